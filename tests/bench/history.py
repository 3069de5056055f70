"""Run all benchmarks, keep their medians, and say what has become slower since the last run on this machine.

``make bench``. A line of ``docs/bench.jsonl`` is one run: time, commit, machine, the CPU time of each benchmark, and
for each piece of work the median CPU time of its rounds, their interquartile range and their number. The file is in the
tree, so that a run belongs to a commit, travels with every clone and is there when the documentation is built
(:doc:`docs/performance.md`). CPU time is kept, because wall time is also that of other programs on the machine.
The line is written anew whenever a benchmark ends, so that an interrupted run keeps the benchmarks before. A benchmark
that takes longer than its budget is stopped, and the run keeps the work that it has measured by then.

Runs are compared within one machine only: the same processor, number of cores and version of Python.
"""

from __future__ import annotations

import contextlib
import json
import os
import platform
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from tests.bench.timing import RECORD, cpu_seconds, spread

ROOT = Path(__file__).parents[2]
KEPT = ROOT / "docs" / "bench.jsonl"
#: wall time that each benchmark may take, s, in the order in which they run: those that record medians are first
BUDGETS = {
    "bench_backends": 90, "bench_ensembles": 45, "bench_lammps": 175, "bench_paper": 150, "bench_studies": 60,
    "bench_bars": 60, "bench_integrators": 50, "bench_horizon": 45, "bench_plan": 75, "bench_scale": 90,
    "bench_campaign": 60,
}  # fmt: skip
#: standard deviations by which a median must exceed the last one to be slower
DEVIATIONS = 3.0
#: and part of it: what the order of code in memory changes from one build to the next
LEAST = 0.03
#: interquartile range of a normal distribution, in standard deviations
_INTERQUARTILE = 1.349


def machine() -> dict[str, Any]:
    """Return what tells one machine from another: processor, cores and Python."""
    name = platform.processor() or platform.machine()
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines() if os.path.exists("/proc/cpuinfo") else []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return {"processor": models[0] if models else name, "cores": os.cpu_count(), "python": platform.python_version()}


def commit() -> str:
    """Return the short hash of the commit, with a + where the tree differs from it; "" without git."""
    words = ["git", "describe", "--always", "--abbrev=8", "--dirty=+", "--exclude=*"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True)
    return done.stdout.strip()


def summarize(lines: Sequence[str]) -> dict[str, dict[str, float]]:
    """Return median, interquartile range (s of CPU) and rounds of each piece of work that was recorded."""
    work: dict[str, list[float]] = {}
    for line in lines:
        entry = json.loads(line)
        work.setdefault(entry["name"], []).extend(entry["seconds"])
    return {
        name: {"median": float(f"{statistics.median(rounds):.4g}"), "range": float(f"{spread(rounds):.2g}")}
        | {"rounds": len(rounds)}
        for name, rounds in work.items()
    }


def last_of(runs: Sequence[Mapping[str, Any]], of_machine: Mapping[str, Any], name: str) -> Mapping[str, Any] | None:
    """Return the last run on this machine that has measured a piece of work; None: there is none."""
    return next((run for run in reversed(runs) if run["machine"] == of_machine and name in run["work"]), None)


def noise(first: Mapping[str, float], second: Mapping[str, float]) -> float:
    """Return the difference of two medians that their rounds explain, s."""
    deviation = (first["range"] ** 2 + second["range"] ** 2) ** 0.5 / _INTERQUARTILE
    return float(max(DEVIATIONS * deviation, LEAST * first["median"]))


