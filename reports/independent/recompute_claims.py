"""Recompute the numbers of the claims on Chaunsali, Kim & Yang (2018) by means of numpy and scipy alone.

This script imports nothing of ``dem_bridge``. It writes down the chains of the paper from its printed numbers, solves
them with its own integrator, and reads each number off with its own formulas, so that an error of the package cannot
repeat itself here. ``tests/studies/paper/test_recomputed.py`` compares both.

Run it with ``python reports/independent/recompute_claims.py [FILE]``. It prints each number with its definition and
writes them to FILE as JSON (default: ``claims.json`` beside the script); it takes less than two minutes.

Notation: body 0 is the striker, contact k joins bodies k and k + 1, x is positive away from the struck end,
``overlap_k = x_k - x_{k+1} + overlap_k(0)``, ``F_k = beta_k max(overlap_k, 0)^{3/2}``, and
``m_i x_i'' = F_{i-1} - F_i + m_i g`` (eq. 3.2 of the paper). The crossing time c_k of contact k is the first time at
which the velocities of its bodies are equal while it is compressed, which is the paper's t_i^i for i = k + 1. The
residence time of body i is c_i - c_{i-1}.

Sources: the paper (*Phil. Trans. R. Soc. A* 376:20170136, equations by their numbers); Johnson (1985), *Contact
Mechanics*, chapter 4 (ellipse, pressure and tension of a Hertz contact) and section 11.4 (Love's criterion);
Hairer, Norsett & Wanner (1993), *Solving Ordinary Differential Equations I*, section II.14 (Nystroem's method).
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq
from scipy.signal import find_peaks
from scipy.special import ellipe, ellipk, elliprd, gamma

Floats = np.ndarray

# printed numbers of the paper, sections 2 and 3
YOUNG, POISSON, DENSITY, RADIUS, HEIGHT = 72e9, 0.17, 2200.0, 9e-3, 18e-3
STRIKER_MASS, STRIKER_STIFFNESS, SPEED = 8.1e-3, 3.98e9, 0.8
CYLINDER_MASS = DENSITY * np.pi * RADIUS**2 * HEIGHT
ANGLES = (2.0, 90.0)
GRAVITY = 9.81
#: density of crystalline quartz, kg/m^3 (CRC Handbook of Chemistry and Physics: 2648 to 2651)
CRYSTALLINE = 2650.0
#: tensile strength of fused quartz, Pa: a design value of dealers' tables (4.8e7 to 5.0e7)
TENSILE = 4.8e7
#: smallest number of sound crossings in a contact time for which a body counts as one mass (no author states one)
CROSSINGS = 10.0


# ----------------------------------------------------------------------------------------------------------------------
# contact laws


def paper_stiffness(angle: float) -> float:
    """Return beta of eq. 3.1 with the paper's approximate axis ratio, N/m^1.5; ``angle`` in degrees."""
    if angle == 90.0:  # the limit e -> 0
        return 2.0 * YOUNG * np.sqrt(RADIUS) / (3.0 * (1.0 - POISSON**2))
    cosine = np.cos(np.radians(angle))
    ratio = ((1.0 + cosine) / (1.0 - cosine)) ** (-2.0 / 3.0)
    return stiffness_of_ratio(angle, ratio)


def stiffness_of_ratio(angle: float, ratio: float) -> float:
    """Return beta of eq. 3.1 at an axis ratio b/a, N/m^1.5. K and E are functions of m = e^2 = 1 - (b/a)^2."""
    m = 1.0 - ratio**2
    big_k, big_e = ellipk(m), ellipe(m)
    bracket = (big_e / ratio**2 - big_k) * (big_k - big_e)
    shape = (4.0 / (np.pi * m) * np.sqrt(bracket)) ** 0.5
    plane = 2.0 * YOUNG / (3.0 * (1.0 - POISSON**2)) * np.sqrt(RADIUS / np.sin(np.radians(angle)))
    return float(plane * (2.0 * big_k / np.pi) ** -1.5 * shape)


def ratio_of_curvatures(quotient: float) -> float:
    """Return b/a of the exact Hertz solution: [(a/b)^2 E - K]/[K - E] = B/A, the quotient of relative curvatures.

    For crossed cylinders of one radius it is (1 + cos a)/(1 - cos a) (Johnson, eq. 4.28).
    """

    def miss(log_ratio: float) -> float:
        ratio = np.exp(log_ratio)
        m = 1.0 - ratio**2
        return float(np.log((ellipe(m) / ratio**2 - ellipk(m)) / (ellipk(m) - ellipe(m))) - np.log(quotient))

    return float(np.exp(brentq(miss, np.log(1e-5), np.log(1.0 - 1e-6), xtol=1e-14)))


