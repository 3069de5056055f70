"""Effects of each parameter and each model term on the predictions: the budget of all errors, numerical ones included.

Every variant is the paper's chain with one thing changed, solved by the reference; its effect is the relative change of
four observables of the first passage. Errors of numerics and of theories stand in the same table, so that a reader
sees which digit is worth having.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.bca import BinaryCollisions
from dem_bridge.observables.front import residence_by_crossing
from dem_bridge.scene import Damping, Scene
from dem_bridge.scene_file.physical import rounded
from dem_bridge.studies.model_hierarchy.model_terms import (
    DASHPOT,
    VISCOELASTIC,
    angles_soften,
    hertz_stiffness,
    on_base,
    quartz_sphere,
    weighing,
)
from dem_bridge.studies.study import Table
from dem_bridge.trajectory import Trajectory

#: overlaps at which contacts with another exponent have the same force as Hertz', m: small and large ones of the wave
ANCHORS = {"exponent-1um": 1e-6, "exponent-5um": 5e-6}
#: kinds of terms. "supposed": physics whose numbers the paper does not give, so that its effect is that of our values
NUMERICS, THEORY, PARAMETER, PHYSICS, SUPPOSED = "numerics", "theory", "parameter", "model", "supposed"
#: the chain itself, beside which its variants are set
AS_IS = "as-is"
#: of the arrival at the end by binary collisions: what comes back from there is no first passage
PASSAGE = 1.3


@dataclass(frozen=True, kw_only=True)
class Variant:
    """The paper's chain with one thing changed."""

    id: str
    kind: str
    what: str
    """What is taken in place of what."""
    change: Callable[[Scene], Scene]

    def of(self, scene: Scene) -> Scene:
        """The changed chain, as long as the first passage lasts."""
        changed = self.change(scene)
        return replace(changed, name=f"{scene.name}.{self.id}", duration=_passage(scene))


def _passage(scene: Scene) -> float:
    """Return the duration of the first passage by eq. 3.3 to 3.7 with a margin, s."""
    arrival = float(BinaryCollisions().run(scene, Resolution(), Sampling(count=1)).crossing_time[scene.n_body - 2])
    # never, within the duration: nan, and the duration is the smaller
    return float(f"{min(scene.duration, PASSAGE * arrival):.3g}")


def _printed_end(scene: Scene) -> Scene:
    """The gradient ends at the printed 4.68e9 in place of eq. 3.1's 4.6892e9."""
    beta = np.array(scene.stiffness[1:])
    soft, hard = float(beta.min()), float(beta.max())
    graded = hard - (hard - beta) * (hard - 4.68e9) / (hard - soft)
    return replace(scene, stiffness=(scene.stiffness[0], *(rounded(b) for b in graded)))


VARIANTS = (
    Variant(id=AS_IS, kind=PHYSICS, what="the paper's chain", change=lambda s: s),
    Variant(
        id="exact-stiffness",
        kind=PHYSICS,
        what="stiffness by the exact Hertz law at the same angles, in place of eq. 3.1's approximation",
        change=lambda s: replace(s, stiffness=(s.stiffness[0], *hertz_stiffness(s)[1:])),
    ),
    Variant(
        id="striker-mass",
        kind=PARAMETER,
        what="striker as heavy as a quartz sphere of r = 9 mm, in place of 8.1 g",
        change=lambda s: replace(s, mass=(quartz_sphere(s), *s.mass[1:])),
    ),
    Variant(
        id="striker-stiffness",
        kind=PARAMETER,
        what="beta_0 by the exact law (3.98253e9), in place of the printed 3.98e9",
        change=lambda s: replace(s, stiffness=(hertz_stiffness(s)[0], *s.stiffness[1:])),
    ),
    Variant(
        id="printed-90-degrees",
        kind=PARAMETER,
        what="beta(90 degrees) as printed, 4.68e9, in place of eq. 3.1's 4.6892e9",
        change=_printed_end,
    ),
    Variant(
        id="speed-1-percent",
        kind=SUPPOSED,
        what="striker 1 % faster: what a drop height off by 2 % does",
        change=lambda s: replace(s, velocity=(1.01 * s.velocity[0], *s.velocity[1:])),
    ),
    Variant(
        id="gravity",
        kind=PHYSICS,
        what="the chain's own weight on a base, static compression solved for, in place of none",
        change=weighing,
    ),
    Variant(
        id="base",
        kind=PHYSICS,
        what="a rigid base behind the last cylinder, in place of a free end",
        change=on_base,
    ),
    Variant(
        id="dashpot",
        kind=SUPPOSED,
        what="a dashpot of 1 N s/m in every contact, in place of none",
        change=lambda s: replace(s, damping=Damping(law="dashpot", coefficient=DASHPOT)),
    ),
    Variant(
        id="kuwabara-kono",
        kind=SUPPOSED,
        what="viscoelastic contacts (Kuwabara-Kono, gamma = 1e-8 s), in place of elastic ones",
        change=lambda s: replace(s, damping=Damping(law="kuwabara-kono", coefficient=VISCOELASTIC)),
    ),
    Variant(
        id="drag",
        kind=SUPPOSED,
        what="drag of 10 1/s on every cylinder (guides), in place of none",
        change=lambda s: replace(s, drag=10.0),
    ),
    *(
        Variant(
            id=id,
            kind=SUPPOSED,
            what=(
                f"n falling from 2.5 at 90 degrees to 2.2 at 2 degrees, same force at {1e6 * anchor:g} um, in place"
                f" of 2.5"
            ),
            change=partial(angles_soften, anchor=anchor),
        )
        for id, anchor in ANCHORS.items()
    ),
)


