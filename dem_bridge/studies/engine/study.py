"""Every normal law, damping, wall and clip of the LAMMPS at hand, in one impact each.

An impact is RIGHT if LAMMPS repeats an independent velocity-Verlet at the same steps, whose difference from the exact
restitution is the error of the time step. It is WRONG otherwise, with its cause if another physics repeats LAMMPS, and
NOT THERE if the engine refuses it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

import numpy as np

from dem_bridge.errors import UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.known_defects import KnownDefect, defects_of
from dem_bridge.lmp.process import require
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.report.columns import METRE, Column
from dem_bridge.report.study import EFFECTS, FigureData, Series, Study
from dem_bridge.report.texts import Texts
from dem_bridge.runs.campaign import Jobs, Progress
from dem_bridge.runs.recall import recall
from dem_bridge.runs.store import Store
from dem_bridge.studies.engine.impacts import DAMPINGS, WRITTEN, Impact, Steps, catalogue
from dem_bridge.studies.engine.motion import (
    AND,
    NOT_A_NUMBER,
    TOLERANCE,
    Exact,
    Motion,
    causes_of,
    closed_form,
    exact,
    twins,
)
from dem_bridge.studies.engine.runs import EngineRun, run_impacts

TEXTS = Texts("engine", "dem_bridge.studies")
WRONG_COLUMNS = (
    "cause", "known defect", "law or damping", "styles", "impacts", "largest error of e", "example", "write instead",
)  # fmt: skip
WRITTEN_COLUMNS = ("written e", "tsuji", "tsuji, right", "coeff_restitution", "coeff_restitution, right")
IMPACTS_COLUMNS = {
    "impact.style": "style", "impact.partner": "partner", "impact.words": "law and damping", "state": "state",
    "restitution": "restitution", "exact.restitution": "exact", "closed_form": "closed form",
    "difference": "difference from the twin", "step_error": "time step",
    "exact.peak_overlap": Column("peak overlap", METRE), "cause": "cause", "names": "known defect",
    "run.message": "the engine's words", "instead": "write instead",
}  # fmt: skip
#: steps of a contact, steps of a run and steps between two samples
CONTACT_STEPS, STEPS, EVERY = 16_000, 17_600, 400
RIGHT, WRONG, ABSENT, UNDEFINED = "RIGHT", "WRONG", "NOT THERE", "NO THEORY"
_OUTCOMES = {RIGHT: Outcome.PASS, WRONG: Outcome.FAIL, ABSENT: Outcome.NOT_RUN, UNDEFINED: Outcome.NOT_RUN}
_RESTITUTION = ("tsuji", "coeff_restitution")
#: smallest difference that the figure shows
LEAST_SHOWN = 1e-14


@dataclass(frozen=True, kw_only=True, eq=False)
class Row:
    """One impact: what LAMMPS made of it, and what is right."""

    run: EngineRun
    exact: Exact
    twin: Motion
    defects: tuple[KnownDefect, ...] = ()
    """Known defects of the release that the deck meets."""
    cause: str = ""
    """Cause of a wrong result."""
    instead: str = ""
    """What to write in place of a wrong or missing combination."""

    @property
    def impact(self) -> Impact:
        """Return the impact in LAMMPS' words."""
        return self.run.impact

    @property
    def state(self) -> str:
        """Return RIGHT, WRONG, NOT THERE or NO THEORY."""
        if self.run.motion is None:
            return ABSENT
        if not defined(self.impact):
            return UNDEFINED
        return RIGHT if self.difference <= TOLERANCE else WRONG

    @property
    def restitution(self) -> float:
        """Return LAMMPS' restitution; nan without one."""
        return math.nan if self.run.motion is None else self.run.motion.restitution

    @property
    def error(self) -> float:
        """Return LAMMPS' restitution minus the exact one."""
        return self.restitution - self.exact.restitution

    @property
    def step_error(self) -> float:
        """Return the twin's restitution minus the exact one."""
        return self.twin.restitution - self.exact.restitution

    @property
    def closed_form(self) -> float:
        """Return the restitution by a closed form; nan if there is none."""
        return closed_form(self.impact.contact) if defined(self.impact) else math.nan

    @property
    def difference(self) -> float:
        """Return the largest difference of closing speeds between LAMMPS and the twin, relative; nan without one."""
        motion = self.run.motion
        return math.nan if motion is None or not motion.finite else motion.difference(self.twin)

    @property
    def known(self) -> tuple[KnownDefect, ...]:
        """Return the known defects that have the causes of a wrong result; none unless they explain all of them."""
        causes = self.cause.split(AND)
        explaining = tuple(defect for defect in self.defects if defect.cause in causes)
        return explaining if {defect.cause for defect in explaining} == set(causes) else ()

    @property
    def names(self) -> str:
        """Return the names of the known defects of a wrong result."""
        return ", ".join(defect.name for defect in self.known)

    @property
    def message(self) -> str:
        """Return the error message of the engine without the line of the deck."""
        return re.split(r" Last (?:input line|command):", self.run.message)[0]

    @property
    def cell(self) -> str:
        """Return state and numbers in a few characters."""
        if self.state == WRONG:
            return f"WRONG {self.restitution:.4f} ({self.exact.restitution:.4f})"
        return self.state + (f" {self.restitution:.4f}" if self.state == RIGHT else "")


