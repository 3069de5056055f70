"""Processes of our own that solve cases: one that dies is replaced, one that hangs is ended."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from types import ModuleType

from dem_bridge.errors import RunBroken
from dem_bridge.foundation.kernel_folders import folder_to_write
from dem_bridge.foundation.progress import Campaign, stop_requested
from dem_bridge.lmp.child import how_ended
from dem_bridge.lmp.loaded import stop_idle
from dem_bridge.runs.campaign.tasks import Outcome, Task, Work, broken, packed, perform

#: s for which the campaign sleeps at most: a signal that comes just before the sleep waits no longer
SLICE = 0.2
#: s that a process may take to end its own children and delete its files
_GRACE = 5.0
#: processes that may die in a row before they can begin
_FAILED_STARTS = 3


def run_in_processes(
    tasks: Sequence[Task], workers: int, state: Campaign, *, main: bool
) -> Iterator[tuple[Task, Outcome]]:
    """Yield each task with its outcome, as they come; ``main``: a task needs the main program.

    A task whose process dies is done once more, and is broken if that process dies, too. A process that takes longer
    than the patience for its task is ended, and the task is broken.

    Raises
    ------
    RunBroken
        If no process can begin.
    """
    work, failed_starts = Work(tasks, workers), 0
    folder_to_write()  # a temporary one is shared by all processes, and said once
    with _processes(workers, main) as processes:
        while work.pending or any(process.tasks for process in processes):
            if stop_requested():
                work.pending.clear()
            for process in processes:
                if work.pending and process.is_idle:
                    process.assign(work.pending.popleft())
            state.update(running=tuple(process.tasks[0].case.label for process in processes if process.tasks))
            ready = wait([process.connection for process in processes], timeout=SLICE)
            for at, process in enumerate(processes):
                if process.connection in ready and process.has_outcome():
                    failed_starts = 0
                    yield from process.outcomes(work)
                elif process.connection in ready or process.overdue is not None:
                    processes[at] = process.replaced(main)
                    failed_starts += not process.started
                    if failed_starts >= _FAILED_STARTS:
                        raise RunBroken(
                            f"{failed_starts} processes died before they could begin ({process.end}); where memory is"
                            " short, or a process cannot begin, take jobs = 1"
                        )
                    yield from _died(work, process)


def _died(work: Work, process: WorkerProcess) -> Iterator[tuple[Task, Outcome]]:
    """Take the tasks of a process that died: the first is the one that it was at."""
    if not process.tasks:
        return
    task, *others = process.tasks
    if others:
        work.pending.appendleft(others)
    if process.overdue is not None:
        yield task, broken(f"{task.case.label}: it did not end within {process.overdue:g} s", process.end)
    else:
        yield from work.lost([task], process.end)


class WorkerProcess:
    """A process that solves cases, and the tasks that it has."""

    def __init__(self, main: bool) -> None:
        # spawn: compiled code and engines do not survive a fork of a process with threads
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.tasks: deque[Task] = deque()
        self.started = False
        self.end = ""
        """How it ended, in words."""
        self._since, self._outcome = time.monotonic(), None
        self._process: SpawnProcess = context.Process(target=serve_tasks, args=(theirs,), daemon=True)
        # Ctrl-C ends the campaign, which ends its processes: they never see it, not even while they begin
        before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        try:
            with hide_main(main):
                self._process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        theirs.close()

    @property
    def is_idle(self) -> bool:
        """Return True if it has begun and has no task."""
        return self.started and not self.tasks

    @property
    def overdue(self) -> float | None:
        """Time that its task may take, s, if it has taken longer; otherwise None."""
        if not self.tasks or time.monotonic() - self._since < (patience := self.tasks[0].patience):
            return None
        return patience

    def assign(self, tasks: Sequence[Task]) -> None:
        """Give it tasks."""
        self.tasks.extend(tasks)
        self._since = time.monotonic()
        with suppress(OSError):  # it has died, as the next look at it shows
            self.connection.send([packed(task) for task in tasks])

    def has_outcome(self) -> bool:
        """Read what it has sent; False: it has died."""
        try:
            self._outcome = self.connection.recv()
        except (EOFError, OSError):
            return False
        return True

    def outcomes(self, work: Work) -> Iterator[tuple[Task, Outcome]]:
        """Yield the task that it has done, with its outcome; none where it has only begun."""
        self.started, self._since = True, time.monotonic()
        if self._outcome is not None:
            yield from work.done(self.tasks.popleft(), self._outcome)

    def replaced(self, main: bool) -> WorkerProcess:
        """End it, note how it ended, and return another."""
        overdue = self.overdue
        self.stop()
        code = self._process.exitcode or 0
        late = "" if overdue is None else f" after {overdue:g} s, in which it had no result"
        self.end = f"process {self._process.pid} ended {how_ended(code)}{late}"
        return WorkerProcess(main)

    def terminate(self) -> None:
        """Ask it to end, so that it ends its own children and deletes its files."""
        self._process.terminate()

    def stop(self) -> None:
        """End it, if need be by force."""
        self.terminate()
        self._process.join(_GRACE)
        if self._process.exitcode is None:
            self._process.kill()
            self._process.join()
        self.connection.close()


@contextmanager
def _processes(count: int, main: bool) -> Iterator[list[WorkerProcess]]:
    """Provide processes; none of them remains, whatever happens."""
    processes: list[WorkerProcess] = []
    try:
        while len(processes) < count:
            processes.append(WorkerProcess(main))
        yield processes
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            process.stop()


def serve_tasks(connection: Connection) -> None:
    """Solve cases as they come, until there are no more; this is what a process does."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # ... and engines, which they start, do not either
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
    signal.signal(signal.SIGTERM, _leave)
    threading.Thread(target=guard_parent_death, daemon=True).start()
    connection.send(None)
    with suppress(EOFError):
        while True:
            for task in connection.recv():
                signal.signal(signal.SIGTERM, _end)
                outcome = perform(task)
                signal.signal(signal.SIGTERM, _leave)
                connection.send(outcome)


def _leave(*_: object) -> None:
    """End at once: without a task nothing remains but engines that wait, and the interpreter's end takes 0.5 s."""
    stop_idle()
    os._exit(128 + signal.SIGTERM)


def _end(*_: object) -> None:
    """End in order: engines are stopped and temporary folders deleted, which a second signal must not interrupt."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    sys.exit(128 + signal.SIGTERM)


def guard_parent_death() -> None:
    """End this process when the one that started it ends."""
    parent = multiprocessing.parent_process()
    assert parent is not None  # a worker has one
    parent.join()
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(_GRACE)
    os._exit(1)


@contextmanager
def hide_main(needed: bool) -> Iterator[None]:
    """Hide the main program from new processes, unless they need it.

    A program that runs as a whole when it is imported, without ``if __name__ == "__main__"``, would run again in each.
    """
    main = sys.modules["__main__"]
    if not needed:
        sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main
