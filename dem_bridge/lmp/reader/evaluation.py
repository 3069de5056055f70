"""Evaluation of a LAMMPS input script as LAMMPS does it, up to its first run: particles, pair laws, fixes, steps.

Commands that do not affect the motion are skipped by name. All others are evaluated, or recorded as unsupported with
file and line. :mod:`.fixes` evaluates fixes, and :mod:`.to_scene` converts the result to a Scene.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise

from dem_bridge.errors import SceneError
from dem_bridge.foundation.numbers import whole_number
from dem_bridge.lmp.reader import pair_laws
from dem_bridge.lmp.reader.fixes import Fixes, Forces
from dem_bridge.lmp.reader.pair_commands import Pairs
from dem_bridge.lmp.reader.particles import Particles
from dem_bridge.lmp.reader.script import Command, Opened, Script, given_variables

#: SI values of the units of length, time and mass; units of force and stiffness follow (manual, command units)
UNITS = {
    "si": (1.0, 1.0, 1.0),
    "cgs": (1e-2, 1.0, 1e-3),
    "micro": (1e-6, 1e-6, 1e-15),
    "nano": (1e-9, 1e-9, 1e-21),
    "lj": (1.0, 1.0, 1.0),
}
#: default time steps, in the units of the script (manual, command timestep)
_DEFAULT_STEP = {"si": 1e-8, "cgs": 1e-8, "micro": 2.0, "nano": 0.00045, "lj": 0.005}
#: commands that do not affect the motion
SILENT = frozenset(
    {
        *(
            "atom_modify",
            "balance",
            "comm_modify",
            "comm_style",
            "communicate",
            "compute",
            "compute_modify",
            "dump",
            "dump_modify",
        ),
        *("echo", "info", "log", "min_modify", "min_style", "neighbor", "newton", "package", "print", "processors"),
        *("restart", "shell", "suffix", "thermo", "thermo_modify", "thermo_style", "timer", "uncompute"),
        *("undump", "write_data", "write_dump", "write_restart"),
    }
)
#: steps between rebuilds of the neighbour list that are safe with LAMMPS' default skin: up to its former defaults
_WAITS = frozenset(map(str, range(11)))
#: first words of commands that `run ... every` may execute
_SILENT_TEXTS = [["NULL"], [], *([name] for name in sorted(SILENT))]
#: commands that set thermo keywords
_DEFINING = ("units", "timestep", "create_box", "read_data", "create_atoms", "run", "reset_timestep")
#: commands that may stand between two runs; those that change forces are noticed at the next run
_LATER = ("run", "timestep", "reset_timestep", "fix", "unfix", "region", "group", "neigh_modify")


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
    acting: Forces | None = None
    """Effect of the fixes during the run."""
    notes: list[str] = field(default_factory=list)
    time_steps: list[float] = field(default_factory=list)
    """Distinct time steps of the runs, in the units of the script."""
    _changed: Command | None = None
    """First command after a run that changes the state."""
    _dump: str | None = None

    def __post_init__(self) -> None:
        self.fixes = Fixes(self.script, self.particles, self.pairs)

    def take(self, command: Command) -> None:
        """Evaluate one command."""
        supported = self._supported
        if command.name in ("dump", "dump_modify"):
            self._frames(command)
        command = _without_suffix(command)
        silent = SILENT | (pair_laws.SILENT_COMMANDS if self.fixes.liggghts else frozenset())
        if command.name not in (*silent, *supported):
            allowed = f"{', '.join(supported)}, and commands without effect on the motion, such as thermo and dump"
            raise command.error("is not supported and may change the motion", allowed)
        self.last = command
        if command.name in silent:
            return
        if self.run is not None and command.name not in _LATER:
            self._changed = self._changed or command
            return
        supported[command.name](command)
        if command.name in _DEFINING:
            self._keywords()

    @property
    def _supported(self) -> Mapping[str, Callable[[Command], None]]:
        """Supported commands and their functions."""
        particles = self.particles
        return {
            "units": self._units,
            "dimension": self._dimension,
            "boundary": particles.set_boundary,
            "atom_style": self._atom_style,
            "lattice": particles.lattice,
            "replicate": lambda command: self._only(command, ("1", "1", "1")),
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
            "fix": self.fixes.add,
            "unfix": self.fixes.remove,
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

    def _atom_style(self, command: Command) -> None:
        styles = [("sphere",), ("sphere", "0"), ("sphere", "1"), *[("granular",)] * self.fixes.liggghts]
        self._only(command, *styles)

    def _dimension(self, command: Command) -> None:
        self._only(command, ("3",), ("2",))
        self.particles.dimension = self.script.whole(command, command.rest[0])

    def _units(self, command: Command) -> None:
        self._only(command, *((name,) for name in UNITS))
        self.units = command.rest[0]
        self.particles.reduced = self.units == "lj"

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
            self.dump_every = whole_number(words[3])
        elif command.name == "dump_modify" and words[:1] == (self._dump,) and "every" in words[:-1]:
            self.dump_every = whole_number(words[words.index("every") + 1])

    def _timestep(self, command: Command) -> None:
        self.step = self.script.number(command, command.rest[0]) if len(command.rest) == 1 else 0.0
        command.fail_if(not self.step > 0.0, "has no valid time step", "timestep DT, a number > 0")

    def _keywords(self) -> None:
        """Set the thermo keywords that a formula may contain."""
        step = _DEFAULT_STEP[self.units] if self.step is None else self.step
        self.script.keywords |= {"dt": step, "step": float(self.counter), "atoms": float(len(self.particles.atoms))}
        for axis, (low, high) in zip("xyz", self.particles.box, strict=False):
            self.script.keywords |= {f"{axis}lo": low, f"{axis}hi": high, f"l{axis}": high - low}

    def _reset_timestep(self, command: Command) -> None:
        command.fail_if(len(command.rest) != 1, "is not supported", "reset_timestep N")
        self.counter = self.script.whole(command, command.rest[0])

    def _run(self, command: Command) -> None:
        words = list(command.rest)
        steps = self.script.whole(command, words.pop(0)) if words else -1
        if "upto" in words:
            words.remove("upto")
            steps -= self.counter
        if "every" in words and all(text.split()[:1] in _SILENT_TEXTS for text in words[words.index("every") + 2 :]):
            del words[words.index("every") :]
        options = dict(zip(words[::2], words[1::2], strict=False))
        if steps < 0 or len(words) % 2 or not set(options) <= {"pre", "post", "start", "stop"}:
            raise command.error("is not supported", "run N [upto] [pre yes|no] [post yes|no]")
        if self.step is None:
            self.step = _DEFAULT_STEP[self.units]
        self.steps += steps
        self.counter += steps
        self.duration += steps * self.step
        if steps:
            self.time_steps += [] if self.step in self.time_steps else [self.step]
            self._run_forces(command)

    def _run_forces(self, command: Command) -> None:
        """Evaluate the forces of a run, whose steps count also if its forces cannot be read."""
        before, self.run = self.run, self.run or command
        if self._changed is not None:
            raise self._changed.error(
                f"comes between runs in lines {before.line if before else 0} and {command.line}, but a scene has one"
                " start",
                "fix, timestep, reset_timestep and commands without effect on the motion between runs",
                "to start from the state after a run, write it by write_data and read that file",
            )
        acting = self.fixes.forces()
        if self.acting is not None and before is not None and acting != self.acting:
            problem = f"has other forces than the run in line {before.line}"
            raise command.error(problem, "the same fixes, with the same numbers, in all runs")
        self.acting = acting


def _without_suffix(command: Command) -> Command:
    """Return a command whose style has no suffix of an accelerated variant, which has the same forces."""
    at = {"pair_style": 1, "atom_style": 1, "run_style": 1, "fix": 3}.get(command.name, len(command.words))
    if at >= len(command.words):
        return command
    style = re.sub(r"(?<=\w)/(omp|opt|kk|gpu|intel)$", "", command.words[at])
    return replace(command, words=(*command.words[:at], style, *command.words[at + 1 :]))


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
    BlockedScript
        If the script does not end. Commands that are invalid or unsupported are in ``blockers`` of the result's script.
    """
    script = Script(opened, given_variables(variables), silent=SILENT - {"dump", "dump_modify"})
    state = ReadScript(script, Particles(script), Pairs(script))
    if pair_laws.is_liggghts(text):
        state.fixes.liggghts = state.particles.keep_density = True
        state.notes.append("the script is for LIGGGHTS; walls have the material of their type")
    for command in script.commands(file, text):
        if command.name == "quit":
            break
        if command.name == "clear" and state.run is not None:
            state.notes.append(f"the script is read up to line {command.line}, where `clear` begins another simulation")
            break
        try:
            state.take(command)
        except SceneError as error:
            script.refuse(command, error)
    return state
