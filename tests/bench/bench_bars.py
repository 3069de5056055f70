"""Count how often error bars hold on random scenes with a truth of their own, for reference and fixed-step codes.

``make bench`` takes every sixth of the 300 scenes (half a minute of CPU time), ``python -m tests.bench.bench_bars 1``
all of them, tests/backends/test_random_bars.py every tenth. Fixed-step codes are tried at 1/25, 1/50 and 1/100 of the
shortest contact time, where many of these scenes are far from converged.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.stats import binomtest

import dem_bridge as db
from dem_bridge.trajectory.trajectory import QUANTITIES
from tests.helpers.random_scenes import COUNT, random_scene, random_truth, shortest_contact

#: of the 300 scenes every sixth
EVERY = 6
#: part of the shortest contact time that is taken as the step
FRACTIONS = (1 / 25, 1 / 50, 1 / 100)
FIXED_STEP = ("verlet", "lammps-granular", "blanes-moan")


@dataclass(frozen=True)
class Trial:
    """Compare the error bars of one run with its errors."""

    seed: int
    outside: dict[str, float]
    """Error over bar, the worst of all contacts: above 1 the bar does not hold."""
    wide: dict[str, float]
    """Bar over error, the median of contacts; nan where there is no error."""
    finite: dict[str, bool]


def trials(backend: str, seeds: Sequence[int], fractions: Sequence[float] = FRACTIONS) -> Iterator[Trial]:
    """Yield a trial for every scene at every step (a reference has none)."""
    for seed in seeds:
        scene, truth = random_scene(seed), random_truth(seed)
        for part in fractions if backend in FIXED_STEP else (None,):
            settings: dict[str, Any] = {} if part is None else {"dt": part * shortest_contact(scene)}
            run = db.solve(scene, backend=backend, **settings)
            outside, wide, finite = {}, {}, {}
            for quantity in QUANTITIES:
                error = truth.error(run, quantity)
                bar = np.broadcast_to(np.atleast_1d(run.uncertainty[quantity]), error.shape)
                real = (error > 1e-300) & np.isfinite(error) & np.isfinite(bar)
                outside[quantity] = truth.outside(run, quantity)
                wide[quantity] = float(np.median(bar[real] / error[real])) if real.any() else math.nan
                finite[quantity] = bool(np.isfinite(bar).all())
            yield Trial(seed, outside, wide, finite)


def _widest(backend: str, quantity: str) -> float:
    """Return the largest median of bar over error that is allowed."""
    if backend not in FIXED_STEP:
        return math.inf
    # errors of order 4 are often smaller than what reading between dense samples may miss, which their bars have
    read_off = quantity in ("peak_force", "crossing_time")
    return 20.0 if backend == "blanes-moan" and read_off else 5.0


def main(*, tiny: bool = False, every: int = EVERY) -> int:
    """Print one table; 1 where bars do not hold as often as they must. ``tiny`` takes two scenes."""
    seeds, fractions = (range(2), FRACTIONS[1:2]) if tiny else (range(0, COUNT, every), FRACTIONS)
    table = Table("backend", "quantity", "runs", "inside", "95 % interval", "finite", "median bar / error", "worst")
    failed = 0
    for backend in ("reference", *FIXED_STEP):
        progress = track(seeds, backend, transient=True)
        runs = [trial for seed in progress for trial in trials(backend, [seed], fractions)]
        least = 0.99 if backend in FIXED_STEP else 1.0
        for quantity in QUANTITIES:
            outside = np.array([run.outside[quantity] for run in runs])
            inside, finite = int(np.sum(outside <= 1.0)), float(np.mean([run.finite[quantity] for run in runs]))
            sure = binomtest(inside, len(runs)).proportion_ci()
            wide = float(np.nanmedian([run.wide[quantity] for run in runs]))
            held = inside >= least * len(runs) and finite >= 0.97 and wide <= _widest(backend, quantity)
            failed += not held
            worst = runs[int(np.argmax(outside))].seed
            table.add_row(
                backend, quantity, str(len(runs)), f"{100 * inside / len(runs):.2f} %",
                f"{100 * sure.low:.1f} .. {100 * sure.high:.1f} %", f"{100 * finite:.1f} %", f"{wide:.2f}",
                f"{outside.max():.2g} (scene {worst})" + ("" if held else "  NOT ENOUGH"),
            )  # fmt: skip
    Console(width=130).print(table)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(every=int(sys.argv[1]) if len(sys.argv) > 1 else EVERY))
