"""Study of pass bands: frequencies that a driven precompressed chain transmits, beside the dispersion relation.

A chirp sweeps slowly over all band edges, and the edges are read off each code's run. The theory is that of small
motions in an infinite chain, so the difference between the two comes from the length of the record, the size of the
motions and the time step; between codes it is round-off.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.campaign import Progress, Result, run_cases
from dem_bridge.differences import difference
from dem_bridge.drive import Drive
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.observables.bands import Bands, measured_bands, unit_cell
from dem_bridge.physics.dispersion import Cell
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from dem_bridge.scene import Scene
from dem_bridge.studies.study import FigureData, Panel, Series, Study, Table
from dem_bridge.trajectory import Trajectory
from dem_bridge.verification.verdict import Outcome, Verdict, judge

#: code -> what it is compared with, and what the two then differ by
COMPARED = {
    "scipy": ("", ""),
    "verlet": ("scipy", "time step"),
    "lammps-granular": ("verlet", "implementation and round-off"),
}
_DRAWN = {"scipy": "reference", "verlet": "ode45", "lammps-granular": "lammps-granular"}
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
class Found:
    """Band edges read off one code's run."""

    backend: str
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
    jobs: int | None = None,
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
    cell = unit_cell(scene)[1]
    if scene.drive is None:
        raise UnsupportedScene(
            f"{scene.name} is not driven: in a gap nothing moves by itself; allowed: a [chain.drive] that goes"
            " over all edges"
        )
    top = cell.edges[-1] / (2.0 * math.pi)
    _check_range(scene, scene.drive, cell)
    sampling = Sampling(count=math.ceil(SAMPLES * top * scene.duration))
    step = Resolution(dt=1.0 / (STEPS * top))
    cases = [
        Case(
            scene=scene,
            backend=name,
            resolution=Resolution() if name == "scipy" else step,
            sampling=sampling,
            engine=engine if name.startswith("lammps") else None,
            uncertainty=False,
        )
        for name in COMPARED
    ]
    results = run_cases(cases, jobs=jobs, progress=progress, store=store)
    runs = {result.case.backend: result.trajectory for result in results if result.trajectory is not None}
    matches = [_found(scene, cell, name, run, runs) for name, run in runs.items()]
    excuses = {result.backend: _excuse(scene, cell, result, tolerance) for result in matches}
    failures = [result for result in results if result.failure is not None]
    rows = [row for result in matches for row in _rows(cell, result, tolerance, excused=bool(excuses[result.backend]))]
    return Study(
        id="bands",
        title=f"Bands of {scene.name}",
        answer=(*_answer(scene, cell, matches, rows, tolerance), *_undecided(rows, excuses)),
        tables=(_edges(rows, tolerance), _codes(matches)),
        figures=(_figure(cell, matches),) if matches else (),
        verdicts=(*(_verdict(scene, row, tolerance) for row in rows), *map(_broken, failures)),
        notes=(
            "Edges are where the trace of the unit cell's transfer matrix, fitted to the spectra of the velocities,"
            " passes 2 or -2; the bar is the inverse of the record's length.",
        ),
    )


def _check_range(scene: Scene, drive: Drive, cell: Cell) -> None:
    """UnsupportedScene for a sine or chirp that does not go over all edges while the window is open."""
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


def _verdict(scene: Scene, row: _Row, tolerance: float) -> Verdict:
    return Verdict(
        scene=scene.name,
        quantity=f"band edge {row.edge}",
        backend=row.backend,
        reference="infinite chain",
        outcome=row.outcome,
        sentence=f"Band edge {row.edge} by {row.backend} is {row.measured:.4g} Hz, that of the infinite chain"
        f" {row.theory:.4g} Hz; tolerance {100 * tolerance:g} %, resolution of the record {100 * row.bar:.2g} %.",
        difference=abs(row.off),
        scale=row.theory,
        unit="Hz",
        scale_name="edge of the infinite chain",
        uncertainty=row.bar,
        tolerance=tolerance,
    )


def _broken(result: Result) -> Verdict:
    case = result.case
    return Verdict(
        scene=case.scene.name,
        quantity="band edges",
        backend=case.backend,
        reference="infinite chain",
        outcome=Outcome.BROKEN,
        sentence=f"{case.backend} did not run: {result.failure}.",
    )


def _found(scene: Scene, cell: Cell, name: str, run: Trajectory, runs: dict[str, Trajectory]) -> Found:
    assert scene.drive is not None
    top = cell.edges[-1] / (2.0 * math.pi)
    lowest = BELOW * cell.edges[0] / (2.0 * math.pi)
    links = len(scene.stiffness)
    static = -scene.contacts.gap[:links]
    change = -np.diff(run.displacement, axis=1)
    other = runs.get(COMPARED[name][0])
    return Found(
        backend=name,
        bands=measured_bands(scene, run, lowest=lowest, highest=BEYOND * top),
        oscillation=float(np.max(np.abs(change) / static)),
        apart=math.nan if other is None else difference("velocity", run, other).value,
    )


def _excuse(scene: Scene, cell: Cell, item: Found, tolerance: float) -> str:
    """Why an edge that is off, or missing, says nothing of the code; "" where it does."""
    if item.oscillation > SMALL:
        return f"overlaps oscillate by {100 * item.oscillation:.2g} % of the static ones"
    if scene.dissipates:
        return "the chain is damped, and the theory's is not"
    finest, narrowest = item.bands.resolution, _narrowest(cell)
    if _unseen(cell, item):
        return f"the record resolves {finest:.3g} Hz, the narrowest band or gap is {narrowest:.3g} Hz wide"
    if len(item.bands.edges) == len(cell.edges):
        return ""
    if finest > tolerance * cell.edges[0] / (2.0 * math.pi):
        return f"the record resolves {finest:.3g} Hz, more than is asked of the lowest edge"
    if scene.drive is not None and scene.drive.shape == "table":
        return "nothing says that the table drives the chain at all edges"
    return ""


