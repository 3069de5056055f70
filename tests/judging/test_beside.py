"""Judgements of runs that are made for them: a foreign code beside ours, and somebody's deck with its limits."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest

import dem_bridge as db
from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.judging import beside
from dem_bridge.scene.file.write import scene_toml
from tests.helpers.command_line import Done, assert_one_line, run_here
from tests.helpers.foreign import FAKE, PAIR


@pytest.fixture
def fake(tmp_path: Path) -> str:
    (tmp_path / "fake.py").write_text(FAKE)
    return f"{sys.executable} -S {tmp_path / 'fake.py'} {{scene}} {{dt}} {{out}}"


def test_a_velocity_verlet_code_is_of_second_order_and_equals_our_twin(fake: str) -> None:
    judgement = db.judge(scene=PAIR, command=fake, dt=(4e-7, 2e-7, 1e-7), tolerance=1e-3)
    assert judgement.outcome == "PASS"
    for quantity in ("velocity", "displacement"):
        assert judgement.order[quantity]["value"] == pytest.approx(2.0, abs=0.02)
    table = next(table for table in judgement.study.tables if table.id == "work-precision")
    codes = {row[0] for row in table.rows}
    assert {"fake.py", "our twin"} <= codes
    errors = {(row[0], row[1]): float(row[2]) for row in table.rows}
    for dt in (4e-7, 2e-7, 1e-7):  # the same algorithm: they differ by round-off
        assert errors["fake.py", dt] == pytest.approx(errors["our twin", dt], rel=1e-6)
    assert all(float(row[4]) > 0.0 for row in table.rows)
    assert [figure.id for figure in judgement.study.figures] == ["errors", "work-precision"]


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """No other code runs beside a foreign one, which saves a second."""
    monkeypatch.setattr(beside, "BESIDE", {})


@pytest.mark.usefixtures("alone")
def test_velocities_of_the_half_step_are_of_first_order(fake: str) -> None:
    judgement = db.judge(scene=PAIR, command=f"{fake} half", dt=(4e-7, 2e-7, 1e-7))
    assert judgement.cause == "half-step-velocity"
    assert judgement.order["velocity"]["value"] == pytest.approx(1.0, abs=0.02)
    assert judgement.order["displacement"]["value"] == pytest.approx(2.0, abs=0.02)


@pytest.mark.usefixtures("alone")
def test_a_soft_code_does_not_converge(fake: str) -> None:
    judgement = db.judge(scene=PAIR, command=f"{fake} soft", dt=(2e-7, 1e-7), tolerance=1e-3)
    assert judgement.outcome == "FAIL"
    assert abs(judgement.order["velocity"]["value"]) < 0.1


@pytest.mark.usefixtures("alone")
def test_the_command_line_judges_a_command_and_names_its_failure(fake: str, tmp_path: Path) -> None:
    (tmp_path / "pair.toml").write_text(scene_toml(PAIR))

    def judge(command: str, *words: str) -> Done:
        return run_here("judge", "--scene", "pair.toml", "--command", command, *words, cwd=tmp_path)

    done = judge(fake, "--dt", "2e-7,1e-7", "--tolerance", "1e-2")
    assert done.returncode == 0
    assert "fake.py at dt = 100 ns: error" in done.stdout
    failed = judge("sh -c 'echo no licence >&2; exit 7' {dt} {out}")
    assert failed.returncode == 3
    assert_one_line(failed, "ended with exit code 7: no licence")
    unread = judge("sh -c 'echo nothing > {out}' {dt}", "--dt", "1e-7")
    assert unread.returncode == 2
    assert_one_line(unread, "output of sh at dt = 1e-07 s")
    assert run_here("judge", "--scene", "pair.toml", cwd=tmp_path).returncode == 2


def test_files_and_command_exclude_each_other(fake: str) -> None:
    with pytest.raises(UsageError, match="one or the other"):
        db.judge("run.csv", PAIR, command=fake)
    with pytest.raises(UsageError, match="no scene"):
        db.judge(command=fake)


#: a deck as people write it: units cgs, beads of 1 cm, damping, few digits and no velocities in its dump
DECK = """
units cgs
atom_style sphere
boundary f f f
comm_modify vel yes
newton off
region b block -1 12 -1 1 -1 1
create_box 1 b
variable i loop 2
label beads
variable x equal 1.0*(v_i-1)
create_atoms 1 single $x 0 0
next i
jump SELF beads
read_or_not
pair_style granular
pair_coeff * * hertz/material 7e11 {damping} 0.3 tangential linear_nohistory 0 0 damping viscoelastic
group first id 1
velocity first set 80 0 0
fix 1 all nve/sphere
timestep 1e-7
dump 1 all custom 100 dump.pair id x y z
run 500
run 500
"""


def _deck(folder: Path, damping: float) -> Path:
    deck = folder / "in.pair"
    atoms = "set group all diameter 1.0\nset group all mass 8.0\nneighbor 0.05 bin\nneigh_modify delay 0"
    deck.write_text(DECK.format(damping=damping).replace("read_or_not", "include atoms.in"))
    (folder / "atoms.in").write_text(f"{atoms}\n")
    return deck


@pytest.mark.lammps
@pytest.mark.parametrize("damping", [0.0, 500.0])
def test_a_deck_is_run_as_it_is_and_its_limits_are_named(tmp_path: Path, damping: float) -> None:
    deck = _deck(tmp_path, damping)
    scene = replace(db.scene_from_deck(deck), damping=None, samples=50)
    before = sorted(tmp_path.iterdir())
    judgement = db.judge(deck, scene, tolerance=1e-3)
    assert sorted(tmp_path.iterdir()) == before
    (table,) = (table for table in judgement.study.tables if table.id.startswith("limits"))
    limits = {str(row[0]): float(row[2]) for row in table.rows}
    velocity = judgement.error["velocity"]
    error = velocity["value"] / velocity["scale"]
    if damping:
        assert limits["damping"] > 1e-7
        # with the damping of the deck a twin repeats it to the round-off of its radius
        assert limits["neither time step nor radius nor what the deck states"] < 1e-3 * limits["damping"]
    else:
        assert limits["time step"] == pytest.approx(error, rel=1e-4)
        assert limits["neither time step nor radius"] < 1e-9
        assert "damping" not in limits
    # beads of 5 mm round off more than the deck of dem-bridge, by far less than the time step
    assert 1e-14 < limits["particle radius"] < 1e-9
    assert limits["digits of own dump 1"] > 0.0
    assert limits["newton"] == 0.0
    assert limits["neighbour list"] == 0.0
    assert any("no velocities" in str(row[1]) for row in table.rows)
    assert dict(judgement.addition.lines)["limits"].startswith("in.pair: ")


@pytest.mark.lammps
def test_variables_of_a_deck_reach_lammps_and_the_reading(tmp_path: Path) -> None:
    deck = _deck(tmp_path, 0.0)
    scene = replace(db.scene_from_deck(deck), samples=50)
    deck.write_text(deck.read_text().replace("timestep 1e-7", "timestep ${step}").replace("run 500", "run ${half}"))
    errors = {}
    for step, half in (("2e-7", "250"), ("1e-7", "500")):
        judgement = db.judge(deck, scene, variables={"step": step, "half": half}, lmp_args="-nonbuf")
        errors[step] = judgement.error["velocity"]["value"]
        assert [file.record.dt for file in judgement.files] == [pytest.approx(float(step))]
    # velocity-Verlet: twice the step, four times the error
    assert errors["2e-7"] / errors["1e-7"] == pytest.approx(4.0, rel=0.02)
    with pytest.raises(UsageError, match=r"variable half, which is not defined.*--var NAME=VALUE"):
        db.judge(deck, scene, variables={"step": "1e-7"})
    csv = tmp_path / "t.csv"
    csv.write_text("time_s,velocity_0\n0,0\n")
    with pytest.raises(UsageError, match="variables were given, but no file is a LAMMPS deck"):
        db.judge(csv, scene, variables={"step": "1e-7"})


@pytest.mark.lammps
def test_a_deck_that_lammps_refuses_ends_with_its_error(tmp_path: Path) -> None:
    deck = _deck(tmp_path, 0.0)
    deck.write_text(deck.read_text().replace("fix 1 all nve/sphere", "fix 1 all nve/cube"))
    with pytest.raises(RunBroken, match="nve/cube"):
        db.judge(deck, PAIR)
    deck.write_text(deck.read_text().replace("run 500", "print run"))
    with pytest.raises(UsageError, match="no run command"):
        db.judge(deck, PAIR)
    with pytest.raises(UsageError, match="has its own time step"):
        db.judge(f"{deck}@1e-7", PAIR)


@pytest.mark.lammps
@pytest.mark.parametrize("reverse", [False, True])
def test_a_deck_is_compared_with_the_scene_from_either_end(reverse: bool) -> None:
    deck = Path(__file__).parents[1] / "data" / "decks" / "in.brass"
    judgement = db.judge(deck, db.scene_from_deck(deck, reverse=reverse))
    assert judgement.outcome == "PASS"
    (table,) = (table for table in judgement.study.tables if table.id.startswith("limits"))
    assert {str(row[0]) for row in table.rows if float(row[2]) > 0.0} == {"time step", "particle radius"}


@pytest.mark.lammps
def test_a_coarse_table_limits_a_deck(tmp_path: Path) -> None:
    db.write_deck(PAIR, tmp_path, style="table", dt=1e-8, table_points=50, table_lines=16)
    judgement = db.judge(tmp_path / "in.pair", PAIR)
    (table,) = (table for table in judgement.study.tables if table.id.startswith("limits"))
    limits = {str(row[0]): float(row[2]) for row in table.rows}
    error = judgement.error["velocity"]["value"] / judgement.error["velocity"]["scale"]
    assert limits["neither time step nor radius"] == pytest.approx(error, rel=0.1)  # the step is 1e-8 s
    assert limits["time step"] < 0.05 * error
    assert {row[1] for row in table.rows if row[0] == "table points"} == {"50 points, spline"}
