"""Measure what limits the accuracy of a LAMMPS deck by twins of the scene, or read it in the deck."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from dem_bridge.errors import DemBridgeError
from dem_bridge.foundation.numbers import whole_number
from dem_bridge.judging.deck import DeckRun, UserDeck
from dem_bridge.judging.reference import FileErrors
from dem_bridge.judging.stated import changed, differences
from dem_bridge.judging.twin_run import twin_run
from dem_bridge.lmp.known_defects import defects_of
from dem_bridge.lmp.reader.evaluation import UNITS
from dem_bridge.lmp.reader.mixing import mixing_warning
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats

#: significant digits of LAMMPS' text dumps without a format
_DIGITS_OF_DUMPS = 6


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
    twins = Twins.of(scene, run, errors)
    limits = [
        *_of_numerics(twins, run, errors),
        *_of_contacts(run),
        *_of_scene(twins, run),
        *_of_neighbours(run, errors.quantities["velocity"].scale),
        *_of_own_dump(run.deck),
    ]
    return tuple(sorted(limits, key=_place))


def _place(limit: Limit) -> tuple[int, float]:
    """Return the place of a limit: effects by size, then unknown ones, then those without an effect."""
    unknown = math.isnan(limit.effect)
    return (1, 0.0) if unknown else (2 * int(limit.effect == 0.0), -limit.effect)


@dataclass(frozen=True, kw_only=True)
class Twins:
    """Runs of our velocity-Verlet code with the samples of a deck's dump, however long its scene is."""

    scene: Scene
    """The scene with the duration and the number of samples of the dump."""
    dt: float | None
    speed: float
    """Largest velocity of the reference, m/s."""
    problem: str = ""
    """Why there are no such runs."""

    @classmethod
    def of(cls, scene: Scene, run: DeckRun, errors: FileErrors) -> Twins:
        """Return the twins of a deck; its samples must be even and begin at the start."""
        time, problem = errors.record.time, ""
        if run.dt is None:
            problem = "several, or none that can be read"
        elif time[0] != 0.0 or float(np.ptp(np.diff(time))) > 1e-6 * float(time[1]):
            problem = "samples are not at even times from the start on"
        sampled = replace(scene, duration=float(time[-1]), samples=len(time) - 1)
        return cls(scene=sampled, dt=run.dt, speed=errors.quantities["velocity"].scale or 1.0, problem=problem)

    def velocity(self, radius: float | None = None, **changes: Any) -> Floats:
        """Return the velocities, m/s, ``(n_t, n_body)``, of the scene with other fields, or with a particle radius."""
        return twin_run(changed(self.scene, changes) if changes else self.scene, self.dt, radius).velocity

    @cached_property
    def plain(self) -> Floats:
        """Velocities of the scene itself, m/s."""
        return self.velocity()

    def effect(self, changes: Mapping[str, Any]) -> float:
        """Return the effect of other fields on velocities, relative to the largest; nan if it is unknown."""
        if self.problem:
            return math.nan
        try:
            return float(np.max(np.abs(self.velocity(**changes) - self.plain))) / self.speed
        except DemBridgeError:
            return math.nan


def _of_numerics(twins: Twins, run: DeckRun, errors: FileErrors) -> Iterator[Limit]:
    """Yield the effects of the time step and of the radius, by twins of the scene, and what nothing stated explains."""
    if twins.problem:
        advice = "use one `timestep` for all runs, which begin at step 0"
        yield Limit(what="time step", found=twins.problem, effect=math.nan, advice=advice)
        return
    part, stated = errors.quantities["velocity"], run.deck.stated(twins.scene)
    columns = list(part.columns)
    values = errors.record.values["velocity"]
    try:
        step = float(np.max(np.abs(twins.plain[:, columns] - (values - part.error)))) / twins.speed
        yield Limit(
            what="time step",
            found=f"{twins.dt:.6g} s",
            effect=step,
            advice="halve the time step: this error falls by 4 (by 2 with damping)",
        )
        roundoff = 0.0
        if (radius := run.deck.radius) is not None:
            roundoff = float(np.max(np.abs(twins.velocity(radius) - twins.plain))) / twins.speed
            yield Limit(
                what="particle radius",
                found=f"{radius:.6g} m",
                effect=roundoff,
                advice="take a smaller radius with the same stiffness: positions then round off less"
                " (dem-bridge deck writes such a deck)",
            )
        twin = twins.velocity(**stated) if stated else twins.plain
        rest = float(np.max(np.abs(values - twin[:, columns]))) / twins.speed
        yield Limit(
            what=f"neither time step nor radius{' nor what the deck states' if stated else ''}",
            found="difference from a twin with this time step",
            effect=max(0.0, rest - roundoff),
            advice="compare contact law, tables, damping and start with the scene: see the other rows and the cause",
        )
    except DemBridgeError as problem:
        yield Limit(what="time step and radius", found=str(problem), effect=math.nan, advice="judge two time steps")


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
    if run.deck.read is not None and (warning := mixing_warning(run.deck.read.mixed, run.version)):
        found, advice = warning.split("; write ", 1)
        yield Limit(what="mixing of types", found=found, effect=math.nan, advice=f"write {advice}")


def _of_scene(twins: Twins, run: DeckRun) -> Iterator[Limit]:
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
    stated = deck.stated(twins.scene)
    for name, difference in differences(twins.scene, deck.read.scene).items():
        yield Limit(
            what=name.replace("_", " "),
            found=difference,
            effect=twins.effect({name: stated[name]}),
            advice="make the deck and the scene agree",
        )
    if len(stated) > 1:
        yield Limit(
            what="all differences from the scene together",
            found=f"{len(stated)} differences",
            effect=twins.effect(stated),
            advice="see each of them: the effects of two may cancel",
        )


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
            count = int(digits[1]) if digits else _DIGITS_OF_DUMPS
            yield Limit(
                what=f"digits of own dump {dump.rest[0]}",
                found=f"{count}",
                effect=0.5 * 10.0 ** (1 - count),
                advice=f"`dump_modify {dump.rest[0]} format float %.17g`: positions lose more, by the size of the box"
                " over the displacements",
            )
