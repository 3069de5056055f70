"""LAMMPS runs scripts of others as they are, and the scenes read from them move as it says.

Velocity-Verlet at h, h/2 and h/4: the difference to the reference falls as the step allows, and what is left when the
two finest are extrapolated is a small part of it. So nothing in a scene differs from its script by more than that.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import dem_bridge as db
from dem_bridge.lmp.process import run_deck
from dem_bridge.lmp.reader.evaluation import UNITS
from dem_bridge.scene.scene import Scene
from tests.helpers.lammps_scripts import PARTS, script

pytestmark = pytest.mark.lammps

DECKS = Path(__file__).parents[2] / "data" / "decks"
Floats = NDArray[np.float64]

#: what is left of the finest difference after extrapolation: steps are small, but not infinitely so, and contacts open
LEFT = 0.05


def _velocities(dump: str, column: str, ids: list[int]) -> Floats:
    """Of atoms in the order of ``ids``, ``(n_t, n_body)``."""
    frames = []
    for frame in dump.split("ITEM: ATOMS ")[1:]:
        heading, *rows = frame.split("ITEM:")[0].strip().splitlines()
        at = heading.split()
        table = {int(row.split()[at.index("id")]): float(row.split()[at.index(column)]) for row in rows}
        frames.append([table[one] for one in ids])
    return np.array(frames)


def _run(folder: Path, files: Mapping[str, str], name: str, changes: Mapping[str, str]) -> str:
    """The text dump that LAMMPS writes."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for file, text in files.items():
        for old, new in changes.items() if file == name else ():
            assert old in text
            text = text.replace(old, new)
        (folder / file).write_text(text)
    run_deck(folder, name, time_limit=60.0)
    [dump] = folder.glob("dump.*")
    return dump.read_text()


def _differences(found: list[Floats], scene: Scene, order: int) -> tuple[list[float], float]:
    """Of each run from the reference, and of the two finest, extrapolated; relative to the largest velocity."""
    truth = db.solve(scene, backend="reference")
    scale = float(np.max(np.abs(truth.velocity)))
    finer = found[-1] + (found[-1] - found[-2]) / (2.0**order - 1.0)
    assert float(truth.uncertainty["velocity"]) < 1e-10 * scale
    return (
        [float(np.max(np.abs(one - truth.velocity))) / scale for one in found],
        float(np.max(np.abs(finer - truth.velocity))) / scale,
    )


OTHERS = {
    # its axis, atoms as the scene has them, lines for the steps h, h/2, h/4
    "brass": (
        "vz",
        [7, 6, 5, 4, 3, 2],
        [{"index 1.0e-8": f"index {1e-8 / k!r}", "index 200": f"index {200 * k}"} for k in (1, 2, 4)],
    ),
    "cradle": (
        "vx",
        [3, 4, 2, 1],
        [
            {
                "dt index 2.0e-8": f"dt index {2e-8 / k!r}",
                "every index 100": f"every index {100 * k}",
                "index 10000": f"index {10000 * k}",
            }
            for k in (1, 2, 4)
        ],
    ),
}


@pytest.mark.parametrize("name", list(OTHERS))
def test_a_deck_of_others_and_the_scene_read_from_it_move_alike(name: str, tmp_path: Path) -> None:
    column, ids, steps = OTHERS[name]
    files = {file.name: file.read_text() for file in DECKS.glob(f"*.{name}")}
    scene = db.scene_from_deck(DECKS / f"in.{name}")
    # both are struck from above
    found = [-_velocities(_run(tmp_path / "run", files, f"in.{name}", one), column, ids) for one in steps]
    errors, left = _differences(found, scene, order=2)
    assert errors[0] < 3e-7
    for coarse, fine in pairwise(errors):
        assert 3.8 < coarse / fine < 4.2  # order 1.93 to 2.07
    assert left < LEFT * errors[-1]
    for wrong in _faults(scene):
        assert _differences(found, wrong, order=2)[1] > 10.0 * LEFT * errors[-1], wrong.name


def _faults(scene: Scene) -> list[Scene]:
    """A stiffness and a mass that are off by a millionth, and the chain from its other end."""
    links = len(scene.stiffness)
    assert isinstance(scene.gap, tuple)
    return [
        replace(scene, name="stiff", stiffness=(*scene.stiffness[:-1], scene.stiffness[-1] * (1.0 + 1e-6))),
        replace(scene, name="heavy", mass=(*scene.mass[:1], scene.mass[1] * (1.0 + 1e-6), *scene.mass[2:])),
        replace(scene, name="turned", stiffness=scene.stiffness[::-1], gap=scene.gap[::-1], mass=scene.mass[::-1]),
        replace(scene, name="apart", gap=(*(0.0,) * (links - 1), 1e-9)),
    ]


