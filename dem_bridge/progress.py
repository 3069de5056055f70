"""Reports of the progress of a run to a listener; without a listener they cost nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

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
