"""Largest overlaps and crossing times are those of closed forms, and the checker refuses others."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dem_bridge as db

pytest.importorskip("flint", reason="needs python-flint, the extra proof")

from flint import arb, ctx

from dem_bridge.proof.certificate import read_ball, read_extremes, read_record
from dem_bridge.proof.checker import check_proof
from dem_bridge.proof.extremes import Unknown
from dem_bridge.proof.turns import Curve, follow_overlap
from tests.helpers import proof_scenes, proofs

File = dict[str, Any]
PAIR, LINEAR = proof_scenes.PAIR, proof_scenes.LINEAR


@cache
def proof(scene: db.Scene) -> db.Proof:
    return db.prove(scene)


def checked(file: File, folder: Path) -> str:
    return check_proof(proofs.written(proofs.sealed(file), folder), jobs=1).sentence


def contains(entry: Any, value: Fraction) -> bool:
    middle, radius = read_ball(entry)
    return abs(middle - value) <= radius


@pytest.mark.parametrize("exponent", [2.0, 2.5, 3.0, 4.5])
def test_those_of_a_collision_are_exact(tmp_path: Path, exponent: float) -> None:
    scene = replace(PAIR, exponent=exponent, stiffness=(4e9 * 1e6 ** (exponent - 2.5),), duration=1e-4)
    with ctx.workprec(400):
        m, v, n = list(map(proofs.exact, scene.mass)), list(map(proofs.exact, scene.velocity)), proofs.exact(exponent)
        beta, gap = proofs.exact(scene.stiffness[0]), proofs.exact(scene.contacts.gap[0])
        reduced, closing, p = m[0] * m[1] / sum(m), v[0] - v[1], proofs.as_ball(1 / n)
        deep = proofs.as_ball(n * reduced * closing**2 / (2 * beta)) ** p
        long = deep / proofs.as_ball(closing) * arb.pi().sqrt() * (1 + p).gamma() / (arb(0.5) + p).gamma()
        strong = proofs.as_ball(beta) * deep ** proofs.as_ball(n - 1)
        depth, half, force = map(proofs.as_fraction, (deep, long, strong))
    found = proof(scene)
    peak, crossing = found.certificate["peaks"][0], found.certificate["crossings"][0]
    assert contains(peak["overlap"], depth)
    assert contains(crossing, gap / closing + half)
    # radii are 1e-20 of the largest overlap and of the duration, rounded up to a power of ten
    assert read_ball(peak["overlap"])[1] <= Fraction(1, 10**19) * depth
    assert read_ball(crossing)[1] <= Fraction(1, 10**19) * Fraction(scene.duration)
    assert abs(Fraction(found.peak_force[0]) - force) <= Fraction(found.peak_force_radius[0])
    assert found.peak_force_radius[0] <= 2.0**-52 * found.peak_force[0]
    assert checked(found.certificate, tmp_path).startswith("proved")


def test_those_of_a_linear_chain_are_in_its_exact_motion() -> None:
    motion, found, c = proof_scenes.linear_motion(), proof(LINEAR), LINEAR.contacts
    n, extremes = LINEAR.n_body, read_extremes(proof(LINEAR).certificate)

    def of_contact(time: Fraction, k: int) -> tuple[Fraction, Fraction]:
        state = motion.at(time)
        x, v = [*state[:n], Fraction(0)], [*state[n:], Fraction(0)]
        left, right = int(c.left[k]), int(c.right[k])
        return x[left] - x[right] - proofs.exact(c.gap[k]), v[left] - v[right]

    grid = [Fraction(LINEAR.duration) * i / 200 for i in range(1, 201)]
    for k, extreme in enumerate(extremes):
        at = of_contact(extreme.at, k)[0]
        assert extreme.low <= at <= extreme.high
        assert all(of_contact(time, k)[0] <= extreme.high for time in grid)
        assert isinstance(extreme.crossing, tuple)
        middle, radius = extreme.crossing
        assert of_contact(middle - radius, k)[1] > 0 > of_contact(middle + radius, k)[1]
        earlier = [of_contact(time, k) for time in grid if time < middle - radius]
        assert all(rate > 0 for overlap, rate in earlier if overlap > 0)
        assert len([overlap for overlap, _ in earlier if overlap > 0]) >= 5
        np.testing.assert_allclose(found.crossing_time[k], float(middle), rtol=1e-15)


def test_a_contact_that_opens_from_the_start_has_no_crossing_before_it_closes(tmp_path: Path) -> None:
    apart = replace(PAIR, gap=(-2e-7,), velocity=(-0.1, 0.1), duration=3e-5)
    found = proof(apart)
    assert (found.certificate["crossings"], found.crossing_time_radius.tolist()) == (["none"], [0.0])
    assert found.as_json()["crossing_time"] == ["none"]
    np.testing.assert_allclose(found.peak_force, 4e9 * 2e-7**1.5, rtol=1e-14)
    assert checked(found.certificate, tmp_path).startswith("proved")
    # the first body returns from a wall
    back = replace(apart, wall_left=db.Wall(stiffness=4e9, gap=1e-6), duration=1.5e-4, velocity=(-0.3, 0.0))
    found = proof(back)
    run = db.solve(back, backend="reference")
    assert [touch.closes for touch in found.touches if touch.contact == 0][:2] == [False, True]
    assert found.touches[-1].time[0] > 0
    error = np.abs(found.crossing_time - run.crossing_time)
    assert (error <= run.uncertainty["crossing_time"] + found.crossing_time_radius).all()
    assert checked(found.certificate, tmp_path).startswith("proved")
    none = copy.deepcopy(found.certificate)
    none["crossings"][0] = "none"
    assert "the crossing time of contact 0 may be near" in checked(none, tmp_path)


def test_an_overlap_that_still_grows_is_largest_at_the_end(tmp_path: Path) -> None:
    scene = replace(PAIR, duration=2e-5)
    found, run = proof(scene), db.solve(scene, backend="reference")
    assert found.certificate["crossings"] == ["none"]
    overlap = run.displacement[-1, 0] - run.displacement[-1, 1] - 2e-6
    np.testing.assert_allclose(found.peak_force, 4e9 * overlap**1.5, rtol=1e-12)
    assert checked(found.certificate, tmp_path).startswith("proved")


def test_what_is_not_established_is_left_out_and_said() -> None:
    released = replace(PAIR, gap=(-2e-7,), velocity=(0.0, 0.0), duration=3e-5)
    found = proof(released)
    # the rate is 0 at the start and has no sign near it
    assert found.certificate["crossings"] == [None]
    assert found.crossing_time_radius.tolist() == [np.inf]
    assert "crossing times of 0 of 1 contacts; not established at contact 0" in str(found)
    assert found.as_json()["crossing_time"] == [None]
    np.testing.assert_allclose(found.peak_force, 4e9 * 2e-7**1.5, rtol=1e-14)


def test_a_contact_that_never_closes_has_no_force_and_no_crossing(tmp_path: Path) -> None:
    found = proof(replace(PAIR, gap=(1.0,)))
    assert (found.peak_force.tolist(), found.peak_force_radius.tolist()) == ([0.0], [0.0])
    assert found.certificate["crossings"] == ["none"]
    assert checked(found.certificate, tmp_path).startswith("proved")


def curve(rate: list[Fraction], faster: Fraction) -> Curve:
    """Return a curve over 1 s whose overlap is the integral of its rate."""
    zero = Fraction(0)
    overlap = [Fraction(1), *(c / (o + 1) for o, c in enumerate(rate))]
    balls = [tuple((c, zero) for c in each) for each in (overlap, rate)]
    return Curve(begin=zero, length=Fraction(1), overlap=balls[0], rate=balls[1], apart=faster, faster=faster, bits=200)


def test_a_turn_is_where_all_rates_within_the_error_fall_through_zero() -> None:
    for error in (Fraction(1, 10**40), Fraction(1, 10**6), Fraction(1, 100)):
        # 1/3 - y, and its zero with the error added and taken away
        course = follow_overlap(curve([Fraction(1, 3), Fraction(-1)], error))
        assert course is not None
        assert course.turn is not None
        middle, radius = course.turn.time
        assert middle - radius <= Fraction(1, 3) - error
        assert Fraction(1, 3) + error <= middle + radius
        assert radius <= 16 * error
        largest = 1 + Fraction(1, 18)
        assert abs(course.turn.overlap[0] - largest) + error <= course.turn.overlap[1] <= 4 * error
        assert (course.first, course.last) == (1, -1)


def test_a_rate_that_may_touch_zero_has_no_proved_course() -> None:
    error = Fraction(1, 1000)
    # (y - 1/3)^2 + c: above the error, within it
    above, within = ([Fraction(1, 9) + c, Fraction(-2, 3), Fraction(1)] for c in (2 * error, error / 2))
    course = follow_overlap(curve(above, error))
    assert course is not None
    assert (course.first, course.last, course.turn) == (1, 1, None)
    course = follow_overlap(curve(within, error))
    assert course is None or course.first == 0
    # a minimum: at most the larger end, and what the error of the rate adds
    course = follow_overlap(curve([Fraction(-1, 3), Fraction(1)], error))
    assert course is not None
    assert (course.first, course.last, course.turn) == (-1, 1, None)
    assert 1 + Fraction(1, 6) <= course.most <= 1 + Fraction(1, 6) + 4 * error
    # two turns with a minimum between them: y = 1/6, 1/2, 5/6
    zeros = [Fraction(5, 72), Fraction(-23, 36), Fraction(3, 2), Fraction(-1)]
    assert follow_overlap(curve(zeros, error)) is None


def test_a_file_that_says_nothing_of_them_goes_on_without_them(tmp_path: Path) -> None:
    file = copy.deepcopy(proof(PAIR).certificate)
    del file["peaks"], file["crossings"]
    assert checked(file, tmp_path).startswith("proved")
    record = read_record(proofs.written(proofs.sealed(file), tmp_path), PAIR)
    assert record.extremes[0].crossing is Unknown.UNPROVED
    assert record.extremes[0].high > 1


def moved(entry: Any, radii: int) -> list[str]:
    """Return a ball that is moved by a multiple of its radius."""
    middle, radius = read_ball(entry)
    return [proofs.text(middle + radii * radius), proofs.text(radius)]


def narrow(entry: Any) -> list[str]:
    """Return a ball without room for the errors of the checker."""
    return [proofs.text(read_ball(entry)[0]), "1e-60"]


def halved(entry: Any) -> list[str]:
    """Return a ball around half of a number."""
    middle, radius = read_ball(entry)
    return [proofs.text(middle / 2), proofs.text(radius)]


def of_crossing(change: Callable[[list[str]], Any]) -> Callable[[File], None]:
    def by(file: File) -> None:
        file["crossings"][1] = change(file["crossings"][1])

    return by


def of_peak(key: str, change: Callable[[Any], Any]) -> Callable[[File], None]:
    def by(file: File) -> None:
        file["peaks"][1][key] = change(file["peaks"][1][key])

    return by


def later(file: File) -> None:
    """Claim the crossing that contact 0 has after it has closed again, in place of the first."""
    file["crossings"][0] = file["crossings"][2]


#: change of the certificate of the linear chain, and what the checker says
FAULTS: dict[str, tuple[Callable[[File], None], str]] = {
    "a peak is lower": (of_peak("overlap", lambda b: moved(b, -2)), "contact 1 may be exceeded"),
    "a peak is higher": (of_peak("overlap", lambda b: moved(b, 2)), "contact 1 may not be reached"),
    "a peak is shrunk": (of_peak("overlap", narrow), "the largest overlap of contact 1 may"),
    "a peak is half": (of_peak("overlap", halved), "contact 1 may"),
    "a peak is nothing": (of_peak("overlap", lambda _: ["0", "1e-20"]), "contact 1 may be exceeded"),
    "a peak is below 0": (of_peak("overlap", lambda b: ["-1", "0"]), "peak 1 is below 0"),
    "a peak is at the start": (of_peak("at", lambda _: "0"), "may not be reached at the start"),
    "a peak is at another time": (of_peak("at", lambda t: proofs.ratio(Fraction(t) / 2)), "contact 1 may not be"),
    "a peak is after the end": (of_peak("at", lambda _: "1"), "is not in the time that is proved"),
    "a crossing is earlier": (of_crossing(lambda b: moved(b, -2)), "crossing time of contact 1 may be after its ball"),
    "a crossing is later": (of_crossing(lambda b: moved(b, 2)), "crossing time of contact 1 may be before"),
    "a crossing is shrunk": (of_crossing(narrow), "the crossing time of contact 1 may be"),
    "a crossing is at the start": (of_crossing(lambda _: ["0", "0"]), "crossing 1 is not in the time"),
    "a crossing is after the end": (of_crossing(lambda _: ["1", "1e-20"]), "crossing 1 is not in the time"),
    "a crossing is denied": (of_crossing(lambda _: "none"), "the crossing time of contact 1 may be near"),
    "a crossing is that of another": (later, "the crossing time of contact 0 may be"),
    "peaks are too few": (lambda file: file["peaks"].pop(), "peaks has 2 entries in place of 3"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_planted_fault_is_refused(tmp_path: Path, fault: str) -> None:
    file = copy.deepcopy(proof(LINEAR).certificate)
    change, sentence = FAULTS[fault]
    change(file)
    assert sentence in checked(file, tmp_path)


def test_the_certificate_without_a_fault_is_proved(tmp_path: Path) -> None:
    file = proof(LINEAR).certificate
    assert None not in [*file["peaks"], *file["crossings"]]
    assert checked(file, tmp_path).startswith("proved")
