"""LAMMPS decks: pure text from a scene, nothing read and nothing written.

The chain is laid along x, one sphere per body, walls as frozen spheres at its ends. In one dimension only overlaps
matter, so the radius is a free gauge; a small one keeps positions small and with them the round-off of their
differences (with the physical 9 mm LAMMPS cannot get below 1e-6). A power of two makes the start positions exact.
A deck has only the lines that its scene needs, and every float with all its digits.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.dense import Schedule
from dem_bridge.lmp.coefficients import GRANULAR_STYLE, TABLE_STYLE, Laws, laws, line_order, pairs
from dem_bridge.lmp.driving import drive_file, drive_variables
from dem_bridge.lmp.encoding import Types, body_types
from dem_bridge.lmp.pairing import Pairing, TableSet, granular, tabled
from dem_bridge.scene import Scene
from dem_bridge.version import FORM_DATE, __version__

Floats = NDArray[np.float64]

#: columns of the dump; with ``type`` and three coordinates other readers know it too
DUMP_COLUMNS = ("id", "type", "x", "y", "z", "vx", "fx")
#: more runs of equal masses than this are read from a file: each `set` looks at every atom
MOST_SETS = 300


@dataclass(frozen=True, kw_only=True)
class Deck:
    """Texts of a LAMMPS run and what is needed to read its answer back; arrays along the line of atoms."""

    name: str
    files: Mapping[str, str]
    """File name -> text; ``in.NAME`` is the deck, the others are read by it."""
    surrogate_radius: float
    """m."""
    line: Floats
    """Position of each atom at the start, m, as LAMMPS reads it; walls included."""
    weight: Floats
    """Constant force on each atom, N."""
    mobility: Floats
    """Inverse mass of each atom, 1/kg; 0 for a wall."""
    first_id: int
    """Atom id of body 0."""
    types: int
    schedule: Schedule
    encoded_radii: Floats | None = None
    """Of each atom, m, where they carry the stiffness; None: all have the gauge radius."""

    more_dumps: tuple[str, ...] = ()
    """Files that go on where the first dump ends."""

    @property
    def radii(self) -> Floats:
        """Of each atom, m."""
        return np.full(len(self.line), self.surrogate_radius) if self.encoded_radii is None else self.encoded_radii

    @property
    def reach(self) -> Floats:
        """Distance of the centres of neighbouring atoms at which they touch, m, ``(n_contact,)``."""
        return self.radii[:-1] + self.radii[1:]

    @property
    def input_file(self) -> str:
        return f"in.{self.name}"

    @property
    def dump_file(self) -> str:
        return f"dump.{self.name}.bin"

    @property
    def content_hash(self) -> str:
        """sha256 over names and texts."""
        text = "\0".join(part for file in sorted(self.files.items()) for part in file)
        return hashlib.sha256(text.encode()).hexdigest()


@dataclass(frozen=True, kw_only=True)
class _Line:
    """Everything that the lines of a deck are written from."""

    scene: Scene
    radius: float
    schedule: Schedule
    laws: Laws
    pairing: Pairing
    types: Types
    place: Floats
    mass: Floats
    """Of each atom; a wall weighs as much as its neighbour."""
    velocity: Floats
    walls: tuple[bool, bool]
    length: float
    """m: how much of the line is ever in use."""
    floor: float | None
    """Round-off to expect, of the largest velocity; None: the radius is a gauge."""

    @property
    def binsize(self) -> float:
        """Of the neighbour bins, m; 0: LAMMPS' own. They follow the radius: a far flight would need millions."""
        most = 20 * len(self.types) + 1000
        return self.length / most if self.length > 1.5 * self.radius * most else 0.0

    @property
    def masses(self) -> list[tuple[int, int]]:
        """Runs of bodies with equal masses, as the atom ids (first, last)."""
        left, right = self.walls
        body = self.mass[left : len(self.mass) - right]
        ends = np.flatnonzero(np.diff(body)) + 1
        first = np.concatenate([[0], ends]) + 1 + left
        last = np.concatenate([ends, [len(body)]]) + left
        return list(zip(first.tolist(), last.tolist(), strict=True))


