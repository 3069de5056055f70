"""The paper's own method: MATLAB's ode45, written anew and compiled; see :mod:`.dormand_prince`.

It solves for displacements and velocities straight through the contacts, at the tolerances that MATLAB takes where it
is told none (the paper states none). So its error can be told from that of the binary collision approximation, which
the paper judges by it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.base import AlwaysAvailable, Resolution, Sampling, run_provenance
from dem_bridge.backends.dormand_prince import STEP_TOO_SMALL, TOO_MANY_STEPS, integrate
from dem_bridge.backends.scales import natural_scales
from dem_bridge.errors import RunBroken
from dem_bridge.foundation.compiled import interruptible
from dem_bridge.foundation.stopwatch import Stopwatch
from dem_bridge.scene import features
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.support import Support
from dem_bridge.trajectory.trajectory import VOCABULARY, Cost, Trajectory

#: those of MATLAB: RelTol, and AbsTol in m and m/s
DEFAULT_RTOL, DEFAULT_ATOL = 1e-3, 1e-6
#: tolerances of the replicas, in units of those of the run, and their least rtol. The first replica may err by chance
#: as the run does: with it alone 12 of 1600 random collisions of two bodies were outside, by up to 13 uncertainties;
#: with both none
TIGHTER, LEAST = (1e-2, 1e-4), 1e-15
#: longest step, in units of the duration: that of MATLAB, and that of the replicas, which would err alike where no
#: tolerance decides the step
SHARE, REPLICA_SHARES = 0.1, (0.02, 0.01)
MOST_STEPS = 50_000_000


class Ode45(AlwaysAvailable):
    """Dormand & Prince 5(4) with MATLAB's step control.

    >>> import dem_bridge as db
    >>> run = db.solve("decelerating-40", backend="ode45")
    >>> error = abs(run.velocity - db.solve("decelerating-40", backend="reference").velocity).max()
    >>> f"{error / 0.8:.0e}", run.cost.force_evaluations < 2500
    ('4e-03', True)
    """

    name = "ode45"
    supports = Support(
        {features.WALLS, features.GAPS, features.INITIAL_OVERLAPS, features.SEVERAL_MOVING}
        | {features.OTHER_EXPONENTS, features.GRADED_EXPONENTS, features.GRAVITY, features.PRECOMPRESSION}
    )

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        """Solve with ``rtol`` and ``atol`` (m and m/s), the initial step as for ``tspan = [0 duration]``.

        Raises RunBroken where the step falls below 16 units in the last place of t, as ode45 warns and stops.
        """
        rtol, atol = _tolerances(resolution)
        run = self.solve_once(scene, sampling, rtol, np.full(2 * scene.n_body, atol), SHARE, False)
        settings = {"rtol": rtol, "atol": atol, "samples": sampling.count}
        return replace(run, provenance={**run.provenance, "settings": settings})

    def replicas(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> list[Trajectory]:
        """Return runs at tighter tolerances of both kinds, whose absolute ones also follow the scales of the scene.

        1e-6 m may be larger than all motion. The runs take shorter steps where nothing bends, and none over a contact:
        a graze between two flights would be missed by all runs.
        """
        rtol, atol = _tolerances(resolution)
        absolute = np.minimum(atol, rtol * state_scales(scene))
        # at rest there is no scale
        return [
            self.solve_once(scene, sampling, max(part * rtol, LEAST), np.maximum(part * absolute, 1e-300), share, True)
            for part, share in zip(TIGHTER, REPLICA_SHARES, strict=True)
        ]

    def solve_once(
        self, scene: Scene, sampling: Sampling, rtol: float, atol: NDArray[np.float64], share: float, wary: bool
    ) -> Trajectory:
        """Return one run at these tolerances, without its uncertainty."""
        watch = Stopwatch()
        c, times = scene.contacts, sampling.times(scene.duration)
        *arrays, accepted, failed, ended, at = interruptible(
            integrate,
            np.array(scene.mass),
            np.array(scene.velocity),
            (c.left, c.right, c.stiffness, c.exponent, c.gap),
            scene.free_acceleration,
            times,
            rtol,
            atol,
            MOST_STEPS,
            share,
            wary,
        )
        if ended == STEP_TOO_SMALL:
            raise RunBroken(
                f"ode45 on {scene.name}: at t = {at:.6g} s no step meets rtol = {rtol:g}; give a larger rtol or atol"
            )
        if ended == TOO_MANY_STEPS:
            raise RunBroken(
                f"ode45 on {scene.name}: {accepted} steps reached t = {at:.6g} s of {scene.duration:g} s;"
                " give a larger rtol or atol"
            )
        motion: dict[str, Any] = dict(zip(VOCABULARY, arrays, strict=True))
        if not np.all(np.isfinite(motion["velocity"])):
            raise RunBroken(f"ode45 on {scene.name}: velocities are not finite; give a smaller rtol")
        return Trajectory(
            time=times,
            **motion,
            cost=Cost.since(watch, steps=accepted, force_evaluations=6 * (accepted + failed) + 1),
            provenance=run_provenance(self, scene, {}) | {"failed_steps": failed},
        )


def _tolerances(resolution: Resolution) -> tuple[float, float]:
    """Return rtol and atol, those of MATLAB where none is given."""
    rtol = resolution.rtol if resolution.rtol is not None else DEFAULT_RTOL
    return rtol, resolution.atol if resolution.atol is not None else DEFAULT_ATOL


def state_scales(scene: Scene) -> NDArray[np.float64]:
    """Return a small value of each entry of the state, ``(2 n_body,)``.

    For displacements it is the shallowest overlap (m) of a body's contacts that the energy of the scene allows, for
    velocities the largest speed (m/s).
    """
    speed, depth = natural_scales(scene)
    of_body = np.full(scene.n_body + 1, speed * scene.duration)
    np.minimum.at(of_body, scene.contacts.left, depth)
    np.minimum.at(of_body, scene.contacts.right, depth)
    return np.concatenate([of_body[:-1], np.full(scene.n_body, speed)])
