"""Prepare what a page plays: the motion of a chain over body and time, and errors on one logarithmic scale.

Both are texts and one image, which are complete without a script; ``live.js`` adds a slider, and values where the
pointer is. Velocities for the script are 16-bit integers, so that a value that is read off errs by 2e-5 of the largest.
"""

from __future__ import annotations

import base64
import io
import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from dem_bridge.report.study import Map, Panel
from dem_bridge.report.styles import DIVERGING, SEQUENTIAL, colour_limits, rgb
from dem_bridge.report.svg import data_uri
from dem_bridge.trajectory.trajectory import Floats

#: most times of a chain that are kept, and most values of all chains of a page: these have 270 kB as text
MOST_TIMES_OF_MAP, MOST_VALUES_OF_MAP = 300, 100_000
#: largest 16-bit integer; the script reads -32768 as "no value"
_LARGEST_SCALED_VALUE = 32767
#: fewest values of a chain with which it is worth playing
_LEAST_TIMES = 40
#: power of ten below which the least value of a scale of errors is round-off
_ROUND_OFF = -9
#: least end of a scale of colours, relative to the other, that is not drawn as zero
_LARGEST_UNSEEN_SHARE = 1e-3
#: most ticks of an axis
_MOST_TICKS = 5


@dataclass(frozen=True, kw_only=True, eq=False)
class Chain:
    """Velocities of a chain over body and time, and the fronts that theories predict."""

    id: str
    title: str
    """Name on the button that shows it: "decelerating"."""
    caption: str
    time: Floats
    """s, (n_time,)."""
    velocity: Floats
    """m/s, (n_time, n_body)."""
    first: int = 0
    """Number of the first body."""
    noun: str = "body"
    lines: bool = False
    """Whether each body is a line over time, in place of a column of a map."""
    signed: bool = False
    """Whether values are signed errors, with zero in the middle of the colours."""
    quantity: str = "velocity"
    fronts: Mapping[str, Floats] = field(default_factory=dict)
    """Arrival at each body by the name of a theory, s, (n_body,)."""


class Tick(NamedTuple):
    """Hold the name of a place on an axis and the place in per cent of its length."""

    name: str
    place: float


