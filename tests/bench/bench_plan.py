"""Compare plans with the cheapest settings of a grid, on random scenes at three accuracies, with LAMMPS and without.

``make bench`` runs this on 10 scenes, one of each kind, ``python -m tests.bench.bench_plan 0 60`` on 60. For each plan
the run is made: its error is that against the reference, its CPU is set beside the cheapest setting that a grid finds:
every in-house code, fixed steps a factor 1.3 apart, the three coarsest that serve, scipy with its rtol by decades.
LAMMPS is set beside LAMMPS at the coarsest step that serves, and not planned where no step of the grid does. CPU is the
least of three to fifteen runs, of one where it is long, those of plan and grid in turn. The grid leaves out what costs
more than twice the cheapest setting so far.

A setting is an answer only if finer ones serve, too: at 40 settings, from that of the free choice down to a quarter of
it, all errors must be within the accuracy.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

import dem_bridge as db
from dem_bridge.backends.base import supports_of
from dem_bridge.backends.reference import SERIES
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.backends.surrogate_radius import radius_after
from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.runs.planning.answer import Plan
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory
from tests.helpers.finer_settings import largest_error
from tests.helpers.random_plans import planned_scene

#: random scenes of ``make bench``; a second argument on the command line asks for more
COUNT = 10
ACCURACIES = (1e-2, 1e-4, 1e-6)
FACTOR = 1.3
#: fixed steps of the grid, at most: what takes more is not the cheapest
MOST_STEPS = 5_000_000
#: repeats of a run whose CPU is looked at, and seconds of CPU after which it is not repeated
REPEATS, LONG = 3, 2.0
LAMMPS = "lammps-granular"


@dataclass(frozen=True)
class Row:
    """One plan beside the grid."""

    seed: int
    accuracy: float
    asked: str
    backend: str = ""
    settings: str = ""
    error: float = math.nan
    predicted: float = math.nan
    cost: float = math.nan
    best: str = ""
    best_cost: float = math.nan
    refused: str = ""
    largest: float = math.nan
    """Largest error at the settings of the plan and at finer ones; nan: not measured."""

    @property
    def met(self) -> bool:
        return self.error <= self.accuracy

    @property
    def holds(self) -> bool:
        return not self.largest > self.accuracy

    @property
    def ratio(self) -> float:
        return self.cost / self.best_cost


class Bench:
    """A scene, its truth, and the errors and costs of runs."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        # where the series do not fit the answer is scipy's, at the least tolerance
        self.truth = db.solve(scene, backend="reference", uncertainty=SERIES.covers(scene))
        self.scale = float(np.abs(self.truth.velocity).max())
        self.prescan = prescan_scene(scene)
        self._errors: dict[tuple[object, ...], float] = {}

    @property
    def bar(self) -> float:
        return float(self.truth.uncertainty["velocity"]) / self.scale

    def error(self, run: Trajectory) -> float:
        return float(np.abs(run.velocity - self.truth.velocity).max()) / self.scale

    def run(self, name: str, **settings: Any) -> Trajectory:
        return db.solve(self.scene, backend=name, uncertainty=False, **settings)

    def cost(self, name: str, **settings: object) -> float:
        return min(self.run(name, **settings).cost.cpu for _ in range(REPEATS))

    def coarsest(
        self, name: str, accuracy: float, most: Callable[[], float] = lambda: math.inf, **settings: object
    ) -> Iterator[float]:
        """Steps of a grid that serve, from the coarsest on; a few, for costs need not fall with the step.

        The grid ends where a run costs more than ``most`` returns, s of CPU.
        """
        interval, served = self.scene.duration / self.scene.samples, 0
        dt = min(interval, 3.0 / self.prescan.frequency if self.prescan.frequency > 0.0 else interval)
        while self.scene.duration / dt < MOST_STEPS and served < 3:
            steps = max(1, math.ceil(interval / dt * (1.0 - 1e-12)))
            key = (name, interval / steps, *settings)
            if key not in self._errors:
                try:
                    run = self.run(name, dt=dt, **settings)
                    if run.cost.cpu > most():
                        return
                    self._errors[key] = self.error(run)
                except RunBroken:
                    self._errors[key] = math.inf
            if self._errors[key] <= accuracy:
                served += 1
                yield interval / steps
            dt = interval / steps / FACTOR

    def cheapest(self, accuracy: float) -> tuple[str, dict[str, float]] | None:
        """Of all in-house codes, with its settings."""
        found: list[tuple[float, str, dict[str, float]]] = []

        def most() -> float:
            return 2.0 * min((cost for cost, *_ in found), default=math.inf)

        if self.bar <= accuracy and SERIES.covers(self.scene):
            found.append((self.cost("reference"), "reference", {}))
        for rtol in (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10):
            run = self.run("scipy", rtol=rtol)
            if run.cost.cpu > most():
                break
            if self.error(run) <= accuracy:
                found.append((self.cost("scipy", rtol=rtol), "scipy", {"rtol": rtol}))
                break
        for name in ("verlet", "blanes-moan"):
            if supports_of(name).covers(self.scene):
                for dt in self.coarsest(name, accuracy, most):
                    found.append((self.cost(name, dt=dt), name, {"dt": dt}))
        return min(found, key=lambda one: one[0])[1:] if found else None


