"""LAMMPS, the code under test: beside the twin at the same step, beside the truth, and when things go wrong."""

from __future__ import annotations

import math
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given

import dem_bridge as db
from dem_bridge.backends import lammps
from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.prescan import prescan_hertz
from dem_bridge.backends.surrogate_radius import radius_after
from dem_bridge.errors import RunBroken, UnsupportedScene, UsageError
from dem_bridge.lmp.binary_dump import read_binary_dump
from dem_bridge.lmp.process import EngineReport, run_deck
from dem_bridge.observables.convergence import observed_order
from dem_bridge.scene.file import MAIN_SCENES
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.trajectory.dense import schedule
from dem_bridge.trajectory.trajectory import Trajectory
from tests.backends.test_verlet import REFINEMENT
from tests.conftest import Solve
from tests.helpers.dumps import frame
from tests.helpers.quadruple_truth import Truth
from tests.helpers.strategies import examples, scenes

EPS = float(np.finfo(float).eps)
ENGINE, TWIN = "lammps-granular", "verlet"
INPUTS = Path(__file__).parents[2] / "lammps_inputs"

PAIR = Scene(name="pair", duration=1e-4, mass=(8.1e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=10)

#: what a sound LAMMPS may differ by from its twin, relative to the largest velocity: round-off, measured at 2e-9 in 3e5
#: steps of 41 bodies and below 1e-12 in short scenes. A coefficient that is wrong by 1e-6 differs by 1e-7.
ROUND_OFF = 5e-9


def _apart(run: Trajectory, other: Trajectory) -> float:
    """Largest difference of velocities over the largest velocity."""
    return float(np.max(np.abs(run.velocity - other.velocity)) / np.max(np.abs(other.velocity)))


# the paper's chains


@pytest.mark.lammps
def test_lammps_repeats_its_twin_on_the_papers_chains(free_chain: Truth, solved: Solve) -> None:
    run, twin = (solved(free_chain.scene, name, dt=1e-8) for name in (ENGINE, TWIN))
    assert np.max(np.abs(run.velocity - twin.velocity)) < ROUND_OFF * free_chain.v0
    # the estimator of peaks and crossings is the same; forces and times differ by the same round-off
    assert run.peak_force == pytest.approx(twin.peak_force, rel=ROUND_OFF)
    assert run.crossing_time == pytest.approx(twin.crossing_time, rel=ROUND_OFF)


@pytest.mark.lammps
def test_lammps_is_a_time_step_away_from_the_truth(free_chain: Truth, solved: Solve) -> None:
    run = solved(free_chain.scene, ENGINE, dt=1e-8)
    # 1.4e-6 and 1.1e-6 of v0 were measured (LAMMPS.md); three times that is another integrator
    assert free_chain.error(run, "velocity") < 4e-6 * free_chain.v0


@pytest.mark.lammps
@pytest.mark.parametrize("chain", ["accelerating", pytest.param("decelerating", marks=pytest.mark.slow)])
def test_the_order_of_lammps_is_two(chain: str, solved: Solve, request: pytest.FixtureRequest) -> None:
    truth: Truth = request.getfixturevalue(chain)
    runs = [solved(truth.scene, ENGINE, dt=dt, uncertainty=False) for dt in REFINEMENT]
    fit = observed_order(REFINEMENT, [float(truth.error(run, "velocity")) for run in runs])
    # round-off (2e-9) is three decades below the smallest of these errors
    assert (fit.points, fit.order) == (4, pytest.approx(2.0, abs=0.05))
    assert fit.residual < 0.02


@pytest.mark.lammps
def test_the_bars_of_lammps_hold(free_chain: Truth, solved: Solve) -> None:
    run = solved(free_chain.scene, ENGINE, dt=1e-8)
    for quantity, bar in run.uncertainty.items():
        assert np.all(free_chain.error(run, quantity) <= bar), quantity
    assert run.uncertainty["velocity"] <= 5.0 * free_chain.error(run, "velocity")


@pytest.mark.lammps
def test_the_ill_conditioned_wall_is_within_its_bars(walled: Truth, solved: Solve) -> None:
    run, twin = (solved(walled.scene, name, dt=1e-8) for name in (ENGINE, TWIN))
    for quantity, bar in run.uncertainty.items():
        assert np.all(walled.error(run, quantity) <= bar), quantity
    # round-off is magnified by the scene's condition, which the bar knows
    round_off = run.uncertainty.parts["round_off"] * float(np.max(np.abs(twin.velocity)))
    assert np.max(np.abs(run.velocity - twin.velocity)) <= round_off
    assert round_off < 1e-5 * walled.v0


@pytest.mark.lammps
def test_one_collision_is_the_exact_one(two_bodies: Truth, solved: Solve) -> None:
    run = solved(two_bodies.scene, ENGINE, dt=1e-8)
    for quantity, bar in run.uncertainty.items():
        assert np.all(two_bodies.error(run, quantity) <= bar), quantity
    # (omega dt)^2 / 24 with omega = 5e4 rad/s is 1e-8; 2e-8 was measured
    assert run.velocity[-1] == pytest.approx([-0.087009983, 0.712990017], abs=5e-8 * 0.8)


# all that a scene can have

SCENES = {
    "between walls": replace(
        PAIR, duration=3e-4, wall_left=Wall(stiffness=3e9, gap=2e-6), wall_right=Wall(stiffness=2e9)
    ),
    "gaps": Scene(
        name="gaps",
        duration=2e-4,
        mass=(8e-3, 1e-2, 2e-2),
        stiffness=(4e9, 5e9),
        velocity=(0.8, 0.0, 0.0),
        gap=(1e-6, 3e-5),
        samples=10,
    ),
    "gravity": replace(PAIR, gravity=1e3),
    "gravity towards the struck end": replace(PAIR, gravity=-1e3, wall_left=Wall(stiffness=1e9)),
    "one body between two walls": Scene(
        name="one",
        duration=4e-4,
        mass=(1e-2,),
        stiffness=(),
        velocity=(0.5,),
        wall_left=Wall(stiffness=1e9, gap=1e-5),
        wall_right=Wall(stiffness=2e9, gap=3e-5),
        samples=20,
    ),
    "initial overlap": replace(PAIR, velocity=(0.0, 0.0), gap=-4e-6),
    "initial overlap with a wall": replace(PAIR, wall_right=Wall(stiffness=1e9, gap=-2e-6)),
    "the last body strikes": replace(PAIR, velocity=(0.0, -0.8)),
    "nothing touches": replace(PAIR, velocity=(0.0, 0.8)),
    # 3e6 radii: so many bins that there are fewer and larger ones, and a box that is wide enough for them
    "bodies that part and fly far": replace(PAIR, velocity=(0.0, 1e6)),
    "one free body": Scene(name="free", duration=1e-4, mass=(1e-2,), stiffness=(), velocity=(0.5,), samples=10),
}


@pytest.mark.lammps
@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
def test_lammps_repeats_its_twin_on_every_kind_of_scene(scene: Scene) -> None:
    run, twin = (db.solve(scene, backend=name, dt=5e-8, uncertainty=False) for name in (ENGINE, TWIN))
    # 8000 steps of a few bodies: three decades less round-off than on the paper's chains
    allowed = 1e-11
    assert _apart(run, twin) < allowed
    length, force = float(np.max(np.abs(twin.displacement))), float(np.max(twin.contact_force, initial=0.0))
    assert run.displacement == pytest.approx(twin.displacement, abs=allowed * length)
    assert run.contact_force == pytest.approx(twin.contact_force, abs=10.0 * allowed * force)
    assert run.peak_force == pytest.approx(twin.peak_force, abs=10.0 * allowed * force)
    assert run.crossing_time == pytest.approx(twin.crossing_time, abs=10.0 * allowed * scene.duration, nan_ok=True)


@pytest.mark.slow
@pytest.mark.lammps
@examples(8)
@given(scene=scenes(bodies=(1, 6), walls=True, gravity=True))
def test_lammps_repeats_its_twin_on_random_scenes(scene: Scene) -> None:
    run, twin = (db.solve(scene, backend=name, dt=1e-7) for name in (ENGINE, TWIN))
    parts = run.uncertainty.parts
    speed = float(np.max(np.abs(twin.velocity)))
    assert np.max(np.abs(run.velocity - twin.velocity)) <= parts["round_off"] * speed
    assert parts["round_off"] < 1e-9


@pytest.mark.lammps
def test_a_prime_number_of_steps_per_sample_gives_the_right_samples() -> None:
    scene = replace(PAIR, duration=2e-4, samples=20)
    dt = scene.duration / 20 / 601
    run, twin = (db.solve(scene, backend=name, dt=dt, uncertainty=False) for name in (ENGINE, TWIN))
    assert run.cost.steps == 601 * 20
    assert run.provenance["settings"]["dt"] == pytest.approx(dt, rel=4.0 * EPS)
    np.testing.assert_array_equal(run.time, np.linspace(0.0, 2e-4, 21))
    # a sample one step too early or late would differ by a dt = 1e-3 of v0
    assert _apart(run, twin) < 1e-11
    assert run.crossing_time == pytest.approx(twin.crossing_time, rel=1e-10)


@pytest.mark.lammps
@pytest.mark.parametrize("radius", [2.0**-16, 3e-5, 1e-3])
def test_the_surrogate_radius_changes_nothing_but_round_off(radius: float) -> None:
    run, twin = db.solve(PAIR, backend=ENGINE, dt=1e-7, surrogate_radius=radius), db.solve(PAIR, backend=TWIN, dt=1e-7)
    assert run.provenance["settings"]["surrogate_radius"] == radius
    # positions of 2 R lose ulp(2 R) in each of 1000 steps, against an overlap of 1e-5 m
    assert _apart(run, twin) < 1000 * EPS * (1.0 + 4.0 * radius / 1e-5)
    assert _apart(run, twin) <= run.uncertainty["velocity"] / 0.8


@pytest.mark.lammps
def test_the_birth_certificate_names_engine_and_deck(solved: Solve) -> None:
    run = solved(PAIR, ENGINE, dt=1e-7)
    deck = lammps.LammpsGranular().deck(PAIR, Resolution(dt=1e-7), Sampling(count=10))
    assert run.provenance["deck_hash"] == deck.content_hash
    assert run.provenance["lammps"]["version"] >= 20250722
    assert "GRANULAR" in run.provenance["lammps"]["packages"]
    assert run.provenance["atom_types"] == 1


# when things go wrong


@pytest.mark.lammps
@pytest.mark.parametrize("share", [0.99, 0.6, 0.3])
def test_overlaps_beyond_the_gauge_are_a_broken_run_with_the_numbers(
    share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    # a coarse run that sees too little: only the check after the run is left
    prescan = prescan_hertz(PAIR)
    monkeypatch.setattr(lammps, "prescan_scene", lambda _: replace(prescan, peak_overlap=0.1 * prescan.peak_overlap))
    exact = float((db.solve(PAIR, backend="scipy", uncertainty=False).peak_force[0] / 4e9) ** (2.0 / 3.0))
    with pytest.raises(RunBroken, match="give a larger surrogate_radius") as caught:
        db.solve(PAIR, backend=ENGINE, dt=1e-7, surrogate_radius=share * exact, uncertainty=False)
    assert f"gauge radius {share * exact:.6g} m" in str(caught.value)


#: two bodies press a third between them
SQUEEZED = Scene(
    name="squeezed", duration=5e-5, mass=(8e-3, 1e-2, 8e-3), stiffness=(4e9, 4e9), velocity=(0.8, 0.0, -0.8), samples=10
)


@pytest.mark.lammps
def test_bodies_that_touch_across_another_are_a_broken_run_with_the_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    # the coarse run is told of a tenth: a radius that is too small is not refused, and LAMMPS lets body 0 touch body 2
    prescan = prescan_hertz(SQUEEZED)
    radius = 0.8 * float(np.max(prescan.peak_overlap))
    monkeypatch.setattr(lammps, "prescan_scene", lambda _: replace(prescan, peak_overlap=0.1 * prescan.peak_overlap))
    with pytest.raises(RunBroken, match="atoms 1 and 3, which are not neighbours, overlap by") as caught:
        db.solve(SQUEEZED, backend=ENGINE, dt=1e-7, surrogate_radius=radius, uncertainty=False)
    assert f"exceeds the gauge radius {radius:.6g} m" in str(caught.value)
    assert "give a larger surrogate_radius" in str(caught.value)


@pytest.mark.parametrize("sound", [True, False])
def test_the_numbers_are_those_of_the_bodies_that_touch(sound: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    prescan = prescan_hertz(SQUEEZED)
    radius = radius_after(prescan)
    plan = schedule(duration=SQUEEZED.duration, samples=10, dt=1e-6, frequency=prescan.frequency, bodies=3)
    # at the last look the two contacts are closed by 1.3 and 0.9 radii: 0.2 radii more than there is room for
    places = [(0.0, 2.0, 4.0)] * (len(plan.dense_steps) - 1) + [(0.0, 2.0, 4.0) if sound else (1.3, 2.0, 3.1)]
    dump = b"".join(
        frame(int(step), [[i + 1.0, 1.0, x * radius, 0.0, 0.0, 0.0, 0.0] for i, x in enumerate(row)])
        for step, row in zip(plan.dense_steps, places, strict=True)
    )
    monkeypatch.setattr(lammps, "run_deck", _answering(dump))
    if sound:
        assert not np.any(db.solve(SQUEEZED, backend=ENGINE, dt=1e-6, uncertainty=False).velocity)
        return
    words = f"atoms 1 and 3, which are not neighbours, overlap by {0.2 * radius:.6g} m at step {plan.steps}"
    with pytest.raises(RunBroken, match=f"an overlap of {1.3 * radius:.6g} m exceeds .*{words}"):
        db.solve(SQUEEZED, backend=ENGINE, dt=1e-6, uncertainty=False)


def test_a_surrogate_radius_below_the_overlap_is_refused_before_the_run() -> None:
    with pytest.raises(UsageError, match=r"surrogate_radius = 1e-06 m; allowed: more than the largest overlap, 1\.5"):
        db.solve(PAIR, backend=ENGINE, dt=1e-7, surrogate_radius=1e-6)


@pytest.mark.lammps
def test_a_large_step_within_stability_gives_a_finite_run_that_is_off_by_a_percent(decelerating: Truth) -> None:
    run = db.solve(decelerating.scene, backend=ENGINE, dt=1e-6, uncertainty=False)
    for name in ("displacement", "contact_force", "peak_force"):
        assert np.all(np.isfinite(getattr(run, name))), name
    # measured: 1.08 % of v0, as for the twin
    assert decelerating.error(run, "velocity") == pytest.approx(0.0108 * decelerating.v0, rel=0.01)


@pytest.mark.lammps
@pytest.mark.parametrize("dt", [1e-5, 1e-4])
def test_a_step_beyond_stability_is_a_broken_run_and_never_nan(decelerating: Truth, dt: float) -> None:
    # LAMMPS itself ends without an error: bodies have passed through each other
    with pytest.raises(RunBroken, match=r"an overlap of \S+ m exceeds .*not neighbours, overlap by \S+ m at step \d+"):
        db.solve(decelerating.scene, backend=ENGINE, dt=dt, samples=10, uncertainty=False)


def _answering(content: bytes) -> object:
    """A stand-in for run_deck that leaves ``content`` as the dump."""

    def run(folder: Path, input_file: str, **_: object) -> EngineReport:
        (folder / f"dump.{input_file.removeprefix('in.')}.bin").write_bytes(content)
        return EngineReport(version=20250722, packages=("GRANULAR",), wall=0.0, cpu=0.0)

    return run


def _frames(**changes: object) -> bytes:
    """A dump as LAMMPS would write it for PAIR at dt = 1e-6: nothing moves."""
    prescan = prescan_hertz(PAIR)
    plan = schedule(duration=PAIR.duration, samples=10, dt=1e-6, frequency=prescan.frequency, bodies=2)
    rows = [[1.0, 1.0, 0.0, 0.0, 0.0, 0.8, 0.0], [2.0, 1.0, 2.0 * radius_after(prescan), 0.0, 0.0, 0.0, 0.0]]
    return b"".join(frame(int(step), rows, **changes) for step in plan.dense_steps)  # type: ignore[arg-type]


def test_a_sound_dump_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lammps, "run_deck", _answering(_frames()))
    run = db.solve(PAIR, backend=ENGINE, dt=1e-6, uncertainty=False)
    assert run.velocity.tolist() == [[0.8, 0.0]] * 11


def test_a_dump_cut_at_the_end_of_a_frame_is_a_broken_run(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = _frames()
    length = len(frame(0, [[0.0] * 7] * 2))
    monkeypatch.setattr(lammps, "run_deck", _answering(whole[: -3 * length]))
    count = len(whole) // length
    with pytest.raises(RunBroken, match=f"LAMMPS dumped {count - 3} frames of 2 atoms; the deck asks for {count} of 2"):
        db.solve(PAIR, backend=ENGINE, dt=1e-6, uncertainty=False)


def test_a_dump_cut_within_a_frame_is_a_broken_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lammps, "run_deck", _answering(_frames()[:-5]))
    with pytest.raises(RunBroken, match=r"dump\.pair\.bin: frame \d+ is incomplete"):
        db.solve(PAIR, backend=ENGINE, dt=1e-6, uncertainty=False)


def test_a_dump_without_a_number_of_atoms_that_fits_is_a_broken_run(monkeypatch: pytest.MonkeyPatch) -> None:
    prescan = prescan_hertz(PAIR)
    plan = schedule(duration=PAIR.duration, samples=10, dt=1e-6, frequency=prescan.frequency, bodies=2)
    dump = b"".join(frame(int(step), [[1.0, 1.0, 0.0, 0.0, 0.0, 0.8, 0.0]]) for step in plan.dense_steps)
    monkeypatch.setattr(lammps, "run_deck", _answering(dump))
    with pytest.raises(RunBroken, match="frames of 1 atoms; the deck asks for"):
        db.solve(PAIR, backend=ENGINE, dt=1e-6, uncertainty=False)


def test_an_empty_dump_is_a_broken_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lammps, "run_deck", _answering(b""))
    with pytest.raises(RunBroken, match=r"dump\.pair\.bin: the dump is empty"):
        db.solve(PAIR, backend=ENGINE, dt=1e-6, uncertainty=False)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_values_that_are_not_finite_are_a_broken_run_with_the_step(monkeypatch: pytest.MonkeyPatch, bad: float) -> None:
    frames = _frames()
    length = len(frame(0, [[0.0] * 7] * 2))
    late = frame(100, [[1.0, 1.0, 0.0, 0.0, 0.0, bad, 0.0], [2.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0]])
    monkeypatch.setattr(lammps, "run_deck", _answering(frames[:-length] + late))
    with pytest.raises(RunBroken, match="without an error, but from step 100 on its values are not finite"):
        db.solve(PAIR, backend=ENGINE, dt=1e-6, uncertainty=False)


def test_an_exponent_that_lammps_does_not_have_is_refused_before_anything_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lammps, "run_deck", lambda *_, **__: pytest.fail("LAMMPS was started"))
    with pytest.raises(UnsupportedScene, match=r"lammps-granular cannot do pair: contact 0 has exponent n = 3\.0"):
        db.solve(replace(PAIR, exponent=3.0), backend=ENGINE)