def study_engine(
    *,
    match: str = "",
    known_defects: str = "fail",
    jobs: Jobs = None,
    engine: Engine | None = None,
    progress: Progress | None = None,
    store: Store | None = None,
) -> Study:
    """Check every normal law, damping and wall of LAMMPS in one impact each against theory, and name what is wrong.

    Parameters
    ----------
    match : str
        Only impacts whose names contain this text, such as "tsuji" or "hertz-velocity-wall". Without it all are run.
    known_defects : str
        Effect of impacts that are wrong by a known defect of the release on the exit code: "fail" (1) or "ok" (none).
    engine, jobs, progress, store : as in :func:`dem_bridge.study`

    Returns
    -------
    Study
        A verdict for each impact: FAIL for a wrong one, NOT_RUN for one that the engine refuses.

    Raises
    ------
    BackendUnavailable
        If there is no LAMMPS.
    UsageError
        If no impact has such a name, or for another effect.
    """
    if known_defects not in EFFECTS:
        raise UsageError(f"known_defects = {known_defects!r}; allowed: {', '.join(EFFECTS)}")
    impacts = [impact for impact in catalogue() if match in impact.name]
    if not impacts:
        raise UsageError(
            f"match = {match!r} is in no name; names are such as 'hertz-velocity-wall', 'jkr-undamped-pair'"
        )
    engine = engine or Engine.chosen()
    version = require(engine, "pair granular").version
    run = lambda: rows_of(impacts, engine, version, jobs=jobs, progress=progress)  # noqa: E731
    kinds = (Row, EngineRun, Impact, Exact, Motion, KnownDefect)
    how: dict[str, Any] = {"kinds": kinds, "engine": engine, "impacts": [impact.name for impact in impacts]}
    rows = recall(store, "engine: impacts", [], run, **how)
    return study_of(rows, version, known_defects=known_defects)


def defined(impact: Impact) -> bool:
    """Return True if theory knows the combination: adhesion has neither a clip nor a damping by restitution."""
    return not (impact.adhesion and (impact.clip or impact.damping in _RESTITUTION))


def steps_of(impact: Impact, solution: Exact) -> Steps:
    """Return the time steps of an impact whose exact solution is known."""
    dt = solution.time / CONTACT_STEPS
    touch = impact.radius * (1.0 if impact.flat else 2.0)
    # as the deck's positions have it
    gap = (touch + 0.37 * impact.contact.speed * dt) - touch
    return Steps(dt=dt, count=STEPS, every=EVERY, gap=gap)


def rows_of(
    impacts: Sequence[Impact],
    engine: Engine,
    version: int,
    *,
    jobs: Jobs = None,
    progress: Progress | None = None,
) -> list[Row]:
    """Run and judge impacts."""
    solved: dict[Any, Exact] = {}
    for impact in impacts:
        contact = impact.contact
        if contact not in solved:
            # combinations without theory have the steps of the undamped contact
            stepped = contact if defined(impact) else replace(contact, damping=0.0, clip=False)
            solved[contact] = exact(stepped)
    solutions = [solved[impact.contact] for impact in impacts]
    steps = [steps_of(impact, solution) for impact, solution in zip(impacts, solutions, strict=True)]
    motions = twins([impact.contact for impact in impacts], steps)
    results = run_impacts(impacts, steps, engine=engine, jobs=jobs, progress=progress)
    rows = [
        Row(run=run, exact=solution, twin=twin, defects=defects_of(version, run.deck))
        for run, solution, twin in zip(results, solutions, motions, strict=True)
    ]
    wrong = [at for at, row in enumerate(rows) if row.state == WRONG]
    tried = [(impacts[at], steps[at], motion) for at in wrong if (motion := rows[at].run.motion) is not None]
    for at, cause in zip(wrong, causes_of(tried), strict=True):
        rows[at] = replace(rows[at], cause=cause)
    return [replace(row, instead=_instead(row, rows)) for row in rows]


