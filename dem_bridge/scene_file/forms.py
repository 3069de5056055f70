"""The tables of a scene file: which keys there are, of which types, in the raw and in the physical forms.

Numbers that go to the Scene as they are have no limits here: the Scene has the last word on them.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from dem_bridge.drive import Drive
from dem_bridge.errors import SceneError
from dem_bridge.scene import Damping, Scene, Wall

Positive = Annotated[float, Field(gt=0.0)]
Angle = Annotated[float, Field(gt=0.0, le=90.0)]
"""Between the axes of two cylinders, degrees."""
Numbers = float | list[float]


class Table(BaseModel):
    """Unknown keys, wrong types and numbers that are not finite are mistakes."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)


class RawTable(Table):
    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=True)


# what all forms have


class WallTable(RawTable):
    stiffness: float
    gap: float = 0.0
    exponent: float | None = None


class DampingTable(RawTable):
    law: Literal["dashpot", "kuwabara-kono"]
    coefficient: Numbers


class DriveTable(RawTable):
    shape: Literal["sine", "chirp", "table"]
    force: Numbers | None = None
    file: str | None = None
    """In place of ``force`` and ``interval``; read before the tables are checked: see :mod:`.drive`."""
    frequency: float | None = None
    last_frequency: float | None = None
    sweep: float | None = None
    phase: float = 0.0
    rise: float = 0.0
    interval: float | None = None

    def drive(self, duration: float) -> Drive:
        """A chirp that is not told otherwise sweeps for the ``duration`` (s) of its scene."""
        if self.force is None:
            raise SceneError("drive.force", problem="is missing", allowed="a number (N); of a table a list, or a file")
        given = self.model_dump(exclude={"file"})
        if self.shape == "chirp" and self.sweep is None:
            given["sweep"] = duration
        return Drive(**given)


class Precompression(RawTable):
    force: float


class Sampling(RawTable):
    count: int = 500


class Environment(RawTable):
    gravity: float = 0.0
    drag: float = 0.0


# raw form: numbers as lists


class RawChain(RawTable):
    mass: list[float]
    stiffness: list[float]
    velocity: list[float]
    exponent: Numbers = 2.5
    gap: Numbers = 0.0
    spacing: float | None = None
    wall_left: WallTable | None = None
    wall_right: WallTable | None = None
    precompression: Precompression | None = None
    damping: DampingTable | None = None
    drive: DriveTable | None = None


class RawScene(RawTable):
    name: str
    duration: float
    description: str = ""
    chain: RawChain
    sampling: Sampling = Sampling()
    environment: Environment = Environment()


# physical form: bodies, from which the numbers follow


class MaterialTable(Table):
    youngs_modulus: Positive
    """Pa."""
    poissons_ratio: Annotated[float, Field(gt=-1.0, le=0.5)]
    density: Positive
    """kg/m^3."""
    name: str = ""


class Cylinders(Table):
    count: Annotated[int, Field(ge=2)]
    radius: Positive
    height: Positive
    mass_gradient: float = 0.0
    """gamma: cylinder i = 1..count has the mass m (1 + gamma i), its height so much more."""


class Spheres(Table):
    count: Annotated[int, Field(ge=2)]
    radius: Positive
    """Of the first, m."""
    ratio: Positive = 1.0
    """The radius of each next is this times the one before."""


class SphereContacts(Table):
    exponent: Numbers = 2.5
    """n, one for all contacts between the bodies of the chain or one for each; the striker has its own."""
    matching_overlap: Positive | None = None
    """m: where the force of a contact with n other than 5/2 is that of Hertz; gives its stiffness."""
    gap: Numbers = 0.0
    """m; as ``exponent``."""


class CylinderContacts(SphereContacts):
    law: Literal["paper", "exact"]
    angle: Angle | None = None
    angles: list[Angle] | None = None
    first_angle: Angle | None = None
    last_angle: Angle | None = None
    grading: Literal["linear-stiffness"] | None = None
    scatter: Annotated[float, Field(ge=0.0)] | None = None
    """Standard deviation of each angle, degrees."""
    seed: Annotated[int, Field(ge=0)] | None = None


class Striker(Table):
    velocity: float
    radius: Positive | None = None
    """Of a sphere of the chain's material, m."""
    mass: Positive | None = None
    stiffness: Positive | None = None
    """N/m^(n-1), with the striker's n."""
    like: Literal["first-body"] | None = None
    """The first body again: its mass, and the stiffness of its contact with the second."""
    exponent: float | None = None
    gap: float = 0.0


