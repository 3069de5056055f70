"""Verdicts as JUnit XML, for the boards of continuous integration."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree

from dem_bridge.verdict import Outcome, Verdict

#: outcome -> element of JUnit; the others are passes
_ELEMENT = {
    Outcome.FAIL: "failure",
    Outcome.UNDECIDED: "failure",
    Outcome.BROKEN: "error",
    Outcome.NOT_RUN: "skipped",
    Outcome.MODEL_DIFFERENCE: "skipped",
}


def junit(verdicts: Sequence[Verdict]) -> str:
    """One test case a verdict; its sentence is the message."""
    elements = [_ELEMENT.get(verdict.outcome) for verdict in verdicts]
    suite = ElementTree.Element(
        "testsuite",
        name="dem_bridge",
        tests=str(len(verdicts)),
        failures=str(elements.count("failure")),
        errors=str(elements.count("error")),
        skipped=str(elements.count("skipped")),
    )
    for verdict, element in zip(verdicts, elements, strict=True):
        name = f"{verdict.quantity}: {verdict.backend} against {verdict.reference}"
        case = ElementTree.SubElement(suite, "testcase", classname=verdict.scene, name=name)
        if element is not None:
            ElementTree.SubElement(case, element, message=f"{verdict.outcome.value}: {verdict.sentence}")
        else:
            ElementTree.SubElement(case, "system-out").text = verdict.sentence
    return ElementTree.tostring(suite, encoding="unicode", xml_declaration=True) + "\n"
