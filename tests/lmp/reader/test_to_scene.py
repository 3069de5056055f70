"""Scripts of LAMMPS become the Scene that LAMMPS would simulate; what is not understood is refused by file and line.

The reader shares no code with the writer of decks. What it gives back of our own decks is the scene they were written
from; what it makes of decks of others is compared with LAMMPS itself in test_deck_lammps.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import dem_bridge as db
from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.lammps import LammpsGranular
from dem_bridge.errors import SceneError
from dem_bridge.lmp.deck import Deck, deck_of
from dem_bridge.lmp.pair_coefficients import GRANULAR_STYLE, line_order
from dem_bridge.lmp.reader.formula import plain
from dem_bridge.lmp.reader.to_scene import ROUND_OFF, read_deck
from dem_bridge.lmp.variants import hertz_history
from dem_bridge.scene.file import load_scene, shipped_scenes
from dem_bridge.scene.scene import Adhesion, Damping, Scene, Wall
from dem_bridge.trajectory.dense import schedule
from tests.helpers.lammps_scripts import PARTS, read, script
from tests.helpers.strategies import damped_scenes, examples, scenes

#: a script that names no file
NOTHING: dict[str, str] = {}
#: of two stiffnesses, each right within ROUND_OFF: K and sqrt(R_eff) on the way out, their product on the way back
STIFFNESS_WITHIN = 2.0 * ROUND_OFF


def _own(deck: Deck, **how: object) -> Scene:
    return read_deck(deck.files[deck.input_file], file=deck.input_file, opened=deck.files.__getitem__, **how).scene  # type: ignore[arg-type]


def _deck(scene: Scene, types: str = "euler", radius: float = 2.0**-10) -> Deck:
    plan = schedule(duration=scene.duration, samples=scene.samples, dt=1e-6, frequency=2e5, bodies=scene.n_body)
    return deck_of(scene, radius=radius, schedule=plan, types=types)


def _gaps_within(deck: Deck) -> float:
    """A position is on the grid of the farthest, and so is known to half of that; a gap has two, and the reader takes
    the shortest decimal within two digits of the grid."""
    return 4.0 * float(np.spacing(np.max(np.abs(deck.line)) + deck.surrogate_radius))


def _same(found: Scene, scene: Scene, deck: Deck) -> None:
    # as the deck has them
    assert found.mass == scene.mass
    assert found.velocity == scene.velocity
    assert found.samples == scene.samples
    assert found.gravity == pytest.approx(scene.gravity, rel=ROUND_OFF)
    assert found.drag == pytest.approx(scene.drag, rel=ROUND_OFF)
    assert found.contacts.exponent.tolist() == scene.contacts.exponent.tolist()
    # products of a few numbers
    assert found.duration == pytest.approx(scene.duration, rel=4.0 * 2.0**-52)
    np.testing.assert_allclose(found.contacts.stiffness, scene.contacts.stiffness, rtol=STIFFNESS_WITHIN, atol=0.0)
    np.testing.assert_allclose(found.contacts.gap, scene.contacts.gap, rtol=0.0, atol=_gaps_within(deck))
    # eta, m_eff, R_eff and beta: four of them, each way
    c = scene.contacts
    np.testing.assert_allclose(found.contacts.damping, c.damping, rtol=4.0 * STIFFNESS_WITHIN, atol=0.0)
    assert np.all((found.contacts.damping_power == c.damping_power)[c.damping > 0.0])
    np.testing.assert_allclose(found.load, scene.load, rtol=ROUND_OFF, atol=0.0)


DRIVEN = tuple(name for name in shipped_scenes() if load_scene(name).drive is not None)
TAKEN = tuple(name for name in shipped_scenes() if GRANULAR_STYLE.covers(load_scene(name)) and name not in DRIVEN)


FORMS = [(name, "surrogate") for name in TAKEN] + [(name, "physical") for name in TAKEN if load_scene(name).spacing]


@pytest.mark.parametrize("types", ["euler", "per-body"])
@pytest.mark.parametrize(("name", "geometry"), FORMS)
def test_decks_of_the_shipped_scenes_give_the_shipped_scenes_back(name: str, types: str, geometry: str) -> None:
    """To the last digit: their numbers have 12, and are the shortest that the deck can mean. So are their motions."""
    scene = load_scene(name)
    form = Resolution(dt=1e-6, types=types, geometry=geometry)
    deck = LammpsGranular().deck(scene, form, Sampling(count=scene.samples))
    found = _own(deck)
    _same(found, scene, deck)
    assert found.content_hash == scene.content_hash
    assert found.precompression == scene.precompression
    assert found.name == scene.name


@pytest.mark.parametrize("name", DRIVEN)
def test_a_force_that_goes_with_time_is_refused(name: str) -> None:
    scene = load_scene(name)
    deck = LammpsGranular().deck(scene, Resolution(dt=1e-6), Sampling(count=scene.samples))
    with pytest.raises(SceneError, match=r"line \d+: `fix drive driven addforce v_drive 0 0` .*not a constant"):
        _own(deck)


HALF = st.sampled_from([2.0, 2.5])


@examples(40)
@given(
    st.one_of(scenes(exponents=HALF, walls=True, gravity=True), damped_scenes(exponents=HALF)),
    st.sampled_from(["euler", "per-body"]),
)
def test_decks_of_random_scenes_give_them_back(scene: Scene, types: str) -> None:
    deck = _deck(scene, types)
    _same(_own(deck, reverse=False), scene, deck)


def test_a_motion_is_the_same_within_what_its_numbers_are_known_to() -> None:
    """Gaps of 2 um and radii of no power of two: the deck's positions round them, and the motion follows."""
    scene = Scene(
        name="odd",
        duration=2e-4,
        mass=(8e-3, 1e-2, 1.3e-2),
        stiffness=(math.pi * 1e9, math.e * 1e9),
        gap=(2e-6 / 3.0, 0.0),
        velocity=(0.8, 0.0, 0.0),
        samples=20,
    )
    deck = _deck(scene, radius=9e-3)
    found = _own(deck)
    assert found.stiffness != ()
    _same(found, scene, deck)
    runs = [db.solve(one, backend="reference") for one in (scene, found)]
    # a gap that is off by g shifts a touch by g / v; accelerations are below F / m
    late = _gaps_within(deck) / 0.8 + STIFFNESS_WITHIN * 1e-4
    most = float(np.max(runs[0].peak_force)) / min(scene.mass) * late
    bars = sum(float(run.uncertainty["velocity"]) for run in runs)
    assert np.max(np.abs(runs[0].velocity - runs[1].velocity)) <= 3.0 * most + bars
    # a stiffness that is off by a millionth is not within it
    wrong = replace(found, stiffness=(found.stiffness[0] * (1.0 + 1e-6), found.stiffness[1]))
    other = db.solve(wrong, backend="reference")
    assert np.max(np.abs(runs[0].velocity - other.velocity)) > 3.0 * most + bars


