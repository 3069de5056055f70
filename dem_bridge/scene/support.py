"""Support of a code: a declaration of the scenes that it can solve, from which the reasons for all others follow.

>>> from dem_bridge.scene.features import GAPS
>>> import dem_bridge as db
>>> support = Support({GAPS})
>>> pair = db.Scene(name="pair", duration=1e-4, mass=(1e-2, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), drag=1.0)
>>> support.unsupported_reason(pair)
'the scene has drag; supported: gaps'
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Set
from dataclasses import dataclass

from dem_bridge.scene.derived import derived
from dem_bridge.scene.features import FEATURES, OTHER_EXPONENTS, Feature
from dem_bridge.scene.scene import Scene


@dataclass(frozen=True)
class Exponents:
    """Allowed exponents n of contacts: the ``values``, or where there are none all from ``least`` to ``most``.

    >>> 2.4 in Exponents(values=(2.0, 2.5)), 2.4 in Exponents(least=2.0, most=5.0)
    (False, True)
    """

    values: tuple[float, ...] = ()
    least: float = 1.0
    most: float = math.inf

    def __contains__(self, exponent: float) -> bool:
        return exponent in self.values if self.values else self.least <= exponent <= self.most

    def __str__(self) -> str:
        if self.values:
            return listed(f"{n:g}" for n in self.values)
        return "any" if self == ANY else f"{self.least:g} to {self.most:g}"


#: no restriction: a scene itself requires n > 1
ANY = Exponents()
HERTZ = Exponents(values=(2.5,))


@dataclass(frozen=True)
class Condition:
    """A requirement that features cannot express.

    ``sentence`` states it; ``violation`` returns what a scene has that violates it, or None.
    """

    sentence: str
    violation: Callable[[Scene], str | None]


@dataclass(frozen=True)
class Support:
    """The scenes that a code can solve.

    Parameters
    ----------
    features : set of Feature
        What a scene may have; whatever is not listed is refused.
    exponents : Exponents
        Allowed exponents n of contacts, where ``features`` has OTHER_EXPONENTS; otherwise only 5/2 is allowed.
    conditions : tuple of Condition
        Further requirements.
    scope : str
        A clause that explains the limits; it is part of the reason why a scene is not supported.
    instead : str
        The backend to recommend first for other scenes.
    """

    features: Set[Feature]
    exponents: Exponents = ANY
    conditions: tuple[Condition, ...] = ()
    scope: str = ""
    instead: str = "scipy"

    def __post_init__(self) -> None:
        object.__setattr__(self, "features", frozenset(self.features))
        if OTHER_EXPONENTS not in self.features:
            object.__setattr__(self, "exponents", HERTZ)

    def covers(self, scene: Scene) -> bool:
        """Return True if the scene has supported features only."""
        return self.unsupported_reason(scene) is None

    @derived
    def unsupported_reason(self, scene: Scene) -> str | None:
        """Return the reason why the scene is not supported, in one line; None if it is supported."""
        problems, allowed = [], []
        # exponents are named with their contact below
        missing = scene.features - self.features - {OTHER_EXPONENTS}
        if missing:
            problems.append(f"the scene has {labels(missing)}")
            allowed.append(f"supported: {labels(self.features) or 'no features beyond a struck chain of contacts'}")
        exponents = scene.contacts.exponent.tolist() if OTHER_EXPONENTS in scene.features else []
        wrong = [k for k, n in enumerate(exponents) if n not in self.exponents]
        if wrong:
            problems.append(f"contact {wrong[0]} has exponent n = {exponents[wrong[0]]!r}")
            allowed.append(f"allowed exponents: {self.exponents}")
        for condition in self.conditions:
            if violation := condition.violation(scene):
                problems.append(violation)
                allowed.append(f"required: {condition.sentence}")
        if not problems:
            return None
        return "; ".join([*problems, *([self.scope] if self.scope else []), *allowed])


def labels(features: Iterable[Feature]) -> str:
    """Return the labels of features as one phrase, in the order of the declarations."""
    chosen = {*features}
    return listed(feature.label for feature in FEATURES if feature in chosen)


def listed(words: Iterable[str]) -> str:
    """Return words as an enumeration.

    >>> listed(["walls", "gaps", "drag"])
    'walls, gaps and drag'
    """
    *first, last = ["", *words]
    return f"{', '.join(first[1:])} and {last}" if len(first) > 1 else last
