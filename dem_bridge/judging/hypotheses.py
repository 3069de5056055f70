"""Hypotheses: what each cause changes in a scene or in its samples, with the values from which a fit starts."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dem_bridge.judging.kernels import System
from dem_bridge.judging.model import Model, system_of
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
        ratio = _effective(masses) / _effective(base.mass)
        damping = base.damping * stiffness ** self.powers[0] * ratio ** self.powers[1]
        load = (base.free - self.scene.gravity) * base.mass
        return base.changed(mass=masses, stiffness=constants, damping=damping, free=self.scene.gravity + load / masses)

    def one_mass(self, body: int) -> Callable[[Floats], Variant]:
        """Return the change of the mass of one body by the factor exp(parameter)."""
        return lambda p: Variant(self.with_factors(mass=_single(self.scene.n_body, body, _factor(p[0]))))

    def one_stiffness(self, place: int) -> Callable[[Floats], Variant]:
        """Return the change of the stiffness of one contact of the line by the factor exp(parameter)."""
        size = self.scene.n_body + 1
        return lambda p: Variant(self.with_factors(stiffness=_single(size, place, _factor(p[0]))))

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

    def bent(self, change: float, factor: float | None = None) -> System:
        """Return the system with other exponents n, on which the powers of damping forces depend, too.

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

    def damping(self, law: int, clipped: bool) -> tuple[Callable[[Floats], Variant], float]:
        """Return a change to one of the three shapes of damping, and the constant at which it is one percent.

        The shapes are constant, by the effective mass, by the stiffness (Kuwabara-Kono) and by the square root of both
        (restitution).
        """
        base, n = self.base, self.base.exponent
        mass, depth = _effective(base.mass), max(self.model.depth, 1e-12)
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


def _effective(mass: Floats) -> Floats:
    """Return the effective mass of each contact of the line, walls included."""
    inverse = np.concatenate([[0.0], 1.0 / mass, [0.0]])
    return np.asarray(1.0 / (inverse[:-1] + inverse[1:]))


def _factor(logarithm: float) -> float:
    """Return the factor of a logarithm; beyond a thousand it stays, because a fit may try any number."""
    return math.exp(min(max(logarithm, -LARGEST_LOGARITHM_OF_FACTOR), LARGEST_LOGARITHM_OF_FACTOR))


def _single(size: int, index: int, factor: float) -> Floats:
    values = np.ones(size)
    values[index] = factor
    return values


DAMPING_NAMES = ("dashpot", "mass_velocity", "kuwabara-kono", "coeff_restitution")


def global_hypotheses(scene: Scene, model: Model) -> Iterator[Hypothesis]:
    """Yield the hypotheses that concern the whole chain and are fitted by continuous parameters, or have none."""
    change = Changes(scene, model)
    base = model.system
    yield Hypothesis(
        "stiffness-scale",
        lambda p: Variant(change.with_factors(stiffness=_factor(p[0]))),
        "All stiffnesses are {0:.6g} +- {1:.2g} of the scene's.",
        WIDE_STARTS,
        value=_factor,
        family="factor",
    )
    yield Hypothesis(
        "mass",
        lambda p: Variant(change.with_factors(mass=_factor(p[0]))),
        "All masses are {0:.6g} +- {1:.2g} of the scene's.",
        WIDE_STARTS,
        value=_factor,
        family="factor",
    )
    yield from _exponents(change)
    yield from _patterns(scene, change)
    yield from _damping(scene, change)
    yield from _gravity(scene, change)
    yield Hypothesis("tension", lambda p: Variant(base.changed(pulls=True)), "Open contacts pull.")
    yield Hypothesis(
        "time-scale",
        lambda p: Variant(base, scale=_factor(p[0])),
        "Times of the file are to be multiplied by {0:.8g} +- {1:.2g}.",
        ((0.0,), (0.3,), (-0.3,)),
        value=_factor,
    )
    yield Hypothesis(
        "start-velocity",
        lambda p: Variant(base.changed(velocity=base.velocity * _factor(p[0]))),
        "All start velocities are {0:.6g} +- {1:.2g} of the scene's.",
        LOG_STARTS,
        value=_factor,
    )
    yield Hypothesis(
        "drag",
        lambda p: Variant(base._replace(drag=base.drag + p[0] / scene.duration)),
        "Every body is dragged.",
        ((0.0,), (0.1,)),
        nameable=False,
    )


