"""The adiabatic wave as a backend: the paper's chains and tapered ones beside the reference, and what it refuses."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import dem_bridge as db
from dem_bridge.backends.adiabatic import AdiabaticWaves
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.observables.conserved import momentum
from dem_bridge.observables.front import residence_time
from dem_bridge.physics import adiabatic
from dem_bridge.physics.adiabatic import adiabatic_wave, launched
from dem_bridge.physics.solitary import solitary_wave
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.trajectory.trajectory import Trajectory
from tests.conftest import Solve

EPS = float(np.finfo(float).eps)
Floats = NDArray[np.float64]

CHAIN = Scene(
    name="chain",
    duration=2e-4,
    mass=(8e-3, 1e-2, 2e-2),
    stiffness=(4e9, 5e9),
    velocity=(0.8, 0.0, 0.0),
    samples=400,
)
#: the paper's section 4b: 200 cylinders, from 2 to 90 degrees and back, with a striker like them
CYLINDER = 2200.0 * math.pi * 0.009**2 * 0.018
STIFFNESS = np.linspace(7.27299328384e10, 4.689197642511e9, 199)


def _struck(name: str, mass: Floats, stiffness: Floats, velocity: float, duration: float, samples: int) -> Scene:
    return Scene(
        name=name,
        duration=duration,
        mass=tuple(mass.tolist()),
        stiffness=tuple(stiffness.tolist()),
        velocity=(velocity, *[0.0] * (len(mass) - 1)),
        samples=samples,
    )


def _long(name: str, stiffness: Floats) -> Scene:
    beta = np.concatenate([stiffness[:1], stiffness])
    # 24 samples in the shortest transit, of 7 us
    return _struck(name, np.full(201, CYLINDER), beta, 0.8, 2.7e-3, 9000)


def _spheres(name: str, ratio: float) -> Scene:
    """Radii fall or grow by ``ratio`` a grain, the larger end is 1; m as R^3, beta as the root of R R' / (R + R')."""
    radius = ratio ** np.arange(41.0)
    radius /= np.max(radius)
    effective = radius[1:] * radius[:-1] / (radius[1:] + radius[:-1])
    return _struck(name, radius**3, np.sqrt(effective / np.max(effective)), 1.0, 60.0, 6000)


SOFTENING, STIFFENING = _long("softening", STIFFNESS), _long("stiffening", STIFFNESS[::-1])
FORWARD, BACKWARD = _spheres("forward", 0.98), _spheres("backward", 1.0 / 0.98)
#: bodies from which a pulse of equal bodies has formed to 1e-4, up to those that feel the end
FIRST, BEFORE_END = 10, 8


def _fastest(run: Trajectory) -> Floats:
    """Peak velocity of each body's first pulse, ``(n_body - 2,)``, by a parabola through the samples about it."""
    if run.provenance["backend"] == "bca":  # steps
        return np.asarray(np.max(run.velocity, axis=0)[1:-1])
    found = []
    for i, (since, until) in enumerate(zip(run.crossing_time[:-1], run.crossing_time[1:], strict=True), start=1):
        inside = np.flatnonzero((run.time >= since) & (run.time <= until))
        j = int(inside[np.argmax(run.velocity[inside, i])])
        before, there, behind = run.velocity[j - 1 : j + 2, i]
        found.append(there - (before - behind) ** 2 / 8.0 / (before - 2.0 * there + behind))
    return np.array(found)


@lru_cache
def _run(scene: Scene, backend: str) -> Trajectory:
    return db.solve(scene, backend=backend, uncertainty=False)


@lru_cache
def _off(scene: Scene, backend: str) -> dict[str, Floats]:
    """Share off the reference, from FIRST to the last but BEFORE_END: residence time, peak velocity, peak force."""
    run, truth = _run(scene, backend), _run(scene, "reference")
    pairs = {
        "residence": (residence_time(scene, run)[1:-1], residence_time(scene, truth)[1:-1]),
        "velocity": (_fastest(run), _fastest(truth)),
        "force": (run.peak_force, truth.peak_force),
    }
    return {name: np.abs(a / b - 1.0)[FIRST:-BEFORE_END] for name, (a, b) in pairs.items()}


