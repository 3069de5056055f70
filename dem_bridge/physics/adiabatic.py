"""The adiabatic solitary wave: the leading pulse of a chain whose masses, stiffnesses and exponents vary slowly.

Locally the pulse is the exact wave of the discrete uniform chain (:mod:`.solitary`), and it conserves its energy E.
With A^n = E / (beta e), and R, V, e, p the peak overlap, peak velocity, energy and momentum of the shape at A = 1::

    peak force = beta (A R)^(n-1)      speed = sqrt(beta A^(n-2) / m)      shift D = A p
    peak velocity = V sqrt(E / (e m))  momentum P = p sqrt(m E / e)

This is order 0: for one mass and one n, the force scales as beta^(1/n) and the velocity is constant. Order 1 adds the
effect of a gradient, derived from conservation of momentum and energy; nothing in it is fitted.

* The momentum that the pulse loses stays with the body that it has passed: u = -(dP/dk) / m, and with it the energy
  m u^2 / 2. In the limit n -> infinity this is the rebound of the binary collision.
* Bodies are shifted by different D, so behind the pulse a contact is left with J = -dD/dk + u / speed. J < 0 is a gap;
  J > 0 is an overlap, which holds the energy beta J^n / n and pushes a body for the time 1 / speed.
* The pulse runs into bodies at rest that touch, and leaves J and u behind. A reversal of time and space changes the
  sign of the gradient, so a quantity that is even about the peak has no first order, apart from the mean of the states
  ahead and behind. To first order the local wave is therefore that of a uniform chain that is pressed by J/2 and moves
  with u/2. :func:`response` computes this wave.

On a chain of one mass and stiffness exp(eps k), n = 5/2, ln of peak force, peak velocity and speed thus change by
-0.3994,
-0.4891 and +0.2608 times eps relative to order 0. Long runs of the reference at eps = -0.01 give -0.3901, -0.4806 and
+0.2605; the remainder scales as eps^2 (with the coefficient -0.9 for the force). The pulse loses no energy on a chain
that softens, and 0.2 eps^(5/2) of its energy per body on one that stiffens. On the paper's 200 cylinders the force
scales as beta^0.3948 where they soften and beta^0.4067 where they stiffen (contacts 5 to 194). The theory gives 0.3940
and 0.4057;
0.0006 of each difference is the term in eps^2.

The theory is valid for single pulses in elastic chains at rest that just touch, for n from 2.1 to 50 and for changes
that are small over the width of the wave, five bodies. It is not valid for the last few bodies before an end.

:func:`launched` computes the share of a striker's energy that goes into the pulse, and the timing of the pulse. No
theory gives this share, but for each exponent and ratio of striker to chain one solution holds at all scales: the
motion of the first bodies, integrated once until the pulse has formed.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dem_bridge.physics.contact_law import Floats
from dem_bridge.physics.numbers import above
from dem_bridge.physics.solitary import filtered, grid, wave_shape

#: below this exponent the wave is tens of bodies wide and needs hundreds of bodies to form
LEAST_EXPONENT, MOST_EXPONENT = 2.1, 50.0


class Local(NamedTuple):
    """The wave of a uniform chain and its first-order response, at m = beta = speed = 1.

    The entries are those of one exponent, or arrays with an entry for each contact.
    """

    exponent: Any
    peak_overlap: Any
    peak_velocity: Any
    momentum: Any
    energy: Any
    pressed: Any
    """Three derivatives of ln(peak force, peak velocity, speed) at constant energy, by J / peak overlap."""
    moving: Any
    """The same derivatives by u / peak velocity."""


@functools.lru_cache(maxsize=1024)
def response(exponent: float) -> Local:
    """Return the wave of one exponent and its response to a chain that is pressed by J/2 and moves with u/2.

    The equation is linearised about the wave, r' = 1 + tent * (n-1) r^(n-2) r' for a unit overlap far ahead and behind.
    The amplitude is then changed so that the energy stays the same.

    Parameters
    ----------
    exponent : float
        Exponent n of the energy.

    Examples
    --------
    >>> hertz = response(2.5)
    >>> [f"{x:.4f}" for x in (*hertz.pressed, *hertz.moving)]
    ['-0.5473', '-0.6702', '0.3574', '-0.4685', '0.1096', '-0.0781']
    """
    shape = wave_shape(exponent)
    n, p, points = shape.exponent, shape.exponent - 1.0, len(shape.overlap) - 1
    modes = np.arange(points + 1)
    cosines = np.cos(np.pi / points * np.outer(modes, modes))
    r, v = np.maximum(cosines @ shape.overlap, 0.0), cosines @ shape.velocity
    box, weight = grid(shape.half_length, points)
    slope, unit = p * r ** (p - 1.0), np.eye(points + 1)
    overlap_gain = np.linalg.solve(unit - filtered(box**2, unit) * slope, np.ones(points + 1))
    velocity_gain = filtered(box, slope * overlap_gain)
    (top, fastest), energy = shape.peaks, shape.kinetic + shape.potential

    def at_constant_energy(overlap: float, velocity: float, energy_gain: float) -> tuple[float, float, float]:
        scale = -energy_gain / (n * energy)  # relative change of the amplitude; the energy is its n-th power
        return p * (overlap / top + scale), velocity / fastest + 0.5 * n * scale, (0.5 * n - 1.0) * scale

    half = 0.5 * top
    energy_gain = float(weight @ (r**p * overlap_gain) + weight @ (v * velocity_gain))
    return Local(
        exponent=n,
        peak_overlap=top,
        peak_velocity=fastest,
        momentum=shape.momentum,
        energy=energy,
        pressed=at_constant_energy(half * float(overlap_gain[0]), half * float(velocity_gain[0]), half * energy_gain),
        moving=at_constant_energy(0.0, 0.5 * fastest, 0.5 * fastest * shape.momentum),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class AdiabaticWave:
    """The leading pulse along a chain, at each contact ``(n_contact,)`` or body ``(n_body,)``.

    :func:`adiabatic_wave` computes it.
    """

    energy: Floats
    """Energy of the pulse as it passes each contact, J."""
    momentum: Floats
    """Momentum of the pulse as it passes each contact, kg m/s: the impulse that the contact transmits."""
    peak_force: Floats
    """Peak force of each contact, N."""
    peak_velocity: Floats
    """Peak velocity of each body, m/s; the first and last are computed as if the chain continued."""
    transit: Floats
    """Time from the peak of contact i-1 to that of contact i for each body i, s: the paper's residence time.

    The first and last are computed as if the chain continued.
    """
    left_velocity: Floats
    """Velocity of each body after the pulse has passed, m/s."""
    left_overlap: Floats
    """Overlap of each contact after the pulse has passed, m; negative: a gap."""


def adiabatic_wave(
    *,
    mass: ArrayLike,
    stiffness: ArrayLike,
    exponent: ArrayLike,
    energy: float | None = None,
    peak_velocity: float | None = None,
    at: int = 0,
    order: int = 1,
) -> AdiabaticWave:
    """Return the leading pulse of a chain from its energy or its peak velocity at one place.

    A contact k has its own stiffness and the geometric mean of the masses on both sides; a body has its own mass and
    the geometric mean of the speeds of both contacts. Both are even about their place, so that the discretisation adds
    no error of first order in the gradient.

    Parameters
    ----------
    mass : array_like
        Masses, kg, ``(n_body,)``.
    stiffness : array_like
        Stiffnesses, N/m^(n-1), ``(n_body - 1,)``.
    exponent : array_like
        Exponent n: one number, or one per contact.
    energy : float, optional
        Energy of the pulse at contact ``at``, J.
    peak_velocity : float, optional
        Peak velocity of body ``at``, m/s. Give either this or ``energy``.
    at : int
        Contact or body at which the pulse is prescribed.
    order : int
        0 conserves the energy and uses the wave of a uniform chain at each place; 1 adds the effect of the gradients.

    Raises
    ------
    ValueError
        If a parameter is outside its range.

    Examples
    --------
    >>> wave = adiabatic_wave(mass=[1.0] * 9, stiffness=0.9 ** np.arange(8), exponent=2.5, peak_velocity=1.0, order=0)
    >>> [f"{x:.6f}" for x in np.log(wave.peak_force[4:6] / wave.peak_force[3:5]) / np.log(0.9)]
    ['0.400000', '0.400000']
    >>> f"{wave.energy[0]:.10f} {wave.momentum[0]:.10f} {1.0 / (wave.transit[1] * 0.9**0.2):.12f}"
    '1.0693229458 1.6699712493 0.907470078412'
    """
    chain = _Chain.of(mass, stiffness, exponent)
    if (energy is None) == (peak_velocity is None):
        count = "neither is" if energy is None else "both are"
        raise ValueError(f"energy, peak_velocity: {count} given; allowed: exactly one, since it determines the other")
    if order not in (0, 1):
        raise ValueError(f"order = {order!r}; allowed: 0 or 1")
    places = len(chain.stiffness) + (energy is None)
    if isinstance(at, bool) or not isinstance(at, int) or not 0 <= at < places:
        raise ValueError(f"at = {at!r}; allowed: 0 to {places - 1}")
    if energy is not None:
        return chain.wave(above(0.0, "energy", energy, "J"), at, order)
    velocity = above(0.0, "peak_velocity", peak_velocity, "m/s")
    start, start_energy = min(at, len(chain.stiffness) - 1), float(chain.mass[at]) * velocity**2
    for _ in range(
        6
    ):  # energy is proportional to velocity squared: one pass is exact for one n, and nearly so for several
        start_energy *= (velocity / float(chain.wave(start_energy, start, order).peak_velocity[at])) ** 2
    return chain.wave(start_energy, start, order)


@dataclass(frozen=True, eq=False)
class _Chain:
    """A chain's masses ``(n_body,)`` and stiffnesses, and the local wave of each contact."""

    mass: Floats
    stiffness: Floats
    local: Local

    @classmethod
    def of(cls, mass: ArrayLike, stiffness: ArrayLike, exponent: ArrayLike) -> _Chain:
        """Return the checked chain of these masses, stiffnesses and exponents."""
        m, beta = np.array(mass, dtype=float), np.array(stiffness, dtype=float)
        if m.ndim != 1 or beta.shape != (len(m) - 1,) or len(m) < 3:
            raise ValueError(
                f"mass, stiffness have shapes {m.shape}, {beta.shape}; allowed: three bodies or more, one contact fewer"
            )
        for name, values in (("mass", m), ("stiffness", beta)):
            for k, value in enumerate(values.tolist()):
                above(0.0, f"{name}[{k}]", value)
        n = np.asarray(exponent, dtype=float)
        if n.shape not in ((), beta.shape):
            raise ValueError(f"exponent has shape {n.shape}; allowed: one number, or {len(beta)}, one per contact")
        distinct, which = np.unique(np.broadcast_to(n, beta.shape), return_inverse=True)
        waves = [response(checked_exponent(value)) for value in distinct.tolist()]
        return cls(m, beta, Local(*(np.array(column).T[..., which] for column in zip(*waves, strict=True))))

    def wave(self, energy: float, at: int, order: int) -> AdiabaticWave:
        """Return the pulse that has ``energy`` (J) at contact ``at``."""
        m, beta, local, between = self.mass, self.stiffness, self.local, np.sqrt(self.mass[1:] * self.mass[:-1])
        n = local.exponent
        at_contact = np.full(len(beta), energy)
        for _ in range(3 if order else 1):  # where n varies, the lost shares depend weakly on the energy
            scale = (at_contact / (beta * local.energy)) ** (1.0 / n)
            spring = beta * scale ** (n - 2.0)  # mass times speed squared
            speed = np.sqrt(spring / between)
            momentum = local.momentum * np.sqrt(between * at_contact / local.energy)
            left_velocity, left_overlap = np.zeros(len(m)), np.zeros(len(beta))
            if order:
                # losses of a pulse of constant energy; the change of its energy is of second order
                alike = np.sqrt(at_contact[1:] * at_contact[:-1])
                per_root = momentum / np.sqrt(at_contact)
                left_velocity[1:-1] = (per_root[:-1] - per_root[1:]) * np.sqrt(alike) / m[1:-1]
                left_overlap = _left_overlap(self, at_contact) + _at_contacts(left_velocity) / speed
                pressed = np.maximum(left_overlap, 0.0)
                pushed = (
                    beta * pressed ** (n - 1.0) / (between * speed)
                )  # velocity from the remaining force during one transit
                left = (beta * pressed**n / n + 0.5 * between * pushed**2) / at_contact
                share = 0.5 * m[1:-1] * left_velocity[1:-1] ** 2 / alike + 0.5 * (left[1:] + left[:-1])
                lost = np.concatenate(
                    [[0.0], np.cumsum(np.log1p(share))]
                )  # relative to the present energy, which stays positive
                at_contact = energy * np.exp(lost[at] - lost)
        # both are small where the theory is valid; elsewhere tanh keeps the results finite
        jump = np.tanh(left_overlap / (scale * local.peak_overlap))
        drift = np.tanh(_at_contacts(left_velocity) / (speed * scale * local.peak_velocity))
        force, velocity, faster = np.exp(local.pressed * jump + local.moving * drift)
        # the factor of a body's velocity that does not depend on its own mass
        per_mass = local.peak_velocity * np.sqrt(at_contact / local.energy) * velocity
        return AdiabaticWave(
            energy=at_contact,
            momentum=momentum,
            peak_force=beta * (scale * local.peak_overlap) ** (n - 1.0) * force,
            peak_velocity=_at_bodies(per_mass) / np.sqrt(m),
            transit=np.sqrt(m) / _at_bodies(np.sqrt(spring) * faster),
            left_velocity=left_velocity,
            left_overlap=left_overlap,
        )


