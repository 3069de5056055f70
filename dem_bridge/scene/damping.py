"""Damping of contacts: its laws, and the factor of the damping force of each contact."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dem_bridge.errors import SceneError
from dem_bridge.foundation.numbers import checked_numbers
from dem_bridge.physics.contact_law import Floats
from dem_bridge.physics.damped_impact import alpha_of_restitution, alpha_of_tsuji

#: damping laws, and the unit of the coefficient of each
DAMPING_LAWS = {"dashpot": "N s/m", "mass_velocity": "1/s", "kuwabara-kono": "s", "tsuji": "", "coeff_restitution": ""}
#: damping laws whose coefficient is a coefficient of restitution, with the factor alpha that follows from it
BY_RESTITUTION = ("coeff_restitution", "tsuji")
#: allowed coefficients of restitution
RESTITUTION = "a coefficient of restitution, above 0 and at most 1"
#: damping laws that do not depend on the overlap
DASHPOTS = ("dashpot", "mass_velocity")
#: words of LAMMPS that are not the names of the laws here
_WORDS_OF_LAMMPS = {"velocity": "dashpot", "viscoelastic": "kuwabara-kono"}


@dataclass(frozen=True, kw_only=True)
class Damping:
    """A damping force in contacts, in addition to the elastic one, while the overlap is > 0.

    ``m`` is the effective mass 1/(1/m1 + 1/m2) of the two bodies of a contact, at a wall the mass of the body.

    =================== ============================================  ===============================================
    law                 force                                         coefficient, one for all or one per contact
    =================== ============================================  ===============================================
    "dashpot"           ``c overlap'``                                c >= 0, N s/m
    "mass_velocity"     ``eta m overlap'``                            eta >= 0, 1/s
    "kuwabara-kono"     ``gamma beta overlap^(n-2) overlap'``         gamma >= 0, s
    "tsuji"             as "coeff_restitution"                        e, 0 < e <= 1; alpha by Marshall's polynomial
    "coeff_restitution" ``alpha sqrt(m beta) overlap^((n-2)/2)        coefficient of restitution e, 0 < e <= 1, from
                        overlap'``                                    which alpha follows exactly
    =================== ============================================  ===============================================

    ``clip`` is True if the sum of elastic and damping force is clipped at zero, so that damping never makes a contact
    tensile (LAMMPS: ``limit_damping``). If it is False, a contact ends when its overlap is zero, in tension. Contacts
    with "tsuji" or "coeff_restitution" have the restitution e only if they are not clipped; clipped ones have a larger
    one: :func:`.restitution_obtained`. None, the default, is True, but False in a scene with
    adhesion, where True is not allowed. Laws other than dashpots need n >= 2.

    References
    ----------
    Kuwabara & Kono 1987, *Jpn. J. Appl. Phys.* 26, 1230. For alpha: :mod:`dem_bridge.physics.damped_impact`.

    Examples
    --------
    >>> Damping(law="coeff_restitution", coefficient=0.9)
    Damping(law='coeff_restitution', coefficient=0.9, clip=True)
    """

    law: str
    coefficient: tuple[float, ...] | float
    clip: bool | None = None
    _clip_by_default: bool = field(init=False, default=False, compare=False, repr=False)
    """True if no clip was given."""

    def __post_init__(self) -> None:
        if self.clip is None:
            object.__setattr__(self, "clip", True)
            object.__setattr__(self, "_clip_by_default", True)


def damping_law(law: object) -> str:
    """Return the damping law if there is one of this name; raise SceneError otherwise."""
    if isinstance(law, str) and law in DAMPING_LAWS:
        return law
    allowed = " or ".join(DAMPING_LAWS)
    if isinstance(law, str) and law in _WORDS_OF_LAMMPS:
        allowed = f"{_WORDS_OF_LAMMPS[law]!r}, which is the law that LAMMPS calls {law!r}; or another of {allowed}"
    raise SceneError("damping.law", value=law, allowed=allowed)


def checked_damping(damping: Damping, exponent: Floats, *, adhesion: bool) -> Damping:
    """Return the damping with one coefficient for each contact of these exponents.

    ``adhesion`` is True if the contacts are adhesive, and then not clipped.

    Raises
    ------
    SceneError
        If an entry is invalid.
    """
    law, by_restitution = damping_law(damping.law), damping.law in BY_RESTITUTION
    if not isinstance(damping.clip, bool):
        raise SceneError(
            "damping.clip", value=damping.clip, allowed="true or false; default: true, with adhesion false"
        )
    clip = damping.clip and not (adhesion and damping._clip_by_default)
    if adhesion and clip:
        problem = "= True, but contacts have adhesion, which a clip would remove"
        raise SceneError("damping.clip", problem=problem, allowed="false, the default with adhesion")
    allowed = f"a number >= 0 ({DAMPING_LAWS[law]})"
    bounds = {"at_least": 0.0}
    if by_restitution:
        allowed, bounds = RESTITUTION, {"above": 0.0, "at_most": 1.0}
    key, per = "damping.coefficient", "contact, walls included"
    coefficient = checked_numbers(key, damping.coefficient, allowed, count=len(exponent), per=per, **bounds)
    if law not in DASHPOTS:
        for k, (value, n) in enumerate(zip(coefficient, exponent.tolist(), strict=True)):
            if n < 2.0 and value != float(by_restitution):
                problem = f"has the law {law} on contact {k}, whose exponent n is {n!r}"
                allowed = "n >= 2, since the force is infinite at touch below"
                raise SceneError("damping", problem=problem, allowed=allowed)
    return Damping(law=law, coefficient=coefficient, clip=clip)


def damping_factors(damping: Damping, effective_mass: Floats, beta: Floats, n: Floats) -> tuple[Floats, Floats]:
    """Return the factor of each damping force and the power of the overlap in it; the damping has been checked."""
    law, value = damping.law, np.array(damping.coefficient)
    if law == "dashpot":
        return value, np.zeros_like(n)
    if law == "kuwabara-kono":
        # an elastic contact has no damping force, for any n
        return value * beta, np.maximum(n - 2.0, 0.0)
    if law == "mass_velocity":
        return value * effective_mass, np.zeros_like(n)
    pairs = zip(value.tolist(), n.tolist(), strict=True)
    alpha = [alpha_of_tsuji(e) if law == "tsuji" else alpha_of_restitution(e, exponent) for e, exponent in pairs]
    return np.array(alpha) * np.sqrt(effective_mass * beta), np.maximum(0.5 * n - 1.0, 0.0)
