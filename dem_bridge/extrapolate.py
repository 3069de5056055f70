"""More accuracy from the same code: Richardson extrapolation of whole runs, where their order is clean."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.accuracy import Extrapolation, richardson
from dem_bridge.backends.base import Backend, Resolution, Sampling
from dem_bridge.errors import NotAsymptotic, UsageError
from dem_bridge.scene import Scene
from dem_bridge.trajectory import QUANTITIES, UNKNOWN, Cost, Trajectory


def extrapolated(
    chosen: Backend, scene: Scene, resolution: Resolution, sampling: Sampling, *, uncertainty: bool = False
) -> Trajectory:
    """The run of a fixed-step backend, extrapolated from steps of 2 dt, dt and dt/2 to 0.

    Velocities and displacements must show the backend's order, else NotAsymptotic says why not. Peak forces and
    crossing times are extrapolated where they show it, and are those of dt/2 with its bars where they do not. The bars
    of what is extrapolated: the distance to the extrapolation from the two coarser runs (Richardson 1911, *Phil. Trans.
    R. Soc. A* 210, 307), and the round-off of the finest. UsageError for a backend without a fixed step.
    """
    if chosen.order is None:
        raise UsageError(f"order = 'richardson' with {chosen.name}, which has no fixed step; give rtol, or nothing")
    # forces that depend on velocities are those of the half step
    order = 1 if scene.dissipates else chosen.order
    main = chosen.run(scene, resolution, sampling)
    step = float(main.provenance["settings"]["dt"])
    coarse = chosen.run(scene, replace(resolution, dt=2.0 * step), sampling)
    # its bars know the round-off, also where none are wanted of the answer
    fine = chosen.run(scene, replace(resolution, dt=0.5 * step, bars=True), sampling)
    runs = (coarse, main, fine)
    steps = [float(run.provenance["settings"]["dt"]) for run in runs]
    rounding = fine.uncertainty.parts["round_off"]

    def of(quantity: str) -> Extrapolation:
        rows = [getattr(run, quantity).ravel().tolist() for run in runs]
        floor = rounding * float(np.nanmax(np.abs(rows[-1]), initial=0.0))
        result = richardson(steps, rows, order=order, floor=floor)
        # weights of 4/3 and -1/3 magnify what was rounded
        return replace(result, uncertainty=result.uncertainty + 5.0 / 3.0 * floor)

    values: dict[str, NDArray[np.float64]] = {}
    bars: dict[str, Any] = dict(fine.uncertainty)
    kept: list[str] = []
    for quantity in QUANTITIES:
        try:
            result = of(quantity)
        except NotAsymptotic:
            if quantity in ("velocity", "displacement"):
                raise
            kept.append(quantity)
            continue
        values[quantity] = np.array(result.value).reshape(getattr(fine, quantity).shape)
        bars[quantity] = result.uncertainty
    weight = 1.0 / ((steps[1] / steps[2]) ** order - 1.0)
    force = fine.contact_force + weight * (fine.contact_force - main.contact_force)
    settings = {**fine.provenance["settings"], "order": "richardson", "dt": steps[1]}
    return replace(
        fine,
        **values,
        contact_force=np.maximum(force, 0.0),
        uncertainty=replace(fine.uncertainty, **bars) if uncertainty else UNKNOWN,
        cost=Cost(
            wall=sum(run.cost.wall for run in runs),
            cpu=sum(run.cost.cpu for run in runs),
            steps=sum(run.cost.steps for run in runs),
            force_evaluations=sum(run.cost.force_evaluations for run in runs),
        ),
        provenance={**fine.provenance, "settings": settings, "extrapolated_from": steps, "not_extrapolated": kept},
    )
