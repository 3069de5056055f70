"""Compare a run with a baseline: SAME or CHANGED, the first difference, and the errors of both against a reference.

This module makes no runs.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from typing import Any

import numpy as np

from dem_bridge.observables.differences import difference
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.observables.verdict import Outcome, judge_relative
from dem_bridge.runs.digits import planned_fingerprint
from dem_bridge.trajectory.relative import own_scale, relative_size
from dem_bridge.trajectory.trajectory import Floats, Trajectory
from dem_bridge.verification.regression.baseline import QUANTITIES, Accuracy, Baseline


class Change(StrEnum):
    """Name the outcomes of a regression; NOT_RUN and BROKEN mean that there is no run to compare."""

    SAME = "SAME"
    CHANGED = "CHANGED"
    NEW = "NEW"
    """There is a run and no baseline."""
    GONE = "GONE"
    """There is a baseline, but its scene or backend no longer exists."""
    NOT_RUN = "NOT_RUN"
    BROKEN = "BROKEN"

    @property
    def fails(self) -> bool:
        """Return True if the outcome is a failure."""
        return self in (Change.CHANGED, Change.GONE, Change.BROKEN)


@dataclass(frozen=True, kw_only=True)
class Departure:
    """Hold the first value of a quantity that differs from the baseline by more than ``same_within``."""

    quantity: str
    body: int
    """Index of the body, or of the contact for peak forces and crossing times."""
    time: float
    """Time of the sample, or crossing time of the contact, s; nan for a contact that never crosses."""
    before: float
    """Value in the baseline."""
    after: float
    """Value in the run."""
    difference: float
    """Relative difference of this value, with the scale of ``same_within``."""
    largest_difference: float
    """Largest relative difference of all values of the quantity."""
    same_within: float
    count: int
    """Number of values that differ by more than ``same_within``."""

    @property
    def sentence(self) -> str:
        """Return a sentence with both values, their difference and its tolerance."""
        observable = OBSERVABLES[self.quantity]
        kind, unit = observable.axis[-1], observable.unit
        when = f" at t = {1e3 * self.time:.6g} ms" if math.isfinite(self.time) else ""
        return (
            f"{self.quantity} of {kind} {self.body}{when} was {self.before!r} {unit} and is {self.after!r} {unit};"
            f" the relative difference is {self.difference:.2g}, the tolerance (same_within) {self.same_within:.2g};"
            f" {self.count} {'value differs' if self.count == 1 else 'values differ'} by more than the tolerance, by at"
            f" most {self.largest_difference:.2g}"
        )


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Hold the comparison of one scene and backend with its baseline."""

    scene: str
    backend: str
    change: Change
    sentence: str
    """Sentence with the outcome, the first difference and the accuracy."""
    departures: tuple[Departure, ...] = ()
    """First difference of each quantity that has changed, in the order of time."""
    differences: Mapping[str, float] = field(default_factory=dict)
    """Largest relative difference of each quantity, with the scale of ``same_within``."""
    same_within: Mapping[str, float] = field(default_factory=dict)
    """Tolerance of the difference of each quantity."""
    bitwise: bool = False
    """True if every value is equal to the last digit."""
    tolerance: float = math.nan
    """Relative tolerance of the velocity error."""
    before: Mapping[str, Accuracy] = field(default_factory=dict)
    """Errors of the baseline against the reference, by quantity."""
    after: Mapping[str, Accuracy] = field(default_factory=dict)
    """Errors of the run against the reference, by quantity."""
    notes: tuple[str, ...] = ()
    """Changes of versions, deck, scene and machine."""
    since: str = ""
    """Change of the outcome since an earlier regression: "new", "fixed" or "still failing"; '' if there is none."""

    def as_json(self) -> dict[str, Any]:
        """Return the comparison as JSON types; numbers that are not finite become null."""
        document: dict[str, Any] = json.loads(json.dumps(asdict(self)), parse_constant=lambda word: None)
        return document


