"""DOP853 in overlap variables, restarted at every located opening and closing.

The force is only C^1 at touch, so a high-order method that steps across an opening or closing loses its order
there. scipy's DOP853 (Hairer, Nørsett & Wanner 1993, *Solving ODEs I*, II.10) is therefore stepped one step at a time:
the overlaps after a step show whether a contact opened or closed in it; the earliest such moment is located on the
dense output and the integration starts anew from there. Overlaps are variables of the integration, so nothing is
ever subtracted that is a thousand times larger than the overlap.

Right-hand side and steps are compiled (:mod:`.scipy_kernels`, :mod:`.scipy_step`). The dense output costs three
evaluations and is made only for steps with a sample, an event or a maximum; equations of one contact are solved on its
polynomials alone.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable
from functools import cached_property
from typing import Any, TypedDict

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853
from scipy.optimize import brentq

from dem_bridge.backends import scipy_kernels as kernels
from dem_bridge.backends.base import Sampling
from dem_bridge.backends.scales import natural_scales, resting_acceleration, resting_speed, unfelt_overlap
from dem_bridge.backends.scipy_kernels import OPEN, PRESSING, Floats
from dem_bridge.backends.scipy_step import CompiledDop853, missed_impulse
from dem_bridge.errors import RunBroken
from dem_bridge.foundation import progress
from dem_bridge.scene.scene import Scene

#: absolute tolerance as a fraction of rtol times the scale: re-collisions a thousand times slower than the impact
#: keep their digits. 1e-2 is 30 times worse on the decelerating chain, 1e-6 no better and 25 % dearer.
ATOL_SHARE = 1e-4
#: the same for what is far slower than a static force could make it: 1e-2 of 3e-14 is the last digit of that force
REST_SHARE = 1e-2
#: tolerances of a contact's closing rate by which the first step may miss the impulse of its force, see
#: :meth:`Integration.longest_start`. A contact that is alone begins with a step that misses 2
MISSED = 3.0
#: part of the unfelt overlap that is round-off of a located event
LATE = 1e-3
#: part of the overlap that the energy allows, and of the largest speed, below which a run states a near touch, or a
#: closing rate that may fall to zero just after the end
NEAR_TOUCH = 1e-6
#: fractions of a step that begins with a closing rate of exactly 0 at which its sign is evaluated: it may turn at once
PROBES = 2.0 ** np.arange(-20, 1)


class NearTouch(TypedDict):
    """A moment at which a contact is near touch, or near its first maximum at the end, so that errors may decide it."""

    contact: int
    time: float
    """s."""
    last: bool
    """The moment is the end of the run; else the contact turns back there."""
    felt: bool
    """The run has a force of this touch."""
    overlap: float
    """m."""
    rate: float
    """Closing rate, m/s; 0 at a turn."""
    bend: float
    """Acceleration of opening, m/s^2."""


class Step:
    """The last step of a solver and its dense output, which is evaluated when it is first needed."""

    def __init__(self, solver: DOP853, contacts: NDArray[Any]) -> None:
        self.solver, self.contacts = solver, contacts

    @cached_property
    def dense(self) -> Any:
        """Dense output of the whole state: a function of time (s)."""
        return self.solver.dense_output()

    def at(self, t: float) -> tuple[float, Floats, Floats]:
        """Return the part of the step at a time, terms of the dense output and the state at its start, for kernels."""
        dense = self.dense
        return float((t - dense.t_old) / dense.h), dense.F, dense.y_old

    def component(self, index: int) -> Callable[[float], float]:
        """Return one component of the state as a function of time, by the operations of scipy's dense output."""
        dense, start = self.dense, float(self.solver.y_old[index])
        began, width, terms = float(dense.t_old), float(dense.h), dense.F[::-1, index].tolist()

        def value(t: float) -> float:
            x = (t - began) / width
            y, factor, other = 0.0, x, 1.0 - x
            for term in terms:
                y = (y + term) * factor
                factor, other = other, factor
            return y + start

        return value

    def closing_rate(self, contact: int) -> Callable[[float], float]:
        """Return the closing rate of a contact (m/s) as a function of time."""
        k = len(self.contacts)
        left, right = (int(self.contacts[side][contact]) for side in ("left", "right"))
        # the index n stands for a wall, which rests
        bodies = [self.component(k + body) if k + body < self.solver.n - 1 else None for body in (left, right)]
        first, second = bodies
        if second is None:
            return first if first is not None else lambda t: 0.0
        if first is None:
            return lambda t: -second(t)
        return lambda t: first(t) - second(t)

    def turning_time(self, contact: int, low: float, high: float) -> float:
        """Return when the closing rate of ``contact`` passes through zero between two times within the step."""
        return root_of(self.closing_rate(contact), low, high)


