"""Work-precision in words and tables; nothing is run here."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from textwrap import shorten
from typing import NamedTuple

from dem_bridge.backends.base import ENGINE_BACKENDS
from dem_bridge.studies.study import Study, Table
from dem_bridge.studies.work_precision.curves import STYLES, WHOLE
from dem_bridge.studies.work_precision.figures import ID, cpu, evaluations, figures
from dem_bridge.studies.work_precision.files import as_csv, as_netcdf
from dem_bridge.studies.work_precision.pareto import cheapest
from dem_bridge.studies.work_precision.runs import Measured, Point

TARGETS = (1e-1, 1e-2, 1e-4, 1e-6, 1e-8)
#: errors that grow by more than this factor under refinement have passed their floor
TURNING = 1.5
_FLOOR = "its floor"


class Group(NamedTuple):
    """Settings among which the cheapest is looked for."""

    name: str
    holds: Callable[[Point], bool]


GROUPS = (
    Group("all backends", lambda point: True),
    Group("fixed steps in house", lambda point: point.curve.knob == "dt" and not _of_engine(point)),
    Group("LAMMPS", lambda point: _of_engine(point)),
)


def _of_engine(point: Point) -> bool:
    return point.curve.backend in ENGINE_BACKENDS


def shown(measured: Measured, *, notes: Sequence[str] = (), interrupted: bool = False) -> Study:
    """The study of what was measured."""
    lost = sum(point.timing is None for point in measured.points)
    how = [
        "After one call of each curve that is not timed, each setting is called two or three times, alone, in one"
        " process. The diagrams have the least CPU time of a call, from the scene to the trajectory: with the start of"
        " LAMMPS' own process, and without error bars but those that an extrapolation needs.",
        "Errors are differences from the reference, whose uncertainty in velocity is"
        f" {measured.uncertainty['velocity', 'max']:.1e}. The size of a smaller error is unknown; that uncertainty"
        " stands"
        " in its place.",
        f"{lost} of {len(measured.points)} settings have no numbers (nan): for the limit of {measured.limit:g} s a"
        " run, or"
        " for another reason; the table of all settings has it.",
        "Steps are the sample interval over powers of two. ode45 (both): atol is a thousandth of rtol, in m and m/s."
        " Tables: at a fixed step.",
        *notes,
    ]
    return Study(
        id=ID,
        title=f"Work-precision: {measured.scene.name}",
        answer=tuple(_answer(measured)),
        tables=(_cheapest_table(measured), _floors_table(measured), _runs_table(measured)),
        figures=tuple(figures(measured)),
        notes=tuple(how),
        interrupted=interrupted,
        provenance=measured.provenance,
        files={f"{ID}-all.csv": partial(as_csv, measured), f"{ID}.nc": partial(as_netcdf, measured)},
    )


def setting(point: Point) -> str:
    """A curve's name with the value of its knob.

    >>> from dem_bridge.studies.work_precision.curves import Curve
    >>> setting(Point(curve=Curve(name="verlet", backend="verlet", knob="dt"), value=1e-7))
    'verlet at dt = 1e-07 s'
    """
    return f"{point.curve.name} at {_turned(point)}" if point.curve.knob else point.curve.name


def _turned(point: Point) -> str:
    """The knob with its value; '' where there is none."""
    knob, value = point.curve.knob, point.value
    digits = f"{value:.0f}" if knob in WHOLE else f"{value:.3g}"
    return f"{knob} = {digits}{' s' if knob == 'dt' else ''}" if knob else ""


def best(measured: Measured, target: float, group: Group, observable: str = "velocity") -> Point | None:
    """The setting of least CPU time that errs by at most ``target``."""
    return cheapest(
        filter(group.holds, measured.points),
        target,
        cost=lambda point: point.cpu,
        error=lambda point: measured.bound(point, observable),
    )


def _answer(measured: Measured) -> Iterator[str]:
    for target in TARGETS[1:]:
        parts = []
        for group in GROUPS:
            point = best(measured, target, group)
            parts.append(f"{group.name}: {'none' if point is None else f'{setting(point)} ({_ms(point.cpu)})'}")
        yield f"Velocities to {target:g} for the least CPU time, {'; '.join(parts)}."
    yield from _on_floors(measured)
    yield from _on_richardson(measured)
    yield from _on_tables(measured)


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.3g} ms" if seconds < 1.0 else f"{seconds:.3g} s"


class Floor(NamedTuple):
    """End of a curve: the smallest error that any setting reaches."""

    best: Point
    """Of least velocity error."""
    why: str
    """What lies beyond."""


def _floor(measured: Measured, name: str) -> Floor | None:
    """None for a curve without a run."""
    points = [point for point in measured.points if point.curve.name == name]
    ran = [point for point in points if math.isfinite(point.error("velocity"))]
    if not ran:
        return None
    least = min(ran, key=lambda point: point.error("velocity"))
    beyond = ran[ran.index(least) + 1 :]
    if len(points) == 1:
        return Floor(least, "it has no knob")
    if not measured.known(least, "velocity"):
        return Floor(least, "below the bar of the reference")
    if any(point.error("velocity") > TURNING * least.error("velocity") for point in beyond):
        return Floor(least, f"{_FLOOR}: finer settings err more")
    if len(beyond) > 0 or _flat(ran):
        return Floor(least, f"{_FLOOR}: finer settings gain nothing")
    if any(point.timing is None for point in points[points.index(least) + 1 :]):
        return Floor(least, f"the limit of {measured.limit:g} s")
    return Floor(least, "the end of what was asked for")


def _flat(ran: Sequence[Point]) -> bool:
    """Return whether the last setting has no smaller error than the one before."""
    return len(ran) > 1 and ran[-1].error("velocity") > ran[-2].error("velocity") / TURNING


def _on_floors(measured: Measured) -> Iterator[str]:
    ended = [
        f"{setting(item.best)} with {item.best.error('velocity'):.1e}"
        for item in (_floor(measured, name) for name in measured.curves)
        if item is not None and item.why.startswith(_FLOOR) and item.best.curve.knob in ("dt", "rtol", "atol")
    ]
    if ended:
        yield f"Floors of velocity, which finer settings of the same curve do not pass: {'; '.join(ended)}."


def _on_richardson(measured: Measured) -> Iterator[str]:
    """Return the cost of extrapolation relative to plain runs of the same error."""
    for name in measured.curves:
        extrapolated = f"{name} (Richardson)"
        if extrapolated not in measured.curves:
            continue
        details: dict[float, str] = {}
        for target in TARGETS[1:]:  # a setting that meets several says the most at the last
            plain, better = (_least(measured, item, target, cpu) for item in (name, extrapolated))
            of_evaluations, fewer = (_least(measured, item, target, evaluations) for item in (name, extrapolated))
            if better and plain and fewer and of_evaluations:
                share = fewer.evaluations / of_evaluations.evaluations
                details[better.value] = (
                    f"to {target:g} it takes {better.cpu / plain.cpu:.2g} times the CPU time and {share:.2g} times the"
                    " force evaluations of plain runs"
                )
            elif better:
                details[better.value] = f"only it reaches {target:g}"
        tried = [point for point in measured.points if point.curve.name == extrapolated]
        refused = sum("no extrapolation" in point.reason for point in tried)
        yield (
            f"Richardson extrapolation of {name}:"
            f" {', '.join(details.values()) or 'it meets no target within the limit'};"
            f" {refused} of {len(tried)} steps are refused, for their order is not clean. Its CPU time has the error"
            " bars of its finest run in it."
        )


def _least(measured: Measured, name: str, target: float, cost: Callable[[Point], float]) -> Point | None:
    """Return the cheapest point of a curve with velocity errors of at most ``target``."""
    return cheapest(measured.of(name), target, cost=cost, error=lambda point: measured.bound(point, "velocity"))


def _on_tables(measured: Measured) -> Iterator[str]:
    plain, tabled = (
        {point.value: point for point in measured.of(name)} for name in ("lammps-granular", "lammps-table")
    )
    both = sorted(set(plain) & set(tabled))
    if both:
        first, other = plain[both[0]], tabled[both[0]]
        yield (
            f"LAMMPS with tables at dt = {both[0]:.3g} s takes {_ms(other.cpu)} of CPU time and errs by"
            f" {other.error('velocity'):.2g}, with the law itself {_ms(first.cpu)} and {first.error('velocity'):.2g}."
        )
    for style in STYLES:
        points = measured.of(f"lammps-table ({style})")
        if points:
            parts = [f"{p.error('velocity'):.1e} with {p.value:g}" for p in points]
            yield f"Tables, {style}, at dt = {points[0].dt:.3g} s err by {', '.join(parts)} points."


def _cheapest_table(measured: Measured) -> Table:
    rows: list[tuple[str | float, ...]] = []
    for observable in measured.observables:
        for target in TARGETS:
            cells: list[str | float] = []
            for group in GROUPS:
                point = best(measured, target, group, observable)
                cells += ["-", math.nan] if point is None else [setting(point), 1e3 * point.cpu]
            rows.append((observable, target, *cells))
    heads = (head for group in GROUPS for head in (group.name, f"{group.name}: CPU (ms)"))
    return Table(
        id="cheapest",
        title="The cheapest setting that is good enough",
        caption="Least CPU time of a run whose largest error is at most the wanted one; of the settings that were run.",
        columns=("observable", "wanted error", *heads),
        rows=tuple(rows),
    )


def _floors_table(measured: Measured) -> Table:
    others = [name for name in measured.observables if name != "velocity"]
    rows: list[tuple[str | float, ...]] = []
    for name in measured.curves:
        floor = _floor(measured, name)
        if floor is None:
            reason = next(point.reason for point in measured.points if point.curve.name == name)
            rows.append((name, "-", math.nan, math.nan, *[math.nan] * len(others), reason))
        else:
            least = (
                min((measured.bound(point, other) for point in measured.of(name)), default=math.inf) for other in others
            )
            error, spent = measured.bound(floor.best, "velocity"), 1e3 * floor.best.cpu
            rows.append((name, _turned(floor.best), error, spent, *least, floor.why))
    return Table(
        id="floors",
        title="The least error of each curve",
        caption=(
            "Largest error of a velocity, at the setting where it is least, and what keeps it from being less; beside"
            " it the least errors of the others, each at its own setting. Never less than the bar of the reference."
        ),
        columns=(
            *("curve", "setting", "velocity error", "CPU (ms)"),
            *(f"least error of {name}" for name in others),
            "what ends it (velocity)",
        ),
        rows=tuple(rows),
    )


def _runs_table(measured: Measured) -> Table:
    def row(point: Point) -> tuple[str | float, ...]:
        return (
            point.curve.name,
            _turned(point),
            1e3 * point.cpu,
            1e3 * point.timing.median_wall if point.timing else math.nan,
            point.evaluations,
            *(point.error(name) for name in measured.observables),
            shorten(point.reason, 60, placeholder=" ..."),
        )

    return Table(
        id="runs",
        title="All settings",
        caption="Errors are the largest, relative. Other norms, timings and whole reasons are in the files above.",
        columns=(
            *("curve", "setting", "CPU, least (ms)", "wall, median (ms)", "force evaluations"),
            *measured.observables,
            "reason",
        ),
        rows=tuple(map(row, measured.points)),
    )


__all__ = ["GROUPS", "TARGETS", "best", "setting", "shown"]
