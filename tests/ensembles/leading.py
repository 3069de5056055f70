"""Print how often the numbers that are named contain the one with the largest index, over 100 seeds.

``python -m tests.ensembles.leading``. The chains are six spheres with five varied stiffnesses. The true indices are
those of a tensor rule of Gauss for normal deviates, which shares with the study only the solution of the chains.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.special import ndtr

from dem_bridge.ensembles.draw import Variation
from dem_bridge.ensembles.sensitivity import sobol_indices
from dem_bridge.ensembles.solve import solve_chains, steps_for
from dem_bridge.scene.scene import Scene

SEEDS = 100
SIX = Scene(name="six", duration=4e-4, mass=(0.01,) * 6, stiffness=(2e10,) * 5, velocity=(0.8, 0.0, 0.0, 0.0, 0.0, 0.0))
VARY = {"stiffness": 0.1}
NAMES = ("arrival", "velocity ratio", "force at contact 0", "force at contact 2", "force at contact 4")


def measures(values: dict[str, Any]) -> Any:
    """Return the measures of :data:`NAMES`, ``(n_measure, n_chain)``."""
    ratio = values["peak_velocity"][:, -1] / values["peak_velocity"][:, 0]
    return np.array([values["arrival_at_end"], ratio, *values["peak_force"][:, ::2].T])


def by_quadrature(nodes: int = 7) -> Any:
    """Return the first-order indices ``(n_measure, 5)``."""
    node, weight = np.polynomial.hermite_e.hermegauss(nodes)
    weight = weight / weight.sum()
    grid = np.stack(np.meshgrid(*[node] * 5, indexing="ij"), axis=-1).reshape(-1, 5)
    variation = Variation(scene=SIX, vary=VARY)
    steps = steps_for(SIX, variation.block(0, 32), 1e-5)
    values = measures(solve_chains(SIX, variation.chains(ndtr(grid)), steps)).reshape(-1, *[nodes] * 5)
    mean = np.einsum("kabcde,a,b,c,d,e->k", values, *[weight] * 5)
    away = values - mean.reshape(-1, *[1] * 5)
    variance = np.einsum("kabcde,a,b,c,d,e->k", away**2, *[weight] * 5)
    indices = []
    for axis in "abcde":
        others = [letter for letter in "abcde" if letter != axis]
        conditional = np.einsum(f"kabcde,{','.join(others)}->k{axis}", away, *[weight] * 4)
        indices.append(conditional**2 @ weight / variance)
    return np.stack(indices, axis=1)


def main() -> None:
    """Print the shares."""
    true = by_quadrature()
    largest = np.argmax(true, axis=1)
    for base in (16, 64, 256):
        named, sizes, plain = np.zeros(len(NAMES)), np.zeros(len(NAMES)), np.zeros(len(NAMES))
        for seed in range(SEEDS):
            found = sobol_indices(Variation(scene=SIX, vary=VARY, seed=seed), measures, base=base)
            named += found.leading[np.arange(len(NAMES)), largest]
            sizes += np.sum(found.leading, axis=1)
            plain += np.argmax(found.first, axis=1) == largest
        for row, name in enumerate(NAMES):
            shares = " ".join(f"{100 * share:5.1f}" for share in true[row])
            print(
                f"base {base}, {name}: true indices {shares} %; the largest is named {named[row]:.0f} of {SEEDS}, alone"
                f" the largest estimate {plain[row]:.0f}; numbers named on average {sizes[row] / SEEDS:.2f} of 5"
            )


if __name__ == "__main__":
    main()
