"""The command ``dem-bridge run``: solve a scene with one backend, and print a summary with uncertainties."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import dem_bridge
from dem_bridge.cli import options, terminal, waiting
from dem_bridge.cli.parameters import POSITIVE, Option, check_output, make_command, print_json
from dem_bridge.errors import UsageError
from dem_bridge.foundation.wording import share

if TYPE_CHECKING:
    from dem_bridge.scene.scene import Scene
    from dem_bridge.trajectory.trajectory import Trajectory

#: error of velocities, relative to the largest, of which a run warns
_LARGEST_ERROR_WITHOUT_WARNING = 0.01
#: columns of the names of a summary
_COLUMNS_OF_NAMES = 28
#: name of a line -> key of the value, key of its uncertainty, unit, SI value of the unit
_UNCERTAIN = {
    "largest velocity": ("largest_velocity_m_per_s", "velocity_uncertainty_m_per_s", "m/s", 1.0),
    "largest contact force": ("largest_force_N", "peak_force_uncertainty_N", "N", 1.0),
    "last arrival": ("last_crossing_time_s", "crossing_time_uncertainty_s", "us", 1e-6),
}
#: name of a line -> key and format of the value; a value that is unknown has no line
_PLAIN = {
    "restitution": ("restitution", "{:.9g}"),
    "round-off floor (relative)": ("roundoff_floor_relative", "{:.2g}"),
    "predicted table error (rel.)": ("table_predicted_error_relative", "{:.2g}"),
    "measured table error (rel.)": ("table_measured_error_relative", "{:.2g}"),
    "time steps": ("steps", "{}"),
    "force evaluations": ("force_evaluations", "{}"),
    "wall time": ("wall_s", "{:.3g} s"),
    "CPU time": ("cpu_s", "{:.3g} s"),
}


@make_command(
    "run",
    options.SCENE,
    replace(
        options.BACKEND,
        help="Backend that solves the scene.",
        default="with --accuracy the cheapest, else required",
    ),
    options.DT,
    options.ACCURACY,
    Option("rtol", "Relative tolerance of the integrators scipy and ode45.", float, metavar="R", limits=POSITIVE),
    Option("atol", "Absolute tolerance of the integrator ode45, m and m/s.", float, metavar="A", limits=POSITIVE),
    options.SAMPLES,
    options.GEOMETRY,
    options.TYPES,
    *options.LAMMPS,
    replace(options.OUTPUT, help="File for the trajectory: .nc, .extxyz, .lammpstrj or .csv."),
    options.FORCE,
    options.AS_JSON,
)
def run(
    scene: str, as_json: bool, force: bool, backend: str | None = None, output: Path | None = None, **settings: Any
) -> None:
    """Solve SCENE with one backend.

    The output is a summary of the run with uncertainties.
    """
    if backend is None and "accuracy" not in settings:
        raise click.UsageError("Missing option '--backend', or '--accuracy', for which the cheapest backend is chosen.")
    with waiting.fraction(f"{scene} by {backend or 'the cheapest backend'}"):
        if output is not None:
            from dem_bridge.formats.writers import format_of

            check_output(scene, output, force)
            format_of(output)
        from dem_bridge.api.runs import refuse_settings

        known = dem_bridge.load_scene(scene)
        refuse_settings(known, backend, settings)
        waiting.announce_compiling()
        result = dem_bridge.solve(known, backend=backend, **settings)
    warn_of_engine(result)
    _warn_of_error(scene, result)
    if output is not None:
        dem_bridge.write_trajectory(result, scene, output)
    summary = _summary(result)
    if as_json:
        print_json(summary)
        return
    if backend is None:
        terminal.print_entry(
            "cheapest backend", f"{summary['backend']} (for the reasons: dem-bridge plan)", _COLUMNS_OF_NAMES
        )
    lines = (*_summary_lines(summary), *_front_line(known, result), *_step_lines(known, result, summary))
    for name, text in lines:
        terminal.print_entry(name, text, _COLUMNS_OF_NAMES)
    if output is not None:
        terminal.print_entry("written", str(output), _COLUMNS_OF_NAMES)


def _warn_of_error(scene: str, run: Trajectory) -> None:
    """Print on stderr that the velocities of a run may be wrong by more than 1 % of the largest, and what to do."""
    largest = float(abs(run.velocity).max(initial=0.0))
    error = float(run.uncertainty["velocity"])
    if _LARGEST_ERROR_WITHOUT_WARNING * largest < error < float("inf"):
        size = f"{'at most ' if error <= largest else ''}{share(error / largest)}"
        click.echo(
            f"dem-bridge: warning: {run.provenance['scene']}: velocities may be wrong by {size} of the largest; for"
            f" better settings: dem-bridge plan {scene} --accuracy 1e-3 --backend {run.provenance['backend']}",
            err=True,
        )


def _front_line(scene: Scene, run: Trajectory) -> Iterator[tuple[str, str]]:
    """Yield the mean speed of the front along the chain with its first and last value, if the bodies have a spacing."""
    import numpy as np

    from dem_bridge.observables.registry import observable_named

    if scene.spacing is None:
        return
    speed = observable_named("wave_speed").read(scene, run).values
    arrival = observable_named("arrival").read(scene, run)
    bodies = np.flatnonzero(np.isfinite(speed))
    if not len(bodies) or len(bodies) <= bodies[-1] - bodies[0] or not (speed[bodies] > 0.0).all():
        return  # the front passes no body, or not one after the other
    first, last = int(bodies[0]), int(bodies[-1])
    duration = float(arrival.values[last + 1] - arrival.values[first])
    relative = float(arrival.uncertainty[last + 1] + arrival.uncertainty[first]) / duration
    mean = scene.spacing * len(bodies) / duration
    bound = f"+- {mean * relative / (1.0 - relative):.1g} m/s" if relative < 1.0 else "uncertainty unknown"
    ends = f"{speed[first]:.4g} m/s at body {first}, {speed[last]:.4g} m/s at body {last}"
    yield "front speed", f"{mean:.7g} m/s {bound} (mean over bodies {first} to {last}; {ends})"


def _step_lines(scene: Scene, run: Trajectory, summary: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield whether what a run did is plausible: overlaps and the step as shares of their scales, or no contact."""
    from dem_bridge.scene.timescales import contact_time_of

    if summary["largest_force_N"] == 0.0:
        yield "contacts", "no contact closes"
        return
    if (steps := summary["steps"]) and summary["settings"].get("dt") and (shortest := contact_time_of(scene)):
        dt = scene.duration / steps
        yield "time step", f"{dt:.6g} s: {dt / shortest:.2g} of the contact time, {1e6 * shortest:.4g} us"
    if scene.geometry is not None and scene.law is None and not scene.dissipates:
        c, radius = scene.contacts, min(body.radius for body in scene.geometry.bodies)
        overlap = float(((run.peak_force / c.stiffness) ** (1.0 / (c.exponent - 1.0))).max())
        yield "largest overlap", f"{overlap:.3g} m, {overlap / radius:.2g} of the smallest radius"


