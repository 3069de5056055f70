"""Chains of struck bodies, with their own formulas of stiffness, statics and damping, and their scene files."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Chain:
    """A chain in SI units: one entry per body, or per contact with the walls after the contacts of the chain.

    ``left`` and ``right`` are the bodies of each contact; the index ``n_body`` is a wall. The force of a contact is
    ``stiffness overlap^power + damping overlap^damping_power overlap'``.
    """

    family: str
    scene: str
    """Text of the scene file."""
    duration: float
    samples: int
    mass: Floats
    velocity: Floats
    left: NDArray[np.int64]
    right: NDArray[np.int64]
    stiffness: Floats
    power: Floats
    gap: Floats
    damping: Floats
    damping_power: Floats
    clipped: bool = True
    tension: bool = False
    gravity: float = 0.0
    load: Floats
    drag: float = 0.0
    radius: Floats | None = None
    """Effective radius R* of each contact, m, if the scene file has shapes."""
    modulus_ratio: Floats | None = None
    """E / E* of each contact, E the harmonic mean of both bodies, if the scene file has materials."""

    @property
    def n_body(self) -> int:
        """Number of bodies."""
        return len(self.mass)

    @property
    def equal_radii(self) -> bool:
        """True if all effective radii are equal, or unknown."""
        return self.radius is None or bool(np.nanmax(self.radius) - np.nanmin(self.radius) < 1e-12 * self.radius[0])

    def with_stiffness(self, factor: Floats | float) -> Chain:
        """Return the chain with other stiffnesses; viscoelastic damping is proportional to them."""
        damping = np.where(self.damping_power > 0.0, self.damping * factor, self.damping)
        return replace(self, stiffness=self.stiffness * factor, damping=damping)

    @property
    def starts_at_rest(self) -> bool:
        """True if no body is accelerated at the start."""
        return self.family not in ("falling", "overlapping") and not (self.gravity and self.family != "stack")

    @property
    def scale_free(self) -> bool:
        """True if a factor on all stiffnesses changes the velocities as a factor on the time does."""
        pulled = self.gravity or np.any(self.load) or np.any(self.gap) or np.any(self.damping) or self.drag
        return not pulled and bool(np.ptp(self.power) == 0.0)


def _numbers(values: Sequence[float] | Floats) -> str:
    return "[" + ", ".join(repr(float(value)) for value in values) + "]"


def _twelve_digits(values: Sequence[float] | Floats) -> Floats:
    """Return values as they enter a scene: numbers from formulas are rounded to 12 digits."""
    return np.array([float(f"{value:.12g}") for value in values])


def contact_time(mass: float, stiffness: float, speed: float) -> float:
    """Return the duration of a Hertzian collision of two bodies of this mass, s."""
    overlap = (5.0 * (0.5 * mass) * speed**2 / (4.0 * stiffness)) ** 0.4
    return float(2.943275184325 * overlap / speed)


def _passage(mass: Floats, stiffness: Floats, speed: float) -> float:
    """Return about how long a pulse takes through the chain, s."""
    steps = [0.5 * contact_time(m, beta, 0.6 * speed) for m, beta in zip(mass[1:], stiffness, strict=False)]
    return float(sum(steps))


def _chain(
    family: str,
    mass: Floats,
    stiffness: Floats,
    *,
    speed: float,
    shape: str = "",
    wall: float | None = None,
    force_exponent: float = 1.5,
    gap: Floats | None = None,
    damping: tuple[str, float] | None = None,
    pressed: float = 0.0,
    gravity: float = 0.0,
    passages: float = 1.1,
    samples: int = 200,
    radius: Floats | None = None,
    modulus_ratio: Floats | None = None,
    name: str = "",
) -> Chain:
    """Return a chain whose body 0 moves, and its scene file; ``shape`` replaces the raw table of the file."""
    bodies = len(mass)
    left, right = np.arange(bodies - 1), np.arange(1, bodies)
    if wall is not None:
        left, right = np.append(left, bodies - 1), np.append(right, bodies)
        stiffness = np.append(stiffness, wall)
        gap = None if gap is None else np.append(gap, 0.0)
    contacts = len(left)
    clearances = np.zeros(contacts) if gap is None else gap
    load = np.zeros(bodies)
    if pressed:
        # the wall at the end carries the weight; the load is on the first body, and on the last one without a wall
        carried = pressed + np.cumsum(mass)[: contacts if wall is not None else bodies - 1] * gravity
        clearances = -((carried / stiffness) ** (1.0 / force_exponent))
        load[0] = pressed
        load[-1] -= pressed if wall is None else 0.0
    inverse = np.append(1.0 / mass, 0.0)
    effective = 1.0 / (inverse[left] + inverse[right])
    factor, power = damping_terms(damping, effective, stiffness, force_exponent)
    duration = float(f"{passages * _passage(mass, stiffness, speed):.3g}")
    lines = [f'name = "{name or family}"', f"duration = {duration!r}"]
    lines += (
        [shape]
        if shape
        else ["[chain]", f"mass = {_numbers(mass)}", f"stiffness = {_numbers(stiffness[: bodies - 1])}"]
    )
    if not shape:
        lines += [f"exponent = {force_exponent + 1.0!r}", f"velocity = {_numbers([speed, *[0.0] * (bodies - 1)])}"]
        lines += [] if gap is None else [f"gap = {_numbers(gap[: bodies - 1])}"]
    lines += [] if wall is None else ["[chain.wall_right]", f"stiffness = {wall!r}"]
    lines += [] if damping is None else ["[chain.damping]", f'law = "{damping[0]}"', f"coefficient = {damping[1]!r}"]
    lines += ["[chain.precompression]", f"force = {pressed!r}"] if pressed else []
    lines += ["[environment]", f"gravity = {gravity!r}"] if gravity else []
    lines += ["[sampling]", f"count = {samples}"]
    start = np.zeros(bodies)
    start[0] = speed
    return Chain(
        family=family,
        scene="\n".join(lines) + "\n",
        duration=duration,
        samples=samples,
        mass=mass,
        velocity=start,
        left=left,
        right=right,
        stiffness=stiffness,
        power=np.full(contacts, force_exponent),
        gap=clearances,
        damping=factor,
        damping_power=power,
        gravity=gravity,
        load=load,
        radius=radius,
        modulus_ratio=modulus_ratio,
    )


def damping_terms(
    damping: tuple[str, float] | None, effective_mass: Floats, stiffness: Floats, force_exponent: float
) -> tuple[Floats, Floats]:
    """Return the factor of the damping force of each contact, and the power of the overlap in it."""
    if damping is None:
        return np.zeros(len(stiffness)), np.zeros(len(stiffness))
    law, value = damping
    factor, power = {
        "dashpot": (value * np.ones(len(stiffness)), 0.0),
        "mass_velocity": (value * effective_mass, 0.0),
        "kuwabara-kono": (value * stiffness, force_exponent - 1.0),
        # alpha of Antypov & Elliott 2011, for Hertz
        "coeff_restitution": (_alpha(value) * np.sqrt(effective_mass * stiffness), 0.5 * (force_exponent - 1.0)),
    }[law]
    return factor, np.full(len(stiffness), power)


def _alpha(restitution: float) -> float:
    logarithm = math.log(restitution)
    return -math.sqrt(5.0) * logarithm / math.sqrt(logarithm**2 + math.pi**2)


QUARTZ, STEEL, PTFE = (72e9, 0.17, 2200.0), (193e9, 0.3, 8000.0), (1.46e9, 0.46, 2200.0)


def _hertz(radius: Floats, materials: Sequence[tuple[float, float, float]]) -> tuple[Floats, Floats, Floats, Floats]:
    """Return mass of each sphere; stiffness, R* and E/E* of each contact."""
    youngs, poisson, density = (np.array(values) for values in zip(*materials, strict=True))
    compliance = (1.0 - poisson**2) / youngs
    star = 1.0 / (compliance[:-1] + compliance[1:])
    reduced = 1.0 / (1.0 / radius[:-1] + 1.0 / radius[1:])
    mass = _twelve_digits(4.0 / 3.0 * math.pi * density * radius**3)
    return (
        mass,
        _twelve_digits(4.0 / 3.0 * star * np.sqrt(reduced)),
        reduced,
        2.0 / (1.0 / youngs[:-1] + 1.0 / youngs[1:]) / star,
    )


def _material(values: tuple[float, float, float], table: str = "material") -> str:
    youngs, poisson, density = values
    return f"[{table}]\nyoungs_modulus = {youngs!r}\npoissons_ratio = {poisson!r}\ndensity = {density!r}"


def spheres(rng: np.random.Generator, bodies: int, *, ratio: float = 1.0, wall: bool = False) -> Chain:
    """Return equal or tapered spheres of one material, struck by one as large as the first."""
    material = QUARTZ if rng.random() < 0.5 else STEEL
    first, speed = float(rng.choice([3e-3, 4.76e-3, 9e-3])), float(f"{rng.uniform(0.2, 2.0):.2g}")
    radius = first * ratio ** np.append(0.0, np.arange(bodies - 1))
    mass, stiffness, reduced, modulus_ratio = _hertz(radius, [material] * bodies)
    lines = [_material(material), "[chain.spheres]", f"count = {bodies - 1}", f"radius = {first!r}"]
    lines += [f"ratio = {ratio!r}"] if ratio != 1.0 else []
    shape = "\n".join([*lines, "[chain.striker]", f"radius = {first!r}", f"velocity = {speed!r}"])
    beta = float(f"{stiffness[-1]:.3g}") if wall else None
    chain = _chain(
        "tapered" if ratio != 1.0 else "spheres",
        mass,
        stiffness,
        speed=speed,
        shape=shape,
        wall=beta,
        passages=1.6 if wall else 1.1,
        radius=reduced,
        modulus_ratio=modulus_ratio,
    )
    if beta is None:
        return chain
    # the wall's stiffness is a number of the scene file, in which no radius and no modulus enters
    return replace(chain, radius=np.append(reduced, np.nan), modulus_ratio=np.append(modulus_ratio, np.nan))


def dimer(rng: np.random.Generator, bodies: int) -> Chain:
    """Return equal spheres of PTFE and steel in turn."""
    bodies -= 1 - bodies % 2
    radius, speed = 4.76e-3, float(f"{rng.uniform(0.2, 1.0):.2g}")
    materials = [STEEL, *[PTFE, STEEL] * (bodies // 2)]
    mass, stiffness, reduced, modulus_ratio = _hertz(np.full(bodies, radius), materials)
    cells = [
        f'[[chain.pattern.cell]]\nshape = "sphere"\nradius = {radius!r}\nmaterial = "{m}"' for m in ("ptfe", "steel")
    ]
    lines = [_material(STEEL, "materials.steel"), _material(PTFE, "materials.ptfe"), "[chain.pattern]"]
    lines += [f"repeat = {bodies // 2}", *cells, "[chain.striker]", f"radius = {radius!r}", 'material = "steel"']
    shape = "\n".join([*lines, f"velocity = {speed!r}"])
    return _chain(
        "dimer", mass, stiffness, speed=speed, shape=shape, passages=1.0, radius=reduced, modulus_ratio=modulus_ratio
    )


def _graded_numbers(rng: np.random.Generator, bodies: int) -> tuple[Floats, Floats, float]:
    """Return masses, stiffnesses and speed of a chain like the paper's, its stiffness falling or rising."""
    stiff = np.linspace(7.27e10, 4.68e9, bodies - 2)[:: int(rng.choice([-1, 1]))]
    return (
        np.array([8.1e-3, *[1.01e-2] * (bodies - 1)]),
        np.array([3.98e9, *stiff]),
        float(f"{rng.uniform(0.3, 1.5):.2g}"),
    )


