"""Scenes as unit tests of LAMMPS: each passes with LAMMPS, and fails with a fault in the place of LAMMPS."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest

from dem_bridge.errors import UnsupportedScene
from dem_bridge.judging.unit_test.driver import run_unit_test
from dem_bridge.judging.unit_test.written import unit_test_of
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.unit_test import read_unit_test
from dem_bridge.observables.verdict import Outcome
from dem_bridge.scene.drive import Drive
from dem_bridge.scene.scene import Adhesion, Damping, Scene, Wall

PAIR = Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
EQUAL = replace(PAIR, mass=(8e-3, 8e-3), velocity=(0.4, -0.4), duration=1.5e-4)
BALL = Scene(
    name="ball", duration=1.5e-4, mass=(8e-3,), stiffness=(), velocity=(0.5,), wall_right=Wall(stiffness=4e9, gap=1e-6)
)
CHAIN = Scene(name="chain", duration=3e-4, mass=(8e-3,) * 5, stiffness=(4e9,) * 4, velocity=(0.8, 0.0, 0.0, 0.0, 0.0))
COEFFICIENT = Damping(law="coeff_restitution", coefficient=0.6, clip=False)
SCENES = {
    "pair": PAIR,
    "equal": EQUAL,
    "pair-hooke": replace(PAIR, exponent=2.0, stiffness=(4e7,), duration=2e-4),
    "pair-gap": replace(PAIR, gap=(2.3e-6,)),
    "equal-coefficient": replace(EQUAL, damping=COEFFICIENT),
    "equal-coefficient-clipped": replace(EQUAL, damping=replace(COEFFICIENT, clip=True)),
    "equal-hooke-dashpot": replace(
        EQUAL, exponent=2.0, stiffness=(4e7,), damping=Damping(law="dashpot", coefficient=60.0, clip=False)
    ),
    "pair-dashpot": replace(PAIR, damping=Damping(law="dashpot", coefficient=40.0)),
    "pair-mass-velocity": replace(PAIR, damping=Damping(law="mass_velocity", coefficient=9e3)),
    "pair-kuwabara-kono": replace(PAIR, damping=Damping(law="kuwabara-kono", coefficient=2e-6)),
    "pair-dmt": replace(PAIR, adhesion=Adhesion(law="dmt", pull_off=(0.5,))),
    "ball": BALL,
    "ball-coefficient": replace(BALL, damping=COEFFICIENT),
    "ball-left": Scene(
        name="left",
        duration=1e-4,
        mass=(8e-3,),
        stiffness=(),
        velocity=(-0.5,),
        wall_left=Wall(stiffness=4e9, gap=1e-6),
    ),
    "chain": CHAIN,
    "chain-gaps": replace(CHAIN, gap=(1.1e-6, 2.3e-6, 0.7e-6, 1.9e-6)),
    "chain-gravity": replace(CHAIN, gravity=9.81),
    "chain-drag": replace(CHAIN, drag=500.0),
    "chain-between-walls": replace(
        CHAIN, wall_left=Wall(stiffness=4e9, gap=1e-6), wall_right=Wall(stiffness=6e9, gap=2e-6)
    ),
    "chain-exponents": replace(CHAIN, exponent=(2.5, 2.0, 2.5, 2.0), stiffness=(4e9, 4e7, 4e9, 4e7)),
    "pair-driven": replace(PAIR, velocity=(0.0, 0.0), drive=Drive(shape="sine", force=40.0, frequency=5e3)),
    "chain-pressed": replace(CHAIN, precompression=20.0, wall_left=Wall(stiffness=4e9), wall_right=Wall(stiffness=4e9)),
}
#: formulas of the scenes that have one
FORMULAS = {
    "pair": "hertz_peak",
    "pair-gap": "hertz_peak",
    "equal": "collision_restitution",
    "equal-coefficient": "collision_restitution",
    "equal-coefficient-clipped": "collision_restitution",
    "equal-hooke-dashpot": "collision_restitution",
    "ball": "wall_restitution",
    "ball-coefficient": "wall_restitution",
}
#: a LAMMPS whose contacts are stiffer by a thousandth: it changes the input before it reads it
STIFFER = """#!{python}
import os, re, sys
words = sys.argv[1:]
if "-in" in words:
    name = words[words.index("-in") + 1]
    text = open(name).read()
    stiffer = lambda match: f"{{match[1]}}{{float(match[2]) * 1.001!r}}"
    open(name, "w").write(re.sub(r"(pair_coeff \\d\\S* \\S+ (?:hertz|hooke|dmt) )(\\S+)", stiffer, text))
os.execv({lmp!r}, [{lmp!r}, *words])
"""


@pytest.fixture
def stiffer(tmp_path: Path) -> Engine:
    """A LAMMPS with a wrong stiffness."""
    lmp = tmp_path / "lmp"
    lmp.write_text(STIFFER.format(python=sys.executable, lmp=str(Path(sys.executable).with_name("lmp"))))
    lmp.chmod(0o755)
    return Engine(lmp=lmp)


#: scenes that are tried by every run of the suite; the others are deep tests
_ALWAYS = ("pair", "equal-coefficient", "ball", "chain-between-walls")


@pytest.mark.lammps
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in _ALWAYS else pytest.mark.slow) for name in SCENES]
)
def test_a_written_test_passes_with_lammps_and_fails_with_a_wrong_one(name: str, stiffer: Engine) -> None:
    test = unit_test_of(replace(SCENES[name], name=name))
    assert read_unit_test(test.text, f"{name}.yaml") == test
    assert (test.analytic.model if test.analytic else None) == FORMULAS.get(name)
    right, wrong = run_unit_test(test), run_unit_test(test, engine=stiffer)
    assert right.outcome is Outcome.PASS, right.sentence
    assert wrong.outcome is Outcome.FAIL
    assert right.largest <= test.epsilon
    assert test.tags == ("granular",)


@pytest.mark.lammps
def test_epsilon_is_the_error_of_the_step() -> None:
    coarse, fine = (unit_test_of(PAIR, dt=dt) for dt in (2e-7, 1e-7))
    assert 3.0 < coarse.epsilon / fine.epsilon < 5.0  # of second order, with epsilon rounded to two digits
    assert run_unit_test(coarse).largest > 0.5 * coarse.epsilon


def test_a_scene_that_no_test_can_contain_is_refused() -> None:
    drive = Drive(shape="table", force=(0.0, 40.0, 0.0), interval=5e-5)
    with pytest.raises(UnsupportedScene, match="a drive by a table needs a file of its own"):
        unit_test_of(replace(PAIR, velocity=(0.0, 0.0), drive=drive))
    masses = tuple(8e-3 + 1e-6 * k for k in range(302))
    long = Scene(name="long", duration=1e-4, mass=masses, stiffness=(4e9,) * 301, velocity=(0.8, *(0.0,) * 301))
    with pytest.raises(UnsupportedScene, match="more than 300 different masses"):
        unit_test_of(long)
