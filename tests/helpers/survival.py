"""A campaign as a program that can be killed, and what is left of it.

``python -m tests.helpers.survival run STORE CASES JOBS KIND`` prints a line of JSON: a digest of all trajectories,
their number, how many are from the store, and the problem with the store. It is a command as those of ``dem-bridge``,
with the option ``--json-progress``.
"""

from __future__ import annotations

import hashlib
import json
import os
import random
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import cycle
from pathlib import Path
from types import MappingProxyType
from typing import Any

import click

from dem_bridge.foundation.leftovers import SHARED_MEMORY
from tests.helpers.processes import PATIENCE, all_end, happens, pause

ROOT = Path(__file__).parents[2]
COUNTED = Path(__file__).with_name("counted")


def program() -> click.Group:
    """Return the campaign as a command of a group as ``dem-bridge``."""
    from dem_bridge.cli.group import _Group

    words = [click.Argument([name]) for name in ("folder", "count", "jobs", "kind")]
    option = click.Option(["--json-progress", "json_progress"], is_flag=True)
    return _Group(commands=[click.Command("run", callback=main, params=[*words, option])])


def main(folder: str, count: str, jobs: str, kind: str, json_progress: bool) -> None:
    """Run the campaign and print what came out.

    ``kind``: "twin", "lammps-1", or "lammps" for one and two ranks in turn.
    """
    from dem_bridge.backends.base import Resolution, Sampling
    from dem_bridge.cli.waiting import bar
    from dem_bridge.lmp.engine import Engine
    from dem_bridge.runs.campaign import run_cases
    from dem_bridge.runs.case import Case
    from dem_bridge.runs.store import Store
    from dem_bridge.scene.scene import Scene

    scenes = [
        Scene(name=f"n{n}", duration=2e-4, mass=(1e-2,) * 3, stiffness=(4e9,) * 2, velocity=(0.5 + 1e-3 * n, 0.0, 0.0))
        for n in range(int(count))
    ]

    def lammps(dt: float, ranks: int) -> dict[str, Any]:
        return {"backend": "lammps-granular", "resolution": Resolution(dt=dt), "engine": Engine(ranks=ranks)}

    runs_of: dict[str, list[dict[str, Any]]] = {
        "twin": [{"backend": "verlet", "resolution": Resolution(dt=5e-10)}],
        # two ranks wait for each other at every step, which takes long on a busy machine
        "lammps": [lammps(1e-9, 1), lammps(1e-6, 2)],
        "lammps-1": [lammps(1e-9, 1)],
    }
    settings = cycle(runs_of[kind])
    cases = [Case(scene=scene, sampling=Sampling(count=20), uncertainty=False, **next(settings)) for scene in scenes]
    store = Store(folder)
    with bar(json_progress) as progress:
        results = run_cases(cases, jobs=int(jobs), store=store, progress=progress)
    runs = [result.trajectory for result in results if result.trajectory is not None]
    digest = hashlib.sha256(b"".join(run.velocity.tobytes() for run in runs)).hexdigest()
    stored = sum("stored" in run.provenance for run in runs)
    print(json.dumps({"digest": digest, "runs": len(runs), "stored": stored, "trouble": store.trouble}))


@dataclass
class Survival:
    """Campaigns over one store, and the runs that they made."""

    folder: Path
    cases: int
    jobs: int = 2
    kind: str = "twin"
    python: str = sys.executable
    store: Path = field(init=False)
    temporary: Path = field(init=False)
    killed: set[int] = field(default_factory=set)
    """Processes of the campaigns that were killed, with their workers and engines."""

    def __post_init__(self) -> None:
        self.store, self.temporary = self.folder / "store", self.folder / "temporary"
        self.temporary.mkdir(parents=True)

    def halt(self, ended: int = sys.maxsize) -> None:
        """Let no run begin when so many have ended in all."""
        part = self.folder / "halt.part"
        part.write_text(str(ended))
        part.replace(self.folder / "halt")

    def begin(
        self,
        *options: str,
        halt: int = sys.maxsize,
        prepare: Callable[[], object] = int,
        variables: Mapping[str, str] = MappingProxyType({}),
    ) -> subprocess.Popen[str]:
        """Start a campaign, in a session of its own; it begins no run when so many have ended in all.

        ``prepare`` is called in the new process before the program begins; ``variables`` are of its environment.
        """
        self.halt(halt)
        others = variables.get("PYTHONPATH", os.environ.get("PYTHONPATH", ""))
        path = os.pathsep.join([str(COUNTED), str(ROOT), *others.split(os.pathsep)])
        own = {"DEM_BRIDGE_COUNT": str(self.folder / "count"), "DEM_BRIDGE_HALT": str(self.folder / "halt")}
        words = (str(self.store), str(self.cases), str(self.jobs), self.kind)
        return subprocess.Popen(
            [self.python, "-m", "tests.helpers.survival", "run", *words, *options],
            env={**os.environ, "TMPDIR": str(self.temporary), **own, **variables, "PYTHONPATH": path},
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            # where the tests run in the background Ctrl-C is ignored, and children inherit that
            preexec_fn=lambda: (signal.signal(signal.SIGINT, signal.default_int_handler), prepare()),
        )

    def begin_and_kill(self, *, ended: int, whole: bool, later: float = 0.0) -> None:
        """Start a campaign, and kill it, or its main process only, ``later`` s after so many runs have ended in all."""
        program = self.begin(halt=ended + self.jobs)
        assert happens(lambda: self.counted("end") >= ended or program.poll() is not None)
        pause(later)
        assert program.poll() is None, program.communicate()
        self.killed |= {program.pid, *self.processes()}
        (os.killpg if whole else os.kill)(program.pid, signal.SIGKILL)
        program.communicate(timeout=PATIENCE)

    def finish(self, program: subprocess.Popen[str]) -> dict[str, Any]:
        """Return what a campaign prints when it is let end; no process of it remains."""
        out, err = program.communicate(timeout=PATIENCE)
        assert (program.returncode, err) == (0, "")
        return dict(json.loads(out))

    def counted(self, word: str) -> int:
        """Return how many runs have begun ("begin"), ended ("end") or are halted ("wait")."""
        path = self.folder / "count"
        lines = path.read_text().splitlines() if path.exists() else []
        return sum(line.startswith(word) for line in lines)

    def processes(self) -> list[int]:
        """Return the processes of all campaigns over this store, with their workers."""
        mark = f"DEM_BRIDGE_COUNT={self.folder / 'count'}".encode()
        return [int(path.parent.name) for path in Path("/proc").glob("[0-9]*/environ") if mark in content(path)]

    def all_ended(self) -> bool:
        """Return whether all processes of all campaigns end."""
        return all_end(self.processes())

    def left(self) -> list[str]:
        """Return what lies beside entries in the folders, and the shared memory of killed processes."""
        paths = [path for folder in (self.store, self.temporary) for path in folder.iterdir()]
        paths += [path for pid in self.killed for path in SHARED_MEMORY.glob(f"mpich_shm_{pid:x}_*")]
        return [path.name for path in paths if path.suffix != ".run"]


def content(path: Path) -> bytes:
    """Return the content of a file; nothing if it cannot be read."""
    try:
        return path.read_bytes()
    except OSError:  # it has ended, or is of another user
        return b""


def moments(seed: int, number: int, most: int) -> Sequence[int]:
    """Return numbers of runs after which a campaign is killed, at random shares of its progress, in order."""
    draw = random.Random(seed)
    return sorted(draw.randint(0, most) for _ in range(number))


if __name__ == "__main__":
    program().main(sys.argv[1:])
