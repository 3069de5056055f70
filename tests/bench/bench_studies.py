"""Measure the CPU time of studies from an empty store, and of a second call. See `make bench`.

``python -m tests.bench.bench_studies all`` measures every study that needs no file, in some ten minutes, and
``... bench_studies energy order`` these two; `make bench` measures the three quickest. The CPU time is that of the
command and of all processes that it starts. A machine that has never run a study compiles its kernels first: measure
twice there.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from tests.bench.timing import cpu_seconds, record

CHAIN = "decelerating-40"
#: the command of each study, the quickest first; "measurement" needs a file of measured values
STUDIES: dict[str, tuple[str, ...]] = {
    "horizon": (CHAIN,), "bands": ("driven-dimer",), "precision": (), "rule-of-thumb": (), "stability": (),
    "styles": (CHAIN,), "sensitivity": (CHAIN,), "scatter": (CHAIN,), "restitution": (), "model-hierarchy": (CHAIN,),
    "engine": (), "order": (), "energy": (), "work-precision": (CHAIN,), "extremes": (),
}  # fmt: skip
#: how many of them `make bench` measures
QUICKEST = 3
#: a study of a second, in place of all
TINY = {"energy": ("--contacts", "1000")}


def call(name: str, words: Sequence[str], folder: Path) -> float:
    """Return the CPU time of one call of a study, s; its store is in ``folder``.

    Raises
    ------
    SystemExit
        If the study ends with an error; 1 is no error but says that a verdict is FAIL.
    """
    command = [sys.executable, "-m", "dem_bridge", "study", name, *words, "-o", str(folder / "page")]
    environment = {**os.environ, "DEM_BRIDGE_STORE": str(folder / "store")}
    began = cpu_seconds()
    done = subprocess.run(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    if done.returncode not in (0, 1):
        raise SystemExit(f"study {name} ended with code {done.returncode}: {done.stderr}")
    return cpu_seconds() - began


def main(names: Sequence[str] = (), *, tiny: bool = False) -> int:
    """Print the CPU times of the named studies ("all": of every one); ``tiny`` measures a short one."""
    studies = TINY if tiny else STUDIES
    if list(names) == ["all"]:
        names = tuple(studies)
    if unknown := [name for name in names if name not in studies]:
        raise SystemExit(f"no study here is called {unknown[0]}; allowed: all, or some of {', '.join(studies)}")
    print("study                 empty store   second call   (s of CPU)")
    for name in names or list(studies)[:QUICKEST]:
        with tempfile.TemporaryDirectory() as folder:
            first, again = (call(name, studies[name], Path(folder)) for _ in range(2))
        record(f"study {name}", [first])
        record(f"study {name}, again", [again])
        print(f"{name:20s} {first:12.1f} {again:13.1f}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
