"""Measurements of the stability study: limits of one scene and of families of small scenes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.lammps_motion import Granular
from dem_bridge.backends.reference import Reference
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.backends.surrogate_radius import surrogate_radius
from dem_bridge.backends.twin import solve_motion
from dem_bridge.errors import RunBroken
from dem_bridge.lmp.pair_coefficients import GRANULAR_STYLE
from dem_bridge.observables.conserved import momentum
from dem_bridge.observables.modes import highest_frequencies
from dem_bridge.physics.exact import two_body_collision
from dem_bridge.report.texts import Texts
from dem_bridge.scene.file import parse_scene
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.timescales import rayleigh_time_of
from dem_bridge.studies.stability import step_limits
from dem_bridge.studies.stability.step_limits import Limit, Stepper, energies, stable_step
from dem_bridge.trajectory.trajectory import Floats, Trajectory

TEXTS = Texts("stability", "dem_bridge.studies")
#: scene of the family of contact angles: crossed quartz cylinders, struck by a sphere
CYLINDERS = """
name = "angle"
duration = 1.0
[material]
youngs_modulus = 72.0e9
poissons_ratio = 0.17
density = 2200.0
[chain.cylinders]
count = 5
radius = 9.0e-3
height = 18.0e-3
[chain.contacts]
law = "exact"
angle = {angle!r}
[chain.striker]
radius = 9.0e-3
velocity = {speed!r}
"""
#: wanted of velocities
ACCURACIES = (1e-2, 1e-4)
#: LAMMPS looks so far below the twin's limit, at steps so close
BESIDE, CLOSE = 1.15, 1.04
#: radius of LAMMPS' bodies over the least that serves: a run must not end because its deck is too narrow
ROOM = 16.0
#: samples of a truth: phase of the highest mode between two, least and most
PHASE, FEWEST, MOST = 0.05, 4000, 50_000
#: of the scenes in families: kg, N/m^1.5, m/s
MASS, STIFFNESS, SPEED = 1e-2, 4e9, 1.0

#: other shares, for how much the limit depends on it
GAINS = (0.01, 0.1, 1.0, 10.0)
#: the largest stable step over those in the table of the trap, and over those in its figure
SHARES, CURVE = (8.0, 4.0, 2.0, 1.0), np.geomspace(32.0, 1.0, 16)
#: omega dt and phase of the first touch of two bodies
STEPS: Floats = np.linspace(0.05, 2.5, 50)
PHASES: Floats = np.asarray((np.arange(16) + 0.5) / 16.0)


@dataclass(frozen=True, kw_only=True)
class Family:
    """Scenes along one parameter."""

    id: str
    values: Floats
    scene_at: Callable[[float], Scene]


@dataclass(frozen=True, kw_only=True, eq=False)
class Measured:
    """One scene with its truth and what steps are set beside."""

    scene: Scene
    truth: Trajectory
    pair: float
    """rad/s: highest of one contact between its two bodies."""
    mode: float
    """rad/s: highest of all contacts together."""
    deepest: float
    """m: largest overlap of the prescan."""
    scale: float
    """J: the most that is in motion."""
    gains: dict[tuple[float, float], float] = field(default_factory=dict)
    """Growth of the energy of the twin's runs by step (s) and phase, as far as it is known."""


def families(points: int) -> tuple[Family, ...]:
    """Return the four families, each over ``points`` values evenly spaced in the logarithm."""
    equal, stiff = (MASS,) * 4, STIFFNESS
    table: tuple[tuple[str, tuple[float, float], Callable[[float], Scene]], ...] = (
        ("speed", (1e-3, 1e2), lambda v: chain("speed", equal[:2], (stiff,), v)),
        ("mass", (1e-3, 1e3), lambda ratio: chain("mass", (MASS, ratio * MASS, MASS), (stiff,) * 2)),
        ("stiffness", (1e-4, 1e4), lambda ratio: chain("stiffness", equal, (stiff, ratio * stiff, stiff))),
        ("angle", (0.1, 90.0), cylinders),
    )
    return tuple(Family(id=id, values=np.geomspace(*ends, points), scene_at=scene_at) for id, ends, scene_at in table)


def chain(name: str, mass: tuple[float, ...], stiffness: tuple[float, ...], speed: float = SPEED) -> Scene:
    """Return a chain in touch, struck by its first body, that lasts until the impact is over."""
    velocity, duration = (speed, *(0.0,) * (len(mass) - 1)), _until_over(mass[0], speed, stiffness)
    return Scene(name=name, duration=duration, mass=mass, stiffness=stiffness, velocity=velocity)


def cylinders(angle: float) -> Scene:
    """Return five quartz cylinders of 9 mm at this angle (degrees), struck by a sphere; Hertz' exact law."""
    scene = parse_scene(CYLINDERS.format(angle=angle, speed=SPEED))
    return replace(scene, duration=_until_over(scene.mass[0], scene.velocity[0], scene.stiffness))


def _until_over(mass: float, speed: float, stiffness: Sequence[float]) -> float:
    """Return six times the time of collisions of two such strikers through each contact, at the striker's speed, s."""
    masses, speeds = (mass,) * 2, (speed, 0.0)
    return 6.0 * sum(
        two_body_collision(masses=masses, velocities=speeds, stiffness=beta, exponent=2.5).contact_time
        for beta in stiffness
    )


