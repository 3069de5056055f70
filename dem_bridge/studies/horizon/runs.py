"""Measurements of the horizon study: growth of perturbations, uncertainty over time, long runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dem_bridge.backends.twin import solve_dense
from dem_bridge.observables.conserved import BLOCKS, Drift, drift_of, energy_parts, swing_of, work
from dem_bridge.runs.campaign import Progress
from dem_bridge.runs.uncertainty.fixed_step import REALISATIONS, TwinFamily, last_digit, step_safety
from dem_bridge.runs.uncertainty.from_replicas import LEAST, REFERENCE
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.dense import Schedule
from dem_bridge.trajectory.trajectory import Floats, Trajectory

#: velocities whose bar is this share of the largest are no longer known
KNOWN = 0.01
#: steps between two reports of a long run
LONGEST_PART = 1_000_000


def perturbed(scene: Scene, share: float, seed: int) -> Scene:
    """Return the scene with every mass, velocity and stiffness moved by ``share`` times a normal deviate of its own.

    A drive is moved as a whole. Values of 0 stay, so that a body at rest is at rest. Gaps stay, because they are sums
    of what is left and right of them.
    """
    deviate = np.random.default_rng([2018, seed])

    def moved(value: float) -> float:
        return value * (1.0 + share * float(deviate.standard_normal()))

    values: dict[str, Any] = {
        name: tuple(map(moved, getattr(scene, name))) for name in ("mass", "velocity", "stiffness")
    }
    walls = {side: replace(wall, stiffness=moved(wall.stiffness)) for side, wall in _walls(scene).items()}
    return replace(scene, **values, **walls, drive=None if scene.drive is None else scene.drive.times(moved(1.0)))


def _walls(scene: Scene) -> dict[str, Any]:
    """Return the walls of a scene by the names of their fields."""
    return {side: wall for side in ("wall_left", "wall_right") if (wall := getattr(scene, side)) is not None}


def apart(first: Floats, other: Floats, scale: float) -> Floats:
    """Return the largest difference so far of velocities ``(n_t, n_body)``, over bodies and earlier samples.

    The result, ``(n_t,)``, is in units of ``scale`` (m/s).
    """
    return np.asarray(np.maximum.accumulate(np.max(np.abs(first - other), axis=1)) / scale)


@dataclass(frozen=True, kw_only=True)
class Growth:
    """Growth of a small perturbation of the input, made by :func:`growth_of`."""

    exponential: bool
    """Whether the chain is closed and exp(rate t) fits better than a power of t."""
    rate: float
    """Lyapunov exponent, 1/s, where exponential, else the power."""
    bar: float
    """Half width of its 95 % interval, from the scatter of the perturbations."""
    factor: float
    """Largest distance at the end over the perturbation: a saturated one says nothing of the rate."""
    window: tuple[float, float]
    """s: from where to where was fitted."""
    misfit: tuple[float, float]
    """Root mean square in the logarithm, of exponential and power."""

    @property
    def kind(self) -> str:
        """Return the law of the fit, or "neither" if it is off by more than a factor e."""
        if not self.misfit[0 if self.exponential else 1] <= 1.0:
            return "neither"
        return "exponential" if self.exponential else "power of time"


def growth_of(time: Floats, distance: Floats, share: float, *, closed: bool = True) -> Growth:
    """Fit the growth of perturbations: ``distance (n_perturbation, n_t)``, over the largest speed.

    The fit is between the perturbation itself and 1 % of the largest speed, where it is no longer small; each
    perturbation has its own factor and rate. Only the motion of a ``closed`` chain, between two walls, goes on for ever
    and can have a Lyapunov exponent: the bodies of an open chain fly apart after finitely many collisions, and then a
    difference grows in proportion to time at most. Growth in an open chain is a power of time, however well an
    exponential fits for a while.

    >>> time = np.linspace(0.0, 1.0, 201)
    >>> two = [factor * 1e-10 * np.exp(15.0 * time) for factor in (1.0, 3.0)]
    >>> found = growth_of(time, np.array(two), 1e-10)
    >>> found.exponential, round(found.rate, 6), round(found.bar, 6)
    (True, 15.0, 0.0)
    >>> found = growth_of(time, np.array([1e-10 * time, 2e-10 * time]), 1e-10)
    >>> found.exponential, round(found.rate, 6)
    (False, 1.0)
    >>> growth_of(time, np.array(two), 1e-10, closed=False).kind
    'neither'
    """
    from scipy.stats import t as student

    positive = (time > 0.0) & np.all(distance > 0.0, axis=0)
    middle = np.exp(np.mean(np.log(np.where(positive, distance, 1.0)), axis=0))
    inside = positive & (middle >= share) & (middle < KNOWN)
    if np.sum(inside) < 8:
        inside = positive & (middle < KNOWN)
    factor, nan = float(np.max(distance, initial=0.0)) / share, math.nan
    if np.sum(inside) < 3:
        return Growth(exponential=False, rate=nan, bar=nan, factor=factor, window=(nan, nan), misfit=(nan, nan))
    y = np.log(distance[:, inside])
    fits = {}
    for exponential, x in ((True, time[inside]), (False, np.log(time[inside]))):
        away = x - np.mean(x)
        slopes = y @ away / np.sum(away**2)
        rest = y - np.mean(y, axis=1, keepdims=True) - slopes[:, None] * away
        fits[exponential] = slopes, float(np.sqrt(np.mean(rest**2)))
    better = closed and fits[True][1] < fits[False][1]
    slopes, n = fits[better][0], len(distance)
    bar = float(student.ppf(0.975, n - 1) * np.std(slopes, ddof=1) / math.sqrt(n)) if n > 1 else math.nan
    return Growth(
        exponential=better,
        rate=float(np.mean(slopes)),
        bar=bar,
        factor=factor,
        window=(float(time[inside][0]), float(time[inside][-1])),
        misfit=(fits[True][1], fits[False][1]),
    )


def step_bar(family: TwinFamily, scale: float) -> Floats:
    """Return the time-step uncertainty of velocities up to each sample, ``(n_t,)``, in units of ``scale`` (m/s)."""
    parts = [
        factor * apart(family.main.velocity, family.others[ratio].velocity, scale)
        for ratio, factor in step_safety(family).items()
    ]
    return np.asarray(np.max(parts, axis=0))


def round_off_bar(own_value: Floats, others: Sequence[Floats], plan: Schedule, scale: float) -> Floats:
    """Bar of the round-off up to each sample from other realisations of it, as bars of whole runs have it."""
    result = np.max([apart(own_value, other, scale) for other in others], axis=0)
    speed = float(np.max(np.abs(own_value))) / scale
    digits = REALISATIONS * last_digit(plan) + 0.5 * plan.steps * float(np.finfo(float).eps)
    return np.asarray(REALISATIONS * result + digits * speed)


def reference_bar(own_value: Floats, others: Sequence[Floats], scale: float) -> Floats:
    """Bar of the reference up to each sample, from runs whose inputs were moved by their last digits."""
    return np.asarray(REFERENCE.samples * np.max([apart(own_value, other, scale) for other in others], axis=0) + LEAST)


def horizon_of(time: Floats, bar: Floats) -> float:
    """Return the first time (s) at which a bar is above 1 %; inf: at none."""
    beyond = np.flatnonzero(~(bar <= KNOWN))
    return float(time[beyond[0]]) if len(beyond) else math.inf


@dataclass(frozen=True, kw_only=True, eq=False)
class Trust:
    """Predictability of single velocities by one backend."""

    backend: str
    bar: Floats
    """Of velocities up to each sample, over the largest speed, ``(n_t,)``."""
    error: Floats | None
    """Largest distance to the reference up to each sample, ``(n_t,)``; None of the reference itself."""
    run: Trajectory
    horizon: float
    """s: when the bar is above 1 %; inf: not within the duration."""
    collisions: float
    """Contacts that closed until then; nan: steps are sampled too rarely to count."""

    @property
    def last(self) -> float:
        """Return the uncertainty at the end."""
        return float(self.bar[-1])


@dataclass(frozen=True, kw_only=True, eq=False)
class LongRun:
    """Quantities of a long run of the twin, in SI: arrays ``(n_t,)``, except ``velocity (n_t, n_body)``."""

    dt: float
    steps: int
    time: Floats
    velocity: Floats
    kinetic: Floats
    stored: Floats
    total: Floats
    """Less the work of a drive."""
    conserved: Floats
    """Total energy with what velocity-Verlet swings by added: see :mod:`dem_bridge.observables.conserved`."""
    scale: float
    """J: the most that was in motion."""
    complete: bool = True
    """False: it was stopped."""

    @property
    def drift(self) -> Drift | None:
        """Drift of the conserved energy per second, in units of ``scale``; None: the run is too short."""
        return drift_of(self.time, self.conserved / self.scale) if len(self.time) >= 2 * BLOCKS else None

    @property
    def swing(self) -> tuple[float, float]:
        """Largest distance of the energy from what is conserved, and of the energy from its start, over ``scale``."""
        swing = float(np.max(np.abs(self.conserved - self.total)))
        return swing / self.scale, float(np.max(np.abs(self.total - self.total[0]))) / self.scale

    def predicted_swing(self, until: float) -> float:
        """Root mean square until then (s) of the energy's distance from what is conserved, J."""
        away = (self.conserved - self.total)[self.time <= until]
        return float(np.sqrt(np.mean(away**2)))


