"""Codes of methods that the judge does not repeat, judged from one file each: right ones, and ones with a fault."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.trajectory.trajectory import Floats

MASS, STIFFNESS = np.array([0.02, 0.024, 0.018, 0.03]), 7e9
SCENE = db.Scene(
    name="dashpots", duration=4e-4, mass=tuple(MASS), stiffness=(STIFFNESS,) * 3, velocity=(1.0, 0.0, 0.0, 0.0),
    damping=db.Damping(law="dashpot", coefficient=18.0),
)  # fmt: skip
DT, EVERY = 4e-7, 5


def acceleration(x: Floats, v: Floats, damping: float, mass: Floats) -> Floats:
    """Return the accelerations of spheres with dashpots whose force is clipped at zero."""
    depth = np.maximum(x[:-1] - x[1:], 0.0)
    force = np.where(depth > 0.0, STIFFNESS * depth**1.5 + damping * (v[:-1] - v[1:]), 0.0)
    force = np.maximum(force, 0.0)
    return np.asarray((np.append(0.0, force) - np.append(force, 0.0)) / mass)


def velocities(method: str, damping: float = 18.0, mass: Floats = MASS) -> Floats:
    """Return velocities by a method whose damping forces take predicted velocities, or by the trapezoid rule."""
    x, v = np.zeros(4), np.array(SCENE.velocity)
    a, rows = acceleration(x, v, damping, mass), [v]
    for step in range(round(SCENE.duration / DT)):
        x, before = x + DT * v + 0.5 * DT**2 * a, a
        a = acceleration(x, v + DT * a, damping, mass)
        if method == "corrected":
            a = acceleration(x, v + 0.5 * DT * (before + a), damping, mass)
        v = v + 0.5 * DT * (before + a)
        if (step + 1) % EVERY == 0:
            rows.append(v)
    return np.array(rows)


@pytest.mark.parametrize("method", ["predicted", "corrected"])
@pytest.mark.parametrize(
    ("fault", "cause"), [("", "none"), ("damping", "damping"), ("order", "order-of-bodies"), ("mass", "mass")]
)
def test_one_file_of_another_method_is_right_or_shows_its_fault(
    tmp_path: Path, method: str, fault: str, cause: str
) -> None:
    mass = MASS * np.where(np.arange(4) == 1, 0.95, 1.0) if fault == "mass" else MASS
    values = velocities(method, 14.0 if fault == "damping" else 18.0, mass)
    values = values[:, [0, 2, 1, 3]] if fault == "order" else values
    time = np.arange(len(values)) * EVERY * DT
    head = ",".join(["time_s", *(f"velocity_{k}_m_per_s" for k in range(4))])
    np.savetxt(tmp_path / "v.csv", np.column_stack([time, values]), delimiter=",", header=head, comments="")
    judgement = db.judge((tmp_path / "v.csv", DT), SCENE)
    assert (judgement.cause, judgement.outcome) == (cause, "PASS" if cause == "none" else "FAIL")
    if fault == "mass":
        assert judgement.where == "body 1"
