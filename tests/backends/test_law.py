"""Contact laws given as functions: alike with powers where they are some, exact where that is known, bars that hold."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.backends import twin
from dem_bridge.backends.base import BACKENDS, Resolution, Sampling, backend, supports_of, unsupported_reason
from dem_bridge.backends.curves import CELLS, curve_force, curves_of
from dem_bridge.backends.scales import natural_scales
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.errors import UsageError
from dem_bridge.lmp.pair_coefficients import Laws
from dem_bridge.observables.conserved import energy, energy_parts
from dem_bridge.physics.contact_law import ContactLaw, Floats, Law, law_of, power_law
from dem_bridge.runs.campaign import run_cases
from dem_bridge.runs.case import Case
from dem_bridge.scene.features import CONTACT_FUNCTIONS, WALLS
from dem_bridge.scene.scene import Damping, Scene, Wall
from dem_bridge.trajectory.dense import Schedule, damped_peaks, schedule
from dem_bridge.trajectory.trajectory import QUANTITIES, Trajectory
from tests.conftest import Solve

SLOPES, KINK = (5e6, 2.5e7), 6e-6
DT = 5e-8


def power(beta: float, n: float, overlap: Floats) -> Floats:
    return np.asarray(beta * overlap ** (n - 1.0))


def hertz_and_linear(overlap: Floats) -> Floats:
    return np.asarray(4e9 * overlap**1.5 + 2e6 * overlap)


def bilinear(overlap: Floats) -> Floats:
    return np.asarray(SLOPES[0] * overlap + (SLOPES[1] - SLOPES[0]) * np.maximum(overlap - KINK, 0.0))


BILINEAR = law_of(bilinear, reach=1e-4, kinks=(KINK,))

POWERS = Scene(
    name="powers",
    duration=3e-4,
    mass=(8e-3, 1e-2, 2e-2),
    stiffness=(4e9, 5e9),
    velocity=(0.8, 0.0, 0.0),
    wall_right=Wall(stiffness=2e9, exponent=3.0 - 0.3),
    samples=50,
)
FUNCTIONS = replace(
    POWERS,
    name="functions",
    law=tuple(partial(power, *one) for one in ((4e9, 2.5), (5e9, 2.5), (2e9, 2.7))),
)
SCENES = {
    "hertz and linear": replace(POWERS, name="hertz_and_linear", law=hertz_and_linear),
    "a declared kink": replace(POWERS, name="kink", law=BILINEAR),
    "saturating": replace(POWERS, name="saturating", law=lambda overlap: 1e3 * np.tanh(overlap / 1e-5)),
    "all different": replace(
        POWERS, name="different", law=(BILINEAR, hertz_and_linear, power_law(1e9, 2.5)), gap=(1e-6, -5e-7), gravity=1e3
    ),
    "a dashpot": replace(
        POWERS, name="dashpot", law=hertz_and_linear, damping=Damping(law="dashpot", coefficient=(20.0, 0.0, 30.0))
    ),
}
every_scene = pytest.mark.parametrize("what", SCENES)


def _apart(one: Trajectory, other: Trajectory) -> float:
    """Largest difference of velocities over the largest velocity."""
    return float(np.max(np.abs(one.velocity - other.velocity)) / np.max(np.abs(other.velocity)))


def _holds(run: Trajectory, truth: Trajectory) -> None:
    for name in QUANTITIES:
        away = np.abs(getattr(run, name) - getattr(truth, name))
        both_never = np.isnan(getattr(run, name)) & np.isnan(getattr(truth, name))
        assert np.all((away <= run.uncertainty[name] + truth.uncertainty[name]) | both_never), name


# powers as functions


def test_scipy_has_the_same_motion_from_a_power_and_from_the_function_that_it_is(solved: Solve) -> None:
    # both are converged to 1e-12 of the largest velocity by their own bars; 2e-14 was measured
    assert _apart(solved(FUNCTIONS, "scipy"), solved(POWERS, "scipy")) < 1e-12


def test_the_twins_splines_add_less_than_its_bar_for_them(solved: Solve) -> None:
    run, powers = solved(FUNCTIONS, "verlet", dt=DT), solved(POWERS, "verlet", dt=DT)
    # overlap^1.5 is a cubic of the root; overlap^1.7 is missed by 1e-9 of the force within 1e-7 of its range
    assert _apart(run, powers) < 1e-12
    assert run.uncertainty.parts["table"] < 1e-12
    assert run.uncertainty["velocity"] == pytest.approx(powers.uncertainty["velocity"], rel=1e-3)


@pytest.mark.lammps
def test_tables_of_powers_and_of_the_functions_that_they_are_move_lammps_alike(solved: Solve) -> None:
    run, powers = solved(FUNCTIONS, "lammps-table", dt=DT), solved(POWERS, "lammps-table", dt=DT)
    told, known = run.provenance["table"], powers.provenance["table"]
    assert told["predicted_error"] == pytest.approx(known["predicted_error"], rel=0.05)  # ranges follow other surveys
    # either table is this far from the law; the motion is no more sensitive to it than by a factor of a few
    assert _apart(run, powers) < 4.0 * told["predicted_error"]


def test_the_reference_answers_through_scipy(solved: Solve) -> None:
    assert solved(FUNCTIONS, "reference").provenance["answered_by"] == "scipy"


@pytest.mark.parametrize("n", [2.0, 2.05, 2.5, 3.3, 5.0])
def test_the_twins_splines_have_powers_to_1e_9_of_the_largest_force(n: float) -> None:
    scene = replace(POWERS, exponent=n, wall_right=None, law=partial(power, 4e6 * 1e6 ** (n - 2.0), n))
    assert _curve_error(scene) < 1e-9


@every_scene
def test_the_twins_splines_have_other_laws_too(what: str) -> None:
    # kinks stand between two splines; half as many cells are not much worse than all
    assert _curve_error(SCENES[what]) < 1e-12
    assert _curve_error(SCENES[what], CELLS // 2) < 1e-12


def test_a_kink_that_nobody_told_of_is_seen_in_the_splines_and_in_the_bars() -> None:
    scene = replace(POWERS, name="undeclared", law=bilinear)
    # a spline across a kink errs by about a tenth of what the slope's jump makes of the width of a cell, 1e-9 m
    assert 1e-7 < _curve_error(scene) < 1e-5
    told = db.solve(scene, backend="verlet", dt=DT).uncertainty.parts["table"]
    assert 1e-9 < told < 1e-6


def _curve_error(scene: Scene, cells: int = CELLS) -> float:
    """Largest error of force in the twin's kernel over the largest force, of all contacts."""
    c, worst = scene.contacts, 0.0
    curves = curves_of(scene, cells)
    for k in range(scene.n_contact):
        law, reach = c.laws[c.law[k]], float(c.reach[c.law[k]])
        overlap = reach * np.concatenate([np.logspace(-12, 0, 2000), np.linspace(1e-4, 1.0, 5001)])
        overlap = np.concatenate([overlap, *(kink * (1.0 + 1e-5 * np.linspace(-1.0, 1.0, 101)) for kink in law.kinks)])
        overlap = overlap[overlap <= reach]
        found = np.array([curve_force(k, one, curves) for one in overlap])
        worst = max(worst, float(np.max(np.abs(found - law.force(overlap))) / law.force(np.array(reach))))
    return worst


