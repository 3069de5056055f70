"""The limit of stability of chains, beside LAMMPS below and above it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.errors import RunBroken
from dem_bridge.judging.step import stability_limit
from dem_bridge.observables.modes import highest_frequencies
from dem_bridge.scene.timescales import contact_time_of
from tests.helpers.checked_decks import CONTACT, MASS, RADIUS, STIFFNESS

CHAINS = 20


def chain(number: int) -> db.Scene:
    """Return a chain of random masses, stiffnesses and start velocity; some have gaps, some equal bodies."""
    rng = np.random.default_rng(number)
    n = int(rng.integers(3, 16))
    mass = MASS * 10 ** (rng.uniform(-0.5, 0.5, n) if number % 2 else np.zeros(n))
    stiffness = STIFFNESS * math.sqrt(RADIUS / 2) * 10 ** (rng.uniform(-0.5, 0.5, n - 1) * (number % 3 > 0))
    gap = np.where(rng.random(n - 1) < 0.3, 1e-5, 0.0) * (number % 4 == 0)
    velocity = np.zeros(n)
    velocity[0] = 10 ** rng.uniform(-1, 1)
    scene = db.Scene(
        name="chain", duration=CONTACT, mass=tuple(mass), stiffness=tuple(stiffness), gap=tuple(gap),
        velocity=tuple(velocity),
    )  # fmt: skip
    contact = contact_time_of(scene)
    assert contact is not None
    return replace(scene, duration=(1.2 * n + 4) * contact * (3 if gap.any() else 1))


def limits(scene: db.Scene) -> tuple[float, float, float]:
    """Return the limit of stability and 2/omega of one contact alone and of the highest mode, s."""
    run = db.solve(scene, backend="reference", samples=2000, uncertainty=False)
    contact, mode = highest_frequencies(scene, run)
    return stability_limit(scene, run.displacement, run.velocity, scene.duration, contact), 2 / contact, 2 / mode


def gain(scene: db.Scene, dt: float) -> float:
    """Return the largest kinetic energy of LAMMPS with a step, over that of the start; inf if it loses bodies."""
    steps = math.ceil(scene.duration / dt)
    scene = replace(scene, duration=steps * dt, samples=steps)
    try:
        run = db.solve(scene, backend="lammps-granular", dt=dt, uncertainty=False)
    except RunBroken:
        return math.inf
    energy = run.velocity**2 @ np.array(scene.mass)
    return float(np.max(energy) / energy[0])


@pytest.mark.lammps
def test_lammps_is_stable_below_the_limit_and_not_above_it() -> None:
    below, above = [], []
    for number in range(CHAINS):
        scene = chain(number)
        limit, contact, mode = limits(scene)
        assert 0.8 * mode < limit <= mode * (1 + 1e-9)
        assert contact >= mode * (1 - 1e-9)
        below.append(gain(scene, 0.95 * limit))
        above.append(gain(scene, 1.2 * limit))
    assert max(below) < 2.0  # no body is lost below it
    assert sum(value > 2.0 for value in above) >= 0.8 * CHAINS  # above it bodies are lost, or energy comes from nothing


@pytest.mark.lammps
def test_a_body_between_two_contacts_has_the_stiffness_of_both() -> None:
    n = 10
    scene = db.Scene(
        name="equal", duration=14 * CONTACT, mass=(MASS,) * n,
        stiffness=(STIFFNESS * math.sqrt(RADIUS / 2),) * (n - 1), velocity=(0.5, *[0.0] * (n - 1)),
    )  # fmt: skip
    limit, contact, _ = limits(scene)
    assert limit < 0.9 * contact
    # the usual estimate, of one contact alone, is no limit of this chain
    assert gain(scene, 0.95 * limit) < 2.0 < gain(scene, 0.99 * contact)


def test_chains_without_a_contact_or_a_mode_have_no_limit() -> None:
    scene = db.Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    still = np.zeros((1, 2))
    assert math.isnan(stability_limit(scene, still, still, 1e-4, 0.0))
