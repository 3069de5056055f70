"""Study of stability and accuracy: the largest stable and the largest accurate time steps of velocity-Verlet.

Four families of small scenes and one named scene. Each point is a search (:mod:`.step_limits`) by the twin, in part by
LAMMPS, set beside 2/omega of the fastest contact and of the chain's highest mode (:mod:`dem_bridge.observables.modes`).
Between the two limits lies a trap, shown on the named scene: momentum and energy hold where velocities do not.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dem_bridge.errors import UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.report.columns import PERCENT, SECOND, Column
from dem_bridge.report.study import FigureData, Map, Series, Study, Table, check_setting
from dem_bridge.runs.campaign import Progress
from dem_bridge.runs.store import Store
from dem_bridge.scene.file import load_scene
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.stability.parts import Results, Settings, measure
from dem_bridge.studies.stability.points import ACCURACIES, PHASES, STEPS, TEXTS, Family, Trap, families
from dem_bridge.studies.stability.step_limits import FINEST, RATIO
from dem_bridge.verification.roles import GRANULAR, TWIN

if TYPE_CHECKING:
    from pandas import DataFrame

#: lines of the figures: label -> style and column
FAMILY_LINES = {
    "2/omega of one contact": ("guide", "over_pair"),
    "2/omega of the highest mode": ("fit", "over_mode"),
    "stable, twin": ("black line", "stable"),
    "stable, LAMMPS": ("lammps-granular", "engine"),
    f"accurate to {ACCURACIES[0]:g}, twin": ("vermilion squares", "coarse"),
    f"accurate to {ACCURACIES[1]:g}, twin": ("purple triangles", "fine"),
    "Rayleigh time": ("", "rayleigh"),
}
TRAP_LINES = {
    "velocity, largest error": ("vermilion squares", "velocity"),
    "velocity at the end": ("purple triangles", "last"),
    "kinetic energy at the end": ("fit", "kinetic"),
    "momentum, largest change": ("black line", "momentum"),
}
ENGINE_LINES = {"velocity, LAMMPS": ("lammps-granular", "velocity")}
LIMITS_COLUMNS = {
    "varied": "varied", "value": "value", "over_pair": Column("2/omega, contact", SECOND),
    "over_mode": Column("2/omega, mode", SECOND), "stable": Column("stable, twin", SECOND),
    "engine": Column("stable, LAMMPS", SECOND), "engine_ratio": "LAMMPS / twin",
    "pair_ratio": "stable / (2/omega, contact)", "mode_ratio": "stable / (2/omega, mode)",
    "coarse": Column(f"accurate to {ACCURACIES[0]:g}", SECOND),
    "fine": Column(f"accurate to {ACCURACIES[1]:g}", SECOND), "over_coarse": f"stable / accurate to {ACCURACIES[0]:g}",
    "over_fine": f"stable / accurate to {ACCURACIES[1]:g}", "share": Column("stable / Rayleigh time", PERCENT),
    "coarse_share": Column("accurate to 0.01 / Rayleigh time", PERCENT),
    "window": Column("stable again up to", SECOND),
}  # fmt: skip
THRESHOLDS_COLUMNS = {
    "scene": "scene", "share": "energy may grow by", "omega_dt": "omega dt, mode", "window": "window up to omega dt",
}  # fmt: skip
TRAP_COLUMNS = {
    "backend": "backend", "dt": Column("dt", SECOND),
    "velocity": Column("velocity, largest error", PERCENT, of="of the largest"),
    "last": Column("velocity at the end", PERCENT), "momentum": "momentum, largest change",
    "kinetic": "kinetic energy at the end, error", "energy": "total energy, growth",
}  # fmt: skip


#: a run is unstable whose energy grows for good by more than this share of what was in motion
GAIN = 1.0
DEFAULT_SCENE = "decelerating-40"
#: limits of LAMMPS and twin are the same within this: both are known to half of it
SAME = 0.01


def study_stability(
    scene: Scene | None = None,
    *,
    gain: float = GAIN,
    points: int = 7,
    engine: Engine | None = None,
    store: Store | None = None,
    progress: Progress | None = None,
) -> Study:
    """Find the largest stable and the largest accurate time steps of velocity-Verlet.

    The twin and LAMMPS are run on four families of small scenes and on one whole scene. The runs are short, so that
    they are not made in parallel; the limits are kept in the store. Ctrl-C keeps what was finished.

    Parameters
    ----------
    scene : Scene, optional
        Scene beside the families, without a drive. None: decelerating-40.
    gain : float
        Lasting growth of the energy, relative to the energy in motion, above which a run is called unstable.
    points : int
        Number of scenes in each family.
    engine, store, progress : as in :func:`dem_bridge.study`

    Returns
    -------
    Study

    Raises
    ------
    UsageError
        For a setting out of its range, and for a scene that is driven or in which nothing moves.
    """
    check_setting("gain", gain, "a number > 0, as 1.0 for energy that doubles")
    check_setting("points", points, "a whole number from 2 to 100", least=2, most=100)
    from pandas import DataFrame

    scene = load_scene(DEFAULT_SCENE) if scene is None else scene
    if scene.drive is not None:
        raise UsageError(
            f"{scene.name} is driven, and energy that grows is no sign of a step too large there; allowed: a scene"
            " without drive, as the same one struck"
        )
    chosen, results = families(points), Results()
    settings = Settings(gain=float(gain), engine=engine or Engine.chosen(), store=store)
    total = points * len(chosen) + 4
    try:
        for done, label in enumerate(measure(scene, chosen, results, settings)):
            if progress is not None:
                progress(done, total, label)
    except KeyboardInterrupt:
        results.interrupted = True
    columns = ["family", "varied", "value", "omega_dt", "rayleigh", *LIMITS_COLUMNS]
    frame = DataFrame(results.points, columns=list(dict.fromkeys(columns)))
    return TEXTS.study(
        {"scene": scene.name},
        answer=tuple(answer(chosen, frame, results, float(gain))) or ("Nothing was finished.",),
        tables=tables(scene, frame, results),
        figures=tuple(figures(scene, chosen, frame, results, float(gain))),
        verdicts=tuple(judge_agreement(point) for point in results.points if math.isfinite(point["engine"])),
        notes=(*results.notes, *TEXTS.notes(gain=gain, finest=100 * (FINEST - 1), ratio=100 * (RATIO - 1))),
        interrupted=results.interrupted,
        provenance={"scene": scene.name, "scene_hash": scene.content_hash, "gain": gain, "points": points},
    )


def judge_agreement(point: Mapping[str, Any]) -> Verdict:
    """Judge whether LAMMPS and the twin have the same largest stable step."""
    apart = abs(point["engine_ratio"] - 1.0)
    names = {"scene": point["name"], "backend": GRANULAR, "reference": TWIN}
    numbers = {"difference": apart, "scale": point["stable"], "tolerance": SAME}
    outcome = Outcome.PASS if apart <= SAME else Outcome.FAIL
    return TEXTS.verdict("agreement", **names, **numbers, outcome=outcome, engine=point["engine"])


def tables(scene: Scene, points: DataFrame, result: Results) -> tuple[Table, ...]:
    """Return the limits of every point, how they depend on what is called stable, and the trap."""
    return (
        TEXTS.table("limits", LIMITS_COLUMNS, points.itertuples()),
        TEXTS.table("thresholds", THRESHOLDS_COLUMNS, result.thresholds),
        TEXTS.table("trap", TRAP_COLUMNS, result.traps, scene=scene.name),
    )


def figures(
    scene: Scene, chosen: Sequence[Family], points: DataFrame, result: Results, gain: float
) -> Iterator[FigureData]:
    """Yield the limits over each family, the energy of two bodies over step and phase, and the trap."""
    panels = []
    for letter, family in zip("abcd", chosen, strict=False):
        if len(item := points[points["family"] == family.id]):
            series = _lines(FAMILY_LINES, item, "value")
            panels.append(
                TEXTS.panel("family", series, letter=letter, family=TEXTS.data["families"][family.id], log=True)
            )
    if panels:
        yield TEXTS.figure("stability-limits", panels)
    if result.gains is not None:
        finite = np.where(np.isfinite(result.gains), result.gains, np.nan)
        edges = [
            Series(label="most gained, of 16 phases", style="black line", x=STEPS, y=np.nanmax(finite, axis=0)),
            Series(label="most lost", style="vermilion squares", x=STEPS, y=-np.nanmin(finite, axis=0)),
            Series(label="2/omega", style="guide", x=np.array([2.0, 2.0]), y=np.array([1e-6, 1e2])),
            Series(label="gain that is called unstable", style="fit", x=STEPS[[0, -1]], y=np.array([gain, gain])),
        ]
        size = Map(label="log10 |energy change|", x=STEPS, y=PHASES, values=np.log10(np.maximum(np.abs(finite), 1e-9)))
        yield TEXTS.figure("stability-gain", (TEXTS.panel("phases", edges, log=True), TEXTS.panel("gains", map=size)))
    if result.curve:
        yield TEXTS.figure(
            "stability-trap", [TEXTS.panel("trap", _trap(points, result), scene=scene.name, log=True)], columns=1
        )


def _trap(points: DataFrame, result: Results) -> Iterator[Series]:
    """Yield the errors of the named scene over the time step, and its largest stable step."""
    curve, engine = _frame(result.curve, TWIN), _frame(result.traps, GRANULAR)
    yield from _lines(TRAP_LINES, curve.assign(momentum=np.maximum(curve["momentum"], 1e-17)), "dt")
    yield from _lines(ENGINE_LINES, engine, "dt")
    limit = float(points["stable"].iloc[-1])
    yield Series(label="largest stable step", style="guide", x=np.array([limit] * 2), y=np.array([1e-16, 1.0]))


def _lines(lines: Mapping[str, tuple[str, str]], frame: DataFrame, x: str) -> Iterator[Series]:
    """Yield a series over column ``x`` for each label -> (style, column) that has values."""
    for label, (style, column) in lines.items():
        rows = frame.dropna(subset=[column])
        if len(rows):
            yield Series(label=label, style=style, x=rows[x].to_numpy(float), y=rows[column].to_numpy(float))


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
        yield TEXTS("accurate", p=point, first=ACCURACIES[0], second=ACCURACIES[1])
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
        collapsed, value = speeds["omega_dt"], speeds["value"].iloc
        spread = collapsed.max() / collapsed.min() - 1
        yield TEXTS("speed", limit=collapsed.iloc[0], first=value[0], last=value[-1], spread=spread)
    if len(angles) > 1:
        yield TEXTS("angle", first=angles.iloc[0], last=angles.iloc[-1])
    for name in dict.fromkeys(threshold["scene"] for threshold in result.thresholds):
        first, *_, last = (threshold for threshold in result.thresholds if threshold["scene"] == name)
        yield TEXTS("threshold", scene=name, first=first, last=last, gain=gain)


def _range(values: Any) -> tuple[float, float]:
    return float(values.min()), float(values.max())
