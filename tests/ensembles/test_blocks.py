"""Blocks of an ensemble and their workers, solved by a made-up solver: who solves what, and where results are kept."""

from __future__ import annotations

import threading
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dem_bridge.ensembles import run
from dem_bridge.ensembles.draw import BLOCK, Variation
from dem_bridge.ensembles.run import run_ensemble
from dem_bridge.ensembles.solve import OBSERVABLES
from dem_bridge.errors import RunBroken
from dem_bridge.scene.scene import Scene

TWO = Scene(name="two", duration=1e-4, mass=(0.01, 0.02), stiffness=(2e10,), velocity=(0.8, 0.0))
VARIATION = Variation(scene=TWO, vary={"mass": 0.1}, seed=7)
WIDTHS = {"": (), "body": (2,), "contact": (1,)}


class Solver:
    """Solves no chains: every observable is the mass of the first body."""

    def __init__(self) -> None:
        self.chains: list[int] = []
        self.pilots: list[tuple[int, float]] = []

    def steps_for(self, scene: Scene, chains: Any, accuracy: float, samples: int | None = None) -> int:
        self.pilots.append((len(chains), accuracy))
        return 64

    def solve_chains(self, scene: Scene, chains: Any, steps: int, samples: int = 0) -> dict[str, Any]:
        self.chains.append(len(chains))
        first = chains.mass[:, 0]
        values = {
            name: np.multiply.outer(first, np.ones(WIDTHS[axis])) if axis else first
            for name, axis in OBSERVABLES.items()
        }
        return values | ({"velocity": np.multiply.outer(first, np.ones((samples + 1, 2)))} if samples else {})


@pytest.fixture
def solver(monkeypatch: pytest.MonkeyPatch) -> Solver:
    made_up = Solver()
    monkeypatch.setattr(run, "steps_for", made_up.steps_for)
    monkeypatch.setattr(run, "solve_chains", made_up.solve_chains)
    return made_up


