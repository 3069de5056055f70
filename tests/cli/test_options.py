"""The declared options of commands: each number has limits that hold, and each unit stands in the help."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from dem_bridge.cli import main
from dem_bridge.cli.parameters import COUNTS, FINITE, Option
from dem_bridge.errors import UsageError
from tests.helpers.command_line import assert_one_line, run_here


def _options(group: click.Group, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], click.Option]]:
    """Yield all options of the package's commands; those of studies follow from signatures."""
    for name, command in group.commands.items():
        if isinstance(command, click.Group) and name != "study":
            yield from _options(command, (*path, name))
        yield from (((*path, name), option) for option in command.params if isinstance(option, click.Option))


OPTIONS = list(_options(main))
NUMBERS = [
    (words, option) for words, option in OPTIONS if option.type.name in ("float", "integer") or option.name == "dt"
]


def _declared(option: click.Option) -> Option:
    """Return the declaration of an option with limits."""
    declared = getattr(option.callback, "__self__", None)
    assert isinstance(declared, Option), option
    return declared


@pytest.mark.parametrize(("words", "option"), NUMBERS, ids=lambda one: getattr(one, "name", None) or " ".join(one))
def test_a_number_outside_its_limits_is_refused_before_the_command_begins(
    words: tuple[str, ...], option: click.Option
) -> None:
    limits = _declared(option).limits
    assert limits is not None
    context = click.Context(click.Command("any"))
    wrong = [0] if limits is COUNTS else [float("nan"), *([] if limits is FINITE else [-1.5])]
    assert option.callback is not None
    for value in wrong:
        with pytest.raises(UsageError, match=f"{option.opts[0]} = .*; allowed: "):
            option.callback(context, option, value)
    context.resilient_parsing = True  # completion in a shell
    assert option.callback(context, option, wrong[0]) is wrong[0]


def test_there_are_numbers_of_all_kinds() -> None:
    assert len(NUMBERS) > 40
    assert {_declared(option).unit for _, option in NUMBERS} == {"", "s", "m", "m/s", "Pa", "N", "m/s^2", "1/s"}


def test_the_unit_of_a_number_stands_in_its_help() -> None:
    for _, option in NUMBERS:
        unit = _declared(option).unit
        assert not unit or f", {unit}" in str(option.help), option


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("run", "tapered-backward", "--backend", "verlet", "--dt", "0"), "--dt = 0.0; allowed: a number above 0 (s)"),
        (("verify", "tapered-backward", "-j", "0"), "-j = 0; allowed: a whole number >= 1"),
        (("compare", "a.nc", "b.nc", "--dt", "nan"), "--dt = nan; allowed: a number above 0 (s)"),
        (("judge", "a.csv", "--dt", "1e-7,-1"), "--dt = -1.0; allowed: a number above 0 (s)"),
        (("check", "in.a", "--time-limit", "inf"), "--time-limit = inf; allowed: a number above 0 (s)"),
    ],
)
def test_a_number_outside_its_limits_is_one_line(words: tuple[str, ...], message: str, tmp_path: Path) -> None:
    done = run_here(*words, cwd=tmp_path)
    assert done.returncode == 2
    assert_one_line(done, message)
    assert not list(tmp_path.iterdir())
