"""Colours and styles of figures: lines and marks of the Okabe-Ito set, and maps for values and for signed errors.

A style is named by its form and holds arguments of matplotlib. Both maps can be told apart by colour-blind readers;
pages and pictures use the same colours of maps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.report.study import Map

BLACK = "#000000"
BLUE = "#0072B2"
VERMILION = "#D55E00"
GREEN = "#009E73"
PURPLE = "#CC79A7"
ORANGE = "#E69F00"
GREY = "#7F7F7F"
SKY = "#56B4E9"
PALE = "#C8C8C8"
HOLLOW: Mapping[str, Any] = {"markerfacecolor": "none", "markeredgewidth": 1.1}
#: style of a Series -> matplotlib arguments; all differ in grey, and markers at one place stay visible
STYLES: Mapping[str, Mapping[str, Any]] = {
    "blue circles": {"color": BLUE, "linestyle": "none", "marker": "o", "markersize": 4.5, **HOLLOW},
    "black line": {"color": BLACK, "linestyle": "-", "linewidth": 1.4},
    "vermilion squares": {
        "color": VERMILION,
        "linestyle": "--",
        "linewidth": 1.5,
        "marker": "s",
        "markersize": 7.0,
        **HOLLOW,
    },
    "purple triangles": {
        "color": PURPLE,
        "linestyle": "-.",
        "linewidth": 1.7,
        "marker": "^",
        "markersize": 10.0,
        **HOLLOW,
    },
    "green crosses": {"color": GREEN, "linestyle": "none", "marker": "x", "markersize": 4.5},
    "fit": {"color": ORANGE, "linestyle": ":", "linewidth": 2.4, "zorder": 4},
    "guide": {"color": GREY, "linestyle": (0, (9, 3)), "linewidth": 1.2},
    "mark-1": {"color": BLACK, "linestyle": "none", "marker": "*", "markersize": 9.0},
    "mark-2": {"color": BLUE, "linestyle": "none", "marker": "s", "markersize": 8.0, **HOLLOW},
    "mark-3": {"color": VERMILION, "linestyle": "none", "marker": "^", "markersize": 8.5, **HOLLOW},
    "mark-4": {"color": GREEN, "linestyle": "none", "marker": "+", "markersize": 9.0, "markeredgewidth": 1.8},
    "mark-5": {"color": PURPLE, "linestyle": "none", "marker": "D", "markersize": 11.0, **HOLLOW},
}
#: the style of a Series of a backend, under the name of the backend
OF_BACKEND: Mapping[str, str] = {
    "lammps-granular": "blue circles",
    "lammps-table": "blue circles",
    "reference": "black line",
    "bca": "vermilion squares",
    "adiabatic": "purple triangles",
    "ode45": "green crosses",
}
#: further styles: "front" is a Pareto front (wide, pale, behind everything), "below" an arrow down from an uncertainty,
#: "band" the pale area of the uncertainty around a line that is not drawn
FURTHER: Mapping[str, Mapping[str, Any]] = {
    "front": {"color": PALE, "linestyle": "-", "linewidth": 7.0, "drawstyle": "steps-post", "zorder": 0.5},
    "band": {"color": PALE, "linestyle": "-", "linewidth": 0.0, "zorder": 0.5},
    "below": {"color": BLACK, "linestyle": "none", "marker": "$\\downarrow$", "markersize": 11.0, "zorder": 4},
    "other": {"color": GREY, "linestyle": "-", "linewidth": 1.2},
}
#: colour, marker and size of marks of each backend in figures with many of them
MARKS: Mapping[str, tuple[str, str, float]] = {
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
CYCLE = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK)
#: forms of "nth/COLOUR/FORM" and of "line/COLOUR/FORM"
FORMS: Mapping[str, tuple[Mapping[str, Any], ...]] = {
    "nth": (
        {"linestyle": "-", "linewidth": 1.4},
        {"linestyle": "none", "marker": "o", "markersize": 4.5, **HOLLOW},
        {"linestyle": "none", "marker": "x", "markersize": 4.5},
        {"linestyle": (0, (4, 1.5)), "linewidth": 1.4},
        {"linestyle": "none", "marker": "s", "markersize": 6.5, **HOLLOW},
        {"linestyle": ":", "linewidth": 2.0},
    ),
    "line": (
        {"linestyle": "-", "linewidth": 1.4},
        {"linestyle": "-", "linewidth": 5.0, "alpha": 0.35},
        {"linestyle": "-", "linewidth": 1.0},
        {"linestyle": (0, (4, 1.5)), "linewidth": 1.4},
        {"linestyle": ":", "linewidth": 2.0},
        {"linestyle": "-.", "linewidth": 1.4},
    ),
}
#: dash pattern of a variant of a curve of a backend
DASHES: Mapping[str, Any] = {
    "": "-",
    "richardson": (0, (4, 1.5)),
    "physical": (0, (1, 1.2)),
    "both": (0, (4, 1.5)),
    "spline": "-",
    "linear": (0, (4, 1.5)),
    "lines": (0, (1, 1.2)),
}


#: colours at equal distances, from the least to the largest value: cividis of matplotlib
SEQUENTIAL = (
    "#00224e", "#002c64", "#0c3470", "#273e6e", "#38476c", "#46516c", "#535a6d", "#5f636f", "#6b6d72", "#777776",
    "#828079", "#908b78", "#9c9576", "#aaa073", "#b8aa6e", "#c6b667", "#d4c15f", "#e4ce53", "#f2da44", "#fee838",
)  # fmt: skip
#: colours of signed values: blue below zero, white at zero, orange above; the Okabe-Ito blue and vermilion, darkened
DIVERGING = ("#003d66", "#0072b2", "#7ab8e0", "#f7f7f7", "#f2a46f", "#d55e00", "#7a2e00")


def rgb(colours: Sequence[str], fractions: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return the colours (..., 3) at fractions of a scale, which is 0 for the first colour and 1 for the last.

    >>> rgb(DIVERGING, np.array([0.0, 0.5, 2.0])).tolist()
    [[0, 61, 102], [247, 247, 247], [122, 46, 0]]
    """
    stops = np.array([[int(colour[at : at + 2], 16) for at in (1, 3, 5)] for colour in colours], dtype=float)
    places = np.clip(fractions, 0.0, 1.0) * (len(stops) - 1)
    return np.stack(
        [np.rint(np.interp(places, np.arange(len(stops)), stops[:, part])) for part in range(3)], axis=-1
    ).astype(np.uint8)


