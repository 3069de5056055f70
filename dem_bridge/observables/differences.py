"""Differences between two runs: of each observable, relative to its scale, and when velocities first differ.

Relative differences are read in a window, by place, and reduced to one number. A place is a sample, body or contact.
Where neither run has a value there is no difference, and the place does not count; where only one has, they are
infinitely far apart.

This module uses observables, but no verdicts and no outcomes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.foundation.numbers import check_number
from dem_bridge.foundation.wording import summary
from dem_bridge.observables.observable import ALL as ALL
from dem_bridge.observables.observable import Observable
from dem_bridge.observables.observable import Reading as Reading
from dem_bridge.observables.observable import Window as Window
from dem_bridge.observables.registry import observable_named
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.relative import relative_size
from dem_bridge.trajectory.trajectory import VOCABULARY, Floats, Trajectory


def read(observable: Observable | str, scene: Scene, run: Trajectory, window: Window = ALL) -> Reading:
    """Return an observable of a run inside a window."""
    if isinstance(observable, str):
        observable = observable_named(observable)
    return observable.read(scene, run, window)


@dataclass(frozen=True, kw_only=True, eq=False)
class RelativeError:
    """Hold the differences of a run from a reference, relative to the scale of the reference, one for each place."""

    values: Floats
    """With their sign; nan where neither run has a value, inf where only one has."""
    uncertainty: Floats
    """Of the run; nan where it has no value."""
    reference_uncertainty: Floats
    """Of the reference; nan where it has no value."""

    @property
    def worst(self) -> tuple[int, ...] | None:
        """Return the place of the largest magnitude; None where no run has any value."""
        size = np.where(np.isnan(self.values), -1.0, np.abs(self.values))
        if not np.any(size >= 0.0):
            return None
        return tuple(int(index) for index in np.unravel_index(int(np.argmax(size)), size.shape))

    def reduced(self, reduce: str = "max") -> float:
        """Return one number of all places, by one of :data:`REDUCTIONS`; nan where no run has any value."""
        return reduced(self.values, reduce)


#: name -> norm of magnitudes
REDUCTIONS: Mapping[str, Callable[[Floats], float]] = MappingProxyType(
    {
        "max": lambda size: float(np.max(size)),
        "rms": lambda size: float(np.sqrt(np.mean(size**2))),
        "mean": lambda size: float(np.mean(size)),
    }
)


def reduced(values: Floats, reduce: str = "max") -> float:
    """Return the norm of the magnitudes of values that are not nan; nan where all are."""
    sizes = np.abs(values[~np.isnan(values)])
    return REDUCTIONS[reduce](sizes) if sizes.size else math.nan


def relative_to(reference: Reading, reading: Reading) -> RelativeError:
    """Return the differences of a reading from that of the reference, relative to the scale of the reference.

    UsageError where the two have different numbers of samples, bodies or contacts.
    """
    if reading.values.shape != reference.values.shape:
        raise UsageError(
            f"{reference.observable.name} of runs with {reading.values.shape} and {reference.values.shape} values along"
            f" {', '.join(reference.observable.axis)}; allowed: two runs of one scene at the same samples"
        )
    missing = np.isnan(reading.values), np.isnan(reference.values)
    with np.errstate(invalid="ignore"):
        apart = reading.values - reference.values
    apart = np.where(np.isnan(apart), math.inf, apart)
    # samples always have a value: one that is not a number is no agreement
    agreed = missing[0] & missing[1] & ("time" not in reference.observable.axis)
    return RelativeError(
        values=np.where(agreed, np.nan, relative_size(apart, reference.scale)),
        uncertainty=relative_size(reading.uncertainty, reference.scale),
        reference_uncertainty=relative_size(reference.uncertainty, reference.scale),
    )


def relative_error(
    observable: Observable | str,
    scene: Scene,
    run: Trajectory,
    reference: Trajectory,
    window: Window = ALL,
    reduce: str = "max",
) -> float:
    """Return how far a run is from a reference in one observable, relative to the scale of the observable.

    Parameters
    ----------
    observable : Observable or str
        One of :data:`~dem_bridge.observables.registry.OBSERVABLES`, by its name.
    scene : Scene
        Of both runs.
    run, reference : Trajectory
        At the same samples.
    window : Window
        The part of both runs that counts.
    reduce : str
        "max", "rms" or "mean" of the magnitudes at all samples, bodies or contacts.

    Returns
    -------
    float
        nan where neither run has a value of the observable, inf where only one has.

    Examples
    --------
    >>> import dem_bridge as db
    >>> scene = db.load_scene("decelerating-40")
    >>> theory, reference = (db.solve(scene, backend=name, samples=2) for name in ("bca", "reference"))
    >>> f"{relative_error('arrival_at_end', scene, theory, reference):.3f}"
    '0.023'

    """
    readings = (read(observable, scene, item, window) for item in (reference, run))
    return relative_to(*readings).reduced(reduce)


def relative_uncertainty(
    observable: Observable | str, scene: Scene, run: Trajectory, window: Window = ALL, reduce: str = "max"
) -> float:
    """Return the estimated numerical error of a run in one observable, relative as :func:`relative_error` has it."""
    reading = read(observable, scene, run, window)
    return reduced(relative_to(reading, reading).uncertainty, reduce)


#: arrays with an entry for each sample
SAMPLED = tuple(name for name, (_, _, axis) in VOCABULARY.items() if "time" in axis)
#: largest difference of equal sample times, relative to the interval between samples (round-off of files)
SAME_TIME = 1e-6
#: difference of velocities, relative to the largest, that the order of operations makes
ROUNDOFF_OF_VELOCITIES = 1e-12
#: fewest samples of each run in a common interval of time for an interpolation
FEWEST_SAMPLES = 4


#: quantities whose plural is not that of their name
_PLURALS = {"velocity": "velocities", "displacement": "displacements", "crossing_time": "crossing times"}


@dataclass(frozen=True, kw_only=True)
class Difference:
    """Hold the largest difference of one observable between two runs, relative to ``scale``."""

    quantity: str
    """Name of the observable."""
    value: float
    """Relative difference (maximum norm); inf if only one of the runs has a value."""
    scale: float
    """Scale of the difference in ``unit``, at the body or contact of the largest difference if each has its own."""
    unit: str
    scale_name: str
    """Scale in words, such as ``largest |velocity| of the reference``."""
    uncertainty: float
    """Estimated numerical error of the first run, relative to the same scale."""
    reference_uncertainty: float
    """Estimated numerical error of the second run, relative to the same scale."""
    axis: str
    """"body" or "contact"; "" for an observable of the whole chain."""
    body: int
    """Index of the body or contact of the largest difference; -1 for an observable of the whole chain."""
    time: float
    """Time of the largest difference, s; nan for an observable that is not sampled in time."""

    @property
    def place(self) -> str:
        """Return the body or contact of the largest difference, such as "contact 3", or "" for the whole chain."""
        return f"{self.axis} {self.body}" if self.axis else ""

    def __str__(self) -> str:
        """Return the sentence: absolute and relative difference, with place and time."""
        noun = _PLURALS.get(self.quantity, f"{self.quantity.replace('_', ' ')}s")
        if not self.value:
            return f"{noun} are equal"
        scale = self.scale_name if self.scale_name.startswith("each") else f"the {self.scale_name}"
        time = f" at {self.time:.9g} s" if self.time == self.time else ""
        return (
            f"{noun} differ by at most {self.value * self.scale:.3g} {self.unit}, {self.value:.3g} of"
            f" {scale} ({self.scale:.6g} {self.unit}); {self.place}{time}"
        )


class Readings:
    """Observables of runs of one scene, each read once.

    Parameters
    ----------
    scene : Scene or None
        None: only the arrays that a trajectory stores can be read.
    """

    def __init__(self, scene: Scene | None) -> None:
        self.scene = scene
        # a run lives as long as its readings, so that no other run has its id
        self._known: dict[tuple[int, str], tuple[Trajectory, Reading]] = {}

    def read(self, quantity: str, run: Trajectory) -> Reading:
        """Return an observable of a run, by the name of the observable."""
        about = id(run), quantity
        if about not in self._known:
            if self.scene is None and quantity not in VOCABULARY:
                raise UsageError(f"the observable {quantity} needs the scene of the runs; give scene=...")
            # what a trajectory stores is read without the scene
            reading = observable_named(quantity).read(cast(Scene, self.scene), run)
            self._known[about] = run, reading
        return self._known[about][1]

    def difference(self, quantity: str, run: Trajectory, reference: Trajectory) -> Difference:
        """Return the largest difference of an observable between two runs, see :func:`difference`."""
        _check_comparable(run, reference)
        base = self.read(quantity, reference)
        observable, errors = base.observable, relative_to(base, self.read(quantity, run))
        worst = errors.worst
        place = dict(zip(observable.axis, worst, strict=True)) if worst is not None else {}
        axis = next((axis for axis in observable.axis if axis != "time"), "")
        uncertainty, reference_uncertainty = (
            0.0 if math.isnan(estimate := reduced(part)) else estimate
            for part in (errors.uncertainty, errors.reference_uncertainty)
        )
        return Difference(
            quantity=quantity,
            value=0.0 if worst is None else float(abs(errors.values[worst])),
            scale=0.0 if worst is None else float(base.scale[worst]),
            unit=observable.unit,
            scale_name=observable.scale_name,
            uncertainty=uncertainty,
            reference_uncertainty=reference_uncertainty,
            axis=axis,
            body=place.get(axis, 0) if axis else -1,
            time=float(run.time[place["time"]]) if "time" in place else math.nan,
        )


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
    observable_named(quantity)
    return Readings(scene).difference(quantity, run, reference)


def _check_comparable(run: Trajectory, reference: Trajectory) -> None:
    """Raise UsageError unless two runs have the same numbers of bodies and contacts, and the same samples."""
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


def first_divergence(run: Trajectory, reference: Trajectory, tolerance: float) -> tuple[float, int] | None:
    """Return the time (s) and body at which velocities first differ by more than a tolerance; None if they do not.

    ``tolerance`` is relative to the largest velocity of the reference. A velocity that is nan counts as different.
    """
    scale = float(np.max(np.abs(reference.velocity)))
    beyond = ~(np.abs(run.velocity - reference.velocity) <= tolerance * scale)
    rows = np.nonzero(beyond.any(axis=1))[0]
    if len(rows) == 0:
        return None
    return float(run.time[rows[0]]), int(np.argmax(beyond[rows[0]]))


def explained_difference(run: Trajectory, reference: Trajectory) -> float:
    """Return the difference of velocities that uncertainties and round-off explain, relative to the largest one.

    An uncertainty that is unknown explains nothing.
    """
    known = [each.uncertainty.get("velocity", math.inf) for each in (run, reference)]
    explained = sum(size for size in known if math.isfinite(size))
    scale = float(np.max(np.abs(reference.velocity), initial=0.0))
    return max(relative_size(explained, scale), ROUNDOFF_OF_VELOCITIES) if scale > 0.0 else ROUNDOFF_OF_VELOCITIES


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Hold the differences of two runs; :func:`compare_runs` returns an instance.

    Attributes
    ----------
    differences : tuple of Difference
        Differences of the quantities that both runs have.
    unknown : tuple of str
        Sentences on quantities that are not compared.
    divergence : (float, int) or None
        Time (s) and body of the first difference of velocities beyond the tolerance; None if there is none or
        velocities are unknown.
    samples : int
        Number of common sample times.
    notes : tuple of str
        Sentences on the scenes, peak forces and sample times.
    interpolation : mapping of str to float
        Estimated error of each quantity that was interpolated, in its unit; empty if the sample times are the same.
    undecided : bool
        True if the interpolation error decides whether the velocities differ by more than the tolerance.
    """

    differences: tuple[Difference, ...]
    unknown: tuple[str, ...]
    divergence: tuple[float, int] | None
    samples: int
    notes: tuple[str, ...]
    interpolation: Mapping[str, float] = field(default_factory=dict)
    undecided: bool = False

    def __str__(self) -> str:
        """Return at most 15 lines: each difference, and the notes."""
        notes = (*self.unknown, *self.notes)
        lines = (*map(str, self.differences), *(f"note: {note}" for note in notes))
        return summary(lines, title=f"Differences at {self.samples} common times")

    __repr__ = __str__