def _left_overlap(chain: _Chain, energy: Floats) -> Floats:
    """Return -dD/dk at constant energy at each contact, from the shifts D of its two neighbours."""
    beta, local = chain.stiffness, chain.local
    padded = np.pad(np.arange(len(beta)), 1, mode="edge")
    before, behind = padded[:-2], padded[2:]

    def shift(of: NDArray[np.int64]) -> Floats:
        return np.asarray(local.momentum[of] * (energy / (beta[of] * local.energy[of])) ** (1.0 / local.exponent[of]))

    return (shift(before) - shift(behind)) / (behind - before)


def _at_contacts(of_bodies: Floats) -> Floats:
    """Return the mean of the two inner bodies of each contact."""
    inner = np.pad(of_bodies[1:-1], 1, mode="edge")
    return np.asarray(0.5 * (inner[1:] + inner[:-1]))


def _at_bodies(of_contacts: Floats) -> Floats:
    """Return the geometric mean of the two contacts of each body; an end body has one contact."""
    padded = np.pad(of_contacts, 1, mode="edge")
    return np.sqrt(padded[1:] * padded[:-1])


def checked_exponent(n: float) -> float:
    """Return ``n`` if it is in the range of the theory.

    Raises
    ------
    ValueError
        If ``n`` is outside 2.1 to 50.
    """
    if not LEAST_EXPONENT <= n <= MOST_EXPONENT:
        why = "at n = 2 every pulse disperses, and near it the wave is too wide to form"
        raise ValueError(f"exponent = {n!r}; allowed: {LEAST_EXPONENT:g} to {MOST_EXPONENT:g}; {why}")
    return n


