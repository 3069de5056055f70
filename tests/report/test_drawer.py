"""A process draws beside this one where that is of use; otherwise, and where it fails, pictures are drawn here."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from dem_bridge.foundation.beside import Beside
from dem_bridge.report import drawer
from dem_bridge.report.drawer import drawing_beside, drawn, is_drawing_beside, prepare_drawing
from dem_bridge.report.images import begin_picture_of_data
from dem_bridge.report.svg import svg_of_data
from dem_bridge.runs.store import Store
from tests.helpers.beside_functions import about, here_alone
from tests.helpers.processes import running
from tests.report.test_drawing import FULL


@pytest.fixture
def fresh(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have two cores, and matplotlib not imported, as at the start of a command."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    monkeypatch.delitem(sys.modules, "matplotlib")


@pytest.fixture
def beside(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    with drawing_beside():
        with monkeypatch.context() as at_first:
            at_first.setattr(os, "sched_getaffinity", lambda _: {0, 1})
            at_first.delitem(sys.modules, "matplotlib")
            prepare_drawing()
        assert is_drawing_beside()
        yield
    assert not is_drawing_beside()


def test_without_a_process_a_picture_is_drawn_here_when_it_is_asked_for() -> None:
    picture = drawn(about, "a")
    assert not is_drawing_beside()
    assert picture() == (os.getpid(), ("a",))


def test_the_process_draws_and_ends_with_its_context(fresh: None) -> None:
    with drawing_beside():
        prepare_drawing()
        prepare_drawing()  # there is one
        pids = {drawn(about, each)()[0] for each in "ab"}
        assert len(pids) == 1
        assert running(pids) == [*pids]
        assert os.getpid() not in pids
    assert running(pids) == []
    assert drawn(about, "a")()[0] == os.getpid()


def test_what_was_begun_before_is_drawn_once(beside: None, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[bytes] = []
    ask = Beside.ask

    def noted(process: Beside, question: bytes) -> Any:
        asked.append(question)
        return ask(process, question)

    monkeypatch.setattr(Beside, "ask", noted)
    pictures = [drawn(about, *each) for each in ("ab", "ab", "ac")]
    assert [picture()[1] for picture in pictures] == [("a", "b"), ("a", "b"), ("a", "c")]
    assert len(asked) == 2


def test_a_further_process_draws_while_many_pictures_wait(fresh: None) -> None:
    with drawing_beside():
        prepare_drawing()
        pictures = [drawn(about, each) for each in range(40)]
        pids = {picture()[0] for picture in pictures}
        assert [picture()[1] for picture in pictures] == [(each,) for each in range(40)]
        assert len(pids) == 2  # of two cores
        assert len({drawn(about, str(each))()[0] for each in range(3)}) == 1
    assert running(pids) == []


def test_what_fails_there_or_cannot_go_there_is_drawn_here(beside: None) -> None:
    assert drawn(here_alone, os.getpid())() == os.getpid()
    assert drawn(lambda: "a picture")() == "a picture"
    with pytest.raises(RuntimeError, match="not here"):
        drawn(here_alone, 0)()


@pytest.mark.usefixtures("fresh")
@pytest.mark.parametrize("reason", ["one core", "imported", "no context", "not wanted", "no process"])
def test_no_process_is_started_where_it_is_of_no_use(reason: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        assert reason == "no process"
        raise OSError

    monkeypatch.setattr(drawer, "Beside", refuse)
    if reason == "one core":
        monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    if reason == "imported":
        monkeypatch.setitem(sys.modules, "matplotlib", drawer)
    if reason == "no context":
        prepare_drawing()
    else:
        with drawing_beside(wanted=reason != "not wanted"):
            prepare_drawing()
            assert not is_drawing_beside()


def test_another_process_that_was_forked_draws_by_itself(beside: None, monkeypatch: pytest.MonkeyPatch) -> None:
    own = os.getpid()
    assert drawn(about)()[0] != own
    with monkeypatch.context() as forked:
        forked.setattr(os, "getpid", lambda: own + 1)
        assert drawn(about)() == (own + 1, ())


def test_a_picture_is_the_same_from_there_and_from_here_and_is_kept(beside: None, tmp_path: Path) -> None:
    store = Store(tmp_path)
    picture = begin_picture_of_data(FULL, store)
    assert not list(tmp_path.iterdir())
    assert picture() == svg_of_data(FULL)
    assert len(list(tmp_path.iterdir())) == 1
    assert begin_picture_of_data(FULL, store)() == picture()
