# dem_bridge/studies/halving.py
"""The error of half a time step."""

from __future__ import annotations

from dataclasses import replace

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.observables.differences import difference
from dem_bridge.report.study import Study, Table
from dem_bridge.runs.campaign import Progress, run_cases
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from dem_bridge.scene.scene import Scene


def study_halving(
    scene: Scene,
    *,
    dt: float = 1e-6,
    jobs: int | None = None,
    progress: Progress | None = None,
    store: Store | None = None,
) -> Study:
    """Measure by how much the velocity error falls when the time step is halved.

    Parameters
    ----------
    scene : Scene
        Scene to be solved.
    dt : float
        Larger of the two time steps, s.
    jobs, progress, store : as in :func:`dem_bridge.study`

    Returns
    -------
    Study
    """
    main = Case(scene=scene, backend="reference", resolution=Resolution(), sampling=Sampling(count=scene.samples))
    twins = [
        replace(main, backend="verlet", resolution=Resolution(dt=step), uncertainty=False) for step in (dt, 0.5 * dt)
    ]
    reference, *others = (
        result.trajectory for result in run_cases([main, *twins], jobs=jobs, progress=progress, store=store)
    )
    assert reference is not None
    errors = [difference("velocity", run, reference).value for run in others if run is not None]
    return Study(
        id="halving",
        title="Error of half a time step",
        answer=(
            f"With half of {dt:g} s the velocity error on {scene.name} is {errors[0] / errors[1]:.1f} times smaller.",
        ),
        tables=(
            Table(
                id="halving",
                title="Errors",
                caption="Largest over all samples and bodies, relative to the largest velocity.",
                columns=("dt (s)", "velocity error"),
                rows=((dt, errors[0]), (0.5 * dt, errors[1])),
            ),
        ),
    )
