"""Frequencies of a chain: those at each moment, and the pass bands of a periodic one.

At a moment each contact is a spring of its tangent stiffness ``k = dF/d(overlap)``. Alone between its two bodies it has
``omega^2 = k (1/m_i + 1/m_j)``. Together they have the modes of the matrix ``sqrt(k) B M^-1 B^T sqrt(k)`` over the
contacts (B: from bodies to overlaps), which has these squares on its diagonal: so the highest mode is never below the
fastest pair. Nor is it above sqrt(2) times that: give half of a body's mass to each of its two contacts and every
contact alone has at most twice its square (Irons & Treharne 1971, in *Proc. 3rd Conf. Matrix Methods in Structural
Mechanics*, 245; for bodies in contact O'Sullivan & Bray 2004, *Eng. Comput.* 21, 278). On a linear chain
velocity-Verlet is stable for dt < 2/omega of that mode.

The pass bands of a precompressed periodic chain are measured on a run. In small motions at one frequency the motions of
a body and of those one unit cell before and behind it obey ``V[j-p] + V[j+p] = D V[j]``, whatever stands at the ends
and whatever drives it: D, the trace of the cell's transfer matrix, is that of the infinite chain (Brillouin 1946, *Wave
Propagation in Periodic Structures*, ch. 4 and 8). Where ``|D| <= 2`` it is ``2 cos k`` with the phase k per cell, and
waves travel; beyond they decay. So D is fitted to the spectra of the velocities, all bodies together, and bands end
where it passes 2 or -2: no resonance of a finite chain and no threshold enters.

What limits it is the length of the record T: two frequencies closer than 1/T are one. On chains of 24 bodies with one
to three bodies in a cell edges were off by at most half of that. Motions must be small: the relative shift of
frequencies is of the order of the square of the overlap's oscillation over the static overlap.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.observables.interpolate import contact_motion, spacing
from dem_bridge.physics.dispersion import Cell
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats, Trajectory

#: part of an overlap over which the slope of a law is taken
_SLOPE = 1e-4


def tangent_stiffness(scene: Scene, overlap: Floats) -> Floats:
    """Return ``dF/d(overlap)``, N/m, of each contact at overlaps ``(n_t, n_contact)``; 0 where it is open.

    Raises UnsupportedScene for n < 2, where it is infinite at touch.
    """
    c = scene.contacts
    if scene.law is not None:
        closed, every = np.maximum(overlap, 0.0), np.arange(scene.n_contact)
        rise = c.force(closed * (1.0 + _SLOPE), every) - c.force(closed * (1.0 - _SLOPE), every)
        return np.divide(rise, 2.0 * _SLOPE * closed, out=np.zeros_like(rise), where=closed > 0.0)
    if np.any(c.exponent < 2.0):
        raise UnsupportedScene(
            f"{scene.name} has contacts of exponent n = {float(np.min(c.exponent)):g}, whose tangent stiffness is"
            " infinite at touch: no highest frequency; allowed: n >= 2"
        )
    power = np.maximum(overlap, 0.0) ** (c.exponent - 2.0)
    return np.asarray(np.where(overlap > 0.0, (c.exponent - 1.0) * c.stiffness * power, 0.0))


def highest_frequencies(scene: Scene, trajectory: Trajectory) -> tuple[float, float]:
    """Return the highest angular frequencies (rad/s) of all samples: of one contact alone, and of a mode.

    Damping and drag are left out. Both are 0 if no bodies touch. Frequencies between samples may be higher.

    >>> import dem_bridge as db
    >>> scene = db.load_scene("decelerating-40")
    >>> pair, mode = highest_frequencies(scene, db.solve(scene, backend="reference", samples=5000))
    >>> f"{pair:.3g} rad/s, {mode / pair:.2f}"
    '1.86e+05 rad/s, 1.27'
    """
    return _highest(scene, contact_motion(scene, trajectory)[0])


def highest_mode(scene: Scene, displacement: Floats) -> float:
    """Return the highest angular frequency of a mode, rad/s, of samples of displacements, m, ``(n_t, n_body)``."""
    c, x = scene.contacts, np.pad(displacement, ((0, 0), (0, 1)))  # a wall is one more body at rest
    return _highest(scene, x[:, c.left] - x[:, c.right] - c.gap)[1]


def _highest(scene: Scene, overlap: Floats) -> tuple[float, float]:
    """Return what :func:`highest_frequencies` returns, by the overlaps of contacts, m, ``(n_t, n_contact)``."""
    from scipy.linalg import eigvalsh_tridiagonal

    c, mobility = scene.contacts, scene.mobility
    k = tangent_stiffness(scene, overlap)
    # along the line of bodies: the left wall's contact is the first
    links = len(scene.stiffness)
    first = [links] if scene.wall_left is not None else []
    line = np.array([*first, *range(links), *range(links + len(first), scene.n_contact)], dtype=np.int64)
    k, left, right = k[:, line], c.left[line], c.right[line]
    own_value = k * (mobility[left] + mobility[right])
    between = -np.sqrt(k[:, :-1] * k[:, 1:]) * mobility[right[:-1]]
    fastest = np.max(own_value, axis=1, initial=0.0)
    highest = 0.0
    for row in np.argsort(-fastest).tolist():
        if 2.0 * fastest[row] <= highest:
            break  # no mode of what is left can be higher
        top = len(line) - 1
        result = (
            eigvalsh_tridiagonal(own_value[row], between[row], select="i", select_range=(top, top))
            if top
            else own_value[row]
        )
        highest = max(highest, float(result[0]))
    return math.sqrt(float(np.max(fastest, initial=0.0))), math.sqrt(highest)


#: relative difference below which two neighbours count as equal
ALIKE = 1e-9
#: number of frequencies over which the trace is smoothed by a median before edges are determined: deep in a gap, where
#: bodies hardly move, single frequencies are outliers because the motion is not exactly linear
ALONE = 5
#: smallest number of cells in a chain
FEWEST_CELLS = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class Bands:
    """Hold the pass bands of a run; :func:`measured_bands` returns them."""

    frequency: Floats
    """``(n_f,)``, Hz."""
    trace: Floats
    """``(n_f,)``: D, twice the cosine of the phase per cell where it is within -2 and 2."""
    transmission: Floats
    """``(n_f,)``: speed of the last body over that of the first."""
    edges: tuple[float, ...]
    """Hz, rising: where D passes 2 or -2."""
    resolution: float
    """Hz: the inverse of the record's length."""

    @property
    def phase(self) -> Floats:
        """Return the phase k per cell, rad, from 0 to pi, ``(n_f,)``; nan where no wave travels."""
        inside = np.abs(self.trace) <= 2.0
        return np.where(inside, np.arccos(np.clip(0.5 * self.trace, -1.0, 1.0)), np.nan)


