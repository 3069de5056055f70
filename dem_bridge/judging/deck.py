"""Somebody's LAMMPS deck, read as far as it can be read, and run as it is with a dump of ours.

A copy of the deck and of the files that it names runs in a temporary folder. Nothing in it is changed; before its first
run stands one more line, a dump of positions and velocities with all digits.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import BlockedScript, RunBroken, SceneError, UsageError
from dem_bridge.foundation.files import text_of_file
from dem_bridge.foundation.script_files import files_of
from dem_bridge.judging.check.edits import Edit, applied
from dem_bridge.judging.stated import differences, of_any_contact
from dem_bridge.judging.table_law import TableLaw, in_place_of_table, laws_of_tables
from dem_bridge.lmp.binary_dump import read_binary_dump
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.process import run_deck, workspace
from dem_bridge.lmp.reader.evaluation import UNITS, ReadScript, read_script
from dem_bridge.lmp.reader.script import Command, Opened, Script, given_variables
from dem_bridge.lmp.reader.to_scene import ReadDeck, read_deck
from dem_bridge.scene.scene import Scene

#: the added dump, and its file
_DUMP, _FILE = "dem_bridge", "dem_bridge.dump"
#: the added dump of the frames in which forces act, and its file
_ACTIVE, _ACTIVE_FILE = "dem_bridge_active", "dem_bridge_active.bin"


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
    order: tuple[int, ...] = ()
    """Places of the bodies along the chain in frames that are sorted by the ids of atoms; empty without a scene."""
    axis: int = 0
    """Axis of the chain: 0, 1 or 2."""

    def active(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the steps of the frames in which forces act, and velocities by atom ids, ``(n_frame, n_atom, 3)``.

        There are none if the dump was not asked for.
        """
        path = self.out.with_name(_ACTIVE_FILE)
        if not path.is_file() or path.stat().st_size == 0:
            return np.zeros(0, dtype=np.int64), np.zeros((0, 0, 3))
        steps, values = read_binary_dump(path, 4)
        return steps, values[:, :, 1:]


@dataclass(frozen=True, kw_only=True)
class UserDeck:
    """Somebody's deck, read as far as it can be read."""

    path: Path
    commands: tuple[Command, ...]
    state: ReadScript
    read: ReadDeck | None
    """The scene of the deck; None if it cannot be read as one."""
    mirrored: bool
    """True if body 0 of the scene is at the upper end of the deck's axis."""
    problems: tuple[str, ...]
    """Commands that cannot be read as part of a scene."""
    overlooked: tuple[str, ...] = ()
    """Commands of neighbour lists that may miss contacts, without which the scene was read."""
    tables: tuple[TableLaw, ...] = ()
    """Force tables, in place of which the scene has the laws that they mean."""
    unread_table: str = ""
    """Why a force table is not compared with a law; '' where it is, or where there is none."""
    files: frozenset[str] = frozenset()
    """Names of other files that were read, or whose reading was tried: included ones, data, lists of values."""

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

    def stated(self, scene: Scene) -> dict[str, Any]:
        """Return the fields of its scene that differ from those of ``scene``; none if it cannot be read."""
        if self.read is None:
            return {}
        return {name: of_any_contact(self.read.scene, name) for name in differences(scene, self.read.scene)}

    def last(self, name: str) -> Command | None:
        """Return the last command of a name."""
        return next((command for command in reversed(self.commands) if command.name == name), None)


def user_deck(
    path: Path,
    scene: Scene | None = None,
    variables: Mapping[str, str] | None = None,
    changed: Mapping[str, str] = MappingProxyType({}),
) -> UserDeck:
    """Read a deck, as far as it can be read; body 0 is at the end where the deck is most like the scene.

    ``scene``: None: body 0 is at the moving end. ``variables``: values that LAMMPS is given by ``-var``. ``changed``:
    texts in place of those of files, by name.
    """
    try:
        text = changed[path.name] if path.name in changed else text_of_file(path)
    except OSError as error:
        raise UsageError(f"{path}: the deck cannot be read ({error.strerror}); give a LAMMPS input script") from None

    on_disk, files = files_of(path.parent), set[str]()

    def opened(name: str) -> str:
        files.add(name)
        return changed[name] if name in changed else on_disk(name)

    state = read_script(text, file=path.name, opened=opened, variables=variables)
    commands: list[Command] = []
    script = Script(opened, given_variables(variables), dict(state.script.keywords))
    try:
        for command in script.commands(path.name, text):
            commands.append(command)
    except BlockedScript:
        pass  # the loop does not end: LAMMPS will say so
    lists = (words for style, words in script.variables.values() if style in ("file", "atomfile"))
    files.update(word for words in lists for word in words)
    read, mirrored, problems = _scene_of(text, path.name, opened, scene, variables)
    overlooked: tuple[str, ...] = ()
    if problems and all("`neigh_modify " in problem for problem in problems):
        # LAMMPS may miss contacts: its run shows whether it does
        without = re.sub(r"^[ \t]*neigh_modify\b.*(&[ \t]*\n.*)*$", "", text, flags=re.MULTILINE)
        read, mirrored, others = _scene_of(without, path.name, opened, scene, variables)
        problems, overlooked = (others, ()) if others else ((), problems)
    tables: tuple[TableLaw, ...] = ()
    unread_table = ""
    if problems and all("`pair_style table " in problem for problem in problems):
        try:
            laws = laws_of_tables(commands, state, lambda name: changed.get(name) or _text_beside(path, name))
            texts = {name: opened(name) for name in {command.file for command in commands} - {path.name}}
            lawful = _with_laws({path.name: text, **texts}, commands, laws, state)
            read, mirrored, others = _scene_of(
                lawful[path.name], path.name, lambda name: lawful.get(name) or opened(name), scene, variables
            )
            problems, tables = (others, ()) if others else ((), tuple(laws.values()))
        except (UsageError, OSError, ValueError) as error:
            unread_table = str(error)
    return UserDeck(
        path=path,
        tables=tables,
        unread_table=unread_table,
        commands=tuple(commands),
        state=state,
        read=read,
        mirrored=mirrored,
        problems=problems,
        overlooked=overlooked,
        files=frozenset(files),
    )


