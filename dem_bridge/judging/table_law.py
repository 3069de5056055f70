"""The law that a force table of a script means, and what LAMMPS makes of the lines of the table.

A table states no law. The one that it means is fitted: Hertz's or Hooke's, whose coefficient is the median of force
over overlap^p, and which leaves less of the lines. With it in place of the table a script is read as a scene.
Format and interpolation: LAMMPS manual, *pair_style table*; the styles linear and spline agree with
:mod:`dem_bridge.lmp.interpolation`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from dem_bridge.errors import UsageError
from dem_bridge.lmp.reader.evaluation import ReadScript
from dem_bridge.lmp.reader.script import Command, Opened
from dem_bridge.trajectory.trajectory import Floats

#: power of the overlap -> normal model of ``pair_style granular``
_MODELS = {1.5: "hertz", 1.0: "hooke"}
#: relative difference of half of the lines from the law that a table means, at most
LARGEST_DIFFERENCE_OF_LINES = 0.05
#: relative difference of the distance at which bodies touch from that at which a force begins
_ROUNDOFF_OF_TOUCH = 1e-6
#: part of the deepest overlap of a table from which its lines determine the coefficient
_LEAST_SHARE_OF_REACH = 0.05
#: places at which the interpolation is compared with the law, and the styles of ``pair_style table``
_PLACES, _STYLES = 20_000, ("lookup", "linear", "spline", "bitmap")
_BEHIND_LAW = "0 tangential linear_nohistory 0 0 damping velocity"


@dataclass(frozen=True, kw_only=True, eq=False)
class TableLaw:
    """A table of a script with the law that it means, in the units of the script."""

    name: str
    """File and section."""
    style: str
    points: int
    """N of ``pair_style table STYLE N``; 2^N points for style bitmap."""
    distance: Floats
    """Distances of the lines, ascending."""
    force: Floats
    slopes: tuple[float, float]
    touch: float
    """Distance at which the bodies touch: the sum of their radii."""
    power: float
    coefficient: float
    """Force = coefficient * overlap^power."""

    @property
    def model(self) -> str:
        """The law in words."""
        return f"{_MODELS[self.power]} with {self.coefficient:.6g} * overlap^{self.power:g}, fitted to its lines"

    def exact(self, overlap: Floats) -> Floats:
        """Return the force of the law at overlaps of 0 or more."""
        return np.asarray(self.coefficient * overlap**self.power)

    def force_error(self, deepest: float, points: int | None = None) -> float:
        """Return the largest error of LAMMPS' force over overlaps up to ``deepest``, relative to the force there.

        ``points``: with so many in place of those of the script.
        """
        deepest = min(deepest, self.touch - float(self.distance[0]))
        if not deepest > 0.0:
            return math.nan
        # as many places in each tenfold of the overlap as in all of it
        overlap = np.union1d(np.linspace(0.0, deepest, _PLACES), np.geomspace(1e-4 * deepest, deepest, _PLACES))
        told = interpolated_force(self, self.touch - overlap, points or self.points)
        return float(np.max(np.abs(told - self.exact(overlap))) / self.exact(np.array(deepest)))


def interpolated_force(table: TableLaw, distance: Floats, points: int) -> Floats:
    """Return the force of LAMMPS at distances within a table, by its style and number of points.

    LAMMPS evaluates a spline through the lines at points that are even in r^2 (bitmap: in r^2 within each power of two)
    and takes force over distance between them: constant, linear, or a cubic spline.
    """
    from scipy.interpolate import CubicSpline

    first, last = table.slopes
    lines = CubicSpline(table.distance, table.force, bc_type=((1, first), (1, last)))
    inner, cut = float(table.distance[0]), float(table.distance[-1])
    squared = distance * distance
    nodes: Floats
    if table.style == "bitmap":
        nodes = _bitmap(inner * inner, cut * cut, points)
    else:
        nodes = np.asarray(inner * inner + np.arange(points) * ((cut * cut - inner * inner) / (points - 1)))
    if table.style == "lookup":
        middle = np.sqrt(0.5 * (nodes[:-1] + nodes[1:]))
        cell = np.clip(np.searchsorted(nodes, squared, side="right") - 1, 0, len(middle) - 1)
        over = (lines(middle) / middle)[cell]
    else:
        at = np.sqrt(nodes.astype(np.float32)).astype(float) if table.style == "bitmap" else np.sqrt(nodes)
        value = lines(at) / at
        if table.style == "spline":
            low, high = ((s / r - v / r) / (2.0 * r) for s, r, v in ((first, inner, value[0]), (last, cut, value[-1])))
            over = CubicSpline(nodes, value, bc_type=((1, low), (1, high)))(squared)
        else:
            over = np.interp(squared, nodes, value)
    return np.where(squared < cut * cut, distance * over, 0.0)


def _bitmap(inner: float, cut: float, bits: int) -> Floats:
    """Return the squared distances at which a bitmapped table of 2^bits points has values."""
    lowest, exponents = math.floor(math.log2(inner)), 0
    while 2.0 ** (2**exponents) < cut / 2.0**lowest:
        exponents += 1
    parts = 2 ** max(bits - exponents, 0)
    powers = np.arange(lowest, math.ceil(math.log2(cut)) + 1)
    nodes = np.ravel(2.0 ** powers[:, None].astype(float) * (1.0 + np.arange(parts) / parts))
    return np.unique(np.clip(nodes, inner, cut))


def laws_of_tables(commands: Sequence[Command], state: ReadScript, opened: Opened) -> dict[Command, TableLaw]:
    """Return the law that each ``pair_coeff`` of a script with ``pair_style table`` means.

    Raises
    ------
    UsageError
        If a table cannot be read, or means neither Hertz's law nor Hooke's between bodies that have radii.
    """
    style = next((command for command in reversed(commands) if command.name == "pair_style"), None)
    if style is None or style.rest[:1] != ("table",) or len(style.rest) < 3 or style.rest[1] not in _STYLES:
        raise UsageError("the script has another pair_style beside that of its table")
    laws = {}
    for command in commands[commands.index(style) :]:
        if command.name == "pair_coeff":
            laws[command] = _law_of(command, style.rest[1], int(style.rest[2]), state, opened)
    return laws


def in_place_of_table(command: Command, law: TableLaw | None, state: ReadScript) -> str:
    """Return the line of ``pair_style granular`` that has the law of a table; None: the line of the style itself."""
    if law is None:
        return "pair_style granular"
    first, second = (_radius(word, state) for word in command.rest[:2])
    stiffness = law.coefficient / math.sqrt(first * second / (first + second)) if law.power == 1.5 else law.coefficient
    return f"pair_coeff {command.rest[0]} {command.rest[1]} {_MODELS[law.power]} {stiffness!r} {_BEHIND_LAW}"


def _law_of(command: Command, style: str, points: int, state: ReadScript, opened: Opened) -> TableLaw:
    """Return the law of a ``pair_coeff I J FILE KEYWORD [CUTOFF]``."""
    if len(command.rest) != 4:
        raise UsageError(f"line {command.line}: a table with a cutoff of its own is not compared with a law")
    *words, file, keyword = command.rest
    touch = sum(_radius(word, state) for word in words)
    distance, force, slopes = read_table(opened(file), keyword, file)
    overlap = touch - distance
    inside = overlap > _ROUNDOFF_OF_TOUCH * touch
    if not np.any(inside) or np.any(np.abs(force[~inside]) > 1e-3 * np.max(np.abs(force))):
        raise UsageError(f"the force of {file} begins at another distance than {touch:g}, at which the bodies touch")
    depth, values = overlap[inside], force[inside]
    deep = depth > _LEAST_SHARE_OF_REACH * depth.max()
    fits = []
    for power in _MODELS:
        ratio = values[deep] / depth[deep] ** power
        coefficient = float(np.median(ratio))
        fits.append(
            (float(np.median(np.abs(ratio / coefficient - 1.0))) if coefficient else math.inf, power, coefficient)
        )
    left, power, coefficient = min(fits)
    if not (coefficient > 0.0 and left < LARGEST_DIFFERENCE_OF_LINES):
        raise UsageError(f"the force of {file} is neither that of Hertz nor that of Hooke")
    return TableLaw(
        name=f"{file}, {keyword}", style=style, points=points, distance=distance, force=force, slopes=slopes,
        touch=touch, power=power, coefficient=coefficient,
    )  # fmt: skip


def _radius(word: str, state: ReadScript) -> float:
    """Return the radius of all atoms of the types of a word such as ``*``, ``2`` or ``1*3``."""
    low, star, high = word.partition("*")
    first, last = int(low or 1), int(high or (10**9 if star else low))
    radii = {atom.radius for atom in state.particles.atoms.values() if first <= atom.kind <= last}
    if len(radii) != 1 or not min(radii) > 0.0:
        raise UsageError(f"the atoms of types {word} have no radius, or several, so that no distance is that of touch")
    return radii.pop()


def read_table(text: str, keyword: str, file: str) -> tuple[Floats, Floats, tuple[float, float]]:
    r"""Return distances, forces and the slopes at both ends of a section of a table file.

    Raises
    ------
    UsageError
        If there is no such section, or its lines are not those that it announces.

    Examples
    --------
    >>> read_table("# a table\n\nA\nN 3 R 1 3\n\n1 1 0 4\n2 2 0 1\n3 3 0 0\n", "A", "t")[2]
    (-3.0, -1.0)
    """
    rows = iter(text.splitlines())
    head: list[str] = []
    for row in rows:
        if row.split()[:1] == [keyword] and not row.startswith("#"):
            head = next((line.split() for line in rows if line.strip()), [])
            break
    try:
        count = int(head[head.index("N") + 1])
        found = [line.split() for line in rows if re.match(r"\s*\d", line)][:count]
        table = np.array([[float(word) for word in row[1:4]] for row in found])
        distance, force = table[:, 0], table[:, 2]
        for word in {"R", "RSQ"} & {*head}:
            low, high = (float(each) for each in head[head.index(word) + 1 :][:2])
            even = np.linspace(low, high, count) if word == "R" else np.sqrt(np.linspace(low**2, high**2, count))
            distance = even
        if "FPRIME" in head:
            low, high = (float(each) for each in head[head.index("FPRIME") + 1 :][:2])
            slopes = low, high
        else:  # LAMMPS takes those of the first and the last two lines
            ends = np.diff(force)[[0, -1]] / np.diff(distance)[[0, -1]]
            slopes = float(ends[0]), float(ends[1])
        if len(table) < count or not np.all(np.diff(distance) > 0.0) or not np.all(np.isfinite(table)):
            raise ValueError(count)
    except (ValueError, IndexError) as error:
        raise UsageError(
            f"the section {keyword} of {file} is no table of LAMMPS with as many lines as it says"
        ) from error
    return distance, force, slopes


def worst(laws: Iterable[TableLaw], deepest: float) -> TableLaw:
    """Return the table with the largest error of its force over overlaps up to ``deepest``."""
    return max(laws, key=lambda law: law.force_error(deepest))
