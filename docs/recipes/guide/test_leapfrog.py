# tests/backends/test_leapfrog.py
"""Position-Verlet: of second order, and another code than the twin."""

from __future__ import annotations

import numpy as np

from dem_bridge.scene.scene import Scene
from tests.conftest import Solve

#: a pair that stays in touch: nothing opens, so the order is clean
PRESSED = Scene(
    name="pressed", duration=2e-5, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), gap=(-1e-6,), samples=4
)


def test_half_the_step_leaves_a_quarter_of_the_error(solved: Solve) -> None:
    truth = solved(PRESSED, "reference").velocity
    coarse, fine = (
        float(np.max(np.abs(solved(PRESSED, "leapfrog", dt=dt, uncertainty=False).velocity - truth)))
        for dt in (2e-7, 1e-7)
    )
    # the next term of the error is smaller by (omega dt)^2 = 1e-4
    assert abs(coarse / fine - 4.0) < 0.01