def angle_of(stiffness: float) -> float:
    """Return the contact angle at which eq. 3.1 has a stiffness, degrees."""
    if stiffness <= paper_stiffness(90.0) * (1.0 + 1e-9):
        return 90.0
    return float(brentq(lambda angle: paper_stiffness(angle) / stiffness - 1.0, 1.0, 89.999999, xtol=1e-12))


# ----------------------------------------------------------------------------------------------------------------------
# chains


@dataclass(frozen=True)
class Chain:
    """Hold masses (kg; inf: a body at rest), stiffnesses (N/m^1.5), gravity, start velocities and overlaps."""

    mass: Floats
    stiffness: Floats
    velocity: Floats
    overlap: Floats
    gravity: float = 0.0


def struck(mass: Floats, stiffness: Floats) -> Chain:
    """Return a chain at rest and just in touch, whose body 0 has the paper's striker velocity."""
    velocity = np.zeros(len(mass))
    velocity[0] = SPEED
    return Chain(np.asarray(mass, float), np.asarray(stiffness, float), velocity, np.zeros(len(stiffness)))


def paper_chain(*, rising: bool, count: int = 40, like_first: bool = False, gradient: float = 0.0) -> Chain:
    """Return one of the paper's chains: stiffness linear between eq. 3.1 at 2 and at 90 degrees over contacts 1 to N-1.

    ``like_first``: m_0 = m and beta_0 = beta_1 (section 4b). ``gradient``: gamma of m_i = m (1 + gamma i) (appendix A).
    """
    ends = [paper_stiffness(angle) for angle in ANGLES]
    graded = np.linspace(*(ends[::-1] if rising else ends), count - 1)
    masses = CYLINDER_MASS * (1.0 + gradient * np.arange(1, count + 1))
    if like_first:
        return struck(np.r_[CYLINDER_MASS, masses], np.r_[graded[0], graded])
    return struck(np.r_[STRIKER_MASS, masses], np.r_[STRIKER_STIFFNESS, graded])


def stacked(chain: Chain, *, weight: bool) -> Chain:
    """Return the chain on a rigid base behind its last body, as stiff as the last contact.

    With ``weight`` contact k of the stack bears the cylinders 1 to k, but not the striker, which is dropped and touches
    the first cylinder without overlap at t = 0.
    """
    count = len(chain.mass)
    carried = GRAVITY * np.r_[0.0, np.cumsum(chain.mass[1:])] if weight else np.zeros(count)
    stiffness = np.r_[chain.stiffness, chain.stiffness[-1]]
    return Chain(
        mass=np.r_[chain.mass, np.inf],
        stiffness=stiffness,
        velocity=np.r_[chain.velocity, 0.0],
        overlap=(carried / stiffness) ** (2.0 / 3.0),
        gravity=GRAVITY if weight else 0.0,
    )


def tapered_chain(ratio: float, count: int = 40, radius: float = 9e-3) -> Chain:
    """Return a chain of ``count`` spheres whose radii fall by ``ratio``, struck by a sphere like the first.

    Masses are 4/3 pi R^3 rho. Equal materials: beta = 2 Y/(3 (1 - nu^2)) sqrt(R R'/(R + R')) (Johnson, eq. 4.23).
    """
    radii = radius * np.r_[1.0, ratio ** np.arange(count)]
    together = radii[:-1] * radii[1:] / (radii[:-1] + radii[1:])
    stiffness = 2.0 * YOUNG / (3.0 * (1.0 - POISSON**2)) * np.sqrt(together)
    return struck(4.0 / 3.0 * np.pi * radii**3 * DENSITY, stiffness)


# ----------------------------------------------------------------------------------------------------------------------
# integration


@dataclass(frozen=True)
class Run:
    """Hold the samples of one chain: time ``(n,)``, displacement, velocity and acceleration ``(n, bodies)``."""

    chain: Chain
    time: Floats
    x: Floats
    v: Floats
    a: Floats

    @property
    def overlap(self) -> Floats:
        """Return the overlap of each contact at each sample, m; negative: a gap."""
        return self.x[:, :-1] - self.x[:, 1:] + self.chain.overlap

    @cached_property
    def crossing(self) -> tuple[Floats, Floats]:
        """Return the result of :func:`crossing_of`."""
        return crossing_of(self)


