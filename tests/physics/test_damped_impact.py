"""Impacts and restitution: against direct integration, the formulas branch by branch and published values.

The linear contact with a dashpot: against direct integration of the equation of motion, and its own identities.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, minimize_scalar

from dem_bridge.physics.damped_impact import (
    DashpotCollision,
    RestitutionLaw,
    alpha_of_restitution,
    alpha_of_tsuji,
    bounce_heights,
    dashpot_collision,
    linear_restitution,
    restitution_obtained,
    restitution_of_alpha,
    restitution_to_write,
)
from dem_bridge.physics.exact import two_body_collision
from dem_bridge.physics.hertz import sphere_on_plane, sphere_on_sphere
from tests.helpers.strategies import examples, log_uniform


def _integrated(alpha: float, n: float, speed: float = 1.0, clip: bool = False) -> float:
    """Return the restitution of d'' = -d^(n-1) - alpha d^((n-2)/2) d' by DOP853.

    The contact ends at d = 0, or where the net force falls through zero if it is clipped.
    """

    def rate(_: float, y: np.ndarray) -> list[float]:
        d = max(float(y[0]), 0.0)
        return [y[1], -(d ** (n - 1.0)) - alpha * d ** (0.5 * n - 1.0) * y[1]]

    def touch(t: float, y: np.ndarray) -> float:
        force = -rate(t, y)[1] if clip and y[1] < 0.0 else float(y[0])
        return force if t > 0.0 else 1.0

    touch.terminal, touch.direction = True, -1.0  # type: ignore[attr-defined]
    run = solve_ivp(rate, (0.0, 50.0), [0.0, speed], method="DOP853", rtol=1e-11, atol=1e-14, events=touch)
    return -float(run.y_events[0][0][1]) / speed


@pytest.mark.parametrize("n", [2.0, 2.5, 3.0])
@pytest.mark.parametrize("e", [0.3, 0.9])
def test_a_contact_that_is_not_clipped_has_the_restitution_for_which_alpha_is_computed(e: float, n: float) -> None:
    # 1e-7: steps of the second writing next to the touch, where the damping force has no derivative
    assert _integrated(alpha_of_restitution(e, n), n, speed=0.37) == pytest.approx(e, abs=1e-7)
    assert _integrated(1.001 * alpha_of_restitution(e, n), n) != pytest.approx(e, abs=1e-5)  # the test can fail


def test_marshalls_polynomial_gives_the_published_restitutions() -> None:
    # values of e for .1 .3 .5 .7 .9, computed independently with the prefactor sqrt(2)
    for e, out in zip((0.1, 0.3, 0.5, 0.7, 0.9), (0.09948, 0.29991, 0.49992, 0.69994, 0.90018), strict=True):
        alpha = alpha_of_tsuji(e)
        assert math.exp(-math.pi * alpha / math.sqrt(5.0 - alpha**2)) == pytest.approx(out, abs=6e-6)
    assert all(alpha_of_tsuji(e) > 0.0 for e in np.linspace(1e-3, 1.0, 1000).tolist())  # it never drives a contact


def test_no_damping_belongs_to_a_restitution_of_one() -> None:
    assert str(alpha_of_restitution(1.0)) == "0.0"


@pytest.mark.parametrize("e", [0.0, -0.1, 1.0 + 1e-9, math.nan, math.inf, True, "half"])
def test_a_restitution_is_above_0_and_at_most_1(e: float) -> None:
    for function in (alpha_of_restitution, alpha_of_tsuji):
        with pytest.raises(ValueError, match=r"^restitution = .*; allowed: a"):
            function(e)


# restitution obtained, and the tables of the field

WRITTEN = (0.1, 0.3, 0.5, 0.7, 0.9)
#: restitution that a contact gives for these, clipped
CLIPPED = {
    "coeff_restitution": (0.25273, 0.39714, 0.55028, 0.71820, 0.90203),
    "tsuji": (0.25235, 0.39707, 0.55022, 0.71815, 0.90220),
}


def _branches(b: float, clip: bool) -> float:
    """Return the restitution at b/w_0 by the formulas of Schwager & Poeschel (2007), branch by branch."""
    if b > 1.0:
        root = math.sqrt(b * b - 1.0)
        return math.exp(-b / root * math.log((b + root) / (b - root))) if clip else 0.0
    w = math.sqrt(1.0 - b * b)
    if not clip:
        return math.exp(-math.pi * b / w)
    angle = math.atan(2.0 * b * w / (w * w - b * b))
    return math.exp(-b / w * (math.pi - angle)) if b < math.sqrt(0.5) else math.exp(b / w * angle)


@pytest.mark.parametrize("clip", [True, False])
@pytest.mark.parametrize("ratio", [0.05, 0.4, 0.7, 0.71, 0.99, 1.02, 1.5, 20.0])
def test_the_restitution_of_a_linear_spring_is_that_of_every_branch(ratio: float, clip: bool) -> None:
    obtained = linear_restitution(damping_ratio=ratio, clip=clip)
    assert obtained == pytest.approx(_branches(ratio, clip), rel=1e-13, abs=0.0)
    for n in (1.7, 2.0, 2.5, 3.0):
        alpha = ratio * math.sqrt(2.0 * n)
        assert restitution_of_alpha(alpha, clip=clip, exponent=n) == pytest.approx(obtained, rel=1e-12)


@pytest.mark.parametrize("n", [2.0, 2.5, 3.0])
@pytest.mark.parametrize("e", [0.3, 0.9])
def test_a_clipped_contact_has_the_restitution_of_direct_integration(e: float, n: float) -> None:
    alpha = alpha_of_restitution(e, n)
    # 1e-7: as above; the clip changes e by more than 1e-3
    truth = _integrated(alpha, n, speed=0.37, clip=True)
    assert restitution_of_alpha(alpha, clip=True, exponent=n) == pytest.approx(truth, abs=1e-7)
    assert restitution_of_alpha(alpha, clip=False, exponent=n) < truth - 1e-3  # the test can fail


@pytest.mark.parametrize("law", ["coeff_restitution", "tsuji"])
def test_what_is_obtained_is_the_table_and_has_an_inverse(law: RestitutionLaw) -> None:
    for e, out in zip(WRITTEN, CLIPPED[law], strict=True):
        assert restitution_obtained(e, clip=True, law=law) == pytest.approx(out, abs=6e-6)
    for e in (0.2, 0.5, 0.93, 0.999):
        for clip in (True, False):
            write = restitution_to_write(e, clip=clip, law=law)
            assert restitution_obtained(write, clip=clip, law=law) == pytest.approx(e, abs=1e-13)
            assert clip or law == "tsuji" or write == pytest.approx(e, abs=1e-13)


@pytest.mark.parametrize(("law", "e"), [("coeff_restitution", 0.135), ("tsuji", 0.17), ("tsuji", 1.0)])
def test_a_restitution_that_nothing_gives_is_refused(law: RestitutionLaw, e: float) -> None:
    with pytest.raises(ValueError, match=rf"^restitution = {e}; allowed: 0.1.* to .*, which the clipped law '{law}'"):
        restitution_to_write(e, clip=True, law=law)
    with pytest.raises(
        ValueError, match=r"^law = 'hooke'; allowed: 'coeff_restitution', 'tsuji', 'tsuji_without_sqrt2'$"
    ):
        restitution_obtained(0.5, clip=True, law="hooke")  # type: ignore[arg-type]


def test_a_hard_sphere_loses_the_same_share_at_each_bounce() -> None:
    heights = bounce_heights(height=0.3, restitution=0.8, bounces=6)
    speed = [math.sqrt(h) for h in (0.3, *heights)]
    assert [after / before for before, after in pairwise(speed)] == pytest.approx([0.8] * 6, rel=1e-14)
    with pytest.raises(ValueError, match=r"^height = 0.0; allowed"):
        bounce_heights(height=0.0, restitution=0.8, bounces=1)


#: Chung & Ooi (2011): E GPa, nu, rho kg/m^3, R mm, closing speed m/s, whether on a wall; d_max um, F_max N, t_c us
CHUNG_OOI = [
    (48.0, 0.20, 2800.0, 10.0, 20.0, False, "274.11270", "10696.88898", "40.339456"),
    (20.0, 0.25, 2500.0, 10.0, 20.0, False, "368.30403", "7108.24128", "54.201005"),
    (70.0, 0.30, 2699.0, 100.0, 0.2, True, "49.71718", "11369.85831", "731.65664"),
    (40.0, 0.35, 1800.0, 100.0, 0.2, True, "52.12329", "7232.68103", "767.06591"),
    (380.0, 0.23, 4000.0, 2.5, 3.9, True, "8.08881", "615.35157", "6.104510"),
    (100.0, 0.25, 7000.0, 2.5, 3.9, True, "17.18871", "506.76023", "12.972081"),
]


@pytest.mark.parametrize("row", CHUNG_OOI)
@pytest.mark.parametrize("rigid", [True, False])
def test_hertz_impacts_are_those_of_chung_and_ooi_to_every_digit(row: tuple[object, ...], rigid: bool) -> None:
    young, nu, rho, radius, speed, wall = (float(cell) for cell in row[:6])  # type: ignore[arg-type]
    sphere = {"radius": 1e-3 * radius, "young": 1e9 * young, "poisson": nu}
    contact = sphere_on_plane(**sphere, young2=math.inf if rigid else None) if wall else sphere_on_sphere(**sphere)
    mass = 4.0 / 3.0 * math.pi * rho * (1e-3 * radius) ** 3
    masses = (mass, math.inf if wall else mass)
    hit = two_body_collision(masses=masses, velocities=(speed, 0.0), stiffness=contact.stiffness, exponent=2.5)
    # a wall of the same material halves E*: d ~ E*^(-2/5), F ~ E*^(2/5)
    softer = 1.0 if rigid or not wall else 2.0**0.4
    values = (1e6 * hit.peak_overlap / softer, hit.peak_force * softer, 1e6 * hit.contact_time / softer)
    for value, printed in zip(values, row[6:], strict=True):
        digits = len(str(printed).partition(".")[2])
        assert f"{value:.{digits}f}" == printed
    # second writing of the stiffness, (4/3) E* sqrt(R)
    reduced = 1e-3 * radius / (1.0 if wall else 2.0)
    stiffness = 4.0 / 3.0 * 1e9 * young / (1.0 - nu**2) / (1.0 if wall and rigid else 2.0) * math.sqrt(reduced)
    assert contact.stiffness == pytest.approx(stiffness, rel=1e-14)
    # the planted fault: a wall with the pair's modulus in place of a rigid one
    assert rigid or not wall or f"{1e6 * hit.peak_overlap:.5f}" != row[6]


EPS = float(np.finfo(float).eps)
ratios = st.one_of(st.just(0.0), st.just(1.0), log_uniform(1e-6, 1e3), st.floats(0.9, 1.1), st.floats(0.45, 0.55))
masses = log_uniform(1e-4, 1e2)
partners = st.one_of(st.just(math.inf), masses)


def _hit(m1: float, m2: float, v1: float, v2: float, ratio: float, clip: bool) -> DashpotCollision:
    beta = 3e5
    damping = 2.0 * ratio * math.sqrt(beta * m1 / (1.0 + m1 / m2))
    return dashpot_collision(masses=(m1, m2), velocities=(v1, v2), stiffness=beta, damping=damping, clip=clip)


class Integrated:
    """Second writing: the oscillator overlap'' = -overlap - 2 zeta overlap' by DOP853, events by its dense output."""

    def __init__(self, zeta: float, clip: bool) -> None:
        def force(y: np.ndarray) -> float:
            return float(y[0] + 2.0 * zeta * y[1])

        def touch(_: float, y: np.ndarray) -> float:
            return float(y[0]) if _ > 0.0 else 1.0

        touch.terminal, touch.direction = True, -1.0  # type: ignore[attr-defined]

        def released(_: float, y: np.ndarray) -> float:
            return force(y) if _ > 0.0 else 1.0

        released.terminal, released.direction = clip, -1.0  # type: ignore[attr-defined]

        run = solve_ivp(
            lambda _, y: [y[1], -force(y)], (0.0, 40.0 * (1.0 + zeta)), [0.0, 1.0],
            method="DOP853", rtol=1e-13, atol=1e-45, dense_output=True, events=(touch, released),
        )  # fmt: skip
        self.push = float((*run.t_events[1], *run.t_events[0])[0])  # without a dashpot both happen at once
        y = run.sol(self.push)
        if clip and len(run.t_events[1]):  # a free flight from here on
            self.restitution, self.contact = -float(y[1]), self.push - float(y[0] / y[1])
        elif len(run.t_events[0]):
            self.contact = float(run.t_events[0][0])
            self.restitution = -float(run.sol(self.contact)[1])
        else:  # still creeping apart
            self.contact, self.restitution = math.inf, -float(run.y[1, -1])
        self.half = brentq(lambda t: run.sol(t)[1], 0.0, self.push, xtol=1e-15)
        self.overlap = float(run.sol(self.half)[0])
        best = minimize_scalar(lambda t: -force(run.sol(t)), bounds=(0.0, self.push), method="bounded")
        self.force = max(-float(best.fun), 2.0 * zeta)


