"""A kernel is identified by its content, and by all of it: what it calls, and the values that are compiled into it."""

from __future__ import annotations

import ast
import inspect
import os
import subprocess
import sys
from collections import namedtuple
from collections.abc import Iterator, Mapping
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import pytest

import dem_bridge
from dem_bridge.foundation import kernel_content
from dem_bridge.foundation.compiled import Kernel
from dem_bridge.foundation.kernel_content import Unidentified, closure_digest

PACKAGE = Path(dem_bridge.__file__).parent


@pytest.fixture(autouse=True)
def nothing_identified_yet(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let each test change what this process has identified before."""
    monkeypatch.setattr(kernel_content, "first_identified", WeakKeyDictionary())


@cache
def _kernels() -> Mapping[str, Any]:
    """Return all kernels of the package by module and name, from the text of its files."""
    found = {}
    for file in sorted(PACKAGE.rglob("*.py")):
        if "@kernel(" in file.read_text(encoding="utf-8") and file.stem != "compiled":
            module = import_module(".".join(file.relative_to(PACKAGE.parent).with_suffix("").parts))
            for name, value in vars(module).items():
                if isinstance(value, Kernel) and value.py_func.__module__ == module.__name__:
                    found[f"{module.__name__}.{name}"] = value.py_func
    return found


@cache
def _used(module: str) -> Mapping[str, frozenset[str]]:
    """Return the names that each function of a module reads, from its syntax tree and not from its byte code."""
    tree = ast.parse(inspect.getsource(import_module(module)))
    return {
        item.name: frozenset(
            node.id for part in item.body for node in ast.walk(part)
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)
        )
        for item in tree.body if isinstance(item, ast.FunctionDef)
    }  # fmt: skip


def _closure(name: str) -> set[str]:
    """Return the kernels and constants (module and name) that a kernel depends on, itself included."""
    reached, waiting = set[str](), [name]
    while waiting:
        if (current := waiting.pop()) in reached:
            continue
        reached.add(current)
        module, _, function = current.rpartition(".")
        for used in _used(module).get(function, ()):
            value = vars(import_module(module)).get(used)
            if isinstance(value, Kernel):
                waiting.append(f"{value.py_func.__module__}.{value.py_func.__qualname__}")
            elif value is not None and not isinstance(value, ModuleType | type | FunctionType):
                reached.add(f"{module}.{used}")
    return reached


def _digests(monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    monkeypatch.setattr(kernel_content, "first_identified", WeakKeyDictionary())
    return {name: closure_digest(function) for name, function in _kernels().items()}


def _changed(before: Mapping[str, str], now: Mapping[str, str]) -> set[str]:
    return {name for name in before if before[name] != now[name]}


def test_a_changed_kernel_changes_exactly_the_kernels_that_use_it(monkeypatch: pytest.MonkeyPatch) -> None:
    before, closures = _digests(monkeypatch), {name: _closure(name) for name in _kernels()}
    assert len(before) > 50
    assert len(set(before.values())) == len(before)
    for name, function in _kernels().items():
        code = function.__code__
        function.__code__ = code.replace(co_consts=(*code.co_consts, "another constant"))
        try:
            assert _changed(before, _digests(monkeypatch)) == {user for user in closures if name in closures[user]}, (
                name
            )
        finally:
            function.__code__ = code
    assert _digests(monkeypatch) == before


def test_a_changed_constant_changes_exactly_the_kernels_that_use_it(monkeypatch: pytest.MonkeyPatch) -> None:
    before, closures = _digests(monkeypatch), {name: _closure(name) for name in _kernels()}
    modules = {name.rpartition(".")[0] for name in before}
    constants = [
        (module, name, value)
        for module in sorted(modules)
        for name, value in vars(import_module(module)).items()
        if isinstance(value, int | float | tuple) and not name.startswith("__")
    ]
    used = 0
    for module, name, value in constants:
        with monkeypatch.context() as patch:
            patch.setattr(import_module(module), name, (*value, 1) if isinstance(value, tuple) else value + 1)
            users = {user for user in closures if f"{module}.{name}" in closures[user]}
            assert _changed(before, _digests(patch)) == users, (module, name)
            used += bool(users)
    assert used > 5


Pair = namedtuple("Pair", ["first", "second"])
Swapped = namedtuple("Swapped", ["second", "first"])
Swapped.__name__ = Swapped.__qualname__ = "Pair"

_TEXT = """
import math
import numpy as np
FACTOR = 2.0
UNUSED = 1
def helper(x):
    return FACTOR * x
def other(x):
    return x
def function(x, power=2):
    y = helper(x)
    def inner(z):
        return z + y
    return inner(y) ** power + math.pi
"""

#: what is changed in the text above -> the replacement, and whether it is another content
_EDITS = {
    "nothing": ("math", "math", False),
    "a comment": ("def helper(x):", "def helper(x):  # twice", False),
    "a line above": ("import math\n", "import math\n\n\n", False),
    "a space": ("FACTOR * x", "FACTOR  *  x", False),
    "parentheses": ("FACTOR * x", "(FACTOR * x)", False),
    "an annotation": ("helper(x):", "helper(x: float):", False),
    "a constant that is not used": ("UNUSED = 1", "UNUSED = 2", False),
    "a function that is not used": ("return x\n", "return 2 * x\n", False),
    "a constant of a helper": ("FACTOR = 2.0", "FACTOR = 2.5", True),
    "its type": ("FACTOR = 2.0", "FACTOR = 2", True),
    "its sign of zero": ("FACTOR = 2.0", "FACTOR = -0.0", True),
    "its last bit": ("FACTOR = 2.0", "FACTOR = 2.0000000000000004", True),
    "a constant that is an array": ("FACTOR = 2.0", "FACTOR = np.array([2.0])", True),
    "a constant that is a tuple": ("FACTOR = 2.0", "FACTOR = (2.0,)", True),
    "an operation of a helper": ("FACTOR * x", "FACTOR + x", True),
    "the order of operands": ("FACTOR * x", "x * FACTOR", True),
    "another helper": ("y = helper(x)", "y = other(x)", True),
    "a default": ("power=2", "power=3", True),
    "an inner function": ("z + y", "z - y", True),
    "a function of a library": ("math.pi", "math.e", True),
    "the library": ("import math", "import cmath as math", True),
    "a name that was built in": ("UNUSED = 1", "UNUSED = 1\nmath = np", True),
}


def _defined(text: str, **names: object) -> FunctionType:
    space: dict[str, Any] = {"__name__": "somewhere", **names}
    exec(compile(text, "anywhere.py", "exec"), space)
    function = space["function"]
    assert isinstance(function, FunctionType)
    return function


@pytest.mark.parametrize(("old", "new", "differs"), _EDITS.values(), ids=_EDITS)
def test_a_digest_changes_with_the_machine_code_alone(old: str, new: str, differs: bool) -> None:
    assert old in _TEXT
    before, after = closure_digest(_defined(_TEXT)), closure_digest(_defined(_TEXT.replace(old, new)))
    assert (before != after) is differs


def _values() -> Iterator[tuple[str, Any]]:
    yield from {
        "None": None, "True": True, "1": 1, "1.0": 1.0, "1 + 0j": 1 + 0j, "text": "1", "bytes": b"1", "0.0": 0.0,
        "-0.0": -0.0,
        "nan": float("nan"), "inf": float("inf"), "tuple": (1,), "nested": ((1,),), "two": (1, 1), "list": [1],
        "set": frozenset({1}), "dict": {1: 2}, "float64": np.float64(1), "float32": np.float32(1), "int64": np.int64(1),
        "array": np.ones(2), "longer": np.ones(3), "integers": np.ones(2, dtype=int), "rows": np.ones((2, 1)),
        "columns": np.ones((2, 3), order="F"), "of rows": np.ones((2, 3)), "other": np.array([1.0, 2.0]),
        "big endian": np.ones(2, dtype=">f8"), "dtype": np.dtype("f8"), "float type": np.float64,
        "record": np.dtype([("a", "f8")]), "other record": np.dtype([("b", "f8")]),
        "padded": np.dtype([("a", "f8")], align=True),
        "named tuple": Pair(1, 2), "swapped": Swapped(1, 2), "class": Pair, "swapped class": Swapped, "ufunc": np.sqrt,
        "another ufunc": np.exp, "function": np.dot, "built in": len, "another": max, "module": np,
    }.items()  # fmt: skip


def test_every_value_has_a_digest_of_its_own() -> None:
    text = "def function():\n    return VALUE"
    digests = {name: closure_digest(_defined(text, VALUE=value)) for name, value in _values()}
    same = {name for name, digest in digests.items() if list(digests.values()).count(digest) > 1}
    assert len(digests) > 40
    # an array of one column is in the order of rows and of columns; an alignment without padding changes nothing
    assert same <= {"record", "padded"}


def test_cells_and_named_defaults_are_content() -> None:
    def made(cell: object, default: object) -> Any:
        def function(x: Any, *, keyword: Any = default) -> Any:
            return x, cell, keyword

        return function

    digests = [closure_digest(made(*values)) for values in ((1, 2), (2, 1), (1, 1), (2, 2), (1, 2))]
    assert digests[0] == digests[4]
    assert len(set(digests)) == 4


def test_functions_may_call_themselves_and_each_other() -> None:
    text = "def even(n):\n    return n == 0 or function(n - 1)\ndef function(n):\n    return n != 0 and even(n - 1)"
    texts = (text, f"{text}\n", text.replace("n == 0", "n == 1"))
    first, again, other = (closure_digest(_defined(definition)) for definition in texts)
    assert first == again != other


def test_what_is_read_from_a_module_is_content() -> None:
    def module(constant: float, unused: float) -> ModuleType:
        made = ModuleType("ours")
        exec(f"import ours\nCONSTANT = {constant}\nUNUSED = {unused}\ndef helper(x):\n    return x * CONSTANT",
             vars(made))  # fmt: skip
        return made

    sys.modules["ours"] = ModuleType("ours")
    try:
        text = "def function(x):\n    return ours.helper(x)"
        digests = [closure_digest(_defined(text, ours=module(*values))) for values in ((1, 1), (1, 2), (2, 1))]
    finally:
        del sys.modules["ours"]
    assert digests[0] == digests[1] != digests[2]


@pytest.mark.parametrize("value", [object(), Unidentified, partial(max, 1), iter(()), np.array([None])], ids=type)
def test_what_has_no_content_is_said_not_to_have_any(value: object) -> None:
    text = "def function():\n    return VALUE"
    with pytest.raises(Unidentified):
        closure_digest(_defined(text, VALUE=value))


def test_names_without_a_value_have_no_content() -> None:
    with pytest.raises(Unidentified, match="'missing', which function uses, is not defined"):
        closure_digest(_defined("def function():\n    return missing"))


def test_a_value_that_changes_after_it_was_compiled_leaves_no_identity() -> None:
    function = _defined(_TEXT)
    closure_digest(function)
    function.__globals__["FACTOR"] = 3.0
    with pytest.raises(Unidentified, match="a value that helper uses has changed"):
        closure_digest(function)
    function.__globals__["FACTOR"] = 2.0
    assert closure_digest(function)


def test_a_digest_is_that_of_every_process() -> None:
    code = (
        "from dem_bridge.backends import taylor, fused, scipy_kernels as k\n"
        "from dem_bridge.foundation.kernel_content import closure_digest as d\n"
        "names = {'a', 'b', 'c', 'd'}\n"
        "def f(x): return x in {'a', 'b', 'c', 'd'} or x in names\n"
        "print([d(x.py_func) for x in (taylor.integrate, fused.advance, k.examine)], d(f))"
    )
    outputs = {
        subprocess.run(
            [sys.executable, "-c", code], env={**os.environ, "PYTHONHASHSEED": seed}, check=True, capture_output=True
        ).stdout
        for seed in ("0", "1", "2")
    }
    assert len(outputs) == 1
