"""The uncertainty of a run with a fixed step, from a family of runs of the same method that share its settings.

The family depends on scene, steps, radius and tables alone, and the uncertainty uses no value of the run itself: a
wrong run cannot widen its own uncertainty. Each part is measured apart:

*Time step.* Runs at the step of the run, at about twice and at a third of it. For a method of second order the error is
a third of the first difference and nine eighths of the second; the larger of the two counts, because one of them can be
small by chance, and ``STEP_SAFETY`` times that, because the order is not clean everywhere.

*Round-off.* A code that stores absolute positions rounds them at every step and subtracts them for every overlap. The
twin can do the same; its difference to the twin in overlap variables is that round-off, with the conditioning of the
scene in it. On the paper's chains it predicts that of LAMMPS to 1 %; ``REALISATIONS`` times it counts, because it is
one realisation of a random quantity.

*Summation.* Equal increments round alike, half a unit in the last place at most at every step.

*Tables.* The twin with LAMMPS' tables and the twin with the laws themselves, at the same step; for a law that is a
function, the twin's own interpolation of it and one with half as many cells.

*Thinning.* Peak forces and crossing times are read between dense samples (:mod:`dem_bridge.trajectory.dense`): the
readings from all of them and from every second one.

*Secondary peak force.* As far as velocities are uncertain, the next largest collision of a contact may be its largest.

*Early touches.* Adhesion and a dashpot set in at touch. A run with a fixed step has their force from the end of that
step, and is wrong by an impulse of the force times part of a step. Later touches fall on other parts of the steps of
the other runs, whose differences show it. In the first step all runs miss the force times the time until the touch
alike, and the part of their error that is proportional to the step may cancel that of other forces.

*Undetected grazes*, *undecided crossings* and *unresolved contacts*: see :mod:`.grazes`.

The share of random scenes in which the true error is within the uncertainty is measured in tests/bench/bench_bars.py.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.runs.uncertainty.grazes import Doubt, widen_for_moments
from dem_bridge.runs.uncertainty.moments import Moments, Reached
from dem_bridge.runs.uncertainty.run_differences import absolute_differences, at_least_the_median
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.dense import CROSSING_ERROR, PEAK_ERROR, Schedule
from dem_bridge.trajectory.relative import own_scale, relative_size
from dem_bridge.trajectory.trajectory import FREE, QUANTITIES, SAMPLED, Cost, Floats, Trajectory, Uncertainty

#: one realisation of round-off stands for others up to this factor
REALISATIONS = 3.0
#: factor between an error of clean order and its uncertainty, which then holds where the order is not clean, too
STEP_SAFETY = 3.0
#: the twin has LAMMPS' tables to the last digit; only the distance of each run to the exact laws differs
TABLE_SAFETY = 2.0
_EPSILON = float(np.finfo(float).eps)

#: one part of the uncertainty: a number for sampled quantities, one per contact for the others
Part = dict[str, Any]


@dataclass(frozen=True, kw_only=True, eq=False)
class DenseReadings:
    """Numbers read off the dense samples of a run, between those that its trajectory keeps."""

    thinned: tuple[Floats, Floats]
    """Peak forces (N) and crossing times (s) from every second dense sample."""
    secondary_peak_force: Floats
    """Largest force of each contact outside the collision that has its largest, N."""
    unresolved: NDArray[np.bool_]
    """Contacts whose first compression is briefer than the step."""
    drift: Floats
    """Overlap, m, that round-off may give to each contact whose bodies fly in touch; 0 for all others."""
    reached: Reached
    """How far each contact was closed, at most and at the end."""
    moments: Moments | None = None
    """Moments that errors of the size of the uncertainty could decide otherwise; None: there are none."""
    elsewhere: Mapping[float, tuple[Floats, Floats]] = field(default_factory=dict)
    """Overlaps (m) and closing rates (m/s) of the runs at other steps at these moments, by the ratio of their step."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TwinFamily:
    """Runs of one method from which the uncertainty of a run with the same settings follows."""

    scene: Scene
    plan: Schedule
    """Steps of ``main``, ``positional``, ``tabled`` and ``halved``."""
    order: int
    main: Trajectory
    """The run in overlap variables, with the laws themselves."""
    others: Mapping[float, Trajectory]
    """The same at a coarser and a finer step, by the ratio of their step to that of the plan."""
    positional: Trajectory
    """As ``main``, in absolute positions; with the tables if there are any, for these are looked up by a distance."""
    tabled: Trajectory | None = None
    """As ``main``, with tables; None: the code has the laws themselves."""
    halved: Trajectory | None = None
    """As ``main``, with laws that are functions from half as many cells; None: the laws are powers."""
    readings: DenseReadings
    """Of ``positional``."""
    thinning: float
    """Part of the change by thinning that counts."""
    scatter: float = 0.0
    """Factor of the difference between the ``others`` that counts as an error of the time step, too."""
    cost: Cost = FREE
    """Cost of all runs of the family."""

    @property
    def speed(self) -> float:
        """Largest velocity, m/s."""
        return float(np.max(np.abs(self.main.velocity)))


