"""The scenes that are part of the package: their names and files, and a list of them that is quick to make.

The list is read from the texts. It needs neither numpy nor the checks of a scene file, which take a second to import.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple

from dem_bridge.errors import SceneError, UsageError, meant
from dem_bridge.foundation.arguments import check_arguments

_PACKAGE = Path(__file__).parents[1]
#: folders of the shipped scenes, by their kind
_FOLDERS: Mapping[Literal["chain", "benchmark", "all"], Path] = {
    "chain": _PACKAGE / "scenes",
    "benchmark": _PACKAGE / "scenes" / "benchmarks",
}


class ListedScene(NamedTuple):
    """A scene as it is listed; ``duration`` in s."""

    name: str
    n_body: int
    duration: float
    description: str


def shipped_scenes(kind: Literal["chain", "benchmark", "all"] = "chain") -> tuple[str, ...]:
    """Return the names of the scenes that are part of the package.

    Parameters
    ----------
    kind : {"chain", "benchmark", "all"}
        "chain": the chains of the paper and their relatives, which ``verify paper`` and ``regress`` run. "benchmark":
        single impacts and other benchmarks of the field, whose values are known from elsewhere.

    Raises
    ------
    UsageError
        If there is no such kind.

    Examples
    --------
    >>> "decelerating-40" in shipped_scenes()
    True
    >>> shipped_scenes("benchmark")[:3]
    ('bouncing-ball', 'chung-ooi-1-glass', 'chung-ooi-1-limestone')
    """
    check_arguments(shipped_scenes, locals())
    if kind == "all":
        return tuple(name for one_kind in _FOLDERS for name in shipped_scenes(one_kind))
    if kind not in _FOLDERS:
        raise UsageError(f"kind = {kind!r}; allowed: {', '.join((*_FOLDERS, 'all'))}")
    return tuple(sorted(file.stem for file in _FOLDERS[kind].glob("*.toml")))


def file_of_shipped(name: str) -> Path | None:
    """Return the file of a shipped scene; None if there is no scene of this name.

    >>> file_of_shipped("newtons-cradle").name, file_of_shipped("scenes/newtons-cradle")
    ('newtons-cradle.toml', None)
    """
    kinds = (kind for kind in _FOLDERS if name in shipped_scenes(kind))
    return next((_FOLDERS[kind] / f"{name}.toml" for kind in kinds), None)


def listed_scenes() -> list[ListedScene]:
    """Return all shipped scenes, chains before benchmarks, without a check of their files.

    >>> listed_scenes()[0].name, listed_scenes()[0].n_body
    ('accelerating-200', 201)
    """
    files = [_FOLDERS[kind] / f"{name}.toml" for kind in _FOLDERS for name in shipped_scenes(kind)]
    return [_listed(tomllib.loads(file.read_text(encoding="utf-8"))) for file in files]


def _listed(table: Mapping[str, Any]) -> ListedScene:
    """Return the line of a scene from the table of its file, which states the duration."""
    return ListedScene(table["name"], count_bodies(table), table["duration"], table["description"])


def count_bodies(table: Mapping[str, Any]) -> int:
    """Return the number of bodies of a scene from the table of its file, whatever its form."""
    if "impact" in table:
        return 1 if table["impact"].get("wall", False) is not False else 2
    chain = table["chain"]
    if "mass" in chain:
        return len(chain["mass"])
    striker = 1 if "striker" in chain else 0
    if "pattern" in chain:
        return striker + _count_pattern(chain["pattern"])
    return striker + int(chain["cylinders" if "cylinders" in chain else "spheres"]["count"])


def _count_pattern(pattern: Mapping[str, Any]) -> int:
    """Return the number of bodies of a repeated cell, with its step and its decoration."""
    repeat, step = pattern.get("repeat", 1), pattern.get("step")
    first = repeat if step is None else step["from"]
    count: int = first * len(pattern["cell"]) + (0 if step is None else (repeat - first) * len(step["cell"]))
    return count + ((count - 1) // pattern["decorate"].get("every", 1) if "decorate" in pattern else 0)


def missing_scene(name: str) -> SceneError:
    """Return the error of a name that is neither a shipped scene nor a file."""
    allowed = f"{', '.join(shipped_scenes()[:6])}, ... (dem-bridge scenes lists them), or the path of a .toml file"
    advice = meant(name, shipped_scenes("all"))
    return SceneError("", problem="there is no such scene or file", allowed=allowed, advice=advice, where=name)
