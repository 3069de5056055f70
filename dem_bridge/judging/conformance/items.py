"""The items of a grade: one question each, with an outcome, a sentence with a number, and a cause."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from dem_bridge.judging.conformance.explain import Failure
from dem_bridge.observables.verdict import Outcome, plain

#: the questions, in the order of the score card
QUESTIONS: Mapping[str, str] = {
    "law": "has a Hertz contact the stiffness of the scene?",
    "exponent": "does its force go as overlap^1.5?",
    "contacts": "does every contact act, on both of its bodies?",
    "mixing": "has each body its mass, and each contact its stiffness?",
    "hooke": "are linear springs right?",
    "walls": "are walls rigid, at their places, and as stiff as they should be?",
    "gaps": "do bodies that are apart meet at the right time?",
    "gravity": "has gravity its size and direction?",
    "precompression": "does the chain start in equilibrium?",
    "several-moving": "do all bodies start with their velocities?",
    "restitution": "is the damping force that of its law?",
    "order": "do errors fall with the square of the time step, or faster?",
    "phase": "do velocities and positions belong to the times that are written?",
    "digits": "are enough digits computed and written?",
    "units": "are times and values in SI units, in order, with the right sign?",
    "momentum": "is momentum conserved?",
    "energy": "is energy conserved without damping?",
    "largest-step": "which step is stable, and which gives errors of 1e-2 and 1e-4?",
    "unseen": "are scenes right that nobody could prepare for?",
}


@dataclass(frozen=True, kw_only=True)
class Item:
    """The answer to one question."""

    name: str
    scene: str
    """Scene that decides; '' if several do."""
    outcome: Outcome
    sentence: str
    cause: str = "none"
    """Name of the fault; "none", or "unknown"."""
    numbers: Mapping[str, float] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """Return the fields; numbers that are not finite are null."""
        return {
            "name": self.name,
            "scene": self.scene,
            "outcome": self.outcome.value,
            "sentence": self.sentence,
            "cause": self.cause,
            "numbers": {key: plain(value) for key, value in self.numbers.items()},
        }


def failed_item(
    name: str, scene: str, sentence: str, cause: str = "unknown", numbers: Mapping[str, float] | None = None
) -> Item:
    """Return an item that a fault fails."""
    return Item(
        name=name, scene=scene, outcome=Outcome.FAIL, sentence=sentence, cause=cause, numbers=dict(numbers or {})
    )


def passed_item(name: str, scene: str, sentence: str, numbers: Mapping[str, float] | None = None) -> Item:
    """Return an item that passes."""
    return Item(name=name, scene=scene, outcome=Outcome.PASS, sentence=sentence, numbers=dict(numbers or {}))


def not_run_item(name: str, reason: str) -> Item:
    """Return an item that could not be asked."""
    return Item(name=name, scene="", outcome=Outcome.NOT_RUN, sentence=f"Not asked: {reason}.")


def failure_item(name: str, failures: Sequence[Failure]) -> Item | None:
    """Return the item that the fault of a scene fails; None if there is no such fault."""
    failure = next((failure for failure in failures if failure.item == name), None)
    if failure is None:
        return None
    return failed_item(name, failure.scene, failure.fault.sentence, failure.fault.cause)
