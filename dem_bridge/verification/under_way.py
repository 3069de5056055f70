"""Write the page of a verification while its runs are made: what has ended, and what is under way.

A thread writes the page, so that it is there from the first seconds on and also while one run lasts long.
"""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from dem_bridge.errors import UsageError
from dem_bridge.foundation.files import write_whole
from dem_bridge.foundation.progress import Campaign, watching
from dem_bridge.observables.verdict import Outcome
from dem_bridge.report.drawer import prepare_drawing
from dem_bridge.report.study import Table
from dem_bridge.report.texts import Texts, verdict_table
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.verification import Verification, verification_of

TEXTS = Texts("under-way", "dem_bridge.verification")
#: s between two pages, and until the first: a verification that takes less writes none
SECONDS_BETWEEN_PAGES = 5.0
#: s within which a case that a backend refuses has ended: nothing is drawn of it
_SECONDS_OF_A_REFUSAL = 0.1
#: a page is written at most so often that it takes this share of the time
_SHARE = 0.02


@dataclass(kw_only=True)
class UnderWay:
    """What has ended of a verification, and what is under way."""

    accuracy: float
    scenes: tuple[str, ...] = ()
    """Names of all scenes, once they are known."""
    studies: dict[int, SceneStudy] = field(default_factory=dict)
    """Scenes whose runs have all ended, by their places in :attr:`scenes`."""
    state: Campaign | None = None
    """The present campaign; None: none has begun."""
    trouble: str = ""
    """Why pages could not be written; empty if they could."""
    _drawing: threading.Timer | None = None
    """Prepares the drawing of what is run, unless nothing runs any more by then."""

    def watch(self, state: Campaign) -> None:
        """Note the state of a campaign; what is run will be drawn."""
        self.state = replace(state)
        if not state.running and self._drawing is not None:
            self._drawing.cancel()
            self._drawing = None
        elif state.running and self._drawing is None:
            self._drawing = threading.Timer(_SECONDS_OF_A_REFUSAL, prepare_drawing)
            self._drawing.daemon = True
            self._drawing.start()

    def page(self, *, interrupted: bool = False) -> dict[str, str | bytes]:
        """Return the page, and the tables beside it, by their names."""
        # it imports the templates, which a quick verification needs last
        from dem_bridge.report.page import study_files

        files = study_files(self.study(interrupted=interrupted), reload=None if interrupted else SECONDS_BETWEEN_PAGES)
        # the verdicts are a file of their own once they are complete
        return {name: text for name, text in files.items() if name == "index.html" or name.startswith("tables/")}

    def study(self, *, interrupted: bool = False) -> Verification:
        """Return the verification of the scenes that have ended, with what is under way as the first answer."""
        studies, state = [study for _, study in sorted(dict(self.studies).items())], self.state
        part = verification_of(studies, accuracy=self.accuracy, wall=0.0)
        tables = (_scene_table(self.scenes, studies), verdict_table(part.verdicts))
        title = "title-one" if len(self.scenes) == 1 else "title"
        return replace(
            part,
            title=TEXTS(title, scene=", ".join(self.scenes[:1]), scenes=len(self.scenes) or "all"),
            answer=(_progress(state, len(studies), len(self.scenes)), *part.answer),
            tables=tuple(table for table in tables if table.rows),
            interrupted=interrupted,
            provenance={},
        )


def _progress(state: Campaign | None, ended: int, scenes: int) -> str:
    """Return in words how many runs have ended, and which are under way."""
    if state is None:
        return TEXTS("begins")
    numbers = TEXTS("runs", done=state.done, total=state.total, failures=state.failures, ended=ended, scenes=scenes)
    running = TEXTS("running", running="; ".join(state.running)) if state.running else ""
    return " ".join(filter(None, (numbers, running or (TEXTS("judged") if state.done == state.total else ""))))


def _scene_table(scenes: Sequence[str], studies: Sequence[SceneStudy]) -> Table:
    """Return the number of verdicts by outcome of each scene."""
    ended = {study.scene.name: Counter(verdict.outcome for verdict in study.verdicts) for study in studies}
    rows = [
        (name, *(ended[name][outcome] if name in ended else "" for outcome in Outcome))
        for name in sorted(scenes, key=lambda name: name not in ended)
    ]
    return TEXTS.table("scenes", ("scene", *(outcome.value for outcome in Outcome)), rows)


@contextmanager
def write_pages(folder: Path | None, accuracy: float, every: float = SECONDS_BETWEEN_PAGES) -> Iterator[UnderWay]:
    """Yield the state of a verification, and write its page into ``folder`` every few seconds until the end.

    Where the verification is interrupted, the last page says so. A page that cannot be written ends the writing and
    not the verification; :attr:`UnderWay.trouble` has the reason.
    """
    under_way = UnderWay(accuracy=accuracy)
    if folder is None:
        yield under_way
        return
    writer = _Writer(under_way, folder, every)
    try:
        with watching(under_way.watch):
            yield under_way
    except BaseException:
        writer.end(interrupted=True)
        raise
    writer.end()


class _Writer:
    """The thread that writes the page of a verification again and again."""

    def __init__(self, under_way: UnderWay, folder: Path, every: float) -> None:
        self._under_way, self._folder, self._every = under_way, folder, every
        self._ended, self._written = threading.Event(), set[str]()
        self._thread = threading.Thread(target=self._repeat, daemon=True)
        self._thread.start()

    def _repeat(self) -> None:
        wait = self._every
        while not self._ended.wait(wait):
            began = time.thread_time()
            if not self._write():
                return
            wait = max(self._every, (time.thread_time() - began) / _SHARE)

    def _write(self, *, interrupted: bool = False) -> bool:
        page = self._under_way.page(interrupted=interrupted)
        try:
            write_whole(self._folder, page)
        except UsageError as error:
            self._under_way.trouble = TEXTS("unwritten", error=error)
            return False
        self._written |= set(page)
        return True

    def end(self, *, interrupted: bool = False) -> None:
        """End the thread; the page of an interrupted verification is written once more, if there is one.

        Otherwise the page of the whole verification takes its place, and its other files are removed.
        """
        self._ended.set()
        self._thread.join()
        if interrupted and self._written:
            self._write(interrupted=True)
        elif not interrupted:
            for name in self._written - {"index.html"}:
                (self._folder / name).unlink(missing_ok=True)
