"""Faults in table files: LAMMPS takes what stands there, and the verdicts must say that it is not the law."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import pytest

from dem_bridge.lmp.deck import Deck
from dem_bridge.scene import Wall
from dem_bridge.studies.checks import TABLE
from dem_bridge.verdict import Outcome
from tests.faults.decks import Change, run_with
from tests.faults.judging import ENERGY, FREE, IMPLEMENTATION, USER, Bench, Fault, replaced

pytestmark = pytest.mark.lammps

#: three laws in one chain, a wall, gaps, collisions that come again; exponents that two references can do
MIXED = replace(
    FREE,
    name="mixed",
    exponent=(2.5, 3.5, 3.0),
    stiffness=(1e10, 4e15, 2e13),
    wall_right=Wall(stiffness=3e9, exponent=2.5, gap=1e-6),
)
BENCH = Bench(MIXED, 5e-6)
#: a row of a file: number, distance, energy, force
Row = list[str]


def rows(law: int, change: Callable[[list[Row]], list[Row]]) -> Change:
    """A deck with other rows in the file of one law."""

    def changed(deck: Deck) -> dict[str, str]:
        name = f"{deck.name}.{law}.table"
        head, body = re.split(r"(?<=\n)(?=1 )", deck.files[name], maxsplit=1)
        found = change([line.split() for line in body.splitlines()])
        head = re.sub(r"^N \d+", f"N {len(found)}", head, flags=re.MULTILINE)
        text = "".join(f"{i} {' '.join(row[1:])}\n" for i, row in enumerate(found, start=1))
        return {**deck.files, name: head + text}

    return changed


def scaled(column: int, factor: float, *, only: int | None = None) -> Callable[[list[Row]], list[Row]]:
    """A column (2: energy, 3: force) times a factor, in one row or in all."""

    def change(found: list[Row]) -> list[Row]:
        for row in found:
            if only in (None, int(row[0])):
                row[column] = repr(float(row[column]) * factor)
        return found

    return change


TABLES = frozenset({"table - contact laws"})
TABLE_ENERGY = frozenset({"table_energy - contact laws"})

FAULTS: dict[str, Fault[Change]] = {
    "one force wrong by 1e-4": Fault(plant=rows(1, scaled(3, 1.0 + 1e-4, only=60)), shows=TABLES | IMPLEMENTATION),
    "every force wrong by 1e-4": Fault(
        plant=rows(1, scaled(3, 1.0 + 1e-4)), shows=TABLES | IMPLEMENTATION | USER | ENERGY
    ),
    "one line in ten": Fault(
        plant=rows(1, lambda found: [*found[:-1:10], found[-1]]), shows=TABLES | TABLE_ENERGY | IMPLEMENTATION
    ),
    # it moves nothing: only what LAMMPS prints as energy is wrong
    "an energy column that does not fit": Fault(plant=rows(1, scaled(2, 1.0 + 1e-5)), shows=TABLE_ENERGY),
}


def test_sound_tables_have_no_fault() -> None:
    assert {case.backend for case in BENCH.engine_cases} == {TABLE}
    found = BENCH.check(BENCH.sound_runs)
    assert set(found) >= TABLES | TABLE_ENERGY


@pytest.mark.parametrize("fault", FAULTS.values(), ids=FAULTS)
def test_a_fault_in_a_table_is_named(fault: Fault[Change]) -> None:
    BENCH.check_fault(replaced(BENCH.sound_runs, run_with(fault.plant, BENCH.engine_cases[0])), fault)


def test_fewer_lines_than_a_file_says_are_lammps_own_error() -> None:
    def cut(deck: Deck) -> dict[str, str]:
        name = f"{deck.name}.1.table"
        return {**deck.files, name: deck.files[name].rsplit("\n", 50)[0] + "\n"}

    found = BENCH.verdicts(replaced(BENCH.sound_runs, run_with(cut, BENCH.engine_cases[0])))
    [broken] = [verdict for verdict in found.values() if verdict.outcome is Outcome.BROKEN]
    assert "ERROR" in broken.sentence