def accelerations(chains: list[Chain]) -> Callable[[Floats], Floats]:
    """Return the function x -> x'' of eq. 3.2 for chains of one length, stacked as rows."""
    stiffness, offset = (np.array([getattr(chain, name) for chain in chains]) for name in ("stiffness", "overlap"))
    inverse = np.array([1.0 / chain.mass for chain in chains])
    weight = np.array([np.where(np.isinf(chain.mass), 0.0, chain.gravity) for chain in chains])
    force = np.zeros((len(chains), inverse.shape[1] + 1))

    def acceleration(x: Floats) -> Floats:
        overlap = np.maximum(x[:, :-1] - x[:, 1:] + offset, 0.0)
        force[:, 1:-1] = stiffness * overlap * np.sqrt(overlap)
        return (force[:, :-1] - force[:, 1:]) * inverse + weight

    return acceleration


def integrate(chains: list[Chain], duration: float, step: float, every: int) -> list[Run]:
    """Integrate chains of one length together by Nystroem's method of order 4, and keep every ``every``-th step.

    x' = x + h v + h^2 (k1 + 2 k2)/6 and v' = v + h (k1 + 4 k2 + k3)/6 with k1 = f(x), k2 = f(x + h v/2 + h^2 k1/8) and
    k3 = f(x + h v + h^2 k2/2) (Hairer et al. 1993, section II.14). The force is only once differentiable at touch, so
    that the observed order is about 2.5; :func:`convergence` shows the error.
    """
    f, count = accelerations(chains), round(duration / (step * every))
    v = np.array([chain.velocity for chain in chains])
    x = np.zeros_like(v)
    kept = np.empty((3, count + 1, *v.shape))
    k1 = f(x)
    kept[:, 0] = x, v, k1
    half, eighth, whole, sixth = step / 2.0, step**2 / 8.0, step**2 / 2.0, step / 6.0
    for sample in range(1, count + 1):
        for _ in range(every):
            k2 = f(x + half * v + eighth * k1)
            k3 = f(x + step * v + whole * k2)
            x = x + step * v + step * sixth * (k1 + 2.0 * k2)
            v = v + sixth * (k1 + 4.0 * k2 + k3)
            k1 = f(x)
        kept[:, sample] = x, v, k1
    when = step * every * np.arange(count + 1)
    return [Run(chain, when, *(part[:, row] for part in kept)) for row, chain in enumerate(chains)]


# ----------------------------------------------------------------------------------------------------------------------
# observables


def crossing_of(run: Run) -> tuple[Floats, Floats]:
    """Return the time of the first maximal compression of each contact, and its force; nan where there is none.

    A maximum counts from a twentieth of the contact's largest compression on, beyond that at the start, so that the
    small motions of a stack ahead of the front do not count. Between samples the closing rate is the cubic Hermite
    polynomial through rates and their derivatives.
    """
    overlap, rate, change = run.overlap, run.v[:, :-1] - run.v[:, 1:], run.a[:, :-1] - run.a[:, 1:]
    count = overlap.shape[1]
    when, force = np.full(count, np.nan), np.full(count, np.nan)
    for k in range(count):
        rise = overlap[:, k] - max(run.chain.overlap[k], 0.0)
        turns = (rate[:-1, k] > 0.0) & (rate[1:, k] <= 0.0) & (rise[1:] > 0.05 * rise.max()) & (overlap[1:, k] > 0.0)
        rows = np.flatnonzero(turns)
        if len(rows) == 0:
            continue
        pick = slice(rows[0], rows[0] + 2)
        curve = CubicHermiteSpline(run.time[pick], rate[pick, k], change[pick, k])
        when[k] = brentq(curve, *run.time[pick], xtol=1e-18)
        deepest = overlap[rows[0], k] + curve.integrate(run.time[rows[0]], when[k])
        force[k] = run.chain.stiffness[k] * deepest**1.5
    return when, force


def largest_force(run: Run, contact: int) -> float:
    """Return the largest force of a contact in the whole run, N; between samples overlaps are cubic Hermite."""
    overlap, rate = run.overlap[:, contact], run.v[:, contact] - run.v[:, contact + 1]
    row = int(np.clip(np.argmax(overlap), 1, len(overlap) - 2))
    pick = slice(row - 1, row + 2)
    curve = CubicHermiteSpline(run.time[pick], overlap[pick], rate[pick])
    deepest = max(float(overlap[row]), *curve(curve.derivative().roots(extrapolate=False)))
    return float(run.chain.stiffness[contact] * deepest**1.5)


