"""The limit of a code for a vanishing time step, and its order, from its files at three time steps.

Scenes judge the limit, so that a question about physics has the same answer for every method of integration; the order,
and whether times and velocities belong together, follow from the differences between the files, which need no
reference solution.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType

import numpy as np

from dem_bridge.errors import UsageError
from dem_bridge.formats.readers import Record
from dem_bridge.judging.conformance.scenes import RATIO_OF_STEPS, Probe
from dem_bridge.trajectory.trajectory import Floats

#: quantities that are graded
QUANTITIES = ("velocity", "displacement")
#: difference of a time from that of its sample, relative to the sampling interval, that counts as rounding
LARGEST_TIME_DIFFERENCE = 1e-4
#: difference of the pace of the written times from that of the samples, above which they are those of another run
LARGEST_DIFFERENCE_OF_PACE = 0.1
#: distance of an order from 1 or 2 up to which the error has this order; beyond it the limit is less certain
CLEAN_ORDER = 0.25
#: difference between two time steps, relative to the largest value, that is round-off and digits and has no order
LEAST_DIFFERENCE_WITH_ORDER = 1e-9
#: uncertainty of a limit, relative to the largest value, that round-off of codes with absolute positions makes
ROUNDOFF_OF_CODES = 1e-7
#: units of time that headings may state wrongly, s
_TIME_UNITS = (1e3, 1e6, 1e9, 1e-3, 1e-6, 1e-9)


class Nonsense(UsageError):
    """A file of a code that can be read, but not graded."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Values of one file at the samples of a scene."""

    values: Mapping[str, Floats]
    """Velocity and displacement, ``(n_t, n_body)``, SI."""
    digits: Mapping[str, float]
    """Largest rounding error of each quantity as written."""
    delay: float = 0.0
    """What is to be subtracted from the written times, s, so that they are the times of the samples."""
    time_unit: float = 1.0
    """What is to be multiplied to the written times so that they are in s."""
    pace: float = 1.0
    """Written times over those of the samples."""
    single: bool = False
    """True if all values are numbers of single precision."""


def samples_of(record: Record, probe: Probe) -> Samples:
    """Return the values of a file at the samples of its scene, that at the start included.

    Raises
    ------
    Nonsense
        If samples or bodies are missing, or values are not finite.
    """
    times = np.linspace(0.0, probe.scene.duration, probe.scene.samples + 1)
    rows, delay, unit, pace = _matched(record.time, times, np.max(record.rounding["time"], initial=0.0))
    values, digits = {}, {}
    for name in QUANTITIES:
        if name not in record.values:
            continue
        columns = record.columns[name]
        if missing := [body for body in range(probe.scene.n_body) if body not in columns]:
            raise Nonsense(f"the file has no {name} of body {missing[0]}; write all {probe.scene.n_body} bodies")
        order = [columns.index(body) for body in range(probe.scene.n_body)]
        chosen = record.values[name][rows][:, order]
        if not np.all(np.isfinite(chosen)):
            raise Nonsense(f"the {name} has values that are not finite numbers")
        values[name] = chosen
        digits[name] = float(np.max(record.rounding[name][rows], initial=0.0))
    if not values:
        raise Nonsense("the file has neither velocities nor displacements")
    if "velocity" in values and np.all(values["velocity"] == values["velocity"][0]):
        # bodies in free flight have round numbers, which do not show how many digits are written
        digits = dict.fromkeys(digits, 0.0)
    single = all(map(_is_single, values.items()))
    return Samples(MappingProxyType(values), MappingProxyType(digits), delay, unit, pace, single)


def _is_single(item: tuple[str, Floats]) -> bool:
    """Return True if the values of a quantity have single precision, zeros aside."""
    values = item[1][item[1] != 0.0]
    # text of nine digits restores a number of single precision; a double is so near to one in a case of 2^29
    return len(values) > 0 and bool(np.all(np.abs(values.astype(np.float32) - values) <= 1e-9 * np.abs(values)))


