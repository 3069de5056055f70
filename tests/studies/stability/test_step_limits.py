"""Searches for the largest step: what they find where it is known, and faults that they must not pass over."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.lammps_motion import granular
from dem_bridge.backends.reference import Reference
from dem_bridge.backends.splitting import Motion
from dem_bridge.backends.twin import solve_motion, solve_plan
from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.physics.dispersion import dispersion
from dem_bridge.scene.contacts import Contacts
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.studies.stability.points import Measured, chain, engine_on, measured
from dem_bridge.studies.stability.step_limits import (
    FINEST,
    GUARD,
    Limit,
    Stepper,
    accurate_step,
    contacts_of,
    energies,
    energy_gain,
    gain_of,
    largest_step,
    stable_step,
    steps_of,
    struck,
    velocity_error,
)
from dem_bridge.trajectory.dense import Schedule
from dem_bridge.trajectory.trajectory import Trajectory

PAIR = chain("pair", (1e-2, 1e-2), (4e9,))


@pytest.fixture(scope="module")
def pair() -> Measured:
    return measured(PAIR)


def stable(found: Measured, stepper: Stepper = solve_motion, allowed: float = 1.0) -> Limit:
    return stable_step(stepper, found.scene, start=3.0 / found.mode, scale=found.scale, allowed=allowed)[0]


def scene_of(scene: Scene, plan: Schedule, contacts: Contacts) -> Scene:
    """Return the scene that a schedule and contacts stand for."""
    return replace(scene, gap=tuple(contacts.gap.tolist()), duration=plan.steps * plan.step, samples=plan.samples)


def test_a_window_of_good_steps_is_told_and_is_not_the_limit() -> None:
    found = largest_step(lambda dt: dt < 1.0 or 1.5 < dt < 1.8, 4.0)
    assert found.good < 1.0 <= found.bad <= FINEST * found.good
    assert 1.5 < found.window < 1.8
    assert math.isnan(largest_step(lambda dt: dt < 1.0, 4.0).window)


def test_a_limit_above_the_start_is_found_too() -> None:
    found = largest_step(lambda dt: dt < 7.0, 1.0)
    assert found.good < 7.0 <= found.bad <= FINEST * found.good


def test_bad_steps_within_the_guarded_range_are_not_missed() -> None:
    # below the first good step lies a bad band, wider than the distance of the steps that are tried
    found = largest_step(lambda dt: dt < 0.6 or 0.7 < dt < 1.0, 4.0)
    assert found.good < 0.6 <= found.bad
    assert GUARD > 1.0 / 0.6


@pytest.mark.parametrize("always", [True, False], ids=["never fires", "always fires"])
def test_a_criterion_that_decides_nothing_is_caught(always: bool) -> None:
    with pytest.raises(RunBroken, match="no largest step"):
        largest_step(lambda dt: always, 1.0)


def test_an_energy_that_is_never_looked_at_is_caught(pair: Measured, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dem_bridge.studies.stability.step_limits.energy_gain", lambda *_: 0.0)
    monkeypatch.setattr("dem_bridge.studies.stability.step_limits.MOST_TRIES", 40)
    with pytest.raises(RunBroken, match="no largest step"):
        stable(pair, lambda *_: solve_motion(PAIR, steps_of(PAIR, 1e-6)))


def held() -> Scene:
    """Linear while no contact opens: n = 2, pressed together between walls, one body nudged."""
    wall, n = Wall(stiffness=1e6), 4
    return Scene(name="held", duration=1.0, mass=(1e-2,) * n, stiffness=(1e6,) * (n - 1), exponent=2.0,
                 velocity=(1e-6,) + (0.0,) * (n - 1), wall_left=wall, wall_right=wall, precompression=10.0)  # fmt: skip


def test_a_linear_chain_is_stable_up_to_2_over_its_highest_mode() -> None:
    top = dispersion(mass=1e-2, stiffness=1e6, exponent=2.0, static_force=10.0).fixed_modes(4)[-1]
    scene = replace(held(), duration=600.0 / top)
    found = measured(scene)
    assert found.mode == pytest.approx(top, rel=1e-9)
    limit = stable(found)
    # at omega dt = 2 (1 + d) a mode grows by sqrt(8 d) each step: in 300 steps, d = 1e-3 doubles any energy many times
    assert limit.good * top == pytest.approx(2.0, rel=FINEST - 1.0 + 1e-3)

    def longer(scene: Scene, plan: Schedule, contacts: Contacts) -> Motion:
        return solve_motion(scene, replace(plan, step=1.05 * plan.step), contacts)

    # planted: a code that steps by 5 % more than it is asked for
    assert stable(found, longer).good * top == pytest.approx(2.0 / 1.05, rel=FINEST - 1.0 + 1e-3)


def test_energy_is_that_of_the_centre_of_mass_where_there_is_no_wall(pair: Measured) -> None:
    moving = replace(PAIR, velocity=(101.0, 100.0))
    assert not struck(moving)
    fast = measured(moving)
    # 100 m/s of all bodies leave 14 digits of the rest
    assert fast.scale == pytest.approx(pair.scale, rel=1e-10)
    one, other = (gain_of(solve_motion, m.scene, 1.9 / pair.pair, 0.0, m.scale) for m in (pair, fast))
    assert other == pytest.approx(one, rel=1e-6)


def test_what_a_contact_gives_back_is_no_gain(pair: Measured) -> None:
    """Half way through an impact the energy of velocity-Verlet is up; kept is what remains."""
    # here, by phase, an impact takes a little over two steps and gives back what it took
    dt = 1.5 / pair.pair
    contacts = contacts_of(PAIR, 0.5 * PAIR.velocity[0] * dt)
    run = solve_motion(PAIR, steps_of(PAIR, dt), contacts)
    total = energies(PAIR, run, contacts)[1] / pair.scale
    assert np.max(total) - total[0] > 0.1 > 3.0 * abs(energy_gain(PAIR, run, pair.scale, contacts))


def test_the_phase_of_the_touch_counts(pair: Measured) -> None:
    dt = 1.9 / pair.pair
    gains = [gain_of(solve_motion, PAIR, dt, phase, pair.scale) for phase in np.linspace(0.0, 0.9, 10)]
    assert max(gains) > 1.0 > min(gains)
    alone, _ = stable_step(solve_motion, PAIR, start=3.0 / pair.mode, scale=pair.scale, allowed=1.0, phases=(0.0,))
    assert stable(pair).good <= alone.good


def test_speed_changes_nothing_but_the_scale(pair: Measured) -> None:
    fast = measured(chain("pair", (1e-2, 1e-2), (4e9,), 32.0))
    # 32 times the speed is half the time: all but the last digits of powers
    assert stable(fast).good == pytest.approx(0.5 * stable(pair).good, rel=1e-12)


def test_an_error_is_told_from_none_and_from_another(pair: Measured) -> None:
    def reference(scene: Scene, plan: Schedule, contacts: Contacts) -> Trajectory:
        return Reference().run(scene_of(scene, plan, contacts), Resolution(), Sampling(count=plan.samples))

    def softer(scene: Scene, plan: Schedule, contacts: Contacts) -> Trajectory:
        return reference(replace(scene, stiffness=tuple(0.99 * k for k in scene.stiffness)), plan, contacts)

    # between samples a polynomial stands for the truth; next to a touch it is good to a few 1e-9
    assert velocity_error(reference, PAIR, pair.truth, 1e-6, 0.3) < 1e-7
    # planted: 1 % less stiffness makes an impact longer by 0.4 %
    assert 1e-3 < velocity_error(softer, PAIR, pair.truth, 1e-6, 0.3) < 1e-2


def test_accuracy_follows_second_order(pair: Measured) -> None:
    limits = [
        accurate_step(solve_motion, PAIR, pair.truth, stable=1.7 / pair.mode, accuracy=a).good for a in (1e-3, 1e-5)
    ]
    # errors go up and down by tens of a per cent with the phase of the touch
    assert math.log10(limits[0] / limits[1]) == pytest.approx(1.0, abs=0.1)


def test_the_search_runs_no_step_and_phase_twice(pair: Measured) -> None:
    runs: list[tuple[float, bytes]] = []

    def counted(scene: Scene, plan: Schedule, contacts: Contacts) -> Motion:
        runs.append((plan.step, contacts.gap.tobytes()))
        return solve_motion(scene, plan, contacts)

    limit, phase = stable_step(counted, PAIR, start=3.0 / pair.mode, scale=pair.scale, allowed=1.0)
    assert len(runs) == len(set(runs))
    assert gain_of(solve_motion, PAIR, limit.bad, phase, pair.scale) > 1.0


def test_nothing_in_motion_is_said_in_one_line() -> None:
    with pytest.raises(UsageError, match="nothing moves in pair"):
        measured(replace(PAIR, velocity=(0.0, 0.0)))


@pytest.mark.lammps
def test_lammps_breaks_where_the_twin_does(pair: Measured) -> None:
    limit, phase = stable_step(solve_motion, PAIR, start=3.0 / pair.mode, scale=pair.scale, allowed=1.0)
    with granular(Engine()) as lammps:
        lmp = engine_on(pair, lammps)
        assert lmp is not None
        gains = [gain_of(lmp, PAIR, dt, phase, pair.scale) for dt in (limit.good, limit.bad)]
    assert gains[0] <= 1.0 < gains[1]
    # some tens of steps in positions: a few last digits
    of_twin = [gain_of(solve_motion, PAIR, dt, phase, pair.scale) for dt in (limit.good, limit.bad)]
    assert gains == pytest.approx(of_twin, rel=1e-9)


@pytest.mark.parametrize("scene", [PAIR, replace(PAIR, exponent=2.4)], ids=["fused kernel", "plain kernel"])
def test_a_motion_is_the_run_of_the_scene_it_stands_for_bit_for_bit(scene: Scene) -> None:
    plan, contacts = steps_of(scene, 1e-6, samples=20), contacts_of(scene, 1e-7)
    motion, run = solve_motion(scene, plan, contacts), solve_plan(scene_of(scene, plan, contacts), plan)
    for name in ("time", "displacement", "velocity"):
        assert getattr(motion, name).tobytes() == getattr(run, name).tobytes()
    assert motion.velocity.tobytes() != solve_motion(scene, plan).velocity.tobytes()
