"""Describe a regression as text for a terminal and as Markdown for a pull request."""

from __future__ import annotations

import math

from dem_bridge.report.page import fill
from dem_bridge.verification.regression.baseline import QUANTITIES
from dem_bridge.verification.regression.compare import Change, Comparison, worst_outcome
from dem_bridge.verification.regression.run import Regression

#: order of the outcomes in a pull request, failures first
_ORDER = (Change.BROKEN, Change.CHANGED, Change.GONE, Change.NOT_RUN, Change.NEW, Change.SAME)
#: changes since an earlier regression
_SINCE = ("new", "fixed", "still failing")


def tally(regression: Regression) -> str:
    """Return a line with the number of comparisons by outcome.

    >>> tally(Regression(comparisons=(), title="", texts={}))
    'nothing was compared'
    """
    comparisons = regression.comparisons
    if not comparisons:
        return "nothing was compared"
    parts = [", ".join(f"{regression.count(change)} {change.value}" for change in _ORDER if regression.count(change))]
    if wrong := sum(worst_outcome(comparison.after) == "FAIL" for comparison in comparisons):
        parts.append(f"{wrong} wrong against the reference")
    since = {word: sum(comparison.since == word for comparison in comparisons) for word in _SINCE}
    if any(since.values()):
        parts.append(f"since last time {', '.join(f'{count} {word}' for word, count in since.items() if count)}")
    return "; ".join(parts)


def lines(regression: Regression) -> list[str]:
    """Return the lines for a terminal: one per comparison, with details of those that changed or broke."""
    if not regression.comparisons:
        return [tally(regression)]
    scene, backend = (
        max(len(getattr(comparison, key)) for comparison in regression.comparisons) for key in ("scene", "backend")
    )
    text = []
    for comparison in regression.comparisons:
        change, since = comparison.change, _since(comparison)
        head = f"{change.value:8} {comparison.scene:{scene}}  {comparison.backend:{backend}}"
        text.append(f"{head}  {comparison.sentence}{since}")
        if change is Change.CHANGED:
            text += [f"{'':8} then: {departure.sentence}" for departure in comparison.departures[1:]]
        if change in (Change.CHANGED, Change.BROKEN):
            text += [f"{'':8} note: {note}" for note in comparison.notes]
    return [*text, *(f"note: {note}" for note in _common_notes(regression)), tally(regression)]


def markdown(regression: Regression) -> str:
    """Return Markdown for a pull request: the comparisons that are not SAME, then a table of all."""
    return fill(
        "regression.md.j2",
        __package__,
        regression=regression,
        tally=tally(regression),
        order=_ORDER[:-1],
        cells=_cells,
        notes=_common_notes(regression),
        since=_since,
    )


def _since(comparison: Comparison) -> str:
    """Return the change since an earlier regression in brackets, or nothing."""
    return f" ({comparison.since})" if comparison.since else ""


def _cells(comparison: Comparison) -> list[str]:
    """Return the differences of a comparison with their tolerances, then the velocity errors now and before."""
    cells = []
    for name in QUANTITIES:
        value, tolerance = comparison.differences.get(name), comparison.same_within.get(name, math.nan)
        cells.append("" if value is None else f"{value:.1e} ({tolerance:.1e})" if value else "0")
    errors = [accuracies.get("velocity") for accuracies in (comparison.after, comparison.before)]
    verdict = worst_outcome(comparison.after)
    return [*cells, *("" if accuracy is None else f"{accuracy.error:.1e}" for accuracy in errors), verdict]


def _common_notes(regression: Regression) -> list[str]:
    """Return the notes of all comparisons that are SAME, each once."""
    notes = [note for entry in regression.comparisons if entry.change is Change.SAME for note in entry.notes]
    return list(dict.fromkeys(notes))
