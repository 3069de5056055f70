"""The figures of the paper as numbers: what they show is what truth files, formulas and made-up runs say."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from dem_bridge.errors import UsageError
from dem_bridge.report.drawing import draw_figure
from dem_bridge.report.images import picture_of_data
from dem_bridge.report.page import csv_texts
from dem_bridge.report.study import FigureData, Panel, Series
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.paper.figures import (
    ChainRuns,
    figure_2,
    figure_3,
    figure_4,
    figure_4_spectra,
    figure_5,
    figure_6,
)
from dem_bridge.studies.paper.panels import MAP_ROWS, speed_ratios, window
from dem_bridge.trajectory.trajectory import Trajectory
from tests.conftest import Solve
from tests.helpers.fake_runs import NO_COST, NO_ERROR
from tests.helpers.quadruple_truth import Truth

#: of a map's rounding: half a unit of the last of its five digits
ROUNDED = 0.5e-5


def _series(panel: Panel, style: str) -> Series:
    return next(one for one in panel.series if one.style == style)


def _runs(truth: Truth, solved: Solve) -> ChainRuns:
    """The twin stands in for LAMMPS: same algorithm, no engine."""
    scene = replace(truth.scene, spacing=0.018)
    backends = {"reference": "reference", "lammps-granular": "verlet", "bca": "bca", "ode45": "ode45"}
    return ChainRuns(scene, {name: solved(scene, backend, uncertainty=False) for name, backend in backends.items()})


@pytest.fixture(scope="module")
def chains(decelerating: Truth, accelerating: Truth, solved: Solve) -> tuple[ChainRuns, ChainRuns]:
    return _runs(decelerating, solved), _runs(accelerating, solved)


def _made_up(*, bodies: int = 61, width: float = 12e-6, power: float = 0.37, seconds: float = 2e-3) -> ChainRuns:
    """A Gaussian pulse of the same length in time at every body, at speeds and forces that follow powers exactly."""
    stiffness = np.linspace(8e10, 1e10, bodies - 1)
    i = np.arange(1, bodies - 1)
    speed = (4e8 - 5e6 * i) ** 0.4
    crossing = 1e-4 + np.concatenate([[0.0], np.cumsum(0.018 / speed)])
    scene = Scene(
        name="made-up",
        duration=seconds,
        mass=(1e-2,) * bodies,
        stiffness=tuple(stiffness),
        velocity=(0.8,) + (0.0,) * (bodies - 1),
        spacing=0.018,
    )
    time = np.linspace(0.0, seconds, 2001)
    velocity = np.zeros((2001, bodies))
    velocity[:, 1:] = 0.5 * np.exp(-0.5 * ((time[:, None] - crossing) / width) ** 2)
    run = Trajectory(
        time=time,
        displacement=np.zeros_like(velocity),
        velocity=velocity,
        contact_force=np.zeros((2001, bodies - 1)) + np.arange(bodies - 1),
        peak_force=300.0 * (stiffness / 1e10) ** power,
        crossing_time=crossing,
        uncertainty=NO_ERROR,
        cost=NO_COST,
        provenance={"backend": "made up"},
    )
    return ChainRuns(scene, {"reference": run})


@pytest.fixture(scope="module")
def made_up() -> ChainRuns:
    return _made_up()


def test_the_map_is_the_truth_at_its_own_times_and_without_the_striker(
    chains: tuple[ChainRuns, ChainRuns], decelerating: Truth
) -> None:
    found = figure_2(*chains).panels[0].map
    assert found is not None
    assert found.x.tolist() == list(range(1, 41))
    rows = np.searchsorted(decelerating.data["t"], 1e-3 * found.y[1:] - 1e-12)
    np.testing.assert_allclose(1e3 * decelerating.data["t"][rows], found.y[1:], rtol=1e-9)
    truth = decelerating.data["v"][rows, 1:]
    # by LAMMPS' twin at its own time step, which errs by 3e-6 of v0
    assert np.abs(found.values[1:] - truth).max() <= ROUNDED * 1.0 + 1e-5
    assert found.values.max() == pytest.approx(truth.max(), abs=2e-5)
    assert found.values.max() < 0.8


def test_both_maps_end_when_the_slower_front_has_long_passed(chains: tuple[ChainRuns, ChainRuns]) -> None:
    ends = [panel.map.y[-1] for panel in figure_2(*chains).panels if panel.map is not None]
    assert ends[0] == ends[1]
    # 0.572 ms is the arrival at the end of the slower one; samples are 6 us apart
    assert 1.3 * 0.57 - 0.006 < ends[0] < 1.3 * 0.58


def test_fronts_and_residence_times_of_theory_are_those_of_the_formula(
    chains: tuple[ChainRuns, ChainRuns], decelerating: Truth
) -> None:
    """Eq. 3.3 to 3.7 of the paper, written out once more."""
    m0, m = decelerating.data["m"][:2]
    v, n, mu = 2.0 * 0.8 / (1.0 + m / m0), 2.5, m / 2.0
    gamma = math.gamma(1.0 + 1.0 / n) / math.gamma(0.5 + 1.0 / n)
    beta = decelerating.data["beta"][1:40]
    residence = math.sqrt(math.pi) * (n * mu / (2.0 * beta)) ** (1.0 / n) * v ** (-1.0 + 2.0 / n) * gamma
    line = _series(figure_3(*chains).panels[0], "bca")
    assert line.x.tolist() == list(range(1, 40))
    np.testing.assert_allclose(line.y, 1e6 * residence, rtol=1e-12)
    front = _series(figure_2(*chains).panels[0], "bca")
    np.testing.assert_allclose(np.diff(front.y), 1e3 * residence, rtol=1e-9)


def test_residence_times_and_speeds_are_those_of_the_truth(free_chain: Truth, solved: Solve) -> None:
    chain = _runs(free_chain, solved)
    figure = figure_3(chain, chain)
    residence = np.diff(free_chain.data["t_cross"])
    for name, error in (("reference", 1e-9), ("lammps-granular", 1e-4), ("ode45", 0.02)):
        np.testing.assert_allclose(_series(figure.panels[0], name).y, 1e6 * residence, rtol=error)
        np.testing.assert_allclose(_series(figure.panels[3], name).y, 0.018 / residence, rtol=error)


def test_bars_are_those_of_both_crossings_and_none_where_nothing_is_known(
    decelerating: Truth, chains: tuple[ChainRuns, ChainRuns], solved: Solve
) -> None:
    run = chains[0].reference
    bars = np.linspace(1e-9, 2e-9, 40)
    barred = replace(run, uncertainty=replace(run.uncertainty, crossing_time=bars))
    times, _, speeds, *_ = figure_3(ChainRuns(chains[0].scene, {"reference": barred}), chains[1]).panels
    line, speed = _series(times, "reference"), _series(speeds, "reference")
    assert line.bar is not None
    assert speed.bar is not None
    np.testing.assert_allclose(line.bar, 1e6 * (bars[:-1] + bars[1:]), rtol=1e-12)
    # the speed changes most where the residence time is short
    np.testing.assert_allclose(speed.bar / speed.y, line.bar / (line.y - line.bar), rtol=1e-12)
    assert _series(figure_3(*chains).panels[0], "bca").bar is None


def test_the_fit_of_the_speed_finds_the_power_that_made_it(made_up: ChainRuns) -> None:
    panel = figure_3(made_up, made_up).panels[2]
    line = _series(panel, "fit")
    np.testing.assert_allclose(line.y, (4e8 - 5e6 * line.x) ** 0.4, rtol=1e-8)
    assert panel.notes == ("fit: b1 = 400, b2 = -5 in 10⁶ (m/s)^2.5, to 0.00 % rms",)


def test_spectra_of_a_gaussian_pulse_are_those_of_the_formula(made_up: ChainRuns) -> None:
    figure = figure_4_spectra(made_up, made_up)
    panel = figure.panels[0]
    found, width = panel.map, 12e-6
    assert found is not None
    assert (panel.x_label, panel.y_label) == ("cylinder", "frequency (kHz)")
    # |v|^2 goes as exp(-(2 pi f s)^2), whose mean is 1 / (2 pi^1.5 s) on f > 0
    inside = (found.x > 5) & (found.x < 55)
    centroid = _series(panel, "reference")
    np.testing.assert_allclose(centroid.y[inside], 1e-3 / (2.0 * math.pi**1.5 * width), rtol=0.03)
    shape = np.exp(-((2.0 * math.pi * 1e3 * found.y * width) ** 2))
    assert np.abs(found.values[:, inside] - shape[:, None]).max() < 0.01
    assert found.y[-1] == pytest.approx(1e-3 * math.sqrt(-math.log(0.02)) / (2.0 * math.pi * width), rel=0.05)


def test_the_wavenumber_of_a_pulse_that_slows_down_rises(made_up: ChainRuns) -> None:
    """Of the same length in time, it gets shorter in space as its speed V falls: k = 0.018 / (2 pi^1.5 V s)."""
    panel = figure_4_spectra(made_up, made_up).panels[2]
    found, line = panel.map, _series(panel, "reference")
    assert found is not None
    assert (panel.x_label, panel.y_label) == ("time (ms)", "wavenumber (1/cylinder)")
    assert len(found.x) <= MAP_ROWS
    for body in (20, 40):
        speed = (4e8 - 5e6 * body) ** 0.4
        there = np.interp(1e3 * made_up.reference.crossing_time[body - 1], line.x, line.y)
        # the speed changes by 2 % along the pulse
        assert there == pytest.approx(0.018 / (2.0 * math.pi**1.5 * speed * 12e-6), rel=0.03)


def test_each_column_of_a_spectrum_has_one_as_its_largest(made_up: ChainRuns) -> None:
    for panel in figure_4_spectra(made_up, made_up).panels:
        assert panel.map is not None
        assert np.all(panel.map.values.max(axis=0) == 1.0)


def test_the_exponent_is_the_one_that_made_the_forces(made_up: ChainRuns) -> None:
    other = _made_up(power=0.41)
    for panel, power in zip(figure_5(made_up, other).panels[2:4], (0.37, 0.41), strict=True):
        fit, guide = _series(panel, "fit"), _series(panel, "guide")
        np.testing.assert_allclose(fit.y, 300.0 * (fit.x / 10.0) ** power, rtol=1e-9)
        assert np.diff(np.log(guide.y)) / np.diff(np.log(guide.x)) == pytest.approx(0.4)
        assert np.all(guide.y > fit.y)
        assert panel.log
        assert panel.notes[0].startswith(f"exponent {power:.4f} for contacts ")


def test_insets_are_of_the_middle_while_the_impulse_is_there(made_up: ChainRuns) -> None:
    velocity, force = figure_4(made_up, made_up).panels[2], figure_5(made_up, made_up).panels[4]
    arrival = 1e3 * made_up.reference.crossing_time[29]
    line = _series(velocity, "reference")
    assert velocity.notes == ("cylinder 30",)
    assert line.x[np.argmax(line.y)] == pytest.approx(arrival, abs=0.001)  # a sample
    assert line.x[0] < arrival < line.x[-1] < arrival + 0.2
    assert force.notes == ("between cylinders 29 and 30",)
    assert np.all(_series(force, "reference").y == 29.0)


def test_ratios_are_handed_on_and_what_is_missing_is_a_gap(chains: tuple[ChainRuns, ChainRuns]) -> None:
    slow, fast = chains
    ratios = [(-0.01, {"reference": 0.5, "bca": 0.6}), (0.01, {"reference": 0.3})]
    figure = figure_6((slow, slow, fast, fast), ratios, [(0.0, {"adiabatic": 2.0})])
    down, up = figure.panels[2], figure.panels[5]
    # theories would lie on the line of the reference; their deviations are below
    assert [one.style for one in down.series] == ["reference"]
    np.testing.assert_array_equal(down.series[0].y, [0.5, 0.3])
    assert up.series == ()
    every = speed_ratios("", [*ratios, (0.02, {"adiabatic": 2.0})]).series
    assert [one.style for one in every] == ["reference", "bca", "adiabatic"]
    np.testing.assert_array_equal(every[1].y, [0.6, np.nan, np.nan])
    # 20 % above the reference, which itself has no deviation
    [away] = figure.panels[8].series
    assert away.style == "bca"
    np.testing.assert_allclose(away.y, [20.0, np.nan])
    assert figure.panels[11].series == ()
    # each map has the deviation of its arrivals two rows below
    for place in (0, 1, 3, 4):
        assert figure.panels[place].title[:2] == figure.panels[place + 6].title[:2]
    with pytest.raises(UsageError, match="2 maps; figure 6 has 4"):
        figure_6((slow, fast), ratios, ratios)


Figures = Callable[[ChainRuns, ChainRuns], FigureData]


def _sixth(slow: ChainRuns, fast: ChainRuns) -> FigureData:
    return figure_6((slow, slow, fast, fast), [(0.0, {"reference": 0.3})], [(0.0, {"reference": 3.0})])


EACH = pytest.mark.parametrize("figure", [figure_2, figure_3, figure_4, figure_4_spectra, figure_5, _sixth])


@EACH
def test_every_axis_has_its_unit_and_pairs_share_their_scale(figure: Figures, made_up: ChainRuns) -> None:
    found = figure(made_up, made_up)
    # counts have no unit, and neither has a ratio, which names both of its parts
    counts = ("cylinder", "contact", "contact k, between cylinders k and k+1")
    ratios = ("V_out / V_in", "power / largest of its column")
    for place, panel in enumerate(found.panels):
        labels = [panel.x_label, panel.y_label, *([panel.map.label] if panel.map else [])]
        assert all(label in counts + ratios or re.search(r"\(\S+\)$", label) for label in labels)
        assert re.match(r"\([a-f](, inset|, deviation)?\) ", panel.title)
        for other in panel.shares_scale_with:
            assert place in (*found.panels[other].shares_scale_with, other)
            assert found.panels[other].y_label == panel.y_label
            assert (found.panels[other].map is None) == (panel.map is None)
    maps = [panel for panel in found.panels if panel.map is not None]
    assert all(len(panel.shares_scale_with) >= 2 for panel in maps)
    assert len({panel.title for panel in found.panels}) == len(found.panels)


@EACH
def test_the_csv_is_small_and_gives_every_number_back(figure: Figures, made_up: ChainRuns) -> None:
    found = figure(made_up, made_up)
    texts = csv_texts(found)
    assert max(len(text.encode()) for text in texts.values()) < 600_000
    rows = list(csv.DictReader(io.StringIO(texts[f"{found.id}.csv"]))) if f"{found.id}.csv" in texts else []
    for panel in found.panels:
        for line in panel.series:
            mine = [row for row in rows if (row["panel"], row["series"]) == (panel.title, line.label)]
            np.testing.assert_array_equal([float(row["y"]) for row in mine], line.y)
        if panel.map is not None:
            assert max(panel.map.values.shape) <= max(MAP_ROWS, made_up.scene.n_body)
            text = texts[f"{found.id}-{panel.title[1]}.csv"]
            numbers = np.loadtxt(io.StringIO(text), delimiter=",", skiprows=1)
            np.testing.assert_array_equal(numbers, np.column_stack([panel.map.y, panel.map.values]))


@EACH
def test_figures_are_drawn_with_whatever_runs_there_are(figure: Figures, chains: tuple[ChainRuns, ChainRuns]) -> None:
    slow, fast = chains
    alone = ChainRuns(slow.scene, {"reference": slow.reference})
    pictured = figure(alone, fast)
    assert len(draw_figure(pictured).axes) >= len(pictured.panels)
    styles = {line.style for panel in figure(alone, alone).panels for line in panel.series}
    assert styles <= {"reference", "fit", "guide"}


def test_a_figure_needs_a_reference(chains: tuple[ChainRuns, ChainRuns]) -> None:
    scene = chains[0].scene
    with pytest.raises(UsageError, match=r"runs of a_N40_dec: bca; a figure needs that of backend 'reference'"):
        ChainRuns(scene, {"bca": chains[0].runs["bca"]})


def test_maps_end_with_the_run_where_the_front_gets_nowhere(made_up: ChainRuns) -> None:
    crossing = made_up.reference.crossing_time.copy()
    crossing[40:] = np.nan
    lost = ChainRuns(made_up.scene, {"reference": replace(made_up.reference, crossing_time=crossing)})
    assert window([lost], 1.3) == made_up.scene.duration
    found = figure_2(lost, made_up).panels[0]
    assert found.map is not None
    assert found.map.y[-1] == pytest.approx(1e3 * made_up.scene.duration, rel=0.01)
    assert picture_of_data(figure_2(lost, lost)).startswith("<svg")


def test_quiet_maps_stay_quiet(made_up: ChainRuns) -> None:
    rest = replace(made_up.reference, velocity=np.zeros_like(made_up.reference.velocity))
    quiet, moving = (ChainRuns(made_up.scene, {"reference": run}) for run in (rest, made_up.reference))
    found = figure_2(quiet, moving).panels[0].map
    assert found is not None
    assert not found.values.any()
    # what rounds to nothing has no sign
    recoil = replace(made_up.reference, velocity=np.where(made_up.reference.velocity > 1e-7, 0.5, -1e-9))
    found = figure_2(ChainRuns(made_up.scene, {"reference": recoil}), moving).panels[0].map
    assert found is not None
    assert set(found.values.ravel().tolist()) == {0.0, 0.5}
    assert not np.signbit(found.values).any()
