"""Define every quantity that is measured, planned, judged, tabulated or drawn, each in one place.

An :class:`Observable` is a quantity read off a run: its definition, unit and axes, functions that return its values and
their uncertainty, and the scale that relative differences are taken to. Checks, planning, work-precision, the model
hierarchy, the paper's tables, exports and the report read :data:`OBSERVABLES`; :func:`register` adds another one.

Windows in time or along the chain, and norms over what is inside, belong to the question that is asked and not to the
observable: they are arguments in :mod:`dem_bridge.observables.errors`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from dem_bridge.errors import UsageError
from dem_bridge.observables import conserved, front
from dem_bridge.observables.forces import contact_force_uncertainty, first_peak_force
from dem_bridge.observables.front import peak_velocity_of_front
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import VOCABULARY, Floats, Trajectory, own_scale

#: a quantity of a scene and a run of it, ``(n_axis, ...)`` in the order of ``Observable.axis``
Reader = Callable[[Scene, Trajectory], Floats]
#: axes that an observable may have, in this order; without any it is one number of the whole chain
AXES = ("time", "body", "contact")


@dataclass(frozen=True, kw_only=True)
class Scale:
    """Define the scale of relative differences of an observable, computed from the reference."""

    name: str
    """In words; ``{name}`` and ``{axis}`` stand for those of the observable."""
    of: Callable[[Scene, Trajectory, Floats], Floats]
    """f(scene, reference, its values in the window), in the unit of the observable, broadcast to the values."""


#: the largest magnitude that the reference has anywhere: for traces, which pass through zero
LARGEST = Scale(
    name="largest |{name}| of the reference",
    of=lambda scene, run, values: np.asarray(np.max(np.abs(values), initial=0.0)),
)
#: the value itself, or a thousandth of the largest in the chain where that is more
OWN = Scale(name="each {axis}'s own {name}", of=lambda scene, run, values: own_scale(values))


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

    def __post_init__(self) -> None:
        if not self.name.isidentifier() or self.axis != tuple(axis for axis in AXES if axis in self.axis):
            raise ValueError(
                f"observable {self.name!r} with axis {self.axis!r}; allowed: an identifier, some of {AXES}"
            )

    @property
    def words(self) -> str:
        """Return the name as it stands in a sentence."""
        return self.name.replace("_", " ")

    @property
    def scale_name(self) -> str:
        """Return the scale in words."""
        return self.scale.name.format(name=self.name, axis=self.axis[-1] if self.axis else "chain")


def _stored(name: str, definition: str, scale: Scale, uncertainty: Reader | None = None) -> Observable:
    """Return the observable of an array that every trajectory stores."""
    unit, _, axis = VOCABULARY[name]

    def value(scene: Scene, run: Trajectory) -> Floats:
        return np.asarray(getattr(run, name))

    def stored(scene: Scene, run: Trajectory) -> Floats:
        return np.broadcast_to(run.uncertainty[name], value(scene, run).shape)

    return Observable(
        name=name,
        definition=definition,
        unit=unit,
        axis=axis,
        value=value,
        uncertainty=uncertainty or stored,
        scale=scale,
    )


def _spacing(scene: Scene) -> float:
    """Return the spacing of the bodies, m; nan for a scene without one."""
    return np.nan if scene.spacing is None else scene.spacing


OBSERVABLES_IN_ORDER = (
    _stored("velocity", "Velocity of the body at each sample.", LARGEST),
    _stored("displacement", "Displacement of the body from its start at each sample.", LARGEST),
    _stored(
        "contact_force",
        "Compressive force of the contact at each sample, with its damping.",
        LARGEST,
        contact_force_uncertainty,
    ),
    Observable(
        name="arrival",
        definition=(
            "Time at which the impulse reaches the body: the first maximal compression of the contact on its struck"
            " side (Chaunsali, Kim & Yang 2018, section 4a)."
        ),
        unit="s",
        axis=("body",),
        value=front.arrival,
        uncertainty=front.arrival_uncertainty,
    ),
    Observable(
        name="arrival_at_end",
        definition="Arrival of the impulse at the last body of the chain.",
        unit="s",
        axis=(),
        value=lambda scene, run: front.arrival(scene, run)[-1],
        uncertainty=lambda scene, run: front.arrival_uncertainty(scene, run)[-1],
    ),
    Observable(
        name="residence_time",
        definition=(
            "Time between the first maximal compressions of the two contacts of the body, during which it holds the"
            " impulse (Chaunsali, Kim & Yang 2018, section 4a)."
        ),
        unit="s",
        axis=("body",),
        value=front.residence_time,
        uncertainty=front.residence_time_uncertainty,
    ),
    Observable(
        name="front_speed",
        definition="Speed of the wave front at the body in bodies per second: the inverse of the residence time.",
        unit="1/s",
        axis=("body",),
        value=front.front_speed,
        uncertainty=front.front_speed_uncertainty,
    ),
    Observable(
        name="wave_speed",
        definition=(
            "Speed of the wave front at the body: the spacing of the bodies over the residence time (Chaunsali, Kim &"
            " Yang 2018, eq. 3.6)."
        ),
        unit="m/s",
        axis=("body",),
        value=lambda scene, run: _spacing(scene) * front.front_speed(scene, run),
        uncertainty=lambda scene, run: _spacing(scene) * front.front_speed_uncertainty(scene, run),
    ),
    Observable(
        name="peak_velocity",
        definition="Largest velocity of the body until it hands the impulse on.",
        unit="m/s",
        axis=("body",),
        value=lambda scene, run: peak_velocity_of_front(scene, run).velocity,
        uncertainty=lambda scene, run: peak_velocity_of_front(scene, run).uncertainty,
    ),
    Observable(
        name="peak_velocity_time",
        definition="Time at which the body has its largest velocity before it hands the impulse on.",
        unit="s",
        axis=("body",),
        value=lambda scene, run: peak_velocity_of_front(scene, run).time,
        uncertainty=lambda scene, run: peak_velocity_of_front(scene, run).time_uncertainty,
    ),
    _stored("peak_force", "Largest compressive force of the contact during the run.", OWN),
    Observable(
        name="first_peak_force",
        definition="Elastic force of the contact at its first maximal compression; a later wave may press harder.",
        unit="N",
        axis=("contact",),
        value=lambda scene, run: first_peak_force(scene, run)[0],
        uncertainty=lambda scene, run: first_peak_force(scene, run)[1],
    ),
    _stored("crossing_time", "Time of the first maximal compression of the contact.", OWN),
    Observable(
        name="momentum",
        definition="Total momentum of the bodies at each sample.",
        unit="kg m/s",
        axis=("time",),
        value=conserved.momentum,
        uncertainty=conserved.momentum_uncertainty,
        scale=Scale(
            name="total mass times largest velocity",
            of=lambda scene, run, values: np.asarray(sum(scene.mass) * np.max(np.abs(run.velocity), initial=0.0)),
        ),
    ),
    Observable(
        name="energy",
        definition="Energy of motion, contacts and height at each sample.",
        unit="J",
        axis=("time",),
        value=conserved.energy,
        uncertainty=conserved.energy_uncertainty,
        scale=Scale(
            name="most energy in motion, contacts and height",
            of=lambda scene, run, values: np.asarray(
                np.max(sum(map(np.abs, conserved.energy_parts(scene, run))), initial=0.0),
            ),
        ),
    ),
    Observable(
        name="energy_less_work",
        definition="Energy at each sample less the work that the drive has done.",
        unit="J",
        axis=("time",),
        value=lambda scene, run: conserved.energy(scene, run) - conserved.work(scene, run)[0],
        uncertainty=lambda scene, run: conserved.energy_uncertainty(scene, run) + conserved.work(scene, run)[1],
        # what a precompressed chain stores is no measure of a small wave
        scale=Scale(
            name="most energy in motion and work done",
            of=lambda scene, run, values: np.asarray(
                np.max(conserved.energy_parts(scene, run)[0] + np.abs(conserved.work(scene, run)[0]), initial=0.0)
            ),
        ),
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
