"""A bundle is whole, says what it is, loses nothing of others, and a replay sees what changed."""

from __future__ import annotations

import csv
import hashlib
import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from importlib.metadata import distributions
from pathlib import Path
from typing import Any

import pytest

import dem_bridge
from dem_bridge.api.verification import verify, write_found
from dem_bridge.backends.base import Sampling
from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.scene.file import parse_scene
from dem_bridge.scene.scene import Scene
from dem_bridge.verification import replay
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.bundle import bundle_files, check_bundle, pinned, write_bundle
from dem_bridge.verification.roles import assign_roles
from dem_bridge.verification.verification import Verification
from tests.helpers.fake_paper import NOTHING, fake_paper

SMALL = Scene(
    name="small",
    description="three bodies",
    duration=1.0e-4,
    mass=(8.1e-3, 1e-2, 1e-2),
    stiffness=(4e9, 5e9),
    velocity=(0.8, 0.0, 0.0),
    samples=10,
)


@pytest.fixture(scope="module")
def found() -> Verification:
    return verify(SMALL, accuracy=1e-3, jobs=1)


def _rows(text: str | bytes) -> list[dict[str, str]]:
    assert isinstance(text, str)
    return list(csv.DictReader(text.splitlines()))


@pytest.mark.lammps
def test_a_bundle_has_everything_a_run_was_made_of_and_found(found: Verification, tmp_path: Path) -> None:
    write_found(found, bundle=tmp_path / "bundle")
    folder = tmp_path / "bundle"
    files = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert {"README.md", "replay.sh", "replay.py", "requirements.txt", "report/index.html"} <= files
    assert {"decks/small/in.small", "decks/small/data.small", "scenes/small.toml", "csv/verdicts.csv"} <= files
    assert "source/dem_bridge/report/templates/study.html.j2" in files
    [known] = distributions(name="dem-bridge", path=[str(folder / "source")])
    assert known.version == dem_bridge.__version__
    subprocess.run(["sha256sum", "--check", "--quiet", "SHA256SUMS"], cwd=folder, check=True)
    assert len((folder / "SHA256SUMS").read_text().splitlines()) == len(files) - 1
    scene = parse_scene((folder / "scenes/small.toml").read_text(encoding="utf-8"))
    assert scene.content_hash == SMALL.content_hash


@pytest.mark.slow
@pytest.mark.lammps
def test_the_decks_are_those_that_were_run(found: Verification) -> None:
    files = bundle_files(found, report={})
    decks = {name.removeprefix("decks/small/"): text for name, text in files.items() if name.startswith("decks/")}
    text = "\0".join(str(part) for file in sorted(decks.items()) for part in file)
    [study] = found.studies
    run = study.run("lammps-granular")
    assert run is not None
    assert hashlib.sha256(text.encode()).hexdigest() == run.provenance["deck_hash"]


@pytest.mark.lammps
def test_a_deck_that_is_not_the_one_that_was_run_is_no_part_of_a_bundle(found: Verification) -> None:
    [study] = found.studies
    assert study.runs is not None
    engine = replace(study.runs.engine, case=replace(study.runs.engine.case, sampling=Sampling(count=5)))
    runs = replace(study.runs, engine=engine)
    with pytest.raises(RunBroken, match="the deck of small differs from the deck that was run"):
        bundle_files(replace(found, studies=(replace(study, runs=runs),)), report={})


@pytest.mark.slow
@pytest.mark.lammps
def test_verdicts_and_contacts_lie_there_as_csv_in_full_precision(found: Verification) -> None:
    files = bundle_files(fake_paper(found), report={})
    rows = _rows(files["csv/verdicts.csv"])
    assert [row["outcome"] for row in rows] == [verdict.outcome.value for verdict in found.verdicts]
    assert float(rows[0]["difference"]) == found.verdicts[0].difference
    assert {row["tolerance"] for row in rows if row["outcome"] == "MODEL_DIFFERENCE"} == {""}
    contacts = [row for row in _rows(files["csv/contacts-small.csv"]) if row["backend"] == "reference"]
    truth = found.studies[0].run("reference")
    assert truth is not None
    assert [float(row["peak_force (N)"]) for row in contacts] == truth.peak_force.tolist()
    assert [float(row["crossing_time (s)"]) for row in contacts] == truth.crossing_time.tolist()
    claims = _rows(files["csv/claims.csv"])
    assert len(claims) == sum(len(claim.values) for claim in fake_paper().claims)


def test_pins_are_all_that_is_needed_and_exact() -> None:
    pins = pinned("dem-bridge")
    assert {"lammps", "mpich", "numpy", "numba", "llvmlite", "MarkupSafe"} <= set(pins)
    assert not {"pytest", "ruff", "dem-bridge"} & set(pins)  # of extras, and itself
    lines = bundle_files(NOTHING, report={})["requirements.txt"]
    assert isinstance(lines, str)
    assert all(re.fullmatch(r"[\w.-]+==[\w.+!]+", line) for line in lines.splitlines())


