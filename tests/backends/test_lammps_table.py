"""LAMMPS with tables: bit for bit the twin with the same tables, within its bars of the truth, and refused beyond."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.errors import RunBroken, UnsupportedScene, UsageError
from dem_bridge.lmp import pair_coefficients
from dem_bridge.scene.file import MAIN_SCENES
from dem_bridge.scene.scene import Damping, Scene, Wall
from dem_bridge.trajectory.trajectory import Trajectory
from tests.conftest import Solve
from tests.helpers.fault_judging import FREE
from tests.helpers.strategies import stiffness_for

pytestmark = pytest.mark.lammps

EPS = float(np.finfo(float).eps)
ENGINE, TWIN = "lammps-table", "verlet"


def _stiffness(exponent: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(stiffness_for(n, hertz) for n, hertz in zip(exponent, (4e9, 5e9, 8e9), strict=True))


def _wall(exponent: float, hertz: float, gap: float = 0.0) -> Wall:
    return Wall(stiffness=stiffness_for(exponent, hertz), exponent=exponent, gap=gap)


#: four bodies that collide several times; exponents differ along the chain, and those of the walls are others again
MIXED = Scene(
    name="mixed",
    duration=3e-4,
    mass=(8e-3, 1e-2, 2e-2, 1.2e-2),
    stiffness=_stiffness((2.2, 5.0, 3.0)),
    exponent=(2.2, 5.0, 3.0),
    velocity=(0.8, 0.0, 0.0, -0.1),
    samples=30,
)
WALLED = replace(MIXED, name="walled", wall_left=_wall(2.7, 3e9, 1e-6), wall_right=_wall(4.0, 2e9, 5e-6))
DASHPOT = Damping(law="dashpot", coefficient=5.0)


def _same(exponent: float) -> Scene:
    return replace(MIXED, exponent=(exponent,) * 3, stiffness=_stiffness((exponent,) * 3))


def _twin(run: Trajectory, scene: Scene | str, **settings: Any) -> Trajectory:
    """The twin in positions with the same tables, at the same step."""
    how = {"dt": run.provenance["settings"]["dt"], "surrogate_radius": run.provenance["settings"]["surrogate_radius"]}
    return db.solve(scene, backend=TWIN, tables=True, uncertainty=False, **how, **settings)


def _in_overlaps(run: Trajectory, scene: Scene) -> Trajectory:
    """The twin with the same tables and without positions."""
    return db.solve(scene, backend=TWIN, tables=True, uncertainty=False, dt=run.provenance["settings"]["dt"])


def _apart(one: Trajectory, other: Trajectory) -> float:
    """Largest difference of velocities over the largest velocity."""
    return float(np.max(np.abs(one.velocity - other.velocity)) / np.max(np.abs(other.velocity)))


def _assert_equal(run: Trajectory, twin: Trajectory, contacts: int) -> None:
    """Motion bit for bit; forces come as running sums of net forces: half an ulp of the largest for each contact."""
    np.testing.assert_array_equal(run.velocity, twin.velocity)
    np.testing.assert_array_equal(run.displacement, twin.displacement)
    largest = float(np.max(twin.peak_force))
    assert run.contact_force == pytest.approx(twin.contact_force, rel=0.0, abs=contacts * EPS * largest)


# beside the twin


@pytest.mark.parametrize("settings", [{}, {"table_style": "linear"}])
@pytest.mark.parametrize("name", MAIN_SCENES)
def test_lammps_is_its_twin_bit_for_bit_on_the_shipped_chains(
    name: str, settings: dict[str, Any], solved: Solve
) -> None:
    scene = db.load_scene(name)
    run = solved(scene, ENGINE, dt=1e-7, **settings)
    _assert_equal(run, _twin(run, scene, **settings), 40)


@pytest.mark.slow
@pytest.mark.parametrize("name", MAIN_SCENES)
def test_types_and_radius_leave_lammps_its_twin_bit_for_bit(name: str, solved: Solve) -> None:
    scene = db.load_scene(name)
    euler = solved(scene, ENGINE, dt=1e-7)
    per_body = solved(scene, ENGINE, dt=1e-7, types="per-body", uncertainty=False)
    assert (euler.provenance["atom_types"], per_body.provenance["atom_types"]) == (9, 41)
    for quantity in ("velocity", "displacement", "contact_force", "peak_force", "crossing_time"):
        np.testing.assert_array_equal(getattr(euler, quantity), getattr(per_body, quantity))
    # a radius that is no power of two: positions are rounded from the start on
    physical = solved(scene, ENGINE, dt=1e-7, geometry="physical")
    assert physical.provenance["settings"]["surrogate_radius"] == 0.009
    _assert_equal(physical, _twin(physical, scene), 40)


#: nothing but contacts: LAMMPS adds at most two forces to a body, in whatever order
EXACT = {
    "n = 2": _same(2.0),
    "n = 2.2": _same(2.2),
    "n = 5/2": _same(2.5),
    "n = 3": _same(3.0),
    "n = 5": _same(5.0),
    "mixed": MIXED,
    "between walls of other exponents": WALLED,
    "gaps": replace(WALLED, gap=(1e-6, 0.0, 3.3e-5)),
    "initial overlaps": replace(MIXED, gap=(-5e-7, -4e-6, 0.0), velocity=(0.0, 0.0, 0.0, 0.0)),
    "one contact and a wall": Scene(
        name="two", duration=3e-4, mass=(1e-2, 2e-2), stiffness=(stiffness_for(3.5, 4e9),), exponent=3.5,
        velocity=(0.5, 0.0), wall_right=_wall(2.1, 2e9), samples=30,
    ),
}  # fmt: skip
#: weight, drag and damping are added as well: then the last digit depends on the order, and grows as round-off does
ROUNDED = {
    "weight": replace(WALLED, gravity=500.0),
    "precompression": replace(MIXED, precompression=20.0),
    "precompression by walls, with weight": replace(
        MIXED, precompression=20.0, gravity=9.81, wall_left=_wall(2.7, 3e9), wall_right=_wall(4.0, 2e9)
    ),
    "drag": replace(WALLED, drag=300.0),
    "dashpots beside tables": replace(WALLED, damping=DASHPOT),
    "a dashpot in one contact": replace(MIXED, damping=Damping(law="dashpot", coefficient=(0.0, 5.0, 0.0))),
    "dashpots, some clipped": replace(
        MIXED, exponent=(2.5, 3.0, 2.0), stiffness=_stiffness((2.5, 3.0, 2.0)), damping=DASHPOT
    ),
    "Kuwabara-Kono damping where granular has it": replace(
        MIXED,
        exponent=(2.5, 3.0, 2.0),
        stiffness=_stiffness((2.5, 3.0, 2.0)),
        damping=Damping(law="kuwabara-kono", coefficient=(2e-6, 0.0, 2e-6)),
    ),
}


@pytest.mark.parametrize("scene", EXACT.values(), ids=EXACT)
def test_lammps_is_its_twin_bit_for_bit_on_every_kind_of_contact(scene: Scene) -> None:
    run = db.solve(scene, backend=ENGINE, dt=1e-7, uncertainty=False)
    twin = _twin(run, scene)
    _assert_equal(run, twin, scene.n_contact)
    assert np.count_nonzero(twin.peak_force) == scene.n_contact, "a contact that never closes shows nothing"


@pytest.mark.parametrize("scene", ROUNDED.values(), ids=ROUNDED)
def test_lammps_is_its_twin_but_for_the_order_of_sums(scene: Scene) -> None:
    run = db.solve(scene, backend=ENGINE, dt=1e-7)
    twin = _twin(run, scene)
    predicted = run.uncertainty.parts["round_off"]
    assert _apart(run, twin) <= predicted < 1e-11
    # against the truth the bar also covers that dashpots beside tables may pull
    truth = db.solve(scene, backend="scipy", uncertainty=False)
    assert _inside(run, truth, "velocity")
    assert _inside(run, truth, "peak_force")


def test_a_dashpot_beside_a_table_pulls_where_granular_clips_and_the_bar_says_so() -> None:
    scene = Scene(
        name="pulls", duration=2e-4, mass=(1e-2, 1e-2), stiffness=(stiffness_for(3.0, 4e9),), exponent=3.0,
        velocity=(0.8, 0.0), damping=Damping(law="dashpot", coefficient=50.0), samples=40,
    )  # fmt: skip
    run, truth = db.solve(scene, backend=ENGINE, dt=1e-7), db.solve(scene, backend="scipy", uncertainty=False)
    assert np.min(run.contact_force) < 0.0 <= np.min(truth.contact_force)
    # a pull that is far more than time step and round-off: without it the bar would not hold
    parts = run.uncertainty.parts
    assert parts["table"] > 10.0 * (parts["time_step"] + parts["round_off"])
    assert _inside(run, truth, "velocity")
    clip = replace(scene, exponent=2.5, stiffness=(4e9,))
    assert np.min(db.solve(clip, backend=ENGINE, dt=1e-7, uncertainty=False).contact_force) >= 0.0


def test_the_round_off_of_a_sound_run_is_predicted_where_laws_alone_would_predict_half_of_it() -> None:
    exponent = (2.3, 3.0, 2.8)
    scene = replace(FREE, exponent=exponent, stiffness=tuple(map(stiffness_for, exponent, FREE.stiffness)), samples=150)
    run = db.solve(scene, backend=ENGINE, dt=1e-8)
    radii = (None, 2.0**-15)
    twins = [db.solve(scene, backend=TWIN, dt=1e-8, uncertainty=False, surrogate_radius=radius) for radius in radii]
    round_off = run.uncertainty.parts["round_off"]
    # three realisations of it, and the last digit
    assert 3.0 * (_apart(*twins) + math.sqrt(15_000) * EPS) < _apart(run, _in_overlaps(run, scene)) <= round_off


# geometry


def test_a_scene_without_a_spacing_has_no_physical_geometry() -> None:
    for backend in (ENGINE, "lammps-granular"):
        with pytest.raises(
            UsageError, match=r"geometry = 'physical' on mixed, which has no spacing .* allowed: 'surrogate'"
        ):
            db.solve(replace(MIXED, exponent=2.5), backend=backend, dt=1e-7, geometry="physical")


@pytest.mark.slow
@pytest.mark.parametrize("dt", [1e-7, 2e-8])
@pytest.mark.parametrize("name", MAIN_SCENES)
def test_the_round_off_of_9_mm_is_that_predicted_within_a_factor_3(name: str, dt: float, solved: Solve) -> None:
    scene = db.load_scene(name)
    run = solved(scene, ENGINE, dt=dt, geometry="physical")
    floor = run.uncertainty.roundoff_floor
    assert floor / 3.0 < _apart(run, _in_overlaps(run, scene)) < 3.0 * floor


@pytest.mark.slow
def test_an_accuracy_below_the_floor_of_9_mm_is_refused_with_the_floor() -> None:
    with pytest.raises(
        UsageError, match=r"accuracy = 1e-07 .*radius of 0\.009 m is (\S+) of .*geometry='surrogate'"
    ) as caught:
        db.solve("decelerating-40", backend=ENGINE, accuracy=1e-7, geometry="physical")
    said = float(str(caught.value).split("0.009 m is ")[1].split()[0])
    step = float(str(caught.value).split("at dt = ")[1].split()[0])
    runs = [
        db.solve("decelerating-40", backend=TWIN, dt=step, surrogate_radius=r, uncertainty=False) for r in (0.009, None)
    ]
    assert said == pytest.approx(_apart(*runs), rel=0.1)  # two digits are said
    assert "\n" not in str(caught.value)


# the error of a table


@pytest.mark.parametrize("style", ["spline", "linear"])
@pytest.mark.parametrize("name", MAIN_SCENES)
def test_the_error_of_interpolation_is_that_predicted_within_a_factor_2(name: str, style: str, solved: Solve) -> None:
    told = solved(db.load_scene(name), ENGINE, dt=1e-7, **({} if style == "spline" else {"table_style": style}))
    told = told.provenance["table"]
    assert told["style"] == style
    assert 0.5 < told["measured_error"] / told["predicted_error"] < 2.0
    assert told["predicted_error"] < {"spline": 1e-8, "linear": 2e-7}[style]


def _inside(run: Trajectory, truth: Trajectory, quantity: str) -> bool:
    """The truth, whose own error is far below, is within the run's bar."""
    away = np.nan_to_num(np.abs(getattr(run, quantity) - getattr(truth, quantity)))
    return bool(np.all(away <= run.uncertainty[quantity]))


