"""Study of pass bands: frequencies that a driven precompressed chain transmits, beside the dispersion relation.

A chirp sweeps slowly over all band edges, and the edges are read off each code's run. The theory is that of small
motions in an infinite chain, so the difference between the two comes from the length of the record, the size of the
motions and the time step; between codes it is round-off.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.observables.differences import difference
from dem_bridge.observables.modes import Bands, measured_bands, unit_cell
from dem_bridge.observables.verdict import Outcome, Verdict, judge
from dem_bridge.physics.dispersion import Cell
from dem_bridge.report.columns import KILOHERTZ, PERCENT, Column
from dem_bridge.report.study import FigureData, Series, Study
from dem_bridge.report.texts import Texts
from dem_bridge.runs.campaign import Jobs, Progress, run_cases
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from dem_bridge.scene.drive import Drive
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.recalled import recall_study
from dem_bridge.trajectory.trajectory import Trajectory

TEXTS = Texts("bands", "dem_bridge.studies")
#: codes in the order of their runs -> the one that each is compared with, what the two then differ by, and its style
CODES = {
    "scipy": {"other": "", "isolated": "", "style": "black line"},
    "verlet": {"other": "scipy", "isolated": "time step", "style": "green crosses"},
    "lammps-granular": {"other": "verlet", "isolated": "implementation and round-off", "style": "lammps-granular"},
}
EDGES_COLUMNS = {
    "backend": "code", "edge": "edge", "theory": Column("infinite chain", KILOHERTZ),
    "measured": Column("measured", KILOHERTZ), "off": Column("difference", PERCENT),
    "bar": Column("resolution", PERCENT), "outcome": "outcome",
}  # fmt: skip
CODES_COLUMNS = {
    "backend": "code", "other": "compared with", "isolated": "isolates", "apart": "difference",
    "oscillation": Column("oscillation of an overlap", PERCENT),
}  # fmt: skip
#: relative, of an edge
TOLERANCE = 0.01
#: samples in a period of the highest edge; a third of it is the least that :func:`measured_bands` takes
SAMPLES = 6
#: steps of velocity-Verlet in the same: frequencies are off by (2 pi / 500)^2 / 24 = 7e-6
STEPS = 500
#: edges are looked for from this part of the lowest to this of the highest
BELOW, BEYOND = 0.5, 1.15
#: parts of the record between which a chirp must be there: the window hides what is at its ends
SEEN = (0.005, 0.9)
#: part of the static overlap beyond which oscillations are no longer small: their square shifts edges by 0.2 %
SMALL = 0.05
#: a band or gap that is no wider than so many times what the record resolves may not be seen
RESOLVED = 4.0


@dataclass(frozen=True, kw_only=True)
class Measured:
    """Band edges read off one code's run."""

    backend: str
    other: str
    """The code that it is compared with."""
    isolated: str
    """What the two differ by."""
    style: str
    """Of its lines."""
    bands: Bands
    oscillation: float
    """Largest change of an overlap over the static one."""
    apart: float
    """Largest difference of a velocity to that of the code that it is compared with, relative to the largest; nan: that
    did not run."""


def study_bands(
    scene: Scene,
    *,
    engine: Engine | None = None,
    jobs: Jobs = None,
    progress: Progress | None = None,
    store: Store | None = None,
    tolerance: float = TOLERANCE,
) -> Study:
    """Compare the band edges of a driven, precompressed chain with those of the infinite chain.

    The chain is solved by scipy, the twin and LAMMPS.

    Parameters
    ----------
    scene : Scene
        Precompressed chain of repeated unit cells, driven over all band edges.
    tolerance : float
        Largest relative error of a band edge.
    engine, jobs, progress, store : as in :func:`dem_bridge.study`

    Returns
    -------
    Study

    Raises
    ------
    UnsupportedScene
        If the chain is not precompressed, has no unit cell, or is not driven over all edges.
    UsageError
        For a tolerance out of its range.
    """
    if not 0.0 < tolerance < 1.0:
        raise UsageError(f"tolerance = {tolerance!r}; allowed: above 0 and below 1")
    if scene.driving_force is None:
        raise UnsupportedScene(
            f"{scene.name} is driven by no force: in a gap nothing moves by itself; allowed: a [chain.drive] that goes"
            " over all edges"
        )
    cell = unit_cell(scene)[1]
    _check_range(scene, scene.driving_force, cell)
    engine = engine or Engine.chosen()

    def measured() -> Study:
        return _study(scene, cell, engine, tolerance, {"jobs": jobs, "progress": progress, "store": store})

    return recall_study("bands", store, measured, scene, engine, tolerance=tolerance)


