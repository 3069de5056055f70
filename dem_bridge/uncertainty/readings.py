"""Numbers that an uncertainty needs from dense samples, and the runs that it needs for them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from dem_bridge.backends.steps import Dense, peaks_and_crossings
from dem_bridge.dense import Schedule, secondary_peak_force
from dem_bridge.scene import Scene
from dem_bridge.stopwatch import Stopwatch
from dem_bridge.trajectory import Cost, Trajectory
from dem_bridge.uncertainty.family import DenseReadings, TwinFamily
from dem_bridge.uncertainty.fixed_step import displacement_uncertainty
from dem_bridge.uncertainty.grazes import may_graze, open_turns, unresolved_contacts


def read_dense(scene: Scene, plan: Schedule, dense: Dense, run: Trajectory) -> DenseReadings:
    """Return the readings of a run on the steps of ``plan``."""
    return DenseReadings(
        thinned=peaks_and_crossings(scene, plan, dense, every=2),
        secondary_peak_force=secondary_peak_force(dense.force),
        unresolved=unresolved_contacts(scene, plan, dense, run),
        turns=open_turns(scene, plan, dense),
    )


def complete_family(
    family: TwinFamily,
    watch: Stopwatch,
    plans: Mapping[float, Schedule],
    solve: Callable[[Schedule], tuple[Trajectory, Dense]],
) -> TwinFamily:
    """Return a family with its cost and, where a contact may graze another, the turns of the runs at other steps.

    ``watch`` began with the first run of the family; ``plans`` has the other steps, by their ratio; ``solve`` makes a
    run on given steps, with its dense samples.
    """
    runs = [family.main, *family.others.values()]
    runs += [run for run in (family.positional, family.tabled, family.halved) if run not in (None, family.main)]
    if may_graze(family.readings.turns, displacement_uncertainty(family)):
        turns = {}
        for ratio, plan in plans.items():
            run, dense = solve(plan)
            runs.append(run)
            turns[ratio] = open_turns(family.scene, plan, dense)
        family = replace(family, readings=replace(family.readings, turns_elsewhere=turns))
    steps, evaluations = sum(run.cost.steps for run in runs), sum(run.cost.force_evaluations for run in runs)
    return replace(family, cost=Cost.since(watch, steps=steps, force_evaluations=evaluations))
