"""Claims of sections 2 and 3: printed numbers, beside the values that follow from the other printed numbers."""

from __future__ import annotations

from collections.abc import Iterator

from dem_bridge.geometry import Elastic
from dem_bridge.observables.front import peak_velocity_of_front
from dem_bridge.physics.contact import cylinder_stiffness_paper
from dem_bridge.physics.hertz import crossed_cylinders, sphere_on_cylinder
from dem_bridge.studies.model_hierarchy.model_terms import GRAVITY, quartz_sphere
from dem_bridge.studies.paper.claims import by, claim, decided, exact, heard, percent, printed, together
from dem_bridge.studies.paper.effects import AS_IS, observables
from dem_bridge.studies.paper.measures import Measure, inside
from dem_bridge.studies.paper.runs import DECELERATING, MAIN, Runs
from dem_bridge.studies.paper.validity import contact_validity
from dem_bridge.studies.study import Claim, ClaimValue
from dem_bridge.verification.roles import REFERENCE
from dem_bridge.verification.verdict import Outcome

#: relative change of an observable of the first passage that counts as negligible
NEGLIGIBLE = 0.01
#: the paper's section 2: fused quartz, r = 9 mm
RADIUS, QUARTZ = 9e-3, Elastic(young=72e9, poisson=0.17)


def numbers(runs: Runs) -> Iterator[Claim]:
    """Yield the claims on printed numbers in the order of the paper."""
    yield _striker_mass(runs)
    yield from _stiffness()
    yield _approximation()
    yield _striker_stiffness()
    yield _point_contact(runs)
    yield _weight(runs)
    yield from _gravity(runs)
    yield _bca_velocity(runs)


def _agrees(value: float, claim_value: ClaimValue) -> Outcome:
    """Judge whether a number rounds to the printed one."""
    result = ClaimValue(name="", backend="formula", value=value, uncertainty=0.0)
    return inside(result, claim_value.value - claim_value.uncertainty, claim_value.value + claim_value.uncertainty)


def _striker_mass(runs: Runs) -> Claim:
    mass, companion = (
        quartz_sphere(runs.scenes[DECELERATING]),
        printed("mass of the striker", 8.1e-3, "kg", last_digit=1e-4),
    )
    return claim(
        "striker-mass",
        "section 2",
        "The striker is a quartz sphere of r = 9 mm that weighs 8.1 g.",
        _agrees(mass, companion),
        f"A quartz sphere of r = 9 mm weighs {1e3 * mass:.2f} g, {percent(1.0 - mass / 8.1e-3)} less than printed, so"
        " the"
        " printed radius, density and mass do not agree. The scenes keep the printed mass; the budget lists the effect"
        " of the other mass.",
        companion,
        exact("4/3 pi r^3 rho", mass, "kg"),
    )


def _stiffness() -> Iterator[Claim]:
    for angle, value, digit in ((2.0, 7.27e10, 1e8), (90.0, 4.68e9, 1e7)):
        result = cylinder_stiffness_paper(angle, radius=RADIUS, **QUARTZ)
        companion = printed(f"stiffness at {angle:g} degrees", value, "N/m^1.5", last_digit=digit)
        yield claim(
            f"stiffness-{angle:g}-degrees",
            "section 3, eq. 3.1",
            f"The contact stiffness at {angle:g} degrees is {value:.2e} N/m^1.5.",
            _agrees(result, companion),
            f"Eq. 3.1 gives {result:.6g} N/m^1.5, {percent(result / value - 1.0)} off the printed value."
            + (
                ""
                if angle == 2.0
                else " This is the minimum of eq. 3.1 over all angles, so no angle gives the printed value."
            ),
            companion,
            exact("eq. 3.1", result, "N/m^1.5"),
        )


def _approximation() -> Claim:
    ratios = {
        angle: cylinder_stiffness_paper(angle, radius=RADIUS, **QUARTZ)
        / crossed_cylinders(angle=angle, radius=RADIUS, law="exact", **QUARTZ).stiffness
        for angle in (2.0, 10.0, 30.0, 60.0)
    }
    return claim(
        "axis-ratio",
        "section 3, below eq. 3.1",
        "The axis ratio of the contact ellipse is about [(1 + cos a)/(1 - cos a)]^(-2/3), from which eq. 3.1 gives the"
        " stiffness.",
        Outcome.MODEL_DIFFERENCE,
        "With this axis ratio eq. 3.1 is stiffer than the exact Hertz solution by "
        + ", ".join(f"{percent(ratio - 1.0)} at {angle:g} degrees" for angle, ratio in ratios.items())
        + ". The approximation is worst at the small angles at which the paper's chains start.",
        *(exact(f"eq. 3.1 over exact, {angle:g} degrees", ratio, "") for angle, ratio in ratios.items()),
    )


def _striker_stiffness() -> Claim:
    result = sphere_on_cylinder(radius=RADIUS, radius2=RADIUS, **QUARTZ).stiffness
    companion = printed("beta_0", 3.98e9, "N/m^1.5", last_digit=1e7)
    return claim(
        "striker-stiffness",
        "section 3, below eq. 3.2",
        "The stiffness of the contact of the striker with the first cylinder is 3.98e9 N/m^1.5.",
        _agrees(result, companion),
        f"The exact Hertz law for a sphere on a cylinder gives {result:.6g} N/m^1.5.",
        companion,
        exact("sphere on cylinder, exact", result, "N/m^1.5"),
    )


