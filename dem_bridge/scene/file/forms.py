"""The tables of a scene file: the keys and types of its raw, physical and pattern forms.

Numbers that are passed to the Scene unchanged have no limits here, because the Scene checks them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import fields
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from dem_bridge.errors import SceneError
from dem_bridge.foundation.numbers import MOST_BODIES, checked_number
from dem_bridge.physics.adhesion import pull_off_force
from dem_bridge.scene.damping import DAMPING_LAWS, damping_law
from dem_bridge.scene.drive import Drive
from dem_bridge.scene.piston import Piston
from dem_bridge.scene.scene import Adhesion, Damping

Positive = Annotated[float, Field(gt=0.0)]
Angle = Annotated[float, Field(gt=0.0, le=90.0)]
"""Angle between the axes of two cylinders, degrees."""
Count = Annotated[int, Field(ge=2, le=MOST_BODIES)]
Numbers = float | list[float]
#: limits that the Scene checks, with a message of its own; they are for the schema of scene files alone
ABOVE_ZERO = Field(json_schema_extra={"exclusiveMinimum": 0})
NOT_NEGATIVE = Field(json_schema_extra={"minimum": 0})
AboveZero = Annotated[float, ABOVE_ZERO]


class Table(BaseModel):
    """A table that rejects unknown keys, wrong types and numbers that are not finite."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, defer_build=True)


class RawTable(Table):
    """A table whose numbers are checked by the Scene, infinities included."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=True, defer_build=True)


# tables of all forms


class WallTable(RawTable):
    """Table [chain.wall_left] or [chain.wall_right]."""

    stiffness: AboveZero
    """Stiffness, N/m^(n-1): the force is stiffness * overlap^(n-1)."""
    gap: float = 0.0
    """Gap between the wall and the body, m; negative: an overlap at the start."""
    exponent: float | None = None
    """Exponent n of the energy; without it that of the next contact."""


class DampingTable(RawTable):
    """Table [chain.damping] or [impact.damping]."""

    law: Annotated[str, Field(json_schema_extra={"enum": list(DAMPING_LAWS)})]
    coefficient: Numbers
    """N s/m (dashpot), 1/s (mass_velocity), s (kuwabara-kono), or a coefficient of restitution; one or a list."""
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
    """Pull-off force, N, one for all contacts or one for each."""
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
    """Table [chain.drive]: a force on body 0, or its prescribed velocity."""

    shape: Literal["constant", "sine", "chirp", "table"]
    force: Numbers | None = None
    """Amplitude of the force on body 0, N; a list for the shape "table"."""
    velocity: Numbers | None = None
    """Velocity of body 0 in place of ``force``, m/s: constant, the amplitude of a sine, or a list for a table."""
    file: str | None = None
    """CSV file in place of ``force`` and ``interval``; :mod:`.measured_force` reads it before the checks."""
    frequency: AboveZero | None = None
    """Frequency, Hz; of a chirp the first."""
    last_frequency: AboveZero | None = None
    """Last frequency of a chirp, Hz."""
    sweep: AboveZero | None = None
    """Time of the sweep of a chirp, s; without it the duration of the scene."""
    phase: float = 0.0
    """Phase, degrees; 180 pulls first."""
    rise: Annotated[float, NOT_NEGATIVE] = 0.0
    """Time in which the amplitude rises from zero, s."""
    interval: AboveZero | None = None
    """Time between two values of a table, s."""

    def drive(self, duration: float) -> Drive | Piston:
        """Return the Drive or Piston; a chirp without ``sweep`` sweeps for the ``duration`` (s) of its scene."""
        if self.velocity is not None:
            return self._piston(self.velocity)
        if self.force is None:
            allowed = "a number (N); for a table a list, or a file; or velocity (m/s) for a piston"
            raise SceneError("drive.force", problem="is missing", allowed=allowed)
        values = self.model_dump(exclude={"file", "velocity"})
        if self.shape == "chirp" and self.sweep is None:
            values["sweep"] = duration
        return Drive(**values)

    def _piston(self, velocity: Numbers) -> Piston:
        """Return the Piston of this velocity."""
        own = {field.name for field in fields(Piston)}
        for key, value in self.model_dump(exclude=own, exclude_defaults=True).items():
            allowed = ", ".join(sorted(own))
            raise SceneError(f"drive.{key}", value=value, allowed=f"no such key with velocity, only {allowed}")
        values = tuple(velocity) if isinstance(velocity, list) else velocity
        return Piston(**self.model_dump(include=own) | {"velocity": values})


class Precompression(RawTable):
    """Table [chain.precompression]."""

    force: Annotated[float, NOT_NEGATIVE]
    """Static force in all contacts, N, held by the walls or by the ends."""


class Sampling(RawTable):
    """Table [sampling]."""

    count: Annotated[int, Field(json_schema_extra={"minimum": 1})] = 500
    """Number of equal sampling intervals."""


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


class ChainKeys(Table):
    """Keys of [chain] that all forms have."""

    wall_left: WallTable | None = None
    wall_right: WallTable | None = None
    precompression: Precompression | None = None
    damping: DampingTable | None = None
    adhesion: AdhesionTable | None = None
    drive: DriveTable | None = None


class SceneKeys(Table):
    """Keys of a scene file that all forms have."""

    name: str
    """Name of the scene: 1 to 100 of the characters A-Z a-z 0-9 . _ -"""
    duration: AboveZero
    """Duration, s."""
    description: str = ""
    """What happens, in one line."""
    sampling: Sampling = Sampling()
    environment: Environment = Environment()
    measurement: MeasurementTable | None = None


# raw form: numbers as lists; RawTable is the last base, because the settings of the last one count


class RawChain(ChainKeys, RawTable):
    """Table [chain] of the raw form."""

    mass: list[AboveZero]
    """Masses of the bodies, kg, the struck body first."""
    stiffness: list[AboveZero]
    """Stiffness of each contact between bodies, N/m^(n-1); contact k joins bodies k and k + 1."""
    velocity: list[float]
    """Start velocity of each body, m/s, positive away from the struck end."""
    exponent: Numbers = 2.5
    """Exponent n of the energy, one for all contacts or one for each; the force is stiffness * overlap^(n-1)."""
    gap: Numbers = 0.0
    """Gap of each contact, m, one or a list; negative: an overlap at the start."""
    spacing: AboveZero | None = None
    """Distance between the centres of neighbours, m, for wave speeds in m/s."""


class RawScene(SceneKeys, RawTable):
    """A scene file in raw form."""

    chain: RawChain


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
