"""Compile all kernels in two processes before parallel tests begin, because each of those would compile them again.

python -m tests.helpers.compile_kernels
"""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from typing import Any

import numpy as np

import dem_bridge as db
from dem_bridge.judging.model import Model
from dem_bridge.scene.scene import Damping, Scene

HERTZ = Scene(
    name="three", duration=1e-5, mass=(8e-3, 1e-2, 1e-2), stiffness=(4e9, 4e9), velocity=(0.8, 0.0, 0.0), samples=2
)
GRADED = replace(HERTZ, exponent=(2.5, 2.4))
DAMPED = replace(HERTZ, damping=Damping(law="dashpot", coefficient=1.0))
LAW = replace(HERTZ, law=lambda overlap: 4e9 * overlap**1.5)
#: backend and settings of the runs in each process, which take about the same time
PARTS: tuple[tuple[tuple[str, Scene, dict[str, Any]], ...], ...] = (
    (("reference", HERTZ, {}), ("scipy", DAMPED, {}), ("blanes-moan", HERTZ, {})),
    (
        ("verlet", HERTZ, {}),
        ("verlet", GRADED, {"tables": True}),
        ("verlet", LAW, {}),
        ("scipy", GRADED, {}),
        ("ode45", HERTZ, {}),
    ),
)


def compile_part(part: int) -> None:
    """Make the runs of a part, after which its kernels are in numba's cache."""
    for backend, scene, settings in PARTS[part]:
        db.solve(scene, backend=backend, **settings)
    if part == 0:
        model = Model(HERTZ)
        model.exact(model.system, np.array([0.0, 1e-6]))
        model.stepped(model.system, np.array([0, 1]), 1e-7)
        db.ensemble(HERTZ, {"mass": 0.1}, n=2, checks=0)


def main() -> None:
    """Compile all parts side by side."""
    words = [sys.executable, "-m", "tests.helpers.compile_kernels"]
    processes = [subprocess.Popen([*words, str(part)]) for part in range(len(PARTS))]
    codes = [process.wait() for process in processes]
    if any(codes):
        sys.exit("a kernel does not compile")


if __name__ == "__main__":
    compile_part(int(sys.argv[1])) if sys.argv[1:] else main()
