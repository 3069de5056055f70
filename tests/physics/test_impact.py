"""Damping factors of a wanted restitution: against direct integration of the impact and published values."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dem_bridge.physics.impact import alpha_of_restitution, alpha_of_tsuji


def _integrated(alpha: float, n: float, speed: float = 1.0) -> float:
    """Return the restitution of d'' = -d^(n-1) - alpha d^((n-2)/2) d' from d = 0 back to d = 0, by DOP853."""

    def rate(_: float, y: np.ndarray) -> list[float]:
        d = max(float(y[0]), 0.0)
        return [y[1], -(d ** (n - 1.0)) - alpha * d ** (0.5 * n - 1.0) * y[1]]

    def touch(t: float, y: np.ndarray) -> float:
        return float(y[0]) if t > 0.0 else 1.0

    touch.terminal, touch.direction = True, -1.0  # type: ignore[attr-defined]
    run = solve_ivp(rate, (0.0, 50.0), [0.0, speed], method="DOP853", rtol=1e-11, atol=1e-14, events=touch)
    return -float(run.y_events[0][0][1]) / speed


@pytest.mark.parametrize("n", [2.0, 2.5, 3.0])
@pytest.mark.parametrize("e", [0.3, 0.9])
def test_a_contact_that_is_not_clipped_has_the_restitution_for_which_alpha_is_computed(e: float, n: float) -> None:
    # 1e-7: steps of the second writing next to the touch, where the damping force has no derivative
    assert _integrated(alpha_of_restitution(e, n), n, speed=0.37) == pytest.approx(e, abs=1e-7)
    assert _integrated(1.001 * alpha_of_restitution(e, n), n) != pytest.approx(e, abs=1e-5)  # the test can fail


def test_marshalls_polynomial_gives_the_published_restitutions() -> None:
    # values of e for .1 .3 .5 .7 .9, computed independently with the prefactor sqrt(2)
    for e, out in zip((0.1, 0.3, 0.5, 0.7, 0.9), (0.09948, 0.29991, 0.49992, 0.69994, 0.90018), strict=True):
        alpha = alpha_of_tsuji(e)
        assert math.exp(-math.pi * alpha / math.sqrt(5.0 - alpha**2)) == pytest.approx(out, abs=6e-6)
    assert all(alpha_of_tsuji(e) > 0.0 for e in np.linspace(1e-3, 1.0, 1000).tolist())  # it never drives a contact


def test_no_damping_belongs_to_a_restitution_of_one() -> None:
    assert str(alpha_of_restitution(1.0)) == "0.0"


@pytest.mark.parametrize("e", [0.0, -0.1, 1.0 + 1e-9, math.nan, math.inf, True, "half"])
def test_a_restitution_is_above_0_and_at_most_1(e: float) -> None:
    for function in (alpha_of_restitution, alpha_of_tsuji):
        with pytest.raises(ValueError, match=r"^restitution = .*; allowed: a"):
            function(e)
