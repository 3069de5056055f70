"""Sizes, texts and marks of drawn figures are those of the numbers that are written here."""

from __future__ import annotations

import io
import math
import textwrap
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from dem_bridge.report.drawing import draw_figure, draw_panel, fix_layout, new_axes
from dem_bridge.report.drawing_styles import scale_together, set_scales
from dem_bridge.report.study import FigureData, Map, Panel, Series
from dem_bridge.report.styles import colour_limits

#: width of a sheet, inches
SHEET = 7.3
X = np.arange(40.0)
MAP = Map(label="v (m/s)", x=np.arange(3.0), y=np.arange(2.0), values=np.array([[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]))
LONG = " ".join(["word"] * 60)


def _line(label: str = "line", style: str = "line/0/0", y: Any = (1.0, 2.0), **more: Any) -> Series:
    values = np.array(y, dtype=float)
    return Series(label=label, style=style, **{"x": np.arange(float(len(values))), "y": values} | more)


def _panel(*series: Series, **more: Any) -> Panel:
    return Panel(**{"title": "(a) t", "x_label": "body", "y_label": "force (N)", "series": series} | more)


def _figure(*panels: Panel, columns: int = 1, **more: Any) -> Figure:
    return draw_figure(FigureData(id="f", title="", caption="", panels=panels, columns=columns, **more))


def _alone(panel: Panel) -> Axes:
    """Return a panel as in a notebook, on axes of 6.4 inches, of which 77.5 % are between their ends."""
    return draw_panel(Figure(figsize=(6.4, 4.8)).add_subplot(), panel)


def _columns(legend: Any) -> int:
    return int(legend._ncols)


def _colour_bars(figure: Figure) -> list[Axes]:
    return [ax for ax in figure.axes if ax.get_label() == "<colorbar>"]


ROWS = ("group:", "one", "two")
ROWED = _panel(_line(style="mark-2", x=np.array([1e-3, 1e-2, 1e-1]), y=np.arange(3.0)), rows=ROWS)


@pytest.mark.parametrize(
    ("panels", "more", "width", "heights"),
    [
        # inches: 1.95 of lines, 2.25 of a map, 0.15 of a note, half as much again of a tall one
        ((_panel(_line()),), {}, 0.62 * SHEET, [1.95]),
        ((_panel(_line(), notes=("n", "m")),), {}, 0.62 * SHEET, [2.25]),
        ((_panel(_line(), tall=True, notes=("n",)),), {}, 0.62 * SHEET, [3.075]),
        ((_panel(map=MAP), _panel(_line()), _panel(_line())), {"columns": 2}, SHEET, [2.25, 1.95]),
        ((_panel(map=MAP, tall=True),), {}, 0.62 * SHEET, [3.375]),
        # a row has 0.24, and 0.3 with bars
        ((ROWED,), {}, SHEET, [0.7 + 3 * 0.24]),
        ((replace(ROWED, bars=True, notes=("n",)),), {}, SHEET, [0.7 + 3 * 0.3 + 0.15]),
        # panels of a narrow figure have 65 % of their height, those beside a last one 85 %
        ((_panel(_line()), _panel(_line())), {"columns": 2, "width": 0.7}, 0.7 * SHEET, [0.65 * 1.95]),
        ((_panel(_line()), _panel(_line()), _panel(_line())), {"last_beside": True}, SHEET, [0.85 * 1.95] * 2),
        # a single panel stands beside none, and is drawn as it is without
        ((_panel(_line()),), {"last_beside": True}, 0.62 * SHEET, [1.95]),
        ((_panel(map=MAP, notes=("n",)),), {"last_beside": True, "width": 0.7}, 0.7 * SHEET, [0.65 * 2.4]),
        # of more columns than panels there are as many as panels
        ((_panel(_line()),), {"columns": 3}, 0.62 * SHEET, [1.95]),
    ],
)  # fmt: skip
def test_a_figure_has_the_sizes_of_its_panels(
    panels: tuple[Panel, ...], more: dict[str, Any], width: float, heights: list[float]
) -> None:
    figure = _figure(*panels, **more)
    # 0.35 for a row of the legend
    assert tuple(figure.get_size_inches()) == pytest.approx((width, sum(heights) + 0.35), rel=1e-9)
    grid = figure.axes[0].get_subplotspec()
    assert grid is not None
    ratios = np.array(grid.get_gridspec().get_height_ratios())
    np.testing.assert_allclose(ratios / ratios.sum(), np.array(heights) / sum(heights), rtol=1e-9)
    places = [ax.get_subplotspec() for ax in figure.axes if ax.get_label() != "<colorbar>"]
    columns = min(more.get("columns", 1), len(panels))
    of_grid = len(panels) - (more.get("last_beside", False) and len(panels) > 1)
    assert len(places) == len(panels)
    for nth, place in enumerate(places[:of_grid]):
        assert place is not None
        assert (place.rowspan.start, place.colspan.start) == divmod(nth, columns)


@pytest.mark.parametrize(("letters", "names"), [(3, 8), (3, 9), (35, 2), (120, 2), (4, 1)])
def test_the_legend_has_as_many_names_in_a_row_as_there_is_room_for(letters: int, names: int) -> None:
    labels = ["n" * (letters - 2) + f"{k:02}" for k in range(names)]
    figure = _figure(*(_panel(*(_line(label) for label in labels)) for _ in range(2)), columns=2)
    [legend] = figure.legends
    # eleven and a half letters of 8.5 points are an inch wide, and a line and gaps have the width of seven letters
    room = max(1, min(names, math.floor(11.5 * SHEET) // (letters + 7)))
    assert [text.get_text() for text in legend.get_texts()] == labels  # each once
    assert _columns(legend) == room
    rows = math.ceil(names / room)
    assert figure.get_figheight() == pytest.approx(1.95 + 0.35 + 0.17 * (rows - 1), rel=1e-9)
    assert (legend.get_title().get_text(), legend.get_frame_on(), legend.handlelength) == ("", False, 3.4)
    assert _figure(_panel()).legends == []


def test_a_last_panel_beside_the_others_has_58_percent_of_the_width() -> None:
    figure = _figure(_panel(map=MAP), _panel(_line()), _panel(_line(), title=LONG), last_beside=True)
    left, right = figure.subfigs
    assert left.bbox.width / figure.bbox.width == pytest.approx(0.42, rel=1e-9)
    assert right.bbox.width / figure.bbox.width == pytest.approx(0.58, rel=1e-9)
    assert (len(left.axes), len(right.axes)) == (3, 1)  # the colour bar stands left, too
    wide = right.axes[0].get_title(loc="left").split("\n")
    assert wide == textwrap.wrap(LONG, int(8.4 * (0.58 * SHEET - 0.3) * 11.0 / 9.0))


@pytest.mark.parametrize(("columns", "inches"), [(1, 0.62 * SHEET), (2, SHEET / 2), (3, SHEET / 3)])
def test_titles_and_notes_are_broken_at_the_width_of_their_panel(columns: int, inches: float) -> None:
    notes = (LONG, "short")
    panel = _panel(_line(), title=LONG, notes=notes, y_label="residence time of all of the inner bodies (µs)")
    ax = _figure(*[panel] * columns, columns=columns).axes[0]
    width = int(8.4 * (inches - 0.3) * 11.0 / 9.0)
    title = ax._left_title  # type: ignore[attr-defined]
    assert title.get_text() == "\n".join(textwrap.wrap(LONG, width))
    assert (title.get_fontsize(), title.get_fontweight()) == (9.0, "bold")
    [note] = ax.texts
    expected = [line for text in notes for line in textwrap.wrap(text, int(1.1 * width * 9.0 / 8.0))]
    assert note.get_text().split("\n") == expected
    assert (note.get_fontsize(), note.xy, note.get_position()) == (8.0, (0.0, 1.0), (0.0, 4.0))  # type: ignore[attr-defined]
    # the title stands above the notes: half a letter, and 1.39 of the size of the notes for each of their lines
    up = ax.transAxes.inverted().transform(ax.titleOffsetTrans.transform((0.0, 0.0)))  # type: ignore[attr-defined]
    figure = ax.get_figure(root=True)
    assert figure is not None
    points = (up - ax.transAxes.inverted().transform((0.0, 0.0)))[1] * ax.bbox.height * 72.0 / figure.dpi
    assert points == pytest.approx(0.5 * 9.0 + 1.39 * 8.0 * len(expected), rel=1e-9)
    assert ax.get_ylabel() == "residence time of all of the\ninner bodies (µs)"  # at most 30 letters
    assert ax.get_xlabel() == "body"


def test_a_title_without_notes_stands_half_a_letter_above_its_panel() -> None:
    ax = _figure(_panel(_line())).axes[0]
    assert list(ax.texts) == []
    up = ax.titleOffsetTrans.transform((0.0, 0.0))[1] * 72.0 / ax.figure.dpi  # type: ignore[attr-defined]
    assert up == pytest.approx(0.5 * 9.0, rel=1e-9)


@pytest.mark.parametrize("kept", [_panel(_line(y=(0.2, 20.0)), map=MAP), ROWED], ids=["map", "rows"])
def test_a_panel_that_shares_with_lines_keeps_the_axis_of_its_map_or_rows(kept: Panel) -> None:
    lines = _panel(_line(y=(3.0, 9.0)))
    alone, of_lines = (_figure(panel).axes[0].get_ylim() for panel in (kept, lines))
    assert [ax.get_ylim() for ax in _figure(lines, replace(kept, shares_scale_with=(0,))).axes[:2]] == [of_lines, alone]
    assert [ax.get_ylim() for ax in _figure(replace(kept, shares_scale_with=(1,)), lines).axes[:2]] == [alone, of_lines]
    # the axis of a map ends at its samples, and that of rows at the last of them
    assert alone == ((-0.5, 1.5) if kept.map else (2.5, -0.5))
    assert of_lines == pytest.approx((0.0, 1.06 * 9.0))


def test_a_panel_of_a_notebook_has_larger_text_and_its_own_legend() -> None:
    ax = _alone(_panel(_line("first"), _line("second", y=(2.0, 3.0)), title=LONG, notes=("n",)))
    inches = 0.775 * 6.4
    title = ax._left_title  # type: ignore[attr-defined]
    assert title.get_text() == "\n".join(textwrap.wrap(LONG, int(8.4 * (inches - 0.3))))
    assert (title.get_fontsize(), ax.texts[0].get_fontsize()) == (11.0, 9.0)
    legend = ax.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["first", "second"]
    assert [text.get_fontsize() for text in legend.get_texts()] == [9.0] * 2
    assert (_columns(legend), legend.get_frame_on(), legend.handlelength) == (2, False, 3.0)
    assert legend._get_loc() == 2  # type: ignore[attr-defined] # upper left
    # 6 % above the largest value, and then a row of the legend
    assert ax.get_ylim() == pytest.approx((0.0, 3.18 * (1.0 + 0.085 + 0.02)), rel=1e-9)
    # a map keeps its own limits, and its legend is where no front is
    both = _alone(_panel(_line("front", y=(0.2, 9.0)), map=MAP))
    assert (both.get_xlim(), both.get_ylim()) == ((-0.5, 2.5), (-0.5, 1.5))
    legend = both.get_legend()
    assert legend is not None
    assert (legend._get_loc(), legend.get_frame_on()) == (4, True)  # type: ignore[attr-defined] # lower right
    assert _alone(_panel()).get_legend() is None


def test_the_room_above_the_lines_is_that_of_all_rows_of_the_legend() -> None:
    names = [f"a name of some forty letters, number {k:03}" for k in range(3)]
    many = Series(label=names[0], style="ode45", x=X, y=np.full(40, 2.0))
    ax = _alone(_panel(many, _line(names[1]), _line(names[2], bar=np.array([math.nan, 0.5]))))
    legend = ax.get_legend()
    assert legend is not None
    # one name in a row of 4.96 inches, and a row that says that not all points are marked
    assert _columns(legend) == 1
    assert legend.get_title().get_text() == "circles and crosses: not all points are marked"
    assert legend.get_title().get_fontsize() == 9.0
    top = 2.5 * 1.06
    assert ax.get_ylim() == pytest.approx((0.0, top * (1.0 + 0.085 * 4 + 0.02)), rel=1e-9)
    # a first point off the scale has room below the legend, too
    ax = _alone(_panel(_line(y=(30.0, 1.0, 1.0))))
    assert ax.get_ylim() == pytest.approx((0.0, 30.0 + 30.0 * 0.105), rel=1e-9)
    ax = _alone(_panel(_line(y=(-2.0, -1.0))))
    assert ax.get_ylim() == pytest.approx((-2.12, 0.12 + 2.24 * 0.105), rel=1e-9)


def test_a_map_has_its_values_its_limits_and_one_colour_bar() -> None:
    figure = _figure(_panel(map=MAP), replace(_panel(map=MAP), shares_scale_with=(0,)), columns=2)
    [bar] = _colour_bars(figure)
    assert bar.get_ylabel() == "v (m/s)"
    # the largest values of columns are 3, 4 and 5, twice each: the 95th percentile of six is between the last two
    assert bar.get_ylim() == pytest.approx((0.0, 5.0), abs=1e-12)
    for ax in figure.axes[:2]:
        mesh: Any = ax.collections[0]
        assert mesh.get_cmap().name == "cividis"
        assert mesh.get_rasterized()
        assert mesh.get_clim() == pytest.approx((0.0, 5.0), abs=1e-12)
        assert (ax.get_xlim(), ax.get_ylim()) == ((-0.5, 2.5), (-0.5, 1.5))
        assert not ax.xaxis.get_gridlines()[0].get_visible()
    drawn: Any = figure.axes[0].collections[0].colorbar
    assert (drawn.extend, drawn.solids.get_rasterized()) == ("neither", True)
    assert len(bar.get_yticks()) <= 8
    # maps of other quantities, and those of another row, have bars of their own
    other = _panel(map=replace(MAP, label="force (N)"))
    assert [bar.get_ylabel() for bar in _colour_bars(_figure(_panel(map=MAP), other, columns=2))] == [
        "v (m/s)", "force (N)",
    ]  # fmt: skip
    shared = replace(_panel(map=MAP), shares_scale_with=(0,))
    assert len(_colour_bars(_figure(_panel(map=MAP), shared, columns=1))) == 2
    assert len(_colour_bars(_figure(_panel(map=MAP), shared, _panel(_line()), columns=1, last_beside=True))) == 1
    [alone] = _colour_bars(_alone(_panel(map=MAP)).get_figure(root=True))  # type: ignore[arg-type]
    assert (alone.get_ylabel(), alone.get_ylim()) == ("v (m/s)", pytest.approx((0.1, 4.9), rel=1e-9))


def test_lines_on_a_map_are_light_with_a_dark_edge_and_marks_at_every_fifth_body() -> None:
    front, other = _line("front", "bca", y=np.full(20, 0.5)), _line("other", "reference", y=np.full(20, 0.5))
    one, two = _figure(_panel(front, other, map=MAP)).axes[0].get_lines()
    assert (one.get_linestyle(), one.get_marker(), one.get_markevery()) == ("None", "o", (4, 5))
    assert (two.get_linestyle(), two.get_marker(), two.get_markevery()) == ("-", "None", None)
    assert [line.get_color() for line in (one, two)] == ["#fefefe"] * 2
    assert [len(line.get_path_effects()) for line in (one, two)] == [1, 1]
    # marks of a front on a map are no sample of its points
    assert _figure(_panel(front, map=MAP)).legends[0].get_title().get_text() == ""


def test_rows_of_several_panels_have_one_axis_that_has_all_values() -> None:
    low, high = (
        replace(ROWED, series=(_line(style="mark-2", x=np.array(x), y=np.arange(3.0)),))
        for x in ((1e-3, 1e-2, 1e-1), (1e-2, 1e-1, 5.0))
    )
    apart = [_figure(each).axes[0].get_xlim() for each in (low, high)]
    both = [ax.get_xlim() for ax in _figure(low, high).axes]
    assert apart[0] != apart[1]
    assert both == [(min(apart)[0], max(apart)[1])] * 2
    # bars have an axis of their own
    barred = _figure(low, replace(high, bars=True)).axes
    assert barred[0].get_xlim() == apart[0]
    assert [line.get_xdata()[0] for line in barred[1].get_lines()] == [0.0]  # type: ignore[index]


def test_bars_of_three_series_stand_one_below_the_other() -> None:
    series = tuple(_line(f"{k}", x=np.array([1.0 + k, 5.0]), y=np.array([0.0, 1.0])) for k in range(3))
    figure = _figure(_panel(*series, rows=("a", "b"), bars=True))
    bars: list[Any] = list(figure.axes[0].patches)
    height = 0.8 / 3.0
    expected = [(row + (k - 1.5) * height, height) for k in range(3) for row in (0.0, 1.0)]
    np.testing.assert_allclose([(bar.get_y(), bar.get_height()) for bar in bars], expected, rtol=1e-9)
    assert [bar.get_width() for bar in bars] == [1.0, 5.0, 2.0, 5.0, 3.0, 5.0]
    # two looks by turns, the second hatched
    assert [bar.get_hatch() for bar in bars] == [None, None, "////", "////", None, None]
    assert {to_hex(bar.get_edgecolor()) for bar in bars} == {"#000000"}
    assert {bar.get_linewidth() for bar in bars} == {0.5}
    # a series alone has the whole height, around the middle of its row
    [alone] = _figure(_panel(_line("0", x=np.array([1.0]), y=np.array([0.0])), rows=("a",), bars=True)).axes[0].patches
    assert (alone.get_y(), alone.get_height()) == pytest.approx((-0.4, 0.8))  # type: ignore[attr-defined]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["0", "1", "2"]
    assert figure.legends[0].get_title().get_text() == ""


def test_small_multiples_fill_rows_of_a_sheet_with_titles_of_their_width() -> None:
    line, field = _panel(_line("a", "bca"), title=LONG), _panel(map=MAP)
    figure = _figure(line, field, line, line, columns=3, small=True)
    assert tuple(figure.get_size_inches()) == pytest.approx((SHEET, 2.1), rel=1e-9)
    places = [ax.get_subplotspec() for ax in figure.axes]
    assert [(place.rowspan.start, place.colspan.start) for place in places if place] == [(0, 0), (0, 1), (0, 2), (1, 0)]
    title = figure.axes[0]._left_title  # type: ignore[attr-defined]
    letters = int(8.4 * 11.0 / 8.5 * (SHEET / 3.0 - 0.08))
    assert (title.get_text(), title.get_fontsize()) == ("\n".join(textwrap.wrap(LONG, letters)), 8.0)
    assert figure.axes[1].collections[0].get_clim() == pytest.approx((0.1, 4.9), rel=1e-9)
    [drawn] = figure.axes[0].get_lines()
    assert (drawn.get_linestyle(), drawn.get_marker()) == ("--", "s")
    assert len(_figure(*[line] * 3, columns=3, small=True).axes) == 3
    assert _figure(*[line] * 3, columns=3, small=True).get_figheight() == pytest.approx(1.05)


@pytest.mark.parametrize(
    ("style", "count", "every"),
    [
        ("lammps-granular", 48, (0, 2)),  # circles begin at the first point
        ("lammps-granular", 73, (0, 4)),
        ("ode45", 73, (2, 4)),  # crosses stand between them
        ("ode45", 24, (0, 1)),
        ("bca", 90, (3, 10)),  # squares at a third, other marks at two thirds
        ("adiabatic", 90, (6, 10)),
        ("adiabatic", 1, (0, 1)),
        ("adiabatic", 2, (0, 1)),
        ("curve/verlet", 90, None),
        ("below", 90, None),
        ("reference", 90, None),
        ("curve/reference", 90, None),
    ],
)
def test_marks_stand_at_their_own_points(style: str, count: int, every: tuple[int, int] | None) -> None:
    [drawn] = _figure(_panel(_line(style=style, y=np.ones(count)))).axes[0].get_lines()
    assert drawn.get_markevery() == every


def test_marks_that_are_left_out_are_those_of_points_without_a_line() -> None:
    def note(style: str, count: int) -> str:
        return _figure(_panel(_line(style=style, y=np.ones(count)))).legends[0].get_title().get_text()

    assert [note("ode45", count) for count in (24, 25)] == ["", "circles and crosses: not all points are marked"]
    assert note("bca", 90) == note("below", 90) == ""
    # of one panel among several
    figure = _figure(_panel(_line(style="ode45", y=np.ones(25))), _panel(_line()))
    assert figure.legends[0].get_title().get_text() != ""


def test_uncertainties_are_drawn_where_they_are_known_and_wider_than_a_line() -> None:
    y, bar = np.array([-4.0, 2.0, 1.0]), np.array([math.inf, 0.1, math.nan])
    [ax] = _figure(_panel(_line(y=y, bar=bar))).axes
    [bars] = ax.collections
    segments = np.array([np.ptp(segment[:, 1]) for segment in bars.get_segments()])  # type: ignore[attr-defined]
    np.testing.assert_allclose(segments, [0.0, 0.2, 0.0], atol=1e-12)
    assert bars.get_alpha() == 0.3
    assert bars.get_zorder() < ax.get_lines()[0].get_zorder()

    def drawn(bar: Any, panel: Any) -> int:
        return len(panel(_panel(_line(y=y, bar=np.array(bar)))).collections)

    def of_sheet(panel: Panel) -> Axes:
        return _figure(panel).axes[0]

    # a five hundredth of the largest value, whatever its sign
    assert [drawn([size] * 3, of_sheet) for size in (0.0079, 0.0081)] == [0, 1]
    assert [drawn([size] * 3, _alone) for size in (0.0, 1e-9)] == [0, 1]
    assert drawn([math.inf] * 3, of_sheet) == drawn([math.nan] * 3, _alone) == 0


def test_a_band_is_the_area_between_its_edges() -> None:
    y, bar = np.array([1.0, 2.0, 4.0]), np.array([0.25, 0.5, 1.0])
    [ax] = _figure(_panel(_line("band", "band", y=y, bar=bar))).axes
    [area] = ax.collections
    corners = {(x, z) for x, z in area.get_paths()[0].vertices.tolist()}  # type: ignore[union-attr]
    assert corners == {(k, y[k] + side * bar[k]) for k in range(3) for side in (-1.0, 1.0)}
    assert ax.get_lines()[:] == []
    figure = ax.get_figure(root=True)
    assert isinstance(figure, Figure)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["band"]
    assert len(_figure(_panel(_line("band", "band", y=y))).axes[0].get_lines()) == 1


def test_a_layout_is_computed_once_and_kept() -> None:
    figure = _figure(_panel(_line()))
    before = figure.axes[0].get_position().bounds
    assert fix_layout(figure) is figure
    assert figure.get_layout_engine() is None
    after = figure.axes[0].get_position().bounds
    assert after != before
    figure.draw_without_rendering()
    assert figure.axes[0].get_position().bounds == after
    plain = Figure()
    assert fix_layout(plain) is plain


def test_a_figure_whose_layout_is_fixed_is_drawn_once_when_it_is_saved(monkeypatch: pytest.MonkeyPatch) -> None:
    figure, draw, drawn = fix_layout(_figure(_panel(_line()))), Axes.draw, list[Axes]()

    def draw_noted(self: Axes, *given: Any, **named: Any) -> None:
        drawn.append(self)
        draw(self, *given, **named)

    monkeypatch.setattr(Axes, "draw", draw_noted)
    figure.savefig(io.StringIO(), format="svg")
    assert drawn == [figure.axes[0]]


def test_new_axes_have_the_size_of_a_notebook() -> None:
    figure = new_axes().get_figure(root=True)
    assert figure is not None
    assert tuple(figure.get_size_inches()) == pytest.approx((6.6, 3.7))


# scales


@pytest.mark.parametrize(
    ("values", "diverging", "low", "high", "extend"),
    [
        ([[0.0, 1.0]], False, 0.05, 0.95, "both"),
        # an excess of less than one of 256 colours is not seen
        ([[0.0] * 21, [*[1.0] * 20, 1.003]], False, 0.0, 1.0, "neither"),
        ([[0.0] * 21, [*[1.0] * 20, 1.005]], False, 0.0, 1.0, "max"),
        ([[1.0] * 21, [*[0.0] * 20, -0.003]], False, 0.0, 1.0, "neither"),
        ([[1.0] * 21, [*[0.0] * 20, -0.005]], False, 0.0, 1.0, "min"),
        ([[1.0, 1.0], [-3.0, -3.0]], True, -3.0, 3.0, "neither"),
        # the columns have 2, and 1 to 3
        ([[math.inf, 1.0], [2.0, 3.0]], False, 1.05, 2.95, "both"),
    ],
)
def test_a_colour_scale_is_that_of_percentiles_by_hand(
    values: list[list[float]], diverging: bool, low: float, high: float, extend: str
) -> None:
    array = np.array(values)
    data = Map(label="", x=np.arange(float(array.shape[1])), y=np.arange(float(len(array))), values=array)
    assert colour_limits([replace(data, diverging=diverging)]) == (pytest.approx(low), pytest.approx(high), extend)
    # one map of both signs is enough for several
    both = [replace(data, diverging=True), data]
    assert colour_limits(both)[0] == -colour_limits(both[::-1])[1]


def test_the_note_of_a_point_off_scale_points_at_it() -> None:
    ax = Figure().add_subplot()
    scale_together([ax], [_panel(_line(y=(12345.6, 1.0, 2.0)), x_label="contact (from the left)", y_label="force")])
    [note] = ax.texts
    assert note.get_text() == "contact 0: 1.235e+04 , off scale"
    assert note.get_position() == (0.12, 0.925)
    assert note.arrow_patch is not None  # type: ignore[attr-defined]
    assert (note.get_verticalalignment(), note.get_in_layout()) == ("center", False)
    # of a line without a point, and of one that ends in a nan, there is none
    ax = Figure().add_subplot()
    scale_together([ax], [_panel(_line(y=()), _line(y=(math.nan, 1.0)), _line(y=(9.0, 1.0)))])
    assert [text.get_text() for text in ax.texts] == ["body 0: 9 N, off scale"]


@pytest.mark.parametrize(
    ("first", "rest", "low", "high"),
    [
        (4.0, 2.0, 0.0, 4.24),  # twice the others is near
        (4.01, 2.0, 0.0, 2.42),
        (-4.0, -2.0, -4.24, 0.24),
        (-4.01, -2.0, -2.12, 0.12),  # below, without a note
        (2.119, 2.0, 0.0, 1.06 * 2.119),
    ],
)
def test_a_first_point_is_near_up_to_twice_the_others(first: float, rest: float, low: float, high: float) -> None:
    ax = Figure().add_subplot()
    scale_together([ax], [_panel(_line(y=(first, rest)))])
    assert ax.get_ylim() == pytest.approx((low, high), rel=1e-9)
    assert len(ax.texts) == (first == 4.01)


def test_a_logarithmic_axis_of_one_panel_is_that_of_all() -> None:
    axes = [Figure().add_subplot() for _ in range(2)]
    scale_together(axes, [_panel(_line(y=(1.0, 1e2)), log_y=True), _panel(_line(y=(1e-2, 0.0)), log_y=True)])
    assert [ax.get_ylim() for ax in axes] == [pytest.approx((1e-2 / 1e4**0.1, 1e2 * 1e4**0.1))] * 2
    [bare] = [Figure().add_subplot()]
    scale_together([bare], [_panel(_line(y=(math.nan, math.nan)), log_y=True)])
    assert bare.get_ylim() == (0.0, 1.0)


def _ticked(panel: Panel, inches: float = 3.0) -> Axes:
    ax = Figure(figsize=(inches, 2.0)).add_subplot()
    for line in panel.series:
        ax.plot(line.x, line.y)
    set_scales(ax, panel, inches)
    return ax


@pytest.mark.parametrize(
    ("ends", "subs"),
    [
        ((1.0, 5.0), [1.0, 1.5, 2.0, 3.0, 5.0, 7.0]),  # up to 0.7 decades
        ((1.0, 5.02), [1.0, 2.0, 5.0]),
        ((1.0, 99.0), [1.0, 2.0, 5.0]),
        ((1.0, 100.0), [1.0]),
    ],
)
def test_decades_decide_the_ticks_of_both_logarithmic_axes(ends: tuple[float, float], subs: list[float]) -> None:
    ends = (ends[0], 10.0**0.6999) if ends[1] == 5.0 else ends
    for x, y in ((ends, (1.0, 1e5)), ((1.0, 1e5), ends)):
        ax = _ticked(_panel(_line(x=np.array(x), y=np.array(y)), log=True))
        short, long = (ax.xaxis, ax.yaxis) if x is ends else (ax.yaxis, ax.xaxis)
        assert list(short.get_major_locator()._subs) == subs  # type: ignore[attr-defined]
        assert list(long.get_major_locator()._subs) == [1.0]  # type: ignore[attr-defined]
        # whole powers of ten from three decades on
        assert short.get_major_formatter()(300.0, 0) == "300"
        assert long.get_major_formatter()(300.0, 0) == "3×10²"
        assert short.get_minor_formatter()(3.0, 0) == ""
    exact = _ticked(_panel(_line(x=np.array([1.0, 1e3]), y=np.array([1.0, 999.0])), log=True))
    texts = [axis.get_major_formatter()(100.0, 0) for axis in (exact.xaxis, exact.yaxis)]
    assert texts == ["10²", "100"]


def test_an_axis_of_a_logarithmic_y_has_at_most_six_ticks_and_plain_x() -> None:
    ax = _ticked(_panel(_line(y=(1e-12, 1.0)), log_y=True))
    locator = ax.yaxis.get_major_locator()
    assert isinstance(locator, LogLocator)
    assert locator.numticks == 6
    assert ax.yaxis.get_minor_formatter()(3.0, 0) == ""
    assert ax.get_xscale() == "linear"
    assert _ticked(_panel(_line(y=(-1.0, 0.0)), log_y=True)).get_yscale() == "linear"
    # of one positive value, too
    assert _ticked(_panel(_line(y=(0.0, 2.0)), log_y=True)).get_yscale() == "log"
    # both are logarithmic, or none
    half = _ticked(_panel(_line(x=np.array([-1.0, 0.0]), y=np.array([1.0, 2.0])), log=True))
    assert (half.get_xscale(), half.get_yscale()) == ("linear", "linear")


def _steps(ax: Axes) -> list[float]:
    return [float(step) for step in ax.xaxis.get_major_locator()._steps]  # type: ignore[attr-defined]


def test_ticks_of_whole_numbers_are_one_two_or_five_apart() -> None:
    whole, parts = _ticked(_panel(_line())), _ticked(_panel(_line(x=np.array([0.0, 0.5]))))
    assert (_steps(whole), _steps(parts)) == ([1.0, 2.0, 5.0, 10.0], [1.0, 2.0, 2.5, 5.0, 10.0])
    assert [whole.xaxis.get_major_locator()._nbins, parts.xaxis.get_major_locator()._nbins] == [8, 6]  # type: ignore[attr-defined]
    narrow = [_ticked(_panel(_line(x=np.array([0.0, 0.5]))), inches) for inches in (2.6, 2.61)]
    assert [ax.xaxis.get_major_locator()._nbins for ax in narrow] == [3, 6]  # type: ignore[attr-defined]
    assert whole.xaxis.get_major_locator()._integer  # type: ignore[attr-defined]
    # those of a map count, too, and a mixture is not whole
    parts_of_map = _panel(_line(), map=replace(MAP, x=np.array([0.0, 0.5, 1.0])))
    for panel in (parts_of_map, _panel()):
        assert not _ticked(panel).xaxis.get_major_locator()._integer  # type: ignore[attr-defined]
    # two series at one place, and two places
    assert _ticked(_panel(_line(x=np.array([7.0]), y=[1.0]), _line(x=np.array([7.0]), y=[2.0]))).get_xlim() == (
        6.0,
        8.0,
    )
    assert _ticked(_panel(_line(x=np.array([0.5]), y=[1.0]))).get_xlim() != (-0.5, 1.5)


def test_names_of_rows_are_short_and_headings_bold() -> None:
    long = " ".join(["name"] * 12)
    series = _line(style="mark-2", x=np.array([1.0, 2.0, 3.0]), y=np.arange(3.0))
    ax = _ticked(_panel(series, rows=(long, "a:", "b: c")))
    names = ax.get_yticklabels()
    assert [text.get_text() for text in names] == ["name name name name name name name name ...", "a:", "b: c"]
    assert [text.get_fontweight() for text in names] == ["normal", "bold", "normal"]
    assert ax.get_yticks().tolist() == [0.0, 1.0, 2.0]
    assert ax.get_ylim() == (2.5, -0.5)


@pytest.mark.parametrize(
    ("values", "low", "high", "ticks", "text"),
    [
        ((1e-12, 1e-7), 1e-14, 2.0, 5, "10⁻⁵"),  # five decades
        ((1e-12, 9e-9), None, None, None, "10⁻⁵"),  # fewer than four
        ((2e-9, 1.0), None, None, 5, "10⁻⁵"),  # none is an error below 1e-9
        ((1e-15, 2.0), 3e-16, 6.0, 5, "10⁻⁵"),
        ((0.9e-9, 1.0), 1e-14, 3.0, 5, "10⁻⁵"),
    ],
)
def test_an_axis_of_errors_is_that_of_decades(
    values: tuple[float, float], low: float | None, high: float | None, ticks: int | None, text: str
) -> None:
    series = _line(style="mark-2", x=np.array([*values, 0.0]), y=np.arange(3.0))
    ax = _ticked(_panel(series, rows=("a", "b", "c")))
    if low is not None and high is not None:
        assert ax.get_xlim() == pytest.approx((low, high), rel=1e-9, abs=0.0)
    else:
        assert ax.get_xlim()[0] > 0.01 * values[0]
    assert ax.xaxis.get_major_formatter()(1e-5, 0) == text
    locator = ax.xaxis.get_major_locator()
    assert isinstance(locator, LogLocator)
    assert locator.numticks == (5 if ticks else LogLocator(numticks=None).numticks)
