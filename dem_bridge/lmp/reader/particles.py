"""The particles of a LAMMPS script.

They are defined by ``read_data``, ``create_atoms``, ``set``, ``group`` and ``velocity``. All values are in the units
of the script. Only spheres are supported; a mass is that of ``set``, or else density times volume. Commands are
evaluated in the same order as by LAMMPS, because later ones change the results of earlier ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from dem_bridge.foundation.numbers import MOST_BODIES
from dem_bridge.lmp.reader.pair_commands import numbered
from dem_bridge.lmp.reader.script import Command, Script

_SETTABLE = ("type", "mass", "density", "density/disc", "diameter", "x", "y", "z", "vx", "vy", "vz")
_SPINS = ("omegax", "omegay", "omegaz")
#: lattices with one spacing along all axes -> atoms of a cell
_LATTICES = {"sc": 1, "sq": 1, "bcc": 2, "fcc": 4, "diamond": 8}
_SECTIONS = ("Atoms", "Velocities")


@dataclass
class Particle:
    """One sphere."""

    number: int
    kind: int
    place: list[float]
    diameter: float = 1.0
    mass: float = math.pi / 6.0
    density: float = 1.0
    weighed: bool = False
    """True if the mass is given, and not a product of density and volume."""
    velocity: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    spin: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    """Angular velocity; a chain may have only such spins as cause no force."""

    @property
    def radius(self) -> float:
        """Radius of the sphere."""
        return 0.5 * self.diameter

    def made_of(self, density: float, *, disc: bool = False) -> None:
        """Set the mass to density times volume, or times area for a disc."""
        # a power beyond floats is an error, one of inf is not
        radius = self.radius if self.radius < 1e100 else math.inf
        size = math.pi * radius**2 if disc else 4.0 * math.pi / 3.0 * radius**3
        self.mass, self.density, self.weighed = size * density, density, False


@dataclass
class Particles:
    """All particles and the box."""

    script: Script
    types: int = 0
    keep_density: bool = False
    """True in LIGGGHTS, where a new diameter changes the mass and discs have the mass of their area."""
    dimension: int = 3
    reduced: bool = True
    """True in ``units lj``."""
    spacing: float = 1.0
    """Length of a lattice cell, the unit of positions and velocities without ``units box``."""
    boundary: tuple[str, str, str] = ("p", "p", "p")
    box: list[tuple[float, float]] = field(default_factory=list)
    atoms: dict[int, Particle] = field(default_factory=dict)
    groups: dict[str, set[int]] = field(default_factory=dict)
    regions: dict[str, Command] = field(default_factory=dict)
    spun: Command | None = None
    """The last command that gave atoms a spin."""
    _last: int = 0
    """Largest id of an atom."""

    def region(self, command: Command) -> None:
        """Evaluate a ``region`` command."""
        command.fail_if(len(command.rest) < 2, "is incomplete", "region ID block xlo xhi ylo yhi zlo zhi")
        self.regions[command.rest[0]] = command

    def lattice(self, command: Command) -> None:
        """Evaluate a ``lattice`` command."""
        style, *words = (*command.rest, "")
        numbers = [self.script.number(command, word) for word in words[:-1]]
        if style not in ("none", *_LATTICES) or len(numbers) != 1 or not numbers[0] > 0.0:
            raise command.error("is not supported", f"lattice {' or '.join(('none', *_LATTICES))} with one number > 0")
        self.spacing = numbers[0]
        if style != "none" and self.reduced:  # in units lj the number is the density
            self.spacing = (_LATTICES[style] / numbers[0]) ** (1.0 / self.dimension)

    def scaled(self, command: Command, word: str) -> float:
        """Return a length or velocity in the units of the script."""
        options = dict(zip(command.words, command.words[1:], strict=False))
        return self.script.number(command, word) * (1.0 if options.get("units") == "box" else self.spacing)

    def set_boundary(self, command: Command) -> None:
        """Evaluate a ``boundary`` command."""
        command.fail_if(len(command.rest) != 3, f"has {len(command.rest)} arguments", "boundary x y z")
        x, y, z = command.rest
        self.boundary = (x, y, z)

    def create_box(self, command: Command) -> None:
        """Evaluate a ``create_box`` command."""
        if len(command.rest) < 2 or command.rest[1] not in self.regions:
            raise command.error("names no region that is defined before it", "create_box TYPES REGION")
        region = self.regions[command.rest[1]]
        words = region.rest[2:]
        usual = not words[6:] or words[6:] in (("units", "box"), ("units", "lattice"))
        if region.rest[1] != "block" or len(words) < 6 or not usual:
            raise region.error("is not supported", "region ID block xlo xhi ylo yhi zlo zhi")
        ends = [self.scaled(region, word) for word in words[:6]]
        self.types = self.script.whole(command, command.rest[0])
        self.box = [(ends[0], ends[1]), (ends[2], ends[3]), (ends[4], ends[5])]

    def create_atoms(self, command: Command) -> None:
        """Evaluate a ``create_atoms`` command."""
        words = command.rest
        if len(words) < 5 or words[1] != "single" or words[5:] not in ((), ("units", "box"), ("units", "lattice")):
            raise command.error("is not supported", "create_atoms TYPE single x y z")
        command.fail_if(not self.box, "comes before the box is defined", "create_box or read_data first")
        place = [self.scaled(command, word) for word in words[2:5]]
        for (low, high), coordinate, axis in zip(self.box, place, "xyz", strict=True):
            if not low <= coordinate < high:  # on the upper side LAMMPS creates no atom, without a message
                raise command.error(f"is outside of the box along {axis}", f"from {low:g} to below {high:g}")
        self._last = number = self._last + 1
        self.atoms[number] = Particle(number, self._kind(command, words[0]), place)

    def _kind(self, command: Command, word: str) -> int:
        """Return a valid atom type."""
        kind = self.script.whole(command, word)
        command.fail_if(not 1 <= kind <= self.types, f"has the atom type {kind}", f"1 to {self.types}")
        return kind

    def read_data(self, command: Command) -> None:
        """Evaluate a LAMMPS data file, whose first line is a comment."""
        if len(command.rest) != 1 or self.atoms:
            raise command.error("has settings, or comes after other atoms", "one read_data FILE, without settings")
        file = command.rest[0]
        section, box = "", dict[str, tuple[float, float]]()
        declared = 0
        for number, line in enumerate(self.script.read(command, file).splitlines(), start=1):
            words = tuple(line.partition("#")[0].split())
            if number == 1 or not words:
                continue
            at = Command(file, number, words)
            if words[0][0].isalpha():
                section = words[0]
                if section not in _SECTIONS or len(words) > 1:
                    raise at.error("is a section that is not supported", ", ".join(_SECTIONS))
                if section == "Atoms" and (style := line.partition("#")[2].split()[:1]) not in ([], ["sphere"]):
                    raise at.error(f"has atom style {style[0]}", "Atoms # sphere")
            elif section:
                (self._atom if section == "Atoms" else self._velocity)(at)
            elif words[1:] == ("atoms",):
                declared = self.script.whole(at, words[0])
                at.fail_if(declared > MOST_BODIES, f"declares {declared} atoms", f"at most {MOST_BODIES}")
            elif words[1:] == ("atom", "types"):
                self.types = self.script.whole(at, words[0])
            elif len(words) == 4 and words[2:] in (("xlo", "xhi"), ("ylo", "yhi"), ("zlo", "zhi")):
                box[words[2]] = (self.script.number(at, words[0]), self.script.number(at, words[1]))
            elif words[0] != "0":  # such as "0 bonds"
                raise at.error("is not supported", "N atoms, N atom types, xlo xhi, ylo yhi, zlo zhi")
        if len(self.atoms) != declared or len(box) < 3:
            problem = f"{file} has {len(self.atoms)} atoms and {len(box)} sides of a box"
            raise command.error(problem, f"the {declared} atoms of its header, and xlo xhi, ylo yhi, zlo zhi")
        self.box = [box["xlo"], box["ylo"], box["zlo"]]

    def _atom(self, at: Command) -> None:
        """Evaluate a line ``id type diameter density x y z [image flags]``."""
        if len(at.words) not in (7, 10):
            raise at.error(f"has {len(at.words)} columns", "id type diameter density x y z, as atom_style sphere has")
        if any(self.script.whole(at, word) for word in at.words[7:]):
            raise at.error("is an atom that has left the box", "image flags of 0")
        number, place = self.script.whole(at, at.words[0]), [self.script.number(at, word) for word in at.words[4:7]]
        at.fail_if(number in self.atoms, f"repeats atom {number}", "each id once")
        diameter, density = (self.script.number(at, word) for word in at.words[2:4])
        if not (diameter > 0.0 and density > 0.0):
            raise at.error("has a diameter or density that is not positive", "numbers > 0")
        atom = Particle(number, self._kind(at, at.words[1]), place, diameter)
        atom.made_of(density)
        self.atoms[number] = atom
        self._last = max(self._last, number)

    def _velocity(self, at: Command) -> None:
        """Evaluate a line ``id vx vy vz wx wy wz``."""
        numbers = [self.script.number(at, word) for word in at.words[1:]]
        number = self.script.whole(at, at.words[0])
        if len(numbers) != 6 or number not in self.atoms:
            raise at.error("is not the velocity of an atom of this file", "id vx vy vz wx wy wz")
        at.fail_if(any(numbers[3:]), "has an angular velocity", "wx wy wz of 0, since bodies of a scene do not rotate")
        self.atoms[number].velocity = numbers[:3]

    def members(self, command: Command, name: str) -> set[int]:
        """Return the ids of a group."""
        if name == "all":
            return set(self.atoms)
        if name not in self.groups:
            raise command.error(f"names the group {name}, which is not defined", f"all, {', '.join(self.groups)}")
        return self.groups[name]

    def group(self, command: Command) -> None:
        """Evaluate a ``group`` command."""
        command.fail_if(len(command.rest) < 2, "is incomplete", "group ID STYLE ...")
        name, style, *words = command.rest
        self.script.count(command, len(self.atoms) * len(words) // 4)
        if style in ("id", "type"):
            chosen, key = self._ranged(command, words), "number" if style == "id" else "kind"
            members = {atom.number for atom in self.atoms.values() if chosen(getattr(atom, key))}
            self.groups[name] = self.groups.get(name, set()) | members
        elif style == "region" and len(words) == 1:
            self.groups[name] = self.groups.get(name, set()) | self._inside(command, words[0])
        elif style in ("union", "subtract", "intersect") and words:
            sets = [self.members(command, word) for word in words]
            joins: dict[str, Callable[..., set[int]]]
            joins = {"union": set.union, "subtract": set.difference, "intersect": set.intersection}
            self.groups[name] = self.groups.get(name, set()) | joins[style](*sets)
        elif style in ("empty", "clear"):
            self.groups[name] = set()
        else:
            raise command.error("is not supported", "id, type, region, union, subtract, intersect, empty and clear")

    def _inside(self, command: Command, name: str) -> set[int]:
        """Return the ids of the atoms in a region."""
        command.fail_if(name not in self.regions, f"names the region {name}, which is not defined", "a region")
        region = self.regions[name]
        kind, *words = region.rest[1:]
        numbers = {"block": 6, "sphere": 4}.get(kind, 0)
        if not 0 < numbers <= len(words) or words[numbers:] not in ([], ["units", "box"], ["units", "lattice"]):
            raise region.error("is not supported", "region ID block xlo xhi ylo yhi zlo zhi, or sphere x y z radius")
        infinite = dict.fromkeys(("INF", "EDGE"), math.inf)
        if kind == "sphere":
            *centre, radius = [self.scaled(region, word) for word in words[:4]]
            return {atom.number for atom in self.atoms.values() if math.dist(atom.place, centre) <= radius}
        ends = [infinite.get(word) or self.scaled(region, word) for word in words[:6]]
        low, high = [-abs(end) if math.isinf(end) else end for end in ends[::2]], ends[1::2]
        return {
            atom.number
            for atom in self.atoms.values()
            if all(a <= x <= b for a, x, b in zip(low, atom.place, high, strict=True))
        }

    def _ranged(self, command: Command, words: Sequence[str]) -> Callable[[int], bool]:
        """Return a function that is true for the numbers of ``n``, ``n:m`` and ``n:m:step``."""
        ranges = []
        for word in words:
            parts = [self.script.whole(command, part) for part in word.split(":")]
            command.fail_if(len(parts) > 3 or (len(parts) == 3 and parts[2] < 1), f"has {word!r}", "n, n:m or n:m:step")
            ranges.append(range(parts[0], (*parts, parts[0])[1] + 1, (*parts, 1, 1)[2] if len(parts) == 3 else 1))
        return lambda number: any(number in numbers for numbers in ranges)

    def set_values(self, command: Command) -> None:
        """Evaluate a ``set`` command."""
        if len(command.rest) < 4 or command.rest[0] not in ("atom", "type", "group", "region"):
            allowed = f"set atom|type|group|region ID and {', '.join(_SETTABLE)} with a value"
            raise command.error("is not supported", allowed)
        style, who, *pairs = command.rest
        if style == "group":
            chosen = self.members(command, who)
        elif style == "region":
            chosen = self._inside(command, who)
        else:
            most = max(self.atoms, default=0) if style == "atom" else self.types
            numbers = numbered(self.script, command, who, most)
            key = "number" if style == "atom" else "kind"
            chosen = {atom.number for atom in self.atoms.values() if getattr(atom, key) in numbers}
            self.script.count(command, len(self.atoms) // 20)
        command.fail_if(not chosen, "changes no atom", "atoms that exist")
        self.script.count(command, len(chosen) * len(pairs) // 8)
        for key, word in self._pairs(command, pairs):
            known = key in _SETTABLE or key in _SPINS
            command.fail_if(not known, f"sets {key}, which is not supported", ", ".join(_SETTABLE))
            rows = self._rows(command, word)
            for number in sorted(chosen):
                if rows is not None and number not in rows:
                    raise command.error(f"has no value for atom {number}", "one value for each atom")
                value = self.script.number(command, word) if rows is None else rows[number]
                self._set(command, self.atoms[number], key, value)

    def _pairs(self, command: Command, words: list[str]) -> list[tuple[str, str]]:
        """Return the keys and values of a ``set`` command, with the three components of ``omega`` apart."""
        while "omega" in words[::2]:
            at = 2 * words[::2].index("omega")
            spins = [word for pair in zip(_SPINS, words[at + 1 : at + 4], strict=False) for word in pair]
            words = [*words[:at], *spins, *words[at + 4 :]]
        command.fail_if(len(words) % 2 == 1, "has a key without a value", f"{', '.join(_SETTABLE)} with a value")
        return list(zip(words[::2], words[1::2], strict=True))

    def _rows(self, command: Command, word: str) -> dict[int, float] | None:
        """Return the values by atom of a variable of style atomfile, or None for one value for all."""
        style, words = self.script.variables.get(word.removeprefix("v_"), ("", ()))
        if not word.startswith("v_") or style != "atomfile":
            return None
        text = self.script.read(command, words[0])
        lines = [
            Command(words[0], at, tuple(line.split("#")[0].split())) for at, line in enumerate(text.splitlines(), 1)
        ]
        count, *rows = [line for line in lines if line.words]
        if any(len(row.words) != 2 for row in rows) or self.script.whole(count, count.words[0]) != len(rows):
            raise count.error(f"is followed by {len(rows)} rows", "the number of rows `id value` that follow")
        return {self.script.whole(row, row.words[0]): self.script.number(row, row.words[1]) for row in rows}

    def _set(self, command: Command, atom: Particle, key: str, value: float) -> None:
        """Set one property of one atom."""
        if key in ("mass", "density", "density/disc", "diameter") and not value > 0.0:
            raise command.error(f"sets {key} to {value:g}", "a number > 0")
        if key == "type":
            atom.kind = self._kind(command, f"{value!r}")
        elif key == "mass":
            atom.mass, atom.weighed = value, True
        elif key in ("density", "density/disc"):
            atom.made_of(value, disc=key == "density/disc" or (self.keep_density and self.dimension == 2))
        elif key == "diameter":
            atom.diameter = value
            if self.keep_density:  # else the mass does not change
                atom.made_of(atom.density, disc=self.dimension == 2)
        else:
            if key in _SPINS and value != 0.0:
                self.spun = command
            where = atom.spin if key in _SPINS else atom.velocity if key.startswith("v") else atom.place
            where["xyz".index(key[-1])] = value

    def set_velocity(self, command: Command) -> None:
        """Evaluate a ``velocity`` command."""
        words = command.rest
        options = dict(zip(words[5::2], words[6::2], strict=False))
        if words[1:2] != ("set",) or len(words) % 2 == 0 or len(words) < 5 or not set(options) <= {"units", "sum"}:
            raise command.error("is not supported", "velocity GROUP set vx vy vz")
        members = self.members(command, words[0])
        self.script.count(command, len(members) // 4)
        for axis, word in enumerate(words[2:5]):
            value = 0.0 if word == "NULL" else self.scaled(command, word)
            for number in members if word != "NULL" else ():
                old = self.atoms[number].velocity[axis] if options.get("sum") == "yes" else 0.0
                self.atoms[number].velocity[axis] = old + value
