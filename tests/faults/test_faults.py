"""Planted defects: each of them must be caught, by the comparison that is meant to catch it.

A fault in a deck is caught by LAMMPS minus twin, where the time step cancels and 1e-8 of the largest velocity is
enough; a fault in the twin or in the reference by one minus the other. A check that cannot fail is a bug.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import dem_bridge as db
from dem_bridge.backends import bca, lammps, scipy_integration
from dem_bridge.backends import twin as twin_code
from dem_bridge.compare import difference
from dem_bridge.errors import RunBroken
from dem_bridge.lmp.deck import Deck, granular_deck
from dem_bridge.physics import exact
from dem_bridge.scene import Scene, Wall
from dem_bridge.trajectory import Trajectory
from dem_bridge.verdict import Outcome, Verdict, numerical_verdict

#: an accelerating and then re-colliding chain with everything that a deck can say: masses, gap, overlap, walls, weight
CHAIN = Scene(
    name="chain",
    duration=4e-4,
    mass=(8.1e-3, 1e-2, 1.1e-2, 1.2e-2, 9e-3),
    stiffness=(4e9, 5e9, 8e9, 6e9),
    velocity=(0.8, 0.0, 0.0, 0.0, -0.1),
    gap=(0.0, 1e-6, -5e-7, 0.0),
    wall_left=Wall(stiffness=3e9, gap=1e-6),
    wall_right=Wall(stiffness=2e9, gap=5e-6),
    gravity=50.0,
    samples=100,
)
DT = 1e-7

#: what LAMMPS may differ by from its twin: ten times what 4000 sound steps of this scene could ever need
TOLERANCE = 1e-8


def _judged(run: Trajectory, reference: Trajectory, tolerance: float, quantity: str = "velocity") -> Verdict:
    return numerical_verdict(
        difference(quantity, run, reference),
        scene=CHAIN.name,
        backend="judged",
        reference="reference",
        tolerance=tolerance,
        meaning="a planted fault",
    )


@pytest.fixture(scope="module")
def twin() -> Trajectory:
    # what judges a deck's fault is the difference alone: the twin at the same step has no error of its own here
    sound = db.solve(CHAIN, backend="verlet", dt=DT, bars=False)
    return replace(sound, uncertainty=dict.fromkeys(sound.uncertainty, 0.0))


@pytest.fixture(scope="module")
def reference() -> Trajectory:
    return db.solve(CHAIN, backend="scipy")


# in a deck

Change = Callable[[str, str], tuple[str, str]]


def _substituted(pattern: str, new: str | Callable[[re.Match[str]], str], *, data: bool = False) -> Change:
    """A change of the one place in the deck (or its data file) where the pattern fits."""

    def change(deck: str, other: str) -> tuple[str, str]:
        text, count = re.subn(pattern, new, other if data else deck, flags=re.MULTILINE)
        assert count == 1, f"{pattern!r} fits {count} places"
        return (deck, text) if data else (text, other)

    return change


def _swapped(deck: str, data: str) -> tuple[str, str]:
    """The stiffnesses of contacts 1 and 2 change places."""
    found = {k: re.search(rf"hertz (\S+) 0 .*# contact {k}:", deck) for k in (1, 2)}
    one, other = (match[1] for match in found.values() if match)
    return deck.replace(f"hertz {one} ", "hertz @ ").replace(f"hertz {other} ", f"hertz {one} ").replace(
        "@", other
    ), data


def _without_root(deck: str, data: str) -> tuple[str, str]:
    """K = beta instead of beta / sqrt(R/2)."""
    text, count = re.subn(r"hertz \S+ 0 (.*# \S+( \d+)?: beta = (\S+))$", r"hertz \3 0 \1", deck, flags=re.MULTILINE)
    assert count == CHAIN.n_contact
    return text, data


def _damped(deck: str, data: str) -> tuple[str, str]:
    text, count = re.subn(r"(hertz [1-9]\S+) 0 ", r"\1 1e-3 ", deck)
    assert count == CHAIN.n_contact
    return text, data


def _times(pattern: str, factor: float) -> Callable[[re.Match[str]], str]:
    return lambda match: match[0].replace(match[1], repr(float(match[1]) * factor))


K2 = r"hertz (\S+) 0 .*# contact 2:"
DECK_FAULTS: dict[str, Change] = {
    "stiffness of one contact wrong by 1e-6": _substituted(K2, _times(K2, 1.0 + 1e-6)),
    "two contacts swapped": _swapped,
    "mass of one body wrong by 1e-6": _substituted(r"atom 4 mass (\S+)", _times("", 1.0 + 1e-6)),
    "mass of one body missing": _substituted(r"^set +atom 4 mass .*\n", "set atom 4 mass 1e-2\n"),
    "damping left on at 1e-3": _damped,
    "stiffness of the wall wrong by 1e-5": _substituted(r"hertz (\S+) 0 .*# wall_right:", _times("", 1.0 + 1e-5)),
    "two contacts given the same pair of types": _substituted(r"^7 1 ", "7 3 ", data=True),
    "weight the other way": _substituted(r"vector 1 0 0", "vector -1 0 0"),
    "weight forgotten": _substituted(r"^fix +weight.*\n", ""),
    "weight wrong by 1e-4": _substituted(r"index 50\.0 ", "index 50.005 "),
    "step wrong by 1e-6": _substituted(r"dt +index (\S+)", _times("", 1.0 + 1e-6)),
    "speed of the striker wrong by 1e-7": _substituted(r"^2 0\.8 0 0 0 0 0", "2 0.80000008 0 0 0 0 0", data=True),
    "a body moved by a nanometre": _substituted(
        r"^(4 \d+ \S+ \S+ )(\S+) 0 0$", lambda m: f"{m[1]}{float(m[2]) + 1e-9!r} 0 0", data=True
    ),
    "walls that give way": _substituted(r"^fix +motion bodies nve", "fix motion all nve"),
}

#: faults that let bodies run into each other: with the small gauge radius of a run they are noticed there already
SOFT_FAULTS: dict[str, Change] = {
    "root of the effective radius missing": _without_root,
    "one contact left out": _substituted(r"^pair_coeff.*# contact 1:.*\n", ""),
}


@pytest.fixture
def faulty_lammps(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Trajectory]:
    def solve(change: Change, **settings: float) -> Trajectory:
        def planted(scene: Scene, **how: Any) -> Deck:
            deck = granular_deck(scene, **how)
            texts = change(deck.files["in.chain"], deck.files["data.chain"])
            return replace(deck, files=dict(zip(("in.chain", "data.chain"), texts, strict=True)))

        monkeypatch.setattr(lammps, "granular_deck", planted)
        return db.solve(CHAIN, backend="lammps-granular", dt=DT, bars=False, **settings)

    return solve


@pytest.mark.lammps
def test_a_sound_deck_passes(faulty_lammps: Callable[..., Trajectory], twin: Trajectory) -> None:
    run = faulty_lammps(lambda deck, data: (deck, data))
    for quantity in ("velocity", "displacement", "peak_force", "crossing_time"):
        assert _judged(run, twin, TOLERANCE, quantity).outcome is Outcome.PASS
    # far below the tolerance: what is caught is the fault and not the weather
    assert difference("velocity", run, twin).value < 1e-3 * TOLERANCE


@pytest.mark.lammps
@pytest.mark.parametrize("change", DECK_FAULTS.values(), ids=DECK_FAULTS)
def test_a_fault_in_a_deck_fails(change: Change, faulty_lammps: Callable[..., Trajectory], twin: Trajectory) -> None:
    verdict = _judged(faulty_lammps(change), twin, TOLERANCE)
    assert verdict.outcome is Outcome.FAIL
    assert verdict.sentence.startswith("velocity of judged differs")


@pytest.mark.lammps
@pytest.mark.parametrize("change", SOFT_FAULTS.values(), ids=SOFT_FAULTS)
def test_a_fault_that_makes_contacts_too_soft_breaks_the_run_or_fails(
    change: Change, faulty_lammps: Callable[..., Trajectory], twin: Trajectory
) -> None:
    with pytest.raises(RunBroken, match="exceeds the gauge radius"):
        faulty_lammps(change)
    # bodies large enough to take it: then the comparison sees it
    assert _judged(faulty_lammps(change, gauge_radius=1e-3), twin, TOLERANCE).outcome is Outcome.FAIL


@pytest.mark.lammps
@pytest.mark.parametrize(
    "fault",
    [
        _substituted(r"floor\(step\*v_dense/v_per_sample\) \+ 1\)\*v_per_sample/v_dense", "step + 1)"),
        _substituted(r"first yes", "first no"),
        _substituted(r"steps +index (\d+)", lambda match: f"steps index {int(match[1]) // 2}"),
    ],
    ids=["a dump at every step", "the start not dumped", "half of the steps"],
)
def test_dumps_at_other_steps_are_a_broken_run(fault: Change, faulty_lammps: Callable[..., Trajectory]) -> None:
    with pytest.raises(RunBroken, match=r"LAMMPS dumped \d+ frames of 7 atoms; the deck asks for \d+ of 7"):
        faulty_lammps(fault)


# in the twin

SOURCE = inspect.getsource(twin_code.integrate.py_func)

#: what is written -> what is planted, in the twin's own source
TWIN_FAULTS = {
    "tension allowed": [("max(overlap[k], 0.0)", "overlap[k]"), ("np.sqrt(closed)", "np.sqrt(abs(closed))")],
    "one kick with the force of the step before": [
        ("            if hertz:\n", "            old = net.copy()\n            if hertz:\n"),
        ("kick[i] * net[i]\n            step += 1", "kick[i] * old[i]\n            step += 1"),
    ],
    "whole kicks instead of half ones": [("0.5 * dt / mass", "dt / mass")],
    "a reaction forgotten": [("net[k + 1] += force[k]", "net[k + 1] += 0.999 * force[k]")],
    "weight without mass": [("mass * gravity", "0.01 * gravity")],
    "a gap of the wrong sign": [("overlap = -gap", "overlap = gap.copy()")],
    "samples one step late": [("while step <= dense_steps[row]:", "while step <= dense_steps[row] + (row > 0):")],
    "an exponent in place of the root": [("closed * np.sqrt(closed)", "closed ** 1.499")],
}


def _faulty_twin(monkeypatch: pytest.MonkeyPatch, changes: list[tuple[str, str]]) -> Trajectory:
    """The twin with a changed source, not compiled."""
    text = SOURCE
    for old, new in changes:
        assert old in text, f"the twin's source has changed: {old!r} is not in it"
        text = text.replace(old, new)
    names = {"np": np}
    exec(text.split("\n", 1)[1], names)  # without the decorator
    monkeypatch.setattr(twin_code, "integrate", names["integrate"])
    return db.solve(CHAIN, backend="verlet", dt=DT, bars=False)


#: (omega dt)^2 / 12 = 1e-6 for the twin at this step and the re-collisions of the chain; measured 1e-5
TIME_STEP = 1e-4


def test_the_sound_twin_passes_compiled_or_not(
    monkeypatch: pytest.MonkeyPatch, twin: Trajectory, reference: Trajectory
) -> None:
    plain = _faulty_twin(monkeypatch, [])
    np.testing.assert_array_equal(plain.velocity, twin.velocity)
    assert _judged(plain, reference, TIME_STEP).outcome is Outcome.PASS


@pytest.mark.parametrize("changes", TWIN_FAULTS.values(), ids=TWIN_FAULTS)
def test_a_fault_in_the_twin_fails(
    changes: list[tuple[str, str]], monkeypatch: pytest.MonkeyPatch, reference: Trajectory
) -> None:
    verdict = _judged(_faulty_twin(monkeypatch, changes), reference, TIME_STEP)
    assert verdict.outcome is Outcome.FAIL
    assert verdict.first_divergence is None or verdict.first_divergence[0] > 0.0


def test_a_wrong_exponent_in_the_twin_fails(reference: Trajectory) -> None:
    # 1.45 in place of 1.5, with the stiffness that gives the same force at 5 um
    stiffness = tuple(k * 5e-6**0.05 for k in CHAIN.stiffness)
    walls = (CHAIN.wall_left, CHAIN.wall_right)
    left, right = (Wall(stiffness=w.stiffness * 5e-6**0.05, gap=w.gap, exponent=2.45) for w in walls if w)
    soft = replace(CHAIN, exponent=(2.45,) * 4, stiffness=stiffness, wall_left=left, wall_right=right)
    assert _judged(db.solve(soft, backend="verlet", dt=DT), reference, TIME_STEP).outcome is Outcome.FAIL


# in the reference


def test_a_reference_that_restarts_late_fails(monkeypatch: pytest.MonkeyPatch, reference: Trajectory) -> None:
    sound = scipy_integration.Integration._first_event

    def late(self: Any, solver: Any, dense: Any, closed: NDArray[np.bool_]) -> tuple[float, int] | None:
        found = sound(self, solver, dense, closed)
        return None if found is None else (float(solver.t), found[1])

    monkeypatch.setattr(scipy_integration.Integration, "_first_event", late)
    wrong = db.solve(CHAIN, backend="scipy", bars=False)
    # what every reference run is asserted to have on the paper's chains
    assert _judged(wrong, reference, 1e-10).outcome is Outcome.FAIL


def test_a_reference_with_another_law_fails(
    monkeypatch: pytest.MonkeyPatch, twin: Trajectory, reference: Trajectory
) -> None:
    sound = scipy_integration.Integration._force
    monkeypatch.setattr(scipy_integration.Integration, "_force", lambda self, overlap: 1.001 * sound(self, overlap))
    assert _judged(twin, db.solve(CHAIN, backend="scipy"), TIME_STEP).outcome is Outcome.FAIL


# in the theory


def test_a_theory_with_the_masses_swapped_loses_momentum(monkeypatch: pytest.MonkeyPatch) -> None:
    def swapped(
        *, masses: tuple[float, float], velocities: tuple[float, float], stiffness: float, exponent: float
    ) -> exact.TwoBodyCollision:
        return exact.two_body_collision(
            masses=masses[::-1], velocities=velocities, stiffness=stiffness, exponent=exponent
        )

    monkeypatch.setattr(bca, "two_body_collision", swapped)
    pulse = replace(
        CHAIN, gap=0.0, wall_left=None, wall_right=None, gravity=0.0, velocity=(0.8, 0.0, 0.0, 0.0, 0.0), exponent=2.5
    )
    total = db.solve(pulse, backend="bca").velocity @ np.array(pulse.mass)
    assert np.max(np.abs(total / total[0] - 1.0)) > 1e-3
