"""An earlier outcome, kept as a small text that a person can read and a machine trusts only where it is whole.

One JSON file a scene and backend: a line for each body with its velocities at a few times, a line for each contact
with its peak force and crossing time, every number with all its digits. A file with a changed number is still an
outcome to be compared with; one that is cut short, or has the same numbers in another order, is refused.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.errors import UsageError
from dem_bridge.trajectory import Cost, Floats, Trajectory, Uncertainty
from dem_bridge.verification.verdict import plain

SCHEMA = "dem-bridge/baseline/1"
#: what a baseline has of a run
QUANTITIES = ("velocity", "peak_force", "crossing_time")
_CONTACT = ("peak_force", "crossing_time", "peak_force_bar", "crossing_time_bar")
_KEYS = (
    "schema", "scene", "backend", "birth", "settings", "same_within", "accuracy", "velocity_bar",
    "counts", "digests", "time", "bodies", "contacts",
)  # fmt: skip
_BIRTH = ("date", "package", "scene_hash", "source", "deck_hash", "lammps", "versions", "machine", "solved_with")
_SETTINGS = ("dt", "samples", "tolerance")
_UNKNOWN = Cost(wall=math.nan, cpu=math.nan, steps=0, force_evaluations=0)


@dataclass(frozen=True, kw_only=True)
class Within:
    """How far two honest builds may differ."""

    value: float
    """Relative: to the largest |velocity|, or to each contact's own value."""
    reason: str


@dataclass(frozen=True, kw_only=True)
class Accuracy:
    """Error of one quantity against a reference, relative, and what was made of it."""

    error: float
    bar: float
    """Of the reference."""
    tolerance: float
    """Of velocity what was wanted; of the others no less than the bar of the run."""
    outcome: str
    """PASS, FAIL or UNDECIDED."""
    by: str
    """Which reference."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Baseline:
    """An outcome with its birth certificate.

    ``time (n_t,)`` in s; ``velocity (n_t, n_body)`` in m/s; ``peak_force (n_contact,)`` in N and ``crossing_time`` in
    s, nan where there is none. ``bars``: of the run, in the units of the quantities, as in a Trajectory.
    """

    scene: str
    backend: str
    birth: Mapping[str, Any]
    """date, package (its version), scene_hash, source, deck_hash, lammps, versions, machine, solved_with."""
    dt: float | None
    """Step that was asked for, s; None: the backend has none."""
    tolerance: float
    """Of the accuracy verdict, relative."""
    same_within: Mapping[str, Within]
    accuracy: Mapping[str, Accuracy]
    """When it was made; empty where nothing judged it."""
    time: Floats
    velocity: Floats
    peak_force: Floats
    crossing_time: Floats
    bars: Mapping[str, Any]
    edited: tuple[str, ...] = ()
    """Quantities whose numbers are not those that were written."""

    @property
    def file_name(self) -> str:
        return f"{self.scene}.{self.backend}.json"

    @property
    def resolution(self) -> Resolution:
        return Resolution(dt=self.dt)

    @property
    def sampling(self) -> Sampling:
        return Sampling(count=len(self.time) - 1)

    def as_trajectory(self) -> Trajectory:
        """As far as it goes: displacements and contact forces are nan."""
        nothing = math.nan * self.velocity
        return Trajectory(
            time=self.time,
            displacement=nothing,
            velocity=self.velocity,
            contact_force=np.full((len(self.time), len(self.peak_force)), math.nan),
            peak_force=self.peak_force,
            crossing_time=self.crossing_time,
            uncertainty=Uncertainty(displacement=math.inf, **self.bars),
            cost=_UNKNOWN,
            provenance=dict(self.birth),
        )

    def text(self) -> str:
        """JSON, a line for each body and contact."""
        head = {
            "schema": SCHEMA,
            "scene": self.scene,
            "backend": self.backend,
            "birth": dict(self.birth),
            "settings": {"dt": self.dt, "samples": len(self.time) - 1, "tolerance": self.tolerance},
            "same_within": {name: vars(one) for name, one in self.same_within.items()},
            "accuracy": {name: {k: plain(v) for k, v in vars(one).items()} for name, one in self.accuracy.items()},
            "velocity_bar": plain(float(self.bars["velocity"])),
            "counts": {"times": len(self.time), "bodies": self.velocity.shape[1], "contacts": len(self.peak_force)},
            "digests": {name: _digests(getattr(self, name)) for name in QUANTITIES},
        }
        bodies = [{"body": i, "velocity": column.tolist()} for i, column in enumerate(self.velocity.T)]
        columns = [
            self.peak_force,
            self.crossing_time,
            np.asarray(self.bars["peak_force"]),
            np.asarray(self.bars["crossing_time"]),
        ]
        contacts = [
            {"contact": k} | {name: plain(float(one[k])) for name, one in zip(_CONTACT, columns, strict=True)}
            for k in range(len(self.peak_force))
        ]
        parts = [f" {json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in head.items()]
        parts.append(f' "time": {json.dumps(self.time.tolist())}')
        for key, rows in (("bodies", bodies), ("contacts", contacts)):
            lines = ",\n".join(f"  {json.dumps(row, allow_nan=False)}" for row in rows)
            parts.append(f' "{key}": [\n{lines}\n ]' if rows else f' "{key}": []')
        return "{\n" + ",\n".join(parts) + "\n}\n"


def read_baseline(path: Path) -> Baseline:
    """The baseline in a file; UsageError with the file's name and what is wrong with it."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(
            f"{path}: cannot be read ({error}); allowed: a baseline that regress --update wrote"
        ) from error
    try:
        found = baseline_of_text(text)
        if found.file_name != path.name:
            raise _Wrong(f"is the baseline {found.file_name}, under another name")
    except _Wrong as error:
        raise UsageError(
            f"{path}: {error}; take it from version control again, or make it anew with regress --update"
        ) from error
    return found


