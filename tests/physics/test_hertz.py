"""Hertz's ellipse against its own integral equation, 60 digits, identities, and the paper's law beside it."""

from __future__ import annotations

import math
from decimal import Decimal, localcontext
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from dem_bridge.physics.contact_ellipse import cylinder_stiffness_paper
from dem_bridge.physics.hertz import (
    SMALLEST_ANGLE,
    AxisRatio,
    HertzContact,
    angle_of_stiffness,
    contact_modulus,
    crossed_cylinders,
    hertz_contact,
    relative_curvatures,
    sphere_on_cylinder,
    sphere_on_plane,
    sphere_on_sphere,
    stiffness_slope,
)
from tests.helpers.high_precision import DIGITS, complete_elliptic, cosine, pi
from tests.helpers.strategies import log_uniform

QUARTZ: dict[str, Any] = {"radius": 9e-3, "young": 72e9, "poisson": 0.17}
LAWS: tuple[AxisRatio, ...] = ("exact", "paper")
EPS = float(np.finfo(float).eps)

radii = log_uniform(1e-4, 1.0)
youngs = log_uniform(1e6, 1e12)
poissons = st.floats(-0.5, 0.5)
any_angle = st.floats(-720.0, 720.0)
curvature = st.floats(-200.0, 500.0)
pairs = st.tuples(curvature, curvature)
laws = st.sampled_from(LAWS)


def crossed(angle: float, law: AxisRatio = "exact") -> float:
    return crossed_cylinders(angle=angle, law=law, **QUARTZ).stiffness


def angle_of(stiffness: float, law: AxisRatio = "exact") -> float:
    return angle_of_stiffness(stiffness, law=law, **QUARTZ)


# the published numbers


def test_the_numbers_of_the_papers_contacts() -> None:
    # half a unit of the last printed digit each
    assert sphere_on_cylinder(**QUARTZ).stiffness == pytest.approx(3.98253e9, abs=0.5e4)
    contact = crossed_cylinders(angle=2.0, **QUARTZ)
    assert contact.stiffness == pytest.approx(6.17559e10, abs=0.5e5)
    assert contact.axis_ratio == pytest.approx(0.0076064, abs=0.5e-7)


@pytest.mark.parametrize(
    ("angle", "factor", "half_unit"),
    [
        (2.0, 1.1777, 5e-5),
        (5.0, 1.094, 5e-4),
        (10.0, 1.047, 5e-4),
        (30.0, 1.0068, 5e-5),
        (60.0, 1.00027, 1e-5),
        (0.1, 1.62, 5e-3),
        (0.001, 2.97, 5e-3),
    ],
)
def test_the_paper_is_too_stiff_by(angle: float, factor: float, half_unit: float) -> None:
    assert crossed(angle, "paper") / crossed(angle) == pytest.approx(factor, abs=half_unit)


@given(angle=st.one_of(st.floats(1e-3, 90.0), log_uniform(1e-6, 90.0)), radius=radii, young=youngs, poisson=poissons)
def test_with_the_papers_ratio_it_is_the_papers_stiffness(
    angle: float, radius: float, young: float, poisson: float
) -> None:
    angle = min(angle, 90.0)
    body = {"radius": radius, "young": young, "poisson": poisson}
    assert crossed_cylinders(angle=angle, law="paper", **body).stiffness == pytest.approx(
        cylinder_stiffness_paper(angle, **body), rel=1e-14
    )


# the exact law, by ways that share nothing with it


def ellipse_integrals(major: float, minor: float) -> tuple[float, float, float]:
    """``int_0^inf dx/(s W)``, W = sqrt((a^2+x)(b^2+x)x), with s = a^2+x, b^2+x and 1 (Landau & Lifshitz, section 9).

    The trapezium rule in ln x: the integrands are analytic in a strip about the axis and fall off exponentially, as
    x^(1/2) and x^(-1/2) at the slowest, so that steps of 0.1 from x = e^-80 b^2 to e^80 a^2 leave round-off alone.
    """
    step = 0.1
    log = np.arange(2.0 * math.log(minor) - 80.0, 2.0 * math.log(major) + 80.0, step)
    x = np.exp(log)
    of_major, of_minor = major**2 + x, minor**2 + x
    weight: NDArray[np.float64] = step * np.sqrt(x / (of_major * of_minor))
    return float(np.sum(weight / of_major)), float(np.sum(weight / of_minor)), float(np.sum(weight))


