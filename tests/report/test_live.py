"""What a page plays has the numbers of the run, and errors stand at their places on one scale."""

from __future__ import annotations

import base64
from dataclasses import replace

import numpy as np
import pytest

from dem_bridge.report.live import MOST_TIMES_OF_MAP, MOST_VALUES_OF_MAP, Chain, error_scale_of, shown_chains
from dem_bridge.report.study import Panel, Series

TIME = np.linspace(0.0, 6e-4, 801)
WAVE = np.exp(-((40 * TIME[:, None] / 6e-4 - np.arange(1.0, 41.0)) ** 2) / 4.0)
CHAIN = Chain(id="slow", title="slow", caption="A wave.", time=TIME, velocity=0.6 * WAVE - 0.1, first=1)


def _values(data: dict[str, object]) -> np.ndarray:
    whole = np.frombuffer(base64.b64decode(str(data["values"])), dtype="<i2").reshape(-1, int(str(data["n"])))
    return np.where(whole == -32768, np.nan, whole / 32767.0 * float(str(data["scale"])))


def test_data_are_the_samples_of_the_run_to_sixteen_bits() -> None:
    [shown] = shown_chains([CHAIN])
    values, times = _values(shown["data"]), np.array(shown["data"]["times"])
    assert values.shape == (MOST_TIMES_OF_MAP, 40)
    rows = [int(np.argmin(np.abs(1e3 * TIME - time))) for time in times]
    assert np.max(np.abs(1e3 * TIME[rows] - times)) < 1e-4
    assert np.max(np.abs(values - CHAIN.velocity[rows])) <= 0.51 * shown["data"]["scale"] / 32767
    assert (times[0], times[-1]) == (0.0, 0.6)


def test_samples_that_are_dense_in_a_part_of_the_time_are_shown_once_each_in_their_order() -> None:
    uneven = replace(CHAIN, time=TIME[-1] * (TIME / TIME[-1]) ** 3)
    [shown] = shown_chains([uneven])
    times = np.array(shown["data"]["times"])
    wanted = 1e3 * np.linspace(0.0, TIME[-1], MOST_TIMES_OF_MAP)
    nearest = np.unique(np.argmin(np.abs(wanted[:, None] - 1e3 * uneven.time), axis=1))
    assert len(nearest) < MOST_TIMES_OF_MAP
    np.testing.assert_allclose(times, 1e3 * uneven.time[nearest], rtol=0.0, atol=1e-4)


def test_a_value_that_is_unknown_stays_unknown() -> None:
    velocity = CHAIN.velocity.copy()
    velocity[0, 3] = np.nan
    [shown] = shown_chains([replace(CHAIN, velocity=velocity)])
    assert np.isnan(_values(shown["data"])[0, 3])


def test_all_chains_of_a_page_have_300_kb_at_most_and_those_beyond_are_shown_without_data() -> None:
    wide = [replace(CHAIN, id=str(k), velocity=np.tile(CHAIN.velocity, (1, 5))) for k in range(3)]
    shown = shown_chains(wide)
    sizes = [len(one["data"]["values"]) if one["data"] else 0 for one in shown]
    assert sizes[0] > sizes[1] > sizes[2] == 0
    assert 0.9 * MOST_VALUES_OF_MAP * 8 / 3 < sum(sizes) < 2.7e5
    assert all(one["image"].startswith("data:image/png;base64,") for one in shown)


def test_rings_stand_at_the_arrivals_of_every_fifth_body() -> None:
    arrival = np.linspace(1e-5, 6.2e-4, 40)
    arrival[9] = np.nan
    [shown] = shown_chains([replace(CHAIN, fronts={"BCA": arrival})])
    rings = shown["fronts"]["BCA"]
    assert [x for x, _ in rings] == [100.0 * (k - 0.5) / 40 for k in (5, 15, 20, 25, 30, 35)]  # 40 lies beyond the end
    assert rings[0][1] == pytest.approx(100.0 * arrival[4] / 6e-4, abs=0.01)


def test_names_of_lines_that_end_together_stand_apart() -> None:
    together = np.full((801, 4), 0.5)
    [shown] = shown_chains([replace(CHAIN, velocity=together, lines=True)])
    ends = sorted(end for _, end in shown["lines"])
    assert min(np.diff(ends)) >= 7.9


def test_signed_errors_have_zero_in_the_middle_of_their_colours() -> None:
    [shown] = shown_chains([replace(CHAIN, signed=True)])
    assert shown["low"] == -shown["high"]


ROWS = ("Numerics:", "round-off", "step", "Effects:", "theory")
KINDS = ("", "round-off", "time step", "", "model")


def _panel(*sizes: float) -> Panel:
    slow = Series(label="slow", style="mark-2", x=np.array(sizes), y=np.array([1.0, 2.0, 4.0]))
    fast = replace(slow, label="fast", x=2.0 * slow.x)
    guide = Series(label="tolerance", style="guide", x=np.full(2, 5e-6), y=np.array([0.5, 2.5]))
    return Panel(title="", x_label="", y_label="", series=(slow, fast, guide), rows=ROWS, row_kinds=KINDS)


def test_rows_have_their_values_the_largest_first_and_headings_have_none() -> None:
    scale = error_scale_of(_panel(1e-10, 1e-6, 1e-2))
    assert scale is not None
    assert [row.name for row in scale.rows] == ["round-off", "step", "theory"]
    first = scale.rows[0].dots
    assert [(dot.series, dot.value) for dot in first] == [("fast", 2e-10), ("slow", 1e-10)]
    # the axis goes from 1e-14 to 1
    assert first[1].place == pytest.approx(100.0 * 4.0 / 14.0, abs=0.01)
    assert scale.tolerance is not None
    assert scale.tolerance.place == pytest.approx(100.0 * (14.0 + np.log10(5e-6)) / 14.0, abs=0.01)


def test_bands_lie_between_the_kinds_and_there_are_none_where_kinds_overlap() -> None:
    scale = error_scale_of(_panel(1e-10, 1e-6, 1e-2))
    assert scale is not None
    assert [band.kind for band in scale.bands] == ["round-off", "time step", "model"]
    assert [scale.bands[0].left, scale.bands[-1].right] == [0.0, 100.0]
    for band, row in zip(scale.bands, scale.rows, strict=True):
        assert all(band.left < dot.place < band.right for dot in row.dots)
    coarse = error_scale_of(_panel(1e-10, 1e-1, 1e-2))
    assert coarse is not None
    assert coarse.bands == ()


def test_the_band_of_the_step_ends_before_a_defect() -> None:
    panel = replace(_panel(1e-10, 1e-6, 0.1), row_kinds=("", "round-off", "time step", "", ""))
    scale = error_scale_of(panel)
    assert scale is not None
    step, defect = scale.rows[1].dots[0], scale.rows[2].dots[-1]  # the largest and the least
    middle = (step.place + defect.place) / 2.0
    assert scale.bands[-1] == ("time step", scale.bands[0].right, round(middle, 2))


def test_a_panel_without_values_has_no_scale() -> None:
    assert error_scale_of(_panel(0.0, 0.0, 0.0)) is None
