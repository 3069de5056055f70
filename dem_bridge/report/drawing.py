"""Draw any figure (a FigureData), and write the same numbers as CSV.

Lines and marks are those of :mod:`.strokes`; maps have cividis, which colour-blind readers can tell and which rises
evenly in lightness, so that a page printed in grey keeps its meaning. Every figure has the width of a
page, so that a text of 10 points is read as such.
"""

from __future__ import annotations

import csv
import io
import re
import textwrap
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from itertools import groupby
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogFormatterMathtext, LogLocator, MaxNLocator, NullFormatter
from numpy.typing import NDArray

from dem_bridge.report.strokes import STYLES, style_of, style_on_map
from dem_bridge.studies.study import FigureData, Map, Panel, Series

#: rises evenly in lightness, alike for all eyes; of either sign too, where a scale of two hues is two-valued in grey
COLOURS = "cividis"
#: inches; at 100 pixels to the inch the width of a page
WIDTH = 11.0
_HEIGHT = {"map": 3.7, "series": 3.0}
#: of a title to the inch
_LETTERS = 8.4
_THINNED = "circles and crosses: not all points are marked"
#: marks along a line; more would run together
_MARKS, _MARKS_ON_LINE = 24, 9


def drawn(data: FigureData) -> Figure:
    """The figure, panels in rows of ``data.columns``, titles and notes above each, one legend above all.

    Panels that share a scale have the same colours, or without map the same y axis. The scale of maps is that of the
    fronts in them: bodies that are far faster than the rest, as the last one flying off, leave it by an arrow.
    """
    panels, columns = data.panels, max(1, min(data.columns, len(data.panels)))
    rows = [list(range(at, min(at + columns, len(panels)))) for at in range(0, len(panels), columns)]
    heights = [max(_height(panels[at]) for at in row) for row in rows]
    page = WIDTH if columns > 1 else 0.6 * WIDTH
    layout = ConstrainedLayoutEngine(w_pad=0.08, h_pad=0.08)
    rows_of_names = -(-len(_names(panels)) // _names_in_row(_names(panels), page))
    figure = Figure(figsize=(page, sum(heights) + 0.5 + 0.2 * max(0, rows_of_names - 2)), layout=layout)
    if not rows:
        return figure
    grid = figure.add_gridspec(len(rows), columns, height_ratios=heights)
    axes = [figure.add_subplot(grid[divmod(at, columns)]) for at in range(len(panels))]
    limits = {at: colour_limits([one.map for one in group if one.map is not None]) for at, group in _shared(panels)}
    images = {}
    for at, (ax, panel) in enumerate(zip(axes, panels, strict=True)):
        if panel.map is not None:
            images[at] = _draw_map(ax, panel.map, limits[at][:2])
        _draw_lines(ax, panel, page / columns)
    rowed = [ax for ax, panel in zip(axes, panels, strict=True) if panel.rows]
    for ax in rowed:  # one x axis for all
        ax.set_xlim(min(one.get_xlim()[0] for one in rowed), max(one.get_xlim()[1] for one in rowed))
    for group in _groups(panels):
        lines = [at for at in group if panels[at].map is None and not panels[at].rows]
        scale_together([axes[at] for at in lines], [panels[at] for at in lines])
    for row in rows:
        mapped = [at for at in row if at in images]
        for label_and_limits, alike in groupby(mapped, key=lambda at: (panels[at].map.label, limits[at])):  # type: ignore[union-attr]
            places = list(alike)
            label, (_, _, extend) = label_and_limits
            bar = figure.colorbar(
                images[places[0]], ax=[axes[at] for at in places], label=label, extend=extend, pad=0.02, aspect=28
            )
            bar.ax.locator_params(nbins=6)
    _legend(figure, axes)
    return figure


def drawn_on(ax: Axes, panel: Panel) -> Axes:
    """The panel on axes that are there, as :func:`drawn` draws it, with its own colour bar and legend; the axes."""
    figure = ax.get_figure(root=True)
    assert figure is not None
    if panel.map is not None:
        low, high, extend = colour_limits([panel.map])
        image = _draw_map(ax, panel.map, (low, high))
        bar = figure.colorbar(image, ax=ax, label=panel.map.label, extend=extend, pad=0.02, aspect=28)
        bar.ax.locator_params(nbins=6)
    inches = ax.get_position().width * figure.get_figwidth()
    _draw_lines(ax, panel, inches)
    if panel.map is None:
        scale_together([ax], [panel])
    if panel.series:
        columns = _names_in_row(_names([panel]), inches)
        rows, thinned = -(-len(_names([panel])) // columns), _thinned(ax)
        if panel.map is None:  # a strip of its own
            low, high = ax.get_ylim()
            high = max(high, *(_top(one) for one in panel.series))
            ax.set_ylim(low, high + (0.085 * (rows + thinned) + 0.02) * (high - low))
        ax.legend(
            # before the front of a map there is nothing to hide
            loc="upper left" if panel.map is None else "lower right",
            fontsize=9,
            frameon=panel.map is not None,
            handlelength=3.0,
            ncols=columns,
            title=_THINNED if thinned else None,
            title_fontsize=9,
        )
    return ax


def new_axes(height: float = _HEIGHT["map"]) -> Axes:
    """Axes in a figure of their own, as wide as one of a report. A notebook shows it, for pyplot knows it; without a
    display pyplot falls back on what can be saved."""
    from matplotlib import pyplot  # the report needs none

    return pyplot.figure(figsize=(0.6 * WIDTH, height), layout="constrained").add_subplot()


def png(data: FigureData, *, dpi: int = 130) -> bytes:
    """The picture as a file; the same numbers give the same bytes."""
    buffer = io.BytesIO()
    settled(drawn(data)).savefig(buffer, format="png", dpi=dpi, metadata={"Software": None})
    return buffer.getvalue()


def settled(figure: Figure) -> Figure:
    """The figure with its layout made once: while an engine for it is there, saving draws everything twice."""
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine("none")
    return figure


def csv_texts(data: FigureData) -> dict[str, str]:
    """File name -> CSV: all lines as ``<id>.csv`` in long form, and each map as a matrix in ``<id>-<letter>.csv``.

    In long form a map of 200 by 200 is 1.5 MB, as a matrix 0.25 MB. Its first row has x, its first column y.

    >>> one = Map(label="velocity (m/s)", x=np.array([1.0, 2.0]), y=np.array([0.5]), values=np.array([[0.1, 0.25]]))
    >>> panel = Panel(title="(a) slow", x_label="cylinder", y_label="time (ms)", map=one)
    >>> texts = csv_texts(FigureData(id="figure-2", title="", caption="", panels=(panel,)))
    >>> print(texts["figure-2-a.csv"], end="")
    velocity (m/s): time (ms) by cylinder,1.0,2.0
    0.5,0.1,0.25
    """
    texts = {}
    if any(panel.series for panel in data.panels):
        only_lines = tuple(replace(panel, map=None) for panel in data.panels)
        texts[f"{data.id}.csv"] = replace(data, panels=only_lines).as_csv()
    for place, panel in enumerate(data.panels, start=1):
        if panel.map is None:
            continue
        found = re.match(r"\((\w+)\)", panel.title)
        name = f"{data.id}-{found[1] if found else place}.csv"
        if name in texts:
            raise ValueError(f"{data.id}: two maps would be written to {name}; give each panel a letter of its own")
        texts[name] = _matrix(panel, panel.map)
    return texts


def colour_limits(maps: Sequence[Map]) -> tuple[float, float, str]:
    """Least and largest value of a scale for all ``maps``, and at which ends values leave it.

    The scale is that of the columns: 19 in 20 of them lie within it. A percentile of all values would follow from how
    much of a map is quiet.
    """
    tops, bottoms = [], []
    for one in maps:
        known = np.where(np.isfinite(one.values), one.values, np.nan)
        full = known[:, np.isfinite(known).any(axis=0)]
        if full.size:
            tops.append(np.nanmax(full, axis=0))
            bottoms.append(np.nanmin(full, axis=0))
    if not tops:
        return 0.0, 1.0, "neither"
    high, low = np.concatenate(tops), np.concatenate(bottoms)
    top, bottom = float(np.percentile(high, 95.0)), float(np.percentile(low, 5.0))
    if any(one.diverging for one in maps):
        top = max(abs(top), abs(bottom))
        bottom = -top
    if not top > bottom:
        top, bottom = float(high.max()), float(low.min())
    if not top > bottom:
        top = bottom + 1.0
    step = (top - bottom) / 256.0  # of a colour: less leaves no scale
    ends = (float(low.min()) < bottom - step, float(high.max()) > top + step)
    extend = {(False, False): "neither", (True, False): "min", (False, True): "max", (True, True): "both"}[ends]
    return bottom, top, extend


def scale_together(axes: Sequence[Axes], panels: Sequence[Panel]) -> None:
    """One y axis for all. Linear ones begin at zero; a first point above twice the rest is named in its panel instead
    of squeezing the others: next to the striker a chain has such a one."""
    series = [[line.y[np.isfinite(line.y)] for line in panel.series if np.isfinite(line.y).any()] for panel in panels]
    lines = [y for one in series for y in one]
    if not lines:
        return
    if panels[0].log:
        low = min(float(y[y > 0.0].min()) for y in lines if (y > 0.0).any())
        high = max(float(y.max()) for y in lines)
        margin = max((high / low) ** 0.06, 1.02)
        for ax in axes:
            ax.set_ylim(low / margin, high * margin)
        return
    rest = [value for y in lines for value in (y[1:] if len(y) > 1 else y)]
    low, high = min(0.0, *rest), max(0.0, *rest)
    near = [float(y[0]) for y in lines if low <= y[0] <= 2.0 * high]
    high = max([high, *near])
    if not high > low:
        low, high = low - 1.0, high + 1.0
    room = 0.06 * (high - low)
    beyond = any(y[0] > high + room for y in lines)
    top = high + room * (3.5 if beyond else 1.0)  # a strip for what is said of it
    for ax, one, panel in zip(axes, series, panels, strict=True):
        ax.set_ylim(low - room if low < 0.0 else 0.0, top)
        first = max((float(y[0]) for y in one), default=0.0)
        if beyond and first > high + room:
            _name_off_scale(ax, panel, first)


def _name_off_scale(ax: Axes, panel: Panel, first: float) -> None:
    at = next(float(line.x[0]) for line in panel.series if len(line.x) and line.y[0] == first)
    _, top = ax.get_ylim()
    unit = re.search(r"\((.*)\)\s*$", panel.y_label)
    what = re.split(r"[,(]", panel.x_label)[0].strip()
    note = ax.annotate(
        f"{what} {at:g}: {first:.4g} {unit[1] if unit else ''}, off scale",
        xy=(at, 0.985 * top),
        xytext=(0.12, 0.925),
        textcoords="axes fraction",
        va="center",
        arrowprops={"arrowstyle": "->"},
    )
    note.set_in_layout(False)  # a note gives way to the axes, not they to it


def _top(line: Series) -> float:
    """The largest value with its bar."""
    bar = np.zeros(1) if line.bar is None else np.where(np.isfinite(line.bar), line.bar, 0.0)
    return float(np.nanmax(line.y + bar, initial=-np.inf))


def _draw_map(ax: Axes, one: Map, limits: tuple[float, float]) -> Any:
    image = ax.pcolormesh(
        one.x, one.y, one.values, cmap=COLOURS, vmin=limits[0], vmax=limits[1], shading="nearest", rasterized=True
    )
    ax.set(xlim=ax.get_xlim(), ylim=ax.get_ylim())  # lines that go on beyond a map do not stretch it
    return image


def _draw_series(ax: Axes, line: Series, *, on_map: bool) -> None:
    style = style_of(line.style)
    n = len(line.x)
    if on_map:
        style = style_on_map(line.style)
    elif line.style.startswith("curve/") or line.style == "below":
        pass  # each point is a setting of its own
    elif style["linestyle"] == "none":
        every = max(1, -(-n // _MARKS))
        # two sets of marks that agree stand beside each other, not on top
        style["markevery"] = (every // 2 if style["marker"] == "x" else 0, every)
        style["zorder"] = 3
    elif style.get("marker"):
        every = max(1, n // _MARKS_ON_LINE)
        style["markevery"] = (min(every // 3 if style["marker"] == "s" else 2 * every // 3, max(n - 1, 0)), every)
    if n == 1 and not style.get("marker"):
        style["marker"] = "D"  # a line of one point is none
    ax.plot(line.x, line.y, label=line.label, **style)
    if line.bar is not None and np.isfinite(line.bar).any():
        bar = np.where(np.isfinite(line.bar), line.bar, 0.0)
        ax.errorbar(line.x, line.y, yerr=bar, fmt="none", ecolor=style["color"], elinewidth=1.0)


def _draw_lines(ax: Axes, panel: Panel, inches: float) -> None:
    """All but the map, in a place that many inches wide."""
    for line in panel.series:
        _draw_series(ax, line, on_map=panel.map is not None)
    _dress(ax, panel, inches)


def _dress(ax: Axes, panel: Panel, inches: float) -> None:
    """Names, notes and ticks."""
    width = int(_LETTERS * inches)
    head = textwrap.fill(panel.title, width)
    notes = "\n".join(textwrap.fill(note, int(1.35 * width)) for note in panel.notes)
    ax.set_title(
        head, loc="left", fontsize=11, fontweight="bold", pad=6 + 12.5 * (notes.count("\n") + 1 if notes else 0)
    )
    if notes:
        ax.annotate(
            notes, (0.0, 1.0), xytext=(0.0, 4.0), xycoords="axes fraction", textcoords="offset points", fontsize=9
        )
    ax.set(xlabel=panel.x_label, ylabel=panel.y_label)
    xs = [line.x for line in panel.series] + ([panel.map.x] if panel.map is not None else [])
    if panel.rows:
        ax.set(xscale="log", ylim=(len(panel.rows) - 0.5, -0.5))
        ax.set_yticks(range(len(panel.rows)), [textwrap.shorten(name, 44, placeholder=" ...") for name in panel.rows])
        ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    elif panel.log and all(_decades(values) is not None for values in (xs, [line.y for line in panel.series])):
        ax.set(xscale="log", yscale="log")
        for axis, values in ((ax.xaxis, xs), (ax.yaxis, [line.y for line in panel.series])):
            decades = _decades(values) or 0.0
            subs = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0) if decades < 1.3 else (1.0, 2.0, 5.0) if decades < 2.3 else (1.0,)
            axis.set_major_locator(LogLocator(subs=subs))
            wide = LogFormatterMathtext() if decades >= 3.0 else FuncFormatter(lambda value, _: f"{value:g}")
            axis.set_major_formatter(wide)
            axis.set_minor_formatter(NullFormatter())
    else:
        whole = bool(xs) and all(np.array_equal(x, np.round(x)) for x in xs)
        ax.xaxis.set_major_locator(
            MaxNLocator(nbins=8 if whole else 6, integer=whole, steps=[1, 2, 5, 10] if whole else [1, 2, 2.5, 5, 10])
        )
        if whole and len({x for line in xs for x in line.tolist()}) == 1:  # matplotlib would show thousandths of a body
            ax.set_xlim(float(xs[0][0]) - 1.0, float(xs[0][0]) + 1.0)
    if panel.map is None:
        ax.grid(alpha=0.25, which="both")


def _decades(values: Sequence[NDArray[np.float64]]) -> float | None:
    """That the positive values span; None without any."""
    known = np.concatenate([np.empty(0), *(one[np.isfinite(one) & (one > 0.0)] for one in values)])
    return float(np.log10(known.max() / known.min())) if known.size else None


def _legend(figure: Figure, axes: Iterable[Axes]) -> None:
    """Each name once, above all panels, where it hides nothing."""
    entries: dict[str, Line2D] = {}
    thinned = False
    for ax in axes:
        thinned |= _thinned(ax)
        for line in ax.get_lines():
            entries.setdefault(str(line.get_label()), line)
    if not entries:
        return
    figure.legend(
        list(entries.values()),
        list(entries),
        loc="outside upper center",
        ncols=_names_in_row(entries, figure.get_figwidth()),
        frameon=False,
        handlelength=3.4,
        title=_THINNED if thinned else None,
        title_fontsize=9,
    )


def _thinned(ax: Axes) -> bool:
    """Whether marks stand for more points than they are."""
    marks = [line.get_markevery() for line in ax.get_lines() if line.get_linestyle() == "None"]
    return any(isinstance(every, tuple) and every[1] > 1 for every in marks)


def _names(panels: Sequence[Panel]) -> set[str]:
    return {line.label for panel in panels for line in panel.series}


def _names_in_row(names: Collection[str], width: float) -> int:
    """Of a legend in a figure that many inches wide."""
    widest = max(map(len, names), default=0)
    return max(1, min(len(names), int(10.0 * width) // (widest + 7)))


def _height(panel: Panel) -> float:
    if panel.rows:
        return 1.0 + 0.3 * len(panel.rows) + 0.17 * len(panel.notes)
    height = _HEIGHT["map" if panel.map is not None else "series"]
    return (1.5 if panel.tall else 1.0) * height + 0.17 * len(panel.notes)


def _groups(panels: Sequence[Panel]) -> list[list[int]]:
    """Places of panels that share a scale, by what any of them says of another."""
    group = list(range(len(panels)))
    for at, panel in enumerate(panels):
        for other in panel.shares_scale_with:
            if not 0 <= other < len(panels):
                raise ValueError(f"panel {at} shares its scale with {other}; the figure has {len(panels)} panels")
            old, new = group[at], group[other]
            group = [new if one == old else one for one in group]
    return [[at for at, one in enumerate(group) if one == name] for name in dict.fromkeys(group)]


def _shared(panels: Sequence[Panel]) -> list[tuple[int, list[Panel]]]:
    return [(at, [panels[other] for other in group]) for group in _groups(panels) for at in group]


def _matrix(panel: Panel, one: Map) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([f"{one.label}: {panel.y_label} by {panel.x_label}", *one.x.tolist()])
    writer.writerows([y, *row] for y, row in zip(one.y.tolist(), one.values.tolist(), strict=True))
    return text.getvalue()


__all__ = [
    "STYLES",
    "Axes",
    "colour_limits",
    "csv_texts",
    "drawn",
    "drawn_on",
    "new_axes",
    "png",
    "scale_together",
    "settled",
]
