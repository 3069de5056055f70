"""Which module names which other one, and what follows for the rooms of the package.

A room is a package directly below the package, or a loose module directly in it. A module names another one

statement  by an import, also within a function and for type checkers alone; a public name that is taken from the
           package itself is the module from which ``__init__.pyi`` has it
string     by a text of code that is a dotted name of the package, such as ``import_module("dem_bridge.x")``,
           ``"dem_bridge.x.y:f"``, or an f-string that begins so; not in docstrings
data       by a text in a JSON or TOML file, which counts for the room of the file

What follows "-m" in a list is a program that is started and not an import; :func:`programs` lists these.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from graphlib import TopologicalSorter
from pathlib import Path

from house_source import Module

WAYS = ("statement", "string", "data")
#: a dotted name, with or without the name of a function
_DOTTED = r"\.\w+(?:\.\w+)*"
Graph = dict[str, set[str]]


@dataclass(frozen=True)
class Naming:
    """One module that names another one."""

    source: str
    target: str
    way: str


def namings(package: Path, modules: Mapping[str, Module]) -> set[Naming]:
    """Return all that modules and data files of a package name."""
    found, homes = set[Naming](), public_homes(package)
    for module in modules.values():
        if module.name == package.name:  # the facade imports by name when asked, for everybody
            continue
        found |= {Naming(module.name, name, "statement") for name in _imported(module, modules, homes)}
        texts = {_resolved(text, modules) for text, started in _texts(module, package.name) if not started}
        found |= {Naming(module.name, name, "string") for name in texts if name is not None}
    for file in (file for suffix in ("json", "toml") for file in package.rglob(f"*.{suffix}")):
        # a text of code that names its folder (to read another file there) does not name what the file names
        source = ".".join(file.relative_to(package.parent).parts)
        for text in re.findall(rf'["\']({package.name}{_DOTTED})[:"\']', file.read_text(encoding="utf-8")):
            if (name := _resolved(text, modules)) is not None and file.parent != package:
                found.add(Naming(source, name, "data"))
    return {naming for naming in found if naming.source != naming.target}


def programs(package: str, modules: Mapping[str, Module]) -> list[str]:
    """Return the modules that others start as programs, as "who: what"."""
    return sorted(
        f"{name}: {text}" for name, module in modules.items() for text, started in _texts(module, package) if started
    )


def public_homes(package: Path) -> dict[str, str]:
    """Return the modules of the names that the package itself offers, from its stub; empty where there is none."""
    stub = package / "__init__.pyi"
    text = stub.read_text(encoding="utf-8") if stub.is_file() else ""
    return {name: home for home, name in re.findall(r"^from (\S+) import (\w+)", text, re.MULTILINE)}


def room_of(module: str) -> str:
    """Return the room of a module.

    >>> room_of("tiny.runs.store"), room_of("tiny.errors")
    ('runs', 'errors')
    """
    return module.split(".")[1]


def graph_of(found: Iterable[Naming], ways: Iterable[str] = WAYS) -> Graph:
    """Return who names whom, module by module."""
    graph, allowed = Graph(), set(ways)
    for naming in found:
        if naming.way in allowed:
            graph.setdefault(naming.source, set()).add(naming.target)
    return graph


def graph_of_rooms(graph: Mapping[str, set[str]]) -> Graph:
    """Return which room names which other room."""
    rooms = Graph()
    for source, targets in graph.items():
        rooms.setdefault(room_of(source), set()).update(map(room_of, targets))
    return {room: others - {room} for room, others in rooms.items()}


def components(graph: Mapping[str, set[str]]) -> list[set[str]]:
    """Return the strongly connected components.

    >>> sorted(map(sorted, components({"a": {"b"}, "b": {"c"}, "c": {"b"}})))
    [['a'], ['b', 'c']]
    """
    reach = {name: _reached(graph, name) for name in {*graph, *(name for some in graph.values() for name in some)}}
    found: dict[str, set[str]] = {}
    for name, others in reach.items():
        if name not in found:
            component = {name} | {other for other in others if name in reach[other]}
            found |= dict.fromkeys(component, component)
    return list({id(component): component for component in found.values()}.values())


def circles(graph: Mapping[str, set[str]]) -> list[list[str]]:
    """Return the components of more than one member, the largest first."""
    return sorted((sorted(one) for one in components(graph) if len(one) > 1), key=lambda one: (-len(one), one))


def floors(graph: Mapping[str, set[str]]) -> int:
    """Return the number of floors: the longest chain of components, of which each names the next.

    >>> floors({"a": {"b"}, "b": {"c"}, "c": {"b", "d"}})
    3
    """
    home = {name: number for number, one in enumerate(components(graph)) for name in one}
    above: dict[int, set[int]] = {number: set() for number in home.values()}
    for source, targets in graph.items():
        above[home[source]] |= {home[target] for target in targets} - {home[source]}
    height: dict[int, int] = {}
    for number in TopologicalSorter(above).static_order():
        height[number] = 1 + max((height[other] for other in above[number]), default=0)
    return max(height.values(), default=0)


def _reached(graph: Mapping[str, set[str]], start: str) -> set[str]:
    waiting, reached = [start], set[str]()
    while waiting:
        for other in graph.get(waiting.pop(), set()) - reached:
            reached.add(other)
            waiting.append(other)
    return reached


def _resolved(text: str, modules: Mapping[str, Module]) -> str | None:
    """Return the module that a dotted name begins with; None for the package itself and for what is none."""
    parts = text.partition(":")[0].strip(".").split(".")
    names = (".".join(parts[:count]) for count in range(len(parts), 1, -1))
    return next((name for name in names if name in modules), None)


def _imported(module: Module, modules: Mapping[str, Module], homes: Mapping[str, str]) -> Iterator[str]:
    """Yield the modules of the package that statements import."""
    package, facade = module.name.split(".")[0], _facade(module)
    for node in module.nodes:
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = module.package.split(".")[: len(module.package.split(".")) + 1 - node.level] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            names = [f"{base}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            names = [f"{package}.{node.attr}"] if node.value.id in facade else []
        else:
            continue
        for name in names:
            first, _, public = name.partition(".")
            if first == package and (target := _resolved(homes.get(public, name), modules)) is not None:
                yield target


def _facade(module: Module) -> set[str]:
    """Return under which names a module has the package itself."""
    package = module.name.split(".")[0]
    imports = (node for node in module.nodes if isinstance(node, ast.Import))
    return {alias.asname or alias.name for node in imports for alias in node.names if alias.name == package}


def _texts(module: Module, package: str) -> Iterator[tuple[str, bool]]:
    """Yield dotted names of the package in texts of code, and whether each is that of a program that is started."""
    started = {
        id(after)
        for node in module.nodes
        if isinstance(node, ast.List | ast.Tuple)
        for before, after in zip(node.elts, node.elts[1:], strict=False)
        if isinstance(before, ast.Constant) and before.value == "-m"
    }
    for node in module.nodes:
        if isinstance(node, ast.JoinedStr) and node.values and isinstance(node.values[0], ast.Constant):
            text = str(node.values[0].value)
            # what follows is unknown: the part up to the last dot is certain
            if re.fullmatch(rf"{package}(\.\w*)+", text) and len(node.values) > 1:
                yield text.rpartition(".")[0], id(node) in started
        elif (
            isinstance(node, ast.Constant)
            and re.fullmatch(rf"{package}{_DOTTED}(:[\w.]+)?", str(node.value))
            and node.lineno not in module.docstrings
        ):
            yield str(node.value), id(node) in started
