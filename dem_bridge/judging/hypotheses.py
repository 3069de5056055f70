"""A hypothesis on the cause of a difference: what it changes in a scene or in its samples, and where its fit starts."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dem_bridge.judging.kernels import System
from dem_bridge.judging.model import Model
from dem_bridge.scene.scene import Scene

Floats = NDArray[np.float64]


class Variant(NamedTuple):
    """A changed system and the way in which its motion was written into a file."""

    system: System
    shift: float = 0.0
    """s; the file has at time t the state of the time ``scale t - shift``."""
    scale: float = 1.0
    late: float = 0.0
    """s; velocities are those of a time earlier by this much."""
    lag: int = 0
    """Samples by which the file is late."""
    factors: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Of velocity, displacement and contact force."""
    order: tuple[int, ...] | None = None
    """Body of the scene for each body of the file; contacts are reversed with all bodies, and else in their order."""
    flipped: tuple[tuple[int, int], ...] = ()
    """Quantity and body of each column with the other sign."""
    offset: tuple[float, ...] | None = None
    """Displacement of each body at the start, m."""
    method: int | None = None
    """Fixed-step method of :mod:`.kernels`, if the hypothesis requires one."""
    dt: float | None = None
    """Its step, s, if the hypothesis determines it."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A possible cause.

    ``make`` returns the variant for parameters; ``starts`` are parameters from which a fit starts, all of one length,
    which is 0 where nothing is fitted; ``evidence`` is a sentence for the value that ``value`` computes from the first
    parameter. ``nameable`` is False for causes outside the list, which are fitted as competitors.
    """

    cause: str
    make: Callable[[Floats], Variant]
    evidence: str
    starts: tuple[tuple[float, ...], ...] = ((),)
    where: str = ""
    value: Callable[[float], float] = float
    numbers: Callable[[Floats, Floats], tuple[float, ...]] | None = None
    """Numbers of the sentence, from parameters and their standard deviations, in place of those of ``value``."""
    family: str = ""
    nameable: bool = True
    bounds: tuple[Any, Any] = (-math.inf, math.inf)
    """Least and largest parameters: a number for all of them, or one each."""
    probe: float | None = 1e-3
    """First parameter at which the motion is compared with the scene's; None: only the starts are tried."""
    logarithmic: bool = False
    """The scene itself is at the parameter minus infinity."""
    together: tuple[str, ...] = ()
    """Causes that are in it at once."""
    keeps_step: bool = False
    """Parameters are none of a method that the variants require: the step of the file is known."""
    reach: float = 1.5
    """Largest first guess by linear extrapolation."""
    least: float = 0.0
    """Standard deviations by which the first parameter differs from 0: else it is a simpler hypothesis."""

    @property
    def size(self) -> int:
        """Number of fitted parameters."""
        return len(self.starts[0])


#: logarithm of the largest factor of a hypothesis
LARGEST_LOGARITHM_OF_FACTOR = 7.0
#: standard deviations by which a parameter is not 0
DEVIATIONS_FROM_ZERO = 5.0
#: numbers of a system whose changes are multiplied; those of all others are added
FACTORS = ("mass", "stiffness", "damping", "velocity")
TERMS = ("free", "exponent", "gap", "damping_power", "pull_off", "drag")
#: names of the contacts with walls
WALLS = ("wall_left", "wall_right")
LOG_STARTS = ((0.0,), (0.7,), (-0.7,))
WIDE_STARTS = (*LOG_STARTS, (1.6,), (-1.6,), (2.7,), (-2.7,))


