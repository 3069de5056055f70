"""Numbers that an uncertainty needs from dense samples, and the runs that it needs for them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from dem_bridge.backends.base import Resolution
from dem_bridge.backends.prescan import Prescan
from dem_bridge.backends.steps import Dense, approach_of, fixed_step_plan, peaks_and_crossings
from dem_bridge.foundation.stopwatch import Stopwatch
from dem_bridge.runs.cache import RunCache
from dem_bridge.runs.case import Case
from dem_bridge.runs.uncertainty.fixed_step import DenseReadings, TwinFamily, doubt_at_moments, sampled_uncertainty
from dem_bridge.runs.uncertainty.grazes import drift_in_flight, unresolved_contacts
from dem_bridge.runs.uncertainty.moments import reached, read_at, undecided_moments, with_ways
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.dense import Schedule, secondary_peak_force
from dem_bridge.trajectory.trajectory import Cost, Trajectory

#: part of the largest step that resolves a contact with n < 2: without it 3 of 600 collisions with n = 1.1 were outside
#: by velocity-Verlet, by up to 1.7 uncertainties, and 1 of 591 others by Blanes and Moan's method, by 4.7
SINGULAR = 0.1
#: dense samples times bodies up to which those of a run at another step are kept: 60 MB
MOST_KEPT = 1.5e6
#: steps times bodies that the finer run takes to resolve contacts: a fifth of a second
MOST_WORK = 1e7


def read_dense(scene: Scene, plan: Schedule, dense: Dense, run: Trajectory) -> DenseReadings:
    """Return the readings of a run on the steps of ``plan``."""
    return DenseReadings(
        thinned=peaks_and_crossings(scene, plan, dense, every=2),
        secondary_peak_force=secondary_peak_force(dense.force),
        unresolved=unresolved_contacts(scene, plan, dense, run),
        drift=drift_in_flight(scene, plan, dense),
        reached=reached(approach_of(scene, plan, dense)),
    )


def finer_ratio(ratio: float, scene: Scene, plan: Schedule, prescan: Prescan, resolved: float) -> float:
    """Return the ratio of the finer step to that of a run: ``ratio``, or less so that it resolves every contact.

    ``resolved`` is the largest step that does, in units of 1/omega of the stiffest contact. Where no run of a family
    resolves a contact, all of them may miss it, or err by the same. With n < 2 a contact is the stiffer the smaller its
    overlap, and a tenth of it serves; ahead of a front no step resolves it, so that :data:`MOST_WORK` bounds the run.
    """
    phase = plan.step * prescan.frequency
    if scene.law is None and np.any(scene.contacts.exponent < 2.0):
        resolved = SINGULAR * resolved
    affordable = plan.steps * scene.n_body / MOST_WORK
    return min(ratio, max(resolved / phase, affordable)) if phase > 0.0 else ratio


@dataclass(frozen=True, kw_only=True, eq=False)
class OtherRuns:
    """Runs of a case at other steps, by the ratio of their step to that of the family."""

    plans: dict[float, Schedule] = field(default_factory=dict)
    runs: dict[float, Trajectory] = field(default_factory=dict)
    dense: dict[float, Dense] = field(default_factory=dict)
    """Dense samples of those runs that were made here and have few enough of them."""


def runs_at_other_steps(
    case: Case,
    plan: Schedule,
    ratios: Iterable[float],
    prescan: Prescan,
    cache: RunCache,
    *,
    alone: Callable[[Schedule], Trajectory],
    sampled: Callable[[Schedule], tuple[Trajectory, Dense]],
) -> OtherRuns:
    """Return runs of a case at about ``ratios`` times the step of ``plan``.

    ``alone`` and ``sampled`` make a run on given steps, without and with its dense samples.
    """
    others = OtherRuns()
    for ratio in ratios:
        other = replace(case, resolution=Resolution(dt=ratio * plan.step))
        steps = fixed_step_plan(case.scene, other.resolution, case.sampling, prescan)
        ratio = steps.step / plan.step
        others.plans[ratio], run = steps, cache.load(other)
        if run is None and len(steps.dense_steps) * case.scene.n_body > MOST_KEPT:
            run = cache.keep(other, alone(steps))
        elif run is None:
            run, others.dense[ratio] = sampled(steps)
            cache.keep(other, run)
        others.runs[ratio] = run
    return others


def complete_family(
    family: TwinFamily,
    watch: Stopwatch,
    dense: Dense,
    others: OtherRuns,
    solve: Callable[[Schedule], tuple[Trajectory, Dense]],
) -> TwinFamily:
    """Return a family with its cost, its undecided moments, and what the runs at other steps have at these.

    ``watch`` began with the first run of the family; ``dense`` are the dense samples of ``positional``; ``solve`` makes
    a run on given steps, with its dense samples.
    """
    runs = [family.main, *family.others.values()]
    runs += [run for run in (family.positional, family.tabled, family.halved) if run not in (None, family.main)]
    scene, crossing = family.scene, family.positional.crossing_time
    seen = approach_of(scene, family.plan, dense)
    moments = undecided_moments(scene, family.plan, dense, seen, crossing, **sampled_uncertainty(family))
    if len(moments):
        elsewhere = {}
        for ratio, plan in others.plans.items():
            samples = others.dense.get(ratio)
            if samples is None:
                run, samples = solve(plan)
                runs.append(run)
            elsewhere[ratio] = read_at(approach_of(scene, plan, samples), moments.contact, moments.time)
        family = replace(family, readings=replace(family.readings, moments=moments, elsewhere=elsewhere))
        moments = with_ways(moments, seen, doubt_at_moments(family).overlap)
        family = replace(family, readings=replace(family.readings, moments=moments))
    steps, evaluations = sum(run.cost.steps for run in runs), sum(run.cost.force_evaluations for run in runs)
    return replace(family, cost=Cost.since(watch, steps=steps, force_evaluations=evaluations))