def test_a_precompressed_chain_between_an_end_and_a_wall_is_one_again() -> None:
    scene = Scene(
        name="pressed",
        duration=1e-4,
        mass=(8e-3, 1e-2, 1.2e-2),
        stiffness=(4e9, 5e9),
        velocity=(0.1, 0.0, 0.0),
        wall_right=Wall(stiffness=3e9),
        gravity=9.81,
        precompression=20.0,
        samples=10,
    )
    for one in (
        scene,
        replace(scene, wall_right=None),
        replace(scene, wall_right=None, wall_left=Wall(stiffness=3e9), gravity=-9.81),
    ):
        found = _own(_deck(one))
        assert found.content_hash == one.content_hash
    # between two walls the overlaps are all there is to see
    held = replace(scene, wall_left=Wall(stiffness=2e9))
    found = _own(_deck(held))
    assert found.precompression == 0.0
    _same(found, held, _deck(held))


def test_a_load_without_its_equilibrium_is_refused() -> None:
    pressed = Scene(
        name="pressed", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0, 0), precompression=20.0
    )
    deck = _deck(pressed)
    text = deck.files[deck.input_file].replace("addforce 20.0", "addforce 20.1")
    with pytest.raises(SceneError, match=r"addforce -20.0 0 0` loads atom 2 with -20 N, .* has -20.1 N there"):
        read_deck(text, file="in.pressed", opened=deck.files.__getitem__)
    text = text.replace("addforce -20.0", "addforce -20.1")
    with pytest.raises(SceneError, match=r"contact 0 starts with an overlap of 2\.92\S*e-06 m instead of 2\.93"):
        read_deck(text, file="in.pressed", opened=deck.files.__getitem__)


def test_radii_that_carry_stiffnesses_are_read() -> None:
    scene = Scene(
        name="encoded",
        duration=1e-4,
        mass=(8e-3, 1e-2, 1.2e-2),
        stiffness=(4e9, 5e9),
        velocity=(0.8, 0, 0),
        samples=10,
    )
    deck = hertz_history(_deck(scene), scene, np.full(2, 1e-5))
    # six operations between beta and radii that carry it
    np.testing.assert_allclose(_own(deck).stiffness, scene.stiffness, rtol=2.0 * STIFFNESS_WITHIN)


def test_masses_from_a_file_are_read() -> None:
    """More than 300 runs of equal masses are no `set` lines."""
    mass = tuple(1e-2 + 1e-5 * k for k in range(310))
    scene = Scene(
        name="long", duration=1e-4, mass=mass, stiffness=(4e9,) * 309, velocity=(0.8,) + (0,) * 309, samples=10
    )
    deck = _deck(scene)
    assert "masses.long" in deck.files
    assert _own(deck).mass == scene.mass


# what others write


def test_a_small_script_and_what_is_told_of_it() -> None:
    found = read()
    assert found.scene == Scene(
        name="test",
        description="from in.test: the chain lies along x; body 0 is atom 1 (which moves), positive is +x",
        duration=1e-4,
        mass=(0.01,) * 3,
        stiffness=(7071067811.865475,) * 2,
        velocity=(0.5, 0.0, 0.0),
        wall_right=Wall(stiffness=7071067811.865475, exponent=2.5),
        samples=50,
    )
    assert found.scene.stiffness[0] == pytest.approx(1e11 * math.sqrt(0.005), rel=ROUND_OFF)
    assert found.notes[1] == "units si, pair_style granular, 4 atoms; its time step is 1e-07"


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_a_chain_may_lie_along_any_axis_either_way(axis: str) -> None:
    def atoms(sign: int) -> str:
        rows = [(1, -0.02), (1, 0.0), (1, 0.02), (2, 0.04)]
        return "\n".join(
            f"create_atoms {kind} single " + " ".join(f"{sign * x}" if one == axis else "0" for one in "xyz")
            for kind, x in rows
        )

    start = "group striker id 1\nvelocity striker set " + " ".join("0.5" if one == axis else "0" for one in "xyz")
    found = read(atoms=atoms(1), start=start, boundary="boundary f f f")
    assert found.scene.content_hash == read().scene.content_hash
    assert f"along {axis}; body 0 is atom 1" in found.notes[0]
    back = read(atoms=atoms(-1), start=start.replace("0.5", "-0.5"), boundary="boundary f f f")
    assert back.scene.content_hash == found.scene.content_hash
    assert f"positive is -{axis}" in back.notes[0]


