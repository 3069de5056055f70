"""Causes that are seen without a fit of the motion: single precision, and another scene.

Contact forces conserve momentum at any time step, by any law and by every method whose forces are equal and opposite.
Velocities of all bodies therefore determine the ratios of the masses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dem_bridge.judging.fitting import TOLERANCE_OF_SEARCH, Block, Data
from dem_bridge.judging.hypotheses import Variant
from dem_bridge.judging.model import system_of
from dem_bridge.scene.file import load_scene
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.shipped import listed_scenes

Floats = NDArray[np.float64]

#: fewest different values of a body from which a grid is recognised
FEWEST_VALUES_OF_GRID = 20
#: part of a spacing of single precision that the digits of a file must resolve
LARGEST_ROUNDING_SHARE = 0.25
#: part of the values that are on a grid: those of the start may not have been rounded yet
LEAST_SHARE_ON_GRID = 0.95
#: powers of two that are tried as the spacing of positions, m
SPACINGS_TRIED_M = tuple(2.0**-k for k in range(18, 44))


def on_single_grid(data: Data) -> bool:
    """Return whether velocities or displacements are numbers of single precision, which the file's digits resolve.

    A code that keeps positions has displacements that are multiples of the spacing of single precision at a position,
    except those of a body that starts at the origin.
    """
    for block in data.blocks:
        columns = [_column(block, column) for column in range(block.values.shape[1])]
        moved = [(values, digits) for values, digits in columns if len(np.unique(values)) >= FEWEST_VALUES_OF_GRID]
        singles = [_are_singles(values, digits) for values, digits in moved]
        if singles and all(singles):
            return True
        if block.quantity == 1:
            grids = [_on_grid(values, digits) for values, digits in moved]
            if any(grids) and all(grid or single for grid, single in zip(grids, singles, strict=True)):
                return True
    return False


def _column(block: Block, column: int) -> tuple[Floats, Floats]:
    """Return the values of a body that are not 0, and their rounding errors by the digits of the file."""
    chosen = block.present[:, column] & (block.values[:, column] != 0.0)
    values = block.values[chosen, column]
    return values, np.maximum(block.rounding[chosen, column], 2.0**-52 * np.abs(values))


def _are_singles(values: Floats, digits: Floats) -> bool:
    """Return whether values are numbers of single precision: to all digits of a double, or to those of the file."""
    away = np.abs(values - values.astype(np.float32).astype(np.float64))
    half = 0.5 * np.spacing(np.abs(values).astype(np.float32)).astype(np.float64)
    exactly = away <= 2.0**-50 * np.abs(values)
    resolved = digits < LARGEST_ROUNDING_SHARE * half
    on_grid = exactly | (resolved & (away <= 1.1 * digits))
    return bool(np.mean(on_grid) > LEAST_SHARE_ON_GRID)


def _on_grid(values: Floats, digits: Floats) -> bool:
    """Return whether displacements are multiples of a power of two much larger than their digits."""
    least, most = float(np.max(digits)) / LARGEST_ROUNDING_SHARE, 0.01 * float(np.ptp(values))
    remainders = (np.abs(values - q * np.rint(values / q)) for q in SPACINGS_TRIED_M if least < q < most)
    return any(np.mean(remainder <= 1.1 * digits) > LEAST_SHARE_ON_GRID for remainder in remainders)


#: change of momentum, in units of the noise of the velocities, that their digits explain
LARGEST_MOMENTUM_NOISES = 3.0
#: the next combination of masses changes so many times more: else they are not determined
LEAST_MULTIPLE_OF_NEXT = 30.0
#: bodies with other masses from which the scene is another one, and the least relative difference
FEWEST_OTHER_MASSES, LEAST_DIFFERENCE_OF_MASS = 3, 1e-3
#: largest relative difference of masses that are those of the scene in another order
LARGEST_DIFFERENCE_OF_REORDERED = 0.005
#: part of the difference from the scene that a shipped scene leaves, and its largest error relative to the scale
LARGEST_SHARE_OF_OTHER_SCENE, LARGEST_ERROR_OF_OTHER_SCENE = 0.1, 0.05
#: relative difference of a stiffness, by which half of the contacts of quite another chain differ at least
LEAST_DIFFERENCE_OF_STIFFNESS = 0.1


@dataclass(frozen=True, eq=False)
class OtherMasses:
    """The masses of a file relative to those of its scene, ``(n_body,)``, in the median 1; nan: not determined."""

    ratio: Floats
    out_of_order: int
    """Number of masses that differ from those of the scene in any order: 0 where bodies are in another order."""

    @property
    def differing(self) -> list[int]:
        """Bodies with another mass."""
        return np.flatnonzero(np.abs(self.ratio - 1.0) > LEAST_DIFFERENCE_OF_MASS).tolist()

    def words(self) -> str:
        """Return the three largest differences in words."""
        worst = sorted(self.differing, key=lambda body: -abs(np.log(self.ratio[body])))[:3]
        return ", ".join(f"{self.ratio[body]:.4g} (body {body})" for body in sorted(worst))


def other_masses(scene: Scene, data: Data) -> OtherMasses | None:
    """Return the masses that conserve the momentum of a file; None if those of the scene do, or if none are determined.

    Velocities of all bodies are needed, and a scene without forces from outside but gravity.
    """
    outside = (scene.wall_left, scene.wall_right, scene.drive)
    block = next((block for block in data.blocks if block.quantity == 0), None)
    if block is None or any(part is not None for part in outside) or scene.drag or scene.precompression:
        return None
    if sorted(block.columns) != list(range(scene.n_body)) or not np.all(block.present):
        return None
    mass = np.array(scene.mass)[block.columns]
    change = (block.values - scene.gravity * data.time[:, None])[1:] - block.values[0]
    noise = np.sqrt(2.0 * np.sum((block.sigma[1:] * mass) ** 2, axis=1))[:, None]
    moved = np.max(np.abs(change), axis=0) > 1e-6 * block.scale
    weighted = change[:, moved] * mass[moved] / noise
    if (
        np.sqrt(np.mean(np.sum(weighted, axis=1) ** 2)) < LARGEST_MOMENTUM_NOISES
        or np.count_nonzero(moved) < FEWEST_OTHER_MASSES
    ):
        return None
    _, sizes, combinations = np.linalg.svd(weighted, full_matrices=False)
    least, ratio = sizes / np.sqrt(len(weighted)), combinations[-1] * np.sqrt(len(combinations))
    if (
        len(sizes) < len(ratio)
        or least[-1] > LARGEST_MOMENTUM_NOISES
        or least[-2] < LEAST_MULTIPLE_OF_NEXT * max(least[-1], 1.0)
    ):
        return None
    ratio = ratio / np.median(ratio)
    if np.any(ratio <= 0.0):
        return None
    whole = np.full(scene.n_body, np.nan)
    whole[block.columns[moved]] = ratio
    order = np.sort(ratio * mass[moved]) / np.sort(mass[moved])
    apart = np.abs(order / np.median(order) - 1.0) > LARGEST_DIFFERENCE_OF_REORDERED
    return OtherMasses(whole, int(np.count_nonzero(apart)))


@dataclass(frozen=True)
class ShippedScene:
    """The shipped scene that a file is of, and its largest error relative to the scale of a quantity."""

    name: str
    error: float
    differs_widely: bool
    """True if many stiffnesses differ by different factors from those of the scene, and no exponent does."""


def shipped_scene(scene: Scene, data: Data, error: float) -> ShippedScene | None:
    """Return the shipped scene that a file is of; None if it is none of them.

    ``error`` is that of the scene itself, relative to the scale of a quantity.
    """
    best: ShippedScene | None = None
    least = min(LARGEST_ERROR_OF_OTHER_SCENE, LARGEST_SHARE_OF_OTHER_SCENE * error)
    # only scenes of as many bodies are read: all of them take half a second
    for name in (listed.name for listed in listed_scenes() if listed.n_body == scene.n_body):
        other = load_scene(name)
        if other.law is not None or other.content_hash == scene.content_hash:
            continue
        motion = Variant(system_of(other))
        # what begins otherwise does not need its whole motion
        for rows in (-(-len(data.time) // 64), -(-len(data.time) // 8), len(data.time)):
            size = float(np.max(data.errors(data.predict(motion, rows, TOLERANCE_OF_SEARCH))))
            if not size < least:
                break
        else:
            best, least = ShippedScene(name, size, _differs_widely(scene, other)), size
    return best


def _differs_widely(scene: Scene, other: Scene) -> bool:
    """Return whether half of all stiffnesses differ by different factors, which no hypothesis changes."""
    if scene.exponent != other.exponent:
        return False
    ratio = np.array(other.stiffness) / np.array(scene.stiffness)
    differing = np.abs(ratio / np.median(ratio) - 1.0) > LEAST_DIFFERENCE_OF_STIFFNESS
    return 2 * int(np.count_nonzero(differing)) > len(ratio)
