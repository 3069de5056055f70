"""Study of order: order reduction at contact onset, errors at given tolerances, and exact condition numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.blanes_moan import SRKN_6B
from dem_bridge.backends.ode45 import Ode45
from dem_bridge.backends.reference import SERIES, Reference
from dem_bridge.backends.scales import natural_scales
from dem_bridge.backends.scipy_dop853 import ScipyDop853
from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.physics.touch_error import touch_coefficient
from dem_bridge.report.study import FigureData, Series, Study, Table
from dem_bridge.runs.campaign import Jobs, Progress, run_cases
from dem_bridge.runs.case import Case
from dem_bridge.runs.recall import recall
from dem_bridge.runs.store import Store
from dem_bridge.scene.file import load_scene
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.order import touch
from dem_bridge.studies.order.conditioning import PARAMETERS, ConditionNumber, conditions, verdict
from dem_bridge.studies.order.touch import TEXTS, ChainErrors, PairErrors
from dem_bridge.trajectory.trajectory import Floats

TOLERANCES = tuple(10.0**-k for k in range(3, 14))
ORDERS_COLUMNS = (
    "case", "exponent n", "predicted order", "measured order", "C, predicted", "C, measured", "order of the rest",
)  # fmt: skip
CHAIN_ORDERS_COLUMNS = (
    "run", "openings and closings", "order", "smallest over half", "largest over half", "steps fitted",
    "largest error", "smallest error",
)  # fmt: skip
TOLERANCES_COLUMNS = ("integrator", "tolerance", "velocity error", "force evaluations")
CONDITIONING_COLUMNS = {
    "observable": "observable", "parameter": "parameter", "exact": "exact", "measured": "by differences",
    "difference": "largest deviation", "uncertainty": "uncertainty of the differences",
}  # fmt: skip


#: absolute over relative tolerance of ode45, m and m/s
ATOL_PER_RTOL = 1e-3


@dataclass(frozen=True, kw_only=True)
class Row:
    """One run of one integrator."""

    name: str
    """Key of its texts: an integrator of :data:`INTEGRATORS`."""
    tolerance: float
    error: float
    """Largest velocity error of all samples and bodies, over the largest velocity."""
    evaluations: float
    """Of all contact forces; for a Taylor series, the orders computed."""


def _taylor(scene: Scene, sampling: Sampling, tolerance: float) -> tuple[Floats, int]:
    run = Reference().solve_series(scene, sampling, accuracy=tolerance)
    return run.velocity, run.cost.force_evaluations


def _located(scene: Scene, sampling: Sampling, tolerance: float) -> tuple[Floats, int]:
    run = ScipyDop853(largest_rtol=1.0).run(scene, Resolution(rtol=tolerance), sampling)
    return run.velocity, run.cost.force_evaluations


def _ode45(scene: Scene, sampling: Sampling, tolerance: float) -> tuple[Floats, int]:
    run = Ode45().run(scene, Resolution(rtol=tolerance, atol=ATOL_PER_RTOL * tolerance), sampling)
    return run.velocity, run.cost.force_evaluations


def _unlocated(scene: Scene, sampling: Sampling, tolerance: float) -> tuple[Floats, int]:
    """Return a run of scipy's DOP853 that steps across openings and closings; variables and scales as in `scipy`."""
    from scipy.integrate import solve_ivp

    from dem_bridge.backends.scipy_integration import ATOL_SHARE

    c, n, inverse = scene.contacts, scene.n_body, 1.0 / np.append(scene.mass, np.inf)
    free, power = np.append(scene.free_acceleration, 0.0), c.exponent - 1.0
    speed, depth = natural_scales(scene)

    def slope(t: float, y: Floats) -> Floats:
        force, velocity = c.stiffness * np.maximum(y[:-n], 0.0) ** power, np.append(y[-n:], 0.0)
        acceleration = free.copy()
        np.subtract.at(acceleration, c.left, force * inverse[c.left])
        np.add.at(acceleration, c.right, force * inverse[c.right])
        return np.concatenate([velocity[c.left] - velocity[c.right], acceleration[:n]])

    start = np.concatenate([-c.gap, scene.velocity])
    absolute = np.maximum(ATOL_SHARE * tolerance * np.concatenate([depth, np.full(n, speed)]), 1e-300)
    times = sampling.times(scene.duration)
    run = solve_ivp(slope, (0.0, scene.duration), start, method="DOP853", rtol=tolerance, atol=absolute, t_eval=times)
    if not run.success:
        raise RunBroken(f"DOP853 on {scene.name}: {run.message}")
    return run.y[-n:].T, run.nfev


