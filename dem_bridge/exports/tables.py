"""The tables by name, with the settings that each accepts."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

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


def table_function(name: str) -> Callable[..., Table]:
    """Return the function of the table ``name``; raise UsageError with the allowed names if it is unknown."""
    if name not in TABLES:
        raise UsageError(f"table = {name!r} is unknown; allowed: {', '.join(TABLES)}")
    return TABLES[name]


def settings_of(function: Callable[..., Table]) -> tuple[bool, tuple[str, ...]]:
    """Return True if a table shows results of a run, and the names of the settings that the table accepts."""
    parameters = inspect.signature(function).parameters
    names = [name for name, parameter in parameters.items() if parameter.kind is parameter.KEYWORD_ONLY]
    if any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters.values()):
        names += DECK_SETTINGS
    return "run" in parameters, tuple(names)


def needs_run(function: Callable[..., Table]) -> bool:
    """Return True if a table consists of results of a run only."""
    parameter: Any = inspect.signature(function).parameters.get("run")
    return parameter is not None and parameter.default is parameter.empty
