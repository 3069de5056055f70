"""Campaigns: order, what is run and what is not, other processes, and what is left where one ends early."""

from __future__ import annotations

import inspect
import math
import os
import re
import signal
import subprocess
import sys
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

import dem_bridge as db
from dem_bridge.backends.base import Availability, Resolution, Sampling
from dem_bridge.backends.verlet import Verlet
from dem_bridge.cli import main
from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.runs import case as case_module
from dem_bridge.runs.cache import RunCache
from dem_bridge.runs.campaign import Crashed, Result, pool, results, run_cases
from dem_bridge.runs.campaign.run import count_workers
from dem_bridge.runs.case import Case
from dem_bridge.runs.keys import run_key
from dem_bridge.runs.store import Store, StoreNote
from dem_bridge.runs.uncertainty.estimate import solve
from dem_bridge.scene.features import CONTACT_FUNCTIONS, OTHER_EXPONENTS, SEVERAL_MOVING
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.support import Condition, Support
from dem_bridge.trajectory.trajectory import Trajectory
from dem_bridge.verification import verify
from dem_bridge.verification.verification import Verification, verification_of
from dem_bridge.verification.verify import verify_scenes
from tests.helpers.fake_runs import free_flight
from tests.helpers.processes import PATIENCE, all_end, running
from tests.helpers.three_bodies import THREE

#: what no scene satisfies
NEVER = Condition("nothing", lambda scene: "it can do nothing")
SCENE = replace(THREE, samples=4, spacing=None)


def _case(dt: float = 1e-6, scene: Scene = SCENE, backend: str = "verlet", **settings: Any) -> Case:
    return Case(
        scene=scene,
        backend=backend,
        resolution=Resolution(dt=dt, **settings),
        sampling=Sampling(count=4),
        uncertainty=False,
    )


class Fake:
    """A backend that counts its runs; ``fails``: the steps at which it raises, with what."""

    name, equations, order = "fake", "hertz", None
    supports = Support({OTHER_EXPONENTS, SEVERAL_MOVING, CONTACT_FUNCTIONS})

    def availability(self) -> Availability:
        return Availability(True)

    def __init__(self) -> None:
        self.runs: list[tuple[str, float | None]] = []
        self.fails: dict[float | None, BaseException] = {}

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        self.runs.append((scene.name, resolution.dt))
        if resolution.dt in self.fails:
            raise self.fails[resolution.dt]
        provenance = {"backend": "verlet", "scene": scene.name, "settings": {"dt": resolution.dt}}
        return free_flight(provenance=provenance)


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> Fake:
    backend = Fake()
    for module in (results, case_module):
        monkeypatch.setattr(module, "backend", lambda name, engine: backend)
    return backend


def _steps(results: tuple[Result, ...]) -> list[float | None]:
    return [result.trajectory.provenance["settings"]["dt"] if result.trajectory else None for result in results]


def test_results_stand_in_the_order_of_the_cases_whatever_runs_first(fake: Fake) -> None:
    steps = [1e-11, 1e-12, 1e-6, 1e-13]  # so fine that each takes much longer than the next
    results = run_cases([_case(dt) for dt in steps])
    assert _steps(results) == steps
    assert [result.case.resolution.dt for result in results] == steps
    # the longest first
    assert [dt for _, dt in fake.runs] == sorted(steps)


def test_wrong_settings_and_crashes_stop_a_campaign_unless_they_are_asked_for(fake: Fake) -> None:
    fake.fails = {1e-7: UsageError("too fine"), 1e-8: KeyError("three")}
    for dt, error, words in ((1e-7, UsageError, "too fine"), (1e-8, KeyError, "three")):
        with pytest.raises(error, match=words):
            run_cases([_case(dt)])
    results = run_cases([_case(1e-7), _case(1e-8), _case(1e-6)], everything=True)
    assert str(results[0].failure) == "too fine"
    crash = results[1].failure
    assert isinstance(crash, Crashed)
    assert str(crash) == "KeyError: 'three'"
    assert "Traceback" in crash.log
    assert results[2].trajectory is not None


