"""Each rule of the order of convergence, with exact values and with numbers on both sides of its threshold."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dem_bridge.errors import UsageError
from dem_bridge.judging import order
from dem_bridge.judging.error import QuantityErrors
from dem_bridge.judging.order import Convergence, Order, convergence
from dem_bridge.trajectory.trajectory import Floats

NAN = math.nan


@pytest.mark.parametrize(
    ("used", "all_steps", "value", "uncertainty", "flat", "vanishes"),
    [
        (3, 3, 2.0, 0.04, NAN, True),
        (4, 4, 2.2, 0.049, NAN, True),
        (0, 3, 2.0, 0.01, NAN, False),  # no order
        (2, 2, 2.0, 0.01, NAN, False),  # two files show nothing
        (3, 4, 2.0, 0.01, NAN, False),  # one of the files does not follow
        (3, 3, 2.0, 0.01, 1e-9, False),  # errors remain
        (3, 3, 2.2, 0.05, NAN, False),
        (3, 3, 2.2, 0.06, NAN, False),
        (3, 3, 1.95, 0.0, NAN, False),
        (3, 3, 1.951, 0.0, NAN, True),
        (3, 3, 1.98, 0.04, NAN, False),
    ],
)
def test_errors_vanish_if_all_of_three_files_fall_at_second_order(
    used: int, all_steps: int, value: float, uncertainty: float, flat: float, vanishes: bool
) -> None:
    fitted = Order(value=value, uncertainty=uncertainty, steps=tuple(range(used, 0, -1))) if used else None
    errors = tuple(1.0 for _ in range(all_steps))
    part = Convergence(quantity="velocity", dt=errors, errors=errors, explained=errors, order=fitted, flat=flat)
    assert part.vanishes is vanishes


# ---------------------------------------------------------------- common samples
T = np.arange(13.0)


@pytest.mark.parametrize(
    ("times", "rows"),
    [
        # the start is left out, and one file ends before the other
        ([T, T[:11]], [range(1, 11)] * 2),
        ([T, np.arange(0.0, 12.5, 0.5)], [range(1, 13), range(2, 26, 2)]),
        ([T[2:], T[:11]], [range(9), range(2, 11)]),
        # eight samples in common are enough, of seven those of the common interval are taken instead
        ([T, np.append(T[:9], 9.5)], [range(1, 9)] * 2),
        ([T, np.append(T[:8], 8.5)], [range(1, 9), range(1, 9)]),
        ([T, np.append(T[:7] + 0.25, 9.0)], [range(1, 10), range(8)]),
        ([T, T[2:] + 0.25], [range(3, 13), range(10)]),
        ([T - 1.5, T + 0.25], [range(2, 13), range(11)]),
        # times agree to a millionth of the smallest interval of any file
        ([T, T + 0.5e-6], [range(1, 13), range(1, 13)]),
        ([T[1:], T[1:] + 1.5e-6], [range(1, 12), range(11)]),
        ([np.append(T[1:], 112.0), np.append(T[1:] + 5e-6, 112.0)], [range(1, 13), range(13)]),
        ([np.arange(100.0), np.arange(10.0, 99.0, 10.0) + 5e-6], [range(11, 91), range(9)]),
    ],
)
def test_samples_are_compared_at_common_times_or_in_the_common_interval(times: list[Floats], rows: list[range]) -> None:
    scaled = [1e-5 * time for time in times]
    assert [list(part) for part in order._common_rows(scaled, ["a", "b", "c"])] == [list(part) for part in rows]


def test_files_without_a_common_interval_are_named_with_the_end_of_one_and_the_start_of_the_other() -> None:
    rows = ([3.0, 4.0, 9.0], [0.0, 1.9, 1.95, 2.0], [0.5, 0.6, 0.7, 8.0], [2.9, 8.0, 9.0, 10.0], [2.0, 2.5, 5.0])
    times = [np.array(row) for row in rows]
    with pytest.raises(UsageError, match=r"^b ends at 2 s and a begins at 3 s; "):
        order._common_rows(times, [*"abcde"])
    # one common instant is no interval
    with pytest.raises(UsageError, match=r"^b ends at 2 s and e begins at 2 s; "):
        order._common_rows([times[1], times[4]], ["b", "e"])


# ---------------------------------------------------------------- errors of several files
def part_of(error: Floats, limit: float, columns: tuple[int, ...], *, reference: float = 0.0, name: str = "velocity"
            ) -> QuantityErrors:  # fmt: skip
    explained = np.full(error.shape, limit)
    return QuantityErrors(
        quantity=name, scale=1.0, error=error, explained=explained, columns=columns, reference_uncertainty=reference
    )


def file_of(name: str, dt: float | None, parts: dict[str, QuantityErrors], rows: int = 10) -> Any:
    return SimpleNamespace(record=SimpleNamespace(name=name, dt=dt, time=1e-5 * np.arange(rows)), quantities=parts)


SHAPE = np.outer(np.arange(10.0), [1.0, -2.0])


def followers(steps: tuple[float | None, ...], power: float = 2.0) -> list[Any]:
    return [
        file_of(f"f{k}", dt, {"velocity": part_of((dt or 1e-6) ** power * SHAPE, 1e-30, (0, 1))})
        for k, dt in enumerate(steps)
    ]


def test_the_order_of_errors_that_are_a_power_of_the_step_is_exact() -> None:
    (part,) = convergence(followers((2e-6, None, 1e-6, 4e-6), power=1.5))
    assert part.dt == (1e-6, 2e-6, 4e-6)
    rms = [dt**1.5 * math.sqrt(np.mean(SHAPE[1:] ** 2)) for dt in part.dt]
    assert part.errors == pytest.approx(rms, rel=1e-12)
    assert part.order is not None
    assert part.order.value == pytest.approx(1.5, abs=1e-12)
    assert part.order.uncertainty < 1e-9
    assert part.order.ends == (4e-6, 1e-6)
    assert math.isnan(part.flat)
    assert len(convergence(followers((1e-6, 2e-6)))) == 1
    assert convergence(followers((None, 2e-6))) == ()


def test_steps_that_differ_by_a_rounding_are_one_step() -> None:
    assert convergence(followers((1e-6, 1e-6 * (1.0 + 1.5e-9))))
    with pytest.raises(UsageError, match=r"^f0 and f1 have the same time step, 1e-06 s; "):
        convergence(followers((1e-6 * (1.0 + 0.5e-9), 1e-6)))


def test_quantities_and_bodies_that_only_some_files_have_are_left_out() -> None:
    first, second = followers((1e-6, 2e-6))
    second.quantities["displacement"] = first.quantities["velocity"]
    assert [part.quantity for part in convergence([first, second])] == ["velocity"]
    first.quantities["contact_force"] = first.quantities["velocity"]
    assert [part.quantity for part in convergence([first, second])] == ["velocity"]
    first.quantities["displacement"] = part_of(SHAPE, 0.0, (4, 5))
    assert [part.quantity for part in convergence([first, second])] == ["velocity"]
    # in the order of the file of the finest step
    both = {"velocity": first.quantities["velocity"], "displacement": part_of(SHAPE, 0.0, (0, 1), name="displacement")}
    files = file_of("h", 1e-6, both), file_of("i", 2e-6, dict(reversed(both.items())))
    assert [part.quantity for part in convergence(files)] == ["velocity", "displacement"]
    # body 1 alone is in both files, in other columns
    other = part_of(4e-12 * SHAPE[:, ::-1], 1e-30, (1, 7))
    (part,) = convergence([first, file_of("g", 2e-6, {"velocity": other})])
    assert part.errors[0] == pytest.approx(2e-12 * math.sqrt(np.mean(np.arange(1.0, 10.0) ** 2)), rel=1e-12)
    assert part.order is not None
    assert part.order.value == pytest.approx(2.0)


def samples(*factors: float, limit: float = 0.01, other: float = 0.3) -> list[QuantityErrors]:
    """Return errors of two samples: a factor along the first and another across it, but for the last file."""
    return [
        part_of(np.array([[factor], [other if k + 1 < len(factors) else 0.0]]), limit, (0,), reference=0.001 * (k + 1),
                name="velocity" if k == 0 else "other")
        for k, factor in enumerate(factors)
    ]  # fmt: skip


STEPS = [(1e-7, 0), (2e-7, 1), (4e-7, 2)]
BOTH = [np.array([0, 1])] * 3


def test_errors_are_measured_along_the_shape_of_those_of_the_coarsest_file() -> None:
    part = order._convergence(samples(1.0, 4.0, 16.0), BOTH, STEPS)
    assert part is not None
    assert part.quantity == "velocity"
    # of two samples the second has none of the coarsest file's error
    assert part.errors == pytest.approx([factor / math.sqrt(2.0) for factor in (1.0, 4.0, 16.0)])
    # two deviations of a uniform error, along one of two samples, and the reference of the finest file
    rounding = 2.0 * 0.009 / math.sqrt(3.0) / math.sqrt(2.0) + 0.001
    assert part.explained == pytest.approx([rounding] * 3)
    # errors that digits may explain have no shape: three times what is explained is the limit
    for limit, along in ((3.5, True), (4.0, False)):
        part = order._convergence(samples(1.0, 4.0, 16.0, limit=limit), BOTH, STEPS)
        assert part is not None
        expected = 1.0 if along else math.sqrt(1.0 + 0.09)
        assert part.errors[0] == pytest.approx(expected / math.sqrt(2.0))
    # ... of what is explained of the coarsest file
    parts = samples(1.0, 4.0, 16.0, limit=9.0)
    parts[-1] = part_of(parts[-1].error, 0.01, (0,))
    part = order._convergence(parts, BOTH, STEPS)
    assert part is not None
    assert part.errors[0] == pytest.approx(1.0 / math.sqrt(2.0))
    # samples of different numbers have none either
    uneven = [np.array([0, 1]), np.array([0]), np.array([0, 1])]
    part = order._convergence(samples(1.0, 4.0, 16.0), uneven, STEPS)
    assert part is not None
    assert part.errors == pytest.approx([math.sqrt(1.09 / 2.0), 4.0, 16.0 / math.sqrt(2.0)])


def test_errors_that_stay_at_the_finest_step_are_the_flat_ones() -> None:
    part = order._convergence(samples(1.0, 1.1, 4.4, limit=1e-9, other=0.0), BOTH, STEPS)
    assert part is not None
    assert part.flat == pytest.approx(1.0 / math.sqrt(2.0))
    assert part.order is not None
    assert part.order.steps == (4e-7, 2e-7)
    part = order._convergence(samples(1.0, 4.0, 16.0, limit=1e-9), BOTH, STEPS)
    assert part is not None
    assert math.isnan(part.flat)


def test_no_rows_or_bodies_have_no_convergence_and_lists_of_other_lengths_are_an_error() -> None:
    nothing = [np.array([0, 1]), np.array([], dtype=int), np.array([0, 1])]
    assert order._convergence(samples(1.0, 4.0, 16.0), nothing, STEPS) is None
    with pytest.raises(ValueError, match="zip"):
        order._convergence(samples(1.0, 4.0, 16.0), BOTH[:2], STEPS)
    pairs = [(1.0, 0.0)] * 3
    with pytest.raises(ValueError, match="zip"):
        order._first_that_follows((1e-7, 2e-7), pairs, pairs)


def test_the_part_of_an_error_along_a_shape_is_exact() -> None:
    shape, error = np.array([[3.0, 0.0], [0.0, 4.0]]), np.array([[1.0, 9.0], [9.0, 2.0]])
    limit = np.array([[0.3, 7.0], [7.0, 0.2]])
    value, explained = order._along(shape, error, limit, 0.1)
    # (3 + 8) / (5 * 2), and 2 |(3 * 0.2, 4 * 0.1)| / (sqrt(3) * 5 * 2) + 0.1
    assert value == pytest.approx(1.1)
    assert explained == pytest.approx(2.0 * math.hypot(0.6, 0.4) / (10.0 * math.sqrt(3.0)) + 0.1)
    assert order._along(shape, -error, limit, 0.1)[0] == 0.0
    assert order._root_mean_square(np.array([[3.0, 4.0]])) == pytest.approx(math.sqrt(12.5))


# ---------------------------------------------------------------- which files follow the step
DT = (1e-7, 2e-7, 4e-7, 1.6e-6)


@pytest.mark.parametrize(
    ("errors", "answer"),
    [
        # from a step to its double errors grow by more than half, to its fourfold by more than 1.5 times
        ((1.0, 1.45, 5.0, 50.0), (1, True)),
        ((1.0, 1.55, 5.0, 50.0), (0, False)),
        ((2.0, 3.0, 9.0, 90.0), (1, True)),  # exactly half is too little
        ((1.0, 1.1, 1.2, 2.9), (0, False)),
        ((1.0, 1.1, 1.2, 3.1), (2, True)),
        ((1.0, 1.1, 4.0, 40.0), (1, True)),
        ((4.0, 3.0, 2.0, 1.0), (0, False)),  # nothing follows
    ],
)
def test_errors_follow_the_step_if_they_grow_by_half_of_its_growth(
    errors: tuple[float, ...], answer: tuple[int, bool]
) -> None:
    pairs = [(error, 1e-6) for error in errors]
    assert order._first_that_follows(DT, pairs, pairs) == answer


@pytest.mark.parametrize(
    ("measured", "whole", "answer"),
    [
        # an error counts from ten times what is explained on, and so do all coarser ones
        ((10.5, 40.0, 160.0, 640.0), 9.0, (0, False)),
        ((10.0, 40.0, 160.0, 640.0), 9.0, (1, False)),
        ((9.5, 40.0, 160.0, 640.0), 9.0, (1, False)),
        ((40.0, 9.5, 160.0, 640.0), 9.0, (2, False)),
        ((9.0, 9.0, 9.0, 9.0), 9.0, (4, False)),
        # flat errors that digits explain, up to three times, are not flat
        ((15.0, 40.0, 160.0, 640.0), 3.2, (1, True)),
        ((15.0, 40.0, 160.0, 640.0), 3.4, (0, False)),
    ],
)
def test_digits_hide_errors_of_ten_times_and_explain_flat_ones_of_three_times_their_size(
    measured: tuple[float, ...], whole: float, answer: tuple[int, bool]
) -> None:
    # the whole errors are 10, 10, 100, 1000: flat between the two finest files
    sizes = [(10.0, whole), (10.0, whole), (100.0, 0.01), (1000.0, 0.01)]
    assert order._first_that_follows(DT, [(error, 1.0) for error in measured], sizes) == answer


def test_an_exact_threefold_is_explained() -> None:
    sizes = [(3.0, 1.0), (3.0, 1.0), (100.0, 1.0), (1000.0, 1.0)]
    assert order._first_that_follows(DT, [(99.0, 1.0)] * 4, sizes) == (0, False)


def slope(first: float, second: float, ratio: float) -> float:
    return math.log(second / first) / math.log(ratio)


def test_the_uncertainty_of_an_order_is_the_largest_difference_of_its_parts() -> None:
    dt, errors = (1e-7, 2e-7, 4e-7), (1.0, 4.0, 20.0)
    exact = [(error, 0.0) for error in errors]
    fit = 0.5 * math.log2(20.0)
    for sizes, limit, expected in (
        ((1.0, 4.0, 20.0), 0.0, slope(4.0, 20.0, 2.0) - fit),  # of two adjacent steps
        ((1.0, 4.0, 60.0), 0.0, 0.5 * math.log2(60.0) - fit),  # of all errors
        ((1.0, 4.0, 60.0), 0.09, 0.5 * math.log2(60.0) - fit),
        ((1.0, 4.0, 60.0), 0.1, slope(4.0, 20.0, 2.0) - fit),  # ... where digits do not hide one of them
        ((1.0, 4.0, 60.0), 0.15, slope(4.0, 20.0, 2.0) - fit),
    ):
        result = order._order(dt, exact, [(size, limit) for size in sizes])
        assert result is not None
        assert (result.value, result.steps) == (pytest.approx(fit), dt[::-1])
        assert result.uncertainty == pytest.approx(expected, rel=1e-9)
    # what is not known of the errors adds to it
    doubtful = [(1.0, 0.03), (4.0, 0.08), (20.0, 0.0)]
    result = order._order(dt, doubtful, [(size, 1.0) for size in errors])
    assert result is not None
    unknown = math.hypot(0.03, 0.02) / math.log(4.0)
    assert result.uncertainty == pytest.approx(slope(4.0, 20.0, 2.0) - fit + unknown, rel=1e-9)
    two = order._order(dt[:2], exact[:2], exact[:2])
    assert two is not None
    assert (two.value, two.uncertainty) == (pytest.approx(2.0), pytest.approx(0.0, abs=1e-12))
    assert order._order(dt[:1], exact[:1], exact[:1]) is None
