"""Variants of a deck change what they name and nothing else; radii carry stiffnesses to the last digits."""

from __future__ import annotations

import difflib
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dem_bridge.errors import UnsupportedScene
from dem_bridge.lmp.deck import Deck, deck_of
from dem_bridge.lmp.variants import (
    MARGIN,
    encoded_radii,
    flat_walls,
    frozen_walls,
    hertz_history,
    newton_off,
    with_restart,
)
from dem_bridge.scene.scene import Adhesion, Damping, Scene, Wall
from dem_bridge.trajectory.dense import schedule

SCENE = Scene(
    name="held",
    duration=1e-4,
    mass=(8e-3, 1e-2, 1.2e-2),
    stiffness=(4e9, 5e9),
    velocity=(0.8, 0.0, 0.0),
    wall_left=Wall(stiffness=6e9, gap=1e-6),
    wall_right=Wall(stiffness=7e9),
    gravity=9.81,
    samples=10,
)
RADIUS = 2.0**-15
OVERLAP = np.full(SCENE.n_contact, 1e-5)


def _deck(scene: Scene, dt: float = 1e-7) -> Deck:
    plan = schedule(duration=scene.duration, samples=scene.samples, dt=dt, frequency=2e5, bodies=scene.n_body)
    return deck_of(scene, radius=RADIUS, schedule=plan)


def _changes(old: Deck, new: Deck) -> list[str]:
    """Lines of the deck that went (-) or came (+)."""
    before, after = (deck.files[deck.input_file].splitlines() for deck in (old, new))
    return [line for line in difflib.ndiff(before, after) if line.startswith(("- ", "+ "))]


def test_newton_off_changes_one_line() -> None:
    deck = _deck(SCENE)
    assert _changes(deck, newton_off(deck)) == ["- newton          on", "+ newton          off"]
    assert newton_off(deck).files[f"data.{SCENE.name}"] == deck.files[f"data.{SCENE.name}"]


@pytest.mark.parametrize("dt", [1e-7, 1e-5, 2e-6])
def test_a_restart_cuts_between_dumps_where_there_is_such_a_step(dt: float) -> None:
    deck = _deck(SCENE, dt)
    plan = deck.schedule
    runs = [
        line.split()[1] for line in with_restart(deck).files[deck.input_file].splitlines() if line.startswith("run")
    ]
    cut = int(runs[0])
    assert runs[1] == "${steps}"
    assert 0 < cut <= plan.steps
    if len(plan.dense_steps) < plan.steps:
        assert cut not in plan.dense_steps
        assert abs(cut - plan.steps / 2) <= plan.per_sample


def test_a_plane_has_the_stiffness_of_one_radius_and_touches_where_the_frozen_body_did() -> None:
    deck = flat_walls(_deck(SCENE), SCENE)
    fixes = [line.split() for line in deck.files[deck.input_file].splitlines() if " wall/gran " in line]
    planes = {words[1]: (float(words[6]), words[-3:-1]) for words in fixes}
    k, (plane, no) = planes["left"]
    assert (k, no) == (6e9 / np.sqrt(RADIUS), "NULL")
    # of body 0, which is at 0
    assert 0.0 - RADIUS - float(plane) == pytest.approx(1e-6, rel=1e-9)
    k, (no, plane) = planes["right"]
    assert (k, no) == (7e9 / np.sqrt(RADIUS), "NULL")
    assert float(plane) == 4 * RADIUS + RADIUS
    # the marks have a type of their own, and that has no law but the background's
    rows = deck.files[f"data.{SCENE.name}"].splitlines()
    marks = [
        row.split()[1]
        for row in rows
        if row.endswith(" 0 0") and row.split()[0] in ("1", "5") and len(row.split()) == 7
    ]
    assert str(deck.types) in marks
    assert not any(line.split()[2] == str(deck.types) for line in _pairs(deck))


def _pairs(deck: Deck) -> list[str]:
    return [line for line in deck.files[deck.input_file].splitlines() if line.startswith("pair_coeff")]


def test_a_plane_sees_the_whole_mass_of_a_body() -> None:
    """A frozen body weighs as much as its neighbour, so the effective mass of the two is half of it."""
    gamma = 1e-6
    scene = replace(SCENE, damping=Damping(law="kuwabara-kono", coefficient=gamma))
    text = flat_walls(_deck(scene), scene).files["in.held"]
    words = next(line.split() for line in text.splitlines() if line.startswith("fix             left"))
    assert words[-6:-4] == ["viscoelastic", "limit_damping"]
    eta = float(words[7])
    assert eta * scene.mass[0] * np.sqrt(RADIUS) == pytest.approx(gamma * 6e9, rel=1e-14)


