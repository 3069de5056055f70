"""Faults in tables: in the files that LAMMPS reads, and in the code that makes them, which the twin shares."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from dem_bridge.campaign import run_case
from dem_bridge.lmp import coefficients
from dem_bridge.lmp.deck import Deck
from dem_bridge.physics.law import ContactLaw, power_law
from dem_bridge.studies.checks import REFERENCE
from dem_bridge.verdict import Outcome
from tests.faults.decks import Change, run_with, substituted
from tests.faults.judging import (
    ENERGY,
    FREE,
    IMPLEMENTATION,
    ORDER,
    USER,
    Bench,
    Fault,
    minus,
    replaced,
)
from tests.strategies import stiffness_for

pytestmark = pytest.mark.lammps

EXPONENTS = (3.0, 2.5, 3.5)
#: the scene on which faults in other decks are planted, with laws that only tables have
MIXED = replace(
    FREE,
    name="recolliding-mixed",
    exponent=EXPONENTS,
    stiffness=tuple(stiffness_for(n, k) for n, k in zip(EXPONENTS, FREE.stiffness, strict=True)),
)
BENCH = Bench(MIXED, 5e-6)
TABLE = minus("its laws", "table")

Rows = np.ndarray
"""Distance, energy, force: ``(lines, 3)``."""


def rewritten(law: int, change: Callable[[Rows], Rows]) -> Change:
    """The file of one law with other numbers in its lines."""

    def plant(deck: Deck) -> dict[str, str]:
        file = f"{deck.name}.{law}.table"
        head, body = deck.files[file].rsplit("\n\n", 1)
        rows = change(np.array([[float(word) for word in line.split()[1:]] for line in body.splitlines()]))
        lines = [f"{i} {r!r} {e!r} {f!r}" for i, (r, e, f) in enumerate(rows.tolist(), start=1)]
        return {**deck.files, file: "\n".join([f"{head}\n", *lines, ""])}

    return plant


def neighbours(contact: int, other: int) -> Change:
    """A contact reads the file of another."""
    name = "recolliding-mixed"
    return substituted(rf"{name}\.{contact}\.table LAW{contact} ", f"{name}.{other}.table LAW{other} ")


def steeper(by: float) -> Change:
    """Contact 0 with another exponent, and the same force in the middle of its table."""

    def change(rows: Rows) -> Rows:
        overlap = rows[-1, 0] - rows[:, 0]
        factor = (overlap / np.median(overlap)) ** by
        return np.stack([rows[:, 0], rows[:, 1] * factor, rows[:, 2] * factor], axis=1)

    return rewritten(0, change)


def one_line(by: float) -> Change:
    def change(rows: Rows) -> Rows:
        rows[len(rows) // 3, 2] *= 1.0 + by
        return rows

    return rewritten(0, change)


def with_cutoff(by: float) -> Change:
    """Contact 0 ends so much (m) before its bodies part."""
    return lambda deck: substituted(
        r"(recolliding-mixed\.0\.table LAW0) ", rf"\g<1> {2.0 * deck.gauge_radius - by!r} "
    )(deck)


#: a table's own error shows in its forces, and in what LAMMPS differs by from the twin that has the tables too
OF_TABLE = TABLE | IMPLEMENTATION

FAULTS: dict[str, Fault[Change]] = {
    "stiffness of the neighbour": Fault(plant=neighbours(2, 1), shows=OF_TABLE | USER | ENERGY),
    "force wrong by 1e-6": Fault(
        plant=rewritten(0, lambda rows: rows * np.array([1.0, 1.0 + 1e-6, 1.0 + 1e-6])), shows=OF_TABLE, begins=0.0
    ),
    # a hundredth of the largest overlap: all that is left out is a force of 1e-4
    "a cutoff 100 nm before touch": Fault(plant=with_cutoff(1e-7), shows=OF_TABLE, begins=0.0),
    "exponent wrong by 1e-3": Fault(plant=steeper(1e-3), shows=OF_TABLE | USER | ENERGY, begins=0.0),
    "exponent wrong by 1e-6": Fault(plant=steeper(1e-6), shows=OF_TABLE, begins=0.0),
    "one line of 250 wrong by 1e-6": Fault(plant=one_line(1e-6), shows=OF_TABLE),
    # where the impulse is while it crosses the chain, and how hard it presses, need not show
    "distances wrong by a nanometre": Fault(
        plant=rewritten(0, lambda rows: rows + np.array([1e-9, 0.0, 0.0])),
        shows=OF_TABLE | minus(REFERENCE, "velocity", "displacement", "crossing_time") | ENERGY,
        begins=0.0,
    ),
    # as good as was predicted, and yet not what the deck says: LAMMPS minus its twin alone
    "slopes at the ends left out": Fault(
        plant=lambda deck: {file: re.sub(" FPRIME .*", "", text) for file, text in deck.files.items()},
        shows=IMPLEMENTATION,
    ),
    "a tenth of the points": Fault(plant=substituted("table spline 10000", "table spline 1000"), shows=IMPLEMENTATION),
    "linear in place of spline": Fault(plant=substituted("table spline", "table linear"), shows=OF_TABLE),
}


def test_sound_tables_have_no_fault() -> None:
    BENCH.check(BENCH.sound_runs)


@pytest.mark.parametrize("fault", FAULTS.values(), ids=FAULTS)
def test_a_fault_in_a_table_is_named(fault: Fault[Change]) -> None:
    BENCH.check_fault(replaced(BENCH.sound_runs, run_with(fault.plant, BENCH.engine_cases[0])), fault)


def test_energies_move_nothing_and_are_the_readers_to_judge() -> None:
    # tests/lmp/test_deck.py reads them; LAMMPS' own check of force = -dE/dr warns alone
    doubled = rewritten(0, lambda rows: rows * np.array([1.0, 2.0, 1.0]))
    BENCH.check(replaced(BENCH.sound_runs, run_with(doubled, BENCH.engine_cases[0])))


BROKEN: dict[str, tuple[Change, str]] = {
    # made for another range
    "the file of a stiffer neighbour": (neighbours(1, 2), "Pair distance < table inner cutoff"),
    "a cutoff beyond the file": (with_cutoff(-1e-9), "Pair table cutoff outside of table"),
    "a file that is missing": (lambda deck: {k: v for k, v in deck.files.items() if ".1.table" not in k}, "table"),
    "a section that is missing": (substituted("table LAW1 ", "table LAW9 "), "keyword"),
}


@pytest.mark.parametrize(("change", "why"), BROKEN.values(), ids=BROKEN)
def test_what_lammps_notices_itself_is_broken_in_its_words(change: Change, why: str) -> None:
    found = BENCH.verdicts(replaced(BENCH.sound_runs, run_with(change, BENCH.engine_cases[0])))
    [broken] = [name for name, verdict in found.items() if verdict.outcome is not Outcome.PASS]
    assert (broken, found[broken].outcome) == ("velocity - reference", Outcome.BROKEN)
    assert why in found[broken].sentence


# the code that makes tables: LAMMPS and the twin with tables have the fault alike, so LAMMPS minus twin cannot show it


@pytest.mark.parametrize(("by", "shows"), [(1e-3, ENERGY | ORDER), (1e-5, ORDER)])
def test_a_fault_in_the_laws_of_tables_shows_against_the_reference(
    by: float, shows: frozenset[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def wrong(stiffness: float, exponent: float) -> ContactLaw:
        return power_law(stiffness * 1e-5**-by, exponent + by)

    monkeypatch.setattr(coefficients, "power_law", wrong)
    found = BENCH.verdicts(tuple(run_case(case) for case in BENCH.cases))
    bad = {name: verdict.outcome for name, verdict in found.items() if verdict.outcome is not Outcome.PASS}
    assert set(bad) == minus(REFERENCE, "velocity") | shows
    # of other quantities the bar, which knows the twin with the laws themselves, is the tolerance
    assert bad["velocity - reference"] is Outcome.FAIL
