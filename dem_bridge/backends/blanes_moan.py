"""Order 4 at fixed steps: the symplectic Runge-Kutta-Nystroem method of Blanes & Moan, in overlap variables.

Blanes & Moan 2002 (*J. Comput. Appl. Math.* 142, 313), SRKN_6^b: six evaluations of the forces to a step that is some
thirty times velocity-Verlet's; stable up to 3.16 / omega. No velocity may decide a force: damping and drag are refused.

Where no contact opens or closes the order is 4. At touch Hertz's force has no second derivative, and on chains that
open the error of velocities goes as dt^2.6 on average from 1e-4 of the impact speed down, by chance up to three times
more or less, for it depends on where the step meets each touch. On decelerating-40 it takes 0.44, 0.22, 0.13 of
velocity-Verlet's forces to 1e-4, 1e-6, 1e-8, on random scenes 0.43 and 0.32 to 1e-4 and 1e-6 (geometric mean); the
partitioned S_6 and SRKN_11^b and SRKN_14^a, of order 6, take the same within 20 %, with coarser choices of the step.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dem_bridge import features
from dem_bridge.backends.bars import apart
from dem_bridge.backends.base import Availability, Resolution, Sampling
from dem_bridge.backends.curves import CELLS
from dem_bridge.backends.splitting import Method, solve
from dem_bridge.backends.steps import fixed_step_plan, peaks_and_crossings
from dem_bridge.backends.tabled import prescan_scene
from dem_bridge.backends.touches import UndetectedGrazes, too_brief, turns_of
from dem_bridge.backends.twin_bars import Twins, with_bars
from dem_bridge.dense import MOST_STEPS, secondary_peak_force
from dem_bridge.scene import Scene
from dem_bridge.support import Support
from dem_bridge.trajectory import Trajectory

_B1, _B2, _B3 = 0.0829844064174052, 0.396309801498368, -0.0390563049223486
_A1, _A2 = 0.245298957184271, 0.604872665711080
_A3, _B4 = 0.5 - (_A1 + _A2), 1.0 - 2.0 * (_B1 + _B2 + _B3)
ORDER = 4
SRKN_6B = Method(drifts=np.array([_A1, _A2, _A3, _A3, _A2, _A1]), kicks=np.array([_B1, _B2, _B3, _B4, _B3, _B2, _B1]))

#: default step, of 1/omega of the stiffest contact: on random scenes the median error is velocity-Verlet's at its own
#: default (2e-7), for a third of the forces
PHASE = 0.05
#: of what every second dense sample changes: where the step errs so little, what is read off counts in full
THINNING = 1.0
#: of what the two other runs differ by, beside the bars of order 4: little where the order is clean, most where all
#: three are as far from the truth by the chance of round-off or touches. Without it 0.5 % of bars were too narrow on
#: the random scenes, and none of 1200 runs' with it
CHANCE = 6.0


class Own(Twins):
    """The method's own runs at other steps, as its bars need them."""

    def of_step(self) -> dict[str, Any]:
        found, others = super().of_step(), apart(*self.others.values())
        return {name: found[name] + CHANCE * others[name] for name in found}


class BlanesMoan:
    """The symplectic Runge-Kutta-Nystroem method SRKN_6^b in overlap variables, compiled."""

    name = "blanes-moan"
    equations = "hertz"
    order: int | None = ORDER
    supports = Support(
        {features.WALLS, features.GAPS, features.INITIAL_OVERLAPS, features.SEVERAL_MOVING}
        | {features.OTHER_EXPONENTS, features.GRADED_EXPONENTS, features.GRAVITY, features.PRECOMPRESSION}
        | {features.CONTACT_FUNCTIONS, features.SINE_DRIVE, features.CHIRP_DRIVE, features.TABLE_DRIVE},
        scope="the method evaluates forces where it knows no velocities",
    )

    def availability(self) -> Availability:
        return Availability(True)

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        """Solve; the bars come from runs at two other steps."""
        prescan = prescan_scene(scene)
        plan = fixed_step_plan(scene, resolution, sampling, prescan, PHASE)
        bars = resolution.bars and plan.steps <= MOST_STEPS / 3
        run, dense = solve(self, SRKN_6B, scene, plan, full=bars)
        if not bars:
            return run
        others, finer = {}, {}
        for ratio in (1 / 2, 1 / 3):
            other = fixed_step_plan(scene, Resolution(dt=ratio * plan.step), Sampling(count=plan.samples), prescan)
            finer[other.step / plan.step] = other
            others[other.step / plan.step] = solve(self, SRKN_6B, scene, other, full=False)[0]
        twins = Own(
            plan=plan,
            order=ORDER,
            own=run,
            others=others,
            positional=run,
            halved=solve(self, SRKN_6B, scene, plan, cells=CELLS // 2, full=False)[0]
            if scene.law is not None
            else None,
            thinned=peaks_and_crossings(scene, plan, dense, every=2),
            secondary_peak_force=secondary_peak_force(dense.force),
            thinning=THINNING,
            unresolved=too_brief(scene, plan, dense, run),
            grazes=UndetectedGrazes(
                scene=scene,
                seen=turns_of(scene, plan, dense),
                others=lambda: {
                    ratio: turns_of(scene, one, solve(self, SRKN_6B, scene, one)[1]) for ratio, one in finer.items()
                },
            ),
        )
        return with_bars(run, twins)
