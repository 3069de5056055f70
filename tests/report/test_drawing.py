"""Any Exhibit is drawn from its data alone: shared scales are the same, nothing overlaps, CSV gives all back."""

from __future__ import annotations

import csv
import io
import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from dem_bridge.backends.base import BACKENDS, ENGINE_BACKENDS
from dem_bridge.report.drawing import draw_figure, fix_layout, panel_boxes
from dem_bridge.report.drawing_styles import style_of
from dem_bridge.report.images import picture_of_data
from dem_bridge.report.page import csv_texts
from dem_bridge.report.study import FigureData, Map, Panel, Series
from dem_bridge.report.styles import FURTHER, OF_BACKEND, STYLES, colour_limits
from tests.helpers.legibility import assert_legible

X = np.arange(1.0, 41.0)
LONG = "circles stand for the engine and crosses for another code, in words that fill more than one line of a panel"


def _map(scale: float, **changes: bool) -> Map:
    """A front of that height, and a last body that is ten times as fast."""
    time = np.linspace(0.0, 1.0, 60)
    values = scale * np.exp(-(((time[:, None] - X / 50.0) / 0.05) ** 2))
    values[:, -1] *= 10.0
    return Map(label="velocity (m/s)", x=X, y=time, values=values, **changes)


def _line(style: str, y: np.ndarray, bar: np.ndarray | None = None) -> Series:
    return Series(label=style, style=style, x=X[: len(y)], y=y, bar=bar)


def _panel(title: str, **parts: object) -> Panel:
    return Panel(title=title, x_label="cylinder", y_label="residence time (µs)", **parts)  # type: ignore[arg-type]


def _figure(*panels: Panel, columns: int = 2) -> FigureData:
    return FigureData(id="figure-9", title="nine", caption="", panels=panels, columns=columns)


EVERY_STYLE = tuple(_line(style, 3.0 + np.sin(X / 9.0) + 0.1 * at) for at, style in enumerate(STYLES))
FULL = _figure(
    _panel("(a) falls", map=_map(0.4), series=(_line("bca", X / 50.0),), notes=(LONG,), shares_scale_with=(1,)),
    _panel("(c) rises", map=_map(0.6), series=(_line("adiabatic", X / 50.0),), notes=("short",)),
    _panel("(b) a title of many words, which has no room on one line of its panel", series=EVERY_STYLE, notes=(LONG,)),
    _panel("(d) steep", series=(_line("reference", X**2.5), _line("guide", X**2)), log=True, notes=("n = 5/2",)),
)


def _axes(figure: Figure) -> list[Axes]:
    """Those of panels, without colour bars."""
    return [ax for ax in figure.axes if ax.get_label() != "<colorbar>"]


def _norm(ax: Axes) -> Any:
    return ax.collections[0].get_clim()


def test_each_panel_has_its_names_and_everything_in_it() -> None:
    axes = _axes(draw_figure(FULL))
    assert [ax.get_title(loc="left").split()[0] for ax in axes] == ["(a)", "(c)", "(b)", "(d)"]
    for ax, panel in zip(axes, FULL.panels, strict=True):
        assert (ax.get_xlabel(), ax.get_ylabel()) == (panel.x_label, panel.y_label)
        assert len(ax.collections) == (panel.map is not None)
        for line, series in zip(ax.get_lines(), panel.series, strict=True):
            np.testing.assert_array_equal(np.asarray(line.get_xydata()).T, [series.x, series.y])


def test_maps_that_share_have_one_scale_and_one_bar_and_others_their_own() -> None:
    shared, alone = (
        draw_figure(FULL),
        draw_figure(replace(FULL, panels=tuple(replace(p, shares_scale_with=()) for p in FULL.panels))),
    )
    one, other = (_norm(ax) for ax in _axes(shared)[:2])
    assert one == other
    assert len(shared.axes) - len(_axes(shared)) == 1
    one, other = (_norm(ax) for ax in _axes(alone)[:2])
    assert one != other
    assert len(alone.axes) - len(_axes(alone)) == 2


def test_the_scale_is_that_of_the_fronts_and_not_of_the_body_that_flies_off() -> None:
    low, high, extend = colour_limits([_map(0.4)])
    assert extend == "max"
    assert high == pytest.approx(0.4, rel=0.01)  # the front's height, between samples
    assert abs(low) < 0.001
    low, high, _ = colour_limits([_map(0.4, diverging=True)])
    assert low == -high


