"""Impacts whose restitution has a closed form: a scene of one contact for each damping law.

The spheres are those of Chung & Ooi's third test (aluminium oxide, 2.5 mm, 3.9 m/s). Laws that are defined by a
restitution, and Kuwabara-Kono, act on their Hertz contact; dashpots act on a linear spring whose elastic contact lasts
as long.

The heights of a bouncing sphere are those of MFiX DEM-02. A hard sphere rises to ``e^2`` of its last height. A soft one
rises less high, because gravity acts during the contact; its heights are exact by
:func:`~dem_bridge.physics.drop_and_stack.linear_drop`. The difference of a code from these is its numerical error.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Literal, cast

import numpy as np
from scipy.optimize import brentq

from dem_bridge.backends.base import ENGINE_BACKENDS, Resolution, Sampling
from dem_bridge.lmp.engine import Engine
from dem_bridge.observables.verdict import Outcome, judge_relative
from dem_bridge.physics.damped_impact import (
    RestitutionLaw,
    alpha_of_restitution,
    bounce_heights,
    linear_restitution,
    restitution_obtained,
)
from dem_bridge.physics.drop_and_stack import linear_drop
from dem_bridge.physics.exact import two_body_collision
from dem_bridge.physics.hertz import sphere_on_sphere
from dem_bridge.physics.viscoelastic import LARGEST_STRENGTH, viscoelastic_impact
from dem_bridge.runs.campaign import Result
from dem_bridge.runs.case import Case
from dem_bridge.scene.file import load_scene
from dem_bridge.scene.scene import BY_RESTITUTION, DAMPING_LAWS, DASHPOTS, Damping, Scene, Wall

#: laws that the study knows
LAWS = tuple(DAMPING_LAWS)
RADIUS, SPEED, DENSITY = 2.5e-3, 3.9, 4000.0
MATERIAL = {"young": 380e9, "poisson": 0.23}
#: restitution of the impact at which speed, mass ratio, radius and time step are varied, not clipped
USUAL = 0.5
#: coefficients of restitution that are written
WRITTEN = (0.1, 0.3, 0.5, 0.7, 0.9)
#: parameters that are varied, with their values; the mass ratio is that of the second body to the first, inf for a wall
Parameter = Literal["speed", "ratio", "radius"]
VARIED: dict[Parameter, tuple[float, ...]] = {
    "speed": (SPEED / 30.0, SPEED, 30.0 * SPEED),
    "ratio": (0.1, 1.0, math.inf),
    "radius": (0.5 * RADIUS, RADIUS, 2.0 * RADIUS),
}
#: duration in elastic contact times: an impact that is not clipped at e = 0.1 lasts less than 3
CONTACTS = 8


@dataclass(frozen=True, kw_only=True)
class Impact:
    """One impact of a sphere on another one, or on a wall, with a damping law."""

    law: str
    coefficient: float
    """In the unit of the law."""
    clip: bool
    speed: float = SPEED
    ratio: float = 1.0
    """Mass of the second body over that of the first, by its density: the contact stays the same; inf is a wall."""
    radius: float = RADIUS
    """Radius of both spheres, m."""

    @property
    def mass(self) -> float:
        """Mass of the first sphere, kg."""
        return 4.0 / 3.0 * math.pi * DENSITY * self.radius**3

    @property
    def effective_mass(self) -> float:
        """Effective mass of the contact, kg."""
        return self.mass / (1.0 + 1.0 / self.ratio)

    @property
    def exponent(self) -> float:
        """Exponent n of the contact: 2 with a dashpot, otherwise 5/2."""
        return 2.0 if self.law in DASHPOTS else 2.5

    @property
    def stiffness(self) -> float:
        """Stiffness of the contact, N/m^(n-1); a linear spring does not depend on the radius."""
        return _spring() if self.law in DASHPOTS else _hertz(self.radius)

    @property
    def contact_time(self) -> float:
        """Time of the elastic contact, s."""
        masses, velocities = (self.mass, self.ratio * self.mass), (self.speed, 0.0)
        hit = two_body_collision(masses=masses, velocities=velocities, stiffness=self.stiffness, exponent=self.exponent)
        return hit.contact_time

    @property
    def clip_words(self) -> str:
        """Clip in words."""
        return "clipped" if self.clip else "not clipped"

    @property
    def name(self) -> str:
        """Law and clip in words."""
        return f"{self.law}, {self.clip_words}"

    @property
    def scene(self) -> Scene:
        """The impact as a scene that ends after the contact."""
        parts: dict[str, Any] = {"mass": (self.mass,), "stiffness": (), "velocity": (self.speed,)}
        if self.ratio == math.inf:
            parts["wall_right"] = Wall(stiffness=self.stiffness, exponent=self.exponent)
        else:
            parts = {"mass": (self.mass, self.ratio * self.mass), "stiffness": (self.stiffness,)}
            parts["velocity"] = (self.speed, 0.0)
        return Scene(
            name="impact",
            duration=CONTACTS * self.contact_time,
            exponent=self.exponent,
            damping=Damping(law=self.law, coefficient=self.coefficient, clip=self.clip),
            **parts,
        )

    def theory(self) -> tuple[float, float]:
        """Return the restitution by the closed form of the law, and a bound of its error."""
        mass, stiffness, value = self.effective_mass, self.stiffness, self.coefficient
        if self.law in BY_RESTITUTION:
            law = cast("RestitutionLaw", self.law)
            return restitution_obtained(value, clip=self.clip, law=law), math.ulp(1.0)
        if self.law in DASHPOTS:
            damping = value if self.law == "dashpot" else value * mass
            ratio = 0.5 * damping / math.sqrt(stiffness * mass)
            return linear_restitution(damping_ratio=ratio, clip=self.clip), math.ulp(1.0)
        hit = viscoelastic_impact(mass=mass, speed=self.speed, stiffness=stiffness, viscosity=value, clip=self.clip)
        return hit.restitution, hit.remainder


@cache
def usual_impact(law: str, clip: bool | None = None) -> Impact:
    """Return the impact of two equal spheres whose restitution is :data:`USUAL` if it is not clipped.

    Parameters
    ----------
    law : str
        Damping law.
    clip : bool, optional
        None: not clipped where the coefficient is a restitution, which only then is that of the impact.

    Examples
    --------
    >>> for law in LAWS:
    ...     pulling, clipped = (usual_impact(law, clipped).theory()[0] for clipped in (False, True))
    ...     print(f"{law}: {pulling:.5f}, clipped {clipped:.5f}")
    dashpot: 0.50000, clipped 0.55028
    mass_velocity: 0.50000, clipped 0.55028
    kuwabara-kono: 0.50000, clipped 0.53156
    tsuji: 0.49992, clipped 0.55022
    coeff_restitution: 0.50000, clipped 0.55028
    """
    impact = Impact(law=law, coefficient=1.0, clip=law not in BY_RESTITUTION if clip is None else clip)
    mass, stiffness, value = impact.effective_mass, impact.stiffness, USUAL
    if law in DASHPOTS:
        damping = alpha_of_restitution(USUAL, 2.0) * math.sqrt(stiffness * mass)
        value = damping if law == "dashpot" else damping / mass
    elif law == "kuwabara-kono":
        most = LARGEST_STRENGTH / ((stiffness / mass) ** 0.4 * SPEED**0.2)
        pulling = replace(impact, clip=False)
        excess = lambda gamma: replace(pulling, coefficient=gamma).theory()[0] - USUAL  # noqa: E731
        value = brentq(excess, 0.0, most * (1.0 - 1e-12), xtol=1e-16 * most)
    return replace(impact, coefficient=value)


def written_impacts(laws: Sequence[str]) -> list[Impact]:
    """Return the impacts for all coefficients of restitution that are written, clipped and not."""
    chosen = [law for law in laws if law in BY_RESTITUTION]
    return [Impact(law=law, coefficient=e, clip=clip) for law in chosen for clip in (False, True) for e in WRITTEN]


def varied_impacts(law: str, parameter: Parameter, values: Sequence[float] | None = None) -> list[Impact]:
    """Return the usual impact of a law with other values of one parameter; None: those of :data:`VARIED`."""
    chosen = VARIED[parameter] if values is None else values
    changes: list[dict[str, Any]] = [{parameter: value} for value in chosen]
    return [replace(usual_impact(law), **change) for change in changes]


def curve_of(law: str, parameter: Parameter) -> tuple[np.ndarray, np.ndarray]:
    """Return values of a parameter over the range that is varied, and the restitution by the closed form."""
    values = [value for value in VARIED[parameter] if value < math.inf]
    x = np.geomspace(min(values), 30.0 if parameter == "ratio" else max(values), 41)
    return x, np.array([impact.theory()[0] for impact in varied_impacts(law, parameter, x.tolist())])


@cache
def _hertz(radius: float) -> float:
    """Return the stiffness of the contact of two spheres of a radius, N/m^1.5."""
    return sphere_on_sphere(radius=radius, **MATERIAL).stiffness


@cache
def _spring() -> float:
    """Return the stiffness of the linear spring, N/m: the usual pair is in contact as long as by Hertz's law."""
    pair = Impact(law="coeff_restitution", coefficient=1.0, clip=False)
    return pair.effective_mass * (math.pi / pair.contact_time) ** 2