@dataclass(frozen=True, kw_only=True)
class Effect:
    """Relative changes of the four observables."""

    id: str
    kind: str
    what: str
    scene: str
    changes: Mapping[str, float]

    @property
    def largest(self) -> float:
        return max((abs(change) for change in self.changes.values() if math.isfinite(change)), default=math.nan)


def observables(scene: Scene, run: Trajectory) -> dict[str, float]:
    """Return the four observables of the first passage on which effects are measured."""
    middle = scene.n_body // 2
    residence = residence_by_crossing(scene, run)
    return {
        "arrival at the last cylinder": float(run.crossing_time[scene.n_body - 2]),
        "speed at the middle": 1.0 / float(residence[middle - 1]),
        "force at the middle": float(run.peak_force[middle]),
        "largest force": float(np.max(run.peak_force[: scene.n_body - 1])),
    }


OBSERVABLES = ("arrival at the last cylinder", "speed at the middle", "force at the middle", "largest force")


def effect(variant: Variant, scene: Scene, base: Trajectory, changed: Trajectory) -> Effect:
    """Return the effect of one variant on one chain."""
    return Effect(
        id=variant.id,
        kind=variant.kind,
        what=variant.what,
        scene=scene.name,
        changes=_relative(observables(scene, base), observables(variant.of(scene), changed)),
    )


def of_numerics(scene: Scene, what: str, id: str, kind: str, run: Trajectory, truth: Trajectory) -> Effect:
    """Errors of a code or a theory on the same four observables."""
    changes = _relative(observables(scene, truth), observables(scene, run))
    return Effect(id=id, kind=kind, what=what, scene=scene.name, changes=changes)


def own_bar(scene: Scene, truth: Trajectory) -> Effect:
    """The reference's own bars on the four observables, relative."""
    middle, last = scene.n_body // 2, scene.n_body - 2
    time, force = truth.uncertainty["crossing_time"], truth.uncertainty["peak_force"]
    residence = float(residence_by_crossing(scene, truth)[middle - 1])
    largest = int(np.argmax(truth.peak_force[: scene.n_body - 1]))
    values = (
        time[last] / truth.crossing_time[last],
        (time[middle] + time[middle - 1]) / residence,
        force[middle] / truth.peak_force[middle],
        force[largest] / truth.peak_force[largest],
    )
    return Effect(
        id="reference-bar",
        kind=NUMERICS,
        what="error bar of the reference itself",
        scene=scene.name,
        changes=dict(zip(OBSERVABLES, map(float, values), strict=True)),
    )


def _relative(old: Mapping[str, float], new: Mapping[str, float]) -> dict[str, float]:
    return {name: new[name] / old[name] - 1.0 for name in OBSERVABLES}


def budget_table(effects: list[Effect]) -> Table:
    """All terms of both chains, the largest first."""

    def rows() -> Iterator[tuple[str | float, ...]]:
        for item in sorted(effects, key=lambda e: -np.nan_to_num(e.largest)):
            yield (item.what, item.kind, item.scene, *(100.0 * item.changes[name] for name in OBSERVABLES))

    return Table(
        id="budget",
        title="The whole budget",
        caption=(
            "Each term alone, as change of the paper's chain in per cent, the largest first. A parameter is a number"
            " that the paper prints and that does not follow from its other numbers; a model term is physics that the"
            " equations have in another form, or not at all; of a supposed term the paper gives no number, so the"
            " effect is that of the value taken here. First passage of the wave; forces of theories and codes: of the"
            " whole run."
        ),
        columns=("term", "kind", "chain", *(f"{name} (%)" for name in OBSERVABLES)),
        rows=tuple(rows()),
    )
