"""Line contact: a cylinder on a parallel one or lengthwise on a plane, the limit of crossed cylinders at 0 degrees.

The contact is a strip of half-width h, ``h^2 = 4 F R/(pi E* l)``, 1/R the sum of curvatures and l the length of the
line (Johnson 1985, *Contact Mechanics*, section 4.2). How far the bodies approach is no local matter in two
dimensions: it depends on how they are held. Taken here is Johnson's section 5.6: a cylinder of radius r pressed
between two opposite lines, as in a stack, is compressed between its axis and one of them by ::

    F (1 - nu^2)/(pi Y l) [2 ln(4 r/h) - 1]

and a half-space, between its surface and the depth d below it, by ``[2 ln(2 d/h) - nu/(1 - nu)]`` instead.
Assumed are a strip much narrower than the bodies, plane strain (a line much longer than it is wide; its ends are not
looked at), axes that are exactly parallel, and equal forces on both sides of a cylinder, which a wave does not have.

The sum for both bodies is ``overlap = (F/G) ln(F0/F)`` with ``G = pi E* l``: Lambert's W inverts it. The slope of the
force is 0 at touch, and its local exponent a little above 2, not 5/2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dem_bridge.physics.contact import Floats
from dem_bridge.physics.hertz import compliance
from dem_bridge.physics.law import ContactLaw
from dem_bridge.physics.valid import above


@dataclass(frozen=True)
class LineContact:
    """``overlap = (F/scale) ln(force_scale/F)``. Made by :func:`parallel_cylinders` and :func:`cylinder_on_plane`.

    Functions of the overlap take and give arrays, and are nan beyond :attr:`reach`.
    """

    scale: float
    """G = pi E* l, N/m."""
    force_scale: float
    """F0, N: at F0/e the strip is about as wide as the bodies, and the formula turns round."""
    width_squared: float
    """Square of the half-width per force, m^2/N: 4 R/(pi E* l)."""
    length: float
    """l of the line, m."""

    @property
    def reach(self) -> float:
        """Overlap, m, up to which the formula has a force: ``F0/(e G)``."""
        return self.force_scale / (math.e * self.scale)

    def overlap(self, force: ArrayLike) -> Floats:
        """m, under a force from 0 to F0/e, N."""
        force = np.asarray(force, dtype=float)
        with np.errstate(divide="ignore", invalid="ignore"):
            overlap = force / self.scale * np.log(self.force_scale / force)
        overlap = np.where(force <= self.force_scale / math.e, overlap, math.nan)
        return np.where(force == 0.0, 0.0, overlap)

    def force(self, overlap: ArrayLike) -> Floats:
        """N, at an overlap from 0 to :attr:`reach`, m."""
        return np.asarray(self.scale * np.asarray(overlap, dtype=float) / self._logarithm(overlap))

    def energy(self, overlap: ArrayLike) -> Floats:
        """Energy stored, J: ``F^2/(2 G) [ln(F0/F) - 1/2]``, the integral of the force."""
        logarithm = self._logarithm(overlap)
        return np.asarray(0.5 * self.scale * np.square(overlap) / logarithm * (1.0 - 0.5 / logarithm))

    def exponent(self, overlap: ArrayLike) -> Floats:
        """Local n: ``1 + d ln F/d ln overlap = 2 + 1/[ln(F0/F) - 1]``; 2 at touch."""
        return np.asarray(2.0 + 1.0 / (self._logarithm(overlap) - 1.0))

    def half_width(self, force: float) -> float:
        """Half the width of the strip under a force >= 0 (N), m."""
        return math.sqrt(self.width_squared * force)

    def peak_pressure(self, force: float) -> float:
        """Pressure in the middle of the strip under a force >= 0 (N), Pa: ``2 F/(pi h l)``."""
        return 2.0 / math.pi * math.sqrt(force / self.width_squared) / self.length

    def law(self) -> ContactLaw:
        """What a scene takes.

        >>> law = parallel_cylinders(radius=9e-3, length=18e-3, young=72e9, poisson=0.17).law()
        >>> [round(force, 3) for force in law.force(np.array([0.0, 1e-6, 2e-6])).tolist()]
        [0.0, 164.7, 350.148]
        """
        return ContactLaw(force=self.force, energy=self.energy)

    def _logarithm(self, overlap: ArrayLike) -> Floats:
        """ln(F0/F): the root L > 1 of ``L e^-L = overlap G/F0``."""
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
    """Two cylinders side by side, each pressed on its other side too; the overlap is the approach of their axes.

    Radii and ``length`` of the line of contact in m, Young's moduli in Pa; what is None is as the first cylinder's.

    >>> line = parallel_cylinders(radius=9e-3, length=18e-3, young=72e9, poisson=0.17)
    >>> f"{1e6 * float(line.overlap(236.0)):.4f} um, n = {float(line.exponent(line.overlap(236.0))):.4f}"
    '1.3924 um, n = 2.0880'
    """
    one = _cylinder(radius, young, poisson, "")
    two = _cylinder(
        radius if radius2 is None else radius2,
        young if young2 is None else young2,
        poisson if poisson2 is None else poisson2,
        "2",
    )
    return _line((one, two), length)


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
    """A cylinder lengthwise on a plane, pressed on its other side too; its axis approaches ``depth`` below the surface.

    ``depth`` (m) has to be told, for the surface of a half-space sinks without end below a line; it does not matter
    where ``young2`` is inf, a rigid plane. All else as in :func:`parallel_cylinders`.

    >>> quartz = dict(radius=9e-3, length=18e-3, young=72e9, poisson=0.17)
    >>> rigid = cylinder_on_plane(depth=0.1, young2=math.inf, **quartz)
    >>> f"{1e6 * float(rigid.overlap(236.0)):.4f} um"
    '0.6962 um'
    """
    young2, poisson2 = young if young2 is None else young2, poisson if poisson2 is None else poisson2
    soft = compliance("young2", young2, "poisson2", poisson2)
    plane = (0.0, soft, 2.0 * math.log(2.0 * above(0.0, "depth", depth, "m")) - poisson2 / (1.0 - poisson2))
    return _line((_cylinder(radius, young, poisson, ""), plane), length)


#: curvature (1/m), compliance (1/Pa) and what is beside -2 ln(h) in the bracket of its approach
_Body = tuple[float, float, float]


def _cylinder(radius: float, young: float, poisson: float, which: str) -> _Body:
    soft = compliance(f"young{which}", young, f"poisson{which}", poisson)
    radius = above(0.0, f"radius{which}", radius, "m")
    return 1.0 / radius, soft, 2.0 * math.log(4.0 * radius) - 1.0


def _line(bodies: tuple[_Body, _Body], length: float) -> LineContact:
    length = above(0.0, "length", length, "m")
    soft = sum(body[1] for body in bodies)
    if soft == 0.0:
        raise ValueError("young = young2 = inf; allowed: at least one body that yields")
    scale = math.pi * length / soft
    width_squared = 4.0 / (scale * sum(body[0] for body in bodies))
    bracket = sum(body[1] * body[2] for body in bodies) / soft
    return LineContact(
        scale=scale, force_scale=math.exp(bracket) / width_squared, width_squared=width_squared, length=length
    )
