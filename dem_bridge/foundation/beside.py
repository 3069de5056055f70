"""Call functions in another process of Python, beside what this one does.

The process is a program of its own: the main program of this one is not run there, so that a function or a value of it
cannot go there. Whoever asks has the value made here then.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

from dem_bridge.foundation.isolated import start_script

_CHILD = Path(__file__).with_name("beside_child.py")


class Unanswered(Exception):
    """The other process has no value: it has ended, or what was asked cannot go there, or failed there."""


class Beside:
    """A process that calls functions one after another, in the order in which they were asked for.

    It imports ``modules`` when it starts. It ends when :meth:`end` is called, and when this process ends.

    Raises
    ------
    OSError
        If no process can be started.
    """

    def __init__(self, *modules: str) -> None:
        self._process = start_script(_CHILD, *modules)
        # a question may be larger than a pipe takes while the process still imports
        self._thread, self._asked = ThreadPoolExecutor(1), list[Future[Any]]()

    @property
    def waiting(self) -> int:
        """Return how many questions have no answer yet."""
        return sum(not future.done() for future in self._asked)

    def ask(self, question: bytes) -> Callable[[], Any]:
        """Have a function called with its arguments, which :func:`packed` packs; return a function that awaits it.

        That function raises Unanswered if there is no value.
        """
        future = self._thread.submit(self._answer, question)
        self._asked.append(future)

        def wait() -> Any:
            try:
                return future.result()
            except CancelledError as error:
                raise Unanswered("the process was ended") from error

        return wait

    def _answer(self, question: bytes) -> Any:
        assert self._process.stdin is not None
        try:
            for part in (len(question).to_bytes(8, "little"), question):
                view = memoryview(part)
                while view:
                    view = view[self._process.stdin.write(view) :]
            fine, value = pickle.loads(self._take(int.from_bytes(self._take(8), "little")))
        except (OSError, EOFError, ValueError) as error:  # it has ended, or is ended just now
            raise Unanswered(str(error)) from error
        if not fine:
            raise Unanswered(value)
        return value

    def _take(self, count: int) -> bytes:
        """Return the next bytes that the process writes."""
        assert self._process.stdout is not None
        out = bytearray()
        while len(out) < count:
            if not (part := self._process.stdout.read(count - len(out))):
                raise EOFError("the process has ended")
            out += part
        return bytes(out)

    def end(self) -> None:
        """End the process; what was not answered yet is Unanswered."""
        self._process.kill()
        self._process.wait()
        self._thread.shutdown(cancel_futures=True)
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            with suppress(OSError):
                pipe.close()


def packed(function: Callable[..., Any], *arguments: Any) -> bytes | None:
    """Return a function of a module with its arguments as they go to another process; None if they cannot."""
    try:
        return pickle.dumps((function, arguments), protocol=5)
    except Exception:  # classes raise exceptions of many types
        return None