def _narrowest(cell: Cell) -> float:
    """Width of the narrowest band or gap, Hz."""
    return float(np.min(np.diff([0.0, *cell.edges]))) / (2.0 * math.pi)


def _unseen(cell: Cell, item: Found) -> bool:
    """Return whether a band or gap is narrower than the record resolves, so that its edges may be chance."""
    return RESOLVED * item.bands.resolution > _narrowest(cell)


def _undecided(rows: Sequence[_Row], excuses: dict[str, str]) -> Iterator[str]:
    for name, why in excuses.items():
        if why and any(row.backend == name and row.outcome is Outcome.UNDECIDED for row in rows):
            yield f"{name} is not judged by its edges: {why}."


def _rows(cell: Cell, item: Found, tolerance: float, *, excused: bool) -> Iterator[_Row]:
    """Edges in their order; where there are more or fewer than there should be none is known by name.

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
    scene: Scene, cell: Cell, matches: Sequence[Found], rows: Sequence[_Row], tolerance: float
) -> Iterator[str]:
    if not matches:
        yield f"No code could run {scene.name}."
        return
    edges = ", ".join(f"{1e-3 * edge / (2.0 * math.pi):.4g}" for edge in cell.edges)
    yield (
        f"The infinite chain with {scene.name}'s cell of {cell.bodies} {'body' if cell.bodies == 1 else 'bodies'} has"
        f" band edges at {edges} kHz."
    )
    known_values = [row for row in rows if math.isfinite(row.measured)]
    if known_values:
        worst = max(known_values, key=lambda row: abs(row.off))
        yield (
            f"Measured edges are off by at most {100 * abs(worst.off):.2g} % ({worst.backend}, edge {worst.edge}; the"
            f" record resolves {100 * max(row.bar for row in known_values):.2g} %; asked: {100 * tolerance:g} %)."
        )
    for first in matches:
        if len(first.bands.edges) != len(cell.edges):
            yield (
                f"{first.backend} shows {len(first.bands.edges)} edges where there should be {len(cell.edges)}: none is"
                " known by name."
            )
    for first in matches:
        other, isolated = COMPARED[first.backend]
        if math.isfinite(first.apart):
            yield f"{first.backend} differs from {other} by {first.apart:.1e} of the largest velocity: {isolated}."
    largest = max(result.oscillation for result in matches)
    small = "small, as the theory asks" if largest <= SMALL else "not small: edges move with its square"
    yield f"Overlaps oscillate by {100 * largest:.2g} % of the static ones: {small}."


def _edges(rows: Sequence[_Row], tolerance: float) -> Table:
    return Table(
        id="edges",
        title="Band edges",
        caption=(
            "Off: measured over theory, minus 1. Resolution: the inverse of the record's length. PASS: both together"
            f" are within {100 * tolerance:g} %."
        ),
        columns=("code", "edge", "infinite chain (kHz)", "measured (kHz)", "off (%)", "resolution (%)", "outcome"),
        rows=tuple(
            (
                row.backend,
                float(row.edge),
                1e-3 * row.theory,
                1e-3 * row.measured,
                100.0 * row.off,
                100.0 * row.bar,
                row.outcome.value,
            )
            for row in rows
        ),
    )


def _codes(matches: Sequence[Found]) -> Table:
    return Table(
        id="codes",
        title="The runs",
        caption="Difference: of velocities, the largest over all samples and bodies, relative to the largest velocity.",
        columns=("code", "compared with", "isolates", "difference", "oscillation of an overlap (%)"),
        rows=tuple(
            (result.backend, *COMPARED[result.backend], result.apart, 100.0 * result.oscillation) for result in matches
        ),
    )


def _figure(cell: Cell, matches: Sequence[Found]) -> FigureData:
    phases = np.linspace(0.0, math.pi, 101)
    branches = np.array([cell.frequencies(phase) for phase in phases.tolist()]) / (2e3 * math.pi)
    theory = tuple(
        Series(label="infinite chain", style="guide", x=phases / math.pi, y=branches[:, nth])
        for nth in range(cell.bodies)
    )
    edges = [edge / (2e3 * math.pi) for edge in cell.edges]
    ways = [(result, result.bands.phase / math.pi, 1e-3 * result.bands.frequency) for result in matches]
    levels = [20.0 * np.log10(result.bands.transmission) for result in matches]
    low, high = min(float(np.min(level)) for level in levels), max(float(np.max(level)) for level in levels)
    return FigureData(
        id="bands",
        title="Bands",
        caption=(
            "(a) Phase per unit cell that the runs show, over the dispersion relation of the infinite chain. (b) Speed"
            " of the last body over that of the first; the lines are the edges of the infinite chain's bands."
        ),
        panels=(
            Panel(
                title="(a) dispersion",
                x_label="phase per cell (π)",
                y_label="frequency (kHz)",
                series=(
                    *theory,
                    *(Series(label=way.backend, style=_DRAWN[way.backend], x=x, y=y) for way, x, y in ways),
                ),
            ),
            Panel(
                title="(b) transmission",
                x_label="frequency (kHz)",
                y_label="last over first body (dB)",
                series=(
                    *(
                        Series(label="band edges", style="guide", x=np.full(2, edge), y=np.array([low, high]))
                        for edge in edges
                    ),
                    *(
                        Series(
                            label=result.backend, style=_DRAWN[result.backend], x=1e-3 * result.bands.frequency, y=level
                        )
                        for result, level in zip(matches, levels, strict=True)
                    ),
                ),
            ),
        ),
    )
