"""Write the report: one self-contained HTML page, the verdicts as JSON, and figures and tables as CSV.

All files are written, or none.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
from collections import Counter
from collections.abc import Mapping
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from dem_bridge.backends.base import BACKENDS, ENGINE_BACKENDS
from dem_bridge.files import write_whole
from dem_bridge.lmp.coefficients import MODELS
from dem_bridge.report import figures
from dem_bridge.report.cells import (
    CLAIMED,
    SEVERITY,
    by_backend,
    by_outcome,
    data_uri,
    digits_of,
    number,
    numeric,
    sortable,
)
from dem_bridge.report.drawing import csv_texts, draw_figure
from dem_bridge.runs.store import Store, code_hash, study_key
from dem_bridge.studies.independence import ANSWERS_THROUGH, matrix
from dem_bridge.studies.study import FigureData, Paper
from dem_bridge.studies.verify import Verification
from dem_bridge.trajectory import Trajectory
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.roles import BLANES_MOAN, POSITIONAL, REFERENCE, SCIPY, THEORY, TWIN
from dem_bridge.verification.verdict import Outcome, Verdict
from dem_bridge.version import __version__

SCHEMA = "dem-bridge/verdicts/1"
NAMES = {
    **dict.fromkeys(ENGINE_BACKENDS, "LAMMPS"),
    TWIN: "twin",
    POSITIONAL: "twin in positions",
    REFERENCE: "reference",
    SCIPY: "scipy",
    BLANES_MOAN: "Blanes-Moan",
    THEORY: "BCA",
}
#: number of panels side by side on a page
_COLUMNS = 2
#: limits of every verification, which the page states
_NEVER_VERIFIED = (
    "The physics of the model is not verified: the report compares codes with codes and with theory, not with"
    " measurements.",
    "The contact stiffness is not verified: it is an input of the scene. The shipped scenes follow eq. 3.1 of the paper"
    " with its approximate axis ratio; the exact Hertz solution is softer by 15 % at 2 degrees, and there the contact"
    " ellipse is as long as the cylinder is high, which is beyond Hertz' theory.",
    "Bending of cylinders, rotation, friction and motion in two or three dimensions are not part of the scenes.",
    "The uncertainty of the reference is an estimate, not a proof. It comes from runs of another order with every input"
    " perturbed by its last digit, and was tested against quadruple-precision solutions of four scenes and"
    " extended-precision solutions of 300 random scenes.",
)


def write_report(verification: Verification, folder: Path) -> tuple[Path, Path]:
    """Write :func:`report_files` into ``folder`` and return the paths of the page and of the verdicts."""
    write_whole(folder, report_files(verification))
    return folder / "index.html", folder / "verdicts.json"


def report_files(verification: Verification, store: Store | None = None) -> dict[str, str]:
    """Return the contents of the files of a report by name.

    The files are ``index.html`` and ``verdicts.json``, and for the paper also ``figures/*.csv`` and ``tables/*.csv``.
    ``store`` keeps the images of figures, so that a second report does not draw them again.
    """
    record = as_json(verification)
    paper = verification.paper
    numbers = {figure.id: csv_texts(figure) for figure in (paper.figures if paper else ())}
    files = {
        "index.html": render(verification, record, store, numbers={id: tuple(texts) for id, texts in numbers.items()}),
        "verdicts.json": json.dumps(record, indent=1, ensure_ascii=False, allow_nan=False) + "\n",
    }
    files |= {f"figures/{name}": text for texts in numbers.values() for name, text in texts.items()}
    files |= {f"tables/{table.id}.csv": table.as_csv() for table in (paper.tables if paper else ())}
    return files


def as_json(verification: Verification) -> dict[str, Any]:
    """Return the content of ``verdicts.json``; unknown numbers are null."""
    paper = verification.paper
    return {
        "schema": SCHEMA,
        "verdicts": [verdict.as_json() for verdict in verification.verdicts],
        "claims": [claim.as_json() for claim in (paper.claims if paper else ())],
        "budgets": [
            budget.as_json() | {"scene": study.scene.name} for study in verification.studies for budget in study.budgets
        ],
        "provenance": provenance(verification),
    }


def provenance(verification: Verification) -> dict[str, Any]:
    """Return versions, hashes, settings and costs, without names of machines or people."""
    lammps: dict[str, Any] = {}
    runs = []
    for study in verification.studies:
        for result in study.results:
            run = result.trajectory
            if run is None:
                continue
            lammps = dict(run.provenance.get("lammps", lammps))
            runs.append(
                {
                    "scene": study.scene.name,
                    "scene_hash": study.scene.content_hash,
                    "backend": result.case.backend,
                    "settings": run.provenance["settings"],
                    "deck_hash": run.provenance.get("deck_hash"),
                    "wall": round(run.cost.wall, 3),
                    "cpu": round(run.cost.cpu, 3),
                    "steps": run.cost.steps,
                    "force_evaluations": run.cost.force_evaluations,
                    "stored": run.provenance.get("stored"),
                }
            )
    packages = ("lammps", "mpich", "numpy", "scipy", "numba", "matplotlib")
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "accuracy": verification.accuracy,
        "versions": {"dem_bridge": __version__, "python": platform.python_version()}
        | {name: version(name) for name in packages},
        "lammps": lammps,
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores",
        "wall": round(verification.wall, 2),
        "runs": runs,
        **({"paper": dict(verification.paper.provenance)} if verification.paper else {}),
    }


def render(
    verification: Verification,
    record: dict[str, Any],
    store: Store | None = None,
    numbers: Mapping[str, tuple[str, ...]] = MappingProxyType({}),
) -> str:
    """Return the page as HTML; ``numbers`` are the CSV files of each figure by its id."""
    environment = Environment(
        loader=PackageLoader("dem_bridge.report", "templates"),
        undefined=StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "by_backend": by_backend,
        "by_outcome": by_outcome,
        "claimed": lambda outcome: CLAIMED[outcome],
        "digits": lambda value: digits_of(value.value, value.uncertainty),
        "stored_image": partial(_stored_image, store=store),
        "number": number,
        "numeric": numeric,
        "data_uri": data_uri,
        "sortable": sortable,
    }
    counts = Counter(verdict.outcome for verdict in verification.verdicts)
    paper = verification.paper
    tables = paper.tables if paper else ()
    with_figures = [study for study in verification.studies if paper is None or _has_refinement(study)]
    return environment.get_template("page.html.j2").render(
        verification=verification,
        record=record,
        paper=paper,
        numbers=numbers,
        title=title(verification),
        budget=next((table for table in tables if table.id == "budget"), None),
        tables=[table for table in tables if table.id != "budget"],
        contents=_contents(paper),
        headline=headline(verification),
        failures=[verdict for verdict in verification.verdicts if verdict.outcome in SEVERITY[:3]],
        counts=[(outcome, counts[outcome]) for outcome in Outcome if counts[outcome]],
        pairs=[with_figures[i : i + _COLUMNS] for i in range(0, len(with_figures), _COLUMNS)],
        with_figures=with_figures,
        figures=figures,
        judged=lambda study: [v for v in study.verdicts if v.outcome is not Outcome.MODEL_DIFFERENCE],
        with_theory=lambda pair: any(study.run(THEORY) is not None for study in pair),
        models=lambda study: [v for v in study.verdicts if v.outcome is Outcome.MODEL_DIFFERENCE],
        deck_hashes=_deck_hashes,
        not_verified=list(dict.fromkeys([*(paper.not_verified if paper else ()), *not_verified(verification)])),
        names=NAMES,
        backends=tuple(BACKENDS),
        shares=matrix(),
        answers_through=ANSWERS_THROUGH,
    )


def title(verification: Verification) -> str:
    """Return the title of the page."""
    if verification.paper is not None:
        return "Chaunsali, Kim & Yang (2018), claim by claim"
    return f"Verification of {', '.join(study.scene.name for study in verification.studies)}"


def _contents(paper: Paper | None) -> list[tuple[str, str]]:
    """Return the ids and names of the sections of the page."""
    first = [("answer", "Answer")]
    if paper is None:
        last = [("not-verified", "Not verified")]
    else:
        first += [("not-verified", "Not verified")]
        first += [("budget", "Error budget")] * any(table.id == "budget" for table in paper.tables)
        first += [("claims", "Claims")]
        first += [("figures", "Figures")] * bool(paper.figures)
        first += [("tables", "Tables")] * any(table.id != "budget" for table in paper.tables)
        last = []
    runs = [("verdicts", "Verdicts"), ("budgets", "Errors of LAMMPS"), ("run-figures", "Figures of runs")]
    return [*first, *runs, ("shared", "Shared modules"), *last, ("provenance", "Provenance")]


def _has_refinement(study: SceneStudy) -> bool:
    """Return True if a scene of the paper has refinement levels; scenes without them get no figures of their own."""
    return any(len(steps) > 1 for steps, _ in study.refinement.values())


def _stored_image(figure: FigureData, store: Store | None) -> str:
    """Return the image of a figure from the store, or draw it, which takes half a second."""
    # equal numbers drawn by the same code and matplotlib have the same key
    content = hashlib.sha256(figure.content()).hexdigest()
    key = study_key("picture", [], content=content, code=code_hash(), matplotlib=version("matplotlib"))
    stored = store.load_arrays(key) if store is not None and key is not None else None
    if stored is not None:
        image: str = stored["picture"].tobytes().decode("ascii")
        return image
    uri = data_uri(draw_figure(figure))
    if store is not None and key is not None:
        store.save_arrays(key, {"picture": np.frombuffer(uri.encode("ascii"), dtype=np.uint8)})
    return uri


def not_verified(verification: Verification) -> list[str]:
    """Return sentences on what the report does not verify."""
    lines = list(_NEVER_VERIFIED)
    runs = [(study, study.run(study.engine)) for study in verification.studies]
    engine_runs = [(study, run) for study, run in runs if run is not None]
    commands = {command: None for study, run in engine_runs for command in _commands(study, run)}  # each once, in order
    ranks = max((int(run.provenance.get("lammps", {}).get("ranks", 1)) for _, run in engine_runs), default=1)
    if commands:
        lines.append(
            f"Of LAMMPS only these parts are verified, on {ranks} rank{'s' * (ranks > 1)}: {', '.join(commands)}. Other"
            " styles, builds and numbers of ranks are not verified."
        )
    alone = [
        study.scene.name
        for study in verification.studies
        if (truth := study.run(REFERENCE)) is not None
        and truth.provenance.get("answered_by") == SCIPY
        and study.scene.dissipates
    ]
    if alone:
        lines.append(
            f"The reference solution of {', '.join(alone)} is not verified by a second method: with damping or drag it"
            f" is that of {SCIPY}."
        )
    return lines


def _commands(study: SceneStudy, run: Trajectory) -> list[str]:
    """Return the parts of LAMMPS that a run used, as LAMMPS commands."""
    scene, c = study.scene, study.scene.contacts
    table, damped = run.provenance.get("table"), c.damping > 0.0
    # with tables, pair_style granular has only the damped contacts, some of them with the damping alone
    models = MODELS.items() if not table else [(n, word) for n, word in MODELS.items() if n in c.exponent[damped]]
    granular = [" and ".join(word for n, word in models if n in c.exponent)]
    if damped.any():
        granular.append(f"damping {'viscoelastic' if (c.damping_power[damped] > 0.0).any() else 'velocity'}")
    parts = {
        f"pair_style table {table['style'] if table else ''}": table,
        f"pair_style granular ({' with '.join(filter(None, granular))})": not table or damped.any(),
        "fix nve": True,
        "fix gravity": scene.gravity != 0.0,
        "fix addforce": scene.load.any(),
        "fix addforce by a variable": scene.drive is not None,
        "fix langevin at zero temperature": scene.drag > 0.0,
    }
    return [command for command, used in parts.items() if used]


def _deck_hashes(study: SceneStudy) -> list[str]:
    """Return the hash of the deck of the LAMMPS run, if there is one."""
    run = study.run(study.engine)
    return [run.provenance["deck_hash"]] if run is not None and "deck_hash" in run.provenance else []


def headline(verification: Verification) -> list[str]:
    """Return the answer: a text per scene."""
    return [_answer(study) for study in verification.studies]


def _answer(study: SceneStudy) -> str:
    """Return the answer for a scene: the error of LAMMPS and its cause, or the verdicts that do not pass."""

    def verdict(quantity: str, backend: str, reference: str) -> Verdict | None:
        pair = (quantity, backend, reference)
        return next((v for v in study.verdicts if (v.quantity, v.backend, v.reference) == pair), None)

    error, twin = verdict("velocity", study.engine, REFERENCE), verdict("velocity", study.engine, TWIN)
    positional = verdict("velocity", study.engine, POSITIONAL)
    clean = (Outcome.PASS, Outcome.MODEL_DIFFERENCE, Outcome.NOT_RUN)
    missing = [f"{v.outcome}: {v.sentence}" for v in study.verdicts if v.outcome is Outcome.NOT_RUN]
    failures = [f"{v.outcome}: {v.sentence}" for v in study.verdicts if v.outcome not in clean]
    if error is None or twin is None or positional is None or failures:
        return f"{study.scene.name}: {' '.join([*failures, *missing]) or 'no verdict on LAMMPS'}"
    run = study.run(study.engine)
    assert run is not None
    parts = study.budgets[0].parts
    cause = "the time step"
    agreement = f"to {positional.difference:.1e}" if positional.difference > 0.0 else "bit for bit"
    if "table" in run.provenance:
        cause += f" ({parts['time step']:.1e}) and the interpolation of the force tables ({parts['table']:.1e})"
    text = (
        f"{study.scene.name}: with dt = {run.provenance['settings']['dt']:.3g} s, the velocity error of LAMMPS is at"
        f" most {error.difference:.1e} of the largest velocity ({error.scale:.3g} m/s). Its cause is {cause}: the"
        f" same algorithm in another code (the twin) differs from LAMMPS by only {twin.difference:.1e}, which is"
        f" round-off, and a twin that stores positions, as LAMMPS does, agrees with it {agreement}."
    )
    worst, end = verdict("arrival", THEORY, REFERENCE), verdict("arrival_at_end", THEORY, REFERENCE)
    if worst is not None and end is not None:
        text += (
            " The binary collision approximation (BCA) predicts the arrival at the last body with an error of"
            f" {100 * end.difference:.1f} %, and at the worst body of {100 * worst.difference:.1f} %."
        )
    # checks that were not run do not affect this answer
    return " ".join([text, *missing])
