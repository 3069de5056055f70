"""Order 4 at fixed steps: the symplectic Runge-Kutta-Nystroem method of Blanes & Moan, in overlap variables.

Blanes & Moan 2002 (*J. Comput. Appl. Math.* 142, 313), SRKN_6^b: six evaluations of the forces for a step that may be
some twenty times that of velocity-Verlet. No velocity may decide a force, so damping and drag are refused.

Order 4 needs a force with four derivatives, and that of Hertz has one where a contact opens or closes: on chains in
which contacts do, the error of velocities goes as dt^4 down to about 1e-5 of the impact speed and as dt^2.5 .. dt^3.5
below, with scatter, for it depends on where the step finds each touch.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dem_bridge.backends.bars import apart
from dem_bridge.backends.base import Availability, Resolution, Sampling
from dem_bridge.backends.curves import CELLS
from dem_bridge.backends.splitting import Method, solve
from dem_bridge.backends.steps import fixed_step_plan, peaks_and_crossings
from dem_bridge.backends.tabled import survey_of
from dem_bridge.backends.twin_bars import Twins, with_bars
from dem_bridge.dense import MOST_STEPS, rivals
from dem_bridge.scene import Scene
from dem_bridge.trajectory import Trajectory

_B1, _B2, _B3 = 0.0829844064174052, 0.396309801498368, -0.0390563049223486
_A1, _A2 = 0.245298957184271, 0.604872665711080
_A3, _B4 = 0.5 - (_A1 + _A2), 1.0 - 2.0 * (_B1 + _B2 + _B3)
ORDER = 4
SRKN_6B = Method(drifts=np.array([_A1, _A2, _A3, _A3, _A2, _A1]), kicks=np.array([_B1, _B2, _B3, _B4, _B3, _B2, _B1]))


#: part of what every second dense sample changes: beside so small errors of the step it must be all
THINNING = 1.0
#: where the two other runs differ as much as each from the run itself, all three are as far from the truth, each by its
#: own chance: of two differences no more than that, and not clean order, is known
CHANCE = 6.0


class Own(Twins):
    """The method's own runs at other steps, as its bars need them."""

    def of_step(self) -> dict[str, Any]:
        found, others = super().of_step(), apart(*self.others.values())
        return {name: found[name] + CHANCE * others[name] for name in found}


class BlanesMoan:
    """SRKN_6^b (numba). Any masses, exponents, laws, gaps, walls; precompression, gravity."""

    name = "blanes-moan"
    equations = "hertz"
    order: int | None = ORDER

    def availability(self) -> Availability:
        return Availability(True)

    def refusal(self, scene: Scene) -> str | None:
        if scene.dissipates:
            return (
                "a Runge-Kutta-Nystroem method has no velocity at the moment of a force, and damping or drag needs one;"
                " allowed: scenes without, or backend = 'verlet' or 'scipy'"
            )
        return None

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        """Solve; the bars come from runs at two other steps."""
        look = survey_of(scene)
        plan = fixed_step_plan(scene, resolution, sampling, look)
        bars = resolution.bars and plan.steps <= MOST_STEPS / 3
        run, dense = solve(self, SRKN_6B, scene, plan, full=bars)
        if not bars:
            return run
        others = {}
        for ratio in (1 / 2, 1 / 3):
            other = fixed_step_plan(scene, Resolution(dt=ratio * plan.step), Sampling(count=plan.samples), look)
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
            rivals=rivals(dense.force),
            thinning=THINNING,
        )
        return with_bars(run, twins)
