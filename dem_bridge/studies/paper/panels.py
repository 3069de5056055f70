"""Panels of the paper's figures as numbers: what a chain and its runs give. What a chain has no run of is left out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.base import ENGINE_BACKENDS
from dem_bridge.errors import UsageError
from dem_bridge.observables.fits import force_exponent, speed_power_law
from dem_bridge.observables.front import (
    arrival_by_crossing,
    residence_bar,
    residence_by_crossing,
    wave_speed_by_crossing,
)
from dem_bridge.observables.spectrum import Spectrum, frequency_spectrum, wavenumber_spectrum
from dem_bridge.scene import Scene
from dem_bridge.studies.study import Map, Panel, Series
from dem_bridge.trajectory import Trajectory

Floats = NDArray[np.float64]
#: gamma and V_out/V_in by each backend
Ratios = Sequence[tuple[float, Mapping[str, float]]]

THEORIES = ("bca", "adiabatic")
#: those with a velocity and a force at every time; binary collisions have steps
IN_TIME = ("reference", "adiabatic", *ENGINE_BACKENDS, "ode45")
EVERY = ("reference", *THEORIES, *ENGINE_BACKENDS, "ode45")
LABELS = {**dict.fromkeys(ENGINE_BACKENDS, "LAMMPS"), "bca": "BCA", "adiabatic": "adiabatic theory"}
#: of a map: rows (or columns) at most, and its rounding as part of the largest value
MAP_ROWS, MAP_DIGITS = 300, 5
#: height of the guide over the reference: on it, neither would be seen
GUIDE = 1.08
#: of a column's largest power: less is dark
_DARK = 0.02
_POWER = "power / largest of its column (1)"


@dataclass(frozen=True, eq=False)
class ChainRuns:
    """One chain with its runs, by name of backend. Only "reference" must be there; UsageError without."""

    scene: Scene
    runs: Mapping[str, Trajectory]

    def __post_init__(self) -> None:
        if "reference" not in self.runs:
            result = ", ".join(self.runs) or "none"
            raise UsageError(f"runs of {self.scene.name}: {result}; a figure needs that of backend 'reference'")

    @property
    def reference(self) -> Trajectory:
        return self.runs["reference"]

    @property
    def shown(self) -> tuple[str, Trajectory]:
        """Backend and run of a map: LAMMPS' where there is one."""
        return next(iter([*self.named(*ENGINE_BACKENDS), ("reference", self.reference)]))

    @property
    def middle(self) -> int:
        """The 100th cylinder of 200."""
        return self.scene.n_body // 2

    def named(self, *wanted: str) -> Iterator[tuple[str, Trajectory]]:
        """Yield the runs of these backends that exist, in the order of drawing."""
        return ((name, self.runs[name]) for name in wanted if name in self.runs)


def window(chains: Iterable[ChainRuns], factor: float) -> float:
    """Return the end of the time axis, s: ``factor`` times the arrival at the last body, at most the duration.

    It is the latest of all chains, because figures that are compared share their time axis.
    """
    ends = []
    for chain in chains:
        last = arrival_by_crossing(chain.scene, chain.reference)[-1]
        ends.append(min(factor * float(last), chain.scene.duration) if np.isfinite(last) else chain.scene.duration)
    return max(ends)


def velocity_map(
    title: str, chain: ChainRuns, end: float, *, shares: tuple[int, ...], theories: tuple[str, ...] = THEORIES
) -> Panel:
    """Velocity over cylinder and time until ``end`` (s), without the striker, and the front as theories have it."""
    name, run = chain.shown
    rows = int(np.searchsorted(run.time, end, side="right"))
    thin = slice(None, rows, _step(rows))
    bodies = np.arange(1.0, chain.scene.n_body)
    return Panel(
        title=title,
        x_label="cylinder",
        y_label="time (ms)",
        # a time is a whole number of samples: what is left at 1e-9 ms is round-off
        map=Map(
            label="velocity (m/s)",
            x=bodies,
            y=np.round(1e3 * run.time[thin], 9),
            values=_rounded(run.velocity[thin, 1:]),
        ),
        series=tuple(
            Series(
                label=f"front by {LABELS[theory]}",
                style=theory,
                x=bodies,
                y=1e3 * arrival_by_crossing(chain.scene, result),
            )
            for theory, result in chain.named(*theories)
        ),
        notes=(f"velocity by {LABELS.get(name, name)}",),
        shares_scale_with=shares,
    )


def residence_times(title: str, chain: ChainRuns, *, shares: tuple[int, ...]) -> Panel:
    """Residence time along the chain by all runs."""
    series, bodies = [], np.arange(1.0, chain.scene.n_body - 1)
    for name, run in chain.named(*EVERY):
        times = residence_by_crossing(chain.scene, run)
        series.append(_series(name, bodies, 1e6 * times, 1e6 * residence_bar(chain.scene, run)))
    return Panel(
        title=title,
        x_label="cylinder",
        y_label="residence time (µs)",
        series=tuple(series),
        shares_scale_with=shares,
    )