def misfit(contact: HertzContact, force: float) -> float:
    """How far the ellipse, its pressure and the overlap miss Hertz's integral equation; the largest relative part."""
    major, minor = contact.semi_axes(force)
    of_major, of_minor, whole = ellipse_integrals(major, minor)
    factor = 0.75 * force / (math.pi * contact.modulus)
    smaller, larger = contact.curvatures
    found = (factor * of_major / smaller, factor * of_minor / larger, factor * whole / contact.overlap(force))
    return max(abs(one - 1.0) for one in found)


@given(ratio=log_uniform(1e-9, 1.0), size=log_uniform(1e-2, 1e4), modulus=log_uniform(1e6, 1e12))
def test_ellipse_and_overlap_solve_hertzs_equation(ratio: float, size: float, modulus: float) -> None:
    contact = hertz_contact((min(ratio, 1.0) * size, size), modulus)
    # a sum of some 2000 terms of a few ulps each, and axes to the third power
    assert misfit(contact, 3.0) < 1e-13


def test_the_papers_ratio_does_not_solve_it() -> None:
    for angle, least in ((2.0, 0.3), (30.0, 1e-2), (60.0, 5e-4)):
        assert misfit(crossed_cylinders(angle=angle, law="paper", **QUARTZ), 3.0) > least


def exact_in_60_digits(angle: float, start: float) -> tuple[float, float]:
    """Stiffness and axis ratio with the condition as printed, [(a/b)^2 E - K]/[K - E] = (1+cos)/(1-cos)."""
    with localcontext() as context:
        context.prec = DIGITS
        cos = cosine(Decimal(angle) * pi() / 180)
        wanted = ((1 + cos) / (1 - cos)).ln()

        def beside(ratio: Decimal) -> Decimal:
            k, e = complete_elliptic(1 - ratio**2)
            return ((e / ratio**2 - k) / (k - e)).ln() - wanted

        one, other = Decimal(start), Decimal(start) * (1 - Decimal("1e-6"))
        at_one, at_other = beside(one), beside(other)
        while abs(one - other) > Decimal("1e-25") * one:  # the secant rule
            one, other = one - at_one * (one - other) / (at_one - at_other), one
            at_one, at_other = beside(one), at_one
        squared = 1 - one**2
        k, e = complete_elliptic(squared)
        braces = 4 / (pi() * squared) * ((e / one**2 - k) * (k - e)).sqrt()
        modulus = 2 * Decimal(QUARTZ["young"]) / (3 * (1 - Decimal(QUARTZ["poisson"]) ** 2))
        geometry = (Decimal(QUARTZ["radius"]) / (1 - cos**2).sqrt()).sqrt()
        return float(modulus * geometry * (2 * k / pi()) ** Decimal("-1.5") * braces.sqrt()), float(one)


@pytest.mark.parametrize("angle", [1e-3, 0.01, 0.1, 1.0, 2.0, 5.0, 17.3, 45.0, 60.0, 85.0, 89.0, 89.9])
def test_the_exact_law_in_60_digits(angle: float) -> None:
    contact = crossed_cylinders(angle=angle, **QUARTZ)
    stiffness, ratio = exact_in_60_digits(angle, start=0.9 * contact.axis_ratio)
    # the root is sought to 1e-15 in ln(a/b), and rounded where that is up to 16; the stiffness goes as its power 1/4
    assert contact.axis_ratio == pytest.approx(ratio, rel=40.0 * EPS)
    assert contact.stiffness == pytest.approx(stiffness, rel=20.0 * EPS)


