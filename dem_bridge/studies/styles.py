"""The same scene through every way that the engine at hand has, each beside the twin at the same step.

Each way differs from the twin by round-off, and by nothing else unless it says so: the tolerance is what twins predict
for a code that keeps positions of bodies with the radii of this way's own deck. Bitwise equality is with the first way,
``pair_style granular`` on walls of frozen bodies, one rank, no suffix. A way that the scene or the engine does not have
is NOT_RUN, with the reason.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.lammps import LammpsGranular, LammpsTable, Written
from dem_bridge.backends.prescan import Prescan, prescan_hertz
from dem_bridge.backends.steps import fixed_step_plan
from dem_bridge.backends.tabled import in_kernel, tables_for
from dem_bridge.backends.twin import solve_plan
from dem_bridge.backends.twin_bars import REALISATIONS, last_digit
from dem_bridge.campaign import Progress
from dem_bridge.differences import Difference, difference
from dem_bridge.errors import BackendUnavailable, RunBroken, UnsupportedScene
from dem_bridge.lmp.deck import Deck
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.process import require
from dem_bridge.lmp.variants import flat_walls, hertz_history, newton_off, with_restart
from dem_bridge.progress import listening
from dem_bridge.scene import Scene
from dem_bridge.trajectory import QUANTITIES, SMALLEST_SCALE, Trajectory
from dem_bridge.verification.verdict import Outcome, exit_code, judge, plain

#: columns of the matrix
COLUMNS = QUANTITIES
#: of the deck's radii, for realisations of round-off: other last digits, and hardly other sizes
RADIUS_FACTORS = (1.0, 1.125, 1.375)


@dataclass(frozen=True, kw_only=True)
class Base:
    """What every way starts from: the deck of ``pair_style granular``, and what made it."""

    scene: Scene
    backend: LammpsGranular
    resolution: Resolution
    prescan: Prescan
    deck: Deck
    own: Trajectory
    """The twin in overlap variables on the deck's steps."""
    _floors: dict[bytes, dict[str, float]] = field(default_factory=dict)

    def floor(self, deck: Deck) -> dict[str, float]:
        """Round-off of a code that keeps positions of bodies with the deck's radii, relative, by quantity: the largest
        of some realisations, because one alone can be small by chance."""
        key = deck.radii.tobytes()
        if key not in self._floors:
            radius = deck.surrogate_radius if deck.encoded_radii is None else deck.encoded_radii
            runs = [solve_plan(self.scene, deck.schedule, factor * radius) for factor in RADIUS_FACTORS]
            self._floors[key] = {name: max(difference(name, run, self.own).value for run in runs) for name in COLUMNS}
        return self._floors[key]

    def of_types(self, types: str) -> Deck:
        return self._written(self.backend, replace(self.resolution, types=types))

    def of_tables(self, style: str) -> Deck:
        return self._written(LammpsTable(self.backend.engine), replace(self.resolution, table_style=style))

    def _written(self, backend: LammpsGranular, resolution: Resolution) -> Deck:
        sampling = Sampling(count=self.deck.schedule.samples)
        return backend.written(self.scene, resolution, sampling, self.prescan).deck

    def table_error(self, style: str) -> dict[str, float]:
        """What such tables change, relative, by the twin that has them."""
        tables = tables_for(self.scene, replace(self.resolution, table_style=style), self.prescan)
        kernel = in_kernel(self.scene, tables, self.deck.surrogate_radius)
        run = solve_plan(self.scene, self.deck.schedule, tables=kernel)
        return {name: difference(name, run, self.own).value for name in COLUMNS}

    def restart_error(self) -> dict[str, float]:
        """What a cut in two may change, relative: nothing but where forces depend on velocities. LAMMPS then begins
        again with those of the full step's velocity, which is another run of the same first order."""
        if not self.scene.dissipates:
            return {}
        coarse = Sampling(count=self.deck.schedule.samples)
        twice = Resolution(dt=2.0 * self.deck.schedule.step)
        other = solve_plan(self.scene, fixed_step_plan(self.scene, twice, coarse, self.prescan))
        return {name: difference(name, other, self.own).value for name in COLUMNS}


@dataclass(frozen=True, kw_only=True)
class Way:
    """One way to run the scene. ``deck`` raises UnsupportedScene for what it cannot express."""

    name: str
    deck: Callable[[Base], Deck] = lambda base: base.deck
    engine: Callable[[Engine], Engine] = lambda engine: engine
    style: str = "pair granular"
    """Of ``engine.STYLES``, without which there is no such way."""
    package: str = ""
    suffix: str = ""
    """What the pair style's name ends with, where it has such a variant."""
    beside: Callable[[Base], Mapping[str, float]] = lambda base: {}
    """What may differ beside round-off, relative, by quantity."""


