"""Solve cases in this process, and those of an engine, which is a process of its own, beside the others.

A thread starts one engine after another while the main thread solves the other cases. Once these are done, the main
thread takes a share of the engines, too.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack
from contextvars import copy_context
from dataclasses import dataclass, replace
from functools import partial
from itertools import filterfalse
from queue import Empty, SimpleQueue

from dem_bridge.backends.base import ENGINE_BACKENDS
from dem_bridge.foundation.progress import Campaign, Interrupted, listening, stop_requested
from dem_bridge.runs.campaign.tasks import Outcome, Task, is_stored, lock_of, perform_task, with_run
from dem_bridge.runs.case import Case

#: called with a label and the time that of the work of its run is done, s
Say = Callable[[str, float], None]
#: s for which the main thread sleeps at most: a signal that comes just before the sleep waits no longer
_SLICE = 0.2


@dataclass(frozen=True)
class _Made:
    """A task with its outcome, or the error of the thread that was at it; the lock of its run is held until closed."""

    task: Task
    lock: ExitStack
    outcome: Outcome | None = None
    error: BaseException | None = None


def run_here(
    tasks: Sequence[Task], say: Say, state: Campaign, *, beside: bool
) -> Generator[tuple[Task, Outcome], None, None]:
    """Yield each task with its outcome, as they come; a run is stored before the lock on it ends.

    ``beside``: engines run beside other cases, and two at a time. When a stop is requested, runs that have begun are
    finished, and no other begins. Where the campaign ends otherwise, a run that has begun is ended.
    """
    engines, others = (list(filter(_is_of_engine, tasks)), list(filterfalse(_is_of_engine, tasks)))
    if not beside or len(tasks) < 2 or not engines:
        waiting = _Waiting(tasks)
        while (task := waiting.take()) is not None:
            yield from _solved(task, waiting, say, state, ())
        return
    # the shortest of the others are first, so that what is read off them is there early
    waiting = _Waiting([*engines, *reversed(others)])
    thread = _EngineThread(waiting)
    try:
        while True:
            while (made := thread.made(0.0)) is not None:
                yield from _outcome_of(made)
            if (task := waiting.take(of_engine=False) or waiting.take()) is not None:
                yield from _solved(task, waiting, say, state, thread.running)
            elif thread.is_done:
                return
            else:
                state.update(running=thread.running)
                if (made := thread.made(_SLICE)) is not None:
                    yield from _outcome_of(made)
    finally:
        thread.end()


def can_run_beside(jobs: int | None, cases: Sequence[Case]) -> bool:
    """Return True if the number of runs at a time is free, and there are cores for two runs of an engine."""
    ranks = max((case.engine.ranks for case in cases if case.engine is not None), default=1)
    return jobs is None and len(os.sched_getaffinity(0)) >= 2 * ranks


def _is_of_engine(task: Task) -> bool:
    """Return True for a run in a process of its own."""
    return task.case.backend in ENGINE_BACKENDS


class _Waiting:
    """Tasks that have not begun, in their order."""

    def __init__(self, tasks: Sequence[Task]) -> None:
        self._tasks, self._lock = list(tasks), threading.Lock()

    def take(self, *, of_engine: bool | None = None) -> Task | None:
        """Take the first task, or with ``of_engine`` the first of an engine (True) or of none (False).

        Return None where there is none, or a stop is requested.
        """
        with self._lock:
            if stop_requested():
                return None
            fits = (place for place, task in enumerate(self._tasks) if of_engine in (None, _is_of_engine(task)))
            place = next(fits, None)
            return None if place is None else self._tasks.pop(place)

    def put_back(self, task: Task) -> None:
        """Put back a task that another campaign is at: it comes last."""
        with self._lock:
            self._tasks.append(replace(task, waits=True))


class _EngineThread:
    """A thread that runs the tasks of engines, one after another."""

    def __init__(self, waiting: _Waiting) -> None:
        self._waiting = waiting
        self._made: SimpleQueue[_Made] = SimpleQueue()
        self._ended = threading.Event()
        self.running: tuple[str, ...] = ()
        """Label of the task that is being run."""
        # daemon: a program that is stopped at once does not wait for it
        self._thread = threading.Thread(target=copy_context().run, args=(self._run,), daemon=True)
        self._thread.start()

    @property
    def is_done(self) -> bool:
        """Return True if it runs nothing any more, and all that it has made was taken."""
        return not self._thread.is_alive() and self._made.empty()

    def made(self, seconds: float) -> _Made | None:
        """Return what was made first and not taken yet, waiting for it at most so many s."""
        try:
            return self._made.get(timeout=seconds) if seconds else self._made.get_nowait()
        except Empty:
            return None

    def end(self) -> None:
        """End what it runs, and wait for its end."""
        self._ended.set()
        self._thread.join()
        while (made := self.made(0.0)) is not None:
            made.lock.close()

    def _run(self) -> None:
        while not self._ended.is_set() and (task := self._waiting.take(of_engine=True)) is not None:
            self.running, lock = (task.case.label,), ExitStack()
            try:
                if lock.enter_context(lock_of(task)):
                    with listening(self._check):
                        self._made.put(_Made(task, lock, _perform(task)))
                else:
                    lock.close()
                    self._waiting.put_back(task)
            except BaseException as error:  # carried to the main thread
                self._made.put(_Made(task, lock, error=error))
                return
            finally:
                self.running = ()

    def _check(self, _: float) -> None:
        """Stop the run that calls this, if it is to end."""
        if self._ended.is_set():
            raise Interrupted


def _outcome_of(made: _Made) -> Iterator[tuple[Task, Outcome]]:
    """Yield the task and the outcome of what a thread has made, and end the lock on it, or raise the thread's error."""
    with made.lock:
        if made.error is not None:
            raise made.error
        assert made.outcome is not None
        yield made.task, made.outcome


def _solved(
    task: Task, waiting: _Waiting, say: Say, state: Campaign, others: tuple[str, ...]
) -> Iterator[tuple[Task, Outcome]]:
    """Solve a task, and yield it with its outcome; put it back where another campaign is at it."""
    label = task.case.label
    say(label, 0.0)
    state.update(running=(label, *others))
    with lock_of(task) as free:
        if not free:
            waiting.put_back(task)
            return
        with listening(partial(_within, say, label, task.case.expected)):
            outcome = _perform(task)
        yield task, outcome


def _perform(task: Task) -> Outcome:
    """Return the outcome of a task: the run that the store has by now, or that is made."""
    stored = with_run(task, Outcome(kept=True)) if is_stored(task) else None
    return stored or perform_task(replace(task, folder=None, here=True))


def _within(say: Say, label: str, expected: float, part: float) -> None:
    say(label, part * expected)
