"""The likely cause of the difference between a file and its scene: hypotheses are fitted, compared and named."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from dem_bridge.formats.readers.record import Record
from dem_bridge.judging.fitting import DECISION, Fit
from dem_bridge.judging.hypotheses import Hypothesis, Variant, equal_radii, uniform_name
from dem_bridge.judging.samples import WORDS, sample_hypotheses
from dem_bridge.judging.search import Search
from dem_bridge.judging.single import on_single_grid
from dem_bridge.judging.stated import Statement, statements, variant_of
from dem_bridge.judging.step import StepError, step_error
from dem_bridge.scene.scene import Scene

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
    "start-velocity",
    "start-position",
    "sign",
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
    step : StepError, optional
        Error of the time step of the code, if step and method are known.
    """

    cause: str
    evidence: str
    alternatives: tuple[str, ...] = ()
    where: str = ""
    parameters: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    step: StepError | None = None


#: least effect, in floors, for which a cause is named
FLOORS = 50.0
#: rms and largest residual, in units of the noise, at which the digits of a file explain the difference
EXPLAINED, LARGEST = 1.5, 12.0
#: ... and the largest residual in floors, if it is larger in units of the noise
LARGEST_FLOORS = 3.0
#: error relative to the scale that a code of unknown method may have
SMALL = 1e-6
#: part of the difference that a cause may leave to a code of unknown method, and the largest error that is left
LITTLE, LITTLE_ERROR = 1e-3, 2e-5
#: its usual error: so many times the error of an adaptive method at a tolerance of 1e-11, because the
#: tolerances of a code, absolute ones among them, are unknown
ADAPTIVE = 100.0
#: part of the difference that a right code may show where nothing has moved
AT_REST = 0.1
#: difference relative to the scale that no cause makes: units differ by at most 1e9
UNSTABLE = 1e12
#: change of an exponent that no code makes
UNCHANGED = 1e-6
#: files that are examined
MOST_FILES = 3
#: causes whose effect grows with the time step
BY_STEP = ("half-step-velocity", "first-order-integrator", "time-shift", "sampling-shift")
#: noise of single precision: what the nearest hypothesis leaves at least, and the largest error relative to the scale
NOISY, LARGEST_NOISE = 0.3, 5.0
#: which of several causes that fit equally well is named; where nothing collides, it is a missed contact
PRIORITY = (
    *("none", "missed-contact", "units", "order-of-bodies", "sign", "sampling-shift", "half-step-velocity"),
    *("first-order-integrator", "clip", "tension", "gravity", "missing-sqrt-radius", "modulus", "stiffness-scale"),
    *("stiffness", "mass", "exponent", "damping", "start-velocity", "start-position", "time-shift", "time-scale"),
)


def diagnose(scene: Scene, records: Sequence[Record], floor: Mapping[str, float] | None = None) -> Diagnosis:
    """Return the likely cause of the difference between the ``records`` and the exact motion of their ``scene``.

    ``floor`` is the round-off floor of each quantity in its unit, in addition to the digits of the files. The file of
    the smallest time step decides. Where it shows no cause, the others are examined for causes that grow with the step.
    """
    if scene.law is not None:
        return Diagnosis(cause="unknown", evidence="Hypotheses are not available for contact laws that are functions.")
    with np.errstate(all="ignore"):  # a hypothesis may have no motion
        return _diagnose_files(scene, records, floor or {})


def _diagnose_files(scene: Scene, records: Sequence[Record], floor: Mapping[str, float]) -> Diagnosis:
    """Return the diagnosis of all files together."""
    ordered = sorted(records, key=lambda record: math.inf if record.dt is None else record.dt)
    first = _diagnose_file(scene, ordered[0], floor)
    if first.cause in ("none", "unknown"):
        for record in ordered[1:MOST_FILES]:
            other = _diagnose_file(scene, record, floor)
            if other.cause in BY_STEP or (first.cause == other.cause == "unknown"):
                return other
    return first


def _diagnose_file(scene: Scene, record: Record, floor: Mapping[str, float]) -> Diagnosis:
    """Return the diagnosis of one file."""
    search = Search(scene, record, floor)
    none = search.decision.decide(search.none, np.zeros(0))
    if _explained(none) or _nearly_explained(none):
        return Diagnosis(
            cause="none",
            evidence="Time step and digits explain the difference.",
            step=step_error(search.decision, none),
        )
    size = float(np.max(search.errors))
    if none.stepping is not None and none.error < min(SMALL, size / FLOORS):
        # no fault that is left would be 50 floors, of which the error of the step is one
        return Diagnosis(
            cause="none",
            evidence=f"The time step explains the difference but for {none.error:.2g} of the largest value.",
            step=step_error(search.decision, none),
        )
    if size > UNSTABLE:
        sentence = f"Values grow to {size:.2g} of the largest value of the scene, as those of an unstable step do."
        return Diagnosis(cause="unknown", evidence=sentence)
    stated = statements(scene, record)
    diagnosis = by_statements(search, none, stated) or _beside(_by_fits(search, none, stated), stated)
    return replace(diagnosis, evidence=_all_zero(search) + diagnosis.evidence)


