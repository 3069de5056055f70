"""Write a study as files: one self-contained HTML page, tables as CSV, figures as SVG and CSV, and everything as JSON.

All files are written, or none.
"""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from dem_bridge.foundation.files import check_report_folder, write_whole
from dem_bridge.foundation.notebook import picture
from dem_bridge.report.drawing import draw_figure
from dem_bridge.report.images import picture_of_data
from dem_bridge.report.pages import SEVERITY, fill, outcomes_of
from dem_bridge.report.study import FigureData, Map, Panel, Study
from dem_bridge.runs.store import Store
from dem_bridge.version import __version__

_MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")


def write_study(study: Study, folder: Path, store: Store | None = None) -> tuple[str, ...]:
    """Write the files of a study into ``folder`` (made if need be), all or none; return the names, the page first."""
    files = study.page_files(store)
    check_report_folder(folder)
    write_whole(folder, files)
    return tuple(files)


def about(provenance: Mapping[str, Any]) -> tuple[str, ...]:
    """Return version of dem_bridge, release of LAMMPS (if it ran) and date, as the head of a page names them.

    >>> about({"lammps": {"version": 20250722}, "date": "2026-11-23 20:34 UTC"})[1:]
    ('LAMMPS 22 Jul 2025', '2026-11-23')
    """
    release = provenance.get("lammps")
    release = release.get("version") if isinstance(release, Mapping) else release
    named = re.fullmatch(r"(\d{4})(\d\d)(\d\d)", str(release))
    lammps = f"{int(named[3])} {_MONTHS[int(named[2]) - 1]} {named[1]}" if named else release
    day = str(provenance.get("date") or datetime.now(UTC).date())[:10]
    return (f"dem_bridge {__version__}", *([f"LAMMPS {lammps}"] if lammps else []), day)


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
    shown = {"about": about(study.provenance), "outcomes": outcomes_of(study.verdicts)} | shown
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


def picture_of_study(study: Study) -> str:
    """Return the HTML of the first figure of a study for a notebook; empty where it has none."""
    if not study.figures:
        return ""
    figure = study.figures[0]
    return picture(draw_figure(figure), f"{figure.title}. {figure.caption}")
