"""The adiabatic solitary wave: the leading pulse of a chain whose masses, stiffnesses and exponents vary slowly.

Locally the pulse is the exact wave of the discrete uniform chain (:mod:`.solitary`), and what it keeps is its energy E.
With A^n = E / (beta e), and R, V, e, p the peak overlap, peak velocity, energy and momentum of the shape at A = 1::

    peak force = beta (A R)^(n-1)      speed = sqrt(beta A^(n-2) / m)      shift D = A p
    peak velocity = V sqrt(E / (e m))  momentum P = p sqrt(m E / e)

That is order 0: for one mass and one n, force goes as beta^(1/n) and velocity does not change. Order 1 adds what a
gradient does, from conservation of momentum and energy alone; nothing in it is fitted.

* What the pulse loses in momentum stays with the body passed: u = -(dP/dk) / m, and with it the energy m u^2 / 2. For
  n -> infinity that is the binary collision, whose rebound it is.
* Bodies end up shifted by different D, so behind the pulse a contact is left with J = -dD/dk + u / speed: a gap
  (J < 0), or an overlap with its energy beta J^n / n and that of the body it pushes for 1 / speed.
* The pulse runs into bodies at rest that touch, and leaves J and u behind. Time and space reversed, the gradient
  changes its sign, so what is even about the peak has no first order but for the mean of ahead and behind: the local
  wave is that of a uniform chain pressed by J/2 that moves with u/2, to first order. :func:`response` is that wave.

On a chain of one mass and stiffness exp(eps k), n = 5/2, ln of peak force, peak velocity and speed thus have -0.3994,
-0.4891 and +0.2608 times eps beside order 0. Long runs of the reference at eps = -0.01 have -0.3901, -0.4806 and
+0.2605; what is left goes as eps^2 (-0.9 of it for the force). A chain that softens costs the pulse nothing, one that
stiffens 0.2 eps^(5/2) of its energy a body. On the paper's 200 cylinders force goes as beta^0.3948 where they soften
and beta^0.4067 where they stiffen (contacts 5 to 194); the theory has 0.3940 and 0.4057, and 0.0006 of each difference
is that eps^2.

How much of a striker's energy goes into the pulse is a problem of its own: :mod:`.launch`.

Valid for single pulses into chains at rest that just touch, elastic, n from 2.1 to 50, changes small over the wave's
width of five bodies; not for the last few bodies before an end. Knows nothing of scenes.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dem_bridge.physics.solitary import wave_shape
from dem_bridge.physics.valid import above

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Floats = NDArray[np.float64]

#: below it the wave is tens of bodies wide and takes hundreds to form
LEAST_EXPONENT = 2.1


@dataclass(frozen=True, eq=False)
class Local:
    """What the uniform chain's wave of one exponent is and how it answers, all at m = beta = speed = 1."""

    exponent: float
    peak_overlap: float
    peak_velocity: float
    momentum: float
    energy: float
    pressed: tuple[float, float, float]
    """d ln(peak force, peak velocity, speed) at constant energy, by a jump J of the overlap over the peak overlap."""
    moving: tuple[float, float, float]
    """The same by the velocity u left behind over the peak velocity."""


