"""Measure the numbers behind statements of the documentation by means of numpy and scipy alone.

Condition numbers of traces (docs/theory/order.md), the restitution with few steps in a contact
(docs/howto/restitution.md), both forms of Nesterenko's formula (docs/theory/collisions.md), and what the exact law of
stiffness changes in the paper's chains (README.md). It imports nothing of ``dem_bridge``, and solves chains as
``recompute_claims.py`` beside it does. ``python -m tests.studies.energy.doubling`` has the energy of ode45.

Run it with ``python reports/independent/measure_statements.py [FILE]`` (default: ``statements.json`` beside it); it
takes 5 s.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from recompute_claims import (
    Chain,
    Floats,
    angle_of,
    integrate,
    paper_chain,
    paper_stiffness,
    ratio_of_curvatures,
    stiffness_of_ratio,
    struck,
)
from scipy.optimize import brentq

#: speed of the solitary wave of the discrete chain, found without a time step: in the units of its force and velocity
BY_FORCE, BY_VELOCITY = 0.905515776419, 0.907470078412
#: steps in an elastic contact, wanted restitutions, and places of the touch in a step
STEPS, WANTED, PLACES = (10, 100), (0.1, 0.3, 0.5, 0.7, 0.9), 10


def condition_numbers(chain: Chain) -> tuple[float, float, float, float]:
    """Return the largest derivatives of a velocity by ln v0 and ln beta over 3 ms, at all times and at 500 samples.

    dv/d ln v0 = v + t a/5 and dv/d ln beta = 2 t a/5, over the largest velocity.
    """
    run = integrate([chain], 3.0e-3, 1e-7, 1)[0]
    time, largest = run.time[:, None], float(np.max(np.abs(run.v)))
    speed, stiffness = np.abs(run.v + 0.2 * time * run.a), np.abs(0.4 * time * run.a)
    every = slice(None, None, 60)
    return (
        float(speed.max() / largest),
        float(stiffness.max() / largest),
        float(speed[every].max() / largest),
        float(stiffness[every].max() / largest),
    )


def exact_stiffness(chain: Chain) -> Floats:
    """Return the stiffnesses of a chain's cylinders by the exact Hertz law at the angles that eq. 3.1 gives them."""

    def exact(beta: float) -> float:
        angle = angle_of(beta)
        if angle == 90.0:
            return paper_stiffness(90.0)
        cosine = np.cos(np.radians(angle))
        return stiffness_of_ratio(angle, ratio_of_curvatures((1.0 + cosine) / (1.0 - cosine)))

    return np.r_[chain.stiffness[0], [exact(float(beta)) for beta in chain.stiffness[1:]]]


def speed_changes(chain: Chain) -> tuple[float, float]:
    """Return by how much the exact law changes the wave speed: at cylinder 1, and at most from cylinder 5 to 37."""
    runs = integrate([chain, struck(chain.mass, exact_stiffness(chain))], 1.6e-3, 1e-7, 4)
    paper, exact = (np.r_[np.nan, np.diff(run.crossing[0])] for run in runs)
    change = paper / exact - 1.0
    return float(change[1]), float(np.max(np.abs(change[5:38])))


def rebound(alpha: float, steps: int, place: float) -> float:
    """Return the restitution of F = d^(3/2) + alpha d^(1/4) d' by velocity-Verlet with half-step velocities in forces.

    Mass, stiffness and speed are 1, an elastic contact has ``steps`` steps, and the touch falls at a part ``place`` of
    a step. Unclipped: the contact ends at d = 0.
    """
    depth = 1.25**0.4
    step = 2.943275184325 * depth / steps
    overlap, rate, force = -place * step, 1.0, 0.0
    while overlap > 0.0 or rate > 0.0:
        half = rate - 0.5 * step * force
        overlap += step * half
        pressed = max(overlap, 0.0)
        force = pressed**1.5 + alpha * pressed**0.25 * half if pressed else 0.0
        rate = half - 0.5 * step * force
    return -rate


def restitution_errors(steps: int) -> Iterator[float]:
    """Yield the errors of the restitution over :data:`WANTED` and :data:`PLACES`.

    e = exp(-pi alpha / sqrt(5 - alpha^2)) (Antypov & Elliott 2011).
    """
    for wanted in WANTED:
        alpha = float(brentq(lambda a, e=wanted: -np.pi * a / np.sqrt(5.0 - a * a) - np.log(e), 0.0, 2.236))
        for place in range(PLACES):
            yield rebound(alpha, steps, place / PLACES) - wanted


def main(file: Path) -> None:
    """Print all numbers and write them to a file."""
    numbers: dict[str, float] = {}
    for name, rising in (("decelerating-40", False), ("accelerating-40", True)):
        chain = paper_chain(rising=rising)
        labels = ("d ln v0", "d ln beta", "d ln v0 at 500 samples", "d ln beta at 500 samples")
        numbers |= {f"{label}, {name}": value for label, value in zip(labels, condition_numbers(chain), strict=True)}
        first, inner = speed_changes(chain)
        numbers |= {f"exact law, speed at cylinder 1, {name}": first, f"exact law, largest from 5 to 37, {name}": inner}
    for steps in STEPS:
        errors = list(restitution_errors(steps))
        numbers[f"largest error of e with {steps} steps"] = max(map(abs, errors))
        numbers[f"error of e = 0.5 with {steps} steps, touch on a step"] = errors[WANTED.index(0.5) * PLACES]
    # c = (2/sqrt 5) (beta/m)^(1/2) d^(1/4) with d = (F/beta)^(2/3), or with d = v/c
    front = 2.0 / np.sqrt(5.0)
    numbers["Nesterenko, force form over the exact wave, less 1"] = float(front / BY_FORCE - 1.0)
    numbers["Nesterenko, velocity form over the exact wave, less 1"] = float(front**0.8 / BY_VELOCITY - 1.0)
    for name, value in numbers.items():
        print(f"{name}: {value:.5g}")
    file.write_text(json.dumps({"schema": "statements/1", "numbers": numbers}, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("statements.json"))
