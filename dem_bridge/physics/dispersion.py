"""Small oscillations of a precompressed chain, whose contacts act as springs of their tangent stiffness.

Under a static force F0 each contact has the overlap ``delta0 = (F0/beta)^(1/(n-1))`` and responds to small motions as a
spring ``K = (n-1) beta delta0^(n-2)``. A lattice of equal masses then has ``omega = 2 sqrt(K/m) |sin(k/2)|``; a lattice
of two alternating masses has an acoustic and an optical branch (Brillouin 1946, *Wave Propagation in Periodic
Structures*, ch. 3 and 4; Nesterenko 2001, *Dynamics of Heterogeneous Materials*, ch. 1, for the granular chain). Wave
numbers k are in radians per contact, speeds in grains per second. The theory is valid while the oscillation of the
overlap is much smaller than delta0: no contact opens, and the relative error of K is about (n-2)/2 times their ratio.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from dem_bridge.physics.numbers import above


@dataclass(frozen=True, kw_only=True)
class Dispersion:
    """Dispersion relation of a precompressed chain of one mass or of two alternating masses.

    :func:`dispersion` computes it.
    """

    static_overlap: float
    """Static overlap delta0, m."""
    tangent_stiffness: float
    """Tangent stiffness K, N/m."""
    sound_speed: float
    """Speed of long waves, grains per second."""
    cutoff: float
    """Largest angular frequency of a wave, rad/s."""
    band_gap: tuple[float, float]
    """Top of the acoustic and bottom of the optical branch, rad/s; for equal masses both are sqrt(2 K/m): no gap."""
    masses: tuple[float, float]
    """Masses of two successive bodies, kg."""

    def frequency(self, wave_number: float, *, optical: bool = False) -> float:
        """Return omega(k) of the acoustic or optical branch, rad/s.

        Parameters
        ----------
        wave_number : float
            k, rad per contact, from 0 to pi; to pi/2 for two masses or ``optical``.
        optical : bool
            True for the optical branch.
        """
        k = self._in_zone(wave_number, folded=optical)
        if self._uniform and not optical:
            return self.cutoff * math.sin(0.5 * k)
        # with a = K/m1, b = K/m2: omega^2 = a + b -+ sqrt((a + b)^2 - 4 a b sin^2 k), the root written as a hypotenuse
        # and the smaller omega^2 as product over larger, so that nothing cancels at either end of the zone
        a, b = (self.tangent_stiffness / m for m in self.masses)
        larger = a + b + math.hypot(a - b, 2.0 * math.sqrt(a * b) * math.cos(k))
        product = 4.0 * a * b * math.sin(k) ** 2
        return math.sqrt(larger if optical else product / larger)

    def group_velocity(self, wave_number: float) -> float:
        """Return d omega / d k of the acoustic branch, grains per second; ``wave_number`` as in :meth:`frequency`."""
        k = self._in_zone(wave_number)
        if self._uniform:
            return self.sound_speed * math.cos(0.5 * k)
        if k == 0.0:
            return self.sound_speed
        omega = self.frequency(k)
        # implicit derivative of omega^4 - 2 (a + b) omega^2 + 4 a b sin^2 k = 0
        a, b = (self.tangent_stiffness / m for m in self.masses)
        return a * b * math.sin(2.0 * k) / (omega * math.hypot(a - b, 2.0 * math.sqrt(a * b) * math.cos(k)))

    def fixed_modes(self, count: int) -> tuple[float, ...]:
        """Return the angular frequencies of ``count`` equal bodies between rigid walls, rad/s.

        There are ``count`` + 1 equal contacts. In mode j body i moves as sin(k i) with k = j pi / (count + 1).
        """
        if not self._uniform:
            raise ValueError(
                f"masses = {self.masses}; allowed: equal masses, since two different masses have no closed form"
            )
        if isinstance(count, bool) or not isinstance(count, int) or count < 1:
            raise ValueError(f"count = {count!r}; allowed: a whole number >= 1")
        return tuple(self.frequency(j * math.pi / (count + 1)) for j in range(1, count + 1))

    @property
    def _uniform(self) -> bool:
        return self.masses[0] == self.masses[1]

    def _in_zone(self, wave_number: float, *, folded: bool = False) -> float:
        """Return the wave number if it lies in the Brillouin zone, which is halved for two masses or ``folded``."""
        edge, text = (math.pi, "pi") if self._uniform and not folded else (0.5 * math.pi, "pi/2")
        if not 0.0 <= wave_number <= edge:
            raise ValueError(f"wave_number = {wave_number!r} rad per grain; allowed: 0 to {text}")
        return float(wave_number)


def dispersion(
    *, mass: float | tuple[float, float], stiffness: float, exponent: float, static_force: float
) -> Dispersion:
    """Return the dispersion relation of a chain that is held by a static force.

    Parameters
    ----------
    mass : float or tuple of float
        Mass of each body, kg; a pair for two alternating masses.
    stiffness : float
        Stiffness beta, N/m^(n-1).
    exponent : float
        Exponent n > 1.
    static_force : float
        Static force F0, N.

    Raises
    ------
    ValueError
        If a parameter is outside its range. Without a static force a chain with n > 2 has no sound speed.

    Examples
    --------
    >>> chain = dispersion(mass=0.01, stiffness=4e9, exponent=2.5, static_force=10.0)
    >>> f"{chain.sound_speed:.6f} grains/s, {chain.cutoff:.6f} rad/s, {chain.static_overlap:.6e} m"
    '28536.385282 grains/s, 57072.770565 rad/s, 1.842016e-06 m'
    >>> f"{chain.frequency(math.pi):.6f}", chain.group_velocity(0.0) == chain.sound_speed
    ('57072.770565', True)
    """
    pair = mass if isinstance(mass, tuple) else (mass, mass)
    if len(pair) != 2:
        raise ValueError(f"mass = {mass!r}; allowed: one number > 0 (kg), or two for alternating masses")
    m1, m2 = (above(0.0, "mass", m, "kg") for m in pair)
    beta, n = above(0.0, "stiffness", stiffness, "N/m^(n-1)"), above(1.0, "exponent", exponent)
    force = above(0.0, "static_force", static_force, "N", why="a chain without static force has no sound speed")
    overlap = (force / beta) ** (1.0 / (n - 1.0))
    spring = (n - 1.0) * force / overlap
    light, heavy = sorted((m1, m2))
    return Dispersion(
        static_overlap=overlap,
        tangent_stiffness=spring,
        sound_speed=math.sqrt(2.0 * spring / (light + heavy)),
        cutoff=math.sqrt(2.0 * spring * (1.0 / light + 1.0 / heavy)),
        band_gap=(math.sqrt(2.0 * spring / heavy), math.sqrt(2.0 * spring / light)),
        masses=(m1, m2),
    )


@dataclass(frozen=True, kw_only=True)
class Cell:
    """Unit cell of an infinite chain: masses (kg) and the spring (N/m) behind each of them, in order.

    Its frequencies at a phase k per cell are the eigenvalues of a Hermitian matrix (Brillouin 1946, ch. 8); in one
    dimension each band has its edges at k = 0 and pi.

    Examples
    --------
    >>> cell = Cell(mass=(0.01, 0.04), spring=(8e6, 8e6))
    >>> [f"{edge:.0f}" for edge in cell.edges]  # sqrt(2 K/m2), sqrt(2 K/m1), sqrt(2 K (1/m1 + 1/m2))
    ['20000', '40000', '44721']
    """

    mass: tuple[float, ...]
    spring: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.mass) != len(self.spring) or not self.mass:
            raise ValueError(f"{len(self.mass)} masses and {len(self.spring)} springs; allowed: one spring per mass")
        for name, values, unit in (("mass", self.mass, "kg"), ("spring", self.spring, "N/m")):
            for value in values:
                above(0.0, name, value, unit)

    @property
    def bodies(self) -> int:
        """Number of bodies in the cell."""
        return len(self.mass)

    def frequencies(self, phase: float) -> tuple[float, ...]:
        """Return the angular frequencies at ``phase`` (rad per cell), rad/s, ascending, ``(bodies,)``."""
        import numpy as np  # imported here because the closed forms do not need it

        count = self.bodies
        root = 1.0 / np.sqrt(self.mass)
        matrix = np.zeros((count, count), dtype=complex)
        for i, k in enumerate(self.spring):
            j, turn = (i + 1) % count, np.exp(1j * phase) if i + 1 == count else 1.0
            matrix[i, i] += k
            matrix[j, j] += k
            matrix[i, j] -= k * turn
            matrix[j, i] -= k * np.conj(turn)
        squares = np.linalg.eigvalsh(matrix * np.outer(root, root))
        return tuple(np.sqrt(np.maximum(squares, 0.0)).tolist())

    @property
    def bands(self) -> tuple[tuple[float, float], ...]:
        """Lowest and highest angular frequency of each band, rad/s; the first, acoustic band begins at 0."""
        long, short = self.frequencies(0.0), self.frequencies(math.pi)
        ranges = [(min(pair), max(pair)) for pair in zip(long, short, strict=True)]
        return ((0.0, ranges[0][1]), *ranges[1:])

    @property
    def edges(self) -> tuple[float, ...]:
        """Band edges, rad/s, ascending, without the 0 of the acoustic band; bands that meet have no edge there."""
        bands = self.bands
        edges = [bands[0][1]]
        for low, high in bands[1:]:
            if low - edges[-1] > 1e-9 * low:
                edges += [low, high]
            else:
                edges[-1] = high
        return tuple(edges)
