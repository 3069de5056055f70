"""What the files of a code say without a reference: order, delays, digits, momentum and energy."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dem_bridge.judging.conformance.behaviour import Behaviour
from dem_bridge.judging.conformance.limit import CLEAN_ORDER, LEAST_DIFFERENCE_WITH_ORDER
from dem_bridge.judging.conformance.scenes import RATIO_OF_STEPS
from dem_bridge.trajectory.relative import relative_size
from dem_bridge.trajectory.trajectory import Floats

#: part of a difference between two steps that a delay may leave: the slope over a sampling interval is not exact
LARGEST_LEFT_BY_DELAY = 0.4
#: order below which a method is of first order
LEAST_ORDER = 1.5


@dataclass(frozen=True)
class Delay:
    """Values that belong to another time than is written."""

    steps: float
    """Steps by which the values are late; negative: early."""
    left: float
    """Part of the difference between two time steps that the delay leaves."""


def delay_of(behaviour: Behaviour, name: str) -> Delay | None:
    """Return the delay, in time steps, that explains the differences of a quantity between the steps; None without.

    A value of the time t - s dt differs at two steps by s times the difference of the steps times its slope.
    """
    limit = behaviour.limits.get(name)
    if limit is None or not abs(limit.order - 1.0) <= CLEAN_ORDER or len(behaviour.files) < 3:
        return None
    before, last = (file.values[name][-len(limit.values) :] for file in behaviour.files[-2:])
    steps = behaviour.probe.steps
    slope = np.gradient(limit.values, behaviour.probe.interval, axis=0)
    # the ends have one-sided slopes, which are less exact
    slope, change = slope[1:-1].ravel(), (before - last)[1:-1].ravel()
    size = float(slope @ slope)
    if size == 0.0:
        return None
    late = -float(change @ slope) / size / (steps[-2] - steps[-1])
    left = float(np.linalg.norm(change + late * (steps[-2] - steps[-1]) * slope) / np.linalg.norm(change))
    return Delay(late, left) if left <= LARGEST_LEFT_BY_DELAY else None


def order_while_closing(behaviour: Behaviour, name: str) -> float:
    """Return the order of a quantity before the first contact begins to open; infinite if no step shows there.

    A force that jumps when a contact begins to open lowers the order from then on, whatever the method.
    """
    rows = min(len(file.values[name]) for file in behaviour.files)
    files = [file.values[name][-rows:] for file in behaviour.files]
    motion = {key: limit.values[-rows:] for key, limit in behaviour.limits.items()}
    if "displacement" in motion:
        last = int(np.argmax(motion["displacement"][:, 0] - motion["displacement"][:, 1]))
    else:
        last = int(np.argmax(motion["velocity"][:, 0] <= motion["velocity"][:, 1])) - 1
    early = [values[: max(last, 2)] for values in files]
    coarse, fine = (float(np.max(np.abs(b - a))) / behaviour.scale[name] for a, b in pairwise(early))
    if fine <= LEAST_DIFFERENCE_WITH_ORDER:
        return math.inf
    return math.log(max(coarse, 1e-300) / fine, RATIO_OF_STEPS)


def momentum_drift(behaviour: Behaviour) -> float:
    """Return the largest change of the momentum in the finest file, relative to the sum of the magnitudes."""
    momentum = _momentum(behaviour)
    return relative_size(float(np.max(np.abs(momentum - momentum[0]))), _magnitudes_of_momentum(behaviour))


def momentum_drift_apart(behaviour: Behaviour) -> float:
    """Return the change of the momentum while no bodies touch, relative to the sum of the magnitudes; 0 if all do."""
    if "displacement" not in behaviour.limits:
        return 0.0
    momentum = _momentum(behaviour)
    displacement = behaviour.files[-1].values["displacement"]
    rows = min(len(momentum), len(displacement))
    apart = np.all(_openings(behaviour, displacement[-rows:]) > 0.0, axis=1)
    changes = np.abs(np.diff(momentum[-rows:]))[apart[1:] & apart[:-1]]
    return relative_size(float(np.sum(changes)), _magnitudes_of_momentum(behaviour))


def _momentum(behaviour: Behaviour) -> Floats:
    """Return the momentum of all bodies in the finest file, kg m/s."""
    return np.asarray(behaviour.files[-1].values["velocity"] @ np.array(behaviour.probe.scene.mass))


def momentum_by_digits(behaviour: Behaviour) -> float:
    """Return the change of the momentum that the digits of the finest file explain, relative to the same."""
    by_digits = 2.0 * behaviour.files[-1].digits["velocity"] * float(np.sum(behaviour.probe.scene.mass))
    return relative_size(by_digits, _magnitudes_of_momentum(behaviour))


def _magnitudes_of_momentum(behaviour: Behaviour) -> float:
    """Return the largest sum of the magnitudes of the momenta of all bodies in the finest file, kg m/s."""
    return float(np.max(np.abs(behaviour.files[-1].values["velocity"]) @ np.array(behaviour.probe.scene.mass)))


def energy_change(behaviour: Behaviour) -> float | None:
    """Return the relative change of the kinetic energy of the limit from the start to the last sample without contact.

    No law of contact is needed: contacts that are open store nothing. None if contacts are never open.
    """
    if not {"velocity", "displacement"} <= behaviour.limits.keys():
        return None
    velocity, displacement = (behaviour.limits[name].values for name in ("velocity", "displacement"))
    mass = np.array(behaviour.probe.scene.mass)
    rows = np.flatnonzero(np.all(_openings(behaviour, displacement) > 0.0, axis=1))
    if not len(rows):
        return None
    written = behaviour.files[-1].values["velocity"]
    scene = behaviour.probe.scene
    first = written[0] if len(written) > scene.samples else np.array(scene.velocity)
    start = float(mass @ first**2)
    return float(mass @ velocity[rows[-1]] ** 2) / start - 1.0 if start > 0.0 else None


def _openings(behaviour: Behaviour, displacement: Floats) -> Floats:
    """Return the distance of the bodies in each contact of the chain, m, ``(n_t, n_contact)``."""
    gaps = behaviour.probe.scene.contacts.gap[: displacement.shape[1] - 1]
    return np.asarray(np.diff(displacement, axis=1) + gaps)


def written_digits(behaviour: Behaviour) -> float:
    """Return the number of significant digits of the largest values, as they are written; at most those of doubles."""
    ratios = [
        behaviour.scale[name] / (2.0 * file.digits[name])
        for file in behaviour.files
        for name in behaviour.limits
        if file.digits[name] > 0.0
    ]
    return math.log10(max(min([*ratios, 2.0**53]), 1.0))