def _suffixed(suffix: str, package: str, arguments: tuple[str, ...], **more: Any) -> Way:
    def engine(engine: Engine) -> Engine:
        return replace(engine, lmp_args=(*engine.lmp_args, *arguments))

    return Way(engine=engine, package=package, suffix=suffix, **{"name": f"granular, {suffix}", **more})


def _history(base: Base) -> Deck:
    return hertz_history(base.deck, base.scene, base.prescan.peak_overlap)


def _table(style: str) -> Way:
    return Way(
        name=f"table, {style}",
        deck=lambda base: base.of_tables(style),
        style="pair table",
        beside=lambda base: base.table_error(style),
    )


_OMP = ("-sf", "omp", "-pk", "omp", "2")
_HISTORY: dict[str, Any] = {"deck": _history, "style": "pair gran/hertz/history"}
WAYS = (
    Way(name="granular"),
    Way(name="granular, types per body", deck=lambda base: base.of_types("per-body")),
    Way(name="granular, newton off", deck=lambda base: newton_off(base.deck)),
    Way(
        name="granular, restart halfway",
        deck=lambda base: with_restart(base.deck),
        beside=lambda base: base.restart_error(),
    ),
    Way(name="granular, fix wall/gran", deck=lambda base: flat_walls(base.deck, base.scene), style="fix wall/gran"),
    Way(name="granular, 2 ranks", engine=lambda engine: replace(engine, ranks=2)),
    _suffixed("opt", "OPT", ("-sf", "opt")),
    _suffixed("omp", "OPENMP", _OMP),
    _suffixed("kk", "KOKKOS", ("-k", "on", "-sf", "kk")),
    Way(name="gran/hertz/history", **_HISTORY),
    _suffixed("omp", "OPENMP", _OMP, name="gran/hertz/history, omp", **_HISTORY),
    _table("linear"),
    _table("spline"),
)


@dataclass(frozen=True, kw_only=True)
class Row:
    """One way and what it differs by from the twin; without numbers where it was not run."""

    way: str
    outcome: Outcome
    reason: str = ""
    """Why there are no numbers, or what should be known of them."""
    differences: Mapping[str, Difference] = field(default_factory=dict)
    tolerances: Mapping[str, float] = field(default_factory=dict)
    """Relative, to the same scales as the differences."""
    bitwise: bool | None = None
    """Whether velocities, displacements and contact forces are those of the first way, bit for bit."""
    wall: float = math.nan
    """s, of LAMMPS alone."""

    @property
    def beyond(self) -> str:
        """Which differences are not within their tolerance, and where; '' if all are."""
        found = [(one, self.tolerances[name]) for name, one in self.differences.items()]
        return "; ".join(
            f"{one.quantity} differs by {one.value:.2e} of {one.scale_name}, tolerance {tolerance:.1e}"
            f" ({'body' if math.isfinite(one.time) else 'contact'} {one.body}"
            + (f" at t = {1e3 * one.time:.4g} ms)" if math.isfinite(one.time) else ")")
            for one, tolerance in found
            if not one.value <= tolerance
        )

    def as_json(self) -> dict[str, Any]:
        """JSON-able; differences and tolerances by quantity."""
        return {
            "way": self.way,
            "outcome": self.outcome.value,
            "reason": self.reason,
            "bitwise_equal_to_granular": self.bitwise,
            "difference": {name: plain(one.value) for name, one in self.differences.items()},
            "tolerance": {name: plain(one) for name, one in self.tolerances.items()},
            "engine_wall_s": plain(self.wall),
        }


@dataclass(frozen=True, kw_only=True)
class StylesStudy:
    """Result of :func:`study_styles`."""

    scene: Scene
    dt: float
    """s: the step of all."""
    rows: tuple[Row, ...]
    lammps: str
    """Version of the engine."""

    @property
    def exit_code(self) -> int:
        return exit_code(row.outcome for row in self.rows)

    def as_json(self) -> dict[str, Any]:
        """JSON-able."""
        return {
            "scene": self.scene.name,
            "scene_hash": self.scene.content_hash,
            "dt": self.dt,
            "lammps": self.lammps,
            "reference": "verlet, the twin in overlap variables at the same step",
            "ways": [row.as_json() for row in self.rows],
        }

    def as_csv(self) -> str:
        """One line for each way; empty where there is no number."""
        text = io.StringIO()
        lines = csv.writer(text, lineterminator="\n")
        both = [f"{name}_{what}" for name in COLUMNS for what in ("difference", "tolerance")]
        lines.writerow(["way", "outcome", "bitwise_equal_to_granular", *both, "engine_wall_s", "reason"])
        for row in self.rows:
            numbers = [
                repr(number) if row.differences else ""
                for name in COLUMNS
                for number in ((row.differences[name].value, row.tolerances[name]) if row.differences else ("", ""))
            ]
            bits = "" if row.bitwise is None else "yes" if row.bitwise else "no"
            wall = f"{row.wall:.4g}" if math.isfinite(row.wall) else ""
            lines.writerow([row.way, row.outcome.value, bits, *numbers, wall, row.reason])
        return text.getvalue()


