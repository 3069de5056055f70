"""Hypotheses change what they say, samples are predicted as files hold them, and fits find what was planted."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dem_bridge.formats.readers import Record
from dem_bridge.judging.chain_hypotheses import global_hypotheses
from dem_bridge.judging.decision import Decision
from dem_bridge.judging.fitting import MOST_STEPS_OF_METHOD, Data, Fit, Fitter, Stepping, least
from dem_bridge.judging.hypotheses import Changes, Hypothesis, Variant
from dem_bridge.judging.kernels import KICK_EULER, RK4, VERLET, System
from dem_bridge.judging.model import Model, system_of
from dem_bridge.judging.samples import half_steps, sample_hypotheses
from dem_bridge.judging.search import Search
from dem_bridge.scene.file import parse_scene
from dem_bridge.scene.scene import Damping, Scene, Wall
from dem_bridge.trajectory.trajectory import Floats
from tests.helpers.judged_records import CHAIN

WALLED = replace(CHAIN, wall_left=Wall(stiffness=3e9), wall_right=Wall(stiffness=4e9), gap=(3e-6, 0.0, 0.0, 0.0))
STEPS = 35
DT = CHAIN.duration / CHAIN.samples / STEPS


def file_of(
    scene: Scene = WALLED, system: System | None = None, *, dt: float | None = DT, method: int = VERLET,
    stated: bool = False, rounding: float = 1e-12, **fields: Any,
) -> Record:  # fmt: skip
    """Return what a code of a method writes, or the exact motion for no step; roundings are relative."""
    model, time = Model(scene), np.linspace(0.0, scene.duration, scene.samples + 1)
    system = system or model.system
    motion = model.exact(system, time, 1e-13) if dt is None else model.stepped_at(system, time, dt, method)
    places = Changes(scene, model).places()
    values = {
        "velocity": motion.velocity,
        "displacement": motion.displacement,
        "contact_force": motion.force[:, places],
    }
    errors = {name: np.full(part.shape, rounding * float(np.max(np.abs(part)))) for name, part in values.items()}
    return Record(
        name="file", time=time, values=values, columns={name: tuple(range(p.shape[1])) for name, p in values.items()},
        rounding={**errors, "time": np.zeros(len(time))}, dt=dt if stated else None, **fields,
    )  # fmt: skip


def data_of(record: Record, scene: Scene = WALLED) -> Data:
    return Data(record, Model(scene), {})


def rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


# ---------------------------------------------------------------- least squares
def test_least_squares_are_those_of_linear_algebra_for_columns_of_any_size() -> None:
    random = np.random.default_rng(1)
    columns, target = random.standard_normal((40, 3)) * [1e-6, 1.0, 1e8], random.standard_normal(40)
    truth = np.linalg.lstsq(columns / [1e-6, 1.0, 1e8], target, rcond=None)[0] / [1e-6, 1.0, 1e8]
    np.testing.assert_allclose(least(columns, target), truth, rtol=1e-9)
    # a column of nothing has no part, two equal columns share one, and what is no number moves nothing
    np.testing.assert_allclose(least(np.column_stack([columns[:, 1], np.zeros(40)]), target)[1], 0.0)
    twice = least(columns[:, [1, 1]], target)
    np.testing.assert_allclose(twice.sum(), least(columns[:, [1]], target)[0], rtol=1e-9)
    assert list(least(np.full((40, 2), np.nan), target)) == [0.0, 0.0]
    assert least(np.zeros((40, 0)), target).shape == (0,)


# ---------------------------------------------------------------- what a file would hold
def test_a_right_file_is_predicted_in_all_its_columns_walls_included() -> None:
    exact = data_of(file_of(dt=None))
    assert {block.quantity for block in exact.blocks} == {0, 1, 2}
    assert rms(exact.residual(exact.predict(Variant(exact.model.system), 41, 1e-13))) < 1.2
    # the second writing of the columns of contacts: chain, left wall, right wall
    force, overlap = exact.blocks[2].values, exact.blocks[1].values
    np.testing.assert_allclose(force[:, 4], 3e9 * np.maximum(-overlap[:, 0], 0.0) ** 1.5, rtol=1e-9)
    np.testing.assert_allclose(force[:, 5], 4e9 * np.maximum(overlap[:, 4], 0.0) ** 1.5, rtol=1e-9)
    stepped = data_of(file_of(stated=True))
    assert rms(stepped.residual(stepped.predict(Variant(stepped.model.system), 41, 1e-13, Stepping(VERLET, DT)))) < 1.2
    assert rms(stepped.residual(stepped.predict(Variant(stepped.model.system), 41, 1e-13))) > 1e3


def test_late_velocities_shifts_factors_and_orders_are_written_as_they_say() -> None:
    data = data_of(file_of(dt=None))
    system = data.model.system
    v, x, f = data.predict(Variant(system), 41, 1e-13)
    time = np.array(data.time)
    late = data.predict(Variant(system, late=1e-7), 41, 1e-13)
    motion = data.model.exact(system, time, 1e-13)
    np.testing.assert_allclose(late[0][1:], (v - 1e-7 * motion.acceleration)[1:], atol=1e-12)
    assert np.all(np.isnan(late[0][0]))  # half a step before the start there is no velocity
    np.testing.assert_array_equal(late[1][1:], x[1:])
    np.testing.assert_array_equal(late[2][1:], f[1:])
    shifted = data.predict(Variant(system, shift=data.interval), 41, 1e-13)
    assert np.all(np.isnan(shifted[1][0]))
    np.testing.assert_allclose(shifted[1][1:], x[:-1], atol=1e-15)
    np.testing.assert_allclose(data.predict(Variant(system, lag=1), 41, 1e-13)[0][1:], v[:-1], atol=1e-9)
    scaled = data.predict(Variant(system, factors=(2.0, 3.0, 5.0)), 41, 1e-13)
    for part, factor, plain in zip(scaled, (2.0, 3.0, 5.0), (v, x, f), strict=True):
        np.testing.assert_allclose(part, factor * plain)
    turned = data.predict(Variant(system, order=(4, 3, 2, 1, 0)), 41, 1e-13)
    np.testing.assert_array_equal(turned[0], v[:, ::-1])
    np.testing.assert_array_equal(turned[2], f[:, [3, 2, 1, 0, 5, 4]])


def test_digits_of_times_are_noise_where_values_change() -> None:
    record = file_of(dt=None)
    data = data_of(replace(record, rounding={**record.rounding, "time": np.full(41, 1e-8)}))
    slope = np.abs(data.model.exact(data.model.system, np.array(record.time), 1e-13).acceleration)
    # a uniform error; where bodies rest the digits of the velocity remain
    fast = slope > 1e-3 * np.max(slope)
    np.testing.assert_allclose(data.blocks[0].sigma[fast], 1e-8 * slope[fast] / math.sqrt(3.0), rtol=1e-3)


def test_displacements_from_the_first_sample_start_at_zero() -> None:
    record = file_of(dt=None, displacement_from_first=True)
    data = data_of(replace(record, time=record.time[5:], values={k: v[5:] for k, v in record.values.items()},
                           rounding={k: v[5:] for k, v in record.rounding.items()}))  # fmt: skip
    predicted = data.predict(Variant(data.model.system), 36, 1e-13)[1]
    whole = record.values["displacement"]
    np.testing.assert_allclose(predicted, (whole - whole[5])[5:], atol=1e-15)


def test_a_step_in_the_unit_of_the_times_is_scaled_with_them_and_another_is_not() -> None:
    # times and the step are three times too large; the step 35.4 times in an interval is in a unit of its own
    record, system = file_of(stated=True), Model(WALLED).system
    for dt, used in ((3.0 * DT, DT), (3.0 * DT * 35.0 / 35.4, 3.0 * DT * 35.0 / 35.4)):
        data = data_of(replace(record, time=3.0 * record.time, dt=dt))
        motion, times = data.motion(Variant(system, scale=1.0 / 3.0), 41, 1e-13, Stepping(VERLET, dt))
        np.testing.assert_allclose(times, record.time, atol=1e-18)
        right = data.model.stepped_at(system, np.clip(record.time, 0.0, None), used, VERLET)
        np.testing.assert_allclose(motion.velocity, right.velocity, atol=1e-13)


def test_the_error_of_the_step_is_a_nuisance_of_any_size_but_not_for_a_method() -> None:
    data = data_of(file_of())
    exact, system = data.predict(Variant(data.model.system), 41, 1e-13), data.model.system
    step = [stepped - right for stepped, right in zip(
        data.predict(Variant(system), 41, 1e-13, Stepping(VERLET, 0.5 * DT)), exact, strict=True)]  # fmt: skip
    with_it, without = Fitter(data, step, 1e-13), Fitter(data, None, 1e-13)
    plain = rms(without.residual(Variant(system), 41, 0.0))
    # the error at half the step has the same shape, and a quarter of the size
    assert rms(with_it.residual(Variant(system), 41, 0.0)) < 0.02 * plain
    stepping = Stepping(VERLET, 0.5 * DT)
    assert rms(with_it.residual(Variant(system), 41, 0.0, stepping)) == pytest.approx(0.75 * plain, rel=0.02)
    method = Variant(system, method=VERLET, dt=0.5 * DT)
    assert rms(with_it.residual(method, 41, 0.0)) == pytest.approx(0.75 * plain, rel=0.02)
    # a file that a hypothesis says nothing of is not explained by it
    assert np.all(with_it.residual(Variant(system, shift=30 * data.interval), 41, 0.0) == 1e6)


def test_a_fit_finds_a_mass_from_the_scene() -> None:
    change = Changes(WALLED, Model(WALLED))
    wrong = change.one_mass(2)(np.array([math.log(1.02)])).system
    data = data_of(file_of(system=wrong, dt=None))
    hypothesis = Hypothesis("mass", change.one_mass(2), "")
    hypothesis = replace(hypothesis, starts=((0.0,),))
    p, left = Fitter(data, None, 1e-13).fit(hypothesis, np.zeros(1), 41, 0.0)
    # to the linear steps of a difference quotient
    assert p[0] == pytest.approx(math.log(1.02), rel=1e-4)
    assert left < 50.0


# ---------------------------------------------------------------- method and step
@pytest.fixture(scope="module")
def unstated() -> Decision:
    """Return the decision on a right file that does not state its step."""
    return Decision(data_of(file_of()))


NONE = Hypothesis("none", lambda p: Variant(Model(WALLED).system), "")


def test_a_step_is_found_from_its_error_alone(unstated: Decision, monkeypatch: pytest.MonkeyPatch) -> None:
    # another hypothesis leaves so little that no list of steps is tried
    rival = Fit(NONE, np.zeros(0), 1.5, 0.0, 1e-6, np.zeros(0))
    for start in (0.25, 1.7, 4.0):
        monkeypatch.setattr(unstated, "step", start * DT)
        result = unstated.decide(NONE, np.zeros(0), rival)
        assert result.stepping == pytest.approx((VERLET, DT), rel=1e-12)
        assert result.rms < 1.2


def test_method_and_step_of_a_right_file_are_decided() -> None:
    rk4 = Decision(data_of(file_of(method=RK4, dt=DT * 35 / 8)))
    fit = rk4.decide(NONE, np.zeros(0))
    assert fit.stepping == pytest.approx((RK4, DT * 35 / 8))
    stated = Decision(data_of(file_of(stated=True)))
    assert stated.step == DT
    assert stated.decide(NONE, np.zeros(0)).stepping == Stepping(VERLET, DT)


def test_the_step_of_a_method_that_explains_is_a_part_of_the_interval() -> None:
    decision = Decision(data_of(file_of(method=KICK_EULER)))
    euler = next(each for each in half_steps(decision.data, DT) if each.make(np.zeros(1)).method == KICK_EULER)
    fit = decision.decide(euler, np.array([-math.log(36.4)]))
    assert euler.value(float(fit.parameters[0])) == pytest.approx(DT, rel=1e-12)
    assert fit.rms < 1.2


def test_a_step_that_would_take_long_is_not_repeated() -> None:
    data = data_of(replace(file_of(), dt=1e-12))
    decision = Decision(data)
    assert WALLED.duration / 4e5 <= decision.step <= WALLED.duration / 2e4
    data.dt = None
    assert Decision(data).step == decision.step


def test_the_deviation_of_a_parameter_is_that_of_least_squares() -> None:
    change = Changes(WALLED, Model(WALLED))
    hypothesis = Hypothesis("mass", change.one_mass(2), "", starts=((0.0,),))
    decision = Decision(data_of(file_of(dt=None, rounding=1e-4)))
    data, fit = decision.data, decision.decide(hypothesis, np.zeros(1))
    moved, unmoved = (
        data.residual(data.predict(hypothesis.make(p), 41, 1e-13)) for p in (np.full(1, 1e-5), np.zeros(1))
    )
    slope = (moved - unmoved) / 1e-5
    # noise is one at least, however well it fits
    assert fit.deviation[0] == pytest.approx(1.0 / np.linalg.norm(slope), rel=1e-3)
    assert 1e-6 < fit.deviation[0] < 1e-3


def test_an_effect_is_measured_in_floors_of_digits_of_the_step_and_of_what_is_left() -> None:
    change = Changes(WALLED, Model(WALLED))
    heavier = Hypothesis("mass", change.one_mass(2), "", starts=((0.0,),))
    p = np.array([0.02])
    wrong = heavier.make(p).system
    for rounding in (1e-4, 1e-6):
        decision = Decision(data_of(file_of(system=wrong, dt=None, rounding=rounding)))
        fit = decision.decide(heavier, p)
        expected = max(
            float(np.max(np.abs(block.values - exact))) / (rounding * float(np.max(np.abs(block.values))))
            for block, exact in zip(decision.data.blocks, decision.exact, strict=True)
        )
        assert decision.effect(fit) == pytest.approx(expected, rel=0.01)
    # of a code with a step its error is the floor, which is far above the digits
    decision = Decision(data_of(file_of(system=wrong, stated=True)))
    stepping = Stepping(VERLET, DT)
    fit = decision.decide(heavier, p)
    assert (fit.stepping, fit.parameters[0]) == (stepping, pytest.approx(0.02, rel=1e-3))
    error, effect = decision.data.largest(decision.data.predict(heavier.make(p), 41, 1e-13), decision.exact), 0.0
    for block, left, exact in zip(decision.data.blocks, error, decision.exact, strict=True):
        step = float(np.max(np.abs(decision.data.predict(heavier.make(p), 41, 1e-13)[block.quantity] - block.values)))
        effect = max(effect, left / step)
        assert exact.shape == block.values.shape
    assert decision.effect(fit) == pytest.approx(effect, rel=0.01)


def test_noise_is_measured_in_floors_of_the_file() -> None:
    random = np.random.default_rng(4)
    record = file_of(dt=None, rounding=1e-9)
    noisy = {k: v + 1e-5 * np.max(np.abs(v)) * random.uniform(-1.0, 1.0, v.shape) for k, v in record.values.items()}
    decision = Decision(data_of(replace(record, values=noisy)))
    left = rms(decision.data.residual(decision.exact))
    fit = Fit(NONE, np.zeros(0), left, 0.0, 1e-5, np.zeros(0))
    # the step of a search is finer than the noise
    assert 100.0 < decision.effect_of_noise(fit) < 1e4
    # what a step explains is no noise
    stepped = Decision(data_of(file_of(rounding=1e-9)))
    right = stepped.decide(NONE, np.zeros(0))
    assert stepped.effect_of_noise(right) == 0.0
    stated = Decision(data_of(file_of(rounding=1e-9, stated=True)))
    assert stated.effect_of_noise(stated.decide(NONE, np.zeros(0))) < 1.1


def test_errors_of_bodies_that_have_not_met_anything_are_at_rest() -> None:
    record = file_of(dt=None)
    decision = Decision(data_of(record))
    assert decision.error_at_rest() < 1e-9
    for name, body, row in (("velocity", 0, 0), ("velocity", 4, 1), ("displacement", 4, 1)):
        wrong = {k: v.copy() for k, v in record.values.items()}
        wrong[name][row, body] += 1e-3 * np.max(np.abs(wrong[name]))
        planted = Decision(data_of(replace(record, values=wrong)))
        assert planted.error_at_rest() == pytest.approx(1e-3, rel=0.01)
    late = {k: v.copy() for k, v in record.values.items()}
    late["velocity"][20, 1] += 1e-3
    assert Decision(data_of(replace(record, values=late))).error_at_rest() < 1e-9


# ---------------------------------------------------------------- hypotheses
#: young's modulus, Poisson's ratio and radius of four spheres, the striker first
YOUNG, POISSON = np.array([48e9, 70e9, 200e9, 3e9]), np.array([0.2, 0.33, 0.3, 0.4])
RADIUS = np.array([0.01, 0.02, 0.03, 0.015])
MATERIALS = "".join(
    f"[materials.m{k}]\nyoungs_modulus = {young}\npoissons_ratio = {poisson}\ndensity = 2000.0\n"
    for k, (young, poisson) in enumerate(zip(YOUNG, POISSON, strict=True))
)
CELLS = "".join(
    f'[[chain.pattern.cell]]\nshape = "sphere"\nradius = {RADIUS[k]}\nmaterial = "m{k}"\n' for k in (1, 2, 3)
)
SPHERES = f"""
name = "four"
duration = 1e-3
{MATERIALS}
[chain.pattern]
repeat = 1
{CELLS}
[chain.striker]
radius = {RADIUS[0]}
material = "m0"
velocity = 0.5
"""


def of_cause(scene: Scene, *causes: str) -> list[Hypothesis]:
    return [each for each in global_hypotheses(scene, Model(scene)) if each.cause in causes]


def test_gravity_starts_from_none_and_from_that_of_the_earth_in_both_directions() -> None:
    scene = replace(CHAIN, gravity=2.0)
    (hypothesis,) = of_cause(scene, "gravity")
    assert sorted(hypothesis.value(p) for (p,) in hypothesis.starts) == pytest.approx([-9.81, -2.0, 0.0, 9.81])
    for p in (-3.0, 0.5):
        system = hypothesis.make(np.array([p])).system
        np.testing.assert_allclose(system.free - system_of(scene).free, hypothesis.value(p), rtol=1e-9)


def test_every_fit_may_return_to_the_scene_and_starts_within_its_bounds() -> None:
    for hypothesis in global_hypotheses(CHAIN, Model(CHAIN)):
        low, high = hypothesis.bounds
        assert all(low <= p <= high for start in hypothesis.starts for p in start[:1])
        if hypothesis.size and not hypothesis.logarithmic:
            assert low <= 0.0 < high
            if hypothesis.cause != "modulus" and hypothesis.cause != "missing-sqrt-radius":
                same, base = hypothesis.make(np.zeros(hypothesis.size)).system, Model(CHAIN).system
                np.testing.assert_allclose(same.stiffness, base.stiffness)
                np.testing.assert_allclose(same.mass, base.mass)
                assert not same.damped


def test_masses_change_without_the_weight_and_with_their_damping() -> None:
    scene = replace(CHAIN, gravity=-9.81, damping=Damping(law="kuwabara-kono", coefficient=1e-6))
    change = Changes(scene, Model(scene))
    system = change.with_factors(mass=2.0, stiffness=3.0)
    np.testing.assert_allclose(system.free, -9.81, rtol=1e-12)
    np.testing.assert_allclose(system.mass, 2.0 * np.array(scene.mass))
    # its constant is proportional to the stiffness
    np.testing.assert_allclose(system.damping, 3.0 * change.base.damping)
    stiffer = change.one_stiffness(2)(np.array([math.log(1.5)])).system
    np.testing.assert_allclose(stiffer.stiffness / np.where(change.base.stiffness > 0.0, change.base.stiffness, 1.0),
                               [0.0, 1.0, 1.5, 1.0, 1.0, 0.0])  # fmt: skip


@pytest.mark.parametrize("law", ["kuwabara-kono", "dashpot", "tsuji"])
def test_another_exponent_bends_the_damping_of_its_law(law: str) -> None:
    coefficient = {"kuwabara-kono": 1e-6, "dashpot": 5.0, "tsuji": 0.2}[law]
    scene = replace(CHAIN, damping=Damping(law=law, coefficient=coefficient))
    bent = Changes(scene, Model(scene)).bent(0.25)
    # force = constant rate overlap^power: n - 2, 0, and half of n - 2
    power = {"kuwabara-kono": 0.75, "dashpot": 0.0, "tsuji": 0.375}[law]
    inner = bent.stiffness > 0.0
    np.testing.assert_allclose(bent.exponent[inner], 2.75)
    np.testing.assert_allclose(bent.damping_power[inner], power)
    assert not bent.hertz


def test_moduli_and_radii_of_a_geometry_make_patterns_of_stiffness() -> None:
    scene = parse_scene(SPHERES)
    base, zero, young, loss = Model(scene).system, np.zeros(1), YOUNG, 1.0 - POISSON**2
    modulus = 1.0 / (loss[:-1] / young[:-1] + loss[1:] / young[1:])
    reduced = RADIUS[:-1] * RADIUS[1:] / (RADIUS[:-1] + RADIUS[1:])
    ratios = {
        "missing-sqrt-radius": [1.0 / np.sqrt(reduced), 1.0 / base.stiffness[1:-1]],
        # of the first body, of the second, and of both without Poisson's ratio
        "modulus": [young[:-1] / modulus, young[1:] / modulus, 1.0 / (1.0 / young[:-1] + 1.0 / young[1:]) / modulus],
    }
    for cause, patterns in ratios.items():
        made = [each.make(zero).system.stiffness[1:-1] / base.stiffness[1:-1] for each in of_cause(scene, cause)]
        for pattern in patterns:
            expected = pattern / np.exp(np.mean(np.log(pattern)))
            assert any(np.allclose(ratio, expected, rtol=1e-9) for ratio in made)


def test_patterns_leave_walls_alone() -> None:
    scene = replace(WALLED, mass=(8e-3, 2e-2, 5e-2, 1e-2, 1e-2))
    base = Model(scene).system
    patterns = of_cause(scene, "modulus", "missing-sqrt-radius")
    assert patterns
    for hypothesis in patterns:
        changed = hypothesis.make(np.array([0.5])).system.stiffness / base.stiffness
        assert (changed[0], changed[-1]) == (1.0, 1.0)
        # the mean factor between bodies is the parameter
        assert np.mean(np.log(changed[1:-1])) == pytest.approx(0.5)
    assert any(np.ptp(each.make(np.zeros(1)).system.stiffness[1:-1]) < 1.0 for each in patterns)


def test_units_of_each_quantity_are_recognised_by_their_size() -> None:
    record = file_of(dt=None)
    for name, factors in (("velocity", (1e3, 1.0, 1.0)), ("displacement", (1.0, 1e6, 1.0)),
                          ("contact_force", (1.0, 1.0, 1e-3))):  # fmt: skip
        factor = max(factors) if max(factors) > 1.0 else min(factors)
        data = data_of(replace(record, values={**record.values, name: factor * record.values[name]}))
        exact = data.predict(Variant(data.model.system), 41, 1e-13)
        made = [
            each.make(np.zeros(0)) for each in sample_hypotheses(data, exact) if each.cause == "units" and not each.size
        ]
        assert any(each.factors == pytest.approx(factors) and each.scale == 1.0 for each in made)
        right = next(each for each in made if each.factors == pytest.approx(factors) and each.scale == 1.0)
        assert rms(data.residual(data.predict(right, 41, 1e-13))) < 1.2


def test_a_step_that_is_fitted_is_at_most_the_interval_of_the_samples() -> None:
    data = data_of(file_of())
    for hypothesis in half_steps(data, DT):
        low, high = hypothesis.bounds
        assert hypothesis.value(high) == pytest.approx(data.interval)
        # at the smallest one a run takes as many steps as are allowed
        assert data.time[-1] / hypothesis.value(low) < MOST_STEPS_OF_METHOD
        assert hypothesis.value(hypothesis.starts[0][0]) == pytest.approx(DT)
        variant = hypothesis.make(np.array([math.log(0.5)]))
        assert variant.dt == pytest.approx(0.5 * data.interval)
        assert abs(variant.late) in (0.0, pytest.approx(0.25 * data.interval))


def test_a_difference_ranks_its_cause_first_and_guesses_its_size() -> None:
    change = Changes(CHAIN, Model(CHAIN))
    wrong = change.one_mass(2)(np.array([math.log(1.002)])).system
    search = Search(CHAIN, file_of(CHAIN, wrong, dt=None), {})
    masses = [
        Hypothesis("mass", change.one_mass(k), "", starts=((0.0,), (0.7,), (-0.7,)), where=f"body {k}")
        for k in range(5)
    ]
    first = int(np.flatnonzero(search.errors >= 0.05 * np.max(search.errors))[0])
    # from where the difference is seen: eight samples, and twice as many each
    assert search.windows() == [*(first + 8 * 2**k for k in range(3) if first + 8 * 2**k < 41), 41]
    rows = search.windows()[0]
    ranked = search.rank(masses, rows)
    assert ranked[0].hypothesis.where == "body 2"
    # linear in the cause
    assert ranked[0].parameters[0] == pytest.approx(math.log(1.002), rel=0.05)
    assert ranked[0].left < 0.05
    assert [candidate.left for candidate in ranked] == sorted(candidate.left for candidate in ranked)
    assert all(0.05 < candidate.left <= 1.0 + 1e-9 for candidate in ranked[1:])