@given(radius=radii, radius2=radii, young=youngs, poisson=poissons)
def test_spheres_are_elementary(radius: float, radius2: float, young: float, poisson: float) -> None:
    one = sphere_on_sphere(radius=radius, young=young, poisson=poisson, radius2=radius2)
    reduced = 1.0 / (1.0 / radius + 1.0 / radius2)
    modulus = young / (2.0 * (1.0 - poisson**2))
    assert one.axis_ratio == 1.0
    # roots and quotients of an ulp each
    assert one.stiffness == pytest.approx(4.0 / 3.0 * modulus * math.sqrt(reduced), rel=12.0 * EPS)
    force = 7.0
    radius_of_contact = (3.0 * force * reduced / (4.0 * modulus)) ** (1.0 / 3.0)
    assert one.semi_axes(force) == pytest.approx((radius_of_contact,) * 2, rel=12.0 * EPS)
    assert one.overlap(force) == pytest.approx(radius_of_contact**2 / reduced, rel=24.0 * EPS)
    pressure = (6.0 * force * modulus**2 / (math.pi**3 * reduced**2)) ** (1.0 / 3.0)
    assert one.peak_pressure(force) == pytest.approx(pressure, rel=24.0 * EPS)


def test_cylinders_at_90_degrees_are_a_sphere_on_a_plane_and_nothing_jumps_beside_it() -> None:
    sphere = sphere_on_plane(**QUARTZ)
    for law in LAWS:
        right = crossed_cylinders(angle=90.0, law=law, **QUARTZ)
        assert right.axis_ratio == 1.0
        assert right.stiffness == pytest.approx(sphere.stiffness, rel=4.0 * EPS)
        for beside in (math.nextafter(90.0, 0.0), 90.0 - 1e-9, 90.0 - 1e-6):
            contact = crossed_cylinders(angle=beside, law=law, **QUARTZ)
            assert contact.stiffness == pytest.approx(sphere.stiffness, rel=8.0 * EPS)
            # b/a = 1 - 4 g/3 for both laws, g^2 is 3e-16
            gap = math.radians(90.0 - beside)
            assert 1.0 - contact.axis_ratio == pytest.approx(4.0 / 3.0 * gap, abs=8.0 * EPS)


def test_a_sphere_on_an_ever_wider_cylinder_is_one_on_a_plane() -> None:
    plane = sphere_on_plane(**QUARTZ).stiffness
    found = [sphere_on_cylinder(radius2=9e-3 * wide, **QUARTZ).stiffness / plane - 1.0 for wide in (1e2, 1e4, 1e6)]
    # 1/R grows by 1/(2 wide) of itself, and beta goes as sqrt(R)
    assert found == pytest.approx([-0.25e-2, -0.25e-4, -0.25e-6], rel=1e-2)


# curvatures


def curvature_matrix(pair: tuple[float, float], angle: float) -> NDArray[np.float64]:
    cos, sin = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    turn = np.array([[cos, -sin], [sin, cos]])
    return np.asarray(turn @ np.diag(pair) @ turn.T)


@given(first=pairs, second=pairs, angle=any_angle)
def test_curvatures_are_the_eigenvalues_of_half_the_sum(
    first: tuple[float, float], second: tuple[float, float], angle: float
) -> None:
    expected = np.linalg.eigvalsh(0.5 * (curvature_matrix(first, 0.0) + curvature_matrix(second, angle)))
    assume(expected[0] > 1.0)
    # eigenvalues are good to some ulps of the largest entry, 500; the angle to 720 degrees' ulp
    assert relative_curvatures(first, second, angle) == pytest.approx(expected, abs=1e-11)


@given(first=pairs, second=pairs, angle=st.integers(-720, 720), turns=st.integers(-3, 3))
def test_which_body_is_first_and_half_turns_do_not_matter(
    first: tuple[float, float], second: tuple[float, float], angle: int, turns: int
) -> None:
    try:
        found = relative_curvatures(first, second, angle)
    except ValueError:
        assume(False)
    assert relative_curvatures(first, second, -angle + 180 * turns) == found
    # sums in another order: a few ulps of the largest term, 500, over B, or of B itself
    tolerance = 16.0 * EPS * 500.0 * (1.0 + 1000.0 / found[1])
    assert relative_curvatures(second, first, angle) == pytest.approx(found, abs=tolerance)
    quarter = relative_curvatures(first[::-1], second, angle + 90)
    assert quarter == pytest.approx(found, abs=tolerance)


