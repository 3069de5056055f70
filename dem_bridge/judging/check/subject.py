"""What is checked: an input script as it is, or the deck of a scene, and the same with a finer time step."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from dem_bridge.backends.base import Resolution, Sampling, unsupported_reason
from dem_bridge.backends.lammps import LammpsGranular
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.errors import SceneError, UnsupportedScene, UsageError
from dem_bridge.foundation.files import MOST_BYTES, text_of_file
from dem_bridge.foundation.script_files import is_deck, is_unit_test_file
from dem_bridge.judging.check.edits import Edit, applied, finer, keeps_duration, only_steps
from dem_bridge.judging.deck import UserDeck, named_paths, user_deck
from dem_bridge.lmp.process import workspace
from dem_bridge.lmp.reader.evaluation import UNITS
from dem_bridge.lmp.unit_test import UnitTest, read_unit_test
from dem_bridge.scene.file import scene_of
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.timescales import contact_time_of, samples_of

#: contact times that a front needs for one body, and those after the last one, where a script has no run
_CONTACT_TIMES_PER_BODY, _CONTACT_TIMES_AFTER = 1.0, 2.0
#: units of time of the unit styles whose times are not told in s
_TIME_UNITS = {"lj": "tau", "metal": "ps", "real": "fs", "electron": "fs"}
#: commands that read files
_COMMANDS_THAT_READ = ("read_data", "read_restart", "pair_coeff", "variable", "fix", "molecule", "region", "include")
#: steps of a contact time of the deck of a scene for which no step was given: the rule of thumb of DEM codes
STEPS_OF_CONTACT = 50.0


@dataclass(frozen=True, kw_only=True)
class Subject:
    """An input script with what was read of it."""

    name: str
    path: Path
    deck: UserDeck
    scene: Scene | None
    """The scene of the deck; None if it cannot be read as one."""
    changed: Mapping[str, str] = field(default_factory=dict)
    """Texts in place of those of files: those with an added run."""
    added: tuple[Edit, ...] = ()
    """Lines that the script lacks."""
    of_scene: str = ""
    """Name or path of the scene whose deck was written; '' for an input script."""
    assumed: str = ""
    """What the step of a scene's deck is, such as "1/50 of the shortest contact time"; '' if it was given."""
    variables: Mapping[str, str] = field(default_factory=dict)
    test: UnitTest | None = None
    """The unit test of LAMMPS whose commands the script has; None for another script."""

    @property
    def unit(self) -> float:
        """Unit of time of the script, s."""
        return UNITS.get(self.deck.state.units, (1.0, 1.0, 1.0))[1]

    @property
    def time_unit(self) -> str:
        """Unit in which times are told."""
        units = self.deck.last("units")
        return _TIME_UNITS.get(units.rest[0] if units is not None and units.rest else "lj", "s")

    def companions(self) -> dict[str, bytes]:
        """Return the files of its folder that the script consists of or reads, such as a data file, by name."""
        words = {word for command in self.deck.commands if command.name in _COMMANDS_THAT_READ for word in command.rest}
        names = sorted(named_paths(self.deck) & (words | self.deck.files | {*self.texts()}))
        paths = {name: self.path.parent / name for name in names}
        fit = (name for name, path in paths.items() if path.is_file() and path.stat().st_size <= MOST_BYTES)
        return {name: paths[name].read_bytes() for name in fit}

    def texts(self) -> dict[str, str]:
        """Return the texts of the script and of the files that it includes, by name."""
        files = dict.fromkeys((self.path.name, *(command.file for command in self.deck.commands)))
        return {file: self.changed.get(file) or text_of_file(self.path.parent / file) for file in files}

    def edits(self, factor: int) -> tuple[Edit, ...]:
        """Return the lines that divide the time steps by a whole number and keep the durations of runs.

        Raises
        ------
        UsageError
            If the lines of the steps cannot be changed so.
        """
        if factor == 1:
            return ()
        texts = self.texts()
        full = finer(texts, self.deck.commands, self.deck.state, factor)
        for edits in (full, only_steps(full)):
            changed = user_deck(self.path, self.scene, self.variables, {**self.changed, **applied(texts, edits)})
            if edits and keeps_duration(self.deck.state, changed.state, factor):
                return edits
        raise UsageError(f"{self.name}: its steps follow from other lines, which this program does not change")

    def edits_of_coarse(self, factor: int) -> tuple[Edit, ...]:
        """Return the lines that shorten only steps above the longest one divided by a number, if there are such.

        The durations of the runs are kept.
        """
        texts, state = self.texts(), self.deck.state
        try:
            edits = finer(texts, self.deck.commands, state, factor, coarse=True)
        except UsageError:
            return ()
        changed = user_deck(self.path, self.scene, self.variables, {**self.changed, **applied(texts, edits)}).state
        longest = max(state.time_steps) / factor * (1.0 + 1e-9)
        as_long = math.isclose(state.duration, changed.duration, rel_tol=1e-9)
        return edits if as_long and max(changed.time_steps) <= longest else ()

    def finer(self, factor: int) -> dict[str, str]:
        """Return the texts of all files that differ from those on the disk, with steps so many times shorter."""
        if self.of_scene and factor > 1:
            assert self.scene is not None  # it was given
            assert self.deck.dt is not None  # the deck is ours
            return dict(deck_files(self.scene, self.deck.dt / factor))
        return {**self.changed, **applied(self.texts(), self.edits(factor))}


