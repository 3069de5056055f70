"""Motions of one scene with faults at its samples, and the numbers of faults that fit the files of a code best."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from dem_bridge.errors import DemBridgeError
from dem_bridge.judging.conformance.behaviour import Behaviour
from dem_bridge.judging.conformance.faults import Candidate, Family, Fault, Numbers, Values
from dem_bridge.judging.conformance.limit import QUANTITIES
from dem_bridge.judging.model import Model

#: steps of a fit, and the relative change at which it ends
_MOST_FIT_STEPS, _FIT_CHANGE = 12, 1e-9
#: a fit that leaves more than this part after so many steps does not get near the files
_FEWEST_FIT_STEPS, _LEAST_PROGRESS = 4, 0.5


class Motions:
    """Motions of one scene with faults, at its samples."""

    def __init__(self, behaviour: Behaviour, known: Iterable[Fault] = ()) -> None:
        self.behaviour, self.known = behaviour, tuple(known)
        #: the last motion, for the faults of what is written
        self._motions: dict[tuple[Fault, ...], Values] = {}

    def values(self, further: Sequence[Fault] = ()) -> Values:
        """Return the values of the scene with the known faults and further ones; the reference without any."""
        faults = (*self.known, *further)
        if not faults:
            return self.behaviour.truth.values
        values = self._moved(tuple(fault for fault in faults if fault.moves))
        for fault in faults:
            values = fault.values(values)
        return values

    def _moved(self, faults: tuple[Fault, ...]) -> Values:
        """Return the motion of the scene with faults, those of what is written aside."""
        if not faults:
            return self.behaviour.truth.values
        if (kept := self._motions.get(faults)) is not None:
            return kept
        scene = self.behaviour.probe.scene
        times = np.linspace(0.0, scene.duration, scene.samples + 1)
        for fault in faults:
            scene, times = fault.scene(scene), fault.time_factor * times
        model = Model(scene)
        system = model.system
        for fault in faults:
            system = fault.system(system)
        with np.errstate(all="ignore"):
            motion = model.exact(system, times)
        self._motions = {faults: {name: getattr(motion, name) for name in QUANTITIES}}
        return self._motions[faults]

    def difference(self, fault: Fault | None = None) -> float:
        """Return the difference that is left, with a further fault; infinite if the scene cannot have the faults."""
        try:
            return self.behaviour.difference(self.values([] if fault is None else [fault]))
        except (DemBridgeError, ArithmeticError):
            return math.inf

    def best(self, candidate: Candidate) -> tuple[Fault, float]:
        """Return a fault, or that of a family which leaves the least, and what it leaves."""
        if isinstance(candidate, Fault):
            return candidate, self.difference(candidate)
        best = candidate.make(*candidate.starts[0])
        least = math.inf
        for start in candidate.starts:
            numbers, left = self.fit(candidate, start)
            if left < least:
                best, least = candidate.make(*numbers), left
        return best, least

    def fit(self, family: Family, start: Numbers) -> tuple[Numbers, float]:
        """Return the numbers of a family by Gauss-Newton from a start, and the difference that they leave.

        The difference is infinite if the files do not depend on one of the numbers.
        """
        numbers = np.array(start)
        best, least, first = start, math.inf, math.inf
        for step in range(_MOST_FIT_STEPS):
            changes = 1e-6 * np.maximum(np.abs(numbers), 1e-3)
            try:
                here = self.behaviour.residual(self.values([family.make(*numbers)]))
                there = [
                    self.behaviour.residual(self.values([family.make(*(numbers + change))]))
                    for change in np.diag(changes)
                ]
            except (DemBridgeError, ArithmeticError):
                break
            slopes = np.stack([(values - here) / change for values, change in zip(there, changes, strict=True)], axis=1)
            if not np.all(np.any(slopes, axis=0)):
                break
            left = float(np.max(np.abs(here)))
            if left < least:
                best, least = tuple(numbers.tolist()), left
            first = left if step == 0 else first
            if step == _FEWEST_FIT_STEPS and least > _LEAST_PROGRESS * first:
                break
            bounds = 0.5 * np.maximum(np.abs(numbers), 1e-2)
            moves = np.clip(np.linalg.lstsq(slopes, -here, rcond=None)[0], -bounds, bounds)
            numbers = numbers + moves
            if np.all(np.abs(moves) < _FIT_CHANGE * np.maximum(np.abs(numbers), 1e-6)):
                break
        return best, least
