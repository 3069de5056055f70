"""Panels of the paper's figures as data, from the runs of a chain. Backends without a run are left out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dem_bridge.backends.base import ENGINE_BACKENDS
from dem_bridge.errors import UsageError
from dem_bridge.observables.fits import force_exponent, speed_power_law
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.observables.spectrum import Cascade, Spectrum, cascade, frequency_spectrum, wavenumber_spectrum
from dem_bridge.report.study import Map, Panel, Series
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.paper.measures import THEORIES
from dem_bridge.trajectory.trajectory import Floats, Trajectory

#: gamma and V_out/V_in by each backend
Ratios = Sequence[tuple[float, Mapping[str, float]]]

#: least median distance of a line from that of the reference, over its height, that is seen: two widths of the line
_SEEN = 0.02
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
_AWAY = "deviation from reference (%)"
_POWER = "power / largest of its column"


@dataclass(frozen=True, eq=False)
class ChainRuns:
    """Hold one chain with its runs by backend; UsageError without a run of the reference."""

    scene: Scene
    runs: Mapping[str, Trajectory]

    def __post_init__(self) -> None:
        if "reference" not in self.runs:
            result = ", ".join(self.runs) or "none"
            raise UsageError(f"runs of {self.scene.name}: {result}; a figure needs that of backend 'reference'")

    @property
    def reference(self) -> Trajectory:
        """Return the run of the reference."""
        return self.runs["reference"]

    @property
    def shown(self) -> tuple[str, Trajectory]:
        """Return backend and run of a map: those of LAMMPS where there is one, else of the reference."""
        return next(iter([*self.named(*ENGINE_BACKENDS), ("reference", self.reference)]))

    @property
    def middle(self) -> int:
        """Return the number of the middle cylinder, such as 100 of 200."""
        return self.scene.n_body // 2

    def named(self, *backends: str) -> Iterator[tuple[str, Trajectory]]:
        """Yield the runs of these backends that exist, in the order of drawing."""
        return ((name, self.runs[name]) for name in backends if name in self.runs)


def window(chains: Iterable[ChainRuns], factor: float) -> float:
    """Return the end of the time axis, s: ``factor`` times the arrival at the last body, at most the duration.

    It is the latest of all chains, because figures that are compared share their time axis.
    """
    ends = []
    for chain in chains:
        last = OBSERVABLES["arrival_at_end"].value(chain.scene, chain.reference)
        ends.append(min(factor * float(last), chain.scene.duration) if np.isfinite(last) else chain.scene.duration)
    return max(ends)


def velocity_map(
    title: str, chain: ChainRuns, end: float, *, shares: tuple[int, ...], theories: tuple[str, ...] = ("bca",)
) -> Panel:
    """Return velocity over cylinder and time until ``end`` (s), without the striker, and the fronts by theories."""
    name, run = chain.shown
    rows = int(np.searchsorted(run.time, end, side="right"))
    thin = slice(None, rows, _step(rows))
    bodies = np.arange(1.0, chain.scene.n_body)
    return Panel(
        title=title,
        x_label="cylinder",
        y_label="time (ms)",
        # a time is a whole number of samples: digits below 1e-9 ms are round-off
        map=Map(
            label="velocity (m/s)",
            x=bodies,
            y=np.round(1e3 * run.time[thin], 9),
            values=_rounded(run.velocity[thin, 1:]),
        ),
        series=tuple(
            Series(
                label=f"front by {LABELS.get(theory, theory)}",
                style=theory,
                x=bodies,
                y=1e3 * OBSERVABLES["arrival"].value(chain.scene, result)[1:],
            )
            for theory, result in chain.named(*theories)
        ),
        notes=(f"velocity by {LABELS.get(name, name)}",),
        shares_scale_with=shares,
    )


def residence_times(title: str, chain: ChainRuns, *, shares: tuple[int, ...]) -> Panel:
    """Return the residence time along the chain by all runs."""
    series, note = _once(list(_along(chain, "residence_time", 1e6)))
    return _panel(title, "cylinder", "residence time (µs)", series, shares, note)


def wave_speeds(title: str, chain: ChainRuns, *, shares: tuple[int, ...]) -> Panel:
    """Return the wave speed along the chain by all runs, and the power law fitted to the reference."""
    fit = speed_power_law(chain.scene, chain.reference)
    i = np.arange(fit.first, fit.last + 1)
    fitted = Series(label="fit", style="fit", x=i.astype(float), y=fit.speed(i))
    terms = f"b1 = {1e-6 * fit.b1:.4g}, b2 = {1e-6 * fit.b2:.4g} in 10⁶ (m/s)^{fit.exponent:g}"
    note = f"fit: {terms}, to {100.0 * fit.residual:.2f} % rms"
    series, same = _once(list(_along(chain, "wave_speed")))
    panel = _panel(title, "cylinder", "wave speed (m/s)", [*series, fitted], shares, note)
    return replace(panel, notes=(*panel.notes, same) if same else panel.notes)


def frequencies(chains: Sequence[tuple[str, ChainRuns]], *, place: int) -> list[Panel]:
    """Return the spectrum in time along each chain with its centroid.

    ``chains``: with their titles; ``place``: that of the first panel in the figure.
    """
    results = [frequency_spectrum(chain.scene, chain.shown[1], first=1) for _, chain in chains]
    power = [_normalised(_two_sided(result)) for result in results]
    # one axis for all, up to where the last column is dark
    highest = max(result.frequency[(p >= _DARK).any(axis=1)][-1] for result, p in zip(results, power, strict=True))
    panels = []
    for (title, chain), result, p in zip(chains, results, power, strict=True):
        rows = int(np.searchsorted(result.frequency, highest, side="right"))
        thin = slice(None, rows, _step(rows))
        spectrum = Map(label=_POWER, x=result.position, y=1e-3 * result.frequency[thin], values=p[thin])
        centroid = 1e-3 * result.centroid
        line = Series(label="centroid", style=chain.shown[0], x=spectrum.x, y=centroid)
        note = _from_to("kHz", cascade(frequency_spectrum(chain.scene, chain.shown[1])), scale=1e-3)
        shares = tuple(range(place, place + len(chains)))
        panels.append(_panel(title, "cylinder", "frequency (kHz)", [line], shares, note, spectrum))
    return panels


def wavenumbers(chains: Sequence[tuple[str, ChainRuns]], *, place: int) -> list[Panel]:
    """Return the spectrum along each chain in time with its centroid; arguments as in :func:`frequencies`.

    The shortest wave of two cylinders, which is once in a spectrum or not at all, is left out.
    """
    panels = []
    for title, chain in chains:
        item = wavenumber_spectrum(chain.scene, chain.shown[1], first=1)
        size = _step(len(item.time))
        power = _normalised(_means(_two_sided(item), size))[:-1]
        spectrum = Map(label=_POWER, x=_means(1e3 * item.time, size), y=item.frequency[:-1], values=power)
        line = Series(label="centroid", style=chain.shown[0], x=spectrum.x, y=_means(item.centroid, size))
        note = _from_to("1/cylinder", cascade(wavenumber_spectrum(chain.scene, chain.shown[1])))
        shares = tuple(range(place, place + len(chains)))
        panels.append(_panel(title, "time (ms)", "wavenumber (1/cylinder)", [line], shares, note, spectrum))
    return panels


def velocity_in_the_middle(title: str, chain: ChainRuns, *, shares: tuple[int, ...]) -> Panel:
    """Return the velocity of the middle cylinder while the impulse passes."""
    series, same = _once(list(_in_time(chain, "velocity", chain.middle)))
    note = "; ".join(filter(None, [f"cylinder {chain.middle}", same]))
    return _panel(title, "time (ms)", "velocity (m/s)", series, shares, note)


def force_in_the_middle(title: str, chain: ChainRuns, *, shares: tuple[int, ...]) -> Panel:
    """Return the force on the middle cylinder by the one before it, while the impulse passes."""
    contact = chain.middle - 1
    note = f"between cylinders {contact} and {contact + 1}"
    series, same = _once(list(_in_time(chain, "contact_force", contact)))
    note = "; ".join(filter(None, [note, same]))
    return _panel(title, "time (ms)", "contact force (N)", series, shares, note)


def peak_forces(title: str, chain: ChainRuns, *, shares: tuple[int, ...]) -> Panel:
    """Return the largest force of each contact by all runs."""
    label = "contact k, between cylinders k and k+1"
    series, note = _once(list(_along(chain, "peak_force")))
    return _panel(title, label, "largest contact force (N)", series, shares, note)


def force_against_stiffness(title: str, chain: ChainRuns, *, shares: tuple[int, ...]) -> Panel:
    """Return the largest force of each contact against its stiffness, the fitted power, and a guide of slope 2/5."""
    stiffness = chain.scene.contacts.stiffness
    fit = force_exponent(chain.scene, chain.reference)
    fitted = slice(fit.first, fit.last + 1)
    x = np.sort(stiffness[fitted])[[0, -1]]
    # a line of least squares goes through the mean of its points
    away = x / np.exp(np.mean(np.log(stiffness[fitted])))
    height = np.exp(np.mean(np.log(chain.reference.peak_force[fitted])))
    found, same = _once([_series(name, 1e-9 * stiffness, run.peak_force) for name, run in chain.named(*EVERY)])
    return Panel(
        title=title,
        x_label="contact stiffness (GN/m^1.5)",
        y_label="largest contact force (N)",
        series=(
            *found,
            Series(label="fit", style="fit", x=1e-9 * x, y=height * away**fit.slope),
            Series(label="slope 2/5", style="guide", x=1e-9 * x, y=GUIDE * height * away**0.4),
        ),
        log=True,
        notes=(
            f"exponent {fit.slope:.4f} for contacts {fit.first}-{fit.last};"
            f" others {fit.spread[0]:.4f}-{fit.spread[1]:.4f}",
            *([same] if same else []),
        ),
        shares_scale_with=shares,
    )


def speed_ratios(title: str, ratios: Ratios, backends: Sequence[str] = EVERY) -> Panel:
    """Return V_out/V_in against the mass gradient by each backend that has it for any gradient."""
    gammas = np.array([gamma for gamma, _ in ratios])
    return Panel(
        title=title,
        x_label="γ (1/cylinder)",
        y_label="V_out / V_in",
        series=tuple(
            _series(name, gammas, np.array([ratio.get(name, np.nan) for _, ratio in ratios]))
            for name in backends
            if any(name in ratio for _, ratio in ratios)
        ),
    )


def deviations(title: str, chain: ChainRuns, name: str, *, shares: tuple[int, ...]) -> Panel:
    """Return the size of the relative deviation from the reference along the chain, in per cent, by all other runs."""
    lines = list(_along(chain, name))
    truth = next(line for line in lines if line.style == "reference")
    series = [_deviation(line, line.y / truth.y) for line in lines if line is not truth]
    label = "contact" if OBSERVABLES[name].axis == ("contact",) else "cylinder"
    return replace(_panel(title, label, _AWAY, series, shares), log_y=True)


def ratio_deviations(title: str, ratios: Ratios, *, shares: tuple[int, ...]) -> Panel:
    """Return the size of the relative deviation of V_out/V_in from the reference, in per cent, by each backend."""
    panel = speed_ratios(title, ratios)
    truth = next((line for line in panel.series if line.style == "reference"), None)
    series = [_deviation(line, line.y / truth.y) for line in panel.series if truth is not None and line is not truth]
    return replace(panel, y_label=_AWAY, series=tuple(series), log_y=True, shares_scale_with=shares)


def _deviation(line: Series, ratio: Floats) -> Series:
    """Return the size of a deviation in per cent; where it is zero nothing is drawn."""
    size = 100.0 * np.abs(ratio - 1.0)
    return replace(line, y=np.where(size > 0.0, size, np.nan), bar=None)


def _panel(
    title: str,
    x_label: str,
    y_label: str,
    series: Iterable[Series],
    shares: tuple[int, ...],
    note: str = "",
    map: Map | None = None,
) -> Panel:
    return Panel(
        title=title,
        x_label=x_label,
        y_label=y_label,
        series=tuple(series),
        map=map,
        notes=(note,) if note else (),
        shares_scale_with=shares,
    )


def _series(name: str, x: Floats, y: Floats, uncertainty: Floats | None = None) -> Series:
    """Return a line or marks of a backend; an uncertainty that is nowhere finite is left out."""
    available = uncertainty if uncertainty is not None and np.isfinite(uncertainty).any() else None
    return Series(label=LABELS.get(name, name), style=name, x=x, y=y, bar=available)


def _along(chain: ChainRuns, name: str, factor: float = 1.0) -> Iterator[Series]:
    """Yield an observable of all runs along the chain, times a factor, with its uncertainty."""
    observable = OBSERVABLES[name]
    places = slice(None) if observable.axis == ("contact",) else slice(1, chain.scene.n_body - 1)
    for backend, run in chain.named(*EVERY):
        value, uncertainty = (
            factor * part(chain.scene, run)[places] for part in (observable.value, observable.uncertainty)
        )
        yield _series(
            backend, np.arange(float(places.start or 0), (places.start or 0) + len(value)), value, uncertainty
        )


def _once(series: list[Series]) -> tuple[list[Series], str]:
    """Return the lines, those on the line of the reference marked as not drawn, and a note that names these."""
    reference = next((line for line in series if line.style == "reference"), None)
    if reference is None:
        return series, ""
    height = float(np.nanmax(np.abs(reference.y)))
    same = [
        line.label
        for line in series
        if line is not reference
        and len(line.y) == len(reference.y)
        and float(np.nanmedian(np.abs(line.y - reference.y))) < _SEEN * height
    ]
    shown = [replace(line, drawn=line.label not in same) for line in series]
    return shown, f"within {_SEEN:.0%} of the height of this line: {', '.join(same)}" if same else ""


def _in_time(chain: ChainRuns, name: str, place: int) -> Iterator[Series]:
    """Yield an observable of all runs at one body or contact, while the impulse passes the middle."""
    for backend, run in chain.named(*IN_TIME):
        near = _while_there(chain, run)
        yield _series(backend, 1e3 * run.time[near], OBSERVABLES[name].value(chain.scene, run)[near, place])


def _step(count: int) -> int:
    return max(1, -(-count // MAP_ROWS))


def _rounded(values: Floats) -> Floats:
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    if not 0.0 < largest < np.inf:
        return values
    # the sum turns -0.0 into 0.0
    return np.asarray(np.round(values, MAP_DIGITS - int(np.ceil(np.log10(largest)))) + 0.0)


def _means(values: Floats, size: int) -> Floats:
    """Return the means of ``size`` columns each; leaving samples out would alias with the pulse's steps."""
    starts = np.arange(0, values.shape[-1], size)
    sums = np.add.reduceat(values, starts, axis=-1)
    return np.asarray(sums / np.diff(np.append(starts, values.shape[-1])))


