"""Decisions of the planner among runs whose errors, costs and round-off are made up, so that each of them is known."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

import dem_bridge as db
from dem_bridge.backends.base import BACKENDS, Resolution, Sampling
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.runs.planning import planner
from dem_bridge.runs.planning import trials as check
from dem_bridge.runs.planning.answer import Plan
from dem_bridge.runs.planning.predict import OF_RTOL, OF_STEP, Outlook
from dem_bridge.scene.scene import Damping, Scene
from dem_bridge.trajectory.trajectory import Cost, Trajectory
from tests.runs.planning.test_planner import PAIR

SAMPLES = Sampling(count=10)
#: s between samples
INTERVAL = 1e-5
#: an exponent for which the reference has no series
SOFT = replace(PAIR, name="soft", exponent=2.3, stiffness=(5e8,))
#: codes with a setting, of which the cheapest is chosen
CODES = ("verlet", "blanes-moan", "scipy")


class World:
    """Made-up codes: errors by (code, setting), predicted and measured costs (s), round-off and uncertainties."""

    def __init__(self) -> None:
        self.exact = db.solve(PAIR, backend="reference", samples=10)
        self.errors: Callable[[str, float], float] = lambda name, setting: 0.0
        self.tables: Callable[[int | None], float] = lambda points: 0.0
        self.predicted: Callable[[str, float], float] = lambda name, setting: 1.0
        self.measured: Callable[[str], float] = lambda name: 1.0
        self.roundoff: Callable[[float, float], float] = lambda step, radius: 0.0
        self.uncertainty: Callable[[str], float] = lambda name: 0.0
        self.extrapolated: Callable[[float], float] = lambda step: math.inf
        self.runs: list[tuple[str, float]] = []
        self.references: list[tuple[str, float | None]] = []
        self.extrapolations: list[float] = []
        self.clock = 0.0

    def code(self, name: str) -> Any:
        def run(scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
            setting = resolution.dt or resolution.rtol or 0.0
            self.runs.append((name, setting))
            self.clock += 1.0
            off = self.errors(name, setting) + (self.tables(resolution.table_points) if resolution.tables else 0.0)
            cost = Cost(wall=0.0, cpu=self.measured(name), steps=17, force_evaluations=19)
            return replace(self.exact, velocity=(1.0 + off) * self.exact.velocity, cost=cost)

        return SimpleNamespace(run=run)

    def solve(self, case: Any) -> Trajectory:
        self.references.append((case.backend, case.resolution.rtol))
        if case.backend == "reference" and self.uncertainty("reference") == math.inf:
            raise RunBroken("the series do not end")
        return replace(self.exact, provenance={**self.exact.provenance, "backend": case.backend})

    def extrapolate(self, case: Any) -> Trajectory:
        assert not case.uncertainty
        self.extrapolations.append(case.resolution.dt)
        return replace(self.exact, velocity=(1.0 + self.extrapolated(case.resolution.dt)) * self.exact.velocity)

    def settings(self, name: str) -> list[float]:
        return [setting for code, setting in self.runs if code == name]


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch) -> World:
    made_up = World()
    monkeypatch.setattr(check, "backend", made_up.code)
    monkeypatch.setattr(planner, "solve", made_up.solve)
    monkeypatch.setattr(planner, "extrapolate", made_up.extrapolate)
    monkeypatch.setattr(planner, "time", SimpleNamespace(process_time=lambda: made_up.clock))

    def roundoff(scene: Scene, plan: Any, radius: float) -> float:
        return made_up.roundoff(plan.step, radius)

    def uncertainty(observable: str, scene: Scene, run: Trajectory) -> float:
        return made_up.uncertainty(str(run.provenance["backend"]))

    def cost(self: Outlook, name: str, setting: float = math.nan) -> float:
        return made_up.predicted(name, setting)

    monkeypatch.setattr(planner, "roundoff_floor", roundoff)
    monkeypatch.setattr(planner, "measured_uncertainty", uncertainty)
    monkeypatch.setattr(Outlook, "cost", cost)
    return made_up


def _plan(accuracy: float, *names: str, scene: Scene = PAIR, **settings: Any) -> Plan:
    """Plan with the backends of these names; a single one is asked for by name."""
    name = names[0] if len(names) == 1 else None
    left_out = {} if name else dict.fromkeys(BACKENDS.keys() - set(names), "left out")
    return planner.plan_for(scene, accuracy, name=name, left_out=left_out, sampling=SAMPLES, **settings)


def _reasons(plan: Plan) -> str:
    return "; ".join(plan.reasons)


# what errors are measured against


@pytest.mark.parametrize(
    ("reference", "codes", "used"),
    [
        (1.0 / 7.0, (0.001, 5.0), True),  # seven runs take 1 s
        (0.15, (0.001, 5.0), False),  # and here more
        (0.2, (0.5, 5.0), True),  # 1.4 s are less than three of the cheapest run
        (0.22, (0.5, 5.0), False),
    ],
)
def test_a_reference_is_solved_where_it_is_cheap(
    reference: float, codes: tuple[float, float], used: bool, world: World
) -> None:
    costs = dict(zip(CODES, codes, strict=False)) | {"reference": reference}
    world.predicted = lambda name, setting: costs.get(name, 9.0)
    # errors by finer runs are 1/(1 - 2^-1.6) times the distance from them, of exact runs 0
    plan = _plan(1e-3, "verlet", "blanes-moan")
    assert world.references == ([("reference", None)] if used else [])
    why = f"finer runs of the same backend, because reference would take {7.0 * reference:.2g} s"
    assert f"errors are measured against {'reference, with' if used else why}" in _reasons(plan)


@pytest.mark.parametrize(("uncertainty", "used"), [(1e-4, True), (1.01e-4, False), (math.inf, False)])
def test_a_reference_is_certain_to_a_tenth_of_the_accuracy(uncertainty: float, used: bool, world: World) -> None:
    world.predicted = lambda name, setting: 0.01
    world.uncertainty = lambda name: uncertainty
    reasons = _reasons(_plan(1e-3, "verlet"))
    assert ("errors are measured against reference, with an uncertainty of 0.0001" in reasons) == used
    assert ("because reference has an uncertainty of 0.0001" in reasons) == (uncertainty == 1.01e-4)
    assert ("because the series do not end" in reasons) == (uncertainty == math.inf)


@pytest.mark.parametrize(("accuracy", "nearest"), [(1e-3, None), (0.9, 1e-4), (1e-12, 3e-14)])
def test_without_series_scipy_is_the_reference_at_a_tolerance_that_suffices(
    accuracy: float, nearest: float | None, world: World
) -> None:
    # scipy at the finest tolerance is too expensive; four runs of 0.2 s are not
    world.predicted = lambda name, setting: 0.3 if name == "scipy" and setting <= 3e-14 and not nearest else 0.2
    world.measured = lambda name: 0.01
    world.uncertainty = lambda name: 0.0 if len(world.references) > 1 or nearest is None else 1.0
    _plan(accuracy, "blanes-moan", scene=SOFT)
    outlook = Outlook(scene=SOFT, prescan=prescan_scene(SOFT), sampling=SAMPLES)
    law = OF_RTOL["scipy"]
    # its law errs by no more than its spread in four of five scenes: a hundredth of the accuracy with that
    enough = outlook.setting(law, 0.01 * accuracy / law.spread, "velocity")
    names, settings = zip(*world.references, strict=True)
    assert set(names) == {"scipy"}
    assert settings[-1] == pytest.approx(nearest or enough, rel=1e-12)
    assert settings[:-1] == ((3e-14,) if nearest else ())


def test_progress_is_the_part_of_the_expected_time(world: World) -> None:
    costs = {"reference": 0.1, "verlet": 2.0, "blanes-moan": 8.0, "scipy": 8.1}
    world.predicted = lambda name, setting: costs.get(name, 9.0)
    calls: list[tuple[float, int, str]] = []
    # the search of the cheapest code has several runs of 1 s on the made-up clock
    world.errors = lambda name, setting: (setting / INTERVAL) ** 2
    world.measured = lambda name: 2.0
    world.clock = 100.0
    _plan(1e-3, *CODES, progress=lambda *words: calls.append(words))
    # seven runs of the reference, and five runs of each option up to four times the cheapest
    expected = 7.0 * 0.1 + 5.0 * (2.0 + 8.0)
    assert calls[0] == (0.0, 1, "reference by reference")
    for nth, (part, total, label) in enumerate(calls[1:]):
        assert (part, total) == (pytest.approx(min(0.95, nth / expected), rel=1e-12), 1)
        assert label.startswith(("verlet at dt = ", "blanes-moan at dt = "))
    assert calls[-1][0] > 0.2


def test_progress_expects_the_cheaper_of_two_references(world: World) -> None:
    # scipy at the finest tolerance, or at one that suffices
    world.predicted = lambda name, setting: 0.1 if name != "scipy" else 0.3 if setting <= 3e-14 else 0.2
    world.errors = lambda name, setting: (setting / INTERVAL) ** 2
    calls: list[tuple[float, int, str]] = []
    _plan(0.5, "verlet", scene=SOFT, progress=lambda *words: calls.append(words))
    # after a reference on the made-up clock, which does not count it, and a run of 1 s
    assert [part for part, _, label in calls if label.startswith("verlet")][:2] == pytest.approx(
        [0.0, min(0.95, 1.0 / (4.0 * 0.2 + 5.0 * 0.1))], rel=1e-12
    )


@pytest.mark.parametrize(
    ("name", "scene", "margin"),
    [
        ("verlet", PAIR, 0.8),
        ("verlet", replace(PAIR, damping=Damping(law="dashpot", coefficient=1.0)), 0.8),
        ("blanes-moan", PAIR, 0.6),
        ("scipy", PAIR, 0.25),
    ],
    ids=["order 2", "damped", "order 4", "rtol"],
)
def test_errors_of_accepted_settings_are_below_the_accuracy_by_the_margin_of_their_order(
    name: str, scene: Scene, margin: float, world: World
) -> None:
    world.predicted = lambda name, setting: 0.01
    for part, taken in ((0.99, True), (1.01, False)):
        world.errors = lambda name, setting, error=part * margin * 1e-3: error  # type: ignore[misc]
        if taken:
            assert _plan(1e-3, name, scene=scene).found_error == pytest.approx(0.99e-3 * margin, rel=1e-9)
        else:
            with pytest.raises(UsageError, match=f"{name}: the smallest measured error is"):
                _plan(1e-3, name, scene=scene)


def test_every_tolerance_is_confirmed_and_steps_only_where_errors_are_near_the_accuracy(world: World) -> None:
    world.predicted = lambda name, setting: 0.01
    # exact runs: 40 tolerances down to a quarter of the coarsest one, and steps eight neighbours apart
    _plan(1e-3, "scipy")
    tolerances = world.settings("scipy")
    assert sum(rtol <= 1e-4 for rtol in tolerances) >= 40
    _plan(1e-3, "verlet")
    assert len(world.settings("verlet")) < 15


def test_a_finer_run_that_confirms_serves_all_settings_down_to_a_quarter(world: World) -> None:
    world.predicted = lambda name, setting: 1.0
    world.errors = lambda name, setting: 0.79e-3 * (setting / 1e-7) ** 2
    step = _plan(1e-3, "verlet").units["dt"]
    assert world.references == []
    # finer by two than a quarter of the step
    assert min(world.settings("verlet")) == pytest.approx(step / 8.0, rel=0.1)


# the step that is answered


@pytest.mark.parametrize(("error", "step", "tidied"), [(0.0, 1.5e-5, 2e-5), (1e-3, 0.75e-5, 1e-5)])
def test_an_answered_step_is_the_shortest_number_that_makes_as_many_steps(
    error: float, step: float, tidied: float, world: World
) -> None:
    # samples are 1.5e-5 s apart: one step for each from there up to no end, two from half of it
    world.errors = lambda name, setting: error if setting > 1e-5 else 0.0
    plan = _plan(1e-3, "verlet", scene=replace(PAIR, duration=1.5e-4))
    assert plan.units["dt"] == pytest.approx(step)
    assert plan.resolution == {"dt": tidied}


def test_only_codes_that_were_not_run_are_said_to_be_known_by_their_twin(world: World) -> None:
    world.predicted = lambda name, setting: 0.01
    assert "verlet was not run" not in _reasons(_plan(1e-3, "verlet"))
    plan = _plan(1e-3, "lammps-granular")
    assert "lammps-granular was not run: the positional twin gives the same numbers to 1e-10" in _reasons(plan)


# what a budget buys


def _bought(accuracy: float, budget: float, name: str | None = None, **settings: Any) -> str:
    settings = {"sampling": SAMPLES} | settings
    with pytest.raises(UsageError) as caught:
        planner.plan_for(PAIR, accuracy, name=name, budget=budget, predict_only=True, **settings)
    return str(caught.value)


def test_a_budget_buys_the_finest_step_that_costs_as_much(world: World) -> None:
    # half of the budget from 1e-6 s on
    world.predicted = lambda name, setting: 0.5 if setting >= 1e-6 else 1.0
    outlook = Outlook(scene=PAIR, prescan=prescan_scene(PAIR), sampling=SAMPLES)
    law = OF_STEP[2]
    first = outlook.setting(law, 1e-6 / law.spread, "velocity")
    error = outlook.error(law, first, "velocity") * (1e-6 / first) ** 2
    assert 1e-6 < error < 1.0
    assert f"the budget is 0.5 s; it buys an accuracy of about {error:.1g} by verlet" in _bought(1e-6, 0.5, "verlet")
    assert "it buys no meaningful run" in _bought(1e-6, 0.49, "verlet")


def test_a_budget_may_buy_another_code(world: World) -> None:
    # the theory errs by 0.07 in the time at which the last body is reached, and its cost is the whole budget
    world.predicted = lambda name, setting: 0.5 if name == "bca" else 1.0
    left_out = dict.fromkeys(BACKENDS.keys() - {"bca", "verlet"}, "left out")
    words = _bought(1e-3, 0.5, observable="arrival_at_end", left_out=left_out)
    assert "costs 1 s of CPU by verlet, and the budget is 0.5 s; it buys an accuracy of about 0.07 by bca" in words


def test_an_error_of_one_and_more_is_no_accuracy(world: World) -> None:
    # one sample: steps are 1e-4 s at most
    once = Sampling(count=1)
    outlook = Outlook(scene=PAIR, prescan=prescan_scene(PAIR), sampling=once)
    law = OF_STEP[2]
    for error, words in ((0.9, "an accuracy of about 0.9 by verlet"), (1.5, "no meaningful run")):
        step = outlook.setting(law, error, "velocity")
        assert step < 1e-4
        world.predicted = lambda name, setting, step=step: 0.5 if setting >= step else 1.0  # type: ignore[misc]
        assert f"it buys {words};" in _bought(1e-3, 0.5, "verlet", sampling=once)


# which option is tried, and which is taken


@pytest.mark.parametrize(("predicted", "how"), [(5.0, "measured"), (7.0, "predicted to")])
def test_an_option_is_tried_unless_it_is_predicted_to_cost_four_times_as_much(
    predicted: float, how: str, world: World
) -> None:
    costs = {"verlet": 1.0, "blanes-moan": 3.0, "scipy": predicted, "reference": 0.01}
    world.predicted = lambda name, setting: costs.get(name, 9.0)
    # the cheapest by prediction is not the cheapest when it is run
    world.measured = lambda name: {"verlet": 2.0, "blanes-moan": 1.5, "scipy": 9.0}[name]
    plan = _plan(1e-3, *CODES)
    assert (plan.backend, plan.found_cost) == ("blanes-moan", 1.5)
    reasons = _reasons(plan)
    assert "verlet: measured cost 2 s of CPU" in reasons
    assert f"scipy: {how} cost {9.0 if how == 'measured' else predicted:.2g} s of CPU" in reasons
    assert ("scipy" in dict(world.runs)) == (how == "measured")
    assert list(dict(world.runs))[:2] == ["verlet", "blanes-moan"]
    assert (plan.steps, plan.force_evaluations, plan.found_error) == (17, 19, pytest.approx(0.0, abs=1e-12))


def test_floors_of_all_options_are_in_the_message(world: World) -> None:
    world.predicted = lambda name, setting: 0.01
    world.errors = lambda name, setting: {"verlet": 0.012, "blanes-moan": 0.034, "scipy": 0.056}[name]
    with pytest.raises(UsageError) as caught:
        _plan(1e-3, *CODES)
    words = str(caught.value)
    assert words.startswith("accuracy = 0.001 of velocity on pair cannot be reached: ")
    for name, error in (("verlet", 0.012), ("blanes-moan", 0.034), ("scipy", 0.056)):
        assert f"{name}: the smallest measured error is {error:g}, and finer settings do not reduce it" in words
    # one that serves is taken, and the floors of the others are said
    world.errors = lambda name, setting: {"verlet": 0.012, "blanes-moan": 0.0, "scipy": 0.056}[name]
    plan = _plan(1e-3, *CODES)
    assert plan.backend == "blanes-moan"
    assert "verlet: the smallest measured error is 0.012, and finer settings do not reduce it" in plan.reasons


@pytest.mark.parametrize("budget", [0.0, math.inf, math.nan, -1.0])
def test_a_budget_is_a_number_above_zero(budget: float) -> None:
    with pytest.raises(UsageError, match=rf"^budget = {budget}; allowed: a number > 0 \(s of CPU\)$"):
        _plan(1e-3, "verlet", budget=budget)


def test_a_plan_may_cost_its_whole_budget(world: World) -> None:
    assert _plan(1e-3, "verlet", budget=1.0).found_cost == 1.0
    with pytest.raises(UsageError, match=r"costs 1 s of CPU by verlet, and the budget is 0\.99 s"):
        _plan(1e-3, "verlet", budget=0.99)


@pytest.mark.parametrize(("accuracy", "serves"), [(0.01, True), (0.0099, False)])
def test_a_theory_serves_up_to_its_error(accuracy: float, serves: bool, world: World) -> None:
    world.predicted = lambda name, setting: 0.01
    world.measured = lambda name: 0.2
    world.errors = lambda name, setting: 0.01 * (1.0 - 1e-12)
    plan = planner.plan_for
    if not serves:
        with pytest.raises(UsageError, match=r"bca: its error is 0\.01; ask for less"):
            plan(PAIR, accuracy, name="bca", sampling=SAMPLES)
        return
    found = plan(PAIR, accuracy, name="bca", sampling=SAMPLES)
    assert (found.found_error, found.found_cost) == (pytest.approx(0.01), 0.2)
    assert "its error is measured against reference, with an uncertainty of 0" in found.reasons


def test_the_reference_is_not_solved_twice(world: World) -> None:
    world.predicted = lambda name, setting: 0.01
    world.uncertainty = lambda name: 1e-4
    plan = _plan(1e-3, "reference")
    assert (world.references, plan.found_error) == ([("reference", None)], 1e-4)
    assert "its uncertainty is taken as its error" in plan.reasons
    # an uncertainty of the whole accuracy serves, but not as a reference of others
    world.uncertainty = lambda name: 1e-3
    assert _plan(1e-3, "reference").found_error == 1e-3
    assert len(world.references) == 3
    world.uncertainty = lambda name: 1.1e-3
    with pytest.raises(UsageError, match=r"reference: its uncertainty is 0\.0011; ask for less"):
        _plan(1e-3, "reference")


# LAMMPS: round-off, tables and extrapolation


def test_steps_of_lammps_are_confirmed_where_round_off_leaves_room(world: World) -> None:
    world.predicted = lambda name, setting: 0.01
    world.errors = lambda name, setting: 7.6e-9 * (setting / 3e-8) ** 2
    finest = {}
    # 0.3 of the accuracy at a quarter of the step, at half of it, or at neither
    for part, roundoff in ((0.25, 0.3 * 1e-8), (0.5, 3.1e-9), (1.0, 1.0)):
        world.runs.clear()

        def floor(step: float, radius: float, of_finest: float = roundoff) -> float:
            # of LAMMPS' finest runs alone
            return 0.0 if step > 2.2e-8 else min(of_finest, 9e-9) if step < 1.1e-8 or of_finest == 1.0 else 2.9e-9

        world.roundoff = floor
        plan = _plan(1e-8, "lammps-granular")
        finest[part] = world.settings("verlet")[-1] / plan.units["dt"]
    for part, found in finest.items():
        assert found == pytest.approx(part, rel=0.02)
    # other codes, and lower accuracies, are confirmed down to a quarter without a look at round-off
    world.roundoff = lambda step, radius: 2.0 * 1e-6 if step < 1e-7 else 0.0
    world.errors = lambda name, setting: 7.6e-6 * (setting / 1e-6) ** 2
    for name in ("verlet", "lammps-granular"):
        world.runs.clear()
        plan = _plan(1e-5, name)
        assert world.settings("verlet")[-1] / plan.units["dt"] == pytest.approx(0.25, rel=0.02)


@pytest.mark.parametrize(("floor", "allowed"), [(1e-8, True), (1.01e-8, False)])
def test_round_off_above_the_accuracy_rules_lammps_out_before_any_run(
    floor: float, allowed: bool, world: World
) -> None:
    steps: list[float] = []

    def roundoff(step: float, radius: float) -> float:
        steps.append(step)
        return floor if len(steps) == 1 else 0.0

    world.roundoff = roundoff
    if allowed:
        _plan(1e-8, "lammps-granular")
    else:
        with pytest.raises(UsageError, match=r"round-off with a radius of \S+ m limits the accuracy to 1e-08"):
            _plan(1e-8, "lammps-granular")
        assert world.runs == []
    outlook = Outlook(scene=PAIR, prescan=prescan_scene(PAIR), sampling=SAMPLES)
    predicted = outlook.setting(OF_STEP[2], 1e-8, "velocity")
    assert steps[0] == pytest.approx(outlook.schedule(max(predicted, PAIR.duration / 5e6)).step)


def test_round_off_rules_nothing_out_for_codes_without_positions_and_at_1e_7(world: World) -> None:
    world.roundoff = lambda step, radius: 1.0
    world.predicted = lambda name, setting: 0.01
    for name, accuracy in (("verlet", 1e-8), ("lammps-granular", 1e-7)):
        world.runs.clear()
        world.errors = lambda name, setting, accuracy=accuracy: 0.79 * accuracy * (setting / 1e-7) ** 2  # type: ignore[misc]
        step = _plan(accuracy, name).units["dt"]
        assert world.settings("verlet")[-1] == pytest.approx(0.25 * step, rel=0.01)


def test_the_last_digits_of_all_steps_are_a_limit(world: World) -> None:
    outlook = Outlook(scene=PAIR, prescan=prescan_scene(PAIR), sampling=SAMPLES)
    steps = outlook.schedule(outlook.setting(OF_STEP[2], 2e-13, "velocity")).steps
    digits = 2.0**-52 * math.sqrt(steps)
    assert digits > 2e-13
    with pytest.raises(UsageError, match=f"the round-off of {steps} steps adds up to {digits:.1g}; ask for less"):
        _plan(2e-13, "verlet")


def test_a_floor_above_the_finest_setting_is_not_that_of_the_finest(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    world.predicted = lambda name, setting: 0.01
    world.errors = lambda name, setting: 0.02
    floor = r"verlet: the smallest measured error is 0\.02, and finer settings do not reduce it"
    with pytest.raises(UsageError, match=floor):
        _plan(1e-3, "verlet")
    # at most a half more steps than the last trial had
    monkeypatch.setattr(
        "dem_bridge.runs.planning.backend_options.MOST_STEPS", 1.5 * PAIR.duration / world.settings("verlet")[-1]
    )
    with pytest.raises(UsageError, match=floor):
        _plan(1e-3, "verlet")


def test_round_off_is_the_reason_where_it_takes_a_third_of_the_accuracy(world: World) -> None:
    world.predicted = lambda name, setting: 0.01
    world.errors = lambda name, setting: 0.02
    world.roundoff = lambda step, radius: 2.9e-4
    with pytest.raises(UsageError, match=r"granular: the smallest measured error is 0\.02, and finer settings do not"):
        _plan(1e-3, "lammps-granular")
    world.roundoff = lambda step, radius: 3.1e-4
    with pytest.raises(
        UsageError, match=r"round-off with a radius of \S+ m limits the accuracy to 0\.00031; the smallest m\S+ error"
    ):
        _plan(1e-3, "lammps-granular")


@pytest.mark.parametrize(
    ("errors", "points"),
    [
        ({None: 2.9e-4}, None),
        ({None: 3.1e-4, 40_000: 2.9e-4}, 40_000),
        ({None: 1e-2, 40_000: 1e-3, 160_000: 2.9e-4}, 160_000),
        ({None: 1e-2, 40_000: 1e-3, 160_000: 5e-4, 640_000: 2.9e-4}, 640_000),
    ],
)
def test_tables_have_the_fewest_points_that_err_by_less_than_a_third_of_the_accuracy(
    errors: dict[int | None, float], points: int | None, world: World
) -> None:
    world.predicted = lambda name, setting: 0.01
    world.tables = lambda given: errors[given]
    plan = _plan(1e-3, "lammps-table")
    assert plan.resolution.get("table_points") == points
    assert ("table_points" in plan.resolution) == (points is not None)
    world.tables = lambda given: 3.1e-4
    with pytest.raises(UsageError, match=r"tables of 640000 points have an interpolation error of 0\.00031"):
        _plan(1e-3, "lammps-table")


def _extrapolating(world: World, accuracy: float, single: float, order4: float) -> None:
    """Give the twin an error of order 2 that is the aim at ``single`` (s), and extrapolations one of order 4."""
    world.predicted = lambda name, setting: 1e-9 / setting if name == "lammps-granular" else 0.01
    world.errors = lambda name, setting: 0.8 * accuracy * (setting / single) ** 2
    world.extrapolated = lambda step: 0.6 * accuracy * (step / order4) ** 4


def test_extrapolations_are_taken_where_they_cost_four_fifths_of_a_run(world: World) -> None:
    # three runs at 2 dt, dt and dt/2 cost 0.5 + 1 + 1.4 2 = 4.3 runs at dt, and 4.3/0.8 = 5.375
    for ratio, taken in ((5.0, False), (6.0, True), (12.0, True)):
        world.extrapolations.clear()
        world.runs.clear()
        _extrapolating(world, 1e-6, 1e-7, ratio * 1e-7)
        plan = _plan(1e-6, "lammps-granular")
        assert (plan.resolution.get("order") == "richardson") == taken
        if taken:
            step = plan.units["dt"]
            assert 1.0 <= ratio * 1e-7 / step <= 1.13
            assert plan.predicted_cost == pytest.approx(1e-9 * (0.5 + 1.0 + 2.8) / step, rel=1e-9)
            assert f"three runs cost {plan.predicted_cost:.2g} s of CPU, a single run" in _reasons(plan)
            assert plan.found_error == pytest.approx(0.6e-6 * (step / (ratio * 1e-7)) ** 4, rel=1e-6)
            # finer ones serve down to a quarter, and the first step follows from the orders
            assert min(world.extrapolations) == pytest.approx(0.25 * step, rel=0.01)
            single = world_single(plan)
            first = 2.0 * single * 100.0**0.25
            assert world.extrapolations[0] == pytest.approx(first, rel=0.05)
            # the second step follows from the first by order 4, and aims at 0.92 of the margin
            tried = world.extrapolations
            enough = (0.92 * 0.6e-6 / world.extrapolated(tried[0])) ** 0.25
            assert tried[1] == pytest.approx(tried[0] * enough, rel=0.1)
            # the single run is confirmed before
            assert min(world.settings("verlet")) == pytest.approx(0.25 * single, rel=0.05)


def world_single(plan: Plan) -> float:
    """Return the step of the single run, s, from its cost in the reasons (1 ns/step, to two digits)."""
    return 1e-9 / float(_reasons(plan).split("a single run ")[1].split()[0])


@pytest.mark.parametrize(("accuracy", "tried"), [(1e-5, True), (1.01e-5, False)])
def test_extrapolations_are_for_accuracies_from_1e_5_on(accuracy: float, tried: bool, world: World) -> None:
    _extrapolating(world, accuracy, 1e-7, 1e-6)
    assert bool(_plan(accuracy, "lammps-granular").resolution.get("order")) == tried
    assert bool(world.extrapolations) == tried


def test_extrapolations_are_left_out_where_they_cannot_serve(world: World) -> None:
    # the coarsest of three runs is longer than half a sample
    _extrapolating(world, 1e-6, 4e-6, 1e-5)
    assert _plan(1e-6, "lammps-granular").resolution.keys() == {"dt"}
    assert world.extrapolations == []
    # round-off, which the weights 4/3 and -1/3 magnify to 5/3, is above the accuracy
    for roundoff, tried in ((0.59e-6, True), (0.61e-6, False)):
        world.extrapolations.clear()
        _extrapolating(world, 1e-6, 1e-7, 1e-6)
        world.roundoff = lambda step, radius, value=roundoff: value  # type: ignore[misc]
        _plan(1e-6, "lammps-granular")
        assert bool(world.extrapolations) == tried
    # the round-off is that of the finest of the three runs, at half of the first step
    for part, tried in ((0.4, True), (0.6, False)):
        world.extrapolations.clear()
        first = 2.0 * 1e-7 * 100.0**0.25
        world.roundoff = lambda step, radius, end=part * first: 1.0 if step < end else 0.0  # type: ignore[misc]
        _plan(1e-6, "lammps-granular")
        assert bool(world.extrapolations) == tried
    # no step of the extrapolation serves
    world.roundoff = lambda step, radius: 0.0
    world.extrapolated = lambda step: 1e-3
    assert _plan(1e-6, "lammps-granular").resolution.keys() == {"dt"}
    # and without a reference there is none
    world.extrapolations.clear()
    world.uncertainty = lambda name: 1.0
    _extrapolating(world, 1e-6, 1e-7, 1e-6)
    _plan(1e-6, "lammps-granular")
    assert world.extrapolations == []


def test_extrapolations_begin_at_1_75_times_the_single_step(world: World) -> None:
    # three runs at half of a sample, 5e-6 s, are cheap, and the single one at 2e-6 s is not
    world.errors = lambda name, setting: 0.79e-6 * (setting / 2e-6) ** 2
    world.extrapolated = lambda step: 1e-8
    world.predicted = lambda name, setting: 1.0 if setting < 2.1e-6 else 0.01
    assert _plan(1e-6, "lammps-granular").resolution["order"] == "richardson"
    # from 3e-6 s, three runs would have to be at 5.25e-6 s
    world.extrapolations.clear()
    world.errors = lambda name, setting: 0.79e-6 * (setting / 3.4e-6) ** 2
    world.predicted = lambda name, setting: 1.0 if setting < 2.4e-6 else 0.9 if setting < 3.4e-6 else 0.01
    assert _plan(1e-6, "lammps-granular").resolution.keys() == {"dt"}
    assert world.extrapolations == []


@pytest.mark.parametrize(("roundoff", "finest"), [(0.0, 0.25), (0.17, 0.25), (0.19, 0.5)])
def test_extrapolations_are_confirmed_where_their_round_off_leaves_room(
    roundoff: float, finest: float, world: World
) -> None:
    _extrapolating(world, 1e-8, 1e-8, 1e-7)
    step = _plan(1e-8, "lammps-granular").units["dt"]
    # 5/3 of it is 0.3 of the accuracy at 0.18, at a quarter of the finest of three runs
    world.roundoff = lambda each, radius: roundoff * 1e-8 if each < 0.15 * step else 0.0
    world.extrapolations.clear()
    assert _plan(1e-8, "lammps-granular").units["dt"] == pytest.approx(step)
    assert min(world.extrapolations) == pytest.approx(finest * step, rel=0.01)


def test_extrapolations_serve_where_no_single_run_does(world: World) -> None:
    _extrapolating(world, 1e-6, 1e-7, 1e-6)
    world.errors = lambda name, setting: 1e-3
    plan = _plan(1e-6, "lammps-granular")
    assert plan.resolution["order"] == "richardson"
    assert "of CPU, and no single run serves" in _reasons(plan)