def graded(rng: np.random.Generator, bodies: int) -> Chain:
    """Return a graded chain like the paper's."""
    mass, stiffness, speed = _graded_numbers(rng, bodies)
    return _chain("graded", mass, stiffness, speed=speed)


def scattered(rng: np.random.Generator, bodies: int) -> Chain:
    """Return a chain of unequal masses and stiffnesses."""
    mass, stiffness = (_twelve_digits(rng.uniform(low, 4 * low, bodies - i)) for i, low in enumerate((4e-3, 5e9)))
    return _chain("scattered", mass, stiffness, speed=float(f"{rng.uniform(0.3, 1.5):.2g}"))


def with_gaps(rng: np.random.Generator, bodies: int) -> Chain:
    """Return a graded chain with a gap in some contacts."""
    mass, stiffness, speed = _graded_numbers(rng, bodies)
    gap = np.where(rng.random(bodies - 1) < 0.6, np.round(rng.uniform(0.2e-6, 2e-6, bodies - 1), 8), 0.0)
    return _chain("gaps", mass, stiffness, speed=speed, gap=gap, passages=1.3)


def damped(rng: np.random.Generator, bodies: int) -> Chain:
    """Return a graded chain with a dashpot or viscoelastic damping in each contact."""
    mass, stiffness, speed = _graded_numbers(rng, bodies)
    law = str(rng.choice(["dashpot", "kuwabara-kono"]))
    value = float(f"{rng.uniform(3.0, 15.0) if law == 'dashpot' else rng.uniform(1e-7, 5e-7):.2g}")
    return _chain("damped", mass, stiffness, speed=speed, damping=(law, value))


