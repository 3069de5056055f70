"""The laws of contacts in a deck: atom types, ``pair_style`` and ``pair_coeff``, and the table files that they read.

**Atom types.** LAMMPS stores one model per pair of types, and its memory grows with their square: one type per body
takes 4.7 GB at 10,000 bodies. But only *neighbouring* bodies meet, and a law can be shared by contacts of equal
stiffness.

* All laws differ: an Eulerian circuit of the complete graph with loops on T types (T odd) visits all T(T+1)/2 unordered
  pairs once. Bodies that take the types along the circuit have a different pair at each contact, so N contacts need
  about sqrt(2N) types (Hierholzer 1873).
* D laws recur: with D types and law ``(a + b) mod D`` for the pair (a, b), one type gives the required law at each next
  contact (a symmetric Latin square).

**Coefficients** of ``pair_style granular``. ``hertz K`` is F = K sqrt(R_eff) overlap^1.5 with R_eff = R/2, hence K =
beta / sqrt(R/2); ``hooke k`` is F = k overlap, the law of n = 2 (LAMMPS manual, *pair_style granular*). Damping adds
eta overlap' (``velocity``) or eta m_eff sqrt(R_eff overlap) overlap' (``viscoelastic``) or eta m_eff overlap'
(``mass_velocity``). For ``coeff_restitution`` and ``tsuji`` it is alpha(e) sqrt(m_eff F/overlap) overlap' with the
elastic force F, in which the radius cancels. With ``limit_damping`` the sum is clipped at zero. Every float is written
with all its digits.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from dem_bridge.lmp.force_table import LINES, ContactTable, Style, contact_table, points_for, zero_table
from dem_bridge.physics.contact_law import ContactLaw, power_law
from dem_bridge.scene import features
from dem_bridge.scene.derived import derived, frozen
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.support import Condition, Exponents, Support, labels

Types = NDArray[np.int64]


def body_types(laws: NDArray[np.integer], how: str) -> Types:
    """Return types 1..T of ``len(laws) + 1`` bodies in a row, such that equal pairs of types have equal laws.

    Parameters
    ----------
    laws : ndarray of int
        Law of each contact, 0..D-1.
    how : {"euler", "per-body"}
        "euler" uses the better of the two ways above, "per-body" one type for each body.

    Examples
    --------
    >>> body_types(np.array([0, 1, 1, 0, 1]), "euler").tolist()
    [1, 1, 2, 1, 1, 2]
    >>> [int(max(body_types(np.arange(n), "euler"))) for n in (1, 40, 10_000)]
    [1, 9, 141]
    """
    contacts = len(laws)
    if how == "per-body":
        return np.arange(1, contacts + 2)
    distinct = int(np.max(laws, initial=-1)) + 1
    return latin_types(laws, distinct) if distinct < _types_needed(contacts) else euler_types(contacts)


def latin_types(laws: NDArray[np.integer], distinct: int) -> Types:
    """Return types 1..``distinct`` such that the pair (a, b), counted from 0, has the law ``(a + b) mod distinct``."""
    # t_k = s_k - t_(k-1): an alternating sum
    sign = np.where(np.arange(len(laws) + 1) % 2 == 0, 1, -1)
    steps = np.concatenate([[0], np.asarray(laws, dtype=np.int64)])
    return np.asarray(sign * np.cumsum(sign * steps) % max(distinct, 1) + 1)


def _types_needed(contacts: int) -> int:
    """Return the smallest odd number of types with enough pairs."""
    types = math.isqrt(2 * contacts)
    while types % 2 == 0 or types * (types + 1) // 2 < contacts:
        types += 1
    return types


def euler_types(contacts: int) -> Types:
    """Return types 1..T of ``contacts + 1`` bodies in a row, such that no unordered pair of neighbours occurs twice.

    Examples
    --------
    >>> euler_types(5).tolist()
    [1, 1, 2, 2, 3, 3]
    """
    if contacts < 0:
        raise ValueError(f"contacts = {contacts}; allowed: >= 0")
    types = _types_needed(contacts)
    # Hierholzer: `upto[a]` runs over the partners of a; each pair is used once, from either end
    used = bytearray(types * types)
    upto = [0] * types
    stack, circuit = [0], []
    while stack:
        here = stack[-1]
        while upto[here] < types and used[here * types + upto[here]]:
            upto[here] += 1
        if upto[here] == types:
            circuit.append(stack.pop() + 1)
            continue
        other = upto[here]
        used[here * types + other] = used[other * types + here] = 1
        stack.append(other)
    circuit.reverse()
    return np.array(circuit[: contacts + 1], dtype=np.int64)


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
    | {features.SINE_DRIVE, features.CHIRP_DRIVE, features.TABLE_DRIVE}
    | {features.CONSTANT_PISTON, features.SINE_PISTON, features.TABLE_PISTON},
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


#: range of a table relative to the largest overlap of the prescan
MARGIN = 1.1
#: range of a table of a contact that never closed in the prescan, relative to the largest overlap of all contacts
_UNTOUCHED = 0.01


@dataclass(frozen=True, kw_only=True)
class Pairing:
    """The pair commands of a deck."""

    note: str
    """Meaning of the coefficients, as a comment for readers."""
    head: tuple[str, ...]
    """``pair_style``, and the coefficients of the pairs without contact."""
    behind: tuple[tuple[str, ...], ...]
    """Arguments of ``pair_coeff I J``, one line or more for each law."""
    files: Mapping[str, str]


@dataclass(frozen=True, kw_only=True)
class TableSet:
    """The tables of a scene.

    :func:`table_set` computes it.
    """

    style: Style
    points: int
    """Number of points of LAMMPS' internal tables."""
    tables: Mapping[int, ContactTable]
    """Table of each law, except damped laws that ``granular`` has, because only ``granular`` can clip the net force."""


