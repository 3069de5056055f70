"""Presenters: functions or modules that show a value, found by a name.

A room that makes values does not import the room that draws them, because that room is built on it. The facade stands
above all rooms and is always imported first: it declares a loader for each name. The loader is called when the
presenter is asked for, so that nothing is imported before.

>>> declare_presenter("digits of an example", lambda: str)
>>> presenter("digits of an example")(12)
'12'
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dem_bridge.errors import UsageError

#: what draws a run: a module with a function for each figure
FIGURES_OF_RUNS = "figures of runs"
_LOADERS: dict[str, Callable[[], Any]] = {}


def declare_presenter(name: str, load: Callable[[], Any]) -> None:
    """Declare what returns the presenter of a name; a later declaration of the same name takes its place."""
    _LOADERS[name] = load


def presenter(name: str) -> Any:
    """Return the presenter of a name, as its loader returns it.

    Raises
    ------
    UsageError
        If no loader is declared for the name.
    """
    if name not in _LOADERS:
        known = ", ".join(map(repr, sorted(_LOADERS))) or "none"
        raise UsageError(
            f"presenter {name!r}: no loader is declared; declared: {known}; import dem_bridge, which declares them, or"
            " call declare_presenter"
        )
    return _LOADERS[name]()
