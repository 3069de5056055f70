"""What other distributions add by entry points: backends, studies and readers of files.

A distribution names them in its pyproject.toml, each as ``name = "module:attribute"``::

    [project.entry-points."dem_bridge.backends"]
    my-backend = "my_package.backend:MyBackend"

The groups are ``dem_bridge.backends`` (classes), ``dem_bridge.studies`` and ``dem_bridge.readers`` (functions); here
they are named by their last part. The entry points are read when a name is not one of this package, or when names are
listed. A name of this package cannot be taken, and a name that two distributions have belongs to neither.
"""

from __future__ import annotations

from collections.abc import Collection
from functools import cache
from typing import TYPE_CHECKING, Any

from dem_bridge.errors import UsageError, one_line

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

BACKENDS, STUDIES, READERS = "backends", "studies", "readers"


def group_name(group: str) -> str:
    """Return the name of a group of entry points.

    >>> group_name(READERS)
    'dem_bridge.readers'
    """
    return f"dem_bridge.{group}"


@cache
def _points(group: str) -> dict[str, tuple[EntryPoint, ...]]:
    """Return the entry points of a group by name, those of a name in the order of their distributions."""
    from importlib.metadata import entry_points

    points = sorted(entry_points(group=group_name(group)), key=lambda point: (point.name, _distribution(point)))
    return {name: tuple(point for point in points if point.name == name) for name in {p.name: None for p in points}}


def _distribution(point: EntryPoint) -> str:
    """Return the name of the distribution that has an entry point."""
    return point.dist.name if point.dist is not None else point.value


def guest_names(group: str, ours: Collection[str] = ()) -> tuple[str, ...]:
    """Return the names that other distributions add to a group; a name of ours is not among them."""
    return tuple(name for name in _points(group) if name not in ours)


def find_guest(group: str, name: object) -> EntryPoint | None:
    """Return the entry point of a name, None without one; raise UsageError for a name of two distributions."""
    points = _points(group).get(name, ()) if isinstance(name, str) else ()
    if len(points) > 1:
        raise UsageError(
            f"{name!r} of {group_name(group)} is a name in the distributions"
            f" {' and '.join(map(_distribution, points))}; allowed: one distribution for each name;"
            " uninstall the others"
        )
    return points[0] if points else None


def load_guest(point: EntryPoint) -> Any:
    """Import what an entry point names; raise UsageError in one line if that fails."""
    try:
        return point.load()
    except Exception as error:  # a foreign module may raise anything
        raise UsageError(
            f"{point.name!r} of the distribution {_distribution(point)} cannot be imported from {point.value}"
            f" ({type(error).__name__}: {one_line(str(error))}); correct or uninstall the distribution"
        ) from error


def examined(group: str, name: str, ours: Collection[str]) -> str:
    """Import what a name stands for and return a line about it; raise UsageError for a name that is taken."""
    if name in ours:
        raise UsageError(
            f"{name!r} of {group_name(group)} in the distribution {_distribution(_points(group)[name][0])} is not used,"
            " because dem_bridge has that name; rename it there"
        )
    point = find_guest(group, name)
    assert point is not None  # the name is one of the group
    load_guest(point)
    return f"{name}, of the distribution {_distribution(point)}"
