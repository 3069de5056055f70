"""Verdicts of the horizon study: velocities within the horizon, conserved quantities and statistics beyond it."""

from __future__ import annotations

import math

import numpy as np

from dem_bridge.observables.conserved import energy, energy_parts, momentum, work
from dem_bridge.observables.drift import BLOCKS
from dem_bridge.observables.verdict import Outcome, Verdict, judge, judge_relative
from dem_bridge.report.texts import Texts
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.horizon.runs import KNOWN, Found, Trust
from dem_bridge.trajectory.trajectory import Floats, Trajectory
from dem_bridge.verification.roles import REFERENCE, TWIN

TEXTS = Texts("horizon", "dem_bridge.studies")
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


def single(result: Found, trust: Trust) -> Verdict:
    """Judge whether each velocity is known to 1 % all along; beyond the horizon single velocities are UNDECIDED."""
    predictable, scene = math.isinf(trust.horizon), result.scene
    texts = {"trust": trust, "duration": scene.duration, "ms": 1e3 * trust.horizon}
    return TEXTS.verdict(
        "velocity",
        scene=scene.name,
        backend=trust.backend,
        outcome=Outcome.PASS if predictable else Outcome.UNDECIDED,
        sentence=TEXTS("known_all" if predictable else "known_until", **texts),
        reference="" if trust.backend == REFERENCE else REFERENCE,
        difference=math.nan if trust.error is None else float(trust.error[-1]),
        uncertainty=trust.last,
        tolerance=KNOWN,
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
    """Judge the statistics of a run by those of independent runs of the reference, where there are such runs."""
    first = independent_from(result)
    if first is None:
        return []
    scene, created = result.scene, []
    others = [statistics(scene, run, first) for run in (result.truth, *result.ensemble)]
    texts = {
        "ms": 1e3 * float(result.truth.time[first]),
        "count": len(others),
        "within": ONCE_IN - 1.0,
        "once_in": ONCE_IN,
    }
    for quantity, value in statistics(scene, trust.run, first).items():
        available: Floats = np.array([other[quantity] for other in others])
        # of one more of the same kind: its own scatter, and that of the mean
        width = float(_quantile(len(available)) * np.std(available, ddof=1)) * math.sqrt(1.0 + 1.0 / len(available))
        middle = float(np.mean(available))
        away = abs(value - middle)
        size = 1.0 if quantity == SKEWNESS else abs(middle)
        numbers = {"difference": away, "reference_uncertainty": width, "tolerance": width}
        names = {"scene": scene.name, "quantity": quantity, "backend": trust.backend}
        texts |= {"value": value, "middle": middle}
        outcome = judge_relative(away / size, 0.0, width / size)
        created.append(TEXTS.verdict("statistic", **names, **numbers, **texts, outcome=outcome))
    return created


def conserved(result: Found, trust: Trust) -> list[Verdict]:
    """Judge the drift of momentum and of energy.

    Momentum must be constant to round-off. The tolerance of energy is twice the predicted oscillation of
    velocity-Verlet and the drift of the twin over the runs that are compared.
    """
    scene, run, long = result.scene, trust.run, result.long
    drifted = sum(map(abs, long.drift.total)) if long.drift is not None else 0.0
    checks = []
    if scene.conserves_momentum:
        scale = sum(scene.mass) * float(np.max(np.abs(run.velocity)))
        checks.append((momentum(scene, run), "momentum", scale, "kg m/s", run.cost.steps * float(np.finfo(float).eps)))
    if not scene.dissipates:
        quantity = "energy" if scene.conserves_energy else "energy less work"
        balance = energy(scene, run) - work(scene, run)[0]
        checks.append((balance, quantity, long.scale, "J", 2.0 * long.swing[0] + drifted))
    verdicts = []
    for series, quantity, scale, unit, tolerance in checks:
        away = float(np.max(np.abs(series - series[0]))) / scale
        names = {"scene": scene.name, "quantity": quantity, "backend": trust.backend, "unit": unit}
        numbers = {"difference": away, "scale": scale, "tolerance": tolerance}
        verdicts.append(TEXTS.verdict("conserved", **names, **numbers, outcome=judge(away, 0.0, tolerance)))
    return verdicts


def drift(result: Found) -> list[Verdict]:
    """Judge the energy drift and, where the virial theorem predicts it, the energy ratio of the long run.

    The tolerance of the drift is 1 % of the largest energy in motion; both have the uncertainty of the long run's
    averages.
    """
    long, scene, created = result.long, result.scene, []
    texts = {"scene": scene.name, "backend": TWIN, "over": TEXTS("over", long=long, duration=float(long.time[-1]))}
    if not scene.dissipates and long.drift is not None:
        total, bar = long.drift.total
        numbers = {"difference": abs(total), "scale": long.scale, "uncertainty": bar, "tolerance": KNOWN}
        texts["significant"] = "significant" if long.drift.found else "not significant"
        created.append(TEXTS.verdict("drift", **texts, **numbers, outcome=judge(abs(total), bar, KNOWN), total=total))
    exact = virial(scene)
    if exact is not None and long.drift is not None:
        kinetic, stored = (
            np.array([np.mean(part) for part in np.array_split(item, BLOCKS)]) for item in (long.kinetic, long.stored)
        )
        ratio = float(np.sum(kinetic) / np.sum(stored))
        # of a ratio of sums: the blocks' scatter about it, as parts of the mean below the line
        scatter = float(np.std(kinetic - ratio * stored, ddof=1) / np.mean(stored))
        width = _quantile(BLOCKS) * scatter / math.sqrt(BLOCKS)
        away = abs(ratio - exact)
        numbers = {"difference": away, "uncertainty": width, "tolerance": width, "ratio": ratio, "exact": exact}
        outcome = judge_relative(away / exact, 0.0, width / exact)
        created.append(TEXTS.verdict("virial", **texts, **numbers, outcome=outcome))
    return created


def _quantile(count: int) -> float:
    """Return Student's t of ``count`` values that a right code exceeds once in :data:`ONCE_IN`."""
    from scipy.stats import t as student

    return float(student.ppf(1.0 - 0.5 / ONCE_IN, count - 1))


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
