"""A small scene for every feature, on which the feature changes the motion clearly.

A scene starts from one of three plain scenes (a chain of three bodies, a pair, a single body), because a backend may
support only some of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.scene import features
from dem_bridge.scene.drive import Drive
from dem_bridge.scene.features import Feature
from dem_bridge.scene.piston import Piston
from dem_bridge.scene.scene import Adhesion, Damping, Scene, Wall
from dem_bridge.scene.support import Support

MASS = (8e-3, 1e-2, 2e-2)
STIFFNESS = (4e9, 5e9)
DURATION = 1.5e-4
#: contacts of any exponent have the force of Hertz's law at this overlap, m
MATCHING_OVERLAP = 5e-6
#: exponents of examples, the first that a backend allows is taken
OTHER = (2.0, 3.0, 2.4)


def plain_scene(bodies: int, exponent: float = 2.5) -> Scene:
    """Return one to three touching bodies without any feature but the exponent; body 0 moves towards the others.

    >>> plain_scene(2).features
    frozenset()
    """
    factor = MATCHING_OVERLAP ** (2.5 - exponent)
    return Scene(
        name=f"plain-{bodies}",
        duration=DURATION,
        mass=MASS[:bodies],
        stiffness=tuple(factor * stiffness for stiffness in STIFFNESS[: bodies - 1]),
        velocity=(0.8, 0.0, 0.0)[:bodies],
        exponent=exponent,
        samples=30,
    )


def hertz_and_linear(overlap: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the force (N) of a contact law that is no power of the overlap (m)."""
    return np.asarray(4e9 * overlap**1.5 + 2e7 * overlap)


def _walls(scene: Scene) -> dict[str, Any]:
    stiffness = 3e9 * MATCHING_OVERLAP ** (2.5 - _first_exponent(scene))
    return {"wall_left": Wall(stiffness=stiffness), "wall_right": Wall(stiffness=0.5 * stiffness)}


def _first_exponent(scene: Scene) -> float:
    return float(scene.contacts.exponent[0]) if scene.n_contact else 2.5


def _gaps(scene: Scene, first: float) -> dict[str, Any]:
    return {"gap": tuple(first * factor for factor in (1.0, 0.5)[: len(scene.stiffness)])}


def _damping(law: str, coefficient: float, *, clip: bool = True) -> dict[str, Any]:
    return {"damping": Damping(law=law, coefficient=coefficient, clip=clip)}


def _first_pull_off(scene: Scene) -> tuple[float, ...]:
    """Return the pull-off forces of the first contact, whose bodies approach each other, and the others; n = 5/2."""
    return (100.0 if _first_exponent(scene) == 2.5 else 0.0, *[0.0] * scene.n_contact)[: scene.n_contact]


def _moved(scene: Scene, **piston: Any) -> dict[str, Any]:
    """Return the changes that put a piston in the place of body 0; it moves nothing in a scene of one body."""
    if scene.n_body == 1:
        return {}
    return {"drive": Piston(**piston), "velocity": (0.0,) * scene.n_body}


_SINE = Drive(shape="sine", force=200.0, frequency=1e4, phase=30.0, rise=2e-5)
_CHIRP = replace(_SINE, shape="chirp", last_frequency=2e4, sweep=1e-4)
_TABLE = Drive(shape="table", force=(0.0, 200.0, -100.0, 50.0), interval=0.5e-4)

#: feature -> the changes that give it to a plain scene; the exponents are chosen in :func:`example`
EXAMPLES: Mapping[Feature, Callable[[Scene], Mapping[str, Any]]] = MappingProxyType(
    {
        features.WALLS: _walls,
        features.GAPS: lambda scene: _gaps(scene, 1e-5),
        features.INITIAL_OVERLAPS: lambda scene: _gaps(scene, -1e-5),
        features.SEVERAL_MOVING: lambda scene: {"velocity": (0.8, -0.3, 0.1)[: scene.n_body]},
        features.OTHER_EXPONENTS: lambda scene: {},
        features.GRADED_EXPONENTS: lambda scene: {
            "exponent": (2.5, *scene.contacts.exponent.tolist()[1:])[: scene.n_contact]
        },
        features.CONTACT_FUNCTIONS: lambda scene: {"law": hertz_and_linear},
        features.GRAVITY: lambda scene: {"gravity": 2e3},
        features.PRECOMPRESSION: lambda scene: {"precompression": 50.0},
        features.DASHPOT: lambda scene: _damping("dashpot", 100.0),
        features.MASS_VELOCITY: lambda scene: _damping("mass_velocity", 2e4),
        features.KUWABARA_KONO: lambda scene: _damping("kuwabara-kono", 1e-5),
        features.COEFF_RESTITUTION: lambda scene: _damping("coeff_restitution", 0.3),
        features.TSUJI: lambda scene: _damping("tsuji", 0.3),
        features.NOT_CLIPPED: lambda scene: _damping("dashpot", 100.0, clip=False),
        features.DMT: lambda scene: {"adhesion": Adhesion(law="dmt", pull_off=_first_pull_off(scene))},
        features.JKR: lambda scene: {"adhesion": Adhesion(law="jkr", pull_off=_first_pull_off(scene))},
        features.DRAG: lambda scene: {"drag": 3e3},
        features.SINE_DRIVE: lambda scene: {"drive": _SINE},
        features.CHIRP_DRIVE: lambda scene: {"drive": _CHIRP},
        features.TABLE_DRIVE: lambda scene: {"drive": _TABLE},
        features.CONSTANT_PISTON: lambda scene: _moved(scene, shape="constant", velocity=0.5),
        features.SINE_PISTON: lambda scene: _moved(scene, shape="sine", velocity=0.8, frequency=1e4, phase=30.0),
        features.TABLE_PISTON: lambda scene: _moved(
            scene, shape="table", velocity=(0.5, 1.0, -0.5, 0.2), interval=0.5e-4
        ),
    }
)
#: features that an example has in addition to its own
_NEEDS: Mapping[Feature, tuple[Feature, ...]] = MappingProxyType(
    {features.GRADED_EXPONENTS: (features.OTHER_EXPONENTS,), features.NOT_CLIPPED: (features.DASHPOT,)}
)


def example(feature: Feature, support: Support) -> Scene | None:
    """Return a small scene that has a feature and otherwise nothing that a backend does not support.

    Parameters
    ----------
    feature : Feature
        The feature that the scene has, whether or not it is supported.
    support : Support
        What else the scene may have.

    Returns
    -------
    Scene or None
        None if the conditions or exponents of the support exclude every example of the feature.

    Examples
    --------
    >>> example(features.DRAG, Support({features.GAPS})).features
    frozenset({<Feature: drag>})
    """
    wider = Support(
        {*support.features, feature, *_NEEDS.get(feature, ())},
        exponents=support.exponents,
        conditions=support.conditions,
    )
    other = next((n for n in OTHER if n in wider.exponents), None)
    hertz = 2.5 if 2.5 in support.exponents else other
    exponent = other if feature in (features.OTHER_EXPONENTS, features.GRADED_EXPONENTS) else hertz
    for bodies in (3, 2, 1):
        if exponent is not None:
            plain = plain_scene(bodies, exponent)
            scene = replace(plain, **EXAMPLES[feature](plain), name=f"example-{bodies}")
            if feature in scene.features and wider.covers(scene):
                return scene
    return None
