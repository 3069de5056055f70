"""Stand in for LAMMPS by velocity-Verlet in plain Python, for faults that no deck can make LAMMPS commit.

It keeps absolute positions and answers with the columns of LAMMPS' dump, so that all that reads a dump is at work. Free
scenes of Hertzian contacts only. A third writing beside LAMMPS and the twin.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dem_bridge.backends import lammps
from dem_bridge.lmp.deck import DUMP_COLUMNS, Deck, deck_of
from dem_bridge.lmp.process import EngineReport
from dem_bridge.runs.campaign import Result, run_case
from dem_bridge.runs.case import Case
from dem_bridge.scene.scene import Scene
from tests.helpers.fault_judging import BENCH, Results

#: positions (m), velocities (m/s) and net forces (N) of the bodies
State = tuple[list[float], list[float], list[float]]
Net = Callable[[list[float]], list[float]]


@dataclass
class Code:
    """Integrate soundly; a fault overrides one method."""

    before: list[float] = field(default_factory=list)
    """Whatever a fault keeps from the step before."""

    def contact_force(self, overlap: list[float], stiffness: tuple[float, ...]) -> list[float]:
        return [k * d * math.sqrt(d) if d > 0.0 else 0.0 for k, d in zip(stiffness, overlap, strict=True)]

    def net_force(self, force: list[float]) -> list[float]:
        return [left - right for left, right in zip([0.0, *force], [*force, 0.0], strict=True)]

    def kicked(self, v: list[float], f: list[float], mass: tuple[float, ...], dt: float) -> list[float]:
        return [speed + dt / m * net for speed, m, net in zip(v, mass, f, strict=True)]

    def stepped(self, state: State, net: Net, mass: tuple[float, ...], dt: float) -> State:
        x, v, f = state
        v = self.kicked(v, f, mass, 0.5 * dt)
        x = [place + dt * speed for place, speed in zip(x, v, strict=True)]
        f = net(x)
        return x, self.kicked(v, f, mass, 0.5 * dt), f

    def frames(self, scene: Scene, deck: Deck) -> tuple[np.ndarray, np.ndarray]:
        """Return steps ``(n_dense,)`` and x, v, f in LAMMPS' columns ``(n_dense, n_body, 7)``."""
        dt, diameter = deck.schedule.step, 2.0 * deck.surrogate_radius

        def net(x: list[float]) -> list[float]:
            overlap = [diameter - (right - left) for left, right in pairwise(x)]
            return self.net_force(self.contact_force(overlap, scene.stiffness))

        start = list(deck.line)
        state: State = (start, list(scene.velocity), net(start))
        step, rows = 0, []
        for row in deck.schedule.dense_steps.tolist():
            while step < row:
                state = self.stepped(state, net, scene.mass, dt)
                step += 1
            rows.append(state)
        values = np.zeros((len(rows), scene.n_body, len(DUMP_COLUMNS)))
        for name, column in zip(("x", "vx", "fx"), np.moveaxis(np.array(rows), 1, 0), strict=True):
            values[:, :, DUMP_COLUMNS.index(name)] = column
        return deck.schedule.dense_steps, values


def run_in_place_of_lammps(code: Callable[[], Code], case: Case) -> Result:
    """Run the case as LAMMPS' backend does, with ``code`` as the engine."""
    decks: list[tuple[Scene, Deck]] = []

    def deck(scene: Scene, **how: Any) -> Deck:
        decks.append((scene, deck_of(scene, **how)))
        return decks[-1][1]

    def engine(folder: Path, input_file: str, **how: Any) -> EngineReport:
        return EngineReport(version=0, packages=(), wall=0.0, cpu=0.0)

    def dump(path: Path, columns: int) -> tuple[np.ndarray, np.ndarray]:
        return code().frames(*decks[-1])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lammps, "deck_of", deck)
        patch.setattr(lammps, "run_deck", engine)
        patch.setattr(lammps, "read_binary_dump", dump)
        return run_case(case)


@cache
def runs_of(code: Callable[[], Code]) -> Results:
    """Return all runs of the free scene, with ``code`` in place of LAMMPS in each of them, refinement levels too."""
    return BENCH.runs_with(partial(run_in_place_of_lammps, code))
