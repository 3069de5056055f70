"""Hertz's point contact of two smooth bodies, from their principal curvatures.

Near the point of touch the gap between the bodies is ``A x^2 + B y^2``, A <= B, and they meet on an ellipse of
semi-axes a >= b (Johnson 1985, *Contact Mechanics*, ch. 4). With k = b/a and e^2 = 1 - k^2 everything follows from the
integrals of Jahnke and Emde::

    b(k) = (E - k^2 K)/e^2        d(k) = (K - E)/e^2        K = b + d

Johnson's condition on the ellipse (section 4.2) is ``B/A = b/(k^2 d)`` in these integrals, and the stiffness is ::

    beta = (2 pi E*/3) K^(-3/2) [b d/(k^2 A B)]^(1/4)

They are evaluated (:func:`.ellipse_integrals`) without the cancellation of these forms at the circle (e -> 0).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

from dem_bridge.physics.contact_ellipse import (
    check_angle,
    ellipse_integrals,
)
from dem_bridge.physics.numbers import above, not_negative, number, poisson_ratio
from dem_bridge.physics.roots import root_between

#: source of the axis ratio: Hertz's exact condition, or the paper's b/a = (A/B)^(2/3)
AxisRatio = Literal["exact", "paper"]
#: degrees; below it :func:`angle_of_stiffness` treats two cylinders as parallel: over 1 m they diverge by 2e-8 m
SMALLEST_ANGLE = 1e-6
#: a stiffness may be below the minimum by this fraction: half a unit of the 12th digit, to which scenes round
_ROUNDED = 5e-12
#: a stiffness may be above the minimum by this fraction for the roundings in both: up to 3 units in the last place were
#: seen over 3,000 pairs of cylinders and four versions of libm
_ROUNDOFF = 4.0 * 2.0**-52


@dataclass(frozen=True)
class HertzContact:
    """Two bodies that meet on a contact ellipse, with ``F = stiffness overlap^1.5``.

    :func:`hertz_contact` and the functions for single geometries compute it.
    """

    stiffness: float
    """Stiffness beta, N/m^1.5."""
    axis_ratio: float
    """b/a of the contact ellipse, 0 < b/a <= 1."""
    curvatures: tuple[float, float]
    """Relative curvatures A <= B, 1/m: the gap between the bodies is ``A x^2 + B y^2``."""
    modulus: float
    """Contact modulus E* of both bodies, Pa."""

    def force(self, overlap: float) -> float:
        """Return the force at an overlap >= 0 (m), N."""
        return self.stiffness * math.pow(not_negative("overlap", overlap, "m"), 1.5)

    def overlap(self, force: float) -> float:
        """Return the overlap under a force >= 0 (N), m."""
        return math.cbrt(not_negative("force", force, "N") / self.stiffness) ** 2

    def semi_axes(self, force: float) -> tuple[float, float]:
        """Return the semi-axes a >= b of the contact ellipse under a force (N), m: ``a = 3 F K/(2 pi E* overlap)``."""
        major = self._major_of_one_newton() * math.cbrt(not_negative("force", force, "N"))
        return major, self.axis_ratio * major

    def peak_pressure(self, force: float) -> float:
        """Return the pressure at the centre of the ellipse under a force (N), Pa: ``3 F/(2 pi a b)``."""
        area = math.pi * self.axis_ratio * self._major_of_one_newton() ** 2
        return 1.5 * math.cbrt(not_negative("force", force, "N")) / area

    def _major_of_one_newton(self) -> float:
        """Return the semi-major axis under a force of 1 N, m; it scales as the cube root of the force."""
        integral_k = sum(ellipse_integrals(self.axis_ratio))
        return float(1.5 * integral_k / (math.pi * self.modulus) * self.stiffness ** (2.0 / 3.0))


def compliance(young_name: str, young: float, poisson_name: str, poisson: float) -> float:
    """Return ``(1 - nu^2)/Y`` of one body, 1/Pa; 0 for a rigid body (Y = inf).

    Raises
    ------
    ValueError
        If a value is outside its range; ``young_name`` and ``poisson_name`` are for the message.
    """
    young = above(0.0, young_name, young, "Pa", infinite="a rigid body")
    return (1.0 - poisson_ratio(poisson_name, poisson) ** 2) / young


def contact_modulus(
    young1: float, poisson1: float, young2: float | None = None, poisson2: float | None = None
) -> float:
    """Return the contact modulus E*, Pa: ``1/E* = (1 - nu1^2)/Y1 + (1 - nu2^2)/Y2``.

    Parameters
    ----------
    young1, young2 : float
        Young's moduli, Pa; inf for a rigid body. ``young2=None`` means ``young1``.
    poisson1, poisson2 : float
        Poisson's ratios; ``poisson2=None`` means ``poisson1``.

    Raises
    ------
    ValueError
        If both bodies are rigid or a value is outside its range.

    References
    ----------
    Johnson (1985), *Contact Mechanics*, section 4.2.

    Examples
    --------
    >>> round(contact_modulus(72e9, 0.17) / 1e9, 6), round(contact_modulus(72e9, 0.17, math.inf) / 1e9, 6)
    (37.071362, 74.142725)
    """
    young2, poisson2 = young1 if young2 is None else young2, poisson1 if poisson2 is None else poisson2
    soft = compliance("young1", young1, "poisson1", poisson1) + compliance("young2", young2, "poisson2", poisson2)
    if soft == 0.0:
        raise ValueError("young1 = young2 = inf; allowed: at least one deformable body")
    return 1.0 / soft


def relative_curvatures(
    first: tuple[float, float], second: tuple[float, float], angle: float = 0.0
) -> tuple[float, float]:
    """Return the relative curvatures (A, B), 1/m, A <= B, of two bodies in touch.

    A + B is half the sum of the four curvatures, and 4 A B is the determinant of the sum of the curvature tensors. The
    code avoids differences of nearly equal terms, so no digits are lost for cylinders at 0.001 degrees.

    Parameters
    ----------
    first, second : tuple of float
        Principal curvatures of each body, 1/m: positive if convex, 0 in a flat direction, negative if concave.
    angle : float
        Angle between the first direction of ``first`` and the first direction of ``second``, degrees; any value.

    Raises
    ------
    ValueError
        If there is no contact ellipse: A <= 0.

    References
    ----------
    Johnson (1985), *Contact Mechanics*, section 4.1.

    Examples
    --------
    >>> relative_curvatures((100.0, 0.0), (100.0, 0.0), 90.0), relative_curvatures((100.0, 100.0), (0.0, 0.0))
    ((50.0, 50.0), (50.0, 50.0))
    """
    (one1, two1), (one2, two2) = (
        tuple(number(f"{name}[{nth}]", value, "1/m") for nth, value in enumerate(pair))
        for name, pair in (("first", first), ("second", second))
    )
    sine, cosine = _sine_cosine(angle)
    total = 0.5 * (one1 + two1 + one2 + two2)
    along, across = one1 - two1 + one2 - two2, one1 - two1 - one2 + two2
    spread = 0.5 * math.hypot(along * cosine, across * sine)
    larger, smaller = 0.5 * (total + spread), 0.5 * (total - spread)
    if 2.0 * spread > total > 0.0:  # the difference would lose digits; the determinant does not
        alike, unlike = (one1 + one2) * (two1 + two2), (one1 + two2) * (two1 + one2)
        smaller = 0.25 * (alike * cosine * cosine + unlike * sine * sine) / larger
    if not (smaller > 0.0 and larger < math.inf):
        raise ValueError(
            f"relative curvatures A = {smaller:.6g}, B = {larger:.6g} 1/m of {first} and {second} at {angle} degrees; "
            "allowed: both > 0, since otherwise there is no contact ellipse; use physics.line_contact for parallel "
            "cylinders"
        )
    return smaller, larger


def hertz_contact(curvatures: tuple[float, float], modulus: float, *, law: AxisRatio = "exact") -> HertzContact:
    """Return the contact of two bodies with these relative curvatures and this contact modulus.

    Parameters
    ----------
    curvatures : tuple of float
        Relative curvatures (A, B), 1/m, 0 < A <= B.
    modulus : float
        Contact modulus E*, Pa.
    law : {"exact", "paper"}
        "exact" solves Hertz's condition on the axis ratio; "paper" uses ``b/a = (A/B)^(2/3)``, which is too stiff.

    Raises
    ------
    ValueError
        If a parameter is outside its range.

    References
    ----------
    Johnson (1985), *Contact Mechanics*, section 4.2 (both); Chaunsali, Kim & Yang (2018), below eq. 3.1 ("paper").

    Examples
    --------
    >>> contact = hertz_contact((50.0, 50.0), 37e9)  # as a sphere of 10 mm on a plane
    >>> contact.axis_ratio, bool(abs(contact.stiffness / (4 / 3 * 37e9 * 10e-3**0.5) - 1) < 1e-15)
    (1.0, True)
    """
    _check_law(law)
    smaller, larger = (above(0.0, f"curvatures[{nth}]", value, "1/m") for nth, value in enumerate(curvatures))
    if smaller > larger:
        raise ValueError(f"curvatures = {curvatures!r}; allowed: the smaller one first")
    modulus = above(0.0, "modulus", modulus, "Pa")
    ratio = math.exp(-_flattening(0.5 * math.log(larger / smaller), law))
    integral_b, integral_d = ellipse_integrals(ratio)
    shape = math.sqrt(math.sqrt(integral_b * integral_d / (ratio * ratio)))
    size = math.sqrt(math.sqrt(smaller) * math.sqrt(larger))
    stiffness = 2.0 * math.pi / 3.0 * modulus * (integral_b + integral_d) ** -1.5 * shape / size
    return HertzContact(stiffness=stiffness, axis_ratio=ratio, curvatures=(smaller, larger), modulus=modulus)


def crossed_cylinders(
    *,
    angle: float,
    radius: float,
    young: float,
    poisson: float,
    radius2: float | None = None,
    young2: float | None = None,
    poisson2: float | None = None,
    law: AxisRatio = "exact",
) -> HertzContact:
    """Return the contact of two cylinders whose axes cross at an angle.

    Parameters
    ----------
    angle : float
        Angle between the axes, degrees, 0 < angle <= 90.
    radius, radius2 : float
        Radii, m. The second cylinder's radius, modulus and Poisson's ratio equal the first one's unless they are given.
    young, young2 : float
        Young's moduli, Pa.
    poisson, poisson2 : float
        Poisson's ratios.
    law : {"exact", "paper"}
        Source of the axis ratio; see :func:`hertz_contact`.

    Raises
    ------
    ValueError
        If a parameter is outside its range.

    Examples
    --------
    >>> quartz = dict(radius=9e-3, young=72e9, poisson=0.17)
    >>> for law in ("exact", "paper"):
    ...     contact = crossed_cylinders(angle=2.0, law=law, **quartz)
    ...     print(f"{contact.stiffness:.6g} N/m^1.5, b/a {contact.axis_ratio:.5g}")
    6.17559e+10 N/m^1.5, b/a 0.0076064
    7.27299e+10 N/m^1.5, b/a 0.0045279
    """
    check_angle(angle)
    curvatures = relative_curvatures(_cylinder("radius", radius), _cylinder("radius2", radius2, radius), angle)
    return hertz_contact(curvatures, contact_modulus(young, poisson, young2, poisson2), law=law)


def sphere_on_cylinder(
    *,
    radius: float,
    young: float,
    poisson: float,
    radius2: float | None = None,
    young2: float | None = None,
    poisson2: float | None = None,
    law: AxisRatio = "exact",
) -> HertzContact:
    """Return the contact of a sphere of ``radius`` with the side of a cylinder of ``radius2``, both m.

    The other parameters are those of :func:`crossed_cylinders`; the cylinder's values equal the sphere's unless they
    are given.

    Examples
    --------
    >>> f"{sphere_on_cylinder(radius=9e-3, young=72e9, poisson=0.17).stiffness:.6g}"
    '3.98253e+09'
    """
    curvatures = relative_curvatures(_sphere("radius", radius), _cylinder("radius2", radius2, radius))
    return hertz_contact(curvatures, contact_modulus(young, poisson, young2, poisson2), law=law)


def sphere_on_sphere(
    *,
    radius: float,
    young: float,
    poisson: float,
    radius2: float | None = None,
    young2: float | None = None,
    poisson2: float | None = None,
) -> HertzContact:
    """Return the contact of two spheres, ``beta = (4/3) E* sqrt(R)`` with 1/R the sum of both curvatures.

    The parameters are those of :func:`crossed_cylinders`; ``radius2`` < 0 (m) is a hollow sphere around the first one.

    References
    ----------
    Johnson (1985), *Contact Mechanics*, section 4.2.

    Examples
    --------
    >>> two = sphere_on_sphere(radius=9e-3, young=72e9, poisson=0.17)
    >>> f"{two.stiffness:.6g} N/m^1.5, b/a {two.axis_ratio}"
    '3.31576e+09 N/m^1.5, b/a 1.0'
    """
    curvatures = relative_curvatures(_sphere("radius", radius), _sphere("radius2", radius2, radius))
    return hertz_contact(curvatures, contact_modulus(young, poisson, young2, poisson2))


def sphere_on_plane(
    *, radius: float, young: float, poisson: float, young2: float | None = None, poisson2: float | None = None
) -> HertzContact:
    """Return the contact of a sphere of ``radius`` (m) with a plane.

    The other parameters are those of :func:`crossed_cylinders`; ``young2=inf`` is a rigid plane, and the plane's values
    equal the sphere's unless they are given.

    Examples
    --------
    >>> f"{sphere_on_plane(radius=9e-3, young=72e9, poisson=0.17, young2=math.inf).stiffness:.6g}"
    '9.3784e+09'
    """
    curvatures = relative_curvatures(_sphere("radius", radius), (0.0, 0.0))
    return hertz_contact(curvatures, contact_modulus(young, poisson, young2, poisson2))


def angle_of_stiffness(
    stiffness: float, *, radius: float, young: float, poisson: float, law: AxisRatio = "exact"
) -> float:
    """Return the angle (degrees) at which two equal crossed cylinders have the stiffness beta (N/m^1.5).

    The stiffness falls from infinity at 0 to ``2 Y sqrt(r)/(3 (1 - nu^2))`` at 90 degrees. Both laws give angle and
    stiffness as functions of the axis ratio, so that only one root has to be found. The equation is solved for
    ``sqrt(ln(beta/beta_min))``, which is linear at the minimum of beta. The relative error of the angle is 1e-12 up to
    89.9 degrees. Nearer to 90, ``beta/beta_min = 1 + g^2/3`` for both laws, with g = 90 - angle in radians: a relative
    error eps of beta changes the angle by ``3 eps/(2 g)``, and by ``sqrt(3 eps)`` at 90. The beta of angles above
    89.999997 differs from the minimum by its roundings only (4 units in the last place), and 12 digits of beta
    distinguish angles from 90 that differ by 1e-4 degrees. For such a stiffness, and for one that is below the minimum
    by at most a fraction of 5e-12, the minimum rounded to 12 digits, the result is 90.

    Parameters
    ----------
    stiffness : float
        Stiffness beta, N/m^1.5.
    radius : float
        Radius of both cylinders, m.
    young : float
        Young's modulus, Pa.
    poisson : float
        Poisson's ratio.
    law : {"exact", "paper"}
        Source of the axis ratio; see :func:`hertz_contact`.

    Raises
    ------
    ValueError
        If the stiffness is below the minimum or above the value at 1e-6 degrees.

    Examples
    --------
    >>> quartz = dict(radius=9e-3, young=72e9, poisson=0.17)
    >>> round(angle_of_stiffness(7.27e10, law="paper", **quartz), 6), round(angle_of_stiffness(7.27e10, **quartz), 6)
    (2.000886, 1.648059)
    """
    _check_law(law)
    stiffness = above(0.0, "stiffness", stiffness, "N/m^1.5")
    least = 4.0 / 3.0 * contact_modulus(young, poisson) * math.sqrt(above(0.0, "radius", radius, "m"))
    deepest = _flattening(_stretch(SMALLEST_ANGLE), law)
    excess = (stiffness - least) / least
    if excess < -_ROUNDED or math.log1p(excess) > _log_stiffness(deepest, law):
        most = least * math.exp(_log_stiffness(deepest, law))
        raise ValueError(
            f"stiffness = {stiffness!r} N/m^1.5; allowed: from {least:.12g} (at 90 degrees) to {most:.4g} (at "
            f"{SMALLEST_ANGLE:g} degrees), the range of two such cylinders by the {law} law"
        )
    if excess <= _ROUNDOFF:
        return 90.0
    root_log = math.sqrt(math.log1p(excess))
    flattening = root_between(
        lambda trial: math.sqrt(max(_log_stiffness(trial, law), 0.0)) - root_log, 0.0, deepest, xtol=1e-15
    )
    return min(math.degrees(2.0 * math.atan(math.exp(-_stretch_of(flattening, law)))), 90.0)


def stiffness_slope(angle: float, *, law: AxisRatio = "exact") -> float:
    """Return ``d ln(beta)/d(angle)`` of two equal crossed cylinders, per degree; <= 0, and 0 at 90.

    A change of the stiffness by 1 % thus corresponds to ``0.01/|slope|`` degrees. By the exact law the slope is
    ``-(e^2/2) (d/K) cot(angle/2)`` per radian: the elastic energy is stationary in the pressure, so a change of a
    curvature contributes only through its mean under the pressure, F a^2/5 for A and F b^2/5 for B. The slope does not
    depend on radius or material.

    Parameters
    ----------
    angle : float
        Angle between the axes, degrees, 0 < angle <= 90.
    law : {"exact", "paper"}
        Source of the axis ratio; see :func:`hertz_contact`.

    Examples
    --------
    >>> [round(stiffness_slope(angle), 5) for angle in (2.0, 30.0, 89.0)]
    [-0.42014, -0.02167, -0.0002]
    """
    _check_law(law)
    check_angle(angle)
    stretch = _stretch(angle)
    if stretch == 0.0:
        return 0.0
    flattening = _flattening(stretch, law)
    ratio, squared_e = math.exp(-flattening), -math.expm1(-2.0 * flattening)
    integral_b, integral_d = ellipse_integrals(ratio)
    integral_k = integral_b + integral_d
    if law == "exact":
        slope = -0.5 * squared_e * integral_d / integral_k * math.exp(stretch)
    else:
        # d(d)/du, u = ln(a/b), and d(b)/du = b - d(d)/du; du/d(angle) = -(4/3)/sin
        derivative = (integral_b - ratio * ratio * integral_d) / squared_e
        shape = (integral_b - integral_d) * (derivative / (4.0 * integral_b * integral_d) - 0.75 / integral_k)
        sine, cosine = _sine_cosine(angle)
        slope = -(4.0 / 3.0 * shape + 0.5 * cosine) / sine
    return math.radians(slope)


# The flattening ln(a/b) and the stretch ln(B/A)/2 are 0 for the circle and odd functions about it; e^(-stretch) is
# tan(angle/2) for equal cylinders. Each law relates the two.


def _flattening(stretch: float, law: AxisRatio) -> float:
    """Return the flattening ln(a/b) of a stretch ln(B/A)/2."""
    if law == "paper" or stretch < 1e-6:  # near the circle the laws differ by a cubic term
        return 4.0 / 3.0 * stretch
    # as b <= d, the root is at least the stretch; it is at most the paper's value
    return root_between(lambda u: _stretch_of(u, law) - stretch, 0.99 * stretch, 1.4 * stretch, xtol=1e-15)


def _stretch_of(flattening: float, law: AxisRatio) -> float:
    """Return the stretch ln(B/A)/2 of a flattening ln(a/b)."""
    if law == "paper":
        return 0.75 * flattening
    integral_b, integral_d = ellipse_integrals(math.exp(-flattening))
    return flattening + 0.5 * math.log(integral_b / integral_d)


def _stretch(angle: float) -> float:
    """Return the stretch of two equal cylinders, ``-ln tan(angle/2) = asinh(cot(angle))``, exact also at 90 degrees."""
    sine, cosine = _sine_cosine(angle)
    return math.asinh(cosine / sine)


def _log_stiffness(flattening: float, law: AxisRatio) -> float:
    """Return ln(beta/beta_min) of two equal cylinders; each term is even in the flattening."""
    ratio = math.exp(-flattening)
    integral_b, integral_d = ellipse_integrals(ratio)
    integral_k = integral_b + integral_d
    circle = 16.0 / math.pi**2
    return (
        0.25 * math.log(circle * ratio * integral_b * integral_d)
        - 1.5 * math.log(2.0 / math.pi * math.sqrt(ratio) * integral_k)
        + 0.5 * math.log(math.cosh(_stretch_of(flattening, law)))
    )


def _sine_cosine(angle: float) -> tuple[float, float]:
    """Return sine and cosine of an angle in degrees, to full precision.

    The angle is reduced to 0..90 first, so that both are exact at the ends.
    """
    acute = abs(math.remainder(number("angle", angle, "degrees"), 180.0))
    if acute <= 45.0:
        return math.sin(math.radians(acute)), math.cos(math.radians(acute))
    return math.cos(math.radians(90.0 - acute)), math.sin(math.radians(90.0 - acute))


def _sphere(name: str, radius: float | None, otherwise: float = math.nan) -> tuple[float, float]:
    """Return the two principal curvatures of a sphere, 1/m."""
    radius = number(name, otherwise if radius is None else radius, "m")
    if radius == 0.0:
        raise ValueError(f"{name} = 0.0; allowed: a finite number > 0 (m), or < 0 where the sphere is hollow")
    return 1.0 / radius, 1.0 / radius


def _cylinder(name: str, radius: float | None, otherwise: float = math.nan) -> tuple[float, float]:
    """Return the two principal curvatures of a cylinder, 1/m."""
    return 1.0 / above(0.0, name, otherwise if radius is None else radius, "m"), 0.0


def _check_law(law: str) -> None:
    """Raise ValueError unless ``law`` is one of the laws for the axis ratio."""
    if law not in get_args(AxisRatio):
        raise ValueError(f"law = {law!r}; allowed: {' or '.join(get_args(AxisRatio))}")
