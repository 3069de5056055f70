"""Two faults at once: pairs of hypotheses, ranked where a difference begins and fitted by all samples."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dem_bridge.judging.chain_hypotheses import global_hypotheses
from dem_bridge.judging.decision import RMS_NOISES_AT_END
from dem_bridge.judging.diagnosis import (
    LARGEST_SHARE_LEFT_TO_STEP_BY_PAIR,
    PRIORITY,
    Diagnosis,
    Fault,
    alternative,
    as_good,
    explained,
    leaves,
    needed_files,
    rest_of_step,
    stepping_of,
    value,
)
from dem_bridge.judging.fitting import Fit, least
from dem_bridge.judging.hypotheses import Hypothesis, Variant, merged
from dem_bridge.judging.kernels import System
from dem_bridge.judging.samples import half_steps
from dem_bridge.judging.search import Candidate, Search

Floats = NDArray[np.float64]

#: single faults around which a second one is looked for in a window, pairs that are fitted, and those fitted at last
MOST_FIRST_FAULTS, MOST_PAIRS_FITTED, MOST_PAIRS_FITTED_BY_ALL = 6, 10, 4
#: ... of the same two causes
MOST_PAIRS_OF_CAUSES = 3
#: part of the difference that a pair may leave in a window, and times what the best pair leaves
LARGEST_SHARE_LEFT_BY_PAIR, LARGEST_MULTIPLE_OF_BEST_PAIR = 0.5, 30.0
#: pairs that leave so many times what the best leaves are fitted at last by their simplicity
MULTIPLE_OF_EQUAL_PAIRS = 3.0
#: times what pairs left in the window before, above which a second fault begins in this one; and windows ranked for it
LEAST_MULTIPLE_OF_NEXT_FAULT, MOST_WINDOWS_RANKED_AGAIN = 30.0, 2
#: rms, in units of the noise, of pairs that are examined with other names of one fault where one explains the samples
LARGEST_NEAR_NOISES = 3.0
#: ... both faults one after the other
MOST_NAMES_CHANGED = 2
#: causes that may look like velocities of half a step
CAUSES_LIKE_HALF_STEPS = ("start-position", "time-shift", "half-step-velocity", "first-order-integrator")
#: numbers of faults in words
NUMBERS = {2: "Two", 3: "Three", 4: "Four"}
#: standard deviations by which each parameter of a pair differs from that of the scene
DEVIATIONS_FROM_SCENE = 5.0


@dataclass(frozen=True, eq=False)
class Pair:
    """Two hypotheses, whose parameters stand in a row."""

    first: Hypothesis
    second: Hypothesis
    hypothesis: Hypothesis
    """Both together."""

    def parts(self, fit: Fit) -> tuple[tuple[Hypothesis, Floats, Floats], ...]:
        """Return each hypothesis with its parameters and their standard deviations."""
        size = self.first.size
        return (
            (self.first, fit.parameters[:size], fit.deviation[:size]),
            (self.second, fit.parameters[size:], fit.deviation[size:]),
        )

    def sure(self, fit: Fit) -> bool:
        """Return True if each of the two differs from the scene."""
        return all(not h.size or abs(float(p[0])) > DEVIATIONS_FROM_SCENE * float(d[0]) for h, p, d in self.parts(fit))


#: what a pair leaves of a difference, the pair, and its parameters
_Kept = tuple[float, Pair, Floats]


def fit_pairs(search: Search) -> list[tuple[Pair, Fit]]:
    """Return pairs of hypotheses with their fits by all samples, those that leave least first."""
    fits: list[tuple[Pair, Fit]] = []

    def decide(pairs: Iterable[tuple[Pair, Floats]]) -> None:
        for pair, start in pairs:
            if fits and search.data.over:
                return
            best = min((fit for _, fit in fits), key=lambda fit: fit.rms, default=None)
            fits.append((pair, search.decision.decide(pair.hypothesis, start, best)))

    decide(_finalists(search))
    for _ in range(MOST_NAMES_CHANGED):
        decide(list(_with_other_names(search, _near(search, fits), {_names(pair) for pair, _ in fits})))
    return sorted(((pair, fit) for pair, fit in fits if pair.sure(fit)), key=lambda item: item[1].rms)


def _near(search: Search, fits: list[tuple[Pair, Fit]]) -> Iterator[tuple[Pair, Floats, float | None]]:
    """Yield pairs with parameters and step that explain the samples, or all of them where none does."""
    explains = any(fit.rms < RMS_NOISES_AT_END for _, fit in fits)
    for pair, fit in fits:
        if not explains or fit.rms < LARGEST_NEAR_NOISES:
            found = None if fit.stepping is None else fit.stepping.dt
            yield pair, fit.parameters, search.data.dt or found


def name_pair(search: Search, none: Fit) -> Diagnosis | None:
    """Return the diagnosis of a file that two faults at once explain; None if none do, or if neither is certain.

    The cause is the larger of the faults that all pairs share which explain the samples equally well.
    """
    fits = fit_pairs(search)
    if not fits or not (explained(fits[0][1]) or _within_step(search, fits[0][1], none)):
        return None
    count = sum(block.values.size for block in search.data.blocks)
    equal = sorted(
        (item for item in fits if as_good(item[1], fits[0][1], count)), key=lambda item: _complexity(item[0])
    )
    pair, fit = equal[0]
    shared = set.intersection(*({_name(h) for h in (other.first, other.second)} for other, _ in equal))
    parts = sorted(pair.parts(fit), key=lambda part: -search.effect(part[0].make(part[1])))
    certain = [h for h, _, _ in parts if _name(h) in shared]
    if not certain:
        return None
    faults = tuple(Fault(h.cause, h.where, h.evidence.format(*value(h, p, d))) for h, p, d in parts)
    evidence = f"{at_once(' '.join(fault.sentence for fault in faults), 2)} {leaves(fit, none, 'With both faults')}"
    hypotheses = {h for other, _ in equal for h in (other.first, other.second)}
    others = {h.cause for h in hypotheses} - {fault.cause for fault in faults}
    return Diagnosis(
        cause=certain[0].cause,
        alternatives=tuple(sorted(others, key=PRIORITY.index)),
        where=certain[0].where,
        evidence=evidence if explained(fit) else rest_of_step(search, fit, evidence),
        faults=faults,
        sentences=tuple(_alternative(*item) for item in equal[1:]),
        needed=needed_files(search, hypotheses),
        stepping=stepping_of(fit),
    )


def at_once(sentences: str, count: int) -> str:
    """Return sentences on several faults with their number.

    >>> at_once("Gravity is 0.", 2)
    'Two faults at once: Gravity is 0.'
    """
    return f"{NUMBERS.get(count, str(count))} faults at once: {sentences}"


def after_faults(evidence: str) -> str:
    """Return the evidence for several faults without their number."""
    return evidence.split(" faults at once: ", 1)[-1]


def _within_step(search: Search, fit: Fit, none: Fit) -> bool:
    """Return whether a pair leaves little, and no more than an error of the time step."""
    return fit.rms < LARGEST_SHARE_LEFT_TO_STEP_BY_PAIR * none.rms and search.decision.within_step(fit)


def _name(hypothesis: Hypothesis) -> tuple[str, str]:
    """Return what a hypothesis says of the cause: factors on masses, stiffnesses and times are nearly one.

    So are velocities of half a step and methods of first order.
    """
    if hypothesis.family == "factor" or hypothesis.cause == "time-scale":
        return "factor", ""
    one = hypothesis.cause in ("half-step-velocity", "first-order-integrator")
    return "half-step-velocity" if one else hypothesis.cause, hypothesis.where


def _complexity(pair: Pair) -> tuple[int, int, int]:
    """Return the place of a pair among those that explain the samples as well: few parameters, and no free unit."""
    both = (pair.first, pair.second)
    units = sum(h.cause == "units" and h.size > 0 for h in both)
    return units, sum(h.size for h in both), sum(PRIORITY.index(h.cause) for h in both)


def _alternative(pair: Pair, fit: Fit) -> str:
    """Return a sentence on a pair that explains the samples as well."""
    first, second = (h.evidence.format(*value(h, p, d)).rstrip(".") for h, p, d in pair.parts(fit))
    return alternative(f"{first}, and {second[:1].lower()}{second[1:]}", f"{pair.first.cause} and {pair.second.cause}")


def _finalists(search: Search) -> list[tuple[Pair, Floats]]:
    """Return the pairs that leave least of a difference, from the window in which it begins to all samples."""
    windows, kept, before, again = search.windows(), list[_Kept](), 0.0, 0
    ranked_in = {windows[0], windows[min(2, len(windows) - 1)], windows[len(windows) // 2]}
    for rows in windows:
        if kept and search.data.over:
            break
        earlier = kept
        if rows in ranked_in:
            kept = [*kept, *_chosen(_ranked(search, rows))]
        kept, left = _fitted(search, kept, rows)
        if rows == windows[0]:
            best = [(pair, p, search.data.dt) for _, pair, p in kept[:MOST_PAIRS_FITTED_BY_ALL]]
            others = _with_other_names(search, best, {_names(pair) for _, pair, _ in kept})
            kept, left = _fitted(search, [*kept, *((1.0, pair, p) for pair, p in others)], rows)
        if earlier and left > max(LEAST_MULTIPLE_OF_NEXT_FAULT * before, 1e-3) and again < MOST_WINDOWS_RANKED_AGAIN:
            again += 1
            firsts = _parts(earlier)
            kept += _chosen(_ranked(search, rows, firsts))
            kept, left = _fitted(search, kept, rows)
        before = left
    least_left = min((left for left, _, _ in kept), default=0.0)
    kept.sort(key=lambda item: (item[0] > MULTIPLE_OF_EQUAL_PAIRS * least_left, _complexity(item[1]), item[0]))
    return [(pair, p) for _, pair, p in kept[:MOST_PAIRS_FITTED_BY_ALL]]


def _fitted(search: Search, kept: list[_Kept], rows: int) -> tuple[list[_Kept], float]:
    """Return pairs fitted in a window that leave least of the difference, and what the best leaves; 1 without any."""
    extra = 1e-3 * float(np.max(search.errors[:rows]))
    start = float(np.sqrt(np.mean(search.fitter.residual(search.base, rows, extra) ** 2)))
    fitted: dict[frozenset[tuple[str, str, str]], _Kept] = {}
    for _, pair, p in kept:
        if fitted and search.data.over:
            break
        p, rms = search.fitter.fit(pair.hypothesis, p, rows, extra)
        name = _names(pair)
        if name not in fitted or rms / start < fitted[name][0]:
            fitted[name] = (rms / start, pair, p)
    ordered = sorted(fitted.values(), key=lambda item: item[0])
    left = ordered[0][0] if ordered else 1.0
    limit = min(LARGEST_SHARE_LEFT_BY_PAIR, max(LARGEST_MULTIPLE_OF_BEST_PAIR * left, 0.1))
    return [item for item in ordered if item[0] < limit][:MOST_PAIRS_FITTED], left


def _chosen(ranked: Iterable[_Kept]) -> list[_Kept]:
    """Return the pairs that leave least, a few of the same two causes at most."""
    kept = list[_Kept]()
    for item in sorted(ranked, key=lambda item: item[0]):
        causes = {item[1].first.cause, item[1].second.cause}
        same = sum({pair.first.cause, pair.second.cause} == causes for _, pair, _ in kept)
        if same < MOST_PAIRS_OF_CAUSES and len(kept) < MOST_PAIRS_FITTED:
            kept.append(item)
    return kept


def _parts(kept: list[_Kept]) -> list[Candidate]:
    """Return the faults of the best pairs of a window, which may be the first of two faults in the next one."""
    firsts = list[Candidate]()
    for left, pair, p in kept[:2]:
        for hypothesis, start in ((pair.first, p[: pair.first.size]), (pair.second, p[pair.first.size :])):
            if all(hypothesis is not candidate.hypothesis for candidate in firsts):
                firsts.append(Candidate(hypothesis, start, left))
    return firsts


def _with_other_names(
    search: Search, pairs: Iterable[tuple[Pair, Floats, float | None]], names: set[frozenset[tuple[str, str, str]]]
) -> Iterator[tuple[Pair, Floats]]:
    """Yield pairs, with parameters and the step of the code (s), with another name of one fault of nearly one motion.

    Factors on all masses, stiffnesses and times are such names, delays by half a step, and an exponent alone.
    ``names`` are those of pairs that are known, to which the new ones are added.
    """
    everywhere = list(global_hypotheses(search.scene, search.model))
    factors = [h for h in everywhere if h.family == "factor"]
    exponents = [h for h in everywhere if h.cause == "exponent"]
    for pair, p, dt in pairs:
        size = pair.first.size
        for own, rest, mine, start in (
            (pair.first, pair.second, p[:size], p[size:]),
            (pair.second, pair.first, p[size:], p[:size]),
        ):
            others = [
                (h, factor if h.cause == "stiffness-scale" else -factor)
                for factor in _factor_of(own, mine, search.base.system)
                for h in factors
                if h.cause != own.cause
            ]
            others += [(h, mine[: h.size]) for h in exponents if own.cause == h.cause and h.size < own.size]
            if own.cause in CAUSES_LIKE_HALF_STEPS and dt is not None:
                others += [(h, np.zeros(0)) for h in half_steps(search.data, dt, dt)]
            for other, value_of_other in others:
                name = frozenset((_named(other), _named(rest)))
                if name not in names and (changed := paired(search.base.system, rest, other)) is not None:
                    names.add(name)
                    yield changed, np.concatenate([start, value_of_other])


def _factor_of(hypothesis: Hypothesis, p: Floats, base: System) -> Iterator[Floats]:
    """Yield the logarithm of the factor on all stiffnesses that has nearly the motion of a hypothesis."""
    if hypothesis.family == "factor":
        yield p if hypothesis.cause == "stiffness-scale" else -p
    elif hypothesis.cause == "time-scale":  # times of an impact go as (mass / stiffness)^(1/n)
        yield float(np.median(base.exponent)) * p
    elif hypothesis.cause == "exponent" and hypothesis.size == 2:
        yield p[1:]


def _names(pair: Pair) -> frozenset[tuple[str, str, str]]:
    """Return what tells pairs apart."""
    return frozenset((_named(pair.first), _named(pair.second)))


def _named(hypothesis: Hypothesis) -> tuple[str, str, str]:
    """Return what tells hypotheses apart."""
    return hypothesis.cause, hypothesis.where, hypothesis.evidence


def _ranked(search: Search, rows: int, firsts: Iterable[Candidate] = ()) -> Iterator[_Kept]:
    """Yield pairs with what they leave by a linear step about a first hypothesis that was fitted in this window.

    ``firsts`` are further first hypotheses, those of an earlier window.
    """
    hypotheses = [*search.everywhere(), *search.places(rows)]
    extra = 1e-3 * float(np.max(search.errors[:rows]))
    start = search.fitter.residual(search.base, rows, extra)
    size = float(np.sqrt(np.sum(start**2)))
    for candidate in (*firsts, *_firsts(search.rank(hypotheses, rows))):
        first = candidate.hypothesis
        p, _ = search.fitter.fit(first, candidate.parameters, rows, extra)
        at = search.fitter.residual(first.make(p), rows, extra)
        own = [
            (search.fitter.residual(first.make(p + 1e-3 * unit), rows, extra) - at) / 1e-3
            for unit in np.eye(first.size)
        ]
        if search.data.over:
            return
        for second in hypotheses:
            if second is first or (pair := paired(search.base.system, first, second)) is None:
                continue
            yield from _about(search, pair, p, at, own, rows=rows, extra=extra, size=size)


def _firsts(ranked: list[Candidate]) -> list[Candidate]:
    """Return the first candidates of a ranking, two of one cause at most."""
    kept = list[Candidate]()
    for candidate in ranked:
        same = sum(other.hypothesis.cause == candidate.hypothesis.cause for other in kept)
        if candidate.hypothesis.nameable and same < 2 and len(kept) < MOST_FIRST_FAULTS:
            kept.append(candidate)
    return kept


def _about(
    search: Search, pair: Pair, p: Floats, at: Floats, own: list[Floats], *, rows: int, extra: float, size: float
) -> Iterator[tuple[float, Pair, Floats]]:
    """Yield a pair with what it leaves after a linear step in the parameters of both."""
    second = pair.second
    probe = 1e-3 if second.probe is None else second.probe
    columns, before = list(own), at
    for unit in np.eye(second.size):
        with_probe = pair.hypothesis.make(np.concatenate([p, probe * unit]))
        columns.append((search.fitter.residual(with_probe, rows, extra) - at) / probe)
    if not second.size:
        before = search.fitter.residual(pair.hypothesis.make(p), rows, extra)
    guess = np.concatenate([p, np.zeros(second.size)])
    if columns:
        changes = np.stack(columns, axis=1)
        step = least(changes, -before)
        before = before + changes @ step
        guess = np.clip(guess + step, *pair.hypothesis.bounds)
    left = float(np.sqrt(np.sum(before**2))) / size
    if math.isfinite(left):
        yield left, pair, guess


def paired(base: System, first: Hypothesis, second: Hypothesis) -> Pair | None:
    """Return two hypotheses together; None if they change the same thing, or if the step of a code is to be fitted."""
    if any(h.logarithmic or h.family == "common" for h in (first, second)) or not (first.nameable and second.nameable):
        return None
    if (first.cause, first.where) == (second.cause, second.where):
        return None
    size = first.size
    trial = [h.make(np.array(h.starts[-1])) for h in (first, second)]
    if merged(base, *trial) is None:
        return None

    def make(p: Floats) -> Variant:
        both = merged(base, first.make(p[:size]), second.make(p[size:]))
        assert both is not None
        return both

    low, high = (np.concatenate([np.full(h.size, h.bounds[side]) for h in (first, second)]) for side in (0, 1))
    together = Hypothesis(
        first.cause,
        make,
        f"{first.evidence} {second.evidence}",
        ((*first.starts[0], *second.starts[0]),),
        bounds=(low, high),
        keeps_step=True,
    )
    return Pair(first, second, together)
