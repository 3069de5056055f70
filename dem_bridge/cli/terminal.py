"""Print results as sentences, entries and tables; colours only on a terminal."""

from __future__ import annotations

import os
import shutil
import sys
import textwrap
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console

    from dem_bridge.observables.verdict import Verdict
    from dem_bridge.report.study import Study, Table
    from dem_bridge.runs.planning.answer import Plan
    from dem_bridge.scene.shipped import ListedScene
    from dem_bridge.verification.verification import Verification

_COLOURS = {"PASS": "green", "FAIL": "red", "BROKEN": "red", "MODEL_DIFFERENCE": "blue"}
#: columns of lines for people, where the terminal is not narrower
COLUMNS = 80
#: how lines are wrapped: a path or a number stays whole
_WHOLE_WORDS: dict[str, Any] = {"break_long_words": False, "break_on_hyphens": False}
#: largest number of scenes whose answers are printed one by one
_MOST_SCENES_ONE_BY_ONE = 10
#: rows of all tables together that are printed on a terminal
_MOST_ROWS_OF_TABLES = 100
#: repeated here to avoid an import; a test compares them with the package
_OUTCOMES = ("PASS", "FAIL", "UNDECIDED", "MODEL_DIFFERENCE", "NOT_RUN", "BROKEN")


def _console() -> Console:
    """Return a console with colours on a terminal, unless NO_COLOR is set, and plain text elsewhere."""
    from rich.console import Console

    class Piped(Console):
        """A console that leaves a closed pipe to the caller; rich would end the process as a check that failed."""

        def on_broken_pipe(self) -> None:
            raise BrokenPipeError

    return Piped(width=None if sys.stdout.isatty() else 140, highlight=False)


def _coloured(outcome: str) -> str:
    """Return the outcome in its colour."""
    colour = _COLOURS.get(outcome, "yellow")
    return f"[{colour}]{outcome}[/{colour}]"


def _cell(value: str | float) -> str:
    """Return a cell of a table: outcomes in their colour, numbers with four digits."""
    from rich.markup import escape

    return _coloured(value) if isinstance(value, str) and value in _OUTCOMES else escape(_plain(value))


def print_scenes(scenes: Sequence[ListedScene]) -> None:
    """Print a line per scene; on a terminal the description is wrapped to the width."""
    name = max(len(scene.name) for scene in scenes)
    width = columns()
    print(f"{'scene':{name}}  bodies   ms  description")
    for scene in scenes:
        head = f"{scene.name:{name}}  {scene.n_body:6} {1e3 * scene.duration:4.3g}  "
        print(textwrap.fill(scene.description, width, initial_indent=head, subsequent_indent=" " * len(head)))


def print_plan(plan: Plan, scene: str, verbose: bool = False) -> None:
    """Print a plan with its predicted and measured error and cost, and the command that makes the run last.

    ``scene`` is the name or path that was given. ``verbose``: the reasons come before.
    """
    for reason in plan.reasons if verbose else ():
        say(f"reason: {reason}")
    if plan.reasons and not verbose:
        say(f"reasons for these settings: {len(plan.reasons)} lines (-v prints them)")
    settings = ", ".join(f"{key} = {value}" for key, value in plan.resolution.items()) or "default settings"

    def numbers(error: float | None, cost: float | None) -> str:
        """Return the error and the cost as text; unknown numbers are left out."""
        parts = [f"error {error:.2g}"] if error is not None else []
        return ", ".join(parts + ([f"{cost:.2g} s of CPU"] if cost is not None else []))

    # the law of a step or a tolerance is fitted to random scenes; -v prints how far their errors spread
    spread = ": the median of random scenes" if {"dt", "rtol"} & set(plan.resolution) else ""
    rows = {
        "accuracy": f"{plan.accuracy:g} of {plan.observable} on {plan.scene}",
        "backend": f"{plan.backend}, {settings}",
        "predicted": f"{numbers(plan.model_error, plan.model_cost)} (by the error model{spread})",
        "measured": numbers(plan.found_error, plan.found_cost) or "no run was made",
    }
    if plan.steps:
        rows["steps"] = f"{plan.steps}" + (
            f", {plan.force_evaluations} force evaluations" if plan.force_evaluations else ""
        )
    if plan.units:
        names = {"rayleigh_time": "of the Rayleigh time", "contact_time": "of the Hertz contact time"}
        parts = [f"{100 * x:.3g} % {names.get(key, f'of {key}')}" for key, x in plan.units.items() if key != "dt"]
        rows["time step"] = ", ".join([f"{plan.units['dt']:.6g} s", *parts])
    words = " ".join(f"--{key} {value}" for key, value in plan.resolution.items())
    if set(plan.resolution) <= {"dt", "rtol", "samples"}:
        rows["command"] = f"dem-bridge run {scene} --backend {plan.backend} {words}".rstrip()
    else:
        keywords = "".join(f", {key}={value!r}" for key, value in plan.resolution.items())
        rows["command"] = f"db.solve({scene!r}, backend={plan.backend!r}{keywords})"
    command = rows.pop("command")
    for key, value in rows.items():
        print_entry(key, value, 10)
    print(f"{'command':10} {command}")  # in one line, so that it can be copied


def print_entry(name: str, text: str, names: int) -> None:
    """Print a name and its text beside it within 80 columns, without broken words; ``names`` is the room of a name."""
    following = " " * (names + 1)
    head = f"{name:{names}} "
    print(textwrap.fill(text, COLUMNS, initial_indent=head, subsequent_indent=following, **_WHOLE_WORDS))