def compare_runs(run: Trajectory, reference: Trajectory, tolerance: float = 0.0) -> Comparison:
    """Compare all quantities that two runs have, at their common sample times, or interpolated if these are few.

    ``tolerance`` is the difference of velocities, relative to the largest of the reference, beyond which the runs have
    diverged. Raises UsageError for runs of different numbers of bodies, or without common times.
    """
    check_number("tolerance", tolerance, "a number >= 0", at_least=0.0)
    interpolation: dict[str, float] = {}
    common = at_common_times(run, reference)
    if common is None:
        first, second, interpolation, notes = interpolated(run, reference)
    else:
        first, second, notes = common
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
    # a divergence must exceed the error of the interpolation, too; between the two nothing is decided
    scale = float(np.max(np.abs(second.velocity))) if velocities else 1.0
    margin = relative_size(interpolation.get("velocity", 0.0), scale)
    divergence = first_divergence(first, second, tolerance + margin) if velocities else None
    within = not velocities or first_divergence(first, second, max(0.0, tolerance - margin)) is None
    return Comparison(
        differences=tuple(differences),
        unknown=tuple(unknown),
        divergence=divergence,
        samples=len(first.time),
        notes=notes,
        interpolation=interpolation,
        undecided=divergence is None and margin > 0.0 and (margin > tolerance or not within),
    )