@given(arrays(float, (7, 5), elements=st.floats(-1e6, 1e6)), st.booleans())
def test_a_scale_is_never_empty_and_says_where_values_leave_it(values: np.ndarray, diverging: bool) -> None:
    one = Map(label="", x=np.arange(5.0), y=np.arange(7.0), values=values, diverging=diverging)
    low, high, extend = colour_limits([one])
    assert low < high
    step = (high - low) / 256.0  # a colour
    assert (extend in ("max", "both")) == bool((values > high + step).any())
    assert (extend in ("min", "both")) == bool((values < low - step).any())


@pytest.mark.parametrize("log", [False, True])
def test_panels_of_lines_that_share_have_one_axis_that_shows_all(log: bool) -> None:
    low, high = (_panel(f"({at})", series=(_line("reference", at * X),), log=log) for at in (1.0, 7.0))
    axes = _axes(draw_figure(_figure(low, replace(high, shares_scale_with=(0,)))))
    assert axes[0].get_ylim() == axes[1].get_ylim()
    bottom, top = axes[0].get_ylim()
    assert bottom <= 1.0
    assert top >= 7.0 * X[-1]
    assert (bottom == 0.0) is not log


def test_zero_is_on_every_linear_axis() -> None:
    for sign in (1.0, -1.0):
        [ax] = _axes(draw_figure(_figure(_panel("a", series=(_line("reference", sign * (100.0 + X)),)))))
        bottom, top = ax.get_ylim()
        assert bottom <= 0.0 <= top


@pytest.mark.parametrize("style", ["band", "reference"])
def test_bands_and_bars_are_within_a_linear_axis_at_its_first_point_too(style: str) -> None:
    bar = np.full(len(X), 0.5)
    bar[0] = 1.5
    [ax] = _axes(draw_figure(_figure(_panel("a", series=(replace(_line(style, np.ones(len(X))), bar=bar),)))))
    bottom, top = ax.get_ylim()
    assert bottom < -0.5  # 1 - 1.5, of the first point
    assert top > 2.5
    assert not ax.texts


def test_an_edge_of_a_first_point_far_above_the_others_does_not_compress_them() -> None:
    bar = np.full(len(X), 0.1)
    bar[0] = 100.0
    [ax] = _axes(draw_figure(_figure(_panel("a", series=(replace(_line("band", np.ones(len(X))), bar=bar),)))))
    assert ax.get_ylim()[1] < 1.5
    assert not ax.texts  # the note is for values


def test_a_long_label_of_a_y_axis_is_on_the_page() -> None:
    label = "energy change / largest energy in motion of all bodies (1e-08)"
    panel = replace(_panel("a", series=(_line("reference", X),)), y_label=label)
    figure = draw_figure(_figure(panel))
    assert _axes(figure)[0].get_ylabel().replace("\n", " ") == label
    assert_legible(figure)


@pytest.mark.parametrize(("least", "start"), [(1e-12, 1e-14), (1e-5, None)])
def test_a_scale_of_errors_begins_below_round_off_and_another_at_its_values(least: float, start: float | None) -> None:
    values = Series(label="error", style="mark-2", x=np.array([least, 1.0]), y=np.array([0.0, 1.0]))
    figure = draw_figure(_figure(replace(_panel("a", series=(values,)), rows=("first", "second"))))
    low, high = _axes(figure)[0].get_xlim()
    assert low == pytest.approx(start) if start is not None else low > 1e-7
    assert high >= 1.0


def test_a_first_point_far_above_is_named_and_squeezes_nothing() -> None:
    near, far = (np.concatenate([[first], np.full(39, 10.0)]) for first in (15.0, 300.0))
    axes = _axes(
        draw_figure(_figure(*(_panel(at, series=(_line("reference", y),)) for at, y in (("n", near), ("f", far)))))
    )
    texts = [[one.get_text() for one in ax.texts if "off scale" in one.get_text()] for ax in axes]
    assert texts == [[], ["cylinder 1: 300 µs, off scale"]]
    assert [15.0 < ax.get_ylim()[1] < 20.0 for ax in axes] == [True, False]
    assert 10.0 < axes[1].get_ylim()[1] < 15.0


def test_no_two_styles_are_told_apart_by_colour_alone() -> None:
    assert all(style_of(name) == style_of(ENGINE_BACKENDS[0]) for name in ENGINE_BACKENDS)
    forms = [(str(style["linestyle"]), style.get("marker")) for style in STYLES.values()]
    assert len(set(forms)) == len(forms)


