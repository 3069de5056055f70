"""The table of what runs along the chain: the front as each body sees it, with error bars."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dem_bridge.exports.parameters import origin
from dem_bridge.exports.table import Column, Table, counts, numbers, with_uncertainty
from dem_bridge.observables.front import (
    arrival_by_crossing,
    grain_speed_by_crossing,
    peak_velocity_of_front,
    residence_bar,
    residence_by_crossing,
)
from dem_bridge.scene import Scene
from dem_bridge.trajectory import Trajectory

Floats = NDArray[np.float64]


def observables(scene: Scene, run: Trajectory) -> Table:
    """Body by body: arrival, residence, speed of the front, largest velocity in it, force that came with it."""
    links = scene.n_body - 1
    arrival_bar = np.asarray(run.uncertainty["crossing_time"])[:links]
    residence, bar = residence_by_crossing(scene, run), residence_bar(scene, run)
    speed = grain_speed_by_crossing(scene, run)
    peak = peak_velocity_of_front(scene, run)
    # bodies that have no residence time: the first, which brings the impulse, and the last, which hands it to none
    ends = (1, int(links > 0))
    notes = [
        f"found by {run.provenance['backend']}",
        "arrival: first maximal compression of the contact on the struck side; residence: from that to the same of the"
        " contact behind (Chaunsali, Kim & Yang 2018, section 4a); the last body has none",
        "peak velocity: the largest until the body hands the impulse on",
        "peak force: of the contact on the struck side, the largest of the whole run",
    ]
    # speed is the inverse of the residence time, of which a bar as long as itself leaves nothing
    left = residence - bar
    relative = np.divide(bar, left, out=np.full(len(bar), np.inf), where=left > 0.0)
    columns: list[Column] = [
        counts("body", "body", range(scene.n_body)),
        *with_uncertainty(
            "arrival", "arrival", "s", _placed(arrival_by_crossing(scene, run), (1, 0)), _placed(arrival_bar, (1, 0))
        ),
        *with_uncertainty("residence", "residence time", "s", _placed(residence, ends), _placed(bar, ends)),
        *with_uncertainty(
            "front_speed", "speed in bodies", "1/s", _placed(speed, ends), _placed(speed * relative, ends)
        ),
    ]
    spacing = scene.spacing
    if spacing is None:
        notes.append("the scene has no spacing: wave speeds are known in bodies per second alone")
        spacing = np.nan
    metres = spacing * speed
    columns += with_uncertainty(
        "wave_speed", "wave speed", "m/s", _placed(metres, ends), _placed(metres * relative, ends)
    )
    columns += with_uncertainty("peak_velocity", "peak velocity", "m/s", peak.velocity, peak.bar)
    columns.append(numbers("peak_velocity_time", "time of peak velocity", "s", peak.time))
    force, force_bar = run.peak_force[:links], np.asarray(run.uncertainty["peak_force"])[:links]
    columns += with_uncertainty("peak_force", "peak force", "N", _placed(force, (1, 0)), _placed(force_bar, (1, 0)))
    if not np.all(np.isfinite(arrival_bar)):
        notes.append("bars that are empty are not known")
    return Table(
        id="observables",
        title=f"The front along {scene.name}",
        columns=tuple(columns),
        notes=tuple(notes),
        provenance=origin(scene, run),
    )


def _placed(values: Floats, around: tuple[int, int]) -> Floats:
    """Among all bodies; nan before and behind."""
    return np.pad(np.asarray(values, dtype=float), around, constant_values=np.nan)
