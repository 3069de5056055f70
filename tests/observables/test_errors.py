"""Relative differences are those computed by hand, in windows, norms and where values are missing."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dem_bridge.errors import UsageError
from dem_bridge.observables.errors import (
    ALL,
    REDUCTIONS,
    Window,
    read,
    relative_error,
    relative_to,
    relative_uncertainty,
)
from dem_bridge.observables.observable import LARGEST, Observable
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory
from tests.helpers.fake_runs import free_flight, uncertain

SCENE = Scene(name="three", duration=1.0, mass=(1.0, 1.0, 1.0), stiffness=(1.0, 1.0), velocity=(1.0, 2.0, 3.0))


def changed(quantity: str, where: Any, by: float) -> Trajectory:
    run = free_flight()
    values = getattr(run, quantity).copy()
    values[where] += by
    return replace(run, **{quantity: values})


def test_norms_are_those_of_all_places() -> None:
    run = changed("velocity", (slice(None), 1), 0.3)  # one body of three, over the largest velocity of 3 m/s
    found = {name: relative_error("velocity", SCENE, run, free_flight(), reduce=name) for name in REDUCTIONS}
    assert found == pytest.approx({"max": 0.1, "rms": 0.1 / math.sqrt(3.0), "mean": 0.1 / 3.0}, rel=1e-12)


def test_a_window_leaves_out_what_is_later_or_elsewhere() -> None:
    reference = free_flight()  # samples at 0, 0.25, ... 1 s
    late, elsewhere = changed("velocity", (4, 0), 3.0), changed("velocity", (0, 2), 3.0)
    assert relative_error("velocity", SCENE, late, reference, Window(until=0.75)) == 0.0
    assert relative_error("velocity", SCENE, late, reference, Window(until=1.0)) == 1.0
    # without the last body the largest velocity is 2 m/s
    inside = Window(bodies=range(2))
    assert relative_error("velocity", SCENE, elsewhere, reference, inside) == 0.0
    assert relative_error("velocity", SCENE, late, reference, inside) == 1.5
    assert (
        relative_error("peak_force", SCENE, changed("peak_force", 0, 1.0), reference, Window(contacts=range(1, 2)))
        == 0.0
    )
    assert (inside.first("body"), Window(bodies=range(2, 3)).first("body"), ALL.first("contact")) == (0, 2, 0)


def test_a_time_is_relative_to_that_of_its_own_body() -> None:
    run = changed("crossing_time", 0, 0.01)  # contact 0 at 0.1 s, contact 1 at 0.2 s
    errors = relative_to(read("arrival", SCENE, free_flight()), read("arrival", SCENE, run))
    np.testing.assert_allclose(errors.values, [np.nan, 0.1, 0.0], rtol=1e-12)
    assert errors.worst == (1,)
    assert relative_error("arrival_at_end", SCENE, run, free_flight()) == 0.0


def test_differences_have_their_sign() -> None:
    early = changed("crossing_time", 1, -0.02)
    errors = relative_to(read("arrival_at_end", SCENE, free_flight()), read("arrival_at_end", SCENE, early))
    assert errors.values == pytest.approx(-0.1)
    assert errors.reduced() == pytest.approx(0.1)
    assert errors.worst == ()


def test_what_only_one_run_has_is_infinitely_far_and_what_none_has_does_not_count() -> None:
    whole, never = free_flight(), free_flight(crossing_time=[0.1, math.nan])
    for run, reference in ((whole, never), (never, whole)):
        errors = relative_to(read("crossing_time", SCENE, reference), read("crossing_time", SCENE, run))
        assert errors.values.tolist() == [0.0, math.inf]
        assert (errors.worst, errors.reduced("mean")) == ((1,), math.inf)
    assert relative_error("crossing_time", SCENE, never, never) == 0.0
    assert math.isnan(relative_error("arrival_at_end", SCENE, never, never))
    nothing = read("arrival_at_end", SCENE, never)
    assert relative_to(nothing, nothing).worst is None


def test_samples_that_are_no_numbers_agree_with_nothing() -> None:
    lost = changed("velocity", (2, 1), math.nan)
    assert relative_error("velocity", SCENE, lost, free_flight()) == math.inf
    assert relative_error("velocity", SCENE, lost, lost) == math.inf


def test_nothing_is_nothing_of_nothing_and_anything_else_infinite() -> None:
    still = free_flight(velocity=np.zeros((5, 3)))
    assert relative_error("velocity", SCENE, still, still) == 0.0
    assert relative_error("velocity", SCENE, free_flight(), still) == math.inf


def test_an_uncertainty_is_relative_to_the_same_scale_and_counts_where_there_is_a_value() -> None:
    bars = uncertain(velocity=0.3, crossing_time=[0.01, 5.0])
    run = free_flight(uncertainty=bars)
    assert relative_uncertainty("velocity", SCENE, run) == pytest.approx(0.1)
    assert relative_uncertainty("crossing_time", SCENE, run) == pytest.approx(25.0)
    never = replace(run, crossing_time=np.array([0.1, np.nan]))
    assert relative_uncertainty("crossing_time", SCENE, never) == pytest.approx(0.1)
    unknown = free_flight(uncertainty=uncertain(crossing_time=[np.nan, 0.0]))
    assert relative_uncertainty("crossing_time", SCENE, unknown) == math.inf


def _own(value: Callable[[Scene, Trajectory], np.ndarray], **changes: Any) -> Observable:
    return replace(OBSERVABLES["peak_force"], value=value, uncertainty=value, **changes)


def test_any_observable_will_do_whether_registered_or_not() -> None:
    double = _own(lambda scene, run: 2.0 * run.peak_force, name="double", scale=LARGEST)
    # 20 and 40 N
    run = changed("peak_force", 0, 1.0)
    assert relative_error(double, SCENE, run, free_flight()) == pytest.approx(2.0 / 40.0)


def test_runs_of_different_numbers_of_samples_or_bodies_are_refused() -> None:
    with pytest.raises(UsageError, match=r"^velocity of runs with \(3, 3\) and \(5, 3\) values along time, body;"):
        relative_error("velocity", SCENE, free_flight(samples=2), free_flight())
