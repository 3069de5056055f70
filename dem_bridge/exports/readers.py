"""Runs of others as trajectories: dumps, extended XYZ, ASE's trajectories and CSV, beside the scene that they are of.

What a file does not say is not made up: velocities are no finite differences, crossing times are not guessed, bars are
inf. What is taken for granted is named in ``provenance["assumed"]``, and what can be checked against the scene is: who
is who, in which order, and how fast all start.
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
from dem_bridge.exports.frames import Frames, Sheet, read_ase, read_csv, read_dump, short_of_digits
from dem_bridge.scene import Scene
from dem_bridge.trajectory import Cost, Trajectory
from dem_bridge.version import __version__

Floats = NDArray[np.float64]

#: start velocities and masses in a file may be off by this part of the largest: few digits, but no other unit
START_WITHIN = 1e-4
#: motion across the chain, of that along it, that is none
ACROSS = 1e-6
#: a file whose last time is short of the scene's duration by no more than this part of it is whole
ENDS_WITHIN = 1e-6
#: numbers that are looked at to see how many digits a file has
_LOOKED_AT = 2000
_U, _A, _EV = 1.66053906660e-27, 1e-10, 1.602176634e-19  # kg, m, J (CODATA 2018)
_KCAL = 4184.0 / 6.02214076e23  # J


@dataclass(frozen=True)
class Units:
    """SI values of a style's units: m, s, m/s, N, kg."""

    length: float
    time: float
    velocity: float
    force: float
    mass: float


#: LAMMPS' styles (manual, command units), and "ase": Å, eV, u and what follows of them for time
UNITS = {
    "si": Units(1.0, 1.0, 1.0, 1.0, 1.0),
    "cgs": Units(1e-2, 1.0, 1e-2, 1e-5, 1e-3),
    "micro": Units(1e-6, 1e-6, 1.0, 1e-9, 1e-15),
    "nano": Units(1e-9, 1e-9, 1.0, 1e-12, 1e-21),
    "metal": Units(_A, 1e-12, 1e2, _EV / _A, _U),
    "real": Units(_A, 1e-15, 1e5, _KCAL / _A, _U),
    "ase": Units(_A, _A * math.sqrt(_U / _EV), math.sqrt(_EV / _U), _EV / _A, _U),
}


@dataclass
class _Found:
    """What becomes a Trajectory, ``(n_t, n_body)`` and ``(n_t, n_contact)``, with what was taken for granted."""

    time: Floats
    displacement: Floats
    velocity: Floats | None
    contact_force: Floats | None
    digits: dict[str, float | None]
    assumed: list[str] = field(default_factory=list)
    units: str = "si"


def read(path: Path, scene: Scene, format: str, *, units: str | None = None, dt: float | None = None) -> Trajectory:
    """The run in a file of ``format`` "extxyz", "lammpstrj", "traj" or "csv".

    ``units``: of a file that does not say, see :data:`UNITS` (None: "ase" for "traj", else "si"); ``dt`` (s): of a time
    step, or of a frame where steps are not counted, in a file without times. Raises UsageError in one line for a lost
    atom or frame, another number of bodies, units that are not known, and a start that is not the scene's.
    """
    if units is not None and units not in UNITS:
        raise UsageError(f"units = {units!r}; allowed: {', '.join(UNITS)}")
    if dt is not None and not 0.0 < dt < math.inf:
        raise UsageError(f"dt = {dt!r}; allowed: a number above 0 (s)")
    if not path.is_file():
        raise UsageError(f"{path}: no such file; allowed: a dump, extended XYZ, ASE's .traj or CSV")
    if format == "csv":
        if units not in (None, "si") or dt is not None:
            raise UsageError(f"{path}: units and dt are not for CSV, whose headings have units; leave them out")
        found = _of_sheet(path, read_csv(path), scene)
    else:
        frames = read_dump(path) if format == "lammpstrj" else read_ase(path, format)
        found = _of_frames(path, frames, scene, units, dt, "ase" if format == "traj" else "si")
    _check_times(path, found.time)
    _check_start(path, found, scene)
    if found.time[-1] < scene.duration * (1.0 - ENDS_WITHIN):
        found.assumed.append(f"the file ends at {found.time[-1]:.6g} s, the scene at {scene.duration:.6g} s")
    return _trajectory(path, found, scene, format)


