"""Forces and overlaps of the contacts of a chain at rest.

Each body at rest transmits the force on it, plus its weight where a wall below carries that. Each contact is compressed
until its law gives this force, ``delta = (F/beta)^(1/(n-1))`` (Nesterenko 2001, *Dynamics of Heterogeneous Materials*,
section 1.2, for the precompressed chain; with weight: Hong, Ji & Kim 1999, *Phys. Rev. Lett.* 82, 3058).
"""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Context, Decimal
from functools import lru_cache
from itertools import accumulate

#: with 25 digits the result of the two operations below rounds to the nearest double
_CONTEXT = Context(prec=25, traps=[])


def static_forces(
    masses: Sequence[float], *, force: float, gravity: float, wall_left: bool, wall_right: bool
) -> tuple[float, ...]:
    """Return the force at each end and contact of a chain at rest, N, ``(n_body + 1,)``: left end, contacts, right end.

    A wall in the direction of gravity carries the weight. Without such a wall the chain falls freely, and falling
    bodies do not press on each other.

    Parameters
    ----------
    masses : sequence of float
        Masses, kg, body 0 first.
    force : float
        Force, N, at the end that carries no weight.
    gravity : float
        Acceleration, m/s^2, positive towards the last body.
    wall_left, wall_right : bool
        True where the chain has a wall at that end.

    Examples
    --------
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
    """Return the overlap at which a contact carries a force, m.

    The result is correctly rounded, so that decks do not depend on the last bit of a library. It is infinity or 0 where
    it is outside the range of double precision.

    Parameters
    ----------
    force : float
        Force, N.
    stiffness : float
        Stiffness beta, N/m^(n-1).
    exponent : float
        Exponent n of the energy.

    Examples
    --------
    >>> static_overlap(8.0, 1e9, 2.5)
    4e-06
    """
    ratio = _CONTEXT.divide(Decimal(force), Decimal(stiffness))
    return float(_CONTEXT.power(ratio, _CONTEXT.divide(Decimal(1), Decimal(exponent) - 1)))
