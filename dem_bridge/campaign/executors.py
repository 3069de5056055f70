"""Cases solved by an executor of somebody else: threads, processes, Dask, MPI."""

from __future__ import annotations

import os
import pickle
import tempfile
import time
from collections.abc import Collection, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from dataclasses import replace
from pathlib import Path

from dem_bridge.campaign.pool import SLICE
from dem_bridge.campaign.tasks import Outcome, Task, Work, broken, perform_all
from dem_bridge.errors import RunBroken
from dem_bridge.leftovers import owned

#: workers of an executor that does not tell their number
_WORKERS = 16


def run_by_executor(tasks: Sequence[Task], executor: Executor) -> Iterator[tuple[Task, Outcome]]:
    """Yield each task with its outcome, as they come.

    The tasks of a chunk whose worker dies are done once more, each alone, and one that dies again is broken. Where
    nothing comes for longer than the patience for all tasks that are away, these are broken.

    Raises
    ------
    RunBroken
        If the executor takes no more tasks.
    """
    away: dict[Future[list[Outcome]], list[Task]] = {}
    folder = next((task.folder for task in tasks if task.folder is not None), None)
    if folder is not None and not _shares(executor, folder):
        tasks = [replace(task, folder=None) for task in tasks]
    work, since = Work(tasks, workers_of(executor)), time.monotonic()
    try:
        while work.pending or away:
            while work.pending:
                chunk = work.pending.popleft()
                away[_submit(executor, chunk)] = chunk
            done, _ = wait(away, timeout=SLICE, return_when=FIRST_COMPLETED)
            for future in done:
                chunk, since = away.pop(future), time.monotonic()
                try:
                    outcomes = future.result()
                except (Exception, CancelledError) as error:
                    yield from work.lost(chunk, f"{type(error).__name__}: {error}")
                    continue
                for task, outcome in zip(chunk, outcomes, strict=True):
                    yield from work.done(task, outcome)
            if away and time.monotonic() - since > (patience := _patience(away.values())):
                for task in [task for future in list(away) for task in away.pop(future)]:
                    yield task, broken(task, f"{task.case.label}: nothing came back within {patience:g} s", "")
    finally:
        for future in away:
            future.cancel()


def workers_of(executor: Executor) -> int:
    """Return the number of workers of an executor, or a guess."""
    return int(getattr(executor, "_max_workers", None) or _WORKERS)


def _shares(executor: Executor, folder: Path) -> bool:
    """Return True if a worker sees the files of a folder; otherwise runs travel back by the executor."""
    try:
        with tempfile.NamedTemporaryFile(prefix=owned("shared"), dir=folder, suffix=".part") as file:
            future = executor.submit(os.path.exists, file.name)
            while not future.done():
                wait([future], timeout=SLICE)
            return future.result()
    except Exception:  # a folder that cannot be written; that of a worker shows where cases are run
        return False


def _submit(executor: Executor, chunk: Sequence[Task]) -> Future[list[Outcome]]:
    try:
        return executor.submit(perform_all, [pickle.dumps(task) for task in chunk])
    except Exception as error:
        raise RunBroken(
            f"the executor takes no more cases ({type(error).__name__}: {error}); runs that ended are in the store:"
            " call again with an executor that works"
        ) from error


def _patience(chunks: Collection[Sequence[Task]]) -> float:
    """Return the time within which one of several chunks ends, if no worker hangs, s."""
    return max(sum(task.patience for task in chunk) for chunk in chunks)
