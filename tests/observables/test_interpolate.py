"""Between samples: polynomials that are exact where they must be, and accelerations that are those of the motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import dem_bridge as db
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.observables.conserved import energy, energy_parts
from dem_bridge.observables.interpolate import (
    KNOWN_FORCES,
    acceleration,
    hermite,
    integrals,
    piston_contact,
    require_forces,
    require_known_forces,
    root_between,
    spacing,
    state_at,
    touch_times,
    with_wall,
)
from dem_bridge.scene.drive import Drive
from dem_bridge.scene.features import DRAG, FEATURES, Feature
from dem_bridge.scene.scene import Scene, Wall
from tests.helpers.fake_runs import free_flight
from tests.helpers.strategies import examples
from tests.helpers.waves import travelling_wave

EPS = float(np.finfo(float).eps)


@examples(30)
@given(
    coefficients=st.lists(st.floats(-1.0, 1.0), min_size=12, max_size=12),
    at=st.lists(st.floats(0.0, 1.0), min_size=1, max_size=5),
)
def test_six_samples_carry_a_polynomial_of_degree_eleven(coefficients: list[float], at: list[float]) -> None:
    run = free_flight(samples=5)
    p = np.polynomial.Polynomial(coefficients)
    value, slope = p(run.time)[:, None], p.deriv()(run.time)[:, None]
    when = np.array(at)[:, None]
    # the basis is largest at the ends of the six samples, where its powers cancel to 1e-3 of themselves
    size = 1e4 * EPS * float(np.sum(np.abs(coefficients)) + 1e-300)
    assert hermite(run, value, slope, when) == pytest.approx(p(when), abs=size)
    assert hermite(run, value, slope, when, derivative=1) == pytest.approx(p.deriv()(when), abs=300 * size)


def test_its_error_falls_with_the_twelfth_power_of_the_spacing() -> None:
    errors = []
    for samples in (10, 20):
        run = free_flight(samples=samples)
        phase = 12.0 * run.time[:, None]
        when = (run.time[4] + np.linspace(0.0, 1.0, 11) * run.time[1])[:, None]
        found = hermite(run, np.sin(phase), 12.0 * np.cos(phase), when)
        errors.append(float(np.max(np.abs(found - np.sin(12.0 * when)))))
    # the product of all distances squared, 12.36 h^12 in the middle, over 12!: 2.6e-8 (omega h)^12
    assert 1e-3 * 2.6e-8 * 1.2**12 < errors[0] < 2.6e-8 * 1.2**12
    assert 1e-3 * 2.6e-8 * 0.6**12 < errors[1] < 2.6e-8 * 0.6**12


def test_one_time_per_column_and_times_for_all_are_the_same() -> None:
    scene, run, _ = travelling_wave(bodies=12)
    a = acceleration(scene, run)
    when = np.linspace(0.2, 0.8, scene.n_body) * scene.duration
    each = hermite(run, run.velocity, a, when)
    every = hermite(run, run.velocity, a, when[:, None])
    assert each.tolist() == np.diagonal(every).tolist()
    assert np.isnan(hermite(run, run.velocity, a, np.where(when > when[3], np.nan, when))[4:]).all()


@pytest.mark.parametrize("samples", [1, 2, 3, 4, 5])
def test_few_samples_carry_what_they_can(samples: int) -> None:
    run = free_flight(samples=samples)
    t = run.time
    # a cubic, its slope, and where it is between the samples
    value, slope = (t**3 - t)[:, None], (3.0 * t**2 - 1.0)[:, None]
    when = np.array([[0.3], [0.9]])
    assert hermite(run, value, slope, when) == pytest.approx(when**3 - when, abs=20 * EPS)
    # rounded values over spacings of a fifth, by coefficients of up to some hundred
    assert hermite(run, value, slope, when, derivative=1) == pytest.approx(3.0 * when**2 - 1.0, abs=2000 * EPS)


def test_at_samples_nothing_is_changed() -> None:
    scene, run, _ = travelling_wave(bodies=12)
    found = hermite(run, run.velocity, acceleration(scene, run), run.time[:, None])
    assert found == pytest.approx(run.velocity, abs=100 * EPS * 0.5)


def test_the_acceleration_is_the_slope_of_the_velocity_in_all_that_a_scene_has() -> None:
    scene = Scene(
        name="all",
        duration=2e-4,
        mass=(0.01, 0.02, 0.03),
        stiffness=(1e9, 2e9),
        velocity=(0.5, 0.0, -0.2),
        wall_left=Wall(stiffness=1e9),
        wall_right=Wall(stiffness=3e9),
        gravity=300.0,
        precompression=5.0,
        drag=900.0,
        drive=Drive(shape="sine", force=50.0, frequency=5000.0),
        samples=2000,
    )
    run = db.solve(scene, backend="scipy", uncertainty=False)
    a, h = acceleration(scene, run), run.time[1]
    slope = (run.velocity[2:] - run.velocity[:-2]) / (2.0 * h)
    # (omega h)^2 / 6 with omega h = 2e5 * 1e-7, and first order where a contact opens: (omega h) of a small force
    assert np.max(np.abs(slope - a[1:-1])) < 2e-3 * np.max(np.abs(a))
    for other in (replace(scene, gravity=0.0), replace(scene, drag=0.0), replace(scene, drive=None)):
        wrong = acceleration(other, run)
        assert np.max(np.abs(slope - wrong[1:-1])) > 5e-3 * np.max(np.abs(a))


def test_a_load_in_place_of_a_wall_belongs_to_the_acceleration() -> None:
    scene = Scene(name="pressed", duration=1e-4, mass=(0.01,) * 4, stiffness=(1e9,) * 3, velocity=(0.0,) * 4,
                  precompression=20.0, samples=20)  # fmt: skip
    run = db.solve(scene, backend="reference", uncertainty=False)
    assert np.max(np.abs(acceleration(scene, run))) < 1e-9 * 20.0 / 0.01


def test_the_state_between_samples_is_that_of_the_wave() -> None:
    scene, run, wave = travelling_wave()
    when = run.crossing_time[10:30] + 0.3 / wave.speed
    overlap, v = state_at(scene, run, when)
    place = 10.3 + np.arange(20)[:, None]
    # omega h = 2.2 / 8: 2.6e-8 of that to the 12th is 5e-15; displacements, the sums of 40 overlaps, are rounded
    assert overlap == pytest.approx(wave.overlap(place - np.arange(39)), abs=1e-12 * wave.peak_overlap)
    assert v == pytest.approx(wave.velocity(place - np.arange(40) + 0.5), abs=1e-12 * wave.peak_velocity)


def test_walls_are_bodies_at_rest_in_the_state() -> None:
    scene = Scene(name="walled", duration=1.0, mass=(1.0,) * 3, stiffness=(1.0,) * 2, velocity=(0.0,) * 3,
                  wall_left=Wall(stiffness=1.0, gap=-1.0), wall_right=Wall(stiffness=1.0, gap=1.0))  # fmt: skip
    run = free_flight(contacts=4, samples=10)  # displacements t, 2 t, 3 t
    overlap, _ = state_at(scene, run, np.array([0.55]))
    assert overlap[0] == pytest.approx([0.0, 0.0, 1.0 - 0.55, 3 * 0.55 - 1.0], abs=100 * EPS)


def test_integrals_are_those_of_rates_that_jump_at_breaks() -> None:
    run = free_flight(samples=4)

    def rate(when: np.ndarray, nodes: int) -> np.ndarray:
        # a jump at 0.3, a power that Gauss' rule has, and an error of two samples that integrates to 0.1 t
        return np.hstack([np.where(when > 0.3, 2.0, 1.0), 12.0 * when**11 + 0.1 * (nodes == 2)])

    done, uncertainty = integrals(run, rate, breaks=(-5.0, 0.0, 0.3, 1.0, 7.0))
    t = run.time
    assert done[:, 0] == pytest.approx(t + np.maximum(t - 0.3, 0.0), rel=1e-13)
    assert done[:, 1] == pytest.approx(t**12, rel=1e-12, abs=1e-16)
    assert uncertainty == pytest.approx([0.0, 0.1], rel=1e-12)
    # without the break the jump is within an interval
    assert abs(integrals(run, rate)[0][-1, 0] - 1.7) > 1e-3


@pytest.mark.parametrize(("off", "even"), [(0.9e-9, True), (1.1e-9, False), (-0.9e-9, True), (-1.1e-9, False)])
def test_samples_are_even_within_a_billionth(off: float, even: bool) -> None:
    run = replace(free_flight(), time=np.array([0.0, 1.0, 2.0, 3.0, 4.0 + off]))
    if even:
        assert spacing(run) == 1.0
    else:
        with pytest.raises(UsageError, match="not evenly spaced"):
            spacing(run)


@pytest.mark.parametrize("power", [1, 5], ids=["straight", "flat at the root"])
def test_each_root_is_found_from_either_side(power: int) -> None:
    root = np.array([0.1, 0.7, 0.5])
    sign = np.array([1.0, -1.0, 1.0])
    for low, high in ((np.zeros(3), np.ones(3)), (np.ones(3), np.zeros(3))):
        found = root_between(lambda x: sign * ((x - root) ** power + 1e-3 * (x - root)), low, high)
        assert found == pytest.approx(root, abs=2 * EPS)


def test_where_nothing_changes_its_sign_the_far_end_is_the_root() -> None:
    found = root_between(lambda x: np.array([1.0, -1.0]) + 0.0 * x, np.zeros(2), np.ones(2))
    assert found == pytest.approx([1.0, 1.0], abs=2 * EPS)


def test_uneven_samples_are_refused() -> None:
    run = replace(free_flight(), time=np.array([0.0, 0.1, 0.3, 0.6, 1.0]))
    with pytest.raises(UsageError, match="not evenly spaced"):
        spacing(run)


def test_a_run_without_contact_forces_is_refused_by_the_name_of_its_backend() -> None:
    run = db.solve("decelerating-40", backend="bca")
    with pytest.raises(UsageError, match="width: backend 'bca' gives no contact forces"):
        require_forces(run, "width")


def test_forces_that_observables_do_not_know_are_refused_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    magnet = Feature("a magnet", "A constant force acts on each body.", lambda scene: scene.name == "magnetic")
    for module in ("scene", "support"):
        monkeypatch.setattr(f"dem_bridge.scene.{module}.FEATURES", (*FEATURES, magnet))
    scene = Scene(name="magnetic", duration=1.0, mass=(2.0, 3.0, 5.0), stiffness=(7.0, 11.0), velocity=(1.0, 2.0, 3.0))
    for function in (acceleration, energy_parts, energy):
        with pytest.raises(UnsupportedScene, match="in magnetic cannot be computed: the scene has a magnet;"):
            function(scene, free_flight(contacts=2))


def test_a_force_that_observables_do_not_know_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), drag=1.0)
    require_known_forces(scene, "energies")
    without_drag = replace(KNOWN_FORCES, features=KNOWN_FORCES.features - {DRAG})
    monkeypatch.setattr("dem_bridge.observables.interpolate.KNOWN_FORCES", without_drag)
    with pytest.raises(UnsupportedScene, match=r"energies in pair cannot be computed: .*drag"):
        require_known_forces(scene, "energies")


def test_walls_are_at_rest_beside_the_bodies() -> None:
    motion = np.arange(6.0).reshape(3, 2) + 1.0
    assert with_wall(motion).tolist() == [[1.0, 2.0, 0.0], [3.0, 4.0, 0.0], [5.0, 6.0, 0.0]]


def test_a_piston_and_the_body_before_it_part_as_their_velocities_say() -> None:
    # the piston moves at 0.3 m/s and body 1, which rests, is 1 um away: they touch after 1/0.3 us
    scene = Scene(
        name="pushed", duration=3e-6, mass=(1e-2, 1e-2), stiffness=(4e9,), velocity=(0.3, 0.0), gap=1e-6,
        drive=db.Piston(shape="constant", velocity=0.3), samples=12,
    )  # fmt: skip
    run = db.solve(scene, backend="reference")
    overlap, closing = piston_contact(scene, run, np.array([[1e-6], [2.5e-6]]))
    # round-off of displacements of 1 um
    assert overlap[:, 0] == pytest.approx([-0.7e-6, -0.25e-6], abs=1e-20)
    assert closing[:, 0] == pytest.approx([0.3, 0.3], rel=1e-14)


def test_times_of_touch_are_found_between_samples_and_approached() -> None:
    # two bodies meet after 2 us at 0.5 m/s and part at the end of the contact; samples are 10 us apart
    scene = Scene(
        name="meet", duration=2e-4, mass=(1e-2, 1e-2), stiffness=(4e9,), velocity=(0.5, 0.0), gap=1e-6, samples=20
    )
    run = db.solve(scene, backend="reference")
    overlap = run.displacement[:, :1] - run.displacement[:, 1:] - 1e-6
    times = touch_times(run, overlap, run.velocity[:, :1] - run.velocity[:, 1:])
    assert not touch_times(run, -np.abs(overlap), 0.0 * overlap).size
    # the cubic between samples is exact in free flight and differs by the contact within its interval
    assert np.min(np.abs(times - 2e-6)) < 0.5e-6
    assert len(times) == 2 * (1 + 2 * 12)