def colour_limits(maps: Sequence[Map]) -> tuple[float, float, str]:
    """Return the smallest and the largest value of a colour scale for all maps, and the ends that values exceed.

    The extreme values of 19 of 20 columns lie within the scale. A percentile of all values would depend on how much of
    a map is at rest.
    """
    tops, bottoms = [], []
    for data in maps:
        finite = np.where(np.isfinite(data.values), data.values, np.nan)
        full = finite[:, np.isfinite(finite).any(axis=0)]
        if full.size:
            tops.append(np.nanmax(full, axis=0))
            bottoms.append(np.nanmin(full, axis=0))
    if not tops:
        return 0.0, 1.0, "neither"
    high, low = np.concatenate(tops), np.concatenate(bottoms)
    top, bottom = float(np.percentile(high, 95.0)), float(np.percentile(low, 5.0))
    if any(data.diverging for data in maps):
        top = max(abs(top), abs(bottom))
        bottom = -top
    if not top > bottom:
        top, bottom = float(high.max()), float(low.min())
    if not top > bottom:
        top = bottom + 1.0
    step = (top - bottom) / 256.0  # one of 256 colours; smaller excesses are invisible
    ends = (float(low.min()) < bottom - step, float(high.max()) > top + step)
    extend = {(False, False): "neither", (True, False): "min", (False, True): "max", (True, True): "both"}[ends]
    return bottom, top, extend