def fixed_step_uncertainty(family: TwinFamily, summed: float | None = None, *, drifts: bool = False) -> Uncertainty:
    """Return the uncertainty of a run with the settings of a family.

    Parameters
    ----------
    family : TwinFamily
    summed : float, optional
        For a code whose contact forces are running sums of net forces: the sum of all other forces, N. None: the code
        gives its contact forces.
    drifts : bool
        Whether bodies that fall in touch drift in the code: it may have crossings by round-off.
    """
    step, roundoff, tables = time_step_part(family), roundoff_differences(family), table_part(family)
    reading, lost = reading_part(family)
    total = _sum(step, roundoff_part(family, roundoff), summation_part(family, summed), tables, reading)
    total = _sum(total, early_touch_part(family))
    drifted = family.scene.contacts.force(family.readings.drift, np.arange(family.scene.n_contact))
    total["peak_force"] = total["peak_force"] + secondary_peak_part(family, total["velocity"]) + drifted
    unresolved = family.readings.unresolved | (drifts & (family.readings.drift > 0.0))
    total["crossing_time"] = np.where(unresolved, math.inf, total["crossing_time"])
    moments = family.readings.moments
    if moments is not None:
        doubt = doubt_at_moments(family)
        total = widen_for_moments(total, family.scene, family.main, moments, doubt, family.readings.reached)
    # a crossing that may be after the end of the run may be none
    late = family.main.crossing_time + total["crossing_time"] > family.main.time[-1]
    total["crossing_time"] = np.where(late, math.inf, total["crossing_time"])
    if not family.plan.resolved:
        # no run of the family is sampled densely enough to see what happens between its samples
        total["peak_force"] = total["crossing_time"] = math.inf
    return Uncertainty(
        **total,
        parts=_velocity_parts(family, step, roundoff, tables),
        roundoff_floor=relative_size(float(roundoff["velocity"]), family.speed),
        # kept samples are steps: only peaks and crossings are read between steps
        sampling=dict.fromkeys(QUANTITIES, 0.0)
        | {
            name: float(np.max(relative_size(amount, own_scale(getattr(family.main, name))), initial=0.0))
            for name, amount in lost.items()
        },
        cost=family.cost,
    )


def sampled_uncertainty(family: TwinFamily) -> dict[str, float]:
    """Return the uncertainty of velocities and displacements without that of single contacts."""
    roundoff = roundoff_part(family, roundoff_differences(family))
    step = _sum(time_step_part(family), early_touch_part(family))
    total = _sum(step, roundoff, summation_part(family, None), table_part(family))
    return {name: float(total[name]) for name in SAMPLED}


