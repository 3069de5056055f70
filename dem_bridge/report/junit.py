"""Write verdicts and regressions as JUnit XML for continuous integration."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple
from xml.etree import ElementTree

from dem_bridge.regression.compare import Change, Comparison
from dem_bridge.verification.verdict import Outcome, Verdict

#: JUnit element of each outcome; outcomes without an element pass
_ELEMENT = {
    Outcome.FAIL: "failure",
    Outcome.UNDECIDED: "failure",
    Outcome.BROKEN: "error",
    Outcome.NOT_RUN: "skipped",
    Outcome.MODEL_DIFFERENCE: "skipped",
}
_ELEMENT_OF_CHANGE = {
    Change.CHANGED: "failure",
    Change.GONE: "failure",
    Change.BROKEN: "error",
    Change.NOT_RUN: "skipped",
    Change.NEW: "skipped",
}


class _Case(NamedTuple):
    """Hold a test case."""

    group: str
    name: str
    element: str | None
    """Element of a case that does not pass; None for a pass."""
    outcome: str
    sentence: str


def junit(verdicts: Sequence[Verdict]) -> str:
    """Return JUnit XML with a test case per verdict."""
    return _xml(
        [
            _Case(
                verdict.scene,
                f"{verdict.quantity}: {verdict.backend} against {verdict.reference}",
                _ELEMENT.get(verdict.outcome),
                verdict.outcome.value,
                verdict.sentence,
            )
            for verdict in verdicts
        ]
    )


def regression_junit(comparisons: Sequence[Comparison]) -> str:
    """Return JUnit XML with a test case per comparison with a baseline."""
    return _xml(
        [
            _Case(
                comparison.scene,
                f"{comparison.backend}: same as its baseline",
                _ELEMENT_OF_CHANGE.get(comparison.change),
                comparison.change.value,
                "; ".join([comparison.sentence, *comparison.notes]),
            )
            for comparison in comparisons
        ]
    )


def _xml(cases: Sequence[_Case]) -> str:
    """Return the JUnit XML of test cases."""
    elements = [case.element for case in cases]
    suite = ElementTree.Element(
        "testsuite",
        name="dem_bridge",
        tests=str(len(cases)),
        failures=str(elements.count("failure")),
        errors=str(elements.count("error")),
        skipped=str(elements.count("skipped")),
    )
    for case in cases:
        node = ElementTree.SubElement(suite, "testcase", classname=case.group, name=case.name)
        if case.element is not None:
            ElementTree.SubElement(node, case.element, message=f"{case.outcome}: {case.sentence}")
        else:
            ElementTree.SubElement(node, "system-out").text = case.sentence
    return ElementTree.tostring(suite, encoding="unicode", xml_declaration=True) + "\n"