def test_what_is_stored_is_not_run_again_and_says_when_it_was(fake: Fake, tmp_path: Path) -> None:
    cases = [_case(1e-6), _case(1e-7)]
    first = run_cases(cases[:1], store=Store(tmp_path))
    assert first[0].trajectory is not None
    assert "stored" not in first[0].trajectory.provenance
    second = run_cases(cases, store=Store(tmp_path))
    assert [dt for _, dt in fake.runs] == [1e-6, 1e-7]
    assert _steps(second) == [1e-6, 1e-7]
    assert ["stored" in result.trajectory.provenance for result in second if result.trajectory] == [True, False]
    assert run_cases(cases, store=Store(tmp_path))[1].trajectory is not None
    assert len(fake.runs) == 2


def test_a_stored_run_keeps_what_it_cost(tmp_path: Path) -> None:
    [first], [kept] = (run_cases([_case()], store=Store(tmp_path)) for _ in range(2))
    assert first.trajectory is not None
    assert kept.trajectory is not None
    assert kept.trajectory.cost == first.trajectory.cost
    assert kept.trajectory.cost.wall > 0.0


def test_a_damaged_entry_is_run_again(fake: Fake, tmp_path: Path) -> None:
    run_cases([_case()], store=Store(tmp_path))
    [file] = tmp_path.iterdir()
    file.write_bytes(file.read_bytes()[:-1])
    store = Store(tmp_path)
    run_cases([_case()], store=store)
    assert len(fake.runs) == 2
    assert "is damaged" in store.trouble
    run_cases([_case()], store=Store(tmp_path))
    assert len(fake.runs) == 2


def test_identical_cases_run_once_under_whatever_names(fake: Fake) -> None:
    other = replace(SCENE, name="other")
    results = run_cases([_case(), _case(scene=other), _case(), _case(1e-7)])
    assert len(fake.runs) == 2
    assert [result.case.scene.name for result in results] == ["three", "other", "three", "three"]
    scenes = [result.trajectory.provenance["scene"] for result in results if result.trajectory]
    assert scenes == ["three", "other", "three", "three"]


def _cases_with_and_without() -> list[Case]:
    case = _case()
    return [case, replace(case, uncertainty=True), case]


def _known(results: tuple[Result, ...]) -> list[bool]:
    """Whether each result has a finite uncertainty."""
    return [math.isfinite(result.trajectory.uncertainty.velocity) for result in results if result.trajectory]


def test_a_case_with_uncertainty_and_the_same_without_are_one_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    solved: list[Case] = []

    def counted(case: Case, *_: object) -> Trajectory:
        solved.append(case)
        return solve(case)

    monkeypatch.setattr("dem_bridge.runs.campaign.results.solve", counted)
    results = run_cases(_cases_with_and_without(), store=Store(tmp_path))
    assert _known(results) == [False, True, False]
    assert solved == [_cases_with_and_without()[1]]
    # values that are read from them are kept under keys that differ, as they do when the runs come from the store
    keys = [result.key for result in results]
    assert keys == [case.key for case in _cases_with_and_without()]
    assert [result.key for result in run_cases(_cases_with_and_without(), store=Store(tmp_path))] == keys


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_a_run_stored_without_uncertainty_answers_for_no_case_with_one(order: tuple[int, int], tmp_path: Path) -> None:
    cases = [_cases_with_and_without()[number] for number in order]
    for case in cases:
        assert _known(run_cases([case], store=Store(tmp_path))) == [case.uncertainty]
    # the second time from the store; a run with its uncertainty is kept for both
    assert len(list(tmp_path.iterdir())) == (2 if order == (0, 1) else 1)
    for case in cases:
        [result] = run_cases([case], store=Store(tmp_path))
        assert result.trajectory is not None
        assert "stored" in result.trajectory.provenance
        assert _known((result,)) == [case.uncertainty]