def _matched(written: Floats, times: Floats, rounding: float) -> tuple[list[int], float, float, float]:
    """Return the row of each sample (the first may be missing), the delay of the times, their unit (s) and pace."""
    for unit in (1.0, *_TIME_UNITS):
        allowed = LARGEST_TIME_DIFFERENCE * times[1] + unit * rounding
        for count in (len(times), len(times) - 1):
            wanted, scaled = times[-count:], unit * written
            rows = np.searchsorted(scaled, wanted - allowed)
            if rows[-1] < len(scaled) and np.max(np.abs(scaled[rows] - wanted)) <= allowed:
                return rows.tolist(), 0.0, unit, 1.0
    allowed = LARGEST_TIME_DIFFERENCE * times[1] + rounding
    for count in (len(times), len(times) - 1):
        delays = written - times[-count:] if len(written) == count else np.array([0.0, 1.0])
        if np.ptp(delays) <= 2.0 * allowed:
            return list(range(count)), float(np.mean(delays)), 1.0, 1.0
        pace = written[-1] / times[-1]
        alike = len(written) == count and abs(pace - 1.0) <= LARGEST_DIFFERENCE_OF_PACE
        if alike and np.max(np.abs(written - pace * times[-count:])) <= 2.0 * allowed:
            return list(range(count)), 0.0, 1.0, float(pace)
    raise Nonsense(
        f"the file has {len(written)} samples from {written[0]:.6g} to {written[-1]:.6g} s; expected: the {len(times)}"
        f" samples of the scene, each {times[1]:.6g} s from 0 to {times[-1]:.6g} s"
    )


@dataclass(frozen=True, eq=False)
class Limit:
    """The limit of one quantity for a vanishing time step, relative to the largest value of the reference."""

    values: Floats
    """Limit, ``(n_t, n_body)``, SI; the rows are the last samples of the scene."""
    uncertainty: float
    """Largest error of the limit, relative to the scale."""
    order: float
    """Observed order; nan where the differences between the steps are round-off."""
    difference: float
    """Largest difference between the two finest files, relative to the scale."""
    same: bool
    """True if the two finest files have the same values."""


def limit_of(files: Sequence[Floats], digits: float, scale: float, *, smooth: bool = True) -> Limit:
    """Return the limit of the values of several files, from coarse to fine, whose steps have the ratio 4.

    ``smooth``: False if the force has a kink or a jump at a touch. The error then depends on where in a step the touch
    falls, so that it does not follow a power of the step although its size may: the limit has its uncertainty.

    Examples
    --------
    >>> exact = np.array([[1.0], [0.5]])
    >>> found = limit_of([exact * (1.0 + 1e-2 / 16.0**k) for k in range(3)], digits=0.0, scale=1.0)
    >>> f"{found.order:.2f}", bool(abs(found.values - exact).max() < 1e-12)
    ('2.00', True)
    """
    finest = files[-1]
    if len(files) < 2:
        return Limit(finest, 1.0, math.nan, 0.0, False)
    with np.errstate(all="ignore"):
        steps = [float(np.max(np.abs(fine - coarse))) / scale for coarse, fine in pairwise(files)]
    same = steps[-1] == 0.0
    floor = 3.0 * digits / scale + ROUNDOFF_OF_CODES
    if steps[-1] <= LEAST_DIFFERENCE_WITH_ORDER + 2.0 * digits / scale or len(files) < 3:
        certain = max(steps[-1], floor) if len(files) == 3 else steps[-1] + floor
        return Limit(finest, certain, math.nan, steps[-1], same)
    order = math.log(max(steps[0], 1e-300) / steps[1], RATIO_OF_STEPS)
    nearest = float(min(2, max(1, round(order))))
    clean = abs(order - nearest) <= CLEAN_ORDER or order > nearest
    factor = RATIO_OF_STEPS**nearest - 1.0
    before, last = (fine + (fine - coarse) / factor for coarse, fine in pairwise(files))
    between = float(np.max(np.abs(last - before))) / scale
    values = last + (last - before) / (RATIO_OF_STEPS**2 - 1.0) if clean and nearest == 1.0 else last
    uncertainty = between + floor + (0.0 if clean and smooth else steps[1])
    return Limit(values, uncertainty, order, steps[1], same)
