"""Faults in a deck: LAMMPS itself commits each of them, and the verdicts must say so.

What LAMMPS does otherwise than the twin shows in LAMMPS minus twin (IMPLEMENTATION), the sharper the smaller it is;
what is larger than the accuracy asked for shows against the reference (USER) as well; a law that breaks has a name.
"""

from __future__ import annotations

import re

import numpy as np
import pytest

from dem_bridge.lmp.deck import Deck
from dem_bridge.observables.verdict import Outcome
from dem_bridge.verification.reference_choice import REFERENCE
from dem_bridge.verification.roles import POSITIONAL, TWIN
from tests.helpers.fault_decks import Change, both, run_with, substituted, times
from tests.helpers.fault_judging import (
    BENCH,
    ENERGY,
    FREE,
    HELD,
    HELD_BENCH,
    IMPLEMENTATION,
    MOMENTUM,
    USER,
    Bench,
    Fault,
    minus,
    replaced,
)
from tests.helpers.fault_tables import hertz, tabulated

pytestmark = pytest.mark.lammps


def softer(overlap: np.ndarray, beta: float) -> tuple[np.ndarray, np.ndarray]:
    """Exponent 1.45, with the sound law's force at 5 um."""
    closed, same = np.maximum(overlap, 0.0), beta * 5e-6**0.05
    return same * closed**1.45, same * closed**2.45 / 2.45


def sticky(overlap: np.ndarray, beta: float) -> tuple[np.ndarray, np.ndarray]:
    """Bodies that are apart pull as they would push."""
    (push, pressed), (pull, stretched) = hertz(overlap, beta), hertz(-overlap, beta)
    return push - pull, pressed + stretched


def swapped(deck: Deck) -> dict[str, str]:
    """The stiffnesses of contacts 1 and 2 change places."""
    text = deck.files[deck.input_file]
    first, other = (re.findall(rf"hertz (\S+) 0 .*# contact {k}:", text)[0] for k in (1, 2))
    exchange = {first: other, other: first}
    return substituted(rf"(?<=hertz )({re.escape(first)}|{re.escape(other)})", lambda m: exchange[m[0]], places=2)(deck)


def list_rebuilt_every(steps: int) -> Change:
    """A skin of 1 nm, and a list that is rebuilt without a look at how far bodies have moved."""
    return both(
        substituted("^neighbor .*", "neighbor 1e-9 bin"),
        substituted("every 1 check yes", f"every {steps} check no"),
    )


def stiffness_changed(factor: float) -> Change:
    """Contact 0 gets another stiffness at 83 us, when it has opened for the second time; it comes back at 94 us."""

    def change(deck: Deck) -> dict[str, str]:
        before = round(83e-6 / deck.schedule.step)
        [line] = re.findall(r"^pair_coeff.*# contact 0:.*$", deck.files[deck.input_file], re.MULTILINE)
        new = re.sub(r"hertz (\S+)", times(factor), line)
        return substituted(r"^run .*", f"run {before}\n{new}\nrun {deck.schedule.steps - before}")(deck)

    return change


def without_root(deck: Deck) -> dict[str, str]:
    """K = beta in place of beta / sqrt(R_eff)."""
    places = FREE.n_contact
    return substituted(r"hertz \S+ 0 (.*# \S+ \d+: beta = (\S+))$", r"hertz \2 0 \1", places=places)(deck)


#: each stiffness of the deck, but for the background's zero
ALL_K = r"hertz ([1-9]\S+) 0"

