"""The same scene through every way that the engine at hand has, each beside the twin at the same step.

Each way differs from the twin by round-off, and by nothing else unless it says so: the tolerance is what twins predict
for a code that keeps positions of bodies with the radii of this way's own deck. Bitwise equality is with the first way,
``pair_style granular`` on walls of frozen bodies, one rank, no suffix. A way that the scene or the engine does not have
is NOT_RUN, with the reason.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.lammps import LammpsGranular, LammpsTable, Written
from dem_bridge.backends.prescan import Prescan, prescan_hertz
from dem_bridge.backends.steps import DEFAULT_PHASE, default_step, fixed_step_plan
from dem_bridge.backends.tabled import in_kernel, tables_for
from dem_bridge.backends.twin import solve_plan
from dem_bridge.errors import BackendUnavailable, RunBroken, UnsupportedScene
from dem_bridge.foundation.progress import listening
from dem_bridge.lmp.deck import Deck
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.process import require
from dem_bridge.lmp.variants import (
    CLASSIC,
    flat_walls,
    frozen_walls,
    hertz_history,
    hertz_material,
    newton_off,
    with_restart,
)
from dem_bridge.observables.differences import Difference, difference
from dem_bridge.observables.verdict import Outcome, Verdict, judge_relative
from dem_bridge.report.columns import SECOND, Column
from dem_bridge.report.study import FigureData, Series, Study
from dem_bridge.report.texts import Texts
from dem_bridge.runs.campaign import Progress
from dem_bridge.runs.store import Store
from dem_bridge.runs.uncertainty.fixed_step import REALISATIONS, last_digit
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.recalled import recall_study
from dem_bridge.trajectory.relative import SMALLEST_SCALE, relative_size
from dem_bridge.trajectory.trajectory import QUANTITIES, Trajectory

TEXTS = Texts("styles", "dem_bridge.studies")
STYLES_COLUMNS = {
    "way": "variant", "differences.velocity.value": "velocity", "differences.displacement.value": "displacement",
    "differences.peak_force.value": "peak force", "differences.crossing_time.value": "crossing time",
    "largest_share": "largest / tolerance", "same_bits": "same bits", "wall": Column("wall", SECOND),
    "outcome": "outcome",
}  # fmt: skip
TOLERANCES_COLUMNS = {
    "way": "variant", "tolerances.velocity": "velocity", "tolerances.displacement": "displacement",
    "tolerances.peak_force": "peak force", "tolerances.crossing_time": "crossing time",
}  # fmt: skip
#: columns of the matrix
COLUMNS = QUANTITIES
#: step of all runs by default, as a part of 1/omega of the stiffest contact: about five times that of the backend. Its
#: error is the same in all runs, and round-off grows with the number of steps: on decelerating-40 the tolerances of
#: variants without tables are 0.12 to 0.42 times those at the step of the backend
PHASE = 5.0 * DEFAULT_PHASE
#: of the deck's radii, for realisations of round-off: other last digits, and hardly other sizes
RADIUS_FACTORS = (1.0, 1.125, 1.375)
#: smallest part of a tolerance that the figure shows
LEAST_SHOWN = 1e-3


@dataclass(frozen=True, kw_only=True)
class Base:
    """Starting point of all styles: the deck of ``pair_style granular``, and its writer."""

    scene: Scene
    backend: LammpsGranular
    resolution: Resolution
    prescan: Prescan
    deck: Deck
    twin: Trajectory
    """The twin in overlap variables on the deck's steps."""
    lammps: str
    """Version of LAMMPS."""
    _floors: dict[bytes, dict[str, float]] = field(default_factory=dict)

    def floor(self, deck: Deck) -> dict[str, float]:
        """Return the relative round-off of a code that keeps positions of bodies with the deck's radii, by quantity.

        It is the largest of several realisations, because a single one can be small by chance.
        """
        key = deck.radii.tobytes()
        if key not in self._floors:
            radius = deck.surrogate_radius if deck.encoded_radii is None else deck.encoded_radii
            runs = [self.change(solve_plan(self.scene, deck.schedule, factor * radius)) for factor in RADIUS_FACTORS]
            self._floors[key] = {name: max(change[name] for change in runs) for name in COLUMNS}
        return self._floors[key]

    def change(self, run: Trajectory) -> dict[str, float]:
        """Return the largest relative differences of a run from the twin, by quantity."""
        return {name: difference(name, run, self.twin).value for name in COLUMNS}

    def of(self, backend: LammpsGranular | None = None, **settings: Any) -> Deck:
        """Return the deck with other settings, or of another backend."""
        resolution, sampling = replace(self.resolution, **settings), Sampling(count=self.deck.schedule.samples)
        return (backend or self.backend).written(self.scene, resolution, sampling, self.prescan).deck

    def table_error(self, style: str) -> dict[str, float]:
        """Return the relative change that tables of this style make, by the twin that has them."""
        tables = tables_for(self.scene, replace(self.resolution, table_style=style), self.prescan)
        kernel = in_kernel(self.scene, tables, self.deck.surrogate_radius)
        return self.change(solve_plan(self.scene, self.deck.schedule, tables=kernel))

    def restart_error(self) -> dict[str, float]:
        """Return the permissible relative change by a restart: zero, unless forces depend on velocities.

        LAMMPS then begins again with forces at the full step's velocity, which is another run of the same first order.
        """
        if not self.scene.dissipates:
            return {}
        coarse = Sampling(count=self.deck.schedule.samples)
        twice = Resolution(dt=2.0 * self.deck.schedule.step)
        return self.change(solve_plan(self.scene, fixed_step_plan(self.scene, twice, coarse, self.prescan)))