def _point_contact(runs: Runs) -> Claim:
    """Compare the contact ellipse at the peak force, by the exact law, with the height of the cylinders."""
    values, words = [], []
    for name in MAIN:
        scene, truth = runs.scenes[name], runs.truth(name)
        if truth is None:
            continue
        # without the striker's
        results = [contact_validity(scene, truth, k) for k in range(1, scene.n_body - 1)]
        longest, beyond = (
            max(result.over_half_height for result in results),
            [result for result in results if result.over_half_height > 1.0],
        )
        values.append(ClaimValue(name=f"semi-major axis over half-height, {name}", backend=REFERENCE, value=longest))
        words.append(f"at most {longest:.2f} in {name}")
        if beyond:
            words[-1] += f" and beyond 1 in {len(beyond)} contacts, up to {max(c.angle for c in beyond):.2f} degrees"
    return claim(
        "point-contact",
        "sections 1 and 3",
        "The cylinders interact as in Hertz' law at all angles from 2 to 90 degrees.",
        together(*(inside(value, 0.0, 1.0) for value in values)) if values else Outcome.NOT_RUN,
        "Semi-major axis of the contact ellipse at the peak force over the half-height of a cylinder:"
        f" {'; '.join(words)}. Acceptance criterion (ours): at most 1, because a longer ellipse exceeds the height of"
        " the"
        " cylinder and the contact is no point contact.",
        values,
    )


def _weight(runs: Runs) -> Claim:
    scene = runs.scenes[DECELERATING]
    weight = GRAVITY * sum(scene.mass[1:])
    companion = printed("load at the bottom", 1.6, "N", last_digit=0.1)
    return claim(
        "weight",
        "section 3",
        "The largest compressive load due to gravity is about 1.6 N, at the bottom of the chain.",
        _agrees(weight, companion),
        f"{scene.n_body - 1} cylinders of {1e3 * scene.mass[1]:.2f} g weigh {weight:.2f} N, {weight / 1.6:.1f} times"
        " the printed load.",
        companion,
        exact("m g times 40", weight, "N"),
    )


def _gravity(runs: Runs) -> Iterator[Claim]:
    """Yield the claims on the load of gravity and on its effect."""
    values, words, outcomes, done, changed = [], [], [], [], []
    load = GRAVITY * sum(runs.scenes[DECELERATING].mass[1:])
    for name in MAIN:
        scene = runs.scenes[name]
        base, weighing = runs.truth(f"{name}.{AS_IS}"), runs.truth(f"{name}.gravity")
        if base is None or weighing is None:
            continue
        ratio = Measure(
            name=f"least peak force over the weight, {name}",
            of=lambda s, run: float(min(run.peak_force[1 : s.n_body - 1])) / (GRAVITY * sum(s.mass[1:])),
            made_of=("peak_force",),
        )
        result = heard(runs, name, ratio)
        values.append(result)
        outcomes.append(decided(result, low=10.0**1.5))
        words.append(f"{by(result).value:.0f} times the weight in {name}")
        before, after = observables(scene, base), observables(scene, weighing)
        effects = {key: after[key] / before[key] - 1.0 for key in before}
        worst = max(effects, key=lambda key: abs(effects[key]))
        done.append(f"{name}: the {worst} changes by {percent(effects[worst])}")
        changed += [
            ClaimValue(name=f"{key}, with gravity over without, {name}", backend="reference", value=1.0 + effect)
            for key, effect in effects.items()
        ]
    yield claim(
        "gravity-load",
        "section 3",
        "The load of gravity is about two orders of magnitude below the contact forces.",
        together(*outcomes) if outcomes else Outcome.NOT_RUN,
        f"The smallest peak force is {' and '.join(words)} (the weight is {load:.2f} N, not 1.6 N). Acceptance"
        " criterion"
        " (ours): at least 10^1.5 times, which rounds to two orders of magnitude.",
        *values,
    )
    small = all(abs(item.value - 1.0) < NEGLIGIBLE for item in changed)
    yield claim(
        "gravity-neglected",
        "section 3",
        "The effect of gravity may be neglected.",
        Outcome.NOT_RUN if not changed else Outcome.PASS if small else Outcome.FAIL,
        f"With the weight and its static compression, {'; '.join(done)}. Acceptance criterion (ours): within"
        f" {percent(NEGLIGIBLE)}, which is two orders of magnitude. The static preload stiffens the contacts ahead of"
        " the"
        " pulse and so raises its speed.",
        changed,
    )


def _bca_velocity(runs: Runs) -> Claim:
    """Compare eq. 3.5 with the simulated peak velocities of the cylinders."""
    values, words = [], []
    for name in MAIN:
        scene = runs.scenes[name]
        v1 = 2.0 * scene.velocity[0] / (1.0 + scene.mass[1] / scene.mass[0])
        fastest = Measure(
            name=f"peak velocity of cylinder 20, {name}",
            of=lambda s, run: float(peak_velocity_of_front(s, run).velocity[20]),
            unit="m/s",
            made_of=("velocity",),
        )
        result = heard(runs, name, fastest)
        values.append(result)
        words.append(
            f"{by(result).value:.3f} m/s in {name} (the BCA value is {percent(v1 / by(result).value - 1.0)} larger)"
        )
    v1 = by(values[0], "bca").value
    return claim(
        "velocity-by-bca",
        "section 3, eq. 3.5",
        "The largest velocity of every cylinder is 2 v0/(1 + m/m0) = 0.713 m/s.",
        together(*(decided(value, low=0.95 * 0.713, high=1.05 * 0.713) for value in values)),
        f"Cylinder 20 reaches {' and '.join(words)}; eq. 3.5 gives {v1:.3f} m/s. The BCA predicts arrival times but not"
        " amplitudes, because the pulse spans about five cylinders rather than two. Acceptance criterion (ours): within"
        " 5 %.",
        *values,
    )
