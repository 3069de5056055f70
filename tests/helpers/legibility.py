"""Check that a figure is legible: no text covers another, none lies beyond the page."""

from __future__ import annotations

from itertools import combinations

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text


def assert_legible(figure: Figure) -> int:
    """Assert that no two texts overlap and all lie on the page; return how many were checked."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    texts = {text for text in figure.findobj(Text) if isinstance(text, Text) and text.get_visible() and text.get_text()}
    texts -= {label for ax in figure.axes for label in beyond(ax)}
    shown = [(text.get_text(), text.get_window_extent(canvas.get_renderer())) for text in texts]
    for name, box in shown:
        assert box.x0 >= 0.0, name
        assert box.y0 >= 0.0, name
        assert box.x1 <= figure.bbox.x1, name
        assert box.y1 <= figure.bbox.y1, name
    for (name, box), (other, place) in combinations(shown, 2):
        # a pixel: boxes are a little larger than their letters
        assert not box.padded(-1.0).overlaps(place.padded(-1.0)), (name, other)
    return len(shown)


def beyond(ax: Axes) -> list[Text]:
    """Return the labels of ticks outside the limits: they exist and are not drawn."""
    labels = []
    for axis in (ax.xaxis, ax.yaxis):
        low, high = sorted(axis.get_view_interval())
        ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
        labels += [label for tick in ticks if not low <= tick.get_loc() <= high for label in (tick.label1, tick.label2)]
    return labels
