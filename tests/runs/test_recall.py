"""Values that follow from stored runs: exact, computed once, and plain data."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.backends import scene_prescan
from dem_bridge.backends.prescan import Prescan
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.observables import registry
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.report.study import PARTS
from dem_bridge.runs import keys
from dem_bridge.runs.recall import begin_recall, recall, recall_prescan
from dem_bridge.runs.store import Store
from dem_bridge.scene.scene import Scene
from dem_bridge.verification.verification import Verification
from tests.helpers.fake_paper import fake_paper

VERDICT = Verdict(
    scene="pair", quantity="velocity", backend="verlet", reference="reference", outcome=Outcome.PASS, sentence="It is.",
    difference=1e-9, uncertainty=float("inf"), first_divergence=(1e-6, 2),
)  # fmt: skip
SCENE = Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=10)
#: every kind of plain data; two floats next to each other, and one that JSON has no number for
VALUE = {
    "verdicts": (VERDICT, VERDICT),
    "refinement": {"verlet": ([1e-8, 2e-8], [0.1, float("nan")])},
    "nothing": None,
    "numbers": (1, True, 0.1, float(np.nextafter(0.1, 1.0)), -0.0, np.float64(0.1), np.int64(3), np.bool_(True)),
    "image": b"\x89PNG",
    "arrays": (np.array([[1.0, np.nan], [-0.0, 5e-324]]), np.zeros((0, 3)), np.array([True, False])),
}


#: the classes in it
KINDS = (*PARTS, Verification)


def _exact(value: object) -> str:
    """Return a value as text, with all digits of all numbers of its arrays."""
    with np.printoptions(floatmode="unique", threshold=sys.maxsize):
        return repr(value)


def test_all_plain_data_comes_back_to_the_last_digit(tmp_path: Path) -> None:
    every = {**VALUE, "paper": fake_paper()}
    compute = Mock(return_value=every)
    first, second = (recall(Store(tmp_path), "value", ["key"], compute, kinds=KINDS) for _ in range(2))
    compute.assert_called_once()
    assert first is every
    for name, value in every.items():
        assert _exact(second[name]) == _exact(value), name
        assert type(second[name]) is type(value)
    assert second["verdicts"][0].outcome is Outcome.PASS


@pytest.mark.parametrize(
    "change",
    [{"keys": ["other"]}, {"keys": ["key", "other"]}, {"question": "other"}, {"accuracy": 2.0}, {"scenes": [SCENE]}],
    ids=lambda change: next(iter(change)),
)
def test_another_key_question_setting_or_scene_is_another_value(tmp_path: Path, change: dict[str, Any]) -> None:
    asked: dict[str, Any] = {"question": "value", "keys": ["key"], "accuracy": 1.0}
    assert recall(Store(tmp_path), compute=lambda: 1, **asked) == 1
    assert recall(Store(tmp_path), compute=lambda: 2, **asked) == 1
    assert recall(Store(tmp_path), compute=lambda: 3, **{**asked, **change}) == 3


@pytest.mark.parametrize("keys", [[None], ["key", None]])
def test_what_has_no_key_is_computed_each_time(tmp_path: Path, keys: list[str | None]) -> None:
    compute = Mock(return_value=1.0)
    for store in (Store(tmp_path), Store(tmp_path), None):
        assert recall(store, "value", keys, compute) == 1.0
    assert compute.call_count == 3
    assert not list(tmp_path.iterdir())


def test_a_damaged_entry_is_computed_again(tmp_path: Path) -> None:
    assert recall(Store(tmp_path), "value", ["key"], lambda: 1.0) == 1.0
    [entry] = tmp_path.iterdir()
    entry.write_bytes(entry.read_bytes()[:-1])
    store = Store(tmp_path)
    assert recall(store, "value", ["key"], lambda: 2.0) == 2.0
    assert "is damaged" in store.trouble


@pytest.mark.parametrize(
    "value", [len, object(), {"inside": [len]}, Mock()], ids=["function", "object", "list", "mock"]
)
def test_what_is_not_plain_data_is_refused_and_not_kept(tmp_path: Path, value: object) -> None:
    with pytest.raises(TypeError, match="is not plain data"):
        recall(Store(tmp_path), "value", ["key"], lambda: value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "name", ["subprocess:Popen", "dem_bridge.runs.store:Store", "dem_bridge.observables.verdict:Verdict"]
)
def test_an_entry_makes_no_class_but_those_that_are_declared(tmp_path: Path, name: str) -> None:
    store, wanted = Store(tmp_path), [Outcome]
    assert recall(store, "value", ["key"], lambda: 1.0, kinds=wanted) == 1.0
    [entry] = tmp_path.iterdir()
    fields = {"scene": "", "quantity": "", "backend": "", "reference": "", "outcome": "", "sentence": ""}
    text = json.dumps({"dataclass": name, "fields": fields}).encode()
    store.save_arrays(entry.stem, {"json": np.frombuffer(text, dtype=np.uint8)})
    assert recall(store, "value", ["key"], lambda: 2.0, kinds=wanted) == 2.0
    assert recall(store, "value", ["key"], lambda: 3.0, kinds=wanted) == 2.0
    # the fault: with the class declared the entry makes it
    store.save_arrays(entry.stem, {"json": np.frombuffer(text, dtype=np.uint8)})
    made = recall(store, "value", ["key"], lambda: None, kinds=[Verdict])
    assert isinstance(made, Verdict) is name.endswith("Verdict")


@pytest.mark.parametrize("value", [VERDICT, Outcome.PASS], ids=["dataclass", "enumeration"])
def test_a_value_of_a_class_that_is_not_declared_is_refused(tmp_path: Path, value: object) -> None:
    with pytest.raises(TypeError, match="is not plain data"):
        recall(Store(tmp_path), "value", ["key"], lambda: value)


def test_changed_code_is_another_value(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert recall(Store(tmp_path), "value", ["key"], lambda: 1) == 1
    monkeypatch.setattr(keys, "digest", lambda *_: "of another version")
    assert recall(Store(tmp_path), "value", ["key"], lambda: 2) == 2


def test_another_geometry_of_the_same_motion_is_another_value(tmp_path: Path) -> None:
    scene = db.load_scene("decelerating-40")
    assert scene.geometry is not None
    first, *others = scene.geometry.bodies
    changed = replace(
        scene, geometry=replace(scene.geometry, bodies=(replace(first, radius=2.0 * first.radius), *others))
    )
    assert changed.content_hash == scene.content_hash
    assert recall(Store(tmp_path), "value", [], lambda: 1, scenes=[scene]) == 1
    assert recall(Store(tmp_path), "value", [], lambda: 2, scenes=[changed]) == 2


def test_another_registered_observable_is_another_value(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compute = Mock(side_effect=count())

    def recalled() -> int:
        value: int = recall(Store(tmp_path), "value", ["key"], compute)
        return value

    renamed = replace(OBSERVABLES["momentum"], name="quantity_of_motion")
    foreign = replace(renamed, value=lambda scene, run: np.zeros(1))
    assert (recalled(), recalled()) == (0, 0)
    monkeypatch.setitem(registry._REGISTRY, renamed.name, renamed)
    assert (recalled(), recalled()) == (1, 1)
    # the code of an observable that another program has registered is not in the key
    monkeypatch.setitem(registry._REGISTRY, renamed.name, foreign)
    assert (recalled(), recalled()) == (2, 3)


def test_a_prescan_is_made_once_for_all_processes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    prescans: dict[str, Prescan] = {}
    monkeypatch.setattr(scene_prescan, "PRESCANS", prescans)
    recall_prescan(Store(tmp_path), SCENE)
    made = prescan_scene(SCENE)
    prescans.clear()  # another process
    monkeypatch.setattr(scene_prescan, "prescan_hertz", Mock(side_effect=AssertionError("made again")))
    recall_prescan(Store(tmp_path), SCENE)
    assert _exact(prescan_scene(replace(SCENE, name="other"))) == _exact(made)
    with pytest.raises(AssertionError, match="made again"):
        prescan_scene(replace(SCENE, mass=(8e-3, 2e-2)))


def test_a_value_is_begun_at_once_where_it_is_not_stored_and_kept_when_it_is_there(tmp_path: Path) -> None:
    store, finish = Store(tmp_path), Mock(return_value="a picture")
    begin = Mock(return_value=finish)
    value = begin_recall(store, "picture", ["key"], begin)
    assert (begin.call_count, finish.call_count, list(tmp_path.iterdir())) == (1, 0, [])
    assert value() == "a picture"
    again = begin_recall(store, "picture", ["key"], begin)(), recall(store, "picture", ["key"], finish)
    assert again == ("a picture", "a picture")
    assert (begin.call_count, finish.call_count) == (1, 1)
    assert begin_recall(None, "picture", ["key"], begin)() == "a picture"
    assert begin.call_count == 2
