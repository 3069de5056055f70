"""From fits and errors to names, orders and sentences: each rule by itself, with numbers on both sides of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dem_bridge.errors import UsageError
from dem_bridge.judging import deck
from dem_bridge.judging.diagnosis import Diagnosis, name_cause
from dem_bridge.judging.fitting import Block, Fit
from dem_bridge.judging.foreign import Command as ForeignCommand
from dem_bridge.judging.hypotheses import Hypothesis, Variant
from dem_bridge.judging.model import Model
from dem_bridge.judging.reference import QuantityErrors, reference_at
from dem_bridge.judging.without_fits import on_single_grid
from dem_bridge.lmp.reader.script import Command
from dem_bridge.scene.scene import Scene

PAIR = Scene(name="p", duration=1e-3, mass=(1e-2, 1e-2), stiffness=(4e9,), velocity=(1.0, 0.0), samples=50)


# ---------------------------------------------------------------- which fits are as good, and which name they get
def fit(
    name: str = "mass", *, rms: float = 1.0, largest: float = 3.0, error: float = 1e-3, floors: float = 99.0,
    family: str = "", nameable: bool = True, variant: Variant | None = None,
) -> Fit:  # fmt: skip
    system = Model(PAIR).system
    hypothesis = Hypothesis(name, lambda p: variant or Variant(system), "", family=family, nameable=nameable)
    return Fit(hypothesis, np.zeros(0), rms, largest, error, np.zeros(0), floors=floors)


def named(none: Fit, fits: list[Fit], *, effect: float = 1e3, dt: float | None = 1e-6, rest: float = 1.0) -> Diagnosis:
    """Return the diagnosis for fits without a file; ``rest`` is the largest error at rest."""
    decision = SimpleNamespace(
        within_step=lambda best: False,
        adaptive_error=lambda: 1e-10,
        effect=lambda best: effect,
        error_at_rest=lambda: rest * none.error,
    )
    block = SimpleNamespace(values=np.zeros((50, 2)))
    search: Any = SimpleNamespace(decision=decision, data=SimpleNamespace(dt=dt, blocks=[block]), scene=PAIR)
    return name_cause(search, none, fits)


def test_a_cause_may_leave_a_little_to_a_code_of_unknown_method() -> None:
    none = fit("none", rms=1e4, error=1e-2)
    assert named(none, [fit("gravity", rms=5.0, largest=50.0, error=1e-5)]).cause == "gravity"
    # too large for the error of a method, or too much of the difference
    assert named(none, [fit("gravity", rms=5.0, largest=50.0, error=3e-5)]).cause == "unknown"
    assert named(none, [fit("gravity", rms=90.0, largest=500.0, error=1e-5)]).cause == "unknown"
    # what nothing explains is no cause if it is as small as errors of codes are, and none of it is at rest
    small = fit("none", rms=1e2, error=5e-9)
    assert named(small, [], rest=0.0).cause == "none"
    assert named(small, [], rest=0.5).cause == "unknown"


def test_an_effect_below_fifty_floors_is_not_named() -> None:
    none = fit("none", rms=40.0, error=1e-2)
    assert named(none, [fit("mass")], effect=60.0).cause == "mass"
    assert named(none, [fit("mass")], effect=40.0).cause == "unknown"
    assert named(fit("none", rms=1e3, error=1e-7), [fit("mass")], effect=40.0).cause == "none"
    assert named(none, [fit("drag", nameable=False)]).cause == "unknown"


def test_times_in_another_unit_may_as_well_be_scaled_times() -> None:
    none, system = fit("none", rms=1e6, error=1.0), Model(PAIR).system
    times = named(none, [fit("units", variant=Variant(system, scale=1e-3))])
    assert (times.cause, times.alternatives) == ("units", ("time-scale",))
    for variant in (
        Variant(system, factors=(1e3, 1.0, 1.0)),
        Variant(system, scale=1e-3, factors=(1e3, 1.0, 1.0)),
        Variant(system, scale=1e-3, factors=(1.0, 1.0, 1e3)),
    ):
        assert named(none, [fit("units", variant=variant)]).alternatives == ()


# ---------------------------------------------------------------- errors
def test_the_largest_error_may_be_larger_or_smaller_by_what_explains_it() -> None:
    part = QuantityErrors(
        quantity="velocity", scale=2.0, error=np.array([[1.0, -3.0]]), explained=np.array([[2.5, 0.2]]),
        columns=(4, 7), reference_uncertainty=0.0,
    )  # fmt: skip
    assert (part.value, part.place, part.floor) == (3.0, "body 7", 2.5)
    # the other error may be 3.5, this one 2.8
    assert part.uncertainty == pytest.approx(0.5)
    sure = replace(part, explained=np.array([[0.1, 0.2]]))
    assert sure.uncertainty == pytest.approx(0.2)


@pytest.mark.parametrize("times", [[0.0, 2e-6, 1e-6], [0.0, 1e-6, 1e-6], [0.0, np.nan], [-1e-6, 1e-6], [0.0], []])
def test_times_without_an_order_have_no_reference(times: list[float]) -> None:
    with pytest.raises(UsageError, match=r"increasing times|any later\s+time"):
        reference_at(PAIR, np.array(times))


def test_the_reference_is_at_the_times_that_are_given_with_or_without_the_start() -> None:
    whole, later = (reference_at(PAIR, np.array(times)) for times in ([0.0, 1e-5, 3e-5], [1e-5, 3e-5]))
    for name, values in whole.values.items():
        assert later.values[name].shape == (2, values.shape[1])
        np.testing.assert_allclose(later.values[name], values[1:], rtol=1e-12, atol=1e-15)


# ---------------------------------------------------------------- decks
def commands(*lines: str) -> tuple[Command, ...]:
    return tuple(Command("in.x", number, tuple(line.split())) for number, line in enumerate(lines, start=1))


def run_of(*lines: str, dangerous: int = 0, dt: float | None = 1e-6, units: str = "si") -> Any:
    state: Any = SimpleNamespace(units=units)
    user = deck.UserDeck(
        path=Path("in.x"), commands=commands(*lines), state=state, read=None, mirrored=False, problems=()
    )
    return SimpleNamespace(deck=user, dangerous=dangerous, dt=dt, version=20250722)


def test_step_and_radius_of_a_deck_are_in_its_units() -> None:
    atoms = {1: SimpleNamespace(radius=0.5), 2: SimpleNamespace(radius=2.0)}
    for units, length, time in (("si", 1.0, 1.0), ("cgs", 1e-2, 1.0), ("micro", 1e-6, 1e-6)):
        user = run_of(units=units).deck
        user.state.__dict__.update(particles=SimpleNamespace(atoms=atoms), time_steps=[], step=3.0)
        assert user.radius == pytest.approx(2.0 * length)
        assert user.dt == pytest.approx(3.0 * time)
        user.state.__dict__.update(particles=SimpleNamespace(atoms={}), time_steps=[1.0, 2.0])
        assert (user.radius, user.dt) == (None, None)


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("sh {dt}", r"has no \{out\}"),
        ("sh {out}", r"has no \{dt\}"),
        ("sh {dt} {out} {out.csv}", "has 2 names of its output"),
        ("sh {dt} {out} {other}", "the placeholder {other} is unknown"),
    ],
)
def test_what_a_command_lacks_is_named(command: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        ForeignCommand.of(command)


# ---------------------------------------------------------------- single precision
def block_of(*columns: np.ndarray, quantity: int = 0, digits: float = 1e-13) -> Block:
    values = np.column_stack(columns)
    scale = float(np.max(np.abs(values)))
    return Block(
        quantity, values, np.arange(values.shape[1]), np.full(values.shape, digits), np.isfinite(values), scale,
        np.full(values.shape, digits * scale),
    )  # fmt: skip


def is_single(*blocks: Block) -> bool:
    data: Any = SimpleNamespace(blocks=blocks)
    return on_single_grid(data)


def test_numbers_of_single_precision_are_recognised_and_doubles_are_not() -> None:
    random = np.random.default_rng(2)
    doubles, others = random.uniform(0.1, 0.8, (2, 60))
    rounded, exact = (part.astype(np.float32).astype(float) for part in (doubles, others))
    rest = np.zeros(60)
    assert is_single(block_of(rounded, exact, rest))
    assert is_single(block_of(np.round(rounded, 11), digits=1e-11))
    assert not is_single(block_of(doubles, others, rest))
    assert not is_single(block_of(rounded, others, rest))
    assert not is_single(block_of(1e-6 * doubles, digits=1e-17))
    # six digits do not resolve a grid of seven, and ten values are too few
    assert not is_single(block_of(np.round(rounded, 6), digits=5e-7))
    assert not is_single(block_of(rounded[:10]))


def test_displacements_on_the_grid_of_a_position_are_recognised() -> None:
    random = np.random.default_rng(2)
    near, far = random.uniform(0.0, 1e-4, (2, 60))
    grid = 2.0**-30
    on_grid, origin = grid * np.rint(far / grid), near.astype(np.float32).astype(float)
    assert is_single(block_of(origin, on_grid, quantity=1))  # a body that starts at the origin has its own grid
    assert not is_single(block_of(near, on_grid, quantity=1))
    assert not is_single(block_of(near, far, quantity=1))