def _instead(row: Row, rows: Sequence[Row]) -> str:
    """Return what to write in place of a wrong or missing combination."""
    if row.state in (RIGHT, UNDEFINED):
        return ""
    if row.known:
        return "; ".join(defect.instead for defect in row.known)
    impact = row.impact
    right = [other.impact for other in rows if other.state == RIGHT and other.impact.clip == impact.clip]
    dampings = [other.damping for other in right if (other.law, other.style) == (impact.law, impact.style)]
    if dampings:
        return TEXTS("other_damping", dampings=", ".join(dict.fromkeys(dampings)))
    styles = [other.style for other in right if (other.law, other.damping) == (impact.law, impact.damping)]
    return TEXTS("other_style", styles=", ".join(dict.fromkeys(styles))) if styles else TEXTS("nothing")


def study_of(rows: Sequence[Row], version: int, *, known_defects: str = "fail") -> Study:
    """Show the rows; nothing is run here."""
    count = {state: sum(row.state == state for row in rows) for state in _OUTCOMES}
    right = [row for row in rows if row.state == RIGHT]
    groups = list(_groups(rows))
    largest = max((row.difference for row in right), default=math.nan)
    step = max((abs(row.step_error) for row in rows if defined(row.impact)), default=math.nan)
    numbers = {"lammps": version, "rows": len(rows), "largest": largest}
    numbers |= {"right": count[RIGHT], "wrong": count[WRONG], "absent": count[ABSENT]}
    answer = [TEXTS("count" if right else "count_without", **numbers)]
    if groups:
        answer.append(TEXTS("wrong_are", groups="; ".join(TEXTS("group", **group) for group in groups)))
    return TEXTS.study(
        {"lammps": version},
        answer=tuple(answer),
        tables=(
            TEXTS.table("wrong", WRONG_COLUMNS, [tuple(group.values()) for group in groups]),
            TEXTS.table("written", WRITTEN_COLUMNS, _written(rows)),
            TEXTS.table("impacts", IMPACTS_COLUMNS, rows),
            TEXTS.table("matrix", ("style", "law", "limit_damping", *DAMPINGS), _matrix(rows)),
        ),
        figures=(_figure(rows),),
        verdicts=tuple(_verdicts(rows, groups)),
        notes=TEXTS.notes(step=step, tolerance=TOLERANCE),
        known_defects=known_defects,
        provenance={"lammps": version, "contact_steps": CONTACT_STEPS, "tolerance": TOLERANCE},
    )


def _groups(rows: Iterable[Row]) -> Iterator[dict[str, Any]]:
    """Yield the wrong impacts by their cause, with their largest error and an example."""

    def key(row: Row) -> tuple[str, str]:
        return row.cause, row.names

    for (cause, names), members in groupby(sorted((row for row in rows if row.state == WRONG), key=key), key):
        group = list(members)
        usual = [row for row in group if row.impact.written == WRITTEN and not row.impact.linear] or group
        worst = max(usual, key=lambda row: abs(row.error) if math.isfinite(row.error) else math.inf)
        impacts = [row.impact for row in group]
        what = [f"{i.law} {'' if i.classic else i.damping}".strip() for i in impacts]
        if len({i.law for i in impacts if not i.classic}) > 1:
            what = [i.damping for i in impacts]
        elif len(set(what)) > 1 and not any(i.classic for i in impacts):
            what = [i.law for i in impacts]
        yield {
            "cause": cause,
            "known": names,
            "what": ", ".join(dict.fromkeys(what)),
            "styles": ", ".join(dict.fromkeys(i.style for i in impacts)),
            "impacts": len(group),
            "error": max((abs(row.error) for row in group), default=math.nan),
            "example": TEXTS("example", row=worst),
            "instead": worst.instead,
        }


