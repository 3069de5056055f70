"""Whether a figure can be read: no text on another, none beyond the page."""

from __future__ import annotations

from itertools import combinations

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text


def assert_legible(figure: Figure) -> int:
    """The number of texts that were looked at."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    texts = {one for one in figure.findobj(Text) if isinstance(one, Text) and one.get_visible() and one.get_text()}
    texts -= {label for ax in figure.axes for label in beyond(ax)}
    shown = [(one.get_text(), one.get_window_extent(canvas.get_renderer())) for one in texts]
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
    """Labels of ticks outside the limits: they exist and are not drawn."""
    found = []
    for axis in (ax.xaxis, ax.yaxis):
        low, high = sorted(axis.get_view_interval())
        ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
        found += [label for tick in ticks if not low <= tick.get_loc() <= high for label in (tick.label1, tick.label2)]
    return found