SCENE = "mfix-dem-02"
#: stiffness of the plane, N/m
STIFFNESS = (5e4, 5e5, 5e6)
#: time steps in a contact, and samples of the run: heights are read at the sample next to each summit
STEPS, SAMPLES = 200, 1500
#: round-off of the closed form: exponentials and roots, relative
ROUND_OFF = 1e-13


@dataclass(frozen=True, kw_only=True)
class Bounce:
    """Height after one bounce, by one code."""

    backend: str
    stiffness: float
    """N/m."""
    number: int
    """From 1."""
    hard: float
    """Height of the hard sphere, m."""
    soft: float
    """Height of the soft sphere, m."""
    height: float
    """Height by the code, m."""
    uncertainty: float
    """Estimated numerical error of it, m."""

    @property
    def softness(self) -> float:
        """Soft sphere less hard sphere, relative to the hard one."""
        return self.soft / self.hard - 1.0

    @property
    def error(self) -> float:
        """Code less soft sphere, m."""
        return self.height - self.soft

    @property
    def outcome(self) -> Outcome:
        """PASS if the code has the height of the soft sphere within its uncertainty."""
        return judge_relative(abs(self.error) / self.soft, ROUND_OFF, self.uncertainty / self.soft)


def bouncing_scenes() -> list[Scene]:
    """Return the scene with each stiffness of the plane."""
    scene = load_scene(SCENE)
    assert scene.wall_right is not None
    return [replace(scene, wall_right=replace(scene.wall_right, stiffness=stiffness)) for stiffness in STIFFNESS]


