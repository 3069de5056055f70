"""The command line: parse the words, call the public functions, print their results.

Results go to stdout, progress to stderr and only on a terminal. Large packages are imported only by the commands that
need them. Exit codes: 0 all checks pass, 1 a check failed, 2 wrong use or bad scene, 3 a run broke, 4 undecided.
"""

from __future__ import annotations

import gc
import json
import os
import select
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import dem_bridge
from dem_bridge.cli import terminal
from dem_bridge.cli.check import check
from dem_bridge.cli.demo import demo, show
from dem_bridge.cli.files import compare, convert, export, judge
from dem_bridge.cli.options import check_new, check_output, print_json, with_options
from dem_bridge.cli.regress import regress
from dem_bridge.cli.scene_files import import_group, new, schema
from dem_bridge.cli.store import store_group
from dem_bridge.cli.studies import study as study_group
from dem_bridge.errors import BlockedScript, DemBridgeError, UnsupportedScene, UsageError, one_line
from dem_bridge.foundation.files import FILES_BELOW, write_whole

if TYPE_CHECKING:
    from dem_bridge.scene.scene import Scene
    from dem_bridge.trajectory.trajectory import Trajectory


#: error of velocities, relative to the largest, of which a run warns
_WORTH_A_WARNING = 0.01
#: exit code if the reader of the output ended, as of a program that SIGPIPE stops
PIPE_CLOSED = 141