def _verdicts(rows: Sequence[Row], groups: Iterable[Mapping[str, Any]]) -> Iterator[Verdict]:
    """Yield a verdict for each cause of wrong impacts, each style with right ones and each message of the engine."""

    def verdict(scene: str, outcome: Outcome, key: str, **values: Any) -> Verdict:
        sentence = TEXTS(key, scene=scene, **values)
        return Verdict(scene=scene, quantity="restitution", backend="LAMMPS", reference="twin", outcome=outcome,
                       sentence=sentence, tolerance=TOLERANCE, known_defect=values.get("known", ""),
                       difference=values.get("difference", math.nan))  # fmt: skip

    for group in groups:
        yield verdict(group["what"], Outcome.FAIL, "known" if group["known"] else "wrong", **group)
    right = [row for row in rows if row.state == RIGHT]
    for style in dict.fromkeys(row.impact.style for row in right):
        differences = [row.difference for row in right if row.impact.style == style]
        yield verdict(style, Outcome.PASS, "right", count=len(differences), difference=max(differences))
    shown = {defect.name for row in rows for defect in row.known}
    for name in dict.fromkeys(defect.name for row in right for defect in row.defects if defect.name not in shown):
        yield verdict(name, Outcome.PASS, "unshown")
    for state, key in ((ABSENT, "absent"), (UNDEFINED, "undefined")):
        chosen = [row for row in rows if row.state == state]
        for words in dict.fromkeys(row.message for row in chosen):
            impacts = [row.impact for row in chosen if row.message == words]
            what = ", ".join(dict.fromkeys(f"{impact.law} {impact.damping}" for impact in impacts))
            yield verdict(what, Outcome.NOT_RUN, key, count=len(impacts), engine=words)


def _written(rows: Sequence[Row]) -> Iterator[tuple[float, ...]]:
    """Yield written coefficients of restitution with what two Hertz spheres make of them."""
    law = "hertz/material"
    chosen = [row for row in rows if row.impact.law == law and row.impact.partner == "pair" and not row.impact.clip]
    pairs = {name: {row.impact.written: row for row in chosen if row.impact.damping == name} for name in _RESTITUTION}
    for written in sorted(set.intersection(*(set(rows) for rows in pairs.values()))):
        cells = (pairs[name][written] for name in _RESTITUTION)
        yield (written, *(value for row in cells for value in (row.restitution, row.exact.restitution)))


def _matrix(rows: Sequence[Row]) -> Iterator[tuple[str, ...]]:
    """Yield the states by style, law and clip, a column for each damping."""
    keyed: dict[tuple[str, str, str], dict[str, str]] = {}
    for row in rows:
        impact = row.impact
        partner = " (frozen)" * (impact.partner == "frozen")
        key = (impact.style + partner, impact.law, "yes" if impact.clip else "no")
        keyed.setdefault(key, {}).setdefault(impact.damping, row.cell)
    for key, cells in keyed.items():
        yield (*key, *(cells.get(damping, "") for damping in DAMPINGS))


def _figure(rows: Sequence[Row]) -> FigureData:
    written = np.array(list(_written(rows))).T
    series = [Series(label="what is written", style="guide", x=np.array([0.0, 1.0]), y=np.array([0.0, 1.0]))]
    if written.size:
        for nth, (at, label) in enumerate(((1, "tsuji"), (3, "coeff_restitution")), start=1):
            series.append(Series(label=label, style=f"mark-{nth}", x=written[0], y=written[at]))
    laws = tuple(dict.fromkeys(_name(row) for row in rows))
    points = [Series(label="tolerance", style="fit", x=np.full(2, TOLERANCE), y=np.array([-0.5, len(laws) - 0.5]))]
    for state, style in ((RIGHT, "mark-4"), (WRONG, "mark-3")):
        # marks that would hide each other are one
        shown = {
            (round(math.log10(max(row.difference, LEAST_SHOWN)), 1) if row.cause != NOT_A_NUMBER else 0.0, _name(row))
            for row in rows
            if row.state == state
        }
        x = np.array([10.0**power for power, _ in sorted(shown)])
        y = np.array([float(laws.index(name)) for _, name in sorted(shown)])
        points.append(Series(label=state, style=style, x=x, y=y))
    panels = [TEXTS.panel("restitution", series), TEXTS.panel("differences", points, rows=laws)]
    return TEXTS.figure("engine-impacts", panels, least=LEAST_SHOWN)


def _name(row: Row) -> str:
    return f"{'gran/' * row.impact.classic}{row.impact.law}"
