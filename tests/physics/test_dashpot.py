"""The linear contact with a dashpot: against direct integration of the equation of motion, and its own identities."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, minimize_scalar

from dem_bridge.physics.dashpot import DashpotCollision, dashpot_collision
from tests.helpers.strategies import examples, log_uniform

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
