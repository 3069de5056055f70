"""Print how often intervals cover a bias and how often a right model raises an alarm, in 200 synthetic measurements.

``python -m tests.studies.measurement.coverage``. The motion is that of scipy's solve_ivp, the noise is Gaussian.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.stats import binomtest

from dem_bridge.scene.file import parse_scene
from dem_bridge.studies.measurement.comparison import compare
from dem_bridge.studies.measurement.fit import fit_parameters
from dem_bridge.studies.measurement.parameters import parameters_of
from dem_bridge.studies.measurement.prediction import Prediction
from dem_bridge.studies.measurement.readings import Reading
from dem_bridge.studies.measurement.scalars import joint_of, scalars_of
from dem_bridge.trajectory.trajectory import Floats
from tests.helpers.synthetic import SCENE, motion

SEEDS, BIAS, NOISE = 200, 0.02, 0.005


def interval(count: int) -> str:
    """Return a share of SEEDS with its 95 % binomial interval (Clopper and Pearson)."""
    low, high = binomtest(count, SEEDS).proportion_ci(0.95)
    return f"{100 * count / SEEDS:.1f} % ({100 * low:.1f} to {100 * high:.1f} %)"


def main() -> None:
    """Print the figures of docs/measurement.md."""
    scene, bodies = parse_scene(SCENE), (1, 3)
    times = np.linspace(2e-6, 2.4e-4, 120)
    right, biased = (motion(times, stiffness=1.0 + bias)[0][:, bodies].T.ravel() for bias in (0.0, BIAS))
    sigma = np.full(len(times), NOISE)
    readings = tuple(
        Reading(quantity="velocity", place=body, time=times, value=np.zeros(len(times)), uncertainty=sigma)
        for body in bodies
    )
    prediction = Prediction(scene=scene, readings=readings)
    parameters = parameters_of({"stiffness": 0.02, "velocity": 0.005}, scene)
    own = np.full(len(right), NOISE)
    start = compare(prediction, parameters[1:], count=100, seed=0)
    none = compare(prediction, (), count=100, seed=0)
    joint, pulses, decided, shares = 0, 0, 0, []
    covered = {"stiffness alone": 0, "stiffness, start velocity uncertain": 0, "stiffness of both fitted": 0}
    velocity_covered, found = 0, []
    random = np.random.default_rng(2009)
    for _ in range(SEEDS):
        noise = NOISE * random.standard_normal(len(own))
        values = right + noise
        again = replace(none, measured=values, readings=_with(readings, values))
        shares.append([again.share_within(k) for k in (1.0, 2.0)])
        together = joint_of(scalars_of(replace(prediction, readings=again.readings), again), again)
        assert together is not None
        joint += again.joint().deviations > 2.0
        pulses += together.deviations > 2.0
        decided += min(1.0, 2.0 * min(again.joint().p, together.p)) < 0.0455
        for name, fit, others in zip(
            covered, (parameters[:1], parameters[:1], parameters), ((), parameters[1:], ()), strict=True
        ):
            # an uncertain start velocity acts on all values by its declared uncertainty
            extra = start.of_samples @ random.standard_normal(100) if others else 0.0
            best = fit_parameters(prediction, fit, others, biased + noise + extra, own).fitted
            covered[name] += best[0].low < BIAS < best[0].high
            if len(best) == 2:
                velocity_covered += best[1].low < 0.0 < best[1].high
            elif not others:
                found.append((best[0].change, best[0].uncertainty))
    print(f"{SEEDS} seeds; 2 bodies, 120 times, noise {NOISE} m/s")
    change, uncertainty = np.array(found).T
    print(f"stiffness found: {np.mean(change):.4f}, scatter {np.std(change):.5f}, stated {np.mean(uncertainty):.5f}")
    for name, count in covered.items():
        print(f"covered, {name}: {count} of {SEEDS}: {interval(count)}")
    print(f"covered, start velocity of both fitted: {velocity_covered}: {interval(velocity_covered)}")
    print(f"alarms at k = 2: values {joint}, pulses {pulses}, outcome {decided}: {interval(decided)}")
    print("within 1 and 2 u_val:", np.mean(shares, axis=0), "expected 0.6827 and 0.9545")


def _with(readings: tuple[Reading, ...], values: Floats) -> tuple[Reading, ...]:
    parts = np.split(values, len(readings))
    return tuple(replace(one, value=part) for one, part in zip(readings, parts, strict=True))


if __name__ == "__main__":
    main()
