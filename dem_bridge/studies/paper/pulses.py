"""The leading pulse and the fits of every scene that has one, of which the claims quote some."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from dem_bridge.errors import UsageError
from dem_bridge.observables.fits import force_exponent, speed_power_law
from dem_bridge.observables.pulse import (
    front_window,
    leading_pulse,
    pulse_width_by_force,
    reflected,
    secondary_fronts,
    speed_ratio,
)
from dem_bridge.observables.spectrum import Spectrum, cascade, frequency_spectrum, wavenumber_spectrum
from dem_bridge.report.study import Table
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.paper.runs import Runs
from dem_bridge.studies.paper.texts import PAPER
from dem_bridge.trajectory.trajectory import Trajectory

#: places in the chain at which a pulse is measured: where it is formed, and before the end
EARLY, LATE = 0.25, 0.9

Numbers = tuple[float, ...]


def pulses_table(runs: Runs, names: Iterable[str]) -> Table:
    """Return width, energy and momentum of the leading pulse of each scene, and later pulses, by the reference."""
    return PAPER.table("pulses", _rows(runs, names, _pulse), early=EARLY, late=LATE)


def fits_table(runs: Runs, names: Iterable[str]) -> Table:
    """Return power laws of speed and force and the cascades of spectra, with their errors, by the reference."""
    return PAPER.table("fits", _rows(runs, names, _fits))


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
            *(1e3 * float(front.kinetic[k]) for k in (early, late)),
            float(pulse.energy_share[late]),
            float(pulse.momentum_share[late]),
            1e3 * float(behind.backward_momentum[late]),
        )

    return (
        *_or_nothing(of_pulse, 7),
        *_or_nothing(lambda: (float(secondary_fronts(scene, run, scene.n_body // 2).count),), 1),
        *_or_nothing(lambda: (speed_ratio(scene, run).ratio,), 1),
    )


def _fits(scene: Scene, run: Trajectory) -> Numbers:
    def speed() -> Numbers:
        fit = speed_power_law(scene, run)
        return (fit.b1, fit.b2, 100.0 * fit.residual)

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