def long_run(
    scene: Scene, dt: float, steps: int, *, samples: int = 10_000, progress: Progress | None = None
) -> LongRun:
    """Run the twin for ``steps`` steps of ``dt`` (s) and keep ``samples`` samples.

    The run is made in parts of a million steps, each from where the last one ended. Overlaps and velocities are its
    whole state, so the parts are one run to the last digit. A precompressed, damped or driven scene is run as a whole.
    After Ctrl-C the part that was run is kept. ``progress`` is called with (steps done, steps, label).
    """
    per_sample = max(1, steps // samples)
    count = max(1, steps // per_sample)
    in_parts = scene.precompression == 0.0 and scene.conserves_energy
    each = max(1, LONGEST_PART // per_sample) if in_parts else count
    there, done, complete = np.zeros(scene.n_body), 0, True
    now, parts, results = scene, [], count
    while done < count:
        rows = min(each, count - done)
        part = replace(now, duration=rows * per_sample * dt, samples=rows)
        plan = Schedule(step=dt, per_sample=per_sample, subdivisions=1, samples=rows)
        try:
            if progress is not None:
                progress(done * per_sample, count * per_sample, f"{scene.name}: {count * per_sample:.0e} steps")
            run, dense = solve_dense(part, plan, 0.0)
        except KeyboardInterrupt:
            complete, results = False, done
            break
        kinetic, stored, potential = energy_parts(part, run)
        potential = potential - scene.gravity * there @ np.array(scene.mass) - work(part, run)[0]
        first = 1 if done else 0
        parts.append(np.column_stack([kinetic, stored, potential, swing_of(part, run, dt), run.velocity])[first:])
        there = there + run.displacement[-1]
        done += rows
        if done < count:
            now = _from_here(part, dense.overlap[-1], run.velocity[-1])
    values = np.concatenate(parts) if parts else np.zeros((1, 4 + scene.n_body))
    kinetic, stored, potential, swing = values[:, :4].T
    total = kinetic + stored + potential
    return LongRun(
        dt=dt,
        steps=results * per_sample,
        time=np.asarray(per_sample * dt * np.arange(len(values))),
        velocity=values[:, 4:],
        kinetic=kinetic,
        stored=stored,
        total=total,
        conserved=total + swing,
        scale=float(np.max(kinetic)),
        complete=complete,
    )


def _from_here(scene: Scene, overlap: Floats, velocity: Floats) -> Scene:
    """Return the scene that continues from these overlaps (m, negative: gaps) and velocities."""
    gap, links = (-overlap).tolist(), len(scene.stiffness)
    walls = {side: replace(wall, gap=gap[links + i]) for i, (side, wall) in enumerate(_walls(scene).items())}
    return replace(scene, gap=tuple(gap[:links]), velocity=tuple(velocity.tolist()), **walls)


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """All that the study found, before it is judged."""

    scene: Scene
    plan: Schedule
    perturbation: float
    """Relative."""
    distance: Floats
    """``(n_nudge, n_t)``: largest so far of each perturbation, over the largest speed."""
    growth: Growth
    trusts: tuple[Trust, ...]
    """The reference's first."""
    ensemble: tuple[Trajectory, ...]
    """Of the perturbed scenes."""
    long: LongRun
    halved: LongRun | None
    """At half the step; None: not run."""
    contact_time: float
    """s: of the shortest collision; nan: there is none."""

    @property
    def truth(self) -> Trajectory:
        """Return the run of the reference."""
        return self.trusts[0].run
