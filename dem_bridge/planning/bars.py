"""Settings for a wanted accuracy: the largest time step whose error bar is within it."""

from __future__ import annotations

import math
from dataclasses import replace

from dem_bridge.accuracy import checked_accuracy
from dem_bridge.backends.base import Backend, Resolution, Sampling, unsupported_reason
from dem_bridge.backends.steps import default_step, order_on, radius_of, round_step
from dem_bridge.backends.tabled import prescan_scene
from dem_bridge.backends.verlet import Verlet
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.scene import Scene
from dem_bridge.trajectory import Trajectory

#: fixed-step runs longer than this are not chosen by accuracy
MOST_STEPS = 50_000_000


def resolution_for(
    scene: Scene, accuracy: float, resolution: Resolution, sampling: Sampling, backend: Backend | None = None
) -> Resolution:
    """``resolution`` with the largest step of the 1-2-5 series whose velocity bar is within ``accuracy``.

    Bars are those of ``own``, a fixed-step backend, or of the twin, which are those of LAMMPS, too. Raises
    UsageError where that would take more than 5e7 steps, UnsupportedScene where that code cannot do the scene.
    """
    code = backend or Verlet()
    assert code.order is not None  # it has a fixed step
    order = order_on(scene) if code.order == Verlet.order else code.order
    reason = unsupported_reason(code, scene)
    if reason:
        raise UnsupportedScene(f"accuracy = {accuracy!r} on {scene.name}: {reason}")
    accuracy = checked_accuracy(accuracy)
    prescan = prescan_scene(scene)
    radius, least = radius_of(scene, resolution, prescan), math.inf
    # a method of higher order may have longer steps
    dt = 100.0 * max(1.0, 0.5 * order) * default_step(scene, sampling, prescan)
    while scene.duration / dt <= MOST_STEPS:
        run = code.run(scene, replace(resolution, dt=dt, bars=True), sampling)
        scale = float(abs(run.velocity).max())
        bar = run.uncertainty["velocity"] / scale if scale > 0.0 else 0.0
        if bar <= accuracy:
            return replace(resolution, dt=dt)
        least = min(least, bar)
        parts = run.uncertainty.parts
        if max(accuracy, parts["time_step"]) < parts["round_off"] + parts["table"]:
            # round-off grows with the number of steps, and tables err whatever it is: no smaller step helps
            raise UsageError(
                f"accuracy = {accuracy:g} on {scene.name} cannot be had: "
                + _what_no_step_changes(run, radius, resolution)
                + f"; the least bar found is {least:.2g}, so ask for less"
            )
        # the bar goes as dt^order; no step further than to a tenth, for what no step can reach shows on the way
        dt = round_step(dt * min(0.7, max(0.1, (accuracy / bar) ** (1.0 / order))))
    raise UsageError(
        f"accuracy = {accuracy:g} on {scene.name} needs a step below {dt:.2g} s, more than {MOST_STEPS:.0e} steps;"
        " ask for less, or take backend='scipy'"
    )


def _what_no_step_changes(run: Trajectory, radius: float, resolution: Resolution) -> str:
    """The larger of round-off and tables, with what would make it smaller."""
    parts, dt = run.uncertainty.parts, run.provenance["settings"]["dt"]
    if parts["table"] > parts["round_off"]:
        if run.contact_force.min(initial=0.0) < 0.0:
            return (
                f"contacts whose damping stands beside a table pull, which is {parts['table']:.2g} of the velocities"
                " (take n = 2 or 2.5 in damped contacts, or backend='scipy')"
            )
        return f"tables miss {parts['table']:.2g} of the velocities (take more table_points, or lammps-granular)"
    remedy = " (take geometry='surrogate')" if resolution.geometry == "physical" else ""
    floor = run.uncertainty.roundoff_floor
    return f"bodies of {radius:.3g} m round off {floor:.2g} of the velocities at dt = {dt:g} s{remedy}"
