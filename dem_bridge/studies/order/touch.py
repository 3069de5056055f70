"""Runs that measure the order of a method of order 4 where contacts open and close: two bodies, and a whole chain.

Two bodies touch at a set place of a step, so that the error of the velocity after the touch is known in closed form
(:mod:`dem_bridge.physics.touch_error`). Runs end before the contact opens: each has one touch, or none.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.blanes_moan import ORDER, SRKN_6B
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.observables.verdict import Verdict, judge
from dem_bridge.physics.exact import scaling, two_body_collision
from dem_bridge.physics.touch_error import touch_coefficient
from dem_bridge.report.texts import Texts
from dem_bridge.runs.case import Case
from dem_bridge.scene import features
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.support import Support
from dem_bridge.trajectory.trajectory import Floats, Trajectory

TEXTS = Texts("order", "dem_bridge.studies")
REFERENCE, METHOD, VERLET = "reference", "blanes-moan", "verlet"
#: steps of the pair until the end of its run, this share of the contact time after the touch
COUNTS, SPAN = (16, 32, 64, 128, 256, 512), 0.4
#: ... and where the error as a function of the phase is extrapolated to a step of 0
PHASES, FINE_COUNTS = np.arange(24) / 24.0, (256, 512)
#: overlap of the pair without a touch, in units of (m v^2 / beta)^(1/n)
PRESSED = 0.3
#: relative errors below which round-off counts: of two bodies, and of chains in units of their largest velocity
FLOOR, CHAIN_FLOOR = 1e-13, 3e-11
#: relative errors above which a chain has no clean order
COARSE = 1e-3
#: half-orders are 0.5 apart, and the next term of the error, a step smaller, moves the order by 0.05 at these steps
ORDER_TOLERANCE = 0.1
#: coefficients C below it are zeros with the round-off of sums of numbers of order 1
ROUNDED = 1e-12
#: what the extrapolation leaves is smaller than C by a step^1.5 (1e-4 at 512 steps), times some units
COEFFICIENT_TOLERANCE = 1e-3
#: exponents that the chain has in turn; sample intervals of its runs
EXPONENTS, CHAIN_SAMPLES = (2.5, 3.0, 3.5, 4.0), 50
#: longest over shortest step, from the first that resolves the stiffest contact; number of steps, of the scene itself
#: more, because each errs by chance
REFINEMENT, RELATIVE_STEPS, CHAIN_STEPS = 100.0, 19, 61
#: static force that keeps contacts closed, in units of the largest force without it
PRESSED_CHAIN = 2.0
#: scenes without a length or a time of their own
SIMILAR = Support(
    {features.WALLS, features.OTHER_EXPONENTS, features.SEVERAL_MOVING},
    scope="the scaling laws are exact for bodies that just touch, under one exponent",
)


@dataclass(frozen=True, kw_only=True)
class PairErrors:
    """Velocity errors of two bodies, with one touch at a phase of the step or with none."""

    name: str
    """Key of its texts."""
    exponent: float
    phase: float | None
    """None: the bodies overlap from the start to the end."""
    steps: Floats
    """Relative to the contact time."""
    errors: Floats
    """Of the relative velocity, over the impact speed, with their sign."""
    unit: Floats
    """Leading term of the errors for a coefficient C of 1; nan where nothing touches."""
    coefficient: float
    """C of the touch; 0 without one."""

    @property
    def predicted(self) -> Floats:
        """Leading term of the errors; zeros where the touch makes none."""
        return self.coefficient * self.unit if self.coefficient else np.zeros_like(self.errors)

    @property
    def measured(self) -> float:
        """C as measured at the two finest steps, extrapolated to a step of 0."""
        coarse, fine = (self.errors / self.unit)[-2:].tolist()
        return float(2.0 * fine - coarse)

    @property
    def predicted_order(self) -> float:
        """The exponent n where a touch has an error of its own, but at most the order of the method."""
        return min(self.exponent, ORDER) if self.coefficient else float(ORDER)

    @property
    def order(self) -> float:
        """Order between the three finest steps whose errors are above round-off."""
        return _last_order(self.steps, self.errors)

    @property
    def left(self) -> float:
        """Order of what is left when the prediction is subtracted; nan without a prediction."""
        return _last_order(self.steps, self.errors - self.predicted) if self.coefficient else math.nan


PAIRS: tuple[tuple[str, float, float | None], ...] = (
    ("hertz_within", 2.5, 0.5),
    ("hertz_grid", 2.5, 0.0),
    ("linear_within", 2.0, 0.5),
    ("linear_grid", 2.0, 0.0),
    ("closed", 2.5, None),
)


def fit_order(steps: Floats, errors: Floats) -> float:
    """Return the slope of log error over log step; nan for fewer than two points."""
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0]) if len(steps) > 1 else math.nan


def _last_order(steps: Floats, errors: Floats) -> float:
    clear = np.abs(errors) > FLOOR
    return fit_order(steps[clear][-3:], np.abs(errors[clear][-3:]))


def pair_errors(name: str, exponent: float, phase: float | None, counts: Iterable[int] = COUNTS) -> PairErrors:
    """Run two bodies at several steps, in units of their effective mass, impact speed and stiffness."""
    hit = two_body_collision(masses=(2.0, 2.0), velocities=(1.0, 0.0), stiffness=1.0, exponent=exponent)
    power = math.log(scaling(exponent=exponent, velocity=math.e).time)
    rows = []
    for count in counts:
        step = SPAN * hit.contact_time / count
        scene = Scene(
            name="pair",
            duration=count * step,
            mass=(2.0, 2.0),
            stiffness=(1.0,),
            velocity=(1.0, 0.0),
            gap=(-PRESSED if phase is None else phase * step,),
            exponent=exponent,
        )
        run, exact = (solve_with_step(scene, backend, step, 1) for backend in (METHOD, REFERENCE))
        speed, error = (float(v[-1, 0] - v[-1, 1]) for v in (exact.velocity, run.velocity - exact.velocity))
        # the error at the touch grows by du/dv, and u = v f(t v^-power) with v = 1: the force is the deceleration
        since = math.nan if phase is None else (count - phase) * step
        growth = speed + power * since * float(exact.contact_force[-1, 0])
        rows.append((step / hit.contact_time, error, -growth * step**exponent))
    steps, errors, unit = np.array(rows).T
    coefficient = 0.0 if phase is None else touch_coefficient(*SRKN_6B, exponent=exponent, phase=phase)
    if abs(coefficient) < ROUNDED:
        coefficient = 0.0
    return PairErrors(
        name=name, exponent=exponent, phase=phase, steps=steps, errors=errors, unit=unit, coefficient=coefficient
    )


def coefficients(exponent: float) -> tuple[Floats, Floats]:
    """Return the coefficient C at :data:`PHASES`, measured and predicted."""
    pairs = [pair_errors("", exponent, phase, FINE_COUNTS) for phase in PHASES.tolist()]
    return np.array([pair.measured for pair in pairs]), np.array([pair.coefficient for pair in pairs])


@dataclass(frozen=True, kw_only=True)
class ChainErrors:
    """Velocity errors of a chain at many steps."""

    label: str
    backend: str
    exponent: float
    """The smallest of the contacts."""
    touches: int
    """Openings and closings in the run of the reference."""
    steps: Floats
    """s."""
    errors: Floats
    """Largest of all samples and bodies, over the largest velocity."""

    @property
    def clean(self) -> tuple[Floats, Floats]:
        """Steps and errors that are neither coarse nor round-off."""
        chosen = (self.errors < COARSE) & (self.errors > CHAIN_FLOOR)
        return self.steps[chosen], self.errors[chosen]

    @property
    def order(self) -> float:
        """Order over all clean steps."""
        return fit_order(*self.clean)

    @property
    def windows(self) -> tuple[float, float]:
        """Smallest and largest order over half of the clean steps, one after another."""
        steps, errors = self.clean
        half = max(2, (len(steps) + 1) // 2)
        orders = [fit_order(steps[at : at + half], errors[at : at + half]) for at in range(len(steps) - half + 1)]
        return (min(orders), max(orders)) if orders else (math.nan, math.nan)


def chain_errors(scene: Scene) -> Iterator[ChainErrors]:
    """Yield the errors of velocity-Verlet on a scene, and of the method of order 4 on the scene and on its relatives.

    Relatives have other exponents, with the same force at the largest overlap of each contact, or are precompressed so
    that no contact opens.
    """
    exponent = scene.contacts.exponent
    depth = prescan_scene(scene).peak_overlap
    yield _errors_of(scene, VERLET, "chain")
    yield _errors_of(scene, METHOD, "chain", CHAIN_STEPS)
    for other in EXPONENTS if np.all(exponent == exponent[0]) else ():
        if other != exponent[0]:
            factor = np.where(depth > 0.0, depth, 1.0) ** (exponent - other)
            yield _errors_of(with_stiffness(scene, factor, other), METHOD, "relative")
    if SIMILAR.covers(scene):
        force = PRESSED_CHAIN * float(np.max(scene.contacts.stiffness * depth ** (exponent - 1.0)))
        yield _errors_of(replace(scene, precompression=force), METHOD, "pressed")


def with_stiffness(scene: Scene, factor: Floats, exponent: float | None = None) -> Scene:
    """Return the scene with each stiffness times ``factor (n_contact,)``, walls included, and with another exponent."""
    stiffness, links = (scene.contacts.stiffness * factor).tolist(), len(scene.stiffness)
    other: dict[str, Any] = {} if exponent is None else {"exponent": exponent}
    walls = iter(stiffness[links:])
    changed = other | {
        side: replace(wall, stiffness=next(walls), **other)
        for side in ("wall_left", "wall_right")
        if (wall := getattr(scene, side)) is not None
    }
    return replace(scene, stiffness=tuple(stiffness[:links]), geometry=None, **changed)


def _errors_of(scene: Scene, backend: str, label: str, count: int = RELATIVE_STEPS) -> ChainErrors:
    interval = scene.duration / CHAIN_SAMPLES
    first = max(1.0, interval * prescan_scene(scene).frequency)
    counts = np.unique(np.rint(np.geomspace(first, REFINEMENT * first, count)))
    exact = solve_with_step(scene, REFERENCE, 0.0, CHAIN_SAMPLES)
    runs = (solve_with_step(scene, backend, interval / count, CHAIN_SAMPLES) for count in counts.tolist())
    errors = [np.max(np.abs(run.velocity - exact.velocity)) for run in runs]
    exponents = scene.contacts.exponent
    return ChainErrors(
        label=TEXTS(label, backend=backend, exponent=f"{exponents.min():g}", force=scene.precompression),
        backend=backend,
        exponent=float(exponents.min()),
        touches=exact.provenance["openings"] + exact.provenance["closings"],
        steps=interval / counts,
        errors=np.array(errors) / np.max(np.abs(exact.velocity)),
    )


def solve_with_step(scene: Scene, backend: str, step: float, samples: int) -> Trajectory:
    """Return a run; a step larger by a rounding error keeps the number of steps."""
    resolution = Resolution(dt=step * (1.0 + 1e-9) if step else None)
    return Case(scene=scene, backend=backend, resolution=resolution, sampling=Sampling(count=samples)).solve()


def order_verdict(pair: PairErrors) -> Verdict:
    """Judge whether two bodies have the predicted order."""
    difference = abs(pair.order - pair.predicted_order)
    outcome = judge(difference, 0.0, ORDER_TOLERANCE)
    numbers = {"difference": difference, "scale": 1.0, "tolerance": ORDER_TOLERANCE, "outcome": outcome}
    return TEXTS.verdict("order", **numbers, pair=pair, label=TEXTS(pair.name))


def coefficient_verdict(exponent: float, measured: Floats, predicted: Floats) -> Verdict:
    """Judge whether the error of a touch has the predicted size at every phase."""
    scale = float(np.max(np.abs(predicted)))
    difference = float(np.max(np.abs(measured - predicted))) / scale
    outcome = judge(difference, 0.0, COEFFICIENT_TOLERANCE)
    numbers = {"difference": difference, "scale": scale, "tolerance": COEFFICIENT_TOLERANCE, "outcome": outcome}
    return TEXTS.verdict("coefficient", **numbers, exponent=exponent, count=len(predicted))