@pytest.mark.parametrize(
    "name", ["scipy", "verlet", pytest.param("lammps-table", marks=pytest.mark.lammps)], ids=lambda name: str(name)
)
def test_the_powers_near_a_law_do_not_move_anything(name: str, solved: Solve) -> None:
    scene = SCENES["a dashpot"]
    far = Wall(stiffness=1e11, exponent=3.0)
    other = replace(scene, name="far", stiffness=(1e12, 1e11), exponent=(4.0, 3.0), wall_right=far)
    run, same = solved(other, name, dt=DT), solved(scene, name, dt=DT)
    # ranges begin elsewhere, and splines with them: tables err by 1e-8, the others by round-off
    allowed = 4.0 * run.provenance["table"]["predicted_error"] if name == "lammps-table" else 1e-11
    assert _apart(run, same) < allowed
    for quantity in ("peak_force", "crossing_time"):
        assert getattr(run, quantity) == pytest.approx(getattr(same, quantity), rel=allowed)
    if name == "lammps-table":
        rounding = [one.provenance["table"]["round_off"] for one in (run, same)]
        assert rounding[0] == pytest.approx(rounding[1], rel=0.01)
    np.testing.assert_array_equal(natural_scales(scene)[1], scene.contacts.reach[scene.contacts.law])


# beside each other


@every_scene
def test_the_bars_of_the_twin_hold(what: str, solved: Solve) -> None:
    _holds(solved(SCENES[what], "verlet", dt=DT), solved(SCENES[what], "scipy"))


