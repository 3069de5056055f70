"""Draw chains that end within 1e-8 s of a touch or of a first maximum, or whose drag stops a body near touch.

Touches, maxima and the ways of bodies under drag are found in decimal arithmetic.
"""

from __future__ import annotations

from dataclasses import replace
from decimal import localcontext
from typing import Any

import numpy as np

from dem_bridge.scene.scene import Damping, Scene, Wall
from tests.helpers.decimal_chain import DIGITS, OPEN, PRESSING, Chain, Exact

#: seconds from the end of the run to the touch, or to the maximum; negative: it is before the end
APART = (0.0, 1e-12, -1e-12, 1e-11, -1e-11, 1e-10, -1e-10, 1e-9, -1e-9, 1e-8)


class RecordedChain(Chain):
    """Keep when each contact closes."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self.touches: list[float] = []

    def _begin(self) -> None:
        before, now = list(self.state), float(self.now)
        super()._begin()
        pairs = zip(before, self.state, strict=True)
        self.touches += [now for old, new in pairs if (old, new) == (OPEN, PRESSING)]

    def stops_before_touch(self, contact: int) -> float:
        """Return the overlap (m, negative: open) at which drag stops two bodies that nothing else moves."""
        rate = self.v[self.left[contact]] - self.v[self.right[contact]]
        return float(self.s[contact] + rate / self.drag)


def recorded(scene: Scene) -> tuple[RecordedChain, Exact]:
    """Return a solved chain with its touches, and what the scene ends with."""
    with localcontext() as context:
        context.prec, context.Emin, context.Emax = DIGITS, -999_999, 999_999
        chain = RecordedChain(scene)
        return chain, chain.solved()


def last_touch(seed: int, *, drag: bool) -> Scene | None:
    """Return 2 to 5 bodies, with drag and damping (n = 2 or 2.5) or without (more exponents); None: nothing is near."""
    rng = np.random.default_rng([305, seed])
    n, speed, span = int(rng.integers(2, 6)), 10.0 ** rng.uniform(-2, 1), 10.0 ** rng.uniform(-4, -2)
    mass = 10.0 ** rng.uniform(-3, -1) * 10.0 ** rng.uniform(-0.7, 0.7, n)
    exponent = float(rng.choice([2.0, 2.5] if drag else [2.0, 2.5, 3.0, 1.5, 4.0]))
    depth = speed * span * 10.0 ** rng.uniform(-2.2, -1, n)
    stiffness = 0.25 * exponent * float(np.median(mass)) * speed**2 / depth**exponent
    velocity = np.array([speed, *np.zeros(n - 1)])
    if rng.uniform() < 0.4:
        velocity = speed * np.sort(rng.uniform(-0.2, 1, n))[::-1]
    stopped = drag and rng.uniform() < 0.3
    more: dict[str, Any] = {}
    if rng.uniform() < 0.4:
        gap = float(speed * span * rng.uniform(0.01, 0.3))
        more["wall_right"] = Wall(stiffness=float(stiffness[-1]), gap=gap, exponent=exponent)
    if drag and rng.uniform() < 0.4:
        law, part = str(rng.choice(["dashpot", "kuwabara-kono"])), 10.0 ** rng.uniform(-2, -0.5)
        period = float(np.median(depth)) / speed
        unit = float(np.min(mass)) / period if law == "dashpot" else period
        more["damping"] = Damping(law=law, coefficient=part * unit, clip=bool(rng.integers(2)))
    scene = Scene(
        name=f"last-{seed}",
        duration=span,
        mass=tuple(mass),
        velocity=tuple(velocity),
        stiffness=tuple(stiffness[: n - 1]),
        exponent=exponent,
        gap=tuple(speed * span * 10.0 ** rng.uniform(-2.5, -0.5, n - 1) * rng.choice([0, 1, 1], n - 1)),
        drag=rng.uniform(1, 8) / span if stopped or (drag and rng.uniform() < 0.5) else 0.0,
        gravity=float(rng.uniform(-1, 1) * speed / span) if not stopped and rng.uniform() < 0.3 else 0.0,
        samples=int(rng.choice([1, 7, 20])),
        **more,
    )
    if stopped:
        return _stopped(scene, int(rng.integers(n - 1)), 100.0 * speed * span, rng)
    chain, truth = recorded(scene)
    times = np.array([*chain.touches, *truth.crossing_time])
    times = times[(times > 0.01 * span) & (times < 0.999 * span)]
    return replace(scene, duration=float(rng.choice(times)) - float(rng.choice(APART))) if len(times) else None


def _stopped(scene: Scene, contact: int, far: float, rng: np.random.Generator) -> Scene | None:
    """Return a scene in which drag stops the bodies of a contact 1e-12 to 1e-3 of their way before touch, or after."""
    gap = np.array(scene.contacts.gap[: scene.n_body - 1])
    gap[contact] = far
    way = recorded(replace(scene, gap=tuple(gap)))[0].stops_before_touch(contact) + far
    gap[contact] = way * (1.0 + 10.0 ** rng.uniform(-12, -3) * rng.choice([-1, -1, 1]))
    return replace(scene, gap=tuple(gap)) if way > 1e-12 * far else None
