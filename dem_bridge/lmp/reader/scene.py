"""Conversion of an evaluated LAMMPS script to a Scene: the line of particles, contacts, walls, weight, load and drag.

Numbers are known with the precision of the script: overlaps, which are differences of positions, to the last digit of
the farthest position; stiffnesses to the round-off of K sqrt(R_eff). Each is replaced by the shortest decimal within
that precision, so that a deck written from simple numbers gives these numbers back.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from dem_bridge.errors import SceneError
from dem_bridge.lmp.coefficients import BY_EFFECTIVE_MASS, DAMPINGS
from dem_bridge.lmp.reader.deck import UNITS, Forces, ReadScript, read_script
from dem_bridge.lmp.reader.pairs import PairLaw
from dem_bridge.lmp.reader.particles import Particle
from dem_bridge.lmp.reader.script import Command, Opened
from dem_bridge.scene import BY_RESTITUTION, Damping, Scene, Wall

#: round-off of the few operations between K and beta, and between density and mass
ROUND_OFF = 3.0 * 2.0**-52
#: largest relative difference between the initial overlaps and those of static equilibrium under the load
EQUILIBRIUM_WITHIN = 1e-6
_AXES = "xyz"
_NONE = [0.0, 0.0, 0.0]


@dataclass(frozen=True, kw_only=True)
class ReadDeck:
    """A scene that was read from a deck."""

    scene: Scene
    notes: tuple[str, ...]
    """Sentences about what was recognised and assumed."""


def plain(value: float, within: float) -> float:
    """Return the shortest decimal that differs from ``value`` by at most ``within``.

    Examples
    --------
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
    """Return the scene of a LAMMPS script, and notes on what was recognised and assumed.

    The parameters are those of :func:`dem_bridge.scene_from_deck`; ``opened`` is a function that returns the text of a
    file that the script names.

    Raises
    ------
    SceneError
        If a command is invalid or unsupported.
    """
    script = read_script(text, file=file, opened=opened, variables=variables)
    if script.last is None:
        raise SceneError("", problem="has no command", allowed="a LAMMPS input script", where=file)
    for present, what in ((script.units != "lj", f"units {' or '.join(UNITS)}"), (script.pairs.command, "pair_style")):
        if not present:
            problem = f"is the last command, but {what.split()[0]} is missing before it"
            raise script.last.error(problem, f"a script with {what}")
    if not script.particles.atoms:
        raise script.last.error("is the last command, but there is no atom", "read_data or create_atoms single")
    if script.run is None and duration is None:
        raise script.last.error("is the last command, but there is no run", "run N, or the setting duration")
    length, time, mass = UNITS[script.units]
    if duration is None:
        duration = plain(script.duration * time, 2.0 * math.ulp(script.duration * time))
    else:
        script.duration = duration / time
    line = _line(script, reverse)
    step = "" if script.step is None else f"; its time step is {script.step:g}"
    about = f"units {script.units}, pair_style {script.pairs.style}, {len(script.particles.atoms)} atoms{step}"
    notes = [line.description, about]
    count, remark = (samples, "") if samples is not None else _samples(script)
    notes += [remark] if remark else []
    if description is None:
        printable = "".join(sign for sign in re.split(r"[/\\]", file)[-1] if sign.isprintable())
        description = f"from {printable}: {line.description}"
    settings = {"name": name or scene_name(file), "description": description, "duration": duration, "samples": count}
    scene = _scene(line, settings, (length, time, mass), notes)
    return ReadDeck(scene=scene, notes=tuple(notes))


def scene_name(file: str) -> str:
    """Return the name of a scene that is read from a file: in.chain, chain.in and chain.lmp give "chain".

    Examples
    --------
    >>> [scene_name(file) for file in ("runs/in.chain", "chain.csv", "my chain.in", "...")]
    ['chain', 'chain', 'my-chain', 'scene']
    """
    name = re.split(r"[/\\]", file)[-1]
    name = name.removeprefix("in.") if name.startswith("in.") else name.rpartition(".")[0] or name
    return re.sub(r"[^A-Za-z0-9._-]", "-", name).lstrip("._-")[:100] or "scene"


