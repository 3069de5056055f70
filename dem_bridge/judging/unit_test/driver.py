"""A unit test of LAMMPS executed as LAMMPS' own test program executes it, by any LAMMPS.

The commands, their order and the comparison are those of the test program: each test runs with ``newton on`` and with
``newton off``, after each segment the state of each atom is compared with the recorded one component by component, and
one formula with the state after its segment. ``run_angmom`` and formulas of bodies that slide or roll are left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from dem_bridge.errors import RunBroken
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.process import run_deck, workspace
from dem_bridge.lmp.reader.evaluation import read_script
from dem_bridge.lmp.unit_test import COLUMNS, UnitTest, component_error
from dem_bridge.observables.verdict import Outcome

#: columns that formulas need beyond those of states
_COLUMNS = ("id", "mass", "radius", "fx", "fy", "fz", *(name for names in COLUMNS.values() for name in names))

#: tag -> column -> value, of one state
Atoms = Mapping[int, Mapping[str, float]]


@dataclass(frozen=True, kw_only=True)
class Failure:
    """One comparison of a unit test that fails."""

    newton: bool
    segment: int
    what: str
    """The quantity, such as "vx of atom 2", or the formula."""
    expected: float
    found: float
    error: float
    allowed: float

    def __str__(self) -> str:
        setting = "on" if self.newton else "off"
        return (
            f"newton {setting}, segment {self.segment}, {self.what}: recorded {self.expected:.17g}, found"
            f" {self.found:.17g}; the difference is {self.error:.3g}, allowed {self.allowed:.3g}"
        )


@dataclass(frozen=True, kw_only=True)
class TestRun:
    """The result of a unit test."""

    __test__ = False  # no test of pytest

    failures: tuple[Failure, ...]
    largest: float
    """Largest difference of a component, as the test program measures it."""
    comparisons: int
    """Number of components and values of formulas that were compared."""
    version: int
    """Release of the engine that ran the test."""
    left_out: str = ""
    """The formula that was not evaluated; '' if there is none."""

    @property
    def outcome(self) -> Outcome:
        """PASS if no comparison fails; NOT_RUN if the test has nothing to compare with."""
        if not self.comparisons:
            return Outcome.NOT_RUN
        return Outcome.FAIL if self.failures else Outcome.PASS

    @property
    def sentence(self) -> str:
        """The result in a sentence."""
        formula = f"; the formula {self.left_out} was not evaluated" if self.left_out else ""
        if not self.comparisons:
            return f"the test has no recorded states to compare with{formula}."
        size = f"{self.comparisons} values were compared; the largest difference of a component is {self.largest:.3g}"
        if self.failures:
            return f"{size}, and {len(self.failures)} are too far off, first with {self.failures[0]}{formula}."
        return f"{size}{formula}."


def run_unit_test(
    test: UnitTest, *, engine: Engine | None = None, time_limit: float = 600.0, executed: UnitTest | None = None
) -> TestRun:
    """Execute a unit test with ``newton on`` and ``newton off``.

    Parameters
    ----------
    test : UnitTest
        The test, whose states and tolerances count.
    engine : Engine, optional
        Which LAMMPS; the default is the one that is chosen for all runs.
    time_limit : float
        Time limit of each of the two runs, s.
    executed : UnitTest, optional
        Test whose commands are executed in place of those of ``test``, such as one with a planted fault.

    Raises
    ------
    RunBroken
        If LAMMPS stops with an error.
    BackendUnavailable
        If there is no LAMMPS or it lacks a style.
    """
    failures: list[Failure] = []
    largest, comparisons, version, left_out = 0.0, 0, 0, ""
    for newton in (True, False):
        states, version = _executed(executed or test, newton, engine or Engine.chosen(), time_limit)
        for key, recorded in test.states.items():
            for segment, state in enumerate(recorded):
                found = states[segment]
                if {*found} != {*state}:
                    what = f"atoms of {key}"
                    failures.append(_failure(newton, segment, what, len(state), len(found), math.inf, test.epsilon))
                for tag, values in state.items():
                    for column, value in zip(COLUMNS[key], values, strict=True):
                        comparisons += 1
                        now = found.get(tag, {}).get(column, math.nan)
                        error = component_error(value, now)
                        largest = max(largest, error)
                        if not error <= test.epsilon:  # also nan
                            what = f"{column} of atom {tag}"
                            failures.append(_failure(newton, segment, what, value, now, error, test.epsilon))
        if (formula := test.analytic) is not None:
            if formula.model not in FORMULAS:
                left_out = formula.model
                continue
            time = test.ends[formula.segment] * _step(test)
            for what, value, now, allowed in _formula(test, states[formula.segment], time):
                comparisons += 1
                if not abs(now - value) <= allowed:
                    error = abs(now - value) / max(abs(value), 1e-300)
                    failures.append(_failure(newton, formula.segment, what, value, now, error, formula.tolerance))
    return TestRun(
        failures=tuple(failures), largest=largest, comparisons=comparisons, version=version, left_out=left_out
    )


def _failure(
    newton: bool, segment: int, what: str, expected: float, found: float, error: float, allowed: float
) -> Failure:
    return Failure(
        newton=newton, segment=segment, what=what, expected=expected, found=found, error=error, allowed=allowed
    )


def _executed(test: UnitTest, newton: bool, engine: Engine, time_limit: float) -> tuple[list[Atoms], int]:
    """Return the states after the segments of a test, and the release of the engine."""
    dump = f"write_dump all custom state.{{}} {' '.join(_COLUMNS)} modify sort id format float %.17g"
    lines = [f"newton {'on' if newton else 'off'}", *test.commands, "run 0 post no"]
    for segment, steps in enumerate(test.segments):
        lines += [f"run {steps} post no", dump.format(segment)]
    with workspace() as folder:
        name = f"in.{test.name}"
        (folder / name).write_text("\n".join((*lines, "")), encoding="utf-8")
        report = run_deck(folder, name, time_limit=time_limit, engine=engine)
        return [_atoms(folder / f"state.{segment}") for segment in range(len(test.segments))], report.version


def _atoms(file: Path) -> Atoms:
    """Return the atoms of a dump of one state."""
    try:
        head, _, body = file.read_text(encoding="utf-8").partition("ITEM: ATOMS")
    except OSError:
        raise RunBroken(f"LAMMPS ended without an error, but it did not write {file.name}") from None
    if not head:
        raise RunBroken(f"{file.name}, which LAMMPS wrote, is no dump")
    heading, *rows = body.splitlines()
    columns = heading.split()
    atoms = [dict(zip(columns, map(float, row.split()), strict=True)) for row in rows]
    return {int(atom["id"]): atom for atom in atoms}


# ---------------------------------------------------------------- formulas
#: what a formula compares: name, value of the formula, value of the run, permissible difference
Compared = tuple[str, float, float, float]


def _number(test: UnitTest, name: str, default: float = 0.0) -> float:
    """Return the value of a variable of a test, as its formulas have it; the default if it is no number."""
    try:
        return float(test.variables.get(name, default))
    except ValueError:
        return default


def _step(test: UnitTest) -> float:
    """Return the time step of a test, in its unit."""
    script = read_script(test.script, file=test.name, opened=_no_file)
    return script.time_steps[-1] if script.time_steps else math.nan


def _no_file(name: str) -> str:
    raise KeyError(name)


def _formula(test: UnitTest, atoms: Atoms, time: float) -> list[Compared]:
    """Return what the formula of a test compares."""
    assert test.analytic is not None  # the caller has seen it
    tolerance = test.analytic.tolerance
    return [
        (f"{test.analytic.model}: {what}", value, now, tolerance * (abs(value) if scale is None else scale))
        for what, value, now, scale in FORMULAS[test.analytic.model](test, atoms, time)
    ]


#: name, value of the formula, value of the run, and the scale of the tolerance; None: the value of the formula
_Part = tuple[str, float, float, float | None]


def _freefall(test: UnitTest, atoms: Atoms, time: float) -> list[_Part]:
    g, start = _number(test, "grav"), _number(test, "z0")
    return [("z", start - 0.5 * g * time**2, atoms[1]["z"], None), ("vz", -g * time, atoms[1]["vz"], None)]


def _collision_restitution(test: UnitTest, atoms: Atoms, time: float) -> list[_Part]:
    speed = _number(test, "vin")
    first, second = atoms[1], atoms[2]
    momentum = first["mass"] * first["vx"] + second["mass"] * second["vx"]
    restitution = -(first["vx"] - second["vx"]) / (2.0 * speed)
    return [
        ("momentum", 0.0, momentum, (first["mass"] + second["mass"]) * speed),
        ("restitution", _number(test, "en", 1.0), restitution, None),
    ]


def _wall_restitution(test: UnitTest, atoms: Atoms, time: float) -> list[_Part]:
    return [("vx", -_number(test, "en", 1.0) * _number(test, "vx_in"), atoms[1]["vx"], None)]


def _overlap(test: UnitTest, atoms: Atoms) -> float:
    """Return the overlap of the two atoms, or of the atom with a floor below it."""
    one = atoms[1]
    if len(atoms) < 2:
        return one["radius"] - (one["z"] - _number(test, "floor"))
    return one["radius"] + atoms[2]["radius"] - math.dist(*([atom[axis] for axis in "xyz"] for atom in (one, atoms[2])))


def _force(atom: Mapping[str, float]) -> float:
    return math.hypot(atom["fx"], atom["fy"], atom["fz"])


def _hertz_normal_impact(test: UnitTest, atoms: Atoms, time: float) -> list[_Part]:
    """At the largest overlap the kinetic energy is 2/5 of force times overlap."""
    mass = _number(test, "mred_factor", 1.0) * atoms[1]["mass"]
    energy = 0.5 * mass * _number(test, "vrela") ** 2
    return [("energy", energy, 0.4 * _force(atoms[1]) * _overlap(test, atoms), None)]


def _hertz_peak(test: UnitTest, atoms: Atoms, time: float) -> list[_Part]:
    """Compare the largest overlap, (5 m v^2 / 4 k)^(2/5), and the force there, k overlap^(3/2)."""
    mass, stiffness = _number(test, "mred_factor", 1.0) * atoms[1]["mass"], _number(test, "kfac")
    overlap = (1.25 * mass * _number(test, "vrela") ** 2 / stiffness) ** 0.4
    return [
        ("overlap", overlap, _overlap(test, atoms), None),
        ("force", stiffness * overlap**1.5, _force(atoms[1]), None),
    ]


def _pulloff_dmt(test: UnitTest, atoms: Atoms, time: float) -> list[_Part]:
    return [("force", 4.0 * math.pi * _number(test, "coh") * _number(test, "reff"), _force(atoms[1]), None)]


#: formulas of bodies on a line, by their names in tests
FORMULAS: Mapping[str, Callable[[UnitTest, Atoms, float], list[_Part]]] = MappingProxyType(
    {
        "freefall": _freefall,
        "collision_restitution": _collision_restitution,
        "wall_restitution": _wall_restitution,
        "hertz_normal_impact": _hertz_normal_impact,
        "hertz_peak": _hertz_peak,
        "pulloff_dmt": _pulloff_dmt,
    }
)