def test_body_0_is_the_end_that_moves_unless_it_is_said() -> None:
    start = "group striker id 3\nvelocity striker set -0.5 0 0"
    free = {"fixes": "fix move all nve"}
    far = read(start=start.replace("3", "4"), **free)
    assert far.scene.velocity == (0.5, 0.0, 0.0, 0.0)
    text = script(start=start.replace("3", "4"), **free)
    near = read_deck(text, file="in.test", opened=NOTHING.__getitem__, reverse=False)
    assert near.scene.velocity == (0.0, 0.0, 0.0, -0.5)
    # an inner one decides nothing
    assert read(start=start, **free).scene.velocity == (0.0, 0.0, -0.5, 0.0)
    other = read_deck(script(), file="in.test", opened=NOTHING.__getitem__, reverse=True)
    assert other.scene.velocity == (0.0, 0.0, -0.5)
    assert other.scene.wall_left is not None
    assert "(the end of highest coordinate)" in other.notes[0]


@pytest.mark.parametrize(
    ("units", "length", "time", "mass"),
    [("si", 1.0, 1.0, 1.0), ("cgs", 1e-2, 1.0, 1e-3), ("micro", 1e-6, 1e-6, 1e-15), ("nano", 1e-9, 1e-9, 1e-21)],
)
def test_units_are_turned_into_si(units: str, length: float, time: float, mass: float) -> None:
    """The same chain, said in other units: twelve digits of each number are those of SI."""

    def said(value: float, unit: float) -> str:
        return f"{value / unit:.15g}"

    places = "\n".join(
        f"create_atoms {kind} single {said(x, length)} 0 0" for kind, x in ((1, -0.02), (1, 0), (1, 0.02), (2, 0.04))
    )
    half = said(0.1, length)
    found = read(
        units=f"units {units}",
        box=f"region box block -{half} {half} -{half} {half} -{half} {half}\ncreate_box 2 box",
        atoms=places,
        sizes=f"set type * diameter {said(0.02, length)} mass {said(0.01, mass)}",
        coefficients=(
            f"pair_coeff * * hertz {said(1e11, mass / length / time**2)} {said(3.0, mass / time)}"
            " tangential linear_nohistory 0 0 damping velocity limit_damping"
        ),
        start=f"group striker id 1\nvelocity striker set {said(0.5, length / time)} 0 0",
        more=f"fix g bodies gravity {said(9.81, length / time**2)} vector 1 0 0\n"
        f"fix drag bodies langevin 0 0 {said(0.02, time)} 1",
        step=f"timestep {said(1e-7, time)}",
    ).scene
    for value, wanted in (
        (found.mass[0], 0.01),
        (found.velocity[0], 0.5),
        (found.stiffness[0], 1e11 * math.sqrt(0.005)),
        (found.gravity, 9.81),
        (found.drag, 50.0),
        (found.duration, 1e-4),
        (found.contacts.damping[0], 3.0),
    ):
        assert value == pytest.approx(wanted, rel=1e-12)
    assert np.max(np.abs(found.contacts.gap)) < 1e-15


@pytest.mark.parametrize(
    ("coefficients", "damping"),
    [
        ("hertz 1e11 2 tangential linear_nohistory 0 0 damping mass_velocity limit_damping", ("dashpot", 0.01)),
        (
            "hertz 1e11 2 tangential linear_nohistory 0 0 limit_damping",  # viscoelastic is the default
            ("kuwabara-kono", 2 * 0.005 * math.sqrt(0.005) / (1e11 * math.sqrt(0.005))),
        ),
        ("hooke 1e7 2 tangential linear_nohistory 0 0 damping velocity limit_damping", ("dashpot", 2.0)),
    ],
)
def test_damping_is_that_of_the_manual(coefficients: str, damping: tuple[str, float]) -> None:
    found = read(coefficients=f"pair_coeff * * {coefficients}").scene.damping
    assert found is not None
    assert found.law == damping[0]
    assert isinstance(found.coefficient, tuple)
    assert found.coefficient[0] == pytest.approx(damping[1], rel=1e-14)


def test_a_body_under_fix_freeze_has_no_mass_in_the_effective_one() -> None:
    hertz = "pair_coeff * * hertz 1e11 2 tangential linear_nohistory 0 0 damping mass_velocity limit_damping"
    found = read(coefficients=hertz, more="group wall type 2\nfix hold wall freeze").scene
    assert found.damping == Damping(law="mass_velocity", coefficient=(2.0, 2.0, 2.0), clip=True)
    assert found.contacts.damping.tolist() == [0.01, 0.01, 0.02]


@pytest.mark.parametrize(("word", "law"), [("coeff_restitution", "coeff_restitution"), ("tsuji", "tsuji")])
def test_a_coefficient_of_restitution_is_that_of_the_scene(word: str, law: str) -> None:
    pair, freeze = f"pair_coeff * * hertz 1e11 0.5 damping {word}", "group wall type 2\nfix hold wall freeze"
    for clip, words in ((False, ""), (True, " limit_damping")):
        scene = read(coefficients=pair + words, more=freeze).scene
        assert scene.damping == Damping(law=law, coefficient=(0.5,) * 3, clip=clip)
    assert read(coefficients=pair.replace("0.5", "1"), more=freeze).scene.damped == (law == "tsuji")


@pytest.mark.parametrize("damping", [None, Damping(law="kuwabara-kono", coefficient=1e-5, clip=False)], ids=str)
def test_a_deck_with_adhesion_gives_its_scene_back(damping: Damping | None) -> None:
    scene = Scene(
        name="adhesive", duration=1e-3, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.3, 0.0), gap=1e-6, samples=20,
        wall_right=Wall(stiffness=3e9, gap=5e-6), adhesion=Adhesion(law="dmt", pull_off=(20.0, 0.4)), damping=damping,
    )  # fmt: skip
    read_back = _own(_deck(scene))
    assert read_back.adhesion is not None
    assert read_back.adhesion.pull_off == pytest.approx((20.0, 0.4), rel=4.0 * ROUND_OFF)
    _same(read_back, scene, _deck(scene))