class Changes:
    """The changes of a scene that hypotheses make, with damping constants that follow masses and stiffnesses."""

    def __init__(self, scene: Scene, model: Model) -> None:
        self.scene, self.model, self.base = scene, model, model.system
        law = scene.damping.law if scene.damping is not None else ""
        #: powers of stiffness and effective mass in the damping constants
        self.powers = {"kuwabara-kono": (1.0, 0.0), "mass_velocity": (0.0, 1.0)}.get(
            law, (0.5, 0.5) if law in ("coeff_restitution", "tsuji") else (0.0, 0.0)
        )

    def with_factors(self, mass: Floats | float = 1.0, stiffness: Floats | float = 1.0) -> System:
        """Return the system with factors on masses ``(n,)`` and stiffnesses ``(n + 1,)``."""
        base = self.base
        masses, constants = base.mass * mass, base.stiffness * stiffness
        ratio = effective(masses) / effective(base.mass)
        damping = base.damping * stiffness ** self.powers[0] * ratio ** self.powers[1]
        load = (base.free - self.scene.gravity) * base.mass
        return base.changed(mass=masses, stiffness=constants, damping=damping, free=self.scene.gravity + load / masses)

    def one_mass(self, body: int) -> Callable[[Floats], Variant]:
        """Return the change of the mass of one body by the factor exp(parameter)."""
        return lambda p: Variant(self.with_factors(mass=_single(self.scene.n_body, body, factor_of(p[0]))))

    def one_stiffness(self, place: int) -> Callable[[Floats], Variant]:
        """Return the change of the stiffness of one contact of the line by the factor exp(parameter)."""
        size = self.scene.n_body + 1
        return lambda p: Variant(self.with_factors(stiffness=_single(size, place, factor_of(p[0]))))

    def one_exponent(self, place: int) -> Callable[[Floats], Variant]:
        """Return the change of the exponent of one contact of the line, whose stiffness is the same number."""
        where = np.eye(self.scene.n_body + 1)[place]
        return lambda p: Variant(self.bent(p[0] * where))

    def one_gap(self, place: int, unit: float) -> Callable[[Floats], Variant]:
        """Return the change of the gap of one contact of the line by the parameter times ``unit`` (m)."""
        base, where = self.base, np.eye(self.scene.n_body + 1)[place]
        return lambda p: Variant(base.changed(gap=base.gap + p[0] * unit * where))

    def one_position(self, body: int, unit: float) -> Callable[[Floats], Variant]:
        """Return the change of the place of one body at the start by the parameter times ``unit`` (m)."""
        base, where = self.base, np.eye(self.scene.n_body)[body]

        def make(p: Floats) -> Variant:
            moved = p[0] * unit * where
            places = np.concatenate([[0.0], moved, [0.0]])
            return Variant(base.changed(gap=base.gap + np.diff(places)), offset=tuple(moved.tolist()))

        return make

    def bent(self, change: float | Floats, factor: float | None = None) -> System:
        """Return the system with other exponents n, on which the powers of damping forces depend, too.

        The ``change`` is one for all contacts, or one for each place on the line.

        Stiffnesses are the scene's numbers, or, with a ``factor``, such that all forces at the depth of the first
        impact are those of the scene times this factor.
        """
        base, law = self.base, self.scene.damping.law if self.scene.damping is not None else ""
        rate = {"kuwabara-kono": 1.0, "coeff_restitution": 0.5, "tsuji": 0.5}.get(law, 0.0)
        if factor is not None:
            base = self.with_factors(stiffness=factor * max(self.model.depth, 1e-12) ** -change)
        return base.changed(
            exponent=base.exponent + change, damping_power=np.maximum(base.damping_power + rate * change, 0.0)
        )

    def places(self) -> NDArray[np.int64]:
        """Return the place on the line of each contact of the scene."""
        c = self.scene.contacts
        return np.asarray(np.where(c.left == self.scene.n_body, 0, c.left + 1))

    def named_places(self) -> Iterator[tuple[int, str]]:
        """Yield the place on the line of each contact of the scene with its name: "contact 3", or "wall_left"."""
        walls = {0: WALLS[0], self.scene.n_body: WALLS[1]}
        for k, place in enumerate(self.places().tolist()):
            yield place, walls.get(place, f"contact {k}")

    def damping(self, law: int, clipped: bool) -> tuple[Callable[[Floats], Variant], float]:
        """Return a change to one of the three shapes of damping, and the constant at which it is one percent.

        The shapes are constant, by the effective mass, by the stiffness (Kuwabara-Kono) and by the square root of both
        (restitution).
        """
        base, n = self.base, self.base.exponent
        mass, depth = effective(base.mass), max(self.model.depth, 1e-12)
        present = base.stiffness > 0.0
        middle = int(np.argmax(base.stiffness))
        critical = 2.0 * np.sqrt((n - 1.0) * base.stiffness * depth ** (n - 2.0) * mass)
        shape, power = (
            (np.ones_like(n), np.zeros_like(n)),
            (mass, np.zeros_like(n)),
            (base.stiffness, np.maximum(n - 2.0, 0.0)),
            (np.sqrt(mass * base.stiffness), np.maximum(0.5 * n - 1.0, 0.0)),
        )[law]
        unit = 0.01 * critical[middle] / (shape[middle] * depth ** power[middle])

        def make(p: Floats) -> Variant:
            damping = np.where(present, shape * unit * p[0], 0.0)
            return Variant(base.changed(damping=damping, damping_power=power, clipped=clipped))

        return make, float(unit)


def effective(mass: Floats) -> Floats:
    """Return the effective mass of each contact of the line, walls included."""
    inverse = np.concatenate([[0.0], 1.0 / mass, [0.0]])
    return np.asarray(1.0 / (inverse[:-1] + inverse[1:]))


def factor_of(logarithm: float) -> float:
    """Return the factor of a logarithm; beyond a thousand it stays, because a fit may try any number."""
    return math.exp(min(max(logarithm, -LARGEST_LOGARITHM_OF_FACTOR), LARGEST_LOGARITHM_OF_FACTOR))


def _single(size: int, index: int, factor: float) -> Floats:
    values = np.ones(size)
    values[index] = factor
    return values


def merged(base: System, first: Variant, second: Variant) -> Variant | None:
    """Return the variant with the changes of both; None if both change what only one can."""
    none = Variant(base)
    for name in ("late", "lag", "order", "method"):
        if all(getattr(item, name) != getattr(none, name) for item in (first, second)):
            return None
    a, b = first.system, second.system
    if all(np.any(system.damping != base.damping) for system in (a, b)):
        return None
    if np.any((a.exponent != base.exponent) & (b.exponent != base.exponent)):
        return None
    values: dict[str, Any] = {name: _product(*(getattr(s, name) for s in (a, b, base))) for name in FACTORS}
    values |= {name: getattr(a, name) + getattr(b, name) - getattr(base, name) for name in TERMS}
    values["clipped"] = a.clipped if a.clipped != base.clipped else b.clipped
    values["pulls"] = a.pulls or b.pulls
    offsets = [np.array(item.offset) for item in (first, second) if item.offset is not None]
    own = first if first.method is not None else second
    return Variant(
        base.changed(**values),
        shift=first.shift + second.shift,
        scale=first.scale * second.scale,
        late=first.late or second.late,
        lag=first.lag or second.lag,
        factors=(
            first.factors[0] * second.factors[0],
            first.factors[1] * second.factors[1],
            first.factors[2] * second.factors[2],
        ),
        order=first.order if first.order is not None else second.order,
        flipped=(*first.flipped, *second.flipped),
        offset=tuple(np.sum(offsets, axis=0).tolist()) if offsets else None,
        method=own.method,
        dt=own.dt,
    )


def _product(first: Floats, second: Floats, base: Floats) -> Floats:
    """Return the base with both factors on it, and the sum of both where it is 0."""
    with np.errstate(all="ignore"):
        return np.where(base != 0.0, first * (second / base), first + second)
