"""Runs that several cases of a verification need are made once: families of twins, looser runs, those of a choice."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dem_bridge.backends import splitting
from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.lammps import LammpsGranular
from dem_bridge.backends.scipy_dop853 import DEFAULT_RTOL, ScipyDop853
from dem_bridge.backends.verlet import Verlet
from dem_bridge.runs.cache import RunCache
from dem_bridge.runs.campaign import nodes, run_cases, run_groups
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from dem_bridge.runs.uncertainty.estimate import looser_cases, solve
from dem_bridge.scene.scene import Damping, Scene
from dem_bridge.trajectory.trajectory import QUANTITIES
from dem_bridge.verification.roles import THEORY
from dem_bridge.verification.verify import plan_scene
from tests.helpers.three_bodies import THREE

SCENE = THREE
DAMPED = replace(SCENE, damping=Damping(law="dashpot", coefficient=10.0))
ACCURACY = 1e-4


@pytest.fixture
def solves(monkeypatch: pytest.MonkeyPatch) -> Counter[tuple[Any, ...]]:
    """Count the runs of each kind by their settings; the twin stands in for LAMMPS, and is counted as LAMMPS."""
    counts: Counter[tuple[Any, ...]] = Counter()
    split, scipy, twin = splitting.solve, ScipyDop853.run, Verlet.run
    engine = [False]

    def counted_twin(code: Any, method: Any, scene: Any, plan: Any, **settings: Any) -> Any:
        if not engine[0]:
            counts["twin", round(plan.step, 15), bool(np.any(np.asarray(settings["radius"]) > 0.0))] += 1
        return split(code, method, scene, plan, **settings)

    def counted_scipy(self: ScipyDop853, scene: Scene, resolution: Resolution, sampling: Sampling) -> Any:
        counts["scipy", resolution.rtol or DEFAULT_RTOL] += 1
        return scipy(self, scene, resolution, sampling)

    def lammps(self: LammpsGranular, scene: Scene, resolution: Resolution, sampling: Sampling) -> Any:
        counts["lammps", resolution.dt] += 1
        engine[0] = True
        try:
            return twin(Verlet(), scene, replace(resolution, surrogate_radius=1e-3), sampling)
        finally:
            engine[0] = False

    monkeypatch.setattr(splitting, "solve", counted_twin)
    monkeypatch.setattr(ScipyDop853, "run", counted_scipy)
    monkeypatch.setattr(LammpsGranular, "run", lammps)
    return counts


def _verify(scene: Scene, solves: Counter[tuple[Any, ...]]) -> list[float]:
    """Make all runs of the verification of a scene, and of ASE on the same steps; return the steps of twins.

    Steps that the choice tried and left are not counted.
    """
    cache = RunCache()
    plan = plan_scene(scene, ACCURACY, cache=cache)
    assert plan.runs is not None
    solves.clear()
    settings = [run.provenance["settings"] for run in cache.runs.values()]
    solves.update(("twin", round(each["dt"], 15), "surrogate_radius" in each) for each in settings)
    main = plan.runs.twin
    ase = [] if scene.damped else [replace(main, backend="ase")]
    results = run_cases([*plan.cases, *ase], cache=cache)
    assert all(result.failure is None for result in results if result.case.backend != THEORY)
    return [float(case.resolution.dt or 0.0) for case in (plan.runs.twin, *plan.runs.twin_refinements)]


@pytest.mark.parametrize("scene", [SCENE, DAMPED], ids=["reference", "scipy"])
def test_a_verification_makes_each_run_once(scene: Scene, solves: Counter[tuple[Any, ...]]) -> None:
    _verify(scene, solves)
    assert set(solves.values()) == {1}, solves
    assert {kind for kind, *_ in solves} == {"twin", "scipy", "lammps"}


def test_the_runs_are_one_family_and_the_refinement_levels(solves: Counter[tuple[Any, ...]]) -> None:
    main, *levels = _verify(SCENE, solves)
    twins = {key[1:] for key in solves if key[0] == "twin"}
    family = {(main, False), (main, True), (2.0 * main, False), (main / 3.0, False)}
    assert twins == {(round(step, 15), positional) for step, positional in family | {(step, False) for step in levels}}
    assert Counter(kind for kind, *_ in solves) == {"twin": 4 + 4, "lammps": 1 + 4, "scipy": 4}


@pytest.mark.parametrize(("scene", "kind"), [(SCENE, "twin"), (DAMPED, "twin"), (DAMPED, "scipy")])
def test_cases_that_share_nothing_repeat_runs(
    scene: Scene, kind: str, solves: Counter[tuple[Any, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    # the fault that the tests above catch
    monkeypatch.setattr(nodes, "needs_of", lambda case: ())
    plan = plan_scene(scene, ACCURACY)
    assert plan.runs is not None
    other = replace(plan.runs.reference, backend="scipy")
    run_cases([*plan.cases, other])
    assert max(count for key, count in solves.items() if key[0] == kind) > 1


def test_runs_that_are_parts_of_others_are_stored(tmp_path: Path, solves: Counter[tuple[Any, ...]]) -> None:
    case = Case(scene=DAMPED, backend="reference", resolution=Resolution(), sampling=Sampling(count=5))
    run_cases([case], store=Store(tmp_path))
    assert solves == {("scipy", factor * DEFAULT_RTOL): 1 for factor in (1, 5, 10, 20)}
    for looser in looser_cases(case):
        run_cases([looser], store=Store(tmp_path))
    assert solves.total() == 4


@pytest.mark.parametrize("jobs", [1, 2])
def test_shared_runs_give_the_uncertainties_of_cases_that_are_solved_alone(jobs: int) -> None:
    cases = [
        Case(scene=scene, backend=name, resolution=Resolution(dt=1e-7), sampling=Sampling(count=5))
        for scene, name in ((SCENE, "ase"), (SCENE, "verlet"), (DAMPED, "verlet"), (DAMPED, "reference"))
    ]
    [together] = run_groups([cases], jobs=jobs)
    for case, result in zip(cases, together, strict=True):
        alone, run = solve(case), result.trajectory
        assert run is not None
        for name in QUANTITIES:
            assert np.asarray(run.uncertainty[name]).tobytes() == np.asarray(alone.uncertainty[name]).tobytes()
            assert getattr(run, name).tobytes() == getattr(alone, name).tobytes()
        assert run.uncertainty.as_json()["parts"] == alone.uncertainty.as_json()["parts"]
