"""Effects are those of known similarity laws, of the right body, with the right sign; windows keep reflections out."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.errors import UsageError
from dem_bridge.scene import Scene, Wall
from dem_bridge.studies.model_hierarchy.passage import (
    JUDGED,
    OBSERVABLES,
    Effect,
    Reading,
    checked_observables,
    decided,
    effect,
    effects,
    known,
    largest,
    last_counted,
    read,
)
from dem_bridge.trajectory import Trajectory
from dem_bridge.verification.verdict import Outcome

BODIES = 12
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


def readings(scene: Scene, *, whole: bool = False) -> dict[str, Reading]:
    return read(scene, solved(scene), float(solved(CHAIN).crossing_time[-1]), whole=whole)


def test_effects_are_those_of_the_scaling_with_the_start_velocity() -> None:
    # v0 -> s v0 takes times with s^-1/5, velocities with s, forces with s^6/5; the runs' bars are 1e-12
    s = 1.05
    found = effects(readings(CHAIN), readings(replace(CHAIN, velocity=(s * 0.8, *CHAIN.velocity[1:]))))
    expected = {
        "arrival": s**-0.2 - 1.0, "residence": s**-0.2 - 1.0, "peak_velocity": s - 1.0, "peak_force": s**1.2 - 1.0,
    }  # fmt: skip
    assert {name: found[name].value for name in JUDGED} == pytest.approx(expected, rel=1e-6)
    assert all(one.bar < 1e-6 for one in found.values())
    back = effects(readings(replace(CHAIN, velocity=(s * 0.8, *CHAIN.velocity[1:]))), readings(CHAIN))
    assert all(math.copysign(1.0, back[name].value) == -math.copysign(1.0, found[name].value) for name in JUDGED)


def test_the_worst_body_is_the_one_that_is_another() -> None:
    mass = list(CHAIN.mass)
    mass[6] *= 1.02
    other = replace(CHAIN, mass=tuple(mass))
    found, mine, theirs = effects(readings(CHAIN), readings(other)), solved(CHAIN), solved(other)
    residence = np.diff(theirs.crossing_time) / np.diff(mine.crossing_time) - 1.0
    worst = int(np.argmax(np.abs(residence[: last_counted(CHAIN)])))
    assert (found["residence"].at, found["residence"].value) == (worst + 1, pytest.approx(residence[worst], rel=1e-9))
    assert found["residence"].at == found["peak_velocity"].at == 6
    assert found["peak_velocity"].value < 0.0 < found["residence"].value
    # until contacts behind the front press again, the largest force is that of the front
    force = theirs.peak_force / mine.peak_force - 1.0
    place = int(np.argmax(np.abs(force)))
    assert found["peak_force"].at == place
    assert found["peak_force"].value == pytest.approx(force[place], rel=1e-6)


def test_a_base_is_not_seen_before_the_front_is_there_and_is_afterwards() -> None:
    base = replace(CHAIN, wall_right=Wall(stiffness=2e10))
    found = effects(readings(CHAIN), readings(base))
    # 1e-3 in chains of 40, a share of the last residence time alone, of which there are as many as bodies
    assert 1e-3 < abs(found["arrival"].value) < 5e-3
    assert max(abs(found[name].value) for name in OBSERVABLES if name != "arrival") < 1e-3
    # the reflection comes back within these runs: without the window it is there
    whole = effects(readings(CHAIN, whole=True), readings(base, whole=True))
    assert abs(whole["velocity"].value) > 0.5
    assert abs(whole["peak_velocity"].value) > 0.2
    assert (whole["peak_velocity"].at, last_counted(CHAIN)) == (BODIES - 1, BODIES - 3)


def test_the_force_of_the_front_is_the_peak_where_nothing_comes_after_it() -> None:
    run, found = solved(CHAIN), readings(CHAIN)["peak_force"]
    np.testing.assert_allclose(found.values, run.peak_force[: len(found.values)], rtol=1e-7)
    apart = np.abs(found.values - run.peak_force[: len(found.values)])
    assert np.all(apart <= found.bars)
    theory = db.solve(CHAIN, backend="bca")
    np.testing.assert_array_equal(
        read(CHAIN, theory, 1.0)["peak_force"].values, theory.peak_force[: last_counted(CHAIN) + 1]
    )


def test_a_run_of_another_scene_is_not_read() -> None:
    with pytest.raises(ValueError, match=r"^a run of 'uniform' is read as one of 'other'$"):
        read(replace(CHAIN, name="other", duration=2e-4), solved(CHAIN), 1.0)


def _reading(*values: float, bar: float = 0.0) -> Reading:
    return Reading(values=np.array(values), bars=np.full(len(values), bar), first=1)


def test_what_only_one_run_has_is_infinitely_far_away_and_what_neither_has_does_not_count() -> None:
    nan = math.nan
    found = effect("residence", _reading(1.0, nan), _reading(1.1, nan))
    assert (found.value, found.bar, found.at) == (pytest.approx(0.1), 0.0, 1)
    for one, other in (((1.0, 2.0), (1.0, nan)), ((1.0, nan), (1.0, 2.0))):
        found = effect("residence", _reading(*one, bar=1e-9), _reading(*other, bar=math.inf))
        assert (found.value, found.at) == (math.inf, 2)
    nothing = effect("residence", _reading(nan), _reading(nan))
    assert not known(nothing)
    assert not known(effect("arrival", _reading(), _reading()))
    bars = _reading(2.0, bar=0.02), _reading(2.2, bar=0.04)
    assert effect("residence", *bars).bar == pytest.approx(0.03)
    assert effect("residence", *bars, one_sided=True).bar == pytest.approx(0.01)


def test_what_is_little_is_measured_by_the_chain() -> None:
    # the second contact hardly feels anything: a thousandth of the largest is its scale
    found = effect("peak_force", _reading(100.0, 1e-6), _reading(101.0, 2e-6))
    assert (found.value, found.at) == (pytest.approx(0.01), 1)


def test_one_observable_beyond_decides_and_an_unknown_one_does_not() -> None:
    inside, outside = Effect(value=-0.009, bar=1e-6, at=1), Effect(value=-0.011, bar=1e-6, at=2)
    doubtful, absent = Effect(value=0.0099, bar=2e-4, at=3), Effect(value=math.nan, bar=math.nan, at=-1)
    found = {"arrival": absent, "residence": inside, "peak_velocity": outside, "peak_force": doubtful}
    assert decided(found, ("arrival", "residence"), 0.01) is Outcome.PASS
    assert decided(found, ("residence", "peak_force"), 0.01) is Outcome.UNDECIDED
    assert decided(found, JUDGED, 0.01) is Outcome.FAIL
    assert largest(found, JUDGED) == ("peak_velocity", outside)
    endless = {"arrival": Effect(value=math.inf, bar=0.0, at=-1)}
    assert decided(endless, ("arrival",), 0.01) is Outcome.FAIL


@pytest.mark.parametrize("names", ["arrival", (), ("speed",), None, 3])
def test_observables_that_are_none_are_refused_in_one_line(names: object) -> None:
    with pytest.raises(UsageError, match=r"^observables = .*; allowed: a list of arrival, residence, .*velocity$"):
        checked_observables(names)
