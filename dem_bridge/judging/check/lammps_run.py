"""Velocities of one run of a script by LAMMPS, as its dumps have them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dem_bridge.errors import UsageError
from dem_bridge.foundation.compiled import Ints
from dem_bridge.judging.deck import DeckRun
from dem_bridge.lmp.reader.deck import UNITS
from dem_bridge.trajectory.trajectory import Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class LammpsRun:
    """Velocities of one run of the script by LAMMPS."""

    factor: int
    """How many times its time steps are shorter than those of the script."""
    time: Floats
    """Sample times, s, ``(n_t,)``."""
    velocity: Floats
    """In m/s, ``(n_t, n_body)`` of a scene; else in the units of the script, three components of each atom."""
    bodies: tuple[int, ...]
    version: int
    dangerous: int
    """Dangerous builds of the neighbour list."""
    active_steps: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """Further samples, between which velocities change little, while forces act: steps of this run."""
    active: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    """Velocities at :attr:`active_steps`, as :attr:`velocity`."""

    @property
    def finite(self) -> bool:
        """Return True if all velocities are numbers."""
        return bool(np.all(np.isfinite(self.velocity)))

    @property
    def common_steps(self) -> Ints:
        """Further samples as steps of the script as it is, which finer runs share."""
        return self.active_steps // self.factor

    def apart(self, other: LammpsRun) -> float:
        """Return the largest difference of velocities from another run at common samples; nan if not finite."""
        rows = min(len(self.velocity), len(other.velocity))
        _, own, others = np.intersect1d(self.common_steps, other.common_steps, return_indices=True)
        with np.errstate(all="ignore"):
            parts = [self.velocity[:rows] - other.velocity[:rows]]
            if len(own):
                parts.append(self.active[own] - other.active[others])
            return max(float(np.max(np.abs(part))) for part in parts)


def along_chain(run: DeckRun, values: Floats, result: LammpsRun, end: float) -> Floats:
    """Return velocities of all atoms until a time, s, as those of bodies, m/s, ``(n_frame, n_body)``."""
    length, time, _ = UNITS.get(run.deck.state.units, (1.0, 1.0, 1.0))
    sign = -1.0 if run.deck.mirrored else 1.0
    along = sign * length / time * values[:, list(run.order), run.axis]
    # atoms that stay, such as a frozen one at an end, are no bodies: the others move as the samples do
    many = len(result.bodies)
    after = result.velocity[min(int(np.searchsorted(result.time, end)), len(result.time) - 1)]
    starts = range(along.shape[1] - many + 1)
    first = min(starts, key=lambda start: float(np.max(np.abs(along[-1, start : start + many] - after))))
    return np.asarray(along[:, first : first + many])


def times_at(steps: Ints, dt: float) -> Floats:
    """Return the times of steps, s."""
    return np.asarray(dt * steps, dtype=np.float64)


def dumped(text: str) -> tuple[Floats, Floats]:
    """Return times and velocities of the added dump, atoms by their ids: ``(n_t,)`` and ``(n_t, 3 n_atom)``."""
    times: list[float] = []
    rows: list[Floats] = []
    lines = text.splitlines()
    place, count = 0, 0
    while place < len(lines):
        heading = lines[place]
        if heading.startswith("ITEM: TIME") and not heading.startswith("ITEM: TIMESTEP"):
            times.append(float(lines[place + 1]))
        elif heading.startswith("ITEM: NUMBER OF ATOMS"):
            count = int(lines[place + 1])
        elif heading.startswith("ITEM: ATOMS"):
            table = np.array([line.split() for line in lines[place + 1 : place + 1 + count]], dtype=float)
            rows.append(table[np.argsort(table[:, 0]), 5:8].ravel())
            place += count
        place += 1
    if len({len(row) for row in rows}) > 1:
        raise UsageError("the number of atoms changes during the run; allowed: as many atoms in all frames")
    return np.array(times), np.array(rows)