def wave_speeds(title: str, chain: ChainRuns, *, shares: tuple[int, ...]) -> Panel:
    """Wave speed along the chain by all runs, and the power law fitted to the reference."""
    series, bodies = [], np.arange(1.0, chain.scene.n_body - 1)
    for name, run in chain.named(*EVERY):
        speed = wave_speed_by_crossing(chain.scene, run)
        relative = residence_bar(chain.scene, run) / residence_by_crossing(chain.scene, run)
        series.append(_series(name, bodies, speed, relative * speed))
    fit = speed_power_law(chain.scene, chain.reference)
    i = np.arange(fit.first, fit.last + 1)
    series.append(Series(label="fit V = (b1 + b2 i)^(1/n)", style="fit", x=i.astype(float), y=fit.speed(i)))
    return Panel(
        title=title,
        x_label="cylinder",
        y_label="wave speed (m/s)",
        series=tuple(series),
        notes=(f"fit: b1 = {fit.b1:.4g}, b2 = {fit.b2:.4g} (m/s)^{fit.exponent:g}, to {fit.residual:.2%} rms",),
        shares_scale_with=shares,
    )


def frequencies(titles: Sequence[str], chains: Sequence[ChainRuns], *, place: int) -> list[Panel]:
    """Spectrum in time along each chain with its centroid; ``place``: that of the first panel in the figure."""
    results = [frequency_spectrum(chain.scene, chain.shown[1], first=1) for chain in chains]
    power = [_normalised(_two_sided(result)) for result in results]
    # one axis for all, up to where the last column is dark
    heard = max(result.frequency[(p >= _DARK).any(axis=1)][-1] for result, p in zip(results, power, strict=True))
    panels = []
    for title, chain, result, p in zip(titles, chains, results, power, strict=True):
        rows = int(np.searchsorted(result.frequency, heard, side="right"))
        thin = slice(None, rows, _step(rows))
        panels.append(
            _spectrum(
                title,
                chain,
                ("cylinder", "frequency (kHz)"),
                Map(label=_POWER, x=result.position, y=1e-3 * result.frequency[thin], values=p[thin]),
                1e-3 * result.centroid,
                note=_from_to("kHz", 1e-3 * result.centroid, result.position),
                shares=tuple(range(place, place + len(chains))),
            )
        )
    return panels


def wavenumbers(titles: Sequence[str], chains: Sequence[ChainRuns], *, place: int) -> list[Panel]:
    """Spectrum along each chain in time with its centroid; ``place``: that of the first panel in the figure.

    Without the shortest wave of two cylinders, which is once in a spectrum or not at all.
    """
    panels = []
    for title, chain in zip(titles, chains, strict=True):
        item = wavenumber_spectrum(chain.scene, chain.shown[1], first=1)
        size = _step(len(item.time))
        power = _normalised(_means(_two_sided(item), size))[:-1]
        panels.append(
            _spectrum(
                title,
                chain,
                ("time (ms)", "wavenumber (1/cylinder)"),
                Map(label=_POWER, x=_means(1e3 * item.time, size), y=item.frequency[:-1], values=power),
                _means(item.centroid, size),
                note=_from_to("1/cylinder", item.centroid, item.position),
                shares=tuple(range(place, place + len(chains))),
            )
        )
    return panels


def velocity_in_the_middle(title: str, chain: ChainRuns, *, shares: tuple[int, ...]) -> Panel:
    """Velocity of the middle cylinder while the impulse is there."""
    runs = {name: run.velocity[:, chain.middle] for name, run in chain.named(*IN_TIME)}
    return _in_time(title, chain, "velocity (m/s)", runs, note=f"cylinder {chain.middle}", shares=shares)


def force_in_the_middle(title: str, chain: ChainRuns, *, shares: tuple[int, ...]) -> Panel:
    """Force on the middle cylinder by the one before it, while the impulse is there."""
    contact = chain.middle - 1
    runs = {name: run.contact_force[:, contact] for name, run in chain.named(*IN_TIME)}
    note = f"between cylinders {contact} and {contact + 1}"
    return _in_time(title, chain, "contact force (N)", runs, note=note, shares=shares)


def peak_forces(title: str, chain: ChainRuns, *, shares: tuple[int, ...]) -> Panel:
    """Largest force of each contact by all runs."""
    contacts = np.arange(float(chain.scene.n_contact))
    return Panel(
        title=title,
        x_label="contact k, between cylinders k and k+1",
        y_label="largest contact force (N)",
        series=tuple(
            _series(name, contacts, run.peak_force, run.uncertainty["peak_force"]) for name, run in chain.named(*EVERY)
        ),
        shares_scale_with=shares,
    )


