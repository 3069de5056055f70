"""The search with residuals that are linear in a parameter: which hypotheses are ranked, fitted and kept, exactly."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dem_bridge.judging import search as module
from dem_bridge.judging.hypotheses import Changes, Hypothesis
from dem_bridge.judging.model import Model
from dem_bridge.judging.search import Candidate, Search
from dem_bridge.scene.scene import Damping, Wall
from dem_bridge.trajectory.trajectory import Floats
from tests.helpers.judged_records import CHAIN

#: residual of the scene and that of the scene without the error of the step
START, WHOLE = np.array([3.0, 4.0]), np.array([0.0, 10.0])
SMALL, LARGE = [0.05, 0.1], [0.01, 0.15]


def hypothesis(
    residual: Callable[[Floats], Any] = lambda p: START,
    *,
    cause: str = "mass",
    method: int | None = None,
    **fields: Any,
) -> Hypothesis:
    """Return a hypothesis whose residual is a function of its parameters."""

    def make(p: Floats) -> Any:
        return SimpleNamespace(method=method, residual=np.array(residual(p), dtype=float), parameters=p)

    return Hypothesis(cause, make, "", **({"starts": ((0.0,),)} | fields))


@pytest.fixture(autouse=True)
def _one_core(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep the order of fits, which are made side by side."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0})


class Fitter:
    """Return the residuals of the variants, and answers for fits by the place of the hypothesis."""

    def __init__(self) -> None:
        self.requests: list[tuple[int, float]] = []
        self.probed: list[list[float]] = []
        self.fits: list[tuple[str, float, int, float]] = []
        self.left: dict[str, float] = {}

    def residual(self, variant: Any, rows: int, extra: float) -> Floats:
        self.requests.append((rows, extra))
        self.probed.append(list(variant.parameters))
        return np.asarray(variant.residual)

    def fit(self, chosen: Hypothesis, start: Floats, rows: int, extra: float) -> tuple[Floats, float]:
        self.fits.append((chosen.where, float(start[0]), rows, extra))
        return start + 1.0, self.left.get(chosen.where, 0.5)


def search_of(errors: Iterable[float], start: Floats = START) -> Any:
    search: Any = Search.__new__(Search)
    search.errors = np.array([*errors])
    search.rows = len(search.errors)
    search.fitter = Fitter()
    search.base = SimpleNamespace(residual=start, parameters=())
    search.exact = [np.zeros((search.rows, 1))]
    search.data = SimpleNamespace(residual=lambda values, extra: WHOLE, over=False, dt=1e-8)
    return search


# ---------------------------------------------------------------- settings and windows
@pytest.mark.parametrize(
    ("size", "tolerance"),
    [(0.015, 1e-9), (0.01, 1e-11), (1.5e-4, 1e-11), (1e-4, 1e-11), (0.9e-4, 1e-13)],
)
def test_small_differences_are_searched_with_small_tolerances(
    monkeypatch: pytest.MonkeyPatch, size: float, tolerance: float
) -> None:
    decision = SimpleNamespace(base=0, exact=0, errors=np.array([0.0, size]), time_step_error=lambda: "step")
    for name, value in (("model_of", 0), ("Data", SimpleNamespace(time=(0.0, 1.0))), ("Decision", decision)):
        monkeypatch.setattr(module, name, lambda *arguments, value=value: value)
    monkeypatch.setattr(module, "Fitter", lambda data, nuisance, accuracy: (nuisance, accuracy))
    assert Search(CHAIN, None, {}).fitter == ("step", tolerance)


def rising(*values: tuple[int, float], rows: int) -> Floats:
    """Return errors that keep each value from its place on."""
    out = np.zeros(rows)
    for place, value in values:
        out[place:] = value
    return out


@pytest.mark.parametrize(
    ("errors", "windows"),
    [
        # from 1 % of the scale on, for a fortieth of the samples
        (rising((9, 0.009), (21, 0.01), (30, 0.1), (36, 0.15), (50, 1.0), rows=400), [31, 41, 61, 101, 181, 341, 400]),
        (rising((21, 0.015), (30, 0.1), (36, 0.15), (50, 1.0), rows=400), [31, 41, 61, 101, 181, 341, 400]),
        # ... or until the difference is a tenth of the scale
        (rising((21, 0.015), (30, 0.1), (36, 0.15), (50, 0.3), rows=800), [37, 53, 85, 149, 277, 533, 800]),
        # from a twentieth of a small difference on
        (rising((9, 0.0039), (21, 0.0041), (30, 0.009), (50, 0.08), rows=400), [31, 41, 61, 101, 181, 341, 400]),
        (rising((9, 0.19), (20, 0.3), (50, 0.2), rows=41), [17, 25, 41]),
        # eight samples at least
        (rising((0, 1.0), rows=64), [8, 16, 32, 64]),
        (rising((0, 1.0), rows=5), [5]),
    ],
)
def test_windows_begin_where_a_difference_is_seen_and_double(errors: Floats, windows: list[int]) -> None:
    assert search_of(errors).windows() == windows


# ---------------------------------------------------------------- ranking
@pytest.mark.parametrize(
    ("chosen", "parameter", "left"),
    [
        # the least squares of (3, 4) along (1, 0) are at -3 and leave 4 of 5
        (hypothesis(lambda p: START + p[0] * np.array([1.0, 0.0]), reach=10.0), -3.0, 0.8),
        (hypothesis(lambda p: START + p[0] * np.array([1.0, 0.0])), -1.5, 0.8),
        (hypothesis(lambda p: START - p[0] * np.array([1.0, 0.0])), 1.5, 0.8),
        (hypothesis(lambda p: START + p[0] * np.array([1.0, 0.0]), bounds=(-0.5, 9.0)), -0.5, 0.8),
        (hypothesis(lambda p: START + p[0] * np.array([1.0, 1.0]), reach=10.0), -3.5, math.sqrt(0.02)),
        (hypothesis(lambda p: START + p[0] * np.array([0.1, 0.0]), reach=50.0, probe=0.5), -30.0, 0.8),
        # what changes nothing leaves all, and is not tried
        (hypothesis(lambda p: START, starts=((0.25,), (0.5,))), 0.25, math.inf),
        # methods of other codes are compared without the error of the step
        (hypothesis(lambda p: WHOLE + p[0] * np.array([1.0, 5.0]), method=1, reach=10.0), -50.0 / 26.0, math.nan),
        # the logarithm of a factor, from the probe on: half of what the probe changes, or at most 5 % of it
        (hypothesis(lambda p: START + np.array([-6.0, 0.0]), logarithmic=True, probe=-2.0, reach=9.0),
         -2.0 - math.log(2.0), 0.8),
        (hypothesis(lambda p: START + np.array([6.0, 0.0]), logarithmic=True, probe=-2.0, reach=9.0), -5.0, 1.0),
        (hypothesis(lambda p: START + np.array([4.0, -3.0]), logarithmic=True, probe=-2.0, reach=9.0), -5.0, 1.0),
        # nothing is fitted
        (hypothesis(lambda p: [0.0, 2.5], starts=((),)), None, 0.5),
    ],
)  # fmt: skip
def test_a_first_parameter_is_that_of_least_squares(chosen: Hypothesis, parameter: float | None, left: float) -> None:
    search = search_of(SMALL)
    (candidate,) = search.rank([chosen], 2)
    assert list(candidate.parameters) == ([] if parameter is None else [pytest.approx(parameter)])
    if math.isnan(left):
        left = float(np.linalg.norm(WHOLE - 50.0 / 26.0 * np.array([1.0, 5.0]))) / 5.0
    assert candidate.left == pytest.approx(left)
    # a thousandth of the largest difference is noise
    assert search.fitter.requests[0] == (2, pytest.approx(1e-4))


def test_no_start_is_tried_for_small_differences() -> None:
    search = search_of(SMALL)
    search.rank([hypothesis(lambda p: START * (1.0 - p[0]), starts=((0.0,), (9.0,)), probe=0.25)], 2)
    assert search.fitter.probed == [[], [0.25]]
    search = search_of(SMALL)
    (candidate,) = search.rank([hypothesis(starts=((0.5,), (0.25,)), probe=None)], 2)
    assert (search.fitter.probed, list(candidate.parameters), candidate.left) == ([[]], [0.5], math.inf)


@pytest.mark.parametrize(
    ("chosen", "parameters", "left"),
    [
        # the best of the starts but for the scene itself, which is at 0
        (hypothesis(lambda p: [abs(p[0]), 0.0], starts=((0.0,), (2.0,), (-1.0,), (1.0,)), probe=None), [-1.0], 0.2),
        (hypothesis(lambda p: [p[0], 0.0], starts=((0.0,), (4.0,)), bounds=(1.0, 2.0), probe=None), [2.0], 0.4),
        (hypothesis(lambda p: [p[0], 0.0], starts=((1.0,),), probe=None), [1.0], 0.2),
        # the guess by least squares counts by what it leaves, or by the square root of what it would leave
        (hypothesis(lambda p: START + p[0] * np.array([1.0, 0.0]), starts=((0.0,), (1.0,)), reach=10.0), [-3.0], 0.8),
        (hypothesis(lambda p: START + p[0] * START if p[0] > -0.5 else 9.0 * START, starts=((0.0,), (1.0,))), [-1.0],
         0.0),
        (hypothesis(lambda p: START + (p[0] * np.array([1.0, 0.0]) if abs(p[0]) < 0.5 else 9.0),
                    starts=((0.0,), (1.0,)), reach=10.0), [-3.0], math.sqrt(0.8)),
    ],
)  # fmt: skip
def test_large_differences_are_compared_at_all_starts(chosen: Hypothesis, parameters: list[float], left: float) -> None:
    (candidate,) = search_of(LARGE).rank([chosen], 2)
    assert list(candidate.parameters) == [pytest.approx(p) for p in parameters]
    assert candidate.left == pytest.approx(left, abs=1e-6)


def test_the_hypothesis_that_leaves_least_is_the_first() -> None:
    parts = [hypothesis(lambda p: [2.0, 0.0], starts=((),), where="2.0")]
    parts += [hypothesis(lambda p: [1.0, 0.0], starts=((),), where="1.0")]
    parts += [hypothesis(lambda p: [3.0, 0.0], starts=((),), where="3.0")]
    ranked = search_of(SMALL).rank(parts, 2)
    assert [candidate.hypothesis.where for candidate in ranked] == ["1.0", "2.0", "3.0"]


# ---------------------------------------------------------------- single places
def test_masses_stiffnesses_and_missed_contacts_are_hypotheses_of_a_place(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = replace(CHAIN, wall_right=Wall(stiffness=4e9), damping=Damping(law="dashpot", coefficient=5.0))
    search = search_of(SMALL)
    search.scene, search.model = scene, Model(scene)
    ranked: list[list[Hypothesis]] = []

    def rank(kind: list[Hypothesis], rows: int) -> list[Candidate]:
        ranked.append(kind)
        assert rows == 17
        return [Candidate(each, np.zeros(1), 0.0) for each in kind[::-1]]

    search.rank = rank
    chosen = search.places(17)
    # gaps of five contacts, and places of four bodies between two of them
    assert [len(kind) for kind in ranked] == [5, 5, 5, 5, 9]
    assert [each.where for each in chosen] == [
        *("body 4", "body 3", "body 2", "body 1"),
        *("wall_right", "contact 3", "contact 2", "contact 1") * 3,
        *("body 4", "body 3", "body 2", "body 1"),
    ]
    base, change = search.model.system, Changes(scene, search.model)
    mass, stiffness, exponent, missed = ranked[0][2], ranked[1][4], ranked[2][1], ranked[3][1]
    assert mass.evidence.format(1.5, 0.25) == "The mass of body 2 is 1.5 +- 0.25 of the scene's."
    assert stiffness.evidence.format(1.5, 0.25) == "The stiffness of wall_right is 1.5 +- 0.25 of the scene's."
    assert missed.evidence == "Contact 1 never acts."
    assert ranked[3][4].evidence == "The contact with wall_right never acts."
    assert exponent.evidence.format(0.5, 0.25) == "The exponent n of contact 1 differs from the scene's by 0.5 +- 0.25."
    bent = exponent.make(np.array([0.5])).system
    np.testing.assert_allclose(bent.exponent - search.model.system.exponent, [0, 0, 0.5, 0, 0, 0])
    np.testing.assert_allclose(bent.stiffness, search.model.system.stiffness)
    assert (mass.cause, stiffness.cause, missed.cause) == ("mass", "stiffness", "missed-contact")
    assert (stiffness.bounds, mass.bounds) == ((-12.0, 12.0), (-math.inf, math.inf))
    assert (mass.value(0.5), stiffness.value(0.5), missed.size) == (math.exp(0.5), math.exp(0.5), 0)
    assert mass.starts == stiffness.starts == ((0.0,), (0.7,), (-0.7,))
    factor = math.exp(0.5)
    np.testing.assert_allclose(mass.make(np.array([0.5])).system.mass / base.mass, [1.0, 1.0, factor, 1.0, 1.0])
    inside = base.stiffness > 0.0
    ratio = stiffness.make(np.array([0.5])).system.stiffness[inside] / base.stiffness[inside]
    np.testing.assert_allclose(ratio, [1.0, 1.0, 1.0, 1.0, factor])
    # neither pushes nor damps
    without = missed.make(np.zeros(0)).system
    np.testing.assert_allclose(without.stiffness, change.base.stiffness * [1, 1, 0, 1, 1, 1])
    np.testing.assert_allclose(without.damping, change.base.damping * [1, 1, 0, 1, 1, 1])
    assert np.count_nonzero(without.damping) == 4


# ---------------------------------------------------------------- fits in growing windows
def candidate(
    where: str, left: float = 0.5, *, cause: str = "", parameter: float = 0.0, evidence: str = ""
) -> Candidate:
    chosen = replace(hypothesis(cause=cause or where, where=where), evidence=evidence)
    return Candidate(chosen, np.array([parameter]), left)


def fitting_of(candidates: dict[int, list[Candidate]], windows: Sequence[int] = (10,), rows: int = 100) -> Any:
    """Return a search with candidates by the number of samples, and a residual of 1 for the scene."""
    search = search_of(np.linspace(0.01, 1.0, rows), start=np.ones(4))
    search.windows, search.scene, search.model = (lambda: [*windows]), None, None
    search.missing_bodies = 0
    search.everywhere = lambda: ["everywhere"]
    search.places = lambda rows: [f"places {rows}"]

    def rank(hypotheses: list[str], rows: int) -> list[Candidate]:
        assert hypotheses == ["everywhere", f"places {rows}"]
        return candidates.get(rows, [])

    search.rank = rank
    return search


def places_of(kept: Iterable[Candidate]) -> list[str]:
    return [each.hypothesis.where for each in kept]


@pytest.mark.parametrize(
    ("windows", "ranked"),
    [([10, 20, 40, 80], (10, 40)), ([10, 20, 40], (10, 40)), ([10, 20], (10, 20)), ([10], (10,))],
)
def test_hypotheses_are_ranked_in_the_first_and_in_the_third_window(
    windows: list[int], ranked: tuple[int, ...]
) -> None:
    # windows without a rank of their own have a candidate, too, which is not examined
    search = fitting_of({rows: [candidate(f"a{rows}")] for rows in (10, 20, 40, 80)}, windows)
    assert places_of(search.finalists()) == [f"a{rows}" for rows in ranked]
    # each window begins from the fit of the one before
    fits = [(where, start, rows) for where, start, rows, _ in search.fitter.fits]
    assert fits == [(f"a{rows}", float(k), window) for k, window in enumerate(windows) for rows in ranked]
    assert [extra for *_, extra in search.fitter.fits] == pytest.approx(
        [1e-3 * search.errors[window - 1] for window in windows for _ in ranked]
    )


def test_candidates_that_leave_all_that_are_many_or_that_are_alike_are_not_fitted() -> None:
    few = [
        *(candidate("a", 0.9), candidate("b", 0.96), candidate("c", 0.97), candidate("d", 1.5)),
        *(candidate(f"e{k}", 0.9, cause="e", parameter=float(k)) for k in range(6)),
    ]
    assert places_of(fitting_of({10: few}).finalists()) == ["a", "b", "e0", "e1", "e2", "e3"]
    assert len(fitting_of({10: [candidate(f"a{k}") for k in range(30)]}).finalists()) == 24


@pytest.mark.parametrize(
    ("first", "second", "alike"),
    [
        (("a", 1.25), ("a", 1.0), True),
        (("a", 1.4), ("a", 1.0), False),
        (("a", 1.0), ("b", 1.0), False),
        (("a", 0.5e-12), ("a", 0.0), True),
        (("a", 1.5e-12), ("a", 0.0), False),
    ],
)
def test_of_candidates_of_one_place_and_nearly_one_start_the_first_is_fitted(
    first: tuple[str, float], second: tuple[str, float], alike: bool
) -> None:
    left, right = (
        candidate(where, cause="mass", parameter=parameter, evidence="Some.") for where, parameter in (first, second)
    )
    search = fitting_of({10: [left, right]})
    search.finalists()
    assert [start for _, start, *_ in search.fitter.fits] == [first[1], *([] if alike else [second[1]])]
    for changes in ({"evidence": "Another."}, {"cause": "stiffness"}):
        other = replace(right, hypothesis=replace(right.hypothesis, **changes))  # type: ignore[arg-type]
        assert len(fitting_of({10: [left, other]}).finalists()) == 2


@pytest.mark.parametrize(
    ("left", "kept"),
    [
        # 60 % of the scene's own residual, or less
        ({"a": 0.05, "b": 0.59, "c": 0.6, "d": 0.7}, ["a", "b"]),
        # at most thirty times what the best one leaves, or a tenth
        ({"a": 0.015625, "b": 0.46, "c": 0.46875, "d": 0.5}, ["a", "b"]),
        ({"a": 0.001, "b": 0.09, "c": 0.1, "d": 0.15}, ["a", "b"]),
        ({"a": 0.7, "b": 0.8, "c": 0.9, "d": 1.0}, []),
    ],
)
def test_fits_that_leave_much_are_dropped(left: dict[str, float], kept: list[str]) -> None:
    search = fitting_of({10: [candidate(name) for name in reversed(left)]})
    search.fitter.left = left
    assert places_of(search.finalists()) == kept
    search.base.residual = np.array([1.0, 7.0])  # root mean square 5
    search.fitter.left = {name: 5.0 * value for name, value in left.items()}
    assert [each.left for each in search.finalists()] == pytest.approx([left[name] for name in kept])
    assert fitting_of({10: []}).finalists() == []


@pytest.mark.parametrize(
    ("ranked", "fitted", "last", "kept"),
    [
        # a cause that explains the first window and all later ones needs no other ranking
        (0.29, 0.009, 0.009, ["a"]),
        # ... but one that does not seem to, does not, or does so only at first
        (0.31, 0.009, 0.009, ["a", "b"]),
        (0.29, 0.011, 0.009, ["a", "b"]),
        (0.29, 0.009, 0.7, ["b"]),
    ],
)
def test_a_cause_that_explains_all_windows_needs_no_second_ranking(
    ranked: float, fitted: float, last: float, kept: list[str]
) -> None:
    search = fitting_of({10: [candidate("a", ranked)], 40: [candidate("b", 0.5)]}, [10, 20, 40])
    search.fitter.left = {"b": 0.02}
    fit = search.fitter.fit

    def by_window(chosen: Hypothesis, start: Floats, rows: int, extra: float) -> tuple[Floats, float]:
        p, left = fit(chosen, start, rows, extra)
        return p, left if chosen.where == "b" else last if rows == 40 else fitted

    search.fitter.fit = by_window
    assert sorted(places_of(search.finalists())) == kept
    search.data.dt = None  # the step is looked for from what both rankings have
    assert "b" in places_of(search.finalists())


def test_of_fits_of_one_hypothesis_that_end_at_nearly_one_parameter_the_best_is_kept() -> None:
    for parameter, dt, kept in ((1.001, 1e-8, ["a"]), (1.003, 1e-8, ["a", "a"]), (1.001, None, ["a", "a"])):
        alike = [candidate("a", cause="mass", parameter=value, evidence="Some.") for value in (0.0, parameter)]
        search = fitting_of({10: alike})
        search.data.dt = dt
        search.fitter.fit = lambda chosen, start, rows, extra: (np.where(start == 0.0, 1.0, start), 0.5)
        assert places_of(search.finalists()) == kept


@pytest.mark.parametrize(
    ("size", "left", "missing", "foreign"),
    [(0.31, 0.61, 0, True), (0.31, 0.59, 0, False), (0.29, 0.61, 0, False), (0.31, 0.61, 1, True)],
)
def test_a_file_that_no_fault_resembles_where_it_begins_is_searched_no_further(
    size: float, left: float, missing: int, foreign: bool
) -> None:
    search = fitting_of({10: [candidate("a", 0.4)], 40: [candidate("b", left)]}, [10, 20, 40])
    search.errors, search.missing_bodies = size * search.errors, missing
    kept = search.finalists()
    assert search.foreign is foreign
    assert (kept == [] and search.fitter.fits == []) is foreign


def test_a_file_of_some_bodies_is_not_fitted_as_a_whole_where_no_window_shows_a_fault() -> None:
    for missing in (0, 3):
        search = fitting_of({10: [candidate("a", 0.97)], 100: [candidate("b")]})
        search.missing_bodies = missing
        assert (places_of(search.finalists()), search.foreign) == (([], True) if missing else (["b"], False))


def test_where_no_window_shows_anything_all_samples_may() -> None:
    search = fitting_of({10: [candidate("a", 0.97)], 100: [candidate("b")]})
    assert places_of(search.finalists()) == ["b"]
    assert {rows for _, _, rows, _ in search.fitter.fits} == {100}
    assert places_of(fitting_of({10: [candidate("a")], 100: [candidate("b")]}).finalists()) == ["a"]


def test_factors_on_masses_and_stiffnesses_are_examined_together(monkeypatch: pytest.MonkeyPatch) -> None:
    scale, mass, other = (
        hypothesis(cause=cause, family=family, where=cause)
        for cause, family in (("stiffness-scale", "factor"), ("mass", "factor"), ("gravity", ""))
    )
    monkeypatch.setattr(module, "global_hypotheses", lambda scene, model: [other, scale, mass])
    first, second, third = candidate("first", parameter=7.0), Candidate(scale, np.array([0.25]), 0.2), candidate("last")
    search = fitting_of({10: [first, second, third]})
    search.fitter.left = {"first": 0.1, "stiffness-scale": 0.2, "mass": 0.2, "last": 0.3}
    kept = search.finalists()
    assert places_of(kept) == ["first", "stiffness-scale", "mass", "last"]
    # a factor on all stiffnesses is the inverse factor on all masses
    assert (kept[1].parameters[0], kept[2].parameters[0], kept[2].left) == (1.25, -1.25, 0.2)
    both = fitting_of({10: [first, second, Candidate(mass, np.array([-0.25]), 0.2)]})
    assert places_of(both.finalists()) == ["first", "stiffness-scale", "mass"]
    assert places_of(fitting_of({10: [first, third]}).finalists()) == ["first", "last"]


def test_six_finalists_are_decided_each_with_the_best_one_before() -> None:
    search, rivals = search_of(SMALL), []
    search.finalists = lambda: [candidate(str(k), parameter=float(k)) for k in range(8)]
    sizes = {"0": 5.0, "1": 3.0, "2": 4.0, "3": 9.0, "4": 1.0, "5": 2.0}

    def decide(chosen: Hypothesis, p: Floats, rival: Any) -> Any:
        rivals.append(None if rival is None else rival.where)
        assert str(int(p[0])) == chosen.where
        return SimpleNamespace(rms=sizes[chosen.where], where=chosen.where)

    search.decision = SimpleNamespace(decide=decide)
    assert [fit.where for fit in search.fits()] == ["4", "5", "1", "2", "0", "3"]
    assert rivals == [None, "0", "1", "1", "1", "4"]
