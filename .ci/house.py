"""Count how the package is built: ``make house``, ``python .ci/house.py --checkout BEFORE --checkout .``.

A line of code is neither blank nor a comment or docstring alone. A circle is a group of rooms (or modules) each of
which names each other one, directly or through others; ``house_graph.py`` says what a room and a naming are. Kernels
are the functions that numba compiles. A private function is called by a test where its name begins with one
underscore, the package defines it and no test does; names of protocols such as ``_repr_html_`` are public. A
monkeypatch is a call of ``setattr``, ``delattr``, ``setitem`` or ``delitem`` of a fixture, or of ``mock.patch``;
variables of the environment are not counted. Modules that are imported by one
other are no ``__init__``. Only text is read.
"""

from __future__ import annotations

import argparse
import ast
import json
import re
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from house_graph import WAYS, circles, floors, graph_of, graph_of_rooms, namings, programs, room_of
from house_source import Module, is_kernel, is_typed, read_modules

#: most lines of code of a function, of a kernel and of a class
FUNCTION, KERNEL, CLASS = 60, 100, 300
_PATCHES = {"setattr", "delattr", "setitem", "delitem"}


@dataclass(frozen=True)
class Count:
    """One number, and what it counts where that can be listed."""

    number: int
    members: Sequence[str] = field(default=(), repr=False)

    @classmethod
    def of(cls, members: Sequence[str]) -> Count:
        return cls(len(members), members)


def count_rooms(package: Path, modules: Mapping[str, Module]) -> dict[str, Count]:
    """Count rooms, what they name of each other, and the circles of it."""
    rooms = {room_of(name) for name in modules if name != package.name}
    loose = sorted(room for room in rooms if (package / f"{room}.py").is_file() and room != "__main__")
    found = namings(package, modules)
    whole, stated = graph_of(found), graph_of(found, WAYS[:1])
    arrows, by_statement = graph_of_rooms(whole), graph_of_rooms(stated)
    in_words = graph_of_rooms(graph_of(found, WAYS[:2]))
    unstated = [f"{a} -> {b}" for a, others in arrows.items() for b in others - by_statement.get(a, set())]
    importers = Counter(name for targets in stated.values() for name in targets)
    once = [name for name, times in importers.items() if times == 1 and modules[name].file.name != "__init__.py"]
    return {
        "rooms": Count.of(sorted(rooms)),
        "loose modules": Count.of(loose),
        "floors": Count(floors(arrows)),
        "floors by statements alone": Count(floors(by_statement)),
        "arrows between rooms": Count.of(sorted(f"{a} -> {b}" for a, others in arrows.items() for b in others)),
        "arrows in strings and data alone": Count.of(sorted(unstated)),
        "circles of rooms": Count.of([" ".join(one) for one in circles(arrows)]),
        "circles of rooms without data files": Count.of([" ".join(one) for one in circles(in_words)]),
        "circles of rooms by statements alone": Count.of([" ".join(one) for one in circles(by_statement)]),
        "rooms in circles": Count(sum(map(len, circles(arrows)))),
        "circles of modules": Count.of([" ".join(one) for one in circles(whole)]),
        "programs that are started": Count.of(programs(package.name, modules)),
        "modules with one importer": Count.of(sorted(once)),
    }


def count_sizes(modules: Mapping[str, Module]) -> dict[str, Count]:
    """Count lines, and what is too long or not typed."""
    every = modules.values()
    functions = [(module, node) for module in every for node in module.functions]
    plain = [(module, node) for module, node in functions if not is_kernel(node)]
    kernels = [(module, node) for module, node in functions if is_kernel(node)]
    classes = [(module, node) for module in every for node in module.classes]

    def above(
        most: int, nodes: Sequence[tuple[Module, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef]]
    ) -> Count:
        sizes = [(module.size(node), f"{module.name}.{node.name}") for module, node in nodes]
        return Count.of([f"{name} {size}" for size, name in sorted(sizes, reverse=True) if size > most])

    ignored = [module.name for module in every for text in module.comments if re.search(r"type:\s*ignore", text)]
    names = [module.name for module in every for node in module.nodes if _is_any(node)]
    return {
        "modules": Count(len(modules)),
        "lines of code": Count(sum(len(module.code) for module in every)),
        "statements": Count(sum(module.statements for module in every)),
        "lines of docstrings": Count(sum(len(module.docstrings) for module in every)),
        "modules above 350 lines": Count.of([one.name for one in every if len(one.text.splitlines()) > 350]),
        f"functions above {FUNCTION} lines": above(FUNCTION, plain),
        f"kernels above {KERNEL} lines": above(KERNEL, kernels),
        f"classes above {CLASS} lines": above(CLASS, classes),
        "kernels": Count(len(kernels)),
        "untyped kernels": Count.of([f"{module.name}.{node.name}" for module, node in kernels if not is_typed(node)]),
        "type: ignore": Count.of(ignored),
        "Any": Count.of(names),
    }


def count_tests(tests: Mapping[str, Module], modules: Mapping[str, Module]) -> dict[str, Count]:
    """Count what ties tests to private parts, in total; :func:`by_folder` has it folder by folder."""
    private = {node.name for module in modules.values() for node in module.functions if _is_private(node.name)}
    calls = [module.name for module in tests.values() for _ in private_calls(module, private)]
    patches = [(module.name, name) for module in tests.values() for name in patched(module)]
    return {
        "lines of code of tests": Count(sum(len(module.code) for module in tests.values())),
        "calls of private functions in tests": Count.of(calls),
        "monkeypatches in tests": Count.of([name for name, _ in patches]),
        "monkeypatches of private names in tests": Count.of([name for name, what in patches if _is_private(what)]),
    }


