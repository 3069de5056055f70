"""Damped contacts in the integration of :mod:`.scipy_integration`: three states, each with smooth forces.

======== ===================================== ==========================================
open     overlap < 0, no force                 ends as the overlap rises through 0
pressing elastic and damping force, sum > 0    ends as the sum, or the overlap, falls to 0
slack    overlap > 0, but the sum would pull   ends as the sum rises, or the overlap falls
======== ===================================== ==========================================

The sum never pulls, so a damped contact ends before its overlap does, and with a dashpot it begins with a jump from
0 to c times the closing rate. Every one of these moments is located, and the integration starts anew from there. The
largest force need not be at maximal compression; it is looked for on the dense output and at the jumps.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853
from scipy.optimize import brentq, minimize_scalar

from dem_bridge.backends.base import Sampling
from dem_bridge.backends.scales import natural_scales
from dem_bridge.backends.scipy_integration import Floats, Integration
from dem_bridge.errors import RunBroken
from dem_bridge.scene import Scene

OPEN, PRESSING, SLACK = range(3)
#: part of the largest force that may pull unnoticed: round-off of the sum near its zero is a tenth of it
UNNOTICED = 1e-14
#: where in a step forces and overlaps are looked at. The two next to the ends tell whether a force still rises there; a
#: maximum between them and the end is missed by (1e-6)^2 of it
LOOKS = np.concatenate([[0.0, 1e-6], np.arange(1, 8) / 8.0, [1.0 - 1e-6, 1.0]])
#: what a look must stand out by to have a maximum beside it
FLAT = 1e-12
#: events without any time between them, per contact, after which a run is given up
MOST_AT_ONCE = 10


class DampedIntegration(Integration):
    """One run with damped contacts; some of them, of coefficient 0, may be elastic."""

    def __init__(
        self, scene: Scene, sampling: Sampling, rtol: float, *, share_before: float = 0.0, share: float = 1.0
    ) -> None:
        super().__init__(scene, sampling, rtol, share_before=share_before, share=share)
        assert scene.damping is not None
        self.coefficient = np.array(scene.damping.coefficient)
        self.dashpot = scene.damping.law == "dashpot"
        #: an elastic contact has no such force, whatever its n
        self.power = np.maximum(self.contacts.exponent - 2.0, 0.0)
        speed, depth = natural_scales(scene)
        scale = self._force(depth) + self._damping(depth, np.full(self.k, speed))
        # smallest that divides; a scene at rest has no scale
        self.unnoticed, self.touch = np.maximum(UNNOTICED * scale, 1e-300), np.maximum(self.touch, 1e-300)
        self.last_event, self.at_once = -1.0, 0

    def _damping(self, overlap: Floats, rate: Floats) -> Floats:
        if self.dashpot:
            return self.coefficient * rate
        return np.asarray(self.coefficient * self.contacts.stiffness * overlap**self.power * rate)

    def _sum(self, rows: Floats) -> Floats:
        """Elastic and damping force ``(n_rows, n_contact)`` of states ``(n_rows, n_state)``, whatever its sign."""
        overlap = np.maximum(rows[:, : self.k], 0.0)
        velocity = np.concatenate([rows[:, self.k : -1], np.zeros((len(rows), 1))], axis=1)
        rate = velocity[:, self.contacts.left] - velocity[:, self.contacts.right]
        return self._force(overlap) + self._damping(overlap, rate)

    def _contact_force(self, y: Floats, state: NDArray[Any]) -> Floats:
        overlap = np.maximum(y[: self.k], 0.0)
        return np.where(state == PRESSING, self._force(overlap) + self._damping(overlap, self._closing(y)), 0.0)

    def _sampled_force(self, states: Floats, state: NDArray[Any]) -> Floats:
        return np.where(state == PRESSING, np.maximum(self._sum(states.T), 0.0), 0.0)

    def _start(self, y: Floats) -> NDArray[Any]:
        overlap, pushes = y[: self.k], (self._sum(y[None])[0] > 0.0) | (self.coefficient == 0.0)
        touching = (overlap == 0.0) & (self._closing(y) >= 0.0)
        return np.where(overlap > 0.0, np.where(pushes, PRESSING, SLACK), np.where(touching, PRESSING, OPEN))

    def _switch(self, contact: int, y: Floats, state: NDArray[Any]) -> None:
        at_touch, parting = y[contact] <= self.touch[contact], self._closing(y)[contact] < 0.0
        if state[contact] == OPEN:
            state[contact] = PRESSING
        elif state[contact] == PRESSING:
            state[contact] = OPEN if at_touch else SLACK
        else:
            state[contact] = OPEN if at_touch and parting else PRESSING
        if at_touch:
            y[contact] = 0.0

    def _margins(self, rows: Floats, state: NDArray[Any]) -> Floats:
        """Positive while a contact keeps its state, ``(n_rows, n_contact)``, in units of what goes unnoticed.

        Undamped contacts end with their overlap: their sum is no second condition.
        """
        overlap, total = rows[:, : self.k] / self.touch, self._sum(rows) / self.unnoticed
        pressing = np.where(self.coefficient > 0.0, np.minimum(overlap, total), overlap)
        return np.select([state == OPEN, state == PRESSING], [-overlap, pressing], np.minimum(overlap, -total))

    def _first_event(
        self, solver: DOP853, dense: Callable[[Any], Floats], state: NDArray[Any]
    ) -> tuple[float, int] | None:
        """Earliest change of state inside the last step, as (time, contact)."""
        times = solver.t_old + LOOKS * (solver.t - solver.t_old)
        margins = self._margins(dense(times).T, state)
        # the start itself is not asked: it is the zero of the last event, with its round-off
        ended = margins < -1.0
        ended[0] = False
        found: list[tuple[float, int]] = []
        for contact in np.flatnonzero(ended.any(axis=0)).tolist():
            first = int(np.argmax(ended[:, contact]))
            before = np.flatnonzero(margins[:first, contact] > 0.0)
            if len(before) == 0:
                found.append((float(solver.t_old), contact))
                continue
            when = brentq(
                lambda t, contact=contact: self._margins(dense(t)[None], state)[0, contact],
                times[before[-1]],
                times[first],
                xtol=1e-300,
                rtol=1e-15,
            )
            found.append((float(when), contact))
        event = min(found, default=None)
        if event is not None:
            self.at_once = self.at_once + 1 if event[0] == self.last_event else 0
            self.last_event = event[0]
            if self.at_once > MOST_AT_ONCE * self.k:
                raise RunBroken(f"scipy on {self.scene.name}: contact {event[1]} chatters at t = {event[0]:.6g} s")
        return event

    def _note_peaks(
        self, solver: DOP853, dense: Callable[[Any], Floats], until: float, state: NDArray[Any], tilt: Floats
    ) -> None:
        """Crossings as ever; largest forces wherever in the step they are, its start after a jump included."""
        super()._note_peaks(solver, dense, until, state, tilt)
        times = solver.t_old + LOOKS * (until - solver.t_old)
        forces = self._sampled_force(dense(times), state)
        np.maximum(self.peak_force, forces.max(axis=0), out=self.peak_force)
        inner = forces[1:-1]
        # how far the middle one of three stands out: a maximum is at most an eighth of that above it, so forces that
        # only wander by round-off are not looked at again
        rise = inner - np.minimum(forces[:-2], forces[2:])
        top = (inner >= np.maximum(forces[:-2], forces[2:])) & (inner > 0.9 * self.peak_force)
        top &= rise > FLAT * self.peak_force
        for look, contact in np.argwhere(top).tolist():
            low, high = times[look], times[look + 2]
            best = minimize_scalar(
                lambda t, contact=contact: -self._sampled_force(dense(t)[:, None], state)[0, contact],
                bounds=(low, high),
                method="bounded",
                # the square of it is what a maximum is missed by
                options={"xatol": 1e-8 * (high - low)},
            )
            self.peak_force[contact] = max(self.peak_force[contact], -float(best.fun))
