"""The paper's own method: MATLAB's ode45, written anew and compiled; see :mod:`.dormand_prince`.

It solves for displacements and velocities straight through the contacts, at the tolerances that MATLAB takes where it
is told none (the paper states none). So its error can be told from that of the binary collision approximation, which
the paper judges by it.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dem_bridge import features
from dem_bridge.backends.bars import reference_bars
from dem_bridge.backends.base import Availability, Resolution, Sampling, run_provenance
from dem_bridge.backends.dormand_prince import STEP_TOO_SMALL, TOO_MANY_STEPS, integrate
from dem_bridge.backends.scales import natural_scales
from dem_bridge.compiled import interruptible
from dem_bridge.errors import RunBroken
from dem_bridge.scene import Scene
from dem_bridge.support import Support
from dem_bridge.trajectory import Cost, Trajectory, Uncertainty

#: those of MATLAB: RelTol, and AbsTol in m and m/s
DEFAULT_RTOL, DEFAULT_ATOL = 1e-3, 1e-6
#: the second run, for the bars, has this many times the tolerances, but no smaller rtol than this
TIGHTER, LEAST = 1e-2, 1e-15
#: ... and the difference to it is taken this many times: SAMPLES for velocity and displacement, CONTACTS for peaks and
#: crossings. Over 200 random scenes (2 to 60 bodies, four decades of mass and stiffness, 1e-9 to 1e3 m/s) the error was
#: up to 1.5, 2.4, 16 and 182 differences at the default tolerances, but at most 1.1, 1.4, 6.1 and 4.8 in 99 % of them
#: (on 200 others the bars held in 99.5 % and more of the scenes for each quantity); at tighter tolerances less
SAMPLES, CONTACTS = 2.0, 8.0
#: longest step, of the duration: MATLAB's, and that of the second run, which would else err alike where no tolerance
#: decides the step
SHARE, SECOND_SHARE = 0.1, 0.02
MOST_STEPS = 50_000_000


class Ode45:
    """Dormand & Prince 5(4) with MATLAB's step control.

    >>> import dem_bridge as db
    >>> run = db.solve("decelerating-40", backend="ode45")
    >>> error = abs(run.velocity - db.solve("decelerating-40", backend="reference").velocity).max()
    >>> f"{error / 0.8:.0e}", run.cost.force_evaluations < 2500
    ('4e-03', True)
    """

    name = "ode45"
    equations = "hertz"
    order: int | None = None
    supports = Support(
        {features.WALLS, features.GAPS, features.INITIAL_OVERLAPS, features.SEVERAL_MOVING}
        | {features.OTHER_EXPONENTS, features.GRADED_EXPONENTS, features.GRAVITY, features.PRECOMPRESSION}
    )

    def availability(self) -> Availability:
        return Availability(True)

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        """Solve with ``rtol`` and ``atol`` (m and m/s), the initial step as for ``tspan = [0 duration]``.

        The bars are the difference to a second run with both a hundredth, whose absolute tolerances besides follow the
        scene's own scales: 1e-6 m may be all that moves. That run takes shorter steps where nothing bends, and none
        over a contact: a graze between two flights would be missed by both. Raises RunBroken where the step falls
        below 16 units in the last place of t, as ode45 warns and stops.
        """
        rtol = resolution.rtol if resolution.rtol is not None else DEFAULT_RTOL
        atol = resolution.atol if resolution.atol is not None else DEFAULT_ATOL
        run = self._solve(scene, sampling, rtol, np.full(2 * scene.n_body, atol), SHARE, False)
        settings = {"rtol": rtol, "atol": atol, "samples": sampling.count}
        run = replace(run, provenance={**run.provenance, "settings": settings})
        if not resolution.bars:
            return run
        own = np.maximum(TIGHTER * np.minimum(atol, rtol * _scales(scene)), 1e-300)  # a scene at rest has no scale
        second = self._solve(scene, sampling, max(TIGHTER * rtol, LEAST), own, SECOND_SHARE, True)
        bars = reference_bars(run, [second], factor=CONTACTS, duration=scene.duration)
        samples = reference_bars(run, [second], factor=SAMPLES, duration=scene.duration)
        bars |= {name: samples[name] for name in ("velocity", "displacement")}
        # which collision is the largest is no better known than velocities are
        speed = float(np.max(np.abs(run.velocity)))
        share = bars["velocity"] / speed if speed > 0.0 else 0.0
        bars["peak_force"] = np.maximum(bars["peak_force"], share * run.peak_force)
        return replace(run, uncertainty=Uncertainty(**bars))

    def _solve(
        self, scene: Scene, sampling: Sampling, rtol: float, atol: NDArray[np.float64], share: float, wary: bool
    ) -> Trajectory:
        wall, cpu = time.perf_counter(), time.process_time()
        c, times = scene.contacts, sampling.times(scene.duration)
        x, v, force, peak, crossing, accepted, failed, ended, at = interruptible(
            integrate,
            np.array(scene.mass),
            np.array(scene.velocity),
            c.left,
            c.right,
            c.stiffness,
            c.exponent,
            c.gap,
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
        if not np.all(np.isfinite(v)):
            raise RunBroken(f"ode45 on {scene.name}: velocities are not finite; give a smaller rtol")
        return Trajectory(
            time=times,
            displacement=x,
            velocity=v,
            contact_force=force,
            peak_force=peak,
            crossing_time=crossing,
            cost=Cost(
                wall=time.perf_counter() - wall,
                cpu=time.process_time() - cpu,
                steps=accepted,
                force_evaluations=6 * (accepted + failed) + 1,
            ),
            provenance=run_provenance(self, scene, {}) | {"failed_steps": failed},
        )


def _scales(scene: Scene) -> NDArray[np.float64]:
    """What is small against each entry of the state: the shallowest overlap (m) of a body's contacts that the energy at
    hand allows, then the largest speed (m/s)."""
    speed, depth = natural_scales(scene)
    of_body = np.full(scene.n_body + 1, speed * scene.duration)
    np.minimum.at(of_body, scene.contacts.left, depth)
    np.minimum.at(of_body, scene.contacts.right, depth)
    return np.concatenate([of_body[:-1], np.full(scene.n_body, speed)])
