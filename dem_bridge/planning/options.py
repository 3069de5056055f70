"""The backends that may answer a question of accuracy, each with what is predicted of it: nothing is run here."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from dem_bridge.backends.base import BACKENDS, ENGINE_BACKENDS, Backend, Sampling, backend
from dem_bridge.backends.reference import series_fit
from dem_bridge.backends.scipy_dop853 import LARGEST_RTOL
from dem_bridge.backends.steps import order_on
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.planning.check import LEAST_RTOL, OBSERVABLES, Candidate, Trial
from dem_bridge.planning.predict import OF_RTOL, OF_STEP, ErrorLaw, Outlook
from dem_bridge.scene import Scene

#: fixed-step runs longer than this are not planned
MOST_STEPS = 50_000_000
#: other equations, which come near in times alone
THEORIES = ("bca", "adiabatic")
TIMES = ("arrival", "residence", "crossing_time")


@dataclass(frozen=True, kw_only=True)
class Option:
    """A candidate with what is known of it: first predicted, then found."""

    candidate: Candidate
    law: ErrorLaw | None
    """None: it has no setting that decides its error."""
    setting: float
    error: float
    cost: float
    """CPU, s."""
    trial: Trial | None = None
    """The run that was found to serve."""
    told: str = ""
    """How the error was found."""


class Options:
    """What there is for one question, from the cheapest on, as predicted; and what there is not."""

    def __init__(self, scene: Scene, accuracy: float, name: str | None, observable: str, sampling: Sampling) -> None:
        if observable not in OBSERVABLES:
            raise UsageError(f"observable = {observable!r}; allowed: {', '.join(OBSERVABLES)}")
        self.scene, self.accuracy, self.name, self.observable = scene, accuracy, name, observable
        self.interval = scene.duration / sampling.count
        self.left_out: dict[str, str] = {}
        candidates = list(self._candidates())
        self.outlook = Outlook.of(scene, sampling)
        self.found = sorted(map(self._predicted, candidates), key=lambda one: one.cost)

    def _candidates(self) -> Iterator[Candidate]:
        for name in BACKENDS if self.name is None else (self.name,):
            chosen = backend(name)
            if (reason := self._unwanted(name) or chosen.refusal(self.scene)) is None:
                yield self._candidate(chosen)
            elif self.name is None:
                self.left_out[name] = reason
            else:
                raise UnsupportedScene(f"{name} cannot do {self.scene.name}: {reason}")

    def _unwanted(self, name: str) -> str | None:
        """Why a backend is not among those to choose from; None: it is."""
        if name == "ode45":
            return "its tolerances say little of its error; take rtol from a convergence study, or another backend"
        if self.name is not None:
            return None
        if name in (*ENGINE_BACKENDS, "ase"):
            return "the twin repeats it, and costs less"
        if name in THEORIES and self.observable not in TIMES:
            return f"its equations are others, and come near in times alone, not in {self.observable}"
        if name == "reference" and not series_fit(self.scene):
            return "its series do not fit, and it would answer through scipy at the least tolerance"
        return None

    def _candidate(self, chosen: Backend) -> Candidate:
        name = chosen.name
        if chosen.order is not None:
            order = order_on(self.scene) if chosen.order == 2 else chosen.order
            runs = "verlet" if name in (*ENGINE_BACKENDS, "ase") else name
            return Candidate(name=name, runs=runs, knob="dt", order=OF_STEP[order].order, kind=order)
        if name == "scipy":
            return Candidate(name=name, runs=name, knob="rtol", order=OF_RTOL.order)
        return Candidate(name=name, runs=name, knob="", order=0.0)

    def _predicted(self, candidate: Candidate) -> Option:
        name, knob = candidate.name, candidate.knob
        if knob == "":
            error = self.outlook.known_error(name, self.observable)
            return Option(candidate=candidate, law=None, setting=0.0, error=error, cost=self.outlook.cost(name))
        law = OF_STEP[candidate.kind] if knob == "dt" else OF_RTOL
        return self._at(candidate, law, self.outlook.setting(law, self.accuracy, self.observable))

    def _at(self, candidate: Candidate, law: ErrorLaw, setting: float) -> Option:
        """What is predicted of a setting, or of the nearest that can be."""
        setting = min(max(setting, self.least(candidate)), self.most(candidate))
        return Option(
            candidate=candidate,
            law=law,
            setting=setting,
            error=self.outlook.error(law, setting, self.observable),
            cost=self.outlook.cost(candidate.name, setting),
        )

    def least(self, candidate: Candidate) -> float:
        """The finest setting that is looked at."""
        return self.scene.duration / MOST_STEPS if candidate.knob == "dt" else LEAST_RTOL

    def most(self, candidate: Candidate) -> float:
        """The coarsest there is."""
        return self.interval if candidate.knob == "dt" else LARGEST_RTOL

    def foreseen(self) -> Option:
        """The cheapest as predicted, with settings that nine of ten scenes need no finer."""
        found: list[Option] = []
        for one in self.found:
            if (law := one.law) is not None:
                setting = self.outlook.setting(law, self.accuracy / law.spread, self.observable)
                careful = self._at(one.candidate, law, setting)
                if careful.error * law.spread <= 1.01 * self.accuracy:  # last digits are above the law
                    found.append(careful)
            elif one.error <= self.accuracy:
                found.append(one)
        if not found:
            least = min(one.error for one in self.found)
            raise UsageError(
                f"accuracy = {self.accuracy:g} on {self.scene.name} is not to be expected of"
                f" {self.name or 'any backend'}: the least error predicted is {least:.2g}; ask for less"
            )
        return min(found, key=lambda one: one.cost)