def _of_frames(path: Path, frames: Frames, scene: Scene, units: str | None, dt: float | None, usual: str) -> _Found:
    style, assumed = _units(path, frames.units, units, usual)
    si = UNITS[style]
    if not np.all(np.isfinite(frames.position)):
        frame = int(np.argwhere(~np.isfinite(frames.position))[0, 0])
        raise UsageError(f"{path}: frame {frame} has positions that are no numbers; allowed: finite ones")
    bodies, with_walls = _bodies(path, frames, scene)
    axis = _axis(path, frames, bodies)
    if axis != 0:
        assumed.append(f"the chain lies along {'xyz'[axis]}")
    along = frames.position[:, :, axis]
    _check_order(path, along[:, bodies], frames.ids[bodies])
    if frames.time is not None:
        time = _scaled(frames.time, si.time)
        if dt is not None:
            raise UsageError(f"{path}: dt = {dt!r}, but the file has times; leave it out")
    elif dt is not None and frames.step is not None:
        time = frames.step * dt
        assumed.append(f"a time step, or a frame where steps are not counted, is {dt!r} s")
    else:
        raise UsageError(
            f"{path}: has no times; give dt, the seconds of a time step (of a frame where none are counted)"
        )
    columns = frames.columns
    velocity = columns.get("velocity")
    moving = None if velocity is None else _scaled(velocity[:, bodies, axis], si.velocity)
    _check_mass(path, columns, frames.ids, bodies, scene, si)
    if "displacement" in columns:
        displacement = _scaled(columns["displacement"][:, bodies], si.length)
    else:
        displacement = _scaled(along[:, bodies] - along[0, bodies], si.length)
        assumed.append("displacements are from the first frame")
    digits = {"position": _short(along, si.length)}
    if moving is not None:
        digits["velocity"] = _short(moving)
    contact = None
    if "force_left" in columns and "force_right" in columns:
        left, right = (_scaled(columns[name][:, bodies], si.force) for name in ("force_left", "force_right"))
        contact = _from_sides(left, right, scene)
    elif "force" in columns:
        contact = _from_net(_scaled(columns["force"][:, :, axis], si.force), time, scene, with_walls)
        if contact is not None:
            assumed.append("contact forces are the running sum of net forces, less weight, load and drive")
    return _Found(time, displacement, moving, contact, digits, assumed, style)


def _units(path: Path, said: str | None, given: str | None, usual: str) -> tuple[str, list[str]]:
    if said is not None and given is not None and said != given:
        raise UsageError(f"{path}: says that its units are {said!r}, asked was {given!r}; leave units out")
    style = said or given or usual
    if style not in UNITS:
        raise UsageError(
            f"{path}: has units {style!r}, which are no metres and seconds known here; allowed: {', '.join(UNITS)}"
        )
    return style, [] if said else [f"units {style}: the file does not say"]


def _scaled(values: Floats, unit: float) -> Floats:
    """In SI; what is in SI keeps its bits."""
    return values if unit == 1.0 else values * unit


def _short(values: Floats, unit: float = 1.0) -> float | None:
    """What few digits cost, in SI."""
    flat = values.ravel()
    if len(flat) > _LOOKED_AT:  # any, and not always the same body's
        flat = np.random.default_rng(0).choice(flat, _LOOKED_AT)
    found = short_of_digits(flat.tolist())
    return None if found is None else found * unit


def _bodies(path: Path, frames: Frames, scene: Scene) -> tuple[slice, bool]:
    """Which atoms are bodies; whether the scene's walls are atoms too, at the ends as in our decks."""
    walls = scene.n_contact - (scene.n_body - 1)
    atoms = len(frames.ids)
    if atoms == scene.n_body:
        return slice(0, atoms), walls == 0
    if atoms == scene.n_body + walls:
        first = int(scene.wall_left is not None)
        return slice(first, first + scene.n_body), True
    and_walls = f", or {scene.n_body + walls} with its walls" if walls else ""
    raise UsageError(
        f"{path}: frames have {atoms} atoms, {scene.name} has {scene.n_body} bodies{and_walls}; give the scene that was"
        " run, or the whole file"
    )


