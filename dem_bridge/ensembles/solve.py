"""Chains of one form solved in groups of lanes, and the number of steps that an accuracy takes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.blanes_moan import SRKN_6B
from dem_bridge.backends.prescan import prescan_hertz
from dem_bridge.backends.scales import natural_scales, resting_acceleration
from dem_bridge.ensembles.damped import POWERS, march_damped
from dem_bridge.ensembles.draw import Chains
from dem_bridge.ensembles.lanes import jacobi_rules, march
from dem_bridge.ensembles.within_step import LANES
from dem_bridge.errors import RunBroken, UnsupportedScene, UsageError
from dem_bridge.physics.statics import static_forces
from dem_bridge.scene import features
from dem_bridge.scene.damping import damping_factors
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.support import Support
from dem_bridge.trajectory.relative import own_scale, relative_size
from dem_bridge.trajectory.trajectory import Floats

#: scenes whose chains can be solved in lanes
LANED = Support(
    {features.WALLS, features.GAPS, features.INITIAL_OVERLAPS, features.SEVERAL_MOVING}
    | {features.OTHER_EXPONENTS, features.GRADED_EXPONENTS, features.GRAVITY, features.PRECOMPRESSION}
    | {features.DASHPOT, features.MASS_VELOCITY, features.KUWABARA_KONO, features.COEFF_RESTITUTION, features.TSUJI}
    | {features.NOT_CLIPPED, features.DRAG},
    instead="a study of single runs",
)
#: observables of an ensemble and their axes, by their names in :data:`~dem_bridge.observables.registry.OBSERVABLES`
OBSERVABLES: Mapping[str, str] = {
    "arrival_at_end": "",
    "crossing_time": "contact",
    "residence_time": "body",
    "peak_velocity": "body",
    "peak_force": "contact",
}
#: the first step that is tried, of 1/omega of the stiffest contact, and the factor between steps that are tried
_FIRST_PHASE, _FACTOR = 1.0, math.sqrt(2.0)
#: the error of a run is at most its difference from one at 1/sqrt(2) of the step, times this: of order 2 or more, 2;
#: where a step meets each touch is chance, and single runs lie up to three times above the mean
_SAFETY = 6.0
#: the same for velocities at samples, whose scale is the largest velocity and not each one's own
_SAFETY_OF_SAMPLES = 3.0
#: least closing rate at which a touch is corrected, of the speed of the chain
SLOWEST_TOUCH = 1e-6
#: least maximal overlap that counts in a damped chain, of the natural one
LEAST_COMPRESSION = 1e-7
#: most steps of a chain
MOST_STEPS = 1_000_000


def check_solvable(scene: Scene) -> None:
    """Raise UnsupportedScene if chains of this scene cannot be solved in lanes."""
    if reason := LANED.unsupported_reason(scene):
        raise UnsupportedScene(f"an ensemble of {scene.name} cannot be solved: {reason}")


def solve_chains(scene: Scene, chains: Chains, steps: int, samples: int = 0) -> dict[str, Floats]:
    """Return the observables of chains, one row for each: see :data:`OBSERVABLES`.

    Parameters
    ----------
    scene : Scene
        What all chains have in common: duration, exponents, walls, gravity, precompression.
    chains : Chains
    steps : int
        Steps of each chain.
    samples : int
        With a divisor of ``steps`` the velocities at the start and at the ends of so many equal intervals are returned
        as "velocity", ``(n_chain, samples + 1, n_body)``.

    Raises
    ------
    RunBroken
        If a velocity is not finite, because the step is too long.
    """
    n, line, groups = scene.n_body, _line(scene), -(-len(chains) // LANES)
    # where fewer chains are left the last of them is repeated
    group = chains.rows(np.minimum(np.arange(LANES * groups), len(chains) - 1))

    def lanes(values: Floats) -> Floats:
        """Return ``(n_group, n_place, n_lane)`` of the values of all chains at each place."""
        return np.ascontiguousarray(values.reshape(groups, LANES, -1).swapaxes(1, 2))

    def bodies(values: Floats, rest: float) -> Floats:
        return lanes(np.pad(values, ((0, 0), (1, 1)), constant_values=rest))

    def contacts(values: Floats) -> Floats:
        out = np.zeros((len(group), n + 1))
        out[:, line] = values
        return lanes(out)

    gap = group.gap if scene.precompression == 0.0 else -_static_overlaps(scene, group)
    weight = group.mass * scene.gravity + np.asarray(scene.load)
    power, of_overlap = np.full(n + 1, 2.5), np.zeros(n + 1)
    power[line] = scene.contacts.exponent
    law = 0 if np.all(power[line] == 2.5) else 1 if np.all(power[line] == 2.0) else 2
    mass, velocity, weight = bodies(group.mass, math.inf), bodies(group.velocity, 0.0), bodies(weight, 0.0)
    stiffness, overlap = contacts(group.stiffness), contacts(-gap)
    resting = contacts(resting_acceleration(scene))[0]
    unfelt = contacts(LEAST_COMPRESSION * natural_scales(scene)[1])[0]
    damped, clip = scene.damped, scene.contacts.clip
    of_chains, of_overlap[line] = _damping(scene, group)
    damping, distinct = contacts(of_chains), set(of_overlap[line].tolist())
    of_damping = POWERS.index(distinct.pop()) if len(distinct) == 1 and distinct <= set(POWERS) else len(POWERS)
    rules, slow, drifts, kicks = jacobi_rules(power), SLOWEST_TOUCH * _speed(scene), SRKN_6B.drifts, SRKN_6B.kicks
    kept = np.empty((len(group), samples + 1 if samples else 0, n))
    read = np.empty((3, groups, n + 1, LANES))
    for nth in range(groups):
        rows = kept[LANES * nth : LANES * (nth + 1)]
        moving = mass[nth], velocity[nth], weight[nth], stiffness[nth], overlap[nth]
        step = scene.duration / steps
        if damped:
            result = march_damped(
                *moving, damping[nth], power, of_overlap, (law, of_damping), clip, scene.drag, resting, slow, unfelt,
                step, steps, rows,
            )  # fmt: skip
        else:
            result = march(*moving, power, law, resting, rules, slow, drifts, kicks, step, steps, scene.drag, rows)
        read[:, nth] = np.reshape(result, (3, n + 1, LANES))
    crossing, peak, fastest = read.swapaxes(2, 3).reshape(3, len(group), n + 1)[:, : len(chains)]
    if not np.all(np.isfinite(fastest[:, 1:])):
        raise RunBroken(f"{scene.name}: a velocity is not finite at {steps} steps; give a smaller accuracy")
    values = _observables(crossing[:, line], peak[:, line], fastest[:, 1:])
    return values | ({"velocity": kept[: len(chains)]} if samples else {})


def _damping(scene: Scene, chains: Chains) -> tuple[Floats, Floats]:
    """Return the factor of the damping force of each contact ``(n_chain, n_contact)``, and its power of the overlap."""
    c, mobility = scene.contacts, np.pad(1.0 / chains.mass, ((0, 0), (0, 1)))
    if scene.damping is None:
        return np.zeros_like(chains.stiffness), np.zeros(scene.n_contact)
    effective = 1.0 / (mobility[:, c.left] + mobility[:, c.right])
    factor, power = damping_factors(scene.damping, effective, chains.stiffness, c.exponent)
    return np.broadcast_to(factor, chains.stiffness.shape), power


def _line(scene: Scene) -> NDArray[np.int64]:
    """Return the place of each contact, walls last, on the line: contact k is between places k and k + 1."""
    n = scene.n_body
    line = np.arange(1, n) if scene.wall_left is None else np.append(np.arange(1, n), 0)
    return line if scene.wall_right is None else np.append(line, n)


def _observables(crossing: Floats, peak: Floats, fastest: Floats) -> dict[str, Floats]:
    """Return the observables of chains from what their contacts and bodies had, one row for each chain."""
    n = fastest.shape[1]
    arrival = np.pad(crossing[:, : n - 1], ((0, 0), (1, 0)), constant_values=np.nan)
    reached = np.where(np.arange(n) == 0, True, ~np.isnan(arrival))
    return {
        "arrival_at_end": arrival[:, -1],
        "crossing_time": crossing,
        "residence_time": np.pad(np.diff(arrival), ((0, 0), (0, 1)), constant_values=np.nan),
        "peak_velocity": np.where(reached & (fastest > 0.0), fastest, np.nan),
        "peak_force": peak,
    }


def _speed(scene: Scene) -> float:
    """Return the speed of the whole chain if all its energy at the start were in one motion, m/s."""
    c, mass = scene.contacts, np.array(scene.mass)
    stored = np.sum(c.stiffness / c.exponent * np.maximum(-c.gap, 0.0) ** c.exponent)
    return math.sqrt((np.sum(mass * np.array(scene.velocity) ** 2) + 2.0 * float(stored)) / np.sum(mass))


def _static_overlaps(scene: Scene, chains: Chains) -> Floats:
    """Return the overlaps by which the contacts of precompressed chains carry their forces, m, as ``chains.gap``."""
    left, right = scene.wall_left is not None, scene.wall_right is not None
    distinct, row = np.unique(chains.mass, axis=0, return_inverse=True)
    force = partial(static_forces, force=scene.precompression, gravity=scene.gravity, wall_left=left, wall_right=right)
    forces = np.array([force(mass.tolist()) for mass in distinct])
    columns = [*range(1, scene.n_body), *([0] if left else []), *([scene.n_body] if right else [])]
    carried = forces[row.reshape(-1)][:, columns]
    return np.asarray((carried / chains.stiffness) ** (1.0 / (scene.contacts.exponent - 1.0)))


def difference(values: Floats, reference: Floats) -> Floats:
    """Return each chain's largest difference of an observable, relative to each value's own scale, ``(n_chain,)``.

    The scale is the value itself, or a thousandth of the chain's largest where that is more. A value that only one of
    the two has counts as inf.
    """
    reference, values = (item.reshape(len(item), -1) for item in (reference, values))
    scale = np.array([own_scale(row) for row in reference])
    missing = np.isnan(values) != np.isnan(reference)
    off = relative_size(np.abs(values - reference), scale)
    return np.asarray(
        np.max(np.where(missing, np.inf, np.nan_to_num(off, nan=0.0, posinf=np.inf)), axis=1, initial=0.0)
    )


def steps_for(scene: Scene, chains: Chains, accuracy: float, samples: int | None = None) -> int:
    """Return the steps of a chain by which all observables of the ``chains`` have the accuracy.

    Each trial is compared with one of 1.41 times the steps. With ``samples`` the velocities at all samples count, too,
    relative to the largest, and the steps are a multiple of ``samples``.

    Raises
    ------
    UsageError
        If even the largest number of steps does not give the accuracy.
    """
    frequency = prescan_hertz(scene).frequency
    every = samples or 1
    trial = max(8.0, scene.duration * frequency / _FIRST_PHASE) / _FACTOR
    before: tuple[int, dict[str, Floats]] | None = None
    steps = 0
    while trial < MOST_STEPS:
        trial = max(trial * _FACTOR, steps + 1.0)
        steps = every * max(1, math.ceil(trial / every))
        try:
            values = solve_chains(scene, chains, steps, samples or 0)
        except RunBroken:
            continue
        if before is not None and _error(before[1], values) <= accuracy:
            return before[0]
        before = steps, values
    raise UsageError(
        f"{scene.name}: accuracy = {accuracy:g} needs more than {MOST_STEPS:g} steps; give a larger accuracy"
    )


def _error(values: Mapping[str, Floats], finer: Mapping[str, Floats]) -> float:
    """Return the estimated relative error of the values, the largest of all observables and chains."""
    off = max(float(np.max(difference(values[name], finer[name]), initial=0.0)) for name in OBSERVABLES)
    if "velocity" not in values:
        return _SAFETY * off
    largest = np.max(np.abs(finer["velocity"]), axis=(1, 2), keepdims=True)
    of_samples = float(np.max(np.abs(values["velocity"] - finer["velocity"]) / largest))
    return max(_SAFETY * off, _SAFETY_OF_SAMPLES * of_samples)
