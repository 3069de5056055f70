"""Name the cause that fits show, with what explains the samples as well."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from dem_bridge.foundation.wording import share
from dem_bridge.judging.chain_hypotheses import lacking_radius, uniform_name
from dem_bridge.judging.fitting import Fit, Stepping
from dem_bridge.judging.hypotheses import Hypothesis
from dem_bridge.judging.search import Search
from dem_bridge.observables.largest_step import StepError
from dem_bridge.trajectory.trajectory import Floats

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
    "wrong-scene",
)


#: which of several causes that fit equally well is named; where nothing collides, it is a missed contact
PRIORITY = (
    *("none", "missed-contact", "units", "order-of-bodies", "sign", "sampling-shift", "half-step-velocity"),
    *("first-order-integrator", "clip", "tension", "gravity", "missing-sqrt-radius", "modulus", "stiffness-scale"),
    *("stiffness", "mass", "exponent", "damping", "start-velocity", "time-shift", "start-position", "time-scale"),
)


@dataclass(frozen=True)
class Fault:
    """One of two faults at once: its cause, its body or contact, and a sentence with the fitted value."""

    cause: str
    where: str
    sentence: str


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
        Body, contact or wall of the cause, "body 3", "contact 7" or "wall_left"; empty if it concerns the whole chain.
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
    faults: tuple[Fault, ...] = ()
    """Both faults, the larger one first, where two at once explain the files."""
    sentences: tuple[str, ...] = ()
    """What explains the files as well, with numbers: "or: all masses are 0.971 +- 2e-9 of the scene's (mass)"."""
    stepping: Stepping | None = None
    """Method and step of the code, where a cause was fitted with them."""
    headline: str = ""
    """What is known of an unknown cause, in a sentence for the first line."""
    needed: str = ""
    """Which files would tell the cause from the alternatives, in a sentence; empty if none would."""


#: least effect, in floors, for which a cause is named, unless it explains the file to its digits
LEAST_EFFECT_FLOORS = 50.0
#: ... where it leaves less than a thousandth of the difference, as at a coarse step
LEAST_EFFECT_OF_ALL = 10.0
#: rms and largest residual, in units of the noise, at which the digits of a file explain the difference
LARGEST_RMS_NOISES, LARGEST_RESIDUAL_NOISES = 1.5, 12.0
#: ... and the largest residual in floors, if it is larger in units of the noise
LARGEST_RESIDUAL_FLOORS = 3.0
#: part of the difference that a fault may leave to be told as a part of the cause
LARGEST_SHARE_OF_PART = 0.5
#: error relative to the scale that a code of unknown method may have
ERROR_OF_UNKNOWN_METHOD = 1e-6
#: part of the difference that a cause may leave to a code of unknown method, and the largest error that is left
LARGEST_SHARE_LEFT, LARGEST_ERROR_LEFT = 1e-3, 2e-5
#: its usual error: so many times the error of an adaptive method at a tolerance of 1e-11, because the
#: tolerances of a code, absolute ones among them, are unknown
ADAPTIVE_ERROR_MULTIPLE = 100.0
#: part of the difference that a fault, or two, may leave to the error of the time step of a method that is not known
LARGEST_SHARE_LEFT_TO_STEP, LARGEST_SHARE_LEFT_TO_STEP_BY_PAIR = 0.2, 0.05
#: what is said of it
WITHIN_STEP = "What is left is as large as errors of methods of second order at this step."
#: part of the difference that a right code may show where nothing has moved
LARGEST_SHARE_AT_REST = 0.1
#: change of an exponent that no code makes
LEAST_CHANGE_OF_EXPONENT = 1e-6
#: evidence of a right file
RIGHT = "Time step and digits explain the difference."
#: which files would tell causes apart that have one motion
FORCES = "Only stiffness over mass is determined: contact forces tell both."
AT_START = "A scene in which bodies are accelerated at the start (gravity, an overlap) tells them apart."


def explained(fit: Fit) -> bool:
    """Return whether the digits of the file explain the residual, but for a few small values.

    Small values have more decimals than large ones, so that the error of a code without steps shows in them.
    """
    return to_digits(fit) or (fit.rms < LARGEST_RMS_NOISES and fit.floors < LARGEST_RESIDUAL_FLOORS)


def to_digits(fit: Fit) -> bool:
    """Return whether the digits of the file explain the residual."""
    return fit.rms < LARGEST_RMS_NOISES and fit.largest < LARGEST_RESIDUAL_NOISES


def as_good(fit: Fit, best: Fit, count: int) -> bool:
    """Return whether the ``count`` values of the samples cannot tell a fit from the best one.

    Where a few values are not explained by their digits, the sum of squares is that of these values. Factors on all
    masses and on all stiffnesses give nearly one motion, and what they leave differs by errors of integration.
    """
    if not to_digits(best):
        family = fit.hypothesis.family
        return fit.rms < (3.0 if family and family == best.hypothesis.family else 1.5) * best.rms
    return to_digits(fit) and count * (fit.rms**2 - best.rms**2) < 60.0 * max(best.rms, 1.0) ** 2


def priority(fit: Fit) -> int:
    """Return the place of the cause of a fit among those that fit equally well."""
    return PRIORITY.index(fit.hypothesis.cause) if fit.hypothesis.nameable else len(PRIORITY)


def _named_first(fit: Fit) -> tuple[int, int]:
    """Return the place of a fit among equal ones: units of any factor after what changes the scene."""
    hypothesis = fit.hypothesis
    return len(PRIORITY) - 1 if hypothesis.cause == "units" and hypothesis.size else priority(fit), hypothesis.size


def value(hypothesis: Hypothesis, p: Floats, deviation: Floats) -> tuple[float, ...]:
    """Return the fitted value of a hypothesis and its standard deviation; () where nothing is fitted."""
    if hypothesis.size == 0:
        return ()
    if hypothesis.numbers is not None:
        return hypothesis.numbers(p, deviation)
    number, first = hypothesis.value, float(p[0])
    return number(first), abs(number(first + float(deviation[0])) - number(first))


def claim(fit: Fit) -> str:
    """Return what a fit claims, with its value."""
    return fit.hypothesis.evidence.format(*value(fit.hypothesis, fit.parameters, fit.deviation))


def sentence(fit: Fit, none: Fit) -> str:
    """Return what a fit claims, and what it leaves beside the scene."""
    return f"{claim(fit)} {leaves(fit, none)}"


def leaves(fit: Fit, none: Fit, subject: str = "With this fault") -> str:
    """Return what a fit leaves of the difference, in a sentence."""
    return (
        f"{subject} in the reference the difference shrinks from {share(none.error)} of the largest value to"
        f" {share(fit.error)}."
    )


def alternative(text: str, cause: str) -> str:
    """Return a sentence on what explains the samples as well.

    >>> alternative("All masses are 1.03 of the scene's.", "mass")
    "or: all masses are 1.03 of the scene's (mass)"
    """
    return f"or: {text[:1].lower()}{text[1:].rstrip('.')} ({cause})"


def name_cause(search: Search, none: Fit, fits: list[Fit], *, certain: bool = False) -> Diagnosis:
    """Return the diagnosis for fits that are sorted by what they leave.

    ``certain``: the first sample is not the start of the scene, which no error of the time step explains.
    """
    fits = [fit for fit in fits if _is_itself(fit)]
    best = fits[0] if fits else none
    if (early := _without_name(search, none, best, bool(fits), certain=certain)) is not None:
        return early
    count = sum(block.values.size for block in search.data.blocks)
    equal = sorted(
        (fit for fit in fits if as_good(fit, best, count) or _is_simpler(search, fit, best, none)), key=_named_first
    )
    missed = {fit.hypothesis.where for fit in equal if fit.hypothesis.cause == "missed-contact"}
    nameable = [
        fit
        for fit in equal
        if fit.hypothesis.nameable
        and not (fit.hypothesis.cause == "start-position" and fit.hypothesis.where in missed)  # a gap that never closes
    ]
    if not nameable or (best.hypothesis not in [fit.hypothesis for fit in nameable] and not to_digits(nameable[0])):
        return Diagnosis(cause="unknown", evidence="A cause outside the list fits best.")
    first, cause = nameable[0], nameable[0].hypothesis.cause
    sentences = [(fit.hypothesis.cause, claim(fit)) for fit in nameable]
    uniform = next((fit for fit in nameable if _is_factor(fit, "stiffness-scale")), None)
    if uniform is not None:
        factor, deviation = math.exp(float(uniform.parameters[0])), float(uniform.deviation[0])
        within = max(1e-5, 5.0 * deviation)
        if cause == "stiffness-scale":
            cause = uniform_name(search.scene, factor, within)
        sentences += _names_of_a_factor(search, factor, within)
    sentences += _other_names(first)
    names = dict.fromkeys(name for name, _ in sentences)
    places = {fit.hypothesis.where for fit in nameable if fit.hypothesis.cause == first.hypothesis.cause}
    numbers = value(first.hypothesis, first.parameters, first.deviation)
    return Diagnosis(
        cause=cause,
        alternatives=tuple(name for name in names if name != cause),
        where=first.hypothesis.where if len(places) == 1 else "",
        evidence=sentence(first, none) if to_digits(first) else rest_of_step(search, first, sentence(first, none)),
        parameters={"value": (numbers[0], numbers[1])} if numbers else {},
        sentences=_alternatives(cause, sentences),
        faults=tuple(Fault(name, "", claim(first)) for name in first.hypothesis.together),
        needed=needed_files(search, {fit.hypothesis for fit in nameable}),
        stepping=stepping_of(first),
    )


def stepping_of(fit: Fit) -> Stepping | None:
    """Return method and step of the code that a fit has found; None without them."""
    variant = fit.hypothesis.make(fit.parameters)
    if variant.method is not None and variant.dt is not None:
        return Stepping(variant.method, variant.dt)
    return fit.stepping


def _without_name(search: Search, none: Fit, best: Fit, found: bool, *, certain: bool) -> Diagnosis | None:
    """Return the diagnosis where no cause is named: nothing explains the difference, or it is too small; else None."""
    left = best.rms / none.rms
    usual = min(ERROR_OF_UNKNOWN_METHOD, ADAPTIVE_ERROR_MULTIPLE * search.decision.adaptive_error())
    loosely = (left < 1.0 / LEAST_EFFECT_FLOORS and best.error < usual) or (
        left < LARGEST_SHARE_LEFT and best.error < LARGEST_ERROR_LEFT
    )
    small = Diagnosis(cause="none", evidence=f"The difference is {share(none.error)} of the largest value.")
    known = found and (explained(best) or loosely)
    by_step = found and not known and left < LARGEST_SHARE_LEFT_TO_STEP and search.decision.within_step(best)
    if not (known or by_step):
        if search.data.dt is None and none.floors < LEAST_EFFECT_FLOORS:
            usual = ERROR_OF_UNKNOWN_METHOD
        if none.error < usual and search.decision.error_at_rest() < LARGEST_SHARE_AT_REST * none.error:
            return small
        if best.hypothesis is none.hypothesis or left > LARGEST_SHARE_OF_PART:
            return Diagnosis(cause="unknown", evidence="No single fault helps.", headline="No single fault helps.")
        words = f"{claim(best)} This explains {100.0 * (1.0 - left):.3g} % of the difference; something else remains."
        return Diagnosis(cause="unknown", evidence=words, headline=words)
    effect = search.decision.effect(best)
    nearly_all = left < LARGEST_SHARE_LEFT and effect >= LEAST_EFFECT_OF_ALL and none.error >= ERROR_OF_UNKNOWN_METHOD
    if (
        effect >= LEAST_EFFECT_FLOORS
        or by_step
        or nearly_all
        or (
            to_digits(best)
            and (certain or (left < 1.0 / LEAST_EFFECT_FLOORS and none.error >= ERROR_OF_UNKNOWN_METHOD))
        )
    ):
        return None
    if none.error < ERROR_OF_UNKNOWN_METHOD:
        return small
    words = (
        f"The difference is {effect:.3g} times what step and digits of the file make, and no cause is named below"
        f" {LEAST_EFFECT_FLOORS:g} times. {claim(best)} This would explain it."
    )
    return Diagnosis(cause="unknown", evidence=words, headline=words)


def rest_of_step(search: Search, fit: Fit, evidence: str) -> str:
    """Return the evidence for a fault with a sentence on what is left, if that is an error of the time step."""
    return f"{evidence} {WITHIN_STEP}" if search.decision.within_step(fit) else evidence


def _is_itself(fit: Fit) -> bool:
    """Return whether a fit is no other hypothesis with one parameter more, which is 0."""
    least = fit.hypothesis.least
    return least == 0.0 or abs(float(fit.parameters[0])) > max(
        least * float(fit.deviation[0]), LEAST_CHANGE_OF_EXPONENT
    )


def _is_simpler(search: Search, fit: Fit, best: Fit, none: Fit) -> bool:
    """Return whether a fit is the best one without a second parameter, which the error of the time step may feign."""
    same = fit.hypothesis.cause == best.hypothesis.cause and fit.hypothesis.size < best.hypothesis.size
    return (
        same
        and not to_digits(best)
        and fit.rms < LARGEST_SHARE_LEFT_TO_STEP * none.rms
        and search.decision.within_step(fit)
    )


def _is_factor(fit: Fit, cause: str) -> bool:
    """Return whether a fit is a factor on all masses, or on all stiffnesses."""
    return fit.hypothesis.family == "factor" and fit.hypothesis.cause == cause


def _names_of_a_factor(search: Search, factor: float, within: float) -> Iterator[tuple[str, str]]:
    """Yield the names that a factor on all stiffnesses may have, with what they claim."""
    yield "modulus", f"The effective modulus is {factor:.6g} of the scene's."
    if (radius := lacking_radius(search.scene, factor, within)) is not None:
        yield "missing-sqrt-radius", f"Stiffnesses lack sqrt(R*), where R* is {radius:.6g} m."


def _other_names(first: Fit) -> Iterator[tuple[str, str]]:
    """Yield other names of a cause that is a limit of another one."""
    hypothesis = first.hypothesis
    variant = hypothesis.make(first.parameters)
    if hypothesis.cause == "missed-contact":
        yield "stiffness", f"The stiffness of {hypothesis.where} is 0."
    if hypothesis.cause == "units" and variant.scale != 1.0 and variant.factors == (1.0, 1.0, 1.0):
        yield "time-scale", f"Times of the file are to be multiplied by {variant.scale:g}."


def _alternatives(cause: str, sentences: Sequence[tuple[str, str]]) -> tuple[str, ...]:
    """Return the sentences on the other causes that explain the samples as well."""
    texts = [alternative(text, name) for place, (name, text) in enumerate(sentences) if place and name != cause]
    return tuple(dict.fromkeys(texts))


def needed_files(search: Search, hypotheses: set[Hypothesis]) -> str:
    """Return which files would tell hypotheses apart that have one motion; empty if none would."""
    causes = {hypothesis.cause for hypothesis in hypotheses}
    factors = {hypothesis.cause for hypothesis in hypotheses if hypothesis.family == "factor"}
    if len(factors) > 1 and not any(block.quantity == 2 for block in search.data.blocks):
        return FORCES
    same_at_rest = {"half-step-velocity", "first-order-integrator"} <= causes
    return AT_START if same_at_rest and np.all(search.base.system.free == 0.0) else ""
