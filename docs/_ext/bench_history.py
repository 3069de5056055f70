"""Draw the runs of ``make bench`` that are kept in docs/bench.jsonl, while the site is built."""

from __future__ import annotations

import html
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

#: panels in a row, and width and height of a panel, px
_COLUMNS, _WIDTH, _HEIGHT = 3, 250, 120
#: room around the points of a panel, px: left, right, top, bottom
_LEFT, _RIGHT, _TOP, _BOTTOM = 10, 10, 40, 10

Run = Mapping[str, Any]


def read(path: Path) -> list[Run]:
    """Return the runs that are kept, oldest first."""
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()] if path.exists() else []


def machine_changes(runs: Sequence[Run]) -> list[int]:
    """Return the numbers of the runs that are on another machine than the run before.

    Examples
    --------
    >>> machine_changes([{"machine": "a"}, {"machine": "a"}, {"machine": "b"}, {"machine": "a"}])
    [2, 3]
    """
    return [nth for nth in range(1, len(runs)) if runs[nth]["machine"] != runs[nth - 1]["machine"]]


def picture(runs: Sequence[Run]) -> str:
    """Return a panel for each piece of work: median and interquartile range of each run, from 0 s on, as SVG."""
    names = list(dict.fromkeys(name for run in runs for name in run["work"]))
    rows = -(-len(names) // _COLUMNS)
    panels = (
        f'<g transform="translate({nth % _COLUMNS * _WIDTH} {nth // _COLUMNS * _HEIGHT})">{_panel(name, runs)}</g>'
        for nth, name in enumerate(names)
    )
    times = "one run" if len(runs) == 1 else f"{len(runs)} runs"
    label = f"CPU time of {len(names)} pieces of work in {times} of the benchmarks; the table has the last."
    return (
        f'<svg class="bench-history" role="img" aria-label="{label}" viewBox="0 0 {_COLUMNS * _WIDTH} {rows * _HEIGHT}"'
        f' style="width: 100%; color: inherit" fill="currentColor" stroke="none" font-size="12">{"".join(panels)}</svg>'
    )


def _panel(name: str, runs: Sequence[Run]) -> str:
    """Return the panel of one piece of work; runs that lack it leave a gap."""
    work = {nth: run["work"][name] for nth, run in enumerate(runs) if name in run["work"]}
    most = max(part["median"] + part["range"] for part in work.values()) or 1.0
    across, up = _WIDTH - _LEFT - _RIGHT, _HEIGHT - _TOP - _BOTTOM

    def x(nth: float) -> float:
        return _LEFT + across * (nth + 0.5) / len(runs)

    def y(seconds: float) -> float:
        return _TOP + up * (1.0 - seconds / most)

    last = work[max(work)]
    parts = [
        f'<text x="{_LEFT}" y="14">{html.escape(name)}</text>',
        f'<text x="{_LEFT}" y="30" opacity="0.8">last {last["median"]:.3g} s, largest {most:.3g} s</text>',
        f'<path d="M{_LEFT} {_TOP + up}h{across}" stroke="currentColor" opacity="0.5"/>',
    ]
    for nth in machine_changes(runs):
        dashed = 'stroke="currentColor" stroke-dasharray="3 3" opacity="0.7"'
        parts.append(f'<path class="machine" d="M{x(nth - 0.5):.1f} {_TOP}v{up}" {dashed}/>')
    for nth, part in work.items():
        half = 0.5 * part["range"]
        low, high = y(part["median"] - half), y(part["median"] + half)
        parts.append(f'<path d="M{x(nth):.1f} {low:.1f}V{high:.1f}" stroke="currentColor"/>')
        title = html.escape(f"{runs[nth]['commit']}: {part['median']:.3g} s, interquartile range {part['range']:.2g} s")
        parts.append(f'<circle cx="{x(nth):.1f}" cy="{y(part["median"]):.1f}" r="3"><title>{title}</title></circle>')
    return "".join(parts)


def table(runs: Sequence[Run]) -> Iterator[str]:
    """Yield the lines of an HTML table: each piece of work in the last run and in the one before on its machine."""
    last = runs[-1]
    yield "<table><thead><tr><th>work</th><th>CPU time, s</th><th>interquartile range, s</th><th>rounds</th>"
    yield "<th>run before on this machine, s</th></tr></thead><tbody>"
    for name, part in last["work"].items():
        earlier = [run for run in runs[:-1] if run["machine"] == last["machine"] and name in run["work"]]
        before = f"{earlier[-1]['work'][name]['median']:.3g}" if earlier else "none"
        cells = (html.escape(name), f"{part['median']:.3g}", f"{part['range']:.2g}", str(part["rounds"]), before)
        yield "<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>"
    yield "</tbody></table>"


def page_part(runs: Sequence[Run]) -> str:
    """Return picture and table as HTML; a sentence where no run is kept."""
    if not runs:
        return "<p>No run of the benchmarks is kept yet.</p>"
    last = runs[-1]
    where = f"{last['machine']['processor']}, {last['machine']['cores']} cores, Python {last['machine']['python']}"
    wall, cpu = (sum(part[key] for part in last["benchmarks"].values()) for key in ("wall", "cpu"))
    sentence = (
        f"The last run is that of {last['time'][:10]} at commit {last['commit']} on {where}:"
        f" {len(last['benchmarks'])} benchmarks in {wall:.0f} s ({cpu:.0f} s of CPU)."
    )
    if ends := [name for name, part in last["benchmarks"].items() if part["targets"] in ("stopped", "failed")]:
        sentence += f" Not measured to their end: {', '.join(ends)}."
    return f"{picture(runs)}<p>{html.escape(sentence)}</p>{''.join(table(runs))}"


class BenchHistory(SphinxDirective):
    """Show the runs that are kept."""

    def run(self) -> list[nodes.Node]:
        """Read the file beside the page and return its picture and table."""
        path = Path(self.env.srcdir) / "bench.jsonl"
        self.env.note_dependency(str(path))
        return [nodes.raw("", page_part(read(path)), format="html")]


def setup(app: Sphinx) -> dict[str, bool]:
    """Add the directive ``bench-history``."""
    app.add_directive("bench-history", BenchHistory)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
