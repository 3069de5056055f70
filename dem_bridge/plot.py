"""Pictures of runs for notebooks and papers: ``db.plot``. Each function draws on ``ax`` (None: in a figure of its own)
as the figures of the report are drawn, and returns the matplotlib Axes, to be changed at will.

Nothing is shown or saved here, and no display is needed. Runs are a Trajectory, several, or names with runs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from dem_bridge.api.runs import solve
from dem_bridge.errors import UsageError
from dem_bridge.report.drawing import Axes, drawn_on, new_axes
from dem_bridge.report.figures import LABELS, budget_on, residence_panel, spacetime_panel
from dem_bridge.scene import Scene
from dem_bridge.scene_file import load_scene, scene_of, shipped_scenes
from dem_bridge.studies.study import Panel, Series
from dem_bridge.studies.verify import Verification
from dem_bridge.trajectory import QUANTITIES, Trajectory
from dem_bridge.verification.assess import SceneStudy

#: one run, several, or name -> run
Runs = Trajectory | Sequence[Trajectory] | Mapping[str, Trajectory]
#: backends that are theories of the front
THEORIES = ("bca", "adiabatic")
#: bodies whose velocity is drawn where none are named
_BODIES, _OF_SEVERAL = 5, 3


def spacetime(
    t: Runs,
    ax: Axes | None = None,
    *,
    until: float | None = None,
    theory: str | None = None,
    scene: Scene | str | Path | None = None,
) -> Axes:
    """Velocity (colour, m/s) of every body over time (ms). ``until`` (s): None: a little after the front has passed.

    ``theory``: "bca" or "adiabatic", whose arrivals are drawn over it; for that the ``scene`` is needed, unless it is a
    shipped one. Raises UsageError for another theory or scene.

    >>> import dem_bridge as db
    >>> ax = db.plot.spacetime(db.solve("accelerating-40", backend="verlet", dt=1e-6, bars=False), theory="bca")
    >>> ax.get_xlabel(), ax.get_ylabel(), [line.get_label() for line in ax.get_lines()]
    ('body', 'time (ms)', ['front by BCA'])
    """
    if len(named := _named(t)) != 1:
        raise UsageError(f"t has {len(named)} runs; allowed: one, for a map shows no two")
    [(label, run)] = named.items()
    fronts = {} if theory is None else {theory: _by_theory(theory, scene, run)}
    panel = spacetime_panel(run, f"{_scene_name(run)} ({label})", until=until, fronts=fronts)
    return drawn_on(new_axes() if ax is None else ax, panel)


def velocity(
    t: Runs, bodies: Sequence[int] | int | None = None, ax: Axes | None = None, *, until: float | None = None
) -> Axes:
    """Velocity (m/s) of some ``bodies`` over time (ms): by colour the body, by form the run; of several runs the first
    is a pale band in which the others are to be.

    ``bodies``: None: five along the chain, three of several runs. ``until`` (s): None: the end. Raises UsageError for a
    body that is not there.
    """
    runs = _named(t)
    least = min(run.velocity.shape[1] for run in runs.values())
    if bodies is None:
        chosen = sorted(
            {round(place) for place in np.linspace(0, least - 1, _BODIES if len(runs) == 1 else _OF_SEVERAL)}
        )
    else:
        chosen = [bodies] if isinstance(bodies, int | np.integer) else list(bodies)
    for one in chosen:
        if not 0 <= one < least:
            raise UsageError(f"bodies = {bodies!r}, and the chain has no body {one}; allowed: 0 to {least - 1}")
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
    return drawn_on(new_axes() if ax is None else ax, panel)


def residence(
    t: Runs, ax: Axes | None = None, *, theory: str | None = None, scene: Scene | str | Path | None = None
) -> Axes:
    """How long each body holds the impulse (µs), with error bars: from the first maximal compression of the contact on
    its struck side to that of the other, as :mod:`dem_bridge.observables.front` has it.

    ``theory``: "bca" or "adiabatic" beside it; ``scene``: as in :func:`spacetime`. Raises UsageError for fewer than
    three bodies.

    >>> import dem_bridge as db
    >>> run = db.solve("decelerating-40", backend="verlet", dt=1e-6, bars=False)
    >>> db.plot.residence(run, theory="bca").get_ylabel()
    'residence time (µs)'
    """
    runs = dict(_named(t))
    first = next(iter(runs.values()))
    if first.velocity.shape[1] < 3:
        raise UsageError(f"{_scene_name(first)} has {first.velocity.shape[1]} bodies; residence times need three")
    if theory is not None:
        runs[LABELS.get(theory, theory)] = _by_theory(theory, scene, first)
    backends = [run.provenance.get("backend") for run in runs.values()]
    plain = len(set(map(_who, runs.values()))) == len(runs) and set(backends) <= {*LABELS, *THEORIES, "ode45"}
    # codes that have no look of their own, or the same, are told apart by number
    styles = None if plain else [f"nth/{at}/{at}" for at in range(len(runs))]
    panel = residence_panel(runs, _title(_named(t)), styles=styles)
    return drawn_on(new_axes() if ax is None else ax, panel)


def budget(
    found: Verification | SceneStudy, ax: Axes | None = None, *, quantity: str = "velocity", scene: str | None = None
) -> Axes:
    """What the error of LAMMPS' run consists of, each part measured by other runs, relative to the quantity's scale.

    ``scene``: its name, where several were verified; ``quantity``: "velocity", "displacement", "peak_force" or
    "crossing_time". Raises UsageError where there is no such budget.
    """
    studies = found.studies if isinstance(found, Verification) else (found,)
    names = [study.scene.name for study in studies]
    if scene is None and len(studies) == 1:
        scene = names[0]
    if scene not in names:
        raise UsageError(f"scene = {scene!r}; allowed, of what was verified: {', '.join(names)}")
    if quantity not in QUANTITIES:
        raise UsageError(f"quantity = {quantity!r}; allowed: {', '.join(QUANTITIES)}")
    study = studies[names.index(scene)]
    chosen = [one for one in study.budgets if one.quantity == quantity]
    if not chosen:
        why = " ".join(verdict.sentence for verdict in study.verdicts if verdict.outcome in ("BROKEN", "NOT_RUN"))
        raise UsageError(f"{scene} has no budget, for not all its runs were made; {why}")
    ax = new_axes() if ax is None else ax
    budget_on(ax, chosen[0])
    ax.invert_yaxis()
    ax.set_title(f"{scene}: error of the {quantity.replace('_', ' ')}", loc="left", fontsize=11, fontweight="bold")
    ax.set_xlabel(f"difference / {chosen[0].scale_name.replace('_', ' ')}\ndotted: what may stay unexplained")
    return ax


def _named(t: Runs) -> dict[str, Trajectory]:
    """Runs by names that tell them apart: the code; where that is the same, its step; else a number."""
    if isinstance(t, Mapping):
        return dict(t)
    runs = [t] if isinstance(t, Trajectory) else list(t)
    if not runs or not all(isinstance(run, Trajectory) for run in runs):
        raise UsageError(f"t = {t!r}; allowed: a Trajectory, several, or names with trajectories")
    names = [_who(run) for run in runs]
    if len(set(names)) < len(names):
        steps = [run.provenance.get("settings", {}).get("dt") for run in runs]
        names = [
            name if step is None else f"{name}, dt = {step:.3g} s" for name, step in zip(names, steps, strict=True)
        ]
    if len(set(names)) < len(names):
        names = [f"{name} ({at})" for at, name in enumerate(names, start=1)]
    return dict(zip(names, runs, strict=True))


def _who(run: Trajectory) -> str:
    backend = str(run.provenance.get("backend", "run"))
    return LABELS.get(backend, backend)


def _scene_name(run: Trajectory) -> str:
    return str(run.provenance.get("scene", "a chain"))


def _title(runs: Mapping[str, Trajectory]) -> str:
    scenes = ", ".join(dict.fromkeys(_scene_name(run) for run in runs.values()))
    return scenes if len(runs) > 1 else f"{scenes} ({next(iter(runs))})"


def _by_theory(theory: str, scene: Scene | str | Path | None, run: Trajectory) -> Trajectory:
    """What a theory says of the scene of a run."""
    if theory not in THEORIES:
        raise UsageError(f"theory = {theory!r}; allowed: {' or '.join(THEORIES)}, or None")
    name = _scene_name(run)
    if scene is None and name not in shipped_scenes():
        raise UsageError(f"theory = {theory!r} needs the scene, and {name!r} is no shipped one; give scene=...")
    known = load_scene(name) if scene is None else scene_of(scene)
    solved = run.provenance.get("scene_hash", known.content_hash)
    if solved != known.content_hash:
        raise UsageError(f"the run is of another {name} than the scene {known.name}; give the scene that was run")
    return solve(known, backend=theory, samples=len(run.time) - 1)


__all__ = ["budget", "residence", "spacetime", "velocity"]
