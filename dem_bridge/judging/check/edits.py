"""Lines of an input script that are changed, added or left out, such as those of another time step."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from dem_bridge.errors import UsageError
from dem_bridge.lmp.reader.evaluation import ReadScript
from dem_bridge.lmp.reader.script import Command, logical_lines

#: how much longer than the least a series of steps may be for a time step with fewer digits
_LARGEST_MULTIPLE_OF_STEPS = 1.35
#: relative difference of two durations that counts as round-off
_ROUNDOFF_OF_DURATIONS = 1e-9


@dataclass(frozen=True, kw_only=True)
class Edit:
    """One line of a file of a script that is replaced, or one that is added before it."""

    file: str
    line: int
    """Number of the first line that is replaced, or of that before which the new one stands, from 1."""
    new: str
    added: bool = False

    def __str__(self) -> str:
        return self.new

    @property
    def place(self) -> str:
        """Where the line belongs, in words."""
        return f"{'before ' if self.added else ''}line {self.line} of {self.file}"


def applied(texts: Mapping[str, str], edits: Sequence[Edit]) -> dict[str, str]:
    r"""Return the texts of the files that edits change, by name.

    Examples
    --------
    >>> edits = [Edit(file="in.x", line=2, new="run 4"), Edit(file="in.x", line=2, new="timestep 1", added=True)]
    >>> applied({"in.x": "units si\nrun 2\n"}, edits)["in.x"].splitlines()
    ['units si', 'timestep 1', 'run 4']
    """
    changed: dict[str, str] = {}
    for file in dict.fromkeys(edit.file for edit in edits):
        lines: dict[int, list[str]] = {n: [line] for n, line in enumerate(texts[file].splitlines(), start=1)}
        numbers = [number for number, _ in logical_lines(texts[file])]
        ends = dict(zip(numbers, [*numbers[1:], len(lines) + 1], strict=True))
        of_file = [edit for edit in edits if edit.file == file]
        for edit in (edit for edit in of_file if not edit.added):
            for number in range(edit.line, _end_of(lines, edit.line, ends)):
                lines[number] = []
            lines[edit.line] = [edit.new]
        for edit in (edit for edit in reversed(of_file) if edit.added):
            lines.setdefault(edit.line, []).insert(0, edit.new)
        changed[file] = "\n".join(line for n in sorted(lines) for line in lines[n]) + "\n"
    return changed


def _end_of(lines: Mapping[int, list[str]], first: int, ends: Mapping[int, int]) -> int:
    """Return the number behind the last line of a command, without the blank lines that follow."""
    last = first
    while last + 1 < ends.get(first, first + 1) and lines[last] and lines[last][0].rstrip().endswith("&"):
        last += 1
    return last + 1


def finer(
    texts: Mapping[str, str], commands: Iterable[Command], state: ReadScript, factor: int, *, coarse: bool = False
) -> tuple[Edit, ...]:
    """Return the edits that divide all time steps of a script by a whole number and keep the duration of its runs.

    ``coarse``: steps of several are divided only as far as they are above the longest one divided by ``factor``.

    Raises
    ------
    UsageError
        If a line of the steps cannot be changed: one within a branch, or a run with the keywords start or stop.
    """
    seen: dict[tuple[str, int], Edit] = {}
    has_step, by = False, factor
    first_run: Command | None = None
    for command in commands:
        has_step = has_step or (command.name == "timestep" and first_run is None)
        if command.name == "run" and first_run is None:
            first_run = command
        if coarse and command.name == "timestep":
            by = tidy_factor(float(command.rest[0]), float(command.rest[0]) * factor / max(state.time_steps))
        place = (command.file, command.line)
        if command.name not in _SCALED:
            continue
        edit = _scaled(command, dict(logical_lines(texts[command.file]))[command.line], by)
        if coarse and seen.setdefault(place, edit) != edit:
            raise UsageError(f"{command.file}, line {command.line}: `{command.text}` runs with several time steps")
        seen.setdefault(place, edit)
    edits = tuple(edit for edit in seen.values() if not coarse or edit.new != _bare(texts, edit))
    if first_run is not None and not has_step and state.step is not None:
        step = f"timestep {state.time_steps[0] / factor if state.time_steps else state.step / factor:.15g}"
        edits = (Edit(file=first_run.file, line=first_run.line, new=step, added=True), *edits)
    return tuple(sorted(edits, key=lambda edit: (edit.file, edit.line, not edit.added)))


def _bare(texts: Mapping[str, str], edit: Edit) -> str:
    """Return the line that an edit replaces as it is written, without its comment."""
    return " ".join(_split(dict(logical_lines(texts[edit.file]))[edit.line]))


def stretched(texts: Mapping[str, str], commands: Iterable[Command], step: float) -> tuple[Edit, ...]:
    """Return the edits of a script with one longer step, in the units of the script, whose runs last at least as long.

    Raises
    ------
    UsageError
        If a step or a number of steps is not written as a number, or stands in a loop.
    """
    edits: list[Edit] = []
    before = 0.0
    for command in commands:
        if command.name not in _SCALED:
            continue
        plain = _bare(texts, Edit(file=command.file, line=command.line, new="")) == command.text
        place = (command.file, command.line)
        if not plain or len(command.rest) != 1 or place in {(edit.file, edit.line) for edit in edits}:
            raise UsageError(f"{command.file}, line {command.line}: `{command.text}` cannot be changed to other steps")
        value = float(command.rest[0])
        before = value if command.name == "timestep" else before
        new = f"timestep {step:.15g}" if command.name == "timestep" else f"run {math.ceil(value * before / step)}"
        edits.append(Edit(file=command.file, line=command.line, new=new))
    return tuple(edits)


def only_steps(edits: Iterable[Edit]) -> tuple[Edit, ...]:
    """Return the edits without those of runs, for a script that computes its numbers of steps from the time step."""
    return tuple(edit for edit in edits if edit.new.startswith("timestep"))


def keeps_duration(before: ReadScript, after: ReadScript, factor: float) -> bool:
    """Return True if a changed script runs as long as before, in steps that are so many times shorter."""
    steps = zip(before.time_steps, after.time_steps, strict=False)
    finer = all(math.isclose(new * factor, old, rel_tol=_ROUNDOFF_OF_DURATIONS) for old, new in steps)
    as_long = math.isclose(before.duration, after.duration, rel_tol=_ROUNDOFF_OF_DURATIONS)
    return finer and as_long and len(before.time_steps) == len(after.time_steps)


def tidy_factor(step: float, least: float) -> int:
    """Return a whole number from ``least`` on that divides a time step to one of few digits.

    Examples
    --------
    >>> tidy_factor(5e-6, 2.6), tidy_factor(1e-6, 7.0), tidy_factor(1e-6, 0.3)
    (4, 8, 1)
    """
    first = max(1, math.ceil(least * (1.0 - 1e-12)))
    if first == 1:
        return 1
    factors = range(first, max(first + 1, int(_LARGEST_MULTIPLE_OF_STEPS * first)) + 1)
    return min(factors, key=lambda factor: (len(f"{step / factor:.15e}".rstrip("0").split("e")[0].rstrip("0")), factor))


def _scaled(command: Command, raw: str, factor: int) -> Edit:
    """Return the edit of one ``timestep`` or ``run`` command."""
    words = _split(raw)
    if not words or words[0] != command.name or {"start", "stop"} & {*command.rest}:
        raise UsageError(f"{command.file}, line {command.line}: `{command.text}` cannot be changed to other steps")
    new = _SCALED[command.name](command, words, factor) if factor > 1 else " ".join(words)
    return Edit(file=command.file, line=command.line, new=new)


def _step(command: Command, words: list[str], factor: int) -> str:
    """Return a ``timestep`` command with a step that is so many times shorter."""
    return f"timestep {float(command.rest[0]) / factor:.15g}"


def _run(command: Command, words: list[str], factor: int) -> str:
    """Return a ``run`` command with so many times the steps."""
    places = [1, *(place + 1 for place, word in enumerate(words) if word == "every")]
    return " ".join(_times(word, factor) if place in places else word for place, word in enumerate(words))


_SCALED: Mapping[str, Callable[[Command, list[str], int], str]] = {"timestep": _step, "run": _run}


def _split(raw: str) -> list[str]:
    """Return the words of a line as it is written, without its comment; formulas in brackets are one word."""
    bare = re.sub(r"\s#.*", "", f" {raw}").strip()
    return re.findall(r"\$\((?:[^()]|\([^()]*\))*\)|\"[^\"]*\"|\S+", bare)


def _times(word: str, factor: int) -> str:
    """Return a number of steps, or a formula of one, times a whole number.

    Examples
    --------
    >>> _times("100", 4), _times("${n}", 4), _times("$(v_T/dt)", 4), _times("1e3", 2)
    ('400', '$(4*v_n)', '$(4*(v_T/dt))', '2000')
    """
    if match := re.fullmatch(r"\$\{(\w+)\}|\$(\w)", word):
        return f"$({factor}*v_{match[1] or match[2]})"
    if word.startswith("$(") and ":" not in word:
        return f"$({factor}*{word[1:]})"
    if word.startswith("v_"):
        return f"$({factor}*{word})"
    try:
        return f"{round(float(word) * factor)}"
    except ValueError:
        raise UsageError(f"a number of steps is written as {word!r}; allowed: a number or a variable") from None