def at_common_times(run: Trajectory, reference: Trajectory) -> tuple[Trajectory, Trajectory, tuple[str, ...]] | None:
    """Return both runs at their common sample times, and sentences on the samples that were left out.

    Returns None if fewer than half of the samples of either run in the common interval are common.
    """
    if np.array_equal(run.time, reference.time):
        return run, reference, ()
    interval = min(float(np.min(np.diff(time), initial=math.inf)) for time in (run.time, reference.time))
    near = np.clip(np.searchsorted(reference.time, run.time), 1, max(1, len(reference.time) - 1))
    near -= run.time - reference.time[near - 1] < reference.time[np.minimum(near, len(reference.time) - 1)] - run.time
    off = np.abs(run.time - reference.time[near])
    here = np.flatnonzero(off <= SAME_TIME * interval)
    end = min(run.time[-1], reference.time[-1]) + SAME_TIME * interval
    if len(here) < 2 or 2 * len(here) < min(np.sum(run.time <= end), np.sum(reference.time <= end)):
        return None
    there, notes = near[here], []
    if len(here) < max(len(run.time), len(reference.time)):
        notes.append(
            f"the runs are compared at their {len(here)} common sample times up to {run.time[here[-1]]:g} s, of"
            f" {len(run.time)} and {len(reference.time)} samples"
        )
    if np.any(off[here] > 0.0):
        notes.append(f"the common sample times differ by up to {float(np.max(off[here])):.1e} s")
    return _rows(run, here, reference.time[there]), _rows(reference, there, reference.time[there]), tuple(notes)


