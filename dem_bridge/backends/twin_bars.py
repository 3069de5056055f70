"""Error bars of fixed-step runs, each part measured apart by twins and none by the run that is judged.

*Time step.* The twin at the run's step, at twice and at a third of it. A second-order error is a third of the first
difference and nine eighths of the second (of first order, where forces depend on velocities: all of the first, one and
a half times the second); three times the error is taken, so that the bar holds where the order is not
clean, and the larger of the two, because one of them can be small by chance. Damped contacts get other ratios of steps,
and weights that follow from them.

*Round-off.* A code that keeps absolute positions rounds them at every step and subtracts them for every overlap. The
twin can do the same; its difference to the twin in overlap variables is that round-off, with the scene's conditioning
in it. On the paper's chains it predicts LAMMPS' to 1 %; three times it is taken, because it is one realisation.

*Tables.* The twin with LAMMPS' tables beside the twin with the laws themselves, at the same step; where a law is a
function, the twin's own interpolation of it beside one with half as many cells.

*Touches* that all twins may pass by alike: :mod:`.touches`.

*Sampling.* Peaks and crossings from every second dense sample beside those from all, see :mod:`dem_bridge.dense`.

How often bars hold is measured on 300 random scenes in tests/bench/bench_bars.py.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.bars import Answer, apart, not_below_the_median
from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.curves import CELLS
from dem_bridge.backends.prescan import Prescan
from dem_bridge.backends.splitting import EXACT, Tables
from dem_bridge.backends.steps import fixed_step_plan, order_on, peaks_and_crossings
from dem_bridge.backends.touches import UndetectedGrazes, too_brief, turns_of
from dem_bridge.backends.twin import solve_dense, solve_plan
from dem_bridge.dense import CROSSING_ERROR, MOST_STEPS, PEAK_ERROR, Schedule, secondary_peak_force
from dem_bridge.scene import Scene
from dem_bridge.trajectory import QUANTITIES, Trajectory, Uncertainty, own_scale

#: one realisation of round-off stands for others up to this factor
REALISATIONS = 3.0
#: bars of the time step are so many times an error of clean order: they hold where the order is not clean, too
STEP_SAFETY = 3.0
#: the twin has LAMMPS' tables to the last digit: what differs is how far each run is from the other laws
TABLE_SAFETY = 2.0
#: the golden ratio and 1 over its square, for damped contacts: a dashpot's force begins with the step after touch, and
#: steps with a common multiple may all have it late by the same
INCOMMENSURATE = (1.618, 0.382)
#: of what every second dense sample changes: by order 7/2 (a neighbour that opens between them) a tenth is lost
THINNING = 0.5


def twins_of(
    scene: Scene,
    plan: Schedule,
    prescan: Prescan,
    *,
    radius: float,
    summed: float | None = None,
    own: Trajectory | None = None,
    tables: Tables | None = None,
) -> Twins | None:
    """The twins that a run on the steps of ``plan`` gets its bars from; None where no finer run can be had.

    ``radius`` (m): of the bodies, for a code that keeps positions. ``summed`` (N): of a code whose contact forces are
    running sums of net forces, all that is summed beside them; None: it knows its contact forces. ``own``: the twin on
    these steps in overlap variables, if it is there already. ``tables``: of a code that has not the laws themselves
    (None: it has).
    """
    # one step per sample leaves no coarser step that falls on the samples
    ratios = (2.0, 1.0 / 3.0) if plan.per_sample > 1 else (0.5, 1.0 / 3.0)
    if scene.damped and plan.per_sample > 2:
        ratios = INCOMMENSURATE
    if plan.steps > min(ratios) * MOST_STEPS:
        return None
    plans = [
        fixed_step_plan(scene, Resolution(dt=ratio * plan.step), Sampling(count=plan.samples), prescan)
        for ratio in ratios
    ]
    positional, dense = solve_dense(scene, plan, radius, tables or EXACT)
    thinned = peaks_and_crossings(scene, plan, dense, every=2)
    return Twins(
        plan=plan,
        order=order_on(scene),
        own=own or solve_plan(scene, plan),
        others={one.step / plan.step: solve_plan(scene, one) for one in plans},
        positional=positional,
        tabled=None if tables is None else solve_plan(scene, plan, tables=tables),
        halved=solve_plan(scene, plan, cells=CELLS // 2) if scene.law is not None else None,
        thinned=thinned,
        secondary_peak_force=secondary_peak_force(dense.force),
        unresolved=too_brief(scene, plan, dense, positional),
        grazes=UndetectedGrazes(
            scene=scene,
            seen=turns_of(scene, plan, dense),
            others=lambda: {
                one.step / plan.step: turns_of(scene, one, solve_dense(scene, one, 0.0)[1]) for one in plans
            },
        ),
        summed=summed,
    )


def last_digit(plan: Schedule) -> float:
    """What no run is better than, relative: a random walk of its last digit."""
    return float(np.finfo(float).eps) * math.sqrt(plan.steps)


def round_off_floor(scene: Scene, plan: Schedule, radius: float) -> float:
    """What a code loses that keeps positions of bodies of ``radius`` (m): of velocities, over the largest of them."""
    own, positional = solve_plan(scene, plan), solve_plan(scene, plan, radius)
    speed = float(np.max(np.abs(own.velocity)))
    return float(apart(own, positional)["velocity"]) / speed if speed > 0.0 else 0.0


def _safe(ratio: float, order: int) -> float:
    """What a difference to a run at so many times the step is taken for the error of a run of this order."""
    return STEP_SAFETY / abs(ratio**order - 1.0)


@dataclass(frozen=True, kw_only=True)
class Twins:
    """Runs of the twin that a fixed-step run gets its bars from."""

    plan: Schedule
    """Steps of the run that is judged, and of ``own`` and ``positional``."""
    order: int
    own: Answer
    others: Mapping[float, Answer]
    """The same at other steps, by the ratio of their step to that of the plan."""
    positional: Answer
    """As ``own``, in absolute positions; with tables where there are any: they look up a distance, not an overlap."""
    tabled: Answer | None = None
    """As ``own``, with tables; None: the code has the laws themselves."""
    halved: Answer | None = None
    """As ``own``, with laws that are functions from half as many cells; None: there are none."""
    thinned: tuple[NDArray[np.float64], NDArray[np.float64]]
    """Peak forces and crossing times of ``positional`` from every second dense sample."""
    secondary_peak_force: NDArray[np.float64]
    """Largest force of each contact outside the collision that has its largest, N."""
    unresolved: NDArray[np.bool_] | None = None
    """Contacts whose first compression is briefer than the step; None: not looked for."""
    grazes: UndetectedGrazes | None = None
    """Contacts that nearly touch, by the twin in positions and those at other steps; None: not looked for."""
    thinning: float = THINNING
    """Part of what every second dense sample changes that all of them may still miss."""
    summed: float | None = None
    """Of a code whose contact forces are running sums of net forces: all that is summed beside them, N."""

    def of_step(self) -> dict[str, Any]:
        """Bars for the time step, before contacts are compared with each other."""
        safe = {ratio: _safe(ratio, self.order) for ratio in self.others}
        found = {ratio: apart(self.own, other) for ratio, other in self.others.items()}
        return {name: np.max([safe[ratio] * one[name] for ratio, one in found.items()], axis=0) for name in QUANTITIES}


def with_bars(run: Trajectory, twins: Twins | None) -> Trajectory:
    """``run`` (of LAMMPS or of the twin) with its bars; as it is where no twins can say anything."""
    if twins is None:
        return run
    plan, own = twins.plan, twins.own
    step, rounding = twins.of_step(), apart(twins.tabled or own, twins.positional)
    speed = float(np.max(np.abs(own.velocity)))
    digit = last_digit(plan)
    bars: dict[str, Any] = {}
    for name in QUANTITIES:
        size = np.nan_to_num(np.abs(getattr(own, name)))
        if name in ("velocity", "displacement"):
            bars[name] = float(step[name]) + REALISATIONS * (rounding[name] + digit * float(np.max(size)))
        else:
            # force errors go with the force; a late crossing is late by what all before it were
            share = size if name == "peak_force" else np.ones_like(size)
            bars[name] = not_below_the_median(step[name], share) + REALISATIONS * (rounding[name] + digit * size)
    # equal increments round alike: a sum may be off by half a unit in the last place for every step
    summation = 0.5 * plan.steps * np.finfo(float).eps
    bars["displacement"] += summation * float(np.max(np.abs(own.displacement)))
    bars["velocity"] += summation * speed
    # what nothing touches may show the last digit of the largest force and, in running sums, of all weights
    largest = float(np.max(own.peak_force, initial=0.0))
    sums = largest if twins.summed is None else 4.0 * largest + twins.summed
    bars["peak_force"] += np.finfo(float).eps * sums
    interpolated = 0.0
    for other in (twins.tabled, twins.halved):
        if other is None:
            continue
        found = apart(own, other)
        interpolated += float(found["velocity"]) / speed if speed > 0.0 else 0.0
        for name in QUANTITIES:
            bars[name] = bars[name] + TABLE_SAFETY * found[name]
    thin_peak, thin_crossing = twins.thinned
    lost = {
        "peak_force": twins.thinning * np.abs(thin_peak - twins.positional.peak_force),
        "crossing_time": twins.thinning * np.nan_to_num(np.abs(thin_crossing - twins.positional.crossing_time)),
    }
    bars["peak_force"] += lost["peak_force"] + PEAK_ERROR * own.peak_force
    bars["crossing_time"] += lost["crossing_time"] + CROSSING_ERROR * plan.spacing
    # a share of the velocities is not known, and so of the force of the next largest collision: it may be the largest
    unknown = min(1.0, float(bars["velocity"]) / speed) if speed > 0.0 else 0.0
    bars["peak_force"] += np.maximum(0.0, twins.secondary_peak_force * (1.0 + unknown) - own.peak_force)
    if twins.unresolved is not None:
        bars["crossing_time"] = np.where(twins.unresolved, math.inf, bars["crossing_time"])
    if twins.grazes is not None:
        safe = {ratio: _safe(ratio, twins.order) for ratio in twins.others}
        twins.grazes.widen(bars, own, safe, REALISATIONS * float(rounding["displacement"]))
    if not plan.resolved:
        # all twins look too rarely, so their differences say nothing of what lies between the looks
        bars["peak_force"] = bars["crossing_time"] = math.inf
    floor = float(rounding["velocity"]) / speed if speed > 0.0 else 0.0
    parts = {
        "time_step": float(step["velocity"]) / speed if speed > 0.0 else 0.0,
        "round_off": REALISATIONS * (floor + digit) if speed > 0.0 else 0.0,
        "table": TABLE_SAFETY * interpolated,
        "summation": float(summation),
        "last_digit": digit if speed > 0.0 else 0.0,
    }
    # samples are steps: only what lies between them is read off a curve
    sampling = dict.fromkeys(QUANTITIES, 0.0) | {
        name: float(np.max(amount / np.maximum(own_scale(getattr(own, name)), 1e-300), initial=0.0))
        for name, amount in lost.items()
    }
    return replace(run, uncertainty=Uncertainty(**bars, parts=parts, roundoff_floor=floor, sampling=sampling))