@pytest.mark.parametrize("style", ["gran/hooke", "gran/hooke/history", "gran/hertz/history"])
def test_the_older_styles_have_one_law_for_all(style: str) -> None:
    found = read(pair=f"pair_style {style} 1e9 NULL 40 NULL 0.5 1 limit_damping", coefficients="pair_coeff * *").scene
    hertz = "hertz" in style
    assert found.exponent == ((2.5 if hertz else 2.0),) * 2
    beta = 1e9 * (math.sqrt(0.005) if hertz else 1.0)
    assert found.stiffness[0] == pytest.approx(beta, rel=1e-14)
    assert found.damping is not None
    assert isinstance(found.damping.coefficient, tuple)
    eta = 40 * 0.005
    assert found.damping.coefficient[0] == pytest.approx(eta * math.sqrt(0.005) / beta if hertz else eta, rel=1e-14)


def test_types_without_a_pair_are_mixed_as_lammps_does() -> None:
    """Stiffnesses by their geometric mean, materials by the sum of their compliances."""
    tail = "tangential linear_nohistory 0 0 damping velocity"
    plain_ = read(coefficients=f"pair_coeff 1 1 hertz 1e11 0 {tail}\npair_coeff 2 2 hertz 4e11 0 {tail}").scene
    assert plain_.wall_right is not None
    assert plain_.wall_right.stiffness == pytest.approx(2e11 * math.sqrt(0.005), rel=1e-14)
    stuff = read(
        coefficients=f"pair_coeff 1 1 hertz/material 2e11 0 0.3 {tail}\npair_coeff 2 2 hertz/material 1e11 0 0.2 {tail}"
    ).scene
    assert stuff.wall_right is not None
    effective = 1.0 / ((1 - 0.09) / 2e11 + (1 - 0.04) / 1e11)
    assert stuff.wall_right.stiffness == pytest.approx(4 / 3 * effective * math.sqrt(0.005), rel=1e-14)
    assert stuff.stiffness[0] == pytest.approx(4 / 3 * 2e11 / (2 * (1 - 0.09)) * math.sqrt(0.005), rel=1e-14)


def test_later_commands_change_what_earlier_ones_made() -> None:
    """A diameter that changes keeps the mass; a density takes the diameter at hand; the last pair_coeff holds."""
    sizes = "set type * diameter 0.02 density 1000\nset atom 2 diameter 0.018\nset atom 3 diameter 0.018 density 1000"
    mass = read(sizes=sizes).scene.mass
    volume = [math.pi / 6 * d**3 for d in (0.02, 0.02, 0.018)]
    assert mass == pytest.approx([1000 * one for one in volume], rel=1e-14)
    twice = PARTS["coefficients"] + "\npair_coeff 1 1 hertz 2e11 0 tangential linear_nohistory 0 0 damping velocity"
    found = read(coefficients=twice).scene
    assert found.wall_right is not None
    assert found.stiffness[0] == pytest.approx(2.0 * found.wall_right.stiffness, rel=1e-14)


def test_several_runs_are_one_and_a_fix_may_go_before_them() -> None:
    more = "fix odd all gravity 5 vector 1 0 0\nunfix odd"
    found = read(more=more, after="timestep 2e-7\nrun 100 pre no\nrun 1500 upto").scene
    assert found.duration == pytest.approx(1000 * 1e-7 + 500 * 2e-7, rel=1e-15)
    assert found.gravity == 0.0


def test_run_upto_counts_from_where_a_script_sets_the_counter() -> None:
    assert read(run="reset_timestep 400\nrun 1000 upto").scene.duration == pytest.approx(600 * 1e-7, rel=1e-15)
    again = read(after="reset_timestep 0\nrun 500 upto").scene
    assert again.duration == pytest.approx(1500 * 1e-7, rel=1e-15)


def test_a_variable_that_changes_behind_the_last_run_changes_nothing() -> None:
    more = "variable g equal 5\nfix weight all gravity v_g vector 1 0 0"
    assert read(more=more, after="variable g equal 7").scene == read(more=more).scene


def test_a_run_of_no_steps_is_no_start() -> None:
    assert read(start="run 0\n" + PARTS["start"]).scene == read().scene


def test_a_body_alone_has_walls_or_nothing() -> None:
    for walls in ((None, None), (Wall(stiffness=1e9), None), (Wall(stiffness=1e9), Wall(stiffness=2e9, gap=1e-6))):
        scene = Scene(
            name="alone",
            duration=1e-4,
            mass=(1e-2,),
            stiffness=(),
            velocity=(-0.5,),
            wall_left=walls[0],
            wall_right=walls[1],
            samples=10,
        )
        assert _own(_deck(scene)) == replace(scene, description=_own(_deck(scene)).description)


def test_forces_across_that_setforce_takes_away_are_none() -> None:
    more = "fix g bodies gravity 9.81 vector 0 0 -1\nfix s bodies setforce NULL 0 0"
    assert read(more=more).scene == read().scene


@pytest.mark.parametrize(
    ("dump", "samples", "note"),
    [
        ("dump d all atom 100 f", 10, None),
        ("dump d all atom 1 f\ndump_modify d every 250", 4, None),
        ("dump d all atom 300 f", 500, "1000 steps, and dumps every 300"),
        ("dump d all atom 1 f\ndump_modify d every v_next", 500, "no dump at equal intervals"),
        ("", 500, "no dump at equal intervals"),
    ],
)
def test_samples_are_the_frames_of_the_first_dump(dump: str, samples: int, note: str | None) -> None:
    found = read(dump=dump)
    assert found.scene.samples == samples
    assert (note is None) == (len(found.notes) == 2)
    assert note is None or note in found.notes[-1]