def deck_of(
    scene: Scene,
    *,
    radius: float,
    schedule: Schedule,
    tables: TableSet | None = None,
    travel: float = 0.0,
    types: str = "euler",
    floor: float | None = None,
) -> Deck:
    """The deck of a scene: for ``pair_style table`` with the ``tables`` made for it, else for ``pair_style granular``.

    ``radius`` in m; ``travel`` (m): how far bodies get, roughly; ``types``: "euler", as few as can be, or "per-body";
    ``floor``: where the radius is the scene's own, the round-off that it costs, relative to the largest velocity.
    Raises ValueError where the style cannot express the scene.
    """
    reason = (GRANULAR_STYLE if tables is None else TABLE_STYLE).unsupported_reason(scene)
    if reason:
        raise ValueError(reason)
    found = laws(scene)
    pairing = granular(found, radius) if tables is None else tabled(found, radius, tables, scene.name)
    walls = (scene.wall_left is not None, scene.wall_right is not None)
    place = positions(scene, radius)
    around = (int(walls[0]), int(walls[1]))
    mass = np.pad(np.array(scene.mass), around, mode="edge")
    line = _Line(
        scene=scene,
        radius=radius,
        schedule=schedule,
        laws=found,
        pairing=pairing,
        types=body_types(found.where, types),
        place=place,
        mass=mass,
        velocity=np.pad(np.array(scene.velocity), around),
        walls=walls,
        length=float(place[-1] - place[0]) + travel,
        floor=floor,
    )
    files = {f"in.{scene.name}": "\n".join(_input(line)) + "\n", f"data.{scene.name}": "\n".join(_data(line)) + "\n"}
    files |= pairing.files
    if len(line.masses) > MOST_SETS:
        files[f"masses.{scene.name}"] = "\n".join(_mass_file(line)) + "\n"
    if scene.drive is not None and scene.drive.shape == "table":
        values = (_header(scene, "force on body 0 in N"), *drive_file(scene.drive))
        files[f"drive.{scene.name}"] = "\n".join(values) + "\n"
    return Deck(
        name=scene.name,
        files=MappingProxyType(files),
        surrogate_radius=radius,
        line=place,
        weight=np.pad(scene.steady_force, around),
        mobility=np.pad(1.0 / np.array(scene.mass), around),
        first_id=1 + walls[0],
        types=int(np.max(line.types)),
        schedule=schedule,
    )


def positions(scene: Scene, radius: float) -> Floats:
    """Centres along x of bodies of ``radius`` (m), with the walls' in their places; body 0 at 0."""
    first = int(scene.wall_left is not None)
    # sums in two doubles, so that nothing is lost on the way
    high, low, sums = 0.0, 0.0, [(0.0, 0.0)]
    for one in scene.contacts.gap[line_order(scene)].tolist():
        total = math.fsum((high, low, one))
        high, low = total, math.fsum((high, low, one, -total))
        sums.append((high, low))
    origin = sums[first]
    gaps = [math.fsum((*here, -origin[0], -origin[1])) for here in sums]
    line = 2.0 * radius * (np.arange(len(gaps)) - first)
    # a common grid, that of the farthest: bodies in touch are so to the last digit where the radius is a power of two
    grid = math.ulp(max(abs(x + gap) for x, gap in zip(line.tolist(), gaps, strict=True)))
    return np.asarray(line + np.array([round(gap / grid) * grid for gap in gaps]))


def _header(scene: Scene, what: str) -> str:
    return (
        f"# {what} of {scene.name}, written by dem_bridge {__version__}"
        f" DATE: {FORM_DATE} UNITS: si SCENE: sha256:{scene.content_hash}"
    )


def _input(line: _Line) -> Iterator[str]:
    scene, radius, plan = line.scene, line.radius, line.schedule
    binsize = f" binsize {line.binsize!r}" if line.binsize else ""
    kinds = int(np.max(line.types))
    alone = len(line.laws.stiffness) == scene.n_contact
    own = "each contact has its own pair" if alone else "contacts with the same law may share a pair"
    yield _header(scene, "LAMMPS deck")
    if scene.description:
        yield f"# {scene.description}"
    yield f"# {scene.n_body} bodies, {scene.n_contact} contacts, {kinds} atom types: {own}"
    if line.floor is None:
        yield f"# gauge radius R = {radius!r} m; {line.pairing.note}"
    else:
        far = float(np.max(np.abs(line.place)))
        known = f"overlaps, differences of positions up to {far:.3g} m, are known to {math.ulp(far):.1e} m"
        yield f"# radius R = {radius!r} m, half the spacing of the bodies; {line.pairing.note}"
        yield f"# {known}: expect round-off of {line.floor:.0e} of the"
        yield "# largest velocity, more with a finer step; with a gauge radius there is less, and motion is the same"
    yield ""
    yield "# run it in this folder; a finer step needs dt, per_sample and steps together: half, twice and twice"
    yield f"variable dt          index {plan.step!r}  # s"
    yield f"variable steps       index {plan.steps}"
    yield f"variable per_sample  index {plan.per_sample}  # steps between two samples"
    yield f"variable dense       index {plan.subdivisions}  # dumps per sample, for peaks and crossing times"
    yield f"variable dump        index dump.{scene.name}.bin  # any other ending gives text"
    if scene.gravity != 0.0:
        yield f"variable gravity     index {abs(scene.gravity)!r}  # m/s^2"
    if scene.drag > 0.0:
        yield f"variable drag_time   index {1.0 / scene.drag!r}  # s: drag is -mass * velocity / drag_time"
    if scene.drive is not None:
        yield from drive_variables(scene.drive, f"drive.{scene.name}", scene.duration)
    yield from (
        "",
        "units           si",
        "dimension       3",
        "boundary        m f f",
        "atom_style      sphere",
        "atom_modify     map array sort 0 0.0",
        "newton          on",
        "comm_modify     vel yes",
        f"read_data       data.{scene.name}",
    )
    yield from _masses(line)
    yield from (
        "",
        f"neighbor        {radius!r} bin",
        f"neigh_modify    delay 0 every 1 check yes{binsize}",
        *line.pairing.head,
    )
    yield from _coefficients(line)
    yield ""
    yield from _fixes(line)
    yield from (
        "timestep        ${dt}",
        "",
        "thermo_style    custom step time pe ke etotal",
        "thermo_modify   format float %.17g lost error",
        # at samples, where energies can be compared with those of the dump
        f"thermo          {max(1, plan.samples // 10) * plan.per_sample}",
        "# dumps fall on ceil(j * per_sample / dense), j = 0, 1, 2, ...; every dense-th one is a sample",
        'variable next   equal "ceil((floor(step*v_dense/v_per_sample) + 1)*v_per_sample/v_dense)"',
        f"dump            motion all custom 1 ${{dump}} {' '.join(DUMP_COLUMNS)}",
        "dump_modify     motion sort id every v_next first yes units yes time yes format float %.17g",
        "run             ${steps}",
    )


