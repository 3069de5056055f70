"""The in-house scipy reference: DOP853 in overlap variables, restarted at every located opening and closing.

The integration is that of :mod:`.scipy_integration`, of damped contacts that of :mod:`.scipy_damped`. Shares no code
with the twin.
"""

from __future__ import annotations

from dem_bridge.backends.base import AlwaysAvailable, Resolution, Sampling, run_provenance
from dem_bridge.backends.scales import in_common_frame, in_rest_frame
from dem_bridge.errors import UsageError
from dem_bridge.foundation.stopwatch import Stopwatch
from dem_bridge.scene import features
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.support import Support
from dem_bridge.trajectory.trajectory import VOCABULARY, Cost, Trajectory

#: local tolerance, near the smallest that DOP853 takes (100 eps)
DEFAULT_RTOL = 3e-14
#: the largest that may be asked for and still be called a reference
LARGEST_RTOL = 1e-4


class ScipyDop853(AlwaysAvailable):
    """DOP853 in overlap variables with located contact events."""

    name = "scipy"
    supports = Support(
        {features.WALLS, features.GAPS, features.INITIAL_OVERLAPS, features.SEVERAL_MOVING}
        | {features.OTHER_EXPONENTS, features.GRADED_EXPONENTS, features.GRAVITY, features.PRECOMPRESSION}
        | {features.DASHPOT, features.MASS_VELOCITY, features.KUWABARA_KONO, features.COEFF_RESTITUTION, features.TSUJI}
        | {features.CONTACT_FUNCTIONS, features.NOT_CLIPPED, features.DMT, features.DRAG}
        | {features.SINE_DRIVE, features.CHIRP_DRIVE, features.TABLE_DRIVE}
        | {features.CONSTANT_PISTON, features.SINE_PISTON, features.TABLE_PISTON},
        instead="verlet",
    )

    def __init__(self, largest_rtol: float = LARGEST_RTOL) -> None:
        self.largest_rtol = largest_rtol

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        """Solve at the tolerance ``rtol``.

        Raises UsageError for ``rtol`` above the largest, RunBroken where DOP853 stops.
        """
        # they bring scipy.integrate, which takes half a second to import
        from dem_bridge.backends.scipy_damped import DampedIntegration
        from dem_bridge.backends.scipy_integration import Integration

        watch = Stopwatch()
        rtol = resolution.rtol if resolution.rtol is not None else DEFAULT_RTOL
        if rtol > self.largest_rtol:
            raise UsageError(f"rtol = {rtol:g} is too loose for {self.name}; allowed: up to {self.largest_rtol:g}")
        frame, velocity = in_common_frame(scene)
        integration = (DampedIntegration if scene.damped or scene.adhesive else Integration)(frame, sampling, rtol)
        integration.run()
        run = Trajectory(
            time=integration.times,
            **{name: getattr(integration, name) for name in VOCABULARY},
            cost=Cost.since(watch, steps=integration.steps, force_evaluations=integration.evaluations),
            provenance=run_provenance(self, scene, {"rtol": rtol, "samples": sampling.count})
            | {"restarts": integration.restarts, "near_touches": integration.near_touches}
            | {"slowing": integration.slowing_at_crossing},
        )
        return in_rest_frame(run, velocity, scene.drag)
