"""The parts of the stability study, each read from the store where the same code has measured it before."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Any, TypeVar

from dem_bridge.backends.lammps_motion import Granular, granular
from dem_bridge.backends.twin import solve_motion
from dem_bridge.errors import BackendUnavailable
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.pair_coefficients import GRANULAR_STYLE
from dem_bridge.lmp.process import require
from dem_bridge.runs.recall import recall
from dem_bridge.runs.store import Store
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.stability.points import (
    CURVE,
    GAINS,
    MASS,
    PHASES,
    SHARES,
    STEPS,
    STIFFNESS,
    Family,
    Measured,
    Trap,
    chain,
    engine_on,
    gain_map,
    measured,
    point_of,
    stable_at,
    trap_of,
)
from dem_bridge.studies.stability.step_limits import Stepper
from dem_bridge.trajectory.trajectory import Floats
from dem_bridge.verification.roles import GRANULAR, TWIN

Value = TypeVar("Value")


@dataclass(kw_only=True)
class Results:
    """Results so far; an interrupted study has those that were finished."""

    points: list[dict[str, Any]] = field(default_factory=list)
    """Results of :func:`point_of`."""
    thresholds: list[dict[str, Any]] = field(default_factory=list)
    """Limits by scene and permissible ``share`` of growth of the energy, in units of 1/omega of the highest mode."""
    gains: Floats | None = None
    """``(n_phase, n_step)`` of two bodies."""
    traps: list[Trap] = field(default_factory=list)
    curve: list[Trap] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    interrupted: bool = False


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What every part depends on, and where parts are kept."""

    gain: float
    """Permissible growth of the energy, relative to the energy in motion."""
    engine: Engine
    store: Store | None = None

    def kept(
        self, part: str, compute: Callable[[], Value], scene: Scene, *, lammps: bool = False, **settings: object
    ) -> Value:
        """Return a part from the store, or compute and keep it; ``settings``: all that it depends on beside the scene.

        ``lammps``: the engine is asked, too.
        """
        engine = self.engine if lammps else None
        how: dict[str, Any] = {"scenes": [scene], "engine": engine, **settings}
        return recall(self.store, f"stability: {part}", [], compute, kinds=[Trap], **how)

    def unavailable_reason(self) -> str:
        """Return the reason why LAMMPS cannot run, '' if it can; an engine that could before is not started."""
        ask: Callable[[], int] = lambda: require(self.engine, "pair granular").version  # noqa: E731
        try:
            recall(self.store, "stability: version of LAMMPS", [], ask, engine=self.engine)
        except BackendUnavailable as error:
            return str(error)
        return ""


def measure(scene: Scene, chosen: Sequence[Family], result: Results, settings: Settings) -> Iterator[str]:
    """Measure all of it into ``result``; yield the name of each part before it is measured."""
    yield "LAMMPS"
    reason = settings.unavailable_reason()
    if reason:
        result.notes.append(f"LAMMPS was not run: {reason}.")
    with ExitStack() as resources:
        lammps = cache(lambda: resources.enter_context(granular(settings.engine)))
        for family in chosen:
            some = {0, len(family.values) // 2, len(family.values) - 1}
            for i, value in enumerate(family.values.tolist()):
                yield f"{family.id} = {value:.3g}"
                there = {"family": family.id, "value": value}
                result.points.append(_point(family.scene_at(value), there, settings, lammps, not reason and i in some))
        yield scene.name
        expressible = GRANULAR_STYLE.unsupported_reason(scene)
        if expressible and not reason:
            result.notes.append(f"LAMMPS was not run on {scene.name}: {expressible}.")
        whole = cache(lambda: measured(scene))
        with_engine = not (reason or expressible)
        point = _point(scene, {}, settings, lammps, with_engine, whole)
        result.points.append(point)
        yield "thresholds"
        _thresholds(whole, scene, result, settings)
        yield "trap"
        limit = float(point["stable"])
        compute = lambda: _traps(whole(), limit, engine_on(whole(), lammps()) if with_engine else None)  # noqa: E731
        steps = {"limit": limit, "curve": list(CURVE), "shares": list(SHARES)}
        result.curve, result.traps = settings.kept("trap", compute, scene, lammps=with_engine, **steps)


def _point(
    scene: Scene,
    there: dict[str, Any],
    settings: Settings,
    lammps: Callable[[], Granular],
    with_engine: bool,
    whole: Callable[[], Measured] | None = None,
) -> dict[str, Any]:
    """Return the limits of a scene; ``there``: its family and value."""

    def compute() -> dict[str, Any]:
        item = measured(scene) if whole is None else whole()
        stepper = engine_on(item, lammps()) if with_engine else None
        return point_of(item, **there, allowed=settings.gain, engine=stepper)

    return settings.kept("point", compute, scene, lammps=with_engine, gain=settings.gain, **there)


def _thresholds(whole: Callable[[], Measured], scene: Scene, result: Results, settings: Settings) -> None:
    """Measure how the limits of three scenes depend on the permissible growth, and the growth of two bodies."""
    pair, row = chain("two-equal", (MASS, MASS), (STIFFNESS,)), chain("five-equal", (MASS,) * 5, (STIFFNESS,) * 4)
    of_pair = cache(lambda: measured(pair))

    def limits(of: Callable[[], Measured], share: float) -> dict[str, float]:
        stable, _ = stable_at(of(), share)
        return {"omega_dt": of().mode * stable.good, "window": of().mode * stable.window}

    for item, of in ((pair, of_pair), (row, cache(lambda: measured(row))), (scene, whole)):
        for share in GAINS:
            numbers = settings.kept("threshold", partial(limits, of, share), item, share=share)
            result.thresholds.append({"scene": item.name, "share": share} | numbers)
    grid = {"steps": STEPS.tolist(), "phases": PHASES.tolist()}
    result.gains = settings.kept("gains", lambda: gain_map(of_pair(), STEPS, PHASES), pair, **grid)


def _traps(whole: Measured, limit: float, lammps: Stepper | None) -> tuple[list[Trap], list[Trap]]:
    """Return the runs of the twin at steps up to the limit (s), and those of the table, with LAMMPS where it can."""
    curve, table = [trap_of(whole, solve_motion, TWIN, float(limit / share)) for share in CURVE], []
    for dt in (float(f"{limit / share:.0e}") for share in SHARES):
        table.append(trap_of(whole, solve_motion, TWIN, dt))
        if lammps is not None:
            table.append(trap_of(whole, lammps, GRANULAR, dt))
    return curve, table
