"""Name the lines of a figure: one legend above all panels, or, where that would be high, names beside the lines."""

from __future__ import annotations

import textwrap
from collections.abc import Collection, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Annotation

from dem_bridge.report.drawing_styles import style_of
from dem_bridge.report.study import Panel, Series

THINNED = "circles and crosses: not all points are marked"
#: most rows of a legend above the panels
_ROWS = 2
#: most letters in a line of a name beside a panel; height of such a line, points
_LETTERS, _LINE = 24, 10.0
#: where the sample of a line beside its panel begins and ends, and where its name begins, as parts of the width
_SAMPLE, _NAME = (1.015, 1.075), 1.09


def names_fit(panels: Sequence[Panel], width: float) -> bool:
    """Return True if a legend of two rows, of a width in inches, has room for the names of all lines."""
    names = names_of(panels)
    return -(-len(names) // names_in_row(names, width)) <= _ROWS or any(panel.bars or panel.rows for panel in panels)


class Name(NamedTuple):
    """Hold the name of a line beside its panel, with the sample of the line, and the place of the end of the line."""

    text: Annotation
    sample: Line2D
    end: float


def name_lines(ax: Axes, panel: Panel) -> list[Name]:
    """Write the name of each line right of its panel, at the height of its end, with a sample of the line.

    Lines of one name are named once. Names may cover each other until :func:`move_apart` moves them.
    """
    lines: dict[str, Series] = {}
    for line in panel.series:
        if not line.label.startswith("_") and np.isfinite(line.y).any():
            lines.setdefault(line.label, line)
    x = [_SAMPLE[0], sum(_SAMPLE) / 2.0, _SAMPLE[1]]
    names: list[Name] = []
    figure = ax.get_figure(root=True)
    assert figure is not None
    for label, line in lines.items():
        end = _end(ax, line)
        style = {key: value for key, value in style_of(line.style).items() if key not in ("drawstyle", "zorder")}
        sample = Line2D(x, [end] * 3, transform=ax.transAxes, clip_on=False, markevery=[1], zorder=5.0, **style)
        figure.add_artist(sample)
        text = ax.annotate(
            textwrap.fill(label, _LETTERS), (_NAME, end), xycoords="axes fraction", va="center", fontsize=8.0
        )
        names.append(Name(text, sample, end))
    return names


def lines_of_names(panel: Panel) -> int:
    """Return how many lines of text the names beside a panel have."""
    return sum(len(textwrap.wrap(label, _LETTERS)) for label in names_of([panel]))


def move_apart(ax: Axes, names: Sequence[Name]) -> None:
    """Move the names beside a panel, whose size is known, so that none covers another."""
    height = 72.0 * ax.bbox.height / ax.get_figure(root=True).dpi  # type: ignore[union-attr]
    heights = [_LINE * (name.text.get_text().count("\n") + 1) / height for name in names]
    for name, place in zip(names, spread([name.end for name in names], heights), strict=True):
        name.text.xy = (_NAME, place)
        name.text.set_position((_NAME, place))
        name.sample.set_ydata([place] * 3)


def _end(ax: Axes, line: Series) -> float:
    """Return the height of the last point of a line, as a part of the height of the axes."""
    finite = np.flatnonzero(np.isfinite(line.y) & np.isfinite(line.x))
    last = finite[np.argmax(line.x[finite])]
    place = ax.transAxes.inverted().transform(ax.transData.transform((line.x[last], line.y[last])))[1]
    return float(np.clip(place, 0.0, 1.0)) if np.isfinite(place) else 0.0


def spread(places: Sequence[float], heights: Sequence[float]) -> list[float]:
    """Return places from 0 to 1, moved as little as needed so that things of these heights do not overlap.

    >>> [round(place, 3) for place in spread([0.5, 0.5, 0.9], [0.1, 0.1, 0.1])]
    [0.45, 0.55, 0.9]
    """
    order = sorted(range(len(places)), key=lambda k: (places[k], k))
    moved = [places[k] for k in order]
    for _ in range(200):
        for k in range(len(moved) - 1):
            lack = (heights[order[k]] + heights[order[k + 1]]) / 2.0 - (moved[k + 1] - moved[k])
            if lack > 0.0:
                moved[k] -= lack / 2.0
                moved[k + 1] += lack / 2.0
        if moved and moved[0] < 0.0:
            moved[0] = 0.0
        if moved and moved[-1] > 1.0:
            moved[-1] = 1.0
    return [moved[order.index(k)] for k in range(len(places))]


def draw_legend(figure: Figure, axes: Iterable[Axes]) -> None:
    """Draw a legend above all panels with each label once."""
    entries: dict[str, Any] = {}
    some = False
    for ax in axes:
        some |= thinned(ax)
        handles: list[Any] = [*ax.get_lines(), *ax.containers, *ax.collections]
        for line in handles:
            if not str(line.get_label()).startswith("_"):
                entries.setdefault(str(line.get_label()), line)
    if not entries:
        return
    figure.legend(
        list(entries.values()),
        list(entries),
        loc="outside upper center",
        ncols=names_in_row(entries, figure.get_figwidth()),
        frameon=False,
        handlelength=3.4,
        title=THINNED if some else None,
        title_fontsize=8,
    )


def thinned(ax: Axes) -> bool:
    """Return True if not all points of a series have a marker."""
    lines = [line for line in ax.get_lines() if line.get_linestyle() == "None" and not line.get_path_effects()]
    marks = [line.get_markevery() for line in lines]
    return any(isinstance(every, tuple) and every[1] > 1 for every in marks)


def names_of(panels: Sequence[Panel]) -> set[str]:
    """Return the labels of all series."""
    return {line.label for panel in panels for line in panel.series}


def names_in_row(names: Collection[str], width: float) -> int:
    """Return the number of labels in a row of a legend of a width in inches."""
    widest = max(map(len, names), default=0)
    return max(1, min(len(names), int(11.5 * width) // (widest + 7)))
