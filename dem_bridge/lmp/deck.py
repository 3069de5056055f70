"""LAMMPS decks: pure text from a scene, nothing read and nothing written.

The chain is laid along x, one sphere per body, walls as frozen spheres at its ends. In one dimension only overlaps
matter, so the radius is a free gauge; a small one keeps positions small and with them the round-off of their
differences (with the physical 9 mm LAMMPS cannot get below 1e-6). A power of two makes the start positions exact.
Stiffness: ``pair_style granular`` with ``hertz K`` has F = K sqrt(R_eff) overlap^1.5, R_eff = R/2, hence
K = beta / sqrt(R/2) (LAMMPS manual, *pair_style granular*). Every float is written with all its digits.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby, pairwise
from types import MappingProxyType

import numpy as np

from dem_bridge.dense import Schedule
from dem_bridge.lmp.encoding import euler_types
from dem_bridge.scene import Scene
from dem_bridge.version import __version__

#: date of the deck's form, not of the day it is written: the same scene gives the same bytes
FORM_DATE = "2026-11-21"
#: columns of the dump; with ``type`` and three coordinates other readers know it too
DUMP_COLUMNS = ("id", "type", "x", "y", "z", "vx", "fx")
#: a contact law that is exactly elastic: these two clauses with zeros give no force at all
_ELASTIC = "tangential linear_nohistory 0 0 damping velocity"


@dataclass(frozen=True, kw_only=True)
class Deck:
    """Texts of a LAMMPS run and what is needed to read its answer back."""

    name: str
    files: Mapping[str, str]
    """File name -> text; ``in.NAME`` is the deck, the others are read by it."""
    gauge_radius: float
    """m."""
    line: tuple[float, ...]
    """Position of each atom at the start, m, as LAMMPS reads it; walls included."""
    weight: tuple[float, ...]
    """Constant force on each atom, N."""
    mobility: tuple[float, ...]
    """Inverse mass of each atom, 1/kg; 0 for a wall."""
    first_id: int
    """Atom id of body 0."""
    types: int
    schedule: Schedule

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


def refusal(scene: Scene) -> str | None:
    """Why ``pair_style granular`` cannot express the scene; None if it can."""
    if scene.dissipates:
        return "the deck has neither damping nor drag; take backend='scipy'"
    wrong = [k for k, n in enumerate(scene.contacts.exponent) if n != 2.5]
    if wrong:
        found = float(scene.contacts.exponent[wrong[0]])
        return f"contact {wrong[0]} has exponent n = {found!r}; pair_style granular's hertz has n = 2.5 only"
    return None


def granular_deck(scene: Scene, *, radius: float, schedule: Schedule, travel: float = 0.0) -> Deck:
    """The deck of a scene for ``pair_style granular``; ``radius`` in m, ``travel`` (m): how far bodies get, roughly.

    Raises ValueError where :func:`refusal` has a reason.
    """
    reason = refusal(scene)
    if reason:
        raise ValueError(reason)
    walls = (scene.wall_left is not None, scene.wall_right is not None)
    line = _positions(scene, radius)
    types = euler_types(len(line) - 1)
    files = {
        f"in.{scene.name}": "\n".join(_input(scene, radius, schedule, types, walls, line[-1] - line[0] + travel))
        + "\n",
        f"data.{scene.name}": "\n".join(_data(scene, radius, line, types, walls)) + "\n",
    }
    return Deck(
        name=scene.name,
        files=MappingProxyType(files),
        gauge_radius=radius,
        line=tuple(line),
        weight=(*[0.0] * walls[0], *(np.array(scene.mass) * scene.gravity + scene.load).tolist(), *[0.0] * walls[1]),
        mobility=(*[0.0] * walls[0], *(1.0 / m for m in scene.mass), *[0.0] * walls[1]),
        first_id=1 + walls[0],
        types=max(types),
        schedule=schedule,
    )


def _positions(scene: Scene, radius: float) -> list[float]:
    """Centres along x, with the walls' in their places; body 0 at 0. Each is rounded once."""
    gap = scene.contacts.gap.tolist()
    gaps, beside = gap[: scene.n_body - 1], gap[scene.n_body - 1 :]
    line = [math.fsum([2.0 * radius * i, *gaps[:i]]) for i in range(scene.n_body)] if any(gaps) else []
    line = line or [2.0 * radius * i for i in range(scene.n_body)]
    if scene.wall_left is not None:
        line.insert(0, -(2.0 * radius + beside[0]))
    if scene.wall_right is not None:
        line.append(math.fsum([2.0 * radius * scene.n_body, *gaps, beside[-1]]))
    return line


def _header(scene: Scene, what: str) -> str:
    return (
        f"# {what} of {scene.name}, written by dem_bridge {__version__}"
        f" DATE: {FORM_DATE} UNITS: si SCENE: sha256:{scene.content_hash}"
    )


