"""The in-house scipy reference: DOP853 in overlap variables, restarted at every located opening and closing.

The integration is that of :mod:`.scipy_integration`, of damped contacts that of :mod:`.scipy_damped`. Shares no code
with the twin.
"""

from __future__ import annotations

import time

import numpy as np

from dem_bridge import features
from dem_bridge.backends.bars import reference_bars
from dem_bridge.backends.base import Availability, Resolution, Sampling, run_provenance
from dem_bridge.errors import UsageError
from dem_bridge.scene import Scene
from dem_bridge.support import Support
from dem_bridge.trajectory import UNKNOWN, Cost, Trajectory, Uncertainty

#: local tolerance, near the smallest that DOP853 takes (100 eps)
DEFAULT_RTOL = 3e-14
#: the largest that may be asked for and still be called a reference
LARGEST_RTOL = 1e-4
#: the runs for the bars have so many times the tolerance. Two: one agrees by chance where round-off rules, and of 75
#: random scenes whose error is known 6 then were outside; of two runs 1
BAR_FACTORS = (10.0, 20.0)
#: ... and the larger difference to them is taken this many times
BAR_SAFETY = 3.0


class ScipyDop853:
    """DOP853 in overlap variables with located contact events."""

    name = "scipy"
    equations = "hertz"
    order: int | None = None
    supports = Support(
        {features.WALLS, features.GAPS, features.INITIAL_OVERLAPS, features.SEVERAL_MOVING}
        | {features.OTHER_EXPONENTS, features.GRADED_EXPONENTS, features.GRAVITY, features.PRECOMPRESSION}
        | {features.CONTACT_FUNCTIONS, features.DASHPOT, features.KUWABARA_KONO, features.DRAG}
        | {features.SINE_DRIVE, features.CHIRP_DRIVE, features.TABLE_DRIVE},
        instead="verlet",
    )

    def availability(self) -> Availability:
        return Availability(True)

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        """Solve; the bars are the differences to runs at ten and twenty times the tolerance.

        Raises UsageError for ``rtol`` above 1e-4, RunBroken where DOP853 stops.
        """
        # they bring scipy.integrate, which takes half a second to import
        from dem_bridge.backends.scipy_damped import DampedIntegration
        from dem_bridge.backends.scipy_integration import Integration

        wall, cpu = time.perf_counter(), time.process_time()
        rtol = resolution.rtol if resolution.rtol is not None else DEFAULT_RTOL
        if rtol > LARGEST_RTOL:
            raise UsageError(f"rtol = {rtol:g} is too loose for {self.name}; allowed: up to {LARGEST_RTOL:g}")
        share = 1.0 / (1 + len(BAR_FACTORS)) if resolution.bars else 1.0
        kind = DampedIntegration if scene.damped else Integration
        fine = kind(scene, sampling, rtol, share=share)
        fine.run()
        estimate = UNKNOWN
        used = (time.perf_counter() - wall, time.process_time() - cpu)
        if resolution.bars:
            coarse = [
                kind(scene, sampling, factor * rtol, share_before=(1 + nth) * share, share=share)
                for nth, factor in enumerate(BAR_FACTORS)
            ]
            for run in coarse:
                run.run()
            bars = reference_bars(fine, coarse, factor=BAR_SAFETY, duration=scene.duration)
            # beyond an open contact displacements follow from its gap, which every step rounds, and all runs alike
            farthest = float(np.max(np.abs(scene.contacts.gap), initial=0.0))
            bars["displacement"] += 0.5 * fine.steps * float(np.finfo(float).eps) * farthest
            estimate = Uncertainty(**bars)
        return Trajectory(
            time=fine.times,
            displacement=fine.displacement,
            velocity=fine.velocity,
            contact_force=fine.contact_force,
            peak_force=fine.peak_force,
            crossing_time=fine.crossing_time,
            uncertainty=estimate,
            cost=Cost(wall=used[0], cpu=used[1], steps=fine.steps, force_evaluations=fine.evaluations),
            provenance=run_provenance(self, scene, {"rtol": rtol, "samples": sampling.count})
            | {"restarts": fine.restarts},
        )
