"""Show notebooks as pages: each is executed while the site is built, and an error in a cell ends the build.

A notebook is read as JSON, and its cells are executed in one namespace of this process, in an empty folder. The last
A notebook is read as JSON; its cells are executed in one namespace of this process, in an empty folder. The last
needed, and outputs that a file may hold are not shown.
"""

from __future__ import annotations

import ast
import contextlib
import io
import json
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from docutils.parsers import Parser
from myst_parser.parsers.sphinx_ import MystParser
from sphinx.application import Sphinx

#: fence of code and of HTML, which nothing within them has
_FENCE = "`" * 6


def page_of(notebook: Mapping[str, Any], name: str) -> str:
    r"""Return a notebook, executed, as Markdown.

    Examples
    --------
    >>> cells = [{"cell_type": "markdown", "source": "# One"}, {"cell_type": "code", "source": ["x = 1\n", "x + 1"]}]
    >>> print(page_of({"cells": cells}, "small.ipynb"))
    # One
    <BLANKLINE>
    ``````python
    x = 1
    x + 1
    ``````
    <BLANKLINE>
    ``````text
    2
    ``````
    """
    space: dict[str, Any] = {"__name__": "__main__"}
    parts: list[str] = []
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for number, cell in enumerate(notebook["cells"], start=1):
            text = "".join(cell["source"])
            if cell["cell_type"] == "markdown":
                parts.append(text)
            elif cell["cell_type"] == "code":
                parts.append(_fenced("python", text))
                parts += _outputs(text, space, f"{name}, cell {number}")
    return "\n\n".join(parts)


def _outputs(text: str, space: dict[str, Any], where: str) -> Iterator[str]:
    """Execute a cell, and yield what it prints and the value of its last expression."""
    tree, printed, value = ast.parse(text), io.StringIO(), None
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, where, "exec"), space)
        if last is not None:
            value = eval(compile(ast.Expression(last.value), where, "eval"), space)
    if printed.getvalue():
        yield _fenced("text", printed.getvalue().rstrip("\n"))
    if value is not None and hasattr(value, "_repr_html_"):
        html = value._repr_html_().replace("\n", " ")
        yield _fenced("{raw} html", f'<div class="notebook-output">{html}</div>')
    elif value is not None and not text.rstrip().endswith(";"):
        yield _fenced("text", str(value))


def _fenced(language: str, text: str) -> str:
    """Return a block of code."""
    return f"{_FENCE}{language}\n{text}\n{_FENCE}"


class NotebookParser(MystParser):  # type: ignore[misc]
    """Parse a notebook as the Markdown that it is when it has been executed."""

    supported = ("notebook",)

    def parse(self, inputstring: str, document: Any) -> None:
        """Execute the notebook and parse the page."""
        super().parse(page_of(json.loads(inputstring), Path(document["source"]).name), document)


def setup(app: Sphinx) -> dict[str, bool]:
    """Add the parser for files that end in .ipynb."""
    assert issubclass(NotebookParser, Parser)
    app.add_source_suffix(".ipynb", "notebook")
    app.add_source_parser(NotebookParser)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
