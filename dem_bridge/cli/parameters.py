"""How a command is made: from a function and the arguments and options that are declared for it.

An :class:`Option` states once the name, type, unit, limits, default and help of an option. Those that several commands
have are in ``options``; those of one command stand above its function; those of a study follow from its signature.
The types of values become names, numbers, a wall or the executor of a cluster.
"""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from dem_bridge.backends.catalogue import BACKENDS, backend_names
from dem_bridge.errors import UsageError
from dem_bridge.foundation.files import check_file
from dem_bridge.foundation.numbers import check_number

if TYPE_CHECKING:
    from dem_bridge.scene.scene import Wall


class Limits(NamedTuple):
    """The numbers that an option allows; other numbers are refused before the command begins."""

    allowed: str
    """Description for the message; the unit of the option is added."""
    above: float = float("-inf")
    at_least: float = float("-inf")
    at_most: float = float("inf")
    below: float = float("inf")

    def check(self, name: str, value: float, unit: str) -> None:
        """Raise UsageError unless the value is a finite number within the limits.

        >>> POSITIVE.check("--dt", 0.0, "s")
        Traceback (most recent call last):
        dem_bridge.errors.UsageError: --dt = 0.0; allowed: a number above 0 (s)
        """
        allowed = f"{self.allowed} ({unit})" if unit else self.allowed
        bounds = {key: bound for key, bound in self._asdict().items() if key != "allowed"}
        check_number(name, value, allowed, **bounds)


POSITIVE = Limits("a number above 0", above=0.0)
NOT_NEGATIVE = Limits("a number >= 0", at_least=0.0)
ACCURACIES = Limits("a number between 0 and 1, such as 1e-6", above=0.0, below=1.0)
COUNTS = Limits("a whole number >= 1", at_least=1.0)
FINITE = Limits("a finite number")


@dataclass(frozen=True)
class Argument:
    """One argument of commands."""

    name: str
    """Name of the value that the function of the command receives."""
    metavar: str = ""
    kind: Any = None
    """Type of the value: a type of click, or a function of the text; text if None."""
    value: Any = None
    """Value that is passed without the argument; None: nothing is passed, and the function decides."""
    required: bool = True
    many: bool = False
    """Whether it has any number of values."""
    completion: Callable[..., list[Any]] | None = None

    def parameter(self) -> click.Parameter:
        """Return the argument for click."""
        keywords = {key: value for key, value in {"metavar": self.metavar, "default": self.value}.items() if value}
        if self.many:
            keywords["nargs"] = -1
        return click.Argument(
            [self.name],
            type=self.kind,
            required=self.required and not self.many,
            shell_complete=self.completion,
            **keywords,
        )


@dataclass(frozen=True)
class Option:
    """One option of commands.

    >>> Option("time_limit", "Time limit, s.", float, unit="s", default="600").parameter().opts
    ['--time-limit']
    """

    name: str
    """Name of the value that the function of the command receives; also the flag, where ``flags`` has no other."""
    help: str
    kind: Any = None
    """Type of the value: float, int, bool (of a flag), a tuple of choices, a type of click, or a function of the text;
    text if None."""
    metavar: str = ""
    unit: str = ""
    """Unit of a number that has one; without a ``metavar`` it stands for the value in the help."""
    limits: Limits | None = None
    default: str = ""
    """What holds without the option, for the help."""
    value: Any = None
    """Value that is passed without the option; None: nothing is passed, and the function decides."""
    flags: tuple[str, ...] = ()
    required: bool = False
    many: bool = False
    """Whether it can be repeated."""

    def parameter(self) -> click.Parameter:
        """Return the option for click."""
        flags = self.flags or (f"--{self.name.replace('_', '-')}",)
        keywords: dict[str, Any] = {} if self.value is None else {"default": self.value}
        if self.kind is bool:  # of two flags, such as --full/--no-full, neither holds unless it is given
            keywords = {"default": self.value} if "/" in flags[0] else {"is_flag": True}
        else:
            keywords["type"] = click.Choice(self.kind) if isinstance(self.kind, tuple) else self.kind
        return click.Option(
            [*flags, self.name],
            help=f"{self.help}  [default: {self.default}]" if self.default else self.help,
            metavar=self.metavar or self.unit.upper() or None,
            required=self.required,
            multiple=self.many,
            callback=self._checked if self.limits else None,
            **keywords,
        )

    def _checked(self, ctx: click.Context, param: click.Parameter, value: Any) -> Any:
        """Return the value; raise UsageError if a number is outside the limits."""
        if self.limits is not None and not ctx.resilient_parsing:
            for number in value if isinstance(value, list | tuple) else () if value is None else (value,):
                self.limits.check(param.opts[0], number, self.unit)
        return value