class PhysicalChain(Table):
    striker: Striker | None = None
    velocity: Numbers | None = None
    """m/s, where there is no striker: of the first body, or one for each."""
    wall_left: WallTable | None = None
    wall_right: WallTable | None = None
    precompression: Precompression | None = None
    damping: DampingTable | None = None
    drive: DriveTable | None = None


class CylinderChain(PhysicalChain):
    cylinders: Cylinders
    contacts: CylinderContacts


class SphereChain(PhysicalChain):
    spheres: Spheres
    contacts: SphereContacts = SphereContacts()


# pattern form: bodies of several materials, cell after cell


class BodyTable(Table):
    shape: Literal["sphere", "cylinder"]
    radius: Positive
    height: Positive | None = None
    """Of a cylinder, which lies across the chain, m."""
    material: str | None = None
    """None: the only one."""


class Decorate(BodyTable):
    every: Annotated[int, Field(ge=1)] = 1


class Step(Table):
    first: Annotated[int, Field(ge=0, alias="from")]
    cell: Annotated[list[BodyTable], Field(min_length=1)]


class Disorder(Table):
    radius: Annotated[float, Field(ge=0.0)] = 0.0
    """Standard deviation of each radius, relative."""
    angle: Annotated[float, Field(ge=0.0)] = 0.0
    """Of each angle, degrees."""
    seed: Annotated[int, Field(ge=0)]


class Pattern(Table):
    cell: Annotated[list[BodyTable], Field(min_length=1)]
    repeat: Annotated[int, Field(ge=1)] = 1
    law: Literal["paper", "exact"] = "exact"
    angle: Angle | None = None
    angles: list[Angle] | None = None
    """One for each two cylinders of the chain that meet."""
    taper: Positive = 1.0
    gap: Numbers = 0.0
    step: Step | None = None
    decorate: Decorate | None = None
    disorder: Disorder | None = None


class PatternStriker(Striker):
    material: str | None = None
    """None: that of the first body."""


class PhysicalScene(Table):
    name: str
    duration: float
    description: str = ""
    material: MaterialTable
    sampling: Sampling = Sampling()
    environment: Environment = Environment()


class PatternWall(WallTable):
    stiffness: float = math.nan
    """Not given: it follows from the material."""
    material: str | None = None
    """Of a flat half space."""


class PatternChain(PhysicalChain):
    pattern: Pattern
    striker: PatternStriker | None = None
    wall_left: PatternWall | None = None
    wall_right: PatternWall | None = None


class PatternScene(Table):
    name: str
    duration: float
    description: str = ""
    materials: Annotated[dict[str, MaterialTable], Field(min_length=1)]
    chain: PatternChain
    sampling: Sampling = Sampling()
    environment: Environment = Environment()


class CylinderScene(PhysicalScene):
    chain: CylinderChain


class SphereScene(PhysicalScene):
    chain: SphereChain


# to a Scene


def numbers(value: Numbers) -> float | tuple[float, ...]:
    return tuple(value) if isinstance(value, list) else value


def in_common(file: RawScene | CylinderScene | SphereScene | PatternScene) -> dict[str, Any]:
    """Of a Scene's arguments, those that all forms give alike."""
    chain, damping = file.chain, file.chain.damping

    def wall(table: WallTable | None) -> Wall | None:
        return None if table is None else Wall(stiffness=table.stiffness, gap=table.gap, exponent=table.exponent)

    return {
        "name": file.name,
        "description": file.description,
        "duration": file.duration,
        "wall_left": wall(chain.wall_left),
        "wall_right": wall(chain.wall_right),
        "precompression": 0.0 if chain.precompression is None else chain.precompression.force,
        "damping": None if damping is None else Damping(law=damping.law, coefficient=numbers(damping.coefficient)),
        "drive": None if chain.drive is None else chain.drive.drive(file.duration),
        "gravity": file.environment.gravity,
        "drag": file.environment.drag,
        "samples": file.sampling.count,
    }


def from_raw(file: RawScene) -> Scene:
    """The numbers of the file, as they are."""
    chain = file.chain
    return Scene(
        mass=tuple(chain.mass),
        stiffness=tuple(chain.stiffness),
        velocity=tuple(chain.velocity),
        exponent=numbers(chain.exponent),
        gap=numbers(chain.gap),
        spacing=chain.spacing,
        **in_common(file),
    )