REFUSED = [
    # a part, what stands in its place, and what is said
    ({"units": "units metal"}, "line 1: `units metal` is not supported; allowed: units si or units cgs or"),
    ({"style": "atom_style ellipsoid"}, "`atom_style ellipsoid` is not supported; allowed: atom_style sphere"),
    ({"pair": "pair_style table linear 1000"}, "reads forces from a file, so that the force is not a power"),
    ({"pair": "pair_style hybrid granular none"}, "has more than one law for a pair"),
    ({"pair": "pair_style lj/cut 2.5"}, "has the style lj/cut, which is not supported; allowed: granular"),
    ({"pair": "pair_style gran/hooke 1e9 NULL"}, "has 2 settings; allowed: Kn Kt gamma_n"),
    ({"pair": ""}, "comes before pair_style"),
    ({"pair": "pair_style gran/hooke 1e9 NULL 0 0 0 0"}, "has coefficients, but gran/hooke has one law for all pairs"),
    ({"coefficients": "pair_coeff * * dmt 1e9 0 0.6 0 damping velocity"}, "has an impossible material; allowed: E > 0"),
    ({"coefficients": "pair_coeff * * dmt 0 0 0.3 0 damping velocity"}, "has an impossible material; allowed: E > 0"),
    ({"sizes": "set type 1 mass v_m"}, "uses the variable m, which is not defined"),
    ({"start": "set atom 1 omega 0 0 1"}, "slide on each other; allowed: no spin, or spins of which the sum of radius"),
    ({"coefficients": "pair_coeff * * jkr 1e9 0 0.3 10 damping velocity"}, "has the normal model jkr, which is not"),
    ({"coefficients": "pair_coeff * * dmt 1e9 0 0.3 -1 damping velocity"}, "has a surface energy below 0"),
    ({"coefficients": "pair_coeff * * dmt 1e9 5 0.3 1 damping velocity limit_damping"},
     "in.test, line 21: damping.clip = True, but contacts have adhesion, which a clip would remove; allowed"),
    ({"coefficients": "pair_coeff * * hertz 1e9 0.5 damping mdr"}, "has damping mdr, which is not supported"),
    ({"coefficients": "pair_coeff * * hertz 1e9 0 damping tsuji"}, "restitution of 0; allowed: a number above 0"),
    ({"coefficients": "pair_coeff * * hertz 1e9 1.1 damping coeff_restitution"}, "coefficient of restitution of 1.1"),
    ({"coefficients": "pair_coeff * * hertz 1e9 0.5 damping coeff_restitution"}, "atom; allowed: fix freeze for this"),
    ({"coefficients": "pair_coeff * * hertz 1e9 0.5 damping tsuji\npair_coeff 1 2 hertz 1e9 0 damping velocity",
      "more": "group w type 2\nfix h w freeze"}, "damps some contacts only, and tsuji damps for each e"),
    (
        {
            "coefficients": "pair_coeff * * hertz 1e9 5 damping velocity\n"
            "pair_coeff 1 2 hertz 1e9 5 damping velocity limit_damping"
        },
        "has another limit_damping than other contacts; allowed: limit_damping in all",
    ),
    ({"coefficients": "pair_coeff * * hertz 1e9 0 cutoff 0.1 damping velocity"}, "has the setting cutoff"),
    ({"coefficients": "pair_coeff * * hertz 1e9"}, "has 1 numbers for hertz; allowed: 2"),
    ({"coefficients": "pair_coeff * * hertz abc 0"}, "has 'abc' where a number is required"),
    ({"coefficients": "pair_coeff * * hertz inf 0"}, "has 'inf' where a number is required"),
    ({"coefficients": "pair_coeff 1 1 hertz 1e9 0 damping velocity"}, "leaves types 1 and 2, which meet, without"),
    ({"coefficients": "pair_coeff * * hertz 0 0 damping velocity"}, "leaves atoms 1 and 2, which are neighbours"),
    ({"coefficients": "pair_coeff 3 3 hertz 1e9 0 damping velocity"}, "has '3'; allowed: 1 to 2"),
    ({"fixes": "fix move all npt temp 1 1 1"}, "npt, which is not supported and may change the motion; allowed: nve"),
    ({"fixes": "", "start": ""}, "runs without any moving atom"),
    ({"fixes": "group inner id 1 3\nfix move inner nve"}, "with atom 2 frozen inside of the chain"),
    ({"fixes": "fix move all nve\nfix again all nve/sphere"}, "integrates atoms that another fix integrates"),
    ({"fixes": "fix move gone nve"}, "names the group gone, which is not defined; allowed: all, striker"),
    ({"more": "fix w all wall/gran hooke 1 1 1 1 1 1 xplane 0 1"}, "has an atom behind it; allowed: all atoms of"),
    ({"more": "fix w all wall/gran hooke 1 1 0 1 1 1 limit_damping"}, "has no wall that is supp"),
    ({"more": "fix w all wall/gran hooke 1 1 0 1 1 1 zcylinder 1"}, "has a wall zcylinder 1, which is not supported"),
    ({"more": "fix w all wall/gran hooke 1 1 0 1 1 1 xplane -1 NULL wiggle x 1 1"}, "wiggle x 1 1, which is not supp"),
    ({"more": "fix w all wall/gran odd 1 xplane -1 NULL"}, "has the force style odd, which is not"),
    ({"more": "fix w all wall/gran hooke 1 1 0 1 1 1 zplane -0.009 NULL"}, "touches atom 1 from the side, across the"),
    ({"more": "fix w all wall/gran hooke 1 1 0 1 1 1 xplane -1 1\nfix u all wall/gran hooke 1 1 0 1 1 1 xplane -1 1"},
     "is the second wall at one end, with fix w all wall/gran"),
    ({"more": "fix w all wall/gran/region hooke 1 1 0 1 1 1 region gone"}, "names the region gone, which is not def"),
    ({"more": "region r plane -1 0 0 1 1 0\nfix w all wall/gran/region hooke 1 1 0 1 1 1 region r"},
     "is a plane that is not perpendicular to an axis"),
    ({"more": "region r block 0 1 0 1 0 1 side out\nfix w all wall/gran/region hooke 1 1 0 1 1 1 region r"},
     "is a block whose bodies are outside"),
    ({"more": "region r sphere 0 0 0 1\nfix w all wall/gran/region hooke 1 1 0 1 1 1 region r"}, "is a wall that is n"),
    ({"more": "region r block -1 1 -1 1 -0.009 1\nfix w all wall/gran/region hooke 1 1 0 1 1 1 region r"},
     "touches atom 1 from the side"),
    ({"more": "fix g striker gravity 9.81 vector 1 0 0"}, "gives atom 1 9.81 and atom 2 0; allowed: the same"),
    ({"more": "fix g bodies gravity 9.81 vector 0 0 -1"}, "with a force on atom 1 along z, across the chain"),
    ({"more": "fix s bodies setforce NULL 0 0\nfix g bodies gravity 9.81 vector 0 0 -1"}, "on atom 1 along z, across"),
    ({"more": "fix h all setforce 0 0 0\nfix g all gravity 9.81 vector 1 0 0", "start": ""},
     "`fix h all setforce 0 0 0` comes before a force on atom 1, which then moves it"),
    ({"more": "fix g bodies gravity 9.81 chute 20"}, "with a force on atom 1 along z, across the chain"),
    ({"more": "fix g bodies gravity 9.81 gradient 1 0 0"}, "allowed: fix ID GROUP gravity MAGNITUDE vector"),
    ({"more": "fix v bodies viscous -1"}, "adds energy; allowed: gamma >= 0"),
    ({"more": "fix t bodies langevin 300 300 0.1 1"}, "is not a pure drag"),
    ({"more": "fix a striker addforce v_f 0 0"}, "uses the variable f, which is not defined"),
    ({"more": "group m id 2\nfix a m addforce 1 0 0"}, "loads atom"),
    ({"more": "fix a striker addforce -1 0 0"}, "is not a load that compresses a chain"),
    ({"more": "fix s striker setforce 1 0 0"}, "sets a force other than 0; allowed: 0 or NULL"),
    ({"more": "velocity all set 0 0 0.1"}, "with atoms that move off the line along x, by 0.1 along z"),
    ({"more": "group w id 4\nvelocity w set 0.1 0 0"}, "atom 4, which no fix nve moves although it has a velocity"),
    ({"more": "fix s all setforce 0 0 0\n"}, "which setforce or freeze holds although it has a velocity"),
    ({"more": "minimize 0 0 100 100"}, "is not supported and may change the motion"),
    ({"more": "neigh_modify exclude type 1 2"}, "excludes pairs that may touch"),
    ({"more": "neigh_modify every 1000000 delay 0 check no"}, "may miss bodies that meet between two rebuilds"),
    ({"more": "neigh_modify delay 5000"}, "may miss bodies that meet between two rebuilds"),
    ({"more": "neigh_modify once yes"}, "may miss bodies that meet between two rebuilds"),
    ({"more": "run_style respa 2 2"}, "is not supported; allowed: run_style verlet"),
    ({"more": "if 1 then quit"}, "is the last command, but there is no run; allowed: run N"),
    ({"more": "if 1 quit"}, '`if 1 quit` is not supported; allowed: if "CONDITION" then'),
    ({"more": 'if "ke > 1" then quit'}, "has the formula 'ke > 1', which is not a constant"),
    ({"more": "label again\njump SELF again"}, "is in a loop that does not end, or takes too long; allowed: 100000"),
    ({"more": "label again\nprint a\njump SELF gone"}, "jumps to the label gone, which is not in the file"),
    ({"more": "next i"}, "names i, which has no further values"),
    ({"more": "lattice hcp 1"}, "`lattice hcp 1` is not supported; allowed: lattice none or sc"),
    ({"start": "velocity all create 1 1"}, "allowed: velocity GROUP set vx vy vz"),
    ({"start": "group striker include a"}, "allowed: id, type, region, union"),
    ({"start": "group striker region gone"}, "names the region gone, which is not defined"),
    ({"start": "region r cone x 0 0 1 1 0 1\ngroup striker region r"}, "allowed: region ID block xlo"),
    ({"atoms": "create_atoms 1 box"}, "allowed: create_atoms TYPE single x y z"),
    ({"atoms": "create_atoms 1 single 0.2 0 0"}, "is outside of the box along x; allowed: from -0.1 to"),
    ({"atoms": "create_atoms 3 single 0 0 0"}, "has the atom type 3; allowed: 1 to 2"),
    ({"atoms": PARTS["atoms"].replace("0.02 0 0", "0.02 1e-9 0")}, "that lie off the line along x, by 1e-09 along y"),
    ({"atoms": PARTS["atoms"].replace("-0.02", "-0.009")}, "runs with atoms 1 and 2 0.009 apart, of radii 0.01"),
    ({"box": "region box sphere 0 0 0 1\ncreate_box 2 box"}, "allowed: region ID block xlo"),
    ({"sizes": "set type 1 charge 1"}, "sets charge, which is not supported"),
    ({"sizes": "set atom 9 mass 1"}, "has '9'; allowed: 1 to 4"),
    ({"sizes": "set type 1 mass -1"}, "sets mass to -1; allowed: a number > 0"),
    ({"step": "timestep 0"}, "has no valid time step"),
    ({"run": "run 1.5"}, "has '1.5' where a whole number is required"),
    ({"run": 'run 100 every 10 "velocity all set 0 0 0"'}, "allowed: run N [upto]"),
    ({"run": ""}, "there is no run; allowed: run N, or the setting duration"),
    ({"after": "velocity all set 0 0 0\nrun 10"}, "comes between runs in lines 21 and 23, but a scene has one"),
    ({"more": "variable g equal 5\nfix weight all gravity v_g vector 1 0 0",
      "after": "variable g equal 7\nrun 100"}, "has other forces than the run in line 22; allowed: the same"),
    ({"more": "reset_timestep 1 time 0.5"}, "is not supported; allowed: reset_timestep N"),
    ({"atoms": "create_atoms 1 single 0.1 0 0"}, "is outside of the box along x; allowed: from -0.1 to below 0.1"),
    ({"boundary": "boundary p p p", "run": "run 9000000"}, "periodic along the chain and 0.2 long, so that its ends"),
    ({"boundary": "boundary f p p", "box": PARTS["box"].replace("-0.1 0.1", "-0.1 0.1", 1).replace(
        "block -0.1 0.1 -0.1 0.1", "block -0.1 0.1 -0.009 0.009")}, "0.018 wide along y, so that atoms meet their"),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "why"), REFUSED, ids=[why[:40] for _, why in REFUSED])
