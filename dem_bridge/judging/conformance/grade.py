"""The grade of a code: what it does in each scene becomes one item a question, simple scenes first.

A fault that a scene shows is part of the reference of the scenes after it. So each item answers its own question: the
first scene that can be run decides about the law and about what is written, and every other scene about what it adds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from dem_bridge.foundation.wording import relative_number
from dem_bridge.judging.conformance.explain import (
    LARGEST_UNCERTAINTY,
    Behaviour,
    Explanation,
    Failure,
    explain,
    fitted_exponent,
)
from dem_bridge.judging.conformance.faults import Fault
from dem_bridge.judging.conformance.items import QUESTIONS, Item, failed_item, failure_item, not_run_item, passed_item
from dem_bridge.judging.conformance.properties import BASE, LargeStep, property_items
from dem_bridge.judging.conformance.scenes import FEATURES, Probe, frozen_probes
from dem_bridge.judging.conformance.unseen import unseen_item
from dem_bridge.observables.verdict import Outcome

#: unseen scenes for which a fault is looked for: the first ones name it
MOST_SEARCHES = 3
#: items whose faults have effects in every scene that are not known
_HIDING = ("order", "momentum", "energy", "digits")


@dataclass(frozen=True, eq=False)
class Evidence:
    """What a code does in each scene that it was run on, or why nothing is known of it."""

    probes: tuple[Probe, ...]
    behaviours: Mapping[str, Behaviour]
    """By the name of the scene."""
    problems: Mapping[str, str]
    """Why a scene has no behaviour, by its name."""
    large_steps: tuple[LargeStep, ...] = ()
    """From fine to coarse."""


def grade(evidence: Evidence, features: Sequence[str]) -> tuple[Item, ...]:
    """Return all items in the order of the score card.

    Parameters
    ----------
    evidence : Evidence
        What the code does.
    features : sequence of str
        Features that the code has; scenes with others were not run.
    """
    explanations, failures = _explained(evidence)
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
            apart = answers.apart(names[0]) if names else ""
            items.append(
                unseen_item(names, evidence.behaviours, evidence.problems, explanations, failures, wrong, apart)
            )
        else:
            items += answers.frozen(name, features)
    return tuple(items)


def _explained(evidence: Evidence) -> tuple[dict[str, Explanation], list[Failure]]:
    """Compare the scenes one after the other; a fault that one shows is known in those after it."""
    known: list[Fault] = []
    explanations: dict[str, Explanation] = {}
    failures: list[Failure] = []
    decided, lost, searches = False, False, 0
    for probe in evidence.probes:
        name = probe.scene.name
        if (behaviour := evidence.behaviours.get(name)) is None:
            continue
        certain = behaviour.uncertainty <= LARGEST_UNCERTAINTY
        search = certain and searches < MOST_SEARCHES and (not lost or probe.question in BASE)
        found = explanations[name] = explain(behaviour, known, first=not decided, search=search)
        searches += not probe.frozen and not found.right
        # where a simple scene is wrong and nothing explains it, nothing explains those after it
        lost = lost or (certain and not found.right and found.fault is None)
        if found.fault is not None:
            known.append(found.fault)
            # the first scene decides about the law and the output; a later one only about what it adds
            item = probe.question if decided else found.fault.item
            # the same body or contact of another scene: an item is to be named once
            same = (
                failure.item for failure in failures if failure.is_of_body and failure.fault.cause == found.fault.cause
            )
            item = item if found.fault.everywhere else next(same, item)
            if item == "unseen" and found.fault.item == "restitution" and not _has_frozen_law(evidence, probe):
                item = "restitution"
            failures.append(Failure(name, item, found.fault))
        decided = decided or certain
    return _without_masses(evidence, explanations, failures)


def _without_masses(
    evidence: Evidence, explanations: dict[str, Explanation], failures: list[Failure]
) -> tuple[dict[str, Explanation], list[Failure]]:
    """Take back the mass of a body in a simple scene if another one is wrong and no fault explains it.

    Forces on the two bodies of a contact that are not opposite look like another mass in a pair, but not in a chain.
    """
    simple = [probe.scene.name for probe in evidence.probes if probe.question in BASE]
    found = [name for name in simple if name in explanations]
    if all(explanations[name].right or explanations[name].fault is not None for name in found):
        return explanations, failures
    masses = [failure for failure in failures if failure.scene in simple and failure.fault.cause == "mass"]
    for failure in masses:
        explanations[failure.scene] = replace(explanations[failure.scene], fault=None)
    return explanations, [failure for failure in failures if failure not in masses]


def _has_frozen_law(evidence: Evidence, probe: Probe) -> bool:
    """Return True if a frozen scene has the damping law of an unseen one."""
    laws = {other.scene.damping.law for other in evidence.probes if other.frozen and other.scene.damping is not None}
    return probe.scene.damping is not None and probe.scene.damping.law in laws


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
        n = fitted_exponent(self.evidence.behaviours[scene], own)
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
            sentence = f"{off} off{self.apart(scene)} (steps explain {relative_number(found.allowed)})."
            return replace(item, outcome=Outcome.PASS, sentence=sentence)
        if own:
            left = relative_number(found.left)
            sentence = f"The fault of the item {own[0].item} explains the difference but for {left}."
            return replace(item, outcome=Outcome.PASS, sentence=sentence)
        if other := self.hiding or self._wrong_before(scene):
            sentence = f"It differs from the reference by {off}; the fault of the item {other} hides why."
            return replace(item, outcome=Outcome.UNDECIDED, sentence=sentence, cause="unknown")
        sentence = f"It differs from the reference by {off}; steps explain {allowed}, and no known fault the rest."
        return replace(item, outcome=Outcome.FAIL, sentence=sentence, cause="unknown")

    def apart(self, scene: str) -> str:
        """Return the words for faults of other items that were part of the reference of a scene."""
        names = [probe.scene.name for probe in self.evidence.probes]
        before = [f for f in self.failures if f.fault.everywhere and names.index(f.scene) < names.index(scene)]
        return f", apart from the fault of the item {before[0].item}" if before else ""

    def _wrong_before(self, scene: str) -> str:
        """Return the item of the first of the simple scenes before ``scene`` that is wrong; '' if none is."""
        for probe in self.evidence.probes:
            if probe.scene.name == scene or probe.question not in BASE:
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