class _Wrong(UsageError):
    """What is wrong with a baseline, before its file is known."""


def baseline_of_text(text: str) -> Baseline:
    """The baseline that :meth:`Baseline.text` wrote; UsageError for anything that is not whole."""
    try:
        told = json.loads(text, parse_constant=_no_number)
    except json.JSONDecodeError as error:
        raise _Wrong(f"is no JSON, or is cut short: {error}") from error
    if not isinstance(told, dict) or told.get("schema") != SCHEMA:
        schema = told.get("schema") if isinstance(told, dict) else None
        raise _Wrong(f"schema = {schema!r}; this version reads {SCHEMA!r}")
    _keys("", told, _KEYS)
    _keys("birth.", told["birth"], _BIRTH)
    _keys("settings.", told["settings"], _SETTINGS)
    for name in ("same_within", "digests"):
        _keys(f"{name}.", told[name], QUANTITIES)
    _keys("counts.", told["counts"], ("times", "bodies", "contacts"))
    try:
        return _read(told)
    except (KeyError, TypeError, ValueError) as error:
        if isinstance(error, _Wrong):
            raise
        raise _Wrong(f"a part is missing or of the wrong kind ({type(error).__name__}: {error})") from error


def _read(told: Mapping[str, Any]) -> Baseline:
    counts, samples = told["counts"], told["settings"]["samples"]
    time = _times(told["time"], counts["times"], samples)
    bodies = _rows("bodies", "body", told["bodies"], counts["bodies"], ("velocity",))
    contacts = _rows("contacts", "contact", told["contacts"], counts["contacts"], _CONTACT)
    for i, row in enumerate(bodies):
        if len(row["velocity"]) != len(time):
            raise _Wrong(f"bodies[{i}].velocity has {len(row['velocity'])} values for {len(time)} times: truncated")
    velocity = np.array([_finite(f"bodies[{i}].velocity", row["velocity"]) for i, row in enumerate(bodies)]).T
    # null: none, of a crossing; nothing can be said, of a bar
    empty = {name: math.nan if name == "crossing_time" else math.inf for name in _CONTACT}
    columns = {
        name: np.array([empty[name] if row[name] is None else _number(name, row[name]) for row in contacts])
        for name in _CONTACT
    }
    _finite("contacts.peak_force", columns["peak_force"].tolist())
    values = {"velocity": velocity, **{name: columns[name] for name in ("peak_force", "crossing_time")}}
    bar = told["velocity_bar"]
    dt = told["settings"]["dt"]
    return Baseline(
        scene=_text("scene", told["scene"]),
        backend=_text("backend", told["backend"]),
        birth=told["birth"],
        dt=None if dt is None else _number("settings.dt", dt),
        tolerance=_number("settings.tolerance", told["settings"]["tolerance"]),
        same_within={name: _within(name, told["same_within"][name]) for name in QUANTITIES},
        accuracy={name: _accuracy(name, one) for name, one in told["accuracy"].items()},
        time=time,
        **values,
        bars={
            "velocity": math.inf if bar is None else _number("velocity_bar", bar),
            "peak_force": columns["peak_force_bar"],
            "crossing_time": columns["crossing_time_bar"],
        },
        edited=tuple(name for name in QUANTITIES if _is_edited(name, values[name], told["digests"][name])),
    )


