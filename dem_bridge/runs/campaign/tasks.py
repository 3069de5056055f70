"""Define what travels between a campaign and the processes that work for it: tasks there, outcomes back.

A task is pickled to bytes, so that every executor can carry it. Where there is a store, the worker itself writes the
run into it; then only the key travels back, not the arrays.
"""

from __future__ import annotations

import pickle
import traceback
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from dem_bridge.backends.base import ENGINE_BACKENDS
from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.runs.cache import RunCache
from dem_bridge.runs.campaign.identity import check_identity, identity
from dem_bridge.runs.campaign.results import Crashed, Failure, run_case
from dem_bridge.runs.case import Case
from dem_bridge.runs.digits import fingerprint, made_at, planned_fingerprint
from dem_bridge.runs.keys import same_engine
from dem_bridge.runs.locks import locked, wait_for_release
from dem_bridge.runs.store import Store
from dem_bridge.trajectory.trajectory import Trajectory
from dem_bridge.version import __version__

#: s of expected work that travel together
_CHUNK = 1.0
#: chunks for each worker, so that all workers end at about the same time
CHUNKS_EACH = 4
#: a worker may take the time limit of a case, this factor times its expected time, and so many s
_FACTOR, _MARGIN = 100.0, 60.0
#: s for which a worker waits for another campaign until it is given another task
PAUSE = 1.0


@dataclass(frozen=True, kw_only=True)
class Task:
    """A case that a worker solves."""

    name: str
    case: Case
    everything: bool = False
    """Wrong settings and crashes are results, too."""
    key: str | None = None
    """Key of the run in the store."""
    folder: Path | None = None
    """Folder of the store; None: the run travels back."""
    limit: int = 0
    """Size limit of the store, bytes."""
    shared: bool = False
    """Other cases need the runs and families that are made for it."""
    recompute: bool = False
    """The run is made even if the store has it."""
    waits: bool = False
    """Another campaign was at the run: its worker waits for it for a while."""
    here: bool = False
    """It is solved in the process that planned it."""
    version: str = __version__
    code: str = ""
    """Hash of the code of the campaign, once the task travels."""

    @property
    def patience(self) -> float:
        """Wall time after which its worker is taken for hanging, s.

        An engine ends its run by itself after the time limit of the case (an hour unless the settings say otherwise);
        the time that other codes are expected to take is a rough estimate.
        """
        return self.case.resolution.time_limit + _FACTOR * self.case.expected + _MARGIN


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Hold what a worker returns of a task; the case does not travel back."""

    trajectory: Trajectory | None = None
    failure: Failure | None = None
    error: Exception | None = None
    """What the campaign stops with, in place of a result."""
    kept: bool = False
    """The run is in the store, and not here."""
    locked: bool = False
    """Another campaign is at the run, and it was not made."""
    key: str | None = None
    """Key of the run where it was made; None: it cannot be stored."""
    digits: str = ""
    """Fingerprint of the place where the run was made."""
    cache: RunCache | None = None
    """Runs and families that others need."""
    trouble: str = ""
    """Problem with the store."""


def packed(task: Task) -> bytes:
    """Return a task as it travels to another process, with the version and the code that the process must have."""
    version, code = identity()
    return pickle.dumps(replace(task, version=version, code=code))


def perform(packed: bytes) -> Outcome:
    """Solve the case of a pickled task; never raises. What a worker does."""
    try:
        task = pickle.loads(packed)
    except Exception as error:
        return Outcome(error=RunBroken(f"a case cannot be read in another process: {type(error).__name__}: {error}"))
    try:
        check_identity((task.version, task.code))
    except UsageError as error:
        return Outcome(error=error)
    return perform_task(task)


def perform_task(task: Task) -> Outcome:
    """Solve the case of a task; never raises. A run that another campaign makes or has stored is not made again."""
    with lock_of(task) as free:
        if not free:
            return Outcome(locked=True)
        return Outcome(kept=True) if is_stored(task) else _perform(task)


def _perform(task: Task) -> Outcome:
    cache = RunCache()
    try:
        result = run_case(task.case, everything=task.everything, cache=cache)
    except Exception as error:
        return Outcome(error=_portable(error))
    shared = cache if task.shared else None
    run, key = result.trajectory, key_where_made(task.case, task.key, here=task.here)
    if run is None or task.folder is None or key is None or key != task.key:
        digits = "" if key is None else fingerprint()
        return Outcome(trajectory=run, failure=result.failure, cache=shared, key=key, digits=digits)
    store = _store(task.folder, task.limit)
    if not store.save(key, run):
        return Outcome(trajectory=run, cache=shared, trouble=store.trouble, key=key, digits=fingerprint())
    cache.runs.pop(replace(task.case, uncertainty=False), None)
    return Outcome(kept=True, cache=shared, trouble=store.trouble)


def key_where_made(case: Case, planned: str | None, *, here: bool = True) -> str | None:
    """Return the key of a case that was just solved: again, unless it must be the planned one.

    An engine may have become another meanwhile, and another machine has other keys. ``here``: this process planned it.
    """
    own_place = here and planned_fingerprint() == fingerprint()
    if planned is None or (own_place and (case.backend not in ENGINE_BACKENDS or same_engine(planned, case.engine))):
        return planned
    with made_at(""):
        return case.key


def perform_all(chunk: Sequence[bytes], number: str) -> list[Outcome]:
    """Solve the cases of pickled tasks one by one. What a worker of an executor does.

    ``number`` is another at each call: Dask takes calls with the same arguments for the same.
    """
    return [perform(packed) for packed in chunk]


def is_stored(task: Task) -> bool:
    """Return True if the store has the run of a task, and no other case needs what is made for it."""
    if task.folder is None or task.key is None or task.shared or task.recompute:
        return False
    return _store(task.folder, task.limit).has(task.key)


@contextmanager
def lock_of(task: Task) -> Iterator[bool]:
    """Lock the run of a task within this context; yield False if another campaign is at it."""
    if task.folder is None or task.key is None or task.shared or task.recompute:
        yield True
        return
    about = task.folder, task.key, task.case.expected
    if task.waits:
        wait_for_release(*about, at_most=PAUSE)
    with locked(*about) as free:
        yield free


def with_run(task: Task, outcome: Outcome) -> Outcome | None:
    """Return an outcome with its run, read from the store; None: the run is not there."""
    if not outcome.kept:
        return outcome
    assert task.folder is not None
    assert task.key is not None
    run = _store(task.folder, task.limit).load(task.key, task.case.scene)
    if run is None:
        return None
    provenance = {name: value for name, value in run.provenance.items() if name != "stored"}  # it was made just now
    return replace(outcome, trajectory=replace(run, provenance=provenance))


@cache
def _store(folder: Path, limit: int) -> Store:
    return Store(folder, limit=limit)


def _portable(error: Exception) -> Exception:
    """Return an exception that can travel to another process."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return Crashed(f"{type(error).__name__}: {error}", log=traceback.format_exc())
    return error


