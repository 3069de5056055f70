"""The command line prints what it must where it must, and ends with the exit code of its outcome.

Most commands run in this process; three start the program, as a shell does.
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import dem_bridge as db
from dem_bridge.cli.terminal import print_scenes
from dem_bridge.scene.shipped import listed_scenes
from tests.helpers.command_line import PROGRAM, assert_one_line, run_here, run_program
from tests.helpers.export_chains import CROSSED_FILE
from tests.helpers.fake_runs import CHAIN


@pytest.mark.parametrize("word", ["--help", "scenes"])
def test_help_and_the_list_of_scenes_need_no_numpy(word: str, tmp_path: Path) -> None:
    code = (
        "import sys; from dem_bridge.cli import main\n"
        f"try: main(['{word}'])\n"
        "except SystemExit: pass\n"
        "heavy = {'numpy', 'scipy', 'numba', 'rich', 'pydantic', 'matplotlib'} & set(sys.modules)\n"
        "sys.exit(f'imported {heavy}' if heavy else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr


def test_a_command_uses_one_thread_for_linear_algebra_unless_the_caller_sets_more(tmp_path: Path) -> None:
    for preset, expected in (("", "1"), ("3", "3")):
        code = (
            f"import os, sys; os.environ.pop('OPENBLAS_NUM_THREADS', None); preset = {preset!r};"
            "os.environ.update({'OPENBLAS_NUM_THREADS': preset} if preset else {});"
            "from dem_bridge.cli import group;"
            "group.main = lambda: print(os.environ['OPENBLAS_NUM_THREADS'], 'numpy' in sys.modules); group.command()"
        )
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path)
        assert done.stdout == f"{expected} False\n"


#: presses Ctrl-C when the first module of the command line is imported
_EARLY = """
import os, signal, sys
class Early:
    def find_spec(name, *_):
        if name == "dem_bridge.cli.group":
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Early)
sys.argv = ["dem-bridge", "--version"]
from dem_bridge.cli import {name}
{name}()
"""


@pytest.mark.parametrize(
    ("before", "name", "code", "lines"),
    [
        (signal.default_int_handler, "command", -signal.SIGINT, 0),
        (signal.SIG_IGN, "command", 0, 0),
        (signal.default_int_handler, "main", -signal.SIGINT, 1),  # the fault: Python's handler while modules come
    ],
)
def test_ctrl_c_during_the_imports_ends_without_a_traceback(before: Any, name: str, code: int, lines: int) -> None:
    done = subprocess.run(
        [sys.executable, "-c", _EARLY.format(name=name)],
        capture_output=True,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, before),
    )
    assert (done.returncode, done.stderr.count("Traceback")) == (code, lines)


def test_scenes_lists_every_shipped_scene(tmp_path: Path) -> None:
    done = run_here("scenes", cwd=tmp_path)
    assert done.returncode == 0
    lines = done.stdout.splitlines()
    assert tuple(line.split()[0] for line in lines) == ("scene", *db.shipped_scenes("all"))
    assert max(map(len, lines)) <= 124
    scenes = {scene["name"]: scene for scene in json.loads(run_here("scenes", "--json", cwd=tmp_path).stdout)}
    assert scenes["decelerating-40"]["contacts"] == 40


@pytest.mark.parametrize("width", [80, 120])
def test_scenes_fit_a_terminal(width: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    print_scenes(listed_scenes())
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= width
    assert len(lines) > len(listed_scenes()) + 1  # some are wrapped, under what happens in them
    assert {line[:45].strip() for line in lines if line.startswith(" ")} == {""}


def test_run_prints_json_on_stdout_and_nothing_on_stderr_in_a_pipe(tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text(CHAIN)
    done = run_program(
        "run", "small.toml", "--backend", "verlet", "--dt", "1e-7", "--json", "-o", "run.nc", cwd=tmp_path
    )
    assert done.returncode == 0
    assert done.stderr == ""
    printed = json.loads(done.stdout)
    assert printed["settings"]["dt"] == pytest.approx(1e-7)
    assert 0.0 < printed["velocity_uncertainty_m_per_s"] < 1e-3
    assert (tmp_path / "run.nc").exists()
    assert not list(tmp_path.glob("*.part"))


def test_run_takes_the_tolerances_of_an_adaptive_backend(tmp_path: Path) -> None:
    words = ("run", "accelerating-40", "--backend", "ode45", "--rtol", "1e-5", "--atol", "1e-8", "--json")
    printed = json.loads(run_here(*words, cwd=tmp_path).stdout)
    assert (printed["settings"]["rtol"], printed["settings"]["atol"]) == (1e-5, 1e-8)


@pytest.mark.parametrize(
    "words",
    [("run", "own.toml", "--backend", "verlet"), ("export", "own.toml", "--table", "bodies", "--format", "csv")],
    ids=["run", "export"],
)
def test_no_output_takes_the_place_of_the_scene_that_is_read(words: tuple[str, ...], tmp_path: Path) -> None:
    file = tmp_path / "own.toml"
    file.write_text(CHAIN, encoding="utf-8")
    done = run_here(*words, "-o", "own.toml", cwd=tmp_path)
    assert done.returncode == 2
    assert_one_line(done, "own.toml: the output would replace the scene file")
    assert file.read_text(encoding="utf-8") == CHAIN


def test_a_bad_scene_is_one_line_and_exit_code_2(tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_text(CHAIN.replace("8.1e-3", "-8.1e-3"))
    done = run_program("run", "bad.toml", "--backend", "verlet", cwd=tmp_path)
    assert done.returncode == 2
    assert_one_line(done, "bad.toml", "chain.mass[0]", "-0.0081", "allowed")


@pytest.mark.parametrize(
    "words",
    [
        ("run", "nowhere.toml", "--backend", "verlet"),
        ("run", "decelerating-40", "--backend", "verlet", "--dt", "-1"),
        ("run", "decelerating-40", "--backend", "verlet", "--dt", "nan"),
        ("run", "decelerating-40", "--backend", "verlet", "--dt", "1e-8", "--accuracy", "1e-6"),
        ("run", "decelerating-40", "--backend", "bca", "--accuracy", "1e-6"),
        ("run", "decelerating-40", "--backend", "verlet", "--samples", "0"),
        ("run", "decelerating-40", "--backend", "scipy", "--rtol", "1e-3"),
        ("run", "decelerating-40", "--backend", "ode45", "--atol", "0"),
        ("verify", "decelerating-40", "--accuracy", "2"),
        ("run", "decelerating-40", "--backend", "lammps-table", "--geometry", "9mm"),
        ("run", "decelerating-40", "--backend", "lammps-table", "--types", "one"),
        ("deck", "decelerating-40", "--style", "lepton", "-o", "deck"),
        ("deck", "decelerating-40", "--style", "table", "--geometry", "", "-o", "deck"),
    ],
)
def test_wrong_use_is_one_line_and_exit_code_2(words: tuple[str, ...], tmp_path: Path) -> None:
    done = run_here(*words, cwd=tmp_path)
    assert done.returncode == 2
    assert_one_line(done)
    assert list(tmp_path.iterdir()) == []


def test_a_backend_that_cannot_do_the_scene_says_so(tmp_path: Path) -> None:
    (tmp_path / "steep.toml").write_text(CHAIN.replace("velocity =", "exponent = 3.0\nvelocity ="))
    done = run_here("run", "steep.toml", "--backend", "lammps-granular", cwd=tmp_path)
    assert done.returncode == 2
    assert_one_line(done, "NOT_RUN", "exponent")


def test_an_output_folder_that_is_missing_is_found_before_the_run(tmp_path: Path) -> None:
    done = run_here("run", "decelerating-40", "--backend", "scipy", "-o", "no/such/run.nc", cwd=tmp_path)
    assert done.returncode == 2
    assert "no/such" in done.stderr


def test_deck_writes_the_deck(tmp_path: Path) -> None:
    done = run_here("deck", "accelerating-40", "-o", "deck", cwd=tmp_path)
    assert done.returncode == 0
    assert [Path(line).name for line in done.stdout.split()] == ["in.accelerating-40", "data.accelerating-40"]


def test_a_deck_may_have_tables_the_scenes_own_radius_and_a_type_for_each_body(tmp_path: Path) -> None:
    words = ("deck", "accelerating-40", "--dt", "1e-7", "--style", "table")
    done = run_here(*words, "--geometry", "physical", "--types", "per-body", "-o", "deck", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert {Path(line).name for line in done.stdout.split()} == {file.name for file in (tmp_path / "deck").iterdir()}
    text = (tmp_path / "deck" / "in.accelerating-40").read_text()
    assert "41 atom types" in text
    assert "radius R = 0.009 m" in text
    assert "pair_style      table spline 10000\n" in text
    assert len(list((tmp_path / "deck").glob("*.table"))) == 41


def test_a_scene_without_a_spacing_has_no_deck_of_its_own_radius(tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text(CHAIN)
    done = run_here("deck", "small.toml", "--geometry", "physical", "-o", "deck", cwd=tmp_path)
    assert done.returncode == 2
    assert_one_line(done, "geometry = 'physical' on small", "no spacing", "allowed: 'surrogate'")
    assert not (tmp_path / "deck").exists()


@pytest.mark.lammps
def test_run_solves_any_exponent_by_tables_and_prints_their_errors_and_round_off(tmp_path: Path) -> None:
    (tmp_path / "steep.toml").write_text(CHAIN.replace("velocity =", "exponent = [3.2, 2.1]\nvelocity ="))
    words = ("run", "steep.toml", "--backend", "lammps-table", "--types", "per-body", "--dt", "1e-7", "--json")
    done = run_here(*words, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    printed = json.loads(done.stdout)
    assert printed["backend"] == "lammps-table"
    assert 0.0 < printed["roundoff_floor_relative"] < 1e-10
    assert 0.0 < printed["table_measured_error_relative"] < 2.0 * printed["table_predicted_error_relative"] < 1e-6
    assert 0.0 < printed["velocity_uncertainty_m_per_s"] < 1e-3


@pytest.mark.lammps
def test_verify_writes_page_json_and_junit_and_ends_with_0(tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text(CHAIN)
    words = ("verify", "small.toml", "--accuracy", "1e-4", "-o", "report", "--json", "v.json", "--junit", "v.xml")
    done = run_here(*words, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr == ""
    assert "PASS" in done.stdout
    assert "\x1b" not in done.stdout
    assert json.loads((tmp_path / "v.json").read_text())["verdicts"]
    assert (tmp_path / "report" / "index.html").exists()


def test_a_bundle_is_not_written_into_a_folder_with_other_things(tmp_path: Path) -> None:
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "thesis.tex").write_text("years of work")
    done = run_here("verify", "decelerating-40", "-o", "report", "--bundle", "thesis", cwd=tmp_path)
    assert done.returncode == 2
    assert_one_line(done, "thesis", "contains files that are not a bundle", "allowed: a new or empty folder")
    assert [path.name for path in (tmp_path / "thesis").iterdir()] == ["thesis.tex"]
    assert not list((tmp_path / "report").iterdir())


@pytest.mark.slow
@pytest.mark.lammps
def test_verify_writes_a_bundle_and_names_the_command_that_runs_it_again(tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text(CHAIN)
    done = run_program("verify", "small.toml", "--accuracy", "1e-4", "-o", "report", "--bundle", "bundle", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert "bundle: bundle; repeat the runs with: sh bundle/replay.sh" in done.stdout
    same = (tmp_path / "report/verdicts.json").read_text() == (tmp_path / "bundle/report/verdicts.json").read_text()
    assert same


def test_tab_completion_offers_the_shipped_scenes(tmp_path: Path) -> None:
    completion = {"_DEM_BRIDGE_COMPLETE": "bash_complete", "COMP_WORDS": "dem-bridge run dec", "COMP_CWORD": "2"}
    done = subprocess.run(
        [PROGRAM], capture_output=True, text=True, cwd=tmp_path, env={**os.environ, **completion}, timeout=60
    )
    assert "decelerating-40" in done.stdout


def test_the_paper_is_verified_alone(tmp_path: Path) -> None:
    done = run_here("verify", "paper", "decelerating-40", cwd=tmp_path)
    assert done.returncode == 2
    assert_one_line(done, "'paper' stands for all shipped scenes", "give it alone")


def test_the_summary_of_an_impact_has_its_restitution(tmp_path: Path) -> None:
    words = ("run", "lammps-hertz-restitution", "--backend", "scipy")
    summary = json.loads(run_here(*words, "--json", cwd=tmp_path).stdout)
    assert summary["restitution"] == pytest.approx(0.5, abs=1e-11)
    assert "restitution                  0.5" in run_here(*words, cwd=tmp_path).stdout.splitlines()
    other = run_here("run", "decelerating-40", "--backend", "bca", "--json", cwd=tmp_path)
    assert "restitution" not in json.loads(other.stdout)


@pytest.mark.parametrize("size", [10, 100_000])
def test_a_reader_that_ends_early_causes_no_message(size: int, tmp_path: Path) -> None:
    code = (
        "import sys, click, dem_bridge.cli.group as group\n"
        f"group.main.add_command(click.Command('long', callback=lambda: click.echo('x' * {size})))\n"
        "sys.argv = ['dem-bridge', 'long']\n"
        "sys.stdin.readline()\n"
        "group.command()\n"
    )
    words = [sys.executable, "-c", code]
    pipe = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(words, cwd=tmp_path, **pipe) as process:  # type: ignore[call-overload]
        process.stdout.close()
        process.stdin.write(b"\n")
        process.stdin.close()
        assert process.stderr.read() == b""
        assert process.wait(timeout=60.0) == 141


def test_files_that_exist_are_replaced_only_by_force(tmp_path: Path) -> None:
    (tmp_path / "deck").mkdir()
    (tmp_path / "deck" / "data.decelerating-40").write_text("precious")
    words = ("deck", "decelerating-40", "--dt", "1e-7", "-o", "deck")
    done = run_here(*words, cwd=tmp_path)
    assert done.returncode == 2
    assert "deck/data.decelerating-40: the file exists; allowed: new files, or --force" in done.stderr
    assert [file.name for file in (tmp_path / "deck").iterdir()] == ["data.decelerating-40"]
    assert (tmp_path / "deck" / "data.decelerating-40").read_text() == "precious"
    assert run_here(*words, "--force", cwd=tmp_path).returncode == 0
    assert (tmp_path / "deck" / "data.decelerating-40").read_text() != "precious"
    for flag in ("--json", "--junit"):
        (tmp_path / "v").write_text("precious")
        done = run_here("verify", "decelerating-40", flag, "v", "-o", "report", cwd=tmp_path)
        assert (done.returncode, (tmp_path / "v").read_text()) == (2, "precious")
        assert "v: the file exists; allowed: a new file, or --force" in done.stderr
    assert not (tmp_path / "report").exists()


def test_names_that_are_no_utf_8_are_printed_and_a_closed_output_is_none(tmp_path: Path) -> None:
    words: list[str | bytes] = [
        sys.executable,
        "-m",
        "dem_bridge.cli",
        "export",
        "dimer-1-1",
        "--table",
        "bodies",
        "-o",
        b"\xff.csv",
    ]
    done = subprocess.run(words, capture_output=True, cwd=tmp_path, timeout=300)
    assert (done.returncode, done.stderr, b"\\udcff" in done.stdout) == (0, b"", True)
    done = subprocess.run(["sh", "-c", f"{sys.executable} -m dem_bridge.cli scenes >&-"], capture_output=True)
    assert (done.returncode, done.stderr) == (0, b"")


def test_an_interrupt_while_the_words_are_read_is_no_failed_check(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("dem_bridge.cli.main.parse_args", interrupted)
    done = run_here("scenes", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (130, "dem-bridge: interrupted; nothing was run\n")


@pytest.mark.parametrize(
    "words",
    [
        ("run", "decelerating-40", "--backend", "bca", "-o"),
        ("export", "decelerating-40", "--table", "bodies", "--format", "csv", "-o"),
        *(("regress", "--baselines", ".", option) for option in ("--json", "--junit", "--markdown")),
    ],
    ids=lambda words: f"{words[0]} {words[-1]}",
)
def test_no_command_replaces_a_file_without_force(words: tuple[str, ...], tmp_path: Path) -> None:
    (tmp_path / "v").write_text("precious")
    (tmp_path / "link").symlink_to("v")
    for name in ("v", "link"):
        done = run_here(*words, name, cwd=tmp_path)
        assert (done.returncode, "the file exists; allowed: a new file, or --force" in done.stderr) == (2, True)
    assert (tmp_path / "v").read_text() == "precious"
    if words[0] == "export":
        assert run_here(*words, "v", "--force", cwd=tmp_path).returncode == 0
        assert (tmp_path / "v").read_text() != "precious"


def test_files_of_a_scene_may_be_elsewhere_if_the_user_says_so(tmp_path: Path) -> None:
    (tmp_path / "force.csv").write_text("0,1\n1,1\n")
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / "scene.toml").write_text(
        "name = 'driven'\nduration = 1.0\n[chain]\nmass = [1.0]\nstiffness = []\nvelocity = [0.0]\n"
        "[chain.drive]\nshape = 'table'\nfile = '../force.csv'\n"
    )
    words = ("export", "inner/scene.toml", "--table", "bodies", "--no-run")
    done = run_here(*words, cwd=tmp_path)
    assert (done.returncode, "name another folder by --files-below" in done.stderr) == (2, True)
    assert run_here("--files-below", ".", *words, cwd=tmp_path).returncode == 0


def test_the_file_of_a_run_has_the_format_of_its_ending_and_holds_its_scene(tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text(CROSSED_FILE)
    for name in ("run.csv", "run.nc"):
        done = run_here("run", "own.toml", "--backend", "verlet", "--dt", "1e-6", "-o", name, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    done = run_here("convert", "run.nc", "-o", "again.csv", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "again.csv").read_bytes() == (tmp_path / "run.csv").read_bytes()
    done = run_here("run", "own.toml", "--backend", "verlet", "-o", "run.xyzw", cwd=tmp_path)
    assert done.returncode == 2
    assert "the file type is not clear from '.xyzw'" in done.stderr


def test_a_run_whose_error_is_large_names_the_command_that_finds_a_better_step(tmp_path: Path) -> None:
    done = run_here("run", "decelerating-40", "--backend", "verlet", "--dt", "1e-5", cwd=tmp_path)
    assert done.returncode == 0
    said = "velocities may be wrong by {} of the largest; for better settings: dem-bridge plan decelerating-40 --acc"
    assert said.format("more than 100 %") in done.stderr
    done = run_here("run", "decelerating-40", "--backend", "verlet", "--dt", "1e-6", cwd=tmp_path)
    assert re.search(said.format(r"at most \d\.?\d? %"), done.stderr)
    done = run_here("run", "decelerating-40", "--backend", "verlet", "--dt", "1e-7", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert "1e-07 s: 0.0055 of the contact time, 18.33 us" in done.stdout
    assert max(map(len, done.stdout.splitlines())) <= 80


def test_a_run_in_which_nothing_touches_says_so(tmp_path: Path) -> None:
    (tmp_path / "rest.toml").write_text(
        'name = "rest"\nduration = 1e-3\n[chain]\nmass = [1e-2, 1e-2]\nstiffness = [1e9]\nvelocity = [0.0, 0.0]\n'
    )
    done = run_here("run", "rest.toml", "--backend", "verlet", cwd=tmp_path)
    assert "no contact closes" in done.stdout


def test_a_step_that_is_none_is_answered_with_a_usual_one(tmp_path: Path) -> None:
    done = run_here("run", "decelerating-40", "--backend", "verlet", "--dt", "1e-41", cwd=tmp_path)
    assert done.returncode == 2
    assert "a usual step for this scene is 2e-08 s" in done.stderr


def test_a_pipe_that_is_closed_is_no_failed_check(tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text(CHAIN)
    command = f"{sys.executable} -m dem_bridge.cli verify small.toml --accuracy 1e-2 -j 1 -o report"
    script = f"({command}; echo $? > code) | true"
    assert subprocess.run(["sh", "-c", script], cwd=tmp_path, timeout=300).returncode == 0
    assert (tmp_path / "code").read_text().strip() == "141"


def test_a_working_folder_that_was_removed_and_a_full_disk_end_in_words(tmp_path: Path) -> None:
    words = f"{sys.executable} -m dem_bridge.cli run decelerating-40 --backend verlet --dt 1e-6"
    script = f"mkdir gone && cd gone && rmdir ../gone && {words} -o run.nc"
    done = subprocess.run(["sh", "-c", script], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    last = "dem-bridge: the working folder was removed; change to a folder that exists"
    assert (done.returncode, done.stderr.splitlines()[-1]) == (2, last)
    script = f"ulimit -f 8; {words} -o run.nc"
    done = subprocess.run(["sh", "-c", script], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.returncode == 2
    assert "cannot be written (File too large)" in done.stderr
    assert not list(tmp_path.glob("*.nc"))


def test_a_command_ends_at_once_and_leaves_no_process_behind() -> None:
    code = """
import atexit, multiprocessing, sys, time
from dem_bridge.cli import group

class Torn:
    def __del__(self):
        print("the interpreter was torn down", flush=True)

torn = Torn()
atexit.register(print, "removed", flush=True)
child = multiprocessing.get_context("spawn").Process(target=time.sleep, args=(60.0,), daemon=True)
child.start()
print(child.pid)
group.main = sys.exit
group.command()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=30.0)
    pid, *rest = done.stdout.splitlines()
    assert (done.returncode, done.stderr, rest) == (0, "", ["removed"])
    assert not Path(f"/proc/{pid}").exists()
