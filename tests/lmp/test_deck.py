"""Decks say what the scene says, as an independent reader understands them, and never change by themselves."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import dem_bridge as db
from dem_bridge.backends.survey import gauge_radius
from dem_bridge.dense import schedule
from dem_bridge.errors import SceneError
from dem_bridge.lmp.deck import Deck, granular_deck, refusal
from dem_bridge.scene import Damping, Scene, Wall
from tests.lmp.deck_reader import ReadDeck, read_deck
from tests.strategies import examples, log_uniform, scenes
from tests.truth import Truth

INPUTS = Path(__file__).parents[2] / "lammps_inputs"
EPS = float(np.finfo(float).eps)
RADIUS = 2.0**-15

PAIR = Scene(name="pair", duration=1e-4, mass=(8.1e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=10)


def _deck(scene: Scene, radius: float = RADIUS, dt: float = 1e-7) -> Deck:
    plan = schedule(duration=scene.duration, samples=scene.samples, dt=dt, frequency=2e5, bodies=scene.n_body)
    return granular_deck(scene, radius=radius, schedule=plan)


def _read(deck: Deck) -> ReadDeck:
    with TemporaryDirectory() as name:
        folder = Path(name)
        for file, text in deck.files.items():
            (folder / file).write_text(text)
        return read_deck(folder, deck.name)


def _along_the_line(scene: Scene, column: list[float]) -> list[float]:
    """A scene's contacts (chain, wall_left, wall_right) in the order in which they stand."""
    links = scene.n_body - 1
    chain, walls = column[:links], column[links:]
    left = walls[:1] if scene.wall_left is not None else []
    right = walls[-1:] if scene.wall_right is not None else []
    return [*left, *chain, *right]


def _assert_says(read: ReadDeck, scene: Scene, dt: float) -> None:
    """The deck that was read is the scene, number by number."""
    c = scene.contacts
    assert read.masses == list(scene.mass)
    assert read.velocities == list(scene.velocity)
    assert (read.wall_left, read.wall_right) == (scene.wall_left is not None, scene.wall_right is not None)
    assert read.gravity == scene.gravity
    # K = beta / sqrt(R/2) is rounded at the root and the quotient, reading it back at the root and the product
    assert read.stiffnesses == pytest.approx(_along_the_line(scene, c.stiffness.tolist()), rel=2.0 * EPS)
    rounded = 1.0 if math.frexp(0.5 * read.atoms[0].diameter)[0] == 0.5 else 2.0
    ends = zip(read.gaps, _along_the_line(scene, c.gap.tolist()), read.atoms, read.atoms[1:], strict=False)
    for found, gap, one, other in ends:
        # both positions are rounded to half an ulp; so is 2 R i before, unless R is a power of two
        ulp = math.ulp(max(abs(one.place[0]), abs(other.place[0])))
        assert found == pytest.approx(gap, abs=rounded * ulp)
        if rounded == 1.0 and not any(c.gap):
            assert found == gap == 0.0
    assert read.steps * read.dt == pytest.approx(scene.duration, rel=4.0 * EPS)
    assert read.dt <= dt * (1.0 + 1e-11)


@examples(60)
@given(
    scene=scenes(bodies=(1, 12), walls=True, gravity=True),
    radius=log_uniform(2e-5, 1e-2) | st.sampled_from([2.0**-15, 2.0**-12]),
)
def test_the_deck_of_a_random_scene_is_that_scene(scene: Scene, radius: float) -> None:
    # any radius will do, not only the powers of two that runs choose
    _assert_says(_read(_deck(scene, radius=radius)), scene, 1e-7)


@examples(60)
@given(scene=scenes(bodies=(1, 12), walls=True, gravity=True))
def test_every_contact_has_a_pair_of_types_that_no_other_has(scene: Scene) -> None:
    read = _read(_deck(scene))
    assert len(set(read.pairs)) == len(read.pairs) == len(read.atoms) - 1
    assert read.types == max(atom.kind for atom in read.atoms)


def test_the_decks_of_the_truth_files_are_their_scenes(free_chain: Truth, walled: Truth) -> None:
    for scene in (free_chain.scene, walled.scene):
        read = _read(_deck(scene, dt=1e-8))
        _assert_says(read, scene, 1e-8)
        assert read.types == 9  # the smallest odd T with T (T + 1)/2 >= 41 contacts