def unit_cell(scene: Scene) -> tuple[int, Cell]:
    """Return the first body of the periodic part of a precompressed chain, 0 or 1, and its unit cell.

    The first body is 1 behind a striker.

    Raises UnsupportedScene where nothing is pressed or nothing repeats.

    >>> scene = Scene(name="bar", duration=1e-3, mass=(0.01,) * 8, stiffness=(4e9,) * 7, velocity=(1e-3,) + (0.0,) * 7,
    ...               precompression=10.0)
    >>> first, cell = unit_cell(scene)
    >>> first, cell.bodies, [f"{edge:.1f}" for edge in cell.edges]
    (0, 1, ['57072.8'])
    """
    if scene.precompression == 0.0:
        raise UnsupportedScene(f"{scene.name} is not precompressed: there is no sound in it and no band")
    if scene.law is not None:
        raise UnsupportedScene(f"{scene.name} has laws of its own: their static overlaps are not known")
    c, links = scene.contacts, len(scene.stiffness)
    mass = np.array(scene.mass)
    spring = tangent_stiffness(scene, -c.gap[None, :])[0, :links]
    for first in (0, 1):
        bodies, contacts = mass[first:], spring[first:]
        for period in range(1, len(bodies) // FEWEST_CELLS + 1):
            if _repeats(bodies, period) and _repeats(contacts, period):
                return first, Cell(mass=tuple(bodies[:period].tolist()), spring=tuple(contacts[:period].tolist()))
    raise UnsupportedScene(
        f"{scene.name} has no unit cell that repeats {FEWEST_CELLS} times or more, so no bands of an infinite chain"
    )


def _repeats(values: Floats, period: int) -> bool:
    return bool(np.all(np.abs(values[period:] - values[:-period]) <= ALIKE * np.abs(values[period:])))


def measured_bands(
    scene: Scene, trajectory: Trajectory, *, lowest: float | None = None, highest: float | None = None
) -> Bands:
    """Return the bands between two frequencies (Hz; None: all that the record resolves) from all samples of a run.

    Samples must be closer than a third of the shortest period, and the record longer than 20 periods of ``lowest``.
    Raises UnsupportedScene as :func:`unit_cell` does, UsageError where nothing moves or fewer than :data:`ALONE`
    frequencies are left between the two.
    """
    from scipy.signal import get_window, medfilt

    h, (first, cell) = spacing(trajectory), unit_cell(scene)
    length, p = len(trajectory.time) * h, cell.bodies
    top = 1.0 / (3.0 * h)
    lowest = 20.0 / length if lowest is None else max(lowest, 20.0 / length)
    highest = top if highest is None else highest
    if not lowest < highest <= top:
        raise UsageError(
            f"highest = {highest:g} Hz; allowed: from {lowest:g}, 20 periods in the record, to {top:g} Hz, three"
            " samples a period; take more samples or a longer run"
        )
    window = get_window("hann", len(trajectory.time), fftbins=False)
    frequency: Floats = np.fft.rfftfreq(len(trajectory.time), h).astype(np.float64)
    inside = (frequency >= lowest) & (frequency <= highest)
    frequency = frequency[inside]
    if len(frequency) < ALONE:
        raise UsageError(
            f"{len(frequency)} frequencies from {lowest:g} to {highest:g} Hz; allowed: {ALONE} or more;"
            " take a longer run"
        )
    spectra = np.fft.rfft(trajectory.velocity * window[:, None], axis=0)[inside]
    middle = np.arange(first + p, scene.n_body - p)
    own_values, around = spectra[:, middle], spectra[:, middle - p] + spectra[:, middle + p]
    power = np.sum(np.abs(own_values) ** 2, axis=1)
    if not np.all(power > 0.0):
        raise UsageError(f"nothing moves in {scene.name} at some frequency; allowed: a chain that is struck or driven")
    trace = np.sum((np.conj(own_values) * around).real, axis=1) / power
    return Bands(
        frequency=frequency,
        trace=trace,
        transmission=np.abs(spectra[:, -1]) / np.abs(spectra[:, 0]),
        edges=band_edges(frequency, medfilt(trace, ALONE)),
        resolution=1.0 / length,
    )


def band_edges(frequency: Floats, trace: Floats) -> tuple[float, ...]:
    """Return the frequencies at which the trace passes 2 or -2, by linear interpolation between two frequencies.

    >>> band_edges(np.array([10.0, 11.0, 12.0]), np.array([1.0, 3.0, 3.0]))
    (10.5,)
    """
    results = []
    for level in (2.0, -2.0):
        off = trace - level
        at = np.flatnonzero((off[:-1] < 0.0) != (off[1:] < 0.0))
        results += (frequency[at] - off[at] * (frequency[at + 1] - frequency[at]) / (off[at + 1] - off[at])).tolist()
    return tuple(sorted(results))
