"""Runs of a foreign code over a series of time steps, and its work-precision beside the codes of the house.

A command such as ``mycode {scene} {dt} {out}`` is split as a shell does, but no shell runs it. Every run has a working
folder of its own, which is removed; files that the command names are found from the folder of the caller.
"""

from __future__ import annotations

import math
import re
import shlex
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from dem_bridge.backends.base import Resolution, Sampling, backend
from dem_bridge.backends.lammps import LammpsGranular
from dem_bridge.backends.prescan import prescan_hertz
from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.foundation.files import write_whole
from dem_bridge.foundation.numbers import check_number
from dem_bridge.lmp.child import how_ended, run_program
from dem_bridge.lmp.process import workspace
from dem_bridge.scene.file.write import scene_json, scene_toml
from dem_bridge.scene.scene import Scene

#: default time steps: the largest is this part of 1/omega of the stiffest contact, each other half of the one before
LARGEST_STEP_OMEGA, NUMBER_OF_STEPS = 0.04, 4
#: time limit of a run, s
TIME_LIMIT_S = 600.0
_PLACEHOLDER = re.compile(r"\{([A-Za-z][\w.]*)\}")
_SCENES = ("scene", "scene.json", "scene.toml", "deck")
_ALLOWED = "{scene} or {scene.json}, {scene.toml}, {deck}, {dt}, and {out} or {out.ENDING} such as {out.csv}"


class OutOfTime(RunBroken):
    """A run of a code that did not end within its time limit."""


@dataclass(frozen=True, kw_only=True)
class ForeignRun:
    """One run of a foreign code; times in s, those of the whole process."""

    name: str
    """Program and time step, for tables and messages."""
    dt: float
    out: Path
    """File of the samples, a folder, or a pattern of files with a frame each."""
    wall: float
    cpu: float


@dataclass(frozen=True)
class Command:
    """A command with placeholders, split into words.

    Parameters
    ----------
    words : tuple of str
        Program and arguments; :meth:`of` checks them.
    """

    words: tuple[str, ...]

    @classmethod
    def of(cls, command: str | Sequence[str]) -> Command:
        """Return the command of a text or of words.

        Raises
        ------
        UsageError
            If quotes do not close, a placeholder is unknown, ``{dt}`` or ``{out}`` is missing, or there is no such
            program.

        Examples
        --------
        >>> Command.of("sh -c 'mycode < {scene}' {dt} {out.csv}").words[1:]
        ('-c', 'mycode < {scene}', '{dt}', '{out.csv}')
        """
        try:
            words = shlex.split(command) if isinstance(command, str) else [str(word) for word in command]
        except ValueError as error:
            raise UsageError(f"command = {command!r} cannot be split ({error}); close its quotes") from None
        names = _PLACEHOLDER.findall(" ".join(words))
        outs = {name for name in names if name.split(".")[0] == "out"}
        for name in names:
            if name not in (*_SCENES, "dt", *outs):
                raise UsageError(f"command: the placeholder {{{name}}} is unknown; allowed: {_ALLOWED}")
        if "dt" not in names or len(outs) != 1:
            missing = "{dt}" if "dt" not in names else "{out}"
            problem = f"has {len(outs)} names of its output" if len(outs) > 1 else f"has no {missing}"
            raise UsageError(f"command = {' '.join(words)!r} {problem}; allowed: {_ALLOWED}, each with one meaning")
        if (program := shutil.which(words[0])) is None:
            raise UsageError(f"command: there is no program {words[0]!r} on PATH or at this path; give its path")
        return cls((str(Path(program).absolute()), *map(_absolute, words[1:])))

    @property
    def name(self) -> str:
        """Name of the code: its script, or the program."""
        script = next((word for word in self.words[1:3] if word.startswith("/")), self.words[0])
        return Path(script).name

    @property
    def placeholders(self) -> set[str]:
        """Names of the placeholders."""
        return set(_PLACEHOLDER.findall(" ".join(self.words)))

    def filled(self, values: dict[str, str]) -> list[str]:
        """Return the words with the values of the placeholders."""
        return [_PLACEHOLDER.sub(lambda match: values[match[1]], word) for word in self.words]


def default_steps(scene: Scene) -> tuple[float, ...]:
    """Return time steps that divide the sampling interval, s: the largest resolves the stiffest contact of the scene.

    Examples
    --------
    >>> from dem_bridge.scene.file import load_scene
    >>> [f"{dt:.3g}" for dt in default_steps(load_scene("decelerating-40"))]
    ['2.14e-07', '1.07e-07', '5.36e-08', '2.68e-08']
    """
    interval = scene.duration / scene.samples
    frequency = prescan_hertz(scene).frequency
    steps = max(1, math.ceil(interval * frequency / LARGEST_STEP_OMEGA))
    return tuple(interval / (steps * 2**k) for k in range(NUMBER_OF_STEPS))


