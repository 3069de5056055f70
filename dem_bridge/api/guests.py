"""The guests of the package, by name: studies, the verification of the paper, and the reduction of a scene.

A study of this package is the function ``study_NAME`` of ``studies/NAME.py`` or ``studies/NAME/study.py``, and its
summary is the first line of the docstring. Both are read in the text of the module, which is imported only when its
function is called. ``studies/catalogue.toml`` lists the other guests. Without the folder there are none, and
everything else works.

A study is a function ``(scene, *, engine, jobs, progress, store, **settings) -> Study`` that takes those of these
parameters that it uses. Its signature and its docstring are all that :func:`dem_bridge.study` and the command line
know of it.
"""

from __future__ import annotations

import importlib
import re
import tomllib
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


_FOLDER = Path(__file__).parents[1] / "studies"
_FILE = _FOLDER / "catalogue.toml"
_KINDS = tomllib.loads(_FILE.read_text(encoding="utf-8")) if _FILE.is_file() else {}
#: the rest of a signature, and the first line of the docstring
_RETURNS_STUDY = re.compile(r'(?:(?!\) ->).)*\) -> Study:\n    r?"""(.+?)(?:"""|$)', re.MULTILINE | re.DOTALL)


def studies_in(folder: Path) -> Mapping[str, Entry]:
    """Return the studies whose modules are in a folder, in alphabetical order; no module is imported.

    Parameters
    ----------
    folder : Path
        Folder of the package ``dem_bridge.studies``.

    Returns
    -------
    mapping of str to Entry
        Of the name of each study, with hyphens. A module without the function of its name is no study.

    >>> studies_in(Path(__file__).parents[1] / "studies")["rule-of-thumb"].function
    'study_rule_of_thumb'
    """
    files = {file.stem: file for file in folder.glob("*.py")}
    files |= {file.parent.name: file for file in folder.glob("*/study.py")}
    entries = {}
    for name, file in sorted(files.items()):
        _, function, text = file.read_text(encoding="utf-8").partition(f"\ndef study_{name}(")
        if function and (found := _RETURNS_STUDY.match(text)):
            module = ".".join(("dem_bridge", *file.relative_to(folder.parent).with_suffix("").parts))
            entries[name.replace("_", "-")] = Entry(module, f"study_{name}", found[1])
    return MappingProxyType(entries)


def _entries(kind: str) -> Mapping[str, Entry]:
    """Return the entries of a kind by name."""
    return MappingProxyType({name: Entry(**entry) for name, entry in _KINDS.get(kind, {}).items()})


STUDIES = studies_in(_FOLDER)
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
