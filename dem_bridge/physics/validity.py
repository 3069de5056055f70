"""How far a contact is from what Hertz's law and lumped masses assume: one ratio and one sentence for each assumption.

Numbers come from elsewhere (:mod:`dem_bridge.physics.hertz` for the ellipse and its pressure, a run for forces and
times). Limits that no author gives are keywords with their reason; the ratio stays whatever they are.

| assumption | ratio | holds |
|---|---|---|
| :func:`ellipse_on_body` | semi-major axis / half-height | up to 1 |
| :func:`half_space` | semi-axis / radius | up to 0.1 |
| :func:`no_crushing` | peak pressure / compressive strength | up to 1 |
| :func:`no_cracking` | tension at the ellipse's edge / tensile strength | up to 1 |
| :func:`quasi_static` | contact time / time of sound across the body | from 10 |
| :func:`weightless` | static / dynamic force | up to 0.1 |
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from dem_bridge.physics.hertz import not_negative, poisson_ratio
from dem_bridge.physics.valid import above

#: compressive and tensile strength of fused quartz, Pa: design values in dealers' tables (ProSciTech, "Properties of
#: Fused Quartz": more than 1.1e9, and 4.8e7; makeitfrom.com: 1.1e9 and 5.0e7); a surface without flaws bears far more
FUSED_QUARTZ_COMPRESSIVE = 1.1e9
FUSED_QUARTZ_TENSILE = 4.8e7


@dataclass(frozen=True)
class Validity:
    """One assumption about one contact. Made by the functions of this module."""

    ratio: float
    """What is found, in units of what it is compared with."""
    limit: float
    """Where the assumption ends, in the same units."""
    holds: bool
    """Whether the ratio is on the right side of the limit."""
    sentence: str
    """The same in plain words, with the numbers."""


def ellipse_on_body(semi_major: float, *, half_height: float) -> Validity:
    """Whether the contact ellipse ends before the body does: ``semi_major / half_height``, both m, up to 1.

    Hertz's ellipse lies on surfaces that go on beyond it (Johnson 1985, section 4.2). Of a cylinder that touches in the
    middle of its height the half-height is what the ellipse may reach; near the limit its ends are felt already.

    >>> ellipse_on_body(10.4e-3, half_height=9e-3).sentence
    'the semi-major axis, 0.0104 m, is 1.16 of the half-height, 0.009 m: the ellipse would reach beyond the body'
    """
    ratio = not_negative("semi_major", semi_major, "m") / above(0.0, "half_height", half_height, "m")
    found = f"the semi-major axis, {semi_major:.3g} m, is {ratio:.3g} of the half-height, {half_height:.3g} m"
    return _up_to(1.0, ratio, found, "the ellipse ends on the body", "the ellipse would reach beyond the body")


def half_space(semi_axis: float, *, radius: float, limit: float = 0.1) -> Validity:
    """Whether the body is as good as a half-space with a parabolic surface: ``semi_axis / radius``, both m.

    Hertz assumes a << R and contacts small beside the bodies (Johnson 1985, section 4.2). A circle departs from its
    parabola by the part (y/R)^2/4, 0.25 % at the default ``limit``. The semi-minor axis against the radius tells of
    that profile; the semi-major one of the stresses, which reach about as deep as the ellipse is long.

    >>> half_space(7.9e-5, radius=9e-3).holds, half_space(10.4e-3, radius=9e-3).holds
    (True, False)
    """
    ratio = not_negative("semi_axis", semi_axis, "m") / above(0.0, "radius", radius, "m")
    found = f"the semi-axis, {semi_axis:.3g} m, is {ratio:.3g} of the radius, {radius:.3g} m"
    return _up_to(limit, ratio, found, "small beside the body", "not small beside the body")


def no_crushing(peak_pressure: float, *, strength: float = FUSED_QUARTZ_COMPRESSIVE) -> Validity:
    """Whether the largest pressure stays below the compressive ``strength``, both Pa: their quotient, up to 1.

    The pressure in the middle of the ellipse (Johnson 1985, section 4.2). Strengths are of uniaxial tests; the middle
    of a contact is under nearly hydrostatic pressure and bears more, so this is on the safe side.

    >>> round(no_crushing(3.26e8).ratio, 3)
    0.296
    """
    ratio = not_negative("peak_pressure", peak_pressure, "Pa") / above(0.0, "strength", strength, "Pa")
    found = f"the peak pressure, {peak_pressure:.3g} Pa, is {ratio:.3g} of the compressive strength, {strength:.3g} Pa"
    return _up_to(1.0, ratio, found, "the contact stays elastic", "the material may crush")


def no_cracking(tension: float, *, strength: float = FUSED_QUARTZ_TENSILE) -> Validity:
    """Whether the tension at the edge (:func:`edge_tension`) stays below the tensile ``strength``, both Pa.

    Their quotient, up to 1. Brittle bodies crack there first, in a ring or at the ellipse's ends (Lawn 1993, *Fracture
    of Brittle Solids*, ch. 8); the tension falls off within a small part of the ellipse, so that short flaws
    survive more.

    >>> no_cracking(edge_tension(3.26e8, poisson=0.17)).holds
    False
    """
    ratio = not_negative("tension", tension, "Pa") / above(0.0, "strength", strength, "Pa")
    found = f"the tension at the edge, {tension:.3g} Pa, is {ratio:.3g} of the tensile strength, {strength:.3g} Pa"
    return _up_to(1.0, ratio, found, "no crack is to be expected", "flaws of the surface may open")


def edge_tension(peak_pressure: float, *, poisson: float, axis_ratio: float = 1.0) -> float:
    """Largest tension on the surface, Pa: at both ends of the ellipse's major axis, along it.

    ``(1 - 2 nu) p0/3`` around a circle. With k = b/a, e^2 = 1 - k^2 it is ``(1 - 2 nu) p0 (k/e^2) [artanh(e)/e - 1]``
    (Johnson 1985, section 4.3), written as ``(1 - 2 nu) p0 k R_D(k^2, k^2, 1)/3`` so that the circle costs no digits;
    the ends of the minor axis bear less. ``axis_ratio`` is k, 0 < k <= 1.

    >>> edge_tension(3e8, poisson=0.0), round(edge_tension(3e8, poisson=0.0, axis_ratio=0.0076) / 1e6, 2)
    (100000000.0, 10.43)
    """
    if not 0.0 < axis_ratio <= 1.0:
        raise ValueError(f"axis_ratio = {axis_ratio!r}; allowed: 0 < b/a <= 1")
    from scipy.special import elliprd

    squared = axis_ratio**2
    factor = (1.0 - 2.0 * poisson_ratio("poisson", poisson)) * not_negative("peak_pressure", peak_pressure, "Pa") / 3.0
    return factor * axis_ratio * float(elliprd(squared, squared, 1.0))


def quasi_static(contact_time: float, *, size: float, young: float, density: float, limit: float = 10.0) -> Validity:
    """Whether bodies act as masses and contacts as springs: ``contact_time / (size sqrt(density/young))``, from 10.

    The time that sound in a bar takes across a body of ``size`` (2 r; m), against the duration of the contact (s).
    Love's criterion: statics holds while waves cross the body many times during the contact (Love 1927, *Treatise on
    the Mathematical Theory of Elasticity*, on Hertz's impact; Johnson 1985, section 11.4). "Many" is ``limit``.
    ``young`` in Pa, ``density`` in kg/m^3.

    >>> collision = quasi_static(5.6e-5, size=18e-3, young=72e9, density=2200.0)
    >>> round(collision.ratio, 1), collision.holds
    (17.8, True)
    """
    speed = math.sqrt(above(0.0, "young", young, "Pa") / above(0.0, "density", density, "kg/m^3"))
    crossing = above(0.0, "size", size, "m") / speed
    ratio = above(0.0, "contact_time", contact_time, "s") / crossing
    found = f"the contact lasts {contact_time:.3g} s, in which sound crosses the body {ratio:.3g} times"
    return _from(limit, ratio, found, "the body acts as one mass", "the body rings while it is in contact")


def weightless(static_force: float, dynamic_force: float, *, limit: float = 0.1) -> Validity:
    """Whether a chain may be taken as just touching: ``static_force / dynamic_force``, both N, up to ``limit``.

    Where the dynamic force is not much larger, the contact is stiff before the wave comes, and the wave has a speed of
    sound (Nesterenko 2001, *Dynamics of Heterogeneous Materials*, ch. 1). A Hertz contact under a tenth of the
    dynamic force is compressed by a fifth of the dynamic overlap: the overlaps go as ``ratio^(2/3)``.

    >>> weightless(3.95, 236.0).sentence
    'the static force, 3.95 N, is 0.0167 of the dynamic one, 236 N: the chain acts as if it just touched'
    """
    ratio = not_negative("static_force", static_force, "N") / above(0.0, "dynamic_force", dynamic_force, "N")
    found = f"the static force, {static_force:.3g} N, is {ratio:.3g} of the dynamic one, {dynamic_force:.3g} N"
    return _up_to(limit, ratio, found, "the chain acts as if it just touched", "the static force shapes the wave")


def _up_to(limit: float, ratio: float, found: str, well: str, ill: str) -> Validity:
    holds = ratio <= above(0.0, "limit", limit)
    return Validity(ratio=ratio, limit=limit, holds=holds, sentence=f"{found}: {well if holds else ill}")


def _from(limit: float, ratio: float, found: str, well: str, ill: str) -> Validity:
    holds = ratio >= above(0.0, "limit", limit)
    return Validity(ratio=ratio, limit=limit, holds=holds, sentence=f"{found}: {well if holds else ill}")
