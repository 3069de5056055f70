"""Evaluation of a LAMMPS input script as LAMMPS does it, up to its first run: particles, pair laws, fixes, steps.

Commands that do not affect the motion are skipped by name. All others are evaluated, or reported as unsupported with
file and line. :mod:`.scene` converts the result to a Scene.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise

from dem_bridge.lmp.reader.pairs import Pairs
from dem_bridge.lmp.reader.particles import Particles
from dem_bridge.lmp.reader.script import Command, Opened, Script

#: SI values of the units of length, time and mass; units of force and stiffness follow (manual, command units)
UNITS = {
    "si": (1.0, 1.0, 1.0),
    "cgs": (1e-2, 1.0, 1e-3),
    "micro": (1e-6, 1e-6, 1e-15),
    "nano": (1e-9, 1e-9, 1e-21),
}
#: default time steps, in the units of the script (manual, command timestep)
_DEFAULT_STEP = {"si": 1e-8, "cgs": 1e-8, "micro": 2.0, "nano": 0.00045}
#: commands that do not affect the motion
SILENT = frozenset(
    {
        *("atom_modify", "balance", "comm_modify", "comm_style", "compute", "compute_modify", "dump", "dump_modify"),
        *("echo", "info", "log", "min_modify", "min_style", "neighbor", "newton", "package", "print", "processors"),
        *("restart", "suffix", "thermo", "thermo_modify", "thermo_style", "timer", "uncompute"),
        *("undump", "write_data", "write_dump", "write_restart"),
    }
)
#: fixes that do not affect the motion
_SILENT_FIXES = frozenset({"ave/atom", "ave/chunk", "ave/time", "balance", "enforce2d", "print", "vector"})
#: steps between rebuilds of the neighbour list that are safe with LAMMPS' default skin: up to its former defaults
_WAITS = frozenset(map(str, range(11)))
_FIXES = ("nve", "nve/sphere", "gravity", "addforce", "langevin", "freeze", "setforce")


@dataclass
class Forces:
    """The effect of all fixes, by atom, in the units of the script."""

    moves: set[int] = field(default_factory=set)
    """Atoms that a fix integrates."""
    frozen: set[int] = field(default_factory=set)
    """Atoms of ``fix freeze``, which also removes their mass from m_eff."""
    held: dict[int, set[int]] = field(default_factory=dict)
    """Axes along which the forces of contacts and earlier fixes are set to zero."""
    gravity: dict[int, list[float]] = field(default_factory=dict)
    drag: dict[int, float] = field(default_factory=dict)
    """Inverse relaxation times."""
    load: dict[int, list[float]] = field(default_factory=dict)
    commands: dict[str, Command] = field(default_factory=dict)
    """Style -> its last command."""


@dataclass
class ReadScript:
    """State of a script that is being evaluated.

    :func:`read_script` creates it.
    """

    script: Script
    particles: Particles
    pairs: Pairs
    units: str = "lj"
    step: float | None = None
    duration: float = 0.0
    """Duration of all runs, in the units of the script."""
    steps: int = 0
    counter: int = 0
    """LAMMPS' step counter, which a script can set."""
    dump_every: int | None = None
    """Steps between the frames of the first dump."""
    run: Command | None = None
    """The first run command."""
    last: Command | None = None
    fixes: dict[str, Command] = field(default_factory=dict)
    acting: Forces | None = None
    """Effect of the fixes during the run."""
    _dump: str | None = None

    def take(self, command: Command) -> None:
        """Evaluate one command."""
        self.last = command
        supported = self._supported
        if command.name in ("dump", "dump_modify"):
            self._frames(command)
        if command.name in SILENT:
            return
        if command.name not in supported:
            allowed = f"{', '.join(supported)}, and commands without effect on the motion: {', '.join(sorted(SILENT))}"
            raise command.error("is not supported and may change the motion", allowed)
        if self.run is not None and command.name not in ("run", "timestep", "reset_timestep"):
            raise command.error(
                f"comes after the run in line {self.run.line}, but a scene has one start",
                "run, timestep, reset_timestep and commands without effect on the motion",
                "to start from the state after a run, write it by write_data and read that file",
            )
        supported[command.name](command)

    @property
    def _supported(self) -> Mapping[str, Callable[[Command], None]]:
        """Supported commands and their functions."""
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
        """Raise SceneError unless the arguments are among the allowed ones."""
        if command.rest not in allowed:
            usage = " or ".join(f"{command.name} {' '.join(words)}" for words in allowed)
            raise command.error("is not supported", usage)

    def _units(self, command: Command) -> None:
        self._only(command, *((name,) for name in UNITS))
        self.units = command.rest[0]

    @staticmethod
    def _neigh_modify(command: Command) -> None:
        command.fail_if("exclude" in command.rest, "excludes pairs that may touch", "neigh_modify without exclude")
        settings = dict(pairwise(command.rest))
        delayed = any(settings.get(key, "0") not in _WAITS for key in ("every", "delay"))
        unchecked = settings.get("check") == "no" and settings.get("every", "1") != "1"
        if delayed or unchecked or settings.get("once") == "yes":
            problem = "may miss bodies that meet between two rebuilds of the neighbour list"
            raise command.error(problem, "every and delay of 0 to 10, check yes")

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
        command.fail_if(len(command.rest) < 3, "is incomplete", "fix ID GROUP STYLE ...")
        name, group, style = command.rest[:3]
        if style in _SILENT_FIXES:
            return
        if style not in _FIXES:
            silent = ", ".join(sorted(_SILENT_FIXES))
            allowed = f"{', '.join(_FIXES)}, and fixes without effect on the motion: {silent}"
            raise command.error(f"has the fix style {style}, which is not supported and may change the motion", allowed)
        self.particles.members(command, group)
        self.fixes[name] = command

    def _unfix(self, command: Command) -> None:
        for name in command.rest:
            self.fixes.pop(name, None)

    def _timestep(self, command: Command) -> None:
        self.step = self.script.number(command, command.rest[0]) if len(command.rest) == 1 else 0.0
        command.fail_if(not self.step > 0.0, "has no valid time step", "timestep DT, a number > 0")

    def _reset_timestep(self, command: Command) -> None:
        command.fail_if(len(command.rest) != 1, "is not supported", "reset_timestep N")
        self.counter = self.script.whole(command, command.rest[0])

    def _run(self, command: Command) -> None:
        words = list(command.rest)
        steps = self.script.whole(command, words.pop(0)) if words else -1
        if "upto" in words:
            words.remove("upto")
            steps -= self.counter
        options = dict(zip(words[::2], words[1::2], strict=False))
        if steps < 0 or len(words) % 2 or not set(options) <= {"pre", "post"}:
            raise command.error("is not supported", "run N [upto] [pre yes|no] [post yes|no]")
        if steps:
            acting = self.forces()
            if self.run is not None and acting != self.acting:
                why = "because a variable of a fix has changed"
                problem = f"has other forces than the run in line {self.run.line}, {why}"
                raise command.error(problem, "the same forces in all runs")
            self.run, self.acting = self.run or command, acting
        if self.step is None:
            self.step = _DEFAULT_STEP.get(self.units, 1.0)
        self.steps += steps
        self.counter += steps
        self.duration += steps * self.step

    def forces(self) -> Forces:
        """Return the effect of the script's fixes."""
        forces = Forces()
        acting = {"gravity": self._gravity, "addforce": self._addforce, "langevin": self._langevin}
        for command in self.fixes.values():
            style, members = command.rest[2], self.particles.members(command, command.rest[1])
            forces.commands[style] = command
            if style in acting:
                acting[style](command, members, forces)
            elif style == "setforce":
                self._setforce(command, members, forces)
            elif len(command.rest) > 3:
                raise command.error("has settings that are not supported", f"fix ID GROUP {style}")
            elif style == "freeze":
                forces.frozen |= members
                self._hold(members, (0, 1, 2), forces)
            elif forces.moves & members:
                problem = "integrates atoms that another fix integrates"
                raise command.error(problem, "one fix nve or nve/sphere for each atom")
            else:
                forces.moves |= members
        return forces

    def _numbers(self, command: Command, words: tuple[str, ...]) -> list[float]:
        return [self.script.number(command, word) for word in words]

    def _gravity(self, command: Command, members: set[int], forces: Forces) -> None:
        words = command.rest[3:]
        if len(words) != 5 or words[1] != "vector":
            raise command.error("is not supported", "fix ID GROUP gravity MAGNITUDE vector x y z")
        size, *direction = self._numbers(command, (words[0], *words[2:]))
        length = sum(component * component for component in direction) ** 0.5
        command.fail_if(not length > 0.0, "has no direction", "a vector other than 0 0 0")
        self._add(forces.gravity, members, [size * component / length for component in direction])

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

    def _setforce(self, command: Command, members: set[int], forces: Forces) -> None:
        words = command.rest[3:]
        command.fail_if(len(words) != 3, "is not supported", "fix ID GROUP setforce with 0 or NULL along x, y and z")
        axes = [axis for axis, word in enumerate(words) if word != "NULL"]
        if any(self.script.number(command, words[axis]) != 0.0 for axis in axes):
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


def read_script(text: str, *, file: str, opened: Opened, variables: Mapping[str, str] | None = None) -> ReadScript:
    """Evaluate a script.

    Parameters
    ----------
    text : str
        The script.
    file : str
        Its name, for messages.
    opened : callable
        Function that returns the text of a file that the script names; it raises OSError or KeyError if there is none.
    variables : mapping, optional
        Variables that LAMMPS is given by ``-var``.

    Raises
    ------
    SceneError
        If a command is invalid or unsupported.
    """
    script = Script(opened, {name: ("index", (value,)) for name, value in (variables or {}).items()})
    state = ReadScript(script, Particles(script), Pairs(script))
    for command in script.commands(text, file):
        state.take(command)
    return state
