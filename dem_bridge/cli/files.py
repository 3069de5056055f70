"""The commands that read or write files of other programs: ``convert``, ``compare``, ``judge`` and ``export``."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import dem_bridge
from dem_bridge.cli import options, terminal, waiting
from dem_bridge.cli.parameters import (
    ACCURACIES,
    FILE,
    NOT_NEGATIVE,
    POSITIVE,
    Argument,
    Limits,
    Option,
    assignments,
    check_new,
    check_output,
    integers,
    make_command,
    names,
    numbers,
    print_json,
)
from dem_bridge.errors import UsageError
from dem_bridge.foundation.files import check_report_folder, write_whole

if TYPE_CHECKING:
    from dem_bridge.trajectory.trajectory import Trajectory


def _read(path: Path, scene: str | None, settings: dict[str, Any]) -> Trajectory:
    """Read a trajectory; netCDF states its units and times itself."""
    return dem_bridge.read_trajectory(path, scene, **({} if path.suffix.lower() == ".nc" else settings))


def _print_assumptions(path: Path, run: Trajectory) -> None:
    """Print on stderr what the reader of a file had to assume."""
    for sentence in run.provenance.get("assumed", ()):
        click.echo(f"dem-bridge: note: {path.name}: {sentence}", err=True)


@make_command(
    "convert",
    Argument("run", "RUN", FILE),
    replace(options.OUTPUT, help="File to write: .extxyz, .lammpstrj, .csv or .nc.", required=True),
    options.SCENE_OF_FILE,
    options.UNITS,
    options.DT_OF_FILE,
    Option("format", "Format of FILE.", ("nc", "extxyz", "lammpstrj", "csv"), default="by its ending"),
    Option(
        "spacing",
        "Spacing of bodies in a scene without geometry, m.",
        float,
        unit="m",
        limits=POSITIVE,
        default="0.01",
    ),
    Option(
        "layout",
        "Layout of csv: a row per time and body, or a row per time.",
        ("long", "wide"),
        default="long",
        value="long",
    ),
    options.FORCE,
)
def convert(
    run: Path,
    output: Path,
    scene: str | None = None,
    format: str | None = None,
    spacing: float | None = None,
    layout: str = "long",
    force: bool = False,
    **settings: Any,
) -> None:
    """Convert the trajectory file RUN to another format.

    RUN is a .nc, .lammpstrj, .extxyz, .traj or .csv file.
    """
    check_new(output, force)
    with waiting.bar(label=f"{run} is converted"):
        trajectory = _read(run, scene, settings)
        dem_bridge.write_trajectory(trajectory, scene, output, format=format, spacing=spacing, layout=layout)
    _print_assumptions(run, trajectory)
    click.echo(f"written: {output}")


@make_command(
    "compare",
    Argument("first", "A[@DT]", FILE),
    Argument("second", "B[@DT]", FILE),
    options.SCENE_OF_FILE,
    options.UNITS,
    options.DT_OF_FILE,
    Option(
        "tolerance",
        "Allowed difference of velocities, relative to the largest velocity of B; exit code 1 if it is larger.",
        float,
        metavar="R",
        limits=NOT_NEGATIVE,
    ),
)
def compare(
    first: Path, second: Path, scene: str | None = None, tolerance: float | None = None, **settings: Any
) -> None:
    """Compare two trajectory files A and B.

    A file may be given as FILE@DT, with the time step of its run in s. The output has the largest difference of each
    quantity, relative to B, and time and body of the first divergence.
    """
    with waiting.bar(label=f"{first} and {second} are compared"):
        from dem_bridge.formats.readers.read import with_step

        pairs = [with_step(file) for file in (first, second)]
        runs = [_read(path, scene, settings if step is None else settings | {"dt": step}) for path, step in pairs]
        if "dt" in settings:
            _check_ends([run for run, (_, step) in zip(runs, pairs, strict=True) if step is None], settings["dt"])
        from dem_bridge.observables.differences import explained_difference

        explained = explained_difference(*runs)
        comparison = dem_bridge.compare(*runs, tolerance=explained if tolerance is None else tolerance)
    for (path, _), run in zip(pairs, runs, strict=True):
        _print_assumptions(path, run)
    for entry in comparison.differences:
        terminal.say(str(entry))
    for note in (*comparison.unknown, *comparison.notes):
        terminal.say(f"note: {note}")
    compared = any(entry.quantity == "velocity" for entry in comparison.differences)
    least = explained if tolerance is None else tolerance
    limit = f"differ by more than {least:.3g} of the largest velocity" if least else "differ"
    if not compared:
        terminal.say("velocities are not compared")
    elif comparison.undecided:
        terminal.say(
            f"undecided: the interpolation error decides whether velocities {limit}; sample both at the same times"
        )
    elif comparison.divergence is None:
        terminal.say(f"velocities do not {limit} at any of {comparison.samples} samples")
    else:
        time, body = comparison.divergence
        terminal.say(f"velocities first {limit} at {time:.9g} s, body {body}")
        if not tolerance:
            terminal.say("give --tolerance to see when the difference matters")
    if tolerance is None:
        terminal.say(f"the uncertainties of both runs and round-off explain {explained:.3g}")
        terminal.say("no --tolerance was given: the exit code is 0 whatever the difference")
        return
    decided = compared and not comparison.undecided
    sys.exit(1 if comparison.divergence is not None else 0 if decided else 4)


def _check_ends(runs: list[Trajectory], dt: float) -> None:
    """Raise UsageError if one time step was used for two files, whose times then contradict the scene."""
    notes = [(run.time[-1], run.provenance.get("assumed", ())) for run in runs]
    ends = [end for end, assumed in notes if any(note.startswith("times are step numbers") for note in assumed)]
    if len(ends) == 2 and abs(ends[0] - ends[1]) > 1e-6 * max(ends):
        raise UsageError(
            f"--dt {dt:g} was given for both files, which then end at {ends[0]:.6g} s and {ends[1]:.6g} s; allowed: the"
            " time step of each file; give A@DT and B@DT"
        )


@make_command(
    "export",
    replace(options.SCENE, metavar="[SCENE]", required=False),
    Option(
        "table",
        "Table to write.",
        (
            "contacts",
            "pair-coeffs",
            "bodies",
            "observables",
            "energy-ledger",
            "stiffness-curve",
            "angles",
            "constants",
        ),
    ),
    Option(
        "lammps_test",
        "Write a unit test of LAMMPS (unittest/granular) into FILE in place of a table, for the step --dt.",
        FILE,
        metavar="FILE.yaml",
    ),
    Option(
        "format",
        "Format of the table.",
        ("csv", "json", "yaml", "md", "tex", "parquet", "lammps", "c"),
        default="by the ending of FILE, else csv",
    ),
    Option("columns", "Columns to write, by their names in csv.", names, metavar="A,B", default="all"),
    replace(options.BACKEND, help="Backend of the run in the table.", default="reference"),
    options.DT,
    options.ACCURACY,
    options.SAMPLES,
    Option("no_run", "Write the table contacts without results of a run.", bool),
    options.GEOMETRY,
    options.TYPES,
    Option(
        "surrogate_radius",
        "Radius of the bodies in the deck, m.",
        float,
        unit="m",
        limits=POSITIVE,
        default="a power of two above the largest overlap",
    ),
    Option("law", "Stiffness law of the table angles.", ("paper", "exact"), default="the scene's law"),
    Option(
        "within",
        "Relative error of the stiffness from which the angle tolerances follow.",
        float,
        metavar="R",
        limits=ACCURACIES,
        default="0.01",
    ),
    Option("angles", "Angles of the table stiffness-curve, degrees.", numbers, metavar="A,B", default="0.1 to 90"),
    Option("radius", "Radius of the cylinders, m.", float, unit="m", limits=POSITIVE, default="the scene's"),
    Option(
        "youngs_modulus",
        "Young's modulus of the cylinders, Pa.",
        float,
        unit="Pa",
        limits=POSITIVE,
        default="the scene's",
    ),
    Option(
        "poissons_ratio",
        "Poisson's ratio of the cylinders.",
        float,
        metavar="NU",
        limits=Limits("a number above -1 and up to 0.5", above=-1.0, at_most=0.5),
        default="the scene's",
    ),
    *options.LAMMPS,
    replace(options.OUTPUT, default="stdout"),
    options.FORCE,
)
def export(
    no_run: bool,
    force: bool,
    scene: str | None = None,
    table: str | None = None,
    lammps_test: Path | None = None,
    format: str | None = None,
    output: Path | None = None,
    **settings: Any,
) -> None:
    """Write a table of SCENE, or SCENE as a unit test of LAMMPS.

    The tables have contacts, bodies, LAMMPS coefficients, results of a run, or contact angles. The table `constants`
    has no SCENE: exact numbers of waves, impacts and damping laws.
    """
    if lammps_test is not None:
        others = {"--table": table, "--format": format, "--output": output, "--no-run": no_run, **settings}
        _export_lammps_test(scene, lammps_test, force, others)
        return
    if table is None:
        raise UsageError(
            "neither --table nor --lammps-test was given; give the table to write, or --lammps-test FILE.yaml"
        )
    if output is not None:
        check_output(scene or "", output, force)
    if no_run:
        settings["with_run"] = False
    with waiting.fraction(f"table {table} of {scene}" if scene else f"table {table}"):
        from dem_bridge.api.files import export_table
        from dem_bridge.formats.tables.render import format_for

        chosen = format_for("csv" if format is None and output is None else format, output, table)
        if chosen == "parquet" and output is None:
            raise click.UsageError("parquet is a binary format and cannot be printed; name a file: -o FILE.parquet.")
        data, content = export_table(scene, table=table, format=chosen, path=output, **settings)
    if chosen in ("csv", "parquet"):  # the other formats contain the notes
        for note in data.notes:
            click.echo(f"dem-bridge: note: {note}", err=True)
    if output is None:
        click.echo(content, nl=False)
    else:
        click.echo(f"written: {output}")


def _export_lammps_test(scene: str | None, file: Path, force: bool, settings: dict[str, Any]) -> None:
    """Write a scene as a unit test of LAMMPS; raise UsageError for options of tables that were given with it."""
    dt = settings.pop("dt", None)
    if scene is None:
        raise UsageError("--lammps-test was given without a scene; give the scene of the test: export SCENE")
    if given := [name for name, value in settings.items() if value]:
        raise UsageError(
            f"--lammps-test was given with {', '.join(given)}; allowed with it: --dt and --force; leave out the rest"
        )
    check_output(scene, file, force)
    with waiting.bar(label=f"unit test of {scene}"):
        dem_bridge.write_lammps_test(scene, file, dt=dt)
    click.echo(f"written: {file}")


@make_command(
    "judge",
    Argument("files", "[FILE[@DT]...]", many=True),
    replace(
        options.SCENE_OF_FILE,
        help="Scene of the files: name of a shipped scene or a scene file; required, except for a unit test of LAMMPS.",
    ),
    Option(
        "command",
        "Run a code in place of reading files, such as 'mycode {scene} {dt} {out.csv}'; {scene} is JSON, {scene.toml}"
        " TOML, {deck} a LAMMPS deck.",
        metavar="WORDS",
    ),
    Option(
        "tolerance",
        "Permissible error, relative to the largest value of each quantity.",
        float,
        metavar="T",
        limits=ACCURACIES,
        default="the cause decides the outcome",
    ),
    replace(
        options.DT_OF_FILE,
        help="Time step of a single file, or time steps of the command, s.  [default of the command: four steps]",
        kind=numbers,
        metavar="S[,S...]",
    ),
    replace(options.TIME_LIMIT, help="Time limit of each run of a command or a deck, s."),
    Option(
        "columns",
        'Headings of all columns in their order, or HEADING=MEANING,..., such as "ch1=velocity 3 [mm/s]".',
        assignments,
        metavar="A,B,...",
    ),
    replace(
        options.UNITS,
        help="Units that the files do not state: si, metal, ... or QUANTITY=UNIT,..., such as time=ms.",
        kind=assignments,
        metavar="UNITS",
        default="",
    ),
    Option("bodies", "Body of each column, from 0, the struck end.", integers, metavar="I,J,..."),
    Option("axis", "Axis along which the chain lies.", ("x", "y", "z")),
    replace(options.VARIABLES, help="Value of a variable of a deck, as LAMMPS accepts it by -var; can be repeated."),
    *options.LAMMPS,
    replace(options.VERBOSE, name="every", help="Print every line of the answer, not the most needed 15."),
    options.AS_JSON,
    replace(options.FOLDER, help="Write the page (index.html), verdicts.json, tables and figures into DIR."),
    replace(options.JUNIT_FILE, help="File for the verdicts, JUnit XML."),
    replace(options.FORCE, help="Replace the file of --junit if it exists."),
)
def judge(
    files: tuple[str, ...],
    scene: str | None = None,
    every: bool = False,
    as_json: bool = False,
    folder: Path | None = None,
    junit_file: Path | None = None,
    force: bool = False,
    **settings: Any,
) -> None:
    """Judge FILES of any code against the reference solution of their scene.

    Each FILE holds samples of one run: FILE, or FILE@DT with the time step of the run in s. Several files with
    different time steps give the order of convergence; the one with the finest step decides the outcome. A FILE that is
    a LAMMPS input script is run as it is; of a unit test of LAMMPS (.yaml) the recorded states are judged. With
    --command a code is run in place of reading files.

    The exit code is 0 for PASS, 1 for FAIL, 3 for a run that failed and 4 for UNDECIDED.
    """
    if folder is not None:
        check_report_folder(folder)
    if junit_file is not None:
        check_new(junit_file, force)
    if isinstance(units := settings.get("units"), list):
        settings["units"] = ",".join(units)
    if not files and "command" not in settings:
        raise UsageError("no FILE[@DT] was given; give files of a code, a LAMMPS deck, or --command")
    if len(steps := settings.get("dt", ())) == 1 and "command" not in settings:
        settings["dt"] = steps[0]
    if "variables" in settings:
        settings["variables"] = dict(settings["variables"])
    waiting.announce_compiling("taylor")
    with waiting.bar(label=f"the reference solution of {scene}, and fits to {', '.join(files) or 'the runs'}"):
        from dem_bridge.judging.sentences import COLUMNS_OF_NAMES, notes_of, text_of

        judgement = dem_bridge.judge(list(files), scene, **settings)
    if folder is not None:
        judgement.save(folder)
    if junit_file is not None:
        from dem_bridge.verification.records import junit

        write_whole(junit_file.parent, {junit_file.name: junit(judgement.study.verdicts)})
    if as_json:
        print_json(judgement.as_json())
    else:
        click.echo(text_of(judgement, every=every))
        if folder is not None:
            click.echo(f"{'written':{COLUMNS_OF_NAMES}}{folder / 'index.html'}")
        for sentence in notes_of(judgement):
            click.echo(f"dem-bridge: note: {sentence}", err=True)
    sys.exit(judgement.exit_code)
