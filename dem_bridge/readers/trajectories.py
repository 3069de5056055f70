"""Read runs of other programs as trajectories: dumps, extended XYZ, ASE trajectories and CSV.

Quantities that a file does not contain stay unknown: velocities are not computed by finite differences, crossing times
are nan, and uncertainties are inf. ``provenance["assumed"]`` lists the assumptions. The number and order of the bodies,
their masses and their initial velocities are checked against the scene.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.observables.interpolate import KNOWN_FORCES
from dem_bridge.readers.assemble import from_sides
from dem_bridge.readers.digits import rounding_error
from dem_bridge.readers.frames import Frames, read_ase, read_csv, read_dump
from dem_bridge.readers.headings import DATA
from dem_bridge.scene import Scene
from dem_bridge.trajectory import Cost, Floats, Trajectory
from dem_bridge.version import __version__

#: tolerance of initial velocities and masses, relative to the largest: permits few digits, but no other unit
START_WITHIN = 1e-4
#: largest motion across the chain, relative to the motion along it, that counts as round-off
ACROSS = 1e-6
#: a file is complete if its last time is before the scene's duration by at most this part of the duration
ENDS_WITHIN = 1e-6


@dataclass(frozen=True)
class Units:
    """Hold the SI values of the units of a unit style: m, s, m/s, N, kg."""

    length: float
    time: float
    velocity: float
    force: float
    mass: float


#: the unit styles of LAMMPS (manual, command units), and "ase": Å, eV, u and the unit of time that follows; CODATA 2018
UNITS = {style: Units(**values) for style, values in DATA["unit_styles"].items()}


@dataclass
class _Samples:
    """Hold the samples of a file in SI units, from which a Trajectory is built."""

    time: Floats
    """Times, ``(n_t,)``."""
    displacement: Floats
    """Displacements, ``(n_t, n_body)``."""
    velocity: Floats | None
    """Velocities, ``(n_t, n_body)``; None if the file has none."""
    contact_force: Floats | None
    """Contact forces, ``(n_t, n_contact)``; None if they are unknown."""
    digits: dict[str, float | None]
    """Rounding error of positions and velocities; None where all digits are in the file."""
    assumed: list[str] = field(default_factory=list)
    """Assumptions, as sentences."""
    units: str = "si"


def read(path: Path, scene: Scene, format: str, *, units: str | None = None, dt: float | None = None) -> Trajectory:
    """Read a run of ``scene`` from a file of the format "extxyz", "lammpstrj", "traj" or "csv".

    ``units`` is the unit style of a file that does not name one (see :data:`UNITS`; None is "ase" for "traj" and "si"
    for others). ``dt`` is the time step in s of a file with step numbers and no times, or the time between frames of a
    file with neither. Raises UsageError for a missing atom or frame, another number of bodies, unknown units, and
    initial velocities or masses that are not those of the scene.
    """
    if units is not None and units not in UNITS:
        raise UsageError(f"units = {units!r} is unknown; allowed: {', '.join(UNITS)}")
    if dt is not None and not 0.0 < dt < math.inf:
        raise UsageError(f"dt = {dt!r}; allowed: a number above 0 (s)")
    if not path.is_file():
        raise UsageError(
            f"{path}: there is no such file; allowed: a LAMMPS dump, extended XYZ, an ASE trajectory or CSV"
        )
    try:
        if format == "csv":
            if units not in (None, "si") or dt is not None:
                raise UsageError("units and dt do not apply to CSV, whose headings have units; leave them out")
            samples = _samples_of_table(*read_csv(path), scene)
        else:
            frames = read_dump(path) if format == "lammpstrj" else read_ase(path, format)
            samples = _samples_of_frames(frames, scene, units, dt, "ase" if format == "traj" else "si")
        _check_times(samples.time)
        _check_start(samples, scene)
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from error
    if samples.time[-1] < scene.duration * (1.0 - ENDS_WITHIN):
        samples.assumed.append(f"the file ends at {samples.time[-1]:.6g} s, the scene at {scene.duration:.6g} s")
    return _trajectory(path, samples, scene, format)


def _samples_of_frames(
    frames: Frames, scene: Scene, units: str | None, dt: float | None, default_units: str
) -> _Samples:
    """Return the samples of frames: motion along the chain's axis and contact forces."""
    style, assumed = _units(frames.units, units, default_units)
    si = UNITS[style]
    _check_finite("positions", frames.position)
    bodies, with_walls = _bodies(frames, scene)
    axis = _axis(frames, bodies)
    if axis != 0:
        assumed.append(f"the chain lies along {'xyz'[axis]}")
    along = frames.position[:, :, axis]
    _check_order(along[:, bodies], frames.ids[bodies])
    if frames.time is not None:
        time = frames.time * si.time
        if dt is not None:
            raise UsageError(f"dt = {dt!r} was given, but the file has times; leave dt out")
    elif dt is not None and frames.step is not None:
        time = frames.step * dt
        assumed.append(f"the time step (without step numbers: the time between frames) is {dt!r} s")
    else:
        raise UsageError("the file has step or frame numbers but no times; give the time step in seconds, dt (--dt)")
    columns = frames.columns
    vectors = columns.get("velocity")
    velocity = None if vectors is None else vectors[:, bodies, axis] * si.velocity
    _check_mass(columns, frames.ids, bodies, scene, si)
    if "displacement" in columns:
        displacement = columns["displacement"][:, bodies] * si.length
    else:
        displacement = (along[:, bodies] - along[0, bodies]) * si.length
        assumed.append("displacements are relative to the first frame")
    digits = {"position": rounding_error(along, si.length)}
    if velocity is not None:
        digits["velocity"] = rounding_error(velocity)
    contact = None
    if "force_left" in columns and "force_right" in columns:
        left, right = (columns[name][:, bodies] * si.force for name in ("force_left", "force_right"))
        contact = from_sides(left, right, scene)
    elif "force" in columns:
        contact = _from_net(columns["force"][:, :, axis] * si.force, time, scene, with_walls)
        if contact is not None:
            assumed.append(
                "contact forces are the running sum of net forces minus weight, precompression force and drive"
            )
    return _Samples(time, displacement, velocity, contact, digits, assumed, style)


