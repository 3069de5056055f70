"""Tables, figures and answer of the horizon study; nothing is run here."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from dem_bridge.studies.horizon.runs import KNOWN, Floats, Found, LongRun, horizon_of
from dem_bridge.studies.horizon.verdicts import independent_from
from dem_bridge.studies.study import FigureData, Panel, Series, Table, verdict_table
from dem_bridge.verification.roles import REFERENCE, TWIN
from dem_bridge.verification.verdict import Outcome, Verdict

#: points of a line of a long run, and least value that is drawn
_POINTS, _LEAST = 1000, 1e-18


def tables(result: Found, judged: Sequence[Verdict]) -> tuple[Table, ...]:
    """Horizons, growth, the long run, and all verdicts."""
    g = result.growth
    horizons = Table(
        id="horizons",
        title="How long single velocities are known to 1 %",
        caption="Horizon: when the bar is above 1 % of the largest speed (inf: not within the duration). Bars are from"
        " twins at other steps and in positions, of the reference from inputs moved by their last digits; differences"
        " to the reference are what was found.",
        columns=(
            "backend", "horizon (s)", "in contact times", "contacts closed until then", "bar at the end",
            "largest difference to the reference",
            "difference above 1 % from (s)",
        ),
        rows=tuple(
            (
                trust.backend,
                trust.horizon,
                trust.horizon / result.contact_time,
                trust.collisions,
                float(trust.bar[-1]),
                math.nan if trust.error is None else float(trust.error[-1]),
                math.nan if trust.error is None else horizon_of(result.truth.time, trust.error),
            )
            for trust in result.trusts
        ),
    )  # fmt: skip
    growth = Table(
        id="growth",
        title="How a perturbation grows",
        caption=f"{len(result.distance)} runs of the reference with masses, velocities and stiffnesses moved by"
        f" {result.perturbation:g}; bars are 95 % intervals from their scatter.",
        columns=(
            "fits", "rate (1/s) or power", "bar", "e-folding time in contact times", "fitted from (s)", "to (s)",
            "misfit, exponential", "misfit, power", "largest distance / perturbation",
        ),
        rows=(
            (
                g.kind,
                g.rate,
                g.bar,
                1.0 / (g.rate * result.contact_time) if g.exponential else math.nan,
                *g.window,
                *g.misfit,
                g.factor,
            ),
        ),
    )  # fmt: skip
    long = Table(
        id="long",
        title="Energy of long runs of the twin",
        caption="Drift of what velocity-Verlet conserves (energy with its known swing added), over the whole run, in"
        " parts of the most that was in motion; bars are 95 % intervals that hold for a walk at random, too.",
        columns=(
            "dt (s)", "steps", "duration (s)", "drift", "bar", "drift told from none", "swing, found",
            "swing, predicted", "mean kinetic / stored energy",
        ),
        rows=tuple(_long_row(item) for item in (result.long, result.halved) if item is not None),
    )  # fmt: skip
    return horizons, growth, long, verdict_table(judged)


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
    """Distances and bars over time; the energy of the long run; the distribution of velocities beyond the horizon."""
    created = [_parting(result)]
    if len(result.long.time) > 2:
        created.append(_energy(result.long))
    first = independent_from(result)
    if first is not None:
        created.append(_distribution(result, first))
    return tuple(created)


def _log(values: Floats) -> Floats:
    return np.asarray(np.log10(np.maximum(values, _LEAST)))


def _parting(result: Found) -> FigureData:
    time = 1e3 * result.truth.time
    middle = np.exp(np.mean(np.log(np.maximum(result.distance, _LEAST)), axis=0))

    def line(label: str, style: str, y: Floats) -> Series:
        return Series(label=label, style=style, x=time, y=_log(y))

    perturbations = (
        line(f"inputs moved by {result.perturbation:g}", "reference", middle),
        line("the nearest", "guide", np.min(result.distance, axis=0)),
        line("the farthest", "guide", np.max(result.distance, axis=0)),
    )
    styles = {REFERENCE: "adiabatic", TWIN: "bca"}
    bars = [
        line(f"bar of {trust.backend}", styles.get(trust.backend, trust.backend), trust.bar) for trust in result.trusts
    ]
    bars += [
        line(f"{trust.backend} - reference", "fit" if trust.backend == TWIN else "ode45", trust.error)
        for trust in result.trusts
        if trust.error is not None
    ]
    bars.append(Series(label="1 %", style="guide", x=time[[0, -1]], y=np.log10([KNOWN, KNOWN])))
    label = "log10 of distance"
    return FigureData(
        id="horizon",
        title="How velocities part",
        caption="Largest distance of velocities so far, over the largest speed. Left: runs of the reference whose"
        " inputs differ a little. Right: bars of each code, and what it differs by from the reference; where a bar"
        " passes 1 % its horizon is.",
        panels=(
            Panel(title="(a) growth of a perturbation", x_label="time (ms)", y_label=label, series=perturbations),
            Panel(title="(b) bars of the codes", x_label="time (ms)", y_label=label, series=tuple(bars)),
        ),
    )


def _energy(long: LongRun) -> FigureData:
    every = max(1, len(long.time) // _POINTS)
    time, drift = long.time[::every], long.drift
    energy, kept = ((item - long.conserved[0]) / long.scale for item in (long.total, long.conserved))
    unit = 10.0 ** math.floor(math.log10(max(float(np.max(np.abs(energy))), _LEAST)))
    series = [
        Series(label="energy", style="guide", x=time, y=energy[::every] / unit),
        Series(label="conserved by the method", style="reference", x=time, y=kept[::every] / unit),
    ]
    notes: tuple[str, ...] = ()
    if drift is not None:
        line = float(np.mean(kept)) + drift.slope * (time - float(np.mean(long.time)))
        series.append(Series(label="fitted drift", style="fit", x=time, y=line / unit))
        total, bar = drift.total
        notes = (f"drift {total:+.1e} +- {bar:.1e} over {long.steps:.3g} steps of {long.dt:.3g} s",)
    panel = Panel(
        title="energy",
        x_label="time (s)",
        y_label=f"change / most in motion ({unit:.0e})",
        series=tuple(series),
        notes=notes,
    )
    return FigureData(
        id="horizon-energy",
        title="Energy of the long run",
        caption="The energy of velocity-Verlet swings about what the method conserves; that walks at random by what"
        " each touch adds or takes.",
        panels=(panel,),
        columns=1,
    )


def _distribution(result: Found, first: int) -> FigureData:
    root = np.sqrt(np.array(result.scene.mass))
    parts = [(trust.backend, trust.backend, [trust.run]) for trust in result.trusts[1:]]
    styles = {TWIN: "bca"}
    edges = np.linspace(-4.0, 4.0, 41)
    middle = 0.5 * (edges[1:] + edges[:-1])

    def density(runs: Sequence[Floats]) -> Floats:
        values = np.concatenate([run.ravel() for run in runs])
        return np.asarray(np.histogram(values / np.sqrt(np.mean(values**2)), bins=edges, density=True)[0])

    available = density([item.velocity[first:] * root for item in (result.truth, *result.ensemble)])
    series = [Series(label="reference, independent runs", style="reference", x=middle, y=available)]
    series += [
        Series(
            label=name,
            style=styles.get(style, style),
            x=middle,
            y=density([run.velocity[first:] * root for run in runs]),
        )
        for name, style, runs in parts
    ]
    normal = np.exp(-0.5 * middle**2) / math.sqrt(2.0 * math.pi)
    series.append(Series(label="normal", style="guide", x=middle, y=normal))
    return FigureData(
        id="horizon-distribution",
        title="Velocities beyond the horizon",
        caption=f"Of all bodies and samples from {1e3 * result.truth.time[first]:.3g} ms on, times the root of the"
        " mass,"
        " over their root mean square: one by one unknown, together well known.",
        panels=(
            Panel(
                title=result.scene.name, x_label="velocity / root mean square", y_label="density", series=tuple(series)
            ),
        ),
        columns=1,
    )


def answer(result: Found, judged: Sequence[Verdict]) -> tuple[str, ...]:
    """Return the answer in sentences, the horizons first."""
    g, scene = result.growth, result.scene
    said = []
    # a chain that is driven from rest has no collision to count by
    available = math.isfinite(result.contact_time)
    for trust in result.trusts:
        if math.isinf(trust.horizon):
            said.append(
                f"Velocities of {trust.backend} on {scene.name} have no horizon within {scene.duration:.3g} s: their"
                " bar"
                f" is {float(trust.bar[-1]):.1e} of the largest at the end."
            )
        else:
            at = f" at dt = {result.plan.step:.3g} s" if trust.backend != REFERENCE else ""
            said.append(
                f"Single velocities of {trust.backend} on {scene.name}{at} are known to 1 % until"
                f" {1e3 * trust.horizon:.3g} ms"
                f" ({f'{trust.horizon / result.contact_time:.0f} contact times, ' * available}"
                f"{trust.collisions:.0f} contacts closed); beyond that they are UNDECIDED."
            )
    fits = f"misfit in the logarithm {g.misfit[0]:.2g}, of a power of time {g.misfit[1]:.2g}"
    if g.kind == "neither":
        said.append(
            f"A perturbation grows {g.factor:.1e} times, not steadily: neither an exponential nor a power fits"
            f" ({fits})."
        )
    elif g.exponential:
        companion = f", which is {1.0 / (g.rate * result.contact_time):.2g} contact times" * available
        said.append(
            f"A perturbation grows {g.factor:.1e} times, exponentially ({fits}): by a factor e in {1.0 / g.rate:.2e}"
            f" s{companion}"
            f" (rate {g.rate:.4g} +- {g.bar:.2g} 1/s, from {len(result.distance)} perturbations). One digit more in a"
            " run"
            f" buys {2.302585 / g.rate:.2e} s."
        )
    else:
        said.append(
            f"A perturbation grows {g.factor:.1e} times, as time to the power {g.rate:.2f} +- {g.bar:.2g} and not"
            f" exponentially ({fits})."
        )
    drift = result.long.drift
    if drift is not None:
        total, bar = drift.total
        predicted, swing = result.long.swing
        said.append(
            f"Energy of the twin over {result.long.steps:.3g} steps ({drift.duration:.3g} s): drift {total:+.1e} +-"
            f" {bar:.1e} of the most in motion, {'told' if drift.found else 'not told'} from none; it swings by"
            f" {swing:.1e} at most ({predicted:.1e} predicted from the step)."
        )
        if result.halved is not None:
            until = float(result.halved.time[-1])
            ratio = result.long.predicted_swing(until) / result.halved.predicted_swing(until)
            said.append(
                f"At half the step it swings {ratio:.2f} times less (root mean square over {until:.3g} s): second order"
                " has 4."
            )
    beyond = [item for item in judged if item.quantity != "velocity"]
    passed = sum(item.outcome is Outcome.PASS for item in beyond)
    said.append(f"{passed} of {len(beyond)} conserved and statistical quantities pass.")
    return tuple(said)