GRANULAR = "tangential linear_nohistory 0 0 damping"
#: what is changed in the small script
CASES = {
    "material, mixed": {
        "coefficients": f"pair_coeff 1 1 hertz/material 2e11 0 0.3 {GRANULAR} velocity\n"
        f"pair_coeff 2 2 hertz/material 1e11 0 0.2 {GRANULAR} velocity"
    },
    "hooke, mixed": {
        "coefficients": f"pair_coeff 1 1 hooke 2e7 0 {GRANULAR} velocity\n"
        f"pair_coeff 2 2 hooke 9e7 0 {GRANULAR} velocity"
    },
    "types named the other way round": {
        "coefficients": f"pair_coeff * * hertz 1e11 0 {GRANULAR} velocity\n"
        f"pair_coeff 2 1 hertz 3e11 0 {GRANULAR} velocity"
    },
    "damping, mixed": {
        "coefficients": f"pair_coeff 1 1 hertz 2e11 10 {GRANULAR} velocity limit_damping\n"
        f"pair_coeff 2 2 hertz 1e11 90 {GRANULAR} velocity limit_damping"
    },
    "mass_velocity": {"coefficients": f"pair_coeff * * hertz 1e11 2e3 {GRANULAR} mass_velocity limit_damping"},
    "frozen": {
        "coefficients": f"pair_coeff * * hertz 1e11 2e3 {GRANULAR} mass_velocity limit_damping",
        "more": "group wall type 2\nfix hold wall freeze",
    },
    "viscoelastic": {"coefficients": "pair_coeff * * hertz 1e11 2e7 tangential linear_nohistory 0 0 limit_damping"},
    "gran/hooke": {
        "pair": "pair_style gran/hooke 1e7 NULL 2e3 NULL 0.5 1 limit_damping",
        "coefficients": "pair_coeff * *",
    },
    "gran/hertz/history": {
        "pair": "pair_style gran/hertz/history 1e11 NULL 2e7 NULL 0.5 1 limit_damping",
        "coefficients": "pair_coeff * *",
    },
    "weight, drag": {
        "more": "fix g all gravity 500 vector 2 0 0\nfix drag bodies langevin 0 0 1e-3 7\n"
        "fix line bodies setforce NULL 0 0"
    },
    "density, types": {
        "sizes": "set type 1*2 diameter 0.02 density 2500\nset atom 2 diameter 0.018 type 2\n"
        "set atom 2 x -0.001 vx -0.2",
        "fixes": "group bodies id 1:3\nfix move bodies nve",
    },
}
#: steps per sample, and of how many seconds
EVERY, STEP = 20, 1e-7


@pytest.mark.parametrize("case", list(CASES))
def test_each_law_that_is_read_is_that_of_lammps(case: str, tmp_path: Path) -> None:
    """The twin takes the same steps, with velocities of the half step in damped contacts, so that all that is left is
    round-off: positions of 4 cm are known to 7e-18 m, of overlaps of 1e-5 m; 1e-10 was found, ten times it allowed."""
    usual = {"boundary": "boundary f p p\ncomm_modify vel yes", "step": f"timestep {STEP!r}", "run": "run 2000"}
    usual["dump"] = f"dump d all custom {EVERY} dump.txt id x vx\ndump_modify d sort id format float %.17g"
    changes = CASES[case]
    text = script(**{**usual, **changes, "more": "neighbor 0.002 bin\n" + changes.get("more", "")})
    found = _velocities(_run(tmp_path / "run", {"in.test": text}, "in.test", {}), "vx", [1, 2, 3])
    scene = db.scene_from_deck(tmp_path / "run" / "in.test")
    twin = db.solve(scene, backend="verlet", dt=STEP, uncertainty=False)
    scale = np.max(np.abs(twin.velocity))
    assert np.max(np.abs(found - twin.velocity)) < 1e-9 * scale
    # a stiffness or a damping that is off by a millionth is seen
    off = replace(scene, stiffness=(scene.stiffness[0] * (1.0 + 1e-6), *scene.stiffness[1:]))
    assert np.max(np.abs(found - db.solve(off, backend="verlet", dt=STEP, uncertainty=False).velocity)) > 1e-8 * scale
    if scene.damping is not None:
        assert isinstance(scene.damping.coefficient, tuple)
        weaker = tuple(one * (1.0 - 1e-5) for one in scene.damping.coefficient)
        off = replace(scene, damping=replace(scene.damping, coefficient=weaker))
        assert (
            np.max(np.abs(found - db.solve(off, backend="verlet", dt=STEP, uncertainty=False).velocity)) > 1e-8 * scale
        )