def test_what_is_not_installed_has_no_pin() -> None:
    with pytest.raises(UsageError, match="no-such-thing is not installed, so the bundle cannot state its version"):
        pinned("no-such-thing")


def test_a_folder_with_other_things_is_refused_and_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    for refuse in (lambda: check_bundle(tmp_path), lambda: write_bundle(NOTHING, tmp_path, report={})):
        with pytest.raises(
            UsageError, match="contains files that are not a bundle; allowed: a new or empty folder"
        ) as error:
            refuse()
        assert "\n" not in str(error.value)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
    with pytest.raises(UsageError, match="not a bundle"):
        check_bundle(tmp_path / "thesis.tex")
    (tmp_path / "bundle.json").write_text('{"schema": "another program\'s"}')
    (tmp_path / "SHA256SUMS").write_text("0  thesis.tex\n")
    with pytest.raises(UsageError, match="not a bundle"):
        check_bundle(tmp_path)


def test_a_refused_folder_is_found_before_anything_is_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    monkeypatch.setattr("dem_bridge.verification.verify.verify_scenes", lambda *_, **__: pytest.fail("it was run"))
    with pytest.raises(UsageError, match="not a bundle"):
        verify(SMALL, bundle=tmp_path)


def test_a_bundle_is_written_again_and_keeps_what_others_put_there(tmp_path: Path) -> None:
    write_bundle(NOTHING, tmp_path, report={"index.html": "one", "figures/old.csv": "1"})
    (tmp_path / "notes.txt").write_text("of the reviewer")
    write_bundle(NOTHING, tmp_path, report={"index.html": "two"})
    assert (tmp_path / "report/index.html").read_text() == "two"
    assert (tmp_path / "notes.txt").exists()
    assert not (tmp_path / "report/figures/old.csv").exists()
    assert "old.csv" not in (tmp_path / "SHA256SUMS").read_text()


def test_a_list_of_files_that_points_elsewhere_deletes_nothing_there(tmp_path: Path) -> None:
    folder = tmp_path / "bundle"
    write_bundle(NOTHING, folder, report={})
    (tmp_path / "thesis.tex").write_text("years of work")
    with (folder / "SHA256SUMS").open("a") as file:
        file.write(f"0  ../thesis.tex\n0  {tmp_path / 'thesis.tex'}\n")
    write_bundle(NOTHING, folder, report={})
    assert (tmp_path / "thesis.tex").exists()


def test_scenes_whose_laws_are_functions_are_named_in_one_line(tmp_path: Path) -> None:
    glued = replace(SMALL, name="glued", law=lambda overlap: 4e9 * overlap**1.5)
    studies = tuple(SceneStudy(roles=assign_roles(one), verdicts=()) for one in (SMALL, glued))
    files = bundle_files(replace(NOTHING, studies=studies), report={})
    readme, told = str(files["README.md"]), json.loads(files["bundle.json"])
    assert [
        line
        for line in readme.splitlines()
        if line.startswith("These scenes are not repeated") and line.endswith(": glued.")
    ]
    assert told["not_replayed"] == ["glued"]
    assert told["verify"] == ["scenes/small.toml", "--accuracy", "0.001"]


@pytest.mark.slow
def test_what_was_asked_for_the_paper_is_replayed_as_such() -> None:
    files = bundle_files(fake_paper(), report={})
    assert json.loads(files["bundle.json"])["verify"] == ["paper", "--accuracy", "0.001"]


def test_the_replay_is_told_how_lammps_was_run_and_no_path_of_this_machine() -> None:
    engine = Engine(ranks=2, lmp_args=("-sf", "omp"), python=Path(sys.executable))
    files = bundle_files(NOTHING, report={}, engine=engine, words=("one",))
    assert json.loads(files["bundle.json"])["verify"] == [
        "one", "--accuracy", "0.001", "--ranks", "2", "--lmp-args=-sf omp"
    ]  # fmt: skip
    assert "sh replay.sh --lmp PATH" in str(files["README.md"])
    assert str(sys.executable) not in "".join(str(files[name]) for name in ("README.md", "bundle.json", "replay.sh"))


@pytest.mark.lammps
@pytest.mark.slow
def test_a_replay_says_same_and_after_a_scene_was_touched_changed(found: Verification, tmp_path: Path) -> None:
    folder = tmp_path / "bundle"
    write_bundle(found, folder, report=found.page_files())
    # the same bytes, with what was compiled of them before: that takes a minute
    shutil.rmtree(folder / "source" / "dem_bridge")
    (folder / "source" / "dem_bridge").symlink_to(Path(dem_bridge.__file__).parent)
    done = _replayed(folder)
    assert done.returncode == 0, done.stdout + done.stderr
    count = len(found.verdicts) + 1
    assert f"{count} SAME, 0 CHANGED, 0 NOT REPLAYED" in done.stdout
    scene = folder / "scenes/small.toml"
    scene.write_text(scene.read_text(encoding="utf-8").replace("0.0081", "0.0082"), encoding="utf-8")
    done = _replayed(folder)
    assert done.returncode == 1
    assert "CHANGED       scenes/small.toml differs from the file of the bundle" in done.stdout
    assert re.search(r"CHANGED +small: hashes of the scene and of its 5 decks", done.stdout)
    assert re.search(r"CHANGED +small: peak_force of bca against reference: MODEL_DIFFERENCE", done.stdout)
    scene.unlink()
    done = _replayed(folder)
    assert done.returncode == 2
    assert "wrote no verdicts" in done.stderr


