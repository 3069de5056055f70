"""How far two trajectories are apart, with a named scale, and where they first part.

Knows arrays; nothing of tolerances or outcomes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.trajectory import VOCABULARY, Trajectory, own_scale

#: sampled in time; contact forces have no bars of their own
SAMPLED = ("velocity", "displacement", "contact_force")
UNITS = {name: unit for name, (unit, _, _) in VOCABULARY.items()}
#: times that are no further apart, in units of the interval between samples, are one: round-off and few digits
SAME_TIME = 1e-6


@dataclass(frozen=True, kw_only=True)
class Difference:
    """Largest difference of one quantity, relative to ``scale``."""

    quantity: str
    value: float
    """Relative, max-norm; inf where one of the two has no value."""
    scale: float
    """In ``unit``; where each contact is its own scale, that of the worst."""
    unit: str
    scale_name: str
    uncertainty: float
    """Bar of the first trajectory, relative to the same scale."""
    reference_uncertainty: float
    """Bar of the second."""
    body: int
    """Body or contact where the difference is largest."""
    time: float
    """s: when it is largest; nan for quantities that are not sampled in time."""


def difference(quantity: str, run: Trajectory, reference: Trajectory) -> Difference:
    """Compare ``velocity``, ``displacement`` or ``contact_force`` (max over all samples and columns, relative to the
    reference's largest magnitude), or ``peak_force`` or ``crossing_time`` (max over contacts, each relative to
    the reference's own, or to a thousandth of the largest in the chain where that is more).

    Raises UsageError where the two are sampled at different times.
    """
    if quantity not in UNITS:
        raise UsageError(f"quantity = {quantity!r}; allowed: {', '.join(UNITS)}")
    mine, other = getattr(run, quantity), getattr(reference, quantity)
    if mine.shape[1:] != other.shape[1:] or run.velocity.shape[1:] != reference.velocity.shape[1:]:
        raise UsageError(
            f"the runs have {run.velocity.shape[1]} and {reference.velocity.shape[1]} bodies and cannot be compared;"
            " give two runs of the same scene"
        )
    if mine.shape != other.shape or not np.array_equal(run.time, reference.time):
        raise UsageError(
            f"the runs have {len(run.time)} and {len(reference.time)} samples at different times; solve both with the"
            " same samples"
        )
    if quantity in SAMPLED:
        scale = float(np.max(np.abs(other), initial=0.0))
        apart = np.abs(mine - other)
        row, body = np.unravel_index(int(np.argmax(apart)), apart.shape) if apart.size else (0, 0)
        return Difference(
            quantity=quantity,
            value=_relative(float(apart[row, body]) if apart.size else 0.0, scale),
            scale=scale,
            unit=UNITS[quantity],
            scale_name=f"largest |{quantity}| of the reference",
            uncertainty=_relative(run.uncertainty.get(quantity, math.inf), scale),
            reference_uncertainty=_relative(reference.uncertainty.get(quantity, math.inf), scale),
            body=int(body),
            time=float(run.time[row]),
        )
    apart = np.abs(mine - other)
    # neither has a value: agreed; only one has: infinitely far apart
    apart = np.where(np.isnan(mine) & np.isnan(other), 0.0, np.where(np.isnan(apart), math.inf, apart))
    own = own_scale(other)
    relative = np.array([_relative(a, s) for a, s in zip(apart, own, strict=True)])
    where = int(np.argmax(relative)) if len(relative) else 0
    bars = [
        max((_relative(b, s) for b, s in zip(t.uncertainty[quantity], own, strict=True)), default=0.0)
        for t in (run, reference)
    ]
    return Difference(
        quantity=quantity,
        value=float(relative[where]) if len(relative) else 0.0,
        scale=float(own[where]) if len(relative) else 0.0,
        unit=UNITS[quantity],
        scale_name=f"each contact's own {quantity}",
        uncertainty=bars[0],
        reference_uncertainty=bars[1],
        body=where,
        time=math.nan,
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
    for name in UNITS:
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


def _relative(value: float, scale: float) -> float:
    if value == 0.0:
        return 0.0
    return float(value) / scale if scale > 0.0 else math.inf
