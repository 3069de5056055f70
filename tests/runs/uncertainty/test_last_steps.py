"""What happens in the last steps of a run, or in its first one, happens in all further runs alike."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.backends.base import backend, unsupported_reason
from dem_bridge.backends.prescan import prescan_hertz
from dem_bridge.runs.uncertainty import fixed_step, grazes, moments, readings
from dem_bridge.runs.uncertainty.fixed_step import largest_drag, summation_part
from dem_bridge.scene.scene import Adhesion, Damping, Scene, Wall
from dem_bridge.trajectory.trajectory import QUANTITIES
from tests.helpers.decimal_chain import solve_exactly
from tests.helpers.last_touches import last_touch, recorded
from tests.helpers.twin_families import family

#: it touches the second body after 1e-5 s; the third one is in touch with the second
THREE = Scene(
    name="three", duration=1.0001e-5, mass=(1e-3, 2e-3, 1e-3), velocity=(0.1, 0.0, 0.0), stiffness=(1e9, 1e9),
    gap=(1e-6, 0.0), samples=7,
)  # fmt: skip
DASHPOT = Damping(law="dashpot", coefficient=5.0)


def outside(scene: Scene, code: str = "verlet", **settings: Any) -> dict[str, float]:
    """Return the quantities outside of their uncertainty, in uncertainties."""
    run = db.solve(scene, backend=code, **settings)
    return {name: ratio for name, ratio in solve_exactly(scene).ratios(run).items() if ratio > 1.0}


@pytest.mark.parametrize(("after", "damping"), [(1e-12, None), (1e-9, DASHPOT), (1e-12, DASHPOT), (-1e-12, DASHPOT)])
def test_a_touch_at_the_end_presses_the_bodies_behind_it(damping: Damping | None, after: float) -> None:
    scene = replace(THREE, damping=damping, duration=1e-5 + after)
    truth = solve_exactly(scene)
    for dt in (1e-8, 1e-7):
        assert max(truth.ratios(db.solve(scene, backend="verlet", dt=dt)).values()) <= 1.0


def test_the_force_of_the_last_step_would_be_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = replace(THREE, damping=DASHPOT)
    monkeypatch.setattr(moments, "RECENT", 0.0)
    assert {"peak_force", "displacement"} <= set(outside(scene, dt=1e-7))


def test_a_force_that_is_handed_on_would_be_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    nobody = grazes.HandedOn(np.zeros(0, dtype=int), np.zeros(0), np.zeros(0, dtype=bool))
    monkeypatch.setattr(grazes, "force_handed_on", lambda *about: nobody)
    assert "peak_force" in outside(replace(THREE, damping=DASHPOT), dt=1e-7)


def test_a_dashpot_that_only_a_coarse_run_feels_may_have_no_force(monkeypatch: pytest.MonkeyPatch) -> None:
    # the bodies touch after the end, and with steps that are too long before it
    scene = Scene(
        name="late", duration=1.259e-3, mass=(0.12, 0.065), velocity=(0.089, 0.0), stiffness=(1.4e7,), exponent=2.0,
        gap=0.0, damping=Damping(law="dashpot", coefficient=100.0), wall_right=Wall(stiffness=2.7e6, gap=1.0),
        drag=870.0, samples=7,
    )  # fmt: skip
    assert scene.wall_right is not None
    way = recorded(scene)[1].displacement[-1]
    scene = replace(scene, wall_right=replace(scene.wall_right, gap=way * (1.0 + 1e-9)))
    run = db.solve(scene, backend="verlet", dt=1e-6)
    assert run.peak_force[1] > 1.0
    assert outside(scene, dt=1e-6) == {}
    monkeypatch.setattr(grazes, "OWN_PEAK", np.inf)
    assert "peak_force" in outside(scene, dt=1e-6)


def test_bodies_that_fall_in_touch_drift_by_round_off(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(7)
    scenes = [
        Scene(name="fall", duration=1e-4, mass=tuple(10.0 ** rng.uniform(-4, -2, 5)), velocity=(0.0,) * 5,
              stiffness=(1e8,) * 4, exponent=2.0, gravity=-float(rng.uniform(10, 100)), samples=2)
        for _ in range(3)
    ]  # fmt: skip
    assert [outside(scene, "ase", dt=2e-8) for scene in scenes] == [{}] * 3
    by_ase, by_twin = (db.solve(scenes[0], backend=code, dt=2e-8).uncertainty for code in ("ase", "verlet"))
    assert np.all(np.isinf(by_ase["crossing_time"]))
    assert np.all(np.isfinite(by_twin["crossing_time"]))
    monkeypatch.setattr(readings, "drift_in_flight", lambda *about: np.zeros(4))
    blind = db.solve(scenes[0], backend="ase", dt=2e-8).uncertainty
    assert np.all(np.isfinite(blind["crossing_time"]))
    assert np.all(blind["peak_force"] < 1e-3 * by_ase["peak_force"])


def test_forces_of_drag_are_terms_of_running_sums() -> None:
    # 2, 4 and 8 kg at 1, 2 and 3 m/s: sqrt(14 kg 90 J)
    slowed = family(scene=replace(family().scene, drag=3.0))
    assert largest_drag(slowed) == pytest.approx(3.0 * np.sqrt(14.0 * 90.0), rel=1e-12)
    more = summation_part(slowed, 0.0)["peak_force"] - summation_part(family(), 0.0)["peak_force"]
    assert more == pytest.approx(4.0 * 2.0**-52 * largest_drag(slowed), rel=1e-12)
    assert summation_part(slowed, None) == summation_part(family(), None)


#: DMT adhesion as strong as the collision, and a viscous force that hides the impulse which the first step misses
STICKY = Scene(
    name="sticky", duration=0.4, mass=(0.0036, 0.01777), velocity=(1.461e-3, 0.0), stiffness=(151.3,), gap=8.776e-8,
    damping=Damping(law="kuwabara-kono", coefficient=0.0552, clip=False),
    adhesion=Adhesion(law="dmt", pull_off=9.04e-5), samples=1,
)  # fmt: skip


def test_a_force_that_jumps_in_the_first_step_is_late_in_all_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    truth, run = solve_exactly(STICKY), db.solve(STICKY, backend="verlet", dt=5e-4)
    assert max(truth.ratios(run).values()) <= 1.0
    monkeypatch.setattr(fixed_step, "early_touch_part", lambda family: dict.fromkeys(QUANTITIES, 0.0))
    assert truth.ratios(db.solve(STICKY, backend="verlet", dt=5e-4))["crossing_time"] > 1.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("code", "drag"),
    [("verlet", True), ("ase", False), pytest.param("lammps-granular", True, marks=pytest.mark.lammps)],
)
def test_many_runs_that_end_near_a_touch(code: str, drag: bool) -> None:
    found, runs = [], 0
    for seed in range(150):
        scene = last_touch(seed, drag=drag)
        if scene is None or unsupported_reason(backend(code), scene):
            continue
        prescan = prescan_hertz(scene)
        if prescan.frequency * scene.duration > 60.0:
            continue
        for phase in (2.5e-3, 2.5e-2):
            runs += 1
            if off := outside(scene, code, dt=phase / prescan.frequency):
                found.append((seed, phase, off))
    assert runs >= 100
    assert found == []
