"""Styles of lines and markers: one colour, marker and dash pattern for each backend in all figures.

Colours are the Okabe-Ito set (legible for colour-blind readers); lines and marks also differ in form, so that a page
printed in grey keeps its meaning.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib.patheffects import withStroke

#: the data: colours of the Okabe-Ito set, and the matplotlib arguments of styles, whose colours have names here
_DATA = json.loads(Path(__file__).with_name("strokes.json").read_text(encoding="utf-8"))
_INK: Mapping[str, str] = _DATA["colours"]
BLACK, BLUE, VERMILION, GREEN = (_INK[name] for name in ("black", "blue", "vermilion", "green"))
#: backends with a single setting, which have a marker and no line
_ALONE = ("reference", "bca", "adiabatic")


def _dash(pattern: str | list[Any]) -> Any:
    """Return a dash pattern of the data for matplotlib."""
    return pattern if isinstance(pattern, str) else (pattern[0], tuple(pattern[1]))


def _arguments(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Return the matplotlib arguments of an entry of the data; markers are filled unless they are hollow."""
    style = {**entry, "linestyle": _dash(entry["linestyle"])}
    if "color" in style:
        style["color"] = _INK[style["color"]]
    if style.pop("hollow", False):
        style |= {"markerfacecolor": "none", "markeredgewidth": 1.1}
    return style


#: matplotlib arguments of each style of a Series; all differ in grey, and markers at one place stay visible
STYLES: Mapping[str, Mapping[str, Any]] = {name: _arguments(entry) for name, entry in _DATA["named"].items()}
#: further styles: "front" is a Pareto front (wide, pale, behind everything), "below" an arrow down from an uncertainty,
#: "band" the pale area of the uncertainty around a line that is not drawn
_FURTHER = {name: _arguments(entry) for name, entry in _DATA["further"].items()}
#: lines over a map: thin, so that they do not hide the front, and black or white with an edge of the other, so that
#: they are visible on every colour of the map
#: (almost black and almost white, because exact ones are exchanged on a dark page)
_DARK, _LIGHT = "#010101", "#fefefe"
_ON_MAP = {"bca": (_LIGHT, "none"), "adiabatic": (_LIGHT, "-.")}
#: a front that lies on that of the map has markers at every fifth body, between which the map is seen
_ON_FRONT = {"marker": "o", "markersize": 4.5, "markerfacecolor": "none", "markevery": (4, 5)}
#: bars of a row: fill and hatching
BARS: tuple[Mapping[str, Any], ...] = ({"color": BLUE}, {"color": _INK["orange"], "hatch": "////"})


def style_of(name: str) -> dict[str, Any]:
    """Return the matplotlib arguments of the style of a Series.

    A style is a key of :data:`STYLES`, "front", "below", "curve/BACKEND/VARIANT", "mark/BACKEND" (markers without a
    line), or "nth/COLOUR/FORM" or "line/COLOUR/FORM" by number. An unknown style is grey.

    >>> style_of("curve/verlet")["marker"], style_of("curve/verlet/richardson")["linestyle"]
    ('v', (0, (4, 1.5)))
    """
    if name.startswith(("nth/", "line/")):
        kind, colour, form = name.split("/")
        forms, colours = _DATA[kind], _DATA["cycle"]
        return _arguments({"color": colours[int(colour) % len(colours)], **forms[int(form) % len(forms)]})
    if not name.startswith(("curve/", "mark/")):
        return dict(STYLES.get(name) or _FURTHER.get(name) or _FURTHER["other"])
    kind, code, variant = f"{name}/".split("/")[:3]
    colour, mark, size = _DATA["codes"].get(code, ("grey", ">", 5.5))
    filled = variant == "richardson" or code in _ALONE
    return {
        "color": _INK[colour],
        "marker": mark,
        "markersize": size,
        "markeredgewidth": 1.2,
        "markerfacecolor": _INK[colour] if filled else "white",
        "linestyle": "none" if kind == "mark" or code in _ALONE else _dash(_DATA["dashes"].get(variant, "-.")),
        "linewidth": 1.3,
        "zorder": 3 if code in _ALONE or mark == "x" else 2,
    }


def style_on_map(name: str) -> dict[str, Any]:
    """Return the matplotlib arguments of a line over a map."""
    ink, dash = _ON_MAP.get(name, (_LIGHT, "-"))
    edge = withStroke(linewidth=1.7, foreground=_DARK if ink == _LIGHT else _LIGHT)
    marks = _ON_FRONT if dash == "none" else {}
    return {"color": ink, "linestyle": dash, "linewidth": 0.8, "path_effects": [edge], **marks}
