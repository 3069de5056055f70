"""A code of the standard library alone, for Hertz chains and walls, that can be told to misbehave in one scene.

    python tiny_code.py MODE SCENE.json DT OUT.csv

MODE is "right", or what it does in the scene "walls": kill, hang, mute, nan, crash, empty or short.
"""

from __future__ import annotations

import json
import math
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any


def forces(x: list[float], k: list[float], gap: list[float]) -> list[float]:
    """Return the force of each contact along the line."""
    line = [0.0, *x, 0.0]
    return [
        stiffness * max(line[j] - line[j + 1] - gap[j], 0.0) ** 1.5 if stiffness else 0.0
        for j, stiffness in enumerate(k)
    ]


def solve(document: dict[str, Any], dt: float) -> list[list[float]]:
    """Return rows of time, displacements and velocities by velocity Verlet."""
    chain, samples = document["chain"], document["sampling"]["count"]
    m, v, n = chain["mass"], list(chain["velocity"]), len(chain["mass"])
    left, right = chain.get("wall_left") or {}, chain.get("wall_right") or {}
    k = [left.get("stiffness", 0.0), *chain["stiffness"], right.get("stiffness", 0.0)]
    gap = [left.get("gap", 0.0), *chain["gap"], right.get("gap", 0.0)]
    interval = document["duration"] / samples
    every = max(1, round(interval / dt))
    step = interval / every
    x = [0.0] * n

    def acceleration() -> list[float]:
        f = forces(x, k, gap)
        return [(f[i] - f[i + 1]) / m[i] for i in range(n)]

    a, rows = acceleration(), [[0.0, *x, *v]]
    for sample in range(1, samples + 1):
        for _ in range(every):
            v = [v[i] + 0.5 * step * a[i] for i in range(n)]
            x = [x[i] + step * v[i] for i in range(n)]
            a = acceleration()
            v = [v[i] + 0.5 * step * a[i] for i in range(n)]
        rows.append([sample * interval, *x, *v])
    return rows


def main() -> None:
    """Run as a program."""
    mode, scene, dt, out = sys.argv[1:]
    document = json.loads(Path(scene).read_text(encoding="utf-8"))
    rows = solve(document, float(dt))
    if document["name"] == "walls":
        if mode == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        elif mode == "hang":
            os.fork()  # a child that hangs, too, must not remain
            time.sleep(3600.0)
        elif mode == "mute":
            return
        elif mode == "crash":
            raise ValueError("no walls today")
        elif mode == "nan":
            rows = [[row[0], *[math.nan] * (len(row) - 1)] for row in rows]
        elif mode == "empty":
            rows = []
        elif mode == "short":
            rows = rows[:7]
    bodies = range(len(document["chain"]["mass"]))
    heads = ["time_s", *(f"displacement_{k}_m" for k in bodies), *(f"velocity_{k}_m_per_s" for k in bodies)]
    text = "\n".join([",".join(heads), *(",".join(map(repr, row)) for row in rows)])
    Path(out).write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
