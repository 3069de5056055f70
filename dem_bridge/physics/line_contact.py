"""Line contact: a cylinder on a parallel cylinder or on a plane, the limit of crossed cylinders at 0 degrees.

The contact is a strip of half-width h, ``h^2 = 4 F R/(pi E* l)``, with 1/R the sum of curvatures and l the length of
the line (Johnson 1985, *Contact Mechanics*, section 4.2). In two dimensions the approach of the bodies depends on how
they are held. This module follows Johnson's section 5.6: a cylinder of radius r pressed between two opposite lines, as
in a stack, is compressed between its axis and one of them by ::

    F (1 - nu^2)/(pi Y l) [2 ln(4 r/h) - 1]

and a half-space, between its surface and the depth d below it, by ``[2 ln(2 d/h) - nu/(1 - nu)]`` instead of the
bracket. The assumptions are: a strip much narrower than the bodies; plane strain (a line much longer than it is wide,
end effects neglected); exactly parallel axes; and equal forces on both sides of a cylinder, which does not hold in a
wave.

The sum for both bodies is ``overlap = (F/G) ln(F0/F)`` with ``G = pi E* l``; Lambert's W inverts it. The slope of the
force is 0 at touch, and its local exponent is slightly above 2, not 5/2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dem_bridge.physics.contact_law import ContactLaw, Floats
from dem_bridge.physics.hertz import compliance
from dem_bridge.physics.numbers import above


@dataclass(frozen=True)
class LineContact:
    """A line contact with ``overlap = (F/scale) ln(force_scale/F)``.

    :func:`parallel_cylinders` and :func:`cylinder_on_plane` compute it. Functions of the overlap take and return
    arrays, and are nan beyond :attr:`reach`.
    """

    scale: float
    """G = pi E* l, N/m."""
    force_scale: float
    """F0, N. At F0/e the strip is about as wide as the bodies, and the overlap of the formula has its maximum."""
    width_squared: float
    """Square of the half-width per force, 4 R/(pi E* l), m^2/N."""
    length: float
    """Length l of the line, m."""

    @property
    def reach(self) -> float:
        """Largest overlap at which the formula has a force, ``F0/(e G)``, m."""
        return self.force_scale / (math.e * self.scale)

    def overlap(self, force: ArrayLike) -> Floats:
        """Return the overlap under a force from 0 to F0/e (N), m."""
        force = np.asarray(force, dtype=float)
        with np.errstate(divide="ignore", invalid="ignore"):
            overlap = force / self.scale * np.log(self.force_scale / force)
        overlap = np.where(force <= self.force_scale / math.e, overlap, math.nan)
        return np.where(force == 0.0, 0.0, overlap)

    def force(self, overlap: ArrayLike) -> Floats:
        """Return the force at an overlap from 0 to :attr:`reach` (m), N."""
        return np.asarray(self.scale * np.asarray(overlap, dtype=float) / self._logarithm(overlap))

    def energy(self, overlap: ArrayLike) -> Floats:
        """Return the stored energy ``F^2/(2 G) [ln(F0/F) - 1/2]``, the integral of the force, J."""
        logarithm = self._logarithm(overlap)
        return np.asarray(0.5 * self.scale * np.square(overlap) / logarithm * (1.0 - 0.5 / logarithm))

    def exponent(self, overlap: ArrayLike) -> Floats:
        """Return the local exponent n, ``1 + d ln F/d ln overlap = 2 + 1/[ln(F0/F) - 1]``; it is 2 at touch."""
        return np.asarray(2.0 + 1.0 / (self._logarithm(overlap) - 1.0))

    def half_width(self, force: float) -> float:
        """Return half the width of the strip under a force >= 0 (N), m."""
        return math.sqrt(self.width_squared * force)

    def peak_pressure(self, force: float) -> float:
        """Return the pressure at the centre of the strip under a force >= 0 (N), Pa: ``2 F/(pi h l)``."""
        return 2.0 / math.pi * math.sqrt(force / self.width_squared) / self.length

    def law(self) -> ContactLaw:
        """Return the contact as a law for a scene.

        Examples
        --------
        >>> law = parallel_cylinders(radius=9e-3, length=18e-3, young=72e9, poisson=0.17).law()
        >>> [round(force, 3) for force in law.force(np.array([0.0, 1e-6, 2e-6])).tolist()]
        [0.0, 164.7, 350.148]
        """
        return ContactLaw(force=self.force, energy=self.energy)

    def _logarithm(self, overlap: ArrayLike) -> Floats:
        """Return ln(F0/F): the root L > 1 of ``L e^-L = overlap G/F0``."""
        from scipy.special import lambertw

        part = np.asarray(overlap, dtype=float) * (self.scale / self.force_scale)
        part = np.where((part >= 0.0) & (part < math.exp(-1.0)), part, math.nan)
        return np.asarray(-lambertw(-part, -1).real)


def parallel_cylinders(
    *,
    radius: float,
    length: float,
    young: float,
    poisson: float,
    radius2: float | None = None,
    young2: float | None = None,
    poisson2: float | None = None,
) -> LineContact:
    """Return the contact of two parallel cylinders, each of which is also pressed on its other side.

    The overlap is the approach of the two axes.

    Parameters
    ----------
    radius, radius2 : float
        Radii, m. The second cylinder's radius, modulus and Poisson's ratio equal the first one's unless they are given.
    length : float
        Length of the line of contact, m.
    young, young2 : float
        Young's moduli, Pa.
    poisson, poisson2 : float
        Poisson's ratios.

    Raises
    ------
    ValueError
        If a parameter is outside its range.

    Examples
    --------
    >>> line = parallel_cylinders(radius=9e-3, length=18e-3, young=72e9, poisson=0.17)
    >>> f"{1e6 * float(line.overlap(236.0)):.4f} um, n = {float(line.exponent(line.overlap(236.0))):.4f}"
    '1.3924 um, n = 2.0880'
    """
    first = _cylinder(radius, young, poisson, "")
    values = ((radius2, radius), (young2, young), (poisson2, poisson))
    radius2, young2, poisson2 = (first_value if value is None else value for value, first_value in values)
    return _line((first, _cylinder(radius2, young2, poisson2, "2")), length)


def cylinder_on_plane(
    *,
    radius: float,
    length: float,
    depth: float,
    young: float,
    poisson: float,
    young2: float | None = None,
    poisson2: float | None = None,
) -> LineContact:
    """Return the contact of a cylinder that lies on a plane and is pressed on its other side too.

    The overlap is the approach of the cylinder's axis to a point at ``depth`` below the surface. The depth is required
    because the surface of a half-space sinks without bound under a line load. It has no effect if ``young2`` is inf, a
    rigid plane.

    Parameters
    ----------
    radius : float
        Radius of the cylinder, m.
    length : float
        Length of the line of contact, m.
    depth : float
        Depth below the surface that the approach refers to, m.
    young, young2 : float
        Young's moduli of cylinder and plane, Pa. The plane's values equal the cylinder's unless they are given.
    poisson, poisson2 : float
        Poisson's ratios of cylinder and plane.

    Raises
    ------
    ValueError
        If a parameter is outside its range.

    Examples
    --------
    >>> quartz = dict(radius=9e-3, length=18e-3, young=72e9, poisson=0.17)
    >>> rigid = cylinder_on_plane(depth=0.1, young2=math.inf, **quartz)
    >>> f"{1e6 * float(rigid.overlap(236.0)):.4f} um"
    '0.6962 um'
    """
    young2, poisson2 = young if young2 is None else young2, poisson if poisson2 is None else poisson2
    soft = compliance("young2", young2, "poisson2", poisson2)
    plane = (0.0, soft, 2.0 * math.log(2.0 * above(0.0, "depth", depth, "m")) - poisson2 / (1.0 - poisson2))
    return _line((_cylinder(radius, young, poisson, ""), plane), length)


#: curvature (1/m), compliance (1/Pa) and the terms other than -2 ln(h) in the bracket of the approach
_Body = tuple[float, float, float]


def _cylinder(radius: float, young: float, poisson: float, which: str) -> _Body:
    """Return the numbers of a cylinder."""
    soft = compliance(f"young{which}", young, f"poisson{which}", poisson)
    radius = above(0.0, f"radius{which}", radius, "m")
    return 1.0 / radius, soft, 2.0 * math.log(4.0 * radius) - 1.0


def _line(bodies: tuple[_Body, _Body], length: float) -> LineContact:
    """Return the contact of two bodies on a line of ``length``."""
    length = above(0.0, "length", length, "m")
    soft = sum(body[1] for body in bodies)
    if soft == 0.0:
        raise ValueError("young = young2 = inf; allowed: at least one deformable body")
    scale = math.pi * length / soft
    width_squared = 4.0 / (scale * sum(body[0] for body in bodies))
    bracket = sum(body[1] * body[2] for body in bodies) / soft
    return LineContact(
        scale=scale, force_scale=math.exp(bracket) / width_squared, width_squared=width_squared, length=length
    )
