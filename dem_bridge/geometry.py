"""What the bodies of a chain are: shapes, sizes, materials, and the angles at which cylinders cross.

It decides nothing of the motion, which follows from a Scene's masses and stiffnesses alone; it is there for what is
asked about them: how large a contact ellipse is, what another contact law would say, how heavy a body should be.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Literal, TypedDict

from dem_bridge.checked import checked_number
from dem_bridge.errors import SceneError

if TYPE_CHECKING:
    from dem_bridge.physics.hertz import HertzContact

#: contact laws of two crossed cylinders: the paper's approximate axis ratio, and Hertz' own
LAWS = ("paper", "exact")
SHAPES = ("sphere", "cylinder")
#: what an angle between two axes may be, degrees
ANGLE = "a number > 0 and <= 90 (degrees)"


class Elastic(TypedDict):
    """What contact laws ask of a material."""

    young: float
    poisson: float


@dataclass(frozen=True, kw_only=True)
class Material:
    """``youngs_modulus`` in Pa, ``density`` in kg/m^3; SceneError for what no material has.

    >>> Material(youngs_modulus=72e9, poissons_ratio=0.17, density=2200.0, name="fused quartz").density
    2200.0
    """

    youngs_modulus: float
    poissons_ratio: float
    density: float
    name: str = ""

    def __post_init__(self) -> None:
        for key, unit in (("youngs_modulus", "Pa"), ("density", "kg/m^3")):
            number = checked_number(f"material.{key}", getattr(self, key), f"a number > 0 ({unit})", above=0.0)
            object.__setattr__(self, key, number)
        ratio = checked_number("material.poissons_ratio", self.poissons_ratio, "-1 < nu <= 0.5")
        if not -1.0 < ratio <= 0.5:
            raise SceneError("material.poissons_ratio", found=ratio, allowed="-1 < nu <= 0.5")
        object.__setattr__(self, "poissons_ratio", ratio)

    @property
    def elastic(self) -> Elastic:
        """As :mod:`dem_bridge.physics.hertz` takes it."""
        return {"young": self.youngs_modulus, "poisson": self.poissons_ratio}


@dataclass(frozen=True, kw_only=True)
class Body:
    """A "sphere", or a "cylinder" lying across the chain; ``radius`` and ``height`` in m, None for a sphere's height.

    >>> quartz = Material(youngs_modulus=72e9, poissons_ratio=0.17, density=2200.0)
    >>> f"{1e3 * Body(shape='sphere', radius=9e-3, material=quartz).mass:.2f} g"
    '6.72 g'
    """

    shape: str
    radius: float
    material: Material
    height: float | None = None

    def __post_init__(self) -> None:
        if self.shape not in SHAPES:
            raise SceneError("body.shape", found=self.shape, allowed=" or ".join(SHAPES))
        if not isinstance(self.material, Material):
            raise SceneError("body.material", found=self.material, allowed="a Material")
        if (self.height is None) != (self.shape == "sphere"):
            raise SceneError("body.height", found=self.height, allowed="a number > 0 (m), None for a sphere")
        for key in ("radius", "height"):
            if (value := getattr(self, key)) is not None:
                number = checked_number(f"body.{key}", value, "a number > 0 (m)", above=0.0)
                object.__setattr__(self, key, number)

    @property
    def mass(self) -> float:
        """Density times volume, kg. What a Scene takes for its mass may be another."""
        if self.height is None:
            return self.material.density * 4.0 / 3.0 * math.pi * self.radius**3
        return self.material.density * math.pi * self.radius**2 * self.height


@dataclass(frozen=True, kw_only=True)
class Geometry:
    """The bodies of a Scene, in its order, and how its chain's contacts cross.

    ``law`` is that of crossed cylinders, "paper" or "exact". How they cross is known by one of two, each with an entry
    per contact of the chain and None where a sphere takes part: ``angles`` (degrees), or the ``stiffness``
    (N/m^1.5) that they give by the law. A chain of spheres has neither. Raises SceneError for anything else.
    """

    bodies: tuple[Body, ...]
    law: Literal["paper", "exact"] = "exact"
    angles: tuple[float | None, ...] | None = None
    stiffness: tuple[float | None, ...] | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.bodies, tuple | list) or not all(isinstance(one, Body) for one in self.bodies):
            raise SceneError("geometry.bodies", problem="is no list of bodies", allowed="a tuple of Body")
        object.__setattr__(self, "bodies", tuple(self.bodies))
        if self.law not in LAWS:
            raise SceneError("geometry.law", found=self.law, allowed=" or ".join(LAWS))
        if self.angles is not None and self.stiffness is not None:
            raise SceneError("geometry", problem="has angles and stiffness", allowed="one of the two")
        if self.angles is None and self.stiffness is None and any(self._crossed):
            raise SceneError("geometry", problem="has cylinders that cross", allowed="their angles, or their stiffness")
        for key, allowed in (("angles", ANGLE), ("stiffness", "a number > 0 (N/m^1.5)")):
            if getattr(self, key) is not None:
                object.__setattr__(self, key, self._checked(key, allowed))
        for k, angle in enumerate(self.angles or ()):
            if angle is not None and angle > 90.0:
                raise SceneError(f"geometry.angles[{k}]", found=angle, allowed=ANGLE)

    @property
    def _crossed(self) -> tuple[bool, ...]:
        """Whether each contact is one of two cylinders."""
        shapes = [body.shape for body in self.bodies]
        return tuple("sphere" not in pair for pair in pairwise(shapes))

    def _checked(self, key: str, allowed: str) -> tuple[float | None, ...]:
        given, name = getattr(self, key), f"geometry.{key}"
        if not isinstance(given, tuple | list) or len(given) != len(self._crossed):
            raise SceneError(name, found=given, allowed=f"{len(self._crossed)} entries, one per contact of the chain")
        for k, (value, crossed) in enumerate(zip(given, self._crossed, strict=True)):
            if crossed != (value is not None):
                raise SceneError(f"{name}[{k}]", found=value, allowed=f"{allowed}, None where a sphere takes part")
        return tuple(
            None if value is None else checked_number(f"{name}[{k}]", value, allowed, above=0.0)
            for k, value in enumerate(given)
        )

    @cached_property
    def angle(self) -> tuple[float | None, ...]:
        """Between the axes of each two neighbours, degrees; None where a sphere takes part, ``(n_body - 1,)``.

        Found from the stiffness when asked for, where no angles were given. ValueError for a stiffness that no angle
        has: below that at 90 degrees.
        """
        if self.angles is not None:
            return self.angles
        if self.stiffness is None:
            return (None,) * len(self._crossed)
        from dem_bridge.physics.hertz import angle_of_stiffness  # elliptic integrals, which no motion needs

        def crossing(body: Body, stiffness: float | None) -> float | None:
            if stiffness is None:
                return None
            return angle_of_stiffness(stiffness, law=self.law, radius=body.radius, **body.material.elastic)

        return tuple(map(crossing, self.bodies, self.stiffness))

    def contact(self, k: int, law: Literal["paper", "exact"] = "exact") -> HertzContact:
        """Hertz' contact of bodies k and k + 1, each of its own material; ``law``: of crossed cylinders."""
        from dem_bridge.physics.hertz import crossed_cylinders, sphere_on_cylinder, sphere_on_sphere

        one, other, angle = self.bodies[k], self.bodies[k + 1], self.angle[k]
        if angle is None and one.shape == "cylinder":
            one, other = other, one
        first, second = one.material.elastic, other.material.elastic
        pair = {"radius2": other.radius, "young2": second["young"], "poisson2": second["poisson"]}
        if angle is not None:
            return crossed_cylinders(angle=angle, law=law, radius=one.radius, **first, **pair)
        touching = sphere_on_sphere if one.shape == other.shape else sphere_on_cylinder
        return touching(radius=one.radius, **first, **pair)

    def __getstate__(self) -> dict[str, object]:
        """What is found again travels to no other process."""
        return {field.name: getattr(self, field.name) for field in fields(self)}
