"""Turn the frames of a file into a record: units, axis and order of the bodies are recognised here."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.formats.readers.column_meaning import Choices
from dem_bridge.formats.readers.columns_to_record import from_sides
from dem_bridge.formats.readers.dumps import Frames
from dem_bridge.formats.readers.record import Draft
from dem_bridge.formats.readers.rounding import counted_times, scaled, step_of
from dem_bridge.formats.units import STYLES
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats

#: largest difference of masses from those of the scene by which units are recognised, relative
_SAME_MASS = 1e-3
#: roundings of a file, and part of a mass of the scene, by which masses differ
_MASSES_APART, _ROUNDED_MASS = 3.0, 1e-9
#: largest difference of start velocities by which a mirrored chain is recognised, relative to the largest
_SAME_START = 1e-3


def draft_of_frames(name: str, frames: Frames, scene: Scene, choices: Choices, default_units: str) -> Draft:
    """Return the draft of a record from frames of atoms."""
    notes = list(frames.notes)
    style = style_of(frames, scene, choices, default_units, notes)
    units = Choices(units=style)
    scale = {
        quantity: (choices if choices.states(quantity) else units).scale(quantity, None)
        for quantity in ("time", "position", "velocity", "displacement", "contact_force")
    }
    time, time_rounding, dt = times_of(frames, choices, scale["time"], notes)
    draft = Draft(name=name, time=time, time_rounding=time_rounding, dt=dt, notes=notes)
    axis = axis_of(frames, choices)
    if axis:
        notes.append(f"the chain lies along {'xyz'[axis]}")
    order, bodies = _bodies(frames, axis, scene, choices, notes)
    sign = _sign(frames, axis, order, bodies, scene, scale["velocity"])
    if sign < 0.0:
        notes.append("the chain is mirrored: body 0 is at the upper end of the axis; signs are changed")
    for quantity, column in (("velocity", "velocity"), ("displacement", "displacements")):
        if column in frames.columns:
            values, rounding = (part[column][:, order, axis] for part in (frames.columns, frames.rounding))
            values, rounding = scaled(values, rounding, scale[quantity])
            draft.add(quantity, sign * values, rounding, bodies)
    if "displacement" in frames.columns:
        values, rounding = (part["displacement"][:, order] for part in (frames.columns, frames.rounding))
        values, rounding = scaled(values, rounding, scale["displacement"])
        draft.add("displacement", sign * values, rounding, bodies)
    elif "position" in frames.columns:
        values, rounding = (part["position"][:, order, axis] for part in (frames.columns, frames.rounding))
        values, rounding = scaled(values, rounding, scale["position"])
        draft.add_positions(sign * values, rounding, bodies)
    if {"force_left", "force_right"} <= set(frames.columns) and bodies == tuple(range(scene.n_body)):
        forces, errors = (
            from_sides(part["force_left"][:, order], part["force_right"][:, order], scene)
            for part in (frames.columns, frames.rounding)
        )
        draft.add("contact_force", *scaled(forces, errors, scale["contact_force"]), range(scene.n_contact))
    _say_diameters(frames, order, bodies, scene, style, notes)
    draft.stated = _other_masses(frames, order, bodies, scene, STYLES[style].mass)
    return draft


def style_of(frames: Frames, scene: Scene, choices: Choices, default: str, notes: list[str]) -> str:
    """Return the unit style: that of the file, the stated one, one that gives the scene's masses, or ``default``."""
    stated = choices.units if isinstance(choices.units, str) else None
    styles = STYLES
    if frames.units is not None and stated is not None and frames.units != stated:
        raise UsageError(f"units = {stated!r} was given, but the file has {frames.units!r}; leave units out")
    style: str | None = frames.units or stated
    if style is not None:
        if style not in styles:
            raise UsageError(f"the file has units {style!r}, whose SI values are unknown; allowed: {', '.join(styles)}")
        return style
    if "mass" in frames.columns and len(frames.ids) == scene.n_body:
        ratio = float(np.median(frames.columns["mass"][0])) / float(np.median(scene.mass))
        near = [name for name, si in styles.items() if abs(ratio * si.mass - 1.0) <= _SAME_MASS]
        if near and default not in near:
            notes.append(f"units are {near[0]}, because the masses of the file are then those of the scene")
            return near[0]
    notes.append(f"units are {default}, because the file does not state them")
    return default


def times_of(frames: Frames, choices: Choices, scale: float, notes: list[str]) -> tuple[Floats, Floats, float | None]:
    """Return the times of the frames with their rounding errors, and the time step."""
    dt = choices.dt if choices.dt is not None else None if frames.dt is None else frames.dt * scale
    if frames.time is not None:
        time, rounding = scaled(frames.time, frames.rounding["time"], scale)
        dt = dt if dt is not None else step_of(time, rounding, frames.step, notes)
        return *counted_times(time, rounding, frames.step, dt, notes), dt
    if dt is None or frames.step is None:
        raise UsageError("the file has step or frame numbers but no times; give the time step in seconds, dt (FILE@DT)")
    notes.append(f"times are step numbers (without them: frame numbers) times the time step of {dt:.9g} s")
    time = frames.step * dt
    return time, 0.5 * np.spacing(time), dt