def _two_sided(spectrum: Spectrum) -> Floats:
    """Return the density with twice the value at zero, as a one-sided spectrum has half of it there."""
    density = spectrum.density.copy()
    density[0] *= 2.0
    return density


def _normalised(density: Floats) -> Floats:
    """Return each column over its largest value, so that spectra of any energy can be compared."""
    return np.asarray(np.round(density / np.max(density, axis=0), MAP_DIGITS))


def _from_to(unit: str, ends: Cascade, *, scale: float = 1.0) -> str:
    """Return the means of the centroid over the first and the last tenth of the way, whose ratio the claims judge."""
    early, late = scale * ends.early, scale * ends.late
    return f"centroid: {early:.3g} {unit} over the first tenth of the way, {late:.3g} {unit} over the last"


def _while_there(chain: ChainRuns, run: Trajectory) -> slice:
    """Return the samples from 4 residence times before the impulse reaches the middle to 6 after.

    All samples are returned if it never reaches the middle.
    """
    before, stay = (
        OBSERVABLES[name].value(chain.scene, chain.reference)[chain.middle] for name in ("arrival", "residence_time")
    )
    if not np.isfinite(stay):
        return slice(None)
    first, last = np.searchsorted(run.time, (before - 4.0 * stay, before + 6.0 * stay))
    return slice(int(first), int(last))
