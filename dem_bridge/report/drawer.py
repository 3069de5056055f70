"""Draw pictures in a process beside this one, which is started as soon as it is clear that pictures will be needed.

matplotlib takes half a second of CPU to import, and a picture a tenth. Where this process has imported matplotlib, has
one core, or cannot start another process, pictures are drawn here when they are asked for.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from threading import Lock
from typing import Any, TypeVar

from dem_bridge.foundation.beside import Beside, Unanswered, packed

R = TypeVar("R")
#: pictures that wait for a process, from which on the start of a further one is worth its half second
_MANY = 6
#: what the process imports when it starts
_IMPORTED = ("dem_bridge.report.drawing", "matplotlib.backends.backend_svg")


class Drawer:
    """A process that draws, and further ones while many pictures wait, with what they were asked for."""

    def __init__(self) -> None:
        self._processes, self._owner = [Beside(*_IMPORTED)], os.getpid()
        self._begun: dict[bytes, Callable[[], Any]] = {}

    def begin(self, function: Callable[..., R], *arguments: Any) -> Callable[[], R]:
        """Begin to draw, unless the same was begun before; return a function that awaits the picture."""
        question = packed(function, *arguments) if self._owner == os.getpid() else None
        if question is None:
            return lambda: function(*arguments)
        digest = hashlib.sha256(question).digest()
        if digest not in self._begun:
            self._begun[digest] = self._free().ask(question)
        answer = self._begun[digest]

        def wait() -> R:
            try:
                picture: R = answer()
                return picture
            except Unanswered:
                return function(*arguments)

        return wait

    def _free(self) -> Beside:
        """Return the process with the fewest pictures to draw, a further one if these are many."""
        free = min(self._processes, key=lambda process: process.waiting)
        if free.waiting < _MANY or len(self._processes) >= len(os.sched_getaffinity(0)):
            return free
        with suppress(OSError):
            free = Beside(*_IMPORTED)
            self._processes.append(free)
        return free

    def end(self) -> None:
        """End the processes."""
        if self._owner == os.getpid():
            for process in self._processes:
                process.end()


_lock = Lock()
#: for each context that needs pictures, its drawer once there is one
_contexts: list[list[Drawer]] = []


@contextmanager
def drawing_beside(*, wanted: bool = True) -> Iterator[None]:
    """Let :func:`prepare_drawing` start a process that draws, if pictures are ``wanted``; it ends with this context."""
    if not wanted:
        yield
        return
    context: list[Drawer] = []
    _contexts.append(context)
    try:
        yield
    finally:
        with _lock:
            _contexts.remove(context)
        for drawer in context:
            drawer.end()


def prepare_drawing() -> None:
    """Start the process that draws, unless there is one, or none is of use."""
    with _lock:
        of_use = "matplotlib" not in sys.modules and len(os.sched_getaffinity(0)) > 1
        if of_use and _contexts and not _contexts[-1]:
            with suppress(OSError):  # no process can be started: pictures are drawn here
                _contexts[-1].append(Drawer())


def drawn(function: Callable[..., R], *arguments: Any) -> Callable[[], R]:
    """Return a function that returns ``function(*arguments)``, a picture that is being drawn if a process draws.

    The function must be one of a module of this package, and draw from its arguments alone.
    """
    drawer = next((drawer for context in reversed(_contexts) for drawer in context), None)
    if drawer is None:
        return lambda: function(*arguments)
    return drawer.begin(function, *arguments)


def is_drawing_beside() -> bool:
    """Return True if there is a process that draws."""
    return any(_contexts)
