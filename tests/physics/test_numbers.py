"""Checks of numbers: both sides of each bound, and the message in full."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from dem_bridge.physics.numbers import above, not_negative, number, poisson_ratio

UP, DOWN = math.nextafter(1.0, 2.0), math.nextafter(1.0, 0.0)
NO_NUMBERS: tuple[object, ...] = (math.nan, math.inf, -math.inf, True, False, None, "1", [1.0])


@pytest.mark.parametrize(
    ("check", "value"),
    [
        (lambda x: number("x", x), -3),
        (lambda x: number("x", x), np.float32(0.5)),
        (lambda x: above(1.0, "x", x), UP),
        (lambda x: above(1.0, "x", x), 1e308),
        (lambda x: above(-2.0, "x", x), -1.5),
        (lambda x: above(1.0, "x", x, infinite="a wall"), math.inf),
        (lambda x: above(1.0, "x", x, infinite="a wall"), 2.0),
        (lambda x: not_negative("x", x, "m"), 0.0),
        (lambda x: not_negative("x", x, "m"), 5e-324),
        (lambda x: poisson_ratio("x", x), 0.5),
        (lambda x: poisson_ratio("x", x), -DOWN),
        (lambda x: poisson_ratio("x", x), 0),
    ],
)
def test_what_is_allowed_is_returned_as_a_float(check: Callable[[Any], float], value: Any) -> None:
    assert check(value) == value
    assert type(check(value)) is float


@pytest.mark.parametrize("value", NO_NUMBERS)
def test_what_is_no_finite_number_is_refused_by_every_check(value: object) -> None:
    checks: tuple[Callable[[], float], ...] = (
        lambda: number("x", value),
        lambda: above(-1.0, "x", value),
        lambda: not_negative("x", value, "m"),  # type: ignore[arg-type]
        lambda: poisson_ratio("x", value),  # type: ignore[arg-type]
    )
    for check in checks:
        with pytest.raises(ValueError, match=rf"^x = {re.escape(repr(value))}; allowed: a finite number"):
            check()


@pytest.mark.parametrize(
    ("check", "text"),
    [
        (lambda: number("x", "1"), "x = '1'; allowed: a finite number"),
        (lambda: number("x", None, "m/s"), "x = None; allowed: a finite number (m/s)"),
        (lambda: above(1.0, "x", 1.0), "x = 1.0; allowed: a finite number > 1"),
        (lambda: above(1.0, "x", DOWN, "kg"), f"x = {DOWN!r}; allowed: a finite number > 1 (kg)"),
        (lambda: above(0.0, "x", 0, "kg", infinite="a wall"),
            "x = 0; allowed: a finite number > 0 (kg), or inf for a wall"),
        (lambda: above(0.0, "x", -math.inf, infinite="a wall"),
            "x = -inf; allowed: a finite number > 0, or inf for a wall"),
        (lambda: above(0.0, "x", math.inf, why="it breaks"), "x = inf; allowed: a finite number > 0; it breaks"),
        (lambda: not_negative("x", -5e-324, "m"), "x = -5e-324; allowed: a number >= 0 (m)"),
        (lambda: poisson_ratio("x", -1.0), "x = -1.0; allowed: a number above -1 and up to 0.5"),
        (lambda: poisson_ratio("x", 0.51), "x = 0.51; allowed: a number above -1 and up to 0.5"),
    ],
)  # fmt: skip
def test_what_is_beyond_a_bound_is_refused_with_the_bound(check: Callable[[], float], text: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
        check()
