"""A size relative to a scale has one answer, without a scale too, wherever the package writes one."""

from __future__ import annotations

import ast
import math
import re
from pathlib import Path

import numpy as np
import pytest

import dem_bridge
from dem_bridge.trajectory.relative import own_scale, relative_size

#: words for a scale that may be zero
SCALES = {"scale", "speed", "largest"}
#: modules that divide by such a scale in their own way, each with the reason
OWN = {
    "judging/check/laboratory.py": "a run that ended in nan is infinitely far off",
    "judging/check/step.py": "a step over the largest one that an accuracy permits; no such step is twice too large",
    "backends/roundoff.py": "what solves imports nothing of what judges it",
    "runs/uncertainty/from_replicas.py": "the rule of the reference shares nothing with the rule of what it judges",
}


def test_a_small_value_has_the_scale_of_a_thousandth_of_the_largest() -> None:
    assert own_scale(np.array([2.0, -0.5, 1e-9, 0.0])).tolist() == [2.0, 0.5, 2e-3, 2e-3]


@pytest.mark.parametrize(
    ("amount", "scale", "expected"),
    [
        (3.0, 4.0, 0.75),
        (-3.0, 4.0, -0.75),
        (0.0, 4.0, 0.0),
        (0.0, 0.0, 0.0),
        (1e-300, 0.0, math.inf),
        (-1e-300, 0.0, -math.inf),
        (math.inf, 0.0, math.inf),
        (math.inf, math.inf, math.inf),
        (1.0, math.inf, 0.0),
        (math.nan, 4.0, math.nan),
        (math.nan, 0.0, math.nan),
        (1.0, math.nan, math.inf),
        (0.0, math.nan, 0.0),
    ],
)
def test_a_relative_size_has_one_answer(amount: float, scale: float, expected: float) -> None:
    for value in (relative_size(amount, scale), relative_size(np.array([amount]), np.array([scale]))[0]):
        assert value == expected or (math.isnan(value) and math.isnan(expected))


def test_numbers_are_floats_and_arrays_have_the_shape_of_both() -> None:
    assert type(relative_size(1.0, 3.0)) is float
    assert relative_size(np.array(1.0), np.array(0.0)).shape == ()
    # the same division, to the last digit
    assert relative_size(1.0, 3.0) == 1.0 / 3.0
    assert relative_size(np.ones((2, 1)), np.array([2.0, 0.0, 4.0])).tolist() == [[0.5, math.inf, 0.25]] * 2


def _own_answers(text: str) -> list[str]:
    """Return each ``a / scale if ... else other`` and ``a / max(..., 1e-300)`` of a relative size."""
    found = []
    for node in ast.walk(ast.parse(text)):
        branch = node.body if isinstance(node, ast.IfExp) else node
        if isinstance(branch, ast.BinOp) and isinstance(branch.op, ast.Div):
            divisor = ast.unparse(branch.right)
            named = branch is not node and re.split(r"\W", divisor)[-1] in SCALES
            if named or re.search(rf"\b({'|'.join(SCALES)})\b.*1e-300", divisor):
                found.append(ast.unparse(node))
    return found


def test_no_module_has_an_answer_of_its_own_but_where_codes_judge_each_other() -> None:
    package = Path(dem_bridge.__file__).parent
    files = {file.relative_to(package).as_posix(): file.read_text(encoding="utf-8") for file in package.rglob("*.py")}
    assert {name for name, text in files.items() if _own_answers(text)} == set(OWN)


@pytest.mark.parametrize("line", ["x / self.scale if self.scale > 0 else nan", "x / max(largest, 1e-300)"])
def test_an_answer_of_its_own_is_seen(line: str) -> None:
    assert _own_answers(line)