@pytest.mark.lammps
@every_scene
def test_the_bars_of_lammps_hold(what: str, solved: Solve) -> None:
    _holds(solved(SCENES[what], "lammps-table", dt=DT), solved(SCENES[what], "scipy"))


@pytest.mark.lammps
@every_scene
def test_lammps_is_the_twin_with_the_same_tables(what: str, solved: Solve) -> None:
    run = solved(SCENES[what], "lammps-table", dt=DT)
    radius = run.provenance["settings"]["surrogate_radius"]
    beside = solved(SCENES[what], "verlet", dt=DT, tables=True, surrogate_radius=radius, uncertainty=False)
    # no bit differs undamped; damping may be summed in another order, an ulp a step in 6000 steps
    assert _apart(run, beside) < 6000 * np.finfo(float).eps


@pytest.mark.lammps
def test_a_law_that_is_off_by_1e_6_in_the_table_is_seen(monkeypatch: pytest.MonkeyPatch, solved: Solve) -> None:
    scene, honest = SCENES["hertz and linear"], Laws.law
    beside = solved(scene, "verlet", dt=DT)

    def planted(self: Laws, law: int) -> ContactLaw:
        sound = honest(self, law)
        return ContactLaw(
            force=lambda overlap: sound.force(overlap) * (1.0 + 1e-6),
            energy=lambda overlap: sound.energy(overlap) * (1.0 + 1e-6),
        )

    sound = solved(scene, "lammps-table", dt=DT)
    monkeypatch.setattr(Laws, "law", planted)
    run = db.solve(scene, backend="lammps-table", dt=DT, uncertainty=False)
    limit = 4.0 * sound.provenance["table"]["predicted_error"]
    assert _apart(sound, beside) < limit < _apart(run, beside)


@pytest.mark.lammps
@pytest.mark.parametrize(
    ("law", "words"),
    [
        # too little for the scene's own look to see
        (ContactLaw(hertz_and_linear, lambda d: (1.0 + 1e-9) * (4e9 * d**2.5 / 2.5 + 1e6 * d**2)), "the energy rises"),
        (bilinear, "to compute the energy, with the overlaps at which the slope jumps"),
    ],
)
def test_tables_refuse_an_energy_that_is_not_of_the_force(law: Law, words: str) -> None:
    with pytest.raises(UsageError) as caught:
        db.solve(replace(POWERS, law=law), backend="lammps-table", dt=DT)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("what", [name for name in SCENES if name != "a dashpot"])
def test_energy_is_conserved(what: str, solved: Solve) -> None:
    run = solved(SCENES[what], "scipy")
    total = energy(SCENES[what], run)
    # the bar of a velocity v moves m v^2 / 2 by twice its share
    speed = float(np.max(np.abs(run.velocity)))
    assert np.ptp(total) < 8.0 * np.max(total) * (run.uncertainty["velocity"] / speed + 1e-13)
    assert np.max(energy_parts(SCENES[what], run)[1]) > 0.1 * np.max(total)


def test_an_energy_that_does_not_fit_is_not_conserved(solved: Solve) -> None:
    scene = SCENES["hertz and linear"]
    wrong = ContactLaw(hertz_and_linear, lambda d: (1.0 + 1e-7) * (4e9 * d**2.5 / 2.5 + 1e6 * d**2))
    run = solved(scene, "scipy")
    sound, planted = (np.ptp(energy(one, run)) for one in (scene, replace(scene, law=wrong)))
    assert sound < 1e-11 * np.max(energy(scene, run)) < 1e-8 * np.max(energy(scene, run)) < planted


# collisions whose answer is known

REDUCED, SPEED, RIGID = 8e-3 * 1e-2 / 1.8e-2, 0.8, 5e6
OMEGA = math.sqrt(RIGID / REDUCED)
HALF_SINE = Scene(
    name="half_sine",
    duration=1.25 * math.pi / OMEGA,
    mass=(8e-3, 1e-2),
    stiffness=(4e9,),
    velocity=(SPEED, 0.0),
    law=lambda overlap: RIGID * overlap,
    samples=50,
)


