"""The files of a study of styles: the matrix as a table, as JSON and as a picture."""

from __future__ import annotations

import io
import json
from pathlib import Path

from dem_bridge.files import write_whole
from dem_bridge.report.figures import styles_matrix
from dem_bridge.studies.styles import StylesStudy


def write_styles(study: StylesStudy, folder: Path) -> None:
    """Write ``styles.csv``, ``styles.json`` and ``styles.png`` into ``folder``, all or none."""
    picture = io.BytesIO()
    styles_matrix(study).savefig(picture, format="png", dpi=150)
    text = json.dumps(study.as_json(), indent=1, allow_nan=False) + "\n"
    write_whole(folder, {"styles.csv": study.as_csv(), "styles.json": text, "styles.png": picture.getvalue()})
