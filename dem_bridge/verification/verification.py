"""The study that verifies scenes: verdicts and error budgets of each scene, claims of the paper, limits.

Nothing is run or drawn here.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from dem_bridge.backends.base import versions_of
from dem_bridge.lmp.pair_coefficients import MODELS, damping_model
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.report.study import Claim, Headline, Points, Study, Table
from dem_bridge.report.texts import Texts, verdict_table
from dem_bridge.runs.store import Store
from dem_bridge.trajectory.trajectory import Trajectory
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.closed_form import closed_form_table
from dem_bridge.verification.proved import proved_sentence, proved_table
from dem_bridge.verification.reference_choice import REFERENCE, SCIPY
from dem_bridge.verification.roles import POSITIONAL, THEORY, TWIN
from dem_bridge.version import __version__

SCHEMA = "dem-bridge/verdicts/1"
TEXTS = Texts("verify", "dem_bridge.verification")
OBSERVABLES_COLUMNS = (
    "scene", "observable", "reference", "unit", "uncertainty of reference", "LAMMPS - reference",
    "uncertainty of LAMMPS", "twin - reference", "uncertainty of twin", "second reference - reference",
    "uncertainty of second reference",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Verification(Study):
    """Hold the study of how accurately LAMMPS solves scenes; :func:`verification_of` returns it."""

    studies: tuple[SceneStudy, ...]
    """Runs, verdicts and error budgets of each scene."""
    accuracy: float
    """Wanted accuracy of velocities, relative to the largest."""
    dt: float | None = None
    """Time step of the main runs, s; None: it followed from the accuracy."""
    wall: float
    """s, for all of it."""
    played: tuple[str, ...] = ()
    """Names of the scenes whose motion the page plays, in their order; empty: all."""
    headlines: tuple[Headline, ...] = ()
    """Numbers that the page shows large, if the whole paper was verified."""
    abstract: tuple[Points, ...] = ()
    """Question, method, result and further parts in points, if the whole paper was verified."""
    claims: tuple[Claim, ...] = ()
    """Statements of the paper, if the whole paper was verified."""
    not_verified: tuple[str, ...] = ()
    """What a reader must not conclude from it."""

    def page_files(self, store: Store | None = None) -> dict[str, str | bytes]:
        """Return the page, JSON, tables and figures by their names; pictures are kept in ``store``."""
        from dem_bridge.verification.page import verification_files  # it is built on verifications

        return verification_files(self, store)

    def _picture(self) -> str:
        """Return the HTML of the picture of a notebook: the motion of the first scene."""
        from dem_bridge.verification.page import picture_of_verification  # it is built on verifications

        return picture_of_verification(self)

    @property
    def record_name(self) -> str:
        """Return the name of the JSON file."""
        return "verdicts.json"

    def as_json(self) -> dict[str, Any]:
        """Return the content of ``verdicts.json``, of the schema :data:`SCHEMA`; JSON without NaN."""
        return {
            "schema": SCHEMA,
            "verdicts": [verdict.as_json() for verdict in self.verdicts],
            "claims": [claim.as_json() for claim in self.claims],
            "budgets": [
                budget.as_json() | {"scene": study.scene.name} for study in self.studies for budget in study.budgets
            ],
            "observables": [row for table in self.tables if table.id == "observables" for row in table.as_json()],
            "provenance": dict(self.provenance),
        }


def verification_of(
    studies: Sequence[SceneStudy], *, accuracy: float, wall: float, notes: Sequence[str] = ()
) -> Verification:
    """Return the verification of some scenes."""
    verdicts = tuple(verdict for study in studies for verdict in study.verdicts)
    exact = [table for table in (closed_form_table(studies), proved_table(studies)) if table is not None]
    return Verification(
        id="verify",
        title=TEXTS("title", scenes=", ".join(study.scene.name for study in studies)),
        answer=tuple(map(_answer, studies)),
        tables=(*exact, verdict_table(verdicts), observable_table(studies)),
        verdicts=verdicts,
        notes=tuple(notes),
        provenance=_provenance(studies, accuracy, wall),
        studies=tuple(studies),
        accuracy=accuracy,
        wall=wall,
        not_verified=(*TEXTS.notes(), *_limits(studies)),
    )


def observable_table(studies: Sequence[SceneStudy]) -> Table:
    """Return all registered observables of each scene.

    Scenes without a reference, and those of the paper that are run without refinement levels, have no rows.
    """
    return TEXTS.table("observables", OBSERVABLES_COLUMNS, [row for study in studies for row in study.observables])


def _provenance(studies: Sequence[SceneStudy], accuracy: float, wall: float) -> dict[str, Any]:
    """Return versions, hashes, settings and costs, without names of machines or people."""
    results = [(study.scene, item.case, item.trajectory) for study in studies for item in study.results]
    runs = [
        {
            "scene": scene.name,
            "scene_hash": scene.content_hash,
            "backend": case.backend,
            "settings": run.provenance["settings"],
            "deck_hash": run.provenance.get("deck_hash"),
            "wall": round(run.cost.wall, 3),
            "cpu": round(run.cost.cpu, 3),
            "steps": run.cost.steps,
            "force_evaluations": run.cost.force_evaluations,
            "stored": run.provenance.get("stored"),
        }
        for scene, case, run in results
        if run is not None
    ]
    engines = [run.provenance["lammps"] for *_, run in results if run is not None and "lammps" in run.provenance]
    packages = ("lammps", "mpich", "numpy", "scipy", "numba", "matplotlib")
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "accuracy": accuracy,
        "versions": {"dem_bridge": __version__, "python": platform.python_version()} | versions_of(*packages),
        "lammps": dict(engines[-1]) if engines else {},
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores",
        "wall": round(wall, 2),
        "runs": runs,
    }


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
        return TEXTS("none", scene=study.scene.name, verdicts=" ".join([*failures, *missing]) or "no verdict on LAMMPS")
    run = study.run(study.engine)
    assert run is not None
    parts = study.budgets[0].parts
    same, same_positions = (
        f"to {v.difference:.1e}" if v.difference > 0.0 else "bit for bit" for v in (twin, positional)
    )
    answer = TEXTS(
        "engine",
        scene=study.scene.name,
        dt=run.provenance["settings"]["dt"],
        error=error,
        cause=TEXTS("tables" if "table" in run.provenance else "step", step=parts["time step"], table=parts["table"]),
        twin=same,
        positional=same_positions,
    )
    if proved := proved_sentence(study):
        answer += " " + proved
    worst, end = verdict("arrival", THEORY, REFERENCE), verdict("arrival_at_end", THEORY, REFERENCE)
    if worst is not None and end is not None:
        answer += " " + TEXTS("theory", end=100.0 * end.difference, worst=100.0 * worst.difference)
    # checks that were not run do not affect this answer
    return " ".join([answer, *missing])


def _limits(studies: Sequence[SceneStudy]) -> Iterator[str]:
    """Yield what is not verified because these scenes do not have it."""
    runs = [(study, run) for study in studies if (run := study.run(study.engine)) is not None]
    used = dict.fromkeys(command for study, run in runs for command in _commands(study, run))
    ranks = max((int(run.provenance.get("lammps", {}).get("ranks", 1)) for _, run in runs), default=1)
    if used:
        yield TEXTS("parts", ranks=f"{ranks} rank{'s' * (ranks > 1)}", used=", ".join(used))
    alone = [
        study.scene.name
        for study in studies
        if study.run(REFERENCE) is not None and study.scene.dissipates and study.roles.solver == SCIPY
    ]
    if alone:
        yield TEXTS("alone", scenes=", ".join(alone), code=SCIPY)


def _commands(study: SceneStudy, run: Trajectory) -> list[str]:
    """Return the parts of LAMMPS that a run used, as LAMMPS commands."""
    scene, c = study.scene, study.scene.contacts
    table, damped = run.provenance.get("table"), c.damping > 0.0
    # with tables, pair_style granular has only the damped contacts, some of them with the damping alone
    models = MODELS.items() if not table else [(n, word) for n, word in MODELS.items() if n in c.exponent[damped]]
    granular = [" and ".join(word for n, word in models if n in c.exponent)]
    if damped.any():
        granular.append(f"damping {damping_model(scene)[0]}")
    parts = {
        f"pair_style table {table['style'] if table else ''}": table,
        f"pair_style granular ({' with '.join(filter(None, granular))})": not table or damped.any(),
        "fix nve": True,
        "fix gravity": scene.gravity != 0.0,
        "fix addforce": scene.load.any(),
        "fix addforce by a variable": scene.driving_force is not None,
        "fix move": scene.piston is not None,
        "fix langevin at zero temperature": scene.drag > 0.0,
    }
    return [command for command, used in parts.items() if used]