class _Group(click.Group):
    """Print every error of dem_bridge as one line and end with its exit code, without a traceback.

    An input script that cannot be read has a line for each of its commands that cannot.
    """

    def make_context(self, *args: Any, **settings: Any) -> click.Context:
        """Read the words; a Ctrl-C meanwhile ends the program as later, where click ends it as a check that failed."""
        try:
            return super().make_context(*args, **settings)
        except KeyboardInterrupt:
            click.echo("dem-bridge: interrupted; nothing was run", err=True)
            raise SystemExit(130) from None

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command and turn errors into exit codes."""
        try:
            with terminal.ending_in_order():
                return super().invoke(ctx)
        except UnsupportedScene as error:
            text, code = f"NOT_RUN: {error}", 2
        except BlockedScript as error:
            text, code = str(error), error.exit_code
            for line in text.splitlines()[:-1]:
                click.echo(f"dem-bridge: {line}", err=True)
            text = text.splitlines()[-1]
        except DemBridgeError as error:
            text, code = str(error), error.exit_code
        except BrokenPipeError as error:
            if not output_is_closed():
                raise
            _discard_output()
            raise SystemExit(PIPE_CLOSED) from error
        except click.UsageError as error:
            command = error.ctx.command_path if error.ctx else "dem-bridge"
            text, code = f"{error.format_message()} See: {command} --help", 2
        except (OSError, ArithmeticError, MemoryError) as error:
            text, code = f"{type(error).__name__}: {error}; the run was stopped", 3
            if isinstance(error, FileNotFoundError) and not _has_folder():
                text, code = "the working folder was removed; change to a folder that exists", 2
        except KeyboardInterrupt as error:  # with words where a campaign ended in order
            text, code = str(error) or "interrupted; the run was stopped; a second call uses what was finished", 130
        click.echo(f"dem-bridge: {one_line(text)}", err=True)
        ctx.exit(code)


@click.group(cls=_Group, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(dem_bridge.__version__, prog_name="dem-bridge")
@click.option(
    "--files-below",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Folder below which the files must be that a scene or a deck names.  [default: its own folder]",
)
@click.pass_context
def main(ctx: click.Context, files_below: Path | None) -> None:
    """Verify simulations of one-dimensional granular chains against LAMMPS.

    SCENE is the name of a shipped scene (see `dem-bridge scenes`) or the path of a scene file (.toml).
    """
    if files_below is not None:
        before = dict(os.environ)
        os.environ[FILES_BELOW] = str(files_below.absolute())
        ctx.call_on_close(lambda: os.environ.update(before) if FILES_BELOW in before else os.environ.pop(FILES_BELOW))


@with_options("scenes")
def scenes(as_json: bool) -> None:
    """List the shipped scenes."""
    shipped = [dem_bridge.load_scene(name) for name in dem_bridge.shipped_scenes("all")]
    if not as_json:
        terminal.print_scenes(shipped)
        return
    fields = {"name": "name", "bodies": "n_body", "contacts": "n_contact", "duration": "duration"}
    fields |= {"description": "description", "hash": "content_hash"}
    print_json([{key: getattr(scene, field) for key, field in fields.items()} for scene in shipped])


@with_options("run")
def run(
    scene: str, as_json: bool, force: bool, backend: str | None = None, output: Path | None = None, **settings: Any
) -> None:
    """Solve SCENE with one backend.

    The output is a summary of the run with uncertainties.
    """
    if backend is None and "accuracy" not in settings:
        raise click.UsageError("Missing option '--backend', or '--accuracy', for which the cheapest backend is chosen.")
    if output is not None:
        from dem_bridge.formats.writers import format_of

        check_output(scene, output, force)
        format_of(output)
    with terminal.fraction(f"{scene} by {backend or 'the cheapest backend'}"):
        result = dem_bridge.solve(scene, backend=backend, **settings)
    _warn(result)
    _warn_of_error(scene, result)
    if output is not None:
        dem_bridge.write_trajectory(result, scene, output)
    summary = _summary(result)
    if as_json:
        print_json(summary)
        return
    if backend is None:
        click.echo(f"{'cheapest backend':28} {summary['backend']} (for the reasons: dem-bridge plan)")
    for name, text in (*_summary_lines(summary), *_step_lines(dem_bridge.load_scene(scene), result, summary)):
        click.echo(f"{name:28} {text}")
    if output is not None:
        click.echo(f"{'written':28} {output}")


@with_options("deck")
def deck(scene: str, folder: Path, force: bool, **settings: Any) -> None:
    """Write the LAMMPS deck of SCENE.

    The deck runs in its folder by `lmp -in in.NAME`.
    """
    for path in dem_bridge.write_deck(scene, folder, replace=force, **settings):
        click.echo(path)


@with_options("verify")
def verify(
    scenes: tuple[str, ...],
    folder: Path,
    force: bool,
    json_file: Path | None = None,
    junit_file: Path | None = None,
    known_defects: str = "fail",
    json_progress: bool = False,
    verbose: bool = False,
    **settings: Any,
) -> None:
    """Verify scenes and write a report.

    The default SCENE is `paper`: all shipped scenes and the claims of the paper.
    """
    for file in (json_file, junit_file):
        if file is not None:
            check_new(file, force)
    with terminal.bar(json_progress, label="the steps of the runs are chosen") as progress:
        verification = dem_bridge.verify(list(scenes) or None, folder=folder, progress=progress, **settings)
    if json_file is not None:
        write_whole(json_file.parent, {json_file.name: (folder / "verdicts.json").read_text(encoding="utf-8")})
    if junit_file is not None:
        from dem_bridge.verification.junit import junit

        write_whole(junit_file.parent, {junit_file.name: junit(verification.verdicts)})
    for study in verification.studies:
        if (engine_run := study.run(study.engine)) is not None:
            _warn(engine_run)
    terminal.print_verification(verification, verbose)
    click.echo(f"report: {folder / 'index.html'}")
    if bundle := settings.get("bundle"):
        click.echo(f"bundle: {bundle}; repeat the runs with: sh {bundle / 'replay.sh'}")
    sys.exit(replace(verification, known_defects=known_defects).exit_code)


@with_options("plan")
def plan(
    scene: str, accuracy: float, as_json: bool, json_progress: bool = False, verbose: bool = False, **settings: Any
) -> None:
    """Find the cheapest settings for an accuracy.

    The settings are those of the cheapest backend, or of one backend. Runs check them.
    """
    with terminal.bar(json_progress, label=f"{scene}: the cheapest settings for {accuracy:g}") as progress:
        answer = dem_bridge.plan(scene, accuracy, progress=progress, **settings)
    if as_json:
        print_json(answer.as_json())
    else:
        terminal.print_plan(answer, scene, verbose)


@with_options("doctor")
def doctor(as_json: bool, **settings: Any) -> None:
    """Check the installation.

    Each fault is printed with what to do about it.

    The exit code is 3 if a run with default settings is not possible.
    """
    from dem_bridge.cli.doctor import examine
    from dem_bridge.lmp.engine import Engine

    findings = examine(Engine.chosen(**settings))
    if as_json:
        print_json([finding.as_dict() for finding in findings])
    else:
        click.echo("\n".join(map(str, findings)))
    sys.exit(0 if all(finding.fine or not finding.needed for finding in findings) else 3)


_COMMANDS = (
    demo,
    show,
    scenes,
    run,
    deck,
    verify,
    doctor,
    study_group,
    new,
    schema,
    plan,
    export,
    regress,
    convert,
    compare,
    check,
    judge,
    import_group,
    store_group,
)
for _command in _COMMANDS:
    main.add_command(_command)


def _warn(run: Trajectory) -> None:
    """Print the note of a LAMMPS run, if it has one, on stderr."""
    if note := run.provenance.get("lammps", {}).get("note"):
        click.echo(f"dem-bridge: warning: {run.provenance['scene']}: {note}", err=True)


def _warn_of_error(scene: str, run: Trajectory) -> None:
    """Print on stderr that the velocities of a run may be wrong by more than 1 % of the largest, and what to do."""
    largest = float(abs(run.velocity).max(initial=0.0))
    error = float(run.uncertainty["velocity"])
    if _WORTH_A_WARNING * largest < error < float("inf"):
        click.echo(
            f"dem-bridge: warning: {run.provenance['scene']}: velocities may be wrong by {error / largest:.0%} of the"
            f" largest; for better settings: dem-bridge plan {scene} --accuracy 1e-3 --backend"
            f" {run.provenance['backend']}",
            err=True,
        )


def _step_lines(scene: Scene, run: Trajectory, summary: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield whether what a run did is plausible: overlaps and the step as shares of their scales, or no contact."""
    from dem_bridge.scene.timescales import contact_time_of

    if summary["largest_force_N"] == 0.0:
        yield "contacts", "no contact closes"
        return
    if (steps := summary["steps"]) and summary["settings"].get("dt") and (shortest := contact_time_of(scene)):
        dt = scene.duration / steps
        yield "time step", f"{dt:.6g} s, {dt / shortest:.2g} of the shortest contact time ({1e6 * shortest:.4g} us)"
    if scene.geometry is not None and scene.law is None and not scene.dissipates:
        c, radius = scene.contacts, min(body.radius for body in scene.geometry.bodies)
        overlap = float(((run.peak_force / c.stiffness) ** (1.0 / (c.exponent - 1.0))).max())
        yield "largest overlap", f"{overlap:.3g} m, {overlap / radius:.2g} of the smallest radius"


