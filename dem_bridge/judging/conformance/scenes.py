"""The scenes on which a code is graded: twelve that never change, and any number that are drawn from a seed.

A scene that is changed here gets the set a new number, because values of the set are shipped with the package.
"""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

from dem_bridge.errors import UsageError, meant
from dem_bridge.scene.damping import BY_RESTITUTION, DAMPING_LAWS, DASHPOTS
from dem_bridge.scene.scene import Damping, Scene, Wall
from dem_bridge.scene.timescales import contact_time_of

#: number of the set of frozen scenes
SET = 1
#: what a code may declare, with the words of messages and of the page
FEATURES: Mapping[str, str] = MappingProxyType(
    {
        "hertz": "contact forces stiffness * overlap^1.5",
        "hooke": "contact forces stiffness * overlap",
        "walls": "rigid walls at the ends",
        "gaps": "gaps between bodies at the start",
        "gravity": "a constant acceleration along the chain",
        "precompression": "a chain that starts in equilibrium under a static force",
        "several-moving": "bodies behind the first that move at the start",
        "polydisperse": "bodies of different masses and contacts of different stiffnesses",
        **{law: f"damping of the law {law}" for law in DAMPING_LAWS},
    }
)
#: questions of the scenes that have no more than contacts: all bodies are equal, no outer force acts
BASE = ("law", "contacts", "hooke")
#: ratio of a time step to the next finer one, and number of time steps of a scene
RATIO_OF_STEPS, NUMBER_OF_STEPS = 4, 3
#: steps in a contact time at the coarsest time step, about
COARSEST_STEPS_IN_CONTACT = 48
#: sampling intervals of a scene
SAMPLES = 32


