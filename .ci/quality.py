"""Write measured rows into the tables of docs/quality.md.

A table stands between ``<!-- NAME: ... -->`` and ``<!-- end of NAME -->``; a row is replaced by its first cell.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

PAGE = Path(__file__).resolve().parent.parent / "docs" / "quality.md"


def with_rows(page: str, name: str, rows: Sequence[Sequence[str]]) -> str:
    """Return the page with these rows in the table of that name, sorted by their numbers.

    >>> page = "<!-- counts: by make -->\\n| n | m |\\n|---|---|\\n| 9 | a |\\n| 10 | b |\\n<!-- end of counts -->"
    >>> print(with_rows(page, "counts", [("10", "c"), ("8", "d")]))
    <!-- counts: by make -->
    | n | m |
    |---|---|
    | 8 | d |
    | 9 | a |
    | 10 | c |
    <!-- end of counts -->
    """
    pattern = rf"(<!-- {name}: .*?-->\n\|.*\n\|[-:|]+\|\n)(.*?)(<!-- end of {name} -->)"
    block = re.search(pattern, page, re.DOTALL)
    if block is None:
        raise SystemExit(f"{PAGE} has no table {name!r}")
    lines = {line.split("|")[1].strip(): line for line in block[2].splitlines()}
    lines |= {row[0]: f"| {' | '.join(row)} |" for row in rows}
    text = "".join(f"{lines[key]}\n" for key in sorted(lines, key=_natural))
    return page[: block.start()] + block[1] + text + block[3] + page[block.end() :]


def write_rows(name: str, rows: Sequence[Sequence[str]]) -> None:
    """Write rows into a table of the page."""
    PAGE.write_text(with_rows(PAGE.read_text(encoding="utf-8"), name, rows), encoding="utf-8")


def _natural(text: str) -> tuple[list[int], str]:
    return [int(digits) for digits in re.findall(r"\d+", text)], text