@pytest.mark.parametrize(
    ("scene", "why"),
    [
        (replace(SCENE, exponent=2.0), "n = 2.5 only"),
        (replace(SCENE, damping=Damping(law="dashpot", coefficient=1.0)), "one damping coefficient"),
        (Scene(name="one", duration=1e-4, mass=(1.0,), stiffness=(), velocity=(1.0,), samples=10), "no contact"),
        (replace(SCENE, stiffness=(1e9, 9e9)), "no radii"),
    ],
)
def test_what_one_coefficient_cannot_express_is_refused_with_the_reason(scene: Scene, why: str) -> None:
    with pytest.raises(UnsupportedScene, match=why):
        hertz_history(_deck(scene), scene, np.full(scene.n_contact, 1e-5))


def test_walls_that_are_not_there_are_refused() -> None:
    free = replace(SCENE, wall_left=None, wall_right=None)
    with pytest.raises(UnsupportedScene, match="no wall"):
        flat_walls(_deck(free), free)


def test_a_deck_of_encoded_radii_says_where_its_bodies_touch() -> None:
    deck = hertz_history(_deck(SCENE), SCENE, OVERLAP)
    assert deck.types == 1
    # gaps along the line: left wall, the chain's two, right wall; to the last digit of a coordinate
    found = np.diff(deck.line) - deck.reach
    assert found == pytest.approx([1e-6, 0.0, 0.0, 0.0], abs=4 * np.spacing(np.max(np.abs(deck.line))))
    assert deck.line[1] == 0.0


@given(
    inverse=st.lists(st.floats(1e2, 1e5), min_size=2, max_size=60),
    overlap=st.floats(1e-9, 1e-4),
    scale=st.floats(1e6, 1e12),
)
def test_stiffnesses_that_radii_can_carry_are_carried(inverse: list[float], overlap: float, scale: float) -> None:
    u = np.array(inverse)
    beta = scale / np.sqrt(u[1:] + u[:-1])
    found = encoded_radii(beta, np.full(len(beta), overlap))
    if found is None:
        # the window of first radii has shrunk to their last digits: these are the radii at both of its ends
        sign = np.where(np.arange(len(u)) % 2 == 0, 1.0, -1.0)
        assert np.min(u[sign > 0]) + np.min(u[sign < 0]) < 1e-8 * np.max(u)
        return
    radii, kn = found
    # one rounding for each of 1/R, their sum, the root and what was given: a few units in the last place, but sums
    # of which one part is much smaller than what it was subtracted from lose as much as that
    loss = np.max(u) / np.min(u[1:] + u[:-1])
    assert kn * np.sqrt(radii[1:] * radii[:-1] / (radii[1:] + radii[:-1])) == pytest.approx(
        beta, rel=1e-15 * (8 + loss)
    )
    assert np.min(radii) >= MARGIN * overlap * (1 - 1e-12)


def test_equal_stiffnesses_give_equal_radii_that_are_powers_of_two() -> None:
    radii, _ = encoded_radii(np.full(7, 4e9), np.full(7, 1e-5)) or (np.zeros(0), 0.0)
    assert radii.tolist() == [2.0**-16] * 8


def test_variants_say_what_a_scene_lacks() -> None:
    free = Scene(name="free", duration=1e-4, mass=(1.0, 1.0), stiffness=(1e9,), velocity=(1.0, 0.0))
    glued = replace(free, adhesion=Adhesion(law="dmt", pull_off=0.5), gap=1e-6)
    deck: Any = None  # which is not looked at
    with pytest.raises(UnsupportedScene, match="the scene has no wall, which this variant requires"):
        frozen_walls(deck, free)
    with pytest.raises(UnsupportedScene, match="gran/hertz/history has no adhesion"):
        hertz_history(deck, glued, np.ones(1))
    assert encoded_radii(np.zeros(0), np.zeros(0)) is None


@pytest.mark.parametrize("places", [0, 2])
def test_a_variant_changes_exactly_one_place_of_a_deck(places: int) -> None:
    deck = _deck(SCENE)
    text = re.sub(r"(?m)^newton +on\n", "newton on\n" * places, deck.files[deck.input_file])
    assert text != deck.files[deck.input_file]
    changed = replace(deck, files={**deck.files, deck.input_file: text})
    with pytest.raises(ValueError, match=f"fits {places} places of the deck; allowed: one"):
        newton_off(changed)
