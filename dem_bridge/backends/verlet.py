"""The algorithmic twin of LAMMPS: the same velocity-Verlet, written in overlap variables and compiled.

LAMMPS (``fix nve``) half-kicks, drifts, evaluates the forces and half-kicks again (Swope et al. 1982); so does
this, in the same order of operations. But it carries the overlap of each contact as a variable of its own, so no
position is ever subtracted from another: what LAMMPS loses there is what the two differ by. Asked for a
``surrogate_radius`` it keeps absolute positions instead, as LAMMPS does, and then loses the same.
"""

from __future__ import annotations

from dem_bridge.backends.base import AlwaysAvailable, Resolution, Sampling
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.backends.splitting import EXACT
from dem_bridge.backends.steps import fixed_step_plan
from dem_bridge.backends.surrogate_radius import radius_of
from dem_bridge.backends.tabled import in_kernel, tables_for
from dem_bridge.backends.twin import TWIN, solve_plan
from dem_bridge.scene import features
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.support import Support
from dem_bridge.trajectory.trajectory import Trajectory


class Verlet(AlwaysAvailable):
    """Velocity-Verlet in overlap variables, compiled."""

    name = TWIN.name
    order: int | None = 2
    supports = Support(
        {features.WALLS, features.GAPS, features.INITIAL_OVERLAPS, features.SEVERAL_MOVING}
        | {features.OTHER_EXPONENTS, features.GRADED_EXPONENTS, features.GRAVITY, features.PRECOMPRESSION}
        | {features.DASHPOT, features.MASS_VELOCITY, features.KUWABARA_KONO, features.COEFF_RESTITUTION, features.TSUJI}
        | {features.CONTACT_FUNCTIONS, features.NOT_CLIPPED, features.DMT, features.DRAG}
        | {features.SINE_DRIVE, features.CHIRP_DRIVE, features.TABLE_DRIVE}
        | {features.CONSTANT_PISTON, features.SINE_PISTON, features.TABLE_PISTON}
    )

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        """Solve; with ``surrogate_radius`` in absolute positions, as LAMMPS does."""
        prescan = prescan_scene(scene)
        plan = fixed_step_plan(scene, resolution, sampling, prescan)
        tables = EXACT
        if resolution.tables:
            radius = radius_of(scene, resolution, prescan)
            tables = in_kernel(scene, tables_for(scene, resolution, prescan), radius)
        return solve_plan(scene, plan, resolution.surrogate_radius or 0.0, tables)