def measured(scene: Scene) -> Measured:
    """Solve a scene by the reference, and return its highest frequencies; UsageError where nothing moves or touches."""
    prescan = prescan_scene(scene)
    count = math.ceil(math.sqrt(2.0) * prescan.frequency * scene.duration / PHASE)
    sampling = Sampling(count=min(max(count, FEWEST), MOST))
    truth = Reference().run(scene, Resolution(), sampling)
    scale = step_limits.in_motion(scene, truth)
    pair, mode = highest_frequencies(scene, truth)
    deepest = float(np.max(prescan.peak_overlap, initial=0.0))
    return Measured(scene=scene, truth=truth, pair=pair, mode=mode, deepest=deepest, scale=scale)


def stable_at(result: Measured, allowed: float) -> tuple[Limit, float]:
    """Return the twin's largest stable step and the phase that decides; ``allowed``: growth of the energy."""
    search: dict[str, Any] = {"start": 3.0 / result.mode, "scale": result.scale, "gains": result.gains}
    return stable_step(solve_motion, result.scene, allowed=allowed, **search)


def point_of(
    result: Measured, *, family: str = "", value: float = math.nan, allowed: float, engine: Stepper | None = None
) -> dict[str, Any]:
    """Return all limits of a scene and their ratios by name; times in s.

    ``engine``: LAMMPS, if its limit is searched next to that of the twin. ``value`` is the parameter of the ``family``.
    """
    limit, phase = stable_at(result, allowed)
    stable, pair, mode, of_engine = limit.good, result.pair, result.mode, math.nan
    if engine is not None:
        search: dict[str, Any] = {"start": limit.bad, "scale": result.scale, "ratio": CLOSE, "guard": BESIDE}
        of_engine = stable_step(engine, result.scene, allowed=allowed, phases=(phase,), **search)[0].good
    coarse, fine = (
        step_limits.accurate_step(solve_motion, result.scene, result.truth, stable=stable, accuracy=accuracy).good
        for accuracy in ACCURACIES
    )
    rayleigh = rayleigh_time_of(result.scene) or math.nan
    return {
        "family": family,
        "varied": TEXTS.data["families"][family]["axis"] if family else result.scene.name,
        "name": result.scene.name,
        "value": value,
        "over_pair": 2.0 / pair,
        "over_mode": 2.0 / mode,
        "stable": stable,
        "window": limit.window,
        "engine": of_engine,
        "engine_ratio": of_engine / stable,
        "pair_ratio": 0.5 * stable * pair,
        "mode_ratio": 0.5 * stable * mode,
        "omega_dt": stable * pair,
        "coarse": coarse,
        "fine": fine,
        "over_coarse": stable / coarse,
        "over_fine": stable / fine,
        "rayleigh": rayleigh,
        "share": stable / rayleigh,
        "coarse_share": coarse / rayleigh,
    }


def engine_on(result: Measured, lammps: Granular) -> Stepper | None:
    """Return LAMMPS on a scene; None where ``pair_style granular`` cannot express it."""
    if not GRANULAR_STYLE.covers(result.scene):
        return None
    return partial(lammps.motion, radius=ROOM * surrogate_radius(result.deepest))


@dataclass(frozen=True, kw_only=True)
class Trap:
    """One run of a scene at a large step: what looks right in it and what is wrong. All relative; inf: it broke."""

    backend: str
    dt: float
    """s."""
    velocity: float = math.inf
    """Largest error over all samples and bodies, over the truth's largest velocity."""
    last: float = math.inf
    """The same at the end alone."""
    momentum: float = math.inf
    """Largest change over that of the start; nan: walls or weight change it."""
    kinetic: float = math.inf
    """Error of the kinetic energy at the end, over the truth's there."""
    energy: float = math.inf
    """What the total energy has grown by at the end, over what was in motion."""


def trap_of(result: Measured, stepper: Stepper, backend: str, dt: float) -> Trap:
    """Compare a run at ``dt`` (s) with the reference; all numbers are inf where it breaks."""
    scene, truth = result.scene, result.truth
    try:
        run = stepper(scene, step_limits.steps_of(scene, dt), scene.contacts)
    except RunBroken:
        return Trap(backend=backend, dt=dt)
    # the end of the scene need not fall on a step
    final = int(np.searchsorted(run.time, truth.time[-1] * (1.0 + 1e-12), side="right")) - 1
    available, _ = energies(result.scene, truth)
    kinetic, total = energies(scene, run)
    speed = float(np.max(np.abs(truth.velocity)))
    series = momentum(scene, run)
    start = float(np.sum(np.array(scene.mass) * np.abs(run.velocity[0])))
    companion = np.array([np.interp(run.time[final], truth.time, column) for column in truth.velocity.T])
    return Trap(
        backend=backend,
        dt=dt,
        velocity=step_limits.velocity_error(stepper, result.scene, truth, dt),
        last=float(np.max(np.abs(run.velocity[final] - companion))) / speed,
        momentum=float(np.max(np.abs(series - series[0]))) / start
        if scene.conserves_momentum and start > 0.0
        else math.nan,
        kinetic=abs(float(kinetic[final]) / float(np.interp(run.time[final], truth.time, available)) - 1.0),
        energy=float(total[final] - total[0]) / result.scale,
    )


def gain_map(pair: Measured, steps: Floats, phases: Floats) -> Floats:
    """Return the energy growth of two bodies, ``(n_phase, n_step)``, over ``steps`` (omega dt) and phases.

    It is the same for all masses, speeds and stiffnesses, because two Hertzian bodies have no scale.
    """
    gain = partial(step_limits.gain_of, solve_motion, pair.scene, scale=pair.scale)
    return np.array([[gain(x / pair.pair, phase) for x in steps] for phase in phases.tolist()])
