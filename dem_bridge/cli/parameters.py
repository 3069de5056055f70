"""How a command is made: from a function and the arguments and options that are declared for it.

An :class:`Option` states once the name, type, unit, limits, default and help of an option. Those that several commands
have are in ``options``; those of one command stand above its function; those of a study follow from its signature.
"""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import click

from dem_bridge.errors import UsageError
from dem_bridge.foundation.files import check_file
from dem_bridge.foundation.numbers import check_number


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
