"""Writing of a scene as a scene file: raw form with all digits, so that reading it gives the same scene."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType

from dem_bridge.errors import UnsupportedScene
from dem_bridge.scene.drive import KEYS, Drive
from dem_bridge.scene.file.forms import Environment
from dem_bridge.scene.piston import PISTON_KEYS
from dem_bridge.scene.scene import Scene

#: numbers per line of a list
_ON_A_LINE = 6
#: units of the numbers in [chain]
_UNITS = {
    "duration": "s", "mass": "kg", "stiffness": "N/m^(n-1)", "gap": "m", "velocity": "m/s",
    "spacing": "m", "force": "N",
}  # fmt: skip


def scene_toml(scene: Scene) -> str:
    """Return the scene as TOML in raw form, without its geometry, on which the motion does not depend.

    Raises
    ------
    UnsupportedScene
        If a contact's law is a function, which no file can contain.

    Examples
    --------
    >>> from dem_bridge.scene.file import load_scene, parse_scene
    >>> chain = load_scene("decelerating-40")
    >>> parse_scene(scene_toml(chain)) == chain
    True
    """
    if scene.law is not None:
        raise UnsupportedScene(f"{scene.name} has a contact whose law is a function, which a scene file cannot contain")
    return "\n".join(_lines(scene)) + "\n"


def scene_json(scene: Scene) -> str:
    """Return the scene as JSON, with the keys and units of a scene file in raw form.

    Raises
    ------
    UnsupportedScene
        If a contact's law is a function, which no file can contain.

    Examples
    --------
    >>> from dem_bridge.scene.file import load_scene
    >>> json.loads(scene_json(load_scene("decelerating-40")))["chain"]["velocity"][:2]
    [0.8, 0.0]
    """
    return json.dumps(tomllib.loads(scene_toml(scene)), indent=1) + "\n"


def _lines(scene: Scene) -> Iterator[str]:
    damping, drive = scene.damping, scene.drive
    yield from _values({"name": scene.name, "description": scene.description or None, "duration": scene.duration})
    yield from _section("chain", scene, ("mass", "stiffness", "exponent", "gap", "velocity", "spacing"), _UNITS)
    for side in ("wall_left", "wall_right"):
        yield from _section(f"chain.{side}", getattr(scene, side), ("stiffness", "gap", "exponent"))
    if scene.precompression > 0.0:
        yield "[chain.precompression]"
        yield from _values({"force": scene.precompression}, _UNITS)
    if damping is not None:
        clip = {} if damping.clip else {"clip": damping.clip}
        yield "[chain.damping]"
        yield from _values({"law": damping.law, "coefficient": damping.coefficient, **clip})
    yield from _section("chain.adhesion", scene.adhesion, ("law", "pull_off"), {"pull_off": "N"})
    if isinstance(drive, Drive):
        yield from _section("chain.drive", drive, ("shape", "force", *KEYS[drive.shape]), {"force": "N"})
    elif drive is not None:
        yield from _section("chain.drive", drive, ("shape", "velocity", *PISTON_KEYS[drive.shape]), {"velocity": "m/s"})
    units = Environment.units()
    yield from _section("environment", scene, tuple(units), units)
    yield "[sampling]"
    yield f"count = {scene.samples}"


def _section(
    heading: str, source: object, keys: Sequence[str], units: Mapping[str, str] = MappingProxyType({})
) -> Iterator[str]:
    """Yield a table with the attributes ``keys`` of ``source``; nothing if that is None."""
    if source is not None:
        yield f"[{heading}]"
        yield from _values({key: getattr(source, key) for key in keys}, units)


def _values(values: Mapping[str, object], units: Mapping[str, str] = _UNITS) -> Iterator[str]:
    """Yield the lines of all values that are not None, with their units as comments."""
    for key, value in values.items():
        if value is not None:
            yield f"{key} = {_toml(value)}" + (f"  # {units[key]}" if key in units else "")


def _toml(value: object) -> str:
    """Return a text, a number or a list of numbers as TOML."""
    if isinstance(value, str):
        # a JSON string of printable characters is a TOML string; names and descriptions of scenes are printable
        return json.dumps(value, ensure_ascii=False)
    if not isinstance(value, Sequence):
        return repr(value).lower()
    words = [repr(number) for number in value]
    if len(words) <= _ON_A_LINE:
        return f"[{', '.join(words)}]"
    rows = [", ".join(words[at : at + _ON_A_LINE]) for at in range(0, len(words), _ON_A_LINE)]
    return "[\n" + "".join(f"  {row},\n" for row in rows) + "]"
