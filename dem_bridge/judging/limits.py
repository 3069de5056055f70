"""Measure what limits the accuracy of a LAMMPS deck by twins of the scene, or read it in the deck."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.checked import whole_number
from dem_bridge.errors import DemBridgeError
from dem_bridge.judging.deck import DeckRun, UserDeck, differences
from dem_bridge.judging.error import FileErrors
from dem_bridge.lmp.known_defects import defects_of
from dem_bridge.lmp.reader.deck import UNITS
from dem_bridge.runs.case import Case
from dem_bridge.scene import Scene
from dem_bridge.trajectory import Floats

#: significant digits of LAMMPS' text dumps without a format
_DIGITS = 6


@dataclass(frozen=True, kw_only=True)
class Limit:
    """One property of a deck that limits its accuracy, or that is suspected and does not."""

    what: str
    found: str
    """What the deck has."""
    effect: float
    """Largest effect on velocities, relative to the largest; 0: none; nan: not known."""
    advice: str


def deck_limits(scene: Scene, run: DeckRun, errors: FileErrors) -> tuple[Limit, ...]:
    """Return what limits the accuracy of a deck: the largest effect first, unknown ones after those that are known.

    Parameters
    ----------
    scene : Scene
        The scene that the deck should be of.
    run : DeckRun
        Its run.
    errors : FileErrors
        Errors of its velocities.
    """
    limits = [
        *_of_numerics(scene, run, errors),
        *_of_contacts(run),
        *_of_scene(scene, run),
        *_of_neighbours(run, errors.quantities["velocity"].scale),
        *_of_own_dump(run.deck),
    ]
    return tuple(sorted(limits, key=_place))


def _place(limit: Limit) -> tuple[int, float]:
    """Return the place of a limit: effects by size, then unknown ones, then those without an effect."""
    unknown = math.isnan(limit.effect)
    return (1, 0.0) if unknown else (2 * int(limit.effect == 0.0), -limit.effect)


def _of_numerics(scene: Scene, run: DeckRun, errors: FileErrors) -> Iterator[Limit]:
    """Yield the effects of the time step and of the radius, by twins of the scene, and what neither explains."""
    dt, radius = run.dt, run.deck.radius
    if dt is None:
        yield Limit(
            what="time step",
            found="several, or none that can be read",
            effect=math.nan,
            advice="use one `timestep` for all runs",
        )
        return
    try:
        reference, exact = _velocity(scene, "reference"), _velocity(scene, "verlet", dt)
        speed = float(np.max(np.abs(reference)))
        step = float(np.max(np.abs(exact - reference))) / speed
        yield Limit(
            what="time step",
            found=f"{dt:.6g} s",
            effect=step,
            advice="halve the time step: this error falls by 4 (by 2 with damping)",
        )
        roundoff = 0.0
        if radius is not None:
            roundoff = float(np.max(np.abs(_velocity(scene, "verlet", dt, radius) - exact))) / speed
            yield Limit(
                what="particle radius",
                found=f"{radius:.6g} m",
                effect=roundoff,
                advice="take a smaller radius with the same stiffness: positions then round off less"
                " (dem-bridge deck writes such a deck)",
            )
        rest = _difference_from_twin(scene, errors, exact - reference) / speed
        yield Limit(
            what="neither time step nor radius",
            found="difference from a twin with this time step",
            effect=max(0.0, rest - roundoff),
            advice="compare contact law, tables, damping and start with the scene: see the other rows and the cause",
        )
    except DemBridgeError as problem:
        yield Limit(what="time step and radius", found=str(problem), effect=math.nan, advice="judge two time steps")


def _difference_from_twin(scene: Scene, errors: FileErrors, twin: Floats) -> float:
    """Return the largest difference of a file from a twin, m/s, at the sample times of the scene that the file has.

    ``twin`` are the errors of the twin, ``(n_t, n_body)``. The result is nan if the file has none of these times.
    """
    times = Sampling(count=scene.samples).times(scene.duration)
    part, file_times = errors.quantities["velocity"], errors.record.time
    rows = np.clip(np.searchsorted(times, file_times - 0.5 * times[1]), 0, len(times) - 1)
    same = np.abs(times[rows] - file_times) <= 1e-9 * times[-1]
    if not np.any(same):
        return math.nan
    return float(np.max(np.abs(part.error[same] - twin[rows[same]][:, part.columns])))


def _velocity(scene: Scene, backend: str, dt: float | None = None, radius: float | None = None) -> Floats:
    """Return the velocities of a scene by one of our codes."""
    resolution = Resolution(dt=dt, surrogate_radius=radius)
    sampling = Sampling(count=scene.samples)
    case = Case(scene=scene, backend=backend, resolution=resolution, sampling=sampling, uncertainty=False)
    return case.solve().velocity


def _of_contacts(run: DeckRun) -> Iterator[Limit]:
    """Yield tables, `newton` and defects of the release that the deck meets."""
    for command in run.deck.commands:
        words = command.rest
        if command.name == "pair_style" and "table" in words[:-2]:
            place = words.index("table")
            yield Limit(
                what="table points",
                found=f"{words[place + 2]} points, {words[place + 1]}",
                effect=math.nan,
                advice="double the points and the lines of the file: if the result changes, the table limits it;"
                " pair_style granular needs none",
            )
    if (newton := run.deck.last("newton")) is not None:
        yield Limit(
            what="newton", found=" ".join(newton.rest), effect=0.0, advice="nothing: on and off give the same bits"
        )
    text = "\n".join(command.text for command in run.deck.commands)
    for defect in defects_of(run.version, text):
        yield Limit(
            what=f"known defect {defect.name}", found=defect.symptom, effect=math.nan, advice=f"write {defect.instead}"
        )


def _of_scene(scene: Scene, run: DeckRun) -> Iterator[Limit]:
    """Yield the properties in which the deck differs from the scene, each with its effect by a twin."""
    deck = run.deck
    if deck.read is None:
        problems = "; ".join(deck.problems)
        problems = problems if len(problems) <= 160 else f"{problems[:157]}..."
        yield Limit(
            what="comparison with the scene",
            found=f"the deck cannot be read as a scene: {problems}",
            effect=math.nan,
            advice="compare the deck with the scene by hand",
        )
        return
    for name, difference in differences(scene, deck.read.scene).items():
        yield Limit(
            what=name.replace("_", " "),
            found=difference,
            effect=_effect(scene, name, getattr(deck.read.scene, name), run.dt),
            advice="make the deck and the scene agree",
        )


def _effect(scene: Scene, name: str, value: Any, dt: float | None) -> float:
    """Return the effect of another value of one field on velocities, relative to the largest; nan if it is unknown."""
    if dt is None:
        return math.nan
    try:
        plain = _velocity(scene, "verlet", dt)
        changed = _velocity(replace(scene, **{name: value}), "verlet", dt)
        return float(np.max(np.abs(changed - plain)) / np.max(np.abs(plain)))
    except DemBridgeError:
        return math.nan


def _of_neighbours(run: DeckRun, largest: float) -> Iterator[Limit]:
    """Yield whether the neighbour list may miss contacts."""
    neighbor, modify = run.deck.last("neighbor"), run.deck.last("neigh_modify")
    settings: Mapping[str, str] = dict(zip(modify.rest[::2], modify.rest[1::2], strict=False)) if modify else {}
    settings_text = (
        f"{neighbor.text if neighbor else 'default skin'}, {modify.text if modify else 'default neigh_modify'}"
    )
    settings_text += f"; dangerous builds: {run.dangerous}"
    wait = max(whole_number(settings.get(key, "0")) or 0 for key in ("every", "delay"))
    length = UNITS.get(run.deck.state.units, (1.0,))[0]
    try:
        skin = float(neighbor.rest[0]) * length if neighbor else math.nan
    except ValueError:
        skin = math.nan
    travel = 2.0 * largest * (run.dt or 0.0) * wait
    risky = run.dangerous > 0 or settings.get("once") == "yes" or settings.get("exclude") is not None
    if risky or (not math.isnan(skin) and travel > skin):
        advice = "write `neigh_modify delay 0 every 1 check yes` and a skin of a radius: contacts may be missed"
        yield Limit(what="neighbour list", found=settings_text, effect=math.nan, advice=advice)
    else:
        yield Limit(what="neighbour list", found=settings_text, effect=0.0, advice="nothing: no contact is missed")


def _of_own_dump(deck: UserDeck) -> Iterator[Limit]:
    """Yield what the deck's own dump loses; the judgement is by the added dump."""
    dumps = [command for command in deck.commands if command.name == "dump"]
    if not dumps:
        yield Limit(
            what="own dump",
            found="none",
            effect=math.nan,
            advice="`dump 1 all custom N dump.chain id type x y z vx vy vz` and `dump_modify 1 sort id time yes"
            " format float %.17g`",
        )
    for dump in dumps:
        columns = dump.rest[5:]
        if len(dump.rest) > 3 and dump.rest[2] == "custom" and not {"vx", "vy", "vz"} & {*columns}:
            yield Limit(
                what=f"columns of own dump {dump.rest[0]}",
                found="no velocities",
                effect=math.nan,
                advice="add vx vy vz: velocities are the sharpest observable",
            )
        formats = [
            " ".join(command.rest)
            for command in deck.commands
            if command.name == "dump_modify" and command.rest[:1] == dump.rest[:1] and "format" in command.rest
        ]
        if dump.rest[4:5] and dump.rest[4].endswith(".bin"):
            continue
        digits = re.search(r"%[-+ 0#\d]*\.(\d+)([efg])", formats[-1]) if formats else None
        if digits is None or (digits[2] == "g" and int(digits[1]) < 15):
            count = int(digits[1]) if digits else _DIGITS
            yield Limit(
                what=f"digits of own dump {dump.rest[0]}",
                found=f"{count}",
                effect=0.5 * 10.0 ** (1 - count),
                advice=f"`dump_modify {dump.rest[0]} format float %.17g`: positions lose more, by the size of the box"
                " over the displacements",
            )
