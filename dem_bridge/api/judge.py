"""The public functions that judge files of other codes, and check input scripts and scenes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeGuard, cast

from dem_bridge.errors import UsageError
from dem_bridge.formats.readers.read import File, with_step
from dem_bridge.foundation.arguments import check_arguments
from dem_bridge.foundation.script_files import is_deck, is_unit_test_file
from dem_bridge.lmp.engine import Engine
from dem_bridge.scene.file import scene_of
from dem_bridge.scene.scene import Scene

if TYPE_CHECKING:
    from dem_bridge.judging.check.answer import Check
    from dem_bridge.judging.judgement import Judgement


def judge(
    files: File | Sequence[File] = (),
    scene: Scene | str | Path | None = None,
    *,
    command: str | Sequence[str] | None = None,
    tolerance: float | None = None,
    dt: float | Sequence[float] | None = None,
    time_limit: float = 600.0,
    columns: Mapping[str, str] | Sequence[str] | None = None,
    units: Mapping[str, str] | str | None = None,
    bodies: Sequence[int] | None = None,
    axis: str | None = None,
    variables: Mapping[str, str] | None = None,
    engine: Engine | None = None,
    lmp: str | Path | None = None,
    lmp_args: str | None = None,
    python: str | Path | None = None,
    ranks: int | None = None,
) -> Judgement:
    """Judge files of any code against the reference solution of their scene, at the times of the files.

    Parameters
    ----------
    files : str, Path, (path, dt) or sequence of these
        Files of one scene: CSV, text columns, npz, netCDF, LAMMPS or LIGGGHTS dump, extended XYZ, ASE or VTK. A string
        may end in the time step of its run, "FILE@DT" in s. All files with a time step give the order of convergence;
        the one with the finest step decides the outcome. A LAMMPS input script is run as it is, and what in it limits
        the accuracy is listed. Of a unit test of LAMMPS (.yaml) the recorded states are judged.
    scene : Scene, str or Path
        Scene of the files, name of a shipped scene or path of a scene file. A unit test of LAMMPS needs none: its
        commands state it.
    command : str or sequence of str, optional
        A foreign code to run in place of files, such as "mycode {scene} {dt} {out.csv}". The placeholders are
        ``{scene}`` or ``{scene.json}``, ``{scene.toml}``, ``{deck}`` (a LAMMPS deck), ``{dt}`` in s, and ``{out}`` or
        ``{out.ENDING}``, the file that the code writes. No shell is involved.
    tolerance : float, optional
        Permissible error of each quantity, relative to its largest value. None: the outcome is PASS if time step and
        digits explain all errors, FAIL if a cause of them can be named, and UNDECIDED otherwise.
    dt : float or sequence of float, optional
        Time step of a single file, or time steps of the command, s. The default for a command is four steps, the
        largest of which resolves the stiffest contact.
    time_limit : float, optional
        Time limit of each run of a command or a deck, s.
    columns : mapping or sequence of str, optional
        Meaning of headings, such as ``{"ch1": "velocity 3 [mm/s]"}``, or the headings of all columns in their order.
    units : str or mapping, optional
        Unit style of files that do not state their units, or the unit of each quantity, such as ``{"time": "ms"}``.
    bodies : sequence of int, optional
        Body of each column, from 0, the struck end, if the files do not state it.
    axis : {"x", "y", "z"}, optional
        Axis along which the chain lies.
    variables : mapping of str to str, optional
        Values of variables of decks, as LAMMPS accepts them by ``-var``.
    engine : Engine, optional
        Which LAMMPS runs decks, in place of ``lmp``, ``lmp_args``, ``python`` and ``ranks``, which are as in
        :func:`solve`.

    Returns
    -------
    Judgement
        A mapping with outcome, error, first_divergence, order, floor, cause, alternatives, where, evidence,
        recognised, step, alternative_causes, faults and needed, which are attributes, too. Errors, scales and
        uncertainties are in SI units.

    Raises
    ------
    UsageError
        If a file cannot be read, or its values cannot be judged.
    RunBroken
        If a run of the command or of a deck fails.
    UnsupportedScene
        If there is no reference solution of the scene.

    Examples
    --------
    >>> import dem_bridge as db, tempfile
    >>> pair = db.Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     files = []
    ...     for dt in (2e-7, 1e-7):
    ...         run = db.solve(pair, backend="verlet", dt=dt, uncertainty=False)
    ...         db.write_trajectory(run, pair, f"{folder}/{dt}.csv", layout="wide")
    ...         files.append((f"{folder}/{dt}.csv", dt))
    ...     judgement = db.judge(files, pair, tolerance=1e-3)
    >>> judgement.outcome, f"{judgement.order['velocity']['value']:.2f}"
    ('PASS', '2.00')
    """
    check_arguments(judge, locals())
    paths = [with_step(file) for file in (files if _is_several(files) else [cast(File, files)])]
    scene = _scene_of_files(scene, [path for path, _ in paths])
    reading = {"columns": columns, "units": units, "bodies": bodies, "axis": axis}
    if command is not None:
        if paths:
            raise UsageError(f"command and {len(paths)} files were given; give one or the other")
        from dem_bridge.judging.beside import judge_command

        steps = [dt] if isinstance(dt, int | float) else dt
        return judge_command(scene, command, steps, tolerance=tolerance, time_limit=time_limit, **reading)
    if dt is not None:
        if not isinstance(dt, int | float) or len(paths) != 1:
            raise UsageError(f"dt = {dt!r} was given for {len(paths)} files; give each file its own time step, FILE@DT")
        paths = [with_step((paths[0][0], dt))]
    decks = [path for path, _ in paths if is_deck(path)]
    for path, step in paths:
        if path in decks and step is not None:
            raise UsageError(f"{path} is a LAMMPS deck, which has its own time step; leave out @{step:g}")
    others = [(path, step) for path, step in paths if path not in decks]
    lammps = Engine.named(engine, lmp=lmp, lmp_args=lmp_args, python=python, ranks=ranks)
    if not decks and (variables or lammps):
        raise UsageError(f"{'variables were' if variables else 'a LAMMPS was'} given, but no file is a LAMMPS deck")
    if not decks:
        from dem_bridge.judging.records import judge_files

        return judge_files(scene, others, tolerance=tolerance, **reading)
    from dem_bridge.judging.beside import judge_decks

    return judge_decks(
        scene,
        others,
        decks,
        tolerance=tolerance,
        time_limit=time_limit,
        engine=lammps,
        variables=variables,
        **reading,
    )


def _scene_of_files(scene: Scene | str | Path | None, paths: Sequence[Path]) -> Scene:
    """Return the scene of some files: the one that is given, or that of a unit test; UsageError without one."""
    if scene is None and (test := next(filter(is_unit_test_file, paths), None)):
        from dem_bridge.api.scenes import scene_from_deck

        scene = scene_from_deck(test)
    if scene is None:
        if deck := next(filter(is_deck, paths), None):
            raise UsageError(f"no scene was given, and {deck} is a LAMMPS input script; write: dem-bridge check {deck}")
        raise UsageError("no scene was given; give the scene of the files, a shipped name or the path of a scene file")
    return scene_of(scene)


def _is_several(files: File | Sequence[File]) -> TypeGuard[Sequence[File]]:
    """Return False for a single file, which a pair of a path and a time step is, too."""
    pair = isinstance(files, tuple) and len(files) == 2 and not isinstance(files[1], str | Path | tuple)
    return not (pair or isinstance(files, str | Path))


def check(
    file: str | Path | Scene,
    *,
    accuracy: float = 1e-3,
    dt: float | None = None,
    variables: Mapping[str, str] | None = None,
    engine: Engine | None = None,
    lmp: str | Path | None = None,
    lmp_args: str | None = None,
    python: str | Path | None = None,
    ranks: int | None = None,
    time_limit: float = 600.0,
    progress: Callable[[float, int, str], None] | None = None,
    announce: Callable[[float | None], None] | None = None,
) -> Check:
    """Check a LAMMPS input script or unit test, or the deck of a scene: law, step, and what to write.

    A copy of the script runs with one more dump. The law is right if LAMMPS differs from our code at the same step by
    round-off only. The step is right if velocities are within ``accuracy`` of the reference solution. What cannot be
    read as a scene is named with its line; the step is then judged by LAMMPS at finer steps alone.

    Parameters
    ----------
    file : str, Path or Scene
        LAMMPS input script, unit test of LAMMPS (unittest/granular, .yaml), scene file (.toml), name of a shipped
        scene, or Scene. Of a unit test the recorded states are judged, too, and the test is executed as by LAMMPS.
    accuracy : float
        Permissible error of velocities, relative to the largest velocity of all bodies and samples.
    dt : float, optional
        Time step of the deck of a scene, s; the default is a fiftieth of the shortest contact time.
    variables : mapping of str to str, optional
        Values of variables of a script, as LAMMPS accepts them by ``-var``.
    engine : Engine, optional
        Which LAMMPS, in place of ``lmp``, ``lmp_args``, ``python`` and ``ranks``, which are as in :func:`solve`.
    time_limit : float
        Time limit of each run of LAMMPS, s.
    progress : callable, optional
        Callback with the part that is done, 1, and what runs.
    announce : callable, optional
        Callback with the expected time of the check in s, before it begins; None where it cannot be known.

    Returns
    -------
    Check
        A mapping with outcome ("PASS", "FAIL", "UNDECIDED" or "BROKEN"), law, step, engine, recorded (None unless
        the file is a unit test), plausibility and advice, the lines to write. ``print`` shows them in eight lines;
        :meth:`save` writes a page.

    Raises
    ------
    SceneError
        If a file is neither an input script nor a scene.
    UsageError
        If a setting does not fit.
    BackendUnavailable
        If there is no LAMMPS or it lacks a style.

    Examples
    --------
    >>> import dem_bridge as db
    >>> pair = db.Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    >>> answer = db.check(pair, dt=4e-6)
    >>> answer.outcome, answer.law["outcome"], answer.step["outcome"]
    ('FAIL', 'PASS', 'FAIL')
    """
    check_arguments(check, locals())
    from dem_bridge.judging.check.checked import check_file

    return check_file(
        file,
        accuracy=accuracy,
        dt=dt,
        variables=variables,
        engine=Engine.named(engine, lmp=lmp, lmp_args=lmp_args, python=python, ranks=ranks),
        time_limit=time_limit,
        progress=progress,
        announce=announce,
    )
