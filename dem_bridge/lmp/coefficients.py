"""What stands behind ``pair_coeff``: the law of each contact in the words of ``pair_style granular``.

``hertz K`` has F = K sqrt(R_eff) overlap^1.5 with R_eff = R/2, hence K = beta / sqrt(R/2); ``hooke k`` has
F = k overlap, the law of n = 2 (LAMMPS manual, *pair_style granular*). Damping adds eta overlap' (``velocity``) or
eta m_eff sqrt(R_eff overlap) overlap' (``viscoelastic``); with ``limit_damping`` the sum never pulls. Every float is
written with all its digits.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dem_bridge import features
from dem_bridge.physics.law import ContactLaw, power_law
from dem_bridge.scene import Scene
from dem_bridge.support import Condition, Exponents, Support

#: force ~ overlap^(n-1) -> LAMMPS' normal model
MODELS = {2.0: "hooke", 2.5: "hertz"}
#: no contact at all: for pairs that never meet
NOTHING = "hertz 0 0 tangential linear_nohistory 0 0 damping velocity"


def _unknown_damping(scene: Scene) -> str | None:
    c = scene.contacts
    viscoelastic = (c.damping > 0.0) & (c.damping_power > 0.0) & ~np.isin(c.exponent, list(MODELS))
    if not viscoelastic.any():
        return None
    wrong = int(np.argmax(viscoelastic))
    return f"contact {wrong} has Kuwabara-Kono damping and exponent n = {float(c.exponent[wrong])!r}"


#: what ``pair_style granular`` can express
GRANULAR_STYLE = Support(
    {features.WALLS, features.GAPS, features.INITIAL_OVERLAPS, features.SEVERAL_MOVING}
    | {features.OTHER_EXPONENTS, features.GRADED_EXPONENTS, features.GRAVITY, features.PRECOMPRESSION}
    | {features.DASHPOT, features.KUWABARA_KONO, features.DRAG}
    | {features.SINE_DRIVE, features.CHIRP_DRIVE, features.TABLE_DRIVE},
    exponents=Exponents(values=tuple(MODELS)),
    instead="lammps-table",
)
#: what ``pair_style table`` can, with ``granular`` for damped contacts
TABLE_STYLE = Support(
    GRANULAR_STYLE.features | {features.CONTACT_FUNCTIONS},
    exponents=Exponents(least=2.0, most=5.0),
    conditions=(Condition("n = 2 or 2.5 where contacts have Kuwabara-Kono damping", _unknown_damping),),
)


def line_order(scene: Scene) -> NDArray[np.int64]:
    """Which contact of the scene (chain, wall_left, wall_right) stands at each place along the line of atoms."""
    links = len(scene.stiffness)
    order = list(range(links))
    if scene.wall_left is not None:
        order.insert(0, links)
    if scene.wall_right is not None:
        order.append(scene.n_contact - 1)
    return np.array(order, dtype=np.int64)


@dataclass(frozen=True, kw_only=True)
class Laws:
    """The distinct laws of a scene's contacts, and which of them stands where. Made by :func:`laws`."""

    stiffness: NDArray[np.float64]
    """beta, ``(n_law,)``, N/m^(n-1)."""
    exponent: NDArray[np.float64]
    damping: NDArray[np.float64]
    """eta as LAMMPS has it: N s/m (velocity), or 1/(m s) (viscoelastic, per unit of m_eff R_eff^(1/2))."""
    viscoelastic: bool
    clipped: bool
    """Whether anything is damped: net forces never pull."""
    functions: tuple[ContactLaw, ...] | None
    """Where laws are no powers, what they are."""
    where: NDArray[np.int64]
    """Law of each contact along the line of atoms, ``(n_contact,)``."""

    def coefficients(self, law: int, radius: float) -> str:
        """Behind ``pair_coeff I J``, for bodies of ``radius`` (m)."""
        beta, n, eta = (float(one[law]) for one in (self.stiffness, self.exponent, self.damping))
        value = beta / math.sqrt(0.5 * radius) if n == 2.5 else beta
        viscoelastic = self.viscoelastic and n == 2.5
        if viscoelastic:
            eta /= math.sqrt(0.5 * radius)
        damping = f"damping {'viscoelastic' if viscoelastic else 'velocity'}{' limit_damping' * self.clipped}"
        # a zero as ever: the decks of undamped scenes do not know that there is damping
        return f"{MODELS[n]} {value!r} {eta if eta else 0!r} tangential linear_nohistory 0 0 {damping}"

    def left_to_granular(self, law: int) -> bool:
        """Whether a law is one that ``granular`` has, and damped: only there a net force can be clipped."""
        return self.functions is None and self.damping[law] > 0.0 and self.exponent[law] in MODELS

    def law(self, law: int) -> ContactLaw:
        """Elastic force and energy as functions of overlap."""
        if self.functions is not None:
            return self.functions[law]
        return power_law(float(self.stiffness[law]), float(self.exponent[law]))

    def dashpot(self, law: int) -> str:
        """As :meth:`coefficients`, for what is added beside a table: no elastic force, and nothing clipped."""
        return f"hertz 0 {float(self.damping[law])!r} tangential linear_nohistory 0 0 damping velocity"


def laws(scene: Scene) -> Laws:
    """The distinct laws of a scene, in the order in which they first stand along the line."""
    c, order = scene.contacts, line_order(scene)
    viscoelastic = bool(np.any((c.damping > 0.0) & (c.damping_power > 0.0)))
    eta = c.damping.copy()
    if viscoelastic:
        # LAMMPS multiplies by the effective mass; its wall atoms weigh as much as their neighbours
        mass = np.array(scene.mass)
        left, right = (
            mass[np.where(end == scene.n_body, other, end)] for end, other in ((c.left, c.right), (c.right, c.left))
        )
        eta = np.where(c.damping_power > 0.0, eta * (left + right) / (left * right), eta)
    rows = np.stack([c.stiffness, c.exponent, eta, c.law], axis=1)[order]
    _, first, where = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    by_place = np.argsort(first)
    rank = np.empty_like(by_place)
    rank[by_place] = np.arange(len(by_place))
    chosen = rows[first[by_place]]
    return Laws(
        stiffness=chosen[:, 0],
        exponent=chosen[:, 1],
        damping=chosen[:, 2],
        viscoelastic=viscoelastic,
        clipped=scene.damped,
        functions=tuple(c.laws[nth] for nth in chosen[:, 3].astype(int)) if scene.law is not None else None,
        where=rank[where.ravel()],
    )


def pairs(types: NDArray[np.int64]) -> Iterator[tuple[int, int, int, int]]:
    """Every pair of types (low, high) that meets, with the first place along the line where it does and how often."""
    low, high = np.minimum(types[:-1], types[1:]), np.maximum(types[:-1], types[1:])
    _, first, count = np.unique(low * (int(np.max(types)) + 1) + high, return_index=True, return_counts=True)
    for at in np.argsort(first).tolist():
        place = int(first[at])
        yield int(low[place]), int(high[place]), place, int(count[at])