@pytest.mark.parametrize("clip", [True, False])
@pytest.mark.parametrize("zeta", [0.0, 0.01, 0.3, 0.49, 0.51, 0.9, 0.999, 1.0, 1.001, 1.5, 6.0])
def test_every_number_is_that_of_direct_integration(zeta: float, clip: bool) -> None:
    m1, m2, closing, beta = 0.02, 0.05, 0.7, 3e5
    hit, other = _hit(m1, m2, 0.9, 0.2, zeta, clip), Integrated(zeta, clip)
    mu = m1 * m2 / (m1 + m2)
    unit = math.sqrt(mu / beta)
    # DOP853 at 1e-13 over up to ten thousand steps of a damped motion
    assert hit.restitution == pytest.approx(other.restitution, abs=3e-11)
    assert hit.half_time == pytest.approx(other.half * unit, rel=1e-10)
    assert hit.push_time == pytest.approx(other.push * unit, rel=1e-10)
    assert hit.contact_time == pytest.approx(other.contact * unit, rel=1e-9)
    assert hit.peak_overlap == pytest.approx(other.overlap * closing * unit, rel=1e-11)
    # the bounded search stops within 1e-5 of the maximum: its square
    assert hit.peak_force == pytest.approx(other.force * mu * closing / unit, rel=1e-9)