def test_contacts_that_are_not_neighbours_have_no_stiffness_of_their_own() -> None:
    read = _read(_deck(PAIR))
    assert read.coefficients[1, 1].stiffness > 0.0
    scene = Scene(name="four", duration=1e-4, mass=(1.0,) * 4, stiffness=(1e9,) * 3, velocity=(1.0, 0.0, 0.0, 0.0))
    read = _read(_deck(scene))
    used = {pair for pair, found in read.coefficients.items() if found.stiffness > 0.0}
    assert used == set(read.pairs)


@examples(30)
@given(scene=scenes(bodies=(1, 12), walls=True, gravity=True))
def test_nothing_dissipates_and_nothing_rubs(scene: Scene) -> None:
    for found in _read(_deck(scene)).coefficients.values():
        # `velocity` damping with eta = 0 is exactly no force; `tsuji` never is (LAMMPS manual)
        assert (found.eta, found.damping, found.tangential) == (0.0, "velocity", (0.0, 0.0))


def test_what_lammps_must_be_told_stands_in_the_deck() -> None:
    told = _read(_deck(PAIR)).settings
    assert told["units"] == "si"
    assert told["atom_style"] == "sphere"
    assert told["comm_modify"] == "vel yes"
    assert told["newton"] == "on"
    assert "every 1 check yes" in told["neigh_modify"]
    assert "lost error" in told["thermo_modify"]
    assert "%.17g" in told["thermo_modify"]


def test_a_deck_is_the_same_text_every_time() -> None:
    one, other = _deck(PAIR), _deck(PAIR)
    assert dict(one.files) == dict(other.files)
    assert one.content_hash == other.content_hash


def test_another_scene_has_another_deck_hash() -> None:
    assert _deck(replace(PAIR, stiffness=(5e9,))).content_hash != _deck(PAIR).content_hash


def test_the_header_says_generator_units_and_scene() -> None:
    for text in _deck(PAIR).files.values():
        header = text.splitlines()[0]
        assert header.startswith("# LAMMPS")
        assert "dem_bridge" in header
        assert "UNITS: si" in header
        assert f"SCENE: sha256:{PAIR.content_hash}" in header


def test_numbers_a_person_may_want_to_change_are_variables() -> None:
    deck = _deck(replace(PAIR, gravity=9.81)).files["in.pair"]
    variables = re.findall(r"^variable (\w+) +index", deck, re.MULTILINE)
    assert set(variables) >= {"dt", "steps", "per_sample", "dense", "dump", "gravity"}


def test_a_deck_knows_its_line_weights_and_mobilities() -> None:
    left, right = Wall(stiffness=1e9, gap=1e-6), Wall(stiffness=1e9)
    deck = _deck(replace(PAIR, wall_left=left, wall_right=right, gravity=-3.0))
    read = _read(deck)
    assert list(deck.line) == [atom.place[0] for atom in read.atoms]
    assert deck.weight == (0.0, -3.0 * 8.1e-3, -3.0 * 1e-2, 0.0)
    assert deck.mobility == (0.0, 1.0 / 8.1e-3, 1.0 / 1e-2, 0.0)
    assert (deck.first_id, deck.types) == (2, read.types)


@pytest.mark.parametrize("exponent", [2.0, 2.4999999, 3.0])
def test_an_exponent_that_hertz_does_not_have_is_refused_with_contact_and_value(exponent: float) -> None:
    scene = Scene(
        name="mixed",
        duration=1.0,
        mass=(1.0,) * 3,
        stiffness=(1.0, 1.0),
        exponent=(2.5, exponent),
        velocity=(1.0, 0.0, 0.0),
    )
    reason = refusal(scene)
    assert reason is not None
    assert f"contact 1 has exponent n = {exponent!r}" in reason
    with pytest.raises(ValueError, match="contact 1 has exponent"):
        _deck(scene)


def test_a_wall_of_another_exponent_is_refused_too() -> None:
    scene = replace(PAIR, wall_right=Wall(stiffness=1.0, exponent=2.0))
    assert "contact 1 has exponent n = 2.0" in (refusal(scene) or "")


def test_hertzian_scenes_are_not_refused() -> None:
    assert refusal(PAIR) is None


@given(peak=log_uniform(1e-12, 1e-2))
def test_the_gauge_radius_is_the_next_power_of_two_above_five_quarters_of_the_overlap(peak: float) -> None:
    radius = gauge_radius(peak)
    assert math.frexp(radius)[0] == 0.5  # a power of two: multiples of it are exact
    assert 1.25 * peak < radius * (1.0 + EPS)
    assert radius <= 2.5 * peak * (1.0 + EPS)


