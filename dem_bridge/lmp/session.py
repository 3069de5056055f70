"""Many short decks in one process of the engine, for searches: a deck takes 5 ms of CPU there, a process 100 ms."""

from __future__ import annotations

import json
import os
import select
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.process import deck_worker, run_deck, workspace


class Session:
    """Run decks one after another, each in an instance of LAMMPS of its own, but all in one process.

    A deck that fails is run again in a process of its own, whose error is raised; another process takes the next deck.
    A binary, or an engine on several ranks, has a process for each deck.
    """

    def __init__(self, engine: Engine, folder: Path, time_limit: float, resources: ExitStack) -> None:
        self.engine, self.folder, self.time_limit = engine, folder, time_limit
        self._resources = resources
        self._exchange: Callable[[bytes], bytes] | None = None

    def run(self, input_file: str) -> None:
        """Run a deck of the folder; raise as :func:`~dem_bridge.lmp.process.run_deck`."""
        if self.engine.lmp is None and self.engine.ranks == 1 and self._runs(input_file):
            return
        run_deck(self.folder, input_file, time_limit=self.time_limit, engine=self.engine)

    def _runs(self, input_file: str) -> bool:
        """Return True if the deck ended without an error in the common process."""
        if self._exchange is None:
            self._exchange = self._started()
        reply = self._exchange(os.fsencode(input_file) + b"\n")
        if reply and json.loads(reply) == "":
            return True
        self._resources.close()
        self._exchange = None
        return False

    def _started(self) -> Callable[[bytes], bytes]:
        """Start the process; return a function that hands it a deck and waits for its reply, b"" if there is none."""
        ours, theirs = os.pipe()
        replies = self._resources.enter_context(os.fdopen(ours, "rb", buffering=0))
        with os.fdopen(theirs, "wb"):
            decks = self._resources.enter_context(deck_worker(self.engine, self.folder, theirs))

        def exchange(deck: bytes) -> bytes:
            try:
                decks.write(deck)
            except BrokenPipeError:
                return b""
            ready, _, _ = select.select([replies], [], [], self.time_limit)
            return replies.readline() if ready else b""

        return exchange


@contextmanager
def session(engine: Engine, *, time_limit: float) -> Iterator[Session]:
    """Yield a :class:`Session` in a temporary folder; nothing of it remains after the context.

    ``time_limit``: for each deck, s.
    """
    with workspace() as folder, ExitStack() as resources:
        yield Session(engine, folder, time_limit, resources)