@pytest.mark.parametrize("scene", [SOFTENING, STIFFENING, FORWARD, BACKWARD], ids=lambda scene: scene.name)
def test_on_long_graded_chains_it_is_good_to_the_square_of_the_gradient(scene: Scene) -> None:
    mass, beta = np.log(scene.mass[1:]), np.log(scene.stiffness[1:])
    gradient = max(float(np.max(np.abs(np.diff(one)[:-BEFORE_END]))) for one in (mass, beta))
    assert 0.04 < gradient < 0.08
    found, collisions = _off(scene, "adiabatic"), _off(scene, "bca")
    for name, off in found.items():
        # first order is in the theory; in exponential chains the second has a factor of 0.9, the launch adds its own
        assert np.max(off) < 2.0 * gradient**2, name
        assert np.median(off) < np.median(collisions[name]) / 20.0, name


@pytest.mark.parametrize("name", ["decelerating-40", "accelerating-40"])
def test_on_the_papers_chains_all_three_are_closer_than_binary_collisions(name: str) -> None:
    scene = replace(db.load_scene(name), samples=6000)
    found, collisions = _off(scene, "adiabatic"), _off(scene, "bca")
    # the chain changes by 3 to 30 % a body and the front of the softer one is still forming: no order to derive from;
    # measured 0.3 %, 1.2 % and 1.8 % where binary collisions are off by 2.8 %, 54 % and 28 % or more
    assert np.max(found["residence"]) < 0.005
    assert np.max(found["velocity"]) < 0.02
    assert np.max(found["force"]) < 0.03
    assert min(np.max(collisions[which]) for which in ("velocity", "force")) > 0.25
    assert np.max(collisions["residence"]) > 0.025


def _exponent(scene: Scene, force: Floats, window: slice) -> float:
    return float(np.polyfit(np.log(scene.stiffness[window]), np.log(force[window]), 1)[0])


@pytest.mark.parametrize(("scene", "sign"), [(SOFTENING, -1.0), (STIFFENING, 1.0)], ids=["softening", "stiffening"])
def test_it_gives_the_exponent_of_force_that_is_not_two_fifths(scene: Scene, sign: float) -> None:
    beta, striker = np.array(scene.stiffness), 0.5 * CYLINDER * 0.8**2
    plain = adiabatic_wave(mass=scene.mass, stiffness=beta, exponent=2.5, energy=striker, order=0)
    for window in (slice(5, 195), slice(10, 190), slice(20, 180)):
        found = _exponent(scene, _run(scene, "adiabatic").peak_force, window)
        true = _exponent(scene, _run(scene, "reference").peak_force, window)
        assert 0.004 < sign * (true - 0.4) < 0.007
        # the second order, 0.9 eps^2 on ln of force, is 0.002 at eps = 0.045: 0.001 over the range of ln beta, 2.3
        assert found == pytest.approx(true, abs=0.0015)
        assert _exponent(scene, plain.peak_force, window) == pytest.approx(0.4, abs=1e-13)


def test_a_response_of_the_other_sign_is_seen_by_the_exponent(monkeypatch: pytest.MonkeyPatch) -> None:
    sound = adiabatic.response

    def turned(n: float) -> adiabatic.Local:
        force, velocity, speed = sound(n).pressed
        return sound(n)._replace(pressed=(-force, velocity, speed))

    monkeypatch.setattr(adiabatic, "response", turned)
    wrong = db.solve(SOFTENING, backend="adiabatic", samples=1)
    assert _exponent(SOFTENING, wrong.peak_force, slice(10, 190)) > 0.404


