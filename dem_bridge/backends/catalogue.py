"""The backends that exist, by name, from ``catalogue.json``; no backend is imported before it is used."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple


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
