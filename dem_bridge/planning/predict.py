"""Predictions of error and cost of a run, from the prescan of its scene and from fitted laws of a few numbers each.

The prescan (:mod:`dem_bridge.backends.prescan`) gives omega, the highest frequency of a contact, and the phase: the
integral over time of the frequency of the stiffest contact of each moment. The error of a method of order p with a
fixed step is predicted as ``C phase^b (omega dt)^p``, because each local error is proportional to (omega dt)^p and a
longer run adds up more of them. C and b are fits to 186 random scenes (tests/helpers/random_plans.py; the benchmark of
the planner uses other scenes). A prediction is an order of magnitude, which runs then check.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.prescan import Prescan
from dem_bridge.backends.splitting import FUSED
from dem_bridge.backends.steps import fixed_step_plan
from dem_bridge.backends.tabled import prescan_scene
from dem_bridge.dense import PHASE_PER_DENSE_SAMPLE, Schedule
from dem_bridge.errors import UsageError
from dem_bridge.scene import Scene
from dem_bridge.timescales import contact_time_of, rayleigh_time_of

EPS = 2.0**-52
#: phase, rad, of the stiffest contact in one step of the prescan; with damped contacts the step is a tenth of that
_PHASE = 0.1


@dataclass(frozen=True, kw_only=True)
class ErrorLaw:
    """Median velocity error of random scenes, ``factor phase**growth knob**order`` of the largest velocity."""

    order: float
    factor: float
    growth: float
    spread: float
    """In at least four of five random scenes the error is at most this factor times the law. Most of the other scenes
    have condition numbers of 1e4 and more. Where all collisions are single, errors can be a hundred times smaller."""


#: by the order of the method; the knob is omega dt. Where contacts open and close, order 4 is reduced to about 2.5
OF_STEP: Mapping[int, ErrorLaw] = MappingProxyType(
    {
        1: ErrorLaw(order=1.0, factor=1.3e-2, growth=0.20, spread=40.0),
        2: ErrorLaw(order=2.0, factor=1.0e-2, growth=0.75, spread=10.0),
        4: ErrorLaw(order=2.5, factor=2.5e-4, growth=0.55, spread=30.0),
    }
)
#: for scipy; the knob is rtol
OF_RTOL = ErrorLaw(order=0.83, factor=2.0e-2, growth=0.68, spread=40.0)
#: error of each observable over the velocity error, for orders 1 and 2: ``factor * phase**growth``
OBSERVED: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        "velocity": (1.0, 0.0),
        "displacement": (0.45, -0.13),
        "contact_force": (2.5, -0.17),
        "peak_force": (5.0, -0.69),
        "crossing_time": (3.7, -0.81),
        "arrival_at_end": (6.6, -1.27),
        "residence_time": (2.0, -0.61),
    }
)
#: observables whose errors follow from those of another one; all that are not named err as velocities
OBSERVED_AS: Mapping[str, str] = MappingProxyType(
    {
        "arrival": "crossing_time",
        "first_peak_force": "peak_force",
        "front_speed": "residence_time",
        "wave_speed": "residence_time",
    }
)
#: in-house codes with fixed steps, by the kernel that solves the scene
FAST, PLAIN = "in-house, fast kernel", "in-house, plain kernel"
#: CPU time of fixed-step runs, s: per run; per dense sample, and per body in it; per evaluation of the forces, and per
#: body in it. Measured on random scenes; nine of ten are within a factor of 2
COST: Mapping[str, tuple[float, float, float, float, float]] = MappingProxyType(
    {
        FAST: (4.0e-4, 5.0e-8, 6.0e-9, 2.8e-8, 2.2e-10),
        PLAIN: (5.0e-4, 2.0e-8, 2.5e-8, 1.0e-8, 1.0e-8),
        "lammps-granular": (8.8e-3, 7.2e-6, 3.1e-7, 6.1e-7, 2.5e-8),
        "lammps-table": (1.5e-2, 5.5e-6, 8.3e-7, 4.0e-7, 2.8e-8),
        "ase": (5e-2, 0.0, 1e-6, 2e-5, 5e-7),
    }
)
#: evaluations of the forces in a step, where there is more than one
EVALUATIONS: Mapping[str, int] = MappingProxyType({"blanes-moan": 6})
#: CPU time of runs without a fixed step, s: per run, and ``factor * bodies**a * prescan_steps**b * (rtol / 1e-6)**c``
ADAPTIVE: Mapping[str, tuple[float, float, float, float, float]] = MappingProxyType(
    {
        "reference": (5e-4, 3e-5, 1.63, 0.12, 0.0),
        "scipy": (7e-3, 6.7e-4, 1.19, 0.33, -0.06),
        "bca": (3e-4, 0.0, 0.0, 0.0, 0.0),
        "adiabatic": (1.3e-3, 0.0, 0.0, 0.0, 0.0),
    }
)
#: uncertainty of the reference: in 95 % of random scenes it is below ``factor * phase**growth``
REFERENCE_UNCERTAINTY = (3e-15, 1.33)
#: error that 95 % of random single-pulse chains stay below (masses and stiffnesses at random within one and a half
#: decades); the median is a fifth of it, and steadily graded chains err less. For other observables theories are far
#: off
THEORY_ERROR: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "bca": {"arrival_at_end": 0.07, "crossing_time": 0.2, "arrival": 0.2},
        "adiabatic": {"arrival_at_end": 0.2, "crossing_time": 0.26, "arrival": 0.26},
    }
)


@dataclass(frozen=True, kw_only=True)
class Outlook:
    """Input of all predictions: a scene, its prescan and its samples."""

    scene: Scene
    prescan: Prescan
    sampling: Sampling

    @classmethod
    def of(cls, scene: Scene, sampling: Sampling) -> Outlook:
        """Run the prescan of a scene. Raises RunBroken where that would take too long."""
        return cls(scene=scene, prescan=prescan_scene(scene), sampling=sampling)

    @property
    def phase(self) -> float:
        """Integral over time of the frequency of the stiffest contact of each moment, rad; at least 1."""
        if self.scene.law is not None:
            return max(1.0, self.prescan.frequency * self.scene.duration)
        return max(1.0, self.prescan.steps * (0.1 * _PHASE if self.scene.damped else _PHASE))

    def schedule(self, dt: float) -> Schedule:
        """Return the steps of a run with this ``dt`` (s)."""
        return fixed_step_plan(self.scene, Resolution(dt=dt), self.sampling, self.prescan)

    def _scale(self, law: ErrorLaw, observable: str) -> float:
        """Return the predicted error at a knob of 1."""
        factor, growth = OBSERVED.get(OBSERVED_AS.get(observable, observable), OBSERVED["velocity"])
        return float(factor * law.factor * self.phase ** (law.growth + growth))

    def error(self, law: ErrorLaw, setting: float, observable: str) -> float:
        """Predict the relative error at a setting: dt (s), where round-off of all steps is added, or rtol."""
        scale = self._scale(law, observable)
        if law is OF_RTOL:
            return float(scale * setting**law.order)
        digits = EPS * math.sqrt(self.scene.duration / setting)
        return float(scale * (self.prescan.frequency * setting) ** law.order) + digits

    def setting(self, law: ErrorLaw, error: float, observable: str) -> float:
        """Return the setting with this predicted error; inf where no bodies touch."""
        knob: float = (error / self._scale(law, observable)) ** (1.0 / law.order)
        if law is OF_RTOL:
            return knob
        return knob / self.prescan.frequency if self.prescan.frequency > 0.0 else math.inf

    def cost(self, name: str, setting: float = math.nan) -> float:
        """Predict the CPU time of a run without its uncertainty, s."""
        bodies = self.scene.n_body
        if name in ADAPTIVE:
            once, factor, a, b, c = ADAPTIVE[name]
            coarse = self.prescan.steps * (0.1 if self.scene.damped else 1.0)
            finer = (setting / 1e-6) ** c if c != 0.0 else 1.0
            return float(once + factor * bodies**a * coarse**b * finer)
        kernel = FAST if FUSED.covers(self.scene) else PLAIN
        once, row, row_body, evaluation, evaluation_body = COST.get(name, COST[kernel])
        interval = self.scene.duration / self.sampling.count
        steps = self.sampling.count * max(1.0, interval / setting)
        rows = min(steps, self.sampling.count * max(1.0, interval * self.prescan.frequency / PHASE_PER_DENSE_SAMPLE))
        evaluations = steps * EVALUATIONS.get(name, 1)
        return once + rows * (row + row_body * bodies) + evaluations * (evaluation + evaluation_body * bodies)

    def known_error(self, name: str, observable: str) -> float:
        """Return the relative error of a backend that has no setting; inf where none is known."""
        factor, growth = REFERENCE_UNCERTAINTY
        if name == "reference":
            return float(factor * self.phase**growth) + EPS
        return THEORY_ERROR[name].get(observable, math.inf)

    def units(self, dt: float) -> dict[str, float]:
        """Return ``dt`` (s) as a fraction of the usual time scales of DEM, as far as the scene has them."""
        fractions = {}
        if (rayleigh := rayleigh_time_of(self.scene)) is not None:
            fractions["rayleigh_time"] = dt / rayleigh
        if (contact := contact_time_of(self.scene)) is not None:
            fractions["contact_time"] = dt / contact
        if self.prescan.frequency > 0.0:
            fractions["2/omega"] = dt * self.prescan.frequency / 2.0
        return fractions


def tidy(low: float, high: float) -> float:
    """Return the number with the fewest digits from ``low`` up to but excluding ``high``; of several, the largest.

    >>> tidy(1.1236e-8, 1.1364e-8), tidy(9.96e-7, 1.04e-6)
    (1.13e-08, 1e-06)
    """
    if not 0.0 < low < high:
        raise UsageError(f"low = {low!r}, high = {high!r}; allowed: 0 < low < high")
    if math.isinf(high):
        return low
    for digits in range(17):
        # downwards from high: the first candidate below it
        unit = 10.0 ** (math.floor(math.log10(high)) - digits)
        nearest = math.floor(high / unit)
        for count in (nearest, nearest - 1):
            value = float(f"{count * unit:.{digits}e}") if count > 0 else 0.0
            if low <= value < high:
                return value
    return low
