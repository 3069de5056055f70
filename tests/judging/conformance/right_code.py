"""A right code of its own: velocity Verlet or leapfrog in numba; it shares nothing with the grader or the backends.

It reads the JSON that ``dem-bridge conform`` writes, so that a misread key of a scene file would show.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit


@njit(cache=True)
def force(x: Any, v: Any, wall: Any, k: Any, n: Any, gap: Any, c: Any, power: Any, clip: bool, out: Any) -> None:
    """Write the force of each contact along the line; contact j is in front of body j."""
    bodies = len(x)
    for j in range(bodies + 1):
        left = x[j - 1] if j > 0 else 0.0
        right = x[j] if j < bodies else 0.0
        vl = v[j - 1] if j > 0 else 0.0
        vr = v[j] if j < bodies else 0.0
        depth = left - right - gap[j]
        out[j] = 0.0
        if (0 < j < bodies or wall[j]) and depth > 0.0:
            out[j] = k[j] * depth ** (n[j] - 1.0) + c[j] * depth ** power[j] * (vl - vr)
            if clip and out[j] < 0.0:
                out[j] = 0.0


@njit(cache=True)
def verlet(
    m: Any, v: Any, free: Any, wall: Any, k: Any, n: Any, gap: Any, c: Any, power: Any, clip: bool,
    dt: float, every: int, samples: int,
) -> Any:  # fmt: skip
    """Return displacements and velocities; damping takes the velocity that a step of Euler predicts."""
    bodies = len(m)
    x, a, f = np.zeros(bodies), np.zeros(bodies), np.zeros(bodies + 1)
    xs, vs = np.zeros((samples + 1, bodies)), np.zeros((samples + 1, bodies))
    vs[0] = v
    force(x, v, wall, k, n, gap, c, power, clip, f)
    a = free + (f[:-1] - f[1:]) / m
    for sample in range(1, samples + 1):
        for _ in range(every):
            half = v + 0.5 * dt * a
            x = x + dt * half
            force(x, half + 0.5 * dt * a, wall, k, n, gap, c, power, clip, f)
            a = free + (f[:-1] - f[1:]) / m
            v = half + 0.5 * dt * a
        xs[sample], vs[sample] = x, v
    return xs, vs


def alpha(law: str, e: float, n: float) -> float:
    """Return the factor of a damping force by a coefficient of restitution."""
    if law == "coeff_restitution":
        return -math.sqrt(2.0 * n) * math.log(e) / math.hypot(math.pi, math.log(e))
    polynomial = 1.2728 - 4.2783 * e + 11.087 * e**2 - 22.348 * e**3 + 27.467 * e**4 - 18.022 * e**5 + 4.8218 * e**6
    return math.sqrt(2.0) * polynomial


def numbers(document: dict[str, Any]) -> dict[str, Any]:
    """Return the numbers of a scene file along the line."""
    chain, environment = document["chain"], document.get("environment", {})
    m = np.array(chain["mass"])
    bodies = len(m)
    walls = [chain.get("wall_left"), *[{}] * (bodies - 1), chain.get("wall_right")]
    k = [1.0, *chain["stiffness"], 1.0]
    n = [2.5, *chain["exponent"], 2.5]
    gap = [0.0, *chain["gap"], 0.0]
    for at in (0, bodies):
        if walls[at]:
            k[at], n[at], gap[at] = walls[at]["stiffness"], walls[at]["exponent"], walls[at]["gap"]
    free = np.full(bodies, environment.get("gravity", 0.0))
    if (static := chain.get("precompression", {}).get("force", 0.0)) > 0.0:
        gap = [-((static / stiffness) ** (1.0 / (exponent - 1.0))) for stiffness, exponent in zip(k, n, strict=True)]
        free[0] += 0.0 if walls[0] else static / m[0]
        free[-1] -= 0.0 if walls[-1] else static / m[-1]
    c, power, clip = np.zeros(bodies + 1), np.zeros(bodies + 1), True
    if damping := chain.get("damping"):
        clip, law = damping.get("clip", True), damping["law"]
        # one coefficient per contact of the chain, then the left and the right wall
        given = list(damping["coefficient"])
        coefficient = [0.0, *given[: bodies - 1], 0.0]
        ends = given[bodies - 1 :]
        for at in (0, bodies):
            if walls[at]:
                coefficient[at] = ends.pop(0)
        for j in range(bodies + 1):
            masses = [m[at] for at in (j - 1, j) if 0 <= at < bodies]
            effective = 1.0 / sum(1.0 / mass for mass in masses)
            if not (0 < j < bodies or walls[j]):
                continue
            value = coefficient[j]
            if law == "dashpot":
                c[j] = value
            elif law == "mass_velocity":
                c[j] = value * effective
            elif law == "kuwabara-kono":
                c[j], power[j] = value * k[j], n[j] - 2.0
            else:
                c[j] = alpha(law, value, n[j]) * math.sqrt(effective * k[j])
                power[j] = 0.5 * n[j] - 1.0
    return {
        "m": m, "v": np.array(chain["velocity"]), "free": free, "wall": np.array([bool(w) for w in walls]),
        "k": np.array(k), "n": np.array(n), "gap": np.array(gap), "c": c, "power": power, "clip": clip,
    }  # fmt: skip


def solve(document: dict[str, Any], dt: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times, displacements and velocities of the samples."""
    samples = document["sampling"]["count"]
    interval = document["duration"] / samples
    every = max(1, round(interval / dt))
    xs, vs = verlet(**numbers(document), dt=interval / every, every=every, samples=samples)
    return interval * np.arange(samples + 1), xs, vs


def write(path: Path, time: np.ndarray, x: np.ndarray, v: np.ndarray) -> None:
    """Write the samples as CSV."""
    bodies = range(x.shape[1])
    heads = ["time_s", *(f"displacement_{k}_m" for k in bodies), *(f"velocity_{k}_m_per_s" for k in bodies)]
    rows = [",".join(map(repr, map(float, (t, *a, *b)))) for t, a, b in zip(time, x, v, strict=True)]
    path.write_text("\n".join([",".join(heads), *rows]) + "\n", encoding="utf-8")


def main() -> None:
    """Run as a program: SCENE.json DT OUT."""
    document = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    write(Path(sys.argv[3]), *solve(document, float(sys.argv[2])))


if __name__ == "__main__":
    main()
