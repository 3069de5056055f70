"""A Dask scheduler and its workers as processes of their own, as on a cluster, on the loopback interface."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.helpers.processes import happens

ROOT = Path(__file__).parents[2]


class Cluster:
    """Hold the scheduler file, and the processes."""

    def __init__(self, folder: Path) -> None:
        self.file = folder / "scheduler.json"
        self._folder = folder
        self.workers: list[subprocess.Popen[bytes]] = []
        self.scheduler = self._start("dask_scheduler", "--port", "0")
        assert happens(self.file.exists)

    def add_worker(self, **variables: str) -> subprocess.Popen[bytes]:
        # without a nanny: a worker that is killed stays dead
        worker = self._start("dask_worker", "--nthreads", "1", "--no-nanny", "--death-timeout", "60", **variables)
        self.workers.append(worker)
        return worker

    def _start(self, program: str, *words: str, **variables: str) -> subprocess.Popen[bytes]:
        place = ("--scheduler-file", str(self.file), "--host", "127.0.0.1", "--no-dashboard")
        path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
        with (self._folder / f"{program}-{len(self.workers)}.log").open("wb") as log:
            return subprocess.Popen(
                [sys.executable, "-m", f"distributed.cli.{program}", *place, *words],
                cwd=self._folder,
                stdout=log,
                stderr=log,
                env={**os.environ, "PYTHONPATH": path, **variables},
            )


@contextmanager
def dask_cluster(folder: Path, workers: int) -> Iterator[Cluster]:
    """Provide a cluster; its processes are ended."""
    cluster = Cluster(folder)
    try:
        for _ in range(workers):
            cluster.add_worker()
        yield cluster
    finally:
        for process in (*cluster.workers, cluster.scheduler):
            process.kill()
            process.wait()
