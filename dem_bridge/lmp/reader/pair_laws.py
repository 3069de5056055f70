"""The normal force between the atoms of two types on a straight line, in the units of a script; laws of LIGGGHTS.

Scripts of LIGGGHTS have ``pair_style gran model hertz`` with materials of ``fix property/global``. The normal force is
4/3 E* sqrt(R_eff) overlap^1.5, with a damping force that gives the coefficient of restitution e at every speed: the law
of LAMMPS' ``hertz/material`` with ``damping coeff_restitution`` (LIGGGHTS manual, *gran model hertz*; Antypov & Elliott
2011, *EPL* 94, 50004). E and nu are given by type, e by pair of types. In contrast to LAMMPS a wall has a type, whose
material is mixed with that of the body. Tangential and rolling models have no effect if nothing rotates or moves across
the line.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from dem_bridge.lmp.reader.script import Command, Script


@dataclass(frozen=True)
class PairLaw:
    """The law of two types, in the units of the script."""

    command: Command = field(compare=False)
    model: str
    """"hertz" or "hooke"."""
    stiffness: float
    """Coefficient K or k."""
    eta: float
    """Damping coefficient, or the coefficient of restitution."""
    damping: str
    clip: bool
    """True with ``limit_damping``: the net force is clipped at zero."""
    material: tuple[float, float] | None = None
    """E and nu of ``hertz/material`` and ``dmt``."""
    surface_energy: float = 0.0
    """Surface energy of ``dmt``."""
    mixed_as: str = field(default="", compare=False)
    """The ``pair_coeff`` command of a law that is mixed from those of its two types; '' of one that is written."""

    @property
    def exponent(self) -> float:
        """Exponent n of the energy."""
        return {"hertz": 2.5, "hooke": 2.0}[self.model]

    @property
    def damped(self) -> bool:
        """Return whether contacts with the law dissipate energy."""
        return self.eta != (1.0 if self.damping == "coeff_restitution" else 0.0)

    def coefficient(self, radius: float) -> float:
        """Return the stiffness beta for the effective radius of a contact."""
        return self.stiffness * math.sqrt(radius) if self.model == "hertz" else self.stiffness


def compliance(young: float, poisson: float) -> float:
    """Return the term of one body in the sum that is the inverse effective modulus of two bodies."""
    return (1.0 - poisson**2) / young


#: words that only a LIGGGHTS script has
_WORDS = re.compile(
    r"^[ \t]*(fix\s.*\s(property/global|particletemplate/\w+|mesh/surface\S*|insert/\w+|wall/gran\s+model)\s"
    r"|pair_style\s+gran\s+model\s|atom_style\s+(hybrid\s+)?granular\b|(hard|soft)_particles\s)",
    re.MULTILINE,
)
#: commands of LIGGGHTS without effect on the motion
SILENT_COMMANDS = frozenset({"hard_particles", "soft_particles", "thermo_log"})
#: fixes of LIGGGHTS without effect on the motion
SILENT_FIXES = frozenset({"check/timestep/gran", "property/atom/lammps"})
#: models of a contact and their settings that are allowed; None: all, since they have no effect on motion along a line
_MODELS = {
    "model": ("hertz",),
    "tangential": None,
    "rolling_friction": None,
    "cohesion": ("off",),
    "surface": ("default",),
}
_SETTINGS = ("limitForce", "tangential_damping", "torsionTorque", "computeDissipatedEnergy", "absolute_damping")
_FORM = "gran model hertz tangential off [limitForce on]"
_STYLES = {"scalar": "scalar", "peratomtype": "list", "atomtype": "list", "peratomtypepair": "matrix"}
_NEEDED = ("youngsModulus", "poissonsRatio", "coefficientRestitution")
ABOUT = "spheres on one line with `pair_style gran model hertz tangential off`, `fix property/global` and plane walls"


def is_liggghts(text: str) -> bool:
    r"""Return True if a script has a word that only LIGGGHTS knows.

    Examples
    --------
    >>> is_liggghts("units si\natom_style granular"), is_liggghts("# pair_style gran model hertz")
    (True, False)
    """
    return _WORDS.search(text) is not None


@dataclass
class Materials:
    """The properties of ``fix property/global``."""

    script: Script
    properties: dict[str, tuple[Command, str, list[float]]] = field(default_factory=dict)

    def add(self, command: Command) -> None:
        """Evaluate a ``fix ID GROUP property/global`` command."""
        allowed = "fix ID GROUP property/global NAME scalar|peratomtype|peratomtypepair NUMBERS"
        name, style, *words = (*command.rest[3:], "", "")
        if name and name not in _NEEDED:  # friction, heat and others
            return
        kind = _STYLES.get(style, "matrix" if style == "atomtypepair" else "")
        command.fail_if(not kind, "is not supported", allowed)
        numbers = [self.script.number(command, word) for word in words[:-2]]
        if kind == "matrix":
            count = int(numbers.pop(0)) if numbers else 0
            command.fail_if(len(numbers) != count * count, f"has {len(numbers)} numbers", f"{count * count} after N")
        self.properties[name] = (command, kind, numbers)

    def settings(self, command: Command, words: Sequence[str]) -> bool:
        """Return whether forces are clipped, from the words after ``gran`` or ``wall/gran``."""
        pairs = dict(zip(words[::2], words[1::2], strict=False))
        for key, value in pairs.items():
            supported = _MODELS.get(key, ("on", "off") if key in _SETTINGS else ())
            if supported is not None and value not in supported:
                raise command.error(f"has {key} {value}, which is not supported", _FORM)
        command.fail_if(len(words) % 2 == 1 or pairs.get("model") is None, "is not supported", _FORM)
        command.fail_if(pairs.get("absolute_damping") == "on", "has absolute_damping, which is not supported", _FORM)
        return pairs.get("limitForce") == "on"

    def law(self, command: Command, first: int, second: int, *, clip: bool) -> PairLaw:
        """Return the law between two types; the type of a wall is one of them."""
        young, poisson, restitution = (self._value(command, name, first, second) for name in _NEEDED)
        if not (min(young) > 0.0 and min(poisson) > -1.0 and max(poisson) <= 0.5):
            raise command.error(f"joins types {first} and {second} of an impossible material", "E > 0, -1 < nu <= 0.5")
        e = restitution[0]
        command.fail_if(
            not 0.0 < e <= 1.0, f"has a coefficient of restitution of {e:g}", "a number above 0 and at most 1"
        )
        stiffness = 4.0 / 3.0 / sum(compliance(*material) for material in zip(young, poisson, strict=True))
        return PairLaw(command, "hertz", stiffness, e, "coeff_restitution", clip, (young[0], poisson[0]))

    def _value(self, command: Command, name: str, first: int, second: int) -> list[float]:
        """Return the values of a property for two types, or its value for the pair."""
        if name not in self.properties:
            raise command.error(f"needs the property {name}", f"fix ID GROUP property/global {name} ...")
        at, kind, numbers = self.properties[name]
        size = round(len(numbers) ** 0.5) if kind == "matrix" else len(numbers)
        at.fail_if(max(first, second) > size, f"has values for {size} types", f"{max(first, second)} types")
        if kind == "matrix":
            return [numbers[(first - 1) * size + second - 1]]
        return [numbers[first - 1], numbers[second - 1]]
