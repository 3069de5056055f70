"""Search among hypotheses: linear ranking where a difference begins, and fits in growing windows."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.foundation.compiled import side_by_side
from dem_bridge.judging.chain_hypotheses import common_factor, global_hypotheses
from dem_bridge.judging.decision import Decision
from dem_bridge.judging.fitting import TOLERANCE_OF_DECISION, TOLERANCE_OF_SEARCH, Data, Fit, Fitter, least
from dem_bridge.judging.hypotheses import LOG_STARTS, WALLS, Changes, Hypothesis, Variant
from dem_bridge.judging.model import model_of
from dem_bridge.judging.samples import half_steps, sample_hypotheses
from dem_bridge.scene.scene import Scene

Floats = NDArray[np.float64]

#: difference relative to the scale of a quantity up to which it counts as linear in its cause
LARGEST_LINEAR_DIFFERENCE = 0.1
#: masses and stiffnesses of single bodies and contacts that are fitted after the linear ranking
MOST_PLACES_FITTED = 4
#: hypotheses that are fitted in the first window, and by all samples
MOST_FITTED_IN_WINDOW, MOST_FITTED_BY_ALL = 24, 6
#: ... and of one cause and family
MOST_FITTED_OF_CAUSE = 4
#: part of the samples in the first window
FEWEST_SAMPLES_OF_WINDOW = 40
#: part of the scene's own residual that a hypothesis may leave to be fitted further
LARGEST_RESIDUAL_SHARE = 0.6
#: part that the best hypothesis leaves of the first window, as ranked and as fitted, so that no other ranking is needed
LARGEST_SHARE_OF_PROMISING, LARGEST_SHARE_OF_CERTAIN = 0.3, 0.01
#: relative difference of parameters up to which two fits of one hypothesis are one
SAME_AFTER_FIT = 1e-3
#: part that every hypothesis leaves of another scene's motion where it begins, and the least size of the difference
LEAST_SHARE_OF_OTHER_SCENE, LEAST_ERROR_OF_OTHER_SCENE = 0.6, 0.3


@dataclass(frozen=True, eq=False)
class Candidate:
    """A hypothesis with parameters and the residual that it leaves, relative to that of the scene."""

    hypothesis: Hypothesis
    parameters: Floats
    left: float


class Search:
    """The search for the cause of the difference between one file and its scene."""

    foreign = False
    """True once the file looks like one of another scene, on which no further search is spent."""

    def __init__(self, scene: Scene, record: Any, floor: Mapping[str, float]) -> None:
        self.scene, self.model, self.record = scene, model_of(scene), record
        self.data = Data(record, self.model, floor)
        self.decision = Decision(self.data)
        self.base, self.exact, self.errors = self.decision.base, self.decision.exact, self.decision.errors
        self.none = Hypothesis("none", lambda p: self.base, "The scene itself.")
        self.rows = len(self.data.time)

    @property
    def size(self) -> float:
        """Largest difference relative to the scale of its quantity."""
        return float(np.max(self.errors))

    @cached_property
    def missing_bodies(self) -> int:
        """Number of bodies of the scene that no column of the file is of."""
        counts = [len(block.columns) for block in self.data.blocks if block.quantity < 2]
        return self.scene.n_body - max(counts, default=self.scene.n_body)

    @cached_property
    def fitter(self) -> Fitter:
        """Fits to the file, which no right file needs."""
        size = float(np.max(self.errors))
        # the model errs by up to ten thousand tolerances of its steps, where bodies collide often
        tolerance = TOLERANCE_OF_SEARCH if size > 1e-2 else TOLERANCE_OF_DECISION if size < 1e-4 else 1e-11
        return Fitter(self.data, self.decision.time_step_error(), tolerance)

    def effect(self, variant: Variant) -> float:
        """Return the largest change by a variant relative to the scale of a quantity."""
        changes = self.data.largest(self.data.predict(variant, self.rows, TOLERANCE_OF_DECISION), self.exact)
        return max(change / block.scale for change, block in zip(changes, self.data.blocks, strict=True))

    # ------------------------------------------------------------------ ranking
    def windows(self) -> list[int]:
        """Return numbers of samples: until the difference is no longer linear in its cause, and twice as many each."""
        over = np.flatnonzero(self.errors > LARGEST_LINEAR_DIFFERENCE)
        # time-step errors are below a fiftieth of an effect that can be named
        first = int(np.flatnonzero(self.errors >= min(1e-2, 0.05 * float(np.max(self.errors))))[0])
        linear = int(over[0]) + 1 - first if len(over) else self.rows
        length, windows = max(min(linear, self.rows // FEWEST_SAMPLES_OF_WINDOW), 8), []
        while first + length < self.rows:
            windows.append(first + length)
            length *= 2
        return [*windows, self.rows]

    def rank(self, hypotheses: Iterable[Hypothesis], rows: int) -> list[Candidate]:
        """Return the hypotheses with first parameters, those that leave least first."""
        extra = 1e-3 * float(np.max(self.errors[:rows]))
        start = self.fitter.residual(self.base, rows, extra)
        size = math.sqrt(float(np.sum(start**2)))
        # methods of other codes have a time-step error of their own
        whole = self.data.residual([value[:rows] for value in self.exact], extra)
        large = float(np.max(self.errors[:rows])) > LARGEST_LINEAR_DIFFERENCE

        def first(hypothesis: Hypothesis) -> Candidate:
            best = Candidate(hypothesis, np.array(hypothesis.starts[0]), math.inf)
            starts = [p for p in hypothesis.starts if not p or any(p)]  # the scene itself
            trials = [np.clip(np.array(p), *hypothesis.bounds) for p in starts if large or not p]
            if hypothesis.size and hypothesis.probe is not None:
                probes = [hypothesis.make(probe) for probe in hypothesis.probe * np.eye(hypothesis.size)]
                origin = start if probes[0].method is None else whole
                changes = np.stack([self.fitter.residual(probe, rows, extra) - origin for probe in probes], axis=1)
                if np.any(changes):
                    factors = least(changes, -origin)
                    left = math.sqrt(float(np.sum((origin + changes @ factors) ** 2))) / size
                    guess = hypothesis.probe * factors
                    if hypothesis.logarithmic:
                        factor = float(factors[0])
                        guess = np.array([hypothesis.probe + (math.log(factor) if factor > 0.0 else -3.0)])
                        left = left if factor > 0.0 else 1.0
                    limit = hypothesis.reach
                    best = Candidate(hypothesis, np.clip(np.clip(guess, *hypothesis.bounds), -limit, limit), left)
                    if large:
                        trials.append(best.parameters)
                        best = Candidate(hypothesis, best.parameters, math.sqrt(left))
            for trial in trials:
                left = math.sqrt(float(np.sum(self.fitter.residual(hypothesis.make(trial), rows, extra) ** 2))) / size
                if left < best.left:
                    best = Candidate(hypothesis, trial, left)
            return best

        def quietly(hypothesis: Hypothesis) -> Candidate:
            with np.errstate(all="ignore"):  # which each thread has for itself
                return first(hypothesis)

        return sorted(side_by_side(quietly, hypotheses), key=lambda candidate: candidate.left)

    def places(self, rows: int) -> list[Hypothesis]:
        """Return the masses and stiffnesses of single bodies and contacts that resemble the difference most."""
        change, scene = Changes(self.scene, self.model), self.scene
        masses = [
            Hypothesis(
                "mass", change.one_mass(i), f"The mass of body {i} is {{0:.6g}} +- {{1:.2g}} of the scene's.",
                starts=LOG_STARTS, where=f"body {i}", value=math.exp,
            )
            for i in range(scene.n_body)
        ]  # fmt: skip
        stiffnesses = [
            Hypothesis(
                "stiffness", change.one_stiffness(place),
                f"The stiffness of {name} is {{0:.6g}} +- {{1:.2g}} of the scene's.",
                starts=LOG_STARTS, where=name, value=math.exp, bounds=(-12.0, 12.0),
            )
            for place, name in change.named_places()
        ]  # fmt: skip
        exponents = [
            Hypothesis(
                "exponent", change.one_exponent(place),
                f"The exponent n of {name} differs from the scene's by {{0:.6g}} +- {{1:.2g}}.",
                starts=((0.0,), (0.25,), (-0.25,)), where=name, bounds=(-1.4, 3.0),
            )
            for place, name in change.named_places()
            if scene.n_contact > 1
        ]  # fmt: skip
        missed = [
            Hypothesis(
                "missed-contact", _missed(change, place),
                f"{f'The contact with {name}' if name in WALLS else name.capitalize()} never acts.", where=name,
            )
            for place, name in change.named_places()
        ]  # fmt: skip
        kinds = (masses, stiffnesses, exponents, missed, self._positions(change))
        return [candidate.hypothesis for kind in kinds for candidate in self.rank(kind, rows)[:MOST_PLACES_FITTED]]

    def _positions(self, change: Changes) -> list[Hypothesis]:
        """Return other gaps of single contacts, and other places of single bodies between two contacts."""
        unit, n = max(self.model.depth, 1e-12), self.scene.n_body
        starts = ((0.0,), (0.3,), (-0.3,), (1.0,), (-1.0,))
        gaps = [
            Hypothesis(
                "start-position", change.one_gap(place, unit),
                f"The gap of {name} is {{0:.6g}} +- {{1:.2g}} m larger than in the scene.",
                starts=starts, where=name, value=lambda p: p * unit,
            )
            for place, name in change.named_places()
        ]  # fmt: skip
        between = [i for i in range(n) if {i, i + 1} <= {int(place) for place in change.places()}]
        bodies = [
            Hypothesis(
                "start-position", change.one_position(i, unit),
                f"Body {i} starts {{0:.6g}} +- {{1:.2g}} m further on than in the scene.",
                starts=starts, where=f"body {i}", value=lambda p: p * unit,
            )
            for i in between
        ]  # fmt: skip
        return [*gaps, *bodies]

    def everywhere(self) -> list[Hypothesis]:
        """Return the hypotheses that do not concern a single place."""
        everywhere = [*sample_hypotheses(self.data, self.exact), *half_steps(self.data, self.decision.step)]
        if any(block.quantity == 2 for block in self.data.blocks):
            everywhere.append(common_factor(self.scene, self.model))
        return [*everywhere, *global_hypotheses(self.scene, self.model)]

    # ------------------------------------------------------------------ fits
    def finalists(self) -> list[Candidate]:
        """Return the hypotheses that leave least of the difference, fitted by all samples."""
        kept = self._fitted(self.windows())
        self.foreign = self.foreign or (not kept and self.size > LEAST_ERROR_OF_OTHER_SCENE and self.missing_bodies > 0)
        kept = kept or ([] if self.foreign else self._fitted([self.rows]))
        # a factor on all masses is nearly the inverse factor on all stiffnesses: neither is examined without the other
        factors = {
            candidate.hypothesis.cause: candidate for candidate in kept if candidate.hypothesis.family == "factor"
        }
        if len(factors) == 1:
            factor = next(iter(factors.values()))
            for hypothesis in global_hypotheses(self.scene, self.model):
                if hypothesis.family == "factor" and hypothesis.cause != factor.hypothesis.cause:
                    kept.insert(kept.index(factor) + 1, Candidate(hypothesis, -factor.parameters, factor.left))
        return kept

    def _fitted(self, windows: list[int]) -> list[Candidate]:
        """Return the hypotheses that leave least in each of the windows.

        Where a difference begins it is linear in its cause, and a little later causes differ more. The second ranking
        is left out where a hypothesis of the first one explains the samples of all windows, unless the step of the file
        is to be found: that is looked for from the parameters of both.
        """
        everywhere = self.everywhere()
        ranked, kept = self._ranked(everywhere, [], windows[0])
        promising = bool(ranked) and ranked[0].left < LARGEST_SHARE_OF_PROMISING
        if len(windows) > 1 and promising and self.data.dt is not None:
            best = self._best_in_window(kept, windows[0])
            if best and best[0].left < LARGEST_SHARE_OF_CERTAIN and (best := self._best_in_windows(best, windows[1:])):
                return best
        if (rows := windows[min(2, len(windows) - 1)]) != windows[0]:
            ranked, kept = self._ranked(everywhere, kept, rows)
        # the last ranking is of samples in which the causes differ: where none helps, two of them hardly do
        if (
            len(windows) > 1
            and self.size > LEAST_ERROR_OF_OTHER_SCENE
            and min((c.left for c in ranked), default=1.0) > LEAST_SHARE_OF_OTHER_SCENE
        ):
            self.foreign = True
            return []
        return self._best_in_windows(kept, windows)

    def _ranked(
        self, everywhere: list[Hypothesis], kept: list[Candidate], rows: int
    ) -> tuple[list[Candidate], list[Candidate]]:
        """Return the ranking of all hypotheses, and the candidates ``kept`` with those that are to be fitted, too."""
        ranked, kept = self.rank([*everywhere, *self.places(rows)], rows), list(kept)
        for candidate in (candidate for candidate in ranked if candidate.left < 0.97):
            same = [other for other in kept if _kind(other.hypothesis) == _kind(candidate.hypothesis)]
            again = any(_alike(other, candidate) for other in same)
            if len(same) < MOST_FITTED_OF_CAUSE and len(kept) < MOST_FITTED_IN_WINDOW and not again:
                kept.append(candidate)
        return ranked, kept

    def _best_in_windows(self, candidates: list[Candidate], windows: list[int]) -> list[Candidate]:
        """Return the candidates that leave least in each of the windows."""
        for rows in windows:
            if self.data.over:
                break
            candidates = self._best_in_window(candidates, rows)
        return candidates

    def _best_in_window(self, candidates: list[Candidate], rows: int) -> list[Candidate]:
        """Return the candidates that leave least of the first samples after a fit, each once if the step is known.

        Where the step is to be found, it is looked for from each of them.
        """
        extra = 1e-3 * float(np.max(self.errors[:rows]))
        start = float(np.sqrt(np.mean(self.fitter.residual(self.base, rows, extra) ** 2)))

        def fitted(candidate: Candidate) -> Candidate:
            with np.errstate(all="ignore"):  # which each thread has for itself
                p, rms = self.fitter.fit(candidate.hypothesis, candidate.parameters, rows, extra)
            return Candidate(candidate.hypothesis, p, rms / start)

        best, least = list[Candidate](), math.inf
        for candidate in sorted(side_by_side(fitted, candidates), key=lambda candidate: candidate.left):
            least = min(least, candidate.left)
            good = candidate.left < LARGEST_RESIDUAL_SHARE and candidate.left < max(30.0 * least, 0.1)
            again = self.data.dt is not None and any(_alike(other, candidate, SAME_AFTER_FIT) for other in best)
            if good and not again:
                best.append(candidate)
        return best

    def fits(self) -> list[Fit]:
        """Return the last fits of the finalists, those that leave least first."""
        fits = list[Fit]()
        for candidate in self.finalists()[:MOST_FITTED_BY_ALL]:
            if fits and self.data.over:
                break
            best = min(fits, key=lambda fit: fit.rms, default=None)
            fits.append(self.decision.decide(candidate.hypothesis, candidate.parameters, best))
        return sorted(fits, key=lambda fit: fit.rms)


def _kind(hypothesis: Hypothesis) -> tuple[str, str]:
    """Return what hypotheses share of which a few are fitted: the shapes of damping differ, factors and places do."""
    return hypothesis.cause, hypothesis.family


def _alike(first: Candidate, second: Candidate, tolerance: float = 0.3) -> bool:
    """Return whether two candidates are one hypothesis with nearly one start."""
    left, right = first.hypothesis, second.hypothesis
    same = (left.cause, left.where, left.evidence) == (right.cause, right.where, right.evidence)
    return same and bool(np.allclose(first.parameters, second.parameters, rtol=tolerance, atol=1e-12))


def _missed(change: Changes, place: int) -> Callable[[Floats], Variant]:
    """Return the change to a contact that never acts, neither by its stiffness nor by its damping."""
    acts = np.arange(change.scene.n_body + 1) != place
    system = change.with_factors(stiffness=1.0 * acts)
    return lambda p: Variant(system.changed(damping=system.damping * acts))
