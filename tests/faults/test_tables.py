"""Faults in table files: LAMMPS takes what stands there, and the verdicts must say that it is not the law."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import pytest

from dem_bridge.lmp import pair_coefficients
from dem_bridge.lmp.deck import Deck
from dem_bridge.observables.verdict import Outcome
from dem_bridge.physics.contact_law import ContactLaw, power_law
from dem_bridge.runs.campaign import run_case
from dem_bridge.scene.scene import Wall
from dem_bridge.verification.reference_choice import REFERENCE
from dem_bridge.verification.roles import POSITIONAL, TABLE
from tests.helpers.fault_decks import Change, run_with, substituted
from tests.helpers.fault_judging import ENERGY, FREE, IMPLEMENTATION, ORDER, USER, Bench, Fault, minus, replaced

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
        lines = change([line.split() for line in body.splitlines()])
        head = re.sub(r"^N \d+", f"N {len(lines)}", head, flags=re.MULTILINE)
        text = "".join(f"{i} {' '.join(row[1:])}\n" for i, row in enumerate(lines, start=1))
        return {**deck.files, name: head + text}

    return changed


def scaled(column: int, factor: float, *, only: int | None = None) -> Callable[[list[Row]], list[Row]]:
    """A column (2: energy, 3: force) times a factor, in one row or in all."""

    def change(table: list[Row]) -> list[Row]:
        for row in table:
            if only in (None, int(row[0])):
                row[column] = repr(float(row[column]) * factor)
        return table

    return change


def steeper(by: float) -> Callable[[list[Row]], list[Row]]:
    """Another exponent, with the same force (and energy) at 5 um."""

    def change(table: list[Row]) -> list[Row]:
        for row in table[:-1]:
            factor = ((float(table[-1][1]) - float(row[1])) / 5e-6) ** by
            row[2:] = [repr(float(value) * factor) for value in row[2:]]
        return table

    return change


def moved(table: list[Row]) -> list[Row]:
    """All distances a nanometre larger: a law that begins too early."""
    return [[number, repr(float(r) + 1e-9), *rest] for number, r, *rest in table]


def reading(law: int, other: int) -> Change:
    """A contact that reads the file of another."""
    return substituted(rf" mixed\.{law}\.table LAW{law} ", f" mixed.{other}.table LAW{other} ")


def cut_before_touch(by: float) -> Change:
    """The cutoff of contact 0 so much (m) before its bodies part."""
    return lambda deck: substituted(r"(mixed\.0\.table LAW0) ", rf"\g<1> {2.0 * deck.surrogate_radius - by!r} ")(deck)


def without_slopes(deck: Deck) -> dict[str, str]:
    return {file: re.sub(" FPRIME .*", "", text) for file, text in deck.files.items()}


TABLES = frozenset({"table - contact laws"})
TABLE_ENERGY = frozenset({"table_energy - contact laws"})

FAULTS: dict[str, Fault[Change]] = {
    "one force wrong by 1e-4": Fault(plant=rows(1, scaled(3, 1.0 + 1e-4, only=60)), shows=TABLES | IMPLEMENTATION),
    "every force wrong by 1e-4": Fault(
        plant=rows(1, scaled(3, 1.0 + 1e-4)), shows=TABLES | IMPLEMENTATION | USER | ENERGY
    ),
    "one line in ten": Fault(
        plant=rows(1, lambda table: [*table[:-1:10], table[-1]]), shows=TABLES | TABLE_ENERGY | IMPLEMENTATION
    ),
    # it moves nothing: only what LAMMPS prints as energy is wrong
    "an energy column that does not fit": Fault(plant=rows(1, scaled(2, 1.0 + 1e-5)), shows=TABLE_ENERGY),
    "the law of the neighbour": Fault(
        plant=reading(1, 0), shows=TABLES | TABLE_ENERGY | IMPLEMENTATION | USER | ENERGY
    ),
    "exponent wrong by 1e-3": Fault(
        plant=rows(1, steeper(1e-3)), shows=TABLES | TABLE_ENERGY | IMPLEMENTATION | USER | ENERGY
    ),
    "exponent wrong by 1e-6": Fault(plant=rows(1, steeper(1e-6)), shows=TABLES | TABLE_ENERGY | IMPLEMENTATION),
    "distances wrong by a nanometre": Fault(
        plant=rows(1, moved), shows=TABLES | TABLE_ENERGY | IMPLEMENTATION | USER | ENERGY
    ),
    # a fortieth of the largest overlap
    "a cutoff 300 nm before touch": Fault(plant=cut_before_touch(3e-7), shows=TABLES | IMPLEMENTATION | USER | ENERGY),
    # as good as was foreseen, and yet not what the deck says: LAMMPS minus its twin alone
    # (displacements may part by a last digit a step, and these do by less)
    "slopes at the ends left out": Fault(
        plant=without_slopes, shows=IMPLEMENTATION - minus(POSITIONAL, "displacement")
    ),
    "a fifth of the points": Fault(plant=substituted("table spline 10000", "table spline 2000"), shows=IMPLEMENTATION),
    "linear in place of spline": Fault(plant=substituted("table spline", "table linear"), shows=IMPLEMENTATION),
}


def test_sound_tables_have_no_fault() -> None:
    assert {case.backend for case in BENCH.engine_cases} == {TABLE}
    verdicts = BENCH.check(BENCH.sound_runs)
    assert set(verdicts) >= TABLES | TABLE_ENERGY


@pytest.mark.parametrize("fault", FAULTS.values(), ids=FAULTS)
def test_a_fault_in_a_table_is_named(fault: Fault[Change]) -> None:
    BENCH.check_fault(replaced(BENCH.sound_runs, run_with(fault.plant, BENCH.engine_cases[0])), fault)


def cut_short(deck: Deck) -> dict[str, str]:
    name = f"{deck.name}.1.table"
    return {**deck.files, name: deck.files[name].rsplit("\n", 50)[0] + "\n"}


def missing(deck: Deck) -> dict[str, str]:
    return {file: text for file, text in deck.files.items() if file != f"{deck.name}.1.table"}


#: what LAMMPS notices itself -> a word of its error
BROKEN: dict[str, tuple[Change, str]] = {
    "fewer lines than a file says": (cut_short, "ERROR"),
    "a file that is missing": (missing, "ERROR"),
    "a section that is missing": (substituted("table LAW1 ", "table LAW9 "), "ERROR"),
    "a file that ends before the deepest overlap": (
        rows(0, lambda table: table[20:]),
        "Pair distance < table inner cutoff",
    ),
    "a cutoff beyond the file": (cut_before_touch(-1e-9), "Pair table cutoff outside of table"),
}


@pytest.mark.parametrize(("change", "why"), BROKEN.values(), ids=BROKEN)
def test_what_lammps_notices_itself_is_broken_in_its_words(change: Change, why: str) -> None:
    verdicts = BENCH.verdicts(replaced(BENCH.sound_runs, run_with(change, BENCH.engine_cases[0])))
    [broken] = [name for name, verdict in verdicts.items() if verdict.outcome is not Outcome.PASS]
    assert (broken, verdicts[broken].outcome) == ("velocity - reference", Outcome.BROKEN)
    assert why in verdicts[broken].sentence


# the code that makes tables: LAMMPS and the twin with tables have the fault alike, so LAMMPS minus twin cannot show it


def test_a_fault_in_the_laws_of_tables_shows_against_the_reference(monkeypatch: pytest.MonkeyPatch) -> None:
    by = 1e-5  # with 1e-3 the same verdicts fail

    def wrong(stiffness: float, exponent: float) -> ContactLaw:
        return power_law(stiffness * 1e-5**-by, exponent + by)

    monkeypatch.setattr(pair_coefficients, "power_law", wrong)
    verdicts = BENCH.verdicts(BENCH.cases.map(run_case))
    bad = {name: verdict.outcome for name, verdict in verdicts.items() if verdict.outcome is not Outcome.PASS}
    assert set(bad) == minus(REFERENCE, "velocity") | ENERGY | ORDER
    # of other quantities the bar, which knows the twin with the laws themselves, is the tolerance
    assert bad["velocity - reference"] is Outcome.FAIL
