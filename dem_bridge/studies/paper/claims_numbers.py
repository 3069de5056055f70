"""Claims of sections 2 and 3: printed numbers, beside the values that follow from the other printed numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from dem_bridge.geometry import Elastic
from dem_bridge.physics.contact import cylinder_stiffness_paper
from dem_bridge.physics.hertz import crossed_cylinders, sphere_on_cylinder
from dem_bridge.scene import Scene
from dem_bridge.studies.model_hierarchy.model_terms import GRAVITY, quartz_sphere
from dem_bridge.studies.paper.claims import Limits, claim, exact, printed, together
from dem_bridge.studies.paper.effects import AS_IS, relative_changes
from dem_bridge.studies.paper.measures import Measure, at_body, inside
from dem_bridge.studies.paper.runs import DECELERATING, MAIN, Runs
from dem_bridge.studies.paper.texts import CLAIMS
from dem_bridge.studies.paper.validity import contact_validity
from dem_bridge.studies.study import Claim, ClaimValue
from dem_bridge.trajectory import Trajectory
from dem_bridge.verification.roles import REFERENCE
from dem_bridge.verification.verdict import Outcome

#: relative change of an observable of the first passage that counts as negligible
NEGLIGIBLE = 0.01
#: the paper's section 2: fused quartz, r = 9 mm
RADIUS, QUARTZ = 9e-3, Elastic(young=72e9, poisson=0.17)
#: the velocity that the paper gives all cylinders, m/s
BCA_VELOCITY = 0.713


def numbers(runs: Runs) -> Iterator[Claim]:
    """Yield the claims on printed numbers in the order of the paper."""
    scene = runs.scenes[DECELERATING]
    mass = quartz_sphere(scene)
    yield _formula("striker-mass", mass, grams=1e3 * mass)
    for angle in (2, 90):
        yield _formula(f"stiffness-{angle}-degrees", cylinder_stiffness_paper(float(angle), radius=RADIUS, **QUARTZ))
    yield _approximation()
    yield _formula("striker-stiffness", sphere_on_cylinder(radius=RADIUS, radius2=RADIUS, **QUARTZ).stiffness)
    yield _point_contact(runs)
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


def _point_contact(runs: Runs) -> Claim:
    """Compare the contact ellipse at the peak force, by the exact law, with the height of the cylinders."""
    values, each = [], []
    for name in MAIN:
        scene, truth = runs.scenes[name], runs.truth(name)
        if truth is None:
            continue
        # without the striker's
        contacts = [contact_validity(scene, truth, k) for k in range(1, scene.n_body - 1)]
        longest = max(contact.over_half_height for contact in contacts)
        beyond = [contact.angle for contact in contacts if contact.over_half_height > 1.0]
        values.append(ClaimValue(name=f"semi-major axis over half-height, {name}", backend=REFERENCE, value=longest))
        words = f" and beyond 1 in {len(beyond)} contacts, up to {max(beyond):.2f} degrees" if beyond else ""
        each.append({"chain": name, "longest": longest, "beyond": words})
    return claim("point-contact", together(*(inside(value, 0.0, 1.0) for value in values)), values, each=each)


def _gravity_load(runs: Runs) -> Claim:
    def least_force(scene: Scene, run: Trajectory) -> float:
        return float(min(run.peak_force[1 : scene.n_body - 1])) / _weight(scene)

    measure = Measure(name="least peak force over the weight", of=least_force, made_of=("peak_force",))
    limits = Limits(id="gravity-load", measure=measure, chains=MAIN, low=10.0**1.5)
    return limits.judge(runs, load=_weight(runs.scenes[DECELERATING]))


def _gravity_neglected(runs: Runs) -> Claim:
    changed, each = [], []
    for name in MAIN:
        base, weighing = runs.truth(f"{name}.{AS_IS}"), runs.truth(f"{name}.gravity")
        if base is None or weighing is None:
            continue
        changes = relative_changes(runs.scenes[name], base, weighing)
        worst = max(changes, key=lambda key: abs(changes[key]))
        each.append({"chain": name, "observable": worst, "change": changes[worst]})
        changed += [
            ClaimValue(name=f"{key}, with gravity over without, {name}", backend="reference", value=1.0 + change)
            for key, change in changes.items()
        ]
    small = all(abs(item.value - 1.0) < NEGLIGIBLE for item in changed)
    outcome = Outcome.NOT_RUN if not changed else Outcome.PASS if small else Outcome.FAIL
    return claim("gravity-neglected", outcome, changed, each=each, tolerance=NEGLIGIBLE)
