"""Measure how a campaign of runs of about half a second scales from one worker to two, by processes and by Dask.

``make bench`` runs this (a minute on a quiet machine); longer runs scale better. Runs that only wait show what the
engine costs alone; runs of the twin show what the cores give besides. Rounds alternate between one worker and two, so
that a machine that slows down for a while slows both. Starting processes, which is paid once for a campaign, is left
out.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import dem_bridge as db
from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.foundation.progress import Campaign
from dem_bridge.runs.campaign import run_cases
from dem_bridge.runs.campaign.cluster import connected
from dem_bridge.runs.campaign.executors import run_by_executor, workers_of
from dem_bridge.runs.campaign.pool import run_in_processes
from dem_bridge.runs.campaign.tasks import Task
from dem_bridge.runs.case import Case
from tests.helpers.campaign_cases import with_action
from tests.helpers.dask_cluster import dask_cluster
from tests.helpers.processes import happens

SCENE = "decelerating-40"
#: runs of a campaign, the step of the twin and the wait (s) of each, and rounds
SIZES = (6, 2.3e-10, 0.5, 2)
TINY = (4, 1e-6, 0.01, 1)


def _twins(count: int, dt: float) -> list[Case]:
    settings: dict[str, Any] = {"scene": db.load_scene(SCENE), "sampling": Sampling(count=100), "uncertainty": False}
    # each is another, for equal cases are run once
    steps = [Resolution(dt=dt * (1.0 + 1e-3 * nth)) for nth in range(count)]
    return [Case(backend="verlet", resolution=step, **settings) for step in steps]


def _by_processes(cases: Sequence[Case], workers: int) -> float:
    """Return the wall time of a run, s, without the first of each worker, whose start it includes."""
    tasks = [Task(name=str(nth), case=case) for nth, case in enumerate(cases)]
    state = Campaign(total=len(tasks), done=0)
    times = [time.perf_counter() for _ in run_in_processes(tasks, workers, state, main=False)]
    return (times[-1] - times[workers - 1]) / (len(cases) - workers)


def _by_dask(cases: Sequence[Case], workers: int) -> float:
    with (
        tempfile.TemporaryDirectory() as folder,
        dask_cluster(Path(folder), workers) as cluster,
        connected(str(cluster.file)) as executor,
    ):
        happens(lambda: workers_of(executor) == workers)
        run_cases(_twins(2 * workers, TINY[1]), jobs=executor)  # modules are imported, kernels loaded
        tasks = [Task(name=str(nth), case=case) for nth, case in enumerate(cases)]
        began, state = time.perf_counter(), Campaign(total=len(tasks), done=0)
        assert len(list(run_by_executor(tasks, executor, state))) == len(tasks)
        return (time.perf_counter() - began) / len(cases)


def main(*, tiny: bool = False) -> int:
    """Print the time of a run and the efficiency of two workers; 1 if waiting runs reach less than 90 % of linear."""
    count, dt, wait, rounds = TINY if tiny else SIZES
    kinds = {"waiting": [with_action(time.sleep, wait) for _ in range(count)], "the twin": _twins(count, dt)}
    engines: dict[str, Callable[[Sequence[Case], int], float]] = {"processes": _by_processes, "Dask": _by_dask}
    least = 1.0
    for engine, seconds in engines.items():
        for kind, cases in kinds.items():
            pairs = [(seconds(cases, 1), seconds(cases, 2)) for _ in range(rounds)]
            alone, both = (statistics.median(column) for column in zip(*pairs, strict=True))
            shares = sorted(one / (2.0 * two) for one, two in pairs)
            share = statistics.median(shares)
            least = min(least, share) if kind == "waiting" else least
            print(
                f"{engine}, {count} runs of {kind}: {alone:.2f} s each by one worker, {both:.2f} s by two:"
                f" {100 * share:.0f} % of linear ({100 * shares[0]:.0f} to {100 * shares[-1]:.0f} %)",
                flush=True,
            )
    return int(least < 0.9)


if __name__ == "__main__":
    sys.exit(main())
