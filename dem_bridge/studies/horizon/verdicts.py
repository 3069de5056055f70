"""Results of the horizon study, of which nothing is run here: verdicts, tables, figures and answer.

Velocities are judged within the horizon, conserved quantities and statistics beyond it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from dem_bridge.observables.conserved import BLOCKS, energy, energy_parts, momentum, work
from dem_bridge.observables.verdict import Outcome, Verdict, judge, judge_relative
from dem_bridge.report.columns import SECOND, Column
from dem_bridge.report.study import FigureData, Series, Table
from dem_bridge.report.texts import Texts, verdict_table
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.horizon.runs import KNOWN, Found, LongRun, Trust, horizon_of
from dem_bridge.trajectory.trajectory import Floats, Trajectory
from dem_bridge.verification.reference_choice import REFERENCE
from dem_bridge.verification.roles import TWIN

TEXTS = Texts("horizon", "dem_bridge.studies")
HORIZONS_COLUMNS = (
    "backend", Column("horizon", SECOND), "in contact times", "contacts closed until then", "uncertainty at the end",
    "largest difference to the reference", Column("difference above 1 % from", SECOND),
)  # fmt: skip
GROWTH_COLUMNS = (
    "fits", "rate (1/s) or power", "uncertainty", "e-folding time in contact times", Column("fitted from", SECOND),
    Column("to", SECOND), "misfit, exponential", "misfit, power", "largest distance / perturbation",
)  # fmt: skip
LONG_COLUMNS = (
    Column("dt", SECOND), "steps", Column("duration", SECOND), "drift", "uncertainty", "drift significant",
    "oscillation, measured", "oscillation, predicted", "mean kinetic / stored energy",
)  # fmt: skip
#: perturbed runs are independent from when the nearest two are this far apart, of the largest speed
INDEPENDENT = 0.1
#: of the duration that must be left then for statistics over time
LEFT = 0.25
#: a statistic of a right code is outside its bar once in so many
ONCE_IN = 1000.0
#: points of a line of a long run, and least value that is drawn
_POINTS, _LEAST = 1000, 1e-18
#: the statistic that is 0 for a normal distribution, so that its uncertainty is relative to 1 and not to its value
SKEWNESS = "skewness of velocities"


def verdicts(result: Found) -> tuple[Verdict, ...]:
    """Return the verdicts on single velocities of each backend, then on statistics and on conserved quantities."""
    created = [single(result, trust) for trust in result.trusts]
    for trust in result.trusts[1:]:
        created += statistical(result, trust)
        created += conserved(result, trust)
    return (*created, *drift(result))


def single(result: Found, trust: Trust) -> Verdict:
    """Judge whether each velocity is known to 1 % all along; beyond the horizon single velocities are UNDECIDED."""
    predictable, scene = math.isinf(trust.horizon), result.scene
    texts = {"trust": trust, "duration": scene.duration, "ms": 1e3 * trust.horizon}
    return TEXTS.verdict(
        "velocity",
        scene=scene.name,
        backend=trust.backend,
        outcome=Outcome.PASS if predictable else Outcome.UNDECIDED,
        sentence=TEXTS("known_all" if predictable else "known_until", **texts),
        reference="" if trust.backend == REFERENCE else REFERENCE,
        difference=math.nan if trust.error is None else float(trust.error[-1]),
        uncertainty=trust.last,
        tolerance=KNOWN,
        scale=1.0,
    )


def independent_from(result: Found) -> int | None:
    """First sample from which all perturbed runs are independent; None: never, or too late for statistics."""
    apart = np.flatnonzero(np.min(result.distance, axis=0) >= INDEPENDENT)
    if len(apart) == 0 or result.truth.time[apart[0]] > (1.0 - LEFT) * result.scene.duration:
        return None
    return int(apart[0])


def statistics(scene: Scene, run: Trajectory, first: int) -> dict[str, float]:
    """Return four statistics over all samples from ``first`` on.

    They are the ratio of mean kinetic to mean stored energy, the mean kinetic energy (J), and the skewness and the
    kurtosis of velocities times the root of the mass (0 and 3 for a normal distribution).
    """
    kinetic, stored, _ = energy_parts(scene, run)
    pushed = run.velocity[first:] * np.sqrt(np.array(scene.mass))
    second = float(np.mean(pushed**2))
    held = float(np.mean(stored[first:]))
    return {
        "mean kinetic / stored energy": float(np.mean(kinetic[first:])) / held if held > 0.0 else math.nan,
        "mean kinetic energy (J)": float(np.mean(kinetic[first:])),
        SKEWNESS: float(np.mean(pushed**3)) / second**1.5,
        "kurtosis of velocities": float(np.mean(pushed**4)) / second**2,
    }


def statistical(result: Found, trust: Trust) -> list[Verdict]:
    """Judge the statistics of a run by those of independent runs of the reference, where there are such runs."""
    first = independent_from(result)
    if first is None:
        return []
    scene, created = result.scene, []
    others = [statistics(scene, run, first) for run in (result.truth, *result.ensemble)]
    texts = {
        "ms": 1e3 * float(result.truth.time[first]),
        "count": len(others),
        "within": ONCE_IN - 1.0,
        "once_in": ONCE_IN,
    }
    for quantity, value in statistics(scene, trust.run, first).items():
        available: Floats = np.array([other[quantity] for other in others])
        # of one more of the same kind: its own scatter, and that of the mean
        width = float(_quantile(len(available)) * np.std(available, ddof=1)) * math.sqrt(1.0 + 1.0 / len(available))
        middle = float(np.mean(available))
        away = abs(value - middle)
        size = 1.0 if quantity == SKEWNESS else abs(middle)
        numbers = {"difference": away, "reference_uncertainty": width, "tolerance": width}
        names = {"scene": scene.name, "quantity": quantity, "backend": trust.backend}
        texts |= {"value": value, "middle": middle}
        outcome = judge_relative(away / size, 0.0, width / size)
        created.append(
            TEXTS.verdict("statistic", **names, **numbers, **texts, outcome=outcome, scale=1.0, uncertainty=0.0)
        )
    return created


def conserved(result: Found, trust: Trust) -> list[Verdict]:
    """Judge the drift of momentum and of energy.

    Momentum must be constant to round-off. The tolerance of energy is twice the predicted oscillation of
    velocity-Verlet and the drift of the twin over the runs that are compared.
    """
    scene, run, long = result.scene, trust.run, result.long
    drifted = sum(map(abs, long.drift.total)) if long.drift is not None else 0.0
    checks = []
    if scene.conserves_momentum:
        scale = sum(scene.mass) * float(np.max(np.abs(run.velocity)))
        checks.append((momentum(scene, run), "momentum", scale, "kg m/s", run.cost.steps * float(np.finfo(float).eps)))
    if not scene.dissipates:
        quantity = "energy" if scene.conserves_energy else "energy less work"
        balance = energy(scene, run) - work(scene, run)[0]
        checks.append((balance, quantity, long.scale, "J", 2.0 * long.swing[0] + drifted))
    verdicts = []
    for series, quantity, scale, unit, tolerance in checks:
        away = float(np.max(np.abs(series - series[0]))) / scale
        names = {"scene": scene.name, "quantity": quantity, "backend": trust.backend, "unit": unit}
        numbers = {"difference": away, "scale": scale, "tolerance": tolerance}
        verdicts.append(
            TEXTS.verdict(
                "conserved",
                **names,
                **numbers,
                outcome=judge(away, 0.0, tolerance),
                uncertainty=0.0,
                reference_uncertainty=0.0,
            )
        )
    return verdicts


def drift(result: Found) -> list[Verdict]:
    """Judge the energy drift and, where the virial theorem predicts it, the energy ratio of the long run.

    The tolerance of the drift is 1 % of the largest energy in motion; both have the uncertainty of the long run's
    averages.
    """
    long, scene, created = result.long, result.scene, []
    texts = {"scene": scene.name, "backend": TWIN, "over": TEXTS("over", long=long, duration=float(long.time[-1]))}
    if not scene.dissipates and long.drift is not None:
        total, bar = long.drift.total
        numbers = {"difference": abs(total), "scale": long.scale, "uncertainty": bar, "tolerance": KNOWN}
        significant = "significant" if long.drift.found else "not significant"
        outcome = judge(abs(total), bar, KNOWN)
        created.append(
            TEXTS.verdict(
                "drift",
                **texts,
                **numbers,
                outcome=outcome,
                total=total,
                significant=significant,
                reference_uncertainty=0.0,
            )
        )
    exact = virial(scene)
    if exact is not None and long.drift is not None:
        kinetic, stored = (
            np.array([np.mean(part) for part in np.array_split(item, BLOCKS)]) for item in (long.kinetic, long.stored)
        )
        ratio = float(np.sum(kinetic) / np.sum(stored))
        # of a ratio of sums: the blocks' scatter about it, as parts of the mean below the line
        scatter = float(np.std(kinetic - ratio * stored, ddof=1) / np.mean(stored))
        width = _quantile(BLOCKS) * scatter / math.sqrt(BLOCKS)
        away = abs(ratio - exact)
        numbers = {"difference": away, "uncertainty": width, "tolerance": width, "ratio": ratio, "exact": exact}
        outcome = judge_relative(away / exact, 0.0, width / exact)
        created.append(
            TEXTS.verdict("virial", **texts, **numbers, outcome=outcome, scale=1.0, reference_uncertainty=0.0)
        )
    return created


def _quantile(count: int) -> float:
    """Return Student's t of ``count`` values that a right code exceeds once in :data:`ONCE_IN`."""
    from scipy.stats import t as student

    return float(student.ppf(1.0 - 0.5 / ONCE_IN, count - 1))


