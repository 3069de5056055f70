"""The tables of a scene file: the keys and types of the raw and the physical forms.

Numbers that are passed to the Scene unchanged have no limits here, because the Scene checks them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from dem_bridge.checked import MOST_BODIES, checked_number
from dem_bridge.damping import damping_law
from dem_bridge.drive import Drive
from dem_bridge.errors import SceneError
from dem_bridge.geometry import Body
from dem_bridge.physics.adhesion import pull_off_force
from dem_bridge.scene import Adhesion, Damping, Scene, Wall

Positive = Annotated[float, Field(gt=0.0)]
Angle = Annotated[float, Field(gt=0.0, le=90.0)]
"""Angle between the axes of two cylinders, degrees."""
Count = Annotated[int, Field(ge=2, le=MOST_BODIES)]
Numbers = float | list[float]


class Table(BaseModel):
    """A table that rejects unknown keys, wrong types and numbers that are not finite."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)


class RawTable(Table):
    """A table whose numbers are checked by the Scene, infinities included."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=True)


# tables of all forms


class WallTable(RawTable):
    """Table [chain.wall_left] or [chain.wall_right]."""

    stiffness: float
    gap: float = 0.0
    exponent: float | None = None


class DampingTable(RawTable):
    """Table [chain.damping] or [impact.damping]."""

    law: str
    coefficient: Numbers
    clip: bool | None = None
    """True if net forces are clipped at zero; None means true, or false with adhesion."""

    def damping(self) -> Damping:
        """Return the Damping."""
        value = tuple(self.coefficient) if isinstance(self.coefficient, list) else self.coefficient
        return Damping(law=damping_law(self.law), coefficient=value, clip=self.clip)


class AdhesionTable(RawTable):
    """Table [chain.adhesion]."""

    law: Literal["dmt", "jkr"]
    pull_off: Numbers | None = None
    surface_energy: float | None = None
    """Surface energy of spheres, J/m^2, in place of ``pull_off``."""

    def adhesion(self, radii: Sequence[float] | None = None) -> Adhesion:
        """Return the Adhesion; ``radii`` are the effective radii of all contacts, m, if all bodies are spheres."""
        if self.pull_off is not None and self.surface_energy is None:
            values = self.pull_off
            return Adhesion(law=self.law, pull_off=tuple(values) if isinstance(values, list) else values)
        if self.surface_energy is None or self.pull_off is not None:
            problem = "needs one of two keys"
            raise SceneError("adhesion", problem=problem, allowed="pull_off (N) or surface_energy (J/m^2)")
        if radii is None:
            allowed = "pull_off (N), or spheres of known radii"
            raise SceneError("adhesion.surface_energy", problem="requires radii", allowed=allowed)
        checked_number("adhesion.surface_energy", self.surface_energy, "a number > 0 (J/m^2)", above=0.0)
        forces = [pull_off_force(self.law, radius=r, surface_energy=self.surface_energy) for r in radii]
        return Adhesion(law=self.law, pull_off=tuple(float(f"{force:.12g}") for force in forces))


class DriveTable(RawTable):
    """Table [chain.drive]."""

    shape: Literal["sine", "chirp", "table"]
    force: Numbers | None = None
    file: str | None = None
    """CSV file in place of ``force`` and ``interval``; :mod:`.drive` reads it before the tables are checked."""
    frequency: float | None = None
    last_frequency: float | None = None
    sweep: float | None = None
    phase: float = 0.0
    rise: float = 0.0
    interval: float | None = None

    def drive(self, duration: float) -> Drive:
        """Return the Drive; a chirp without ``sweep`` sweeps for the ``duration`` (s) of its scene."""
        if self.force is None:
            raise SceneError("drive.force", problem="is missing", allowed="a number (N); for a table a list, or a file")
        values = self.model_dump(exclude={"file"})
        if self.shape == "chirp" and self.sweep is None:
            values["sweep"] = duration
        return Drive(**values)


class Precompression(RawTable):
    """Table [chain.precompression]."""

    force: float


class Sampling(RawTable):
    """Table [sampling]."""

    count: int = 500


class Environment(RawTable):
    """Table [environment]: each key is an argument of Scene; its description begins with its unit.

    Scene files that are written, and templates with the value under ``examples``, follow from these declarations.
    """

    gravity: Annotated[float, Field(description="m/s^2, positive towards the last body", examples=[9.81])] = 0.0
    drag: Annotated[float, Field(description="1/s: a force -drag mass velocity on each body", examples=[1.0])] = 0.0

    @classmethod
    def template_lines(cls) -> list[str]:
        """Return the table as lines that are commented out, with the example and the description of each key."""
        keys = [
            (f"#{key} = {(field.examples or [0.0])[0]!r}", field.description) for key, field in cls.model_fields.items()
        ]
        return ["#[environment]", *(f"{setting:<31}# {description}" for setting, description in keys)]

    @classmethod
    def units(cls) -> dict[str, str]:
        """Return the unit of each key."""
        return {key: re.split("[,:]", field.description or "")[0] for key, field in cls.model_fields.items()}


class MeasurementTable(Table):
    """Table [measurement]: files of measured values, and parameters of the scene with their standard uncertainties."""

    file: str | list[str]
    """CSV file, or several, relative to the folder of the scene file."""
    source: str = ""
    """Who measured what and how, or where the figure was published."""
    kind: Literal["measured", "digitised", "synthetic"] = "measured"
    parameters: dict[str, Positive] = {}
    """Standard uncertainty of each parameter: of its value relative to the scene's, or absolute."""
    fit: list[str] | None = None
    """Parameters that are fitted; None means all that are declared for the whole scene."""


