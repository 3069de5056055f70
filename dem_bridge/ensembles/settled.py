"""When nothing that follows can change the observables of a chain: a bound by the conserved energy.

After the wave has passed, bodies at both ends of a free chain fly away from the others. What is between them keeps its
momentum and its energy E in the frame of its centre of mass, so that no contact stores more than E and no body is
faster than all of E would make it. If the ends are faster than that they are never met again, and a contact whose
largest force so far is above that at the energy E has had its largest force. The rest of the run, three quarters of
the duration on decelerating-40, then changes no observable, only velocities at samples.

Damping only takes energy away, and its force is at most that of the deepest overlap at the fastest rate. Drag
slows down all bodies alike, by the factor ``slowed`` until the end. Walls, weights and loads exchange energy with a
chain: such chains are solved to their end.
"""

from __future__ import annotations

import numpy as np

from dem_bridge.foundation.compiled import Floats, kernel

#: factor on the energy: the steps conserve it to some per cent at the coarsest, and to the accuracy at finer ones
MARGIN = 1.1


@kernel(nogil=False)
def is_free(weight: Floats, stiffness: Floats) -> bool:
    """Return whether no wall, weight or load acts on any of the chains; the arrays are those of :func:`.march`."""
    return not (np.any(weight != 0.0) or np.any(stiffness[0] != 0.0) or np.any(stiffness[-1] != 0.0))


@kernel(nogil=False)
def all_settled(
    mass: Floats, stiffness: Floats, damping: Floats, exponent: Floats, power: Floats, velocity: Floats,
    overlap: Floats, crossing: Floats, peak: Floats, slowed: float,
) -> bool:  # fmt: skip
    """Return whether the observables of all lanes are final; what moves is flat, one place after the other."""
    lanes = mass.shape[1]
    for lane in range(lanes):
        moving = velocity[lane::lanes], overlap[lane::lanes], crossing[lane::lanes], peak[lane::lanes]
        if not is_settled(mass[:, lane], stiffness[:, lane], damping[:, lane], exponent, power, *moving, slowed):
            return False
    return True


@kernel(nogil=False)
def is_settled(
    mass: Floats, stiffness: Floats, damping: Floats, exponent: Floats, power: Floats, velocity: Floats,
    overlap: Floats, crossing: Floats, peak: Floats, slowed: float,
) -> bool:  # fmt: skip
    """Return whether the observables of one free chain are final.

    Arguments are those of one lane of :func:`.march` and :func:`.march_damped`, one number for each place or contact:
    kg, N/m^(n-1), damping and the power of the overlap in it, m/s, m, s (inf: not yet) and N. Bodies that leave are
    tried in numbers of 1, 2, 4 ... at both ends, and all at most.
    """
    first, last = 1, len(mass) - 2
    right, left = last, first
    while right > first and overlap[right - 1] <= 0.0 and (right == last or velocity[right] <= velocity[right + 1]):
        right -= 1
    while left < last and overlap[left] <= 0.0 and (left == first or velocity[left] >= velocity[left - 1]):
        left += 1
    leaving = 1
    while last - leaving >= right or leaving == 1:
        staying = 0
        while first + staying <= min(left, last - leaving):
            ends = first + staying, last - leaving
            numbers = mass, stiffness, damping, exponent, power, velocity, overlap, crossing, peak
            if right <= last - leaving and _stay_apart(*ends, *numbers, slowed):
                return True
            staying = max(1, 2 * staying)
        leaving *= 2
    return False


@kernel(nogil=False)
def _stay_apart(
    first: int, last: int, mass: Floats, stiffness: Floats, damping: Floats, exponent: Floats, power: Floats,
    velocity: Floats, overlap: Floats, crossing: Floats, peak: Floats, slowed: float,
) -> bool:  # fmt: skip
    """Return whether bodies from ``first`` to ``last`` never meet the others, nor exceed their forces so far."""
    if not np.all(crossing[first : last + 1] < np.inf):
        return False
    total, momentum = 0.0, 0.0
    for i in range(first, last + 1):
        total += mass[i]
        momentum += mass[i] * velocity[i]
    mean, energy = momentum / total, 0.0
    for i in range(first, last + 1):
        energy += 0.5 * mass[i] * (velocity[i] - mean) ** 2
        if i < last and overlap[i] > 0.0:
            energy += stiffness[i] * overlap[i] ** exponent[i] / exponent[i]
    energy *= MARGIN
    # the others move against this body, so that their momenta cancel
    fastest = np.sqrt(2.0 * energy * (total - mass[last]) / (total * mass[last]))
    if slowed * (velocity[last + 1] - mean) < fastest:
        return False
    slowest = np.sqrt(2.0 * energy * (total - mass[first]) / (total * mass[first]))
    if first > 1 and slowed * (mean - velocity[first - 1]) < slowest:
        return False
    for k in range(first, last):
        depth = (exponent[k] * energy / stiffness[k]) ** (1.0 / exponent[k])
        force = stiffness[k] * depth ** (exponent[k] - 1.0)
        if damping[k] > 0.0:
            rate = np.sqrt(2.0 * energy * (1.0 / mass[k] + 1.0 / mass[k + 1]))
            force += damping[k] * depth ** power[k] * rate
        if force > peak[k]:
            return False
    return True
