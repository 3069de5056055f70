"""The CPU time of a run: one table, which campaigns, studies and the planner read.

Each number is the CPU time of one core in s. That of a fixed step has a part for the run, one for each dense sample and
one for each evaluation of the forces, the last two with a part for each body. That of a run without a fixed step is a
power law. The parts are needed because samples of LAMMPS are read from text, and because each step has a cost that does
not depend on the bodies.

The numbers are earlier fits of the planner to random scenes, not fitted again since. They were compared with one set of
runs, decelerating-40 on 26 November 2026, whose measured CPU times in s are: verlet 0.016, blanes-moan 0.010,
lammps-granular 0.70, ase 0.15, reference 0.058, scipy 1.9, ode45 0.005.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType

from dem_bridge.backends.catalogue import class_of
from dem_bridge.backends.splitting import FUSED
from dem_bridge.scene.scene import Scene


@dataclass(frozen=True)
class StepCost:
    """CPU time, s, of the parts of a run with a fixed step."""

    run: float
    sample: float
    """Of each dense sample ..."""
    sample_body: float
    """... and for each body in it."""
    evaluation: float
    """Of each evaluation of the forces ..."""
    evaluation_body: float
    """... and for each body in it."""

    def of(self, bodies: int, samples: float, evaluations: float) -> float:
        """Return the CPU time of a run, s, from its dense samples and evaluations of the forces."""
        by_sample = samples * (self.sample + self.sample_body * bodies)
        return self.run + by_sample + evaluations * (self.evaluation + self.evaluation_body * bodies)


@dataclass(frozen=True)
class PowerCost:
    """CPU time, s, ``run + factor bodies**b coarse_steps**s (rtol / 1e-6)**t`` of a run without a fixed step."""

    run: float
    factor: float = 0.0
    bodies: float = 0.0
    coarse_steps: float = 0.0
    """Of the steps of the prescan."""
    tolerance: float = 0.0

    def of(self, bodies: int, coarse_steps: float, rtol: float) -> float:
        """Return the CPU time of a run, s."""
        work = self.factor * bodies**self.bodies * coarse_steps**self.coarse_steps
        return float(self.run + work * (rtol / 1e-6) ** self.tolerance)


#: codes with a fixed step; those that are not named run by a kernel of this package
STEPS: Mapping[str, StepCost] = MappingProxyType(
    {
        "fast kernel": StepCost(4.0e-4, 5.0e-8, 6.0e-9, 2.8e-8, 2.2e-10),
        "plain kernel": StepCost(5.0e-4, 2.0e-8, 2.5e-8, 1.0e-8, 1.0e-8),
        "lammps-granular": StepCost(8.8e-3, 7.2e-6, 3.1e-7, 6.1e-7, 2.5e-8),
        "lammps-table": StepCost(1.5e-2, 5.5e-6, 8.3e-7, 4.0e-7, 2.8e-8),
        "ase": StepCost(5e-2, 0.0, 1e-6, 2e-5, 5e-7),
    }
)
#: codes without a fixed step
POWERS: Mapping[str, PowerCost] = MappingProxyType(
    {
        "reference": PowerCost(5e-4, 3e-5, 1.63, 0.12),
        "scipy": PowerCost(7e-3, 6.7e-4, 1.19, 0.33, -0.06),
        "ode45": PowerCost(1e-4, 5.2e-7, 1.39, 0.55, -0.14),
        "bca": PowerCost(3e-4),
        "adiabatic": PowerCost(1.3e-3),
    }
)
#: what LAMMPS (2025-07-22) adds in each step for the formula of a drive, s, by its shape
DRIVES: Mapping[str, float] = MappingProxyType({"sine": 6e-6, "table": 11e-6, "chirp": 17e-6})
#: the same for the formulas of displacement and velocity of a piston
PISTONS: Mapping[str, float] = MappingProxyType({"constant": 0.0, "sine": 9e-6, "table": 35e-6})
#: CPU time of a run with its uncertainty over that of the run alone. Fixed steps: twins at twice and at a third of the
#: step (3.5), one in positions (1) and, for the longest, one with tables; adaptive codes: as many further runs
WITH_UNCERTAINTY: Mapping[str, float] = MappingProxyType(
    {"verlet": 6.0, "blanes-moan": 6.0, "reference": 7.0, "scipy": 4.0, "ode45": 3.0}
)


@cache
def evaluations_of(name: str) -> int:
    """Return the evaluations of the forces in a step of a backend: its attribute ``evaluations``, 1 without one.

    >>> evaluations_of("verlet"), evaluations_of("blanes-moan")
    (1, 6)
    """
    return int(getattr(class_of(name), "evaluations", 1))


def predicted_cost(
    name: str,
    scene: Scene,
    *,
    steps: float = math.nan,
    samples: float = math.nan,
    coarse: float = math.nan,
    rtol: float = 1e-6,
) -> float:
    """Return the CPU time of a run without its uncertainty, s.

    Parameters
    ----------
    name : str
        Backend; one that is not in the table is taken for a kernel of this package.
    scene : Scene
        Scene to be solved.
    steps, samples : float
        Steps and dense samples of a run with a fixed step.
    coarse : float
        Steps of the prescan of an undamped scene, for a run without a fixed step.
    rtol : float
        Tolerance of a run without a fixed step.

    Examples
    --------
    >>> import dem_bridge as db
    >>> scene = db.load_scene("decelerating-40")
    >>> f"{predicted_cost('lammps-granular', scene, steps=3e5, samples=3e4):.2f} s"
    '1.10 s'
    """
    if name in POWERS:
        return POWERS[name].of(scene.n_body, coarse, rtol)
    kernel = f"{'fast' if FUSED.covers(scene) else 'plain'} kernel"
    evaluations = steps * (1 if name in STEPS else evaluations_of(name))
    cost = STEPS.get(name, STEPS[kernel]).of(scene.n_body, samples, evaluations)
    if scene.driving_force is not None and name.startswith("lammps"):
        cost += steps * DRIVES[scene.driving_force.shape]
    if scene.piston is not None and name.startswith("lammps"):
        cost += steps * PISTONS[scene.piston.shape]
    return cost
