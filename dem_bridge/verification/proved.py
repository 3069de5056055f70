"""Compare the runs of a scene with its proved motion, where the checkout has a certificate of ``dem-bridge prove``.

Certificates are files of ``reports/proofs``, which an installed package has not. They are read as they are: JSON with
midpoints, and radii within which the true motion is proved to be. Nothing here needs the library of proofs.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from dem_bridge.errors import OF_DAMAGED_DATA
from dem_bridge.report.study import Table
from dem_bridge.report.texts import Texts
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import SAMPLED, Floats, Trajectory
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.reference_choice import REFERENCE

TEXTS = Texts("proved", "dem_bridge.verification")
COLUMNS = (
    "scene", "quantity", "LAMMPS - proved", "reference - proved", "stated uncertainty of reference", "relative to",
    "proved up to (s)", "certificate",
)  # fmt: skip
#: certificates of a checkout
FOLDER = Path(__file__).parents[2] / "reports" / "proofs"
#: schema of a certificate
SCHEMA = "dem-bridge/proof/1"
#: two roundings of a double, relative
_ROUNDED = 3e-16
#: values of contacts are compared with themselves, but at least with this part of the largest
_SMALLEST = 1e-3
_QUANTITIES = {
    "velocity": "largest velocity",
    "displacement": "largest displacement",
    "peak_force": "each contact's own force",
    "crossing_time": "each contact's own time",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class ProvedMotion:
    """What a certificate proves of a scene: midpoints and radii by quantity, at every ``stride``-th of its samples."""

    file: Path
    stride: int
    until: float
    """Time up to which the motion is proved, s."""
    values: Mapping[str, tuple[Floats, Floats]]

    @property
    def link(self) -> str:
        """Return the name of the certificate in the folder of a report."""
        return f"proofs/{self.file.name}"

    def difference(self, quantity: str, run: Trajectory) -> float:
        """Return an upper bound of the largest difference of a run from the true motion, relative."""
        middle, radius = self.values[quantity]
        values = np.asarray(getattr(run, quantity), dtype=float)
        if quantity in SAMPLED:
            values = values[:: self.stride][: len(middle)]
        missing = np.isnan(values) & np.isfinite(middle)
        return self._relative(quantity, np.where(missing, math.inf, np.abs(values - middle) + radius))

    def uncertainty(self, quantity: str, run: Trajectory) -> float:
        """Return the uncertainty that a run states, on the same scale."""
        return self._relative(quantity, np.asarray(run.uncertainty[quantity]))

    def _relative(self, quantity: str, errors: Floats) -> float:
        """Return the largest of some errors relative to the scale of a quantity, where a value is proved."""
        middle = np.abs(self.values[quantity][0])
        largest = np.max(middle, where=np.isfinite(middle), initial=0.0)
        scale = np.maximum(middle, _SMALLEST * largest)  # nan where nothing is proved
        relative = errors / (largest if quantity in SAMPLED else scale)
        return float(np.max(relative, where=~np.isnan(relative), initial=0.0))


def proved_motion(scene: Scene) -> ProvedMotion | None:
    """Return the proved motion of a scene; None unless a certificate has the same numbers, and samples in common."""
    file = FOLDER / f"{scene.name}.json"
    document = _read(file)
    if document is None:
        return None
    count = int(document["scene"]["count"])
    same = replace(scene, samples=count).content_hash == document["scene"]["hash"]
    if not same or scene.samples % count:
        return None
    values = {**_samples(file)}
    until = _number(document["proved_until"])
    if until == scene.duration and document.get("peaks"):
        values["peak_force"] = _forces(scene, document["peaks"])
    if document.get("crossings"):
        times = [[math.nan, math.inf] if entry in (None, "none") else _ball(entry) for entry in document["crossings"]]
        values["crossing_time"] = np.array(times)[:, 0], np.array(times)[:, 1]
    return ProvedMotion(file=file, stride=scene.samples // count, until=until, values=values)


@cache
def _read(file: Path) -> dict[str, Any] | None:
    """Return a certificate; None where there is none, or one that is damaged."""
    try:
        document: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        rest = {key: value for key, value in document.items() if key != "digest"}
        digest = hashlib.sha256(json.dumps(rest, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
        return document if document["schema"] == SCHEMA and document["digest"] == digest else None
    except (OSError, *OF_DAMAGED_DATA):
        return None


@cache
def _samples(file: Path) -> dict[str, tuple[Floats, Floats]]:
    """Return midpoints and radii of a certificate at its samples.

    They are kept, because a page that is written again and again while runs go on needs them each time.
    """
    document = _read(file)
    samples = {} if document is None else document["samples"]
    powers = samples.get("power", dict.fromkeys(SAMPLED, 0))
    return {name: _balls(samples[name], powers[name]) for name in SAMPLED if samples}


def _number(text: str) -> float:
    """Return a decimal or a ratio as a double."""
    over, _, under = text.partition("/")
    return int(over) / int(under) if under else float(text)


def _ball(entry: str | list[str], power: int = 0) -> tuple[float, float]:
    """Return midpoint and radius, with the rounding to doubles; one decimal has the radius of its last digit.

    A decimal that has no power of ten is in units of ``10^power``.

    >>> middle, radius = _ball("12e-1")
    >>> middle, round(radius, 12)
    (1.2, 0.1)
    """
    if isinstance(entry, str):
        mantissa, _, own = entry.partition("e")
        middle, radius = float(f"{mantissa}e{own or power}"), float(f"1e{own or power}")
    else:
        middle, radius = map(_number, entry)
    return middle, radius * (1.0 + _ROUNDED) + _ROUNDED * abs(middle)


def _balls(rows: Sequence[Sequence[str]], power: int) -> tuple[Floats, Floats]:
    both = np.array([[_ball(entry, power) for entry in row] for row in rows])
    return both[..., 0], both[..., 1]


def _forces(scene: Scene, peaks: Sequence[Mapping[str, Any] | None]) -> tuple[Floats, Floats]:
    """Return the forces at the largest overlaps, N; nan where one is not established."""
    overlaps = np.array([[math.nan, math.inf] if peak is None else _ball(peak["overlap"]) for peak in peaks])
    contacts = np.arange(len(peaks))
    middle = scene.contacts.force(np.maximum(overlaps[:, 0], 0.0), contacts)
    # the force is largest at the upper end, and grows by as much or less below the middle
    most = scene.contacts.force(np.maximum(overlaps[:, 0] + overlaps[:, 1], 0.0), contacts)
    return middle, most - middle + 4.0 * _ROUNDED * most


def proved_table(studies: Sequence[SceneStudy]) -> Table | None:
    """Return the differences of LAMMPS and reference from each proved motion; None where no scene has one."""
    rows = [row for study in studies for row in _rows(study)]
    return TEXTS.table("proved", COLUMNS, rows) if rows else None


def largest_proved_error(studies: Sequence[SceneStudy]) -> float:
    """Return an upper bound of LAMMPS' largest difference from the proved velocities of all these scenes, relative.

    It is nan unless all of them are proved up to their ends, and LAMMPS ran.
    """
    largest = 0.0
    for study in studies:
        motion, run = proved_motion(study.scene), study.run(study.engine)
        if motion is None or run is None or motion.until != study.scene.duration:
            return math.nan
        largest = max(largest, motion.difference("velocity", run))
    return largest if studies else math.nan


def proved_sentence(study: SceneStudy) -> str:
    """Return by how much LAMMPS differs from the proved velocities of a scene; empty where there are none."""
    motion, run = proved_motion(study.scene), study.run(study.engine)
    if motion is None or run is None:
        return ""
    return TEXTS(
        "sentence", difference=motion.difference("velocity", run), until=motion.until, certificate=motion.file.name
    )


def _rows(study: SceneStudy) -> Iterator[tuple[str | float, ...]]:
    motion = proved_motion(study.scene)
    if motion is None:
        return
    lammps, reference = (study.run(name) for name in (study.engine, REFERENCE))
    for quantity in motion.values:
        yield (
            study.scene.name,
            quantity.replace("_", " "),
            math.nan if lammps is None else motion.difference(quantity, lammps),
            math.nan if reference is None else motion.difference(quantity, reference),
            math.nan if reference is None else motion.uncertainty(quantity, reference),
            _QUANTITIES[quantity],
            motion.until,
            motion.link,
        )
