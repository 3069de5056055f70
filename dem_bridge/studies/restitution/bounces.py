"""Heights of a bouncing sphere: the soft sphere's distance from a hard one, and the error of a code, told apart.

The scene is MFiX DEM-02. A hard sphere rises to ``e^2`` of its last height. A soft one rises less high, because gravity
acts during the contact; its heights are exact by :func:`~dem_bridge.physics.stages.linear_drop`. The difference of a
code from these is its numerical error.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dem_bridge.backends.base import ENGINE_BACKENDS, Resolution, Sampling
from dem_bridge.lmp.engine import Engine
from dem_bridge.observables.verdict import Outcome, judge_relative
from dem_bridge.physics.impact import bounce_heights
from dem_bridge.physics.stages import linear_drop
from dem_bridge.runs.campaign import Result
from dem_bridge.runs.case import Case
from dem_bridge.scene.file import load_scene
from dem_bridge.scene.scene import Scene

SCENE = "mfix-dem-02"
#: stiffness of the plane, N/m
STIFFNESS = (5e4, 5e5, 5e6)
#: time steps in a contact, and samples of the run: heights are read at the sample next to each summit
STEPS, SAMPLES = 200, 1500
#: round-off of the closed form: matrix exponentials and roots, relative
ROUND_OFF = 1e-13


@dataclass(frozen=True, kw_only=True)
class Bounce:
    """Height after one bounce, by one code."""

    backend: str
    stiffness: float
    """N/m."""
    number: int
    """From 1."""
    hard: float
    """Height of the hard sphere, m."""
    soft: float
    """Height of the soft sphere, m."""
    height: float
    """Height by the code, m."""
    uncertainty: float
    """Estimated numerical error of it, m."""

    @property
    def softness(self) -> float:
        """Soft sphere less hard sphere, relative to the hard one."""
        return self.soft / self.hard - 1.0

    @property
    def error(self) -> float:
        """Code less soft sphere, m."""
        return self.height - self.soft

    @property
    def outcome(self) -> Outcome:
        """PASS if the code has the height of the soft sphere within its uncertainty."""
        return judge_relative(abs(self.error) / self.soft, ROUND_OFF, self.uncertainty / self.soft)


def bouncing_scenes() -> list[Scene]:
    """Return the scene with each stiffness of the plane."""
    scene = load_scene(SCENE)
    assert scene.wall_right is not None
    return [replace(scene, wall_right=replace(scene.wall_right, stiffness=stiffness)) for stiffness in STIFFNESS]


def bounce_cases(backends: Sequence[str], engine: Engine | None) -> list[Case]:
    """Return the cases of all scenes and codes."""
    return [
        Case(
            scene=scene,
            backend=backend,
            resolution=Resolution(dt=math.pi * math.sqrt(scene.mass[0] / scene.contacts.stiffness[0]) / STEPS),
            sampling=Sampling(count=SAMPLES),
            engine=engine if backend in ENGINE_BACKENDS else None,
        )
        for scene in bouncing_scenes()
        for backend in backends
    ]


def soft_summits(scene: Scene) -> Iterator[tuple[float, float]]:
    """Yield the time (s) and the height (m) of each summit of the soft sphere within the duration of the scene."""
    gap, gravity = float(scene.contacts.gap[0]), scene.gravity
    height, time = gap, 0.0  # of the last summit
    while True:
        drop = linear_drop(
            mass=scene.mass[0],
            stiffness=float(scene.contacts.stiffness[0]),
            damping=float(scene.contacts.damping[0]),
            height=height,
            gravity=gravity,
        )
        time += drop.touch_time + drop.contact_time + drop.exit_speed / gravity
        height = drop.rebound_height
        if not time <= scene.duration:
            return
        yield time, height


def bounces_of(scene: Scene, result: Result) -> Iterator[Bounce]:
    """Yield the bounces of a run of the scene: heights follow from position and velocity in free flight."""
    run = result.trajectory
    assert scene.damping is not None
    assert not isinstance(scene.damping.coefficient, float)
    summits = list(soft_summits(scene))
    gap, gravity = float(scene.contacts.gap[0]), scene.gravity
    hard = bounce_heights(height=gap, restitution=scene.damping.coefficient[0], bounces=len(summits))
    for number, (time, soft) in enumerate(summits):
        height = uncertainty = math.nan
        if run is not None:
            at = int(np.argmin(np.abs(run.time - time)))
            speed = abs(float(run.velocity[at, 0]))
            height = gap - float(run.displacement[at, 0]) + 0.5 * speed**2 / gravity
            uncertainty = run.uncertainty.displacement + speed * run.uncertainty.velocity / gravity
        yield Bounce(
            backend=result.case.backend,
            stiffness=float(scene.contacts.stiffness[0]),
            number=number + 1,
            hard=hard[number],
            soft=soft,
            height=height,
            uncertainty=uncertainty,
        )