def _fixes(line: _Line) -> Iterator[str]:
    scene, walls = line.scene, line.walls
    group = "all"
    if any(walls):
        frozen = [str(i) for i, there in ((1, walls[0]), (len(line.types), walls[1])) if there]
        group = "bodies"
        yield f"group           walls id {' '.join(frozen)}"
        yield "group           bodies subtract all walls"
    yield f"fix             motion {group} nve"
    if scene.gravity != 0.0:
        yield f"fix             weight {group} gravity ${{gravity}} vector {1 if scene.gravity > 0 else -1} 0 0"
    if scene.drag > 0.0:
        # a bath at zero temperature takes mass * velocity / time and gives nothing back
        yield f"fix             drag {group} langevin 0 0 ${{drag_time}} 1"
    loads = scene.load.tolist()
    for body in np.flatnonzero(loads).tolist():
        yield f"group           load{body} id {body + 1 + walls[0]}"
        yield f"fix             load{body} load{body} addforce {loads[body]!r} 0 0"
    if scene.drive is not None:
        yield f"group           driven id {1 + walls[0]}"
        yield "fix             drive driven addforce v_drive 0 0"


def _masses(line: _Line) -> Iterator[str]:
    """``set`` gives the mass itself; a density in the data file gives it only up to round-off."""
    runs = line.masses
    if len(runs) > MOST_SETS:
        yield f"variable        mass atomfile masses.{line.scene.name}"
        yield "set             group all mass v_mass"
        return
    for first, last in runs:
        ids = f"{first}*{last}" if last > first else f"{first}"
        yield f"set             atom {ids} mass {float(line.mass[first - 1])!r}"


def _mass_file(line: _Line) -> Iterator[str]:
    yield _header(line.scene, "masses in kg")
    yield f"{len(line.mass)}"
    yield from _rows("{} {!r}".format, line.mass)


def _coefficients(line: _Line) -> Iterator[str]:
    order = line_order(line.scene)
    links = len(line.scene.stiffness)
    ends = [side for side, there in zip(("wall_left", "wall_right"), line.walls, strict=True) if there]
    for low, high, at, count in pairs(line.types):
        law, contact = int(line.laws.where[at]), int(order[at])
        name = f"contact {contact}" if contact < links else ends[contact - links]
        more = f" and {count - 1} more" if count > 1 else ""
        own = line.laws.functions is not None
        what = "a law of its own" if own else f"beta = {float(line.laws.stiffness[law])!r}"
        for behind in line.pairing.behind[law]:
            yield f"pair_coeff      {low} {high} {behind}  # {name}{more}: {what}"


def _data(line: _Line) -> Iterator[str]:
    # as thin as bodies are: there are bins across the line, too; but LAMMPS refuses bins much larger than the box
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
    yield from _rows(row, line.types, density, line.place)
    yield ""
    yield "Velocities"
    yield ""
    yield from _rows("{} {!r} 0 0 0 0 0".format, line.velocity)


def _rows(row: Callable[..., str], *columns: NDArray[Any], block: int = 10_000) -> Iterator[str]:
    """Lines ``row(atom id, *values)``, a block at a time: a long chain is never there as an object for each body."""
    for begin in range(0, len(columns[0]), block):
        values = [one[begin : begin + block].tolist() for one in columns]
        yield "\n".join(map(row, range(begin + 1, begin + block + 1), *values))
