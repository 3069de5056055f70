"""Report the progress of runs and campaigns to listeners, and pass on the request to begin no more runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from threading import Event

_listener: ContextVar[Callable[[float], None] | None] = ContextVar("listener", default=None)


def report(fraction: float) -> None:
    """Report to the listener that ``fraction`` (0 to 1) of the present run is done."""
    listener = _listener.get()
    if listener is not None:
        listener(min(max(fraction, 0.0), 1.0))


def has_listener() -> bool:
    """Return True if a listener is registered."""
    return _listener.get() is not None


@contextmanager
def listening(listener: Callable[[float], None]) -> Iterator[None]:
    """Call ``listener`` with the fraction done, within this context.

    Examples
    --------
    >>> seen = []
    >>> with listening(seen.append):
    ...     report(0.5)
    >>> seen
    [0.5]
    """
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


@contextmanager
def share(before: float, part: float) -> Iterator[None]:
    """Count the run within this context as a ``part`` of the whole, of which ``before`` is done already.

    Examples
    --------
    >>> seen = []
    >>> with listening(seen.append), share(0.5, 0.25):
    ...     report(1.0)
    >>> seen
    [0.75]
    """
    listener = _listener.get()
    if listener is None:
        yield
        return
    with listening(lambda fraction: listener(before + part * fraction)):
        yield


class Interrupted(KeyboardInterrupt):
    """A campaign that was asked to stop has ended the runs that had begun; the message says how many are done."""


@dataclass(kw_only=True)
class Campaign:
    """The state of a campaign: what is done, what has failed, and what is running."""

    total: int
    """Number of runs, with those that the store has."""
    done: int
    failures: int = 0
    """Runs that are broken."""
    running: tuple[str, ...] = ()
    """Labels of the cases that are being run."""

    def update(self, *, done: int = 0, failures: int = 0, running: tuple[str, ...] | None = None) -> None:
        """Count further runs, and tell those who watch unless nothing is new."""
        before = self.done, self.failures, self.running
        self.done, self.failures = self.done + done, self.failures + failures
        self.running = self.running if running is None else running
        if before != (self.done, self.failures, self.running):
            for watcher in _watchers:
                watcher(self)


_watchers: list[Callable[[Campaign], None]] = []
_campaigns: list[Campaign] = []
_stop = Event()


@contextmanager
def campaign(total: int, done: int) -> Iterator[Campaign]:
    """Yield the state of a campaign, which can be watched and asked to stop within this context.

    Examples
    --------
    >>> seen = []
    >>> with watching(lambda state: seen.append(state.done)), campaign(3, 1) as state:
    ...     state.update(done=1, running=("pair: verlet",))
    >>> seen
    [1, 2, 2]
    """
    state = Campaign(total=total, done=done)
    _campaigns.append(state)
    try:
        for watcher in _watchers:
            watcher(state)
        yield state
    finally:
        _campaigns.remove(state)
        state.update(running=())


@contextmanager
def watching(watcher: Callable[[Campaign], None]) -> Iterator[None]:
    """Call ``watcher`` with the state of every campaign when it changes, within this context."""
    _watchers.append(watcher)
    try:
        yield
    finally:
        _watchers.remove(watcher)


def request_stop() -> bool:
    """Ask all campaigns to begin no more runs; return False if there is none, or they were asked before."""
    if not _campaigns or _stop.is_set():
        return False
    _stop.set()
    return True


def stop_requested() -> bool:
    """Return True if no more runs are to begin."""
    return _stop.is_set()


def withdraw_stop() -> None:
    """Let runs begin again."""
    _stop.clear()