def test_what_is_not_understood_is_refused_in_one_line(changes: dict[str, str], why: str) -> None:
    with pytest.raises(SceneError) as caught:
        read(**changes)
    text = str(caught.value)
    assert why in text
    assert text.startswith("in.test, line ")
    assert "allowed: " in text
    assert "\n" not in text


WORDS = ["0", "1", "-1", "1e400", "nan", "*", "2*", "v_x", "${x}", "$(1/0)", "all", "NULL", '"', "&", "#", "granular",
         "set", "vector", "index", "equal", "é", "single", "hertz", "fix", "run", "units"]  # fmt: skip


@examples(400)
@given(st.lists(st.tuples(st.integers(0, 10**6), st.sampled_from(["drop", "put", "swap"]), st.sampled_from(WORDS)),
                min_size=1, max_size=4))  # fmt: skip
def test_whatever_is_done_to_a_script_it_is_read_or_refused_in_one_line(edits: list[tuple[int, str, str]]) -> None:
    lines = [line.split(" ") for line in script(more="fix g all gravity 1 vector 1 0 0").splitlines()]
    places = [(i, k) for i, line in enumerate(lines) for k in range(len(line))]
    for nth, how, word in edits:
        i, k = places[nth % len(places)]
        if k < len(lines[i]):
            lines[i][k : k + 1] = [] if how == "drop" else [word] if how == "put" else [word, lines[i][k]]
    said = "in.test; allowed: "
    try:
        read_deck("\n".join(" ".join(line) for line in lines), file="in.test", opened=NOTHING.__getitem__)
    except SceneError as error:
        said = str(error)
    for line in said.splitlines():  # one for each command that cannot be read
        assert line.startswith("in.test")
        assert "allowed: " in line


