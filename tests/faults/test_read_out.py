"""Faults in what is read out of a sound run: they show in the quantities they touch and in no other."""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Callable, Sequence
from typing import Any

import pytest

from dem_bridge.backends import lammps, steps
from dem_bridge.verification.reference_choice import REFERENCE
from dem_bridge.verification.roles import POSITIONAL, TWIN
from tests.helpers.fault_decks import Change, both, run_with, substituted
from tests.helpers.fault_judging import BENCH, ENERGY, IMPLEMENTATION, USER, Fault, minus, replaced
from tests.helpers.fault_stand_in import Code, run_in_place_of_lammps, runs_of


def shown(*quantities: str) -> frozenset[str]:
    """The quantities against both the twin in positions and the reference; velocity against the twin, too."""
    twin = minus(TWIN, "velocity") if "velocity" in quantities else frozenset()
    return twin | minus(POSITIONAL, *quantities) | minus(REFERENCE, *quantities)


# LAMMPS answers with something else than the deck asks for

DUMPS: dict[str, Fault[Change]] = {
    # v - dt/2 f/m: where the closing rate turns, and with it every crossing, moves by half a step
    "half-step velocities": Fault(
        plant=both(
            substituted(r"^dump .*", lambda m: f"variable half atom vx-0.5*v_dt*fx/mass\n{m[0]}"),
            substituted(r"^(dump .*) vx ", r"\1 v_half "),
        ),
        shows=(IMPLEMENTATION | USER | ENERGY)
        - minus(POSITIONAL, "displacement", "contact_force")
        - minus(REFERENCE, "displacement"),
        begins=0.0,
    ),
    # a clock that is off by one: all times are, so times between two crossings are not; energy is that of any moment.
    # 3e-11 of peak forces come from other dense samples beside the peak, more than round-off
    "a clock one step late": Fault(
        plant=substituted("^thermo_style ", "run 1\nreset_timestep 0\nthermo_style "),
        shows=shown("velocity", "displacement", "crossing_time") | minus(POSITIONAL, "peak_force", "contact_force"),
        begins=0.0,
    ),
}


@pytest.mark.lammps
@pytest.mark.parametrize("fault", DUMPS.values(), ids=DUMPS)
def test_a_fault_in_what_lammps_dumps_is_named(fault: Fault[Change]) -> None:
    BENCH.check_fault(replaced(BENCH.sound_runs, run_with(fault.plant, BENCH.engine_cases[0])), fault)


# the dump is sound, its reading is not; the stand-in writes it

#: of a function's source: what is written -> what is planted
Substitution = tuple[Callable[..., Any], str, str]


def changed(function: Callable[..., Any], changes: Sequence[Substitution], **names: Any) -> Any:
    """``function`` with something else in its source, and other functions behind the ``names`` that it calls."""
    text = textwrap.dedent(inspect.getsource(function))
    for where, old, new in changes:
        if where is function:
            assert text.count(old) == 1, f"the source has changed: {old!r} is in it {text.count(old)} times"
            text = text.replace(old, new)
    scope = {**vars(inspect.getmodule(function)), **names}
    exec("from __future__ import annotations\n" + text, scope)
    return scope[function.__name__]


DENSE, READ_OFF, EXTREMES = lammps.dense_of, steps.read_off, steps.peaks_and_crossings
KEEP = "keep = slice(None, None, (len(dense.velocity) - 1) // plan.samples)"
SEEN = "**approach_of(scene, plan, dense, every), "
READINGS: dict[str, Fault[Substitution]] = {
    "samples off by one": Fault(
        plant=(
            READ_OFF,
            KEEP,
            "keep = np.minimum(np.arange(0, len(dense.force), plan.subdivisions) + 1, len(dense.force) - 1)",
        ),
        shows=shown("velocity", "displacement") | minus(POSITIONAL, "contact_force"),
        begins=0.0,
    ),
    "times off by one": Fault(
        plant=(EXTREMES, SEEN, f'{SEEN}"time": (plan.dense_steps[::every] + 1) * plan.step, '),
        shows=shown("crossing_time"),
    ),
    # overlaps, and so the energy in contacts, are those of displacements
    "start positions without the gaps": Fault(
        plant=(DENSE, "position - deck.line", "position - 2.0 * deck.surrogate_radius * np.arange(len(deck.line))"),
        shows=shown("displacement") | ENERGY,
    ),
    "peak force of the dense samples alone": Fault(
        plant=(READ_OFF, KEEP, f"peak_force = np.max(dense.force, axis=0); {KEEP}"), shows=shown("peak_force")
    ),
    "a curve without accelerations": Fault(
        plant=(DENSE, "at_rest_beside(acceleration)", "at_rest_beside(0.0 * net)"),
        shows=shown("peak_force", "crossing_time") | minus(REFERENCE, "residence_time"),
    ),
}


def read_with(monkeypatch: pytest.MonkeyPatch, *changes: Substitution) -> Any:
    """The stand-in's runs, read with these changes; the twin, which is read off by the same functions, without."""
    peaks = changed(EXTREMES, changes)
    monkeypatch.setattr(lammps, "dense_of", changed(DENSE, changes))
    monkeypatch.setattr(lammps, "read_off", changed(READ_OFF, changes, peaks_and_crossings=peaks))
    return replaced(runs_of(Code), run_in_place_of_lammps(Code, BENCH.engine_cases[0]))


def test_the_reading_as_it_is_fails_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    BENCH.check(read_with(monkeypatch))


@pytest.mark.parametrize("fault", READINGS.values(), ids=READINGS)
def test_a_fault_in_the_reading_is_named(fault: Fault[Substitution], monkeypatch: pytest.MonkeyPatch) -> None:
    BENCH.check_fault(read_with(monkeypatch, fault.plant), fault)


def test_contact_forces_in_the_columns_of_others_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    column = "contact_force=dense.force[keep]"
    results = read_with(monkeypatch, (READ_OFF, column, f"{column}[:, ::-1]"))
    BENCH.check(results, minus(POSITIONAL, "contact_force"))
