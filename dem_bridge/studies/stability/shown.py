"""Tables, figures and answer of the stability study; nothing is run here."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from dem_bridge.scene import Scene
from dem_bridge.studies.stability.points import ACCURACIES, PHASES, STEPS, Family, Floats, Found, Point, Trap
from dem_bridge.studies.stability.step_limits import FINEST
from dem_bridge.studies.study import FigureData, Map, Panel, Series, Table
from dem_bridge.verification.roles import GRANULAR, TWIN


def tables(scene: Scene, chosen: Sequence[Family], result: Found) -> tuple[Table, ...]:
    """Limits of every point, how they depend on what is called stable, and the trap."""
    names = {family.id: family.axis for family in chosen} | {"": scene.name}
    limits = Table(
        id="limits",
        title="Largest stable and largest accurate steps",
        caption="omega: of the fastest contact alone between its two bodies, and of the fastest mode of all contacts"
        " together, by tangent stiffness, highest over the motion.",
        columns=(
            "varied",
            "value",
            "2/omega, contact (s)",
            "2/omega, mode (s)",
            "stable, twin (s)",
            "stable, LAMMPS (s)",
            "LAMMPS / twin",
            "stable / (2/omega, contact)",
            "stable / (2/omega, mode)",
            *(f"accurate to {requested:g} (s)" for requested in ACCURACIES),
            *(f"stable / accurate to {requested:g}" for requested in ACCURACIES),
            "stable / Rayleigh time (%)",
            "accurate to 0.01 / Rayleigh time (%)",
            "stable again up to (s)",
        ),
        rows=tuple(_limits(names[key], point) for key, points in result.points.items() for point in points),
    )
    thresholds = Table(
        id="thresholds",
        title="What is called stable",
        caption="omega times the largest step below which no energy grows for good by more than the share given, and"
        " the largest step tried above it at which none does either (windows: - where there is none).",
        columns=("scene", "energy may grow by", "omega dt, mode", "window up to omega dt"),
        rows=tuple(
            (name, share, mode * limit.good, mode * limit.window)
            for name, (mode, limits) in result.thresholds.items()
            for share, limit in limits.items()
        ),
    )
    trap = Table(
        id="trap",
        title=f"The trap: {scene.name} at large steps",
        caption="Errors against the reference. Momentum: largest change over all samples. A run may conserve to the"
        " last digit what it has wrong.",
        columns=(
            "backend",
            "dt (s)",
            "velocity, largest error (% of the largest)",
            "velocity at the end (%)",
            "momentum, largest change",
            "kinetic energy at the end, error",
            "total energy, growth",
        ),
        rows=tuple(
            (item.backend, item.dt, 100 * item.velocity, 100 * item.last, item.momentum, item.kinetic, item.energy)
            for item in result.traps
        ),
    )
    return limits, thresholds, trap


def _limits(name: str, point: Point) -> tuple[str | float, ...]:
    stable, nan = point.stable.good, math.nan
    engine = nan if point.engine is None else point.engine.good
    rayleigh = nan if point.rayleigh is None else point.rayleigh
    accurate = [limit.good for limit in point.accurate]
    return (
        name,
        point.value,
        2.0 / point.pair,
        2.0 / point.mode,
        stable,
        engine,
        engine / stable,
        0.5 * stable * point.pair,
        0.5 * stable * point.mode,
        *accurate,
        *(stable / item for item in accurate),
        100.0 * stable / rayleigh,
        100.0 * accurate[0] / rayleigh,
        point.stable.window,
    )


def figures(scene: Scene, chosen: Sequence[Family], result: Found, gain: float) -> tuple[FigureData, ...]:
    """The limits over each family, the energy of two bodies over step and phase, and the trap."""
    created = [
        FigureData(
            id="stability-limits",
            title="Largest steps of velocity-Verlet",
            caption="Between the stable steps and those that are right to 1e-4 lie one to two decades. Below 2/omega of"
            " one contact a chain may be unstable; the highest mode of all contacts says where.",
            panels=tuple(
                _family_panel(letter, family, result.points[family.id])
                for letter, family in zip("abcd", chosen, strict=False)
                if family.id in result.points
            ),
        )
    ]
    if result.gains is not None:
        created.append(_gain_figure(result.gains, gain))
    if result.curve:
        created.append(_trap_figure(scene, result))
    return tuple(item for item in created if item.panels)


def _family_panel(letter: str, family: Family, points: Sequence[Point]) -> Panel:
    def line(label: str, style: str, of: Mapping[float, float]) -> Series:
        return Series(label=label, style=style, x=np.array(list(of)), y=np.array(list(of.values())))

    series = [
        line("2/omega of one contact", "guide", {p.value: 2.0 / p.pair for p in points}),
        line("2/omega of the highest mode", "fit", {p.value: 2.0 / p.mode for p in points}),
        line("stable, twin", "reference", {p.value: p.stable.good for p in points}),
        line("stable, LAMMPS", GRANULAR, {p.value: p.engine.good for p in points if p.engine is not None}),
    ]
    for style, (nth, requested) in zip(("bca", "adiabatic"), enumerate(ACCURACIES), strict=True):
        series.append(line(f"accurate to {requested:g}, twin", style, {p.value: p.accurate[nth].good for p in points}))
    if all(p.rayleigh is not None for p in points):
        series.append(line("Rayleigh time", "", {p.value: p.rayleigh or math.nan for p in points}))
    return Panel(
        title=f"({letter}) {family.title}",
        x_label=family.axis,
        y_label="time step (s)",
        series=tuple(item for item in series if len(item.x)),
        log=True,
    )


def _gain_figure(gains: Floats, called: float) -> FigureData:
    """Return the figure of the energy gain of two bodies: the worst phase over the step, and all phases."""
    finite = np.where(np.isfinite(gains), gains, np.nan)
    edges = [
        Series(label="most gained, of 16 phases", style="reference", x=STEPS, y=np.nanmax(finite, axis=0)),
        Series(label="most lost", style="bca", x=STEPS, y=-np.nanmin(finite, axis=0)),
        Series(label="2/omega", style="guide", x=np.array([2.0, 2.0]), y=np.array([1e-6, 1e2])),
        Series(label="gain that is called unstable", style="fit", x=STEPS[[0, -1]], y=np.array([called, called])),
    ]
    size = np.log10(np.maximum(np.abs(finite), 1e-9))
    return FigureData(
        id="stability-gain",
        title="Energy of two bodies after their impact",
        caption="One curve for all speeds, masses and stiffnesses of Hertzian pairs. An impact lasts 4.03/omega, two"
        " steps at dt = 2/omega: no oscillation has time to grow; what is gained depends on where in a step the"
        " touch falls, and in a chain of many impacts gains and losses average out.",
        panels=(
            Panel(
                title="(a) worst phases",
                x_label="omega dt",
                y_label="energy gained or lost / energy in motion",
                series=tuple(edges),
                log=True,
            ),
            Panel(
                title="(b) all phases",
                x_label="omega dt",
                y_label="phase of the touch within a step",
                map=Map(label="log10 |energy change|", x=STEPS, y=PHASES, values=size),
            ),
        ),
    )


def _trap_figure(scene: Scene, result: Found) -> FigureData:
    runs = [item for item in result.curve if math.isfinite(item.velocity)]
    dt = np.array([run.dt for run in runs])
    shown = (
        ("velocity, largest error", "bca", [run.velocity for run in runs]),
        ("velocity at the end", "adiabatic", [run.last for run in runs]),
        ("kinetic energy at the end", "fit", [run.kinetic for run in runs]),
        ("momentum, largest change", "reference", [max(run.momentum, 1e-17) for run in runs]),
    )
    series = [Series(label=label, style=style, x=dt, y=np.array(y)) for label, style, y in shown]
    lmp = [trap for trap in result.traps if trap.backend == GRANULAR and math.isfinite(trap.velocity)]
    if lmp:
        x, y = np.array([item.dt for item in lmp]), np.array([item.velocity for item in lmp])
        series.append(Series(label="velocity, LAMMPS", style=GRANULAR, x=x, y=y))
    limit = result.points[""][0].stable.good
    series.append(Series(label="largest stable step", style="guide", x=np.array([limit] * 2), y=np.array([1e-16, 1.0])))
    available = tuple(item for item in series if np.isfinite(item.y).any())
    panel = Panel(title=scene.name, x_label="time step (s)", y_label="relative error", series=available, log=True)
    return FigureData(
        id="stability-trap",
        title="The trap: what conservation does not show",
        caption="Momentum is a sum of equal and opposite kicks: it holds whatever the step. Energy goes up and down"
        " with every impact and averages out. Neither says that velocities are right.",
        panels=(panel,),
        columns=1,
    )


def answer(scene: Scene, chosen: Sequence[Family], result: Found, gain: float) -> tuple[str, ...]:
    """Return the answer in sentences; of an interrupted study those that are known."""
    said = [sentence for point in result.points.get("", ()) for sentence in _of_scene(scene, point)]
    said += _of_trap([trap for trap in result.traps if trap.backend == TWIN and math.isfinite(trap.velocity)])
    small = [point for family in chosen for point in result.points.get(family.id, ())]
    if small:
        mode = [0.5 * point.stable.good * point.mode for point in small]
        pair = [0.5 * point.stable.good * point.pair for point in small]
        ratio = [point.stable.good / point.accurate[1].good for point in small]
        said.append(
            f"Over {len(small)} small scenes of {len(chosen)} families the limit is {min(mode):.2f} to"
            f" {max(mode):.2f} times 2/omega of the highest mode and {min(pair):.2f} to {max(pair):.2f} times that of"
            f" the fastest contact; velocities right to {ACCURACIES[1]:g} take a step {min(ratio):.0f} to"
            f" {max(ratio):.0f} times smaller than a stable one."
        )
    both = [
        (point.engine.good / point.stable.good, point.name)
        for point in (*small, *result.points.get("", ()))
        if point.engine is not None
    ]
    if both:
        away = max(abs(ratio - 1.0) for ratio, _ in both)
        said.append(
            f"LAMMPS has the twin's limit on {len(both)} scenes to {100 * away:.1f} %, where the search resolves"
            f" {100 * (FINEST - 1):.1f} %."
        )
    if speeds := result.points.get("speed", ()):
        collapsed = [point.stable.good * point.pair for point in speeds]
        said.append(
            "Impact speed changes nothing but the scale: omega dt at the limit of two bodies is"
            f" {collapsed[0]:.4g} from {speeds[0].value:g} to {speeds[-1].value:g} m/s, equal to"
            f" {max(collapsed) / min(collapsed) - 1:.0e}."
        )
    angles = [
        (point.value, point.stable.good / point.rayleigh) for point in result.points.get("angle", ()) if point.rayleigh
    ]
    if len(angles) > 1:
        (first, low), (last, high) = angles[0], angles[-1]
        said.append(
            f"The Rayleigh time knows no contact angle: the limit is {100 * low:.0f} % of it at {first:g} degrees and"
            f" {100 * high:.0f} % at {last:g}."
        )
    for name, (omega, limits) in result.thresholds.items():
        (least, narrow), *_, (most, wide) = limits.items()
        said.append(
            f"What is called stable on {name}: omega dt (highest mode) is {omega * narrow.good:.2f} at the limit where"
            f" energy may grow by {least:g}, and {omega * wide.good:.2f} where by {most:g}; {gain:g} is taken here."
        )
    return tuple(said) or ("Nothing was finished.",)


def _of_scene(scene: Scene, point: Point) -> tuple[str, str]:
    limit, (items, two) = point.stable.good, (result.good for result in point.accurate)
    lmp = f" (LAMMPS: {point.engine.good:.3g} s)" if point.engine is not None else ""
    share = f", {100 * limit / point.rayleigh:.0f} % of the Rayleigh time" if point.rayleigh else ""
    return (
        f"On {scene.name} velocity-Verlet is stable up to dt = {limit:.3g} s{lmp}{share}:"
        f" {0.5 * limit * point.mode:.2f} times 2/omega of the chain's highest mode, and"
        f" {0.5 * limit * point.pair:.2f} times that of its fastest contact alone, which is the usual estimate.",
        f"Velocities there are right to {ACCURACIES[0]:g} up to {items:.3g} s and to {ACCURACIES[1]:g} up to"
        f" {two:.3g} s:"
        f" {limit / items:.0f} and {limit / two:.0f} times below the stable step.",
    )


def _of_trap(runs: Sequence[Trap]) -> list[str]:
    if not runs:
        return []
    errors, last = [100 * run.velocity for run in runs], [100 * run.last for run in runs]
    moved = max(run.momentum for run in runs)
    kept = "" if math.isnan(moved) else f"momentum changes by at most {moved:.0e} of its own and "
    return [
        f"Between the two conservation says nothing: from dt = {runs[0].dt:.0e} to {runs[-1].dt:.0e} s velocities err"
        f" by {min(errors):.2g} to {max(errors):.2g} % of the largest ({min(last):.2g} to {max(last):.2g} % at the end"
        f" alone), while {kept}the final kinetic energy errs by at most {max(run.kinetic for run in runs):.0e}."
    ]
