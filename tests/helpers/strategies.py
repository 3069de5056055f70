"""Draw random small scenes for property tests: sizes, masses, stiffnesses, exponents and speeds all vary."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from typing import Any

import hypothesis
from hypothesis import strategies as st

from dem_bridge.scene.scene import Damping, Scene, Wall

#: HYPOTHESIS_PROFILE=explore: other examples every time, and many more
EXPLORE = os.environ.get("HYPOTHESIS_PROFILE") == "explore"


def examples(count: int) -> hypothesis.settings:
    """Return the settings of a test that takes ``count`` examples, as many as its cost allows."""
    return hypothesis.settings(max_examples=20 * count if EXPLORE else count)


HERTZ = st.just(2.5)
#: exponents for which the reference has series: 2 (n - 1) is a whole number
HALVES = st.sampled_from([2.0, 2.5, 3.0, 3.5])
ANY = st.integers(1600, 3500).map(lambda n: n / 1000)

#: every scene lasts about three collisions of its bodies, so that contacts open and close in it
DURATION = 3e-4


def log_uniform(low: float, high: float) -> st.SearchStrategy[float]:
    """Draw positive numbers, evenly spread over their decades."""
    return st.floats(math.log(low), math.log(high)).map(math.exp)


def stiffness_for(exponent: float, hertz: float) -> float:
    """Return the stiffness that gives, at an overlap of 10 um, the force of a Hertz contact of stiffness ``hertz``."""
    return hertz * math.pow(1e-5, 2.5 - exponent)


@st.composite
def scenes(
    draw: st.DrawFn,
    *,
    bodies: tuple[int, int] = (2, 8),
    exponents: st.SearchStrategy[float] | tuple[float, float] = HERTZ,
    gaps: bool = True,
    walls: bool = False,
    gravity: bool = False,
    samples: int = 20,
) -> Scene:
    """Draw a chain whose first body (or every body) moves; exponents n out of ``exponents``, or between two."""
    n = draw(st.integers(*bodies))
    links = n - 1
    hertz = log_uniform(1e8, 5e10)
    of = st.floats(*exponents) if isinstance(exponents, tuple) else exponents
    exponent = tuple(draw(of) for _ in range(links))
    gap = st.sampled_from([0.0, 1e-6, 2e-5, -5e-7]) if gaps else st.just(0.0)
    pulse = draw(st.booleans())
    speeds = st.integers(-1000, 1000).map(lambda k: k / 1000)  # no speed is a millionth of another
    velocity = [draw(log_uniform(0.1, 2.0)), *[0.0] * links] if pulse else [draw(speeds) for _ in range(n)]

    def wall() -> Wall | None:
        if not walls or not draw(st.booleans()):
            return None
        return Wall(stiffness=draw(hertz), gap=draw(st.sampled_from([0.0, 1e-5])), exponent=2.5)

    return Scene(
        name="random",
        duration=DURATION,
        mass=tuple(draw(log_uniform(1e-3, 1e-1)) for _ in range(n)),
        stiffness=tuple(stiffness_for(e, draw(hertz)) for e in exponent),
        exponent=exponent,
        gap=tuple(draw(gap) for _ in range(links)),
        velocity=tuple(velocity),
        wall_left=wall(),
        wall_right=wall(),
        gravity=draw(st.sampled_from([0.0, 9.81, -500.0])) if gravity else 0.0,
        samples=samples,
    )


@st.composite
def damped_scenes(draw: st.DrawFn, /, **how: Any) -> Scene:
    """Draw :func:`scenes` with walls, weight, drag, and damping in some or all contacts."""
    scene = draw(scenes(walls=True, gravity=True, **how))
    sizes = {
        "dashpot": log_uniform(1e-1, 1e3),
        "mass_velocity": log_uniform(1e1, 1e5),
        "kuwabara-kono": log_uniform(1e-7, 1e-3),
        "coeff_restitution": st.floats(0.1, 0.99),
    }
    law = draw(st.sampled_from([*sizes]))
    coefficients = st.one_of(st.just(float(law == "coeff_restitution")), sizes[law])
    coefficient = tuple(draw(coefficients) for _ in range(scene.n_contact))
    damping = Damping(law=law, coefficient=coefficient, clip=draw(st.sampled_from([None, True, False])))
    return replace(scene, damping=damping, drag=draw(st.sampled_from([0.0, 0.0, 1e3])))


def thirty_two_times_as_fast(scene: Scene) -> Scene:
    """Return the same motion at v -> 32 v (Hertz): t -> t/2, x -> 16 x, F and g -> 64 times, all powers of two."""

    def scaled(wall: Wall | None) -> Wall | None:
        return None if wall is None else replace(wall, gap=16.0 * wall.gap)

    return replace(
        scene,
        velocity=tuple(32.0 * v for v in scene.velocity),
        gap=tuple(16.0 * gap for gap in scene.contacts.gap[: scene.n_body - 1].tolist()),
        wall_left=scaled(scene.wall_left),
        wall_right=scaled(scene.wall_right),
        gravity=64.0 * scene.gravity,
        duration=0.5 * scene.duration,
    )
