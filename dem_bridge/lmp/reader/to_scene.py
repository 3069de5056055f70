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
from typing import Any

import numpy as np

from dem_bridge.errors import BlockedScript, SceneError
from dem_bridge.foundation.numbers import whole_number
from dem_bridge.lmp.pair_coefficients import BY_EFFECTIVE_MASS, DAMPINGS
from dem_bridge.lmp.reader import pair_laws
from dem_bridge.lmp.reader.chain import Line, axis_of, line_of
from dem_bridge.lmp.reader.evaluation import UNITS, ReadScript, read_script
from dem_bridge.lmp.reader.fixes import Forces
from dem_bridge.lmp.reader.formula import plain
from dem_bridge.lmp.reader.moved import piston_of
from dem_bridge.lmp.reader.script import Opened
from dem_bridge.scene.scene import BY_RESTITUTION, Adhesion, Damping, Scene, Wall

#: round-off of the few operations between K and beta, and between density and mass
ROUND_OFF = 3.0 * 2.0**-52
#: largest relative difference between the initial overlaps and those of static equilibrium under the load
EQUILIBRIUM_WITHIN = 1e-6
#: commands without which the places of the atoms are not known
_OF_ATOMS = {
    "region",
    "create_box",
    "create_atoms",
    "read_data",
    "read_restart",
    "lattice",
    "variable",
    "set",
    "velocity",
}


