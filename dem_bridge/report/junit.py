"""Verdicts and regressions as JUnit XML, for the boards of continuous integration."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple
from xml.etree import ElementTree

from dem_bridge.regression.compare import Change, Comparison
from dem_bridge.verification.verdict import Outcome, Verdict

#: outcome -> element of JUnit; the others are passes
_ELEMENT = {
    Outcome.FAIL: "failure",
    Outcome.UNDECIDED: "failure",
    Outcome.BROKEN: "error",
    Outcome.NOT_RUN: "skipped",
    Outcome.MODEL_DIFFERENCE: "skipped",
}
_OF_CHANGE = {
    Change.CHANGED: "failure",
    Change.GONE: "failure",
    Change.BROKEN: "error",
    Change.NOT_RUN: "skipped",
    Change.NEW: "skipped",
}


class _Case(NamedTuple):
    group: str
    name: str
    element: str | None
    """None: it passed."""
    outcome: str
    sentence: str


def junit(verdicts: Sequence[Verdict]) -> str:
    """One test case a verdict; its sentence is the message."""
    return _written(
        [
            _Case(
                one.scene,
                f"{one.quantity}: {one.backend} against {one.reference}",
                _ELEMENT.get(one.outcome),
                one.outcome.value,
                one.sentence,
            )
            for one in verdicts
        ]
    )


def regression_junit(comparisons: Sequence[Comparison]) -> str:
    """One test case a scene and backend beside its baseline."""
    return _written(
        [
            _Case(
                one.scene,
                f"{one.backend}: same as its baseline",
                _OF_CHANGE.get(one.change),
                one.change.value,
                "; ".join([one.sentence, *one.notes]),
            )
            for one in comparisons
        ]
    )


def _written(cases: Sequence[_Case]) -> str:
    elements = [case.element for case in cases]
    suite = ElementTree.Element(
        "testsuite",
        name="dem_bridge",
        tests=str(len(cases)),
        failures=str(elements.count("failure")),
        errors=str(elements.count("error")),
        skipped=str(elements.count("skipped")),
    )
    for one in cases:
        case = ElementTree.SubElement(suite, "testcase", classname=one.group, name=one.name)
        if one.element is not None:
            ElementTree.SubElement(case, one.element, message=f"{one.outcome}: {one.sentence}")
        else:
            ElementTree.SubElement(case, "system-out").text = one.sentence
    return ElementTree.tostring(suite, encoding="unicode", xml_declaration=True) + "\n"
