"""Faults in the motion of a piston, as users write them for LAMMPS; the verdicts name each of them."""

from __future__ import annotations

import pytest

from dem_bridge.observables.verdict import Outcome
from dem_bridge.scene.scene import Damping
from tests.faults.test_driven import BALANCE
from tests.helpers.driven_chains import pushed
from tests.helpers.fault_decks import Change, run_with, substituted, times
from tests.helpers.fault_judging import IMPLEMENTATION, USER, Bench, Fault, replaced

pytestmark = pytest.mark.lammps

SINE = Bench(pushed("sine"), 1e-5)
WIGGLE = Bench(pushed("wiggle"), 1e-5)
TABLE = Bench(pushed("table"), 1e-5)
#: the damping of its first contact depends on the mass of the piston
DAMPED = Bench(pushed("wiggle", damping=Damping(law="coeff_restitution", coefficient=0.5)), 1e-3)
#: m: larger than any overlap that a fault makes
ROOMY = 2e-5

VELOCITY_ALONE = substituted("move variable v_piston_x NULL", "move variable NULL NULL")
#: that of the sine, whose velocity at time 0 is half of the largest one
WIGGLED = substituted("move variable .*", "move wiggle 7.957747154594767e-06 0 0 0.00016666666666666666")
HEAVIER = substituted(r"^set +atom 1 mass (\S+)", times(1.5))
FROZEN = substituted(r"^(fix +motion.*)$", r"\1\nfix frozen piston freeze")

EVERYTHING = IMPLEMENTATION | USER | BALANCE
FAULTS: dict[str, tuple[Bench, Fault[Change]]] = {
    "velocity alone": (SINE, Fault(plant=VELOCITY_ALONE, shows=EVERYTHING)),
    "velocity of a table alone": (TABLE, Fault(plant=VELOCITY_ALONE, shows=EVERYTHING)),
    "a wiggle for any sine": (SINE, Fault(plant=WIGGLED, shows=EVERYTHING)),
    "an amplitude wrong by 1e-7": (
        WIGGLE, Fault(plant=substituted(r"wiggle (\S+)", times(1.0 + 1e-7)), shows=IMPLEMENTATION),
    ),
    "another mass, undamped": (WIGGLE, Fault(plant=HEAVIER, shows=frozenset())),
}  # fmt: skip


@pytest.mark.parametrize("bench", [SINE, WIGGLE, TABLE], ids=["sine", "wiggle", "table"])
def test_sound_runs_have_no_fault(bench: Bench) -> None:
    bench.check(bench.sound_runs)


@pytest.mark.parametrize(("bench", "fault"), FAULTS.values(), ids=FAULTS)
def test_a_fault_in_the_motion_of_a_piston_is_named(bench: Bench, fault: Fault[Change]) -> None:
    run = run_with(fault.plant, bench.engine_cases[0], surrogate_radius=ROOMY)
    bench.check_fault(replaced(bench.sound_runs, run), fault)


@pytest.mark.parametrize("plant", [HEAVIER, FROZEN], ids=["another mass", "a frozen piston"])
def test_another_mass_in_the_damping_is_named(plant: Change) -> None:
    run = run_with(plant, DAMPED.engine_cases[0], surrogate_radius=ROOMY)
    sound, planted = (DAMPED.verdicts(runs) for runs in (DAMPED.sound_runs, replaced(DAMPED.sound_runs, run)))
    assert not any(verdict.outcome is Outcome.FAIL for verdict in sound.values())
    failed = {name for name, verdict in planted.items() if verdict.outcome is Outcome.FAIL}
    assert failed == IMPLEMENTATION | USER