def _text_beside(script: Path, name: str) -> str:
    """Return the text of a file in the folder of a script, or below it."""
    file = Path(name)
    if file.is_absolute() or ".." in file.parts:
        raise UsageError(f"{name} is not in the folder of the script")
    return text_of_file(script.parent / file)


def _with_laws(
    texts: Mapping[str, str], commands: Sequence[Command], laws: Mapping[Command, TableLaw], state: ReadScript
) -> dict[str, str]:
    """Return the texts of a script with the laws of its tables in place of the tables, by name."""
    style = next(command for command in reversed(commands) if command.name == "pair_style")
    edits = [
        Edit(file=command.file, line=command.line, new=in_place_of_table(command, laws.get(command), state))
        for command in (style, *laws)
    ]
    return {**texts, **applied(texts, edits)}


def _scene_of(
    text: str, file: str, opened: Opened, scene: Scene | None, variables: Mapping[str, str] | None
) -> tuple[ReadDeck | None, bool, tuple[str, ...]]:
    """Return the scene of a deck, whether body 0 is at the upper end, and the problems of a deck without a scene."""
    try:
        both = [
            read_deck(text, file=file, opened=opened, reverse=reverse, variables=variables) for reverse in (False, True)
        ]
        alike = scene or read_deck(text, file=file, opened=opened, variables=variables).scene
        mirrored = len(differences(alike, both[1].scene)) < len(differences(alike, both[0].scene))
        return both[int(mirrored)], both[int(mirrored)].line.sign < 0.0, ()
    except BlockedScript as error:
        return None, False, tuple(str(blocker) for blocker in error.blockers)
    except SceneError as error:
        return None, False, (str(error),)


@contextmanager
def deck_run(
    path: Path,
    scene: Scene | None,
    *,
    engine: Engine | None = None,
    variables: Mapping[str, str] | None = None,
    time_limit: float,
    changed: Mapping[str, str] = MappingProxyType({}),
    every: int | None = None,
    active_every: int | None = None,
) -> Iterator[DeckRun]:
    """Run a copy of a deck with a dump of ours; its files are removed after the context.

    ``changed``: texts in place of those of files of the deck, by name. ``every``: steps between two frames of the dump;
    None: those of a sample of the scene. ``active_every``: those between two frames of one more dump, which has only
    frames in which the forces on atoms differ; None: no such dump.

    Raises
    ------
    UsageError
        If the deck has no run.
    BackendUnavailable
        If there is no LAMMPS or it lacks a style.
    RunBroken
        If LAMMPS stops with an error.
    """
    engine = (engine or Engine.chosen()).with_variables(variables or {})
    deck = user_deck(path, scene, variables, changed)
    run = next((command for command in deck.commands if command.name == "run"), None)
    if run is None:
        cause = next((text for text in deck.problems if "variable" in text), "")
        raise UsageError(cause or f"{path}: the deck has no run command that can be read; give a deck that runs")
    with workspace() as folder:
        for name in named_paths(deck):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            if (path.parent / name).is_file():
                shutil.copyfile(path.parent / name, folder / name)
        for name, text in changed.items():
            (folder / name).write_text(text, encoding="utf-8")
        target = folder / run.file
        lines = target.read_text(encoding="utf-8-sig").splitlines(keepends=True)
        lines.insert(run.line - 1, _dump_line(every or _every(deck, scene), active_every))
        target.write_text("".join(lines), encoding="utf-8")
        report = run_deck(folder, path.name, time_limit=time_limit, engine=engine)
        log = folder / "log.lammps"
        text = log.read_text(errors="replace") if log.is_file() else ""
        loops = [int(steps) for steps in re.findall(r"^Loop time of .* for (\d+) steps", text, re.MULTILINE)]
        if not (folder / _FILE).is_file() or (loops and not any(loops)):
            raise RunBroken(f"{path}: LAMMPS ended without an error, but it ran no step; give a deck that runs")
        order, axis = _put_in_order(folder / _FILE, mirrored=deck.mirrored) if deck.read is not None else ((), 0)
        if deck.state.units == "lj":  # taken as m, s and kg, as the reader of decks does
            dump = (folder / _FILE).read_text()
            (folder / _FILE).write_text(dump.replace("ITEM: UNITS\nlj\n", "ITEM: UNITS\nsi\n"))
        builds = re.findall(r"^Dangerous builds\s*=\s*(\d+)", text, re.MULTILINE)
        yield DeckRun(
            out=folder / _FILE,
            dt=deck.dt,
            wall=report.wall,
            cpu=report.cpu,
            deck=deck,
            version=report.version,
            dangerous=sum(map(int, builds)),
            order=order,
            axis=axis,
        )