def virial(scene: Scene) -> float | None:
    """Mean kinetic to mean stored energy of a chain between walls whose contacts touch when it is at rest: n/2.

    ``2 <T> = <sum F overlap> = n <U>`` for forces that are powers (Clausius 1870). None where there is more to it.

    >>> import dem_bridge as db
    >>> virial(db.load_scene("decelerating-40")) is None
    True
    """
    c = scene.contacts
    held = scene.wall_left is not None and scene.wall_right is not None and not np.any(c.gap)
    alone = scene.law is None and scene.gravity == 0.0 and scene.conserves_energy
    if not (held and alone and np.all(c.exponent == c.exponent[0])):
        return None
    return 0.5 * float(c.exponent[0])


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
        TEXTS.table("horizons", HORIZONS_COLUMNS, horizons),
        TEXTS.table("growth", GROWTH_COLUMNS, growth, count=len(result.distance), perturbation=result.perturbation),
        TEXTS.table(
            "long", LONG_COLUMNS, [_long_row(item) for item in (result.long, result.halved) if item is not None]
        ),
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
        line(f"inputs moved by {result.perturbation:g}", "black line", middle),
        line("the nearest", "guide", np.min(result.distance, axis=0)),
        line("the farthest", "guide", np.max(result.distance, axis=0)),
    )
    styles = {REFERENCE: "purple triangles", TWIN: "vermilion squares"}
    codes = [
        line(f"uncertainty of {trust.backend}", styles.get(trust.backend, trust.backend), trust.bar)
        for trust in result.trusts
    ]
    codes += [
        line(f"{trust.backend} - reference", "fit" if trust.backend == TWIN else "green crosses", trust.error)
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
        Series(label="conserved by the method", style="black line", x=time, y=kept[::every] / unit),
    ]
    panel = TEXTS.panel("energy", unit=unit)
    if drift is not None:
        line = float(np.mean(kept)) + drift.slope * (time - float(np.mean(long.time)))
        series.append(Series(label="fitted drift", style="fit", x=time, y=line / unit))
        total, bar = drift.total
        note = f"drift {total:+.1e} +- {bar:.1e} over {long.steps:.3g} steps of {long.dt:.3g} s"
        panel = replace(panel, notes=(note,))
    return TEXTS.figure("horizon-energy", [replace(panel, series=tuple(series))], columns=1)


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
        series.append(
            density(trust.backend, "vermilion squares" if trust.backend == TWIN else trust.backend, [trust.run])
        )
    normal = np.exp(-0.5 * middle**2) / math.sqrt(2.0 * math.pi)
    series.append(Series(label="normal", style="guide", x=middle, y=normal))
    panel = TEXTS.panel("velocities", tuple(series), scene=result.scene.name)
    return TEXTS.figure("horizon-distribution", [panel], ms=1e3 * float(result.truth.time[first]), columns=1)


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
