"""Writing of a scene as a scene file: raw form with all digits, so that reading it gives the same scene."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence

from dem_bridge.drive import KEYS, Drive
from dem_bridge.errors import UnsupportedScene
from dem_bridge.scene import Scene, Wall
from dem_bridge.scene_file.forms import Environment

#: numbers per line of a list
_ON_A_LINE = 6


def scene_toml(scene: Scene) -> str:
    """Return the scene as TOML in raw form, without its geometry, on which the motion does not depend.

    Raises
    ------
    UnsupportedScene
        If a contact's law is a function, which no file can contain.

    Examples
    --------
    >>> from dem_bridge.scene_file import load_scene, parse_scene
    >>> chain = load_scene("decelerating-40")
    >>> parse_scene(scene_toml(chain)) == chain
    True
    """
    if scene.law is not None:
        raise UnsupportedScene(f"{scene.name} has a contact whose law is a function, which a scene file cannot contain")
    return "\n".join(_lines(scene)) + "\n"


def _lines(scene: Scene) -> Iterator[str]:
    yield f"name = {_text(scene.name)}"
    if scene.description:
        yield f"description = {_text(scene.description)}"
    yield f"duration = {scene.duration!r}  # s"
    yield "[chain]"
    yield f"mass = {_list(scene.mass)}  # kg"
    yield f"stiffness = {_list(scene.stiffness)}  # N/m^(n-1)"
    yield f"exponent = {_list(scene.exponent)}"
    yield f"gap = {_list(scene.gap)}  # m"
    yield f"velocity = {_list(scene.velocity)}  # m/s"
    if scene.spacing is not None:
        yield f"spacing = {scene.spacing!r}  # m"
    for side, wall in (("wall_left", scene.wall_left), ("wall_right", scene.wall_right)):
        if wall is not None:
            yield from _wall(side, wall)
    if scene.precompression > 0.0:
        yield "[chain.precompression]"
        yield f"force = {scene.precompression!r}  # N"
    if scene.damping is not None:
        yield "[chain.damping]"
        yield f"law = {_text(scene.damping.law)}"
        yield f"coefficient = {_list(scene.damping.coefficient)}"
    if scene.drive is not None:
        yield from _drive(scene.drive)
    yield "[environment]"
    yield from (f"{key} = {getattr(scene, key)!r}  # {unit}" for key, unit in Environment.units().items())
    yield "[sampling]"
    yield f"count = {scene.samples}"


def _wall(side: str, wall: Wall) -> Iterator[str]:
    yield f"[chain.{side}]"
    yield f"stiffness = {wall.stiffness!r}"
    yield f"gap = {wall.gap!r}"
    if wall.exponent is not None:
        yield f"exponent = {wall.exponent!r}"


def _drive(drive: Drive) -> Iterator[str]:
    yield "[chain.drive]"
    yield f"shape = {_text(drive.shape)}"
    yield f"force = {_list(drive.force)}  # N"
    yield from (f"{key} = {getattr(drive, key)!r}" for key in KEYS[drive.shape])


def _text(text: str) -> str:
    # a JSON string of printable characters is a TOML string; names and descriptions of scenes are printable
    return json.dumps(text, ensure_ascii=False)


def _list(values: Sequence[float] | float) -> str:
    if not isinstance(values, Sequence):
        return repr(values)
    words = [repr(value) for value in values]
    if len(words) <= _ON_A_LINE:
        return f"[{', '.join(words)}]"
    rows = [", ".join(words[at : at + _ON_A_LINE]) for at in range(0, len(words), _ON_A_LINE)]
    return "[\n" + "".join(f"  {row},\n" for row in rows) + "]"