def shown_chains(chains: Iterable[Chain], most: int = MOST_VALUES_OF_MAP) -> list[dict[str, Any]]:
    """Return what the template needs of each chain; those beyond ``most`` values in all are shown without data.

    >>> wave = Chain(id="a", title="a", caption="", time=np.array([0.0, 1e-4]), velocity=np.eye(2))
    >>> [shown] = shown_chains([wave])
    >>> shown["data"]["n"], shown["data"]["scale"], [tick.name for tick in shown["bodies"]]
    (2, 1.0, ['0', '1'])
    """
    shown, left = [], most
    for chain in chains:
        n = chain.velocity.shape[1]
        times = min(MOST_TIMES_OF_MAP, left // n, len(chain.time))
        plays = times >= min(_LEAST_TIMES, len(chain.time))
        picked = _thinned(chain, times if plays else min(MOST_TIMES_OF_MAP, len(chain.time)))
        left -= len(picked.time) * n * plays
        shown.append(_shown(picked, plays))
    return shown


def _thinned(chain: Chain, times: int) -> Chain:
    """Return the chain at so many samples at nearly equal distances in time."""
    wanted = np.linspace(chain.time[0], chain.time[-1], times)
    after = np.clip(np.searchsorted(chain.time, wanted), 1, max(1, len(chain.time) - 1))
    nearer = wanted - chain.time[after - 1] < chain.time[after] - wanted
    rows = np.where(nearer, after - 1, after)
    rows = rows[np.diff(rows, prepend=-1) > 0]  # they ascend, and numpy.unique takes long to import
    values = {name: getattr(chain, name) for name in Chain.__dataclass_fields__}
    return Chain(**values | {"time": chain.time[rows], "velocity": chain.velocity[rows]})


def _shown(chain: Chain, plays: bool) -> dict[str, Any]:
    """Return what the template needs of a chain."""
    n, end = chain.velocity.shape[1], float(chain.time[-1])
    numbers = chain.first + np.arange(n)
    low, high, extend = _limits(chain)
    unit, factor = ("ms", 1e3) if end >= 1e-4 else ("µs", 1e6)
    scale = float(np.nanmax(np.abs(chain.velocity), initial=0.0)) or 1.0
    colours = DIVERGING if chain.signed else SEQUENTIAL
    shown: dict[str, Any] = {
        "chain": chain,
        "unit": unit,
        "times": _ticks(0.0, factor * end),
        "bodies": [Tick(str(k), 100.0 * (k - chain.first + 0.5) / n) for k in _numbers(chain.first, n)],
        "extend": extend,
        "low": low,
        "high": high,
        "colours": colours,
        "data": None,
    }
    if chain.lines:
        shown |= _lines(chain, low, high)
    else:
        shown["image"] = _image(chain, low, high, colours)
        shown["fronts"] = {name: _rings(chain, times, end) for name, times in chain.fronts.items()}
    if plays:
        shown["data"] = {
            "n": n, "first": chain.first, "noun": chain.noun, "quantity": chain.quantity, "unit": unit,
            "lines": chain.lines, "times": [float(f"{factor * value:.4g}") for value in chain.time.tolist()],
            "scale": scale, "low": low, "high": high, "colours": list(colours),
            "names": [str(k) for k in numbers.tolist()], "values": _packed(chain.velocity / scale),
        }  # fmt: skip
    return shown


def _limits(chain: Chain) -> tuple[float, float, str]:
    """Return the ends of the scale, and which of them values exceed; lines are not cut."""
    if chain.lines:
        low, high = float(np.nanmin(chain.velocity, initial=0.0)), float(np.nanmax(chain.velocity, initial=0.0))
        room = 0.05 * ((high - low) or 1.0)
        return low - room if low < 0.0 else 0.0, high + room, "neither"
    numbers = np.arange(float(chain.velocity.shape[1]))
    values = Map(label="", x=numbers, y=chain.time, values=chain.velocity, diverging=chain.signed)
    low, high, extend = colour_limits([values])
    return (0.0 if abs(low) < _LARGEST_UNSEEN_SHARE * high else low), high, extend


def _image(chain: Chain, low: float, high: float, colours: Sequence[str]) -> str:
    """Return the map as a PNG, a pixel for each body and time, time upwards."""
    from PIL import Image

    values = np.nan_to_num((chain.velocity[::-1] - low) / (high - low), nan=0.5)
    image = Image.fromarray(rgb(colours, values)).quantize(128, method=Image.Quantize.MAXCOVERAGE, kmeans=2)
    file = io.BytesIO()
    image.save(file, format="png", optimize=True)
    return data_uri(file.getvalue())


def _rings(chain: Chain, arrival: Floats, end: float) -> list[tuple[float, float]]:
    """Return where the front by a theory reaches every fifth body, in per cent of the width and the height."""
    n = chain.velocity.shape[1]
    every = max(1, 5 * round(n / 40))
    places = [k for k in range(n) if (chain.first + k) % every == 0 and np.isfinite(arrival[k])]
    rings = [(100.0 * (k + 0.5) / n, 100.0 * float(arrival[k]) / end) for k in places]
    return [(round(x, 2), round(y, 2)) for x, y in rings if 0.0 < y < 99.0]


def _lines(chain: Chain, low: float, high: float) -> dict[str, Any]:
    """Return a line of each body as points of a square of 1000 by 1000, and where its name stands at the end."""
    x = 1000.0 * chain.time / float(chain.time[-1])
    lines = 1000.0 * (1.0 - (chain.velocity - low) / (high - low))
    points = [" ".join(f"{a:.0f},{b:.0f}" for a, b in zip(x, line, strict=True)) for line in lines.T]
    ends = _apart([float(line[-1]) / 10.0 for line in lines.T])
    return {
        "lines": list(zip(points, [round(end, 1) for end in ends], strict=True)),
        "levels": [Tick(tick.name, tick.place) for tick in _ticks(low, high)],
    }


def _apart(places: Sequence[float], room: float = 8.0) -> list[float]:
    """Return places in per cent, moved so that neighbours are at least ``room`` apart and all are within 0 to 100.

    >>> _apart([50.0, 50.0, 10.0])
    [46.0, 54.0, 10.0]
    """
    order = sorted(range(len(places)), key=lambda k: (places[k], k))
    moved = [places[k] for k in order]
    for _ in range(100):
        for k in range(len(moved) - 1):
            lack = room - (moved[k + 1] - moved[k])
            if lack > 1e-9:
                moved[k] -= lack / 2.0
                moved[k + 1] += lack / 2.0
        moved = [min(max(place, 0.0), 100.0) for place in moved]
    return [round(moved[order.index(k)], 6) for k in range(len(places))]


def _numbers(first: int, count: int) -> list[int]:
    """Return the numbers of bodies that are named on an axis: the first, the last, and round ones between.

    >>> _numbers(1, 40), _numbers(0, 3)
    ([1, 10, 20, 30, 40], [0, 1, 2])
    """
    last = first + count - 1
    if count <= 2 * _MOST_TICKS:
        return list(range(first, last + 1))
    step = next(s * 10**p for p in range(9) for s in (1, 2, 5) if count <= _MOST_TICKS * s * 10**p)
    step = 10 if step == 8 else step
    inner = [k for k in range(0, last + 1, step) if k > first + 0.4 * step and k < last - 0.4 * step]
    return [first, *inner, last]


def _ticks(low: float, high: float) -> list[Tick]:
    """Return round values between two ends with their places in per cent.

    >>> _ticks(0.0, 0.55)[1:3]
    [Tick(name='0.2', place=36.36), Tick(name='0.4', place=72.73)]
    """
    step = 10.0 ** math.floor(math.log10((high - low) / _MOST_TICKS))
    step *= next(factor for factor in (1, 2, 5, 10) if (high - low) / (factor * step) <= _MOST_TICKS)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [Tick(f"{k * step:.6g}", round(100.0 * (k * step - low) / (high - low), 2)) for k in range(first, last + 1)]


def _packed(values: Floats) -> str:
    """Return values from -1 to 1 as 16-bit integers, base64."""
    whole = np.where(
        np.isfinite(values), np.rint(_LARGEST_SCALED_VALUE * np.nan_to_num(values)), -_LARGEST_SCALED_VALUE - 1
    ).astype("<i2")
    return base64.b64encode(whole.tobytes()).decode("ascii")


class Dot(NamedTuple):
    """Hold one value of a row of a scale of errors."""

    series: str
    value: float
    place: float
    """Per cent of the width."""


class Row(NamedTuple):
    """Hold a row of a scale of errors; its first dot is the largest."""

    name: str
    kind: str
    """Where the value comes from: "round-off", "time step", "model" or ""."""
    dots: tuple[Dot, ...]


class Band(NamedTuple):
    """Hold a range of a scale in which all values of one kind lie: its ends in per cent of the width."""

    kind: str
    left: float
    right: float


class Scale(NamedTuple):
    """Hold errors on one logarithmic scale as a page shows them."""

    rows: tuple[Row, ...]
    bands: tuple[Band, ...]
    ticks: tuple[Tick, ...]
    tolerance: Dot | None


#: kinds of errors in the order in which they should grow
KINDS_OF_ERRORS = ("round-off", "time step", "model")


def error_scale_of(panel: Panel) -> Scale | None:
    """Return the rows of a panel as a page shows them; None without any value above zero.

    The panel has :attr:`~dem_bridge.report.study.Panel.row_kinds`; its series of style "guide" is the tolerance.

    >>> from dem_bridge.report.study import Series
    >>> x, y = np.array([1e-12, 1e-6]), np.arange(2.0)
    >>> series = Series(label="slow", style="mark-2", x=x, y=y)
    >>> rows, kinds = ("round-off", "step"), ("round-off", "time step")
    >>> panel = Panel(title="", x_label="", y_label="", series=(series,), rows=rows, row_kinds=kinds)
    >>> scale = error_scale_of(panel)
    >>> [(row.name, row.dots[0].place) for row in scale.rows], [band.kind for band in scale.bands]
    ([('round-off', 14.29), ('step', 57.14)], ['round-off', 'time step'])
    """
    marks = [line for line in panel.series if line.style != "guide"]
    values = {
        (place, line.label): float(x)
        for line in marks
        for x, place in zip(line.x, line.y.astype(int).tolist(), strict=True)
        if x > 0.0
    }
    if not values:
        return None
    low = math.floor(math.log10(min(values.values()))) - 1
    high = max(math.ceil(math.log10(max(values.values()))), low + 4)
    if low < _ROUND_OFF:  # from below round-off to one
        low, high = min(low, -14), max(high, 0)

    def dot(series: str, value: float) -> Dot:
        return Dot(series, value, round(100.0 * (math.log10(value) - low) / (high - low), 2))

    rows = []
    for place, name in enumerate(panel.rows):
        dots = [dot(line.label, values[place, line.label]) for line in marks if (place, line.label) in values]
        if dots:
            kind = panel.row_kinds[place] if panel.row_kinds else ""
            rows.append(Row(name, kind, tuple(sorted(dots, key=lambda item: -item.value))))
    guides = [dot(line.label, float(line.x[0])) for line in panel.series if line.style == "guide"]
    step = 2 if high - low < 9 else 4
    ticks = [Tick(str(k), round(100.0 * (k - low) / (high - low), 2)) for k in range(low, high + 1) if k % step == 0]
    return Scale(tuple(rows), _bands(rows), tuple(ticks), guides[0] if guides else None)


def _bands(rows: Sequence[Row]) -> tuple[Band, ...]:
    """Return the ranges of the kinds of errors; none where they overlap, so that there is no line between them."""
    ends = {
        kind: (min(places), max(places))
        for kind in KINDS_OF_ERRORS
        if (places := [dot.place for row in rows if row.kind == kind for dot in row.dots])
    }
    kinds = list(ends)
    if len(kinds) < 2 or any(ends[a][1] >= ends[b][0] for a, b in itertools.pairwise(kinds)):
        return ()
    inner = [(ends[a][1] + ends[b][0]) / 2.0 for a, b in itertools.pairwise(kinds)]
    largest = ends[kinds[-1]][1]
    others = [dot.place for row in rows if not row.kind for dot in row.dots if dot.place > largest]
    # a defect lies beyond the errors of the steps, unless those of a model do
    last = (largest + min(others)) / 2.0 if others and kinds[-1] != KINDS_OF_ERRORS[-1] else 100.0
    edges = [round(edge, 2) for edge in (0.0, *inner, last)]
    return tuple(Band(kind, *pair) for kind, pair in zip(kinds, itertools.pairwise(edges), strict=True))