# raw form: numbers as lists


class RawChain(RawTable):
    """Table [chain] of the raw form."""

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
    adhesion: AdhesionTable | None = None
    drive: DriveTable | None = None


class RawScene(RawTable):
    """A scene file in raw form."""

    name: str
    duration: float
    description: str = ""
    chain: RawChain
    sampling: Sampling = Sampling()
    environment: Environment = Environment()
    measurement: MeasurementTable | None = None


# physical form: bodies, from which the numbers are computed


class MaterialTable(Table):
    """Table [material] or [materials.NAME]."""

    youngs_modulus: Positive
    """Young's modulus, Pa."""
    poissons_ratio: Annotated[float, Field(gt=-1.0, le=0.5)]
    density: Positive
    """Density, kg/m^3."""
    name: str = ""


class Cylinders(Table):
    """Table [chain.cylinders]."""

    count: Count
    radius: Positive
    height: Positive
    mass_gradient: float = 0.0
    """gamma: cylinder i = 1..count has the mass m (1 + gamma i), and its height changes by the same factor."""


class Spheres(Table):
    """Table [chain.spheres]."""

    count: Count
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
    angle: Angle | None = None
    angles: list[Angle] | None = None
    first_angle: Angle | None = None
    last_angle: Angle | None = None
    grading: Literal["linear-stiffness"] | None = None
    scatter: Annotated[float, Field(ge=0.0)] | None = None
    """Standard deviation of each angle, degrees."""
    seed: Annotated[int, Field(ge=0)] | None = None


class Striker(Table):
    """Table [chain.striker]."""

    velocity: float
    radius: Positive | None = None
    """Radius of a sphere of the chain's material, m."""
    mass: Positive | None = None
    stiffness: Positive | None = None
    """Stiffness of the struck contact, N/m^(n-1), with the striker's n."""
    like: Literal["first-body"] | None = None
    """"first-body": the striker has the mass of the first body, and the stiffness of its contact with the second."""
    exponent: float | None = None
    gap: float = 0.0


class PhysicalChain(Table):
    """Keys of [chain] that all physical forms have."""

    striker: Striker | None = None
    velocity: Numbers | None = None
    """Start velocity, m/s, of a chain without a striker: of the first body, or one for each."""
    wall_left: WallTable | None = None
    wall_right: WallTable | None = None
    precompression: Precompression | None = None
    damping: DampingTable | None = None
    adhesion: AdhesionTable | None = None
    drive: DriveTable | None = None


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
    cell: Annotated[list[BodyTable], Field(min_length=1)]