@contextmanager
def foreign_runs(
    command: Command,
    scene: Scene,
    steps: Sequence[float],
    *,
    time_limit: float = TIME_LIMIT_S,
    progress: Callable[[str], None] | None = None,
) -> Iterator[tuple[ForeignRun, ...]]:
    """Run a foreign code at each time step (s) and yield its runs; their files are removed after the context.

    Raises
    ------
    UsageError
        If a time step or the time limit is not a number above 0.
    UnsupportedScene
        If the scene cannot be written for the code.
    RunBroken
        If a run fails, does not end in time or writes no output.
    """
    for name, value in (*(("dt", dt) for dt in steps), ("time_limit", time_limit)):
        check_number(name, value, "a number above 0 (s)", above=0.0)
    if not steps or len({*steps}) < len(steps):
        raise UsageError(f"dt = {list(steps)}; allowed: one or more time steps (s), each once")
    with workspace() as folder:
        runs = []
        for number, dt in enumerate(sorted(steps, reverse=True)):
            if progress is not None:
                progress(f"{command.name} at dt = {dt:.6g} s")
            runs.append(_run(command, scene, dt, folder / f"run-{number}", time_limit))
        yield tuple(runs)


def _run(command: Command, scene: Scene, dt: float, folder: Path, time_limit: float) -> ForeignRun:
    """Run the code at one time step in a new folder."""
    work = folder / "work"
    work.mkdir(parents=True)
    (out,) = (name for name in command.placeholders if name.split(".")[0] == "out")
    values = {"dt": repr(float(dt)), out: str(folder / out)}
    if command.placeholders & {"scene", "scene.json"}:
        values |= dict.fromkeys(("scene", "scene.json"), _written(folder / "scene.json", scene_json(scene)))
    if "scene.toml" in command.placeholders:
        values["scene.toml"] = _written(folder / "scene.toml", scene_toml(scene))
    if "deck" in command.placeholders:
        code = backend("lammps-granular")
        assert isinstance(code, LammpsGranular)
        deck = code.deck(scene, Resolution(dt=dt), Sampling(count=scene.samples))
        write_whole(work, deck.files)
        values["deck"] = str(work / next(iter(deck.files)))
    name = f"{command.name} at dt = {dt:.6g} s"
    stdout, stderr = folder / "stdout.txt", folder / "stderr.txt"
    try:
        ended = run_program(command.filled(values), work, time_limit=time_limit, stdout=stdout, stderr=stderr)
    except TimeoutError:
        raise OutOfTime(
            f"{name} did not end within the time limit of {time_limit:g} s and was stopped; give a larger"
            " --time-limit or larger time steps (--dt)"
        ) from None
    said = _last_line(stderr) or _last_line(stdout)
    if ended.code != 0:
        raise RunBroken(f"{name} ended {how_ended(ended.code)}" + (f": {said}" if said else " without a message"))
    output = folder / out
    if not output.exists():  # some writers add an ending, or write a file for each frame
        others = sorted(folder.glob(f"{out}*"))
        if not others:
            raise RunBroken(
                f"{name} ended without error but wrote no file {{{out}}}; the command must write its samples there"
                + (f" (its last line was: {said})" if said else "")
            )
        output = others[0] if len(others) == 1 else folder / f"{out}*"
    return ForeignRun(name=name, dt=dt, out=output, wall=ended.wall, cpu=ended.cpu)


def _absolute(word: str) -> str:
    """Return the absolute path of a word that names a file from the folder of the caller, and other words unchanged.

    A bare word is changed only if it names a file, because it may be a name of something else.
    """
    if _PLACEHOLDER.search(word) or word.startswith("-"):
        return word
    try:
        path = Path(word)
        exists = path.is_file() or ("/" in word and path.exists())
    except (OSError, ValueError):  # too long, or a NUL
        return word
    return str(path.absolute()) if exists else word


def _written(path: Path, text: str) -> str:
    """Write a text and return its path as a word."""
    path.write_text(text, encoding="utf-8")
    return str(path)


def _last_line(path: Path) -> str:
    """Return the last line with content of what a program printed."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 20_000))
        lines = [line.strip() for line in file.read().decode(errors="replace").splitlines() if line.strip()]
    return "".join(sign for sign in lines[-1][:500] if sign.isprintable()) if lines else ""
