"""Study of single precision: the digits that LAMMPS' single and mixed precision modes leave of the velocities.

The twin is run in the arithmetic of these modes (:mod:`dem_bridge.backends.precision`) with the surrogate radius and
with the radius of the bodies. Overlaps are differences of positions, so their relative error is the rounding of a
position over an overlap, ``2^-24 L / overlap`` for positions of size L.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling, backend
from dem_bridge.backends.precision import PRECISIONS, velocities_in
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.backends.splitting import FUSED
from dem_bridge.backends.steps import fixed_step_plan
from dem_bridge.backends.surrogate_radius import radius_after
from dem_bridge.backends.twin import solve_plan
from dem_bridge.errors import UnsupportedScene
from dem_bridge.report.columns import METRE, SECOND, SPEED, Column
from dem_bridge.report.study import FigureData, Series, Study
from dem_bridge.report.texts import Texts
from dem_bridge.runs.campaign import Jobs, Progress, map_in_threads
from dem_bridge.runs.recall import recall
from dem_bridge.runs.store import Store
from dem_bridge.scene.file import load_scene, shipped_scenes
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.relative import relative_size
from dem_bridge.trajectory.trajectory import Floats

TEXTS = Texts("precision", "dem_bridge.studies")
PRECISION_COLUMNS = {
    "scene": "scene", "kind": "radius", "radius": Column("radius", METRE), "dt": Column("step", SECOND),
    "length": Column("L", METRE), "overlap": Column("overlap", METRE), "error.double": "double",
    "error.force": "force", "error.mixed": "mixed", "mixed": "mixed, predicted", "error.kokkos-mixed": "kokkos-mixed",
    "error.single": "single", "single": "single, predicted", "standstill": Column("standstill", SPEED),
}  # fmt: skip
PRECISION_STEPS_COLUMNS = {
    "kind": "radius", "dt": Column("step", SECOND), "total.double": "double", "total.force": "force",
    "total.mixed": "mixed", "total.kokkos-mixed": "kokkos-mixed", "total.single": "single",
}  # fmt: skip
MAIN = "decelerating-40"
SAMPLES = 300
#: rounding of a number in single precision, relative
ROUNDING = 2.0**-24
#: modes with a column of their own; those of the figures
MODES = tuple(mode for mode in PRECISIONS if mode != "double")
DRAWN = ("mixed", "single")
SURROGATE, REAL = "surrogate", "real"
#: steps of the main scene, in default steps
FACTORS = (1, 2, 5, 10, 20, 50, 100)


@dataclass(frozen=True, kw_only=True)
class Rounded:
    """Errors of one scene at one step, with bodies of one radius."""

    scene: str
    kind: str
    """"surrogate", or "real" for the radius that follows from the scene's geometry."""
    radius: float
    """m."""
    dt: float
    """s."""
    steps: int
    length: float
    """m: largest position."""
    overlap: float
    """m: median of the largest overlaps of the contacts."""
    error: Mapping[str, float]
    """Mode -> largest difference of a velocity from the twin in double precision, relative to the largest velocity."""
    total: Mapping[str, float]
    """Mode -> largest error of a velocity, relative, against the reference; empty where it was not run."""

    @property
    def mixed(self) -> float:
        """Predicted scale of the error of a mode that subtracts positions in single precision."""
        return ROUNDING * self.length / self.overlap

    @property
    def single(self) -> float:
        """Predicted scale where positions are also moved in single precision: each step rounds, at random."""
        return self.mixed * math.sqrt(self.steps)

    @property
    def standstill(self) -> float:
        """Speed (m/s) below which a body at the far end does not move in single precision."""
        return ROUNDING * self.length / self.dt


def study_precision(
    scene: Scene | None = None,
    *,
    jobs: Jobs = None,
    progress: Progress | None = None,
    store: Store | None = None,
) -> Study:
    """Measure the digits of the velocities that LAMMPS' single and mixed precision modes leave.

    One scene (decelerating-40, or the one that is given) is also run at larger time steps and compared with the
    reference.

    Parameters
    ----------
    scene : Scene, optional
        Scene to be solved, of Hertz' contacts without damping, drag and drive. None: every such shipped scene.
    jobs, progress, store : as in :func:`dem_bridge.study`

    Returns
    -------
    Study

    Raises
    ------
    UnsupportedScene
        If the scene has anything else.
    """
    if scene is not None and (reason := FUSED.unsupported_reason(scene)):
        raise UnsupportedScene(f"precision of {scene.name}: {reason}")
    scenes = [item for item in map(load_scene, shipped_scenes()) if FUSED.covers(item)] if scene is None else [scene]
    main = next((item for item in scenes if item.name == MAIN), scenes[0])
    work = [(item, 1, False) for item in scenes] + [(main, factor, True) for factor in FACTORS]
    finished: list[str] = []

    def measured(item: tuple[Scene, int, bool]) -> list[Rounded]:
        how: dict[str, Any] = {"kinds": [Rounded], "scenes": [item[0]], "factor": item[1], "with_reference": item[2]}
        result = recall(store, "precision: errors", [], lambda: list(errors_of(*item)), **how)
        finished.append(item[0].name)
        if progress is not None:
            progress(len(finished), len(work), item[0].name)
        return result

    results = map_in_threads(measured, work, jobs)
    rows = [row for of_scene in results[: len(scenes)] for row in of_scene]
    steps = [row for of_step in results[len(scenes) :] for row in of_step]
    return TEXTS.study(
        {"count": len(scenes)},
        answer=tuple(_answer(rows, steps)),
        tables=(
            TEXTS.table("precision", PRECISION_COLUMNS, rows),
            TEXTS.table("precision-steps", PRECISION_STEPS_COLUMNS, steps, scene=main.name),
        ),
        figures=(_figure(rows, steps, main.name),),
        provenance={"scenes": {item.name: item.content_hash for item in scenes}},
    )


