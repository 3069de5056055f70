"""What the command line shows on a terminal: tables and progress. Plain text where there is none."""

from __future__ import annotations

import shutil
import sys
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

    from dem_bridge.planning.answer import Plan
    from dem_bridge.scene import Scene
    from dem_bridge.studies.scatter import ScatterStudy
    from dem_bridge.studies.study import Paper, Study
    from dem_bridge.studies.styles import StylesStudy
    from dem_bridge.studies.verify import Verification

_COLOURS = {"PASS": "green", "FAIL": "red", "BROKEN": "red", "MODEL_DIFFERENCE": "blue"}
#: of a table on a terminal
_MOST_ROWS = 40
#: named again here so that nothing is imported for it; a test holds the two together
_OUTCOMES = ("PASS", "FAIL", "UNDECIDED", "MODEL_DIFFERENCE", "NOT_RUN", "BROKEN")


def _console() -> Console:
    """Colours on a terminal that wants them (NO_COLOR is heard), plain text elsewhere."""
    from rich.console import Console

    return Console(width=None if sys.stdout.isatty() else 140, highlight=False)


def _coloured(outcome: str) -> str:
    colour = _COLOURS.get(outcome, "yellow")
    return f"[{colour}]{outcome}[/{colour}]"


def _cell(value: str | float) -> str:
    """A cell of a table: outcomes in their colour, numbers with four digits."""
    from rich.markup import escape

    if isinstance(value, str):
        return _coloured(value) if value in _OUTCOMES else escape(value)
    return "-" if value != value else f"{value:.4g}"


def print_scenes(found: list[Scene]) -> None:
    """A line each; on a terminal what happens in it is wrapped to what is left of the width."""
    name = max(len(scene.name) for scene in found)
    columns = shutil.get_terminal_size().columns if sys.stdout.isatty() else sys.maxsize
    print(f"{'scene':{name}}  bodies   ms  what happens")
    for scene in found:
        head = f"{scene.name:{name}}  {scene.n_body:6} {1e3 * scene.duration:4.3g}  "
        print(textwrap.fill(scene.description, columns, initial_indent=head, subsequent_indent=" " * len(head)))


def print_styles(found: StylesStudy) -> None:
    """The matrix of ways and quantities; "=" marks what is bit for bit the first way. Then what is to be known."""
    from rich.table import Table

    console = _console()
    console.print(
        f"{found.scene.name}, dt = {found.dt:.4g} s, LAMMPS {found.lammps}: differences to the twin at the same step,"
        " relative; the tolerance is of velocity",
        markup=False,
    )
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("way")
    names = ("velocity", "displacement", "peak_force", "crossing_time")
    for column in (
        "velocity",
        "displace-\nment",
        "peak\nforce",
        "crossing\ntime",
        "toler-\nance",
        "bit-\nwise",
        "wall\ns",
    ):
        table.add_column(column, justify="right")
    table.add_column("outcome")
    for row in found.rows:
        numbers = [f"{row.differences[name].value:.1e}" if row.differences else "-" for name in names]
        numbers.append(f"{row.tolerances['velocity']:.1e}" if row.tolerances else "-")
        bits = {None: "-", True: "=", False: "no"}[row.bitwise]
        wall = f"{row.wall:.3f}" if row.differences else "-"
        table.add_row(row.way, *numbers, bits, wall, _coloured(row.outcome.value))
    console.print(table)
    for row in found.rows:
        for kind, text in (
            ("note" if row.differences else row.outcome.value, row.reason),
            (row.outcome.value, row.beyond),
        ):
            if text:
                console.print(f"{kind}: {row.way}: {text}", markup=False)


def print_scatter(found: ScatterStudy) -> None:
    """What a set of chains differs by from the one that was wanted, in words."""
    told = found.as_json()
    times, force = (sorted(told[key]) for key in ("residence_spread", "force_spread"))
    for line in (
        f"{found.scene.name}: {told['chains']} chains, angles off by {found.spread:g} degrees (standard deviation)",
        f"arrival at the last body: {100 * told['arrival_shift_mean']:+.2f} % on average,"
        f" standard deviation {100 * told['arrival_shift_deviation']:.2f} %",
        f"residence time at a body: standard deviation {100 * times[len(times) // 2]:.2f} % (median),"
        f" {100 * times[-1]:.2f} % (largest)",
        f"peak force of a contact:  standard deviation {100 * force[len(force) // 2]:.2f} % (median),"
        f" {100 * force[-1]:.2f} % (largest)",
    ):
        _console().print(line, markup=False)


