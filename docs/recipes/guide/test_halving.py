# tests/studies/test_halving.py
"""Half a time step gives a quarter of the error where the order is clean."""

from __future__ import annotations

import pytest

from dem_bridge.scene.scene import Scene
from dem_bridge.studies.halving import study_halving

PRESSED = Scene(
    name="pressed", duration=2e-5, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), gap=(-1e-6,), samples=4
)
TINY = (PRESSED, {"dt": 2e-7})


def test_the_error_of_a_pair_in_contact_falls_by_a_factor_of_four() -> None:
    rows = study_halving(PRESSED, dt=2e-7).tables[0].rows
    # the next term of the error is smaller by (omega dt)^2 = 1e-4
    assert float(rows[0][1]) / float(rows[1][1]) == pytest.approx(4.0, rel=2e-3)