def _without_single_scene(table: Table) -> tuple[str, Sequence[str], Sequence[Sequence[str | float]]]:
    """Return title, columns and rows; the name of a scene that all rows share stands in the title alone."""
    scenes = {row[0] for row in table.rows}
    if table.columns[0] != "scene" or len(scenes) != 1:
        return table.title, table.columns, table.rows
    return f"{table.title}: {scenes.pop()}", table.columns[1:], [row[1:] for row in table.rows]


def print_study(study: Study, verbose: bool = False) -> None:
    """Print what does not pass, the answer and the number of verdicts by outcome, so that the answer is last.

    ``verbose``: tables and notes come before.
    """
    if verbose:
        _print_tables(study.tables)
    elif study.tables:
        say(f"{len(study.tables)} tables, {len(study.notes)} notes (-v prints them, -o writes them)")
    _print_notes(study, verbose)
    for line in _not_passed(study.verdicts):
        say(line)
    for sentence in study.answer:
        say(f"* {sentence}")
    _print_counts(study)


def _print_notes(study: Study, verbose: bool) -> None:
    """Print notes; without ``verbose`` only those on a store that keeps nothing: a second call takes as long."""
    from dem_bridge.runs.store import StoreNote

    for note in study.notes:
        if verbose or isinstance(note, StoreNote):
            say(f"note: {note}")


def print_verification(verification: Verification, verbose: bool = False) -> None:
    """Print the answer of a verification: for each scene its error, the cause and the steps, and one line a cause.

    Of more than ten scenes those that pass are counted, and the answer on all of them follows. ``verbose``: as for
    studies, tables and notes, and a line for each verdict that does not pass.
    """
    from dem_bridge.verification.banner import banner_of, reasons_not_run

    if verbose:
        _print_tables(verification.tables)
    _print_notes(verification, verbose)
    for line in _not_passed(verification.verdicts) if verbose else ():
        say(line)
    banners = [banner_of(study, verification.accuracy) for study in verification.studies]
    several = len(banners) > _MOST_SCENES_ONE_BY_ONE
    for banner in banners:
        if several and banner.outcome.value == "PASS":
            continue
        say(f"{banner.scene}: {' '.join(banner.sentences)}")
        for group in banner.groups:
            say(f"  {group.sentence}{f' Write: {group.write}' if group.write else ''}")
    for sentence in verification.answer if several else ():
        say(f"* {sentence}")
    for sentence in reasons_not_run(verification.studies):
        say(sentence)
    _print_counts(verification)


def _print_counts(study: Study) -> None:
    """Print the number of verdicts by outcome, and whether the study was interrupted."""
    from collections import Counter

    if counts := Counter(verdict.outcome.value for verdict in study.verdicts):
        in_colours = sys.stdout.isatty() or "FORCE_COLOR" in os.environ
        words = (f"{count} {_coloured(outcome) if in_colours else outcome}" for outcome, count in counts.items())
        # the import of rich takes a tenth of a second
        (_console().print if in_colours else print)(f"verdicts: {', '.join(words)}")
    if study.interrupted:
        say("interrupted: only the results up to the interruption are shown")


def _not_passed(verdicts: Sequence[Verdict]) -> Iterator[str]:
    """Yield the outcome and sentence of verdicts that do not pass, each sentence once with the number of scenes."""
    from collections import Counter

    from dem_bridge.report.texts import without_repeats

    left = without_repeats(v for v in verdicts if v.outcome.value not in ("PASS", "MODEL_DIFFERENCE"))
    for line, count in Counter(f"{v.outcome.value}: {v.sentence}" for v in left).items():
        yield f"{line}{f' ({count} times)' if count > 1 else ''}"


def say(text: str) -> None:
    """Print a sentence; its words are wrapped at the width of the terminal, at most 80 columns, and never broken."""
    within = text[: len(text) - len(text.lstrip())]
    width = min(COLUMNS, columns())
    following = within + "  "
    print(textwrap.fill(text, width, subsequent_indent=following, **_WHOLE_WORDS))


def _print_tables(tables: Sequence[Table]) -> None:
    """Print tables; those with very many rows are named. A table that is too wide has a line for each cell."""
    from rich.table import Table as Grid

    console, rows = _console(), 0
    for data in tables:
        rows += len(data.rows)
        if rows > _MOST_ROWS_OF_TABLES:
            say(f"{data.title}: {len(data.rows)} rows (-o writes them to tables/{data.id}.csv)")
            continue
        title, names, cells = _without_single_scene(data)
        console.print(title, style="bold", markup=False)
        grid = Grid(box=None, pad_edge=False)
        longest = _longest_words(names, cells)
        for name, least in zip(names, longest, strict=True):
            grid.add_column(name, overflow="fold", min_width=least)
        for row in cells:
            grid.add_row(*map(_cell, row))
        if console.measure(grid).minimum <= console.width and sum(longest) + 2 * len(longest) <= console.width:
            console.print(grid)
            continue
        for row in cells:
            first, *others = (f"{name} {_plain(value)}" for name, value in zip(names, row, strict=True))
            say(f"{first}; {'; '.join(others)}")


def _longest_words(names: Sequence[str], cells: Sequence[Sequence[str | float]]) -> list[int]:
    """Return the length of the longest word of each column of a table."""
    rows = [names, *(list(map(_plain, row)) for row in cells)]
    return [max(len(word) for row in rows for word in (row[k].split() or [""])) for k in range(len(names))]


def _plain(value: str | float) -> str:
    """Return a cell without colours."""
    return value if isinstance(value, str) else "-" if value != value else f"{value:.4g}"


def columns() -> int:
    """Return the number of columns of the terminal; many where the output is a pipe."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else sys.maxsize
