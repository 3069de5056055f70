"""The likely cause of the difference between a file and its scene: hypotheses are fitted, compared and named."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from dem_bridge.errors import DemBridgeError
from dem_bridge.formats.readers.record import Record
from dem_bridge.foundation.wording import share
from dem_bridge.judging import kernels
from dem_bridge.judging.diagnosis import (
    ERROR_OF_UNKNOWN_METHOD,
    LARGEST_SHARE_AT_REST,
    LEAST_EFFECT_FLOORS,
    PRIORITY,
    RIGHT,
    Diagnosis,
    Fault,
    alternative,
    as_good,
    claim,
    explained,
    leaves,
    name_cause,
    priority,
    sentence,
)
from dem_bridge.judging.fitting import TOLERANCE_OF_DECISION, Fit, Stepping
from dem_bridge.judging.hypotheses import Hypothesis, Variant
from dem_bridge.judging.pairs import after_faults, at_once, name_pair
from dem_bridge.judging.samples import WORDS, sample_hypotheses
from dem_bridge.judging.search import LEAST_ERROR_OF_OTHER_SCENE, Search
from dem_bridge.judging.stated import Statement, changed, statements, variant_of
from dem_bridge.judging.step import step_error
from dem_bridge.judging.without_fits import FEWEST_OTHER_MASSES, on_single_grid, other_masses, shipped_scene
from dem_bridge.scene.scene import Scene

#: difference relative to the scale that no cause makes: units differ by at most 1e9
LEAST_UNSTABLE_DIFFERENCE = 1e12
#: files that are examined
MOST_FILES = 3
#: processor time, s, after which no further fit is begun for one file
MOST_SECONDS_OF_SEARCH = 60.0
#: causes whose effect grows with the time step
BY_STEP = ("half-step-velocity", "first-order-integrator", "time-shift", "sampling-shift")
#: noise of single precision: what the nearest hypothesis leaves at least, and the largest error relative to the scale
LEAST_SHARE_OF_SINGLE_NOISE, LARGEST_SINGLE_NOISE = 0.3, 5.0
#: ... and the error up to which such noise need not stand out from the error of the time step
LARGEST_USUAL_NOISE = 1e-3
#: error relative to the scale up to which a file is of another scene whatever fits may say
LARGEST_ERROR_WITHOUT_FITS = 1e-3


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


def _diagnose_file(scene: Scene, record: Record, floor: Mapping[str, float], until: float | None = None) -> Diagnosis:
    """Return the diagnosis of one file; ``until`` is the processor time, s, at which the search ends."""
    search = Search(scene, record, floor)
    none = search.decision.decide(search.none, np.zeros(0))
    search.data.until = time.process_time() + MOST_SECONDS_OF_SEARCH if until is None else until
    if explained(none):
        return Diagnosis(
            cause="none",
            evidence=RIGHT,
            step=step_error(search.decision, none),
        )
    size = float(np.max(search.errors))
    if none.stepping is not None and none.error < min(ERROR_OF_UNKNOWN_METHOD, size / LEAST_EFFECT_FLOORS):
        # no fault that is left would be 50 floors, of which the error of the step is one
        return Diagnosis(
            cause="none",
            evidence=f"The time step explains the difference but for {share(none.error)} of the largest value.",
            step=step_error(search.decision, none),
        )
    if size > LEAST_UNSTABLE_DIFFERENCE:
        sentence = f"Values grow to {size:.2g} of the largest value of the scene, as those of an unstable step do."
        return Diagnosis(cause="unknown", evidence=sentence)
    stated = statements(scene, record)
    diagnosis = (
        by_statements(search, none, stated)
        or _of_other_masses(search)
        or _of_shipped_scene(search, size, certain=True)
        or _beside(_by_fits(search, none, stated), stated)
    )
    if diagnosis.cause == "unknown" and not stated and (by_step := _of_unknown_method(search, none)) is not None:
        return by_step
    if diagnosis.cause == "unknown":
        diagnosis = (
            _of_shipped_scene(search, size)
            or _beside_statements(search, stated, floor)
            or (_foreign(search, diagnosis) if search.foreign else name_pair(search, none))
            or _of_other_masses(search, reordered=True)
            or diagnosis
        )
    if diagnosis.cause == "unknown" and search.data.over:
        ended = f" The search ended after {MOST_SECONDS_OF_SEARCH:g} s of processor time, its limit."
        diagnosis = replace(diagnosis, evidence=f"{diagnosis.evidence}{ended}")
    return replace(diagnosis, evidence=_all_zero(search) + diagnosis.evidence)


def _of_unknown_method(search: Search, none: Fit) -> Diagnosis | None:
    """Return the diagnosis of a file that errs no more than a method of second order at its step; else None."""
    decision, dt = search.decision, search.data.dt
    if dt is None or not decision.within_step(none) or decision.error_at_rest() > LARGEST_SHARE_AT_REST * none.error:
        return None
    size = float(np.max(search.errors))
    words = f"The difference is {share(size)} of the largest value, as methods of second order err at this step."
    by_verlet = replace(none, stepping=Stepping(kernels.VERLET, dt))
    return Diagnosis(cause="none", evidence=words, step=step_error(decision, by_verlet))


def _of_other_masses(search: Search, *, reordered: bool = False) -> Diagnosis | None:
    """Return the diagnosis of a file whose momentum is conserved with other masses of several bodies; else None.

    Masses that may be those of the scene in another order, but for one or two, count only if they are ``reordered``.
    """
    masses = other_masses(search.scene, search.data)
    if masses is None or len(masses.differing) < FEWEST_OTHER_MASSES:
        return None
    if masses.out_of_order == 0 or (masses.out_of_order < FEWEST_OTHER_MASSES) != reordered:
        return None
    evidence = (
        f"Momentum is conserved if the masses are {masses.words()} times those of the scene, relative to the median"
        f" ({len(masses.differing)} of {search.scene.n_body} differ). Is it this scene?"
    )
    return Diagnosis(cause="wrong-scene", evidence=evidence)


def _of_shipped_scene(search: Search, size: float, *, certain: bool = False) -> Diagnosis | None:
    """Return the diagnosis of a file that is of another shipped scene; else None.

    ``certain``: only if no other hypothesis can explain a file of that scene, so that none needs a fit.
    """
    if certain and (size < LEAST_ERROR_OF_OTHER_SCENE or search.missing_bodies or on_single_grid(search.data)):
        return None
    shipped = shipped_scene(search.scene, search.data, size)
    if shipped is None or (certain and not (shipped.error < LARGEST_ERROR_WITHOUT_FITS and shipped.differs_widely)):
        return None
    evidence = f"The file is of the scene {shipped.name}, from which it differs by {share(shipped.error)}"
    return Diagnosis(cause="wrong-scene", evidence=f"{evidence} of the largest value.")


def _foreign(search: Search, diagnosis: Diagnosis) -> Diagnosis:
    """Return the diagnosis of a file that looks like one of another scene."""
    n = search.scene.n_body
    some = f" The file has {n - search.missing_bodies} of its {n} bodies." if search.missing_bodies else ""
    words = f"Is it this scene, {search.scene.name}?{some} No single fault explains the difference where it begins."
    return replace(diagnosis, evidence=words, headline=words)


def _by_fits(search: Search, none: Fit, stated: Sequence[Statement]) -> Diagnosis:
    """Return the diagnosis by fits of all hypotheses."""
    fits = search.fits()
    diagnosis = name_cause(
        search, none, fits, certain=any({"velocity", "start"} & set(item.changes) for item in stated)
    )
    if (
        diagnosis.cause != "unknown"
        or (fits and fits[0].rms < LEAST_SHARE_OF_SINGLE_NOISE * none.rms)
        or not on_single_grid(search.data)
    ):
        return diagnosis
    if none.error > LARGEST_SINGLE_NOISE or (
        none.error > LARGEST_USUAL_NOISE and search.decision.effect_of_noise(none) < LEAST_EFFECT_FLOORS
    ):
        return diagnosis
    sentence = f"The samples are numbers of single precision, and differ by {share(none.error)} of the largest value."
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
    if not (explained(together) or together.error < none.error / LEAST_EFFECT_FLOORS):
        return None
    # where one of them is no scene by itself, its effect is that of all
    effects = {statement: search.effect(variant_of(search.scene, [statement]) or variant) for statement in stated}
    first = max(stated, key=lambda statement: effects[statement])
    effect, step = effects[first], step_error(decision, together)
    words = _and(f"{statement.words} (effect {share(effects[statement])})" for statement in stated)
    left = leaves(together, none, "With it")
    if effect < max(ERROR_OF_UNKNOWN_METHOD, 0.0 if step is None else step.error / LEAST_EFFECT_FLOORS):
        return Diagnosis(
            cause="none", evidence=f"Time step and digits explain the difference, although {words}.", step=step
        )
    if not first.cause:
        return Diagnosis(cause="unknown", evidence=f"A cause outside the list is stated: {words}. {left}")
    others = [] if search.record.stated else _equal_samples(search, together)
    evidence = f"{words[:1].upper()}{words[1:]}. {left}"
    claims = [(first.cause, evidence, first.where)] + [
        (fit.hypothesis.cause, sentence(fit, none), "") for fit in others
    ]
    claims.sort(key=lambda item: PRIORITY.index(item[0]))
    cause, evidence, where = claims[0]
    texts = {fit.hypothesis.cause: claim(fit) for fit in others} | {first.cause: first.words}
    names = tuple(dict.fromkeys(name for name, _, _ in claims if name != cause))
    return Diagnosis(
        cause=cause,
        alternatives=names,
        where=where,
        evidence=evidence,
        sentences=tuple(alternative(texts[name], name) for name in names),
        step=step,
    )


def _beside_statements(search: Search, stated: Sequence[Statement], floor: Mapping[str, float]) -> Diagnosis | None:
    """Return the diagnosis of a file that differs from the scene which it states by a further fault; else None."""
    changes = {name: value for statement in stated for name, value in statement.changes.items()}
    if not stated or not stated[0].cause or "start" in changes:
        return None
    try:
        scene = changed(search.scene, changes)
    except DemBridgeError:
        return None
    rest = _diagnose_file(scene, replace(search.record, stated={}), floor, search.data.until)
    if rest.cause in ("none", "unknown", "wrong-scene"):
        return None
    first = stated[0]
    words = _and(statement.words for statement in stated)
    fault = Fault(first.cause, first.where, f"{words[:1].upper()}{words[1:]}.")
    others = rest.faults or (Fault(rest.cause, rest.where, rest.evidence),)
    return replace(
        rest,
        cause=first.cause,
        where=first.where,
        evidence=f"{at_once(fault.sentence, 1 + len(others))} {after_faults(rest.evidence)}",
        faults=(fault, *others),
    )


def _certain(variant: Variant, cause: str) -> Hypothesis:
    """Return the hypothesis of a variant without parameters."""
    return Hypothesis(cause, lambda p: variant, "What is stated.")


def _equal_samples(search: Search, best: Fit) -> list[Fit]:
    """Return the fits of other units, signs and orders that explain a file as well as what it states, by priority."""
    data, rows = search.data, search.rows
    count = sum(block.values.size for block in data.blocks)
    near = []
    for hypothesis in sample_hypotheses(data, search.exact):
        if not hypothesis.size:
            residual = data.residual(
                data.predict(hypothesis.make(np.zeros(0)), rows, TOLERANCE_OF_DECISION, best.stepping)
            )
            if float(np.sqrt(np.mean(residual**2))) < 3.0 * max(best.rms, 1.0):
                near.append(search.decision.decide(hypothesis, np.zeros(0), best))
    return sorted((fit for fit in near if as_good(fit, best, count)), key=priority)


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


def _all_zero(search: Search) -> str:
    """Return a sentence on quantities of a file that are 0 throughout, although the bodies move; else ''."""
    names = [
        WORDS[block.quantity]
        for block, value in zip(search.data.blocks, search.exact, strict=True)
        if not np.any(block.values) and np.any(np.nan_to_num(value))
    ]
    return f"All {_and(names)} of the file are 0. " if names else ""
