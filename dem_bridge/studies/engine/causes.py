"""Causes of wrong impacts: each is another physics, whose twin repeats LAMMPS if it is the cause."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from types import MappingProxyType

from dem_bridge.studies.engine.impacts import POISSON, TOUCH, Contact, Impact, Steps
from dem_bridge.studies.engine.motion import Motion, twins

#: largest difference of closing speeds between LAMMPS and a twin that repeats it, relative to the closing speed at the
#: start; positions leave 3e-11
TOLERANCE = 1e-9
NOT_A_NUMBER = "velocities are not numbers"
UNKNOWN = "unknown"
#: between two causes
AND = ", and "


def _damping(factor: float) -> Callable[[Impact, Contact], Contact]:
    return lambda impact, c: replace(c, damping=factor * c.damping)


def _mass(factor: float) -> Callable[[Impact, Contact], Contact]:
    """Return the contact with another mass in its damping; a damping by restitution has the root of it."""

    def change(impact: Impact, c: Contact) -> Contact:
        by_root = impact.damping in ("tsuji", "coeff_restitution")
        return c if impact.damping == "velocity" else _damping(math.sqrt(factor) if by_root else factor)(impact, c)

    return change


def _stiffness(factor: float) -> Callable[[Impact, Contact], Contact]:
    """Return the contact with another stiffness, of which a damping by restitution has the root."""

    def change(impact: Impact, c: Contact) -> Contact:
        by_root = impact.damping in ("tsuji", "coeff_restitution")
        return replace(c, stiffness=factor * c.stiffness, damping=c.damping * (math.sqrt(factor) if by_root else 1.0))

    return change


def _radius(factor: float) -> Callable[[Impact, Contact], Contact]:
    """Return the contact with another effective radius."""

    def change(impact: Impact, c: Contact) -> Contact:
        if impact.linear:
            return c
        new = _stiffness(math.sqrt(factor))(impact, c)
        by_area = impact.damping == "viscoelastic" or impact.law == "hertz/history"
        return replace(new, pull_off=factor * c.pull_off, damping=new.damping * (math.sqrt(factor) if by_area else 1.0))

    return change


#: cause -> the physics that it makes of a contact
CAUSES: Mapping[str, Callable[[Impact, Contact], Contact]] = MappingProxyType(
    {
        "the damping lacks a factor sqrt(2)": _damping(math.sqrt(0.5)),
        "the damping has twice the effective mass": _mass(2.0),
        "the damping has half the effective mass": _mass(0.5),
        "the effective radius is twice as large": _radius(2.0),
        "the effective radius is half as large": _radius(0.5),
        "E* is twice as large, that of a rigid wall": _stiffness(2.0),
        "E* is half as large": _stiffness(0.5),
        "E* of a wall has 1 - nu in place of 1 - nu^2": _stiffness(1.0 + POISSON),
        "the net force is not clipped": lambda impact, c: replace(c, clip=False),
        "the net force is clipped": lambda impact, c: replace(c, clip=True),
        "the contact opens at its least force": lambda impact, c: replace(c, breaks=1.0),
        "the contact opens at overlap 0": lambda impact, c: replace(c, breaks=TOUCH),
    }
)


def causes_of(wrong: Sequence[tuple[Impact, Steps, Motion]]) -> list[str]:
    """Return the cause of each wrong impact: the first one or two whose twin repeats LAMMPS.

    Parameters
    ----------
    wrong : sequence of (Impact, Steps, Motion)
        Impacts with what LAMMPS made of them.
    """
    names = [UNKNOWN if motion.finite else NOT_A_NUMBER for *_, motion in wrong]
    for count in (1, 2):
        trials = [
            (at, AND.join(causes), contact)
            for at, (impact, *_) in enumerate(wrong)
            if names[at] == UNKNOWN
            for causes in combinations(CAUSES, count)
            if (contact := _changed(impact, causes)) is not None
        ]
        runs = twins([contact for *_, contact in trials], [wrong[at][1] for at, *_ in trials])
        for (at, cause, _), run in zip(trials, runs, strict=True):
            if names[at] == UNKNOWN and run.difference(wrong[at][2]) <= TOLERANCE:
                names[at] = cause
    return names


def _changed(impact: Impact, causes: Sequence[str]) -> Contact | None:
    """Return the contact of an impact with these causes; None if one of them has no effect."""
    contact = impact.contact
    for cause in causes:
        before, contact = contact, CAUSES[cause](impact, contact)
        if contact == before:
            return None
    return contact
