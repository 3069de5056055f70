"""The family of Blanes and Moan's method: its own runs at a half and a third of the step.

The method is of order 4 where no contact opens or closes, and the differences to two finer runs are the error but for a
quarter, whatever its order is there.
"""

from __future__ import annotations

from functools import partial

from dem_bridge.backends.blanes_moan import ORDER, PHASE, SRKN_6B, BlanesMoan
from dem_bridge.backends.curves import CELLS
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.backends.splitting import solve
from dem_bridge.backends.steps import fixed_step_plan
from dem_bridge.foundation.stopwatch import Stopwatch
from dem_bridge.runs.cache import RunCache
from dem_bridge.runs.case import Case
from dem_bridge.runs.uncertainty.fixed_step import TwinFamily
from dem_bridge.runs.uncertainty.readings import complete_family, finer_ratio, read_dense, runs_at_other_steps
from dem_bridge.trajectory.dense import MOST_STEPS

#: ratios of the steps of the other runs to that of the family
RATIOS = (1.0 / 2.0, 1.0 / 3.0)
#: largest step of the finer run, of 1/omega of the stiffest contact: a third of the default one and a little more
RESOLVED = 0.02
#: part of the change by thinning that counts: the step errs so little that the reading counts in full
THINNING = 1.0
#: factor of the difference between the two finer runs: small where the order is clean, and most of the uncertainty
#: where all three runs are as far from the solution by the chance of round-off or touches. Without it 0.5 % of the
#: uncertainties on the random scenes were too small, and none of those of 1200 runs with it
SCATTER = 6.0


def blanes_moan_family(case: Case, cache: RunCache | None = None) -> TwinFamily | None:
    """Return the family of a case; None if the finer run would have more steps than can be counted."""
    return (cache or RunCache()).family(case, _solve_family)


def _solve_family(case: Case, cache: RunCache) -> TwinFamily | None:
    watch = Stopwatch()
    scene, prescan = case.scene, prescan_scene(case.scene)
    plan = fixed_step_plan(scene, case.resolution, case.sampling, prescan, PHASE)
    ratios = (RATIOS[0], finer_ratio(RATIOS[1], scene, plan, prescan, RESOLVED))
    if plan.steps > min(ratios) * MOST_STEPS:
        return None
    run = partial(solve, BlanesMoan(), SRKN_6B, scene)
    main, dense = run(plan)
    cache.keep(case, main)
    settings = case, plan, ratios, prescan, cache
    others = runs_at_other_steps(*settings, alone=lambda steps: run(steps, full=False)[0], sampled=run)
    family = TwinFamily(
        scene=scene,
        plan=plan,
        order=ORDER,
        main=main,
        others=others.runs,
        positional=main,
        halved=run(plan, cells=CELLS // 2, full=False)[0] if scene.law is not None else None,
        readings=read_dense(scene, plan, dense, main),
        thinning=THINNING,
        scatter=SCATTER,
    )
    return complete_family(family, watch, dense, others, run)
