"""Make the pictures of a page, which the store keeps under the keys of the runs that they show or under their numbers.

Pictures are SVG: lines and text are vectors, so that they stay sharp on paper and text is text; only maps are images in
them. matplotlib takes half a second of CPU to import, and is imported when a picture is drawn.
"""

from __future__ import annotations

import base64
import hashlib
import io
import re
from collections.abc import Callable, Sequence
from functools import cache
from html import escape
from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, TypeVar

from dem_bridge.foundation.compiled import started
from dem_bridge.report.study import FigureData
from dem_bridge.runs.code import code_of_all, digest
from dem_bridge.runs.recall import recall
from dem_bridge.runs.store import Store
from dem_bridge.scene.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Svg = TypeVar("Svg", str, str | None)
#: resolution of the maps in a picture, dots per inch
_DOTS_PER_INCH = 110
#: colours of a picture that a dark page replaces, and the names of these colours in style.css
_THEMED = {"#000000": "ink", "#ffffff": "paper", "#0072b2": "blue", "#7f7f7f": "grey", "#c8c8c8": "pale"}


@cache
def prepare_drawing() -> None:
    """Import matplotlib in a thread, beside runs that are made in other processes and in kernels."""
    started(lambda: [import_module(f"matplotlib.{name}") for name in ("figure", "backends.backend_svg")])


def picture_of_data(data: FigureData, store: Store | None = None) -> str:
    """Return the picture of a figure, as SVG."""

    def draw() -> str:
        from dem_bridge.report.drawing import draw_figure

        return svg_of(draw_figure(data))

    return recalled_picture(store, "figure", [], draw, content=hashlib.sha256(data.content()).hexdigest())


def recalled_picture(
    store: Store | None,
    name: str,
    keys: Sequence[str | None],
    draw: Callable[[], Svg],
    scenes: Sequence[Scene] = (),
    **shown: object,
) -> Svg:
    """Return a picture from the store, or draw it if the runs, the code of the report or a library are new."""
    drawing = {"code": digest(code_of_all()), "matplotlib": version("matplotlib"), "pillow": version("pillow")}
    return recall(store, f"picture {name}", keys, draw, scenes=scenes, drawing=drawing, shown=shown)


def svg_of(figure: Figure) -> str:
    """Return a figure as SVG with text as text; equal figures have equal texts."""
    from matplotlib import rc_context

    from dem_bridge.report.drawing import fix_layout, panel_boxes

    text = io.StringIO()
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "dem_bridge", "path.simplify_threshold": 0.3}):
        metadata = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        boxes = panel_boxes(fix_layout(figure))
        figure.savefig(text, format="svg", dpi=_DOTS_PER_INCH, transparent=True, metadata=metadata)
    svg = text.getvalue()
    svg = _shortened(svg[svg.index("<svg") :])
    places = " ".join(",".join(f"{value:.0f}" for value in box) for box in boxes)
    return svg.replace("<svg", f'<svg data-panels="{places}"', 1) if places else svg


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


def _shortened(svg: str) -> str:
    """Return an SVG of matplotlib without what a page does not need: comments, names of fonts, ids of groups."""
    svg = re.sub(r"<!--.*?-->\n?|<metadata>.*?</metadata>\n?", "", svg, flags=re.DOTALL)
    svg = re.sub(r'<g id="[^"]*">', "<g>", svg)
    svg = re.sub(r' transform="rotate\(-?0 [^"]*"', "", svg)
    svg = re.sub(r" ?font-family: [^;\"]*;?", "", svg)  # the page has a font
    svg = re.sub(r"data:image/png;base64,([^\"]*)", lambda match: data_uri(_compressed(match[1])), svg)
    svg = re.sub(r"<g([^>]*)>\s*((?:<use [^>]*/>\s*)+)</g>", _of_group, svg)
    # lines of one style that follow each other, such as bars of uncertainty, are one path
    svg = re.sub(r'(?:<path d="[^"]*"( [^>]*fill: none[^>]*/>)\s*)(?:<path d="[^"]*"\1\s*)+', _one_path, svg)
    svg = re.sub(r' d="[^"]*"', lambda path: re.sub(r"\s*\n\s*| (?=[LCQMz])", "", path[0]), svg)
    svg = re.sub(r"\n\s*", "\n", svg)
    # a tenth of a point, and not in texts
    return re.sub(r"<[^>]*>", lambda tag: re.sub(r"(\d\.\d)\d+", r"\1", tag[0]), svg)


def _of_group(match: re.Match[str]) -> str:
    """Return a group of markers with the style of all of them in one place, if it is the same."""
    styles = set(re.findall(r' style="[^"]*"', match[2]))
    if len(styles) != 1:
        return match[0]
    style = styles.pop()
    return f"<g{match[1]}{style}>\n{match[2].replace(style, '')}</g>"


def _one_path(match: re.Match[str]) -> str:
    """Return lines of one style as one path."""
    lines = " ".join(re.findall(r' d="([^"]*)"', match[0]))
    return f'<path d="{lines}"{match[1]}\n'


def _compressed(base: str) -> bytes:
    """Return an image of an SVG with a palette."""
    return compress_png(base64.b64decode(base))


def data_uri(png: bytes) -> str:
    """Return an image as a data URI, so that the page is a single file."""
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def compress_png(png: bytes) -> bytes:
    """Return the image with a palette of 256 colours, in about a third of the bytes; transparent parts are white.

    The palette covers all colours, so that thin lines keep theirs, and is then refined by k-means, without which a map
    has a dozen visible steps. The file has no date and no software, so that equal images have equal bytes.
    """
    from PIL import Image

    small = io.BytesIO()
    image = Image.open(io.BytesIO(png)).convert("RGBA")
    colours = Image.alpha_composite(Image.new("RGBA", image.size, "white"), image).convert("RGB")
    indexed = colours.quantize(256, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE, kmeans=2)
    indexed.save(small, format="png", optimize=True)
    return small.getvalue()
