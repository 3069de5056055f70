"""The guests of the package, by name: studies, the verification of the paper, and the reduction of a scene.

``dem_bridge/studies/catalogue.json`` lists those of this package; without the folder there are none, and everything
else works. The file and not the installation is read, so that a checkout needs no new installation for a new study.
A module is imported only when its function is called.

A study is a function ``(scene, *, engine, jobs, progress, store, **settings) -> Study`` that takes those of these
parameters that it uses. Its signature and the "Parameters" section of its docstring are all that
:func:`dem_bridge.study` and the command line know of it. To add a study, write a module with that function and an
entry in the file, whose summary is the first line of the docstring.
"""

from __future__ import annotations

import importlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from dem_bridge.errors import UsageError
from dem_bridge.foundation import guests


class Entry(NamedTuple):
    """Location of a function, and its purpose in one sentence."""

    module: str
    function: str
    summary: str


_FILE = Path(__file__).parents[1] / "studies" / "catalogue.json"
_KINDS = json.loads(_FILE.read_text(encoding="utf-8")) if _FILE.is_file() else {}


def _entries(kind: str) -> Mapping[str, Entry]:
    """Return the entries of a kind by name."""
    return MappingProxyType({name: Entry(**entry) for name, entry in _KINDS.get(kind, {}).items()})


STUDIES = _entries("study")
#: verifications of more than the scenes that are named, and functions that find a scene by a study
VERIFICATIONS, SCENES = _entries("verification"), _entries("scene")


def function_of(entry: Entry) -> Callable[..., Any]:
    """Import the module of an entry and return the function."""
    function: Callable[..., Any] = getattr(importlib.import_module(entry.module), entry.function)
    return function


def study_named(name: str) -> Callable[..., Any]:
    """Return the function of a study; raise UsageError with the names that exist if there is none of that name."""
    if isinstance(name, str) and name in STUDIES:
        return function_of(STUDIES[name])
    if (point := guests.find_guest(guests.STUDIES, name)) is not None:
        function: Callable[..., Any] = guests.load_guest(point)
        return function
    raise UsageError(f"study = {name!r}; allowed: {', '.join(study_names()) or 'none, because no study is installed'}")


def study_names() -> tuple[str, ...]:
    """Return the names of all studies: those of this package, then those of other distributions."""
    return (*STUDIES, *guests.guest_names(guests.STUDIES, STUDIES))


def guest_named(entries: Mapping[str, Entry], name: str, purpose: str) -> Callable[..., Any]:
    """Return the function of an entry; raise UsageError with its purpose if it is not installed."""
    if name not in entries:
        raise UsageError(f"{purpose} needs the studies of dem_bridge, which are not installed; install them")
    return function_of(entries[name])
