"""Scene files: TOML in, Scene out, and every mistake named by file, key, value and what is allowed.

Two forms. *Raw*: masses, stiffnesses, gaps and velocities as lists. *Physical*: material, cylinders, contact angles
and a striker, from which masses and stiffnesses follow; numbers that come from formulas are rounded to 12 significant
digits on their way into the Scene, so that decks do not depend on the last bit of a library. The structure of a file
(keys, types) is checked here; the numbers that reach a Scene are checked by the Scene.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from dem_bridge.errors import SceneError
from dem_bridge.physics.contact import cylinder_stiffness_paper
from dem_bridge.scene import Damping, Scene, Wall

Positive = Annotated[float, Field(gt=0.0)]


class _Table(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)


class _RawTable(_Table):
    # numbers in here go to the Scene as they are, which has the last word on them
    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=True)


class _Wall(_RawTable):
    stiffness: float
    gap: float = 0.0
    exponent: float | None = None


class _Damping(_RawTable):
    law: Literal["dashpot", "kuwabara-kono"]
    coefficient: float | list[float]


class _Precompression(_RawTable):
    force: float


class _RawChain(_RawTable):
    mass: list[float]
    stiffness: list[float]
    velocity: list[float]
    exponent: float | list[float] = 2.5
    gap: float | list[float] = 0.0
    spacing: float | None = None
    wall_left: _Wall | None = None
    wall_right: _Wall | None = None
    precompression: _Precompression | None = None
    damping: _Damping | None = None


class _Sampling(_RawTable):
    count: int = 500


class _Environment(_RawTable):
    gravity: float = 0.0
    drag: float = 0.0


class _RawScene(_RawTable):
    name: str
    duration: float
    description: str = ""
    chain: _RawChain
    sampling: _Sampling = _Sampling()
    environment: _Environment = _Environment()


class _Material(_Table):
    youngs_modulus: Positive
    poissons_ratio: Annotated[float, Field(gt=-1.0, le=0.5)]
    density: Positive


class _Cylinders(_Table):
    count: Annotated[int, Field(ge=2)]
    radius: Positive
    height: Positive


class _AngleContacts(_Table):
    law: Literal["paper"]
    first_angle: Annotated[float, Field(gt=0.0, le=90.0)]
    last_angle: Annotated[float, Field(gt=0.0, le=90.0)]
    grading: Literal["linear-stiffness"]


class _Striker(_Table):
    mass: Positive
    velocity: float
    stiffness: Positive


class _PhysicalChain(_Table):
    cylinders: _Cylinders
    contacts: _AngleContacts
    striker: _Striker
    wall_left: _Wall | None = None
    wall_right: _Wall | None = None
    precompression: _Precompression | None = None
    damping: _Damping | None = None


class _PhysicalScene(_Table):
    name: str
    duration: float
    description: str = ""
    material: _Material
    chain: _PhysicalChain
    sampling: _Sampling = _Sampling()
    environment: _Environment = _Environment()


def shipped_scenes() -> tuple[str, ...]:
    """Names of the scenes that come with the package.

    >>> shipped_scenes()
    ('accelerating-40', 'decelerating-40')
    """
    files = resources.files("dem_bridge").joinpath("scenes").iterdir()
    return tuple(sorted(file.name.removesuffix(".toml") for file in files if file.name.endswith(".toml")))


def load_scene(source: str | Path) -> Scene:
    """The scene of a shipped name, or of the ``.toml`` file at a path.

    Raises :class:`SceneError` in one line where there is no such scene, or where the file has a mistake.

    >>> load_scene("decelerating-40").stiffness[1]
    72729932838.4
    """
    if not isinstance(source, str | Path):
        raise SceneError("", found=source, allowed="the name of a shipped scene or the path of a .toml file")
    name = str(source)
    if name in shipped_scenes():
        file = resources.files("dem_bridge").joinpath("scenes", f"{name}.toml")
        return parse_scene(file.read_text(encoding="utf-8"), where=f"{name}.toml")
    path = Path(source)
    try:
        is_file = path.is_file()
    except (OSError, ValueError):  # a name too long, or with a NUL in it
        is_file = False
    if not is_file:
        raise SceneError(
            "",
            problem="no such scene",
            allowed=f"{', '.join(shipped_scenes())}, or the path of a .toml file",
            where=name,
        )
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise SceneError("", problem=f"cannot be read: {error}", allowed="a TOML file in UTF-8", where=name) from error
    return parse_scene(text, where=name)


def parse_scene(text: str, *, where: str = "scene") -> Scene:
    """The scene in a TOML text; ``where`` names it in errors."""
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # tomllib's own error is a ValueError
        raise SceneError("", problem=f"not TOML: {error}", allowed="TOML 1.0", where=where) from error
    chain = table.get("chain", {})
    physical = "material" in table or (isinstance(chain, dict) and "cylinders" in chain)
    try:
        if physical:
            return _from_physical(_PhysicalScene.model_validate(table))
        return _from_raw(_RawScene.model_validate(table))
    except ValidationError as error:
        raise _in_one_line(error, _PhysicalScene if physical else _RawScene, where) from None
    except SceneError as error:
        raise error.at(where, _file_key(error.key)) from None


def _from_raw(file: _RawScene) -> Scene:
    chain = file.chain
    return Scene(
        name=file.name,
        description=file.description,
        duration=file.duration,
        mass=tuple(chain.mass),
        stiffness=tuple(chain.stiffness),
        velocity=tuple(chain.velocity),
        exponent=_numbers(chain.exponent),
        gap=_numbers(chain.gap),
        spacing=chain.spacing,
        wall_left=_wall(chain.wall_left),
        wall_right=_wall(chain.wall_right),
        precompression=0.0 if chain.precompression is None else chain.precompression.force,
        damping=_damping(chain.damping),
        gravity=file.environment.gravity,
        drag=file.environment.drag,
        samples=file.sampling.count,
    )


def _from_physical(file: _PhysicalScene) -> Scene:
    """Masses m = rho pi r^2 h; stiffness linear from the first to the last contact between cylinders."""
    cylinders, contacts, striker = file.chain.cylinders, file.chain.contacts, file.chain.striker
    mass = _rounded(file.material.density * math.pi * cylinders.radius**2 * cylinders.height)
    first, last = (
        cylinder_stiffness_paper(
            angle,
            radius=cylinders.radius,
            young=file.material.youngs_modulus,
            poisson=file.material.poissons_ratio,
        )
        for angle in (contacts.first_angle, contacts.last_angle)
    )
    if cylinders.count == 2 and first != last:
        raise SceneError(
            "contacts.last_angle",
            found=contacts.last_angle,
            allowed=f"first_angle = {contacts.first_angle!r}: two cylinders have one contact",
        )
    graded = np.linspace(first, last, cylinders.count - 1)
    return Scene(
        name=file.name,
        description=file.description,
        duration=file.duration,
        mass=(striker.mass, *[mass] * cylinders.count),
        stiffness=(striker.stiffness, *(_rounded(float(beta)) for beta in graded)),
        velocity=(striker.velocity, *[0.0] * cylinders.count),
        spacing=2.0 * cylinders.radius,
        wall_left=_wall(file.chain.wall_left),
        wall_right=_wall(file.chain.wall_right),
        precompression=0.0 if file.chain.precompression is None else file.chain.precompression.force,
        damping=_damping(file.chain.damping),
        gravity=file.environment.gravity,
        drag=file.environment.drag,
        samples=file.sampling.count,
    )


def _rounded(value: float) -> float:
    return float(f"{value:.12g}")


def _numbers(value: float | list[float]) -> float | tuple[float, ...]:
    return tuple(value) if isinstance(value, list) else value


def _wall(wall: _Wall | None) -> Wall | None:
    return None if wall is None else Wall(stiffness=wall.stiffness, gap=wall.gap, exponent=wall.exponent)


def _damping(damping: _Damping | None) -> Damping | None:
    return None if damping is None else Damping(law=damping.law, coefficient=_numbers(damping.coefficient))


#: where a Scene's attributes stand in a file, if not in [chain] under their own name
_FILE_KEYS = {
    "name": "name",
    "duration": "duration",
    "samples": "sampling.count",
    "gravity": "environment.gravity",
    "drag": "environment.drag",
    "precompression": "chain.precompression.force",
}


def _file_key(key: str) -> str:
    """Where a Scene's attribute stands in a file."""
    return _FILE_KEYS.get(key, f"chain.{key}")