@dataclass(frozen=True, kw_only=True)
class _Line:
    """Particles in the order of the scene, walls included."""

    script: ReadScript
    forces: Forces
    axis: int
    sign: float
    """+1 if the positive direction of the scene is that of the axis, else -1."""
    atoms: tuple[Particle, ...]
    left: bool
    right: bool
    description: str

    @property
    def bodies(self) -> tuple[Particle, ...]:
        """Particles without the walls."""
        return self.atoms[int(self.left) : len(self.atoms) - int(self.right)]

    @property
    def grain(self) -> float:
        """Precision of the gaps."""
        return 2.0 * max(math.ulp(abs(atom.place[self.axis]) + atom.radius) for atom in self.atoms)

    @property
    def gaps(self) -> list[float]:
        """Gap of each contact along the line, exact except for one rounding."""
        return [
            math.fsum((self.sign * b.place[self.axis], -self.sign * a.place[self.axis], -a.radius, -b.radius))
            for a, b in self.neighbours
        ]

    @property
    def neighbours(self) -> list[tuple[Particle, Particle]]:
        """The two particles of each contact along the line."""
        return list(pairwise(self.atoms))

    @property
    def laws(self) -> list[PairLaw]:
        """Law of each contact along the line."""
        return [self.script.pairs.between(a.kind, b.kind) for a, b in self.neighbours]

    @property
    def stiffness(self) -> list[float]:
        """Stiffness of each contact along the line, in the units of the script."""
        pairs = zip(self.laws, self.neighbours, strict=True)
        return [law.coefficient(_reduced(a.radius, b.radius)) for law, (a, b) in pairs]

    def along(self, vectors: Mapping[int, list[float]], atom: Particle) -> float:
        """Return the component of a vector of an atom along the chain, positive as in the scene."""
        return self.sign * vectors.get(atom.number, _NONE)[self.axis] + 0.0  # no -0.0


def _reduced(first: float, second: float) -> float:
    """Return the product of two radii or masses divided by their sum."""
    return first * second / (first + second)


def _line(script: ReadScript, reverse: bool | None) -> _Line:
    """Return the particles as a line, with body 0 at the moving end, or as ``reverse`` requires."""
    command = script.run or script.last
    assert command is not None  # the script has commands
    forces = script.acting or script.forces()
    atoms = list(script.particles.atoms.values())
    axis = _axis(command, atoms)
    atoms.sort(key=lambda atom: atom.place[axis])
    fixed = [_at_rest(command, atom, forces, axis) for atom in atoms]
    command.fail_if(all(fixed), "runs without any moving atom", "fix nve on the bodies of the chain")
    for atom, held in zip(atoms[1:-1], fixed[1:-1], strict=True):
        command.fail_if(held, f"runs with atom {atom.number} frozen inside of the chain", "frozen atoms at its ends")
    ends = [atom.velocity[axis] for atom, held in zip(atoms, fixed, strict=True) if not held]
    if reverse is None:
        reverse = ends[0] == 0.0 != ends[-1]
    if reverse:
        for values in (atoms, fixed, ends):
            values.reverse()
    first = "which moves" if ends[0] else f"the end of {'highest' if reverse else 'lowest'} coordinate"
    where = f"body 0 is atom {atoms[fixed[0]].number} ({first}), positive is {'-' if reverse else '+'}{_AXES[axis]}"
    line = _Line(
        script=script,
        forces=forces,
        axis=axis,
        sign=-1.0 if reverse else 1.0,
        atoms=tuple(atoms),
        left=fixed[0],
        right=fixed[-1],
        description=f"the chain lies along {_AXES[axis]}; {where}",
    )
    _check_places(command, line)
    return line


def _axis(command: Command, atoms: list[Particle]) -> int:
    """Return the axis along which all particles lie and move, or raise SceneError."""
    spread = [max(atom.place[k] for atom in atoms) - min(atom.place[k] for atom in atoms) for k in range(3)]
    moving = [max(abs(atom.velocity[k]) for atom in atoms) for k in range(3)]
    axis = max(range(3), key=lambda k: (spread[k], moving[k]))
    for k in range(3):
        if k != axis and (spread[k] > 0.0 or moving[k] > 0.0):
            kind, off = ("lie", spread[k]) if spread[k] > 0.0 else ("move", moving[k])
            problem = f"runs with atoms that {kind} off the line along {_AXES[axis]}, by {off:g} along {_AXES[k]}"
            raise command.error(problem, "one straight line along x, y or z")
    return axis


