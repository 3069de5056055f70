"""Say in words how a verification ended: the error of LAMMPS, its cause and the step to use, or why checks fail.

Verdicts that fail for one reason are one group. Nothing is run or drawn here.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from dem_bridge.backends.base import supports_of
from dem_bridge.backends.catalogue import BACKENDS
from dem_bridge.backends.steps import order_on
from dem_bridge.foundation.wording import share
from dem_bridge.lmp.known_defects import known_defects
from dem_bridge.observables.largest_step import ACCURACIES, LargestStep, StepError, with_sources
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.report.texts import Texts
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.budget import Budget
from dem_bridge.verification.checks import INDEPENDENT
from dem_bridge.verification.reference_choice import REFERENCE

TEXTS = Texts("banner", "dem_bridge.verification")
#: outcomes of checks that can pass or fail, the worst first
_JUDGED = (Outcome.BROKEN, Outcome.FAIL, Outcome.UNDECIDED, Outcome.PASS)
#: part of a budget -> cause of the failures that it explains
_CAUSES = {"time step": "step", "table": "table", "round-off": "round-off", "sampling": "sampling"}
#: first word of the meaning of a verdict -> cause of its failure, where no budget says it
_MEANINGS = {
    "time": "step", "implementation": "implementation", "interpolation": "table", "convergence": "order",
    "round-off": "round-off", INDEPENDENT.split()[0]: "references",
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Group:
    """Verdicts of one scene that do not pass for one reason."""

    cause: str
    """Id of the cause: "step", "implementation", "table", "round-off", "references", "order", "broken", "defect"."""
    sentence: str
    write: str
    """Line to write instead, or for a known defect a sentence on it; empty where none is known."""
    verdicts: tuple[Verdict, ...]


@dataclass(frozen=True, kw_only=True)
class Banner:
    """How the verification of one scene ended."""

    scene: str
    outcome: Outcome
    sentences: tuple[str, ...]
    not_run: tuple[str, ...]
    """Why checks were not run."""
    groups: tuple[Group, ...]
    """Empty if all checks pass, the largest group first."""


def banner_of(study: SceneStudy, accuracy: float) -> Banner:
    """Return how the verification of a scene ended; ``accuracy`` is that of velocities."""
    judged = [verdict for verdict in study.verdicts if verdict.outcome in _JUDGED]
    outcome = next((o for o in _JUDGED if any(v.outcome is o for v in judged)), Outcome.NOT_RUN)
    groups = tuple(sorted(_groups(study, judged, accuracy), key=lambda group: -len(group.verdicts)))
    return Banner(
        scene=study.scene.name,
        outcome=outcome,
        sentences=tuple(_sentences(study, judged, outcome)),
        not_run=reasons_not_run([study]),
        groups=groups,
    )


def reasons_not_run(studies: Iterable[SceneStudy]) -> tuple[str, ...]:
    """Return why checks were not run: a sentence a backend, however many scenes it does not support."""
    by_backend: dict[str, list[Verdict]] = {}
    for verdict in (verdict for study in studies for verdict in study.verdicts if verdict.outcome is Outcome.NOT_RUN):
        by_backend.setdefault(verdict.backend, []).append(verdict)
    return tuple(itertools.chain.from_iterable(map(_reasons_of, by_backend, by_backend.values())))


def _reasons_of(backend: str, verdicts: Sequence[Verdict]) -> Iterator[str]:
    """Yield why a backend did not run, by its verdicts on one scene or on several."""
    count = len({verdict.scene for verdict in verdicts})
    many = f"{count} scenes" if count > 1 else verdicts[0].scene
    sentences = dict.fromkeys(v.sentence.replace(f" on {v.scene}", f" on {many}", 1) for v in verdicts)
    scope = supports_of(backend).scope if backend in BACKENDS else ""
    if count > 1 and len(sentences) > 1 and scope:
        sentences = {}
        yield TEXTS("not_run_scope", backend=backend, scenes=many, scope=scope)
    yield from (TEXTS("not_run", sentence=sentence) for sentence in sentences)


def _sentences(study: SceneStudy, judged: Sequence[Verdict], outcome: Outcome) -> Iterator[str]:
    """Yield the sentences of a banner; those of groups follow them."""
    velocity = _velocity(study)
    run = study.run(study.engine)
    if velocity is not None and run is not None:
        dt = float(run.provenance["settings"]["dt"])
        key = "error" if velocity.outcome is Outcome.PASS else "too_large"
        error, allowed = share(velocity.difference), share(velocity.tolerance)
        yield TEXTS(key, outcome=outcome.value, dt=dt, error=error, allowed=allowed, scale=velocity.scale)
        cause = _cause_of_error(study.budgets[0]) if study.budgets else ""
        if cause and not velocity.known_defect:  # the group of its verdicts names a defect
            yield TEXTS("cause", cause=TEXTS(cause, "names"))
        # no step mends a wrong law
        tried = () if cause == "implementation" else ACCURACIES
        steps = [
            (TEXTS("step", accuracy=share(a), step=_seconds(step.dt)), step)
            for a in tried
            if (step := largest_step(study, a)) is not None
        ]
        if steps:
            yield TEXTS("steps", steps=with_sources(steps, _seconds))
    elif not judged:
        yield TEXTS("nothing", outcome=outcome.value)
    else:
        yield TEXTS("unjudged", outcome=outcome.value)


def _velocity(study: SceneStudy) -> Verdict | None:
    """Return the verdict on the velocities of LAMMPS."""
    pair = ("velocity", study.engine, REFERENCE)
    return next(
        (v for v in study.verdicts if (v.quantity, v.backend, v.reference) == pair and v.difference == v.difference),
        None,
    )


def _cause_of_error(budget: Budget) -> str:
    """Return the id of the largest part of an error."""
    parts = {_CAUSES[name]: value for name, value in budget.parts.items() if name in _CAUSES}
    parts["implementation"] = budget.unexplained if budget.is_finding else 0.0
    known = {cause: value for cause, value in parts.items() if math.isfinite(value)}
    cause = max(known, key=lambda name: known[name])
    return cause if known[cause] > 0.0 else ""


def largest_step(study: SceneStudy, accuracy: float) -> LargestStep | None:
    """Return the largest time step of LAMMPS with which velocities err by ``accuracy`` at most; None if unknown.

    It is measured, or lies between two steps that were run, or follows from the order of the algorithm.
    """
    refinement = study.refinement.get(study.engine)
    if refinement is None:
        return None
    errors = StepError(curve=tuple(zip(*refinement, strict=True)))
    return errors.largest_step(accuracy, order=order_on(study.scene))


def _seconds(step: float) -> str:
    """Return a step with its unit.

    Examples
    --------
    >>> _seconds(1e-8), _seconds(2.8e-8)
    ('1.0e-8 s', '2.8e-8 s')
    """
    return f"{step:.1e} s".replace("e-0", "e-")


def _groups(study: SceneStudy, judged: Sequence[Verdict], accuracy: float) -> Iterator[Group]:
    """Yield the verdicts that do not pass by the reason."""
    budgets = {budget.quantity: budget for budget in study.budgets}
    by_cause: dict[tuple[Outcome, str], list[Verdict]] = {}
    for verdict in judged:
        if verdict.outcome is not Outcome.PASS:
            cause = _cause_of_verdict(verdict, study.engine, budgets)
            by_cause.setdefault((verdict.outcome, cause), []).append(verdict)
    for (outcome, cause), verdicts in by_cause.items():
        id, _, name = cause.partition(" ")
        why, write = _reason(study, id, name, verdicts, accuracy)
        sentence = TEXTS(
            "group" if len(verdicts) > 1 else "single",
            count=len(verdicts), total=len(judged), word=TEXTS(outcome.value, "outcomes"), why=why,
        )  # fmt: skip
        yield Group(cause=id, sentence=sentence, write=write, verdicts=tuple(verdicts))


def _cause_of_verdict(verdict: Verdict, engine: str, budgets: dict[str, Budget]) -> str:
    """Return the id of the cause of a verdict that does not pass; that of a defect is followed by its name."""
    if verdict.outcome is Outcome.BROKEN:
        return "broken"
    if verdict.known_defect:
        return f"defect {verdict.known_defect}"
    if verdict.backend == engine and verdict.reference == REFERENCE:
        # an observable without a budget of its own follows from the velocities
        budget = budgets.get(verdict.quantity) or budgets.get("velocity")
        cause = "" if budget is None else _cause_of_error(budget)
        if cause:
            return cause
    return _MEANINGS.get(verdict.meaning.split(",")[0].split(" ")[0], "unknown")


def _reason(study: SceneStudy, id: str, name: str, verdicts: Sequence[Verdict], accuracy: float) -> tuple[str, str]:
    """Return why verdicts do not pass, in words, and the line to write instead."""
    worst = max(verdicts, key=lambda v: v.difference / v.tolerance if v.difference == v.difference else 0.0)
    values: dict[str, Any] = {
        "error": share(worst.difference), "allowed": share(worst.tolerance),
        "quantity": worst.quantity.replace("_", " "), "sentence": worst.sentence.rstrip("."), "name": name,
    }  # fmt: skip
    write = ""
    if id == "step":
        step = largest_step(study, accuracy)
        write = "" if step is None else TEXTS("write_step", step=_seconds(step.dt).removesuffix(" s"))
    if id == "defect":
        defects = [defect for defect in known_defects() if defect.name in name.split(", ")]
        values["name"] = "; ".join(f"{d.name}: {d.symptom} ({d.size})" for d in defects)
        write = "; ".join(defect.instead for defect in defects)
    return TEXTS(id, "why", **values), write