#: contacts at the struck end after which the pulse has formed, in addition to twice the wave's half length
FORMED = 20
#: samples of the launch per unit of time, divided by n, because the width of the overlap's corner scales as 1/n
PER_TIME = 16


@dataclass(frozen=True, kw_only=True, eq=False)
class Launch:
    """Formation of the leading pulse of a uniform chain from a striker's energy.

    :func:`launched` computes it.
    """

    energy: float
    """Energy of the leading pulse, J."""
    share: float
    """Energy of the leading pulse divided by the striker's energy."""
    start: float
    """Time offset of the pulse, s: contact k peaks at ``start + (k + 1/2) / speed`` once the pulse has formed."""
    speed: float
    """Speed of the formed pulse, bodies per second."""
    force_ratio: Floats
    """Peak force of the first contacts divided by that of the formed pulse."""
    late: Floats
    """Delay of the peaks of the first contacts relative to the formula of ``start``, s."""


def launched(
    *,
    masses: tuple[float, float],
    stiffnesses: tuple[float, float],
    exponents: tuple[float, float],
    velocity: float,
) -> Launch:
    """Return the pulse that a striker makes in a uniform chain.

    The chain's first bodies are integrated (DOP853) until the pulse has formed. One solution for each ratio of masses,
    ratio of stiffnesses and pair of exponents serves all scales. For equal masses and stiffnesses the share is a
    function of n alone:
    0.9836 at 2.2, 0.99366 at 5/2, 0.99845 at 3, 0.99989 at 4.

    A two-body estimate multiplies that share by the energy that body 1 would take in a binary collision. Its energy is
    good to 2 % for mass ratios of 0.1 to 1.25 and a struck contact no softer than half the chain's. It is 8 % too low
    at a mass ratio of 2 and 70 % too high at a contact softer by 20; hence this solution. A train of several waves
    (heavy striker, soft struck contact) separates slowly: when the leading wave is read off, its velocity is 0.001 %
    too low at a mass ratio of 10, and
    0.12 % too low at a contact softer by 100.

    Parameters
    ----------
    masses : tuple of float
        Masses of the striker and of each body of the chain, kg.
    stiffnesses : tuple of float
        Stiffnesses of the struck contact and of the chain's contacts, N/m^(n-1).
    exponents : tuple of float
        Exponents n of the struck contact and of the chain's contacts.
    velocity : float
        Velocity of the striker, m/s.

    Raises
    ------
    ValueError
        If a parameter is outside its range.

    Examples
    --------
    >>> launch = launched(masses=(1.0, 1.0), stiffnesses=(1.0, 1.0), exponents=(2.5, 2.5), velocity=1.0)
    >>> f"{launch.share:.5f} {launch.energy:.5f} {launch.force_ratio[0]:.4f}"
    '0.99366 0.49683 1.1859'
    """
    m0, m1 = (above(0.0, f"masses[{i}]", value, "kg") for i, value in enumerate(masses))
    beta0, beta1 = (above(0.0, f"stiffnesses[{i}]", value, "N/m^(n-1)") for i, value in enumerate(stiffnesses))
    n0, n1 = above(1.0, "exponents[0]", exponents[0]), checked_exponent(exponents[1])
    v = above(0.0, "velocity", velocity, "m/s")
    length = (m1 * v**2 / beta1) ** (1.0 / n1)
    share, start, speed, force_ratio, late = _launch(m0 / m1, beta0 / beta1 * length ** (n0 - n1), n0, n1)
    unit = length / v
    return Launch(
        energy=share * 0.5 * m0 * v**2,
        share=share,
        start=start * unit,
        speed=speed / unit,
        force_ratio=force_ratio,
        late=late * unit,
    )


