"""Each impact solved without LAMMPS: exactly, by velocity-Verlet at the steps of the deck, and with another physics.

The exact solution is a closed form where one exists (:mod:`dem_bridge.physics`), else an integral of high order. The
twin advances all impacts together, with forces at the velocity of the half step, as LAMMPS does. The cause of a wrong
impact is another physics, whose twin repeats LAMMPS.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.physics.adhesion import jkr_impact
from dem_bridge.physics.damped_impact import restitution_of_alpha
from dem_bridge.physics.viscoelastic import viscoelastic_impact
from dem_bridge.studies.engine.impacts import BREAK, POISSON, TOUCH, Contact, Impact, Steps

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Exact:
    """Solution of the equation of motion of one impact."""

    restitution: float
    """0 where the bodies stick."""
    peak_overlap: float
    """m."""
    time: float
    """Duration of the contact, s."""


def closed_form(contact: Contact) -> float:
    """Return the restitution by a closed form; nan where none is known.

    Parameters
    ----------
    contact : Contact
        Physics of the impact.
    """
    c = contact
    if c.adhesion == "jkr" and not c.damping:
        return jkr_impact(
            mass=c.mass, speed=c.speed, stiffness=c.stiffness, pull_off=c.pull_off, breaks_at="overlap"
        ).restitution
    if not c.damping:
        return 1.0
    if c.adhesion:
        return math.nan
    alpha = c.damping / math.sqrt(c.mass * c.stiffness)
    if c.power == 0.5 * (c.exponent - 2.0):
        return restitution_of_alpha(alpha, clip=c.clip, exponent=c.exponent)
    if c.exponent == 2.5 and c.power == 0.5:
        viscosity = c.damping / c.stiffness
        return viscoelastic_impact(
            mass=c.mass, speed=c.speed, stiffness=c.stiffness, viscosity=viscosity, clip=c.clip
        ).restitution
    return math.nan


def exact(contact: Contact) -> Exact:
    """Integrate one impact with located ends.

    With ``d = u^4`` and ``dt = u^3 ds`` the motion is smooth at touch. A JKR contact has its own coordinate s, in which
    the overlap is a polynomial.
    """
    from scipy.integrate import solve_ivp

    c, jkr = contact, contact.adhesion == "jkr"
    size = (
        (1.25 * c.mass * c.speed**2 / c.stiffness) ** 0.4
        if c.exponent == 2.5
        else c.speed * math.sqrt(c.mass / c.stiffness)
    )
    span = math.pi * size / c.speed

    def force(q: float, w: float) -> float:
        if jkr:
            wide = math.sqrt(c.length) * q * q if c.power else 1.0
            return c.pull_off * (q**6 - 2.0 * q**3) + c.damping * wide * w
        d = max(q, 0.0) ** 4 * size
        return c.stiffness * math.pow(d, c.exponent - 1.0) - c.pull_off + c.damping * math.pow(d, c.power) * w

    def rates(_: float, state: Array) -> list[float]:
        q, w, _t = state
        if jkr:
            slope = c.length * 4.0 * (q**3 - 1.0 / 3.0)
            return [w * span, -force(q, w) / c.mass * slope * span, slope * span]
        # d = size q^4, dt = span q^3 ds
        return [w * span / (4.0 * size), -force(q, w) / c.mass * q**3 * span, q**3 * span]

    def opened(_: float, state: Array) -> float:
        return float(state[0]) - (BREAK if jkr else 0.0)

    def slack(_: float, state: Array) -> float:
        return force(state[0], state[1]) if c.clip and state[1] < 0.0 else 1.0

    def turned(_: float, state: Array) -> float:
        return float(state[1])

    opened.terminal, opened.direction, slack.terminal, slack.direction = True, -1, True, -1  # type: ignore[attr-defined]
    scale = 1.0 / c.length if jkr else 1.0
    run: Any = solve_ivp(
        rates,
        (0.0, 40.0 * scale),
        [TOUCH if jkr else 0.0, c.speed, 0.0],
        method="DOP853",
        rtol=1e-12,
        atol=[1e-13, 1e-13 * c.speed, 1e-13 * span],
        events=(opened, slack, turned),
        first_step=1e-3 * scale,
    )
    ends = [event for event in run.y_events[:2] if len(event)]
    peak = run.y_events[2][0][0]
    deepest = c.length * (peak**4 - 4.0 / 3.0 * peak) if jkr else size * peak**4
    if not ends:
        return Exact(restitution=0.0, peak_overlap=deepest, time=float(run.y[2, -1]))
    q, w, time = ends[0][0]
    # a slack contact lasts until the bodies are apart
    rest = size * max(q, 0.0) ** 4 / -w if len(run.y_events[1]) else 0.0
    return Exact(restitution=float(-w / c.speed), peak_overlap=float(deepest), time=float(time + rest))


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """Samples of an impact: overlap (m, below 0 apart) and closing speed (m/s), ``(n,)``."""

    overlap: Array
    closing: Array
    speed: float
    """Closing speed at the start, m/s."""

    @property
    def restitution(self) -> float:
        """Return the speed of separation over the speed of approach."""
        return float(-self.closing[-1] / self.speed)

    @property
    def finite(self) -> bool:
        """Return True if all samples are numbers."""
        return bool(np.isfinite(self.closing).all() and np.isfinite(self.overlap).all())

    def difference(self, other: Motion) -> float:
        """Return the largest difference of closing speeds, relative to the speed of approach; nan if any is nan."""
        return float(np.max(np.abs(self.closing - other.closing))) / self.speed


def twins(contacts: Sequence[Contact], steps: Sequence[Steps]) -> list[Motion]:
    """Advance impacts by velocity-Verlet; all have the same number of steps and rows."""
    pairs = list(zip(contacts, steps, strict=True))
    distinct = list(dict.fromkeys(pairs))
    motions = dict(zip(distinct, _advance(*zip(*distinct, strict=True)), strict=True)) if distinct else {}
    return [motions[pair] for pair in pairs]


def _advance(contacts: Sequence[Contact], steps: Sequence[Steps]) -> list[Motion]:
    """Return the motions of distinct impacts."""
    column = {
        name: np.array([getattr(c, name) for c in contacts], dtype=float)
        for name in ("mass", "speed", "stiffness", "exponent", "damping", "power", "pull_off", "breaks")
    }
    mass, beta, power, damping = (column[name] for name in ("mass", "stiffness", "power", "damping"))
    clip, jkr = np.array([c.clip for c in contacts]), np.array([c.adhesion == "jkr" for c in contacts])
    order, pull, root = column["exponent"] - 1.0, np.where(jkr, 0.0, column["pull_off"]), power == 0.5
    length = np.array([c.length if c.adhesion == "jkr" else 1.0 for c in contacts])
    least = length * (column["breaks"] ** 4 - 4.0 / 3.0 * column["breaks"])
    dt, count, every = np.array([s.dt for s in steps]), steps[0].count, steps[0].every
    d, w = np.array([-s.gap for s in steps]), column["speed"].copy()
    force, s = np.zeros(len(contacts)), np.full(len(contacts), TOUCH)
    holds = np.zeros(len(contacts), dtype=bool)
    rows = [(d.copy(), w.copy())]
    for step in range(1, count + 1):
        w -= 0.5 * dt * force / mass
        d += dt * w
        touching = d > 0.0
        holds = jkr & (touching | (holds & (d >= least)))
        deep = np.where(touching, d, 0.0)
        factor = np.where(root, np.sqrt(deep), np.where(power == 0.25, np.sqrt(np.sqrt(deep)), 1.0))
        force = beta * np.where(order == 1.0, deep, deep * np.sqrt(deep)) - pull + damping * factor * w
        force = np.where(touching, np.where(clip, np.maximum(force, 0.0), force), 0.0)
        if jkr.any():
            s = np.where(holds, _state(d / length, s), TOUCH)
            # the radius of contact is sqrt(R L) s^2
            wide = np.where(root, np.sqrt(length) * s * s, 1.0)
            adhesive = column["pull_off"] * (s**6 - 2.0 * s**3) + damping * wide * w
            force = np.where(jkr, np.where(holds, adhesive, 0.0), force)
        w -= 0.5 * dt * force / mass
        if step % every == 0:
            rows.append((d.copy(), w.copy()))
    overlap, closing = (np.array([row[at] for row in rows]) for at in (0, 1))
    return [Motion(overlap=overlap[:, i], closing=closing[:, i], speed=c.speed) for i, c in enumerate(contacts)]


def _state(overlap: Array, s: Array) -> Array:
    """Return the s with ``s^4 - (4/3) s`` = ``overlap`` on the branch of stable contacts, from a nearby one."""
    for _ in range(6):
        slope = 4.0 * s**3 - 4.0 / 3.0
        s = np.maximum(s - (s**4 - 4.0 / 3.0 * s - overlap) / np.where(slope > 1e-6, slope, 1e-6), BREAK + 1e-9)
    return s


#: largest difference of closing speeds between LAMMPS and a twin that repeats it, relative to the closing speed at the
#: start; positions leave 3e-11
TOLERANCE = 1e-9
NOT_A_NUMBER = "velocities are not numbers"
UNKNOWN = "unknown"
#: between two causes
AND = ", and "


def _damping(factor: float) -> Callable[[Impact, Contact], Contact]:
    return lambda impact, c: replace(c, damping=factor * c.damping)


def _mass(factor: float) -> Callable[[Impact, Contact], Contact]:
    """Return the contact with another mass in its damping; a damping by restitution has the root of it."""

    def change(impact: Impact, c: Contact) -> Contact:
        by_root = impact.damping in ("tsuji", "coeff_restitution")
        return c if impact.damping == "velocity" else _damping(math.sqrt(factor) if by_root else factor)(impact, c)

    return change


def _stiffness(factor: float) -> Callable[[Impact, Contact], Contact]:
    """Return the contact with another stiffness, of which a damping by restitution has the root."""

    def change(impact: Impact, c: Contact) -> Contact:
        by_root = impact.damping in ("tsuji", "coeff_restitution")
        return replace(c, stiffness=factor * c.stiffness, damping=c.damping * (math.sqrt(factor) if by_root else 1.0))

    return change


def _radius(factor: float) -> Callable[[Impact, Contact], Contact]:
    """Return the contact with another effective radius."""

    def change(impact: Impact, c: Contact) -> Contact:
        if impact.linear:
            return c
        new = _stiffness(math.sqrt(factor))(impact, c)
        by_area = impact.damping == "viscoelastic" or impact.law == "hertz/history"
        return replace(new, pull_off=factor * c.pull_off, damping=new.damping * (math.sqrt(factor) if by_area else 1.0))

    return change


#: cause -> the physics that it makes of a contact
CAUSES: Mapping[str, Callable[[Impact, Contact], Contact]] = MappingProxyType(
    {
        "the damping lacks a factor sqrt(2)": _damping(math.sqrt(0.5)),
        "the damping has twice the effective mass": _mass(2.0),
        "the damping has half the effective mass": _mass(0.5),
        "the effective radius is twice as large": _radius(2.0),
        "the effective radius is half as large": _radius(0.5),
        "E* is twice as large, that of a rigid wall": _stiffness(2.0),
        "E* is half as large": _stiffness(0.5),
        "E* of a wall has 1 - nu in place of 1 - nu^2": _stiffness(1.0 + POISSON),
        "the net force is not clipped": lambda impact, c: replace(c, clip=False),
        "the net force is clipped": lambda impact, c: replace(c, clip=True),
        "the contact opens at its least force": lambda impact, c: replace(c, breaks=1.0),
        "the contact opens at overlap 0": lambda impact, c: replace(c, breaks=TOUCH),
    }
)


def causes_of(wrong: Sequence[tuple[Impact, Steps, Motion]]) -> list[str]:
    """Return the cause of each wrong impact: the first one or two whose twin repeats LAMMPS.

    Parameters
    ----------
    wrong : sequence of (Impact, Steps, Motion)
        Impacts with what LAMMPS made of them.
    """
    names = [UNKNOWN if motion.finite else NOT_A_NUMBER for *_, motion in wrong]
    for count in (1, 2):
        trials = [
            (at, AND.join(causes), contact)
            for at, (impact, *_) in enumerate(wrong)
            if names[at] == UNKNOWN
            for causes in combinations(CAUSES, count)
            if (contact := _changed(impact, causes)) is not None
        ]
        runs = twins([contact for *_, contact in trials], [wrong[at][1] for at, *_ in trials])
        for (at, cause, _), run in zip(trials, runs, strict=True):
            if names[at] == UNKNOWN and run.difference(wrong[at][2]) <= TOLERANCE:
                names[at] = cause
    return names


def _changed(impact: Impact, causes: Sequence[str]) -> Contact | None:
    """Return the contact of an impact with these causes; None if one of them has no effect."""
    contact = impact.contact
    for cause in causes:
        before, contact = contact, CAUSES[cause](impact, contact)
        if contact == before:
            return None
    return contact