class Disorder(Table):
    """Table [chain.pattern.disorder]: random radii and angles."""

    radius: Annotated[float, Field(ge=0.0)] = 0.0
    """Standard deviation of each radius, relative to the radius."""
    angle: Annotated[float, Field(ge=0.0)] = 0.0
    """Standard deviation of each angle, degrees."""
    seed: Annotated[int, Field(ge=0)]


class Pattern(Table):
    """Table [chain.pattern]."""

    cell: Annotated[list[BodyTable], Field(min_length=1)]
    repeat: Annotated[int, Field(ge=1, le=MOST_BODIES)] = 1
    law: Literal["paper", "exact"] = "exact"
    angle: Angle | None = None
    angles: list[Angle] | None = None
    """One angle for each contact of two cylinders of the chain, degrees."""
    taper: Positive = 1.0
    gap: Numbers = 0.0
    step: Step | None = None
    decorate: Decorate | None = None
    disorder: Disorder | None = None


class PatternStriker(Striker):
    """Table [chain.striker] of a pattern."""

    material: str | None = None
    """Name of the material; None means that of the first body."""


class PhysicalScene(Table):
    """A scene file with bodies of one material."""

    name: str
    duration: float
    description: str = ""
    material: MaterialTable
    sampling: Sampling = Sampling()
    environment: Environment = Environment()
    measurement: MeasurementTable | None = None


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


class PatternScene(Table):
    """A scene file with a pattern of bodies of several materials."""

    name: str
    duration: float
    description: str = ""
    materials: Annotated[dict[str, MaterialTable], Field(min_length=1)]
    chain: PatternChain
    sampling: Sampling = Sampling()
    environment: Environment = Environment()
    measurement: MeasurementTable | None = None


class CylinderScene(PhysicalScene):
    """A scene file with a chain of crossed cylinders."""

    chain: CylinderChain


class SphereScene(PhysicalScene):
    """A scene file with a chain of spheres."""

    chain: SphereChain


# conversion to a Scene


def effective_radii(bodies: Sequence[Body], walls: tuple[bool, bool]) -> list[float] | None:
    """Return the effective radii of all contacts, m, those of the left and the right wall last; None if not spheres."""
    if not bodies or any(body.shape != "sphere" for body in bodies):
        return None
    radii = [body.radius for body in bodies]
    links = [1.0 / (1.0 / first + 1.0 / second) for first, second in pairwise(radii)]
    return links + [radius for radius, wall in zip((radii[0], radii[-1]), walls, strict=True) if wall]


def in_common(
    file: RawScene | CylinderScene | SphereScene | PatternScene, bodies: Sequence[Body] = ()
) -> dict[str, Any]:
    """Return the arguments of a Scene that all forms share; ``bodies`` if they are known."""
    chain, damping = file.chain, file.chain.damping
    radii = effective_radii(bodies, (chain.wall_left is not None, chain.wall_right is not None))

    def wall(table: WallTable | None) -> Wall | None:
        return None if table is None else Wall(stiffness=table.stiffness, gap=table.gap, exponent=table.exponent)

    return {
        "name": file.name,
        "description": file.description,
        "duration": file.duration,
        "wall_left": wall(chain.wall_left),
        "wall_right": wall(chain.wall_right),
        "precompression": 0.0 if chain.precompression is None else chain.precompression.force,
        "damping": None if damping is None else damping.damping(),
        "adhesion": None if chain.adhesion is None else chain.adhesion.adhesion(radii),
        "drive": None if chain.drive is None else chain.drive.drive(file.duration),
        "samples": file.sampling.count,
        **file.environment.model_dump(),
    }


def from_raw(file: RawScene) -> Scene:
    """Return the Scene of a file in raw form."""
    shared = in_common(file)
    return Scene(**file.chain.model_dump(exclude=set(shared)), **shared)
