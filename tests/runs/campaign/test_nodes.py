"""Nodes of a campaign: one for each run and each estimate, and each after those that it needs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.runs import case as case_module
from dem_bridge.runs.cache import RunCache
from dem_bridge.runs.campaign import run_cases
from dem_bridge.runs.campaign.nodes import Estimate, Graph, Groups, Run
from dem_bridge.runs.case import Case
from dem_bridge.runs.keys import run_key
from dem_bridge.runs.store import Store
from dem_bridge.runs.uncertainty.estimate import looser_cases, solve
from dem_bridge.scene.scene import Scene

PAIR = Scene(name="pair", duration=1e-4, mass=(8.1e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))


def _case(name: str, scene: Scene = PAIR, **settings: Any) -> Case:
    return Case(scene=scene, backend=name, resolution=Resolution(**settings), sampling=Sampling(count=4))


TWIN, ASE, SCIPY = _case("verlet", dt=1e-7), _case("ase", dt=1e-7), _case("scipy", rtol=1e-9)


def _alone(case: Case) -> Case:
    return replace(case, uncertainty=False)


def _needs(graph: Graph, case: Case) -> set[Case]:
    node = next(node for node in graph.nodes.values() if node.case == case)
    return {graph.nodes[need].case for need in node.needs}


def test_an_estimate_needs_runs_and_the_family_of_a_twin() -> None:
    graph = Graph([ASE, SCIPY, TWIN, _alone(TWIN)], RunCache())
    assert {node.case for node in graph.tasks} == {_alone(ASE), _alone(SCIPY), TWIN, *looser_cases(SCIPY)}
    assert _needs(graph, ASE) == {_alone(ASE), TWIN}
    assert _needs(graph, SCIPY) == {_alone(SCIPY), *looser_cases(SCIPY)}
    # a run is read off the estimate that is solved as a whole
    assert _needs(graph, _alone(TWIN)) == {TWIN}
    assert {type(node) for node in graph.nodes.values() if node.case.uncertainty} == {Estimate}
    assert {type(node) for node in graph.nodes.values() if not node.case.uncertainty} == {Run}
    order = [node.case for node in graph.put_together(node.name for node in graph.tasks)]
    assert set(order) == {ASE, SCIPY, _alone(TWIN)}
    assert {graph.nodes[name].case for name in graph.shared} >= {TWIN, _alone(ASE), _alone(SCIPY)}


def test_a_node_is_put_together_as_soon_as_what_it_needs_is_made() -> None:
    graph = Graph([ASE, SCIPY, TWIN], RunCache())
    at = {node.case: node.name for node in graph.nodes.values()}
    assert list(graph.put_together()) == []
    assert list(graph.put_together([at[TWIN]])) == []
    assert [node.case for node in graph.put_together([at[_alone(ASE)]])] == [ASE]
    rest = [at[case] for case in (_alone(SCIPY), *looser_cases(SCIPY))]
    assert list(graph.put_together(rest[:-1])) == []
    assert [node.case for node in graph.put_together(rest[-1:])] == [SCIPY]
    assert list(graph.put_together()) == []


def test_a_group_is_complete_once_when_its_last_node_is_made() -> None:
    graph = Graph([TWIN, ASE, _alone(SCIPY), TWIN], RunCache())
    groups = Groups([2, 0, 1, 1], graph)
    twin, ase, scipy, _ = graph.names
    assert list(groups.completed([])) == [1]
    assert list(groups.completed([scipy])) == [2]
    assert list(groups.completed([twin])) == [3]
    assert list(groups.completed([twin, ase])) == [0]
    assert list(groups.completed([twin, ase, scipy])) == []


def test_tasks_of_a_group_have_the_time_of_the_longest_of_them() -> None:
    graph = Graph([TWIN, _alone(SCIPY), ASE], RunCache())
    twin, scipy, _ = graph.names
    times = {node.name: node.case.expected for node in graph.tasks}
    # the twin is of both groups: the second also needs it
    longest = Groups([1, 2], graph).longest()
    assert longest.keys() == times.keys()
    assert set(longest.values()) == {(max(times.values()), 1)}
    alone = Groups([1, 1, 1], graph).longest()
    assert alone[scipy] == (times[scipy], 1)
    assert alone[twin][1] == (0 if max(times, key=lambda name: times[name]) in (twin, scipy) else 2)


def test_what_exists_already_is_not_needed() -> None:
    cache = RunCache()
    solve(TWIN, cache)
    cache.keep(ASE, ASE.solve())
    graph = Graph([ASE, TWIN, _alone(TWIN), _alone(ASE)], cache)
    assert graph.tasks == []
    assert _needs(graph, ASE) == _needs(graph, TWIN) == set()
    other = _case("ase", dt=1e-7, surrogate_radius=1e-3)
    graph = Graph([other], cache)
    assert _needs(graph, other) == {_alone(other)}


def test_a_run_of_the_family_of_a_twin_is_no_task() -> None:
    positional = _alone(_case("verlet", dt=1e-7, surrogate_radius=1e-3))
    graph = Graph([positional, TWIN], RunCache())
    assert [node.case for node in graph.tasks] == [TWIN]
    assert _needs(graph, positional) == {TWIN}
    assert graph.shared == {node.name for node in graph.tasks}
    alone = Graph([positional, _case("verlet", dt=2e-7)], RunCache())
    assert len(alone.tasks) == 2


def test_a_family_that_is_needed_is_made_even_if_its_estimate_is_stored(tmp_path: Path) -> None:
    store = Store(tmp_path)
    run_cases([TWIN], store=store)
    assert [node.case for node in Graph([TWIN, _alone(TWIN)], RunCache(store)).stored] == [TWIN]
    graph = Graph([TWIN, ASE], RunCache(store))
    assert (graph.stored, {node.case for node in graph.tasks}) == ([], {TWIN, _alone(ASE)})


def test_cases_without_a_key_are_nodes_of_their_own() -> None:
    law = replace(PAIR, name="law", law=lambda overlap: 4e9 * overlap**1.5)
    graph = Graph([_case("verlet", law, dt=1e-7)] * 2 + [_case("ase", PAIR, dt=1e-7)], RunCache())
    assert len(set(graph.names)) == 3
    assert sum(node.key is None for node in graph.tasks) == 2


@pytest.mark.parametrize("forgets", [False, True])
def test_a_node_has_one_key_and_one_look_at_the_store(
    forgets: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keys, looks = Counter[str | None](), Counter[str]()
    load = Store.load

    def counted_key(*arguments: Any, **how: Any) -> str | None:
        key = run_key(*arguments, **how)
        keys[key] += 1
        return key

    def counted_load(store: Store, key: str, scene: Scene) -> Any:
        looks[key] += 1
        return load(store, key, scene)

    monkeypatch.setattr(case_module, "run_key", counted_key)
    monkeypatch.setattr(Store, "load", counted_load)
    if forgets:  # the fault that this test catches
        monkeypatch.setattr(RunCache, "key", lambda cache, case: case.key)
    Graph([ASE, SCIPY, TWIN, _alone(TWIN), _alone(ASE)], RunCache(Store(tmp_path)))
    assert (max(keys.values()) == 1) is not forgets
    assert max(looks.values()) == 1


def test_results_are_those_of_cases_that_are_solved_alone() -> None:
    cases = [_alone(TWIN), ASE, TWIN, SCIPY, _alone(SCIPY)]
    by_case: Mapping[Case, Any] = {result.case: result.trajectory for result in run_cases(cases)}
    for case in cases:
        alone = solve(case)
        assert by_case[case].velocity.tobytes() == alone.velocity.tobytes()
        assert by_case[case].uncertainty["velocity"] == alone.uncertainty["velocity"]
