"""The rules of the planner against hand-computed numbers: error and cost laws, candidates, errors by finer runs."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.backends.base import BACKENDS, ENGINE_BACKENDS, Resolution, Sampling
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.runs.planning import trials as check
from dem_bridge.runs.planning.answer import errors_by_setting, evidence_of
from dem_bridge.runs.planning.backend_options import Options
from dem_bridge.runs.planning.predict import OF_RTOL, OF_STEP, Outlook
from dem_bridge.runs.planning.trials import Candidate, Judge, Settled, Trial, confirm, observed_order, settle
from dem_bridge.scene.scene import Damping, Scene
from dem_bridge.trajectory.trajectory import Trajectory
from tests.runs.planning.test_planner import DAMPED, FIVE, PAIR, SOFT

#: ten samples of 1e-5 s, a contact of 1e5 rad/s, and 200 steps of 0.1 rad: a phase of 20 rad
SAMPLES = Sampling(count=10)
SCAN = replace(prescan_scene(PAIR), frequency=1e5, steps=200)
OUTLOOK = Outlook(scene=PAIR, prescan=SCAN, sampling=SAMPLES)
EPS = 2.0**-52
VERLET = Candidate(name="verlet", runs="verlet", knob="dt", order=2.0, kind=2)


# laws of error and cost, with the numbers of runs/planning/predict


def test_the_phase_is_that_of_the_steps_of_the_prescan() -> None:
    assert OUTLOOK.phase == pytest.approx(20.0)
    damped = replace(PAIR, damping=Damping(law="dashpot", coefficient=1.0))
    assert Outlook(scene=damped, prescan=SCAN, sampling=SAMPLES).phase == pytest.approx(2.0)
    law = replace(PAIR, law=lambda overlap: 4e9 * overlap**1.5)
    assert Outlook(scene=law, prescan=SCAN, sampling=SAMPLES).phase == pytest.approx(1e5 * PAIR.duration)
    assert Outlook(scene=PAIR, prescan=replace(SCAN, steps=3), sampling=SAMPLES).phase == 1.0
    assert Outlook(scene=law, prescan=replace(SCAN, frequency=1.0), sampling=SAMPLES).phase == 1.0


@pytest.mark.parametrize(
    ("observable", "factor", "growth"),
    [("velocity", 1.0, 0.0), ("peak_force", 5.0, -0.69), ("arrival", 3.7, -0.81), ("momentum", 1.0, 0.0)],
)
def test_errors_of_steps_and_tolerances_are_those_of_their_law(observable: str, factor: float, growth: float) -> None:
    # order 2: 1e-2 phase^0.75 (omega dt)^2, and the round-off of 1000 steps
    of_step = factor * 1e-2 * 20.0 ** (0.75 + growth) * 1e-2**2
    found = OUTLOOK.error(OF_STEP[2], 1e-7, observable)
    assert found == pytest.approx(of_step + EPS * math.sqrt(1000.0), rel=1e-12, abs=0.0)
    assert OUTLOOK.setting(OF_STEP[2], of_step, observable) == pytest.approx(1e-7, rel=1e-12)
    # scipy: 2e-2 phase^0.68 rtol^0.83, without round-off of steps
    of_rtol = factor * 2e-2 * 20.0 ** (0.68 + growth) * 1e-8**0.83
    assert OUTLOOK.error(OF_RTOL["scipy"], 1e-8, observable) == pytest.approx(of_rtol, rel=1e-12)
    assert OUTLOOK.setting(OF_RTOL["scipy"], of_rtol, observable) == pytest.approx(1e-8, rel=1e-12)


def test_the_round_off_of_all_steps_is_added_to_the_error() -> None:
    # at 1e-14 s there are 1e10 steps, whose truncation is nothing
    assert OUTLOOK.error(OF_STEP[2], 1e-14, "velocity") == pytest.approx(EPS * 1e5, rel=1e-3, abs=0.0)
    still = Outlook(scene=PAIR, prescan=replace(SCAN, frequency=0.0), sampling=SAMPLES)
    assert still.setting(OF_STEP[2], 1e-3, "velocity") == math.inf
    assert "2/omega" not in still.units(1e-7)
    assert OUTLOOK.units(1e-7)["2/omega"] == pytest.approx(5e-3)
    slow = Outlook(scene=PAIR, prescan=replace(SCAN, frequency=0.5), sampling=SAMPLES)
    assert slow.units(1e-7)["2/omega"] == pytest.approx(2.5e-8)
    longer = slow.setting(OF_STEP[2], 1e-3, "velocity") / OUTLOOK.setting(OF_STEP[2], 1e-3, "velocity")
    assert longer == pytest.approx(2e5)


def test_costs_count_runs_samples_steps_and_bodies() -> None:
    # the fast kernel: 4e-4 s a run; a dense sample for each 0.1 rad of 1e-5 s: 10 a sample; 1000 steps of two bodies
    step = 4e-4 + 100 * (5e-8 + 2 * 6e-9) + 1000 * (2.8e-8 + 2 * 2.2e-10)
    assert OUTLOOK.cost("verlet", 1e-7) == pytest.approx(step, rel=1e-12)
    six = 4e-4 + 100 * (5e-8 + 2 * 6e-9) + 6000 * (2.8e-8 + 2 * 2.2e-10)
    assert OUTLOOK.cost("blanes-moan", 1e-7) == pytest.approx(six, rel=1e-12)
    granular = 8.8e-3 + 100 * (7.2e-6 + 2 * 3.1e-7) + 1000 * (6.1e-7 + 2 * 2.5e-8)
    assert OUTLOOK.cost("lammps-granular", 1e-7) == pytest.approx(granular, rel=1e-12)
    # no step is longer than a sample, and no fewer rows are kept than samples
    slow = Outlook(scene=PAIR, prescan=replace(SCAN, frequency=10.0), sampling=SAMPLES)
    assert slow.cost("verlet", 1.0) == pytest.approx(4e-4 + 10 * (5e-8 + 2 * 6e-9) + 10 * (2.8e-8 + 4.4e-10), rel=1e-12)
    fine = 4e-4 + 10 * (5e-8 + 2 * 6e-9) + 1000 * (2.8e-8 + 4.4e-10)
    assert slow.cost("verlet", 1e-7) == pytest.approx(fine, rel=1e-12)
    # adaptive: once + factor bodies^a steps^b (rtol/1e-6)^c
    scipy = 7e-3 + 6.7e-4 * 2**1.19 * 200**0.33 * 1e-4**-0.06
    assert OUTLOOK.cost("scipy", 1e-10) == pytest.approx(scipy, rel=1e-12)
    assert OUTLOOK.cost("reference") == pytest.approx(5e-4 + 3e-5 * 2**1.63 * 200**0.12, rel=1e-12)
    assert OUTLOOK.cost("bca") == pytest.approx(3e-4, rel=1e-12)
    damped = Outlook(
        scene=replace(PAIR, damping=Damping(law="dashpot", coefficient=1.0)), prescan=SCAN, sampling=SAMPLES
    )
    assert damped.cost("scipy", 1e-6) == pytest.approx(7e-3 + 6.7e-4 * 2**1.19 * 20**0.33, rel=1e-12)


def test_codes_without_a_setting_have_known_errors() -> None:
    assert OUTLOOK.known_error("reference", "velocity") == pytest.approx(3e-15 * 20**1.33 + EPS, rel=1e-12, abs=0.0)
    assert OUTLOOK.known_error("bca", "arrival_at_end") == 0.07
    assert OUTLOOK.known_error("adiabatic", "crossing_time") == 0.26
    assert OUTLOOK.known_error("bca", "velocity") == math.inf


# candidates


def _options(scene: Scene, accuracy: float, name: str | None = None, observable: str = "velocity") -> Options:
    return Options(scene, accuracy, name, observable, Sampling(count=scene.samples), {"ode45": "asked for"})


def test_candidates_are_those_that_solve_the_scene_at_a_cost_of_their_own() -> None:
    options = _options(FIVE, 1e-4)
    names = [option.candidate.name for option in options.predicted]
    assert set(names) | set(options.left_out) == set(BACKENDS)
    assert {"reference", "scipy", "verlet", "blanes-moan"} == set(names)
    assert options.left_out["ode45"] == "asked for"
    assert all("the twin gives the same numbers" in options.left_out[name] for name in (*ENGINE_BACKENDS, "ase"))
    assert [option.cost for option in options.predicted] == sorted(option.cost for option in options.predicted)
    # the series have no exponent of 2.3; and a code that is named is a candidate though its twin is cheaper
    assert "do not fit the scene" in _options(SOFT, 1e-4).left_out["reference"]
    assert [option.candidate.runs for option in _options(FIVE, 1e-4, "lammps-granular").predicted] == ["verlet"]
    assert [option.candidate.order for option in _options(DAMPED, 1e-4, "verlet").predicted] == [1.0]


def test_theories_are_candidates_for_times_and_codes_without_a_setting_have_none() -> None:
    free = replace(FIVE, name="free", gap=0.0, wall_right=None)
    of_times, of_speeds = (_options(free, 1e-2, observable=name) for name in ("arrival_at_end", "velocity"))
    settings = {option.candidate.name: option.setting for option in of_times.predicted}
    assert settings["bca"] == settings["adiabatic"] == settings["reference"] == 0.0
    assert not {"bca", "adiabatic"} & {option.candidate.name for option in of_speeds.predicted}
    for name in ("bca", "adiabatic"):
        assert of_speeds.left_out[name] == ("it solves other equations, which approximate times alone, not velocity")
    # scipy takes rtol alone
    [scipy] = _options(FIVE, 1e-4, "scipy").predicted
    assert scipy.candidate.settings_at(1e-6) == {"rtol": 1e-6}


@pytest.mark.parametrize(("part", "foreseen"), [(1.0, True), (1.005, True), (1.02, False)])
def test_a_prediction_serves_with_its_margin_and_the_last_digits(part: float, foreseen: bool) -> None:
    # the finest tolerance of scipy, whose law holds within 40 in four of five scenes
    [finest] = _options(FIVE, 1e-15, "scipy").predicted
    assert (finest.setting, finest.law) == (3e-14, OF_RTOL["scipy"])
    options = _options(FIVE, 40.0 * finest.error / part, "scipy")
    if foreseen:
        assert options.foreseen().setting == pytest.approx(3e-14, rel=0.02)
    else:
        with pytest.raises(UsageError, match="is not expected to be reached by scipy"):
            options.foreseen()


def test_a_known_error_serves_up_to_the_accuracy_itself() -> None:
    [known] = _options(FIVE, 1e-6, "reference").predicted
    assert _options(FIVE, known.error, "reference").foreseen().candidate.name == "reference"
    with pytest.raises(UsageError, match="is not expected to be reached by reference"):
        _options(FIVE, 0.99 * known.error, "reference").foreseen()


def test_settings_are_kept_within_their_range() -> None:
    options = _options(FIVE, 1e-4)
    interval = FIVE.duration / FIVE.samples
    assert FIVE.duration / options.least(VERLET) == pytest.approx(50_000_000, rel=1e-12)
    assert options.most(VERLET) == pytest.approx(interval)
    scipy = Candidate(name="scipy", runs="scipy", knob="rtol", order=0.83)
    assert (options.least(scipy), options.most(scipy)) == (3e-14, 1e-4)
    [coarse] = _options(FIVE, 0.9, "verlet").predicted
    assert coarse.setting == pytest.approx(interval)
    [fine] = _options(FIVE, 1e-14, "scipy").predicted
    assert fine.setting == 3e-14
    [within] = _options(FIVE, 1e-4, "verlet").predicted
    assert within.error == pytest.approx(1e-4, rel=1e-6)


def test_a_careful_prediction_has_the_margin_that_it_states() -> None:
    foreseen = _options(FIVE, 1e-4, "verlet").foreseen()
    # half of the scenes err by less than the law, four of five by less than 10 times that
    assert foreseen.error == pytest.approx(1e-5, rel=1e-3)
    assert _options(FIVE, 1e-9).foreseen().candidate.name == "reference"


def test_an_accuracy_that_nothing_reaches_names_the_smallest_predicted_error() -> None:
    options = _options(FIVE, 1e-17)
    least = min(option.error for option in options.predicted)
    assert least < 0.5 * max(option.error for option in options.predicted)
    with pytest.raises(UsageError, match=rf"by any backend: the smallest predicted error is {least:.2g}; ask for less"):
        options.foreseen()


def test_absolute_tolerances_go_with_the_relative_one() -> None:
    candidate = Candidate(name="ode45", runs="ode45", knob="rtol", order=0.86, atol=2e-9)
    assert candidate.settings_at(1e-3) == {"rtol": 1e-3, "atol": 2e-12}
    assert VERLET.settings_at(1e-7) == {"dt": 1e-7}
    assert Candidate(name="bca", runs="bca", knob="", order=0.0).settings_at(1.0) == {}


# errors by finer runs, of a made-up code whose velocities are off by a known part


class MadeUp:
    """A code whose velocities are too large by ``factor setting^order``; it notes its settings."""

    def __init__(self, order: float, factor: float) -> None:
        self.order, self.factor = order, factor
        self.exact = db.solve(PAIR, backend="reference", samples=10)
        self.settings: list[dict[str, Any]] = []

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        given = {key: getattr(resolution, key) for key in ("dt", "rtol", "surrogate_radius")}
        self.settings.append({key: value for key, value in given.items() if value is not None})
        setting = resolution.dt or resolution.rtol or 0.0
        off = self.factor * (resolution.surrogate_radius or 1.0) * setting**self.order
        return replace(self.exact, velocity=(1.0 + off) * self.exact.velocity)


@pytest.fixture
def made_up(monkeypatch: pytest.MonkeyPatch) -> MadeUp:
    code = MadeUp(2.0, 1e10)
    monkeypatch.setattr(check, "backend", lambda _: code)
    return code


def _judge(reference: Trajectory | None = None) -> Judge:
    return Judge(scene=PAIR, sampling=SAMPLES, observable="velocity", reference=reference, progress=lambda _: None)


def test_an_error_against_a_reference_is_the_distance_from_it(made_up: MadeUp) -> None:
    judge = _judge(made_up.exact)
    trial = judge.trial(VERLET, 1e-6)
    assert (trial.setting, trial.error) == (pytest.approx(1e-6), pytest.approx(1e-2, rel=1e-9))
    # only runs by which others are measured are kept
    judge.trial(VERLET, 1e-6)
    assert len(made_up.settings) == 2


@pytest.mark.parametrize(
    ("candidate", "finer"),
    [
        (VERLET, 5e-7),
        (replace(VERLET, order=1.0), 1e-5 / math.ceil(2.618 * 10.0)),
        (Candidate(name="scipy", runs="scipy", knob="rtol", order=2.0), 1e-6 / 30.0),
    ],
    ids=["dt", "damped", "rtol"],
)
def test_an_error_without_a_reference_follows_from_a_finer_run(
    candidate: Candidate, finer: float, made_up: MadeUp
) -> None:
    trial = _judge().trial(candidate, 1e-6)
    used = [settings[candidate.knob] for settings in made_up.settings]
    assert used == pytest.approx([1e-6, finer])
    apart = (1.0 + 1e10 * 1e-12) / (1.0 + 1e10 * finer**2) - 1.0
    # an order a fifth lower than that of the code, so that the error is not estimated too low
    assert trial.error == pytest.approx(apart / (1.0 - (finer / 1e-6) ** (0.8 * candidate.order)), rel=1e-9)
    assert trial.error >= 1e-2 * (1.0 - 1e-9) or candidate.order == 1.0


def test_runs_by_which_others_are_measured_are_made_once(made_up: MadeUp) -> None:
    judge = _judge()
    first = judge.trial(VERLET, 1e-6).error
    judge.trial(VERLET, 5e-7)  # there, and finer by a half: one more
    assert [round(1e9 * settings["dt"]) for settings in made_up.settings] == [1000, 500, 250]
    # a spare run is finer than this trial needs, and serves the next
    judge.trial(VERLET, 1e-7, spare=4.0)
    judge.trial(VERLET, 5e-8)
    finest = [settings["dt"] for settings in made_up.settings[3:]]
    assert finest == pytest.approx([1e-7, 1.25e-8, 5e-8], rel=1e-9)
    # of several that are finer by a half and more the coarsest serves
    assert judge.trial(VERLET, 1e-6).error == first


def test_runs_of_two_candidates_or_settings_are_told_apart(made_up: MadeUp) -> None:
    judge = _judge()
    twins = [
        Candidate(name=f"{radius} m", runs="verlet", knob="dt", order=2.0, settings={"surrogate_radius": radius})
        for radius in (0.5, 2.0)
    ]
    errors = [judge.trial(twin, 1e-6).error for twin in (*twins, *twins)]
    assert errors[1] / errors[0] == pytest.approx(4.0, rel=0.05)
    assert errors[2:] == errors[:2]
    assert len(made_up.settings) == 4


def test_steps_fall_on_the_samples_and_tolerances_have_a_least(made_up: MadeUp) -> None:
    judge = _judge()
    # samples are 1e-5 s apart
    steps = {3.4e-6: 1e-5 / 3, 3.3e-6: 1e-5 / 4, 1e-5 / 3: 1e-5 / 3, 1.0: 1e-5}
    for asked, taken in steps.items():
        assert judge.snapped(VERLET, asked) == pytest.approx(taken, rel=1e-12)
    scipy = Candidate(name="scipy", runs="scipy", knob="rtol", order=1.0)
    assert [judge.snapped(scipy, rtol) for rtol in (1e-20, 1e-5)] == [3e-14, 1e-5]
    assert judge.snapped(Candidate(name="bca", runs="bca", knob="", order=0.0), 1.0) == 0.0


def test_a_run_that_breaks_has_no_error_and_costs_nothing(made_up: MadeUp) -> None:
    def breaks(*_: Any) -> Trajectory:
        raise RunBroken("a velocity is not finite")

    trial = _judge().trial(VERLET, 1e-6, breaks)
    assert (trial.error, trial.cost.cpu) == (math.inf, 0.0)


def test_the_cost_of_a_short_run_is_the_least_of_three(made_up: MadeUp) -> None:
    costs = iter([0.07, 0.03, 0.01])
    judge = _judge()
    cost = SimpleNamespace(run=lambda *_: SimpleNamespace(cost=SimpleNamespace(cpu=next(costs))))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(check, "backend", lambda _: cost)
        assert judge.cpu(VERLET, 1e-6, 0.09) == 0.03
    # one of half a second is not made again
    assert judge.cpu(VERLET, 1e-6, 0.5) == 0.5
    assert made_up.settings == []


# searches


def _trials(*pairs: tuple[float, float]) -> tuple[Trial, ...]:
    return tuple(Trial(setting=setting, error=error) for setting, error in pairs)


def test_the_observed_order_is_the_slope_of_the_errors() -> None:
    assert observed_order(_trials((1.0, 1e-2), (0.1, 1e-5))) == pytest.approx(3.0)
    assert observed_order(_trials((10.0, math.inf), (1.0, 1e-2), (0.1, 1e-5))) == pytest.approx(3.0)
    # failures and exact runs show none
    assert math.isnan(observed_order(_trials((1.0, math.inf), (0.5, 1e-3), (0.1, 0.0))))
    assert math.isnan(observed_order(_trials((1.0, 1e-3), (1.0, 2e-3))))


def test_a_search_stays_in_its_range_and_stops_at_its_coarsest_setting() -> None:
    asked: list[float] = []

    def trial(setting: float) -> Trial:
        asked.append(setting)
        return Trial(setting=setting, error=setting**2)

    settled = settle(trial, 1e-3, 1.0, order=2.0, least=1e-6, most=0.5)
    assert settled.best is not None
    assert settled.best.setting == pytest.approx(0.5, rel=0.12)
    assert max(asked) <= 0.5
    # a first setting outside of the range is that of its nearest end
    asked.clear()
    settle(trial, 1e-9, 1e-20, order=2.0, least=1e-3, most=1.0)
    assert asked[0] == 1e-3


def test_a_floor_ends_a_search_only_when_finer_settings_do_not_help() -> None:
    def floored(setting: float) -> Trial:
        return Trial(setting=setting, error=max(1e-3, setting**2))

    asked = settle(floored, 1.0, 1e-4, order=2.0, least=1e-9, most=1.0).trials
    assert 4 <= len(asked) < 10
    assert asked[-1].setting < 0.3 * asked[-4].setting


def test_a_confirmation_tries_settings_near_each_other_where_errors_are_near_the_target() -> None:
    def near(setting: float) -> Trial:
        return Trial(setting=setting, error=0.9)

    first = Settled(best=near(1.0), trials=(near(2.0), near(1.0)))
    settled = confirm(near, first, 1.0, order=2.0, least=0.0)
    settings = [trial.setting for trial in settled.trials]
    assert settled.best is not None
    assert settled.best.setting == 1.0
    # 40 from the setting to a quarter of it, and the coarser trial is kept
    assert settings[0] == 2.0
    assert settings[1] == 1.0
    assert len(settings) == 41
    assert settings[-1] == pytest.approx(0.25)
    np.testing.assert_allclose(np.diff(np.log(settings[1:])), math.log(0.25) / 39.0, rtol=1e-6)


def test_a_confirmation_tries_fewer_settings_where_errors_are_far_below_the_target() -> None:
    first = Settled(best=Trial(setting=1.0, error=1e-6), trials=())
    few = confirm(lambda s: Trial(setting=s, error=1e-6 * s**2), first, 1.0, order=2.0, least=0.0)
    every = confirm(lambda s: Trial(setting=s, error=1e-6 * s**2), first, 1.0, order=2.0, least=0.0, every=True)
    # steps of eight neighbours, and all
    assert (len(few.trials), len(every.trials)) == (6, 40)
    short = confirm(lambda s: Trial(setting=s, error=0.9), first, 1.0, order=2.0, least=0.5)
    assert min(trial.setting for trial in short.trials) == pytest.approx(0.5)


def test_the_reasons_list_the_best_and_the_next_coarser_errors_and_the_largest_of_the_finer() -> None:
    best, *others = _trials((1e-7, 1e-4), (8e-7, 6e-3), (4e-7, 2e-3), (2e-7, 5e-4), (5e-8, 3e-5), (2e-8, 7e-5))
    settled = Settled(best=best, trials=(*others, best))
    listed = "0.002 at 4e-07, 0.0005 at 2e-07, 0.0001 at 1e-07"
    assert errors_by_setting(settled) == f"{listed} and at most 7e-05 at 2 finer settings"
    alone = Settled(best=best, trials=(best,))
    assert errors_by_setting(alone) == "0.0001 at 1e-07"
    order = observed_order(settled.trials)
    assert evidence_of(VERLET, settled).endswith(f"finer settings (s); the fitted order is {order:.2f}")
    assert evidence_of(VERLET, alone) == "runs of verlet err by 0.0001 at 1e-07 (s)"
    scipy = Candidate(name="scipy", runs="scipy", knob="rtol", order=1.0)
    assert evidence_of(scipy, alone) == "runs of scipy err by 0.0001 at 1e-07 (rtol)"


def test_a_budget_buys_the_accuracy_whose_plan_costs_as_much() -> None:
    whole = db.plan(FIVE, 1e-7, "verlet", predict_only=True)
    with pytest.raises(UsageError) as caught:
        db.plan(FIVE, 1e-7, "verlet", predict_only=True, budget=0.5 * whole.predicted_cost)
    words = str(caught.value)
    bought = float(words.split("an accuracy of about ")[1].split()[0])
    part = db.plan(FIVE, 1e-7, "verlet", predict_only=True).predicted_error
    # errors go with the square of the step, and the cost with one over it beside a cost of every run
    outlook = Outlook(scene=FIVE, prescan=prescan_scene(FIVE), sampling=Sampling(count=FIVE.samples))
    step = math.sqrt(bought / part) * whole.units["dt"]
    assert outlook.cost("verlet", step) == pytest.approx(0.5 * whole.predicted_cost, rel=0.1)


def test_a_budget_that_buys_less_than_one_digit_buys_nothing() -> None:
    # errors of one and more are no accuracy
    with pytest.raises(
        UsageError, match=r"the budget is 0\.0004 s; it buys no meaningful run; ask for less, or give more"
    ):
        db.plan(FIVE, 1e-7, "verlet", predict_only=True, budget=4e-4)


def test_codes_that_were_not_run_are_left_out_by_their_predicted_cost() -> None:
    plan = db.plan(PAIR, 1e-2)
    outlook = Outlook(scene=PAIR, prescan=prescan_scene(PAIR), sampling=SAMPLES)
    [law] = [option.law for option in Options(PAIR, 1e-2, "scipy", "velocity", SAMPLES, {}).predicted]
    assert law is not None
    cost = outlook.cost("scipy", min(outlook.setting(law, 1e-2, "velocity"), 1e-4))
    assert f"scipy: predicted to cost {cost:.2g} s of CPU" in plan.reasons