@pytest.mark.parametrize(
    "name", ["scipy", "verlet", pytest.param("lammps-table", marks=pytest.mark.lammps)], ids=lambda name: str(name)
)
def test_a_linear_contact_is_half_a_sine(name: str, solved: Solve) -> None:
    run = solved(HALF_SINE, name, dt=DT)
    peak = SPEED * math.sqrt(RIGID * REDUCED)
    assert abs(run.peak_force[0] - peak) <= run.uncertainty["peak_force"][0]
    assert abs(run.crossing_time[0] - 0.5 * math.pi / OMEGA) <= run.uncertainty["crossing_time"][0]
    phase = np.minimum(OMEGA * run.time, math.pi)
    given = SPEED * (REDUCED / np.array(HALF_SINE.mass))[None] * (1.0 - np.cos(phase))[:, None]
    exact = np.array([SPEED, 0.0]) - given * np.array([1.0, -1.0])
    assert np.max(np.abs(run.velocity - exact)) <= run.uncertainty["velocity"]
    # the bars say something: (omega dt)^2/24 of it, times six or so; of scipy the tolerance
    assert run.uncertainty["velocity"] < (1e-10 if name == "scipy" else (OMEGA * DT) ** 2) * SPEED
    # of a force, sampled: that of its overlap's share of the largest
    sine = np.where(phase < math.pi, peak * np.sin(phase), 0.0)
    bar = run.uncertainty["velocity"] / SPEED + run.uncertainty["displacement"] * OMEGA / SPEED
    assert np.max(np.abs(run.contact_force[:, 0] - sine)) <= 2.0 * peak * bar


def test_the_peak_of_a_damped_law_is_found_between_samples() -> None:
    damper = 20.0
    scene = replace(HALF_SINE, damping=Damping(law="dashpot", coefficient=damper))
    decay = 0.5 * damper / REDUCED
    ring = math.sqrt(OMEGA**2 - decay**2)
    time = np.linspace(0.0, 0.9 * math.pi / ring, 29)  # 0.1 of 1/omega between two samples

    def motion(when: Floats) -> tuple[Floats, Floats, Floats]:
        fading = SPEED * np.exp(-decay * when)
        overlap = fading * np.sin(ring * when) / ring
        rate = fading * np.cos(ring * when) - decay * overlap
        return overlap, rate, RIGID * overlap + damper * rate

    overlap, rate, force = (one[:, None] for one in motion(time))
    found = damped_peaks(
        time=time, overlap=overlap, rate=rate, acceleration=-force / REDUCED, force=force, contacts=scene.contacts
    )
    exact = np.max(motion(np.linspace(0.0, time[-1], 1_000_001))[2])
    # parabolas through a sixteenth of a sample's distance err by its fourth power; the samples alone by 1e-4
    assert found[0] == pytest.approx(exact, rel=1e-8)
    assert np.max(force) < (1.0 - 1e-5) * exact


def _against_a_wall(
    law: ContactLaw | Callable[[Floats], Floats],
) -> tuple[Scene, float, float, Callable[[Floats], Floats]]:
    """One body and a bilinear wall: scene, largest force, its time, velocity of time; two sines, joined at the kink."""
    mass = 8e-3
    first, second = (math.sqrt(slope / mass) for slope in SLOPES)
    joint = math.asin(KINK * first / SPEED) / first
    left = SPEED * math.cos(first * joint) / second
    shift = SLOPES[0] * KINK / SLOPES[1]
    swing, phase = math.hypot(shift, left), math.atan2(shift, left)
    top = joint + (0.5 * math.pi - phase) / second

    def velocity(time: Floats) -> Floats:
        back = np.where(time > top, 2.0 * top - time, time)
        inner = swing * second * np.cos(second * (back - joint) + phase)
        speed = np.where(back < joint, SPEED * np.cos(first * np.maximum(back, 0.0)), inner)
        return np.asarray(np.where(time > top, -speed, speed))

    scene = Scene(
        name="wall",
        duration=3.0 * top,
        mass=(mass,),
        stiffness=(),
        velocity=(SPEED,),
        wall_right=Wall(stiffness=4e9),
        law=law,
        samples=40,
    )
    return scene, float(bilinear(np.array(KINK - shift + swing))), top, velocity


def _runs_across_a_kink() -> list[object]:
    own = [("scipy", {}), ("scipy", {"rtol": 1e-11}), ("scipy", {"rtol": 1e-8}), ("verlet", {"dt": 1e-7})]
    cases: list[object] = [
        pytest.param(name, settings, law, id=f"{name}-{word}-{settings}")
        for name, settings in own
        for word, law in (("undeclared", bilinear), ("declared", BILINEAR))
    ]
    return [*cases, pytest.param("lammps-table", {"dt": 1e-7}, BILINEAR, marks=pytest.mark.lammps, id="lammps-table")]


