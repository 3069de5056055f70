"""Extremes of scale, and the symmetries that hold at any: speeds, angles, masses, stiffnesses, sizes, exponents."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.physics.hertz import crossed_cylinders
from dem_bridge.runs.case import Case
from dem_bridge.scene import Wall
from dem_bridge.studies.extremes.entry import (
    BETA,
    FIXED_STEP,
    MASS,
    ONE_CONTACT,
    SPEED,
    Entry,
    chain,
    contact_time,
    plain,
    refused,
    theories_refuse,
)
from dem_bridge.studies.extremes.truths import (
    back_again,
    by_others,
    galilei,
    mirrored,
    scaled,
    shorter,
    two_bodies,
)
from dem_bridge.uncertainty.estimate import solve


def speeds() -> Iterator[Entry]:
    for speed in (1e-9, 1e-3, 1e3):
        pair = chain(f"pair-at-{plain(speed)}", bodies=2, speed=speed, samples=3)
        # ode45's absolute tolerance of 1e-6 m/s sees nothing of 1e-9 m/s; that no step of it is longer than a tenth of
        # the duration is what leaves a number, with a wide bar
        yield Entry(
            name=pair.name,
            asks=f"two bodies at {speed:g} m/s, beside the closed form",
            scene=pair,
            truths=(two_bodies(pair), by_others(pair)),
            expected={"adiabatic": ONE_CONTACT},
        )
        scene = chain(f"speed-{plain(speed)}", speed=speed)
        yield Entry(
            name=scene.name,
            asks=f"a chain struck at {speed:g} m/s: nothing but scales changes",
            scene=scene,
            truths=(by_others(scene), scaled(scene, speed)),
        )
    quick = chain("speed-32-times", speed=32 * SPEED)
    yield Entry(
        name=quick.name,
        asks="v0 -> 32 v0 and dt -> dt/2: powers of two throughout, fixed steps repeat themselves bit for bit",
        scene=quick,
        truths=(by_others(quick), scaled(quick, 32.0, to_the_bit=(FIXED_STEP,))),
    )


def angles() -> Iterator[Entry]:
    angle = np.geomspace(90.0, 0.001, 9)
    beta = [crossed_cylinders(angle=a, radius=9e-3, young=72e9, poisson=0.17).stiffness for a in angle.tolist()]
    for name, betas, way in (
        ("angles-90-to-0.001", beta, "stiffer and stiffer"),
        ("angles-0.001-to-90", beta[::-1], "softer and softer"),
    ):
        scene = chain(name, stiffness=betas)
        yield Entry(
            name=name,
            asks=f"contact angles over {beta[-1] / beta[0]:.0f} in stiffness, {way}",
            scene=scene,
            truths=(by_others(scene),),
        )


def ratios() -> Iterator[Entry]:
    heavy = chain("mass-heavy-striker", mass=[1e6 * MASS, *[MASS] * 4], times=3.0)
    light = chain("mass-light-striker", mass=[1e-6 * MASS, *[MASS] * 4], times=0.1)
    for scene, what in ((heavy, "a striker of 1e6 masses"), (light, "a striker of 1e-6 masses")):
        yield Entry(name=scene.name, asks=what, scene=scene, truths=(by_others(scene),))
    between = chain("mass-light-between", mass=[MASS, 1e-6 * MASS, MASS], times=0.3)
    yield Entry(
        name=between.name,
        asks="a body of 1e-6 masses between two, which meets them some hundred times",
        scene=between,
        truths=(by_others(between),),
        slow=True,
    )
    stiff = chain("stiffness-1e8", stiffness=[BETA, 1e8 * BETA, BETA], times=1.0)
    yield Entry(
        name=stiff.name,
        asks="one contact 1e8 times as stiff as the others",
        scene=stiff,
        truths=(by_others(stiff),),
        phase=0.05,
        slow=True,
    )


def sizes() -> Iterator[Entry]:
    pair = chain("bodies-2", bodies=2, samples=3)
    yield Entry(
        name=pair.name,
        asks="the least chain",
        scene=pair,
        truths=(two_bodies(pair), by_others(pair)),
        expected={"adiabatic": ONE_CONTACT},
    )
    row = chain("bodies-100000", bodies=100_000, times=12.0, samples=2)
    yield Entry(
        name=row.name,
        asks="1e5 bodies, and a front that has passed some thirty: it knows nothing of the others",
        scene=row,
        truths=(shorter(row, 200, own=False), shorter(row, 200)),
        phase=0.1,
        left_out={"scipy": "stopped unfinished after some 430 s: 1e5 unknowns at each of a hundred events"},
        slow=True,
    )


def exponents() -> Iterator[Entry]:
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
        yield Entry(
            name=scene.name, asks=f"n = {n:g}", scene=scene, truths=(by_others(scene), scaled(scene, 0.5)),
            expected=expected, dt=period / 200 if n < 2.0 else None,
        )  # fmt: skip


def symmetries() -> Iterator[Entry]:
    moving = theories_refuse("bodies behind the first that move")
    for u, name in ((-3.0, "galilei-backwards"), (768.0, "galilei-fast")):
        scene = chain(name, velocity=(SPEED + u, *[u] * 9))
        yield Entry(
            name=scene.name, asks=f"all move at {u:g} m/s besides: nothing else changes", scene=scene,
            truths=(by_others(scene), galilei(scene, u)), expected=moving,
        )  # fmt: skip
    beta = np.geomspace(BETA, 20 * BETA, 9).tolist()
    mirror = chain("mirror", stiffness=beta[::-1], velocity=(*[0.0] * 9, -SPEED), wall_left=Wall(stiffness=BETA))
    yield Entry(
        name=mirror.name, asks="a chain struck from its other end, on a wall", scene=mirror,
        truths=(by_others(mirror), mirrored(mirror)), expected=moving,
    )  # fmt: skip
    there = chain("there", stiffness=beta, times=4.0)
    forward = solve(
        Case(scene=there, backend="reference", resolution=Resolution(), sampling=Sampling(count=there.samples))
    )
    scene, truth = back_again(forward, there)
    scene = replace(scene, name="time-reversal")
    yield Entry(
        name=scene.name, asks="all velocities reversed at the end: back to the start", scene=scene,
        truths=(by_others(scene), truth), expected=moving,
    )  # fmt: skip
