"""The tables of a scene file whose chain consists of bodies: the physical and the pattern forms."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field

from dem_bridge.foundation.numbers import MOST_BODIES
from dem_bridge.scene.file.forms import Angle, ChainKeys, Count, Numbers, Positive, SceneKeys, Table, WallTable

# physical form: bodies, from which the numbers are computed


class MaterialTable(Table):
    """Table [material] or [materials.NAME]."""

    youngs_modulus: Positive
    """Young's modulus, Pa."""
    poissons_ratio: Annotated[float, Field(gt=-1.0, le=0.5)]
    """Poisson's ratio."""
    density: Positive
    """Density, kg/m^3."""
    name: str = ""
    """Name of the material."""


class Cylinders(Table):
    """Table [chain.cylinders]."""

    count: Count
    """Number of cylinders, without the striker."""
    radius: Positive
    """Radius, m."""
    height: Positive
    """Height, m."""
    mass_gradient: float = 0.0
    """gamma: cylinder i = 1..count has the mass m (1 + gamma i), and its height changes by the same factor."""


class Spheres(Table):
    """Table [chain.spheres]."""

    count: Count
    """Number of spheres, without the striker."""
    radius: Positive
    """Radius of the first sphere, m."""
    ratio: Positive = 1.0
    """Ratio of each radius to the previous one."""


class SphereContacts(Table):
    """Table [chain.contacts] of spheres."""

    exponent: Numbers = 2.5
    """Exponent n, one for all contacts between the bodies of the chain or one for each, without the striker's."""
    matching_overlap: Positive | None = None
    """Overlap at which a contact with n other than 5/2 has the Hertz force, m; it determines the stiffness."""
    gap: Numbers = 0.0
    """Gap, m, one or a list as ``exponent``."""


class CylinderContacts(SphereContacts):
    """Table [chain.contacts] of cylinders."""

    law: Literal["paper", "exact"]
    """Stiffness of crossed cylinders: the approximation of the paper, or the exact elliptic contact."""
    angle: Angle | None = None
    """Angle between the axes of neighbours, degrees, for all contacts."""
    angles: list[Angle] | None = None
    """Angle of each contact, degrees."""
    first_angle: Angle | None = None
    """Angle of the first contact, degrees, with ``last_angle`` and ``grading``."""
    last_angle: Angle | None = None
    """Angle of the last contact, degrees."""
    grading: Literal["linear-stiffness"] | None = None
    """How angles follow between the first and the last: the stiffness changes linearly."""
    scatter: Annotated[float, Field(ge=0.0)] | None = None
    """Standard deviation of each angle, degrees."""
    seed: Annotated[int, Field(ge=0)] | None = None
    """Seed of the scatter."""


class Striker(Table):
    """Table [chain.striker]."""

    velocity: float
    """Speed at the start, m/s."""
    radius: Positive | None = None
    """Radius of a sphere of the chain's material, m."""
    mass: Positive | None = None
    """Mass, kg, in place of a radius."""
    stiffness: Positive | None = None
    """Stiffness of the struck contact, N/m^(n-1), with the striker's n."""
    like: Literal["first-body"] | None = None
    """"first-body": the striker has the mass of the first body, and the stiffness of its contact with the second."""
    exponent: float | None = None
    """Exponent n of the struck contact."""
    gap: float = 0.0
    """Gap of the struck contact, m."""


class PhysicalChain(ChainKeys):
    """Keys of [chain] that all physical forms have."""

    striker: Striker | None = None
    velocity: Numbers | None = None
    """Start velocity, m/s, of a chain without a striker: of the first body, or one for each."""


class CylinderChain(PhysicalChain):
    """Table [chain] of cylinders."""

    cylinders: Cylinders
    contacts: CylinderContacts


class SphereChain(PhysicalChain):
    """Table [chain] of spheres."""

    spheres: Spheres
    contacts: SphereContacts = SphereContacts()


# pattern form: repeated unit cells of bodies of several materials


class BodyTable(Table):
    """A body of a pattern."""

    shape: Literal["sphere", "cylinder"]
    radius: Positive
    """Radius, m."""
    height: Positive | None = None
    """Height of a cylinder, which lies across the chain, m."""
    material: str | None = None
    """Name of the material; None means the only one."""


class Decorate(BodyTable):
    """Table [chain.pattern.decorate]: a body that is inserted behind each ``every``-th one."""

    every: Annotated[int, Field(ge=1)] = 1


class Step(Table):
    """Table [chain.pattern.step]: another unit cell from a cell on."""

    first: Annotated[int, Field(ge=0, alias="from")]
    """Number of the first of these cells, from 0."""
    cell: Annotated[list[BodyTable], Field(min_length=1)]


class Disorder(Table):
    """Table [chain.pattern.disorder]: random radii and angles."""

    radius: Annotated[float, Field(ge=0.0)] = 0.0
    """Standard deviation of each radius, relative to the radius."""
    angle: Annotated[float, Field(ge=0.0)] = 0.0
    """Standard deviation of each angle, degrees."""
    seed: Annotated[int, Field(ge=0)]
    """Seed of the random numbers."""


class Pattern(Table):
    """Table [chain.pattern]."""

    cell: Annotated[list[BodyTable], Field(min_length=1)]
    """Bodies of the unit cell."""
    repeat: Annotated[int, Field(ge=1, le=MOST_BODIES)] = 1
    """Number of unit cells."""
    law: Literal["paper", "exact"] = "exact"
    """Stiffness of crossed cylinders: the approximation of the paper, or the exact elliptic contact."""
    angle: Angle | None = None
    """Angle between the axes of two cylinders that meet, degrees."""
    angles: list[Angle] | None = None
    """One angle for each contact of two cylinders of the chain, degrees."""
    taper: Positive = 1.0
    """Ratio of the radius of each body to that of the same body of the cell before."""
    gap: Numbers = 0.0
    """Gap, m, one for all contacts or one for each."""
    step: Step | None = None
    decorate: Decorate | None = None
    disorder: Disorder | None = None


class PatternStriker(Striker):
    """Table [chain.striker] of a pattern."""

    material: str | None = None
    """Name of the material; None means that of the first body."""


class PhysicalScene(SceneKeys):
    """A scene file with bodies of one material."""

    material: MaterialTable


class PatternWall(WallTable):
    """Table [chain.wall_left] or [chain.wall_right] of a pattern."""

    stiffness: float = math.nan
    """Stiffness; nan if the wall is defined by its material."""
    material: str | None = None
    """Name of the material of a flat half-space."""


class PatternChain(PhysicalChain):
    """Table [chain] of a pattern."""

    pattern: Pattern
    striker: PatternStriker | None = None
    wall_left: PatternWall | None = None
    wall_right: PatternWall | None = None


class PatternScene(SceneKeys):
    """A scene file with a pattern of bodies of several materials."""

    materials: Annotated[dict[str, MaterialTable], Field(min_length=1)]
    chain: PatternChain


class CylinderScene(PhysicalScene):
    """A scene file with a chain of crossed cylinders."""

    chain: CylinderChain


class SphereScene(PhysicalScene):
    """A scene file with a chain of spheres."""

    chain: SphereChain
