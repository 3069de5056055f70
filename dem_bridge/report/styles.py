"""Colours of the Okabe-Ito set, and the matplotlib arguments of styles, which are named by their form."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

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
