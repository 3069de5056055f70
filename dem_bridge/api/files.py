"""The public functions for files of other programs: tables are written; trajectories are written, read and compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dem_bridge.errors import UsageError
from dem_bridge.foundation.arguments import check_arguments
from dem_bridge.foundation.files import check_file, write_whole
from dem_bridge.scene.file import load_scene, parse_scene, scene_of, shipped_scenes
from dem_bridge.scene.file.write import scene_toml
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory, load_trajectory

if TYPE_CHECKING:
    from dem_bridge.formats.tables.table import Table
    from dem_bridge.observables.differences import Comparison


def export(
    scene: Scene | str | Path | None = None,
    *,
    table: str,
    format: str | None = None,
    path: str | Path | None = None,
    columns: Sequence[str] | None = None,
    **settings: Any,
) -> str | bytes:
    """Return a table of a scene as text or bytes, and write it to a file if ``path`` is given.

    Parameters
    ----------
    scene : Scene, str, Path or None
        Scene, name of a shipped scene, or path of a scene file; None for the table "constants", which has no scene.
    table : {"contacts", "pair-coeffs", "bodies", "observables", "energy-ledger", "stiffness-curve",
        "angles", "constants"}
        Name of the table; see :func:`table_of`.
    format : {"csv", "json", "yaml", "parquet", "md", "tex", "lammps", "c"}, optional
        "csv", "json", "yaml" and "parquet" keep every digit. "md" and "tex" (booktabs, siunitx) are rounded and have
        units in the headings. "lammps", for the table pair-coeffs only, is read by the LAMMPS command ``include``;
        "c", for the table constants only, is a header for C and C++. The default follows from the ending of ``path``.
    path : str or Path, optional
        File to write.
    columns : sequence of str, optional
        Names of the columns to keep, in this order, as in the CSV format. The default is all columns.
    **settings
        Settings of the table and of its run; see :func:`table_of`.

    Returns
    -------
    str or bytes
        Contents of the file; bytes for the format "parquet".

    Raises
    ------
    UsageError
        If a table, format, column or setting is unknown or does not fit. A run in a table raises the errors of
        :func:`dem_bridge.solve`.

    Examples
    --------
    >>> import dem_bridge as db
    >>> print(db.export("decelerating-40", table="stiffness-curve", format="md", angles=[2.0, 30.0, 90.0],
    ...                 columns=["angle_deg", "paper_over_exact"]).split("*")[0].strip())
    ### Stiffness against angle for the cylinders of decelerating-40
    <BLANKLINE>
    | angle (°) | eq. 3.1 over exact |
    | ---: | ---: |
    | 2 | 1.1777 |
    | 30 | 1.0068 |
    | 90 | 1.0000 |
    """
    check_arguments(export, locals())
    return export_table(scene, table=table, format=format, path=path, columns=columns, **settings)[1]


def write_lammps_test(
    scene: Scene | str | Path, path: str | Path, *, dt: float | None = None, replace: bool = True
) -> Path:
    """Write a scene as a unit test of LAMMPS, in the form of its ``unittest/granular``.

    The recorded states are those of the reference solution, and ``epsilon`` is the error of the time step, so that the
    test passes with every LAMMPS that is right. No LAMMPS is needed. The states are at times at which no velocity is
    tiny but not zero, because the test program compares relative to each component; where there are no such times, the
    test has positions only. For a collision of two bodies, or of a body with a wall, the test has the formula of the
    restitution or of the largest overlap. The tag "unvetted" says that the error is not that of the step, so that
    epsilon may not hold elsewhere.

    Parameters
    ----------
    scene : Scene, str or Path
        Scene, name of a shipped scene or path of a scene file.
    path : str or Path
        File to write, .yaml.
    dt : float, optional
        Largest time step, s; the default is 1/1000 of the shortest contact time.
    replace : bool
        Whether a file that exists is replaced; False: it is an error.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    UnsupportedScene
        If LAMMPS, our velocity-Verlet code or the reference cannot do the scene, or a test cannot contain it.

    Examples
    --------
    >>> import dem_bridge as db, tempfile
    >>> pair = db.Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = db.write_lammps_test(pair, f"{folder}/dem02-pair.yaml", dt=1e-7)
    ...     text = file.read_text()
    ...     db.scene_from_deck(file).n_body
    2
    >>> [line for line in text.splitlines() if line.startswith(("epsilon", "analytic_model"))]
    ['epsilon: 3.3e-06', 'analytic_model: hertz_peak']
    """
    check_arguments(write_lammps_test, locals())
    from dem_bridge.judging.unit_test.written import unit_test_of

    path = Path(path)
    check_file(path)
    test = unit_test_of(scene_of(scene), dt=dt, name=path.stem)
    write_whole(path.parent, {path.name: test.text}, replace=replace)
    return path


def export_table(
    scene: Scene | str | Path | None,
    *,
    table: str,
    format: str | None = None,
    path: str | Path | None = None,
    columns: Sequence[str] | None = None,
    **settings: Any,
) -> tuple[Table, str | bytes]:
    """Return a table as data and as :func:`export` returns it, and write it if ``path`` is given."""
    from dem_bridge.formats.tables.render import format_for, render

    path = None if path is None else Path(path)
    chosen = format_for(format, path, table)
    if path is not None:
        check_file(path)
    data = table_of(scene, table, **settings)
    if columns is not None:
        data = data.only(columns)
    content = render(data, chosen)
    if path is not None:
        write_whole(path.parent, {path.name: content})
    return data, content


def table_of(scene: Scene | str | Path | None, table: str, *, with_run: bool = True, **settings: Any) -> Table:
    """Return a table of a scene as data.

    Parameters
    ----------
    scene : Scene, str, Path or None
        Scene, name of a shipped scene, or path of a scene file; None for the table "constants", which has no scene.
    table : {"contacts", "pair-coeffs", "bodies", "observables", "energy-ledger", "stiffness-curve",
        "angles", "constants"}
        "contacts" lists geometry, stiffness, LAMMPS coefficients, predictions and results of each contact;
        "pair-coeffs" the coefficients of each pair of atom types for ``pair_style granular``; "bodies" masses, shapes
        and materials; "observables" arrival, residence time, speed and peak velocity of the front at each body;
        "energy-ledger" the energy that each contact stores and dissipates, with the rest of the balance in notes;
        "stiffness-curve" the stiffness of two crossed cylinders against their angle; "angles" the angle that gives the
        stiffness of each contact; "constants" exact numbers of waves, impacts and damping laws, each with a second
        computation.
    with_run : bool
        False for the table "contacts" without results of a run.
    **settings
        For tables with results ("contacts", "observables", "energy-ledger"): keywords of :func:`dem_bridge.solve`; the
        default backend is "reference". For tables about a deck ("contacts", "bodies", "pair-coeffs"): ``geometry``,
        ``types`` and ``surrogate_radius`` (m). For "stiffness-curve": ``angles`` (degrees). For "angles": ``law`` and
        ``within``. For the last two also ``radius`` (m), ``youngs_modulus`` (Pa) and ``poissons_ratio`` of the
        cylinders; the default is the scene's first crossed pair.

    Returns
    -------
    Table
        Table with the attributes ``columns``, ``rows`` and ``notes`` and the method ``to_pandas()``.

    Raises
    ------
    UsageError
        If a table or setting is unknown or does not fit.

    Examples
    --------
    >>> import dem_bridge as db
    >>> db.table_of("decelerating-40", "contacts", with_run=False).to_pandas()["angle_deg"].round(3)[1:4].tolist()
    [2.0, 2.054, 2.112]
    """
    check_arguments(table_of, locals())
    from dem_bridge.api.runs import solve
    from dem_bridge.formats.tables.catalogue import WITHOUT_SCENE, table_named

    build, needs_run, names = table_named(table)
    if (scene is None) != (table in WITHOUT_SCENE):
        given = "needs a scene, and none was given" if scene is None else f"has no scene, and {scene!s:.40} was given"
        allowed = "the name of a shipped scene or a scene file" if scene is None else "no scene"
        raise UsageError(f"table {table!r} {given}; allowed: {allowed}")
    scenes = () if scene is None else (scene_of(scene),)
    if needs_run and not with_run:
        raise UsageError(f"table {table!r} consists of results of a run; leave out with_run=False (--no-run)")
    table_settings = {key: settings[key] for key in names if key in settings}
    if needs_run is None or not with_run:
        unknown = [key for key in settings if key not in names]
        if unknown:
            allowed = ", ".join(names) or "none"
            raise UsageError(f"table {table!r} without a run has no setting {unknown[0]!r}; allowed: {allowed}")
        return build(*scenes, **table_settings)
    run = solve(*scenes, **({"backend": "reference"} | settings))
    return build(*scenes, run, **table_settings)


#: key of a provenance whose value is the text of the scene file
_SCENE_FILE = "scene_file"


def write_trajectory(
    run: Trajectory,
    scene: Scene | str | Path | None,
    path: str | Path,
    *,
    format: str | None = None,
    spacing: float | None = None,
    layout: str = "long",
) -> None:
    """Write a run for other programs, in SI units with all digits of every number.

    Displacements, velocities and contact forces that are read back are the same to the last bit. Only the format "nc"
    keeps peak forces, crossing times, uncertainties and provenance.

    Parameters
    ----------
    run : Trajectory
        Run to write.
    scene : Scene, str, Path or None
        Scene of the run; None for the scene that the run's provenance holds or, if it is a shipped one, names.
    path : str or Path
        File to write.
    format : {"extxyz", "lammpstrj", "csv", "nc"}, optional
        Extended XYZ, a LAMMPS text dump, CSV or netCDF; the default follows from the ending of ``path``.
    spacing : float, optional
        Distance between bodies in m, for a scene without a geometry; the default is 0.01.
    layout : {"long", "wide"}
        Layout of CSV: "long" has a row per time and body, "wide" a row per time.

    Raises
    ------
    UsageError
        If the format is unknown, the run is not one of the scene, or a setting does not fit.

    Examples
    --------
    >>> import dem_bridge as db, tempfile
    >>> scene = db.Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    >>> run = db.solve(scene, backend="verlet", dt=1e-6, samples=10, uncertainty=False)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     db.write_trajectory(run, scene, f"{folder}/pair.lammpstrj")
    ...     again = db.read_trajectory(f"{folder}/pair.lammpstrj", scene)
    >>> bool((again.velocity == run.velocity).all()), again.uncertainty["velocity"]
    (True, inf)
    """
    check_arguments(write_trajectory, locals())
    from dem_bridge.formats.writers import format_of, text_of

    path = Path(path)
    chosen = format_of(path, format)
    if chosen == "traj":
        raise UsageError(
            f"{path}: the format 'traj' of ASE can be read, but not written; allowed: extxyz (which ASE reads),"
            " lammpstrj, csv, nc"
        )
    check_file(path)
    if chosen == "nc":
        _with_scene(run, scene).save(path)
        return
    write_whole(
        path.parent, {path.name: text_of(run, scene_of_run(scene, run), chosen, spacing=spacing, layout=layout)}
    )


def read_trajectory(
    path: str | Path,
    scene: Scene | str | Path | None = None,
    *,
    format: str | None = None,
    units: str | None = None,
    dt: float | None = None,
) -> Trajectory:
    r"""Read a run from a file of dem_bridge or of another program.

    The first frame is the start of the scene. Quantities that the file does not contain are nan: velocities are not
    computed by finite differences, and crossing times are unknown. Peak forces are the largest of the samples, and
    uncertainties are inf.

    Parameters
    ----------
    path : str or Path
        File to read.
    scene : Scene, str or Path, optional
        Scene of the run; not needed for the format "nc".
    format : {"lammpstrj", "extxyz", "traj", "csv", "nc"}, optional
        Format of the file; it follows from the content in any case, and "nc" requires a file of dem_bridge.
    units : {"si", "cgs", "micro", "nano", "metal", "real", "ase"}, optional
        Units of a file that does not state them; the default is "ase" for the format "traj" and "si" for others.
    dt : float, optional
        Time step in s, for a file with step numbers and no times; without step numbers, the time between frames.

    Returns
    -------
    Trajectory
        The run. Its ``provenance`` has the name and the sha256 of the file, the assumptions (``assumed``), and the
        rounding error of a file with few digits (``resolution``).

    Raises
    ------
    UsageError
        If an atom or a frame is missing, or the number of bodies, the units or the initial velocities are not those of
        the scene.

    Examples
    --------
    >>> import dem_bridge as db, tempfile
    >>> scene = db.Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    >>> lines = ["time_s,x_0_m,x_1_m,velocity_0_m_per_s,velocity_1_m_per_s", "0,0,0.02,0.8,0", "1e-4,1e-5,0.02,0,0.7"]
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(folder, "pair.csv").write_text("\n".join(lines))
    ...     run = db.read_trajectory(f"{folder}/pair.csv", scene)
    >>> run.velocity[1].tolist(), run.provenance["assumed"][0]
    ([0.0, 0.7], 'displacements are relative to the first frame')
    """
    check_arguments(read_trajectory, locals())
    from dem_bridge.formats.readers.arrays import own_netcdf
    from dem_bridge.formats.readers.trajectories import read
    from dem_bridge.formats.writers import SUFFIXES, format_of

    path = Path(path)
    chosen = format_of(path, format) if format is not None else SUFFIXES.get(path.suffix.lower(), "by content")
    is_own = own_netcdf(path)
    if is_own or format == "nc" or (chosen == "nc" and (is_own is None or scene is None)):
        if units is not None or dt is not None:
            raise UsageError(
                f"{path}: units and dt do not apply to netCDF, which has SI units and times; leave them out"
            )
        return load_trajectory(path)
    if scene is None:
        raise UsageError(
            f"{path}: no scene was given, but a file of another program has no contacts and masses; give the scene of"
            " this run (--scene)"
        )
    return read(path, scene_of_run(scene), chosen, units=units, dt=dt)


def compare(run: Trajectory, reference: Trajectory, *, tolerance: float = 0.0) -> Comparison:
    """Compare two runs at their common sample times, quantity by quantity.

    If few sample times are common, the run with more samples is interpolated at the times of the other (Hermite), and
    the error of the interpolation is stated.

    Parameters
    ----------
    run : Trajectory
        Run to compare.
    reference : Trajectory
        Run to compare with; differences are relative to its largest values.
    tolerance : float
        Difference of velocities, relative to the largest velocity of ``reference``, beyond which the runs count as
        diverged; 0 counts any difference.

    Returns
    -------
    Comparison
        Differences of the quantities that both runs have, and the time and body of the first divergence.

    Raises
    ------
    UsageError
        If the runs have different numbers of bodies or no common interval of time.

    Examples
    --------
    >>> import dem_bridge as db
    >>> scene = db.Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    >>> coarse, fine = (db.solve(scene, backend="verlet", dt=dt, samples=10, uncertainty=False) for dt in (2e-6, 1e-6))
    >>> comparison = db.compare(coarse, fine, tolerance=1e-6)
    >>> velocity = comparison.differences[1]
    >>> velocity.quantity, velocity.value < 1e-2, comparison.divergence is not None
    ('velocity', True, True)
    """
    check_arguments(compare, locals())
    from dem_bridge.observables.differences import compare_runs

    return compare_runs(run, reference, tolerance)


def _with_scene(run: Trajectory, scene: Scene | str | Path | None) -> Trajectory:
    """Return a run whose provenance holds the text of its scene file, unless the scene is shipped or no file can."""
    if scene is None or (known := scene_of(scene)).law is not None or known.name in shipped_scenes("all"):
        return run
    return replace(run, provenance={**run.provenance, _SCENE_FILE: scene_toml(known)})


def scene_of_run(scene: Scene | str | Path | None, run: Trajectory | None = None) -> Scene:
    """Return the scene, or without one the scene in the run's provenance: its text, or the name of a shipped one."""
    if scene is not None:
        return scene_of(scene)
    name = None if run is None else run.provenance.get("scene")
    if run is not None and isinstance(text := run.provenance.get(_SCENE_FILE), str):
        return parse_scene(text, where=f"scene of {name}")
    if run is None or name not in shipped_scenes("all"):
        raise UsageError(f"the run is of the scene {name!r}, which is not a shipped scene; give the scene (--scene)")
    return load_scene(name)
