"""Variants of decks: one cause whatever step, dump and length of the run are, and no contradiction in an answer."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from tests.helpers.user_decks import Answer, Chain, contradictions, write_deck

#: differences between a deck and its scene, with the cause that names them; values are factors
DIFFERENCES: dict[str, tuple[str, dict[str, Any]]] = {
    "right": ("none", {}),
    "density": ("mass", {"density": 8100.0 / 7850.0}),
    "speed": ("start-velocity", {"speed": 1.02}),
    "radius": ("mass", {"radius": 1.03}),
    "stiffness": ("stiffness-scale", {"stiffness": 1.05}),
    "damping": ("damping", {"damping": 1.5}),
    "no damping": ("damping", {"damping": 0.0}),
    "exponent": ("exponent", {"hooke": True}),
    "gap": ("start-position", {"gaps": 2e-6}),
    "gravity": ("gravity", {"gravity": 0.0}),
    "no wall": ("missed-contact", {"wall": False}),
}


@dataclass(frozen=True)
class Variant:
    """A deck with its scene."""

    difference: str
    chain: Chain
    dt: float
    length: float
    """Length of the run over that of the scene."""
    samples: int
    dump: int
    order: tuple[int, ...]
    crossings: float
    """Duration of the scene over the time that a pulse takes to cross the chain, roughly."""

    @property
    def cause(self) -> str:
        """The cause that is true."""
        return DIFFERENCES[self.difference][0]

    def judge(self, folder: Path) -> Answer:
        """Run the deck and judge it."""
        contact = 2.94 * (1.25 * 0.5 * self.chain.mass / (self.chain.stiffness * (self.chain.radius / 2) ** 0.5)) ** 0.4
        duration = float(f"{self.crossings * self.chain.bodies * 0.5 * contact * self.chain.speed**-0.2:.2g}")
        changed: dict[str, Any] = {
            name: value if isinstance(value, bool) else getattr(self.chain, name) * value if name != "gaps"
            else (value, *(self.chain.gaps or (0.0,) * (self.chain.bodies - 1))[1:])
            for name, value in DIFFERENCES[self.difference][1].items()
        }  # fmt: skip
        deck = replace(self.chain, **changed)
        text = deck.deck(
            dt=self.dt, steps=max(10, round(self.length * duration / self.dt)), dump=self.dump, order=self.order
        )
        scene = self.chain.scene(duration, self.samples)
        return Answer.of(db.judge(write_deck(folder, text), scene))


def variant(seed: int) -> Variant:
    """Return the variant of a seed."""
    rng = np.random.default_rng([seed, 30])
    difference = list(DIFFERENCES)[seed % len(DIFFERENCES)]
    bodies = int(rng.integers(3, 11))
    damped = difference in ("damping", "no damping") or rng.random() < 0.2
    chain = Chain(
        bodies=bodies,
        radius=float(rng.choice([2e-3, 5e-3, 9e-3])),
        density=float(rng.choice([2500.0, 7850.0])),
        stiffness=float(rng.choice([5e9, 2e10, 8e10])),
        speed=float(rng.choice([0.1, 0.5, 2.0])),
        gaps=tuple(float(gap) for gap in rng.choice([0.0, 3e-6], bodies - 1)) if rng.random() < 0.4 else (),
        damping=float(rng.choice([2.0, 10.0])) if damped else 0.0,
        gravity=9.81 if difference == "gravity" else 0.0,
        wall=difference == "no wall" or bool(rng.random() < 0.3),
    )
    return Variant(
        difference=difference,
        chain=chain,
        dt=float(rng.choice([2e-7, 5e-7, 1e-6, 2e-6, 4e-6])),
        length=float(rng.choice([0.7, 1.0, 2.0, 4.0, 8.0])),
        samples=int(rng.choice([20, 60, 200])),
        dump=int(rng.choice([1, 7, 50])),
        order=tuple(rng.permutation(bodies).tolist()) if rng.random() < 0.5 else tuple(range(bodies)),
        crossings=2.0,
    )


#: seeds of the quick test: a right deck whose run is longer than its scene, and four differences
QUICK = (0, 1, 2, 8, 9)


@pytest.mark.lammps
@pytest.mark.parametrize("seed", QUICK)
def test_a_deck_has_the_cause_that_it_states(seed: int, tmp_path: Path) -> None:
    case = variant(seed)
    answer = case.judge(tmp_path)
    assert (answer.cause, contradictions(answer)) == (case.cause, []), case


@pytest.mark.slow
@pytest.mark.lammps
@pytest.mark.parametrize("seed", range(len(QUICK), 88))
def test_every_variant_of_a_deck_has_the_cause_that_it_states(seed: int, tmp_path: Path) -> None:
    case = variant(seed)
    answer = case.judge(tmp_path)
    assert (answer.cause, contradictions(answer)) == (case.cause, []), case


@pytest.mark.lammps
@pytest.mark.parametrize(("length", "samples"), [(0.5, 20), (3.4, 60)])
@pytest.mark.parametrize("difference", ["right", "speed"])
def test_the_length_of_a_run_and_its_dump_change_no_cause(
    difference: str, length: float, samples: int, tmp_path: Path
) -> None:
    case = replace(variant(0), difference=difference, length=length, samples=samples, dt=2e-6)
    answer = case.judge(tmp_path)
    assert (answer.cause, contradictions(answer)) == (case.cause, []), case


RIGHT = Answer(
    outcome="PASS", cause="none", alternatives=[], error=8.5e-3, floor=1e-13,
    next="For an error of 0.1 % write a step of 1.7 µs.",
    step="5 µs makes an error of 0.85 % of the largest velocity; for 1 %, 0.1 % and 1e-4 at most 5.4 µs, 1.7 µs"
    " and 540 ns",
    limits={"time step": 8.5e-3, "particle radius": 1e-12, "neither time step nor radius": 0.0, "own dump": math.nan},
)  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "found"),
    [
        ({}, None),
        # the answer of the deck whose run was longer than its scene
        ({"outcome": "UNDECIDED", "cause": "unknown", "next": "Look at"}, "the limits explain all but"),
        ({"step": "for 1 %, 0.1 % and 1e-4 at most 5.4 µs, 1.7 µs and 540 ns"}, "nothing is said of"),
        # the answer of the deck with a density of 8100 in place of 7850
        ({"outcome": "FAIL", "cause": "stiffness-scale", "alternatives": ["mass"], "error": 0.066,
          "next": "Compare the stiffness with that of the scene: all contacts have the same wrong factor.",
          "limits": {"time step": 3.4e-4, "mass": 6.7e-2, "neither time step nor radius": 0.0}},
         "mass has a larger effect"),
        ({"outcome": "FAIL"}, "the outcome is FAIL, and the cause none"),
        ({"limits": {**RIGHT.limits, "mass": 0.07}}, "mass has an effect of 7.0e-02"),
        ({"limits": {**RIGHT.limits, "time step": 2e-3}}, "that of the step 2.00e-03"),
        ({"limits": {**RIGHT.limits, "neither time step nor radius": 4e-3}}, "4.0e-03 is explained by nothing"),
        ({"step": RIGHT.step.replace("1.7", "7")}, "a step of 7e-06 s makes 0.001"),
        ({"step": RIGHT.step.replace("0.85 %", "44 %")}, "said to make an error of 0.44"),
        ({"outcome": "FAIL", "cause": "mass", "alternatives": ["mass"]}, "its own alternative"),
        ({"outcome": "FAIL", "cause": "mass", "limits": {**RIGHT.limits, "mass": 0.07}}, "the advice is"),
        # two differences that cancel
        ({"limits": {**RIGHT.limits, "mass": 0.03, "stiffness": 0.03, "all differences from the scene together": 0.0}},
         None),
    ],
)  # fmt: skip
def test_contradictions_of_an_answer_are_found(changes: dict[str, Any], found: str | None) -> None:
    said = contradictions(replace(RIGHT, **changes))
    assert (not said) if found is None else any(found in sentence for sentence in said), said
