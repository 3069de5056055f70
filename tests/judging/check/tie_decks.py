"""Scripts with a planted tie, or with the same parts and none: two or three spheres on a line, or one and a wall.

All numbers are drawn. A planted moment falls on a step; without one it falls at least 5 % of a step beside each step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.lmp.reader.to_scene import read_deck
from dem_bridge.runs.case import Case
from dem_bridge.scene.scene import Scene

KINDS = ("touch", "wall touch", "later touch", "opening", "simultaneous touches", "graze", "dump time", "segment end")
LAWS = (
    "hertz {k:.6g} 0.0 tangential linear_nohistory 0.0 0.0",
    "hertz {k:.6g} {e:.4g} tangential linear_nohistory 0.0 0.0 damping coeff_restitution",
    "hertz {k:.6g} {e:.4g} tangential linear_nohistory 0.0 0.0 damping tsuji",
    "hooke {h:.6g} 0.0 tangential linear_nohistory 0.0 0.0",
    "hooke {h:.6g} {e:.4g} tangential linear_nohistory 0.0 0.0 damping coeff_restitution",
    "hertz {k:.6g} {g:.4g} tangential linear_nohistory 0.0 0.0 damping velocity",
)
#: nearest part of a step at which a moment is that is no tie
NEAREST = 0.05


@dataclass(frozen=True, kw_only=True)
class TieDeck:
    """A script, and what is planted in it."""

    text: str
    kind: str
    planted: bool
    step: int
    """The step on which the planted moment falls."""


@dataclass(frozen=True, kw_only=True)
class _Parts:
    """Numbers of a script."""

    radius: float
    density: float
    law: str
    dt: float
    speeds: tuple[float, ...]
    gaps: tuple[float, ...]
    steps: int
    origin: float
    wall: float | None = None
    gravity: float = 0.0
    lines: tuple[str, ...] = ()
    run: str = ""

    @property
    def text(self) -> str:
        places = [self.origin]
        for gap in self.gaps:
            places.append(places[-1] + 2.0 * self.radius + gap)
        wall = [] if self.wall is None else [places[-1] + self.radius + self.wall]
        commands = [
            "units si", "boundary m f f", "atom_style sphere", "comm_modify vel yes",
            f"region box block {places[0] - 0.1!r} {places[-1] + 0.1!r} -0.05 0.05 -0.05 0.05 units box",
            "create_box 1 box",
            *(f"create_atoms 1 single {place!r} 0 0 units box" for place in places),
            f"set group all diameter {2.0 * self.radius!r} density {self.density!r}",
            *(f"set atom {k} vx {speed!r}" for k, speed in enumerate(self.speeds, 1) if speed),
            "pair_style granular", f"pair_coeff * * {self.law}",
            "fix move all nve/sphere",
            *(f"fix wall all wall/gran granular {self.law} xplane NULL {place!r}" for place in wall),
            *([f"fix weight all gravity {self.gravity!r} vector -1 0 0"] if self.gravity else []),
            f"timestep {self.dt!r}",
            *self.lines,
            self.run or f"run {self.steps}",
        ]  # fmt: skip
        return "\n".join((*commands, ""))

    @property
    def scene(self) -> Scene:
        return read_deck(self.text, file="in.tie", opened=lambda name: name).scene


def tie_deck(number: int, *, planted: bool) -> TieDeck:
    """Return a script; every eighth has the same kind of moment."""
    draw = np.random.default_rng([number, planted])
    kind = KINDS[number % len(KINDS)]
    radius, speed = float(10.0 ** draw.uniform(-4.0, -2.0)), float(f"{draw.uniform(0.2, 3.0):.3g}")
    radius = float(f"{radius:.3g}")
    density, e = float(f"{draw.uniform(900.0, 8000.0):.4g}"), draw.uniform(0.3, 0.95)
    mass = 4.0 / 3.0 * np.pi * radius**3 * density
    # a contact of about 0.01 of a radius, and steps of 1/80 to 1/400 of a contact
    overlap = 0.01 * radius
    k = mass * speed**2 / (overlap**2.5 * np.sqrt(radius))
    h, g = mass * speed**2 / overlap**2, draw.uniform(0.02, 0.2) * mass * speed / overlap
    law = LAWS[draw.integers(len(LAWS))].format(k=k, h=h, e=e, g=g)
    dt = float(f"{overlap / speed * 3.0 / draw.uniform(80.0, 400.0):.2g}")
    at = int(draw.integers(40, 600))
    off = 0.0 if planted else float(draw.uniform(NEAREST, 1.0 - NEAREST))
    beside = float(draw.uniform(NEAREST, 1.0 - NEAREST))
    parts = _Parts(
        radius=radius, density=density, law=law, dt=dt, speeds=(speed, 0.0), gaps=((at + beside) * dt * speed,),
        steps=at + 900, origin=float(f"{draw.uniform(-5.0, 5.0) * radius:.3g}"),
    )  # fmt: skip
    gap = (at + off) * dt * speed
    if kind == "touch":
        parts = replace(parts, gaps=(float(f"{gap:.12g}"),))
    elif kind == "wall touch":
        parts = replace(parts, speeds=(speed,), gaps=(), wall=float(f"{gap:.12g}"))
    elif kind == "later touch":
        later = _later_gap(parts, at + 500, off)
        parts = replace(parts, speeds=(speed, 0.0, 0.0), gaps=(*parts.gaps, later), steps=at + 1400)
        at += 500
    elif kind == "opening":
        parts, at = _opening(parts, off)
    elif kind == "simultaneous touches":
        other = float(f"{draw.uniform(0.2, 3.0):.3g}")
        one = (at + beside) * dt
        two = one if planted else one + float(draw.uniform(0.1, 3.0)) * dt
        parts = replace(parts, speeds=(speed, 0.0, -other), gaps=(one * speed, two * other))
    elif kind == "graze":
        # a ball is thrown up, and turns at a ceiling; without a tie a tenth of its way below or beyond it
        gravity = float(f"{2.0 * speed / (1200.0 * dt):.3g}")
        height = 0.5 * speed**2 / gravity
        away = 1.0 if planted else float(draw.choice([0.9, 1.1]))
        steps = round(1.05 * 2.0 * speed / gravity / dt)
        parts = replace(parts, speeds=(speed,), gaps=(), wall=height * away, gravity=gravity, steps=steps)
        at = round(speed / gravity / dt)
    elif kind == "dump time":
        every = (int(draw.integers(5, 60)) + off) * dt
        lines = ("dump d all custom 1 d.dump id x", f"dump_modify d every/time {every:.12g}")
        parts, at = replace(parts, lines=lines), round(every / dt)
    else:
        whole = parts.steps
        time = (whole + off) * dt
        lines = (
            f"variable total equal {time:.12g}",
            f"variable count equal {draw.choice(['floor', 'ceil'])}(v_total/{dt!r})",
        )
        parts, at = replace(parts, lines=lines, run="run ${count}"), whole
    return TieDeck(text=parts.text, kind=kind, planted=planted, step=at)


def _motion(scene: Scene, dt: float, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the displacements of our code at all steps, and the start gaps."""
    run = Case(
        scene=replace(scene, duration=dt * steps, samples=steps), backend="verlet", resolution=Resolution(dt=dt),
        sampling=Sampling(count=steps), uncertainty=False,
    ).solve()  # fmt: skip
    return run.displacement, scene.contacts.gap


