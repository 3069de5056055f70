"""A run as tables of pandas and as figures."""

from __future__ import annotations

import numpy as np
import pytest

import dem_bridge as db
from tests.helpers.fake_runs import CHAIN


@pytest.fixture(scope="module")
def run() -> db.Trajectory:
    from dem_bridge.scene.file import parse_scene

    return db.solve(parse_scene(CHAIN), backend="verlet", uncertainty=False)


def test_the_tables_have_every_sample_at_its_place(run: db.Trajectory) -> None:
    bodies = run.to_pandas().pivot(index="time_s", columns="body", values="velocity_m_per_s")
    np.testing.assert_array_equal(bodies.to_numpy(), run.velocity)
    np.testing.assert_array_equal(bodies.index, run.time)
    shifts = run.to_pandas("bodies").pivot(index="time_s", columns="body", values="displacement_m")
    np.testing.assert_array_equal(shifts.to_numpy(), run.displacement)
    contacts = run.to_pandas("contacts")
    forces = contacts.pivot(index="time_s", columns="contact", values="force_N")
    np.testing.assert_array_equal(forces.to_numpy(), run.contact_force)
    first = contacts.groupby("contact").first()
    np.testing.assert_array_equal(first.peak_force_N, run.peak_force)
    np.testing.assert_array_equal(first.crossing_time_s, run.crossing_time)


def test_a_run_is_drawn_by_the_functions_of_plot(run: db.Trajectory) -> None:
    assert run.plot().get_xlabel() == db.plot.spacetime(run).get_xlabel() == "body"
    ax = run.plot("velocity", bodies=[1])
    assert [line.get_label() for line in ax.get_lines()] == ["body 1"]
    assert run.plot("velocity", ax) is ax


def test_other_tables_and_figures_are_refused(run: db.Trajectory) -> None:
    with pytest.raises(db.errors.UsageError, match="table = 'forces'; allowed: 'bodies' or 'contacts'"):
        run.to_pandas("forces")
    with pytest.raises(db.errors.UsageError, match="figure = 'budget'; allowed: 'spacetime', 'velocity', 'residence'"):
        run.plot("budget")
