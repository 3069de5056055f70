"""Effects of each parameter and each model term on the predictions: the budget of all errors, numerical ones included.

Every variant is the paper's chain with one thing changed, solved by the reference; its effect is the relative change of
four observables of the first passage. Errors of numerics and of theories are in the same table, so that a reader sees
which digits are significant.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.bca import BinaryCollisions
from dem_bridge.observables.observable import Reader
from dem_bridge.observables.registry import OBSERVABLES as REGISTERED
from dem_bridge.physics.statics import static_overlap
from dem_bridge.report.columns import PERCENT, Column
from dem_bridge.report.study import Table
from dem_bridge.scene.file.conversion import rounded
from dem_bridge.scene.scene import Damping, Scene
from dem_bridge.studies.model_hierarchy import model_terms
from dem_bridge.studies.paper import PAPER
from dem_bridge.trajectory.trajectory import Trajectory

#: overlaps at which contacts with another exponent have the same force as Hertz', m: small and large ones of the wave
ANCHORS = {"exponent-1um": 1e-6, "exponent-5um": 5e-6}
#: kinds of terms. "supposed": physics whose numbers the paper does not give, so that its effect is that of our values
NUMERICS, THEORY, PARAMETER, PHYSICS, SUPPOSED = "numerics", "theory", "parameter", "model", "supposed"
#: kind -> terms of the error budget: changes of the paper's chain, or a code or theory in place of the reference
TERMS: Mapping[str, tuple[str, ...]] = {
    PHYSICS: ("as-is", "exact-stiffness", "gravity", "base"),
    SUPPOSED: ("striker-mass", "speed-1-percent", "dashpot", "kuwabara-kono", "drag", "exponent-1um", "exponent-5um"),
    PARAMETER: ("striker-stiffness", "printed-90-degrees"),
    NUMERICS: ("reference-uncertainty", "lammps", "scipy", "ode45"),
    THEORY: ("bca", "adiabatic"),
}
#: the chain itself, beside which its variants are set
AS_IS = "as-is"
#: of the arrival at the end by binary collisions: what comes back from there is no first passage
PASSAGE = 1.3


@dataclass(frozen=True, kw_only=True)
class Variant:
    """Hold a change of the paper's chain."""

    id: str
    """Also the key of its texts among the terms."""
    change: Callable[[Scene], Scene]

    def of(self, scene: Scene) -> Scene:
        """Return the changed chain, as long as the first passage lasts."""
        changed = self.change(scene)
        return replace(changed, name=f"{scene.name}.{self.id}", duration=_passage(scene))


def _passage(scene: Scene) -> float:
    """Return the duration of the first passage by eq. 3.3 to 3.7 with a margin, s."""
    arrival = float(BinaryCollisions().run(scene, Resolution(), Sampling(count=1)).crossing_time[scene.n_body - 2])
    # never, within the duration: nan, and the duration is the smaller
    return float(f"{min(scene.duration, PASSAGE * arrival):.3g}")


def _printed_end(scene: Scene) -> Scene:
    """Return the chain whose gradient ends at the printed 4.68e9 in place of eq. 3.1's 4.6892e9."""
    beta = np.array(scene.stiffness[1:])
    soft, hard = float(beta.min()), float(beta.max())
    graded = hard - (hard - beta) * (hard - 4.68e9) / (hard - soft)
    return replace(scene, stiffness=(scene.stiffness[0], *(rounded(b) for b in graded)))


def _stacked(scene: Scene) -> Scene:
    """Return the chain on a base under its weight, in equilibrium but for the striker.

    The striker is dropped: it touches the first cylinder without overlap, and the stack does not carry it.
    """
    based = model_terms.on_base(scene)
    assert based.wall_right is not None
    carried = model_terms.GRAVITY * np.cumsum(scene.mass[1:])
    laws = zip(carried, based.contacts.stiffness[1:], based.contacts.exponent[1:], strict=True)
    overlaps = [rounded(static_overlap(float(force), float(beta), float(n))) for force, beta, n in laws]
    wall = replace(based.wall_right, gap=-overlaps[-1])
    return replace(
        based, gravity=model_terms.GRAVITY, gap=(0.0, *(-overlap for overlap in overlaps[:-1])), wall_right=wall
    )


