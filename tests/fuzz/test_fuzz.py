"""Changed files of every kind end in a result or in an error of one line, within limits of time, memory and folders."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.fuzz.child import outcome
from tests.fuzz.harness import FAULTS, fuzz
from tests.fuzz.report import PAGE
from tests.fuzz.targets import TARGETS, Target

#: changed files of each reader in the suite for every commit, and in the whole one
FEW, MANY = 25, 20_000


def test_no_changed_file_causes_a_fault() -> None:
    assert [f"{name} {fault}" for name, figures in fuzz(FEW).items() for fault in figures.faults] == []


@pytest.mark.slow
@pytest.mark.parametrize("name", TARGETS)
def test_no_file_of_thousands_causes_a_fault(name: str) -> None:
    assert fuzz(MANY, names=[name])[name].faults == []


@pytest.mark.parametrize("name", TARGETS)
def test_the_files_are_valid_before_they_are_changed(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    target = TARGETS[name]
    for nth, source in enumerate(target.sources()):
        folder = tmp_path / str(nth)
        folder.mkdir()
        target.prepare(folder)
        (folder / target.name).write_bytes(target.finish(source))
        assert outcome(target, folder / target.name) == ("accepted", ""), nth


def test_the_harness_notices_each_fault(tmp_path: Path) -> None:
    def fails(error: BaseException) -> Target:
        def read(_path: Path) -> None:
            raise error

        return Target(list, "x", read)

    from dem_bridge.errors import UsageError

    long = UsageError("x")
    long.args = ("two\nlines",)
    words = [
        outcome(fails(error), tmp_path / "x")[0] for error in (KeyError("x"), MemoryError(), long, UsageError("x"))
    ]
    assert words == ["traceback", "over memory", "message", "refused"]
    assert set(words[:3]) <= set(FAULTS)


def test_the_page_has_a_row_for_each_reader() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert [name for name in TARGETS if f"\n| {name} |" not in text] == []
