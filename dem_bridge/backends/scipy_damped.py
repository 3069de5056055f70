"""Damped contacts in the integration of :mod:`.scipy_integration`: three states, each with smooth forces.

======== ===================================== ==========================================
open     overlap < 0, no force                 ends as the overlap rises through 0
pressing elastic and damping force, sum > 0    ends as the sum, or the overlap, falls to 0
slack    overlap > 0, but the sum would pull   ends as the sum rises, or the overlap falls
======== ===================================== ==========================================

Where the sum is clipped at zero, a damped contact ends before its overlap does; where it is not, no contact is slack.
With a dashpot a contact begins with a jump from 0 to c times the closing rate, and ends with one if it is not clipped.
Every one of these moments is located, and the integration starts anew from there. The largest force need not be at
maximal compression; it is searched for on the dense output and at the jumps.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853
from scipy.optimize import minimize_scalar

from dem_bridge.backends import scipy_kernels as kernels
from dem_bridge.backends.base import Sampling
from dem_bridge.backends.scales import UNFELT, natural_scales
from dem_bridge.backends.scipy_integration import Integration, Step, put_on_its_side, root_of
from dem_bridge.backends.scipy_kernels import OPEN, PRESSING, SLACK, Floats
from dem_bridge.errors import RunBroken
from dem_bridge.scene.scene import Scene

#: fractions of a step at which forces and overlaps are evaluated. The two next to the ends tell whether a force still
#: rises there; a maximum between them and the end is missed by (1e-6)^2 of it
PROBES = np.concatenate([[0.0, 1e-6], np.arange(1, 8) / 8.0, [1.0 - 1e-6, 1.0]])
#: what a force must stand out by, of the largest, for a maximum beside its probe
FLAT = 1e-12
#: part of a time by which an event may be late: twice the tolerance of :func:`.root_of`
LAST_DIGITS = 2e-15
#: events without any time between them, per contact, after which a run is given up
MOST_AT_ONCE = 10


class DampedIntegration(Integration):
    """One run with damped contacts; some of them, of coefficient 0, may be elastic."""

    def __init__(self, scene: Scene, sampling: Sampling, rtol: float) -> None:
        super().__init__(scene, sampling, rtol)
        self.clip = scene.contacts.clip
        self.touch = np.maximum(self.touch, 1e-300)  # smallest that divides; a scene at rest has no scale
        speed, depth = natural_scales(scene)
        largest, unfelt = self._force_scale(depth, speed), self._force_scale(self.touch, UNFELT * speed)
        # a body far lighter than the others, or much slower relative to them than all together, feels smaller forces
        self.unnoticed = np.maximum(np.minimum(kernels.UNNOTICED * largest, unfelt), 1e-300)
        self.last_event, self.at_once = -1.0, 0
        self.rows = np.zeros((len(PROBES), len(self.atol)))  # states at the probes of the last step

    def _force_scale(self, overlap: Floats, rate: float) -> Floats:
        """Return elastic plus damping force of each contact, N, at an overlap (m) and a closing rate (m/s)."""
        damping = self.contacts["damping"] * overlap ** self.contacts["damping_power"] * rate
        return np.asarray(self.scene.contacts.force(overlap, np.arange(self.k)) + damping)

    def _sampled_force(self, rows: Floats, state: NDArray[Any]) -> Floats:
        force = self._force(rows)
        return np.where(state == PRESSING, np.maximum(force, 0.0) if self.clip else force, 0.0)

    def state_at_start(self, y: Floats) -> NDArray[Any]:
        """Return the state of the contacts at the start: a damped contact is SLACK where its force is clipped."""
        overlap = y[: self.k]
        pushes = (self._force(y[None])[0] > 0.0) | (self.contacts["damping"] == 0.0) | (not self.clip)
        touching = (overlap == 0.0) & (self.closing_rates(y) >= 0.0)
        return np.where(overlap > 0.0, np.where(pushes, PRESSING, SLACK), np.where(touching, PRESSING, OPEN))

    def _switch(self, contact: int, y: Floats, state: NDArray[Any]) -> None:
        rate = float(self.closing_rates(y)[contact])
        # with n < 2 an overlap that is felt may be less than that which passes in the last digits of a time
        touch = max(float(self.touch[contact]), LAST_DIGITS * self.last_event * abs(rate))
        at_touch, parting = y[contact] <= touch, rate < 0.0
        if state[contact] == OPEN:
            state[contact] = PRESSING
        elif state[contact] == PRESSING:
            state[contact] = OPEN if at_touch else SLACK
        else:
            state[contact] = OPEN if at_touch and parting else PRESSING
        if at_touch:
            put_on_its_side(contact, y, state, touch)

    def margins(self, rows: Floats, state: NDArray[Any]) -> Floats:
        """Return how far each contact is from a change of its state, ``(n_row, n_contact)``: see the kernel."""
        margins = np.empty((len(rows), self.k))
        elastic = self._elastic(rows[:, : self.k])
        limits = (self.clip, self.touch, self.unnoticed)
        kernels.margins(rows, state, elastic, self.contacts, self.n, *limits, margins)
        return margins

    def first_event(self, solver: DOP853, step: Step, state: NDArray[Any]) -> tuple[float, int] | None:
        """Return the earliest change of state inside the last step, as (time, contact), or None."""
        times = solver.t_old + PROBES * (solver.t - solver.t_old)
        self.rows = step.dense(times).T
        margins = self.margins(self.rows, state)
        # the start itself does not count: it is the zero of the last event, with its round-off
        ended = margins < -1.0
        ended[0] = False
        events: list[tuple[float, int]] = []
        for contact in np.flatnonzero(ended.any(axis=0)).tolist():
            first = int(np.argmax(ended[:, contact]))
            before = np.flatnonzero(margins[:first, contact] > 0.0)
            if len(before) == 0:
                events.append((float(solver.t_old), contact))
                continue

            margin = self._margin_within(step, contact, state)
            events.append((root_of(margin, float(times[before[-1]]), float(times[first])), contact))
        events += self._grazes(solver, step, state)
        event = min(events, default=None)
        if event is not None:
            self.at_once = self.at_once + 1 if event[0] == self.last_event else 0
            self.last_event = event[0]
            if self.at_once > MOST_AT_ONCE * self.k:
                raise RunBroken(
                    f"scipy on {self.scene.name}: contact {event[1]} chatters at t = {event[0]:.6g} s, with"
                    f" {self.at_once} events without any time between them; allowed: {MOST_AT_ONCE * self.k}; take"
                    " backend='verlet'"
                )
        return event

    def _margin_within(self, step: Step, contact: int, state: NDArray[Any]) -> Callable[[float], float]:
        """Return the margin of a contact as a function of time within the last step."""
        if self.laws:
            return lambda t: float(self.margins(step.dense(t)[None], state)[0, contact])
        limits = self.clip, float(self.touch[contact]), float(self.unnoticed[contact])
        of_contact = (int(state[contact]), self.contacts, self.n, contact, limits)
        return lambda t: kernels.margin_within.compiled(*step.at(t), *of_contact)

    def _force_within(self, step: Step, contact: int, state: NDArray[Any]) -> Callable[[float], float]:
        """Return the force of a pressing contact as a function of time within the last step."""
        if self.laws:
            return lambda t: float(self._sampled_force(step.dense(t)[None], state)[0, contact])
        of_contact, least = (self.contacts, self.n, contact), 0.0 if self.clip else -math.inf
        return lambda t: max(kernels.force_within.compiled(*step.at(t), *of_contact), least)

    def _grazes(self, solver: DOP853, step: Step, state: NDArray[Any]) -> list[tuple[float, int]]:
        """Return (time, contact) of open contacts that close within the last step and may open again between probes."""
        events = []
        for contact in np.flatnonzero((self.marks & kernels.TURNS) * (state == OPEN)).tolist():
            turning, overlap = step.turning_time(contact, solver.t_old, solver.t), step.component(contact)
            top = overlap(turning)
            if top <= self.touch[contact]:
                self._note_turn(contact, turning, step, state)
            elif solver.y_old[contact] < 0.0:
                events.append((root_of(overlap, solver.t_old, turning), contact))
        return events

    def _note_peaks(self, solver: DOP853, step: Step, until: float, state: NDArray[Any]) -> None:
        """Keep crossings, and largest forces wherever in the step they are, its start after a jump included."""
        super()._note_peaks(solver, step, until, state)
        times = solver.t_old + PROBES * (until - solver.t_old)
        forces = self._sampled_force(self.rows if until == solver.t else step.dense(times).T, state)
        np.maximum(self.peak_force, forces.max(axis=0), out=self.peak_force)
        inner = forces[1:-1]
        # how far the middle one of three stands out: a maximum is at most an eighth of that above it, so forces that
        # only wander by round-off are not examined again
        rise = inner - np.minimum(forces[:-2], forces[2:])
        top = (inner >= np.maximum(forces[:-2], forces[2:])) & (inner > 0.9 * self.peak_force)
        top &= rise > FLAT * self.peak_force
        for probe, contact in np.argwhere(top).tolist():
            low, high = times[probe], times[probe + 2]
            force = self._force_within(step, contact, state)
            maximum = minimize_scalar(
                lambda t, force=force: -force(t),
                bounds=(low, high),
                method="bounded",
                # the square of it is what a maximum is missed by
                options={"xatol": 1e-8 * (high - low)},
            )
            # as accurate as a step, which the dense output is not
            y = self._step_to(float(maximum.x), step)
            largest = self._sampled_force(y[None], state)[0, contact]
            self.peak_force[contact] = max(self.peak_force[contact], float(largest))
