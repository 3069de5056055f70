"""The comparison of the limit of a code with the reference of a scene, and the fault that explains the difference."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from dem_bridge.judging.conformance.behaviour import ALLOWED_UNCERTAINTIES, Behaviour
from dem_bridge.judging.conformance.faults import Family, Fault
from dem_bridge.judging.conformance.feature_faults import candidates
from dem_bridge.judging.conformance.motions import Motions

#: part of the difference that a fault may leave: with more it does not explain it
LARGEST_LEFT_SHARE = 0.02
#: part of what another fault leaves that a fault must leave to be the better one: an earlier one is simpler
_BETTER = 0.3


@dataclass(frozen=True)
class Explanation:
    """How the limit of a code differs from the reference of one scene, and why."""

    difference: float
    """Largest difference from the reference with the faults that are known already, relative to the largest values."""
    allowed: float
    """Difference that the time steps explain, and what known faults leave."""
    apart: tuple[str, ...] = ()
    """Items of the known faults that are part of the reference."""
    fault: Fault | None = None
    """Further fault that explains the difference; None if there is none or if it is not known."""
    left: float = math.nan
    """Difference that the fault leaves."""
    alternatives: tuple[Fault, ...] = ()
    """Faults that explain the difference as well: another scene decides between them."""

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
    left: float = 0.0
    """Difference that the fault leaves in the scene, relative to the largest values."""
    alternatives: tuple[Fault, ...] = ()
    """Faults that explain the scene as well, as long as no other scene has decided."""


def explain(
    behaviour: Behaviour, known: Sequence[Failure] = (), *, first: bool = True, search: bool = True
) -> Explanation:
    """Compare the limit of a code with the reference, and look for the fault that explains a difference.

    ``known`` faults were found in other scenes. Each is part of the reference in the form that suits this scene best,
    unless the scene is better without it, because a fault of one law is none of another. ``first``: False if a simpler
    scene is right, so that units and the like are. ``search``: False if only the difference is of interest.
    """
    motions, used = _with_known(behaviour, known)
    allowed = behaviour.allowed + ALLOWED_UNCERTAINTIES * sum(failure.left for failure in used)
    items = tuple(dict.fromkeys(failure.item for failure in used))
    found = Explanation(motions.difference(), allowed, items)
    return found if found.right or not search else _searched(found, motions, first=first)


def _with_known(behaviour: Behaviour, known: Sequence[Failure]) -> tuple[Motions, list[Failure]]:
    """Return the motions with those known faults that are seen in this scene, and these faults."""
    best, used = Motions(behaviour), []
    least = best.difference()
    for failure in known:
        if least <= behaviour.allowed:
            break
        tried = [best.best(form) for form in failure.fault.forms(behaviour.probe)]
        fault, left = min(tried, key=lambda pair: pair[1], default=(failure.fault, math.inf))
        if left < least:
            best, least = Motions(behaviour, (*best.known, fault)), left
            used.append(failure)
    return best, used


def _searched(found: Explanation, motions: Motions, *, first: bool) -> Explanation:
    """Return a comparison with the fault that explains the difference, if there is one.

    In a scene of the simplest kind all faults are tried if one was found that may have other forms in other scenes,
    because another one may explain this scene alike.
    """
    allowed = found.allowed
    enough = max(allowed, LARGEST_LEFT_SHARE * found.difference)
    best, least = None, math.inf
    alike: list[tuple[Fault, float]] = []
    for candidate in candidates(motions.behaviour.probe, first=first):
        fault, left = motions.best(candidate)
        if left > enough:
            continue
        alike.append((fault, left))
        if least > allowed and left < _BETTER * least:
            best, least = fault, left
        if best is not None and least <= allowed and (best.elsewhere is None or not motions.behaviour.probe.basic):
            break
    if best is None:
        return found
    others = tuple(fault for fault, left in alike if fault is not best and _BETTER * left <= max(least, allowed))
    return replace(found, fault=best, left=least, alternatives=others)


def fitted_exponent(behaviour: Behaviour, known: Sequence[Fault]) -> float | None:
    """Return the exponent n of the contact force overlap^(n-1) that fits best; None if the motion does not show it."""

    def with_exponent(n: float) -> Fault:
        return Fault("exponent", "exponent", "", lambda scene: replace(scene, exponent=n))

    (exponent,), left = Motions(behaviour, known).fit(Family(with_exponent, ((2.49,),)), (2.49,))
    return exponent if math.isfinite(left) else None