@contextmanager
def subject_of(
    file: str | Path | Scene, *, dt: float | None = None, variables: Mapping[str, str] | None = None
) -> Iterator[Subject]:
    """Yield what is checked; the deck of a scene is in a temporary folder, which is removed after the context.

    Raises
    ------
    UsageError
        If a file is neither an input script nor a scene, or a time step is given for a script that has its own.
    UnsupportedScene
        If LAMMPS cannot do the scene.
    """
    path = None if isinstance(file, Scene) else Path(file)
    if path is not None and path.is_file() and path.suffix != ".toml":
        unit_test = is_unit_test_file(path)
        if not unit_test and not is_deck(path):
            problem = "the file is neither a LAMMPS input script nor a scene file (.toml) nor a unit test of LAMMPS"
            raise SceneError("", problem=problem, allowed="one of these, or the name of a scene", where=str(file))
        if dt is not None:
            raise UsageError(
                f"{file} is an input script, which has its own time step; leave out --dt {dt:g}, or write the step as a"
                f" variable and give it by --var, such as --var dt={dt:g}"
            )
        if unit_test:
            with workspace() as folder:
                yield _unit_test(path, folder, variables)
        else:
            yield _script(path, variables)
        return
    if variables:
        raise UsageError(f"variables were given, but {file} is a scene; they are those of an input script")
    scene = scene_of(file)
    with workspace() as folder:
        yield _deck_of(scene, scene.name if path is None else str(file), folder, dt)


def _unit_test(path: Path, folder: Path, variables: Mapping[str, str] | None) -> Subject:
    """Return the commands of a unit test as an input script, which is written into a folder."""
    test = read_unit_test(text_of_file(path), str(path))
    script = folder / f"in.{test.name}"
    script.write_text(test.script, encoding="utf-8")
    return replace(_script(script, variables), name=path.name, test=test)


def _script(path: Path, variables: Mapping[str, str] | None) -> Subject:
    """Return an input script, with a run if it has none."""
    deck = user_deck(path, variables=variables)
    if not deck.commands:
        raise SceneError("", problem="has no command", allowed="a LAMMPS input script", where=str(path))
    scene = None if deck.read is None else deck.read.scene
    fields: dict[str, Any] = {"name": path.name, "path": path, "variables": variables or {}}
    if deck.state.run is None and (added := _missing_run(path, deck, variables)):
        changed = applied({path.name: text_of_file(path)}, added)
        with_run = user_deck(path, variables=variables, changed=changed)
        scene = None if with_run.read is None else with_run.read.scene
        return Subject(**fields, deck=with_run, scene=scene, changed=changed, added=added)
    return Subject(**fields, deck=deck, scene=scene)


