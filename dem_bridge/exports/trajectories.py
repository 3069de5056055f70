"""Write trajectories for other programs with all digits: extended XYZ, LAMMPS dumps and CSV.

Bodies are placed by the scene's geometry, or by a spacing where there is none. Positions are rounded at their own size,
so files also contain the displacement, and beside the net force the forces of the left and the right contact of each
body: samples that are read back are the same to the last bit. Only netCDF keeps peak forces, crossing times,
uncertainties, cost and provenance.

"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.scene import Scene
from dem_bridge.trajectory import Trajectory
from dem_bridge.version import __version__

Floats = NDArray[np.float64]
Layout = Literal["long", "wide"]

#: spacing in m of bodies without a geometry; extended XYZ files then say spacing=nominal
NOMINAL_SPACING = 0.01
#: format of each file ending
SUFFIXES: Mapping[str, str] = MappingProxyType(
    {
        ".nc": "nc",
        ".extxyz": "extxyz",
        ".xyz": "extxyz",
        ".lammpstrj": "lammpstrj",
        ".dump": "lammpstrj",
        ".csv": "csv",
        ".traj": "traj",
    }
)


def format_of(path: Path, name: str | None = None) -> str:
    """Return the format ``name``, or without a name the format of the file's ending; raise UsageError if unknown."""
    allowed = tuple(dict.fromkeys(SUFFIXES.values()))
    if name is not None:
        if name not in allowed:
            raise UsageError(f"format = {name!r} is unknown; allowed: {', '.join(allowed)}")
        return name
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError(
            f"{path}: the file type is not clear from {path.suffix!r}; allowed: {', '.join(SUFFIXES)}; rename the file,"
            " or give its format (--format)"
        )
    return SUFFIXES[path.suffix.lower()]


def centres(scene: Scene, spacing: float | None = None) -> tuple[Floats, Floats, bool]:
    """Return the initial positions and the radii of the bodies, m, ``(n_body,)``, and True if they are physical.

    Body 0 is at 0. Radii are those of the geometry; without a geometry, half the scene's spacing, half ``spacing`` (m)
    or half :data:`NOMINAL_SPACING`. Raises UsageError for a spacing that is not above 0, or that is given for a scene
    with a geometry or spacing of its own.

    >>> import dem_bridge as db
    >>> positions, radii, physical = centres(db.load_scene("decelerating-40"))
    >>> positions[:3].tolist(), float(radii[0]), physical
    ([0.0, 0.018, 0.036], 0.009, True)
    """
    physical = scene.geometry is not None or scene.spacing is not None
    if spacing is not None:
        if physical:
            raise UsageError(
                f"spacing = {spacing!r} was given, but the scene {scene.name} has a spacing; leave spacing out"
            )
        if not 0.0 < spacing < np.inf:
            raise UsageError(f"spacing = {spacing!r}; allowed: a number above 0 (m)")
    if scene.geometry is not None:
        radii = np.array([body.radius for body in scene.geometry.bodies])
    else:
        radii = np.full(scene.n_body, 0.5 * (scene.spacing or spacing or NOMINAL_SPACING))
    steps = radii[:-1] + radii[1:] + scene.contacts.gap[: scene.n_body - 1]
    return np.concatenate([[0.0], np.cumsum(steps)]), radii, physical


def sided_forces(scene: Scene, run: Trajectory) -> tuple[Floats, Floats]:
    """Return the forces of each body's left and right contact, N, ``(n_t, n_body)`` each; 0 without a contact."""
    links, n_t = scene.n_body - 1, len(run.time)
    chain, none = run.contact_force[:, :links], np.zeros((n_t, 1))
    left = run.contact_force[:, [links]] if scene.wall_left is not None else none
    right = run.contact_force[:, [scene.n_contact - 1]] if scene.wall_right is not None else none
    return np.hstack([left, chain]), np.hstack([chain, right])


def text_of(run: Trajectory, scene: Scene, format: str, *, spacing: float | None = None, layout: str = "long") -> str:
    """Return the samples of a run of ``scene`` as text in the format "extxyz", "lammpstrj" or "csv".

    Raises UsageError if the run is not one of the scene, or the format has no such ``layout``.
    """
    shape = (scene.n_body, scene.n_contact)
    run_shape = (run.velocity.shape[1], len(run.peak_force))
    if run_shape != shape:
        raise UsageError(
            f"the run has {run_shape[0]} bodies and {run_shape[1]} contacts, the scene {scene.name} has {shape[0]} and"
            f" {shape[1]}; give the scene of this run"
        )
    of_run = run.provenance.get("scene_hash", scene.content_hash)
    if of_run != scene.content_hash:
        raise UsageError(
            f"the run is of a scene with the hash {of_run[:12]}, the scene {scene.name} has the hash"
            f" {scene.content_hash[:12]}; give the scene of this run"
        )
    if layout not in ("long", "wide") or (layout == "wide" and format != "csv"):
        raise UsageError(f"layout = {layout!r} with format {format!r}; allowed: long, and with format csv also wide")
    if format == "csv" and layout == "wide":
        return "\n".join(_wide(run)) + "\n"
    return "\n".join(_WRITERS[format](run, scene, spacing)) + "\n"


def _rows(columns: list[Floats], row: int) -> list[list[float]]:
    """Return the numbers of one sample, a list per body, as Python floats, whose repr has all digits."""
    return np.stack([column[row] for column in columns], axis=1).tolist()  # type: ignore[no-any-return]