@given(angle=log_uniform(1e-9, 45.0), radius=radii)
def test_crossed_cylinders_lose_nothing_at_small_angles(angle: float, radius: float) -> None:
    found = relative_curvatures((1.0 / radius, 0.0), (1.0 / radius, 0.0), angle)
    half = math.radians(angle) / 2.0
    assert found == pytest.approx((math.sin(half) ** 2 / radius, math.cos(half) ** 2 / radius), rel=12.0 * EPS)


@pytest.mark.parametrize(
    ("first", "second", "angle"),
    [
        ((100.0, 0.0), (100.0, 0.0), 0.0),  # parallel cylinders
        ((100.0, 0.0), (100.0, 0.0), 180.0),
        ((100.0, 0.0), (0.0, 0.0), 30.0),  # a cylinder on a plane
        ((0.0, 0.0), (0.0, 0.0), 0.0),
        ((100.0, 100.0), (-100.0, -100.0), 0.0),  # a ball in its own seat
        ((100.0, 100.0), (-120.0, 0.0), 0.0),  # in too narrow a groove
        ((-100.0, -100.0), (-100.0, 0.0), 45.0),
    ],
)
def test_bodies_without_a_contact_ellipse_are_refused(
    first: tuple[float, float], second: tuple[float, float], angle: float
) -> None:
    with pytest.raises(ValueError, match=r"^relative curvatures A = .*; allowed: both > 0, since .*$") as caught:
        relative_curvatures(first, second, angle)
    assert "\n" not in str(caught.value)


def test_a_ball_in_a_groove_is_softer_to_press_the_closer_they_fit() -> None:
    fits = [hertz_contact(relative_curvatures((100.0, 100.0), (-hollow, 0.0)), 37e9) for hollow in (0.0, 50.0, 99.0)]
    assert fits[0].stiffness < fits[1].stiffness < fits[2].stiffness
    assert fits[0].axis_ratio > fits[1].axis_ratio > fits[2].axis_ratio


# scaling, materials


@given(angle=st.floats(0.01, 90.0), factor=log_uniform(1e-3, 1e3), law=laws)
def test_stiffness_goes_as_the_modulus_and_the_root_of_the_radius(angle: float, factor: float, law: AxisRatio) -> None:
    one = crossed_cylinders(angle=angle, law=law, **QUARTZ)
    stiffer = crossed_cylinders(angle=angle, law=law, **{**QUARTZ, "young": factor * 72e9})
    assert stiffer.stiffness == pytest.approx(factor * one.stiffness, rel=8.0 * EPS)
    wider = crossed_cylinders(angle=angle, law=law, **{**QUARTZ, "radius": factor * 9e-3})
    # ln(B/A) is that of other roundings, up to 17 with an ulp of its own
    assert wider.stiffness == pytest.approx(math.sqrt(factor) * one.stiffness, rel=40.0 * EPS)
    assert wider.axis_ratio == pytest.approx(one.axis_ratio, rel=40.0 * EPS)


@given(force=log_uniform(1e-6, 1e6), factor=st.floats(0.1, 10.0), angle=st.floats(0.01, 90.0))
def test_axes_go_as_the_cube_root_of_the_force_and_force_and_overlap_are_inverse(
    force: float, factor: float, angle: float
) -> None:
    contact = crossed_cylinders(angle=angle, **QUARTZ)
    (major, minor), root = contact.semi_axes(force), math.cbrt(factor)
    assert contact.semi_axes(factor * force) == pytest.approx((root * major, root * minor), rel=8.0 * EPS)
    assert contact.peak_pressure(factor * force) == pytest.approx(root * contact.peak_pressure(force), rel=8.0 * EPS)
    assert contact.peak_pressure(force) == pytest.approx(1.5 * force / (math.pi * major * minor), rel=12.0 * EPS)
    assert contact.force(contact.overlap(force)) == pytest.approx(force, rel=8.0 * EPS)


def test_without_force_there_is_no_contact() -> None:
    contact = crossed_cylinders(angle=2.0, **QUARTZ)
    assert (contact.overlap(0.0), contact.force(0.0), contact.semi_axes(0.0), contact.peak_pressure(0.0)) == (
        0.0,
        0.0,
        (0.0, 0.0),
        0.0,
    )


