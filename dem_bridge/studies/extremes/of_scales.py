"""Extremes of scale, and the symmetries that hold at any: speeds, angles, masses, stiffnesses, sizes, exponents."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.physics.hertz import crossed_cylinders
from dem_bridge.runs.case import Case
from dem_bridge.scene import Wall
from dem_bridge.studies.extremes.entry import (
    BETA,
    FIXED_STEP,
    MASS,
    SPEED,
    Entry,
    chain,
    contact_time,
    entry,
    plain,
    refused,
    theories_refuse,
)
from dem_bridge.studies.extremes.truths import back_again, by_others, galilei, mirrored, scaled, shorter, two_bodies
from dem_bridge.uncertainty.estimate import solve

#: the adiabatic wave needs more than two bodies
ONE_CONTACT = {"adiabatic": refused("the number of contacts is 1")}


def speeds() -> Iterator[Entry]:
    """Yield slow and fast impacts."""
    for speed in (1e-9, 1e-3, 1e3):
        pair = chain(f"pair-at-{plain(speed)}", bodies=2, speed=speed, samples=3)
        # ode45's absolute tolerance of 1e-6 m/s sees nothing of 1e-9 m/s; that no step of it is longer than a tenth of
        # the duration is what leaves a number, with a wide bar
        asks = f"two bodies at {speed:g} m/s, beside the closed form"
        yield entry(pair, asks, two_bodies, by_others, expected=ONE_CONTACT)
        asks = f"a chain struck at {speed:g} m/s: nothing but scales changes"
        yield entry(chain(f"speed-{plain(speed)}", speed=speed), asks, by_others, partial(scaled, factor=speed))
    asks = "v0 -> 32 v0 and dt -> dt/2: powers of two throughout, fixed steps repeat themselves bit for bit"
    same = partial(scaled, factor=32.0, to_the_bit=(FIXED_STEP,))
    yield entry(chain("speed-32-times", speed=32 * SPEED), asks, by_others, same)


def angles() -> Iterator[Entry]:
    """Yield contact angles over five decades."""
    angle = np.geomspace(90.0, 0.001, 9)
    beta = [crossed_cylinders(angle=a, radius=9e-3, young=72e9, poisson=0.17).stiffness for a in angle.tolist()]
    for name, betas, way in (
        ("angles-90-to-0.001", beta, "stiffer and stiffer"),
        ("angles-0.001-to-90", beta[::-1], "softer and softer"),
    ):
        asks = f"contact angles over {beta[-1] / beta[0]:.0f} in stiffness, {way}"
        yield entry(chain(name, stiffness=betas), asks)


def ratios() -> Iterator[Entry]:
    """Yield large ratios of masses and of stiffnesses."""
    yield entry(chain("mass-heavy-striker", mass=[1e6 * MASS, *[MASS] * 4], times=3.0), "a striker of 1e6 masses")
    yield entry(chain("mass-light-striker", mass=[1e-6 * MASS, *[MASS] * 4], times=0.1), "a striker of 1e-6 masses")
    asks = "a body of 1e-6 masses between two, which meets them some hundred times"
    yield entry(chain("mass-light-between", mass=[MASS, 1e-6 * MASS, MASS], times=0.3), asks, slow=True)
    stiff = chain("stiffness-1e8", stiffness=[BETA, 1e8 * BETA, BETA], times=1.0)
    yield entry(stiff, "one contact 1e8 times as stiff as the others", phase=0.05, slow=True)


def sizes() -> Iterator[Entry]:
    """Yield the shortest chain and a very long one."""
    pair = chain("bodies-2", bodies=2, samples=3)
    yield entry(pair, "the least chain", two_bodies, by_others, expected=ONE_CONTACT)
    yield entry(
        chain("bodies-100000", bodies=100_000, times=12.0, samples=2),
        "1e5 bodies, and a front that has passed some thirty: it knows nothing of the others",
        partial(shorter, bodies=200, by_itself=False),
        partial(shorter, bodies=200),
        phase=0.1,
        left_out={"scipy": "stopped unfinished after some 430 s: 1e5 unknowns at each of a hundred events"},
        slow=True,
    )


def exponents() -> Iterator[Entry]:
    """Yield exponents other than Hertz'."""
    for n in (1.5, 2.0, 2.0001, 2.001, 5.0, 6.0):
        # the force of a Hertz contact at 10 um
        beta = BETA * 1e-5 ** (2.5 - n)
        # below n = 2 contacts are the stiffer the less deep they are: there is no highest frequency to take a step from
        period = contact_time(stiffness=beta, exponent=n)
        scene = chain(f"n-{n:g}", exponent=n, stiffness=beta, duration=5.0 * period)
        expected = {}
        if n != 2.0:
            expected["lammps-granular"] = refused("allowed exponents: 2 and 2.5")
        if not 2.0 <= n <= 5.0:
            expected["lammps-table"] = refused("allowed exponents: 2 to 5")
        if n < 2.1:
            # no steady pulse, and near n = 2 it is too wide to form
            expected["adiabatic"] = refused("allowed exponents: 2.1 to 50")
        dt = period / 200 if n < 2.0 else None
        yield entry(scene, f"n = {n:g}", by_others, partial(scaled, factor=0.5), expected=expected, dt=dt)


def symmetries() -> Iterator[Entry]:
    """Yield scenes that must move as others do."""
    moving = theories_refuse("bodies behind the first that move")
    for u, name in ((-3.0, "galilei-backwards"), (768.0, "galilei-fast")):
        scene = chain(name, velocity=(SPEED + u, *[u] * 9))
        asks = f"all move at {u:g} m/s besides: nothing else changes"
        yield entry(scene, asks, by_others, partial(galilei, speed=u), expected=moving)
    beta = np.geomspace(BETA, 20 * BETA, 9).tolist()
    mirror = chain("mirror", stiffness=beta[::-1], velocity=(*[0.0] * 9, -SPEED), wall_left=Wall(stiffness=BETA))
    yield entry(mirror, "a chain struck from its other end, on a wall", by_others, mirrored, expected=moving)
    there = chain("there", stiffness=beta, times=4.0)
    sampling = Sampling(count=there.samples)
    forward = solve(Case(scene=there, backend="reference", resolution=Resolution(), sampling=sampling))
    scene, truth = back_again(forward, there)
    scene = replace(scene, name="time-reversal")
    asks = "all velocities reversed at the end: back to the start"
    yield entry(scene, asks, by_others, lambda scene: truth, expected=moving)
