"""Keep values that are read from stored runs in the store, under the keys of these runs.

Verdicts, claims, tables, figures and images are plain data: dataclasses and enumerations that the caller declares,
tuples, lists, mappings, numbers, texts, bytes and arrays. An entry holds them as JSON and arrays; nothing is imported
to read it, and no other class is made.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.prescan import Prescan
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.lmp.engine import Engine
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.runs.keys import study_key
from dem_bridge.runs.store import Store
from dem_bridge.scene.scene import Scene

Value = TypeVar("Value")
_PACKAGE = "dem_bridge."


def recall(
    store: Store | None,
    question: str,
    keys: Sequence[str | None],
    compute: Callable[[], Value],
    *,
    kinds: Sequence[type] = (),
    scenes: Sequence[Scene] = (),
    engine: Engine | None = None,
    **settings: object,
) -> Value:
    """Return ``compute()``, from the store if it was computed before by the same code from the same runs.

    Parameters
    ----------
    store : Store or None
        None: the value is always computed.
    question : str
        Name of the value.
    keys : sequence of str or None
        Keys of all runs that are read; with None among them the value is always computed.
    compute : callable
        Computes the value, which must be plain data.
    kinds : sequence of type
        All dataclasses and enumerations that the value and its parts may be.
    scenes : sequence of Scene
        Scenes that are read, with their names, descriptions and geometry.
    engine : Engine, optional
        The LAMMPS that ``compute`` runs; one that has no key (:mod:`.keys`) has the value always computed.
    **settings
        Everything else that the value depends on, as JSON. The code of the package is always part of the key, except
        that of the report and of the command line. An observable that another program has registered has code that is
        not in the key: the value is then always computed.

    Raises
    ------
    TypeError
        If the value is not plain data, or of other kinds.
    """
    settled: dict[str, Any] = {"kinds": kinds, "scenes": scenes, "engine": engine}
    return begin_recall(store, question, keys, lambda: compute, **settled | settings)()


def begin_recall(
    store: Store | None,
    question: str,
    keys: Sequence[str | None],
    begin: Callable[[], Callable[[], Value]],
    *,
    kinds: Sequence[type] = (),
    scenes: Sequence[Scene] = (),
    engine: Engine | None = None,
    **settings: object,
) -> Callable[[], Value]:
    """Return a function that returns what :func:`recall` does, once.

    ``begin`` is called at once, and only if the store has not the value; it returns what computes or awaits the value.
    """
    functions = [part for item in OBSERVABLES.values() for part in (item.value, item.uncertainty, item.measure) if part]
    foreign = any(not part.__module__.startswith(_PACKAGE) for part in functions)
    if store is None or foreign or None in keys:
        return begin()
    texts = {at: repr(geometry) for at, geometry in {id(each.geometry): each.geometry for each in scenes}.items()}
    shown = [(scene.name, scene.description, texts[id(scene.geometry)]) for scene in scenes]
    registered = [(item.name, item.definition, item.unit, item.axis, item.scale.name) for item in OBSERVABLES.values()]
    parts = {"keys": list(keys), "shown": shown, "observables": registered, "settings": settings}
    key = study_key(question, scenes, engine, **parts)
    if key is None:
        return begin()
    declared = {_name(kind): kind for kind in kinds}
    entry = store.load_arrays(key)
    if entry is not None:
        try:
            value: Value = _decoded(json.loads(entry["json"].tobytes()), entry, declared)
            return lambda: value
        except (AttributeError, KeyError, TypeError, ValueError):
            pass  # the entry was not written by this function: the value is computed and the entry replaced
    finish, kept = begin(), key

    def finished() -> Value:
        value, arrays = finish(), dict[str, NDArray[Any]]()
        text = json.dumps(_encoded(value, arrays, declared))
        store.save_arrays(kept, {"json": np.frombuffer(text.encode(), dtype=np.uint8), **arrays})
        return value

    return finished


def recall_prescan(store: Store | None, scene: Scene) -> None:
    """Have the prescan of a scene ready: from the store, or made once for all processes.

    A prescan takes milliseconds, but the compiler that it needs takes half a second to load.
    """
    if store is not None and scene.law is None:
        prescan_scene(scene, lambda make: recall(store, "prescan", [], make, kinds=[Prescan], scenes=[scene]))


def _encoded(value: Any, arrays: dict[str, NDArray[Any]], declared: Mapping[str, type]) -> Any:
    """Return a value as JSON with its arrays in ``arrays``; TypeError for anything but plain data."""
    if (isinstance(value, Enum) or is_dataclass(value)) and _name(type(value)) not in declared:
        raise TypeError(f"{value!r} is not plain data of a declared class, and cannot be kept in the store")
    if isinstance(value, Enum):
        return {"enum": _name(type(value)), "value": value.value}
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, np.number | np.bool_):  # before float, which one of them is
        return {"numpy": value.dtype.name, "value": value.item()}
    if isinstance(value, int | float):
        return value
    if isinstance(value, list):
        return [_encoded(item, arrays, declared) for item in value]
    if isinstance(value, tuple):
        return {"tuple": [_encoded(item, arrays, declared) for item in value]}
    if isinstance(value, Mapping):
        return {
            "mapping": [
                [_encoded(key, arrays, declared), _encoded(item, arrays, declared)] for key, item in value.items()
            ]
        }
    if isinstance(value, bytes | np.ndarray):
        name = f"array {len(arrays)}"
        arrays[name] = np.frombuffer(value, dtype=np.uint8) if isinstance(value, bytes) else value
        return {"bytes" if isinstance(value, bytes) else "array": name}
    if is_dataclass(value):
        parts = {field.name: _encoded(getattr(value, field.name), arrays, declared) for field in fields(value)}
        return {"dataclass": _name(type(value)), "fields": parts}
    raise TypeError(f"{value!r} is not plain data, and cannot be kept in the store")


def _decoded(value: Any, arrays: Mapping[str, NDArray[Any]], declared: Mapping[str, Any]) -> Any:
    """Return what :func:`_encoded` encoded; KeyError for a class that is not declared."""
    if isinstance(value, list):
        return [_decoded(item, arrays, declared) for item in value]
    if not isinstance(value, dict):
        return value
    if "tuple" in value:
        return tuple(_decoded(item, arrays, declared) for item in value["tuple"])
    if "mapping" in value:
        return {_decoded(key, arrays, declared): _decoded(item, arrays, declared) for key, item in value["mapping"]}
    if "array" in value:
        return arrays[value["array"]]
    if "bytes" in value:
        return arrays[value["bytes"]].tobytes()
    if "numpy" in value:
        return np.dtype(value["numpy"]).type(value["value"])
    if "enum" in value:
        return declared[value["enum"]](value["value"])
    parts = {name: _decoded(item, arrays, declared) for name, item in value["fields"].items()}
    return declared[value["dataclass"]](**parts)


def _name(cls: type) -> str:
    """Return the module and name of a class."""
    return f"{cls.__module__}:{cls.__qualname__}"
