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
from tests.bench.history import BUDGETS, LEAST, main, noise, slower, summarize
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


@pytest.fixture
def programs(monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """Run a Python program, given by the name of the benchmark, in place of each benchmark."""
    texts: dict[str, str] = {}
    start = subprocess.Popen

    def popen(words: list[str], **more: Any) -> Any:
        name = words[-1].rpartition(".")[2]
        return start([sys.executable, "-c", texts[name]] if name in texts else words, **more)

    monkeypatch.setattr(subprocess, "Popen", popen)
    return texts


def _recording(name: str, seconds: float, then: str = "") -> str:
    """Return a program that records a piece of work as a benchmark does."""
    line = json.dumps({"name": name, "seconds": [seconds]})
    return f"import os, time\nopen(os.environ[{RECORD!r}], 'a').write({line!r} + '\\n')\n{then}"


def test_a_run_is_kept_as_a_line_and_compared(
    tmp_path: Path, programs: dict[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    kept, names = tmp_path / "bench.jsonl", ["bench_paper"]
    programs["bench_paper"] = _recording("verify paper", 1.0)
    assert main(names, kept) == 0
    assert "nothing is slower than before, of 0 compared" in capsys.readouterr().out
    programs["bench_paper"] = _recording("verify paper", 2.0)
    assert main(names, kept) == 0
    assert "slower: verify paper takes 2 s of CPU, 1 s at" in capsys.readouterr().out
    first, second = (json.loads(line) for line in kept.read_text().splitlines())
    assert first["machine"] == second["machine"]
    assert set(first["machine"]) == {"processor", "cores", "python"}
    assert first["work"] == {"verify paper": {"median": 1.0, "range": 0.0, "rounds": 1}}
    assert set(first["benchmarks"]) == {"bench_paper"}
    with pytest.raises(SystemExit, match="no benchmark is called paper; allowed: bench_backends"):
        main(["paper"], kept)


def test_a_run_is_not_compared_with_one_of_another_machine(
    tmp_path: Path, programs: dict[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    kept = tmp_path / "bench.jsonl"
    history.keep(kept, [_run(1.0, machine=OTHER)])
    programs["bench_paper"] = _recording("paper", 2.0)
    assert main(["bench_paper"], kept) == 0
    assert "nothing is slower than before, of 0 compared" in capsys.readouterr().out
    assert [run["machine"] == OTHER for run in history.read(kept)] == [True, False]


def test_an_interrupted_run_keeps_the_benchmarks_that_have_ended(
    tmp_path: Path, programs: dict[str, str], page: ModuleType
) -> None:
    kept = tmp_path / "bench.jsonl"
    history.keep(kept, [_run(1.0)])
    programs |= {"bench_paper": _recording("verify paper", 1.0), "bench_bars": _recording("bars", 1.0)}
    run = history.measure(["bench_paper", "bench_bars"])
    history.keep(kept, [*history.read(kept), next(run)])
    run.close()
    earlier, interrupted = history.read(kept)
    assert earlier == _run(1.0)
    assert list(interrupted["benchmarks"]) == ["bench_paper"]
    assert list(interrupted["work"]) == ["verify paper"]
    assert "1 benchmarks in" in page.page_part([earlier, interrupted])


@pytest.mark.parametrize(
    ("then", "outcome"),
    [("raise SystemExit(2)", "failed"), ("time.sleep(60)", "stopped"), ("raise SystemExit(1)", "missed")],
)
def test_a_benchmark_that_does_not_end_keeps_its_work(
    then: str, outcome: str, tmp_path: Path, programs: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    if outcome == "stopped":
        monkeypatch.setitem(history.BUDGETS, "bench_paper", 0.3)
    programs |= {"bench_paper": _recording("verify paper", 1.0, then), "bench_bars": _recording("bars", 1.0)}
    assert main(["bench_paper", "bench_bars"], tmp_path / "bench.jsonl") == (outcome != "missed")
    (run,) = history.read(tmp_path / "bench.jsonl")
    assert {name: part["targets"] for name, part in run["benchmarks"].items()} == {
        "bench_paper": outcome, "bench_bars": "met"
    }  # fmt: skip
    assert list(run["work"]) == ["verify paper", "bars"]


def test_the_budgets_of_all_benchmarks_are_a_quarter_of_an_hour() -> None:
    assert sum(history.BUDGETS.values()) <= 900.0


def test_every_kept_run_is_whole() -> None:
    for run in history.read(history.KEPT):
        assert set(run) == {"time", "commit", "machine", "benchmarks", "work"}
        assert set(run["benchmarks"]) <= set(BUDGETS)
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
    assert "1 benchmarks in 2 s (2 s of CPU).</p>" in page.page_part([_run(1.0)]).replace("1.5", "2")
    stopped = _run(1.0, benchmarks={"b": {"wall": 2.0, "cpu": 2.0, "targets": "stopped"}})
    assert "1 benchmarks in 2 s (2 s of CPU). Not measured to their end: b.</p>" in page.page_part([stopped])


def test_one_run_makes_a_picture(page: ModuleType) -> None:
    drawing = ElementTree.fromstring(page.picture([_run(1.0)]))
    assert len(list(drawing.iter("circle"))) == 1
    assert not [path for path in drawing.iter("path") if path.attrib.get("class") == "machine"]
