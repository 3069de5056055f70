"""Figures of runs for notebooks and papers, in the style of the report's figures.

Each function draws on the matplotlib Axes ``ax``, or on the axes of a new figure if ``ax`` is None, and returns the
Axes. The functions show and save nothing and need no display. Runs are one Trajectory, a sequence of them, or a mapping
from labels to them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from dem_bridge.api.runs import solve
from dem_bridge.errors import UsageError
from dem_bridge.report.drawing import Axes, draw_panel, new_axes
from dem_bridge.report.study import Panel, Series
from dem_bridge.scene.file import load_scene, scene_of, shipped_scenes
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import QUANTITIES, Trajectory
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.figures import budget_on
from dem_bridge.verification.panels import LABELS, residence_panel, spacetime_panel
from dem_bridge.verification.verification import Verification

#: one run, several runs, or runs by label
Runs = Trajectory | Sequence[Trajectory] | Mapping[str, Trajectory]
#: backends that are theories of the front
THEORIES = ("bca", "adiabatic")
#: default numbers of bodies whose velocity is drawn, for one run and for several runs
_BODIES, _BODIES_OF_SEVERAL = 5, 3


def spacetime(
    t: Runs,
    ax: Axes | None = None,
    *,
    until: float | None = None,
    theory: str | None = None,
    scene: Scene | str | Path | None = None,
) -> Axes:
    """Plot the velocity of every body (colour, m/s) against time (ms).

    Parameters
    ----------
    t : Trajectory
        One run.
    ax : Axes, optional
        Axes to draw on; the default is a new figure.
    until : float, optional
        Last time, s; the default is shortly after the front has reached the last body.
    theory : {"bca", "adiabatic"}, optional
        Theory whose arrival times are drawn as a line.
    scene : Scene, str or Path, optional
        Scene of the run; needed for a theory unless the run is of a shipped scene.

    Returns
    -------
    Axes

    Raises
    ------
    UsageError
        If there is more than one run, or the theory or the scene does not fit.

    Examples
    --------
    >>> import dem_bridge as db
    >>> ax = db.plot.spacetime(db.solve("accelerating-40", backend="verlet", dt=1e-6, uncertainty=False), theory="bca")
    >>> ax.get_xlabel(), ax.get_ylabel(), [line.get_label() for line in ax.get_lines()]
    ('body', 'time (ms)', ['front by BCA'])
    """
    if len(runs := _by_label(t)) != 1:
        raise UsageError(f"t has {len(runs)} runs; allowed: one run per space-time plot")
    [(label, run)] = runs.items()
    fronts = {} if theory is None else {theory: _by_theory(theory, scene, run)}
    panel = spacetime_panel(run, f"{_scene_name(run)} ({label})", until=until, fronts=fronts)
    return draw_panel(new_axes() if ax is None else ax, panel)


def velocity(
    t: Runs, bodies: Sequence[int] | int | None = None, ax: Axes | None = None, *, until: float | None = None
) -> Axes:
    """Plot the velocities of some bodies (m/s) against time (ms).

    The colour shows the body and the line style the run. The first of several runs is a broad pale line, on which the
    lines of the others lie if the runs agree.

    Parameters
    ----------
    t : Trajectory, sequence or mapping
        One or more runs.
    bodies : int or sequence of int, optional
        Indices of bodies; the default is five bodies along the chain, or three for several runs.
    ax : Axes, optional
        Axes to draw on; the default is a new figure.
    until : float, optional
        Last time, s; the default is the end of the runs.

    Returns
    -------
    Axes

    Raises
    ------
    UsageError
        If a body is not in the chain.

    Examples
    --------
    >>> import dem_bridge as db
    >>> ax = db.plot.velocity(db.solve("accelerating-40", backend="bca"), bodies=[0, 40])
    >>> [line.get_label() for line in ax.get_lines()]
    ['body 0', 'body 40']
    """
    runs = _by_label(t)
    n_body = min(run.velocity.shape[1] for run in runs.values())
    if bodies is None:
        number = _BODIES if len(runs) == 1 else _BODIES_OF_SEVERAL
        chosen = sorted({round(place) for place in np.linspace(0, n_body - 1, number)})
    else:
        chosen = [bodies] if isinstance(bodies, int | np.integer) else list(bodies)
    for body in chosen:
        if not 0 <= body < n_body:
            raise UsageError(f"bodies = {bodies!r}, but the chain has no body {body}; allowed: 0 to {n_body - 1}")
    end = max(float(run.time[-1]) for run in runs.values()) if until is None else until
    lines = [
        Series(
            label=f"body {body}" + (f", {label}" if len(runs) > 1 else ""),
            style=f"line/{colour}/{form}",
            x=1e3 * run.time[run.time <= end],
            y=run.velocity[run.time <= end, body],
        )
        for form, (label, run) in enumerate(runs.items(), start=len(runs) > 1)
        for colour, body in enumerate(chosen)
    ]
    panel = Panel(title=_title(runs), x_label="time (ms)", y_label="velocity (m/s)", series=tuple(lines))
    return draw_panel(new_axes() if ax is None else ax, panel)


def residence(
    t: Runs, ax: Axes | None = None, *, theory: str | None = None, scene: Scene | str | Path | None = None
) -> Axes:
    """Plot the residence time of the impulse at each body (µs) with its uncertainty.

    The residence time is the time between the first maximal compressions of a body's two contacts (see
    :mod:`dem_bridge.observables.registry`).

    Parameters
    ----------
    t : Trajectory, sequence or mapping
        One or more runs.
    ax : Axes, optional
        Axes to draw on; the default is a new figure.
    theory : {"bca", "adiabatic"}, optional
        Theory to draw for comparison.
    scene : Scene, str or Path, optional
        Scene of the runs; needed for a theory unless the runs are of a shipped scene.

    Returns
    -------
    Axes

    Raises
    ------
    UsageError
        If the chain has fewer than three bodies, or the theory or the scene does not fit.

    Examples
    --------
    >>> import dem_bridge as db
    >>> run = db.solve("decelerating-40", backend="verlet", dt=1e-6, uncertainty=False)
    >>> db.plot.residence(run, theory="bca").get_ylabel()
    'residence time (µs)'
    """
    runs = dict(_by_label(t))
    first = next(iter(runs.values()))
    if first.velocity.shape[1] < 3:
        raise UsageError(
            f"{_scene_name(first)} has {first.velocity.shape[1]} bodies; allowed: at least three, because a residence"
            " time needs contacts on both sides"
        )
    if theory is not None:
        runs[LABELS.get(theory, theory)] = _by_theory(theory, scene, first)
    backends = [run.provenance.get("backend") for run in runs.values()]
    distinct = len(set(map(_backend_label, runs.values()))) == len(runs)
    # backends without a style of their own, and several runs of one backend, get numbered styles
    plain = distinct and set(backends) <= {*LABELS, *THEORIES, "ode45"}
    styles = None if plain else [f"nth/{nth}/{nth}" for nth in range(len(runs))]
    panel = residence_panel(runs, _title(_by_label(t)), styles=styles)
    return draw_panel(new_axes() if ax is None else ax, panel)


def budget(
    verification: Verification | SceneStudy,
    ax: Axes | None = None,
    *,
    quantity: str = "velocity",
    scene: str | None = None,
) -> Axes:
    """Plot the error budget of the LAMMPS run: its total error and the measured contributions.

    Parameters
    ----------
    verification : Verification or SceneStudy
        Result of :func:`dem_bridge.verify`.
    ax : Axes, optional
        Axes to draw on; the default is a new figure.
    quantity : {"velocity", "displacement", "peak_force", "crossing_time"}
        Quantity whose error is drawn, relative to the scale of the quantity.
    scene : str, optional
        Name of the scene; needed if several scenes were verified.

    Returns
    -------
    Axes

    Raises
    ------
    UsageError
        If there is no such scene or quantity, or no budget because runs are missing.
    """
    studies = verification.studies if isinstance(verification, Verification) else (verification,)
    names = [study.scene.name for study in studies]
    if scene is None and len(studies) == 1:
        scene = names[0]
    if scene not in names:
        raise UsageError(f"scene = {scene!r}; allowed (scenes that were verified): {', '.join(names)}")
    if quantity not in QUANTITIES:
        raise UsageError(f"quantity = {quantity!r}; allowed: {', '.join(QUANTITIES)}")
    study = studies[names.index(scene)]
    chosen = [budget for budget in study.budgets if budget.quantity == quantity]
    if not chosen:
        reason = " ".join(verdict.sentence for verdict in study.verdicts if verdict.outcome in ("BROKEN", "NOT_RUN"))
        raise UsageError(f"{scene} has no error budget, because some of its runs are missing; {reason}")
    ax = new_axes() if ax is None else ax
    budget_on(ax, chosen[0])
    ax.invert_yaxis()
    ax.set_title(f"{scene}: error of the {quantity.replace('_', ' ')}", loc="left", fontsize=11, fontweight="bold")
    ax.set_xlabel(f"difference / {chosen[0].scale_name.replace('_', ' ')}\ndotted: allowed unexplained error")
    return ax


def _by_label(t: Runs) -> dict[str, Trajectory]:
    """Return runs by distinct labels: the backend, with the time step or a number if backends are equal."""
    if isinstance(t, Mapping):
        return dict(t)
    runs = [t] if isinstance(t, Trajectory) else list(t)
    if not runs or not all(isinstance(run, Trajectory) for run in runs):
        raise UsageError(f"t = {t!r}; allowed: a Trajectory, a sequence of them, or a mapping from labels to them")
    labels = [_backend_label(run) for run in runs]
    if len(set(labels)) < len(labels):
        steps = [run.provenance.get("settings", {}).get("dt") for run in runs]
        labels = [
            label if step is None else f"{label}, dt = {step:.3g} s" for label, step in zip(labels, steps, strict=True)
        ]
    if len(set(labels)) < len(labels):
        labels = [f"{label} ({nth})" for nth, label in enumerate(labels, start=1)]
    return dict(zip(labels, runs, strict=True))


def _backend_label(run: Trajectory) -> str:
    """Return the label of the run's backend."""
    backend = str(run.provenance.get("backend", "run"))
    return LABELS.get(backend, backend)


