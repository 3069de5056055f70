"""Plans for two bodies on a spring, whose error under velocity-Verlet is known in closed form at every step.

From the touch on, velocity-Verlet turns the relative motion by ``theta`` in each step, ``cos(theta) = 1 - (w dt)^2/2``,
in place of ``w dt``: the relative velocity at step j is ``v cos(j theta)`` and should be ``v cos(j w dt)``.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import dem_bridge as db
from dem_bridge.backends.base import Sampling
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.runs.planning.predict import OF_RTOL, OF_STEP, Outlook
from dem_bridge.runs.planning.trials import AIM, CLOSE, MARGIN, Candidate, Judge, observed_order
from dem_bridge.scene.scene import Scene
from tests.helpers.strategies import examples

MASS, STIFFNESS, SPEED = (8e-3, 1.2e-2), 4e6, 0.8
OMEGA = math.sqrt(STIFFNESS * (1.0 / MASS[0] + 1.0 / MASS[1]))
#: 0.9 of the time in touch: the spring is compressed from the start to the end
SPRING = Scene(
    name="spring", duration=0.9 * math.pi / OMEGA, mass=MASS, stiffness=(STIFFNESS,), exponent=2.0,
    velocity=(SPEED, 0.0), samples=10,
)  # fmt: skip
OUTLOOK = Outlook(scene=SPRING, prescan=prescan_scene(SPRING), sampling=Sampling(count=10))
VERLET = Candidate(name="verlet", runs="verlet", knob="dt", order=2.0, kind=2)


def closed_form(steps: int) -> float:
    """Return the velocity error of a run of so many steps, relative to the largest velocity of a sample."""
    phase = OMEGA * SPRING.duration / steps
    turns = np.arange(0, steps + 1, steps // 10)
    exact, stepped = np.cos(turns * phase), np.cos(turns * math.acos(1.0 - 0.5 * phase**2))
    share = np.array([MASS[1], -MASS[0]]) / sum(MASS)  # of each body in the relative velocity
    common = SPEED * MASS[0] / sum(MASS)
    velocity = common + SPEED * exact[:, None] * share
    return float(np.max(np.abs(SPEED * (stepped - exact)[:, None] * share)) / np.max(np.abs(velocity)))


def _judge(reference: bool) -> Judge:
    run = db.solve(SPRING, backend="reference") if reference else None
    sampling = Sampling(count=10)
    return Judge(scene=SPRING, sampling=sampling, observable="velocity", reference=run, progress=lambda label: None)


def test_the_measured_error_of_a_step_is_that_of_the_closed_form() -> None:
    judge = _judge(reference=True)
    trials = [judge.trial(VERLET, SPRING.duration / steps) for steps in (100, 200, 400)]
    for trial, steps in zip(trials, (100, 200, 400), strict=True):
        assert trial.error == pytest.approx(closed_form(steps), rel=1e-6)
        assert trial.cost.steps == steps
    assert observed_order(trials) == pytest.approx(2.0, abs=1e-3)


def test_the_error_without_a_reference_is_at_least_the_true_one_and_not_far_above() -> None:
    # an order a fifth below 2 is taken: (4/3 of the distance to half the step) becomes 1.49 of it
    careful = (1.0 - 2.0**-2) / (1.0 - 2.0**-1.6)
    for steps in (100, 400):
        error = _judge(reference=False).trial(VERLET, SPRING.duration / steps).error
        assert error == pytest.approx(careful * closed_form(steps), rel=1e-3)
        assert error > closed_form(steps)


@pytest.mark.parametrize("accuracy", [1e-3, 1e-5])
def test_a_planned_step_has_its_error_and_is_as_coarse_as_stated(accuracy: float) -> None:
    plan = db.plan(SPRING, accuracy, "verlet")
    assert plan.steps is not None
    error = closed_form(plan.steps)
    assert plan.found_error == plan.predicted_error == pytest.approx(error, rel=1e-5)
    assert error <= MARGIN[2] * accuracy
    law = OF_STEP[2]
    assert plan.model_error == pytest.approx(OUTLOOK.error(law, plan.units["dt"], "velocity"), rel=1e-9)
    assert plan.model_error != plan.found_error
    # a coarser step within the margin may be passed over up to CLOSE, or where the search aims below it
    per_sample = plan.steps // 10
    coarser = 10 * math.floor(per_sample / (CLOSE["dt"] * AIM["dt"] ** -0.5) / 1.05 - 1.0)
    assert closed_form(max(coarser, 10)) > MARGIN[2] * accuracy
    assert plan.units["dt"] == pytest.approx(SPRING.duration / plan.steps, rel=1e-12)
    # the prescan finds the frequency of the spring
    assert plan.units["2/omega"] == pytest.approx(0.5 * OMEGA * plan.units["dt"], rel=1e-9)
    run = db.solve(SPRING, backend=plan.backend, **plan.resolution)
    assert run.cost.steps == plan.steps


@examples(60)
@given(exponent=st.floats(-9.0, -1.0), law=st.sampled_from([*OF_STEP.values(), *OF_RTOL.values()]))
def test_the_setting_of_an_error_has_this_error(exponent: float, law: object) -> None:
    laws = {id(one): one for one in (*OF_STEP.values(), *OF_RTOL.values())}
    chosen, error = laws[id(law)], 10.0**exponent
    setting = OUTLOOK.setting(chosen, error, "velocity")
    # of steps the round-off is added, 2^-52 sqrt(steps)
    digits = 0.0 if chosen in OF_RTOL.values() else 2.0**-52 * math.sqrt(SPRING.duration / setting)
    assert OUTLOOK.error(chosen, setting, "velocity") == pytest.approx(error + digits, rel=1e-9)
    # finer settings are predicted to err less, by the order of the law
    finer = OUTLOOK.setting(chosen, 1e-2 * error, "velocity")
    assert finer / setting == pytest.approx(1e-2 ** (1.0 / chosen.order), rel=1e-9)


def test_costs_grow_with_steps_and_do_not_depend_on_the_unit_of_mass() -> None:
    costs = [OUTLOOK.cost("verlet", SPRING.duration / steps) for steps in (1e3, 1e5, 1e6)]
    assert costs == sorted(costs)
    # ten times the steps: ten times what goes with steps
    assert (costs[2] - costs[1]) / (costs[1] - costs[0]) == pytest.approx((1e6 - 1e5) / (1e5 - 1e3), rel=0.05)
