"""A study as files: a page, its tables as CSV, its figures as PNG with their numbers as CSV, and all of it as JSON."""

from __future__ import annotations

import json
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from dem_bridge.files import write_whole
from dem_bridge.report.cells import number, numeric, sortable
from dem_bridge.report.drawing import csv_texts, png
from dem_bridge.studies.study import Study


def write_study(found: Study, folder: Path) -> tuple[str, ...]:
    """Write :func:`study_files` into ``folder`` (made if need be), all or none; the names, the page first."""
    files = study_files(found)
    write_whole(folder, files)
    return tuple(files)


def study_files(found: Study) -> dict[str, str | bytes]:
    """Name -> content: ``index.html``, ``<study>.json``, ``<table>.csv``, each figure as ``.png`` and ``.csv``, and the
    study's own ``files``."""
    numbers = {one.id: csv_texts(one) for one in found.figures}
    files: dict[str, str | bytes] = {
        "index.html": _page(found, {id: tuple(texts) for id, texts in numbers.items()}),
        f"{found.id}.json": json.dumps(found.as_json(), indent=1, ensure_ascii=False, allow_nan=False) + "\n",
    }
    parts: list[dict[str, str | bytes]] = [{name: content()} for name, content in found.files.items()]
    parts += [{f"{one.id}.csv": one.as_csv()} for one in found.tables]
    parts += [{f"{one.id}.png": png(one), **numbers[one.id]} for one in found.figures]
    for part in parts:
        if twice := set(part) & set(files):
            raise ValueError(f"study {found.id}: two of its parts would be written to {min(twice)}")
        files |= part
    return files


def _page(found: Study, numbers: dict[str, tuple[str, ...]]) -> str:
    environment = Environment(
        loader=PackageLoader("dem_bridge.report", "templates"),
        undefined=StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": number, "numeric": numeric, "sortable": sortable}
    return environment.get_template("study.html.j2").render(found=found, numbers=numbers)
