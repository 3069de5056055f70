"""Write trajectories for other programs with all digits: extended XYZ, LAMMPS dumps and CSV.

Bodies are placed by the scene's geometry, or by a spacing where there is none. Positions are rounded at their own size,
so files also contain the displacement, and beside the net force the forces of the left and the right contact of each
body: samples that are read back are the same to the last bit. Only netCDF keeps peak forces, crossing times,
uncertainties, cost and provenance.

"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from dem_bridge.errors import UsageError
from dem_bridge.foundation.numbers import check_number
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats, Trajectory
from dem_bridge.version import __version__

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
#: start of a file, head of a frame, and line of a body (index from 0 and from 1, radius, mass, x, velocity, net force,
#: displacement, forces of the left and the right contact); ``!r`` writes all digits
_TEMPLATES: Mapping[str, tuple[str, str, str]] = {
    "extxyz": (
        "",
        (
            "{scene.n_body}\n"
            'Lattice="{length!r} 0.0 0.0 0.0 {width!r} 0.0 0.0 0.0 {width!r}" '
            'Origin="{low!r} -{reach!r} -{reach!r}" pbc="F F F" '
            "Properties=species:S:1:pos:R:3:velo:R:3:forces:R:3:radius:R:1:mass:R:1:id:I:1:"
            "displacement:R:1:force_left:R:1:force_right:R:1 "
            "units=si scene={scene.name} scene_hash=sha256-{scene.content_hash} "
            "backend={backend} spacing={spacing} "
            "written_by=dem_bridge-{version} Time={time!r} sample={sample}"
        ),
        "X {4!r} 0.0 0.0 {5!r} 0.0 0.0 {6!r} 0.0 0.0 {2!r} {3!r} {0} {7!r} {8!r} {9!r}",
    ),
    "lammpstrj": (
        "ITEM: UNITS\nsi",
        (
            "ITEM: TIME\n"
            "{time!r}\n"
            "ITEM: TIMESTEP\n"
            "{sample}\n"
            "ITEM: NUMBER OF ATOMS\n"
            "{scene.n_body}\n"
            "ITEM: BOX BOUNDS ff ff ff\n"
            "{low!r} {high!r}\n"
            "-{reach!r} {reach!r}\n"
            "-{reach!r} {reach!r}\n"
            "ITEM: ATOMS id type x y z vx vy vz fx fy fz radius mass d_displacement d_force_left d_force_right"
        ),
        "{1} 1 {4!r} 0 0 {5!r} 0 0 {6!r} 0 0 {2!r} {3!r} {7!r} {8!r} {9!r}",
    ),
}


def format_of(path: Path, name: str | None = None) -> str:
    """Return the format ``name``, or without a name the format of the file's ending; raise UsageError if unknown."""
    allowed = tuple(dict.fromkeys(SUFFIXES.values()))
    if name is not None:
        if name not in allowed:
            raise UsageError(f"format = {name!r} is unknown; allowed: {', '.join(allowed)}")
        return name
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError(
            f"{path}: the file type is not clear from {path.suffix!r}; allowed: {', '.join(SUFFIXES)}; rename the file"
            " or state its format"
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
        check_number("spacing", spacing, "a number above 0 (m)", above=0.0)
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
    n_body, n_contact = run.velocity.shape[1], len(run.peak_force)
    if (n_body, n_contact) != (scene.n_body, scene.n_contact):
        raise UsageError(
            f"the run has {n_body} bodies and {n_contact} contacts, the scene {scene.name} has {scene.n_body} and"
            f" {scene.n_contact}; give the scene of this run"
        )
    of_run = run.provenance.get("scene_hash", scene.content_hash)
    if of_run != scene.content_hash:
        raise UsageError(
            f"the run is of a scene with the hash {of_run[:12]}, the scene {scene.name} has the hash"
            f" {scene.content_hash[:12]}; give the scene of this run"
        )
    if layout not in ("long", "wide") or (layout == "wide" and format != "csv"):
        raise UsageError(f"layout = {layout!r} with format {format!r}; allowed: long, and with format csv also wide")
    positions, radii, physical = centres(scene, spacing)
    left, right = sided_forces(scene, run)
    x = positions + run.displacement
    if format == "csv":
        return _csv(run, x, left, right, layout)
    # the box contains all motion
    flight, reach = run.displacement[np.isfinite(run.displacement)], 2.0 * float(np.max(radii))
    low = float(positions[0]) + float(np.min(flight, initial=0.0)) - reach
    high = float(positions[-1]) + float(np.max(flight, initial=0.0)) + reach
    box = {"low": low, "high": high, "length": high - low, "reach": reach, "width": 2.0 * reach}
    about = {"scene": scene, "backend": _word(run), "spacing": "physical" if physical else "nominal"}
    start, head, body = _TEMPLATES[format]
    rows = np.stack([x, run.velocity, left - right, run.displacement, left, right], axis=2)
    lines = [start] if start else []
    for sample, time in enumerate(run.time.tolist()):
        lines.append(head.format(**box, **about, version=__version__, time=time, sample=sample))
        sizes = zip(range(scene.n_body), range(1, scene.n_body + 1), radii.tolist(), scene.mass, strict=True)
        lines += [body.format(*size, *row) for size, row in zip(sizes, rows[sample].tolist(), strict=True)]
    return "\n".join(lines) + "\n"


def _csv(run: Trajectory, x: Floats, left: Floats, right: Floats, layout: str) -> str:
    """Return the samples as CSV with a row per time and body (layout "long") or a row per time ("wide")."""
    from pandas import DataFrame

    n_t, n_body = run.velocity.shape
    columns: dict[str, Any]
    if layout == "long":
        columns = {"time_s": np.repeat(run.time, n_body), "body": np.tile(np.arange(n_body), n_t)}
        sampled = {"x_m": x, "displacement_m": run.displacement, "velocity_m_per_s": run.velocity}
        sampled |= {"force_left_N": left, "force_right_N": right}
        columns |= {name: values.ravel() for name, values in sampled.items()}
    else:
        columns = {"time_s": run.time}
        for name, unit in (("displacement", "m"), ("velocity", "m_per_s"), ("contact_force", "N")):
            columns |= {f"{name}_{k}_{unit}": column for k, column in enumerate(getattr(run, name).T)}
    return str(DataFrame(columns).to_csv(index=False, lineterminator="\n"))


def _word(run: Trajectory) -> str:
    """Return the name of the backend as one word."""
    return re.sub(r"[^\w.-]", "_", str(run.provenance.get("backend", "-")))