#: name -> run; the first two locate openings and closings
INTEGRATORS = {"taylor": _taylor, "located": _located, "unlocated": _unlocated, "ode45": _ode45}


def tolerance_rows(scene: Scene, sampling: Sampling, exact: Floats) -> Iterator[Row]:
    """Yield the errors of every integrator at every tolerance; ``exact``: velocities of the reference."""
    scale = float(np.max(np.abs(exact)))
    for name, run in INTEGRATORS.items():
        for tolerance in TOLERANCES:
            velocity, evaluations = run(scene, sampling, tolerance)
            error = float(np.max(np.abs(velocity - exact))) / scale
            yield Row(name=name, tolerance=tolerance, error=error, evaluations=float(evaluations))


DEFAULT_SCENE = "decelerating-40"
#: velocity errors whose cost is stated
TARGETS = (1e-4, 1e-6, 1e-9)
#: tolerance at which errors are stated
STATED = 1e-9
#: drawing styles, by keys of the texts: two bodies with circles, crosses on the step grid, and a square without a touch
STYLES = {
    "hertz_within": "nth/1/1",
    "hertz_grid": "nth/1/2",
    "linear_within": "nth/0/1",
    "linear_grid": "nth/0/2",
    "closed": "nth/2/4",
    "taylor": "curve/reference",
    "located": "curve/scipy",
    "unlocated": "curve/scipy/both",
    "ode45": "curve/ode45/both",
}
#: exponents whose touch error is measured at every place of the touch within its step
LAWS, FINE_PHASES = (2.0, 2.5), np.linspace(0.0, 1.0, 145)


def study_order(
    scene: Scene | None = None,
    *,
    jobs: Jobs = None,
    progress: Progress | None = None,
    store: Store | None = None,
) -> Study:
    """Measure the order at contact onset, errors at given tolerances, and condition numbers.

    The order is measured on two bodies, whose error is known in closed form, and on the scene. Condition numbers follow
    from the scaling laws and are checked by runs of the reference.

    Parameters
    ----------
    scene : Scene, optional
        Scene with power-law contacts, without damping, drag or a drive. None: decelerating-40.
    jobs, progress, store : as in :func:`dem_bridge.study`

    Returns
    -------
    Study

    Raises
    ------
    UsageError
        For a scene that the Taylor series do not cover, or in which nothing moves.
    RunBroken
        If the reference has no run.
    """
    scene = load_scene(DEFAULT_SCENE) if scene is None else scene
    reason = SERIES.unsupported_reason(scene) or (None if scene.drive is None else "the scene has a drive")
    if reason is not None or not any(scene.velocity):
        raise UsageError(f"study order of {scene.name}: {reason or 'nothing moves; allowed: a scene with an impact'}")
    say = progress or (lambda done, total, label: None)
    sampling = Sampling(count=scene.samples)
    case = Case(scene=scene, backend=touch.REFERENCE, resolution=Resolution(), sampling=sampling)
    (result,) = run_cases([case], store=store)
    if result.trajectory is None:
        raise RunBroken(f"{scene.name}: without a run of the reference nothing has an error ({result.failure})")
    velocity = result.trajectory.velocity
    bar = result.trajectory.uncertainty["velocity"] / float(np.max(np.abs(velocity)))
    say(0, 4, "two bodies")
    pairs = recall(store, "order: two bodies", [], _pairs, kinds=[PairErrors])
    laws = recall(store, "order: coefficients", [], lambda: {law: touch.coefficients(law) for law in LAWS})
    say(1, 4, f"{scene.name}: orders")
    chains = recall(
        store, "order: chains", [], lambda: list(touch.chain_errors(scene)), kinds=[ChainErrors], scenes=[scene]
    )
    say(2, 4, f"{scene.name}: tolerances")
    errors = lambda: list(tolerance_rows(scene, sampling, velocity))  # noqa: E731
    rows = recall(store, "order: tolerances", [case.key], errors, kinds=[Row], scenes=[scene])
    say(3, 4, f"{scene.name}: condition numbers")
    dissimilar = touch.SIMILAR.unsupported_reason(scene)
    numbers = () if dissimilar else conditions(scene, jobs=jobs, store=store)
    say(4, 4, "")
    observables = dict.fromkeys(number.observable for number in numbers)
    verdicts = (
        *map(touch.order_verdict, pairs.values()),
        *(touch.coefficient_verdict(exponent, *law) for exponent, law in laws.items()),
        *(verdict(scene, [item for item in numbers if item.observable == name]) for name in observables),
    )
    limits: dict[str, Any] = {"floor": touch.CHAIN_FLOOR, "coarse": touch.COARSE}
    answer = [*_order_answer(scene, pairs, laws, chains), *_tolerance_answer(rows)]
    if numbers:
        answer.append(TEXTS("conditioning", **_largest(numbers)))
    else:
        answer.append(TEXTS("not_similar", scene=scene.name, reason=dissimilar))
    return TEXTS.study(
        {"scene": scene.name, "bar": bar, **limits},
        answer=tuple(answer),
        tables=tuple(_tables(pairs, chains, numbers, rows, limits)),
        figures=(_touch_figure(pairs, laws), _chain_figure(scene, chains), _tolerance_figure(scene, rows)),
        verdicts=verdicts,
        provenance={"scene": scene.name, "scene_hash": scene.content_hash},
    )


