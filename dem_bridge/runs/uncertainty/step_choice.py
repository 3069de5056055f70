"""The choice of a time step for a wanted accuracy: the largest step whose velocity uncertainty is within it."""

from __future__ import annotations

import math
from dataclasses import replace

from dem_bridge.backends.base import Resolution, Sampling, backend, unsupported_reason
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.backends.steps import default_step, order_on, round_step
from dem_bridge.backends.surrogate_radius import radius_of
from dem_bridge.backends.twin import TWIN
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.observables.convergence import checked_accuracy
from dem_bridge.runs.cache import RunCache
from dem_bridge.runs.case import Case
from dem_bridge.runs.uncertainty.estimate import solve
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.relative import relative_size
from dem_bridge.trajectory.trajectory import Trajectory

#: no step is chosen with which a run has more steps than this
MOST_STEPS = 50_000_000


def step_for_accuracy(
    scene: Scene,
    accuracy: float,
    resolution: Resolution,
    sampling: Sampling,
    *,
    by: str = TWIN.name,
    cache: RunCache | None = None,
) -> Resolution:
    """Return ``resolution`` with the largest step of the 1-2-5 series that has the accuracy.

    Parameters
    ----------
    scene : Scene
    accuracy : float
        Largest uncertainty of velocities, relative to the largest velocity.
    resolution : Resolution
        All other settings.
    sampling : Sampling
    by : str
        The backend with a fixed step; the twin's choice holds for LAMMPS and ASE, too.
    cache : RunCache, optional
        Where the runs at the chosen step are kept.

    Raises
    ------
    UsageError
        If no step has the accuracy, or only one with more than 5e7 steps.
    UnsupportedScene
        If the backend does not do the scene.
    """
    code = backend(by)
    assert code.order is not None  # it has a fixed step
    order = order_on(scene) if by == TWIN.name else code.order
    reason = unsupported_reason(code, scene)
    if reason:
        raise UnsupportedScene(f"accuracy = {accuracy!r} on {scene.name}: {reason}")
    accuracy = checked_accuracy(accuracy)
    prescan = prescan_scene(scene)
    radius, least = radius_of(scene, resolution, prescan), math.inf
    # a method of higher order may have longer steps
    dt = 100.0 * max(1.0, 0.5 * order) * default_step(scene, sampling, prescan)
    while scene.duration / dt <= MOST_STEPS:
        trial = RunCache()
        chosen = replace(resolution, dt=dt)
        run = solve(Case(scene=scene, backend=by, resolution=chosen, sampling=sampling), trial)
        scale = float(abs(run.velocity).max())
        # where nothing moves, no step is better than another
        uncertainty = relative_size(run.uncertainty.velocity, scale) if scale > 0.0 else 0.0
        if uncertainty <= accuracy:
            if cache is not None:
                cache.adopt(trial)
            return chosen
        least = min(least, uncertainty)
        parts = run.uncertainty.parts
        if max(accuracy, parts["time_step"]) < parts["round_off"] + parts["table"]:
            # round-off grows with the number of steps, and the error of tables is the same at any
            raise UsageError(
                f"accuracy = {accuracy:g} on {scene.name} cannot be reached: "
                + _limit_of_any_step(scene, run, radius, resolution)
                + f"; the smallest uncertainty is {least:.2g}; ask for less"
            )
        # the uncertainty scales as dt^order; a step to a tenth at most, so that limits of any step show on the way
        dt = round_step(dt * min(0.7, max(0.1, (accuracy / uncertainty) ** (1.0 / order))))
    raise UsageError(
        f"accuracy = {accuracy:g} on {scene.name} needs a step below {dt:.2g} s, more than {MOST_STEPS:.0e} steps;"
        " ask for less, or take backend='scipy'"
    )


def _limit_of_any_step(scene: Scene, run: Trajectory, radius: float, resolution: Resolution) -> str:
    """Return the larger of round-off and tables, with a remedy."""
    parts, dt = run.uncertainty.parts, run.provenance["settings"]["dt"]
    if parts["table"] > parts["round_off"]:
        if scene.contacts.clip and run.contact_force.min(initial=0.0) < 0.0:
            return (
                f"contacts with damping beside a table become tensile, which changes velocities by {parts['table']:.2g}"
                " of the largest (take n = 2 or 2.5 in damped contacts, or backend='scipy')"
            )
        return (
            f"the interpolation error of the tables is {parts['table']:.2g} of the largest velocity (take more"
            " table_points, or lammps-granular)"
        )
    remedy = " (take geometry='surrogate')" if resolution.geometry == "physical" else ""
    floor = run.uncertainty.roundoff_floor
    return f"round-off with a radius of {radius:.3g} m is {floor:.2g} of the largest velocity at dt = {dt:g} s{remedy}"
