"""A trajectory as files that other programs open: extended XYZ, a LAMMPS dump, CSV; every number as it is.

Bodies stand in their physical places where the scene has a geometry, else a stated spacing apart; positions are rounded
as doubles of that size are, so ``displacement`` stands beside them, and the force of each body's left and right contact
beside the net one: samples read back from a file are the same to the last bit. Peaks, crossing times, bars, cost and
provenance are in netCDF alone.
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

#: m, between bodies of which nothing is known; a file says so
NOMINAL_SPACING = 0.01
#: ending of a file -> format
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
    """The format that is named, else that of the file's ending; UsageError where there is none such."""
    allowed = tuple(dict.fromkeys(SUFFIXES.values()))
    if name is not None:
        if name not in allowed:
            raise UsageError(f"format = {name!r}; allowed: {', '.join(allowed)}")
        return name
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError(f"{path}: {path.suffix!r} tells no format; allowed: {', '.join(SUFFIXES)}, or name a format")
    return SUFFIXES[path.suffix.lower()]


def centres(scene: Scene, spacing: float | None = None) -> tuple[Floats, Floats, bool]:
    """Places of the bodies' centres at the start, body 0 at 0, and radii, m, ``(n_body,)``; whether they are physical.

    Those of the geometry; else half the ``spacing`` (m), the scene's, or :data:`NOMINAL_SPACING`. Raises UsageError for
    a spacing that is no number above 0, or one beside a geometry.

    >>> import dem_bridge as db
    >>> places, radii, physical = centres(db.load_scene("decelerating-40"))
    >>> places[:3].tolist(), float(radii[0]), physical
    ([0.0, 0.018, 0.036], 0.009, True)
    """
    known = scene.geometry is not None or scene.spacing is not None
    if spacing is not None:
        if known:
            raise UsageError(f"spacing = {spacing!r}, but {scene.name} has its own; leave it out")
        if not 0.0 < spacing < np.inf:
            raise UsageError(f"spacing = {spacing!r}; allowed: a number above 0 (m)")
    if scene.geometry is not None:
        radii = np.array([body.radius for body in scene.geometry.bodies])
    else:
        radii = np.full(scene.n_body, 0.5 * (scene.spacing or spacing or NOMINAL_SPACING))
    steps = radii[:-1] + radii[1:] + scene.contacts.gap[: scene.n_body - 1]
    return np.concatenate([[0.0], np.cumsum(steps)]), radii, known


def sided_forces(scene: Scene, run: Trajectory) -> tuple[Floats, Floats]:
    """Force of each body's left and right contact, N, ``(n_t, n_body)`` both, walls included; 0 where there is none."""
    links, n_t = scene.n_body - 1, len(run.time)
    chain, none = run.contact_force[:, :links], np.zeros((n_t, 1))
    left = run.contact_force[:, [links]] if scene.wall_left is not None else none
    right = run.contact_force[:, [scene.n_contact - 1]] if scene.wall_right is not None else none
    return np.hstack([left, chain]), np.hstack([chain, right])


def text_of(run: Trajectory, scene: Scene, format: str, *, spacing: float | None = None, layout: str = "long") -> str:
    """The samples of a run of ``scene`` as text, "extxyz", "lammpstrj" or "csv"; UsageError for what does not fit."""
    shape = (scene.n_body, scene.n_contact)
    found = (run.velocity.shape[1], len(run.peak_force))
    if found != shape:
        raise UsageError(
            f"the run has {found[0]} bodies and {found[1]} contacts, {scene.name} has {shape[0]} and {shape[1]}; give"
            " the scene that was run"
        )
    of_run = run.provenance.get("scene_hash", scene.content_hash)
    if of_run != scene.content_hash:
        raise UsageError(
            f"the run is one of the scene with hash {of_run[:12]}, {scene.name} has {scene.content_hash[:12]}; give the"
            " scene that was run"
        )
    if layout not in ("long", "wide") or (layout == "wide" and format != "csv"):
        raise UsageError(f"layout = {layout!r} of format {format!r}; allowed: long, or with csv wide")
    if format == "csv" and layout == "wide":
        return "\n".join(_wide(run)) + "\n"
    return "\n".join(_WRITERS[format](run, scene, spacing)) + "\n"


def _rows(columns: list[Floats], row: int) -> list[list[float]]:
    """Of one sample: a list of Python's own numbers per body, whose repr has all digits."""
    return np.stack([one[row] for one in columns], axis=1).tolist()  # type: ignore[no-any-return]


