"""The scatter of contact angles as files: what was found as JSON, the figure with its numbers as CSV."""

from __future__ import annotations

import json
from pathlib import Path

from dem_bridge.files import write_whole
from dem_bridge.report.drawing import png
from dem_bridge.studies.scatter import ScatterStudy, figure


def write_scatter(found: ScatterStudy, folder: Path) -> None:
    """Write ``scatter.json``, ``scatter.csv`` and ``scatter.png`` into ``folder``, all or none."""
    shown = figure(found)
    write_whole(
        folder,
        {
            "scatter.json": json.dumps(found.as_json(), indent=1, allow_nan=False) + "\n",
            "scatter.csv": shown.as_csv(),
            "scatter.png": png(shown),
        },
    )
