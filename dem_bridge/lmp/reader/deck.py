"""A LAMMPS input script read as LAMMPS would, up to its first run: particles, pair laws, fixes, steps.

What has no say in the motion is passed over by name; what has one is understood or refused, with file and line. How a
Scene follows is in :mod:`.scene`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise

from dem_bridge.lmp.reader.pairs import Pairs
from dem_bridge.lmp.reader.particles import Particles
from dem_bridge.lmp.reader.script import Command, Opened, Script

#: SI values of a style's length, time and mass; forces and stiffnesses follow of them (manual, command units)
UNITS = {
    "si": (1.0, 1.0, 1.0),
    "cgs": (1e-2, 1.0, 1e-3),
    "micro": (1e-6, 1e-6, 1e-15),
    "nano": (1e-9, 1e-9, 1e-21),
}
#: time steps of scripts that name none, in their own units (manual, command timestep)
_DEFAULT_STEP = {"si": 1e-8, "cgs": 1e-8, "micro": 2.0, "nano": 0.00045}
#: commands that change no motion
SILENT = frozenset(
    {
        *("atom_modify", "balance", "comm_modify", "comm_style", "compute", "compute_modify", "dump", "dump_modify"),
        *("echo", "info", "log", "min_modify", "min_style", "neighbor", "newton", "package", "print", "processors"),
        *("restart", "suffix", "thermo", "thermo_modify", "thermo_style", "timer", "uncompute"),
        *("undump", "write_data", "write_dump", "write_restart"),
    }
)
#: ... and fixes
_SILENT_FIXES = frozenset({"ave/atom", "ave/chunk", "ave/time", "balance", "enforce2d", "print", "vector"})
#: steps between two looks at who is near: those that LAMMPS has had as defaults are safe with its default skin
_WAITS = frozenset(map(str, range(11)))
_FIXES = ("nve", "nve/sphere", "gravity", "addforce", "langevin", "freeze", "setforce")


@dataclass
class Forces:
    """What fixes do, by atom, in the units of the script."""

    moves: set[int] = field(default_factory=set)
    """Integrated."""
    frozen: set[int] = field(default_factory=set)
    """By ``fix freeze``, which takes their mass out of m_eff, too."""
    held: dict[int, set[int]] = field(default_factory=dict)
    """Axes along which nothing acts that an earlier fix or a contact does."""
    gravity: dict[int, list[float]] = field(default_factory=dict)
    drag: dict[int, float] = field(default_factory=dict)
    """Inverse times."""
    load: dict[int, list[float]] = field(default_factory=dict)
    said: dict[str, Command] = field(default_factory=dict)
    """Style -> the last command of it."""


@dataclass
class ReadScript:
    """What a script has said. Made by :func:`read_script`."""

    script: Script
    particles: Particles
    pairs: Pairs
    units: str = "lj"
    step: float | None = None
    duration: float = 0.0
    """In the units of the script."""
    steps: int = 0
    counter: int = 0
    """What LAMMPS counts steps by, which a script may set."""
    dump_every: int | None = None
    """Steps between the frames of the first dump."""
    run: Command | None = None
    """The first."""
    last: Command | None = None
    fixes: dict[str, Command] = field(default_factory=dict)
    acting: Forces | None = None
    """What fixes do while it runs."""
    _dump: str | None = None

    def take(self, command: Command) -> None:
        """One command."""
        self.last = command
        known = self._known
        if command.name in ("dump", "dump_modify"):
            self._frames(command)
        if command.name in SILENT:
            return
        if command.name not in known:
            allowed = f"{', '.join(known)}, and what changes no motion: {', '.join(sorted(SILENT))}"
            raise command.refused("is a command that is not read here and may change the motion", allowed)
        if self.run is not None and command.name not in ("run", "timestep", "reset_timestep"):
            raise command.refused(
                f"stands behind the run in line {self.run.line}, and a scene has one start",
                "run, timestep, reset_timestep and what changes no motion",
                "a state that an earlier run made: write it with write_data, and read that",
            )
        known[command.name](command)

    @property
    def _known(self) -> Mapping[str, Callable[[Command], None]]:
        particles = self.particles
        return {
            "units": self._units,
            "dimension": lambda command: self._only(command, ("2",), ("3",)),
            "boundary": particles.set_boundary,
            "atom_style": lambda command: self._only(command, ("sphere",), ("sphere", "0")),
            "lattice": lambda command: self._only(command, ("none", "1.0"), ("none", "1")),
            "region": particles.region,
            "create_box": particles.create_box,
            "create_atoms": particles.create_atoms,
            "read_data": particles.read_data,
            "set": particles.set_values,
            "group": particles.group,
            "velocity": particles.set_velocity,
            "pair_style": self.pairs.pair_style,
            "pair_coeff": lambda command: self.pairs.pair_coeff(command, particles.types),
            "neigh_modify": self._neigh_modify,
            "run_style": lambda command: self._only(command, ("verlet",)),
            "fix": self._fix,
            "unfix": self._unfix,
            "timestep": self._timestep,
            "reset_timestep": self._reset_timestep,
            "run": self._run,
        }

    @staticmethod
    def _only(command: Command, *allowed: tuple[str, ...]) -> None:
        if command.rest not in allowed:
            raise command.refused("is not read here", " or ".join(f"{command.name} {' '.join(one)}" for one in allowed))

    def _units(self, command: Command) -> None:
        self._only(command, *((one,) for one in UNITS))
        self.units = command.rest[0]

    @staticmethod
    def _neigh_modify(command: Command) -> None:
        if "exclude" in command.rest:
            raise command.refused("leaves out pairs that may touch", "neigh_modify without exclude")
        said = dict(pairwise(command.rest))
        waits = any(said.get(key, "0") not in _WAITS for key in ("every", "delay"))
        if waits or said.get("once") == "yes" or (said.get("check") == "no" and said.get("every", "1") != "1"):
            raise command.refused(
                "may miss bodies that meet between two looks", "every and delay of 0 to 10, check yes"
            )

    def _frames(self, command: Command) -> None:
        words = command.rest
        if command.name == "dump" and self._dump is None and len(words) > 3:
            self._dump = words[0]
            if words[3].isdigit():
                self.dump_every = int(words[3])
        elif command.name == "dump_modify" and words[:1] == (self._dump,) and "every" in words[:-1]:
            every = words[words.index("every") + 1]
            self.dump_every = int(every) if every.isdigit() else None

    def _fix(self, command: Command) -> None:
        if len(command.rest) < 3:
            raise command.refused("is no fix", "fix ID GROUP STYLE ...")
        name, group, style = command.rest[:3]
        if style in _SILENT_FIXES:
            return
        if style not in _FIXES:
            allowed = f"{', '.join(_FIXES)}, and what changes no motion: {', '.join(sorted(_SILENT_FIXES))}"
            raise command.refused(f"is a fix that is not read here and may change the motion: {style}", allowed)
        self.particles.members(command, group)
        self.fixes[name] = command

    def _unfix(self, command: Command) -> None:
        for name in command.rest:
            self.fixes.pop(name, None)

    def _timestep(self, command: Command) -> None:
        self.step = self.script.number(command, command.rest[0]) if len(command.rest) == 1 else 0.0
        if not self.step > 0.0:
            raise command.refused("is no time step", "timestep DT, a number > 0")

    def _reset_timestep(self, command: Command) -> None:
        if len(command.rest) != 1:
            raise command.refused("is not read here", "reset_timestep N")
        self.counter = self.script.whole(command, command.rest[0])

    def _run(self, command: Command) -> None:
        words = list(command.rest)
        steps = self.script.whole(command, words.pop(0)) if words else -1
        if "upto" in words:
            words.remove("upto")
            steps -= self.counter
        options = dict(zip(words[::2], words[1::2], strict=False))
        if steps < 0 or len(words) % 2 or not set(options) <= {"pre", "post"}:
            raise command.refused("is not read here", "run N [upto] [pre yes|no] [post yes|no]")
        if steps:
            acting = self.forces()
            if self.run is not None and acting != self.acting:
                raise command.refused(
                    f"has other forces than the run in line {self.run.line}: a variable of a fix has changed",
                    "forces that are the same from the start to the end",
                )
            self.run, self.acting = self.run or command, acting
        if self.step is None:
            self.step = _DEFAULT_STEP.get(self.units, 1.0)
        self.steps += steps
        self.counter += steps
        self.duration += steps * self.step

    def forces(self) -> Forces:
        """What the fixes of the script do."""
        found = Forces()
        acting = {"gravity": self._gravity, "addforce": self._addforce, "langevin": self._langevin}
        for command in self.fixes.values():
            style, members = command.rest[2], self.particles.members(command, command.rest[1])
            found.said[style] = command
            if style in acting:
                acting[style](command, members, found)
            elif style == "setforce":
                self._setforce(command, members, found)
            elif len(command.rest) > 3:
                raise command.refused("has settings that are not read here", f"fix ID GROUP {style}")
            elif style == "freeze":
                found.frozen |= members
                self._hold(members, (0, 1, 2), found)
            elif found.moves & members:
                raise command.refused("moves what another fix moves already", "one fix nve or nve/sphere for each atom")
            else:
                found.moves |= members
        return found

    def _numbers(self, command: Command, words: tuple[str, ...]) -> list[float]:
        return [self.script.number(command, word) for word in words]

    def _gravity(self, command: Command, members: set[int], found: Forces) -> None:
        words = command.rest[3:]
        if len(words) != 5 or words[1] != "vector":
            raise command.refused("is not read here", "fix ID GROUP gravity MAGNITUDE vector x y z")
        size, *way = self._numbers(command, (words[0], *words[2:]))
        length = sum(one * one for one in way) ** 0.5
        if not length > 0.0:
            raise command.refused("has no direction", "a vector that is not 0 0 0")
        for number in members:
            here = found.gravity.setdefault(number, [0.0, 0.0, 0.0])
            found.gravity[number] = [old + size * one / length for old, one in zip(here, way, strict=True)]

    def _addforce(self, command: Command, members: set[int], found: Forces) -> None:
        words = command.rest[3:]
        if len(words) != 3:
            raise command.refused("is not read here", "fix ID GROUP addforce fx fy fz, constants")
        force = self._numbers(command, words)
        for number in members:
            here = found.load.setdefault(number, [0.0, 0.0, 0.0])
            found.load[number] = [old + one for old, one in zip(here, force, strict=True)]

    def _langevin(self, command: Command, members: set[int], found: Forces) -> None:
        words = command.rest[3:]
        numbers = self._numbers(command, words[:4])
        if len(words) != 4 or numbers[0] != 0.0 or numbers[1] != 0.0 or not numbers[2] > 0.0:
            raise command.refused("is no drag alone", "fix ID GROUP langevin 0 0 TIME SEED, without settings")
        for number in members:
            found.drag[number] = found.drag.get(number, 0.0) + 1.0 / numbers[2]

    def _setforce(self, command: Command, members: set[int], found: Forces) -> None:
        words = command.rest[3:]
        if len(words) != 3:
            raise command.refused("is not read here", "fix ID GROUP setforce with 0 or NULL along x, y and z")
        axes = [axis for axis, word in enumerate(words) if word != "NULL"]
        if any(self.script.number(command, words[axis]) != 0.0 for axis in axes):
            raise command.refused("sets a force", "0 or NULL along x, y and z; a load is addforce")
        self._hold(members, axes, found)

    @staticmethod
    def _hold(members: set[int], axes: Iterable[int], found: Forces) -> None:
        """Fixes act in their order: what was there before is gone along ``axes``."""
        for number in members:
            found.held.setdefault(number, set()).update(axes)
            for acting in (found.gravity, found.load):
                for axis in axes if number in acting else ():
                    acting[number][axis] = 0.0


def read_script(text: str, *, file: str, opened: Opened, variables: Mapping[str, str] | None = None) -> ReadScript:
    """What a script says; ``variables``: those that LAMMPS is given by ``-var``. Raises SceneError in one line.

    ``opened``: the text of a file that the script names, OSError or KeyError where there is none.
    """
    script = Script(opened, {name: ("index", (value,)) for name, value in (variables or {}).items()})
    found = ReadScript(script, Particles(script), Pairs(script))
    for command in script.commands(text, file):
        found.take(command)
    return found