def _box(scene: Scene, run: Trajectory, places: Floats, radii: Floats) -> tuple[float, float, float]:
    """Ends along the chain and half the width, m, around all that moves; powers of no meaning but of room."""
    reach = 2.0 * float(np.max(radii))
    flight = run.displacement[np.isfinite(run.displacement)]
    low, high = (float(bound(flight)) if flight.size else 0.0 for bound in (np.min, np.max))
    return float(places[0]) + min(low, 0.0) - reach, float(places[-1]) + max(high, 0.0) + reach, reach


def _extxyz(run: Trajectory, scene: Scene, spacing: float | None) -> Iterator[str]:
    places, radii, physical = centres(scene, spacing)
    left, right = sided_forces(scene, run)
    low, high, half = _box(scene, run, places, radii)
    words = (
        f'Lattice="{high - low!r} 0.0 0.0 0.0 {2.0 * half!r} 0.0 0.0 0.0 {2.0 * half!r}"'
        f' Origin="{low!r} {-half!r} {-half!r}" pbc="F F F"'
        " Properties=species:S:1:pos:R:3:velo:R:3:forces:R:3:radius:R:1:mass:R:1:id:I:1:displacement:R:1"
        ":force_left:R:1:force_right:R:1"
        f" units=si scene={scene.name} scene_hash=sha256-{scene.content_hash} backend={_word(run)}"
        f" spacing={'physical' if physical else 'nominal'} written_by=dem_bridge-{__version__}"
    )
    columns = [places + run.displacement, run.velocity, left - right, run.displacement, left, right]
    still = [
        f"{radius!r} {mass!r} {k}" for k, (radius, mass) in enumerate(zip(radii.tolist(), scene.mass, strict=True))
    ]
    for row, time in enumerate(run.time.tolist()):
        yield f"{scene.n_body}\n{words} Time={time!r} sample={row}"
        for same, (x, v, f, u, fl, fr) in zip(still, _rows(columns, row), strict=True):
            yield f"X {x!r} 0.0 0.0 {v!r} 0.0 0.0 {f!r} 0.0 0.0 {same} {u!r} {fl!r} {fr!r}"


def _dump(run: Trajectory, scene: Scene, spacing: float | None) -> Iterator[str]:
    places, radii, _ = centres(scene, spacing)
    left, right = sided_forces(scene, run)
    low, high, half = _box(scene, run, places, radii)
    bounds = f"{low!r} {high!r}\n{-half!r} {half!r}\n{-half!r} {half!r}"
    columns = [places + run.displacement, run.velocity, left - right, run.displacement, left, right]
    still = [f"{radius!r} {mass!r}" for radius, mass in zip(radii.tolist(), scene.mass, strict=True)]
    yield "ITEM: UNITS\nsi"
    for row, time in enumerate(run.time.tolist()):
        yield f"ITEM: TIME\n{time!r}\nITEM: TIMESTEP\n{row}\nITEM: NUMBER OF ATOMS\n{scene.n_body}"
        yield f"ITEM: BOX BOUNDS ff ff ff\n{bounds}"
        yield ("ITEM: ATOMS id type x y z vx vy vz fx fy fz radius mass d_displacement d_force_left d_force_right")
        for k, (same, (x, v, f, u, fl, fr)) in enumerate(zip(still, _rows(columns, row), strict=True), start=1):
            yield f"{k} 1 {x!r} 0 0 {v!r} 0 0 {f!r} 0 0 {same} {u!r} {fl!r} {fr!r}"


def _long(run: Trajectory, scene: Scene, spacing: float | None) -> Iterator[str]:
    places, _, _ = centres(scene, spacing)
    left, right = sided_forces(scene, run)
    columns = [places + run.displacement, run.displacement, run.velocity, left, right]
    yield "time_s,body,x_m,displacement_m,velocity_m_per_s,force_left_N,force_right_N"
    for row, time in enumerate(run.time.tolist()):
        for body, values in enumerate(_rows(columns, row)):
            yield f"{time!r},{body},{','.join(map(_cell, values))}"


def _wide(run: Trajectory) -> Iterator[str]:
    parts = {"displacement": "m", "velocity": "m_per_s", "contact_force": "N"}
    heads = [f"{name}_{k}_{unit}" for name, unit in parts.items() for k in range(getattr(run, name).shape[1])]
    yield ",".join(["time_s", *heads])
    whole = np.hstack([run.time[:, None], *(getattr(run, name) for name in parts)])
    for row in whole:
        yield ",".join(map(_cell, row.tolist()))


def _cell(value: float) -> str:
    return "" if value != value else repr(value)


def _word(run: Trajectory) -> str:
    return "".join(sign if sign.isalnum() or sign in "-._" else "_" for sign in str(run.provenance.get("backend", "-")))


_WRITERS: Mapping[str, Callable[[Trajectory, Scene, float | None], Iterator[str]]] = MappingProxyType(
    {"extxyz": _extxyz, "lammpstrj": _dump, "csv": _long}
)
