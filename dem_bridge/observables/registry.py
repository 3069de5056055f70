"""Define every quantity that is measured, planned, judged, tabulated or drawn, each in one place.

An :class:`Observable` is a quantity read off a run: its definition, unit and axes, functions that return its values and
their uncertainty, and the scale that relative differences are taken to. Checks, planning, work-precision, the model
hierarchy, the paper's tables, exports and the report read :data:`OBSERVABLES`; :func:`register` adds another one.

Windows in time or along the chain, and norms over what is inside, belong to the question that is asked and not to the
observable: they are arguments of :meth:`Observable.read` and in :mod:`dem_bridge.observables.errors`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from dem_bridge.errors import UsageError
from dem_bridge.observables import conserved, front
from dem_bridge.observables.forces import contact_force_uncertainty, first_peak_force
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.relative import own_scale
from dem_bridge.trajectory.trajectory import VOCABULARY, Floats, Trajectory

#: a quantity of a scene and a run of it, ``(n_axis, ...)`` in the order of ``Observable.axis``
Reader = Callable[[Scene, Trajectory], Floats]
#: axes that an observable may have, in this order; without any it is one number of the whole chain
AXES = ("time", "body", "contact")


class Measured(NamedTuple):
    """What is read off a run in one pass."""

    values: Floats
    uncertainty: Floats
    size: float = math.nan
    """A scale of the whole run, in the unit of the values, for an observable whose scale they do not give."""


@dataclass(frozen=True, kw_only=True)
class Window:
    """Hold the part of a run that is compared."""

    until: float = math.inf
    """s: the latest sample."""
    bodies: range | None = None
    """Numbers of consecutive bodies; None: all."""
    contacts: range | None = None

    def first(self, axis: str) -> int:
        """Return the number of the first sample, body or contact inside."""
        return self._slices(None)[axis].start or 0

    def of(self, axes: tuple[str, ...], run: Trajectory, values: Floats) -> Floats:
        """Return the part of values along some axes that is inside."""
        slices = self._slices(run)
        return np.asarray(values)[tuple(slices[axis] for axis in axes)]

    def _slices(self, run: Trajectory | None) -> dict[str, slice]:
        samples = slice(None)
        if run is not None and self.until < math.inf:
            samples = slice(int(np.searchsorted(run.time, self.until, side="right")))
        numbers = {"body": self.bodies, "contact": self.contacts}
        return {"time": samples} | {
            axis: slice(None) if part is None else slice(part.start, part.stop) for axis, part in numbers.items()
        }


#: the whole run
ALL = Window()


@dataclass(frozen=True, kw_only=True)
class Scale:
    """Define the scale of relative differences of an observable, computed from what is read off the reference."""

    name: str
    """In words; ``{name}`` and ``{axis}`` stand for those of the observable."""
    of: Callable[[Measured], Floats]
    """Function of the values in the window, in their unit, broadcast to them."""


#: the largest magnitude that the reference has anywhere: for traces, which pass through zero
LARGEST = Scale(
    name="largest |{name}| of the reference",
    of=lambda measured: np.asarray(np.max(np.abs(measured.values), initial=0.0)),
)
#: the value itself, or a thousandth of the largest in the chain where that is more
OWN = Scale(name="each {axis}'s own {name}", of=lambda measured: own_scale(measured.values))


def _whole(name: str) -> Scale:
    """Return a scale of the whole run, which is measured with the values."""
    return Scale(name=name, of=lambda measured: np.asarray(measured.size))


@dataclass(frozen=True, kw_only=True)
class Observable:
    """Define a quantity that is read off a run.

    ``value`` and ``uncertainty`` have one entry for each sample, body or contact that ``axis`` names: bodies from 0,
    contacts as :attr:`Scene.contacts`. A value is nan where a run has none, such as the arrival at a body that the
    impulse never reaches; an uncertainty is inf where the run has no estimate of it.
    """

    name: str
    """In snake_case, as it stands in tables, files and options."""
    definition: str
    """One sentence with the source of the definition."""
    unit: str
    """SI."""
    axis: tuple[str, ...]
    """Of :data:`AXES`."""
    value: Reader
    uncertainty: Reader
    """Estimated numerical error of ``value``, same shape and unit."""
    scale: Scale = OWN
    measure: Callable[[Scene, Trajectory], Measured] | None = None
    """Function for ``value`` and ``uncertainty`` in one pass, where they share their work; None: each alone."""

    def __post_init__(self) -> None:
        if not self.name.isidentifier() or self.axis != tuple(axis for axis in AXES if axis in self.axis):
            raise ValueError(
                f"observable {self.name!r} with axis {self.axis!r}; allowed: an identifier, some of {AXES}"
            )

    def read(self, scene: Scene, run: Trajectory, window: Window = ALL) -> Reading:
        """Return the values of a run inside a window, with their uncertainty and scale, in one pass."""
        if self.measure is not None:
            measured = self.measure(scene, run)
        else:
            measured = Measured(self.value(scene, run), self.uncertainty(scene, run))
        values, uncertainty = (window.of(self.axis, run, part) for part in measured[:2])
        uncertainty = np.where(np.isnan(uncertainty), np.inf, uncertainty)
        return Reading(
            observable=self,
            values=values,
            uncertainty=np.where(np.isnan(values), np.nan, uncertainty),
            scale=np.broadcast_to(self.scale.of(measured._replace(values=values)), values.shape),
            window=window,
        )

    @property
    def words(self) -> str:
        """Return the name as it stands in a sentence."""
        return self.name.replace("_", " ")

    @property
    def scale_name(self) -> str:
        """Return the scale in words."""
        return self.scale.name.format(name=self.name, axis=self.axis[-1] if self.axis else "chain")


@dataclass(frozen=True, kw_only=True, eq=False)
class Reading:
    """Hold the values of one observable of one run inside a window, with their uncertainty and scale, in its unit."""

    observable: Observable
    values: Floats
    uncertainty: Floats
    """Of each value; nan where there is none."""
    scale: Floats
    """Of differences from this run; same shape as the values."""
    window: Window = ALL


def _measured(
    name: str,
    definition: str,
    unit: str,
    axis: tuple[str, ...],
    measure: Callable[[Scene, Trajectory], Measured],
    scale: Scale = OWN,
) -> Observable:
    """Return the observable whose values and uncertainties are measured in one pass."""
    return Observable(
        name=name,
        definition=definition,
        unit=unit,
        axis=axis,
        value=lambda scene, run: measure(scene, run).values,
        uncertainty=lambda scene, run: measure(scene, run).uncertainty,
        scale=scale,
        measure=measure,
    )


def _stored(name: str, definition: str, scale: Scale, uncertainty: Reader | None = None) -> Observable:
    """Return the observable of an array that every trajectory stores."""
    unit, _, axis = VOCABULARY[name]

    def measure(scene: Scene, run: Trajectory) -> Measured:
        values = np.asarray(getattr(run, name))
        given = np.broadcast_to(run.uncertainty[name], values.shape) if uncertainty is None else uncertainty(scene, run)
        return Measured(values, given)

    return _measured(name, definition, unit, axis, measure, scale)


def _wave_speed(scene: Scene, run: Trajectory) -> Measured:
    """Return the front speed times the spacing of the bodies; nan for a scene without one."""
    spacing = np.nan if scene.spacing is None else scene.spacing
    return Measured(spacing * front.front_speed(None, run), spacing * front.front_speed_uncertainty(None, run))


OBSERVABLES_IN_ORDER = (
    _stored("velocity", "Velocity of the body at each sample.", LARGEST),
    _stored("displacement", "Displacement of the body from its start at each sample.", LARGEST),
    _stored(
        "contact_force",
        "Compressive force of the contact at each sample, with its damping.",
        LARGEST,
        contact_force_uncertainty,
    ),
    _measured(
        "arrival",
        "Time at which the impulse reaches the body: the first maximal compression of the contact on its struck"
        " side (Chaunsali, Kim & Yang 2018, section 4a).",
        "s",
        ("body",),
        lambda scene, run: Measured(front.arrival(None, run), front.arrival_uncertainty(None, run)),
    ),
    _measured(
        "arrival_at_end",
        "Arrival of the impulse at the last body of the chain.",
        "s",
        (),
        lambda scene, run: Measured(front.arrival(None, run)[-1], front.arrival_uncertainty(None, run)[-1]),
    ),
    _measured(
        "residence_time",
        "Time between the first maximal compressions of the two contacts of the body, during which it holds the"
        " impulse (Chaunsali, Kim & Yang 2018, section 4a).",
        "s",
        ("body",),
        lambda scene, run: Measured(front.residence_time(None, run), front.residence_time_uncertainty(None, run)),
    ),
    _measured(
        "front_speed",
        "Speed of the wave front at the body in bodies per second: the inverse of the residence time.",
        "1/s",
        ("body",),
        lambda scene, run: Measured(front.front_speed(None, run), front.front_speed_uncertainty(None, run)),
    ),
    _measured(
        "wave_speed",
        "Speed of the wave front at the body: the spacing of the bodies over the residence time (Chaunsali, Kim &"
        " Yang 2018, eq. 3.6).",
        "m/s",
        ("body",),
        _wave_speed,
    ),
    _measured(
        "peak_velocity",
        "Largest velocity of the body until it hands the impulse on.",
        "m/s",
        ("body",),
        lambda scene, run: Measured(*front.peak_velocity_of_front(scene, run).largest),
    ),
    _measured(
        "peak_velocity_time",
        "Time at which the body has its largest velocity before it hands the impulse on.",
        "s",
        ("body",),
        lambda scene, run: Measured(*front.peak_velocity_of_front(scene, run).when),
    ),
    _stored("peak_force", "Largest compressive force of the contact during the run.", OWN),
    _measured(
        "first_peak_force",
        "Elastic force of the contact at its first maximal compression; a later wave may press harder.",
        "N",
        ("contact",),
        lambda scene, run: Measured(*first_peak_force(scene, run)),
    ),
    _stored("crossing_time", "Time of the first maximal compression of the contact.", OWN),
    _measured(
        "momentum",
        "Total momentum of the bodies at each sample.",
        "kg m/s",
        ("time",),
        lambda scene, run: Measured(*conserved.measure_momentum(scene, run)),
        _whole("total mass times largest velocity"),
    ),
    _measured(
        "energy",
        "Energy of motion, contacts and height at each sample.",
        "J",
        ("time",),
        lambda scene, run: Measured(*conserved.measure_energy(scene, run)),
        _whole("most energy in motion, contacts and height"),
    ),
    _measured(
        "energy_less_work",
        "Energy at each sample less the work that the drive has done.",
        "J",
        ("time",),
        lambda scene, run: Measured(*conserved.measure_energy_less_work(scene, run)),
        # what a precompressed chain stores is no measure of a small wave
        _whole("most energy in motion and work done"),
    ),
)
_REGISTRY = {observable.name: observable for observable in OBSERVABLES_IN_ORDER}
#: name -> observable, in the order of tables
OBSERVABLES: Mapping[str, Observable] = MappingProxyType(_REGISTRY)


def register(observable: Observable) -> Observable:
    """Add an observable to :data:`OBSERVABLES` and return it.

    It then is in the tables of verifications, work-precision and exports, and accuracy can be planned for it.

    Parameters
    ----------
    observable : Observable
        With a name that is not in use.

    Raises
    ------
    UsageError
        If the name is in use.

    """
    if observable.name in _REGISTRY:
        raise UsageError(f"observable = {observable.name!r} is registered already; allowed: another name")
    _REGISTRY[observable.name] = observable
    return observable


def observable_named(name: str) -> Observable:
    """Return the observable of that name; UsageError, with the names that are allowed, if there is none.

    Examples
    --------
    >>> residence_time = observable_named("residence_time")
    >>> residence_time.unit, residence_time.axis, residence_time.scale_name
    ('s', ('body',), "each body's own residence_time")

    """
    if name not in OBSERVABLES:
        raise UsageError(f"observable = {name!r}; allowed: {', '.join(OBSERVABLES)}")
    return OBSERVABLES[name]
