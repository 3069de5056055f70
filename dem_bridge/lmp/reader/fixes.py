"""Evaluation of the ``fix`` commands of a script: which atoms move, and which forces act on them besides contacts.

``fix wall/gran`` is the pair law in the limit of a second body with infinite radius and mass; ``hertz/material`` of a
wall takes E and nu of the fix for both bodies, in contrast to a pair, whose materials are mixed (LAMMPS manual, *fix
wall/gran*, *fix wall/gran/region*).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from dem_bridge.lmp.reader import pair_laws
from dem_bridge.lmp.reader.pair_commands import Pairs
from dem_bridge.lmp.reader.pair_laws import PairLaw
from dem_bridge.lmp.reader.particles import Particles
from dem_bridge.lmp.reader.script import Command, Script

#: fixes that do not affect the motion
SILENT_FIXES = frozenset(
    {
        *("ave/atom", "ave/chunk", "ave/correlate", "ave/histo", "ave/time", "balance", "enforce2d", "print"),
        *("property/atom", "store/force", "store/state", "vector"),
    }
)
_FIXES = ("nve", "nve/sphere", "gravity", "addforce", "langevin", "viscous", "freeze", "setforce", "move")
_WALLS = ("wall/gran", "wall/gran/region")
_PLANES = ("xplane", "yplane", "zplane")
_WALL_STYLES = (*_PLANES, "zcylinder", "region")
#: settings of a wall that do not affect the motion -> number of their values
_WALL_SETTINGS = {"contacts": 0, "temperature": 1}
#: faces of a block in the numbering of ``region open``: axis and side of the bodies
_FACES = ((0, 1), (0, -1), (1, 1), (1, -1), (2, 1), (2, -1))


@dataclass(frozen=True)
class Plane:
    """A plane wall, which is perpendicular to an axis."""

    command: Command = field(compare=False)
    axis: int
    position: float
    side: int
    """+1 if bodies are at higher coordinates than the plane, -1 if at lower ones, 0 if on both sides."""
    law: PairLaw | None
    """None if it follows from the types of the wall and the atom, as in LIGGGHTS."""
    members: frozenset[int]
    """Atoms that the wall acts on."""
    kind: int = 0
    """Type of a wall of LIGGGHTS."""
    clip: bool = False
    """True if the forces of a wall of LIGGGHTS are clipped."""


@dataclass
class Forces:
    """The effect of all fixes, by atom, in the units of the script."""

    moves: set[int] = field(default_factory=set)
    """Atoms that a fix integrates."""
    moved: dict[int, Command] = field(default_factory=dict, compare=False)
    """Atoms of ``fix move``, whose motion is prescribed, and their commands."""
    frozen: set[int] = field(default_factory=set)
    """Atoms of ``fix freeze``, which also removes their mass from m_eff."""
    held: dict[int, set[int]] = field(default_factory=dict)
    """Axes along which the forces of contacts and earlier fixes are set to zero."""
    gravity: dict[int, list[float]] = field(default_factory=dict)
    drag: dict[int, float] = field(default_factory=dict)
    """Inverse relaxation times."""
    load: dict[int, list[float]] = field(default_factory=dict)
    planes: list[Plane] = field(default_factory=list)
    commands: dict[str, Command] = field(default_factory=dict, compare=False)
    """Style -> its last command."""


@dataclass
class Fixes:
    """The fixes that act at a place of a script."""

    script: Script
    particles: Particles
    pairs: Pairs
    liggghts: bool = False
    commands: dict[str, Command] = field(default_factory=dict)

    def add(self, command: Command) -> None:
        """Evaluate a ``fix`` command."""
        command.fail_if(len(command.rest) < 3, "is incomplete", "fix ID GROUP STYLE ...")
        name, group, style = command.rest[:3]
        if style in SILENT_FIXES or (self.liggghts and style in pair_laws.SILENT_FIXES):
            return
        if style == "property/global":
            self.pairs.materials.add(command)
            return
        if style not in (*_FIXES, *_WALLS):
            raise command.error(
                f"has the fix style {style}, which is not supported and may change the motion",
                f"{', '.join((*_FIXES, *_WALLS))}, and fixes without effect on the motion, such as print and ave/time",
            )
        self.particles.members(command, group)
        self._act(command, Forces())  # raises its errors here, once
        self.commands[name] = command

    def remove(self, command: Command) -> None:
        """Evaluate an ``unfix`` command."""
        for name in command.rest:
            self.commands.pop(name, None)

    def forces(self) -> Forces:
        """Return the effect of the fixes."""
        forces = Forces()
        for command in self.commands.values():
            self._act(command, forces)
        return forces

    def _act(self, command: Command, forces: Forces) -> None:
        """Add the effect of one fix."""
        style, members = command.rest[2], self.particles.members(command, command.rest[1])
        self.script.count(command, len(members) // 4)
        forces.commands[style] = command
        acting = {"gravity": self._gravity, "addforce": self._addforce, "langevin": self._langevin}
        acting |= {"viscous": self._viscous, "setforce": self._setforce}
        if style in acting:
            acting[style](command, members, forces)
        elif style in _WALLS:
            forces.planes += self._planes(command, frozenset(members))
        elif style == "move":
            twice = bool((forces.moves | {*forces.moved}) & members)
            command.fail_if(twice, "moves atoms that another fix moves", "one fix nve or fix move for each atom")
            forces.moved.update(dict.fromkeys(members, command))
        elif command.rest[3:] not in ((), ("disc",)):
            raise command.error("has settings that are not supported", f"fix ID GROUP {style}")
        elif style == "freeze":
            forces.frozen |= members
            self._hold(members, (0, 1, 2), forces)
        elif (forces.moves | {*forces.moved}) & members:
            problem = "integrates atoms that another fix integrates"
            raise command.error(problem, "one fix nve or nve/sphere for each atom")
        else:
            forces.moves |= members

    def _numbers(self, command: Command, words: Sequence[str]) -> list[float]:
        """Return numbers that are constant during a run; a formula must not contain the time step or the time."""
        keywords, self.script.keywords = self.script.keywords, {}
        try:
            return [self.script.number(command, word) for word in words]
        finally:
            self.script.keywords = keywords

    def _gravity(self, command: Command, members: set[int], forces: Forces) -> None:
        size, style, *angles = (*command.rest[3:], "", "")
        if (style, len(angles)) not in (("vector", 5), ("spherical", 4), ("chute", 3)):
            allowed = "fix ID GROUP gravity MAGNITUDE vector x y z, or spherical PHI THETA, or chute ANGLE"
            raise command.error("is not supported", allowed)
        direction = self._numbers(command, angles[:-2])
        if style != "vector":
            # manual: angles in degrees, theta from +z; a chute is tilted about y
            phi, theta = (*direction, 0.0)[:2] if style == "spherical" else (0.0, 180.0 - direction[0])
            turned = [math.radians(angle) for angle in (phi, theta)]
            direction = [math.sin(turned[1]) * math.cos(turned[0]), math.sin(turned[1]) * math.sin(turned[0])]
            # the sine of 180 degrees is zero, except for round-off
            parts = (*direction, math.cos(turned[1]))
            direction = [component if abs(component) > 1e-15 else 0.0 for component in parts]
        length = math.hypot(*direction)
        command.fail_if(not length > 0.0, "has no direction", "a vector other than 0 0 0")
        [strength] = self._numbers(command, [size])
        self._add(forces.gravity, members, [strength * component / length for component in direction])

    def _addforce(self, command: Command, members: set[int], forces: Forces) -> None:
        words = command.rest[3:]
        command.fail_if(len(words) != 3, "is not supported", "fix ID GROUP addforce fx fy fz, constants")
        self._add(forces.load, members, self._numbers(command, words))

    @staticmethod
    def _add(vectors: dict[int, list[float]], members: set[int], vector: list[float]) -> None:
        """Add a vector to those of all members."""
        for number in members:
            total = vectors.get(number, [0.0, 0.0, 0.0])
            vectors[number] = [old + component for old, component in zip(total, vector, strict=True)]

    def _langevin(self, command: Command, members: set[int], forces: Forces) -> None:
        words = command.rest[3:]
        numbers = self._numbers(command, words[:4])
        if len(words) != 4 or numbers[0] != 0.0 or numbers[1] != 0.0 or not numbers[2] > 0.0:
            raise command.error("is not a pure drag", "fix ID GROUP langevin 0 0 TIME SEED, without settings")
        for number in members:
            forces.drag[number] = forces.drag.get(number, 0.0) + 1.0 / numbers[2]

    def _viscous(self, command: Command, members: set[int], forces: Forces) -> None:
        words = command.rest[3:]
        command.fail_if(len(words) != 1, "is not supported", "fix ID GROUP viscous GAMMA, without settings")
        [gamma] = self._numbers(command, words)
        command.fail_if(gamma < 0.0, "adds energy", "gamma >= 0")
        for number in members:
            forces.drag[number] = forces.drag.get(number, 0.0) + gamma / self.particles.atoms[number].mass

    def _setforce(self, command: Command, members: set[int], forces: Forces) -> None:
        words = command.rest[3:]
        command.fail_if(len(words) != 3, "is not supported", "fix ID GROUP setforce with 0 or NULL along x, y and z")
        axes = [axis for axis, word in enumerate(words) if word != "NULL"]
        if any(self._numbers(command, [words[axis] for axis in axes])):
            raise command.error("sets a force other than 0", "0 or NULL along x, y and z; use addforce for a load")
        self._hold(members, axes, forces)

    @staticmethod
    def _hold(members: set[int], axes: Iterable[int], forces: Forces) -> None:
        """Set the forces along ``axes`` to zero, as they are up to this fix; fixes act in their order."""
        for number in members:
            forces.held.setdefault(number, set()).update(axes)
            for acting in (forces.gravity, forces.load):
                for axis in axes if number in acting else ():
                    acting[number][axis] = 0.0

    def _planes(self, command: Command, members: frozenset[int]) -> list[Plane]:
        """Return the planes of ``fix wall/gran`` or ``fix wall/gran/region``."""
        words = command.rest[3:]
        if words[:1] == ("model",):
            return [self._primitive(command, words, members)]
        at = next((k for k, word in enumerate(words) if word in _WALL_STYLES), len(words))
        allowed = "a force style with its settings, then xplane, yplane or zplane with LO HI, or region ID of planes"
        command.fail_if(at == len(words), "has no wall that is supported", allowed)
        style, law = words[at], self.pairs.wall_law(command, words[:at])
        count = 1 if style == "region" else 2
        ends, settings = words[at + 1 : at + 1 + count], list(words[at + 1 + count :])
        while settings and settings[0] in _WALL_SETTINGS:
            del settings[: 1 + _WALL_SETTINGS[settings[0]]]
        if style == "zcylinder" or len(ends) < count or settings:
            raise command.error(f"has a wall {' '.join((style, *ends, *settings))}, which is not supported", allowed)
        if style == "region":
            return [Plane(command, *face, law, members) for face in self._faces(command, ends[0])]
        sides = zip((1, -1), ends, strict=True) if "NULL" in ends or ends[0] != ends[1] else [(0, ends[0])]
        axis = _PLANES.index(style)
        return [
            Plane(command, axis, self.script.number(command, end), side, law, members)
            for side, end in sides
            if end != "NULL"
        ]

    def _primitive(self, command: Command, words: tuple[str, ...], members: frozenset[int]) -> Plane:
        """Return the plane of LIGGGHTS' ``fix wall/gran MODELS primitive type T xplane X``."""
        at = words.index("primitive") if "primitive" in words else len(words)
        behind = words[at + 1 :]
        if len(behind) != 4 or behind[0] != "type" or behind[2] not in _PLANES:
            allowed = "wall/gran model hertz tangential off primitive type T xplane|yplane|zplane POSITION"
            raise command.error("has a wall that is not supported", allowed)
        clip = self.pairs.materials.settings(command, words[:at])
        kind, [position] = self.script.whole(command, behind[1]), self._numbers(command, behind[3:])
        return Plane(command, _PLANES.index(behind[2]), position, 0, None, members, kind, clip)

    def _faces(self, command: Command, name: str) -> list[tuple[int, float, int]]:
        """Return axis, position and side of each plane of a region."""
        if name not in self.particles.regions:
            raise command.error(f"names the region {name}, which is not defined", "a region that is defined before")
        region = self.particles.regions[name]
        allowed = "region ID plane x y z nx ny nz with a normal along an axis, or block with side in"
        kind, *words = region.rest[1:]
        size = {"plane": 6, "block": 6}.get(kind, len(words) + 1)
        options, opened = words[size:], set[int]()
        side = 1
        while len(options) > 1 and options[0] in ("side", "units", "open"):
            key, value = options.pop(0), options.pop(0)
            side = -1 if (key, value) == ("side", "out") else side
            if key == "open":
                opened.add(self.script.whole(region, value) - 1)
        region.fail_if(len(words) < size or bool(options), "is a wall that is not supported", allowed)
        if kind == "block":
            region.fail_if(side < 0, "is a block whose bodies are outside, which is not supported", allowed)
            faces = [(axis, words[k], side) for k, (axis, side) in enumerate(_FACES) if k not in opened]
            infinite = ("INF", "EDGE")
            return [(a, self.particles.scaled(region, word), s) for a, word, s in faces if word not in infinite]
        normal = self._numbers(region, words[3:6])
        axes = [axis for axis in range(3) if normal[axis] != 0.0]
        region.fail_if(len(axes) != 1 or bool(opened), "is a plane that is not perpendicular to an axis", allowed)
        [axis] = axes
        return [(axis, self.particles.scaled(region, words[axis]), side if normal[axis] > 0.0 else -side)]