def rows(seed: int, accuracies: Sequence[float] = ACCURACIES) -> Iterator[Row]:
    """Yield all plans of one scene."""
    bench = Bench(planned_scene(seed))
    for accuracy in accuracies:
        yield _free(seed, bench, accuracy)
        if supports_of(LAMMPS).covers(bench.scene):
            yield _of_lammps(seed, bench, accuracy)


def _free(seed: int, bench: Bench, accuracy: float) -> Row:
    best = bench.cheapest(accuracy)
    row = {"seed": seed, "accuracy": accuracy, "asked": "free", "best": str(best or "")}
    try:
        plan = db.plan(bench.scene, accuracy)
    except UsageError as error:
        return Row(**row, refused=str(error))  # type: ignore[arg-type]
    ours, theirs = _in_turn(bench, (plan.backend, plan.resolution), best)
    row["largest"] = largest_error(bench.scene, plan, bench.truth)
    return _row(row, plan, bench, ours, theirs)


def _row(row: dict[str, object], plan: Plan, bench: Bench, ours: list[Trajectory], theirs: list[Trajectory]) -> Row:
    return Row(
        **row,  # type: ignore[arg-type]
        backend=plan.backend,
        settings=str(dict(plan.resolution)),
        error=bench.error(ours[0]),
        predicted=plan.predicted_error,
        cost=min(run.cost.cpu for run in ours),
        best_cost=min((run.cost.cpu for run in theirs), default=math.nan),
    )


def _in_turn(
    bench: Bench, ours: tuple[str, Mapping[str, float]], theirs: tuple[str, Mapping[str, float]] | None
) -> tuple[list[Trajectory], list[Trajectory]]:
    """Runs of both, one after the other: the cheapest of a grid was found so by luck, too, and is looked at again."""
    runs: tuple[list[Trajectory], list[Trajectory]] = ([], [])
    spent = 0.0
    # starting an engine takes longer than it counts
    most = REPEATS if ours[0] == LAMMPS else 5 * REPEATS
    while len(runs[0]) < (REPEATS if spent < LONG else 1) or (len(runs[0]) < most and spent < 0.5):
        for found, asked in zip(runs, (ours, theirs), strict=True):
            if asked is not None:
                found.append(bench.run(asked[0], **asked[1]))
        spent += runs[0][-1].cost.cpu
    return runs


def _of_lammps(seed: int, bench: Bench, accuracy: float) -> Row:
    # the grid is that of the twin in positions, which LAMMPS repeats; its CPU is LAMMPS' own
    best = max(bench.coarsest("verlet", accuracy, surrogate_radius=radius_after(bench.prescan)), default=math.nan)
    row = {"seed": seed, "accuracy": accuracy, "asked": LAMMPS, "best": f"{best:.3g}"}
    if math.isnan(best):
        return Row(**row, refused=f"no step of the grid down to {MOST_STEPS:,} steps serves")  # type: ignore[arg-type]
    try:
        plan = db.plan(bench.scene, accuracy, LAMMPS)
    except UsageError as error:
        return Row(**row, refused=str(error))  # type: ignore[arg-type]
    ours, theirs = _in_turn(bench, (LAMMPS, plan.resolution), (LAMMPS, {"dt": best}))
    return _row(row, plan, bench, ours, theirs)


def main(*, tiny: bool = False, first: int = 0, count: int = COUNT) -> int:
    """Print the rows that miss and a table; 1 where the share met, finer settings or costs are not good enough.

    ``first`` and ``count`` choose the random scenes; ``tiny`` takes one scene at one accuracy.
    """
    accuracies: Sequence[float] = ACCURACIES
    if tiny:
        count, accuracies = 1, ACCURACIES[:1]
    console, plans = Console(width=150), []
    for seed in track(range(first, first + count), "plans", transient=True):
        for row in rows(seed, accuracies):
            plans.append(row)
            if not row.met or not row.holds or row.ratio > 2.0:
                console.print(row, soft_wrap=True)
    table = Table(
        "asked",
        "accuracy",
        "plans",
        "refused",
        "met",
        "finer settings, too",
        "cost / cheapest: median",
        "95 %",
        "largest",
    )
    failed = 0
    for asked in ("free", LAMMPS):
        for accuracy in accuracies:
            of = [row for row in plans if row.asked == asked and row.accuracy == accuracy]
            planned = [row for row in of if not row.refused]
            # what the grid cannot have either is refused rightly
            wrong = [row for row in of if row.refused and row.best not in ("", "nan")]
            met = sum(row.met for row in planned)
            ratio = np.array([row.ratio for row in planned if not math.isnan(row.ratio)] or [math.nan])
            held = sum(row.holds for row in planned)
            good = (
                held == len(planned)
                and met >= 0.95 * (len(planned) + len(wrong))
                and np.median(ratio) <= 1.3
                and ratio.max() <= 2.0
            )
            failed += not good
            table.add_row(
                asked, f"{accuracy:g}", str(len(planned)), f"{len(of) - len(planned)} ({len(wrong)} wrongly)",
                f"{met}", f"{held}" if asked == "free" else "-",
                f"{np.median(ratio):.2f}", f"{np.quantile(ratio, 0.95):.2f}", f"{ratio.max():.2f}",
            )  # fmt: skip
    console.print(table)
    return 1 if failed else 0


if __name__ == "__main__":
    words = sys.argv[1:]
    sys.exit(main(first=int(words[0]) if words else 0, count=int(words[1]) if len(words) > 1 else COUNT))
