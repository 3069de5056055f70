"""Hertz's point contact of any two smooth bodies, by their principal curvatures.

Near touch the bodies part by ``A x^2 + B y^2``, A <= B, and meet on an ellipse of semi-axes a >= b (Johnson 1985,
*Contact Mechanics*, ch. 4). With k = b/a and e^2 = 1 - k^2 everything follows from the integrals of Jahnke and Emde::

    b(k) = (E - k^2 K)/e^2 = k^2 R_D(0, 1, k^2)/3        d(k) = (K - E)/e^2 = R_D(0, k^2, 1)/3        K = b + d

Johnson's condition on the ellipse (section 4.2) reads ``B/A = b/(k^2 d)`` in them, and the stiffness is ::

    beta = (2 pi E*/3) K^(-3/2) [b d/(k^2 A B)]^(1/4)

The right-hand sides are Carlson's integrals (1979, *Numer. Math.* 33, eq. 4.6; DLMF 19.25.1): the circle (e -> 0) and
the line (k -> 0) cost no digits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

from dem_bridge.physics.contact import check_angle
from dem_bridge.physics.valid import above, number

#: where the axis ratio comes from: Hertz's own condition, or the paper's b/a = (A/B)^(2/3)
AxisRatio = Literal["exact", "paper"]
#: degrees; below it :func:`angle_of_stiffness` calls two cylinders parallel: 1 m of them parts by 2e-8 m
SMALLEST_ANGLE = 1e-6
#: a stiffness may be below the smallest by this part of it: half a unit of the 12th digit, to which scenes round
_ROUNDED = 5e-12


def not_negative(name: str, value: float, unit: str) -> float:
    """``value`` as a finite float >= 0; ValueError, in one line, where it is none."""
    if number(name, value, unit) < 0.0:
        raise ValueError(f"{name} = {value!r}; allowed: a number >= 0 ({unit})")
    return float(value)


def poisson_ratio(name: str, value: float) -> float:
    """``value`` as a float above -1 and up to 0.5; ValueError, in one line, where it is none."""
    if not -1.0 < number(name, value) <= 0.5:
        raise ValueError(f"{name} = {value!r}; allowed: a number above -1 and up to 0.5")
    return float(value)


@dataclass(frozen=True)
class HertzContact:
    """Two bodies on a contact ellipse: ``F = stiffness overlap^1.5``. Made by :func:`hertz_contact` and its kin."""

    stiffness: float
    """beta, N/m^1.5."""
    axis_ratio: float
    """b/a of the contact ellipse, 0 < b/a <= 1."""
    curvatures: tuple[float, float]
    """Relative curvatures A <= B, 1/m: the bodies part by ``A x^2 + B y^2``."""
    modulus: float
    """E* of both bodies, Pa."""

    def force(self, overlap: float) -> float:
        """N, at an overlap >= 0 in m."""
        return self.stiffness * math.pow(not_negative("overlap", overlap, "m"), 1.5)

    def overlap(self, force: float) -> float:
        """m, under a force >= 0 in N."""
        return math.cbrt(not_negative("force", force, "N") / self.stiffness) ** 2

    def semi_axes(self, force: float) -> tuple[float, float]:
        """Semi-axes a >= b of the contact ellipse under a force (N), m: ``a = 3 F K/(2 pi E* overlap)``."""
        major = self._major_of_one_newton() * math.cbrt(not_negative("force", force, "N"))
        return major, self.axis_ratio * major

    def peak_pressure(self, force: float) -> float:
        """Largest pressure under a force (N), Pa: ``3 F/(2 pi a b)``, in the middle of the ellipse."""
        area = math.pi * self.axis_ratio * self._major_of_one_newton() ** 2
        return 1.5 * math.cbrt(not_negative("force", force, "N")) / area

    def _major_of_one_newton(self) -> float:
        integral_k = sum(_integrals(self.axis_ratio))
        return float(1.5 * integral_k / (math.pi * self.modulus) * self.stiffness ** (2.0 / 3.0))


def compliance(young_name: str, young: float, poisson_name: str, poisson: float) -> float:
    """``(1 - nu^2)/Y`` of one body, 1/Pa; 0 for a rigid one (Y = inf). The names are for the ValueError's line."""
    young = above(0.0, young_name, young, "Pa", infinite="a rigid body")
    return (1.0 - poisson_ratio(poisson_name, poisson) ** 2) / young