#: the first body flies to a wall and comes back; at overlap 0 a wall of LAMMPS has a damping force and a pair has none,
#: so that the touch must not fall on a step
BACK = {"start": "group striker id 1\nvelocity striker set -0.5 0 0"}
WALLS = {
    "granular": "fix w all wall/gran granular hertz 2e11 0 {tail} velocity xplane {at} NULL",
    "granular, both sides": "fix w all wall/gran granular hooke 2e7 0 {tail} velocity xplane {at} 0.9 contacts",
    "material": "fix w all wall/gran granular hertz/material 2e11 0 0.3 {tail} velocity xplane {at} NULL",
    "mass_velocity": "fix w all wall/gran granular hooke 2e7 2e3 {tail} mass_velocity limit_damping xplane {at} 9",
    "hooke": "fix w all wall/gran hooke 2e7 NULL 4e3 NULL 0.5 1 limit_damping xplane {at} NULL",
    "hooke/history": "fix w all wall/gran hooke/history 2e7 NULL 4e3 NULL 0.5 1 limit_damping xplane {at} NULL",
    "hertz/history": "fix w all wall/gran hertz/history 2e11 NULL 4e6 NULL 0.5 1 limit_damping xplane {at} NULL",
    "not clipped": "fix w all wall/gran hooke 2e7 NULL 4e3 NULL 0.5 1 xplane {at} NULL",
    "restitution": "fix w all wall/gran granular hertz 2e11 0.6 {tail} coeff_restitution xplane {at} NULL",
    "restitution of a material": "fix w all wall/gran granular hertz/material 2e11 0.6 0.3 {tail} coeff_restitution"
    " limit_damping xplane {at} NULL",
    "tsuji": "fix w all wall/gran granular hooke 2e7 0.6 {tail} tsuji xplane {at} NULL\n"
    "group wall type 2\nfix hold wall freeze",
    "dmt": "fix w all wall/gran granular dmt 2e11 0 0.3 50 {tail} velocity xplane {at} NULL",
    "region plane": "region p plane {at} 0 0 2 0 0\n"
    "fix w all wall/gran/region granular hertz 2e11 0 {tail} velocity region p",
    "region plane, from outside": "region p plane {at} 0 0 -2 0 0 side out\n"
    "fix w all wall/gran/region granular hertz 2e11 0 {tail} velocity region p",
    "region block": "region p block {at} 0.09 -0.08 0.08 -0.08 0.08 open 3\n"
    "fix w all wall/gran/region hertz/history 2e11 NULL 4e6 NULL 0.5 1 limit_damping region p",
}
LIMITED = "pair_coeff * * hertz 1e11 0 tangential linear_nohistory 0 0 damping mass_velocity limit_damping"
DMT = f"pair_coeff 1 1 dmt 2e11 2 0.3 20 {GRANULAR} velocity\npair_coeff 2 2 dmt 1e11 8 0.2 5 {GRANULAR} velocity"
#: bodies that touch at the start without an approach have no defined adhesion
APART = "\n".join(
    f"create_atoms {kind} single {x} 0 0" for kind, x in ((1, -0.02), (1, 3e-7), (1, 0.0200007), (2, 0.040001))
)
WORDS: dict[str, dict[str, str]] = {
    **{
        name: BACK | {"more": wall.format(tail=GRANULAR, at=-0.03000103), "coefficients": LIMITED}
        | ({"coefficients": LIMITED.replace("mass_velocity", "viscoelastic")} if "4e6" in wall else {})
        | ({"coefficients": f"pair_coeff * * hertz 1e11 0.7 {GRANULAR} tsuji"} if "tsuji" in wall else {})
        | ({"coefficients": DMT, "atoms": APART} if "dmt" in wall else {})
        for name, wall in WALLS.items()
    },
    "viscous": {"more": "fix v all viscous 3"},
    "spherical": {"more": "fix g all gravity 500 spherical 0 90\nfix f bodies setforce NULL 0 0"},
    "loop": {
        "atoms": "variable i loop 3\nvariable kind index 1 1 1\nlabel more\n"
        'create_atoms ${kind} single $(0.02*(v_i-2)) 0 0\nif "${i} == 2" then "group second id 2"\n'
        "next i\nnext kind\njump SELF more\ncreate_atoms 2 single 0.04 0 0"
    },
    "lattice": {
        "box": "lattice sc 0.02\n" + PARTS["box"].replace("0.1", "5"),
        "atoms": PARTS["atoms"].replace("0.02", "1").replace("0.04", "2"),
        "start": "group striker id 1\nvelocity striker set 25 0 0",
        "sizes": "set group all diameter 0.02 mass 1\nregion r block -9 1.5 INF INF INF INF\nset region r mass 0.01",
    },
    "disc, dimension 2": {
        "style": "dimension 2\natom_style sphere",
        "box": PARTS["box"].replace(" -0.1 0.1\n", " -0.001 0.001\n"),
        "sizes": "set type 1*2 diameter 0.02 density/disc 30",
        "fixes": "group bodies type 1\nfix move bodies nve/sphere disc\nfix flat all enforce2d",
    },
    "lj": {"units": "", "step": f"timestep {1e-7!r}", "coefficients": LIMITED},
    "runs": {
        "run": "fix p all print 1000 a\nrun 300\nunfix p\nunfix move\nfix move bodies nve\nrun 1000 upto\nrun 700",
        "after": "velocity all set 0 0 0\nset group all mass 9",
    },
}  # fmt: skip