def _axis(path: Path, frames: Frames, bodies: slice) -> int:
    """Along which the bodies lie; UsageError where they leave the line."""
    start = frames.position[0, bodies]
    axis = int(np.argmax(np.ptp(start, axis=0)))
    flight = np.max(np.abs(frames.position[:, bodies] - start), axis=(0, 1))
    across = float(np.max(np.delete(flight, axis)))
    if across > ACROSS * float(flight[axis]) and across > 0.0:
        raise UsageError(
            f"{path}: bodies move by {across:g} across the chain, which lies along {'xyz'[axis]}, and by"
            f" {flight[axis]:g} along it; allowed: motion along one line"
        )
    return axis


def _check_order(path: Path, along: Floats, ids: NDArray[np.int64]) -> None:
    wrong = np.argwhere(np.diff(along, axis=1) <= 0.0)
    if len(wrong):
        frame, k = wrong[0].tolist()
        raise UsageError(
            f"{path}: in frame {frame} atom {ids[k]} is at {along[frame, k]:.9g} and atom {ids[k + 1]} at"
            f" {along[frame, k + 1]:.9g}; allowed: places that grow with the id, body 0 first"
        )


def _check_mass(path: Path, columns: Any, ids: NDArray[np.int64], bodies: slice, scene: Scene, si: Units) -> None:
    if "mass" not in columns:
        return
    mass = columns["mass"][0, bodies] * si.mass
    off = np.abs(mass - scene.mass) > START_WITHIN * np.array(scene.mass)
    if np.any(off):
        k = int(np.argmax(off))
        raise UsageError(
            f"{path}: atom {ids[bodies][k]} has a mass of {mass[k]:.6g} kg, body {k} of {scene.name} one of"
            f" {scene.mass[k]:.6g} kg; give the scene that was run, or the units of the file"
        )


def _from_sides(left: Floats, right: Floats, scene: Scene) -> Floats:
    walls = [left[:, :1]] * (scene.wall_left is not None) + [right[:, -1:]] * (scene.wall_right is not None)
    return np.hstack([right[:, :-1], *walls])


def _from_net(net: Floats, time: Floats, scene: Scene, with_walls: bool) -> Floats | None:
    """Contact forces from the net force on each atom at each time, as LAMMPS has it; None where they do not follow."""
    left, right = scene.wall_left is not None, scene.wall_right is not None
    if scene.drag > 0.0 or (left and right and not with_walls):
        return None
    outer = np.tile(scene.steady_force, (len(time), 1))
    if scene.drive is not None:
        outer[:, 0] += scene.drive.at(time)
    if with_walls:
        outer = np.pad(outer, ((0, 0), (int(left), int(right))))
    # force behind each atom; the sum begins where there is nothing, which is the right end if a wall is missing there
    if left and not with_walls:
        behind = np.cumsum((outer - net)[:, ::-1], axis=1)[:, ::-1]
        return np.hstack([-behind[:, 1:], -behind[:, :1]])
    behind = np.cumsum(outer - net, axis=1)
    if not with_walls:
        return behind if right else behind[:, :-1]
    chain = behind[:, int(left) : int(left) + scene.n_body - 1]
    walls = [behind[:, :1]] * left + [behind[:, -2:-1]] * right
    return np.hstack([chain, *walls])


def _of_sheet(path: Path, sheet: Sheet, scene: Scene) -> _Found:
    columns, assumed = sheet.columns, []
    widths = {name: values.shape[1] for name, values in columns.items()}
    for name, width in widths.items():
        wanted = scene.n_contact if name == "contact_force" else scene.n_body
        if width != wanted:
            raise UsageError(
                f"{path}: has {width} columns or bodies of {name}, {scene.name} has {wanted}; give its scene"
            )
    if "displacement" in columns:
        displacement = columns["displacement"]
    elif "x" in columns:
        displacement = columns["x"] - columns["x"][0]
        assumed.append("displacements are from the first time")
    else:
        raise UsageError(f"{path}: has neither displacements nor positions; allowed: displacement_m or x_m")
    if "x" in columns:
        _check_order(path, columns["x"], np.arange(scene.n_body))
    contact = columns.get("contact_force")
    if contact is None and "force_left" in columns and "force_right" in columns:
        contact = _from_sides(columns["force_left"], columns["force_right"], scene)
    digits = {"position": _short(columns.get("x", displacement))}
    if "velocity" in columns:
        digits["velocity"] = _short(columns["velocity"])
    return _Found(sheet.time, displacement, columns.get("velocity"), contact, digits, assumed)


