"""The tables by name, with the settings that each accepts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from dem_bridge.errors import UsageError
from dem_bridge.formats.tables.angles import angles, stiffness_curve
from dem_bridge.formats.tables.front import observables
from dem_bridge.formats.tables.ledger import ledger
from dem_bridge.formats.tables.parameters import bodies, contacts, pair_coeffs
from dem_bridge.formats.tables.table import Table

_DECK = ("geometry", "types", "surrogate_radius")
_CYLINDERS = ("radius", "youngs_modulus", "poissons_ratio")
#: by table name the function, True if it needs a run (None if it shows none), and the settings; the function is
#: f(scene, run, **settings) for tables with results of a run, and f(scene, **settings) for others
TABLES: Mapping[str, tuple[Callable[..., Table], bool | None, tuple[str, ...]]] = MappingProxyType(
    {
        "contacts": (contacts, False, _DECK),
        "pair-coeffs": (pair_coeffs, None, _DECK),
        "bodies": (bodies, None, _DECK),
        "observables": (observables, True, ()),
        "energy-ledger": (ledger, True, ()),
        "stiffness-curve": (stiffness_curve, None, ("angles", *_CYLINDERS)),
        "angles": (angles, None, ("law", *_CYLINDERS, "within")),
    }
)


def table_named(name: str) -> tuple[Callable[..., Table], bool | None, tuple[str, ...]]:
    """Return the entry of :data:`TABLES`; raise UsageError with the allowed names if the name is unknown."""
    if name not in TABLES:
        raise UsageError(f"table = {name!r} is unknown; allowed: {', '.join(TABLES)}")
    return TABLES[name]
