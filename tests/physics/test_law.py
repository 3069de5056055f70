"""Contact laws as functions of overlap."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dem_bridge.physics import contact
from dem_bridge.physics.law import clustered, law_of, power_law, reach_of

REACH = 1e-5


@given(exponent=st.floats(2.0, 5.0), stiffness=st.floats(1e3, 1e12))
def test_a_power_law_is_that_of_contact(exponent: float, stiffness: float) -> None:
    law, overlap = power_law(stiffness, exponent), np.array([0.0, 1e-9, 1e-6, REACH])
    # the same operations: two ulps for another kernel of numpy
    np.testing.assert_allclose(law.force(overlap), contact.force(overlap, stiffness, exponent), rtol=5e-16)
    np.testing.assert_allclose(law.energy(overlap), contact.energy(overlap, stiffness, exponent), rtol=5e-16)


@pytest.mark.parametrize(
    ("stiffness", "exponent", "words"),
    [(0.0, 2.5, "stiffness"), (math.nan, 2.5, "stiffness"), (1.0, 1.9, "exponent"), (1.0, math.inf, "exponent")],
)
def test_what_is_no_power_law_is_refused(stiffness: float, exponent: float, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        power_law(stiffness, exponent)


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
