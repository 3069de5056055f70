"""Each rule of the order of convergence, with exact values and with numbers on both sides of its threshold."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dem_bridge.errors import UsageError
from dem_bridge.judging.order import Convergence, Order, convergence
from dem_bridge.judging.reference import QuantityErrors
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
    # each sample has an error of its own; nothing stands above what is explained, so that all of each error counts
    errors = [np.arange(1.0, len(time) + 1.0) ** 2 for time in times]
    files = [
        file_of(f"f{k}", 1e-7 * (k + 1), {"velocity": part_of(error[:, None], 1e9, (0,))}, time=1e-5 * time)
        for k, (time, error) in enumerate(zip(times, errors, strict=True))
    ]
    (part,) = convergence(files)
    expected = [math.sqrt(np.mean(error[chosen] ** 2)) for error, chosen in zip(errors, rows, strict=True)]
    assert part.errors == pytest.approx(expected)


def test_files_without_a_common_interval_are_named_with_the_end_of_one_and_the_start_of_the_other() -> None:
    rows = ([3.0, 4.0, 9.0], [0.0, 1.9, 1.95, 2.0], [0.5, 0.6, 0.7, 8.0], [2.9, 8.0, 9.0, 10.0], [2.0, 2.5, 5.0])
    files = [
        file_of(name, 1e-7 * (k + 1), {}, time=row) for k, (name, row) in enumerate(zip("abcde", rows, strict=True))
    ]
    with pytest.raises(UsageError, match=r"^b ends at 2 s and a begins at 3 s; "):
        convergence(files)
    # one common instant is no interval
    with pytest.raises(UsageError, match=r"^b ends at 2 s and e begins at 2 s; "):
        convergence([files[1], files[4]])


# ---------------------------------------------------------------- errors of several files
def part_of(error: Floats, limit: float, columns: tuple[int, ...], *, reference: float = 0.0, name: str = "velocity"
            ) -> QuantityErrors:  # fmt: skip
    explained = np.full(error.shape, limit)
    return QuantityErrors(
        quantity=name, scale=1.0, error=error, explained=explained, columns=columns, reference_uncertainty=reference
    )


def file_of(
    name: str, dt: float | None, parts: dict[str, QuantityErrors], rows: int = 10, *, time: Any = None
) -> Any:  # fmt: skip
    times = 1e-5 * np.arange(rows) if time is None else np.array(time)
    return SimpleNamespace(record=SimpleNamespace(name=name, dt=dt, time=times), quantities=parts)


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


# ---------------------------------------------------------------- errors along the shape of the coarsest file's
Pair = tuple[float, float]


def planted(dt: Sequence[float], measured: Sequence[Pair], whole: Sequence[Pair]) -> Convergence:
    """Return the convergence of files with these errors and what is explained of them, fine to coarse.

    Of two samples after the start the coarsest file has an error in the first alone, which is the shape. ``measured``:
    root mean squares along it; ``whole``: of both samples. Both are equal for the coarsest file.
    """
    files, size, part = [], math.sqrt(2.0), math.sqrt(1.5)
    for step, (along, limit), (total, all_limit) in zip(dt, measured, whole, strict=True):
        error = np.array([[0.0], [size * along], [math.sqrt(2.0 * total**2 - 2.0 * along**2)]])
        explained = np.array([[0.0], [part * limit], [math.sqrt(max(2.0 * all_limit**2 - 1.5 * limit**2, 0.0))]])
        errors = replace(part_of(error, 0.0, (0,)), explained=explained)
        files.append(file_of(f"f{step}", step, {"velocity": errors}, rows=3))
    (result,) = convergence(files)
    assert result.errors == pytest.approx([error for error, _ in measured])
    assert result.explained == pytest.approx([limit for _, limit in measured])
    return result


def same(errors: Sequence[float], limit: float = 1e-6) -> list[Pair]:
    return [(error, limit) for error in errors]


def follows(part: Convergence) -> tuple[int, bool]:
    """Return the number of the finest files that do not count for the order, all but one without it, and flatness."""
    return len(part.dt) - (1 if part.order is None else len(part.order.steps)), not math.isnan(part.flat)


def test_errors_are_measured_along_the_shape_of_those_of_the_coarsest_file() -> None:
    def measured(explained: Sequence[float]) -> tuple[float, ...]:
        files = []
        for step, factor, limit in zip((1e-7, 2e-7, 4e-7), (1.0, 4.0, 16.0), explained, strict=True):
            error = np.array([[0.0], [factor], [0.3 if step < 4e-7 else 0.0]])
            files.append(file_of("f", step, {"velocity": part_of(error, limit, (0,), reference=0.001 * limit)}, rows=3))
        (result,) = convergence(files)
        return result.errors

    along, all_of_it = 1.0 / math.sqrt(2.0), math.sqrt(1.09 / 2.0)
    assert measured((0.01,) * 3) == pytest.approx([along, 4.0 * along, 16.0 * along])
    # errors that digits may explain have no shape: three times what is explained of the coarsest file is the limit
    for limit, first in ((3.5, along), (4.0, all_of_it)):
        assert measured((limit,) * 3)[0] == pytest.approx(first)
    assert measured((9.0, 9.0, 0.01))[0] == pytest.approx(along)
    # samples of different numbers have none either: two of one file and three of the other are in the common interval
    shape, times = np.arange(4.0)[:, None] * [1.0, -2.0], ((0.0, 1.0, 2.0), (0.1, 0.6, 1.1, 3.1))
    files = [
        file_of(f"f{k}", 1e-7 * (k + 1), {"velocity": part_of(shape[: len(time)], 1e-9, (0, 1))}, time=time)
        for k, time in enumerate(times)
    ]
    (part,) = convergence(files)
    assert part.errors == pytest.approx([math.sqrt(np.mean(chosen**2)) for chosen in (shape[1:3], shape[:3])])


def test_the_part_of_an_error_along_a_shape_is_exact() -> None:
    start = np.zeros((1, 2))
    shape, error = np.array([[3.0, 0.0], [0.0, 4.0]]), np.array([[1.0, 9.0], [9.0, 2.0]])
    limit = np.array([[0.3, 7.0], [7.0, 0.2]])
    for sign, along in ((1.0, 1.1), (-1.0, 0.0)):  # (3 + 8) / (5 * 2)
        fine = replace(part_of(np.vstack([start, sign * error]), 0.0, (0, 1), reference=0.1),
                       explained=np.vstack([start, limit]))  # fmt: skip
        coarse = part_of(np.vstack([start, shape]), 1e-9, (0, 1), reference=99.0)
        (part,) = convergence([file_of("f", dt, {"velocity": each}, rows=3)
                               for dt, each in ((1e-7, fine), (2e-7, coarse))])  # fmt: skip
        assert part.errors[0] == pytest.approx(along)
        # 2 |(3 * 0.2, 4 * 0.1)| / (sqrt(3) * 5 * 2), and the reference of the finest file
        assert part.explained[0] == pytest.approx(2.0 * math.hypot(0.6, 0.4) / (10.0 * math.sqrt(3.0)) + 0.1)


def test_rounding_along_a_shape_is_that_of_uniform_errors() -> None:
    random, rounding = np.random.default_rng(5), 0.05
    shape = random.standard_normal((200, 3))
    files = [file_of(f"f{dt}", dt, {"velocity": part_of(dt / 2e-7 * shape, rounding, (0, 1, 2))}, rows=200)
             for dt in (1e-7, 2e-7)]  # fmt: skip
    (part,) = convergence(files)
    used = shape[1:]
    size = float(np.sqrt(np.mean(used**2)))
    assert part.errors == pytest.approx([0.5 * size, size])
    # two deviations hold 95 % of what rounding really leaves along the shape
    left = [
        abs(float(np.sum(random.uniform(-rounding, rounding, used.shape) * used))) / (size * used.size)
        for _ in range(400)
    ]
    assert np.mean(np.array(left) <= part.explained[0]) == pytest.approx(0.954, abs=0.04)


def test_no_samples_after_the_start_have_no_convergence() -> None:
    files = [file_of(f"f{k}", 1e-7 * (k + 1), {"velocity": part_of(np.ones((rows, 1)), 0.0, (0,))}, time=time)
             for k, (rows, time) in enumerate(((2, (0.0, 2.0)), (3, (0.0, 0.5, 1.0))))]  # fmt: skip
    assert convergence(files) == ()


# ---------------------------------------------------------------- which files follow the step
DT = (1e-7, 2e-7, 4e-7, 1.6e-6)


@pytest.mark.parametrize(
    ("errors", "answer"),
    [
        # from a step to its double errors grow by more than half, to its fourfold by more than 1.5 times
        ((1.0, 1.45, 5.0, 50.0), (1, True)),
        ((1.0, 1.55, 5.0, 50.0), (0, False)),
        ((1.0, 1.1, 1.2, 2.9), (0, False)),
        ((1.0, 1.1, 1.2, 3.1), (2, True)),
        ((1.0, 1.1, 4.0, 40.0), (1, True)),
        ((4.0, 3.0, 2.0, 1.0), (0, False)),  # nothing follows
    ],
)
def test_errors_follow_the_step_if_they_grow_by_half_of_its_growth(
    errors: tuple[float, ...], answer: tuple[int, bool]
) -> None:
    part = planted(DT, same(errors), same(errors))
    assert follows(part) == answer
    assert part.flat == pytest.approx(errors[0] if answer[1] else NAN, nan_ok=True)


@pytest.mark.parametrize(
    ("measured", "whole", "answer"),
    [
        # an error counts from ten times what is explained on, and so do all coarser ones
        ((10.5, 40.0, 160.0), 17.0, (0, False)),
        ((9.5, 40.0, 160.0), 17.0, (1, False)),
        ((40.0, 9.5, 160.0), 17.0, (2, False)),
        ((9.0, 9.0, 9.0), 17.0, (3, False)),  # one error alone has no order
        # flat errors that digits explain, up to three times, are not flat
        ((15.0, 40.0, 160.0), 16.2, (1, True)),
        ((15.0, 40.0, 160.0), 17.0, (0, False)),
    ],
)
def test_digits_hide_errors_of_ten_times_and_explain_flat_ones_of_three_times_their_size(
    measured: tuple[float, ...], whole: float, answer: tuple[int, bool]
) -> None:
    # the whole errors are 50, 50, 500, 5000: flat between the two finest files
    sizes = [(50.0, whole), (50.0, 17.0), (500.0, 1.0), (5000.0, 1.0)]
    assert follows(planted(DT, same((*measured, 5000.0), 1.0), sizes)) == answer


def slope(first: float, second: float, ratio: float) -> float:
    return math.log(second / first) / math.log(ratio)


def test_the_uncertainty_of_an_order_is_the_largest_difference_of_its_parts() -> None:
    dt, errors = (1e-7, 2e-7, 4e-7), (1.0, 4.0, 20.0)
    fit, adjacent = 0.5 * math.log2(20.0), slope(4.0, 20.0, 2.0) - 0.5 * math.log2(20.0)
    for size, limit, expected in (
        (1.0, 0.0, adjacent),  # of two adjacent steps
        (2.0, 0.0, fit - 0.5 * math.log2(10.0)),  # of all errors
        (2.0, 0.19, fit - 0.5 * math.log2(10.0)),
        (2.0, 0.21, adjacent),  # ... where digits do not hide one of them
    ):
        order = planted(dt, same(errors, 0.0), [(size, limit), (4.0, 0.0), (20.0, 0.0)]).order
        assert order is not None
        assert (order.value, order.steps) == (pytest.approx(fit), dt[::-1])
        assert order.uncertainty == pytest.approx(expected, rel=1e-9)
    # what is not known of the errors adds to it
    doubtful = [(1.0, 0.03), (4.0, 0.08), (20.0, 0.0)]
    order = planted(dt, doubtful, [(1.0, 1.0), (4.0, 1.0), (20.0, 0.0)]).order
    assert order is not None
    assert order.uncertainty == pytest.approx(adjacent + math.hypot(0.03, 0.02) / math.log(4.0), rel=1e-9)
    two = planted(dt[:2], same(errors[:2], 0.0), same(errors[:2], 0.0)).order
    assert two is not None
    assert (two.value, two.uncertainty) == (pytest.approx(2.0), pytest.approx(0.0, abs=1e-12))
