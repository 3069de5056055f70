"""Claims of sections 2 and 3: printed numbers, beside the values that follow from the other printed numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from dem_bridge.observables.pulse import pulse_width_by_force
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.observables.verdict import Outcome
from dem_bridge.physics.contact_ellipse import cylinder_stiffness_paper
from dem_bridge.physics.hertz import crossed_cylinders, sphere_on_cylinder
from dem_bridge.report.study import Claim, ClaimValue
from dem_bridge.scene.geometry import Elastic
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.model_hierarchy.model_terms import GRAVITY, quartz_sphere
from dem_bridge.studies.paper.claims import FORMULAS, PRINTED, Limits, claim, exact, printed, together
from dem_bridge.studies.paper.effects import relative_changes
from dem_bridge.studies.paper.measures import Measure, at_body, inside
from dem_bridge.studies.paper.runs import DECELERATING, MAIN, Runs
from dem_bridge.studies.paper.runs import WEIGHED as WEIGHED_RUNS
from dem_bridge.studies.paper.validity import JUDGED, LEAST, contact_validity
from dem_bridge.trajectory.trajectory import Trajectory
from dem_bridge.verification.reference_choice import REFERENCE

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
#: what follows where an assumption is beyond its limit
BEYOND = {"point-contact": Outcome.FAIL, "edge-tension": Outcome.UNDECIDED}
#: the velocity that the paper gives all cylinders, m/s
BCA_VELOCITY = 0.713
AT_MIDDLE = at_body("peak_velocity", 20, "peak velocity of cylinder 20")
#: times of sound across a cylinder that a contact should last (no author gives a number), and the share of its peak
#: from which a contact in a chain counts as loaded: without gaps every contact has some force from the impact on
CROSSINGS, LOADED = 10.0, 0.01
#: cylinders over which the effect of weight on single cylinders is read, the first and the last
SINGLE = slice(5, 38)
#: claim -> the assumption that it is about, the first contact that counts, and the names of its values
VALIDITY = {
    "point-contact": ("over half-height", 1, ("ellipses beyond the cylinder", "longest ellipse")),
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
    point, tension = (
        _validity(runs, id, assumption, first=first, names=names) for id, (assumption, first, names) in VALIDITY.items()
    )
    yield from (point, _lumped_mass(runs), tension)
    yield _formula("weight", weight_of(scene), count=scene.n_body - 1, grams=1e3 * scene.mass[1])
    yield _gravity_load(runs)
    yield _gravity_neglected(runs)
    limits = Limits(
        id="velocity-by-bca",
        measure=AT_MIDDLE,
        chains=MAIN,
        low=0.95 * BCA_VELOCITY,
        high=1.05 * BCA_VELOCITY,
    )
    causes = _causes_of_velocity(runs)
    values = [
        ClaimValue(name=f"factor of {what}, {DECELERATING}", backend=REFERENCE, value=causes[key])
        for key, what in (("width", "the pulse's width"), ("second", "the second pulse"))
        if causes is not None
    ]
    yield limits.judge(runs, *values, more=causes)


def _formula(id: str, result: float, **numbers: Any) -> Claim:
    """Return the claim on a printed number that must be the rounded result of a formula."""
    number = printed(**PRINTED[id])
    value, half = exact(FORMULAS[id], result, number.unit), number.uncertainty
    outcome = inside(value, number.value - half, number.value + half)
    off = result / number.value - 1.0
    return claim(id, outcome, number, value, result=result, off=off, less=-off, ratio=1.0 + off, **numbers)


def weight_of(scene: Scene) -> float:
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
        # an ellipse beyond the body is no Hertz contact, but a design strength is no criterion for cracks
        outcomes.append(Outcome.PASS if not beyond else BEYOND[id])
    largest: dict[str, Any] = {
        key: max((float(item[key]) for item in each), default=math.nan) for key in ("worst", "inner", "limit")
    }
    return claim(id, together(*outcomes), values, each=each, **largest)


def _lumped_mass(runs: Runs) -> Claim:
    """Return the times of contact in units of sound crossings, of isolated collisions and in the chain."""
    values: list[ClaimValue] = []
    each: list[dict[str, Any]] = []
    for name in MAIN:
        scene, truth = runs.scenes[name], runs.truth(name)
        if truth is None:
            continue
        contacts = [contact_validity(scene, truth, k) for k in range(scene.n_body - 1)]
        alone = np.array([contact.judged[list(JUDGED).index(LEAST)].ratio for contact in contacts])
        width = pulse_width_by_force(scene, truth, share=LOADED)
        loaded = (width.fall - width.rise) / np.array([contact.crossing for contact in contacts])
        numbers = {
            "count": float(np.sum(alone < CROSSINGS)),
            "worst": float(np.min(alone)),
            "in_chain": float(np.sum(loaded < CROSSINGS)),
            "shortest": float(np.nanmin(loaded)),
            "least_energy": min(contact.vibration for contact in contacts),
            "energy": max(contact.vibration for contact in contacts),
        }
        each.append({"chain": name, "of": len(contacts), **numbers})
        values += [
            ClaimValue(name=f"{label}, {name}", backend=REFERENCE, value=numbers[key])
            for key, label in {
                "count": "contacts below ten crossings, two bodies",
                "worst": "fewest crossings, two bodies",
                "in_chain": "contacts below ten crossings, in the chain",
                "shortest": "fewest crossings, in the chain",
                "energy": "largest share of energy in vibration (Hunter)",
            }.items()
        ]
    outcome = Outcome.MODEL_DIFFERENCE if each else Outcome.NOT_RUN
    shares = [float(item[key]) for item in each for key in ("least_energy", "energy")] or [math.nan]
    sizes: dict[str, Any] = {"limit": CROSSINGS, "least_energy": min(shares), "energy": max(shares)}
    return claim("lumped-mass", outcome, values, each=each, **sizes)


def _causes_of_velocity(runs: Runs) -> dict[str, float] | None:
    """Return by which factors eq. 3.5 is too large in the decelerating chain, and why; None where runs are missing.

    Without the mismatch of stiffness there is one pulse, so that only its width separates it from eq. 3.5.
    """
    matched, chain = f"{DECELERATING}.matched-stiffness", DECELERATING
    if not (runs.has(matched) and runs.has(chain)):
        return None
    alone, both = (AT_MIDDLE.of(runs.scenes[name], _truth(runs, name)) for name in (matched, chain))
    return {"width": BCA_VELOCITY / alone, "second": alone / both}


def _truth(runs: Runs, name: str) -> Trajectory:
    truth = runs.truth(name)
    assert truth is not None
    return truth


def _single_cylinders(runs: Runs, chain: str) -> dict[str, float]:
    """Return by how much the weight changes three observables of single cylinders at most, relative, by name."""
    changes, names = {}, [f"{chain}.{variant}" for variant in WEIGHED_RUNS]
    for name in ("front_speed", "residence_time", "peak_velocity"):
        read = OBSERVABLES[name].value
        before, after = (read(runs.scenes[run], _truth(runs, run))[SINGLE] for run in names)
        changes[name.replace("_", " ")] = float(np.max(np.abs(after / before - 1.0)))
    return changes


def _gravity_load(runs: Runs) -> Claim:
    def least_force(scene: Scene, run: Trajectory) -> float:
        return float(min(run.peak_force[1 : scene.n_body - 1])) / weight_of(scene)

    measure = Measure(name="least peak force over the weight", of=least_force, made_of=("peak_force",))
    limits = Limits(id="gravity-load", measure=measure, chains=MAIN, low=TWO_ORDERS)
    return limits.judge(runs, load=weight_of(runs.scenes[DECELERATING]))


def _gravity_neglected(runs: Runs) -> Claim:
    """Compare the stack with the same chain on a base without weight."""
    changed: list[ClaimValue] = []
    each: list[dict[str, Any]] = []
    largest: list[float] = []
    for name in MAIN:
        base, weighing = (runs.truth(f"{name}.{variant}") for variant in WEIGHED_RUNS)
        if base is None or weighing is None:
            continue
        # the largest force of all depends on the base, where the front ends
        changes = relative_changes(runs.scenes[name], base, weighing)
        changes = {key: changes[key] for key in WEIGHED}
        single = _single_cylinders(runs, name)
        largest += single.values()
        each.append({"chain": name, **{key.split()[0]: change for key, change in changes.items()}})
        changed += [
            ClaimValue(name=f"{key}, {name}", backend=REFERENCE, value=1.0 + change)
            for key, change in (
                changes | {f"largest change of {key}": change for key, change in single.items()}
            ).items()
        ]
    outcome = Outcome.MODEL_DIFFERENCE if changed else Outcome.NOT_RUN
    numbers: dict[str, Any] = {"two_orders": 1.0 / TWO_ORDERS, "largest": max(largest, default=math.nan)}
    return claim("gravity-neglected", outcome, changed, each=each, **numbers)
