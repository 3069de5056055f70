"""LAMMPS' unit tests of granular models: a YAML file with commands, states that were recorded, and a tolerance.

The form is that of ``unittest/granular`` of LAMMPS. A test has blocks of commands (``pre_commands``, ``pair_style``,
``pair_coeff``, ``post_commands``) with ``variables``, runs of so many steps each (``run_segments``), and the state of
each atom after each of them (``run_pos``, ``run_vel``, ...: a row is ``segment tag x y z``). The test program compares
each component with the recorded one: ``|a - b| / min(|a|, |b|)`` must be at most ``epsilon``; where one of the two is
exactly zero, ``|a - b|``. It may also compare with a formula that ``analytic_model`` names.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import Any

import numpy as np

from dem_bridge.errors import SceneError
from dem_bridge.foundation.script_files import KEYS_OF_UNIT_TESTS
from dem_bridge.lmp.reader.evaluation import UNITS
from dem_bridge.lmp.reader.to_scene import ReadDeck
from dem_bridge.physics.contact_law import Floats

#: blocks of recorded states, and the columns that a dump has for each of them
COLUMNS = {
    "run_pos": ("x", "y", "z"),
    "run_vel": ("vx", "vy", "vz"),
    "run_torque": ("tqx", "tqy", "tqz"),
    "run_omega": ("omegax", "omegay", "omegaz"),
}
_YES = ("yes", "true", "on", "1")
#: tolerance of a test that states none, as the test program has it
_DEFAULT_EPSILON = 1e-14

#: tag of an atom -> its three components
State = Mapping[int, tuple[float, float, float]]


@dataclass(frozen=True, kw_only=True)
class Analytic:
    """The formula with which a test compares the state after one of its segments."""

    model: str
    tolerance: float
    """Permissible difference, relative to the value of the formula."""
    segment: int


@dataclass(frozen=True, kw_only=True)
class UnitTest:
    """A unit test of a granular model: commands, recorded states and tolerances."""

    name: str
    pre_commands: tuple[str, ...]
    pair_style: str
    pair_coeff: tuple[str, ...]
    post_commands: tuple[str, ...]
    segments: tuple[int, ...]
    """Steps of each run."""
    variables: Mapping[str, str] = field(default_factory=dict)
    prerequisites: tuple[tuple[str, str], ...] = ()
    """Kind and name of each style that the engine must have."""
    states: Mapping[str, tuple[State, ...]] = field(default_factory=dict)
    """Key of :data:`COLUMNS` -> recorded state after each segment, as far as states were recorded."""
    epsilon: float = _DEFAULT_EPSILON
    tags: tuple[str, ...] = ()
    version: str = ""
    """The release of LAMMPS, or the code, that recorded the states."""
    date: str = ""
    atoms: int = 0
    analytic: Analytic | None = None

    @property
    def ends(self) -> tuple[int, ...]:
        """Steps from the start to the end of each segment."""
        return tuple(sum(self.segments[: k + 1]) for k in range(len(self.segments)))

    @property
    def recorder(self) -> str:
        """The code that recorded the states, for sentences."""
        release = f"LAMMPS {self.version}" if self.version[:1].isdigit() else self.version
        return release or "a LAMMPS that the test does not name"

    @property
    def commands(self) -> tuple[str, ...]:
        """All commands before the first run, in the order in which the test program executes them."""
        return (
            *(f"variable {name} index {value}" for name, value in self.variables.items()),
            *self.pre_commands,
            f"pair_style {self.pair_style}",
            *(f"pair_coeff {line}" for line in self.pair_coeff),
            *self.post_commands,
        )

    @property
    def script(self) -> str:
        """The test as an input script: its commands, and a run for each segment."""
        head = f"# the commands of the unit test {self.name}, in the order in which they are executed"
        return "\n".join((head, *self.commands, *(f"run {steps}" for steps in self.segments), ""))

    @property
    def text(self) -> str:
        """The test as a YAML file."""
        return "".join(self._lines())

    def _lines(self) -> Iterator[str]:
        yield "---\n"
        yield f"lammps_version: {self.version}\n"
        yield f"tags: {' '.join(self.tags)}\n"
        yield f"date_generated: {self.date}\n"
        yield f"epsilon: {self.epsilon!r}\n"
        yield "skip_tests:\n"
        yield from _block("prerequisites", (" ".join(pair) for pair in self.prerequisites))
        yield from _block("pre_commands", self.pre_commands)
        yield from _block("post_commands", self.post_commands)
        yield "input_file:\n"
        yield f"natoms: {self.atoms}\n"
        yield from _block("variables", (f"{name} {value}" for name, value in self.variables.items()))
        yield f"pair_style: {self.pair_style}\n"
        yield from _block("pair_coeff", self.pair_coeff)
        yield from _block("run_segments", [" ".join(map(str, self.segments))])
        if self.analytic is not None:
            yield "analytic_enable: yes\n"
            yield f"analytic_model: {self.analytic.model}\n"
            yield f"analytic_tol: {self.analytic.tolerance!r}\n"
            yield f"analytic_segment: {self.analytic.segment}\n"
        for key, states in self.states.items():
            rows = (
                f"{segment:3d} {tag:3d} " + " ".join(f"{value:23.16e}" for value in values)
                for segment, state in enumerate(states)
                for tag, values in state.items()
            )
            yield from _block(key, rows, mark="|2")  # the first row begins with a space
        yield "...\n"


def _block(key: str, lines: Any, mark: str = "|") -> Iterator[str]:
    """Yield a block of lines of a YAML file."""
    yield f"{key}: {mark}\n"
    yield from (f"  {line}\n" for line in lines)


def read_unit_test(text: str, file: str) -> UnitTest:
    r"""Return the unit test in the text of a YAML file.

    Parameters
    ----------
    text : str
        Text of the file.
    file : str
        Name of the file, for messages; the test has its name without the ending.

    Raises
    ------
    SceneError
        If the text is no YAML, lacks a block, or has a row or a number that cannot be read.

    Examples
    --------
    >>> test = read_unit_test(
    ...     "variables: |\n  dt 1e-8\npre_commands: |\n  timestep ${dt}\npair_style: granular\npair_coeff: |\n"
    ...     "  * * hooke 1e6 0.5\nrun_segments: |-\n  10 5\nrun_pos: |2\n    0   1 0.5 0 0\n", "spring.yaml")
    >>> test.ends, test.states["run_pos"][0][1], test.commands[:2]
    ((10, 15), (0.5, 0.0, 0.0), ('variable dt index 1e-8', 'timestep ${dt}'))
    """
    values = _scalars(text, file)
    for key in KEYS_OF_UNIT_TESTS:
        if not values.get(key, "").strip():
            raise _error(file, key, "is missing or empty", "a unit test of LAMMPS with commands and run_segments")
    segments = tuple(_whole(file, "run_segments", word) for word in values["run_segments"].split())
    analytic = None
    if values.get("analytic_enable", "").strip() in _YES:
        segment = _whole(file, "analytic_segment", values.get("analytic_segment", "").strip() or "-1")
        analytic = Analytic(
            model=values.get("analytic_model", "").strip(),
            tolerance=_number(file, "analytic_tol", values.get("analytic_tol", "").strip() or "0.01"),
            segment=segment if segment >= 0 else len(segments) - 1,
        )
    words = [line.split(maxsplit=1) for line in _lines_of(values, "variables")]
    return UnitTest(
        name=PurePath(file).stem,
        pre_commands=tuple(_lines_of(values, "pre_commands")),
        pair_style=values["pair_style"].strip(),
        pair_coeff=tuple(_lines_of(values, "pair_coeff")),
        post_commands=tuple(_lines_of(values, "post_commands")),
        segments=segments,
        variables={pair[0]: pair[1].strip() if len(pair) > 1 else "" for pair in words},
        prerequisites=tuple((p[0], p[1]) for line in _lines_of(values, "prerequisites") if len(p := line.split()) > 1),
        states={key: _states(file, key, values[key], len(segments)) for key in COLUMNS if values.get(key, "").strip()},
        epsilon=_number(file, "epsilon", values.get("epsilon", "").strip() or repr(_DEFAULT_EPSILON)),
        tags=tuple(values.get("tags", "").replace(",", " ").split()),
        version=values.get("lammps_version", "").strip(),
        date=values.get("date_generated", "").strip(),
        atoms=_whole(file, "natoms", values.get("natoms", "").strip() or "0"),
        analytic=analytic,
    )


def _scalars(text: str, file: str) -> dict[str, str]:
    """Return the keys of the first YAML document with their texts; nothing is converted and no object is built."""
    import yaml  # which only such a test needs

    try:
        values = next(yaml.load_all(text, Loader=yaml.BaseLoader), None)
    except (yaml.YAMLError, RecursionError) as error:
        said = " ".join(str(getattr(error, "problem", None) or type(error).__name__).split())
        raise _error(file, "", f"is no YAML file ({said})", "a unit test of LAMMPS") from None
    if not isinstance(values, dict):
        raise _error(file, "", "has no keys", "a unit test of LAMMPS with keys such as pre_commands")
    for key, value in values.items():
        if not isinstance(value, str):
            raise _error(file, str(key), "is a list or a mapping", "a text, or a block of lines")
    return values


def _lines_of(values: Mapping[str, str], key: str) -> list[str]:
    """Return the lines of a block that are not empty."""
    return [line.strip() for line in values.get(key, "").splitlines() if line.strip()]


def _states(file: str, key: str, block: str, segments: int) -> tuple[State, ...]:
    """Return the recorded states of a block; segments without rows at its end have none."""
    states: list[dict[int, tuple[float, float, float]]] = []
    for line in block.splitlines():
        words = line.split()
        if not words:
            continue
        if len(words) != 5:
            raise _error(file, key, f"has the row {line.strip()[:60]!r}", "rows of segment, tag and three numbers")
        segment, tag = (_whole(file, key, word) for word in words[:2])
        if not 0 <= segment < segments:
            raise _error(file, key, f"has a row of segment {segment}", f"0 to {segments - 1}, as run_segments has them")
        states.extend({} for _ in range(segment + 1 - len(states)))
        x, y, z = (_number(file, key, word) for word in words[2:])
        states[segment][tag] = (x, y, z)
    return tuple(states)


def _number(file: str, key: str, word: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise _error(file, key, f"has {word[:40]!r} where a number is required", "a number") from None


def _whole(file: str, key: str, word: str) -> int:
    number = _number(file, key, word)
    if not math.isfinite(number) or number != int(number):
        raise _error(file, key, f"has {word[:40]!r} where a whole number is required", "a whole number")
    return int(number)


def _error(file: str, key: str, problem: str, allowed: str) -> SceneError:
    return SceneError(key, problem=problem, allowed=allowed, where=file)


def component_error(first: float, second: float) -> float:
    """Return the difference of two numbers as LAMMPS' test program measures it.

    Examples
    --------
    >>> component_error(1.0, 1.1), component_error(0.0, 1e-9)
    (0.10000000000000009, 1e-09)
    """
    least = min(abs(first), abs(second))
    apart = abs(first - second)
    return apart if least == 0.0 else apart / least


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedStates:
    """The recorded states of a unit test along the chain of its scene, in SI units."""

    steps: tuple[int, ...]
    """Steps from the start, of each state."""
    velocity: Floats
    """m/s, ``(n_state, n_body)``."""
    displacement: Floats
    """Positions minus those at the start, m, ``(n_state, n_body)``."""
    place: Floats
    """Positions at the start in the direction of the chain, m, ``(n_body,)``."""


def recorded_states(test: UnitTest, read: ReadDeck) -> RecordedStates | None:
    """Return the recorded states of the bodies of a test, whose script was read as a scene; None without."""
    if not {"run_pos", "run_vel"} <= set(test.states):
        return None
    bodies, axis, sign = read.line.bodies, read.line.axis, read.line.sign
    length, time, _ = UNITS[read.line.script.units]
    names = {body.number for body in bodies}
    both = zip(test.ends, test.states["run_pos"], test.states["run_vel"], strict=False)
    kept = [(end, place, speed) for end, place, speed in both if end > 0 and names <= {*place} & {*speed}]
    if not kept:
        return None
    start = sign * np.array([body.place[axis] for body in bodies])
    place, speed = (
        sign * np.array([[state[body.number][axis] for body in bodies] for state in states])
        for states in ([place for _, place, _ in kept], [speed for _, _, speed in kept])
    )
    return RecordedStates(
        steps=tuple(end for end, _, _ in kept),
        velocity=speed * (length / time),
        displacement=(place - start) * length,
        place=start * length,
    )
