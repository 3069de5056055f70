"""Read Markdown and LaTeX tables by the rules of Markdown, LaTeX, booktabs and siunitx and nothing of ours."""

from __future__ import annotations

import re
from dataclasses import dataclass

#: a number in an S column of siunitx
NUMBER = re.compile(r"-?\d+(\.\d+)?(e-?\d+)?")
#: signs that mean something to LaTeX unless a backslash stands before them
SPECIAL = re.compile(r"(?<!\\)[&%$#_^~]")


@dataclass(frozen=True)
class Tabular:
    """Hold the parts of a ``tabular``."""

    types: list[str]
    """Of columns: "l", or "S[table-format=...]"."""
    head: list[str]
    rows: list[list[str]]


def read_tex(text: str) -> Tabular:
    """Return the parts of a ``tabular``; AssertionError where LaTeX, booktabs or siunitx would not take it as meant."""
    lines = [line for line in text.splitlines() if not line.startswith("%")]
    assert all("%" not in line.replace(r"\%", "") for line in lines)
    match = re.fullmatch(
        r"\\begin{tabular}{(?P<types>.*?)\n}\n\\toprule\n(?P<head>.*)\n\\midrule\n(?P<rows>.*\n)?\\bottomrule\n\\end{tabular}",
        "\n".join(lines),
        re.DOTALL,
    )
    assert match is not None, text
    types = re.findall(r"l|S\[table-format=-?\d+\.\d+(?:e-?\d+)?\]", match["types"])
    assert re.sub(r"\s", "", match["types"]) == "".join(types)
    head, rows = _cells(match["head"]), [_cells(line) for line in (match["rows"] or "").splitlines()]
    assert all(len(row) == len(types) for row in (head, *rows)), "as many cells as columns"
    for row, is_head in ((head, True), *((row, False) for row in rows)):
        for cell, kind in zip(row, types, strict=True):
            _check_cell(cell, kind, is_head)
    return Tabular(types, head, rows)


def _cells(line: str) -> list[str]:
    assert line.endswith(r" \\"), line
    return [cell.strip() for cell in re.split(r"(?<!\\)&", line[:-3])]


def _check_cell(cell: str, kind: str, is_head: bool) -> None:
    depth = 0
    for sign in re.sub(r"\\[{}]", "", cell):
        depth += {"{": 1, "}": -1}.get(sign, 0)
        assert depth >= 0, cell
    assert depth == 0, cell
    maths = re.sub(r"\$[^$]*\$", "", cell)
    assert not SPECIAL.search(maths), cell
    for unit in re.findall(r"\\si(.*?)(?=\\si|$)", cell):
        assert re.match(r"{(\\[a-z]+({[\d.]+})?)+}", unit), f"no unit of siunitx in {cell}"
    if kind == "l":
        return
    if is_head or not NUMBER.fullmatch(cell):
        # words in a column of numbers stand in braces
        assert re.fullmatch(r"{.*}", cell), cell
        assert not is_head or len(cell) > 2
        return
    room = re.fullmatch(r"S\[table-format=(-?)(\d+)\.(\d+)(?:e(-?)(\d+))?\]", kind)
    number = re.fullmatch(r"(-?)(\d+)(?:\.(\d+))?(?:e(-?)(\d+))?", cell)
    assert room is not None
    assert number is not None
    minus, whole, decimals, below, power = number.groups(default="")
    assert len(minus) <= len(room[1])
    assert len(whole) <= int(room[2])
    assert len(decimals) <= int(room[3])
    assert len(below) <= len(room[4] or "")
    assert len(power) <= int(room[5] or 0)


def read_markdown(text: str) -> tuple[list[str], list[list[str]]]:
    """Return headings and rows of the one pipe table in a text."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    cut = [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines]
    head, rule, *rows = [[re.sub(r"\\(.)", r"\1", cell) for cell in row] for row in cut]
    assert all(re.fullmatch(r"-{3,}:?", cell) for cell in rule)
    assert all(len(row) == len(head) for row in (rule, *rows))
    return head, rows
