"""Identify a compiled function by its content: its byte code and all that is frozen into its machine code.

numba compiles the byte code of a function together with the functions that it calls, and with the values of the
globals, cells and defaults that these read. All of that is the closure here, and its digest changes with the machine
code and with nothing else: times, paths, comments and line numbers are not in it. Functions and values of Python, numpy
and numba are identified by their names, since the versions of these are part of every identity (:mod:`.kernel_cache`).
"""

from __future__ import annotations

import builtins
import hashlib
import sys
from collections.abc import Callable, Iterator
from dis import opmap
from enum import Enum
from threading import Lock
from types import CodeType, FunctionType, ModuleType
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

#: a text, and the functions to which it refers, in their order
Content = tuple[str, tuple[FunctionType, ...]]
_EXTENDED, _LOAD_GLOBAL = opmap["EXTENDED_ARG"], opmap["LOAD_GLOBAL"]
#: packages whose version is part of every identity
_VERSIONED = frozenset({*sys.stdlib_module_names, "numpy", "numba", "llvmlite"})
_PLAIN = frozenset({type(None), type(...), bool, int, float, complex, str, bytes})
_PARTS = (
    "co_code", "co_names", "co_varnames", "co_cellvars", "co_freevars", "co_argcount", "co_posonlyargcount",
    "co_kwonlyargcount", "co_flags", "co_exceptiontable",
)  # fmt: skip
#: content of each function when it was first identified: what was compiled since then has these values
first_identified: WeakKeyDictionary[FunctionType, Content] = WeakKeyDictionary()
_lock = Lock()


class Unidentified(TypeError):
    """Report that a function depends on something that has no content to identify it by."""


def closure_digest(function: FunctionType) -> str:
    """Return the sha256 of a function and of all functions and values that it is compiled with.

    Raises
    ------
    Unidentified
        If it uses an object of an unknown kind, or a value that has changed since it was first identified.

    Examples
    --------
    >>> def scaled(number, factor=2.0):
    ...     return factor * number
    >>> before = closure_digest(scaled)
    >>> before == closure_digest(scaled), len(before)
    (True, 64)
    """
    return _digest(functions_of(function))


def functions_of(function: FunctionType) -> dict[FunctionType, Content]:
    """Return all functions of the closure of a function, in the order in which it reaches them.

    Each has its own content as a text, and the functions to which the text refers, in their order.
    """
    reached: dict[FunctionType, Content] = {}
    waiting = [function]
    while waiting:
        if (current := waiting.pop()) not in reached:
            reached[current] = own_content(current)
            waiting += reversed(reached[current][1])
    return reached


def _digest(reached: dict[FunctionType, Content]) -> str:
    """Return the sha256 of the functions of a closure, which refer to each other by place: they may be recursive."""
    places = {member: place for place, member in enumerate(reached)}
    digest = hashlib.sha256()
    for member, (text, references) in reached.items():
        with _lock:
            if first_identified.setdefault(member, (text, references)) != (text, references):
                raise Unidentified(f"a value that {member.__qualname__} uses has changed since it was first compiled")
        digest.update(f"{text}\n{[places[other] for other in references]}\n".encode())
    return digest.hexdigest()


def own_content(function: FunctionType) -> Content:
    """Return the content of one function as a text, and the functions to which the text refers, in their order."""
    references: list[FunctionType] = []
    names = set(_names(function.__code__))
    known = {name: _global(function, name) for name in sorted(_globals(function.__code__)) if _is_ours(function, name)}
    try:
        cells = [cell.cell_contents for cell in function.__closure__ or ()]
    except ValueError:
        raise Unidentified(f"a variable that {function.__qualname__} uses has no value yet") from None

    def text_of(value: Any) -> str:
        return _text(value, names, references.append)

    parts = (function.__module__, function.__qualname__, function.__code__, known, cells, function.__defaults__,
             function.__kwdefaults__)  # fmt: skip
    return "\n".join(map(text_of, parts)), tuple(references)


def _is_ours(function: FunctionType, name: str) -> bool:
    """Return True unless a name is one of Python's own, which its version identifies."""
    return name in function.__globals__ or not hasattr(builtins, name)


def _global(function: FunctionType, name: str) -> Any:
    """Return the value of a global name of a function."""
    try:
        return function.__globals__[name]
    except KeyError:
        raise Unidentified(f"{name!r}, which {function.__qualname__} uses, is not defined") from None


