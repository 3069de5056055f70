"""LAMMPS decks as text from a scene; no file is read or written.

The chain lies along x, with one sphere per body and frozen spheres at its ends as walls. In one dimension the motion
depends on overlaps only, so the particle radius is arbitrary. A small radius keeps positions small and with them the
round-off of their differences (with the physical radius of 9 mm LAMMPS cannot get below 1e-6); a power of two makes the
start positions exact. A deck has only the lines that its scene needs, and every float with all its digits.

A drive is a LAMMPS variable: the force on body 0 is a formula of the step, which LAMMPS evaluates in each step. LAMMPS
(2025-07-22) needs some microseconds per step for it: 6 for a sine, 11 for a table of any length, 17 for a chirp that
rises and ends. A table is in a file of its own, as one command. 5,000,000 values were read in 9 s; the only limit is
memory.

A piston is an atom of ``fix move``: ``linear`` at a constant velocity; ``wiggle``, whose velocity is largest at time 0,
for a sine of phase 90 or -90 degrees; else ``variable`` with formulas of displacement *and* velocity. With the velocity
alone LAMMPS sums it up to first order in the step. The atom is not frozen: its mass counts in damping.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.lmp.pair_coefficients import (
    BY_EFFECTIVE_MASS,
    GRANULAR_STYLE,
    TABLE_STYLE,
    TableSet,
    body_types,
    granular,
    laws,
    line_order,
    pairs,
    tabled,
)
from dem_bridge.physics.contact_law import Floats
from dem_bridge.scene.contacts import Contacts
from dem_bridge.scene.drive import Drive
from dem_bridge.scene.piston import Piston
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.dense import Schedule
from dem_bridge.version import FORM_DATE, __version__

_TEMPLATE = Path(__file__).with_name("deck.template")
#: columns of the dump; with ``type`` and three coordinates, other programs can read it
DUMP_COLUMNS = ("id", "type", "x", "y", "z", "vx", "fx")
#: mass of a wall over that of its neighbour, where the engine's force depends on the effective mass
HEAVY = 2.0**60
#: largest number of characters of a comment from outside
_LONGEST_COMMENT = 1000
#: more groups of equal masses than this are read from a file, because each `set` visits every atom
MOST_SETS = 300


@dataclass(frozen=True, kw_only=True)
class Deck:
    """Texts of a LAMMPS run and the information for reading its output; arrays are along the line of atoms."""

    name: str
    files: Mapping[str, str]
    """File name -> text; ``in.NAME`` is the deck, which reads the others."""
    surrogate_radius: float
    """Radius of all particles unless ``encoded_radii`` is given, m."""
    line: Floats
    """Position of each atom at the start as LAMMPS reads it, m, walls included."""
    weight: Floats
    """Constant force on each atom, N; 0 for walls and for a piston, on which no fix acts."""
    mobility: Floats
    """Inverse mass of each atom, 1/kg; 0 for a wall and for a piston."""
    first_id: int
    """Atom id of body 0."""
    types: int
    schedule: Schedule
    encoded_radii: Floats | None = None
    """Radius of each atom, m, if radii encode the stiffness; None if all have the surrogate radius."""
    more_dumps: tuple[str, ...] = ()
    """Dump files that continue the first one."""

    @property
    def radii(self) -> Floats:
        """Radius of each atom, m."""
        return np.full(len(self.line), self.surrogate_radius) if self.encoded_radii is None else self.encoded_radii

    @property
    def reach(self) -> Floats:
        """Distance between the centres of neighbouring atoms at touch, m, ``(n_contact,)``."""
        return self.radii[:-1] + self.radii[1:]

    @property
    def input_file(self) -> str:
        """Name of the deck."""
        return f"in.{self.name}"

    @property
    def dump_file(self) -> str:
        """Name of the dump."""
        return f"dump.{self.name}.bin"

    @property
    def content_hash(self) -> str:
        """sha256 of the names and texts."""
        text = "\0".join(part for file in sorted(self.files.items()) for part in file)
        return hashlib.sha256(text.encode()).hexdigest()


class _Line:
    """Everything that the lines of a deck are written from, for the arguments of :func:`deck_of`."""

    def __init__(
        self, scene: Scene, radius: float, tables: TableSet | None, travel: float, types: str, contacts: Contacts
    ) -> None:
        self.scene, self.radius = scene, radius
        self.laws = laws(scene)
        self.pairing = granular(self.laws, radius) if tables is None else tabled(self.laws, radius, tables, scene.name)
        self.walls = (int(scene.wall_left is not None), int(scene.wall_right is not None))
        self.place = positions(scene, radius, contacts)
        #: mass of each atom, kg; a wall has that of its neighbour, or is so heavy that the effective mass is the body's
        self.mass = np.pad(np.array(scene.mass), self.walls, mode="edge")
        if self.laws.damping in BY_EFFECTIVE_MASS:
            heavy = np.pad(np.zeros(scene.n_body, dtype=bool), self.walls, constant_values=True)
            self.mass[heavy] *= HEAVY
        self.velocity = np.pad(np.array(scene.velocity), self.walls)
        self.types = body_types(self.laws.where, types)
        #: length of the line that bodies ever occupy, m
        self.length = float(self.place[-1] - self.place[0]) + travel

    @property
    def binsize(self) -> float:
        """Size of the neighbour bins, m; 0 means LAMMPS' default.

        The default follows the radius; a long flight would need millions of bins.
        """
        most = 20 * len(self.types) + 1000
        return self.length / most if self.length > 1.5 * self.radius * most else 0.0

    @property
    def masses(self) -> list[tuple[int, int]]:
        """Groups of successive bodies with equal masses, as atom ids (first, last)."""
        left, bodies = self.walls[0], self.scene.n_body
        ends = np.flatnonzero(np.diff(self.scene.mass)) + 1 + left
        return list(zip([1 + left, *(ends + 1).tolist()], [*ends.tolist(), bodies + left], strict=True))


def deck_of(
    scene: Scene,
    *,
    radius: float,
    schedule: Schedule,
    tables: TableSet | None = None,
    travel: float = 0.0,
    types: str = "euler",
    floor: float | None = None,
    contacts: Contacts | None = None,
) -> Deck:
    """Return the deck of a scene for ``pair_style granular``, or for ``pair_style table`` with its ``tables``.

    Parameters
    ----------
    scene : Scene
        The scene.
    radius : float
        Particle radius, m.
    schedule : Schedule
        Time steps and samples.
    tables : TableSet, optional
        Tables that were made for this scene.
    travel : float
        Approximate distance that bodies travel, m.
    types : {"euler", "per-body"}
        "euler" uses as few atom types as possible.
    floor : float, optional
        Round-off that the radius causes, relative to the largest velocity, if it is the radius of the scene's bodies.
    contacts : Contacts, optional
        Those of the scene with other gaps, for a search. None: the scene's own.

    Raises
    ------
    ValueError
        If the pair style cannot express the scene.
    """
    reason = (GRANULAR_STYLE if tables is None else TABLE_STYLE).unsupported_reason(scene)
    if reason:
        raise ValueError(reason)
    line = _Line(scene, radius, tables, travel, types, contacts or scene.contacts)
    files = {f"in.{scene.name}": _input(line, schedule, floor), f"data.{scene.name}": _lines(*_data(line))}
    files |= line.pairing.files
    if len(line.masses) > MOST_SETS:
        rows = numbered_rows("{} {!r}".format, line.mass)
        files[f"masses.{scene.name}"] = _lines(_header(scene, "masses in kg"), f"{len(line.mass)}", *rows)
    if scene.drive is not None and scene.drive.shape == "table":
        files[f"drive.{scene.name}"] = _lines(*_drive_file(scene))
    return Deck(
        name=scene.name,
        files=MappingProxyType(files),
        surrogate_radius=radius,
        line=line.place,
        weight=np.pad(np.where(scene.mobility[:-1] > 0.0, scene.steady_force, 0.0), line.walls),
        mobility=np.pad(scene.mobility[:-1], line.walls),
        first_id=1 + line.walls[0],
        types=int(np.max(line.types)),
        schedule=schedule,
    )


def positions(scene: Scene, radius: float, contacts: Contacts | None = None) -> Floats:
    """Return the centres along x of bodies of ``radius`` (m), walls included, with body 0 at 0.

    ``contacts``: those of the scene with other gaps; None: its own.
    """
    first = int(scene.wall_left is not None)
    # sums in two doubles, without round-off
    high, low, sums = 0.0, 0.0, [(0.0, 0.0)]
    for gap in (contacts or scene.contacts).gap[line_order(scene)].tolist():
        total = math.fsum((high, low, gap))
        high, low = total, math.fsum((high, low, gap, -total))
        sums.append((high, low))
    origin = sums[first][0]  # 0, or the gap of the left wall
    gaps = [math.fsum((*here, -origin)) for here in sums]
    line = 2.0 * radius * (np.arange(len(gaps)) - first)
    # a common grid, that of the farthest position: if the radius is a power of two, bodies in touch have overlap 0
    grid = math.ulp(max(abs(x + shift) for x, shift in zip(line.tolist(), gaps, strict=True)))
    return np.asarray(line + np.array([round(shift / grid) * grid for shift in gaps]))


def _header(scene: Scene, what: str) -> str:
    """Return the first line of a file."""
    return (
        f"# {what} of {scene.name}, written by dem_bridge {__version__}"
        f" DATE: {FORM_DATE} UNITS: si SCENE: sha256:{scene.content_hash}"
    )


def as_comment(text: str) -> str:
    r"""Return a text as the words of a comment of a deck, which end with its line and have no meaning for LAMMPS.

    Three quotation marks or an ampersand at the end would make LAMMPS read on after the line, also within a comment.

    >>> print(as_comment('a \"\"\" at 2 \u00b5m &'))
    a ''' at 2 \xb5m and
    """
    line = re.sub(r"[^ -~]", lambda sign: " " if sign[0].isspace() else ascii(sign[0])[1:-1], text)
    line = re.sub('"{3,}', lambda quotes: "'" * len(quotes[0]), line)
    return re.sub(r"[&\s]*&\s*$", " and", line)[:_LONGEST_COMMENT]


def _lines(*lines: str) -> str:
    """Return lines as text."""
    return "".join(f"{line}\n" for line in lines)


def _input(line: _Line, plan: Schedule, floor: float | None) -> str:
    """Return the deck, as ``deck.template`` has it."""
    scene, radius = line.scene, line.radius
    alone = len(line.laws.stiffness) == scene.n_contact
    size = f"# surrogate radius R = {radius!r} m (arbitrary: forces depend on overlaps only); {line.pairing.note}"
    if floor is not None:
        far = float(np.max(np.abs(line.place)))
        precision = f"differences of positions up to {far:.3g} m with a resolution of {math.ulp(far):.1e} m"
        size = (
            f"# radius R = {radius!r} m, half the spacing of the bodies; {line.pairing.note}\n"
            f"# overlaps are {precision}; expect a round-off error of {floor:.0e} of\n"
            "# the largest velocity, more with a smaller time step; a surrogate radius gives less and the same motion"
        )
    return _TEMPLATE.read_text(encoding="utf-8").format(
        header=_header(scene, "LAMMPS deck"),
        description=_lines(f"# {as_comment(scene.description)}") if scene.description else "",
        scene=scene,
        plan=plan,
        kinds=int(np.max(line.types)),
        sharing=f"{'each contact has its own' if alone else 'contacts with the same law may share a'} pair of types",
        size=size,
        variables=_lines(*_variables(scene)),
        masses=_lines(*_masses(line)),
        radius=radius,
        binsize=f" binsize {line.binsize!r}" if line.binsize else "",
        pairs=_lines(*line.pairing.head, *_coefficients(line)),
        fixes=_lines(*_fixes(line)),
        # at samples, so that energies can be compared with those of the dump
        thermo=max(1, plan.samples // 10) * plan.per_sample,
        columns=" ".join(DUMP_COLUMNS),
    )


def _variables(scene: Scene) -> Iterator[str]:
    """Yield the variables of the forces that act on bodies, and of the motion of a piston."""
    if scene.gravity != 0.0:
        yield f"variable gravity     index {abs(scene.gravity)!r}  # m/s^2"
    if scene.drag > 0.0:
        yield f"variable drag_time   index {1.0 / scene.drag!r}  # s; the drag force is -mass * velocity / drag_time"
    if scene.driving_force is not None:
        yield from drive_variables(scene.driving_force, f"drive.{scene.name}", scene.duration)
    if scene.piston is not None:
        yield from piston_variables(scene.piston, f"drive.{scene.name}")


def _fixes(line: _Line) -> Iterator[str]:
    """Yield the groups and fixes of the deck."""
    scene, walls = line.scene, line.walls
    group, apart = "all", []
    if any(walls):
        frozen = [str(i) for i, there in ((1, walls[0]), (len(line.types), walls[1])) if there]
        apart.append("walls")
        yield f"group           walls id {' '.join(frozen)}"
    if scene.piston is not None:
        apart.append("piston")
        yield f"group           piston id {1 + walls[0]}"
    if apart:
        group = "bodies"
        yield f"group           bodies subtract all {' '.join(apart)}"
    yield f"fix             motion {group} nve"
    if scene.gravity != 0.0:
        yield f"fix             weight {group} gravity ${{gravity}} vector {1 if scene.gravity > 0 else -1} 0 0"
    if scene.drag > 0.0:
        # a heat bath at zero temperature exerts the drag force -mass * velocity / time without noise
        yield f"fix             drag {group} langevin 0 0 ${{drag_time}} 1"
    loads = scene.load.tolist()
    if scene.piston is not None:
        yield f"fix             piston piston move {_move(scene.piston)}"
        loads[0] = 0.0
    for body in np.flatnonzero(loads).tolist():
        yield f"group           load{body} id {body + 1 + walls[0]}"
        yield f"fix             load{body} load{body} addforce {loads[body]!r} 0 0"
    if scene.driving_force is not None:
        yield f"group           driven id {1 + walls[0]}"
        yield "fix             drive driven addforce v_drive 0 0"


def _masses(line: _Line) -> Iterator[str]:
    """Yield the ``set`` commands of the masses; a density in the data file gives a mass only up to round-off."""
    runs = line.masses
    if len(runs) > MOST_SETS:
        yield f"variable        mass atomfile masses.{line.scene.name}"
        yield "set             group all mass v_mass"
        return
    for first, last in runs:
        ids = f"{first}*{last}" if last > first else f"{first}"
        yield f"set             atom {ids} mass {float(line.mass[first - 1])!r}"


def _coefficients(line: _Line) -> Iterator[str]:
    """Yield the ``pair_coeff`` lines of the deck."""
    order = line_order(line.scene)
    links = len(line.scene.stiffness)
    ends = [side for side, present in zip(("wall_left", "wall_right"), line.walls, strict=True) if present]
    for low, high, at, count in pairs(line.types):
        law, contact = int(line.laws.where[at]), int(order[at])
        name = f"contact {contact}" if contact < links else ends[contact - links]
        more = f" and {count - 1} more" if count > 1 else ""
        is_function = line.laws.functions is not None
        what = "not a power law" if is_function else f"beta = {float(line.laws.stiffness[law])!r}"
        for behind in line.pairing.behind[law]:
            yield f"pair_coeff      {low} {high} {behind}  # {name}{more}: {what}"


def _data(line: _Line) -> Iterator[str]:
    """Yield the lines of the data file."""
    # the box is about as wide as a body, because there are bins across the line too, and LAMMPS rejects bins that are
    # much larger than the box
    margin = max(2.0 * line.radius, line.binsize)
    across = 0.5 * margin
    yield _header(line.scene, "LAMMPS data")
    yield ""
    yield f"{len(line.types)} atoms"
    yield f"{int(np.max(line.types))} atom types"
    yield f"{float(np.min(line.place)) - margin!r} {float(np.max(line.place)) + margin!r} xlo xhi"
    yield f"{-across!r} {across!r} ylo yhi"
    yield f"{-across!r} {across!r} zlo zhi"
    yield ""
    yield "Atoms # sphere  (id type diameter density x y z; the masses are set in the deck)"
    yield ""
    density = line.mass / (4.0 / 3.0 * math.pi * line.radius**3)
    row = f"{{}} {{}} {2.0 * line.radius!r} {{!r}} {{!r}} 0 0".format
    yield from numbered_rows(row, line.types, density, line.place)
    yield ""
    yield "Velocities"
    yield ""
    yield from numbered_rows("{} {!r} 0 0 0 0 0".format, line.velocity)


def numbered_rows(row: Callable[..., str], *columns: NDArray[Any], block: int = 10_000) -> Iterator[str]:
    """Yield lines ``row(atom id, *values)`` in blocks, so that a long chain never exists as one object per body."""
    for begin in range(0, len(columns[0]), block):
        values = [column[begin : begin + block].tolist() for column in columns]
        yield "\n".join(map(row, range(begin + 1, begin + block + 1), *values))


#: time, s, as a formula
_TIME = "(step*v_dt)"
#: the same by the time step that LAMMPS has, which follows `timestep`
_CLOCK = "(step*dt)"
#: values per line of a table
_ON_A_LINE = 4


def drive_variables(drive: Drive, file: str, duration: float) -> Iterator[str]:
    """Yield the lines that define ``v_drive`` as the force (N) at each step of ``v_dt`` s.

    ``file`` contains the values of a table. The force is one formula, except for the cells of a table: LAMMPS passes
    the value of a variable within another with 15 digits, which would limit the accuracy of a phase of many turns.
    """
    if drive.shape == "table":
        yield f"include {file}  # defines the variable drive_force, N"
        yield f"variable drive_cell  equal floor({_TIME}/{drive.interval!r})  # interval of {drive.interval!r} s"
        yield "variable drive_this  equal v_drive_cell+1  # LAMMPS counts from 1"
        yield "variable drive_next  equal v_drive_cell+2"
        fraction = f"({_TIME}/{drive.interval!r}-v_drive_cell)"
        difference = f"(v_drive_force[v_drive_next]-v_drive_force[v_drive_this])*{fraction}"
        yield f"variable drive       equal v_drive_force[v_drive_this]+{difference}  # N: {drive.words}"
        return
    assert drive.frequency is not None
    first, phase = 2.0 * math.pi * drive.frequency, math.radians(drive.phase)
    angle = f"{first!r}*{_TIME}"
    if drive.shape == "chirp":
        assert drive.last_frequency is not None
        assert drive.sweep is not None
        last = 2.0 * math.pi * drive.last_frequency
        swept = _TIME if drive.sweep >= duration else _at_most(drive.sweep)
        angle = f"({first!r}+({0.5 * (last - first) / drive.sweep!r})*{swept})*{swept}"
        if drive.sweep < duration:
            angle += f"+{last!r}*({_TIME}-{swept})"
    envelope = f"*sin({0.5 * math.pi / drive.rise!r}*{_at_most(drive.rise)})^2" if drive.rise > 0.0 else ""
    offset = f"+({phase!r})" if phase != 0.0 else ""
    yield f"variable drive       equal {drive.force!r}{envelope}*sin({angle}{offset})  # N: {drive.words}"


def _at_most(time: float) -> str:
    """Return a formula for the minimum of the current time and ``time`` (s), exact; LAMMPS has no minimum function."""
    return f"(({_TIME}<{time!r})*{_TIME}+({_TIME}>={time!r})*{time!r})"


def _move(piston: Piston) -> str:
    """Return the style of ``fix move`` of a piston, with its arguments."""
    if piston.shape == "constant":
        return f"linear {piston.velocity!r} 0 0"
    if (sign := {90.0: 1.0, -90.0: -1.0, 270.0: -1.0}.get(piston.phase)) and piston.frequency is not None:
        # LAMMPS moves it by A sin(2 pi t / period)
        return f"wiggle {sign * piston.peak / piston.turn!r} 0 0 {1.0 / piston.frequency!r}"
    return "variable v_piston_x NULL NULL v_piston_v NULL NULL"


def piston_variables(piston: Piston, file: str) -> Iterator[str]:
    """Yield the lines that define ``v_piston_x`` (m) and ``v_piston_v`` (m/s) at each step, where needed.

    ``file`` contains the values of a table and the displacements at their times.
    """
    if "variable" not in _move(piston):
        return
    if piston.shape == "table":
        interval, place = repr(piston.interval), f"{_CLOCK}/{piston.interval!r}"
        yield f"include {file}  # defines the variables piston_velocity, m/s, and piston_way, m"
        yield f"variable piston_this equal floor({place})+1  # interval of {interval} s; LAMMPS counts from 1"
        yield f"variable piston_next equal floor({place})+2"
        # passed with 15 digits, which is 1e-15 of what the velocity changes by in an interval
        yield f"variable piston_part equal {place}-floor({place})"
        low, high = "v_piston_velocity[v_piston_this]", "v_piston_velocity[v_piston_next]"
        mean = f"(0.5*({high}-{low})*v_piston_part+{low})"
        yield f"variable piston_x    equal v_piston_way[v_piston_this]+{interval}*v_piston_part*{mean}  # m"
        yield f"variable piston_v    equal {low}+({high}-{low})*v_piston_part  # m/s: {piston.words}"
        return
    phase = math.radians(piston.phase)
    angle = f"{piston.turn!r}*{_CLOCK}{f'+({phase!r})' if phase != 0.0 else ''}"
    yield f"variable piston_x    equal {piston.peak / piston.turn!r}*({math.cos(phase)!r}-cos({angle}))  # m"
    yield f"variable piston_v    equal {piston.peak!r}*sin({angle})  # m/s: {piston.words}"


def _drive_file(scene: Scene) -> Iterator[str]:
    """Yield the lines of the file with the table of a drive."""
    if (drive := scene.driving_force) is not None and isinstance(drive.force, tuple):
        yield _header(scene, "force on body 0 in N")
        yield from vector_lines("drive_force", (*drive.force, drive.force[-1]))
    if (piston := scene.piston) is not None and isinstance(piston.velocity, tuple):
        yield _header(scene, "velocity of body 0 in m/s and its displacement in m")
        yield from vector_lines("piston_velocity", (*piston.velocity, piston.velocity[-1]))
        yield from vector_lines("piston_way", (*piston.knots.tolist(), piston.knots[-1].item()))


def vector_lines(name: str, values: Sequence[float]) -> Iterator[str]:
    """Yield the command, over many lines, that defines a vector of LAMMPS.

    The last value of a table is given twice, because LAMMPS reads one value beyond it at the end.
    """
    words = list(map(repr, values))
    rows = [",".join(words[at : at + _ON_A_LINE]) for at in range(0, len(words), _ON_A_LINE)]
    yield f"variable {name} vector [&"
    yield from (f"{row},&" for row in rows[:-1])
    yield f"{rows[-1]}]"
