"""Measure the size of the package: ``python .ci/house.py [CHECKOUT]``.

It prints the number of modules, the lines of code without docstrings, comments and blank lines, the statements, and the
lines of docstrings. It then counts the calls of functions of the package from ``dem-bridge verify decelerating-40`` to
its first run.
"""

from __future__ import annotations

import ast
import io
import subprocess
import sys
import tokenize
from pathlib import Path

#: counts calls of functions of the package until the first backend is asked for a run, and ends there
_COUNT_CALLS = """
import os, sys
root = os.path.join(os.getcwd(), "dem_bridge") + os.sep
calls = 0

def profile(frame, event, argument):
    global calls
    if event != "call" or not frame.f_code.co_filename.startswith(root):
        return
    name = frame.f_code.co_name
    if name == "<module>":
        return
    calls += 1
    # a twin that is solved for the choice of a step is a run too
    if name in ("run", "solve") and os.sep + "backends" + os.sep in frame.f_code.co_filename:
        sys.setprofile(None)
        print(calls, frame.f_code.co_filename[len(root):])
        sys.stdout.flush()
        os._exit(0)

import numba  # otherwise the kernel of the prescan is interpreted, and its calls are counted
from dem_bridge.cli import command
sys.argv = ["dem-bridge", "verify", "decelerating-40", "-j", "1"]
sys.setprofile(profile)
command()
"""
_NO_CODE = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}


def docstring_lines(tree: ast.Module) -> set[int]:
    """Return the numbers of all lines that belong to docstrings, those under attributes included."""
    lines: set[int] = set()
    for node in ast.walk(tree):
        for statement in getattr(node, "body", ()) if not isinstance(node, ast.Lambda | ast.IfExp) else ():
            value = statement.value if isinstance(statement, ast.Expr) else None
            if isinstance(value, ast.Constant) and isinstance(value.value, str):
                assert statement.end_lineno is not None
                lines |= set(range(statement.lineno, statement.end_lineno + 1))
    return lines


def count(file: Path) -> tuple[int, int, int]:
    """Return the lines of code, the statements and the lines of docstrings of a module."""
    text = file.read_text(encoding="utf-8")
    tree = ast.parse(text)
    docstrings = docstring_lines(tree)
    statements = sum(
        isinstance(node, ast.stmt) and not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant))
        for node in ast.walk(tree)
    )
    code: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in _NO_CODE:
            code |= set(range(token.start[0], token.end[0] + 1))
    return len(code - docstrings), statements, len(docstrings)


def main(checkout: Path) -> None:
    """Print the figures of a checkout."""
    counts = [count(file) for file in sorted((checkout / "dem_bridge").rglob("*.py"))]
    print(f"modules             {len(counts)}")
    for name, column in zip(
        ("lines of code", "statements", "lines of docstrings"), zip(*counts, strict=True), strict=True
    ):
        print(f"{name:19} {sum(column)}")
    environment = {"PATH": "", "PYTHONPATH": str(checkout), "DEM_BRIDGE_STORE": ""}
    command = [sys.executable, "-c", _COUNT_CALLS]
    done = subprocess.run(command, cwd=checkout, env=environment, capture_output=True, text=True, check=True)
    print(f"calls to first run  {done.stdout.strip()}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else ".").resolve())