def _later_gap(parts: _Parts, step: int, off: float) -> float:
    """Return the gap of a third body that the second one crosses at a step after its collision."""
    moved, _ = _motion(parts.scene, parts.dt, step + 1)
    return float(moved[step, 1] + off * (moved[step + 1, 1] - moved[step, 1]))


def _opening(parts: _Parts, off: float) -> tuple[_Parts, int]:
    """Return a script whose contact opens at a step, by the gap at its start, and that step."""

    def overlap(gap: float, step: int) -> float:
        scene = replace(parts.scene, gap=(gap,))
        moved, gaps = _motion(scene, parts.dt, step)
        return float(moved[step, 0] - moved[step, 1] - gaps[0])

    gap = parts.gaps[0]
    moved, gaps = _motion(parts.scene, parts.dt, parts.steps)
    closed = moved[:, 0] - moved[:, 1] - gaps[0] > 0.0
    opens = int(np.flatnonzero(closed)[-1])  # the last closed step, for this gap
    way = parts.dt * parts.speeds[0]
    if off:
        return parts, opens
    wider = next(factor for factor in (0.25, 0.5, 0.75, 1.0, 1.25, 1.5) if overlap(gap - factor * way, opens) < 0.0)
    return replace(
        parts, gaps=(float(brentq(lambda x: overlap(x, opens), gap - wider * way, gap, xtol=1e-24, rtol=1e-15)),)
    ), opens
