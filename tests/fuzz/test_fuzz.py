"""Changed files of every kind end in a result or in an error of one line, within limits of time, memory and folders."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from dem_bridge.errors import UsageError
from dem_bridge.formats.readers import read
from tests.fuzz import harness
from tests.fuzz.child import outcome
from tests.fuzz.harness import FAULTS, NAMES, fuzz
from tests.fuzz.mutate import VALUES, changed, of_json
from tests.fuzz.planted import FAULTY, PLANTED
from tests.fuzz.report import PAGE
from tests.fuzz.strategies import DRAWN
from tests.fuzz.targets import TARGETS, Target

#: files of each reader in the suite for every commit, and in the whole one; a quarter as many that are drawn
FEW, MANY = 200, 20_000


def test_no_changed_file_causes_a_fault() -> None:
    figures = fuzz(FEW)
    assert [f"{name} {fault}" for name, of_reader in figures.items() for fault in of_reader.faults] == []
    assert [of_reader.inputs for of_reader in figures.values()] == [FEW] * len(TARGETS) + [FEW // 4] * len(DRAWN)
    assert [name for name in TARGETS if not figures[name].counts.get("accepted")] == []


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_no_file_of_thousands_causes_a_fault(name: str) -> None:
    assert fuzz(MANY, names=[name])[name].faults == []


@pytest.mark.parametrize("name", TARGETS)
def test_the_files_are_valid_before_they_are_changed(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    target = TARGETS[name]
    for nth, content in enumerate(target.sources()):
        folder = tmp_path / str(nth)
        folder.mkdir()
        target.prepare(folder)
        (folder / target.name).write_bytes(target.finish(content))
        assert outcome(target, folder / target.name) == ("accepted", ""), nth


@pytest.mark.slow
def test_each_planted_fault_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(harness, "SILENCE", 5.0)
    found = {name: figures.counts for name, figures in fuzz(1, names=PLANTED).items()}
    assert found == {name: {due: 1} for name, (_, due) in PLANTED.items()}
    assert {due for _, due in PLANTED.values()} == set(FAULTS)


def test_a_guard_hides_an_error_from_users_and_not_from_the_fuzzing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = FAULTY["raises KeyError in a guard"]
    assert outcome(target, tmp_path / "x")[0] == "refused"
    monkeypatch.setattr(read, "OF_DAMAGED_DATA", ())
    assert outcome(target, tmp_path / "x")[0] == "traceback"


def test_the_harness_notices_each_fault(tmp_path: Path) -> None:
    def fails(error: BaseException) -> Target:
        def read(_path: Path) -> None:
            raise error

        return Target(list, "x", read)

    long = UsageError("x")
    long.args = ("two\nlines",)
    words = [
        outcome(fails(error), tmp_path / "x")[0] for error in (KeyError("x"), MemoryError(), long, UsageError("x"))
    ]
    assert words == ["traceback", "over memory", "message", "refused"]
    assert set(words[:3]) <= set(FAULTS)


def test_a_document_is_changed_as_its_seed_alone_says() -> None:
    data = json.dumps({"a": [1, {"b": [2, 3]}], "c": {"d": "e"}}).encode()
    before = repr(VALUES)
    first = [changed(str(seed), [data], structure=of_json) for seed in range(3000)]
    assert repr(VALUES) == before
    assert first == [changed(str(seed), [data], structure=of_json) for seed in range(3000)]


def test_the_page_has_a_row_for_each_reader() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert [name for name in NAMES if f"\n| {name} |" not in text] == []
