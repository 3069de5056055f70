"""The kernels for powers of the overlap: bit for bit what the general ones answer, and left where they do not serve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dem_bridge.judging import kernels, plain_kernels
from dem_bridge.judging.model import Model
from dem_bridge.scene.drive import Drive
from dem_bridge.scene.scene import Damping, Scene, Wall
from tests.judging.test_kernels import CHAIN, SCENES
from tests.judging.test_motion import LINE

SPHERES = 23
SPEEDS = tuple(np.random.default_rng(5).uniform(-0.5, 0.5, SPHERES).tolist())
#: of more bodies than fit into a vector of any processor, and with each thing that the loops treat by itself
PLAIN = {
    "walls and gaps": CHAIN,
    "gravity and drag": replace(CHAIN, gravity=-50.0, drag=300.0),
    "a front": LINE,
    "all move": Scene(
        name="all", duration=3e-4, mass=tuple(np.linspace(4e-3, 9e-3, SPHERES).tolist()), velocity=SPEEDS,
        stiffness=tuple(np.linspace(2e9, 9e9, SPHERES - 1).tolist()), wall_right=Wall(stiffness=5e9),
    ),
    "overlaps at the start": replace(CHAIN, gap=(-1e-6, -2e-6), velocity=(0.0, 0.0, 0.0)),
    "exponents": SCENES["exponents"],
    "one exponent of a front": replace(LINE, exponent=2.4),
    "an exponent of Hooke among Hertz's": replace(CHAIN, exponent=(2.0, 2.5), gravity=-50.0, drag=300.0),
    "a force that hardly rises with the overlap": replace(CHAIN, exponent=1.1, wall_left=None, wall_right=None),
}  # fmt: skip


@pytest.mark.parametrize("name", PLAIN)
def test_motions_are_bit_for_bit_those_of_the_general_kernels(name: str) -> None:
    scene = PLAIN[name]
    model, times = Model(scene), np.linspace(0.0, scene.duration, 14)
    line = plain_kernels.line_of(model.system)
    assert line is not None
    steps = np.array([0, 1, 2, 3, 11, 40, 130])
    for method in plain_kernels.METHODS:
        expected = kernels.fixed(model.system, steps, 1e-6, method, model.speed)
        for values, others in zip(
            vars(model.stepped(model.system, steps, 1e-6, method)).values(), expected, strict=True
        ):
            assert np.array_equal(values, others)
    for tolerance in (1e-9, 1e-13):
        expected = kernels.adaptive(model.system, times, model.speed, tolerance, *model._pair)[:4]
        for values, others in zip(vars(model.exact(model.system, times, tolerance)).values(), expected, strict=True):
            assert np.array_equal(values, others)


@pytest.mark.parametrize(
    "scene",
    [
        *(SCENES[name] for name in ("dashpot", "kuwabara-kono", "adhesion")),
        replace(CHAIN, drive=Drive(shape="sine", force=1.0, frequency=1e4)),
    ],
    ids=lambda scene: ",".join(sorted(feature.label for feature in scene.features)),
)
def test_chains_with_anything_else_are_left_to_the_general_kernels(scene: Scene) -> None:
    assert plain_kernels.line_of(Model(scene).system) is None
    assert plain_kernels.line_of(Model(CHAIN).system._replace(pulls=True)) is None
    undamped = replace(scene, damping=Damping(law="dashpot", coefficient=0.0)) if scene.damping else CHAIN
    assert plain_kernels.line_of(Model(undamped).system) is not None


def test_a_motion_without_numbers_ends_as_nan_and_not_in_an_endless_loop() -> None:
    model = Model(CHAIN)
    broken = model.system._replace(stiffness=np.full(4, np.inf))
    with np.errstate(all="ignore"):
        motion = model.exact(broken, np.array([0.0, 1e-4]), 1e-10)
    assert np.all(motion.displacement[0] == 0.0)
    assert np.all(np.isnan(motion.velocity[1]))