def _study(scene: Scene, cell: Cell, engine: Engine, tolerance: float, campaign: Mapping[str, Any]) -> Study:
    """Run the codes and show what they measure; ``campaign``: arguments of ``run_cases``."""
    top = cell.edges[-1] / (2.0 * math.pi)
    sampling = Sampling(count=math.ceil(SAMPLES * top * scene.duration))
    step = Resolution(dt=1.0 / (STEPS * top))
    scipy = Case(scene=scene, backend="scipy", resolution=Resolution(), sampling=sampling, uncertainty=False)
    twin = replace(scipy, backend="verlet", resolution=step)
    cases = [scipy, twin, replace(twin, backend="lammps-granular", engine=engine)]
    results = run_cases(cases, **campaign)
    runs = {result.case.backend: result.trajectory for result in results if result.trajectory is not None}
    matches = [_measured(scene, cell, name, run, runs) for name, run in runs.items()]
    excuses = {result.backend: _excuse(scene, cell, result, tolerance) for result in matches}
    texts = {"scene": scene.name, "outcome": Outcome.BROKEN}
    broken = [TEXTS.verdict("broken", **texts, backend=r.case.backend, failure=r.failure) for r in results if r.failure]
    rows = [row for result in matches for row in _rows(cell, result, tolerance, excused=bool(excuses[result.backend]))]
    return TEXTS.study(
        {"scene": scene.name},
        answer=(*_answer(scene, cell, matches, rows, tolerance), *_undecided(rows, excuses)),
        tables=(
            TEXTS.table("edges", EDGES_COLUMNS, rows, tolerance=tolerance),
            TEXTS.table("codes", CODES_COLUMNS, matches),
        ),
        figures=(_figure(cell, matches),) if matches else (),
        verdicts=(*_verdicts(scene, rows, tolerance), *broken),
    )


def _check_range(scene: Scene, drive: Drive, cell: Cell) -> None:
    """Raise UnsupportedScene for a sine or chirp that does not go over all edges while the window is open."""
    low, high = (factor * edge / (2.0 * math.pi) for factor, edge in ((BELOW, cell.edges[0]), (BEYOND, cell.edges[-1])))
    requested = (
        f"a chirp that is below {low:.0f} Hz at {SEEN[0] * scene.duration:g} s and above {high:.0f} Hz at"
        f" {SEEN[1] * scene.duration:g} s"
    )
    if drive.shape == "sine":
        raise UnsupportedScene(f"{scene.name} is driven at one frequency; allowed: {requested}, or a table of forces")
    if drive.shape == "chirp":
        assert drive.frequency is not None
        assert drive.last_frequency is not None
        assert drive.sweep is not None
        rate = (drive.last_frequency - drive.frequency) / drive.sweep
        begin, end = (drive.frequency + rate * min(part * scene.duration, drive.sweep) for part in SEEN)
        if begin > low or end < high:
            result = f"its chirp is at {begin:.0f} Hz and {end:.0f} Hz then"
            raise UnsupportedScene(f"{scene.name} is not driven over all edges: {result}; allowed: {requested}")


@dataclass(frozen=True, kw_only=True)
class _Row:
    backend: str
    edge: int
    theory: float
    """Hz."""
    measured: float
    """Hz; nan: not found."""
    bar: float
    """Relative."""
    outcome: Outcome

    @property
    def off(self) -> float:
        """Relative."""
        return self.measured / self.theory - 1.0


def _verdicts(scene: Scene, rows: Sequence[_Row], tolerance: float) -> Iterator[Verdict]:
    for row in rows:
        names = {"scene": scene.name, "backend": row.backend, "outcome": row.outcome, "edge": row.edge}
        numbers = {"difference": abs(row.off), "scale": row.theory, "uncertainty": row.bar, "tolerance": tolerance}
        yield TEXTS.verdict("edge", **names, **numbers, measured=row.measured)


def _measured(scene: Scene, cell: Cell, name: str, run: Trajectory, runs: dict[str, Trajectory]) -> Measured:
    top = cell.edges[-1] / (2.0 * math.pi)
    lowest = BELOW * cell.edges[0] / (2.0 * math.pi)
    links = len(scene.stiffness)
    static = -scene.contacts.gap[:links]
    change = -np.diff(run.displacement, axis=1)
    code = CODES[name]
    other = runs.get(code["other"])
    return Measured(
        backend=name,
        **code,
        bands=measured_bands(scene, run, lowest=lowest, highest=BEYOND * top),
        oscillation=float(np.max(np.abs(change) / static)),
        apart=math.nan if other is None else difference("velocity", run, other).value,
    )


