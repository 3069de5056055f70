"""Largest time steps: up to which a code is stable on a scene, and up to which it is accurate.

*Stable.* An impact is over in a finite time, so an unstable step shows as energy that was not there before: a run is
stable where the energy it keeps has grown by no more than a given share of what was in motion. Kept is the least total
energy over the last quarter of the run, for within a contact the energy of velocity-Verlet goes up and comes back at
any step. Without walls it is the energy in the frame of the centre of mass. Where a touch falls within a step decides
as well (the first may fall anywhere: the striker is moved back by parts of its way in a step), and the worst counts.

*Limit.* Neither stability nor accuracy is monotone in the step: there are windows of good steps above bad ones. The
limit is the largest step below which every step tried is good; where a window begins above it, that is told.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from dem_bridge.backends.splitting import Motion
from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.observables.conserved import energy_parts, momentum
from dem_bridge.observables.interpolate import Moving, acceleration, hermite
from dem_bridge.scene.contacts import Contacts
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.dense import Schedule
from dem_bridge.trajectory.relative import relative_size
from dem_bridge.trajectory.trajectory import Floats, Trajectory

#: a code on the steps of a schedule on a scene with these contacts, its own or with a wider first gap
Stepper = Callable[[Scene, Schedule, Contacts], Motion | Trajectory]
#: parts of a step at which the first touch may fall
PHASES = tuple((i + 0.5) / 8.0 for i in range(8))
#: neighbouring steps that are tried, the range of good steps after which all below count as good, and the resolution
RATIO, GUARD, FINEST = 1.05, 2.0, 1.005
#: a search ends here: beyond it no step is tried
MOST_TRIES = 400
#: samples at which velocities are compared
MOST_SAMPLES = 500


@dataclass(frozen=True, kw_only=True)
class Limit:
    """Result of :func:`largest_step`; steps in s."""

    good: float
    """The limit: it and all smaller steps tried are good."""
    bad: float
    """The next larger step tried, which is not."""
    window: float
    """Largest good step that was tried above a bad one; nan: there is none."""


def largest_step(
    is_good: Callable[[float], bool], start: float, *, ratio: float = RATIO, guard: float = GUARD
) -> Limit:
    """Search the largest step (s) below which all are good, downwards from ``start``.

    Steps are tried ``ratio`` apart until all over a factor ``guard`` are good, then the limit is bisected to 0.5 %.
    Where ``start`` and all below are good, it is looked for upwards. RunBroken after 400 steps.

    >>> found = largest_step(lambda dt: dt < 1.0 or 1.2 < dt < 1.4, 3.0)
    >>> 0.995 < found.good < 1.0 <= found.bad < 1.005, 1.2 < found.window < 1.4
    (True, True)
    """
    tried: dict[float, bool] = {}

    def ask(dt: float) -> bool:
        if len(tried) >= MOST_TRIES:
            raise RunBroken(f"no largest step between {min(tried):.3g} and {max(tried):.3g} s in {MOST_TRIES} tries")
        tried[dt] = is_good(dt)
        return tried[dt]

    dt, top = start, start
    while True:
        if not ask(dt):
            top = dt
        elif dt * guard <= top:
            break
        dt /= ratio
    dt = start
    while all(tried.values()):
        dt *= ratio
        ask(dt)
    bad = min(step for step, good in tried.items() if not good)
    good = max(step for step in tried if step < bad)
    window = max((step for step, fine in tried.items() if fine and step > bad), default=math.nan)
    while bad / good > FINEST:
        middle = math.sqrt(bad * good)
        if ask(middle):
            good = middle
        else:
            bad = middle
    return Limit(good=good, bad=bad, window=window)


def contacts_of(scene: Scene, wider: float) -> Contacts:
    """Return the contacts of a scene whose first gap is wider by so much (m)."""
    gap = scene.contacts.gap.copy()
    gap[:1] += wider
    return replace(scene.contacts, gap=gap) if wider else scene.contacts


def struck(scene: Scene) -> bool:
    """Return whether only body 0 moves and nothing else acts, so that a gap before it only delays all later motion."""
    still = scene.velocity[0] > 0.0 and not any(scene.velocity[1:]) and scene.wall_left is None
    outer = scene.gravity != 0.0 or scene.precompression > 0.0 or scene.drag > 0.0 or scene.drive is not None
    return still and not outer and scene.n_body > 1


def steps_of(scene: Scene, dt: float, *, samples: int | None = None) -> Schedule:
    """Return whole steps of ``dt`` (s), at least for the duration of the scene.

    Each step is a sample or, where there would be more than ``samples``, each multiple of steps.
    """
    steps = max(1, math.ceil(scene.duration / dt * (1.0 - 1e-9)))
    each = math.ceil(steps / (samples or steps))
    return Schedule(step=dt, per_sample=each, subdivisions=1, samples=math.ceil(steps / each))


def energies(scene: Scene, run: Moving, contacts: Contacts | None = None) -> tuple[Floats, Floats]:
    """Return kinetic and total energy, J, ``(n_t,)`` both; without walls in the frame of the centre of mass."""
    kinetic, stored, potential = energy_parts(scene, run, contacts)
    if scene.wall_left is None and scene.wall_right is None:
        kinetic = kinetic - momentum(scene, run) ** 2 / (2.0 * sum(scene.mass))
        potential = -run.displacement @ scene.load
    return kinetic, np.asarray(kinetic + stored + potential)


def in_motion(scene: Scene, truth: Trajectory) -> float:
    """Return the largest kinetic energy, J; UsageError where nothing moves."""
    most = float(np.max(energies(scene, truth)[0]))
    if not most > 0.0:
        raise UsageError(f"nothing moves in {scene.name}, so no step is too large; allowed: a scene with an impact")
    return most


def energy_gain(scene: Scene, run: Motion | Trajectory, scale: float, contacts: Contacts | None = None) -> float:
    """Return the permanent growth of the run's energy, in units of ``scale`` (J); inf where it is not finite."""
    count = len(run.time)
    rows = np.r_[0, count - max(1, count // 4) : count]  # the start, and the last quarter
    with np.errstate(over="ignore", invalid="ignore"):
        total = energies(scene, Motion(run.time[rows], run.displacement[rows], run.velocity[rows]), contacts)[1]
        gain = (np.min(total[1:]) - total[0]) / scale
    return float(gain) if np.isfinite(gain) else math.inf


def gain_of(stepper: Stepper, scene: Scene, dt: float, phase: float, scale: float) -> float:
    """:func:`energy_gain` at a step (s); inf where the run breaks."""
    contacts = contacts_of(scene, phase * scene.velocity[0] * dt)
    try:
        return energy_gain(scene, stepper(scene, steps_of(scene, dt), contacts), scale, contacts)
    except RunBroken:
        return math.inf


def stable_step(
    stepper: Stepper,
    scene: Scene,
    *,
    start: float,
    scale: float,
    allowed: float,
    phases: tuple[float, ...] | None = None,
    gains: dict[tuple[float, float], float] | None = None,
    **search: float,
) -> tuple[Limit, float]:
    """Search the largest stable step below which all are stable, and the phase that decides just above it.

    ``start`` (s): where to begin; ``scale`` (J): the energy in motion; ``allowed``: gain over that; ``phases``: of the
    first touch (None: :data:`PHASES` where the scene is struck); ``gains``: those that are known, by step (s) and
    phase, to which new ones are added; ``search``: settings of :func:`largest_step`.
    """
    available = (PHASES if struck(scene) else (0.0,)) if phases is None else phases

    decides: dict[float, float] = {}
    known = {} if gains is None else gains

    def gain(dt: float, phase: float) -> float:
        if (dt, phase) not in known:
            known[dt, phase] = gain_of(stepper, scene, dt, phase, scale)
        return known[dt, phase]

    def is_good(dt: float) -> bool:
        phase = next((phase for phase in available if gain(dt, phase) > allowed), None)
        if phase is not None:
            decides[dt] = phase
        return phase is None

    result = largest_step(is_good, start, **search)
    return result, decides[result.bad]


def velocity_error(stepper: Stepper, scene: Scene, truth: Trajectory, dt: float, phase: float = 0.0) -> float:
    """Return the largest velocity error over bodies and samples, relative to the largest velocity.

    It is inf for a broken run. ``truth`` is a run of the unchanged scene, with samples so close that the error of a
    polynomial between them does not count.
    """
    plan = steps_of(scene, dt, samples=MOST_SAMPLES)
    try:
        run = stepper(scene, plan, contacts_of(scene, phase * scene.velocity[0] * dt))
    except RunBroken:
        return math.inf
    late = phase * dt
    available = (run.time >= late) & (run.time <= late + truth.time[-1] * (1.0 + 1e-12))
    when = np.clip(run.time[available] - late, 0.0, truth.time[-1])
    expected = hermite(truth, truth.velocity, _acceleration(scene, truth), when[:, None])
    with np.errstate(over="ignore", invalid="ignore"):
        difference = float(np.max(np.abs(run.velocity[available] - expected)))
    away = relative_size(difference, float(np.max(np.abs(truth.velocity))))
    return away if math.isfinite(away) else math.inf


@lru_cache(maxsize=2)
def _acceleration(scene: Scene, truth: Trajectory) -> Floats:
    """Return the accelerations of a solution that is read at each step of a search."""
    return acceleration(scene, truth)


def accurate_step(stepper: Stepper, scene: Scene, truth: Trajectory, *, stable: float, accuracy: float) -> Limit:
    """Return the largest step (s) below which all steps have velocity errors of at most ``accuracy``.

    The search begins at three times the step that second order predicts from the error at a quarter of ``stable`` (s),
    the largest stable step.
    """
    phases = PHASES[::3] if struck(scene) else (0.0,)

    def is_good(dt: float) -> bool:
        return all(velocity_error(stepper, scene, truth, dt, phase) <= accuracy for phase in phases)

    seen = velocity_error(stepper, scene, truth, 0.25 * stable)
    return largest_step(is_good, min(stable, 0.75 * stable * math.sqrt(accuracy / seen)))
