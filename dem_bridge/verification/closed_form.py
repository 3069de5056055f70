"""Compare the runs of a single collision, of two bodies or of a body and a wall, with its closed form."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from dem_bridge.physics.exact import (
    TwoBodyCollision,
    dmt_impact,
    restitution_of_alpha,
    two_body_collision,
    viscoelastic_impact,
)
from dem_bridge.report.study import Table
from dem_bridge.report.texts import Texts
from dem_bridge.scene.features import DMT, DRAG, GAPS, NOT_CLIPPED, OTHER_EXPONENTS, SEVERAL_MOVING, WALLS
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.reference_choice import REFERENCE

TEXTS = Texts("closed-form", "dem_bridge.verification")
CLOSED_FORM_COLUMNS = (
    "scene", "quantity", "closed form", "reference", "reference - closed form", "LAMMPS", "LAMMPS - closed form",
)  # fmt: skip
#: features of a scene that a closed form allows for, beside damping
_ALLOWED = {WALLS, GAPS, OTHER_EXPONENTS, SEVERAL_MOVING, NOT_CLIPPED, DMT}


def closed_form(scene: Scene) -> TwoBodyCollision | None:
    """Return the closed form of a collision; None unless the scene is one and nothing else.

    A body and a wall on its left are solved as their mirror image; exit velocities are those of the scene. With damping
    only these have a closed form, with DMT adhesion also the largest overlap and force; other numbers are nan.

    Examples
    --------
    >>> from dem_bridge.scene.scene import Wall
    >>> pair = Scene(name="pair", duration=1e-4, mass=(1.0, 1.0), stiffness=(1e9,), velocity=(1.0, 0.0))
    >>> closed_form(pair).exit_velocity
    (0.0, 1.0)
    """
    others = {feature for feature in scene.features - _ALLOWED if feature is DRAG or not feature.dissipates}
    if scene.n_contact != 1 or scene.law is not None or others:
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
    undefined = dict.fromkeys(("peak_overlap", "peak_force", "half_time", "contact_time"), math.nan)
    speed = velocities[0] - velocities[1]
    if scene.adhesive:
        if scene.damped:
            return None
        beta, force = float(contacts.stiffness[0]), float(contacts.pull_off[0])
        mass = 1.0 / sum(1.0 / body for body in scene.mass)
        hit = dmt_impact(mass=mass, speed=speed, stiffness=beta, pull_off=force)
        numbers = undefined | {"peak_overlap": hit.peak_overlap, "peak_force": hit.peak_force}
        collision = TwoBodyCollision(**numbers, exit_velocity=collision.exit_velocity)
    elif scene.damped:
        restitution = closed_restitution(scene, speed)
        if restitution is None:
            return None
        impulse = 0.5 * (1.0 + restitution)  # over that of the elastic collision
        pairs = zip(velocities, collision.exit_velocity, strict=True)
        first, second = (before + impulse * (after - before) for before, after in pairs)
        collision = TwoBodyCollision(**undefined, exit_velocity=(first, second))
    first, second = collision.exit_velocity
    return replace(collision, exit_velocity=(sign * first, sign * second))


def closed_restitution(scene: Scene, speed: float) -> float | None:
    """Return the restitution of a scene of one contact with damping; None where no closed form exists.

    Parameters
    ----------
    scene : Scene
        Scene of two bodies, or of a body and a wall.
    speed : float
        Speed of approach, m/s.

    Examples
    --------
    >>> from dem_bridge.scene.scene import Damping
    >>> damping = Damping(law="coeff_restitution", coefficient=0.5, clip=True)
    >>> pair = Scene(
    ...     name="pair", duration=1e-4, mass=(1.0, 1.0), stiffness=(1e9,), velocity=(1.0, 0.0), damping=damping
    ... )
    >>> round(closed_restitution(pair, 1.0), 5)
    0.55028
    """
    contacts = scene.contacts
    factor, power, stiffness, n = (
        float(values[0]) for values in (contacts.damping, contacts.damping_power, contacts.stiffness, contacts.exponent)
    )
    mass = 1.0 / sum(1.0 / body for body in scene.mass)
    if 2.0 * power == n - 2.0:
        return restitution_of_alpha(factor / math.sqrt(mass * stiffness), clip=contacts.clip, exponent=n)
    if power != 0.5 or n != 2.5:
        return None
    try:
        hit = viscoelastic_impact(
            mass=mass, speed=speed, stiffness=stiffness, viscosity=factor / stiffness, clip=contacts.clip
        )
        return hit.restitution
    except ValueError:  # beyond the range of the series
        return None


def closed_form_table(studies: Sequence[SceneStudy]) -> Table | None:
    """Return the values of each collision by closed form, LAMMPS and reference; None without a collision."""
    rows = [row for study in studies for row in _rows(study)]
    return TEXTS.table("closed-form", CLOSED_FORM_COLUMNS, rows) if rows else None


def _rows(study: SceneStudy) -> Iterator[tuple[str | float, ...]]:
    exact = closed_form(study.scene)
    if exact is None:
        return
    runs = [study.run(name) for name in (REFERENCE, study.engine)]
    values = [[] if run is None else _values(study.scene, run) for run in runs]
    for nth, (name, value) in enumerate(_exact_values(study.scene, exact)):
        if math.isnan(value):
            continue
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
