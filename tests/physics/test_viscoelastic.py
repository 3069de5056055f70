"""Viscoelastic spheres: the series and its remainder against direct integration, quadruple precision and theory."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dem_bridge.physics import viscoelastic
from dem_bridge.physics.viscoelastic import ViscoelasticImpact, viscoelastic_impact


def impact(strength: float, clip: bool, **more: int) -> ViscoelasticImpact:
    return viscoelastic_impact(mass=1.0, speed=1.0, stiffness=1.0, viscosity=strength, clip=clip, **more)


def integrated(strength: float, clip: bool) -> float:
    """Return the restitution of d'' = -d^(3/2) - s d^(1/2) d' by DOP853, with d = u^2 and dt = u dtau: polynomial."""

    def rate(_: float, y: np.ndarray) -> list[float]:
        u, p = y
        return [0.5 * p, -(u**4) - strength * u**2 * p]

    def end(tau: float, y: np.ndarray) -> float:
        # the overlap is zero, or the net force over u
        return 1.0 if tau == 0.0 else float(y[0] ** 2 + strength * y[1] if clip and y[1] < 0.0 else y[0])

    end.terminal, end.direction = True, -1.0  # type: ignore[attr-defined]
    run = solve_ivp(rate, (0.0, 100.0), [0.0, 1.0], method="DOP853", rtol=3e-14, atol=1e-15, max_step=0.05, events=end)
    return -float(run.y_events[0][0][1])


@pytest.mark.parametrize("clip", [False, True])
@pytest.mark.parametrize("strength", [0.002, 0.05, 0.6, 1.3, 2.0])
def test_the_series_is_that_of_direct_integration(strength: float, clip: bool) -> None:
    truth = integrated(strength, clip)
    # DOP853 at 3e-14 over 100 steps; clipped, the force changes its sign at the end with a small slope
    assert impact(strength, clip).restitution == pytest.approx(truth, abs=2e-12)
    # fewer terms are less exact, and the remainder says by how much
    for terms in range(3, 18, 3):
        shorter = impact(strength, clip, terms=terms)
        assert abs(shorter.restitution - truth) <= shorter.remainder + 2e-12
        assert terms > 9 or shorter.remainder > 1e-11


def test_the_remainder_holds_to_the_last_digits() -> None:
    # solved with 26 digits by Taylor series of order 36 in the polynomial form
    for clip, digits in ((False, 0.94425997234333938097737), (True, 0.94439677917763032462827)):
        hit = impact(0.05, clip)
        assert abs(hit.restitution - digits) <= hit.remainder < 4e-15


@pytest.mark.parametrize("clip", [False, True])
@pytest.mark.parametrize("terms", [1, 2, 22, 26])
def test_any_number_of_terms_up_to_all_gives_their_polynomial_and_bounds_the_rest(terms: int, clip: bool) -> None:
    table = viscoelastic._CLIPPED if clip else viscoelastic._PULLING
    # strength 0.5 is a quarter of the range: T_k = cos(k arccos(x)) at x = 2/4 - 1, clipped at 2 sqrt(1/4) - 1
    x = 0.0 if clip else -0.5
    root = math.fsum(c * math.cos(k * math.acos(x)) for k, c in enumerate(table[:terms]))
    hit = impact(0.5, clip, terms=terms)
    assert hit.restitution == pytest.approx(min(root**-5.0, 1.0), rel=1e-13)
    rest = math.fsum(map(abs, table[terms:])) + 3.0 * 2.0**-52
    assert hit.remainder == pytest.approx(5.0 * rest / (root - rest) ** 6, rel=1e-6)


def test_the_largest_strength_is_allowed_and_no_larger_one() -> None:
    assert impact(2.0, False).restitution == pytest.approx(0.0953, abs=5e-5)
    assert impact(2.0, True).restitution == pytest.approx(0.2116, abs=5e-5)
    with pytest.raises(ValueError, match=r"allowed: at most 2$"):
        impact(math.nextafter(2.0, 3.0), True)
    assert impact(0.0, True).restitution <= 1.0
    assert impact(1e-300, False).restitution == pytest.approx(1.0, abs=4e-15)


def test_the_first_terms_are_those_of_ramirez_et_al() -> None:
    first = 0.8 * 1.25**0.6 * math.gamma(0.6) * math.gamma(1.5) / math.gamma(2.1)  # the quadrature of the first order
    assert (first, 0.6 * first**2) == pytest.approx((1.15344, 0.79826), abs=1e-5)
    s = np.linspace(0.002, 0.05, 8)
    rest = [(1.0 - first * x + 0.6 * first**2 * x**2 - impact(x, False).restitution) / x**3 for x in s.tolist()]
    # the next term is -0.5229 s^3 + 0.3487 s^4 (coefficients on a circle in the complex plane)
    assert rest == pytest.approx((0.52288 - 0.34874 * s + 0.233 * s**2).tolist(), abs=2e-5)
    assert 1.0 - first * 0.05 + 0.6 * first**2 * 0.0025 == pytest.approx(0.94432, abs=5e-6)
    # delayed recovery: e clipped less e pulling is (4/15) s^(5/2) e^(3/2)
    lifted = impact(1e-3, True).restitution - impact(1e-3, False).restitution
    assert lifted / (4.0 / 15.0 * 1e-3**2.5) == pytest.approx(impact(1e-3, False).restitution ** 1.5, rel=1e-4)


def test_speed_mass_and_stiffness_enter_by_the_strength_alone() -> None:
    hit = viscoelastic_impact(mass=3e-4, speed=0.7, stiffness=2e9, viscosity=4e-7, clip=True)
    assert hit.strength == pytest.approx(4e-7 * (2e9 / 3e-4) ** 0.4 * 0.7**0.2, rel=1e-14)
    assert hit.restitution == impact(hit.strength, True).restitution
    assert impact(0.0, False).restitution == pytest.approx(1.0, abs=4e-15)


@pytest.mark.parametrize("clip", [False, True])
def test_a_wrong_coefficient_is_found(clip: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """The planted fault: the fourteenth coefficient of about 1e-10 is missing."""
    name = "_CLIPPED" if clip else "_PULLING"
    table = list(getattr(viscoelastic, name))
    monkeypatch.setattr(viscoelastic, name, (*table[:13], 0.0, *table[14:]))
    assert impact(2.0, clip).restitution != pytest.approx(integrated(2.0, clip), abs=2e-12)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"viscosity": 2.001}, r"^strength gamma .* = 2.001; allowed: at most 2$"),
        ({"viscosity": -1.0}, r"^viscosity = -1.0; allowed: a number >= 0"),
        ({"speed": 0.0}, r"^speed = 0.0; allowed"),
        ({"terms": 0}, r"^terms = 0; allowed: a whole number from 1 to 26$"),
        ({"terms": 27}, r"^terms = 27; allowed: a whole number from 1 to 26$"),
    ],
)
def test_numbers_outside_the_series_are_refused_in_one_line(wrong: dict[str, float], says: str) -> None:
    good = {"mass": 1.0, "speed": 1.0, "stiffness": 1.0, "viscosity": 0.1, "clip": True}
    with pytest.raises(ValueError, match=says):
        viscoelastic_impact(**(good | wrong))  # type: ignore[arg-type]
