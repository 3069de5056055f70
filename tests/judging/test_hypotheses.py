"""Every hypothesis with its sentence, its starts and limits, and what it changes, in numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from dem_bridge.judging import kernels, samples
from dem_bridge.judging.chain_hypotheses import global_hypotheses
from dem_bridge.judging.hypotheses import Changes, Hypothesis, Variant
from dem_bridge.judging.model import Model, system_of
from dem_bridge.judging.samples import MOST_BODIES_TO_ORDER, POWERS_OF_UNITS, half_steps, sample_hypotheses
from dem_bridge.scene.file import parse_scene
from dem_bridge.scene.scene import Damping, Scene, Wall
from dem_bridge.trajectory.trajectory import Floats
from tests.helpers.judged_records import CHAIN

HALF, NOTHING = np.array([0.5]), np.zeros(0)
FREE = (-math.inf, math.inf)
LOG = ((0.0,), (0.7,), (-0.7,))
WIDE = (*LOG, (1.6,), (-1.6,), (2.7,), (-2.7,))
DAMPED = replace(CHAIN, damping=Damping(law="dashpot", coefficient=5.0, clip=True))


def of(scene: Scene, *causes: str) -> list[Hypothesis]:
    return [each for each in global_hypotheses(scene, Model(scene)) if each.cause in causes]


def settings(each: Hypothesis) -> tuple[object, ...]:
    """Return the settings of the search that are not those of most hypotheses."""
    standard = (FREE, 1e-3, 1.5, "", True, False)
    actual = (each.bounds, each.probe, each.reach, each.family, each.nameable, each.logarithmic)
    return tuple(new for usual, new in zip(standard, actual, strict=True) if new != usual)


#: cause, sentence for 1.5 +- 0.25, starts, other settings than the usual ones, and value at 0.5
EVERYWHERE = [
    ("stiffness-scale", "All stiffnesses are 1.5 +- 0.25 of the scene's.", WIDE, ("factor",), math.exp(0.5)),
    ("mass", "All masses are 1.5 +- 0.25 of the scene's.", WIDE, ("factor",), math.exp(0.5)),
    ("exponent", "The exponent n is 1.5 +- 0.25 in place of 2.5.",
     ((0.0,), (0.25,), (-0.25,), (0.5,), (-0.5,)), ((-1.4, 3.0),), 3.0),
    ("exponent", "The exponent n is 1.5 +- 0.25 in place of 2.5, and stiffness over mass is 3 +- 0.5 times the number"
     " of the scene.",
     ((0.0, 0.0), (0.25, 0.0), (-0.25, 0.0), (0.5, 0.0), (-0.5, 0.0)), ((-1.4, 3.0),), 0.5),
    ("missing-sqrt-radius",
     "Stiffnesses lack sqrt(R*) in the contacts between bodies (mean factor 1.5 +- 0.25).", WIDE, (None,),
     math.exp(0.5)),
    ("missing-sqrt-radius",
     "Stiffnesses lack sqrt(R*) in the contacts between bodies (mean factor 1.5 +- 0.25).", WIDE, (None,),
     math.exp(0.5)),
    *(("damping", f"Contacts are damped ({name}, {clip}, constant 1.5 +- 0.25).", ((0.0,), (1.0,), (0.1,), (10.0,)),
       ((0.0, 400.0), 1e-2, 100.0, f"damping {law}"), None)
      for law, name in enumerate(("dashpot", "mass_velocity", "kuwabara-kono", "coeff_restitution"))
      for clip in ("clipped", "not clipped")),
    ("gravity", "The acceleration by gravity differs from the scene's by 1.5 +- 0.25 m/s^2.", None, (1e6,), None),
    ("tension", "Open contacts pull.", ((),), (), None),
    ("time-scale", "Times of the file are to be multiplied by 1.5 +- 0.25.", ((0.0,), (0.3,), (-0.3,)), (),
     math.exp(0.5)),
    ("start-velocity", "All start velocities are 1.5 +- 0.25 of the scene's.", LOG, (), math.exp(0.5)),
    ("drag", "Every body is dragged.", ((0.0,), (0.1,)), (False,), 0.5),
]  # fmt: skip


def test_the_hypotheses_of_a_chain_are_these() -> None:
    yielded = list(global_hypotheses(CHAIN, Model(CHAIN)))
    for each, (cause, sentence, starts, other, value) in zip(yielded, EVERYWHERE, strict=True):
        assert (each.cause, each.evidence.format(1.5, 0.25, 3.0, 0.5), settings(each)) == (cause, sentence, other)
        assert starts is None or each.starts == starts
        assert value is None or each.value(0.5) == pytest.approx(value)
        assert each.size == len(each.starts[0])
        assert each.where == ""


def test_the_hypotheses_of_a_damped_chain_have_its_damping_too() -> None:
    for clip in (True, False):
        scene = replace(DAMPED, damping=Damping(law="dashpot", coefficient=5.0, clip=clip))
        base, yielded = Model(scene).system, of(scene, "clip", "damping")
        assert [each.evidence.format(1.5, 0.25) for each in yielded[:3]] == [
            f"The net contact force is {'not ' if clip else ''}clipped at zero.",
            "The damping is 1.5 +- 0.25 of the scene's.",
            "Contacts are not damped.",
        ]
        assert yielded[0].make(NOTHING).system.clipped is not clip
        np.testing.assert_allclose(yielded[1].make(HALF).system.damping, math.exp(0.5) * base.damping)
        undamped = yielded[2].make(NOTHING).system
        assert (list(undamped.damping), undamped.damped) == ([0.0] * 6, False)
        assert (yielded[1].starts, settings(yielded[1]), yielded[1].value(0.5)) == (
            LOG,
            (),
            pytest.approx(math.exp(0.5)),
        )
        # another damping is fitted from its starts alone, because it does not begin at the scene
        assert [each.probe for each in yielded[3:]] == [None] * 8
    assert not of(CHAIN, "clip")


def test_each_hypothesis_changes_what_it_says() -> None:
    model = Model(CHAIN)
    base, factor = model.system, math.exp(0.5)
    by_cause = {each.cause: each for each in reversed(list(global_hypotheses(CHAIN, model)))}
    np.testing.assert_allclose(by_cause["stiffness-scale"].make(HALF).system.stiffness, factor * base.stiffness)
    np.testing.assert_allclose(by_cause["mass"].make(HALF).system.mass, factor * base.mass)
    np.testing.assert_allclose(by_cause["exponent"].make(HALF).system.exponent, base.exponent + 0.5)
    assert by_cause["tension"].make(NOTHING).system.pulls
    assert by_cause["time-scale"].make(HALF) == Variant(base, scale=factor)
    np.testing.assert_allclose(by_cause["start-velocity"].make(HALF).system.velocity, factor * base.velocity)
    dragged = by_cause["drag"].make(HALF).system
    assert dragged.drag == pytest.approx(0.5 / CHAIN.duration)
    again = of(replace(CHAIN, drag=300.0), "drag")[0].make(HALF).system
    assert again.drag == pytest.approx(300.0 + 0.5 / CHAIN.duration)
    # a factor of more than a thousand is none
    for p, logarithm in ((6.5, 6.5), (8.0, 7.0), (-6.5, -6.5), (-8.0, -7.0)):
        limited = by_cause["mass"].make(np.array([p])).system.mass / base.mass
        np.testing.assert_allclose(limited, math.exp(logarithm))
        assert by_cause["mass"].value(p) == pytest.approx(math.exp(logarithm))
    assert Hypothesis("", lambda p: Variant(base), "", starts=((1.0, 2.0), (3.0,))).size == 2


@pytest.mark.parametrize(
    ("law", "coefficient", "stiffer", "heavier"),
    # how the constant follows the stiffness and the effective mass
    [("dashpot", 5.0, 1.0, 1.0), ("mass_velocity", 2e4, 1.0, 2.0), ("kuwabara-kono", 1e-6, 3.0, 1.0),
     ("tsuji", 0.2, math.sqrt(3.0), math.sqrt(2.0)), ("coeff_restitution", 0.5, math.sqrt(3.0), math.sqrt(2.0))],
)  # fmt: skip
def test_damping_constants_follow_stiffness_and_mass_by_their_law(
    law: str, coefficient: float, stiffer: float, heavier: float
) -> None:
    scene = replace(CHAIN, damping=Damping(law=law, coefficient=coefficient))
    change = Changes(scene, Model(scene))
    inner = slice(1, -1)
    for factors, ratio in (({"stiffness": 3.0}, stiffer), ({"mass": 2.0}, heavier), ({}, 1.0)):
        changed = change.with_factors(**factors)
        np.testing.assert_allclose(changed.damping[inner] / change.base.damping[inner], ratio, rtol=1e-12)
        np.testing.assert_allclose(changed.mass, factors.get("mass", 1.0) * change.base.mass)
        np.testing.assert_allclose(changed.stiffness, factors.get("stiffness", 1.0) * change.base.stiffness)
    # the power of the overlap follows the exponent, and is not negative
    rate = {"kuwabara-kono": 1.0, "coeff_restitution": 0.5, "tsuji": 0.5}.get(law, 0.0)
    for bend in (0.25, -1.0):
        expected = max(rate * (0.5 + bend), 0.0)
        np.testing.assert_allclose(change.bent(bend).damping_power[inner], expected, atol=1e-12)
        np.testing.assert_allclose(change.bent(bend).exponent, 2.5 + bend)


def test_a_load_remains_and_a_weight_does_not_depend_on_the_mass() -> None:
    scene = replace(CHAIN, gravity=-3.0, precompression=20.0)
    change = Changes(scene, Model(scene))
    load = (change.base.free + 3.0) * change.base.mass
    assert np.max(np.abs(load)) > 1.0
    changed = change.with_factors(mass=2.0)
    np.testing.assert_allclose(changed.free, -3.0 + load / (2.0 * change.base.mass))


def test_effective_masses_and_places_of_contacts_are_along_the_line() -> None:
    # bodies of 2, 6 and 3 kg: m1 m2 / (m1 + m2), and the mass itself at a wall
    three = Scene(name="three", duration=1e-4, mass=(2.0, 6.0, 3.0), stiffness=(4e9, 4e9), velocity=(1.0, 0.0, 0.0),
                  wall_left=Wall(stiffness=3e9), wall_right=Wall(stiffness=4e9))  # fmt: skip
    by_mass, unit = Changes(three, Model(three)).damping(1, True)
    np.testing.assert_allclose(by_mass(np.ones(1)).system.damping / unit, [2.0, 1.5, 2.0, 3.0])
    walled = replace(CHAIN, wall_left=Wall(stiffness=3e9), wall_right=Wall(stiffness=4e9))
    change = Changes(walled, Model(walled))
    assert change.places().tolist() == [1, 2, 3, 4, 0, 5]
    for body in (0, 4):
        ratio = change.one_mass(body)(HALF).system.mass / change.base.mass
        np.testing.assert_allclose(ratio, np.where(np.arange(5) == body, math.exp(0.5), 1.0))
    for place in (0, 2, 5):
        ratio = change.one_stiffness(place)(HALF).system.stiffness / change.base.stiffness
        np.testing.assert_allclose(ratio, np.where(np.arange(6) == place, math.exp(0.5), 1.0))


@pytest.mark.parametrize("exponent", [2.5, 3.0, 1.5])
@pytest.mark.parametrize("depth", [3e-6, 0.0])
def test_another_damping_is_one_percent_of_the_critical_one_at_a_parameter_of_one(
    exponent: float, depth: float
) -> None:
    scene = replace(CHAIN, exponent=exponent, stiffness=(4.0, 5.0, 0.5, 6.0))
    model = Model(scene)
    model.depth = depth
    change, deep = Changes(scene, model), max(depth, 1e-12)
    first, second, beta = np.array(CHAIN.mass[:-1]), np.array(CHAIN.mass[1:]), np.array([4.0, 5.0, 0.5, 6.0])
    mass = first * second / (first + second)
    # of the stiffest contact, between bodies 3 and 4, at the depth of the scene
    critical = 2.0 * math.sqrt((exponent - 1.0) * 6.0 * deep ** (exponent - 2.0) * mass[3])
    shapes = [
        (np.ones(4), 0.0),
        (mass, 0.0),
        (beta, max(exponent - 2.0, 0.0)),
        (np.sqrt(mass * beta), max(0.5 * exponent - 1.0, 0.0)),
    ]
    for law, (shape, power) in enumerate(shapes):
        for clipped in (True, False):
            make, unit = change.damping(law, clipped)
            assert unit * shape[3] * deep**power == pytest.approx(0.01 * critical)
            system = make(np.array([3.0])).system
            np.testing.assert_allclose(system.damping, [0.0, *(3.0 * unit * shape), 0.0])
            np.testing.assert_allclose(system.damping_power[1:-1], power)
            assert (system.clipped, system.damped) == (clipped, True)
    named = [each for each in global_hypotheses(scene, model) if each.family.startswith("damping")]
    assert [each.make(HALF).system.clipped for each in named] == [True, False] * 4
    for law in range(4):
        _, unit = change.damping(law, True)
        assert [each.value(0.5) for each in named[2 * law : 2 * law + 2]] == [pytest.approx(0.5 * unit)] * 2


SPHERES = """
name = "row"
duration = 1e-3
[materials.hard]
youngs_modulus = 200e9
poissons_ratio = 0.3
density = 8000.0
[materials.soft]
youngs_modulus = 3e9
poissons_ratio = 0.4
density = 1200.0
[chain.pattern]
repeat = {repeat}
[[chain.pattern.cell]]
shape = "sphere"
radius = {radius}
material = "{material}"
[[chain.pattern.cell]]
shape = "sphere"
radius = 0.01
material = "hard"
[chain.striker]
radius = 0.01
material = "hard"
velocity = 0.5
"""


def patterns(scene: Scene) -> list[tuple[str, list[float], float | None]]:
    """Return cause, factors on stiffnesses at the parameter 0, and first step of the fit of each pattern."""
    base = Model(scene).system
    yielded = of(scene, "modulus", "missing-sqrt-radius")
    ratios = [each.make(np.zeros(1)).system.stiffness[1:-1] / base.stiffness[1:-1] for each in yielded]
    return [(each.cause, ratio.tolist(), each.probe) for each, ratio in zip(yielded, ratios, strict=True)]


def normal(values: Iterable[float]) -> Any:
    """Return values relative to their geometric mean."""
    parts = np.array([*values])
    return pytest.approx((parts / np.exp(np.mean(np.log(parts)))).tolist(), rel=1e-9)


def test_wrong_moduli_are_those_of_one_body_of_the_other_and_without_poissons_ratio() -> None:
    scene = parse_scene(SPHERES.format(repeat=1, radius=0.01, material="soft"))
    hard, soft = 200e9, 3e9
    loss_hard, loss_soft = 1.0 - 0.3**2, 1.0 - 0.4**2
    effective = 1.0 / (loss_hard / hard + loss_soft / soft)
    causes = patterns(scene)
    # both contacts are of a hard and a soft sphere: E of the first or of the second body is a pattern, E* is a factor
    assert [cause for cause, *_ in causes] == ["modulus", "modulus"]
    assert causes[0] == ("modulus", normal([hard / effective, soft / effective]), None)
    assert causes[1] == ("modulus", normal([soft / effective, hard / effective]), None)


def test_missing_radii_are_those_of_the_geometry_of_the_masses_and_of_the_whole_stiffness() -> None:
    scene = parse_scene(SPHERES.format(repeat=1, radius=0.03, material="soft"))
    uneven = replace(scene, mass=(scene.mass[0], 2.0 * scene.mass[1], 3.0 * scene.mass[2]))
    mass = np.cbrt(np.array(uneven.mass))
    uneven = replace(uneven, stiffness=(4e9, 5e9))
    expected = [
        ("missing-sqrt-radius", normal((mass[:-1] * mass[1:] / (mass[:-1] + mass[1:])) ** -0.5), None),
        ("missing-sqrt-radius", normal([1.0 / 4e9, 1.0 / 5e9]), None),
    ]
    assert [part for part in patterns(uneven) if part[0] != "modulus"] == expected
    numbers = replace(CHAIN, stiffness=(4e9,) * 4)
    mass = np.cbrt(np.array(CHAIN.mass))
    # the same stiffness in all contacts is that of a factor
    assert patterns(numbers) == [
        ("missing-sqrt-radius", normal((mass[:-1] * mass[1:] / (mass[:-1] + mass[1:])) ** -0.5), None)
    ]
    # a pattern that another one repeats is yielded once
    twice = replace(CHAIN, stiffness=tuple((mass[:-1] * mass[1:] / (mass[:-1] + mass[1:])) ** 0.5))
    assert len(patterns(twice)) == 1
    nearly = replace(twice, stiffness=(twice.stiffness[0] * (1.0 + 3e-9), *twice.stiffness[1:]))
    assert len(patterns(nearly)) == 2
    # beside a wall, which keeps its stiffness, a modulus is no factor on all contacts
    for wall in ({"wall_left": Wall(stiffness=2.0)}, {"wall_right": Wall(stiffness=0.5)}):
        (modulus, *_), walled = patterns(replace(numbers, **wall)), replace(numbers, **wall)  # type: ignore[arg-type]
        assert modulus == ("modulus", [1.0] * 4, 1e-3)
        changed = of(walled, "modulus")[0].make(HALF).system.stiffness
        np.testing.assert_allclose(changed, Model(walled).system.stiffness * [1.0, *[math.exp(0.5)] * 4, 1.0])
        assert of(walled, "modulus")[0].evidence.format(1.5, 0.25) == (
            "Stiffnesses have another modulus in the contacts between bodies (mean factor 1.5 +- 0.25)."
        )
    alone = Scene(
        name="one", duration=1e-4, mass=(1e-2,), stiffness=(), velocity=(0.8,), wall_right=Wall(stiffness=4e9)
    )
    assert patterns(alone) == []


def test_the_radii_of_a_geometry_are_the_first_pattern() -> None:
    scene = parse_scene(SPHERES.format(repeat=2, radius=0.03, material="soft").replace(
        "[chain.striker]\nradius = 0.01", "[chain.striker]\nradius = 0.02"))  # fmt: skip
    radius = np.array([0.02, 0.03, 0.01, 0.03, 0.01])
    yielded = [part for part in patterns(scene) if part[0] != "modulus"]
    # with one modulus in all contacts the stiffness has the pattern of the radii, and is yielded once
    assert len(yielded) == 2
    assert yielded[0][1] == normal((radius[:-1] * radius[1:] / (radius[:-1] + radius[1:])) ** -0.5)
    assert yielded[0][1] == normal(np.array(scene.stiffness) ** -1.0)


@pytest.mark.parametrize("gravity", [0.0, 1.0, -2.0])
@pytest.mark.parametrize("load", [0.0, 0.5])
def test_gravity_may_be_missing_or_that_of_the_earth(gravity: float, load: float) -> None:
    scene = replace(CHAIN, gravity=gravity, precompression=load)
    yielded = of(scene, "gravity")
    # with a load the contacts of the start follow from gravity
    assert len(yielded) == (2 if gravity and load else 1)
    unit = Model(scene).speed / scene.duration
    for each in yielded:
        values = [-gravity, 9.81, -9.81, *([0.0] if gravity else [])]
        assert [unit * p for (p,) in each.starts] == pytest.approx(values)
        assert (settings(each), each.value(0.5)) == ((1e6,), pytest.approx(0.5 * unit))
        assert each.evidence.format(1.5, 0.25).endswith("differs from the scene's by 1.5 +- 0.25 m/s^2.")
    p = np.array([0.5 / unit])
    np.testing.assert_allclose(yielded[0].make(p).system.free, Model(scene).system.free + 0.5, rtol=1e-9)
    np.testing.assert_array_equal(yielded[0].make(p).system.gap, Model(scene).system.gap)
    if len(yielded) > 1:
        right = system_of(replace(scene, gravity=gravity + 0.5))
        np.testing.assert_allclose(yielded[1].make(p).system.gap, right.gap, rtol=1e-9)
        np.testing.assert_allclose(yielded[1].make(p).system.free, right.free, rtol=1e-9)


# ---------------------------------------------------------------- how samples were written
def data_of(
    *, end: float = 1.0, values: tuple[float, ...] = (), interval: float = 0.25, dt: float | None = None,
    quantities: tuple[int, ...] = (0, 1, 2), n_body: int = MOST_BODIES_TO_ORDER + 1,
) -> Any:  # fmt: skip
    """Return data of a scene of 1 s whose exact values are 0.1, -0.2 and one that is absent; ``values``: factors."""
    exact = np.array([0.1, -0.2, np.nan])
    blocks = [
        SimpleNamespace(quantity=quantities[k], values=factor * exact, scale=0.2, columns=range(3))
        for k, factor in enumerate(values)
    ]

    def predict(variant: Variant, rows: int) -> list[Floats]:
        assert rows == 3
        return [100.0 * variant.scale * exact for _ in values]

    return SimpleNamespace(
        model=SimpleNamespace(system="base", scene=SimpleNamespace(n_body=n_body, duration=1.0)), from_first=True,
        time=np.array([0.0, 0.3, end]), interval=interval, dt=dt, blocks=blocks, predict=predict,
        exact=[exact for _ in values],
    )  # fmt: skip


def units_of(data: Any) -> list[Hypothesis]:
    """Return the hypotheses that times or values are in units of a power of ten, which have no parameter."""
    return [each for each in sample_hypotheses(data, data.exact) if each.cause == "units" and not each.size]


def test_times_lags_and_orders_of_samples_are_these() -> None:
    data = data_of(n_body=3)
    new = ("units", "sign", "start-position")
    yielded = [each for each in sample_hypotheses(data, data.exact) if each.cause not in new]
    assert [each.cause for each in yielded] == [
        *("time-shift", "sampling-shift", "sampling-shift", "order-of-bodies", "order-of-bodies")
    ]
    shift = yielded[0]
    assert shift.evidence.format(1.5, 0.25) == "The file is late by 1.5 +- 0.25 s."
    assert shift.starts == ((0.0,), (1.0,), (-1.0,), (3.0,), (-3.0,), (10.0,), (-10.0,))
    assert (settings(shift), shift.value(3.0), shift.make(np.array([3.0])).shift) == ((1e4,), 0.75, 0.75)
    base: Any = "base"
    assert [(each.evidence, each.make(NOTHING)) for each in yielded[1:]] == [
        ("Each sample is that of the previous time.", Variant(base, lag=1)),
        ("Each sample is that of the next time.", Variant(base, lag=-1)),
        ("The bodies are in reversed order.", Variant(base, order=(2, 1, 0))),
        ("The bodies are in reversed order, and the axis is reversed.",
         Variant(base, order=(2, 1, 0), factors=(-1.0, -1.0, 1.0))),
    ]  # fmt: skip
    assert [settings(each) for each in yielded[1:]] == [()] * 4


@pytest.mark.parametrize(
    ("columns", "sign", "asked"),
    [([0, 1, 2], 0.9, 0), ([1, 0, 2], 0.9, 1), ([1, 0, 2], -0.9, 2), ([2, 0, 1], 1.0, 1)],
)
def test_another_order_of_bodies_is_looked_for_where_one_may_leave_less(
    columns: list[int], sign: float, asked: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    searched, search = list[Floats](), samples._best_places

    def search_noted(misfit: Floats) -> Any:
        searched.append(misfit)
        return search(misfit)

    monkeypatch.setattr(samples, "_best_places", search_noted)
    # each body moves at a time of its own
    motion = SimpleNamespace(velocity=np.eye(3), displacement=np.eye(3))
    block = SimpleNamespace(quantity=0, columns=np.arange(3), values=sign * np.eye(3)[:, columns], scale=1.0)
    data: Any = SimpleNamespace(
        model=SimpleNamespace(system="base", scene=SimpleNamespace(n_body=3)), time=np.arange(3.0), blocks=[block],
        motion=lambda *given: (motion, None),
    )  # fmt: skip
    found = [each.make(NOTHING) for each in samples._other_orders(data)]
    factors, base = (math.copysign(1.0, sign), math.copysign(1.0, sign), 1.0), cast(Any, "base")
    assert found == ([Variant(base, order=tuple(columns), factors=factors)] if asked else [])
    assert len(searched) == asked


@pytest.mark.parametrize(
    ("end", "scales"),
    [
        # times after which the scene of 1 s has gone on for a thousandth to three times its duration
        (1.0, [1e-2, 1e-1]),
        (1.5, [1e-3, 1e-2, 1e-1]),
        (0.25, [1e-2, 1e-1, 10.0]),
        (0.295, [1e-2, 1e-1, 10.0]),
        (0.3, [1e-2, 1e-1]),
        (0.45, [1e-2, 1e-1]),
        (0.15, [1e-1, 10.0]),  # of a scene of 2 s
        (1e9, [1e-9]),
        (1e10, [1e-9]),
        (1e-9, [1e6 * 10.0**k for k in (1, 2, 3)]),
        (2e-10, [1e7, 1e8, 1e9]),
    ],
)
def test_times_may_be_in_units_in_which_the_scene_ends_with_the_file(end: float, scales: list[float]) -> None:
    data = data_of(end=end)
    data.model.scene.duration = 2.0 if end == 0.15 else 1.0
    yielded = units_of(data)
    if end == 1e9:
        scales = [1e-9]
    if end == 1e10:
        scales = []
    assert [each.make(NOTHING).scale for each in yielded] == pytest.approx(scales)
    assert [each.evidence for each in yielded] == [
        f"Units: times are {f'{1.0 / scale:.6g} times' if scale < 1.0 else f'1/{scale:.6g} of'} SI." for scale in scales
    ]
    assert min(POWERS_OF_UNITS) == -9


@pytest.mark.parametrize(
    ("factor", "power"),
    [(1e3, 3), (1e-3, -3), (1e3 * 10.0**0.14, 3), (1e3 * 10.0**-0.14, 3), (1e3 * 10.0**0.2, 0), (1.3, 0), (0.0, 0)],
)
def test_values_may_be_in_units_of_a_power_of_ten(factor: float, power: int) -> None:
    for place, name in enumerate(("velocities", "displacements", "forces")):
        factors = tuple(factor if k == place else 1.0 for k in range(3))
        data = data_of(end=5e9, values=factors)
        yielded = units_of(data)
        if not power:
            assert yielded == []
            continue
        (each,) = yielded
        assert each.evidence == f"Units: {name} are {'1000 times' if power > 0 else '1/1000 of'} SI."
        variant = each.make(NOTHING)
        assert (variant.scale, variant.factors[place]) == (1.0, pytest.approx(10.0**power))
        assert variant.factors.count(1.0) == 2
    # in times of another unit values are compared with the motion at those times, here 100 scale times as large
    data = data_of(end=1e9, values=(1e-7, 1e-4), quantities=(0, 2))
    data.exact = [np.zeros(3)] * 2
    (each,) = units_of(data)
    assert each.evidence == "Units: times are 1e+09 times and forces are 1000 times SI."
    assert each.make(NOTHING).factors == pytest.approx((1.0, 1.0, 1e3))


METHODS = [
    ("half-step-velocity", kernels.VERLET, 0.5, "Velocities are those of half a step before the times of the file"),
    ("half-step-velocity", kernels.VERLET, -0.5, "Velocities are those of half a step after the times of the file"),
    ("first-order-integrator", kernels.KICK_EULER, 0.0, "The method is symplectic Euler, velocities first"),
    ("first-order-integrator", kernels.DRIFT_EULER, 0.0, "The method is symplectic Euler, positions first"),
    ("first-order-integrator", kernels.EXPLICIT_EULER, 0.0, "The method is explicit Euler"),
]


def test_methods_of_first_order_have_the_step_of_the_file() -> None:
    yielded = list(half_steps(data_of(dt=1e-3), 1e-2))
    for each, (cause, method, part, words) in zip(yielded, METHODS, strict=True):
        assert (each.cause, each.evidence, each.size) == (cause, f"{words} (dt = 0.001 s).", 0)
        assert settings(each) == ()
        variant = each.make(NOTHING)
        assert (variant.method, variant.dt, variant.late) == (method, 1e-3, part * 1e-3)
    # ten times as many steps as a run may have are too many to be sampled
    assert len(list(half_steps(data_of(end=4e6, dt=1.0), 1e-2))) == 5
    assert len(list(half_steps(data_of(end=4.1e6, dt=1.0), 1e-2))) == 0


@pytest.mark.parametrize(("end", "low"), [(800.0, math.log(0.04)), (4e4, 0.0)])
def test_methods_of_first_order_have_a_step_that_is_fitted(end: float, low: float) -> None:
    yielded = list(half_steps(data_of(end=end, interval=0.25), 0.05))
    start = math.log(0.2)
    for each, (cause, method, part, words) in zip(yielded, METHODS, strict=True):
        assert (each.cause, each.evidence.format(1.5, 0.25)) == (cause, f"{words} (dt = 1.5 s, fitted).")
        assert each.starts == ((pytest.approx(start),), (-1.4,), (-2.3,), (-3.4,), (-4.6,))
        assert (each.bounds, each.probe) == ((pytest.approx(low), 0.0), pytest.approx(start))
        assert (each.logarithmic, each.reach, each.value(-1.0)) == (True, 20.0, pytest.approx(0.25 * math.exp(-1.0)))
        for p, step in ((-1.0, math.exp(-1.0)), (-60.0, math.exp(-50.0)), (60.0, math.exp(50.0))):
            variant = each.make(np.array([p]))
            assert (variant.method, variant.dt) == (method, pytest.approx(0.25 * step, rel=1e-12, abs=0.0))
            assert variant.late == pytest.approx(part * 0.25 * step, rel=1e-12, abs=0.0)


def test_defaults_are_those_of_an_unchanged_motion() -> None:
    system: Any = "base"
    expected = (system, 0.0, 1.0, 0.0, 0, (1.0, 1.0, 1.0), None, (), None, None, None)
    assert tuple(Variant(system)) == expected
    make: Callable[[Floats], Variant] = lambda p: Variant(system)  # noqa: E731
    assert settings(Hypothesis("", make, "")) == ()
    assert Hypothesis("", make, "").value(2.5) == 2.5
