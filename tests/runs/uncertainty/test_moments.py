"""Moments at which a run cannot decide whether a contact closes, or whether its compression is largest."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.backends.base import backend, unsupported_reason
from dem_bridge.backends.prescan import prescan_hertz
from dem_bridge.backends.steps import Dense, approach_of
from dem_bridge.errors import RunBroken
from dem_bridge.runs.uncertainty import moments
from dem_bridge.runs.uncertainty.moments import Moments, read_at, undecided_moments, with_ways
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.dense import Schedule
from tests.helpers.double_compressions import DoubleCompression, double_compression
from tests.helpers.near_touches import NearTouch, arriving, dragged, shaken, thrown

CODES = ("verlet", "blanes-moan", "ase")
#: two bodies of 1 kg
PAIR = Scene(name="pair", duration=1.0, mass=(1.0, 1.0), stiffness=(1.0,), velocity=(1.0, 0.0), gap=1.0, samples=10)
PLAN = Schedule(step=0.01, per_sample=10, subdivisions=10, samples=10)
Motion = Callable[[Any], Any]


def found(overlap: Motion, rate: Motion, bend: Motion, crossing: float = math.nan, **errors: float) -> Moments:
    """Return the undecided moments of a motion of the first body before the second, which is at rest."""
    time = PLAN.dense_steps * PLAN.step

    def first(values: Any) -> Any:
        return np.stack((values * np.ones(len(time)), 0.0 * time, 0.0 * time), axis=1)

    way, none = overlap(time) - overlap(0.0), np.zeros((len(time), 1))
    dense = Dense(first(rate(time)), first(way), first(bend(time)), (overlap(time) * np.ones(len(time)))[:, None], none)
    parts = {"displacement": 1e-3, "velocity": 1e-3} | errors
    return undecided_moments(PAIR, PLAN, dense, approach_of(PAIR, PLAN, dense), np.array([crossing]), **parts)


@pytest.mark.parametrize(("height", "kept"), [(-3.9e-3, True), (-4.1e-3, False), (3.9e-3, True), (4.1e-3, False)])
def test_a_turn_is_undecided_within_four_uncertainties_of_touch(height: float, kept: bool) -> None:
    turn = found(lambda t: height - (t - 0.503) ** 2, lambda t: -2.0 * (t - 0.503), lambda t: -2.0, crossing=0.1)
    assert len(turn) == kept
    if kept:
        assert (turn.time[0], turn.overlap[0], turn.bend[0]) == pytest.approx((0.503, height, 2.0), rel=1e-9)
        assert (turn.touches[0], turn.felt[0], turn.last[0], turn.rate[0]) == (True, height > 0.0, False, 0.0)


def test_a_touch_between_two_open_samples_is_undecided_however_exact_the_run() -> None:
    turn = found(lambda t: 2e-5 - (t - 0.505) ** 2, lambda t: -2.0 * (t - 0.505), lambda t: -2.0, displacement=1e-9)
    assert turn.overlap == pytest.approx([2e-5], rel=1e-6)


def test_what_a_touch_between_two_samples_changes_is_an_error_of_reading() -> None:
    jump = found(
        lambda t: -1e-5 - (t - 0.505) ** 2 - 3e-6 * (t > 0.505), lambda t: -2.0 * (t - 0.505), lambda t: -2.0
    )  # fmt: skip
    assert jump.lost == pytest.approx([3e-6], rel=1e-6)
    smooth = found(lambda t: -1e-5 - (t - 0.505) ** 2, lambda t: -2.0 * (t - 0.505), lambda t: -2.0)
    assert smooth.lost == pytest.approx([0.0], abs=1e-15)


@pytest.mark.parametrize(
    ("overlap", "rate", "bend", "touches"),
    [
        (-1e-3, 0.5, -1.0, True), (1e-3, 0.5, -1.0, True), (-5e-3, 0.5, -1.0, False), (6e-3, 0.5, -1.0, False),
        (-1e-3, -0.5, -1.0, False), (1e-3, 0.01, 1.0, False), (-1e-3, 0.5, 1.0, True), (-1e-3, 0.0, 0.0, False),
        (4e-3, 0.5, -1.0, True), (4e-3, 0.5, 1.0, True), (4e-3, -0.5, -1.0, False),
    ],
    ids=["open", "closed", "far", "deep", "parting", "pressed on", "pulled in", "nothing moves",
         "closed in the last step", "pressed on since the last step", "has opened"],
)  # fmt: skip
def test_a_contact_near_touch_at_the_end_is_undecided(overlap: float, rate: float, bend: float, touches: bool) -> None:
    at_end = found(
        lambda t: overlap + rate * (t - 1.0) + 0.5 * bend * (t - 1.0) ** 2, lambda t: rate + bend * (t - 1.0),
        lambda t: bend, velocity=0.0,
    )  # fmt: skip
    assert at_end.touches[at_end.last].tolist() == [True] * touches


#: a rate of r + (t - 0.503)^2, or its negative, of a contact that is closed
def _pausing(rate: float, sign: float = 1.0) -> tuple[Motion, Motion, Motion]:
    return (
        lambda t: 10.0 + rate * t + sign * ((t - 0.503) ** 3 + 0.503**3) / 3.0,
        lambda t: rate + sign * (t - 0.503) ** 2,
        lambda t: sign * 2.0 * (t - 0.503),
    )


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("rate", "crossing", "kept"),
    [
        (3.9e-3, math.nan, True), (4.1e-3, math.nan, False), (3.9e-3, 0.9, True), (3.9e-3, 0.2, False),
        (-3.9e-3, math.nan, True), (-4.1e-3, math.nan, False), (-3.9e-3, 0.503 - math.sqrt(3.9e-3), True),
    ],
)  # fmt: skip
def test_an_extreme_rate_near_zero_is_undecided_before_the_crossing(
    rate: float, crossing: float, kept: bool, sign: float
) -> None:
    if sign < 0.0 and rate > 0.0 and crossing == 0.9:
        crossing = 0.503 + math.sqrt(3.9e-3)  # it rises above zero, and falls below
    if sign < 0.0 and 0.4 < crossing < 0.5:
        return  # it has not risen above zero
    pause = found(*_pausing(rate, sign), crossing=crossing)
    assert pause.stops.tolist() == [True] * kept
    if kept:
        assert (pause.time[0], pause.rate[0]) == pytest.approx((0.503, rate), rel=1e-9)


def test_a_later_extreme_does_not_belong_to_the_crossing() -> None:
    # crosses at 0.2, opens, and comes near zero once more
    rate = np.polynomial.Polynomial.fromroots([0.2, 0.7, 0.7])
    bend, way = rate.deriv(), rate.integ()
    pause = found(lambda t: 10.0 - way(t), lambda t: -rate(t), lambda t: -bend(t), crossing=0.2)
    assert not np.any(pause.stops)
    assert np.any(found(lambda t: 10.0 - way(t), lambda t: -rate(t), lambda t: -bend(t)).stops)


def test_an_extreme_after_a_rise_does_not_belong_to_the_crossing() -> None:
    # the rate falls through zero near 0.23, turns at 0.303, rises to -1.2e-3 at 0.503, and falls to -2e-3 at 0.603
    bend = 20.0 * np.polynomial.Polynomial.fromroots([0.303, 0.503, 0.603])
    rate = bend.integ() - float(bend.integ()(0.603)) - 2e-3
    way, [crossing] = rate.integ(), [root for root in np.real(rate.roots()).tolist() if 0.2 < root < 0.3]
    motion = (lambda t: 10.0 + way(t), rate, bend)
    assert found(*motion).time[found(*motion).stops] == pytest.approx([0.503, 0.603])
    assert not np.any(found(*motion, crossing=crossing).stops)


@pytest.mark.parametrize(("rate", "bend", "stops"), [(3e-3, -1.0, True), (3e-3, 1.0, False), (0.1, -1.0, False)])
def test_a_maximum_may_be_just_after_the_end(rate: float, bend: float, stops: bool) -> None:
    at_end = found(
        lambda t: 10.0 + rate * (t - 1.0) + 0.5 * bend * (t - 1.0) ** 2,
        lambda t: rate + bend * (t - 1.0),
        lambda t: bend,
    )
    assert at_end.stops[at_end.last].tolist() == [True] * stops


def test_a_motion_is_read_between_samples_and_since_it_came_near() -> None:
    time = np.linspace(0.0, 1.0, 11)
    seen = {
        "time": time, "overlap": np.stack((time**4, time**2 - 1.0), axis=1),
        "rate": np.stack((4.0 * time**3, 2.0 * time), axis=1),
        "acceleration": np.stack((12.0 * time**2, 0.0 * time + 2.0), axis=1),
    }  # fmt: skip
    overlap, rate = read_at(seen, np.array([0, 1, 0]), np.array([0.05, 0.55, 1.0]))
    assert overlap == pytest.approx([0.05**4, 0.55**2 - 1.0, 1.0], rel=1e-12)
    assert rate == pytest.approx([4.0 * 0.05**3, 1.1, 4.0], rel=1e-12)
    end = Moments(**{name: np.array([value]) for name, value in {
        "contact": 1, "time": 1.0, "last": True, "overlap": 0.0, "rate": 2.0, "bend": -2.0, "touches": True,
        "felt": False, "stops": False, "fresh": False, "lost": 0.0,
    }.items()})  # fmt: skip
    # it was 0.36 m away at 0.8 s
    near = with_ways(end, seen, np.array([0.3]))
    assert (near.speed[0], near.lasting[0], near.fastest[0]) == pytest.approx((2.0, 0.2, 2.0), rel=1e-12)


KINDS = {"dragged": dragged, "thrown": thrown, "shaken": shaken, "arriving": arriving}
SHARES = [sign * 10.0**-power for power in (4, 6, 8, 9, 10, 11) for sign in (-1.0, 1.0)]


def near_touch(kind: str, seed: int) -> NearTouch | None:
    """Return a motion of a kind that a few hundred thousand steps resolve."""
    rng = np.random.default_rng([31, seed])
    motion = KINDS[kind](rng, float(rng.choice(SHARES)))
    try:
        phase = prescan_hertz(motion.scene).frequency * motion.scene.duration
    except RunBroken:
        return None
    return motion if phase < 100.0 else None


def missed(
    names: tuple[str, ...], motions: list[NearTouch | None] | list[DoubleCompression | None]
) -> tuple[int, list[Any]]:
    """Return how many runs there are, and those further off than they state."""
    runs, outside = 0, []
    for motion in motions:
        for name in names:
            if motion is None or unsupported_reason(backend(name), motion.scene):
                continue
            default = db.solve(motion.scene, backend=name, uncertainty=False).provenance["settings"]["dt"]
            for factor in (1.0, 7.0):
                run = db.solve(motion.scene, backend=name, dt=factor * default)
                runs += 1
                if bad := motion.outside(run):
                    outside.append((motion.scene, name, factor, bad))
    return runs, outside


@pytest.mark.parametrize("seeds", [range(8), pytest.param(range(8, 200), marks=pytest.mark.slow)], ids=["8", "200"])
@pytest.mark.parametrize("kind", KINDS)
def test_of_what_may_touch_the_uncertainty_holds(kind: str, seeds: range) -> None:
    runs, outside = missed(CODES[:2], [near_touch(kind, seed) for seed in seeds])
    assert runs > 0
    assert outside == []


DEPTHS = (1e-3, 1e-6, 1e-9, 1e-12, -1e-12, -1e-9, -1e-6)


@pytest.mark.parametrize("seeds", [range(16), pytest.param(range(16, 600), marks=pytest.mark.slow)], ids=["16", "600"])
def test_a_first_maximum_is_found_or_undecided(seeds: range) -> None:
    runs, outside = missed(CODES[:2], [double_compression(seed, DEPTHS[seed % len(DEPTHS)]) for seed in seeds])
    assert runs > 0
    assert outside == []


def test_where_no_moment_is_undecided_contacts_are_said_to_be_open(monkeypatch: pytest.MonkeyPatch) -> None:
    pairs = [near_touch("dragged", seed) for seed in range(8)]
    monkeypatch.setattr(moments, "NEAR", 0.0)
    assert missed(("verlet",), pairs)[1] != []
