"""Measure the report of the whole paper: the first time, and again when nothing has changed. See `make bench`."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.bench.timing import cpu_seconds, record

#: target on 2 cores, s: the first time, and again
TARGET = (150.0, 6.0)
REPEATS = 3
#: a scene that is verified in seconds, in place of the paper
TINY_SCENE = """\
name = "tiny"
duration = 5e-5
[chain]
mass = [8.1e-3, 1e-2]
stiffness = [4e9]
exponent = 2.5
velocity = [0.8, 0.0]
[sampling]
count = 5
"""


def main(*, tiny: bool = False) -> int:
    """Print the seconds of the first report and the median of those that follow; ``tiny`` verifies one small scene."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scene = ["paper"]
        if tiny:
            (folder / "tiny.toml").write_text(TINY_SCENE, encoding="utf-8")
            scene = [str(folder / "tiny.toml"), "--accuracy", "1e-3"]
        environment = {**os.environ, "DEM_BRIDGE_STORE": str(folder / "store")}
        words = [sys.executable, "-m", "dem_bridge.cli", "verify", *scene, "-o", str(folder / "report")]
        seconds = []
        for _ in range(1 + (1 if tiny else REPEATS)):
            began, cpu = time.perf_counter(), cpu_seconds()
            subprocess.run(words, env=environment, check=True, stdout=subprocess.DEVNULL)
            seconds.append(time.perf_counter() - began)
            record("verify paper, again" if len(seconds) > 1 else "verify paper", [cpu_seconds() - cpu])
    first, again = seconds[0], statistics.median(seconds[1:])
    print(f"verify {'tiny' if tiny else 'paper'}: {first:.1f} s, again {again:.1f} s")
    print(f"target for the paper on 2 cores: {TARGET[0]:.0f} s, again {TARGET[1]:.0f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
