"""A regression in words: for a terminal, and for a pull request."""

from __future__ import annotations

import math

from dem_bridge.regression.compare import Change, Comparison, worst_outcome
from dem_bridge.regression.run import Regression

#: what a reader of a pull request has to see first
_ORDER = (Change.BROKEN, Change.CHANGED, Change.GONE, Change.NOT_RUN, Change.NEW, Change.SAME)


def tally(found: Regression) -> str:
    """One line.

    >>> tally(Regression(comparisons=(), title="", texts={}))
    'nothing was compared'
    """
    if not found.comparisons:
        return "nothing was compared"
    counts = [f"{found.count(change)} {change.value}" for change in _ORDER if found.count(change)]
    wrong = sum(worst_outcome(one.after) == "FAIL" for one in found.comparisons)
    since = [
        f"{sum(one.since == word for one in found.comparisons)} {word}" for word in ("new", "fixed", "still failing")
    ]
    told = [", ".join(counts)] + ([f"{wrong} wrong beside the reference"] if wrong else [])
    if any(one.since for one in found.comparisons):
        told.append(f"since last time {', '.join(part for part in since if not part.startswith('0 '))}")
    return "; ".join(told)


def lines(found: Regression) -> list[str]:
    """For a terminal: one line each, and what else is known of those that are not the same."""
    if not found.comparisons:
        return [tally(found)]
    scene, code = (max(len(getattr(one, key)) for one in found.comparisons) for key in ("scene", "backend"))
    told = []
    for one in found.comparisons:
        since = f" ({one.since})" if one.since else ""
        told.append(f"{one.change.value:8} {one.scene:{scene}}  {one.backend:{code}}  {one.sentence}{since}")
        if one.change is Change.CHANGED:
            told += [f"{'':8} then: {departure.sentence}" for departure in one.departures[1:]]
        if one.change in (Change.CHANGED, Change.BROKEN):
            told += [f"{'':8} note: {note}" for note in one.notes]
    common = _common_notes(found)
    return [*told, *(f"note: {note}" for note in common), tally(found)]


def markdown(found: Regression) -> str:
    """For a pull request: what is not the same, then all in a table."""
    told = [f"### Regression: {tally(found)}", "", f"{found.title[:1].upper()}{found.title[1:]}.", ""]
    for change in _ORDER[:-1]:
        for one in found.comparisons:
            if one.change is change:
                since = f" ({one.since})" if one.since else ""
                told.append(f"- **{change.value}**{since} {one.scene}, `{one.backend}`: {_safe(one.sentence)}")
                told += [f"  - then {_safe(departure.sentence)}" for departure in one.departures[1:]]
                told += [f"  - {_safe(note)}" for note in one.notes if change is not Change.NEW]
    if told[-1]:
        told.append("")
    head = ("scene", "backend", "outcome", "velocity", "peak force", "crossing time", "error", "was", "verdict")
    told += [f"| {' | '.join(head)} |", f"|{' --- |' * 3}{' ---: |' * 5} --- |"]
    told += [f"| {' | '.join(_row(one))} |" for one in found.comparisons]
    told += ["", "Differences are relative, with how far honest builds may differ in brackets. Errors are of velocity."]
    told += [f"{note}." for note in _common_notes(found)]
    return "\n".join(told) + "\n"


def _row(one: Comparison) -> list[str]:
    apart = []
    for name in ("velocity", "peak_force", "crossing_time"):
        value, within = one.differences.get(name), one.same_within.get(name, math.nan)
        apart.append("" if value is None else f"{value:.1e} ({within:.1e})" if value else "0")
    errors = [f"{side['velocity'].error:.1e}" if "velocity" in side else "" for side in (one.after, one.before)]
    outcome = f"**{one.change.value}**" if one.change.fails else one.change.value
    return [one.scene, f"`{one.backend}`", outcome, *apart, *errors, worst_outcome(one.after)]


def _common_notes(found: Regression) -> list[str]:
    """What is said of those that are the same, once."""
    notes = [note for one in found.comparisons if one.change is Change.SAME for note in one.notes]
    return list(dict.fromkeys(notes))


def _safe(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")
