"""The likely cause of the difference between a file and its scene: hypotheses are fitted, compared and named."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dem_bridge.judging.fitting import Fit
from dem_bridge.judging.search import FINALISTS, Candidate, Search
from dem_bridge.readers.record import Record
from dem_bridge.scene import Scene

Floats = NDArray[np.float64]

#: all causes that a diagnosis can name
CAUSES = (
    "none",
    "unknown",
    "half-step-velocity",
    "first-order-integrator",
    "exponent",
    "missing-sqrt-radius",
    "modulus",
    "mass",
    "stiffness",
    "stiffness-scale",
    "damping",
    "clip",
    "time-shift",
    "time-scale",
    "units",
    "order-of-bodies",
    "gravity",
    "tension",
    "missed-contact",
    "single-precision",
    "sampling-shift",
)


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """The likely cause of the difference between files and their scene.

    Parameters
    ----------
    cause : str
        One of :data:`CAUSES`. "none": the time step and the digits of the files explain the difference; "unknown": no
        hypothesis explains it, or it is below 50 floors.
    alternatives : tuple of str
        Causes that the data cannot tell from ``cause``.
    where : str
        Body or contact of the cause, "body 3" or "contact 7"; empty if it concerns the whole chain.
    evidence : str
        One sentence with the fitted value and the residuals.
    parameters : mapping
        Fitted parameters of the cause, each with its standard deviation.
    """

    cause: str
    evidence: str
    alternatives: tuple[str, ...] = ()
    where: str = ""
    parameters: Mapping[str, tuple[float, float]] = field(default_factory=dict)


#: least effect, in floors, for which a cause is named
FLOORS = 50.0
#: rms and largest residual, in units of the noise, at which the digits of a file explain the difference
EXPLAINED, LARGEST = 1.5, 12.0
#: error relative to the scale that a code of unknown method may have
SMALL = 1e-6
#: which of several causes that fit equally well is named
PRIORITY = (
    *("none", "units", "order-of-bodies", "sampling-shift", "half-step-velocity", "first-order-integrator", "clip"),
    *("missed-contact", "tension", "gravity", "missing-sqrt-radius", "modulus", "stiffness-scale", "stiffness"),
    *("mass", "exponent", "damping", "time-shift", "time-scale"),
)


def diagnose(scene: Scene, records: Sequence[Record], floor: Mapping[str, float] | None = None) -> Diagnosis:
    """Return the likely cause of the difference between the ``records`` and the exact motion of their ``scene``.

    ``floor`` is the round-off floor of each quantity in its unit, in addition to the digits of the files.
    """
    if scene.law is not None:
        return Diagnosis(cause="unknown", evidence="Hypotheses are not available for contact laws that are functions.")
    record = min(records, key=lambda record: math.inf if record.dt is None else record.dt)
    search = Search(scene, record, floor or {})
    none = search.decide(Candidate(search.none, np.zeros(0), 1.0))
    if _explained(none):
        return Diagnosis(cause="none", evidence="Time step and digits explain the difference.")
    fits = sorted((search.decide(candidate) for candidate in search.finalists()[:FINALISTS]), key=lambda fit: fit.rms)
    return name_cause(search, none, fits)


def _explained(fit: Fit) -> bool:
    """Return whether the digits of the file explain the residual."""
    return fit.rms < EXPLAINED and fit.largest < LARGEST


def name_cause(search: Search, none: Fit, fits: list[Fit]) -> Diagnosis:
    """Return the diagnosis for fits that are sorted by what they leave."""
    best = fits[0] if fits else none
    small = none.error < SMALL
    left = best.rms / none.rms
    explained = bool(fits) and (_explained(best) or left < 1e-3 or (left < 1.0 / FLOORS and best.error < SMALL))
    if not explained:
        if small:
            return Diagnosis(cause="none", evidence=f"The difference is {none.error:.2g} of the largest value.")
        return Diagnosis(
            cause="unknown",
            evidence=f"No hypothesis explains the difference; the nearest ({best.hypothesis.cause}"
            f" {best.hypothesis.where}) leaves {best.rms / none.rms:.2g} of it.",
        )
    effect = search.effect(best)
    if effect < FLOORS:
        return Diagnosis(cause="unknown", evidence=f"The difference is {effect:.3g} floors, below {FLOORS:g}.")
    count = sum(block.values.size for block in search.data.blocks)
    equal = [fit for fit in fits if _as_good(fit, best, count)]
    equal.sort(key=lambda fit: PRIORITY.index(fit.hypothesis.cause) if fit.hypothesis.nameable else 99)
    named = [fit for fit in equal if fit.hypothesis.nameable]
    if not named or (best.hypothesis not in [fit.hypothesis for fit in named] and not _explained(named[0])):
        return Diagnosis(cause="unknown", evidence="A cause outside the list fits best.")
    first = named[0]
    places = {fit.hypothesis.where for fit in named if fit.hypothesis.cause == first.hypothesis.cause}
    where = first.hypothesis.where if len(places) == 1 else ""
    alternatives = tuple(dict.fromkeys(fit.hypothesis.cause for fit in named[1:]))
    return Diagnosis(
        cause=first.hypothesis.cause,
        alternatives=tuple(name for name in alternatives if name != first.hypothesis.cause),
        where=where,
        evidence=_sentence(first, none),
        parameters=_parameters(first),
    )


def _as_good(fit: Fit, best: Fit, count: int) -> bool:
    """Return whether the samples cannot tell a fit from the best one."""
    if not _explained(best):
        return fit.rms < 1.5 * best.rms
    return _explained(fit) and count * (fit.rms**2 - best.rms**2) < 60.0 * max(best.rms, 1.0) ** 2


def _sentence(fit: Fit, none: Fit) -> str:
    hypothesis = fit.hypothesis
    values = [number for pair in _parameters(fit).values() for number in pair]
    left = f"It leaves {fit.error:.2g} of the largest value, where the scene leaves {none.error:.2g}."
    return f"{hypothesis.evidence.format(*values)} {left}"


def _parameters(fit: Fit) -> dict[str, tuple[float, float]]:
    """Return the fitted value with its standard deviation."""
    if fit.hypothesis.size == 0:
        return {}
    value, p, deviation = fit.hypothesis.value, float(fit.parameters[0]), float(fit.deviation[0])
    return {"value": (value(p), abs(value(p + deviation) - value(p)))}