class Work:
    """The tasks that are still to be done, and how often each has ended its worker."""

    def __init__(self, tasks: Sequence[Task], workers: int) -> None:
        self.pending = deque(_chunks(tasks, workers))
        self._deaths: dict[str, str] = {}

    def lost(self, tasks: Sequence[Task], how: str, *, again: bool = True) -> Iterator[tuple[Task, Outcome]]:
        """Take tasks whose worker died; each is done once more, alone, and is then broken. Yield the broken ones.

        ``again``: False if the worker died more than once already.
        """
        for task in tasks:
            before = self._deaths.get(task.name)
            if before is not None or not again:
                log = how if before is None else f"{before}\n{how}"
                yield task, broken(f"{task.case.label}: its process died twice", log)
            else:
                self._deaths[task.name] = how
                self.pending.appendleft([task])

    def done(self, task: Task, outcome: Outcome) -> Iterator[tuple[Task, Outcome]]:
        """Yield a task and its outcome; one whose run is not in the store is done again, and the run travels back.

        One that another campaign is at comes last.
        """
        if outcome.locked:
            self.pending.append([replace(task, waits=True)])
        elif (complete := with_run(task, outcome)) is None:
            self.pending.appendleft([replace(task, folder=None)])
        else:
            yield task, complete


def broken(message: str, log: str) -> Outcome:
    """Return the outcome of a case whose worker did not survive it."""
    return Outcome(failure=Crashed(message, log=log))


def _chunks(tasks: Sequence[Task], workers: int) -> Iterator[list[Task]]:
    """Yield tasks in their order, short ones together."""
    work = sum(min(task.case.expected, _CHUNK) for task in tasks)
    most, chunk, seconds = min(_CHUNK, work / (workers * CHUNKS_EACH)), list[Task](), 0.0
    for task in tasks:
        if chunk and seconds + task.case.expected > most:
            yield chunk
            chunk, seconds = [], 0.0
        chunk.append(task)
        seconds += task.case.expected
    if chunk:
        yield chunk