def _replayed(folder: Path) -> subprocess.CompletedProcess[str]:
    words = [sys.executable, "replay.py", "-j", "1"]
    return subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=300)


def _record(**changes: Any) -> dict[str, Any]:
    verdict = {
        "scene": "small", "quantity": "velocity", "backend": "verlet", "reference": "reference",
        "outcome": "PASS", "difference": 1e-6, "tolerance": 5e-6, "scale": 0.8,
    }  # fmt: skip
    run = {"scene": "small", "scene_hash": "a", "deck_hash": "d"}
    value = {"name": "time", "backend": "bca", "value": 2.0, "uncertainty": None}
    claim = {"id": "C1", "outcome": "PASS", "values": [value]}
    for one in (verdict, run, value, claim):
        one.update({key: new for key, new in changes.items() if key in one})
    return {"verdicts": [verdict], "claims": [claim], "provenance": {"runs": [run]}}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, ["SAME", "SAME", "SAME"]),
        ({"difference": 2.6e-6}, ["SAME", "SAME", "SAME"]),  # within a third of the tolerance
        ({"difference": 2.7e-6}, ["CHANGED", "SAME", "SAME"]),
        ({"difference": None}, ["CHANGED", "SAME", "SAME"]),
        ({"scale": 0.80001}, ["CHANGED", "SAME", "SAME"]),
        ({"scene_hash": "b"}, ["SAME", "CHANGED", "SAME"]),
        ({"deck_hash": "e"}, ["SAME", "CHANGED", "SAME"]),
        ({"value": 2.0001}, ["SAME", "SAME", "CHANGED"]),
        ({"outcome": "FAIL"}, ["CHANGED", "SAME", "CHANGED"]),
        ({"quantity": "energy"}, ["CHANGED", "CHANGED", "SAME", "SAME"]),  # one is gone, one is new
        ({"id": "C2"}, ["SAME", "SAME", "CHANGED"]),
    ],
    ids=str,
)
def test_what_moved_is_changed(changes: dict[str, Any], words: list[str]) -> None:
    assert [word for word, _ in replay.compared(_record(), _record(**changes), [])] == words


def test_without_a_tolerance_a_millionth_counts() -> None:
    old, new = _record(tolerance=None), _record(tolerance=None, difference=1.00001e-6)
    assert next(replay.compared(old, new, []))[0] == "CHANGED"
    assert next(replay.compared(old, old, []))[0] == "SAME"


def test_what_was_not_run_again_is_said_and_is_no_pass() -> None:
    nothing: dict[str, Any] = {"verdicts": [], "claims": [], "provenance": {"runs": []}}
    assert [word for word, _ in replay.compared(_record(), nothing, ["small"])] == ["NOT REPLAYED", "NOT REPLAYED"]
    assert [word for word, _ in replay.compared(_record(), nothing, [])] == ["CHANGED", "CHANGED", "NOT REPLAYED"]


def test_the_program_of_a_bundle_needs_nothing_but_python() -> None:
    code = "import sys; sys.path[:] = [p for p in sys.path if 'site-packages' not in p]; import runpy\n"
    code += f"runpy.run_path({str(Path(replay.__file__))!r})"
    subprocess.run([sys.executable, "-I", "-S", "-c", code], check=True)


@pytest.mark.parametrize(
    "content",
    ["", "[]", "{}", "[" * 100_000, "1" * 5000, '{"verdicts": 3}', '{"verdicts": [1], "claims": [], "provenance": {}}'],
    ids=["empty", "list", "no keys", "deep", "digits", "number", "rows"],
)
def test_a_reshaped_report_is_one_line_and_no_traceback(content: str, tmp_path: Path) -> None:
    (tmp_path / "bundle.json").write_text('{"verify": [], "not_replayed": []}')
    (tmp_path / "report").mkdir()
    (tmp_path / "report" / "verdicts.json").write_text(content)
    with pytest.raises(ValueError, match=r"^verdicts\.json"):
        replay.repeat(tmp_path, [])
    with pytest.raises(ValueError, match="has another form"):
        list(replay.compared([], {"verdicts": 3}, []))  # type: ignore[arg-type]


def test_checksums_of_files_outside_of_a_bundle_are_not_read(tmp_path: Path) -> None:
    (tmp_path / "outside").write_text("x")
    (tmp_path / "in").mkdir()
    digest = hashlib.sha256(b"x").hexdigest()
    (tmp_path / "in" / "SHA256SUMS").write_text(f"{digest}  ../outside\n{digest}  {tmp_path}/outside\nno sum\n")
    assert replay.altered(tmp_path / "in") == ["../outside", f"{tmp_path}/outside", ""]
