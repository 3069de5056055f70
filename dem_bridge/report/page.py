"""The report: one self-contained HTML page, beside it the verdicts as JSON and what is drawn and tabled as CSV.

All files appear, or none.
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
    digits_of,
    number,
    numeric,
    picture,
    sortable,
)
from dem_bridge.report.drawing import csv_texts, drawn
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
#: panels side by side on a page
_BESIDE = 2
#: what a reader must not believe that any page shows
_NEVER_VERIFIED = (
    "The physics of the model. Code is verified against code and theory here; nothing is compared with a measurement.",
    "The contact stiffness: it is taken as the scene gives it. Where that is by the paper's eq. 3.1 with its"
    " approximate axis ratio, as in the shipped scenes, the exact Hertz solution is softer by 15 % at 2 degrees, and"
    " there the contact ellipse grows to the height of the cylinder, where Hertz' theory ends.",
    "Cylinders that bend, rotation, friction, more dimensions: none is in such scenes.",
    "Error bars of the reference: they come from runs of another order with every input moved by its last digit. They"
    " are tested against quadruple-precision solutions of four scenes and extended precision in 300 random ones, and"
    " are no proof.",
)


def write_report(found: Verification, folder: Path) -> tuple[Path, Path]:
    """Write :func:`report_files` into ``folder`` (made if need be); the paths of the page and of the verdicts."""
    write_whole(folder, report_files(found))
    return folder / "index.html", folder / "verdicts.json"


def report_files(found: Verification, store: Store | None = None) -> dict[str, str]:
    """Name -> text: ``index.html``, ``verdicts.json``; with a paper ``figures/*.csv`` and ``tables/*.csv``.

    ``store``: where pictures are kept, so that none is drawn twice.
    """
    record = as_json(found)
    numbers = {one.id: csv_texts(one) for one in (found.paper.figures if found.paper else ())}
    files = {
        "index.html": render(found, record, store, numbers={id: tuple(texts) for id, texts in numbers.items()}),
        "verdicts.json": json.dumps(record, indent=1, ensure_ascii=False, allow_nan=False) + "\n",
    }
    files |= {f"figures/{name}": text for texts in numbers.values() for name, text in texts.items()}
    files |= {f"tables/{one.id}.csv": one.as_csv() for one in (found.paper.tables if found.paper else ())}
    return files


def as_json(found: Verification) -> dict[str, Any]:
    """The content of ``verdicts.json``; JSON without NaN."""
    return {
        "schema": SCHEMA,
        "verdicts": [verdict.as_json() for verdict in found.verdicts],
        "claims": [claim.as_json() for claim in (found.paper.claims if found.paper else ())],
        "budgets": [
            budget.as_json() | {"scene": study.scene.name} for study in found.studies for budget in study.budgets
        ],
        "provenance": provenance(found),
    }


def provenance(found: Verification) -> dict[str, Any]:
    """Versions, hashes and time used, without names of machines or people."""
    lammps: dict[str, Any] = {}
    runs = []
    for study in found.studies:
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
        "accuracy": found.accuracy,
        "versions": {"dem_bridge": __version__, "python": platform.python_version()}
        | {name: version(name) for name in packages},
        "lammps": lammps,
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores",
        "wall": round(found.wall, 2),
        "runs": runs,
        **({"paper": dict(found.paper.provenance)} if found.paper else {}),
    }


def render(
    found: Verification,
    record: dict[str, Any],
    store: Store | None = None,
    numbers: Mapping[str, tuple[str, ...]] = MappingProxyType({}),
) -> str:
    """The page as text. ``numbers``: the files of each figure, by its name."""
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
        "digits": lambda claimed: digits_of(claimed.value, claimed.uncertainty),
        "shown": partial(_shown, store=store),
        "number": number,
        "numeric": numeric,
        "picture": picture,
        "sortable": sortable,
    }
    counts = Counter(verdict.outcome for verdict in found.verdicts)
    paper = found.paper
    tables = paper.tables if paper else ()
    drawn_too = [study for study in found.studies if paper is None or _in_full(study)]
    return environment.get_template("page.html.j2").render(
        found=found,
        record=record,
        paper=paper,
        numbers=numbers,
        title=title(found),
        budget=next((one for one in tables if one.id == "budget"), None),
        tables=[one for one in tables if one.id != "budget"],
        contents=_contents(paper),
        headline=headline(found),
        troubles=[verdict for verdict in found.verdicts if verdict.outcome in SEVERITY[:3]],
        counts=[(outcome, counts[outcome]) for outcome in Outcome if counts[outcome]],
        pairs=[drawn_too[i : i + _BESIDE] for i in range(0, len(drawn_too), _BESIDE)],
        drawn_too=drawn_too,
        figures=figures,
        judged=lambda study: [v for v in study.verdicts if v.outcome is not Outcome.MODEL_DIFFERENCE],
        with_theory=lambda pair: any(study.run(THEORY) is not None for study in pair),
        models=lambda study: [v for v in study.verdicts if v.outcome is Outcome.MODEL_DIFFERENCE],
        deck_hashes=_deck_hashes,
        not_verified=list(dict.fromkeys([*(paper.not_verified if paper else ()), *not_verified(found)])),
        names=NAMES,
        backends=tuple(BACKENDS),
        shares=matrix(),
        answers_through=ANSWERS_THROUGH,
    )


def title(found: Verification) -> str:
    """What was verified."""
    if found.paper is not None:
        return "Chaunsali, Kim & Yang (2018), claim by claim"
    return f"Verification of {', '.join(study.scene.name for study in found.studies)}"


def _contents(paper: Paper | None) -> list[tuple[str, str]]:
    """(id, name) of the parts of the page."""
    first = [("answer", "Answer")]
    if paper is None:
        last = [("not-verified", "Not verified")]
    else:
        first += [("not-verified", "Not verified")]
        first += [("budget", "Whole budget")] * any(one.id == "budget" for one in paper.tables)
        first += [("claims", "Claims")]
        first += [("figures", "Figures")] * bool(paper.figures)
        first += [("tables", "Tables")] * any(one.id != "budget" for one in paper.tables)
        last = []
    runs = [("verdicts", "Verdicts"), ("budgets", "Error budgets"), ("pictures", "Pictures")]
    return [*first, *runs, ("shares", "Who shares what"), *last, ("provenance", "Provenance")]


def _in_full(study: SceneStudy) -> bool:
    """Whether a scene of a paper has its steps in a ladder: the others lend their numbers, and no pictures."""
    return any(len(steps) > 1 for steps, _ in study.refinement.values())


def _shown(figure: FigureData, store: Store | None) -> str:
    """The picture of a figure, which takes half a second to be drawn."""
    # the same numbers, drawn by the same code
    content = hashlib.sha256(figure.content()).hexdigest()
    key = study_key("picture", [], content=content, code=code_hash(), matplotlib=version("matplotlib"))
    known = store.load_arrays(key) if store is not None and key is not None else None
    if known is not None:
        return known["picture"].tobytes().decode("ascii")
    uri = picture(drawn(figure))
    if store is not None and key is not None:
        store.save_arrays(key, {"picture": np.frombuffer(uri.encode("ascii"), dtype=np.uint8)})
    return uri


def not_verified(found: Verification) -> list[str]:
    """What a reader must not believe that this page shows, by what its scenes have."""
    lines = list(_NEVER_VERIFIED)
    runs = [(study, study.run(study.engine)) for study in found.studies]
    there = [(study, run) for study, run in runs if run is not None]
    words = {word: None for study, run in there for word in _used(study, run)}  # each once, in order
    ranks = max((int(run.provenance.get("lammps", {}).get("ranks", 1)) for _, run in there), default=1)
    if words:
        lines.append(
            f"LAMMPS beyond {', '.join(words)}, on {ranks} rank{'s' * (ranks > 1)}. Other styles,"
            " builds and numbers of ranks are not verified here."
        )
    alone = [
        study.scene.name
        for study in found.studies
        if (truth := study.run(REFERENCE)) is not None
        and truth.provenance.get("answered_by") == SCIPY
        and study.scene.dissipates
    ]
    if alone:
        lines.append(
            f"The reference of {', '.join(alone)} by a second method: {SCIPY} alone answers where there is damping or"
            " drag."
        )
    return lines


def _used(study: SceneStudy, run: Trajectory) -> list[str]:
    """What of LAMMPS a run had, in LAMMPS' words."""
    scene, c = study.scene, study.scene.contacts
    table, damped = run.provenance.get("table"), c.damping > 0.0
    # beside a table granular has the contacts that are damped, and of some the damping alone
    own = MODELS.items() if not table else [(n, word) for n, word in MODELS.items() if n in c.exponent[damped]]
    granular = [" and ".join(word for n, word in own if n in c.exponent)]
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
    return [words for words, there in parts.items() if there]


def _deck_hashes(study: SceneStudy) -> list[str]:
    run = study.run(study.engine)
    return [run.provenance["deck_hash"]] if run is not None and "deck_hash" in run.provenance else []


def headline(found: Verification) -> list[str]:
    """The answer, a sentence a scene."""
    return [_answer(study) for study in found.studies]


def _answer(study: SceneStudy) -> str:
    def one(quantity: str, backend: str, reference: str) -> Verdict | None:
        wanted = (quantity, backend, reference)
        return next((v for v in study.verdicts if (v.quantity, v.backend, v.reference) == wanted), None)

    error, twin = one("velocity", study.engine, REFERENCE), one("velocity", study.engine, TWIN)
    same = one("velocity", study.engine, POSITIONAL)
    clean = (Outcome.PASS, Outcome.MODEL_DIFFERENCE, Outcome.NOT_RUN)
    missing = [f"{v.outcome}: {v.sentence}" for v in study.verdicts if v.outcome is Outcome.NOT_RUN]
    trouble = [f"{v.outcome}: {v.sentence}" for v in study.verdicts if v.outcome not in clean]
    if error is None or twin is None or same is None or trouble:
        return f"{study.scene.name}: {' '.join([*trouble, *missing]) or 'no verdict on LAMMPS'}"
    run = study.run(study.engine)
    assert run is not None
    parts = study.budgets[0].parts
    cause, agreed = "the time step", f"to {same.difference:.1e}" if same.difference > 0.0 else "bit for bit"
    if "table" in run.provenance:
        cause += f" ({parts['time step']:.1e}) and the tables ({parts['table']:.1e})"
    text = (
        f"{study.scene.name}: at dt = {run.provenance['settings']['dt']:.3g} s LAMMPS' velocities are wrong by"
        f" {error.difference:.1e} of the largest ({error.scale:.3g} m/s), {cause}; from the same algorithm"
        f" in another code they differ by {twin.difference:.1e}, which is round-off: a twin that keeps"
        f" positions, as LAMMPS does, has the same {agreed}."
    )
    worst, end = one("arrival", THEORY, REFERENCE), one("arrival_at_end", THEORY, REFERENCE)
    if worst is not None and end is not None:
        text += (
            f" Binary collisions predict the arrival at the last body to {100 * end.difference:.1f} %"
            f" and at the worst one to {100 * worst.difference:.1f} %."
        )
    # what else was asked and has no answer takes nothing from this one
    return " ".join([text, *missing])
