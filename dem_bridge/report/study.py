"""Write a study as files: a page, tables as CSV, figures as PNG and CSV, and everything as JSON."""

from __future__ import annotations

import json
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from dem_bridge.files import write_whole
from dem_bridge.report.cells import number, numeric, sortable
from dem_bridge.report.drawing import csv_texts, png
from dem_bridge.studies.study import Study


def write_study(study: Study, folder: Path) -> tuple[str, ...]:
    """Write the files of a study into ``folder``, all or none, and return their names, the page first."""
    files = study_files(study)
    write_whole(folder, files)
    return tuple(files)


def study_files(study: Study) -> dict[str, str | bytes]:
    """Return the contents of the files of a study by name.

    The files are ``index.html``, ``<study>.json``, ``<table>.csv``, each figure as ``.png`` and ``.csv``, and the
    further ``files`` of the study.
    """
    numbers = {figure.id: csv_texts(figure) for figure in study.figures}
    files: dict[str, str | bytes] = {
        "index.html": _page(study, {id: tuple(texts) for id, texts in numbers.items()}),
        f"{study.id}.json": json.dumps(study.as_json(), indent=1, ensure_ascii=False, allow_nan=False) + "\n",
    }
    parts: list[dict[str, str | bytes]] = [{name: content()} for name, content in study.files.items()]
    parts += [{f"{table.id}.csv": table.as_csv()} for table in study.tables]
    parts += [{f"{figure.id}.png": png(figure), **numbers[figure.id]} for figure in study.figures]
    for part in parts:
        if twice := set(part) & set(files):
            raise ValueError(f"study {study.id}: two parts have the file name {min(twice)}; allowed: distinct names")
        files |= part
    return files


def _page(study: Study, numbers: dict[str, tuple[str, ...]]) -> str:
    """Return the page of a study; ``numbers`` are the CSV files of each figure."""
    environment = Environment(
        loader=PackageLoader("dem_bridge.report", "templates"),
        undefined=StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": number, "numeric": numeric, "sortable": sortable}
    return environment.get_template("study.html.j2").render(study=study, numbers=numbers)
