"""Chains of one form solved in groups of lanes, and the number of steps that an accuracy takes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial

import numpy as np

from dem_bridge.backends.blanes_moan import SRKN_6B
from dem_bridge.backends.prescan import prescan_hertz
from dem_bridge.backends.scales import resting_acceleration
from dem_bridge.ensembles.draw import Chains
from dem_bridge.ensembles.lanes import LANES, jacobi_rules, march
from dem_bridge.errors import RunBroken, UnsupportedScene, UsageError
from dem_bridge.physics.statics import static_forces
from dem_bridge.scene import features
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.support import Support
from dem_bridge.trajectory.relative import own_scale, relative_size
from dem_bridge.trajectory.trajectory import Floats

#: scenes whose chains can be solved in lanes
LANED = Support(
    {features.WALLS, features.GAPS, features.INITIAL_OVERLAPS, features.SEVERAL_MOVING}
    | {features.OTHER_EXPONENTS, features.GRADED_EXPONENTS, features.GRAVITY, features.PRECOMPRESSION},
    scope="chains of an ensemble are solved by a method that evaluates forces where it knows no velocities",
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
    firsts = range(0, len(chains), LANES)
    kept = np.empty((LANES * len(firsts), samples + 1 if samples else 0, scene.n_body))
    # where fewer chains are left the last of them is repeated
    rows = [np.minimum(np.arange(first, first + LANES), len(chains) - 1) for first in firsts]
    parts = [
        _group(scene, chains.rows(of_group), steps, kept[first : first + LANES])
        for first, of_group in zip(firsts, rows, strict=True)
    ]
    out = {name: np.concatenate([part[name] for part in parts])[: len(chains)] for name in parts[0]}
    return out | ({"velocity": kept[: len(chains)]} if samples else {})


def _group(scene: Scene, chains: Chains, steps: int, kept: Floats) -> dict[str, Floats]:
    """Return the observables of a group of as many chains as there are lanes; ``kept`` is filled."""
    n, links, c = scene.n_body, scene.n_body - 1, scene.contacts
    # contact k of the line is between places k and k + 1: the wall on the left, the chain, the wall on the right
    line = np.arange(1, n) if scene.wall_left is None else np.append(np.arange(1, n), 0)
    line = line if scene.wall_right is None else np.append(line, n)

    def bodies(values: Floats, rest: float) -> Floats:
        return np.ascontiguousarray(np.pad(values, ((0, 0), (1, 1)), constant_values=rest).T)

    def contacts(values: Floats) -> Floats:
        out = np.zeros((n + 1, LANES))
        out[line] = values.T
        return out

    power = np.full(n + 1, 2.5)
    power[line] = c.exponent
    law = 0 if np.all(power[line] == 2.5) else 1 if np.all(power[line] == 2.0) else 2
    gap = chains.gap if scene.precompression == 0.0 else -_static_overlaps(scene, chains)
    weight = chains.mass * scene.gravity + np.asarray(scene.load)
    resting = np.tile(resting_acceleration(scene), (LANES, 1))
    crossing, peak, fastest = march(
        bodies(chains.mass, math.inf),
        bodies(chains.velocity, 0.0),
        bodies(weight, 0.0),
        contacts(chains.stiffness),
        contacts(-gap),
        power,
        law,
        contacts(resting),
        jacobi_rules(power),
        SLOWEST_TOUCH * _speed(scene),
        SRKN_6B.drifts,
        SRKN_6B.kicks,
        scene.duration / steps,
        steps,
        kept,
    )
    crossing, peak, fastest = (item.reshape(n + 1, LANES) for item in (crossing, peak, fastest))
    if not np.all(np.isfinite(fastest[1:])):
        raise RunBroken(f"{scene.name}: a velocity is not finite at {steps} steps; give a smaller accuracy")
    crossing, peak = crossing[line].T, peak[line].T
    arrival = np.pad(crossing[:, :links], ((0, 0), (1, 0)), constant_values=np.nan)
    reached = np.where(np.arange(n) == 0, True, ~np.isnan(arrival))
    speed = np.where(reached & (fastest[1:].T > 0.0), fastest[1:].T, np.nan)
    return {
        "arrival_at_end": arrival[:, -1],
        "crossing_time": crossing,
        "residence_time": np.pad(np.diff(arrival), ((0, 0), (0, 1)), constant_values=np.nan),
        "peak_velocity": speed,
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