@given(angle=st.floats(0.01, 90.0), radius=radii, radius2=radii, young=youngs, young2=youngs)
def test_two_different_bodies_may_change_places(
    angle: float, radius: float, radius2: float, young: float, young2: float
) -> None:
    one = crossed_cylinders(
        angle=angle, radius=radius, radius2=radius2, young=young, young2=young2, poisson=0.17, poisson2=0.3
    )
    other = crossed_cylinders(
        angle=angle, radius=radius2, radius2=radius, young=young2, young2=young, poisson=0.3, poisson2=0.17
    )
    assert other.stiffness == pytest.approx(one.stiffness, rel=40.0 * EPS)


def test_a_rigid_body_doubles_the_modulus_and_two_have_none() -> None:
    assert contact_modulus(72e9, 0.17, math.inf) == pytest.approx(2.0 * contact_modulus(72e9, 0.17), rel=2.0 * EPS)
    assert contact_modulus(1e9, 0.3, 4e9, 0.2) == pytest.approx(1.0 / (0.91e-9 + 0.24e-9), rel=8.0 * EPS)
    with pytest.raises(ValueError, match="at least one deformable body"):
        contact_modulus(math.inf, 0.17)


# the angle of a stiffness


@given(angle=st.one_of(log_uniform(1e-3, 89.9), st.floats(1e-3, 89.9)), law=laws)
def test_the_angle_of_the_stiffness_of_an_angle_is_that_angle(angle: float, law: AxisRatio) -> None:
    angle = min(max(angle, 1e-3), 89.9)
    assert angle_of(crossed(angle, law), law) == pytest.approx(angle, rel=1e-12)


@pytest.mark.parametrize("angle", [1e-3, 2.0, 60.0, 89.0, 89.85, 89.9])
def test_so_it_is_for_the_papers_own_writing(angle: float) -> None:
    assert angle_of(cylinder_stiffness_paper(angle, **QUARTZ), "paper") == pytest.approx(angle, rel=1e-12)


@given(beyond=log_uniform(1e-16, 1e6), law=laws)
def test_the_stiffness_of_the_angle_of_a_stiffness_is_that_stiffness(beyond: float, law: AxisRatio) -> None:
    stiffness = crossed(90.0) * (1.0 + beyond)
    assume(stiffness < crossed(SMALLEST_ANGLE, law))
    assert crossed(angle_of(stiffness, law), law) == pytest.approx(stiffness, rel=1e-13)


@given(gap=log_uniform(1e-9, 0.1), law=laws)
def test_near_90_degrees_the_angle_is_as_good_as_the_digits_of_the_stiffness(gap: float, law: AxisRatio) -> None:
    angle = 90.0 - math.degrees(gap)
    found = math.radians(90.0 - angle_of(crossed(angle, law), law))
    # beta/beta_min - 1 = g^2/3 is known to some ulps: of the last product, of the minimum, and of the logarithms
    assert abs(found**2 - gap**2) / 3.0 < 8.0 * EPS


def test_the_ends_of_what_the_angle_can_be_told_from_are_as_documented() -> None:
    for law in LAWS:
        least = crossed(90.0, law)
        assert crossed(89.999998, law) == pytest.approx(least, rel=4.0 * EPS)
        assert f"{crossed(89.99995, law):.12g}" == f"{least:.12g}"
        assert f"{crossed(89.9998, law):.12g}" != f"{least:.12g}"
        gap = 0.01
        assert crossed(90.0 - math.degrees(gap), law) / least - 1.0 == pytest.approx(gap**2 / 3.0, rel=gap**2)


def test_a_minimum_that_was_rounded_to_12_digits_or_to_the_last_is_90_degrees() -> None:
    least = 4.0 / 3.0 * contact_modulus(QUARTZ["young"], QUARTZ["poisson"]) * math.sqrt(QUARTZ["radius"])
    for law in LAWS:
        # 3 units in the last place, as other versions of libm make them; 6 are an angle
        assert angle_of(least * (1.0 + 3.0 * EPS), law) == 90.0
        assert angle_of(least * (1.0 + 6.0 * EPS), law) < 90.0
        assert angle_of(crossed(90.0, law), law) == 90.0
        assert angle_of(float(f"{crossed(90.0, law):.12g}"), law) == pytest.approx(90.0, abs=3e-4)
        assert angle_of(crossed(90.0, law) * (1.0 - 4e-12), law) == 90.0


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("stiffness", [4.68e9, 4.6891e9, 1e30])
def test_a_stiffness_that_no_angle_has_is_refused_with_both_ends(stiffness: float, law: AxisRatio) -> None:
    with pytest.raises(ValueError, match=r"allowed: from 4689197642\.51 \(at 90 degrees\) to .* \(at 1e-06") as caught:
        angle_of(stiffness, law)
    assert repr(stiffness) in str(caught.value)
    assert f"{crossed(SMALLEST_ANGLE, law):.4g}" in str(caught.value)
    assert "\n" not in str(caught.value)


