"""Reading of scene files: TOML to Scene, with messages that name file, key, value and the allowed values.

There are three kinds of form. The *raw* form has lists of masses, stiffnesses, gaps and velocities. The *physical* form
has bodies and optionally a striker, from which masses and stiffnesses follow: crossed cylinders or spheres of one
material, or a pattern of both of several materials. The *impact* form has two spheres, or a sphere and a plane. The
tables are in :mod:`.forms`; the values that follow from bodies are in :mod:`.conversion`, :mod:`.bodies` and
:mod:`.impact`. The tables check the structure of a file (keys, types); the Scene checks the numbers that it is created
with.

The table [measurement] names files of measured values, and is no part of the Scene. A
:class:`~dem_bridge.scene.scene.Scene` does not hold it, and its content hash does not depend on it.
:func:`measurement_of` reads the table from the scene file where a comparison needs it.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import NoneType
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from dem_bridge.errors import SceneError, meant
from dem_bridge.foundation.arguments import check_arguments
from dem_bridge.foundation.files import named_file, text_of_file
from dem_bridge.foundation.script_files import is_script
from dem_bridge.scene.file.bodies import from_pattern
from dem_bridge.scene.file.conversion import from_cylinders, from_raw, from_spheres
from dem_bridge.scene.file.forms import CylinderScene, Environment, PatternScene, RawScene, SphereScene
from dem_bridge.scene.file.impact import ImpactScene, from_impact
from dem_bridge.scene.file.measured_force import with_force_of_file
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.shipped import file_of_shipped, missing_scene
from dem_bridge.version import advice_on_schema

#: the two main examples: the paper's chains of figures 2 and 3
MAIN_SCENES = ("accelerating-40", "decelerating-40")

#: schema of scene files; a file may name it: schema = "dem-bridge/scene/1"
SCHEMA = "dem-bridge/scene/1"


def scene_of(source: Scene | str | Path) -> Scene:
    """Return a Scene unchanged, and pass anything else to :func:`load_scene`."""
    return source if isinstance(source, Scene) else load_scene(source)


def load_scene(source: str | Path, *, files_below: str | Path | None = None) -> Scene:
    """Return the scene of a shipped name, or of the ``.toml`` file at a path.

    Parameters
    ----------
    source : str or Path
        Name of a shipped scene or path of a scene file.
    files_below : str or Path, optional
        Folder below which the files must be that the scene file names. None: ``$DEM_BRIDGE_FILES_BELOW``, or else the
        folder of the scene file.

    Raises
    ------
    SceneError
        If there is no such scene, or if the file is invalid.

    Examples
    --------
    >>> load_scene("decelerating-40").stiffness[1]
    72729932838.4
    """
    text, where, folder = _text_of(source)
    check_arguments(load_scene, locals())
    return parse_scene(text, where=where, folder=folder, files_below=files_below)


def read_form(source: str | Path) -> tuple[Any, Path]:
    """Return the tables of a scene file as a form of :mod:`.forms`, and the folder of the file."""
    text, where, folder = _text_of(source)
    return _parse_form(text, where, folder), folder


def _text_of(source: str | Path) -> tuple[str, str, Path]:
    """Return the text of a scene file, its name for error messages, and its folder."""
    if not isinstance(source, str | Path):
        raise SceneError("", value=source, allowed="the name of a shipped scene or the path of a .toml file")
    name = str(source)
    if (file := file_of_shipped(name)) is not None:
        return file.read_text(encoding="utf-8"), file.name, file.parent
    path = Path(source)
    try:
        exists = path.exists() and not path.is_dir()
    except (OSError, ValueError):  # the name is too long or contains a NUL
        exists = False
    if not exists:
        raise missing_scene(name)
    try:
        return text_of_file(path), name, path.parent
    except OSError as error:
        problem = f"cannot be read: {error.strerror}"
        raise SceneError("", problem=problem, allowed="a TOML file in UTF-8", where=name) from error


def parse_scene(
    text: str, *, where: str = "scene", folder: str | Path = ".", files_below: str | Path | None = None
) -> Scene:
    """Return the scene of a TOML text.

    Parameters
    ----------
    text : str
        Content of a scene file.
    where : str
        Name of the file, for error messages.
    folder : str or Path
        Folder of the files that the text refers to.
    files_below : str or Path, optional
        Folder below which these files must be, as in :func:`load_scene`.

    Raises
    ------
    SceneError
        If the text is not a valid scene.
    """
    form = _parse_form(text, where, Path(folder), files_below)
    try:
        return _SCENE_FROM[type(form)](form)
    except SceneError as error:
        raise error.at(where, _file_key(error.key, type(form))) from None


def _parse_form(text: str, where: str, folder: Path, files_below: str | Path | None = None) -> Any:
    """Return the tables of a TOML text as a form."""
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # TOMLDecodeError is a ValueError
        if is_script(text):
            advice = (
                f"write dem-bridge check {where}, or make a scene of it: dem-bridge import deck {where} -o FILE.toml"
            )
            raise SceneError(
                "", problem="this is a LAMMPS script", allowed="a scene file", advice=advice, where=where
            ) from error
        raise SceneError("", problem=f"is not TOML: {error}", allowed="TOML 1.0", where=where) from error
    if (schema := table.pop("schema", SCHEMA)) != SCHEMA:
        advice = advice_on_schema(schema, SCHEMA)
        raise SceneError("schema", value=schema, allowed=repr(SCHEMA), advice=advice, where=where)
    form = _form(table)
    try:
        return form.model_validate(with_force_of_file(table, folder, files_below))
    except ValidationError as error:
        raise _in_one_line(error, form, where) from None
    except SceneError as error:
        raise error.at(where, _file_key(error.key, form)) from None


#: function that builds the Scene of each form
_SCENE_FROM: Mapping[type[BaseModel], Callable[[Any], Scene]] = {
    RawScene: from_raw,
    CylinderScene: from_cylinders,
    SphereScene: from_spheres,
    PatternScene: from_pattern,
    ImpactScene: from_impact,
}
#: the forms of a scene file
FORMS = tuple(_SCENE_FROM)


def _form(table: Mapping[str, Any]) -> type[BaseModel]:
    """Return the form of a file, recognised by the keys that only this form has."""
    if "impact" in table:
        return ImpactScene
    chain = table.get("chain")
    keys = chain if isinstance(chain, dict) else {}
    if "pattern" in keys or "materials" in table:
        return PatternScene
    if "spheres" in keys and "cylinders" not in keys:
        return SphereScene
    return CylinderScene if "material" in table or "cylinders" in keys else RawScene


#: keys of a Scene's attributes in a file, if they are not in [chain] under the same name
_FILE_KEYS = {
    "name": "name",
    "duration": "duration",
    "samples": "sampling.count",
    "precompression": "chain.precompression.force",
    **{key: f"environment.{key}" for key in Environment.model_fields},
}


def _file_key(key: str, form: type[BaseModel]) -> str:
    """Return the key of a Scene's attribute in a file."""
    if key.startswith(("material.", "materials.", "impact.")):
        return key
    return _FILE_KEYS.get(key, f"{'impact' if form is ImpactScene else 'chain'}.{key}")


