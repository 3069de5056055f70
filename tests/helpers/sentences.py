"""Compare the fields of sentences with the values that the code gives them, from the source alone: nothing is run.

A call that names its text and its values gives exactly these. Where a text or its values are chosen at run time, each
field must be a name that the modules of the page use: a keyword, a key of a dict, or an attribute of a class.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from string import Formatter
from typing import Any

#: methods of Texts that fill a text -> kind of the text
KINDS = {"": "sentences", "table": "tables", "panel": "panels", "figure": "figures", "verdict": "verdicts"}


def fields_of(text: Any) -> set[str]:
    """Return the fields of a text, or of all texts of a list or mapping."""
    if isinstance(text, str):
        return {name for _, name, _, _ in Formatter().parse(text) if name is not None}
    items = text.values() if isinstance(text, Mapping) else text if isinstance(text, list) else ()
    return {field for item in items for field in fields_of(item)}


@dataclass(frozen=True)
class Call:
    """A call that fills texts of a page."""

    where: str
    page: str
    kind: str
    keys: frozenset[str]
    """Empty: chosen at run time."""
    values: frozenset[str] | None
    """None: chosen at run time."""


class Source:
    """A module: the pages that it names, the names that it uses, and its calls."""

    def __init__(self, text: str, name: str) -> None:
        self.name, self.tree = name.removesuffix(".__init__"), ast.parse(text)
        #: the package of a study of several modules; a module of a room stands alone
        self.folder = ".".join(name.split(".")[:3])
        self.pages = {
            _name(node.targets[0]): str(call.args[0].value)
            for node in self.tree.body
            if isinstance(node, ast.Assign)
            for call in ast.walk(node.value)
            if isinstance(call, ast.Call) and _name(call.func) == "Texts" and isinstance(call.args[0], ast.Constant)
        }
        self.imported = {
            alias.asname or alias.name: (node.module, alias.name)
            for node in ast.walk(self.tree)
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
        }

    @cached_property
    def names(self) -> set[str]:
        """Return keywords, keys of dicts, attributes of classes and names of functions."""
        found: set[str | None] = set()
        for node in ast.walk(self.tree):
            if isinstance(node, ast.keyword | ast.arg):
                found.add(node.arg)
            elif isinstance(node, ast.Dict):
                found |= {str(key.value) for key in node.keys if isinstance(key, ast.Constant)}
            elif isinstance(node, ast.AnnAssign | ast.FunctionDef):
                found.add(node.name if isinstance(node, ast.FunctionDef) else _name(node.target))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.isidentifier():
                found.add(node.value)
        return {name for name in found if name}

    def calls(self, pages: Mapping[str, str]) -> Iterator[Call]:
        """Yield the calls that fill texts of ``pages``: name of a Texts in this module -> page."""
        for function in (node for node in ast.walk(self.tree) if isinstance(node, ast.FunctionDef)):
            for node in ast.walk(function):
                if not (isinstance(node, ast.Call) and node.args):
                    continue
                of, method = (
                    (_name(node.func.value), node.func.attr) if isinstance(node.func, ast.Attribute)
                    else (_name(node.func), "")
                )  # fmt: skip
                if of in pages and method in KINDS:
                    where = f"{self.name}, line {node.lineno}"
                    kind = KINDS[method]
                    if not method and len(node.args) > 1:
                        kind = "".join(_keys(node.args[1]))
                    yield Call(where, pages[of], kind, _keys(node.args[0]), _values(node, function))


def _name(node: ast.AST) -> str:
    return node.id if isinstance(node, ast.Name) else ""


def _keys(node: ast.AST) -> frozenset[str]:
    """Return the texts that an expression may be."""
    if isinstance(node, ast.IfExp):
        one, other = _keys(node.body), _keys(node.orelse)
        return one | other if one and other else frozenset()
    return frozenset({str(node.value)}) if isinstance(node, ast.Constant) else frozenset()


def _values(call: ast.Call, function: ast.FunctionDef) -> frozenset[str] | None:
    """Return the names of the values of a call; ``**name`` is what the function binds the name to."""
    found: set[str] = set()
    for word in call.keywords:
        if word.arg is not None:
            found.add(word.arg)
            continue
        bound = [
            node.value
            for node in ast.walk(function)
            if isinstance(node, ast.Assign | ast.AnnAssign | ast.AugAssign)
            and _name(word.value)
            in {_name(target) for target in getattr(node, "targets", [getattr(node, "target", node)])}
        ]
        if not bound or not all(isinstance(value, ast.Dict) for value in bound):
            return None
        keys = [key for value in bound for key in value.keys]  # type: ignore[union-attr]
        if not all(isinstance(key, ast.Constant) for key in keys):
            return None
        found |= {str(key.value) for key in keys}
    return frozenset(found)


class Code:
    """All calls that fill texts, and the names that the modules of each page use."""

    def __init__(self, sources: Sequence[Source]) -> None:
        made = {(source.name, name): page for source in sources for name, page in source.pages.items()}
        self.names: set[str] = {name for source in sources for name in source.names}
        self.calls: list[Call] = []
        self.names_of: dict[str, set[str]] = {page: set() for page in made.values()}
        for source in sources:
            pages = source.pages | {name: made[origin] for name, origin in source.imported.items() if origin in made}
            self.calls += source.calls(pages)
            together = {name for other in sources if other.folder == source.folder for name in other.names if pages}
            for page in pages.values():
                self.names_of[page] |= together

    def unknown_fields(self, page: str, content: Mapping[str, Any]) -> Iterator[str]:
        """Yield a line for each field of a page that no value has."""
        for group, entries in content.items():
            for key, text in entries.items() if isinstance(entries, Mapping) else [("", entries)]:
                calls = [
                    call for call in self.calls
                    if (call.page, call.kind) == (page, group) and key in call.keys and call.values is not None
                ]  # fmt: skip
                for field in fields_of(text):
                    first, *rest = field.replace("[", ".").replace("]", "").split(".")
                    for call in calls:
                        if first not in (call.values or ()):
                            yield f"{page}.toml, {group}.{key}: {{{field}}} has no value in {call.where}"
                    known = self.names.issuperset(part for part in rest if not part.isdigit())
                    if first not in self.names_of[page] or not known:
                        yield f"{page}.toml, {group}.{key}: {{{field}}} is no name in the code of this page"
