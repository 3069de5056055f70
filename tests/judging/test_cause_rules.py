"""Which fit is named and how, which file decides, and what single precision is: numbers at each limit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dem_bridge.foundation.wording import share
from dem_bridge.judging import cause
from dem_bridge.judging.diagnosis import Diagnosis, name_cause
from dem_bridge.judging.fitting import Block, Fit
from dem_bridge.judging.hypotheses import Hypothesis, Variant
from dem_bridge.judging.without_fits import on_single_grid
from dem_bridge.trajectory.trajectory import Floats
from tests.helpers.judged_records import CHAIN
from tests.helpers.seams import Seam, plant

SYSTEM: Any = "system"


def fit(
    name: str = "gravity", *, rms: float = 1.0, largest: float = 3.0, error: float = 1e-3, floors: float = 99.0,
    family: str = "", where: str = "", p: float | None = None, deviation: float = 0.0, nameable: bool = True,
    evidence: str = "", **variant: Any,
) -> Fit:  # fmt: skip
    starts = ((),) if p is None else ((0.0,),)
    hypothesis = Hypothesis(
        name, lambda q: Variant(SYSTEM, **variant), evidence, starts, where=where, family=family, nameable=nameable,
        value=lambda q: 2.0 * q,
    )  # fmt: skip
    parameters = np.array([] if p is None else [p])
    return Fit(hypothesis, parameters, rms, largest, error, np.array([deviation]), floors=floors)


def diagnosis_of(
    none: Fit, fits: list[Fit], *, effect: float = 1e3, dt: float | None = 1e-6, rest: float = 1.0,
    adaptive: float = 1e-10, count: int = 100, geometry: Any = None, certain: bool = False, by_step: float = 0.0,
) -> Diagnosis:  # fmt: skip
    decision = SimpleNamespace(
        adaptive_error=lambda: adaptive,
        effect=lambda best: effect,
        error_at_rest=lambda: rest * none.error,
        within_step=lambda best: best.error < by_step,
    )
    blocks = [SimpleNamespace(values=np.zeros((count // 2, 1)), quantity=0)] * 2
    search: Any = SimpleNamespace(
        decision=decision, data=SimpleNamespace(dt=dt, blocks=blocks), scene=SimpleNamespace(geometry=geometry)
    )
    return name_cause(search, none, fits, certain=certain)


NONE = fit("none", rms=1e4, error=1e-2)


def is_alternative(other: Fit, best: Fit, *, count: int = 100) -> bool:
    """Return whether the cause of another fit is named beside that of the best one."""
    return diagnosis_of(NONE, [best, other], count=count).alternatives == ("mass",)


@pytest.mark.parametrize(
    ("rms", "largest", "floors", "explained", "nearly"),
    [
        (1.49, 11.9, 99.0, True, False),
        (1.5, 11.9, 2.9, False, False),
        (2.0, 11.9, 2.9, False, False),
        (1.2, 8.0, 99.0, True, False),
        (3.0, 8.0, 99.0, False, False),
        # a normal distribution has no value of 20 deviations, but for small values, whose digits are finer
        (1.49, 12.0, 2.9, False, True),
        (1.49, 13.0, 3.0, False, False),
        (1.49, 20.0, 4.0, False, False),
        (1.2, 99.0, 2.0, False, True),
        (3.0, 99.0, 2.0, False, False),
    ],
)
def test_digits_explain_residuals_below_these_limits(
    rms: float, largest: float, floors: float, explained: bool, nearly: bool
) -> None:
    chosen = fit(rms=rms, largest=largest, floors=floors)
    # what is explained nearly is named as well, but no effect of few floors, although the first sample is certain
    assert (diagnosis_of(NONE, [chosen]).cause == "gravity") is (explained or nearly)
    assert (diagnosis_of(NONE, [chosen], effect=1.0, certain=True).cause == "gravity") is explained


@pytest.mark.parametrize(
    ("rms", "error", "adaptive", "answer"),
    [
        # less than a thousandth of the difference and 2e-5 of the largest value
        (9.0, 1.9e-5, 1e-12, "gravity"),
        (10.0, 1.9e-5, 1e-12, "unknown"),
        (15.0, 1.9e-5, 1e-12, "unknown"),
        (9.0, 2e-5, 1e-12, "unknown"),
        (9.0, 3e-5, 1e-12, "unknown"),
        # less than a fiftieth, and a hundred times the error of an adaptive method, or 1e-6
        (199.0, 0.9e-8, 1e-10, "gravity"),
        (200.0, 0.9e-8, 1e-10, "unknown"),
        (300.0, 0.9e-8, 1e-10, "unknown"),
        (199.0, 1e-8, 1e-10, "unknown"),
        (199.0, 1.5e-8, 1e-10, "unknown"),
        (199.0, 0.9e-6, 1.0, "gravity"),
        (199.0, 1.5e-6, 1.0, "unknown"),
    ],
)
def test_a_code_of_unknown_method_may_leave_a_little(rms: float, error: float, adaptive: float, answer: str) -> None:
    assert diagnosis_of(NONE, [fit(rms=rms, largest=900.0, error=error)], adaptive=adaptive).cause == answer


@pytest.mark.parametrize(
    ("error", "dt", "floors", "rest", "answer"),
    [
        (0.9e-8, 1e-6, 99.0, 0.0, "none"),
        (1e-8, 1e-6, 99.0, 0.0, "unknown"),
        (1.5e-8, 1e-6, 99.0, 0.0, "unknown"),
        (0.9e-8, 1e-6, 99.0, 0.09, "none"),
        (0.9e-8, 1e-6, 99.0, 0.1, "unknown"),
        (0.9e-8, 1e-6, 99.0, 0.15, "unknown"),
        # a file without a step may err by 1e-6, if that is less than fifty floors
        (0.9e-6, None, 49.0, 0.0, "none"),
        (0.9e-6, None, 50.0, 0.0, "unknown"),
        (0.9e-6, None, 75.0, 0.0, "unknown"),
        (0.9e-6, 1e-6, 49.0, 0.0, "unknown"),
        (1.5e-6, None, 49.0, 0.0, "unknown"),
    ],
)
def test_small_errors_without_a_cause_are_those_of_a_method(
    error: float, dt: float | None, floors: float, rest: float, answer: str
) -> None:
    none = fit("none", rms=1e2, error=error, floors=floors)
    for fits in ([], [fit(rms=50.0, largest=900.0, where="body 3", evidence="Something.")]):
        diagnosis = diagnosis_of(none, fits, dt=dt, rest=rest)
        assert diagnosis.cause == answer
        # a fault that leaves half of the difference is told as a part of the cause, one that leaves more is not
        part = "This explains 50 % of the difference; something else remains."
        nearest = f"Something. {part}" if fits else "No single fault helps."
        assert answer == "none" or diagnosis.headline == nearest
        assert diagnosis.evidence == (
            f"The difference is {share(error)} of the largest value." if answer == "none" else nearest
        )


@pytest.mark.parametrize(
    ("effect", "error", "answer"),
    [
        (50.0, 1e-2, "gravity"), (49.0, 1e-2, "unknown"), (75.0, 1e-2, "gravity"), (49.0, 0.9e-6, "none"),
        (49.0, 1e-6, "unknown"), (49.0, 1.5e-6, "unknown"), (50.0, 0.9e-6, "gravity"),
    ],
)  # fmt: skip
def test_an_effect_of_fifty_floors_is_named(effect: float, error: float, answer: str) -> None:
    diagnosis = diagnosis_of(fit("none", rms=49.0, error=error), [fit()], effect=effect)
    assert diagnosis.cause == answer
    # what leaves less than a fiftieth, to the digits of the file, is named at any effect
    whole = diagnosis_of(fit("none", rms=51.0, error=error), [fit()], effect=effect).cause
    assert whole == ("gravity" if answer == "unknown" else answer)
    if answer != "gravity":
        below = (
            "The difference is 49 times what step and digits of the file make, and no cause is named below 50 times. "
            " This would explain it."
        )
        assert diagnosis.evidence == (below if answer == "unknown" else "The difference is 9e-7 of the largest value.")


def test_of_equal_fits_the_first_of_the_list_is_named_with_its_numbers() -> None:
    fits = [
        fit("time-scale", rms=1.0, error=2e-9, p=1.5, deviation=0.25),
        fit("mass", rms=1.001, where="body 2", p=1.5, deviation=0.25, error=3e-9, evidence="Mass {0:g} +- {1:g}."),
        fit("drag", nameable=False, rms=1.001),
        fit("exponent", rms=9.0, largest=90.0),
    ]
    diagnosis = diagnosis_of(NONE, fits)
    assert (diagnosis.cause, diagnosis.where, diagnosis.alternatives) == ("mass", "body 2", ("time-scale",))
    assert diagnosis.evidence == (
        "Mass 3 +- 0.5. With this fault in the reference the difference shrinks from 1 % of the largest value to 3e-9."
    )
    assert diagnosis.parameters == {"value": (3.0, 0.5)}
    # two bodies as good as each other are no place
    other = fit("mass", rms=1.0, where="body 3", p=1.5)
    assert diagnosis_of(NONE, [fits[1], other]).where == ""
    assert diagnosis_of(NONE, [fits[1], fit("mass", rms=1.0, where="body 2", p=1.5)]).where == "body 2"
    assert diagnosis_of(NONE, [fit("missed-contact", where="contact 1")]).alternatives == ("stiffness",)
    assert diagnosis_of(NONE, [fit("gravity")]).parameters == {}


def test_a_cause_outside_the_list_that_fits_best_is_unknown() -> None:
    drag = fit("drag", rms=1.0, nameable=False)
    outside = "A cause outside the list fits best."
    assert diagnosis_of(NONE, [drag]).evidence == outside
    # one of the list that digits explain as well is named
    assert diagnosis_of(NONE, [drag, fit("gravity", rms=1.1)]).cause == "gravity"
    loose = fit("drag", rms=5.0, largest=90.0, error=1e-6, nameable=False)
    assert diagnosis_of(NONE, [loose, fit("gravity", rms=6.0, largest=90.0, error=1e-6)]).evidence == outside
    best = fit("gravity", rms=5.0, largest=90.0, error=1e-6)
    assert diagnosis_of(NONE, [best, fit("drag", rms=6.0, largest=90.0, nameable=False)]).cause == "gravity"


@pytest.mark.parametrize(
    ("scale", "factors", "alternatives"),
    [
        (1e-3, (1.0, 1.0, 1.0), ("time-scale",)),
        (1.0, (1e3, 1.0, 1.0), ()),
        (1e-3, (1e3, 1.0, 1.0), ()),
        (1e-3, (1.0, 1e3, 1.0), ()),
        (1e-3, (1.0, 1.0, 1e3), ()),
    ],
)
def test_times_in_another_unit_may_be_scaled_times(
    scale: float, factors: tuple[float, float, float], alternatives: tuple[str, ...]
) -> None:
    assert diagnosis_of(NONE, [fit("units", scale=scale, factors=factors)]).alternatives == alternatives
    assert diagnosis_of(NONE, [fit("time-shift", scale=scale, factors=factors)]).alternatives == ()


def body(radius: float = 0.04, poisson: float = 0.5) -> Any:
    return SimpleNamespace(radius=radius, material=SimpleNamespace(poissons_ratio=poisson))


def uniform(factor: float, geometry: Any, deviation: float = 0.0) -> Diagnosis:
    chosen = fit("stiffness-scale", family="factor", p=math.log(factor), deviation=deviation)
    return diagnosis_of(NONE, [chosen], geometry=geometry)


@pytest.mark.parametrize(
    ("factor", "name"),
    [
        (5.0, "missing-sqrt-radius"),  # of 40 mm
        (1.0 / math.sqrt(0.02), "missing-sqrt-radius"),  # the effective radius of two
        (1.5, "modulus"),  # 2 (1 - nu^2)
        (0.75, "modulus"),
        (2.0, "modulus"),
        (4.0 / 3.0, "modulus"),
        (0.5, "modulus"),
        (1.3, "stiffness-scale"),
        (1.0, "stiffness-scale"),
        (1.25, "stiffness-scale"),
        (1.0 / math.sqrt(0.08), "stiffness-scale"),
    ],
)
def test_a_factor_on_all_stiffnesses_has_the_name_of_what_makes_it(factor: float, name: str) -> None:
    one_size = SimpleNamespace(bodies=[body(), body()])
    names = {"stiffness-scale", "modulus"}
    for off, expected in ((0.0, name), (0.9e-5, name), (1.5e-5, "stiffness-scale")):
        for sign in (1.0, -1.0):
            diagnosis = uniform(factor * (1.0 + sign * off), one_size)
            # a missing root is an alternative where the factor is that of a radius, and nowhere else
            assert (diagnosis.cause, {diagnosis.cause, *diagnosis.alternatives}) == (expected, names | {expected})
    # five deviations, if they are more
    assert uniform(factor * (1.0 + 4.5e-3), one_size, 1e-3).cause == name
    assert uniform(factor * (1.0 + 7e-3), one_size, 1e-3).cause == "stiffness-scale"
    # without radii, or with several, a factor has no square root of one
    assert uniform(factor, None).cause == "stiffness-scale"
    assert set(uniform(factor, None).alternatives) == names - {"stiffness-scale"}
    sizes = SimpleNamespace(bodies=[body(), body(0.03)])
    diagnosis = uniform(factor, sizes)
    assert diagnosis.cause == ("stiffness-scale" if name == "missing-sqrt-radius" else name)
    assert "missing-sqrt-radius" not in diagnosis.alternatives


def test_a_factor_on_masses_that_is_named_keeps_the_names_of_stiffness_as_alternatives() -> None:
    scale = fit("stiffness-scale", family="factor", p=0.3, rms=1.0)
    mass = fit("mass", family="factor", p=-0.3, rms=1.0)
    diagnosis = diagnosis_of(NONE, [mass, scale])
    assert (diagnosis.cause, set(diagnosis.alternatives)) == (
        "stiffness-scale", {"mass", "modulus"},
    )  # fmt: skip
    assert diagnosis.needed.endswith("contact forces tell both.")
    assert diagnosis_of(NONE, [mass]).alternatives == ()
    units = diagnosis_of(NONE, [scale, fit("units", scale=2.0)])
    assert (units.cause, "modulus" in units.alternatives) == ("units", True)
    other = fit("stiffness-scale", family="", p=0.3)
    assert diagnosis_of(NONE, [other]).alternatives == ()


@pytest.mark.parametrize(
    ("rms", "best", "as_good"),
    [(1.0, 1.0, True), (1.26, 1.0, True), (1.27, 1.0, False), (0.9, 0.5, True), (0.95, 0.5, False), (1.49, 1.3, True)],
)
def test_explained_fits_differ_by_sixty_in_the_sum_of_squares(rms: float, best: float, as_good: bool) -> None:
    assert is_alternative(fit("mass", rms=rms), fit(rms=best)) is as_good
    assert not is_alternative(fit("mass", rms=1.6), fit(rms=1.45), count=2)
    assert not is_alternative(fit("mass", largest=13.0), fit(), count=2)


@pytest.mark.parametrize(
    ("family", "best", "ratio", "as_good"),
    [("a", "", 2.0, False), ("", "a", 2.0, False),
     ("", "", 1.49, True), ("", "", 1.5, False), ("a", "a", 2.9, True), ("a", "a", 3.0, False), ("a", "b", 1.6, False),
     ("a", "a", 4.0, False), ("", "", 2.0, False)],
)  # fmt: skip
def test_unexplained_fits_differ_by_half(family: str, best: str, ratio: float, as_good: bool) -> None:
    first = fit(rms=2.0, largest=20.0, error=1e-9, family=best)
    assert is_alternative(fit("mass", rms=2.0 * ratio, largest=20.0, family=family), first) is as_good
    # a single large residual is as good as none explained
    best_one = fit(rms=1.0, largest=12.0, error=1e-9)
    assert is_alternative(fit("mass", rms=1.4, largest=20.0), best_one, count=10_000)


# ---------------------------------------------------------------- one file, and several
def diagnosed(
    monkeypatch: pytest.MonkeyPatch, none: Fit, *, size: float = 0.1, answer: str = "unknown",
    fits: tuple[Fit, ...] = (), single_grid: bool = True, noise: float = 99.0, files: Sequence[Any] = (),
    by_step: float = 0.0, dt: float | None = None, rest: float = 0.0, over: bool = False,
) -> Diagnosis:  # fmt: skip
    """Return the diagnosis of files that the scene explains no better than ``none``; each may have its own cause."""
    decision = SimpleNamespace(
        decide=lambda hypothesis, p: none if not p.size else None,
        effect_of_noise=lambda fit: noise,
        within_step=lambda fit: fit.error < by_step,
        error_at_rest=lambda: rest,
    )

    def search(scene: Any, record: Any, floor: Any) -> Any:
        assert floor == {"velocity": 1.0}
        return SimpleNamespace(
            decision=decision, none="none", errors=np.array([0.0, size, 0.0]), fits=lambda: list(fits),
            data=SimpleNamespace(blocks=[], dt=dt, over=over), exact=[], record=record, scene=scene, foreign=False,
            missing_bodies=0,
        )  # fmt: skip

    def named(search: Any, none: Fit, fits: list[Fit], certain: bool) -> Diagnosis:
        return Diagnosis(cause=getattr(search.record, "cause", answer), evidence=str(search.record.dt))

    plant(monkeypatch, Seam.SEARCH, search)
    plant(monkeypatch, Seam.NAME_CAUSE, named)
    plant(monkeypatch, Seam.ON_SINGLE_GRID, lambda data: single_grid)
    plant(monkeypatch, Seam.STATEMENTS, lambda scene, record: [])
    plant(monkeypatch, Seam.STEP_ERROR, lambda decision, fit: None)
    for other in (Seam.OTHER_MASSES, Seam.SHIPPED_SCENE, Seam.NAME_PAIR):
        plant(monkeypatch, other, lambda *args, **named: None)
    return cause.diagnose(CHAIN, files or [SimpleNamespace(dt=None)], {"velocity": 1.0})


def test_what_digits_explain_or_nearly_explain_has_no_cause(monkeypatch: pytest.MonkeyPatch) -> None:
    right = Diagnosis(cause="none", evidence="Time step and digits explain the difference.")
    assert diagnosed(monkeypatch, fit(rms=1.0, largest=3.0, floors=99.0)) == right
    assert diagnosed(monkeypatch, fit(rms=1.0, largest=99.0, floors=1.0)) == right
    assert diagnosed(monkeypatch, fit(rms=2.0, largest=3.0), answer="mass").cause == "mass"
    wild = diagnosed(monkeypatch, fit(rms=2.0), size=1.5e12)
    assert (wild.cause, wild.evidence) == (
        "unknown",
        "Values grow to 1.5e+12 of the largest value of the scene, as those of an unstable step do.",
    )
    assert diagnosed(monkeypatch, fit(rms=2.0), size=1e12, answer="mass").cause == "mass"


@pytest.mark.parametrize(
    ("changes", "answer"),
    [
        ({}, "single-precision"),
        ({"answer": "mass"}, "mass"),
        ({"answer": "none"}, "none"),
        ({"single_grid": False}, "unknown"),
        ({"fits": (fit(rms=29.0),)}, "unknown"),  # a hypothesis leaves less than 30 %
        ({"fits": (fit(rms=30.0), fit(rms=1.0))}, "single-precision"),
        ({"fits": (fit(rms=45.0),)}, "single-precision"),
        ({"none": fit("none", rms=100.0, error=5.0)}, "single-precision"),
        ({"none": fit("none", rms=100.0, error=7.0)}, "unknown"),
        ({"noise": 50.0}, "single-precision"),
        ({"noise": 49.0}, "unknown"),
    ],
)
def test_unexplained_values_on_a_grid_of_single_precision_are_so_named(
    monkeypatch: pytest.MonkeyPatch, changes: dict[str, Any], answer: str
) -> None:
    none = changes.pop("none", fit("none", rms=100.0, error=0.5))
    diagnosis = diagnosed(monkeypatch, none, **changes)
    assert diagnosis.cause == answer
    if answer == "single-precision":
        assert diagnosis.evidence == (
            f"The samples are numbers of single precision, and differ by {share(none.error)} of the largest value."
        )


@pytest.mark.parametrize(
    ("causes", "answer"),
    [
        (["none", "mass", "time-shift"], "time-shift"),
        (["none", "mass", "mass", "time-shift"], "none"),  # three files are examined
        (["unknown", "unknown", "time-shift"], "second"),
        (["none", "unknown"], "none"),
        (["unknown", "none"], "unknown"),
        (["mass", "time-shift"], "mass"),
        (["none", "sampling-shift"], "sampling-shift"),
        (["none", "first-order-integrator"], "first-order-integrator"),
        (["none", "half-step-velocity"], "half-step-velocity"),
        (["none", "mass"], "none"),  # whose effect does not grow with the step: the finest file would show it
        (["unknown", "mass"], "unknown"),
    ],
)
def test_coarser_files_show_causes_of_the_step(monkeypatch: pytest.MonkeyPatch, causes: list[str], answer: str) -> None:
    files: list[Any] = [SimpleNamespace(dt=None if k == 3 else 1e-7 * (k + 1), cause=c) for k, c in enumerate(causes)]
    diagnosis = diagnosed(monkeypatch, fit("none", rms=1e4, error=0.1), files=files[::-1], single_grid=False)
    if answer == "second":
        assert (diagnosis.cause, diagnosis.evidence) == ("unknown", "2e-07")
    else:
        assert diagnosis.cause == answer
    law: Any = SimpleNamespace(law=abs)
    assert cause.diagnose(law, files).evidence == "Hypotheses are not available for contact laws that are functions."


def test_what_a_method_of_another_code_errs_by_is_left_to_a_fault() -> None:
    def named(rms: float, by_step: float) -> Diagnosis:
        return diagnosis_of(NONE, [fit(rms=rms, largest=900.0, error=1e-4)], by_step=by_step, effect=2.0)

    # a fifth of the difference at most, if it is within the error of the step
    assert [named(rms, 2e-4).cause for rms in (1999.0, 2001.0)] == ["gravity", "unknown"]
    assert named(1999.0, 0.5e-4).cause == "unknown"
    assert named(1999.0, 2e-4).evidence.endswith("as large as errors of methods of second order at this step.")
    # a second parameter, which such an error may feign, is not named
    exponents = [
        fit("exponent", rms=rms, largest=900.0, error=1e-4, p=0.1, evidence=f"{rms:g}") for rms in (99.0, 500.0)
    ]
    both = replace(exponents[0].hypothesis, starts=((0.0, 0.0),))
    two = replace(exponents[0], hypothesis=both, parameters=np.array([0.1, 0.1]), deviation=np.zeros(2))
    assert diagnosis_of(NONE, [two, exponents[1]], by_step=2e-4).evidence.startswith("500")
    assert diagnosis_of(NONE, [two, exponents[1]], by_step=0.0).cause == "unknown"


def test_a_file_that_errs_as_methods_of_second_order_do_has_no_cause(monkeypatch: pytest.MonkeyPatch) -> None:
    none = fit("none", rms=1e4, error=1e-3)
    answers = {
        by_step: diagnosed(monkeypatch, none, single_grid=False, by_step=by_step, dt=1e-7).cause
        for by_step in (2e-3, 0.5e-3)
    }
    assert answers == {2e-3: "none", 0.5e-3: "unknown"}
    # not without a step, nor where bodies err that have not moved yet
    assert diagnosed(monkeypatch, none, single_grid=False, by_step=2e-3).cause == "unknown"
    assert diagnosed(monkeypatch, none, single_grid=False, by_step=2e-3, dt=1e-7, rest=2e-4).cause == "unknown"
    assert diagnosed(monkeypatch, none, single_grid=True, by_step=2e-3, dt=1e-7).cause == "single-precision"


def test_the_end_of_a_search_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    none = fit("none", rms=1e4, error=1e-3)
    assert "ended" not in diagnosed(monkeypatch, none, single_grid=False).evidence
    over = diagnosed(monkeypatch, none, single_grid=False, over=True)
    assert over.evidence.endswith(" The search ended after 60 s of processor time, its limit.")


# ---------------------------------------------------------------- single precision
RANDOM = np.random.default_rng(8)
DOUBLES = RANDOM.uniform(0.5, 1.0, 100)  # where single precision has a spacing of 2^-24
SINGLES = DOUBLES.astype(np.float32).astype(float)
HALF = 2.0**-25


def block(*columns: Floats, digits: float = 0.0, quantity: int = 0) -> Block:
    values = np.column_stack(columns)
    return Block(
        quantity, values, np.arange(len(columns)), np.ones(values.shape), np.isfinite(values), 1.0,
        np.full(values.shape, digits),
    )  # fmt: skip


def is_single(*blocks: Block) -> bool:
    data: Any = SimpleNamespace(blocks=blocks)
    return on_single_grid(data)


def mixed(share: int) -> Floats:
    """Return numbers of which so many of a hundred are of single precision."""
    return np.where(np.arange(100) < share, SINGLES, DOUBLES)


@pytest.mark.parametrize(
    ("columns", "digits", "answer"),
    [
        ((SINGLES,), 0.0, True),
        ((DOUBLES,), 0.0, False),
        ((mixed(96),), 0.0, True),  # more than 95 %
        ((mixed(95),), 0.0, False),
        ((SINGLES, DOUBLES), 0.0, False),
        ((SINGLES, np.zeros(100)), 0.0, True),
        ((SINGLES, np.repeat([0.1, 0.2], 50)), 0.0, True),  # two values tell nothing
        ((np.where(np.arange(100) < 20, SINGLES, SINGLES[0]),), 0.0, True),
        ((np.where(np.arange(100) < 19, SINGLES, SINGLES[0]),), 0.0, False),
        ((np.where(np.arange(100) < 40, SINGLES, np.nan),), 0.0, True),
        ((np.where(np.arange(100) < 40, SINGLES, 1.0),), 0.0, True),
        # digits of a quarter of half a spacing resolve the grid, and values may be off by them
        ((SINGLES + 1.05 * 0.24 * HALF,), 0.24 * HALF, True),
        ((SINGLES + 1.5 * 0.24 * HALF,), 0.24 * HALF, False),
        ((SINGLES + 0.3 * HALF,), 0.3 * HALF, False),
        ((SINGLES + 0.1 * HALF,), 0.25 * HALF, False),
        ((np.where(np.arange(100) < 40, 0.0, mixed(96)),), 0.0, False),  # a body at rest tells nothing
        ((SINGLES,), 0.3 * HALF, True),
        ((SINGLES * (1.0 + 2.0**-51),), 0.0, True),
        ((SINGLES * (1.0 + 3.0 * 2.0**-51),), 2.0**-53, False),
    ],
)
def test_numbers_of_single_precision_are_on_its_grid(columns: tuple[Floats, ...], digits: float, answer: bool) -> None:
    assert is_single(block(*columns, digits=digits)) is answer
    assert is_single(block(DOUBLES), block(*columns, digits=digits)) is answer


FAR = RANDOM.uniform(0.0, 1e-4, 100)


def grid(power: int, share: int = 100, off: float = 0.0) -> Floats:
    """Return displacements of which some are multiples of a power of two, but for a part of it."""
    spacing = 2.0**-power
    return np.where(np.arange(100) < share, spacing * (np.rint(FAR / spacing) + off), FAR)


@pytest.mark.parametrize(
    ("columns", "digits", "answer"),
    [
        ((grid(30),), 1e-16, True),
        ((grid(43),), 1e-16, True),
        ((grid(44, off=0.0),), 1e-16, False),
        ((grid(30, 96),), 1e-16, True),
        ((grid(30, 95),), 1e-16, False),
        ((grid(30), FAR), 1e-16, False),
        ((grid(30), FAR.astype(np.float32).astype(float)), 1e-16, True),  # a body at the origin has its own grid
        ((grid(30), (1e-4 * FAR).astype(np.float32).astype(float)), 1e-16, True),  # ... or none
        ((FAR,), 1e-16, False),
        # digits of more than a quarter of the grid do not resolve it; values may be off by them
        ((grid(30, off=0.2),), 0.2 * 2.0**-30, True),
        ((grid(30, off=0.3),), 0.3 * 2.0**-30, False),
        ((grid(30, off=0.1),), 0.25 * 2.0**-30, False),
        ((grid(30, off=0.15),), 0.1 * 2.0**-30, False),
        ((grid(30, off=0.105),), 0.1 * 2.0**-30, True),
    ],
)
def test_displacements_of_single_positions_are_multiples_of_their_spacing(
    columns: tuple[Floats, ...], digits: float, answer: bool
) -> None:
    assert is_single(block(*columns, digits=digits, quantity=1)) is answer
    # velocities and forces are no differences of positions: only numbers of single precision have a grid
    for quantity in (0, 2):
        assert not is_single(block(grid(40), digits=1e-16, quantity=quantity))
    assert is_single(block(grid(40), digits=1e-16, quantity=1))


@pytest.mark.parametrize(
    ("count", "step", "digits", "coarsest", "answer"),
    [
        (200, 1, 1e-9, 0.0, True),
        (60, 1, 0.3 * 2.0**-18, 0.0, False),
        (70, 1, 1e-9, 0.0, True),  # by a finer grid
        (70, 1, 0.2 * 2.0**-18, 0.0, False),
        (200, 2, 0.2 * 2.0**-18, 0.0, True),
        (200, 2, 1e-9, 0.3 * 2.0**-18, False),  # the coarsest digits count
    ],
)
def test_a_grid_is_a_hundredth_of_the_motion_at_most_and_finer_than_its_digits(
    count: int, step: int, digits: float, coarsest: float, answer: bool
) -> None:
    # half a nanometre beside the multiples, which is no number of single precision and which no digits resolve
    moved = 2.0**-18 * step * np.rint(np.linspace(0.0, 1.0, 100) * count) + 0.5e-9
    rounding = np.full((100, 1), digits)
    rounding[-1] = max(digits, coarsest)
    assert is_single(block(moved, quantity=1)._replace(rounding=rounding)) is answer
