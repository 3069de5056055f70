"""Styles of lines and markers: one colour, marker and dash pattern for each backend in all figures.

Colours are the Okabe-Ito set (legible for colour-blind readers); lines and marks also differ in form, so that a page
printed in grey keeps its meaning.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.patheffects import withStroke

from dem_bridge.backends.base import ENGINE_BACKENDS

BLACK, BLUE, VERMILION, GREEN, PURPLE = "#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7"
ORANGE, GREY, SKY, PALE = "#E69F00", "#7F7F7F", "#56B4E9", "#C8C8C8"
_HOLLOW = {"markerfacecolor": "none", "markeredgewidth": 1.1}
_CIRCLES = {"color": BLUE, "linestyle": "none", "marker": "o", "markersize": 4.5, **_HOLLOW}
#: matplotlib arguments of each style of a Series; all differ in grey, and markers at one place stay visible
STYLES: Mapping[str, Mapping[str, Any]] = {
    **dict.fromkeys(ENGINE_BACKENDS, _CIRCLES),
    "reference": {"color": BLACK, "linestyle": "-", "linewidth": 1.4},
    "bca": {"color": VERMILION, "linestyle": "--", "linewidth": 1.5, "marker": "s", "markersize": 7.0, **_HOLLOW},
    "adiabatic": {"color": PURPLE, "linestyle": "-.", "linewidth": 1.7, "marker": "^", "markersize": 10.0, **_HOLLOW},
    "ode45": {"color": GREEN, "linestyle": "none", "marker": "x", "markersize": 4.5},
    "fit": {"color": ORANGE, "linestyle": ":", "linewidth": 2.4, "zorder": 4},
    "guide": {"color": GREY, "linestyle": (0, (9, 3)), "linewidth": 1.2},
    # markers of several quantities in one row
    "mark-1": {"color": BLACK, "linestyle": "none", "marker": "*", "markersize": 9.0},
    "mark-2": {"color": BLUE, "linestyle": "none", "marker": "s", "markersize": 8.0, **_HOLLOW},
    "mark-3": {"color": VERMILION, "linestyle": "none", "marker": "^", "markersize": 8.5, **_HOLLOW},
    "mark-4": {"color": GREEN, "linestyle": "none", "marker": "+", "markersize": 9.0, "markeredgewidth": 1.8},
    "mark-5": {"color": PURPLE, "linestyle": "none", "marker": "D", "markersize": 11.0, **_HOLLOW},
}
_OTHER: Mapping[str, Any] = {"color": GREY, "linestyle": "-", "linewidth": 1.2}
#: Pareto front of cost against error: a wide pale step line behind everything
_FRONT: Mapping[str, Any] = {
    "color": PALE,
    "linestyle": "-",
    "linewidth": 7.0,
    "drawstyle": "steps-post",
    "zorder": 0.5,
}
#: arrow down at an uncertainty: the value is below it
_BELOW: Mapping[str, Any] = {
    "color": BLACK,
    "linestyle": "none",
    "marker": "$\\downarrow$",
    "markersize": 11.0,
    "zorder": 4,
}
#: style "curve/BACKEND/VARIANT" in diagrams of many backends: colour, marker and size for each backend ...
_CODES: Mapping[str, tuple[str, str, float]] = {
    "lammps-granular": (BLUE, "o", 5.0),
    "lammps-table": (SKY, "s", 5.0),
    "verlet": (BLACK, "v", 5.5),
    "blanes-moan": (VERMILION, "D", 4.5),
    "ase": (GREY, "P", 6.0),
    "scipy": (ORANGE, "p", 6.5),
    "ode45": (GREEN, "x", 5.0),
    "reference": (BLACK, "*", 11.0),
    "bca": (VERMILION, "X", 8.0),
    "adiabatic": (PURPLE, "^", 8.0),
}
#: style "nth/COLOUR/FORM": numbered colours and forms for series without a style of their own
_COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK)
_FORMS: tuple[Mapping[str, Any], ...] = (
    {"linestyle": "-", "linewidth": 1.4},
    {"linestyle": "none", "marker": "o", "markersize": 4.5, **_HOLLOW},
    {"linestyle": "none", "marker": "x", "markersize": 4.5},
    {"linestyle": (0, (4, 1.5)), "linewidth": 1.4},
    {"linestyle": "none", "marker": "s", "markersize": 6.5, **_HOLLOW},
    {"linestyle": ":", "linewidth": 2.0},
)
#: style "line/COLOUR/FORM": numbered forms of long lines; form 1 is a broad pale line on which others lie
_LINES: tuple[Mapping[str, Any], ...] = (
    {"linestyle": "-", "linewidth": 1.4},
    {"linestyle": "-", "linewidth": 5.0, "alpha": 0.35},
    {"linestyle": "-", "linewidth": 1.0},
    {"linestyle": (0, (4, 1.5)), "linewidth": 1.4},
    {"linestyle": ":", "linewidth": 2.0},
    {"linestyle": "-.", "linewidth": 1.4},
)
#: backends with a single setting, which have a marker and no line
_ALONE = ("reference", "bca", "adiabatic")
_CODE = (GREY, ">", 5.5)
#: ... and a dash pattern for each variant; markers of extrapolated runs are filled
_DASHES: Mapping[str, Any] = {
    "": "-",
    "richardson": (0, (4, 1.5)),
    "physical": (0, (1, 1.2)),
    "both": (0, (4, 1.5)),
    "spline": "-",
    "linear": (0, (4, 1.5)),
    "lines": (0, (1, 1.2)),
}
#: lines over a map: thin, so that they do not hide the front, and black or white with an edge of the other, so that
#: they are visible on every colour of the map
_ON_MAP: Mapping[str, Mapping[str, Any]] = {
    name: {
        "color": ink,
        "linestyle": dash,
        "linewidth": 1.1,
        "path_effects": [withStroke(linewidth=2.4, foreground="black" if ink == "white" else "white")],
    }
    for name, ink, dash in (("bca", "black", "--"), ("adiabatic", "white", "-."), ("", "white", "-"))
}


def style_of(name: str) -> dict[str, Any]:
    """Return the matplotlib arguments of the style of a Series.

    A style is a key of :data:`STYLES`, "front", "below", "curve/BACKEND/VARIANT", "mark/BACKEND" (markers without a
    line), or "nth/COLOUR/FORM" or "line/COLOUR/FORM" by number. An unknown style is grey.

    >>> style_of("curve/verlet")["marker"], style_of("curve/verlet/richardson")["linestyle"]
    ('v', (0, (4, 1.5)))
    """
    if name in ("front", "below"):
        return dict(_FRONT if name == "front" else _BELOW)
    if name.startswith(("nth/", "line/")):
        forms = _FORMS if name.startswith("nth/") else _LINES
        colour, form = (int(number) for number in name.split("/")[1:])
        return {"color": _COLOURS[colour % len(_COLOURS)], **forms[form % len(forms)]}
    if not name.startswith(("curve/", "mark/")):
        return dict(STYLES.get(name, _OTHER))
    kind, code, variant = f"{name}/".split("/")[:3]
    ink, mark, size = _CODES.get(code, _CODE)
    filled = variant == "richardson" or code in _ALONE
    return {
        "color": ink,
        "marker": mark,
        "markersize": size,
        "markeredgewidth": 1.2,
        "markerfacecolor": ink if filled else "white",
        "linestyle": "none" if kind == "mark" or code in _ALONE else _DASHES.get(variant, "-."),
        "linewidth": 1.3,
        "zorder": 3 if code in _ALONE or mark == "x" else 2,
    }


def style_on_map(name: str) -> dict[str, Any]:
    """Return the matplotlib arguments of a line over a map."""
    return dict(_ON_MAP.get(name, _ON_MAP[""]))