def contact_modulus(
    young1: float, poisson1: float, young2: float | None = None, poisson2: float | None = None
) -> float:
    """E*, Pa: ``1/E* = (1 - nu1^2)/Y1 + (1 - nu2^2)/Y2`` (Johnson 1985, section 4.2).

    Young's moduli in Pa, inf for a rigid body; what is None is as the first body's. ValueError where both are rigid.

    >>> round(contact_modulus(72e9, 0.17) / 1e9, 6), round(contact_modulus(72e9, 0.17, math.inf) / 1e9, 6)
    (37.071362, 74.142725)
    """
    young2, poisson2 = young1 if young2 is None else young2, poisson1 if poisson2 is None else poisson2
    soft = compliance("young1", young1, "poisson1", poisson1) + compliance("young2", young2, "poisson2", poisson2)
    if soft == 0.0:
        raise ValueError("young1 = young2 = inf; allowed: at least one body that yields")
    return 1.0 / soft


def relative_curvatures(
    first: tuple[float, float], second: tuple[float, float], angle: float = 0.0
) -> tuple[float, float]:
    """Relative curvatures (A, B), 1/m, A <= B, of two bodies in touch (Johnson 1985, section 4.1).

    ``first``, ``second``: principal curvatures of each body, 1/m: positive where it bulges, 0 for a flat direction,
    negative where it is hollow. ``angle`` (degrees, any): between the first of ``first`` and the first of ``second``.
    ValueError where there is no ellipse: A <= 0.

    A + B is half the sum of the four and 4 A B the determinant of the curvatures' sum; both are written without the
    differences of nearly equal terms, so cylinders at 0.001 degrees lose nothing.

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
    if 2.0 * spread > total > 0.0:  # the difference loses digits, the determinant does not
        alike, unlike = (one1 + one2) * (two1 + two2), (one1 + two2) * (two1 + one2)
        smaller = 0.25 * (alike * cosine * cosine + unlike * sine * sine) / larger
    if not (smaller > 0.0 and larger < math.inf):
        raise ValueError(
            f"relative curvatures A = {smaller:.6g}, B = {larger:.6g} 1/m of {first} and {second} at {angle} degrees; "
            "allowed: both > 0, or there is no contact ellipse (for parallel cylinders: physics.line_contact)"
        )
    return smaller, larger


def hertz_contact(curvatures: tuple[float, float], modulus: float, *, law: AxisRatio = "exact") -> HertzContact:
    """The contact of relative ``curvatures`` (A, B; 1/m, 0 < A <= B) and ``modulus`` E* (Pa).

    ``law``: "exact" solves Hertz's condition on the axis ratio (Johnson 1985, section 4.2); "paper" takes
    ``b/a = (A/B)^(2/3)`` (Chaunsali, Kim & Yang 2018, below eq. 3.1; Johnson 1985, section 4.2), and is too stiff.
    ValueError for what is no such number.

    >>> contact = hertz_contact((50.0, 50.0), 37e9)  # as a sphere of 10 mm on a plane
    >>> contact.axis_ratio, bool(abs(contact.stiffness / (4 / 3 * 37e9 * 10e-3**0.5) - 1) < 1e-15)
    (1.0, True)
    """
    _check_law(law)
    smaller, larger = (above(0.0, f"curvatures[{nth}]", value, "1/m") for nth, value in enumerate(curvatures))
    if smaller > larger:
        raise ValueError(f"curvatures = {curvatures!r}; allowed: the smaller first")
    modulus = above(0.0, "modulus", modulus, "Pa")
    ratio = math.exp(-_flattening(0.5 * math.log(larger / smaller), law))
    integral_b, integral_d = _integrals(ratio)
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
    """Two cylinders whose axes cross at ``angle`` degrees (0 < angle <= 90); radii in m, Young's moduli in Pa.

    What is None is as the first cylinder's. ``law`` as in :func:`hertz_contact`.

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
    """A sphere of ``radius`` on the side of a cylinder of ``radius2``, both m. What is None is as the sphere's.

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
    """Two spheres; radii in m, ``radius2`` < 0 for a hollow one around the first. What is None is as the first's.

    ``beta = (4/3) E* sqrt(R)``, 1/R the sum of both curvatures (Johnson 1985, section 4.2).

    >>> two = sphere_on_sphere(radius=9e-3, young=72e9, poisson=0.17)
    >>> f"{two.stiffness:.6g} N/m^1.5, b/a {two.axis_ratio}"
    '3.31576e+09 N/m^1.5, b/a 1.0'
    """
    curvatures = relative_curvatures(_sphere("radius", radius), _sphere("radius2", radius2, radius))
    return hertz_contact(curvatures, contact_modulus(young, poisson, young2, poisson2))


def sphere_on_plane(
    *, radius: float, young: float, poisson: float, young2: float | None = None, poisson2: float | None = None
) -> HertzContact:
    """A sphere of ``radius`` (m) on a plane; young2 = inf for a rigid one. What is None is as the sphere's.

    >>> f"{sphere_on_plane(radius=9e-3, young=72e9, poisson=0.17, young2=math.inf).stiffness:.6g}"
    '9.3784e+09'
    """
    curvatures = relative_curvatures(_sphere("radius", radius), (0.0, 0.0))
    return hertz_contact(curvatures, contact_modulus(young, poisson, young2, poisson2))


def angle_of_stiffness(
    stiffness: float, *, radius: float, young: float, poisson: float, law: AxisRatio = "exact"
) -> float:
    """Angle (degrees) at which two equal crossed cylinders have ``stiffness`` beta (N/m^1.5).

    Stiffness falls from infinity at 0 to ``2 Y sqrt(r)/(3 (1 - nu^2))`` at 90 degrees. Both laws give angle and
    stiffness as functions of the axis ratio, so that only one root is sought: of ``sqrt(ln(beta/beta_min))``, which
    is straight where beta has its minimum. An angle is returned to 1e-12 of itself up to 89.9 degrees. Nearer to 90,
    ``beta/beta_min = 1 + g^2/3`` for both laws, g = 90 - angle in radians: an error eps of beta is one of
    ``3 eps/(2 g)`` in the angle, and of ``sqrt(3 eps)`` at its end. All angles above 89.999998 have the same double
    for beta, and 12 digits of it tell angles from 90 that are 1e-4 degrees off. Stiffnesses down to 5e-12 below the
    minimum are minima rounded to 12 digits and answered by 90.

    ValueError for all other stiffnesses below the minimum, and those above the value at 1e-6 degrees.

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
            f"{SMALLEST_ANGLE:g} degrees), which is what two such cylinders have by the {law} law"
        )
    if excess <= 0.0:
        return 90.0
    from scipy.optimize import brentq

    wanted = math.sqrt(math.log1p(excess))
    found = brentq(
        lambda flattening: math.sqrt(max(_log_stiffness(flattening, law), 0.0)) - wanted, 0.0, deepest, xtol=1e-15
    )
    return min(math.degrees(2.0 * math.atan(math.exp(-_stretch_of(found, law)))), 90.0)


