"""Error bars of fixed-step runs: time step by twins, round-off by the scene's measured conditioning.

The parts are measured apart, and never from the run that is judged: a wrong LAMMPS run must not widen its own bar.

*Time step.* The twin at the run's step and at another; their difference over ratio - 1, which bounds the error for any
observed order from 1 up and does not trust the order to be 2.

*Round-off.* Every step rounds positions of magnitude X by up to half a unit in the last place. As a random walk over
all steps this shifts an overlap of depth d by ``rho = ulp(X)/2 sqrt(steps) / d``; what a relative shift of the contacts
does to each quantity is measured with a twin whose masses and stiffnesses are moved by 1e-9.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.survey import Survey
from dem_bridge.dense import Schedule
from dem_bridge.scene import Scene, Wall
from dem_bridge.trajectory import Trajectory

QUANTITIES = ("velocity", "displacement", "peak_force", "crossing_time")
#: no bars at all
UNKNOWN = dict.fromkeys(QUANTITIES, math.inf)
#: relative size of the perturbation that measures the conditioning
_NUDGE = 1e-9


class Answer(Protocol):
    """What two runs are compared by: a Trajectory, or a run that will become one."""

    @property
    def velocity(self) -> NDArray[np.float64]: ...
    @property
    def displacement(self) -> NDArray[np.float64]: ...
    @property
    def peak_force(self) -> NDArray[np.float64]: ...
    @property
    def crossing_time(self) -> NDArray[np.float64]: ...


def nudged(scene: Scene, size: float = _NUDGE) -> Scene:
    """The scene with every mass and stiffness moved by a factor 1 + size or 1 - size, in a fixed random pattern."""
    signs = np.random.default_rng(20180305).choice((-size, size), scene.n_body + scene.n_contact)
    mass = np.array(scene.mass) * (1.0 + signs[: scene.n_body])
    links = len(scene.stiffness)
    stiffness = np.array(scene.stiffness) * (1.0 + signs[scene.n_body : scene.n_body + links])

    def moved(wall: Wall | None) -> Wall | None:
        return None if wall is None else replace(wall, stiffness=wall.stiffness * (1.0 + size))

    return replace(
        scene,
        mass=tuple(mass.tolist()),
        stiffness=tuple(stiffness.tolist()),
        wall_left=moved(scene.wall_left),
        wall_right=moved(scene.wall_right),
    )


def apart(one: Answer, other: Answer) -> dict[str, Any]:
    """Absolute difference of each quantity: max-norm for the sampled ones, per contact for the others.

    A crossing that one run has and the other has not leaves nothing to say (inf); one that neither has is agreed (0).
    """
    found: dict[str, Any] = {}
    for name in QUANTITIES:
        a, b = getattr(one, name), getattr(other, name)
        distance = np.abs(a - b)
        if name in ("velocity", "displacement"):
            found[name] = float(np.max(distance))
        else:
            lonely = np.where(np.isnan(distance), np.inf, distance)
            found[name] = np.where(np.isnan(a) & np.isnan(b), 0.0, lonely)
    return found


def relative_round_off(scene: Scene, look: Survey, steps: int, magnitude: float) -> float:
    """rho of the module's docstring; the depth is that of the contact whose force suffers most. ``magnitude`` in m."""
    depth = look.peak_overlap
    force = scene.contacts.stiffness * depth ** (scene.contacts.exponent - 1.0)
    touched = depth > 0.0
    if not np.any(touched):
        return 0.0
    shift = 0.5 * math.ulp(magnitude) * math.sqrt(steps)
    return shift * float(np.max(force[touched] / depth[touched]) / np.max(force))


def with_bars(
    run: Trajectory,
    *,
    scene: Scene,
    plan: Schedule,
    look: Survey,
    own: Trajectory,
    other: Trajectory,
    ratio: float,
    moved: Trajectory,
    magnitude: float,
) -> Trajectory:
    """``run`` with its bars.

    ``own`` and ``other``: twins at the step of ``run`` and at ``ratio`` times it (below 1: finer); ``moved``: the
    nudged scene on the steps of ``other``. ``magnitude`` (m): the largest that positions are rounded at.
    """
    step, condition = apart(own, other), apart(moved, other)
    # where the nudge decides whether a contact is hit at all (inf), no round-off is small
    rho = max(relative_round_off(scene, look, plan.steps, magnitude), math.ulp(0.0))
    # equal increments round alike: a displacement may be off by half a unit in the last place for every step
    drift = 0.5 * math.ulp(magnitude) * plan.steps
    bars: dict[str, NDArray[np.float64] | float] = {}
    for name in QUANTITIES:
        bars[name] = step[name] / abs(ratio - 1.0) + condition[name] / _NUDGE * rho
    bars["displacement"] += drift
    speed = float(np.max(np.abs(run.velocity)))
    parts = {
        "time_step": _relative(step["velocity"] / abs(ratio - 1.0), speed),
        "round_off": _relative(condition["velocity"] / _NUDGE * rho, speed),
        "condition": _relative(condition["velocity"] / _NUDGE, speed),
    }
    return replace(run, uncertainty=bars, provenance={**run.provenance, "velocity_bar": parts})


def _relative(value: float, scale: float) -> float:
    return value / scale if scale > 0.0 else 0.0