DATA = """a data file

4 atoms
1 atom types
-0.1 0.1 xlo xhi
-0.1 0.1 ylo yhi
-0.1 0.1 zlo zhi

Atoms # sphere

1 1 0.02 1000 -0.02 0 0
2 1 0.02 1000 0 0 0 0 0 0
4 1 0.02 1000 0.04 0 0
3 1 0.02 1000 0.02 0 0

Velocities

1 0.5 0 0 0 0 0
"""


def _of_data(data: str) -> Scene:
    changes = {"box": "read_data data.test", "atoms": "", "sizes": "", "start": "", "fixes": "fix m all nve"}
    return read({"data.test": data}, **changes).scene


def test_a_data_file_is_read_by_its_ids() -> None:
    found = _of_data(DATA)
    assert found.velocity == (0.5, 0.0, 0.0, 0.0)
    assert found.mass == pytest.approx([1000 * math.pi / 6 * 8e-6] * 4, rel=1e-14)


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("4 atoms", "5 atoms", "`read_data data.test` data.test has 4 atoms"),
        ("1 1 0.02 1000 -0.02 0 0", "1 1 -0.02 0 0", "data.test, line 11: `1 1 -0.02 0 0` has 5 columns"),
        ("Atoms # sphere", "Atoms # molecular", "has atom style molecular; allowed: Atoms # sphere"),
        ("3 1 0.02", "2 1 0.02", "repeats atom 2"),
        ("3 1 0.02", "3 2 0.02", "has the atom type 2; allowed: 1 to 1"),
        ("3 1 0.02", "3 1 0", "has a diameter or density that is not positive"),
        ("1 0.5 0 0 0 0 0", "1 0.5 0 0 0 0 9", "`1 0.5 0 0 0 0 9` has an angular velocity; allowed: wx wy wz of 0"),
        ("1 0.5 0 0 0 0 0", "7 0.5 0 0 0 0 0", "is not the velocity of an atom of this file"),
        ("0 0 0 0 0 0\n4", "0 0 0 1 0 0\n4", "is an atom that has left the box; allowed: image flags of 0"),
        ("Velocities", "Bonds", "`Bonds` is a section that is not supported; allowed: Atoms, Velocities"),
        ("1 atom types", "1 atom types\n3 bonds", "`3 bonds` is not supported"),
    ],
)
def test_a_data_file_that_is_not_understood_is_refused_by_its_line(old: str, new: str, why: str) -> None:
    assert old in DATA
    with pytest.raises(SceneError) as caught:
        _of_data(DATA.replace(old, new))
    assert why in str(caught.value)
    assert "\n" not in str(caught.value)


@given(st.floats(1e-300, 1e300), st.sampled_from([0.0, 1e-15, 1e-12, 1e-3]))
def test_the_shortest_decimal_is_within_its_bound(value: float, part: float) -> None:
    found = plain(value, part * value)
    assert abs(found - value) <= part * value
    assert len(repr(found)) <= len(repr(value))


