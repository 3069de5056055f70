"""A chain in equilibrium: the forces that its contacts carry at rest, and the overlaps that carry them.

Where nothing moves, each body hands on the force on it, plus its weight where a wall below holds that; each contact
is compressed until its law gives the force it carries, ``delta = (F/beta)^(1/(n-1))`` (Nesterenko 2001, *Dynamics of
Heterogeneous Materials*, section 1.2, for the precompressed chain; with weight: Hong, Ji & Kim 1999, *Phys. Rev.
Lett.* 82, 3058).
"""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Context, Decimal
from functools import lru_cache
from itertools import accumulate

#: 25 digits: after the two operations below the double nearest to the result is the right one
_CONTEXT = Context(prec=25, traps=[])


def static_forces(
    masses: Sequence[float], *, force: float, gravity: float, wall_left: bool, wall_right: bool
) -> tuple[float, ...]:
    """Force in front of each body and behind the last, N, ``(n_body + 1,)``: left end, contacts, right end.

    ``masses`` in kg, body 0 first; ``force`` (N) at the end that bears no weight; ``gravity`` (m/s^2) positive
    towards the last body. A wall that the weight points to bears it; without one the chain falls, and falling bodies
    do not press on each other.

    >>> static_forces((1.0, 2.0), force=10.0, gravity=5.0, wall_left=False, wall_right=True)
    (10.0, 15.0, 25.0)
    >>> static_forces((1.0, 2.0), force=10.0, gravity=5.0, wall_left=True, wall_right=False)
    (10.0, 10.0, 10.0)
    """
    if gravity > 0.0 and wall_right:
        return tuple(accumulate((gravity * mass for mass in masses), initial=force))
    if gravity < 0.0 and wall_left:
        return tuple(accumulate((-gravity * mass for mass in reversed(masses)), initial=force))[::-1]
    return (force,) * (len(masses) + 1)


@lru_cache(maxsize=4096)
def static_overlap(force: float, stiffness: float, exponent: float) -> float:
    """Overlap (m) at which a contact of ``stiffness`` (N/m^(n-1)) and ``exponent`` n carries ``force`` (N).

    Correctly rounded, so that decks do not depend on the last bit of a library. Infinity or 0 where no double holds
    it.

    >>> static_overlap(8.0, 1e9, 2.5)
    4e-06
    """
    ratio = _CONTEXT.divide(Decimal(force), Decimal(stiffness))
    return float(_CONTEXT.power(ratio, _CONTEXT.divide(Decimal(1), Decimal(exponent) - 1)))
