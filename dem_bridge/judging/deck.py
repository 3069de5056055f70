"""Somebody's LAMMPS deck, run as it is with a dump of ours, and what in the deck limits its accuracy.

A copy of the deck and of the files that it names runs in a temporary folder. Nothing in it is changed; before its first
run stands one more line, a dump of positions and velocities with all digits.
"""

from __future__ import annotations

import math
import re
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.errors import BlockedScript, DemBridgeError, SceneError, UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.known_defects import defects_of
from dem_bridge.lmp.process import run_deck, workspace
from dem_bridge.lmp.reader.deck import UNITS, ReadScript, read_script
from dem_bridge.lmp.reader.scene import ReadDeck, read_deck
from dem_bridge.lmp.reader.script import Command, Script
from dem_bridge.runs.case import Case
from dem_bridge.scene import Scene
from dem_bridge.trajectory import Floats

#: the added dump, and its file
_DUMP, _FILE = "dem_bridge", "dem_bridge.dump"
#: commands of which one begins a line of every LAMMPS deck
_DECK = re.compile(r"^[ \t]*(units|atom_style|pair_style|read_data|create_box|include)[ \t]+\S", re.MULTILINE)
#: significant digits of LAMMPS' text dumps without a format, and of %f behind the point
_DIGITS, _FIXED = 6, 6
#: fields of a scene that are compared with those of the deck, with the relative difference that counts as round-off
_FIELDS = ("mass", "stiffness", "exponent", "gap", "velocity", "wall_left", "wall_right", "gravity", "precompression",
           "damping", "adhesion", "drag", "drive")  # fmt: skip
_SAME = 1e-12


@dataclass(frozen=True, kw_only=True)
class Limit:
    """One property of a deck that limits its accuracy, or that is suspected and does not."""

    what: str
    found: str
    """What the deck has."""
    effect: float
    """Largest effect on velocities, relative to the largest; 0: none; nan: not known."""
    advice: str


@dataclass(frozen=True, kw_only=True)
class DeckRun:
    """A run of somebody's deck."""

    out: Path
    """Dump of the run."""
    dt: float | None
    """Time step, s; None if the deck has several or none that can be read."""
    wall: float
    cpu: float
    deck: UserDeck
    version: int
    dangerous: int
    """Dangerous builds of the neighbour list."""


@dataclass(frozen=True, kw_only=True)
class UserDeck:
    """Somebody's deck, read as far as it can be read."""

    path: Path
    commands: tuple[Command, ...]
    state: ReadScript
    read: ReadDeck | None
    """The scene of the deck; None if it cannot be read as one."""
    problems: tuple[str, ...]
    """Commands that cannot be read as part of a scene."""

    @property
    def dt(self) -> float | None:
        """Time step, s; None unless there is one."""
        unit = UNITS.get(self.state.units, (1.0, 1.0, 1.0))[1]
        steps = self.state.time_steps or ([] if self.state.step is None else [self.state.step])
        return steps[0] * unit if len(steps) == 1 else None

    @property
    def radius(self) -> float | None:
        """Largest particle radius, m; None if it cannot be read."""
        unit = UNITS.get(self.state.units, (1.0, 1.0, 1.0))[0]
        radii = [atom.radius for atom in self.state.particles.atoms.values()]
        return max(radii) * unit if radii else None

    def last(self, name: str) -> Command | None:
        """Return the last command of a name."""
        return next((command for command in reversed(self.commands) if command.name == name), None)


def is_deck(path: Path) -> bool:
    """Return True if a file is a LAMMPS input script, by its content."""
    try:
        with path.open("rb") as file:
            head = file.read(100_000)
    except OSError:
        return False
    return b"\0" not in head and b"ITEM:" not in head and _DECK.search(head.decode(errors="replace")) is not None


