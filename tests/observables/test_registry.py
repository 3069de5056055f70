"""Every registered observable agrees with a second definition written here, and its uncertainty covers its error."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.formats.units import UNITS
from dem_bridge.observables.differences import read, relative_to
from dem_bridge.observables.observable import AXES, Observable, of_run
from dem_bridge.observables.registry import OBSERVABLES, observable_named, register
from dem_bridge.scene.drive import Drive
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.trajectory.trajectory import VOCABULARY, Trajectory
from tests.conftest import Solve
from tests.helpers.export_chains import CROSSED, RAW
from tests.helpers.fake_runs import free_flight, uncertain

Floats = NDArray[np.float64]
#: samples so close (1e-7 s, a hundredth of a collision) that differences and sums stand for slopes and integrals
FINE = replace(CROSSED, name="fine", samples=2000)
DRIVEN = replace(FINE, name="fine-driven", velocity=(0.0,) * 4, drive=Drive(shape="sine", force=300.0, frequency=5e3))


def _slope(values: Floats, time: Floats) -> Floats:
    return np.gradient(values, time, axis=0, edge_order=2)


def _integral(values: Floats, time: Floats) -> Floats:
    """Cumulative integral by the trapezoidal rule, 0 at the start."""
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(time).reshape(-1, *[1] * (values.ndim - 1))
    return np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(steps, axis=0)])


def _overlaps(scene: Scene, run: Trajectory) -> Floats:
    """Overlap of the contacts of a chain without walls and gaps, body by body."""
    x = run.displacement
    return np.stack([np.maximum(x[:, k] - x[:, k + 1], 0.0) for k in range(scene.n_body - 1)], axis=1)


def _hertz(scene: Scene, run: Trajectory) -> Floats:
    return np.array(scene.stiffness) * _overlaps(scene, run) ** 1.5


def _handed_on(run: Trajectory) -> Floats:
    """When body k + 1 becomes faster than body k for the first time after it was hit, by a straight line."""
    times = []
    for k in range(run.velocity.shape[1] - 1):
        closing = run.velocity[:, k] - run.velocity[:, k + 1]
        rows = np.flatnonzero((closing[:-1] > 1e-4) & (closing[1:] <= 0.0))
        row = int(rows[0])
        share = closing[row] / (closing[row] - closing[row + 1])
        times.append(run.time[row] + share * (run.time[row + 1] - run.time[row]))
    return np.array(times)


def _stay(run: Trajectory) -> Floats:
    return np.array([np.nan, *np.diff(_handed_on(run)), np.nan])


def _until_handed_on(run: Trajectory) -> Floats:
    """Velocities while each body has not handed the impulse on, -inf later."""
    end = np.append(_handed_on(run), run.time[-1])
    return np.where(run.time[:, None] <= end, run.velocity, -np.inf)


def _energy(scene: Scene, run: Trajectory) -> Floats:
    total = np.zeros(len(run.time))
    for body, mass in enumerate(scene.mass):
        total += 0.5 * mass * run.velocity[:, body] ** 2
    for k, beta in enumerate(scene.stiffness):
        total += beta * _overlaps(scene, run)[:, k] ** 2.5 / 2.5
    return total


def _first_force(scene: Scene, run: Trajectory) -> Floats:
    rows = np.searchsorted(run.time, _handed_on(run))
    force = _hertz(scene, run)
    return np.array([np.max(force[row - 1 : row + 1, k]) for k, row in enumerate(rows)])


#: name -> the same quantity by samples alone, and how far it may be off relative to the scale: with the spacing h
#: between samples and the frequency omega of a collision, (omega h)^2/12 = 1e-5 for slopes and integrals, (omega h)^2/8
#: for largest samples; a time is off by less than h, 1e-7 s of 3e-5 s, and by lines through two samples by far less
SECOND: dict[str, tuple[Callable[[Scene, Trajectory], Floats], float]] = {
    "velocity": (lambda scene, run: _slope(run.displacement, run.time), 3e-4),
    "displacement": (lambda scene, run: _integral(run.velocity, run.time), 3e-5),
    "contact_force": (_hertz, 1e-9),
    "peak_force": (lambda scene, run: np.max(run.contact_force, axis=0), 1e-4),
    "first_peak_force": (_first_force, 1e-4),
    "crossing_time": (lambda scene, run: _handed_on(run), 1e-4),
    "arrival": (lambda scene, run: np.append(np.nan, _handed_on(run)), 1e-4),
    "arrival_at_end": (lambda scene, run: _handed_on(run)[-1], 1e-4),
    "residence_time": (lambda scene, run: _stay(run), 1e-3),
    "front_speed": (lambda scene, run: 1.0 / _stay(run), 1e-3),
    "wave_speed": (lambda scene, run: 18e-3 / _stay(run), 1e-3),
    "peak_velocity": (lambda scene, run: np.max(_until_handed_on(run), axis=0), 1e-4),
    "peak_velocity_time": (lambda scene, run: run.time[np.argmax(_until_handed_on(run), axis=0)], 2e-2),
    # no force from outside
    "momentum": (lambda scene, run: np.full(len(run.time), scene.mass[0] * scene.velocity[0]), 1e-12),
    "energy": (_energy, 1e-12),
    "energy_less_work": (lambda scene, run: np.full(len(run.time), _energy(scene, run)[0]), 1e-5),
}


#: the modules of this folder that have second definitions: this one, and those of observables that came later
for _file in sorted(Path(__file__).parent.glob("test_*.py")):
    if _file != Path(__file__) and "\nSECOND = {" in _file.read_text(encoding="utf-8"):
        SECOND |= importlib.import_module(f"{__package__}.{_file.stem}").SECOND


@pytest.fixture(params=list(OBSERVABLES))
def observable(request: pytest.FixtureRequest) -> Observable:
    return OBSERVABLES[request.param]


def test_every_observable_has_a_second_definition() -> None:
    assert set(SECOND) == set(OBSERVABLES)


def test_an_observable_is_that_of_its_second_definition(observable: Observable, solved: Solve) -> None:
    scene = DRIVEN if observable.name == "energy_less_work" else FINE
    run = solved(scene, "reference")
    second, tolerance = SECOND[observable.name]
    found = read(observable, scene, run)
    expected = second(scene, run)
    np.testing.assert_array_equal(np.isnan(found.values), np.isnan(expected))
    apart = np.abs(found.values - expected) / np.where(found.scale > 0.0, found.scale, 1.0)
    assert np.nanmax(apart) <= tolerance
    assert np.nanmax(np.abs(found.values)) > 0.0


@pytest.mark.parametrize("scene", [CROSSED, RAW, DRIVEN], ids=lambda scene: scene.name)
def test_the_uncertainties_of_two_runs_cover_their_difference(
    observable: Observable, scene: Scene, solved: Solve
) -> None:
    reference, coarse = solved(scene, "reference"), solved(scene, "verlet", dt=1e-7)
    found = relative_to(read(observable, scene, reference), read(observable, scene, coarse))
    there = ~np.isnan(found.values)
    assert np.all((np.abs(found.values) <= found.uncertainty + found.reference_uncertainty)[there])
    if observable.name not in ("momentum", "wave_speed"):
        assert np.max(np.abs(found.values[there])) > 0.0  # the coarse run errs, or nothing was tested


def test_values_and_uncertainties_have_the_shape_of_the_axes(observable: Observable, solved: Solve) -> None:
    sizes = {"time": RAW.samples + 1, "body": RAW.n_body, "contact": RAW.n_contact}
    assert RAW.wall_left is not None  # the contacts of walls count too
    run = solved(RAW, "verlet", dt=1e-7)
    for part in (observable.value, observable.uncertainty):
        assert np.shape(part(RAW, run)) == tuple(sizes[axis] for axis in observable.axis)
    assert set(observable.axis) <= set(AXES)


def test_a_chain_of_one_body_has_all_observables_and_nothing_to_say_of_a_front(solved: Solve) -> None:
    scene = Scene(name="lonely", duration=1e-4, mass=(0.01,), stiffness=(), velocity=(0.5,), samples=3)
    run = solved(scene, "verlet", dt=1e-5)
    for name, observable in OBSERVABLES.items():
        values = np.asarray(observable.value(scene, run))
        along = name in ("arrival", "arrival_at_end", "residence_time", "front_speed", "wave_speed")
        assert np.all(np.isnan(values)) == (along or values.size == 0), name


def test_an_observable_says_what_it_is_in_a_unit_that_tables_know(observable: Observable) -> None:
    assert observable.definition.endswith(".")
    assert observable.definition[0].isupper()
    assert observable.unit in UNITS
    assert "{" not in observable.scale_name
    if observable.name in VOCABULARY:
        unit, _, axis = VOCABULARY[observable.name]
        assert (observable.unit, observable.axis) == (unit, axis)


def test_scales_of_what_is_conserved_are_sums_by_hand() -> None:
    # springs of 10 N/m, 4 m too long, and gravity; bodies of 2, 3 and 5 kg at -1, 2 and 3 m/s
    scene = Scene(name="springs", duration=1.0, mass=(2.0, 3.0, 5.0), stiffness=(10.0, 10.0), exponent=2.0,
                  velocity=(1.0, 2.0, 3.0), gap=-4.0, gravity=4.0)  # fmt: skip
    run = free_flight(samples=1, velocity=np.array([[-1.0, 2.0, 3.0], [-1.0, 2.0, -4.0]]))

    def scale(name: str, **changes: float) -> float:
        return float(np.max(read(name, replace(scene, **changes), run).scale))  # type: ignore[arg-type]

    assert scale("velocity") == 4.0
    assert scale("momentum") == (2.0 + 3.0 + 5.0) * 4.0
    # kinetic 1 + 6 + 40, stored 5 (3^2 + 3^2), height -4 (2 + 6 + 15) after 1 s
    assert scale("energy") == pytest.approx(47.0 + 90.0 + 92.0, rel=1e-14)
    assert scale("energy", gravity=-4.0) == pytest.approx(47.0 + 90.0 + 92.0, rel=1e-14)
    assert scale("energy_less_work") == pytest.approx(47.0, rel=1e-14)


def test_uncertainties_of_what_is_conserved_are_sums_by_hand() -> None:
    # as above, with a wall 0.5 m away on a spring of 7 N/m
    scene = Scene(name="springs", duration=1.0, mass=(2.0, 3.0), stiffness=(10.0,), exponent=2.0, velocity=(1.0, 2.0),
                  gap=-4.0, gravity=-2.0, wall_right=Wall(stiffness=7.0, gap=0.5, exponent=2.0))  # fmt: skip
    run = free_flight(bodies=2, contacts=2, samples=1, uncertainty=uncertain(velocity=0.1, displacement=0.01))
    parts = OBSERVABLES["momentum"].uncertainty(scene, run), OBSERVABLES["energy"].uncertainty(scene, run)
    assert parts[0] == pytest.approx([0.5, 0.5], rel=1e-14)
    # m |v| of both bodies; forces of 40 and 0 N, then 30 and 10.5 N, of which a wall's acts on one body, and weights
    moving = 0.1 * (2.0 + 6.0)
    assert parts[1] == pytest.approx([moving + 0.01 * (80.0 + 10.0), moving + 0.01 * (60.0 + 10.5 + 10.0)], rel=1e-14)
    for lost in (uncertain(velocity=np.inf), uncertain(displacement=np.inf)):
        unknown = replace(run, uncertainty=lost)
        assert np.isinf(OBSERVABLES["energy"].uncertainty(scene, unknown)).all()


def test_a_wave_speed_is_uncertain_by_the_spacing_times_that_of_its_front() -> None:
    scene = Scene(
        name="three", duration=1.0, mass=(1.0,) * 3, stiffness=(1.0,) * 2, velocity=(1.0, 0.0, 0.0), spacing=0.5
    )
    run = free_flight(crossing_time=[1.0, 3.0], uncertainty=uncertain(crossing_time=[0.1, 0.3]))
    # 2 s less 0.4 s
    assert OBSERVABLES["wave_speed"].uncertainty(scene, run)[1] == pytest.approx(0.5 * (1 / 1.6 - 1 / 2), rel=1e-12)
    assert OBSERVABLES["wave_speed"].value(scene, run)[1] == 0.25


def test_a_name_is_registered_once_and_an_unknown_one_is_refused_with_those_that_are_allowed() -> None:
    with pytest.raises(UsageError, match=r"^observable = 'velocity' is registered already; allowed: another name$"):
        register(OBSERVABLES["velocity"])
    with pytest.raises(UsageError, match=r"^observable = 'speed'; allowed: velocity, .*energy_less_work$"):
        observable_named("speed")


def test_the_observables_of_the_package_stand_first_in_the_order_of_tables() -> None:
    assert list(OBSERVABLES)[:16] == [
        "velocity", "displacement", "contact_force", "arrival", "arrival_at_end", "residence_time", "front_speed",
        "wave_speed", "peak_velocity", "peak_velocity_time", "peak_force", "first_peak_force", "crossing_time",
        "momentum", "energy", "energy_less_work",
    ]  # fmt: skip
    # what follows from another observable is judged by that one, and so names one that follows from none
    of = {item.follows for item in OBSERVABLES.values()} - {""}
    assert of == {"velocity", "displacement", "residence_time", "peak_force", "crossing_time"}
    assert all(not OBSERVABLES[name].follows for name in of)


@pytest.mark.parametrize(("name", "axis"), [("two words", ("time",)), ("late", ("body", "time")), ("far", ("place",))])
def test_a_name_or_an_axis_that_is_none_is_refused(name: str, axis: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match=f"observable '{name}'"):
        replace(OBSERVABLES["velocity"], name=name, axis=axis)


def test_what_a_run_alone_has_is_measured_without_its_scene() -> None:
    run = free_flight()

    def value(scene: None, given: Trajectory) -> Floats:
        assert scene is None
        return 2.0 * given.time

    measured = of_run(value, lambda scene, given: 3.0 * given.time)(CROSSED, run)
    assert np.array_equal(measured.values, 2.0 * run.time)
    assert np.array_equal(measured.uncertainty, 3.0 * run.time)
