"""The motion of ``fix move`` in scripts: what is a piston is read, and what is none is refused by name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import dem_bridge as db
from dem_bridge.errors import SceneError
from dem_bridge.lmp.reader.to_scene import ReadDeck
from dem_bridge.scene.piston import Piston
from dem_bridge.scene.scene import Damping, Wall
from tests.helpers.driven_chains import PISTONS, pushed
from tests.helpers.lammps_scripts import read

#: gravity, drag and loads act on the other bodies only; by restitution the mass of the piston counts
PHYSICS: dict[str, dict[str, Any]] = {
    "plain": {},
    "damped": {"damping": Damping(law="coeff_restitution", coefficient=0.5), "gravity": 50.0, "drag": 100.0},
    "pressed": {"precompression": 100.0},
    "walled": {"wall_right": Wall(stiffness=5e9, gap=1e-6)},
}


@pytest.mark.parametrize("kind", PISTONS)
@pytest.mark.parametrize("physics", PHYSICS)
def test_a_deck_of_a_piston_is_read_as_its_scene(kind: str, physics: str, tmp_path: Path) -> None:
    scene = pushed(kind, **PHYSICS[physics])
    db.write_deck(scene, tmp_path, dt=1e-7)
    again = db.scene_from_deck(tmp_path / f"in.{scene.name}")
    assert again.content_hash == scene.content_hash
    assert again.drive == scene.drive


def _moved(move: str, more: str = "", **changes: str) -> ReadDeck:
    """Return what is read of a script with the left atom, of three that are free and one that is not, moved."""
    fixes = f"{more}\ngroup piston id 1\ngroup bodies type 1\ngroup others subtract bodies piston\nfix 1 others nve"
    return read(**{"start": "", "fixes": f"{fixes}\nfix 2 piston move {move}", "step": "timestep 1e-6", **changes})


USERS: dict[str, tuple[str, str, Piston]] = {
    "linear": ("linear 0.25 0 NULL", "", Piston(shape="constant", velocity=0.25)),
    "units": ("linear 0.25 0 0 units box", "", Piston(shape="constant", velocity=0.25)),
    "wiggle": (
        "wiggle -0.001 0.0 0.0 0.01",
        "",
        Piston(shape="sine", velocity=0.6283185307179586, frequency=100.0, phase=-90.0),
    ),
    "a slow cosine": (
        "variable v_x NULL NULL v_v NULL NULL",
        "variable x equal 0.2/(2*PI*150)*sin(2*PI*150*step*dt)\nvariable v equal 0.2*cos(2*PI*150*step*dt)",
        Piston(shape="sine", velocity=0.2, frequency=150.0, phase=90.0),
    ),
    "a fast sine": (
        "variable v_x NULL NULL v_v NULL NULL",
        "variable w equal 2*PI*2e5\nvariable a equal v_w*step*dt\n"
        "variable x equal 0.2/v_w*(1-cos(v_a))\nvariable v equal 0.2*sin(v_a)",
        Piston(shape="sine", velocity=0.2, frequency=2e5, phase=0.0),
    ),
    "a constant": (
        "variable v_x NULL NULL v_v NULL NULL",
        "variable x equal -0.5*step*dt\nvariable v equal -0.5",
        Piston(shape="constant", velocity=-0.5),
    ),
}


@pytest.mark.parametrize(("move", "more", "expected"), USERS.values(), ids=USERS)
def test_the_motion_that_users_write_is_read(move: str, more: str, expected: Piston) -> None:
    scene = _moved(move, more).scene
    piston = scene.piston
    assert piston is not None
    assert (piston.shape, scene.n_body, scene.wall_right is not None) == (expected.shape, 3, True)
    for name in ("velocity", "frequency"):
        assert (getattr(piston, name) or 0.0) == pytest.approx(getattr(expected, name) or 0.0, rel=1e-10)
    assert piston.phase == pytest.approx(expected.phase, abs=1e-7)


def test_a_velocity_alone_is_read_with_a_note() -> None:
    deck = _moved("variable NULL NULL NULL v_v NULL NULL", "variable v equal 0.1*sin(2*PI*2000*step*dt)")
    assert deck.scene.piston == Piston(shape="sine", velocity=0.1, frequency=2000.0)
    assert any("to first order in the time step" in note for note in deck.notes)


@pytest.mark.parametrize(("step", "told"), [("step*dt", False), ("step*1e-6", True)])
def test_a_time_step_as_a_number_in_a_formula_is_told(step: str, told: bool) -> None:
    deck = _moved("variable NULL NULL NULL v_v NULL NULL", f"variable v equal 0.1*sin(2*PI*2000*{step})")
    assert any("write step*dt" in note for note in deck.notes) is told


def test_a_piston_at_the_other_end_is_body_0() -> None:
    pistons = "group piston id 3\ngroup bodies id 1 2\nfix 1 bodies nve\nfix 2 piston move linear -0.25 0 0"
    atoms = "\n".join(f"create_atoms 1 single {x} 0 0" for x in (-0.02, 0, 0.02))
    scene = read(start="", fixes=pistons, atoms=atoms).scene
    assert (scene.piston, scene.n_body) == (Piston(shape="constant", velocity=0.25), 3)
    assert scene.velocity == (0.25, 0.0, 0.0)


def test_units_and_lattice_count() -> None:
    # cm/s and cm: a tenth of a cm each 0.1 s, and a lattice of 2 cm
    changes = {"units": "units cgs\nlattice sc 2.0", "box": "region box block -9 9 -9 9 -9 9\ncreate_box 2 box"}
    atoms = "\n".join(f"create_atoms {kind} single {x} 0 0 units box" for kind, x in ((1, -2), (1, 0), (1, 2), (2, 4)))
    sizes = "set type 1*2 diameter 2.0\nset type 1*2 mass 10.0"
    scene = _moved("linear 5 0 0", units=changes["units"], box=changes["box"], atoms=atoms, sizes=sizes).scene
    assert scene.piston == Piston(shape="constant", velocity=0.1)


BAD: dict[str, tuple[str, str, str]] = {
    "rotate": ("rotate 0 0 0 0 0 1 10", "", "moves atoms in a way that is not supported"),
    "no number": ("linear 1 0", "", "moves atoms in a way that is not supported"),
    "across": ("linear 1 0.5 0", "", "moves an atom across the chain"),
    "not along": ("linear NULL 0 0", "", "does not move the atom along the chain"),
    "still": ("wiggle 0 0 0 1", "", "has no amplitude or no period"),
    "no velocity": ("variable v_x NULL NULL NULL NULL NULL", "variable x equal step", "no velocity along the chain"),
    "neither": (
        "variable NULL NULL NULL v_v NULL NULL",
        "variable v equal 0.1*sin(2000*step*dt)^2*step*dt",
        "neither constant, nor a sine, nor a table",
    ),
    "another displacement": (
        "variable v_x NULL NULL v_v NULL NULL",
        "variable x equal 0.1*step*dt\nvariable v equal 0.2",
        "not the integral of its velocity: 0.0001 m off at step 1000",
    ),
    "twice": ("linear 1 0 0\nfix 3 all nve", "", "integrates atoms that another fix integrates"),
}


@pytest.mark.parametrize(("move", "more", "said"), BAD.values(), ids=BAD)
def test_what_is_no_piston_is_refused_with_its_line(move: str, more: str, said: str) -> None:
    with pytest.raises(SceneError) as caught:
        _moved(move, more)
    assert said in str(caught.value)


@pytest.mark.parametrize("which", ["2", "1 3"])
def test_a_moved_atom_inside_or_at_both_ends_is_refused(which: str) -> None:
    others = " ".join({"1", "2", "3"} - {*which.split()})
    fixes = f"group piston id {which}\ngroup bodies id {others}\nfix 1 bodies nve\nfix 2 piston move linear 1 0 0"
    with pytest.raises(SceneError, match="one of them, the first of the chain"):
        read(start="", fixes=fixes)


def test_a_deck_with_a_wrong_mass_of_its_piston_is_another_scene(tmp_path: Path) -> None:
    scene = pushed("constant", damping=Damping(law="coeff_restitution", coefficient=0.5))
    db.write_deck(scene, tmp_path, dt=1e-7)
    path = tmp_path / f"in.{scene.name}"
    path.write_text(path.read_text(encoding="utf-8").replace("mass 0.005", "mass 0.05"), encoding="utf-8")
    assert db.scene_from_deck(path).mass == (0.05, *scene.mass[1:])
    assert replace(scene, mass=(0.05, *scene.mass[1:])).contacts.damping[0] != scene.contacts.damping[0]
