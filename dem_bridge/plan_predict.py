"""What a run will err by and cost, before there is one: from a coarse run of the scene and laws of a few numbers each.

The coarse run (:mod:`.backends.survey`) knows the highest frequency omega of a contact, and the phase that the stiffest
contact of each moment goes through, all moments together. A fixed step of order p errs by ``C phase^b (omega dt)^p``:
local errors go with (omega dt)^p, and a long run makes more of them than a short one. C and b are fits to random scenes
(tests/random_plans.py); ``spread`` is the factor within which nine of ten of them lie. Ill-conditioned chains err by
more: what is predicted here is an order of magnitude, to be checked by runs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.steps import fixed_step_plan
from dem_bridge.backends.survey import Survey
from dem_bridge.backends.tabled import survey_of
from dem_bridge.dense import Schedule
from dem_bridge.errors import UsageError
from dem_bridge.scene import Scene

#: rad that the stiffest contact goes through in a step of the coarse run; with damped contacts a tenth
_PHASE = 0.1


@dataclass(frozen=True, kw_only=True)
class ErrorLaw:
    """Error of velocities, relative to the largest: ``factor * phase**growth * knob**order``."""

    order: float
    factor: float
    growth: float
    spread: float
    """Nine of ten random scenes have their error within this factor of the law's, either way."""


#: by the order of a fixed step; the knob is omega dt
OF_STEP: Mapping[int, ErrorLaw] = MappingProxyType(
    {
        1: ErrorLaw(order=1.0, factor=1.0e-3, growth=0.7, spread=10.0),
        2: ErrorLaw(order=2.0, factor=1.0e-2, growth=0.8, spread=10.0),
        4: ErrorLaw(order=3.0, factor=1.0e-4, growth=0.9, spread=10.0),
    }
)
#: of scipy; the knob is rtol
OF_RTOL = ErrorLaw(order=0.95, factor=1.0, growth=0.5, spread=20.0)
#: errors of other observables over that of velocities, on the same scenes (medians)
OBSERVED = MappingProxyType(
    {
        "velocity": 1.0,
        "displacement": 0.3,
        "contact_force": 3.0,
        "peak_force": 1.0,
        "crossing_time": 0.3,
        "arrival": 0.1,
        "residence": 1.0,
    }
)
#: s of one core, of a fixed step: of any run; of a body at a dense sample; of a body and force evaluation
COST: Mapping[str, tuple[float, float, float]] = MappingProxyType(
    {
        "verlet": (1.2e-3, 4e-8, 3.5e-9),
        "lammps-granular": (1e-2, 4e-7, 5e-8),
        "lammps-table": (1e-2, 4e-7, 3e-8),
        "ase": (5e-2, 1e-6, 1e-6),
    }
)
#: ... of what has no fixed step: of any run; of a step of the coarse run; of that and a body
ADAPTIVE: Mapping[str, tuple[float, float, float]] = MappingProxyType(
    {
        "reference": (3e-4, 4e-6, 4e-7),
        "scipy": (5e-3, 1e-4, 6e-6),
        "bca": (1e-3, 0.0, 0.0),
        "adiabatic": (3e-3, 0.0, 0.0),
    }
)
#: bar of the reference: 95 % of random scenes are below ``factor * phase**growth``
REFERENCE_BAR = (3e-14, 1.3)
#: of times along the chain, in 95 % of random single-pulse chains
THEORY_ERROR: Mapping[str, float] = MappingProxyType({"bca": 0.05, "adiabatic": 0.05})
#: what scipy costs goes with rtol^-1/8, the order of its steps
_OF_TOLERANCE = 1.0 / 8.0
#: rtol of which ADAPTIVE speaks
_RTOL = 1e-6


