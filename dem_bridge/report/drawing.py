"""Draw figures (FigureData) by matplotlib.

Styles of lines and markers are those of :mod:`.drawing_styles`. Maps have the colours of cividis, which colour-blind
readers can distinguish and whose lightness increases evenly, so that maps can be printed in grey. Every figure has the
width of a printed sheet, so that text has its size on paper: 8 points or more.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes as Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure, FigureBase
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.transforms import Bbox

from dem_bridge.report.drawing_names import (
    THINNED,
    draw_legend,
    lines_of_names,
    move_apart,
    name_lines,
    names_fit,
    names_in_row,
    names_of,
    thinned,
)
from dem_bridge.report.drawing_styles import (
    BARS,
    groups_of_scale,
    scale_together,
    set_scales,
    style_of,
    style_on_map,
)
from dem_bridge.report.study import FigureData, Map, Panel, Series
from dem_bridge.report.styles import DIVERGING, colour_limits

#: colour map with even lightness, and that of values of both signs
COLOURS = "cividis"
_SIGNED = LinearSegmentedColormap.from_list("signed", DIVERGING)
#: width of a figure, inches: that of a sheet of A4 between margins of 12 mm; width of a figure in a notebook
WIDTH, NOTEBOOK_WIDTH = 7.3, 6.6
_HEIGHT = {"map": 2.25, "series": 1.95}
#: height of a small multiple, inches
_SMALL = 1.05
#: width of names beside a panel, inches
_NAMES = 0.9
#: part of its height that a panel of a narrow figure has
_NARROW = 0.65
#: part of the width of a figure that the panels have that stand left of a last one
_LEFT = 0.42
#: sizes of text on a sheet, points; none is below 8
SHEET: Any = {
    "font.size": 8.5,
    "axes.labelsize": 8.5,
    "axes.titlesize": 9.0,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.5,
}
#: sizes of the title and the notes of a panel on a sheet and in a notebook, points
_ON_SHEET, _IN_NOTEBOOK = (9.0, 8.0), (11.0, 9.0)
#: letters of a title per inch, at 11 points
_LETTERS = 8.4
#: letters of a label of a y axis in a line: a panel is 2 inches high
_LETTERS_OF_Y = 30
#: letters of a label of an x axis that may stand out beside a panel
_LETTERS_OF_X = 15
#: largest number of markers of a series without a line, and along a line
_MARKS, _MARKS_ON_LINE = 24, 9
#: least uncertainty that is drawn, relative to the largest value: a third of the width of a line on a panel
_LEAST_BAR = 2e-3


@rc_context(SHEET)
def draw_figure(data: FigureData) -> Figure:
    """Draw a figure: panels in rows of ``data.columns``, titles and notes above each panel, one legend above all.

    Panels that share a scale have the same colour scale (maps) or y axis (lines). The colour scale of maps covers 19 of
    20 columns; an arrow of the colour bar marks values beyond it, such as those of a last body that flies off. With
    ``data.last_beside`` the last panel is as high as all others, and stands right of them, if there are others.
    """
    panels = [drawn_part(panel) for panel in data.panels]
    if data.small:
        return _draw_small(data)
    beside = data.last_beside and len(panels) > 1
    stacked = len(panels) - beside
    columns = max(1, min(data.columns, stacked))
    rows = [list(range(k, min(k + columns, stacked))) for k in range(0, stacked, columns)]
    wide = columns > 1 or beside or any(panel.rows for panel in panels)
    page = data.width * WIDTH if data.width else WIDTH if wide else 0.62 * WIDTH
    layout = ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.06)
    named = not names_fit(panels, page) and not beside and columns <= 2
    heights = [
        (0.85 if beside else _NARROW if data.width else 1.0) * max(_height(panels[k], named) for k in row)
        for row in rows
    ]
    names = names_of(panels)
    rows_of_names = 0 if named else -(-len(names) // names_in_row(names, page))
    figure = Figure(figsize=(page, sum(heights) + 0.35 + 0.17 * max(0, rows_of_names - 1)), layout=layout)
    if not rows:
        return figure
    left: FigureBase = figure
    right: FigureBase = figure
    if beside:
        left, right = figure.subfigures(1, 2, width_ratios=[_LEFT, 1.0 - _LEFT], squeeze=False)[0]
    grid = left.add_gridspec(len(rows), columns, height_ratios=heights)
    axes = [left.add_subplot(grid[divmod(k, columns)]) for k in range(stacked)]
    if stacked % columns:  # the last panel of a row that is not full has the room of those that are not there
        axes[-1].set_subplotspec(grid[(stacked - 1) // columns, (stacked - 1) % columns :])
    axes += [right.add_subplot() for _ in range(stacked, len(panels))]
    part = _LEFT if beside else 1.0
    widths = [page * part / columns - (_NAMES if named else 0.0)] * stacked + [page * (1.0 - part)]
    groups = groups_of_scale(panels)
    limits: dict[int, tuple[float, float, str]] = {}
    for group in groups:
        maps = [panel_map for k in group if (panel_map := panels[k].map) is not None]
        limits |= dict.fromkeys(group, colour_limits(maps))
    images = {}
    for k, (ax, panel) in enumerate(zip(axes, panels, strict=True)):
        if panel.map is not None:
            images[k] = _draw_map(ax, panel.map, limits[k][:2])
        _draw_lines(ax, panel, widths[k], _ON_SHEET)
    rowed = [ax for ax, panel in zip(axes, panels, strict=True) if panel.rows and not panel.bars]
    for ax in rowed:  # the same x axis for all
        ax.set_xlim(min(other.get_xlim()[0] for other in rowed), max(other.get_xlim()[1] for other in rowed))
    for group in groups:
        lines = [k for k in group if panels[k].map is None and not panels[k].rows]
        scale_together([axes[k] for k in lines], [panels[k] for k in lines])
    for row in [list(range(stacked))] if beside else rows:
        mapped = [k for k in row if k in images]
        for label_and_limits, alike in groupby(mapped, key=lambda k: (panels[k].map.label, limits[k])):  # type: ignore[union-attr]
            indices = list(alike)
            label, (_, _, extend) = label_and_limits
            _colour_bar(left, images[indices[0]], [axes[k] for k in indices], label, extend)
    if named:
        _name_beside(figure, axes, panels, rows)
    else:
        draw_legend(figure, axes)
    return figure


def _name_beside(figure: Figure, axes: Sequence[Axes], panels: Sequence[Panel], rows: Sequence[Sequence[int]]) -> None:
    """Name the lines of each panel beside it, unless those of the next panel of its row have the same names."""
    named = []
    for row in rows:
        for k in row:
            following = panels[k + 1] if k + 1 in row else None
            if following is None or following.map is not None or names_of([panels[k]]) != names_of([following]):
                named.append((axes[k], name_lines(axes[k], panels[k])))
    engine = figure.get_layout_engine()
    assert engine is not None
    engine.execute(figure)
    for ax, names in named:
        move_apart(ax, names)


def _draw_small(data: FigureData) -> Figure:
    """Draw small multiples: many panels without axes, each with its own scale."""
    rows = -(-len(data.panels) // data.columns)
    layout = ConstrainedLayoutEngine(w_pad=0.04, h_pad=0.04)
    figure = Figure(figsize=(WIDTH, _SMALL * rows), layout=layout)
    letters = int(_LETTERS * 11.0 / SHEET["font.size"] * (WIDTH / data.columns - 0.08))
    for nth, panel in enumerate(data.panels, start=1):
        ax = figure.add_subplot(rows, data.columns, nth)
        if panel.map is not None:
            _draw_map(ax, panel.map, colour_limits([panel.map])[:2])
        for line in panel.series:
            ax.plot(line.x, line.y, **style_of(line.style))
        ax.set_title("\n".join(textwrap.wrap(panel.title, letters)), loc="left", fontsize=8.0, pad=2.0)
        ax.set(xticks=[], yticks=[])
    return figure


def draw_panel(ax: Axes, panel: Panel) -> Axes:
    """Draw a panel on existing axes, with its own colour bar and legend, and return the axes."""
    figure = ax.get_figure(root=True)
    assert figure is not None
    panel = drawn_part(panel)
    if panel.map is not None:
        low, high, extend = colour_limits([panel.map])
        image = _draw_map(ax, panel.map, (low, high))
        _colour_bar(figure, image, [ax], panel.map.label, extend)
    inches = ax.get_position().width * figure.get_figwidth()
    _draw_lines(ax, panel, inches, _IN_NOTEBOOK)
    if panel.map is None:
        scale_together([ax], [panel])
    if panel.series:
        columns = names_in_row(names_of([panel]), inches)
        rows, some = -(-len(names_of([panel])) // columns), thinned(ax)
        if panel.map is None:  # room for the legend above the lines
            low, high = ax.get_ylim()
            high = max(high, *(_top(line) for line in panel.series))
            ax.set_ylim(low, high + (0.085 * (rows + some) + 0.02) * (high - low))
        ax.legend(
            # ahead of the front a map is empty
            loc="upper left" if panel.map is None else "lower right",
            fontsize=9,
            frameon=panel.map is not None,
            handlelength=3.0,
            ncols=columns,
            title=THINNED if some else None,
            title_fontsize=9,
        )
    return ax


def new_axes(height: float = 3.7) -> Axes:
    """Return axes in a new figure as wide as one of the report.

    The figure is one of pyplot, so that notebooks show it; without a display, pyplot uses a backend that saves files.
    """
    from matplotlib import pyplot  # here, because reports do not need pyplot

    return pyplot.figure(figsize=(NOTEBOOK_WIDTH, height), layout="constrained").add_subplot()


def fix_layout(figure: Figure) -> Figure:
    """Compute the layout of a figure once and return the figure, because saving with a layout engine draws twice.

    So does saving with the engine that does nothing, "none", in place of another one.
    """
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        with rc_context({"figure.autolayout": False, "figure.constrained_layout.use": False}):
            figure.set_layout_engine(None)
    return figure


def _top(line: Series) -> float:
    """Return the largest value plus its uncertainty."""
    bar = np.zeros(1) if line.bar is None else np.where(np.isfinite(line.bar), line.bar, 0.0)
    return float(np.nanmax(line.y + bar, initial=-np.inf))


def panel_boxes(figure: Figure) -> list[tuple[float, float, float, float]]:
    """Return the place of the legend and of each panel with its colour bar on a figure whose layout is fixed.

    Each is (left, top, width, height), points. Empty for a single panel, and for panels that share the names of rows.
    """
    renderer = FigureCanvasAgg(figure).get_renderer()  # type: ignore[no-untyped-call]
    axes = figure.get_axes()
    bars = [ax for ax in axes if ax.get_label() == "<colorbar>"]
    panels = [ax for ax in axes if ax not in bars]
    if len(panels) < 2 or not all(ax.get_visible() and _names_rows(ax) for ax in panels):
        return []
    # what is visible has a box
    boxes = [box for ax in panels if (box := ax.get_tightbbox(renderer)) is not None]
    for place in (box for bar in bars if (box := bar.get_tightbbox(renderer)) is not None):
        left = [k for k, box in enumerate(boxes) if box.y0 < (place.y0 + place.y1) / 2.0 < box.y1 and box.x0 < place.x0]
        if left:
            nearest = max(left, key=lambda k: boxes[k].x1)
            boxes[nearest] = Bbox.union([boxes[nearest], place])
    legends = [legend.get_window_extent(renderer) for legend in figure.legends]
    scale, height = 72.0 / figure.dpi, figure.bbox.height
    padded = [box.padded(3.0) for box in (*legends, *boxes)]
    return [(scale * b.x0, scale * (height - b.y1), scale * b.width, scale * b.height) for b in padded]


def _names_rows(ax: Axes) -> bool:
    """Return True if a panel can stand alone: it has a label of its y axis, or the names of its rows."""
    return bool(ax.get_ylabel()) or any(text.get_visible() and text.get_text() for text in ax.get_yticklabels())


def _draw_map(ax: Axes, data: Map, limits: tuple[float, float]) -> Any:
    """Draw a map and return its image."""
    image = ax.pcolormesh(
        data.x,
        data.y,
        data.values,
        cmap=_SIGNED if data.diverging else COLOURS,
        vmin=limits[0],
        vmax=limits[1],
        shading="nearest",
        rasterized=True,
    )
    ax.set(xlim=ax.get_xlim(), ylim=ax.get_ylim())  # lines beyond the map do not widen the axes
    return image


def _colour_bar(figure: FigureBase, image: Any, axes: Sequence[Axes], label: str, extend: str) -> None:
    """Draw the colour bar of maps beside their axes."""
    bar = figure.colorbar(image, ax=list(axes), label=label, extend=extend, pad=0.02, aspect=28)
    if bar.solids is not None:
        bar.solids.set_rasterized(True)
    bar.ax.locator_params(nbins=6)


def _draw_series(ax: Axes, line: Series, panel: Panel, least: float) -> None:
    """Draw a series of a panel with its markers, and uncertainties above ``least`` of its largest value."""
    style = style_of(line.style)
    n = len(line.x)
    if line.style == "band" and line.bar is not None:
        ax.fill_between(line.x, line.y - line.bar, line.y + line.bar, label=line.label, **style)
        return
    if panel.map is not None:
        style = style_on_map(line.style)
    elif line.style.startswith("curve/") or line.style == "below" or panel.rows:
        pass  # all points are marked, because each is a setting, or a result of a row
    elif style["linestyle"] == "none":
        every = max(1, -(-n // _MARKS))
        # markers of two series that agree are placed side by side
        style["markevery"] = (every // 2 if style["marker"] == "x" else 0, every)
        style["zorder"] = 3
    elif style.get("marker"):
        every = max(1, n // _MARKS_ON_LINE)
        style["markevery"] = (min(every // 3 if style["marker"] == "s" else 2 * every // 3, max(n - 1, 0)), every)
    if n == 1 and not style.get("marker"):
        style["marker"] = "D"  # a line of one point would be invisible
    ax.plot(line.x, line.y, label=line.label, **style)
    if line.bar is not None and np.isfinite(line.bar).any():
        bar = np.where(np.isfinite(line.bar), line.bar, 0.0)
        # bars that are narrower than a line would not be seen; the others are pale and behind everything
        if np.nanmax(bar) > least * np.nanmax(np.abs(line.y), initial=0.0):
            pale = {"ecolor": style["color"], "elinewidth": 3.0, "alpha": 0.3, "zorder": 1}
            ax.errorbar(line.x, line.y, yerr=bar, fmt="none", **pale)


def _draw_bars(ax: Axes, panel: Panel) -> None:
    """Draw a horizontal bar of each series in each row; bars of a row differ in colour and hatching."""
    height = 0.8 / max(1, len(panel.series))
    for nth, line in enumerate(panel.series):
        place = line.y + (nth - 0.5 * (len(panel.series) - 1)) * height
        ax.barh(place, line.x, height, label=line.label, edgecolor="black", linewidth=0.5, **BARS[nth % len(BARS)])
    ax.axvline(0.0, color="black", linewidth=0.8)


def _draw_lines(ax: Axes, panel: Panel, inches: float, sizes: tuple[float, float]) -> None:
    """Draw everything but the map, on axes of a width in inches, with sizes of the title and of notes in points."""
    if panel.bars:
        _draw_bars(ax, panel)
    for line in panel.series if not panel.bars else ():
        _draw_series(ax, line, panel, _LEAST_BAR if sizes == _ON_SHEET else 0.0)
    _label(ax, panel, inches, sizes)


def _label(ax: Axes, panel: Panel, inches: float, sizes: tuple[float, float]) -> None:
    """Write the title, the notes and the labels of a panel, and set its scales."""
    large, small = sizes
    width = int(_LETTERS * (inches - 0.3) * 11.0 / large)
    head = textwrap.fill(panel.title, width)
    notes = "\n".join(textwrap.fill(note, int(1.1 * width * large / small)) for note in panel.notes)
    lines = notes.count("\n") + 1 if notes else 0
    ax.set_title(head, loc="left", fontsize=large, fontweight="bold", pad=0.5 * large + 1.39 * small * lines)
    if notes:
        ax.annotate(
            notes, (0.0, 1.0), xytext=(0.0, 4.0), xycoords="axes fraction", textcoords="offset points", fontsize=small
        )
    ax.set_xlabel(textwrap.fill(panel.x_label, _LETTERS_OF_X + int(_LETTERS * inches)))
    ax.set_ylabel(textwrap.fill(panel.y_label, _LETTERS_OF_Y))
    set_scales(ax, panel, inches)
    if panel.map is None:
        ax.grid(alpha=0.25, which="both")


def drawn_part(panel: Panel) -> Panel:
    """Return a panel without the series that only its CSV has."""
    return replace(panel, series=tuple(line for line in panel.series if line.drawn))


def _height(panel: Panel, named: bool = False) -> float:
    """Return the height of a panel, inches, with the names of its lines beside it."""
    if panel.rows:
        return 0.7 + (0.24 + 0.06 * panel.bars) * len(panel.rows) + 0.15 * len(panel.notes)
    height = _HEIGHT["map" if panel.map is not None else "series"]
    height = max((1.5 if panel.tall else 1.0) * height, 0.95 + 0.15 * lines_of_names(panel) if named else 0.0)
    return height + 0.15 * len(panel.notes)
