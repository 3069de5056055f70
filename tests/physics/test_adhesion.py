"""Impacts with adhesion: against the curves in the radius of contact, quadrature, integration and printed numbers."""

from __future__ import annotations

import math
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.optimize import brentq, minimize_scalar

from dem_bridge.physics import adhesion
from dem_bridge.physics.adhesion import AdhesiveImpact, Break, dmt_impact, jkr_impact, pull_off_force
from dem_bridge.physics.exact import two_body_collision
from tests.helpers.strategies import log_uniform

R, MODULUS, GAMMA = 2.5e-4, 3e8, 0.07
STIFFNESS = 4.0 / 3.0 * MODULUS * math.sqrt(R)
UNIT = ((2.0 * GAMMA) ** 5 * R**4 / MODULUS**2) ** (1.0 / 3.0)
#: factor of UNIT in the loss W, and radius of contact a^3 over gamma R^2 / E* at the break, as printed
PRINTED = {"overlap": (7.0922, math.pi / 4.0), "force": (3.5026, 9.0 * math.pi / 4.0)}


def overlap_of(a: float) -> float:
    """Return the overlap of JKR by Johnson's equations, in the radius of contact a (m) and the surface energy."""
    return a**2 / R - 2.0 * math.sqrt(math.pi * GAMMA * a / MODULUS)


def force_of(a: float) -> float:
    """Return the force of JKR at the radius of contact a (m), N."""
    return 4.0 * MODULUS * a**3 / (3.0 * R) - 4.0 * math.sqrt(math.pi * GAMMA * MODULUS * a**3)


def work(first: float, last: float) -> float:
    """Return the work of the force from one radius of contact to another by quadrature, J."""
    slope = lambda a: 2.0 * a / R - math.sqrt(math.pi * GAMMA / (MODULUS * a))  # noqa: E731
    return float(quad(lambda a: force_of(a) * slope(a), first, last, epsabs=0.0, epsrel=1e-12)[0])


def jkr(speed: float, breaks_at: Break) -> AdhesiveImpact:
    pull_off = pull_off_force("jkr", radius=R, surface_energy=GAMMA)
    return jkr_impact(mass=1e-6, speed=speed, stiffness=STIFFNESS, pull_off=pull_off, breaks_at=breaks_at)


TOUCH = brentq(overlap_of, 1e-7, 1e-3, xtol=1e-20)


def test_the_pull_off_is_the_least_force_of_the_curve() -> None:
    pull_off = pull_off_force("jkr", radius=R, surface_energy=GAMMA)
    best = minimize_scalar(force_of, bounds=(0.1 * TOUCH, TOUCH), method="bounded", options={"xatol": 1e-14})
    assert pull_off == pytest.approx(-best.fun, rel=1e-12)
    assert pull_off == pytest.approx(3.0 * math.pi * GAMMA * R, rel=1e-15)
    assert pull_off_force("dmt", radius=R, surface_energy=GAMMA) == pytest.approx(4.0 * math.pi * GAMMA * R, rel=1e-15)
    assert force_of(TOUCH) == pytest.approx(-8.0 / 9.0 * pull_off, rel=1e-12)
    zero = (9.0 * math.pi * GAMMA * R**2 / MODULUS) ** (1.0 / 3.0)
    assert force_of(zero) == pytest.approx(0.0, abs=1e-12 * pull_off)


@pytest.mark.parametrize("breaks_at", get_args(Break))
def test_loss_and_break_are_those_of_the_curve_and_as_printed(breaks_at: Break) -> None:
    factor, radius = PRINTED[breaks_at]
    broken = (radius * GAMMA * R**2 / MODULUS) ** (1.0 / 3.0)
    hit = jkr(0.2, breaks_at)
    assert hit.loss == pytest.approx(work(TOUCH, broken), rel=1e-10, abs=0.0)
    assert hit.loss / UNIT == pytest.approx(factor, abs=0.6e-4)
    assert hit.break_overlap == pytest.approx(overlap_of(broken), rel=1e-12, abs=0.0)
    if breaks_at == "overlap":
        assert hit.break_overlap == pytest.approx(-3.0 * broken**2 / R, rel=1e-12, abs=0.0)
        assert force_of(broken) == pytest.approx(-5.0 / 9.0 * 3.0 * math.pi * GAMMA * R, rel=1e-12)
    else:
        printed = (3.0 * math.pi**2 / 16.0) ** (1.0 / 3.0) * (GAMMA**2 * R / MODULUS**2) ** (1.0 / 3.0)
        assert hit.break_overlap == pytest.approx(-printed, rel=1e-12)
    assert hit.sticking_speed == pytest.approx(math.sqrt(2.0 * hit.loss / 1e-6), rel=1e-14)


