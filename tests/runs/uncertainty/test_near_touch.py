"""The references' uncertainties hold for contacts whose gaps or grazes are tiny, and for damped contacts that stick."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.backends import scipy_integration
from dem_bridge.errors import RunBroken
from dem_bridge.runs.uncertainty import from_looser_runs as near_turns
from dem_bridge.scene.scene import Scene, Wall
from tests.helpers.decimal_chain import solve_exactly
from tests.helpers.exact_collision import collision
from tests.helpers.near_touch import arrival, graze, soft_graze, sticky, tiny_gaps


def _damped_graze(seed: int) -> Scene | None:
    return graze(seed, damped=True)


#: kind of scene -> its function, the codes that solve it, and a few seeds
KINDS: dict[str, tuple[Callable[[int], Scene | None], tuple[str, ...], Sequence[int]]] = {
    "tiny gaps": (tiny_gaps, ("reference", "scipy"), range(6)),
    "grazes": (graze, ("reference", "scipy"), range(4)),
    "damped grazes": (_damped_graze, ("scipy",), (*range(4), 27, 30, 41)),
    "soft damped grazes": (soft_graze, ("scipy",), (0, 1)),
    "damped arrivals at the end": (arrival, ("scipy",), range(10)),
    "sticking contacts": (sticky, ("scipy",), range(2)),
}


def _outside(kind: str, seeds: Sequence[int]) -> dict[tuple[int, str], dict[str, float]]:
    """Return the quantities outside of their uncertainty, by seed and code."""
    draw, codes, _ = KINDS[kind]
    outside = {}
    for seed in seeds:
        if (scene := draw(seed)) is None:
            continue
        truth = solve_exactly(scene)
        for code in codes:
            try:
                run = db.solve(scene, backend=code)
            except RunBroken as broken:  # below n = 2 contacts that are not clipped may do so
                if "chatters" not in str(broken):
                    raise
                continue
            ratios = truth.ratios(run)
            outside[seed, code] = {name: ratio for name, ratio in ratios.items() if ratio > 1.0}
    assert outside
    return {key: ratios for key, ratios in outside.items() if ratios}


@pytest.mark.parametrize("kind", KINDS)
def test_uncertainties_hold_near_touch(kind: str) -> None:
    assert _outside(kind, KINDS[kind][2]) == {}


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_uncertainties_hold_near_touch_on_many(kind: str) -> None:
    assert _outside(kind, range(6, 90)) == {}


@pytest.mark.parametrize(
    ("kind", "seeds"), [("damped grazes", [27, 30, 41]), ("damped arrivals at the end", range(10))]
)
def test_a_touch_that_no_run_sees_would_be_none(
    kind: str, seeds: Sequence[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(near_turns, "widen_for_near_turns", lambda total, *_: total)
    assert "peak_force" in {name for ratios in _outside(kind, seeds).values() for name in ratios}


@pytest.mark.parametrize("exponent", [1.5, 2.0, 2.5, 3.0, 5.0])
def test_the_decimal_truth_is_that_of_the_closed_form(exponent: float) -> None:
    pair = collision(mass=(1.0, 0.3), velocity=(1.0, 0.1), stiffness=1e9, exponent=exponent, gap=0.3, rest=1.0)
    assert pair is not None
    truth = solve_exactly(pair.scene)
    assert truth.peak_force[0] == pytest.approx(pair.peak_force, rel=1e-15)
    assert truth.crossing_time[0] == pytest.approx(pair.crossing_time, rel=2e-15)
    assert truth.velocity == pytest.approx(pair.velocity, rel=1e-15)
    assert truth.displacement == pytest.approx(pair.displacement, rel=2e-15)


#: three bodies, the last at rest behind a gap that is nothing beside the overlaps
ROW = Scene(
    name="row",
    duration=3e-4,
    mass=(0.02, 0.03, 0.01),
    velocity=(0.5, 0.0, 0.0),
    stiffness=(1e9, 2e9),
    exponent=3.0,
    gap=(0.0, 5e-324),
    samples=3,
)


def _ratios(scene: Scene, code: str) -> dict[str, float]:
    return solve_exactly(scene).ratios(db.solve(scene, backend=code))


@pytest.mark.parametrize("gap", [2.0**-52, 1e-18, 1e-30, 1e-200, 5e-324, 0.0, -5e-324, -1e-30, -1e-17])
@pytest.mark.parametrize("code", ["reference", "scipy"])
def test_a_gap_that_is_nothing_beside_the_overlaps_costs_nothing(gap: float, code: str) -> None:
    scene = replace(ROW, gap=(0.0, gap))
    run = db.solve(scene, backend=code)
    assert max(solve_exactly(scene).ratios(run).values()) <= 1.0
    # with a gap of 1e-30 m the series stood still
    assert run.cost.steps <= 2 * db.solve(replace(ROW, gap=0.0), backend=code, uncertainty=False).cost.steps


def test_an_overlap_that_is_shifted_at_touch_would_be_outside(monkeypatch: pytest.MonkeyPatch) -> None:
    def shifted(contact: int, y: Any, *_: Any) -> None:
        y[contact] = 1e-9 * 1e-4  # of overlaps of 1e-4 m

    assert max(_ratios(ROW, "scipy").values()) <= 1.0
    monkeypatch.setattr(scipy_integration, "put_on_its_side", shifted)
    assert _ratios(ROW, "scipy")["displacement"] > 1.0


def test_forces_that_begin_late_would_be_outside(monkeypatch: pytest.MonkeyPatch) -> None:
    # the series of a contact that is pushed into another begin at 1e-4 of the overlap in place of 1e-12
    monkeypatch.setattr("dem_bridge.backends.reference.TOUCH", 1e-4)
    monkeypatch.setattr("dem_bridge.backends.reference.FORCE", 1e-8)
    # further runs that miss twice as much cover it, and those that miss the same do not
    assert max(_ratios(ROW, "reference").values()) <= 1.0
    monkeypatch.setattr("dem_bridge.backends.reference.SECOND_UNFELT", 1.0)
    assert max(_ratios(ROW, "reference").values()) > 1.0


def test_a_graze_that_no_run_can_see_is_unknown(monkeypatch: pytest.MonkeyPatch) -> None:
    # thrown up by exactly 2^-18 m, a body reaches a wall by 1e-19 m; its weight alone would press it 1e-6 m deep
    wall = Wall(stiffness=1e9, gap=2.0**-18 - 2.0**-63)
    thrown = Scene(
        name="thrown", duration=2e-3, mass=(0.01,), velocity=(2.0**-7,), stiffness=(), wall_right=wall, gravity=-8.0
    )
    assert _ratios(thrown, "reference")["crossing_time"] <= 1.0
    assert _ratios(thrown, "scipy")["crossing_time"] <= 1.0
    monkeypatch.setattr(near_turns, "widen_for_near_turns", lambda total, *_: total)
    assert _ratios(thrown, "scipy")["crossing_time"] == np.inf