def compare(baseline: Baseline, run: Trajectory, *, reference: Trajectory | None = None) -> Comparison:
    """Compare a run with a baseline, and both with a reference if there is one.

    The outcome is SAME if every value is within ``same_within`` of the baseline. Errors are computed if the reference
    has the sample times of the run; without a reference, a run that is SAME keeps the errors of the baseline.
    """
    notes = _notes(baseline, run)
    base: dict[str, Any] = {"scene": baseline.scene, "backend": baseline.backend, "tolerance": baseline.tolerance}
    earlier = baseline.run
    if run.velocity.shape == earlier.velocity.shape:
        # the settings are equal, so the uncertainties are those of the baseline, and the run need not estimate them
        run = replace(run, uncertainty=earlier.uncertainty)
    after = assess(run, reference, baseline.tolerance)
    if earlier.velocity.shape != run.velocity.shape or not np.array_equal(earlier.time, run.time):
        text = (
            f"the run has {run.velocity.shape[1]} bodies and {len(run.time)} times up to {run.time[-1]:.17g} s,"
            f" the baseline {earlier.velocity.shape[1]} bodies and {len(earlier.time)} times up to"
            f" {earlier.time[-1]:.17g} s"
        )
        return Comparison(change=Change.CHANGED, sentence=f"{text}.", notes=tuple(notes), after=after, **base)
    other_scene = baseline.provenance["scene_hash"] != run.provenance["scene_hash"]
    # the reference is of the new scene, so a baseline of another scene has no error against it
    before = {} if other_scene else assess(earlier, reference, baseline.tolerance)
    differences = {name: _relative_difference(name, getattr(earlier, name), getattr(run, name)) for name in QUANTITIES}
    largest = {name: float(np.max(values, initial=0.0)) for name, values in differences.items()}
    same_within = {name: tolerance.value for name, tolerance in baseline.same_within.items()}
    departures = [
        departure
        for name in QUANTITIES
        if (departure := _departure(name, earlier, run, differences[name], same_within[name]))
    ]
    departures.sort(key=lambda departure: (not math.isfinite(departure.time), departure.time))
    same = all(np.array_equal(getattr(earlier, name), getattr(run, name), equal_nan=True) for name in QUANTITIES)
    change = Change.CHANGED if departures or other_scene else Change.SAME
    if departures:
        text = departures[0].sentence + _machines(baseline)
    elif other_scene:
        text = "the scene differs from that of the baseline, but every value is within same_within"
    elif same:
        text = "bit for bit"
    else:
        # every difference is within its tolerance, so one with the tolerance 0 is 0
        name = max(QUANTITIES, key=lambda name: largest[name] / (same_within[name] or 1.0))
        text = f"{name} differs by at most {largest[name]:.2g}, tolerance (same_within) {same_within[name]:.2g}"
    if reference is None and change is Change.SAME:
        before = after = dict(baseline.accuracy)
    words = accuracy_words(before, after)
    return Comparison(
        change=change,
        sentence=f"{text}; {words}." if words else f"{text}.",
        departures=tuple(departures),
        differences=largest,
        same_within=same_within,
        bitwise=same,
        before=before,
        after=after,
        notes=tuple(notes),
        **base,
    )


def assess(run: Trajectory, reference: Trajectory | None, tolerance: float) -> dict[str, Accuracy]:
    """Return the error of each quantity against a reference; empty without a reference with the same sample times.

    ``tolerance`` is that of the velocity. The tolerance of peak forces and crossing times is at least the uncertainty
    of the run.
    """
    if reference is None or run.velocity.shape != reference.velocity.shape or np.any(run.time != reference.time):
        return {}
    accuracies = {}
    for name in QUANTITIES:
        error = difference(name, run, reference)
        allowed = tolerance if name == "velocity" else max(tolerance, error.uncertainty)
        outcome = judge_relative(error.value, error.reference_uncertainty, allowed)
        accuracies[name] = Accuracy(
            error=error.value,
            uncertainty=error.reference_uncertainty,
            tolerance=allowed,
            outcome=outcome.value,
            by=reference.provenance["backend"],
        )
    return accuracies


def worst_outcome(accuracies: Mapping[str, Accuracy]) -> str:
    """Return the worst outcome: FAIL, then UNDECIDED, then PASS; '' without an accuracy."""
    order = (Outcome.FAIL, Outcome.UNDECIDED, Outcome.PASS)
    return next((outcome.value for outcome in order if any(a.outcome == outcome for a in accuracies.values())), "")


_WORD = {"PASS": "right", "FAIL": "wrong", "UNDECIDED": "undecided"}


