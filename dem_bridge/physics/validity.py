"""Ratios that measure how well a contact satisfies the assumptions of Hertz's law and of lumped masses.

Each function returns one ratio, whether it is within its limit, and one sentence. The ellipse and its pressure come
from :mod:`dem_bridge.physics.hertz`, forces and times from a run. A limit that no author states is a keyword argument,
and its docstring gives the reason for its default; the ratio does not depend on it.

=======================  ================================================  =========
assumption               ratio                                             holds
=======================  ================================================  =========
:func:`ellipse_on_body`  semi-major axis / half-height                     up to 1
:func:`half_space`       semi-axis / radius                                up to 0.1
:func:`no_crushing`      peak pressure / compressive strength              up to 1
:func:`no_cracking`      tension at the ellipse's edge / tensile strength  up to 1
:func:`quasi_static`     contact time / time of sound across the body      from 10
:func:`weightless`       static / dynamic force                            up to 0.1
=======================  ================================================  =========
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from dem_bridge.physics.numbers import above, not_negative, poisson_ratio

#: compressive and tensile strength of fused quartz, Pa: design values in dealers' tables (ProSciTech, "Properties of
#: Fused Quartz": more than 1.1e9, and 4.8e7; makeitfrom.com: 1.1e9 and 5.0e7); a surface without flaws is far stronger
FUSED_QUARTZ_COMPRESSIVE = 1.1e9
FUSED_QUARTZ_TENSILE = 4.8e7


@dataclass(frozen=True)
class Validity:
    """Result of checking one assumption on one contact.

    The functions of this module return it.
    """

    ratio: float
    """The checked quantity divided by the quantity that it is compared with."""
    limit: float
    """The value of ``ratio`` at which the assumption ends."""
    holds: bool
    """True if the ratio is on the valid side of the limit."""
    sentence: str
    """The result in plain words, with the numbers."""


def ellipse_on_body(semi_major: float, *, half_height: float) -> Validity:
    """Check that the contact ellipse lies within the body: ``semi_major / half_height`` is at most 1.

    Hertz's solution assumes surfaces that extend beyond the ellipse (Johnson 1985, section 4.2). A cylinder that is
    touched at mid-height offers half its height on each side. Near the limit the ends of the cylinder already matter.

    Parameters
    ----------
    semi_major : float
        Semi-major axis of the contact ellipse, m.
    half_height : float
        Half the height of the cylinder, m.

    Examples
    --------
    >>> ellipse_on_body(10.4e-3, half_height=9e-3).sentence
    'the semi-major axis, 0.0104 m, is 1.16 of the half-height, 0.009 m: the ellipse would reach beyond the body'
    """
    ratio = not_negative("semi_major", semi_major, "m") / above(0.0, "half_height", half_height, "m")
    finding = f"the semi-major axis, {semi_major:.3g} m, is {ratio:.3g} of the half-height, {half_height:.3g} m"
    return _judged(1.0, ratio, finding, "the ellipse ends on the body", "the ellipse would reach beyond the body")


def half_space(semi_axis: float, *, radius: float, limit: float = 0.1) -> Validity:
    """Check that the body acts as a half-space with a parabolic surface: ``semi_axis / radius`` is at most ``limit``.

    Hertz assumes that a << R and that contacts are small compared with the bodies (Johnson 1985, section 4.2). A circle
    departs from its parabola by the fraction (y/R)^2/4, which is 0.25 % at the default ``limit``. Use the semi-minor
    axis to check the shape of the profile, and the semi-major axis to check the stresses, which reach about as deep as
    the ellipse is long.

    Parameters
    ----------
    semi_axis : float
        Semi-axis of the contact ellipse, m.
    radius : float
        Radius of the body, m.
    limit : float
        Largest allowed ratio.

    Examples
    --------
    >>> half_space(7.9e-5, radius=9e-3).holds, half_space(10.4e-3, radius=9e-3).holds
    (True, False)
    """
    ratio = not_negative("semi_axis", semi_axis, "m") / above(0.0, "radius", radius, "m")
    finding = f"the semi-axis, {semi_axis:.3g} m, is {ratio:.3g} of the radius, {radius:.3g} m"
    return _judged(limit, ratio, finding, "small compared with the body", "not small compared with the body")


def no_crushing(peak_pressure: float, *, strength: float = FUSED_QUARTZ_COMPRESSIVE) -> Validity:
    """Check that the largest pressure stays below the compressive ``strength``: their quotient is at most 1.

    The largest pressure is at the centre of the ellipse (Johnson 1985, section 4.2). Strengths are measured in uniaxial
    tests; the centre of a contact is under nearly hydrostatic pressure and withstands more, so this check is
    conservative.

    Parameters
    ----------
    peak_pressure : float
        Pressure at the centre of the ellipse, Pa.
    strength : float
        Compressive strength of the material, Pa.

    Examples
    --------
    >>> round(no_crushing(3.26e8).ratio, 3)
    0.296
    """
    ratio = not_negative("peak_pressure", peak_pressure, "Pa") / above(0.0, "strength", strength, "Pa")
    finding = (
        f"the peak pressure, {peak_pressure:.3g} Pa, is {ratio:.3g} of the compressive strength, {strength:.3g} Pa"
    )
    return _judged(1.0, ratio, finding, "the contact stays elastic", "the material may crush")


def no_cracking(tension: float, *, strength: float = FUSED_QUARTZ_TENSILE) -> Validity:
    """Check that the tension at the edge stays below the tensile ``strength``: the quotient is at most 1.

    Brittle bodies crack there first, in a ring or at the ends of the ellipse (Lawn 1993, *Fracture of Brittle Solids*,
    ch. 8). The tension decays within a small fraction of the ellipse, so that short flaws withstand more.

    Parameters
    ----------
    tension : float
        Tension at the edge, Pa; see :func:`edge_tension`.
    strength : float
        Tensile strength of the material, Pa.

    Examples
    --------
    >>> no_cracking(edge_tension(3.26e8, poisson=0.17)).holds
    False
    """
    ratio = not_negative("tension", tension, "Pa") / above(0.0, "strength", strength, "Pa")
    finding = f"the tension at the edge, {tension:.3g} Pa, is {ratio:.3g} of the tensile strength, {strength:.3g} Pa"
    return _judged(1.0, ratio, finding, "no crack is to be expected", "flaws of the surface may open")


def edge_tension(peak_pressure: float, *, poisson: float, axis_ratio: float = 1.0) -> float:
    """Return the largest tension on the surface, Pa, which acts at the ends of the major axis and along it.

    Around a circle it is ``(1 - 2 nu) p0/3``. With k = b/a and e^2 = 1 - k^2 it is ``(1 - 2 nu) p0 (k/e^2) [artanh(e)/e
    - 1]`` (Johnson 1985, section 4.3). The code uses the equivalent ``(1 - 2 nu) p0 k R_D(k^2, k^2, 1)/3``, which loses
    no digits at the circle. The tension at the ends of the minor axis is smaller.

    Parameters
    ----------
    peak_pressure : float
        Pressure p0 at the centre of the ellipse, Pa.
    poisson : float
        Poisson's ratio nu.
    axis_ratio : float
        k = b/a of the ellipse, 0 < k <= 1.

    Examples
    --------
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
    """Check that bodies act as masses and contacts as springs: the contact outlasts many crossings of sound.

    The ratio is ``contact_time / (size sqrt(density/young))``, at least ``limit``. Its denominator is the time that a
    sound wave in a bar takes to cross the body. Love's criterion is that statics holds while waves cross the body many
    times during the contact (Love 1927, *Treatise on the Mathematical Theory of Elasticity*, on Hertz's impact; Johnson
    1985, section 11.4). He gives no number for "many"; the default of ``limit`` is ours.

    Parameters
    ----------
    contact_time : float
        Duration of the contact, s.
    size : float
        Diameter of the body, m.
    young : float
        Young's modulus, Pa.
    density : float
        Density, kg/m^3.
    limit : float
        Smallest allowed number of crossings.

    Examples
    --------
    >>> collision = quasi_static(5.6e-5, size=18e-3, young=72e9, density=2200.0)
    >>> round(collision.ratio, 1), collision.holds
    (17.8, True)
    """
    speed = math.sqrt(above(0.0, "young", young, "Pa") / above(0.0, "density", density, "kg/m^3"))
    crossing = above(0.0, "size", size, "m") / speed
    ratio = above(0.0, "contact_time", contact_time, "s") / crossing
    finding = f"the contact lasts {contact_time:.3g} s, in which sound crosses the body {ratio:.3g} times"
    well, ill = "the body acts as one mass", "the body rings while it is in contact"
    return _judged(limit, ratio, finding, well, ill, least=True)


