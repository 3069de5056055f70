"""The comparison of the limit of a code with the reference of a scene, and the fault that explains the difference."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dem_bridge.errors import DemBridgeError
from dem_bridge.judging.conformance.faults import Family, Fault, Values
from dem_bridge.judging.conformance.feature_faults import candidates
from dem_bridge.judging.conformance.limit import QUANTITIES, Limit, Samples, limit_of
from dem_bridge.judging.conformance.scenes import Probe
from dem_bridge.judging.conformance.truth import Truth
from dem_bridge.judging.model import Model
from dem_bridge.trajectory.trajectory import Floats

#: multiple of the uncertainty of a limit that is no fault yet
ALLOWED_UNCERTAINTIES = 2.0
#: uncertainty of a limit, relative to the largest value, above which nothing is decided
LARGEST_UNCERTAINTY = 0.05
#: part of the difference that a fault may leave: with more it does not explain it
LARGEST_LEFT_SHARE = 0.02
#: steps of a fit of one number, and the relative change at which it ends
_MOST_FIT_STEPS, _FIT_CHANGE = 12, 1e-9
#: a fit that leaves more than this part after so many steps does not get near the files
_FEWEST_FIT_STEPS, _LEAST_PROGRESS = 4, 0.5


@dataclass(frozen=True, eq=False)
class Behaviour:
    """What a code does in one scene: its values at each time step, and their limits."""

    probe: Probe
    truth: Truth
    files: tuple[Samples, ...]
    """Values at each time step, from coarse to fine."""
    limits: Mapping[str, Limit]
    scale: Mapping[str, float]
    """Largest magnitude of each quantity, in the reference or in the finest file: the file may have other units."""

    @property
    def uncertainty(self) -> float:
        """Largest uncertainty of the limits and of the reference, relative to the largest values."""
        own = (self.truth.uncertainty[name] / self.scale[name] for name in self.limits)
        return max(limit.uncertainty for limit in self.limits.values()) + max(own)

    @property
    def allowed(self) -> float:
        """Difference from the reference, relative to the largest values, that the time steps explain."""
        return ALLOWED_UNCERTAINTIES * self.uncertainty

    def difference(self, values: Values) -> float:
        """Return the largest difference of the limits from values of a motion, relative to the largest values."""
        return float(np.max(np.abs(self.residual(values))))

    def residual(self, values: Values) -> Floats:
        """Return all differences of the limits from values of a motion, relative to the largest values."""
        parts = []
        for name, limit in self.limits.items():
            rows = values[name][-len(limit.values) :]
            parts.append(((limit.values - rows) / self.scale[name]).ravel())
        return np.nan_to_num(np.concatenate(parts), nan=1e3, posinf=1e3, neginf=-1e3)


def behaviour_of(probe: Probe, truth: Truth, files: Sequence[Samples]) -> Behaviour:
    """Return what the files of a code, from coarse to fine, say of one scene."""
    names = [name for name in QUANTITIES if all(name in file.values for file in files)]
    limits, scale = {}, {}
    for name in names:
        rows = min(len(file.values[name]) for file in files)
        values = [file.values[name][-rows:] for file in files]
        scale[name] = max(truth.scale[name], float(np.max(np.abs(values[-1]))))
        digits = max(file.digits[name] for file in files)
        limits[name] = limit_of(values, digits, scale[name], smooth=probe.smooth)
    return Behaviour(probe, truth, tuple(files), limits, scale)


@dataclass(frozen=True)
class Explanation:
    """How the limit of a code differs from the reference of one scene, and why."""

    difference: float
    """Largest difference from the reference with the faults that are known already, relative to the largest values."""
    allowed: float
    """Difference that the time steps explain."""
    fault: Fault | None = None
    """Further fault that explains the difference; None if there is none or if it is not known."""
    left: float = math.nan
    """Difference that the fault leaves."""

    @property
    def right(self) -> bool:
        """True if nothing but faults that are known already is wrong."""
        return self.difference <= self.allowed


@dataclass(frozen=True)
class Failure:
    """A fault that a scene shows."""

    scene: str
    item: str
    """Item that it fails: the one of the fault, or the question of the scene if simpler scenes are right."""
    fault: Fault

    @property
    def is_of_body(self) -> bool:
        """True if the fault is one of a body or contact."""
        return not self.fault.everywhere


class Motions:
    """Motions of one scene with faults, at its samples."""

    def __init__(self, behaviour: Behaviour, known: Iterable[Fault]) -> None:
        self.behaviour, self.known = behaviour, tuple(fault for fault in known if fault.everywhere)
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

    def fitted(self, family: Family) -> tuple[Fault, float]:
        """Return the fault of a family that leaves the least, and what it leaves."""
        best = family.make(family.starts[0])
        least = math.inf
        for start in family.starts:
            number, left = self.fit(family, start)
            if left < least:
                best, least = family.make(number), left
        return best, least

    def fit(self, family: Family, number: float) -> tuple[float, float]:
        """Return the number of a family by Gauss-Newton from a start, and the difference that it leaves."""
        best, least, first = number, math.inf, math.inf
        for step in range(_MOST_FIT_STEPS):
            change = 1e-6 * max(abs(number), 1e-3)
            try:
                here = self.behaviour.residual(self.values([family.make(number)]))
                there = self.behaviour.residual(self.values([family.make(number + change)]))
            except (DemBridgeError, ArithmeticError):
                break
            left = float(np.max(np.abs(here)))
            if left < least:
                best, least = number, left
            first = min(first, left) if step == 0 else first
            if step == _FEWEST_FIT_STEPS and least > _LEAST_PROGRESS * first:
                break
            slope = (there - here) / change
            size = float(slope @ slope)
            if size == 0.0:
                break
            move = -float(slope @ here) / size
            bound = 0.5 * max(abs(number), 1e-2)
            move = min(max(move, -bound), bound)
            number += move
            if abs(move) < _FIT_CHANGE * max(abs(number), 1e-6):
                break
        return best, least


def explain(behaviour: Behaviour, known: Sequence[Fault], *, first: bool = True, search: bool = True) -> Explanation:
    """Compare the limit of a code with the reference, and look for the fault that explains a difference.

    ``known`` faults were found in other scenes: they are part of the reference, unless the scene is better without
    them, because a fault of one law is none of another. ``first``: False if a simpler scene is right, so that units and
    the like are. ``search``: False if only the difference is of interest.
    """
    tried = [motions for faults in (known, ()) if (motions := Motions(behaviour, faults)).known or not faults]
    differences = [motions.difference() for motions in tried]
    difference = min(differences)
    motions = tried[differences.index(difference)]
    found = Explanation(difference, behaviour.allowed)
    if found.right or not search:
        return found
    enough = max(behaviour.allowed, LARGEST_LEFT_SHARE * difference)
    best, least = None, math.inf
    for candidate in candidates(behaviour.probe, first=first):
        fault, left = (
            motions.fitted(candidate) if isinstance(candidate, Family) else (candidate, motions.difference(candidate))
        )
        # an earlier one is simpler: a later one is better only if it leaves much less
        if left <= enough and left < 0.3 * least:
            best, least = fault, left
        if least <= behaviour.allowed:
            break
    return found if best is None else replace(found, fault=best, left=least)


def fitted_exponent(behaviour: Behaviour, known: Sequence[Fault]) -> float:
    """Return the exponent n of the contact force overlap^(n-1) that fits the limit of a code best."""

    def with_exponent(n: float) -> Fault:
        return Fault("exponent", "exponent", "", lambda scene: replace(scene, exponent=n))

    return Motions(behaviour, known).fit(Family(with_exponent, ()), 2.49)[0]