def _at_rest(command: Command, atom: Particle, forces: Forces, axis: int) -> bool:
    """Return True if an atom is part of a wall."""
    held = axis in forces.held.get(atom.number, ())
    acting = [vectors.get(atom.number, _NONE) for vectors in (forces.gravity, forces.load)]
    if atom.number in forces.moves and not held:
        for across in {0, 1, 2} - {axis}:
            if any(vector[across] for vector in acting):  # setforce has already removed the forces of earlier fixes
                what = f"runs with a force on atom {atom.number} along {_AXES[across]}, across the chain"
                raise command.error(what, f"forces along {_AXES[axis]}")
        return False
    if any(atom.velocity):
        why = "held by setforce or freeze" if held else "in no fix nve"
        problem = f"runs with atom {atom.number}, which is {why} and has a velocity"
        raise command.error(problem, "walls at rest, since a scene has no moving walls")
    if atom.number in forces.moves and any(vector[axis] for vector in acting):
        fix = forces.commands.get("setforce", forces.commands.get("freeze", command))
        raise fix.error(f"comes before a force on atom {atom.number}, which then moves it", "this fix as the last one")
    return True


def _check_places(command: Command, line: _Line) -> None:
    """Raise SceneError unless only neighbours can touch and the box does not affect the motion.

    Only neighbours touch if none of them overlap by a radius.
    """
    for (a, b), gap in zip(line.neighbours, line.gaps, strict=True):
        if not gap > -min(a.radius, b.radius):
            apart = f"{a.radius + b.radius + gap:g} apart, of radii {a.radius:g} and {b.radius:g}"
            problem = f"runs with atoms {a.number} and {b.number} {apart}"
            raise command.error(problem, "neighbours that overlap by less than a radius")
    particles = line.script.particles
    widest = 2.0 * max(atom.radius for atom in line.atoms)
    for k, (low, high) in enumerate(particles.box):
        if k == line.axis and particles.boundary[k] == "p" and high - low < 2.0 * _flight(line):
            problem = (
                f"runs in a box that is periodic along the chain and {high - low:g} long, so that its ends may meet"
            )
            raise command.error(problem, "boundary f, s or m along the chain, or a box that no body can cross")
        if k != line.axis and particles.boundary[k] == "p" and high - low < widest:
            problem = f"runs in a box that is {high - low:g} wide along {_AXES[k]}, so that atoms meet their images"
            raise command.error(problem, f"{widest:g}, the largest diameter, or more")


def _flight(line: _Line) -> float:
    """Return the length of the chain plus a bound of the distance that its lightest body can travel.

    The bound uses the initial energy, and the work of weight and load.
    """
    forces, duration = line.forces, line.script.duration
    length = sum(2.0 * atom.radius for atom in line.atoms) + sum(max(gap, 0.0) for gap in line.gaps)
    energy = sum(0.5 * atom.mass * atom.velocity[line.axis] ** 2 for atom in line.atoms)
    for law, beta, gap in zip(line.laws, line.stiffness, line.gaps, strict=True):
        energy += beta * max(-gap, 0.0) ** law.exponent / law.exponent
    lightest = min(atom.mass for atom in line.bodies)
    weight, load = ([abs(line.along(acting, atom)) for atom in line.bodies] for acting in (forces.gravity, forces.load))
    push = max(g + force / atom.mass for g, force, atom in zip(weight, load, line.bodies, strict=True))
    return length + math.sqrt(2.0 * energy / lightest) * duration + 0.5 * push * duration**2


