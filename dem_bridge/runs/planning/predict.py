"""Predictions of error and cost of a run, from the prescan of its scene and from fitted laws of a few numbers each.

The prescan (:mod:`dem_bridge.backends.prescan`) gives omega, the highest frequency of a contact, and the phase: the
integral over time of the frequency of the stiffest contact of each moment. The error of a method of order p with a
fixed step is predicted as ``C phase^b (omega dt)^p``, because each local error is proportional to (omega dt)^p and a
longer run adds up more of them. C and b (``laws.json``) are fits to 186 random scenes (tests/helpers/random_plans.py;
the benchmark of the planner uses other scenes). A prediction is an order of magnitude, which runs then check.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
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


_FITS = json.loads(Path(__file__).with_name("laws.json").read_text(encoding="utf-8"))
#: by the order of the method
OF_STEP: Mapping[int, ErrorLaw] = MappingProxyType({int(p): ErrorLaw(**fit) for p, fit in _FITS["of_step"].items()})
#: by the backend
OF_RTOL: Mapping[str, ErrorLaw] = MappingProxyType({name: ErrorLaw(**fit) for name, fit in _FITS["of_rtol"].items()})


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
        observed = _FITS["observed"]
        names = (observable, observable_named(observable).follows, "velocity")
        factor, growth = next(observed[name] for name in names if name in observed)
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
            bound = _FITS["reference_uncertainty"]
            return float(bound["factor"] * self.phase ** bound["growth"]) + EPS
        return float(_FITS["theory_error"][name].get(observable, math.inf))

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
