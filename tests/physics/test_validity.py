"""What contacts assume: the paper's own numbers, ratios without units, and tension by another way."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from dem_bridge.physics.exact import two_body_collision
from dem_bridge.physics.hertz import crossed_cylinders, sphere_on_cylinder
from dem_bridge.physics.validity import (
    FUSED_QUARTZ_COMPRESSIVE,
    FUSED_QUARTZ_TENSILE,
    Validity,
    edge_tension,
    ellipse_on_body,
    half_space,
    no_cracking,
    no_crushing,
    quasi_static,
    weightless,
)
from tests.helpers.strategies import log_uniform

QUARTZ: dict[str, Any] = {"radius": 9e-3, "young": 72e9, "poisson": 0.17}
MASS = 10.08e-3  # kg, of the paper's cylinder

sizes = log_uniform(1e-6, 1e3)

#: each assumption as a function of two numbers, the second of which is the yardstick; and which side holds
ASSUMPTIONS: list[tuple[Callable[[float, float], Validity], bool]] = [
    (lambda value, unit: ellipse_on_body(value, half_height=unit), True),
    (lambda value, unit: half_space(value, radius=unit), True),
    (lambda value, unit: no_crushing(value, strength=unit), True),
    (lambda value, unit: no_cracking(value, strength=unit), True),
    (lambda value, unit: quasi_static(value, size=unit, young=72e9, density=72e9), False),  # sound: 1 m/s
    (lambda value, unit: weightless(value, unit), True),
]
each = pytest.mark.parametrize(("assumption", "small_holds"), ASSUMPTIONS)


@each
@given(value=sizes, unit=sizes)
def test_the_ratio_is_what_is_found_over_its_yardstick(
    value: float, unit: float, assumption: Callable[[float, float], Validity], small_holds: bool
) -> None:
    found = assumption(value, unit)
    assert found.ratio == pytest.approx(value / unit, rel=1e-15)  # one quotient, and one of a speed that is 1


@each
def test_an_assumption_ends_at_its_limit_and_says_so(
    assumption: Callable[[float, float], Validity], small_holds: bool
) -> None:
    limit = assumption(1.0, 1.0).limit
    below, at, above = (assumption(limit * factor, 1.0) for factor in (0.99, 1.0, 1.01))
    assert (below.holds, at.holds, above.holds) == (small_holds, True, not small_holds)
    # the number before the colon, the judgement after it
    found, judged = zip(*(one.sentence.rsplit(": ", 1) for one in (below, at, above)), strict=True)
    assert f"{below.ratio:.3g}" in found[0]
    assert judged[1] == judged[0 if small_holds else 2] != judged[2 if small_holds else 0]
    assert all("\n" not in one.sentence for one in (below, above))


@each
@pytest.mark.parametrize("wrong", [-1.0, math.nan, math.inf])
def test_numbers_that_are_none_are_refused(
    wrong: float, assumption: Callable[[float, float], Validity], small_holds: bool
) -> None:
    for pair in ((wrong, 1.0), (1.0, wrong)):
        with pytest.raises(ValueError, match=f"= {wrong!r}; allowed: a "):
            assumption(*pair)


def test_limits_are_the_callers_to_set() -> None:
    assert not half_space(5e-3, radius=9e-3).holds
    assert half_space(5e-3, radius=9e-3, limit=1.0).holds
    assert not quasi_static(1e-4, size=18e-3, young=72e9, density=2200.0, limit=100.0).holds
    assert weightless(3.0, 10.0, limit=0.5).holds
    with pytest.raises(ValueError, match="limit = 0"):
        half_space(1.0, radius=1.0, limit=0.0)


# the paper's contacts


def test_two_cylinders_of_the_paper_at_2_degrees_are_beyond_a_point_contact() -> None:
    contact = crossed_cylinders(angle=2.0, **QUARTZ)
    # a cylinder at the 0.713 m/s that the striker would give it, on one at rest
    hit = two_body_collision(
        masses=(MASS, MASS), velocities=(0.712990017, 0.0), stiffness=contact.stiffness, exponent=2.5
    )
    major, minor = contact.semi_axes(hit.peak_force)
    assert major == pytest.approx(11e-3, abs=0.5e-3)
    beyond = ellipse_on_body(major, half_height=9e-3)
    assert not beyond.holds
    assert beyond.sentence.endswith("would reach beyond the body")
    assert not half_space(major, radius=9e-3).holds
    assert half_space(minor, radius=9e-3).holds
    pressure = contact.peak_pressure(hit.peak_force)
    assert no_crushing(pressure).ratio == pytest.approx(0.31, abs=0.01)
    # 20.0 us at 5721 m/s: sound goes to and fro three times
    waves = quasi_static(hit.contact_time, size=18e-3, young=72e9, density=2200.0)
    assert waves.ratio == pytest.approx(6.37, abs=5e-3)
    assert not waves.holds
    assert waves.sentence.endswith("rings while it is in contact")


def test_the_striker_of_the_paper_makes_a_point_contact() -> None:
    contact = sphere_on_cylinder(**QUARTZ)
    force = 236.1474973592  # N, the largest of striker and one cylinder at 0.8 m/s
    major, _ = contact.semi_axes(force)
    assert ellipse_on_body(major, half_height=9e-3).holds
    assert half_space(major, radius=9e-3).holds
    assert quasi_static(5.596816463565898e-05, size=18e-3, young=72e9, density=2200.0).holds
    # the weight of all 40 cylinders, at the end that bears it
    assert weightless(40 * MASS * 9.81, force).ratio == pytest.approx(3.955 / 236.15, rel=1e-3)
    assert not no_crushing(contact.peak_pressure(force)).holds
    assert FUSED_QUARTZ_TENSILE < FUSED_QUARTZ_COMPRESSIVE


# tension beside the ellipse


def tension_by_superposition(ratio: float, poisson: float) -> float:
    """Largest of the tensions at both ends, over p0: the pressure as similar ellipses of constant pressure.

    Outside the load the surface is stressed by ``-(1 - 2 nu)/(2 pi)`` times second derivatives of the logarithmic
    potential (Johnson 1985, section 3.6); that of an ellipse of density 1 with focal distance c has the complex slope
    ``2 pi a b/(z + sqrt(z^2 - c^2))``.
    """

    def at(z: complex) -> float:
        focal = 1.0 - ratio**2

        def shell(angle: float) -> float:  # s = sin(angle) of ellipses s a, s b; weight s ds/sqrt(1 - s^2)
            s = math.sin(angle)
            root = (z * z - s * s * focal) ** 0.5 if z.real else 1j * (s * s * focal - z * z).real ** 0.5
            return float((ratio * s**3 / (root * (z + root))).real)

        return (1.0 - 2.0 * poisson) * float(quad(shell, 0.0, 0.5 * math.pi, epsabs=0.0, epsrel=1e-11)[0])

    return max(at(1.0 + 0.0j), -at(1j * ratio))


@pytest.mark.parametrize("ratio", [1.0, 1.0 - 1e-9, 0.9, 0.63, 0.3, 0.05])
@pytest.mark.parametrize("poisson", [0.0, 0.17, 0.45])
def test_the_tension_at_the_edge_is_that_of_many_ellipses(ratio: float, poisson: float) -> None:
    assert edge_tension(3e8, poisson=poisson, axis_ratio=ratio) == pytest.approx(
        3e8 * tension_by_superposition(ratio, poisson), rel=1e-9
    )


@given(pressure=log_uniform(1e3, 1e11), poisson=st.floats(-0.5, 0.49))
def test_around_a_circle_it_is_a_third_of_the_pressure_and_none_where_nothing_gives_way(
    pressure: float, poisson: float
) -> None:
    # one factor that cancels towards nu = 1/2, alike on both sides
    assert edge_tension(pressure, poisson=poisson) == pytest.approx((1.0 - 2.0 * poisson) * pressure / 3.0, rel=1e-15)
    assert edge_tension(pressure, poisson=0.5) == 0.0


def test_it_agrees_with_the_textbook_where_that_does_not_cancel() -> None:
    for ratio in (0.1, 0.4, 0.7):
        e = math.sqrt(1.0 - ratio**2)
        at_major = ratio / e**2 * (math.atanh(e) / e - 1.0)
        # differences of about e^2/3 = 0.17 of their terms at 0.7
        assert edge_tension(1.0, poisson=0.0, axis_ratio=ratio) == pytest.approx(at_major, rel=1e-14)


def test_wrong_numbers_are_named() -> None:
    with pytest.raises(ValueError, match=r"axis_ratio = 1\.5; allowed: 0 < b/a <= 1"):
        edge_tension(1.0, poisson=0.2, axis_ratio=1.5)
    with pytest.raises(ValueError, match=r"poisson = 0\.7; allowed: a number above -1 and up to 0\.5"):
        edge_tension(1.0, poisson=0.7)
    with pytest.raises(ValueError, match="density = 0"):
        quasi_static(1.0, size=1.0, young=1.0, density=0)
