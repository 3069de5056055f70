"""The arguments of ``pair_coeff``: the law of each contact in the notation of ``pair_style granular``.

``hertz K`` is F = K sqrt(R_eff) overlap^1.5 with R_eff = R/2, hence K = beta / sqrt(R/2); ``hooke k`` is F = k overlap,
the law of n = 2 (LAMMPS manual, *pair_style granular*). Damping adds eta overlap' (``velocity``) or eta m_eff
sqrt(R_eff overlap) overlap' (``viscoelastic``) or eta m_eff overlap' (``mass_velocity``). For ``coeff_restitution`` and
``tsuji`` it is alpha(e) sqrt(m_eff F/overlap) overlap' with the elastic force F, in which the radius cancels. With
``limit_damping`` the sum is clipped at zero. Every float is written with all its digits.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dem_bridge.physics.contact_law import ContactLaw, power_law
from dem_bridge.scene import features
from dem_bridge.scene.derived import derived, frozen
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.support import Condition, Exponents, Support, labels

#: force ~ overlap^(n-1) -> LAMMPS' normal model
MODELS = {2.0: "hooke", 2.5: "hertz"}
#: damping law of a scene -> LAMMPS' damping model
DAMPINGS = {
    "dashpot": "velocity",
    "mass_velocity": "mass_velocity",
    "kuwabara-kono": "viscoelastic",
    "coeff_restitution": "coeff_restitution",
    "tsuji": "tsuji",
}
#: damping models whose coefficient is that of the scene. The engine multiplies by the effective mass, which must be the
#: mass of the body at a wall
BY_EFFECTIVE_MASS = ("mass_velocity", "coeff_restitution", "tsuji")
#: damping models that the engine refuses beside adhesion
WITHOUT_ADHESION = ("coeff_restitution", "tsuji")
#: no interaction, for pairs that never meet
NOTHING = "hertz 0 0 tangential linear_nohistory 0 0 damping velocity"


def _unknown_damping(scene: Scene) -> str | None:
    """Return the reason why LAMMPS has no such damping, or None."""
    c = scene.contacts
    wrong = (c.damping > 0.0) & (c.damping_power > 0.0) & ~np.isin(c.exponent, list(MODELS))
    if scene.damping is None or not wrong.any():
        return None
    label = labels(scene.features & {features.KUWABARA_KONO, features.COEFF_RESTITUTION, features.TSUJI})
    return f"contact {int(np.argmax(wrong))} has {label} and exponent n = {float(c.exponent[np.argmax(wrong)])!r}"


def _cohesive_restitution(scene: Scene) -> str | None:
    """Return the error of the engine for contacts with adhesion and a coefficient of restitution, or None."""
    c, (damping, _) = scene.contacts, damping_model(scene)
    if scene.adhesion is None or damping not in WITHOUT_ADHESION or not np.any((c.damping > 0.0) & (c.pull_off > 0.0)):
        return None
    return f"LAMMPS: Cannot use {damping} model with a cohesive normal model, {scene.adhesion.law}"


#: scenes that ``pair_style granular`` supports
GRANULAR_STYLE = Support(
    {features.WALLS, features.GAPS, features.INITIAL_OVERLAPS, features.SEVERAL_MOVING}
    | {features.OTHER_EXPONENTS, features.GRADED_EXPONENTS, features.GRAVITY, features.PRECOMPRESSION}
    | {features.DASHPOT, features.MASS_VELOCITY, features.KUWABARA_KONO, features.COEFF_RESTITUTION, features.TSUJI}
    | {features.NOT_CLIPPED, features.DMT, features.DRAG}
    | {features.SINE_DRIVE, features.CHIRP_DRIVE, features.TABLE_DRIVE},
    exponents=Exponents(values=tuple(MODELS)),
    conditions=(Condition("no damping by a coefficient of restitution in adhesive contacts", _cohesive_restitution),),
    instead="lammps-table",
)
#: scenes that ``pair_style table`` supports, with ``granular`` for damped contacts
TABLE_STYLE = Support(
    (GRANULAR_STYLE.features | {features.CONTACT_FUNCTIONS}) - {features.DMT},
    exponents=Exponents(least=2.0, most=5.0),
    conditions=(Condition("n = 2 or 2.5 where the damping force depends on the overlap", _unknown_damping),),
)


@derived
def line_order(scene: Scene) -> NDArray[np.int64]:
    """Return the index of the scene's contact (chain, wall_left, wall_right) at each place along the line of atoms."""
    links = len(scene.stiffness)
    order = list(range(links))
    if scene.wall_left is not None:
        order.insert(0, links)
    if scene.wall_right is not None:
        order.append(scene.n_contact - 1)
    return frozen(np.array(order, dtype=np.int64))


def coefficients(
    stiffness: float, exponent: float, eta: float, radius: float, *, damping: str, clip: bool, pull_off: float = 0.0
) -> str:
    """Return the arguments of ``pair_coeff I J`` for contacts of this effective ``radius`` (m)."""
    if (damping == "viscoelastic" and exponent != 2.5) or (eta == 0.0 and damping in WITHOUT_ADHESION):
        damping = "velocity"
    per_root = math.sqrt(radius)
    value = stiffness / per_root if exponent == 2.5 else stiffness
    # "0", not "0.0", so that decks of undamped scenes stay as they were before there was damping
    eta_text = repr(eta / per_root if damping == "viscoelastic" else eta) if eta else "0"
    words = f"damping {damping}{' limit_damping' * clip}"
    law = f"{MODELS[exponent]} {value!r} {eta_text}"
    if pull_off > 0.0:
        # K = 4/3 E / (2 (1 - nu^2)) with nu = 0, and pull_off = 4 pi gamma R_eff
        law = f"dmt {1.5 * value!r} {eta_text} 0 {pull_off / (4.0 * math.pi * radius)!r}"
    return f"{law} tangential linear_nohistory 0 0 {words}"