#: pydantic's words, and those of a scene file
_PLAIN_WORDS = {
    "a valid boolean": "true or false",
    "False, True": "false, true",
    "a valid integer": "a whole number",
    "a valid ": "a ",
}
#: pydantic's names of the two forms of a key that takes a number or a list of them
_ALTERNATIVES = ("float", "list[float]")


def _in_one_line(error: ValidationError, form: type[BaseModel], where: str) -> SceneError:
    """Return the first of pydantic's errors, unknown keys first, because a misspelt key also shows as a missing one."""
    findings = sorted(error.errors(), key=lambda finding: finding["type"] != "extra_forbidden")
    finding = findings[0]
    # a key that takes a number or a list has an error for each; the type of the input selects the relevant one
    if isinstance(finding["input"], list) and _ALTERNATIVES[0] in finding["loc"]:
        finding = next((f for f in findings if _ALTERNATIVES[1] in f["loc"]), finding)
    advice = ""
    path = [part for part in finding["loc"] if part not in _ALTERNATIVES]
    key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path).removeprefix(".")
    key = key if key.isprintable() else repr(key)
    what: dict[str, Any] = {"value": finding["input"]}
    if finding["type"] == "extra_forbidden":
        what, allowed = {"problem": "is an unknown key"}, _keys(form, path[:-1])
        advice = meant(str(path[-1]), allowed.split(", "))
    elif finding["type"] == "missing":
        what, allowed = {"problem": "is missing, but required"}, f"the keys {_keys(form, path[:-1])}"
    elif finding["type"].startswith("model_"):
        allowed = f"a table with the keys {_keys(form, path)}"
    else:
        allowed = finding["msg"].removeprefix("Input should be ")
        for word, plain in _PLAIN_WORDS.items():
            allowed = allowed.replace(word, plain)
    return SceneError(key, **what, allowed=allowed, advice=advice, where=where)