def slower(runs: Sequence[Mapping[str, Any]], run: Mapping[str, Any]) -> Iterator[str]:
    """Yield a line for each piece of work of a run that takes longer than in the last one, by more than the noise."""
    for name, now in run["work"].items():
        last = last_of(runs, run["machine"], name)
        if last is None:
            continue
        before = last["work"][name]
        allowed, more = noise(before, now), now["median"] - before["median"]
        if more > allowed:
            share, of_noise = 100.0 * more / before["median"], 100.0 * allowed / before["median"]
            yield (
                f"slower: {name} takes {now['median']:.3g} s of CPU, {before['median']:.3g} s at {last['commit']}:"
                f" {share:+.0f} %, noise {of_noise:.0f} %"
            )


def read(path: Path) -> list[dict[str, Any]]:
    """Return the runs that are kept, oldest first."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return [json.loads(line) for line in lines]


def keep(path: Path, runs: Sequence[Mapping[str, Any]]) -> None:
    """Write the runs, oldest first; a process that is killed meanwhile leaves the file as it was."""
    new = path.with_suffix(".new")
    new.write_text("".join(json.dumps(run) + "\n" for run in runs), encoding="utf-8")
    new.replace(path)


def call(name: str, record: Path, budget: float) -> str:
    """Run one benchmark in a process group of its own, which ends with it, and return its outcome.

    "met" or "missed" says whether the targets of the benchmark are; "stopped": it has used up its budget of wall time
    (s); "failed": it ended with an error.
    """
    words = [sys.executable, "-m", f"tests.bench.{name}"]
    with subprocess.Popen(words, cwd=ROOT, env=os.environ | {RECORD: str(record)}, start_new_session=True) as process:
        try:
            return {0: "met", 1: "missed"}.get(process.wait(budget), "failed")
        except subprocess.TimeoutExpired:
            return "stopped"
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)


def measure(names: Sequence[str]) -> Generator[dict[str, Any]]:
    """Run the benchmarks one after the other, and yield the run as it is after each of them."""
    run: dict[str, Any] = {"time": datetime.now(UTC).isoformat(timespec="seconds"), "commit": commit()}
    run |= {"machine": machine(), "benchmarks": {}}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "record.jsonl"
        file.touch()
        for name in names:
            print(f"-- {name}, at most {BUDGETS[name]} s", flush=True)
            began, cpu = time.perf_counter(), cpu_seconds()
            outcome = call(name, file, BUDGETS[name])
            spent = {"wall": round(time.perf_counter() - began, 1), "cpu": round(cpu_seconds() - cpu, 1)}
            print(f"-- {name}: {outcome}, {spent['wall']:.0f} s, {spent['cpu']:.0f} s of CPU", flush=True)
            run["benchmarks"][name] = spent | {"targets": outcome}
            run["work"] = summarize(file.read_text(encoding="utf-8").splitlines())
            yield run


def main(names: Sequence[str] = (), kept: Path = KEPT) -> int:
    """Run the named benchmarks (bench_paper ...), all without names, and keep and compare their medians.

    Returns 1 if a benchmark was stopped or failed.
    """
    if unknown := [name for name in names if name not in BUDGETS]:
        raise SystemExit(f"no benchmark is called {unknown[0]}; allowed: {', '.join(BUDGETS)}")
    runs, run = read(kept), {}
    for run in measure(names or list(BUDGETS)):
        keep(kept, [*runs, run])
    lines = list(slower(runs, run))
    compared = sum(last_of(runs, run["machine"], name) is not None for name in run["work"])
    wall, cpu = (sum(part[key] for part in run["benchmarks"].values()) for key in ("wall", "cpu"))
    print(f"-- {len(run['benchmarks'])} benchmarks: {wall:.0f} s, {cpu:.0f} s of CPU; kept as a line of {kept.name}")
    print("\n".join(lines) or f"nothing is slower than before, of {compared} compared with a run on this machine")
    incomplete = [name for name, part in run["benchmarks"].items() if part["targets"] in ("stopped", "failed")]
    if incomplete:
        print(f"not measured to the end: {', '.join(incomplete)}")
    return int(bool(incomplete))


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # stops the benchmark, too
    sys.exit(main(sys.argv[1:]))
