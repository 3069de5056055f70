"""More accuracy from the same code: Richardson extrapolation of whole runs, where their order is clean."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from dem_bridge.backends.base import Backend, backend
from dem_bridge.backends.steps import order_on
from dem_bridge.errors import NotAsymptotic, UsageError
from dem_bridge.observables.convergence import Extrapolation, richardson
from dem_bridge.runs.case import Case
from dem_bridge.runs.uncertainty.estimate import solve
from dem_bridge.runs.uncertainty.from_replicas import summed_cost
from dem_bridge.trajectory.trajectory import QUANTITIES, SAMPLED, UNKNOWN, Floats, Trajectory


def extrapolate(case: Case, code: Backend | None = None) -> Trajectory:
    """Return the run of a case extrapolated from steps of 2 dt, dt and dt/2 to 0.

    Velocities and displacements must show the order of the backend. Peak forces and crossing times are extrapolated
    where they show it, and are those of dt/2 with their uncertainty where they do not. The uncertainty of an
    extrapolated value is its distance to the extrapolation from the two coarser runs (Richardson 1911, *Phil. Trans. R.
    Soc. A* 210, 307) and the round-off of the finest.

    Parameters
    ----------
    case : Case
        The run at the middle step.
    code : Backend, optional
        A backend in place of the one that the case names.

    Raises
    ------
    UsageError
        For a backend without a fixed step.
    NotAsymptotic
        If the runs do not show the order.
    """
    code = code or backend(case.backend, case.engine)
    if code.order is None:
        raise UsageError(f"order = 'richardson' with {code.name}, which has no fixed step; give rtol, or nothing")
    order = order_on(case.scene) if code.order == 2 else code.order
    main = case.solve(code)
    step = float(main.provenance["settings"]["dt"])
    coarse = replace(case, resolution=replace(case.resolution, dt=2.0 * step)).solve(code)
    # the uncertainty of the finest run has the round-off, which the extrapolation needs in any case
    fine = solve(replace(case, resolution=replace(case.resolution, dt=0.5 * step), uncertainty=True), code=code)
    runs = (coarse, main, fine)
    steps = [float(run.provenance["settings"]["dt"]) for run in runs]
    roundoff = fine.uncertainty.parts["round_off"]

    def extrapolation_of(quantity: str) -> Extrapolation:
        rows = [getattr(run, quantity).ravel().tolist() for run in runs]
        floor = roundoff * float(np.nanmax(np.abs(rows[-1]), initial=0.0))
        result = richardson(steps, rows, order=order, floor=floor)
        # weights of 4/3 and -1/3 magnify round-off
        return replace(result, uncertainty=result.uncertainty + 5.0 / 3.0 * floor)

    values: dict[str, Floats] = {}
    uncertainty: dict[str, Any] = dict(fine.uncertainty)
    kept: list[str] = []
    for quantity in QUANTITIES:
        try:
            result = extrapolation_of(quantity)
        except NotAsymptotic:
            if quantity in SAMPLED:
                raise
            kept.append(quantity)
            continue
        values[quantity] = np.array(result.value).reshape(getattr(fine, quantity).shape)
        uncertainty[quantity] = result.uncertainty
    weight = 1.0 / ((steps[1] / steps[2]) ** order - 1.0)
    force = fine.contact_force + weight * (fine.contact_force - main.contact_force)
    settings = {**fine.provenance["settings"], "order": "richardson", "dt": steps[1]}
    return replace(
        fine,
        **values,
        contact_force=np.maximum(force, 0.0) if case.scene.contacts.clip else force,
        uncertainty=replace(fine.uncertainty, **uncertainty) if case.uncertainty else UNKNOWN,
        cost=summed_cost(runs),
        provenance={**fine.provenance, "settings": settings, "extrapolated_from": steps, "not_extrapolated": kept},
    )
