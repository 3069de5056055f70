"""Observables along the chain are those of the run, in their places, and their bars hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.observables.front import peak_velocity_of_front, residence_time
from dem_bridge.observables.registry import OBSERVABLES
from tests.conftest import Solve
from tests.helpers.export_chains import CROSSED, PAIR


def test_every_body_has_what_the_run_says_of_it(solved: Solve) -> None:
    run = solved(CROSSED, "reference")
    frame = db.table_of(CROSSED, "observables").to_pandas()
    np.testing.assert_array_equal(frame["arrival_s"], [np.nan, *run.crossing_time])
    np.testing.assert_array_equal(frame["residence_time_s"], [np.nan, *residence_time(CROSSED, run)[1:-1], np.nan])
    # spacing over residence, and one over it
    np.testing.assert_allclose(frame["wave_speed_m_per_s"] * frame["residence_time_s"], [np.nan, 18e-3, 18e-3, np.nan])
    np.testing.assert_allclose(frame["front_speed_per_s"] * frame["residence_time_s"], [np.nan, 1.0, 1.0, np.nan])
    np.testing.assert_array_equal(frame["peak_velocity_m_per_s"], peak_velocity_of_front(CROSSED, run).velocity)
    np.testing.assert_array_equal(frame["peak_force_N"], [np.nan, *run.peak_force])


def test_bars_hold_between_a_coarse_run_and_the_reference() -> None:
    truth = db.table_of(CROSSED, "observables").to_pandas()
    coarse = db.table_of(CROSSED, "observables", backend="verlet", dt=4e-7).to_pandas()
    quantities = [name.replace("_uncertainty", "") for name in truth.columns if "_uncertainty" in name]
    assert len(quantities) == 8
    for name in quantities:
        stem, unit = next((name[: -len(u)], u) for u in ("_m_per_s", "_per_s", "_s", "_N") if name.endswith(u))
        off, bar = (
            abs(coarse[name] - truth[name]),
            coarse[f"{stem}_uncertainty{unit}"] + truth[f"{stem}_uncertainty{unit}"],
        )
        known = truth[name].notna()
        # an uncertainty that is unknown is an empty cell
        assert np.all(off[known] <= bar[known].fillna(np.inf)), name
        assert np.any(off[known] > 0.0), "the coarse run errs, or nothing was tested"


def test_a_bar_as_long_as_the_residence_leaves_no_bar_of_the_speed(monkeypatch: pytest.MonkeyPatch) -> None:
    run = db.solve(CROSSED, backend="reference", uncertainty=False)
    from dem_bridge.formats.tables.catalogue import observables

    frame = observables(CROSSED, run).to_pandas()
    assert frame["front_speed_per_s"][1] > 0.0
    assert frame["front_speed_uncertainty_per_s"].isna().all()
    bar = np.full(CROSSED.n_contact, 0.25 * residence_time(CROSSED, run)[1])
    half = replace(run, uncertainty=replace(run.uncertainty, crossing_time=bar))
    frame = observables(CROSSED, half).to_pandas()
    # a residence time that may be half as long has a speed that may be twice as much
    assert frame["front_speed_uncertainty_per_s"][1] == pytest.approx(frame["front_speed_per_s"][1], rel=1e-14)


def test_without_spacing_there_is_no_speed_in_metres_and_it_is_said() -> None:
    table = db.table_of(PAIR, "observables")
    assert table.to_pandas()["wave_speed_m_per_s"].isna().all()
    assert "the scene has no spacing: the speed of the front is known in bodies per second only" in table.notes


def test_binary_collisions_have_no_bars() -> None:
    table = db.table_of(CROSSED, "observables", backend="bca")
    frame = table.to_pandas()
    assert frame["arrival_s"].notna().tolist() == [False, True, True, True]
    assert frame["arrival_uncertainty_s"].isna().all()
    assert any("empty uncertainties are unknown" in note for note in table.notes)


def test_what_is_of_the_whole_chain_or_of_samples_stands_in_the_notes(solved: Solve) -> None:
    run = solved(CROSSED, "reference")
    notes = {note.split(":")[0]: note for note in db.table_of(CROSSED, "observables").notes}
    assert notes["arrival at end"].startswith(f"arrival at end: {run.crossing_time[2]:.6g} s (uncertainty ")
    momentum = CROSSED.mass[0] * CROSSED.velocity[0]
    assert notes["momentum"].startswith(f"momentum: largest magnitude at samples, {momentum:.6g} kg m/s (uncertainty ")
    theory = [note.split(":")[0] for note in db.table_of(CROSSED, "observables", backend="bca").notes]
    assert theory[1:] == list(notes)[1:]  # all but who made the run


def test_every_registered_observable_has_a_column_or_a_note() -> None:
    table = db.table_of(CROSSED, "observables")
    there = {column.quantity for column in table.columns}
    there |= {note.split(":")[0].replace(" ", "_") for note in table.notes}
    assert set(OBSERVABLES) - there == {"crossing_time"}  # which is the arrival at the body behind


def test_the_largest_of_samples_has_the_uncertainty_of_its_own_place() -> None:
    run = db.solve(CROSSED, backend="verlet", dt=4e-7)
    force, uncertainty = (
        part(CROSSED, run) for part in (OBSERVABLES["contact_force"].value, OBSERVABLES["contact_force"].uncertainty)
    )
    place = np.unravel_index(np.argmax(force), force.shape)
    # at the start nothing is compressed, and hardly anything is uncertain
    assert uncertainty[0, 0] < 0.1 * uncertainty[place]
    notes = db.table_of(CROSSED, "observables", backend="verlet", dt=4e-7).notes
    expected = (
        f"contact force: largest magnitude at samples, {force[place]:.6g} N (uncertainty {uncertainty[place]:.1e} N)"
    )
    assert expected in notes