@dataclass(frozen=True, kw_only=True)
class Way:
    """One way to run the scene. ``deck`` raises UnsupportedScene for what it cannot express."""

    name: str
    deck: Callable[[Base], Deck] = lambda base: base.deck
    arguments: tuple[str, ...] = ()
    """Of LAMMPS, beside those of the engine."""
    ranks: int | None = None
    """None: those of the engine."""
    style: str = "pair granular"
    """Of ``engine.STYLES``, without which there is no such way."""
    package: str = ""
    suffix: str = ""
    """What the pair style's name ends with, where it has such a variant."""
    changes: Callable[[Base], Mapping[str, float]] = lambda base: {}
    """What may differ apart from round-off, relative, by quantity."""


def _table(style: str) -> Way:
    return Way(
        name=f"table, {style}",
        deck=lambda base: base.of(LammpsTable(base.backend.engine), table_style=style),
        style="pair table",
        changes=lambda base: base.table_error(style),
    )


def _planes(**settings: Any) -> Callable[[Base], Deck]:
    return lambda base: flat_walls(base.deck, base.scene, **settings)


_OMP: dict[str, Any] = {"package": "OPENMP", "suffix": "omp", "arguments": ("-sf", "omp", "-pk", "omp", "2")}
_KOKKOS: dict[str, Any] = {"package": "KOKKOS", "suffix": "kk", "arguments": ("-k", "on", "-sf", "kk")}
_HISTORY: dict[str, Any] = {
    "deck": lambda base: hertz_history(base.deck, base.scene, base.prescan.peak_overlap),
    "style": "pair gran/hertz/history",
}
WAYS = (
    Way(name="granular"),
    Way(name="granular, types per body", deck=lambda base: base.of(types="per-body")),
    Way(name="granular, hertz/material", deck=lambda base: hertz_material(base.deck)),
    Way(name="granular, newton off", deck=lambda base: newton_off(base.deck)),
    Way(name="granular, restart halfway", deck=lambda base: with_restart(base.deck), changes=Base.restart_error),
    Way(name="granular, fix wall/gran", deck=_planes(), style="fix wall/gran"),
    Way(name="granular, fix wall/gran/region", deck=_planes(region=True), style="fix wall/gran/region"),
    *(
        Way(name=f"granular, fix wall/gran {style}", deck=_planes(style=style), style="fix wall/gran")
        for style in CLASSIC
    ),
    Way(name="granular, fix freeze", deck=lambda base: frozen_walls(base.deck, base.scene), style="fix freeze"),
    Way(name="granular, 2 ranks", ranks=2),
    Way(name="granular, opt", package="OPT", suffix="opt", arguments=("-sf", "opt")),
    Way(name="granular, omp", **_OMP),
    Way(name="granular, kk", **_KOKKOS),
    Way(name="gran/hertz/history", **_HISTORY),
    Way(name="gran/hertz/history, omp", **_OMP, **_HISTORY),
    _table("linear"),
    _table("spline"),
)


