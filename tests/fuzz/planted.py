"""Readers with a planted fault each, which the fuzzing must notice."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path

from dem_bridge.errors import UsageError
from dem_bridge.formats.readers.read import damage_as_usage_error
from tests.fuzz.targets import Target
from tests.helpers import hostile


def _key_error(_path: Path) -> None:
    raise KeyError("x")


def _guarded(path: Path) -> None:
    with damage_as_usage_error(path):
        _key_error(path)


def _two_lines(_path: Path) -> None:
    error = UsageError("x")
    error.args = ("two\nlines",)
    raise error


def _foreign(_path: Path) -> None:
    Path("/etc/hosts").read_bytes()


def _hoarding(_path: Path) -> None:
    _ = b"x" * (600 * 2**20)


#: reader -> the outcome that is due
PLANTED: dict[str, tuple[Callable[[Path], None], str]] = {
    "raises KeyError": (_key_error, "traceback"),
    "raises KeyError in a guard": (_guarded, "traceback"),
    "warns": (lambda _: warnings.warn("x", stacklevel=1), "traceback"),
    "message of two lines": (_two_lines, "message"),
    "opens a foreign file": (_foreign, "outside"),
    "allocates a terabyte": (hostile.greedy, "over memory"),
    "keeps 600 MiB": (_hoarding, "over memory"),
    "crashes": (hostile.crash, "died"),
    "never ends": (hostile.endless, "hang"),
}
FAULTY = {name: Target(lambda: [b"x"], "x", read) for name, (read, _) in PLANTED.items()}