FAULTS: dict[str, Fault[Change]] = {
    "force exponent 1.45 in place of 1.5": Fault(
        plant=tabulated(softer, "spline 20000"), shows=IMPLEMENTATION | USER | ENERGY, begins=0.0
    ),
    # total momentum is that of the scene's masses, so a wrong one shows there as soon as its body is struck
    "mass of one body wrong by 1e-6": Fault(
        plant=substituted(r"atom 3 mass (\S+)", times(1.0 + 1e-6)), shows=IMPLEMENTATION | MOMENTUM, begins=15e-6
    ),
    "mass of one body wrong by 1e-4": Fault(
        plant=substituted(r"atom 3 mass (\S+)", times(1.0 + 1e-4)),
        shows=IMPLEMENTATION | USER | MOMENTUM | ENERGY,
        begins=15e-6,
    ),
    "two contacts swapped": Fault(plant=swapped, shows=IMPLEMENTATION | USER | ENERGY, begins=15e-6),
    "K = beta / sqrt(R) in place of R_eff = R/2": Fault(
        plant=substituted(ALL_K, times(2.0**-0.5), places=FREE.n_contact),
        shows=IMPLEMENTATION | USER | ENERGY,
        begins=0.0,
    ),
    # it takes energy, and with it the later peaks; the first crossings stay within the accuracy that was asked for
    "damping left on at 1e-3": Fault(
        plant=substituted(r"(hertz [1-9]\S+) 0 ", r"\1 1e-3 ", places=FREE.n_contact),
        shows=IMPLEMENTATION | minus(REFERENCE, "velocity", "displacement", "peak_force") | ENERGY,
        begins=0.0,
    ),
    # a hundredth of the largest overlap
    "tension over 100 nm": Fault(
        plant=tabulated(sticky, "spline 20000", reach=1e-7), shows=IMPLEMENTATION | USER | ENERGY, begins=0.0
    ),
    "a table of 200 points": Fault(
        plant=tabulated(hertz, "linear 200"), shows=IMPLEMENTATION | USER | ENERGY, begins=0.0
    ),
    # within the accuracy that was asked for, and yet not the law that the deck claims
    "a table of 10,000 points": Fault(plant=tabulated(hertz, "linear 10000"), shows=IMPLEMENTATION, begins=0.0),
    # bodies that come near are not seen until the next rebuild, up to 1 us late; collisions last 26 us and more
    "a neighbour list too short": Fault(
        plant=list_rebuilt_every(100), shows=IMPLEMENTATION | USER | ENERGY, begins=15e-6
    ),
    # the third collision of contact 0, when all crossings and all peaks are past
    "a contact that came back stiffer by 1e-4": Fault(
        plant=stiffness_changed(1.0 + 1e-4),
        shows=minus(TWIN, "velocity")
        | minus(POSITIONAL, "velocity", "displacement", "contact_force")
        | minus(REFERENCE, "velocity", "displacement")
        | ENERGY,
        begins=95e-6,
    ),
}

#: a scene between walls and with weight; where the impulse is while it crosses the chain it need not show
ARRIVED = USER - minus(REFERENCE, "residence_time")
K2 = r"hertz (\S+) 0 .*# contact 2:"
HELD_FAULTS: dict[str, Fault[Change]] = {
    "stiffness of one contact wrong by 1e-6": Fault(plant=substituted(K2, times(1.0 + 1e-6)), shows=IMPLEMENTATION),
    "mass of one body missing": Fault(
        plant=substituted(r"^set +atom 4 mass .*\n", "set atom 4 mass 1e-2\n"), shows=IMPLEMENTATION | USER | ENERGY
    ),
    "stiffness of the wall wrong by 1e-6": Fault(
        plant=substituted(r"hertz (\S+) 0 .*# wall_right:", times(1.0 + 1e-6)), shows=IMPLEMENTATION
    ),
    "wall and last contact given the same pair of types": Fault(
        plant=substituted(r"^7 1 ", "7 3 ", data=True), shows=IMPLEMENTATION | ARRIVED | ENERGY
    ),
    "weight the other way": Fault(
        plant=substituted("vector 1 0 0", "vector -1 0 0"), shows=IMPLEMENTATION | ARRIVED | ENERGY
    ),
    "weight forgotten": Fault(plant=substituted(r"^fix +weight.*\n", ""), shows=IMPLEMENTATION | ARRIVED | ENERGY),
    "weight wrong by 1e-5": Fault(plant=substituted(r"index 50\.0 ", "index 50.0005 "), shows=IMPLEMENTATION),
    "step wrong by 1e-7": Fault(plant=substituted(r"dt +index (\S+)", times(1.0 + 1e-7)), shows=IMPLEMENTATION),
    "speed of the striker wrong by 1e-7": Fault(
        plant=substituted("^2 0.8 0 0 0 0 0", "2 0.80000008 0 0 0 0 0", data=True), shows=IMPLEMENTATION
    ),
    "a body moved by a nanometre": Fault(
        plant=substituted(r"^(4 \d+ \S+ \S+ )(\S+) 0 0$", lambda m: f"{m[1]}{float(m[2]) + 1e-9!r} 0 0", data=True),
        shows=IMPLEMENTATION | USER,
    ),
    "walls that give way": Fault(
        plant=substituted("^fix +motion bodies nve", "fix motion all nve"), shows=IMPLEMENTATION | ARRIVED | ENERGY
    ),
}