@dataclass(frozen=True, kw_only=True)
class Row:
    """One way and its differences from the twin; without numbers if it was not run."""

    way: str
    outcome: Outcome
    reason: str = ""
    """Why there are no numbers, or a remark on them."""
    differences: Mapping[str, Difference] = field(default_factory=dict)
    tolerances: Mapping[str, float] = field(default_factory=dict)
    """Relative, to the same scales as the differences."""
    bitwise: bool | None = None
    """Whether velocities, displacements and contact forces are those of the first way, bit for bit."""
    wall: float = math.nan
    """s, of LAMMPS alone."""

    @property
    def shares(self) -> dict[str, float]:
        """Differences as parts of their tolerances."""
        return {name: item.value / self.tolerances[name] for name, item in self.differences.items()}

    @property
    def largest_share(self) -> float:
        """Largest difference over its tolerance; nan without numbers."""
        return max(self.shares.values(), default=math.nan)

    @property
    def same_bits(self) -> str:
        """Return :attr:`bitwise` in a word."""
        return {None: "", True: "yes", False: "no"}[self.bitwise]

    @property
    def beyond(self) -> str:
        """The differences that exceed their tolerance, and where; '' if none does."""
        parts = []
        for name, item in self.differences.items():
            place = item.place + (f" at t = {1e3 * item.time:.4g} ms" if math.isfinite(item.time) else "")
            if not item.value <= self.tolerances[name]:
                parts.append(TEXTS("beyond", item=item, tolerance=self.tolerances[name], place=place))
        return "; ".join(parts)

    def verdict(self, scene: str) -> Verdict:
        """Return the verdict on the quantity whose difference is the largest part of its tolerance."""
        worst = max(self.shares, key=self.shares.__getitem__, default="")
        item = self.differences.get(worst)
        numbers = {} if item is None else {name: getattr(item, name) for name in ("scale", "unit", "scale_name")}
        if item is not None:
            numbers |= {"difference": item.value, "tolerance": self.tolerances[worst]}
        texts = {"quantity": worst or "all", "finding": self.beyond or self.reason or TEXTS("within")}
        return TEXTS.verdict("way", scene=scene, backend=self.way, outcome=self.outcome, **texts, **numbers)


def study_styles(
    scene: Scene,
    *,
    dt: float | None = None,
    time_limit: float = 3600.0,
    engine: Engine | None = None,
    progress: Progress | None = None,
    store: Store | None = None,
) -> Study:
    """Run a scene through every pair style, wall and suffix of LAMMPS and compare each with the twin.

    All runs have the same time step. A way that the scene or the LAMMPS at hand does not have is NOT_RUN.

    Parameters
    ----------
    scene : Scene
        Scene that ``pair_style granular`` can express.
    dt : float, optional
        Largest time step, s. None: about five times that of the backend.
    time_limit : float
        Longest wall time of one run, s.
    engine, progress, store : as in :func:`dem_bridge.study`

    Returns
    -------
    Study
        A verdict for each way; a run that breaks is BROKEN.

    Raises
    ------
    UnsupportedScene
        If ``pair_style granular`` cannot express the scene.
    BackendUnavailable
        If there is no LAMMPS.
    UsageError
        For a time step that cannot be.
    """
    engine = engine or Engine.chosen()

    def compared() -> Study:
        base = base_of(scene, dt=dt, engine=engine, time_limit=time_limit)
        return study_of(base, rows_of(base, WAYS, progress=progress))

    return recall_study("styles", store, compared, scene, engine, dt=dt, time_limit=time_limit)


def base_of(scene: Scene, *, dt: float | None, engine: Engine | None = None, time_limit: float = 3600.0) -> Base:
    """Return what every way starts from; raise as :func:`study_styles` does."""
    sampling, prescan, backend = Sampling(count=scene.samples), prescan_hertz(scene), LammpsGranular(engine)
    dt = default_step(scene, sampling, prescan, PHASE) if dt is None else dt
    resolution = Resolution(dt=dt, time_limit=time_limit)
    version = str(require(backend.engine, "pair granular").version)
    deck = backend.written(scene, resolution, sampling, prescan).deck
    twin = solve_plan(scene, deck.schedule)
    return Base(
        scene=scene, backend=backend, resolution=resolution, prescan=prescan, deck=deck, twin=twin, lammps=version
    )


def rows_of(base: Base, ways: Sequence[Way], *, progress: Progress | None = None) -> tuple[Row, ...]:
    """Run and compare each way; the first is the one that the others are compared with bit for bit."""
    rows: list[Row] = []
    first: Trajectory | None = None
    for done, way in enumerate(ways):

        def within(part: float, done: int = done, name: str = way.name) -> None:
            if progress is not None:
                progress(done + part, len(ways), f"{base.scene.name}: {name}")

        within(0.0)
        try:
            # the dump is not read while it grows unless the progress is shown
            with listening(within) if progress is not None else nullcontext():
                run, row = _row(way, base)
        except (UnsupportedScene, BackendUnavailable, RunBroken) as error:
            outcome = Outcome.BROKEN if isinstance(error, RunBroken) else Outcome.NOT_RUN
            run, row = None, Row(way=way.name, outcome=outcome, reason=str(error))
        if done == 0:
            first = run
        if run is not None and first is not None:
            row = replace(row, bitwise=_same_bits(run, first))
        rows.append(row)
    if progress is not None:
        progress(len(ways), len(ways), "")
    return tuple(rows)