def test_a_key_that_ignores_the_uncertainty_loses_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # the fault that the test above catches
    monkeypatch.setattr(case_module, "run_key", lambda *rest, uncertainty: run_key(*rest))
    without, with_uncertainty, _ = _cases_with_and_without()
    run_cases([without], store=Store(tmp_path))
    assert _known(run_cases([with_uncertainty], store=Store(tmp_path))) == [False]


@pytest.mark.parametrize("forgets", [False, True], ids=["", "fault"])
def test_the_key_of_a_case_is_computed_once(forgets: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    computed: list[Any] = []

    def counted(*settings: Any, uncertainty: bool) -> str | None:
        computed.append((settings[1:4], uncertainty))
        return run_key(*settings, uncertainty=uncertainty)

    monkeypatch.setattr(case_module, "run_key", counted)
    if forgets:
        monkeypatch.setattr(RunCache, "key", lambda cache, case: case.key)
    store, cases = Store(tmp_path), [_case(1e-6), replace(_case(1e-7), uncertainty=True)]
    for _ in range(2):  # made, and from the store
        run_cases(cases, store=store)
        assert (len(computed) > len(set(computed))) is forgets
        computed.clear()


def test_what_a_store_lacks_is_looked_for_again_by_the_next_campaign(fake: Fake, tmp_path: Path) -> None:
    store = Store(tmp_path)
    cache = RunCache(store)
    assert cache.load_stored(_case()) is None
    run_cases([_case()], store=store)
    assert cache.load_stored(_case()) is None  # once a piece of work
    [result] = run_cases([_case()], store=store, cache=cache)
    assert len(fake.runs) == 1
    assert result.trajectory is not None


def test_another_scene_of_the_same_name_is_run(fake: Fake, tmp_path: Path) -> None:
    other = replace(SCENE, velocity=(0.9, 0.0, 0.0))
    for scene in (SCENE, other):
        run_cases([_case(scene=scene)], store=Store(tmp_path))
    assert len(fake.runs) == 2


def test_laws_that_are_functions_are_never_stored_nor_taken_for_each_other(fake: Fake, tmp_path: Path) -> None:
    scene = replace(SCENE, law=lambda overlap: 4e9 * overlap**1.5)
    for jobs in (1, None):
        run_cases([_case(scene=scene), _case(scene=scene)], jobs=jobs, store=Store(tmp_path))
    assert len(fake.runs) == 4
    assert list(tmp_path.iterdir()) == []


def test_failures_are_results_and_are_never_stored(fake: Fake, tmp_path: Path) -> None:
    fake.fails[1e-12] = RunBroken("LAMMPS: ERROR: Lost atoms", log="last words")
    heavy = replace(SCENE, gravity=9.81)
    for _ in range(2):
        fine, broken, refused = run_cases([_case(), _case(1e-12), _case(scene=heavy)], store=Store(tmp_path))
        assert fine.trajectory is not None
        assert isinstance(broken.failure, RunBroken)
        assert str(refused.failure).startswith("the scene has gravity; supported: ")
    assert [dt for _, dt in fake.runs] == [1e-12, 1e-6, 1e-12]
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize("end", [KeyboardInterrupt("Ctrl-C"), UsageError("dt = 1e-06; too coarse")], ids=repr)
def test_what_was_finished_before_the_end_is_stored(end: BaseException, fake: Fake, tmp_path: Path) -> None:
    cases = [_case(dt) for dt in (1e-13, 1e-12, 1e-6)]
    fake.fails[1e-6] = end
    with pytest.raises(type(end), match=re.escape(str(end))):
        run_cases(cases, store=Store(tmp_path))
    fake.fails.clear()
    run_cases(cases, store=Store(tmp_path))
    assert [dt for _, dt in fake.runs] == [1e-13, 1e-12, 1e-6, 1e-6]


def test_a_run_is_not_stored_if_its_key_has_changed_meanwhile(
    fake: Fake, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # a LAMMPS that was built anew while it ran
    monkeypatch.setattr(case_module, "run_key", lambda *_, **__: ("2" if fake.runs else "1") * 64)
    [result] = run_cases([_case(backend="lammps-granular")], store=Store(tmp_path))
    assert result.trajectory is not None
    assert list(tmp_path.iterdir()) == []


def test_progress_goes_up_to_the_number_of_cases_with_the_time_that_runs_take(fake: Fake, tmp_path: Path) -> None:
    cases, reports = [_case(1e-10), _case(1e-6), _case(1e-6, backend="bca")], list[tuple[float, int, str]]()

    def progress(*news: Any) -> None:
        reports.append(news)

    run_cases(cases, progress=progress, store=Store(tmp_path))
    done = [news[0] for news in reports]
    assert done == sorted(done)
    assert (done[0], reports[-1]) == (0.0, (3, 3, ""))
    # of the time expected the first has 0.062 s in 0.162 s
    after_first = done[2]
    assert after_first == pytest.approx(3 * cases[0].expected / sum(case.expected for case in cases))
    assert {news[1] for news in reports} == {3}
    reports.clear()
    run_cases(cases, progress=progress, store=Store(tmp_path))
    assert reports == [(3, 3, "")]


# other processes


def test_the_cores_are_used_where_it_pays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)))
    chain = Scene(name="chain", duration=1e-3, mass=(1e-2,) * 40, stiffness=(4e9,) * 39, velocity=(0.8,) * 40)
    long = _case(backend="scipy", scene=chain)
    short = _case(backend="bca")
    assert count_workers(None, []) == 1
    assert count_workers(None, [short] * 10) == 1
    assert count_workers(None, [long]) == 1
    assert count_workers(None, [long] * 3) == 3  # no more than there is to do
    assert count_workers(None, [long] * 30) == 8
    assert count_workers(None, [replace(long, engine=Engine(ranks=3))] * 30) == 2
    assert count_workers(5, [short] * 3) == 3
    assert count_workers(1, [long] * 30) == 1


