"""An existing Dask cluster as an executor: connect to its scheduler, and check that its workers can do the work."""

from __future__ import annotations

import re
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dem_bridge.errors import UsageError
from dem_bridge.runs.campaign.identity import identity
from dem_bridge.version import __version__

#: an address ends in a port, or is that of a scheduler in this process
_ADDRESS = re.compile(r":\d+/?$|^inproc://")
#: s in which the scheduler answers, and in which a first worker is there
ANSWER_TIME, FIRST_WORKER_TIME = 10.0, 60.0


@contextmanager
def connected(cluster: str) -> Iterator[Executor]:
    """Provide the executor of an existing Dask cluster.

    Parameters
    ----------
    cluster : str
        Address of the scheduler, such as "tcp://host:8786", or the path of its scheduler file.

    Raises
    ------
    UsageError
        If dask.distributed is not installed, no scheduler answers, there is no worker, or a worker has another
        dem_bridge.

    Examples
    --------
    >>> with connected("nothing"):  # doctest: +ELLIPSIS
    ...     pass
    Traceback (most recent call last):
    dem_bridge.errors.UsageError: cluster = 'nothing': ...
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise UsageError(
            f"cluster = {cluster!r}: dask.distributed is missing ({error}); install it with:"
            ' pip install "dem-bridge[cluster]"'
        ) from error
    is_file = Path(cluster).is_file()
    # an address that cannot be one takes a client half a minute to refuse
    if not is_file and not _ADDRESS.search(cluster):
        raise UsageError(
            f"cluster = {cluster!r}: there is no such file, and it is no address; allowed: the address of a Dask"
            " scheduler, such as tcp://host:8786, or the path of its scheduler file"
        )
    place = {"scheduler_file": cluster} if is_file else {"address": cluster}
    try:
        # results come from the workers themselves, not through the scheduler
        client = Client(**place, timeout=ANSWER_TIME, direct_to_workers=True, set_as_default=False)
    except Exception as error:  # of many kinds: addresses that cannot be, hosts that are not, times that are up
        raise UsageError(
            f"cluster = {cluster!r}: no scheduler answers ({type(error).__name__}: {error}); allowed: the address of a"
            " Dask scheduler, such as tcp://host:8786, or the path of its scheduler file"
        ) from error
    with client:
        _check_workers(client, cluster)
        yield client.get_executor(pure=False)


def _check_workers(client: Any, cluster: str) -> None:
    """Raise UsageError unless there are workers, and all have this dem_bridge."""
    try:
        client.wait_for_workers(1, timeout=FIRST_WORKER_TIME)
    except TimeoutError as error:
        raise UsageError(
            f"cluster = {cluster!r}: the scheduler has no worker after {FIRST_WORKER_TIME:g} s; start some with:"
            " dask worker ADDRESS"
        ) from error
    try:
        versions = client.run(identity)
    except Exception as error:
        raise UsageError(
            f"cluster = {cluster!r}: a worker cannot import dem_bridge {__version__} ({type(error).__name__}: {error});"
            " install it there"
        ) from error
    here = identity()
    for worker, (version, code) in versions.items():
        if (version, code) != here:
            raise UsageError(
                f"cluster = {cluster!r}: the worker {worker} has dem_bridge {version} with code {code}; allowed:"
                f" {here[0]} with code {here[1]}, as here; install the same on all workers"
            )
