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

import numpy as np

from dem_bridge.backends.base import AlwaysAvailable, Resolution, Sampling
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.backends.splitting import Method, solve
from dem_bridge.backends.steps import fixed_step_plan
from dem_bridge.scene import features
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.support import Support
from dem_bridge.trajectory.trajectory import Trajectory

_B1, _B2, _B3 = 0.0829844064174052, 0.396309801498368, -0.0390563049223486
_A1, _A2 = 0.245298957184271, 0.604872665711080
_A3, _B4 = 0.5 - (_A1 + _A2), 1.0 - 2.0 * (_B1 + _B2 + _B3)
ORDER = 4
SRKN_6B = Method(drifts=np.array([_A1, _A2, _A3, _A3, _A2, _A1]), kicks=np.array([_B1, _B2, _B3, _B4, _B3, _B2, _B1]))

#: default step, of 1/omega of the stiffest contact: on random scenes the median error is velocity-Verlet's at its own
#: default (2e-7), for a third of the forces
PHASE = 0.05


class BlanesMoan(AlwaysAvailable):
    """The symplectic Runge-Kutta-Nystroem method SRKN_6^b in overlap variables, compiled."""

    name = "blanes-moan"
    order: int | None = ORDER
    #: of the forces in a step
    evaluations = len(SRKN_6B.drifts)
    supports = Support(
        {features.WALLS, features.GAPS, features.INITIAL_OVERLAPS, features.SEVERAL_MOVING}
        | {features.OTHER_EXPONENTS, features.GRADED_EXPONENTS, features.GRAVITY, features.PRECOMPRESSION}
        | {features.CONTACT_FUNCTIONS, features.SINE_DRIVE, features.CHIRP_DRIVE, features.TABLE_DRIVE}
        | {features.CONSTANT_PISTON, features.SINE_PISTON, features.TABLE_PISTON},
        scope="the method evaluates forces where it knows no velocities",
    )

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        """Solve on the steps of a fixed step that is twenty times that of the twin by default."""
        prescan = prescan_scene(scene)
        plan = fixed_step_plan(scene, resolution, sampling, prescan, PHASE)
        return solve(self, SRKN_6B, scene, plan, full=False)[0]
