"""Judge what files hold: which of their samples can be judged, their errors, the likely cause, and the step."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dem_bridge.errors import UsageError
from dem_bridge.formats.readers import Record, read_record
from dem_bridge.foundation.numbers import check_number
from dem_bridge.foundation.wording import share
from dem_bridge.judging.cause import diagnose
from dem_bridge.judging.diagnosis import Diagnosis, alternative
from dem_bridge.judging.judgement import EXPLAINED, Judgement
from dem_bridge.judging.model import MotionTooLong
from dem_bridge.judging.order import Convergence, convergence
from dem_bridge.judging.reference import FileErrors, QuantityErrors, file_errors
from dem_bridge.judging.step import errors_by_step, observed_curve, step_curve
from dem_bridge.observables.largest_step import ACCURACIES
from dem_bridge.scene.scene import Scene

#: multiple of the scene's duration beyond which a scene that stays together (walls, load, drive) is not continued
MOST_DURATIONS_CONTINUED = 20.0
#: largest value of a run that has not failed, in SI units
LARGEST_VALUE_SI = 1e100
#: most values of a quantity of a file that are judged; of larger files every second, third ... sample is taken
MOST_VALUES_OF_QUANTITY = 2_000_000
#: what reference or digits leave open, relative to the largest value, above which no file is called right
LARGEST_OPEN_SHARE = 0.01
#: names of units of time by their size, s
UNIT_NAMES = {1e-3: "ms", 1e-6: "µs", 1e-9: "ns"}


def judge_records(scene: Scene, records: Sequence[Record], *, tolerance: float | None = None) -> Judgement:
    """Judge what files hold against the reference solution of their scene.

    Raises
    ------
    UsageError
        For values that cannot be judged: not finite, a single sample, none later than the start, the same time step in
        two files, or a tolerance that is not between 0 and 1.
    UnsupportedScene
        If there is no reference solution of the scene.
    """
    if tolerance is not None:
        allowed = "a number between 0 and 1, relative to the largest value"
        tolerance = check_number("tolerance", tolerance, allowed, above=0.0, below=1.0)
    if not records:
        raise UsageError("no file was given; give at least one file of the scene")
    check_steps(records)
    for unit in units_of_time(scene, records):
        judgement = judge_records(scene, [in_unit(record, unit) for record in records], tolerance=tolerance)
        if judgement.cause in ("none", "units"):
            right = judgement.cause == "none"
            rest = "time step and digits explain the difference." if right else judgement.evidence
            diagnosis = Diagnosis(
                cause="units",
                alternatives=("time-scale",) if right else (),
                sentences=(alternative(f"All times are to be multiplied by {unit:g}.", "time-scale"),) if right else (),
                evidence=f"The times are in {UNIT_NAMES[unit]} ({1.0 / unit:.4g} times SI). With times in s: {rest}",
            )
            note = f"The errors are those of the files with times in a unit of {unit:g} s."
            return replace(judgement, diagnosis=diagnosis, time_unit=unit, assumed=(*judgement.assumed, note))
    judged, assumed = zip(*(usable(record, scene) for record in records), strict=True)
    files = file_errors(scene, judged)
    floor = {name: part.reference_uncertainty for file in files for name, part in file.quantities.items()}
    notes = [text for texts in assumed for text in texts]
    end = max(float(record.time[-1]) for record in judged)
    if end > scene.duration * (1.0 + 1e-9):
        notes.append(f"The scene ends at {scene.duration:.6g} s; the reference was continued to {end:.6g} s.")
    converging = convergence(files)
    diagnosis = _diagnosis(scene, files, floor, converging)
    judgement = Judgement(
        scene=scene,
        files=files,
        convergence=converging,
        diagnosis=diagnosis,
        tolerance=tolerance,
        assumed=tuple(notes),
    )
    name, (file, _) = next(iter(judgement.worst.items()))
    right = diagnosis.cause == "none" and name in judgement.order
    accuracies = ACCURACIES if tolerance is None else (*ACCURACIES, tolerance)
    curve = observed_curve(files, name) if right else None
    try:
        curve = curve or step_curve(scene, diagnosis, file, name, accuracies)
        by_step = errors_by_step(scene, diagnosis, judgement.judged[0]) if len(judgement.judged) == 1 else None
    except MotionTooLong as problem:
        return replace(judgement, assumed=(*notes, f"The largest steps are not answered, because {problem}."))
    return replace(judgement, step_curve=curve, by_step=by_step)


def judge_files(
    scene: Scene, files: Sequence[tuple[Path, float | None]], *, tolerance: float | None = None, **reading: Any
) -> Judgement:
    """Judge files with their time steps, s; ``reading`` are the keywords of :func:`read_record`."""
    return judge_records(scene, [read_record(path, scene, dt=dt, **reading) for path, dt in files], tolerance=tolerance)


def _diagnosis(
    scene: Scene, files: Sequence[FileErrors], floor: Mapping[str, float], converging: Sequence[Convergence]
) -> Diagnosis:
    """Return the likely cause; errors without a cause that fall to nothing with the time step are those of the step."""
    explained = not any(file.first_divergence(scene) for file in files)
    try:
        diagnosis = EXPLAINED if explained else diagnose(scene, [file.record for file in files], floor)
    except MotionTooLong as problem:
        words = f"The cause is not answered, because {problem}."
        return Diagnosis(cause="unknown", evidence=words, headline=words)
    if diagnosis.cause == "none" and (part := _without_reference(files)):
        name, size = part.quantity, part.relative(part.reference_uncertainty)
        return Diagnosis(
            cause="unknown",
            evidence=f"The reference is uncertain by {share(size)} of the largest {name} at these times, so that errors"
            " of the file cannot be seen; give earlier samples.",
        )
    if diagnosis.cause == "none" and (size := min(_floors(files), default=0.0)) > LARGEST_OPEN_SHARE:
        return Diagnosis(
            cause="unknown",
            evidence=f"The digits of the file leave {share(size)} of the largest value open, so that errors cannot be"
            " seen; write more digits.",
        )
    if diagnosis.cause != "unknown" or not converging or not all(part.vanishes for part in converging):
        return diagnosis
    order = min(part.order.value for part in converging if part.order is not None)
    return Diagnosis(
        cause="none",
        evidence=f"The errors of all files fall with the time step at an order of {order:.2f} or more, as those of an"
        " integrator do.",
    )


def _without_reference(files: Sequence[FileErrors]) -> QuantityErrors | None:
    """Return a quantity that the reference does not determine; forces are uncertain wherever damped contacts close."""
    for part in (part for file in files for part in file.quantities.values() if part.scale > 0.0):
        if part.quantity != "contact_force" and part.relative(part.reference_uncertainty) > LARGEST_OPEN_SHARE:
            return part
    return None


def _floors(files: Sequence[FileErrors]) -> list[float]:
    """Return what digits and reference leave open of each quantity that has a scale, relative to it."""
    return [part.relative(part.floor) for file in files for part in file.quantities.values() if part.scale > 0.0]


def check_steps(records: Sequence[Record]) -> None:
    """Raise UsageError if only some of several files have a time step."""
    without = [record.name for record in records if record.dt is None]
    if without and len(without) < len(records):
        raise UsageError(
            f"{without[0]} has no time step, but another file has one; give the time step in seconds: {without[0]}@DT"
        )


def usable(record: Record, scene: Scene) -> tuple[Record, list[str]]:
    """Return the samples that can be judged, and what was left out; raise UsageError for unusable values."""
    time, notes = record.time, []
    if not any(values.size for values in record.values.values()):
        raise UsageError(
            f"{record.name} has no velocities, displacements or contact forces; give a file with at least one of them"
        )
    if before := int(np.count_nonzero(time + record.rounding["time"] < 0.0)):
        notes.append(f"{record.name}: {before} samples before the start of the scene, 0 s, are not judged.")
        record = _rows(record, slice(before, None))
    end = MOST_DURATIONS_CONTINUED * scene.duration
    if _stays_together(scene) and (late := int(np.count_nonzero(record.time > end))):
        notes.append(
            f"{record.name}: {late} samples after {end:.6g} s, {MOST_DURATIONS_CONTINUED:g} times the scene,"
            " are not judged."
        )
        record = _rows(record, slice(len(record.time) - late))
        if len(record.time) < 2:
            raise UsageError(
                f"{record.name} goes to {time[-1]:.6g} s, and the scene to {scene.duration:.6g} s; allowed: samples up"
                f" to {end:.6g} s; give the unit of time (--units time=ms), or a scene of this duration"
            )
    interval = float(np.max(np.diff(time), initial=0.0))
    if record.dt is not None and interval < 0.99 * record.dt:
        notes.append(f"{record.name}: the step, {record.dt:.6g} s, is longer than the sampling, {interval:.6g} s.")
    widest = max(values.shape[1] for values in record.values.values())
    if (every := -(-len(record.time) * widest // MOST_VALUES_OF_QUANTITY)) > 1:
        notes.append(f"{record.name}: {every_nth(every)} of {len(record.time)} samples is judged.")
        record = _rows(record, slice(None, None, every))
    if not len(record.time) or record.time[-1] <= 0.0:
        raise UsageError(
            f"{record.name} has no sample after 0 s, the start of the scene; give a file with later samples"
        )
    if len(record.time) < 2:
        raise UsageError(f"{record.name} has a single sample; allowed: two or more samples at increasing times")
    for name, values in record.values.items():
        if len(wrong := np.argwhere(~(np.abs(values) < LARGEST_VALUE_SI))):
            row, column = wrong[0].tolist()
            axis = "contact" if name == "contact_force" else "body"
            raise UsageError(
                f"{record.name} has {len(wrong)} values of {name.replace('_', ' ')} that are not finite or above"
                f" {LARGEST_VALUE_SI:g}, the first at {record.time[row]:.6g} s, {axis} {record.columns[name][column]};"
                " remove these samples, or run the code again with a smaller time step"
            )
    return record, notes


def every_nth(count: int) -> str:
    """Return which samples are taken, in words.

    >>> every_nth(2), every_nth(3), every_nth(21)
    ('every second', 'every third', 'every 21st')
    """
    if count < 4:
        return f"every {('', 'single', 'second', 'third')[count]}"
    last = count % 10
    ending = "stndrd"[2 * last - 2 : 2 * last] if 1 <= last <= 3 and not 10 < count % 100 < 14 else "th"
    return f"every {count}{ending}"


def units_of_time(scene: Scene, records: Sequence[Record]) -> list[float]:
    """Return the units of time, s, in which files would end with the scene whose times go far beyond it."""
    end = max((float(record.time[-1]) for record in records if len(record.time)), default=0.0)
    if not MOST_DURATIONS_CONTINUED * scene.duration < end < math.inf:
        return []
    return [unit for unit in (1e-3, 1e-6, 1e-9) if 0.3 < end * unit / scene.duration < 3.0]


def in_unit(record: Record, unit: float) -> Record:
    """Return a record whose times are in a unit, s."""
    rounding = dict(record.rounding) | {"time": unit * record.rounding["time"]}
    return replace(record, time=unit * record.time, rounding=rounding)


def _stays_together(scene: Scene) -> bool:
    """Return True if bodies may collide again and again, so that the reference takes long for late times."""
    parts = (scene.wall_left, scene.wall_right, scene.drive, scene.adhesion)
    return scene.precompression > 0.0 or any(part is not None for part in parts)


def _rows(record: Record, rows: slice) -> Record:
    """Return a record with some of its samples."""
    return replace(
        record,
        time=record.time[rows],
        values={name: values[rows] for name, values in record.values.items()},
        rounding={name: values[rows] for name, values in record.rounding.items()},
    )
