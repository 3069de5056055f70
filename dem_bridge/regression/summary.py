"""Describe a regression as text for a terminal and as Markdown for a pull request."""

from __future__ import annotations

import math

from dem_bridge.regression.compare import Change, Comparison, worst_outcome
from dem_bridge.regression.run import Regression

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
    title = regression.title
    text = [f"### Regression: {tally(regression)}", "", f"{title[:1].upper()}{title[1:]}.", ""]
    for change in _ORDER[:-1]:
        for comparison in regression.comparisons:
            if comparison.change is change:
                head = f"- **{change.value}**{_since(comparison)} {comparison.scene}, `{comparison.backend}`"
                text.append(f"{head}: {_escape(comparison.sentence)}")
                text += [f"  - then {_escape(departure.sentence)}" for departure in comparison.departures[1:]]
                text += [f"  - {_escape(note)}" for note in comparison.notes if change is not Change.NEW]
    if text[-1]:
        text.append("")
    head_cells = ("scene", "backend", "outcome", "velocity", "peak force", "crossing time", "error", "was", "verdict")
    text += [f"| {' | '.join(head_cells)} |", f"|{' --- |' * 3}{' ---: |' * 5} --- |"]
    text += [f"| {' | '.join(_row(comparison))} |" for comparison in regression.comparisons]
    text += [
        "",
        "Differences are relative; the tolerance (same_within), which only round-off explains, is in brackets."
        " Errors are relative errors of the velocity.",
    ]
    text += [f"{note}." for note in _common_notes(regression)]
    return "\n".join(text) + "\n"


def _since(comparison: Comparison) -> str:
    """Return the change since an earlier regression in brackets, or nothing."""
    return f" ({comparison.since})" if comparison.since else ""


def _row(comparison: Comparison) -> list[str]:
    """Return the cells of a comparison in the table."""
    differences = []
    for name in ("velocity", "peak_force", "crossing_time"):
        value, tolerance = comparison.differences.get(name), comparison.same_within.get(name, math.nan)
        differences.append("" if value is None else f"{value:.1e} ({tolerance:.1e})" if value else "0")
    errors = [
        f"{accuracies['velocity'].error:.1e}" if "velocity" in accuracies else ""
        for accuracies in (comparison.after, comparison.before)
    ]
    outcome = f"**{comparison.change.value}**" if comparison.change.fails else comparison.change.value
    verdict = worst_outcome(comparison.after)
    return [comparison.scene, f"`{comparison.backend}`", outcome, *differences, *errors, verdict]


def _common_notes(regression: Regression) -> list[str]:
    """Return the notes of all comparisons that are SAME, each once."""
    notes = [note for entry in regression.comparisons if entry.change is Change.SAME for note in entry.notes]
    return list(dict.fromkeys(notes))


def _escape(text: str) -> str:
    """Return text that can stand in a Markdown table or list."""
    return text.replace("|", "\\|").replace("\n", " ")
