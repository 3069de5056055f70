"""Page one of the report: the answer in five sentences, and what was not verified."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from dem_bridge.studies.paper.claims import by, percent
from dem_bridge.studies.paper.effects import PARAMETER, PHYSICS, SUPPOSED, THEORY, Effect
from dem_bridge.studies.paper.runs import MAIN
from dem_bridge.studies.study import Claim
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.roles import POSITIONAL, REFERENCE, SCIPY
from dem_bridge.verification.verdict import Outcome

#: limits of this report, in addition to those of every report
NOT_VERIFIED = (
    "The experiments of the paper (figures 2b and 2d, the measured points of figure 3): no measured data are available"
    " here, so nothing is validated. Statements about experiments are tested by simulations only.",
    "Contacts at small angles: where the contact ellipse is longer than the cylinder is high, neither stiffness law is"
    " valid. The claim point-contact gives the angle, and the tables of contacts list the contacts.",
    "Dissipation, exponents other than 5/2 and the scatter of angles: the paper gives no values. The values assumed"
    " here"
    " are stated, and their effects scale with them.",
)
#: names of the claims on printed numbers and formulas, and of other claims, for the list of those that do not hold
SLIPS = {
    "striker-mass": "the striker's mass",
    "stiffness-90-degrees": "the stiffness at 90 degrees",
    "weight": "the weight of the chain",
    "compression": "the largest compression, with v for v^2",
}
PHYSICAL = {
    "point-contact": "Hertz point contact down to 2 degrees",
    "gravity-neglected": "the neglect of gravity",
    "velocity-by-bca": "peak velocities by binary collisions",
    "tapered": "a change of the front's kinetic energy in tapered chains",
}


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
    if math.isnan(error):
        return (
            "LAMMPS was not run on the paper's two chains; the two references agree to"
            f" {everywhere:.1e} on the other runs."
        )
    wrong = Counter(v.outcome for study in studies for v in study.verdicts)
    if wrong[Outcome.FAIL] or wrong[Outcome.BROKEN]:
        return (
            f"The codes are not verified: of {wrong.total()} verdicts {wrong[Outcome.FAIL]} are FAIL and"
            f" {wrong[Outcome.BROKEN]} are BROKEN because a run failed; the table of verdicts lists them."
        )
    return (
        f"LAMMPS integrates the equations of motion correctly: on the paper's two chains its velocities differ from the"
        f" reference solution by at most {error:.1e} of the peak velocity, all of it time-discretisation error, because"
        f" the same algorithm in another code agrees with LAMMPS to {same:.1e}. Two independent reference integrators"
        f" agree to {two:.1e} on these chains and to {everywhere:.1e} on all {len(both)} (of {len(studies)}) scenes"
        " that"
        " both can solve."
    )


def _count(claims: Sequence[Claim]) -> str:
    counts = Counter(claim.outcome for claim in claims)
    parts = (
        (Outcome.PASS, "hold", "holds"),
        (Outcome.FAIL, "do not", "does not"),
        (
            Outcome.MODEL_DIFFERENCE,
            "concern approximations, whose error is given as a number",
            "concerns an approximation, whose error is given as a number",
        ),
        (Outcome.UNDECIDED, "cannot be decided", "cannot be decided"),
        (Outcome.NOT_RUN, "were not run", "was not run"),
    )
    words = [f"{n} {singular if n == 1 else plural}" for outcome, plural, singular in parts if (n := counts[outcome])]
    return f"Of {len(claims)} claims of the paper, {', '.join(words)}."


def _theory(claims: Sequence[Claim]) -> str:
    by_id = {claim.id: claim for claim in claims}
    slow, fast = by_id.get("decelerates"), by_id.get("accelerates")
    if slow is None or fast is None or Outcome.NOT_RUN in (slow.outcome, fast.outcome):
        return "The reference did not run on both chains of the paper."
    velocity = by_id["velocity-by-bca"]
    low, high = (by(claim.values).value for claim in (slow, fast))
    real = by(velocity.values).value
    said = by(velocity.values, "bca").value
    ends = [v for v in by_id["arrival-by-bca"].values if v.backend in (REFERENCE, "bca")]
    away = [
        abs(theory.value / reference.value - 1.0)
        for reference, theory in zip(ends[::2], ends[1::2], strict=True)
        if reference.value > 0.0
    ]
    return (
        f"The paper's central result is reproduced: the wave slows down to {low:.2f} of its initial speed in the"
        f" decelerating chain and speeds up to {high:.2f} times its initial speed in the accelerating one, and the BCA"
        f" predicts the arrival times within {percent(max(away, default=math.nan))}. The BCA does not predict"
        " amplitudes:"
        f" it gives peak velocities of {said:.2f} m/s (simulated: {real:.2f} m/s) and does not give the peak forces."
    )


def _where_not(claims: Sequence[Claim]) -> str:
    failed = [claim.id for claim in claims if claim.outcome is Outcome.FAIL]
    if not failed:
        return "All claims hold that could be decided."
    slips = [SLIPS[id] for id in failed if id in SLIPS]
    physics = [PHYSICAL.get(id, id.replace("-", " ")) for id in failed if id not in SLIPS]
    groups = (("printed numbers and formulas", slips), ("statements of physics", physics))
    words = [f"{len(names)} {kind} ({'; '.join(names)})" for kind, names in groups if names]
    return (
        f"These claims do not hold: {' and '.join(words)}. The table of claims lists the discrepancies; the budget"
        " gives"
        " their effect on the predictions."
    )


def _largest(effects: Sequence[Effect]) -> str:
    def of(*kinds: str, id: str | None = None) -> Effect | None:
        fitting = [e for e in effects if (e.id == id if id else e.kind in kinds) and math.isfinite(e.largest)]
        return max(fitting, key=lambda effect: effect.largest, default=None)

    whole, model, law = of(THEORY, PHYSICS, PARAMETER, SUPPOSED), of(PHYSICS, PARAMETER), of(id="exact-stiffness")
    supposed, numerics = of(SUPPOSED), of(id="lammps")
    if whole is None or model is None or law is None or supposed is None:
        return "There is no error budget, because runs are missing."
    said = "LAMMPS was not run" if numerics is None else f"the numerical error of LAMMPS is {percent(numerics.largest)}"
    return (
        f"The largest term of the whole error budget is {_named(whole)}. Of the model and its parameters it is"
        f" {_named(model)}; the stiffness law, 17.8 % too stiff at 2 degrees, changes results by up to"
        f" {percent(law.largest)}. Of the effects that the paper only conjectures, with values assumed by us, the"
        " largest is"
        f" {_named(supposed)}; {said}."
    )


def _named(effect: Effect) -> str:
    name = max(effect.changes, key=lambda key: abs(effect.changes[key]) if math.isfinite(effect.changes[key]) else 0.0)
    return f"{effect.what}, by {percent(effect.changes[name])} ({name} of {effect.scene})"
