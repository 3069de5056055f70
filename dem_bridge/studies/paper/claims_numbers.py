"""Claims of sections 2 and 3: printed numbers, beside the values that follow from the other printed numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from dem_bridge.geometry import Elastic
from dem_bridge.physics.contact import cylinder_stiffness_paper
from dem_bridge.physics.hertz import crossed_cylinders, sphere_on_cylinder
from dem_bridge.scene import Scene
from dem_bridge.studies.model_hierarchy.model_terms import GRAVITY, quartz_sphere
from dem_bridge.studies.paper.claims import Limits, claim, exact, printed, together
from dem_bridge.studies.paper.effects import relative_changes
from dem_bridge.studies.paper.measures import Measure, at_body, inside
from dem_bridge.studies.paper.runs import DECELERATING, MAIN, Runs
from dem_bridge.studies.paper.texts import CLAIMS
from dem_bridge.studies.paper.validity import JUDGED, LEAST, contact_validity
from dem_bridge.studies.study import Claim, ClaimValue
from dem_bridge.trajectory import Trajectory
from dem_bridge.verification.roles import REFERENCE
from dem_bridge.verification.verdict import Outcome

#: accuracy at which the study asks what may be left out of the paper's chains
NEGLIGIBLE = 0.01
#: the least ratio that rounds to two orders of magnitude
TWO_ORDERS = 10.0**1.5
#: observables of the first passage on which the weight acts before the base does
WEIGHED = ("arrival at the last cylinder", "speed at the middle", "force at the middle")
#: density of crystalline quartz, kg/m^3 (CRC Handbook of Chemistry and Physics: 2648 to 2651)
CRYSTALLINE = 2650.0
#: the paper's section 2: fused quartz, r = 9 mm
RADIUS, QUARTZ = 9e-3, Elastic(young=72e9, poisson=0.17)
#: the velocity that the paper gives all cylinders, m/s
BCA_VELOCITY = 0.713
#: claim -> the assumption that it is about, the first contact that counts, and the names of its values
VALIDITY = {
    "point-contact": ("over half-height", 1, ("ellipses beyond the cylinder", "longest ellipse")),
    "lumped-mass": (LEAST, 0, ("contacts below ten crossings", "fewest crossings")),
    "edge-tension": (
        "edge tension over tensile strength",
        0,
        ("contacts above the strength", "largest tension over strength"),
    ),
}


def numbers(runs: Runs) -> Iterator[Claim]:
    """Yield the claims on printed numbers in the order of the paper."""
    scene = runs.scenes[DECELERATING]
    volume = 4.0 / 3.0 * math.pi * RADIUS**3
    mass, fused = volume * CRYSTALLINE, quartz_sphere(scene)
    yield _formula("striker-mass", mass, grams=1e3 * mass, fused=1e3 * fused, density=CRYSTALLINE)
    for angle in (2, 90):
        yield _formula(f"stiffness-{angle}-degrees", cylinder_stiffness_paper(float(angle), radius=RADIUS, **QUARTZ))
    yield _approximation()
    yield _formula("striker-stiffness", sphere_on_cylinder(radius=RADIUS, radius2=RADIUS, **QUARTZ).stiffness)
    for id, (assumption, first, names) in VALIDITY.items():
        yield _validity(runs, id, assumption, first=first, names=names)
    yield _formula("weight", _weight(scene), count=scene.n_body - 1, grams=1e3 * scene.mass[1])
    yield _gravity_load(runs)
    yield _gravity_neglected(runs)
    yield Limits(
        id="velocity-by-bca",
        measure=at_body("peak_velocity", 20, "peak velocity of cylinder 20"),
        chains=MAIN,
        low=0.95 * BCA_VELOCITY,
        high=1.05 * BCA_VELOCITY,
    ).judge(runs)


def _formula(id: str, result: float, **numbers: Any) -> Claim:
    """Return the claim on a printed number that must be the rounded result of a formula."""
    number = printed(**CLAIMS[id]["printed"])
    value, half = exact(CLAIMS[id]["formula"], result, number.unit), number.uncertainty
    outcome = inside(value, number.value - half, number.value + half)
    off = result / number.value - 1.0
    return claim(id, outcome, number, value, result=result, off=off, less=-off, ratio=1.0 + off, **numbers)


def _weight(scene: Scene) -> float:
    """Return the weight of the cylinders, N."""
    return GRAVITY * sum(scene.mass[1:])


def _approximation() -> Claim:
    ratios = {
        angle: cylinder_stiffness_paper(angle, radius=RADIUS, **QUARTZ)
        / crossed_cylinders(angle=angle, radius=RADIUS, law="exact", **QUARTZ).stiffness
        for angle in (2.0, 10.0, 30.0, 60.0)
    }
    return claim(
        "axis-ratio",
        Outcome.MODEL_DIFFERENCE,
        *(exact(f"eq. 3.1 over exact, {angle:g} degrees", ratio, "") for angle, ratio in ratios.items()),
        each=[{"excess": ratio - 1.0, "angle": angle} for angle, ratio in ratios.items()],
    )


def _validity(runs: Runs, id: str, assumption: str, *, first: int, names: tuple[str, str]) -> Claim:
    """Compare one ratio of :mod:`.validity` with its limit in all contacts from ``first`` on of both chains.

    ``names``: of the number of contacts beyond the limit, and of the worst ratio.
    """
    values, outcomes = [], []
    each: list[dict[str, Any]] = []
    place = list(JUDGED).index(assumption)
    for name in MAIN:
        scene, truth = runs.scenes[name], runs.truth(name)
        if truth is None:
            continue
        contacts = [contact_validity(scene, truth, k) for k in range(first, scene.n_body - 1)]
        judged = [contact.judged[place] for contact in contacts]
        beyond = [contact for contact, item in zip(contacts, judged, strict=True) if not item.holds]
        worst, inner = ((min if assumption == LEAST else max)(item.ratio for item in judged[k:]) for k in (0, 1))
        for label, value in zip(names, (float(len(beyond)), worst), strict=True):
            values.append(ClaimValue(name=f"{label}, {name}", backend=REFERENCE, value=value))
        angles = [contact.angle for contact in beyond if math.isfinite(contact.angle)]
        upto = f", at angles up to {max(angles):.2f} degrees" if angles else ""
        numbers = {"count": len(beyond), "of": len(contacts), "worst": worst, "inner": inner, "limit": judged[0].limit}
        each.append({"chain": name, "upto": upto, **numbers})
        outcomes.append(Outcome.FAIL if beyond else Outcome.PASS)
    largest = {key: max((float(item[key]) for item in each), default=math.nan) for key in ("worst", "inner", "limit")}
    return claim(id, together(*outcomes), values, each=each, **largest)


def _gravity_load(runs: Runs) -> Claim:
    def least_force(scene: Scene, run: Trajectory) -> float:
        return float(min(run.peak_force[1 : scene.n_body - 1])) / _weight(scene)

    measure = Measure(name="least peak force over the weight", of=least_force, made_of=("peak_force",))
    limits = Limits(id="gravity-load", measure=measure, chains=MAIN, low=TWO_ORDERS)
    return limits.judge(runs, load=_weight(runs.scenes[DECELERATING]))


def _gravity_neglected(runs: Runs) -> Claim:
    """Compare the stack with the same chain on a base without weight."""
    changed, each = [], []
    for name in MAIN:
        base, weighing = runs.truth(f"{name}.base"), runs.truth(f"{name}.gravity")
        if base is None or weighing is None:
            continue
        # the largest force of all depends on the base, where the front ends
        changes = relative_changes(runs.scenes[name], base, weighing)
        changes = {key: changes[key] for key in WEIGHED}
        each.append({"chain": name, **{key.split()[0]: change for key, change in changes.items()}})
        changed += [
            ClaimValue(name=f"{key}, {name}", backend=REFERENCE, value=1.0 + change) for key, change in changes.items()
        ]
    outcome = Outcome.MODEL_DIFFERENCE if changed else Outcome.NOT_RUN
    return claim("gravity-neglected", outcome, changed, each=each, two_orders=1.0 / TWO_ORDERS)
