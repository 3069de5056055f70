"""JUnit XML of outcomes and changes, which continuous integration shows."""

from __future__ import annotations

from collections.abc import Iterable

from dem_bridge.report.page import fill

#: JUnit element of each outcome and change; those without an element pass
_ELEMENTS = {
    **dict.fromkeys(("FAIL", "UNDECIDED", "CHANGED", "GONE"), "failure"),
    **dict.fromkeys(("NOT_RUN", "MODEL_DIFFERENCE", "NEW"), "skipped"),
    "BROKEN": "error",
}


def junit_xml(cases: Iterable[tuple[str, str, str, str]]) -> str:
    """Return the JUnit XML of test cases: class, name, outcome and sentence of each.

    Examples
    --------
    >>> text = junit_xml([("pair", "velocity", "FAIL", "It is wrong."), ("pair", "force", "PASS", "It is right.")])
    >>> 'tests="2" failures="1" errors="0"' in text, '<failure message="FAIL: It is wrong." />' in text
    (True, True)
    """
    names = ("group", "name", "outcome", "sentence")
    filled = [{**dict(zip(names, case, strict=True)), "element": _ELEMENTS.get(case[2])} for case in cases]
    return fill("junit.xml.j2", cases=filled)
