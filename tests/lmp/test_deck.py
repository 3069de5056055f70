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
from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.lammps import LammpsTable
from dem_bridge.backends.surrogate_radius import surrogate_radius
from dem_bridge.errors import SceneError
from dem_bridge.lmp import deck as deck_module
from dem_bridge.lmp.deck import Deck, as_comment, deck_of, numbered_rows, positions
from dem_bridge.lmp.pair_coefficients import GRANULAR_STYLE
from dem_bridge.lmp.reader.script import Script
from dem_bridge.scene.drive import Drive
from dem_bridge.scene.file import MAIN_SCENES
from dem_bridge.scene.scene import Damping, Scene, Wall
from dem_bridge.trajectory.dense import Schedule, schedule
from tests.helpers.deck_reader import ReadDeck, read_deck
from tests.helpers.quadruple_truth import Truth
from tests.helpers.strategies import damped_scenes, examples, log_uniform, scenes

INPUTS = Path(__file__).parents[2] / "lammps_inputs"
EPS = float(np.finfo(float).eps)
RADIUS = 2.0**-15
#: the exponents that pair_style granular has
EITHER = st.sampled_from([2.0, 2.5])

PAIR = Scene(name="pair", duration=1e-4, mass=(8.1e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=10)


def _deck(scene: Scene, radius: float = RADIUS, dt: float = 1e-7) -> Deck:
    plan = schedule(duration=scene.duration, samples=scene.samples, dt=dt, frequency=2e5, bodies=scene.n_body)
    return deck_of(scene, radius=radius, schedule=plan)


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
    assert read.exponents == _along_the_line(scene, c.exponent.tolist())
    _assert_takes(read, scene)
    exact = math.frexp(0.5 * read.atoms[0].diameter)[0] == 0.5
    # sums of gaps are rounded to half an ulp of the farthest; so are 2 R i and the position, unless R is a power of two
    ulp = max(math.ulp(atom.place[0]) for atom in read.atoms)
    for found, gap in zip(read.gaps, _along_the_line(scene, c.gap.tolist()), strict=True):
        assert found == pytest.approx(gap, abs=(1.0 if exact else 3.0) * ulp)
        if exact and gap == 0.0:
            assert found == 0.0, "bodies that touch are in touch to the last digit, whatever gaps lie before them"
    assert read.steps * read.dt == pytest.approx(scene.duration, rel=4.0 * EPS)
    assert read.dt <= dt * (1.0 + 1e-11)


def _damping(law: str, value: float, beta: float, n: float, mass: float) -> tuple[float, float]:
    """Return c and p of the damping force c overlap^p overlap'."""
    if law == "kuwabara-kono":
        return value * beta, n - 2.0
    if law != "coeff_restitution":
        return value * (mass if law == "mass_velocity" else 1.0), 0.0
    # the damped oscillator that loses 1 - e of its speed in half a period, in overlap^(n/2)
    ratio = -math.log(value) / math.hypot(math.pi, math.log(value))
    return ratio * math.sqrt(2.0 * n * beta * mass), 0.5 * n - 1.0


def _assert_takes(read: ReadDeck, scene: Scene) -> None:
    """Damping and drag are those of the scene; written from its definition, not from its arrays."""
    wanted, powers = [0.0] * scene.n_contact, [0.0] * scene.n_contact
    if scene.damping is not None:
        assert isinstance(scene.damping.coefficient, tuple)
        c, inverse = scene.contacts, [*(1.0 / mass for mass in scene.mass), 0.0]
        numbers = zip(scene.damping.coefficient, c.stiffness.tolist(), c.exponent.tolist(), strict=True)
        masses = [1.0 / (inverse[i] + inverse[j]) for i, j in zip(c.left.tolist(), c.right.tolist(), strict=True)]
        of_contact = [_damping(scene.damping.law, *each, m) for each, m in zip(numbers, masses, strict=True)]
        wanted, powers = ([each[nth] for each in of_contact] for nth in (0, 1))
    wanted, powers = (_along_the_line(scene, each) for each in (wanted, powers))
    # eta = gamma beta / (m_eff sqrt(R_eff)) and reading it back: a dozen operations
    assert [c for c, _ in read.dampings] == pytest.approx(wanted, rel=12.0 * EPS)
    assert [power for c, (_, power) in zip(wanted, read.dampings, strict=True) if c] == [
        power for c, power in zip(wanted, powers, strict=True) if c
    ]
    # net forces are cut at zero wherever something is damped, and nothing is said of it elsewhere
    clip = scene.damping is not None and bool(scene.damping.clip)
    assert {one.clip for one in read.found} <= {any(wanted) and clip}
    assert all(one.tangential == (0.0, 0.0) for one in read.found)
    assert read.drag == pytest.approx(scene.drag, rel=EPS)


@examples(60)
@given(
    scene=scenes(bodies=(1, 12), walls=True, gravity=True, exponents=EITHER)
    | damped_scenes(bodies=(1, 12), exponents=EITHER),
    radius=log_uniform(2e-5, 1e-2) | st.sampled_from([2.0**-15, 2.0**-12]),
)
def test_the_deck_of_a_random_scene_is_that_scene(scene: Scene, radius: float) -> None:
    # any radius will do, not only the powers of two that runs choose
    _assert_says(_read(_deck(scene, radius=radius)), scene, 1e-7)


@examples(60)
@given(scene=scenes(bodies=(1, 12), walls=True, gravity=True) | damped_scenes(bodies=(1, 12), exponents=EITHER))
def test_equal_pairs_of_types_are_at_equal_laws_only(scene: Scene) -> None:
    read = _read(_deck(scene))
    # what LAMMPS makes of a pair, beside the effective mass that it has from elsewhere
    laws = list(zip(read.stiffnesses, read.exponents, read.dampings, strict=True))
    pairs = dict(zip(read.pairs, laws, strict=True))
    _assert_says(read, scene, 1e-7)
    # so no contact has the law of another; and where no two are alike, each has a pair of its own
    if len(set(laws)) == len(laws):
        assert len(pairs) == len(read.pairs) == len(read.atoms) - 1
    assert read.types == max(atom.kind for atom in read.atoms)


def test_a_uniform_chain_needs_one_type_and_one_line() -> None:
    scene = Scene(name="even", duration=1e-4, mass=(1e-2,) * 9, stiffness=(4e9,) * 8, velocity=(1.0, *[0.0] * 8))
    deck = _deck(scene)
    read = _read(deck)
    assert (read.types, set(read.pairs)) == (1, {(1, 1)})
    assert deck.files["in.even"].count("pair_coeff") == 2  # the background, and the law
    assert "# contact 0 and 7 more: beta = 4000000000.0" in deck.files["in.even"]


@pytest.mark.parametrize("how", ["euler", "per-body"])
def test_types_may_be_as_few_as_can_be_or_one_a_body(how: str) -> None:
    scene = Scene(
        name="two-laws", duration=1e-4, mass=(1e-2,) * 9, stiffness=(4e9, 5e9, 5e9, 4e9) * 2, velocity=(1.0, *[0.0] * 8)
    )
    plan = schedule(duration=1e-4, samples=scene.samples, dt=1e-7, frequency=2e5, bodies=9)
    read = _read(deck_of(scene, radius=RADIUS, schedule=plan, types=how))
    _assert_says(read, scene, 1e-7)
    assert read.types == {"euler": 2, "per-body": 9}[how]


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
        assert (found.eta, found.damping, found.tangential, found.clip) == (0.0, "velocity", (0.0, 0.0), False)


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
    assert deck.weight.tolist() == [0.0, -3.0 * 8.1e-3, -3.0 * 1e-2, 0.0]
    assert deck.mobility.tolist() == [0.0, 1.0 / 8.1e-3, 1.0 / 1e-2, 0.0]
    assert (deck.first_id, deck.types) == (2, read.types)


@pytest.mark.parametrize("exponent", [1.5, 2.0000001, 2.4999999, 3.0])
def test_an_exponent_that_lammps_does_not_have_is_refused_with_contact_and_value(exponent: float) -> None:
    scene = Scene(
        name="mixed",
        duration=1.0,
        mass=(1.0,) * 3,
        stiffness=(1.0, 1.0),
        exponent=(2.5, exponent),
        velocity=(1.0, 0.0, 0.0),
    )
    reason = GRANULAR_STYLE.unsupported_reason(scene)
    assert reason is not None
    assert f"contact 1 has exponent n = {exponent!r}" in reason
    with pytest.raises(ValueError, match="contact 1 has exponent"):
        _deck(scene)


def test_a_wall_of_another_exponent_is_refused_too() -> None:
    scene = replace(PAIR, wall_right=Wall(stiffness=1.0, exponent=3.0))
    assert "contact 1 has exponent n = 3.0" in (GRANULAR_STYLE.unsupported_reason(scene) or "")


def test_hertzian_and_linear_scenes_are_not_refused() -> None:
    assert GRANULAR_STYLE.covers(PAIR)
    assert GRANULAR_STYLE.covers(replace(PAIR, exponent=2.0, wall_right=Wall(stiffness=1.0, exponent=2.5)))


@given(peak=log_uniform(1e-12, 1e-2))
def test_the_surrogate_radius_is_the_next_power_of_two_above_five_quarters_of_the_overlap(peak: float) -> None:
    radius = surrogate_radius(peak)
    assert math.frexp(radius)[0] == 0.5  # a power of two: multiples of it are exact
    assert 1.25 * peak < radius * (1.0 + EPS)
    assert radius <= 2.5 * peak * (1.0 + EPS)


def test_start_positions_are_exact_multiples_of_the_diameter(free_chain: Truth) -> None:
    read = _read(_deck(free_chain.scene))
    assert [atom.place[0] for atom in read.atoms] == [2.0 * RADIUS * i for i in range(41)]


def test_a_scene_where_nothing_touches_has_a_radius_all_the_same() -> None:
    assert surrogate_radius(0.0) > 0.0


@pytest.mark.parametrize("peak", [-1e-6, math.inf, math.nan])
def test_an_overlap_that_is_none_has_no_radius(peak: float) -> None:
    with pytest.raises(ValueError, match="peak overlap"):
        surrogate_radius(peak)


def test_later_pair_coeffs_override_earlier_ones_in_the_reader_as_in_lammps(tmp_path: Path) -> None:
    deck = _deck(PAIR)
    (tmp_path / "data.pair").write_text(deck.files["data.pair"])
    last = "pair_coeff 1 1 hertz 7.0 0 tangential linear_nohistory 0 0 damping velocity\nfix "
    (tmp_path / "in.pair").write_text(deck.files["in.pair"].replace("fix ", last, 1))
    assert read_deck(tmp_path, "pair").coefficients[1, 1].stiffness == 7.0


# committed decks


#: folder of lammps_inputs -> the scene, and how its deck is written
COMMITTED: dict[str, tuple[str, dict[str, Any]]] = {
    **{name: (name, {}) for name in MAIN_SCENES},
    **{f"{name}-physical": (name, {"geometry": "physical", "types": "per-body"}) for name in MAIN_SCENES},
}


def _owners() -> dict[str, set[str]]:
    """Folder of lammps_inputs -> files it must have."""
    return {folder: {f"in.{name}", f"data.{name}"} for folder, (name, _) in COMMITTED.items()}


@pytest.mark.parametrize("folder", COMMITTED)
def test_the_committed_deck_is_byte_for_byte_what_is_written_now(folder: str, tmp_path: Path) -> None:
    name, how = COMMITTED[folder]
    written = db.write_deck(name, tmp_path, **how)
    assert {file.name for file in written} == _owners()[folder]
    for file in written:
        assert file.read_bytes() == (INPUTS / folder / file.name).read_bytes(), f"{folder}/{file.name} has changed"


def test_every_file_in_lammps_inputs_has_a_scene_that_owns_it() -> None:
    found = {str(file.relative_to(INPUTS)) for file in INPUTS.rglob("*") if file.is_file()}
    owned = {f"{folder}/{file}" for folder, files in _owners().items() for file in files}
    assert found == owned


@pytest.mark.parametrize("folder", COMMITTED)
def test_the_committed_deck_is_the_shipped_scene(folder: str) -> None:
    name, how = COMMITTED[folder]
    read = read_deck(INPUTS / folder, name)
    scene = db.load_scene(name)
    _assert_says(read, scene, 1e-8)
    assert scene.spacing == 0.018
    assert read.types == (41 if how else 9)
    assert {atom.diameter for atom in read.atoms} == ({0.018} if how else {2.0**-14})


@pytest.mark.parametrize("name", MAIN_SCENES)
def test_a_deck_of_the_scenes_own_radius_says_what_round_off_to_expect(name: str) -> None:
    text = (INPUTS / f"{name}-physical" / f"in.{name}").read_text()
    [said] = re.findall(r"^# .*expect a round-off error of (\S+) of$", text, re.MULTILINE)
    runs = [
        db.solve(name, backend="verlet", dt=1e-8, surrogate_radius=radius, uncertainty=False).velocity
        for radius in (0.009, None)
    ]
    # the deck states one digit
    assert float(said) == pytest.approx(np.max(np.abs(runs[0] - runs[1])) / np.max(np.abs(runs[1])), rel=0.5)
    assert "with a resolution of 1.1e-16 m" in text
    assert math.ulp(0.72) == pytest.approx(1.1e-16, rel=0.01)
    assert "radius R = 0.009 m" in text
    assert "round-off" not in (INPUTS / name / f"in.{name}").read_text()


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


# damping and drag

DASHPOT = Damping(law="dashpot", coefficient=1.0)
KUWABARA_KONO = Damping(law="kuwabara-kono", coefficient=1e-6)

#: what a scene may have -> a word of the lines that say so
LINES: dict[str, tuple[dict[str, Any], str]] = {
    "weight": ({"gravity": 9.81}, "gravity"),
    "a dashpot": ({"damping": DASHPOT}, "limit_damping"),
    "Kuwabara-Kono damping": ({"damping": KUWABARA_KONO}, "viscoelastic limit_damping"),
    "drag": ({"drag": 1.0}, "langevin"),
    "drag, its time": ({"drag": 1.0}, "drag_time"),
    "a wall": ({"wall_left": Wall(stiffness=1e9)}, "walls"),
    "precompression": ({"precompression": 1.0}, "addforce"),
    "n = 2": ({"exponent": 2.0}, "hooke"),
}


@pytest.mark.parametrize(("changes", "word"), LINES.values(), ids=LINES)
def test_a_deck_has_a_line_only_where_the_scene_needs_it(changes: dict[str, Any], word: str) -> None:
    everything: dict[str, Any] = {key: value for one, _ in LINES.values() for key, value in one.items()}
    with_it = replace(PAIR, **changes)
    without = replace(PAIR, **{key: value for key, value in everything.items() if key not in changes})
    assert word in _deck(with_it).files["in.pair"]
    for scene in (PAIR, without):
        assert word not in _deck(scene).files["in.pair"]


def test_damping_of_no_strength_leaves_no_trace() -> None:
    idle = replace(PAIR, damping=Damping(law="kuwabara-kono", coefficient=0.0), drag=0.0)
    assert dict(_deck(idle).files) == dict(_deck(PAIR).files)


def test_equal_damping_between_unequal_masses_is_two_laws_of_lammps() -> None:
    # eta is per effective mass: one stiffness and one gamma, but a heavier body
    scene = Scene(
        name="masses", duration=1e-4, mass=(1e-2, 1e-2, 5e-2), stiffness=(4e9, 4e9), velocity=(1.0, 0.0, 0.0),
        damping=KUWABARA_KONO,
    )  # fmt: skip
    read = _read(_deck(scene))
    assert len(set(read.pairs)) == 2
    _assert_says(read, scene, 1e-7)
    # a dashpot's is not
    dashpot = replace(scene, damping=DASHPOT)
    assert set(_read(_deck(dashpot)).pairs) == {(1, 1)}
    _assert_says(_read(_deck(dashpot)), dashpot, 1e-7)


def test_more_runs_of_masses_than_are_set_one_by_one_are_read_from_a_file(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = Scene(
        name="many", duration=1e-4, mass=(1e-2, 0.1 + 0.2, 1e-2, 1e-2, math.pi), stiffness=(4e9,) * 4,
        velocity=(1.0, *[0.0] * 4), wall_left=Wall(stiffness=1e9),
    )  # fmt: skip
    assert set(_deck(scene).files) == {"in.many", "data.many"}
    monkeypatch.setattr(deck_module, "MOST_SETS", 3)
    deck = _deck(scene)
    assert set(deck.files) == {"in.many", "data.many", "masses.many"}
    assert " atom " not in re.findall(r"^set .*$", deck.files["in.many"], re.MULTILINE)[0]
    _assert_says(_read(deck), scene, 1e-7)


# tables


def _tabled(scene: Scene, **settings: Any) -> Deck:
    return LammpsTable().deck(scene, Resolution(**{"dt": 1e-7, **settings}), Sampling(count=scene.samples))


def _assert_tables_say(read: ReadDeck, scene: Scene) -> None:
    """Force and energy at all lines are those of the scene's contacts, and bodies that are apart have none."""
    c = scene.contacts
    columns = (_along_the_line(scene, column.tolist()) for column in (c.stiffness, c.exponent, c.damping))
    for pair, beta, n, damping in zip(read.pairs, *columns, strict=True):
        if damping and n in (2.0, 2.5):
            # left to granular, which clips; the table of its pair is that of no contact
            assert not any(read.tables[pair].force)
            continue
        table = read.tables[pair]
        diameter = read.atoms[0].diameter
        r = np.array(table.distance)
        overlap = diameter - r  # exact: r is more than half of the diameter (Sterbenz)
        assert np.all(np.diff(r) > 0.0)
        assert r[-1] == diameter, "the cutoff is where bodies touch"
        # powers of numpy and of libm are good to a unit in the last place
        np.testing.assert_allclose(table.force, beta * overlap ** (n - 1.0), rtol=4.0 * EPS)
        np.testing.assert_allclose(table.energy, beta * overlap**n / n, rtol=4.0 * EPS)
        # the file's own numbers: the mean force between two lines is between the forces at them, for it only rises;
        # energies are rounded to half an ulp each
        mean = -np.diff(table.energy) / np.diff(r)
        noise = 4.0 * EPS * np.array(table.energy[:-1]) / np.diff(r)
        force = np.array(table.force)
        assert np.all(mean <= force[:-1] + noise)
        assert np.all(mean >= force[1:] - noise)
        # and the slope at its deepest line is that of the law
        assert table.slopes[0] == pytest.approx(-(n - 1.0) * force[0] / overlap[0], rel=1e-3)


@examples(25)
@given(
    scene=scenes(bodies=(1, 8), walls=True, gravity=True, exponents=(2.0, 5.0))
    | damped_scenes(bodies=(1, 8), exponents=EITHER)
)
def test_the_tables_of_a_random_scene_are_its_contacts(scene: Scene) -> None:
    deck = _tabled(scene)
    read = _read(deck)
    assert read.table_style == ("spline", 10_000)
    assert read.masses == list(scene.mass)
    assert read.velocities == list(scene.velocity)
    assert read.gravity == scene.gravity
    assert read.gaps == pytest.approx(
        _along_the_line(scene, scene.contacts.gap.tolist()), abs=math.ulp(float(np.max(np.abs(deck.line))))
    )
    _assert_tables_say(read, scene)
    for name, text in deck.files.items():
        if name.endswith(".table"):
            assert re.match(r"# DATE: \d{4}-\d\d-\d\d UNITS: si CONTRIBUTOR: dem_bridge \S+\n\n", text), name
            assert len(text.splitlines()) <= 1000


@pytest.mark.parametrize("geometry", ["surrogate", "physical"])
@pytest.mark.parametrize("name", MAIN_SCENES)
def test_forty_different_contacts_are_41_tables(name: str, geometry: str) -> None:
    scene = db.load_scene(name)
    deck = _tabled(scene, geometry=geometry)
    files = {file for file in deck.files if file.endswith(".table")}
    assert len(files) == 41
    read = _read(deck)
    assert {table.file for table in read.tables.values()} == files
    _assert_tables_say(read, scene)
    # pairs of types that have no contact have no force, not even where bodies overlap
    others = [table for pair, table in read.tables.items() if pair not in read.pairs]
    assert others
    assert not any(any(table.force) or any(table.energy) for table in others)


def test_contacts_with_one_law_share_a_file_and_others_do_not() -> None:
    scene = Scene(
        name="shared", duration=1e-4, mass=(1e-2,) * 6, stiffness=(4e9, 5e9, 4e9, 4e9, 4e9), velocity=(1.0, *[0.0] * 5),
        exponent=(2.5, 2.5, 2.5, 2.5, 2.6), wall_right=Wall(stiffness=5e9),
    )  # fmt: skip
    deck = _tabled(scene)
    assert sum(file.endswith(".table") for file in deck.files) == 4
    read = _read(deck)
    files = [read.tables[pair].file for pair in read.pairs]
    assert files[0] == files[2] == files[3]
    assert files[1] == files[5]
    assert len(set(files)) == 3
    _assert_tables_say(read, scene)


def test_a_table_reaches_a_tenth_beyond_the_overlap_that_was_foreseen() -> None:
    read = _read(_tabled(PAIR))
    [table] = [read.tables[pair] for pair in read.pairs]
    deepest = float((db.solve(PAIR, backend="scipy", uncertainty=False).peak_force[0] / 4e9) ** (2.0 / 3.0))
    # the coarse run is good to a per cent
    assert table.distance[-1] - table.distance[0] == pytest.approx(1.1 * deepest, rel=0.01)


def test_lines_points_and_style_of_tables_can_be_set() -> None:
    deck = _tabled(PAIR, table_lines=40, table_points=777, table_style="linear")
    read = _read(deck)
    assert read.table_style == ("linear", 777)
    assert {len(read.tables[pair].force) for pair in read.pairs} == {40}


def test_a_damped_contact_has_granulars_law_where_that_has_it_and_a_table_with_a_dashpot_beside_it_elsewhere() -> None:
    scene = replace(
        PAIR, mass=(8.1e-3, 1e-2, 1e-2, 1e-2), stiffness=(4e9, 1e12, 4e9), exponent=(2.5, 3.0, 2.7), gap=0.0,
        velocity=(0.8, 0.0, 0.0, 0.0), damping=Damping(law="dashpot", coefficient=(3.0, 2.0, 0.0)),
    )  # fmt: skip
    read = _read(_tabled(scene))
    hertz, beside, dry = (read.coefficients[pair] for pair in read.pairs)
    assert (hertz.stiffness > 0.0, hertz.eta, hertz.clip) == (True, 3.0, True)
    assert (beside.stiffness, beside.eta, beside.clip) == (0.0, 2.0, False)
    assert (dry.stiffness, dry.eta) == (0.0, 0.0)
    _assert_tables_say(read, scene)


@pytest.mark.parametrize(
    "text", ['a """ b', 'ends in """"""""', "ends in &", "ends in & & ", "a \u00b5m $x ${y} \U0001f600"]
)
def test_a_description_changes_no_command_of_a_deck(text: str) -> None:
    plain, other = (_deck(replace(PAIR, description=said)).files["in.pair"] for said in ("plain", text))
    assert other.isascii()

    def commands(deck: str) -> list[tuple[str, ...]]:
        return [command.words for command in Script(dict[str, str]().__getitem__).commands("in", deck)]

    assert commands(other) == commands(plain)
    assert len(other.splitlines()) == len(plain.splitlines())
    described = other.splitlines()[1]
    assert described.startswith("# ")
    assert '"""' not in described
    assert not described.rstrip().endswith("&")


# lines by hand

#: 7 samples of 40 steps
SHORT = Schedule(step=1e-7, per_sample=40, subdivisions=2, samples=7)
#: two bodies between walls, one at a distance of a radius
HELD = replace(PAIR, wall_left=Wall(stiffness=4e9), wall_right=Wall(stiffness=5e9, gap=RADIUS))


def test_the_box_leaves_a_diameter_beyond_the_line_and_is_a_diameter_wide() -> None:
    r = RADIUS
    [first, *others] = [line for line in _deck(HELD).files["data.pair"].splitlines() if line.endswith("hi")]
    # the left wall is at -2 r, body 0 at 0, body 1 at 2 r, and the right wall a gap of r behind touch, at 5 r
    assert first == f"{-4.0 * r!r} {7.0 * r!r} xlo xhi"
    assert others == [f"{-r!r} {r!r} ylo yhi", f"{-r!r} {r!r} zlo zhi"]


def test_atoms_have_type_diameter_density_place_and_velocity() -> None:
    text = _deck(HELD).files["data.pair"]
    atoms, velocities = (part.split("\n\n")[1].split() for part in text.split("Atoms")[1].split("Velocities", 1))
    rows = [atoms[7 * i : 7 * i + 7] for i in range(4)]
    assert len(atoms) == 28
    assert [row[0] for row in rows] == ["1", "2", "3", "4"]
    assert {row[2] for row in rows} == {repr(2.0 * RADIUS)}
    # a wall has the mass of its neighbour
    volume = 4.0 / 3.0 * math.pi * RADIUS**3
    assert [float(row[3]) for row in rows] == pytest.approx(
        [m / volume for m in (8.1e-3, 8.1e-3, 1e-2, 1e-2)], rel=1e-15
    )
    assert [float(row[4]) for row in rows] == [-2.0 * RADIUS, 0.0, 2.0 * RADIUS, 5.0 * RADIUS]
    assert [row[5:] for row in rows] == [["0", "0"]] * 4
    assert velocities == f"1 0.0 {'0 ' * 5}2 0.8 {'0 ' * 5}3 0.0 {'0 ' * 5}4 0.0 {'0 ' * 5}".split()
    assert "4 atoms\n" in text


@pytest.mark.parametrize(("travel", "bins"), [(0.0, False), (1557.9, False), (1558.0, False), (1558.1, True)])
def test_bins_have_a_size_of_their_own_where_the_line_is_1560_radii_long(travel: float, bins: bool) -> None:
    # two atoms: 1040 bins; the line is two radii and the travel
    deck = deck_of(PAIR, radius=RADIUS, schedule=SHORT, travel=travel * RADIUS)
    size = (2.0 + travel) * RADIUS / 1040.0
    end = f" binsize {size!r}\n" if bins else "\n"
    assert f"neigh_modify    delay 0 every 1 check yes{end}" in deck.files["in.pair"]
    # the box is as wide as a bin, if that is more than a body
    wide = deck_of(PAIR, radius=RADIUS, schedule=SHORT, travel=1e6 * RADIUS)
    size = (2.0 + 1e6) * RADIUS / 1040.0
    assert f"{-0.5 * size!r} {0.5 * size!r} ylo yhi" in wide.files["data.pair"]
    assert f"{-size!r} {2.0 * RADIUS + size!r} xlo xhi" in wide.files["data.pair"]


@pytest.mark.parametrize(("samples", "every"), [(1, 40), (9, 40), (10, 40), (19, 40), (20, 80), (500, 2000)])
def test_energies_are_printed_at_samples_ten_times_in_a_run(samples: int, every: int) -> None:
    deck = deck_of(PAIR, radius=RADIUS, schedule=replace(SHORT, samples=samples))
    assert f"\nthermo          {every}\n" in deck.files["in.pair"]


def test_a_deck_has_the_files_radii_and_distances_of_its_line() -> None:
    deck = _deck(HELD)
    assert (deck.input_file, deck.dump_file) == ("in.pair", "dump.pair.bin")
    assert deck.radii.tolist() == [RADIUS] * 4
    encoded = replace(deck, encoded_radii=np.array([1.0, 2.0, 4.0, 8.0]))
    assert encoded.radii.tolist() == [1.0, 2.0, 4.0, 8.0]
    assert (deck.reach.tolist(), encoded.reach.tolist()) == ([2.0 * RADIUS] * 3, [3.0, 6.0, 12.0])


def test_positions_start_at_body_0_and_add_gaps() -> None:
    assert positions(HELD, 0.5) == pytest.approx([-1.0, 0.0, 1.0, 2.0 + RADIUS], abs=0.0)
    open_left = replace(PAIR, wall_left=Wall(stiffness=1.0, gap=0.25), gap=0.125)
    assert positions(open_left, 0.5).tolist() == [-1.25, 0.0, 1.125]


def test_lines_say_which_contacts_have_a_law_and_how_many() -> None:
    three = replace(PAIR, mass=(1e-2,) * 3, stiffness=(4e9, 4e9), velocity=(1.0, 0.0, 0.0), exponent=2.5, gap=0.0)
    texts = {
        "wall_right: beta = 5000000000.0": HELD,
        "contact 0 and 1 more: beta = 4000000000.0": three,
        "contact 0: beta = 4000000000.0": PAIR,
    }
    for text, scene in texts.items():
        assert f"  # {text}\n" in _deck(scene).files["in.pair"]
    shares = "contacts with the same law may share a pair of types"
    assert [shares in _deck(scene).files["in.pair"] for scene in (three, PAIR, HELD)] == [True, False, True]
    assert "each contact has its own pair of types" in _deck(PAIR).files["in.pair"]


def test_masses_are_set_by_groups_of_equal_neighbours_up_to_three_hundred() -> None:
    def sets(bodies: int) -> tuple[list[str], bool]:
        masses = tuple(1e-2 * (1.0 + i % 2) for i in range(bodies))
        scene = Scene(name="many", duration=1e-4, mass=masses, stiffness=(4e9,) * (bodies - 1),
                      velocity=(1.0, *[0.0] * (bodies - 1)))  # fmt: skip
        deck = deck_of(scene, radius=RADIUS, schedule=SHORT)
        return re.findall(r"^set .*$", deck.files["in.many"], re.MULTILINE), "masses.many" in deck.files

    found, from_file = sets(300)
    assert (len(found), from_file) == (300, False)
    assert found[1] == "set             atom 2 mass 0.02"
    assert sets(301) == (["set             group all mass v_mass"], True)
    grouped = replace(HELD, mass=(1e-2, 1e-2))
    assert "set             atom 2*3 mass 0.01\n" in _deck(grouped).files["in.pair"]


TABLE = Drive(shape="table", force=(0.0, 800.0, -300.0, 100.0), interval=4e-5)
#: changes of a pair -> its lines of groups and fixes, and of gravity and drag
OUTER: dict[str, tuple[dict[str, Any], list[str], list[str]]] = {
    "alone": ({}, ["fix motion all nve"], []),
    "gravity": (
        {"gravity": 3.0}, ["fix motion all nve", "fix weight all gravity ${gravity} vector 1 0 0"],
        ["variable gravity index 3.0 # m/s^2"],
    ),
    "left wall": (
        {"wall_left": Wall(stiffness=1e9), "gravity": -3.0},
        ["group walls id 1", "group bodies subtract all walls", "fix motion bodies nve",
         "fix weight bodies gravity ${gravity} vector -1 0 0"],
        ["variable gravity index 3.0 # m/s^2"],
    ),
    "right wall": (
        {"wall_right": Wall(stiffness=1e9), "drag": 4.0},
        ["group walls id 3", "group bodies subtract all walls", "fix motion bodies nve",
         "fix drag bodies langevin 0 0 ${drag_time} 1"],
        ["variable drag_time index 0.25 # s; the drag force is -mass * velocity / drag_time"],
    ),
    "walls": (
        {"wall_left": Wall(stiffness=1e9), "wall_right": Wall(stiffness=1e9), "drive": TABLE},
        ["group walls id 1 4", "group bodies subtract all walls", "fix motion bodies nve", "group driven id 2",
         "fix drive driven addforce v_drive 0 0"],
        [],
    ),
    "drive": (
        {"drive": Drive(shape="sine", force=50.0, frequency=5e3)},
        ["fix motion all nve", "group driven id 1", "fix drive driven addforce v_drive 0 0"], [],
    ),
    "precompression": (
        {"precompression": 5.0, "exponent": 2.5, "gap": 0.0},
        ["fix motion all nve", "group load0 id 1", "fix load0 load0 addforce 5.0 0 0", "group load1 id 2",
         "fix load1 load1 addforce -5.0 0 0"],
        [],
    ),
}  # fmt: skip


@pytest.mark.parametrize(("changes", "fixes", "variables"), OUTER.values(), ids=OUTER)
def test_outer_forces_are_fixes_of_groups(changes: dict[str, Any], fixes: list[str], variables: list[str]) -> None:
    scene = replace(PAIR, **changes)
    deck = _deck(scene)
    lines = [" ".join(line.split()) for line in deck.files["in.pair"].splitlines()]
    assert [line for line in lines if line.startswith(("group ", "fix "))] == fixes
    names = ("variable gravity", "variable drag_time")
    assert [line for line in lines if line.startswith(names)] == variables
    assert any(line.startswith("variable drive ") for line in lines) == (scene.drive is not None)
    # a table has a file of its own
    assert set(deck.files) == {"in.pair", "data.pair", *(["drive.pair"] if scene.drive is TABLE else [])}
    if scene.drive is TABLE:
        assert " force on body 0 in N of pair, written by" in deck.files["drive.pair"].splitlines()[0]
    assert deck.weight.tolist() == [0.0] * bool(scene.wall_left) + [
        m * scene.gravity + load for m, load in zip(scene.mass, scene.load.tolist(), strict=True)
    ] + [0.0] * bool(scene.wall_right)


def test_rows_are_written_in_blocks() -> None:
    rows = numbered_rows("{} {}".format, np.array([7, 8, 9, 10, 11]), block=2)
    assert list(rows) == ["1 7\n2 8", "3 9\n4 10", "5 11"]
    assert list(numbered_rows("{} {} {}".format, np.array([1, 2]), np.array([3, 4]), block=2)) == ["1 1 3\n2 2 4"]
    assert len(list(numbered_rows("{} {}".format, np.zeros(10_001)))) == 2
    assert len(list(numbered_rows("{} {}".format, np.zeros(10_000)))) == 1


@pytest.mark.parametrize(
    ("text", "comment"),
    [
        ("plain", "plain"),
        ("a" * 1001, "a" * 1000),
        ("tab\tand\u2003space", "tab and space"),
        ("2 \u00b5m", "2 \\xb5m"),
        ('two "" are kept', 'two "" are kept'),
        ('three """ and five """""', "three ''' and five '''''"),
        ("you & me", "you & me"),
        ("you &&  ", "you and"),
        ("~ !", "~ !"),
    ],
)
def test_a_comment_is_ascii_that_ends_with_its_line(text: str, comment: str) -> None:
    assert as_comment(text) == comment
