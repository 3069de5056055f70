"""Read runs of other programs as trajectories: complete files of any format, checked against their scene.

A trajectory is built on the record of the file. Quantities that a file does not contain stay unknown: velocities are
not computed by finite differences, crossing times are nan, and uncertainties are inf. ``provenance["assumed"]`` lists
the assumptions. The number and order of the bodies, their masses and their initial velocities are checked against the
scene.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.formats.readers.column_meaning import Choices
from dem_bridge.formats.readers.columns_to_record import draft_of_table
from dem_bridge.formats.readers.dumps import Frames
from dem_bridge.formats.readers.frames_to_record import axis_of, draft_of_frames, style_of
from dem_bridge.formats.readers.read import damage_as_usage_error, load, series
from dem_bridge.formats.readers.record import Record
from dem_bridge.formats.readers.rounding import rounding_error
from dem_bridge.formats.units import STYLES
from dem_bridge.observables.interpolate import KNOWN_FORCES
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Cost, Floats, Trajectory
from dem_bridge.version import __version__

#: tolerance of initial velocities and masses, relative to the largest: permits few digits, but no other unit
START_WITHIN = 1e-4
#: largest motion across the chain, relative to the motion along it, that counts as round-off
ACROSS = 1e-6
#: a file is complete if its last time is before the scene's duration by at most this part of the duration
ENDS_WITHIN = 1e-6


@dataclass
class _Samples:
    """Hold the samples of a file in SI units, from which a Trajectory is built."""

    record: Record
    contact_force: Floats | None
    """Contact forces, ``(n_t, n_contact)``; None if they are unknown."""
    digits: dict[str, float | None]
    """Rounding error of positions and velocities; None where all digits are in the file."""
    assumed: list[str] = field(default_factory=list)
    """Assumptions, as sentences."""
    units: str = "si"

    @property
    def time(self) -> Floats:
        """Times, s, ``(n_t,)``."""
        return self.record.time

    @property
    def velocity(self) -> Floats | None:
        """Velocities, ``(n_t, n_body)``; None if the file has none."""
        return self.record.values.get("velocity")


def read(path: Path, scene: Scene, format: str, *, units: str | None = None, dt: float | None = None) -> Trajectory:
    """Read a complete run of ``scene`` from a file, whose format follows from its content.

    ``units`` is the unit style of a file that does not name one (None is "ase" for ASE trajectories, the style that
    gives the masses of the scene, or "si"). ``dt`` is the time step in s of a file with step numbers and no times, or
    the time between frames of a file with neither. Raises UsageError for a missing atom or frame, another number of
    bodies, unknown units, and initial velocities or masses that are not those of the scene.
    """
    choices = Choices(dt=dt, units=units)
    with damage_as_usage_error(path):
        contents, default = load(path, choices)
        if isinstance(contents, Frames):
            samples = _samples_of_frames(path.name, contents, scene, choices, default)
        else:
            draft = draft_of_table(path.name, contents, scene, choices)
            if draft.lost:
                raise UsageError(f"{draft.lost}; allowed: a complete run; dem-bridge judge takes gaps")
            record = draft.record(scene)
            if draft.positions is not None:
                _check_order(draft.positions, np.arange(draft.positions.shape[1]))
            samples = _Samples(record, record.values.get("contact_force"), {}, list(record.recognised))
        _check_complete(samples, scene)
        _check_times(samples.time)
        _check_start(samples, scene)
        if samples.time[-1] < scene.duration * (1.0 - ENDS_WITHIN):
            samples.assumed.append(f"the file ends at {samples.time[-1]:.6g} s, the scene at {scene.duration:.6g} s")
        return _trajectory(path, samples, scene, format)


def _samples_of_frames(name: str, frames: Frames, scene: Scene, choices: Choices, default: str) -> _Samples:
    """Return the samples of frames: motion along the chain's axis and contact forces."""
    style = style_of(frames, scene, choices, default, [])
    si = STYLES[style]
    _check_finite("positions", frames.position)
    bodies, with_walls = _bodies(frames, scene)
    axis = _axis(frames, bodies, axis_of(frames, choices))
    along = frames.position[:, :, axis]
    _check_order(along[:, bodies], frames.ids[bodies])
    _check_mass(frames, bodies, scene, si.mass)
    record = draft_of_frames(name, frames, scene, choices, default).record(scene)
    assumed = list(record.recognised)
    contact = record.values.get("contact_force")
    if contact is None and "force" in frames.columns:
        contact = _from_net(frames.columns["force"][:, :, axis] * si.force, record.time, scene, with_walls)
        if contact is not None:
            assumed.append(
                "contact forces are the running sum of net forces minus weight, precompression force and drive"
            )
    return _Samples(record, contact, {"position": rounding_error(along, si.length)}, assumed, style)


