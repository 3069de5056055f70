"""A LAMMPS script that has been read, as a Scene: the line of particles, its contacts, walls, weight, load and drag.

Numbers are known as well as the script has them: overlaps, differences of positions, to the last digit of the farthest
position; stiffnesses to the round-off of K sqrt(R_eff). Each is taken as the shortest decimal within that, so that a
deck written from plain numbers gives these numbers back.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from dem_bridge.errors import SceneError
from dem_bridge.lmp.reader.deck import UNITS, Forces, ReadScript, read_script
from dem_bridge.lmp.reader.pairs import PairLaw
from dem_bridge.lmp.reader.particles import Particle
from dem_bridge.lmp.reader.script import Command, Opened
from dem_bridge.scene import Damping, Scene, Wall

#: round-off of the few operations between K and beta, and between density and mass
ROUND_OFF = 3.0 * 2.0**-52
#: overlaps at the start are those of a load in equilibrium within this part of themselves
EQUILIBRIUM_WITHIN = 1e-6
_AXES = "xyz"


@dataclass(frozen=True, kw_only=True)
class ReadDeck:
    """A scene and how it was read."""

    scene: Scene
    notes: tuple[str, ...]
    """Sentences: what was found, what was taken for granted."""


def plain(value: float, within: float) -> float:
    """The shortest decimal no farther than ``within`` from ``value``.

    >>> plain(0.30000000000000004, 1e-15), plain(1e-19, 1e-16), plain(0.1234, 0.0)
    (0.3, 0.0, 0.1234)
    """
    if abs(value) <= within:
        return 0.0
    for digits in range(16):
        short = float(f"{value:.{digits}e}")
        if abs(short - value) <= within:
            return short
    return value


def read_deck(
    text: str,
    *,
    file: str,
    opened: Opened,
    name: str | None = None,
    description: str | None = None,
    duration: float | None = None,
    samples: int | None = None,
    reverse: bool | None = None,
    variables: Mapping[str, str] | None = None,
) -> ReadDeck:
    """The scene of a LAMMPS script and how it was read; arguments as in :func:`dem_bridge.scene_from_deck`.

    ``opened``: the text of a file that the script names. Raises SceneError in one line for what is not understood.
    """
    found = read_script(text, file=file, opened=opened, variables=variables)
    if found.last is None:
        raise SceneError("", problem="has no command", allowed="a LAMMPS input script", where=file)
    for there, what in ((found.units != "lj", f"units {' or '.join(UNITS)}"), (found.pairs.said, "pair_style")):
        if not there:
            problem = "is the last command, and something is missing above it"
            raise found.last.refused(problem, f"a script with {what}")
    if not found.particles.atoms:
        raise found.last.refused("is the last command, and there is no atom", "read_data or create_atoms single")
    if found.run is None and duration is None:
        raise found.last.refused("is the last command, and there is no run", "run N, or a duration given beside it")
    length, time, mass = UNITS[found.units]
    if duration is None:
        duration = plain(found.duration * time, 2.0 * math.ulp(found.duration * time))
    else:
        found.duration = duration / time
    line = _line(found, reverse)
    notes = [line.found, *_named(found)]
    frames, how = (samples, "") if samples is not None else _samples(found)
    notes += [how] if how else []
    scene = _scene(
        line,
        {
            "name": name or scene_name(file),
            "description": description if description is not None else f"from {_printable(file)}: {line.found}",
            "duration": duration,
            "samples": frames,
        },
        (length, time, mass),
        notes,
    )
    return ReadDeck(scene=scene, notes=tuple(notes))


def scene_name(file: str) -> str:
    """What a scene is called that is read from a file: in.chain, chain.in and chain.lmp are "chain".

    >>> [scene_name(one) for one in ("runs/in.chain", "chain.csv", "my chain.in", "...")]
    ['chain', 'chain', 'my-chain', 'scene']
    """
    name = re.split(r"[/\\]", file)[-1]
    name = name.removeprefix("in.") if name.startswith("in.") else name.rpartition(".")[0] or name
    return re.sub(r"[^A-Za-z0-9._-]", "-", name).lstrip("._-")[:100] or "scene"


def _printable(text: str) -> str:
    return "".join(sign for sign in re.split(r"[/\\]", text)[-1] if sign.isprintable())


@dataclass(frozen=True, kw_only=True)
class _Line:
    """Particles in the order of the scene, walls included."""

    script: ReadScript
    forces: Forces
    axis: int
    sign: float
    """+1 where the scene's positive direction is that of the axis."""
    atoms: tuple[Particle, ...]
    left: bool
    right: bool
    found: str

    @property
    def bodies(self) -> tuple[Particle, ...]:
        return self.atoms[int(self.left) : len(self.atoms) - int(self.right)]

    @property
    def grain(self) -> float:
        """To which gaps are known."""
        return 2.0 * max(math.ulp(abs(one.place[self.axis]) + one.radius) for one in self.atoms)

    @property
    def gaps(self) -> list[float]:
        """Of each contact along the line, exact but for one rounding."""
        return [
            math.fsum((self.sign * b.place[self.axis], -self.sign * a.place[self.axis], -a.radius, -b.radius))
            for a, b in pairwise(self.atoms)
        ]

    def along(self, vectors: Mapping[int, list[float]], atom: Particle) -> float:
        """The component of what acts on an atom, positive as in the scene."""
        return self.sign * vectors.get(atom.number, [0.0, 0.0, 0.0])[self.axis] + 0.0  # no -0.0


