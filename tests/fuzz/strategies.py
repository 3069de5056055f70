"""Draw whole files: scene files by the schema, input scripts by commands, dumps by frames, tables by headings.

The structure is mostly that of a valid file, and numbers and words are often extreme; hypothesis shrinks a file that
causes a fault to a small one.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from hypothesis import strategies as st
from pydantic import BaseModel

from dem_bridge.formats.readers.headings import NAMES
from dem_bridge.formats.units import STYLES, VALUES
from dem_bridge.scene.file import forms, impact
from tests.fuzz.mutate import WORDS

Draw = st.SearchStrategy[Any]


def _mostly(usual: Draw, *others: Draw, of: int = 15) -> Draw:
    """Draw a usual value, and one time in so many another one."""
    return st.integers(1, of).flatmap(lambda k: usual if k < of else st.one_of(*others))


#: numbers of bodies and samples; one beyond every limit among them
_WHOLE = _mostly(st.integers(1, 4), st.sampled_from([0, -1, 30, 10**9, 2**63, 10**30]))
_ORDINARY = st.sampled_from([1e-3, 0.01, 0.3, 1.0, 2.0, 2.5, 45.0, 3e3, 4e9])
_EXTREME = st.one_of(st.floats(), st.sampled_from([0, -1, 10**30, 1e-320, 1e308, -0.0, math.inf, math.nan]))
_NUMBER = _mostly(_ORDINARY, _EXTREME)
_WORD = _mostly(st.sampled_from(["a", "sphere", "b"]), st.text(max_size=5), st.sampled_from(WORDS), of=4)
#: words of the schema that its types do not name
_OF_KEYS = {
    "law": st.sampled_from(["dashpot", "mass_velocity", "kuwabara-kono", "coeff_restitution", "exact", "paper"]),
    "file": st.sampled_from(["force.csv", "missing.csv", "../force.csv", "/dev/zero", ""]),
    "material": st.just("steel"),
}


def _of_type(key: str, kind: Any) -> Draw:
    """Draw a value of an annotation of the schema."""
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _of_type(key, arguments[0])
    if origin is Literal:
        return st.sampled_from(arguments)
    if origin in (Union, UnionType):
        return st.one_of(*[_of_type(key, one) for one in arguments if one is not NoneType])
    if origin is list:
        return st.lists(_of_type(key, arguments[0]), min_size=2, max_size=3)
    if origin is dict:
        keys = st.just("steel") if key == "materials" else _WORD
        return st.dictionaries(keys, _of_type(key, arguments[1]), min_size=1, max_size=2)
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return _table(kind)
    return {float: _NUMBER, int: _WHOLE, bool: st.booleans()}.get(kind, _OF_KEYS.get(key, _WORD))


@st.composite
def _table(draw: st.DrawFn, model: type[BaseModel]) -> dict[str, Any]:
    """Draw a table with the required keys and some others; rarely one is left out or has a value of another type."""
    out: dict[str, Any] = {}
    for name, field in model.model_fields.items():
        key = field.alias or name
        kind = draw(st.integers(0, 39 if field.is_required() else 5))  # hypothesis shrinks it to 0, the usual kind
        if kind == (39 if field.is_required() else 5):
            out[key] = draw(st.one_of(_NUMBER, _WORD, st.just([]), st.just({})))
        elif kind > 3 or (field.is_required() and kind < 38):
            out[key] = draw(_of_type(key, field.annotation))
    return out


def _toml(value: Any) -> str:
    """Return a value as TOML in one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {_toml(part)}" for key, part in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return repr(value) if isinstance(value, float) else json.dumps(value)


@st.composite
def scene_files(draw: st.DrawFn) -> bytes:
    """Draw a scene file in TOML or JSON of any form."""
    document = draw(_table(draw(st.sampled_from(_FORMS))))
    lines = [f"{json.dumps(key)} = {_toml(value)}" for key, value in document.items()]
    return "\n".join(lines).encode("utf-8", "replace")


#: forms of a scene file
_FORMS: tuple[type[BaseModel], ...] = (
    forms.RawScene, forms.CylinderScene, forms.SphereScene, forms.PatternScene, impact.ImpactScene,
)  # fmt: skip
_NAMES = st.sampled_from(["i", "r", "m", "s", "x", "left"])
_VALUES = _mostly(
    st.sampled_from(["1", "2", "3", "0.01", "1e-3", "0.5", "*", "1*2"]),
    st.sampled_from(
        ["${r}", "$i", "$(v_r*2)", "v_i", "$(1/0)", "$(v_s:%.6f)", "${i}${r}", "sqrt(v_r)", "random(1,2,3)"]
    ),
    _NUMBER.map(repr),
    st.sampled_from(WORDS),
    of=4,
)
#: commands with places: N a name, V a value, C another command
_COMMANDS = (
    "variable N equal V", "variable N loop V V", "variable N index V V", "variable N string V", "variable N delete",
    "variable N getenv V", "variable N file V", "next N", "jump SELF again", "jump SELF V", "label again", "label V",
    "include more", "include in.pair", "include V", 'if "V > V" then "C" else "C"',
    'if "V == V" then "jump SELF again"',
    "units V", "units si", "atom_style sphere", "dimension V", "boundary f f V", "lattice sc V", "create_box V box",
    "region N block V V V V V V", "region box block 0 1 -1 1 -1 1 units box", "create_atoms V single V 0 0 units box",
    "create_atoms V single V V V", "create_atoms V region N", "create_atoms 1 box", "set atom V mass V", "print V",
    "set type V diameter V density V", "set group N mass V", "group N id V", "group N type V", "group N union N V",
    "velocity N set V V V", "velocity all set V 0 0 units box", "pair_style granular",
    "pair_style gran/hooke V V V V V V",
    "pair_style V", "pair_coeff V V hertz V V tangential linear_nohistory V V damping velocity", "pair_coeff V V V V",
    "pair_style table linear V", "pair_coeff V V V N", "fix N all nve", "fix N N gravity V vector V V V", "timestep V",
    "fix N N wall/gran granular hertz V V tangential linear_nohistory V V damping velocity xplane V V", "unfix N",
    "fix N all addforce V V V", "fix N N setforce V V V", "fix N all viscous V", "read_data data.pair", "read_data V",
    "thermo V", "run V", "run V upto", "reset_timestep V", "neigh_modify every V", "newton off", "replicate V V V",
    "dump N all custom V file id x", "V V V",
)  # fmt: skip


