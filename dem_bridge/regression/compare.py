"""A run beside a baseline: SAME or CHANGED, where first, and how right each of the two is.

Numbers and words, no runs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from typing import Any

import numpy as np

from dem_bridge.differences import difference
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.regression.baseline import QUANTITIES, Accuracy, Baseline
from dem_bridge.trajectory import Floats, Trajectory, own_scale
from dem_bridge.verification.verdict import Outcome, judge, plain


class Change(StrEnum):
    """The closed set of a regression; the last two say why there is no answer."""

    SAME = "SAME"
    CHANGED = "CHANGED"
    NEW = "NEW"
    """There is no baseline."""
    GONE = "GONE"
    """There is a baseline, and nothing to compare it with."""
    NOT_RUN = "NOT_RUN"
    BROKEN = "BROKEN"

    @property
    def fails(self) -> bool:
        return self in (Change.CHANGED, Change.GONE, Change.BROKEN)


@dataclass(frozen=True, kw_only=True)
class Departure:
    """Where one quantity first leaves its baseline."""

    quantity: str
    body: int
    """Body, or contact for peak forces and crossing times."""
    time: float
    """s: the sample, or the crossing of that contact; nan: never."""
    before: float
    after: float
    apart: float
    """There, relative as in ``same_within``."""
    worst: float
    """The most anywhere."""
    same_within: float
    beyond: int
    """How many values are."""

    @property
    def sentence(self) -> str:
        observable = OBSERVABLES[self.quantity]
        kind, unit = observable.axis[-1], observable.unit
        when = f" at t = {1e3 * self.time:.6g} ms" if math.isfinite(self.time) else ""
        return (
            f"{self.quantity} of {kind} {self.body}{when} was {self.before!r} {unit} and is {self.after!r} {unit}:"
            f" {self.apart:.2g} apart, same within {self.same_within:.2g}; {self.beyond}"
            f" {'value is' if self.beyond == 1 else 'values are'} beyond it, at most {self.worst:.2g} apart"
        )


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """One scene and backend. ``sentence`` says all of it that a person asks first."""

    scene: str
    backend: str
    change: Change
    sentence: str
    departures: tuple[Departure, ...] = ()
    """One for each quantity that has changed, in the order of time."""
    differences: Mapping[str, float] = field(default_factory=dict)
    """Quantity -> the most that values are apart, relative as in ``same_within``."""
    same_within: Mapping[str, float] = field(default_factory=dict)
    bitwise: bool = False
    """Whether every value is the same to the last digit."""
    tolerance: float = math.nan
    before: Mapping[str, Accuracy] = field(default_factory=dict)
    after: Mapping[str, Accuracy] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    """What else is another than it was: versions, the deck, the scene."""
    since: str = ""
    """Beside the last time: "new", "fixed", "still failing"; '' where nothing was or is wrong, or nothing is known."""

    def as_json(self) -> dict[str, Any]:
        """JSON-able; numbers that are not finite become null."""
        told: dict[str, Any] = _plain(asdict(self))
        return told


def compare(baseline: Baseline, run: Trajectory, *, reference: Trajectory | None = None) -> Comparison:
    """SAME where every value is within ``same_within`` of the baseline; errors of both where there is a reference
    with the samples of the run. Without one, what is the same is as right as it was."""
    notes = _notes(baseline, run)
    base: dict[str, Any] = {"scene": baseline.scene, "backend": baseline.backend, "tolerance": baseline.tolerance}
    other = baseline.as_trajectory()
    if run.velocity.shape == other.velocity.shape:
        # at the same settings, so with the same bars, which no run that is only compared has of its own
        run = replace(run, uncertainty=other.uncertainty)
    after = judged(run, reference, baseline.tolerance)
    if other.velocity.shape != run.velocity.shape or not np.array_equal(other.time, run.time):
        what = (
            f"the run has {run.velocity.shape[1]} bodies and {len(run.time)} times to {run.time[-1]:.17g} s,"
            f" the baseline {other.velocity.shape[1]} and {len(other.time)} to {other.time[-1]:.17g} s"
        )
        return Comparison(change=Change.CHANGED, sentence=f"{what}.", notes=tuple(notes), after=after, **base)
    moved = baseline.birth["scene_hash"] != run.provenance["scene_hash"]
    # of another scene the reference says nothing
    before = {} if moved else judged(other, reference, baseline.tolerance)
    found = {name: _apart(name, getattr(other, name), getattr(run, name)) for name in QUANTITIES}
    departures = [
        one
        for name in QUANTITIES
        if (one := _departure(name, other, run, found[name], baseline.same_within[name].value))
    ]
    departures.sort(key=lambda one: (not math.isfinite(one.time), one.time))
    same = all(np.array_equal(getattr(other, name), getattr(run, name), equal_nan=True) for name in QUANTITIES)
    change = Change.CHANGED if departures or moved else Change.SAME
    if departures:
        text = departures[0].sentence
    elif moved:
        text = "the scene is not that of the baseline, though every value is the same within same_within"
    elif same:
        text = "bit for bit"
    else:
        name = max(QUANTITIES, key=lambda name: _share(float(np.max(found[name], initial=0.0)), baseline, name))
        text = f"{name} is {np.max(found[name]):.2g} apart at most, same within {baseline.same_within[name].value:.2g}"
    if reference is None and change is Change.SAME:
        before = after = dict(baseline.accuracy)
    words = accuracy_words(before, after)
    return Comparison(
        change=change,
        sentence=f"{text}; {words}." if words else f"{text}.",
        departures=tuple(departures),
        differences={name: float(np.max(one, initial=0.0)) for name, one in found.items()},
        same_within={name: one.value for name, one in baseline.same_within.items()},
        bitwise=same,
        before=before,
        after=after,
        notes=tuple(notes),
        **base,
    )


def judged(run: Trajectory, reference: Trajectory | None, tolerance: float) -> dict[str, Accuracy]:
    """Error of each quantity against a reference; nothing where there is none, or it has other samples.

    The tolerance is of velocity: peaks and crossings may err by what the bars of the run say of its settings.
    """
    if reference is None or run.velocity.shape != reference.velocity.shape:
        return {}
    if not np.array_equal(run.time, reference.time):
        return {}
    told = {}
    for name in QUANTITIES:
        one = difference(name, run, reference)
        allowed = tolerance if name == "velocity" else max(tolerance, one.uncertainty)
        outcome = judge(one.value, one.reference_uncertainty, allowed)
        by = reference.provenance["backend"]
        told[name] = Accuracy(
            error=one.value, bar=one.reference_uncertainty, tolerance=allowed, outcome=outcome.value, by=by
        )
    return told


def worst_outcome(found: Mapping[str, Accuracy]) -> str:
    """FAIL before UNDECIDED before PASS; '' for nothing judged."""
    order = (Outcome.FAIL, Outcome.UNDECIDED, Outcome.PASS)
    return next((one.value for one in order if any(a.outcome == one for a in found.values())), "")


_WORD = {"PASS": "right", "FAIL": "wrong", "UNDECIDED": "undecided"}


def accuracy_words(before: Mapping[str, Accuracy], after: Mapping[str, Accuracy]) -> str:
    """As a person says it.

    >>> right = {"velocity": Accuracy(error=1e-4, bar=0.0, tolerance=1e-3, outcome="PASS", by="reference")}
    >>> wrong = {"velocity": Accuracy(error=0.1, bar=0.0, tolerance=1e-3, outcome="FAIL", by="reference")}
    >>> accuracy_words(right, wrong)
    'now wrong: velocity is 0.1 from reference (was 0.0001), tolerance 0.001'
    """
    if not after:
        return ""
    was, now = worst_outcome(before), worst_outcome(after)
    word = _WORD[now]
    if was:
        word = f"still {word}" if was == now else f"now {word}"
    # the quantity that decides it, or the one that is nearest to its tolerance
    name = max(after, key=lambda one: (after[one].outcome == now, after[one].error / after[one].tolerance))
    past = f" (was {before[name].error:.2g})" if name in before else ""
    one = after[name]
    return f"{word}: {name} is {one.error:.2g} from {one.by}{past}, tolerance {one.tolerance:.2g}"


def _apart(name: str, before: Floats, after: Floats) -> Floats:
    """Relative; inf where only one has a value. The smaller scale of the two counts: a wrong value must not be its
    own excuse."""
    if name == "velocity":
        scale = np.asarray(min(float(np.max(np.abs(one), initial=0.0)) for one in (before, after)))
    else:
        scale = np.minimum(own_scale(before), own_scale(after))
    distance = np.abs(before - after)
    distance = np.where(np.isnan(distance), math.inf, distance)
    distance = np.where(np.isnan(before) & np.isnan(after), 0.0, distance)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(distance == 0.0, 0.0, distance / scale))


def _departure(name: str, before: Trajectory, after: Trajectory, apart: Floats, within: float) -> Departure | None:
    beyond = apart > within
    if not beyond.any():
        return None
    if name == "velocity":
        row = int(np.argmax(beyond.any(axis=1)))
        body, time = int(np.argmax(apart[row])), float(before.time[row])
        place: Any = (row, body)
    else:
        # when that contact is at its deepest, by whichever knows
        at = np.where(np.isnan(before.crossing_time), after.crossing_time, before.crossing_time)
        when = np.where(beyond, np.where(np.isnan(at), math.inf, at), math.inf)
        body = int(np.argmin(when)) if np.isfinite(when).any() else int(np.argmax(beyond))
        time = float(when[body]) if math.isfinite(when[body]) else math.nan
        place = body
    return Departure(
        quantity=name,
        body=body,
        time=time,
        before=float(getattr(before, name)[place]),
        after=float(getattr(after, name)[place]),
        apart=float(apart[place]),
        worst=float(np.max(apart)),
        same_within=within,
        beyond=int(np.count_nonzero(beyond)),
    )


def _share(apart: float, baseline: Baseline, name: str) -> float:
    within = baseline.same_within[name].value
    return apart / within if within > 0.0 else (math.inf if apart > 0.0 else 0.0)


def _notes(baseline: Baseline, run: Trajectory) -> list[str]:
    """What is another than at the birth of the baseline."""
    birth, now, notes = baseline.birth, run.provenance, []
    if baseline.edited:
        notes.append(
            f"{baseline.file_name}: {', '.join(baseline.edited)} is not as it was written: its digests do not fit"
        )
    if birth["scene_hash"] != now["scene_hash"]:
        notes.append(f"scene {birth['scene_hash'][:12]} -> {now['scene_hash'][:12]}")
    if birth["deck_hash"] != now.get("deck_hash"):
        notes.append(f"deck {str(birth['deck_hash'])[:12]} -> {str(now.get('deck_hash'))[:12]}")
    was, new = birth["lammps"] or {}, now.get("lammps") or {}
    if was.get("version") != new.get("version"):
        notes.append(f"LAMMPS {was.get('version')} -> {new.get('version')}")
    if was.get("run_by") != new.get("run_by"):
        notes.append(f"run by {was.get('run_by')} -> {new.get('run_by')}")
    for name, version in now["versions"].items():
        if birth["versions"].get(name) != version:
            notes.append(f"{name} {birth['versions'].get(name)} -> {version}")
    if birth["machine"] != now["machine"]:
        notes.append(f"machine {birth['machine']} -> {now['machine']}")
    return notes


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return value.value if isinstance(value, Change) else plain(value)