#: term -> what it changes in the paper's chain
CHANGES: Mapping[str, Callable[[Scene], Scene]] = {
    AS_IS: lambda s: s,
    "exact-stiffness": lambda s: replace(s, stiffness=(s.stiffness[0], *model_terms.hertz_stiffness(s)[1:])),
    "striker-mass": lambda s: replace(s, mass=(model_terms.quartz_sphere(s), *s.mass[1:])),
    "striker-stiffness": lambda s: replace(s, stiffness=(model_terms.hertz_stiffness(s)[0], *s.stiffness[1:])),
    "printed-90-degrees": _printed_end,
    "speed-1-percent": lambda s: replace(s, velocity=(1.01 * s.velocity[0], *s.velocity[1:])),
    "gravity": _stacked,
    "base": model_terms.on_base,
    "dashpot": lambda s: replace(s, damping=Damping(law="dashpot", coefficient=model_terms.DASHPOT)),
    "kuwabara-kono": lambda s: replace(s, damping=Damping(law="kuwabara-kono", coefficient=model_terms.VISCOELASTIC)),
    "drag": lambda s: replace(s, drag=10.0),
    **{id: partial(model_terms.angles_soften, anchor=anchor) for id, anchor in ANCHORS.items()},
}
VARIANTS = tuple(Variant(id=id, change=change) for id, change in CHANGES.items())
#: a dashpot, N s/m, 300 times that of the budget: whether the sign of its effect holds; no term of the budget
STRONGEST = 300.0
STRONG = Variant(
    id="strong-dashpot", change=lambda s: replace(s, damping=Damping(law="dashpot", coefficient=STRONGEST))
)


@dataclass(frozen=True, kw_only=True)
class Effect:
    """Hold the relative changes of the four observables that one term causes."""

    id: str
    kind: str
    what: str
    scene: str
    changes: Mapping[str, float]

    @property
    def largest(self) -> float:
        """Return the largest magnitude of the changes; nan where none is known."""
        return max((abs(change) for change in self.changes.values() if math.isfinite(change)), default=math.nan)


#: observables of the first passage on which effects are measured -> the registered one, and its place in the chain;
#: contacts of walls do not count
PLACES: Mapping[str, tuple[str, Callable[[Scene], int | slice]]] = {
    "arrival at the last cylinder": ("arrival", lambda scene: scene.n_body - 1),
    "speed at the middle": ("front_speed", lambda scene: scene.n_body // 2),
    "force at the middle": ("peak_force", lambda scene: scene.n_body // 2),
    "largest force": ("peak_force", lambda scene: slice(scene.n_body - 1)),
}
OBSERVABLES = tuple(PLACES)


def observables(scene: Scene, run: Trajectory) -> dict[str, float]:
    """Return the four observables of the first passage."""
    return {
        label: float(np.max(REGISTERED[name].value(scene, run)[place(scene)]))
        for label, (name, place) in PLACES.items()
    }


def relative_changes(scene: Scene, base: Trajectory, changed: Trajectory) -> dict[str, float]:
    """Return the relative changes of the four observables from one run to another."""
    before, after = observables(scene, base), observables(scene, changed)
    return {label: after[label] / before[label] - 1.0 for label in PLACES}


def _term(id: str) -> dict[str, str]:
    """Return the kind of a term of the budget, and what it changes in words."""
    kind = next(kind for kind, ids in TERMS.items() if id in ids)
    return {"kind": kind, "what": PAPER(id, "terms")}


def effect(id: str, scene: Scene, base: Trajectory, changed: Trajectory) -> Effect:
    """Return the effect of a variant, or the error of a code or theory, which has the texts of the term ``id``."""
    return Effect(id=id, scene=scene.name, changes=relative_changes(scene, base, changed), **_term(id))


def reference_uncertainty(scene: Scene, truth: Trajectory) -> Effect:
    """Return the uncertainty of the reference in the four observables, relative."""
    changes = {}
    for label, (name, place) in PLACES.items():
        value, uncertainty = (np.atleast_1d(part(scene, truth)[place(scene)]) for part in _parts(name))
        largest = int(np.argmax(value))
        changes[label] = float(uncertainty[largest] / value[largest])
    return Effect(id="reference-uncertainty", scene=scene.name, changes=changes, **_term("reference-uncertainty"))


def _parts(name: str) -> tuple[Reader, Reader]:
    return REGISTERED[name].value, REGISTERED[name].uncertainty


def budget_table(effects: list[Effect]) -> Table:
    """Return the table of all terms of both chains, the largest first."""
    return PAPER.table(
        "budget",
        ("term", "kind", "chain", *(Column(name, PERCENT) for name in OBSERVABLES)),
        [
            (item.what, item.kind, item.scene, *(item.changes[name] for name in OBSERVABLES))
            for item in sorted(effects, key=lambda e: -np.nan_to_num(e.largest))
        ],
    )