def _exponents(change: Changes) -> Iterator[Hypothesis]:
    """Yield another exponent, with the stiffnesses of the scene as numbers and with others."""
    own = np.unique(change.base.exponent)
    if len(own) == 1:
        start, words = float(own[0]), f"The exponent n is {{0:.6g}} +- {{1:.2g}} in place of {own[0]:g}"
    else:
        start, words = 0.0, "The exponents n differ from the scene's by {0:.6g} +- {1:.2g}"

    def numbers(p: Floats, deviation: Floats) -> tuple[float, ...]:
        # the factor on the forces at the depth of the impact is fitted, which the exponent does not change
        depth = math.log(max(change.model.depth, 1e-12))
        factor = math.exp(float(p[1]) - float(p[0]) * depth)
        uncertain = factor * float(deviation[1] + deviation[0] * abs(depth))
        return start + float(p[0]), float(deviation[0]), factor, uncertain

    yield Hypothesis(
        "exponent",
        lambda p: Variant(change.bent(p[0])),
        f"{words}.",
        ((0.0,), (0.25,), (-0.25,), (0.5,), (-0.5,)),
        value=lambda p: start + p,
        bounds=(-1.4, 3.0),
    )
    yield Hypothesis(
        "exponent",
        lambda p: Variant(change.bent(p[0], factor=_factor(p[1]))),
        f"{words}, and stiffness over mass is {{2:.6g}} +- {{3:.2g}} times the number of the scene.",
        ((0.0, 0.0), (0.25, 0.0), (-0.25, 0.0)),
        numbers=numbers,
        bounds=(-1.4, 3.0),
        together=("exponent", "stiffness-scale"),
        least=DEVIATIONS_FROM_ZERO,
    )


def common_factor(scene: Scene, model: Model) -> Hypothesis:
    """Return one factor on all masses and stiffnesses, which changes contact forces and mostly nothing else."""
    change = Changes(scene, model)
    return Hypothesis(
        "stiffness-scale",
        lambda p: Variant(change.with_factors(mass=_factor(p[0]), stiffness=_factor(p[0]))),
        "All masses and all stiffnesses are {0:.6g} +- {1:.2g} of the scene's.",
        LOG_STARTS,
        value=_factor,
        family="common",
        together=("stiffness-scale", "mass"),
    )


def equal_radii(scene: Scene) -> bool:
    """Return whether a factor sqrt(R*) may be the same for all contacts: a scene of numbers alone has no radii."""
    return scene.geometry is None or len({body.radius for body in scene.geometry.bodies}) == 1


def uniform_name(scene: Scene, factor: float, within: float) -> str:
    """Return the cause that the value of a factor on all stiffnesses suggests; ``within`` is relative."""
    if scene.geometry is None:
        return "stiffness-scale"
    body = scene.geometry.bodies[0]
    loss = 1.0 - body.material.poissons_ratio**2
    radii = (body.radius, 0.5 * body.radius) if equal_radii(scene) else ()
    if any(abs(factor * math.sqrt(radius) - 1.0) < within for radius in radii):
        return "missing-sqrt-radius"
    if any(abs(factor / ratio - 1.0) < within for ratio in (2.0 * loss, loss, 2.0, 1.0 / loss, 0.5)):
        return "modulus"
    return "stiffness-scale"


