"""Drops and stacks on linear springs: against direct integration, and the cases of MFiX (DEM-01 and DEM-03)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import dem_bridge as db
from dem_bridge.physics.damped_impact import alpha_of_restitution, bounce_heights
from dem_bridge.physics.drop_and_stack import LinearDrop, linear_drop, linear_stack

#: MFiX DEM-01: a sphere of 0.2 m and 2600 kg/m^3 falls from a height of 0.5 m of its centre
MASS, HEIGHT, G = 2600.0 * math.pi / 6.0 * 0.2**3, 0.4, 9.81


def drop(stiffness: float, e: float, height: float = HEIGHT) -> LinearDrop:
    damping = alpha_of_restitution(e, 2.0) * math.sqrt(stiffness * MASS)
    return linear_drop(mass=MASS, stiffness=stiffness, damping=damping, height=height, gravity=G)


@pytest.mark.parametrize("stiffness", [1e4, 2.5e4, 5e4, 1e5])
@pytest.mark.parametrize("e", [0.6, 0.8, 1.0])
def test_a_drop_is_that_of_direct_integration(stiffness: float, e: float) -> None:
    hit = drop(stiffness, e)
    damping = alpha_of_restitution(e, 2.0) * math.sqrt(stiffness * MASS)

    def touch(t: float, y: np.ndarray) -> float:
        return float(y[0]) if t > 0.0 else 1.0

    def turn(_: float, y: np.ndarray) -> float:
        return float(y[1])

    touch.terminal, touch.direction = True, -1.0  # type: ignore[attr-defined]

    def rate(_: float, y: np.ndarray) -> list[float]:
        return [y[1], G - (stiffness * y[0] + damping * y[1]) / MASS]

    start = [0.0, math.sqrt(2.0 * G * HEIGHT)]
    run = solve_ivp(rate, (0.0, 2.0), start, method="DOP853", rtol=1e-13, atol=1e-15, events=(touch, turn))
    end, top = run.y_events[0][0], run.y_events[1][0]
    # events of DOP853 are located in its dense output, whose order is lower: 2e-11
    assert hit.contact_time == pytest.approx(run.t_events[0][0], rel=1e-10)
    assert (hit.exit_speed, hit.peak_overlap) == pytest.approx((-end[1], top[0]), rel=1e-10)
    assert hit.rebound_height == pytest.approx(0.5 * end[1] ** 2 / G, rel=2e-10)
    assert (hit.touch_speed, hit.touch_time) == pytest.approx((math.sqrt(2 * G * HEIGHT), math.sqrt(2 * HEIGHT / G)))
    assert e < 1.0 or hit.restitution == pytest.approx(1.0, rel=1e-12)


def test_the_shipped_drop_rises_to_the_height_of_the_closed_form() -> None:
    scene = db.load_scene("mfix-dem-01")
    run = db.solve(scene, backend="scipy", samples=400, uncertainty=False)
    damping, stiffness = float(scene.contacts.damping[0]), float(scene.contacts.stiffness[0])
    hit = linear_drop(mass=scene.mass[0], stiffness=stiffness, damping=damping, height=HEIGHT, gravity=G)
    # height and speed in free flight
    top = int(np.argmin(np.abs(run.time - hit.touch_time - hit.contact_time - hit.exit_speed / G)))
    height = HEIGHT - run.displacement[top, 0] + 0.5 * run.velocity[top, 0] ** 2 / G
    assert height == pytest.approx(hit.rebound_height, rel=1e-11)  # scipy's own accuracy
    # the planted fault: gravity does not act during the contact
    assert height != pytest.approx(hit.touch_speed**2 * scene.damping.coefficient[0] ** 2 / (2.0 * G), rel=1e-4)  # type: ignore[union-attr, index]


def test_the_shipped_stack_moves_as_the_closed_form() -> None:
    scene = db.load_scene("mfix-dem-03")
    run = db.solve(scene, backend="scipy", samples=50, uncertainty=False)
    order = [1, 0, 2]  # contacts: the pair, then the walls
    contacts = scene.contacts
    stack = linear_stack(
        masses=scene.mass,
        stiffness=contacts.stiffness[order].tolist(),
        overlaps=(-contacts.gap[order]).tolist(),
        damping=contacts.damping[order].tolist(),
        gravity=G,
        times=run.time,
    )
    scale = float(np.max(np.abs(stack.velocity)))
    assert np.max(np.abs(run.velocity - stack.velocity)) < 1e-11 * scale  # scipy's own accuracy
    assert np.max(np.abs(run.displacement - stack.displacement)) < 1e-11 * 1e-4


def test_a_stiff_sphere_rises_as_high_as_a_hard_one() -> None:
    """MFiX DEM-02: what is soft vanishes as the stiffness grows, at a rate of 1/sqrt(k)."""
    [hard] = bounce_heights(height=HEIGHT, restitution=0.7, bounces=1)
    away = [drop(k, 0.7).rebound_height / hard - 1.0 for k in (5e4, 5e6, 5e8)]
    assert away[0] > -0.1
    # the contact time falls tenfold from one to the next
    assert [away[0] / away[1], away[1] / away[2]] == pytest.approx([10.0, 10.0], rel=0.15)


def test_a_slow_sphere_stays_on_the_plane() -> None:
    low = drop(1e4, 0.6, height=1e-6)
    assert (low.contact_time, low.exit_speed, low.rebound_height) == (math.inf, 0.0, 0.0)
    assert low.peak_overlap > MASS * G / 1e4


#: MFiX DEM-03: spheres of 1 mm with 2e4 and 1e4 kg/m^3 between walls at a distance of 1.8 mm, centres at 1/4 and 3/4
MASSES = (1e4 * math.pi / 6.0 * 1e-9, 2e4 * math.pi / 6.0 * 1e-9)
STACK = {"masses": MASSES, "stiffness": (1e3, 1e3, 1e3), "overlaps": (5e-5, 1e-4, 5e-5), "gravity": G}


TIMES = np.linspace(0.0, 2e-3, 9)


def integrated_stack(damping: float) -> np.ndarray:
    """Return displacements and velocities at the times by DOP853, each force written out."""
    m1, m2 = MASSES

    def rate(_: float, y: np.ndarray) -> list[float]:
        x1, x2, v1, v2 = y
        left = 1e3 * (5e-5 - x1) - damping * v1
        middle = 1e3 * (1e-4 + x1 - x2) + damping * (v1 - v2)
        right = 1e3 * (5e-5 + x2) + damping * v2
        return [v1, v2, (left - middle) / m1 + G, (middle - right) / m2 + G]

    return np.asarray(solve_ivp(rate, (0.0, 2e-3), [0.0] * 4, method="DOP853", rtol=1e-12, atol=1e-18, t_eval=TIMES).y)


@pytest.mark.parametrize("damping", [0.0, 0.01])
def test_a_stack_is_that_of_direct_integration(damping: float) -> None:
    stack, truth = linear_stack(**STACK, damping=damping, times=TIMES), integrated_stack(damping)  # type: ignore[arg-type]
    # DOP853 at 1e-12 over ten periods
    assert stack.displacement == pytest.approx(truth[:2].T, abs=1e-9 * 5e-5)
    assert stack.velocity == pytest.approx(truth[2:].T, abs=1e-9 * 0.5)
    assert stack.overlap.sum(axis=1) == pytest.approx(np.full(9, 2e-4), rel=1e-12)


def test_a_dashpot_that_is_missing_is_found() -> None:
    """The planted fault: the dashpot between the spheres does nothing."""
    wrong = linear_stack(**STACK, damping=(0.01, 0.0, 0.01), times=TIMES)  # type: ignore[arg-type]
    assert wrong.displacement != pytest.approx(integrated_stack(0.01)[:2].T, abs=1e-3 * 5e-5)


def test_an_undamped_stack_keeps_its_energy() -> None:
    stack = linear_stack(**STACK, velocities=(0.1, -0.2), times=np.linspace(0.0, 5e-3, 200))  # type: ignore[arg-type]
    kinetic = 0.5 * stack.velocity**2 @ MASSES
    energy = kinetic + 500.0 * (stack.overlap**2).sum(axis=1) - G * stack.displacement @ MASSES
    assert np.ptp(energy) < 1e-11 * energy[0]


def test_the_stack_is_linear_only_while_no_contact_opens() -> None:
    with pytest.raises(ValueError, match=r"^contact [02] is open at .* s; allowed: times up to its opening$"):
        linear_stack(**STACK, velocities=(3.0, 0.0), times=np.linspace(0.0, 1e-3, 50))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"^2 masses, 2 stiffnesses and 3 overlaps; allowed: n, n \+ 1 and n \+ 1"):
        linear_stack(**(STACK | {"stiffness": (1.0, 1.0)}), times=[0.0])  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "wrong",
    [
        {"masses": ()},
        {"masses": (0.0, 1.0)},
        {"masses": (1.0, -1.0)},
        {"stiffness": (1.0, 0.0, 1.0)},
        {"overlaps": (0.1, 0.1, -1e-9)},
        {"overlaps": (0.1, 0.1)},
        {"stiffness": (1.0,) * 4, "overlaps": (0.1,) * 4},
        {"masses": (1.0, math.nan)},
    ],
)
def test_each_number_of_a_stack_is_checked(wrong: dict[str, tuple[float, ...]]) -> None:
    good = {"masses": (1.0, 2.0), "stiffness": (1.0, 1.0, 1.0), "overlaps": (0.1, 0.1, 0.1)}
    assert linear_stack(**good, times=[0.0]).overlap.tolist() == [[0.1, 0.1, 0.1]]  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"overlaps; allowed: n, n \+ 1 and n \+ 1 of them"):
        linear_stack(**(good | wrong), times=[0.0])  # type: ignore[arg-type]


def test_a_contact_of_a_stack_may_just_touch() -> None:
    stack = linear_stack(masses=(2.0,), stiffness=(3.0, 5.0), overlaps=(0.5, 0.0), times=[0.0, math.pi / 2.0])
    # half a period later it is as far beyond the equilibrium at 1.5/8 m
    assert stack.overlap == pytest.approx(np.array([[0.5, 0.0], [0.125, 0.375]]), abs=1e-12)
    with pytest.raises(ValueError, match=r"^contact 1 is open at 0.5 s; allowed: times up to its opening$"):
        linear_stack(
            masses=(2.0,), stiffness=(3.0, 5.0), overlaps=(0.5, 0.0), velocities=-2.0, times=[0.0, 0.5]
        )  # fmt: skip


def test_numbers_outside_the_drop_are_refused_in_one_line() -> None:
    good = {"mass": 1.0, "stiffness": 1.0, "damping": 0.1, "height": 1.0, "gravity": 1.0}
    for name in good:
        with pytest.raises(ValueError, match=rf"^{name} = -1.0; allowed: a"):
            linear_drop(**(good | {name: -1.0}))
    with pytest.raises(ValueError, match=r"^damping = 2.0; allowed: below the critical damping, 2 N s/m$"):
        linear_drop(**(good | {"damping": 2.0}))
