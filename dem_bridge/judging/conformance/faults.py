"""Faults that any scene can show: of what is written, of the contact law, and of one body or contact.

A fault is another scene, or another reading of the values of the motion, with its name and its item. One that a scene
shows is applied to the reference of all other scenes, so that their questions are answered as if it were mended.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dem_bridge.judging.conformance.limit import QUANTITIES
from dem_bridge.judging.conformance.scenes import Probe
from dem_bridge.judging.kernels import System
from dem_bridge.scene.scene import Damping, Scene
from dem_bridge.trajectory.trajectory import Floats

#: factor on a stiffness that leaves no contact
_NO_CONTACT = 1e-9
#: powers of ten by which values in other units differ
_POWERS_OF_UNITS = (-9, -6, -3, -2, -1, 1, 2, 3, 6, 9)

Values = Mapping[str, Floats]
Change = Callable[[Scene], Scene]


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
    system: Callable[[System], System] = _same
    """What becomes of the numbers of the motion: statics and damping are those of the scene."""
    time_factor: float = 1.0
    """Times of the motion in those of the samples."""
    everywhere: bool = True
    """False for a fault of one body or contact of one scene."""

    @property
    def moves(self) -> bool:
        """True if the motion is another one, and not only what is written of it."""
        return self.scene is not _same or self.system is not _same or self.time_factor != 1.0


@dataclass(frozen=True)
class Family:
    """Faults that differ in one number, which is fitted."""

    make: Callable[[float], Fault]
    starts: tuple[float, ...]
    """Numbers from which the fit begins."""


Candidate = Fault | Family


def family(
    cause: str,
    item: str,
    sentence: str,
    change: Callable[[float], Change],
    starts: tuple[float, ...] = (0.5, 2.0),
    *,
    everywhere: bool = True,
    unit: float = 1.0,
) -> Family:
    """Return faults that differ in a number, in units of ``unit``; the sentence has a field for it."""

    def make(number: float) -> Fault:
        words = sentence.format(number * unit)
        return Fault(cause, item, words, change(number * unit), everywhere=everywhere)

    return Family(make, starts)


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
    for name in QUANTITIES:
        yield from _scaled(name)
    for rows, words in ((1, "before"), (-1, "after")):
        yield Fault("sampling-shift", "phase", f"Each sample is the one {words} it.", values=both(_shift(rows)))

    def faster(factor: float) -> Fault:
        words = f"The motion has {factor:.5g} times the speed of its times."
        return Fault("time-scale", "units", words, time_factor=abs(factor))

    yield Family(faster, (0.5, 2.0, 0.9, 1.1))


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
    yield Family(by, (0.5, 2.0))


def _shift(rows: int) -> Callable[[Floats], Floats]:
    """Return the shift of samples by rows; the samples at an end are repeated."""
    return lambda array: np.asarray(array[np.clip(np.arange(len(array)) - rows, 0, len(array) - 1)])


def laws(probe: Probe) -> Iterator[Candidate]:
    """Yield faults of the contact law, and forces that the scene does not have."""
    item = "hooke" if probe.question == "hooke" else "law"
    time, speed = probe.contact_time, max(map(abs, probe.scene.velocity))

    def stiffer(factor: float) -> Fault:
        words = f"All contacts have {abs(factor):.5g} times the stiffness over mass."
        change = lambda system: system.changed(stiffness=abs(factor) * system.stiffness)  # noqa: E731
        return Fault("stiffness-scale", item, words, system=change)

    def power(n: float) -> Fault:
        words = f"The contact force goes as overlap^{n - 1.0:.5g}."
        change = lambda system: system.changed(exponent=np.full_like(system.exponent, n))  # noqa: E731
        return Fault("exponent", "hooke" if item == "hooke" else "exponent", words, system=change)

    yield Family(stiffer, (0.5, 2.0, 0.8, 1.25))
    yield from map(power, (2.0, 2.5, 3.0))
    yield Family(power, (2.1, 2.4, 2.6, 2.8))
    sentence = "Open contacts attract."
    yield Fault("tension", item, sentence, system=lambda system: system.changed(pulls=True))
    if probe.scene.damping is None:
        sentence = "Contacts are damped, as by a dashpot of {:.3g} N s/m."
        unit = float(np.mean(probe.scene.mass)) / time
        yield family("damping", "energy", sentence, _dashpot, (0.02, 0.3), unit=unit)
    sentence = "Bodies lose speed at the rate {:.3g} 1/s, in contact or not."
    yield family("drag", "energy", sentence, lambda b: changed("drag", lambda _: abs(b)), (0.02, 0.3), unit=1.0 / time)
    if probe.scene.gravity == 0.0:
        sentence = "Bodies are accelerated by {:.4g} m/s^2, which the scene does not have."
        unit = speed / time
        yield family(
            "gravity", "gravity", sentence, lambda g: changed("gravity", lambda _: g), (0.05, -0.05), unit=unit
        )
    sentence = "The start velocities are {:.5g} times those of the scene."
    yield family("start-velocity", "law", sentence, lambda f: changed("velocity", lambda v: tuple(f * x for x in v)))


def _dashpot(coefficient: float) -> Change:
    """Return a scene with dashpots, N s/m."""
    return lambda scene: replace(scene, damping=Damping(law="dashpot", coefficient=abs(coefficient)))


def bodies(scene: Scene, item: str) -> Iterator[Candidate]:
    """Yield faults of one body or contact; the only contact of a pair is a matter of the law."""
    several = range(len(scene.stiffness)) if len(scene.stiffness) > 1 else range(0)
    for k in several:
        change = entry("stiffness", k, _NO_CONTACT)
        yield Fault("missed-contact", item, f"Contact {k} does not act.", change, everywhere=False)
    for key, words, places in (("stiffness", "Contact {} has", several), ("mass", "Body {} has", range(scene.n_body))):
        for k in places:
            sentence = f"{words.format(k)} {{:.5g}} times its {key}."
            yield family(key, item, sentence, _entry_by(key, k), everywhere=False)


def _entry_by(key: str, place: int) -> Callable[[float], Change]:
    """Return the changes of one entry by a factor."""
    return lambda factor: entry(key, place, abs(factor))
