"""The settings that searches try, one by one, computed by hand from the rules of the search."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from dem_bridge.runs.planning.trials import MARGIN, Candidate, Settled, Trial, accepted, confirm, settle


def _made_up(error: Callable[[float], float]) -> Callable[[float], Trial]:
    return lambda setting: Trial(setting=setting, error=error(setting))


def _tried(error: Callable[[float], float], first: float, target: float, **settings: float | str) -> list[float]:
    limits = {"order": 2.0, "least": 1e-9, "most": 1e9} | settings
    return [trial.setting for trial in settle(_made_up(error), first, target, **limits).trials]  # type: ignore[arg-type]


def test_a_search_aims_below_the_target_with_the_order_that_is_expected_and_then_with_that_which_is_seen() -> None:
    # errors of order 2, as is expected: from 100 targets to 0.92 of it at once, which is within 1.12 of the coarsest
    fine = math.sqrt(0.92 / 100.0)
    assert _tried(lambda s: 100.0 * s**2, 1.0, 1.0) == pytest.approx([1.0, fine], rel=0.01)
    # from a quarter of the target, up to 0.92 of it
    assert _tried(lambda s: 0.25 * s**2, 1.0, 1.0) == pytest.approx([1.0, 2.0 * math.sqrt(0.92)], rel=0.01)
    # of order 2.5: one step with 2, and one with what two trials show
    coarser = fine * (0.92 / (100.0 * fine**2.5)) ** (1.0 / 2.5)
    assert _tried(lambda s: 100.0 * s**2.5, 1.0, 1.0) == pytest.approx([1.0, fine, coarser], rel=0.01)
    # an order above 1.5 times that which is expected is taken for 3, and one below half of it for 1
    third = fine * (0.92 / (100.0 * fine**4)) ** (1.0 / 3.0)
    assert _tried(lambda s: 100.0 * s**4, 1.0, 1.0)[2] == pytest.approx(third, rel=0.01)
    slow = _tried(lambda s: 10.0 * s**0.5, 1.0, 1.0)
    assert slow[1] == pytest.approx(math.sqrt(0.092), rel=0.01)
    assert slow[2] / slow[1] == pytest.approx(0.92 / (10.0 * slow[1] ** 0.5), rel=0.01)


def test_tolerances_are_searched_with_an_aim_and_a_closeness_of_their_own() -> None:
    assert _tried(lambda s: 5.0 * s, 1.0, 1.0, order=1.0, knob="rtol") == pytest.approx([1.0, 0.06], rel=0.01)
    # a setting within ten times of the coarsest is close enough, but a second one, eight times coarser, is tried
    assert _tried(lambda s: s, 0.12, 1.0, order=1.0, knob="rtol") == pytest.approx([0.12, 0.96], rel=0.01)
    assert _tried(lambda s: s, 0.05, 1.0, order=1.0, knob="rtol") == pytest.approx([0.05, 0.3], rel=0.01)
    # with an error of nothing at all the search goes on by eight each time, up to the coarsest setting
    assert _tried(lambda s: 0.0, 1.0, 1.0, most=100.0) == pytest.approx([1.0, 8.0, 64.0, 100.0])


def test_a_search_steps_by_at_least_a_tenth_and_at_most_to_a_twentieth() -> None:
    # errors far above the target
    assert _tried(lambda s: 1e12 * s**2, 1.0, 1.0)[:2] == [1.0, 0.05]
    # a run that fails says nothing of its error
    assert _tried(lambda s: math.inf if s > 0.1 else s**2, 1.0, 1.0)[:3] == pytest.approx([1.0, 0.25, 0.0625])
    # an error just above the target, which a step of 0.96 would meet
    assert _tried(lambda s: 1.001 * s**2, 1.0, 1.0)[:2] == [1.0, 0.9]
    # and just below it: a second setting is tried above
    assert _tried(lambda s: 0.99 * s**2, 1.0, 1.0) == pytest.approx([1.0, 1.12])


def test_a_search_between_two_settings_stays_between_them() -> None:
    def error(setting: float) -> float:
        return 2.0 if setting >= 2.0 else 1e-4

    # below the target by far, so that the aim is beyond the setting that fails: the middle is taken each time
    tried = _tried(error, 4.0, 1.0)
    assert tried[0] == 4.0
    low, high = max(s for s in tried[1:] if s < 2.0), min(s for s in tried if s >= 2.0)
    assert high / low <= 1.13
    serving, failing = -math.inf, math.inf
    for nth, setting in enumerate(tried):
        if math.isfinite(serving) and math.isfinite(failing):
            # three digits are kept
            assert serving < setting < failing
            assert setting == pytest.approx(math.sqrt(serving * failing), rel=0.01), nth
        if error(setting) <= 1.0:
            serving = max(serving, setting)
        else:
            failing = min(failing, setting)


def test_a_step_that_is_predicted_between_two_settings_is_taken_if_it_is_apart_from_both() -> None:
    # a half of the target below a setting that fails: the order that both show gives the next one
    errors = {2.0: 4.0, 0.959: 0.5}
    tried = _tried(lambda s: errors.get(s, 1.0), 2.0, 1.0)
    order = math.log(8.0) / math.log(2.0 / 0.959)
    assert tried[:3] == pytest.approx([2.0, 0.959, 0.959 * (2.0 * 0.92) ** (1.0 / order)], rel=0.01)
    # a tenth of it, and an order of 3 at most: the setting would be that which fails, and the middle is taken
    errors = {2.0: 4.0, 0.959: 0.1015}
    third = 0.959 * (0.92 / 0.1015) ** (1.0 / 3.0)
    assert third == pytest.approx(2.0, rel=0.01)
    assert _tried(lambda s: errors.get(s, 1.0), 2.0, 1.0)[2] == pytest.approx(math.sqrt(2.0 * 0.959), rel=0.01)


def test_a_search_ends_within_1_12_of_the_coarsest_setting_and_of_the_target() -> None:
    # without an error, eight times coarser, to a setting from which the coarsest is 1.12 away
    assert _tried(lambda s: 0.0, 0.125, 1.0, most=1.12) == [0.125, 1.0]
    # a target of 1.12 errors is met by a second setting that is so much coarser
    assert _tried(lambda s: s, 1.0, 1.12, order=1.0)[:2] == [1.0, 1.12]


def test_the_order_is_that_of_the_two_settings_nearest_to_the_target() -> None:
    # errors in units of a target of 1e-3: 100 with order 2, and less of it below 10
    def error(setting: float) -> float:
        return 0.1 * setting**2 if setting > 0.3 else 0.1 * 0.3**2 * (setting / 0.3) ** 1.2

    first, second, third, fourth = _tried(error, 1.0, 1e-3)[:4]
    assert second == pytest.approx(math.sqrt(0.92e-2), rel=0.01)
    orders = [math.log(error(a) / error(b)) / math.log(a / b) for a, b in ((first, second), (second, third))]
    assert min(orders) > 1.0
    for setting, following, order in ((second, third, orders[0]), (third, fourth, orders[1])):
        assert following == pytest.approx(setting * (0.92e-3 / error(setting)) ** (1.0 / order), rel=0.01)


def test_no_run_is_made_twice_at_the_finest_setting() -> None:
    calls: list[float] = []

    def trial(setting: float) -> Trial:
        calls.append(setting)
        return Trial(setting=setting, error=1.0)

    settle(trial, 1.0, 1e-3, order=2.0, least=0.5, most=1.0)
    assert calls == [1.0, 0.5]


def test_a_search_ends_at_its_finest_setting_and_at_a_floor() -> None:
    # no finer setting than the least
    assert _tried(lambda s: 1.0, 1.0, 1e-3, least=0.5) == [1.0, 0.5]
    # three settings, together finer by more than 0.3, that reduce the error by less than 0.7
    assert len(_tried(lambda s: 1.0, 1.0, 1e-3)) == 4
    assert len(_tried(lambda s: max(0.71, min(1.0, 0.71 * s**0.01)), 1.0, 1e-3)) == 4
    assert len(_tried(lambda s: 0.69 if s < 1e-3 else 1.0, 1.0, 1e-3)) > 4
    # steps of 0.81, 0.66 and 0.66 are finer by 0.35 together, and those of three times 0.66 by 0.28
    assert _tried(lambda s: 1.4, 100.0, 1.0) == pytest.approx([100.0, 81.1, 53.3, 35.0, 23.0], rel=0.01)
    # those of three times 0.71 by 0.35 only
    assert len(_tried(lambda s: 1.3, 100.0, 1.0)) == 16
    # an error at the target serves
    found = settle(_made_up(lambda s: 1.0), 1.0, 1.0, order=2.0, least=0.1, most=1.0)
    assert found.best is not None
    assert found.best.setting == 1.0


def test_an_error_of_the_target_itself_is_accepted() -> None:
    trials = [Trial(setting=2.0, error=1.0), Trial(setting=1.0, error=0.5)]
    assert accepted(trials, 1.0) == trials[0]
    first = Settled(best=Trial(setting=1.0, error=1.0), trials=())
    assert confirm(_made_up(lambda s: 1.0), first, 1.0, order=2.0, least=0.0).best == first.best


def _confirmed(first: float, error: Callable[[float], float], *, every: bool = False, order: float = 2.0) -> list[int]:
    """Return the settings that a confirmation tries, as numbers of neighbours below the first: 39 are a quarter."""
    settled = Settled(best=Trial(setting=1.0, error=first), trials=())
    trials = confirm(_made_up(error), settled, 1.0, order=order, least=0.0, every=every).trials
    places = [39.0 * math.log(trial.setting) / math.log(0.25) for trial in trials]
    assert places == pytest.approx([round(place) for place in places], abs=1e-6)
    return [round(place) for place in places]


@pytest.mark.parametrize(
    ("error", "step"),
    # a neighbour more for each factor of exp(1/2) below the target, from the second on, and eight at most
    [(0.9, 1), (0.4, 1), (0.35, 2), (0.21, 3), (0.13, 4), (0.08, 5), (0.04, 6), (0.025, 7), (0.01, 8), (1e-9, 8)],
)  # fmt: skip
def test_a_confirmation_skips_settings_where_errors_are_far_below_the_target(error: float, step: int) -> None:
    count = sum(error * math.exp(0.5 * number) < 1.0 for number in range(2, 9))
    assert step == 1 + count
    found = _confirmed(error, lambda s: error, order=0.0)
    assert found == [*range(0, 39, step), 39]
    assert _confirmed(error, lambda s: error, order=0.0, every=True) == [*range(40)]


def test_a_confirmation_remembers_errors_of_settings_up_to_1_6_times_coarser() -> None:
    # one large error at the first setting counts, reduced by the order, up to that distance
    places = _confirmed(0.9, lambda s: 1e-9)
    near = [place for place in places if 0.25 ** (-place / 39.0) <= 1.6]
    expected = 0
    for place, following in zip(near, places[1:], strict=False):
        envelope = 0.9 * 0.25 ** (2.0 * place / 39.0)
        expected = place + 1 + sum(envelope * math.exp(0.5 * number) < 1.0 for number in range(2, 9))
        assert following == expected
    beyond = places[len(near)]
    assert places[len(near) + 1] == beyond + 8


def test_the_steps_of_samples_and_the_margins_are_those_that_are_documented() -> None:
    # measured on 38 random scenes: by the order of the method
    assert dict(MARGIN) == {1: 0.8, 2: 0.8, 4: 0.6, 0: 0.25}
    # a candidate without a fixed step has the margin of tolerances
    assert MARGIN[Candidate(name="scipy", runs="scipy", knob="rtol", order=1.0).kind] == 0.25