@given(m1=masses, m2=partners, v1=st.floats(0.1, 5.0), v2=st.floats(-5.0, 0.0), ratio=ratios, clip=st.booleans())
def test_momentum_is_kept_and_the_bodies_part_by_the_restitution(
    m1: float, m2: float, v1: float, v2: float, ratio: float, clip: bool
) -> None:
    hit = _hit(m1, m2, v1, v2, ratio, clip)
    u1, u2 = hit.exit_velocity
    assert u2 - u1 == pytest.approx(hit.restitution * (v1 - v2), abs=16.0 * EPS * (v1 - v2))
    if m2 == math.inf:
        assert u2 == v2
    else:
        assert m1 * u1 + m2 * u2 == pytest.approx(m1 * v1 + m2 * v2, abs=32.0 * EPS * (m1 + m2) * (v1 - v2))


@given(ratio=ratios)
def test_a_contact_that_may_pull_holds_the_bodies_longer_and_slows_them_more(ratio: float) -> None:
    cut, pulling = (_hit(1.0, 2.0, 1.0, 0.0, ratio, clip) for clip in (True, False))
    assert 0.0 <= pulling.restitution <= cut.restitution * (1.0 + 4.0 * EPS) <= 1.0 + 4.0 * EPS
    assert pulling.contact_time >= cut.contact_time * (1.0 - 1e-9)  # equal without a dashpot
    assert cut.push_time <= cut.contact_time
    assert (pulling.peak_force, pulling.peak_overlap) == (cut.peak_force, cut.peak_overlap)


