"""Convert scene files in raw form, and what all forms have in common."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from dem_bridge.scene.file.body_forms import CylinderScene, PatternScene, SphereScene
from dem_bridge.scene.file.forms import RawScene, WallTable
from dem_bridge.scene.geometry import Body
from dem_bridge.scene.scene import Scene, Wall


def effective_radii(bodies: Sequence[Body], walls: tuple[bool, bool]) -> list[float] | None:
    """Return the effective radii of all contacts, m, those of the left and the right wall last; None if not spheres."""
    if not bodies or any(body.shape != "sphere" for body in bodies):
        return None
    radii = [body.radius for body in bodies]
    links = [1.0 / (1.0 / first + 1.0 / second) for first, second in pairwise(radii)]
    return links + [radius for radius, wall in zip((radii[0], radii[-1]), walls, strict=True) if wall]


def in_common(
    file: RawScene | CylinderScene | SphereScene | PatternScene, bodies: Sequence[Body] = ()
) -> dict[str, Any]:
    """Return the arguments of a Scene that all forms share; ``bodies`` if they are known."""
    chain, damping = file.chain, file.chain.damping
    radii = effective_radii(bodies, (chain.wall_left is not None, chain.wall_right is not None))

    def wall(table: WallTable | None) -> Wall | None:
        return None if table is None else Wall(stiffness=table.stiffness, gap=table.gap, exponent=table.exponent)

    return {
        "name": file.name,
        "description": file.description,
        "duration": file.duration,
        "wall_left": wall(chain.wall_left),
        "wall_right": wall(chain.wall_right),
        "precompression": 0.0 if chain.precompression is None else chain.precompression.force,
        "damping": None if damping is None else damping.damping(),
        "adhesion": None if chain.adhesion is None else chain.adhesion.adhesion(radii),
        "drive": None if chain.drive is None else chain.drive.drive(file.duration),
        "samples": file.sampling.count,
        **file.environment.model_dump(),
    }


def from_raw(file: RawScene) -> Scene:
    """Return the Scene of a file in raw form."""
    shared = in_common(file)
    return Scene(**file.chain.model_dump(exclude=set(shared)), **shared)