def _by_fits(search: Search, none: Fit, stated: Sequence[Statement]) -> Diagnosis:
    """Return the diagnosis by fits of all hypotheses."""
    fits = search.fits()
    diagnosis = name_cause(
        search, none, fits, certain=any({"velocity", "start"} & set(item.changes) for item in stated)
    )
    if diagnosis.cause != "unknown" or (fits and fits[0].rms < NOISY * none.rms) or not on_single_grid(search.data):
        return diagnosis
    if none.error > LARGEST_NOISE or search.decision.effect_of_noise(none) < FLOORS:
        return diagnosis
    sentence = f"The samples are numbers of single precision, and differ by {none.error:.2g} of the largest value."
    return Diagnosis(cause="single-precision", evidence=sentence)


def by_statements(search: Search, none: Fit, stated: Sequence[Statement]) -> Diagnosis | None:
    """Return the diagnosis by what a deck or a first sample states, if that explains the file; else None.

    Such a difference is certain, so that it is named at any size that is felt beside the time step. Other units, signs
    and orders of bodies, which change a first sample, too, are examined beside it.
    """
    variant = variant_of(search.scene, stated) if stated else None
    if variant is None:
        return None
    decision = search.decision
    together = decision.decide(_certain(variant, ""), np.zeros(0), none)
    if not (_explained(together) or _nearly_explained(together) or together.error < none.error / FLOORS):
        return None
    # where one of them is no scene by itself, its effect is that of all
    effects = {statement: _effect(search, variant_of(search.scene, [statement]) or variant) for statement in stated}
    first = max(stated, key=lambda statement: effects[statement])
    effect, step = effects[first], step_error(decision, together)
    words = _and(f"{statement.words} (effect {effects[statement]:.2g})" for statement in stated)
    left = f"With it a run leaves {together.error:.2g} of the largest value, where the scene leaves {none.error:.2g}."
    if effect < max(SMALL, 0.0 if step is None else step.error / FLOORS):
        return Diagnosis(
            cause="none", evidence=f"Time step and digits explain the difference, although {words}.", step=step
        )
    if not first.cause:
        return Diagnosis(cause="unknown", evidence=f"A cause outside the list is stated: {words}. {left}")
    others = [] if search.record.stated else _equal_samples(search, together)
    causes = sorted(dict.fromkeys((first.cause, *(fit.hypothesis.cause for fit in others))), key=PRIORITY.index)
    if causes[0] != first.cause:
        return Diagnosis(cause=causes[0], alternatives=tuple(causes[1:]), evidence=_sentence(others[0], none))
    evidence = f"{words[:1].upper()}{words[1:]}. {left}"
    return Diagnosis(cause=first.cause, alternatives=tuple(causes[1:]), where=first.where, evidence=evidence)


def _certain(variant: Variant, cause: str) -> Hypothesis:
    """Return the hypothesis of a variant without parameters."""
    return Hypothesis(cause, lambda p: variant, "What is stated.")


def _effect(search: Search, variant: Variant) -> float:
    """Return the largest change by a variant relative to the scale of a quantity."""
    data, decision = search.data, search.decision
    changes = data.largest(data.predict(variant, decision.rows, DECISION), decision.exact)
    return max(change / block.scale for change, block in zip(changes, data.blocks, strict=True))


def _equal_samples(search: Search, best: Fit) -> list[Fit]:
    """Return the fits of other units, signs and orders that explain a file as well as what it states, by priority."""
    data, rows = search.data, search.rows
    count = sum(block.values.size for block in data.blocks)
    near = []
    for hypothesis in sample_hypotheses(data, search.exact):
        if not hypothesis.size:
            residual = data.residual(data.predict(hypothesis.make(np.zeros(0)), rows, DECISION, best.stepping))
            if float(np.sqrt(np.mean(residual**2))) < 3.0 * max(best.rms, 1.0):
                near.append(search.decision.decide(hypothesis, np.zeros(0), best))
    return sorted((fit for fit in near if _as_good(fit, best, count)), key=_priority)


def _beside(diagnosis: Diagnosis, stated: Sequence[Statement]) -> Diagnosis:
    """Return the diagnosis by fits with what is stated: it decides between causes that no trajectory can tell apart."""
    causes = (diagnosis.cause, *diagnosis.alternatives)
    first = next((statement for statement in stated if statement.cause in causes), None)
    if diagnosis.cause == "unknown" and stated:
        words = _and(statement.words for statement in stated)
        return replace(diagnosis, evidence=f"{diagnosis.evidence} Beside it, {words}.")
    if first is None or first.cause == diagnosis.cause:
        return diagnosis
    others = tuple(cause for cause in causes if cause != first.cause)
    evidence = f"{diagnosis.evidence} But {first.words}."
    return replace(diagnosis, cause=first.cause, alternatives=others, where=first.where, evidence=evidence)


def _and(parts: Iterable[str]) -> str:
    """Return parts of a sentence in a row."""
    return " and ".join(parts)


def _priority(fit: Fit) -> int:
    """Return the place of the cause of a fit among those that fit equally well."""
    return PRIORITY.index(fit.hypothesis.cause) if fit.hypothesis.nameable else len(PRIORITY)


