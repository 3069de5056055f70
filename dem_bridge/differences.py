"""Compare two trajectories: the largest difference of an observable over its scale, and when velocities first differ.

Knows observables; nothing of tolerances or outcomes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.observables.errors import read, reduced, relative_to
from dem_bridge.observables.registry import observable_named
from dem_bridge.scene import Scene
from dem_bridge.trajectory import VOCABULARY, Trajectory

#: arrays with an entry for each sample
SAMPLED = tuple(name for name, (_, _, axis) in VOCABULARY.items() if "time" in axis)
#: times that are no further apart, in units of the interval between samples, are the same but for round-off
SAME_TIME = 1e-6


@dataclass(frozen=True, kw_only=True)
class Difference:
    """Largest difference of one observable between two runs, relative to ``scale``."""

    quantity: str
    """Name of the observable."""
    value: float
    """Relative, max-norm; inf where only one of the two runs has a value."""
    scale: float
    """In ``unit``; where each body or contact has its own scale, that of the place of the largest difference."""
    unit: str
    scale_name: str
    uncertainty: float
    """Estimated numerical error of the first run, relative to the same scale."""
    reference_uncertainty: float
    """Estimated numerical error of the second run."""
    axis: str
    """"body" or "contact"; "" for an observable of the whole chain."""
    body: int
    """Body or contact where the difference is largest; -1 for an observable of the whole chain."""
    time: float
    """s: when it is largest; nan for an observable that is not sampled in time."""

    @property
    def place(self) -> str:
        """Where the difference is largest, such as "contact 3"; "" for an observable of the whole chain."""
        return f"{self.axis} {self.body}" if self.axis else ""


def difference(quantity: str, run: Trajectory, reference: Trajectory, scene: Scene | None = None) -> Difference:
    """Return the largest difference of an observable between two runs, with its scale and place.

    Parameters
    ----------
    quantity : str
        Name of one of :data:`~dem_bridge.observables.registry.OBSERVABLES`.
    run, reference : Trajectory
        Of one scene, at the same samples. The scale is that of the reference.
    scene : Scene, optional
        Not needed for the arrays that a trajectory stores.

    Raises
    ------
    UsageError
        For another observable, or runs of different numbers of bodies or at different times.

    """
    observable = observable_named(quantity)
    if scene is None and quantity not in VOCABULARY:
        raise UsageError(f"{quantity} of two runs is asked without their scene; give scene=...")
    if run.velocity.shape[1:] != reference.velocity.shape[1:] or len(run.peak_force) != len(reference.peak_force):
        raise UsageError(
            f"the runs have {run.velocity.shape[1]} and {reference.velocity.shape[1]} bodies and cannot be compared;"
            " give two runs of the same scene"
        )
    if not np.array_equal(run.time, reference.time):
        raise UsageError(
            f"the runs have {len(run.time)} and {len(reference.time)} samples at different times; solve both with the"
            " same samples"
        )
    # what a trajectory stores is read without the scene
    readings = [read(observable, cast(Scene, scene), trajectory) for trajectory in (reference, run)]
    errors = relative_to(*readings)
    worst = errors.worst
    place = dict(zip(observable.axis, worst, strict=True)) if worst is not None else {}
    axis = next((axis for axis in observable.axis if axis != "time"), "")
    uncertainty, reference_uncertainty = (
        0.0 if math.isnan(bar := reduced(part)) else bar for part in (errors.uncertainty, errors.reference_uncertainty)
    )
    return Difference(
        quantity=quantity,
        value=0.0 if worst is None else float(abs(errors.values[worst])),
        scale=0.0 if worst is None else float(readings[0].scale[worst]),
        unit=observable.unit,
        scale_name=observable.scale_name,
        uncertainty=uncertainty,
        reference_uncertainty=reference_uncertainty,
        axis=axis,
        body=place.get(axis, 0) if axis else -1,
        time=float(run.time[place["time"]]) if "time" in place else math.nan,
    )


def first_divergence(run: Trajectory, reference: Trajectory, tolerance: float) -> tuple[float, int] | None:
    """Time (s) and body where velocities first differ by more than ``tolerance`` of the reference's largest; None:
    they never do."""
    scale = float(np.max(np.abs(reference.velocity)))
    # what is not a number has parted too
    beyond = ~(np.abs(run.velocity - reference.velocity) <= tolerance * scale)
    rows = np.nonzero(beyond.any(axis=1))[0]
    if len(rows) == 0:
        return None
    return float(run.time[rows[0]]), int(np.argmax(beyond[rows[0]]))


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Two runs beside each other. Made by :func:`compared`."""

    differences: tuple[Difference, ...]
    """Of each quantity that both have."""
    unknown: tuple[str, ...]
    """Sentences: which quantity is not compared, and why."""
    divergence: tuple[float, int] | None
    """As :func:`first_divergence`; None too where velocities are not known."""
    samples: int
    """At which both were compared."""
    notes: tuple[str, ...]

    @property
    def beyond(self) -> bool:
        """Whether velocities part at all by more than was allowed."""
        return self.divergence is not None


