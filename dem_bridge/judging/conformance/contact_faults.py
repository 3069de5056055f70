"""Faults of contacts that any scene can show: of their law, of forces beside them, and of one body or contact."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from dem_bridge.judging.conformance.faults import (
    Candidate,
    Change,
    Family,
    Fault,
    SystemChange,
    changed,
    entry,
    family,
    from_each,
    placed,
    placed_family,
)
from dem_bridge.judging.conformance.scenes import Probe
from dem_bridge.judging.kernels import System
from dem_bridge.scene.scene import Damping
from dem_bridge.trajectory.trajectory import Floats

#: factor on a force that leaves none
_NO_FORCE = 1e-9
#: fields of a system by which the force of a contact is proportional
_FORCES = ("stiffness", "damping", "pull_off")
#: largest overlap of a Hertz contact over the product of contact time and speed, about
_OVERLAP_OF_TIME = 0.34


def laws(probe: Probe) -> Iterator[Candidate]:
    """Yield faults of the contact law, and forces that the scene does not have."""
    item = "hooke" if probe.question == "hooke" else "law"
    yield _all_missing()
    yield Family(lambda factor: _stiffer(factor, item), from_each(0.5, 2.0, 0.8, 1.25))
    yield from _exponents(probe)
    unit = 2.0 * float(np.mean(probe.scene.mass)) * max(map(abs, probe.scene.velocity)) / probe.contact_time
    yield Family(lambda share: _attracting(share * unit, item), from_each(0.01, 0.1))
    sentence = "Open contacts attract."
    yield Fault("tension", item, sentence, system=lambda system: system.changed(pulls=True))
    yield from _outer_forces(probe)
    sentence = "The start velocities are {:.5g} times those of the scene."
    yield family("start-velocity", "law", sentence, lambda f: changed("velocity", lambda v: tuple(f * x for x in v)))


def _stiffer(factor: float, item: str) -> Fault:
    """Return the fault that all contacts have another stiffness.

    Walls, static overlaps and damping forces may have it or not: other scenes decide.
    """
    factor = abs(factor)
    fault = Fault("stiffness-scale", item, f"All contacts have {factor:.5g} times the stiffness over mass.")
    of_motion = replace(fault, system=lambda system: system.changed(stiffness=factor * system.stiffness))
    of_scene = replace(fault, scene=changed("stiffness", lambda values: tuple(factor * k for k in values)))
    return replace(of_motion, elsewhere=lambda probe: (of_motion, of_scene))


def _exponents(probe: Probe) -> Iterator[Candidate]:
    """Yield other powers of the overlap: with the number of the stiffness, or with another force, too."""
    item = "hooke" if probe.question == "hooke" else "exponent"

    def power(n: float) -> Fault:
        fault = Fault("exponent", item, f"The contact force goes as overlap^{n - 1.0:.5g}.")
        same = replace(fault, system=lambda system: system.changed(exponent=_all(system, n)))
        # another law may have an exponent that is off by as much
        off = n - float(probe.scene.contacts.exponent[0])
        shifted = replace(fault, system=lambda system: system.changed(exponent=system.exponent + off))
        return replace(same, elsewhere=lambda _: (same, shifted))

    yield from map(power, (2.0, 2.5, 3.0))
    yield Family(power, from_each(2.1, 2.4, 2.6, 2.8))
    # the course of the velocity in a collision tells the exponent, whatever the stiffness
    yield Family(lambda n, factor: _power(probe, n, factor, item), ((2.1, 1.0), (2.4, 1.0), (2.6, 1.0), (2.9, 1.0)))


def _power(probe: Probe, n: float, factor: float, item: str) -> Fault:
    """Return the fault of forces as overlap^(n-1), with a factor on the force at an overlap near the largest.

    The unit of a stiffness is another one with another exponent, so that other scenes may have other factors.
    """
    overlap = _OVERLAP_OF_TIME * probe.contact_time * max(map(abs, probe.scene.velocity))

    def change(system: System) -> System:
        stiffness = abs(factor) * system.stiffness * overlap ** (system.exponent - n)
        return system.changed(exponent=_all(system, n), stiffness=stiffness)

    def forms(other: Probe) -> Sequence[Candidate]:
        return (Family(lambda factor: _power(other, n, factor, item), from_each(1.0)),)

    words = (
        f"The contact force goes as overlap^{n - 1.0:.5g}, with {abs(factor):.4g} times the force at {overlap:.2g} m."
    )
    return Fault("exponent", item, words, system=change, elsewhere=forms, definite=False)


def _attracting(force: float, item: str) -> Fault:
    """Return the fault of a constant attraction as long as a contact lasts, N."""

    def change(system: System) -> System:
        return system.changed(pull_off=np.where(system.stiffness > 0.0, abs(force), 0.0))

    return Fault("pull-off", item, f"Contacts attract with {abs(force):.3g} N.", system=change, jumps=True)


def _all(system: System, n: float) -> Floats:
    """Return one exponent for all contacts."""
    return np.full_like(system.exponent, n)


def _outer_forces(probe: Probe) -> Iterator[Candidate]:
    """Yield forces that the scene does not have: dashpots in contacts, drag, gravity."""
    time, speed = probe.contact_time, max(map(abs, probe.scene.velocity))
    if probe.scene.damping is None:
        sentence = "Contacts are damped, as by a dashpot of {:.3g} N s/m."
        unit = float(np.mean(probe.scene.mass)) / time
        yield family("damping", "energy", sentence, _dashpot, (0.02, 0.3), unit=unit, jumps=True)
    sentence = "Bodies lose speed at the rate {:.3g} 1/s, in contact or not: their momentum is not conserved."
    yield family(
        "drag", "momentum", sentence, lambda b: changed("drag", lambda _: abs(b)), (0.02, 0.3), unit=1.0 / time
    )
    if probe.scene.gravity == 0.0:
        sentence = "Bodies are accelerated by {:.4g} m/s^2, which the scene does not have."
        unit = speed / time
        yield family(
            "gravity", "gravity", sentence, lambda g: changed("gravity", lambda _: g), (0.05, -0.05), unit=unit
        )


def _dashpot(coefficient: float) -> Change:
    """Return a scene with dashpots, N s/m."""
    return lambda scene: replace(scene, damping=Damping(law="dashpot", coefficient=abs(coefficient)))


def bodies(probe: Probe) -> Iterator[Candidate]:
    """Yield faults of one body or contact, and of the forces of contacts on one of their two bodies.

    The stiffness of the only contact of a pair is a matter of the law.
    """
    scene = probe.scene
    item = "mixing" if probe.question == "mixing" else "contacts"
    contacts = range(len(scene.stiffness))
    for k in contacts:
        yield placed(lambda at: (_missing(at, item),), k, scene, "stiffness")
    for side in ("left", "right"):
        for k in contacts:
            yield placed(partial(_one_sided, side, item), k, scene, "stiffness")
    for k in contacts if len(contacts) > 1 else ():
        words = "Contact {} has {:.5g} times its stiffness."
        yield placed_family("stiffness", item, words, _entry_by("stiffness"), k, scene)
    for k in range(scene.n_body):
        yield placed_family("mass", item, "Body {} has {:.5g} times its mass.", _entry_by("mass"), k, scene)
    for side in ("left", "right"):
        words = f"No contact acts on its {side} body."
        yield Fault("momentum", "momentum", words, system=_acting(side, _NO_FORCE))
    yield Family(_unequal, from_each(0.5, 0.9, 1.1))


def _entry_by(key: str) -> Callable[[int, float], Change]:
    """Return the changes of one entry of a field by a factor."""
    return lambda place, factor: entry(key, place, abs(factor))


def _missing(contact: int, item: str) -> Fault:
    """Return the fault of a contact without force; static overlaps are those of the scene."""
    change = _acting_where(lambda numbers: numbers != contact + 1)
    return Fault("missed-contact", item, f"Contact {contact} does not act.", system=change)


def _all_missing() -> Fault:
    """Return the fault that no contact acts between bodies; walls may act or not."""
    fault = Fault("missed-contact", "contacts", "No contact acts.", system=_acting_where(lambda numbers: numbers < 0))
    walls = replace(fault, system=_acting_where(lambda numbers: (numbers == 0) | (numbers == numbers[-1])))
    return replace(fault, elsewhere=lambda probe: (fault, walls))


def _acting_where(acts: Callable[[Any], Any]) -> SystemChange:
    """Return the change of a system to one without some of its contacts; ``acts`` is given their numbers."""

    def change(system: System) -> System:
        where = acts(np.arange(len(system.stiffness)))
        return system.changed(**{name: where * getattr(system, name) for name in _FORCES})

    return change


def _one_sided(side: str, item: str, contact: int) -> Sequence[Fault]:
    """Return the fault of a contact that does not act on one of its bodies."""
    words = f"Contact {contact} does not act on its {side} body."
    return (Fault("missed-reaction", item, words, system=_acting(side, _NO_FORCE, contact)),)


def _unequal(factor: float) -> Fault:
    """Return the fault of forces on the two bodies of each contact that are not equal."""
    words = f"Contacts act on their right bodies with {abs(factor):.5g} times the force on their left bodies."
    return Fault("momentum", "momentum", words, system=_acting("right", abs(factor)))


def _acting(side: str, factor: float, contact: int | None = None) -> SystemChange:
    """Return the change of the force of a contact (None: of all) on the body on one side by a factor.

    Contacts with opposite forces move bodies of other masses in the same way: where the force on the right body is r
    times that on the left one, the masses and forces behind the contact are 1/r times theirs.
    """

    def change(system: System) -> System:
        ratio, forces = np.ones(len(system.mass)), np.ones(len(system.stiffness))
        at = slice(1, len(ratio)) if contact is None else slice(contact + 1, contact + 2)
        ratio[at] = factor if side == "right" else 1.0 / factor
        masses = 1.0 / np.cumprod(ratio)
        forces[1:] = masses
        if side == "left":
            forces[at] *= factor
        return system.changed(mass=masses * system.mass, **{name: forces * getattr(system, name) for name in _FORCES})

    return change
