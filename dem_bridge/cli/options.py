"""The arguments and options of all commands: the data are in ``options.json``, the types of their values are here.

The file has the options of each command in their order, as arguments of :class:`click.Option`. An entry ``{}`` is the
option of the part ``shared`` with the same name. The choices are written in the file, because ``--help`` must not
import numpy; a test compares them with the package.
"""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dem_bridge.backends.catalogue import BACKENDS, backend_names
from dem_bridge.errors import UsageError
from dem_bridge.foundation.files import check_file

if TYPE_CHECKING:
    from dem_bridge.scene.scene import Wall


def scene_names(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[Any]:
    """Return the completions of a scene: names of shipped scenes, or files if no name matches."""
    from click.shell_completion import CompletionItem

    folder = Path(__file__).parents[1] / "scenes"
    names = sorted(file.stem for file in folder.rglob("*.toml") if file.stem.startswith(incomplete))
    return [CompletionItem(name) for name in names] or [CompletionItem(incomplete, type="file")]


class ObservableChoice(click.Choice[str]):
    """The name of a registered observable; the registry is imported when a name is needed, not for ``--help``."""

    def __init__(self) -> None:
        self.case_sensitive = True

    @property
    def choices(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of all registered observables."""
        from dem_bridge.observables.registry import OBSERVABLES

        return tuple(OBSERVABLES)


class BackendChoice(click.Choice[str]):
    """The name of a backend; those of other distributions are looked for when a name is not of this package."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the name of a backend."""
        if value in self.choices or value in backend_names():
            return str(value)
        return super().convert(value, param, ctx)


def _names(value: str) -> list[str]:
    """Return the names of a list with commas."""
    return [name.strip() for name in value.split(",")]


def _assignments(value: str) -> dict[str, str] | list[str]:
    """Return the names of a list with commas, or a mapping if each of them is NAME=TEXT."""
    names = _names(value)
    pairs = [name.partition("=") for name in names]
    return {name.strip(): text.strip() for name, _, text in pairs} if all(sign for _, sign, _ in pairs) else names


def _integers(value: str) -> list[int]:
    """Return the whole numbers of a list with commas."""
    try:
        return [int(number) for number in value.split(",")]
    except ValueError as error:
        raise click.BadParameter(f"{error}; allowed: whole numbers separated by commas") from None


def _numbers(value: str) -> list[float]:
    """Return the numbers of a list with commas."""
    try:
        return [float(number) for number in value.split(",")]
    except ValueError as error:
        raise click.BadParameter(f"{error}; allowed: numbers separated by commas") from None


def _variable(value: str) -> tuple[str, str]:
    """Return name and value of a variable NAME=VALUE."""
    name, sign, text = value.partition("=")
    if not sign:
        raise click.BadParameter(f"{value!r}; allowed: NAME=VALUE")
    return name, text


def _wall(value: str) -> Wall:
    """Return the wall STIFFNESS[,GAP[,EXPONENT]]."""
    import dem_bridge

    try:
        numbers = [float(word) for word in value.split(",")]
    except ValueError:
        numbers = []
    if not 1 <= len(numbers) <= 3:
        raise click.BadParameter(f"{value!r}; allowed: STIFFNESS[,GAP[,EXPONENT]]")
    return dem_bridge.Wall(**dict(zip(("stiffness", "gap", "exponent"), numbers, strict=False)))


class _Cluster(click.ParamType[Any]):
    """A Dask scheduler, to which the command is connected until it ends."""

    name = "cluster"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the executor of the cluster."""
        from dem_bridge.runs.campaign.cluster import connected

        return ctx.with_resource(connected(value)) if ctx is not None and isinstance(value, str) else value


_TYPES: dict[str, Any] = {
    "assignments": _assignments,
    "backend": BackendChoice(BACKENDS),
    "cluster": _Cluster(),
    "file": click.Path(path_type=Path),
    "float": float,
    "int": int,
    "integers": _integers,
    "names": _names,
    "numbers": _numbers,
    "observable": ObservableChoice(),
    "positive": click.IntRange(min=1),
    "variable": _variable,
    "wall": _wall,
}


@cache
def _table() -> dict[str, dict[str, dict[str, Any]]]:
    """Return the contents of ``options.json``."""
    return dict(json.loads(Path(__file__).with_name("options.json").read_text(encoding="utf-8")))


def parameters(command: str) -> list[click.Parameter]:
    """Return the arguments and options of a command in their order."""
    table = _table()
    return [_parameter(name, dict(entry or table["shared"][name])) for name, entry in table[command].items()]


def _parameter(name: str, keywords: dict[str, Any]) -> click.Parameter:
    """Return an argument or an option; its type is a list of choices or a key of ``_TYPES``."""
    kind = keywords.pop("type", None)
    keywords["type"] = click.Choice(kind) if isinstance(kind, list) else _TYPES.get(kind)
    if keywords.pop("argument", False):
        return click.Argument(
            [name], shell_complete=scene_names if name in ("scene", "scenes", "drawn") else None, **keywords
        )
    return click.Option([*keywords.pop("flags", [f"--{name.replace('_', '-')}"]), name], **keywords)


def with_options(name: str, **attributes: Any) -> Callable[[Callable[..., None]], click.Command]:
    """Return a decorator that makes a function the command ``name``; options that were not given are not passed."""

    def make(function: Callable[..., None]) -> click.Command:
        def call(**values: Any) -> None:
            function(**{key: value for key, value in values.items() if value is not None})

        return click.Command(
            name.split()[-1], callback=call, params=parameters(name), help=inspect.getdoc(function), **attributes
        )

    return make


def check_new(path: Path, force: bool) -> None:
    """Raise UsageError unless a file can be written at ``path`` and none exists there (or ``force`` is set)."""
    check_file(path)
    if path.exists() and not force:
        raise UsageError(f"{path}: the file exists; allowed: a new file, or --force to replace it")


def check_output(scene: str, output: Path, force: bool) -> None:
    """Raise UsageError as :func:`check_new`, and if ``output`` is the scene file that is read."""
    source = Path(scene)
    if source.is_file() and output.exists() and output.samefile(source):
        raise UsageError(f"{output}: the output would replace the scene file; name another file")
    check_new(output, force)


def print_json(document: Any) -> None:
    """Print a document of JSON types."""
    click.echo(json_text(document))


def json_text(document: Any) -> str:
    """Return a document of JSON types as text."""
    return json.dumps(document, indent=1, allow_nan=False)