def doubt_at_moments(family: TwinFamily) -> Doubt:
    """Return the uncertainty of overlaps and closing rates at the undecided moments.

    Differences to the runs at other steps are those of the same contact at the same time; two bodies round, and lose
    the last digit of every step.
    """
    moments, factor, elsewhere = family.readings.moments, step_safety(family), family.readings.elsewhere
    assert moments is not None
    roundoff, tables = roundoff_part(family, roundoff_differences(family)), table_part(family)
    summation = summation_part(family, None)
    parts = []
    for nth, (name, here) in enumerate((("displacement", moments.overlap), ("velocity", moments.rate))):
        there = {ratio: values[nth] for ratio, values in elsewhere.items()}
        step = np.max([factor[ratio] * np.abs(value - here) for ratio, value in there.items()], axis=0)
        step = step + family.scatter * np.ptp(list(there.values()), axis=0)
        parts.append(step + 2.0 * float(roundoff[name] + tables[name] + summation[name]))
    return Doubt(parts[0] + moments.lost, parts[1])


def time_step_part(family: TwinFamily) -> Part:
    """Return the uncertainty by the time step; no contact has less than the median of all, relative to its own."""
    factor = step_safety(family)
    differences = {ratio: absolute_differences(family.main, other) for ratio, other in family.others.items()}
    part = {
        name: np.max([factor[ratio] * each[name] for ratio, each in differences.items()], axis=0) for name in QUANTITIES
    }
    if family.scatter:
        between = absolute_differences(*family.others.values())
        part = {name: part[name] + family.scatter * between[name] for name in QUANTITIES}
    # errors of forces scale with the force; a late crossing is late by the delays of all before it
    size = np.nan_to_num(np.abs(family.main.peak_force))
    return part | {
        "velocity": float(part["velocity"]),
        "displacement": float(part["displacement"]),
        "peak_force": at_least_the_median(part["peak_force"], size),
        # what never crosses has no error that could count among them
        "crossing_time": at_least_the_median(
            part["crossing_time"], np.isfinite(family.main.crossing_time).astype(np.float64)
        ),
    }


def step_safety(family: TwinFamily) -> dict[float, float]:
    """Return the factor from the difference to a run at another step to the uncertainty, by the ratio of its step."""
    return {ratio: STEP_SAFETY / abs(ratio**family.order - 1.0) for ratio in family.others}


def roundoff_differences(family: TwinFamily) -> Part:
    """Return the differences that only the round-off of absolute positions makes."""
    return absolute_differences(family.tabled or family.main, family.positional)


def roundoff_part(family: TwinFamily, differences: Part) -> Part:
    """Return the uncertainty by the round-off of positions and the random walk of the last digit."""
    digit = last_digit(family.plan)
    part: Part = {}
    for name in QUANTITIES:
        size = np.nan_to_num(np.abs(getattr(family.main, name)))
        scale = float(np.max(size)) if name in SAMPLED else size
        part[name] = REALISATIONS * (differences[name] + digit * scale)
    return part


def summation_part(family: TwinFamily, summed: float | None) -> Part:
    """Return the uncertainty by sums: over steps, and over contacts where forces are running sums of net forces."""
    steps, main = 0.5 * family.plan.steps * _EPSILON, family.main
    # a contact without force shows the last digit of the largest force and, in running sums, of all other forces
    largest = float(np.max(main.peak_force, initial=0.0))
    forces = largest if summed is None else 4.0 * (largest + largest_drag(family)) + summed
    return {
        "velocity": steps * family.speed,
        "displacement": steps * float(np.max(np.abs(main.displacement))),
        "peak_force": _EPSILON * forces,
        "crossing_time": 0.0,
    }


def largest_drag(family: TwinFamily) -> float:
    """Return a bound of the sum of all forces of drag, N.

    The momenta ``m |v|`` of all bodies add up to no more than ``sqrt(sum(m) sum(m v^2))``.
    """
    mass = np.array(family.scene.mass)
    return family.scene.drag * math.sqrt(float(np.sum(mass) * np.max(family.main.velocity**2 @ mass)))


