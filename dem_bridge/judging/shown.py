"""The lines, the page, the tables and the figures of a judgement."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dem_bridge.backends.base import versions_of
from dem_bridge.backends.reference import SERIES
from dem_bridge.foundation.notebook import quantity as amount
from dem_bridge.judging.error import FileErrors, QuantityErrors
from dem_bridge.judging.judgement import Judgement
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.report.study import FigureData, Map, Panel, Series, Study, Table
from dem_bridge.report.texts import Texts

TEXTS = Texts("judge", "dem_bridge.judging")
#: words for quantities in a sentence
WORDS = {"velocity": "velocities", "displacement": "displacements", "contact_force": "contact forces"}
#: largest distance of an observed order from a whole number that counts as this order, beside its uncertainty
NEAR = 0.15
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
    first = [texts.pop("outcome"), f"Cause: {texts.pop('cause')}"]
    further = [f"{name.capitalize()}: {text}" for name, text in texts.items()]
    names = [file.record.name for file in judgement.files]
    method = "Taylor series" if SERIES.covers(judgement.scene) else "DOP853 with located openings and closings"
    tables = [_error_table(judgement)]
    if judgement.order:
        tables.append(_order_table(judgement))
    if judgement.recognised:
        tables.append(TEXTS.table("recognised", [(text,) for text in judgement.recognised]))
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


def lines(judgement: Judgement) -> Iterator[tuple[str, str]]:
    """Yield the lines of a judgement as pairs of name and text."""
    yield "outcome", _outcome(judgement)
    for name, (file, part) in judgement.worst.items():
        text = _error_text(file, part)
        if len(judgement.files) > 1:
            text = TEXTS("in_file", errors=text, name=_file_name(file))
        yield f"{name.replace('_', ' ')}", f"error {text}"
    yield "divergence", _divergence(judgement)
    if len(judgement.files) > 1:
        yield "order", _order_text(judgement)
    yield "floor", _floor(judgement)
    yield "cause", f"{judgement.cause}{f' ({judgement.where})' if judgement.where else ''}. {judgement.evidence}"
    if judgement.alternatives:
        others = ", ".join(judgement.alternatives)
        yield "alternatives", TEXTS("alternatives", cause=judgement.cause, alternatives=others)
    yield "next", " ".join(_advice(judgement))
    yield from judgement.addition.lines


def _several(names: list[str]) -> str:
    """Return the names of a few files, or the first and the number of the others."""
    return " and ".join(names) if len(names) < 3 else f"{names[0]} and {len(names) - 1} more files"


def _file_name(file: FileErrors) -> str:
    """Return the name of a file with its time step."""
    return file.record.name + (f" (dt = {amount(file.record.dt, 's')})" if file.record.dt is not None else "")


def _share(part: QuantityErrors, value: float) -> str:
    """Return a value relative to the scale as text."""
    return _two_digits(part.relative(value))


def _two_digits(value: float) -> str:
    """Return a number with two digits, as a power of ten unless it is of ordinary size.

    >>> _two_digits(3.4e-5), _two_digits(0.1089), _two_digits(88.2)
    ('3.4e-05', '0.11', '88')
    """
    return f"{value:.2g}" if 1e-3 <= value < 99.5 else f"{value:.1e}"


def _error_text(file: FileErrors, part: QuantityErrors) -> str:
    """Return the largest error of a quantity as a sentence without a subject."""
    numbers = {"error": f"{_two_digits(part.value)} {part.unit}", "uncertainty": f"{part.uncertainty:.0e} {part.unit}"}
    if part.scale == 0.0:
        return TEXTS("error_without_scale", **numbers)
    time = amount(float(file.record.time[part.worst[0]]), "s", 4)
    scale = f"{part.scale:.3g} {part.unit}"
    return TEXTS("error", **numbers, relative=_share(part, part.value), scale=scale, place=part.place, time=time)


def _outcome(judgement: Judgement) -> str:
    """Return the outcome and the reason for it."""
    if judgement.tolerance is None:
        if judgement.cause == "none":
            return TEXTS("explained")
        if judgement.cause == "unknown":
            return TEXTS("unseen" if judgement.first_divergence is None else "open")
        return TEXTS("caused", cause=judgement.cause)
    if judgement.outcome == Outcome.PASS:
        return TEXTS("passes", tolerance=judgement.tolerance)
    deciding = {
        name: judgement.worst[name][1]
        for name, outcome in judgement.outcomes.items()
        if outcome.value == judgement.outcome
    }
    name, part = max(deciding.items(), key=lambda item: item[1].relative(item[1].value))
    values = {"quantity": name.replace("_", " "), "tolerance": judgement.tolerance}
    if judgement.outcome == Outcome.FAIL:
        return TEXTS("fails", **values, relative=_share(part, part.value))
    return TEXTS("straddles", **values, uncertainty=_share(part, part.uncertainty))


def _divergence(judgement: Judgement) -> str:
    """Return the sentence on the first divergence."""
    first = judgement.first_divergence
    if first is None:
        return TEXTS("no_divergence")
    place = f"contact {first['contact']}" if "contact" in first else f"body {first['body']}"
    words = first["quantity"].replace("_", " ")
    return TEXTS("divergence", quantity=words, place=place, time=amount(first["time"], "s", 4))


def _order_text(judgement: Judgement) -> str:
    """Return the observed orders and what they mean."""
    orders = [(part.quantity, part.order) for part in judgement.convergence if part.order is not None]
    if not orders:
        return TEXTS("no_order")
    text = ", ".join(
        f"{name.replace('_', ' ')} {order.value:.2f} +- {max(order.uncertainty, 0.005):.2g}" for name, order in orders
    )
    steps = [step for _, order in orders for step in order.steps]
    ends = {"coarse": amount(max(steps), "s"), "fine": amount(min(steps), "s")}
    return f"{TEXTS('orders', orders=text, **ends)}. {TEXTS(_meaning(judgement.order))}"


def _meaning(orders: Mapping[str, Mapping[str, float]]) -> str:
    """Return the key of the sentence on what the observed orders mean."""

    def near(name: str, value: float) -> bool:
        order = orders.get(name)
        return order is not None and abs(order["value"] - value) <= max(NEAR, order["uncertainty"])

    if near("velocity", 1.0) and near("displacement", 2.0):
        return "half_step"
    values = [(name, order["value"]) for name, order in orders.items()]
    for value, key in ((0.0, "constant"), (1.0, "first"), (2.0, "second")):
        if all(near(name, value) for name, _ in values):
            return key
    if all(value > 2.0 for _, value in values):
        return "high"
    return "growing" if all(value < 0.0 for _, value in values) else "other"


def _floor(judgement: Judgement) -> str:
    """Return the sentence on the floor."""
    name, (_, part) = next(iter(judgement.worst.items()))
    floor = math.nan if judgement.floor is None else judgement.floor
    flat = floor > part.relative(part.floor)
    return TEXTS("flat" if flat else "floor", floor=floor, quantity=name.replace("_", " "))


def _advice(judgement: Judgement) -> Iterator[str]:
    """Yield what to do next."""
    if judgement.cause == "unknown" and judgement.first_divergence is None:
        yield TEXTS("see_more")
        return
    tolerance, fails = judgement.tolerance, judgement.outcome == Outcome.FAIL
    if judgement.cause == "none" and not fails and judgement.first_divergence is not None:
        yield from _step_advice(judgement)
    else:
        yield TEXTS("reduce") if fails and judgement.cause == "none" else TEXTS.data["advice"][judgement.cause]
    if tolerance is not None and fails and not math.isnan(step := _step_for(judgement, tolerance)):
        step = min(step, next(iter(judgement.worst.values()))[0].record.dt or step)
        yield TEXTS("step_for_tolerance" if judgement.order else "step_by_method", dt=amount(step, "s", 2))
    if len(judgement.files) == 1 and judgement.cause == "unknown":
        yield TEXTS("more_files")


def _step_advice(judgement: Judgement) -> Iterator[str]:
    """Yield how large the error of the time step is, and which steps make errors of 1e-2 and 1e-3."""
    name, (file, part) = next(iter(judgement.worst.items()))
    words = {"relative": _share(part, part.value), "quantity": name.replace("_", " ")}
    step = judgement.diagnosis.step
    dt = file.record.dt if step is None else step.dt
    if dt is None or (step is None and not judgement.order):
        yield TEXTS("small", **words)
        return
    found = TEXTS("found_step") if step is not None and not step.stated else ""
    yield TEXTS("step", dt=amount(dt, "s"), found=found, **words)
    coarse, fine = (_step_for(judgement, error) for error in (1e-2, 1e-3))
    if not (math.isnan(coarse) or math.isnan(fine)):
        yield TEXTS("steps", coarse=amount(coarse, "s", 2), fine=amount(fine, "s", 2), quantity=words["quantity"])


def _step_for(judgement: Judgement, error: float) -> float:
    """Return the largest time step for errors relative to the scale, s, by the observed orders or by the method."""
    steps = []
    for name, (file, part) in judgement.worst.items():
        order = judgement.order.get(name, {}).get("value", 0.0)
        if file.record.dt is not None and order > 0.5 and part.value > 0.0 < part.scale:
            steps.append(file.record.dt * (error / part.relative(part.value)) ** (1.0 / order))
    if not steps and judgement.cause == "none" and judgement.diagnosis.step is not None:
        return judgement.diagnosis.step.largest_for(error)
    return min(steps, default=math.nan)


def _error_table(judgement: Judgement) -> Table:
    """Return the largest error of each quantity of each file."""
    rows = []
    for file in judgement.files:
        for name, part in file.quantities.items():
            step = math.nan if file.record.dt is None else file.record.dt
            numbers = (part.value, part.uncertainty, part.scale, part.unit, part.relative(part.value))
            when = float(file.record.time[part.worst[0]])
            rows.append((file.record.name, step, name.replace("_", " "), *numbers, part.place, when))
    return TEXTS.table("errors", rows)


def _order_table(judgement: Judgement) -> Table:
    """Return the observed order of each quantity."""
    rows = [
        (part.quantity.replace("_", " "), part.order.value, part.order.uncertainty, *part.order.ends)
        for part in judgement.convergence
        if part.order is not None
    ]
    return TEXTS.table("orders", rows)


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
            error=f"{_two_digits(part.value)} {part.unit}",
            relative=_share(part, part.value),
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
        thinned=f" (every sample number {every} is drawn)" if every > 1 else "",
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
        series.append(Series(label=_file_name(file), style=f"line/{nth}/{nth}", x=time, y=error))
    file, part = judgement.worst[name]
    limit = part.explained.max(axis=1) / (part.scale or 1.0)
    series.append(Series(label="explained by digits", style="guide", x=factor * file.record.time, y=limit))
    drawn = [Series(label=line.label, style=line.style, x=line.x[line.y > 0], y=line.y[line.y > 0]) for line in series]
    return TEXTS.panel("time", [line for line in drawn if len(line.x)], unit=unit)


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
    return TEXTS.panel("steps", series)