def _tables(
    pairs: Mapping[str, PairErrors],
    chains: Sequence[ChainErrors],
    numbers: Sequence[ConditionNumber],
    rows: Sequence[Row],
    limits: Mapping[str, Any],
) -> Iterator[Table]:
    yield TEXTS.table("orders", ORDERS_COLUMNS, map(_pair_row, pairs.values()))
    yield TEXTS.table("chain-orders", CHAIN_ORDERS_COLUMNS, map(_chain_row, chains), **limits)
    yield TEXTS.table("conditioning", CONDITIONING_COLUMNS, numbers)
    errors = ((TEXTS(row.name), row.tolerance, row.error, row.evaluations) for row in rows)
    yield TEXTS.table("tolerances", TOLERANCES_COLUMNS, errors)


def _pairs() -> dict[str, PairErrors]:
    """Return the errors of two bodies, by the name of their touch."""
    return {name: touch.pair_errors(name, exponent, phase) for name, exponent, phase in touch.PAIRS}


def _pair_row(pair: PairErrors) -> tuple[str | float, ...]:
    measured = pair.measured if pair.phase is not None else math.nan
    numbers = (pair.predicted_order, pair.order, pair.coefficient, measured, pair.left)
    return (TEXTS(pair.name), pair.exponent, *numbers)


def _chain_row(chain: ChainErrors) -> tuple[str | float, ...]:
    steps, errors = chain.clean
    ends = (float(errors.max()), float(errors.min())) if len(errors) else (math.nan, math.nan)
    return (chain.label, float(chain.touches), chain.order, *chain.windows, float(len(steps)), *ends)


def _order_answer(
    scene: Scene,
    pairs: Mapping[str, PairErrors],
    laws: Mapping[float, tuple[Floats, Floats]],
    chains: Sequence[ChainErrors],
) -> Iterator[str]:
    keys = {"within": "hertz_within", "grid": "hertz_grid", "closed": "closed", "spring": "linear_grid"}
    chosen = {name: pairs[key] for name, key in keys.items()}
    yield TEXTS("pairs", **chosen)
    verlet, chain, *others = chains
    yield TEXTS("chain_order", scene=scene.name, chain=chain, verlet=verlet)
    parts = [TEXTS("exponent", chain=item) for item in _touching(chains)]
    yield TEXTS("exponents", parts=", ".join(parts))
    for item in others:
        if not item.touches:
            yield TEXTS("pressed_order", chain=item)
    measured, predicted = laws[2.5]
    worst = float(np.max(np.abs(measured - predicted)) / np.max(np.abs(predicted)))
    yield TEXTS("coefficient", count=len(predicted), worst=worst)
    yield TEXTS("left", **chosen)


def _tolerance_answer(rows: Sequence[Row]) -> Iterator[str]:
    runs = {name: [row for row in rows if row.name == name] for name in INTEGRATORS}
    for target in TARGETS:
        parts = []
        for name, items in runs.items():
            enough = [row.evaluations for row in items if row.error <= target]
            text = TEXTS("part", evaluations=min(enough), name=TEXTS(name)) if enough else ""
            parts.append(text or TEXTS("part_none", name=TEXTS(name)))
        yield TEXTS("cheapest", target=target, parts=", ".join(parts))
    stated = (row for row in rows if row.tolerance == STATED)
    parts = [TEXTS("achieved_part", error=row.error, name=TEXTS(row.name)) for row in stated]
    yield TEXTS("achieved", tolerance=STATED, parts=", ".join(parts))
    both = list(zip(runs["located"], runs["unlocated"], strict=True))
    gains = np.array([located.error / unlocated.error for located, unlocated in both])
    costs = np.array([located.evaluations / unlocated.evaluations for located, unlocated in both])
    spans = {"low": gains.min(), "high": gains.max(), "middle": np.median(gains)}
    yield TEXTS("located_gain", **spans, cost_low=costs.min(), cost_high=costs.max())


