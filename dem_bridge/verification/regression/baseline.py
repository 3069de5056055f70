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

from dem_bridge.backends.base import Sampling
from dem_bridge.errors import OF_DAMAGED_DATA, UsageError
from dem_bridge.foundation.files import text_of_file
from dem_bridge.foundation.numbers import is_within
from dem_bridge.observables.verdict import plain
from dem_bridge.trajectory.trajectory import Cost, Floats, Trajectory, Uncertainty
from dem_bridge.version import schema_fault

SCHEMA = "dem-bridge/baseline/2"
#: the first has no fingerprint of the last digits of its machine
_FIRST = "dem-bridge/baseline/1"
#: quantities of a run in a baseline
QUANTITIES = ("velocity", "peak_force", "crossing_time")
#: the data: form of a file and of its entries of accuracy; an entry is an object with these keys, a list of one form, a
#: number, text or an object (or null), or any of them
#: form of a baseline, and of an entry of its accuracy: kinds of values, "or null" where they may be missing
_FORM: dict[str, Any] = {
    "schema": "text",
    "scene": "text",
    "backend": "text",
    "birth": {
        "date": "text",
        "package": "text",
        "scene_hash": "text",
        "source": "text",
        "deck_hash": "text or null",
        "lammps": "object or null",
        "versions": "object",
        "machine": "text",
        "digits": "text",
        "solved_with": "object",
    },
    "settings": {"dt": "number or null", "samples": "number", "tolerance": "number"},
    "same_within": {
        "velocity": {"value": "number", "reason": "text"},
        "peak_force": {"value": "number", "reason": "text"},
        "crossing_time": {"value": "number", "reason": "text"},
    },
    "accuracy": "any",
    "velocity_bar": "number or null",
    "counts": {"times": "number", "bodies": "number", "contacts": "number"},
    "digests": {
        "velocity": {"in_order": "text", "sorted": "text"},
        "peak_force": {"in_order": "text", "sorted": "text"},
        "crossing_time": {"in_order": "text", "sorted": "text"},
    },
    "time": ["number"],
    "bodies": [{"body": "number", "velocity": ["number"]}],
    "contacts": [
        {
            "contact": "number",
            "peak_force": "number",
            "crossing_time": "number or null",
            "peak_force_bar": "number or null",
            "crossing_time_bar": "number or null",
        }
    ],
}
_ACCURACY_FORM = {
    "error": "number or null",
    "bar": "number or null",
    "tolerance": "number or null",
    "outcome": "text",
    "by": "text",
}
_FIRST_FORM = _FORM | {"birth": {key: form for key, form in _FORM["birth"].items() if key != "digits"}}
LARGEST_DOUBLE = float(np.finfo(float).max)
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

    def as_file(self) -> dict[str, Any]:
        """Return the entry of a file, in which the uncertainty has the key ``bar``."""
        return {"bar" if key == "uncertainty" else key: plain(value) for key, value in vars(self).items()}

    @classmethod
    def of_file(cls, entry: Mapping[str, Any]) -> Accuracy:
        """Return the accuracy of an entry of a file."""
        values: dict[str, Any] = {key: math.inf if value is None else value for key, value in entry.items()}
        return cls(uncertainty=values.pop("bar"), **values)


