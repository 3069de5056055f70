"""The line of particles of an evaluated script: their order, contacts with each other and with plane walls."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

from dem_bridge.lmp.reader.evaluation import ReadScript
from dem_bridge.lmp.reader.fixes import Forces, Plane
from dem_bridge.lmp.reader.pair_laws import PairLaw
from dem_bridge.lmp.reader.particles import Particle
from dem_bridge.lmp.reader.script import Command

_AXES = "xyz"
#: sections of a law of contact by which it resists rolling or twisting
_RESISTS = re.compile(r"\b(rolling|twisting|rolling_friction)\s+(?!none\b)")
_NONE = [0.0, 0.0, 0.0]


@dataclass(frozen=True)
class LineContact:
    """A contact of two atoms, or of an atom and a plane, in the units of the script."""

    law: PairLaw
    gap: float
    """Exact except for one rounding."""
    radius: float
    """Effective radius; that of the atom at a plane."""
    mass: float
    """Effective mass as a scene has it, in which walls have infinite mass."""
    engine_mass: float
    """Effective mass as LAMMPS has it, in which atoms of ``fix freeze`` have infinite mass."""
    bodies: tuple[Particle, ...]
    """The two atoms, or the atom at a plane."""

    @property
    def stiffness(self) -> float:
        """Stiffness beta."""
        return self.law.coefficient(self.radius)

    @property
    def names(self) -> str:
        """The bodies, for messages."""
        numbers = [atom.number for atom in self.bodies]
        return f"atoms {numbers[0]} and {numbers[1]}" if len(numbers) > 1 else f"atom {numbers[0]} and its wall"


@dataclass(frozen=True, kw_only=True)
class Line:
    """Particles in the order of the scene, walls included."""

    script: ReadScript
    forces: Forces
    axis: int
    sign: float
    """+1 if the positive direction of the scene is that of the axis, else -1."""
    atoms: tuple[Particle, ...]
    """Frozen atoms at the ends included."""
    frozen: tuple[bool, bool]
    """True if the first or last atom is frozen, so that it is a wall."""
    planes: tuple[Plane | None, Plane | None]
    """Plane walls at both ends."""
    description: str
    piston: Command | None
    """The ``fix move`` of the first body; None if forces move it."""

    @property
    def driven(self) -> tuple[Particle, ...]:
        """The bodies that forces move."""
        return self.bodies if self.piston is None else self.bodies[1:]

    @property
    def order(self) -> list[int]:
        """Numbers of the contacts in the order of a scene: those of the chain, and then those with walls."""
        last = len(self.contacts) - 1
        inner = range(int(self.left), last + 1 - int(self.right))
        return [*inner, *[0] * self.left, *[last] * self.right]

    @property
    def left(self) -> bool:
        """True if the scene has a left wall."""
        return self.frozen[0] or self.planes[0] is not None

    @property
    def right(self) -> bool:
        """True if the scene has a right wall."""
        return self.frozen[1] or self.planes[1] is not None

    @property
    def bodies(self) -> tuple[Particle, ...]:
        """Particles without the walls."""
        return self.atoms[int(self.frozen[0]) : len(self.atoms) - int(self.frozen[1])]

    @property
    def grain(self) -> float:
        """Precision of the gaps."""
        ends = [abs(atom.place[self.axis]) + atom.radius for atom in self.atoms]
        return 2.0 * math.ulp(max(ends + [abs(plane.position) for plane in self.planes if plane is not None]))

    @cached_property
    def contacts(self) -> tuple[LineContact, ...]:
        """All contacts along the line, walls included."""
        contacts = [self._pair(a, b) for a, b in pairwise(self.atoms)]
        left, right = self.planes
        first = [] if left is None else [self._wall(self.atoms[0], left, -self.sign)]
        last = [] if right is None else [self._wall(self.atoms[-1], right, self.sign)]
        return (*first, *contacts, *last)

    def _pair(self, a: Particle, b: Particle) -> LineContact:
        """Return the contact of two atoms."""
        ends = (self.sign * b.place[self.axis], -self.sign * a.place[self.axis], -a.radius, -b.radius)
        mass = engine_mass = _reduced(a.mass, b.mass)
        for atom, other in ((a, b), (b, a)):
            if atom.number in self.forces.frozen:
                engine_mass = other.mass
            if (self.frozen[0] and atom is self.atoms[0]) or (self.frozen[1] and atom is self.atoms[-1]):
                mass = other.mass
        law = self.script.pairs.between(a.kind, b.kind)
        radius = _reduced(a.radius, b.radius)
        return LineContact(law, math.fsum(ends), radius, mass, engine_mass, (a, b))

    def _wall(self, atom: Particle, plane: Plane, way: float) -> LineContact:
        """Return the contact of an atom with a plane in the direction ``way`` of the axis."""
        gap = math.fsum((way * plane.position, -way * atom.place[self.axis], -atom.radius))
        law = plane.law or self.script.pairs.materials.law(plane.command, atom.kind, plane.kind, clip=plane.clip)
        return LineContact(law, gap, atom.radius, atom.mass, atom.mass, (atom,))

    def along(self, vectors: Mapping[int, list[float]], atom: Particle) -> float:
        """Return the component of a vector of an atom along the chain, positive as in the scene."""
        return self.sign * vectors.get(atom.number, _NONE)[self.axis] + 0.0  # no -0.0


def _reduced(first: float, second: float) -> float:
    """Return the product of two radii or masses divided by their sum."""
    return first * second / (first + second)


def line_of(script: ReadScript, reverse: bool | None) -> Line:
    """Return the particles as a line, with body 0 at the moving end, or as ``reverse`` requires.

    An atom of ``fix move`` is always body 0.
    """
    command = script.run or script.last
    assert command is not None  # the script has commands
    forces = script.acting or script.fixes.forces()
    atoms = list(script.particles.atoms.values())
    axis = axis_of(command, atoms, forces)
    atoms.sort(key=lambda atom: atom.place[axis])
    fixed = [_at_rest(command, atom, forces, axis) for atom in atoms]
    command.fail_if(all(fixed), "runs without any moving atom", "fix nve on the bodies of the chain")
    for atom, held in zip(atoms[1:-1], fixed[1:-1], strict=True):
        command.fail_if(held, f"runs with atom {atom.number} frozen inside of the chain", "frozen atoms at its ends")
    ends = [atom.velocity[axis] for atom, held in zip(atoms, fixed, strict=True) if not held]
    moved = [atom.number for atom in atoms if atom.number in forces.moved]
    if moved:
        reverse = moved == [atoms[-1].number]
    elif reverse is None:
        reverse = ends[0] == 0.0 != ends[-1]
    if reverse:
        for values in (atoms, fixed, ends):
            values.reverse()
    piston = forces.moved.get(atoms[0].number)
    if moved and (piston is None or len(moved) > 1):
        problem = f"runs with the atoms {', '.join(map(str, moved))} of fix move"
        raise command.error(problem, "one of them, the first of the chain, which has no wall behind it")
    first = (
        "which fix move moves"
        if piston
        else "which moves"
        if ends[0]
        else f"the end of {'highest' if reverse else 'lowest'} coordinate"
    )
    sign = -1.0 if reverse else 1.0
    planes = [_plane(atoms, forces, axis, sign * end) for end in (-1.0, 1.0)]
    where = f"body 0 is atom {atoms[fixed[0]].number} ({first}), positive is {'-' if reverse else '+'}{_AXES[axis]}"
    line = Line(
        script=script,
        forces=forces,
        axis=axis,
        sign=sign,
        atoms=tuple(atoms),
        frozen=(fixed[0], fixed[-1]),
        planes=(None if fixed[0] else planes[0], None if fixed[-1] else planes[1]),
        description=f"the chain lies along {_AXES[axis]}; {where}",
        piston=piston,
    )
    _check_places(command, line)
    _check_spins(line)
    return line


def _plane(atoms: list[Particle], forces: Forces, axis: int, way: float) -> Plane | None:
    """Return the plane wall at the end of the line in the direction ``way`` of the axis, or None."""
    end = max(atoms, key=lambda atom: way * atom.place[axis])
    walls = []
    for plane in forces.planes:
        if plane.axis != axis:
            for atom in atoms:
                if atom.number in plane.members and abs(atom.place[plane.axis] - plane.position) < atom.radius:
                    problem = f"touches atom {atom.number} from the side, across the chain"
                    raise plane.command.error(problem, f"walls across {_AXES[axis]}, or farther from the bodies")
            continue
        inside = [way * (plane.position - atom.place[axis]) for atom in atoms if atom.number in plane.members]
        if plane.side * way > 0.0 or not inside:  # the wall at the other end
            continue
        behind = any(distance <= 0.0 for distance in inside)
        if plane.side == 0 and all(distance <= 0.0 for distance in inside):
            continue
        plane.command.fail_if(behind, "has an atom behind it", "all atoms of the chain on one side of the wall")
        if end.number in plane.members:
            walls.append(plane)
    if len(walls) > 1:
        raise walls[1].command.error(f"is the second wall at one end, with {walls[0].command.text}", "one wall")
    return walls[0] if walls else None


def axis_of(command: Command, atoms: list[Particle], forces: Forces) -> int:
    """Return the axis along which all particles lie and move, or raise SceneError."""
    pulls = [*forces.gravity.values(), *forces.load.values(), _NONE]
    pull = [max(abs(vector[k]) for vector in pulls) for k in range(3)]
    walls = [sum(plane.axis == k for plane in forces.planes) for k in range(3)]
    spread = [max(atom.place[k] for atom in atoms) - min(atom.place[k] for atom in atoms) for k in range(3)]
    moving = [max(abs(atom.velocity[k]) for atom in atoms) for k in range(3)]
    axis = max(range(3), key=lambda k: (spread[k], moving[k], pull[k], walls[k]))
    for k in range(3):
        if k != axis and (spread[k] > 0.0 or moving[k] > 0.0):
            kind, off = ("lie", spread[k]) if spread[k] > 0.0 else ("move", moving[k])
            problem = f"runs with atoms that {kind} off the line along {_AXES[axis]}, by {off:g} along {_AXES[k]}"
            raise command.error(problem, "one straight line along x, y or z")
    return axis


def _at_rest(command: Command, atom: Particle, forces: Forces, axis: int) -> bool:
    """Return True if an atom is part of a wall."""
    if atom.number in forces.moved:
        return False
    held = axis in forces.held.get(atom.number, ())
    acting = [vectors.get(atom.number, _NONE) for vectors in (forces.gravity, forces.load)]
    if atom.number in forces.moves and not held:
        for across in {0, 1, 2} - {axis}:
            if any(vector[across] for vector in acting):  # setforce has already removed the forces of earlier fixes
                what = f"runs with a force on atom {atom.number} along {_AXES[across]}, across the chain"
                raise command.error(what, f"forces along {_AXES[axis]}")
        return False
    if any(atom.velocity):
        why = "setforce or freeze holds" if held else "no fix nve moves"
        problem = f"runs with atom {atom.number}, which {why} although it has a velocity"
        raise command.error(problem, "walls at rest, since a scene has no moving walls")
    if atom.number in forces.moves and any(vector[axis] for vector in acting):
        fix = forces.commands.get("setforce", forces.commands.get("freeze", command))
        raise fix.error(f"comes before a force on atom {atom.number}, which then moves it", "this fix as the last one")
    return True


def _check_places(command: Command, line: Line) -> None:
    """Raise SceneError unless only neighbours can touch and the box does not affect the motion.

    Only neighbours touch if none of them overlap by a radius.
    """
    for contact in line.contacts:
        if not contact.gap > -min(atom.radius for atom in contact.bodies):
            apart = f"{sum(atom.radius for atom in contact.bodies) + contact.gap:g} apart, of radii"
            radii = " and ".join(f"{atom.radius:g}" for atom in contact.bodies)
            problem = f"runs with {contact.names} {apart} {radii}"
            raise command.error(problem, "neighbours that overlap by less than a radius")
    particles = line.script.particles
    widest = 2.0 * max(atom.radius for atom in line.atoms)
    for k, (low, high) in enumerate(particles.box):
        if k == 2 and particles.dimension == 2:
            continue
        open_ended = k == line.axis and not (line.left and line.right)
        if open_ended and particles.boundary[k] == "p" and high - low < 2.0 * _flight(line):
            problem = (
                f"runs in a box that is periodic along the chain and {high - low:g} long, so that its ends may meet"
            )
            raise command.error(problem, "boundary f, s or m along the chain, or a box that no body can cross")
        if k != line.axis and particles.boundary[k] == "p" and high - low < widest:
            problem = f"runs in a box that is {high - low:g} wide along {_AXES[k]}, so that atoms meet their images"
            raise command.error(problem, f"{widest:g}, the largest diameter, or more")


def _check_spins(line: Line) -> None:
    """Raise SceneError unless the spins of the bodies cause no force: at each contact the two surfaces move alike.

    The surfaces of two bodies move alike across the chain if the sum of radius times spin is zero, as it is for equal
    spheres of equal and opposite spin. Rolling and twisting resistance would act nevertheless.
    """
    spun = line.script.particles.spun
    if spun is None:
        return
    allowed = "no spin, or spins of which the sum of radius times spin is 0 at each contact, such as equal and opposite"
    for contact in line.contacts:
        slip = [math.fsum(atom.radius * atom.spin[k] for atom in contact.bodies) for k in range(3)]
        along = [atom.spin[line.axis] for atom in contact.bodies]
        spun.fail_if(any(slip) or any(along), f"lets the surfaces of {contact.names} slide on each other", allowed)
        resisting = any(atom.spin != _NONE for atom in contact.bodies) and _RESISTS.search(contact.law.command.text)
        spun.fail_if(bool(resisting), f"spins {contact.names}, whose law resists rolling or twisting", allowed)


def _flight(line: Line) -> float:
    """Return the length of the chain plus a bound of the distance that its lightest body can travel.

    The bound uses the initial energy, and the work of weight and load.
    """
    forces, duration = line.forces, line.script.duration
    length = sum(2.0 * atom.radius for atom in line.atoms) + sum(max(contact.gap, 0.0) for contact in line.contacts)
    energy = sum(0.5 * atom.mass * atom.velocity[line.axis] ** 2 for atom in line.atoms)
    for contact in line.contacts:
        energy += contact.stiffness * max(-contact.gap, 0.0) ** contact.law.exponent / contact.law.exponent
    lightest = min(atom.mass for atom in line.bodies)
    weight, load = ([abs(line.along(acting, atom)) for atom in line.bodies] for acting in (forces.gravity, forces.load))
    push = max(g + force / atom.mass for g, force, atom in zip(weight, load, line.bodies, strict=True))
    return length + math.sqrt(2.0 * energy / lightest) * duration + 0.5 * push * duration**2
