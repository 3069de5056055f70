"""Write the certificates of reports/proofs, and compare the reference with proofs of many small chains.

    python .ci/proofs.py write [NAME ...]     certificates; all of them, or those named
    python .ci/proofs.py compare COUNT        chains of 2 to 5 bodies: are codes inside at their own accuracy?

An unfinished certificate is continued.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

import dem_bridge as db
from dem_bridge.verification.proved import proved_motion

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
        # powers of Python are the same on all processors, and the hash of the scene with them
        stiffness=tuple(10.0**power for power in rng.uniform(9.5, 10.8, contacts).tolist()),
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


class Comparison:
    """Errors of a code against proved motions, relative to the uncertainty that the code states."""

    def __init__(self, backend: str) -> None:
        self.backend, self.scenes = backend, 0
        self.ratios, self.outside = list[float](), list[str]()

    def add(self, scene: str, shares: Mapping[str, float]) -> None:
        """Take the largest error of each quantity over its uncertainty."""
        self.scenes += 1
        for name, share in shares.items():
            self.ratios.append(1.0 / max(share, np.finfo(float).tiny))
            if not share <= 1.0:
                self.outside.append(f"{scene} {name}: error of {share:.3g} uncertainties")

    def __str__(self) -> str:
        """Return how many errors are larger than the uncertainty, and how wide it is."""
        text = f"{self.backend}: {self.scenes} scenes, {len(self.ratios)} quantities, {len(self.outside)} outside"
        return "\n".join([f"{text}, median ratio {np.median(self.ratios):.3g}", *self.outside])


def shares_of(proof: db.Proof, run: db.Trajectory) -> dict[str, float]:
    """Return the errors of a run that its uncertainty must cover, relative to it."""
    shares = {}
    for name in ("velocity", "displacement", "peak_force", "crossing_time"):
        errors = np.abs(getattr(run, name) - getattr(proof, name)) - getattr(proof, f"{name}_radius")
        known = np.isfinite(getattr(proof, name))  # a contact may have no crossing time
        bars = np.broadcast_to(run.uncertainty[name], errors.shape)[known]
        shares[name] = float(np.max(errors[known] / bars, initial=0.0))
    return shares


def compare(count: int) -> None:
    """Print how many errors of reference and scipy are outside; scipy, which is slow, runs a fifth of the scenes."""
    reference, scipy, kept = Comparison("reference"), Comparison("scipy"), Comparison("reference, certificates")
    for seed in range(count):
        scene = replace(small_chain(1000 + seed, 2 + seed % 4), samples=30)
        proof = db.prove(scene)
        if not proof.complete:
            print(f"{scene.name}: {proof.reason}", flush=True)
            continue
        reference.add(scene.name, shares_of(proof, db.solve(scene, backend="reference")))
        if seed % 5 == seed % 4:  # each number of bodies as often
            scipy.add(scene.name, shares_of(proof, db.solve(scene, backend="scipy")))
        if seed % 10 == 9 or seed == count - 1:
            print(reference, scipy, sep="\n", flush=True)
    for name, scene in scenes().items():
        if (motion := proved_motion(scene)) is not None:
            run = db.solve(scene, backend="reference")
            kept.add(name, {key: motion.difference(key, run) / motion.uncertainty(key, run) for key in motion.values})
    print(kept)


if __name__ == "__main__":
    if sys.argv[1] == "write":
        write(sys.argv[2:])
    else:
        compare(int(sys.argv[2]))
