"""Refuse workers whose dem_bridge is not that of the campaign: their numbers would be kept as those of this code."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import Any

from dem_bridge.errors import UsageError
from dem_bridge.runs.code import NOT_IN_RUNS, code_without, digest, is_within
from dem_bridge.version import __version__

#: version of a dem_bridge, and hash of the code of its runs, campaigns and ensembles
Identity = tuple[str, str]
#: parts whose code workers use, although no number of a trajectory passes through them
IN_WORKERS = ("ensembles", "runs")


def identity() -> Identity:
    """Return the version of this dem_bridge, and a hash of the code that its workers use."""
    return __version__, _code()


@cache
def _code() -> str:
    return digest(code_without(tuple(part for part in NOT_IN_RUNS if not is_within(part, IN_WORKERS))))[:12]


def check_identity(of_campaign: Identity) -> None:
    """Raise UsageError unless this dem_bridge, that of a worker, is the one of the campaign.

    >>> check_identity(identity())
    >>> check_identity(("0.0.1", "0123456789ab"))  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    dem_bridge.errors.UsageError: a worker has dem_bridge ... with code ...; allowed: 0.0.1 with code 0123456789ab, ...
    """
    if of_campaign != identity():
        raise UsageError(
            f"a worker has dem_bridge {_words(identity())}; allowed: {_words(of_campaign)}, as here; install the same"
            " on all workers, and start again if a file of dem_bridge has changed since the start"
        )


def for_workers(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function for an executor that calls ``function`` in workers with this dem_bridge, and no others."""
    return partial(_call, identity(), function)


def _call(of_campaign: Identity, function: Callable[..., Any], *arguments: Any) -> Any:
    check_identity(of_campaign)
    return function(*arguments)


def _words(of: Identity) -> str:
    version, code = of
    return f"{version} with code {code or 'unknown'}"