def _random(seed: int) -> Scene:
    """Two to six bodies with contacts of any exponent, gaps, walls, weight."""
    rng = np.random.default_rng([4, seed])
    n = int(rng.integers(2, 7))
    exponent = rng.uniform(2.0, 5.0, n + 1).tolist()
    hertz = (10.0 ** rng.uniform(8.5, 10.5, n + 1)).tolist()
    walls = [
        _wall(exponent[k], hertz[k], float(rng.choice([0.0, 5e-6]))) if rng.random() < 0.5 else None for k in (-1, -2)
    ]
    return Scene(
        name=f"random-{seed}",
        duration=3e-4,
        mass=tuple((10.0 ** rng.uniform(-2.5, -1.5, n)).tolist()),
        stiffness=tuple(stiffness_for(e, h) for e, h in zip(exponent[: n - 1], hertz, strict=False)),
        exponent=tuple(exponent[: n - 1]),
        gap=tuple(rng.choice([0.0, 1e-6, 2e-5, -5e-7], n - 1).tolist()),
        velocity=(float(rng.uniform(0.2, 2.0)), *rng.choice([0.0, -0.3, 0.1], n - 1).tolist()),
        wall_left=walls[0],
        wall_right=walls[1],
        gravity=float(rng.choice([0.0, 9.81, -500.0])),
        samples=20,
    )  # fmt: skip


