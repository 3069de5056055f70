"""The fast kernel answers what the plain one does, to the last bit; and what is planted in it shows."""

from __future__ import annotations

import inspect
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import dem_bridge as db
from dem_bridge.backends import fused, splitting
from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.blanes_moan import SRKN_6B
from dem_bridge.backends.prescan import prescan_hertz
from dem_bridge.backends.splitting import Method
from dem_bridge.backends.steps import Dense, fixed_step_plan
from dem_bridge.backends.twin import TWIN, VERLET
from dem_bridge.scene.scene import Damping, Scene, Wall
from dem_bridge.trajectory.trajectory import QUANTITIES, Trajectory
from tests.helpers.no_support import NOTHING
from tests.helpers.strategies import examples, scenes

METHODS = {"verlet": VERLET, "srkn_6b": SRKN_6B}


def _run(
    scene: Scene, method: Method, radius: float, *, plain: bool, full: bool = True, dt: float = 5e-7
) -> tuple[Trajectory, Dense]:
    plan = fixed_step_plan(scene, Resolution(dt=dt), Sampling(count=scene.samples), prescan_hertz(scene))
    with pytest.MonkeyPatch.context() as patch:
        if plain:
            patch.setattr(splitting, "FUSED", NOTHING)
        return splitting.solve(TWIN, method, scene, plan, radius=radius, full=full)


def _differences(scene: Scene, method: Method, radius: float, dt: float = 5e-7) -> set[str]:
    """What the fast kernel has otherwise than the plain one."""
    plain, every = _run(scene, method, radius, plain=True, dt=dt)
    found = set()
    for full in (True, False):
        fast, dense = _run(scene, method, radius, plain=False, full=full, dt=dt)
        for name in (*QUANTITIES, "contact_force"):
            if not np.array_equal(getattr(fast, name), getattr(plain, name), equal_nan=True):
                found.add(name)
        if full:
            names = ("velocity", "displacement", "acceleration", "overlap", "force")
            found |= {f"dense {n}" for n in names if not np.array_equal(getattr(dense, n), getattr(every, n))}
    return found


@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
@examples(25)
@given(scene=scenes(bodies=(1, 40), walls=True, gravity=True, samples=7), radius=st.sampled_from([0.0, 2.0**-13]))
def test_both_kernels_agree_to_the_last_bit(method: Method, scene: Scene, radius: float) -> None:
    assert splitting.FUSED.covers(scene)
    assert _differences(scene, method, radius) == set()


def _chain(bodies: int, **changes: Any) -> Scene:
    parts: dict[str, Any] = {
        "duration": 2e-4,
        "mass": tuple(np.linspace(5e-3, 2e-2, bodies).tolist()),
        "stiffness": tuple(np.linspace(8e10, 1e10, bodies - 1).tolist()),
        "velocity": (0.8, *[0.0] * (bodies - 1)),
        "samples": 7,
    }
    return Scene(name="chain", **(parts | changes))


#: more bodies than a block, and than a front passes in the time
CHAIN = _chain(60)
FRONTS = {
    "from the left": CHAIN,
    "from the right": replace(CHAIN, velocity=(*[0.0] * 59, -0.8)),
    "from within": replace(CHAIN, velocity=(*[0.0] * 20, 0.5, *[0.0] * 39)),
    "into a gap": replace(CHAIN, gap=(*[0.0] * 10, 1e-6, *[0.0] * 48)),
    "onto a wall": _chain(18, wall_right=Wall(stiffness=1e10)),
    "precompressed": replace(CHAIN, precompression=10.0),
    "at rest": replace(CHAIN, velocity=(0.0,) * 60),
}


@pytest.mark.parametrize("radius", [0.0, 2.0**-13])
@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
@pytest.mark.parametrize("scene", FRONTS.values(), ids=FRONTS)
def test_what_rests_ahead_of_a_front_may_be_left_out(scene: Scene, method: Method, radius: float) -> None:
    assert _differences(scene, method, radius) == set()


