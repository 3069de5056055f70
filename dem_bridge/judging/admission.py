"""Which samples of a file can be judged: those of the scene's time, finite, and in a unit of time that fits it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dem_bridge.errors import UsageError
from dem_bridge.formats.readers import Record
from dem_bridge.scene.scene import Scene

#: multiple of the scene's duration beyond which a scene that stays together (walls, load, drive) is not continued
MOST_DURATIONS_CONTINUED = 20.0
#: largest value of a run that has not failed, in SI units
LARGEST_VALUE_SI = 1e100
#: most values of a quantity of a file that are judged; of larger files every second, third ... sample is taken
MOST_VALUES_OF_QUANTITY = 2_000_000


def check_steps(records: Sequence[Record]) -> None:
    """Raise UsageError if only some of several files have a time step."""
    without = [record.name for record in records if record.dt is None]
    if without and len(without) < len(records):
        raise UsageError(
            f"{without[0]} has no time step, but another file has one; give the time step in seconds: {without[0]}@DT"
        )


def usable(record: Record, scene: Scene) -> tuple[Record, list[str]]:
    """Return the samples that can be judged, and what was left out; raise UsageError for unusable values."""
    time, notes = record.time, []
    if not any(values.size for values in record.values.values()):
        raise UsageError(
            f"{record.name} has no velocities, displacements or contact forces; give a file with at least one of them"
        )
    if before := int(np.count_nonzero(time + record.rounding["time"] < 0.0)):
        notes.append(f"{record.name}: {before} samples before the start of the scene, 0 s, are not judged.")
        record = _rows(record, slice(before, None))
    end = MOST_DURATIONS_CONTINUED * scene.duration
    if _stays_together(scene) and (late := int(np.count_nonzero(record.time > end))):
        notes.append(
            f"{record.name}: {late} samples after {end:.6g} s, {MOST_DURATIONS_CONTINUED:g} times the scene,"
            " are not judged."
        )
        record = _rows(record, slice(len(record.time) - late))
        if len(record.time) < 2:
            raise UsageError(
                f"{record.name} goes to {time[-1]:.6g} s, and the scene to {scene.duration:.6g} s; allowed: samples up"
                f" to {end:.6g} s; give the unit of time (--units time=ms), or a scene of this duration"
            )
    interval = float(np.max(np.diff(time), initial=0.0))
    if record.dt is not None and interval < 0.99 * record.dt:
        notes.append(f"{record.name}: the step, {record.dt:.6g} s, is longer than the sampling, {interval:.6g} s.")
    widest = max(values.shape[1] for values in record.values.values())
    if (every := -(-len(record.time) * widest // MOST_VALUES_OF_QUANTITY)) > 1:
        notes.append(f"{record.name}: {every_nth(every)} of {len(record.time)} samples is judged.")
        record = _rows(record, slice(None, None, every))
    if not len(record.time) or record.time[-1] <= 0.0:
        raise UsageError(
            f"{record.name} has no sample after 0 s, the start of the scene; give a file with later samples"
        )
    if len(record.time) < 2:
        raise UsageError(f"{record.name} has a single sample; allowed: two or more samples at increasing times")
    for name, values in record.values.items():
        if len(wrong := np.argwhere(~(np.abs(values) < LARGEST_VALUE_SI))):
            row, column = wrong[0].tolist()
            axis = "contact" if name == "contact_force" else "body"
            raise UsageError(
                f"{record.name} has {len(wrong)} values of {name.replace('_', ' ')} that are not finite or above"
                f" {LARGEST_VALUE_SI:g}, the first at {record.time[row]:.6g} s, {axis} {record.columns[name][column]};"
                " remove these samples, or run the code again with a smaller time step"
            )
    return record, notes


def every_nth(count: int) -> str:
    """Return which samples are taken, in words.

    >>> every_nth(2), every_nth(3), every_nth(21)
    ('every second', 'every third', 'every 21st')
    """
    if count < 4:
        return f"every {('', 'single', 'second', 'third')[count]}"
    last = count % 10
    ending = "stndrd"[2 * last - 2 : 2 * last] if 1 <= last <= 3 and not 10 < count % 100 < 14 else "th"
    return f"every {count}{ending}"


def units_of_time(scene: Scene, records: Sequence[Record]) -> list[float]:
    """Return the units of time, s, in which files would end with the scene whose times go far beyond it."""
    end = max((float(record.time[-1]) for record in records if len(record.time)), default=0.0)
    if not MOST_DURATIONS_CONTINUED * scene.duration < end < math.inf:
        return []
    return [unit for unit in (1e-3, 1e-6, 1e-9) if 0.3 < end * unit / scene.duration < 3.0]


def in_unit(record: Record, unit: float) -> Record:
    """Return a record whose times are in a unit, s."""
    rounding = dict(record.rounding) | {"time": unit * record.rounding["time"]}
    return replace(record, time=unit * record.time, rounding=rounding)


def _stays_together(scene: Scene) -> bool:
    """Return True if bodies may collide again and again, so that the reference takes long for late times."""
    parts = (scene.wall_left, scene.wall_right, scene.drive, scene.adhesion)
    return scene.precompression > 0.0 or any(part is not None for part in parts)


def _rows(record: Record, rows: slice) -> Record:
    """Return a record with some of its samples."""
    return replace(
        record,
        time=record.time[rows],
        values={name: values[rows] for name, values in record.values.items()},
        rounding={name: values[rows] for name, values in record.rounding.items()},
    )