@dataclass(frozen=True, kw_only=True)
class Outlook:
    """A scene, what its coarse run found, and its samples: all that predictions are made of."""

    scene: Scene
    look: Survey
    sampling: Sampling

    @classmethod
    def of(cls, scene: Scene, sampling: Sampling) -> Outlook:
        """Makes the coarse run; RunBroken where that would take too long."""
        return cls(scene=scene, look=survey_of(scene), sampling=sampling)

    @property
    def phase(self) -> float:
        """rad that the stiffest contact of each moment goes through, all moments together; at least 1."""
        if self.scene.law is not None:
            return max(1.0, self.look.frequency * self.scene.duration)
        return max(1.0, self.look.steps * (0.1 * _PHASE if self.scene.damped else _PHASE))

    def schedule(self, dt: float) -> Schedule:
        """The steps that a run with this ``dt`` (s) takes."""
        return fixed_step_plan(self.scene, Resolution(dt=dt), self.sampling, self.look)

    def error(self, law: ErrorLaw, setting: float, observable: str) -> float:
        """Relative error with ``setting``: dt (s) of a fixed step, else rtol."""
        knob = setting if law is OF_RTOL else self.look.frequency * setting
        return float(OBSERVED[observable] * law.factor * self.phase**law.growth * knob**law.order)

    def setting(self, law: ErrorLaw, error: float, observable: str) -> float:
        """The setting that errs by ``error``; inf where nothing touches anything."""
        knob: float = (error / (OBSERVED[observable] * law.factor * self.phase**law.growth)) ** (1.0 / law.order)
        if law is OF_RTOL:
            return knob
        return knob / self.look.frequency if self.look.frequency > 0.0 else math.inf

    def cost(self, name: str, setting: float = math.nan, *, evaluations: int = 1) -> float:
        """CPU of a run without bars, s; ``evaluations`` of the forces in a step."""
        bodies = self.scene.n_body
        if name in ADAPTIVE:
            once, step, body = ADAPTIVE[name]
            finer = (setting / _RTOL) ** -_OF_TOLERANCE if name == "scipy" else 1.0
            return once + self.look.steps * (step + body * bodies) * finer
        once, dense, each = COST.get(name, COST["verlet"])
        interval = self.scene.duration / self.sampling.count
        steps = self.sampling.count * max(1.0, interval / setting)
        rows = min(steps, self.sampling.count * max(1.0, 10.0 * interval * self.look.frequency))
        return once + bodies * (dense * rows + each * steps * evaluations)

    def known_error(self, name: str) -> float:
        """Relative error of what has no setting."""
        factor, growth = REFERENCE_BAR
        return float(factor * self.phase**growth) if name == "reference" else THEORY_ERROR[name]

    def units(self, dt: float) -> dict[str, float]:
        """``dt`` (s) as a fraction of the times that DEM users think in; those that the scene has."""
        found = {}
        if (rayleigh := rayleigh_time(self.scene)) is not None:
            found["rayleigh_time"] = dt / rayleigh
        if (contact := contact_time(self.scene, self.look)) is not None:
            found["contact_time"] = dt / contact
        if self.look.frequency > 0.0:
            found["2/omega"] = dt * self.look.frequency / 2.0
        return found


def rayleigh_time(scene: Scene) -> float | None:
    """The least time of a Rayleigh wave over a body, s: ``pi R sqrt(rho/G) / (0.1631 nu + 0.8766)``.

    Sheng, Lawrence, Briscoe & Thornton (2004, *Eng. Comput.* 21, 304); of a cylinder with its own radius. None where
    the scene does not say what its bodies are.

    >>> import dem_bridge as db
    >>> f"{1e6 * rayleigh_time(db.load_scene('decelerating-40')):.2f} us"
    '8.36 us'
    """
    if scene.geometry is None:
        return None

    def of(radius: float, young: float, poisson: float, density: float) -> float:
        shear = young / (2.0 * (1.0 + poisson))
        return math.pi * radius * math.sqrt(density / shear) / (0.1631 * poisson + 0.8766)

    return min(
        of(one.radius, one.material.youngs_modulus, one.material.poissons_ratio, one.material.density)
        for one in scene.geometry.bodies
    )


def contact_time(scene: Scene, look: Survey) -> float | None:
    """The shortest duration of a collision of two bodies alone that comes to the overlap found by ``look``, s.

    With overlap d, reduced mass mu and stiffness beta the closing speed is ``sqrt(2 beta d^n / (n mu))``, and the
    collision takes ``2 sqrt(pi) Gamma(1 + 1/n) / Gamma(1/2 + 1/n) d/v`` (:func:`.physics.exact.two_body_collision`).
    None where nothing touches, or contacts have laws of their own.
    """
    from dem_bridge.physics.exact import two_body_collision

    if scene.law is not None:
        return None
    c, mobility, found = scene.contacts, [*(1.0 / m for m in scene.mass), 0.0], []
    for k, depth in enumerate(look.peak_overlap.tolist()):
        beta, n = float(c.stiffness[k]), float(c.exponent[k])
        both = mobility[c.left[k]] + mobility[c.right[k]]
        speed = math.sqrt(2.0 * beta * depth**n / n * both)
        if speed > 0.0:
            hit = two_body_collision(masses=(1.0 / both, math.inf), velocities=(speed, 0.0), stiffness=beta, exponent=n)
            found.append(hit.contact_time)
    return min(found, default=None)


def tidy(low: float, high: float) -> float:
    """The number from ``low`` up to, but not with, ``high`` that has the fewest digits; the largest of those.

    >>> tidy(1.1236e-8, 1.1364e-8), tidy(9.96e-7, 1.04e-6)
    (1.13e-08, 1e-06)
    """
    if not 0.0 < low < high:
        raise UsageError(f"{low!r} to {high!r} is no range of positive numbers")
    if math.isinf(high):
        return low
    for digits in range(17):
        # from above: the first that is below
        unit = 10.0 ** (math.floor(math.log10(high)) - digits)
        nearest = math.floor(high / unit)
        for count in (nearest, nearest - 1):
            value = float(f"{count * unit:.{digits}e}") if count > 0 else 0.0
            if low <= value < high:
                return value
    return low
