"""Count the truths of many random scenes that lie outside of the stated uncertainty, by backend and quantity.

``python -m tests.uncertainty.measure_bars -n 500 --seed 1`` takes 500 of the scenes of :mod:`tests.helpers.many_scenes`
at random. Codes with a fixed step run at their default one. A finite uncertainty of what does not exist, or of what the
run does not have, counts as outside. References must have none outside, others at most 1 %.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest

import dem_bridge as db
from dem_bridge.backends.base import backend, unsupported_reason
from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.scene import Scene
from tests.helpers.many_scenes import QUANTITIES, Truth, many

REFERENCES = ("reference", "scipy")
OTHERS = ("verlet", "blanes-moan", "ode45")
#: part of the truths that may lie outside for codes that are no references
ALLOWED = 0.01


@dataclass(frozen=True)
class Trial:
    """Compare one run with its truth."""

    backend: str
    scene: str
    ratio: dict[str, float]
    """Error over uncertainty, the worst of all bodies or contacts."""
    width: dict[str, float]
    """Uncertainty over error, the median of all bodies or contacts."""


def try_backend(name: str, pairs: Sequence[tuple[Scene, Truth]]) -> list[Trial]:
    """Return the trials of a backend on the scenes that it supports and does not refuse."""
    trials = []
    for scene, truth in pairs:
        if unsupported_reason(backend(name), scene):
            continue
        try:
            run = db.solve(scene, backend=name)
        except (RunBroken, UsageError):
            continue
        ratio, width = (
            {quantity: measure(run, quantity) for quantity in QUANTITIES} for measure in (truth.outside, truth.width)
        )
        trials.append(Trial(name, scene.name, ratio, width))
    return trials


def summary(trials: Sequence[Trial]) -> list[str]:
    """Return a line for each quantity: how many truths lie outside, the 95 % interval (Clopper-Pearson), widths."""
    lines = []
    for quantity in QUANTITIES:
        ratios = np.array([trial.ratio[quantity] for trial in trials])
        outside = int(np.sum(ratios > 1.0))
        sure = binomtest(outside, len(trials)).proportion_ci()
        width = float(np.nanmedian([trial.width[quantity] for trial in trials]))
        worst = trials[int(np.argmax(ratios))]
        lines.append(
            f"{worst.backend:12} {quantity:14} {outside:5d} of {len(trials):5d} outside,"
            f" {100 * sure.low:.2f} to {100 * sure.high:.2f} %; largest error over uncertainty"
            f" {ratios.max():.3g} ({worst.scene}), median uncertainty over error {width:.3g}"
        )
    return lines


def enough(trials: Sequence[Trial], allowed: float) -> bool:
    """Return whether at most this part of the truths lies outside for every quantity."""
    parts = (np.mean([trial.ratio[quantity] > 1.0 for trial in trials]) for quantity in QUANTITIES)
    return all(part <= allowed for part in parts)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the summaries; return 1 where more lie outside than may."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("-n", type=int, default=200, help="number of scenes")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--backend", action="append", help="one or several; default: all of them")
    options = parser.parse_args(arguments)
    pairs, failed = many(), 0
    chosen = np.random.default_rng(options.seed).permutation(len(pairs))[: options.n]
    for name in options.backend or (*REFERENCES, *OTHERS):
        trials = try_backend(name, [pairs[i] for i in chosen.tolist()])
        print("\n".join(summary(trials)), flush=True)
        failed += not enough(trials, 0.0 if name in REFERENCES else ALLOWED)
    return min(failed, 1)


if __name__ == "__main__":
    sys.exit(main())
