"""Faults: the changes of a source, how one is planted in a running process, and which statements tests execute."""

from __future__ import annotations

import ast
import contextlib
import functools
import gc
import math
import random
import sys
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
#: groups of parts, and the files and folders of each part, in which faults are planted: a sample is one of a group
GROUPS: dict[str, dict[str, tuple[str, ...]]] = {
    "numerics": {
        "physics": ("physics",), "uncertainty": ("runs/uncertainty",), "observables": ("observables",),
        "deck": ("lmp/deck.py",), "judging": ("judging",),
    },
    "services": {
        "ensembles": ("ensembles",), "exports": ("formats/tables", "formats/writers.py", "scene/file/scene_csv.py"),
        "planning": ("runs/planning",), "campaign": ("runs/campaign",), "measurement": ("studies/measurement",),
        "figures": (
            "plot.py", "report/drawing.py", "report/page.py", "verification/figures.py",
            "report/drawing_styles.py", "report/styles.py", "verification/panels.py",
        ),
        "keys": ("runs/cache.py", "runs/case.py", "runs/keys.py"),
    },
}  # fmt: skip
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
    ...     with mutated(text, k) as (_, line, _, _):
    ...         print(line)
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


@functools.cache
def _parsed(text: str) -> tuple[ast.Module, list[Change]]:
    tree = ast.parse(text)
    return tree, list(changes(tree))


@contextlib.contextmanager
def mutated(text: str, index: int) -> Iterator[tuple[ast.Module, str, int, str]]:
    """Yield the tree with a change, the first changed line of the text, its number, and that line before.

    >>> with mutated("y = [x for x in (a if b else c)]", 0) as (_, line, number, _):
    ...     print(number, line)
    1 y = [x for x in (a if not b else c)]
    """
    tree, every = _parsed(text)
    node, field, place, new = every[index]
    holder: Any
    key: Any
    holder, key = (vars(node), field) if place is None else (getattr(node, field), place)
    old = holder[key]
    # that of the whole, or of its part where the whole has none, such as the loop of a comprehension
    line: int = next(filter(None, (getattr(each, "lineno", 0) for each in (node, new, old))))
    around = next(each for each in tree.body if each.lineno <= line <= (each.end_lineno or 0))
    before = ast.unparse(around).splitlines()
    holder[key] = new
    ast.fix_missing_locations(tree)
    after = ast.unparse(around).splitlines()
    changed = next((pair for pair in zip(before, after, strict=False) if pair[0] != pair[1]), ("", ""))
    try:
        yield tree, changed[1].strip(), line, changed[0].strip()
    finally:
        holder[key] = old


def targets(group: str, part: str = "") -> list[str]:
    """Return the files of a group in which faults are planted, or those of one of its parts."""
    places = [
        ROOT / "dem_bridge" / each for name, of_part in GROUPS[group].items() if part in ("", name) for each in of_part
    ]
    files = [file for place in places for file in (sorted(place.rglob("*.py")) if place.is_dir() else [place])]
    return [str(file.relative_to(ROOT)) for file in files]


@functools.cache
def _every_change(group: str) -> list[tuple[str, int]]:
    texts = {file: (ROOT / file).read_text(encoding="utf-8") for file in targets(group)}
    return [(file, k) for file, text in texts.items() for k in range(len(_parsed(text)[1]))]


def sample(count: int, seed: int, group: str = "numerics", files: Collection[str] | None = None) -> dict[int, Mutant]:
    """Return a seeded sample of all changes of a group by number, or those of the sample that are in some files.

    A smaller count is the beginning of a larger one.
    """
    every = list(_every_change(group))
    random.Random(seed).shuffle(every)
    chosen = {}
    for number, (file, index) in enumerate(every[:count]):
        if files is None or file in files:
            with mutated((ROOT / file).read_text(encoding="utf-8"), index) as (_, after, line, before):
                chosen[number] = Mutant(file, index, line, before, after)
    return chosen