def _codes(code: CodeType) -> Iterator[CodeType]:
    """Yield a code object and all that are within it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


def _names(code: CodeType) -> Iterator[str]:
    """Yield the names of all globals and attributes that a function uses."""
    for part in _codes(code):
        yield from part.co_names


def _globals(code: CodeType) -> set[str]:
    """Return the names of all globals that a function reads, also within functions in it.

    This reads the byte code of Python 3.11 and later, at a tenth of the time that :mod:`dis` takes.
    """
    names = set()
    for part in _codes(code):
        extended = 0
        for operation, argument in zip(part.co_code[::2], part.co_code[1::2], strict=True):
            argument |= extended
            extended = argument << 8 if operation == _EXTENDED else 0
            if operation == _LOAD_GLOBAL:
                names.add(part.co_names[argument >> 1])
    return names


def _text(value: Any, names: set[str], refer: Callable[[FunctionType], None]) -> str:
    """Return the content of a value as a text; ``refer`` takes the functions of ours that it contains.

    ``names``: the names that the function uses, one of which may be an attribute of a module.
    """

    def text_of(item: Any) -> str:
        return _text(item, names, refer)

    if type(value) in _PLAIN:
        return f"{type(value).__name__} {value!r}"
    if isinstance(value, CodeType):
        return f"code {[getattr(value, part) for part in _PARTS]} {text_of(value.co_consts)}"
    if isinstance(value, ModuleType):
        return _text_of_module(value, names, refer)
    if isinstance(function := getattr(value, "py_func", value), FunctionType) and not _is_versioned(function):
        refer(function)
        return f"function {_options(value)}"
    if isinstance(value, type):
        return _text_of_class(value, text_of)
    if isinstance(value, tuple | list):
        return f"{_name(type(value))} {getattr(value, '_fields', '')} [{', '.join(map(text_of, value))}]"
    if isinstance(value, set | frozenset):
        return f"{_name(type(value))} {sorted(map(text_of, value))}"
    if isinstance(value, dict):
        return f"dict {[(text_of(key), text_of(item)) for key, item in value.items()]}"
    if isinstance(value, np.ndarray | np.generic) and not value.dtype.hasobject:
        array = np.asarray(value)
        about = array.dtype.descr, array.shape, array.flags.c_contiguous, array.flags.f_contiguous
        return f"{_name(type(value))} {about} {array.tobytes().hex()}"
    if isinstance(value, np.dtype):
        return f"dtype {value.descr if value.names else value.str} {value.itemsize} {value.isalignedstruct}"
    if isinstance(value, Enum):
        return f"{_name(type(value))} {value.name} {text_of(value.value)}"
    if type(value).__module__.startswith("numba.core.types"):
        return f"type {value!r}"
    if _is_versioned(value) and (name := getattr(value, "__qualname__", getattr(value, "__name__", ""))):
        return f"{_name(type(value))} {getattr(value, '__module__', '')} {name}"
    raise Unidentified(f"a value of type {_name(type(value))} cannot be identified")


def _text_of_module(module: ModuleType, names: set[str], refer: Callable[[FunctionType], None]) -> str:
    """Return the name of a module, with what a function with these ``names`` may read from it if it is ours."""
    if module.__name__.split(".")[0] in _VERSIONED:
        return f"module {module.__name__}"
    read = {name: vars(module)[name] for name in sorted(names) if name in vars(module)}
    # the module itself is left out of what is read from it: modules may name each other
    return f"module {module.__name__} {[(name, _text(item, names - {name}, refer)) for name, item in read.items()]}"


def _text_of_class(kind: type, text_of: Callable[[Any], str]) -> str:
    """Return the name of a class, with fields and default values of a named tuple or the members of an enumeration."""
    if issubclass(kind, tuple) and hasattr(kind, "_fields"):
        return f"class {_name(kind)} {kind._fields} {text_of(getattr(kind, '_field_defaults', {}))}"
    if issubclass(kind, Enum):
        return f"class {_name(kind)} {[(member.name, text_of(member.value)) for member in kind]}"
    if not _is_versioned(kind):
        raise Unidentified(f"the class {_name(kind)} cannot be identified")
    return f"class {_name(kind)}"


def _options(value: Any) -> str:
    """Return the options with which a function is compiled that is no ``Kernel``."""
    options = {**getattr(value, "targetoptions", {}), "locals": getattr(value, "locals", None)}
    return repr(sorted(options.items()))


def _is_versioned(value: Any) -> bool:
    """Return True for what belongs to a package whose version is part of every identity."""
    return str(getattr(value, "__module__", None) or "").split(".")[0] in _VERSIONED


def _name(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"
