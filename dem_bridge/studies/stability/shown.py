"""Tables, figures and answer of the stability study; nothing is run here."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dem_bridge.scene import Scene
from dem_bridge.studies.stability.points import ACCURACIES, PHASES, STEPS, TEXTS, Family, Point, Results, Trap
from dem_bridge.studies.stability.step_limits import FINEST
from dem_bridge.studies.study import FigureData, Map, Series, Table, lines
from dem_bridge.verification.roles import GRANULAR, TWIN

if TYPE_CHECKING:
    from pandas import DataFrame

_ACCURACIES: dict[str, Any] = {"first": ACCURACIES[0], "second": ACCURACIES[1]}


def points_of(scene: Scene, result: Results) -> DataFrame:
    """Return the limits of all scenes and their ratios, a row for each scene."""
    from pandas import DataFrame

    axes = {family: texts["axis"] for family, texts in TEXTS.data["families"].items()} | {"": scene.name}
    frame = DataFrame(result.points, columns=list(Point.__dataclass_fields__))
    return frame.assign(
        varied=frame["family"].map(axes),
        over_pair=2.0 / frame["pair"],
        over_mode=2.0 / frame["mode"],
        engine_ratio=frame["engine"] / frame["stable"],
        pair_ratio=0.5 * frame["stable"] * frame["pair"],
        mode_ratio=0.5 * frame["stable"] * frame["mode"],
        over_coarse=frame["stable"] / frame["coarse"],
        over_fine=frame["stable"] / frame["fine"],
        share=frame["stable"] / frame["rayleigh"],
        coarse_share=frame["coarse"] / frame["rayleigh"],
    )


def tables(scene: Scene, points: DataFrame, result: Results) -> tuple[Table, ...]:
    """Return the limits of every point, how they depend on what is called stable, and the trap."""
    return (
        TEXTS.table("limits", points.itertuples(), **_ACCURACIES),
        TEXTS.table("thresholds", result.thresholds),
        TEXTS.table("trap", result.traps, scene=scene.name),
    )


def figures(
    scene: Scene, chosen: Sequence[Family], points: DataFrame, result: Results, gain: float
) -> Iterator[FigureData]:
    """Yield the limits over each family, the energy of two bodies over step and phase, and the trap."""
    columns = {
        "2/omega of one contact": ("guide", "over_pair"),
        "2/omega of the highest mode": ("fit", "over_mode"),
        "stable, twin": ("reference", "stable"),
        "stable, LAMMPS": (GRANULAR, "engine"),
        f"accurate to {ACCURACIES[0]:g}, twin": ("bca", "coarse"),
        f"accurate to {ACCURACIES[1]:g}, twin": ("adiabatic", "fine"),
        "Rayleigh time": ("", "rayleigh"),
    }
    panels = [
        TEXTS.panel("family", lines(item, "value", columns), letter=letter, family=TEXTS.data["families"][family.id])
        for letter, family in zip("abcd", chosen, strict=False)
        if len(item := points[points["family"] == family.id])
    ]
    if panels:
        yield TEXTS.figure("stability-limits", panels)
    if result.gains is not None:
        finite = np.where(np.isfinite(result.gains), result.gains, np.nan)
        edges = [
            Series(label="most gained, of 16 phases", style="reference", x=STEPS, y=np.nanmax(finite, axis=0)),
            Series(label="most lost", style="bca", x=STEPS, y=-np.nanmin(finite, axis=0)),
            Series(label="2/omega", style="guide", x=np.array([2.0, 2.0]), y=np.array([1e-6, 1e2])),
            Series(label="gain that is called unstable", style="fit", x=STEPS[[0, -1]], y=np.array([gain, gain])),
        ]
        size = Map(label="log10 |energy change|", x=STEPS, y=PHASES, values=np.log10(np.maximum(np.abs(finite), 1e-9)))
        yield TEXTS.figure("stability-gain", (TEXTS.panel("phases", edges), TEXTS.panel("gains", map=size)))
    if result.curve:
        yield TEXTS.figure("stability-trap", [TEXTS.panel("trap", _trap(points, result), scene=scene.name)])


def _trap(points: DataFrame, result: Results) -> Iterator[Series]:
    """Yield the errors of the named scene over the time step, and its largest stable step."""
    curve, engine = _frame(result.curve, TWIN), _frame(result.traps, GRANULAR)
    columns = {
        "velocity, largest error": ("bca", "velocity"),
        "velocity at the end": ("adiabatic", "last"),
        "kinetic energy at the end": ("fit", "kinetic"),
        "momentum, largest change": ("reference", "momentum"),
    }
    yield from lines(curve.assign(momentum=np.maximum(curve["momentum"], 1e-17)), "dt", columns)
    yield from lines(engine, "dt", {"velocity, LAMMPS": (GRANULAR, "velocity")})
    limit = float(points["stable"].iloc[-1])
    yield Series(label="largest stable step", style="guide", x=np.array([limit] * 2), y=np.array([1e-16, 1.0]))


def _frame(traps: Sequence[Trap], backend: str) -> DataFrame:
    """Return the runs of a backend at large steps that did not break, a row for each."""
    from pandas import DataFrame

    rows = [trap for trap in traps if trap.backend == backend and math.isfinite(trap.velocity)]
    return DataFrame(rows, columns=list(Trap.__dataclass_fields__))


def answer(chosen: Sequence[Family], points: DataFrame, result: Results, gain: float) -> Iterator[str]:
    """Yield the answer in sentences; of an interrupted study those that are known."""
    for point in points[points["family"] == ""].itertuples():
        lmp = f" (LAMMPS: {point.engine:.3g} s)" if math.isfinite(point.engine) else ""
        share = f", {100 * point.share:.0f} % of the Rayleigh time" if math.isfinite(point.share) else ""
        yield TEXTS("stable", p=point, lmp=lmp, share=share)
        yield TEXTS("accurate", p=point, **_ACCURACIES)
    traps = _frame(result.traps, TWIN)
    if len(traps):
        moved = traps["momentum"].max(skipna=False)
        yield TEXTS(
            "trap",
            first=traps["dt"].iloc[0],
            last=traps["dt"].iloc[-1],
            v=_range(100 * traps["velocity"]),
            end=_range(100 * traps["last"]),
            kept="" if math.isnan(moved) else f"momentum changes by at most {moved:.0e} of its own and ",
            kinetic=traps["kinetic"].max(),
        )
    small = points[points["family"] != ""]
    if len(small):
        mode, pair, fine = (_range(small[name]) for name in ("mode_ratio", "pair_ratio", "over_fine"))
        ranges: dict[str, Any] = {"mode": mode, "pair": pair, "fine": fine}
        yield TEXTS("families", count=len(small), families=len(chosen), accuracy=ACCURACIES[1], **ranges)
    both = points["engine_ratio"].dropna()
    if len(both):
        yield TEXTS("engine", count=len(both), away=np.max(np.abs(both - 1.0)), finest=100 * (FINEST - 1))
    speeds, angles = (points[points["family"] == family] for family in ("speed", "angle"))
    if len(speeds):
        collapsed, value = speeds["stable"] * speeds["pair"], speeds["value"].iloc
        spread = collapsed.max() / collapsed.min() - 1
        yield TEXTS("speed", limit=collapsed.iloc[0], first=value[0], last=value[-1], spread=spread)
    if len(angles) > 1:
        yield TEXTS("angle", first=angles.iloc[0], last=angles.iloc[-1])
    for name in dict.fromkeys(threshold.scene for threshold in result.thresholds):
        first, *_, last = (threshold for threshold in result.thresholds if threshold.scene == name)
        yield TEXTS("threshold", scene=name, first=first, last=last, gain=gain)


def _range(values: Any) -> tuple[float, float]:
    return float(values.min()), float(values.max())
