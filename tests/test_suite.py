"""The tests keep rules: an expected error has words, nothing is compared with itself, no test reads a clock."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import hypothesis
import pytest

from dem_bridge import errors

FILES = sorted(Path(__file__).parent.rglob("*.py"))
#: errors that many lines raise, each with its own words
BROAD = {name for name, kind in vars(errors).items() if isinstance(kind, type) and issubclass(kind, Exception)}
BROAD |= {"Exception", "AssertionError", "OSError", "RuntimeError", "ValueError"}
CLOCKS = {f"time.{name}" for name in ("time", "monotonic", "perf_counter", "process_time", "sleep")}
#: files that may wait for an event, and those that are not tests
WITH_CLOCKS = ("tests/judging/conformance/tiny_code", "tests/verification/test_under_way", 
    "tests/helpers/processes.py", "tests/helpers/counted/", "tests/bench/timing.py", "tests/bench/history.py",
    "tests/bench/bench_", "tests/judging/measure_causes.py", "tests/fuzz/harness.py", "tests/soak.py",
)  # fmt: skip


def wordless_errors(tree: ast.AST) -> Iterator[int]:
    """Yield the lines of ``pytest.raises`` that any error of a broad kind satisfies."""
    items = (item for node in ast.walk(tree) if isinstance(node, ast.With) for item in node.items)
    for item in items:
        call = item.context_expr
        if not isinstance(call, ast.Call) or ast.unparse(call.func) != "pytest.raises" or item.optional_vars:
            continue
        kinds = {kind.id for kind in ast.walk(call.args[0]) if isinstance(kind, ast.Name)}
        if kinds & BROAD and not any(keyword.arg == "match" for keyword in call.keywords):
            yield call.lineno


def compared_with_itself(tree: ast.AST) -> Iterator[int]:
    """Yield the lines on which an expression is compared with the same expression."""
    for node in ast.walk(tree):
        pair: list[ast.expr] = []
        if isinstance(node, ast.Compare) and isinstance(node.ops[0], ast.Eq | ast.LtE | ast.GtE):
            pair = [node.left, node.comparators[0]]
        elif isinstance(node, ast.Call) and "assert_" in ast.unparse(node.func):
            pair = node.args[:2]
        if len(pair) == 2 and ast.dump(pair[0]) == ast.dump(pair[1]):
            yield pair[0].lineno


def clocks(tree: ast.AST) -> Iterator[int]:
    """Yield the lines that read a clock or wait for one."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and ast.unparse(node) in CLOCKS:
            yield node.lineno


RULES = {
    "errors without words": (wordless_errors, "with pytest.raises(RunBroken):\n    run()"),
    "broad errors among others": (wordless_errors, "with pytest.raises((KeyError, UsageError)):\n    run()"),
    "compared with itself": (compared_with_itself, "assert types(3) == types(3)"),
    "arrays compared with themselves": (compared_with_itself, "np.testing.assert_array_equal(types(3), types(3))"),
    "clocks": (clocks, "began = time.perf_counter()"),
    "waits": (clocks, "time.sleep(0.5)"),
}


@cache
def _tree(file: Path) -> ast.Module:
    return ast.parse(file.read_text(encoding="utf-8"))


@pytest.mark.parametrize("rule", [wordless_errors, compared_with_itself, clocks])
def test_every_file_keeps_the_rule(rule: object) -> None:
    assert callable(rule)
    broken = []
    for file in FILES:
        path = file.relative_to(Path(__file__).parents[1]).as_posix()
        if rule is not clocks or not path.startswith(WITH_CLOCKS):
            broken += [f"{path}:{line}" for line in rule(_tree(file))]
    assert broken == []


@pytest.mark.parametrize(("rule", "source"), RULES.values(), ids=RULES)
def test_a_broken_rule_is_noticed(rule: object, source: str) -> None:
    assert callable(rule)
    assert list(rule(ast.parse(source))) == [1]


def test_property_tests_take_the_same_examples_every_time_and_are_not_timed() -> None:
    settings = hypothesis.settings.default
    assert settings is not None
    assert (settings.derandomize, settings.deadline, settings.database) == (True, None, None)


@pytest.mark.skipif(sys.platform != "linux", reason="threads are counted in /proc")
def test_linear_algebra_takes_one_thread() -> None:
    # on two busy cores two threads take 30 times as long for the small matrices here
    code = "import tests, numpy, os; print(len(os.listdir('/proc/self/task')))"
    environment = {key: value for key, value in os.environ.items() if key != "OPENBLAS_NUM_THREADS"}
    environment["PYTHONPATH"] = str(Path(__file__).parents[1])
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout == "1\n"
