"""Write into docs/quality.md which statements and branches of the package the tests run: ``make coverage``.

It needs the data of ``coverage run`` and ``coverage combine``. It also lists the assertions of the tests that no test
reached: an assertion in a loop over nothing cannot fail. Exit codes: 0, and 1 where there are such assertions.
"""

from __future__ import annotations

import ast
import datetime
import json
import subprocess
import sys
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from pathlib import PurePosixPath
from typing import Any

from quality import PAGE, write_rows

ROOT = PAGE.parent.parent
#: statements, those that ran, branches, those that were taken
COUNTS = ("num_statements", "covered_lines", "num_branches", "covered_branches")
WHOLE = "whole package"


def rows(files: Mapping[str, Any], date: str) -> list[tuple[str, ...]]:
    """Return the rows of the table, from the ``files`` of coverage's report in JSON.

    >>> part = {"summary": dict(num_statements=4, covered_lines=3, num_branches=2, covered_branches=1)}
    >>> for row in rows({"p/a/b.py": part, "p/c.py": part, "tests/d.py": part}, "today"):
    ...     print(*row, sep=" | ")
    a | 4 | 75.0 % | 2 | 50.0 % | today
    modules | 4 | 75.0 % | 2 | 50.0 % | today
    whole package | 8 | 75.0 % | 4 | 50.0 % | today
    """
    counts: dict[str, Counter[str]] = {}
    for name, file in files.items():
        top, *between = PurePosixPath(name).parent.parts
        if top != "tests":
            for part in (between[0] if between else "modules", WHOLE):
                counts.setdefault(part, Counter()).update({count: file["summary"][count] for count in COUNTS})
    return [(part, *_cells(counts[part]), date) for part in sorted(counts)]


def _cells(count: Mapping[str, int]) -> Iterator[str]:
    for total, covered in (COUNTS[:2], COUNTS[2:]):
        yield str(count[total])
        yield f"{100.0 * count[covered] / count[total]:.1f} %" if count[total] else "-"


def unreached(source: str, missing: Collection[int]) -> list[int]:
    """Return the lines of assertions that did not run, in tests that came to their last statement.

    >>> unreached("def test_a():\\n    for x in []:\\n        assert x\\n    assert 1\\n", [3])
    [3]
    """
    tests = (node for node in ast.parse(source).body if isinstance(node, ast.FunctionDef))
    ended = [test for test in tests if test.name.startswith("test_") and test.body[-1].lineno not in missing]
    return [
        node.lineno
        for test in ended
        for node in ast.walk(test)
        if isinstance(node, ast.Assert) and node.lineno in missing
    ]


def main() -> int:
    words = [sys.executable, "-m", "coverage", "json", "-q", "-o", "-"]
    files = json.loads(subprocess.run(words, cwd=ROOT, stdout=subprocess.PIPE, check=True).stdout)["files"]
    table = rows(files, datetime.date.today().isoformat())
    write_rows("coverage", table)
    print(*("  ".join(row) for row in table), sep="\n")
    idle = [
        f"{name}:{line}: this assertion never ran"
        for name, file in files.items()
        if name.startswith("tests/")
        for line in unreached((ROOT / name).read_text(encoding="utf-8"), file["missing_lines"])
    ]
    print(*idle, sep="\n")
    return int(bool(idle))


if __name__ == "__main__":
    sys.exit(main())
