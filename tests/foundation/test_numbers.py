"""One check says what a number is, and every argument, setting and entry of a scene is checked by it."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.errors import DemBridgeError, UsageError
from dem_bridge.foundation.numbers import check_number, is_within
from dem_bridge.lmp.engine import Engine
from dem_bridge.scene.scene import Scene

NO_NUMBERS = [True, np.True_, "3", None, 1j, Decimal(3), np.array([3.0]), np.timedelta64(3), math.nan, math.inf]
#: modules that look for a bool among numbers in their own way, each with the reason
OWN = {
    "physics/adiabatic.py": "formulas import nothing of the package",
    "physics/dispersion.py": "formulas import nothing of the package",
    "physics/numbers.py": "formulas import nothing of the package",
}


@pytest.mark.parametrize("value", NO_NUMBERS, ids=repr)
def test_what_is_no_finite_number_is_refused_and_named(value: Any) -> None:
    assert not is_within(value)
    with pytest.raises(UsageError) as refused:
        check_number("dt", value, "a number")
    assert str(refused.value) == f"dt = {value!r}; allowed: a number"


@pytest.mark.parametrize("value", [3, np.int64(3), 3.0, np.float32(3.0)], ids=repr)
def test_numbers_of_python_and_numpy_become_floats_or_ints(value: Any) -> None:
    assert check_number("x", value, "") == 3.0
    assert type(check_number("x", value, "")) is float
    whole = isinstance(value, int | np.integer)
    assert is_within(value, whole=True) == whole
    if whole:
        assert type(check_number("x", value, "", whole=True)) is int


def test_bounds_are_allowed_unless_they_are_open() -> None:
    assert [is_within(value, above=0.0, at_most=1.0) for value in (0.0, 1e-300, 1.0, 1.1)] == [False, True, True, False]
    assert [is_within(value, at_least=0.0, below=1.0) for value in (-0.1, 0.0, 1.0)] == [False, True, False]


PAIR: dict[str, Any] = {
    "name": "pair",
    "duration": 1e-4,
    "mass": (1.0, 1.0),
    "stiffness": (1.0,),
    "velocity": (1.0, 0.0),
}


@pytest.mark.parametrize(
    "call",
    [
        lambda value: db.solve("decelerating-40", backend="verlet", dt=value),
        lambda value: db.solve("decelerating-40", backend="bca", samples=value),
        lambda value: db.solve("decelerating-40", backend="verlet", accuracy=value),
        lambda value: db.plan("decelerating-40", accuracy=value),
        lambda value: db.ensemble("decelerating-40", vary={"mass": value}, n=1),
        lambda value: db.ensemble("decelerating-40", vary={"mass": 0.1}, n=value),
        pytest.param(lambda value: db.study("horizon", "decelerating-40", steps=value), marks=pytest.mark.studies),
        lambda value: db.angles_for([1e10], radius=1e-2, youngs_modulus=1e9, poissons_ratio=0.2, within=value),
        lambda value: Engine(ranks=value),
        lambda value: Scene(**{**PAIR, "samples": value}),
        lambda value: Scene(**{**PAIR, "mass": (1.0, value)}),
    ],
)
def test_no_argument_takes_true_or_nan_for_a_number(call: Callable[[Any], Any]) -> None:
    for value in (True, math.nan, "3"):
        with pytest.raises(DemBridgeError, match=r" = (True|nan|'3'); allowed: "):
            call(value)


def test_no_other_module_tells_numbers_from_truth_values() -> None:
    package, found = Path(db.__file__).parent, set()
    for file in package.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.BoolOp):
                text = ast.unparse(node)
                if "bool)" in text and ("int)" in text or "__float__" in text):
                    found.add(file.relative_to(package).as_posix())
    assert found == set(OWN)
