"""Components of the reference: steps on clocks of their own, touches between them, and planted faults."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.backends import reference, taylor, taylor_components
from dem_bridge.backends.scales import natural_scales
from dem_bridge.backends.taylor_series import Event
from dem_bridge.foundation.compiled import Kernel
from dem_bridge.scene.scene import Scene

QUANTITIES = ("velocity", "displacement", "peak_force", "crossing_time")
#: two pairs that collide at the same time and then, while both are compressed, with each other
PAIRS = Scene(
    name="pairs", duration=6e-5, mass=(0.01, 0.007, 0.012, 0.009), stiffness=(2e10, 3e10, 1e10), samples=12,
    velocity=(0.7, 0.0, 0.0, -0.5), gap=(0.0, 2e-6, 0.0),
)  # fmt: skip


def _gas(bodies: int, gravity: float = 0.0) -> Scene:
    speeds = tuple(np.random.default_rng(bodies).uniform(-0.5, 0.5, bodies))
    return Scene(
        name="gas", duration=2e-4, mass=(0.01,) * bodies, stiffness=(2e10,) * (bodies - 1), velocity=speeds,
        samples=40, gravity=gravity,
    )  # fmt: skip


def _interpreted(scene: Scene, calls: dict[str, int]) -> np.ndarray[Any, Any]:
    """Return the velocities of a run without the compiler, in which planted functions are called."""
    speed, depth = natural_scales(scene)
    *tables, _ = reference.chain_tables(scene, 1.0, 1e-12 * depth)
    bodies, contacts, components = (table.view(np.recarray) for table in tables)
    times = np.linspace(0.0, scene.duration, scene.samples + 1)
    calls.clear()
    settings = (28, 1e-16, speed, 100_000)
    return taylor.integrate.interpret(bodies, contacts, components, times, *settings)[1]


def _planted(calls: dict[str, int], original: Kernel[..., Any], fault: Callable[..., Any]) -> Callable[..., Any]:
    def function(*arguments: Any) -> Any:
        result = original(*arguments)
        changed = fault(result, *arguments)
        calls["changed"] = calls.get("changed", 0) + (changed != result)
        return changed

    return function


def _missed(result: Any, contact: int, _: float, chain: Any) -> Any:
    both = chain.bodies[contact].owner >= 0 and chain.bodies[contact + 1].owner >= 0
    return (np.inf, False) if both else result


#: module and function, and what becomes of its result
FAULTS = {
    "a merge that starts only one of the two anew": (taylor, "meet", lambda result, j, *_: (j, result[1])),
    "a touch between two components is missed": (taylor_components, "next_touch", _missed),
    "a split that is too late": (
        taylor_components, "next_event",
        lambda result, *_: (1.3 * result[0], *result[1:]) if result[1] == Event.OPENS else result,
    ),
}  # fmt: skip


def test_two_compressed_pairs_that_meet_are_those_of_scipy() -> None:
    mine, other = db.solve(PAIRS, backend="reference"), db.solve(PAIRS, backend="scipy")
    for quantity in QUANTITIES:
        apart = np.abs(getattr(mine, quantity) - getattr(other, quantity))
        assert np.all(apart <= mine.uncertainty[quantity] + other.uncertainty[quantity]), quantity
    assert np.max(mine.contact_force[-1]) > 0.0 or mine.provenance["openings"] > 0


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_in_the_clocks_is_far_outside_of_the_uncertainty(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    right, calls = db.solve(PAIRS, backend="scipy"), dict[str, int]()
    assert np.max(np.abs(_interpreted(PAIRS, calls) - right.velocity)) <= 10.0 * right.uncertainty["velocity"]
    module, function, fault = FAULTS[name]
    monkeypatch.setattr(module, function, _planted(calls, getattr(module, function), fault))
    wrong = _interpreted(PAIRS, calls)
    assert calls["changed"] > 0
    assert not np.max(np.abs(wrong - right.velocity)) <= 1e3 * right.uncertainty["velocity"]


@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_a_gas_is_that_of_scipy(gravity: float) -> None:
    scene = _gas(24, gravity)
    mine, other = db.solve(scene, backend="reference"), db.solve(scene, backend="scipy")
    for quantity in QUANTITIES:
        apart = np.abs(getattr(mine, quantity) - getattr(other, quantity))
        bars = mine.uncertainty[quantity] + other.uncertainty[quantity]
        assert np.all(np.nan_to_num(apart) <= bars), quantity


def test_forces_of_samples_are_those_of_their_overlaps() -> None:
    scene = _gas(64)
    run = db.solve(scene, backend="reference", uncertainty=False)
    overlap = run.displacement[:, :-1] - run.displacement[:, 1:]
    force = 2e10 * np.maximum(overlap, 0.0) ** 1.5
    assert np.max(np.abs(run.contact_force - force)) <= 1e-12 * np.max(force)


def test_steps_of_distant_chains_do_not_depend_on_each_other() -> None:
    """A pair takes as many steps beside others as alone: no clock is common to them."""

    def steps(pairs: int) -> int:
        bodies = 2 * pairs
        gap = tuple(0.0 if j % 2 == 0 else 1.0 for j in range(bodies - 1))
        return db.solve(
            Scene(
                name="apart", duration=1e-4, mass=(0.01,) * bodies, stiffness=(2e10,) * (bodies - 1), gap=gap,
                velocity=tuple((0.1 + 0.01 * (i // 2)) * (i % 2 == 0) for i in range(bodies)), samples=3,
            ),
            backend="reference",
            uncertainty=False,
        ).cost.steps  # fmt: skip

    assert steps(20) <= 1.2 * 20 * steps(1)


def test_a_contact_too_faint_for_the_last_coefficients_has_long_steps() -> None:
    # closing at 5e-26 m/s the last coefficients are 0 in doubles: a step of one unit of r ended where it began
    scene = Scene(
        name="faint", duration=1e-5, mass=(6.6e-5,) * 3, stiffness=(5e10,) * 2, velocity=(3e-6, 5e-26, 0.0),
        gap=(1e-3, 5e-32), samples=4,
    )  # fmt: skip
    run = db.solve(scene, backend="reference", uncertainty=False)
    assert run.cost.steps < 100
    np.testing.assert_allclose(run.velocity[-1, :2], [3e-6, 5e-26], rtol=1e-10)
    # the force of a contact that has closed for the whole time gives less than this, m/s
    overlap = 5e-26 * scene.duration
    assert 0.0 < run.velocity[-1, 2] < 5e10 * overlap**1.5 * scene.duration / 6.6e-5