def force_against_stiffness(title: str, chain: ChainRuns, *, shares: tuple[int, ...]) -> Panel:
    """Largest force of each contact against its stiffness, the fitted power, and a guide of the slope 2/5."""
    stiffness = chain.scene.contacts.stiffness
    fit = force_exponent(chain.scene, chain.reference)
    fitted = slice(fit.first, fit.last + 1)
    x = np.sort(stiffness[fitted])[[0, -1]]
    # a line of least squares goes through the mean of its points
    away = x / np.exp(np.mean(np.log(stiffness[fitted])))
    height = np.exp(np.mean(np.log(chain.reference.peak_force[fitted])))
    return Panel(
        title=title,
        x_label="contact stiffness (GN/m^1.5)",
        y_label="largest contact force (N)",
        series=(
            *(_series(name, 1e-9 * stiffness, run.peak_force) for name, run in chain.named(*EVERY)),
            Series(label="fit", style="fit", x=1e-9 * x, y=height * away**fit.slope),
            Series(label="slope 2/5", style="guide", x=1e-9 * x, y=GUIDE * height * away**0.4),
        ),
        log=True,
        notes=(
            f"exponent {fit.slope:.4f} for contacts {fit.first}-{fit.last};"
            f" others {fit.spread[0]:.4f}-{fit.spread[1]:.4f}",
        ),
        shares_scale_with=shares,
    )


def speed_ratios(title: str, ratios: Ratios) -> Panel:
    """V_out/V_in against the mass gradient by each backend that has one anywhere."""
    gammas = np.array([gamma for gamma, _ in ratios])
    return Panel(
        title=title,
        x_label="mass gradient gamma (1/cylinder)",
        y_label="V_out / V_in (1)",
        series=tuple(
            _series(name, gammas, np.array([ratio.get(name, np.nan) for _, ratio in ratios]))
            for name in EVERY
            if any(name in ratio for _, ratio in ratios)
        ),
    )


def _series(name: str, x: Floats, y: Floats, bar: Floats | None = None) -> Series:
    """A line or marks by a backend; a bar that says nothing is none."""
    available = bar if bar is not None and np.isfinite(bar).any() else None
    return Series(label=LABELS.get(name, name), style=name, x=x, y=y, bar=available)


def _in_time(
    title: str, chain: ChainRuns, label: str, runs: Mapping[str, Floats], *, note: str, shares: tuple[int, ...]
) -> Panel:
    series = []
    for name, values in runs.items():
        time, near = chain.runs[name].time, _while_there(chain, chain.runs[name])
        series.append(_series(name, 1e3 * time[near], values[near]))
    return Panel(
        title=title, x_label="time (ms)", y_label=label, series=tuple(series), notes=(note,), shares_scale_with=shares
    )


def _spectrum(
    title: str,
    chain: ChainRuns,
    labels: tuple[str, str],
    power: Map,
    centroid: Floats,
    *,
    note: str,
    shares: tuple[int, ...],
) -> Panel:
    line = Series(label="centroid", style=chain.shown[0], x=power.x, y=centroid)
    return Panel(
        title=title,
        x_label=labels[0],
        y_label=labels[1],
        map=power,
        series=(line,),
        notes=(note,),
        shares_scale_with=shares,
    )


def _step(count: int) -> int:
    return max(1, -(-count // MAP_ROWS))


def _rounded(values: Floats) -> Floats:
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    if not 0.0 < largest < np.inf:
        return values
    # and no -0.0, which is nothing with a sign
    return np.asarray(np.round(values, MAP_DIGITS - int(np.ceil(np.log10(largest)))) + 0.0)


def _means(values: Floats, size: int) -> Floats:
    """Return the means of ``size`` columns each; leaving samples out would alias with the pulse's steps."""
    starts = np.arange(0, values.shape[-1], size)
    sums = np.add.reduceat(values, starts, axis=-1)
    return np.asarray(sums / np.diff(np.append(starts, values.shape[-1])))


def _two_sided(spectrum: Spectrum) -> Floats:
    """Density by the shape of a pulse's spectrum: what is one-sided has half of it at zero, which is there but once."""
    density = spectrum.density.copy()
    density[0] *= 2.0
    return density


def _normalised(density: Floats) -> Floats:
    """Each column over its largest: how high a spectrum reaches, whatever its energy."""
    return np.asarray(np.round(density / np.max(density, axis=0), MAP_DIGITS))


def _from_to(unit: str, centroid: Floats, position: Floats) -> str:
    """The centroid where the pulse has formed and before it leaves: at 10 and at 90 % of the chain."""
    first, last = (float(np.interp(share * position[-1], position, centroid)) for share in (0.1, 0.9))
    return f"centroid: {first:.3g} {unit} at 10 % of the way, {last:.3g} at 90 %"


def _while_there(chain: ChainRuns, run: Trajectory) -> slice:
    """Samples from 4 residence times before the impulse reaches the middle to 6 after; all if it never does."""
    before, after = arrival_by_crossing(chain.scene, chain.reference)[chain.middle - 1 : chain.middle + 1]
    stay = after - before
    if not np.isfinite(stay):
        return slice(None)
    first, last = np.searchsorted(run.time, (before - 4.0 * stay, before + 6.0 * stay))
    return slice(int(first), int(last))