@pytest.mark.parametrize("breaks_at", get_args(Break))
def test_bodies_stick_below_a_speed_and_part_above_it(breaks_at: Break) -> None:
    stick = jkr(0.2, breaks_at).sticking_speed
    assert jkr(0.99 * stick, breaks_at).restitution == 0.0
    for factor in (1.01, 2.0, 50.0):
        hit = jkr(factor * stick, breaks_at)
        assert hit.restitution == pytest.approx(math.sqrt(1.0 - 1.0 / factor**2), rel=1e-12)
        # the peak by quadrature over the curve
        peak = brentq(lambda a: work(TOUCH, a) - 0.5e-6 * (factor * stick) ** 2, TOUCH * 1.05, 1e-2, xtol=1e-20)  # noqa: B023
        assert hit.peak_overlap == pytest.approx(overlap_of(peak), rel=1e-9)
        assert hit.peak_force == pytest.approx(force_of(peak), rel=1e-9)


def test_the_same_impact_sticks_by_the_textbook_and_bounces_in_lammps() -> None:
    # at 1.19 of LAMMPS' own sticking speed: measured .70597
    stick = jkr(0.2, "force").sticking_speed
    speed = stick / math.sqrt(1.0 - 0.70599**2)
    assert jkr(speed, "overlap").restitution == 0.0
    assert jkr(speed, "force").restitution == pytest.approx(0.70599, rel=1e-12)


@given(mass=log_uniform(1e-9, 1e3), speed=log_uniform(1e-6, 1e3), force=log_uniform(1e-12, 1e6))
def test_dmt_stores_all_energy_at_its_peak(mass: float, speed: float, force: float) -> None:
    hit = dmt_impact(mass=mass, speed=speed, stiffness=STIFFNESS, pull_off=force)
    energy, d = 0.5 * mass * speed**2, hit.peak_overlap
    parts = 0.4 * STIFFNESS * d**2.5, force * d
    # relative to both parts, of which the kinetic energy can be a small difference
    assert parts[0] - parts[1] == pytest.approx(energy, abs=1e-14 * sum(parts))
    assert hit.peak_force == pytest.approx(STIFFNESS * d**1.5 - force, rel=1e-15)
    assert (hit.restitution, hit.sticking_speed, hit.loss) == (1.0, 0.0, 0.0)


def test_without_adhesion_dmt_is_hertz() -> None:
    hit = dmt_impact(mass=2.0, speed=3.0, stiffness=5.0, pull_off=0.0)
    hertz = two_body_collision(masses=(2.0, math.inf), velocities=(3.0, 0.0), stiffness=5.0, exponent=2.5)
    assert (hit.peak_overlap, hit.peak_force) == pytest.approx((hertz.peak_overlap, hertz.peak_force), rel=1e-14)


@given(s=st.floats(0.5, 4.0))
def test_the_force_is_the_slope_of_the_energy(s: float) -> None:
    h = 1e-5
    overlap = lambda x: x**4 - 4.0 / 3.0 * x  # noqa: E731
    rise = (adhesion.jkr_energy(s + h) - adhesion.jkr_energy(s - h)) / (2.0 * h)
    along = (overlap(s + h) - overlap(s - h)) / (2.0 * h)
    # central differences: h^2 times the third derivative, at most 3e4
    assert rise == pytest.approx((s**6 - 2.0 * s**3) * along, rel=1e-6, abs=1e-5)


def test_the_break_of_the_other_kind_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """The planted fault: the contact breaks at the wrong end."""
    monkeypatch.setitem(adhesion._BREAK, "force", adhesion._BREAK["overlap"])
    assert jkr(0.2, "force").loss / UNIT != pytest.approx(PRINTED["force"][0], rel=0.5)


def test_what_is_outside_is_refused_in_one_line() -> None:
    good = {"mass": 1.0, "speed": 1.0, "stiffness": 1.0, "pull_off": 1.0}
    for name in good:
        with pytest.raises(ValueError, match=rf"^{name} = -1.0; allowed: a"):
            dmt_impact(**(good | {name: -1.0}))
        with pytest.raises(ValueError, match=rf"^{name} = -1.0; allowed: a"):
            jkr_impact(**(good | {name: -1.0}), breaks_at="force")
    with pytest.raises(ValueError, match=r"^breaks_at = 'there'; allowed: 'overlap', 'force'$"):
        jkr_impact(**good, breaks_at="there")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"^adhesion law = 'glue'; allowed: 'dmt', 'jkr'$"):
        pull_off_force("glue", radius=1.0, surface_energy=1.0)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"^surface_energy = 0.0; allowed: a finite number > 0"):
        pull_off_force("jkr", radius=1.0, surface_energy=0.0)