def table_part(family: TwinFamily) -> Part:
    """Return the uncertainty by the tables, or by the interpolation of laws that are functions."""
    others = [absolute_differences(family.main, run) for run in (family.tabled, family.halved) if run is not None]
    return {name: TABLE_SAFETY * sum((part[name] for part in others), start=0.0) for name in QUANTITIES}


def reading_part(family: TwinFamily) -> tuple[Part, Part]:
    """Return the uncertainty by reading between dense samples, and the part of it that thinning shows."""
    peak, crossing = family.readings.thinned
    with np.errstate(invalid="ignore"):  # forces beyond doubles are unknown
        peaks = np.nan_to_num(np.abs(peak - family.positional.peak_force), nan=math.inf, posinf=math.inf)
    lost = {
        "peak_force": family.thinning * peaks,
        "crossing_time": family.thinning * np.nan_to_num(np.abs(crossing - family.positional.crossing_time)),
    }
    part = {
        "velocity": 0.0,
        "displacement": 0.0,
        "peak_force": lost["peak_force"] + PEAK_ERROR * family.main.peak_force,
        "crossing_time": lost["crossing_time"] + CROSSING_ERROR * family.plan.spacing,
    }
    return part, lost


def secondary_peak_part(family: TwinFamily, velocity: float) -> Floats:
    """Return how far another collision may exceed the largest, N, if velocities are uncertain by ``velocity`` (m/s)."""
    unknown = min(1.0, relative_size(velocity, family.speed))
    return np.maximum(0.0, family.readings.secondary_peak_force * (1.0 + unknown) - family.main.peak_force)


def last_digit(plan: Schedule) -> float:
    """Return the relative error that no run is without: a random walk of its last digit."""
    return _EPSILON * math.sqrt(plan.steps)


def _velocity_parts(family: TwinFamily, step: Part, roundoff: Part, tables: Part) -> dict[str, float]:
    speed, digit = family.speed, last_digit(family.plan)
    moving = speed > 0.0
    return {
        "time_step": relative_size(step["velocity"], speed),
        "round_off": REALISATIONS * (relative_size(float(roundoff["velocity"]), speed) + digit) if moving else 0.0,
        "table": relative_size(float(tables["velocity"]), speed),
        "summation": 0.5 * family.plan.steps * _EPSILON,
        "last_digit": digit if moving else 0.0,
    }


def _sum(*parts: Part) -> Part:
    return {name: sum((part[name] for part in parts[1:]), start=parts[0][name]) for name in QUANTITIES}


def early_touch_part(family: TwinFamily) -> dict[str, Any]:
    """Return the uncertainty by touches in the first step of the coarsest run of a family, by quantity.

    The impulse, relative to that of the bodies that meet, is a part of their closing rate: forces change by twice that
    part at most (they go as its power ``2 (n - 1) / n``), and the time of a crossing by that part.
    """
    c, mobility = family.scene.contacts, family.scene.mobility
    velocity, first = np.append(family.scene.velocity, 0.0), max(1.0, *family.others) * family.plan.step
    left, right = mobility[c.left], mobility[c.right]
    rate = velocity[c.left] - velocity[c.right]
    early = (c.gap > 0.0) & (c.gap < first * rate)
    jump = c.pull_off + np.where(c.damping_power == 0.0, c.damping * np.maximum(rate, 0.0), 0.0)
    impulse = np.where(early, jump * c.gap / np.where(early, rate, 1.0), 0.0)
    share = float(np.sum(impulse * (left + right) / np.where(early, rate, 1.0)))
    kick = float(np.sum(impulse * np.maximum(left, right)))
    return {
        "velocity": kick,
        "displacement": kick * family.scene.duration,
        "peak_force": 2.0 * share * (family.main.peak_force + jump),
        "crossing_time": share * np.nan_to_num(family.main.crossing_time),
    }