def _summary(run: Trajectory) -> dict[str, Any]:
    """Return a summary of a trajectory with uncertainties as JSON types; unknown values are None."""
    import numpy as np

    def known(value: float) -> float | None:
        return float(value) if np.isfinite(value) else None

    uncertainty = {name: known(np.nanmax(bound, initial=0.0)) for name, bound in run.uncertainty.items()}
    crossed = run.crossing_time[np.isfinite(run.crossing_time)]
    table = run.provenance.get("table", {})
    errors = ("predicted_error", "measured_error")
    return {
        **{key: run.provenance[key] for key in ("scene", "backend", "settings")},
        "samples": len(run.time) - 1,
        "largest_velocity_m_per_s": float(np.max(np.abs(run.velocity))),
        "velocity_uncertainty_m_per_s": uncertainty["velocity"],
        "largest_force_N": float(np.max(run.peak_force, initial=0.0)),
        "peak_force_uncertainty_N": uncertainty["peak_force"],
        "last_crossing_time_s": float(crossed[-1]) if len(crossed) else None,
        "crossing_time_uncertainty_s": uncertainty["crossing_time"],
        **({"restitution": known(_restitution(run))} if "impact" in run.provenance else {}),
        "roundoff_floor_relative": known(run.uncertainty.roundoff_floor),
        **{f"table_{name}_relative": table[name] for name in errors if table},
        "steps": run.cost.steps,
        "force_evaluations": run.cost.force_evaluations,
        "wall_s": round(run.cost.wall, 4),
        "cpu_s": round(run.cost.cpu, 4),
        "versions": run.provenance["versions"],
    }


def _restitution(run: Trajectory) -> float:
    """Return the restitution of an impact, nan where its samples do not show it."""
    try:
        return run.restitution
    except UsageError:
        return float("nan")


def _summary_lines(summary: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the lines of a summary as pairs of name and text; unknown values are left out.

    ``summary.json`` has the lines: name, key, and format of the value; or name, key, key of the uncertainty, unit and
    SI value of the unit.
    """
    for name, key, *form in json.loads(Path(__file__).with_name("summary.json").read_text(encoding="utf-8")):
        value = summary.get(key)
        if len(form) == 1:
            if value is not None:
                yield name, form[0].format(value)
            continue
        bound, unit, size = form
        error = summary[bound]
        uncertainty = "uncertainty unknown" if error is None else f"+- {error / size:.1g} {unit}"
        yield name, "none" if value is None else f"{value / size:.7g} {unit} {uncertainty}"


def _has_folder() -> bool:
    """Return True if the working folder exists."""
    try:
        os.getcwd()
    except FileNotFoundError:
        return False
    return True


def output_is_closed() -> bool:
    """Return True if the program that reads the output, such as `head`, has ended."""
    output = select.poll()
    output.register(sys.stdout.fileno(), 0)
    return any(event & select.POLLERR for _, event in output.poll(0))


def _discard_output() -> None:
    """Send further output nowhere, so that no message about the closed pipe follows."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def command() -> None:
    """Run :func:`main` as a program and end the process at once, because the normal exit of Python takes 0.3 s."""
    gc.set_threshold(100_000)  # otherwise a tenth of the time of an import is a search for garbage
    # matrices are small: threads of numpy's library that wait for each other would take most of the time of a command
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by the caller
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
        getattr(sys, name).reconfigure(errors="backslashreplace")  # names of files may be no UTF-8
    code: str | int | None = 1
    try:
        try:
            main()
        except SystemExit as end:
            code = end.code
        sys.stdout.flush()
        sys.stderr.flush()
    except BrokenPipeError:
        _discard_output()
        code = PIPE_CLOSED
    if "multiprocessing.process" in sys.modules or isinstance(code, str):
        sys.exit(code)  # waits for child processes
    os._exit(code or 0)