@pytest.mark.parametrize("seeds", [range(4), pytest.param(range(4, 15), marks=pytest.mark.slow)], ids=["few", "more"])
def test_the_bars_hold_on_random_scenes_of_any_exponents(seeds: range) -> None:
    outside, tried = [], 0
    for seed in seeds:
        scene = _random(seed)
        run, truth = db.solve(scene, backend=ENGINE, dt=1e-7), db.solve(scene, backend="scipy", uncertainty=False)
        round_off = run.uncertainty.parts["round_off"]
        assert _apart(run, _twin(run, scene)) <= round_off
        # a distance that is looked up in a table is rounded, too
        assert _apart(run, _in_overlaps(run, scene)) <= round_off
        tried += 1
        outside += [(seed, quantity) for quantity in run.uncertainty if not _inside(run, truth, quantity)]
    assert tried == len(seeds)
    assert outside == []


@pytest.mark.parametrize("accuracy", [1e-4, 1e-6])
def test_an_accuracy_asked_for_is_kept(accuracy: float) -> None:
    run, truth = (
        db.solve(WALLED, backend=ENGINE, accuracy=accuracy),
        db.solve(WALLED, backend="scipy", uncertainty=False),
    )
    assert _apart(run, truth) <= accuracy
    assert run.uncertainty["velocity"] <= accuracy * float(np.max(np.abs(run.velocity)))


