"""Write the numbers of a figure as CSV."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import replace

from dem_bridge.report.study import FigureData, Map, Panel


def csv_texts(data: FigureData) -> dict[str, str]:
    """Return CSV files by name: all lines in ``<id>.csv`` in the long layout, each map as a matrix in a file.

    The file of a map is ``<id>-<letter>.csv``; its first row has x and its first column y. A map of 200 by 200 values
    has 0.25 MB as a matrix and 1.5 MB in the long layout. Small multiples have no files, because they only give an
    overview of runs.

    >>> import numpy as np
    >>> data = Map(label="velocity (m/s)", x=np.array([1.0, 2.0]), y=np.array([0.5]), values=np.array([[0.1, 0.25]]))
    >>> panel = Panel(title="(a) slow", x_label="cylinder", y_label="time (ms)", map=data)
    >>> texts = csv_texts(FigureData(id="figure-2", title="", caption="", panels=(panel,)))
    >>> print(texts["figure-2-a.csv"], end="")
    velocity (m/s): time (ms) by cylinder,1.0,2.0
    0.5,0.1,0.25
    """
    texts: dict[str, str] = {}
    if data.small:
        return texts
    if any(panel.series for panel in data.panels):
        only_lines = tuple(replace(panel, map=None) for panel in data.panels)
        texts[f"{data.id}.csv"] = replace(data, panels=only_lines).as_csv()
    for place, panel in enumerate(data.panels, start=1):
        if panel.map is None:
            continue
        letter = re.match(r"\((\w+)\)", panel.title)
        name = f"{data.id}-{letter[1] if letter else place}.csv"
        if name in texts:
            raise ValueError(f"{data.id}: two maps have the file name {name}; give each panel its own letter")
        texts[name] = _matrix(panel, panel.map)
    return texts


def _matrix(panel: Panel, data: Map) -> str:
    """Return a map as CSV with x in the first row and y in the first column."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([f"{data.label}: {panel.y_label} by {panel.x_label}", *data.x.tolist()])
    writer.writerows([y, *row] for y, row in zip(data.y.tolist(), data.values.tolist(), strict=True))
    return text.getvalue()