CURVES = (
    *(f"curve/{name}" for name in BACKENDS),
    *(f"curve/{name}/richardson" for name in ("lammps-granular", "verlet")),
    "curve/lammps-granular/physical",
    "curve/ode45/both",
)
COST = tuple(
    Series(label=f"{style.removeprefix('curve/')} of some", style=style, x=X[:9] * 10.0**-at, y=X[:9] ** -4.0)
    for at, style in enumerate(CURVES)
)


def test_no_style_is_named_after_a_backend() -> None:
    assert not {*STYLES, *FURTHER} & {*BACKENDS}
    assert set(OF_BACKEND) <= {*BACKENDS}
    assert {*OF_BACKEND.values()} <= {*STYLES}


def test_no_two_curves_of_many_codes_are_told_apart_by_colour_alone() -> None:
    styles = [style_of(name) for name in CURVES]
    filled = [style["markerfacecolor"] == style["color"] for style in styles]
    forms = [(style["marker"], str(style["linestyle"]), full) for style, full in zip(styles, filled, strict=True)]
    assert len(set(forms)) == len(forms)
    # a code that nobody has named here is drawn nevertheless, and each code has a mark of its own
    assert len({style_of(f"curve/{name}")["marker"] for name in (*BACKENDS, "new")}) == len(BACKENDS) + 1


def test_the_front_is_behind_all_and_goes_down_where_the_next_is_paid_for() -> None:
    front = Series(label="Pareto front", style="front", x=X[:3], y=np.array([1e-2, 1e-4, 1e-6]))
    below = Series(label="less, not known", style="below", x=X[2:3], y=np.array([1e-6]))
    figure = draw_figure(_figure(_panel("(a)", series=(front, *COST, below), log=True)))
    lines = figure.axes[0].get_lines()
    assert lines[0].get_drawstyle() == "steps-post"
    assert lines[0].get_zorder() < min(line.get_zorder() for line in lines[1:])
    assert lines[-1].get_zorder() > max(line.get_zorder() for line in lines[:-1])
    # every point of a curve is a setting of its own: none goes unmarked
    assert {line.get_markevery() for line in lines[1:]} == {None}


@pytest.mark.slow
def test_a_tall_panel_loses_no_height_to_many_names() -> None:
    def height(*, tall: bool, names: int) -> float:
        figure = draw_figure(_figure(*(_panel(at, series=COST[:names], log=True, tall=tall) for at in "ab")))
        FigureCanvasAgg(figure).draw()
        return float(figure.axes[0].get_window_extent().height)

    low, high, many = height(tall=False, names=2), height(tall=True, names=2), height(tall=True, names=len(COST))
    assert high > 1.5 * low
    # names take no height from a panel (rows are not a whole fifth of an inch); many beside their lines may add some
    assert many > 0.9 * high


def test_the_colours_of_maps_rise_in_lightness_so_that_grey_keeps_their_order() -> None:
    figure = draw_figure(FULL)
    image = _axes(figure)[0].collections[0]
    low, high = _norm(_axes(figure)[0])
    colours = np.asarray(image.to_rgba(np.linspace(low, high, 64)))
    grey = colours[:, :3] @ [0.2126, 0.7152, 0.0722]
    assert np.all(np.diff(grey) > 0.0)
    assert grey[-1] - grey[0] > 0.6


STEEP = tuple(
    (columns, _panel("(d) steep", series=(_line("reference", X**power), _line("guide", 2.0 * X**power)), log=True))
    for columns, power in ((1, 1.2), (2, 0.01), (2, 0.6), (3, 2.5))
)


@pytest.mark.parametrize(("columns", "steep"), [*STEEP, (2, _panel("(d) many", series=COST, log=True, tall=True))])
def test_no_text_overlaps_another_or_leaves_the_page(columns: int, steep: Panel) -> None:
    figure = draw_figure(replace(FULL, columns=columns, panels=(*FULL.panels[:3], steep)))
    assert assert_legible(figure) > 30


NOTHING = np.full(40, np.nan)


