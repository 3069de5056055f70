"""Tables, figures and answer of the horizon study; nothing is run here."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.report.study import FigureData, Series, Table
from dem_bridge.report.texts import Texts, verdict_table
from dem_bridge.studies.horizon.runs import KNOWN, Found, LongRun, horizon_of
from dem_bridge.studies.horizon.verdicts import independent_from
from dem_bridge.trajectory.trajectory import Floats, Trajectory
from dem_bridge.verification.roles import REFERENCE, TWIN

TEXTS = Texts("horizon", "dem_bridge.studies")
#: points of a line of a long run, and least value that is drawn
_POINTS, _LEAST = 1000, 1e-18


def tables(result: Found, judged: Sequence[Verdict]) -> tuple[Table, ...]:
    """Return the horizons, the growth, the long run, and all verdicts."""
    g = result.growth
    horizons = [
        (
            trust.backend,
            trust.horizon,
            trust.horizon / result.contact_time,
            trust.collisions,
            trust.last,
            math.nan if trust.error is None else float(trust.error[-1]),
            math.nan if trust.error is None else horizon_of(result.truth.time, trust.error),
        )
        for trust in result.trusts
    ]
    folding = 1.0 / (g.rate * result.contact_time) if g.exponential else math.nan
    growth = [(g.kind, g.rate, g.bar, folding, *g.window, *g.misfit, g.factor)]
    return (
        TEXTS.table("horizons", horizons),
        TEXTS.table("growth", growth, count=len(result.distance), perturbation=result.perturbation),
        TEXTS.table("long", [_long_row(item) for item in (result.long, result.halved) if item is not None]),
        verdict_table(judged),
    )


def _long_row(long_run: LongRun) -> tuple[str | float, ...]:
    nan, drift = math.nan, long_run.drift
    predicted, swing = long_run.swing
    stored = float(np.mean(long_run.stored))
    return (
        long_run.dt,
        float(long_run.steps),
        float(long_run.time[-1]),
        *(drift.total if drift is not None else (nan, nan)),
        "too short" if drift is None else "yes" if drift.found else "no",
        swing,
        predicted,
        float(np.mean(long_run.kinetic)) / stored if stored > 0.0 else nan,
    )


def figures(result: Found) -> tuple[FigureData, ...]:
    """Return the distances over time, the energy of the long run, and the velocities beyond the horizon."""
    created = [_parting(result)]
    if len(result.long.time) > 2:
        created.append(_energy(result.long))
    first = independent_from(result)
    if first is not None:
        created.append(_distribution(result, first))
    return tuple(created)


def _parting(result: Found) -> FigureData:
    time = 1e3 * result.truth.time
    middle = np.exp(np.mean(np.log(np.maximum(result.distance, _LEAST)), axis=0))

    def line(label: str, style: str, y: Floats) -> Series:
        return Series(label=label, style=style, x=time, y=np.log10(np.maximum(y, _LEAST)))

    perturbations = (
        line(f"inputs moved by {result.perturbation:g}", "reference", middle),
        line("the nearest", "guide", np.min(result.distance, axis=0)),
        line("the farthest", "guide", np.max(result.distance, axis=0)),
    )
    styles = {REFERENCE: "adiabatic", TWIN: "bca"}
    codes = [
        line(f"uncertainty of {trust.backend}", styles.get(trust.backend, trust.backend), trust.bar)
        for trust in result.trusts
    ]
    codes += [
        line(f"{trust.backend} - reference", "fit" if trust.backend == TWIN else "ode45", trust.error)
        for trust in result.trusts
        if trust.error is not None
    ]
    codes.append(Series(label="1 %", style="guide", x=time[[0, -1]], y=np.log10([KNOWN, KNOWN])))
    return TEXTS.figure("horizon", [TEXTS.panel("growth", perturbations), TEXTS.panel("codes", tuple(codes))])


def _energy(long: LongRun) -> FigureData:
    every = max(1, len(long.time) // _POINTS)
    time, drift = long.time[::every], long.drift
    energy, kept = ((item - long.conserved[0]) / long.scale for item in (long.total, long.conserved))
    unit = 10.0 ** math.floor(math.log10(max(float(np.max(np.abs(energy))), _LEAST)))
    series = [
        Series(label="energy", style="guide", x=time, y=energy[::every] / unit),
        Series(label="conserved by the method", style="reference", x=time, y=kept[::every] / unit),
    ]
    panel = TEXTS.panel("energy", unit=unit)
    if drift is not None:
        line = float(np.mean(kept)) + drift.slope * (time - float(np.mean(long.time)))
        series.append(Series(label="fitted drift", style="fit", x=time, y=line / unit))
        total, bar = drift.total
        note = f"drift {total:+.1e} +- {bar:.1e} over {long.steps:.3g} steps of {long.dt:.3g} s"
        panel = replace(panel, notes=(note,))
    return TEXTS.figure("horizon-energy", [replace(panel, series=tuple(series))])


def _distribution(result: Found, first: int) -> FigureData:
    root = np.sqrt(np.array(result.scene.mass))
    edges = np.linspace(-4.0, 4.0, 41)
    middle = 0.5 * (edges[1:] + edges[:-1])

    def density(label: str, style: str, runs: Sequence[Trajectory]) -> Series:
        values = np.concatenate([(run.velocity[first:] * root).ravel() for run in runs])
        scaled = values / np.sqrt(np.mean(values**2))
        return Series(label=label, style=style, x=middle, y=np.histogram(scaled, bins=edges, density=True)[0])

    series = [density("reference, independent runs", "reference", (result.truth, *result.ensemble))]
    for trust in result.trusts[1:]:
        series.append(density(trust.backend, "bca" if trust.backend == TWIN else trust.backend, [trust.run]))
    normal = np.exp(-0.5 * middle**2) / math.sqrt(2.0 * math.pi)
    series.append(Series(label="normal", style="guide", x=middle, y=normal))
    panel = TEXTS.panel("velocities", tuple(series), scene=result.scene.name)
    return TEXTS.figure("horizon-distribution", [panel], ms=1e3 * float(result.truth.time[first]))


def answer(result: Found, judged: Sequence[Verdict]) -> Iterator[str]:
    """Yield the answer in sentences, the horizons first."""
    g, scene, contact_time = result.growth, result.scene, result.contact_time

    def in_contact_times(key: str, time: float) -> str:
        # a chain that is driven from rest has no collision to count by
        return TEXTS(key, number=time / contact_time) if math.isfinite(contact_time) else ""

    for trust in result.trusts:
        if math.isinf(trust.horizon):
            yield TEXTS("known", trust=trust, scene=scene)
            continue
        at = TEXTS("at", dt=result.plan.step) if trust.backend != REFERENCE else ""
        contacts = in_contact_times("contact_times", trust.horizon)
        yield TEXTS("until", trust=trust, scene=scene, at=at, ms=1e3 * trust.horizon, contacts=contacts)
    fits = TEXTS("fits", g=g)
    if g.kind != "exponential":
        yield TEXTS("neither" if g.kind == "neither" else "power", g=g, fits=fits)
    else:
        time = 1.0 / g.rate
        contacts, count = in_contact_times("in_contact_times", time), len(result.distance)
        yield TEXTS("exponential", g=g, fits=fits, time=time, contacts=contacts, count=count, digit=2.302585 * time)
    drift = result.long.drift
    if drift is not None:
        significant = "significantly different" if drift.found else "not significantly different"
        yield TEXTS("drift", long=result.long, drift=drift, significant=significant)
        if result.halved is not None:
            until = float(result.halved.time[-1])
            ratio = result.long.predicted_swing(until) / result.halved.predicted_swing(until)
            yield TEXTS("halved", ratio=ratio, until=until)
    beyond = [item for item in judged if item.quantity != "velocity"]
    yield TEXTS("beyond", passed=sum(item.outcome is Outcome.PASS for item in beyond), count=len(beyond))