def _digests(values: Floats) -> dict[str, str]:
    """Of the numbers as they stand, and of the same numbers sorted: the two tell an order from a value."""
    numbers = np.asarray(values).ravel() + 0.0
    return {"in_order": _sha(numbers.tolist()), "sorted": _sha(np.sort(numbers).tolist())}


def _sha(numbers: Sequence[float]) -> str:
    return hashlib.sha256("\n".join(map(repr, numbers)).encode()).hexdigest()[:16]


def _is_edited(name: str, values: Floats, written: Mapping[str, str]) -> bool:
    found = _digests(values)
    if found["in_order"] == written["in_order"]:
        return False
    if found["sorted"] == written["sorted"]:
        raise _Wrong(f"the values of {name} are reordered: the same numbers as were written, in another order")
    return True


def _times(given: Any, count: int, samples: int) -> Floats:
    time = _finite("time", given)
    if len(time) != count or count != samples + 1:
        raise _Wrong(f"time has {len(time)} values for counts.times = {count} and {samples} samples: truncated")
    for k, (one, after) in enumerate(pairwise(time)):
        if not after > one:
            raise _Wrong(f"time[{k + 1}] = {after!r} is not after time[{k}] = {one!r}: reordered")
    even = np.linspace(0.0, time[-1], count)
    for k, (one, step) in enumerate(zip(time, even.tolist(), strict=True)):
        if not math.isclose(one, step, rel_tol=1e-12):
            raise _Wrong(f"time[{k}] = {one!r} is not one of {samples} equal steps to {time[-1]!r}")
    return np.array(time)


def _rows(key: str, index: str, given: Any, count: int, columns: tuple[str, ...]) -> list[dict[str, Any]]:
    rows = list(given)
    for k, row in enumerate(rows):
        _keys(f"{key}[{k}].", row, (index, *columns))
        if row[index] != k:
            raise _Wrong(f"{key}[{k}].{index} = {row[index]!r}; allowed: {k}: reordered, or a line is missing")
    if len(rows) != count:
        raise _Wrong(f"{key} has {len(rows)} lines for counts.{key} = {count}: truncated")
    return rows


def _keys(where: str, given: Any, allowed: Sequence[str]) -> None:
    if not isinstance(given, dict):
        raise _Wrong(f"{where.rstrip('.')} = {given!r}; allowed: an object with {', '.join(allowed)}")
    for key in given:
        if key not in allowed:
            raise _Wrong(f"{where}{key} is unknown; allowed: {', '.join(allowed)}")
    for key in allowed:
        if key not in given:
            raise _Wrong(f"{where}{key} is missing")


def _number(key: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise _Wrong(f"{key} = {value!r}; allowed: a finite number")
    return float(value)


def _finite(key: str, values: Any) -> list[float]:
    if not isinstance(values, list):
        raise _Wrong(f"{key} = {values!r}; allowed: a list of numbers")
    return [_number(f"{key}[{k}]", value) for k, value in enumerate(values)]


def _text(key: str, value: Any) -> str:
    if not isinstance(value, str):
        raise _Wrong(f"{key} = {value!r}; allowed: text")
    return value


def _within(name: str, given: Any) -> Within:
    where = f"same_within.{name}."
    _keys(where, given, ("value", "reason"))
    value = _number(f"{where}value", given["value"])
    if value < 0.0:
        raise _Wrong(f"{where}value = {value!r}; allowed: a number >= 0")
    return Within(value=value, reason=_text(f"{where}reason", given["reason"]))


def _accuracy(name: str, given: Any) -> Accuracy:
    numbers = ("error", "bar", "tolerance")
    _keys(f"accuracy.{name}.", given, (*numbers, "outcome", "by"))
    return Accuracy(
        **{key: math.inf if given[key] is None else _number(key, given[key]) for key in numbers},
        outcome=_text("outcome", given["outcome"]),
        by=_text("by", given["by"]),
    )


def _no_number(word: str) -> float:
    raise _Wrong(f"{word} is no number of JSON")