def bounce_cases(backends: Sequence[str], engine: Engine | None) -> list[Case]:
    """Return the cases of all scenes and codes."""
    return [
        Case(
            scene=scene,
            backend=backend,
            resolution=Resolution(dt=math.pi * math.sqrt(scene.mass[0] / scene.contacts.stiffness[0]) / STEPS),
            sampling=Sampling(count=SAMPLES),
            engine=engine if backend in ENGINE_BACKENDS else None,
        )
        for scene in bouncing_scenes()
        for backend in backends
    ]


def soft_summits(scene: Scene) -> Iterator[tuple[float, float]]:
    """Yield the time (s) and the height (m) of each summit of the soft sphere within the duration of the scene."""
    gap, gravity = float(scene.contacts.gap[0]), scene.gravity
    height, time = gap, 0.0  # of the last summit
    while True:
        drop = linear_drop(
            mass=scene.mass[0],
            stiffness=float(scene.contacts.stiffness[0]),
            damping=float(scene.contacts.damping[0]),
            height=height,
            gravity=gravity,
        )
        time += drop.touch_time + drop.contact_time + drop.exit_speed / gravity
        height = drop.rebound_height
        if not time <= scene.duration:
            return
        yield time, height


def bounces_of(scene: Scene, result: Result) -> Iterator[Bounce]:
    """Yield the bounces of a run of the scene: heights follow from position and velocity in free flight."""
    run = result.trajectory
    assert scene.damping is not None
    assert not isinstance(scene.damping.coefficient, float)
    summits = list(soft_summits(scene))
    gap, gravity = float(scene.contacts.gap[0]), scene.gravity
    hard = bounce_heights(height=gap, restitution=scene.damping.coefficient[0], bounces=len(summits))
    for number, (time, soft) in enumerate(summits):
        height = uncertainty = math.nan
        if run is not None:
            at = int(np.argmin(np.abs(run.time - time)))
            speed = abs(float(run.velocity[at, 0]))
            height = gap - float(run.displacement[at, 0]) + 0.5 * speed**2 / gravity
            uncertainty = run.uncertainty.displacement + speed * run.uncertainty.velocity / gravity
        yield Bounce(
            backend=result.case.backend,
            stiffness=float(scene.contacts.stiffness[0]),
            number=number + 1,
            hard=hard[number],
            soft=soft,
            height=height,
            uncertainty=uncertainty,
        )