def _samples(script: ReadScript) -> tuple[int, str]:
    """Return the number of samples, and a note if it is the default.

    It is that of the script's first dump; decks of dem_bridge state it by ``per_sample``.
    """
    words = script.script.variables.get("per_sample", ("", ()))[1]
    every = int(words[0]) if words and words[0].isdigit() else script.dump_every
    if every and script.steps and script.steps % every == 0:
        return script.steps // every, ""
    default = Scene.samples
    why = "no dump at equal intervals of steps" if not every else f"{script.steps} steps, and dumps every {every}"
    return default, f"{default} samples, the default: the script has {why}"


def _scene(line: _Line, settings: dict[str, Any], units: tuple[float, float, float], notes: list[str]) -> Scene:
    """Return the Scene of a line."""
    length, time, mass = units
    force = mass * length / time**2
    laws, gaps = line.laws, [plain(gap * length, line.grain * length) for gap in line.gaps]
    raw = [beta * force / length ** (law.exponent - 1.0) for law, beta in zip(laws, line.stiffness, strict=True)]
    for law, (a, b), value in zip(laws, line.neighbours, raw, strict=True):
        if not value > 0.0:
            problem = f"leaves atoms {a.number} and {b.number}, which are neighbours, without a force"
            raise law.command.error(problem, "a stiffness > 0, or another pair_coeff for these types")
    stiffness = [plain(value, ROUND_OFF * value) for value in raw]
    exponent = [law.exponent for law in laws]
    inner = slice(int(line.left), len(laws) - int(line.right))
    ends = {"wall_left": 0} if line.left else {}
    ends |= {"wall_right": len(laws) - 1} if line.right else {}
    # in the scene the walls come after the contacts of the chain
    order = [*range(len(laws))[inner], *ends.values()]
    parts: dict[str, Any] = settings | {
        "mass": [(b.mass if b.weighed else plain(b.mass, ROUND_OFF * b.mass)) * mass for b in line.bodies],
        "velocity": [line.sign * body.velocity[line.axis] * length / time + 0.0 for body in line.bodies],
        "stiffness": stiffness[inner],
        "exponent": exponent[inner] or 2.5,
        "gap": gaps[inner],
        "gravity": _common(line, "gravity", length / time**2),
        "drag": _common(line, "langevin", 1.0 / time),
        "damping": _damping(line, order, time, force / length * time),
        **{side: Wall(stiffness=stiffness[k], gap=gaps[k], exponent=exponent[k]) for side, k in ends.items()},
    }
    loads = [line.along(line.forces.load, body) * force for body in line.bodies]
    if not any(loads):
        return Scene(**parts)
    return _pressed(line, parts, loads, [gaps[k] for k in order], length, notes)


def _common(line: _Line, style: str, unit: float) -> float:
    """Return the gravity or drag that acts on all bodies, or raise SceneError if it differs between them."""
    forces = line.forces
    if style == "gravity":
        values = [line.along(forces.gravity, body) for body in line.bodies]
    else:
        values = [forces.drag.get(body.number, 0.0) for body in line.bodies]
    odd = next((k for k, value in enumerate(values) if value != values[0]), None)
    if odd is not None:
        a, b = line.bodies[0], line.bodies[odd]
        problem = f"gives atom {a.number} {values[0]:g} and atom {b.number} {values[odd]:g}"
        raise forces.commands[style].error(problem, "the same value for all moving atoms")
    value = values[0] * unit
    return plain(value, ROUND_OFF * abs(value))