def make_command(
    name: str, *declared: Argument | Option, **attributes: Any
) -> Callable[[Callable[..., None]], click.Command]:
    """Return a decorator that makes a function the command ``name``; options that were not given are not passed."""

    def make(function: Callable[..., None]) -> click.Command:
        def call(**values: Any) -> None:
            function(**{key: value for key, value in values.items() if value is not None})

        parameters = [one.parameter() for one in declared]
        return click.Command(name, callback=call, params=parameters, help=inspect.getdoc(function), **attributes)

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


#: the path of a file or a folder
FILE = click.Path(path_type=Path)


def scene_names(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[Any]:
    """Return the completions of a scene: names of shipped scenes, or files if no name matches."""
    from click.shell_completion import CompletionItem

    from dem_bridge.scene.shipped import shipped_scenes

    names = sorted(name for name in shipped_scenes("all") if name.startswith(incomplete))
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

    def __init__(self) -> None:
        super().__init__(BACKENDS)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the name of a backend."""
        if value in self.choices or value in backend_names():
            return str(value)
        return super().convert(value, param, ctx)


class Cluster(click.ParamType[Any]):
    """A Dask scheduler, to which the command is connected until it ends."""

    name = "cluster"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the executor of the cluster."""
        from dem_bridge.runs.campaign.cluster import connected

        return ctx.with_resource(connected(value)) if ctx is not None and isinstance(value, str) else value


def names(value: str) -> list[str]:
    """Return the names of a list with commas."""
    return [name.strip() for name in value.split(",")]


def assignments(value: str) -> dict[str, str] | list[str]:
    """Return the names of a list with commas, or a mapping if each of them is NAME=TEXT."""
    parts = names(value)
    pairs = [name.partition("=") for name in parts]
    return {name.strip(): text.strip() for name, _, text in pairs} if all(sign for _, sign, _ in pairs) else parts


def integers(value: str) -> list[int]:
    """Return the whole numbers of a list with commas."""
    try:
        return [int(number) for number in value.split(",")]
    except ValueError as error:
        raise click.BadParameter(f"{error}; allowed: whole numbers separated by commas") from None


def numbers(value: str) -> list[float]:
    """Return the numbers of a list with commas."""
    try:
        return [float(number) for number in value.split(",")]
    except ValueError as error:
        raise click.BadParameter(f"{error}; allowed: numbers separated by commas") from None


def variable(value: str) -> tuple[str, str]:
    """Return name and value of a variable NAME=VALUE."""
    name, sign, text = value.partition("=")
    if not sign:
        raise click.BadParameter(f"{value!r}; allowed: NAME=VALUE")
    return name, text


def wall(value: str) -> Wall:
    """Return the wall STIFFNESS[,GAP[,EXPONENT]]."""
    import dem_bridge

    try:
        given = [float(word) for word in value.split(",")]
    except ValueError:
        given = []
    if not 1 <= len(given) <= 3:
        raise click.BadParameter(f"{value!r}; allowed: STIFFNESS[,GAP[,EXPONENT]]")
    return dem_bridge.Wall(**dict(zip(("stiffness", "gap", "exponent"), given, strict=False)))
