"""Study of the energy over many contacts: velocity-Verlet, a method of order 4 and ode45, with predicted errors.

Beads between two walls collide without end. Symplectic methods conserve a modified energy between touches, and each
touch adds a jump of known size and random phase (:mod:`.touch_error`): the energy makes a random walk.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling, backend
from dem_bridge.observables.verdict import Verdict, judge
from dem_bridge.report.columns import PERCENT, SECOND, Column
from dem_bridge.report.study import FigureData, Series, Study, check_setting
from dem_bridge.report.texts import Texts
from dem_bridge.runs.campaign import Jobs, Progress, map_in_threads
from dem_bridge.runs.recall import recall
from dem_bridge.runs.store import Store
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.energy_walk import (
    BEAD,
    BOX,
    METHODS,
    Walk,
    energy_of,
    long_run,
    overlap_of,
    read_touches,
    second_term,
)
from dem_bridge.trajectory.trajectory import Floats

TEXTS = Texts("energy", "dem_bridge.studies")
WALKS_COLUMNS = (
    "run", "scene", Column("step", SECOND), "force evaluations per contact", "contacts",
    "change by a contact, predicted", "change by a contact, measured", Column("unexplained", PERCENT), "growth",
    "expected error at the end", "error at the end", "sum of the predicted jumps",
)  # fmt: skip
#: s: some fifty steps in a contact; the method of order 4 evaluates six forces in its step, and gets the same number
STEP = 1e-6
#: s: time of a contact. The jumps neglect terms of relative size (step / contact time), because other contacts
#: accelerate the bodies at touch; a verdict allows twice that
CONTACT, ALLOWED = 5e-5, 2.0
#: contacts of the further runs, and those from which the drift of ode45 is extrapolated, as parts of all
FURTHER, FIRST = 0.1, 0.1
#: samples of the panels within a contact and of the walk
WITHIN, SHOWN = 160, 400


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """One method with its settings on one scene, and its walk."""

    label: str
    scene: Scene
    code: str
    resolution: Resolution
    share: float = 1.0
    """Contacts, as a part of those of the study."""
    walk: Walk | None = None

    @property
    def of(self) -> Walk:
        """The walk, once the run is made."""
        assert self.walk is not None
        return self.walk

    @property
    def count(self) -> int:
        """Contacts of the whole run."""
        return int(self.of.contacts[-1])

    @property
    def drift(self) -> float:
        """Change of the relative energy per contact, over the first tenth of the run."""
        last = max(1, int(FIRST * (len(self.of.contacts) - 1)))
        return float(self.of.error[last] / self.of.contacts[last])

    @property
    def end(self) -> float:
        """Relative energy error at the end."""
        return float(self.of.error[-1])

    @property
    def expected(self) -> float:
        """Expected size of the error at the end: sqrt(N) jumps of a walk, or N times the drift."""
        return self.of.jump * math.sqrt(self.count) if self.code in METHODS else abs(self.drift) * self.count

    @property
    def slope(self) -> float:
        """Power of the number of contacts by which the error grows, fitted to all but the two longest windows."""
        windows, rms = self.of.windows()[:-2], self.of.rms()[:-2]
        return float(np.polyfit(np.log(windows), np.log(rms), 1)[0]) if len(windows) > 2 else math.nan


def runs_of() -> tuple[Run, ...]:
    """Return the runs of the study, the main ones first."""
    verlet = Run(label="velocity-Verlet", scene=BOX, code="verlet", resolution=Resolution(dt=STEP))
    order_4 = Run(label="blanes-moan", scene=BOX, code="blanes-moan", resolution=Resolution(dt=6 * STEP))
    ode45 = [
        Run(
            label=f"ode45, rtol {rtol:g}",
            scene=BOX,
            code="ode45",
            resolution=Resolution(rtol=rtol, atol=1e-3 * rtol),
            share=share,
        )
        for rtol, share in ((1e-3, 1.0), (1e-6, 1.0), (1e-8, FURTHER))
    ]
    return (
        verlet,
        order_4,
        *ode45,
        replace(verlet, label="velocity-Verlet, half step", resolution=Resolution(dt=0.5 * STEP), share=FURTHER),
        replace(order_4, label="blanes-moan, half step", resolution=Resolution(dt=3 * STEP), share=FURTHER),
        replace(verlet, label="velocity-Verlet, one bead", scene=BEAD, share=FURTHER),
    )


def study_energy(
    *,
    contacts: int = 1_000_000,
    jobs: Jobs = None,
    progress: Progress | None = None,
    store: Store | None = None,
) -> Study:
    """Measure the energy error over many contacts against its prediction by backward error analysis.

    Three beads between two walls are run by velocity-Verlet, by the method of order 4 at the same number of force
    evaluations, and by ode45 at three tolerances; one bead is run by velocity-Verlet.

    Parameters
    ----------
    contacts : int
        Number of contacts of each main run; the further runs, and ode45 with rtol 1e-8, have a tenth.
    jobs, progress, store : as in :func:`dem_bridge.study`

    Returns
    -------
    Study

    Raises
    ------
    UsageError
        If the number of contacts is out of its range.
    """
    check_setting("contacts", contacts, "a whole number from 1000 to 10000000", least=1000, most=10_000_000)
    todo = runs_of()
    done = dict.fromkeys((run.label for run in todo), 0.0)

    def made(run: Run) -> Run:
        def tell(part: float) -> None:
            done[run.label] = part * run.share
            if progress is not None:
                progress(sum(done.values()), math.ceil(sum(item.share for item in todo)), run.label)

        count = int(run.share * contacts)
        solve = lambda: long_run(backend(run.code), run.scene, run.resolution, count, tell)  # noqa: E731
        how: dict[str, Any] = {"backend": run.code, "resolution": vars(run.resolution), "contacts": count}
        return replace(run, walk=recall(store, "energy: walk", [], solve, kinds=[Walk], scenes=[run.scene], **how))

    runs = map_in_threads(made, todo, jobs)
    times, measured, predicted = recall(store, "energy: within a contact", [], within_contact, scenes=[BOX])
    return TEXTS.study(
        {"step": STEP, "contact": CONTACT, "allowed": ALLOWED},
        answer=tuple(_answer(runs, measured, predicted)),
        tables=(TEXTS.table("walks", WALKS_COLUMNS, map(_row, runs)),),
        figures=(_figure(runs, times, measured, predicted),),
        verdicts=tuple(map(_verdict, (run for run in runs if run.code in METHODS))),
        provenance={"contacts": contacts, "scenes": {run.scene.name: run.scene.content_hash for run in runs}},
    )


def within_contact(scene: Scene = BOX, step: float = STEP, rows: int = WITHIN) -> tuple[Floats, Floats, Floats]:
    """Return times (s) of the first steps of velocity-Verlet with the relative energy errors, measured and predicted.

    Predicted are ``-h^2 H_2`` and the jumps of the touches until then.
    """
    run = backend("verlet").run(replace(scene, duration=rows * step), Resolution(dt=step), Sampling(count=rows))
    overlap = overlap_of(scene, run.displacement)
    energy = energy_of(scene, run.velocity, overlap)
    jumps = np.cumsum(read_touches(scene, run.velocity, overlap, step, METHODS["verlet"])[1])
    predicted = (jumps - step**2 * second_term(scene, run.velocity, overlap)) / energy[0]
    return run.time, energy / energy[0] - 1.0, predicted


def _row(run: Run) -> tuple[str | float, ...]:
    split = run.code in METHODS
    return (
        run.label,
        run.scene.name,
        run.resolution.dt or math.nan,
        run.of.evaluations,
        float(run.count),
        run.of.jump,
        float(run.of.rms()[0]),
        run.of.unexplained if split else math.nan,
        run.slope,
        run.expected,
        run.end,
        float(run.of.predicted[-1]) if split else math.nan,
    )


def _verdict(run: Run) -> Verdict:
    """Judge whether the predicted jumps explain the changes of energy."""
    part, tolerance = run.of.unexplained, ALLOWED * (run.resolution.dt or math.nan) / CONTACT
    names = {"scene": run.scene.name, "backend": run.code, "label": run.label}
    numbers = {"difference": part, "scale": float(run.of.rms()[0]), "tolerance": tolerance}
    return TEXTS.verdict("jumps", **names, **numbers, outcome=judge(part, 0.0, tolerance))


def _answer(runs: Sequence[Run], measured: Floats, predicted: Floats) -> Iterator[str]:
    verlet, order_4, _, ode45, tight, half, _, bead = runs
    numbers: Mapping[str, Any] = {"verlet": verlet, "order_4": order_4, "ode45": ode45, "tight": tight, "bead": bead}
    yield TEXTS("walk", **numbers, rms=float(verlet.of.rms()[0]), at_end=abs(verlet.end))
    yield TEXTS("others", **numbers, ratio=order_4.of.jump / verlet.of.jump)
    yield TEXTS("law", power=math.log2(float(verlet.of.rms()[0] / half.of.rms()[0])), largest=_largest(bead), bead=bead)
    yield TEXTS("within", measured=float(np.max(np.abs(measured))), rest=float(np.max(np.abs(measured - predicted))))


def _largest(run: Run) -> float:
    return float(np.max(np.abs(run.of.error)))


def _figure(runs: Sequence[Run], times: Floats, measured: Floats, predicted: Floats) -> FigureData:
    verlet, order_4, _, ode45, tight, half, _, bead = runs
    first = [_series(run, f"mark-{k}", whole=True) for k, run in enumerate((verlet, order_4, ode45, tight), 1)]
    second = [_series(verlet, "mark-1"), _series(half, "mark-5"), _series(bead, "mark/scipy")]
    lines = [_line(run, "guide" if run.code in METHODS else "other") for run in (verlet, order_4, ode45, tight)]
    walk, every = verlet.of, slice(None, None, max(1, len(verlet.of.contacts) // SHOWN))
    panels = (
        TEXTS.panel("growth", (*lines, *first), log=True, tall=True),
        TEXTS.panel("further", (_line(verlet, "guide"), _line(half, "guide"), *second), log=True, tall=True),
        TEXTS.panel("walk", _pair(np.asarray(1e-3 * walk.contacts[every]), walk.error[every], walk.predicted[every])),
        TEXTS.panel("within", _pair(1e6 * times, measured, predicted)),
    )
    return TEXTS.figure("energy-growth", panels)


def _pair(x: Floats, measured: Floats, predicted: Floats) -> tuple[Series, Series]:
    """Return measured and predicted energy errors, in thousandths."""
    return (
        Series(label="measured", style="black line", x=x, y=1e3 * measured),
        Series(label="predicted", style="fit", x=x, y=1e3 * predicted),
    )


def _series(run: Run, style: str, *, whole: bool = False) -> Series:
    """Return the error over windows and, if wanted, the one of the whole run."""
    x, y = run.of.windows().astype(float), run.of.rms()
    if whole:
        x, y = np.append(x, run.count), np.append(y, abs(run.end))
    return Series(label=run.label, style=style, x=x, y=y)


def _line(run: Run, style: str) -> Series:
    """Return the predicted random walk, or the drift of the first tenth of a run."""
    ends = np.array([1.0, float(run.count)])
    walks = run.code in METHODS
    law = run.of.jump * np.sqrt(ends) if walks else abs(run.drift) * ends
    return Series(label="predicted random walk" if walks else "drift of the first tenth", style=style, x=ends, y=law)