def lines_of(text: str, line: int) -> range:
    """Return the lines of the innermost statement around a line, or none where it is executed by an import.

    >>> text = "A = 1\\ndef f(x=2):\\n    if (x or\\n            A):\\n        return 1\\n    return 0"
    >>> [list(lines_of(text, line)) for line in range(1, 7)]
    [[], [], [3, 4], [3, 4], [5], [6]]
    """
    lines = range(0)
    for function in ast.walk(ast.parse(text)):
        if isinstance(function, ast.FunctionDef) and function.body[0].lineno <= line <= (function.end_lineno or 0):
            for node in ast.walk(function):
                if isinstance(node, ast.stmt) and node is not function and node.lineno <= line:
                    body = getattr(node, "body", None) or getattr(node, "cases", None)
                    last = body[0].lineno - 1 if isinstance(body, list) and body else node.end_lineno or 0
                    lines = range(node.lineno, last + 1) if line <= last else lines
    return lines


class Live:
    """What a process has loaded: functions by their file, compiled kernels and caches; made once, before the forks."""

    def __init__(self) -> None:
        from dem_bridge.foundation.compiled import Kernel

        gc.unfreeze()  # conftest.py froze what was collected
        objects = gc.get_objects()
        gc.freeze()
        ours = [each for each in objects if str(getattr(each, "__module__", "")).startswith(("dem_bridge", "tests"))]
        self.functions = [each for each in ours if isinstance(each, FunctionType)]
        self.kernels = [each for each in objects if isinstance(each, Kernel)]
        self._caches = [each for each in ours if isinstance(each, functools._lru_cache_wrapper)]

    def callers(self, kernels: Sequence[Any]) -> list[Any]:
        """Return kernels with all that call them, directly or through others: these have inlined their code."""
        reached = {id(kernel): kernel for kernel in kernels}
        while True:
            others = [kernel for kernel in self.kernels if id(kernel) not in reached]
            named = {id(k): map(k.py_func.__globals__.get, k.py_func.__code__.co_names) for k in others}
            new = [kernel for kernel in others if any(id(value) in reached for value in named[id(kernel)])]
            if not new:
                return list(reached.values())
            reached |= {id(kernel): kernel for kernel in new}

    def forget_results(self) -> None:
        """Empty the caches of all functions, because they hold what the code without a fault returned."""
        for cache in self._caches:
            cache.cache_clear()

    def swap(self, codes: dict[CodeType, CodeType]) -> None:
        """Give all functions with one of the codes its successor."""
        files = {code.co_filename for code in codes}
        for each in self.functions:
            if each.__code__.co_filename in files:
                each.__code__ = codes.get(each.__code__, each.__code__)


def plant(mutant: Mutant, live: Live) -> None:
    """Give the functions and constants of a module their changed code and values, in this process."""
    path = ROOT / mutant.file
    text = path.read_text(encoding="utf-8")
    before = _codes(compile(text, str(path), "exec", dont_inherit=True))
    with mutated(text, mutant.index) as (tree, *_):
        after = _codes(compile(tree, str(path), "exec", dont_inherit=True))
        around = [each for each in tree.body if each.lineno <= mutant.line <= (each.end_lineno or 0)]
        statement = compile(ast.Module(around[:1], []), str(path), "exec", dont_inherit=True)
    changed = {old: new for old, new in zip(before, after, strict=True) if old != new}
    module = sys.modules[_module(mutant.file)]
    live.swap(changed)
    if stale := live.callers([kernel for kernel in live.kernels if kernel.py_func.__code__ in changed.values()]):
        import numba

        for kernel in stale:  # compiled code of the right one must not be used
            vars(kernel).pop("compiled", None)
        numba.njit = functools.partial(lambda njit, cache, nogil: njit(nogil=nogil), numba.njit)
    if not lines_of(text, mutant.line):  # executed by the import
        names = dict(vars(module))
        exec(statement, names)
        for name, value in names.items():
            if name != "__builtins__" and value is not vars(module).get(name):
                _replace(vars(module).get(name), value, name)
    live.forget_results()