def _line(found: ReadScript, reverse: bool | None) -> _Line:
    said = found.run or found.last
    assert said is not None  # the script has commands
    forces = found.acting or found.forces()
    atoms = list(found.particles.atoms.values())
    axis = _axis(said, atoms)
    atoms.sort(key=lambda one: one.place[axis])
    still = [_at_rest(said, one, forces, axis) for one in atoms]
    if all(still):
        raise said.refused("runs, and nothing moves", "fix nve on the bodies of the chain")
    left, right = still[0], still[-1]
    for one, held in list(zip(atoms, still, strict=True))[1:-1]:
        if held:
            raise said.refused(f"runs with atom {one.number} frozen inside of the chain", "frozen atoms at its ends")
    bodies = atoms[int(left) : len(atoms) - int(right)]
    if reverse is None:
        reverse = len(bodies) > 1 and bodies[0].velocity[axis] == 0.0 and bodies[-1].velocity[axis] != 0.0
    if reverse:
        atoms.reverse()
        bodies.reverse()
        left, right = right, left
    way = f"{'-' if reverse else '+'}{_AXES[axis]}"
    first = "which moves" if bodies[0].velocity[axis] else "the end of lowest coordinate"
    if reverse and not bodies[0].velocity[axis]:
        first = "the end of highest coordinate"
    line = _Line(
        script=found,
        forces=forces,
        axis=axis,
        sign=-1.0 if reverse else 1.0,
        atoms=tuple(atoms),
        left=left,
        right=right,
        found=f"the chain lies along {_AXES[axis]}; body 0 is atom {bodies[0].number} ({first}), positive is {way}",
    )
    _check_places(said, line)
    return line


def _axis(said: Command, atoms: list[Particle]) -> int:
    """Along which all lie and move; SceneError where they do not."""
    spread = [max(one.place[k] for one in atoms) - min(one.place[k] for one in atoms) for k in range(3)]
    moving = [max(abs(one.velocity[k]) for one in atoms) for k in range(3)]
    axis = max(range(3), key=lambda k: (spread[k], moving[k]))
    for k in range(3):
        if k != axis and (spread[k] > 0.0 or moving[k] > 0.0):
            kind, off = ("lie", spread[k]) if spread[k] > 0.0 else ("move", moving[k])
            problem = f"runs with atoms that {kind} off the line along {_AXES[axis]}, by {off:g} along {_AXES[k]}"
            raise said.refused(problem, "one straight line along x, y or z")
    return axis


def _at_rest(said: Command, atom: Particle, forces: Forces, axis: int) -> bool:
    """Whether an atom is part of a wall."""
    held = axis in forces.held.get(atom.number, ())
    if atom.number in forces.moves and not held:
        for across in range(3):
            acting = (vectors.get(atom.number, [0.0] * 3)[across] for vectors in (forces.gravity, forces.load))
            if across != axis and any(acting):  # what an earlier one of them did, setforce has taken away
                what = f"runs with a force on atom {atom.number} along {_AXES[across]}, across the chain"
                raise said.refused(what, f"forces along {_AXES[axis]}")
        return False
    if any(atom.velocity):
        why = "held by setforce or freeze" if held else "in no fix nve"
        problem = f"runs with atom {atom.number}, which is {why} and has a velocity"
        raise said.refused(problem, "walls at rest; a wall that is driven is no scene's")
    if atom.number in forces.moves and any(
        vectors.get(atom.number, [0.0] * 3)[axis] for vectors in (forces.gravity, forces.load)
    ):
        fix = forces.said.get("setforce", forces.said.get("freeze", said))
        raise fix.refused(f"stands before a force on atom {atom.number}, which then moves it", "it as the last fix")
    return True


