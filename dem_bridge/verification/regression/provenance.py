"""Provenance of baselines, and the differences between two correct builds that round-off alone explains.

The tolerances are measured, not tuned. LAMMPS stores positions and rounds them at every step: the difference between
the twin that stores positions and the twin that stores overlaps is its round-off. An in-house backend runs again with
every mass and stiffness perturbed by one unit in the last place.
"""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np

from dem_bridge.backends.base import ENGINE_BACKENDS, backend
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.backends.steps import fixed_step_plan
from dem_bridge.backends.twin import solve_plan
from dem_bridge.runs.case import Case
from dem_bridge.runs.digits import planned_fingerprint
from dem_bridge.runs.uncertainty.fixed_step import REALISATIONS, last_digit
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.relative import own_scale, relative_size
from dem_bridge.trajectory.trajectory import Trajectory
from dem_bridge.verification.regression.baseline import QUANTITIES, Baseline, RoundoffTolerance
from dem_bridge.verification.regression.compare import assess
from dem_bridge.version import __version__

#: number of builds that are compared; each may differ from exact arithmetic
_BUILDS_COMPARED = 2.0


def baseline_of(
    case: Case, run: Trajectory, reference: Trajectory | None, *, tolerance: float, source: str
) -> Baseline:
    """Return the baseline of a run, with its errors and the differences that round-off alone explains."""
    origin = run.provenance
    lammps = origin.get("lammps")
    provenance = {
        "date": datetime.now(UTC).date().isoformat(),
        "package": __version__,
        "scene_hash": origin["scene_hash"],
        "source": source,
        "deck_hash": origin.get("deck_hash"),
        "lammps": None if lammps is None else {key: lammps[key] for key in ("version", "packages", "build", "run_by")},
        "versions": dict(origin["versions"]),
        "machine": origin["machine"],
        "digits": planned_fingerprint(),
        "solved_with": dict(origin["settings"]),
    }
    return Baseline(
        scene=case.scene.name,
        backend=origin["backend"],
        provenance=provenance,
        dt=case.resolution.dt,
        tolerance=tolerance,
        same_within=_roundoff_tolerance(case, run),
        accuracy=assess(run, reference, tolerance),
        run=run,
    )


def _roundoff_tolerance(case: Case, run: Trajectory) -> dict[str, RoundoffTolerance]:
    """Return for each quantity the difference that round-off alone explains, with the reason.

    The tolerance is six times the effect of perturbed last digits: a factor of three, because one realisation of the
    round-off represents all, and a factor of two, because both builds differ from exact arithmetic.
    """
    digit = float(np.finfo(float).eps) * math.sqrt(max(run.cost.steps, 1))
    scene = case.scene
    if case.backend in ENGINE_BACKENDS:
        plan = fixed_step_plan(scene, case.resolution, case.sampling, prescan_scene(scene))
        radius = float(run.provenance["settings"]["surrogate_radius"])
        unperturbed, perturbed = solve_plan(scene, plan), solve_plan(scene, plan, radius)
        digit = last_digit(plan)
        cause = (
            f"the difference between a twin that stores positions at a radius of {radius:.3g} m and a twin that stores"
            " overlaps"
        )
    else:
        perturbed = backend(case.backend).run(_perturbed(scene), case.resolution, case.sampling)
        unperturbed = run
        cause = "the effect of a perturbation of every mass and stiffness by its last digit"
    tolerances = {}
    for quantity in QUANTITIES:
        a, b = getattr(unperturbed, quantity), getattr(perturbed, quantity)
        scale = np.max(np.abs(a), initial=0.0) if quantity == "velocity" else own_scale(a)
        distance = np.nan_to_num(np.abs(a - b))  # nan: a crossing in one run only is not round-off
        # what has no scale would permit any value of the others
        relative = relative_size(distance, scale)[np.broadcast_to(scale > 0.0, a.shape)]
        value = _BUILDS_COMPARED * REALISATIONS * (float(np.max(relative, initial=0.0)) + digit)
        reason = f"6 times ({cause}, plus a random walk of the last digit)"
        tolerances[quantity] = RoundoffTolerance(value=float(f"{value:.2g}"), reason=reason)
    return tolerances


def _perturbed(scene: Scene) -> Scene:
    """Return the scene with every mass and stiffness perturbed by its last digit, up or down at random.

    A perturbation of all values in one direction would only change the unit of time.
    """
    rng = np.random.default_rng(0)

    def perturb(values: tuple[float, ...]) -> tuple[float, ...]:
        direction = np.where(rng.random(len(values)) < 0.5, 0.0, math.inf)
        return tuple(np.nextafter(np.array(values), direction).tolist())

    return replace(scene, mass=perturb(scene.mass), stiffness=perturb(scene.stiffness))