def precompressed(rng: np.random.Generator, bodies: int) -> Chain:
    """Return a uniform chain that is pressed at its ends or onto a wall."""
    mass, stiffness = np.full(bodies, 1.01e-2), np.full(bodies - 1, 5e9)
    speed, force = float(f"{rng.uniform(0.05, 0.5):.2g}"), float(f"{rng.uniform(1.0, 20.0):.2g}")
    wall = 6e9 if rng.random() < 0.5 else None
    return _chain("precompressed", mass, stiffness, speed=speed, pressed=force, wall=wall, passages=0.9)


def stack(rng: np.random.Generator, bodies: int) -> Chain:
    """Return a graded chain that stands on a wall under its weight."""
    mass, stiffness, speed = _graded_numbers(rng, bodies)
    return _chain("stack", mass, stiffness, speed=speed, pressed=1e-6, gravity=9.81, wall=4.7e9, passages=1.2)


def falling(rng: np.random.Generator, bodies: int) -> Chain:
    """Return a graded chain whose bodies fall freely onto a wall."""
    mass, stiffness, speed = _graded_numbers(rng, bodies)
    return _chain("falling", mass, stiffness, speed=speed, gravity=9.81, wall=4.7e9, passages=1.4)


def springs(rng: np.random.Generator, bodies: int) -> Chain:
    """Return a chain with contacts that are not Hertzian."""
    mass, _, speed = _graded_numbers(rng, bodies)
    n = float(rng.choice([1.0, 1.3, 1.4]))
    # about as stiff as Hertz at 5 micrometres
    return _chain(
        "springs", mass, np.full(bodies - 1, float(f"{1e10 * 5e-6 ** (1.5 - n):.3g}")), speed=speed, force_exponent=n
    )


Family = Callable[[np.random.Generator, int], Chain]
FAMILIES: dict[str, Family] = {
    "spheres": spheres,
    "graded": graded,
    "tapered": lambda rng, bodies: spheres(rng, bodies, ratio=float(rng.choice([0.95, 0.97, 1.04])), wall=True),
    "dimer": dimer,
    "scattered": scattered,
    "gaps": with_gaps,
    "damped": damped,
    "precompressed": precompressed,
    "stack": stack,
    "falling": falling,
    "springs": springs,
}