@pytest.mark.parametrize(("scene", "slope"), [(FORWARD, 0.0295), (BACKWARD, -0.0309)], ids=["forward", "backward"])
def test_peak_velocity_along_tapered_chains(scene: Scene, slope: float) -> None:
    grains = np.arange(15, 36)
    found = {
        name: float(np.polyfit(grains, np.log(_fastest(_run(scene, name))[grains - 1]), 1)[0])
        for name in ("reference", "adiabatic", "bca")
    }
    assert found["reference"] == pytest.approx(slope, abs=0.5e-4)  # the digits
    # the energy left behind is of second order in the gradient of mass, 0.06; the next is of third
    assert found["adiabatic"] == pytest.approx(found["reference"], abs=0.06**3)
    assert found["bca"] == pytest.approx(slope, abs=4e-4)


def test_in_a_uniform_chain_every_body_moves_as_the_exact_wave_once_it_has_formed() -> None:
    scene = _struck("uniform", np.full(61, 0.01), np.full(60, 4e9), 0.8, 1.6e-3, 1500)
    run = _run(scene, "adiabatic")
    launch = launched(masses=(0.01, 0.01), stiffnesses=(4e9, 4e9), exponents=(2.5, 2.5), velocity=0.8)
    peak = math.sqrt(launch.energy / 1.0693229458 / 0.01)
    exact = solitary_wave(mass=0.01, stiffness=4e9, exponent=2.5, peak_velocity=peak)
    for i in range(30, 50):
        passing = exact.velocity(exact.speed * (run.time - launch.start) - i)
        # peaks are read off to 1e-6 of a transit and of the force, the profile is a spline good to 1e-8
        np.testing.assert_allclose(run.velocity[:, i], passing, atol=1e-4 * peak)
        assert run.displacement[-1, i] == pytest.approx(exact.shift, rel=1e-4)
    pulse = np.nan_to_num(run.contact_force[:, 40])
    assert np.max(pulse) == pytest.approx(exact.peak_force, rel=1e-3)  # 26 samples a transit


def test_the_struck_end_is_the_launchs_from_the_first_contact_on() -> None:
    scene = _struck("struck", np.array([0.008, *[0.01] * 50]), np.array([1e9, *[4e9] * 49]), 0.8, 1.4e-3, 1)
    run, truth = _run(scene, "adiabatic"), _run(scene, "reference")
    # formed to 1e-6 of the force, integrated to 1e-9; tops by parabolas through 40 samples a unit, (1/40)^2 / 6 of it
    assert run.peak_force[:40] == pytest.approx(truth.peak_force[:40], rel=1e-5)
    assert run.crossing_time[:40] == pytest.approx(truth.crossing_time[:40], abs=1e-4 / 3.5e4)
    assert 1.0 / np.diff(truth.crossing_time[20:40]) == pytest.approx(3.5e4, rel=0.1), "the transit meant above"
    assert truth.peak_force[0] < 0.9 * truth.peak_force[30], "the first contacts are unlike the others"


def test_newtons_law_holds_for_what_is_shown(solved: Solve) -> None:
    run = solved(replace(CHAIN, samples=4000), "adiabatic")
    h, mass = run.time[1], np.array(CHAIN.mass)
    push = -np.diff(run.contact_force, prepend=0.0, append=0.0, axis=1)
    middle = 0.5 * (push[1:] + push[:-1])
    gained = mass * np.diff(run.velocity, axis=0) / h
    # trapezoidal rule at 4000 samples of 2e-4 s, h^2 f''/12 with f'' of a pulse of 30 us: 1e-5; not the first sample,
    # where bodies only touch
    np.testing.assert_allclose(gained[1:], middle[1:], atol=1e-4 * float(np.max(run.contact_force)))
    moved = np.diff(run.displacement, axis=0) / h
    np.testing.assert_allclose(moved, 0.5 * (run.velocity[1:] + run.velocity[:-1]), atol=1e-4 * 0.8)


def test_momentum_is_kept_at_every_moment(solved: Solve) -> None:
    scene = replace(db.load_scene("decelerating-40"), samples=200)
    total = momentum(scene, solved(scene, "adiabatic"))
    # each of 40 impulses is given and taken, with the rounding of velocities of 0.8 m/s and masses of 10 g
    assert total == pytest.approx(np.full(201, scene.mass[0] * 0.8), rel=40 * 16 * EPS)


