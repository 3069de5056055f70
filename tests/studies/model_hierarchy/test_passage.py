"""Effects are those of known similarity laws, of the right body, with the right sign; windows keep reflections out."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.errors import UsageError
from dem_bridge.observables.differences import ALL, Reading, Window
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.observables.verdict import Outcome
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.studies.model_hierarchy.passage import (
    JUDGED,
    Effect,
    Readings,
    checked_observables,
    decided,
    effect,
    effects,
    first_counted,
    largest,
    last_counted,
    readings_of,
    window_of,
)
from dem_bridge.trajectory.relative import own_scale
from dem_bridge.trajectory.trajectory import Trajectory

BODIES = 12
PASSAGE = JUDGED["passage"]
NAMES = (*PASSAGE, "velocity", "peak_force")
CHAIN = Scene(
    name="uniform",
    duration=3e-4,
    mass=(0.01,) * BODIES,
    stiffness=(2e10,) * (BODIES - 1),
    velocity=(0.8,) + (0.0,) * (BODIES - 1),
)


@cache
def solved(scene: Scene) -> Trajectory:
    return db.solve(scene, backend="reference", samples=600)


def readings(scene: Scene, *, whole: bool = False) -> Readings:
    window = window_of(scene, float(solved(CHAIN).crossing_time[-1]), whole=whole)
    return readings_of(scene, solved(scene), window, NAMES)


def test_effects_are_those_of_the_scaling_with_the_start_velocity() -> None:
    # v0 -> s v0 takes times with s^-1/5, velocities with s, forces with s^6/5; the runs' bars are 1e-12
    s = 1.05
    found = effects(readings(CHAIN), readings(replace(CHAIN, velocity=(s * 0.8, *CHAIN.velocity[1:]))))
    expected = {
        "arrival_at_end": s**-0.2 - 1.0, "residence_time": s**-0.2 - 1.0, "peak_velocity": s - 1.0,
        "first_peak_force": s**1.2 - 1.0,
    }  # fmt: skip
    assert {name: found[name].value for name in PASSAGE} == pytest.approx(expected, rel=1e-6)
    assert all(one.uncertainty < 1e-6 for one in found.values())
    back = effects(readings(replace(CHAIN, velocity=(s * 0.8, *CHAIN.velocity[1:]))), readings(CHAIN))
    assert all(math.copysign(1.0, back[name].value) == -math.copysign(1.0, found[name].value) for name in PASSAGE)


def test_the_worst_body_is_the_one_that_is_another() -> None:
    mass = list(CHAIN.mass)
    mass[6] *= 1.02
    other = replace(CHAIN, mass=tuple(mass))
    found, mine, theirs = effects(readings(CHAIN), readings(other)), solved(CHAIN), solved(other)
    residence = np.diff(theirs.crossing_time) / np.diff(mine.crossing_time) - 1.0
    worst = int(np.argmax(np.abs(residence[: last_counted(CHAIN)])))
    held = found["residence_time"]
    assert (held.at, held.value) == (worst + 1, pytest.approx(residence[worst], rel=1e-9))
    assert held.at == found["peak_velocity"].at == 6
    assert found["peak_velocity"].value < 0.0 < held.value
    # until contacts behind the front press again, the largest force is that of the front
    force = theirs.peak_force / mine.peak_force - 1.0
    place = int(np.argmax(np.abs(force)))
    assert found["first_peak_force"].at == place
    assert found["first_peak_force"].value == pytest.approx(force[place], rel=1e-6)


def test_a_base_is_not_seen_before_the_front_is_there_and_is_afterwards() -> None:
    base = replace(CHAIN, wall_right=Wall(stiffness=2e10))
    found = effects(readings(CHAIN), readings(base))
    # 1e-3 in chains of 40, a share of the last residence time alone, of which there are as many as bodies
    assert 1e-3 < abs(found["arrival_at_end"].value) < 5e-3
    assert max(abs(found[name].value) for name in (*PASSAGE[1:], "velocity")) < 1e-3
    # the reflection comes back within these runs: without the window it is there
    whole = effects(readings(CHAIN, whole=True), readings(base, whole=True))
    assert abs(whole["velocity"].value) > 0.5
    assert abs(whole["peak_velocity"].value) > 0.2
    assert (whole["peak_velocity"].at, last_counted(CHAIN)) == (BODIES - 1, BODIES - 3)


def test_the_force_of_the_front_is_the_peak_where_nothing_comes_after_it() -> None:
    run, found = solved(CHAIN), readings(CHAIN)["first_peak_force"]
    counted = slice(first_counted(CHAIN), last_counted(CHAIN) + 1)
    np.testing.assert_allclose(found.values, run.peak_force[counted], rtol=1e-7)
    apart = np.abs(found.values - run.peak_force[counted])
    assert np.all(apart <= found.uncertainty)
    theory = db.solve(CHAIN, backend="bca")
    np.testing.assert_array_equal(
        readings_of(CHAIN, theory, window_of(CHAIN, 1.0), ["first_peak_force"])["first_peak_force"].values,
        theory.peak_force[counted],
    )


def test_what_the_striker_forms_does_not_count_and_is_read_apart() -> None:
    """A softer contact of the striker moves the first residence times, and those behind them much less."""
    softer = replace(CHAIN, stiffness=(0.5 * CHAIN.stiffness[0], *CHAIN.stiffness[1:]))
    assert first_counted(CHAIN) == 5
    counted = effects(readings(CHAIN), readings(softer))["residence_time"]
    window = window_of(CHAIN, float(solved(CHAIN).crossing_time[-1]), start=True)
    assert (window.bodies, window.contacts) == (range(5), range(5))
    start = effects(*(readings_of(scene, solved(scene), window, ["residence_time"]) for scene in (CHAIN, softer)))
    assert abs(start["residence_time"].value) > 5.0 * abs(counted.value)
    assert start["residence_time"].at < 5 <= counted.at
    # in shorter chains all bodies count
    few = Scene(name="few", duration=1e-4, mass=(0.01,) * 9, stiffness=(2e10,) * 8, velocity=(0.8,) + (0.0,) * 8)
    assert first_counted(few) == 0


def test_a_run_of_another_scene_is_not_read() -> None:
    with pytest.raises(ValueError, match=r"^a run of 'uniform' is read as one of 'other'$"):
        readings_of(replace(CHAIN, name="other", duration=2e-4), solved(CHAIN), ALL, NAMES)


def _reading(name: str, *values: float, bar: float = 0.0) -> Reading:
    """Values of the bodies or contacts from 1 on."""
    known = np.array(values)
    return Reading(
        observable=OBSERVABLES[name],
        values=known,
        uncertainty=np.where(np.isnan(known), np.nan, bar),
        scale=own_scale(known),
        window=Window(bodies=range(1, 1 + len(values)), contacts=range(1, 1 + len(values))),
    )


_residence = partial(_reading, "residence_time")


def test_what_only_one_run_has_is_infinitely_far_away_and_what_neither_has_does_not_count() -> None:
    nan = math.nan
    found = effect(_residence(1.0, nan), _residence(1.1, nan))
    assert (found.value, found.uncertainty, found.at) == (pytest.approx(0.1), 0.0, 1)
    for one, other in (((1.0, 2.0), (1.0, nan)), ((1.0, nan), (1.0, 2.0))):
        found = effect(_residence(*one, bar=1e-9), _residence(*other, bar=math.inf))
        assert (found.value, found.at) == (math.inf, 2)
    assert not effect(_residence(nan), _residence(nan)).exists
    assert not effect(_residence(), _residence()).exists
    bars = _residence(2.0, bar=0.02), _residence(2.2, bar=0.04)
    assert effect(*bars).uncertainty == pytest.approx(0.03)
    assert effect(*bars, one_sided=True).uncertainty == pytest.approx(0.01)


def test_what_is_little_is_measured_by_the_chain() -> None:
    # the second contact hardly feels anything: a thousandth of the largest is its scale
    found = effect(_reading("peak_force", 100.0, 1e-6), _reading("peak_force", 101.0, 2e-6))
    assert (found.value, found.at) == (pytest.approx(0.01), 1)


def test_one_observable_beyond_decides_and_an_unknown_one_does_not() -> None:
    inside, outside = Effect(value=-0.009, uncertainty=1e-6, at=1), Effect(value=-0.011, uncertainty=1e-6, at=2)
    doubtful, absent = Effect(value=0.0099, uncertainty=2e-4, at=3), Effect(value=math.nan, uncertainty=math.nan, at=-1)
    found = dict(zip(PASSAGE, (absent, inside, outside, doubtful), strict=True))
    assert decided(found, PASSAGE[:2], 0.01) is Outcome.PASS
    assert decided(found, ("residence_time", "first_peak_force"), 0.01) is Outcome.UNDECIDED
    assert decided(found, PASSAGE, 0.01) is Outcome.FAIL
    assert largest(found, PASSAGE) == ("peak_velocity", outside)
    endless = {"arrival_at_end": Effect(value=math.inf, uncertainty=0.0, at=-1)}
    assert decided(endless, ("arrival_at_end",), 0.01) is Outcome.FAIL


@pytest.mark.parametrize("names", ["arrival", (), ("speed",), ("residence",), None, 3])
def test_observables_that_are_none_are_refused_in_one_line(names: object) -> None:
    with pytest.raises(UsageError, match=r"^observables = .*; allowed: a list of velocity, .*energy_less_work$"):
        checked_observables(names)
