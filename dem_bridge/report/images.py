"""Make the images of a page, which the store keeps under the keys of the runs that they show or under their numbers.

matplotlib takes half a second of CPU to import, and is imported when an image is drawn.
"""

from __future__ import annotations

import base64
import hashlib
import io
from collections.abc import Callable, Sequence
from importlib.metadata import version
from typing import TYPE_CHECKING, TypeVar

from dem_bridge.runs.recall import recall
from dem_bridge.runs.store import Store, code_hash
from dem_bridge.scene import Scene
from dem_bridge.studies.study import FigureData
from dem_bridge.verification.assess import SceneStudy

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Png = TypeVar("Png", bytes, bytes | None)
#: resolution of images, dots per inch
_DPI = 120


def image_of_data(data: FigureData, store: Store | None = None) -> bytes:
    """Return the image of a figure, as PNG."""

    def draw() -> bytes:
        from dem_bridge.report.drawing import draw_figure

        return png_of(draw_figure(data))

    return _recall(store, "figure", [], draw, content=hashlib.sha256(data.content()).hexdigest())


def image_of_runs(name: str, studies: Sequence[SceneStudy], store: Store | None = None) -> bytes | None:
    """Return the image that a function of :mod:`.figures` draws of the runs of scenes; None where it draws none."""

    def draw() -> bytes | None:
        from dem_bridge.report import figures

        figure: Figure | None = getattr(figures, name)(studies)
        return None if figure is None else png_of(figure)

    keys = [result.key for study in studies for result in study.results]
    judged = [
        (
            study.refinement,
            [verdict.as_json() for verdict in study.verdicts],
            [budget.as_json() for budget in study.budgets],
        )
        for study in studies
    ]
    return _recall(store, name, keys, draw, [study.scene for study in studies], judged=judged)


def _recall(
    store: Store | None,
    name: str,
    keys: Sequence[str | None],
    draw: Callable[[], Png],
    scenes: Sequence[Scene] = (),
    **shown: object,
) -> Png:
    """Return an image from the store, or draw it if the runs, the code of the report or a library are new."""
    drawing = {"code": code_hash(), "matplotlib": version("matplotlib"), "pillow": version("pillow")}
    return recall(store, f"image {name}", keys, draw, scenes=scenes, drawing=drawing, shown=shown)


def png_of(figure: Figure) -> bytes:
    """Return a figure as a small PNG image; equal figures have equal bytes."""
    from dem_bridge.report.drawing import fix_layout

    png = io.BytesIO()
    fix_layout(figure).savefig(png, format="png", dpi=_DPI)
    return compress_png(png.getvalue())


def data_uri(png: bytes) -> str:
    """Return an image as a data URI, so that the page is a single file."""
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def compress_png(png: bytes) -> bytes:
    """Return the image with a palette of 256 colours, in about a third of the bytes.

    The palette covers all colours, so that thin lines keep theirs, and is then refined by k-means, without which a map
    has a dozen visible steps. The file has no date and no software, so that equal images have equal bytes.
    """
    from PIL import Image

    small = io.BytesIO()
    colours = Image.open(io.BytesIO(png)).convert("RGB")
    indexed = colours.quantize(256, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE, kmeans=2)
    indexed.save(small, format="png", optimize=True)
    return small.getvalue()