@pytest.mark.parametrize(
    "panel",
    [
        _panel("empty"),
        _panel("unknown", series=(_line("bca", NOTHING),)),
        _panel("unknown", series=(_line("bca", NOTHING),), log=True),
        _panel("a point", series=(_line("reference", np.array([2.0])),)),
        _panel("two points", series=(_line("lammps-granular", np.array([2.0, -1.0])), _line("new", np.ones(2)))),
        _panel("rest", map=replace(_map(1.0), values=np.zeros((60, 40)))),
        _panel("unknown", map=replace(_map(1.0), values=np.full((60, 40), np.nan))),
        _panel("one body", map=Map(label="v (m/s)", x=X[:1], y=X, values=np.ones((40, 1)))),
        _panel("bars", series=(_line("ode45", X, bar=np.where(X > 3, np.inf, 0.5)),)),
    ],
    ids=lambda panel: panel.title,
)
def test_a_single_panel_with_little_in_it_is_drawn(panel: Panel) -> None:
    picture = picture_of_data(_figure(panel))
    assert picture.startswith("<svg")
    assert all(text.count("\n") >= 1 for text in csv_texts(_figure(panel)).values())


def test_a_figure_without_panels_is_an_empty_page() -> None:
    assert draw_figure(_figure()).axes == []


def test_a_panel_that_shares_with_none_that_is_there_is_refused() -> None:
    with pytest.raises(ValueError, match="panel 0 shares its scale with 4; the figure has 1 panels"):
        draw_figure(_figure(_panel("a", shares_scale_with=(4,))))


def test_marks_that_are_left_out_are_spoken_of() -> None:
    def said(count: int) -> str:
        many = Series(label="LAMMPS", style="lammps-granular", x=np.arange(float(count)), y=np.ones(count))
        return draw_figure(_figure(_panel("a", series=(many,)))).legends[0].get_title().get_text()

    assert said(20) == ""
    assert "not all points" in said(400)


def test_the_same_numbers_give_the_same_bytes() -> None:
    one = _figure(FULL.panels[1])
    first = picture_of_data(one)
    picture_of_data(FULL)  # nothing of another figure is left in the next one
    assert picture_of_data(one) == first


def test_csv_gives_back_every_number() -> None:
    texts = csv_texts(FULL)
    assert set(texts) == {"figure-9.csv", "figure-9-a.csv", "figure-9-c.csv"}
    for panel, letter in ((FULL.panels[0], "a"), (FULL.panels[1], "c")):
        head, *rows = csv.reader(io.StringIO(texts[f"figure-9-{letter}.csv"]))
        assert panel.map is not None
        assert head[0] == "velocity (m/s): residence time (µs) by cylinder"
        np.testing.assert_array_equal(np.array(head[1:], dtype=float), panel.map.x)
        np.testing.assert_array_equal(np.array(rows, dtype=float)[:, 0], panel.map.y)
        np.testing.assert_array_equal(np.array(rows, dtype=float)[:, 1:], panel.map.values)
    lines = list(csv.DictReader(io.StringIO(texts["figure-9.csv"])))
    for panel in FULL.panels:
        for series in panel.series:
            mine = [row for row in lines if (row["panel"], row["series"]) == (panel.title, series.label)]
            assert [(float(row["x"]), float(row["y"])) for row in mine] == list(zip(series.x, series.y, strict=True))


def test_two_maps_never_share_a_file() -> None:
    panels = (_panel("(a) one", map=_map(1.0)), _panel("(a) other", map=_map(1.0)))
    with pytest.raises(ValueError, match=r"two maps have the file name figure-9-a\.csv"):
        csv_texts(_figure(*panels))
    assert set(csv_texts(_figure(*(replace(p, title="no letter") for p in panels)))) == {
        "figure-9-1.csv",
        "figure-9-2.csv",
    }


def test_names_that_would_make_a_high_legend_stand_beside_their_lines_in_the_order_of_their_ends() -> None:
    names = [f"a long name of the code number {k} of many" for k in range(8)]
    lines = tuple(
        Series(label=name, style=f"nth/{k}/{k}", x=X, y=np.full(len(X), 1.0 + 0.01 * k)) for k, name in enumerate(names)
    )
    figure = draw_figure(_figure(_panel("(a)", series=lines), _panel("(b)", series=lines[:2])))
    assert figure.legends == []
    assert assert_legible(figure) > 10
    for ax, shown in zip(figure.axes, (names, names[:2]), strict=True):
        beside = [text for text in ax.texts if "code" in text.get_text()]
        heights = {text.get_text().replace("\n", " "): text.get_position()[1] for text in beside}
        assert sorted(heights, key=heights.__getitem__) == shown
    # each has a sample of its line
    assert len(figure.artists) == 10


