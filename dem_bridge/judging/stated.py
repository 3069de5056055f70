"""What a deck or the first sample of a file states about the scene: compared with the scene before anything is fitted.

Statements are certain where fits are not: a deck with another density has another mass, although no trajectory can tell
it from another stiffness.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from dem_bridge.errors import DemBridgeError
from dem_bridge.formats.readers.record import Record
from dem_bridge.judging.chain_hypotheses import stiffness_patterns, uniform_name
from dem_bridge.judging.hypotheses import Variant
from dem_bridge.judging.kernels import accelerations
from dem_bridge.judging.model import system_of
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.trajectory.trajectory import Floats

#: largest relative difference of factors on stiffnesses that are equal, or have one pattern
LARGEST_DIFFERENCE_OF_FACTORS = 1e-6
#: roundings of a file by which its first sample differs from the scene's start
ROUNDINGS_FROM_START = 3.0
#: largest relative difference of velocities of half a step at the start: an overlap or a damping may be others, too
LARGEST_DIFFERENCE_OF_HALF_STEPS = 1e-3
#: fields of a scene that are compared with those of the deck, with the relative difference that counts as round-off
_FIELDS = ("mass", "stiffness", "exponent", "gap", "velocity", "wall_left", "wall_right", "gravity", "precompression",
           "damping", "adhesion", "drag", "drive")  # fmt: skip
_ROUNDOFF_OF_FIELDS = 1e-12
Numbers = Sequence[float] | float | Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class Statement:
    """One difference from the scene that a deck or a file states."""

    cause: str
    """One of the causes; "" where none of them is such a difference."""
    words: str
    changes: dict[str, Any]
    """Fields of the scene with the stated values, and "start": displacement of each body at the start, m."""
    where: str = ""


def statements(scene: Scene, record: Record) -> list[Statement]:
    """Return the differences from the scene that the deck of a file, its columns or its first sample state."""
    stated = dict(record.stated)
    if "velocity" not in stated:
        stated |= _first_velocities(scene, record)
    others = list(_of_others(scene, stated))
    if "exponent" in stated:  # with which the unit of a stiffness changes, so that both are one difference
        with_exponent = {name: stated.pop(name) for name in ("stiffness", "wall_left", "wall_right") if name in stated}
        others[0] = replace(others[0], changes=others[0].changes | with_exponent)
    return [*_of_bodies(scene, stated), *_of_stiffness(scene, stated), *others]


def variant_of(scene: Scene, stated: Iterable[Statement]) -> Variant | None:
    """Return the variant of a scene with what is stated; None if that is no scene."""
    changes = {name: value for statement in stated for name, value in statement.changes.items()}
    start = changes.pop("start", None)
    try:
        system = system_of(changed(scene, changes))
    except DemBridgeError:
        return None
    if start is None:
        return Variant(system)
    places = np.concatenate([[0.0], start, [0.0]])
    return Variant(system.changed(gap=system.gap + np.diff(places)), offset=tuple(start))


def differences(scene: Scene, other: Scene) -> dict[str, str]:
    """Return how each field in which two scenes differ differs, in words."""
    words = {name: _difference(of_any_contact(scene, name), of_any_contact(other, name)) for name in _FIELDS}
    return {name: text for name, text in words.items() if text}


def _difference(ours: object, theirs: object) -> str:
    """Return how two values of a scene differ, in words; '' if they agree to round-off."""
    if isinstance(ours, tuple | float) and isinstance(theirs, tuple | float):
        first, second = np.atleast_1d(ours).astype(float), np.atleast_1d(theirs).astype(float)
        if len(first) != len(second):
            return f"{len(second)} numbers; the scene has {len(first)}"
        gap = np.abs(first - second)
        if np.max(gap, initial=0.0) <= _ROUNDOFF_OF_FIELDS * np.max(np.abs([first, second]), initial=0.0):
            return ""
        place = int(np.argmax(gap))
        where = f" at {place}" if len(first) > 1 else ""
        return f"{second[place]:.9g}{where}; the scene has {first[place]:.9g}"
    if ours == theirs:
        return ""
    return f"{_brief(theirs)}; the scene has {_brief(ours)}"


def of_any_contact(scene: Scene, name: str) -> Any:
    """Return a field of a scene; the constants of damping and adhesion are one number if all contacts have the same.

    Scenes with other walls have other numbers of contacts.
    """
    value, constants = getattr(scene, name), {"damping": "coefficient", "adhesion": "pull_off"}
    if name in constants and value is not None:
        numbers = np.unique(np.atleast_1d(getattr(value, constants[name])))
        return replace(value, **{constants[name]: float(numbers[0])}) if len(numbers) == 1 else value
    return value


def changed(scene: Scene, changes: Mapping[str, Any]) -> Scene:
    """Return a scene with other fields; new walls have the damping and adhesion of the other contacts."""
    fields = {name: of_any_contact(scene, name) for name in ("damping", "adhesion")}
    return replace(scene, **{**fields, **changes})


def _first_velocities(scene: Scene, record: Record) -> dict[str, Any]:
    """Return the start velocities and the displacements of a first sample at 0 s that are not those of the scene."""
    stated: dict[str, Any] = {}
    start = {"velocity": np.array(scene.velocity), "displacement": np.zeros(scene.n_body)}
    for name, values in start.items():
        if name not in record.values or record.time[0] > record.rounding["time"][0]:
            continue
        columns, first = list(record.columns[name]), record.values[name][0]
        apart = np.abs(first - values[columns]) > ROUNDINGS_FROM_START * record.rounding[name][0]
        if np.any(apart) and not (name == "velocity" and _of_half_step(scene, record, first - values[columns])):
            values[columns] = np.where(apart, first, values[columns])
            stated["start" if name == "displacement" else name] = tuple(values.tolist())
    return stated


def _of_half_step(scene: Scene, record: Record, apart: Floats) -> bool:
    """Return whether velocities are apart from those of the start by half a step of the acceleration at the start.

    Such velocities are those of half a step before or after the start, which the whole file decides.
    """
    if record.dt is None or scene.law is not None:
        return False
    system = system_of(scene)
    force, start = np.zeros(scene.n_body + 1), np.zeros(scene.n_body)
    acceleration = np.zeros(scene.n_body)
    accelerations(0.0, start, system.velocity, scene.n_body, system, force, acceleration)
    half = 0.5 * record.dt * acceleration[list(record.columns["velocity"])]
    digits = ROUNDINGS_FROM_START * record.rounding["velocity"][0] + LARGEST_DIFFERENCE_OF_HALF_STEPS * np.abs(half)
    return bool(np.any(half)) and any(np.all(np.abs(apart - sign * half) <= digits) for sign in (-1.0, 1.0))


def _of_bodies(scene: Scene, stated: Mapping[str, Any]) -> Iterator[Statement]:
    """Yield other masses, start velocities and start positions."""
    if "mass" in stated:
        words, where = _differing("has a mass of {} kg", stated["mass"], scene.mass)
        yield Statement(cause="mass", words=words, where=where, changes={"mass": stated["mass"]})
    if "velocity" in stated:
        velocity, own = np.array(stated["velocity"]), np.array(scene.velocity)
        words, where = _differing("starts at {} m/s", velocity, own)
        reversed_sign = bool(np.any(own)) and np.allclose(velocity, -own, rtol=LARGEST_DIFFERENCE_OF_FACTORS, atol=0.0)
        cause, where = ("sign", "") if reversed_sign else ("start-velocity", where)
        yield Statement(cause=cause, words=words, where=where, changes={"velocity": stated["velocity"]})
    if "start" in stated:
        zeros = np.zeros(scene.n_body)
        words, where = _differing("starts at a displacement of {} m", stated["start"], zeros)
        yield Statement(cause="start-position", words=words, where=where, changes={"start": stated["start"]})
    if "gap" in stated:
        words, where = _differing("has a gap of {} m", stated["gap"], scene.gap, "contact")
        yield Statement(cause="start-position", words=words, where=where, changes={"gap": stated["gap"]})


def _differing(text: str, values: Numbers, own: Numbers, kind: str = "body") -> tuple[str, str]:
    """Return a sentence on the largest difference of two lists, and its place if it is the only one."""
    first, second = np.broadcast_arrays(np.asarray(values, dtype=float), np.asarray(own, dtype=float))
    gap = np.abs(first - second)
    place = int(np.argmax(gap))
    alone = np.count_nonzero(gap > LARGEST_DIFFERENCE_OF_FACTORS * gap[place]) == 1
    words = f"{kind} {place} {text.format(f'{first[place]:.9g}')}, in the scene {second[place]:.9g}"
    if (
        not alone
        and np.all(second != 0.0)
        and np.ptp(ratio := first / second) <= LARGEST_DIFFERENCE_OF_FACTORS * abs(ratio[0])
    ):
        words = f"{words}, and all others differ by the same factor of {ratio[0]:.6g}"
    elif not alone:
        words = f"{words}, and others differ less"
    return words, f"{kind} {place}" if alone else ""


def _of_stiffness(scene: Scene, stated: Mapping[str, Any]) -> Iterator[Statement]:
    """Yield other stiffnesses: of all contacts, of one, or in a pattern that has a name."""
    walls = {name: stated[name] for name in ("wall_left", "wall_right") if name in stated}
    factors = {name: _wall_factor(getattr(scene, name), wall) for name, wall in walls.items()}
    if "stiffness" not in stated:
        yield from (_of_wall(scene, name, wall) for name, wall in walls.items())
        return
    ratio = np.array(stated["stiffness"]) / np.array(scene.stiffness)
    words, where = _differing("has a stiffness of {} N/m^(n-1)", stated["stiffness"], scene.stiffness, "contact")
    uniform = float(np.ptp(ratio)) <= LARGEST_DIFFERENCE_OF_FACTORS * float(ratio[0])
    near = partial(math.isclose, ratio[0], rel_tol=LARGEST_DIFFERENCE_OF_FACTORS)
    whole = [getattr(scene, name) is None or near(factors.get(name, 1.0))
             for name in ("wall_left", "wall_right")]  # fmt: skip
    changes = {"stiffness": stated["stiffness"]}
    cause = "stiffness"
    if uniform and all(whole):
        cause, where, changes, walls = uniform_name(scene, float(ratio[0]), 1e-5), "", changes | walls, {}
        words = f"all stiffnesses are {ratio[0]:.9g} of the scene's"
    elif not where:
        cause = next((name for name, pattern in stiffness_patterns(scene) if _alike(ratio, pattern)), cause)
    yield Statement(cause=cause, words=words, where=where, changes=changes)
    yield from (_of_wall(scene, name, wall) for name, wall in walls.items())


def _alike(ratio: Floats, pattern: Floats) -> bool:
    """Return whether factors have a pattern."""
    relative = ratio / pattern
    return float(np.ptp(relative)) <= LARGEST_DIFFERENCE_OF_FACTORS * float(np.max(relative))


def _wall_factor(own: Wall | None, wall: Wall | None) -> float:
    """Return the factor on the stiffness of a wall that differs in nothing else; nan if it differs otherwise."""
    if own is None or wall is None or (own.gap, own.exponent) != (wall.gap, wall.exponent):
        return math.nan
    return wall.stiffness / own.stiffness


def _of_wall(scene: Scene, name: str, wall: Wall | None) -> Statement:
    """Return the difference of a wall."""
    own: Wall | None = getattr(scene, name)
    words, where = name.replace("_", " "), "" if own is None else name
    changes = {name: wall}
    if own is None or wall is None:
        there = ("no", "one") if wall is None else ("a", "none")
        words = f"there is {there[0]} {words}, and in the scene there is {there[1]}"
        return Statement(cause="missed-contact" if wall is None else "", words=words, where=where, changes=changes)
    differing = [key for key in ("stiffness", "gap", "exponent") if getattr(own, key) != getattr(wall, key)]
    cause = {"stiffness": "stiffness", "gap": "start-position", "exponent": "exponent"}[differing[0]]
    values = f"{getattr(wall, differing[0])}, and in the scene {getattr(own, differing[0])}"
    return Statement(cause=cause, words=f"the {differing[0]} of the {words} is {values}", where=where, changes=changes)


def _of_others(scene: Scene, stated: Mapping[str, Any]) -> Iterator[Statement]:
    """Yield other exponents, damping, gravity, and what is no cause by itself."""
    causes = {"exponent": "exponent", "gravity": "gravity", "damping": "damping"}
    for name in ("exponent", "gravity", "damping", "precompression", "adhesion", "drag", "drive"):
        if name not in stated:
            continue
        value, cause = stated[name], causes.get(name, "")
        own = of_any_contact(scene, name)
        if name == "damping" and value is not None and own is not None and replace(value, clip=own.clip) == own:
            cause = "clip"
        yield Statement(
            cause=cause, words=f"the {name} is {_brief(value)}, and in the scene {_brief(own)}", changes={name: value}
        )


def _brief(value: object) -> str:
    """Return a value of a field, or a part of a scene, in a few words."""
    if value is None:
        return "none"
    if isinstance(value, tuple):
        return f"{min(value):.9g} to {max(value):.9g}" if len(set(value)) > 1 else f"{value[0]:.9g}"
    if isinstance(value, int | float):
        return f"{value:.9g}"
    fields = {key: item for key, item in vars(value).items() if item is not None}
    return ", ".join(f"{key} {item[0] if isinstance(item, tuple) else item}" for key, item in fields.items())