def axis_of(frames: Frames, choices: Choices) -> int:
    """Return the axis of the chain: the stated one, that of the largest extent, or of the largest motion."""
    if choices.axis is not None:
        return "xyz".index(choices.axis)
    if "position" in frames.columns and len(frames.ids) > 1:
        return int(np.argmax(np.ptp(frames.columns["position"][0], axis=0)))
    for name in ("velocity", "position"):
        if name in frames.columns:
            return int(np.argmax(np.max(np.ptp(frames.columns[name], axis=0), axis=0)))
    return 0


def _bodies(
    frames: Frames, axis: int, scene: Scene, choices: Choices, notes: list[str]
) -> tuple[NDArray[np.int64], tuple[int, ...]]:
    """Return the places of the bodies among the atoms, in the order of the columns, and the body of each column."""
    count, walls = len(frames.ids), scene.n_contact - (scene.n_body - 1)
    order = np.arange(count)
    if "position" in frames.columns:
        along = frames.columns["position"][0, :, axis]
        steps = np.diff(along)
        if not (np.all(steps > 0.0) or np.all(steps < 0.0)):
            order = np.argsort(along, kind="stable")
            notes.append("bodies are in the order of their positions, which is not that of their ids")
    if choices.bodies is not None:
        if len(choices.bodies) != count:
            raise UsageError(
                f"{len(choices.bodies)} bodies were given, the file has {count} atoms; give the body of each, in"
                " the order of their ids"
            )
        return np.arange(count), tuple(choices.bodies)
    if count == scene.n_body:
        return order, tuple(range(count))
    if walls and count == scene.n_body + walls:
        first = int(scene.wall_left is not None)
        notes.append(f"{walls} of {count} atoms at the ends are the walls")
        return order[first : first + scene.n_body], tuple(range(scene.n_body))
    first_id = 0 if frames.ids[0] == 0 else 1
    if frames.numbered and count < scene.n_body and frames.ids[-1] - first_id < scene.n_body:
        notes.append(f"the file has {count} of {scene.n_body} bodies; ids count from {first_id}")
        return np.arange(count), tuple((frames.ids - first_id).tolist())
    raise UsageError(
        f"the file has {count} atoms per frame, the scene {scene.name} has {scene.n_body} bodies; allowed: all bodies"
        + f", or {scene.n_body + walls} atoms with its walls" * bool(walls)
        + ", or some bodies with ids from 1. Is it this scene? Give that of this run, or the bodies (--bodies)"
    )


def _sign(
    frames: Frames, axis: int, order: NDArray[np.int64], bodies: tuple[int, ...], scene: Scene, scale: float
) -> float:
    """Return -1 if the chain is mirrored, which its positions and start velocities must both show; else 1."""
    if "position" not in frames.columns or "velocity" not in frames.columns or len(order) < 2:
        return 1.0
    along = frames.columns["position"][0, order, axis]
    start = np.array(scene.velocity)[list(bodies)]
    first = frames.columns["velocity"][0, order, axis] * scale
    near = _SAME_START * float(np.max(np.abs(start), initial=0.0))
    mirrored = near > 0.0 and np.all(np.diff(along) < 0.0) and np.all(np.abs(first + start) <= near)
    return -1.0 if mirrored else 1.0


def _other_masses(
    frames: Frames, order: NDArray[np.int64], bodies: tuple[int, ...], scene: Scene, unit: float
) -> dict[str, tuple[float, ...]]:
    """Return the masses of the scene with those that the file has otherwise, kg; nothing if all are the scene's."""
    if "mass" not in frames.columns:
        return {}
    mass, places = np.array(scene.mass), list(bodies)
    values, rounding = (unit * part["mass"][0, order] for part in (frames.columns, frames.rounding))
    apart = np.abs(values - mass[places]) > _MASSES_APART * rounding + _ROUNDED_MASS * mass[places]
    mass[places] = np.where(apart, values, mass[places])
    return {"mass": tuple(mass.tolist())} if np.any(apart) else {}


def _say_diameters(
    frames: Frames, order: NDArray[np.int64], bodies: tuple[int, ...], scene: Scene, style: str, notes: list[str]
) -> None:
    """Add a note if the radii of the file are the diameters of the scene; neither is used."""
    if scene.geometry is None or "radius" not in frames.columns:
        return
    radii = np.array([scene.geometry.bodies[body].radius for body in bodies])
    ratio = float(np.median(frames.columns["radius"][0, order] / radii)) * STYLES[style].length
    if math.isclose(ratio, 2.0, rel_tol=1e-3):
        notes.append("the column radius has the diameters of the scene; radii are not used")
