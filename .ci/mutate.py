"""Plant small faults in the package one at a time, and count those that no test catches.

    make mutate                          # 300 faults of a seeded sample
    make mutate ARGS="--count 60"        # the first 60 of them
    make mutate ARGS="--again 17"        # one of them, with what the tests print

A fault is one change of an operator, a comparison, a constant or a choice, as mutmut and cosmic-ray plant them, in the
modules of ``TARGETS``. It exists in a forked process only: no file is changed. That process runs the examples of the
module and the tests that belong to it, those that import it first, up to the first failure; slow tests are left out.
Results are added to ``reports/latest/mutants.jsonl``, so that an interrupted count goes on; ``--fresh`` begins anew.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import json
import math
import os
import random
import re
import resource
import select
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import CodeType
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "reports" / "latest" / "mutants.jsonl"
TARGETS = ("physics", "accuracy.py", "verification/verdict.py", "uncertainty", "observables", "lmp/deck.py", "judging")
#: s of CPU and of wall time, bytes: a fault that needs more is caught by the limit
CPU, WALL, MEMORY = 600, 3600.0, 16 * 2**30
#: loaded once, before the forks
HEAVY = (
    "numpy",
    "numba",
    "scipy.integrate",
    "scipy.optimize",
    "scipy.linalg",
    "pandas",
    "xarray",
    "pydantic",
    "pytest",
)
_OPERATORS: dict[type, type] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult, ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In, ast.And: ast.Or,
    ast.Or: ast.And, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
}  # fmt: skip
_NAMES = {"min": "max", "max": "min", "any": "all", "all": "any", "argmin": "argmax", "argmax": "argmin"}


@dataclass(frozen=True)
class Mutant:
    """One fault: change number ``index`` of a file, with its line before and after."""

    file: str
    index: int
    line: int
    before: str
    after: str


#: node, its field, place in a list there (None: no list), and what replaces it
Change = tuple[ast.AST, str, int | None, Any]


def changes(tree: ast.AST) -> Iterator[Change]:
    """Yield all changes of a tree, in a fixed order; annotations, decorators and texts are left alone.

    >>> text = "y = -x + 1 if x < 2.0 else max(x, z)"
    >>> for k in range(7):
    ...     print(mutated(text, k)[1])
    y = -x + 1 if not x < 2.0 else max(x, z)
    y = -x + 1 if x <= 2.0 else max(x, z)
    y = -x + 1 if x < 4.0 else max(x, z)
    y = x + 1 if x < 2.0 else max(x, z)
    y = -x - 1 if x < 2.0 else max(x, z)
    y = -x + 2 if x < 2.0 else max(x, z)
    y = -x + 1 if x < 2.0 else min(x, z)
    """
    for field, value in ast.iter_fields(tree):
        if field in ("annotation", "returns", "decorator_list") or isinstance(value, ast.JoinedStr):
            continue
        for place, node in enumerate(value) if isinstance(value, list) else [(None, value)]:
            if isinstance(node, ast.AST) and not isinstance(node, ast.JoinedStr):
                yield from ((tree, field, place, new) for new in _replacements(node))
                yield from changes(node)
            elif isinstance(tree, ast.Constant) and field == "value":
                yield from ((tree, field, None, new) for new in _numbers(value))


def _replacements(node: ast.AST) -> Iterator[ast.AST]:
    if type(node) in _OPERATORS:
        yield _OPERATORS[type(node)]()
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
        yield node.operand
    if isinstance(node, ast.Name) and node.id in _NAMES:
        yield ast.Name(_NAMES[node.id], node.ctx)
    if isinstance(node, ast.Attribute) and node.attr in _NAMES:
        yield ast.Attribute(node.value, _NAMES[node.attr], node.ctx)
    if isinstance(node, ast.If | ast.IfExp) and ast.unparse(node.test) != "TYPE_CHECKING":
        yield type(node)(ast.UnaryOp(ast.Not(), node.test), node.body, node.orelse)  # type: ignore[arg-type]


def _numbers(value: object) -> Iterator[object]:
    if isinstance(value, bool):
        yield not value
    elif isinstance(value, int):
        yield value + 1
    elif isinstance(value, float) and math.isfinite(value):
        yield 2.0 * value if value else 1.0


def mutated(text: str, index: int) -> tuple[ast.Module, str, int, str]:
    """Return the tree with a change, the first changed line of the text, its number, and that line before."""
    tree = ast.parse(text)
    before = ast.unparse(tree).splitlines()
    node, field, place, new = list(changes(tree))[index]
    line: int = getattr(node, "lineno", 0) or getattr(new, "lineno", 0)
    if place is None:
        setattr(node, field, new)
    else:
        getattr(node, field)[place] = new
    ast.fix_missing_locations(tree)
    after = ast.unparse(tree).splitlines()
    changed = next((pair for pair in zip(before, after, strict=False) if pair[0] != pair[1]), ("", ""))
    return tree, changed[1].strip(), line, changed[0].strip()


def sample(count: int, seed: int) -> list[Mutant]:
    """Return a seeded sample of all changes of the targets; a smaller count is the beginning of a larger one."""
    files = []
    for target in TARGETS:
        place = ROOT / "dem_bridge" / target
        files += sorted(place.rglob("*.py")) if place.is_dir() else [place]
    texts = {str(file.relative_to(ROOT)): file.read_text(encoding="utf-8") for file in files}
    every = [(file, k) for file, text in texts.items() for k, _ in enumerate(changes(ast.parse(text)))]
    random.Random(seed).shuffle(every)
    chosen = []
    for file, index in every[:count]:
        _, after, line, before = mutated(texts[file], index)
        chosen.append(Mutant(file, index, line, before, after))
    return chosen


def tests_of(file: str) -> list[str]:
    """Return what is run for a file: its examples, its own tests and those that import it, or those of its folder."""
    name = Path(file).with_suffix("").as_posix().replace("/", ".")
    parent, _, stem = name.rpartition(".")
    imported = re.compile(rf"{re.escape(name)}\b|from {re.escape(parent)} import [^\n]*\b{stem}\b")
    tests = sorted((ROOT / "tests").rglob("test_*.py"))
    folder = ROOT / "tests" / Path(file).relative_to("dem_bridge").parent
    near = [test for test in tests if test.parent == folder and folder != ROOT / "tests"]
    own = [test for test in tests if test.stem == f"test_{stem}"]
    direct = [test for test in tests if "faults" not in test.parts and imported.search(test.read_text("utf-8"))]
    return [file, *dict.fromkeys(str(test.relative_to(ROOT)) for test in ([*own, *direct] or near))]


class _Changed(importlib.machinery.SourceFileLoader):
    """Load a module from the changed tree."""

    def __init__(self, name: str, file: Path, code: CodeType) -> None:
        super().__init__(name, str(file))
        self.code = code

    def get_code(self, fullname: str) -> CodeType:
        return self.code


class _Finder(importlib.abc.MetaPathFinder):
    """Find one module with its loader, before all others do."""

    def __init__(self, loader: _Changed) -> None:
        self.loader = loader

    def find_spec(self, fullname: str, path: object = None, target: object = None) -> Any:
        if fullname != self.loader.name:
            return None
        return importlib.util.spec_from_file_location(fullname, self.loader.path, loader=self.loader)


class _Plugin:
    """Plant the fault, and note the first test that fails."""

    failed = ""
    finder: _Finder | None = None

    def pytest_configure(self) -> None:
        if self.finder is not None:  # before pytest's own finder, which takes the modules whose examples are run
            sys.meta_path.insert(0, self.finder)

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed and not self.failed:
            self.failed = report.nodeid

    pytest_collectreport = pytest_runtest_logreport


def run_tests(mutant: Mutant | None, tests: Sequence[str], *, show: bool = False) -> str:
    """Run tests in a forked process with a fault, or none; return the first that fails, or which limit was passed."""
    receive, send = os.pipe()
    child = os.fork()
    if child == 0:
        os.setsid()
        with contextlib.suppress(BaseException):
            os.write(send, _in_child(mutant, tests, show).encode())
        os._exit(0)
    os.close(send)
    ready, _, _ = select.select([receive], [], [], WALL)
    answer = os.read(receive, 4096).decode() if ready else ""
    os.close(receive)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return answer if answer else "more than the limits of time or memory"


def _in_child(mutant: Mutant | None, tests: Sequence[str], show: bool) -> str:
    import pytest

    resource.setrlimit(resource.RLIMIT_CPU, (CPU, CPU))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    if not show:
        with open(os.devnull, "w") as nothing:
            os.dup2(nothing.fileno(), 1)
            os.dup2(nothing.fileno(), 2)
    plugin = _Plugin()
    if mutant is not None:
        path = ROOT / mutant.file
        tree, *_ = mutated(path.read_text(encoding="utf-8"), mutant.index)
        name = Path(mutant.file).with_suffix("").as_posix().replace("/", ".")
        plugin.finder = _Finder(_Changed(name, path, compile(tree, str(path), "exec")))
        sys.meta_path.insert(0, plugin.finder)  # conftest.py is imported before the plugin is configured
        if path.name == "kernels.py":  # compiled code of the right one must not be loaded
            os.environ["NUMBA_CACHE_DIR"] = str(RESULTS.parent / "mutants-numba")
    words = ["-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-m", "not slow and not browser and not peers"]
    code = pytest.main([*words, *tests], plugins=[plugin])
    return "none" if code in (0, 5) else plugin.failed or f"exit code {int(code)}"


def interval(killed: int, count: int) -> tuple[float, float]:
    """Return Wilson's 95 % interval of a fraction.

    >>> [round(bound, 3) for bound in interval(90, 100)]
    [0.826, 0.945]
    """
    z, p = 1.959964, killed / count
    middle, spread = p + z * z / (2 * count), z * math.sqrt(p * (1 - p) / count + z * z / (4 * count * count))
    return (middle - spread) / (1 + z * z / count), (middle + spread) / (1 + z * z / count)


def main() -> int:
    parser = argparse.ArgumentParser(prog="mutate.py", description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=20)
    parser.add_argument("--again", type=int, metavar="NUMBER", help="run one of the sample and show its tests")
    parser.add_argument("--survivors", action="store_true", help="run those again that no test caught")
    parser.add_argument("--deselect", action="append", default=[], metavar="TEST", help="leave out a test that fails")
    parser.add_argument("--fresh", action="store_true", help="forget earlier results")
    options = parser.parse_args()
    os.chdir(ROOT)
    sys.path.insert(0, str(ROOT))
    for name in HEAVY:
        importlib.import_module(name)
    mutants = sample(options.count, options.seed)
    if options.again is not None:
        print(run_tests(mutants[options.again], tests_of(mutants[options.again].file), show=True))
        return 0
    RESULTS.parent.mkdir(parents=True, exist_ok=True)
    if options.fresh:
        RESULTS.unlink(missing_ok=True)
    lines = RESULTS.read_text("utf-8").splitlines() if RESULTS.exists() else []
    results = {(entry["file"], entry["before"], entry["after"]): entry for entry in map(json.loads, lines)}
    for number, mutant in enumerate(mutants):
        key = (mutant.file, mutant.before, mutant.after)
        again = [*options.deselect, *(["none"] if options.survivors else [])]
        if key in results and results[key]["caught_by"] not in again:
            continue
        began = time.monotonic()
        caught = run_tests(mutant, [*tests_of(mutant.file), *(f"--deselect={test}" for test in options.deselect)])
        results[key] = vars(mutant) | {"number": number, "caught_by": caught, "s": round(time.monotonic() - began, 1)}
        with RESULTS.open("a", encoding="utf-8") as file:
            file.write(json.dumps(results[key]) + "\n")
        print(f"{number:4} {results[key]['s']:6.1f} s  {mutant.file}:{mutant.line}  {caught}", flush=True)
    chosen = [results[mutant.file, mutant.before, mutant.after] for mutant in mutants]
    # a test that fails without a fault catches nothing
    for test in sorted({entry["caught_by"] for entry in chosen if "::" in entry["caught_by"]}):
        if (answer := run_tests(None, [test])) != "none":
            raise SystemExit(f"{test} fails without a fault, too: {answer}")
    survivors = [entry for entry in chosen if entry["caught_by"] == "none"]
    for entry in survivors:
        print(f"{entry['number']}: {entry['file']}:{entry['line']}\n- {entry['before']}\n+ {entry['after']}")
    low, high = interval(len(chosen) - len(survivors), len(chosen))
    print(f"{len(chosen) - len(survivors)} of {len(chosen)} caught, {100 * low:.0f} to {100 * high:.0f} % (95 %)")
    return 0


if __name__ == "__main__":
    sys.exit(main())
