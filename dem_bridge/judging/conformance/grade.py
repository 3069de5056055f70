"""The grade of a code: what it does in each scene becomes one item a question.

The first scene that can be run decides about the law and about what is written, and every other one about what it adds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from dem_bridge.foundation.wording import relative_number
from dem_bridge.judging.conformance.behaviour import LARGEST_UNCERTAINTY
from dem_bridge.judging.conformance.explain import Explanation, Failure, fitted_exponent
from dem_bridge.judging.conformance.items import QUESTIONS, Item, failed_item, failure_item, not_run_item, passed_item
from dem_bridge.judging.conformance.properties import property_items
from dem_bridge.judging.conformance.scenes import FEATURES, Probe, frozen_probes
from dem_bridge.judging.conformance.sequence import Comparison, Evidence, apart_words
from dem_bridge.judging.conformance.unseen import unseen_item
from dem_bridge.observables.verdict import Outcome

#: items whose faults have effects in every scene that are not known
_HIDING = ("order", "momentum", "energy", "digits", "phase")


def grade(evidence: Evidence, features: Sequence[str]) -> tuple[Item, ...]:
    """Return all items in the order of the score card.

    Parameters
    ----------
    evidence : Evidence
        What the code does.
    features : sequence of str
        Features that the code has; scenes with others were not run.
    """
    comparison = Comparison(evidence)
    explanations, failures = comparison.explanations, comparison.failures
    found = property_items(evidence.behaviours, explanations, failures, evidence.large_steps)
    properties = {item.name: item for item in found}
    hiding = next((name for name in _HIDING if properties[name].outcome is Outcome.FAIL), "")
    answers = _Answers(evidence, explanations, failures, hiding)
    items: list[Item] = []
    for name in QUESTIONS:
        if name in properties:
            items.append(properties[name])
        elif name == "exponent":
            items.append(answers.exponent(features))
        elif name == "unseen":
            names = [probe.scene.name for probe in evidence.probes if not probe.frozen]
            wrong = answers.wrong_frozen() or hiding
            items.append(unseen_item(names, evidence.behaviours, evidence.problems, explanations, failures, wrong))
        else:
            items += answers.frozen(name, features)
    return tuple(items)


@dataclass(frozen=True, eq=False)
class _Answers:
    """The items of frozen scenes."""

    evidence: Evidence
    explanations: Mapping[str, Explanation]
    failures: Sequence[Failure]
    hiding: str
    """Item of a fault that hides others, because nothing is known of its effect; '' if there is none."""

    def frozen(self, name: str, features: Sequence[str]) -> list[Item]:
        """Return the items of the frozen scenes of a question."""
        probes = [probe for probe in frozen_probes() if probe.question == name]
        asked = [probe for probe in probes if probe.features <= {*features}]
        items = [self._scene(probe) for probe in asked]
        names = [probe.scene.name for probe in asked]
        others = [failure for failure in self.failures if failure.item == name and failure.scene not in names]
        if others and not any(item.outcome is Outcome.FAIL for item in items):
            items = [failed_item(name, others[0].scene, others[0].fault.sentence, others[0].fault.cause), *items[1:]]
        elif not items:
            lacking = {feature for probe in probes for feature in probe.features - {*features}}
            missing = " or ".join(feature for feature in FEATURES if feature in lacking)
            items = [not_run_item(name, f"the code does not declare {missing}")]
        return items

    def exponent(self, features: Sequence[str]) -> Item:
        """Return the item on the exponent of Hertz contacts, which the scene of the law decides."""
        (probe,) = (probe for probe in frozen_probes() if probe.question == "law")
        name, scene = "exponent", probe.scene.name
        if failed := failure_item(name, self.failures):
            return failed
        item = self._scene(probe) if probe.features <= {*features} else None
        if item is None or item.outcome is Outcome.BROKEN:
            reason = "the code does not declare hertz" if item is None else f"the scene {scene} has no files"
            return not_run_item(name, reason)
        own = [failure.fault for failure in self.failures if failure.scene == scene]
        if item.outcome is Outcome.FAIL and not own:
            sentence = "The difference from the law is not explained, so that its exponent cannot be told."
            return replace(item, name=name, outcome=Outcome.UNDECIDED, sentence=sentence)
        if item.outcome in (Outcome.UNDECIDED, Outcome.NOT_RUN):
            return replace(item, name=name)
        if (n := fitted_exponent(self.evidence.behaviours[scene], own)) is None:
            sentence = "The motion does not depend on the exponent."
            return replace(item, name=name, outcome=Outcome.UNDECIDED, sentence=sentence)
        return passed_item(name, scene, f"The force goes as overlap^{n - 1.0:.6f}; Hertz: 1.5.", {"exponent": n})

    def _scene(self, probe: Probe) -> Item:
        """Return the item that one frozen scene decides."""
        name, scene = probe.question, probe.scene.name
        item = Item(name=name, scene=scene, outcome=Outcome.NOT_RUN, sentence="Not run: scenes before it did not end.")
        if (found := self.explanations.get(scene)) is None:
            if (problem := self.evidence.problems.get(scene)) is None:
                return item
            return replace(item, outcome=Outcome.BROKEN, sentence=problem)
        item = replace(item, numbers={"difference": found.difference, "explained_by_steps": found.allowed})
        off, allowed = (f"{relative_number(value)} of the largest value" for value in (found.difference, found.allowed))
        own = [failure for failure in self.failures if failure.scene == scene]
        if failure := next((failure for failure in own if failure.item == name), None):
            return failed_item(name, scene, failure.fault.sentence, failure.fault.cause, item.numbers)
        if self.evidence.behaviours[scene].uncertainty > LARGEST_UNCERTAINTY:
            sentence = f"The files at the three steps differ too much for an answer: by {allowed}."
            return replace(item, outcome=Outcome.UNDECIDED, sentence=sentence, cause="unknown")
        if found.right:
            sentence = f"{off} off{apart_words(found.apart)} (steps explain {relative_number(found.allowed)})."
            return replace(item, outcome=Outcome.PASS, sentence=sentence)
        if own and own[0].fault.cause == "missed-contact" and probe.scene.n_contact == 1:
            sentence = f"The only contact does not act: this is the item {own[0].item}."
            return replace(item, outcome=Outcome.UNDECIDED, sentence=sentence)
        if own:
            left = relative_number(found.left)
            sentence = f"The fault of the item {own[0].item} explains the difference but for {left}."
            return replace(item, outcome=Outcome.PASS, sentence=sentence)
        if other := self.hiding or self._wrong_before(scene):
            sentence = f"It differs from the reference by {off}; the fault of the item {other} hides why."
            return replace(item, outcome=Outcome.UNDECIDED, sentence=sentence, cause="unknown")
        sentence = f"It differs from the reference by {off}; steps explain {allowed}, and no known fault the rest."
        return replace(item, outcome=Outcome.FAIL, sentence=sentence, cause="unknown")

    def _wrong_before(self, scene: str) -> str:
        """Return the item of the first of the simple scenes before ``scene`` that is wrong; '' if none is."""
        for probe in self.evidence.probes:
            if probe.scene.name == scene or not probe.basic:
                break
            if wrong := self._wrong(probe):
                return wrong
        return ""

    def wrong_frozen(self) -> str:
        """Return the item of the first frozen scene that is wrong or has no files; '' if none is."""
        return next((wrong for probe in self.evidence.probes if probe.frozen and (wrong := self._wrong(probe))), "")

    def _wrong(self, probe: Probe) -> str:
        """Return the item that a scene fails, or its question if it is wrong without a fault; '' if it is right."""
        found = self.explanations.get(probe.scene.name)
        if found is not None and found.right:
            return ""
        return next((failure.item for failure in self.failures if failure.scene == probe.scene.name), probe.question)