def named_paths(deck: UserDeck) -> set[str]:
    """Return the deck, and what it reads or names in its folder or in a subfolder of it, relative to the folder."""
    words = deck.files | {word for command in deck.commands for word in (command.file, *command.rest)}
    names = {deck.path.name}
    for word in words:
        path = Path(word)
        inside = len(word) < 200 and not path.is_absolute() and ".." not in path.parts
        target = deck.path.parent / path
        if inside and (target.is_file() or (len(path.parts) > 1 and target.parent.is_dir())):
            names.add(word)
    return names


def _every(deck: UserDeck, scene: Scene | None) -> int:
    """Return the steps between two frames of the added dump: those of a sample of the scene, if the step is known."""
    if scene is None:
        return max(1, deck.state.steps // Scene.samples)
    if deck.dt is not None:
        return max(1, round(scene.duration / scene.samples / deck.dt))
    return max(1, deck.state.steps // scene.samples)


def _dump_line(every: int, active_every: int | None = None) -> str:
    """Return the line that defines the added dumps, once also in a loop."""
    lines = [
        f"dump {_DUMP} all custom {every} {_FILE} id type x y z vx vy vz",
        f"dump_modify {_DUMP} sort id units yes time yes format float %.17g",
    ]
    if active_every is not None:
        apart = "+".join(f"c_{_ACTIVE}_most[{k}]-c_{_ACTIVE}_least[{k}]" for k in (1, 2, 3))
        lines += [
            f"compute {_ACTIVE}_most all reduce max fx fy fz",
            f"compute {_ACTIVE}_least all reduce min fx fy fz",
            f"variable {_ACTIVE}_none equal '{apart} == 0.0'",
            f"dump {_ACTIVE} all custom {active_every} {_ACTIVE_FILE} id vx vy vz",
            f"dump_modify {_ACTIVE} sort id skip v_{_ACTIVE}_none",
        ]
    commands = " ".join(f'"{line}"' for line in lines)
    return f'if "$(is_defined(dump,{_DUMP})) == 0" then {commands}\n'


def _put_in_order(dump: Path, *, mirrored: bool) -> tuple[tuple[int, ...], int]:
    """Sort the atoms of the added dump along the chain, and change all signs if body 0 is at the upper end.

    The result is the order, as places in frames that are sorted by the ids of atoms, and the axis of the chain.
    """
    head, *frames = re.split(r"(?<=\n)(ITEM: ATOMS[^\n]*\n)", dump.read_text())
    ranks: dict[str, int] = {}
    sorting, axis = np.zeros(0, dtype=np.int64), 0
    parts = [head]
    for heading, text in zip(frames[::2], frames[1::2], strict=True):
        numbers, kept, rest = [], [], ""
        for line in text.splitlines(keepends=True):
            if rest or line.startswith("ITEM:"):
                rest += line
            else:
                numbers.append(line.split())
        if not ranks:
            places = np.array([row[2:5] for row in numbers], dtype=float)
            axis = int(np.argmax(np.ptp(places, axis=0)))
            order = np.argsort(-places[:, axis] if mirrored else places[:, axis], kind="stable")
            sorting = np.argsort(np.argsort([int(row[0]) for row in numbers]))[order]
            ranks = {numbers[place][0]: rank for rank, place in enumerate(order, start=1)}
        for number, kind, *values in sorted(numbers, key=lambda row: ranks[row[0]]):
            signed = [(word[1:] if word.startswith("-") else f"-{word}") for word in values] if mirrored else values
            kept.append(" ".join((str(ranks[number]), kind, *signed)))
        parts.append(heading + "\n".join(kept) + "\n" + rest)
    dump.write_text("".join(parts))
    return tuple(sorting.tolist()), axis
