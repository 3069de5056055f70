"""The least uncertainty of adaptive runs: further runs that agree to the last bit may all have lost the last digits."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from dem_bridge.uncertainty.replicas import REFERENCE, replica_uncertainty
from tests.helpers.fake_runs import free_flight

#: the steps of a small chain
STEPS = 1000


def test_what_a_thousand_roundings_lose_is_covered_where_all_runs_agree() -> None:
    lost = []
    for seed in range(20):
        increments = np.random.default_rng([16, seed]).uniform(0.5, 1.5, STEPS).tolist()
        total, exact = 0.0, Fraction(0)
        for increment in increments:
            total += increment
            exact += Fraction(increment)
        run = free_flight(bodies=1, contacts=0, displacement=np.full((5, 1), total))
        # every other run adds the same numbers in the same order
        bar = replica_uncertainty(run, [run, run], REFERENCE)["displacement"]
        error = abs(float(Fraction(total) - exact))
        assert error <= bar
        lost.append(error / (2.0**-52 * total))
    # what they lose is more than a unit in the last place, and the bar is not much more than that
    assert 1.0 < max(lost) < 16.0
