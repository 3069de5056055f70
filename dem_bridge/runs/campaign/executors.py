"""Cases solved by an executor of somebody else: threads, processes, Dask, MPI."""

from __future__ import annotations

import os
import tempfile
import time
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    FIRST_EXCEPTION,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ThreadPoolExecutor,
    wait,
)
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Generic, TypeVar
from uuid import uuid4

from dem_bridge.errors import RunBroken
from dem_bridge.foundation.leftovers import owned
from dem_bridge.foundation.progress import Campaign, stop_requested
from dem_bridge.runs.campaign.pool import SLICE, run_in_processes
from dem_bridge.runs.campaign.tasks import Outcome, Task, Work, broken, packed, perform_all
from dem_bridge.runs.digits import fingerprint

Item = TypeVar("Item")
Value = TypeVar("Value")
#: number of processes; None: as many as pay; or where cases are run instead
Jobs = int | Executor | None
#: workers of an executor that does not tell their number
_WORKERS = 16
#: s in which a worker says which digits it computes
ANSWER_TIME = 60.0
#: chunks that an executor has at a time: enough for a cluster to see how many workers are needed
MOST_AWAY = 1000


class Away(Generic[Item, Value]):
    """The calls that an executor has been given: not too many at a time, so that memory is constant.

    Parameters
    ----------
    submit : callable
        Gives the call for an item to the executor.
    """

    def __init__(self, submit: Callable[[Item], Future[Value]]) -> None:
        self._submit = submit
        self.items: dict[Future[Value], Item] = {}

    def fill(self, pending: deque[Item], most: int) -> None:
        """Submit pending items until ``most`` calls are away; an item that cannot be submitted stays pending."""
        while pending and len(self.items) < most:
            future = self._submit(pending[0])
            self.items[future] = pending.popleft()

    def ended(self) -> Iterator[tuple[Item, Future[Value]]]:
        """Yield the calls that have ended; wait for one, but only so long that Ctrl-C is not lost."""
        done, _ = wait(self.items, timeout=SLICE, return_when=FIRST_COMPLETED)
        for future in done:
            yield self.items.pop(future), future

    def cancel(self) -> None:
        """Cancel the calls that have not begun."""
        self.items = {future: item for future, item in self.items.items() if not future.cancel()}


def run_by_executor(tasks: Sequence[Task], executor: Executor, state: Campaign) -> Iterator[tuple[Task, Outcome]]:
    """Yield each task with its outcome, as they come.

    The tasks of a chunk whose worker dies are done once more, each alone, and one that dies again is broken. Where
    nothing comes for longer than the patience for all tasks that are away, these are broken. A pool of processes that
    is broken is replaced by processes of our own.

    Raises
    ------
    RunBroken
        If the executor takes no more tasks, or drops those that it has.
    """
    folder = next((task.folder for task in tasks if task.folder is not None), None)
    if folder is not None and not shares_folder(executor, folder):
        tasks = [replace(task, folder=None) for task in tasks]
    work, since = Work(tasks, workers_of(executor)), time.monotonic()
    away = Away[list[Task], list[Outcome]](partial(_submit, executor))
    try:
        while work.pending or away.items:
            if stop_requested():
                work.pending.clear()
                away.cancel()
            try:
                away.fill(work.pending, MOST_AWAY)
            except BrokenExecutor:  # processes on this machine, of which one died: ours go on
                rest = [task for chunk in (*away.items.values(), *work.pending) for task in chunk]
                away.items.clear()
                yield from run_in_processes(rest, workers_of(executor), state, main=False)
                return
            running = (chunk[0].case.label for future, chunk in away.items.items() if future.running())
            state.update(running=tuple(running))
            for chunk, future in away.ended():
                since = time.monotonic()
                try:
                    outcomes = future.result()
                except CancelledError as error:
                    raise _gone("dropped the cases that it had", error) from error
                except Exception as error:
                    # Dask has already tried a killed task on several workers
                    again = len(chunk) > 1 or type(error).__name__ != "KilledWorker"
                    yield from work.lost(chunk, f"{type(error).__name__}: {error}", again=again)
                    continue
                for task, outcome in zip(chunk, outcomes, strict=True):
                    yield from work.done(task, outcome)
            if away.items and time.monotonic() - since > (patience := _patience(away.items.values())):
                late = [task for chunk in away.items.values() for task in chunk]
                away.cancel()
                away.items.clear()
                for task in late:
                    yield task, broken(f"{task.case.label}: nothing came back within {patience:g} s", "")
    finally:
        away.cancel()


def map_in_threads(function: Callable[[Item], Value], items: Iterable[Item], jobs: Jobs) -> list[Value]:
    """Return the values of a function, computed by threads: ``jobs`` of them, or one for each core.

    For work that leaves the interpreter to others: compiled code, or engines in processes of their own.
    """
    pool = ThreadPoolExecutor(jobs if isinstance(jobs, int) else len(os.sched_getaffinity(0)))
    try:
        futures = [pool.submit(function, item) for item in items]
        while wait(futures, timeout=SLICE, return_when=FIRST_EXCEPTION).not_done:
            for failed in (future for future in futures if future.done() and future.exception()):
                failed.result()
        return [future.result() for future in futures]
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def workers_of(executor: Executor) -> int:
    """Return the number of workers of an executor, or a guess; the standard has no way to ask."""
    if (client := getattr(executor, "_client", None)) is not None:  # of Dask
        return sum(client.nthreads().values()) or _WORKERS
    return int(getattr(executor, "_max_workers", None) or _WORKERS)


def fingerprint_of(executor: Executor) -> str:
    """Return the fingerprint of the workers of an executor, of several the most common; '' if there is no answer."""
    try:
        if (client := getattr(executor, "_client", None)) is not None:  # of Dask
            answers = list(client.run(fingerprint).values())
        else:
            future = executor.submit(fingerprint)
            answers = [future.result(timeout=ANSWER_TIME)]
    except Exception:  # of a worker that cannot do anything: that shows where cases are run
        return ""
    return Counter(answers).most_common(1)[0][0] if answers else ""


def shares_folder(executor: Executor, folder: Path) -> bool:
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
        return executor.submit(perform_all, [packed(task) for task in chunk], uuid4().hex)
    except BrokenExecutor:
        raise
    except Exception as error:
        raise _gone("takes no more cases", error) from error


def _gone(event: str, error: Exception) -> RunBroken:
    """Return the error for an executor that was shut down, or lost its scheduler."""
    return RunBroken(
        f"the executor {event} ({' '.join(f'{type(error).__name__}: {error}'.split())}); runs that ended are in the"
        " store if there is one: call again with an executor that works"
    )


def _patience(chunks: Collection[Sequence[Task]]) -> float:
    """Return the time within which one of several chunks ends, if no worker hangs, s."""
    return max(sum(task.patience for task in chunk) for chunk in chunks)
