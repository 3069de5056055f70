"""Write a study as files: one self-contained HTML page, tables as CSV, figures as SVG and CSV, and everything as JSON.

All files are written, or none.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from markupsafe import Markup

from dem_bridge.backends.base import BACKENDS, ENGINE_BACKENDS
from dem_bridge.files import check_report_folder, write_whole
from dem_bridge.notebook import scene_sketch
from dem_bridge.report import cells, crate
from dem_bridge.report.cells import KINDS, SEVERITY
from dem_bridge.report.figure_csv import csv_texts
from dem_bridge.report.images import picture_of_data, picture_of_runs
from dem_bridge.report.pages import fill
from dem_bridge.runs.recall import recall
from dem_bridge.runs.store import Store
from dem_bridge.studies.independence import ANSWERS_THROUGH, matrix
from dem_bridge.studies.scope import scope
from dem_bridge.studies.study import Study
from dem_bridge.studies.verification import Verification
from dem_bridge.verification.roles import BLANES_MOAN, POSITIONAL, REFERENCE, SCIPY, THEORY, TWIN
from dem_bridge.verification.verdict import Outcome

NAMES = {
    **dict.fromkeys(ENGINE_BACKENDS, "LAMMPS"),
    TWIN: "twin",
    POSITIONAL: "twin in positions",
    REFERENCE: "reference",
    SCIPY: "scipy",
    BLANES_MOAN: "Blanes-Moan",
    THEORY: "BCA",
}
#: tables that the page of a verification shows in another form
_SHOWN_OTHERWISE = ("claims", "verdicts")


def write_study(study: Study, folder: Path, store: Store | None = None) -> tuple[str, ...]:
    """Write :func:`study_files` into ``folder`` (made if need be), all or none; return the names, the page first."""
    files = study_files(study, store)
    check_report_folder(folder)
    write_whole(folder, files)
    return tuple(files)


def study_files(study: Study, store: Store | None = None) -> dict[str, str | bytes]:
    """Return the files of a study by name.

    These are ``index.html``, the JSON, ``tables/ID.csv``, ``figures/ID.svg``, ``figures/ID.csv`` and the study's own
    ``files``; for the paper also the RO-Crate. Pictures are kept in ``store``.
    """
    figures: dict[str, dict[str, str | bytes]] = {
        figure.id: {
            f"figures/{figure.id}.svg": picture_of_data(figure, store),
            **{f"figures/{name}": text for name, text in csv_texts(figure).items()},
        }
        for figure in study.figures
    }
    files: dict[str, str | bytes] = {
        "index.html": _page(study, figures, store),
        study.record_name: json.dumps(study.as_json(), indent=1, ensure_ascii=False, allow_nan=False) + "\n",
    }
    parts: list[dict[str, str | bytes]] = [{name: content()} for name, content in study.files.items()]
    parts += [{f"tables/{table.id}.csv": table.as_csv()} for table in study.tables]
    for part in (*parts, *figures.values()):
        if twice := set(part) & set(files):
            raise ValueError(f"study {study.id}: two parts have the file name {min(twice)}; allowed: distinct names")
        files |= part
    if isinstance(study, Verification) and study.claims:
        files[crate.NAME] = crate.crate(study, files)
    return files


def _page(study: Study, figures: Mapping[str, Mapping[str, str | bytes]], store: Store | None) -> str:
    """Return the page as text. ``figures``: the files of each figure, its picture first."""
    template, more = "study.html.j2", {}
    if isinstance(study, Verification):
        template, more = "verification.html.j2", _of_verification(study, store)
    return fill(
        template,
        study=study,
        files=figures,
        picture_of=partial(picture_of_runs, store=store),
        failures=[verdict for verdict in study.verdicts if verdict.outcome in SEVERITY[:3]],
        **more,
    )


def _of_verification(study: Verification, store: Store | None) -> dict[str, Any]:
    """Return what the page of a verification shows beside the parts that every study has."""
    counts = Counter(verdict.outcome for verdict in study.verdicts)
    # scenes of the paper without refinement levels have no figures of their own
    with_figures = [
        chain
        for chain in study.studies
        if not study.claims or any(len(steps) > 1 for steps, _ in chain.refinement.values())
    ]
    return {
        "paper": bool(study.claims),
        "scope": scope(study),
        "sketch": lambda chain: Markup(scene_sketch(chain.scene)),
        "tables": [table for table in study.tables if table.id not in _SHOWN_OTHERWISE],
        "counts": [(outcome, counts[outcome]) for outcome in Outcome if counts[outcome]],
        "kinds": KINDS,
        "valued": cells.valued(study.claims),
        "with_figures": with_figures,
        "with_theory": lambda pair: any(chain.run(THEORY) is not None for chain in pair),
        "names": NAMES,
        "backends": tuple(BACKENDS),
        "shares": recall(store, "shared modules", [], matrix),
        "answers_through": ANSWERS_THROUGH,
    }