def _check_complete(samples: _Samples, scene: Scene) -> None:
    """Raise UsageError unless the record has displacements or velocities of all bodies; add the rounding errors."""
    record = samples.record
    if "displacement" not in record.values and "velocity" not in record.values:
        raise UsageError("the file has neither displacements nor positions nor velocities; add one of them")
    for quantity, columns in record.columns.items():
        kind, count = ("contacts", scene.n_contact) if quantity == "contact_force" else ("bodies", scene.n_body)
        if columns != tuple(range(count)):
            raise UsageError(
                f"the columns of {quantity} are of {len(columns)} {kind}, the scene {scene.name} has {count}; allowed:"
                " all, in their order; dem-bridge judge takes some of them"
            )
    if "displacement" in record.values:
        samples.digits.setdefault("position", rounding_error(record.values["displacement"]))
    if "velocity" in record.values:
        samples.digits["velocity"] = rounding_error(record.values["velocity"])


def _check_finite(name: str, values: Floats) -> None:
    """Raise UsageError unless all values are finite."""
    if len(wrong := np.argwhere(~np.isfinite(values))):
        raise UsageError(f"frame {wrong[0, 0]} has {name} that are not finite; allowed: finite numbers")


def _bodies(frames: Frames, scene: Scene) -> tuple[slice, bool]:
    """Return which atoms are bodies, and True if the scene's walls are atoms at the ends, as in our decks."""
    walls = scene.n_contact - (scene.n_body - 1)
    atoms = len(frames.ids)
    if atoms == scene.n_body:
        return slice(0, atoms), walls == 0
    if atoms == scene.n_body + walls:
        first = int(scene.wall_left is not None)
        return slice(first, first + scene.n_body), True
    and_walls = f", or {scene.n_body + walls} atoms with its walls" if walls else ""
    raise UsageError(
        f"the file has {atoms} atoms per frame, the scene {scene.name} has {scene.n_body} bodies{and_walls};"
        " give the scene of this run, and a file with all bodies"
    )


def _axis(frames: Frames, bodies: slice, axis: int) -> int:
    """Return the axis along which the bodies lie (0, 1 or 2); raise UsageError if they leave the line."""
    start = frames.position[0, bodies]
    flight = np.max(np.abs(frames.position[:, bodies] - start), axis=(0, 1))
    across = float(np.max(np.delete(flight, axis)))
    if across > ACROSS * float(flight[axis]) and across > 0.0:
        raise UsageError(
            f"bodies move by {across:g} across the chain and by {flight[axis]:g} along it (axis"
            f" {'xyz'[axis]}); allowed: motion along one line"
        )
    return axis


def _check_order(along: Floats, ids: NDArray[np.int64]) -> None:
    """Raise UsageError unless the positions increase with the ids in every frame."""
    wrong = np.argwhere(np.diff(along, axis=1) <= 0.0)
    if len(wrong):
        frame, k = wrong[0].tolist()
        raise UsageError(
            f"in frame {frame} atom {ids[k]} is at {along[frame, k]:.9g} and atom {ids[k + 1]} at"
            f" {along[frame, k + 1]:.9g}; allowed: positions that increase with the id, body 0 first"
        )


def _check_mass(frames: Frames, bodies: slice, scene: Scene, unit: float) -> None:
    """Raise UsageError unless the masses in the file, if any, are those of the scene."""
    if "mass" not in frames.columns:
        return
    mass = frames.columns["mass"][0, bodies] * unit
    off = np.abs(mass - scene.mass) > START_WITHIN * np.array(scene.mass)
    if np.any(off):
        k = int(np.argmax(off))
        raise UsageError(
            f"atom {frames.ids[bodies][k]} has a mass of {mass[k]:.6g} kg, body {k} of {scene.name} has"
            f" {scene.mass[k]:.6g} kg; give the scene of this run, or the units of the file"
        )


