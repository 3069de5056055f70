"""The tables by name, and what each can be asked."""

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

#: name -> f(scene, run, settings of its own) or f(scene, settings); ``run`` is asked for by those that have one
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
#: how a deck is laid out: settings of tables that show it
FORM = ("geometry", "types", "surrogate_radius")


def table_named(name: str) -> Callable[..., Table]:
    """UsageError with the allowed names for another."""
    if name not in TABLES:
        raise UsageError(f"table = {name!r}; allowed: {', '.join(TABLES)}")
    return TABLES[name]


def takes(made: Callable[..., Table]) -> tuple[bool, tuple[str, ...]]:
    """Whether a table has a run in it, and the names of its own settings."""
    parameters = inspect.signature(made).parameters
    own = [name for name, one in parameters.items() if one.kind is one.KEYWORD_ONLY]
    if any(one.kind is one.VAR_KEYWORD for one in parameters.values()):
        own += FORM
    return "run" in parameters, tuple(own)


def needs_run(made: Callable[..., Table]) -> bool:
    """Whether it cannot be without one."""
    one: Any = inspect.signature(made).parameters.get("run")
    return one is not None and one.default is one.empty
