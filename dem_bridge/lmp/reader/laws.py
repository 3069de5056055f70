"""The normal force between the atoms of two types on a straight line, in the units of a script."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from dem_bridge.lmp.reader.script import Command


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

    def mixed(self, other: PairLaw, types: tuple[int, int], command: Command) -> PairLaw:
        """Return the law that LAMMPS mixes for two ``types`` i and j from the laws of i with i and j with j."""
        alike, others = (
            (law.model, law.damping, law.clip, law.material is None, law.surface_energy > 0.0) for law in (self, other)
        )
        if alike != others:
            raise command.error("leaves two types that meet without coefficients", "pair_coeff I J for these types")
        eta = math.sqrt(self.eta * other.eta)
        gamma = math.sqrt(self.surface_energy * other.surface_energy)
        if self.material is None or other.material is None:
            stiffness, material = math.sqrt(self.stiffness * other.stiffness), None
            numbers = [stiffness, eta]
        else:
            both = compliance(*self.material) + compliance(*other.material)
            stiffness, material, poisson = 4.0 / 3.0 / both, self.material, self.material[1]
            numbers = [2.0 * (1.0 - poisson**2) / both, eta, poisson]
        numbers += [gamma] if self.surface_energy > 0.0 else []
        name, words = self.command.rest[2], self.command.rest[3:]
        numbers += [0.0] if name == "dmt" and len(numbers) < 4 else []
        text = " ".join((*map(str, types), name, *map(repr, numbers), *words[len(numbers) :]))
        return PairLaw(
            self.command, self.model, stiffness, eta, self.damping, self.clip, material, gamma, f"pair_coeff {text}"
        )


def compliance(young: float, poisson: float) -> float:
    """Return the term of one body in the sum that is the inverse effective modulus of two bodies."""
    return (1.0 - poisson**2) / young