def front_velocity(run: Run) -> Floats:
    """Return the peak velocity of each body in the leading front: its maximum between c_{i-1} and c_i, m/s."""
    times, _ = run.crossing
    peak = np.full(len(run.chain.mass), np.nan)
    for i in range(1, len(peak) - 1):
        low, high = np.searchsorted(run.time, times[[i - 1, i]]) if np.all(np.isfinite(times[[i - 1, i]])) else (0, 0)
        if high - low < 1:
            continue
        # one sample further on each side, which does not matter to a maximum inside
        rows = slice(low - 1, high + 1)
        curve = CubicHermiteSpline(run.time[rows], run.v[rows, i], run.a[rows, i])
        turning = curve.derivative().roots(extrapolate=False)
        peak[i] = np.max(curve(turning)) if len(turning) else np.max(run.v[rows, i])
    return peak


def half_times(run: Run) -> tuple[Floats, Floats]:
    """Return the times at which the force of each contact rises to half its first peak, and falls back to it, s."""
    times, forces = run.crossing
    rises, falls = np.full(len(times), np.nan), np.full(len(times), np.nan)
    overlap, rate = run.overlap, run.v[:, :-1] - run.v[:, 1:]
    for k in np.flatnonzero(np.isfinite(times)):
        half = (0.5 * forces[k] / run.chain.stiffness[k]) ** (2.0 / 3.0)
        above = overlap[:, k] > half
        peak = int(np.searchsorted(run.time, times[k]))
        up, down = np.flatnonzero(~above[:peak])[-1:], peak + np.flatnonzero(~above[peak:])[:1] - 1
        for rows, target in ((up, rises), (down, falls)):
            for row in rows:
                pick = slice(row, row + 2)
                curve = CubicHermiteSpline(run.time[pick], overlap[pick, k] - half, rate[pick, k])
                target[k] = brentq(curve, *run.time[pick], xtol=1e-18)
    return rises, falls


def passage_width(run: Run, contact: int) -> float:
    """Return the time that a contact's force is above half its first peak, over the front's time per contact there.

    The time per contact at contact k is (c_{k+1} - c_{k-1})/2. In a solitary wave this is its width at half force.
    """
    times, _ = run.crossing
    rises, falls = half_times(run)
    return float((falls[contact] - rises[contact]) / (0.5 * (times[contact + 1] - times[contact - 1])))


def window_energy(run: Run, contact: int, *, reach: int = 2, stored: bool = True) -> float:
    """Return the energy of the front in a window of fixed length at the first peak of a contact, J.

    Bodies k - ``reach`` to k + 1 + ``reach`` count with their kinetic energies and, with ``stored``, the contacts
    between them with 2/5 beta overlap^(5/2). States between samples are cubic Hermite polynomials.
    """
    when = run.crossing[0][contact]
    row = int(np.searchsorted(run.time, when)) - 1
    pick, bodies = slice(row, row + 2), slice(contact - reach, contact + reach + 2)
    x = CubicHermiteSpline(run.time[pick], run.x[pick, bodies], run.v[pick, bodies])(when)
    v = CubicHermiteSpline(run.time[pick], run.v[pick, bodies], run.a[pick, bodies])(when)
    contacts = slice(contact - reach, contact + reach + 1)
    overlap = np.maximum(x[:-1] - x[1:] + run.chain.overlap[contacts], 0.0)
    elastic = np.sum(0.4 * run.chain.stiffness[contacts] * overlap**2.5) if stored else 0.0
    return float(np.sum(0.5 * run.chain.mass[bodies] * v**2) + elastic)


def front_energy(run: Run, body: int) -> float:
    """Return m v^2/2 of one body at its peak velocity in the front, J."""
    return float(0.5 * run.chain.mass[body] * front_velocity(run)[body] ** 2)


@dataclass(frozen=True)
class Pulse:
    """Hold the peak velocity (m/s), its time, and the duration above half of it (s) of a pulse at one body."""

    velocity: float
    time: float
    duration: float


def pulses(run: Run, body: int, *, share: float = 0.05) -> list[Pulse]:
    """Return the maxima of a body's velocity that reach ``share`` of the first and rise as much above their dips.

    All maxima of the run count.
    """
    v, first = run.v[:, body], front_velocity(run)[body]
    rows, _ = find_peaks(v, height=share * first, prominence=share * first)
    result = []
    for row in rows:
        curve = between_samples(run, body, row - 1)
        time = float(curve.derivative().roots(extrapolate=False)[0])
        half = 0.5 * float(curve(time))
        below = v < half
        sides = []
        for edge in (np.flatnonzero(below[:row])[-1], row + np.flatnonzero(below[row:])[0] - 1):
            side = between_samples(run, body, edge, less=half)
            sides.append(float(side.roots(extrapolate=False)[0]))
        result.append(Pulse(2.0 * half, time, sides[1] - sides[0]))
    return result