def _keys(form: type[BaseModel], path: list[Any]) -> str:
    """Return the allowed keys of the table at ``path``."""
    inner: Any = form
    for part in path:
        # the type of an entry is the last argument of list[...] and dict[str, ...]
        inner = _fields(inner)[part].annotation if _is_table(inner) else get_args(inner)[-1]
        if not _is_table(inner) and NoneType in get_args(inner):
            inner = get_args(inner)[0]
    return ", ".join(_fields(inner))


def _is_table(kind: Any) -> bool:
    """Return True for a class of tables."""
    return isinstance(kind, type) and issubclass(kind, BaseModel)


def _fields(table: type[BaseModel]) -> Mapping[str, Any]:
    """Return the fields of a table by their keys in a file."""
    return {field.alias or name: field for name, field in table.model_fields.items()}


#: kind of measured values -> its name on a page; a digitised figure is not called data
NAMES = {"measured": "data", "digitised": "digitised figure", "synthetic": "synthetic data"}


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """Files of measured values, their source, and the uncertain parameters of the scene.

    ``files`` are CSV files. ``parameters`` maps the name of each uncertain parameter to its standard uncertainty (see
    the study "measurement" for the names). ``fit`` are the parameters that are fitted; None means
    all that belong to the whole scene.

    Examples
    --------
    >>> Measurement(files=(Path("laser.csv"),), parameters={"stiffness": 0.02}).name
    'data'
    """

    files: tuple[Path, ...]
    source: str = ""
    kind: str = "measured"
    parameters: Mapping[str, float] = field(default_factory=dict)
    fit: tuple[str, ...] | None = None

    @property
    def name(self) -> str:
        """Return what the values are called on a page."""
        return NAMES[self.kind]


def measurement_of(source: Scene | str | Path | None) -> Measurement | None:
    """Return the measurement of a scene file; None for a Scene, and for a file without the table [measurement].

    Raises
    ------
    SceneError
        If the file is not a valid scene file.
    """
    if source is None or isinstance(source, Scene):
        return None
    form, folder = read_form(source)
    table = form.measurement
    if table is None:
        return None
    try:
        files = tuple(
            named_file(folder, file) for file in ([table.file] if isinstance(table.file, str) else table.file)
        )
    except OSError as error:
        problem, allowed = f"cannot be read: {error.strerror}", "files below the folder of the scene file"
        raise SceneError("measurement.file", problem=problem, allowed=allowed, where=str(source)) from None
    return Measurement(
        files=files,
        source=table.source,
        kind=table.kind,
        parameters=table.parameters,
        fit=None if table.fit is None else tuple(table.fit),
    )