def test_exponents_may_vary_along_the_chain() -> None:
    n = np.linspace(2.35, 2.65, 40)
    beta = 4e9 * 1.2e-5 ** (2.5 - n)
    scene = replace(_struck("varying", np.full(41, 0.01), beta, 0.8, 1.2e-3, 1), exponent=tuple(n.tolist()))
    run, truth = _run(scene, "adiabatic"), _run(scene, "scipy")
    inner = slice(FIRST, -BEFORE_END)
    # wave and overlap change by 1 % a body: first order moves the force by 0.5 to 0.9 %, second by a fifth of that
    assert run.peak_force[inner] == pytest.approx(truth.peak_force[inner], rel=2e-3)
    assert run.crossing_time[inner] == pytest.approx(truth.crossing_time[inner], rel=2e-4)
    launch = launched(masses=(0.01, 0.01), stiffnesses=(beta[0], beta[1]), exponents=(n[0], n[1]), velocity=0.8)
    plain = adiabatic_wave(mass=scene.mass, stiffness=beta, exponent=n, energy=launch.energy, at=1, order=0)
    assert np.min(np.abs(plain.peak_force / truth.peak_force - 1.0)[inner]) > 3e-3


def test_what_is_reached_after_the_end_has_no_crossing(solved: Solve) -> None:
    run = solved(replace(CHAIN, duration=3e-5, samples=10), "adiabatic")
    assert np.isnan(run.crossing_time).tolist() == [False, True]


def test_it_says_nothing_of_its_own_error(solved: Solve) -> None:
    assert all(np.all(np.isinf(bar)) for bar in solved(CHAIN, "adiabatic").uncertainty.values())


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"gap": (1e-6, 0.0)}, "the scene has gaps;"),
        ({"wall_right": Wall(stiffness=1e9)}, "the scene has walls;"),
        ({"gravity": 9.81}, "the scene has gravity;"),
        ({"velocity": (0.8, 0.0, -0.1)}, "the scene has bodies behind the first that move at the start;"),
        ({"velocity": (-0.8, 0.0, 0.0)}, "body 0 starts with a velocity of -0.8 m/s;"),
        ({"precompression": 1.0}, "the scene has precompression;"),
        ({"drag": 1.0}, "the scene has drag;"),
        ({"exponent": 2.0}, "contact 0 has exponent n = 2.0; the adiabatic wave"),
        ({"exponent": (2.5, 1.5)}, "contact 1 has exponent n = 1.5; the adiabatic wave"),
        ({"mass": (1.0, 1.0), "stiffness": (1.0,), "velocity": (1.0, 0.0)}, "the number of contacts is 1;"),
        (
            {"mass": (1.0,), "stiffness": (), "velocity": (1.0,), "gap": 0.0, "exponent": 2.5},
            "number of contacts is 0;",
        ),
    ],
    ids=str,
)
def test_scenes_that_are_no_single_pulse_are_refused_with_the_reason(changes: dict[str, Any], reason: str) -> None:
    if "mass" in changes:
        changes = {"gap": 0.0, "exponent": 2.5} | changes
    scene = replace(CHAIN, **changes)
    with pytest.raises(
        UnsupportedScene, match=r"adiabatic cannot do chain: .*; the adiabatic wave is a single pulse"
    ) as caught:
        db.solve(scene, backend="adiabatic")
    assert reason in str(caught.value)


def test_all_reasons_are_given_at_once() -> None:
    reason = AdiabaticWaves.supports.unsupported_reason(replace(CHAIN, gravity=1.0, exponent=2.0))
    assert reason is not None
    assert reason.startswith("the scene has gravity; contact 0 has exponent n = 2.0; ")
    assert reason.endswith("; allowed exponents: 2.1 to 50")


def test_an_accuracy_cannot_be_promised_by_a_theory() -> None:
    with pytest.raises(UsageError, match="is not reached by adiabatic"):
        db.solve(CHAIN, backend="adiabatic", accuracy=1e-3)