def study_styles(
    scene: Scene,
    *,
    dt: float | None = None,
    engine: Engine | None = None,
    ways: Sequence[Way] = WAYS,
    time_limit: float = 3600.0,
    progress: Progress | None = None,
) -> StylesStudy:
    """Run and judge; the first of ``ways`` is what the others are compared with bit for bit.

    ``dt`` (s): None for the backend's own. ``time_limit`` (s): of each run. ``progress`` is called with (done, total,
    way). Raises UnsupportedScene where ``pair_style granular`` cannot express the scene, BackendUnavailable where there
    is no LAMMPS, UsageError for a step that cannot be.
    """
    resolution = Resolution(dt=dt, time_limit=time_limit, bars=False)
    prescan, backend = prescan_hertz(scene), LammpsGranular(engine)
    found = require(backend.engine, "pair granular")
    deck = backend.written(scene, resolution, Sampling(count=scene.samples), prescan).deck
    own = solve_plan(scene, deck.schedule)
    base = Base(scene=scene, backend=backend, resolution=resolution, prescan=prescan, deck=deck, own=own)
    rows: list[Row] = []
    first: Trajectory | None = None
    for done, way in enumerate(ways):

        def within(part: float, done: int = done, name: str = way.name) -> None:
            if progress is not None:
                progress(done + part, len(ways), f"{scene.name}: {name}")

        within(0.0)
        try:
            # with nobody to be told, nobody looks at the dump while it grows
            with listening(within) if progress is not None else nullcontext():
                run, row = _row(way, base)
        except (UnsupportedScene, BackendUnavailable) as error:
            run, row = None, Row(way=way.name, outcome=Outcome.NOT_RUN, reason=str(error))
        except RunBroken as error:
            run, row = None, Row(way=way.name, outcome=Outcome.BROKEN, reason=str(error))
        if done == 0:
            first = run
        if run is not None and first is not None:
            row = replace(row, bitwise=_same_bits(run, first))
        rows.append(row)
    if progress is not None:
        progress(len(ways), len(ways), "")
    return StylesStudy(scene=scene, dt=deck.schedule.step, rows=tuple(rows), lammps=str(found.version))


def _row(way: Way, base: Base) -> tuple[Trajectory, Row]:
    engine = way.engine(base.backend.engine)
    found = require(engine, way.style)
    if way.package and way.package not in found.packages:
        raise BackendUnavailable(f"LAMMPS {found.version} has no {way.package} package")
    deck = way.deck(base)
    run = LammpsGranular(engine).run_written(base.scene, Written(deck=deck), time_limit=base.resolution.time_limit)
    differences = {name: difference(name, run, base.own) for name in COLUMNS}
    tolerances = tolerances_of(base, deck, way.beside(base))
    outcomes = {judge(differences[name].value, last_digit(deck.schedule), tolerances[name]) for name in COLUMNS}
    notes = [str(run.provenance["lammps"].get("note", ""))]
    style = str(run.provenance["pair_style"])
    if way.suffix and not style.endswith(f"/{way.suffix}"):
        notes.append(f"pair_style {style} has no variant with /{way.suffix}: the plain one ran")
    return run, Row(
        way=way.name,
        outcome=next(one for one in (Outcome.FAIL, Outcome.UNDECIDED, Outcome.PASS) if one in outcomes),
        reason="; ".join(note for note in notes if note),
        differences=differences,
        tolerances=tolerances,
        wall=float(run.provenance["engine_wall"]),
    )


def tolerances_of(base: Base, deck: Deck, beside: Mapping[str, float]) -> dict[str, float]:
    """What a deck's run may differ by from the twin, relative, by quantity: the round-off of a code that keeps
    positions of bodies with its radii, and what is allowed ``beside``."""
    plan, own, floor = deck.schedule, base.own, base.floor(deck)
    eps, digit = float(np.finfo(float).eps), last_digit(plan)
    # forces are running sums of net forces, and small ones are measured against a thousandth of the largest
    largest = float(np.max(own.peak_force, initial=0.0))
    sums = 4.0 * largest + base.scene.summed_outer_force
    more = {
        # equal increments round alike
        "displacement": 0.5 * plan.steps * eps,
        "peak_force": eps * sums / (SMALLEST_SCALE * largest) if largest > 0.0 else 0.0,
    }
    return {
        name: REALISATIONS * (floor[name] + digit) + more.get(name, 0.0) + beside.get(name, 0.0) for name in COLUMNS
    }


def _same_bits(run: Trajectory, other: Trajectory) -> bool:
    return all(
        getattr(run, name).tobytes() == getattr(other, name).tobytes()
        for name in ("velocity", "displacement", "contact_force")
    )


__all__ = ["COLUMNS", "WAYS", "Base", "Row", "StylesStudy", "Way", "study_styles", "tolerances_of"]
