"""The command line: parse the words, call the public functions, print their results.

Results go to stdout, progress to stderr and only on a terminal. Large packages are imported only by the commands that
need them. Exit codes: 0 all checks pass, 1 a check failed, 2 wrong use or bad scene, 3 a run broke, 4 undecided.
"""

from __future__ import annotations

import atexit
import os
import select
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import dem_bridge
from dem_bridge.cli import options, terminal, waiting
from dem_bridge.cli.check import check
from dem_bridge.cli.conform import conform
from dem_bridge.cli.contact import contact
from dem_bridge.cli.demo import demo, show
from dem_bridge.cli.files import compare, convert, export, judge
from dem_bridge.cli.parameters import FILE, POSITIVE, ObservableChoice, Option, check_new, make_command, print_json
from dem_bridge.cli.proof import prove
from dem_bridge.cli.regress import regress
from dem_bridge.cli.run import run, warn_of_engine
from dem_bridge.cli.scene_files import import_group, new, schema
from dem_bridge.cli.store import store_group
from dem_bridge.cli.studies import study as study_group
from dem_bridge.errors import BlockedScript, DemBridgeError, UnsupportedScene, one_line
from dem_bridge.foundation.files import FILES_BELOW, write_whole

if TYPE_CHECKING:
    pass


#: exit code if the reader of the output ended, as of a program that SIGPIPE stops
PIPE_CLOSED = 141
_NO_FOLDER = "the working folder was removed; change to a folder that exists"


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
            with waiting.ending_in_order():
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
            if code == 2 and not _has_folder():
                text = _NO_FOLDER
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
                text, code = _NO_FOLDER, 2
        except KeyboardInterrupt as error:  # with words where a campaign ended in order
            text, code = str(error) or "interrupted; the run was stopped; a second call uses what was finished", 130
        click.echo(f"dem-bridge: {one_line(text)}", err=True)
        ctx.exit(code)