@given(ratio=log_uniform(1e-4, 50.0))
def test_the_clipped_contact_ends_where_spring_and_dashpot_balance(ratio: float) -> None:
    # three identities between outputs: spring beta d = c |d'| at the end of the push, then free flight to d = 0
    hit = _hit(1.0, math.inf, 2.0, 0.0, ratio, True)
    beta = 3e5
    left = (hit.contact_time - hit.push_time) * hit.restitution * 2.0
    damping = 2.0 * ratio * math.sqrt(beta)
    # the flight is a difference of two times
    lost = 16.0 * EPS * hit.contact_time / (hit.contact_time - hit.push_time)
    assert beta * left == pytest.approx(damping * hit.restitution * 2.0, rel=lost + 1e-13)
    assert hit.half_time == 0.5 * hit.push_time
    assert hit.peak_overlap == pytest.approx(2.0 / math.sqrt(beta) * math.sqrt(hit.restitution), rel=1e-13)


@pytest.mark.parametrize("clip", [True, False])
def test_nothing_jumps_through_critical_damping(clip: bool) -> None:
    below, at, beyond = (_hit(1.0, 1.0, 1.0, 0.0, z, clip) for z in (1.0 - 1e-9, 1.0, 1.0 + 1e-9))
    for name in ("restitution", "peak_overlap", "peak_force", "half_time", "push_time"):
        assert getattr(below, name) == pytest.approx(getattr(at, name), rel=1e-8, abs=1e-15), name
        assert getattr(beyond, name) == pytest.approx(getattr(at, name), rel=1e-8, abs=1e-15), name
    # clipped: e^-2; else they stick
    assert at.restitution == pytest.approx(math.exp(-2.0) if clip else 0.0, rel=1e-14, abs=0.0)


