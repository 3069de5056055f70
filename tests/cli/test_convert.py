"""`dem-bridge convert` and `dem-bridge compare`: files in and out, words, exit codes."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

import dem_bridge as db
from dem_bridge.cli import main
from dem_bridge.scene.file.write import scene_toml
from tests.helpers.command_line import choices
from tests.helpers.export_chains import RAW
from tests.helpers.export_runs import foreign_dump, made_up


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """With a scene file, a run of it, the same by another, and one in which a bit is different."""
    run = made_up(RAW)
    (tmp_path / "raw.toml").write_text(scene_toml(RAW))
    run.save(tmp_path / "run.nc")
    (tmp_path / "theirs.lammpstrj").write_text(foreign_dump(RAW, run, walls=True))
    velocity = run.velocity.copy()
    velocity[7, 2] = np.nextafter(velocity[7, 2], 9.0)
    replace(run, velocity=velocity).save(tmp_path / "other.nc")
    return tmp_path


def _asked(*words: object) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


def test_the_words_of_the_commands_are_those_of_the_package() -> None:
    from dem_bridge.formats.units import STYLES as KNOWN
    from dem_bridge.formats.writers import SUFFIXES

    assert tuple(KNOWN) == choices("convert", "units") == choices("compare", "units")
    assert set(choices("convert", "format")) == set(SUFFIXES.values()) - {"traj"}


@pytest.mark.parametrize("ending", ["extxyz", "lammpstrj", "csv", "nc"])
def test_a_run_goes_out_and_in_and_is_the_same(folder: Path, ending: str) -> None:
    out = folder / f"out.{ending}"
    done = _asked("convert", folder / "run.nc", "-o", out, "--scene", folder / "raw.toml")
    assert (done.exit_code, done.stdout, done.stderr) == (0, f"written: {out}\n", "")
    out.write_bytes(written := out.read_bytes() + b" ")
    again = _asked("convert", folder / "run.nc", "-o", out, "--scene", folder / "raw.toml")
    assert (again.exit_code, out.read_bytes() == written) == (2, True)
    assert "the file exists; allowed: a new file, or --force to replace it" in again.stderr
    forced = _asked("convert", folder / "run.nc", "-o", out, "--scene", folder / "raw.toml", "--force")
    assert (forced.exit_code, out.read_bytes() == written[:-1]) == (0, True)
    back = _asked("compare", out, folder / "run.nc", "--scene", folder / "raw.toml", "--tolerance", "0")
    assert back.exit_code == 0, back.output
    assert "velocities do not differ at any of 13 samples" in back.stdout


def test_a_dump_of_others_becomes_netcdf_with_what_was_assumed(folder: Path) -> None:
    out = folder / "theirs.nc"
    done = _asked("convert", folder / "theirs.lammpstrj", "-o", out, "--scene", folder / "raw.toml")
    assert done.exit_code == 0
    assert "note: theirs.lammpstrj: displacements are relative to the first frame" in done.stderr
    assert db.load_trajectory(out).provenance["file"]["name"] == "theirs.lammpstrj"


def _said(done: Result) -> str:
    """Return what was printed without its lines, which have 80 columns at most."""
    assert max(map(len, done.stdout.splitlines())) <= 80
    return " ".join(done.stdout.split())


def test_compare_says_what_where_and_when(folder: Path) -> None:
    done = _asked("compare", folder / "other.nc", folder / "run.nc")
    assert done.exit_code == 0
    # the difference is far below round-off and the uncertainties of both runs
    assert re.search(r"velocities do not differ by more than 1.3\de-09 of the largest velocity at any of", _said(done))
    exactly = _asked("compare", folder / "other.nc", folder / "run.nc", "--tolerance", "0")
    assert "velocities first differ at 0.000116666667 s, body 2\n" in exactly.stdout
    assert _said(done).startswith("displacements are equal velocities differ by at most ")
    # a difference is a finding, and a failure where it is said to be one
    assert _asked("compare", folder / "other.nc", folder / "run.nc", "--tolerance", "0").exit_code == 1
    within = _asked("compare", folder / "other.nc", folder / "run.nc", "--tolerance", "1e-9")
    assert within.exit_code == 0
    assert "velocities do not differ by more than 1e-09 of the largest velocity at any of 13 samples" in _said(within)


def test_without_a_tolerance_the_exit_code_is_said_to_mean_nothing(folder: Path) -> None:
    done = _asked("compare", folder / "other.nc", folder / "run.nc")
    assert done.exit_code == 0
    assert _said(done).endswith("no --tolerance was given: the exit code is 0 whatever the difference")
    assert "no --tolerance" not in _asked("compare", folder / "other.nc", folder / "run.nc", "--tolerance", "0").stdout


def test_each_file_has_its_own_time_step_and_one_for_both_must_not_contradict_the_scene(folder: Path) -> None:
    """Two dumps of one run without times: 100 and 50 steps a sample, so 1 and 2 of the time step."""
    text = re.sub(r"ITEM: TIME\n.*\n", "", (folder / "theirs.lammpstrj").read_text())
    halved = re.sub(r"(?<=TIMESTEP\n)\d+", lambda found: str(int(found[0]) // 2), text)
    (folder / "fine.dump").write_text(text)
    (folder / "coarse.dump").write_text(halved)
    dt = RAW.duration / 1200
    scene = ("--scene", folder / "raw.toml", "--tolerance", "0")
    fine, coarse = f"{folder / 'fine.dump'}@{dt!r}", f"{folder / 'coarse.dump'}@{2 * dt!r}"
    assert _asked("compare", fine, coarse, *scene).exit_code == 0
    assert _asked("compare", folder / "fine.dump", coarse, "--dt", repr(dt), *scene).exit_code == 0
    done = _asked("compare", folder / "fine.dump", folder / "coarse.dump", "--dt", repr(dt), *scene)
    assert done.exit_code == 2
    assert "was given for both files, which then end at 0.0002 s and 0.0001 s; allowed: the time step of" in done.stderr
    assert "give A@DT and B@DT" in done.stderr


def test_without_velocities_nothing_is_decided(folder: Path) -> None:
    dump = folder / "theirs.lammpstrj"
    dump.write_text(dump.read_text().replace("z vx fx", "z c_1 fx"))
    done = _asked("compare", dump, folder / "run.nc", "--scene", folder / "raw.toml", "--tolerance", "1e-6")
    assert done.exit_code == 4
    assert "note: velocity is not compared, because it is unknown in the first run" in done.stdout


@pytest.mark.parametrize(
    ("words", "found"),
    [
        (("convert", "theirs.lammpstrj", "-o", "x.nc"), "give the scene of this run"),
        (("convert", "run.nc", "-o", "x.csv"), "the scene 'raw', which is not a shipped scene; give the scene"),
        (("convert", "run.nc", "-o", "x.pdb", "--scene", "raw.toml"), "the file type is not clear from"),
        (("convert", "none.nc", "-o", "x.csv", "--scene", "raw.toml"), "no such file"),
        (
            ("convert", "run.nc", "-o", "x.csv", "--scene", "decelerating-40"),
            "the run has 4 bodies and 5 contacts, the scene",
        ),
        (("compare", "run.nc", "theirs.lammpstrj"), "give the scene of this run"),
        (("compare", "run.nc", "run.nc", "--tolerance", "-1"), "tolerance = -1.0; allowed"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(folder: Path, words: tuple[str, ...], found: str) -> None:
    done = _asked(*(folder / word if "." in word else word for word in words))
    assert done.exit_code == 2
    assert done.stderr.count("\n") == 1, done.stderr
    assert found in done.stderr
    assert not (folder / "x.csv").exists()