def _summary(run: Trajectory) -> dict[str, Any]:
    """Return a summary of a trajectory with uncertainties as JSON types; unknown values are None."""
    import numpy as np

    def known(value: float) -> float | None:
        return float(value) if np.isfinite(value) else None

    uncertainty = {name: known(np.nanmax(bound, initial=0.0)) for name, bound in run.uncertainty.items()}
    crossed = run.crossing_time[np.isfinite(run.crossing_time)]
    table = run.provenance.get("table", {})
    errors = ("predicted_error", "measured_error")
    return {
        **{key: run.provenance[key] for key in ("scene", "backend", "settings")},
        "samples": len(run.time) - 1,
        "largest_velocity_m_per_s": float(np.max(np.abs(run.velocity))),
        "velocity_uncertainty_m_per_s": uncertainty["velocity"],
        "largest_force_N": float(np.max(run.peak_force, initial=0.0)),
        "peak_force_uncertainty_N": uncertainty["peak_force"],
        "last_crossing_time_s": float(crossed[-1]) if len(crossed) else None,
        "crossing_time_uncertainty_s": uncertainty["crossing_time"],
        **({"restitution": known(_restitution(run))} if "impact" in run.provenance else {}),
        "roundoff_floor_relative": known(run.uncertainty.roundoff_floor),
        **{f"table_{name}_relative": table[name] for name in errors if table},
        "steps": run.cost.steps,
        "force_evaluations": run.cost.force_evaluations,
        "wall_s": round(run.cost.wall, 4),
        "cpu_s": round(run.cost.cpu, 4),
        "versions": run.provenance["versions"],
    }


def _restitution(run: Trajectory) -> float:
    """Return the restitution of an impact, nan where its samples do not show it."""
    try:
        return run.restitution
    except UsageError:
        return float("nan")


def _summary_lines(summary: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the lines of a summary as pairs of name and text; unknown values are left out."""
    yield from ((key, str(summary[key])) for key in ("scene", "backend", "samples"))
    for name, (key, bound, unit, size) in _UNCERTAIN.items():
        value, error = summary[key], summary[bound]
        uncertainty = "uncertainty unknown" if error is None else f"+- {error / size:.1g} {unit}"
        yield name, "none" if value is None else f"{value / size:.7g} {unit} {uncertainty}"
    for name, (key, form) in _PLAIN.items():
        if summary.get(key) is not None:
            yield name, form.format(summary[key])


def warn_of_engine(run: Trajectory) -> None:
    """Print the note of a LAMMPS run, if it has one, on stderr."""
    if note := run.provenance.get("lammps", {}).get("note"):
        click.echo(f"dem-bridge: warning: {run.provenance['scene']}: {note}", err=True)