#: the other words are run in the deep suite; what they become is checked without LAMMPS in test_to_scene
_QUICK = ("hertz/history", "restitution", "region plane", "dmt", "loop")


@pytest.mark.parametrize(
    "case", [pytest.param(case, marks=() if case in _QUICK else pytest.mark.slow) for case in WORDS]
)
def test_the_deck_of_the_scene_repeats_the_script(case: str, tmp_path: Path) -> None:
    """Positions in the script are of 4 cm, so that overlaps of 1e-5 m have a round-off of 1e-12; 2e-10 was found."""
    usual = {"boundary": "boundary f p p\ncomm_modify vel yes", "step": f"timestep {STEP!r}", "run": "run 2000"}
    usual["dump"] = f"dump d all custom {EVERY} dump.txt id x vx\ndump_modify d sort id format float %.17g"
    changes = WORDS[case]
    text = script(**{**usual, **changes, "more": "neighbor 0.002 bin\n" + changes.get("more", "")})
    velocities = _velocities(_run(tmp_path / "run", {"in.test": text}, "in.test", {}), "vx", [1, 2, 3])
    assert np.all(np.isfinite(velocities))
    scene = db.scene_from_deck(tmp_path / "run" / "in.test", reverse=False)
    own = db.solve(scene, backend="lammps-granular", dt=STEP, uncertainty=False)
    scale = np.max(np.abs(velocities))
    assert np.max(np.abs(velocities - own.velocity)) < 1e-9 * scale
    for wrong in _wrong(scene):
        other = db.solve(wrong, backend="verlet", dt=STEP, uncertainty=False)
        assert np.max(np.abs(velocities - other.velocity)) > 1e-8 * scale, wrong.name


def _wrong(scene: Scene) -> list[Scene]:
    """Scenes with a wall, a damping or a drag that is off by a hundred-thousandth."""
    off = 1.0 + 1e-5
    scenes = []
    if scene.wall_left is not None:
        wall = replace(scene.wall_left, stiffness=scene.wall_left.stiffness * off)
        scenes += [
            replace(scene, name="wall", wall_left=wall),
            replace(scene, name="far", wall_left=replace(wall, gap=1.0)),
        ]
    if scene.damping is not None and scene.damped:
        assert isinstance(scene.damping.coefficient, tuple)
        weaker = tuple(value / off for value in scene.damping.coefficient)
        scenes.append(replace(scene, name="damping", damping=replace(scene.damping, coefficient=weaker)))
    if scene.adhesion is not None:
        assert isinstance(scene.adhesion.pull_off, tuple)
        weaker = tuple(value / off for value in scene.adhesion.pull_off)
        scenes.append(replace(scene, name="adhesion", adhesion=replace(scene.adhesion, pull_off=weaker)))
    if scene.drag:
        scenes.append(replace(scene, name="drag", drag=scene.drag * 1.01))
    return [*scenes, replace(scene, name="mass", mass=(scene.mass[0] * off, *scene.mass[1:]))]


@pytest.mark.parametrize("units", list(UNITS))
def test_a_script_without_a_time_step_has_that_of_its_units(units: str, tmp_path: Path) -> None:
    slow = PARTS["start"].replace("0.5", "1e-9")  # a step of 2 microseconds would carry it out of its box
    text = script(
        units=f"units {units}", boundary="boundary f p p\ncomm_modify vel yes", start=slow, step="", run="run 1"
    )
    text = text.replace(PARTS["dump"], "neighbor 0.002 bin\ndump d all custom 1 dump.txt id vx\ndump_modify d time yes")
    dump = _run(tmp_path / "run", {"in.test": text}, "in.test", {})
    time = float(dump.split("ITEM: TIME\n")[2].split()[0])
    scene = db.scene_from_deck(tmp_path / "run" / "in.test")
    assert scene.duration == pytest.approx(time * UNITS[units][1], rel=1e-12)
