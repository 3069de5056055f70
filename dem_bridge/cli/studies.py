"""The commands of ``dem-bridge study``, built from the signatures and docstrings of the studies."""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import click

import dem_bridge
from dem_bridge.api.guests import STUDIES, study_named, study_names
from dem_bridge.cli import terminal, waiting
from dem_bridge.cli.options import (
    AS_JSON,
    CLUSTER,
    FOLDER,
    JOBS,
    JSON_PROGRESS,
    LAMMPS,
    RECOMPUTE,
    SCENE,
    VERBOSE,
)
from dem_bridge.cli.parameters import Argument, Option, print_json
from dem_bridge.foundation import guests

#: annotation of a parameter -> type of its option
_TYPES = {"float": float, "int": int, "str": str, "bool": bool}
#: exit code -> what it says of a study
_EXIT_CODES = {
    1: "a check above FAILs; this is a result on LAMMPS, and no fault of the installation (see dem-bridge doctor)",
    2: "a backend that was asked for did not run",
    3: "a run broke",
    4: "a check above is UNDECIDED",
}
#: parameter that several studies have -> its options
_SHARED: dict[str, tuple[Option, ...]] = {
    "executor": (CLUSTER,),
    "engine": LAMMPS,
    "jobs": (JOBS, CLUSTER),
    "store": (RECOMPUTE,),
    "progress": (),
    "measurement": (),
}
#: options of every study, the last of its options
_COMMON = (FOLDER, AS_JSON, JSON_PROGRESS, VERBOSE)


class _StudyCommand(click.Command):
    """The command of one study. The study is imported when its options are needed, not for the list of commands."""

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Return the options, built from the study's function at the first call."""
        if not self.params:
            with nullcontext() if ctx.resilient_parsing else waiting.bar(label=f"study {self.name} is loaded"):
                function = study_named(str(self.name))
            self.help, descriptions = documentation(function)
            self.params = [each.parameter() for each in declared_by(function, descriptions)]
        return super().get_params(ctx)


class _Studies(click.Group):
    """The studies of this package, and those of other distributions, which are looked for when they are needed."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all studies in alphabetical order."""
        return sorted(study_names())

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """Return the command of a study, None for an unknown name."""
        known = super().get_command(ctx, name)
        if known is None and (point := guests.find_guest(guests.STUDIES, name)) is not None:
            known = _StudyCommand(name, callback=partial(_answer, name), short_help=f"From {point.value}.")
        return known


@click.group(cls=_Studies)
def study() -> None:
    """Answer a question that takes many runs, with a page, tables and figures."""


def documentation(function: Callable[..., Any]) -> tuple[str, dict[str, str]]:
    """Return the description in a numpydoc docstring, and the text of each parameter by name.

    >>> documentation(dem_bridge.solve)[0].split()[0]
    'Solve'
    """
    text = re.sub(r":\w+:`[~.]*([^`]+)`|``", r"\1", inspect.getdoc(function) or "")
    description, *sections = re.split(r"\n\n(?=\w[\w ]*\n-{3,}\n)", text)
    parameters = next((part for part in sections if part.startswith("Parameters\n")), "")
    entries = re.findall(r"^([\w, ]+) : .*\n?((?: {4}.*\n?|\n)*)", parameters, re.MULTILINE)
    return description, {name: " ".join(words.split()) for names, words in entries for name in names.split(", ")}


def declared_by(function: Callable[..., Any], descriptions: dict[str, str]) -> Iterator[Argument | Option]:
    """Yield the scene, an option for each setting of a study, and the options that it shares with others."""
    settings = inspect.signature(function).parameters
    if scene := settings.get("scene"):
        yield replace(SCENE, required=scene.default is scene.empty)
    for name, parameter in settings.items():
        if name != "scene" and name not in _SHARED:
            yield _option(parameter, descriptions[name])
    yield from dict.fromkeys((*(option for key in settings for option in _SHARED.get(key, ())), *_COMMON))


def _option(parameter: inspect.Parameter, text: str) -> Option:
    """Return the option of one setting: bool gives ``--x/--no-x``, a sequence an option that can be repeated."""
    name, default, text = parameter.name.replace("_", "-"), parameter.default, text.replace("None: ", "By default ")
    annotation = parameter.annotation.removesuffix(" | None")
    several, flag = annotation.startswith("Sequence["), annotation == "bool"
    if flag:
        default = name if default else f"no-{name}"
    if default is not None:
        text += f"  [default: {', '.join(default) if several else default}]"
    return Option(
        parameter.name,
        text + ("  Can be repeated." if several else ""),
        _TYPES[annotation.removeprefix("Sequence[").removesuffix("]")],
        flags=(f"--{name}/--no-{name}" if flag else f"--{name.removesuffix('s') if several else name}",),
        many=several,
    )


def _answer(
    name: str, *, folder: Path | None, as_json: bool, json_progress: bool, verbose: bool, **settings: Any
) -> None:
    """Run a study, show it, and end with its exit code; settings that were not given are left to the study."""
    chosen = {key: value for key, value in settings.items() if value is not None and value != ()}
    waiting.announce_compiling(silent=json_progress)
    with waiting.bar(json_progress, label=f"study {name}") as progress:
        result = dem_bridge.study(name, folder=folder, progress=progress, **chosen)
    if as_json:
        print_json(result.as_json())
    else:
        terminal.print_study(result, verbose)
        if folder is not None:
            click.echo(f"written: {folder / 'index.html'}, with its tables, figures and {name}.json")
        if result.exit_code:
            click.echo(f"exit code {result.exit_code}: {_EXIT_CODES[result.exit_code]}")
    sys.exit(130 if result.interrupted else result.exit_code)


for _name, _entry in STUDIES.items():
    study.add_command(_StudyCommand(_name, callback=partial(_answer, _name), short_help=_entry.summary))
