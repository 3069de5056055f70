"""Axes, ticks, colour scales and sizes of figures are those of hand-computed numbers."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dem_bridge.report.drawing import NOTEBOOK_WIDTH, WIDTH, draw_figure, draw_panel, new_axes
from dem_bridge.report.drawing_styles import (
    groups_of_scale,
    power_of_ten,
    scale_together,
    set_scales,
)
from dem_bridge.report.page import csv_texts
from dem_bridge.report.study import FigureData, Map, Panel, Series
from dem_bridge.report.styles import STYLES, colour_limits

NAN = float("nan")


def _panel(*curves: Any, **settings: Any) -> Panel:
    """Return a panel with lines of the given values at 0, 1, 2, ..."""
    lines = tuple(
        Series(label=f"line {k}", style=f"line/{k}/0", x=np.arange(float(len(y))), y=np.array(y, dtype=float))
        for k, y in enumerate(curves)
    )
    return Panel(**{"title": "a", "x_label": "body", "y_label": "force (N)", "series": lines} | settings)


def _limits(*panels: Panel) -> list[tuple[float, float]]:
    axes = [Figure().add_subplot() for _ in panels]
    scale_together(axes, panels)
    return [ax.get_ylim() for ax in axes]


# axes of lines: from 0 to 6 % above the largest value


@pytest.mark.parametrize(
    ("values", "low", "high"),
    [
        ([1.0, 2.0, 3.0], 0.0, 3.18),
        ([3.0, 2.0, 1.0], 0.0, 3.18),  # a first point up to twice the others is on the scale
        ([4.0, 2.0, 1.0], 0.0, 4.24),
        ([-1.0, 1.0], -1.12, 1.12),
        ([-1.0, -2.0], -2.12, 0.12),
        ([5.0], 0.0, 5.3),
        ([NAN, 2.0, NAN, 1.0], 0.0, 2.12),
        ([0.0, 0.0], -1.12, 1.12),
        ([10.0, 1.0, 2.0], 0.0, 2.42),  # with room for the note on the first
    ],
)
def test_a_linear_axis_begins_at_zero_and_shows_all_but_a_first_point_far_off(
    values: list[float], low: float, high: float
) -> None:
    assert _limits(_panel(values)) == [pytest.approx((low, high), rel=1e-12)]


def test_axes_that_share_show_the_largest_of_all_and_name_what_is_off_scale() -> None:
    panels = (_panel([1.0, 2.0]), _panel([9.0, 4.0], [1.0, 3.0]), _panel([NAN]))
    axes = [Figure().add_subplot() for _ in panels]
    scale_together(axes, panels)
    # 9 is more than twice 4
    assert [ax.get_ylim() for ax in axes] == [pytest.approx((0.0, 4.0 + 0.24 * 3.5))] * 3
    assert [[text.get_text() for text in ax.texts] for ax in axes] == [[], ["body 0: 9 N, off scale"], []]
    assert _limits(_panel([NAN]), _panel([])) == [(0.0, 1.0)] * 2
    # a panel without a first value has none off scale, however small those of the others are
    small = [Figure().add_subplot() for _ in range(2)]
    scale_together(small, [_panel([0.25, 0.5]), _panel([NAN], [])])
    assert [ax.get_ylim() for ax in small] == [pytest.approx((0.0, 0.53))] * 2
    assert [len(ax.texts) for ax in small] == [0, 0]
    # the largest of several first values is named, wherever it stands in its panel
    ax = Figure().add_subplot()
    scale_together([ax], [_panel([1.0, 3.0], [9.0, 4.0], [7.0, 1.0])])
    assert [text.get_text() for text in ax.texts] == ["body 0: 9 N, off scale"]


def test_a_point_off_scale_is_named_by_its_own_place() -> None:
    first, second = _panel([1.0, 1.0], [9.0, 4.0]).series
    ax = Figure().add_subplot()
    scale_together([ax], [_panel(series=(first, replace(second, x=second.x + 3.0)), x_label="contact, from the left")])
    [note] = ax.texts
    assert note.get_text() == "contact 3: 9 N, off scale"
    assert note.xy == (3.0, 0.985 * ax.get_ylim()[1])  # type: ignore[attr-defined]


def test_lines_and_maps_of_one_figure_have_files_of_their_own() -> None:
    lines, both = _panel([1.0, 2.0], title="(a) lines"), _panel(title="(b) map", map=_map([[0.5, 0.25]]))
    texts = csv_texts(FigureData(id="f", title="", caption="", panels=(lines, both), columns=2))
    assert sorted(texts) == ["f-b.csv", "f.csv"]
    assert texts["f-b.csv"].splitlines()[1] == "0.0,0.5,0.25"
    assert "0.5" not in texts["f.csv"]
    assert sorted(csv_texts(FigureData(id="f", title="", caption="", panels=(both,), columns=1))) == ["f-b.csv"]


def test_uncertainties_are_within_a_linear_axis() -> None:
    [line] = _panel([1.0, 2.0]).series
    panel = replace(_panel(), series=(replace(line, bar=np.array([0.5, 0.5])),))
    assert _limits(panel) == [pytest.approx((0.0, 2.65))]
    wide = replace(panel, series=(replace(line, bar=np.array([0.5, 3.0])),))
    assert _limits(wide) == [pytest.approx((-1.36, 5.36))]
    # and not within a logarithmic one, but for bands
    assert _limits(replace(wide, log_y=True)) == [pytest.approx((1.0 / 2.0**0.1, 2.0 * 2.0**0.1))]
    band = replace(panel, log=True, series=(replace(panel.series[0], style="band"),))
    assert _limits(band) == [pytest.approx((0.5 / 5.0**0.1, 2.5 * 5.0**0.1))]


@pytest.mark.parametrize("setting", ["log", "log_y"])
def test_a_logarithmic_axis_has_room_of_a_tenth_of_its_decades(setting: str) -> None:
    panel = _panel([1e-3, 0.0, 1e-1], **{setting: True})
    assert _limits(panel) == [pytest.approx((1e-3 / 100.0**0.1, 1e-1 * 100.0**0.1))]
    assert _limits(_panel([5.0, 5.0], **{setting: True})) == [pytest.approx((5.0 / 1.02, 5.0 * 1.02))]
    assert _limits(_panel([0.0, -1.0], **{setting: True})) == [(0.0, 1.0)]
    # a line without positive values leaves the axis to the others
    for curves in (([2.0, 8.0], [-1.0, 0.0]), ([-1.0, 0.0], [2.0, 8.0])):
        assert _limits(_panel(*curves, **{setting: True})) == [pytest.approx((2.0 / 4.0**0.1, 8.0 * 4.0**0.1))]


# ticks


def _axes(panel: Panel, inches: float = 3.0) -> Axes:
    ax = Figure(figsize=(inches, 2.0)).add_subplot()
    for line in panel.series:
        ax.plot(line.x, line.y)
    set_scales(ax, panel, inches)
    return ax


def _ticks(ax: Axes) -> tuple[list[float], list[str]]:
    """Return the ticks within the x axis, and their texts."""
    low, high = ax.get_xlim()
    ticks = [tick for tick in ax.get_xticks() if low <= tick <= high]
    return ticks, [str(ax.xaxis.get_major_formatter()(tick, 0)) for tick in ticks]


@pytest.mark.parametrize(
    ("ends", "ticks", "texts"),
    [
        ((1.0, 4.0), [1.0, 1.5, 2.0, 3.0], ["1", "1.5", "2", "3"]),
        ((1.0, 60.0), [1.0, 2.0, 5.0, 10.0, 20.0, 50.0], ["1", "2", "5", "10", "20", "50"]),
        ((1e-3, 0.5), [1e-3, 1e-2, 1e-1], ["0.001", "0.01", "0.1"]),
        ((1e-6, 1e-2), [1e-6, 1e-5, 1e-4, 1e-3, 1e-2], ["10⁻⁶", "10⁻⁵", "10⁻⁴", "10⁻³", "10⁻²"]),
    ],
)
def test_a_logarithmic_axis_has_more_ticks_where_it_has_fewer_decades(
    ends: tuple[float, float], ticks: list[float], texts: list[str]
) -> None:
    [line] = _panel([1.0, 10.0]).series
    ax = _axes(_panel(log=True, series=(replace(line, x=np.array(ends)),)))
    ax.set_xlim(ends[0], ends[1] * (1.0 + 1e-9))
    found, words = _ticks(ax)
    assert set(ticks) <= {float(f"{tick:.6g}") for tick in found}
    assert len(found) <= len(ticks) + 2
    assert set(texts) <= set(words)
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "log")


def test_values_that_no_logarithmic_axis_can_show_do_not_count_for_its_ticks() -> None:
    [line] = _panel([1.0, 2.0, NAN, 0.0, 1.0]).series
    panel = _panel(log=True, series=(replace(line, x=np.array([1.0, 3.0, 2.0, -1.0, np.inf])),))
    ax = Figure().add_subplot()
    set_scales(ax, panel, 3.0)
    ax.set_xlim(1.0, 3.01)
    assert {1.0, 1.5, 2.0, 3.0} <= {float(f"{tick:.6g}") for tick in ax.get_xticks()}
    # without any value above zero an axis stays linear
    nothing = _axes(_panel([-1.0, 0.0], log=True))
    assert (nothing.get_xscale(), nothing.get_yscale()) == ("linear", "linear")


def test_a_linear_axis_of_whole_numbers_has_whole_ticks() -> None:
    whole, parts = _panel([1.0] * 41), _panel([1.0, 2.0])
    ticks, _ = _ticks(_axes(whole))
    assert ticks == [round(tick) for tick in ticks]
    assert 4 <= len(ticks) <= 9
    half = replace(parts, series=tuple(replace(line, x=0.25 * line.x) for line in parts.series))
    assert any(tick != round(tick) for tick in _ticks(_axes(half))[0])
    # a narrow panel has three intervals, a wide one six
    narrow, wide = (len(_ticks(_axes(half, inches))[0]) for inches in (2.0, 3.0))
    assert narrow <= 4 < wide <= 7
    # a single place has one body on each side
    assert _axes(_panel([3.0])).get_xlim() == (-1.0, 1.0)
    logarithmic = _axes(_panel([1e-6, 1.0], log_y=True))
    assert (logarithmic.get_xscale(), logarithmic.get_yscale()) == ("linear", "log")
    assert logarithmic.yaxis.get_major_formatter()(1e-6, 0) == "10⁻⁶"


def test_rows_are_named_from_the_top_on_and_errors_begin_below_round_off() -> None:
    def rows(*values: float, **settings: Any) -> Axes:
        x = np.array(values)
        series = (Series(label="errors", style="mark-2", x=x, y=np.arange(float(len(x)))),)
        names = ("group:", *(f"row {k}" for k in range(1, len(x))))
        return _axes(_panel(series=series, rows=names, **settings))

    ax = rows(1e-12, 1e-3, 1.0)
    assert ax.get_ylim() == (2.5, -0.5)
    assert [text.get_text() for text in ax.get_yticklabels()] == ["group:", "row 1", "row 2"]
    assert [text.get_fontweight() for text in ax.get_yticklabels()] == ["bold", "normal", "normal"]
    assert (ax.get_xscale(), ax.get_xlim()) == ("log", pytest.approx((1e-14, 3.0), abs=0.0))
    assert ax.xaxis.get_major_formatter()(1e-9, 0) == "10⁻⁹"
    assert rows(1e-15, 1e-3).get_xlim() == pytest.approx((3e-16, 2.0), abs=0.0)
    # a scale of four decades or fewer, or of larger values, is that of its values
    few = rows(1e-3, 1e-1)
    assert few.get_xlim()[0] > 1e-4
    assert few.xaxis.get_major_formatter()(1e-5, 0) == "10⁻⁵"
    assert rows(1e-8, 1.0).get_xlim()[0] > 1e-9
    assert rows(1.0, 2.0, bars=True).get_xscale() == "linear"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1e-3, "10⁻³"),
        (1.1e-3, "1.1×10⁻³"),
        (1e5, "10⁵"),
        (99990.0, "9.999×10⁴"),
        (1e-10, "10⁻¹⁰"),
        (1e12, "10¹²"),
        (1.0, "1"),
    ],
)
def test_powers_of_ten_are_short(value: float, text: str) -> None:
    assert power_of_ten(value) == text


# colours


def _map(values: Any, **settings: Any) -> Map:
    array = np.array(values, dtype=float)
    return Map(
        label="v (m/s)",
        x=np.arange(float(array.shape[1])),
        y=np.arange(float(array.shape[0])),
        values=array,
        **settings,
    )


def test_a_colour_scale_is_that_of_nineteen_of_twenty_columns() -> None:
    # columns whose largest values are 1, 2, ... 21, and whose smallest are their negatives
    high = np.arange(1.0, 22.0)
    both = _map([high, -high])
    # the 95th percentile of 21 numbers is the 20th of them
    assert colour_limits([both]) == (-20.0, 20.0, "both")
    assert colour_limits([_map([high, 0.0 * high])]) == (0.0, 20.0, "max")
    assert colour_limits([_map([-high, 0.0 * high])]) == (-20.0, 0.0, "min")
    assert colour_limits([_map([high, -0.5 * high], diverging=True)]) == (-20.0, 20.0, "max")
    assert colour_limits([_map([0.5 * high, -high], diverging=True)]) == (-20.0, 20.0, "min")
    # a column without numbers counts for nothing, and one of two maps for both
    assert colour_limits([_map([[1.0, NAN], [3.0, NAN]])]) == (1.0, 3.0, "neither")
    assert colour_limits([_map([[1.0], [2.0]]), _map([[0.0], [1.0]])])[:2] == pytest.approx((0.05, 1.95))


def test_a_colour_scale_without_an_extent_has_one() -> None:
    assert colour_limits([]) == (0.0, 1.0, "neither")
    assert colour_limits([_map([[NAN]])]) == (0.0, 1.0, "neither")
    assert colour_limits([_map([[2.0, 2.0]])]) == (2.0, 3.0, "neither")
    # the percentiles of a single value among equal ones are equal: its own extremes count
    spike = np.zeros((2, 100))
    spike[0, 50] = 7.0
    assert colour_limits([_map(spike)]) == (0.0, 7.0, "neither")
    assert colour_limits([_map(-spike)]) == (-7.0, 0.0, "neither")


def test_panels_that_share_with_one_another_are_a_group() -> None:
    chain = [
        _panel(),
        _panel(shares_scale_with=(0,)),
        _panel(),
        _panel(shares_scale_with=(1,)),
        _panel(shares_scale_with=(2,)),
    ]
    assert groups_of_scale(chain) == [[0, 1, 3], [2, 4]]
    assert groups_of_scale([_panel(), _panel()]) == [[0], [1]]
    with pytest.raises(ValueError, match="panel 0 shares its scale with 2; the figure has 2 panels"):
        groups_of_scale([_panel(shares_scale_with=(2,)), _panel()])


# sizes


def _figure(count: int, columns: int, **settings: Any) -> Figure:
    panels = tuple(_panel([1.0, 2.0], title=f"({k})") for k in range(count))
    return draw_figure(FigureData(id="f", title="", caption="", panels=panels, columns=columns, **settings))


def test_a_figure_has_the_width_of_a_sheet_and_a_row_for_each_full_set_of_columns() -> None:
    two, four, one = _figure(2, 2), _figure(4, 2), _figure(1, 1)
    assert two.get_figwidth() == pytest.approx(WIDTH)
    assert one.get_figwidth() == pytest.approx(0.62 * WIDTH)
    row = four.get_figheight() - two.get_figheight()
    # a panel of lines, and the legend above
    assert (row, two.get_figheight() - row) == (pytest.approx(1.95), pytest.approx(0.35))
    assert _figure(3, 2).get_figheight() == pytest.approx(four.get_figheight())
    assert len(_figure(5, 3).axes) == 5
    tall = draw_figure(
        FigureData(id="f", title="", caption="", columns=1, panels=(_panel([1.0], tall=True, notes=("n",)),))
    )
    assert tall.get_figheight() - one.get_figheight() == pytest.approx(0.5 * 1.95 + 0.15)
    assert _figure(2, 2, width=0.5).get_figwidth() == pytest.approx(0.5 * WIDTH)
    notebook = new_axes().get_figure(root=True)
    assert notebook is not None
    assert notebook.get_figwidth() == pytest.approx(NOTEBOOK_WIDTH)


def test_a_last_panel_beside_the_others_is_as_high_as_all() -> None:
    figure = _figure(3, 1, last_beside=True)
    figure.draw_without_rendering()
    boxes = [ax.get_window_extent() for ax in figure.subfigs[0].axes] + [figure.subfigs[1].axes[0].get_window_extent()]
    assert boxes[2].x0 > max(boxes[0].x1, boxes[1].x1)
    assert boxes[2].height > 1.5 * boxes[0].height
    assert boxes[0].y0 > boxes[1].y1


def test_marks_and_uncertainties_of_a_panel_are_those_of_its_series() -> None:
    x = np.arange(50.0)
    bar = np.full(50, 1e-3)
    bar[7] = np.inf
    line = Series(label="run", style="line/0/0", x=x, y=1.0 + x, bar=bar)
    ax = draw_panel(Figure().add_subplot(), _panel(series=(line,)))
    [bars] = ax.collections
    segments: Any = bars.get_segments()  # type: ignore[attr-defined]
    lengths = [segment[1, 1] - segment[0, 1] for segment in segments]
    expected = np.where(np.isfinite(bar), 2e-3, 0.0)
    np.testing.assert_allclose(lengths, expected, atol=1e-12)
    # a report leaves out uncertainties that are narrower than a line, which is a five hundredth of the panel
    for size, count in ((0.09, 0), (0.11, 1)):
        small = replace(line, bar=np.full(50, size))
        figure = draw_figure(FigureData(id="f", title="", caption="", columns=1, panels=(_panel(series=(small,)),)))
        assert len(figure.axes[0].collections) == count
    [point] = draw_panel(Figure().add_subplot(), _panel([3.0])).get_lines()
    assert point.get_marker() == "D"


@pytest.mark.parametrize(("count", "every"), [(4, 1), (18, 2), (90, 10)])
def test_a_line_has_about_nine_markers_and_points_without_a_line_at_most_24(count: int, every: int) -> None:
    def drawn(style: str, number: int) -> Any:
        line = Series(label="run", style=style, x=np.arange(float(number)), y=np.ones(number))
        [artist] = draw_panel(Figure().add_subplot(), _panel(series=(line,))).get_lines()
        return artist.get_markevery()

    marked = {name: style for name, style in STYLES.items() if style.get("marker")}
    lines = [name for name, style in marked.items() if style["linestyle"] != "none" and name != "below"]
    points = [name for name, style in marked.items() if style["linestyle"] == "none"]
    assert lines
    assert points
    # a third or two thirds on the way to the second, so that marks of runs that agree stand beside each other
    offsets = {drawn(name, count)[0] for name in lines}
    assert offsets <= {every // 3, 2 * every // 3}
    assert {drawn(name, count)[1] for name in lines} == {every}
    assert {drawn(name, 24 * every)[1] for name in points} == {every}
    assert {drawn(name, 24 * every + 1)[1] for name in points} == {every + 1}


def test_bars_of_a_row_stand_beside_each_other() -> None:
    rows = np.arange(2.0)
    series = tuple(Series(label=f"{k}", style="", x=np.array([1.0, 2.0]) + k, y=rows) for k in range(2))
    figure = draw_figure(
        FigureData(id="f", title="", caption="", columns=1, panels=(_panel(series=series, rows=("a", "b"), bars=True),))
    )
    bars: list[Any] = list(figure.axes[0].patches)
    boxes = [(bar.get_width(), bar.get_y(), bar.get_height()) for bar in bars]
    # each 0.4 high, on both sides of the middle of its row
    np.testing.assert_allclose(boxes, [(1.0, -0.4, 0.4), (2.0, 0.6, 0.4), (2.0, 0.0, 0.4), (3.0, 1.0, 0.4)], atol=1e-12)
    assert figure.get_figheight() == pytest.approx(0.7 + 0.3 * 2 + 0.35)