#: changes that must change nothing: with them, what the faults above show is the fault and not the way it is planted
HARMLESS: dict[str, Change] = {
    "the deck as it is": lambda deck: dict(deck.files),
    "a run in two parts": stiffness_changed(1.0),
    "a thin skin with a list rebuilt at every step": list_rebuilt_every(1),
}


@pytest.mark.parametrize("bench", [BENCH, HELD_BENCH], ids=[FREE.name, HELD.name])
def test_sound_runs_have_no_fault(bench: Bench) -> None:
    bench.check(bench.sound_runs)


@pytest.mark.parametrize("change", HARMLESS.values(), ids=HARMLESS)
def test_a_harmless_change_fails_nothing(change: Change) -> None:
    BENCH.check(replaced(BENCH.sound_runs, run_with(change, BENCH.engine_cases[0])))


def test_a_fine_table_of_the_sound_law_is_what_the_user_asked_for() -> None:
    run = run_with(tabulated(hertz, "spline 20000"), BENCH.engine_cases[0])
    verdicts = BENCH.verdicts(replaced(BENCH.sound_runs, run))
    # motion 1e-12 from the twin, forces 1e-11: what a spline through 20,000 points leaves of the force
    assert {name for name, verdict in verdicts.items() if verdict.outcome is not Outcome.PASS} <= IMPLEMENTATION
    assert max(verdicts[name].difference for name in IMPLEMENTATION) < 3e-11


@pytest.mark.parametrize("fault", FAULTS.values(), ids=FAULTS)
def test_a_fault_in_a_deck_is_named(fault: Fault[Change]) -> None:
    BENCH.check_fault(replaced(BENCH.sound_runs, run_with(fault.plant, BENCH.engine_cases[0])), fault)


@pytest.mark.parametrize("fault", HELD_FAULTS.values(), ids=HELD_FAULTS)
def test_a_fault_in_a_deck_with_walls_and_weight_is_named(fault: Fault[Change]) -> None:
    run = run_with(fault.plant, HELD_BENCH.engine_cases[0])
    HELD_BENCH.check_fault(replaced(HELD_BENCH.sound_runs, run), fault)


RUNS_THROUGH = "exceeds the gauge radius"
BROKEN: dict[str, tuple[Change, str]] = {
    "root of the effective radius missing": (without_root, RUNS_THROUGH),
    "one contact left out": (substituted(r"^pair_coeff.*# contact 1:.*\n", ""), RUNS_THROUGH),
    "a neighbour list that is never rebuilt": (list_rebuilt_every(1_000_000), RUNS_THROUGH),
    "a dump at every step": (
        substituted(r"floor\(step\*v_dense/v_per_sample\) \+ 1\)\*v_per_sample/v_dense", "step + 1)"),
        "frames",
    ),
    "the start not dumped": (substituted("first yes", "first no"), "frames"),
    "half of the steps": (substituted(r"steps +index (\d+)", lambda m: f"steps index {int(m[1]) // 2}"), "frames"),
}


@pytest.mark.parametrize(("change", "why"), BROKEN.values(), ids=BROKEN)
def test_what_a_run_notices_itself_is_broken_and_says_why(change: Change, why: str) -> None:
    verdicts = BENCH.verdicts(replaced(BENCH.sound_runs, run_with(change, BENCH.engine_cases[0])))
    [broken] = [name for name, verdict in verdicts.items() if verdict.outcome is not Outcome.PASS]
    assert (broken, verdicts[broken].outcome) == ("velocity - reference", Outcome.BROKEN)
    assert why in verdicts[broken].sentence


def test_a_missing_root_shows_where_bodies_are_large_enough_to_take_it() -> None:
    run = run_with(without_root, BENCH.engine_cases[0], surrogate_radius=1e-3)
    BENCH.check(replaced(BENCH.sound_runs, run), IMPLEMENTATION | USER | ENERGY)
