"""The bodies of a chain: shapes, sizes, materials, and the angles at which cylinders cross.

The motion does not depend on them; it follows from a Scene's masses and stiffnesses alone. They serve to compute the
size of a contact ellipse, the stiffness by another contact law, or the mass of a body from its density.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Literal, TypedDict

from dem_bridge.errors import SceneError
from dem_bridge.foundation.numbers import Numbers, check_fields, checked_numbers

if TYPE_CHECKING:
    from dem_bridge.physics.hertz import HertzContact

#: contact laws of two crossed cylinders: with the paper's approximate axis ratio, and with Hertz's exact one
LAWS = ("paper", "exact")
SHAPES = ("sphere", "cylinder")
#: allowed angles between two axes
ANGLE = "a number > 0 and <= 90 (degrees)"
_POSITIVE = {"above": 0.0}
_MATERIAL = {
    "youngs_modulus": Numbers("a number > 0 (Pa)", _POSITIVE),
    "density": Numbers("a number > 0 (kg/m^3)", _POSITIVE),
    "poissons_ratio": Numbers("-1 < nu <= 0.5", {"above": -1.0, "at_most": 0.5}),
}
#: the two ways to define a crossing: allowed entries and their upper bound
_CROSSING = {"angles": (ANGLE, 90.0), "stiffness": ("a number > 0 (N/m^1.5)", math.inf)}
_BODY = dict.fromkeys(("radius", "height"), Numbers("a number > 0 (m)", _POSITIVE))


class Elastic(TypedDict):
    """Elastic constants of a material as keyword arguments of :mod:`dem_bridge.physics.hertz`."""

    young: float
    poisson: float


@dataclass(frozen=True, kw_only=True)
class Material:
    """An elastic material: ``youngs_modulus`` in Pa, ``density`` in kg/m^3.

    Raises
    ------
    SceneError
        If a value is outside the range that a material can have.

    Examples
    --------
    >>> Material(youngs_modulus=72e9, poissons_ratio=0.17, density=2200.0, name="fused quartz").density
    2200.0
    """

    youngs_modulus: float
    poissons_ratio: float
    density: float
    name: str = ""

    def __post_init__(self) -> None:
        check_fields(self, _MATERIAL, "material.")

    @property
    def elastic(self) -> Elastic:
        """Elastic constants as keyword arguments of :mod:`dem_bridge.physics.hertz`."""
        return {"young": self.youngs_modulus, "poisson": self.poissons_ratio}


@dataclass(frozen=True, kw_only=True)
class Body:
    """A sphere, or a cylinder that lies across the chain.

    ``shape`` is "sphere" or "cylinder"; ``radius`` and ``height`` are in m; the height of a sphere is None.

    Examples
    --------
    >>> quartz = Material(youngs_modulus=72e9, poissons_ratio=0.17, density=2200.0)
    >>> f"{1e3 * Body(shape='sphere', radius=9e-3, material=quartz).mass:.2f} g"
    '6.72 g'
    """

    shape: str
    radius: float
    material: Material
    height: float | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.shape, str) or self.shape not in SHAPES:
            raise SceneError("body.shape", value=self.shape, allowed=" or ".join(SHAPES))
        if not isinstance(self.material, Material):
            raise SceneError("body.material", value=self.material, allowed="a Material")
        if (self.height is None) != (self.shape == "sphere"):
            raise SceneError("body.height", value=self.height, allowed="a number > 0 (m), None for a sphere")
        check_fields(self, _BODY, "body.")

    @property
    def mass(self) -> float:
        """Density times volume, kg; the mass of the body in the Scene may differ."""
        if self.height is None:
            return self.material.density * 4.0 / 3.0 * math.pi * self.radius**3
        return self.material.density * math.pi * self.radius**2 * self.height


def crossings(bodies: Sequence[Body]) -> tuple[int, ...]:
    """Return the contacts at which two cylinders meet."""
    shapes = [body.shape for body in bodies]
    return tuple([k for k, pair in enumerate(pairwise(shapes)) if "sphere" not in pair])


@dataclass(frozen=True, kw_only=True)
class Geometry:
    """The bodies of a Scene, in its order, and the angles at which its cylinders cross.

    ``law`` is the law of crossed cylinders, "paper" or "exact". The crossing is defined by either ``angles`` (degrees)
    or the ``stiffness`` (N/m^1.5) that they have by the law, each with one entry per contact of the chain and None for
    a contact with a sphere. A chain of spheres has neither.

    Raises
    ------
    SceneError
        If an entry is invalid.
    """

    bodies: tuple[Body, ...]
    law: Literal["paper", "exact"] = "exact"
    angles: tuple[float | None, ...] | None = None
    stiffness: tuple[float | None, ...] | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.bodies, tuple | list) or not all(isinstance(body, Body) for body in self.bodies):
            raise SceneError("geometry.bodies", problem="is not a list of bodies", allowed="a tuple of Body")
        object.__setattr__(self, "bodies", tuple(self.bodies))
        if not isinstance(self.law, str) or self.law not in LAWS:
            raise SceneError("geometry.law", value=self.law, allowed=" or ".join(LAWS))
        if self.angles is not None and self.stiffness is not None:
            raise SceneError("geometry", problem="has both angles and stiffness", allowed="one of the two")
        crossed = crossings(self.bodies)
        if self.angles is None and self.stiffness is None and crossed:
            problem = "has crossed cylinders"
            raise SceneError("geometry", problem=problem, allowed="with their angles or their stiffness")
        for key, (allowed, most) in _CROSSING.items():
            entries, name, count = getattr(self, key), f"geometry.{key}", len(self.bodies) - 1
            if entries is None:
                continue
            if not isinstance(entries, tuple | list) or len(entries) != count:
                raise SceneError(name, value=entries, allowed=f"{count} entries, one per contact of the chain")
            for k, value in enumerate(entries):
                if (k in crossed) != (value is not None):
                    raise SceneError(
                        f"{name}[{k}]", value=value, allowed=f"{allowed}, None for a contact with a sphere"
                    )
            filled = [1.0 if value is None else value for value in entries]
            checked = checked_numbers(name, filled, allowed, above=0.0, at_most=most)
            chosen = tuple([value if k in crossed else None for k, value in enumerate(checked)])
            object.__setattr__(self, key, chosen)

    def __str__(self) -> str:
        """Return two lines: bodies, and how they cross."""
        from dem_bridge.foundation.notebook import geometry_text  # not needed for a run

        return geometry_text(self)

    @cached_property
    def angle(self) -> tuple[float | None, ...]:
        """Angle between the axes of neighbouring bodies, degrees, ``(n_body - 1,)``; None for a contact with a sphere.

        Without ``angles`` it is computed from the stiffness. ValueError is raised for a stiffness below that at 90
        degrees.
        """
        if self.angles is not None:
            return self.angles
        if self.stiffness is None:
            return (None,) * (len(self.bodies) - 1)
        from dem_bridge.physics.hertz import angle_of_stiffness  # only angles need elliptic integrals

        def crossing(body: Body, stiffness: float | None) -> float | None:
            if stiffness is None:
                return None
            return angle_of_stiffness(stiffness, law=self.law, radius=body.radius, **body.material.elastic)

        return tuple(map(crossing, self.bodies, self.stiffness))

    def contact(self, k: int, law: Literal["paper", "exact"] = "exact") -> HertzContact:
        """Return Hertz's contact of bodies k and k + 1; ``law`` is that of crossed cylinders."""
        from dem_bridge.physics.hertz import crossed_cylinders, sphere_on_cylinder, sphere_on_sphere

        body, other, angle = self.bodies[k], self.bodies[k + 1], self.angle[k]
        if angle is None and body.shape == "cylinder":
            body, other = other, body
        first, second = body.material.elastic, other.material.elastic
        pair = {"radius2": other.radius, "young2": second["young"], "poisson2": second["poisson"]}
        if angle is not None:
            return crossed_cylinders(angle=angle, law=law, radius=body.radius, **first, **pair)
        touching = sphere_on_sphere if body.shape == other.shape else sphere_on_cylinder
        return touching(radius=body.radius, **first, **pair)

    def __getstate__(self) -> dict[str, object]:
        """Return the fields alone; cached values are not sent to other processes."""
        return {field.name: getattr(self, field.name) for field in fields(self)}
