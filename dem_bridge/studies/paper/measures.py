"""Numbers of runs with uncertainties that follow from those of the run, and tables of them for every scene.

A measure is a function of a scene and a trajectory. Registered observables have an uncertainty (:func:`at_body`). For
other numbers it is estimated by perturbing parts of the trajectory within their uncertainties: crossing times and peak
forces one at a time, and the changes are added, which is the largest change to first order; velocities, which have one
uncertainty for all samples, with random signs, three times.

The tables have the leading pulse and the fits of every scene, and the deviations of binary collisions and of the
adiabatic wave from the reference. The paper sets binary collisions beside ode45. Their difference has two parts, which
the second table of deviations separates: the error of the theory (BCA - reference) and that of ode45 at MATLAB's
default tolerances (ode45 - reference).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from dem_bridge.errors import DemBridgeError, UsageError
from dem_bridge.observables.differences import SAMPLED
from dem_bridge.observables.fits import force_exponent, speed_power_law
from dem_bridge.observables.observable import Reader
from dem_bridge.observables.pulse import (
    front_window,
    leading_pulse,
    pulse_width_by_force,
    reflected,
    secondary_fronts,
    speed_ratio,
)
from dem_bridge.observables.registry import OBSERVABLES as REGISTERED
from dem_bridge.observables.registry import observable_named
from dem_bridge.observables.spectrum import Spectrum, cascade, frequency_spectrum, wavenumber_spectrum
from dem_bridge.observables.verdict import Outcome
from dem_bridge.report.columns import GRAM_SPEED, MILLIJOULE, PERCENT, Column
from dem_bridge.report.study import ClaimValue, Table
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.paper import PAPER
from dem_bridge.studies.paper.effects import OBSERVABLES, Effect
from dem_bridge.studies.paper.runs import Runs
from dem_bridge.trajectory.trajectory import Floats, Trajectory

SPLIT_COLUMNS = (
    "chain", "quantity", Column("BCA - ode45", PERCENT), Column("of it the theory's", PERCENT),
    Column("of it ode45's own", PERCENT),
)  # fmt: skip
PULSES_COLUMNS = (
    "scene", "width (bodies) at 0.25", "width (bodies) at 0.9", Column("kinetic energy", MILLIJOULE, at="at 0.25"),
    Column("kinetic energy", MILLIJOULE, at="at 0.9"), "energy share at 0.9", "momentum share at 0.9",
    Column("momentum running back at 0.9", GRAM_SPEED), "further fronts", "V_out/V_in",
)  # fmt: skip
FITS_COLUMNS = (
    "scene", "b1 ((m/s)^n)", "b2 ((m/s)^n)", Column("rms", PERCENT), "force exponent", "least exponent",
    "largest exponent", "frequency ratio", "least frequency ratio", "largest frequency ratio", "wavenumber ratio",
    "least wavenumber ratio", "largest wavenumber ratio",
)  # fmt: skip


#: theories, whose numbers have no uncertainty
THEORIES = ("bca", "adiabatic")
#: number of random perturbations of all velocities
MOVES = 3


@dataclass(frozen=True, kw_only=True)
class Measure:
    """Define a number that is read off a run: ``of(scene, trajectory)`` in ``unit``."""

    name: str
    of: Callable[[Scene, Trajectory], float]
    unit: str = ""
    made_of: tuple[str, ...] = ("crossing_time",)
    """Parts of the trajectory that are perturbed: "crossing_time", "peak_force", "velocity"."""
    uncertainty: Callable[[Scene, Trajectory], float] | None = None
    """Function for the uncertainty, in place of perturbations."""


def at_body(observable: str, body: int | None, name: str) -> Measure:
    """Return a registered observable at one body, or of the whole chain (None), with its uncertainty."""
    registered = observable_named(observable)

    def reader(read: Reader) -> Callable[[Scene, Trajectory], float]:
        return lambda scene, run: float(read(scene, run) if body is None else read(scene, run)[body])

    value, uncertainty = reader(registered.value), reader(registered.uncertainty)
    return Measure(name=name, of=value, unit=registered.unit, uncertainty=uncertainty)


def measured(measure: Measure, scene: Scene, run: Trajectory, backend: str) -> ClaimValue:
    """Return the number with its uncertainty; nan where the run does not have it.

    The uncertainty is nan for a theory, and inf where no estimate exists.
    """
    try:
        value = float(measure.of(scene, run))
    except (DemBridgeError, ValueError):  # for example, the wave reached too few contacts
        value = float("nan")
    uncertainty = float("nan")
    if backend not in THEORIES and np.isfinite(value):
        try:
            uncertainty = _uncertainty(measure, scene, run, value)
        except (DemBridgeError, ValueError):  # the perturbed run cannot be measured
            uncertainty = float("inf")
        uncertainty = uncertainty if np.isfinite(uncertainty) else float("inf")
    return ClaimValue(name=measure.name, backend=backend, value=value, uncertainty=uncertainty, unit=measure.unit)


def _uncertainty(measure: Measure, scene: Scene, run: Trajectory, value: float) -> float:
    if measure.uncertainty is not None:
        return float(measure.uncertainty(scene, run))
    total = 0.0
    for part in ("crossing_time", "peak_force"):
        if part in measure.made_of:
            total += sum(_moves(measure, scene, run, part, value))
    if "velocity" in measure.made_of:
        if not np.isfinite(run.uncertainty["velocity"]):
            return float("inf")
        moved = [measure.of(scene, perturbed) for perturbed in _with_moved_velocities(run)]
        total += float(np.max(np.abs(np.array(moved) - value)))
    return total


@lru_cache(maxsize=8)  # several measures are read off the runs of one scene
def _with_moved_velocities(run: Trajectory) -> tuple[Trajectory, ...]:
    """Return the run with all velocities changed by their uncertainty, with random signs, :data:`MOVES` times."""
    size, chance = run.uncertainty["velocity"], np.random.default_rng(1)
    moved = (run.velocity + size * _signs(chance, run.velocity.shape) for _ in range(MOVES))
    return tuple(replace(run, velocity=velocity) for velocity in moved)


def _moves(measure: Measure, scene: Scene, run: Trajectory, part: str, value: float) -> list[float]:
    uncertainties, values = run.uncertainty[part], getattr(run, part)
    if not np.all(np.isfinite(uncertainties[np.isfinite(values)])):
        return [float("inf")]
    if "velocity" not in measure.made_of:  # samples are not read, and need not be copied for every perturbation
        run = replace(run, **{name: getattr(run, name)[:1] for name in ("time", *SAMPLED)})
    results = []
    for k in np.flatnonzero(np.isfinite(values)):
        # a minimum or a maximum may change in one direction only
        moved = []
        for away in (uncertainties[k], -uncertainties[k]):
            shifted = values.copy()
            shifted[k] += away
            moved.append(abs(float(measure.of(scene, replace(run, **{part: shifted}))) - value))
        results.append(max(moved))
    return results


def _signs(chance: np.random.Generator, shape: tuple[int, ...]) -> Floats:
    return np.asarray(chance.choice((-1.0, 1.0), size=shape))


def inside(claim_value: ClaimValue, low: float, high: float) -> Outcome:
    """Judge whether a value lies between ``low`` and ``high`` within its uncertainty.

    PASS and FAIL need the whole interval of the value and its uncertainty to be inside or outside. An uncertainty of
    nan counts as zero (a formula or a theory has none); one of inf gives UNDECIDED.

    >>> one = ClaimValue(name="ratio", backend="reference", value=0.4, uncertainty=0.01)
    >>> [inside(one, *range_).value for range_ in ((0.3, 0.5), (0.5, 1.0), (0.395, 1.0))]
    ['PASS', 'FAIL', 'UNDECIDED']
    """
    uncertainty = 0.0 if np.isnan(claim_value.uncertainty) else claim_value.uncertainty
    if not np.isfinite(claim_value.value):
        return Outcome.UNDECIDED
    if low <= claim_value.value - uncertainty and claim_value.value + uncertainty <= high:
        return Outcome.PASS
    if claim_value.value + uncertainty < low or claim_value.value - uncertainty > high:
        return Outcome.FAIL
    return Outcome.UNDECIDED


#: bodies from here on: the first ones still form the pulse
FIRST = 5
#: bodies from the free end, where the last one flies off, that are left out
LAST = 3
#: theories, and the paper's own method
NAMES = {"bca": "BCA", "adiabatic": "adiabatic wave", "ode45": "ode45"}
#: name in tables -> registered observable of bodies or contacts
PROFILES: Mapping[str, str] = {
    name: name.replace(" ", "_") for name in ("arrival", "residence time", "peak velocity", "peak force")
}


def profiled(scene: Scene) -> slice:
    """Return the bodies, and contacts, that are compared: without both ends of the chain."""
    return slice(FIRST, scene.n_body - LAST)


def profile(what: str, scene: Scene, run: Trajectory) -> Floats:
    """Return one of :data:`PROFILES` of a run at :func:`profiled`."""
    return REGISTERED[PROFILES[what]].value(scene, run)[profiled(scene)]


def deviation(what: str, scene: Scene, run: Trajectory, truth: Trajectory) -> Floats:
    """Return the relative deviation of one of :data:`PROFILES` of a run from the reference, body by body."""
    return profile(what, scene, run) / profile(what, scene, truth) - 1.0


def theories_table(runs: Runs, scenes: Iterable[str]) -> Table:
    """Return the median and the worst deviation for each scene and theory."""
    rows: list[tuple[str | float, ...]] = []
    for name in scenes:
        truth = runs.truth(name)
        if truth is None:
            continue
        scene = runs.scenes[name]
        if scene.n_body < FIRST + LAST + 3 or scene.gravity or scene.precompression:
            continue
        for key, label in NAMES.items():
            run = runs.run(name, key)
            if run is None:
                continue
            numbers: list[float] = []
            for what in PROFILES:
                values = deviation(what, scene, run, truth)
                values = values[np.isfinite(values)]
                values = values if values.size else np.array([np.nan])
                numbers += [float(np.median(values)), float(values[np.argmax(np.abs(values))])]
            rows.append((name, label, *numbers))
    columns = (
        "scene",
        "by",
        *(Column(f"{item}, {which}", PERCENT) for item in PROFILES for which in ("median", "worst")),
    )
    return PAPER.table("theories", columns, rows, first=FIRST, last=LAST)


def split_table(effects: Iterable[Effect]) -> Table:
    """Return the table that splits the difference of binary collisions and ode45 into the deviation of each."""
    known_values = {(effect.scene, effect.id): effect.changes for effect in effects}
    scenes = [scene for scene, id in known_values if id == "bca" and (scene, "ode45") in known_values]
    rows = [
        (scene, name, theory[name] - code[name], theory[name], -code[name])
        for scene in scenes
        for theory, code in [(known_values[scene, "bca"], known_values[scene, "ode45"])]
        for name in OBSERVABLES
    ]
    return PAPER.table("split", SPLIT_COLUMNS, rows)


#: places in the chain at which a pulse is measured: where it is formed, and before the end
EARLY, LATE = 0.25, 0.9

Numbers = tuple[float, ...]


def pulses_table(runs: Runs, names: Iterable[str]) -> Table:
    """Return width, energy and momentum of the leading pulse of each scene, and later pulses, by the reference."""
    return PAPER.table("pulses", PULSES_COLUMNS, _rows(runs, names, _pulse), early=EARLY, late=LATE)


def fits_table(runs: Runs, names: Iterable[str]) -> Table:
    """Return power laws of speed and force and the cascades of spectra, with their errors, by the reference."""
    return PAPER.table("fits", FITS_COLUMNS, _rows(runs, names, _fits))


def _rows(
    runs: Runs, names: Iterable[str], of: Callable[[Scene, Trajectory], Numbers]
) -> Iterator[tuple[str | float, ...]]:
    for name in names:
        truth = runs.truth(name)
        if truth is None:
            continue
        numbers = of(runs.scenes[name], truth)
        if np.any(np.isfinite(numbers)):
            yield (name, *numbers)


def _or_nothing(of: Callable[[], Numbers], count: int) -> Numbers:
    """Return numbers, or nan where an observable does not apply to a scene."""
    try:
        return of()
    except UsageError:
        return (float("nan"),) * count


def _pulse(scene: Scene, run: Trajectory) -> Numbers:
    early, late = (round(part * (scene.n_body - 1)) for part in (EARLY, LATE))

    def of_pulse() -> Numbers:
        width, pulse, behind = pulse_width_by_force(scene, run), leading_pulse(scene, run), reflected(scene, run)
        front = front_window(scene, run)
        return (
            *(float(width.width[k]) for k in (early, late)),
            *(float(front.kinetic[k]) for k in (early, late)),
            float(pulse.energy_share[late]),
            float(pulse.momentum_share[late]),
            float(behind.backward_momentum[late]),
        )

    return (
        *_or_nothing(of_pulse, 7),
        *_or_nothing(lambda: (float(secondary_fronts(scene, run, scene.n_body // 2).count),), 1),
        *_or_nothing(lambda: (speed_ratio(scene, run).ratio,), 1),
    )


def _fits(scene: Scene, run: Trajectory) -> Numbers:
    def speed() -> Numbers:
        fit = speed_power_law(scene, run)
        return (fit.b1, fit.b2, fit.residual)

    def force() -> Numbers:
        fit = force_exponent(scene, run)
        return (fit.slope, *fit.spread)

    def moved(of: Callable[[Scene, Trajectory], Spectrum]) -> Numbers:
        result = cascade(of(scene, run))
        return (result.ratio, *result.spread)

    return (
        *_or_nothing(speed, 3),
        *_or_nothing(force, 3),
        *_or_nothing(lambda: moved(frequency_spectrum), 3),
        *_or_nothing(lambda: moved(wavenumber_spectrum), 3),
    )
