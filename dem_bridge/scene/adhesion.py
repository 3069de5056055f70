"""Adhesion of contacts: its laws, and the checks of its numbers for a scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dem_bridge.errors import SceneError
from dem_bridge.foundation.numbers import checked_numbers
from dem_bridge.scene.contacts import Contacts

#: laws of adhesion
ADHESION_LAWS = ("dmt", "jkr")


@dataclass(frozen=True, kw_only=True)
class Adhesion:
    """An attraction in contacts of exponent 5/2, in addition to the elastic force.

    ``pull_off`` is the largest attraction in N, >= 0, one for all or one per contact, walls included. With ``law``
    "dmt" (Derjaguin, Muller & Toporov) the force is ``beta overlap^1.5 - pull_off`` while the overlap is > 0; spheres
    of effective radius R and surface energy gamma have the pull-off force ``4 pi gamma R``. Energy is conserved, but
    the force jumps at touch. With "jkr" (Johnson, Kendall & Roberts) it is ``3 pi gamma R``; a scene can have this law,
    but no backend solves it: :func:`~dem_bridge.physics.adhesion.jkr_impact` has the closed form of an impact.

    References
    ----------
    Derjaguin, Muller & Toporov 1975, *J. Colloid Interface Sci.* 53, 314.

    Examples
    --------
    >>> Adhesion(law="dmt", pull_off=0.1)
    Adhesion(law='dmt', pull_off=0.1)
    """

    law: str
    pull_off: tuple[float, ...] | float


def refuse_beside_adhesion(others: Mapping[str, bool]) -> None:
    """Raise SceneError if a scene with adhesion has one of the fields (name -> present) that exclude it."""
    for other, present in others.items():
        if present:
            raise SceneError("adhesion", problem=f"cannot be combined with {other}", allowed=f"no {other}")


def checked_adhesion(adhesion: Adhesion, contacts: Contacts, velocity: Sequence[float]) -> Adhesion:
    """Return the adhesion with one pull-off force per contact.

    Parameters
    ----------
    adhesion : Adhesion
        The adhesion as it was given.
    contacts : Contacts
        The contacts of the scene without their adhesion.
    velocity : sequence of float
        Start velocity of each body, m/s.

    Raises
    ------
    SceneError
        If a number is invalid, or a contact cannot have adhesion.
    """
    if not isinstance(adhesion.law, str) or adhesion.law not in ADHESION_LAWS:
        raise SceneError("adhesion.law", value=adhesion.law, allowed=" or ".join(ADHESION_LAWS))
    key, per, allowed, c = "adhesion.pull_off", "contact, walls included", "a number >= 0 (N)", contacts
    pull_off = checked_numbers(key, adhesion.pull_off, allowed, count=len(c.gap), per=per, at_least=0.0)
    v = np.append(velocity, 0.0)
    for k in np.flatnonzero(pull_off).tolist():
        if c.exponent[k] != 2.5:
            problem = f"is in contact {k}, whose exponent n is {float(c.exponent[k])!r}"
            raise SceneError("adhesion", problem=problem, allowed="n = 2.5")
        if c.gap[k] == 0.0 and v[c.left[k]] <= v[c.right[k]]:
            problem = f"is in contact {k}, whose bodies touch at the start without approaching each other"
            raise SceneError("adhesion", problem=problem, allowed="a gap, an initial overlap, or an approach")
    return Adhesion(law=adhesion.law, pull_off=pull_off)
