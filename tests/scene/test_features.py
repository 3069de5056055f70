"""Every field of a scene is declared: it gives features, or every backend obeys it."""

from __future__ import annotations

import pickle
from dataclasses import fields, replace
from typing import Any

import pytest

from dem_bridge.scene.drive import Drive
from dem_bridge.scene.features import FEATURES, FIELDS
from dem_bridge.scene.piston import Piston
from dem_bridge.scene.scene import Adhesion, Damping, Scene, Wall

PLAIN = Scene(
    name="plain", duration=1e-4, mass=(8e-3, 1e-2, 1e-2), stiffness=(4e9, 5e9), velocity=(0.8, 0.0, 0.0), samples=4
)
SINE = Drive(shape="sine", force=2.0, frequency=5e3)


def test_every_field_has_an_entry_and_every_entry_a_field() -> None:
    owners = {kind.__name__: kind for kind in (Scene, Wall, Damping, Adhesion, Drive, Piston)}
    assert {f"{name}.{field.name}" for name, kind in owners.items() for field in fields(kind)} == set(FIELDS)


def test_no_two_features_share_a_label_and_each_is_described_in_a_sentence() -> None:
    assert len({feature.label for feature in FEATURES}) == len(FEATURES)
    for feature in FEATURES:
        assert feature.sentence[0].isupper()
        assert feature.sentence.endswith(".")
        assert not feature.label.endswith(".")


def test_a_plain_scene_has_no_feature() -> None:
    assert PLAIN.features == frozenset()
    assert (PLAIN.dissipates, PLAIN.conserves_energy, PLAIN.conserves_momentum) == (False, True, True)


@pytest.mark.parametrize(
    ("changes", "labels"),
    [
        ({"wall_left": Wall(stiffness=1e9)}, {"walls"}),
        ({"wall_right": Wall(stiffness=1e9)}, {"walls"}),
        ({"wall_right": Wall(stiffness=1e9, gap=1e-6)}, {"walls", "gaps"}),
        ({"wall_left": Wall(stiffness=1e9, gap=-1e-6)}, {"walls", "initial overlaps"}),
        ({"gap": (0.0, 1e-9)}, {"gaps"}),
        ({"gap": (-1e-9, 1e-9)}, {"gaps", "initial overlaps"}),
        ({"velocity": (0.8, 0.0, -1e-3)}, {"bodies behind the first that move at the start"}),
        ({"exponent": 2.4}, {"exponents other than 5/2"}),
        ({"exponent": (2.5, 2.4)}, {"exponents other than 5/2", "exponents that differ between contacts"}),
        (
            {"wall_right": Wall(stiffness=1e9, exponent=2.0)},
            {"walls", "exponents other than 5/2", "exponents that differ between contacts"},
        ),
        ({"law": lambda overlap: 4e9 * overlap**1.5, "exponent": 2.4}, {"contact laws given as functions"}),
        ({"gravity": -1e-9}, {"gravity"}),
        ({"precompression": 5.0}, {"precompression"}),
        ({"damping": Damping(law="dashpot", coefficient=(0.0, 1.0))}, {"dashpot damping"}),
        ({"damping": Damping(law="kuwabara-kono", coefficient=1e-6)}, {"Kuwabara-Kono damping"}),
        ({"damping": Damping(law="mass_velocity", coefficient=1.0)}, {"mass-proportional dashpot damping"}),
        (
            {"damping": Damping(law="coeff_restitution", coefficient=(1.0, 0.5), clip=False)},
            {"damping by a coefficient of restitution", "damping forces that are not clipped"},
        ),
        ({"damping": Damping(law="coeff_restitution", coefficient=1.0)}, set()),
        ({"damping": Damping(law="tsuji", coefficient=0.5, clip=True)}, {"Tsuji damping"}),
        ({"adhesion": Adhesion(law="dmt", pull_off=(0.1, 0.0))}, {"DMT adhesion"}),
        ({"adhesion": Adhesion(law="jkr", pull_off=(0.1, 0.0))}, {"JKR adhesion"}),
        ({"drag": 1.0}, {"drag"}),
        ({"drive": SINE}, {"a sine drive"}),
        ({"drive": replace(SINE, shape="chirp", last_frequency=9e3, sweep=1e-4)}, {"a chirp drive"}),
        ({"drive": Drive(shape="table", force=(0.0, 1.0), interval=1e-4)}, {"a tabulated drive"}),
        ({"duration": 2e-4, "samples": 3, "name": "other", "description": "another", "spacing": 0.1}, set()),
        ({"mass": (1e-2, 3e-2, 1e-2), "stiffness": (1e9, 7e9), "velocity": (-0.1, 0.0, 0.0)}, set()),
        ({"damping": Damping(law="dashpot", coefficient=0.0)}, set()),
    ],
    ids=lambda value: "-".join(sorted(value)) or "none",
)
def test_a_scene_has_the_features_of_its_fields(changes: dict[str, Any], labels: set[str]) -> None:
    assert {feature.label for feature in replace(PLAIN, **changes).features} == labels


def test_features_do_not_travel_with_a_scene() -> None:
    scene = replace(PLAIN, drag=1.0)
    assert [feature.label for feature in scene.features] == ["drag"]
    assert pickle.loads(pickle.dumps(scene)).features == scene.features
