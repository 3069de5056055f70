"""Provide driven chains: each shape of drive, on bodies that touch and on bodies that are pressed."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from dem_bridge.scene.drive import Drive
from dem_bridge.scene.piston import Piston
from dem_bridge.scene.scene import Scene, Wall

SINE = Drive(shape="sine", force=2.0, frequency=4000.0, phase=30.0, rise=2e-4)
#: its sweep ends within the scenes
CHIRP = Drive(shape="chirp", force=2.0, frequency=1000.0, last_frequency=8000.0, sweep=3e-4)
TABLE = Drive(shape="table", force=(0.0, 1.5, -0.5, 2.0, 2.0, 0.0), interval=8e-5)
DRIVES = {drive.shape: drive for drive in (SINE, CHIRP, TABLE)}

#: no body moves but for the drive, no contact is pressed, and nothing stands at the ends
TOUCHING = Scene(
    name="touching",
    duration=4e-4,
    mass=(8e-3, 1e-2, 5e-3, 2e-2),
    stiffness=(4e9, 5e9, 3e9),
    velocity=(0.0,) * 4,
    drive=SINE,
    samples=100,
)
#: pressed so much that no contact opens: all is smooth
PRESSED = replace(TOUCHING, name="pressed", precompression=200.0)


def driven(scene: Scene, shape: str, **changes: Any) -> Scene:
    """Return the scene with the drive of that shape."""
    return replace(scene, name=f"{scene.name}-{shape}", drive=replace(DRIVES[shape], **changes))


def free_body(drive: Drive, *, mass: float = 2e-3, duration: float = 4e-4, samples: int = 50) -> Scene:
    """Return one driven body that touches nothing."""
    return Scene(
        name="alone", duration=duration, mass=(mass,), stiffness=(), velocity=(0.0,), drive=drive, samples=samples
    )


def oscillator(frequency: float, *, amplitude: float = 1.0, cycles: float = 6.0) -> tuple[Scene, float]:
    """Return a body pressed by 10 N to a wall behind a linear spring, driven from rest, and its resonance, rad/s."""
    mass, spring = 5e-3, 2e6
    resonance = math.sqrt(spring / mass)
    scene = Scene(
        name="oscillator",
        duration=cycles * 2.0 * math.pi / resonance,
        mass=(mass,),
        stiffness=(),
        velocity=(0.0,),
        wall_right=Wall(stiffness=spring, exponent=2.0),
        precompression=10.0,
        drive=Drive(shape="sine", force=amplitude, frequency=frequency * resonance / (2.0 * math.pi)),
        samples=200,
    )
    return scene, resonance


#: velocities of a piston, in m/s; "wiggle" is the sine that LAMMPS has a style for
PISTONS = {
    "constant": Piston(shape="constant", velocity=0.3),
    "sine": Piston(shape="sine", velocity=0.3, frequency=6e3, phase=30.0),
    "wiggle": Piston(shape="sine", velocity=0.3, frequency=6e3, phase=-90.0),
    "table": Piston(shape="table", velocity=(0.1, 0.4, -0.2, 0.3, 0.3), interval=5e-5),
}


def pushed(kind: str, **changes: Any) -> Scene:
    """Return a piston and five bodies that touch; no other body moves at the start."""
    scene = Scene(
        name=f"pushed-{kind}",
        duration=1.8e-4,
        mass=(5e-3, 1e-2, 8e-3, 2e-2, 1e-2, 6e-3),
        stiffness=(4e9, 5e9, 3e9, 6e9, 4e9),
        velocity=(0.0,) * 6,
        drive=PISTONS[kind],
        samples=90,
    )
    return replace(scene, **{"velocity": scene.velocity[:1] + (0.0,) * 5, **changes})