def private_calls(module: Module, private: set[str]) -> Iterator[str]:
    """Yield the private functions of the package that a test calls, one for each call."""
    own = {node.name for node in module.functions} | _names_of_tests(module) | _assigned(module)
    for node in module.nodes:
        if isinstance(node, ast.Call):
            target = node.func
            if isinstance(target, ast.Attribute) and target.attr in private:
                if not (
                    isinstance(target.value, ast.Name) and target.value.id in ("self", "cls") and target.attr in own
                ):
                    yield target.attr
            elif isinstance(target, ast.Name) and target.id in private - own:
                yield target.id


def _names_of_tests(module: Module) -> set[str]:
    """Return the names that a test imports from other tests."""
    froms = [node for node in module.nodes if isinstance(node, ast.ImportFrom)]
    ours = [node for node in froms if node.level or (node.module or "").partition(".")[0] == "tests"]
    return {alias.asname or alias.name for node in ours for alias in node.names}


def _assigned(module: Module) -> set[str]:
    """Return the names to which a module assigns, such as partial functions."""
    targets = [target for node in module.tree.body if isinstance(node, ast.Assign) for target in node.targets]
    return {target.id for target in targets if isinstance(target, ast.Name)}


def patched(module: Module) -> Iterator[str]:
    """Yield the names that a test patches, "" where they are not in the text."""
    for node in module.nodes:
        if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
            continue
        owner = node.func.value
        of_mock = node.func.attr == "patch" or (isinstance(owner, ast.Attribute | ast.Name) and _last(owner) == "patch")
        if (node.func.attr in _PATCHES and not isinstance(owner, ast.Constant)) or (
            of_mock and _last(owner) != "patch"
        ):
            texts = [one.value for one in node.args if isinstance(one, ast.Constant) and isinstance(one.value, str)]
            yield texts[0].rpartition(".")[2] if texts else ""


def by_folder(counts: Mapping[str, Count]) -> dict[str, dict[str, int]]:
    """Return the calls of private functions and the monkeypatches of each folder of tests.

    >>> by_folder({"monkeypatches in tests": Count.of(["tests.lmp.test_a", "tests.test_b"])})
    {'lmp': {'monkeypatches in tests': 1}, '(tests)': {'monkeypatches in tests': 1}}
    """
    folders: dict[str, dict[str, int]] = {}
    for name in ("calls of private functions in tests", "monkeypatches in tests"):
        for module in counts.get(name, Count(0)).members:
            parts = module.split(".")
            folder = folders.setdefault(parts[1] if len(parts) > 2 else "(tests)", {})
            folder[name] = folder.get(name, 0) + 1
    return folders


def count(checkout: Path) -> dict[str, Count]:
    """Return all counts of a checkout, in the order in which they are printed."""
    package, tests = checkout / "dem_bridge", checkout / "tests"
    if not package.is_dir():
        raise SystemExit(f"--checkout {checkout}: has no folder dem_bridge; give the root of a checkout")
    modules = read_modules(package)
    sizes, rooms = count_sizes(modules), count_rooms(package, modules)
    return {**sizes, **rooms, **count_tests(read_modules(tests), modules)}


def table(columns: Mapping[str, Mapping[str, int]]) -> str:
    """Return counts as a table of Markdown, a column for each checkout.

    >>> print(table({"before": {"rooms": 54}, "after": {"rooms": 21, "floors": 11}}))
    | | before | after |
    |---|---:|---:|
    | rooms | 54 | 21 |
    | floors | - | 11 |
    """
    names = dict.fromkeys(name for column in columns.values() for name in column)
    lines = [f"| | {' | '.join(columns)} |", f"|---|{'---:|' * len(columns)}"]
    cells = ([str(column.get(name, "-")) for column in columns.values()] for name in names)
    return "\n".join([*lines, *(f"| {name} | {' | '.join(row)} |" for name, row in zip(names, cells, strict=True))])


def _is_private(name: str) -> bool:
    return name.startswith("_") and not name.startswith("__") and not name.endswith("_")


def _is_any(node: ast.AST) -> bool:
    return isinstance(node, ast.Name | ast.Attribute) and _last(node) == "Any"


def _last(node: ast.AST) -> str:
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def main() -> int:
    """Print the counts of the checkouts."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--checkout", type=Path, action="append", metavar="DIR", help="root; several: default this one")
    parser.add_argument("--list", metavar="COUNT", help="what one count counts, such as 'circles of rooms'")
    parser.add_argument("--folders", action="store_true", help="private calls and monkeypatches by folder of tests")
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args()
    roots = [root.resolve() for root in options.checkout or [Path(__file__).parent.parent]]
    counts = {f"{number} {root.name}": count(root) for number, root in enumerate(roots, 1)}
    if options.list is not None:
        for name, found in counts.items():
            if options.list not in found:
                parser.error(f"--list {options.list!r}; allowed: {', '.join(found)}")
            print(f"{name}:", *found[options.list].members, sep="\n  ")
        return 0
    numbers = {name: {key: one.number for key, one in found.items()} for name, found in counts.items()}
    if options.folders:
        folders = {name: sorted(by_folder(found).items()) for name, found in counts.items()}
        numbers = {
            name: {f"{f}: {k}": n for f, these in some for k, n in these.items()} for name, some in folders.items()
        }
    print(json.dumps(numbers, indent=1) if options.json else table(numbers))
    return 0


if __name__ == "__main__":
    sys.exit(main())
