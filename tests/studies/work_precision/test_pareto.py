"""The Pareto front: nothing on it is beaten, everything else is."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from dem_bridge.backends.base import Sampling
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.work_precision.curves import Curve
from dem_bridge.studies.work_precision.figures import front
from dem_bridge.studies.work_precision.runs import Measured, Point
from dem_bridge.studies.work_precision.study import least

# few values, so that costs and errors are often equal
points = st.lists(
    st.tuples(
        st.sampled_from([0.0, 1.0, 2.0, 3.0, math.nan, math.inf]), st.sampled_from([0.1, 0.2, 0.3, math.nan, math.inf])
    )
)


def _beats(one: tuple[float, float], other: tuple[float, float]) -> bool:
    return one[0] <= other[0] and one[1] <= other[1] and one != other


@given(points)
def test_nothing_on_the_front_is_beaten_and_all_else_is(found: list[tuple[float, float]]) -> None:
    real = [one for one in found if all(map(math.isfinite, one))]
    best = [found[at] for at in front([one[0] for one in found], [one[1] for one in found])]
    assert len(set(best)) == len(best)
    assert best == sorted(best)
    assert not any(_beats(other, one) for one in best for other in real)
    assert all(one in best or any(_beats(other, one) for other in best) for one in real)


@given(points, st.sampled_from([0.05, 0.1, 0.25, 1.0]))
def test_the_cheapest_is_good_enough_and_nothing_cheaper_is(found: list[tuple[float, float]], target: float) -> None:
    curve, key = Curve(name="verlet", backend="verlet"), ("velocity", "max")
    settings = [Point(curve=curve, value=0.0, cpu_min=cost, errors={key: error}) for cost, error in found]
    scene = Scene(name="two", duration=1e-4, mass=(0.01, 0.01), stiffness=(4e9,), velocity=(1.0, 0.0))
    measured = Measured(scene=scene, sampling=Sampling(count=1), limit=1.0, points=(), uncertainty={key: 0.0})
    best = least(measured, settings, target)
    enough = [one for one in found if one[1] <= target and math.isfinite(one[0])]
    if best is None:
        assert not enough
    else:
        assert (best.cpu_min, best.errors[key]) in enough
        assert best.cpu_min == min(one[0] for one in enough)