def test_start_positions_are_exact_multiples_of_the_diameter(free_chain: Truth) -> None:
    read = _read(_deck(free_chain.scene))
    assert [atom.place[0] for atom in read.atoms] == [2.0 * RADIUS * i for i in range(41)]


def test_a_scene_where_nothing_touches_has_a_radius_all_the_same() -> None:
    assert gauge_radius(0.0) > 0.0


@pytest.mark.parametrize("peak", [-1e-6, math.inf, math.nan])
def test_an_overlap_that_is_none_has_no_radius(peak: float) -> None:
    with pytest.raises(ValueError, match="peak overlap"):
        gauge_radius(peak)


def test_later_pair_coeffs_override_earlier_ones_in_the_reader_as_in_lammps(tmp_path: Path) -> None:
    deck = _deck(PAIR)
    (tmp_path / "data.pair").write_text(deck.files["data.pair"])
    last = "pair_coeff 1 1 hertz 7.0 0 tangential linear_nohistory 0 0 damping velocity\nfix "
    (tmp_path / "in.pair").write_text(deck.files["in.pair"].replace("fix ", last, 1))
    assert read_deck(tmp_path, "pair").coefficients[1, 1].stiffness == 7.0


# committed decks


def _owners() -> dict[str, set[str]]:
    """Folder of lammps_inputs -> files it must have."""
    return {name: {f"in.{name}", f"data.{name}"} for name in db.shipped_scenes()}


@pytest.mark.parametrize("name", db.shipped_scenes())
def test_the_committed_deck_is_byte_for_byte_what_is_written_now(name: str, tmp_path: Path) -> None:
    written = db.write_deck(name, tmp_path)
    assert {file.name for file in written} == _owners()[name]
    for file in written:
        assert file.read_bytes() == (INPUTS / name / file.name).read_bytes(), f"{name}/{file.name} has changed"


def test_every_file_in_lammps_inputs_has_a_scene_that_owns_it() -> None:
    found = {str(file.relative_to(INPUTS)) for file in INPUTS.rglob("*") if file.is_file()}
    owned = {f"{folder}/{file}" for folder, files in _owners().items() for file in files}
    assert found == owned


@pytest.mark.parametrize("name", db.shipped_scenes())
def test_the_committed_deck_is_the_shipped_scene(name: str) -> None:
    read = read_deck(INPUTS / name, name)
    scene = db.load_scene(name)
    _assert_says(read, scene, 1e-8)
    assert read.types == 9


def test_a_description_of_two_lines_is_refused_before_it_becomes_a_command() -> None:
    with pytest.raises(SceneError, match="description"):
        replace(PAIR, description="first line\nshell touch surprise")


def test_a_precompressed_chain_is_written_with_its_overlaps_and_the_loads_on_its_ends() -> None:
    scene = replace(
        PAIR, mass=(8.1e-3, 1e-2, 2e-2), stiffness=(4e9, 5e9), exponent=2.5, gap=0.0, velocity=(0.8, 0.0, 0.0),
        precompression=10.0,
    )  # fmt: skip
    walled = replace(scene, wall_left=Wall(stiffness=3e9), wall_right=Wall(stiffness=2e9), gravity=9.81)
    half = replace(scene, wall_left=Wall(stiffness=3e9))
    for pressed, loads in ((scene, {1: 10.0, 3: -10.0}), (half, {4: -10.0}), (walled, {})):
        deck = _deck(pressed)
        read = _read(deck)
        assert read.loads == loads
        gap = pressed.contacts.gap
        order = [*([2] if pressed.wall_left else []), 0, 1, *([pressed.n_contact - 1] if pressed.wall_right else [])]
        # positions of a few radii are rounded once each
        assert read.gaps == pytest.approx(gap[order].tolist(), abs=4.0 * EPS * 8.0 * RADIUS)
        weight = 9.81 if pressed is walled else 0.0
        bodies = [m * weight + load for m, load in zip(pressed.mass, pressed.load.tolist(), strict=True)]
        assert [w for w, m in zip(deck.weight, deck.mobility, strict=True) if m] == pytest.approx(bodies)


@pytest.mark.parametrize("changes", [{"drag": 1.0}, {"damping": Damping(law="dashpot", coefficient=1.0)}], ids=str)
def test_a_deck_without_the_scenes_damping_is_not_written(changes: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="neither damping nor drag"):
        _deck(replace(PAIR, **changes))
