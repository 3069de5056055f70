"""Draw a chain and the motion of its bodies with characters, for terminals of any width.

The characters carry all of it; colours are left to the caller. Without ``blocks`` they are ASCII.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dem_bridge.foundation.notebook import quantity, spread
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats, Trajectory

#: heights of a bar, and shades of a speed, from the smallest to the largest; with blocks, and in ASCII
_BARS, _BARS_ASCII = "▁▂▃▄▅▆▇█", "_.-=+*%#"
_SHADES, _SHADES_ASCII = "░▒▓█", ".+%#"
#: width of the headings of rows, and number of rows of a map
_COLUMNS_OF_HEADINGS, _ROWS_OF_MAP = 11, 16
#: part of the largest speed below which a body is shown at rest
_SHARE_OF_SPEED_AT_REST = 0.02
#: largest number of characters of a body
_MOST_CHARACTERS_OF_BODY = 4


@dataclass(frozen=True, kw_only=True)
class Canvas:
    """How a chain is drawn."""

    width: int = 80
    """Number of columns."""
    blocks: bool = True
    """Whether the terminal has block characters."""

    def columns(self, n_body: int) -> list[Sequence[int]]:
        """Return the bodies of each column; a body may have several columns, and a column several bodies."""
        room = self.width - _COLUMNS_OF_HEADINGS - 2
        if n_body <= room:
            wide = min(_MOST_CHARACTERS_OF_BODY, room // n_body)
            return [(body,) for body in range(n_body) for _ in range(wide)]
        edges = np.linspace(0, n_body, room + 1).round().astype(int).tolist()
        return [range(first, last) for first, last in pairwise(edges)]


def chain_lines(scene: Scene, canvas: Canvas) -> list[str]:
    r"""Return the masses of the bodies and the stiffnesses of the contacts as rows of bars, on logarithmic scales.

    A contact stands below the first of its two bodies.

    Examples
    --------
    >>> from dem_bridge.scene.file import load_scene
    >>> print(*chain_lines(load_scene("lammps-hertz-restitution"), Canvas(width=40)), sep="\n")
    mass       ████████  177 mg
    stiffness  ████  1.85e+09 N/m^1.5
    """
    c, joined = scene.contacts, scene.n_body - 1
    unit = f"N/m^{c.exponent[0] - 1.0:g}" if len(set(c.exponent.tolist())) == 1 else "N/m^(n-1)"
    places = canvas.columns(scene.n_body)
    inner: list[Sequence[int]] = [[body for body in bodies if body < joined] for bodies in places]
    rows = [("mass", np.array(scene.mass), places, "kg"), ("stiffness", c.stiffness[:joined], inner, unit)]
    lines = []
    for name, values, columns, unit in rows if joined else rows[:1]:
        bars = _bars(values, [bodies for bodies in columns if bodies], canvas.blocks)
        lines += _beside(f"{name:{_COLUMNS_OF_HEADINGS}}{bars}", spread(values.tolist(), unit), canvas.width)
    if walls := [side for side in ("left", "right") if getattr(scene, f"wall_{side}") is not None]:
        lines.append(f"{'walls':{_COLUMNS_OF_HEADINGS}}{' and '.join(walls)}")
    return lines


def motion_lines(run: Trajectory, canvas: Canvas, until: float | None = None) -> list[str]:
    """Return a map of speeds: a row for each of some times, a column for each body, darker where a body is faster.

    Parameters
    ----------
    run : Trajectory
        Run to draw.
    canvas : Canvas
        Width and characters.
    until : float, optional
        Last time, s; the default is shortly after the front has reached the last contact.
    """
    speeds, places = np.abs(run.velocity), canvas.columns(run.velocity.shape[1])
    largest = float(np.nanmax(speeds, initial=0.0))
    end = _end_of_front(run) if until is None else until
    rows = np.unique(np.searchsorted(run.time, np.linspace(0.0, end, _ROWS_OF_MAP)).clip(max=len(run.time) - 1))
    shades = _SHADES if canvas.blocks else _SHADES_ASCII
    last = str(run.velocity.shape[1] - 1) if run.velocity.shape[1] > 1 else ""
    lines = [f"{'time':{_COLUMNS_OF_HEADINGS}}body 0{last:>{max(2, len(places) - 5)}}".rstrip()]
    for row in rows.tolist():
        cells = "".join(_shade(max(speeds[row, list(bodies)]), largest, shades) for bodies in places)
        lines.append(f"{quantity(float(run.time[row]), 's'):>{_COLUMNS_OF_HEADINGS - 2}} |{cells}|")
    steps = (f"{shade} {quantity(largest * (k + 1) / len(shades), 'm/s', 2)}" for k, shade in enumerate(shades))
    return [*lines, f"{'speed up to':{_COLUMNS_OF_HEADINGS}} {', '.join(steps)}"]


def front_sentences(run: Trajectory) -> list[str]:
    """Return what a reader looks for first: when the front comes to the last contact, and the largest force."""
    crossed, forces = run.crossing_time[np.isfinite(run.crossing_time)], run.peak_force
    if not forces.size or not np.nanmax(forces, initial=0.0) > 0.0:
        return ["No contact closes."]
    strongest = int(np.nanargmax(forces))
    force = f"The largest force is {quantity(float(forces[strongest]), 'N')}, in contact {strongest}."
    if len(crossed) < len(forces):
        return [f"{len(crossed)} of {len(forces)} contacts have a first maximal compression.", force]
    arrival = quantity(float(run.crossing_time[-1]), "s", 4)
    contact = "the contact" if len(forces) == 1 else "the last contact"
    return [f"The first maximal compression of {contact} is at {arrival}.", force]


def _end_of_front(run: Trajectory) -> float:
    """Return a time shortly after the front has come to the last contact, s; the end of the run if it never does."""
    last = float(run.crossing_time[-1]) if len(run.crossing_time) else math.nan
    return min(1.15 * last, float(run.time[-1])) if math.isfinite(last) else float(run.time[-1])


def _bars(values: Floats, columns: Sequence[Sequence[int]], blocks: bool) -> str:
    """Return a bar for each column, the mean of its logarithmic values between the smallest and the largest."""
    bars, logs = _BARS if blocks else _BARS_ASCII, np.log(values)
    low, high = float(logs.min()), float(logs.max())
    # equal values have full bars, and a spread below a factor of two does not look like a large one
    spread_of_logs = max(high - low, math.log(2.0))
    parts = [1.0 + (float(logs[list(bodies)].mean()) - high) / spread_of_logs for bodies in columns]
    return "".join(bars[min(int(part * len(bars)), len(bars) - 1)] for part in parts)


def _beside(line: str, text: str, width: int) -> list[str]:
    """Return a line with a text behind it, or below it where both are too wide."""
    together = f"{line}  {text}"
    return [together] if len(together) <= width else [line, f"{'':{_COLUMNS_OF_HEADINGS}}{text}"]


def _shade(speed: float, largest: float, shades: str) -> str:
    """Return the character of a speed."""
    if not speed > _SHARE_OF_SPEED_AT_REST * largest:
        return " "
    return shades[min(int(speed / largest * len(shades)), len(shades) - 1)]
