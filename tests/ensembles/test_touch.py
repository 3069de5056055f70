"""Steps that meet a touch are corrected: what is left of their error, and what that costs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dem_bridge.backends.blanes_moan import SRKN_6B
from dem_bridge.ensembles import solve
from dem_bridge.ensembles.draw import Variation
from dem_bridge.ensembles.lanes import jacobi_rules, touch_defect
from dem_bridge.ensembles.solve import solve_chains
from dem_bridge.scene.scene import Scene

#: bodies that meet, part and meet again: some twenty touches
GAPS = Scene(
    name="gaps",
    duration=4e-4,
    mass=(0.01, 0.02, 0.015, 0.01, 0.03),
    stiffness=(2e10, 1e10, 3e10, 2e10),
    gap=(1e-6, 2e-6, 1e-6, 3e-6),
    velocity=(0.8, 0.0, -0.1, 0.0, 0.0),
)


def _errors(exponent: float) -> np.ndarray:
    """Return the root mean square errors of 64 chains' velocities at 50 samples, with 400 and 1600 steps."""
    # forces at an overlap of 5 um are the same for all exponents
    stiffness = tuple(5e-6 ** (2.5 - exponent) * k for k in GAPS.stiffness)
    scene = replace(GAPS, exponent=exponent, stiffness=stiffness)
    chains = Variation(scene=scene, vary={"mass": 0.05, "velocity": 0.05}).block(0, 64)
    coarse, fine, exact = (solve_chains(scene, chains, steps, 50)["velocity"] for steps in (400, 1600, 10_000))
    return np.array([np.sqrt(np.mean((value - exact) ** 2)) for value in (coarse, fine)])


@pytest.mark.parametrize("exponent", [2.5, 2.0, 2.2, 3.0])
def test_a_corrected_touch_has_a_small_part_of_its_error(exponent: float, monkeypatch: pytest.MonkeyPatch) -> None:
    corrected = _errors(exponent)
    monkeypatch.setattr(solve, "SLOWEST_TOUCH", math.inf)
    # measured: 1/46 and 1/31 for n = 2.5, 1/770 and 1/9800 for n = 2, 1/100 and 1/55 for n = 2.2, 1/140 and 1/500 for 3
    assert np.all(15.0 * corrected < _errors(exponent))
    if exponent in (2.0, 3.0):  # after the touch the force is a polynomial: nothing is left of it
        assert math.log(corrected[0] / corrected[1], 4) > 3.5


@pytest.mark.parametrize("part", [0.0, 0.3, 0.8, 1.0])
def test_a_corrected_step_is_that_of_two_bodies(part: float) -> None:
    mobility, stiffness, rate, step = 150.0, 2e10, 0.5, 4e-7
    drifts, kicks = SRKN_6B.drifts, SRKN_6B.kicks
    overlap = -part * step * rate
    exact = solve_ivp(
        lambda _, y: [y[1], -mobility * stiffness * max(y[0], 0.0) ** 1.5],
        (part * step, step), [0.0, rate], rtol=1e-12, atol=1e-18, method="DOP853",
    ).y[:, -1]  # fmt: skip
    depth, speed = overlap, rate
    for stage, kick in enumerate(kicks):
        speed -= kick * step * mobility * stiffness * max(depth, 0.0) ** 1.5
        if stage < len(drifts):
            depth += drifts[stage] * step * speed
    rule = jacobi_rules(np.array([2.5]))[0]
    impulse, moment = touch_defect(overlap, rate, 0.0, 0.0, mobility, stiffness, 0, 2.5, rule, 0.0, drifts, kicks, step)
    assert speed - mobility * impulse == pytest.approx(exact[1], abs=1e-9 * rate)
    assert depth - mobility * moment == pytest.approx(exact[0], abs=1e-9 * rate * step)
    if part in (0.3, 0.8):
        assert abs(speed - exact[1]) > 1e-8 * rate, "without the correction the step is off"


def test_corrections_keep_the_momentum() -> None:
    chains = Variation(scene=GAPS, vary={"mass": 0.05}).block(0, 8)
    momentum = np.einsum("csi,ci->cs", solve_chains(GAPS, chains, 400, 50)["velocity"], chains.mass)
    assert np.ptp(momentum, axis=1) == pytest.approx(0.0, abs=1e-15)
