"""The history of the benchmarks: what a run keeps, what counts as slower, and the picture of the documentation."""

from __future__ import annotations

import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.etree import ElementTree

import pytest

from tests.bench import history
from tests.bench.history import BENCHMARKS, LEAST, main, noise, slower, summarize
from tests.bench.timing import RECORD, record, wall_seconds

ROOT = Path(__file__).parents[2]
MACHINE = {"processor": "P", "cores": 2, "python": "3.12.1"}
OTHER = MACHINE | {"processor": "Q"}


def _run(median: float, spread: float = 0.0, rounds: int = 5, **more: Any) -> dict[str, Any]:
    part = {"wall": 2.0, "cpu": 1.5, "targets": "met"}
    work = {"work": {"paper": {"median": median, "range": spread, "rounds": rounds}}}
    run = {"time": "2026-11-26T20:00:00+00:00", "commit": "c0aea7d3", "machine": MACHINE, "benchmarks": {"b": part}}
    return run | work | more


@pytest.fixture(scope="module")
def page() -> ModuleType:
    spec = importlib.util.spec_from_file_location("bench_history", ROOT / "docs" / "_ext" / "bench_history.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_rounds_are_recorded_where_a_history_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[int] = []
    monkeypatch.delenv(RECORD, raising=False)
    record("nowhere", [1.0])
    monkeypatch.setenv(RECORD, str(tmp_path / "record.jsonl"))
    wall_seconds(lambda: calls.append(1), 3, "nothing")
    wall_seconds(lambda: calls.append(1), 3)
    record("paper", [2.0])
    record("paper", [4.0])
    lines = (tmp_path / "record.jsonl").read_text().splitlines()
    assert [json.loads(line)["name"] for line in lines] == ["nothing", "paper", "paper"]
    assert len(calls) == 8  # three rounds and one that warms up, twice
    work = summarize(lines)
    assert work["paper"] == {"median": 3.0, "range": 1.0, "rounds": 2}
    assert work["nothing"]["rounds"] == 3
    assert 0.0 <= work["nothing"]["median"] < 0.5


def test_the_cpu_time_of_children_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(RECORD, str(tmp_path / "record.jsonl"))
    work = "import time\nwhile time.process_time() < 0.3: pass"
    wall_seconds(lambda: subprocess.run([sys.executable, "-c", work], check=True), 1, "child")
    assert json.loads((tmp_path / "record.jsonl").read_text())["seconds"][0] > 0.29


def test_slower_is_what_exceeds_the_noise_of_both_runs() -> None:
    # interquartile ranges of 0.0806 s in both: a deviation of 0.0845 s of the difference, and three of it 0.2535 s
    quiet, noisy = _run(1.0), _run(1.0, 0.0806)
    assert noise(noisy["work"]["paper"], noisy["work"]["paper"]) == pytest.approx(0.2535, rel=1e-3)
    assert not list(slower([noisy], _run(1.25, 0.0806)))
    assert list(slower([noisy], _run(1.26, 0.0806))) == [
        "slower: paper takes 1.26 s of CPU, 1 s at c0aea7d3: +26 %, noise 25 %"
    ]
    # the least that counts where rounds have no range
    assert not list(slower([quiet], _run(1.0 + 0.99 * LEAST)))
    assert len(list(slower([quiet], _run(1.0 + 1.01 * LEAST)))) == 1
    assert not list(slower([noisy], _run(0.5)))


def test_runs_are_compared_with_the_last_on_the_same_machine() -> None:
    runs = [_run(1.0), _run(0.1, machine=OTHER), _run(9.0, work={})]
    assert not list(slower(runs, _run(1.0)))
    assert len(list(slower(runs, _run(2.0)))) == 1
    assert not list(slower(runs, _run(2.0, machine=MACHINE | {"python": "3.13.0"})))
    # the last one, not the fastest
    assert not list(slower([_run(1.0), _run(2.0)], _run(2.0)))


def test_a_run_is_kept_as_a_line_and_compared(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    kept, names = tmp_path / "bench.jsonl", ["bench_paper"]
    seconds = iter([1.0, 2.0])
    code = "import os, json; open(os.environ['{}'], 'a').write(json.dumps({}) + '\\n')"
    start = subprocess.run

    def run(words: list[str], **more: Any) -> Any:
        if "-m" not in words:
            return start(words, **more)
        line = {"name": "verify paper", "seconds": [next(seconds)]}
        return start([sys.executable, "-c", code.format(RECORD, line)], **more)

    monkeypatch.setattr(subprocess, "run", run)
    assert main(names, kept) == 0
    assert "nothing is slower than before, of 0 compared" in capsys.readouterr().out
    assert main(names, kept) == 0
    assert "slower: verify paper takes 2 s of CPU, 1 s at" in capsys.readouterr().out
    first, second = (json.loads(line) for line in kept.read_text().splitlines())
    assert first["machine"] == second["machine"]
    assert set(first["machine"]) == {"processor", "cores", "python"}
    assert first["work"] == {"verify paper": {"median": 1.0, "range": 0.0, "rounds": 1}}
    assert set(first["benchmarks"]) == {"bench_paper"}
    with pytest.raises(SystemExit, match="no benchmark is called paper; allowed: bench_backends"):
        main(["paper"], kept)


def test_a_benchmark_that_fails_keeps_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    start = subprocess.run

    def run(words: list[str], **more: Any) -> Any:
        return start([sys.executable, "-c", "raise SystemExit(2)"] if "-m" in words else words, **more)

    monkeypatch.setattr(subprocess, "run", run)
    with pytest.raises(SystemExit, match="bench_paper ended with code 2; nothing of this run is kept"):
        main(["bench_paper"], tmp_path / "bench.jsonl")
    assert not (tmp_path / "bench.jsonl").exists()


def test_every_kept_run_is_whole() -> None:
    for run in history.read(history.KEPT):
        assert set(run) == {"time", "commit", "machine", "benchmarks", "work"}
        assert set(run["benchmarks"]) <= set(BENCHMARKS)
        for part in run["work"].values():
            assert part["median"] > 0.0
            assert part["range"] >= 0.0
            assert part["rounds"] >= 1


def test_the_picture_has_a_point_for_each_run_and_marks_other_machines(page: ModuleType) -> None:
    runs = [_run(1.0), _run(2.0, 0.2), _run(0.5, machine=OTHER), _run(4.0, 0.4)]
    drawing = ElementTree.fromstring(page.picture(runs))
    points = [float(point.attrib["cy"]) for point in drawing.iter("circle")]
    marks = [path.attrib["d"] for path in drawing.iter("path") if path.attrib.get("class") == "machine"]
    assert len(points) == 4
    assert len(marks) == 2
    # heights from a common zero at the bottom of the panel
    bottom = 110.0
    assert [(bottom - y) / (bottom - points[0]) for y in points] == pytest.approx([1.0, 2.0, 0.5, 4.0], rel=0.02)
    places = [float(point.attrib["cx"]) for point in drawing.iter("circle")]
    assert [float(re.findall(r"M([\d.]+)", mark)[0]) for mark in marks] == pytest.approx(
        [(places[1] + places[2]) / 2, (places[2] + places[3]) / 2], abs=0.2
    )


def test_the_table_compares_within_one_machine(page: ModuleType) -> None:
    text = page.page_part([_run(1.0), _run(9.0, machine=OTHER), _run(2.0, 0.25)])
    assert "<td>paper</td><td>2</td><td>0.25</td><td>5</td><td>1</td>" in text
    assert "<td>none</td>" in page.page_part([_run(1.0), _run(2.0, machine=OTHER)])
    assert page.page_part([]) == "<p>No run of the benchmarks is kept yet.</p>"
    assert "1 benchmarks in 2 s (2 s of CPU)" in page.page_part([_run(1.0)]).replace("1.5", "2")