# faults in a deck are seen in the scene


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("hertz 1e11", "hertz 1.000001e11", "stiffness"),
        ("mass 0.01", "mass 0.01\nset atom 2 mass 0.0100000001", "mass"),
        ("single 0.02 0 0", "single 0.0200000001 0 0", "gap"),
        ("set 0.5 0 0", "set -0.5 0 0", "velocity"),
        ("run 1000", "run 1001", "duration"),
    ],
)
def test_a_fault_in_a_script_changes_the_scene(old: str, new: str, what: str) -> None:
    good = read().scene
    text = script()
    assert old in text
    bad = read_deck(text.replace(old, new), file="in.test", opened=NOTHING.__getitem__, samples=50).scene
    assert bad.content_hash != good.content_hash
    assert getattr(bad, what) != getattr(good, what)


def test_a_mirrored_chain_is_another_scene_when_it_is_not_symmetric() -> None:
    """The order of contacts turns with that of bodies."""
    scene = Scene(
        name="uneven",
        duration=1e-4,
        mass=(1e-2, 2e-2, 3e-2),
        stiffness=(1e9, 2e9),
        gap=(0.0, 1e-6),
        velocity=(0.8, 0, -0.1),
        samples=10,
    )
    there = _own(_deck(scene))
    back = _own(_deck(scene), reverse=True)
    assert there.content_hash == scene.content_hash
    assert back.mass == scene.mass[::-1]
    assert back.stiffness == scene.stiffness[::-1]
    assert back.contacts.gap.tolist() == [1e-6, 0.0]
    assert back.velocity == (0.1, 0.0, -0.8)
    assert line_order(back).tolist() == [0, 1]


def test_a_wall_has_its_own_material_and_a_pair_mixes() -> None:
    """Lammps#4141: E and nu of fix wall/gran hold for both bodies."""
    wall = "fix w all wall/gran granular hertz/material 4e11 0 0.1 damping velocity xplane -0.03 NULL"
    found = read(more=wall, coefficients="pair_coeff * * hertz/material 2e11 0 0.3 damping velocity")
    assert found.scene.wall_left is not None
    effective = 4e11 / (2 * (1 - 0.1**2))
    assert found.scene.wall_left.stiffness == pytest.approx(4 / 3 * effective * math.sqrt(0.01), rel=1e-14)
    assert found.scene.wall_left.gap == 0.0
    assert "the wall of fix w has E and nu of its command, which LAMMPS does not mix" in found.notes[2]
    assert not any(
        "fix w" in note for note in read(more=wall.replace("hertz/material 4e11 0 0.1", "hertz 1e9 0")).notes
    )


def test_a_plane_between_two_regions_of_bodies_and_one_for_others_are_no_walls() -> None:
    far = "group others id 2:3\nfix w others wall/gran hooke 1 1 0 1 1 1 xplane -0.035 NULL"
    assert read(more=far).scene == read().scene
    across = "fix w all wall/gran hooke 1 1 0 1 1 1 zplane -0.02 0.02\nregion r block -9 9 -1 1 -1 1 open 1 open 2\n"
    assert read(more=across + "fix r all wall/gran/region hooke 1 1 0 1 1 1 region r").scene == read().scene
    # behind the frozen atom
    assert read(more="fix w all wall/gran hooke 1 1 0 1 1 1 xplane NULL 0.06").scene == read().scene


def test_a_falling_body_has_the_axis_of_its_weight() -> None:
    found = read(
        atoms="create_atoms 1 single 0 0 0.05",
        start="",
        more="fix g all gravity 9.81 spherical 0 180\nfix w all wall/gran hooke 1e6 1 0 1 1 1 zplane 0 NULL",
        fixes="group bodies type 1\nfix move bodies nve",
        boundary="boundary f f f",
    )
    assert (found.scene.gravity, found.scene.n_body) == (-9.81, 1)
    assert found.scene.wall_left == Wall(stiffness=1e6, gap=0.04, exponent=2.0)


def test_units_lj_and_a_script_without_units_are_read_as_si() -> None:
    for units in ("units lj", ""):
        found = read(units=units)
        assert found.scene == read().scene
        assert "units lj have no dimensions" in found.notes[2]
    no_step = {"step": "", "start": ""}
    assert read(units="units lj", **no_step).scene.duration == pytest.approx(1000 * 0.005, rel=1e-14)


def test_the_script_ends_where_it_clears_or_quits() -> None:
    found = read(after="clear\nunits metal\nodd")
    assert found.scene == read().scene
    assert "read up to line 22, where `clear` begins another simulation" in found.notes[2]
    assert read(after="quit\nodd").scene == read().scene


def test_the_time_steps_of_all_runs_are_known() -> None:
    assert read(after="timestep 2e-7\nrun 10\nrun 0").time_steps == (1e-7, 2e-7)
    text = script(run="")
    assert read_deck(text, file="in.test", opened=NOTHING.__getitem__, duration=1e-4).time_steps == (1e-7,)
    cgs = read(units="units cgs")
    assert cgs.time_steps == (1e-7,)


def test_the_size_of_the_box_and_the_step_are_known_at_once_but_not_in_a_fix() -> None:
    box = read(sizes="set type * diameter $((xhi-xlo)/10) mass $(lx/20)")
    assert box.scene == read().scene
    assert read(run="run $(1e-4/dt:%.0f)").scene == read().scene
    with pytest.raises(SceneError, match=r"has the formula 'step', which is not a constant"):
        read(more="variable g equal step\nfix g all gravity v_g vector 1 0 0")


@pytest.mark.parametrize("every", ["9" * 5000, "²", "v_every"])
def test_an_interval_of_a_dump_that_is_no_ordinary_number_leaves_the_default(every: str) -> None:
    expected = read(dump="").scene.samples
    assert read(dump=f"dump d all custom {every} dump.txt id x vx").scene.samples == expected
    assert read(dump=f"dump d all custom 20 dump.txt id x vx\ndump_modify d every {every}").scene.samples == expected
    index = f"variable per_sample index {every}"
    assert read(dump=index).scene.samples == expected
