"""Pass bands of a precompressed periodic chain, measured on a run.

In small motions at one frequency the motions of a body and of those one unit cell before and behind it obey
``V[j-p] + V[j+p] = D V[j]``, whatever stands at the ends and whatever drives it: D, the trace of the cell's transfer
matrix, is that of the infinite chain (Brillouin 1946, *Wave Propagation in Periodic Structures*, ch. 4 and 8). Where
``|D| <= 2`` it is ``2 cos k`` with the phase k per cell, and waves travel; beyond they decay. So D is fitted to the
spectra of the velocities, all bodies together, and bands end where it passes 2 or -2: no resonance of a finite chain
and no threshold enters.

What limits it is the length of the record T: two frequencies closer than 1/T are one. On chains of 24 bodies with one
to three bodies in a cell edges were off by at most half of that. Motions must be small: the relative shift of
frequencies is of the order of the square of the overlap's oscillation over the static overlap.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.observables.interpolate import spacing
from dem_bridge.observables.modes import tangent_stiffness
from dem_bridge.physics.dispersion import Cell
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats, Trajectory

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
