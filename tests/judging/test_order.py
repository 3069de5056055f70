"""The order of convergence is that of the integrator, and what cannot be seen has none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dem_bridge.errors import UsageError
from dem_bridge.formats.readers import Record
from dem_bridge.judging.order import Convergence, convergence
from dem_bridge.judging.reference import file_errors
from dem_bridge.scene.scene import Scene
from tests.helpers.judged_records import CHAIN, record

STEPS = (1e-6, 5e-7, 2.5e-7)


#: symplectic Euler is of order 2 in displacements where the start has no acceleration
PRESSED = replace(CHAIN, name="pressed", gap=(-2e-6, 0.0, 0.0, 0.0))


def _orders(records: list[Record], scene: Scene = CHAIN) -> dict[str, Convergence]:
    return {part.quantity: part for part in convergence(file_errors(scene, records))}


@pytest.mark.parametrize(
    ("method", "velocity", "displacement"), [("verlet", 2.0, 2.0), ("euler", 1.0, 1.0), ("leapfrog", 1.0, 2.0)]
)
def test_orders_of_integrators_are_observed(method: str, velocity: float, displacement: float) -> None:
    orders = _orders([record(PRESSED, dt=dt, method=method) for dt in STEPS], PRESSED)
    for name, order in (("velocity", velocity), ("displacement", displacement)):
        found = orders[name].order
        assert found is not None
        assert abs(found.value - order) <= max(0.05, found.uncertainty)
        assert found.uncertainty < 0.1


def test_files_at_other_times_have_the_same_order() -> None:
    uneven = replace(CHAIN, samples=25)
    orders = _orders([record(dt=1e-6), record(uneven, dt=5e-7), record(dt=2.5e-7)])
    found = orders["displacement"].order
    assert found is not None
    assert abs(found.value - 2.0) <= max(0.1, found.uncertainty)


def test_a_wrong_parameter_has_no_order() -> None:
    wrong = replace(CHAIN, stiffness=(4e9, 6e9, 4.5e9, 6e9))
    found = _orders([record(wrong, dt=dt) for dt in STEPS])["velocity"].order
    assert found is not None
    assert abs(found.value) < 0.1


def test_round_off_ends_the_order() -> None:
    def blur(samples: dict[str, np.ndarray]) -> None:
        samples["velocity"] += 1e-6 * np.sin(1e3 * np.arange(5.0))

    steps = (1e-6, 5e-7, 2.5e-7, 1.25e-7, 6.25e-8, 3.125e-8)
    part = _orders([record(dt=dt, change=blur) for dt in steps])["velocity"]
    assert part.order is not None
    assert abs(part.order.value - 2.0) <= max(0.05, part.order.uncertainty)
    assert len(part.order.steps) < len(steps)
    assert 5e-7 < part.flat < 1e-5


def test_digits_that_hide_all_errors_leave_no_order() -> None:
    part = _orders([record(dt=dt, rounding=0.01, quantities=("velocity",)) for dt in STEPS])["velocity"]
    assert part.order is None
    assert all(error <= explained for error, explained in zip(part.errors, part.explained, strict=True))


def test_two_files_of_one_step_and_files_without_common_times_are_refused() -> None:
    with pytest.raises(UsageError, match="verlet-1e-06 and twice have the same time step, 1e-06 s"):
        _orders([record(), record(name="twice")])
    early, late = record(), record(dt=5e-7)
    part = replace(
        late,
        time=late.time + 3e-4,
        values={"velocity": late.values["velocity"]},
    )
    with pytest.raises(UsageError, match=r"ends at 0\.0002 s and .* begins at 0\.0003 s"):
        _orders([early, part])


def test_one_file_has_no_order() -> None:
    assert _orders([record()]) == {}
    assert _orders([record(known=False), record(known=False, method="euler")]) == {}


def test_rounding_averages_out_of_the_order() -> None:
    # six digits: at the finest step rounding is as large as the error of the integrator
    records = [record(dt=dt, rounding=1e-6, quantities=("velocity",)) for dt in (1e-6, 5e-7, 2.5e-7, 1.25e-7)]
    part = _orders(records)["velocity"]
    assert part.order is not None
    assert len(part.order.steps) >= 3
    assert abs(part.order.value - 2.0) <= max(0.05, part.order.uncertainty)
    assert part.order.uncertainty < 0.2