#: how pydantic names the two forms of a key that takes a number or a list of them
_ALTERNATIVES = ("float", "list[float]")


def _in_one_line(error: ValidationError, form: type[BaseModel], where: str) -> SceneError:
    """The first of pydantic's findings, unknown keys first: a misspelt key also shows as a missing one."""
    findings = sorted(error.errors(), key=lambda finding: finding["type"] != "extra_forbidden")
    finding = findings[0]
    # a number or a list of them: what was given decides which of the two complaints is meant
    if isinstance(finding["input"], list) and _ALTERNATIVES[0] in finding["loc"]:
        finding = next((f for f in findings if _ALTERNATIVES[1] in f["loc"]), finding)
    meant = {tuple(part for part in f["loc"] if part not in _ALTERNATIVES)[:2] for f in findings}
    path = [part for part in finding["loc"] if part not in _ALTERNATIVES]
    key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path).removeprefix(".")
    key = key if key.isprintable() else repr(key)
    more = f"{len(meant) - 1} more to mend after this" if len(meant) > 1 else ""
    if finding["type"] == "extra_forbidden":
        return SceneError(key, problem="is an unknown key", allowed=_keys(form, path[:-1]), advice=more, where=where)
    if finding["type"] == "missing":
        return SceneError(
            key,
            problem="is missing",
            allowed=f"needed beside {_keys(form, path[:-1])}",
            advice=more,
            where=where,
        )
    allowed = (
        finding["msg"]
        .removeprefix("Input should be ")
        .replace("a valid integer", "a whole number")
        .replace("a valid ", "a ")
    )
    if finding["type"].startswith("model_"):
        allowed = f"a table with the keys {_keys(form, path)}"
    return SceneError(key, found=finding["input"], allowed=allowed, advice=more, where=where)


def _keys(form: type[BaseModel], path: list[Any]) -> str:
    """Keys that the table at ``path`` may have."""
    for part in path:
        fields: Mapping[str, Any] = form.model_fields
        annotation = fields[part].annotation
        options = [annotation, *getattr(annotation, "__args__", ())]
        form = next(o for o in options if isinstance(o, type) and issubclass(o, BaseModel))
    return ", ".join(form.model_fields)
