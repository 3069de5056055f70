"""Page one: the answer in five sentences, and what it does not answer."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from dem_bridge.studies.checks import POSITIONAL, REFERENCE, SECOND
from dem_bridge.studies.exhibits import Claim
from dem_bridge.studies.paper.claims import by, percent
from dem_bridge.studies.paper.effects import NUMERICS, PARAMETER, PHYSICS, THEORY, Effect
from dem_bridge.studies.paper.runs import MAIN
from dem_bridge.studies.verify import SceneStudy
from dem_bridge.verdict import Outcome

#: beside what no page of this kind shows
NOT_VERIFIED = (
    "The experiments of the paper (figures 2b, 2d, the measured points of figure 3): there are no data of them here, so"
    " nothing is validated. What they are said to show is put to simulations only.",
    "Contacts at small angles: below about 3 degrees the contact ellipse is longer than a cylinder is high, and neither"
    " stiffness law holds. The table of contacts says which.",
    "Dissipation, exponents other than 5/2 and the scatter of angles have no values in the paper: those taken here are"
    " stated, and their effects scale with them.",
)


def answer(claims: Sequence[Claim], effects: Sequence[Effect], studies: Sequence[SceneStudy]) -> tuple[str, ...]:
    """Five sentences, each with its number."""
    return (
        _codes(studies),
        _count(claims),
        _theory(claims),
        _where_not(claims),
        _largest(effects),
    )


def _codes(studies: Sequence[SceneStudy]) -> str:
    def worst(backend_is_engine: bool, reference: str, names: Sequence[str] = MAIN) -> float:
        found = [
            v.difference
            for study in studies
            if study.scene.name in names
            for v in study.verdicts
            if v.quantity == "velocity"
            and v.reference == reference
            and (v.backend == study.engine if backend_is_engine else v.backend == SECOND)
            and math.isfinite(v.difference)
        ]
        return max(found, default=math.nan)

    error, same, two = worst(True, REFERENCE), worst(True, POSITIONAL), worst(False, REFERENCE)
    everywhere = worst(False, REFERENCE, [study.scene.name for study in studies])
    if math.isnan(error):
        return f"LAMMPS has not run the paper's two chains; the two references agree to {everywhere:.1e} on what has."
    wrong = Counter(v.outcome for study in studies for v in study.verdicts)
    if wrong[Outcome.FAIL] or wrong[Outcome.BROKEN]:
        return (
            f"The codes are not shown to be right: of {wrong.total()} verdicts {wrong[Outcome.FAIL]} fail and"
            f" {wrong[Outcome.BROKEN]} could not be told, for runs broke; the table of verdicts says which."
        )
    return (
        f"The codes are right: LAMMPS solves the paper's two chains to {error:.1e} of the largest velocity, all of it"
        " the"
        f" time step, for the same algorithm in another code has the same to {same:.1e}; the two references, which"
        " share"
        f" no method, agree to {two:.1e} there and to {everywhere:.1e} on all {len(studies)} scenes."
    )


def _count(claims: Sequence[Claim]) -> str:
    counts = Counter(one.outcome for one in claims)
    parts = (
        (Outcome.PASS, "hold"),
        (Outcome.FAIL, "do not"),
        (Outcome.MODEL_DIFFERENCE, "are statements about an approximation, for which a number is given"),
        (Outcome.UNDECIDED, "cannot be decided"),
        (Outcome.NOT_RUN, "were not run"),
    )
    words = [f"{counts[outcome]} {text}" for outcome, text in parts if counts[outcome]]
    return f"Of {len(claims)} claims of the paper, {', '.join(words)}."


def _theory(claims: Sequence[Claim]) -> str:
    known = {one.id: one for one in claims}
    slow, fast = known.get("decelerates"), known.get("accelerates")
    if slow is None or fast is None or Outcome.NOT_RUN in (slow.outcome, fast.outcome):
        return "The paper's two chains have not both run."
    velocity = known["velocity-by-bca"]
    low, high = (by(one.values).value for one in (slow, fast))
    real = by(velocity.values).value
    said = by(velocity.values, "bca").value
    ends = [v for v in known["arrival-by-bca"].values if v.backend in (REFERENCE, "bca")]
    away = [
        abs(theory.value / truth.value - 1.0)
        for truth, theory in zip(ends[::2], ends[1::2], strict=True)
        if truth.value > 0.0
    ]
    return (
        f"The approach holds in what it is for: the wave slows down to {low:.2f} and speeds up to {high:.2f} of its"
        f" speed, and binary collisions say when it arrives to {percent(max(away, default=math.nan))}; what they say of"
        f" velocities ({said:.2f} where cylinders reach {real:.2f} m/s) and of forces does not hold."
    )


def _where_not(claims: Sequence[Claim]) -> str:
    failed = [one.id.replace("-", " ") for one in claims if one.outcome is Outcome.FAIL]
    if not failed:
        return "No claim was found not to hold."
    return f"What does not hold: {', '.join(failed)}; the claims table says by how much, the budget what it matters."


def _largest(effects: Sequence[Effect]) -> str:
    def of(*kinds: str, id: str | None = None) -> Effect | None:
        fitting = [e for e in effects if e.kind in kinds and id in (None, e.id) and math.isfinite(e.largest)]
        return max(fitting, key=lambda one: one.largest, default=None)

    model, law, numerics = of(PHYSICS, PARAMETER), of(PHYSICS, id="exact-stiffness"), of(NUMERICS, id="lammps")
    theory = of(THEORY)
    if model is None or law is None or numerics is None or theory is None:
        return "There is no budget without runs."
    return (
        f"The largest term of the whole budget is the theory's ({_named(theory)}); of the model and its parameters it"
        " is"
        f" this: {_named(model)}; the stiffness law, off by 17.8 % at 2 degrees, changes up to {percent(law.largest)},"
        " and"
        f" the numerics of LAMMPS {numerics.largest:.1e}."
    )


def _named(one: Effect) -> str:
    name = max(one.changes, key=lambda key: abs(one.changes[key]) if math.isfinite(one.changes[key]) else 0.0)
    return f"{one.what} changes the {name} of {one.scene} by {percent(one.changes[name])}"
