"""Uncertain parameters: what each name changes in a scene, or in the chain of measurement.

The name of a parameter is a kind ("stiffness": the same change at all places), a kind at one place ("stiffness[3]"), or
a kind at each place independently ("stiffness[*]").
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from dem_bridge.errors import SceneError, UsageError
from dem_bridge.scene.file.conversion import rounded
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats


class Kind(NamedTuple):
    """A kind of parameters: its unit ("" for a change relative to the scene), the kind of its places, its effect."""

    unit: str
    axis: str
    """ "body" or "contact"; "" for a parameter of the measurement."""
    change: Callable[[Scene, Floats], Scene] | None = None
    """Return a scene with the changes at all places; None for a parameter of the measurement."""


def _stiffness(scene: Scene, change: Floats) -> Scene:
    return _of_contacts(scene, "stiffness", lambda value, k: value * (1.0 + change[k]))


def _exponent(scene: Scene, change: Floats) -> Scene:
    return _of_contacts(scene, "exponent", lambda value, k: value + change[k])


def _of_contacts(scene: Scene, name: str, changed: Callable[[float, int], float]) -> Scene:
    """Return the scene with another stiffness or exponent in its contacts and walls."""
    links = getattr(scene, name)
    walls = [side for side in ("wall_left", "wall_right") if getattr(scene, side) is not None]
    fields: dict[str, Any] = {
        side: replace(getattr(scene, side), **{name: changed(getattr(getattr(scene, side), name), k)})
        for k, side in enumerate(walls, start=len(links))
    }
    fields[name] = tuple(changed(value, k) for k, value in enumerate(links))
    return replace(scene, **fields)


def _mass(scene: Scene, change: Floats) -> Scene:
    return replace(scene, mass=tuple(np.array(scene.mass) * (1.0 + change)))


def _velocity(scene: Scene, change: Floats) -> Scene:
    return replace(scene, velocity=tuple(np.array(scene.velocity) * (1.0 + change)))


def _damping(scene: Scene, change: Floats) -> Scene:
    if scene.damping is None:
        raise UsageError(f"parameter damping: {scene.name} has none; allowed: a scene with [chain.damping]")
    coefficient = np.array(scene.damping.coefficient) * (1.0 + change)
    return replace(scene, damping=replace(scene.damping, coefficient=tuple(coefficient)))


def _angle(scene: Scene, change: Floats) -> Scene:
    geometry = scene.geometry
    if geometry is None or all(angle is None for angle in geometry.angle):
        raise UsageError(f"parameter angle: {scene.name} has no contact angles; allowed: a scene with cylinders")
    angles, stiffness = list(geometry.angle), list(scene.stiffness)
    for k, angle in enumerate(angles):
        if angle is not None and change[k] != 0.0:
            turned = (angle + change[k]) % 180.0
            angles[k] = min(turned, 180.0 - turned)
    changed = replace(geometry, angles=tuple(angles), stiffness=None)
    for k, angle in enumerate(geometry.angle):
        if angle != angles[k]:
            # relative to the law at the scene's own angle, so that no change is exactly none
            stiffness[k] = rounded(
                stiffness[k] * changed.contact(k, changed.law).stiffness / geometry.contact(k, geometry.law).stiffness
            )
    return replace(scene, stiffness=tuple(stiffness), geometry=changed)


KINDS: Mapping[str, Kind] = {
    "stiffness": Kind("", "contact", _stiffness),
    "mass": Kind("", "body", _mass),
    "velocity": Kind("", "body", _velocity),
    "exponent": Kind("1", "contact", _exponent),
    "damping": Kind("", "contact", _damping),
    "angle": Kind("degrees", "contact", _angle),
    "gain": Kind("", ""),
    "time": Kind("s", ""),
}
_NAME = re.compile(r"([a-z]+)(?:\[(\d{1,9}|\*)\])?")


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A parameter with its standard uncertainty, relative to the scene's value or in the unit of its kind."""

    kind: str
    place: int | None
    """Body or contact; None means all, with the same change."""
    uncertainty: float
    independent: bool = False
    """Whether it is one of many that were declared together, each independent of the others."""

    @property
    def name(self) -> str:
        """Name as in the scene file, such as "stiffness" or "mass[3]"."""
        return self.kind if self.place is None else f"{self.kind}[{self.place}]"

    @property
    def of_measurement(self) -> bool:
        """True for a parameter of the chain of measurement: a gain or a time of zero."""
        return KINDS[self.kind].change is None


def parameters_of(declared: Mapping[str, float], scene: Scene) -> tuple[Parameter, ...]:
    """Return the parameters of a table name -> standard uncertainty; "[*]" stands for one parameter at each place.

    Raises
    ------
    UsageError
        If a name or a place does not exist, or if an uncertainty is not a positive number.

    Examples
    --------
    >>> import dem_bridge as db
    >>> scene = db.Scene(name="three", duration=1e-3, mass=(1, 1, 1), stiffness=(1e9, 1e9), velocity=(1, 0, 0))
    >>> [parameter.name for parameter in parameters_of({"velocity": 0.01, "stiffness[*]": 0.02}, scene)]
    ['velocity', 'stiffness[0]', 'stiffness[1]']
    """
    parameters = []
    for name, uncertainty in declared.items():
        match = _NAME.fullmatch(name)
        if match is None or match[1] not in KINDS:
            raise UsageError(f"parameter {name!r} is unknown; allowed: {', '.join(KINDS)}, or one at a place: mass[3]")
        if not 0.0 < uncertainty < np.inf:
            raise UsageError(f"parameter {name} = {uncertainty!r}; allowed: a standard uncertainty > 0")
        kind, place = match[1], match[2]
        axis = KINDS[kind].axis
        count = {"body": scene.n_body, "contact": scene.n_contact, "": 0}[axis]
        if place is not None and place != "*" and int(place) >= count:
            allowed = f"{axis} 0 to {count - 1}" if axis else "no place, because it belongs to the measurement"
            raise UsageError(f"parameter {name!r}; allowed: {allowed}")
        places = range(count) if place == "*" else [None if place is None else int(place)]
        for nth in places:
            new = Parameter(kind=kind, place=nth, uncertainty=uncertainty, independent=place == "*")
            if new.kind != "velocity" or nth is None or scene.velocity[nth] != 0.0:
                parameters.append(new)
    changed(scene, parameters, [1e-3 * parameter.uncertainty for parameter in parameters])
    return tuple(parameters)


def changed(scene: Scene, parameters: Iterable[Parameter], changes: Iterable[float]) -> Scene:
    """Return the scene with its parameters changed; those of the measurement change nothing.

    Raises
    ------
    UsageError
        If the changed scene is invalid.
    """
    sums: dict[str, Floats] = {}
    for parameter, change in zip(parameters, changes, strict=True):
        kind = KINDS[parameter.kind]
        if kind.change is not None and change != 0.0:
            count = scene.n_body if kind.axis == "body" else scene.n_contact
            total = sums.setdefault(parameter.kind, np.zeros(count))
            total[slice(None) if parameter.place is None else parameter.place] += change
    result = scene
    for name, total in sums.items():
        apply = KINDS[name].change
        assert apply is not None
        try:
            result = apply(result, total)
        except SceneError as error:
            raise UsageError(
                f"parameter {name}: a change by {float(total[np.argmax(np.abs(total))]):.3g} gives an invalid scene"
                f" ({error}); allowed: a smaller uncertainty"
            ) from None
    return result
