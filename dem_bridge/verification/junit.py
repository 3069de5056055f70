"""Write verdicts and regressions as JUnit XML for continuous integration."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from dem_bridge.observables.verdict import Verdict
from dem_bridge.report.pages import fill
from dem_bridge.verification.regression.compare import Comparison

#: JUnit element of each outcome and change; those without an element pass
_ELEMENTS = {
    **dict.fromkeys(("FAIL", "UNDECIDED", "CHANGED", "GONE"), "failure"),
    **dict.fromkeys(("NOT_RUN", "MODEL_DIFFERENCE", "NEW"), "skipped"),
    "BROKEN": "error",
}


def junit(verdicts: Sequence[Verdict]) -> str:
    """Return JUnit XML with a test case per verdict."""
    return _xml((v.scene, f"{v.quantity}: {v.backend} against {v.reference}", v.outcome, v.sentence) for v in verdicts)


def regression_junit(comparisons: Sequence[Comparison]) -> str:
    """Return JUnit XML with a test case per comparison with a baseline."""
    return _xml(
        (c.scene, f"{c.backend}: same as its baseline", c.change, "; ".join([c.sentence, *c.notes]))
        for c in comparisons
    )


def _xml(cases: Iterable[tuple[str, str, str, str]]) -> str:
    """Return the JUnit XML of test cases: class, name, outcome and sentence of each."""
    names = ("group", "name", "outcome", "sentence")
    filled = [{**dict(zip(names, case, strict=True)), "element": _ELEMENTS.get(case[2])} for case in cases]
    return fill("junit.xml.j2", __package__, cases=filled)