def stiffness_slope(angle: float, *, law: AxisRatio = "exact") -> float:
    """``d ln(beta)/d(angle)`` of two equal crossed cylinders, per degree; <= 0, and 0 at 90.

    So 1 % of stiffness is ``0.01/|slope|`` degrees. By the exact law it is ``-(e^2/2) (d/K) cot(angle/2)`` per
    radian: the elastic energy is stationary in the pressure, so what a curvature changes is its mean under the
    pressure, F a^2/5 for A and F b^2/5 for B. ``angle`` in degrees, 0 < angle <= 90; any radius and material.

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
    integral_b, integral_d = _integrals(ratio)
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


def _integrals(ratio: float) -> tuple[float, float]:
    """b(k) and d(k) of the axis ratio k; their sum is K."""
    from scipy.special import elliprd  # a fifth of a second, which scenes with stiffnesses do not need

    squared = ratio * ratio
    return squared * float(elliprd(0.0, 1.0, squared)) / 3.0, float(elliprd(0.0, squared, 1.0)) / 3.0


# Flattening ln(a/b) and stretch ln(B/A)/2 are 0 for the circle and odd there; e^(-stretch) is tan(angle/2) for equal
# cylinders. Either law is one as a function of the other.


def _flattening(stretch: float, law: AxisRatio) -> float:
    if law == "paper" or stretch < 1e-6:  # to the circle both are the same but for a cube
        return 4.0 / 3.0 * stretch
    from scipy.optimize import brentq

    # as b <= d, it is at least the stretch; and at most what the paper takes
    return float(brentq(lambda u: _stretch_of(u, law) - stretch, 0.99 * stretch, 1.4 * stretch, xtol=1e-15))


def _stretch_of(flattening: float, law: AxisRatio) -> float:
    if law == "paper":
        return 0.75 * flattening
    integral_b, integral_d = _integrals(math.exp(-flattening))
    return flattening + 0.5 * math.log(integral_b / integral_d)


def _stretch(angle: float) -> float:
    """Of two equal cylinders: ``-ln tan(angle/2) = asinh(cot(angle))``, to its last digits at 90 degrees too."""
    sine, cosine = _sine_cosine(angle)
    return math.asinh(cosine / sine)


def _log_stiffness(flattening: float, law: AxisRatio) -> float:
    """ln(beta/beta_min) of two equal cylinders; each term is even in the flattening."""
    ratio = math.exp(-flattening)
    integral_b, integral_d = _integrals(ratio)
    integral_k = integral_b + integral_d
    circle = 16.0 / math.pi**2
    return (
        0.25 * math.log(circle * ratio * integral_b * integral_d)
        - 1.5 * math.log(2.0 / math.pi * math.sqrt(ratio) * integral_k)
        + 0.5 * math.log(math.cosh(_stretch_of(flattening, law)))
    )


def _sine_cosine(angle: float) -> tuple[float, float]:
    """Of an angle in degrees, brought to 0..90 first: each to its last digits, and exact at both ends."""
    acute = abs(math.remainder(number("angle", angle, "degrees"), 180.0))
    if acute <= 45.0:
        return math.sin(math.radians(acute)), math.cos(math.radians(acute))
    return math.cos(math.radians(90.0 - acute)), math.sin(math.radians(90.0 - acute))


def _sphere(name: str, radius: float | None, otherwise: float = math.nan) -> tuple[float, float]:
    radius = number(name, otherwise if radius is None else radius, "m")
    if radius == 0.0:
        raise ValueError(f"{name} = 0.0; allowed: a finite number > 0 (m), or < 0 where the sphere is hollow")
    return 1.0 / radius, 1.0 / radius


def _cylinder(name: str, radius: float | None, otherwise: float = math.nan) -> tuple[float, float]:
    return 1.0 / above(0.0, name, otherwise if radius is None else radius, "m"), 0.0


def _check_law(law: str) -> None:
    if law not in get_args(AxisRatio):
        raise ValueError(f"law = {law!r}; allowed: {' or '.join(get_args(AxisRatio))}")
