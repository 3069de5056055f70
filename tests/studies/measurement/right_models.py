"""Print how often right and wrong models pass the study of a measurement, for 1, 5, 20 and 40 uncertain parameters.

``python -m tests.studies.measurement.right_models [RIGHT [WRONG [COUNT...]]]``. Chains of spheres have one uncertain
stiffness for each contact (a common one for a single parameter), by 2 %. Arrivals and peak forces at all contacts are
measured with errors that are small beside those of the parameters, so that the covariance of the parameters decides.
The motion is that of a Runge-Kutta method here, which shares nothing with the package.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

import dem_bridge as db
from dem_bridge.observables.verdict import Outcome
from dem_bridge.scene.file.load import Measurement

Floats = NDArray[np.float64]
MASS, STIFFNESS, SPEED, SPREAD = 0.01, 6e9, 0.8, 0.02
#: standard uncertainties of arrivals, s, and of peak forces, N
ERRORS = 2e-8, 0.3


def scene_of(count: int) -> db.Scene:
    """Return a chain of ``count`` contacts, at least three, and then of a common parameter."""
    links = max(count, 3)
    speeds = (SPEED, *[0.0] * links)
    # the striker is heavier, so that the wave does not end before the last contact
    return db.Scene(
        name="row",
        duration=6e-5 + 2.9e-5 * links,
        mass=(2.0 * MASS, *[MASS] * links),
        stiffness=(STIFFNESS,) * links,
        velocity=speeds,
    )


def observe(scene: db.Scene, stiffness: Floats, exponent: float = 1.5, step: float = 2.5e-7) -> tuple[Floats, Floats]:
    """Return the times and sizes of the first maximum of each contact force, ``(n_model, n_contact)`` each."""
    mass = np.array(scene.mass)
    x = np.zeros((len(stiffness), scene.n_body))
    v = np.tile(np.array(scene.velocity), (len(stiffness), 1))

    def force(x: Floats) -> Floats:
        return np.asarray(stiffness * np.maximum(x[:, :-1] - x[:, 1:], 0.0) ** exponent)

    def acceleration(x: Floats) -> Floats:
        f = force(x)
        return np.asarray((np.pad(f, ((0, 0), (1, 0))) - np.pad(f, ((0, 0), (0, 1)))) / mass)

    series = [force(x)]
    for _ in range(round(scene.duration / step)):
        a1 = acceleration(x)
        v2 = v + 0.5 * step * a1
        a2 = acceleration(x + 0.5 * step * v)
        v3 = v + 0.5 * step * a2
        a3 = acceleration(x + 0.5 * step * v2)
        v4 = v + step * a3
        a4 = acceleration(x + step * v3)
        x = x + step / 6.0 * (v + 2.0 * (v2 + v3) + v4)
        v = v + step / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
        series.append(force(x))
    forces = np.stack(series)
    top = np.argmax((forces[1:-1] > forces[2:]) & (forces[1:-1] >= forces[:-2]), axis=0) + 1
    before, at, after = (np.take_along_axis(forces, (top + side)[None], axis=0)[0] for side in (-1, 0, 1))
    # the parabola through three samples, 1/200 of a contact apart
    offset = 0.5 * (before - after) / (before - 2.0 * at + after)
    return step * (top + offset), at - 0.25 * (before - after) * offset


def write(folder: Path, nth: int, arrival: Floats, peak: Floats, errors: tuple[float, float]) -> Path:
    """Write the values of one model, and return the file."""
    rows = ["body,contact,arrival_s,uncertainty_arrival_s,peak_force_N,uncertainty_peak_force_N"]
    rows += [f"{k + 1},,{time!r},{errors[0]!r},," for k, time in enumerate(arrival.tolist())]
    rows += [f",{k},,,{force!r},{errors[1]!r}" for k, force in enumerate(peak.tolist())]
    (folder / f"{nth}.csv").write_text("\n".join(rows))
    return folder / f"{nth}.csv"


def outcomes(count: int, models: int, kind: str = "right", seed: int = 0) -> Counter[tuple[Outcome, ...]]:
    """Return how often each pair of outcomes, of arrivals and of peak forces, was found by the study."""
    scene, random = scene_of(count), np.random.default_rng([seed, count])
    deviates = random.standard_normal((models, count))
    if kind == "shift":
        deviates[:, 0] += 3.0
    if kind == "spread":
        deviates *= 3.0
    factor = 1.0 + SPREAD * (deviates if count > 1 else np.repeat(deviates, scene.n_contact, axis=1))
    if kind == "common":
        factor *= 1.05
    exponent = 1.52 if kind == "exponent" else 1.5
    # the same force at 10 micrometres
    arrival, peak = observe(scene, STIFFNESS * factor * 1e-5 ** (1.5 - exponent), exponent)
    arrival = arrival + ERRORS[0] * random.standard_normal(arrival.shape)
    peak = peak + ERRORS[1] * random.standard_normal(peak.shape)
    found: Counter[tuple[Outcome, ...]] = Counter()
    name = "stiffness[*]" if count > 1 else "stiffness"
    with tempfile.TemporaryDirectory() as folder:
        for nth in range(models):
            file = write(Path(folder), nth, arrival[nth], peak[nth], ERRORS)
            measurement = Measurement(files=(file,), parameters={name: SPREAD}, fit=())
            study = db.study("measurement", scene, measurement=measurement, samples=10, seed=nth)
            found[tuple(verdict.outcome for verdict in study.verdicts)] += 1
    return found


def main(right: int = 400, wrong: int = 100, *counts: int) -> None:
    """Print the tables of docs/measurement.md."""
    for count in counts or (1, 5, 20, 40):
        for kind in ("right", *(("shift", "spread", "common", "exponent") if wrong else ())):
            models = right if kind == "right" else wrong
            found = outcomes(count, models, kind)
            for place, name in enumerate(("arrivals", "peak forces")):
                miss = sum(number for key, number in found.items() if key[place] is not Outcome.PASS)
                far = sum(number for key, number in found.items() if key[place] is Outcome.MODEL_DIFFERENCE)
                low, high = binomtest(miss, models).proportion_ci(0.95)
                print(
                    f"{count} parameters, {kind}, {name}: not PASS {miss} of {models}, {100 * miss / models:.1f} %"
                    f" ({100 * low:.1f} to {100 * high:.1f} %), of these MODEL_DIFFERENCE {far}",
                    flush=True,
                )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
