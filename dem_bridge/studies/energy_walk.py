"""Long runs of a few beads between two walls: the energy after each contact, and the sum of the predicted jumps.

A run is made of pieces, each by the backend itself: a piece starts with the velocities and gaps with which the one
before it ends. Energies are read where all contacts are open, so that they are kinetic alone and no oscillation within
a contact is left in them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.base import Backend, Resolution, Sampling
from dem_bridge.backends.blanes_moan import SRKN_6B, BlanesMoan
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.backends.splitting import Method, solve_motion
from dem_bridge.backends.steps import fixed_step_plan
from dem_bridge.backends.twin import VERLET
from dem_bridge.backends.verlet import Verlet
from dem_bridge.physics.touch_error import touch_coefficients, touch_rms
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.trajectory.trajectory import Floats

#: the methods whose jumps are predicted
METHODS: Mapping[str, Method] = {"verlet": VERLET, "blanes-moan": SRKN_6B}
#: samples of a piece; at every step of a splitting method
ROWS = 50_000
#: s between the samples of an adaptive method: a tenth of a contact of the box
SPACING = 4e-6
GAP, STIFFNESS = 5e-5, 4e9
#: three beads of unequal masses, whose motion is chaotic: touches have random phases within the steps
BOX = Scene(
    name="three-beads",
    duration=1.0,
    mass=(0.010, 0.013, 0.017),
    stiffness=(STIFFNESS, STIFFNESS),
    velocity=(0.8, 0.1, -0.5),
    gap=(GAP, GAP),
    wall_left=Wall(stiffness=STIFFNESS, gap=GAP),
    wall_right=Wall(stiffness=STIFFNESS, gap=GAP),
)
#: one bead, whose touches follow each other regularly
BEAD = replace(BOX, name="one-bead", mass=(0.010,), stiffness=(), velocity=(0.8,), gap=(), exponent=2.5)


@dataclass(frozen=True, kw_only=True, eq=False)
class Walk:
    """Energy of a run at one moment after each contact, if there is one at which all contacts are open."""

    contacts: NDArray[np.int64]
    """Contacts that have closed since the start, ``(n,)``, ascending."""
    error: Floats
    """Energy relative to that of the start, minus 1, ``(n,)``."""
    predicted: Floats
    """Sum of the predicted jumps of all touches until then, relative, ``(n,)``; 0 where the method has none."""
    jump: float
    """Predicted root mean square of the change of energy by one contact, relative; nan where there is none."""
    evaluations: float
    """Evaluations of the forces per contact."""

    @property
    def unexplained(self) -> float:
        """Root mean square of the changes that the predicted jumps do not explain, relative to that of all changes."""
        change = np.diff(self.error)
        return float(np.sqrt(np.mean((change - np.diff(self.predicted)) ** 2) / np.mean(change**2)))

    def windows(self) -> NDArray[np.int64]:
        """Return numbers of contacts, each about twice the one before, of which the run has four or more in a row."""
        most = max(1, int(self.contacts[-1] - self.contacts[0]) // 4)
        return np.asarray(2 ** np.arange(int(np.log2(most)) + 1))

    def rms(self) -> Floats:
        """Return the root mean square of the changes of the relative energy in each of the windows."""
        places = np.searchsorted(self.contacts, np.arange(self.contacts[0], self.contacts[-1] + 1), side="right") - 1
        error = self.error[places]
        return np.array([np.sqrt(np.mean((error[window:] - error[:-window]) ** 2)) for window in self.windows()])


def long_run(
    code: Backend,
    scene: Scene,
    resolution: Resolution,
    contacts: int,
    progress: Callable[[float], None] = lambda part: None,
) -> Walk:
    """Run a scene until so many contacts have closed, or until the energy has changed by its own size."""
    method, spacing = METHODS.get(code.name), resolution.dt or SPACING
    start, closed, jumped, squares, evaluations = float(energy_of(scene, np.array([scene.velocity]))[0]), 0, 0.0, 0.0, 0
    piece, ended = replace(scene, duration=ROWS * spacing), False
    parts: list[tuple[NDArray[np.int64], Floats, Floats]] = []
    solve = _solver_of(code, piece, resolution)
    while not ended:
        velocity, displacement, evaluated = solve(piece)
        overlap = overlap_of(piece, displacement)
        closings, jump, square = read_touches(piece, velocity, overlap, spacing, method)
        number, path = closed + np.cumsum(closings), jumped + np.cumsum(jump)
        free = np.flatnonzero(~np.any(overlap > 0.0, axis=1))
        first = free[np.flatnonzero(np.diff(number[free].astype(float), prepend=closed if parts else -1) > 0)]
        error = energy_of(piece, velocity[first]) / start - 1.0
        within = slice(int(np.argmax(np.abs(error) > 1.0)) if np.any(np.abs(error) > 1.0) else None)
        parts.append((number[first][within], error[within], path[first][within] / start))
        closed, jumped, squares = int(number[-1]), float(path[-1]), squares + square
        evaluations += evaluated
        progress(min(1.0, closed / contacts))
        ended = closed >= contacts or within.stop is not None
        piece = continued(piece, velocity[-1], overlap[-1])
    numbers, errors, predicted = (np.concatenate(column) for column in zip(*parts, strict=True))
    rms = np.nan if method is None else touch_rms(*method) * float(np.sqrt(squares / closed)) / start
    return Walk(contacts=numbers, error=errors, predicted=predicted, jump=rms, evaluations=evaluations / closed)


def _solver_of(code: Backend, first: Scene, resolution: Resolution) -> Callable[[Scene], tuple[Floats, Floats, int]]:
    """Return a function that solves a piece: velocities, displacements, and the number of force evaluations.

    The splitting methods solve all pieces on the steps of the first, bit for bit as their backends do, without the
    prescan, the peaks and the checks of each piece.
    """
    sampling = Sampling(count=ROWS)
    if isinstance(code, Verlet | BlanesMoan):
        method, plan = METHODS[code.name], fixed_step_plan(first, resolution, sampling, prescan_scene(first))

        def solve_steps(piece: Scene) -> tuple[Floats, Floats, int]:
            motion = solve_motion(code, method, piece, plan)
            return motion.velocity, motion.displacement, len(method.drifts) * plan.steps + 1

        return solve_steps

    def solve_run(piece: Scene) -> tuple[Floats, Floats, int]:
        run = code.run(piece, resolution, sampling)
        return run.velocity, run.displacement, int(run.cost.force_evaluations or 0)

    return solve_run


def read_touches(
    scene: Scene, velocity: Floats, overlap: Floats, spacing: float, method: Method | None
) -> tuple[NDArray[np.int64], Floats, float]:
    """Return the closings up to each sample since the one before, the predicted jumps there (J), and a sum of squares.

    The sum is that of ``(stiffness (u spacing)^n)^2`` over all touches. A touch is between two samples of which one has
    the contact open: seen from there, forwards in time for a closing and backwards for an opening, the overlap grows at
    the closing rate u of that sample.
    """
    c, closed = scene.contacts, overlap > 0.0
    closings, jump, square = np.zeros(len(overlap), dtype=np.int64), np.zeros(len(overlap)), 0.0
    for sign, before, after in ((1.0, slice(None, -1), slice(1, None)), (-1.0, slice(1, None), slice(None, -1))):
        row, k = np.nonzero(~closed[before] & closed[after])
        if sign > 0.0:
            np.add.at(closings, row + 1, 1)
        if method is not None:
            outside = row + int(sign < 0.0)
            around = np.pad(velocity[outside], ((0, 0), (0, 1)))  # walls have the velocity 0
            touches = np.arange(len(outside))
            rate = around[touches, c.left[k]] - around[touches, c.right[k]]
            # a graze may turn within the step: it has no jump worth the name
            depth = np.maximum(sign * rate * spacing, 1e-300)
            phase, size = np.minimum(-overlap[outside, k] / depth, 1.0), c.stiffness[k] * depth ** c.exponent[k]
            coefficient = touch_coefficients(*method, exponent=float(c.exponent[0]), phase=phase)
            np.add.at(jump, row + 1, -sign * size * coefficient)
            square += float(np.sum(size**2))
    return closings, jump, square


def second_term(scene: Scene, velocity: Floats, overlap: Floats) -> Floats:
    """Return the term H_2 of the modified energy H + h^2 H_2 of velocity-Verlet, J/s^2, at each sample.

    It is ``v U'' v / 12 - |U'|^2 / (24 m)`` (Hairer, Lubich & Wanner 2006, section IX.3), with the tangent stiffness
    of the contacts and the net forces on the bodies.
    """
    c, pressed = scene.contacts, np.maximum(overlap, 0.0)
    force = c.stiffness * pressed ** (c.exponent - 1.0)
    tangent = (c.exponent - 1.0) * c.stiffness * pressed ** (c.exponent - 2.0)
    net = np.zeros((len(overlap), scene.n_body + 1))
    for k in range(scene.n_contact):
        net[:, c.left[k]] -= force[:, k]
        net[:, c.right[k]] += force[:, k]
    curvature = np.sum(tangent * _difference(scene, velocity) ** 2, axis=1)
    return np.asarray(curvature / 12.0 - np.sum(net[:, :-1] ** 2 / np.array(scene.mass), axis=1) / 24.0)


def energy_of(scene: Scene, velocity: Floats, overlap: Floats | None = None) -> Floats:
    """Return the energy at each sample, J; without overlaps the kinetic energy alone."""
    kinetic = 0.5 * np.sum(np.array(scene.mass) * velocity**2, axis=1)
    if overlap is None:
        return np.asarray(kinetic)
    c = scene.contacts
    return np.asarray(kinetic + np.sum(c.stiffness * np.maximum(overlap, 0.0) ** c.exponent / c.exponent, axis=1))


def overlap_of(scene: Scene, displacement: Floats) -> Floats:
    """Return the overlap of each contact at each sample, m, negative where it is open."""
    return _difference(scene, displacement) - scene.contacts.gap


def continued(scene: Scene, velocity: Floats, overlap: Floats) -> Scene:
    """Return the scene that starts with these velocities and overlaps."""
    gap, links = (-overlap).tolist(), len(scene.stiffness)
    left = None if scene.wall_left is None else replace(scene.wall_left, gap=gap[links])
    right = None if scene.wall_right is None else replace(scene.wall_right, gap=gap[-1])
    return replace(scene, velocity=tuple(velocity.tolist()), gap=tuple(gap[:links]), wall_left=left, wall_right=right)


def _difference(scene: Scene, values: Floats) -> Floats:
    """Return at each contact the value of the body on its left minus that on its right; walls have 0."""
    c, columns = scene.contacts, [*np.asarray(values).T, 0.0]
    # contiguous along time, along which all is vectorised
    return np.stack([columns[left] - columns[right] for left, right in zip(c.left, c.right, strict=True)]).T
