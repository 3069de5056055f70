"""Ties: moments that fall on a step within round-off are found, with their effect and what mends them."""

from __future__ import annotations

from pathlib import Path

import pytest

import dem_bridge as db
from dem_bridge.judging.check.ties import Tie, ties_of
from dem_bridge.judging.deck import deck_run, user_deck
from tests.judging.check.measure_ties import is_found, measure, ties_found
from tests.judging.check.tie_decks import KINDS, tie_deck

#: two spheres of 5 mm whose contact closes at step 2500, as in two tests of LAMMPS: 50 um at 2 m/s and 1e-8 s
TSUJI = """
units si
boundary f f f
atom_style sphere
comm_modify vel yes
region box block -0.1 0.1 -0.02 0.02 -0.02 0.02 units box
create_box 1 box
create_atoms 1 single -{half!r} 0 0 units box
create_atoms 1 single {half!r} 0 0 units box
set group all diameter 0.005 density 2700.0
set atom 1 vx 2.0
set atom 2 vx -2.0
pair_style granular
pair_coeff * * hertz/material 7e10 0.5 0.33 damping {damping} tangential mindlin NULL 0.5 0.4
fix move all nve/sphere
timestep 1e-8
run 5100
"""


def _ties(text: str, folder: Path) -> tuple[Tie, ...]:
    script = folder / "in.tie"
    script.write_text(text)
    ties, why = ties_of(user_deck(script))
    assert why == ""
    return ties


def test_a_touch_on_a_step_is_found_with_its_effect_and_mended_by_its_own_advice(tmp_path: Path) -> None:
    [tie] = _ties(TSUJI.format(half=0.00255, damping="tsuji"), tmp_path)
    assert (tie.kind, tie.contacts, tie.step) == ("touch", (0,), 2500)
    assert abs(tie.distance) < 1e-16 < tie.allowed
    # the damping goes as overlap^(1/4), so that a round-off of the overlap decides about a kick of a few 1e-6 m/s
    assert 1e-7 < tie.effect < 1e-4
    assert tie.told
    assert "a gap that is 2e-08 m wider (half a step of the approach), or a time step of 9.998e-09 s" in tie.sentence
    assert _ties(TSUJI.format(half=0.00255001, damping="tsuji"), tmp_path) == ()
    finer = TSUJI.format(half=0.00255, damping="tsuji").replace("timestep 1e-8", "timestep 9.998e-9")
    assert _ties(finer, tmp_path) == ()


def test_no_digit_depends_on_a_touch_without_damping(tmp_path: Path) -> None:
    text = TSUJI.format(half=0.00255, damping="velocity").replace(" 0.5 0.33", " 0 0.33")
    [tie] = _ties(text, tmp_path)
    assert tie.effect == 0.0
    assert not tie.told
    assert "no more digits depend on it than on any rounding" in tie.sentence


@pytest.mark.parametrize("kind", KINDS)
def test_planted_ties_are_found(kind: str) -> None:
    deck = tie_deck(KINDS.index(kind), planted=True)
    assert is_found(deck, ties_found(deck))
    assert ties_found(tie_deck(KINDS.index(kind), planted=False)) == ()


@pytest.mark.slow
def test_of_many_planted_ties_nearly_all_are_found_and_few_where_none_is() -> None:
    found, false, wrong = measure(400)
    assert sum(found.values()) >= 0.99 * 200, wrong
    assert sum(false.values()) < 0.01 * 200, wrong


def test_bodies_that_start_in_touch_are_no_tie(tmp_path: Path) -> None:
    assert _ties(TSUJI.format(half=0.0025, damping="tsuji"), tmp_path) == ()
    almost = TSUJI.format(half=0.0025, damping="tsuji").replace("single 0.0025 ", "single 0.0025000000000000005 ")
    [tie] = _ties(almost, tmp_path)  # one digit more: the first step has a contact or none
    assert (tie.kind, tie.step) == ("touch", 0)


def _final_speed(half: float, units: str, folder: Path) -> float:
    """Return the last velocity of the first body by LAMMPS, m/s; ``half``: of the distance, m."""
    text = TSUJI.format(half=half, damping="coeff_restitution")
    if units == "cgs":  # the same in cm, g and s: only round-off differs
        for si, cgs in (
            ("units si", "units cgs"), ("-0.1 0.1 -0.02 0.02 -0.02 0.02", "-10 10 -2 2 -2 2"), ("0.005", "0.5"),
            (repr(half), repr(100.0 * half)), ("2700.0", "2.7"), ("vx 2.0", "vx 200.0"), ("vx -2.0", "vx -200.0"),
            ("7e10", "7e11"),
        ):  # fmt: skip
            assert si in text
            text = text.replace(si, cgs)
    (folder / f"in.{units}").write_text(text)
    with deck_run(folder / f"in.{units}", None, time_limit=60.0, every=5100) as run:
        return float(run.out.read_text().splitlines()[-2].split()[5]) * (0.01 if units == "cgs" else 1.0)


@pytest.mark.lammps
def test_lammps_depends_on_units_by_at_most_what_is_said_and_not_once_it_is_mended(tmp_path: Path) -> None:
    [tie] = _ties(TSUJI.format(half=0.00255, damping="coeff_restitution"), tmp_path)
    apart, mended = (
        abs(_final_speed(half, "si", tmp_path) - _final_speed(half, "cgs", tmp_path)) for half in (0.00255, 0.00255001)
    )
    assert 1e-7 < apart / 2.0 <= tie.effect  # the largest velocity is 2 m/s
    assert mended < 1e-3 * apart


@pytest.mark.lammps
def test_check_tells_a_tie_and_keeps_its_lines(tmp_path: Path) -> None:
    script = tmp_path / "in.tie"
    script.write_text(TSUJI.format(half=0.00255, damping="coeff_restitution"))
    answer = db.check(script)
    assert answer.outcome == "PASS"  # a tie is no fault
    [tie] = answer.ties
    assert (tie["kind"], tie["step"]) == ("touch", 2500)
    assert "ties       the touch of contact 0 falls on step 2500" in answer.shown()
    assert len(list(answer.lines("page/index.html"))) <= 8
    answer.save(tmp_path / "page")
    assert "on which side of the step they are" in (tmp_path / "page" / "index.html").read_text()
