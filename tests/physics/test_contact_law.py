"""Contact laws as functions of overlap.

The contact law and the stiffness of crossed cylinders, against identities and a second writing.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dem_bridge.physics import contact_law
from dem_bridge.physics.contact_law import (
    ContactLaw,
    Law,
    check_law,
    clustered,
    completed,
    energy,
    force,
    law_of,
    power_law,
    reach_of,
    stored,
)
from tests.helpers.strategies import log_uniform

REACH = 1e-5


@given(exponent=st.floats(2.0, 5.0), stiffness=st.floats(1e3, 1e12))
def test_a_power_law_is_that_of_contact(exponent: float, stiffness: float) -> None:
    law, overlap = power_law(stiffness, exponent), np.array([0.0, 1e-9, 1e-6, REACH])
    # the same operations: two ulps for another kernel of numpy
    np.testing.assert_allclose(law.force(overlap), contact_law.force(overlap, stiffness, exponent), rtol=5e-16)
    np.testing.assert_allclose(law.energy(overlap), contact_law.energy(overlap, stiffness, exponent), rtol=5e-16)


@pytest.mark.parametrize(
    ("stiffness", "exponent", "words"),
    [(0.0, 2.5, "stiffness"), (math.nan, 2.5, "stiffness"), (1.0, 1.9, "exponent"), (1.0, math.inf, "exponent")],
)
def test_what_is_no_power_law_is_refused(stiffness: float, exponent: float, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        power_law(stiffness, exponent)


@pytest.mark.parametrize("power", [1.0, 1.5, 3.3])
def test_energy_by_quadrature_has_all_digits_far_below_the_reach(power: float) -> None:
    law = law_of(lambda d: 1e9 * d**power, reach=REACH)
    overlap = REACH * 2.0 ** -np.array([5.3, 12.7, 20.7, 38.2])
    assert law.energy(overlap) == pytest.approx(1e9 * overlap ** (power + 1.0) / (power + 1.0), rel=1e-14, abs=0.0)


@given(exponent=st.floats(2.0, 5.0))
def test_energy_by_quadrature_is_the_exact_one(exponent: float) -> None:
    exact = power_law(1e9, exponent)
    law = law_of(exact.force, reach=REACH)
    overlap = np.concatenate([[0.0], np.geomspace(1e-12, REACH, 200)])
    # 200 panels summed, each good to some ulps
    np.testing.assert_allclose(
        law.energy(overlap), exact.energy(overlap), rtol=0.0, atol=1e-13 * exact.energy(overlap)[-1]
    )


def test_a_kink_that_is_named_costs_nothing() -> None:
    kink, overlap = 0.3 * REACH, np.linspace(0.0, REACH, 1001)

    def exact(d: np.ndarray) -> np.ndarray:
        return np.asarray(0.5e6 * (d**2 + 3.0 * np.maximum(d - kink, 0.0) ** 2))

    def error(*kinks: float) -> float:
        law = law_of(lambda d: 1e6 * (d + 3.0 * np.maximum(d - kink, 0.0)), reach=REACH, kinks=kinks)
        return float(abs(law.energy(overlap) - exact(overlap)).max() / exact(overlap)[-1])

    assert error(kink) < 1e-13
    # in a panel of 1/200 of the reach
    assert error() > 1e-10


def test_places_ascend_from_touch_to_reach_and_hold_the_kinks() -> None:
    places = clustered(REACH, [2e-6, 7e-6, 2e-5, -1.0], 300)
    assert places[0] == 0.0
    assert places[-1] == REACH
    assert np.all(np.diff(places) > 0.0)
    assert len(places) <= 301
    assert {2e-6, 7e-6} <= set(places.tolist())


@given(exponent=st.floats(2.0, 5.0), share=st.floats(-12.0, 0.0))
def test_energy_by_quadrature_has_its_digits_far_below_the_reach_too(exponent: float, share: float) -> None:
    exact = power_law(1e9, exponent)
    overlap = np.array([REACH * 10.0**share])
    # on panels from a half to the whole of an overlap ten Gauss points err by 6^-20 of any power; round-off of 260 sums
    assert law_of(exact.force, reach=REACH).energy(overlap) == pytest.approx(exact.energy(overlap), rel=1e-13)


@given(exponent=st.floats(2.0, 5.0), energy=st.floats(1e-12, 1e3), near=st.floats(1e-12, 1.0))
def test_the_reach_of_an_energy_is_at_most_a_sixteenth_too_long_wherever_one_begins(
    exponent: float, energy: float, near: float
) -> None:
    law = power_law(1e9, exponent)
    exact = (exponent * energy / 1e9) ** (1.0 / exponent)
    # a sixteenth of the next power of two above, which is half of that at least
    assert exact * (1.0 - 1e-12) <= reach_of(law, energy, near=near) <= exact * 1.125
    assert reach_of(law.force, energy, near=near) == pytest.approx(reach_of(law, energy, near=near), rel=0.07)


def test_the_reach_has_few_digits() -> None:
    reach = reach_of(power_law(1e9, 2.5), 1e-3, near=1e-5)
    assert (math.frexp(reach)[0] * 32.0).is_integer()


@pytest.mark.parametrize(
    ("kinks", "intervals", "places"),
    [
        ((), 4, [0.0, 1 / 64, 1 / 8, 27 / 64, 1.0]),
        ((0.0, 1.0, -0.5, 2.0), 4, [0.0, 1 / 64, 1 / 8, 27 / 64, 1.0]),
        ((), 1, [0.0, 1 / 8, 1.0]),
        # on both sides of a kink u^3 / (u^3 + (1 - u)^3), at the end u^3
        ((0.5,), 9, [0.0, 0.5 / 28, 0.25, 13.5 / 28, 0.5, 0.5 + 1 / 128, 0.5 + 1 / 16, 0.5 + 27 / 128, 1.0]),
        ((0.5, 0.5), 5, [0.0, 0.25, 0.5, 0.5 + 1 / 16, 1.0]),
    ],
)
def test_places_are_those_of_the_cubes(kinks: tuple[float, ...], intervals: int, places: list[float]) -> None:
    assert clustered(1.0, kinks, intervals) == pytest.approx(places, rel=1e-15)


def test_a_law_is_completed_for_arrays_of_any_shape() -> None:
    def flat(overlap: np.ndarray) -> np.ndarray:
        assert overlap.ndim == 1
        return 2.0 * overlap

    law: Law
    for law in (flat, ContactLaw(force=flat, energy=lambda overlap: 0.5 * overlap * flat(overlap), kinks=(0.25,))):
        whole = completed(law, reach=1.0)
        for overlap in (np.array(0.5), np.array([0.0, 0.5]), np.array([[0.0, 0.25], [0.5, 1.0]])):
            assert whole.force(overlap).shape == whole.energy(overlap).shape == overlap.shape
            np.testing.assert_allclose(whole.force(overlap), 2.0 * overlap, rtol=1e-15)
            np.testing.assert_allclose(whole.energy(overlap), overlap**2, rtol=1e-13)
    assert whole.kinks == (0.25,)
    assert [stored(law, x) for x in (-1.0, 0.0)] == [0.0, 0.0]
    assert stored(law, 0.5) == pytest.approx(0.25, rel=1e-13)


def test_without_energy_the_reach_is_the_next_power_of_two() -> None:
    law = power_law(1e9, 2.5)
    assert [reach_of(law, 0.0, near=near) for near in (0.25, 0.26, 0.5)] == [0.25, 0.5, 0.5]


@pytest.mark.parametrize("near", [0.125, 0.25, 0.5, 1.0, 4.0])
@pytest.mark.parametrize("reach", [0.5, 0.375, 0.28125])
def test_an_overlap_that_stores_the_very_energy_is_its_reach(near: float, reach: float) -> None:
    # overlaps of few digits, whose squares are exact: 0.5, and after one and four halvings of 0.25 to 0.5
    law = ContactLaw(force=lambda d: 2.0 * d, energy=lambda d: d * d)
    assert reach_of(law, reach**2, near=near) == reach


def _beyond(limit: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda overlap: np.where(overlap <= limit, 2.0 * overlap, np.nan)


@pytest.mark.parametrize("share", [0.5, 0.99, 0.999999])
def test_a_law_that_ends_is_searched_up_to_its_end(share: float) -> None:
    reach = reach_of(_beyond(0.7), share * 0.49, near=1e-3)
    assert 0.7 * math.sqrt(share) * (1.0 - 1e-12) <= reach <= 0.7


@pytest.mark.parametrize(
    ("law", "energy", "near", "text"),
    [
        # never enough: after 60 doublings of 1 m
        (lambda d: 0.0 * d, 1e-3, 1.0, "stores 0 J at an overlap of 1.15e+18 m, less than the energy of the scene"),
        (lambda d: np.minimum(d, 1e-30), 1e-3, 1.0, "stores 1.15e-12 J at an overlap of 1.15e+18 m, less than"),
        # invalid everywhere: said where the search begins
        (lambda d: -d, 1e-3, 64.0, "= -0.000244140625 N at overlap 0.000244141 m"),
        (_beyond(0.7), 0.6, 1e-3, "= nan N at overlap 0.7 m"),
    ],
)  # fmt: skip
def test_a_law_that_never_stores_the_energy_is_refused_with_the_reason(
    law: Law, energy: float, near: float, text: str
) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(text)}"):
        reach_of(law, energy, near=near)


def _of_energy(factor: float) -> ContactLaw:
    return ContactLaw(force=lambda d: 2.0 * d, energy=lambda d: d**2 + factor * d * (1.0 - d))


def _falling(by: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda overlap: np.where(overlap == 0.0, 0.0, np.where(overlap <= 0.5, 1.0, 1.0 - by))


@pytest.mark.parametrize(
    ("law", "text"),
    [
        (power_law(1e9, 2.5), ""),
        # the energy is off by a quarter of the factor at most
        (_of_energy(3.9e-6), ""),
        (_of_energy(-3.9e-6), ""),
        (_of_energy(4.1e-6), "has an energy of 0."),
        (_of_energy(-4.1e-6), "has an energy of 0."),
        (ContactLaw(force=lambda d: 2.0 * d, energy=lambda d: math.nan * d), "has an energy of nan J at overlap 0 m"),
        (_falling(0.9e-12), ""),
        (_falling(1.1e-12), "falls from 1 N at overlap 0.5 m to 1 N at 0.506023 m"),
        (_falling(0.25), "falls from 1 N at overlap 0.5 m to 0.75 N at 0.506023 m"),
        (lambda d: 0.0 * d, ""),
        (lambda d: d + 1.0, "= 1.0 N at overlap 0"),
        (lambda d: np.where(d > 0.9, math.inf, d), "= inf N at overlap 0.9"),
        (lambda d: np.where(d > 0.9, -1.0, d), "= -1.0 N at overlap 0.9"),
        (lambda d: d[:-1], "returns an array of shape"),
        (lambda d: d / None, "raises TypeError on an array of overlaps: unsupported operand"),
    ],
)
def test_a_law_is_checked_on_all_its_overlaps(law: Any, text: str) -> None:
    if not text:
        check_law(law, 1.0)
        return
    with pytest.raises(ValueError, match=f"^{re.escape(text)}"):
        check_law(law, 1.0)


@pytest.mark.parametrize("wrong", [{"reach": 0.0}, {"reach": math.inf}, {"kinks": (math.nan,)}])
def test_a_law_needs_a_finite_reach_and_kinks(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="allowed: a finite number"):
        law_of(lambda d: d, **({"reach": 1.0} | wrong))
    with pytest.raises(ValueError, match=r"^force = 1.0; allowed: an array function of the overlap \(m\)$"):
        law_of(1.0, reach=1.0)  # type: ignore[arg-type]


QUARTZ = {"radius": 9e-3, "young": 72e9, "poisson": 0.17}

EPS = float(np.finfo(float).eps)

overlaps = log_uniform(1e-9, 1e-3)
stiffnesses = log_uniform(1e3, 1e12)
exponents = st.floats(1.5, 4.0)


@given(overlap=overlaps, stiffness=stiffnesses, exponent=exponents)
def test_contact_force_is_minus_the_energy_gradient(overlap: float, stiffness: float, exponent: float) -> None:
    # central difference with h = 1e-4 d: truncation (n-1)(n-2)/6 h^2/d^2 <= 1e-8, round-off eps d/(n h) <= 2e-12
    h = 1e-4 * overlap
    gradient = (energy(overlap + h, stiffness, exponent) - energy(overlap - h, stiffness, exponent)) / (2.0 * h)
    assert float(gradient) == pytest.approx(float(force(overlap, stiffness, exponent)), rel=2e-8)


@given(overlap=overlaps, stiffness=stiffnesses, exponent=exponents)
def test_energy_is_force_times_overlap_over_n(overlap: float, stiffness: float, exponent: float) -> None:
    # two powers, each good to an ulp for arguments like these
    expected = float(force(overlap, stiffness, exponent)) * overlap / exponent
    assert float(energy(overlap, stiffness, exponent)) == pytest.approx(expected, rel=8.0 * EPS)


@given(overlap=overlaps, stiffness=stiffnesses, exponent=exponents, scale=st.floats(0.1, 10.0))
def test_force_goes_as_overlap_to_the_power_n_minus_1(
    overlap: float, stiffness: float, exponent: float, scale: float
) -> None:
    ratio = float(force(scale * overlap, stiffness, exponent) / force(overlap, stiffness, exponent))
    # the rounding of scale * overlap is raised to the power 3 at most; three powers of an ulp each
    assert ratio == pytest.approx(scale ** (exponent - 1.0), rel=10.0 * EPS)


@given(gap=st.floats(0.0, 1e300), stiffness=stiffnesses, exponent=exponents)
def test_an_open_contact_neither_pulls_nor_stores(gap: float, stiffness: float, exponent: float) -> None:
    assert float(force(-gap, stiffness, exponent)) == 0.0
    assert float(energy(-gap, stiffness, exponent)) == 0.0


def test_shapes_broadcast_over_samples_and_contacts() -> None:
    overlap = np.full((7, 3), 4e-6)
    stiffness, exponent = np.array([1e9, 2e9, 3e9]), np.array([2.5, 2.0, 3.0])
    assert force(overlap, stiffness, exponent).shape == energy(overlap, stiffness, exponent).shape == (7, 3)
    assert force(overlap, stiffness, exponent)[5].tolist() == pytest.approx([8.0, 8e3, 4.8e-2], rel=4.0 * EPS)