def study_of(base: Base, rows: Sequence[Row]) -> Study:
    """Show the rows; nothing is run here."""
    scene, dt, ran = base.scene.name, base.deck.schedule.step, [row for row in rows if row.differences]
    alike = sum(bool(row.bitwise) for row in rows)
    answer = [TEXTS("count", count=len(rows), scene=scene, lammps=base.lammps, dt=dt, ran=len(ran), alike=alike)]
    if ran:
        share, name, way = max((share, name, row.way) for row in ran for name, share in row.shares.items())
        answer.append(TEXTS("worst", share=share, name=name.replace("_", " "), way=way))
    return TEXTS.study(
        {"scene": scene},
        answer=tuple(answer),
        tables=(TEXTS.table("styles", STYLES_COLUMNS, rows), TEXTS.table("tolerances", TOLERANCES_COLUMNS, ran)),
        figures=(_figure(scene, ran),) if ran else (),
        verdicts=tuple(row.verdict(scene) for row in rows),
        notes=(*TEXTS.notes(), *(f"{row.way}: {row.reason}." for row in ran if row.reason)),
        provenance={"scene": scene, "scene_hash": base.scene.content_hash, "dt": dt, "lammps": base.lammps},
    )


def _figure(scene: str, rows: Sequence[Row]) -> FigureData:
    places = np.arange(len(rows), dtype=float)
    series = [Series(label="tolerance", style="guide", x=np.ones(2), y=np.array([-0.5, len(rows) - 0.5]))]
    for nth, name in enumerate(COLUMNS, start=1):
        shares = np.array([max(row.shares[name], LEAST_SHOWN) for row in rows])
        series.append(Series(label=name.replace("_", " "), style=f"mark-{nth}", x=shares, y=places))
    panel = TEXTS.panel("shares", series, rows=tuple(row.way for row in rows), scene=scene)
    return TEXTS.figure("styles-differences", [panel], scene=scene, least=LEAST_SHOWN, columns=1)


def _row(way: Way, base: Base) -> tuple[Trajectory, Row]:
    engine = base.backend.engine
    engine = replace(engine, lmp_args=(*engine.lmp_args, *way.arguments), ranks=way.ranks or engine.ranks)
    result = require(engine, way.style)
    if way.package and way.package not in result.packages:
        raise BackendUnavailable(TEXTS("package", version=result.version, package=way.package))
    deck = way.deck(base)
    run = LammpsGranular(engine).run_written(base.scene, Written(deck=deck), time_limit=base.resolution.time_limit)
    differences = {name: difference(name, run, base.twin) for name in COLUMNS}
    tolerances = tolerances_of(base, deck, way.changes(base))
    outcomes = {
        judge_relative(differences[name].value, last_digit(deck.schedule), tolerances[name]) for name in COLUMNS
    }
    notes = [str(run.provenance["lammps"].get("note", ""))]
    style = str(run.provenance["pair_style"])
    if way.suffix and not style.endswith(f"/{way.suffix}"):
        notes.append(TEXTS("plain", style=style, suffix=way.suffix))
    return run, Row(
        way=way.name,
        outcome=next(item for item in (Outcome.FAIL, Outcome.UNDECIDED, Outcome.PASS) if item in outcomes),
        reason="; ".join(note for note in notes if note),
        differences=differences,
        tolerances=tolerances,
        wall=float(run.provenance["engine_wall"]),
    )


def tolerances_of(base: Base, deck: Deck, changes: Mapping[str, float]) -> dict[str, float]:
    """Return the permissible relative difference of a deck's run from the twin, by quantity.

    It is the round-off of a code that keeps positions of bodies with the deck's radii, and the further amount
    ``changes``.
    """
    plan, floor = deck.schedule, base.floor(deck)
    eps, digit = float(np.finfo(float).eps), last_digit(plan)
    # forces are running sums of net forces, and small ones are measured against a thousandth of the largest
    largest = float(np.max(base.twin.peak_force, initial=0.0))
    sums = 4.0 * largest + base.scene.summed_outer_force
    # equal increments of displacements round alike
    more = {"displacement": 0.5 * plan.steps * eps}
    more["peak_force"] = relative_size(eps * sums, SMALLEST_SCALE * largest)
    return {
        name: REALISATIONS * (floor[name] + digit) + more.get(name, 0.0) + changes.get(name, 0.0) for name in COLUMNS
    }


def _same_bits(run: Trajectory, other: Trajectory) -> bool:
    return all(
        getattr(run, name).tobytes() == getattr(other, name).tobytes()
        for name in ("velocity", "displacement", "contact_force")
    )
