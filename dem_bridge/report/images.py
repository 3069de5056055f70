"""Make the pictures of a page, which the store keeps under the keys of their runs, or under their numbers."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Sequence
from html import escape
from typing import TypeVar

from dem_bridge.backends.base import version_of
from dem_bridge.report.drawer import drawn
from dem_bridge.report.study import FigureData
from dem_bridge.report.svg import svg_of_data
from dem_bridge.runs.code import code_of_all, digest
from dem_bridge.runs.recall import begin_recall
from dem_bridge.runs.store import Store
from dem_bridge.scene.scene import Scene

Svg = TypeVar("Svg", str, str | None)
#: colours of a picture that a dark page replaces, and the names of these colours in style.css
_THEMED = {"#000000": "ink", "#ffffff": "paper", "#0072b2": "blue", "#7f7f7f": "grey", "#c8c8c8": "pale"}


def begin_picture_of_data(data: FigureData, store: Store | None = None) -> Callable[[], str]:
    """Begin to draw a figure unless the store has its picture, and return a function that awaits the SVG."""
    content = hashlib.sha256(data.content()).hexdigest()
    return begin_recalled_picture(store, "figure", [], lambda: drawn(svg_of_data, data), content=content)


def picture_of_data(data: FigureData, store: Store | None = None) -> str:
    """Return the picture of a figure, as SVG."""
    return begin_picture_of_data(data, store)()


def begin_recalled_picture(
    store: Store | None,
    name: str,
    keys: Sequence[str | None],
    begin: Callable[[], Callable[[], Svg]],
    scenes: Sequence[Scene] = (),
    **shown: object,
) -> Callable[[], Svg]:
    """Begin to draw a picture if the runs, the code of the report or a library are new; return what awaits the SVG.

    ``begin`` returns the function that awaits the picture. Otherwise the picture comes from the store.
    """
    drawing = {"code": digest(code_of_all())} | {name: version_of(name) for name in ("matplotlib", "pillow")}
    return begin_recall(store, f"picture {name}", keys, begin, scenes=scenes, drawing=drawing, shown=shown)


def alternative_text(data: FigureData) -> str:
    """Return what a figure shows in words: its title, and for each panel the axes and the names of its lines.

    >>> from dem_bridge.report.study import Panel
    >>> panel = Panel(title="(a) slow", x_label="cylinder", y_label="time (ms)")
    >>> alternative_text(FigureData(id="figure-2", title="Figure 2", caption="", panels=(panel,)))
    'Figure 2. (a) slow: time (ms) against cylinder.'
    """
    parts = []
    for panel in data.panels:
        axes = f"{panel.map.label} over " if panel.map is not None else ""
        axes += f"{panel.y_label or ', '.join(filter(None, panel.rows)) or 'rows as before'} against {panel.x_label}"
        lines = ", ".join(dict.fromkeys(line.label for line in panel.series))
        parts.append(f"{panel.title}: {axes}{f'; {lines}' if lines else ''}.")
    return " ".join([f"{data.title}.", *parts])


def inline(svg: str, name: str, alt: str) -> str:
    """Return a picture as an element of a page: an image with an alternative text, in the colours of the page.

    Ids within the picture begin with ``name``, so that two pictures of a page share none. A picture of several panels
    is followed by these one by one, which a narrow screen shows in its place, below each other.

    >>> inline('<svg viewBox="0 0 1 1"><g id="a" fill="#000000"/></svg>', "b", 'x < "y"')
    '<svg role="img" aria-label="x &lt; &quot;y&quot;" viewBox="0 0 1 1"><g id="b-a" fill="var(--ink)"/></svg>'
    >>> whole = '<svg data-panels="0,0,2,1 2,0,2,1" viewBox="0 0 4 1"><path/></svg>'
    >>> inline(whole, "b", "x").split("</svg>")[1]
    '<svg class="panel" aria-hidden="true" style="--w: 2" viewBox="0 0 2 1"><use href="#b-all"/>'
    """
    body = re.sub(r'\bid="', f'id="{name}-', svg.strip())
    body = re.sub(r'(href="|url\()#', rf"\1#{name}-", body)
    body = re.sub(r"#[0-9a-f]{6}\b", lambda match: _themed(match[0]), body)
    # CSS gives the picture its width: that of the figure on paper, more on a screen
    body = re.sub(r'width="([\d.]+)pt" height="[\d.]+pt"', r'style="--w: \1"', body, count=1)
    panels = re.search(r' data-panels="([^"]*)"', body)
    body = body.replace("<svg", f'<svg role="img" aria-label="{escape(alt)}"', 1)
    if panels is None:
        return body
    body = body.replace(panels[0], ' class="whole"', 1)
    body = re.sub(r"(<svg[^>]*>)(.*)</svg>$", rf'\1<g id="{name}-all">\2</g></svg>', body, count=1, flags=re.DOTALL)
    return body + "".join(_panel(box.split(","), f"{name}-all") for box in panels[1].split(" "))


def _panel(box: Sequence[str], id: str) -> str:
    """Return a part of a picture, which shows the same elements."""
    size = f'style="--w: {box[2]}" viewBox="{" ".join(box)}"'
    return f'<svg class="panel" aria-hidden="true" {size}><use href="#{id}"/></svg>'


def _themed(colour: str) -> str:
    """Return a colour as the page has it."""
    return f"var(--{_THEMED[colour]})" if colour in _THEMED else colour
