"""Provide trajectories of random numbers of all sizes, on a scene's bodies, for formats that must keep every digit."""

from __future__ import annotations

import math

import numpy as np

from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory, Uncertainty
from tests.helpers.fake_runs import NO_COST

#: of each run; enough for a lost one to be seen
SAMPLES = 12
NAMES = ("time", "displacement", "velocity", "contact_force")


def made_up(scene: Scene, *, seed: int = 1, forces: bool = True) -> Trajectory:
    """Return a run that starts as the scene does and is random then, over twelve decades; no body passes another."""
    rng = np.random.default_rng(seed)

    def numbers(width: int, largest: float) -> np.ndarray:
        size = (SAMPLES + 1, width)
        return largest * rng.choice([-1.0, 1.0], size) * rng.random(size) * 10.0 ** -rng.integers(0, 12, size)

    displacement, velocity = numbers(scene.n_body, 1e-4), numbers(scene.n_body, 2.0)
    displacement[0], velocity[0] = 0.0, scene.velocity
    force = np.abs(numbers(scene.n_contact, 1e3)) if forces else np.full((SAMPLES + 1, scene.n_contact), math.nan)
    return Trajectory(
        time=np.linspace(0.0, scene.duration, SAMPLES + 1),
        displacement=displacement,
        velocity=velocity,
        contact_force=force,
        peak_force=np.max(force, axis=0),
        crossing_time=rng.random(scene.n_contact) * scene.duration,
        uncertainty=Uncertainty(velocity=1e-9, displacement=1e-12, peak_force=1e-6, crossing_time=1e-9),
        cost=NO_COST,
        provenance={"backend": "made up", "scene": scene.name, "scene_hash": scene.content_hash},
    )


def foreign_dump(
    scene: Scene, run: Trajectory, *, number: str = ".17g", place: float = 0.018, walls: bool = False
) -> str:
    """Return the run as LAMMPS dumps it: ids from 1, in no order, net forces, no column of ours."""
    first = walls and scene.wall_left is not None
    last = walls and scene.wall_right is not None
    links = scene.n_body - 1
    none = np.zeros((len(run.time), 1))
    left = run.contact_force[:, [links]] if scene.wall_left is not None else none
    right = run.contact_force[:, [-1]] if scene.wall_right is not None else none
    force = np.hstack([left, run.contact_force[:, :links], right])
    net = force[:, :-1] - force[:, 1:] + np.array(scene.mass) * scene.gravity + scene.load
    if scene.drive is not None:
        net[:, 0] += scene.drive.at(run.time)
    x = place * np.arange(scene.n_body) + run.displacement
    columns = [x, run.velocity, net]
    if first:
        columns = [np.hstack([column, more]) for column, more in zip((none - place, none, -left), columns, strict=True)]
    if last:
        end = none + place * scene.n_body
        columns = [np.hstack([more, column]) for column, more in zip((end, none, right), columns, strict=True)]
    lines = ["ITEM: UNITS", "si"]
    rng = np.random.default_rng(3)
    for k, time in enumerate(run.time.tolist()):
        atoms = columns[0].shape[1]
        lines += ["ITEM: TIME", f"{time:.17g}", "ITEM: TIMESTEP", str(100 * k), "ITEM: NUMBER OF ATOMS", str(atoms)]
        lines += ["ITEM: BOX BOUNDS ff ff ff", "-1 1", "-1 1", "-1 1", "ITEM: ATOMS id type x y z vx fx"]
        for i in rng.permutation(atoms).tolist():
            px, vx, fx = (format(column[k, i], number) for column in columns)
            lines.append(f"{i + 1} 1 {px} 0 0 {vx} {fx}")
    return "\n".join(lines) + "\n"