def test_no_process_is_started_where_all_is_stored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cases = [_case(1e-6), _case(1e-7)]
    run_cases(cases, store=Store(tmp_path))
    monkeypatch.setattr(pool, "WorkerProcess", None)
    assert None not in _steps(run_cases(cases, jobs=2, store=Store(tmp_path)))


PROGRAM = """
from pathlib import Path
from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.runs.campaign import run_cases
from dem_bridge.runs.case import Case
from dem_bridge.scene.scene import Scene
scene = Scene(name="pair", duration=1e-5, mass=(1e-2, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
cases = [
    Case(scene=scene, backend="bca", resolution=Resolution(dt=dt), sampling=Sampling(count=4)) for dt in (1e-7, 1e-6)
]
results = run_cases(cases, jobs=2)
print(sum(result.trajectory is not None for result in results))
"""


def test_a_program_without_a_guard_is_not_run_again_by_each_process(tmp_path: Path) -> None:
    file = tmp_path / "program.py"
    file.write_text(PROGRAM)
    done = subprocess.run([sys.executable, str(file)], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("2\n", "")


LONG_PROGRAM = """
from dataclasses import replace
from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.runs.campaign import run_cases
from dem_bridge.runs.case import Case
from dem_bridge.scene.scene import Scene

class Announcement:
    # a law that prints the process that it arrives in; what arrives is a law that takes an hour
    def __call__(self, overlap):
        return 4e9 * overlap**1.5

    def __reduce__(self):
        slow = "lambda overlap: __import__('time').sleep(3600)"
        # in one piece, for another process does the same at the same time
        say = "(lambda os: os.write(1, (str(os.getpid()) + chr(10)).encode()))(__import__('os'))"
        return eval, (f"({say}, {slow})[1]",)

if __name__ == "__main__":
    scene = Scene(name="pair", duration=1.0, mass=(1e-2, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    scene = replace(scene, law=Announcement())
    cases = [
        Case(scene=scene, backend="scipy", resolution=Resolution(rtol=rtol), sampling=Sampling(count=4))
        for rtol in (1e-8, 1e-9)
    ]
    run_cases(cases, jobs=2)
"""


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_processes_end_with_the_program_that_started_them(how: signal.Signals, tmp_path: Path) -> None:
    file = tmp_path / "program.py"
    file.write_text(LONG_PROGRAM)
    with subprocess.Popen(
        [sys.executable, str(file)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        # where the tests run in the background Ctrl-C is ignored, and children inherit that
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as program:
        assert program.stdout is not None
        # each process says so when its case has arrived: it runs for an hour then, if it is let be
        workers = [int(program.stdout.readline()) for _ in range(2)]
        try:
            assert running(workers) == workers
            program.send_signal(how)
            assert program.wait(timeout=PATIENCE) != 0
            assert all_end(workers)
        finally:
            for pid in [program.pid, *running(workers)]:
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)


# verification


@pytest.mark.slow
@pytest.mark.lammps
def test_a_second_verification_runs_nothing_and_says_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = replace(SCENE, name="short", duration=1.5e-4, samples=50, spacing=18e-3)
    first = verify_scenes([scene], accuracy=1e-4, store=Store(tmp_path))
    monkeypatch.setattr(results, "backend", None)
    monkeypatch.setattr(Verlet, "run", None)  # the step is not looked for either
    monkeypatch.setattr(verify, "assess_scene", None)  # nothing is judged again
    second = verify_scenes([scene], accuracy=1e-4, store=Store(tmp_path))
    assert [verdict.as_json() for verdict in second.verdicts] == [verdict.as_json() for verdict in first.verdicts]
    assert second.notes == ()


@pytest.mark.lammps
def test_verify_stores_and_makes_anew_what_is_asked_fresh(tmp_path: Path) -> None:
    scene = replace(SCENE, name="pair", mass=(8.1e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), exponent=2.5, gap=0)

    def stored(**how: Any) -> set[bool]:
        verification = db.verify(scene, accuracy=1e-3, **how)
        assert verification.notes == ()
        return {run["stored"] is not None for run in verification.provenance["runs"]}

    assert [stored(store=tmp_path) for _ in range(2)] == [{False}, {True}]
    assert stored(store=tmp_path, recompute=True) == {False}


def test_a_store_that_cannot_be_is_a_note(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(Verlet, "supports", Support(set(), conditions=(NEVER,)))  # and nothing is run
    verification = verify_scenes([SCENE], accuracy=1e-3, store=Store(tmp_path / "file" / "store"))
    [note] = verification.notes
    assert note.startswith("store: nothing is stored: ")


def test_the_command_line_uses_all_cores_and_the_store_unless_told_otherwise_and_warns(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    calls: list[dict[str, Any]] = []

    def verify(scenes: Any, **how: Any) -> Verification:
        calls.append(how)
        return verification_of((), accuracy=1e-6, wall=0.0, notes=(StoreNote("store: nothing is stored: why"),))

    defaults = {name: item.default for name, item in inspect.signature(db.verify).parameters.items()}
    monkeypatch.setattr(db, "verify", verify)
    for words, jobs, recompute in ((), None, False), (("-j", "3", "--no-cache"), 3, True):
        done = CliRunner().invoke(main, ["verify", "-o", str(tmp_path), *words])
        assert done.exit_code == 0
        assert "note: store: nothing is stored: why\n" in done.stdout
        settings = defaults | calls[-1]
        assert (settings["jobs"], settings["recompute"]) == (jobs, recompute)
        assert "store" not in calls[-1]
