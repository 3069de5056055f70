"""Workers of another version, or with other code, do nothing: no result of theirs has the key of this code."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from concurrent.futures import Executor, Future
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import dem_bridge as db
from dem_bridge.ensembles.draw import Variation
from dem_bridge.ensembles.sensitivity import sobol_indices
from dem_bridge.errors import UsageError
from dem_bridge.runs.campaign import identity, run_cases
from dem_bridge.runs.campaign.tasks import Task, packed, perform, perform_task
from dem_bridge.runs.case import Case
from dem_bridge.runs.code import is_within
from dem_bridge.runs.store import Store
from tests.helpers.campaign_cases import SHORT, short_case

REFUSED = r"^a worker has dem_bridge \S+ with code \w+; allowed: \S+ with code \w+, as here; install the same on all"
#: what another dem_bridge has in place of this one
OTHERS = [("__version__", "0.0.1"), ("_code", lambda: "0123456789ab")]


class Elsewhere(Executor):
    """Call functions as a process does that has another version, or other code."""

    _max_workers = 2

    def __init__(self, name: str, value: Any) -> None:
        self.name, self.value = name, value

    def submit(self, function: Any, /, *arguments: Any, **keywords: Any) -> Future[Any]:
        future: Future[Any] = Future()
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(identity, self.name, self.value)
            try:
                future.set_result(function(*arguments, **keywords))
            except Exception as error:
                future.set_exception(error)
        return future


@pytest.fixture(params=OTHERS, ids=["version", "code"])
def elsewhere(request: pytest.FixtureRequest) -> Elsewhere:
    return Elsewhere(*request.param)


@pytest.mark.parametrize("shared", [False, True])
def test_a_case_that_another_dem_bridge_would_solve_is_refused_and_nothing_is_kept(
    elsewhere: Elsewhere, shared: bool, tmp_path: Path
) -> None:
    store = Store(tmp_path) if shared else None
    with pytest.raises(UsageError, match=REFUSED) as caught:
        run_cases([short_case()], jobs=elsewhere, store=store, everything=True)
    assert "\n" not in str(caught.value)
    assert list(tmp_path.rglob("*.npz")) == []


def test_ensembles_and_indices_are_refused_to_another_dem_bridge(elsewhere: Elsewhere) -> None:
    with pytest.raises(UsageError, match=REFUSED):
        db.ensemble(SHORT, {"mass": 0.1}, n=2, checks=0, executor=elsewhere)
    variation = Variation(scene=SHORT, vary={"mass": 0.1})
    with pytest.raises(UsageError, match=REFUSED):
        sobol_indices(variation, lambda values: values["peak_force"].T, base=2, executor=elsewhere)


def test_a_task_of_a_campaign_with_other_code_is_refused_by_name() -> None:
    task = Task(name="short", case=short_case())
    outcome = perform(packed(task))
    assert outcome.trajectory is not None
    # as a campaign sends them that has another version, other code, or no word of its code
    for other in ({"version": "0.0.1", "code": "0123456789ab"}, {"code": "0123456789ab"}, {"code": ""}):
        foreign = replace(pickle.loads(packed(task)), **other)
        outcome = perform(pickle.dumps(foreign))
        assert isinstance(outcome.error, UsageError)
        assert f"allowed: {foreign.version} with code {foreign.code or 'unknown'}, as here" in str(outcome.error)
        assert (outcome.trajectory, outcome.kept) == (None, False)


def test_a_run_that_has_another_key_at_its_worker_is_not_kept_there_as_the_run_of_the_task(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = short_case()
    task = Task(name="short", case=case, key=case.key, folder=tmp_path, limit=10**9)
    monkeypatch.setattr(Case, "key", property(lambda _: "f" * 64))  # of another machine
    outcome = perform_task(task)
    assert outcome.trajectory is not None
    assert not outcome.kept
    assert task.key is not None
    assert Store(tmp_path).load(task.key, case.scene) is None


def test_a_task_that_cannot_be_read_is_one_line() -> None:
    outcome = perform(b"no pickle")
    assert "a case cannot be read in another process: UnpicklingError" in str(outcome.error)


@pytest.fixture
def identity_of(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    def computed(**texts: str) -> tuple[str, str]:
        def without(parts: tuple[str, ...]) -> dict[str, str]:
            return {name: text for name, text in texts.items() if not is_within(name.replace("_", ".", 1), parts)}

        monkeypatch.setattr(identity, "code_without", without)
        identity._code.cache_clear()
        return identity.identity()

    yield computed
    identity._code.cache_clear()


def test_the_identity_is_that_of_the_code_that_workers_use(identity_of: Any) -> None:
    texts = dict.fromkeys(
        ("physics_law", "campaign_tasks", "ensembles_lanes", "runs_store", "report_page", "cli_x"), "a"
    )
    before = identity_of(**texts)
    assert before == identity_of(**texts)
    changed = {name for name in texts if identity_of(**{**texts, name: "b"}) != before}
    assert changed == {"physics_law", "campaign_tasks", "ensembles_lanes", "runs_store"}
    assert len(before[1]) == 12