@functools.lru_cache(maxsize=64)
def _launch(
    mass_ratio: float, stiffness_ratio: float, n0: float, n1: float
) -> tuple[float, float, float, Floats, Floats]:
    """Return share, start, speed, force ratios and delays for a chain of m = beta = 1 and a striker of velocity 1."""
    from scipy.integrate import solve_ivp

    local, shape = response(n1), wave_shape(n1)
    formed = FORMED + math.ceil(2.0 * shape.half_length)
    links = formed + math.ceil(shape.half_length) + 2  # enough that the free end has no effect
    mass, beta, power = np.ones(links + 1), np.ones(links), np.full(links, n1 - 1.0)
    mass[0], beta[0], power[0] = mass_ratio, stiffness_ratio, n0 - 1.0

    # a trial step may compress contacts beyond the available energy; at a high n its force would overflow
    deepest = 1.1 * (0.5 * (power + 1.0) * mass_ratio / beta) ** (1.0 / (power + 1.0))

    overlap, force = np.zeros(links), np.zeros(links + 2)  # no force on the outer sides of the two ends

    def motion(_: float, state: Floats) -> Floats:
        slope = np.empty(2 * links + 2)  # scipy keeps it
        slope[: links + 1] = state[links + 1 :]
        np.subtract(state[:links], state[1 : links + 1], out=overlap)
        np.minimum(np.maximum(overlap, 0.0, out=overlap), deepest, out=overlap)
        np.multiply(beta, np.power(overlap, power, out=overlap), out=force[1:-1])
        np.divide(force[:-1] - force[1:], mass, out=slope[links + 1 :])
        return slope

    def passed(_: float, state: Floats) -> float:
        """Return a value that falls through zero at the largest overlap of contact ``formed + 1``.

        The offset 1e-9 keeps it positive until that contact closes.
        """
        return float(state[links + 1 + formed + 1] - state[links + 1 + formed + 2]) + 1e-9

    passed.terminal, passed.direction = True, -1.0  # type: ignore[attr-defined]
    state = np.zeros(2 * links + 2)
    state[links + 1] = 1.0
    run = solve_ivp(motion, (0.0, 1e6), state, method="DOP853", rtol=1e-9, atol=1e-11, events=passed, dense_output=True)
    time = np.linspace(0.0, run.t[-1], math.ceil(PER_TIME * n1 * run.t[-1]))
    x = run.sol(time)[: links + 1]
    force, peak_time = np.array([first_peak(time, x[k] - x[k + 1], beta[k], power[k]) for k in range(formed + 1)]).T
    scale = force[-1] ** (1.0 / (n1 - 1.0)) / local.peak_overlap
    speed = scale ** (0.5 * n1 - 1.0)
    share = local.energy * scale**n1 / (0.5 * mass_ratio)
    expected = peak_time[-1] - (formed - np.arange(formed + 1)) / speed
    ratio, late = force / force[-1], peak_time - expected
    ratio.flags.writeable = late.flags.writeable = False
    return float(share), float(expected[0] - 0.5 / speed), float(speed), ratio, late


def first_peak(time: Floats, overlap: Floats, stiffness: float, power: float) -> tuple[float, float]:
    """Return force and time of the first maximum above round-off, from a parabola through three samples."""
    inner = overlap[1:-1]
    j = int(np.argmax((inner > 1e-3 * np.max(overlap)) & (inner >= overlap[:-2]) & (inner > overlap[2:]))) + 1
    before, there, behind = overlap[j - 1 : j + 2]
    offset = 0.5 * (before - behind) / (before - 2.0 * there + behind)
    top = there - 0.25 * (before - behind) * offset
    return float(stiffness * top**power), float(time[j] + offset * (time[1] - time[0]))
