"""The page of a verification whose runs are still made."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import pytest

from dem_bridge.backends.verlet import Verlet
from dem_bridge.foundation.progress import Campaign
from dem_bridge.runs.campaign.nodes import Groups
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory
from dem_bridge.verification.under_way import UnderWay, write_pages
from dem_bridge.verification.verify import verify_scenes

EARLY = Scene(
    name="early", duration=1e-4, mass=(8e-3, 1e-2, 1e-2), stiffness=(4e9, 4e9), velocity=(0.8, 0.0, 0.0), samples=10
)
LATE = replace(EARLY, name="late", duration=5e-5)
#: s between two pages here, and s for which a run waits for one at most: a page takes a tenth of a second
EVERY, PATIENCE = 0.01, 120.0


class Stop(Exception):
    """Ends a verification within a run."""


def _wait_for(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, "what is waited for did not happen"
        time.sleep(EVERY)


def _words(page: str) -> str:
    """Return the text of a page without its head, marks and scripts."""
    body = re.sub(r"(?s)<(script|style|head)\b.*?</\1>", " ", page)
    return " ".join(unescape(re.sub(r"<[^>]+>", " ", body)).split())


@pytest.fixture
def seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Let the twin of the late scene wait for a page that names its run, and return that page."""
    pages: list[str] = []
    run = Verlet.run

    def slow(self: Verlet, scene: Scene, *settings: Any) -> Trajectory:
        if scene.name == LATE.name and not pages:
            page = tmp_path / "index.html"
            _wait_for(lambda: page.exists() and f"Under way: {LATE.name}: " in page.read_text(encoding="utf-8"))
            pages.append(page.read_text(encoding="utf-8"))
        return run(self, scene, *settings)

    monkeypatch.setattr(Verlet, "run", slow)
    return pages


def _verify(folder: Path) -> None:
    with write_pages(folder, 1e-4, EVERY) as under_way:
        # with a step that is given no run is made before the campaign
        verify_scenes([EARLY, LATE], accuracy=1e-4, dt=1e-7, under_way=under_way)


@pytest.mark.lammps
@pytest.mark.parametrize("hidden", [False, True])
def test_a_scene_is_on_the_page_while_the_next_is_run(
    hidden: bool, seen: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if hidden:  # the planted fault: groups are handed over at the end
        completed = Groups.completed
        kept = list[str]()

        def late(groups: Groups, made: Iterable[str]) -> Iterator[int]:
            kept.extend(made)
            return completed(groups, kept) if seen else iter(())

        monkeypatch.setattr(Groups, "completed", late)
    _verify(tmp_path)
    [page] = seen
    words = _words(page)
    assert "Verification of 2 scenes, not complete" in words
    ended = "all runs of 1 of 2 scenes have ended" in words and "early: with dt = " in words
    assert ended is not hidden
    assert (re.search(r"checks pass", words) is not None) is not hidden
    assert '<meta http-equiv="refresh" content="5">' in page
    # what others read without the page is written at the end, and tables of this page are not left beside it
    assert {file.name for file in tmp_path.iterdir()} == {"index.html", "tables"}
    assert list((tmp_path / "tables").iterdir()) == []


def test_the_last_page_of_an_interrupted_verification_says_so(tmp_path: Path) -> None:
    def stop() -> None:
        with write_pages(tmp_path, 1e-4, EVERY):
            _wait_for((tmp_path / "index.html").exists)
            assert "Interrupted" not in _words((tmp_path / "index.html").read_text(encoding="utf-8"))
            raise Stop

    with pytest.raises(Stop):
        stop()
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "Interrupted : this page contains the results up to the interruption" in _words(page)
    assert "refresh" not in page


def test_nothing_is_written_before_the_first_seconds_are_over_or_without_a_folder(tmp_path: Path) -> None:
    with write_pages(tmp_path, 1e-4):
        pass
    with pytest.raises(Stop), write_pages(tmp_path, 1e-4):
        raise Stop
    with write_pages(None, 1e-4, 0.0) as under_way:
        assert under_way.trouble == ""
    assert list(tmp_path.iterdir()) == []


def test_a_page_that_cannot_be_written_ends_nothing_and_is_told(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("", encoding="utf-8")
    with write_pages(file, 1e-4, EVERY) as under_way:
        _wait_for(lambda: bool(under_way.trouble))
    assert under_way.trouble.startswith("The page could not be written while the runs were made: ")
    assert str(file) in under_way.trouble


@pytest.mark.parametrize(
    ("done", "running", "expected"),
    [
        (1, ("late: ase",), "Under way: late: ase."),
        (3, (), "All runs have ended, and the results are being judged."),
        (2, (), ""),
    ],
)
def test_the_first_answer_says_what_is_under_way(done: int, running: tuple[str, ...], expected: str) -> None:
    under_way = UnderWay(accuracy=1e-4, scenes=("early", "late"))
    assert under_way.study().answer == ("No run has ended yet: the time steps of the runs are being chosen.",)
    under_way.watch(Campaign(total=3, done=done, failures=1, running=running))
    study = under_way.study()
    numbers = f"{done} of 3 runs have ended, 1 of them broken; all runs of 0 of 2 scenes have ended."
    assert study.answer == (f"{numbers} {expected}".rstrip(),)
    assert [row[0] for row in study.tables[0].rows] == ["early", "late"]


def test_what_draws_is_imported_beside_the_first_run_and_not_where_all_is_stored(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    prepared = threading.Event()
    monkeypatch.setattr("dem_bridge.verification.under_way.prepare_drawing", prepared.set)
    under_way = UnderWay(accuracy=1e-4)
    under_way.watch(Campaign(total=2, done=2))
    # a case that is refused has ended at once
    under_way.watch(Campaign(total=2, done=1, running=("pair: bca",)))
    under_way.watch(Campaign(total=2, done=2))
    assert not prepared.wait(0.5)
    under_way.watch(Campaign(total=3, done=2, running=("pair: verlet",)))
    assert prepared.wait(30.0)


@pytest.mark.lammps
@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="with one core no process draws")
def test_a_verification_draws_in_another_process(tmp_path: Path) -> None:
    code = (
        "import sys, dem_bridge as db\n"
        "pair = db.Scene(name='pair', duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))\n"
        f"db.verify(pair, accuracy=1e-4, folder={str(tmp_path)!r}, store=False)\n"
        "sys.exit('matplotlib was imported' if 'matplotlib' in sys.modules else 0)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert '<svg role="img"' in (tmp_path / "index.html").read_text(encoding="utf-8")