def _check_times(path: Path, time: Floats) -> None:
    steps = np.diff(time)
    if not np.all(np.isfinite(time)) or np.any(steps <= 0.0):
        where = int(np.argmax(~(steps > 0.0)))
        raise UsageError(f"{path}: frame {where + 1} is not later than frame {where}; allowed: times that grow")
    if time[0] != 0.0:
        raise UsageError(f"{path}: begins at {time[0]:g} s; allowed: the scene's start, 0 s, as first frame")
    if len(steps) < 3:
        return
    # frames are lost where nearly all are equally far apart and a few are not
    usual = float(np.median(steps))
    far = np.flatnonzero(steps > 1.5 * usual)
    if 0 < len(far) <= max(1, len(steps) // 10) and np.all(np.delete(steps, far) > 0.5 * usual):
        k = int(far[0])
        raise UsageError(
            f"{path}: between frame {k} ({time[k]:.9g} s) and the next ({time[k + 1]:.9g} s) there are"
            f" {steps[k] / usual:.3g} of the usual intervals: a frame is lost; give a whole file"
        )


def _check_start(path: Path, found: _Found, scene: Scene) -> None:
    start = np.array(scene.velocity)
    if found.velocity is None:
        found.assumed.append("velocities are not in the file, so units and start are not checked")
        return
    if not np.all(np.isfinite(found.velocity)):
        frame = int(np.argwhere(~np.isfinite(found.velocity))[0, 0])
        raise UsageError(f"{path}: frame {frame} has velocities that are no numbers; allowed: finite ones")
    off = np.abs(found.velocity[0] - start)
    scale = float(max(np.max(np.abs(start)), np.max(np.abs(found.velocity))))
    if np.max(off) > START_WITHIN * scale:
        k = int(np.argmax(off))
        ratio = f", {found.velocity[0, k] / start[k]:.6g} times as much" if start[k] else ""
        raise UsageError(
            f"{path}: body {k} starts at {found.velocity[0, k]:.6g} m/s, in {scene.name} at {start[k]:.6g} m/s{ratio};"
            f" give the scene that was run, its start as first frame, and the right units (now {found.units})"
        )


def _trajectory(path: Path, found: _Found, scene: Scene, format: str) -> Trajectory:
    n_t = len(found.time)
    force = found.contact_force
    if force is None or not np.all(np.isfinite(force)):
        force = np.full((n_t, scene.n_contact), math.nan)
        found.assumed.append("contact forces are not known")
    else:
        found.assumed.append("peak forces are those of samples")
    for name, short in found.digits.items():
        if short is not None:
            unit = "m" if name == "position" else "m/s"
            found.assumed.append(f"{name} has few digits: known to {short:.2g} {unit}")
    return Trajectory(
        time=found.time,
        displacement=found.displacement,
        velocity=np.full((n_t, scene.n_body), math.nan) if found.velocity is None else found.velocity,
        contact_force=force,
        peak_force=np.max(force, axis=0),
        crossing_time=np.full(scene.n_contact, math.nan),
        cost=Cost(wall=math.nan, cpu=math.nan, steps=0, force_evaluations=0),
        provenance={
            "backend": "file",
            "scene": scene.name,
            "scene_hash": scene.content_hash,
            "settings": {"format": format, "units": found.units},
            "versions": {"dem-bridge": __version__},
            "file": {"name": path.name, "sha256": hashlib.sha256(path.read_bytes()).hexdigest()},
            "resolution": dict(found.digits),
            "peaks": "samples",
            "assumed": list(found.assumed),
        },
    )
