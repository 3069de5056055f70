"""The arithmetic of LAMMPS' precision modes: double is the positional twin, and single loses what it must."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dem_bridge.backends.precision import PRECISIONS, velocities_in
from dem_bridge.backends.twin import solve_plan
from dem_bridge.errors import UnsupportedScene
from dem_bridge.scene.scene import Damping, Scene, Wall
from dem_bridge.trajectory.dense import Schedule

CHAIN = Scene(
    name="chain",
    duration=2e-4,
    mass=(8e-3, 1e-2, 1.2e-2),
    stiffness=(4e9, 5e9),
    velocity=(0.8, 0.0, -0.1),
    gap=(1e-6, 0.0),
    gravity=9.81,
    wall_right=Wall(stiffness=4e9, gap=2e-6),
)
WALLS = replace(CHAIN, name="walls", wall_left=Wall(stiffness=6e9, gap=3e-6))
PLAN = Schedule(step=1e-7, per_sample=20, subdivisions=1, samples=100)
RADIUS = 9e-3


def _error(precision: str, radius: float, scene: Scene = CHAIN) -> float:
    return float(np.max(np.abs(velocities_in(precision, scene, PLAN, radius) - solve_plan(scene, PLAN).velocity)))


@pytest.mark.parametrize("scene", [CHAIN, WALLS, replace(CHAIN, wall_right=None)], ids=["right", "both", "none"])
@pytest.mark.parametrize("radius", [2.0**-15, RADIUS])
def test_double_precision_is_the_positional_twin_to_the_last_bit(scene: Scene, radius: float) -> None:
    assert np.array_equal(velocities_in("double", scene, PLAN, radius), solve_plan(scene, PLAN, radius).velocity)


@pytest.mark.parametrize("precision", [mode for mode in PRECISIONS if mode != "double"])
def test_each_mode_differs_from_double_precision_by_its_rounding(precision: str) -> None:
    # a rounding of the law, 2^-24, at least once; of a position of 0.054 m over an overlap of 1e-5 m, 3e-4
    least, most = {"force": (1e-9, 1e-6)}.get(precision, (1e-6, 1.0))
    assert least < _error(precision, RADIUS) < most


def test_a_law_in_single_precision_does_not_depend_on_the_radius_and_positions_do() -> None:
    law, mixed = ({radius: _error(mode, radius) for radius in (2.0**-15, RADIUS)} for mode in ("force", "mixed"))
    assert law[RADIUS] < 3.0 * law[2.0**-15]
    # the sizes of the positions differ by a factor of 300
    assert mixed[RADIUS] > 30.0 * mixed[2.0**-15]


def test_in_single_precision_a_body_stands_still_whose_step_is_below_half_a_digit_of_its_position() -> None:
    # body 1 flies to body 2, which is at 0.1 m, where single precision has a digit of 7e-9 m; a step is 3e-9 m
    flying = Scene(
        name="flying", duration=2e-3, mass=(1e-2,) * 3, stiffness=(4e9,) * 2, velocity=(0.0, 0.03, 0.0), gap=(0.0, 2e-5)
    )
    radius = 0.05
    still, moving = (velocities_in(mode, flying, PLAN_LONG, radius)[-1] for mode in ("single", "mixed"))
    assert still.tolist() == pytest.approx([0.0, 0.03, 0.0])
    assert moving[2] == pytest.approx(0.03, rel=1e-2)


PLAN_LONG = Schedule(step=1e-7, per_sample=200, subdivisions=1, samples=100)


def test_other_scenes_are_refused() -> None:
    damped = replace(CHAIN, damping=Damping(law="dashpot", coefficient=1.0))
    with pytest.raises(UnsupportedScene, match="precision of chain: the scene has dashpot damping"):
        velocities_in("single", damped, PLAN, RADIUS)
