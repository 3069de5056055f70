"""The JSON Schema of scene files, with which editors complete keys, explain them and mark mistakes.

It is generated from the tables that check scene files, and has one ``anyOf`` over the forms. The numbers of entries of
lists and the rules between keys are checked when a scene is read, and are not in the schema.
"""

from __future__ import annotations

import ast
import inspect
import math
import textwrap
from collections.abc import Iterator
from typing import Any

from dem_bridge.scene.file.forms import RawTable, Table
from dem_bridge.scene.file.load import FORMS, SCHEMA

#: the dialect in which the schema is written
_DIALECT = "https://json-schema.org/draft/2020-12/schema"
#: the name of the file that ``dem-bridge new`` writes into the first line of a scene file, where editors look for it
SCHEMA_FILE = "dem-bridge.schema.json"


def scene_schema() -> dict[str, Any]:
    """Return the JSON Schema of scene files.

    Examples
    --------
    >>> schema = scene_schema()
    >>> [form["$ref"].rpartition("/")[2] for form in schema["anyOf"]]
    ['RawScene', 'CylinderScene', 'SphereScene', 'PatternScene', 'ImpactScene']
    >>> schema["$defs"]["Impact"]["properties"]["speed"]["description"]
    'Speed of approach, m/s; each of two spheres has half of it.'
    """
    tables: dict[str, Any] = {}
    for form in FORMS:
        table = form.model_json_schema()
        tables |= table.pop("$defs", {})
        table["properties"]["schema"] = {"const": SCHEMA, "description": "Version of this format."}
        tables[form.__name__] = table
    classes = {kind.__name__: kind for base in (Table, RawTable) for kind in _subclasses(base)}
    for name, table in tables.items():
        for key, text in _descriptions(classes[name]):
            # the name in a file, if it is not that of the field
            key = classes[name].model_fields[key].alias or key
            table["properties"][key].setdefault("description", text)
    return {
        "$schema": _DIALECT,
        "title": "Scene file of dem_bridge",
        "anyOf": [{"$ref": f"#/$defs/{form.__name__}"} for form in FORMS],
        "$defs": {name: _without_null(table) for name, table in sorted(tables.items())},
    }


def _subclasses(kind: type[Any]) -> Iterator[type[Any]]:
    """Yield all classes that are derived from a class."""
    for derived in kind.__subclasses__():
        yield derived
        yield from _subclasses(derived)


def _descriptions(kind: type[Any]) -> Iterator[tuple[str, str]]:
    """Yield each field of a class of tables that a text follows in the code, with this text in one line."""
    for owner in kind.__mro__:
        if owner.__module__.startswith("dem_bridge."):
            [defined] = ast.parse(textwrap.dedent(inspect.getsource(owner))).body
            assert isinstance(defined, ast.ClassDef)
            for entry, after in zip(defined.body, defined.body[1:], strict=False):
                match entry, after:
                    case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(text))):
                        yield name, " ".join(text.split())


def _without_null(schema: Any) -> Any:
    """Return a part of a schema without null, which TOML has not, without titles and without defaults that are none."""
    if isinstance(schema, list):
        return [_without_null(part) for part in schema]
    if not isinstance(schema, dict):
        return schema
    parts = {
        key: {name: _without_null(table) for name, table in value.items()}
        if key == "properties"
        else _without_null(value)
        for key, value in schema.items()
        if key != "title" and not (key == "default" and _is_none(value))
    }
    if alternatives := [part for part in parts.get("anyOf", ()) if part != {"type": "null"}]:
        parts["anyOf"] = alternatives
        if len(alternatives) == 1:
            del parts["anyOf"]
            return alternatives[0] | parts
    return parts


def _is_none(value: Any) -> bool:
    """Return True for a default that stands for no value."""
    return value is None or (isinstance(value, float) and math.isnan(value))