@dataclass(frozen=True, kw_only=True, eq=False)
class Baseline:
    """Hold an earlier result of a scene and backend with its provenance."""

    scene: str
    """Name of the scene."""
    backend: str
    """Name of the backend."""
    provenance: Mapping[str, Any]
    """date, package (its version), scene_hash, source, deck_hash, lammps, versions, machine, solved_with; digits (the
    fingerprint of its place) but in files of the first schema."""
    dt: float | None
    """Upper bound of the time step, s; None if the backend has no fixed step."""
    tolerance: float
    """Relative tolerance of the velocity error."""
    same_within: Mapping[str, RoundoffTolerance]
    """Differences, by quantity, up to which a run is SAME."""
    accuracy: Mapping[str, Accuracy]
    """Errors at the time the baseline was written, by quantity; empty without a reference."""
    run: Trajectory
    """Samples of the velocity, peak forces and crossing times with their uncertainties; other quantities are unknown in
    a baseline that was read."""
    edited: tuple[str, ...] = ()
    """Quantities whose numbers were changed after the file was written."""

    @property
    def file_name(self) -> str:
        """Return the name of the file of this baseline."""
        return f"{self.scene}.{self.backend}.json"

    @property
    def sampling(self) -> Sampling:
        """Return the sampling with which the run is repeated."""
        return Sampling(count=len(self.run.time) - 1)

    def text(self) -> str:
        """Return the baseline as JSON with a line for each body and contact."""
        run, uncertainty = self.run, self.run.uncertainty
        head = {
            "schema": SCHEMA if "digits" in self.provenance else _FIRST,
            "scene": self.scene,
            "backend": self.backend,
            "birth": dict(self.provenance),
            "settings": {"dt": self.dt, "samples": len(run.time) - 1, "tolerance": self.tolerance},
            "same_within": {name: vars(tolerance) for name, tolerance in self.same_within.items()},
            "accuracy": {name: accuracy.as_file() for name, accuracy in self.accuracy.items()},
            "velocity_bar": plain(float(uncertainty["velocity"])),
            "counts": {"times": len(run.time), "bodies": run.velocity.shape[1], "contacts": len(run.peak_force)},
            "digests": {name: _digests(getattr(run, name)) for name in QUANTITIES},
        }
        bodies = [{"body": i, "velocity": column.tolist()} for i, column in enumerate(run.velocity.T)]
        columns = {name: getattr(run, name).tolist() for name in QUANTITIES[1:]}
        columns |= {f"{name}_bar": uncertainty[name].tolist() for name in QUANTITIES[1:]}
        contacts = [
            {"contact": k} | dict(zip(columns, map(plain, row), strict=True))
            for k, row in enumerate(zip(*columns.values(), strict=True))
        ]
        parts = [f" {json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in head.items()]
        parts.append(f' "time": {json.dumps(run.time.tolist())}')
        for key, rows in (("bodies", bodies), ("contacts", contacts)):
            lines = ",\n".join(f"  {json.dumps(row, allow_nan=False)}" for row in rows)
            parts.append(f' "{key}": [\n{lines}\n ]' if rows else f' "{key}": []')
        return "{\n" + ",\n".join(parts) + "\n}\n"


def read_baseline(path: Path) -> Baseline:
    """Read a baseline from a file; raise UsageError with the file and the fault if it is not valid."""
    try:
        text = text_of_file(path)
    except OSError as error:
        raise UsageError(
            f"{path}: the file cannot be read ({error.strerror}); allowed: a baseline written by regress --update"
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
    except _InvalidBaseline:
        raise
    except (ValueError, RecursionError) as error:  # also a number of thousands of digits, or thousands of brackets
        raise _InvalidBaseline(f"the file is not JSON or is truncated: {error}") from error
    if not isinstance(document, dict) or document.get("schema") not in (_FIRST, SCHEMA):
        schema = document.get("schema") if isinstance(document, dict) else None
        raise _InvalidBaseline(schema_fault(schema, _FIRST, SCHEMA))
    _check("", document, _FORM if document["schema"] == SCHEMA else _FIRST_FORM)
    entries = document["accuracy"] if isinstance(document["accuracy"], dict) else {}
    _check("accuracy", document["accuracy"], dict.fromkeys(entries, _ACCURACY_FORM))
    try:
        return _parse(document)
    except _InvalidBaseline:
        raise
    except OF_DAMAGED_DATA as error:
        raise _InvalidBaseline(f"the entries contradict each other ({type(error).__name__})") from error


def _check(where: str, value: Any, form: Any) -> None:
    """Raise an error that names the entry unless ``value`` has a form, as in ``_FORM``; numbers must be finite."""
    if isinstance(form, dict):
        if not isinstance(value, dict):
            raise _InvalidBaseline(f"{where} = {value!r}; allowed: an object with {', '.join(form)}")
        prefix = f"{where}." if where else ""
        if unknown := [key for key in value if key not in form]:
            raise _InvalidBaseline(f"{prefix}{unknown[0]} is unknown; allowed: {', '.join(form)}")
        for key, inner in form.items():
            if key not in value:
                raise _InvalidBaseline(f"{prefix}{key} is missing")
            _check(f"{prefix}{key}", value[key], inner)
    elif isinstance(form, list):
        if not isinstance(value, list):
            raise _InvalidBaseline(f"{where} = {value!r}; allowed: a list")
        for k, entry in enumerate(value):
            _check(f"{where}[{k}]", entry, form[0])
    else:
        number = is_within(value)
        fits = {
            "text": isinstance(value, str),
            "number": number,
            "object": isinstance(value, dict),
            "any": True,
        }
        if not (fits[form.removesuffix(" or null")] or (value is None and form.endswith(" or null"))):
            allowed = {"text": "text", "object": "an object"}.get(form.removesuffix(" or null"), "a finite number")
            raise _InvalidBaseline(f"{where} = {value!r}; allowed: {allowed}")


def _parse(document: Mapping[str, Any]) -> Baseline:
    """Return the baseline of a JSON document whose entries have the right form."""
    counts, settings = document["counts"], document["settings"]
    time = _times(document["time"], counts["times"], settings["samples"])
    for key, index in (("bodies", "body"), ("contacts", "contact")):
        _check_rows(key, index, document[key], counts[key])
    for i, row in enumerate(document["bodies"]):
        if len(row["velocity"]) != len(time):
            raise _InvalidBaseline(
                f"bodies[{i}].velocity has {len(row['velocity'])} values for {len(time)} times; the file is truncated"
            )
    for name, entry in document["same_within"].items():
        if entry["value"] < 0.0:
            raise _InvalidBaseline(f"same_within.{name}.value = {entry['value']!r}; allowed: a number >= 0")

    def column(name: str, null: float) -> Floats:
        """Return a column of the contacts; null is "no crossing" for a crossing time and "unknown" elsewhere."""
        return np.array([_number(row[name], null) for row in document["contacts"]])

    velocity = np.array([row["velocity"] for row in document["bodies"]], dtype=np.float64).T
    uncertainty: dict[str, Any] = {name: column(f"{name}_bar", math.inf) for name in QUANTITIES[1:]}
    uncertainty |= {"velocity": _number(document["velocity_bar"], math.inf), "displacement": math.inf}
    run = Trajectory(
        time=time,
        displacement=math.nan * velocity,
        velocity=velocity,
        contact_force=np.full((len(time), len(document["contacts"])), math.nan),
        peak_force=column("peak_force", math.nan),
        crossing_time=column("crossing_time", math.nan),
        uncertainty=Uncertainty(**uncertainty),
        cost=_UNKNOWN,
        provenance=document["birth"],
    )
    return Baseline(
        scene=document["scene"],
        backend=document["backend"],
        provenance=document["birth"],
        dt=settings["dt"],
        tolerance=float(settings["tolerance"]),
        same_within={name: RoundoffTolerance(**document["same_within"][name]) for name in QUANTITIES},
        accuracy={name: Accuracy.of_file(entry) for name, entry in document["accuracy"].items()},
        run=run,
        edited=tuple(name for name in QUANTITIES if _is_edited(name, getattr(run, name), document["digests"][name])),
    )


def _number(value: float | None, null: float) -> float:
    """Return a number, or ``null`` for None."""
    return null if value is None else float(value)


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


def _times(time: list[float], count: int, samples: int) -> Floats:
    """Return the sample times; raise an error unless they are equal steps from 0."""
    if len(time) != count or count != samples + 1:
        raise _InvalidBaseline(
            f"time has {len(time)} values for counts.times = {count} and {samples} samples; the file is truncated"
        )
    for k, (earlier, later) in enumerate(pairwise(time)):
        if not later > earlier:
            raise _InvalidBaseline(f"time[{k + 1}] = {later!r} is not after time[{k}] = {earlier!r}; allowed: in order")
    for k, (value, step) in enumerate(zip(time, np.linspace(0.0, time[-1], count).tolist(), strict=True)):
        if not math.isclose(value, step, rel_tol=1e-12):
            raise _InvalidBaseline(f"time[{k}] = {value!r}; allowed: {samples} equal steps from 0 to {time[-1]!r}")
    return np.array(time, dtype=np.float64)


def _check_rows(key: str, index: str, rows: Sequence[Mapping[str, Any]], count: int) -> None:
    """Raise an error unless all rows of bodies or contacts are there, in order."""
    for k, row in enumerate(rows):
        if row[index] != k:
            raise _InvalidBaseline(
                f"{key}[{k}].{index} = {row[index]!r}; allowed: {k}; lines are in another order or missing"
            )
    if len(rows) != count:
        raise _InvalidBaseline(f"{key} has {len(rows)} lines for counts.{key} = {count}; the file is truncated")


def _refuse_constant(word: str) -> float:
    """Raise an error for NaN and Infinity, which JSON does not have."""
    raise _InvalidBaseline(f"{word} is not a number of JSON; allowed: finite numbers and null")
