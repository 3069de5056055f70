"""Predictions of error and cost of a run, from the prescan of its scene and from fitted laws of a few numbers each.

The prescan (:mod:`dem_bridge.backends.prescan`) gives omega, the highest frequency of a contact, and the phase: the
integral over time of the frequency of the stiffest contact of each moment. The error of a method of order p with a
fixed step is predicted as ``C phase^b (omega dt)^p``, because each local error is proportional to (omega dt)^p and a
longer run adds up more of them. C and b are fits to 186 random scenes (tests/helpers/random_plans.py;
the benchmark of the planner uses other scenes). A prediction is an order of magnitude, which runs then check.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.prescan import Prescan
from dem_bridge.backends.steps import fixed_step_plan
from dem_bridge.errors import UsageError
from dem_bridge.observables.registry import observable_named
from dem_bridge.runs.costs import predicted_cost
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.timescales import contact_time_of, rayleigh_time_of
from dem_bridge.trajectory.dense import PHASE_PER_DENSE_SAMPLE, Schedule

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


#: Velocity error of random scenes, by the order of the method: median factor phase**growth knob**order of the largest
#: velocity; in at least four of five random scenes the error is at most spread times that. The knob is omega dt.
#: Where contacts open and close, order 4 is reduced to about 2.5.
OF_STEP: Mapping[int, ErrorLaw] = MappingProxyType(
    {
        1: ErrorLaw(order=1.0, factor=0.013, growth=0.2, spread=40.0),
        2: ErrorLaw(order=2.0, factor=0.01, growth=0.75, spread=10.0),
        4: ErrorLaw(order=2.5, factor=0.00025, growth=0.55, spread=30.0),
    }
)
#: The same by the backend; the knob is rtol. For ode45, whose atol goes with rtol, it is a fit to 23 random scenes.
OF_RTOL: Mapping[str, ErrorLaw] = MappingProxyType(
    {
        "scipy": ErrorLaw(order=0.83, factor=0.02, growth=0.68, spread=40.0),
        "ode45": ErrorLaw(order=0.86, factor=0.053, growth=1.1, spread=10.0),
    }
)
#: Error of each observable over the velocity error, for orders 1 and 2: factor and growth of factor * phase**growth.
#: Others err as the observable that they follow, or else as velocities.
_OBSERVED: Mapping[str, tuple[float, float]] = {
    "velocity": (1.0, 0.0),
    "displacement": (0.45, -0.13),
    "contact_force": (2.5, -0.17),
    "peak_force": (5.0, -0.69),
    "crossing_time": (3.7, -0.81),
    "arrival_at_end": (6.6, -1.27),
    "residence_time": (2.0, -0.61),
}
#: Uncertainty of the reference: in 95 % of random scenes it is below factor * phase**growth.
_REFERENCE_FACTOR, _REFERENCE_GROWTH = 3e-15, 1.33
#: Error that 95 % of random single-pulse chains stay below (masses and stiffnesses at random within one and a half
#: decades); the median is a fifth of it, and steadily graded chains err less. For other observables theories are far
#: off.
_THEORY_ERROR: Mapping[str, Mapping[str, float]] = {
    "bca": {"arrival_at_end": 0.07, "crossing_time": 0.2, "arrival": 0.2},
    "adiabatic": {"arrival_at_end": 0.2, "crossing_time": 0.26, "arrival": 0.26},
}


@dataclass(frozen=True, kw_only=True)
class Outlook:
    """Input of all predictions: a scene, its prescan and its samples."""

    scene: Scene
    prescan: Prescan
    sampling: Sampling

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
        names = (observable, observable_named(observable).follows, "velocity")
        factor, growth = next(_OBSERVED[name] for name in names if name in _OBSERVED)
        return float(factor * law.factor * self.phase ** (law.growth + growth))

    def error(self, law: ErrorLaw, setting: float, observable: str) -> float:
        """Predict the relative error at a setting: dt (s), where round-off of all steps is added, or rtol."""
        scale = self._scale(law, observable)
        if law in OF_RTOL.values():
            return float(scale * setting**law.order)
        digits = EPS * math.sqrt(self.scene.duration / setting)
        return float(scale * (self.prescan.frequency * setting) ** law.order) + digits

    def setting(self, law: ErrorLaw, error: float, observable: str) -> float:
        """Return the setting with this predicted error; inf where no bodies touch."""
        knob: float = (error / self._scale(law, observable)) ** (1.0 / law.order)
        if law in OF_RTOL.values():
            return knob
        return knob / self.prescan.frequency if self.prescan.frequency > 0.0 else math.inf

    def cost(self, name: str, setting: float = math.nan) -> float:
        """Predict the CPU time of a run without its uncertainty, s."""
        interval = self.scene.duration / self.sampling.count
        steps = self.sampling.count * (max(1.0, interval / setting) if setting > 0.0 else 1.0)  # 0: not a fixed step
        resolving = interval * self.prescan.frequency / PHASE_PER_DENSE_SAMPLE
        return predicted_cost(
            name,
            self.scene,
            steps=steps,
            samples=min(steps, self.sampling.count * max(1.0, resolving)),
            coarse=self.prescan.steps * (0.1 if self.scene.damped else 1.0),
            rtol=setting,
        )

    def known_error(self, name: str, observable: str) -> float:
        """Return the relative error of a backend that has no setting; inf where none is known."""
        if name == "reference":
            return float(_REFERENCE_FACTOR * self.phase**_REFERENCE_GROWTH) + EPS
        return _THEORY_ERROR[name].get(observable, math.inf)

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
            value = float(f"{count * unit:.{digits}e}")
            if low <= value < high:
                return value
    return low