def _check_places(said: Command, line: _Line) -> None:
    """Neighbours alone touch, which follows where none overlaps by a radius; and the box has no say."""
    for (a, b), gap in zip(pairwise(line.atoms), line.gaps, strict=True):
        if not gap > -min(a.radius, b.radius):
            raise said.refused(
                f"runs with atoms {a.number} and {b.number} {a.radius + b.radius + gap:g} apart, of radii"
                f" {a.radius:g} and {b.radius:g}",
                "neighbours that overlap by less than a radius",
            )
    particles = line.script.particles
    widest = 2.0 * max(one.radius for one in line.atoms)
    for k, (low, high) in enumerate(particles.box):
        if k == line.axis and particles.boundary[k] == "p" and high - low < 2.0 * _flight(line):
            raise said.refused(
                f"runs in a box that is periodic along the chain and {high - low:g} long: its ends may meet",
                "boundary f, s or m along it, or a box that none can fly through",
            )
        if k != line.axis and particles.boundary[k] == "p" and high - low < widest:
            problem = f"runs in a box that is {high - low:g} wide along {_AXES[k]}, so that atoms meet their images"
            raise said.refused(problem, f"{widest:g}, the largest diameter, or more")


def _flight(line: _Line) -> float:
    """Length of the chain and how far all energy at hand may carry its lightest body; the work of weight apart."""
    forces, duration = line.forces, line.script.duration
    length = sum(2.0 * one.radius for one in line.atoms) + sum(max(gap, 0.0) for gap in line.gaps)
    energy = sum(0.5 * one.mass * one.velocity[line.axis] ** 2 for one in line.atoms)
    for law, (a, b), gap in zip(_laws(line), pairwise(line.atoms), line.gaps, strict=True):
        beta = law.coefficient(a.radius * b.radius / (a.radius + b.radius))
        energy += beta * max(-gap, 0.0) ** law.exponent / law.exponent
    lightest = min(one.mass for one in line.bodies)
    push = max(
        abs(line.along(forces.gravity, one)) + abs(line.along(forces.load, one)) / one.mass for one in line.bodies
    )
    return length + math.sqrt(2.0 * energy / lightest) * duration + 0.5 * push * duration**2


def _laws(line: _Line) -> list[PairLaw]:
    return [line.script.pairs.between(a.kind, b.kind) for a, b in pairwise(line.atoms)]


def _named(found: ReadScript) -> list[str]:
    step = "" if found.step is None else f"; its time step is {found.step:g}"
    return [f"units {found.units}, pair_style {found.pairs.style}, {len(found.particles.atoms)} atoms{step}"]


def _samples(found: ReadScript) -> tuple[int, str]:
    """From the frames of the script's first dump; a deck of ours says it by ``per_sample``."""
    said = found.script.variables.get("per_sample", ("", ()))[1]
    every = int(said[0]) if said and said[0].isdigit() else found.dump_every
    if every and found.steps and found.steps % every == 0:
        return found.steps // every, ""
    default = Scene.samples
    why = "no dump at equal intervals of steps" if not every else f"{found.steps} steps, and dumps every {every}"
    return default, f"{default} samples, the default: the script has {why}"


def _scene(line: _Line, said: dict[str, Any], units: tuple[float, float, float], notes: list[str]) -> Scene:
    length, time, mass = units
    force = mass * length / time**2
    laws, gaps = _laws(line), [plain(gap * length, line.grain * length) for gap in line.gaps]
    ends = list(pairwise(line.atoms))
    radius = [a.radius * b.radius / (a.radius + b.radius) for a, b in ends]
    raw = [law.coefficient(r) * force / length ** (law.exponent - 1.0) for law, r in zip(laws, radius, strict=True)]
    for law, (a, b), one in zip(laws, ends, raw, strict=True):
        if not one > 0.0:
            what = f"leaves atoms {a.number} and {b.number}, which are neighbours, without a force"
            raise law.said.refused(what, "a stiffness > 0, or a pair_coeff of their own")
    stiffness = [plain(one, ROUND_OFF * one) for one in raw]
    exponent = [law.exponent for law in laws]
    inner = slice(int(line.left), len(laws) - int(line.right))

    def wall(there: bool, k: int) -> Wall | None:
        return Wall(stiffness=stiffness[k], gap=gaps[k], exponent=exponent[k]) if there else None

    # the scene counts walls behind the chain
    order = [*range(len(laws))[inner], *([0] if line.left else []), *([len(laws) - 1] if line.right else [])]
    parts: dict[str, Any] = said | {
        "mass": [(one.mass if one.weighed else plain(one.mass, ROUND_OFF * one.mass)) * mass for one in line.bodies],
        "velocity": [line.sign * one.velocity[line.axis] * length / time + 0.0 for one in line.bodies],
        "stiffness": stiffness[inner],
        "exponent": exponent[inner] or 2.5,
        "gap": gaps[inner],
        "wall_left": wall(line.left, 0),
        "wall_right": wall(line.right, len(laws) - 1),
        "gravity": _common(line, "gravity", length / time**2),
        "drag": _common(line, "langevin", 1.0 / time),
        "damping": _damping(line, [laws[k] for k in order], [ends[k] for k in order], time, force / length * time),
    }
    loads = [line.along(line.forces.load, one) * force for one in line.bodies]
    if not any(loads):
        return Scene(**parts)
    return _pressed(line, parts, loads, [gaps[k] for k in order], length, notes)


