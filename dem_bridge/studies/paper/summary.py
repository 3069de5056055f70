"""Page one: the answer in five sentences, and what it does not answer."""

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

#: beside what no page of this kind shows
NOT_VERIFIED = (
    "The experiments of the paper (figures 2b, 2d, the measured points of figure 3): there are no data of them here, so"
    " nothing is validated. What they are said to show is put to simulations only.",
    "Contacts at small angles: where the contact ellipse is longer than a cylinder is high neither stiffness law holds."
    " The claim point-contact says from which angle on, the tables of contacts which.",
    "Dissipation, exponents other than 5/2 and the scatter of angles have no values in the paper: those taken here are"
    " stated, and their effects scale with them.",
)
#: claims on what is printed, and others, as they are called where they do not hold
SLIPS = {
    "striker-mass": "the striker's mass",
    "stiffness-90-degrees": "the stiffness at 90 degrees",
    "weight": "the weight of the chain",
    "compression": "the largest compression, with v for v^2",
}
PHYSICAL = {
    "point-contact": "that contacts are Hertz' down to 2 degrees",
    "gravity-neglected": "that gravity may be neglected",
    "velocity-by-bca": "the velocity that binary collisions give",
    "tapered": "that the front of a tapered chain changes its kinetic energy",
}


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
            and v.outcome is not Outcome.NOT_RUN
            and v.reference == reference
            and (v.backend == study.engine if backend_is_engine else v.backend == SCIPY)
            and math.isfinite(v.difference)
        ]
        return max(found, default=math.nan)

    error, same, two = worst(True, REFERENCE), worst(True, POSITIONAL), worst(False, REFERENCE)
    # where the reference is the second one's own answer there is nothing to compare
    both = [study.scene.name for study in studies if math.isfinite(worst(False, REFERENCE, [study.scene.name]))]
    everywhere = worst(False, REFERENCE, both)
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
        f" due to the time step, for the same algorithm in another code agrees with it to {same:.1e}; the two"
        f" references, which share no method, agree to {two:.1e} there and to {everywhere:.1e} on the {len(both)}"
        f" scenes, of {len(studies)}, that both can solve."
    )


def _count(claims: Sequence[Claim]) -> str:
    counts = Counter(one.outcome for one in claims)
    parts = (
        (Outcome.PASS, "hold", "holds"),
        (Outcome.FAIL, "do not", "does not"),
        (
            Outcome.MODEL_DIFFERENCE,
            "are on approximations: a number",
            "is on an approximation: a number",
        ),
        (Outcome.UNDECIDED, "cannot be decided", "cannot be decided"),
        (Outcome.NOT_RUN, "were not run", "was not run"),
    )
    words = [f"{n} {one if n == 1 else many}" for outcome, many, one in parts if (n := counts[outcome])]
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
        f"The approach holds in what it is for: the wave slows down to {low:.2f} of its speed in the one chain and"
        f" speeds up to {high:.2f} times it in the other, and binary collisions say when it arrives to"
        f" {percent(max(away, default=math.nan))}; what they say of velocities ({said:.2f} m/s where cylinders reach"
        f" {real:.2f} m/s) and of the size of forces does not hold."
    )


def _where_not(claims: Sequence[Claim]) -> str:
    failed = [one.id for one in claims if one.outcome is Outcome.FAIL]
    if not failed:
        return "No claim was found not to hold."
    slips = [SLIPS[id] for id in failed if id in SLIPS]
    physics = [PHYSICAL.get(id, id.replace("-", " ")) for id in failed if id not in SLIPS]
    groups = (("printed numbers and formulas", slips), ("statements of physics", physics))
    words = [f"{len(found)} {kind} ({'; '.join(found)})" for kind, found in groups if found]
    return f"What does not hold: {' and '.join(words)}; the claims say by how much, the budget what it matters."


def _largest(effects: Sequence[Effect]) -> str:
    def of(*kinds: str, id: str | None = None) -> Effect | None:
        fitting = [e for e in effects if (e.id == id if id else e.kind in kinds) and math.isfinite(e.largest)]
        return max(fitting, key=lambda one: one.largest, default=None)

    whole, model, law = of(THEORY, PHYSICS, PARAMETER, SUPPOSED), of(PHYSICS, PARAMETER), of(id="exact-stiffness")
    supposed, numerics = of(SUPPOSED), of(id="lammps")
    if whole is None or model is None or law is None or supposed is None:
        return "There is no budget without runs."
    said = "LAMMPS has not run" if numerics is None else f"the numerics of LAMMPS are {percent(numerics.largest)}"
    return (
        f"The largest term of the whole budget is {_named(whole)}; of the model and its parameters it is"
        f" {_named(model)}, while the stiffness law, 17.8 % too stiff at 2 degrees, changes up to"
        f" {percent(law.largest)}; of what the paper only suspects, with values that are ours, it is"
        f" {_named(supposed)}; {said}."
    )


def _named(one: Effect) -> str:
    name = max(one.changes, key=lambda key: abs(one.changes[key]) if math.isfinite(one.changes[key]) else 0.0)
    return f"{one.what}, by {percent(one.changes[name])} ({name} of {one.scene})"