@functools.lru_cache(maxsize=1024)
def response(exponent: float) -> Local:
    """The wave of one exponent, and its answer to being in a chain that is pressed by J/2 and moves with u/2.

    Linearised about the wave, r' = 1 + tent * (n-1) r^(n-2) r' for an overlap of one far ahead and behind; then the
    amplitude is changed until the energy is the old one.

    >>> hertz = response(2.5)
    >>> [f"{x:.4f}" for x in (*hertz.pressed, *hertz.moving)]
    ['-0.5473', '-0.6702', '0.3574', '-0.4685', '0.1096', '-0.0781']
    """
    from scipy.fft import dct

    shape = wave_shape(exponent)
    n, p, points = shape.exponent, shape.exponent - 1.0, len(shape.overlap) - 1
    modes = np.arange(points + 1)
    cosines = np.cos(np.pi / points * np.outer(modes, modes))
    r, v = np.maximum(cosines @ shape.overlap, 0.0), cosines @ shape.velocity
    box = np.sinc(modes / (2.0 * shape.half_length))
    weight = np.full(points + 1, 2.0 * shape.half_length / points)
    weight[[0, -1]] *= 0.5

    def filtered(kernel: Floats, values: Floats) -> Floats:
        return np.asarray(dct(kernel[:, None] * dct(values, type=1, axis=0), type=1, axis=0) / (2 * points))

    slope = p * r ** (p - 1.0)
    more = np.linalg.solve(np.eye(points + 1) - filtered(box**2, np.eye(points + 1)) * slope, np.ones(points + 1))
    faster = filtered(box, (slope * more)[:, None])[:, 0]
    (top, fastest), energy = shape.peaks, shape.kinetic + shape.potential

    def at_the_same_energy(overlap: float, velocity: float, gained: float) -> tuple[float, float, float]:
        scale = -gained / (n * energy)  # of the amplitude: energy goes as its n-th power
        return p * (overlap / top + scale), velocity / fastest + 0.5 * n * scale, (0.5 * n - 1.0) * scale

    half = 0.5 * top
    gained = float(weight @ (r**p * more) + weight @ (v * faster))
    return Local(
        exponent=n,
        peak_overlap=top,
        peak_velocity=fastest,
        momentum=shape.momentum,
        energy=energy,
        pressed=at_the_same_energy(half * float(more[0]), half * float(faster[0]), half * gained),
        moving=at_the_same_energy(0.0, 0.5 * fastest, 0.5 * fastest * shape.momentum),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class AdiabaticWave:
    """The leading pulse along a chain. Made by :func:`adiabatic_wave`; of contacts or bodies, ``(n_contact,)``,
    ``(n_body,)``."""

    energy: Floats
    """J, of the pulse as it passes each contact."""
    momentum: Floats
    """kg m/s, as it passes each contact; the impulse that the contact transmits."""
    peak_force: Floats
    """N, of each contact."""
    peak_velocity: Floats
    """m/s, of each body; of the first and last as if the chain went on."""
    transit: Floats
    """s, from the peak of contact i-1 to that of contact i, for each body i; of the first and last as if the chain went
    on. What the paper calls the residence time."""
    left_velocity: Floats
    """m/s, of each body when the pulse has passed."""
    left_overlap: Floats
    """m, of each contact when the pulse has passed; negative: a gap."""


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
    """The pulse of a chain of ``mass`` (kg, ``(n_body,)``), by what it has at one place.

    ``stiffness`` (N/m^(n-1), ``(n_body - 1,)``); ``exponent`` n, one or one per contact. Give one of ``energy`` (J, at
    contact ``at``) and ``peak_velocity`` (m/s, of body ``at``). ``order``: 0, energy is kept and each place has its
    uniform chain's wave; 1, with what the gradients do. A contact k has its own stiffness and the geometric mean of the
    masses beside it, a body its own mass and the geometric mean of both contacts' speeds: even about each place, so
    that nothing of first order in the gradient comes from discretisation. Raises ValueError.

    >>> wave = adiabatic_wave(mass=[1.0] * 9, stiffness=0.9 ** np.arange(8), exponent=2.5, peak_velocity=1.0, order=0)
    >>> [f"{x:.6f}" for x in np.log(wave.peak_force[4:6] / wave.peak_force[3:5]) / np.log(0.9)]
    ['0.400000', '0.400000']
    >>> f"{wave.energy[0]:.10f} {wave.momentum[0]:.10f} {1.0 / (wave.transit[1] * 0.9**0.2):.12f}"
    '1.0693229458 1.6699712493 0.907470078412'
    """
    chain = _Chain.of(mass, stiffness, exponent)
    if (energy is None) == (peak_velocity is None):
        given = "neither is" if energy is None else "both are"
        raise ValueError(f"energy, peak_velocity: {given} given; allowed: one, the other follows from it")
    if order not in (0, 1):
        raise ValueError(f"order = {order!r}; allowed: 0 or 1")
    places = len(chain.stiffness) + (energy is None)
    if isinstance(at, bool) or not isinstance(at, int) or not 0 <= at < places:
        raise ValueError(f"at = {at!r}; allowed: 0 to {places - 1}")
    if energy is not None:
        return chain.wave(above(0.0, "energy", energy, "J"), at, order)
    wanted = above(0.0, "peak_velocity", peak_velocity, "m/s")
    start, found = min(at, len(chain.stiffness) - 1), float(chain.mass[at]) * wanted**2
    for _ in range(6):  # energy goes as velocity squared: exact at once for one n, and nearly so for several
        found *= (wanted / float(chain.wave(found, start, order).peak_velocity[at])) ** 2
    return chain.wave(found, start, order)


@dataclass(frozen=True, eq=False)
class _Chain:
    """A chain's numbers with those of the local wave's shape, all ``(n_contact,)`` but the mass."""

    mass: Floats
    stiffness: Floats
    n: Floats
    top: Floats
    fastest: Floats
    shape_momentum: Floats
    shape_energy: Floats
    pressed: Floats
    """``(3, n_contact)``: see :class:`Local`."""
    moving: Floats

    @classmethod
    def of(cls, mass: ArrayLike, stiffness: ArrayLike, exponent: ArrayLike) -> _Chain:
        m, beta = np.array(mass, dtype=float), np.array(stiffness, dtype=float)
        if m.ndim != 1 or beta.shape != (len(m) - 1,) or len(m) < 3:
            raise ValueError(
                f"mass, stiffness have shapes {m.shape}, {beta.shape}; allowed: three bodies or more, one contact less"
            )
        for name, values in (("mass", m), ("stiffness", beta)):
            for k, value in enumerate(values.tolist()):
                above(0.0, f"{name}[{k}]", value)
        n = np.asarray(exponent, dtype=float)
        if n.shape not in ((), beta.shape):
            raise ValueError(f"exponent has shape {n.shape}; allowed: one number, or {len(beta)}, one per contact")
        distinct, which = np.unique(np.broadcast_to(n, beta.shape), return_inverse=True)
        found = [response(checked_exponent(value)) for value in distinct.tolist()]

        def each(name: str) -> Floats:
            return np.array([getattr(one, name) for one in found]).T[..., which]

        names = ("exponent", "peak_overlap", "peak_velocity", "momentum", "energy", "pressed", "moving")
        return cls(m, beta, *(each(name) for name in names))

    def wave(self, energy: float, at: int, order: int) -> AdiabaticWave:
        """The pulse with this energy at contact ``at``."""
        m, beta, n, between = self.mass, self.stiffness, self.n, np.sqrt(self.mass[1:] * self.mass[:-1])
        at_contact = np.full(len(beta), energy)
        for _ in range(3 if order else 1):  # shares lost depend on the energy where n varies, and hardly there
            scale = (at_contact / (beta * self.shape_energy)) ** (1.0 / n)
            spring = beta * scale ** (n - 2.0)  # mass times speed squared
            speed = np.sqrt(spring / between)
            momentum = self.shape_momentum * np.sqrt(between * at_contact / self.shape_energy)
            left_velocity, left_overlap = np.zeros(len(m)), np.zeros(len(beta))
            if order:
                # of what a pulse of constant energy loses; its loss of energy is of second order
                alike = np.sqrt(at_contact[1:] * at_contact[:-1])
                per_root = momentum / np.sqrt(at_contact)
                left_velocity[1:-1] = (per_root[:-1] - per_root[1:]) * np.sqrt(alike) / m[1:-1]
                left_overlap = _left_overlap(self, at_contact) + _at_contacts(left_velocity) / speed
                pressed = np.maximum(left_overlap, 0.0)
                pushed = beta * pressed ** (n - 1.0) / (between * speed)  # velocity, by the force left for a transit
                left = (beta * pressed**n / n + 0.5 * between * pushed**2) / at_contact
                share = 0.5 * m[1:-1] * left_velocity[1:-1] ** 2 / alike + 0.5 * (left[1:] + left[:-1])
                lost = np.concatenate([[0.0], np.cumsum(np.log1p(share))])  # of what there is: some is always left
                at_contact = energy * np.exp(lost[at] - lost)
        # small, where the theory holds; where it does not its answers are to stay finite
        jump = np.tanh(left_overlap / (scale * self.top))
        drift = np.tanh(_at_contacts(left_velocity) / (speed * scale * self.fastest))
        force, velocity, faster = np.exp(self.pressed * jump + self.moving * drift)
        # of a body's velocity and time what its own mass does not decide
        per_mass = self.fastest * np.sqrt(at_contact / self.shape_energy) * velocity
        return AdiabaticWave(
            energy=at_contact,
            momentum=momentum,
            peak_force=beta * (scale * self.top) ** (n - 1.0) * force,
            peak_velocity=_at_bodies(per_mass) / np.sqrt(m),
            transit=np.sqrt(m) / _at_bodies(np.sqrt(spring) * faster),
            left_velocity=left_velocity,
            left_overlap=left_overlap,
        )


def _left_overlap(chain: _Chain, energy: Floats) -> Floats:
    """-dD/dk at constant energy: of the shifts D on both sides of each contact, half the outer difference."""
    beta, n = chain.stiffness, chain.n
    padded = np.pad(np.arange(len(beta)), 1, mode="edge")
    before, behind = padded[:-2], padded[2:]

    def shift(of: NDArray[np.int64]) -> Floats:
        return np.asarray(chain.shape_momentum[of] * (energy / (beta[of] * chain.shape_energy[of])) ** (1.0 / n[of]))

    return (shift(before) - shift(behind)) / (behind - before)


def _at_contacts(of_bodies: Floats) -> Floats:
    """Means of the inner bodies beside each contact."""
    inner = np.pad(of_bodies[1:-1], 1, mode="edge")
    return np.asarray(0.5 * (inner[1:] + inner[:-1]))


def _at_bodies(of_contacts: Floats) -> Floats:
    """Geometric means of both contacts of each body; at the ends of the only one."""
    padded = np.pad(of_contacts, 1, mode="edge")
    return np.sqrt(padded[1:] * padded[:-1])


def checked_exponent(n: float) -> float:
    """``n``, if the theory knows it; ValueError otherwise."""
    if not LEAST_EXPONENT <= n <= 50.0:
        why = "at n = 2 every pulse disperses, and near it the wave is too wide to form"
        raise ValueError(f"exponent = {n!r}; allowed: {LEAST_EXPONENT} to 50; {why}")
    return n
