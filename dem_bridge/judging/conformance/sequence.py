"""The comparison of all scenes one after the other: a fault that one shows is part of the reference of those after it.

Two faults may explain a simple scene alike, such as another mass and unequal forces in a pair. The next scene that only
one of them explains decides between them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from dem_bridge.judging.conformance.behaviour import LARGEST_UNCERTAINTY, Behaviour
from dem_bridge.judging.conformance.explain import Explanation, Failure, explain
from dem_bridge.judging.conformance.faults import Fault
from dem_bridge.judging.conformance.properties import LargeStep
from dem_bridge.judging.conformance.scenes import Probe

#: unseen scenes for which a fault is looked for: the first ones name it
MOST_SEARCHES = 3


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


class Comparison:
    """The explanations of the scenes that were compared so far, and the faults that they show."""

    def __init__(self, evidence: Evidence) -> None:
        self.evidence = evidence
        self.explanations: dict[str, Explanation] = {}
        """By the name of the scene."""
        self.failures: list[Failure] = []
        #: a simpler scene has shown that units and the like are right; none explains the scenes that follow
        self._decided, self._lost, self._searches = False, False, 0
        for probe in evidence.probes:
            if (behaviour := evidence.behaviours.get(probe.scene.name)) is not None:
                self._compare(probe, behaviour)
        self._take_back_masses()

    def _compare(self, probe: Probe, behaviour: Behaviour) -> None:
        """Compare one scene."""
        name = probe.scene.name
        certain = behaviour.uncertainty <= LARGEST_UNCERTAINTY
        search = certain and self._searches < MOST_SEARCHES and (not self._lost or probe.basic)
        found = explain(behaviour, self.failures, search=False)
        if not found.right and certain:
            found = self._decided_between(behaviour) or explain(
                behaviour, self.failures, first=not self._decided, search=search
            )
        self.explanations[name] = found
        self._searches += not probe.frozen and not found.right
        if found.right:
            # the fault explains another scene, too
            used = [failure.item for failure in self.failures if failure.item in found.apart]
            self.failures = [
                replace(failure, alternatives=()) if failure.item in used else failure for failure in self.failures
            ]
        elif certain and (found.fault is None or not found.fault.definite):
            # where a simple scene is wrong and nothing explains it, nothing explains those after it
            self._lost = True
        if found.fault is not None:
            item = self._item_of(probe, found.fault)
            self.failures.append(Failure(name, item, found.fault, found.left, found.alternatives))
        self._decided = self._decided or certain

    def _decided_between(self, behaviour: Behaviour) -> Explanation | None:
        """Return the comparison with one of the faults that explain an earlier scene alike; None if none is right."""
        for nth, failure in enumerate(self.failures):
            for fault in failure.alternatives:
                item = fault.item if failure.item == failure.fault.item else failure.item
                other = replace(failure, fault=fault, item=item, alternatives=())
                failures = [*self.failures[:nth], other, *self.failures[nth + 1 :]]
                if (found := explain(behaviour, failures, search=False)).right:
                    self.failures = failures
                    self.explanations[failure.scene] = replace(self.explanations[failure.scene], fault=fault)
                    return found
        return None

    def _item_of(self, probe: Probe, fault: Fault) -> str:
        """Return the item that a fault fails.

        The first scene decides about the law and the output; a later one only about what it adds.
        """
        item = probe.question if self._decided else fault.item
        if fault.of_body:
            # the same body or contact of another scene: an item is to be named once
            same = (other for other in self.failures if other.fault.of_body and other.fault.cause == fault.cause)
            item = next((failure.item for failure in same), item)
        if item == "unseen" and fault.item == "restitution" and not self._has_frozen_law(probe):
            return "restitution"
        return item

    def _has_frozen_law(self, probe: Probe) -> bool:
        """Return True if a frozen scene has the damping law of an unseen one."""
        damped = [other.scene.damping for other in self.evidence.probes if other.frozen]
        laws = {damping.law for damping in damped if damping is not None}
        return probe.scene.damping is not None and probe.scene.damping.law in laws

    def _take_back_masses(self) -> None:
        """Take back the mass of a body in a simple scene if another one is wrong and no fault explains it.

        Forces of a contact that are not opposite look like another mass in a pair, but not in a chain.
        """
        simple = [probe.scene.name for probe in self.evidence.probes if probe.basic]
        found = [self.explanations[name] for name in simple if name in self.explanations]
        if all(explanation.right or explanation.fault is not None for explanation in found):
            return
        for failure in [f for f in self.failures if f.scene in simple and f.fault.cause == "mass"]:
            self.explanations[failure.scene] = replace(self.explanations[failure.scene], fault=None)
            self.failures.remove(failure)


def apart_words(items: Sequence[str]) -> str:
    """Return the words for the faults of other items that were part of the reference of a scene."""
    return f", apart from the fault of the item {' and '.join(items)}" if items else ""
