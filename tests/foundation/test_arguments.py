"""Arguments of a wrong type: every public function raises one error of dem_bridge before it does anything."""

from __future__ import annotations

import datetime
import inspect
import re
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.errors import DemBridgeError, UsageError
from dem_bridge.foundation.arguments import check_arguments

PAIR = db.Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=2)
SAMPLES = np.zeros((2, 2))
RUN = db.Trajectory(
    time=np.arange(2.0), displacement=SAMPLES, velocity=SAMPLES, contact_force=SAMPLES[:, :1],
    peak_force=np.ones(1), crossing_time=np.ones(1), cost=db.solve(PAIR, backend="bca").cost, provenance={},
)  # fmt: skip
BALL = db.Body(shape="sphere", radius=9e-3, material=db.Material(youngs_modulus=7e10, poissons_ratio=0.2, density=2e3))
#: arguments that functions require
REQUIRED: dict[str, Any] = {
    "scene": PAIR, "accuracy": 0.5, "vary": {"mass": 0.1}, "run": RUN, "reference": RUN, "table": "bodies",
    "path": "missing", "file": "decelerating-40", "folder": "missing", "source": "decelerating-40",
    "name": "scope", "duration": 1e-4, "bodies": (BALL, BALL),
    "dt": [2.0, 1.0], "error": [4.0, 1.0], "stiffness": 6e9, "radius": 9e-3,
    "youngs_modulus": 7e10, "poissons_ratio": 0.2, "density": 2700.0, "speed": 0.5,
}  # fmt: skip
#: ``law_of`` belongs to the formulas, which know no errors of dem_bridge
FUNCTIONS = sorted(name for name in db.__all__ if inspect.isfunction(getattr(db, name)) and name != "law_of")


def nested(depth: int) -> list[Any]:
    return [nested(depth - 1)] if depth else []


#: values that no argument may have; each ended in a TypeError, RecursionError or warning of some function
ODD = {
    "an object": object(), "a complex number": 1j, "a matrix": np.ones((2, 2)), "a duration": np.timedelta64(1, "s"),
    "a date": datetime.datetime.min, "deep brackets": nested(300), "bytes": b"1",
}  # fmt: skip


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_wrong_type_of_any_argument_is_an_error_of_one_line(name: str) -> None:
    function = getattr(db, name)
    parameters = inspect.signature(function).parameters
    required = {
        key: REQUIRED[key] for key, item in parameters.items() if item.default is item.empty and key in REQUIRED
    }
    for key, item in parameters.items():
        if item.kind is not item.VAR_KEYWORD:
            for label, value in ODD.items():
                with pytest.raises(DemBridgeError) as caught:
                    function(**{**required, key: value})
                assert key in str(caught.value) or key == "source" or label == "deep brackets", (key, label)
                assert str(caught.value).isprintable()
                assert len(str(caught.value)) <= 500


def test_the_functions_are_those_of_the_facade() -> None:
    assert {"solve", "plan", "verify", "judge", "compare", "angles_for", "load_scene"} < set(FUNCTIONS)


def annotated(
    number: float = 1.0,
    count: int | None = None,
    values: list[float] | tuple[float, ...] = (),
) -> None:
    """Take a number, a count and values."""
    check_arguments(annotated, locals())


@pytest.mark.parametrize("number", [1, 1.5, -0.0, np.float32(1.0), np.int64(3), float("nan")])
def test_numbers_of_python_and_numpy_are_numbers(number: float) -> None:
    annotated(number)


@pytest.mark.parametrize("number", [True, np.bool_(True), "1", 10**400, np.array(1.0), None, 1j])
def test_truth_values_texts_and_numbers_beyond_floats_are_no_numbers(number: Any) -> None:
    with pytest.raises(UsageError, match="allowed: a number"):
        annotated(number)


def test_a_whole_number_may_have_any_size_but_no_fraction() -> None:
    annotated(count=10**400)
    with pytest.raises(UsageError, match=r"count = 1\.0; allowed: a whole number, or None"):
        annotated(count=1.0)  # type: ignore[arg-type]


@pytest.mark.parametrize("path", ["a\0b", "a" * 300, "\ud800"])
def test_a_name_that_no_file_can_have_is_refused(path: str) -> None:
    for function in (db.load_trajectory, db.read_trajectory, db.load_scene, db.scene_from_deck):
        with pytest.raises(DemBridgeError, match="the path of a"):
            function(path)


@pytest.mark.parametrize(
    "changed", [{"time": 1.0}, {"velocity": "fast"}, {"uncertainty": None}, {"provenance": 3}, {"peak_force": [[1], 2]}]
)
def test_a_trajectory_of_wrong_parts_is_refused(changed: dict[str, Any]) -> None:
    parts: dict[str, Any] = {key: getattr(RUN, key) for key in inspect.signature(db.Trajectory).parameters}
    with pytest.raises(UsageError, match=next(iter(changed))):
        db.Trajectory(**{**parts, **changed})


def test_numbers_that_are_not_in_the_range_of_a_formula_name_it() -> None:
    for reach in (float("inf"), -1.0, float("nan"), "1", True):
        with pytest.raises(ValueError, match=r"reach = .*; allowed: a finite number > 0 \(m\)"):
            db.law_of(np.sqrt, reach=reach)  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="2 steps and 1 errors"):
        db.observed_order([2.0, 1.0], [1.0])
    with pytest.raises(UsageError, match="finite steps > 0"):
        db.observed_order([-2.0, 1.0], [1.0, 2.0])


@pytest.mark.parametrize(
    ("force", "made"),
    [
        (lambda _: 1.0, "shape () and type float64"),
        (lambda d: d[0], "shape (2,) and type float64"),
        (lambda d: 1j * d, "shape (2, 2) and type complex128"),
        (lambda d: np.nan * d, "shape (2, 2) and type float64"),
    ],
)
def test_a_law_that_does_not_return_a_number_for_each_overlap_is_refused(force: Any, made: str) -> None:
    with pytest.raises(ValueError, match=re.escape(f"is an array of {made}; allowed: finite numbers")):
        db.law_of(force, reach=1e-5)


def test_bytes_are_no_list_of_numbers() -> None:
    with pytest.raises(DemBridgeError, match=r"gap = b'1'; allowed: a list"):
        db.Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), gap=b"1")  # type: ignore[arg-type]