def errors_of(scene: Scene, factor: int = 1, with_reference: bool = False) -> Iterator[Rounded]:
    """Yield the errors of a scene at so many default steps, with the surrogate radius and with that of the bodies."""
    prescan, sampling = prescan_scene(scene), Sampling(count=SAMPLES)
    default = fixed_step_plan(scene, Resolution(), sampling, prescan)
    plan = fixed_step_plan(scene, Resolution(dt=factor * default.step * (1.0 + 1e-12)), sampling, prescan)
    twin = solve_plan(scene, plan).velocity
    exact = backend("reference").run(scene, Resolution(), sampling).velocity if with_reference else None
    radii = {SURROGATE: radius_after(prescan)}
    if scene.spacing is not None:
        radii[REAL] = 0.5 * scene.spacing
    touched = prescan.peak_overlap[prescan.peak_overlap > 0.0]
    for kind, radius in radii.items():
        runs = {mode: velocities_in(mode, scene, plan, radius) for mode in PRECISIONS}
        yield Rounded(
            scene=scene.name,
            kind=kind,
            radius=radius,
            dt=plan.step,
            steps=plan.steps,
            length=2.0 * radius * (scene.n_contact + 1) + prescan.highest,
            overlap=float(np.median(touched)) if len(touched) else math.nan,
            error={mode: relative(run, twin) for mode, run in runs.items()},
            total={mode: relative(run, exact) for mode, run in runs.items()} if exact is not None else {},
        )


def relative(velocity: Floats, reference: Floats) -> float:
    """Return the largest difference relative to the largest reference velocity; inf if one is not finite."""
    difference = relative_size(float(np.max(np.abs(velocity - reference))), float(np.max(np.abs(reference))))
    return difference if math.isfinite(difference) else math.inf


def _answer(rows: Sequence[Rounded], steps: Sequence[Rounded]) -> Iterator[str]:
    for kind in (SURROGATE, REAL):
        chosen = [row for row in rows if row.kind == kind]
        if chosen:
            spans = {mode.replace("-", "_"): _span([row.error[mode] for row in chosen]) for mode in MODES}
            yield TEXTS(kind, count=len(chosen), **spans)
    force = _span([row.error["force"] for row in rows])
    ratios = {mode: [row.error[mode] / getattr(row, mode) for row in rows] for mode in DRAWN}
    spans = {mode: f"{min(values):.2g} to {max(values):.2g}" for mode, values in ratios.items()}
    yield TEXTS("cause", force=force, **spans)
    best = {mode: _smallest(steps, mode) for mode in ("double", *DRAWN)}
    yield TEXTS("steps", scene=steps[0].scene, **best)


def _smallest(steps: Sequence[Rounded], mode: str) -> str:
    """Return the smallest error with the surrogate radius, and its step."""
    error, dt = min((row.total[mode], row.dt) for row in steps if row.kind == SURROGATE)
    return f"{error:.1g} at dt = {dt:.1g} s"


def _span(errors: Sequence[float]) -> str:
    """Return the range of some errors and of the digits that they leave.

    >>> _span([1e-4, 3e-6]), _span([2e-2, 4.0])
    ('3e-06 to 0.0001 (4 to 5 digits)', '0.02 to 4 (0 to 1 digits)')
    """
    low, high = min(errors), max(errors)
    least, most = (max(0, math.floor(-math.log10(error))) if error > 0.0 else 15 for error in (high, low))
    digits = f"{least} digits" if least == most else f"{least} to {most} digits"
    return f"{low:.1g} to {high:.1g} ({digits})"


def _figure(rows: Sequence[Rounded], steps: Sequence[Rounded], scene: str) -> FigureData:
    styles = {("mixed", SURROGATE): 2, ("mixed", REAL): 3, ("single", SURROGATE): 4, ("single", REAL): 5}
    scatter: list[Series] = []
    curves: list[Series] = []
    for (mode, kind), style in styles.items():
        points = [(getattr(row, mode), row.error[mode]) for row in rows if row.kind == kind]
        totals = [(row.dt, row.total[mode]) for row in steps if row.kind == kind]
        for into, values in ((scatter, points), (curves, totals)):
            if values:
                x, y = np.array(values).T
                into.append(Series(label=f"{mode}, {kind} radius", style=f"mark-{style}", x=x, y=y))
    ends = np.array([min(row.mixed for row in rows), max(row.single for row in rows)])
    double = [row for row in steps if row.kind == SURROGATE]
    x, y = np.array([(row.dt, row.total["double"]) for row in double]).T
    panels = (
        TEXTS.panel(
            "prediction",
            (Series(label="measured = predicted", style="guide", x=ends, y=ends), *scatter),
            log=True,
            tall=True,
        ),
        TEXTS.panel(
            "steps",
            (Series(label="double precision", style="black line", x=x, y=y), *curves),
            scene=scene,
            log=True,
            tall=True,
        ),
    )
    return TEXTS.figure("precision-errors", panels, scene=scene)
