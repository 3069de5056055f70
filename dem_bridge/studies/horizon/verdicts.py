"""Verdicts of the horizon study: velocities within the horizon, conserved quantities and statistics beyond it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from dem_bridge.observables.conserved import energy, energy_parts, momentum, work
from dem_bridge.observables.drift import BLOCKS
from dem_bridge.scene import Scene
from dem_bridge.studies.horizon.runs import KNOWN, Floats, Found, Trust
from dem_bridge.studies.texts import Texts
from dem_bridge.trajectory import Trajectory
from dem_bridge.verification.roles import REFERENCE, TWIN
from dem_bridge.verification.verdict import Outcome, Verdict, judge, judge_relative

TEXTS = Texts("horizon")
#: perturbed runs are independent from when the nearest two are this far apart, of the largest speed
INDEPENDENT = 0.1
#: of the duration that must be left then for statistics over time
LEFT = 0.25
#: a statistic of a right code is outside its bar once in so many
ONCE_IN = 1000.0
#: the statistic that is 0 for a normal distribution, so that its uncertainty is relative to 1 and not to its value
SKEWNESS = "skewness of velocities"


def verdicts(result: Found) -> tuple[Verdict, ...]:
    """Return the verdicts on single velocities of each backend, then on statistics and on conserved quantities."""
    created = [single(result, trust) for trust in result.trusts]
    for trust in result.trusts[1:]:
        created += statistical(result, trust)
        created += conserved(result, trust)
    return (*created, *drift(result))


def _verdict(
    result: Found,
    quantity: str,
    backend: str,
    outcome: Outcome,
    sentence: str,
    *,
    scale_name: str = "1",
    **numbers: Any,
) -> Verdict:
    """Return a verdict without uncertainties and with a scale of 1, unless others are given."""
    defaults = {"scale": 1.0, "uncertainty": 0.0, "reference_uncertainty": 0.0}
    return Verdict(
        scene=result.scene.name,
        quantity=quantity,
        backend=backend,
        outcome=outcome,
        sentence=sentence,
        scale_name=scale_name,
        **(defaults | numbers),
    )


def single(result: Found, trust: Trust) -> Verdict:
    """Judge whether each velocity is known to 1 % all along; beyond the horizon single velocities are UNDECIDED."""
    predictable = math.isinf(trust.horizon)
    return _verdict(
        result,
        "velocity",
        trust.backend,
        Outcome.PASS if predictable else Outcome.UNDECIDED,
        TEXTS(
            "velocity_known" if predictable else "velocity_until",
            trust=trust,
            scene=result.scene,
            ms=1e3 * trust.horizon,
        ),
        reference="" if trust.backend == REFERENCE else REFERENCE,
        scale_name="largest |velocity|",
        difference=math.nan if trust.error is None else float(trust.error[-1]),
        uncertainty=trust.last,
        reference_uncertainty=math.nan,
        tolerance=KNOWN,
        meaning="time step and round-off",
    )


def independent_from(result: Found) -> int | None:
    """First sample from which all perturbed runs are independent; None: never, or too late for statistics."""
    apart = np.flatnonzero(np.min(result.distance, axis=0) >= INDEPENDENT)
    if len(apart) == 0 or result.truth.time[apart[0]] > (1.0 - LEFT) * result.scene.duration:
        return None
    return int(apart[0])


def statistics(scene: Scene, run: Trajectory, first: int) -> dict[str, float]:
    """Return four statistics over all samples from ``first`` on.

    They are the ratio of mean kinetic to mean stored energy, the mean kinetic energy (J), and the skewness and the
    kurtosis of velocities times the root of the mass (0 and 3 for a normal distribution).
    """
    kinetic, stored, _ = energy_parts(scene, run)
    pushed = run.velocity[first:] * np.sqrt(np.array(scene.mass))
    second = float(np.mean(pushed**2))
    held = float(np.mean(stored[first:]))
    return {
        "mean kinetic / stored energy": float(np.mean(kinetic[first:])) / held if held > 0.0 else math.nan,
        "mean kinetic energy (J)": float(np.mean(kinetic[first:])),
        SKEWNESS: float(np.mean(pushed**3)) / second**1.5,
        "kurtosis of velocities": float(np.mean(pushed**4)) / second**2,
    }


def statistical(result: Found, trust: Trust) -> list[Verdict]:
    """Statistics of a run beside those of independent runs of the reference; none where there are no such runs."""
    from scipy.stats import t as student

    first = independent_from(result)
    if first is None:
        return []
    scene, name = result.scene, trust.backend
    others = [statistics(scene, run, first) for run in (result.truth, *result.ensemble)]
    created = []
    for quantity, value in statistics(scene, trust.run, first).items():
        available: Floats = np.array([other[quantity] for other in others])
        # of one more of the same kind: its own scatter, and that of the mean
        width = float(student.ppf(1.0 - 0.5 / ONCE_IN, len(available) - 1) * np.std(available, ddof=1))
        width *= math.sqrt(1.0 + 1.0 / len(available))
        middle = float(np.mean(available))
        away = abs(value - middle)
        size = 1.0 if quantity == SKEWNESS else abs(middle)
        sentence = TEXTS(
            "statistic",
            quantity=quantity,
            name=name,
            value=value,
            ms=1e3 * float(result.truth.time[first]),
            count=len(available),
            middle=middle,
            width=width,
            within=ONCE_IN - 1.0,
            once_in=ONCE_IN,
        )
        outcome = judge_relative(away / size, 0.0, width / size)
        created.append(
            _verdict(
                result,
                quantity,
                name,
                outcome,
                sentence,
                reference=REFERENCE,
                difference=away,
                reference_uncertainty=width,
                tolerance=width,
                meaning="statistics beyond the horizon",
            )
        )
    return created


def conserved(result: Found, trust: Trust) -> list[Verdict]:
    """Judge the drift of momentum and of energy.

    Momentum must be constant to round-off. The tolerance of energy is twice the predicted oscillation of
    velocity-Verlet and the drift of the twin over the runs that are compared.
    """
    scene, run, created, long = result.scene, trust.run, [], result.long
    drifted = sum(map(abs, long.drift.total)) if long.drift is not None else 0.0
    if scene.conserves_momentum:
        scale = sum(scene.mass) * float(np.max(np.abs(run.velocity)))
        created.append((momentum(scene, run), "momentum", scale, "kg m/s", run.cost.steps * float(np.finfo(float).eps)))
    if not scene.dissipates:
        quantity = "energy" if scene.conserves_energy else "energy less work"
        balance = energy(scene, run) - work(scene, run)[0]
        created.append((balance, quantity, long.scale, "J", 2.0 * long.swing[0] + drifted))
    verdicts = []
    for series, quantity, scale, unit, tolerance in created:
        away = float(np.max(np.abs(series - series[0]))) / scale
        name = trust.backend
        verdicts.append(
            _verdict(
                result,
                quantity,
                name,
                judge(away, 0.0, tolerance),
                TEXTS(
                    "conserved", quantity=quantity, name=name, away=away, scale=scale, unit=unit, tolerance=tolerance
                ),
                reference="its own start",
                difference=away,
                scale=scale,
                unit=unit,
                scale_name="its largest",
                tolerance=tolerance,
                meaning="conserved",
            )
        )
    return verdicts


def drift(result: Found) -> list[Verdict]:
    """Judge the energy drift and, where the virial theorem predicts it, the energy ratio of the long run.

    The tolerance of the drift is 1 % of the largest energy in motion; both have the uncertainty of the long run's
    averages.
    """
    from scipy.stats import t as student

    long, scene, created = result.long, result.scene, []
    over = TEXTS("over", long=long, duration=float(long.time[-1]))
    if not scene.dissipates and long.drift is not None:
        total, bar = long.drift.total
        significance = "significant" if long.drift.found else "not_significant"
        created.append(
            _verdict(
                result,
                "energy drift",
                TWIN,
                judge(abs(total), bar, KNOWN),
                TEXTS(significance, name=TWIN, total=total, bar=bar, over=over, tolerance=KNOWN),
                reference="none",
                difference=abs(total),
                scale=long.scale,
                unit="J",
                scale_name="most energy in motion",
                uncertainty=bar,
                tolerance=KNOWN,
                meaning="conserved",
            )
        )
    exact = virial(scene)
    if exact is not None and long.drift is not None:
        kinetic, stored = (
            np.array([np.mean(part) for part in np.array_split(item, BLOCKS)]) for item in (long.kinetic, long.stored)
        )
        ratio = float(np.sum(kinetic) / np.sum(stored))
        # of a ratio of sums: the blocks' scatter about it, as parts of the mean below the line
        scatter = float(np.std(kinetic - ratio * stored, ddof=1) / np.mean(stored))
        width = float(student.ppf(1.0 - 0.5 / ONCE_IN, BLOCKS - 1)) * scatter / math.sqrt(BLOCKS)
        away = abs(ratio - exact)
        created.append(
            _verdict(
                result,
                "mean kinetic / stored energy, long run",
                TWIN,
                judge_relative(away / exact, 0.0, width / exact),
                TEXTS("virial", name=TWIN, ratio=ratio, width=width, over=over, exact=exact),
                reference="virial theorem",
                difference=away,
                uncertainty=width,
                tolerance=width,
                meaning="statistics beyond the horizon",
            )
        )
    return created


def virial(scene: Scene) -> float | None:
    """Mean kinetic to mean stored energy of a chain between walls whose contacts touch when it is at rest: n/2.

    ``2 <T> = <sum F overlap> = n <U>`` for forces that are powers (Clausius 1870). None where there is more to it.

    >>> import dem_bridge as db
    >>> virial(db.load_scene("decelerating-40")) is None
    True
    """
    c = scene.contacts
    held = scene.wall_left is not None and scene.wall_right is not None and not np.any(c.gap)
    alone = scene.law is None and scene.gravity == 0.0 and scene.conserves_energy
    if not (held and alone and np.all(c.exponent == c.exponent[0])):
        return None
    return 0.5 * float(c.exponent[0])
