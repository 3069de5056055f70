"""Switches change what they say and nothing else; what changes nothing is no switch."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.scene.scene import Damping, Scene, Wall
from dem_bridge.studies.model_hierarchy.model_terms import (
    BARELY,
    DASHPOT,
    GRAVITY,
    ModelTerm,
    by_law,
    model,
    model_terms_of,
    needs,
)
from tests.helpers.driven_chains import SINE

CHAIN = db.load_scene("decelerating-40")
#: what the geometry of the paper's chains tells, and which numbers are others with it; a wall has its own damping
TOLD = {
    "stiffness-law": {"stiffness"},
    "striker-stiffness": {"stiffness"},
    "damping": {"damping"},
    "base": {"wall_right", "damping"},
    "gravity": {"gravity", "precompression"},
}
RAW = Scene(
    name="raw",
    duration=3e-4,
    mass=(8e-3, 1e-2, 1e-2, 1e-2),
    stiffness=(4e9, 2e10, 2e10),
    velocity=(0.8, 0.0, 0.0, 0.0),
    exponent=(2.5, 2.4, 2.5),
    gap=(0.0, 1e-7, 0.0),
    wall_left=Wall(stiffness=3e9, gap=1e-4),
    wall_right=Wall(stiffness=4e9, exponent=2.3),
    gravity=9.81,
    drag=2.0,
    damping=Damping(law="dashpot", coefficient=(1.0, 2.0, 3.0, 4.0, 5.0)),
)
OWN = {
    "force-law": {"exponent", "stiffness", "wall_right"},
    "gaps": {"gap"},
    "drag": {"drag"},
    "damping": {"damping"},
    "wall": {"wall_left", "damping"},
    "base": {"wall_right", "damping"},
    "gravity": {"gravity"},
}


def _ids(found: tuple[ModelTerm, ...]) -> list[str]:
    return [one.id for one in found]


def _differing(one: Scene, other: Scene) -> set[str]:
    inputs = [each.name for each in fields(Scene) if each.init and each.compare]
    return {name for name in inputs if getattr(one, name) != getattr(other, name)} - {"name"}


@pytest.mark.parametrize(("scene", "expected"), [(CHAIN, TOLD), (RAW, OWN)])
def test_every_switch_changes_what_it_says_and_nothing_else(scene: Scene, expected: dict[str, set[str]]) -> None:
    found = model_terms_of(scene)
    assert _ids(found) == list(expected)
    for one in found:
        held = frozenset(other.id for other in found if one.id in needs(scene, found, other))
        changed = _differing(model(scene, found, held), model(scene, found, held | {one.id}))
        assert changed == expected[one.id], one.id


def test_with_all_that_is_told_left_out_a_scene_is_as_it_was() -> None:
    found = model_terms_of(CHAIN)
    assert model(CHAIN, found, frozenset(TOLD)).content_hash == CHAIN.content_hash
    assert model(RAW, model_terms_of(RAW)).content_hash == RAW.content_hash


def test_the_fullest_model_of_the_papers_chain_is_what_its_geometry_tells() -> None:
    full = model(CHAIN, model_terms_of(CHAIN))
    # the printed mass is that of a sphere of crystalline quartz, and no term
    assert full.mass == CHAIN.mass
    # Hertz at 2 degrees and for a sphere on a cylinder, to the digits known
    assert full.stiffness[:2] == pytest.approx((3.98253e9, 6.17559e10), rel=2e-6)
    assert (full.gravity, full.precompression, full.drag) == (GRAVITY, BARELY, 0.0)
    assert full.wall_right is not None
    assert full.wall_right.stiffness == full.stiffness[-1]
    assert full.damping == Damping(law="dashpot", coefficient=(DASHPOT,) * full.n_contact)
    # the last contact of the chain carries 40 bodies, the base all 41
    static = full.contacts.force(-full.contacts.gap, np.arange(full.n_contact))
    assert static[-1] == pytest.approx(GRAVITY * sum(full.mass), rel=1e-6)


def test_a_law_and_back_is_the_law_that_was() -> None:
    there = by_law(CHAIN, "exact")
    back = by_law(there, "paper")
    # angles found from stiffnesses: near 90 degrees they are ill-conditioned, the stiffness is not
    np.testing.assert_allclose(back.stiffness, CHAIN.stiffness, rtol=1e-9)
    assert there.stiffness[0] == CHAIN.stiffness[0]
    assert all(new < old for new, old in zip(there.stiffness[1:-2], CHAIN.stiffness[1:-2], strict=True))
    exact = db.load_scene("decelerating-40-exact")
    assert _ids(model_terms_of(exact)) == ["stiffness-law", "damping", "base", "gravity"]
    assert model(exact, model_terms_of(exact)).stiffness == exact.stiffness


def test_a_switch_that_changes_nothing_is_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = replace(RAW, name="plain", gap=0.0, drag=0.0, damping=Damping(law="dashpot", coefficient=0.0))
    assert not {"gaps", "drag", "damping"} & set(_ids(model_terms_of(plain)))

    def idle(scene: Scene) -> Iterator[ModelTerm]:
        yield ModelTerm(id="drag", what="a switch that does nothing")
        yield ModelTerm(id="gaps", what="one that does", off=lambda s: replace(s, gap=0.0))

    monkeypatch.setattr("dem_bridge.studies.model_hierarchy.model_terms.terms_of_scene", idle)
    assert _ids(model_terms_of(RAW)) == ["gaps"]


def test_only_what_a_scene_has_is_switched_where_nothing_is_to_be_added() -> None:
    assert model_terms_of(CHAIN, add=False) == ()
    assert _ids(model_terms_of(db.load_scene("decelerating-40-dashpot"), add=False)) == ["damping"]
    assert _ids(model_terms_of(db.load_scene("stacked-40"), add=False)) == ["base", "gravity"]
    assert _ids(model_terms_of(replace(CHAIN, geometry=None))) == []
    # spheres lie anywhere: of their weight nothing is known
    assert _ids(model_terms_of(db.load_scene("homogeneous-spheres"))) == []
    # of other exponents Hertz' law says nothing; the weight is there all the same, and the base as the last contact
    soft = db.load_scene("decelerating-40-soft-exponent")
    assert _ids(model_terms_of(soft)) == ["force-law", "damping", "base", "gravity"]
    wall = model(soft, model_terms_of(soft)).wall_right
    assert wall == Wall(stiffness=soft.stiffness[-1], exponent=2.4)
    # a chain with gaps does not stand in touch
    assert "gravity" not in _ids(model_terms_of(db.load_scene("decelerating-40-gaps")))


def test_a_drive_makes_the_wave_and_is_never_switched() -> None:
    driven = replace(RAW, drive=SINE)
    assert _ids(model_terms_of(driven)) == _ids(model_terms_of(RAW))
    found = model_terms_of(driven)
    assert model(driven, found, frozenset(_ids(found))).drive == SINE


def test_a_weight_needs_what_it_stands_on() -> None:
    def needed(scene: Scene) -> frozenset[str]:
        found = model_terms_of(scene)
        [gravity] = [one for one in found if one.id == "gravity"]
        return needs(scene, found, gravity)

    stacked = db.load_scene("stacked-40")
    assert needed(CHAIN) == needed(stacked) == {"base"}
    hanging = Wall(stiffness=4e9)
    assert needed(replace(stacked, geometry=None, gravity=-9.81, wall_left=hanging)) == {"wall"}
    # one that is not in equilibrium falls on whatever there is
    assert needed(RAW) == frozenset()


def test_what_holds_a_weightless_chain_together_goes_with_the_weight() -> None:
    stacked = db.load_scene("stacked-40")
    light = model(stacked, model_terms_of(stacked, add=False), frozenset({"gravity"}))
    assert (light.gravity, light.precompression) == (0.0, 0.0)
    pressed = replace(stacked, precompression=20.0)
    found = model_terms_of(pressed, add=False)
    assert _ids(found) == ["base", "gravity", "precompression"]
    assert model(pressed, found, frozenset({"gravity"})).precompression == 20.0
    assert model(pressed, found, frozenset({"precompression"})).precompression == BARELY
    assert model(pressed, found, frozenset({"gravity", "precompression"})).precompression == 0.0


def test_what_has_an_entry_per_contact_follows_a_wall() -> None:
    def coefficients(*without: str) -> tuple[float, ...] | float:
        damping = model(RAW, model_terms_of(RAW), frozenset(without)).damping
        assert damping is not None
        return damping.coefficient

    assert coefficients("wall") == (1.0, 2.0, 3.0, 5.0)
    assert coefficients("base") == (1.0, 2.0, 3.0, 4.0)
    damped = db.load_scene("decelerating-40-dashpot")
    full = model(damped, model_terms_of(damped))
    assert full.damping == Damping(law="dashpot", coefficient=(10.0,) * 41)
    law = tuple(lambda overlap, nth=nth: nth * 1e9 * overlap**1.5 for nth in range(1, 6))
    ruled = replace(RAW, damping=None, law=law)
    assert model(ruled, model_terms_of(ruled), frozenset({"wall"})).law == (*law[:3], law[4])


def test_in_place_of_another_law_is_hertz_with_the_same_force_at_the_largest_overlap() -> None:
    def of(scene: Scene) -> Scene:
        return model(scene, model_terms_of(scene), frozenset({"force-law"}))

    overlap, which = prescan_scene(RAW).peak_overlap, np.arange(5)
    felt = overlap > 0.0
    assert felt.sum() >= 4
    hertz = of(RAW).contacts
    assert set(hertz.exponent.tolist()) == {2.5}
    np.testing.assert_allclose(hertz.force(overlap, which), RAW.contacts.force(overlap, which), rtol=1e-11)
    ruled = replace(RAW, damping=None, law=lambda overlap: 1e10 * overlap**1.5 + 2e6 * overlap)
    overlap = prescan_scene(ruled).peak_overlap
    found = of(ruled)
    assert found.law is None
    expected = ruled.contacts.force(overlap, which)
    np.testing.assert_allclose(found.contacts.force(overlap, which)[overlap > 0], expected[overlap > 0], rtol=1e-11)
