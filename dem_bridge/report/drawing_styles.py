"""Set how panels look: lines and markers, axes that several panels share, and ticks.

Each backend has one colour, marker and dash pattern in all figures, which :mod:`.styles` has. Colours are the Okabe-Ito
set (legible for colour-blind readers); lines and marks also differ in form, so that a page printed in grey keeps its
meaning.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter
from numpy.typing import NDArray

from dem_bridge.backends.catalogue import BACKENDS
from dem_bridge.report.study import Panel
from dem_bridge.report.styles import BLUE, CYCLE, DASHES, FORMS, FURTHER, GREY, MARKS, OF_BACKEND, ORANGE, STYLES

#: markers that no code of the data has
_FREE_MARKS = ("h", "8", "d", "<", "H")
#: backends with a single setting, which have a marker and no line
_ALONE = ("reference", "bca", "adiabatic")


#: lines over a map: thin, so that they do not hide the front, and black or white with an edge of the other, so that
#: they are visible on every colour of the map
#: (almost black and almost white, because exact ones are exchanged on a dark page)
_DARK, _LIGHT = "#010101", "#fefefe"
_ON_MAP = {"bca": (_LIGHT, "none"), "adiabatic": (_LIGHT, "-.")}
#: a front that lies on that of the map has markers at every fifth body, between which the map is seen
_ON_FRONT = {"marker": "o", "markersize": 4.5, "markerfacecolor": "none", "markevery": (4, 5)}
#: width, with names beside the lines, below which numbers at 1, 2 and 5 of a decade cover each other, inches
_NARROW = 3.0
#: digits and sign of a power
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
#: bars of a row: fill and hatching
BARS: tuple[Mapping[str, Any], ...] = ({"color": BLUE}, {"color": ORANGE, "hatch": "////"})


def _free_mark(code: str) -> str:
    """Return the marker of a code that the data do not name: a free one for each backend, and one for all others.

    >>> _free_mark("unknown")
    '>'
    """
    others = [name for name in BACKENDS if name not in MARKS]
    return _FREE_MARKS[others.index(code) % len(_FREE_MARKS)] if code in others else ">"


def style_of(name: str) -> dict[str, Any]:
    """Return the matplotlib arguments of the style of a Series.

    A style is a key of :data:`~dem_bridge.report.styles.STYLES`, the name of a backend, "front", "below",
    "curve/BACKEND/VARIANT", "mark/BACKEND" (markers without a line), or "nth/COLOUR/FORM" or "line/COLOUR/FORM" by
    number. An unknown style is grey.

    >>> style_of("curve/verlet")["marker"], style_of("curve/verlet/richardson")["linestyle"]
    ('v', (0, (4, 1.5)))
    """
    if name.startswith(("nth/", "line/")):
        kind, colour, form = name.split("/")
        return {"color": CYCLE[int(colour) % len(CYCLE)], **FORMS[kind][int(form) % len(FORMS[kind])]}
    if not name.startswith(("curve/", "mark/")):
        return dict(STYLES.get(OF_BACKEND.get(name, name)) or FURTHER.get(name) or FURTHER["other"])
    kind, code, variant = f"{name}/".split("/")[:3]
    colour, mark, size = MARKS.get(code) or (GREY, _free_mark(code), 5.5)
    filled = variant == "richardson" or code in _ALONE
    return {
        "color": colour,
        "marker": mark,
        "markersize": size,
        "markeredgewidth": 1.2,
        "markerfacecolor": colour if filled else "white",
        "linestyle": "none" if kind == "mark" or code in _ALONE else DASHES.get(variant, "-."),
        "linewidth": 1.3,
        "zorder": 3 if code in _ALONE or mark == "x" else 2,
    }


def style_on_map(name: str) -> dict[str, Any]:
    """Return the matplotlib arguments of a line over a map."""
    ink, dash = _ON_MAP.get(name, (_LIGHT, "-"))
    edge = withStroke(linewidth=1.7, foreground=_DARK if ink == _LIGHT else _LIGHT)
    marks = _ON_FRONT if dash == "none" else {}
    return {"color": ink, "linestyle": dash, "linewidth": 0.8, "path_effects": [edge], **marks}


def groups_of_scale(panels: Sequence[Panel]) -> list[list[int]]:
    """Return the groups of indices of panels that share a scale."""
    group = list(range(len(panels)))
    for k, panel in enumerate(panels):
        for other in panel.shares_scale_with:
            if not 0 <= other < len(panels):
                raise ValueError(f"panel {k} shares its scale with {other}; the figure has {len(panels)} panels")
            old, new = group[k], group[other]
            group = [new if label == old else label for label in group]
    return [[k for k, label in enumerate(group) if label == name] for name in dict.fromkeys(group)]


def scale_together(axes: Sequence[Axes], panels: Sequence[Panel]) -> None:
    """Set the same y axis for all axes.

    A linear axis begins at zero. A first point above twice the others, as next to the striker of a chain, is off scale
    and stated in a note, so that it does not compress the others.
    """
    series = [[y[np.isfinite(y)] for y in _curves(panel) if np.isfinite(y).any()] for panel in panels]
    lines = [y for curves in series for y in curves]
    if not lines:
        return
    if panels[0].log or panels[0].log_y:
        if not any((y > 0.0).any() for y in lines):
            return
        low = min(float(y[y > 0.0].min()) for y in lines if (y > 0.0).any())
        high = max(float(y.max()) for y in lines)
        margin = max((high / low) ** 0.1, 1.02)  # room for half a marker
        for ax in axes:
            ax.set_ylim(low / margin, high * margin)
        return
    rest = [value for y in lines for value in (y[1:] if len(y) > 1 else y)]
    low, high = min(0.0, *rest), max(0.0, *rest)
    near = [float(y[0]) for y in lines if 2.0 * (low - high) <= y[0] <= 2.0 * high]
    low, high = min([low, *near]), max([high, *near])
    if not high > low:
        low, high = low - 1.0, high + 1.0
    room = 0.06 * (high - low)
    firsts = [
        max((float(y) for line in panel.series for y in line.y[:1] if np.isfinite(y)), default=0.0) for panel in panels
    ]
    beyond = max(firsts) > high + room
    top = high + room * (3.5 if beyond else 1.0)  # room for the note
    for ax, first, panel in zip(axes, firsts, panels, strict=True):
        ax.set_ylim(low - room if low < 0.0 else 0.0, top)
        if first > high + room:
            _name_off_scale(ax, panel, first)


def _curves(panel: Panel) -> list[NDArray[np.float64]]:
    """Return the lines of a panel, and the edges of its bands and, on a linear axis, of its bars."""
    curves = [line.y for line in panel.series]
    linear = not (panel.log or panel.log_y)
    bands = [(line.y, line.bar) for line in panel.series if line.bar is not None and (linear or line.style == "band")]
    return [*curves, *(y + side * bar for y, bar in bands for side in (-1.0, 1.0))]


def _name_off_scale(ax: Axes, panel: Panel, first: float) -> None:
    """Write a note about a first point that is off scale."""
    x = next(float(line.x[0]) for line in panel.series if len(line.x) and line.y[0] == first)
    _, top = ax.get_ylim()
    unit = re.search(r"\((.*)\)\s*$", panel.y_label)
    noun = re.split(r"[,(]", panel.x_label)[0].strip()
    note = ax.annotate(
        f"{noun} {x:g}: {first:.4g} {unit[1] if unit else ''}, off scale",
        xy=(x, 0.985 * top),
        xytext=(0.12, 0.925),
        textcoords="axes fraction",
        va="center",
        arrowprops={"arrowstyle": "->"},
    )
    note.set_in_layout(False)  # the note does not change the size of the axes


def set_scales(ax: Axes, panel: Panel, inches: float) -> None:
    """Set the limits and ticks of a panel of a width in inches."""
    xs = [line.x for line in panel.series] + ([panel.map.x] if panel.map is not None else [])
    ys = [line.y for line in panel.series]
    if panel.rows:
        _set_rows(ax, panel, xs)
    elif panel.log and _decades(xs) is not None and _decades(ys) is not None:
        _set_logarithmic(ax, xs, ys, inches)
    else:
        _set_linear(ax, xs, inches)
        if panel.log_y and _decades(ys) is not None:
            ax.set_yscale("log")
            ax.yaxis.set_major_locator(LogLocator(numticks=6))
            ax.yaxis.set_major_formatter(FuncFormatter(power_of_ten))
            ax.yaxis.set_minor_formatter(NullFormatter())


def _set_rows(ax: Axes, panel: Panel, xs: Sequence[NDArray[np.float64]]) -> None:
    """Name the rows of a panel, and set its x axis, which is logarithmic unless it has bars."""
    ax.set(ylim=(len(panel.rows) - 0.5, -0.5))
    ax.set_yticks(range(len(panel.rows)), [textwrap.shorten(name, 44, placeholder=" ...") for name in panel.rows])
    for text in ax.get_yticklabels():
        text.set_fontweight("bold" if text.get_text().endswith(":") else "normal")
    if not panel.bars:
        ax.set_xscale("log")
        decades = _decades(xs) or 0.0
        positive = np.concatenate([x[x > 0.0] for x in xs])
        if decades > 4.0 and positive.min() < 1e-9:  # a scale of errors, from below round-off to one
            ax.set_xlim(min(1e-14, 0.3 * positive.min()), max(2.0, 3.0 * positive.max()))
        few = LogLocator(subs=(1.0, 2.0, 5.0)) if decades < 2.0 else LogLocator(numticks=5 if decades > 4.0 else None)
        ax.xaxis.set_major_locator(few)
        ax.xaxis.set_minor_formatter(NullFormatter())
        ax.xaxis.set_major_formatter(FuncFormatter(power_of_ten if decades > 4.0 else _plain))


def _set_logarithmic(
    ax: Axes, xs: Sequence[NDArray[np.float64]], ys: Sequence[NDArray[np.float64]], inches: float
) -> None:
    """Set two logarithmic axes, with more ticks where they span fewer decades and have room for their numbers."""
    ax.set(xscale="log", yscale="log")
    for axis, values in ((ax.xaxis, xs), (ax.yaxis, ys)):
        decades = _decades(values) or 0.0
        subs: tuple[float, ...] = (
            (1.0, 1.5, 2.0, 3.0, 5.0, 7.0) if decades < 0.7 else (1.0, 2.0, 5.0) if decades < 2.0 else (1.0,)
        )
        if axis is ax.xaxis and inches < _NARROW and 1.3 < decades < 2.0:
            subs = (1.0, 3.0)
        axis.set_major_locator(LogLocator(subs=subs))
        axis.set_major_formatter(FuncFormatter(power_of_ten if decades >= 3.0 else _plain))
        axis.set_minor_formatter(NullFormatter())


def _set_linear(ax: Axes, xs: Sequence[NDArray[np.float64]], inches: float) -> None:
    """Set the ticks of a linear x axis; those of whole numbers are whole."""
    whole = bool(xs) and all(np.array_equal(x, np.round(x)) for x in xs)
    ax.xaxis.set_major_locator(
        MaxNLocator(
            nbins=8 if whole else 6 if inches > 2.6 else 3,
            integer=whole,
            steps=[1, 2, 5, 10] if whole else [1, 2, 2.5, 5, 10],
        )
    )
    if whole and len({x for line in xs for x in line.tolist()}) == 1:  # matplotlib would show thousandths of a body
        ax.set_xlim(float(xs[0][0]) - 1.0, float(xs[0][0]) + 1.0)


def _plain(value: float, _: float | None = None) -> str:
    """Return a number of an axis of few decades as text."""
    return f"{value:g}" if 1e-4 <= value < 1e6 else power_of_ten(value)


def power_of_ten(value: float, _: float | None = None) -> str:
    """Return a number of a logarithmic axis as text: 0.1, 1 and 10 as they are, others as powers of ten.

    >>> power_of_ten(1e-14), power_of_ten(0.1), power_of_ten(1000.0), power_of_ten(2e-6)
    ('10⁻¹⁴', '0.1', '10³', '2×10⁻⁶')
    """
    if not value > 0.0 or 0.05 < value < 20.0:
        return f"{value:g}"
    front, power = f"{value:.3e}".split("e")
    raised = str(int(power)).translate(_RAISED)
    return f"10{raised}" if float(front) == 1.0 else f"{float(front):g}×10{raised}"


def _decades(values: Sequence[NDArray[np.float64]]) -> float | None:
    """Return the number of decades that the positive values span; None without positive values."""
    positive = np.concatenate([np.empty(0), *(array[np.isfinite(array) & (array > 0.0)] for array in values)])
    return float(np.log10(positive.max() / positive.min())) if positive.size else None
