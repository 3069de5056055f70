"""`dem-bridge import csv` and `dem-bridge import deck`: files in, a scene file out, and what was understood."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner, Result

import dem_bridge as db
from dem_bridge.cli import main
from tests.helpers.lammps_scripts import script
from tests.scene.file.test_scene_csv import CHAIN, THREE

SCRIPT = script().replace("timestep 1e-7", "variable dt index 1e-7\ntimestep ${dt}")


def _asked(*words: object) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "chain.csv").write_text(CHAIN)
    (tmp_path / "in.test").write_text(SCRIPT)
    return tmp_path


def test_a_csv_becomes_a_scene_file(folder: Path) -> None:
    out = folder / "mine.toml"
    done = _asked("import", "csv", folder / "chain.csv", "--duration", "1e-4", "-o", out)
    assert (done.exit_code, done.stderr) == (0, "")
    assert db.load_scene(out) == THREE
    assert done.stdout.splitlines() == [
        "scene          chain: 3 bodies, 2 contacts",
        "masses         0.008 to 0.012 kg",
        "stiffness      5e+06 to 4e+09 N/m^(n-1), n = 2, 2.5",
        "gaps           0 to 1e-06 m",
        "start          body 0 at 0.8 m/s, body 2 at -0.1 m/s",
        "duration       0.0001 s, 500 samples",
        f"written: {out}",
        f"next: dem-bridge verify {out}",
    ]


def test_options_say_what_a_csv_does_not(folder: Path) -> None:
    out = folder / "mine.toml"
    words = ("--name", "n", "--gravity", "9.81", "--drag", "0.5", "--samples", "9", "--description", "my own")
    walls = ("--wall-left", "1e9", "--wall-right", "2e9,1e-6,2")
    done = _asked("import", "csv", folder / "chain.csv", "--duration", "1e-4", "-o", out, *words, *walls)
    assert done.exit_code == 0, done.stderr
    scene = db.load_scene(out)
    assert (scene.name, scene.gravity, scene.drag, scene.samples, scene.description) == ("n", 9.81, 0.5, 9, "my own")
    assert scene.wall_left == db.Wall(stiffness=1e9, exponent=2.5)
    assert scene.wall_right == db.Wall(stiffness=2e9, gap=1e-6, exponent=2.0)
    assert "wall right     stiffness 2e+09, gap 1e-06 m, n = 2" in done.stdout


def test_exported_tables_go_in_by_the_command_line(folder: Path) -> None:
    for table in ("bodies", "contacts"):
        more = ("--no-run",) if table == "contacts" else ()
        done = _asked("export", "stacked-40", "--table", table, *more, "-o", folder / f"{table}.csv")
        assert done.exit_code == 0
    words = ("--contacts", folder / "contacts.csv", "--duration", "1.5e-3", "--gravity", "9.81")
    done = _asked(
        "import", "csv", folder / "bodies.csv", *words, "--precompression", "1e-6", "-o", folder / "again.toml"
    )
    assert done.exit_code == 0, done.stderr
    assert db.load_scene(folder / "again.toml").content_hash == db.load_scene("stacked-40").content_hash


def test_a_deck_becomes_a_scene_file(folder: Path) -> None:
    out = folder / "mine.toml"
    done = _asked("import", "deck", folder / "in.test", "-o", out)
    assert (done.exit_code, done.stderr) == (0, "")
    scene = db.load_scene(out)
    assert scene == db.scene_from_deck(folder / "in.test")
    lines = done.stdout.splitlines()
    assert lines[0] == "read: the chain lies along x; body 0 is atom 1 (which moves), positive is +x"
    assert lines[-3:] == [
        "not tested: the script's time step, 1e-07 s; a scene has no time step, and verify chooses its own",
        f"next: dem-bridge run {out} --backend lammps-granular --dt 1e-07  # accuracy at the script's step",
        f"next: dem-bridge verify {out}",
    ]
    other = _asked(
        "import", "deck", folder / "in.test", "-o", out, "--force", "--var", "dt=2e-7", "--reverse", "--samples", "5"
    )
    assert other.exit_code == 0, other.stderr
    again = db.load_scene(out)
    assert again.duration == pytest.approx(2.0 * scene.duration, rel=1e-15)
    assert again.velocity == tuple(-v + 0.0 for v in scene.velocity[::-1])
    assert again.samples == 5


def test_without_reverse_body_0_is_the_end_that_moves(folder: Path) -> None:
    text = SCRIPT.replace(
        "group striker id 1\nvelocity striker set 0.5", "group striker id 3\nvelocity striker set -0.5"
    )
    (folder / "in.last").write_text(text)
    scenes = []
    for words in ((), ("--reverse",), ("--no-reverse",)):
        done = _asked("import", "deck", folder / "in.last", "-o", folder / "last.toml", "--force", *words)
        assert done.exit_code == 0, done.stderr
        scenes.append(db.load_scene(folder / "last.toml").velocity)
    assert scenes == [(0.5, 0.0, 0.0), (0.5, 0.0, 0.0), (0.0, 0.0, -0.5)]


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("csv", "chain.csv", "-o", "mine.toml"), "Missing option '--duration'"),
        (("csv", "gone.csv", "--duration", "1", "-o", "mine.toml"), "gone.csv: the file cannot be read (No such file"),
        (
            ("csv", "chain.csv", "--duration", "1", "-o", "in.test"),
            "in.test: the file exists; allowed: a new file, or",
        ),
        (("csv", "chain.csv", "--duration", "1", "-o", "no/mine.toml"), "the folder no is missing or not writable"),
        (("csv", "chain.csv", "--duration", "1", "-o", "m.toml", "--wall-left", "a"), "allowed: STIFFNESS[,GAP[,EXP"),
        (("csv", "chain.csv", "--duration", "1", "-o", "m.toml", "--wall-left", "1,2,3,4"), "allowed: STIFFNESS[,GAP"),
        (("csv", "chain.csv", "--duration", "1", "-o", "m.toml", "--wall-left=-1"), "wall_left.stiffness = -1.0"),
        (("deck", "chain.csv", "-o", "mine.toml"), "chain.csv: no line of the file is a command of LAMMPS"),
        (("deck", "in.test", "-o", "mine.toml", "--var", "dt"), "'dt'; allowed: NAME=VALUE"),
        (("deck", "in.test", "-o", "mine.toml", "--name", "a b"), "name = 'a b'; allowed: 1 to 100 of"),
        (("deck", ".", "-o", "mine.toml"), "cannot be read (Is a directory)"),
    ],
)
def test_a_mistake_is_one_line_and_writes_nothing(
    words: tuple[str, ...], why: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    done = _asked("import", *words)
    assert done.exit_code == 2
    assert why in done.stderr
    assert done.stderr.count("\n") == 1
    assert done.stdout == ""
    assert sorted(one.name for one in folder.iterdir()) == ["chain.csv", "in.test"]


def test_completion_offers_the_two_and_files() -> None:
    from click.shell_completion import ShellComplete

    complete = ShellComplete(main, {}, "dem-bridge", "_DEM_BRIDGE_COMPLETE")
    assert [one.value for one in complete.get_completions(["import"], "")] == ["csv", "deck"]
    assert [one.type for one in complete.get_completions(["import", "deck"], "in")] == ["file"]
    assert [one.value for one in complete.get_completions(["import", "csv"], "--w")] == ["--wall-left", "--wall-right"]


def test_every_command_that_cannot_be_read_has_a_line(folder: Path) -> None:
    text = SCRIPT.replace("fix move", "fix pour bodies pour 9 1 2\nmolecule a b\nfix move")
    text = text.replace("damping velocity", "damping odd")
    (folder / "in.test").write_text(text)
    done = _asked("import", "deck", folder / "in.test", "-o", folder / "mine.toml")
    assert (done.exit_code, done.stdout) == (2, "")
    lines = done.stderr.splitlines()
    assert [line.split("`")[0] for line in lines] == [f"dem-bridge: in.test, line {k}: " for k in (13, 17, 18)]
    assert all("; allowed: " in line for line in lines)
    assert not (folder / "mine.toml").exists()


def test_a_script_that_meets_a_known_defect_is_read_with_a_warning(folder: Path) -> None:
    wall = "fix w all wall/gran hooke 2e7 NULL 0 NULL 0 0 xplane -1 NULL\ntimestep"
    (folder / "in.test").write_text(SCRIPT.replace("timestep", wall, 1))
    done = _asked("import", "deck", folder / "in.test", "-o", folder / "out.toml")
    assert done.exit_code == 0, done.stderr
    (line,) = done.stderr.splitlines()
    assert "meets the known defect undamped-classic-wall: velocities are nan" in line
    assert "write gamma_n = 1e-300 in place of 0" in line