def interpolated(
    run: Trajectory, reference: Trajectory
) -> tuple[Trajectory, Trajectory, dict[str, float], tuple[str, ...]]:
    """Return both runs at the sample times of the one with fewer samples, at which the other is interpolated.

    Displacements are interpolated by Hermite polynomials with the velocities as slopes; velocities and forces by the
    Hermite polynomials of a cubic spline. Returns also the error of each interpolated quantity, and a sentence. Raises
    UsageError for runs without a common interval of at least four samples of either.

    The error is estimated by interpolating every second sample at the omitted ones: at half the spacing it is smaller
    by four for second order, and by more for the fourth order of smooth motion.
    """
    end = min(run.time[-1], reference.time[-1])
    begin = max(run.time[0], reference.time[0])
    counts = [int(np.sum((begin <= each.time) & (each.time <= end))) for each in (run, reference)]
    if min(counts) < FEWEST_SAMPLES or not end > begin:
        raise UsageError(
            f"the runs, of {len(run.time)} samples up to {run.time[-1]:g} s and {len(reference.time)} samples up to"
            f" {reference.time[-1]:g} s, have {min(counts)} samples in a common interval of time; allowed: at least"
            f" {FEWEST_SAMPLES} of each; solve both with the same samples"
        )
    fine, coarse = (run, reference) if counts[0] >= counts[1] else (reference, run)
    rows = np.flatnonzero((begin <= coarse.time) & (coarse.time <= end))
    time = coarse.time[rows]
    between = fine.time[1:-1:2]
    errors, values = dict[str, float](), dict[str, Any]()
    for name in SAMPLED:
        samples, slopes = getattr(fine, name), fine.velocity if name == "displacement" else None
        values[name] = _between(fine.time, samples, slopes, time)
        halved = _between(fine.time[::2], samples[::2], None if slopes is None else slopes[::2], between)
        if np.all(np.isfinite(samples)):
            errors[name] = 0.25 * float(np.max(np.abs(halved - samples[1:-1:2]), initial=0.0))
    sampled = replace(fine, time=time, **values)
    compared = _rows(coarse, rows, time)
    which = "first" if fine is run else "second"
    note = (
        f"the sample times differ: the {which} run is interpolated (Hermite) at the {len(time)} times of the other up"
        f" to {time[-1]:g} s; the error of the interpolation is about "
        + " and ".join(f"{error:.1e} {VOCABULARY[name][0]}" for name, error in errors.items())
    )
    first, second = (sampled, compared) if fine is run else (compared, sampled)
    return first, second, errors, (note,)


def _between(time: Floats, values: Floats, slopes: Floats | None, at: Floats) -> Floats:
    """Return values at other times, by slopes that are known or those of a cubic spline; nan where there are nans."""
    from scipy.interpolate import CubicHermiteSpline, CubicSpline

    if len(time) < 2 or not np.all(np.isfinite(values)):
        return np.full((len(at), values.shape[1]), math.nan)
    if slopes is not None and np.all(np.isfinite(slopes)):
        return np.asarray(CubicHermiteSpline(time, values, slopes)(at))
    return np.asarray(CubicSpline(time, values)(at))


def _rows(run: Trajectory, rows: NDArray[np.intp], time: Floats) -> Trajectory:
    """Return the samples ``rows`` of a run, at the times ``time``."""
    return replace(run, time=time, **{name: getattr(run, name)[rows] for name in SAMPLED})


def _known(run: Trajectory, quantity: str) -> bool:
    """Return True if a run has a quantity; a crossing time may also be nan because a contact never crosses."""
    if quantity == "crossing_time":
        return (
            not np.all(np.isinf(run.uncertainty[quantity]) & np.isnan(run.crossing_time)) or run.crossing_time.size == 0
        )
    return bool(np.all(np.isfinite(getattr(run, quantity))))
