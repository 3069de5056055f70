"""Ctrl-C and progress: what runs is finished and kept, the second stops at once, and a second call goes on."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.cli import waiting
from dem_bridge.foundation import progress
from dem_bridge.foundation.progress import Campaign, Interrupted, request_stop, withdraw_stop
from dem_bridge.runs.campaign import here, run_cases
from dem_bridge.runs.campaign.tasks import Outcome, Task, broken, perform_task
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from tests.helpers.processes import happens
from tests.helpers.survival import Survival
from tests.helpers.three_bodies import THREE

CASES = 8
IN_ORDER = "dem-bridge: interrupted: the runs that have begun are finished and kept, and no other begins;"


@pytest.fixture
def survival(tmp_path: Path) -> Iterator[Survival]:
    """A campaign of a few cases."""
    campaigns = Survival(tmp_path, cases=CASES)
    yield campaigns
    for pid in campaigns.processes():  # of a test that fails
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def _interrupted(survival: Survival) -> subprocess.Popen[str]:
    """Return a campaign that waits at a run, after a first Ctrl-C that it has seen."""
    program = survival.begin(halt=2)
    assert happens(lambda: survival.counted("wait") == survival.jobs)
    program.send_signal(signal.SIGINT)
    assert program.stderr is not None
    assert program.stderr.readline().startswith(IN_ORDER)
    return program


def _said(program: subprocess.Popen[str]) -> str:
    """Return what a campaign says after its first line until it ends."""
    assert program.stderr is not None
    with program:
        return program.stderr.read()


@pytest.mark.parametrize("jobs", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_the_first_interrupt_ends_what_runs_and_a_second_call_goes_on(survival: Survival, jobs: int) -> None:
    survival.jobs = jobs
    program = _interrupted(survival)
    done = survival.counted("end") + jobs
    survival.halt()  # the runs that wait go on
    assert (
        _said(program)
        == f"dem-bridge: interrupted after {done} of {CASES} runs; they are kept, and a second call goes on\n"
    )
    assert program.returncode == 130
    assert survival.counted("begin") == survival.counted("end") == done < CASES
    assert survival.all_ended()
    assert survival.finish(survival.begin())["stored"] == done
    assert survival.counted("begin") == CASES


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_the_second_interrupt_stops_at_once(survival: Survival, jobs: int) -> None:
    survival.jobs = jobs
    program = _interrupted(survival)
    program.send_signal(signal.SIGINT)  # the runs still wait
    assert _said(program) == "dem-bridge: interrupted; the run was stopped; a second call uses what was finished\n"
    assert program.returncode == 130
    assert survival.all_ended()
    assert survival.left() == []
    assert survival.finish(survival.begin())["stored"] >= 2


def _cases(number: int) -> list[Case]:
    scene = replace(THREE, samples=4, spacing=None)
    return [
        Case(
            scene=scene,
            backend="bca",
            resolution=Resolution(dt=1e-6 * n),
            sampling=Sampling(count=4),
            uncertainty=False,
        )
        for n in range(1, number + 1)
    ]


@pytest.fixture
def stopped() -> Iterator[None]:
    """A campaign that is asked to stop when it has begun."""

    def stop(state: Campaign) -> None:
        if state.running:
            request_stop()

    with progress.watching(stop):
        yield
    withdraw_stop()


@pytest.mark.usefixtures("stopped")
def test_a_campaign_that_is_asked_to_stop_says_how_far_it_is(tmp_path: Path) -> None:
    cases = _cases(3)
    with pytest.raises(Interrupted, match=r"interrupted after 1 of 3 runs; they are not kept"):
        run_cases(cases)
    withdraw_stop()
    store = Store(tmp_path)
    with pytest.raises(Interrupted, match=r"interrupted after 1 of 3 runs; they are kept, and a second call goes on"):
        run_cases(cases, store=store)
    withdraw_stop()
    with pytest.raises(Interrupted, match="interrupted after 2 of 3 runs"):
        run_cases(cases, store=store)
    withdraw_stop()
    assert len(run_cases(cases, store=store)) == 3  # the last one is begun and ended
    assert len(run_cases(cases, store=store)) == 3  # nothing has to begin


@pytest.mark.usefixtures("stopped")
def test_an_executor_begins_no_more_than_it_has(tmp_path: Path) -> None:
    with ThreadPoolExecutor(1) as executor, pytest.raises(Interrupted, match=r"interrupted after \d+ of 40 runs"):
        run_cases(_cases(40), jobs=executor, store=Store(tmp_path))
    assert len(list(tmp_path.iterdir())) < 40


@pytest.mark.usefixtures("stopped")
def test_a_campaign_that_hears_of_no_stop_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    # the fault that the tests above catch
    monkeypatch.setattr(here, "stop_requested", lambda: False)
    assert len(run_cases(_cases(3))) == 3


def test_there_is_nothing_to_stop_in_order_where_no_campaign_runs() -> None:
    assert not request_stop()
    with pytest.raises(KeyboardInterrupt), waiting.ending_in_order():
        signal.raise_signal(signal.SIGINT)


def test_the_first_of_two_interrupts_is_no_exception(capfd: pytest.CaptureFixture[str]) -> None:
    with waiting.ending_in_order():
        with progress.campaign(3, 0):
            signal.raise_signal(signal.SIGINT)
            assert progress.stop_requested()
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
        assert capfd.readouterr().err.startswith(IN_ORDER)
    assert not progress.stop_requested()


# progress


def test_the_progress_is_a_line_of_json_for_each_change(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    store = Store(tmp_path)
    run_cases(_cases(1), store=store)
    heavy = replace(_cases(1)[0], scene=replace(THREE, gravity=9.81))  # unsupported, which is no failure
    with waiting.bar(True) as callback:
        run_cases([*_cases(3), heavy], store=store, progress=callback)
    lines: list[dict[str, Any]] = [json.loads(line) for line in capsys.readouterr().err.splitlines()]
    assert all(list(line) == ["done", "total", "fraction", "rate", "eta", "failures", "running"] for line in lines)
    assert (lines[0]["done"], lines[0]["total"], lines[0]["rate"]) == (1, 4, None)
    assert [line["done"] for line in lines] == sorted(line["done"] for line in lines)
    assert {label for line in lines for label in line["running"]} == {case.label for case in [*_cases(3)[1:], heavy]}
    last = lines[-1]
    assert (last["done"], last["fraction"], last["eta"], last["failures"], last["running"]) == (4, 1.0, 0.0, 0, [])
    assert last["rate"] > 0.0


def test_broken_runs_are_counted_and_the_counts_add_up(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    cases = _cases(4)

    def perform(task: Task) -> Outcome:
        return broken("it broke", "log") if task.case == cases[1] else perform_task(task)

    monkeypatch.setattr(here, "perform_task", perform)
    with waiting.bar(True) as callback:
        run_cases(cases, progress=callback)
    lines: list[dict[str, Any]] = [json.loads(line) for line in capsys.readouterr().err.splitlines()]
    assert {line["total"] for line in lines} == {4}
    assert {line["done"] for line in lines} == set(range(5))
    failures = [line["failures"] for line in lines]
    assert failures == sorted(failures)
    assert (failures[0], failures[-1]) == (0, 1)


def test_the_rate_and_the_remaining_time_follow_from_what_was_done_since_the_start(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = SimpleNamespace(now=100.0)
    monkeypatch.setattr(waiting, "time", SimpleNamespace(monotonic=lambda: clock.now))
    meter = waiting.Meter(lambda _: None)
    state = Campaign(total=8, done=2)  # two are in the store
    meter.watch(state)
    clock.now += 10.0
    state.update(done=3)
    meter.watch(state)
    meter.advance(2.0, 8, "pair")  # a quarter of the time that all are expected to take
    assert (meter.as_json()["rate"], meter.as_json()["eta"]) == (0.3, 30.0)


def test_the_line_of_a_terminal_says_the_rate_failures_and_what_is_running() -> None:
    meter = waiting.Meter(lambda _: None)
    meter.advance(0.0, 4, "the step")
    assert meter.text == "the step"
    state = Campaign(total=4, done=1)
    meter.watch(state)
    assert meter.text == "1/4 runs, 0 failed: the step"
    state.update(done=2, failures=1, running=("a: verlet", "b: bca"))
    meter.watch(state)
    assert re.fullmatch(r"3/4 runs, [\d.e+]+/s, 1 failed: a: verlet; b: bca", meter.text)
