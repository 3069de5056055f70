"""Checks of the types of arguments against the annotations of public functions, before anything is computed."""

from __future__ import annotations

import ast
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
from inspect import Parameter, signature
from pathlib import Path
from typing import Any

from dem_bridge.errors import UsageError, shown
from dem_bridge.foundation.numbers import KINDS, is_number

#: longest name of a file, in bytes
_LONGEST_NAME = 255
#: names of annotations that stand for others
_ALIASES = {
    "AxisRatio": "str",
    "File": "str | Path | tuple[Any, ...]",
    "Floats": "Any",
    "Numbers": "Iterable[float] | float",
    "Progress": "Callable[[float, int, str], None]",
}
_WORDS = {
    "bool": "True or False",
    "Callable": "a function",
    "Executor": "a concurrent.futures.Executor",
    "float": "a number",
    "int": "a whole number",
    "Iterable": "a list",
    "Mapping": "a mapping",
    "None": "None",
    "Path": "the path of a file",
    "Sequence": "a list",
    "str": "text",
    "tuple": "a tuple",
}


def check_arguments(function: Callable[..., Any], values: Mapping[str, Any]) -> None:
    """Raise UsageError if an argument is not of the type of its annotation.

    Ranges of numbers are left to the function. Keywords that it takes as ``**settings`` are not checked.

    Parameters
    ----------
    function : callable
        Function whose annotations are strings, or a dataclass.
    values : mapping
        Value of each argument, such as ``locals()`` at its beginning.

    Raises
    ------
    UsageError

    Examples
    --------
    >>> def move(distance: float, *, times: Sequence[float] | None = None): check_arguments(move, locals())
    >>> move(1, times=[0.5])
    >>> move(1.0, times="0.5")
    Traceback (most recent call last):
    dem_bridge.errors.UsageError: times = '0.5'; allowed: a list, or None
    """
    for name, annotation in _annotations(function).items():
        if not _fit(annotation, values[name]):
            words = dict.fromkeys(kind.words for kind in annotation)
            raise UsageError(f"{name} = {shown(values[name])}; allowed: {', or '.join(words)}")


class _Kind:
    """One of the types that an annotation allows: its name and the types of its parts."""

    def __init__(self, node: ast.expr) -> None:
        inner: Any = node.slice if isinstance(node, ast.Subscript) else None
        self.name = ast.unparse(node.value if isinstance(node, ast.Subscript) else node)
        parts = inner.elts if isinstance(inner, ast.Tuple) else [inner] if inner is not None else []
        self.parts = () if self.name in ("Callable", "Literal") else tuple(map(_kinds, parts))
        self.words = _WORDS.get(self.name) or f"{'an' if self.name[0] in 'AEIOU' else 'a'} {self.name}"


@lru_cache(maxsize=256)
def _annotations(function: Callable[..., Any]) -> dict[str, tuple[_Kind, ...]]:
    """Return the types of each parameter."""
    return {
        name: _kinds(ast.parse(parameter.annotation, mode="eval").body)
        for name, parameter in signature(function).parameters.items()
        if isinstance(parameter.annotation, str) and parameter.kind is not Parameter.VAR_KEYWORD
    }


def _kinds(node: ast.expr) -> tuple[_Kind, ...]:
    """Return the types that an annotation joins by "|"."""
    if isinstance(node, ast.BinOp):
        return _kinds(node.left) + _kinds(node.right)
    if isinstance(node, ast.Name) and node.id in _ALIASES:
        return _kinds(ast.parse(_ALIASES[node.id], mode="eval").body)
    return (_Kind(node),)


def _fits(kind: _Kind, value: Any) -> bool:
    """Return True if a value is of a type."""
    match kind.name:
        case "Any" | "object" | "..." | "Ellipsis":
            return True
        case "None":
            return value is None
        case "bool":
            return isinstance(value, bool)
        case "str" | "Literal":
            return isinstance(value, str)
        case "float" | "int":
            return is_number(value, whole=kind.name == "int")
        case "Path":
            return isinstance(value, str | Path) and is_path(value)
        case "Callable":
            return callable(value)
        case "Executor":
            return callable(getattr(value, "submit", None))
        case "Mapping":
            return isinstance(value, Mapping)  # its values are left to the function
        case "tuple":
            return isinstance(value, tuple)
        case "Sequence" | "Iterable":
            if isinstance(value, str | bytes | Mapping):
                return False
            if kind.name == "Sequence" and not hasattr(value, "__getitem__"):
                return False
            if hasattr(value, "dtype"):  # an array of numpy or pandas
                return value.ndim == 1 and value.dtype.kind in KINDS and _fit(kind.parts[0], 1)
            # an iterator is left as it is
            return isinstance(value, Iterable) and (
                not isinstance(value, Sequence) or all(_fit(kind.parts[0], part) for part in value)
            )
    return kind.name in (base.__name__ for base in type(value).__mro__)


def _fit(kinds: tuple[_Kind, ...], value: Any) -> bool:
    """Return True if a value is of one of the types; a text that may be a path must be one."""
    if isinstance(value, str) and "Path" in (kind.name for kind in kinds):
        return is_path(value)
    return any(_fits(kind, value) for kind in kinds)


def is_path(value: str | Path) -> bool:
    """Return True if the operating system accepts a path."""
    try:
        name = os.fsencode(value)
    except UnicodeEncodeError:
        return False
    return b"\0" not in name and all(len(part) <= _LONGEST_NAME for part in name.split(b"/"))