def _input(
    scene: Scene, radius: float, plan: Schedule, types: tuple[int, ...], walls: tuple[bool, bool], length: float
) -> Iterator[str]:
    # LAMMPS' own bins follow the radius: bodies that fly far would need millions of them
    most_bins = 20 * len(types) + 1000
    binsize = f" binsize {length / most_bins!r}" if length > 1.5 * radius * most_bins else ""
    yield _header(scene, "LAMMPS deck")
    if scene.description:
        yield f"# {scene.description}"
    yield f"# {scene.n_body} bodies, {scene.n_contact} contacts, {max(types)} atom types: each contact has its own pair"
    yield f"# gauge radius R = {radius!r} m; stiffness K = beta / sqrt(R/2)"
    yield ""
    yield "# run it in this folder; a finer step needs dt, per_sample and steps together: half, twice and twice"
    yield f"variable dt          index {plan.step!r}  # s"
    yield f"variable steps       index {plan.steps}"
    yield f"variable per_sample  index {plan.per_sample}  # steps between two samples"
    yield f"variable dense       index {plan.subdivisions}  # dumps per sample, for peaks and crossing times"
    yield f"variable dump        index dump.{scene.name}.bin  # any other ending gives text"
    if scene.gravity != 0.0:
        yield f"variable gravity     index {abs(scene.gravity)!r}  # m/s^2"
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
    yield from _masses(scene, walls)
    yield from (
        "",
        f"neighbor        {radius!r} bin",
        f"neigh_modify    delay 0 every 1 check yes{binsize}",
        "pair_style      granular",
        f"pair_coeff      * * hertz 0 0 {_ELASTIC}",
    )
    yield from _coefficients(scene, radius, types, walls)
    yield ""
    group = "all"
    if any(walls):
        frozen = [str(i) for i, there in ((1, walls[0]), (len(types), walls[1])) if there]
        group = "bodies"
        yield f"group           walls id {' '.join(frozen)}"
        yield "group           bodies subtract all walls"
    yield f"fix             motion {group} nve"
    if scene.gravity != 0.0:
        yield f"fix             weight {group} gravity ${{gravity}} vector {1 if scene.gravity > 0 else -1} 0 0"
    for body, load in enumerate(scene.load.tolist()):
        if load != 0.0:
            yield f"group           load{body} id {body + 1 + walls[0]}"
            yield f"fix             load{body} load{body} addforce {load!r} 0 0"
    yield from (
        "timestep        ${dt}",
        "",
        "thermo_style    custom step time pe ke etotal",
        "thermo_modify   format float %.17g lost error",
        f"thermo          {max(1, plan.steps // 10)}",
        "# dumps fall on ceil(j * per_sample / dense), j = 0, 1, 2, ...; every dense-th one is a sample",
        'variable next   equal "ceil((floor(step*v_dense/v_per_sample) + 1)*v_per_sample/v_dense)"',
        f"dump            motion all custom 1 ${{dump}} {' '.join(DUMP_COLUMNS)}",
        "dump_modify     motion sort id every v_next first yes units yes time yes format float %.17g",
        "run             ${steps}",
    )


def _masses(scene: Scene, walls: tuple[bool, bool]) -> Iterator[str]:
    """``set`` gives the mass itself; a density in the data file gives it only up to round-off."""
    atom = 1 + walls[0]
    for mass, run in groupby(scene.mass):
        last = atom + len(list(run)) - 1
        ids = f"{atom}*{last}" if last > atom else f"{atom}"
        yield f"set             atom {ids} mass {mass!r}"
        atom = last + 1


def _coefficients(scene: Scene, radius: float, types: tuple[int, ...], walls: tuple[bool, bool]) -> Iterator[str]:
    stiffness = list(scene.stiffness)
    names = [f"contact {k}" for k in range(len(stiffness))]
    if scene.wall_left is not None:
        stiffness.insert(0, scene.wall_left.stiffness)
        names.insert(0, "wall_left")
    if scene.wall_right is not None:
        stiffness.append(scene.wall_right.stiffness)
        names.append("wall_right")
    for beta, name, pair in zip(stiffness, names, pairwise(types), strict=True):
        low, high = min(pair), max(pair)
        yield (
            f"pair_coeff      {low} {high} hertz {beta / math.sqrt(0.5 * radius)!r} 0 {_ELASTIC}"
            f"  # {name}: beta = {beta!r}"
        )


def _data(
    scene: Scene, radius: float, line: list[float], types: tuple[int, ...], walls: tuple[bool, bool]
) -> Iterator[str]:
    margin = 2.0 * radius
    yield _header(scene, "LAMMPS data")
    yield ""
    yield f"{len(line)} atoms"
    yield f"{max(types)} atom types"
    yield f"{min(line) - margin!r} {max(line) + margin!r} xlo xhi"
    yield f"{-4.0 * margin!r} {4.0 * margin!r} ylo yhi"
    yield f"{-4.0 * margin!r} {4.0 * margin!r} zlo zhi"
    yield ""
    yield "Atoms # sphere  (id type diameter density x y z; the masses are set in the deck)"
    yield ""
    volume = 4.0 / 3.0 * math.pi * radius**3
    masses = [*scene.mass[:1] * walls[0], *scene.mass, *scene.mass[-1:] * walls[1]]
    for atom, (kind, mass, x) in enumerate(zip(types, masses, line, strict=True), start=1):
        yield f"{atom} {kind} {2.0 * radius!r} {mass / volume!r} {x!r} 0 0"
    yield ""
    yield "Velocities"
    yield ""
    velocities = [*[0.0] * walls[0], *scene.velocity, *[0.0] * walls[1]]
    for atom, v in enumerate(velocities, start=1):
        yield f"{atom} {v!r} 0 0 0 0 0"