def root_of(function: Callable[[float], float], low: float, high: float) -> float:
    """Return a zero of ``function`` between ``low`` and ``high``, to the last digits."""
    # from 1 s to 1e-300 s are a thousand halvings
    return float(brentq(function, low, high, xtol=1e-300, rtol=1e-15, maxiter=2000))


def put_on_its_side(contact: int, y: Floats, state: NDArray[Any], touch: float) -> None:
    """Set the overlap of a contact that has just opened or closed to 0 if it is 0 but for the digits of a root.

    An event may be late by up to the unfelt overlap ``touch``, m. Such an overlap is kept, for a displacement may be as
    small as that, unless its sign is that of the state before.
    """
    late = abs(y[contact]) > LATE * touch
    y[contact] = (min if state[contact] == OPEN else max)(y[contact], 0.0) if late else 0.0


def rounded_overlap(scene: Scene) -> Floats:
    """Return the part of each overlap of a precompressed chain, m, that the digits of its bodies' velocities hide.

    The last digit of a velocity that two bodies have in common is a closing rate; the overlap is unknown by what it
    grows by in a radian of its oscillation about the static overlap. A tenth of that leaves the result as it is.
    Without this bound steps follow round-off: a chain that flies at 14 m/s from a wall took 108,000 for 165 periods.
    """
    c, mobility = scene.contacts, scene.mobility
    velocity, static = np.abs(np.append(scene.velocity, 0.0)), np.maximum(-c.gap, 1e-300)
    tangent = c.stiffness * (c.exponent - 1.0) * static ** (c.exponent - 2.0)
    frequency = np.sqrt(tangent * (mobility[c.left] + mobility[c.right]))
    common = np.minimum(velocity[c.left], velocity[c.right])
    return np.asarray(0.1 * float(np.finfo(float).eps) * common / frequency)


