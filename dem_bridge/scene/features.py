"""Features of scenes: one declaration for each thing beyond masses, power-law contacts and a struck first body.

``Scene.features`` is computed from these declarations, and a backend lists the features that it supports
(:mod:`dem_bridge.scene.support`). A backend refuses every feature that it does not list, so a feature that is added
here is refused by all backends until each of them lists it. For that reason there is no set of "all features" to refer
to.

>>> import dem_bridge as db
>>> scene = db.Scene(name="pair", duration=1e-4, mass=(1e-2, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), gravity=9.81)
>>> [feature.label for feature in scene.features]
['gravity']
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any


@dataclass(frozen=True, eq=False)
class Feature:
    """One thing that a scene may have.

    Parameters
    ----------
    label : str
        Noun for lists and messages; "the scene has ``label``" is a sentence.
    sentence : str
        Definition for readers, with the formula where there is one.
    present : callable
        Return whether a scene has the feature. The argument is a :class:`~dem_bridge.scene.scene.Scene`; its type is
        not named here because scenes import their features.
    dissipates : bool
        Whether energy is lost.
    does_work : bool
        Whether a force that has no potential changes the energy.
    changes_momentum : bool
        Whether the total momentum of the bodies changes.
    """

    label: str
    sentence: str
    present: Callable[[Any], bool]
    dissipates: bool = False
    does_work: bool = False
    changes_momentum: bool = False

    def __repr__(self) -> str:
        return f"<Feature: {self.label}>"


WALLS = Feature(
    "walls",
    "An end body may touch a rigid wall, which is a body at rest of infinite mass.",
    lambda scene: scene.wall_left is not None or scene.wall_right is not None,
    changes_momentum=True,
)
GAPS = Feature(
    "gaps",
    "Neighbouring bodies, or an end body and its wall, are apart at the start.",
    lambda scene: bool((scene.contacts.gap > 0.0).any()),
)
INITIAL_OVERLAPS = Feature(
    "initial overlaps",
    "Contacts are compressed at the start, and no precompression holds them in equilibrium.",
    lambda scene: scene.precompression == 0.0 and bool((scene.contacts.gap < 0.0).any()),
)
SEVERAL_MOVING = Feature(
    "bodies behind the first that move at the start",
    "Start velocities other than that of body 0 are not zero.",
    lambda scene: any(scene.velocity[1:]),
)
OTHER_EXPONENTS = Feature(
    "exponents other than 5/2",
    "The contact force is stiffness * overlap^(n-1) with n other than Hertz's 5/2.",
    lambda scene: scene.law is None and bool((scene.contacts.exponent != 2.5).any()),
)
GRADED_EXPONENTS = Feature(
    "exponents that differ between contacts",
    "Not all contacts, those of the walls included, have the same exponent n.",
    lambda scene: scene.law is None and len({*scene.contacts.exponent.tolist()}) > 1,
)
CONTACT_FUNCTIONS = Feature(
    "contact laws given as functions",
    "The contact force is any function of the overlap that does not fall.",
    lambda scene: scene.law is not None,
)
GRAVITY = Feature(
    "gravity",
    "A constant acceleration along the chain acts on each body.",
    lambda scene: scene.gravity != 0.0,
    changes_momentum=True,
)
PRECOMPRESSION = Feature(
    "precompression",
    "The chain starts in equilibrium, compressed by a static force that walls or constant loads on the ends hold.",
    lambda scene: scene.precompression > 0.0,
)


def _damped(law: str, label: str, force: str) -> Feature:
    """Return the feature of a damping law."""

    def present(scene: Any) -> bool:
        return bool(scene.damped and scene.damping.law == law)

    return Feature(label, f"The force {force} acts in contacts.", present, dissipates=True)


_EFFECTIVE = "sqrt(effective mass * stiffness) * overlap^((n-2)/2) * d(overlap)/dt"
DASHPOT = _damped("dashpot", "dashpot damping", "c * d(overlap)/dt")
MASS_VELOCITY = _damped("mass_velocity", "mass-proportional dashpot damping", "eta * effective mass * d(overlap)/dt")
KUWABARA_KONO = _damped("kuwabara-kono", "Kuwabara-Kono damping", "gamma * stiffness * overlap^(n-2) * d(overlap)/dt")
COEFF_RESTITUTION = _damped(
    "coeff_restitution",
    "damping by a coefficient of restitution",
    f"alpha * {_EFFECTIVE} with alpha from the coefficient of restitution",
)
TSUJI = _damped(
    "tsuji", "Tsuji damping", f"alpha * {_EFFECTIVE} with alpha by Marshall's polynomial of the restitution"
)
NOT_CLIPPED = Feature(
    "damping forces that are not clipped",
    "The sum of elastic and damping force may be tensile until the overlap is zero; otherwise it is clipped at zero.",
    lambda scene: scene.damped and not scene.damping.clip,
)
DMT = Feature(
    "DMT adhesion",
    "Closed contacts attract with a constant force in addition to their elastic force.",
    lambda scene: scene.adhesive and scene.adhesion.law == "dmt",
)
JKR = Feature(
    "JKR adhesion",
    "Contacts attract by the law of Johnson, Kendall & Roberts and hold on to each other when they separate.",
    lambda scene: scene.adhesive and scene.adhesion.law == "jkr",
    dissipates=True,
)
DRAG = Feature(
    "drag",
    "The force -drag * mass * velocity acts on each body.",
    lambda scene: scene.drag > 0.0,
    dissipates=True,
    changes_momentum=True,
)


def _driven(shape: str, label: str, sentence: str, kind: str = "driving_force") -> Feature:
    """Return the feature of a drive of this shape; ``kind``: the attribute of a scene that has it."""

    def present(scene: Any) -> bool:
        drive = getattr(scene, kind)
        return drive is not None and bool(drive.shape == shape)

    return Feature(label, sentence, present, does_work=True, changes_momentum=True)


SINE_DRIVE = _driven("sine", "a sine drive", "A sinusoidal force acts on body 0.")
CHIRP_DRIVE = _driven("chirp", "a chirp drive", "A sinusoidal force whose frequency is swept acts on body 0.")
TABLE_DRIVE = _driven(
    "table", "a tabulated drive", "A force that is interpolated linearly between given values acts on body 0."
)
CONSTANT_PISTON = _driven(
    "constant", "a piston of constant velocity", "Body 0 has a constant velocity, whatever acts on it.", "piston"
)
SINE_PISTON = _driven(
    "sine", "a piston of sinusoidal velocity", "Body 0 has a sinusoidal velocity, whatever acts on it.", "piston"
)
TABLE_PISTON = _driven(
    "table",
    "a piston of tabulated velocity",
    "Body 0 has a velocity that is interpolated linearly between given values, whatever acts on it.",
    "piston",
)

#: a field that every backend must obey, or that does not act on the bodies
BASE: tuple[Feature, ...] = ()

#: the features that fields of Scene, Wall, Damping, Drive and Piston can give to a scene; every field is in one row
_GIVEN_BY = (
    (BASE, "Scene.name Scene.duration Scene.mass Scene.stiffness Scene.samples Scene.spacing Scene.description"),
    (BASE, "Scene.geometry Scene.content_hash Scene._static_overlap Scene._reach"),
    ((WALLS,), "Scene.wall_left Scene.wall_right Wall.stiffness"),
    ((GAPS, INITIAL_OVERLAPS), "Scene.gap Wall.gap"),
    ((SEVERAL_MOVING,), "Scene.velocity"),
    ((OTHER_EXPONENTS, GRADED_EXPONENTS), "Scene.exponent Wall.exponent"),
    ((CONTACT_FUNCTIONS,), "Scene.law"),
    ((GRAVITY,), "Scene.gravity"),
    ((PRECOMPRESSION,), "Scene.precompression"),
    ((DASHPOT, MASS_VELOCITY, KUWABARA_KONO, COEFF_RESTITUTION, TSUJI), "Damping.law Damping.coefficient"),
    ((DASHPOT, MASS_VELOCITY, KUWABARA_KONO, COEFF_RESTITUTION, TSUJI, NOT_CLIPPED), "Scene.damping"),
    ((NOT_CLIPPED,), "Damping.clip Damping._clip_by_default"),
    ((DMT, JKR), "Scene.adhesion Adhesion.law Adhesion.pull_off"),
    ((DRAG,), "Scene.drag"),
    ((SINE_DRIVE, CHIRP_DRIVE, TABLE_DRIVE, CONSTANT_PISTON, SINE_PISTON, TABLE_PISTON), "Scene.drive"),
    ((SINE_DRIVE, CHIRP_DRIVE, TABLE_DRIVE), "Drive.shape Drive.force"),
    ((SINE_DRIVE, CHIRP_DRIVE), "Drive.frequency Drive.phase Drive.rise"),
    ((CHIRP_DRIVE,), "Drive.last_frequency Drive.sweep"),
    ((TABLE_DRIVE,), "Drive.interval"),
    ((CONSTANT_PISTON, SINE_PISTON, TABLE_PISTON), "Piston.shape Piston.velocity"),
    ((SINE_PISTON,), "Piston.frequency Piston.phase"),
    ((TABLE_PISTON,), "Piston.interval"),
)
#: field -> the features that it can give to a scene
FIELDS: Mapping[str, tuple[Feature, ...]] = MappingProxyType(
    {field: features for features, fields in _GIVEN_BY for field in fields.split()}
)
#: all features that the fields can give, each once, in the order of lists and messages
FEATURES: tuple[Feature, ...] = tuple(dict.fromkeys(sum(FIELDS.values(), BASE)))