def weightless(static_force: float, dynamic_force: float, *, limit: float = 0.1) -> Validity:
    """Check that a loaded chain may be treated as just touching: ``static_force / dynamic_force`` is at most ``limit``.

    Unless the dynamic force is much larger than the static one, the contacts are stiff before the wave arrives and the
    wave travels at a speed of sound (Nesterenko 2001, *Dynamics of Heterogeneous Materials*, ch. 1). A Hertz contact
    under a tenth of the dynamic force is compressed by a fifth of the dynamic overlap, because overlaps scale as
    ``ratio^(2/3)``.

    Parameters
    ----------
    static_force : float
        Force in the contact at rest, N.
    dynamic_force : float
        Peak force of the wave, N.
    limit : float
        Largest allowed ratio.

    Examples
    --------
    >>> weightless(3.95, 236.0).sentence
    'the static force, 3.95 N, is 0.0167 of the dynamic one, 236 N: the chain acts as if it just touched'
    """
    ratio = not_negative("static_force", static_force, "N") / above(0.0, "dynamic_force", dynamic_force, "N")
    finding = f"the static force, {static_force:.3g} N, is {ratio:.3g} of the dynamic one, {dynamic_force:.3g} N"
    return _judged(limit, ratio, finding, "the chain acts as if it just touched", "the static force shapes the wave")


def _judged(limit: float, ratio: float, finding: str, well: str, ill: str, *, least: bool = False) -> Validity:
    """Return the result for a ratio that must not exceed ``limit``, or with ``least`` must not fall below it."""
    above(0.0, "limit", limit)
    holds = ratio >= limit if least else ratio <= limit
    return Validity(ratio=ratio, limit=limit, holds=holds, sentence=f"{finding}: {well if holds else ill}")
