"""Write a study as files: one self-contained HTML page, tables as CSV, figures as SVG and CSV, and everything as JSON.

All files are written, or none.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from dem_bridge.foundation.files import check_report_folder, write_whole
from dem_bridge.report.cells import SEVERITY
from dem_bridge.report.figure_csv import csv_texts
from dem_bridge.report.images import picture_of_data
from dem_bridge.report.pages import fill
from dem_bridge.report.study import Study
from dem_bridge.runs.store import Store


def write_study(study: Study, folder: Path, store: Store | None = None) -> tuple[str, ...]:
    """Write the files of a study into ``folder`` (made if need be), all or none; return the names, the page first."""
    files = study.page_files(store)
    check_report_folder(folder)
    write_whole(folder, files)
    return tuple(files)


def study_files(
    study: Study,
    store: Store | None = None,
    *,
    template: tuple[str, str] = ("study.html.j2", __package__),
    **shown: Any,
) -> dict[str, str | bytes]:
    """Return the files of a study by name.

    These are ``index.html``, the JSON, ``tables/ID.csv``, ``figures/ID.svg``, ``figures/ID.csv`` and the study's own
    ``files``. Pictures are kept in ``store``. ``template``: that of the page, and the package that has it; ``shown``:
    what it shows beside the parts that every study has.
    """
    figures: dict[str, dict[str, str | bytes]] = {
        figure.id: {
            f"figures/{figure.id}.svg": picture_of_data(figure, store),
            **{f"figures/{name}": text for name, text in csv_texts(figure).items()},
        }
        for figure in study.figures
    }
    failures = [verdict for verdict in study.verdicts if verdict.outcome in SEVERITY[:3]]
    files: dict[str, str | bytes] = {
        "index.html": fill(*template, study=study, files=figures, failures=failures, **shown),
        study.record_name: json.dumps(study.as_json(), indent=1, ensure_ascii=False, allow_nan=False) + "\n",
    }
    parts: list[dict[str, str | bytes]] = [{name: content()} for name, content in study.files.items()]
    parts += [{f"tables/{table.id}.csv": table.as_csv()} for table in study.tables]
    for part in (*parts, *figures.values()):
        if twice := set(part) & set(files):
            raise ValueError(f"study {study.id}: two parts have the file name {min(twice)}; allowed: distinct names")
        files |= part
    return files