def user_deck(path: Path) -> UserDeck:
    """Read a deck, as far as it can be read."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        raise UsageError(f"{path}: the deck cannot be read ({error}); give a LAMMPS input script") from None

    def opened(name: str) -> str:
        return (path.parent / name).read_text(encoding="utf-8")

    commands: list[Command] = []
    try:
        for command in Script(opened).commands(path.name, text):
            commands.append(command)
    except BlockedScript:
        pass  # the loop does not end: LAMMPS will say so
    state = read_script(text, file=path.name, opened=opened)
    read: ReadDeck | None = None
    problems: tuple[str, ...] = ()
    try:
        read = read_deck(text, file=path.name, opened=opened)
    except BlockedScript as error:
        problems = tuple(str(blocker) for blocker in error.blockers)
    except SceneError as error:
        problems = (str(error),)
    return UserDeck(path=path, commands=tuple(commands), state=state, read=read, problems=problems)


@contextmanager
def deck_run(path: Path, scene: Scene, *, engine: Engine | None = None, time_limit: float) -> Iterator[DeckRun]:
    """Run a copy of a deck with a dump of ours; its files are removed after the context.

    Raises
    ------
    UsageError
        If the deck has no run.
    BackendUnavailable
        If there is no LAMMPS or it lacks a style.
    RunBroken
        If LAMMPS stops with an error.
    """
    deck = user_deck(path)
    run = next((command for command in deck.commands if command.name == "run"), None)
    if run is None:
        raise UsageError(f"{path}: the deck has no run command that can be read; give a deck that runs")
    with workspace() as folder:
        for name in _named_files(deck):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path.parent / name, folder / name)
        target = folder / run.file
        lines = target.read_text(encoding="utf-8-sig").splitlines(keepends=True)
        lines.insert(run.line - 1, _dump_line(_every(deck, scene)))
        target.write_text("".join(lines), encoding="utf-8")
        report = run_deck(folder, path.name, time_limit=time_limit, engine=engine or Engine.chosen())
        log = folder / "log.lammps"
        builds = re.findall(r"^Dangerous builds\s*=\s*(\d+)", log.read_text(errors="replace"), re.MULTILINE)
        yield DeckRun(
            out=folder / _FILE,
            dt=deck.dt,
            wall=report.wall,
            cpu=report.cpu,
            deck=deck,
            version=report.version,
            dangerous=sum(map(int, builds)),
        )


def _named_files(deck: UserDeck) -> set[str]:
    """Return the deck and all files in its folder that its commands name, relative to the folder."""
    names = {deck.path.name}
    for word in {word for command in deck.commands for word in command.rest} | {
        command.file for command in deck.commands
    }:
        path = Path(word)
        if (
            not path.is_absolute()
            and ".." not in path.parts
            and len(word) < 200
            and (deck.path.parent / path).is_file()
        ):
            names.add(word)
    return names


def _every(deck: UserDeck, scene: Scene) -> int:
    """Return the steps between two frames of the added dump: those of a sample of the scene, if the step is known."""
    if deck.dt is not None:
        return max(1, round(scene.duration / scene.samples / deck.dt))
    return max(1, deck.state.steps // scene.samples)


def _dump_line(every: int) -> str:
    """Return the line that defines the added dump, once also in a loop."""
    dump = f"dump {_DUMP} all custom {every} {_FILE} id type x y z vx vy vz"
    settings = f"dump_modify {_DUMP} sort id units yes time yes format float %.17g"
    return f'if "$(is_defined(dump,{_DUMP})) == 0" then "{dump}" "{settings}"\n'


def deck_limits(scene: Scene, run: DeckRun, error: float, *, largest: float) -> tuple[Limit, ...]:
    """Return what limits the accuracy of a deck, the largest effect first.

    Parameters
    ----------
    scene : Scene
        The scene that the deck should be of.
    run : DeckRun
        Its run.
    error : float
        Largest velocity error of the run, relative to ``largest``.
    largest : float
        Largest velocity of the reference, m/s.
    """
    limits = [
        *_of_numerics(scene, run, error),
        *_of_contacts(run),
        *_of_scene(scene, run),
        *_of_neighbours(run, largest),
        *_of_own_dump(run.deck),
    ]
    return tuple(sorted(limits, key=lambda limit: -1.0 if math.isnan(limit.effect) else -limit.effect))


def _of_numerics(scene: Scene, run: DeckRun, error: float) -> Iterator[Limit]:
    """Yield the effects of the time step and of the radius, by twins of the scene, and what neither explains."""
    dt, radius = run.dt, run.deck.radius
    if dt is None:
        yield Limit(
            what="time step",
            found="several, or none that can be read",
            effect=math.nan,
            advice="use one `timestep` for all runs",
        )
        return
    try:
        reference, exact = _velocity(scene, "reference"), _velocity(scene, "verlet", dt)
        speed = float(np.max(np.abs(reference)))
        step = float(np.max(np.abs(exact - reference))) / speed
        yield Limit(
            what="time step",
            found=f"{dt:.6g} s",
            effect=step,
            advice="halve the time step: this error falls by 4 (by 2 with damping)",
        )
        roundoff = 0.0
        if radius is not None:
            roundoff = float(np.max(np.abs(_velocity(scene, "verlet", dt, radius) - exact))) / speed
            yield Limit(
                what="particle radius",
                found=f"{radius:.6g} m",
                effect=roundoff,
                advice="take a smaller radius with the same stiffness: positions then round off less"
                " (dem-bridge deck writes such a deck)",
            )
        yield Limit(
            what="neither time step nor radius",
            found="the difference that is left",
            effect=max(0.0, error - step - roundoff),
            advice="compare contact law, damping, tables and start with the scene: see the other rows and the cause",
        )
    except DemBridgeError as problem:
        yield Limit(what="time step and radius", found=str(problem), effect=math.nan, advice="judge two time steps")


def _velocity(scene: Scene, backend: str, dt: float | None = None, radius: float | None = None) -> Floats:
    """Return the velocities of a scene by one of our codes."""
    resolution = Resolution(dt=dt, surrogate_radius=radius)
    sampling = Sampling(count=scene.samples)
    case = Case(scene=scene, backend=backend, resolution=resolution, sampling=sampling, uncertainty=False)
    return case.solve().velocity


def _of_contacts(run: DeckRun) -> Iterator[Limit]:
    """Yield tables, `newton` and defects of the release that the deck meets."""
    for command in run.deck.commands:
        words = command.rest
        if command.name == "pair_style" and "table" in words[:-2]:
            place = words.index("table")
            yield Limit(
                what="table points",
                found=f"{words[place + 2]} points, {words[place + 1]}",
                effect=math.nan,
                advice="double the points and the lines of the file: if the result changes, the table limits it;"
                " pair_style granular needs none",
            )
    if (newton := run.deck.last("newton")) is not None:
        yield Limit(
            what="newton", found=" ".join(newton.rest), effect=0.0, advice="nothing: on and off give the same bits"
        )
    text = "\n".join(command.text for command in run.deck.commands)
    for defect in defects_of(run.version, text):
        yield Limit(
            what=f"known defect {defect.name}", found=defect.symptom, effect=math.nan, advice=f"write {defect.instead}"
        )


def _of_scene(scene: Scene, run: DeckRun) -> Iterator[Limit]:
    """Yield the properties in which the deck differs from the scene, each with its effect by a twin."""
    deck = run.deck
    if deck.read is None:
        found = "; ".join(deck.problems[:3])
        yield Limit(
            what="comparison with the scene",
            found=f"the deck cannot be read as a scene: {found}",
            effect=math.nan,
            advice="compare the deck with the scene by hand",
        )
        return
    for name in _FIELDS:
        ours, theirs = getattr(scene, name), getattr(deck.read.scene, name)
        if difference := _difference(ours, theirs):
            yield Limit(
                what=name.replace("_", " "),
                found=difference,
                effect=_effect(scene, name, theirs, run.dt),
                advice="make the deck and the scene agree",
            )


def _effect(scene: Scene, name: str, value: Any, dt: float | None) -> float:
    """Return the effect of another value of one field on velocities, relative to the largest; nan if it is unknown."""
    if dt is None:
        return math.nan
    try:
        plain = _velocity(scene, "verlet", dt)
        changed = _velocity(replace(scene, **{name: value}), "verlet", dt)
        return float(np.max(np.abs(changed - plain)) / np.max(np.abs(plain)))
    except DemBridgeError:
        return math.nan


def _difference(ours: object, theirs: object) -> str:
    """Return how two values of a scene differ, in words; '' if they agree to round-off."""
    if isinstance(ours, tuple | float) and isinstance(theirs, tuple | float):
        first, second = np.atleast_1d(ours).astype(float), np.atleast_1d(theirs).astype(float)
        if len(first) != len(second):
            return f"{len(second)} numbers; the scene has {len(first)}"
        scale = max(float(np.max(np.abs(first), initial=0.0)), float(np.max(np.abs(second), initial=0.0)))
        gap = np.abs(first - second)
        if scale == 0.0 or float(np.max(gap)) <= _SAME * scale:
            return ""
        place = int(np.argmax(gap))
        where = f" at {place}" if len(first) > 1 else ""
        return f"{second[place]:.9g}{where}; the scene has {first[place]:.9g}"
    if ours == theirs:
        return ""
    return f"{_brief(theirs)}; the scene has {_brief(ours)}"


def _brief(value: object) -> str:
    """Return a part of a scene in a few words."""
    if value is None:
        return "none"
    fields = {key: item for key, item in vars(value).items() if item is not None} if hasattr(value, "__dict__") else {}
    words = ", ".join(f"{key} {item if not isinstance(item, tuple) else item[0]}" for key, item in fields.items())
    return words or str(value)


def _of_neighbours(run: DeckRun, largest: float) -> Iterator[Limit]:
    """Yield whether the neighbour list may miss contacts."""
    neighbor, modify = run.deck.last("neighbor"), run.deck.last("neigh_modify")
    settings: Mapping[str, str] = dict(zip(modify.rest[::2], modify.rest[1::2], strict=False)) if modify else {}
    found = f"{neighbor.text if neighbor else 'default skin'}, {modify.text if modify else 'default neigh_modify'}"
    found += f"; dangerous builds: {run.dangerous}"
    wait = max(
        (int(settings.get(key, "0")) for key in ("every", "delay") if settings.get(key, "0").isdigit()), default=0
    )
    length = UNITS.get(run.deck.state.units, (1.0,))[0]
    try:
        skin = float(neighbor.rest[0]) * length if neighbor else math.nan
    except ValueError:
        skin = math.nan
    travel = 2.0 * largest * (run.dt or 0.0) * wait
    risky = run.dangerous > 0 or settings.get("once") == "yes" or settings.get("exclude") is not None
    if risky or (not math.isnan(skin) and travel > skin):
        advice = "write `neigh_modify delay 0 every 1 check yes` and a skin of a radius: contacts may be missed"
        yield Limit(what="neighbour list", found=found, effect=math.nan, advice=advice)
    else:
        yield Limit(what="neighbour list", found=found, effect=0.0, advice="nothing: no contact is missed")


def _of_own_dump(deck: UserDeck) -> Iterator[Limit]:
    """Yield what the deck's own dump loses; the judgement is by the added dump."""
    dumps = [command for command in deck.commands if command.name == "dump"]
    if not dumps:
        yield Limit(
            what="own dump",
            found="none",
            effect=math.nan,
            advice="`dump 1 all custom N dump.chain id type x y z vx vy vz` and `dump_modify 1 sort id time yes"
            " format float %.17g`",
        )
    for dump in dumps:
        columns = dump.rest[5:]
        if len(dump.rest) > 3 and dump.rest[2] == "custom" and not {"vx", "vy", "vz"} & {*columns}:
            yield Limit(
                what=f"own dump {dump.rest[0]}",
                found="no velocities",
                effect=math.nan,
                advice="add vx vy vz: velocities are the sharpest observable",
            )
        formats = [
            " ".join(command.rest[1:])
            for command in deck.commands
            if command.name == "dump_modify" and command.rest[:1] == dump.rest[:1] and "format" in command.rest
        ]
        if dump.rest[4:5] and dump.rest[4].endswith(".bin"):
            continue
        digits = re.search(r"%[-+ 0#\d]*\.(\d+)([efg])", formats[-1]) if formats else None
        if digits is None or (digits[2] == "g" and int(digits[1]) < 15):
            count = int(digits[1]) if digits else _DIGITS
            yield Limit(
                what=f"own dump {dump.rest[0]}",
                found=f"{count} digits",
                effect=0.5 * 10.0 ** (1 - count),
                advice=f"`dump_modify {dump.rest[0]} format float %.17g`: positions lose more, by the size of the box"
                " over the displacements",
            )