def _largest(numbers: Sequence[ConditionNumber]) -> dict[str, list[float]]:
    """Return the magnitudes of condition numbers of times, forces and velocities, one for each parameter."""
    exact = {(number.observable, number.parameter): abs(number.exact) for number in numbers}
    names = {"time": "arrival", "force": "first_peak_force", "velocity": "velocity"}
    return {name: [exact[observable, item] for item in PARAMETERS] for name, observable in names.items()}


def _touch_figure(pairs: Mapping[str, PairErrors], laws: Mapping[float, tuple[Floats, Floats]]) -> FigureData:
    curves: list[Series] = []
    for colour, (exponent, (measured, _)) in enumerate(laws.items()):
        law = [touch_coefficient(*SRKN_6B, exponent=exponent, phase=phase) for phase in FINE_PHASES.tolist()]
        values = {"exponent": exponent}
        curves.append(
            Series(
                label=TEXTS("closed_form", **values),
                style=f"line/{colour}/{3 * colour}",
                x=FINE_PHASES,
                y=np.array(law),
            )
        )
        curves.append(Series(label=TEXTS("runs", **values), style=f"nth/{colour}/1", x=touch.PHASES, y=measured))
    lines: list[Series] = []
    for name, pair in pairs.items():
        order_4 = abs(pair.errors[0]) * (pair.steps / pair.steps[0]) ** 4.0
        term = np.abs(pair.predicted) if pair.coefficient else order_4
        clear = np.abs(pair.errors) > touch.FLOOR
        lines.append(Series(label=TEXTS("law"), style="guide", x=pair.steps[clear], y=term[clear]))
        errors = np.abs(pair.errors[clear])
        lines.append(Series(label=TEXTS(name), style=STYLES[name], x=pair.steps[clear], y=errors))
    return TEXTS.figure(
        "order-touch", (TEXTS.panel("coefficient", curves, tall=True), TEXTS.panel("pair", lines, log=True, tall=True))
    )


def _chain_figure(scene: Scene, chains: Sequence[ChainErrors]) -> FigureData:
    verlet, chain, *others = chains
    shown = [verlet, chain, *(item for item in others if not item.touches)]
    styles = ("curve/verlet", "curve/blanes-moan", "nth/2/4")
    errors = [
        Series(label=item.label, style=style, x=item.steps, y=item.errors)
        for item, style in zip(shown, styles, strict=False)
    ]
    touching = _touching(chains)
    law = np.linspace(2.0, 4.0, 41)
    orders = np.array([item.order for item in touching])
    points = (
        Series(label=TEXTS("smaller"), style="guide", x=law, y=np.minimum(law, 4.0)),
        Series(label=TEXTS("measured"), style="nth/1/1", x=np.array([item.exponent for item in touching]), y=orders),
    )
    return TEXTS.figure(
        "order-chain",
        (TEXTS.panel("chain", errors, scene=scene.name, log=True, tall=True), TEXTS.panel("order", points, tall=True)),
    )


def _touching(chains: Sequence[ChainErrors]) -> list[ChainErrors]:
    """Return the chains of the method of order 4 in which contacts open or close, by exponent."""
    return sorted((item for item in chains[1:] if item.touches), key=lambda item: item.exponent)


def _tolerance_figure(scene: Scene, rows: Sequence[Row]) -> FigureData:
    panels = []
    for id, cost in (("tolerance", "tolerance"), ("evaluations", "evaluations")):
        series = []
        for name in INTEGRATORS:
            x, y = np.array([[getattr(row, cost), row.error] for row in rows if row.name == name]).T
            series.append(Series(label=TEXTS(name), style=STYLES[name], x=x, y=y))
        if id == "tolerance":
            ends = np.array([TOLERANCES[-1], TOLERANCES[0]])
            series.append(Series(label=TEXTS("equal"), style="guide", x=ends, y=ends))
        panels.append(TEXTS.panel(id, series, log=True, tall=True))
    return TEXTS.figure("order-tolerance", panels, scene=scene.name)