@click.group(
    cls=_Group,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(dem_bridge.__version__, prog_name="dem-bridge")
@click.pass_context
def main(ctx: click.Context, files_below: Path | None) -> None:
    """Verify simulations of one-dimensional granular chains against LAMMPS.

    SCENE is the name of a shipped scene (see `dem-bridge scenes`) or the path of a scene file (.toml).
    """
    if files_below is not None:
        before = dict(os.environ)
        os.environ[FILES_BELOW] = str(files_below.absolute())
        ctx.call_on_close(lambda: os.environ.update(before) if FILES_BELOW in before else os.environ.pop(FILES_BELOW))


@make_command("scenes", options.AS_JSON)
def scenes(as_json: bool) -> None:
    """List the shipped scenes."""
    if not as_json:
        from dem_bridge.scene.shipped import listed_scenes

        terminal.print_scenes(listed_scenes())
        return
    shipped = [dem_bridge.load_scene(name) for name in dem_bridge.shipped_scenes("all")]
    fields = {"name": "name", "bodies": "n_body", "contacts": "n_contact", "duration": "duration"}
    fields |= {"description": "description", "hash": "content_hash"}
    print_json([{key: getattr(scene, field) for key, field in fields.items()} for scene in shipped])


@make_command(
    "deck",
    options.SCENE,
    Option("style", "Pair style of the deck.", ("granular", "table"), default="granular", value="granular"),
    options.DT,
    options.GEOMETRY,
    options.TYPES,
    replace(options.FOLDER, help="Folder for the files.", required=True),
    replace(options.FORCE, help="Replace files of the deck that exist in DIR."),
)
def deck(scene: str, folder: Path, force: bool, **settings: Any) -> None:
    """Write the LAMMPS deck of SCENE.

    The deck runs in its folder by `lmp -in in.NAME`.
    """
    for path in dem_bridge.write_deck(scene, folder, replace=force, **settings):
        click.echo(path)


@make_command(
    "verify",
    options.SCENES,
    options.ACCURACY,
    replace(
        options.DT,
        help="Time step of LAMMPS and its twin, s, such as that of an input script.",
        default="the largest for the accuracy",
    ),
    *options.LAMMPS,
    options.JOBS,
    options.CLUSTER,
    options.RECOMPUTE,
    replace(
        options.FOLDER,
        help="Folder for the report (index.html, verdicts.json).",
        default="reports/latest",
        value="reports/latest",
    ),
    Option("bundle", "Folder for a bundle with which a reviewer can repeat the runs.", FILE, metavar="DIR"),
    replace(options.JSON_FILE, help="Further file for the verdicts, JSON."),
    replace(options.JUNIT_FILE, help="File for the verdicts, JUnit XML."),
    replace(options.FORCE, help="Replace the files of --json and --junit if they exist."),
    Option(
        "known_defects",
        "Effect of failures that known defects of this LAMMPS release explain on the exit code: 1 or none.",
        ("fail", "ok"),
        default="fail",
    ),
    options.JSON_PROGRESS,
    options.VERBOSE,
)
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
    waiting.announce_compiling("taylor", silent=json_progress)
    with waiting.bar(json_progress, label="the steps of the runs are chosen") as progress:
        verification = dem_bridge.verify(list(scenes) or None, folder=folder, progress=progress, **settings)
    if json_file is not None:
        write_whole(json_file.parent, {json_file.name: (folder / "verdicts.json").read_text(encoding="utf-8")})
    if junit_file is not None:
        from dem_bridge.verification.records import junit

        write_whole(junit_file.parent, {junit_file.name: junit(verification.verdicts)})
    for study in verification.studies:
        if (engine_run := study.run(study.engine)) is not None:
            warn_of_engine(engine_run)
    terminal.print_verification(verification, verbose)
    click.echo(f"report: {folder / 'index.html'}")
    if bundle := settings.get("bundle"):
        click.echo(f"bundle: {bundle}; repeat the runs with: sh {bundle / 'replay.sh'}")
    sys.exit(replace(verification, known_defects=known_defects).exit_code)


@make_command(
    "plan",
    options.SCENE,
    replace(options.ACCURACY, help="Required relative accuracy, such as 1e-4.", required=True),
    replace(options.BACKEND, help="Backend to plan for.", default="the cheapest"),
    Option("observable", "Observable that must have the accuracy.", ObservableChoice(), default="velocity"),
    Option("budget", "Largest CPU time of the run, s.", float, unit="s", limits=POSITIVE, default="no limit"),
    Option("predict_only", "Use the error model only, without a run to check it.", bool),
    options.SAMPLES,
    options.AS_JSON,
    options.JSON_PROGRESS,
    options.VERBOSE,
)
def plan(
    scene: str, accuracy: float, as_json: bool, json_progress: bool = False, verbose: bool = False, **settings: Any
) -> None:
    """Find the cheapest settings for an accuracy.

    The settings are those of the cheapest backend, or of one backend. Runs check them.
    """
    waiting.announce_compiling(silent=json_progress)
    with waiting.bar(json_progress, label=f"{scene}: the cheapest settings for {accuracy:g}") as progress:
        answer = dem_bridge.plan(scene, accuracy, progress=progress, **settings)
    if as_json:
        print_json(answer.as_json())
    else:
        terminal.print_plan(answer, scene, verbose)


@make_command("doctor", options.AS_JSON, *options.LAMMPS)
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
        for finding in findings:
            terminal.print_entry(finding.head, finding.text, len(finding.head))
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
    prove,
    export,
    contact,
    regress,
    convert,
    compare,
    check,
    judge,
    conform,
    import_group,
    store_group,
)
main.params.append(
    Option(
        "files_below",
        "Folder below which the files must be that a scene or a deck names.",
        FILE,
        metavar="DIR",
        default="its own folder",
    ).parameter()
)
for _command in _COMMANDS:
    main.add_command(_command)


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
    if isinstance(code, str):
        sys.exit(code)  # it is a message
    atexit._run_exitfuncs()  # child processes end, and temporary folders are removed
    os._exit(code or 0)
