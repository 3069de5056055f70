"""Condition numbers of observables under common factors on all velocities, stiffnesses and masses.

A chain of bodies that just touch has no scale of its own (:func:`dem_bridge.physics.exact.scaling`): every observable
of a front is a product of powers of the impact speed, the stiffness and the mass, and the powers are the relative
condition numbers. A trace at a fixed time is ``f = F g(t / T)``, so that ``df/dln p = F' f - T' t df/dt`` with F' and
T' the powers of F and T. Both are checked by differences of runs of the reference.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.errors import RunBroken
from dem_bridge.observables.differences import read
from dem_bridge.observables.verdict import Outcome, Verdict, judge_relative
from dem_bridge.physics.exact import Scaling, scaling
from dem_bridge.runs.campaign import Jobs, Progress, run_cases
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.order.touch import REFERENCE, TEXTS, with_stiffness
from dem_bridge.trajectory.trajectory import Floats, Trajectory

PARAMETERS = ("velocity", "stiffness", "mass")
#: observable of a front -> the quantity that it is proportional to, and the power
FRONT: Mapping[str, tuple[str, int]] = {
    "arrival": ("time", 1),
    "residence_time": ("time", 1),
    "front_speed": ("time", -1),
    "peak_velocity": ("velocity", 1),
    "first_peak_force": ("force", 1),
}
#: observable at a fixed time -> the quantity of its size
TRACES: Mapping[str, str] = {"velocity": "velocity", "displacement": "displacement"}
#: changes of ln p: a difference of logarithms is exact for powers, however large the change; for traces two small ones
FRONT_CHANGE, TRACE_CHANGES = 0.05, (1e-5, 2e-5)


@dataclass(frozen=True, kw_only=True)
class ConditionNumber:
    """Relative condition number of one observable with respect to one parameter."""

    observable: str
    parameter: str
    exact: float
    """With its sign; for a trace the largest magnitude, over the largest of the trace."""
    measured: float
    """By differences, where they deviate the most; for a trace the largest magnitude."""
    difference: float
    """Largest deviation of a difference from the exact number, over all bodies, contacts and samples."""
    uncertainty: float
    """Of the difference of runs at that place."""


def conditions(
    scene: Scene, *, jobs: Jobs = None, progress: Progress | None = None, store: Store | None = None
) -> tuple[ConditionNumber, ...]:
    """Return the condition numbers of a scene that :data:`~dem_bridge.studies.order.touch.SIMILAR` covers.

    Runs whose front is compared last as long as the part of the motion that the scene shows, by the scaling law.
    """
    changes = [sign * change for change in (FRONT_CHANGE, *TRACE_CHANGES) for sign in (1.0, -1.0)]
    scenes = {(name, change): scaled(scene, name, change) for name in PARAMETERS for change in changes}
    base = Case(scene=scene, backend=REFERENCE, resolution=Resolution(), sampling=Sampling(count=scene.samples))
    cases = [base, *(replace(base, scene=item, uncertainty=False) for item in scenes.values())]
    results = run_cases(cases, jobs=jobs, progress=progress, store=store)
    runs = [result.trajectory for result in results if result.trajectory is not None]
    if len(runs) < len(cases):
        raise RunBroken(f"{scene.name}: {next(result.failure for result in results if result.failure)}")
    exact, moved = runs[0], dict(zip(scenes, runs[1:], strict=True))

    def difference(
        observable: str, parameter: str, change: float, of: Callable[[Floats], Floats] = np.asarray
    ) -> Floats:
        keys = [(parameter, sign * change) for sign in (1.0, -1.0)]
        up, down = (of(read(observable, scenes[key], moved[key]).values) for key in keys)
        return np.asarray((up - down) / (2.0 * change))

    chosen: list[ConditionNumber] = []
    for parameter in PARAMETERS:
        powers = _powers(scene, parameter)
        for name, (quantity, sign) in FRONT.items():
            values = read(name, scene, exact)
            with np.errstate(divide="ignore", invalid="ignore"):
                measured = difference(name, parameter, FRONT_CHANGE, np.log)
                uncertainty = values.uncertainty / np.abs(values.values) / FRONT_CHANGE
            chosen.append(_condition(name, parameter, np.array(sign * powers[quantity]), measured, uncertainty))
        for name, quantity in TRACES.items():
            values = read(name, scene, exact)
            scale = float(np.max(np.abs(values.values)))
            law = powers[quantity] * values.values - powers["time"] * exact.time[:, None] * trace_rate(
                scene, exact, name
            )
            small, large = (difference(name, parameter, change) / scale for change in TRACE_CHANGES)
            # the error of a central difference is a third of what doubling the change adds
            uncertainty = np.max(np.abs(large - small)) + np.max(values.uncertainty) / scale / TRACE_CHANGES[0]
            chosen.append(_condition(name, parameter, law / scale, small, np.full(law.shape, uncertainty)))
    return tuple(chosen)


def _condition(name: str, parameter: str, exact: Floats, measured: Floats, uncertainty: Floats) -> ConditionNumber:
    """Return the condition number of a front (``exact`` is one number) or of a trace."""
    deviation = np.abs(measured - exact)
    ratio = np.where(np.isfinite(deviation), deviation / uncertainty, -1.0)
    worst = np.unravel_index(int(np.argmax(ratio)), ratio.shape)
    trace = np.ndim(exact) > 0
    return ConditionNumber(
        observable=name,
        parameter=parameter,
        exact=float(np.max(np.abs(exact)) if trace else exact),
        measured=float(np.max(np.abs(measured)) if trace else measured[worst]),
        difference=float(deviation[worst]),
        uncertainty=float(uncertainty[worst]),
    )


def scaled(scene: Scene, parameter: str, change: float) -> Scene:
    """Return the scene with a parameter times exp(change); small changes keep the duration, large ones the motion.

    The duration of the latter is that of the same part of the motion.
    """
    factor = math.exp(change)
    name = f"{scene.name[:80]}.{parameter}"
    duration = scene.duration * (_scaling(scene, parameter, factor).time if abs(change) == FRONT_CHANGE else 1.0)
    if parameter == "stiffness":
        return replace(with_stiffness(scene, np.full(scene.n_contact, factor)), name=name, duration=duration)
    changed: dict[str, Any] = {parameter: tuple(factor * value for value in getattr(scene, parameter))}
    return replace(scene, name=name, duration=duration, geometry=None, **changed)


def _scaling(scene: Scene, parameter: str, factor: float) -> Scaling:
    return scaling(exponent=float(scene.contacts.exponent[0]), **{parameter: factor})


def _powers(scene: Scene, parameter: str) -> dict[str, float]:
    """Return the power of the parameter in each quantity."""
    return {name: math.log(value) for name, value in vars(_scaling(scene, parameter, math.e)).items()}


def trace_rate(scene: Scene, run: Trajectory, name: str) -> Floats:
    """Return the time derivative of a trace ``(n_t, n_body)``."""
    if name == "displacement":
        return run.velocity
    c = scene.contacts
    force = np.zeros((len(run.time), scene.n_body + 1))
    for contact, (left, right) in enumerate(zip(c.left.tolist(), c.right.tolist(), strict=True)):
        force[:, left] -= run.contact_force[:, contact]
        force[:, right] += run.contact_force[:, contact]
    return np.asarray(force[:, :-1] / np.array(scene.mass))


def verdict(scene: Scene, rows: Sequence[ConditionNumber]) -> Verdict:
    """Judge one observable: differences of runs deviate from the law by no more than their uncertainty."""
    worst = max(rows, key=lambda row: row.difference / row.uncertainty)
    outcome = judge_relative(worst.difference, 0.0, worst.uncertainty)
    numbers = {"difference": worst.difference, "scale": 1.0, "tolerance": worst.uncertainty, "outcome": outcome}
    relation = {Outcome.PASS: "within", Outcome.FAIL: "above"}.get(outcome, "not decided by")
    name = worst.observable
    return TEXTS.verdict("conditioning", scene=scene.name, **numbers, observable=name, worst=worst, relation=relation)
