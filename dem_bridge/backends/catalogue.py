"""The backends that exist, by name, from ``catalogue.json``; no backend is imported before it is used.

Other distributions add backends by entry points (:mod:`dem_bridge.foundation.guests`).
"""

from __future__ import annotations

import importlib
import json
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from dem_bridge.errors import UsageError
from dem_bridge.foundation import guests


class Entry(NamedTuple):
    """The module and class of a backend, and its method and purpose for the README's table."""

    module: str
    """Imported only when the backend is used."""
    attribute: str
    method: str
    purpose: str
    uncertainty: str = ""
    """The rule from which its uncertainty follows, a module of ``runs/uncertainty``; '': its runs state theirs."""


_FILE = Path(__file__).with_name("catalogue.json")
BACKENDS: Mapping[str, Entry] = MappingProxyType(
    {name: Entry(**entry) for name, entry in json.loads(_FILE.read_text(encoding="utf-8")).items()}
)

#: those that run LAMMPS, and are constructed with an Engine
ENGINE_BACKENDS = tuple(name for name in BACKENDS if name.startswith("lammps"))

#: what the attribute ``uncertainty_from`` of a foreign backend may be: twins on the same steps, for a code that
#: errs as velocity-Verlet does, or nothing, where the uncertainty is that which the run states
_FAMILIES = ("", "twins")


def backend_names() -> tuple[str, ...]:
    """Return the names of all backends: those of this package, then those of other distributions."""
    return (*BACKENDS, *guests.guest_names(guests.BACKENDS, BACKENDS))


def class_of(name: str) -> Any:
    """Return the class of a backend; raise UsageError for an unknown name, and for a distribution that is faulty."""
    if name in BACKENDS:
        return getattr(importlib.import_module(BACKENDS[name].module), BACKENDS[name].attribute)
    if (point := guests.find_guest(guests.BACKENDS, name)) is None:
        raise UsageError(f"backend = {name!r}; allowed: {', '.join(backend_names())}")
    return guests.load_guest(point)


def entry_of(name: str) -> Entry:
    """Return the entry of a backend; that of another distribution follows from its class."""
    if name in BACKENDS:
        return BACKENDS[name]
    kind = class_of(name)
    family = getattr(kind, "uncertainty_from", "")
    if family not in _FAMILIES:
        allowed = ", ".join(map(repr, _FAMILIES))
        raise UsageError(f"backend {name!r} has uncertainty_from = {family!r}; allowed: {allowed}")
    return Entry(kind.__module__, kind.__qualname__, "", "", family)