def compared(run: Trajectory, reference: Trajectory, tolerance: float = 0.0) -> Comparison:
    """All quantities that both runs have, at the times that they share, and where velocities first differ by more than
    ``tolerance`` of the largest (0: at all). Raises UsageError for runs that share no bodies or times."""
    if not 0.0 <= tolerance < math.inf:
        raise UsageError(f"tolerance = {tolerance!r}; allowed: a number >= 0")
    first, second, notes = at_common_times(run, reference)
    labelled = (("the first run", first), ("the second run", second))
    hashes = [trajectory.provenance.get("scene_hash") for _, trajectory in labelled]
    if None not in hashes and hashes[0] != hashes[1]:
        notes += (f"the runs are of different scenes, {first.provenance['scene']} and {second.provenance['scene']}",)
    sampled = [label for label, trajectory in labelled if trajectory.provenance.get("peaks") == "samples"]
    if sampled:
        notes += (f"the peak forces of {' and '.join(sampled)} come from samples and may be too low",)
    differences, unknown = [], []
    for name in VOCABULARY:
        missing = [label for label, trajectory in labelled if not _known(trajectory, name)]
        if missing:
            unknown.append(f"{name} is not compared, because it is unknown in {' and '.join(missing)}")
        else:
            differences.append(difference(name, first, second))
    velocities = all(_known(trajectory, "velocity") for _, trajectory in labelled)
    return Comparison(
        differences=tuple(differences),
        unknown=tuple(unknown),
        divergence=first_divergence(first, second, tolerance) if velocities else None,
        samples=len(first.time),
        notes=notes,
    )


def at_common_times(run: Trajectory, reference: Trajectory) -> tuple[Trajectory, Trajectory, tuple[str, ...]]:
    """Both at the times that they share, and sentences about what was left out. Nothing is interpolated: UsageError
    where no time after the start is in both."""
    if np.array_equal(run.time, reference.time):
        return run, reference, ()
    interval = min(float(np.min(np.diff(one.time), initial=math.inf)) for one in (run, reference))
    near = np.clip(np.searchsorted(reference.time, run.time), 1, max(1, len(reference.time) - 1))
    near -= run.time - reference.time[near - 1] < reference.time[np.minimum(near, len(reference.time) - 1)] - run.time
    off = np.abs(run.time - reference.time[near])
    here = np.flatnonzero(off <= SAME_TIME * interval)
    if len(here) < 2:
        raise UsageError(
            f"the runs, of {len(run.time)} samples up to {run.time[-1]:g} s and {len(reference.time)} samples up to"
            f" {reference.time[-1]:g} s, have no sample times in common except the start; allowed: at least one common"
            " time (samples are not interpolated); solve both with the same samples"
        )
    there, notes = near[here], []
    if len(here) < max(len(run.time), len(reference.time)):
        notes.append(
            f"the runs are compared at their {len(here)} common sample times up to {run.time[here[-1]]:g} s, of"
            f" {len(run.time)} and {len(reference.time)} samples"
        )
    if np.any(off[here] > 0.0):
        notes.append(f"the common sample times differ by up to {float(np.max(off[here])):.1e} s")
    return _rows(run, here, reference.time[there]), _rows(reference, there, reference.time[there]), tuple(notes)


def _rows(run: Trajectory, rows: NDArray[np.intp], time: NDArray[np.float64]) -> Trajectory:
    return replace(run, time=time, **{name: getattr(run, name)[rows] for name in SAMPLED})


def _known(run: Trajectory, quantity: str) -> bool:
    """Whether a run says anything of a quantity; a crossing time may be nan because there is none."""
    if quantity == "crossing_time":
        return (
            not np.all(np.isinf(run.uncertainty[quantity]) & np.isnan(run.crossing_time)) or run.crossing_time.size == 0
        )
    return bool(np.all(np.isfinite(getattr(run, quantity))))