def granular(laws: Laws, radius: float) -> Pairing:
    """Return the pair commands of ``pair_style granular`` for bodies of ``radius`` (m)."""
    return Pairing(
        note="stiffness K = beta / sqrt(R/2)",
        head=("pair_style      granular", f"pair_coeff      * * {NOTHING}"),
        behind=tuple((laws.coefficients(law, radius),) for law in range(len(laws.stiffness))),
        files=MappingProxyType({}),
    )


def table_set(
    laws: Laws,
    *,
    radius: float,
    peak_overlap: NDArray[np.float64],
    pairs: int,
    style: Style = "spline",
    lines: int | None = None,
    points: int | None = None,
) -> TableSet:
    """Return one table for each law, whose range follows from the largest overlap of its contacts.

    Parameters
    ----------
    laws : Laws
        The laws of the scene.
    radius : float
        Radius of the bodies, m.
    peak_overlap : ndarray
        Largest overlap of each contact along the line of atoms, m.
    pairs : int
        Number of ``pair_coeff`` lines, which share the memory unless ``points`` is given.
    style : {"linear", "spline"}
        LAMMPS' interpolation.
    lines, points : int, optional
        Lines of each file, and points of LAMMPS' internal tables.
    """
    deepest = np.zeros(len(laws.stiffness))
    np.maximum.at(deepest, laws.where, peak_overlap)
    reach = np.maximum(MARGIN * deepest, _UNTOUCHED * (float(np.max(deepest, initial=0.0)) or radius))
    points = points or points_for(pairs + 1)
    tables = {}
    for law in range(len(laws.stiffness)):
        if laws.left_to_granular(law):
            continue
        tables[law] = contact_table(
            laws.law(law),
            keyword=f"LAW{law}",
            diameter=2.0 * radius,
            reach=float(reach[law]),
            points=points,
            lines=lines or LINES,
        )
    return TableSet(style=style, points=points, tables=MappingProxyType(tables))


def tabled(laws: Laws, radius: float, table_set: TableSet, name: str) -> Pairing:
    """Return the pair commands of ``pair_style table``; with damping, ``hybrid/overlay`` with ``granular``."""
    # contacts that are left to granular have no table, so their overlap has no bound
    reach = radius if laws.damped else None
    none = zero_table(keyword="NONE", diameter=2.0 * radius, reach=reach)
    files = {f"{name}.none.table": none.text}
    files |= {f"{name}.{law}.table": table.text for law, table in table_set.tables.items()}
    style = f"table {table_set.style} {table_set.points}"

    kind, overlay = ("table ", "hybrid/overlay ") if laws.damped else ("", "")
    behind = []
    for law in range(len(laws.stiffness)):
        table = table_set.tables.get(law)
        if table is None:
            behind.append((f"granular {laws.coefficients(law, radius)}",))
            continue
        dashpot = (f"granular {laws.dashpot(law)}",) if laws.eta[law] > 0.0 else ()
        behind.append((f"{kind}{name}.{law}.table {table.keyword}", *dashpot))
    pulls = "; damping is added and can make a contact tensile where granular lacks its law" if laws.clip else ""
    head = (
        f"pair_style      {overlay}{style}{' granular' * laws.damped}",
        f"pair_coeff      * * {kind}{name}.none.table NONE",
        *([f"pair_coeff      * * granular {NOTHING}"] if laws.damped else []),
    )
    note = f"forces from tables, exact at their lines{pulls}"
    return Pairing(note=note, head=head, behind=tuple(behind), files=MappingProxyType(files))
