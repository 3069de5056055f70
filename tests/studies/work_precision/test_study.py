"""Work-precision: each row is what a run of its settings gives, and what has no run keeps its row."""

from __future__ import annotations

import csv
import io
import itertools
import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import dem_bridge as db
from dem_bridge.backends.base import Sampling
from dem_bridge.backends.prescan import Prescan
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.report.study import Study
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.work_precision import curves as work_curves
from dem_bridge.studies.work_precision import figures as work_figures
from dem_bridge.studies.work_precision.curves import Curve, curves, steps
from dem_bridge.studies.work_precision.runs import (
    NORMS,
    Measured,
    Point,
    Timing,
    errors_of,
    measured,
    readings_of,
    uncertainties_of,
)
from dem_bridge.studies.work_precision.study import study_work_precision

SCENE = Scene(
    name="four",
    duration=2e-4,
    mass=(8e-3, 1e-2, 1e-2, 1e-2),
    stiffness=(4e9, 3e10, 1e10),
    velocity=(0.8, 0.0, 0.0, 0.0),
    samples=40,
    spacing=18e-3,
)
FEW = ("verlet", "reference", "ode45", "bca")


DRAWN = ("velocity", "arrival")


@pytest.fixture(scope="module")
def small() -> Iterator[None]:
    """Few steps, and two of the figures."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(work_curves, "HALVINGS", 8)
        patch.setattr(work_figures, "DRAWN", DRAWN)
        yield


@pytest.fixture(scope="module")
def written(small: None, tmp_path_factory: pytest.TempPathFactory) -> tuple[Study, Path, list[float]]:
    folder = tmp_path_factory.mktemp("work") / "out"
    told: list[float] = []
    found = db.study(
        "work-precision",
        SCENE,
        backends=FEW,
        repeats=1,
        folder=folder,
        store=False,
        progress=lambda done, total, label: told.append(done / total),
    )
    return found, folder, told


def _lines(folder: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO((folder / "work-precision-all.csv").read_text())))


def test_every_row_of_the_tidy_table_is_what_its_settings_give(written: tuple[Study, Path, list[float]]) -> None:
    rows = _lines(written[1])
    truth = db.solve(SCENE, backend="reference")
    truth_readings = readings_of(SCENE, truth)
    bars = uncertainties_of(truth_readings)
    assert len(bars) == len(OBSERVABLES) * len(NORMS)  # the wave passes all bodies
    settings = list(dict.fromkeys((row["backend"], row["curve"], row["settings"]) for row in rows))
    assert {backend for backend, _, _ in settings} == set(FEW)
    assert len(rows) == len(settings) * len(OBSERVABLES) * len(NORMS)
    for backend, curve, asked in settings:
        mine = {(r["observable"], r["norm"]): r for r in rows if (r["curve"], r["settings"]) == (curve, asked)}
        assert {float(row["reference_uncertainty"]) for row in mine.values()} <= set(bars.values())
        assert {row["reason"] for row in mine.values()} == {""}  # all settings run on this scene
        run = db.solve(SCENE, backend=backend, uncertainty=False, **json.loads(asked))
        expected = bars if backend == "reference" else errors_of(SCENE, run, truth_readings)
        assert {key: float(row["error"]) for key, row in mine.items()} == expected
        assert {float(row["force_evaluations"]) for row in mine.values()} == {run.cost.force_evaluations}
        for key, row in mine.items():
            assert row["known"] == ("yes" if expected[key] > bars[key] else "no")


def test_netcdf_has_the_same_numbers_with_units(written: tuple[Study, Path, list[float]]) -> None:
    rows = _lines(written[1])
    dataset = xr.load_dataset(written[1] / "work-precision.nc", engine="h5netcdf")
    assert dataset["error"].dims == ("run", "observable", "norm")
    for name, table in (("error", "error"), ("known", "known")):
        found = dataset[name].values.ravel()
        column = [row[table] for row in rows]
        expected = [float(x == "yes") for x in column] if name == "known" else [float(x) for x in column]
        np.testing.assert_array_equal(found, expected)
    per_run = len(OBSERVABLES) * len(NORMS)
    for name, unit in (("cpu_min", "s"), ("wall_median", "s"), ("force_evaluations", "1"), ("dt", "s")):
        assert dataset[name].attrs["units"] == unit
        np.testing.assert_array_equal(dataset[name].values, [float(row[name]) for row in rows[::per_run]])
    assert list(dataset["curve"].values) == [row["curve"] for row in rows[::per_run]]
    assert dataset.attrs["scene_hash"] == SCENE.content_hash


def test_the_page_names_all_files_and_the_table_has_every_setting(written: tuple[Study, Path, list[float]]) -> None:
    found, folder, _ = written
    page = (folder / "index.html").read_text()
    names = {file.relative_to(folder).as_posix() for file in folder.rglob("*.*")}
    pictures = {f"figures/work-precision-{name.replace('_', '-')}.svg" for name in DRAWN}
    tables = {f"tables/{name}.csv" for name in ("cheapest", "floors", "runs")}
    assert {"work-precision-all.csv", "work-precision.nc"} | tables | pictures <= names
    assert all(f'"{name}"' in page for name in names - {"index.html", "work-precision.json"})
    runs = next(one for one in found.tables if one.id == "runs")
    assert len(runs.rows) == len(_lines(folder)) // (len(OBSERVABLES) * len(NORMS))
    assert not found.interrupted


def test_progress_goes_from_nothing_to_all_and_never_back(written: tuple[Study, Path, list[float]]) -> None:
    told = written[2]
    assert told == sorted(told)
    assert told[0] == 0.0
    assert told[-1] == 1.0


def test_the_cheapest_meets_its_target_and_costs_what_its_row_says(written: tuple[Study, Path, list[float]]) -> None:
    found = written[0]
    cheap, runs = (next(one for one in found.tables if one.id == name) for name in ("cheapest", "runs"))
    by_name: dict[str, dict[str, Any]] = {}
    for row in runs.rows:
        cells = dict(zip(runs.columns, row, strict=True))
        by_name[f"{cells['curve']} at {cells['setting']}".removesuffix(" at ")] = cells
    for observable, target, *groups in cheap.rows:
        for name, cost in zip(groups[::2], groups[1::2], strict=True):
            if name == "-":
                assert math.isnan(float(cost))
                continue
            cells = by_name[str(name)]
            assert float(cells[str(observable)]) <= float(target)
            assert cells["CPU, least (ms)"] == cost
    # theories know when the wave comes and little of velocities
    assert cheap.rows[[row[:2] for row in cheap.rows].index(("velocity", 1e-8))][2] != "bca"


def test_steps_fall_on_the_samples_and_begin_below_the_stiffest_contact() -> None:
    prescan, sampling = prescan_scene(SCENE), Sampling(count=7)
    found = steps(SCENE, sampling, prescan)
    interval = SCENE.duration / 7
    halvings = [math.log2(interval / dt) for dt in found]
    # powers of two are exact
    assert halvings == [round(halvings[0]) + j for j in range(len(found))]
    assert found[0] * prescan.frequency <= 1.0
    assert halvings[0] == 0.0 or 2.0 * found[0] * prescan.frequency > 1.0
    free = Prescan(peak_overlap=np.zeros(1), frequency=0.0, max_acceleration=0.0, lowest=0.0, highest=1.0, steps=1)
    assert steps(SCENE, sampling, free)[0] == interval


def test_every_backend_that_does_the_scene_has_a_curve_and_others_a_reason() -> None:
    damped = replace(SCENE, name="damped", drag=10.0)
    asked, notes = curves(damped, Sampling(count=4), prescan_scene(damped), None)
    there = {curve.backend for curve, _ in asked}
    assert {"verlet", "scipy", "reference"} <= there
    assert "ode45" not in there
    assert any(note.startswith("ode45 is not there: the scene has drag;") for note in notes)
    # a backend with a fixed step has that knob, whatever its name
    assert all(any(c.knob == "dt" for c, b in asked if b is chosen) for _, chosen in asked if chosen.order is not None)


def _measured(monkeypatch: pytest.MonkeyPatch, run: Any, **settings: Any) -> list[Point]:
    """One curve of verlet whose runs are ``run(value)``."""
    truth = db.solve(SCENE, backend="reference")
    monkeypatch.setattr(Curve, "run", lambda self, chosen, scene, value, sampling, *, limit: run(value))
    curve = Curve(name="verlet", backend="verlet", knob="dt", values=(8e-8, 4e-8, 2e-8, 1e-8))
    asked: Any = [(curve, object())]
    chosen = {"limit": 5.0, "repeats": 1, "progress": None} | settings
    return list(measured(asked, SCENE, Sampling(count=SCENE.samples), readings_of(SCENE, truth), **chosen))


def test_beyond_the_limit_rows_stay_without_numbers_and_without_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[float] = []

    def run(value: float) -> Any:
        made.append(value)
        return db.solve(SCENE, backend="verlet", dt=value, uncertainty=False)

    points = _measured(monkeypatch, run, limit=1e-9)
    assert [point.value for point in points] == [8e-8, 4e-8, 2e-8, 1e-8]
    assert all(math.isnan(point.error("velocity")) and math.isnan(point.cpu_min) for point in points)
    assert points[0].reason.startswith("the run took ")
    assert all(point.reason.startswith("not run: the predicted time is ") for point in points[1:])
    assert made == [8e-8, 8e-8]  # to warm, and to measure


def test_a_run_that_breaks_says_why_and_the_next_are_made(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(value: float) -> Any:
        if value == 4e-8:
            raise RunBroken("lost atoms")
        return db.solve(SCENE, backend="verlet", dt=value, uncertainty=False)

    points = _measured(monkeypatch, run)
    assert [point.reason for point in points] == ["", "lost atoms", "", ""]
    errors = [point.error("velocity") for point in points]
    assert math.isnan(errors[1])
    # order 2: a quarter for half the step, to a fifth for the kink at touch
    assert errors[2] / errors[3] == pytest.approx(4.0, rel=0.2)


def test_ctrl_c_leaves_what_was_finished(monkeypatch: pytest.MonkeyPatch, small: None) -> None:
    real, calls = Curve.run, itertools.count(1)

    def run(*arguments: Any, **settings: Any) -> Any:
        if next(calls) == 4:  # one to warm, two measured
            raise KeyboardInterrupt
        return real(*arguments, **settings)

    monkeypatch.setattr(Curve, "run", run)
    found = db.study("work-precision", SCENE, backends=("verlet",), repeats=1, store=False)
    assert found.interrupted
    assert len(next(one for one in found.tables if one.id == "runs").rows) == 2
    assert str(found.files["work-precision-all.csv"]()).count("\n") == 1 + 2 * len(OBSERVABLES) * len(NORMS)


def test_what_is_below_the_bar_is_drawn_at_it_and_marked() -> None:
    curve = Curve(name="scipy", backend="scipy", knob="rtol", values=(1e-4, 1e-13))
    bars = {(name, norm): 1e-12 for name in OBSERVABLES for norm in NORMS}

    def point(value: float, error: float) -> Point:
        errors = dict.fromkeys(bars, error)
        times = Timing(wall=(1.0,), cpu=(1.0 / value,)).numbers()
        return Point(curve=curve, value=value, **times, force_evaluations=1.0 / value, errors=errors)

    found = Measured(
        scene=SCENE,
        sampling=Sampling(count=4),
        limit=1.0,
        points=(point(1e-4, 1e-5), point(1e-13, 1e-14)),
        uncertainty=bars,
    )
    panel = next(iter(work_figures.figures(found))).panels[0]
    by_label = {line.label: line for line in panel.series}
    assert by_label["scipy"].y.tolist() == [1e-5, 1e-12]
    assert by_label["less, not known"].y.tolist() == [1e-12]
    assert by_label["Pareto front"].y.tolist() == [1e-5, 1e-12]


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"limit": 0.0}, "limit = 0.0; allowed: a number of seconds > 0"),
        ({"limit": math.nan}, "limit = nan; allowed: a number of seconds > 0"),
        ({"repeats": 0}, "repeats = 0; allowed: a whole number from 1 to 1000"),
        ({"backends": ("lamps",)}, "backend = 'lamps'; allowed: "),
    ],
)
def test_settings_that_are_none_are_refused_in_a_line(settings: dict[str, Any], said: str) -> None:
    with pytest.raises(UsageError) as caught:
        study_work_precision(SCENE, **settings)
    assert str(caught.value).startswith(said)


@pytest.mark.slow
@pytest.mark.lammps
def test_lammps_has_its_knobs_and_errs_as_the_twin_does(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in (
        ("HALVINGS", 8),
        ("FINEST", dict.fromkeys(("lammps-granular", "lammps-table"), 2)),
        ("POINTS", (30, 3000)),
        ("LINES", (16,)),
    ):
        monkeypatch.setattr(work_curves, name, value)
    names = ("lammps-granular", "lammps-table", "verlet")
    found = db.study("work-precision", SCENE, backends=names, repeats=1, store=False)
    runs = next(one for one in found.tables if one.id == "runs")
    rows = [dict(zip(runs.columns, row, strict=True)) for row in runs.rows]
    by_step = {(row["curve"], row["setting"]): float(row["velocity"]) for row in rows}
    for (curve, dt), error in by_step.items():
        if curve in ("lammps-granular", "lammps-table"):
            # the same algorithm: round-off of 1e-10 and tables of 1e-6 beside errors of 1e-3
            assert error == pytest.approx(by_step["verlet", dt], rel=1e-2)
    spline = [float(row["velocity"]) for row in rows if row["curve"] == "lammps-table (spline)"]
    assert spline[1] < 0.5 * spline[0]
    assert "lammps-granular (R = 9 mm)" in {row["curve"] for row in rows}
    assert [figure.id for figure in found.figures][-1] == "work-precision-tables"
    assert any("LAMMPS with tables at dt" in sentence for sentence in found.answer)
