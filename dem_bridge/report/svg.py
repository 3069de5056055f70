"""Turn a figure into the text of an SVG, short and without anything that changes from one drawing to the next.

Pictures are SVG: lines and text are vectors, so that they stay sharp on paper and text is text; only maps are images in
them. matplotlib takes half a second of CPU to import, and is imported when a picture is drawn.
"""

from __future__ import annotations

import base64
import io
import re
from importlib import import_module
from typing import TYPE_CHECKING, Any

from dem_bridge.report.study import FigureData

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: resolution of the maps in a picture, dots per inch
_DOTS_PER_INCH = 110


def svg_of_data(data: FigureData) -> str:
    """Draw a figure, and return it as SVG."""
    from dem_bridge.report.drawing import draw_figure

    return svg_of(draw_figure(data))


def svg_drawn_by(module: str, function: str, *arguments: Any) -> str | None:
    """Return as SVG what a function of a module, which may import matplotlib, draws; None if it draws none."""
    figure: Figure | None = getattr(import_module(module), function)(*arguments)
    return None if figure is None else svg_of(figure)


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