@dataclass(frozen=True)
class Probe:
    """A scene with the question that it answers and the time steps at which a code runs it."""

    scene: Scene
    question: str
    """Name of the item that the scene decides."""
    steps_in_sample: int
    """Time steps in a sampling interval at the coarsest time step."""
    frozen: bool = True
    """False for a scene that was drawn from a seed."""
    features: frozenset[str] = field(init=False)
    """What a code must have to run the scene."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "features", features_of(self.scene))

    @property
    def basic(self) -> bool:
        """True if the scene has no more than contacts."""
        return self.question in BASE

    @property
    def smooth(self) -> bool:
        """True if no contact force has a jump or a kink at a time that is none of a step.

        The touch of a pair that starts in touch is at a step. Its opening is smooth if the force is clipped, or if the
        damping force goes with the overlap.
        """
        scene, damping = self.scene, self.scene.damping
        if damping is None:
            return bool((scene.contacts.exponent > 2.0).all())
        starts_in_touch = scene.n_contact == 1 and not scene.contacts.gap.any()
        return starts_in_touch and bool(damping.clip or damping.law not in DASHPOTS)

    @property
    def interval(self) -> float:
        """Sampling interval, s."""
        return self.scene.duration / self.scene.samples

    @property
    def steps(self) -> tuple[float, ...]:
        """Time steps, s, from coarse to fine; each divides the sampling interval."""
        counts = (self.steps_in_sample * RATIO_OF_STEPS**nth for nth in range(NUMBER_OF_STEPS))
        return tuple(self.interval / count for count in counts)

    @cached_property
    def contact_time(self) -> float:
        """Shortest contact time of two bodies of the scene, s."""
        time = contact_time_of(self.scene)
        assert time is not None  # body 0 of every scene moves, and has a contact
        return time


def features_of(scene: Scene) -> frozenset[str]:
    """Return the features that a code must have to run a scene.

    Examples
    --------
    >>> sorted(features_of(frozen_probes()[6].scene))
    ['gravity', 'hertz']
    """
    c = scene.contacts
    present = {
        "hertz": bool((c.exponent == 2.5).any()),
        "hooke": bool((c.exponent == 2.0).any()),
        "walls": scene.wall_left is not None or scene.wall_right is not None,
        "gaps": scene.precompression == 0.0 and bool((c.gap != 0.0).any()),
        "gravity": scene.gravity != 0.0,
        "precompression": scene.precompression > 0.0,
        "several-moving": any(scene.velocity[1:]),
        "polydisperse": len({*scene.mass}) > 1 or len({*scene.stiffness}) > 1,
    }
    if scene.damping is not None:
        present[scene.damping.law] = True
    return frozenset(name for name, holds in present.items() if holds)


def checked_features(features: Sequence[str] | str) -> tuple[str, ...]:
    """Return declared features in the order of :data:`FEATURES`.

    Raises
    ------
    UsageError
        If one is unknown, or the code has no contact force.

    Examples
    --------
    >>> checked_features("walls, hertz")
    ('hertz', 'walls')
    """
    names = [name.strip() for name in (features.split(",") if isinstance(features, str) else features)]
    for name in names:
        if name not in FEATURES:
            hint = f"; {question}" if (question := meant(name, FEATURES)) else ""
            raise UsageError(f"features: {name!r} is unknown; allowed: {', '.join(FEATURES)}{hint}")
    if not {"hertz", "hooke"} & {*names}:
        raise UsageError(
            f"features = {','.join(names)!r} has no contact force; allowed: hertz or hooke, and any others"
        )
    return tuple(name for name in FEATURES if name in names)


def frozen_probes() -> tuple[Probe, ...]:
    """Return the twelve scenes of set 1, which never change.

    Examples
    --------
    >>> [probe.scene.name for probe in frozen_probes()][:5]
    ['pair', 'chain', 'taper', 'hooke', 'walls']
    >>> len(frozen_probes()), frozen_probes()[0].scene.n_body
    (12, 2)
    """
    pair = _chain((0.5, 0.0))
    return (
        _probe("pair", "law", 3, 128e-6, pair),
        _probe("chain", "contacts", 6, 256e-6, _chain((0.5, 0.0, 0.0, 0.0, 0.0, 0.0))),
        _probe(
            "taper", "mixing", 10, 256e-6,
            _chain((0.5, 0.0, 0.0, 0.0, 0.0))
            | {"mass": (0.02, 0.015, 0.01, 0.008, 0.005), "stiffness": (2e9, 4e9, 3e9, 8e9)},
        ),
        _probe("hooke", "hooke", 4, 128e-6, _chain((0.5, 0.0, 0.0), stiffness=2e7) | {"exponent": 2.0}),
        _probe(
            "walls", "walls", 10, 320e-6,
            pair | {"wall_left": Wall(stiffness=8e9), "wall_right": Wall(stiffness=3e9)},
        ),
        _probe("gaps", "gaps", 8, 288e-6, _chain((0.5, 0.0, 0.0)) | {"gap": (1.3e-5, 2.9e-5)}),
        _probe("gravity", "gravity", 3, 4.8e-3, _chain((0.1, 0.0, 0.0), stiffness=1e6) | {"gravity": 9.81}),
        _probe("precompression", "precompression", 4, 128e-6, _chain((0.2, 0.0, 0.0, 0.0)) | {"precompression": 50.0}),
        _probe("several-moving", "several-moving", 4, 128e-6, _chain((0.5, 0.1, -0.3))),
        _probe("dashpot", "restitution", 3, 128e-6, pair | {"damping": Damping(law="dashpot", coefficient=60.0)}),
        _probe(
            "tsuji", "restitution", 3, 128e-6,
            pair | {"damping": Damping(law="tsuji", coefficient=0.5, clip=False)},
        ),
        _probe(
            "coeff-restitution", "restitution", 3, 128e-6,
            pair | {"damping": Damping(law="coeff_restitution", coefficient=0.6, clip=False)},
        ),
    )  # fmt: skip


def _probe(name: str, question: str, steps_in_sample: int, duration: float, fields: Mapping[str, Any]) -> Probe:
    """Return a frozen scene with its question."""
    return Probe(Scene(name=name, duration=duration, samples=SAMPLES, **fields), question, steps_in_sample)


def _chain(velocity: tuple[float, ...], stiffness: float = 4e9) -> dict[str, Any]:
    """Return equal bodies of 10 g with equal contacts."""
    n = len(velocity)
    return {"mass": (0.01,) * n, "stiffness": (stiffness,) * (n - 1), "velocity": velocity}


def unseen_probes(features: Sequence[str], count: int, seed: int) -> tuple[Probe, ...]:
    """Return scenes that are drawn from a seed within the features of a code.

    Each draw depends on the set, the seed and its number only, so that more scenes leave the first ones as they are.

    Examples
    --------
    >>> [probe.scene.name for probe in unseen_probes(("hertz", "walls"), 2, seed=7)]
    ['unseen-7-1', 'unseen-7-2']
    >>> unseen_probes(("hertz",), 1, seed=7) == unseen_probes(("hertz",), 3, seed=7)[:1]
    True
    """
    return tuple(_drawn(frozenset(features), seed, number) for number in range(1, count + 1))


def _drawn(features: frozenset[str], seed: int, number: int) -> Probe:
    """Return one scene that is drawn within features."""
    # Mersenne's random() of a text is the same in every release of Python
    draw = random.Random(f"dem-bridge conformance {SET}: {seed}, {number}, {sorted(features)}")

    def uniform(low: float, high: float) -> float:
        return float(f"{low + (high - low) * draw.random():.6g}")

    def chance(name: str, probability: float) -> bool:
        return draw.random() < probability and name in features

    n = 2 + int(5 * draw.random())
    mass, speed = 10.0 ** uniform(-3.0, -1.0), uniform(0.1, 2.0)
    hooke = "hooke" in features and ("hertz" not in features or draw.random() < 0.5)
    stiffness = 10.0 ** (uniform(6.0, 8.0) if hooke else uniform(8.5, 10.5))
    spread = chance("polydisperse", 0.7)
    fields: dict[str, Any] = {
        "mass": tuple(_rounded(mass * (uniform(0.5, 2.0) if spread else 1.0)) for _ in range(n)),
        "stiffness": tuple(_rounded(stiffness * (uniform(0.5, 2.0) if spread else 1.0)) for _ in range(n - 1)),
        "velocity": (speed, *[0.0] * (n - 1)),
        "exponent": 2.0 if hooke else 2.5,
    }
    if chance("several-moving", 0.5):
        fields["velocity"] = (speed, *(_rounded(speed * uniform(-0.8, 0.3)) for _ in range(n - 1)))
    for side in ("wall_left", "wall_right"):
        if chance("walls", 0.4):
            fields[side] = Wall(stiffness=_rounded(stiffness * uniform(0.5, 2.0)))
    time = contact_time_of(Scene(name="drawn", duration=1.0, **fields))
    assert time is not None  # body 0 moves and touches body 1
    transit = (1.4 + 0.7 * (n - 1)) * time
    if chance("precompression", 0.4):
        # a share of the largest force of the collision: 2 speed * effective mass over the contact time, about
        fields["precompression"] = _rounded(uniform(0.05, 0.5) * speed * mass / time)
    elif chance("gaps", 0.6):
        fields["gap"] = tuple(_rounded(uniform(0.0, 0.5) * speed * time) for _ in range(n - 1))
        transit += sum(fields["gap"]) / speed
    if "precompression" not in fields and chance("gravity", 0.5):
        fields["gravity"] = _rounded(uniform(-0.3, 0.3) * speed / transit)
    laws = [law for law in DAMPING_LAWS if law in features]
    if laws and draw.random() < 0.6:
        law = laws[int(len(laws) * draw.random())]
        fields["damping"] = Damping(
            law=law, coefficient=_rounded(_coefficient(law, uniform, mass, time)), clip=draw.random() < 0.5
        )
    count = max(1, round(COARSEST_STEPS_IN_CONTACT * transit / SAMPLES / time))
    scene = Scene(name=f"unseen-{seed}-{number}", duration=_rounded(transit), samples=SAMPLES, **fields)
    return Probe(scene, "unseen", count, frozen=False)


def _rounded(value: float) -> float:
    """Return a value with six digits, which every code reads alike."""
    return float(f"{value:.6g}")


def _coefficient(law: str, uniform: Any, mass: float, time: float) -> float:
    """Return a damping coefficient with which a collision loses a third of its speed, about."""
    if law in BY_RESTITUTION:
        return float(uniform(0.4, 0.95))
    per_second = float(uniform(0.1, 0.8)) / time
    kuwabara_kono = 0.1 * float(uniform(0.2, 1.0)) * time
    return {"dashpot": per_second * mass / 2.0, "mass_velocity": per_second}.get(law, kuwabara_kono)


def steps_of(probe: Probe) -> tuple[Scene, tuple[int, ...]]:
    """Return the scene on which the largest step is looked for, and the numbers of steps in its sampling interval.

    It is the scene ``probe`` sampled eight times less often, so that a step may be half a contact time.
    """
    scene = probe.scene
    coarse = replace(scene, name=f"{scene.name}-steps", samples=scene.samples // 8)
    return coarse, (1, 2, 3, 4, 6, 8, 12, 16, 24)