def _common(line: _Line, style: str, unit: float) -> float:
    """What acts on all bodies alike; SceneError where it does not."""
    forces = line.forces
    if style == "gravity":
        values = [line.along(forces.gravity, one) for one in line.bodies]
    else:
        values = [forces.drag.get(one.number, 0.0) for one in line.bodies]
    odd = next((k for k, one in enumerate(values) if one != values[0]), None)
    if odd is not None:
        a, b = line.bodies[0], line.bodies[odd]
        problem = f"gives atom {a.number} {values[0]:g} and atom {b.number} {values[odd]:g}"
        raise forces.said[style].refused(problem, "the same for all that moves")
    value = values[0] * unit
    return plain(value, ROUND_OFF * abs(value))


def _damping(
    line: _Line, laws: list[PairLaw], ends: list[tuple[Particle, Particle]], time: float, dashpot: float
) -> Damping | None:
    """Of the scene's contacts in its order; ``time``, ``dashpot``: SI values of the units of the two coefficients."""
    damped = [law for law in laws if law.eta > 0.0]
    if not damped:
        return None
    for law in damped:
        if not law.clipped:
            raise law.said.refused("has damping that may pull", "limit_damping: net forces of a scene never pull")
    viscous = any(law.damping == "viscoelastic" for law in damped)
    found = []
    for law, (a, b) in zip(laws, ends, strict=True):
        if law.eta == 0.0:
            found.append(0.0)
            continue
        radius, mass = a.radius * b.radius / (a.radius + b.radius), a.mass * b.mass / (a.mass + b.mass)
        for frozen, other in ((a, b), (b, a)):
            if frozen.number in line.forces.frozen:
                mass = other.mass
        hertz = law.model == "hertz"
        if (law.damping == "viscoelastic") != (viscous and hertz):
            raise law.said.refused(
                "has another damping than other contacts, or viscoelastic with hooke",
                "velocity or mass_velocity everywhere, or viscoelastic for hertz and velocity for hooke",
            )
        value = law.eta * (1.0 if law.damping == "velocity" else mass)
        if viscous:
            value *= (math.sqrt(radius) if hertz else 1.0) / law.coefficient(radius) * time
        else:
            value *= dashpot
        found.append(plain(value, 2.0 * ROUND_OFF * value))
    return Damping(law="kuwabara-kono" if viscous else "dashpot", coefficient=tuple(found))


def _pressed(
    line: _Line, parts: dict[str, Any], loads: list[float], gaps: list[float], length: float, notes: list[str]
) -> Scene:
    """The scene whose precompression gives these loads, if its static overlaps are those of the script."""
    said = line.forces.said["addforce"]
    end = loads[0] if parts["wall_left"] is None else -loads[-1]
    still: dict[str, Wall] = {}
    for side in ("wall_left", "wall_right"):
        if (wall := parts[side]) is not None:
            still[side] = Wall(stiffness=wall.stiffness, exponent=wall.exponent)
    try:
        scene = Scene(**parts | still | {"gap": 0.0, "precompression": end})
    except SceneError as error:
        raise said.refused(f"is no load that presses a chain ({error})", _LOADS) from None
    if not np.allclose(scene.load, loads, rtol=4.0 * ROUND_OFF, atol=0.0):
        k = int(np.argmax(np.abs(scene.load - loads)))
        problem = f"loads atom {line.bodies[k].number} with {loads[k]:g} N, where a chain that is pressed"
        raise said.refused(f"{problem} has {scene.load[k]:g} N", _LOADS)
    off = np.abs(scene.contacts.gap - gaps)
    far = off - np.maximum(2.0 * line.grain * length, EQUILIBRIUM_WITHIN * np.abs(scene.contacts.gap))
    if np.any(far > 0.0):
        k = int(np.argmax(far))
        problem = f"presses the chain, whose contact {k} starts with an overlap of {-gaps[k]:.9g} m"
        raise said.refused(f"{problem} and not of {-scene.contacts.gap[k]:.9g} m, that of equilibrium", _LOADS)
    notes.append(
        f"the load of {end:g} N is taken as precompression; overlaps at the start are within {np.max(off):.1e} m of its"
    )
    return scene


_LOADS = "a constant load inwards on each end body without a wall, and a start in equilibrium under it"
