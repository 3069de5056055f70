"""The store from outside: its entries, their checksums, why one is not used again, and what is removed."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.cli import main
from dem_bridge.errors import UsageError
from dem_bridge.runs import inspect, keys
from dem_bridge.runs.case import Case
from dem_bridge.runs.code import code_of_run
from dem_bridge.runs.store import DAMAGED, SUFFIX, VARIABLE, Store
from dem_bridge.scene.scene import Scene

PAIR = Scene(name="pair", duration=1e-4, mass=(8.1e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))


@pytest.fixture
def kept(tmp_path: Path) -> Store:
    """A store with two runs of a pair, at two time steps."""
    folder = Store(tmp_path / "store")
    for dt in (1e-7, 5e-8):
        case = Case(
            scene=PAIR, backend="verlet", resolution=Resolution(dt=dt), sampling=Sampling(count=10), uncertainty=False
        )
        assert case.key is not None
        folder.save(case.key, case.solve())
    return folder


def test_entries_are_listed_with_what_they_are(kept: Store) -> None:
    entries = list(inspect.entries(kept))
    assert {entry.what for entry in entries} == {"pair by verlet dt=1e-07", "pair by verlet dt=5e-08"}
    assert all(entry.size == (kept.folder / f"{entry.key}{SUFFIX}").stat().st_size for entry in entries)


def test_what_is_no_entry_is_neither_opened_nor_printed(kept: Store) -> None:
    before = list(inspect.entries(kept))
    os.mkfifo(kept.folder / f"pipe{SUFFIX}")
    (kept.folder / f"circle{SUFFIX}").symlink_to(f"circle{SUFFIX}")
    (kept.folder / f"folder{SUFFIX}").mkdir()
    (kept.folder / f"\x1b[2J{SUFFIX}").write_text("x")
    assert list(inspect.entries(kept)) == before
    assert inspect.check(kept) == (2, [])
    (kept.folder / f"{before[0].key}{SUFFIX}").unlink()
    os.mkfifo(kept.folder / f"{before[0].key}{SUFFIX}")
    assert kept.load(before[0].key, PAIR) is None
    line = {"made": "\x1b[2J", "provenance": {"scene": "\x1b]0;x\x07", "backend": "\u202e"}}
    (kept.folder / f"text{SUFFIX}").write_text(f"dem-bridge/store/1\n{json.dumps(line)}\n")
    shown = [entry for entry in inspect.entries(kept) if entry.key == "text"]
    assert [(entry.made + entry.what + entry.scene).isprintable() for entry in shown] == [True]


def test_an_entry_is_used_again_until_something_changes(kept: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    assert [text for _, text in inspect.why(kept, PAIR)] == ["used again"] * 2
    heavier = replace(PAIR, mass=(8.1e-3, 2e-2))
    assert {text for _, text in inspect.why(kept, heavier)} == {"not used again: the scene changed"}
    monkeypatch.setattr(keys, "planned_fingerprint", lambda: "another")
    assert {text for _, text in inspect.why(kept, PAIR)} == {"not used again: the last digits of the machine changed"}


def test_changed_code_is_named_by_its_file(kept: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    before = dict(code_of_run("verlet", uncertainty=False))
    monkeypatch.setattr(keys, "code_of_run", lambda *_, **__: {**before, "backends/twin.py": "another"})
    texts = {text for _, text in inspect.why(kept, PAIR)}
    assert texts == {"not used again: the code (backends/twin.py) changed"}


def test_a_damaged_entry_is_set_aside(kept: Store) -> None:
    first, second = sorted(kept.folder.glob(f"*{SUFFIX}"))
    whole = bytearray(first.read_bytes())
    whole[-5] ^= 1
    first.write_bytes(whole)
    count, damaged = inspect.check(kept)
    assert (count, len(damaged)) == (2, 1)
    assert first.with_suffix(DAMAGED).exists()
    assert [entry.key for entry in inspect.entries(kept)] == [second.stem]
    assert inspect.check(kept) == (1, [])


def test_reading_a_damaged_entry_sets_it_aside(kept: Store) -> None:
    path = sorted(kept.folder.glob(f"*{SUFFIX}"))[0]
    path.write_bytes(b"nothing of ours")
    assert kept.load(path.stem, PAIR) is None
    assert path.with_suffix(DAMAGED).exists()
    assert "is set aside" in kept.trouble


def test_old_entries_and_those_beyond_a_size_are_removed(kept: Store) -> None:
    old, new = sorted(kept.folder.glob(f"*{SUFFIX}"))
    os.utime(old, (1e9, 1e9))
    (kept.folder / f"x{DAMAGED}").write_bytes(b"")
    assert inspect.prune(kept, days=1.0)[0] == 1
    assert [entry.key for entry in inspect.entries(kept)] == [new.stem]
    assert not list(kept.folder.glob(f"*{DAMAGED}"))
    assert inspect.prune(kept, megabytes=0.0)[0] == 1
    with pytest.raises(UsageError, match="prune needs a limit"):
        inspect.prune(kept)


def test_the_commands_show_a_store(kept: Store, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(VARIABLE, str(kept.folder))
    runner = CliRunner()
    listed = runner.invoke(main, ["store", "list"])
    assert listed.output.splitlines()[-1].startswith("2 entries")
    assert len(json.loads(runner.invoke(main, ["store", "list", "pair", "--json"]).output)) == 2
    assert json.loads(runner.invoke(main, ["store", "list", "other", "--json"]).output) == []
    from dem_bridge.scene.file.write import scene_toml

    file = tmp_path / "pair.toml"
    file.write_text(scene_toml(PAIR), encoding="utf-8")
    answers = json.loads(runner.invoke(main, ["store", "why", str(file), "--json"]).output)
    assert [answer["why"] for answer in answers] == ["used again"] * 2
    assert runner.invoke(main, ["store", "verify"]).exit_code == 0
    next(kept.folder.glob(f"*{SUFFIX}")).write_bytes(b"")
    assert runner.invoke(main, ["store", "verify"]).exit_code == 1
    assert "1 entries removed" in runner.invoke(main, ["store", "prune", "--megabytes", "0"]).output
    assert runner.invoke(main, ["store", "prune"]).exit_code == 2
    monkeypatch.setenv(VARIABLE, "")
    assert "is empty" in runner.invoke(main, ["store", "list"]).output


@pytest.mark.parametrize("limit", [{"days": -1.0}, {"megabytes": -1.0}, {"days": float("nan")}])
def test_a_limit_below_zero_is_refused(limit: dict[str, float], kept: Store) -> None:
    [(name, value)] = limit.items()
    with pytest.raises(UsageError, match=f"{name} = {value!r}; allowed: a number >= 0"):
        inspect.prune(kept, **limit)


def test_a_case_whose_samples_take_too_much_memory_is_refused() -> None:
    scene = Scene(name="row", duration=1.0, mass=(1.0,) * 20, stiffness=(1e9,) * 19, velocity=(1.0, *[0.0] * 19))
    with pytest.raises(UsageError, match=r"row: 10000000 samples of 20 bodies take 4\.4 GiB; allowed: 4 GiB; give few"):
        Case(scene=scene, backend="verlet", resolution=Resolution(), sampling=Sampling(count=10**7))


def test_arrays_of_objects_are_not_kept(kept: Store) -> None:
    with pytest.raises(TypeError, match="arrays of objects cannot be kept in the store"):
        kept.save_arrays("0" * 64, {"x": np.array([None])})
