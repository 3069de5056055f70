"""Compare the runs of a single collision, of two bodies or of a body and a wall, with its closed form."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from dem_bridge.physics.exact import TwoBodyCollision, two_body_collision
from dem_bridge.scene import Scene
from dem_bridge.studies.study import Table
from dem_bridge.studies.texts import Texts
from dem_bridge.trajectory import Trajectory
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.roles import REFERENCE

TEXTS = Texts("closed-form")
#: features of a scene that a closed form allows for
_ALLOWED = {"walls", "gaps"}


def closed_form(scene: Scene) -> TwoBodyCollision | None:
    """Return the closed form of an elastic collision; None unless the scene is one and nothing else.

    A body and a wall on its left are solved as their mirror image; exit velocities are those of the scene.

    Examples
    --------
    >>> from dem_bridge.scene import Wall
    >>> pair = Scene(name="pair", duration=1e-4, mass=(1.0, 1.0), stiffness=(1e9,), velocity=(1.0, 0.0))
    >>> closed_form(pair).exit_velocity
    (0.0, 1.0)
    """
    if scene.n_contact != 1 or scene.law is not None or {item.label for item in scene.features} - _ALLOWED:
        return None
    contacts, sign = scene.contacts, -1.0 if scene.wall_left is not None else 1.0
    with_wall = scene.n_body == 1
    masses = (scene.mass[0], math.inf if with_wall else scene.mass[1])
    velocities = (sign * scene.velocity[0], 0.0 if with_wall else scene.velocity[1])
    if not velocities[0] > velocities[1]:
        return None
    collision = two_body_collision(
        masses=masses,
        velocities=velocities,
        stiffness=float(contacts.stiffness[0]),
        exponent=float(contacts.exponent[0]),
    )
    first, second = collision.exit_velocity
    return replace(collision, exit_velocity=(sign * first, sign * second))


def closed_form_table(studies: Sequence[SceneStudy]) -> Table | None:
    """Return the values of each collision by closed form, LAMMPS and reference; None without a collision."""
    rows = [row for study in studies for row in _rows(study)]
    return TEXTS.table("closed-form", rows) if rows else None


def _rows(study: SceneStudy) -> Iterator[tuple[str | float, ...]]:
    exact = closed_form(study.scene)
    if exact is None:
        return
    runs = [study.run(name) for name in (REFERENCE, study.engine)]
    values = [[] if run is None else _values(study.scene, run) for run in runs]
    for nth, (name, value) in enumerate(_exact_values(study.scene, exact)):
        row: list[str | float] = [study.scene.name, name, value]
        for of_run in values:
            row += [of_run[nth], of_run[nth] - value] if of_run else [math.nan, math.nan]
        yield tuple(row)


def _exact_values(scene: Scene, exact: TwoBodyCollision) -> list[tuple[str, float]]:
    """Return the names and values of the closed form, in SI."""
    speeds = exact.exit_velocity[: scene.n_body]
    closing = abs(scene.velocity[0] - (scene.velocity[1] if scene.n_body == 2 else 0.0))
    touch = float(scene.contacts.gap[0]) / closing
    names = [f"velocity of body {k} at the end (m/s)" for k in range(scene.n_body)]
    return [
        ("largest force (N)", exact.peak_force),
        ("time of largest force (s)", touch + exact.half_time),
        *zip(names, speeds, strict=True),
    ]


def _values(scene: Scene, run: Trajectory) -> list[float]:
    """Return the same values of a run."""
    speeds = np.asarray(run.velocity[-1], dtype=float)
    return [float(run.peak_force[0]), float(run.crossing_time[0]), *speeds.tolist()]