@dataclass(frozen=True, kw_only=True)
class ReadDeck:
    """A scene that was read from a deck."""

    scene: Scene
    notes: tuple[str, ...]
    """Sentences about what was recognised and assumed."""
    line: Line
    """The particles of the script in the order of the scene."""
    time_steps: tuple[float, ...] = ()
    """Distinct time steps of the script's runs, s."""
    mixed: tuple[str, ...] = ()
    """``pair_coeff`` commands of the pairs of types that the script leaves to mixing and that may touch."""


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
    BlockedScript
        If commands are invalid or unsupported.
    """
    script = read_script(text, file=file, opened=opened, variables=variables)
    blockers = list(script.script.blockers.values())
    if script.last is None:  # not an input script
        empty = SceneError("", problem="has no command", allowed="a LAMMPS input script", where=file)
        raise BlockedScript([*blockers, empty][:1])
    if not blockers:
        try:
            return _read_scene(script, file, name, description, duration, samples, reverse)
        except SceneError as error:
            blockers.append(error)
    elif script.run is not None and script.particles.atoms and not script.script.refused & _OF_ATOMS:
        try:
            axis_of(script.run, list(script.particles.atoms.values()), Forces())
        except SceneError as error:
            blockers.append(error)
    if script.fixes.liggghts:
        blockers.insert(0, SceneError("", problem="this is a LIGGGHTS script", allowed=pair_laws.ABOUT, where=file))
    raise BlockedScript(blockers)


def _read_scene(
    script: ReadScript,
    file: str,
    name: str | None,
    description: str | None,
    duration: float | None,
    samples: int | None,
    reverse: bool | None,
) -> ReadDeck:
    """Return the scene of an evaluated script; the other parameters are those of :func:`read_deck`."""
    assert script.last is not None  # checked before
    if script.pairs.command is None and len(script.particles.atoms) > 1:
        raise script.last.error("is the last command, but pair_style is missing before it", "a script with pair_style")
    if not script.particles.atoms:
        raise script.last.error("is the last command, but there is no atom", "read_data or create_atoms single")
    if script.run is None and duration is None:
        raise script.last.error("is the last command, but there is no run", "run N, or the setting duration")
    length, time, mass = UNITS[script.units]
    if duration is None:
        duration = plain(script.duration * time, 2.0 * math.ulp(script.duration * time))
    else:
        script.duration = duration / time
    line = line_of(script, reverse)
    style = f", pair_style {script.pairs.style}" if script.pairs.style else ""
    step = "" if script.step is None else f"; its time step is {script.step:g}"
    atoms = len(script.particles.atoms)
    notes = [line.description, f"units {script.units}{style}, {atoms} atom{'s' * (atoms != 1)}{step}"]
    if script.units == "lj":
        notes.append("units lj have no dimensions; lengths, times and masses are taken as m, s and kg")
    notes += script.notes
    notes += [
        f"the wall of fix {plane.command.rest[0]} has E and nu of its command, which LAMMPS does not mix with"
        " those of bodies"
        for plane in line.planes
        if plane is not None and plane.law is not None and plane.law.material is not None
    ]
    count, remark = (samples, "") if samples is not None else _samples(script)
    notes += [remark] if remark else []
    if description is None:
        printable = "".join(sign for sign in re.split(r"[/\\]", file)[-1] if sign.isprintable())
        description = f"from {printable}: {line.description}"
    settings = {"name": name or scene_name(file), "description": description, "duration": duration, "samples": count}
    scene = _scene(line, settings, (length, time, mass), notes)
    # a script without a run may have a step, too
    last = [] if script.step is None else [script.step]
    steps = tuple(step * time for step in script.time_steps or last)
    return ReadDeck(scene=scene, notes=tuple(notes), line=line, time_steps=steps, mixed=_mixed(line, scene))


def _mixed(line: Line, scene: Scene) -> tuple[str, ...]:
    """Return the commands of the mixed laws of a line, without those of bodies that the energy keeps apart."""
    length, _, mass = UNITS[line.script.units]
    reach = math.inf
    if not (scene.gravity or scene.precompression or scene.adhesive):
        c, speeds = scene.contacts, np.array(scene.velocity)
        stored = float(np.sum(c.energy(np.maximum(-c.gap, 0.0), np.arange(scene.n_contact))))
        # times the square root of the mass
        reach = math.sqrt(2.0 * stored + float(np.array(scene.mass) @ speeds**2)) * scene.duration
    commands = [
        contact.law.mixed_as
        for contact in line.contacts
        if contact.law.mixed_as
        and contact.gap * length <= sum(reach / math.sqrt(body.mass * mass) for body in contact.bodies)
    ]
    return tuple(dict.fromkeys(commands))


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


def _samples(script: ReadScript) -> tuple[int, str]:
    """Return the number of samples, and a note if it is the default.

    It is that of the script's first dump; decks of dem_bridge state it by ``per_sample``.
    """
    words = script.script.variables.get("per_sample", ("", ()))[1]
    every = whole_number(words[0]) if words else None
    every = script.dump_every if every is None else every
    if every and script.steps and script.steps % every == 0:
        return script.steps // every, ""
    default = Scene.samples
    why = "no dump at equal intervals of steps" if not every else f"{script.steps} steps, and dumps every {every}"
    return default, f"{default} samples, the default: the script has {why}"


def _scene(line: Line, settings: dict[str, Any], units: tuple[float, float, float], notes: list[str]) -> Scene:
    """Return the Scene of a line."""
    length, time, mass = units
    force = mass * length / time**2
    contacts = line.contacts
    gaps = [plain(contact.gap * length, line.grain * length) for contact in contacts]
    exponent = [contact.law.exponent for contact in contacts]
    raw = [contact.stiffness * force / length ** (n - 1.0) for contact, n in zip(contacts, exponent, strict=True)]
    for contact, value in zip(contacts, raw, strict=True):
        if not value > 0.0:
            problem = f"leaves {contact.names}, which are neighbours, without a force"
            raise contact.law.command.error(problem, "a stiffness > 0, or another pair_coeff for these types")
    stiffness = [plain(value, ROUND_OFF * value) for value in raw]
    inner = slice(int(line.left), len(contacts) - int(line.right))
    ends = {"wall_left": 0} if line.left else {}
    ends |= {"wall_right": len(contacts) - 1} if line.right else {}
    order = line.order
    parts: dict[str, Any] = settings | {
        "mass": [(b.mass if b.weighed else plain(b.mass, ROUND_OFF * b.mass)) * mass for b in line.bodies],
        "velocity": [line.sign * body.velocity[line.axis] * length / time + 0.0 for body in line.bodies],
        "stiffness": stiffness[inner],
        "exponent": exponent[inner] or 2.5,
        "gap": gaps[inner],
        "gravity": _common(line, "gravity", length / time**2),
        "drag": _common(line, "langevin" if "langevin" in line.forces.commands else "viscous", 1.0 / time),
        "damping": _damping(line, order, time, force / length * time),
        "adhesion": _adhesion(line, order, force),
        **{side: Wall(stiffness=stiffness[k], gap=gaps[k], exponent=exponent[k]) for side, k in ends.items()},
    }
    if line.piston is not None:
        parts["velocity"][0] = 0.0
        parts["drive"], note = piston_of(line.script, line.piston, line.axis, line.sign)
        notes += [note] if note else []
    loads = [line.along(line.forces.load, body) * force for body in line.bodies]
    if line.piston is not None:
        # no force moves it; a static one is that of the other end
        loads[0] = 0.0 if line.right else -loads[-1]
    if not any(loads):
        try:
            return Scene(**parts)
        except SceneError as error:
            at = line.script.run or line.contacts[0].law.command
            raise error.at(f"{at.file}, line {at.line}", error.key) from None
    return _pressed(line, parts, loads, [gaps[k] for k in order], length, notes)


def _common(line: Line, style: str, unit: float) -> float:
    """Return the gravity or drag that acts on all bodies, or raise SceneError if it differs between them."""
    forces = line.forces
    if style == "gravity":
        values = [line.along(forces.gravity, body) for body in line.driven]
    else:
        values = [forces.drag.get(body.number, 0.0) for body in line.driven]
    odd = next((k for k, value in enumerate(values) if value != values[0]), None)
    if odd is not None:
        a, b = line.driven[0], line.driven[odd]
        problem = f"gives atom {a.number} {values[0]:g} and atom {b.number} {values[odd]:g}"
        raise forces.commands[style].error(problem, "the same value for all moving atoms")
    value = values[0] * unit
    return plain(value, ROUND_OFF * abs(value))


def _damping(line: Line, order: list[int], time: float, dashpot: float) -> Damping | None:
    """Return the damping of the scene's contacts, which are those along the line in this ``order``.

    ``time`` and ``dashpot`` are the SI values of the units of the two coefficients.
    """
    contacts = [line.contacts[k] for k in order]
    damped = [contact.law for contact in contacts if contact.law.damped]
    if not damped:
        return None
    for law in damped:
        if law.clip != damped[0].clip:
            raise law.command.error("has another limit_damping than other contacts", "limit_damping in all, or in none")
    models, clip = {law.damping for law in damped}, damped[0].clip
    ratios = [contact.engine_mass / contact.mass for contact in contacts if contact.law.damped]
    light_wall = any(abs(ratio - 1.0) > ROUND_OFF for ratio in ratios)
    name = next((name for name, model in DAMPINGS.items() if models == {model} and model in BY_EFFECTIVE_MASS), "")
    if name in BY_RESTITUTION and light_wall:
        problem = "gives contacts with a wall a damping that depends on the mass of the wall's atom"
        raise damped[0].command.error(problem, "fix freeze for this atom")
    if name == "tsuji" and len(damped) < len(contacts):
        raise damped[0].command.error("damps some contacts only, and tsuji damps for each e", "tsuji in all contacts")
    if name in BY_RESTITUTION or (name and not light_wall):
        if name in BY_RESTITUTION:
            values = [contact.law.eta if contact.law.damped else 1.0 for contact in contacts]
        else:
            rates = [contact.law.eta / time if contact.law.damped else 0.0 for contact in contacts]
            values = [plain(rate, ROUND_OFF * rate) for rate in rates]
        return Damping(law=name, coefficient=tuple(values), clip=clip)
    viscous, coefficients = "viscoelastic" in models, []
    for contact in contacts:
        law = contact.law
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
        value = law.eta * (1.0 if law.damping == "velocity" else contact.engine_mass)
        if viscous:
            value *= (math.sqrt(contact.radius) if hertz else 1.0) / contact.stiffness * time
        else:
            value *= dashpot
        coefficients.append(plain(value, 2.0 * ROUND_OFF * value))
    return Damping(law="kuwabara-kono" if viscous else "dashpot", coefficient=tuple(coefficients), clip=clip)


def _adhesion(line: Line, order: list[int], newton: float) -> Adhesion | None:
    """Return the adhesion of the contacts, whose unit of force is ``newton`` in SI."""
    contacts = [line.contacts[k] for k in order]
    values = [4.0 * math.pi * contact.law.surface_energy * contact.radius * newton for contact in contacts]
    return Adhesion(law="dmt", pull_off=tuple(plain(f, ROUND_OFF * f) for f in values)) if any(values) else None


def _pressed(
    line: Line, parts: dict[str, Any], loads: list[float], gaps: list[float], length: float, notes: list[str]
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