@pytest.mark.parametrize(("name", "settings", "law"), _runs_across_a_kink())
def test_bars_hold_across_a_kink(name: str, settings: dict[str, Any], law: Law) -> None:
    scene, peak, top, velocity = _against_a_wall(law)
    run = db.solve(scene, backend=name, **settings)
    assert np.max(np.abs(run.velocity[:, 0] - velocity(run.time))) <= run.uncertainty["velocity"]
    assert abs(run.peak_force[0] - peak) <= run.uncertainty["peak_force"][0]
    assert abs(run.crossing_time[0] - top) <= run.uncertainty["crossing_time"][0]
    # and say something: 4e-6 at the coarsest
    assert run.uncertainty["velocity"] < 2e-5 * SPEED


# what is told, chosen and refused


@every_scene
def test_the_survey_finds_overlaps_within_a_per_cent_and_none_beyond_what_energy_allows(
    what: str, solved: Solve
) -> None:
    scene = SCENES[what]
    c, prescan = scene.contacts, prescan_scene(scene)
    fine, dense = twin.solve_dense(scene, _fine(scene), 0.0)
    assert prescan.peak_overlap == pytest.approx(np.max(dense.overlap, axis=0), rel=0.01)
    assert np.all(prescan.peak_overlap <= c.reach[c.law])
    assert (prescan.lowest, prescan.highest) == pytest.approx(
        (np.min(fine.displacement), np.max(fine.displacement)), rel=0.02
    )


def _fine(scene: Scene) -> Schedule:
    return schedule(duration=scene.duration, samples=50, dt=DT, frequency=1e6, bodies=scene.n_body)


def test_a_wanted_accuracy_is_had(solved: Solve) -> None:
    scene = SCENES["hertz and linear"]
    run, truth = db.solve(scene, backend="verlet", accuracy=1e-5), solved(scene, "scipy")
    assert _apart(run, truth) < run.uncertainty["velocity"] / np.max(np.abs(run.velocity)) <= 1e-5


@pytest.mark.parametrize("name", ["scipy", "verlet", pytest.param("lammps-table", marks=pytest.mark.lammps)])
@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.0), (-0.1, 0.0, 0.1)], ids=["at rest", "parting"])
def test_laws_that_nothing_feels_do_nothing(name: str, velocity: tuple[float, ...]) -> None:
    scene = replace(POWERS, law=hertz_and_linear, velocity=velocity, wall_right=None)
    run = db.solve(scene, backend=name)
    assert np.all(run.velocity == velocity)
    assert not np.any(run.peak_force)


def test_a_scene_without_contacts_has_no_laws() -> None:
    alone = Scene(name="alone", duration=1e-3, mass=(1e-2,), stiffness=(), velocity=(0.5,), law=hertz_and_linear)
    assert alone.law is None


@pytest.mark.parametrize("name", [name for name in BACKENDS if CONTACT_FUNCTIONS not in supports_of(name).features])
def test_a_backend_without_laws_names_one_that_has_them(name: str) -> None:
    reason = unsupported_reason(backend(name), FUNCTIONS)
    assert reason is not None
    walls = "" if WALLS in supports_of(name).features else "walls and "
    assert reason.startswith(f"the scene has {walls}contact laws given as functions; ")
    assert "\n" not in reason
    assert reason.endswith(f"; use backend = {('lammps-table' if name == 'lammps-granular' else 'scipy')!r}")


def test_a_law_that_is_a_function_of_a_module_travels_with_its_scene() -> None:
    scene = SCENES["hertz and linear"]
    assert scene.contacts.laws  # found once, and again on arrival
    again = pickle.loads(pickle.dumps(scene))
    assert (again, again.content_hash) == (scene, scene.content_hash)
    assert again.contacts.laws[0].energy(np.array([1e-6])) == scene.contacts.laws[0].energy(np.array([1e-6]))


def test_a_law_that_cannot_travel_is_refused_before_any_run() -> None:
    case = Case(scene=SCENES["saturating"], backend="verlet", resolution=Resolution(), sampling=Sampling(count=5))
    with pytest.raises(UsageError, match=r"jobs = 2: the law of saturating .* or jobs = 1") as caught:
        run_cases([case], jobs=2)
    assert "\n" not in str(caught.value)
