"""Tell how often the judge names the faults of small codes: python -m tests.judging.measure_own_codes --seed 1.

Each fault is planted in a chain of the seed, at several steps and intervals; right files are judged for false alarms.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import dem_bridge as db
from tests.helpers.own_code import FAULTS, Output, chain, planted


def outputs(seed: int) -> Iterator[Output]:
    """Yield steps, intervals and lengths of runs."""
    duration = chain(seed).duration
    for part, every, length in ((4000, 40, 1.0), (1000, 7, 1.0), (500, 1, 2.3), (12000, 100, 0.7)):
        yield Output(dt=float(f"{duration / part:.2g}"), every=every, length=length)


def main() -> None:
    """Judge all files and print a line for each cause."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1, help="first seed")
    parser.add_argument("-n", type=int, default=1, help="number of seeds")
    parser.add_argument("--cause", action="append", choices=list(FAULTS))
    parser.add_argument("--steps", type=int, nargs="*", help="numbers of the outputs; all by default")
    options = parser.parse_args()
    for cause in options.cause or FAULTS:
        named: Counter[str] = Counter()
        for seed in range(options.seed, options.seed + options.n):
            for which in range(len(FAULTS[cause])):
                for number, output in enumerate(outputs(seed)):
                    if options.steps and number not in options.steps:
                        continue
                    kinds = {"damped": cause == "clip" or seed % 5 == 4, "gaps": seed % 3 == 2 and cause != "clip"}
                    with tempfile.TemporaryDirectory() as folder:
                        path, scene = planted(Path(folder), cause, which, seed, output, **kinds)
                        answer = db.judge(f"{path}@{output.dt!r}", scene)
                    named[answer.cause] += 1
                    if answer.cause != cause:
                        error = next(iter(answer.error.values()))
                        size = error["value"] / (error["scale"] or np.nan)
                        print(
                            f"   {cause}/{which} seed {seed} output {number} ({size:.1e}): {answer.cause}"
                            f" {answer.where} {answer.alternatives}: {answer.evidence}",
                            flush=True,
                        )
        print(f"{cause:24} {dict(named)}", flush=True)


if __name__ == "__main__":
    main()
