"""The in-house scipy reference: DOP853 in overlap variables, restarted at every located opening and closing.

The force is only C^1 at touch, so a high-order method that steps across an opening or closing loses its order
there. scipy's DOP853 (Hairer, Nørsett & Wanner 1993, *Solving ODEs I*, II.10) is therefore stepped by hand: after
each step the overlaps say whether a contact opened or closed in it; the earliest such moment is located on the
dense output and the integration starts anew from there. Overlaps are variables of the integration, so nothing is
ever subtracted that is a thousand times larger than the overlap. Shares no code with the twin.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853
from scipy.optimize import brentq

from dem_bridge import progress
from dem_bridge.backends.bars import UNKNOWN, reference_bars
from dem_bridge.backends.base import Availability, Resolution, Sampling, birth_certificate, natural_scales
from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.scene import Scene
from dem_bridge.trajectory import Cost, Trajectory

Floats = NDArray[np.float64]

#: local tolerance, near the smallest that DOP853 takes (100 eps)
DEFAULT_RTOL = 3e-14
#: the largest that may be asked for and still be called a reference
LARGEST_RTOL = 1e-4
#: absolute tolerance as a fraction of rtol times the scale: re-collisions a thousand times slower than the impact
#: keep their digits. 1e-2 is 30 times worse on the decelerating chain, 1e-6 no better and 25 % dearer.
ATOL_SHARE = 1e-4
#: the second run, for the bars, has this many times the tolerance
BAR_FACTOR = 10.0
#: ... and the difference to it is taken this many times
BAR_SAFETY = 3.0


class ScipyDop853:
    """DOP853 in overlap variables with located contact events. Any masses, exponents, gaps, walls; gravity."""

    name = "scipy"
    equations = "hertz"
    order: int | None = None

    def availability(self) -> Availability:
        return Availability(True)

    def refusal(self, scene: Scene) -> str | None:
        return None

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        """Solve; the bars are the difference to a second run at ten times the tolerance.

        Raises UsageError for ``rtol`` above 1e-4, RunBroken where DOP853 stops.
        """
        wall, cpu = time.perf_counter(), time.process_time()
        rtol = resolution.rtol if resolution.rtol is not None else DEFAULT_RTOL
        if rtol > LARGEST_RTOL:
            raise UsageError(f"rtol = {rtol:g} is too loose for {self.name}; allowed: up to {LARGEST_RTOL:g}")
        share = 0.5 if resolution.bars else 1.0
        fine = _Integration(scene, sampling, rtol, share=share)
        fine.run()
        bars: dict[str, Any] = dict(UNKNOWN)
        used = (time.perf_counter() - wall, time.process_time() - cpu)
        if resolution.bars:
            coarse = _Integration(scene, sampling, BAR_FACTOR * rtol, share_before=share, share=share)
            coarse.run()
            bars = reference_bars(fine, [coarse], factor=BAR_SAFETY)
        return Trajectory(
            time=fine.times,
            displacement=fine.displacement,
            velocity=fine.velocity,
            contact_force=fine.contact_force,
            peak_force=fine.peak_force,
            crossing_time=fine.crossing_time,
            uncertainty=bars,
            cost=Cost(wall=used[0], cpu=used[1], steps=fine.steps, force_evaluations=fine.evaluations),
            provenance=birth_certificate(self, scene, {"rtol": rtol, "samples": sampling.count})
            | {"restarts": fine.restarts},
        )


class _Integration:
    """One run. State: overlap of every contact (negative: open), velocity of every body, displacement of body 0."""

    def __init__(
        self, scene: Scene, sampling: Sampling, rtol: float, *, share_before: float = 0.0, share: float = 1.0
    ) -> None:
        self.share_before, self.share = share_before, share  # of the whole work, for progress
        self.scene, self.rtol, self.contacts = scene, rtol, scene.contacts
        self.steps = self.evaluations = self.restarts = 0
        n, k, c = scene.n_body, scene.n_contact, scene.contacts
        self.n, self.k = n, k
        self.inverse_mass = 1.0 / np.array(scene.mass)
        # contacts on either side of each body; k stands for none
        self.pushes, self.holds = np.full(n + 1, k), np.full(n + 1, k)
        self.pushes[c.right], self.holds[c.left] = range(k), range(k)
        self.hertz = bool(np.all(c.exponent == 2.5))
        speed, depth = natural_scales(scene)
        self.touch = 1e-12 * depth  # a contact less deep than this has no force that could matter
        scales = np.concatenate([depth, np.full(n, speed), [speed * scene.duration]])
        self.atol = np.maximum(ATOL_SHARE * rtol * scales, 1e-300)  # a scene at rest has no scale
        self.times = sampling.times(scene.duration)
        rows = len(self.times)
        self.displacement, self.velocity = np.zeros((rows, n)), np.zeros((rows, n))
        self.contact_force = np.zeros((rows, k))
        self.peak_force, self.crossing_time = np.zeros(k), np.full(k, np.nan)

    def run(self) -> None:
        """Integrate from event to event until the end of the scene."""
        k, end = self.k, self.scene.duration
        y = np.concatenate([-self.contacts.gap, np.array(self.scene.velocity), [0.0]])
        self._keep(np.array([0]), y[:, None])
        np.maximum(self.peak_force, self._force(y[:k]), out=self.peak_force)
        at, sample = 0.0, 1
        closed = (y[:k] > 0.0) | ((y[:k] == 0.0) & (self._closing(y) >= 0.0))
        while at < end:
            solver = DOP853(self._slope(closed), at, y, end, rtol=self.rtol, atol=self.atol)
            event = None
            while event is None and solver.status == "running":
                message = solver.step()
                if solver.status == "failed":
                    raise RunBroken(f"scipy on {self.scene.name}: DOP853 stopped at t = {solver.t:.6g} s: {message}")
                self.steps += 1
                dense = solver.dense_output()
                event = self._first_event(solver, dense, closed)
                until = solver.t if event is None else event[0]
                upto = int(np.searchsorted(self.times, until, side="right")) if until < end else len(self.times)
                if upto > sample:
                    rows = np.arange(sample, upto)
                    self._keep(rows, dense(self.times[rows]))
                    sample = upto
                self._note_peaks(solver, dense, until)
            self.evaluations += solver.nfev
            progress.report(self.share_before + self.share * solver.t / end)
            at, y = solver.t, solver.y
            if event is not None:
                at, contact = event
                y = self._step_to(at, solver, dense)
                y[contact] = 0.0
                closed[contact] = not closed[contact]
                self.restarts += 1

    def _step_to(self, at: float, solver: DOP853, dense: Callable[[float], Floats]) -> Floats:
        """State at ``at`` inside the last step, by a step of its own: the dense output is an order lower."""
        width = at - solver.t_old
        if width <= 0.0:
            return np.array(solver.y_old)
        again = DOP853(solver.fun, solver.t_old, solver.y_old, at, rtol=self.rtol, atol=self.atol, first_step=width)
        while again.status == "running":
            again.step()
        self.evaluations += again.nfev
        return np.array(again.y) if again.status == "finished" else dense(at)

    def _closing(self, y: Floats) -> Floats:
        """Closing rate of every contact; a wall is a body at rest."""
        velocity = np.append(y[self.k : -1], 0.0)
        return np.asarray(velocity[self.contacts.left] - velocity[self.contacts.right])

    def _force(self, overlap: Floats) -> Floats:
        pressed = np.maximum(overlap, 0.0)
        if self.hertz:
            return self.contacts.stiffness * pressed * np.sqrt(pressed)
        return np.asarray(self.contacts.stiffness * pressed ** (self.contacts.exponent - 1.0))

    def _slope(self, closed: NDArray[np.bool_]) -> Callable[[float, Floats], Floats]:
        """Right-hand side for a fixed set of closed contacts: smooth across the closing of any other."""
        k, gravity = self.k, self.scene.gravity

        def slope(_: float, y: Floats) -> Floats:
            velocity = y[k:-1]
            out = np.empty_like(y)
            out[:k] = self._closing(y)
            force = np.append(np.where(closed, self._force(y[:k]), 0.0), 0.0)
            out[k:-1] = (force[self.pushes[:-1]] - force[self.holds[:-1]]) * self.inverse_mass + gravity
            out[-1] = velocity[0]
            return out

        return slope

    def _first_event(
        self, solver: DOP853, dense: Callable[[float], Floats], closed: NDArray[np.bool_]
    ) -> tuple[float, int] | None:
        """Earliest opening or closing inside the last step, as (time, contact); flips ``closed`` in place for
        contacts that leave touch without ever having had a force."""
        k, before, after = self.k, solver.y_old, solver.y
        turned = (self._closing(before)) * (self._closing(after)) < 0.0
        side = np.where(closed, 1.0, -1.0)  # side * overlap >= 0 as long as nothing happens
        start, stop = side * before[:k], side * after[:k]
        suspects = np.flatnonzero((stop < -self.touch) | turned).tolist()
        found: list[tuple[float, int]] = []
        for contact in suspects:
            upto = solver.t
            if stop[contact] >= -self.touch[contact]:
                # it may have crossed and come back: look at the turning point
                upto = self._turning_time(solver, dense, contact)
                if side[contact] * dense(upto)[contact] >= -self.touch[contact]:
                    continue
            if start[contact] > 0.0:
                when = brentq(lambda t, contact=contact: dense(t)[contact], solver.t_old, upto, xtol=1e-300, rtol=1e-15)
                found.append((float(when), contact))
            elif closed[contact]:
                closed[contact] = False
            else:
                found.append((float(solver.t_old), contact))
        return min(found, default=None)

    def _turning_time(self, solver: DOP853, dense: Callable[[float], Floats], contact: int) -> float:
        """When the closing rate of ``contact`` passes through zero within the last step."""
        return float(
            brentq(lambda t: self._closing(dense(t))[contact], solver.t_old, solver.t, xtol=1e-300, rtol=1e-15)
        )

    def _note_peaks(self, solver: DOP853, dense: Callable[[float], Floats], until: float) -> None:
        """Force and time of every maximal compression within the last step, up to ``until``."""
        k = self.k
        before, after = self._closing(solver.y_old), self._closing(solver.y)
        for contact in np.flatnonzero((before > 0.0) & (after <= 0.0)).tolist():
            when = self._turning_time(solver, dense, contact)
            if when > until:
                continue
            state = dense(when)
            if state[contact] > self.touch[contact]:
                self.peak_force[contact] = max(self.peak_force[contact], self._force(state[:k])[contact])
                if math.isnan(self.crossing_time[contact]):
                    self.crossing_time[contact] = when

    def _keep(self, rows: NDArray[np.int64], states: Floats) -> None:
        """Store samples; ``states (n_state, n_rows)``. Positions follow from body 0 and the overlaps."""
        k, links = self.k, self.n - 1
        self.velocity[rows] = states[k:-1].T
        between = states[:links] + self.contacts.gap[:links, None]
        self.displacement[rows, 0] = states[-1]
        self.displacement[rows, 1:] = (states[-1] - np.cumsum(between, axis=0)).T
        forces = self._force(states[:k].T)
        self.contact_force[rows] = forces
        np.maximum(self.peak_force, forces.max(axis=0, initial=0.0), out=self.peak_force)
