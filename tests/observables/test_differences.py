"""Differences with a named scale, on trajectories whose difference is known by construction.

Relative differences are those computed by hand, in windows, norms and where values are missing.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dem_bridge.errors import UsageError
from dem_bridge.observables.differences import (
    ALL,
    REDUCTIONS,
    Readings,
    Window,
    at_common_times,
    compare_runs,
    difference,
    explained_difference,
    first_divergence,
    read,
    relative_error,
    relative_to,
    relative_uncertainty,
)
from dem_bridge.observables.observable import LARGEST, Observable
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats, Trajectory
from tests.helpers.fake_runs import free_flight, uncertain
from tests.helpers.registered import MEAN_VELOCITY, registered
from tests.helpers.strategies import log_uniform

EPS = float(np.finfo(float).eps)


def _changed(run: Trajectory, quantity: str, where: Any, by: float) -> Trajectory:
    values = getattr(run, quantity).copy()
    values[where] += by
    changes: dict[str, Any] = {quantity: values}
    return replace(run, **changes)


@pytest.mark.parametrize("quantity", ["velocity", "displacement", "peak_force", "crossing_time"])
def test_a_run_does_not_differ_from_itself(quantity: str) -> None:
    assert difference(quantity, free_flight(), free_flight()).value == 0.0


@given(row=st.integers(0, 4), body=st.integers(0, 2), by=log_uniform(1e-9, 1e3), sign=st.sampled_from([-1.0, 1.0]))
def test_the_largest_difference_is_found_with_its_place(row: int, body: int, by: float, sign: float) -> None:
    reference = free_flight()
    found = difference("velocity", _changed(reference, "velocity", (row, body), sign * by), reference)
    # the largest |velocity| of the reference is 3 m/s; the sum rounds to an ulp of it or of the change
    assert found.value == pytest.approx(by / 3.0, abs=EPS * (1.0 + by))
    assert (found.body, found.time) == (body, reference.time[row])
    assert (found.scale, found.unit) == (3.0, "m/s")
    assert found.scale_name == "largest |velocity| of the reference"


def test_a_displacement_is_measured_by_the_largest_of_the_reference() -> None:
    reference = free_flight()
    found = difference("displacement", _changed(reference, "displacement", (2, 0), 0.6), reference)
    assert (found.value, found.unit, found.body, found.time) == (pytest.approx(0.2), "m", 0, 0.5)


def test_the_scale_is_the_references_and_not_the_runs() -> None:
    reference = free_flight()
    run = replace(reference, velocity=2.0 * reference.velocity)
    assert difference("velocity", run, reference).value == pytest.approx(1.0)
    assert difference("velocity", reference, run).value == pytest.approx(0.5)


def test_peaks_and_crossings_are_measured_by_each_contacts_own() -> None:
    reference = free_flight()  # peaks of 10 and 20 N, crossings at 0.1 and 0.2 s
    run = _changed(_changed(reference, "peak_force", 0, 1.0), "peak_force", 1, -1.5)
    found = difference("peak_force", run, reference)
    assert (found.value, found.body, found.unit) == (pytest.approx(0.1), 0, "N")
    assert math.isnan(found.time)
    late = difference("crossing_time", _changed(reference, "crossing_time", 1, 0.05), reference)
    assert (late.value, late.body, late.unit) == (pytest.approx(0.25), 1, "s")


def test_a_crossing_that_only_one_has_is_infinitely_far() -> None:
    lost = free_flight(crossing_time=[0.1, math.nan])
    for one, other in ((lost, free_flight()), (free_flight(), lost)):
        found = difference("crossing_time", one, other)
        assert (found.value, found.body) == (math.inf, 1)
    assert difference("crossing_time", lost, lost).value == 0.0


def test_bars_of_both_are_relative_to_the_same_scale() -> None:
    reference = free_flight(uncertainty=uncertain(velocity=0.3, peak_force=[0.1, 0.4]))
    run = free_flight(uncertainty=uncertain(velocity=0.6, peak_force=[0.5, 0.2]))
    found = difference("velocity", run, reference)
    assert (found.uncertainty, found.reference_uncertainty) == (pytest.approx(0.2), pytest.approx(0.1))
    peaks = difference("peak_force", run, reference)
    # the worst contact of each: 0.5 of 10 N, 0.4 of 20 N
    assert (peaks.uncertainty, peaks.reference_uncertainty) == (pytest.approx(0.05), pytest.approx(0.02))


def test_a_scene_at_rest_agrees_with_itself_and_with_nothing_that_moves() -> None:
    rest = free_flight(velocity=np.zeros((5, 3)))
    assert difference("velocity", rest, rest).value == 0.0
    assert difference("velocity", free_flight(), rest).value == math.inf


def test_a_scene_without_contacts_has_no_difference_of_forces() -> None:
    run = free_flight(contacts=0)
    assert difference("peak_force", run, run).value == difference("crossing_time", run, run).value == 0.0


@pytest.mark.parametrize("other", [{"samples": 5}, {"duration": 2.0}], ids=str)
def test_other_times_are_refused(other: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match="samples at different times; solve both with the same samples"):
        difference("velocity", free_flight(), free_flight(**other))


def test_what_a_trajectory_does_not_store_is_compared_with_its_scene() -> None:
    scene = Scene(name="three", duration=1.0, mass=(1.0, 1.0, 1.0), stiffness=(1.0, 1.0), velocity=(1.0, 2.0, 3.0))
    run = _changed(free_flight(), "crossing_time", 1, 0.01)  # 0.1 and 0.2 s
    residence = difference("residence_time", run, free_flight(), scene)
    assert (residence.value, residence.scale, residence.place) == (pytest.approx(0.1), pytest.approx(0.1), "body 1")
    end = difference("arrival_at_end", run, free_flight(), scene)
    assert (end.value, end.scale, end.place, end.body) == (pytest.approx(0.05), 0.2, "", -1)
    momentum = difference("momentum", _changed(free_flight(), "velocity", (3, 2), 0.9), free_flight(), scene)
    # over the mass of 3 kg times 3 m/s
    assert (momentum.value, momentum.time, momentum.place) == (pytest.approx(0.1), 0.75, "")
    with pytest.raises(UsageError, match=r"^the observable energy needs the scene of the runs; give scene=\.\.\.$"):
        difference("energy", run, free_flight())


def test_a_quantity_that_does_not_exist_is_refused() -> None:
    with pytest.raises(UsageError, match=r"observable = 'speed'; allowed: velocity, displacement, .*residence_time"):
        difference("speed", free_flight(), free_flight())


def test_another_number_of_bodies_is_refused_as_such() -> None:
    with pytest.raises(UsageError, match="bodies"):
        difference("velocity", free_flight(), free_flight(bodies=4))


def test_round_off_in_a_contact_that_is_never_pressed_is_no_difference() -> None:
    # so it is for LAMMPS beside scipy where touching bodies fly together: 3e-19 N against 0 N
    reference = free_flight(peak_force=[10.0, 0.0])
    assert difference("peak_force", free_flight(peak_force=[10.0, 1e-20]), reference).value < 1e-12


def test_the_first_divergence_is_the_first_sample_beyond_the_tolerance() -> None:
    reference = free_flight()
    run = _changed(_changed(reference, "velocity", (2, 1), 0.031), "velocity", (4, 0), 1.0)
    assert first_divergence(run, reference, 0.01) == (0.5, 1)
    assert first_divergence(run, reference, 0.02) == (1.0, 0)
    assert first_divergence(run, reference, 0.5) is None


def test_a_difference_within_both_uncertainties_is_no_divergence() -> None:
    reference = free_flight()  # the largest velocity is 3 m/s
    # a trace ahead of the front, far below the round-off, and then a difference beyond the uncertainties
    run = _changed(_changed(reference, "velocity", (1, 2), 5.6e-18), "velocity", (3, 1), 1e-3)
    first, second = (
        replace(each, uncertainty=uncertain(velocity=size)) for each, size in ((run, 3e-6), (reference, 6e-6))
    )
    assert explained_difference(first, second) == pytest.approx(3e-6)
    assert compare_runs(first, second, explained_difference(first, second)).divergence == (0.75, 1)
    unknown = replace(reference, uncertainty=uncertain(velocity=math.inf))
    assert explained_difference(unknown, unknown) == 1e-12
    assert compare_runs(run, unknown, 1e-12).divergence == (0.75, 1)


def test_a_divergence_exactly_at_the_tolerance_is_none() -> None:
    reference = free_flight(velocity=np.full((5, 3), 4.0))
    assert first_divergence(_changed(reference, "velocity", (1, 1), 1.0), reference, 0.25) is None


def test_a_velocity_that_is_no_number_diverges() -> None:
    reference = free_flight()
    assert first_divergence(_changed(reference, "velocity", (3, 2), math.nan), reference, 0.1) == (0.75, 2)


def test_contact_forces_are_compared_at_all_samples_and_have_no_bar() -> None:
    one = free_flight()
    found = difference("contact_force", one, _changed(one, "contact_force", (2, 1), 5.0))
    assert (found.value, found.scale, found.body, found.unit) == (1.0, 5.0, 1, "N")
    assert math.isinf(found.uncertainty)


@pytest.mark.parametrize("every", [2, 4])
def test_runs_are_compared_at_the_times_that_both_have(every: int) -> None:
    fine = free_flight(samples=8)
    coarse = free_flight(samples=8 // every)
    common = at_common_times(fine, coarse)
    assert common is not None
    mine, _, notes = common
    assert np.array_equal(mine.time, coarse.time)
    np.testing.assert_array_equal(mine.velocity, fine.velocity[::every])
    np.testing.assert_array_equal(mine.displacement, fine.displacement[::every])
    assert f"their {8 // every + 1} common sample times up to 1 s, of 9 and {8 // every + 1} samples" in notes[0]
    assert compare_runs(coarse, fine).samples == 8 // every + 1


@given(off=log_uniform(1e-16, 1e-8), row=st.integers(1, 8))
def test_times_that_are_rounded_are_the_same(off: float, row: int) -> None:
    reference = free_flight(samples=8)
    time = reference.time.copy()
    time[row] += off
    common = at_common_times(replace(reference, time=time), reference)
    assert common is not None
    mine, other, notes = common
    assert np.array_equal(mine.time, other.time)
    assert len(mine.time) == 9
    assert bool(notes) == bool(time[row] != reference.time[row])


@pytest.mark.parametrize("lost", range(1, 9))
def test_a_sample_that_one_lacks_is_left_out_and_the_rest_stays_in_step(lost: int) -> None:
    reference = free_flight(samples=8)
    kept = np.delete(np.arange(9), lost)
    parts = {name: getattr(reference, name)[kept] for name in ("time", "displacement", "velocity", "contact_force")}
    found = compare_runs(replace(reference, **parts), reference)
    assert found.samples == 8
    assert found.divergence is None
    assert all(one.value == 0.0 for one in found.differences)


def _swinging(samples: int, duration: float = 1.0) -> Trajectory:
    """Return a run in which body i swings as sin((i + 1) t), sampled at other times than another."""
    time, rate = np.linspace(0.0, duration, samples + 1)[:, None], np.arange(1.0, 4.0)
    moved = {"displacement": np.sin(rate * time) / rate, "velocity": np.cos(rate * time)}
    return free_flight(samples=samples, duration=duration, contact_force=np.sin(time) * np.ones((1, 2)), **moved)


@pytest.mark.parametrize(("samples", "duration"), [(37, 1.0), (40, 1.01), (90, 0.97)])
@pytest.mark.parametrize("swapped", [False, True])
def test_runs_at_other_times_are_interpolated_and_the_error_is_said(
    samples: int, duration: float, swapped: bool
) -> None:
    runs = [_swinging(60), _swinging(samples, duration)]
    first, second = runs[::-1] if swapped else runs
    compared = compare_runs(first, second, 1e-3)
    which = "first" if (samples < 60) != swapped else "second"
    assert compared.notes[0].startswith(f"the sample times differ: the {which} run is interpolated (Hermite) at the ")
    assert set(compared.interpolation) == {"displacement", "velocity", "contact_force"}
    for entry in compared.differences:
        if entry.quantity in compared.interpolation:
            # both are the same motion: all of the difference is the interpolation's, and the estimate covers it
            assert entry.value * entry.scale <= compared.interpolation[entry.quantity] < 1e-4, entry.quantity
    assert (compared.divergence, compared.undecided) == (None, False)


def test_a_difference_below_the_interpolation_error_is_undecided_and_a_larger_one_is_not() -> None:
    run, reference = _swinging(60), _swinging(37)
    error = compare_runs(run, reference, 1e-3).interpolation["velocity"]
    assert compare_runs(run, reference, 0.1 * error).undecided
    changed = replace(reference, velocity=reference.velocity * (1.0 + 10.0 * error))
    found = compare_runs(run, changed, 2.0 * error)
    assert found.divergence is not None
    assert not found.undecided
    assert compare_runs(run, changed, 10.0 * error).undecided
    # the difference is below the tolerance, but not by more than the error of the interpolation
    assert compare_runs(run, changed, 10.5 * error).undecided
    assert compare_runs(run, changed, 20.0 * error).divergence is None


@pytest.mark.parametrize("samples", [1, 2])
def test_runs_of_too_few_samples_at_other_times_are_refused(samples: int) -> None:
    with pytest.raises(UsageError, match=r"have \d samples in a common interval of time; allowed: at least 4 of each"):
        compare_runs(free_flight(samples=samples, duration=0.93), free_flight(duration=1.0))


def test_what_one_does_not_know_is_said_and_not_compared() -> None:
    reference = free_flight()
    nothing = np.full_like(reference.velocity, math.nan)
    blind = replace(
        reference,
        velocity=nothing,
        crossing_time=np.full(2, math.nan),
        uncertainty=uncertain(crossing_time=math.inf),
    )
    found = compare_runs(blind, reference)
    assert found.unknown == tuple(
        f"{name} is not compared, because it is unknown in the first run" for name in ("velocity", "crossing_time")
    )
    assert [one.quantity for one in found.differences] == ["displacement", "contact_force", "peak_force"]
    assert found.divergence is None
    # a contact that is never pressed has no crossing time either, and that is known
    never = replace(reference, crossing_time=np.full(2, math.nan))
    assert "crossing_time" in [one.quantity for one in compare_runs(never, never).differences]


def test_any_bit_is_a_divergence_unless_a_tolerance_is_given() -> None:
    reference = free_flight()
    run = _changed(reference, "velocity", (3, 1), 4 * EPS)
    assert compare_runs(run, reference).divergence == (0.75, 1)
    assert compare_runs(run, reference, 1e-12).divergence is None
    with pytest.raises(UsageError, match="tolerance = -1"):
        compare_runs(run, reference, -1.0)


@pytest.mark.parametrize(
    ("peaks", "whose"), [((True, False), "the first run"), ((True, True), "the first run and the second run")]
)
def test_peaks_of_samples_are_said_to_be_so(peaks: tuple[bool, bool], whose: str) -> None:
    first, second = (
        free_flight(provenance={"backend": "file"} | ({"peaks": "samples"} if one else {})) for one in peaks
    )
    assert compare_runs(first, second).notes == (f"the peak forces of {whose} come from samples and may be too low",)


def test_runs_of_two_scenes_are_compared_with_a_word_of_warning() -> None:
    one, other = (
        free_flight(provenance={"backend": "fake", "scene": name, "scene_hash": name}) for name in ("this", "that")
    )
    assert compare_runs(one, other).notes == ("the runs are of different scenes, this and that",)
    assert compare_runs(one, one).notes == ()


def test_readings_read_each_observable_of_each_run_once() -> None:
    times: Counter[int] = Counter()

    def value(scene: Scene, run: Trajectory) -> Floats:
        times[id(run)] += 1
        return MEAN_VELOCITY.value(scene, run)

    scene = Scene(name="three", duration=1.0, mass=(1.0,) * 3, stiffness=(1.0,) * 2, velocity=(1.0, 2.0, 3.0))
    run, other = free_flight(), free_flight(velocity=1.5 * free_flight().velocity)
    with registered(replace(MEAN_VELOCITY, value=value)) as observable:
        readings = Readings(scene)
        found = [readings.difference(observable.name, a, b).value for a, b in ((run, other), (other, run), (run, run))]
    assert found == pytest.approx([1 / 3, 0.5, 0.0], rel=1e-12)
    assert times == {id(run): 1, id(other): 1}


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