def _missing_run(path: Path, deck: UserDeck, variables: Mapping[str, str] | None) -> tuple[Edit, ...]:
    """Return a run in which a front passes all bodies, for a script without one; none if nothing moves."""
    lines = text_of_file(path).splitlines()
    end = len(lines) + 1
    trial = user_deck(
        path, variables=variables, changed=applied({path.name: "\n".join(lines)}, [_line(path, end, "run 1")])
    )
    if trial.read is None or trial.dt is None or (contact := contact_time_of(trial.read.scene)) is None:
        return ()
    duration = contact * (_CONTACT_TIMES_PER_BODY * trial.read.scene.n_body + _CONTACT_TIMES_AFTER)
    return (_line(path, end, f"run {math.ceil(duration / trial.dt)}"),)


def _line(path: Path, number: int, text: str) -> Edit:
    return Edit(file=path.name, line=number, new=text, added=True)


def _deck_of(scene: Scene, name: str, folder: Path, dt: float | None) -> Subject:
    """Return the deck of a scene at a step, or at a fiftieth of its shortest contact time."""
    backend = LammpsGranular(None)
    if reason := unsupported_reason(backend, scene):
        raise UnsupportedScene(f"LAMMPS cannot do {scene.name}: {reason}")
    assumed = ""
    if dt is None:
        dt, assumed = _default_step(scene)
    for name_of_file, text in deck_files(scene, dt).items():
        (folder / name_of_file).write_text(text, encoding="utf-8")
    path = folder / f"in.{scene.name}"
    deck = user_deck(path, scene)
    return Subject(name=scene.name, path=path, deck=deck, scene=scene, of_scene=name, assumed=assumed)


def _default_step(scene: Scene) -> tuple[float, str]:
    """Return the step, s, that is assumed for a scene, and what it is in words.

    It is a fiftieth of the shortest contact time; if nothing moves at first, of half a period of a contact.
    """
    part = f"1/{STEPS_OF_CONTACT:g} of"
    if (contact := contact_time_of(scene)) is not None:
        return contact / STEPS_OF_CONTACT, f"{part} the shortest contact time"
    frequency = prescan_scene(scene).frequency
    if frequency > 0.0:
        return math.pi / frequency / STEPS_OF_CONTACT, f"{part} half the shortest period of a contact"
    return scene.duration / scene.samples, "the time between two samples"


def deck_files(scene: Scene, dt: float) -> Mapping[str, str]:
    """Return the files of the deck of a scene at a time step, s, by name; a coarse step has fewer samples."""
    return LammpsGranular(None).deck(scene, Resolution(dt=dt), Sampling(count=samples_of(scene, dt))).files


def why_unread(subject: Subject) -> str:
    """Return in words why a script has no scene: the first line that is not supported, and how many more there are."""
    problems = [short_problem(problem) for problem in subject.deck.problems]
    problems.sort(key=lambda text: "`pair_" not in text)  # forces that are not known come first
    if not problems:
        return "the script has no run, and nothing moves at its start"
    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    style = subject.deck.last("pair_style")
    unread = f", because {subject.deck.unread_table}" if subject.deck.unread_table else ""
    what = ""
    if style is not None and "table" in style.rest:
        what = f"forces come from a table, which is compared with no law{unread}; "
    elif "model jkr" in problems[0]:
        what = (
            "the force of jkr is compared with no law: neither its pull-off nor the distance at which it ends; the step"
            " was judged by LAMMPS alone, and the release by its known defects; "
        )
    return f"{what}{problems[0]}{more}"


def short_problem(problem: str) -> str:
    """Return a problem of the reader with its line in front, without what is allowed.

    Examples
    --------
    >>> short_problem("in.x, line 3: `fix 2 all pour` has the fix style pour, which is not supported; allowed: nve")
    'line 3: `fix 2 all pour` has the fix style pour, which is not supported'
    """
    said = problem.partition("; allowed: ")[0]
    return re.sub(r"^[^,:]*, (line \d+: )", r"\1", said)