def between_samples(run: Run, body: int, row: int, *, less: float = 0.0) -> CubicHermiteSpline:
    """Return a body's velocity less a value as a function of time from a sample to the next but one."""
    pick = slice(row, row + 3)
    return CubicHermiteSpline(run.time[pick], run.v[pick, body] - less, run.a[pick, body])


# ----------------------------------------------------------------------------------------------------------------------
# binary collisions


def collision_times(chain: Chain) -> Floats:
    """Return T_i of eq. 3.3 with the velocities of eq. 3.4, for i = 0 (the striker) to the last contact, s."""
    n = 2.5
    v, times = chain.velocity[0], []
    for i, beta in enumerate(chain.stiffness):
        one, other = chain.mass[i], chain.mass[i + 1]
        mu = one * other / (one + other)
        shape = np.sqrt(np.pi) * gamma(1.0 + 1.0 / n) / gamma(0.5 + 1.0 / n)
        times.append(shape * (n * mu / (2.0 * beta)) ** (1.0 / n) * v ** (-1.0 + 2.0 / n))
        v = 2.0 * v / (1.0 + other / one)
    return np.array(times)


def handed_over(mass_ratio: float) -> dict[str, float]:
    """Integrate one collision by DOP853 and return what has happened after the time T of eq. 3.3 and after 2 T.

    Body 0 with v = 1 and m = 1 hits a body at rest of mass ``mass_ratio``; beta = 1.
    """
    chain = Chain(np.array([1.0, mass_ratio]), np.ones(1), np.array([1.0, 0.0]), np.zeros(1))
    period = collision_times(chain)[0]

    def rate(_: float, state: Floats) -> Floats:
        overlap = max(state[0] - state[1], 0.0)
        force = overlap * np.sqrt(overlap)
        return np.array([state[2], state[3], -force, force / mass_ratio])

    run = solve_ivp(
        rate, (0.0, 2.0 * period), [0.0, 0.0, 1.0, 0.0], "DOP853", [period, 2.0 * period], rtol=1e-11, atol=1e-13
    )
    momentum = mass_ratio * run.y[3]
    return {"share at T": float(momentum[0] / momentum[1]), "overlap left at 2 T": float(run.y[0, 1] - run.y[1, 1])}


# ----------------------------------------------------------------------------------------------------------------------
# validity


def contact_state(run: Run, contact: int) -> dict[str, float]:
    """Return the ratios that tell whether Hertz' law and lumped masses apply to a contact at its largest force.

    The exact Hertz law at the contact's angle: with 1/r = A + B, E* = Y/(2 (1 - nu^2)) and k = b/a,
    b^3 = 3 F k E(e)/(2 pi E* (A + B)), p0 = 3 F/(2 pi a b), overlap = p0 b K(e)/E* (Johnson, section 4.2). The contact
    time is that of a collision of these two bodies with this largest force; sound crosses a diameter in
    2 r sqrt(rho/Y). The tension at the ends of the ellipse is (1 - 2 nu) p0 k R_D(k^2, k^2, 1)/3 (Johnson, section
    4.3).
    """
    force = largest_force(run, contact)
    if contact == 0:  # sphere on cylinder: relative curvatures 1/(2 r) and 1/r
        ratio, curvature = ratio_of_curvatures(2.0), 1.5 / RADIUS
    else:
        angle = angle_of(run.chain.stiffness[contact])
        cosine = np.cos(np.radians(angle))
        curvature = 1.0 / RADIUS
        ratio = 1.0 if angle == 90.0 else ratio_of_curvatures((1.0 + cosine) / (1.0 - cosine))
    m = 1.0 - ratio**2
    modulus = YOUNG / (2.0 * (1.0 - POISSON**2))
    minor = (3.0 * force * ratio * ellipe(m) / (2.0 * np.pi * modulus * curvature)) ** (1.0 / 3.0)
    pressure = 3.0 * force * ratio / (2.0 * np.pi * minor**2)
    overlap = pressure * minor * ellipk(m) / modulus
    mu = 1.0 / (1.0 / run.chain.mass[contact] + 1.0 / run.chain.mass[contact + 1])
    speed = np.sqrt(0.8 * force * overlap / mu)
    lasts = 2.0 * np.sqrt(np.pi) * gamma(1.4) / gamma(0.9) * overlap / speed
    tension = (1.0 - 2.0 * POISSON) * pressure * ratio * elliprd(ratio**2, ratio**2, 1.0) / 3.0
    return {
        "crossings": float(lasts / (2.0 * RADIUS * np.sqrt(DENSITY / YOUNG))),
        "tension": float(tension / TENSILE),
        "ellipse": float(minor / ratio / (0.5 * HEIGHT)),
    }


