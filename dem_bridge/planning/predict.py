"""What a run will err by and cost, before there is one: from a coarse run of the scene and laws of a few numbers each.

The coarse run (:mod:`.backends.prescan`) knows the highest frequency omega of a contact, and the phase that the
stiffest contact of each moment goes through, all moments together. A fixed step of order p errs by ``C phase^b (omega
dt)^p``: local errors go with (omega dt)^p, and a long run makes more of them than a short one. C and b are fits to 186
random scenes (tests/random_plans.py, others than those of its benchmark): what is predicted here is an order of
magnitude, to be checked by runs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.prescan import Prescan
from dem_bridge.backends.splitting import fits
from dem_bridge.backends.steps import fixed_step_plan
from dem_bridge.backends.tabled import prescan_scene
from dem_bridge.dense import PHASE_PER_DENSE_SAMPLE, Schedule
from dem_bridge.errors import UsageError
from dem_bridge.scene import Scene
from dem_bridge.timescales import contact_time_of, rayleigh_time_of

EPS = 2.0**-52
#: rad that the stiffest contact goes through in a step of the coarse run; with damped contacts a tenth
_PHASE = 0.1


@dataclass(frozen=True, kw_only=True)
class ErrorLaw:
    """Error of velocities, relative to the largest: ``factor * phase**growth * knob**order``, as in half of all random
    scenes or less."""

    order: float
    factor: float
    growth: float
    spread: float
    """Four in five random scenes or more err by no more than this times the law; most of the others have condition
    numbers of 1e4 and more. Where nothing but single collisions happens errors may be a hundred times smaller."""


#: by the order of a fixed step; the knob is omega dt. Where contacts open and close, order 4 is 2.5 on the whole
OF_STEP: Mapping[int, ErrorLaw] = MappingProxyType(
    {
        1: ErrorLaw(order=1.0, factor=1.3e-2, growth=0.20, spread=40.0),
        2: ErrorLaw(order=2.0, factor=1.0e-2, growth=0.75, spread=10.0),
        4: ErrorLaw(order=2.5, factor=2.5e-4, growth=0.55, spread=30.0),
    }
)
#: of scipy; the knob is rtol
OF_RTOL = ErrorLaw(order=0.83, factor=2.0e-2, growth=0.68, spread=40.0)
#: errors of observables over those of velocities, with orders 1 and 2: ``factor * phase**growth``
OBSERVED: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        "velocity": (1.0, 0.0),
        "displacement": (0.45, -0.13),
        "contact_force": (2.5, -0.17),
        "peak_force": (5.0, -0.69),
        "crossing_time": (3.7, -0.81),
        "arrival": (6.6, -1.27),
        "residence": (2.0, -0.61),
    }
)
#: in-house codes at fixed steps, by which of their kernels a scene takes
FAST, PLAIN = "in-house, fast kernel", "in-house, plain kernel"
#: s of one core, of fixed steps: of any run; of a dense sample, and of a body in it; of an evaluation of the forces,
#: and of a body in it. Measured on random scenes, within a factor 2 for nine of ten
COST: Mapping[str, tuple[float, float, float, float, float]] = MappingProxyType(
    {
        FAST: (4.0e-4, 5.0e-8, 6.0e-9, 2.8e-8, 2.2e-10),
        PLAIN: (5.0e-4, 2.0e-8, 2.5e-8, 1.0e-8, 1.0e-8),
        "lammps-granular": (8.8e-3, 7.2e-6, 3.1e-7, 6.1e-7, 2.5e-8),
        "lammps-table": (1.5e-2, 5.5e-6, 8.3e-7, 4.0e-7, 2.8e-8),
        "ase": (5e-2, 0.0, 1e-6, 2e-5, 5e-7),
    }
)
#: evaluations of the forces in a step, where it is not one
EVALUATIONS: Mapping[str, int] = MappingProxyType({"blanes-moan": 6})
#: ... of what has no fixed step: of any run, and ``factor * bodies**a * survey_steps**b * (rtol / 1e-6)**c``
ADAPTIVE: Mapping[str, tuple[float, float, float, float, float]] = MappingProxyType(
    {
        "reference": (5e-4, 3e-5, 1.63, 0.12, 0.0),
        "scipy": (7e-3, 6.7e-4, 1.19, 0.33, -0.06),
        "bca": (3e-4, 0.0, 0.0, 0.0, 0.0),
        "adiabatic": (1.3e-3, 0.0, 0.0, 0.0, 0.0),
    }
)
#: bar of the reference: 95 % of random scenes are below ``factor * phase**growth``
REFERENCE_BAR = (3e-15, 1.33)
#: what 95 % of random single-pulse chains err by, bodies and contacts at random within one and a half decades; medians
#: are a fifth of it, and steadily graded chains are better. No other observable comes near
THEORY_ERROR: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {"bca": {"arrival": 0.07, "crossing_time": 0.2}, "adiabatic": {"arrival": 0.2, "crossing_time": 0.26}}
)


@dataclass(frozen=True, kw_only=True)
class Outlook:
    """A scene, what its coarse run found, and its samples: all that predictions are made of."""

    scene: Scene
    prescan: Prescan
    sampling: Sampling

    @classmethod
    def of(cls, scene: Scene, sampling: Sampling) -> Outlook:
        """Makes the coarse run; RunBroken where that would take too long."""
        return cls(scene=scene, prescan=prescan_scene(scene), sampling=sampling)

    @property
    def phase(self) -> float:
        """rad that the stiffest contact of each moment goes through, all moments together; at least 1."""
        if self.scene.law is not None:
            return max(1.0, self.prescan.frequency * self.scene.duration)
        return max(1.0, self.prescan.steps * (0.1 * _PHASE if self.scene.damped else _PHASE))

    def schedule(self, dt: float) -> Schedule:
        """The steps that a run with this ``dt`` (s) takes."""
        return fixed_step_plan(self.scene, Resolution(dt=dt), self.sampling, self.prescan)

    def _scale(self, law: ErrorLaw, observable: str) -> float:
        """Error at a knob of 1."""
        factor, growth = OBSERVED[observable]
        return float(factor * law.factor * self.phase ** (law.growth + growth))

    def error(self, law: ErrorLaw, setting: float, observable: str) -> float:
        """Relative error with ``setting``: dt (s) of a fixed step, whose last digits add up, else rtol."""
        scale = self._scale(law, observable)
        if law is OF_RTOL:
            return float(scale * setting**law.order)
        digits = EPS * math.sqrt(self.scene.duration / setting)
        return float(scale * (self.prescan.frequency * setting) ** law.order) + digits

    def setting(self, law: ErrorLaw, error: float, observable: str) -> float:
        """The setting that errs by ``error``; inf where nothing touches anything."""
        knob: float = (error / self._scale(law, observable)) ** (1.0 / law.order)
        if law is OF_RTOL:
            return knob
        return knob / self.prescan.frequency if self.prescan.frequency > 0.0 else math.inf

    def cost(self, name: str, setting: float = math.nan) -> float:
        """CPU of a run without bars, s."""
        bodies = self.scene.n_body
        if name in ADAPTIVE:
            once, factor, a, b, c = ADAPTIVE[name]
            coarse = self.prescan.steps * (0.1 if self.scene.damped else 1.0)
            finer = (setting / 1e-6) ** c if c != 0.0 else 1.0
            return float(once + factor * bodies**a * coarse**b * finer)
        once, row, row_body, evaluation, evaluation_body = COST.get(name, COST[FAST if fits(self.scene) else PLAIN])
        interval = self.scene.duration / self.sampling.count
        steps = self.sampling.count * max(1.0, interval / setting)
        rows = min(steps, self.sampling.count * max(1.0, interval * self.prescan.frequency / PHASE_PER_DENSE_SAMPLE))
        evaluations = steps * EVALUATIONS.get(name, 1)
        return once + rows * (row + row_body * bodies) + evaluations * (evaluation + evaluation_body * bodies)

    def known_error(self, name: str, observable: str) -> float:
        """Relative error of what has no setting; inf where nothing is known."""
        factor, growth = REFERENCE_BAR
        if name == "reference":
            return float(factor * self.phase**growth) + EPS
        return THEORY_ERROR[name].get(observable, math.inf)

    def units(self, dt: float) -> dict[str, float]:
        """``dt`` (s) as a fraction of the times that DEM users think in; those that the scene has."""
        found = {}
        if (rayleigh := rayleigh_time_of(self.scene)) is not None:
            found["rayleigh_time"] = dt / rayleigh
        if (contact := contact_time_of(self.scene)) is not None:
            found["contact_time"] = dt / contact
        if self.prescan.frequency > 0.0:
            found["2/omega"] = dt * self.prescan.frequency / 2.0
        return found


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