def _box(scene: Scene, run: Trajectory, positions: Floats, radii: Floats) -> tuple[float, float, float]:
    """Return the ends of a box along the chain and half its width, m; the box contains all motion."""
    reach = 2.0 * float(np.max(radii))
    flight = run.displacement[np.isfinite(run.displacement)]
    low, high = (float(bound(flight)) if flight.size else 0.0 for bound in (np.min, np.max))
    return float(positions[0]) + min(low, 0.0) - reach, float(positions[-1]) + max(high, 0.0) + reach, reach


def _extxyz(run: Trajectory, scene: Scene, spacing: float | None) -> Iterator[str]:
    """Yield the lines of an extended XYZ file."""
    positions, radii, physical = centres(scene, spacing)
    left, right = sided_forces(scene, run)
    low, high, half = _box(scene, run, positions, radii)
    words = (
        f'Lattice="{high - low!r} 0.0 0.0 0.0 {2.0 * half!r} 0.0 0.0 0.0 {2.0 * half!r}"'
        f' Origin="{low!r} {-half!r} {-half!r}" pbc="F F F"'
        " Properties=species:S:1:pos:R:3:velo:R:3:forces:R:3:radius:R:1:mass:R:1:id:I:1:displacement:R:1"
        ":force_left:R:1:force_right:R:1"
        f" units=si scene={scene.name} scene_hash=sha256-{scene.content_hash} backend={_word(run)}"
        f" spacing={'physical' if physical else 'nominal'} written_by=dem_bridge-{__version__}"
    )
    columns = [positions + run.displacement, run.velocity, left - right, run.displacement, left, right]
    constant = [
        f"{radius!r} {mass!r} {k}" for k, (radius, mass) in enumerate(zip(radii.tolist(), scene.mass, strict=True))
    ]
    for row, time in enumerate(run.time.tolist()):
        yield f"{scene.n_body}\n{words} Time={time!r} sample={row}"
        for unchanged, (x, v, f, u, fl, fr) in zip(constant, _rows(columns, row), strict=True):
            yield f"X {x!r} 0.0 0.0 {v!r} 0.0 0.0 {f!r} 0.0 0.0 {unchanged} {u!r} {fl!r} {fr!r}"


def _dump(run: Trajectory, scene: Scene, spacing: float | None) -> Iterator[str]:
    """Yield the lines of a LAMMPS text dump."""
    positions, radii, _ = centres(scene, spacing)
    left, right = sided_forces(scene, run)
    low, high, half = _box(scene, run, positions, radii)
    bounds = f"{low!r} {high!r}\n{-half!r} {half!r}\n{-half!r} {half!r}"
    columns = [positions + run.displacement, run.velocity, left - right, run.displacement, left, right]
    constant = [f"{radius!r} {mass!r}" for radius, mass in zip(radii.tolist(), scene.mass, strict=True)]
    yield "ITEM: UNITS\nsi"
    for row, time in enumerate(run.time.tolist()):
        yield f"ITEM: TIME\n{time!r}\nITEM: TIMESTEP\n{row}\nITEM: NUMBER OF ATOMS\n{scene.n_body}"
        yield f"ITEM: BOX BOUNDS ff ff ff\n{bounds}"
        yield ("ITEM: ATOMS id type x y z vx vy vz fx fy fz radius mass d_displacement d_force_left d_force_right")
        for k, (unchanged, (x, v, f, u, fl, fr)) in enumerate(zip(constant, _rows(columns, row), strict=True), start=1):
            yield f"{k} 1 {x!r} 0 0 {v!r} 0 0 {f!r} 0 0 {unchanged} {u!r} {fl!r} {fr!r}"


def _long(run: Trajectory, scene: Scene, spacing: float | None) -> Iterator[str]:
    """Yield the lines of a CSV file with a row per time and body."""
    positions, _, _ = centres(scene, spacing)
    left, right = sided_forces(scene, run)
    columns = [positions + run.displacement, run.displacement, run.velocity, left, right]
    yield "time_s,body,x_m,displacement_m,velocity_m_per_s,force_left_N,force_right_N"
    for row, time in enumerate(run.time.tolist()):
        for body, values in enumerate(_rows(columns, row)):
            yield f"{time!r},{body},{','.join(map(_cell, values))}"


def _wide(run: Trajectory) -> Iterator[str]:
    """Yield the lines of a CSV file with a row per time."""
    parts = {"displacement": "m", "velocity": "m_per_s", "contact_force": "N"}
    heads = [f"{name}_{k}_{unit}" for name, unit in parts.items() for k in range(getattr(run, name).shape[1])]
    yield ",".join(["time_s", *heads])
    whole = np.hstack([run.time[:, None], *(getattr(run, name) for name in parts)])
    for row in whole:
        yield ",".join(map(_cell, row.tolist()))


def _cell(value: float) -> str:
    """Return a number with all digits, and an empty cell for nan."""
    return "" if value != value else repr(value)


def _word(run: Trajectory) -> str:
    """Return the name of the backend as one word."""
    return "".join(sign if sign.isalnum() or sign in "-._" else "_" for sign in str(run.provenance.get("backend", "-")))


_WRITERS: Mapping[str, Callable[[Trajectory, Scene, float | None], Iterator[str]]] = MappingProxyType(
    {"extxyz": _extxyz, "lammpstrj": _dump, "csv": _long}
)