def accuracy_words(before: Mapping[str, Accuracy], after: Mapping[str, Accuracy]) -> str:
    """Return a clause about the accuracy of the run and of its baseline.

    >>> right = {"velocity": Accuracy(error=1e-4, uncertainty=0.0, tolerance=1e-3, outcome="PASS", by="reference")}
    >>> wrong = {"velocity": Accuracy(error=0.1, uncertainty=0.0, tolerance=1e-3, outcome="FAIL", by="reference")}
    >>> accuracy_words(right, wrong)
    'now wrong: the velocity error against reference is 0.1 (was 0.0001), tolerance 0.001'
    """
    if not after:
        return ""
    was, now = worst_outcome(before), worst_outcome(after)
    word = _WORD[now]
    if was:
        word = f"still {word}" if was == now else f"now {word}"
    # the quantity with the worst outcome and the largest ratio of error to tolerance
    name = max(after, key=lambda name: (after[name].outcome == now, after[name].error / after[name].tolerance))
    past = f" (was {before[name].error:.2g})" if name in before else ""
    accuracy = after[name]
    quantity = name.replace("_", " ")
    return (
        f"{word}: the {quantity} error against {accuracy.by} is {accuracy.error:.2g}{past},"
        f" tolerance {accuracy.tolerance:.2g}"
    )


def _relative_difference(name: str, before: Floats, after: Floats) -> Floats:
    """Return the relative differences; inf where only one of the two has a value.

    The scale is the smaller of the two, because with the larger one a huge wrong value would reduce its own relative
    difference and hide others.
    """
    if name == "velocity":
        scale = np.asarray(min(float(np.max(np.abs(values), initial=0.0)) for values in (before, after)))
    else:
        scale = np.minimum(own_scale(before), own_scale(after))
    unknown = np.isnan(before) & np.isnan(after)
    distance = np.where(unknown, 0.0, np.nan_to_num(np.abs(before - after), nan=math.inf, posinf=math.inf))
    return relative_size(distance, scale)


def _departure(
    name: str, before: Trajectory, after: Trajectory, differences: Floats, tolerance: float
) -> Departure | None:
    """Return the first value that differs by more than the tolerance; None if no value does."""
    beyond = differences > tolerance
    if not beyond.any():
        return None
    if name == "velocity":
        row = int(np.argmax(beyond.any(axis=1)))
        body, time = int(np.argmax(differences[row])), float(before.time[row])
        place: Any = (row, body)
    else:
        # the crossing time of that contact, from the trajectory that has it
        crossing = np.where(np.isnan(before.crossing_time), after.crossing_time, before.crossing_time)
        when = np.where(beyond, np.where(np.isnan(crossing), math.inf, crossing), math.inf)
        body = int(np.argmin(when)) if np.isfinite(when).any() else int(np.argmax(beyond))
        time = float(when[body]) if math.isfinite(when[body]) else math.nan
        place = body
    return Departure(
        quantity=name,
        body=body,
        time=time,
        before=float(getattr(before, name)[place]),
        after=float(getattr(after, name)[place]),
        difference=float(differences[place]),
        largest_difference=float(np.max(differences)),
        same_within=tolerance,
        count=int(np.count_nonzero(beyond)),
    )


def _machines(baseline: Baseline) -> str:
    """Return the end of a sentence that states that a difference may be one of machines; '' if it cannot be."""
    then, now = baseline.provenance.get("digits"), planned_fingerprint()
    if then is None:
        return "; the baseline does not state the last digits of its machine, so the difference may be that of machines"
    if then == now:
        return ""
    return (
        f"; the baseline is of a machine with other last digits (fingerprint {then[:8]}, here {now[:8]}), so the"
        " difference may be that of the machines"
    )


def _notes(baseline: Baseline, run: Trajectory) -> list[str]:
    """Return the changes of scene, deck, versions and machine since the baseline."""
    then, now, notes = baseline.provenance, run.provenance, list[str]()
    if baseline.edited:
        notes.append(
            f"{baseline.file_name}: {', '.join(baseline.edited)} was changed after the file was written (its digest"
            " differs)"
        )
    lammps_then, lammps_now = then["lammps"] or {}, now.get("lammps") or {}
    changes = [
        ("scene", then["scene_hash"][:12], now["scene_hash"][:12]),
        ("deck", str(then["deck_hash"])[:12], str(now.get("deck_hash"))[:12]),
        ("LAMMPS", lammps_then.get("version"), lammps_now.get("version")),
        ("run by", lammps_then.get("run_by"), lammps_now.get("run_by")),
        *((name, then["versions"].get(name), version) for name, version in now["versions"].items()),
        ("machine", then["machine"], now["machine"]),
    ]
    if then.get("digits") is not None:
        changes.append(("last digits", then["digits"][:8], planned_fingerprint()[:8]))
    return notes + [f"{name} {before} -> {after}" for name, before, after in changes if before != after]
