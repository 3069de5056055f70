"""Plant small faults in the package one at a time, and count those that no test catches.

    make mutate                          # 300 faults of a seeded sample of the group "numerics"
    make mutate ARGS="--group services --count 200"  # 200 of ensembles, exports, planning, campaigns, figures ...
    make mutate ARGS="--count 60"        # the first 60 of them
    make mutate ARGS="--again 17"        # one of them, with what the tests print
    make mutate ARGS="--part judging --file judging/order.py --count 9999 --folder reports/latest/one"  # one file

A fault is one change of an operator, a comparison, a constant or a choice, as mutmut and cosmic-ray plant them, in the
modules of a group of parts (``GROUPS`` of faults.py). No file is changed: the tests are collected once, and a forked
process for each fault gives the functions of the module their changed code. It runs those of ``TESTS`` that execute the
changed line, the quickest first, up to the first failure; slow tests are left out. Which lines a test executes is
measured once and kept in ``mutants-lines.json``; a file of tests that has changed since is measured again. A line that
no test executes is "not covered", and so is one that only other processes execute, such as workers of a campaign.
Results are added to ``mutants.jsonl``, so that an interrupted count goes on; ``--fresh`` begins anew. Both files are in
``reports/latest``, those of other groups than the first in a folder there.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import importlib
import json
import math
import os
import resource
import select
import signal
import sys
import time
from collections.abc import Callable, Generator, Sequence
from pathlib import Path
from typing import Any

import pytest
from faults import GROUPS, INTERPRETED, ROOT, Live, Mutant, Statements, lines_of, plant, sample, targets

#: tests of each part beside its examples; what others catch by chance does not count
TESTS = {
    "physics": ("tests/physics", "tests/trajectory/test_restitution.py", "tests/formats/tables/test_angles.py"),
    "observables": ("tests/observables", "tests/verification"),
    "deck": ("tests/lmp/test_deck.py",),
    "uncertainty": ("tests/runs/uncertainty",),
    "judging": ("tests/judging",),
    "ensembles": ("tests/ensembles",),
    "exports": ("tests/formats", "tests/scene/file"),
    "planning": ("tests/runs/planning",),
    "campaign": ("tests/runs/campaign",),
    "measurement": ("tests/studies/measurement",),
    "figures": ("tests/report", "tests/verification", "tests/test_plot.py"),
    "keys": ("tests/runs",),
}
#: answers for a fault that no test catches
SURVIVES = ("none", "not covered")
#: s of CPU beyond five times the usual time, for kernels to be compiled; s of wall time beyond thirty times the usual
#: CPU time, for a campaign that waits for ever; bytes: a fault that needs more is caught by the limit
CPU, WALL, MEMORY = 60.0, 120.0, 16 * 2**30


def forked(answer_of: Callable[[], str], usual: float, *, show: bool = False) -> str:
    """Return what a function answers in a forked process, or which limit it passed; ``usual``: its time, s of CPU."""
    receive, send = os.pipe()
    child = os.fork()
    if child == 0:
        os.setsid()
        resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(CPU + 5.0 * usual),) * 2)
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        if not show:
            with open(os.devnull, "w") as nothing:
                os.dup2(nothing.fileno(), 1)
                os.dup2(nothing.fileno(), 2)
        try:
            answer = answer_of()
        except BaseException as error:
            answer = f"{type(error).__name__}: {error}"
        os.write(send, answer.encode())
        os._exit(0)
    os.close(send)
    ready, _, _ = select.select([receive], [], [], WALL + 30.0 * usual)
    answer = os.read(receive, 4096).decode() if ready else ""
    os.close(receive)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return answer if answer else "more than the limits of time or memory"


def interval(killed: int, count: int) -> tuple[float, float]:
    """Return Wilson's 95 % interval of a fraction.

    >>> [round(bound, 3) for bound in interval(90, 100)]
    [0.826, 0.945]
    """
    z, p = 1.959964, killed / count
    middle, spread = p + z * z / (2 * count), z * math.sqrt(p * (1 - p) / count + z * z / (4 * count * count))
    return (middle - spread) / (1 + z * z / count), (middle + spread) / (1 + z * z / count)


class Count:
    """Plugin of pytest that plants faults instead of running the tests, and counts."""

    def __init__(self, options: argparse.Namespace) -> None:
        self.options, self.failed, self.statements = options, "", Statements()
        self.results, self.lines = options.folder / "mutants.jsonl", options.folder / "mutants-lines.json"
        self.shared: dict[object, set[tuple[str, int]]] = {}
        self.items: dict[str, pytest.Item] = {}
        self.tests: dict[str, dict[str, Any]] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed and not self.failed:
            self.failed = report.nodeid

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Generator[None, object, object]:
        """Note what runs for several tests, because the first of them is not the only one that sees it."""
        seen = self.statements.seen
        outer = set(seen)
        seen.clear()
        try:
            return (yield)
        finally:
            if fixturedef.scope != "function":
                self.shared[fixturedef] = self.shared.get(fixturedef, set()) | seen
            seen |= outer

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        self.items = {item.nodeid: item for item in session.items}
        for name in ("numba", "pandas", "xarray"):  # loaded once, before the forks, and so are the kernels
            importlib.import_module(name)
        for part in (0, 1):
            importlib.import_module("tests.helpers.compile_kernels").compile_part(part)
        if session.testsfailed:
            raise SystemExit("the tests cannot be collected")
        self.live = Live()
        self.measure_lines()
        self.count()
        return True

    def measure_lines(self) -> None:
        """Read or measure which lines each test executes, and how long it takes."""
        kept = json.loads(self.lines.read_text("utf-8")) if self.lines.exists() else {}
        package = _digest(*targets(self.options.group))
        tests = kept.get("tests", {}) if kept.get("package") == package else {}
        files = {name.split("::")[0] for name in (*tests, *self.items)}
        digests = {file: _digest(file) for file in files if (ROOT / file).exists()}
        current = {name: test for name, test in tests.items() if test["digest"] == digests.get(name.split("::")[0])}
        missing = [item for name, item in self.items.items() if name not in current]
        if missing:
            print(f"{len(missing)} tests are run to see which lines they execute", flush=True)

            def trace() -> str:
                self.statements.watch(self.live, targets(self.options.group))
                written = time.monotonic()
                for item, following in zip(missing, [*missing[1:], None], strict=True):
                    digest = {"digest": digests[item.nodeid.split("::")[0]]}
                    current[item.nodeid] = self._traced(item, following) | digest
                    if following is None or time.monotonic() > written + 60.0:
                        self.lines.write_text(json.dumps({"package": package, "tests": current}), encoding="utf-8")
                        written = time.monotonic()
                return "ready"

            self.options.folder.mkdir(parents=True, exist_ok=True)
            if (answer := forked(trace, 3600.0)) != "ready":
                raise SystemExit(answer)
        self.tests = json.loads(self.lines.read_text("utf-8"))["tests"]

    def _traced(self, item: pytest.Item, following: pytest.Item | None) -> dict[str, Any]:
        self.live.forget_results()
        self.failed, began = "", sum(os.times()[:4])
        self.statements.seen.clear()
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
        lines, info = set(self.statements.seen), getattr(item, "_fixtureinfo", None)
        for fixtures in info.name2fixturedefs.values() if info else ():
            lines = lines.union(*(self.shared.get(fixture, set()) for fixture in fixtures))
        files = {file: sorted(line for each, line in lines if each == file) for file, _ in lines}
        return {"s": round(sum(os.times()[:4]) - began, 3), "failed": bool(self.failed), "lines": files}

    def tests_of(self, mutant: Mutant) -> list[str]:
        """Return the tests that execute the line of a fault, or its file if it is executed by the import."""
        lines = set(lines_of((ROOT / mutant.file).read_text("utf-8"), mutant.line))
        names = [
            name
            for name, test in self.tests.items()
            if name in self.items and not test["failed"] and mutant.file in test["lines"]
            if not lines or not lines.isdisjoint(test["lines"][mutant.file])
        ]
        names.sort(key=lambda name: (INTERPRETED[0] not in self.tests[name]["lines"], self.tests[name]["s"]))
        spent = 0.0
        for place, name in enumerate(names):
            spent += self.tests[name]["s"]
            if place and spent > self.options.most:
                return names[:place]
        return names

    def run(self, mutant: Mutant | None, names: Sequence[str], *, show: bool = False) -> str:
        """Run tests with a fault, or none, in a forked process; return the first that fails, a limit, or "none"."""

        def answer() -> str:
            self.failed = ""
            if mutant is not None:
                try:
                    plant(mutant, self.live)
                except Exception as error:
                    return f"import: {type(error).__name__}"
            items = [self.items[name] for name in names]
            for item, following in zip(items, [*items[1:], None], strict=True):
                item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
                if self.failed:
                    break
            return self.failed or "none"

        return forked(answer, sum(self.tests[name]["s"] for name in names), show=show)

    def count(self) -> None:
        """Plant the faults of the sample that have no result yet, and print what came out."""
        options, wanted = self.options, self.options.again
        files = [f"dem_bridge/{options.file}"] if options.file else targets(options.group, options.part)
        chosen = sample(options.count, options.seed, options.group, files)
        if wanted is not None:
            print(self.run(chosen[wanted], self.tests_of(chosen[wanted]), show=True))
            return
        lines = self.results.read_text("utf-8").splitlines() if self.results.exists() and not self.options.fresh else []
        results = {_key(entry): entry for entry in map(json.loads, lines)}
        with self.results.open("a" if lines else "w", encoding="utf-8") as file:
            for number, mutant in chosen.items():
                key = _key(vars(mutant))
                if key in results and not (self.options.survivors and results[key]["caught_by"] in SURVIVES):
                    continue
                began, names = time.monotonic(), self.tests_of(mutant)
                caught = self.run(mutant, names) if names else "not covered"
                took = {"s": round(time.monotonic() - began, 1), "tests": len(names)}
                results[key] = vars(mutant) | {"caught_by": caught} | took
                file.write(json.dumps(results[key]) + "\n")
                file.flush()
                print(f"{number:4} {took['s']:6.1f} s  {mutant.file}:{mutant.line}  {caught}", flush=True)
        self.report({number: results[_key(vars(mutant))] for number, mutant in chosen.items()})

    def report(self, entries: dict[int, dict[str, Any]]) -> None:
        """Print the survivors, and how many were caught in each part."""
        # a test that fails without a fault catches nothing
        catchers = sorted({entry["caught_by"] for entry in entries.values()} & set(self.items))
        if catchers and (answer := self.run(None, catchers)) != "none":
            raise SystemExit(f"{answer} fails without a fault, too")
        survivors = {number: entry for number, entry in entries.items() if entry["caught_by"] in SURVIVES}
        for number, entry in survivors.items():
            print(f"{number}: {entry['file']}:{entry['line']} ({entry['caught_by']})")
            print(f"- {entry['before']}\n+ {entry['after']}")
        for part in ("", *GROUPS[self.options.group]):
            files = targets(self.options.group, part)
            numbers = {number for number, entry in entries.items() if entry["file"] in files}
            if numbers:
                caught = len(numbers - survivors.keys())
                low, high = interval(caught, len(numbers))
                share = f"{caught} ({caught / len(numbers):.0%}) | {low:.0%} to {high:.0%}"
                print(f"| {part or 'all'} | {len(numbers)} | {share} |")


def _key(entry: dict[str, Any]) -> tuple[object, ...]:
    return entry["file"], entry["line"], entry["before"], entry["after"]


def _digest(*files: str) -> str:
    return hashlib.sha256(b"".join((ROOT / file).read_bytes() for file in files)).hexdigest()[:16]


def main() -> int:
    parser = argparse.ArgumentParser(prog="mutate.py", description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=20)
    parser.add_argument("--most", type=float, default=60.0, metavar="S", help="usual time of the tests for one fault")
    parser.add_argument("--again", type=int, metavar="NUMBER", help="run one of the sample and show its tests")
    parser.add_argument("--survivors", action="store_true", help="run those again that no test caught")
    parser.add_argument("--folder", type=Path, help="where results are kept")
    parser.add_argument("--tests", nargs="+", metavar="FILE", help="these tests only; the others are for --survivors")
    parser.add_argument("--group", choices=tuple(GROUPS), help="the parts of which the sample is")
    parser.add_argument("--part", choices=tuple(TESTS), default="", help="only its faults, by its own tests")
    parser.add_argument("--file", default="", metavar="FILE", help="only its faults, such as judging/order.py")
    parser.add_argument("--fresh", action="store_true", help="forget earlier results")
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # a fork has one thread
    os.chdir(ROOT)
    sys.path.insert(0, str(ROOT))
    # pytest would compile functions with assertions anew, and no fault could be planted in them
    words = ["-q", "-s", "--assert=plain", "-p", "no:cacheprovider", "-p", "no:xdist"]
    words += ["-m", "not slow and not browser and not peers"]
    options = parser.parse_args()
    first, *_ = GROUPS
    of_part = next((group for group, parts in GROUPS.items() if options.part in parts), None)
    if of_part and options.group not in (None, of_part):
        parser.error(f"--part {options.part} is of the group {of_part}, and --group is {options.group}; leave out one")
    options.group = of_part or options.group or first
    latest = ROOT / "reports" / "latest"
    options.folder = options.folder or (latest if options.group == first else latest / options.group)
    parts = [options.part] if options.part else list(GROUPS[options.group])
    chosen = options.tests or dict.fromkeys(test for part in parts for test in TESTS[part])
    tests = [*targets(options.group, options.part), *chosen]
    return int(pytest.main([*words, *tests], plugins=[Count(options)]))


if __name__ == "__main__":
    sys.exit(main())
