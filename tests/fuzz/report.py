"""Fuzz every reader and write the figures to docs/quality.md.

``python -m tests.fuzz.report [COUNT [FIRST [TARGET ...]]]``; the table is written if all targets are fuzzed.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path

from tests.fuzz.harness import NAMES, Figures, fuzz

PAGE = Path(__file__).parents[2] / "docs" / "quality.md"
_BEGIN, _END = "<!-- fuzzing: written by python -m tests.fuzz.report -->", "<!-- end of fuzzing -->"
#: heading of each column, with the outcomes that it counts
_COLUMNS = {
    "refused": ("refused",),
    "accepted": ("accepted",),
    "tracebacks": ("traceback", "died"),
    "messages not of one line": ("message",),
    "hangs": ("hang",),
    "over memory": ("over memory",),
    "files outside": ("outside",),
}


def table(figures: Mapping[str, Figures], date: str) -> str:
    """Return the figures as a table of Markdown."""
    lines = [f"| reader | inputs | {' | '.join(_COLUMNS)} | date |", "|---|" + "---:|" * (len(_COLUMNS) + 1) + "---|"]
    for name, of_target in figures.items():
        counts = [sum(of_target.counts.get(word, 0) for word in words) for words in _COLUMNS.values()]
        lines.append(f"| {name} | {of_target.inputs} | {' | '.join(map(str, counts))} | {date} |")
    return "\n".join(lines)


def main() -> None:
    """Fuzz, print the faults, and write the table if all targets were fuzzed."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 20_000
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 1_000_000
    names = sys.argv[3:] or list(NAMES)
    date, figures = datetime.now(UTC).date().isoformat(), dict[str, Figures]()
    for name in names:
        figures |= (latest := fuzz(count, first, [name]))
        print(table(latest, date).splitlines()[-1], flush=True)
        for fault in latest[name].faults[:20]:
            print(f"{name} {fault}", flush=True)
    if set(names) == set(NAMES):
        text = PAGE.read_text(encoding="utf-8")
        new = f"{_BEGIN}\n{table(figures, date)}\n{_END}"
        PAGE.write_text(re.sub(f"{_BEGIN}.*{_END}", lambda _: new, text, flags=re.DOTALL), encoding="utf-8")
    sys.exit(1 if any(of_target.faults for of_target in figures.values()) else 0)


if __name__ == "__main__":
    main()