def test_two_panels_of_a_row_with_the_same_names_have_them_once_and_a_lone_panel_has_the_whole_row() -> None:
    lines = tuple(
        Series(label=f"a name that needs much room in a legend {k}", style=f"nth/{k}/{k}", x=X, y=X + k)
        for k in range(9)
    )
    panels = [_panel(f"({letter})", series=lines) for letter in "abc"]
    figure = draw_figure(_figure(*panels))
    assert [len(ax.texts) for ax in figure.axes] == [0, 9, 9]
    first, _, last = (ax.get_position().width for ax in figure.axes)
    assert last > 1.4 * first


def test_a_line_that_lies_on_another_is_in_the_csv_and_not_drawn() -> None:
    seen = Series(label="seen", style="reference", x=X, y=X)
    figure = _figure(_panel("(a)", series=(seen, replace(seen, label="same", drawn=False))))
    assert [line.get_label() for line in draw_figure(figure).axes[0].get_lines()] == ["seen"]
    assert "same" in csv_texts(figure)[f"{figure.id}.csv"]


def test_signed_values_have_a_white_middle_and_others_colours_of_even_lightness() -> None:
    for signed, middle in ((True, (0.97, 0.97, 0.97)), (False, (0.48, 0.48, 0.47))):
        ax = draw_figure(_figure(_panel("(a)", map=_map(0.4, diverging=signed)))).axes[0]
        assert ax.collections[0].get_cmap()(0.5)[:3] == pytest.approx(middle, abs=0.02)


def test_each_panel_has_its_box_with_its_bar_and_names_of_rows_are_not_cut_off() -> None:
    figure = fix_layout(draw_figure(FULL))
    boxes = panel_boxes(figure)
    width, height = 72.0 * figure.get_size_inches()
    assert len(boxes) == len(figure.legends) + len(FULL.panels)
    for left, top, wide, high in boxes:
        assert -4.0 < left < left + wide < width + 4.0
        assert -4.0 < top < top + high < height + 4.0
    rows = _panel("(a)", series=(Series(label="a", style="mark-2", x=X[:2] + 1.0, y=np.arange(2.0)),), rows=("b", "c"))
    alone = fix_layout(draw_figure(_figure(replace(rows, y_label=""), replace(rows, y_label=""))))
    assert len(panel_boxes(alone)) == len(alone.legends) + 2
    for text in alone.axes[1].get_yticklabels():
        text.set_visible(False)  # as in panels that share the names of the first
    assert panel_boxes(alone) == []


def test_all_points_of_a_row_are_marked_and_not_all_of_a_curve() -> None:
    many = Series(label="a", style="mark-2", x=np.arange(1.0, 401.0), y=np.zeros(400))
    marked = [
        draw_figure(_figure(_panel("(a)", series=(many,), rows=rows))).axes[0].get_lines()[0].get_markevery()
        for rows in (("b",), ())
    ]
    assert marked[0] is None
    assert isinstance(marked[1], tuple)
    assert marked[1][1] > 1


def test_a_long_label_of_the_x_axis_is_not_cut_off_at_the_edge() -> None:
    panel = replace(_panel("(a)", series=(Series(label="a", style="reference", x=X, y=X),)), x_label="many words " * 8)
    figure = fix_layout(draw_figure(_figure(panel, panel, panel)))
    renderer = FigureCanvasAgg(figure).get_renderer()
    for ax in figure.axes:
        box = ax.xaxis.label.get_window_extent(renderer)
        assert 0.0 <= box.x0 < box.x1 <= figure.bbox.width


def test_numbers_of_a_logarithmic_axis_beside_names_do_not_cover_each_other() -> None:
    x = np.geomspace(7e-4, 0.025, 9)
    lines = tuple(Series(label=22 * "W" + str(k), style="mark-2", x=x, y=10.0**k * x**2) for k in range(6))
    panel = replace(_panel("(a)", series=lines), log=True)
    figure = fix_layout(draw_figure(_figure(panel, panel)))
    renderer = FigureCanvasAgg(figure).get_renderer()
    for ax in figure.axes:
        boxes = [text.get_window_extent(renderer) for text in ax.get_xticklabels() if text.get_text()]
        seen = sorted((box.x0, box.x1) for box in boxes if ax.bbox.x0 <= (box.x0 + box.x1) / 2.0 <= ax.bbox.x1)
        assert len(seen) >= 2
        assert all(one[1] < other[0] for one, other in itertools.pairwise(seen))
