"""Faults that any scene can show: of what is written, of the contact law, and of one body or contact.

A fault is another scene, or another reading of the values of the motion, with its name and its item. One that a scene
shows is applied to the reference of all other scenes, so that their questions are answered as if it were mended. It may
have another form there: the last contact has another number in a longer chain.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dem_bridge.judging.conformance.limit import QUANTITIES
from dem_bridge.judging.conformance.scenes import Probe
from dem_bridge.judging.kernels import System
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats

#: powers of ten by which values in other units differ
_POWERS_OF_UNITS = (-9, -6, -3, -2, -1, 1, 2, 3, 6, 9)

Values = Mapping[str, Floats]
Numbers = tuple[float, ...]
Change = Callable[[Scene], Scene]
SystemChange = Callable[[System], System]


def _same(value: Any) -> Any:
    """Return what is given."""
    return value


@dataclass(frozen=True)
class Fault:
    """One fault: what it makes of a scene, of the times and of the values of its motion."""

    cause: str
    item: str
    """Item that it fails."""
    sentence: str
    scene: Change = _same
    values: Callable[[Values], Values] = _same
    system: SystemChange = _same
    """What becomes of the numbers of the motion: statics and damping are those of the scene."""
    time_factor: float = 1.0
    """Times of the motion in those of the samples."""
    elsewhere: Callable[[Probe], Sequence[Candidate]] | None = None
    """Forms that the fault may have in another scene; None if it is the same everywhere."""
    of_body: bool = False
    """True for a fault of one body or contact."""
    definite: bool = True
    """False if the fault leaves open what other scenes are like."""
    jumps: bool = False
    """True if forces of the fault jump at a touch, which lowers the order of any method."""

    def forms(self, probe: Probe) -> Sequence[Candidate]:
        """Return the forms that the fault may have in a scene."""
        return (self,) if self.elsewhere is None else self.elsewhere(probe)

    @property
    def moves(self) -> bool:
        """True if the motion is another one, and not only what is written of it."""
        return self.scene is not _same or self.system is not _same or self.time_factor != 1.0


@dataclass(frozen=True)
class Family:
    """Faults that differ in one number or in several, which are fitted."""

    make: Callable[..., Fault]
    starts: tuple[Numbers, ...]
    """Numbers from which the fit begins."""


Candidate = Fault | Family


def family(
    cause: str,
    item: str,
    sentence: str,
    change: Callable[[float], Change],
    starts: tuple[float, ...] = (0.5, 2.0),
    *,
    unit: float = 1.0,
    jumps: bool = False,
) -> Family:
    """Return faults that differ in a number, in units of ``unit``; the sentence has a field for it."""

    def make(number: float) -> Fault:
        return Fault(cause, item, sentence.format(number * unit), change(number * unit), jumps=jumps)

    return Family(make, from_each(*starts))


def from_each(*numbers: float) -> tuple[Numbers, ...]:
    """Return the starts of a fit of one number."""
    return tuple((number,) for number in numbers)


def placed(make: Callable[[int], Sequence[Fault]], place: int, scene: Scene, key: str) -> Fault:
    """Return the fault of one body or contact of a scene.

    In another scene it is that of the same one, counted from the first or from the last. ``key``: a field of a scene
    that has a number for each of them. ``make`` returns the forms that the fault may have, the simplest first.
    """
    behind = len(getattr(scene, key)) - place

    def forms(other: Probe) -> Sequence[Candidate]:
        count = len(getattr(other.scene, key))
        return [form for at in sorted({place, count - behind}) if 0 <= at < count for form in make(at)]

    return replace(make(place)[0], elsewhere=forms, of_body=True)


def placed_family(
    cause: str, item: str, sentence: str, change: Callable[[int, float], Change], place: int, scene: Scene,
    starts: tuple[float, ...] = (0.5, 2.0),
) -> Family:  # fmt: skip
    """Return faults of one body or contact that differ in a number of the field ``cause`` of a scene.

    The sentence has a field for the place, and one for the number.
    """
    key = "velocity" if cause == "start-velocity" else cause

    def make(number: float) -> Fault:
        def of(at: int) -> Sequence[Fault]:
            fault = Fault(cause, item, sentence.format(at, number), change(at, number))
            # laws of damping and static overlaps may have the right mass
            by_motion = replace(fault, scene=_same, system=_heavier(at, abs(number)))
            return (fault, by_motion) if cause == "mass" else (fault,)

        return placed(of, place, scene, key)

    return Family(make, from_each(*starts))


def _heavier(body: int, factor: float) -> SystemChange:
    """Return the change of the mass of one body in its motion only."""

    def change(system: System) -> System:
        return system.changed(mass=np.where(np.arange(len(system.mass)) == body, factor, 1.0) * system.mass)

    return change


def changed(key: str, change: Callable[[Any], Any]) -> Change:
    """Return the change of one field of a scene."""

    def apply(scene: Scene) -> Scene:
        values: dict[str, Any] = {key: change(getattr(scene, key))}
        return replace(scene, **values)

    return apply


def entry(key: str, place: int, factor: float) -> Change:
    """Return the change of one entry of a field of a scene by a factor."""
    return changed(key, lambda values: tuple(factor * v if k == place else v for k, v in enumerate(values)))


def readings() -> Iterator[Candidate]:
    """Yield faults of what is written."""

    def both(change: Callable[[Floats], Floats]) -> Callable[[Values], Values]:
        return lambda values: {name: change(array) for name, array in values.items()}

    sentence = "The bodies are written in reverse order."
    yield Fault("order-of-bodies", "units", sentence, values=both(lambda array: array[:, ::-1]))
    sentence = "All velocities and displacements have the other sign."
    yield Fault("sign", "units", sentence, values=both(lambda array: -array))
    sentence = "Velocities are written as displacements, and displacements as velocities."
    exchanged = dict(zip(QUANTITIES, reversed(QUANTITIES), strict=True))
    yield Fault("columns", "units", sentence, values=lambda values: {name: values[exchanged[name]] for name in values})
    for name in QUANTITIES:
        yield from _scaled(name)
    for rows, words in ((1, "before"), (-1, "after")):
        yield Fault("sampling-shift", "phase", f"Each sample is the one {words} it.", values=both(_shift(rows)))

    def faster(factor: float) -> Fault:
        words = f"The motion has {factor:.5g} times the speed of its times."
        return Fault("time-scale", "units", words, time_factor=abs(factor))

    yield Family(faster, from_each(0.5, 2.0, 0.9, 1.1))


def _scaled(name: str) -> Iterator[Candidate]:
    """Yield factors of one quantity."""
    words = {"velocity": "velocities", "displacement": "displacements"}[name]

    def times(factor: float) -> Callable[[Values], Values]:
        return lambda values: {key: factor * array if key == name else array for key, array in values.items()}

    def by(factor: float) -> Fault:
        return Fault("units", "units", f"All {words} are {factor:.5g} times the right ones.", values=times(factor))

    yield Fault("sign", "units", f"All {words} have the other sign.", values=times(-1.0))
    for power in _POWERS_OF_UNITS:
        sentence = f"All {words} are 1e{power} times those in SI units."
        yield Fault("units", "units", sentence, values=times(10.0**power))
    yield Family(by, from_each(0.5, 2.0))


def _shift(rows: int) -> Callable[[Floats], Floats]:
    """Return the shift of samples by rows; the samples at an end are repeated."""
    return lambda array: np.asarray(array[np.clip(np.arange(len(array)) - rows, 0, len(array) - 1)])
