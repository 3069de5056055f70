"""When nothing that follows can change the observables of a chain: a bound by the conserved energy.

After the wave has passed, bodies at both ends of a free chain fly away from the others. What is between them keeps its
momentum and its energy E in the frame of its centre of mass, so that no contact stores more than E and no body is
faster than all of E would make it. If the ends are faster than that they are never met again, and a contact whose
largest force so far is above that at the energy E has had its largest force. The rest of the run, four fifths of the
duration on decelerating-40, then changes no observable, only velocities at samples.

Walls, weights and loads exchange energy with a chain: such chains are solved to their end.
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
def is_settled(
    mass: Floats, stiffness: Floats, exponent: Floats, velocity: Floats, overlap: Floats, crossing: Floats, peak: Floats
) -> bool:
    """Return whether the observables of one free chain are final.

    Arguments are those of one lane of :func:`.march`, one number for each place or contact: kg, N/m^(n-1), 1, m/s, m,
    s (inf: not yet) and N. Bodies that leave are tried in numbers of 1, 2, 4 ... at both ends, and all at most.
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
            if right <= last - leaving and _stay_apart(
                first + staying, last - leaving, mass, stiffness, exponent, velocity, overlap, crossing, peak
            ):
                return True
            staying = max(1, 2 * staying)
        leaving *= 2
    return False


@kernel(nogil=False)
def _stay_apart(
    first: int, last: int, mass: Floats, stiffness: Floats, exponent: Floats, velocity: Floats, overlap: Floats,
    crossing: Floats, peak: Floats,
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
    if velocity[last + 1] < mean + fastest:
        return False
    slowest = np.sqrt(2.0 * energy * (total - mass[first]) / (total * mass[first]))
    if first > 1 and velocity[first - 1] > mean - slowest:
        return False
    for k in range(first, last):
        n = exponent[k]
        if stiffness[k] * (n * energy / stiffness[k]) ** ((n - 1.0) / n) > peak[k]:
            return False
    return True
