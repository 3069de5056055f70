"""Claims of section 4c (figure 5), of appendix A (figure 6), and on the other chains that the paper cites."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from dem_bridge.observables.differences import reduced
from dem_bridge.observables.fits import Slope, force_exponent, log_velocity_slope
from dem_bridge.observables.front import local_speed_constant
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.observables.verdict import Outcome
from dem_bridge.physics.exact import solitary_wave, two_body_collision
from dem_bridge.report.study import Claim, ClaimValue
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.paper.claims import (
    DECIDE,
    PRINTED,
    by,
    claim,
    decided,
    exact,
    heard,
    printed,
    sentence_numbers,
    together,
)
from dem_bridge.studies.paper.claims_pulses import WELL
from dem_bridge.studies.paper.claims_wave import SPEED_RATIO
from dem_bridge.studies.paper.measures import THEORIES, Measure
from dem_bridge.studies.paper.runs import ACCELERATING, COARSE, DECELERATING, GRADIENTS, JUDGES, LONG, Runs
from dem_bridge.trajectory.trajectory import Floats, Trajectory
from dem_bridge.verification.reference_choice import REFERENCE
from dem_bridge.verification.roles import assign_roles

#: relative deviation of an exponent up to which the agreement is remarkable
REMARKABLE = 0.02
#: limits of the change of ln(peak velocity) per sphere: clearly positive where masses fall, negative where they rise
TAPERED = {"tapered-forward": (0.01, np.inf), "tapered-backward": (-np.inf, -0.01)}
UNIFORM = "homogeneous-cylinders"
#: from this cylinder on the wave is the solitary wave, to this relative accuracy
SETTLED, EXACT = 40, 1e-9


def _exponent_measure(name: str, of: Callable[[Slope], float]) -> Measure:
    """Return the exponent of a fit; every window moves with the run's uncertainties as the whole one does."""
    return Measure(
        name=name,
        of=lambda scene, run: of(force_exponent(scene, run)),
        uncertainty=lambda scene, run: force_exponent(scene, run).uncertainty,
    )


EXPONENTS = {
    "whole": _exponent_measure("force exponent", lambda fit: fit.slope),
    "least": _exponent_measure("least force exponent", lambda fit: fit.spread[0]),
    "largest": _exponent_measure("largest force exponent", lambda fit: fit.spread[1]),
}
SLOPE = Measure(
    name="d ln(peak velocity) per sphere",
    of=lambda scene, run: log_velocity_slope(scene, run, 15, 35).slope,
    uncertainty=lambda scene, run: log_velocity_slope(scene, run, 15, 35).uncertainty,
)


def forces(runs: Runs) -> Iterator[Claim]:
    """Yield the claims on forces, mass gradients and other chains in the order of the paper."""
    for name in LONG:
        yield _exponent(runs, name)
    yield _compression(runs)
    gradients = {chain: _with_gradient(runs, chain) for chain in (DECELERATING, ACCELERATING)}
    for id, ratios in zip(("mass-decelerates", "mass-accelerates"), gradients.values(), strict=True):
        yield _mass_gradient(id, ratios)
    yield _mass_gradient_by_bca(runs, gradients)
    yield _solitary(runs)
    yield _tapered_slopes(runs)


def _exponent(runs: Runs, name: str) -> Claim:
    """Judge the whole range of exponents over windows, because the residuals are a curve and no scatter."""
    id = f"force-exponent-{name.split('-')[0]}"
    number = printed(**PRINTED[id])
    low, high = ((1.0 + change) * number.value for change in (-REMARKABLE, REMARKABLE))
    values = {key: heard(runs, name, measure) for key, measure in EXPONENTS.items()}
    numbers: dict[str, Any] = {**sentence_numbers(values["whole"]), "tolerance": REMARKABLE}
    numbers |= {key: by(value).value for key, value in values.items()}
    if (truth := runs.truth(name)) is not None:
        fit = force_exponent(runs.scenes[name], truth)
        numbers |= {"first": fit.first, "last": fit.last}
    outcome = together(*(decided(value, low, high) for value in values.values()))
    return claim(id, outcome, number, *values.values(), **numbers)


def _compression(runs: Runs) -> Claim:
    scene = runs.scenes[DECELERATING]
    hit = two_body_collision(
        masses=(scene.mass[0], scene.mass[1]),
        velocities=(scene.velocity[0], 0.0),
        stiffness=scene.stiffness[0],
        exponent=2.5,
    )
    reduced_mass = 1.0 / (1.0 / scene.mass[0] + 1.0 / scene.mass[1])
    as_printed = (2.5 * reduced_mass * scene.velocity[0] / (2.0 * scene.stiffness[0])) ** 0.4
    return claim(
        "compression",
        Outcome.FAIL,
        ClaimValue(name="as printed", backend="paper", value=as_printed, unit="m"),
        exact("with v^2", hit.peak_overlap, "m"),
        squared=1e6 * hit.peak_overlap,
        as_printed=1e6 * as_printed,
    )


def _with_gradient(runs: Runs, chain: str) -> dict[str, Floats]:
    """Return V_out/V_in at each mass gradient by backend; nan where there is no run."""

    def ratio(scene: str, backend: str) -> float:
        run = runs.run(scene, backend) if scene in runs.scenes else None
        return np.nan if run is None else SPEED_RATIO.of(runs.scenes[scene], run)

    return {name: np.array([ratio(f"{chain}.gamma{gamma:g}", name) for gamma in GRADIENTS]) for name in JUDGES}