def _scene_name(run: Trajectory) -> str:
    """Return the name of the run's scene."""
    return str(run.provenance.get("scene", "a chain"))


def _title(runs: Mapping[str, Trajectory]) -> str:
    """Return the title of a figure: the scenes, and the label of a single run."""
    scenes = ", ".join(dict.fromkeys(_scene_name(run) for run in runs.values()))
    return scenes if len(runs) > 1 else f"{scenes} ({next(iter(runs))})"


def _by_theory(theory: str, scene: Scene | str | Path | None, run: Trajectory) -> Trajectory:
    """Return the solution of a theory for the scene of a run."""
    if theory not in THEORIES:
        raise UsageError(f"theory = {theory!r}; allowed: {' or '.join(THEORIES)}, or None")
    name = _scene_name(run)
    if scene is None and name not in shipped_scenes("all"):
        raise UsageError(f"theory = {theory!r} needs the scene, but {name!r} is not a shipped scene; give scene=...")
    run_scene = load_scene(name) if scene is None else scene_of(scene)
    run_hash = run.provenance.get("scene_hash", run_scene.content_hash)
    if run_hash != run_scene.content_hash:
        raise UsageError(
            f"the run is of a scene {name} that differs from the scene {run_scene.name}; give the scene of this run"
        )
    return solve(run_scene, backend=theory, samples=len(run.time) - 1)


__all__ = ["budget", "residence", "spacetime", "velocity"]