@examples(50)
@given(ratio=log_uniform(1e-3, 0.5), m2=partners)
def test_the_dashpots_work_is_the_energy_that_is_missing(ratio: float, m2: float) -> None:
    # unclipped: quadrature of c d'^2 over the contact, d written in complex exponentials; units mu = beta = v = 1
    hit = _hit(1.0, m2, 1.0, 0.0, ratio, False)
    root = complex(-ratio, math.sqrt(1.0 - ratio**2))
    nodes, weights = np.polynomial.legendre.leggauss(60)
    end = math.pi / root.imag
    t = 0.5 * end * (nodes + 1.0)
    rate = np.imag(root * np.exp(root * t)) / root.imag
    work = 2.0 * ratio * 0.5 * end * float(weights @ rate**2)
    assert 0.5 * (1.0 - hit.restitution**2) == pytest.approx(work, rel=1e-12, abs=1e-15)


def test_without_a_dashpot_it_is_half_a_period() -> None:
    for clip in (True, False):
        hit = _hit(2.0, 3.0, 1.5, -0.5, 0.0, clip)
        assert hit.restitution == 1.0
        assert hit.contact_time == pytest.approx(math.pi * math.sqrt(1.2 / 3e5), rel=8.0 * EPS)
        assert hit.peak_force == pytest.approx(2.0 * math.sqrt(1.2 * 3e5), rel=8.0 * EPS)


GOOD = {"masses": (1.0, 2.0), "velocities": (1.0, 0.0), "stiffness": 1.0, "damping": 0.1, "clip": True}


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"masses": (0.0, 1.0)}, r"masses\[0\] = 0.0; allowed: a finite number > 0 \(kg\)$"),
        ({"masses": (math.inf, 1.0)}, r"masses\[0\] = inf; allowed: a finite number"),
        ({"masses": (1.0, -1.0)}, r"masses\[1\] = -1.0; .*or inf for a wall"),
        ({"velocities": (0.0, 0.0)}, r"closing velocity = 0.0 m/s; allowed: > 0"),
        ({"velocities": (math.nan, 0.0)}, r"velocities\[0\] = nan; allowed: a finite number \(m/s\)"),
        ({"stiffness": 0.0}, r"stiffness = 0.0; allowed"),
        ({"damping": -1.0}, r"damping = -1.0; allowed: a finite number >= 0"),
        ({"damping": math.inf}, r"damping = inf; allowed: a finite number"),
    ],
)
def test_what_is_outside_is_refused_in_one_line(wrong: dict[str, object], says: str) -> None:
    with pytest.raises(ValueError, match=says) as caught:
        dashpot_collision(**(GOOD | wrong))  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)
