"""Prepare what the page of a verification plays: motion of its chains, and the errors of LAMMPS on one scale."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.observables.verdict import Outcome
from dem_bridge.report.live import Chain
from dem_bridge.report.study import Panel, Series
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.reference_choice import REFERENCE, SCIPY
from dem_bridge.verification.roles import THEORY

#: most bodies or contacts that are drawn as lines
MOST_LINES_DRAWN = 7
#: arrival of the front at each body by a run
ARRIVAL = OBSERVABLES["arrival"].value


def body_noun(scene: Scene) -> str:
    """Return "cylinder" or "sphere" if all bodies but the first have this shape, else "body".

    >>> import dem_bridge as db
    >>> [body_noun(db.load_scene(name)) for name in ("decelerating-40", "dimer-1-1", "sphere-cylinder-sphere")]
    ['cylinder', 'sphere', 'body']
    """
    shapes = set() if scene.geometry is None else {body.shape for body in scene.geometry.bodies[1:]}
    return shapes.pop() if len(shapes) == 1 else "body"


def time_after_front(run: Trajectory) -> float:
    """Return a time shortly after the front has reached the last body, s, or the end if it never does."""
    last = float(run.crossing_time[-1]) if len(run.crossing_time) else np.nan
    return min(1.15 * last, float(run.time[-1])) if np.isfinite(last) else float(run.time[-1])


def chains_of(study: SceneStudy) -> list[Chain]:
    """Return what the page plays of one scene: the velocities by LAMMPS, and their error; empty without a run."""
    run, reference = study.run(study.engine), study.run(REFERENCE)
    shown = run or reference
    if shown is None:
        return []
    scene = study.scene
    few = scene.n_body <= MOST_LINES_DRAWN
    first = 0 if few or scene.drive is not None else 1
    end = float(shown.time[-1]) if few else time_after_front(shown)
    rows = max(2, int(np.searchsorted(shown.time, end, side="right")))
    theory = None if few else study.run(THEORY)
    by = "LAMMPS" if run is not None else "the reference"
    chain = Chain(
        id=scene.name,
        title=scene.name,
        caption=f"Velocity by {by}." + (" Circles: front by BCA." if theory is not None else ""),
        time=shown.time[:rows],
        velocity=shown.velocity[:rows, first:],
        first=first,
        noun=body_noun(scene),
        lines=few,
        fronts={} if theory is None else {THEORY: ARRIVAL(scene, theory)[first:]},
    )
    if run is None or reference is None or not np.array_equal(run.time, reference.time):
        return [chain]
    return [
        chain,
        replace(
            chain,
            id=f"{scene.name}-error",
            title=f"{scene.name}, error",
            caption="Velocity by LAMMPS minus that by the reference.",
            velocity=(run.velocity - reference.velocity)[:rows, first:],
            signed=True,
            quantity="error",
            fronts={},
        ),
    ]


def error_scale(studies: Sequence[SceneStudy]) -> Panel | None:
    """Return the parts of the velocity error of scenes on one logarithmic scale; None where none is known."""
    errors = {study.scene.name: dict(_errors(study)) for study in studies}
    kinds = {name: kind for of_scene in errors.values() for name, (_, kind) in of_scene.items()}
    rows = [name for name in _ROWS if name in kinds]
    if not rows:
        return None
    series = []
    for scene, of_scene in errors.items():
        present = [name for name in rows if name in of_scene]
        values = np.array([of_scene[name][0] for name in present])
        places = np.array([float(rows.index(name)) for name in present])
        series.append(Series(label=scene, style="mark-2", x=values, y=places))
    verdicts = [verdict for study in studies for verdict in study.verdicts]
    tolerances = [v.tolerance for v in verdicts if (v.quantity, v.reference) == ("velocity", REFERENCE)]
    positive = [value for value in tolerances if value is not None and 0.0 < value < math.inf]
    if positive:
        ends = np.array([-0.5, len(rows) - 0.5])
        series.append(Series(label="tolerance", style="guide", x=np.full(2, max(positive)), y=ends))
    return Panel(
        title="Errors of velocity on one scale",
        x_label="relative error",
        y_label="",
        series=tuple(series),
        rows=tuple(rows),
        row_kinds=tuple(kinds[name] for name in rows),
    )


#: rows of the scale from the budget -> part, kind of error
_PARTS = {
    "reference (estimate)": ("reference", "round-off"),
    "LAMMPS, round-off": ("round-off", "round-off"),
    "LAMMPS, force tables": ("table", "time step"),
    "LAMMPS, time step": ("time step", "time step"),
}
#: rows of the scale from the verdicts -> quantity, backend, kind of error
_COMPARED = {
    "reference, second method": ("velocity", SCIPY, "round-off"),
    "BCA: arrival at the end": ("arrival_at_end", THEORY, "model"),
    "BCA: velocity": ("velocity", THEORY, "model"),
}


#: rows of the scale in their order
_ROWS = (
    "reference (estimate)", "reference, second method", "LAMMPS, round-off", "LAMMPS, force tables",
    "LAMMPS, time step", "LAMMPS, known defect", "LAMMPS, unexplained", "BCA: arrival at the end", "BCA: velocity",
)  # fmt: skip


def _errors(study: SceneStudy) -> Iterator[tuple[str, tuple[float, str]]]:
    """Yield the rows of the scale of one scene with their values, which are above zero, and the kinds of error."""
    compared = {
        (v.quantity, v.backend): v.difference
        for v in study.verdicts
        if v.reference == REFERENCE and v.outcome is not Outcome.NOT_RUN
    }
    rows = {name: (compared.get((quantity, code)), kind) for name, (quantity, code, kind) in _COMPARED.items()}
    for budget in study.budgets[:1]:  # that of velocities
        rows |= {name: (budget.parts[part], kind) for name, (part, kind) in _PARTS.items()}
        if budget.is_finding:
            met = {v.quantity for v in study.verdicts if v.known_defect and v.backend == study.engine}
            rest = "known defect" if budget.quantity in met else "unexplained"
            rows[f"LAMMPS, {rest}"] = (budget.unexplained, "")
    for name, (value, kind) in rows.items():
        if value is not None and 0.0 < value < math.inf:
            yield name, (value, kind)