def _from_net(net: Floats, time: Floats, scene: Scene, with_walls: bool) -> Floats | None:
    """Return contact forces from the net force on each atom at each time; None if they do not follow from it."""
    left, right = scene.wall_left is not None, scene.wall_right is not None
    if scene.drag > 0.0 or not KNOWN_FORCES.covers(scene) or (left and right and not with_walls):
        return None
    outer = np.tile(scene.steady_force, (len(time), 1))
    if scene.piston is not None:
        # nothing is known of the forces on body 0: the sum starts at the other end
        return None if right else np.cumsum((net - outer)[:, :0:-1], axis=1)[:, ::-1]
    if scene.driving_force is not None:
        outer[:, 0] += scene.driving_force.at(time)
    if with_walls:
        outer = np.pad(outer, ((0, 0), (int(left), int(right))))
    # force of the contact on each atom's right side; the sum starts at an end without a contact
    if left and not with_walls:
        behind = np.cumsum((outer - net)[:, ::-1], axis=1)[:, ::-1]
        return np.hstack([-behind[:, 1:], -behind[:, :1]])
    behind = np.cumsum(outer - net, axis=1)
    if not with_walls:
        return behind if right else behind[:, :-1]
    chain = behind[:, int(left) : int(left) + scene.n_body - 1]
    walls = [behind[:, :1]] * left + [behind[:, -2:-1]] * right
    return np.hstack([chain, *walls])


def _check_times(time: Floats) -> None:
    """Raise UsageError unless the times, which increase, begin at 0 and no frame is missing."""
    steps = np.diff(time)
    if time[0] != 0.0:
        raise UsageError(f"the file begins at {time[0]:g} s; allowed: the start of the scene, 0 s")
    if len(steps) < 3:
        return
    # frames are missing if nearly all intervals are equal and a few are longer
    usual = float(np.median(steps))
    far = np.flatnonzero(steps > 1.5 * usual)
    if 0 < len(far) <= max(1, len(steps) // 10) and np.all(np.delete(steps, far) > 0.5 * usual):
        k = int(far[0])
        raise UsageError(
            f"frame {k} is at {time[k]:.9g} s and the next frame at {time[k + 1]:.9g} s, which is"
            f" {steps[k] / usual:.3g} times the usual interval, so a frame is missing; give a file with all frames"
        )


def _check_start(samples: _Samples, scene: Scene) -> None:
    """Raise UsageError unless the velocities of the first frame are the initial velocities of the scene."""
    start = np.array(scene.velocity)
    if samples.velocity is None:
        samples.assumed.append("units and initial velocities are not checked, because the file has no velocities")
        return
    _check_finite("velocities", samples.velocity)
    off = np.abs(samples.velocity[0] - start)
    scale = float(max(np.max(np.abs(start)), np.max(np.abs(samples.velocity))))
    if np.max(off) > START_WITHIN * scale:
        k = int(np.argmax(off))
        ratio = f" (the ratio is {samples.velocity[0, k] / start[k]:.6g})" if start[k] else ""
        raise UsageError(
            f"body {k} starts at {samples.velocity[0, k]:.6g} m/s, in the scene {scene.name} at"
            f" {start[k]:.6g} m/s{ratio}; give the scene of this run, a file that begins at its start, and the right"
            f" units (now {samples.units})"
        )


def _hash(path: Path) -> str:
    """Return the sha256 of a file, or of the files of a folder or pattern one after the other."""
    digest = hashlib.sha256()
    for file in series(path):
        digest.update(file.read_bytes())
    return digest.hexdigest()


def _trajectory(path: Path, samples: _Samples, scene: Scene, format: str) -> Trajectory:
    """Return the trajectory of the samples, with the file and the assumptions in its provenance."""
    n_t = len(samples.time)
    force = samples.contact_force
    if force is None or not np.all(np.isfinite(force)):
        force = np.full((n_t, scene.n_contact), math.nan)
        samples.assumed.append("contact forces are unknown")
    else:
        samples.assumed.append("peak forces are the largest of the samples")
    for name, error in samples.digits.items():
        if error is not None:
            unit = "m" if name == "position" else "m/s"
            samples.assumed.append(f"{name} has few digits: its rounding error is up to {error:.2g} {unit}")
    unknown = np.full((n_t, scene.n_body), math.nan)
    return Trajectory(
        time=samples.time,
        displacement=samples.record.values.get("displacement", unknown),
        velocity=unknown if samples.velocity is None else samples.velocity,
        contact_force=force,
        peak_force=np.max(force, axis=0),
        crossing_time=np.full(scene.n_contact, math.nan),
        cost=Cost(wall=math.nan, cpu=math.nan, steps=0, force_evaluations=0),
        provenance={
            "backend": "file",
            "scene": scene.name,
            "scene_hash": scene.content_hash,
            "settings": {"format": format, "units": samples.units},
            "versions": {"dem-bridge": __version__},
            "file": {"name": path.name, "sha256": _hash(path)},
            "resolution": dict(samples.digits),
            "peaks": "samples",
            "assumed": list(samples.assumed),
        },
    )
