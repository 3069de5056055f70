"""Candidates for an accuracy: the backends that solve a scene, with predicted settings, errors and costs.

Nothing is run here but the prescan of the scene.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from dem_bridge.backends.base import BACKENDS, ENGINE_BACKENDS, Backend, Sampling, backend, unsupported_reason
from dem_bridge.backends.ode45 import DEFAULT_RTOL, state_scales
from dem_bridge.backends.reference import SERIES
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.backends.scipy_dop853 import LARGEST_RTOL
from dem_bridge.backends.steps import order_on
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.observables.registry import observable_named
from dem_bridge.runs.planning.predict import OF_RTOL, OF_STEP, ErrorLaw, Outlook
from dem_bridge.runs.planning.trials import LEAST_RTOL, Candidate, Settled, Trial
from dem_bridge.scene.scene import Scene

#: largest number of steps of a planned fixed-step run
MOST_STEPS = 50_000_000
#: backends with other equations, which approximate times alone
THEORIES = ("bca", "adiabatic")


@dataclass(frozen=True, kw_only=True)
class Option:
    """A candidate with its setting, error and cost: first predicted, then measured."""

    candidate: Candidate
    law: ErrorLaw | None
    """None: no setting of the backend decides its error."""
    setting: float
    error: float
    cost: float
    """CPU, s."""
    settled: Settled | None = None
    """The runs that were made, of which the best has the error; None: nothing was run."""
    confirmed: bool = False
    """Whether the finer settings, too, have errors within the accuracy."""
    evidence: str = ""
    """How the error was measured, for the reasons of a plan."""

    @property
    def trial(self) -> Trial | None:
        """The run whose error is within the accuracy; None: nothing was run."""
        return None if self.settled is None else self.settled.best


class Options:
    """All candidates for one accuracy, the cheapest by prediction first, and the backends that are left out."""

    def __init__(
        self,
        scene: Scene,
        accuracy: float,
        name: str | None,
        observable: str,
        sampling: Sampling,
        left_out: Mapping[str, str],
    ) -> None:
        self.unit = observable_named(observable).unit
        self.scene, self.accuracy, self.name, self.observable = scene, accuracy, name, observable
        self.interval = scene.duration / sampling.count
        self.left_out = dict(left_out)
        candidates = list(self._candidates())
        self.outlook = Outlook(scene=scene, prescan=prescan_scene(scene), sampling=sampling)
        self.predicted = sorted(map(self._predicted, candidates), key=lambda option: option.cost)

    def _candidates(self) -> Iterator[Candidate]:
        for name in BACKENDS if self.name is None else (self.name,):
            chosen = backend(name)
            if (reason := self._left_out_reason(name) or unsupported_reason(chosen, self.scene)) is None:
                yield self._candidate(chosen)
            elif self.name is None:
                self.left_out[name] = reason
            else:
                raise UnsupportedScene(f"{name} cannot do {self.scene.name}: {reason}")

    def _left_out_reason(self, name: str) -> str | None:
        """Return the reason why a backend that could solve the scene is no candidate; None: it is one."""
        if name in self.left_out:
            return self.left_out[name]
        if self.name is not None:
            return None
        if name in (*ENGINE_BACKENDS, "ase"):
            return "the twin gives the same numbers at lower cost"
        if name in THEORIES and self.unit != "s":
            return f"it solves other equations, which approximate times alone, not {self.observable}"
        if name == "reference" and not SERIES.covers(self.scene):
            return "its Taylor series do not fit the scene, so it would answer by scipy at the smallest tolerance"
        return None

    def _candidate(self, chosen: Backend) -> Candidate:
        name = chosen.name
        if chosen.order is not None:
            order = order_on(self.scene) if chosen.order == 2 else chosen.order
            runs = "verlet" if name in (*ENGINE_BACKENDS, "ase") else name
            return Candidate(name=name, runs=runs, knob="dt", order=OF_STEP[order].order, kind=order)
        if name in OF_RTOL:
            atol = float(f"{np.min(state_scales(self.scene)):.0e}") if name == "ode45" else 0.0
            return Candidate(name=name, runs=name, knob="rtol", order=OF_RTOL[name].order, atol=atol)
        return Candidate(name=name, runs=name, knob="", order=0.0)

    def _predicted(self, candidate: Candidate) -> Option:
        name, knob = candidate.name, candidate.knob
        if knob == "":
            error = self.outlook.known_error(name, self.observable)
            return Option(candidate=candidate, law=None, setting=0.0, error=error, cost=self.outlook.cost(name))
        law = OF_STEP[candidate.kind] if knob == "dt" else OF_RTOL[name]
        return self._at(candidate, law, self.outlook.setting(law, self.accuracy, self.observable))

    def _at(self, candidate: Candidate, law: ErrorLaw, setting: float) -> Option:
        """Return the predictions for a setting, or for the nearest setting in the range."""
        setting = min(max(setting, self.least(candidate)), self.most(candidate))
        return Option(
            candidate=candidate,
            law=law,
            setting=setting,
            error=self.outlook.error(law, setting, self.observable),
            cost=self.outlook.cost(candidate.name, setting),
        )

    def least(self, candidate: Candidate) -> float:
        """Return the finest setting that is tried."""
        return self.scene.duration / MOST_STEPS if candidate.knob == "dt" else LEAST_RTOL

    def most(self, candidate: Candidate) -> float:
        """Return the coarsest setting."""
        if candidate.knob == "dt":
            return self.interval
        return LARGEST_RTOL if candidate.name == "scipy" else DEFAULT_RTOL

    def foreseen(self) -> Option:
        """Return the cheapest option by prediction alone, with a margin that suffices in nine of ten scenes."""
        options: list[Option] = []
        for option in self.predicted:
            if (law := option.law) is not None:
                setting = self.outlook.setting(law, self.accuracy / law.spread, self.observable)
                careful = self._at(option.candidate, law, setting)
                if careful.error * law.spread <= 1.01 * self.accuracy:  # round-off is added to the law
                    options.append(careful)
            elif option.error <= self.accuracy:
                options.append(option)
        if not options:
            least = min(option.error for option in self.predicted)
            raise UsageError(
                f"accuracy = {self.accuracy:g} on {self.scene.name} is not expected to be reached by"
                f" {self.name or 'any backend'}: the smallest predicted error is {least:.2g}; ask for less"
            )
        return min(options, key=lambda option: option.cost)