def stiffness_patterns(scene: Scene) -> Iterator[tuple[str, Floats]]:
    """Yield causes with the factors on the stiffnesses of the contacts between bodies that they make.

    Factors are relative to their geometric mean. Stiffnesses of walls are numbers of a scene, in which neither a radius
    nor a modulus enters.
    """
    base = system_of(scene)
    inner, walls = base.stiffness[1:-1], base.stiffness[[0, -1]]
    moduli, radii = [np.ones(len(inner))], [np.cbrt(base.mass)]
    if scene.geometry is not None:
        radii = [np.array([body.radius for body in scene.geometry.bodies]), *radii]
        young = np.array([body.material.youngs_modulus for body in scene.geometry.bodies])
        loss = np.array([1.0 - body.material.poissons_ratio**2 for body in scene.geometry.bodies])
        effective = _effective(young / loss)[1:-1]
        moduli = [young[:-1] / effective, young[1:] / effective, _effective(young)[1:-1] / effective]
    patterns = [("modulus", pattern) for pattern in moduli]
    patterns += [("missing-sqrt-radius", _effective(radius)[1:-1] ** -0.5) for radius in radii]
    patterns.append(("missing-sqrt-radius", inner**-1.0))
    seen: list[Floats] = []
    for cause, pattern in patterns if len(inner) else ():
        relative = pattern / np.exp(np.mean(np.log(pattern)))
        if np.ptp(relative) < 1e-9 and (cause != "modulus" or not np.any(walls > 0.0)):
            continue
        if any(np.max(np.abs(relative - other)) < 1e-9 for other in seen):
            continue
        seen.append(relative)
        yield cause, relative


def _patterns(scene: Scene, change: Changes) -> Iterator[Hypothesis]:
    """Yield factors on stiffnesses that differ between contacts: moduli, and a missing sqrt(R*)."""
    for cause, relative in stiffness_patterns(scene):
        words = "Stiffnesses lack sqrt(R*)" if cause != "modulus" else "Stiffnesses have another modulus"
        yield Hypothesis(
            cause,
            lambda p, relative=relative: Variant(  # type: ignore[misc]
                change.with_factors(stiffness=np.concatenate([[1.0], relative * _factor(p[0]), [1.0]]))
            ),
            f"{words} in the contacts between bodies (mean factor {{0:.6g}} +- {{1:.2g}}).",
            WIDE_STARTS,
            value=_factor,
            probe=1e-3 if np.ptp(relative) < 1e-9 else None,
        )


def _damping(scene: Scene, change: Changes) -> Iterator[Hypothesis]:
    """Yield other damping, and another clip."""
    base = change.base
    if base.damped:
        yield Hypothesis(
            "clip",
            lambda p: Variant(base._replace(clipped=not base.clipped)),
            "The net contact force is {}clipped at zero.".format("not " if base.clipped else ""),
        )
        yield Hypothesis(
            "damping",
            lambda p: Variant(base.changed(damping=base.damping * _factor(p[0]))),
            "The damping is {0:.6g} +- {1:.2g} of the scene's.",
            LOG_STARTS,
            value=_factor,
        )
        yield Hypothesis(
            "damping", lambda p: Variant(base.changed(damping=0.0 * base.damping)), "Contacts are not damped."
        )
    for law, name in enumerate(DAMPING_NAMES):
        for clipped in (True, False):
            make, unit = change.damping(law, clipped)
            yield Hypothesis(
                "damping",
                make,
                f"Contacts are damped ({name}, {'clipped' if clipped else 'not clipped'}, constant {{0:.6g}}"
                " +- {1:.2g}).",
                ((0.0,), (1.0,), (0.1,), (10.0,)),
                value=partial(operator.mul, unit),
                probe=None if base.damped else 1e-2,
                reach=100.0,
                bounds=(0.0, 400.0),
                family=f"damping {law}",
            )


def _gravity(scene: Scene, change: Changes) -> Iterator[Hypothesis]:
    base, g = change.base, scene.gravity
    unit = change.model.speed / scene.duration
    starts = tuple({(-g / unit,): None, (9.81 / unit,): None, (-9.81 / unit,): None, (0.0,): None})
    sentence = "The acceleration by gravity differs from the scene's by {0:.6g} +- {1:.2g} m/s^2."
    yield Hypothesis(
        "gravity",
        lambda p: Variant(base._replace(free=base.free + p[0] * unit)),
        sentence,
        starts,
        value=lambda p: p * unit,
        reach=1e6,
    )
    if scene.precompression > 0.0 and g != 0.0:
        yield Hypothesis(
            "gravity",
            lambda p: Variant(system_of(replace(scene, gravity=g + p[0] * unit))),
            sentence,
            starts,
            value=lambda p: p * unit,
            reach=1e6,
        )