def _check_finite(name: str, values: Floats) -> None:
    """Raise UsageError unless all values are finite."""
    if len(wrong := np.argwhere(~np.isfinite(values))):
        raise UsageError(f"frame {wrong[0, 0]} has {name} that are not finite; allowed: finite numbers")


def _units(in_file: str | None, argument: str | None, default: str) -> tuple[str, list[str]]:
    """Return the unit style, and the assumption about it if the file names none."""
    if in_file is not None and argument is not None and in_file != argument:
        raise UsageError(f"units = {argument!r} was given, but the file has {in_file!r}; leave units out")
    style = in_file or argument or default
    if style not in UNITS:
        raise UsageError(f"the file has units {style!r}, whose SI values are unknown; allowed: {', '.join(UNITS)}")
    return style, [] if in_file else [f"units are {style}, because the file does not state them"]


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


def _axis(frames: Frames, bodies: slice) -> int:
    """Return the axis along which the bodies lie (0, 1 or 2); raise UsageError if they leave the line."""
    start = frames.position[0, bodies]
    axis = int(np.argmax(np.ptp(start, axis=0)))
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


def _check_mass(columns: Any, ids: NDArray[np.int64], bodies: slice, scene: Scene, si: Units) -> None:
    """Raise UsageError unless the masses in the file, if any, are those of the scene."""
    if "mass" not in columns:
        return
    mass = columns["mass"][0, bodies] * si.mass
    off = np.abs(mass - scene.mass) > START_WITHIN * np.array(scene.mass)
    if np.any(off):
        k = int(np.argmax(off))
        raise UsageError(
            f"atom {ids[bodies][k]} has a mass of {mass[k]:.6g} kg, body {k} of {scene.name} has"
            f" {scene.mass[k]:.6g} kg; give the scene of this run, or the units of the file"
        )


def _from_net(net: Floats, time: Floats, scene: Scene, with_walls: bool) -> Floats | None:
    """Return contact forces from the net force on each atom at each time; None if they do not follow from it."""
    left, right = scene.wall_left is not None, scene.wall_right is not None
    if scene.drag > 0.0 or not KNOWN_FORCES.covers(scene) or (left and right and not with_walls):
        return None
    outer = np.tile(scene.steady_force, (len(time), 1))
    if scene.drive is not None:
        outer[:, 0] += scene.drive.at(time)
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


def _samples_of_table(time: Floats, columns: dict[str, Floats], scene: Scene) -> _Samples:
    """Return the samples of a CSV file."""
    assumed = []
    for name, values in columns.items():
        kind, count = ("contacts", scene.n_contact) if name == "contact_force" else ("bodies", scene.n_body)
        if (width := values.shape[1]) != count:
            raise UsageError(
                f"the columns of {name} are of {width} {kind}, the scene {scene.name} has {count}; all are needed"
            )
    if "displacement" in columns:
        displacement = columns["displacement"]
    elif "x" in columns:
        displacement = columns["x"] - columns["x"][0]
        assumed.append("displacements are relative to the first time")
    else:
        raise UsageError("the file has neither displacements nor positions; add a column displacement_m or x_m")
    if "x" in columns:
        _check_order(columns["x"], np.arange(scene.n_body))
    contact = columns.get("contact_force")
    if contact is None and "force_left" in columns and "force_right" in columns:
        contact = from_sides(columns["force_left"], columns["force_right"], scene)
    digits = {"position": rounding_error(columns.get("x", displacement))}
    if "velocity" in columns:
        digits["velocity"] = rounding_error(columns["velocity"])
    return _Samples(time, displacement, columns.get("velocity"), contact, digits, assumed)


def _check_times(time: Floats) -> None:
    """Raise UsageError unless times increase from 0 and no frame is missing."""
    steps = np.diff(time)
    if not np.all(np.isfinite(time)) or np.any(steps <= 0.0):
        where = int(np.argmax(~(steps > 0.0)))
        raise UsageError(f"frame {where + 1} is not later than frame {where}; allowed: increasing times")
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
    return Trajectory(
        time=samples.time,
        displacement=samples.displacement,
        velocity=np.full((n_t, scene.n_body), math.nan) if samples.velocity is None else samples.velocity,
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
            "file": {"name": path.name, "sha256": hashlib.sha256(path.read_bytes()).hexdigest()},
            "resolution": dict(samples.digits),
            "peaks": "samples",
            "assumed": list(samples.assumed),
        },
    )