class Integration:
    """One run. State: overlap of every contact (negative: open), velocity of every body, displacement of body 0.

    The state of the contacts, ``(n_contact,)``, decides which forces act; here a contact is OPEN or PRESSING.
    """

    def __init__(self, scene: Scene, sampling: Sampling, rtol: float) -> None:
        self.scene, self.rtol = scene, rtol
        self.steps = self.evaluations = self.restarts = 0
        n, k, c = scene.n_body, scene.n_contact, scene.contacts
        self.n, self.k, self.gap = n, k, c.gap
        self.contacts, self.bodies = kernels.contact_table(scene), kernels.body_table(scene)
        self.laws = [(law.force, np.flatnonzero(c.law == nth)) for nth, law in enumerate(c.laws)]
        self.marks = np.zeros(k, np.int64)  # of the last step; see kernels.examine
        self.state = np.full(k, OPEN)
        speed, depth = natural_scales(scene)
        self.touch = unfelt_overlap(scene)
        scales = np.concatenate([np.minimum(depth, 1e12 * self.touch), np.full(n, speed), [speed * scene.duration]])
        self.atol = np.maximum(ATOL_SHARE * rtol * scales, 1e-300)  # a scene at rest has no scale
        # forces in balance cancel but for their last digit: velocities and displacements owe nothing below it
        rest = np.concatenate([np.zeros(k), np.full(n, resting_speed(scene)), [np.max(-c.gap, initial=0.0)]])
        if scene.precompression > 0.0:
            self.atol = np.maximum(self.atol, REST_SHARE * rtol * rest)
            self.atol[:k] = np.maximum(self.atol[:k], rounded_overlap(scene))
        self.resting = resting_acceleration(scene)
        self.missed = missed_impulse(self.contacts["power"])
        self.times = sampling.times(scene.duration)
        rows = len(self.times)
        self.displacement, self.velocity = np.zeros((rows, n)), np.zeros((rows, n))
        self.contact_force = np.zeros((rows, k))
        self.peak_force, self.crossing_time = np.zeros(k), np.full(k, np.nan)
        self.near, self.slow = NEAR_TOUCH * depth, NEAR_TOUCH * speed
        self.near_touches: list[NearTouch] = []
        self.lowest = -c.gap  # the smallest overlap of each contact so far, m
        #: how fast the closing rate of a contact falls at its first crossing, m/s^2; the keys are their numbers
        self.slowing_at_crossing: dict[str, float] = {}
        force = scene.driving_force
        self.drive = None if force is None else force.function()
        #: the drive as kernels take it; None for a table
        self.wave = None if force is not None and force.shape == "table" else kernels.wave_table(force)
        #: acceleration of a piston, m/s^2, until the next of its bends; None without one, or at a constant velocity
        self.piston: Callable[[float], float] | None = None

    def run(self) -> None:
        """Integrate from event to event until the end of the scene."""
        end, drive = self.scene.duration, self.scene.drive
        breaks = [] if drive is None else drive.breaks[drive.breaks < end].tolist()
        y = np.concatenate([-self.gap, np.array(self.scene.velocity), [0.0]])
        state = self.state = self.state_at_start(y)
        self._keep(np.array([0]), y[None], state)
        at, sample = 0.0, 1
        while at < end:
            # a high order needs smooth forces: it ends, too, where a drive bends
            stop = breaks[bisect_right(breaks, at)] if breaks and at < breaks[-1] else end
            self._set_piston(at, stop, y)
            with np.errstate(over="ignore", invalid="ignore"):  # a trial step may be far too long, and is refused
                solver = self._solver(state, at, y, stop)
            solver.h_abs = min(solver.h_abs, self.longest_start(y))
            event = None
            while event is None and solver.status == "running":
                begin = solver.f
                with np.errstate(over="ignore", invalid="ignore"):  # a trial step may be far too long, and is refused
                    message = solver.step()
                if solver.status == "failed":
                    raise RunBroken(
                        f"scipy on {self.scene.name}: DOP853 stopped at t = {solver.t:.6g} s: {message} Shorten the"
                        " duration or gap before that time, which leaves its last digits to a collision, or take"
                        " backend='verlet'"
                    )
                self.steps += 1
                np.minimum(self.lowest, solver.y[: self.k], out=self.lowest)
                step = Step(solver, self.contacts)
                self._examine(solver, begin, state)
                event = self.first_event(solver, step, state)
                until = solver.t if event is None else event[0]
                while self.near_touches and self.near_touches[-1]["time"] > until:
                    self.near_touches.pop()  # without what happens before it
                upto = int(np.searchsorted(self.times, until, side="right")) if until < end else len(self.times)
                if upto > sample:
                    samples = np.arange(sample, upto)
                    self._keep(samples, step.dense(self.times[samples]).T, state)
                    sample = upto
                self._note_peaks(solver, step, until, state)
            self.evaluations += solver.nfev
            progress.report(solver.t / end)
            at, y = solver.t, solver.y
            if event is not None:
                at, contact = event
                y = self._step_to(at, step)
                self._switch(contact, y, state)
                self.restarts += 1
        self._note_end(end, y, state)

    def _set_piston(self, at: float, stop: float, y: Floats) -> None:
        """Set the acceleration of a piston between two times, s, and its velocity at the first of them in ``y``."""
        piston = self.scene.piston
        if piston is None or piston.shape == "constant":
            return
        y[self.k] = float(piston.at(at))
        if piston.shape == "table":
            # it is the same at all times between; at their ends it jumps
            slope = float(piston.acceleration(0.5 * (at + stop)))
            self.piston = lambda t: slope
        else:
            size, turn, phase = piston.peak * piston.turn, piston.turn, math.radians(piston.phase)
            self.piston = lambda t: size * math.cos(turn * t + phase)

    def _solver(self, state: NDArray[Any], at: float, y: Floats, stop: float, **more: float) -> DOP853:
        """Return scipy's solver from a time to another; its steps are compiled unless they need functions of Python."""
        settings = (self.derivative(state), at, y, stop)
        if self.laws or self.piston is not None or self.wave is None:
            return DOP853(*settings, rtol=self.rtol, atol=self.atol, **more)
        system = (state, self.contacts, self.bodies, self.scene.drag, self.wave)
        return CompiledDop853(system, *settings, rtol=self.rtol, atol=self.atol, **more)

    def state_at_start(self, y: Floats) -> NDArray[Any]:
        """Return the state of the contacts at the start."""
        np.maximum(self.peak_force, self._force(y[None])[0], out=self.peak_force)
        overlap = y[: self.k]
        return np.where((overlap > 0.0) | ((overlap == 0.0) & (self.closing_rates(y) >= 0.0)), PRESSING, OPEN)

    def longest_start(self, y: Floats) -> float:
        """Return the longest first step, s, at a state in which contacts begin; inf where none does.

        A force ``overlap^(n - 1)`` is singular at touch unless n is whole. The estimate of DOP853's error is too small
        for it where stiffer contacts bend the motion, and where n is nearly whole: it misses what is missed at all
        tolerances alike. With the time ``d/u`` of a contact, ``d^n = n u^2 / (2 beta (1/m + 1/M))``, a first step h
        misses ``n/2 missed (h u/d)^n`` of its closing rate u.
        """
        rate = self.closing_rates(y)
        begins = np.flatnonzero((y[: self.k] >= 0.0) & (y[: self.k] <= self.touch) & (rate > 0.0))
        if self.laws or len(begins) == 0:
            return math.inf
        mobility, contacts, rate = np.append(self.bodies["mobility"], 0.0), self.contacts[begins], rate[begins]
        both, n = mobility[contacts["left"]] + mobility[contacts["right"]], contacts["power"] + 1.0
        with np.errstate(divide="ignore", over="ignore", under="ignore"):  # a piston on a wall has no mobility
            depth = (0.5 * n / both / contacts["stiffness"]) ** (1.0 / n) * rate ** (2.0 / n)
            part = (MISSED * self.rtol / (0.5 * n * self.missed[begins])) ** (1.0 / n)
            # forces of overlaps up to touch are not felt, however they begin
            longest = np.maximum(part * depth, self.touch[begins]) / rate
        return float(np.min(longest[depth > self.touch[begins]], initial=math.inf))

    def _switch(self, contact: int, y: Floats, state: NDArray[Any]) -> None:
        """Open or close a contact, in place."""
        state[contact] = OPEN if state[contact] == PRESSING else PRESSING
        put_on_its_side(contact, y, state, float(self.touch[contact]))

    def _step_to(self, at: float, step: Step) -> Floats:
        """Return the state at ``at`` inside the last step, by a step of its own: the dense output is an order lower."""
        solver = step.solver
        width = at - solver.t_old
        if width <= 0.0:
            return np.array(solver.y_old)
        again = self._solver(self.state, solver.t_old, solver.y_old, at, first_step=width)
        while again.status == "running":
            again.step()
        self.evaluations += again.nfev
        return np.array(again.y if again.status == "finished" else step.dense(at))

    def closing_rates(self, y: Floats) -> Floats:
        """Return the closing rate of every contact; of a derivative of the state the closing acceleration."""
        rates = np.empty(self.k)
        kernels.closing_rates(y, self.contacts, self.n, rates)
        return rates

    def _elastic(self, overlap: Floats) -> Floats:
        """Return elastic forces ``(..., n_contact)`` where laws are functions; no columns where kernels have them."""
        if not self.laws:
            return np.empty((*overlap.shape[:-1], 0))
        pressed, forces = np.maximum(overlap, 0.0), np.zeros(overlap.shape)
        for force, contacts in self.laws:
            depths = pressed[..., contacts]
            if depths.any():  # in a long chain few contacts are closed at a time
                forces[..., contacts] = force(depths)
        return forces

    def _force(self, rows: Floats) -> Floats:
        """Return elastic and damping force of every contact ``(n_row, n_contact)``, whatever the sign of their sum."""
        forces = np.empty((len(rows), self.k))
        kernels.contact_forces(rows, self._elastic(rows[:, : self.k]), self.contacts, self.n, forces)
        return forces

    def derivative(self, state: NDArray[Any]) -> Callable[[float, Floats], Floats]:
        """Return the right-hand side for a fixed state of the contacts: smooth across the closing of any other."""
        k, contacts, bodies, drag, drive = self.k, self.contacts, self.bodies, self.scene.drag, self.drive
        derivative, nothing, piston = kernels.derivative.compiled, np.empty(0), self.piston

        def slope(t: float, y: Floats) -> Floats:
            out = np.empty_like(y)
            elastic = self._elastic(y[:k]) if self.laws else nothing
            push = 0.0 if drive is None else drive(t)
            derivative(y, state, elastic, contacts, bodies, drag, push, out)
            if piston is not None:
                out[k] = piston(t)
            return out

        return slope

    def _examine(self, solver: DOP853, begin: Floats, state: NDArray[Any]) -> None:
        """Mark the contacts that need the dense output of the last step; ``begin``: the derivative at its start."""
        old, new, width = solver.y_old, solver.y, solver.t - solver.t_old
        kernels.examine(
            old, new, begin, solver.f, width, state, self.contacts, self.n, self.touch, self.resting, self.marks
        )

    def first_event(self, solver: DOP853, step: Step, state: NDArray[Any]) -> tuple[float, int] | None:
        """Return the earliest opening or closing inside the last step, as (time, contact), or None.

        A contact that leaves touch without ever having had a force is opened in ``state``, in place.
        """
        events: list[tuple[float, int]] = []
        for contact in np.flatnonzero(self.marks & (kernels.ENDS | kernels.TURNS)).tolist():
            low, high, touch = solver.t_old, solver.t, self.touch[contact]
            side = -1.0 if state[contact] == OPEN else 1.0  # side * overlap >= 0 as long as nothing happens
            overlap = step.component(contact)
            begins, ends = side * solver.y_old[contact], side * solver.y[contact]
            if self.marks[contact] & kernels.TURNS:
                # it may have crossed and come back, or come from touch and gone too far: the turning point decides
                turning = step.turning_time(contact, low, high)
                extreme = side * overlap(turning)
                if state[contact] == OPEN and extreme >= -touch:
                    self._note_turn(contact, turning, step, state)
                if ends >= -touch:
                    high, ends = turning, extreme
                elif begins <= 0.0 and extreme > touch:
                    low, begins = turning, extreme
            if ends >= -touch:
                continue
            if begins > 0.0:
                events.append((root_of(overlap, low, high), contact))
            elif state[contact] == PRESSING and high == solver.t:
                state[contact] = OPEN
            else:
                events.append((float(solver.t_old), contact))
        return min(events, default=None)

    def _maxima(self, solver: DOP853, step: Step, state: NDArray[Any]) -> list[tuple[float, int]]:
        """Return every (time, contact) of the last step at which a closing rate falls through zero.

        Two turns within a step are separated by the extremum of the rate between them.
        """
        old, new = solver.t_old, solver.t
        brackets = [(old, new, contact) for contact in np.flatnonzero(self.marks & kernels.FALLS).tolist()]
        slope = self.derivative(state)
        for contact in np.flatnonzero(self.marks & (kernels.DIPS | kernels.BUMPS)).tolist():

            def bend(t: float, contact: int = contact) -> float:
                return float(self.closing_rates(slope(t, step.dense(t)))[contact])

            if bend(old) * bend(new) >= 0.0:
                continue
            extremum, dips = brentq(bend, old, new), bool(self.marks[contact] & kernels.DIPS)
            if dips == (step.closing_rate(contact)(extremum) < 0.0):
                brackets.append((old, extremum, contact) if dips else (extremum, new, contact))
        times = old + PROBES * (new - old)
        for contact in np.flatnonzero(self.marks & kernels.STARTS).tolist():
            rate = np.array([step.closing_rate(contact)(t) for t in times.tolist()])
            falls = np.flatnonzero((rate[:-1] > 0.0) & (rate[1:] <= 0.0)).tolist()
            brackets += [(times[probe], times[probe + 1], contact) for probe in falls]
        return sorted((step.turning_time(contact, low, high), contact) for low, high, contact in brackets)

    def _note_peaks(self, solver: DOP853, step: Step, until: float, state: NDArray[Any]) -> None:
        """Keep force and time of every maximal compression within the last step, up to ``until``."""
        if not self.marks.any():
            return
        for when, contact in self._maxima(solver, step, state):
            if when > until:
                continue
            y = step.dense(when)
            if math.isnan(self.crossing_time[contact]):
                self._note_turn(contact, when, step, state)
            if y[contact] <= self.touch[contact]:
                continue
            if not self._is_pushed(contact, when, y, state):
                # a motion so small that the dense output has all its digits
                self.peak_force[contact] = max(self.peak_force[contact], self._force_at(y, contact))
                continue
            first = math.isnan(self.crossing_time[contact])
            if first or self._force_at(y, contact) > (1.0 - 1e-9) * self.peak_force[contact]:
                # as accurate as a step, which the dense output is not
                y = self._step_to(when, step)
                self.peak_force[contact] = max(self.peak_force[contact], self._force_at(y, contact))
            if first:
                slowing = self._slowing(contact, when, y, state)
                late = self.closing_rates(y)[contact] / slowing if slowing > 0.0 else 0.0
                self.slowing_at_crossing[str(contact)] = slowing
                self.crossing_time[contact] = min(max(when + late, solver.t_old), solver.t)

    def _note_turn(self, contact: int, when: float, step: Step, state: NDArray[Any]) -> None:
        """Keep a turn of a contact near touch.

        Bodies that begin in touch move by round-off before they are pushed, which is no graze.
        """
        y = step.dense(when)
        overlap, felt = float(y[contact]), bool(state[contact] != OPEN)
        if self.lowest[contact] < -self.touch[contact] and abs(overlap) <= self.near[contact]:
            bend = self._slowing(contact, when, y, state)
            self.near_touches.append(
                NearTouch(contact=contact, time=when, last=False, felt=felt, overlap=overlap, rate=0.0, bend=bend)
            )

    def _note_end(self, end: float, y: Floats, state: NDArray[Any]) -> None:
        """Keep which contacts approach near touch, or near their first maximum of compression, at the end."""
        rates = self.closing_rates(y)
        been_open = self.lowest < -self.touch
        near = (rates >= 0.0) & (np.abs(y[: self.k]) <= self.near) & been_open
        slow = (rates > 0.0) & (rates <= self.slow) & (state != OPEN) & np.isnan(self.crossing_time)
        for contact in np.flatnonzero(near | slow).tolist():
            bend = self._slowing(contact, end, y, state)
            overlap, rate, felt = float(y[contact]), float(rates[contact]), bool(state[contact] != OPEN)
            self.near_touches.append(
                NearTouch(contact=contact, time=end, last=True, felt=felt, overlap=overlap, rate=rate, bend=bend)
            )

    def _is_pushed(self, contact: int, when: float, y: Floats, state: NDArray[Any]) -> bool:
        """Return whether more than round-off ends the compression of a contact."""
        if self.resting[contact] == 0.0:
            return True
        return abs(self._slowing(contact, when, y, state)) >= float(self.resting[contact])

    def _slowing(self, contact: int, when: float, y: Floats, state: NDArray[Any]) -> float:
        """Return how fast the closing rate of a contact falls, m/s^2."""
        return -float(self.closing_rates(self.derivative(state)(when, y))[contact])

    def _keep(self, samples: NDArray[np.int64], rows: Floats, state: NDArray[Any]) -> None:
        """Store the states ``rows (n_row, n_state)`` as samples. Positions follow from body 0 and the overlaps."""
        k, links = self.k, self.n - 1
        self.velocity[samples] = rows[:, k:-1]
        self.displacement[samples, 0] = rows[:, -1]
        self.displacement[samples, 1:] = rows[:, -1:] - np.cumsum(rows[:, :links] + self.gap[:links], axis=1)
        forces = self._sampled_force(rows, state)
        self.contact_force[samples] = forces
        np.maximum(self.peak_force, forces.max(axis=0, initial=0.0), out=self.peak_force)

    def _sampled_force(self, rows: Floats, state: NDArray[Any]) -> Floats:
        """Return contact forces ``(n_row, n_contact)`` of states ``(n_row, n_state)``."""
        return self._force(rows)

    def _force_at(self, y: Floats, contact: int) -> float:
        """Return the force of one contact, N."""
        return float(self._force(y[None])[0, contact])