class Timed(Executor):
    """Answer each call a little later; note how many are away when one comes; ``lose`` calls of a block first."""

    _max_workers = 2

    def __init__(self, lose: dict[int, int] | None = None) -> None:
        self.lose, self.away = dict(lose or {}), list[tuple[int, int]]()
        self._futures: list[Future[Any]] = []

    def submit(self, function: Any, /, *arguments: Any, **keywords: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self._futures = [other for other in self._futures if not other.done()] + [future]
        self.away.append((arguments[1], len(self._futures)))
        # one that will be lost is lost while others are away
        later = 0.0 if self.lose.get(arguments[1], 0) > 0 else 0.05
        threading.Timer(later, self._answer, (future, function, arguments)).start()
        return future

    def _answer(self, future: Future[Any], function: Any, arguments: Any) -> None:
        left = self.lose.get(arguments[1], 0)
        self.lose[arguments[1]] = left - 1
        if left > 0:
            future.set_exception(MemoryError("no room"))
        else:
            future.set_result(function(*arguments))


def test_a_worker_has_two_blocks_at_a_time(solver: Solver) -> None:
    executor = Timed()
    run_ensemble(VARIATION, 8 * BLOCK, checks=0, executor=executor)
    assert executor.away[:4] == [(0, 1), (1, 2), (2, 3), (3, 4)]
    assert max(away for _, away in executor.away) == 4
    assert sorted(nth for nth, _ in executor.away) == list(range(8))


def test_a_block_that_is_lost_is_solved_once_more_and_alone(solver: Solver) -> None:
    executor = Timed({1: 1})
    ensemble = run_ensemble(VARIATION, 6 * BLOCK, checks=0, executor=executor)
    tries = [place for place, (nth, _) in enumerate(executor.away) if nth == 1]
    assert len(tries) == 2
    assert executor.away[tries[1]] == (1, 1)
    # while it is away no other is given
    assert all(away == 1 for _, away in executor.away[tries[1] + 1 :][:1])
    masses = np.concatenate([VARIATION.block(nth).mass[:, 0] for nth in range(6)])
    np.testing.assert_array_equal(ensemble.values["arrival_at_end"], masses)
    with pytest.raises(RunBroken, match=r"^chains 512 to 1023 of two could not be solved by two workers \(MemoryError"):
        run_ensemble(VARIATION, 2 * BLOCK, checks=0, executor=Timed({1: 2}))
    with pytest.raises(RunBroken, match=r"^chains 512 to 519 of two could not"):
        run_ensemble(VARIATION, BLOCK + 8, checks=0, executor=Timed({1: 2}))


def test_a_pool_that_breaks_is_replaced_by_one_of_as_many_processes(
    solver: Solver, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Broken(Executor):
        _max_workers = 3

        def submit(self, function: Any, /, *arguments: Any, **keywords: Any) -> Future[Any]:
            raise BrokenExecutor("a process died")

    numbers: list[int] = []

    def processes(number: int, mp_context: Any) -> ThreadPoolExecutor:
        numbers.append(number)
        return ThreadPoolExecutor(number)

    monkeypatch.setattr(run, "ProcessPoolExecutor", processes)
    assert len(run_ensemble(VARIATION, BLOCK + 1, checks=0, executor=Broken())) == BLOCK + 1
    assert numbers == [3]
    assert sorted(solver.chains) == [1, BLOCK]


def test_progress_counts_chains(solver: Solver) -> None:
    calls: list[tuple[float, int, str]] = []
    executor = ThreadPoolExecutor(1)
    run_ensemble(VARIATION, 1100, checks=0, executor=executor, progress=lambda *words: calls.append(words))
    assert sorted(calls) == [(done, 1100, "two: 1100 chains") for done in (512, 1024, 1100)]


def test_the_steps_are_chosen_with_32_chains_to_1e_4(solver: Solver) -> None:
    assert run_ensemble(VARIATION, 1, checks=0).accuracy == 1e-4
    assert solver.pilots == [(32, 1e-4)]


@pytest.mark.parametrize(("samples", "in_file"), [(1022, False), (1023, True)])
def test_arrays_from_eight_mebibytes_on_are_files(samples: int, in_file: bool, solver: Solver) -> None:
    # 512 chains of 1024 samples of two bodies of 8 bytes
    ensemble = run_ensemble(VARIATION, BLOCK, checks=0, samples=samples)
    velocity = ensemble.values["velocity"]
    assert isinstance(velocity, np.memmap) == in_file
    assert not isinstance(ensemble.values["peak_force"], np.memmap)
    np.testing.assert_array_equal(velocity[:, -1, 1], VARIATION.block(0).mass[:, 0])


@pytest.fixture
def campaign(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, dict[str, Any]]]:
    """Note the cases of checks; they fail."""
    calls: list[tuple[Any, dict[str, Any]]] = []

    def run_cases(cases: Any, **settings: Any) -> list[Any]:
        calls.append((cases, settings))
        return [SimpleNamespace(case=case, trajectory=None, failure="no engine") for case in cases]

    monkeypatch.setattr(run, "run_cases", run_cases)
    return calls


def test_four_chains_are_checked_here_by_two_codes_and_failures_are_rows(solver: Solver, campaign: Any) -> None:
    checked = run_ensemble(VARIATION, 3 * BLOCK).checked
    [(cases, settings)] = campaign
    # one at a time, and what fails is a row
    assert settings == {"jobs": 1, "store": None, "everything": True}
    assert [case.backend for case in cases] == ["reference"] * 4 + ["lammps-granular"] * 4
    assert {case.sampling.count for case in cases} == {2000}
    assert all(case.uncertainty for case in cases)
    assert checked["failure"].tolist() == ["no engine"] * (8 * len(OBSERVABLES))
    chains = checked["chain"].unique().tolist()
    assert chains == sorted(chains)
    for nth, case in zip(chains, cases[:4], strict=True):
        assert case.scene.mass == tuple(VARIATION.block(nth // BLOCK).mass[nth % BLOCK])


def test_no_more_chains_are_checked_than_there_are(solver: Solver, campaign: Any) -> None:
    assert run_ensemble(VARIATION, 3, checks=9).checked["chain"].unique().tolist() == [0, 1, 2]
