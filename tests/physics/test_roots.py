"""Roots by Brent's method are those of scipy to the last bit, and scenes are read without scipy."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import brentq

from dem_bridge.physics import hertz
from dem_bridge.physics.roots import root_between

#: functions with a root for each number p > 0, and the arguments on both sides of it
FUNCTIONS: dict[str, tuple[Callable[[float, float], float], Callable[[float], tuple[float, float]]]] = {
    "power": (lambda x, p: x**5 - p, lambda p: (0.0, 1.0 + p)),
    "flat": (lambda x, p: math.cbrt(x - p) ** 5, lambda p: (-1.0, 2.0 + 3.0 * p)),
    "steep": (lambda x, p: math.tanh(1e6 * (x - p)), lambda p: (0.0, 10.0 * p)),
    "jump": (lambda x, p: 1.0 if x > p else -1.0, lambda p: (0.0, 1.5 * p)),
    "logarithm": (lambda x, p: math.log(x) - p, lambda p: (5e-324, 2.0 * math.exp(p))),
    "faint": (lambda x, p: 1e-160 * math.sin(x - p), lambda p: (p - 1.0, p + 1.5)),
}


class _Recorded:
    """A function of one number that keeps its arguments."""

    def __init__(self, function: Callable[[float, float], float], p: float) -> None:
        self.function, self.p, self.arguments = function, p, list[float]()

    def __call__(self, x: float) -> float:
        self.arguments.append(x)
        return self.function(x, self.p)


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("tolerances", [{"xtol": 1e-15}, {"xtol": 1e-16, "rtol": 1e-15}, {"xtol": 1e-3}])
def test_roots_are_those_of_scipy_to_the_last_bit(name: str, tolerances: dict[str, float]) -> None:
    function, ends = FUNCTIONS[name]
    for p in np.random.default_rng(1).uniform(0.01, 20.0, 300).tolist():
        ours, theirs = _Recorded(function, p), _Recorded(function, p)
        assert root_between(ours, *ends(p), **tolerances) == brentq(theirs, *ends(p), **tolerances)
        assert ours.arguments == theirs.arguments


def test_contact_ellipses_have_the_axes_that_scipy_finds() -> None:
    for angle in np.geomspace(hertz.SMALLEST_ANGLE, 89.9999, 2000).tolist():
        stretch = hertz._stretch(angle)
        ends = 0.99 * stretch, 1.4 * stretch
        assert hertz._flattening(stretch, "exact") == brentq(_beyond, *ends, args=(stretch,), xtol=1e-15)


def _beyond(flattening: float, stretch: float) -> float:
    return hertz._stretch_of(flattening, "exact") - stretch


def test_an_end_may_be_the_root_and_both_of_one_sign_are_an_error() -> None:
    assert root_between(lambda x: x - 1.0, 1.0, 2.0, xtol=1e-15) == 1.0
    assert root_between(lambda x: x - 2.0, 1.0, 2.0, xtol=1e-15) == 2.0
    with pytest.raises(ValueError, match="of one sign"):
        root_between(lambda x: x, 1.0, 2.0, xtol=1e-15)
    with pytest.raises(ValueError, match="no root between 0 and 1 after 100 iterations"):
        root_between(lambda x: 1.0 if x > 1e-60 else -1.0, 0.0, 1.0, xtol=1e-300)


def test_all_shipped_scenes_are_read_without_scipy() -> None:
    code = (
        "import sys, dem_bridge as db\n"
        "from dem_bridge.scene.shipped import listed_scenes\n"
        "for scene in listed_scenes(): db.load_scene(scene.name)\n"
        "print(*(name for name in sys.modules if name.split('.')[0] == 'scipy'))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
