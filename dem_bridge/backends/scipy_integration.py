"""DOP853 in overlap variables, restarted at every located opening and closing.

The force is only C^1 at touch, so a high-order method that steps across an opening or closing loses its order
there. scipy's DOP853 (Hairer, Nørsett & Wanner 1993, *Solving ODEs I*, II.10) is therefore stepped by hand: after
each step the overlaps say whether a contact opened or closed in it; the earliest such moment is located on the
dense output and the integration starts anew from there. Overlaps are variables of the integration, so nothing is
ever subtracted that is a thousand times larger than the overlap.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853
from scipy.optimize import brentq

from dem_bridge import progress
from dem_bridge.backends.base import Sampling
from dem_bridge.backends.scales import natural_scales, resting_acceleration, resting_speed
from dem_bridge.errors import RunBroken
from dem_bridge.scene import Scene

Floats = NDArray[np.float64]

#: absolute tolerance as a fraction of rtol times the scale: re-collisions a thousand times slower than the impact
#: keep their digits. 1e-2 is 30 times worse on the decelerating chain, 1e-6 no better and 25 % dearer.
ATOL_SHARE = 1e-4
#: the same for what is far slower than a static force could make it: 1e-2 of 3e-14 is the last digit of that force
REST_SHARE = 1e-2
#: where in a step that begins with a closing rate of exactly 0 its sign is looked for: it may turn at once
LOOKS = 2.0 ** np.arange(-20, 1)


class Integration:
    """One run. State: overlap of every contact (negative: open), velocity of every body, displacement of body 0.

    The state of the contacts, ``(n_contact,)``, decides which forces act; here it is whether each is closed.
    """

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
        self.laws = [(law.force, np.flatnonzero(c.law == nth)) for nth, law in enumerate(c.laws)]
        self.hertz = bool(np.all(c.exponent == 2.5))
        speed, depth = natural_scales(scene)
        self.touch = 1e-12 * depth  # a contact less deep than this has no force that could matter
        scales = np.concatenate([depth, np.full(n, speed), [speed * scene.duration]])
        self.atol = np.maximum(ATOL_SHARE * rtol * scales, 1e-300)  # a scene at rest has no scale
        # forces in balance cancel but for their last digit: velocities and displacements owe nothing below it
        rest = np.concatenate([np.zeros(k), np.full(n, resting_speed(scene)), [np.max(-c.gap, initial=0.0)]])
        if scene.precompression > 0.0:
            self.atol = np.maximum(self.atol, REST_SHARE * rtol * rest)
        self.free, self.drag, self.resting = scene.free_acceleration, scene.drag, resting_acceleration(scene)
        self.times = sampling.times(scene.duration)
        rows = len(self.times)
        self.displacement, self.velocity = np.zeros((rows, n)), np.zeros((rows, n))
        self.contact_force = np.zeros((rows, k))
        self.peak_force, self.crossing_time = np.zeros(k), np.full(k, np.nan)

    def run(self) -> None:
        """Integrate from event to event until the end of the scene."""
        end, drive = self.scene.duration, self.scene.drive
        breaks = [] if drive is None else drive.breaks[drive.breaks < end].tolist()
        y = np.concatenate([-self.contacts.gap, np.array(self.scene.velocity), [0.0]])
        state = self._start(y)
        self._keep(np.array([0]), y[:, None], state)
        at, sample = 0.0, 1
        while at < end:
            # a high order needs smooth forces: it ends, too, where a drive bends
            stop = breaks[bisect_right(breaks, at)] if breaks and at < breaks[-1] else end
            with np.errstate(over="ignore", invalid="ignore"):  # a trial step may be far too long, and is refused
                solver = DOP853(self._slope(state), at, y, stop, rtol=self.rtol, atol=self.atol)
            event = None
            while event is None and solver.status == "running":
                tilt = solver.f
                with np.errstate(over="ignore", invalid="ignore"):  # a trial step may be far too long, and is refused
                    message = solver.step()
                if solver.status == "failed":
                    raise RunBroken(f"scipy on {self.scene.name}: DOP853 stopped at t = {solver.t:.6g} s: {message}")
                self.steps += 1
                dense = solver.dense_output()
                event = self._first_event(solver, dense, state)
                until = solver.t if event is None else event[0]
                upto = int(np.searchsorted(self.times, until, side="right")) if until < end else len(self.times)
                if upto > sample:
                    rows = np.arange(sample, upto)
                    self._keep(rows, dense(self.times[rows]), state)
                    sample = upto
                self._note_peaks(solver, dense, until, state, tilt)
            self.evaluations += solver.nfev
            progress.report(self.share_before + self.share * solver.t / end)
            at, y = solver.t, solver.y
            if event is not None:
                at, contact = event
                y = self._step_to(at, solver, dense)
                self._switch(contact, y, state)
                self.restarts += 1

    def _start(self, y: Floats) -> NDArray[Any]:
        """State of the contacts at the start."""
        np.maximum(self.peak_force, self._force(y[: self.k]), out=self.peak_force)
        return np.asarray((y[: self.k] > 0.0) | ((y[: self.k] == 0.0) & (self._closing(y) >= 0.0)))

    def _switch(self, contact: int, y: Floats, closed: NDArray[Any]) -> None:
        """A contact opens or closes, in place."""
        y[contact] = 0.0
        closed[contact] = not closed[contact]

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
        if self.laws:
            out = np.zeros(pressed.shape)
            for force, mine in self.laws:
                own = pressed[..., mine]
                if own.any():  # in a long chain few contacts are closed at a time
                    out[..., mine] = force(own)
            return out
        if self.hertz:
            return self.contacts.stiffness * pressed * np.sqrt(pressed)
        return np.asarray(self.contacts.stiffness * pressed ** (self.contacts.exponent - 1.0))

    def _contact_force(self, y: Floats, closed: NDArray[Any]) -> Floats:
        """Force of every contact in a given state, as smooth functions of ``y``."""
        return np.where(closed, self._force(y[: self.k]), 0.0)

    def _slope(self, state: NDArray[Any]) -> Callable[[float, Floats], Floats]:
        """Right-hand side for a fixed state of the contacts: smooth across the closing of any other."""
        k, free, drag, drive, mobility = self.k, self.free, self.drag, self.scene.drive, float(self.inverse_mass[0])

        def slope(t: float, y: Floats) -> Floats:
            velocity = y[k:-1]
            out = np.empty_like(y)
            out[:k] = self._closing(y)
            force = np.append(self._contact_force(y, state), 0.0)
            out[k:-1] = (force[self.pushes[:-1]] - force[self.holds[:-1]]) * self.inverse_mass + free
            if drag > 0.0:
                out[k:-1] -= drag * velocity
            if drive is not None:
                out[k] += drive.at(t) * mobility
            out[-1] = velocity[0]
            return out

        return slope

    def _first_event(
        self, solver: DOP853, dense: Callable[[float], Floats], closed: NDArray[Any]
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
            low, high = solver.t_old, solver.t
            begins, ends = start[contact], stop[contact]
            if turned[contact]:
                # it may have crossed and come back, or come from touch and gone too far: look at the turning point
                turning = self._turning_time(dense, contact, low, high)
                extreme = side[contact] * dense(turning)[contact]
                if ends >= -self.touch[contact]:
                    high, ends = turning, extreme
                elif begins <= 0.0 and extreme > self.touch[contact]:
                    low, begins = turning, extreme
            if ends >= -self.touch[contact]:
                continue
            if begins > 0.0:
                when = brentq(lambda t, contact=contact: dense(t)[contact], low, high, xtol=1e-300, rtol=1e-15)
                found.append((float(when), contact))
            elif closed[contact] and high == solver.t:
                closed[contact] = False
            else:
                found.append((float(solver.t_old), contact))
        return min(found, default=None)

    def _turning_time(self, dense: Callable[[float], Floats], contact: int, low: float, high: float) -> float:
        """When the closing rate of ``contact`` passes through zero between two times within the last step."""
        return float(brentq(lambda t: self._closing(dense(t))[contact], low, high, xtol=1e-300, rtol=1e-15))

    def _maxima(
        self, solver: DOP853, dense: Callable[[Any], Floats], contacts: NDArray[Any], tilt: Floats
    ) -> list[tuple[float, int]]:
        """Every (time, contact) of the last step at which a closing rate falls through zero; ``tilt``: the slope of the
        state at its start. Two turns within a step are found by the extremum between them."""
        old, new = solver.t_old, solver.t
        before, after = self._closing(solver.y_old), self._closing(solver.y)
        found = [(old, new, contact) for contact in np.flatnonzero((before > 0.0) & (after <= 0.0)).tolist()]
        # zero lies between both tangents, and what ends the compression is more than round-off
        begins, ends = self._closing(tilt), self._closing(solver.f)
        bent = (before * (before + begins * (new - old)) < 0.0) & (after * (after - ends * (new - old)) < 0.0)
        dips = bent & (before > 0.0) & (after > 0.0) & (begins <= -self.resting)
        bumps = bent & (before < 0.0) & (after < 0.0) & (ends <= -self.resting)
        slope = self._slope(contacts)
        for contact in np.flatnonzero(dips | bumps).tolist():
            bends = [self._closing(slope(t, dense(t)))[contact] for t in (old, new)]
            if bends[0] * bends[1] >= 0.0:
                continue
            bend = brentq(lambda t, contact=contact: self._closing(slope(t, dense(t)))[contact], old, new)
            if dips[contact] == (self._closing(dense(bend))[contact] < 0.0):
                found.append((old, bend, contact) if dips[contact] else (bend, new, contact))
        still = np.flatnonzero(before == 0.0).tolist()
        if still:
            times = old + LOOKS * (new - old)
            rates = np.array([self._closing(dense(t)) for t in times])
            for contact in still:
                rate = rates[:, contact]
                falls = np.flatnonzero((rate[:-1] > 0.0) & (rate[1:] <= 0.0)).tolist()
                found += [(times[look], times[look + 1], contact) for look in falls]
        return sorted((self._turning_time(dense, contact, low, high), contact) for low, high, contact in found)

    def _note_peaks(
        self,
        solver: DOP853,
        dense: Callable[[Any], Floats],
        until: float,
        contacts: NDArray[Any],
        tilt: Floats,
    ) -> None:
        """Force and time of every maximal compression within the last step, up to ``until``."""
        k = self.k
        for when, contact in self._maxima(solver, dense, contacts, tilt):
            if when > until:
                continue
            state = dense(when)
            if state[contact] <= self.touch[contact]:
                continue
            if not self._is_pushed(contact, when, state, contacts):
                # a motion so small that the dense output has all its digits
                self.peak_force[contact] = max(self.peak_force[contact], self._force(state[:k])[contact])
                continue
            first = math.isnan(self.crossing_time[contact])
            if first or self._force(state[:k])[contact] > (1.0 - 1e-9) * self.peak_force[contact]:
                # as accurate as a step, which the dense output is not
                state = self._step_to(when, solver, dense)
                self.peak_force[contact] = max(self.peak_force[contact], self._force(state[:k])[contact])
            if first:
                slowing = self._slowing(contact, when, state, contacts)
                late = self._closing(state)[contact] / slowing if slowing > 0.0 else 0.0
                self.crossing_time[contact] = min(max(when + late, solver.t_old), solver.t)

    def _is_pushed(self, contact: int, when: float, y: Floats, state: NDArray[Any]) -> bool:
        """Whether more than round-off ends the compression of a contact."""
        if self.resting[contact] == 0.0:
            return True
        return abs(self._slowing(contact, when, y, state)) >= float(self.resting[contact])

    def _slowing(self, contact: int, when: float, y: Floats, state: NDArray[Any]) -> float:
        """How fast the closing rate of a contact falls, m/s^2."""
        return -float(self._closing(self._slope(state)(when, y))[contact])

    def _keep(self, rows: NDArray[np.int64], states: Floats, state: NDArray[Any]) -> None:
        """Store samples; ``states (n_state, n_rows)``. Positions follow from body 0 and the overlaps."""
        k, links = self.k, self.n - 1
        self.velocity[rows] = states[k:-1].T
        between = states[:links] + self.contacts.gap[:links, None]
        self.displacement[rows, 0] = states[-1]
        self.displacement[rows, 1:] = (states[-1] - np.cumsum(between, axis=0)).T
        forces = self._sampled_force(states, state)
        self.contact_force[rows] = forces
        np.maximum(self.peak_force, forces.max(axis=0, initial=0.0), out=self.peak_force)

    def _sampled_force(self, states: Floats, state: NDArray[Any]) -> Floats:
        """Contact forces ``(n_rows, n_contact)`` of states ``(n_state, n_rows)``."""
        return self._force(states[: self.k].T)