def ratios(runs: Runs, chain: str) -> list[tuple[float, dict[str, float]]]:
    """Return the data of figures 6c and 6f: gamma with V_out/V_in by each backend that ran."""
    results, engine = _with_gradient(runs, chain), {"lammps": assign_roles(runs.scenes[chain]).engine}
    return [
        (
            gamma,
            {engine.get(name, name): float(values[i]) for name, values in results.items() if np.isfinite(values[i])},
        )
        for i, gamma in enumerate(GRADIENTS)
    ]


def _mass_gradient(id: str, ratios: dict[str, Floats]) -> Claim:
    truth = ratios[REFERENCE]
    available = [ratios[name][np.isfinite(ratios[name])] for name in DECIDE]
    falls = [bool(np.all(np.diff(values) < 0.0)) for values in available if len(values) > 1]
    values = [
        ClaimValue(name=f"V_out/V_in at gamma = {gamma:+g}", backend=name, value=float(column[i]))
        for name, column in ratios.items()
        for i, gamma in enumerate(GRADIENTS)
        if gamma in (-0.02, -0.01, 0.0, 0.01, 0.02) and np.isfinite(column[i])
    ]
    return claim(
        id,
        Outcome.NOT_RUN if not falls else Outcome.PASS if all(falls) else Outcome.FAIL,
        values,
        first=truth[0],
        middle=truth[len(truth) // 2],
        last=truth[-1],
        least=GRADIENTS[0],
        largest=GRADIENTS[-1],
        steps=len(GRADIENTS) - 1,
        dt=COARSE.dt,
    )


def _mass_gradient_by_bca(runs: Runs, gradients: dict[str, dict[str, Floats]]) -> Claim:
    each, outcomes = [], []
    for chain, ratios in gradients.items():
        bca, adiabatic = (reduced(ratios[name] / ratios[REFERENCE] - 1.0) for name in THEORIES)
        each.append({"chain": chain, "bca": bca, "adiabatic": adiabatic})
        outcomes.append(Outcome.NOT_RUN if np.isnan(bca) else Outcome.PASS if bca < WELL else Outcome.FAIL)
    arrival, off = OBSERVABLES["arrival_at_end"].value, []
    for name, scene in runs.scenes.items():
        theory, truth = runs.run(name, "bca"), runs.truth(name)
        if name.endswith(("gamma0.01", "gamma-0.01")) and theory is not None and truth is not None:
            off.append(abs(float(arrival(scene, theory) / arrival(scene, truth) - 1.0)))
    largest = max(off, default=np.nan)
    return claim("mass-gradient-by-bca", together(*outcomes), each=each, arrival=largest, tolerance=WELL)


def _solitary(runs: Runs) -> Claim:
    truth = _wave_speed()
    values, outcomes, each = [], [], []
    for name, run in runs.judges(UNIFORM):
        # with the v_max of the wave that has the peak forces beside the cylinder
        result = local_speed_constant(runs.scenes[UNIFORM], run)
        values += [
            ClaimValue(
                name=f"c/((beta/m)^0.4 v^0.2) at cylinder {body}",
                backend=name,
                value=float(result.by_force[body - 1]),
                uncertainty=np.nan if name in THEORIES else float(result.by_force_uncertainty[body - 1]),
            )
            for body in (10, 20, 40, 60)
        ]
        if name not in DECIDE:
            continue
        away, allowed, within = _settled(np.abs(result.by_force - truth)), np.array(EXACT), f"within {EXACT:.0e}"
        if name != REFERENCE:
            allowed = _settled(result.by_force_uncertainty)
            within = f"within its uncertainty of {np.max(allowed):.1e}"
        outcomes.append(Outcome.PASS if bool(np.all(away <= allowed)) else Outcome.FAIL)
        each.append({"code": "LAMMPS" if name == "lammps" else name, "deviation": np.max(away), "within": within})
    wave = exact("exact wave of the discrete chain", truth, "")
    return claim("solitary", together(*outcomes), wave, values, each=each, exact=truth, settled=SETTLED)


def deviation_from_wave(scene: Scene, run: Trajectory, *, settled: int = SETTLED) -> float:
    """Return the largest deviation of the local speed constant from the exact wave, from a cylinder on."""
    return float(np.max(_settled(np.abs(local_speed_constant(scene, run).by_force - _wave_speed()), settled)))


def _wave_speed() -> float:
    """Return the speed of the solitary wave of the discrete chain, in (beta/m)^(2/5) v^(1/5)."""
    return solitary_wave(mass=1.0, stiffness=1.0, exponent=2.5, peak_velocity=1.0).speed


def _settled(values: Floats, first: int = SETTLED) -> Floats:
    """Return the values of cylinders at which the wave has settled; the last ones feel the free end."""
    return values[first - 1 : -3]


def _tapered_slopes(runs: Runs) -> Claim:
    values = {name: heard(runs, name, SLOPE) for name in TAPERED if name in runs.scenes}
    return claim(
        "tapered-velocity",
        together(*(decided(values[name], *TAPERED[name]) for name in values)),
        *values.values(),
        each=[
            {"chain": name, "value": by(value).value, "bca": by(value, "bca").value} for name, value in values.items()
        ],
    )
