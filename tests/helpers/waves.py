"""Provide trajectories with known pulses, made without integration, and chains for tests of observables."""

from __future__ import annotations

import math

import numpy as np

from dem_bridge.physics.solitary import SolitaryWave, solitary_wave
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory, Uncertainty
from tests.helpers.fake_runs import NO_COST, NO_ERROR

#: kg: a cylinder of quartz, r = 9 mm, 18 mm high
CYLINDER = 2200.0 * math.pi * 9e-3**2 * 18e-3
#: N/m^1.5: at 2 and at 90 degrees by the paper's formula
STIFFEST, SOFTEST = 7.27299328384e10, 4.689197642511e9


def travelling_wave(
    *,
    bodies: int = 40,
    per_residence: float = 8.0,
    mass: float = 0.01,
    stiffness: float = 4e9,
    exponent: float = 2.5,
    peak_velocity: float = 0.5,
    uncertainty: Uncertainty = NO_ERROR,
) -> tuple[Scene, Trajectory, SolitaryWave]:
    """Return the exact solitary wave through a uniform chain, which it enters from the left and leaves on the right.

    ``per_residence`` samples while it goes from body to body. Nothing holds for body 0, which a contact outside drives.
    """
    wave = solitary_wave(mass=mass, stiffness=stiffness, exponent=exponent, peak_velocity=peak_velocity)
    reach = math.ceil(wave.shape.half_length)
    way = bodies + 2 * reach
    samples = math.ceil(way * per_residence)
    duration = samples / per_residence / wave.speed
    scene = Scene(
        name="wave",
        duration=duration,
        mass=(mass,) * bodies,
        stiffness=(stiffness,) * (bodies - 1),
        velocity=(0.0,) * bodies,
        exponent=exponent,
        spacing=18e-3,
        samples=samples,
    )
    time = np.linspace(0.0, duration, samples + 1)
    contact = np.arange(bodies - 1.0)
    centre = wave.speed * time[:, None] - reach
    # a body is where the overlaps ahead of it, to beyond the chain's end, have let it go
    ahead = wave.overlap(centre - np.arange(bodies + 2.0 * reach))
    displacement = np.cumsum(ahead[:, ::-1], axis=1)[:, ::-1][:, :bodies]
    run = Trajectory(
        time=time,
        displacement=displacement,
        velocity=wave.velocity(centre - np.arange(bodies) + 0.5),
        contact_force=wave.force(centre - contact),
        peak_force=np.full(bodies - 1, wave.peak_force),
        crossing_time=(contact + reach) / wave.speed,
        uncertainty=uncertainty,
        cost=NO_COST,
        provenance={"backend": "fake"},
    )
    return scene, run, wave


def uniform_chain(bodies: int = 100, *, samples: int = 1000) -> Scene:
    """Return a uniform chain struck by its first body; the wave is at the last body within the duration."""
    return Scene(
        name="uniform",
        duration=1.6e-5 * bodies,
        mass=(CYLINDER,) * bodies,
        stiffness=(2e10,) * (bodies - 1),
        velocity=(0.8, *[0.0] * (bodies - 1)),
        spacing=18e-3,
        samples=samples,
    )


def long_chain(direction: str, *, samples: int = 1000) -> Scene:
    """Return the paper's chain of 200 cylinders, linear in stiffness, struck by one more."""
    beta = np.linspace(STIFFEST, SOFTEST, 199)
    if direction == "accelerating":
        beta = beta[::-1]
    return Scene(
        name=f"{direction}-200",
        duration=4e-3,
        mass=(CYLINDER,) * 201,
        stiffness=(float(beta[0]), *beta.tolist()),
        velocity=(0.8, *[0.0] * 200),
        spacing=18e-3,
        samples=samples,
    )


def tapered_chain(ratio: float, *, spheres: int = 40, samples: int = 1000) -> Scene:
    """Return spheres of quartz, each ``ratio`` times as wide as the one before, the first of 9 mm, struck alike."""
    radius = 9e-3 * ratio ** np.arange(spheres)
    radius = np.concatenate([radius[:1], radius])
    modulus, common = 72e9 / (2.0 * (1.0 - 0.17**2)), radius[1:] * radius[:-1] / (radius[1:] + radius[:-1])
    beta = 4.0 / 3.0 * modulus * np.sqrt(common)
    return Scene(
        name="tapered",
        duration=0.7e-3 if ratio < 1.0 else 1.8e-3,
        mass=tuple((2200.0 * 4.0 / 3.0 * math.pi * radius**3).tolist()),
        stiffness=tuple(beta.tolist()),
        velocity=(0.8, *[0.0] * spheres),
        samples=samples,
    )
