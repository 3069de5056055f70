"""The public facade for trajectories as files: written for other programs, read from them, compared."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from dem_bridge.errors import UsageError
from dem_bridge.files import check_file, write_whole
from dem_bridge.scene import Scene
from dem_bridge.scene_file import load_scene, scene_of, shipped_scenes
from dem_bridge.trajectory import Trajectory, load_trajectory

if TYPE_CHECKING:
    from dem_bridge.differences import Comparison


def write_trajectory(
    run: Trajectory,
    scene: Scene | str | Path | None,
    path: str | Path,
    *,
    format: str | None = None,
    spacing: float | None = None,
    layout: str = "long",
) -> None:
    """Write a run of ``scene`` (None: the shipped one that it says) for other programs, every number with all digits.

    ``format``: "extxyz" (extended XYZ), "lammpstrj" (a text dump of LAMMPS), "csv" or "nc"; None: by the ending of
    ``path``. Bodies stand where the scene's geometry has them, else ``spacing`` (m; None: 0.01) apart; ``layout`` of
    csv: "long", a row per time and body, or "wide", a row per time. SI. Displacements, velocities and contact forces
    read back are the same to the last bit; peaks, crossing times, bars and provenance are kept by "nc" alone. Raises
    UsageError for another format, scene or setting.

    >>> import dem_bridge as db, tempfile
    >>> scene = db.Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    >>> run = db.solve(scene, backend="verlet", dt=1e-6, samples=10, bars=False)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     db.write_trajectory(run, scene, f"{folder}/pair.lammpstrj")
    ...     again = db.read_trajectory(f"{folder}/pair.lammpstrj", scene)
    >>> bool((again.velocity == run.velocity).all()), again.uncertainty["velocity"]
    (True, inf)
    """
    from dem_bridge.exports.trajectories import format_of, text_of

    path = Path(path)
    chosen = format_of(path, format)
    if chosen == "traj":
        raise UsageError(f"{path}: ASE's own format is read, not written; allowed: extxyz, which ASE reads, or another")
    check_file(path)
    if chosen == "nc":
        run.save(path)
        return
    write_whole(path.parent, {path.name: text_of(run, _scene(scene, run), chosen, spacing=spacing, layout=layout)})


def read_trajectory(
    path: str | Path,
    scene: Scene | str | Path | None = None,
    *,
    format: str | None = None,
    units: str | None = None,
    dt: float | None = None,
) -> Trajectory:
    """The run in a file, ours or another's, of a ``scene`` (not needed for "nc").

    ``format``: "lammpstrj" (a text dump with ``id``, ``x`` and better ``vx`` and ``fx``), "extxyz", "traj" (ASE's),
    "csv" or "nc"; None: by the ending. ``units``, where the file does not say: "si", "cgs", "micro", "nano", "metal",
    "real" or "ase". ``dt`` (s): of a time step, or of a frame where steps are not counted, in a file without times.

    The first frame is the start. Bars are inf; what the file has not is nan: velocities are no finite differences,
    crossing times are never known, peak forces are those of samples. ``provenance`` has the file's name and sha256,
    what was ``assumed`` and, where a file has few digits, the ``resolution``. Raises UsageError, in one line, for a
    lost atom or frame, another number of bodies, other units or a start that is not the scene's.
    """
    from dem_bridge.exports.trajectories import format_of

    path = Path(path)
    chosen = format_of(path, format)
    if chosen == "nc":
        if units is not None or dt is not None:
            raise UsageError(f"{path}: units and dt are not for netCDF, which has them; leave them out")
        return load_trajectory(path)
    if scene is None:
        raise UsageError(
            f"{path}: a file of format {chosen!r} needs the scene that was run, for its contacts and masses"
        )
    from dem_bridge.exports.readers import read

    return read(path, _scene(scene), chosen, units=units, dt=dt)


def compare(run: Trajectory, reference: Trajectory, *, tolerance: float = 0.0) -> Comparison:
    """How far two runs are apart in every quantity that both have, at the times that both have.

    ``tolerance``: what velocities may differ by, of the largest, before they count as diverged (0: any bit). Raises
    UsageError where bodies or times are not shared; nothing is interpolated.

    >>> import dem_bridge as db
    >>> scene = db.Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    >>> coarse, fine = (db.solve(scene, backend="verlet", dt=dt, samples=10, bars=False) for dt in (2e-6, 1e-6))
    >>> found = db.compare(coarse, fine, tolerance=1e-6)
    >>> found.differences[1].quantity, found.differences[1].value < 1e-2, found.divergence is not None
    ('velocity', True, True)
    """
    from dem_bridge.differences import compared

    return compared(run, reference, tolerance)


def _scene(scene: Scene | str | Path | None, run: Trajectory | None = None) -> Scene:
    if scene is not None:
        return scene_of(scene)
    name = None if run is None else run.provenance.get("scene")
    if run is None or name not in shipped_scenes():
        raise UsageError(f"the run is of {name!r}, which is no shipped scene; give the scene that was run")
    return load_scene(name)