@dataclass(frozen=True, kw_only=True)
class Laws:
    """The distinct laws of a scene's contacts, and the law of each contact.

    :func:`laws` computes it.
    """

    stiffness: NDArray[np.float64]
    """Stiffness beta, N/m^(n-1), ``(n_law,)``."""
    exponent: NDArray[np.float64]
    eta: NDArray[np.float64]
    """LAMMPS' eta: N s/m (velocity), 1/s (mass_velocity), 1/(m s) (viscoelastic, per unit of m_eff R_eff^(1/2)), or the
    coefficient of restitution; 0 without damping."""
    pull_off: NDArray[np.float64]
    """Largest attraction, N."""
    damping: str
    """LAMMPS' damping model."""
    damped: bool
    """True if any contact is damped."""
    clip: bool
    """True if net forces are clipped at zero."""
    functions: tuple[ContactLaw, ...] | None
    """The laws that are not powers; None if all are powers."""
    where: NDArray[np.int64]
    """Index of the law of each contact along the line of atoms, ``(n_contact,)``."""

    def coefficients(self, law: int, radius: float) -> str:
        """Return the arguments of ``pair_coeff I J`` for bodies of ``radius`` (m)."""
        columns = (self.stiffness, self.exponent, self.eta, self.pull_off)
        beta, n, eta, pull_off = (float(column[law]) for column in columns)
        damping, clip = self.damping, self.clip
        return coefficients(beta, n, eta, 0.5 * radius, damping=damping, clip=clip, pull_off=pull_off)

    def left_to_granular(self, law: int) -> bool:
        """Return True if a law is damped and available in ``granular``, which alone can clip the net force."""
        return self.functions is None and self.eta[law] > 0.0 and self.exponent[law] in MODELS

    def law(self, law: int) -> ContactLaw:
        """Return elastic force and energy as functions of the overlap."""
        if self.functions is not None:
            return self.functions[law]
        return power_law(float(self.stiffness[law]), float(self.exponent[law]))

    def dashpot(self, law: int) -> str:
        """Return the arguments of ``pair_coeff I J`` for the damping that is added to a table, which is not clipped."""
        model = "mass_velocity" if self.damping == "mass_velocity" else "velocity"
        return f"hertz 0 {float(self.eta[law])!r} tangential linear_nohistory 0 0 damping {model}"


def laws(scene: Scene) -> Laws:
    """Return the distinct laws of a scene, in the order of their first occurrence along the line."""
    c, order = scene.contacts, line_order(scene)
    damping, eta = damping_model(scene)
    if damping == "viscoelastic":
        # LAMMPS multiplies by the effective mass; wall atoms have the mass of their neighbours
        mass = np.array(scene.mass)
        left, right = (
            mass[np.where(end == scene.n_body, other, end)] for end, other in ((c.left, c.right), (c.right, c.left))
        )
        eta = np.where(c.damping_power > 0.0, eta * (left + right) / (left * right), eta)
    rows = np.stack([c.stiffness, c.exponent, eta, c.law, c.pull_off], axis=1)[order].tolist()
    numbers: dict[tuple[float, ...], int] = {}
    where = [numbers.setdefault(tuple(row), len(numbers)) for row in rows]
    chosen = np.array(list(numbers)).reshape(-1, 5)
    return Laws(
        stiffness=chosen[:, 0],
        exponent=chosen[:, 1],
        eta=chosen[:, 2],
        pull_off=chosen[:, 4],
        damping=damping,
        damped=scene.damped,
        clip=scene.damped and c.clip,
        functions=tuple(c.laws[nth] for nth in chosen[:, 3].astype(int)) if scene.law is not None else None,
        where=np.array(where, dtype=np.int64),
    )


def damping_model(scene: Scene) -> tuple[str, NDArray[np.float64]]:
    """Return LAMMPS' damping model, and eta of each contact; that of ``viscoelastic`` without 1/m_eff.

    ``viscoelastic`` stands for a scene that has contacts of n = 5/2 with it.
    """
    c = scene.contacts
    model = DAMPINGS[scene.damping.law] if scene.damping is not None and scene.damped else "velocity"
    if model in BY_EFFECTIVE_MASS and scene.damping is not None:
        return model, np.where(c.damping > 0.0, scene.damping.coefficient, 0.0)
    return model if np.any((c.damping > 0.0) & (c.damping_power > 0.0)) else "velocity", c.damping.copy()


def pairs(types: NDArray[np.int64]) -> Iterator[tuple[int, int, int, int]]:
    """Yield each pair of types (low, high) that meets, its first place along the line and its number of contacts."""
    low, high = np.minimum(types[:-1], types[1:]), np.maximum(types[:-1], types[1:])
    _, first, count = np.unique(low * (int(np.max(types)) + 1) + high, return_index=True, return_counts=True)
    for at in np.argsort(first).tolist():
        place = int(first[at])
        yield int(low[place]), int(high[place]), place, int(count[at])
