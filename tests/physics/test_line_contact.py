"""Line contact against the strains along the line of force, its own derivatives, and backends that run it."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

import dem_bridge as db
from dem_bridge.physics.contact_law import check_law, law_of
from dem_bridge.physics.hertz import crossed_cylinders
from dem_bridge.physics.line_contact import LineContact, cylinder_on_plane, parallel_cylinders
from dem_bridge.scene.scene import Scene
from tests.helpers.strategies import log_uniform

QUARTZ: dict[str, Any] = {"radius": 9e-3, "young": 72e9, "poisson": 0.17}
LINE = parallel_cylinders(length=18e-3, **QUARTZ)
EPS = float(np.finfo(float).eps)

#: parts of the reach, up to where a strip is a tenth as wide as a body and beyond
parts = log_uniform(1e-12, 0.9)


@st.composite
def lines(draw: st.DrawFn) -> LineContact:
    body = {"radius": draw(log_uniform(1e-4, 1.0)), "young": draw(log_uniform(1e6, 1e12))}
    other = {"radius2": draw(log_uniform(1e-4, 1.0)), "young2": draw(log_uniform(1e6, 1e12)), "poisson2": 0.3}
    length = draw(log_uniform(1e-3, 1.0))
    return parallel_cylinders(length=length, poisson=draw(st.floats(0.0, 0.5)), **body, **other)


def compression(half_width: float, *, per_length: float, depth: float, young: float, poisson: float) -> float:
    """Of a half-space from its surface to ``depth`` under a strip of Hertz pressure, by integrating the strain (m).

    Stresses on the axis of the strip, of Flamant's half-space (Johnson 1985, section 4.2).
    """
    pressure = 2.0 * per_length / (math.pi * half_width)

    def strain(z: float) -> float:
        root = math.hypot(half_width, z)
        across = -pressure * ((half_width**2 + 2.0 * z**2) / root - 2.0 * z) / half_width
        along = -pressure * half_width / root
        return -((1.0 - poisson**2) / young) * (along - poisson / (1.0 - poisson) * across)

    ends = [0.0, *(half_width * 10.0**k for k in range(5)), depth]
    edges = [end for end in ends if end <= depth]
    return float(sum(quad(strain, low, high, epsrel=1e-11)[0] for low, high in pairwise(edges)))


def diametral(half_width: float, *, per_length: float, radius: float, young: float, poisson: float) -> float:
    """Of a cylinder from its axis to one of two opposite lines, by integrating the strain (m).

    The strip's stresses, the pull of the other line and the uniform tension that frees the rim (Johnson 1985, 5.6).
    """
    near = compression(half_width, per_length=per_length, depth=radius, young=young, poisson=poisson)
    rim = per_length / (math.pi * radius)  # P/(pi r) along and across
    far = -2.0 * per_length / math.pi * math.log(2.0)  # int_0^r dz/(2 r - z)
    plane = (1.0 - poisson**2) / young
    return near - plane * (rim * radius + far) + plane * poisson / (1.0 - poisson) * rim * radius


def test_two_cylinders_are_compressed_by_what_the_strains_add_up_to() -> None:
    force = 236.0
    half_width = LINE.half_width(force)
    found = 2.0 * diametral(half_width, per_length=force / 18e-3, **QUARTZ)
    # the formula is that for h << r: it leaves out parts of (h/r)^2, 2.5e-5 here, of a bracket of 12
    assert half_width / 9e-3 == pytest.approx(5.0e-3, abs=1e-5)
    assert float(LINE.overlap(force)) == pytest.approx(found, rel=5e-6)


def test_a_plane_is_compressed_by_what_the_strains_add_up_to() -> None:
    force, depth = 236.0, 0.05
    line = cylinder_on_plane(length=18e-3, depth=depth, young2=200e9, poisson2=0.3, **QUARTZ)
    half_width, per_length = line.half_width(force), force / 18e-3
    found = diametral(half_width, per_length=per_length, **QUARTZ)
    found += compression(half_width, per_length=per_length, depth=depth, young=200e9, poisson=0.3)
    assert float(line.overlap(force)) == pytest.approx(found, rel=5e-6)


def test_a_rigid_plane_does_not_care_for_the_depth_and_takes_half_of_two_cylinders() -> None:
    on = [cylinder_on_plane(length=18e-3, depth=depth, young2=math.inf, **QUARTZ) for depth in (1e-2, 1e2)]
    assert on[0] == on[1]
    # 1/R halves and E* doubles: the same strip; each of the two cylinders is compressed as this one
    assert on[0].half_width(236.0) == pytest.approx(LINE.half_width(236.0), rel=8.0 * EPS)
    assert float(on[0].overlap(236.0)) == pytest.approx(0.5 * float(LINE.overlap(236.0)), rel=16.0 * EPS)


def test_the_strip_is_that_of_hertz() -> None:
    force, modulus = 236.0, 72e9 / (2.0 * (1.0 - 0.17**2))
    assert LINE.half_width(force) ** 2 == pytest.approx(
        4.0 * force / 18e-3 * 4.5e-3 / (math.pi * modulus), rel=16.0 * EPS
    )
    # a half-ellipse of that height and width carries the force
    carried = 0.5 * math.pi * LINE.peak_pressure(force) * LINE.half_width(force) * 18e-3
    assert carried == pytest.approx(force, rel=8.0 * EPS)


@given(line=lines(), part=parts)
def test_force_and_overlap_are_inverse(line: LineContact, part: float) -> None:
    overlap = part * line.reach
    # at 0.9 of the reach the slope d ln F/d ln overlap is 2.8 and L, of which W loses some ulps near its branch, 1.6
    assert float(line.overlap(line.force(overlap))) == pytest.approx(overlap, rel=40.0 * EPS)


@given(line=lines(), part=parts)
def test_energy_and_exponent_are_those_of_the_force(line: LineContact, part: float) -> None:
    overlap = part * line.reach
    law = law_of(line.force, reach=overlap)
    # law_of is good to 1e-13 for powers; here a logarithm goes with the power
    assert float(line.energy(overlap)) == pytest.approx(float(law.energy(np.array(overlap))), rel=1e-9)
    step = 1e-4
    ends = np.log(line.force(overlap * np.array([1.0 - step, 1.0 + step])))
    steep = float(ends[1] - ends[0]) / (math.log1p(step) - math.log1p(-step))
    # error of a central difference: step^2 times a third derivative that grows as (1 - part)^-2.5 towards the end
    assert float(line.exponent(overlap)) == pytest.approx(1.0 + steep, rel=1e-5)


def test_the_exponent_is_a_little_above_2_and_never_that_of_a_point() -> None:
    exponents = LINE.exponent(LINE.overlap(np.array([1e-6, 1.0, 236.0, 1e4])))
    assert np.all(np.diff(exponents) > 0.0)
    assert exponents.min() > 2.0
    assert exponents.max() < 2.2


def test_at_touch_nothing_is_there_and_beyond_the_reach_no_number() -> None:
    ends = np.array([0.0, 0.999, 1.001, 2.0]) * LINE.reach
    for function in (LINE.force, LINE.energy):
        found = function(ends)
        assert found[0] == 0.0
        assert np.isnan(found).tolist() == [False, False, True, True]
    assert LINE.exponent(0.0) == 2.0
    assert LINE.overlap(0.0) == 0.0
    assert np.isnan(LINE.overlap(np.array([-1.0, 0.5 * LINE.force_scale]))).all()


def test_it_is_a_law_as_scenes_check_them_and_a_wrong_energy_is_none() -> None:
    check_law(LINE.law(), 0.5 * LINE.reach)
    wrong = replace(LINE.law(), energy=lambda overlap: 1.001 * LINE.energy(overlap))
    with pytest.raises(ValueError, match="has an energy of"):
        check_law(wrong, 0.5 * LINE.reach)


def test_a_chain_of_parallel_cylinders_runs_and_keeps_its_energy() -> None:
    chain = Scene(
        name="parallel",
        duration=2e-4,
        mass=(10.08e-3,) * 4,
        stiffness=(1e9,) * 3,
        exponent=(2.5,) * 3,
        gap=(0.0,) * 3,
        velocity=(0.8, 0.0, 0.0, 0.0),
        law=LINE.law(),
        samples=20,
    )
    truth = db.solve(chain, backend="scipy")
    kinetic = 0.5 * 10.08e-3 * np.sum(truth.velocity**2, axis=1)
    x = truth.displacement
    stored = np.sum(LINE.energy(np.maximum(x[:, :-1] - x[:, 1:], 0.0)), axis=1)
    assert kinetic + stored == pytest.approx(0.5 * 10.08e-3 * 0.8**2, rel=1e-9)
    # the first collision is one of two bodies but for what the third takes: force times overlap is about twice energy
    assert 700.0 < truth.peak_force[0] < 900.0


def test_a_hertz_contact_at_a_vanishing_angle_outgrows_every_body_before_it_is_a_line() -> None:
    # at equal force the line is stiffer where the ellipse is longer than the cylinder, and softer where it is shorter
    force = 236.0
    ellipses = [crossed_cylinders(angle=angle, **QUARTZ) for angle in (20.0, 0.1)]
    short, long = (ellipse.semi_axes(force)[0] for ellipse in ellipses)
    assert short < 9e-3 < long
    assert ellipses[1].overlap(force) < float(LINE.overlap(force)) < ellipses[0].overlap(force)


def test_wrong_numbers_are_named() -> None:
    with pytest.raises(ValueError, match="length = 0"):
        parallel_cylinders(length=0.0, **QUARTZ)
    with pytest.raises(ValueError, match="radius2 = -1"):
        parallel_cylinders(length=1.0, radius2=-1.0, **QUARTZ)
    with pytest.raises(ValueError, match="depth = inf"):
        cylinder_on_plane(length=1.0, depth=math.inf, **QUARTZ)
    with pytest.raises(ValueError, match="at least one deformable body"):
        parallel_cylinders(radius=1.0, length=1.0, young=math.inf, poisson=0.3)
    with pytest.raises(ValueError, match="poisson2 = 1"):
        cylinder_on_plane(length=1.0, depth=1.0, poisson2=1.0, **QUARTZ)