def _module(file: str) -> str:
    return file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")


def _codes(code: CodeType) -> list[CodeType]:
    return [code, *(inner for each in code.co_consts if isinstance(each, CodeType) for inner in _codes(each))]


def _replace(old: Any, new: Any, name: str) -> None:
    """Hand defaults of a function, values of a class, or another value over to all that use the old one."""
    old, new = (getattr(each, "__wrapped__", each) for each in (old, new))
    if isinstance(new, FunctionType):
        old.__defaults__, old.__kwdefaults__ = new.__defaults__, new.__kwdefaults__
    elif isinstance(new, type):
        for key, value in vars(new).items():
            new_value, old_value = (getattr(each, "__func__", each) for each in (value, vars(old)[key]))
            if isinstance(new_value, FunctionType):  # that of a named tuple is static
                _replace(old_value, new_value, key)
            elif not key.startswith("__"):
                with contextlib.suppress(AttributeError):
                    setattr(old, key, value)
    else:
        for module in list(sys.modules.values()):
            if getattr(module, "__dict__", {}).get(name, module) is old:
                setattr(module, name, new)


#: place of a file's lines where a test calls compiled functions without the compiler, which would take seconds
INTERPRETED = ("interpreted", 0)


class Statements:
    """Notes which statements in functions of the targets run: a call before each of them adds its file and line."""

    def __init__(self) -> None:
        self.seen: set[tuple[str, int]] = set()

    def watch(self, live: Live, files: Sequence[str]) -> None:
        """Give all functions of some files code with these calls, in this process; compiled ones count as a whole."""
        from dem_bridge.foundation.compiled import Kernel

        compiled = {kernel.py_func.__code__: kernel.__module__ for kernel in live.kernels}
        lines: dict[str, set[tuple[str, int]]] = {name: set() for name in compiled.values()}
        for code, name in compiled.items():
            file = str(Path(code.co_filename).relative_to(ROOT))
            lines[name].update((file, line) for *_, line in code.co_lines() if line)
        noted: dict[CodeType, CodeType] = {}
        for file in [each for each in files if _module(each) in sys.modules]:
            text = (ROOT / file).read_text(encoding="utf-8")
            tree = ast.parse(text)
            _insert_notes(tree, file, inside=False)
            ast.fix_missing_locations(tree)
            path = str(ROOT / file)
            plain, watched = (
                _codes(compile(each, path, "exec", dont_inherit=True)) for each in (ast.parse(text), tree)
            )
            noted |= {old: new for old, new in zip(plain, watched, strict=True) if old not in compiled}
            vars(sys.modules[_module(file)])["__note__"] = self.seen.add
        live.swap(noted)
        call, interpret = Kernel.__call__, Kernel.interpret

        def noting(kernel: Any, *arguments: Any) -> Any:
            self.seen |= lines[kernel.__module__]
            return call(kernel, *arguments)

        def interpreting(kernel: Any, *arguments: Any) -> Any:
            self.seen |= {*lines[kernel.__module__], INTERPRETED}
            return interpret(kernel, *arguments)

        setattr(Kernel, "__call__", noting)  # noqa: B010
        setattr(Kernel, "interpret", interpreting)  # noqa: B010


def _insert_notes(node: ast.AST, file: str, *, inside: bool) -> None:
    inside = inside or isinstance(node, ast.FunctionDef)
    for _, value in ast.iter_fields(node):
        for each in value if isinstance(value, list) else []:
            if isinstance(each, ast.AST):
                _insert_notes(each, file, inside=inside)
        if inside and isinstance(value, list) and value and isinstance(value[0], ast.stmt):
            notes = [ast.parse(f"__note__(({file!r}, {each.lineno}))").body[0] for each in value]
            value[:] = [each for pair in zip(notes, value, strict=True) for each in pair]