# how steep


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("angle", [1e-3, 0.1, 2.0, 10.0, 45.0, 80.0, 89.0])
def test_the_slope_is_that_of_a_difference(angle: float, law: AxisRatio) -> None:
    def difference(step: float) -> float:
        return (math.log(crossed(angle * (1 + step), law)) - math.log(crossed(angle * (1 - step), law))) / (
            2.0 * step * angle
        )

    # central differences extrapolated: an error of step^4; round-off 20 eps/(2 step), over the slope per part of angle
    step = 1e-3
    extrapolated = (4.0 * difference(step) - difference(2.0 * step)) / 3.0
    slope = stiffness_slope(angle, law=law)
    assert extrapolated == pytest.approx(slope, abs=20.0 * EPS / (step * angle) + 1e-10 * abs(slope))


@given(gap=log_uniform(1e-6, 1e-2), law=laws)
def test_the_slope_is_flat_at_90_degrees(gap: float, law: AxisRatio) -> None:
    # ln(beta) = g^2/3 + O(g^4); noise of the axis ratio, eps, over its distance from 1
    slope = stiffness_slope(90.0 - math.degrees(gap), law=law)
    assert slope == pytest.approx(-math.radians(2.0 / 3.0 * gap), rel=gap**2 + 100.0 * EPS / gap)
    assert stiffness_slope(90.0, law=law) == 0.0


def test_a_hundredth_of_the_stiffness_is_a_fortieth_of_a_degree_at_2_degrees() -> None:
    off = 0.01 / -stiffness_slope(2.0)
    assert off == pytest.approx(0.0238, abs=5e-5)
    # and so it is: to the second order of 1 %
    assert crossed(2.0 + off) / crossed(2.0) == pytest.approx(0.99, abs=2e-4)


# what is refused


@pytest.mark.parametrize("angle", [0.0, -2.0, 90.0001, math.inf, math.nan])
def test_angles_that_no_two_cylinders_have_are_refused(angle: float) -> None:
    for ask in (lambda: crossed(angle), lambda: stiffness_slope(angle)):
        with pytest.raises(ValueError, match=rf"contact angle = {angle!r} degrees; allowed: 0 < angle <= 90"):
            ask()


def test_wrong_numbers_are_named() -> None:
    with pytest.raises(ValueError, match="radius = -1"):
        crossed_cylinders(angle=2.0, radius=-1.0, young=72e9, poisson=0.17)
    with pytest.raises(ValueError, match="radius2 = 0"):
        sphere_on_sphere(radius2=0.0, **QUARTZ)
    with pytest.raises(ValueError, match="young2 = nan"):
        sphere_on_plane(young2=math.nan, **QUARTZ)
    with pytest.raises(ValueError, match=r"poisson1 = 0\.6; allowed: a number above -1 and up to 0\.5"):
        contact_modulus(72e9, 0.6)
    with pytest.raises(ValueError, match="the smaller one first"):
        hertz_contact((2.0, 1.0), 1e9)
    with pytest.raises(ValueError, match="curvatures\\[0\\] = 0"):
        hertz_contact((0.0, 1.0), 1e9)
    with pytest.raises(ValueError, match="law = 'hertz'; allowed: exact or paper"):
        hertz_contact((1.0, 1.0), 1e9, law="hertz")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"force = -1\.0; allowed: a number >= 0"):
        crossed_cylinders(angle=2.0, **QUARTZ).semi_axes(-1.0)
    with pytest.raises(ValueError, match="stiffness = nan"):
        angle_of(math.nan)