def _damping(line: _Line, order: list[int], time: float, dashpot: float) -> Damping | None:
    """Return the damping of the scene's contacts, which are those along the line in this ``order``.

    ``time`` and ``dashpot`` are the SI values of the units of the two coefficients.
    """
    laws, stiffness = [line.laws[k] for k in order], line.stiffness
    damped = [law for law in laws if law.damped]
    if not damped:
        return None
    for law in damped:
        if law.clipped != damped[0].clipped:
            raise law.command.error("has another limit_damping than other contacts", "limit_damping in all, or in none")
    models, clipped = {law.damping for law in damped}, damped[0].clipped
    masses = [_effective_masses(line, *line.neighbours[k]) for k in order]
    light_wall = any(abs(engine / scene - 1.0) > ROUND_OFF for engine, scene in masses)
    name = next((name for name, model in DAMPINGS.items() if models == {model} and model in BY_EFFECTIVE_MASS), "")
    if name in BY_RESTITUTION and light_wall:
        problem = "gives contacts with a wall a damping that depends on the mass of the wall's atom"
        raise damped[0].command.error(problem, "fix freeze for this atom")
    if name in BY_RESTITUTION or (name and not light_wall):
        unit, idle = (1.0, 1.0) if name in BY_RESTITUTION else (1.0 / time, 0.0)
        values = [law.eta * unit if law.damped else idle for law in laws]
        values = [plain(value, ROUND_OFF * value) for value in values]
        return Damping(law=name, coefficient=tuple(values), clipped=clipped)
    viscous, coefficients = "viscoelastic" in models, []
    for k, law, (mass, _) in zip(order, laws, masses, strict=True):
        if not law.damped:
            coefficients.append(0.0)
            continue
        hertz, allowed = law.model == "hertz", ("velocity", "mass_velocity")
        if law.damping not in (("viscoelastic",) if viscous and hertz else allowed):
            raise law.command.error(
                "has other damping than other contacts, or viscoelastic with hooke",
                "velocity or mass_velocity everywhere, viscoelastic for hertz and velocity for hooke, or"
                " coeff_restitution or tsuji everywhere",
            )
        value = law.eta * (1.0 if law.damping == "velocity" else mass)
        if viscous:
            a, b = line.neighbours[k]
            value *= (math.sqrt(_reduced(a.radius, b.radius)) if hertz else 1.0) / stiffness[k] * time
        else:
            value *= dashpot
        coefficients.append(plain(value, 2.0 * ROUND_OFF * value))
    return Damping(law="kuwabara-kono" if viscous else "dashpot", coefficient=tuple(coefficients), clipped=clipped)


def _effective_masses(line: _Line, a: Particle, b: Particle) -> tuple[float, float]:
    """Return the effective mass of two neighbours as the engine has it, and as a scene has it.

    An atom of a wall has infinite mass in a scene, and in the engine under ``fix freeze``.
    """
    engine = scene = _reduced(a.mass, b.mass)
    walls = ([line.atoms[0]] if line.left else []) + ([line.atoms[-1]] if line.right else [])
    for atom, other in ((a, b), (b, a)):
        if atom.number in line.forces.frozen:
            engine = other.mass
        if any(atom is wall for wall in walls):
            scene = other.mass
    return engine, scene


def _pressed(
    line: _Line, parts: dict[str, Any], loads: list[float], gaps: list[float], length: float, notes: list[str]
) -> Scene:
    """Return the scene with the precompression of these loads, if its static overlaps are those of the script."""
    command = line.forces.commands["addforce"]
    end = loads[0] if "wall_left" not in parts else -loads[-1]
    walls = {side: replace(parts[side], gap=0.0) for side in ("wall_left", "wall_right") if side in parts}
    try:
        scene = Scene(**parts | walls | {"gap": 0.0, "precompression": end})
    except SceneError as error:
        raise command.error(f"is not a load that compresses a chain ({error})", _LOADS) from None
    if not np.allclose(scene.load, loads, rtol=4.0 * ROUND_OFF, atol=0.0):
        k = int(np.argmax(np.abs(scene.load - loads)))
        problem = f"loads atom {line.bodies[k].number} with {loads[k]:g} N, but a precompressed chain has"
        raise command.error(f"{problem} {scene.load[k]:g} N there", _LOADS)
    difference = np.abs(scene.contacts.gap - gaps)
    excess = difference - np.maximum(2.0 * line.grain * length, EQUILIBRIUM_WITHIN * np.abs(scene.contacts.gap))
    if np.any(excess > 0.0):
        k = int(np.argmax(excess))
        problem = f"compresses the chain, but contact {k} starts with an overlap of {-gaps[k]:.9g} m"
        raise command.error(f"{problem} instead of {-scene.contacts.gap[k]:.9g} m, that of equilibrium", _LOADS)
    notes.append(
        f"the load of {end:g} N is taken as precompression; initial overlaps differ from it by at most"
        f" {np.max(difference):.1e} m"
    )
    return scene


_LOADS = "a constant inward load on each end body without a wall, and initial overlaps in equilibrium with it"
