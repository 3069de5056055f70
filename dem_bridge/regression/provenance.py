"""From a run to a baseline: its birth certificate, and how far two honest builds may differ from each other.

Nothing here is tuned: what is allowed is what moving last digits does to this scene, measured with codes of the house.
A code that keeps positions (LAMMPS) rounds them at every step, and the twin in positions shows what comes of it; an
in-house code is run again with every mass and stiffness moved by its last digit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from dem_bridge.backends.base import ENGINE_BACKENDS, Resolution, Sampling, backend
from dem_bridge.backends.steps import fixed_step_plan
from dem_bridge.backends.tabled import prescan_scene
from dem_bridge.backends.twin import solve_plan
from dem_bridge.backends.twin_bars import REALISATIONS, last_digit
from dem_bridge.regression.baseline import QUANTITIES, Accuracy, Baseline, Within
from dem_bridge.scene import Scene
from dem_bridge.trajectory import Trajectory, own_scale
from dem_bridge.version import __version__

#: each of two builds may be so far from exact arithmetic
_TWO = 2.0


def baseline_of(
    scene: Scene,
    run: Trajectory,
    *,
    dt: float | None,
    tolerance: float,
    same_within: Mapping[str, Within],
    accuracy: Mapping[str, Accuracy] | None = None,
    source: str = "",
) -> Baseline:
    """The baseline that a run is from now on. ``dt`` (s): the step that was asked for."""
    told = run.provenance
    lammps = told.get("lammps")
    birth = {
        "date": datetime.now(UTC).date().isoformat(),
        "package": __version__,
        "scene_hash": told["scene_hash"],
        "source": source,
        "deck_hash": told.get("deck_hash"),
        "lammps": None if lammps is None else {key: lammps[key] for key in ("version", "packages", "build", "run_by")},
        "versions": dict(told["versions"]),
        "machine": told["machine"],
        "solved_with": dict(told["settings"]),
    }
    return Baseline(
        scene=scene.name,
        backend=told["backend"],
        birth=birth,
        dt=dt,
        tolerance=tolerance,
        same_within=same_within,
        accuracy=accuracy or {},
        time=run.time,
        velocity=run.velocity,
        peak_force=run.peak_force,
        crossing_time=run.crossing_time,
        bars={name: run.uncertainty[name] for name in QUANTITIES},
    )


def roundoff_tolerance(
    scene: Scene, name: str, resolution: Resolution, sampling: Sampling, run: Trajectory
) -> dict[str, Within]:
    """``same_within`` of a run, for each quantity, with the reason.

    Six times what moved last digits do: three, because one realisation stands for others, and twice, because either
    of two builds may be so far from exact arithmetic.
    """
    digit = float(np.finfo(float).eps) * math.sqrt(max(run.cost.steps, 1))
    if name in ENGINE_BACKENDS:
        plan = fixed_step_plan(scene, resolution, sampling, prescan_scene(scene))
        radius = float(run.provenance["settings"]["surrogate_radius"])
        one: Any
        other: Any
        one, other = solve_plan(scene, plan), solve_plan(scene, plan, radius)
        digit = last_digit(plan)
        why = f"round-off of positions at a radius of {radius:.3g} m, by the twin in positions beside that in overlaps"
    else:
        code = backend(name)
        one, other = run, code.run(_moved(scene), replace(resolution, bars=False), sampling)
        why = "every mass and stiffness moved up or down by its last digit"
    found = {}
    for quantity in QUANTITIES:
        a, b = getattr(one, quantity), getattr(other, quantity)
        scale = np.max(np.abs(a), initial=0.0) if quantity == "velocity" else own_scale(a)
        distance = np.nan_to_num(np.abs(a - b))  # a crossing that only one has is no round-off
        relative = np.divide(distance, scale, out=np.zeros_like(distance), where=np.broadcast_to(scale > 0.0, a.shape))
        value = _TWO * REALISATIONS * (float(np.max(relative, initial=0.0)) + digit)
        found[quantity] = Within(value=float(f"{value:.2g}"), reason=f"6 times ({why}, and a last digit's random walk)")
    return found


def _moved(scene: Scene) -> Scene:
    """Every mass and stiffness moved by its last digit, up or down as a seed says: all one way would only be another
    unit of time."""
    rng = np.random.default_rng(0)

    def moved(values: tuple[float, ...]) -> tuple[float, ...]:
        to = np.where(rng.random(len(values)) < 0.5, 0.0, math.inf)
        return tuple(np.nextafter(np.array(values), to).tolist())

    return replace(scene, mass=moved(scene.mass), stiffness=moved(scene.stiffness))
