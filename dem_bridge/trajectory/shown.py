"""A run as a table of pandas, as a figure, and as a picture in a notebook. Nothing is computed here."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dem_bridge.errors import UsageError
from dem_bridge.foundation.notebook import picture
from dem_bridge.foundation.presenters import FIGURES_OF_RUNS, presenter
from dem_bridge.trajectory.trajectory import Trajectory

if TYPE_CHECKING:
    from pandas import DataFrame

#: tables of a run, and figures of it: functions of :mod:`dem_bridge.plot`, which the facade declares
TABLES, FIGURES = ("bodies", "contacts"), ("spacetime", "velocity", "residence")


def table_of_run(run: Trajectory, table: str) -> DataFrame:
    """Return a table of a run; see :meth:`Trajectory.to_pandas`."""
    from pandas import DataFrame

    if table not in TABLES:
        raise UsageError(f"table = {table!r}; allowed: {' or '.join(map(repr, TABLES))}")
    times, bodies, contacts = len(run.time), run.velocity.shape[1], len(run.peak_force)
    if table == "bodies":
        return DataFrame(
            {
                "time_s": np.repeat(run.time, bodies),
                "body": np.tile(np.arange(bodies), times),
                "displacement_m": run.displacement.ravel(),
                "velocity_m_per_s": run.velocity.ravel(),
            }
        )
    return DataFrame(
        {
            "time_s": np.repeat(run.time, contacts),
            "contact": np.tile(np.arange(contacts), times),
            "force_N": run.contact_force.ravel(),
            "peak_force_N": np.tile(run.peak_force, times),
            "crossing_time_s": np.tile(run.crossing_time, times),
        }
    )


def plot_run(run: Trajectory, figure: str, ax: Any, settings: dict[str, Any]) -> Any:
    """Draw a figure of a run; see :meth:`Trajectory.plot`."""
    if figure not in FIGURES:
        raise UsageError(f"figure = {figure!r}; allowed: {', '.join(map(repr, FIGURES))}")
    return getattr(presenter(FIGURES_OF_RUNS), figure)(run, ax=ax, **settings)


def picture_of_run(run: Trajectory) -> str:
    """Return the HTML of the space-time figure of a run; empty where there is no motion to draw."""
    if run.velocity.shape[1] < 2 or len(run.time) < 2 or not np.isfinite(run.velocity).all() or not run.velocity.any():
        return ""
    ax = plot_run(run, "spacetime", None, {})
    return picture(ax.figure, f"velocity of each body against time, {run.provenance.get('scene', 'a chain')}")