@st.composite
def _command(draw: st.DrawFn, depth: int = 0) -> str:
    """Draw a command."""
    drawn = {"N": lambda: draw(_NAMES), "V": lambda: draw(_VALUES), "C": lambda: draw(_command(depth + 1))}
    words = draw(st.sampled_from(_COMMANDS if depth < 2 else _COMMANDS[:5])).replace('"C"', '"C "').split(" ")
    return " ".join(drawn.get(word.strip('"'), lambda word=word: word)() for word in words)


@st.composite
def scripts(draw: st.DrawFn, whole: bytes) -> bytes:
    """Draw the lines of a whole script, some of them left out, with commands among them."""
    lines = []
    for line in whole.decode().splitlines():
        if draw(st.integers(0, 29)):
            lines.append(line)
        if not draw(st.integers(0, 7)):
            lines.append(draw(_command()))
    return "\n".join(lines).encode("utf-8", "replace")


@st.composite
def dumps(draw: st.DrawFn) -> bytes:
    """Draw the frames of a dump of two bodies: items, columns and numbers."""
    pool = ["id", "type", "x", "xu", "xs", "y", "z", "vx", "vy", "fx", "mass", "radius", "diameter", "displacement"]
    columns = (
        draw(st.lists(st.sampled_from([*pool, "", "c_1"]), min_size=1, max_size=6)) if draw(st.booleans()) else pool
    )
    number = _mostly(st.sampled_from(["0", "1e-5", "0.8", "0.008", "0.01"]), _EXTREME.map(repr), _WORD, of=60)
    text = ""
    for frame in range(draw(st.integers(0, 4))):
        step = draw(_mostly(st.just(str(10 * frame)), number))
        count = draw(_mostly(st.just("2"), st.sampled_from(["0", "1", "-1", "3", "1000000000", "2.0", ""])))
        text += "".join(
            [
                f"ITEM: UNITS\n{draw(st.sampled_from([*STYLES, 'x']))}\n" if draw(st.booleans()) else "",
                f"ITEM: TIME\n{draw(number)}\n" if draw(st.booleans()) else "",
                f"ITEM: TIMESTEP\n{step}\nITEM: NUMBER OF ATOMS\n{count}\n",
                "ITEM: BOX BOUNDS ff ff ff\n0 1\n0 1\n0 1\n" if draw(st.booleans()) else "",
                f"ITEM: ATOMS {' '.join(columns)}\n",
            ]
        )
        for body in range(draw(_mostly(st.just(2), st.sampled_from([0, 1, 3])))):
            row = [str(body + 1) if name == "id" else draw(number) for name in columns]
            text += " ".join(row[: draw(_mostly(st.none(), st.just(1), of=20))]) + "\n"
    return text.encode("utf-8", "replace")


@st.composite
def tables(draw: st.DrawFn) -> bytes:
    """Draw a table of samples: comments, headings with indices and units, delimiters and numbers."""
    names = [name for names in NAMES.values() for name in names]
    units = [unit for table in VALUES.values() for unit in table] + ["m/s", "mm_per_s", "x", ""]
    shapes = ["{0}", "{0}_{1}", "{0}[{1}]", "{0} {1} [{2}]", "{0}_{1}_{2}", "body {1} {0} ({2})", "{0} / {2}", "{2}"]
    index = st.sampled_from(["0", "1", "2", "9" * 20, "-1", "\u0663"])

    def heading() -> str:
        parts = draw(st.sampled_from(names)), draw(index), draw(st.sampled_from(units))
        return draw(st.sampled_from(shapes)).format(*parts)

    delimiter = draw(st.sampled_from([",", ";", "\t", " ", "  ", ", "]))
    width = draw(st.integers(1, 5))
    headings = ["time", "v0", "v1", "x0", "x1"][:width] if draw(st.booleans()) else [heading() for _ in range(width)]
    number = _mostly(st.sampled_from(["0.8", "0", "1e-5", "-0.25", "3"]), _EXTREME.map(repr), _WORD)
    comments = [f"# {draw(st.sampled_from(['dt', 'time step', 'units']))} = {draw(number)}"] * draw(st.integers(0, 1))
    rows = []
    for row in range(draw(st.integers(0, 5))):
        cells = [f"{row}e-5", *[draw(number) for _ in range(width - 1)]]
        rows.append(delimiter.join(cells[: draw(_mostly(st.none(), st.just(1), of=20))]))
    return "\n".join([*comments, delimiter.join(headings), *rows]).encode("utf-8", "replace")


Strategy = Callable[[list[bytes]], st.SearchStrategy[bytes]]
#: files that are drawn -> the reader of changed files that reads them, and their strategy by the sources of that reader
DRAWN: dict[str, tuple[str, Strategy]] = {
    "scene (drawn)": ("scene", lambda _: scene_files()),
    "deck (drawn)": ("deck", lambda sources: st.sampled_from(sources).flatmap(scripts)),
    "dump (drawn)": ("files to judge", lambda _: dumps()),
    "table (drawn)": ("files to judge", lambda _: tables()),
}
