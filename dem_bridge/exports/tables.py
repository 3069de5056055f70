"""The tables by name, with the settings that each accepts."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from types import MappingProxyType

from dem_bridge.errors import UsageError
from dem_bridge.exports.angles import angles, stiffness_curve
from dem_bridge.exports.front import observables
from dem_bridge.exports.parameters import bodies, contacts, pair_coeffs
from dem_bridge.exports.table import Table

#: functions by table name: f(scene, run, **settings) for tables with results of a run, f(scene, **settings) for others
TABLES: Mapping[str, Callable[..., Table]] = MappingProxyType(
    {
        "contacts": contacts,
        "pair-coeffs": pair_coeffs,
        "bodies": bodies,
        "observables": observables,
        "stiffness-curve": stiffness_curve,
        "angles": angles,
    }
)
#: settings of a deck that tables about decks accept
DECK_SETTINGS = ("geometry", "types", "surrogate_radius")


def table_named(name: str) -> tuple[Callable[..., Table], bool | None, tuple[str, ...]]:
    """Return the function of a table, True if the table needs a run (None if it shows none), and its settings.

    Raises UsageError with the allowed names if the name is unknown.
    """
    if name not in TABLES:
        raise UsageError(f"table = {name!r} is unknown; allowed: {', '.join(TABLES)}")
    parameters = inspect.signature(TABLES[name]).parameters
    settings = [key for key, parameter in parameters.items() if parameter.kind is parameter.KEYWORD_ONLY]
    if any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters.values()):
        settings += DECK_SETTINGS
    run = parameters.get("run")
    return TABLES[name], None if run is None else run.default is run.empty, tuple(settings)
