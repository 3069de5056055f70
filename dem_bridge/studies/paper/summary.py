"""Page one of the report: the answer in five sentences, and what was not verified."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from dem_bridge.observables.verdict import Outcome
from dem_bridge.report.study import Claim
from dem_bridge.studies.paper import PAPER, percent
from dem_bridge.studies.paper.claims import by
from dem_bridge.studies.paper.effects import PARAMETER, PHYSICS, SUPPOSED, THEORY, Effect
from dem_bridge.studies.paper.runs import MAIN
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.reference_choice import REFERENCE, SCIPY
from dem_bridge.verification.roles import POSITIONAL

#: limits of this report, in addition to those of every report
NOT_VERIFIED = tuple(PAPER.data["answer"]["not_verified"])
#: how claims are counted, by kind, for several and for one
COUNTED = {
    "holds": ("hold", "holds"),
    "print": (
        "are wrong in print (misprint, rounding or wording)",
        "is wrong in print (misprint, rounding or wording)",
    ),
    "theory": (
        "are theories or approximations that are off by a stated amount",
        "is a theory that is off by a stated amount",
    ),
    "limit": ("exceed a limit that we set", "exceeds a limit that we set"),
    "undecided": ("cannot be decided", "cannot be decided"),
    "not run": ("were not run", "was not run"),
}
#: claims that do not hold, the gravest first -> what the claim is about
FAILURES = {
    "velocity-by-bca": "peak velocities by BCA (eq. 3.5)",
    "arrival-as-printed": "total travel time (eq. 3.7), which omits T_0 and names no origin",
    "weight": "weight of the chain",
    "residence-definition": "time of complete momentum transfer (eq. 3.3)",
    "compression": "largest compression",
    "stiffness-90-degrees": "stiffness at 90 degrees",
    "point-contact": "Hertz point contact down to 2 degrees",
    "residence-by-bca": "residence times by BCA",
}
#: kinds of claims that do not hold, in words
FAILS_BY = {"theory": "a theory that is off", "print": "wrong in print", "limit": "limits that we set"}


def answer(claims: Sequence[Claim], effects: Sequence[Effect], studies: Sequence[SceneStudy]) -> tuple[str, ...]:
    """Return the answer in five sentences, each with its number."""
    return (
        _codes(studies),
        _count(claims),
        _theory(claims),
        _where_not(claims),
        _largest(effects),
    )


def _codes(studies: Sequence[SceneStudy]) -> str:
    def worst(backend_is_engine: bool, reference: str, names: Sequence[str] = MAIN) -> float:
        differences = [
            v.difference
            for study in studies
            if study.scene.name in names
            for v in study.verdicts
            if v.quantity == "velocity"
            and v.outcome is not Outcome.NOT_RUN
            and v.reference == reference
            and (v.backend == study.engine if backend_is_engine else v.backend == SCIPY)
            and math.isfinite(v.difference)
        ]
        return max(differences, default=math.nan)

    error, same, two = worst(True, REFERENCE), worst(True, POSITIONAL), worst(False, REFERENCE)
    # where scipy answers for the reference there is no second solution to compare
    both = [study.scene.name for study in studies if math.isfinite(worst(False, REFERENCE, [study.scene.name]))]
    everywhere = worst(False, REFERENCE, both)
    wrong = Counter(v.outcome for study in studies for v in study.verdicts)
    if math.isnan(error):
        return PAPER("without_lammps", "answer", everywhere=everywhere)
    if failed := wrong[Outcome.FAIL] + wrong[Outcome.BROKEN]:
        broken = wrong[Outcome.BROKEN]
        return PAPER("wrong", "answer", count=wrong.total(), failed=failed - broken, broken=broken)
    differences = {"error": error, "same": same, "two": two, "everywhere": everywhere, "both": len(both)}
    return PAPER("codes", "answer", count=len(studies), **differences)


def _count(claims: Sequence[Claim]) -> str:
    return PAPER("count", "answer", count=len(claims), parts=counted(claims))


def counted(claims: Sequence[Claim]) -> str:
    """Return how many claims there are of each kind, in words."""
    counts = Counter(claim.kind for claim in claims)
    words = [f"{n} {forms[n == 1]}" for kind, forms in COUNTED.items() if (n := counts[kind])]
    return " and ".join(filter(None, [", ".join(words[:-1]), *words[-1:]]))


def _theory(claims: Sequence[Claim]) -> str:
    by_id = {claim.id: claim for claim in claims}
    slow, fast = by_id.get("decelerates"), by_id.get("accelerates")
    if slow is None or fast is None or Outcome.NOT_RUN in (slow.outcome, fast.outcome):
        return PAPER("without_reference", "answer")
    away = [abs(v.value) for v in by_id["arrival-by-bca"].values if v.name.startswith("with T_0")]
    velocities = by_id["velocity-by-bca"].values
    return PAPER(
        "theory",
        "answer",
        low=by(slow.values).value,
        high=by(fast.values).value,
        away=max(away, default=math.nan),
        bca=by(velocities, "bca").value,
        simulated=by(velocities).value,
    )


def _where_not(claims: Sequence[Claim]) -> str:
    groups = names_of_failures(claims)
    return PAPER("where_not", "answer", groups=groups) if groups else PAPER("all_hold", "answer")


def failures(claims: Sequence[Claim]) -> tuple[tuple[Claim, str, str], ...]:
    """Return the claims that do not hold, the gravest first, with why each fails and what it is about, in words."""
    failed = {claim.id: claim for claim in claims if claim.outcome is Outcome.FAIL}
    ordered = [*(id for id in FAILURES if id in failed), *(id for id in failed if id not in FAILURES)]
    return tuple((failed[id], FAILS_BY[failed[id].kind], FAILURES.get(id, id.replace("-", " "))) for id in ordered)


def names_of_failures(claims: Sequence[Claim]) -> str:
    """Return the claims that do not hold in words, by reason; empty without any."""
    groups = [
        (kind, [words for _, by_reason, words in failures(claims) if by_reason == kind]) for kind in FAILS_BY.values()
    ]
    return "; ".join(f"{kind}: {', '.join(names)}" for kind, names in groups if names)


def _largest(effects: Sequence[Effect]) -> str:
    ordered = sorted((e for e in effects if math.isfinite(e.largest)), key=lambda effect: -effect.largest)

    def largest(*names: str) -> Effect | None:
        """Return the largest effect of these kinds, or with this id."""
        return next((effect for effect in ordered if effect.kind in names or effect.id in names), None)

    whole, model, law = (
        largest(THEORY, PHYSICS, PARAMETER, SUPPOSED),
        largest(PHYSICS, PARAMETER),
        largest("exact-stiffness"),
    )
    supposed, numerics = largest(SUPPOSED), largest("lammps")
    if whole is None or model is None or law is None or supposed is None:
        return PAPER("without_budget", "answer")
    said = "LAMMPS was not run" if numerics is None else f"the numerical error of LAMMPS is {percent(numerics.largest)}"
    terms = {"whole": _named(whole), "model": _named(model), "supposed": _named(supposed)}
    return PAPER("largest", "answer", law=law.largest, numerics=said, **terms)


def _named(effect: Effect) -> str:
    name = max(effect.changes, key=lambda key: abs(effect.changes[key]) if math.isfinite(effect.changes[key]) else 0.0)
    return f"{effect.what}, by {percent(effect.changes[name])} ({name} of {effect.scene})"
