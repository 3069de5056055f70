"""Baselines: earlier results of a scene and backend, written to and read from small JSON files.

A file has a line for each body with its velocities at a few times, and a line for each contact with its peak force and
crossing time; every number has all its digits. Digests detect changes: a file with a changed number is read and the
change is noted; a file that is truncated or has its numbers in another order raises an error. The keys of the files
(``birth`` for the provenance, ``velocity_bar`` for an uncertainty) are those of the first version.
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
#: quantities of a run in a baseline
QUANTITIES = ("velocity", "peak_force", "crossing_time")
_CONTACT = ("peak_force", "crossing_time", "peak_force_bar", "crossing_time_bar")
_KEYS = (
    "schema", "scene", "backend", "birth", "settings", "same_within", "accuracy", "velocity_bar",
    "counts", "digests", "time", "bodies", "contacts",
)  # fmt: skip
_BIRTH = ("date", "package", "scene_hash", "source", "deck_hash", "lammps", "versions", "machine", "solved_with")
_SETTINGS = ("dt", "samples", "tolerance")
#: keys in files that differ from the names of attributes
_FILE_KEY = {"uncertainty": "bar"}
_UNKNOWN = Cost(wall=math.nan, cpu=math.nan, steps=0, force_evaluations=0)


@dataclass(frozen=True, kw_only=True)
class RoundoffTolerance:
    """Hold the difference between two correct builds that round-off alone explains."""

    value: float
    """Difference, relative to the largest |velocity| or to the value of each contact."""
    reason: str
    """Sentence on how the value was measured."""


@dataclass(frozen=True, kw_only=True)
class Accuracy:
    """Hold the relative error of one quantity against a reference, with its tolerance and outcome."""

    error: float
    uncertainty: float
    """Relative uncertainty of the reference."""
    tolerance: float
    """The tolerance of the baseline; for peak forces and crossing times at least the uncertainty of the run."""
    outcome: str
    """PASS, FAIL or UNDECIDED."""
    by: str
    """Backend of the reference."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Baseline:
    """Hold an earlier result of a scene and backend with its provenance."""

    scene: str
    """Name of the scene."""
    backend: str
    """Name of the backend."""
    provenance: Mapping[str, Any]
    """date, package (its version), scene_hash, source, deck_hash, lammps, versions, machine, solved_with."""
    dt: float | None
    """Upper bound of the time step, s; None if the backend has no fixed step."""
    tolerance: float
    """Relative tolerance of the velocity error."""
    same_within: Mapping[str, RoundoffTolerance]
    """Differences, by quantity, up to which a run is SAME."""
    accuracy: Mapping[str, Accuracy]
    """Errors at the time the baseline was written, by quantity; empty without a reference."""
    time: Floats
    """Sample times, ``(n_t,)``, s."""
    velocity: Floats
    """Velocities, ``(n_t, n_body)``, m/s."""
    peak_force: Floats
    """Peak forces, ``(n_contact,)``, N."""
    crossing_time: Floats
    """Crossing times, ``(n_contact,)``, s; nan for a contact that has none."""
    uncertainty: Mapping[str, Any]
    """Uncertainties of the run by quantity, in the units of the quantities, as in a Trajectory."""
    edited: tuple[str, ...] = ()
    """Quantities whose numbers were changed after the file was written."""

    @property
    def file_name(self) -> str:
        """Return the name of the file of this baseline."""
        return f"{self.scene}.{self.backend}.json"

    @property
    def resolution(self) -> Resolution:
        """Return the settings with which the run is repeated."""
        return Resolution(dt=self.dt)

    @property
    def sampling(self) -> Sampling:
        """Return the sampling with which the run is repeated."""
        return Sampling(count=len(self.time) - 1)

    def as_trajectory(self) -> Trajectory:
        """Return the baseline as a trajectory; displacements and contact forces are unknown (nan)."""
        unknown = math.nan * self.velocity
        return Trajectory(
            time=self.time,
            displacement=unknown,
            velocity=self.velocity,
            contact_force=np.full((len(self.time), len(self.peak_force)), math.nan),
            peak_force=self.peak_force,
            crossing_time=self.crossing_time,
            uncertainty=Uncertainty(displacement=math.inf, **self.uncertainty),
            cost=_UNKNOWN,
            provenance=dict(self.provenance),
        )

    def text(self) -> str:
        """Return the baseline as JSON with a line for each body and contact."""
        head = {
            "schema": SCHEMA,
            "scene": self.scene,
            "backend": self.backend,
            "birth": dict(self.provenance),
            "settings": {"dt": self.dt, "samples": len(self.time) - 1, "tolerance": self.tolerance},
            "same_within": {name: vars(tolerance) for name, tolerance in self.same_within.items()},
            "accuracy": {
                name: {_FILE_KEY.get(key, key): plain(value) for key, value in vars(accuracy).items()}
                for name, accuracy in self.accuracy.items()
            },
            "velocity_bar": plain(float(self.uncertainty["velocity"])),
            "counts": {"times": len(self.time), "bodies": self.velocity.shape[1], "contacts": len(self.peak_force)},
            "digests": {name: _digests(getattr(self, name)) for name in QUANTITIES},
        }
        bodies = [{"body": i, "velocity": column.tolist()} for i, column in enumerate(self.velocity.T)]
        columns = [
            self.peak_force,
            self.crossing_time,
            np.asarray(self.uncertainty["peak_force"]),
            np.asarray(self.uncertainty["crossing_time"]),
        ]
        contacts = [
            {"contact": k} | {name: plain(float(column[k])) for name, column in zip(_CONTACT, columns, strict=True)}
            for k in range(len(self.peak_force))
        ]
        parts = [f" {json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in head.items()]
        parts.append(f' "time": {json.dumps(self.time.tolist())}')
        for key, rows in (("bodies", bodies), ("contacts", contacts)):
            lines = ",\n".join(f"  {json.dumps(row, allow_nan=False)}" for row in rows)
            parts.append(f' "{key}": [\n{lines}\n ]' if rows else f' "{key}": []')
        return "{\n" + ",\n".join(parts) + "\n}\n"


def read_baseline(path: Path) -> Baseline:
    """Read a baseline from a file; raise UsageError with the file and the fault if it is not valid."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(
            f"{path}: the file cannot be read ({error}); allowed: a baseline written by regress --update"
        ) from error
    try:
        baseline = baseline_of_text(text)
        if baseline.file_name != path.name:
            raise _InvalidBaseline(f"the file contains the baseline {baseline.file_name}; allowed: a file of that name")
    except _InvalidBaseline as error:
        raise UsageError(
            f"{path}: {error}; restore it from version control, or write it again with regress --update"
        ) from error
    return baseline


class _InvalidBaseline(UsageError):
    """Report a fault in the text of a baseline; the reader of the file adds the file's name."""


def baseline_of_text(text: str) -> Baseline:
    """Return the baseline that :meth:`Baseline.text` wrote; raise UsageError for any other text."""
    try:
        document = json.loads(text, parse_constant=_refuse_constant)
    except json.JSONDecodeError as error:
        raise _InvalidBaseline(f"the file is not JSON or is truncated: {error}") from error
    if not isinstance(document, dict) or document.get("schema") != SCHEMA:
        schema = document.get("schema") if isinstance(document, dict) else None
        raise _InvalidBaseline(f"schema = {schema!r}; allowed: {SCHEMA!r}")
    _keys("", document, _KEYS)
    _keys("birth.", document["birth"], _BIRTH)
    _keys("settings.", document["settings"], _SETTINGS)
    for name in ("same_within", "digests"):
        _keys(f"{name}.", document[name], QUANTITIES)
    _keys("counts.", document["counts"], ("times", "bodies", "contacts"))
    try:
        return _parse(document)
    except (KeyError, TypeError, ValueError) as error:
        if isinstance(error, _InvalidBaseline):
            raise
        raise _InvalidBaseline(f"an entry is missing or has a wrong type ({type(error).__name__}: {error})") from error


def _parse(document: Mapping[str, Any]) -> Baseline:
    """Return the baseline of a JSON document whose keys are valid."""
    counts, samples = document["counts"], document["settings"]["samples"]
    time = _times(document["time"], counts["times"], samples)
    bodies = _rows("bodies", "body", document["bodies"], counts["bodies"], ("velocity",))
    contacts = _rows("contacts", "contact", document["contacts"], counts["contacts"], _CONTACT)
    for i, row in enumerate(bodies):
        if len(row["velocity"]) != len(time):
            raise _InvalidBaseline(
                f"bodies[{i}].velocity has {len(row['velocity'])} values for {len(time)} times; the file is truncated"
            )
    velocity = np.array([_finite(f"bodies[{i}].velocity", row["velocity"]) for i, row in enumerate(bodies)]).T
    # null is "no crossing" for a crossing time and "unknown" for an uncertainty
    empty = {name: math.nan if name == "crossing_time" else math.inf for name in _CONTACT}
    columns = {
        name: np.array([empty[name] if row[name] is None else _number(name, row[name]) for row in contacts])
        for name in _CONTACT
    }
    _finite("contacts.peak_force", columns["peak_force"].tolist())
    values = {"velocity": velocity, **{name: columns[name] for name in ("peak_force", "crossing_time")}}
    velocity_uncertainty = document["velocity_bar"]
    dt = document["settings"]["dt"]
    return Baseline(
        scene=_text("scene", document["scene"]),
        backend=_text("backend", document["backend"]),
        provenance=document["birth"],
        dt=None if dt is None else _number("settings.dt", dt),
        tolerance=_number("settings.tolerance", document["settings"]["tolerance"]),
        same_within={name: _tolerance(name, document["same_within"][name]) for name in QUANTITIES},
        accuracy={name: _accuracy(name, entry) for name, entry in document["accuracy"].items()},
        time=time,
        **values,
        uncertainty={
            "velocity": math.inf if velocity_uncertainty is None else _number("velocity_bar", velocity_uncertainty),
            "peak_force": columns["peak_force_bar"],
            "crossing_time": columns["crossing_time_bar"],
        },
        edited=tuple(name for name in QUANTITIES if _is_edited(name, values[name], document["digests"][name])),
    )


def _digests(values: Floats) -> dict[str, str]:
    """Return the digests of the numbers in order and sorted, which distinguish another order from other values."""
    numbers = np.asarray(values).ravel() + 0.0
    return {"in_order": _sha(numbers.tolist()), "sorted": _sha(np.sort(numbers).tolist())}


def _sha(numbers: Sequence[float]) -> str:
    """Return a digest of the numbers with all digits."""
    return hashlib.sha256("\n".join(map(repr, numbers)).encode()).hexdigest()[:16]


def _is_edited(name: str, values: Floats, written: Mapping[str, str]) -> bool:
    """Return True if values differ from those that were written; raise an error if only their order differs."""
    digests = _digests(values)
    if digests["in_order"] == written["in_order"]:
        return False
    if digests["sorted"] == written["sorted"]:
        raise _InvalidBaseline(f"the values of {name} are in another order than they were written")
    return True


def _times(values: Any, count: int, samples: int) -> Floats:
    """Return the sample times; raise an error unless they are equal steps from 0."""
    time = _finite("time", values)
    if len(time) != count or count != samples + 1:
        raise _InvalidBaseline(
            f"time has {len(time)} values for counts.times = {count} and {samples} samples; the file is truncated"
        )
    for k, (earlier, later) in enumerate(pairwise(time)):
        if not later > earlier:
            raise _InvalidBaseline(f"time[{k + 1}] = {later!r} is not after time[{k}] = {earlier!r}; allowed: in order")
    even = np.linspace(0.0, time[-1], count)
    for k, (value, step) in enumerate(zip(time, even.tolist(), strict=True)):
        if not math.isclose(value, step, rel_tol=1e-12):
            raise _InvalidBaseline(f"time[{k}] = {value!r}; allowed: {samples} equal steps from 0 to {time[-1]!r}")
    return np.array(time)


def _rows(key: str, index: str, values: Any, count: int, columns: tuple[str, ...]) -> list[dict[str, Any]]:
    """Return the rows of bodies or contacts; raise an error unless all are there, in order."""
    rows = list(values)
    for k, row in enumerate(rows):
        _keys(f"{key}[{k}].", row, (index, *columns))
        if row[index] != k:
            raise _InvalidBaseline(
                f"{key}[{k}].{index} = {row[index]!r}; allowed: {k}; lines are in another order or missing"
            )
    if len(rows) != count:
        raise _InvalidBaseline(f"{key} has {len(rows)} lines for counts.{key} = {count}; the file is truncated")
    return rows


def _keys(where: str, value: Any, allowed: Sequence[str]) -> None:
    """Raise an error unless ``value`` is an object with exactly the keys ``allowed``."""
    if not isinstance(value, dict):
        raise _InvalidBaseline(f"{where.rstrip('.')} = {value!r}; allowed: an object with {', '.join(allowed)}")
    for key in value:
        if key not in allowed:
            raise _InvalidBaseline(f"{where}{key} is unknown; allowed: {', '.join(allowed)}")
    for key in allowed:
        if key not in value:
            raise _InvalidBaseline(f"{where}{key} is missing")


def _number(key: str, value: Any) -> float:
    """Return a finite number; raise an error for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise _InvalidBaseline(f"{key} = {value!r}; allowed: a finite number")
    return float(value)


def _finite(key: str, values: Any) -> list[float]:
    """Return a list of finite numbers; raise an error for anything else."""
    if not isinstance(values, list):
        raise _InvalidBaseline(f"{key} = {values!r}; allowed: a list of numbers")
    return [_number(f"{key}[{k}]", value) for k, value in enumerate(values)]


def _text(key: str, value: Any) -> str:
    """Return a text; raise an error for anything else."""
    if not isinstance(value, str):
        raise _InvalidBaseline(f"{key} = {value!r}; allowed: text")
    return value


def _tolerance(name: str, entry: Any) -> RoundoffTolerance:
    """Return the round-off tolerance of a quantity."""
    where = f"same_within.{name}."
    _keys(where, entry, ("value", "reason"))
    value = _number(f"{where}value", entry["value"])
    if value < 0.0:
        raise _InvalidBaseline(f"{where}value = {value!r}; allowed: a number >= 0")
    return RoundoffTolerance(value=value, reason=_text(f"{where}reason", entry["reason"]))


def _accuracy(name: str, entry: Any) -> Accuracy:
    """Return the accuracy of a quantity at the time the baseline was written."""
    numbers = ("error", "uncertainty", "tolerance")
    file_key = {key: _FILE_KEY.get(key, key) for key in numbers}
    _keys(f"accuracy.{name}.", entry, (*file_key.values(), "outcome", "by"))
    return Accuracy(
        **{key: math.inf if entry[k] is None else _number(k, entry[k]) for key, k in file_key.items()},
        outcome=_text("outcome", entry["outcome"]),
        by=_text("by", entry["by"]),
    )


def _refuse_constant(word: str) -> float:
    """Raise an error for NaN and Infinity, which JSON does not have."""
    raise _InvalidBaseline(f"{word} is not a number of JSON; allowed: finite numbers and null")