# ----------------------------------------------------------------------------------------------------------------------
# the numbers of the claims


def exponents(run: Run) -> dict[str, float]:
    """Return the slope of ln F_max against ln beta over contacts 20 to 189, and its range over windows.

    The first tenth, where the pulse forms, and the last twentieth, which feels the free end, are left out. Windows are
    0.9 to 0.5 of this range at its start, in its middle and at its end.
    """
    _, force = run.crossing
    x, y = np.log(run.chain.stiffness[20:190]), np.log(force[20:190])
    slopes = []
    for part in (1.0, 0.9, 0.8, 0.7, 0.6, 0.5):
        size = round(part * len(x))
        rest = len(x) - size
        slopes += [np.polyfit(x[start : start + size], y[start : start + size], 1)[0] for start in (0, rest // 2, rest)]
    return {"whole": float(slopes[0]), "least": float(min(slopes)), "largest": float(max(slopes))}


def passage(run: Run) -> dict[str, float]:
    """Return the three observables of the first passage of a chain of 40 on which the effect of weight is measured.

    Forces are those at the first maximal compression of a contact, so that no reflection counts.
    """
    times, force = run.crossing
    return {
        "arrival at the last cylinder": float(times[39]),
        "speed at the middle": float(1.0 / (times[20] - times[19])),
        "force at the middle": float(force[20]),
    }


def chains_of_40() -> dict[str, Chain]:
    """Return the paper's two chains of 40, and each with one change, by name."""
    slow, fast = paper_chain(rising=False), paper_chain(rising=True)
    mass, stiffness = np.r_[slow.mass[1], slow.mass[1:]], np.r_[slow.stiffness[1], slow.stiffness[1:]]
    soft = np.r_[fast.stiffness[1] * slow.stiffness[0] / slow.stiffness[1], fast.stiffness[1:]]
    return {
        "decelerating-40": slow,
        "accelerating-40": fast,
        "decelerating-40.matched-stiffness": struck(slow.mass, stiffness),
        "decelerating-40.matched-mass": struck(mass, slow.stiffness),
        "decelerating-40.matched": struck(mass, stiffness),
        "accelerating-40.mismatched-stiffness": struck(fast.mass, soft),
    }


@dataclass(frozen=True)
class Number:
    """Hold one recomputed number of a claim."""

    claim: str
    """Id of the claim in the report of the project."""
    name: str
    value: float
    definition: str


def of_tapers(factor: float) -> Iterator[Number]:
    """Yield the numbers of tapered chains; steps are ``factor`` times as long."""
    energy = "m v^2/2 of sphere 36 over that of sphere 10, each at its peak velocity in the front"
    window = "kinetic energy of six bodies at the peak of their middle contact, at contact 36 over contact 10"
    breadth = "time above half force over the front's time per contact, at contact 20"
    chains = {
        "uniform spheres": (1.0, 1e-7, 1.2e-3),
        "tapered-forward": (0.98, 1e-7, 1.0e-3),
        "tapered-forward.5-percent": (0.95, 5e-8, 6e-4),
        "tapered-forward.10-percent": (0.9, 1e-8, 3e-4),
    }
    for name, (ratio, step, duration) in chains.items():
        run = integrate([tapered_chain(ratio)], duration, factor * step, round(4 / factor))[0]
        of_body = front_energy(run, 36) / front_energy(run, 10)
        of_window = window_energy(run, 36, stored=False) / window_energy(run, 10, stored=False)
        yield Number("tapered", f"kinetic energy of one body kept, {name}", of_body, energy)
        yield Number("tapered", f"kinetic energy in a window kept, {name}", of_window, window)
        yield Number("tapered-width", f"width at half force, {name}", passage_width(run, 20), breadth)


def of_collisions(name: str, run: Run) -> Iterator[Number]:
    """Yield the numbers of the BCA on one of the paper's chains of 40."""
    times, _ = run.crossing
    theory, residence = collision_times(run.chain), np.r_[np.nan, np.diff(times)]
    off = theory[1:40] / residence[1:40] - 1.0  # cylinder i at i - 1
    inner = off[2:38]
    yield Number(
        "residence-by-bca",
        f"largest deviation of T_i, {name}",
        float(inner[np.argmax(np.abs(inner))]),
        "eq. 3.3 over the simulated residence time less 1, cylinders 3 to 38",
    )
    yield Number(
        "residence-by-bca", f"deviation of T_39, {name}", float(off[38]), "the same at cylinder 39, the last but one"
    )
    end, printed = times[39], float(np.sum(theory[1:40]))
    yield Number(
        "arrival-as-printed",
        f"as printed, {name}",
        printed / end - 1.0,
        "eq. 3.7 from j = 1 over the arrival counted from the impact, less 1, at cylinder 40",
    )
    yield Number(
        "arrival-by-bca", f"with T_0, {name}", (theory[0] + printed) / end - 1.0, "the same with the sum from j = 0"
    )
    yield Number(
        "arrival-as-printed",
        f"from the first crossing, {name}",
        printed / (end - times[0]) - 1.0,
        "eq. 3.7 from j = 1 over the arrival counted from the first crossing, less 1",
    )
    speed = "V = 2 r over the residence time; cylinder 38 over cylinder 3"
    claim = "decelerates" if name.startswith("decelerating") else "accelerates"
    yield Number(claim, f"V_out/V_in, {name}", residence[3] / residence[38], speed)
    for (low, high), (early, late) in (((2, 6), (35, 38)), ((1, 6), (35, 39))):
        ratios = [residence[a] / residence[b] for a in range(low, high + 1) for b in range(early, late + 1)]
        where = f"inputs {low} to {high}, outputs {early} to {late}, {name}"
        for place, value in (("least", min(ratios)), ("largest", max(ratios))):
            yield Number(
                "speed-ratio-sensitivity", f"{place} V_out/V_in, {where}", value, "over all pairs of cylinders"
            )


def of_validity(name: str, run: Run) -> Iterator[Number]:
    """Yield the validity ratios of one of the paper's chains of 40, over its contacts 0 to 39."""
    states = [contact_state(run, contact) for contact in range(40)]
    crossings, tensions, ellipses = (
        np.array([state[key] for state in states]) for key in ("crossings", "tension", "ellipse")
    )
    yield Number(
        "lumped-mass",
        f"contacts below ten crossings, two bodies, {name}",
        int(np.sum(crossings < CROSSINGS)),
        "contact time of the two bodies over 2 r sqrt(rho/Y)",
    )
    yield Number(
        "lumped-mass", f"fewest crossings, two bodies, {name}", float(crossings.min()), "the least of these ratios"
    )
    yield Number(
        "edge-tension",
        f"contacts above the strength, {name}",
        int(np.sum(tensions > 1.0)),
        "tension at the ellipse's edge over 48 MPa",
    )
    yield Number(
        "edge-tension", f"largest tension over strength, {name}", float(tensions.max()), "the largest of these ratios"
    )
    yield Number(
        "point-contact",
        f"ellipses beyond the cylinder, {name}",
        int(np.sum(ellipses > 1.0)),
        "semi-major axis over half the height",
    )
    yield Number("point-contact", f"longest ellipse, {name}", float(ellipses.max()), "the largest of these ratios")


def of_trailing(runs: dict[str, Run]) -> Iterator[Number]:
    """Yield the numbers of pulses behind the front of chains of 40."""
    claims = {
        "decelerating-40": "many-fronts",
        "accelerating-40": "one-front",
        "accelerating-40.mismatched-stiffness": "small-mismatch",
    }
    for name, run in runs.items():
        for body in (10, 20, 30):
            yield Number(
                claims.get(name, "mismatch"),
                f"further pulses at cylinder {body}, {name}",
                len(pulses(run, body)) - 1,
                "later maxima of at least 5 % of the first and as much above their dips",
            )
    for body in (10, 20, 30):
        first, second = pulses(runs["decelerating-40"], body)[:2]
        share, lasts = second.velocity / first.velocity, second.duration / first.duration
        yield Number(
            "similar-pulses",
            f"amplitude of the second pulse at cylinder {body}, decelerating-40",
            share,
            "peak velocity over that of the front",
        )
        yield Number(
            "similar-pulses",
            f"scaled duration of the second pulse at cylinder {body}, decelerating-40",
            lasts * share**0.2,
            "time above half its peak velocity over that of the front, times (amplitude)^(1/5): 1 for the same shape",
        )


def of_gravity(runs: dict[str, Run], factor: float) -> Iterator[Number]:
    """Yield the effects of weight on a chain that stands on a base, whose striker is dropped."""
    names = ("decelerating-40", "accelerating-40")
    stacks = [stacked(runs[name].chain, weight=weight) for name in names for weight in (False, True)]
    made = integrate(stacks, 1.0e-3, factor * 1e-7, round(4 / factor))
    for row, name in enumerate(names):
        without, heavy = passage(made[2 * row]), passage(made[2 * row + 1])
        for key, value in heavy.items():
            yield Number(
                "gravity-neglected",
                f"{key}, {name}",
                value / without[key],
                "with the weight over without it, both on a base, the striker touching without overlap",
            )


def of_long_chains(factor: float) -> Iterator[Number]:
    """Yield the numbers of the chains of 200 cylinders."""
    names = {"decelerating-200": False, "accelerating-200": True}
    chains = [paper_chain(rising=rising, count=200, like_first=True) for rising in names.values()]
    fit = "slope of ln F_max against ln beta, contacts 20 to 189; least and largest over windows"
    energy, window = (
        "m v^2/2 of cylinder 180 over that of cylinder 50",
        "kinetic and elastic energy, contact 180 over 50",
    )
    for name, run in zip(names, integrate(chains, 2.8e-3, factor * 2e-7, round(4 / factor)), strict=True):
        for key, value in exponents(run).items():
            label = f"{key} force exponent, {name}".removeprefix("whole ")
            yield Number(f"force-exponent-{name.split('-')[0]}", label, value, fit)
        of_body = front_energy(run, 180) / front_energy(run, 50)
        yield Number("kinetic-energy-kept", f"kinetic energy of one body kept, {name}", of_body, energy)
        kept = window_energy(run, 180) / window_energy(run, 50)
        yield Number("no-scattering", f"energy in a window kept, {name}", kept, window)


def numbers(factor: float = 1.0) -> list[Number]:
    """Return all numbers, at steps of ``factor`` times the usual ones."""
    chains = chains_of_40()
    runs = dict(zip(chains, integrate(list(chains.values()), 1.5e-3, factor * 1e-7, round(4 / factor)), strict=True))
    result = list(of_tapers(factor))
    window = "kinetic and elastic energy of six bodies and five contacts, contact 36 over contact 10"
    for name in ("decelerating-40", "accelerating-40"):
        kept = window_energy(runs[name], 36) / window_energy(runs[name], 10)
        result.append(Number("no-scattering", f"energy in a window kept, {name}", kept, window))
        result += [*of_collisions(name, runs[name]), *of_validity(name, runs[name])]
    result += [*of_trailing(runs), *of_gravity(runs, factor), *of_long_chains(factor)]
    collision = "one collision of two bodies by DOP853; T is that of eq. 3.3"
    for key, value in handed_over(1.0).items():
        result.append(Number("residence-definition", f"{key}, masses 1 : 1", value, collision))
    volume = 4.0 / 3.0 * np.pi * RADIUS**3
    result.append(
        Number("striker-mass", "4/3 pi r^3 rho, crystalline quartz", volume * CRYSTALLINE, "rho = 2650 kg/m^3")
    )
    return result


def by_dop853(run: Run) -> float:
    """Return the largest difference of velocities, relative to the largest, from DOP853 of scipy with tolerance 1e-12.

    It integrates straight through openings and closings, which limits it to about 1e-8 on this chain.
    """
    f, count = accelerations([run.chain]), len(run.chain.mass)

    def rate(_: float, state: Floats) -> Floats:
        return np.r_[state[count:], f(state[None, :count])[0]]

    start, when = np.r_[run.x[0], run.v[0]], run.time[::50]
    other = solve_ivp(rate, when[[0, -1]], start, "DOP853", when, rtol=1e-12, atol=1e-16)
    return float(np.max(np.abs(other.y[count:].T - run.v[::50])) / np.max(np.abs(run.v)))


def recompute() -> dict[str, Any]:
    """Return all numbers with the change that twice the step makes, and checks of the integrator."""
    fine, coarse = numbers(), numbers(2.0)
    chain = paper_chain(rising=False)
    run = integrate([chain], 1.0e-3, 1e-7, 4)[0]
    momentum = np.sum(chain.mass * run.v, axis=1)
    return {
        "schema": "recomputed-claims/1",
        "checks": {
            "velocity, largest difference from DOP853, relative": by_dop853(run),
            "momentum, largest change, relative": float(np.max(np.abs(momentum / momentum[0] - 1.0))),
        },
        "numbers": [
            asdict(a) | {"change at twice the step": abs(b.value - a.value)} for a, b in zip(fine, coarse, strict=True)
        ],
    }


def main(file: Path) -> None:
    """Print all numbers and write them to a file."""
    result = recompute()
    for key, value in result["checks"].items():
        print(f"{key}: {value:.1e}")
    for item in result["numbers"]:
        value = f"{item['value']:.6g} (twice the step: {item['change at twice the step']:.0e})"
        print(f"{item['claim']}: {item['name']}: {value}; {item['definition']}")
    file.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("claims.json"))