def test_bodies_so_far_apart_that_positions_hide_overlaps_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    far = replace(PAIR, mass=(1e-2, *PAIR.mass), stiffness=(4e9, *PAIR.stiffness), exponent=2.5,
                  velocity=(0.0, *PAIR.velocity), gap=(1e12, 0.0))  # fmt: skip
    monkeypatch.setattr(lammps, "run_deck", lambda *_, **__: pytest.fail("LAMMPS was started"))
    with pytest.raises(
        UnsupportedScene, match=r"known to 0\.00012 m, and overlaps are of .*; take backend='reference'"
    ):
        db.solve(far, backend=ENGINE)


# the committed decks, by LAMMPS alone


@pytest.mark.lammps
@pytest.mark.parametrize("kind", ["", "-physical"])
@pytest.mark.parametrize("name", MAIN_SCENES)
def test_a_committed_deck_runs_by_the_lmp_program_alone(name: str, kind: str, tmp_path: Path) -> None:
    folder = tmp_path / name
    shutil.copytree(INPUTS / f"{name}{kind}", folder)
    program = Path(sys.executable).with_name("lmp")
    words = [str(program), "-in", f"in.{name}", "-var", "steps", "600", "-var", "dump", "dump.txt", "-nocite"]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr
    rows = (folder / "dump.txt").read_text().split("ITEM: ATOMS id type x y z vx fx")[-1].splitlines()[1:]
    values = np.array([[float(word) for word in row.split()] for row in rows])
    # 600 steps are the first sample; the twin makes the same
    twin = db.solve(replace(db.load_scene(name), duration=6e-6, samples=1), backend=TWIN, dt=1e-8, uncertainty=False)
    assert values[:, 0].tolist() == list(range(1, 42))
    assert values[:, 5] == pytest.approx(twin.velocity[-1], abs=1e-12)


@pytest.mark.lammps
def test_a_written_deck_says_the_same_as_the_backend(tmp_path: Path, solved: Solve) -> None:
    db.write_deck(PAIR, tmp_path, dt=1e-7)
    run_deck(tmp_path, "in.pair", time_limit=60.0)
    _, values = read_binary_dump(tmp_path / "dump.pair.bin", columns=7)
    assert values[-1, :, 5].tolist() == solved(PAIR, ENGINE, dt=1e-7).velocity[-1].tolist()