def _excuse(scene: Scene, cell: Cell, item: Measured, tolerance: float) -> str:
    """Return why an edge that is off, or missing, says nothing of the code; "" where it does."""
    if item.oscillation > SMALL:
        return TEXTS("large", share=item.oscillation)
    if scene.dissipates:
        return TEXTS("damped")
    finest = item.bands.resolution
    if _unseen(cell, item):
        return TEXTS("unseen", finest=finest, narrowest=_narrowest(cell))
    if len(item.bands.edges) == len(cell.edges):
        return ""
    if finest > tolerance * cell.edges[0] / (2.0 * math.pi):
        return TEXTS("coarse", finest=finest)
    return TEXTS("table") if scene.drive is not None and scene.drive.shape == "table" else ""


def _narrowest(cell: Cell) -> float:
    """Return the width of the narrowest band or gap, Hz."""
    return float(np.min(np.diff([0.0, *cell.edges]))) / (2.0 * math.pi)


def _unseen(cell: Cell, item: Measured) -> bool:
    """Return whether a band or gap is narrower than the record resolves, so that its edges may be chance."""
    return RESOLVED * item.bands.resolution > _narrowest(cell)


def _undecided(rows: Sequence[_Row], excuses: dict[str, str]) -> Iterator[str]:
    for name, why in excuses.items():
        if why and any(row.backend == name and row.outcome is Outcome.UNDECIDED for row in rows):
            yield TEXTS("undecided", backend=name, reason=why)


def _rows(cell: Cell, item: Measured, tolerance: float, *, excused: bool) -> Iterator[_Row]:
    """Yield the edges in their order; where there are more or fewer than there should be none is known by name.

    ``excused``: what would FAIL is UNDECIDED; so is what would PASS, where a band or gap is too narrow to be seen.
    """
    theory = [edge / (2.0 * math.pi) for edge in cell.edges]
    measured = list(item.bands.edges)
    alike = len(measured) == len(theory)
    for nth, there in enumerate(theory):
        here, bar = (measured[nth] if alike else math.nan), item.bands.resolution / there
        outcome = judge(abs(here / there - 1.0), bar, tolerance) if alike else Outcome.FAIL
        if (excused and outcome is Outcome.FAIL) or _unseen(cell, item):
            outcome = Outcome.UNDECIDED
        yield _Row(backend=item.backend, edge=nth, theory=there, measured=here, bar=bar, outcome=outcome)


def _answer(
    scene: Scene, cell: Cell, matches: Sequence[Measured], rows: Sequence[_Row], tolerance: float
) -> Iterator[str]:
    if not matches:
        yield TEXTS("none", scene=scene.name)
        return
    edges = ", ".join(f"{1e-3 * edge / (2.0 * math.pi):.4g}" for edge in cell.edges)
    yield TEXTS("edges", scene=scene.name, cell=cell, bodies="body" if cell.bodies == 1 else "bodies", edges=edges)
    identified = [row for row in rows if math.isfinite(row.measured)]
    if identified:
        worst, bar = max(identified, key=lambda row: abs(row.off)), max(row.bar for row in identified)
        yield TEXTS("measured", off=abs(worst.off), row=worst, bar=bar, tolerance=tolerance)
    for item in matches:
        if len(item.bands.edges) != len(cell.edges):
            yield TEXTS("count", backend=item.backend, count=len(item.bands.edges), expected=len(cell.edges))
    for item in matches:
        if math.isfinite(item.apart):
            yield TEXTS("apart", **vars(item))
    largest = max(result.oscillation for result in matches)
    small = "small, as the theory asks" if largest <= SMALL else "not small: edges move with its square"
    yield TEXTS("oscillation", share=largest, small=small)


def _figure(cell: Cell, matches: Sequence[Measured]) -> FigureData:
    phases = np.linspace(0.0, math.pi, 101)
    branches = np.array([cell.frequencies(phase) for phase in phases.tolist()]) / (2e3 * math.pi)
    dispersion = [
        Series(label="infinite chain", style="guide", x=phases / math.pi, y=branches[:, nth])
        for nth in range(cell.bodies)
    ]
    levels = [20.0 * np.log10(result.bands.transmission) for result in matches]
    ends = np.array([min(map(np.min, levels)), max(map(np.max, levels))])
    transmission = [
        Series(label="band edges", style="guide", x=np.full(2, edge / (2e3 * math.pi)), y=ends) for edge in cell.edges
    ]
    for result, level in zip(matches, levels, strict=True):
        drawn: dict[str, Any] = {"label": result.backend, "style": result.style}
        frequency = 1e-3 * result.bands.frequency
        dispersion.append(Series(**drawn, x=result.bands.phase / math.pi, y=frequency))
        transmission.append(Series(**drawn, x=frequency, y=level))
    return TEXTS.figure("bands", (TEXTS.panel("dispersion", dispersion), TEXTS.panel("transmission", transmission)))
