"""What an observable is: its definition, unit, axes, values, uncertainty and the scale of relative differences.

A module of this folder declares its observables in a tuple ``DECLARED``, where :mod:`~dem_bridge.observables.registry`
finds them. Windows in time or along the chain, and norms over what is inside, belong to the question that is asked and
not to the observable: they are arguments of :meth:`Observable.read` and in :mod:`dem_bridge.observables.differences`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.relative import own_scale
from dem_bridge.trajectory.trajectory import VOCABULARY, Floats, Trajectory

#: a quantity of a scene and a run of it, ``(n_axis, ...)`` in the order of ``Observable.axis``
Reader = Callable[[Scene, Trajectory], Floats]
#: a quantity that needs no scene
ReaderOfRun = Callable[[None, Trajectory], Floats]
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


def whole(name: str) -> Scale:
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
    follows: str = ""
    """Name of the observable of which this one is a function: its error then follows from that one's. A verification
    judges that one instead, and a plan predicts the error by that one's where it has no law for this one. Empty: none.
    """
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


def measured(
    measure: Callable[[Scene, Trajectory], Measured],
    *,
    name: str,
    definition: str,
    unit: str,
    axis: tuple[str, ...],
    scale: Scale = OWN,
    follows: str = "",
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
        follows=follows,
        measure=measure,
    )


def of_run(value: ReaderOfRun, uncertainty: ReaderOfRun) -> Callable[[Scene, Trajectory], Measured]:
    """Return the function that measures what a run alone has: value and uncertainty need no scene."""

    def measure(scene: Scene, run: Trajectory) -> Measured:
        return Measured(value(None, run), uncertainty(None, run))

    return measure


def stored(
    name: str, definition: str, scale: Scale, *, uncertainty: Reader | None = None, follows: str = ""
) -> Observable:
    """Return the observable of an array that every trajectory stores; ``uncertainty``: None for that of the run."""
    unit, _, axis = VOCABULARY[name]

    def measure(scene: Scene, run: Trajectory) -> Measured:
        values = np.asarray(getattr(run, name))
        given = np.broadcast_to(run.uncertainty[name], values.shape) if uncertainty is None else uncertainty(scene, run)
        return Measured(values, given)

    return measured(measure, name=name, definition=definition, unit=unit, axis=axis, scale=scale, follows=follows)