def test_every_turn_is_kept_however_many_there_are() -> None:
    # a ball between walls: a turn for each of 400 collisions, and more room than the kernel begins with is needed
    wall = Wall(stiffness=4e9, gap=1e-6)
    scene = Scene(
        name="ball",
        duration=0.02,
        mass=(1e-2,),
        stiffness=(),
        velocity=(0.5,),
        wall_left=wall,
        wall_right=wall,
        samples=3,
    )
    found, _ = _run(scene, VERLET, 0.0, plain=False)
    assert found.cost.steps == pytest.approx(40_000, rel=1e-3)
    assert _differences(scene, VERLET, 0.0) == set()


#: what is written in the fast kernel -> what is planted
FAULTS = {
    "a front that is one too slow": ("most = min(n_body, front + steps * stages)", "most = front"),
    "the last kick once only": ("twice = stage == 0 and (begun or turn > 0)", "twice = stage == 0 and turn > 0"),
    "the kick of another stage": ("kick, drift = kicks[stage]", "kick, drift = kicks[stage - 1]"),
    "a drift of a whole step": ("dt * drifts[stage]", "dt"),
    "weight forgotten": ("weight[i + 1] + pushed", "pushed"),
    "a force one body on": ("pushed, behind = ahead, here", "behind = here"),
    "tension allowed": ("closed = depth if depth > 0.0 else 0.0", "closed = depth if depth > 0.0 else -1e-3 * depth"),
    "turns of open contacts alone": ("max(was_overlap[k], s[k]) > 0.0", "s[k] > was_overlap[k]"),
}


def _planted(old: str, new: str) -> Any:
    """The fast kernel with a change in its own source, not compiled."""
    source = inspect.getsource(fused.advance.py_func)
    assert old in source, f"the kernel's source has changed: {old!r} is not in it"
    names = dict(vars(fused))
    exec(source.replace(old, new).split("\n", 1)[1], names)
    return names["advance"]


#: all that the faults are about, in few steps: a front that comes to a block's end, weight, turns, many steps to a look
SMALL = _chain(20, duration=6e-5, velocity=(*[0.0] * 13, 0.8, *[0.0] * 6), samples=3)
TRIED = [(SMALL, SRKN_6B, 1e-6), (replace(SMALL, gravity=500.0), SRKN_6B, 1e-6), (SMALL, VERLET, 1e-8)]


@pytest.mark.parametrize(("old", "new"), [("", ""), *FAULTS.values()], ids=["none", *FAULTS])
def test_a_fault_in_the_fast_kernel_parts_it_from_the_plain_one(
    old: str, new: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(splitting, "advance", _planted(old, new))
    found = {part for scene, method, dt in TRIED for part in _differences(scene, method, 0.0, dt=dt)}
    assert bool(found) == (old != new)


# which kernel


def test_only_hertz_without_loss_is_for_the_fast_kernel() -> None:
    power, damped = replace(CHAIN, exponent=2.6), Damping(law="dashpot", coefficient=1.0)
    function = replace(CHAIN, law=lambda overlap: 1e9 * overlap**1.5)
    others = (power, function, replace(CHAIN, damping=damped), replace(CHAIN, drag=1.0))
    assert [splitting.FUSED.covers(scene) for scene in (CHAIN, *others)] == [True, False, False, False, False]


def test_the_fast_kernel_is_what_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: Any) -> None:
        raise AssertionError("the plain kernel was asked")

    monkeypatch.setattr(splitting, "integrate", refused)
    for name in ("verlet", "blanes-moan"):
        db.solve(SMALL, backend=name, dt=1e-6)
    with pytest.raises(AssertionError, match="plain kernel"):
        db.solve(replace(SMALL, exponent=2.6), backend="verlet", dt=1e-6)
    with pytest.raises(AssertionError, match="plain kernel"):
        db.solve(SMALL, backend="verlet", dt=1e-6, tables=True)