def print_plan(found: Plan, scene: str) -> None:
    """The answer, what it was predicted and found to do, and why; ``scene`` as it was asked for."""
    settings = ", ".join(f"{key} = {value}" for key, value in found.resolution.items()) or "nothing to set"

    def numbers(error: float | None, cost: float | None) -> str:
        told = [f"error {error:.2g}"] if error is not None else []
        return ", ".join(told + ([f"{cost:.2g} s of CPU"] if cost is not None else []))

    rows = {
        "wanted": f"{found.accuracy:g} of {found.observable} on {found.scene}",
        "backend": f"{found.backend}, {settings}",
        "predicted": f"{numbers(found.model_error, found.model_cost)} (by the model alone)",
        "found": numbers(found.found_error, found.found_cost) or "nothing was run",
    }
    if found.steps:
        rows["steps"] = f"{found.steps}" + (
            f", {found.force_evaluations} evaluations of the forces" if found.force_evaluations else ""
        )
    if found.units:
        names = {"rayleigh_time": "of the Rayleigh time", "contact_time": "of the Hertz contact time"}
        parts = [f"{100 * x:.3g} % {names.get(key, f'of {key}')}" for key, x in found.units.items() if key != "dt"]
        rows["step taken"] = ", ".join([f"{found.units['dt']:.6g} s", *parts])
    words = " ".join(f"--{key} {value}" for key, value in found.resolution.items())
    if set(found.resolution) <= {"dt", "rtol", "samples"}:
        rows["run it by"] = f"dem-bridge run {scene} --backend {found.backend} {words}".rstrip()
    else:
        given = "".join(f", {key}={value!r}" for key, value in found.resolution.items())
        rows["run it by"] = f"db.solve({scene!r}, backend={found.backend!r}{given})"
    for key, value in rows.items():
        _console().print(f"{key:10} {value}", markup=False, soft_wrap=True)
    for reason in found.reasons:
        _console().print(f"why: {reason}", markup=False, soft_wrap=True)


def print_study(found: Study) -> None:
    """The answer in words, then the tables."""
    from rich.table import Table

    console = _console()
    for sentence in found.answer:
        console.print(f"* {sentence}", markup=False)
    for one in found.tables:
        if len(one.rows) > _MOST_ROWS:
            console.print(f"{one.title}: {len(one.rows)} rows, with -o in {one.id}.csv", markup=False)
            continue
        table = Table(box=None, pad_edge=False, title=one.title, title_justify="left", title_style="bold")
        for name in one.columns:
            table.add_column(name, overflow="fold")
        for row in one.rows:
            table.add_row(*map(_cell, row))
        console.print(table)
    for note in found.notes:
        console.print(f"note: {note}", markup=False)
    if found.interrupted:
        console.print("interrupted: this is what was finished until then", markup=False)


def print_claims(paper: Paper) -> None:
    """Every claim of the paper with its outcome, and the answer."""
    from rich.table import Table

    console = _console()
    table = Table(box=None, pad_edge=False)
    for column in ("claim", "where", "outcome", "found"):
        table.add_column(column, overflow="fold")
    for one in paper.claims:
        table.add_row(one.id, one.where, _coloured(one.outcome.value), one.sentence)
    console.print(table)
    for sentence in paper.answer:
        console.print(f"* {sentence}", markup=False)


def print_verdicts(found: Verification) -> None:
    """The verdict table, and what does not pass in words. Of the whole paper: its claims, and how many verdicts"
    " pass."""
    if found.paper is not None:
        print_claims(found.paper)
        _print_counts(found)
        return
    from rich.table import Table

    console = _console()
    table = Table(box=None, pad_edge=False)
    for column in ("scene", "quantity", "compared", "difference", "bar", "tolerance", "outcome"):
        table.add_column(column, justify="right" if column in ("difference", "bar", "tolerance") else "left")
    for v in found.verdicts:
        numbers = [f"{x:.2g}" if x == x else "-" for x in (v.difference, v.reference_uncertainty, v.tolerance)]
        table.add_row(v.scene, v.quantity, f"{v.backend} - {v.reference}", *numbers, _coloured(v.outcome.value))
    console.print(table)
    for v in found.verdicts:
        if v.outcome.value not in ("PASS", "MODEL_DIFFERENCE"):
            console.print(f"{v.outcome.value}: {v.sentence}", markup=False)


def _print_counts(found: Verification) -> None:
    """How many verdicts have each outcome, and those that do not pass in words."""
    from collections import Counter

    console = _console()
    counts = Counter(v.outcome.value for v in found.verdicts)
    text = ", ".join(f"{count} {_coloured(outcome)}" for outcome, count in counts.items())
    console.print(f"verdicts on {len(found.studies)} scenes: {text}")
    for v in found.verdicts:
        if v.outcome.value not in ("PASS", "MODEL_DIFFERENCE", "NOT_RUN"):
            console.print(f"{v.outcome.value}: {v.sentence}", markup=False)


@contextmanager
def bar() -> Iterator[Callable[[float, int, str], None] | None]:
    """A progress bar with ETA on a terminal; None in a pipe."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("ETA"),
        TimeRemainingColumn(),
        TextColumn("{task.description}"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task("", total=1.0)
        yield lambda done, total, label: bars.update(task, completed=done / total, description=label)


@contextmanager
def fraction(label: str) -> Iterator[None]:
    """Show how far one run is, as :func:`bar`."""
    from dem_bridge.progress import listening

    with bar() as progress:
        if progress is None:
            yield
            return
        progress(0.0, 1, label)
        with listening(lambda part: progress(part, 1, label)):
            yield
