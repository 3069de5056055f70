"""Damping laws, clipped and not: closed forms by scipy, LAMMPS beside its twin, and faults that each must show."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.backends import scipy_kernels
from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.errors import SceneError
from dem_bridge.lmp.pair_coefficients import GRANULAR_STYLE
from dem_bridge.observables.conserved import energy
from dem_bridge.physics.damped_impact import alpha_of_restitution, alpha_of_tsuji
from dem_bridge.runs.case import Case
from dem_bridge.scene.contacts import Contacts
from dem_bridge.scene.file import parse_scene
from dem_bridge.scene.file.write import scene_toml
from dem_bridge.scene.scene import BY_RESTITUTION, Adhesion, Damping, Scene, Wall
from tests.backends.test_damped_steps import plant
from tests.conftest import Solve
from tests.helpers.fault_decks import Change, run_with, substituted, times

ENGINE, TWIN, SCIPY = "lammps-granular", "verlet", "scipy"
PAIR = Scene(name="pair", duration=2e-4, mass=(1e-2, 3e-2), stiffness=(4e9,), velocity=(1.0, 0.0), samples=20)
BALL = Scene(
    name="ball", duration=2e-4, mass=(1e-2,), stiffness=(), velocity=(1.0,), wall_right=Wall(stiffness=4e9), samples=20
)
#: both exponents, gaps, walls and weight; re-collisions and contacts that are not damped
CHAIN = Scene(
    name="chain", duration=3e-4, mass=(8e-3, 1e-2, 2e-2, 5e-3), stiffness=(4e9, 2e7, 6e9), exponent=(2.5, 2.0, 2.5),
    velocity=(0.8, 0.0, 0.0, -0.2), gap=(0.0, 1e-6, -5e-7), gravity=-300.0, samples=30,
    wall_left=Wall(stiffness=3e9, gap=2e-6), wall_right=Wall(stiffness=1.5e7, gap=1e-5, exponent=2.0),
)  # fmt: skip
#: law -> a coefficient for each contact of the chain
COEFFICIENTS = {
    "dashpot": (40.0, 10.0, 0.0, 30.0, 20.0),
    "mass_velocity": (8e3, 2e3, 0.0, 6e3, 4e3),
    "kuwabara-kono": (1e-5, 3e-6, 0.0, 2e-5, 1e-5),
    "coeff_restitution": (0.5, 0.7, 1.0, 0.3, 0.9),
}
STEP = 1e-7


def _damped(scene: Scene, law: str, coefficient: Any, clip: bool | None = None) -> Scene:
    # contacts have the restitution e only if they are not clipped
    clip = law not in BY_RESTITUTION if clip is None else clip
    return replace(scene, damping=Damping(law=law, coefficient=coefficient, clip=clip))


def _linear(scene: Scene) -> Scene:
    """Return the pair or the ball with n = 2."""
    wall = None if scene.wall_right is None else Wall(stiffness=1e6, exponent=2.0)
    return replace(scene, exponent=2.0, stiffness=(1e6,) * len(scene.stiffness), wall_right=wall, duration=1e-3)


def _rebound(run: Any) -> float:
    """Return the speed of separation; all scenes close at 1 m/s."""
    last = run.velocity[-1]
    return float(last[1] - last[0]) if len(last) == 2 else -float(last[0])


def _far(first: Any, second: Any) -> float:
    return float(np.max(np.abs(first.velocity - second.velocity)) / np.max(np.abs(second.velocity)))


# closed forms


@pytest.mark.parametrize("scene", [PAIR, BALL, _linear(PAIR), _linear(BALL)], ids=["pair", "wall", "pair 2", "wall 2"])
@pytest.mark.parametrize("law", ["coeff_restitution", "tsuji"])
@pytest.mark.parametrize("e", [0.1, 0.5, 0.9])
def test_a_restitution_is_that_of_the_closed_form(e: float, law: str, scene: Scene) -> None:
    n = float(scene.contacts.exponent[0])
    alpha = alpha_of_restitution(e, n) if law == "coeff_restitution" else alpha_of_tsuji(e)
    zeta = alpha / math.sqrt(2.0 * n)
    theta = math.acos(zeta)
    # of the oscillator in overlap^(n/2); it parts after half a period, or at 2 theta where no force pulls
    free, clip = math.exp(-math.pi / math.tan(theta)), math.exp(-2.0 * theta / math.tan(theta))
    for value, exact in ((False, free), (True, clip)):
        # 200 steps at a tolerance of 3e-14; measured: 1e-13
        run = db.solve(_damped(scene, law, e, value), backend=SCIPY, uncertainty=False)
        assert _rebound(run) == pytest.approx(exact, abs=1e-11)
    assert (law == "coeff_restitution") == (abs(free - e) < 1e-12)


@pytest.mark.parametrize("law", [*COEFFICIENTS, "tsuji"])
def test_a_mass_proportional_force_is_that_of_the_effective_mass(law: str) -> None:
    for scene, m in ((PAIR, 1e-2 * 3e-2 / 4e-2), (BALL, 1e-2)):
        c = _damped(scene, law, 0.5).contacts
        alpha = alpha_of_tsuji(0.5) if law == "tsuji" else alpha_of_restitution(0.5)
        expected = {"dashpot": 0.5, "mass_velocity": 0.5 * m, "kuwabara-kono": 0.5 * 4e9}
        assert c.damping[0] == pytest.approx(expected.get(law, alpha * math.sqrt(m * 4e9)), rel=1e-15)
        assert c.damping_power[0] == {"kuwabara-kono": 0.5, "coeff_restitution": 0.25, "tsuji": 0.25}.get(law, 0.0)
        table = scipy_kernels.contact_table(_damped(scene, law, 0.5))
        # two writings: a dozen operations
        assert table["damping"] == pytest.approx(c.damping, rel=3e-15)


def test_unclipped_contacts_end_in_tension_and_clipped_ones_do_not() -> None:
    for law, coefficient in (("dashpot", 40.0), ("mass_velocity", 5e3), ("kuwabara-kono", 2e-5), ("tsuji", 0.5)):
        free, clip = (
            db.solve(_damped(replace(PAIR, samples=200), law, coefficient, value), backend=SCIPY, uncertainty=False)
            for value in (False, True)
        )
        assert np.min(free.contact_force) < -1.0 < 0.0 <= np.min(clip.contact_force)
        assert _rebound(free) < _rebound(clip) - 1e-4


# fixed steps


@pytest.mark.parametrize("clip", [True, False], ids=["clipped", "not"])
@pytest.mark.parametrize("law", COEFFICIENTS)
def test_the_twin_is_of_first_order_and_within_its_uncertainty(law: str, clip: bool, solved: Solve) -> None:
    scene = _damped(CHAIN, law, COEFFICIENTS[law], clip)
    exact = solved(scene, SCIPY, uncertainty=False)
    main = solved(scene, TWIN, dt=STEP)
    assert np.max(np.abs(main.velocity - exact.velocity)) <= main.uncertainty["velocity"]
    assert np.all(np.abs(main.peak_force - exact.peak_force) <= main.uncertainty["peak_force"])
    fine = solved(scene, TWIN, dt=STEP / 8.0, uncertainty=False)
    # 8 by order 1, 64 by order 2; a touch within a step moves by its part of the step, so not clean
    assert 4.0 < _far(main, exact) / _far(fine, exact) < 16.0


@pytest.mark.lammps
@pytest.mark.parametrize("clip", [True, False], ids=["clipped", "not"])
@pytest.mark.parametrize("law", COEFFICIENTS)
def test_lammps_repeats_the_twin_that_keeps_positions(law: str, clip: bool, solved: Solve) -> None:
    scene = _damped(CHAIN, law, COEFFICIENTS[law], clip)
    run = solved(scene, ENGINE, dt=STEP, uncertainty=False)
    radius = run.provenance["settings"]["surrogate_radius"]
    twin = db.solve(scene, backend=TWIN, dt=STEP, surrogate_radius=radius, uncertainty=False)
    # round-off in 3000 steps; measured: 1e-15 to 6e-13
    assert _far(run, twin) < 1e-11
    # the radius in the deck cancels
    other = db.solve(scene, backend=ENGINE, dt=STEP, surrogate_radius=4.0 * radius, uncertainty=False)
    assert _far(run, other) < 1e-9


#: e of LAMMPS 22 Jul 2025 for .1 .3 .5 .7 .9, not clipped and clipped, converged in the step
MEASURED = {
    ("coeff_restitution", False): (0.1, 0.3, 0.5, 0.7, 0.9),
    ("coeff_restitution", True): (0.25273, 0.39714, 0.55028, 0.71820, 0.90203),
}


@pytest.mark.lammps
@pytest.mark.parametrize(("law", "clip"), MEASURED)
def test_lammps_restitution_is_the_one_that_is_asked_for(law: str, clip: bool) -> None:
    for e, out in zip((0.1, 0.3, 0.5, 0.7, 0.9), MEASURED[law, clip], strict=True):
        run = db.solve(_damped(PAIR, law, e, clip), backend=ENGINE, dt=2e-8, uncertainty=False)
        # of first order; 1.5e-4 at the largest damping
        assert _rebound(run) == pytest.approx(out, abs=2e-4)


# adhesion


def _adhesive(scene: Scene, *pull_off: float, **changes: Any) -> Scene:
    return replace(scene, adhesion=Adhesion(law="dmt", pull_off=pull_off), **changes)


APART = replace(PAIR, gap=1e-6)
#: gaps, an initial overlap in equilibrium, a contact without adhesion, a wall; contacts that stick
ADHESIVE = Scene(
    name="adhesive", duration=4e-4, mass=(8e-3, 1e-2, 2e-2, 5e-3), stiffness=(4e9, 6e9, 5e9),
    velocity=(0.3, 0.0, 0.0, 0.0), gap=(1e-6, -((8.0 / 6e9) ** (2.0 / 3.0)), 2e-6), samples=20,
    wall_right=Wall(stiffness=3e9, gap=5e-6), adhesion=Adhesion(law="dmt", pull_off=(20.0, 8.0, 0.0, 40.0)),
)  # fmt: skip


@pytest.mark.parametrize(("speed", "pull_off"), [(1.0, 30.0), (0.1, 10.0), (0.01, 0.3)])
def test_dmt_adhesion_is_that_of_the_closed_form(speed: float, pull_off: float) -> None:
    for scene, m in ((APART, 7.5e-3), (replace(BALL, wall_right=Wall(stiffness=4e9, gap=1e-6)), 1e-2)):
        still = (0.0,) * (scene.n_body - 1)
        span = 3e-4 * speed**-0.2 + 2e-6 / speed
        moved = _adhesive(scene, pull_off, velocity=(speed, *still), duration=span, samples=400)
        run = db.solve(moved, backend=SCIPY)
        # energy: 2/5 beta d^(5/2) - P d = m v^2 / 2 at the largest overlap
        low, high = 0.0, 1e-4
        while high - low > 2.0 * np.spacing(high):
            middle = 0.5 * (low + high)
            rest = 0.4 * 4e9 * middle**2.5 - pull_off * middle - 0.5 * m * speed**2
            low, high = (low, middle) if rest > 0.0 else (middle, high)
        assert run.peak_force[0] == pytest.approx(4e9 * low**1.5 - pull_off, rel=1e-11)
        assert _rebound(run) == pytest.approx(speed, rel=1e-11)
        assert np.min(run.contact_force) < -0.5 * pull_off
        total = energy(moved, run)
        assert total == pytest.approx(np.full(401, total[0]), rel=1e-11)


def test_dmt_contacts_stick_if_they_part_without_a_speed() -> None:
    depth = (10.0 / 4e9) ** (2.0 / 3.0)
    held = _adhesive(PAIR, 10.0, gap=-depth, velocity=(0.0, 0.0))
    for backend in (SCIPY, TWIN):
        run = db.solve(held, backend=backend, uncertainty=False)
        assert np.max(np.abs(run.contact_force)) < 1e-12 * 10.0
        assert np.isnan(run.crossing_time[0])
        moved = db.solve(replace(held, velocity=(1e-3, 0.0)), backend=backend, uncertainty=False)
        assert np.max(np.abs(np.diff(moved.velocity[-1]))) < 2e-3
        assert np.min(moved.contact_force) > -10.0


def test_dmt_in_fixed_steps_is_within_an_uncertainty_that_falls_with_the_step(solved: Solve) -> None:
    exact = solved(ADHESIVE, SCIPY, uncertainty=False)
    runs = [solved(ADHESIVE, TWIN, dt=step) for step in (STEP, STEP / 4.0, STEP / 16.0)]
    for run in runs:
        assert np.max(np.abs(run.velocity - exact.velocity)) <= run.uncertainty["velocity"]
        assert np.max(np.abs(run.displacement - exact.displacement)) <= run.uncertainty["displacement"]
        assert np.all(np.abs(run.peak_force - exact.peak_force) <= run.uncertainty["peak_force"])
    first, _, last = (float(run.uncertainty["velocity"]) for run in runs)
    assert 4.0 < first / last < 64.0  # 16 by order 1, erratic


@pytest.mark.lammps
@pytest.mark.parametrize("damping", [None, Damping(law="kuwabara-kono", coefficient=1e-5, clip=False)], ids=str)
def test_lammps_dmt_repeats_the_twin_that_keeps_positions(damping: Damping | None, solved: Solve) -> None:
    scene = replace(ADHESIVE, damping=damping)
    first = solved(scene, ENGINE, dt=STEP, uncertainty=False)
    radius = first.provenance["settings"]["surrogate_radius"]
    # E and gamma of the deck follow from its radius
    other = db.solve(scene, backend=ENGINE, dt=STEP, surrogate_radius=4.0 * radius, uncertainty=False)
    for run, factor in ((first, 1.0), (other, 4.0)):
        twin = db.solve(scene, backend=TWIN, dt=STEP, surrogate_radius=factor * radius, uncertainty=False)
        assert _far(run, twin) < 1e-11
        assert np.max(np.abs(run.contact_force - twin.contact_force)) < 1e-9 * np.max(twin.peak_force)


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "law": ({"adhesion": Adhesion(law="glue", pull_off=1.0)}, "adhesion.law = 'glue'; allowed: dmt"),
    "negative": ({"adhesion": Adhesion(law="dmt", pull_off=-1.0)}, "adhesion.pull_off = -1.0; allowed: a number >= 0"),
    "count": ({"adhesion": Adhesion(law="dmt", pull_off=(1.0, 2.0))}, "pull_off has 2 entries; allowed: 1, one per"),
    "clip": (
        {"damping": Damping(law="dashpot", coefficient=1.0, clip=True)},
        "damping.clip = True, but contacts have adhesion",
    ),
    "exponent": ({"exponent": 2.0}, "is in contact 0, whose exponent n is 2.0; allowed: n = 2.5"),
    "touch": (
        {"gap": 0.0, "velocity": (0.0, 0.0)},
        "start without approaching each other; allowed: a gap",
    ),
    "precompression": ({"gap": 0.0, "precompression": 1.0}, "cannot be combined with precompression; allowed: no"),
    "function": ({"law": lambda overlap: 1e9 * overlap}, "cannot be combined with law; allowed: no law"),
}


@pytest.mark.parametrize(("changes", "why"), REFUSED.values(), ids=REFUSED)
def test_adhesion_without_a_meaning_is_refused_in_one_line(changes: dict[str, Any], why: str) -> None:
    with pytest.raises(SceneError) as caught:
        replace(_adhesive(APART, 1.0), **changes)
    assert why in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("law", "word"), [("tsuji", "tsuji"), ("coeff_restitution", "coeff_restitution")])
def test_adhesion_beside_a_restitution_is_refused_as_the_engine_refuses_it(law: str, word: str) -> None:
    scene = _damped(_adhesive(APART, 1.0), law, 0.5)
    reason = GRANULAR_STYLE.unsupported_reason(scene)
    assert reason is not None
    assert f"LAMMPS: Cannot use {word} model with a cohesive normal model, dmt; " in reason
    # of two contacts only one has both
    apart = _damped(ADHESIVE, law, (1.0, 1.0, 0.5, 1.0))
    assert GRANULAR_STYLE.covers(apart) == (law == "coeff_restitution")


def test_a_scene_with_adhesion_survives_its_text_and_has_a_hash_of_its_own() -> None:
    assert parse_scene(scene_toml(ADHESIVE)) == ADHESIVE
    none = _adhesive(APART, 0.0)
    assert none.content_hash == APART.content_hash != _adhesive(APART, 1.0).content_hash
    assert (none.features, none.adhesive) == (APART.features, False)


# faults


def _with(scene: Scene, **changes: Any) -> Scene:
    """Return the scene with wrong arrays of contacts, which the twin takes and scipy does not."""
    wrong = replace(scene)
    wrong.__dict__["contacts"] = replace(scene.contacts, **changes)
    return wrong


def _wrong_mass(c: Contacts) -> dict[str, Any]:
    return {"damping": c.damping * np.append([np.sqrt(0.04 / 0.03)], np.ones(c.damping.size - 1))}


#: scene -> arrays of contacts with a fault; each belongs to the law
ARRAY_FAULTS = {
    "mass for effective mass": (_damped(PAIR, "coeff_restitution", 0.5), _wrong_mass),
    "mass for effective mass in a dashpot": (
        _damped(PAIR, "mass_velocity", 5e3),
        lambda c: {"damping": c.damping * 0.04 / 0.03},
    ),
    "sqrt 2 missing": (_damped(PAIR, "tsuji", 0.5), lambda c: {"damping": c.damping / math.sqrt(2.0)}),
    "power of the overlap of Kuwabara-Kono": (
        _damped(PAIR, "coeff_restitution", 0.5),
        lambda c: {"damping_power": c.damping_power * 2.0},
    ),
    "clipped": (_damped(PAIR, "coeff_restitution", 0.5), lambda c: {"clip": True}),
    "not clipped": (_damped(PAIR, "coeff_restitution", 0.5, True), lambda c: {"clip": False}),
    "adhesion forgotten": (ADHESIVE, lambda c: {"pull_off": 0.0 * c.pull_off}),
    "adhesion of the sphere's radius in place of R_eff": (ADHESIVE, lambda c: {"pull_off": 2.0 * c.pull_off}),
    "wall with the pull-off of the pair": (
        ADHESIVE,
        lambda c: {"pull_off": np.array([*c.pull_off[:3], c.pull_off[0]])},
    ),
    "wall with the coefficient of the pair": (
        _damped(CHAIN, "coeff_restitution", COEFFICIENTS["coeff_restitution"]),
        lambda c: {"damping": np.array([*c.damping[:3], c.damping[0], c.damping[4]])},
    ),
}


@pytest.mark.parametrize(("scene", "fault"), ARRAY_FAULTS.values(), ids=ARRAY_FAULTS)
def test_a_fault_in_a_law_parts_the_twin_from_scipy(scene: Scene, fault: Any, solved: Solve) -> None:
    exact, sound = solved(scene, SCIPY, uncertainty=False), solved(scene, TWIN, dt=STEP)
    wrong = db.solve(_with(scene, **fault(scene.contacts)), backend=TWIN, dt=STEP, uncertainty=False)
    assert np.max(np.abs(sound.velocity - exact.velocity)) <= sound.uncertainty["velocity"]
    assert np.max(np.abs(wrong.velocity - exact.velocity)) > 10.0 * sound.uncertainty["velocity"]


def test_a_clip_of_the_damping_force_alone_shows(monkeypatch: pytest.MonkeyPatch, solved: Solve) -> None:
    scene = _damped(PAIR, "coeff_restitution", 0.5, True)
    exact, sound = solved(scene, SCIPY, uncertainty=False), solved(scene, TWIN, dt=STEP)
    plant(monkeypatch, "** damping_power[k] * rate", "** damping_power[k] * max(rate, 0.0)")
    wrong = db.solve(scene, backend=TWIN, dt=STEP, uncertainty=False)
    assert np.max(np.abs(wrong.velocity - exact.velocity)) > 10.0 * sound.uncertainty["velocity"]


#: what a user may write wrongly in a deck of the chain with restitution
DECK_FAULTS: dict[str, Change] = {
    "limit_damping added": substituted(r"coeff_restitution  #", "coeff_restitution limit_damping  #", places=4),
    "tsuji for coeff_restitution": substituted("coeff_restitution  #", "tsuji  #", places=4),
    "wall with the coefficient of the pair": substituted(r" 0\.3 (?=tang.*# wall_left)", " 0.5 "),
    "wall of its neighbour's mass": substituted(
        r"^(1 \S+ \S+ )(\S+) (?=-)", lambda m: f"{m[1]}{float(m[2]) / 2.0**60!r} ", data=True
    ),
    "eta in place of e": substituted(r" 0\.5 (tang.*) coeff_restitution", r" 0.5 \1 velocity"),
    "K = beta / sqrt(R) in place of R_eff = R/2": substituted(
        r"hertz ([1-9]\S+) ", lambda m: f"hertz {float(m[1]) / math.sqrt(2.0)!r} ", places=3
    ),
}


DMT_FAULTS: dict[str, Change] = {
    "pull-off of 3 pi gamma R in place of 4": substituted(r" 0 (\S+) (?=tang.*# contact 0)", times(0.75)),
    "E of hertz/material, nu of 0.3": substituted(r"(dmt \S+ 0) 0 (?=.*# contact 0)", r"\1 0.3 "),
    "hertz in place of dmt": substituted(
        r"dmt (\S+) 0 0 \S+ (?=tang.*# wall)", lambda m: f"hertz {float(m[1]) / 1.5!r} 0 "
    ),
}


@pytest.mark.lammps
@pytest.mark.parametrize("change", DMT_FAULTS.values(), ids=DMT_FAULTS)
def test_a_fault_in_the_adhesion_of_a_deck_parts_lammps_from_the_twin(change: Change, solved: Solve) -> None:
    sound = solved(ADHESIVE, ENGINE, dt=STEP, uncertainty=False)
    assert _far(_run_with(change, ADHESIVE), sound) > 1e-9


@pytest.mark.lammps
@pytest.mark.parametrize("change", DECK_FAULTS.values(), ids=DECK_FAULTS)
def test_a_fault_in_a_deck_parts_lammps_from_the_twin(change: Change, solved: Solve) -> None:
    scene = _damped(CHAIN, "coeff_restitution", COEFFICIENTS["coeff_restitution"])
    sound = solved(scene, ENGINE, dt=STEP, uncertainty=False)
    # the gate of the show; sound ones are three decades below
    assert _far(_run_with(change, scene), sound) > 1e-9


def _run_with(change: Change, scene: Scene) -> Any:
    sampling = Sampling(count=scene.samples)
    case = Case(scene=scene, backend=ENGINE, resolution=Resolution(dt=STEP), sampling=sampling, uncertainty=False)
    result = run_with(change, case)
    assert result.trajectory is not None
    return result.trajectory
