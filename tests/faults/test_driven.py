"""Faults in a drive: in LAMMPS' formula, in the twin, and in the truth; the verdicts name each of them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from dem_bridge.observables.verdict import Outcome
from dem_bridge.verification.reference_choice import BLANES_MOAN, REFERENCE
from tests.faults.test_own_codes import Changes, _faulty, _with_twin
from tests.helpers.driven_chains import SINE, TOUCHING, driven
from tests.helpers.fault_decks import Change, run_with, substituted, times
from tests.helpers.fault_judging import IMPLEMENTATION, TWIN_ERROR, USER, Bench, Fault, minus, replaced, with_trajectory

pytestmark = pytest.mark.lammps

#: what is neither lost nor given by the drive
BALANCE = frozenset({"energy less work - its own start"})
#: by another method than scipy's, which is the reference where there is a drive
TWO_METHODS = frozenset({f"{BLANES_MOAN}: velocity - {REFERENCE}"})

#: a sine from 30 degrees that rises; and a table, whose knots fall on steps
SINE_BENCH = Bench(replace(TOUCHING, name="sine"), 1e-5)
TABLE_BENCH = Bench(driven(TOUCHING, "table"), 1e-5)

#: every crossing is late by the same, so residence times are not
LATE = USER - minus(REFERENCE, "residence_time")

SINE_FAULTS: dict[str, Fault[Change]] = {
    "a phase forgotten": Fault(
        plant=substituted(r"\+\(0\.5235987755982988\)\)", ")"), shows=IMPLEMENTATION | USER | BALANCE
    ),
    "a phase wrong by 1e-7": Fault(plant=substituted(r"\+\((0\.52\d+)\)\)", times(1.0 + 1e-7)), shows=IMPLEMENTATION),
    "the wrong body": Fault(
        plant=substituted("^group +driven id 1", "group driven id 2"), shows=IMPLEMENTATION | USER | BALANCE
    ),
    "half a step late": Fault(
        plant=substituted(r"\(step\*v_dt\)", "((step-0.5)*v_dt)", places=4), shows=IMPLEMENTATION | LATE | BALANCE
    ),
    "a force wrong by 1e-7": Fault(plant=substituted(r"equal (2\.0)\*", times(1.0 + 1e-7)), shows=IMPLEMENTATION),
    "no rise": Fault(plant=substituted(r"2\.0\*sin\(\S+\)\^2\*", "2.0*"), shows=IMPLEMENTATION | USER | BALANCE),
}
TABLE_FAULT: Fault[Change] = Fault(
    plant=substituted(r"drive_this +equal v_drive_cell\+1", "drive_this equal v_drive_cell+2"),
    shows=IMPLEMENTATION | USER | BALANCE,
)
#: m: larger than any overlap that a fault makes
ROOMY = 1e-5

AT = "(step - 1 + ends[stage]) * dt if step > 0 else 0.0"
TWIN_FAULTS: dict[str, Fault[Changes]] = {
    "half a step late": Fault(
        plant=[(AT, "(step - 1.5 + ends[stage]) * dt if step > 0 else 0.0")], shows=IMPLEMENTATION | TWIN_ERROR
    ),
    "the wrong body": Fault(plant=[("net[0] += driving", "net[1] += driving")], shows=IMPLEMENTATION | TWIN_ERROR),
}


@pytest.mark.parametrize("bench", [SINE_BENCH, TABLE_BENCH], ids=["sine", "table"])
def test_sound_driven_runs_have_no_fault(bench: Bench) -> None:
    bench.check(bench.sound_runs)


@pytest.mark.parametrize(
    ("bench", "fault"),
    [*((SINE_BENCH, fault) for fault in SINE_FAULTS.values()), (TABLE_BENCH, TABLE_FAULT)],
    ids=[*SINE_FAULTS, "a table one cell late"],
)
def test_a_fault_in_a_driven_deck_is_named(bench: Bench, fault: Fault[Change]) -> None:
    run = run_with(fault.plant, bench.engine_cases[0], surrogate_radius=ROOMY)
    bench.check_fault(replaced(bench.sound_runs, run), fault)


@pytest.mark.parametrize("fault", TWIN_FAULTS.values(), ids=TWIN_FAULTS)
def test_a_fault_in_the_drive_of_the_twin_is_named(fault: Fault[Changes], monkeypatch: pytest.MonkeyPatch) -> None:
    SINE_BENCH.check_fault(_with_twin(SINE_BENCH, monkeypatch, fault.plant), fault)


def test_a_truth_of_another_phase_is_named() -> None:
    [case] = SINE_BENCH.of(REFERENCE)
    other = replace(SINE_BENCH.scene, drive=replace(SINE, phase=30.1))
    run = _faulty(case, SINE_BENCH.sound_runs, scene=other)
    results = with_trajectory(SINE_BENCH.sound_runs, case, run)
    verdicts = SINE_BENCH.verdicts(results)
    failed = {name for name, verdict in verdicts.items() if verdict.outcome is Outcome.FAIL}
    assert failed >= TWIN_ERROR | TWO_METHODS | {f"velocity - {REFERENCE}"}
    assert not failed & IMPLEMENTATION
