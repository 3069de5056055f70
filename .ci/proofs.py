"""Write the certificates of reports/proofs, and compare the reference with proofs of many small chains.

    python .ci/proofs.py write [NAME ...]     certificates; all of them, or those named
    python .ci/proofs.py compare COUNT        chains of 2 to 5 bodies: is the reference inside at its own accuracy?

An unfinished certificate is continued.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import dem_bridge as db

FOLDER = Path(__file__).parents[1] / "reports" / "proofs"
IMPACTS = ("1-glass", "1-limestone", "2-aluminium", "2-magnesium", "3-alumina", "3-cast-iron")
LONG = ("accelerating-40", "decelerating-40")
#: samples of a small scene
SAMPLES = 100


def small_chain(seed: int, bodies: int) -> db.Scene:
    """Return a random chain with gaps, initial overlaps, a wall, gravity or a precompression."""
    rng = np.random.default_rng(seed)
    contacts = bodies - 1
    pressed = seed % 5 == 4
    gaps = 0.0 if pressed else tuple(rng.choice([0.0, 1e-6, -2e-7], contacts).tolist())
    wall = seed % 2 == 1 or pressed
    return db.Scene(
        name=f"chain-{bodies}-{seed}",
        duration=3e-4,
        mass=tuple(rng.uniform(5e-3, 2e-2, bodies).tolist()),
        stiffness=tuple((10 ** rng.uniform(9.5, 10.8, contacts)).tolist()),
        velocity=(float(rng.uniform(0.3, 1.0)), *rng.uniform(-0.1, 0.1, contacts).tolist()),
        gap=gaps,
        wall_left=db.Wall(stiffness=6e9) if pressed else None,
        wall_right=db.Wall(stiffness=8e9, gap=0.0 if pressed else 1e-6) if wall else None,
        precompression=5.0 if pressed else 0.0,
        gravity=9.81 if seed % 3 == 0 else 0.0,
        samples=SAMPLES,
    )


def scenes() -> dict[str, db.Scene]:
    """Return all scenes with a certificate."""
    cradle = replace(db.load_scene("newtons-cradle"), name="newtons-cradle-undamped", damping=None, samples=SAMPLES)
    impacts = [replace(db.load_scene(f"chung-ooi-{name}"), samples=SAMPLES) for name in IMPACTS]
    chains = [small_chain(seed, 3 + seed % 8) for seed in range(10)]
    long = [db.load_scene(name) for name in LONG]
    return {scene.name: scene for scene in (cradle, *impacts, *chains, *long)}


def write(names: list[str]) -> None:
    """Write certificates, and print a line for each."""
    for name, scene in scenes().items():
        if not names or name in names:
            proof = db.prove(scene, file=FOLDER / f"{name}.json")
            print(f"{proof!s}\n  {proof.certificate['bits']} bits", flush=True)


def compare(count: int) -> None:
    """Print how many runs of the reference are outside, and the median of its uncertainty over its error."""
    outside, ratios = [], []
    for seed in range(count):
        scene = replace(small_chain(1000 + seed, 2 + seed % 4), samples=30)
        proof, run = db.prove(scene), db.solve(scene, backend="reference")
        if not proof.complete:
            print(f"{scene.name}: {proof.reason}", flush=True)
            continue
        for name in ("velocity", "displacement", "peak_force", "crossing_time"):
            errors = np.abs(getattr(run, name) - getattr(proof, name)) - getattr(proof, f"{name}_radius")
            known = np.isfinite(getattr(proof, name))  # a contact may have no crossing time
            bars = np.broadcast_to(run.uncertainty[name], errors.shape)[known]
            share = float(np.max(errors[known] / bars, initial=0.0))
            ratios.append(1.0 / max(share, np.finfo(float).tiny))
            if share > 1.0:
                outside.append(f"{scene.name} {name}: error of {share:.3g} uncertainties")
        print(f"{seed + 1} scenes, {len(outside)} outside, median ratio {np.median(ratios):.3g}", flush=True)
    print("\n".join(outside))


if __name__ == "__main__":
    if sys.argv[1] == "write":
        write(sys.argv[2:])
    else:
        compare(int(sys.argv[2]))