def _all_zero(search: Search) -> str:
    """Return a sentence on quantities of a file that are 0 throughout, although the bodies move; else ''."""
    names = [
        WORDS[block.quantity]
        for block, value in zip(search.data.blocks, search.exact, strict=True)
        if not np.any(block.values) and np.any(np.nan_to_num(value))
    ]
    return f"All {_and(names)} of the file are 0. " if names else ""


def _is_itself(fit: Fit) -> bool:
    """Return whether a fit is no other hypothesis with one parameter more, which is 0."""
    least = fit.hypothesis.least
    return least == 0.0 or abs(float(fit.parameters[0])) > max(least * float(fit.deviation[0]), UNCHANGED)


def _explained(fit: Fit) -> bool:
    """Return whether the digits of the file explain the residual."""
    return fit.rms < EXPLAINED and fit.largest < LARGEST


def _nearly_explained(fit: Fit) -> bool:
    """Return whether the digits of the file explain the residual but for a few small values.

    Small values have more decimals than large ones, so that the error of a code without steps shows in them.
    """
    return fit.rms < EXPLAINED and fit.floors < LARGEST_FLOORS


def name_cause(search: Search, none: Fit, fits: list[Fit], *, certain: bool = False) -> Diagnosis:
    """Return the diagnosis for fits that are sorted by what they leave.

    ``certain``: the first sample is not the start of the scene, which no error of the time step explains.
    """
    fits = [fit for fit in fits if _is_itself(fit)]
    best = fits[0] if fits else none
    left = best.rms / none.rms
    usual = min(SMALL, ADAPTIVE * search.decision.adaptive_error())
    loosely = (left < 1.0 / FLOORS and best.error < usual) or (left < LITTLE and best.error < LITTLE_ERROR)
    explained = bool(fits) and (_explained(best) or _nearly_explained(best) or loosely)
    if not explained:
        if search.data.dt is None and none.floors < FLOORS:
            usual = SMALL
        if none.error < usual and search.decision.error_at_rest() < AT_REST * none.error:
            return Diagnosis(cause="none", evidence=f"The difference is {none.error:.2g} of the largest value.")
        return Diagnosis(
            cause="unknown",
            evidence=f"No hypothesis explains the difference; the nearest ({best.hypothesis.cause}"
            f" {best.hypothesis.where}) leaves {best.rms / none.rms:.2g} of it.",
        )
    effect = search.decision.effect(best)
    hidden = effect < FLOORS and not (certain and _explained(best))
    if hidden and none.error < SMALL:
        return Diagnosis(cause="none", evidence=f"The difference is {none.error:.2g} of the largest value.")
    if hidden:
        return Diagnosis(cause="unknown", evidence=f"The difference is {effect:.3g} floors, below {FLOORS:g}.")
    count = sum(block.values.size for block in search.data.blocks)
    equal = [fit for fit in fits if _as_good(fit, best, count)]
    equal.sort(key=_priority)
    nameable = [fit for fit in equal if fit.hypothesis.nameable]
    if not nameable or (best.hypothesis not in [fit.hypothesis for fit in nameable] and not _explained(nameable[0])):
        return Diagnosis(cause="unknown", evidence="A cause outside the list fits best.")
    first = nameable[0]
    causes = dict.fromkeys(fit.hypothesis.cause for fit in nameable)
    cause = first.hypothesis.cause
    uniform = [
        fit for fit in nameable if fit.hypothesis.family == "factor" and fit.hypothesis.cause == "stiffness-scale"
    ]
    if uniform:
        if cause == "stiffness-scale":
            logarithm, deviation = float(uniform[0].parameters[0]), float(uniform[0].deviation[0])
            cause = uniform_name(search.scene, math.exp(logarithm), max(1e-5, 5.0 * deviation))
        causes |= dict.fromkeys(("modulus", *(["missing-sqrt-radius"] if equal_radii(search.scene) else [])))
    variant = first.hypothesis.make(first.parameters)
    if cause == "missed-contact":
        causes["stiffness"] = None  # which is 0
    if cause == "units" and variant.scale != 1.0 and variant.factors == (1.0, 1.0, 1.0):
        causes["time-scale"] = None  # by a power of ten
    places = {fit.hypothesis.where for fit in nameable if fit.hypothesis.cause == first.hypothesis.cause}
    return Diagnosis(
        cause=cause,
        alternatives=tuple(name for name in causes if name != cause),
        where=first.hypothesis.where if len(places) == 1 else "",
        evidence=_sentence(first, none),
        parameters=_parameters(first),
    )


def _as_good(fit: Fit, best: Fit, count: int) -> bool:
    """Return whether the samples cannot tell a fit from the best one.

    Where a few values are not explained by their digits, the sum of squares is that of these values. Factors on all
    masses and on all stiffnesses give nearly one motion, and what they leave differs by errors of integration.
    """
    if not _explained(best):
        family = fit.hypothesis.family
        return fit.rms < (3.0 if family and family == best.hypothesis.family else 1.5) * best.rms
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
