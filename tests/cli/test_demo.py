"""The first minute: ``dem-bridge demo`` says error, cause and step in five lines, ``dem-bridge show`` draws a chain."""

from __future__ import annotations

import os
import pty
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.report.chain_text import Canvas, chain_lines, front_sentences, motion_lines
from dem_bridge.verification.demo import ACCURACIES, STEP_OF_LAMMPS_S, STEPS_OF_TWIN_S, Demonstration, study_of
from tests.helpers.command_line import PROGRAM, assert_one_line, run_here
from tests.helpers.fake_runs import CHAIN

SCENE = db.load_scene("tapered-backward")


@pytest.mark.lammps
def test_the_demonstration_is_five_lines_and_a_page(tmp_path: Path) -> None:
    done = run_here("demo", "-o", "page", cwd=tmp_path)
    assert done.returncode == 0
    lines = done.stdout.splitlines()
    assert [line.split(":")[0] for line in lines] == ["Chain", "Error", "Cause", "Step", "Page"]
    assert max(map(len, lines)) <= 80
    # the error of second order at a step of 1e-7 s
    error = float(re.findall(r"at most (\S+) of the largest", lines[1])[0])
    assert 1e-5 < error < 1e-4
    assert lines[2].startswith("Cause: the time step;")
    page = (tmp_path / "page" / "index.html").read_text(encoding="utf-8")
    assert all(word in page for word in ("Chain: 41 spheres", "Cause: the time step", "LAMMPS 22 Jul 2025"))
    assert {"demo-error.svg", "demo-steps.svg"} <= {file.name for file in (tmp_path / "page" / "figures").iterdir()}


@pytest.fixture(scope="module")
def demonstration() -> Demonstration:
    """The demonstration with the twin in place of LAMMPS."""
    twins = {dt: db.solve(SCENE, backend="verlet", dt=dt, uncertainty=False) for dt in STEPS_OF_TWIN_S}
    lammps = replace_provenance(twins[STEP_OF_LAMMPS_S], lammps={"version": 20250722})
    return Demonstration(scene=SCENE, lammps=lammps, reference=db.solve(SCENE, backend="reference"), twins=twins)


def replace_provenance(run: db.Trajectory, **more: object) -> db.Trajectory:
    from dataclasses import replace

    return replace(run, provenance={**run.provenance, **more})


def test_the_step_that_is_named_has_the_accuracy_and_the_next_has_not(demonstration: Demonstration) -> None:
    for accuracy in ACCURACIES:
        step = demonstration.largest_step(accuracy)
        assert step is not None
        coarser = STEPS_OF_TWIN_S[STEPS_OF_TWIN_S.index(step) - 1]
        assert demonstration.errors[step] <= accuracy < demonstration.errors[coarser]
    assert demonstration.largest_step(1e-12) is None


def test_a_lammps_that_is_wrong_is_not_explained_by_its_step(demonstration: Demonstration) -> None:
    from dataclasses import replace

    velocity = np.array(demonstration.lammps.velocity)
    velocity[100:, 5] += 1e-3
    wrong = replace(demonstration, lammps=replace(demonstration.lammps, velocity=velocity))
    assert study_of(demonstration).answer[2].startswith("Cause: the time step;")
    assert study_of(wrong).answer[2].startswith("Cause: unknown; a second code")


@pytest.mark.parametrize("name", db.shipped_scenes("all"))
def test_a_chain_fits_into_80_columns(name: str) -> None:
    scene = db.load_scene(name)
    for blocks in (True, False):
        lines = chain_lines(scene, Canvas(blocks=blocks))
        assert max(map(len, lines)) <= 80
        assert "".join(lines).isascii() or blocks


def test_the_map_shows_the_front_where_it_is() -> None:
    run = db.solve(SCENE, backend="verlet", dt=1e-6, uncertainty=False)
    lines = motion_lines(run, Canvas())
    assert max(map(len, lines)) <= 80
    rows = [line[line.index("|") + 1 : -1] for line in lines if line.endswith("|")]
    assert len(rows) == 16
    assert set(map(len, rows)) == {SCENE.n_body}
    # at the start the struck body alone moves, at the end the last ones
    assert rows[0] == "█" + " " * 40
    fronts = [len(row.rstrip()) for row in rows]
    assert fronts == sorted(fronts)
    assert fronts[-1] == 41
    assert front_sentences(run)[0].startswith("The first maximal compression of the last contact is at 8")


def test_many_bodies_share_columns_and_none_is_lost() -> None:
    columns = Canvas(width=40).columns(1_001)
    assert [body for bodies in columns for body in bodies] == list(range(1_001))
    assert len(columns) == 27


def test_a_chain_in_which_nothing_happens_says_so() -> None:
    still = db.Scene(name="still", duration=1e-3, mass=(1e-2, 1e-2), stiffness=(1e9,), velocity=(0.0, 0.0))
    assert front_sentences(db.solve(still, backend="verlet", dt=1e-6, uncertainty=False)) == ["No contact closes."]


def test_scenes_and_runs_are_shown_alike(tmp_path: Path) -> None:
    (tmp_path / "pair.toml").write_text(CHAIN, encoding="utf-8")
    shown = run_here("show", "pair.toml", cwd=tmp_path)
    assert shown.returncode == 0
    assert max(map(len, shown.stdout.splitlines())) <= 80
    assert run_here("run", "pair.toml", "--backend", "verlet", "-o", "run.nc", cwd=tmp_path).returncode == 0
    for words in (("run.nc",), ("run.nc", "--scene", "pair.toml")):
        again = run_here("show", *words, cwd=tmp_path)
        assert again.returncode == 0
        assert again.stdout[again.stdout.index("mass") :].split("time")[0] in shown.stdout
    # without the scene a file of another program cannot be read
    (tmp_path / "theirs.csv").write_text("time_s,x_0_m,x_1_m\n0,0,0.02\n", encoding="utf-8")
    assert_one_line(run_here("show", "theirs.csv", cwd=tmp_path), "no scene was given")
    assert_one_line(run_here("show", "nothing", cwd=tmp_path), "there is no such scene or file")


@pytest.mark.parametrize(("no_color", "coloured"), [("", True), ("1", False)])
def test_colours_are_those_of_a_terminal_that_wants_them(no_color: str, coloured: bool) -> None:
    ours, theirs = pty.openpty()
    environment = os.environ | {"NO_COLOR": no_color, "TERM": "xterm-256color", "COLUMNS": "80", "PYTHONUTF8": "1"}
    child = subprocess.Popen([PROGRAM, "show", "newtons-cradle"], stdout=theirs, stderr=theirs, env=environment)
    os.close(theirs)
    text = b""
    while True:
        try:
            part = os.read(ours, 65536)
        except OSError:
            break
        if not part:
            break
        text += part
    assert child.wait(timeout=120) == 0
    assert (b"\x1b[33m" in text) == coloured
    assert "The largest force is" in text.decode()