def test_an_accuracy_below_the_error_of_the_tables_is_refused_with_what_would_help() -> None:
    with pytest.raises(
        UsageError, match=r"accuracy = 1e-06 .*error of the tables is \S+ of .*\(take more table_points"
    ):
        db.solve(WALLED, backend=ENGINE, accuracy=1e-6, table_points=100)


# when things go wrong


def test_an_overlap_beyond_the_table_is_a_broken_run_in_lammps_own_words(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pair_coefficients, "MARGIN", 0.5)
    with pytest.raises(RunBroken, match="Pair distance < table inner cutoff"):
        db.solve(MIXED, backend=ENGINE, dt=1e-7, uncertainty=False)


@pytest.mark.parametrize("exponent", [1.999, 5.001])
def test_an_exponent_that_tables_do_not_have_is_refused_with_contact_and_value(exponent: float) -> None:
    scene = replace(MIXED, exponent=(2.5, 3.0, exponent))
    with pytest.raises(UnsupportedScene, match=f"lammps-table cannot do mixed: contact 2 has exponent n = {exponent}"):
        db.solve(scene, backend=ENGINE)


def test_kuwabara_kono_damping_that_lammps_does_not_have_is_refused() -> None:
    scene = replace(MIXED, damping=Damping(law="kuwabara-kono", coefficient=(0.0, 1e-6, 0.0)))
    with pytest.raises(UnsupportedScene, match=r"contact 1 has Kuwabara-Kono damping and exponent n = 5\.0; .*'scipy'"):
        db.solve(scene, backend=ENGINE)


# by LAMMPS alone


@pytest.mark.slow
def test_a_deck_of_tables_runs_by_the_lmp_program_alone(tmp_path: Path, solved: Solve) -> None:
    program = str(Path(sys.executable).with_name("dem-bridge"))
    words = [program, "deck", "accelerating-40", "--style", "table", "--dt", "1e-7", "-o", str(tmp_path / "deck")]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert len(done.stdout.split()) == 2 + 41
    assert all(len(file.read_text().splitlines()) <= 1000 for file in (tmp_path / "deck").glob("*.table"))
    lmp = [
        str(Path(sys.executable).with_name("lmp")),
        "-in",
        "in.accelerating-40",
        "-var",
        "dump",
        "dump.txt",
        "-nocite",
    ]
    ran = subprocess.run(lmp, cwd=tmp_path / "deck", capture_output=True, text=True, timeout=100)
    assert ran.returncode == 0, ran.stdout[-2000:] + ran.stderr
    rows = (tmp_path / "deck" / "dump.txt").read_text().split("ITEM: ATOMS id type x y z vx fx")[-1].splitlines()[1:]
    run = solved(db.load_scene("accelerating-40"), ENGINE, dt=1e-7)
    assert [float(row.split()[5]) for row in rows] == run.velocity[-1].tolist()
    # LAMMPS warns of forces that are not -dE/dr, and of numbers that are missing
    assert "WARNING" not in ran.stdout
    assert math.isfinite(float(rows[0].split()[5]))
