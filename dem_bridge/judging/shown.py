"""The lines, the page, the tables and the figures of a judgement."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from dem_bridge.backends.base import versions_of
from dem_bridge.backends.reference import SERIES
from dem_bridge.foundation.wording import share
from dem_bridge.judging.judgement import Judgement
from dem_bridge.judging.records import every_nth
from dem_bridge.judging.reference import FileErrors, QuantityErrors
from dem_bridge.judging.sentences import TEXTS, file_name, lines, two_digits
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.report.columns import SECOND, Column
from dem_bridge.report.study import FigureData, Map, Panel, Series, Study, Table

ERRORS_COLUMNS = (
    "file", Column("time step", SECOND), "quantity", "error", "uncertainty", "largest value", "unit", "relative error",
    "place", Column("time", SECOND),
)  # fmt: skip
ORDERS_COLUMNS = ("quantity", "order", "uncertainty", Column("coarsest step", SECOND), Column("finest step", SECOND))
RECOGNISED_COLUMNS = ("assumption",)


#: words for quantities in a sentence
WORDS = {"velocity": "velocities", "displacement": "displacements", "contact_force": "contact forces"}
#: most rows of a map
MAP_ROWS = 300


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class JudgementStudy(Study):
    """A judgement as a study, whose JSON file has its keys beside the verdicts."""

    judgement: Judgement

    @property
    def record_name(self) -> str:
        """Name of the JSON file."""
        return "verdicts.json"

    @property
    def exit_code(self) -> int:
        """Exit code of the judgement."""
        return self.judgement.exit_code

    def as_json(self) -> dict[str, Any]:
        """Return the keys of the judgement, its verdicts and provenance; JSON without NaN."""
        return {
            "schema": "dem-bridge/verdicts/1",
            **self.judgement.as_json(),
            "verdicts": [verdict.as_json() for verdict in self.verdicts],
            "claims": [],
            "provenance": dict(self.provenance),
        }


def judgement_study(judgement: Judgement) -> Study:
    """Return the page of a judgement as data."""
    texts = dict(lines(judgement))
    first = [text for name in ("outcome", "next") if (text := texts.pop(name))]
    further = [f"{name.capitalize()}: {text}" for name, text in texts.items()]
    names = [file.record.name for file in judgement.files]
    method = "Taylor series" if SERIES.covers(judgement.scene) else "DOP853 with located openings and closings"
    tables = [_error_table(judgement)]
    if judgement.order:
        tables.append(_order_table(judgement))
    if judgement.recognised:
        tables.append(TEXTS.table("recognised", RECOGNISED_COLUMNS, [(text,) for text in judgement.recognised]))
    return JudgementStudy(
        id="judge",
        title=TEXTS("title", files=_several(names), scene=judgement.scene.name),
        answer=(*first, *further),
        tables=(*tables, *judgement.addition.tables),
        figures=(_figure(judgement), *judgement.addition.figures),
        verdicts=tuple(_verdicts(judgement)),
        notes=(*TEXTS.notes(method=method), *judgement.addition.notes),
        provenance={
            "scene": judgement.scene.name,
            "scene_hash": judgement.scene.content_hash,
            "files": names,
            "tolerance": judgement.tolerance,
            "versions": versions_of("dem-bridge", "numpy", "scipy", "numba"),
        },
        judgement=judgement,
    )


def _several(names: list[str]) -> str:
    """Return the names of a few files, or the first and the number of the others."""
    return " and ".join(names) if len(names) < 3 else f"{names[0]} and {len(names) - 1} more files"


def _error_table(judgement: Judgement) -> Table:
    """Return the largest error of each quantity of each file."""
    rows = []
    for file in judgement.files:
        for name, part in file.quantities.items():
            step = math.nan if file.record.dt is None else file.record.dt
            numbers = (part.value, part.uncertainty, part.scale, part.unit, part.relative(part.value))
            when = float(file.record.time[part.worst[0]])
            rows.append((file.record.name, step, name.replace("_", " "), *numbers, part.place, when))
    return TEXTS.table("errors", ERRORS_COLUMNS, rows)


def _order_table(judgement: Judgement) -> Table:
    """Return the observed order of each quantity."""
    rows = [
        (part.quantity.replace("_", " "), part.order.value, part.order.uncertainty, *part.order.ends)
        for part in judgement.convergence
        if part.order is not None
    ]
    return TEXTS.table("orders", ORDERS_COLUMNS, rows)


def _verdicts(judgement: Judgement) -> Iterator[Verdict]:
    """Yield a verdict on each quantity; without a tolerance its outcome is that of the judgement."""
    for name, (file, part) in judgement.worst.items():
        first = file.first_divergence(judgement.scene)
        yield TEXTS.verdict(
            "error",
            scene=judgement.scene.name,
            quantity=name,
            outcome=judgement.outcomes.get(name, Outcome(judgement.outcome)),
            difference=part.relative(part.value),
            scale=part.scale,
            unit=part.unit,
            uncertainty=part.relative(part.uncertainty),
            reference_uncertainty=part.relative(part.reference_uncertainty),
            tolerance=math.nan if judgement.tolerance is None else judgement.tolerance,
            first_divergence=None if first is None else (first["time"], first["body"]),
            cause=judgement.cause,
            words=WORDS[name],
            name=file.record.name,
            error=f"{two_digits(part.value)} {part.unit}",
            relative=share(part.relative(part.value)),
            bound=f"{part.uncertainty:.0e} {part.unit}",
        )


def _figure(judgement: Judgement) -> FigureData:
    """Return the figure: error against time and body, the largest error against time, and error against time step."""
    name, (file, part) = next(iter(judgement.worst.items()))
    axis = "contact" if name == "contact_force" else "body"
    end = max(float(item.record.time[-1]) for item in judgement.files)
    unit, factor = ("ms", 1e3) if end > 1e-3 else ("µs", 1e6)
    every = -(-len(file.record.time) // MAP_ROWS)
    panels = [_map(file, part, axis, unit, factor, every)] if len(part.columns) > 1 else []
    panels.append(_time_panel(judgement, name, unit, factor))
    if any(sum(error > 0.0 for error in item.errors) > 1 for item in judgement.convergence):
        panels.append(_step_panel(judgement))
    return TEXTS.figure(
        "errors",
        panels,
        quantity=name.replace("_", " "),
        name=file.record.name,
        axis=axis,
        axes="contacts" if axis == "contact" else "bodies",
        thinned=f" ({every_nth(every)} sample is drawn)" if every > 1 else "",
        steps=" Last: root mean square error of each quantity against the time step." if len(panels) > 2 else "",
    )


def _map(file: FileErrors, part: QuantityErrors, axis: str, unit: str, factor: float, every: int) -> Panel:
    """Return the panel with the error against time and body."""
    order = np.argsort(part.columns)
    label = f"error of {part.quantity.replace('_', ' ')} ({part.unit})"
    data = Map(
        label=label,
        x=np.array(part.columns, dtype=float)[order],
        y=factor * file.record.time[::every],
        values=part.error[::every][:, order],
        diverging=True,
    )
    return TEXTS.panel("map", map=data, axis=axis, unit=unit, name=file.record.name)


def _time_panel(judgement: Judgement, name: str, unit: str, factor: float) -> Panel:
    """Return the panel with the largest error over all bodies against time."""
    series = []
    having = [file for file in judgement.files if name in file.quantities][:5]
    for nth, file in enumerate(having):
        part, time = file.quantities[name], factor * file.record.time
        scale = part.scale or 1.0
        error = np.abs(part.error).max(axis=1) / scale
        series.append(Series(label=file_name(file), style=f"line/{nth}/{nth}", x=time, y=error))
    file, part = judgement.worst[name]
    limit = part.explained.max(axis=1) / (part.scale or 1.0)
    series.append(Series(label="explained by digits", style="guide", x=factor * file.record.time, y=limit))
    drawn = [Series(label=line.label, style=line.style, x=line.x[line.y > 0], y=line.y[line.y > 0]) for line in series]
    return TEXTS.panel("time", [line for line in drawn if len(line.x)], unit=unit, log_y=True)


def _step_panel(judgement: Judgement) -> Panel:
    """Return the panel with the error of each quantity against the time step, and lines of the observed orders."""
    series = []
    scales = {name: part.scale or 1.0 for name, (_, part) in judgement.worst.items()}
    for nth, item in enumerate(judgement.convergence):
        dt, scale = np.array(item.dt), scales[item.quantity]
        label = item.quantity.replace("_", " ")
        errors = np.array(item.errors) / scale
        series.append(Series(label=label, style=f"mark-{nth + 1}", x=dt[errors > 0.0], y=errors[errors > 0.0]))
        if item.order is not None:
            ends = np.array(item.order.ends)
            start = item.errors[item.dt.index(float(ends[0]))] / scale
            line = start * (ends / ends[0]) ** item.order.value
            series.append(Series(label="observed order", style="guide", x=ends, y=line))
    return TEXTS.panel("steps", series, log=True)
