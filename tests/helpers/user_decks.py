"""Decks as users write them by hand, each with a scene from which it may differ, and contradictions of an answer."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from dem_bridge.judging.judgement import Judgement
from dem_bridge.judging.sentences import lines
from dem_bridge.report.texts import Texts
from dem_bridge.scene.scene import Damping, Scene, Wall

#: rows of the limits that a cause speaks of
ROWS = {
    "mass": ("mass",),
    "start-velocity": ("velocity",),
    "start-position": ("gap",),
    "stiffness": ("stiffness", "wall right"),
    "stiffness-scale": ("stiffness", "wall right"),
    "missing-sqrt-radius": ("stiffness",),
    "modulus": ("stiffness",),
    "exponent": ("exponent", "stiffness"),
    "damping": ("damping",),
    "gravity": ("gravity",),
    "missed-contact": ("wall right",),
    "sign": ("velocity",),
}
#: rows of the limits that are no differences from the scene
NUMERICS = ("time step", "particle radius", "neither", "newton", "neighbour list", "all differences", "own dump")
#: effect of a difference that may stay unnamed: part of that of the time step, and absolutely
UNNAMED, LEAST = 1.0 / 50.0, 1e-6
UNITS = {"s": 1.0, "ms": 1e-3, "µs": 1e-6, "ns": 1e-9}


@dataclass(frozen=True, kw_only=True)
class Chain:
    """Equal spheres on a line in SI units, with the numbers that a deck and its scene share unless one is changed."""

    bodies: int = 6
    radius: float = 5e-3
    density: float = 7850.0
    stiffness: float = 2e10
    """K of LAMMPS' hertz: the force is K sqrt(R*) overlap^(3/2)."""
    speed: float = 0.5
    gaps: tuple[float, ...] = ()
    damping: float = 0.0
    """Dashpot, N s/m."""
    gravity: float = 0.0
    wall: bool = False
    hooke: bool = False

    @property
    def mass(self) -> float:
        """Mass of a body, kg."""
        return 4.0 / 3.0 * math.pi * self.radius**3 * self.density

    def scene(self, duration: float, samples: int) -> Scene:
        """Return the scene of the chain."""
        root = 1.0 if self.hooke else math.sqrt(0.5 * self.radius)
        wall = Wall(stiffness=self.stiffness * (1.0 if self.hooke else math.sqrt(self.radius))) if self.wall else None
        return Scene(
            name="users",
            duration=duration,
            samples=samples,
            mass=(self.mass,) * self.bodies,
            stiffness=(self.stiffness * root,) * (self.bodies - 1),
            exponent=2.0 if self.hooke else 2.5,
            velocity=(self.speed,) + (0.0,) * (self.bodies - 1),
            gap=self.gaps or 0.0,
            gravity=self.gravity,
            wall_right=wall,
            damping=Damping(law="dashpot", coefficient=self.damping, clip=True) if self.damping else None,
        )

    def deck(self, *, dt: float, steps: int, dump: int, order: tuple[int, ...] | None = None) -> str:
        """Return the deck; ``order``: bodies in the order of their ids."""
        # springs are as stiff as the others at an overlap of 10 um
        constant = self.stiffness * math.sqrt(0.5 * self.radius * 1e-5) if self.hooke else self.stiffness
        law = f"{'hooke' if self.hooke else 'hertz'} {constant!r} {self.damping!r}"
        law += " tangential linear_nohistory 0 0 damping velocity" + " limit_damping" * bool(self.damping)
        x = np.concatenate(
            [[0.0], np.cumsum([2.0 * self.radius + gap for gap in self.gaps or [0.0] * (self.bodies - 1)])]
        )
        end = x[-1] + self.radius
        order, across = order or tuple(range(self.bodies)), f"{-4 * self.radius!r} {4 * self.radius!r}"
        commands = [
            *("units si", "atom_style sphere", "boundary f f f", "newton off", "comm_modify vel yes"),
            f"region box block {-20 * self.radius!r} {end + 20 * self.radius!r} {across} {across} units box",
            "create_box 1 box",
            *(f"create_atoms 1 single {x[body]!r} 0 0 units box" for body in order),
            f"set group all diameter {2.0 * self.radius!r}",
            f"set group all density {self.density!r}",
            f"set atom {order.index(0) + 1} vx {self.speed!r}",
            f"neighbor {self.radius!r} bin",
            "neigh_modify delay 0 every 1 check yes",
            "pair_style granular",
            f"pair_coeff * * {law}",
            "fix motion all nve",
            *([f"fix weight all gravity {self.gravity!r} vector 1 0 0"] if self.gravity else []),
            *([f"fix wall all wall/gran granular {law} xplane NULL {end!r}"] if self.wall else []),
            f"timestep {dt!r}",
            f"dump own all custom {dump} own.dump id type x y z vx vy vz",
            "dump_modify own sort id time yes format float %.17g",
            f"run {steps}",
        ]
        return "\n".join(commands).replace("np.float64(", "").replace(")", "") + "\n"


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What an answer says, read from its lines and tables."""

    outcome: str
    cause: str
    alternatives: list[str]
    next: str
    step: str
    error: float
    """Largest error of velocities, relative."""
    floor: float
    limits: dict[str, float] = field(default_factory=dict)
    """Effect of each limit of a deck by its name; nan if it is not known."""

    @classmethod
    def of(cls, judgement: Judgement) -> Answer:
        """Return what an answer says."""
        rows = [row for table in judgement.study.tables if table.id.startswith("limits") for row in table.rows]
        error = judgement.error["velocity"]
        return cls(
            outcome=judgement.outcome,
            cause=judgement.cause,
            alternatives=judgement.alternative_causes,
            next=dict(lines(judgement))["next"],
            step=dict(lines(judgement)).get("step", ""),
            error=error["value"] / error["scale"],
            floor=judgement.floor or 0.0,
            limits={str(row[0]): float(row[2]) for row in rows},
        )


def contradictions(answer: Answer) -> list[str]:
    """Return the contradictions between the outcome, the cause, the limits and the advice of an answer."""
    return [*_of_outcome(answer), *_of_limits(answer), *_of_advice(answer)]


def _of_outcome(answer: Answer) -> Iterator[str]:
    expected = {"none": "PASS", "unknown": "UNDECIDED"}.get(answer.cause, "FAIL")
    if answer.outcome != expected:
        yield f"the outcome is {answer.outcome}, and the cause {answer.cause}"
    if answer.cause in answer.alternatives:
        yield f"{answer.cause} is its own alternative"


def _of_limits(answer: Answer) -> Iterator[str]:
    known = {name: effect for name, effect in answer.limits.items() if not math.isnan(effect)}
    if "time step" not in known:
        return
    step = known["time step"]
    rest = max((effect for name, effect in known.items() if name.startswith("neither")), default=0.0)
    differences = {
        name: effect for name, effect in known.items() if not any(name.startswith(n) or n in name for n in NUMERICS)
    }
    together = max(
        (effect for name, effect in known.items() if name.startswith("all differences")),
        default=max(differences.values(), default=0.0),
    )
    largest = max(differences, key=lambda name: differences[name], default="")
    seen, unnamed = answer.error > 10.0 * answer.floor, max(2.0 * UNNAMED * step, LEAST)
    if answer.cause == "none" and together > unnamed:
        yield f"the cause is none, and {largest or 'a difference'} has an effect of {together:.1e} beside {step:.1e}"
    if answer.cause in ("none", *ROWS) and rest > max(0.02 * answer.error, 1e-8):
        yield f"the cause is {answer.cause}, and {rest:.1e} is explained by nothing"
    if answer.cause == "none" and seen and abs(step - answer.error) > 0.1 * answer.error + unnamed:
        yield f"the error is {answer.error:.2e}, and that of the step {step:.2e}"
    if answer.cause == "unknown" and seen and rest < 1e-3 * answer.error:
        yield f"the cause is unknown, and the limits explain all but {rest:.1e} of {answer.error:.1e}"
    if answer.cause in ROWS and differences:
        rows = [differences.get(row, 0.0) for row in ROWS[answer.cause]]
        if max(rows) < max(differences.values()):
            yield f"the cause is {answer.cause}, and {largest} has a larger effect"


def _of_advice(answer: Answer) -> Iterator[str]:
    advice: dict[str, Any] = Texts("judge", "dem_bridge.judging").data["advice"]
    kinds = [answer.cause, *(["missed-wall"] if answer.cause == "missed-contact" else [])]
    if answer.cause not in ("none", "unknown") and not answer.next.startswith(tuple(advice[kind] for kind in kinds)):
        yield f"the advice is {answer.next!r} for {answer.cause}"
    if answer.cause != "none":
        return
    said = re.search(r"an error of ([\d.e+-]+)( %)? of the largest", answer.step)
    if answer.error > max(10.0 * answer.floor, LEAST) and not said:
        yield f"nothing is said of the step at an error of {answer.error:.1e}"
    size = float(said[1]) * (0.01 if said[2] else 1.0) if said else answer.error
    if said and answer.error > 10.0 * answer.floor and abs(size - answer.error) > 0.1 * answer.error:
        yield f"the step is said to make an error of {size:.2g}, and it is {answer.error:.2e}"
    if steps := re.search(r"^([\d.]+) (\w+) .* at most (\S+) (\w+), (\S+) (\w+) and ", answer.step):
        now, coarse, fine = (float(steps[k]) * UNITS[steps[k + 1]] for k in (1, 3, 5))
        for target, other in ((1e-2, coarse), (1e-3, fine)):
            if (answer.error > 1.2 * target and other > now) or (1.2 * answer.error < target and other < now):
                yield f"a step of {other:.2g} s makes {target:g}, and one of {now:.2g} s {answer.error:.1e}"


def write_deck(folder: Path, text: str) -> Path:
    """Write a deck into a folder and return its path."""
    path = folder / "in.users"
    path.write_text(text)
    return path
