"""Scenes from CSV: tables that were exported give the scene back, and a mistake is named by file, line and column."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import dem_bridge as db
from dem_bridge.errors import DemBridgeError, SceneError, UsageError
from dem_bridge.scene.file import load_scene, shipped_scenes
from dem_bridge.scene.file.scene_csv import BODY, CONTACT, DERIVED, PLACE, scene_of_csv
from dem_bridge.scene.scene import DAMPING_LAWS, Adhesion, Damping, Scene, Wall
from tests.helpers.export_chains import CROSSED, RAW
from tests.helpers.strategies import ANY, damped_scenes, examples, scenes

CHAIN = """# three balls
mass_kg, velocity_m_per_s, stiffness_N_per_m^(n-1), exponent, gap_m
8e-3, 0.8, 4e9, 2.5, 0
1e-2, 0.0, 5e6, 2.0, 1e-6

# the last has no next
1.2e-2, -0.1, , ,
"""
THREE = Scene(
    name="chain",
    duration=1e-4,
    mass=(8e-3, 1e-2, 1.2e-2),
    velocity=(0.8, 0.0, -0.1),
    stiffness=(4e9, 5e6),
    exponent=(2.5, 2.0),
    gap=(0.0, 1e-6),
)


def _beside(scene: Scene) -> dict[str, Any]:
    """What tables do not have."""
    keys = ("name", "duration", "description", "gravity", "drag", "precompression", "samples", "spacing", "drive")
    return {key: getattr(scene, key) for key in keys}


def _back(scene: Scene) -> Scene:
    bodies = str(db.export(scene, table="bodies", format="csv"))
    contacts = str(db.export(scene, table="contacts", format="csv", with_run=False))
    return scene_of_csv(bodies, file="bodies.csv", contacts=contacts, contacts_file="contacts.csv", **_beside(scene))


@pytest.mark.parametrize("name", shipped_scenes())
def test_exported_tables_of_shipped_scenes_are_these_scenes(name: str) -> None:
    scene = load_scene(name)
    assert _back(scene) == scene


@examples(15)
@given(st.one_of(scenes(exponents=ANY, walls=True, gravity=True), damped_scenes()))
def test_exported_tables_of_random_scenes_are_these_scenes(scene: Scene) -> None:
    assert _back(scene) == scene


@pytest.mark.parametrize("clip", [True, False])
@pytest.mark.parametrize("law", DAMPING_LAWS)
def test_every_damping_law_has_a_column_of_its_own(law: str, clip: bool) -> None:
    scene = replace(RAW, damping=Damping(law=law, coefficient=1e-6 if law == "kuwabara-kono" else 0.5, clip=clip))
    assert _back(scene) == scene


@pytest.mark.parametrize("damped", [True, False])
def test_the_adhesion_has_a_column_of_its_own(damped: bool) -> None:
    damping = Damping(law="dashpot", coefficient=1.0) if damped else None
    pull_off = tuple(0.1 + k for k in range(THREE.n_contact))
    glued = replace(THREE, exponent=2.5, damping=damping, adhesion=Adhesion(law="dmt", pull_off=pull_off))
    assert _back(glued) == glued
    text = str(db.export(glued, table="contacts", format="csv", with_run=False))
    assert "pull_off_dmt_N" in text
    # the planted fault: another pull-off force is another scene
    bodies = str(db.export(glued, table="bodies", format="csv"))
    other = scene_of_csv(bodies, file="b", contacts=text.replace("1.1", "1.2"), **_beside(glued))
    assert other.content_hash != glued.content_hash
    with pytest.raises(SceneError, match="column 'pull_off_dmt_N' repeats the quantity of another column"):
        scene_of_csv(bodies, file="b", contacts=text.replace("exponent", "pull_off_jkr_N", 1), **_beside(glued))


@pytest.mark.parametrize("scene", [CROSSED, RAW, replace(RAW, damping=None), THREE])
def test_tables_with_results_are_read_too(scene: Scene, tmp_path: Path) -> None:
    """And every column that an export has is known, so that none is taken for a mistake."""
    known = {*BODY, *CONTACT, *PLACE, *DERIVED}
    for table in ("bodies", "contacts"):
        more: dict[str, Any] = {"backend": "verlet", "dt": 1e-6, "samples": 10} if table == "contacts" else {}
        db.export(scene, table=table, path=tmp_path / f"{table}.csv", **more)
        assert {one.name for one in db.table_of(scene, table, **more).columns} <= known
    beside = _beside(scene)
    found = db.scene_from_csv(tmp_path / "bodies.csv", contacts=tmp_path / "contacts.csv", **beside)
    assert found == scene


def test_a_precompressed_chain_is_said_beside_its_tables() -> None:
    scene = load_scene("stacked-40")
    assert scene.precompression > 0.0
    assert _back(scene) == scene
    # another load has other overlaps
    beside = _beside(scene) | {"precompression": 2e-6}
    bodies = str(db.export(scene, table="bodies", format="csv"))
    contacts = str(db.export(scene, table="contacts", format="csv", with_run=False))
    with pytest.raises(SceneError, match="precompression = 2e-06, but contact 0 has a gap"):
        scene_of_csv(bodies, file="b.csv", contacts=contacts, **beside)


def test_one_table_has_a_row_per_body(tmp_path: Path) -> None:
    (tmp_path / "chain.csv").write_text(CHAIN, encoding="utf-8-sig")
    assert db.scene_from_csv(tmp_path / "chain.csv", duration=1e-4) == THREE
    walled = db.scene_from_csv(
        str(tmp_path / "chain.csv"),
        duration=1e-4,
        name="other",
        wall_right=Wall(stiffness=1e9),
        gravity=9.81,
        samples=7,
        damping=Damping(law="dashpot", coefficient=1.0),
    )
    assert walled == replace(
        THREE,
        name="other",
        wall_right=Wall(stiffness=1e9),
        gravity=9.81,
        samples=7,
        damping=Damping(law="dashpot", coefficient=1.0),
    )


def test_columns_that_are_not_there_have_their_usual_values() -> None:
    found = scene_of_csv("mass_kg,velocity_m_per_s,stiffness_SI\n1,2,3\n4,5,\n", file="a.csv", name="a", duration=1.0)
    assert found == Scene(name="a", duration=1.0, mass=(1, 4), velocity=(2, 5), stiffness=(3,))
    single = scene_of_csv("mass_kg,velocity_m_per_s,stiffness_SI\n1,2,\n", file="a.csv", name="a", duration=1.0)
    assert single.n_body == 1


def test_damping_has_a_column_with_the_unit_of_its_law() -> None:
    text = "mass_kg,velocity_m_per_s,stiffness_SI,{}\n1,2,3,0.5\n4,5,,\n"
    for heading, law in (("damping_N_s_per_m", "dashpot"), ("damping_s", "kuwabara-kono")):
        found = scene_of_csv(text.format(heading), file="a.csv", name="a", duration=1.0)
        assert found.damping == Damping(law=law, coefficient=(0.5,))
        # a wall beside is not damped: the table cannot say that it is
        more = scene_of_csv(text.format(heading), file="a.csv", name="a", duration=1.0, wall_left=Wall(stiffness=1.0))
        assert more.damping == Damping(law=law, coefficient=(0.5, 0.0))


WRONG = [
    # what is changed of CHAIN, and what is said
    ("8e-3", "x", "chain.csv, line 3: mass_kg = 'x'; allowed: a number"),
    ("8e-3", "-1", "chain.csv, line 3: mass_kg = -1.0; allowed: a number > 0 (kg)"),
    ("8e-3", "", "chain.csv, line 3: mass_kg is empty; allowed: a number"),
    ("-0.1", "nan", "chain.csv, line 7: velocity_m_per_s = nan; allowed: a finite number (m/s)"),
    ("5e6", "0", "chain.csv, line 4: stiffness_N_per_m^(n-1) = 0.0; allowed: a number > 0"),
    ("2.0, 1e-6", "1.0, 1e-6", "chain.csv, line 4: exponent = 1.0; allowed: n > 1"),
    ("1e-6", "inf", "chain.csv, line 4: gap_m = inf; allowed: a finite number (m)"),
    (
        "-0.1, ,",
        "-0.1, 1e9,",
        "line 7: stiffness_N_per_m^(n-1) = '1e9'; allowed: an empty cell, because no body follows",
    ),
    ("gap_m", "gap_mm", "chain.csv, line 2: column 'gap_mm' is unknown; allowed: body, mass_kg, velocity_m_per_s"),
    ("gap_m", "exponent", "column 'exponent' repeats the quantity of another column; allowed: one of"),
    (
        "mass_kg, ",
        "",
        "chain.csv, line 2: column 'mass_kg' is missing; allowed: a table with mass_kg, velocity_m_per_s",
    ),
    ("0.8, 4e9", "0.8", "chain.csv, line 3: the row has 4 cells; allowed: 5, one per column"),
    ("8e-3, 0.8", '"8e-3, 0.8', "the text is not CSV"),
    (
        CHAIN,
        "# nothing\n",
        "chain.csv: the table has no headings or no rows; allowed: a row of headings from body, mass_kg",
    ),
    (CHAIN, CHAIN.replace(",", ";"), "chain.csv, line 2: no heading between commas is known; allowed: body, mass_kg, "),
]


@pytest.mark.parametrize(("old", "new", "why"), WRONG, ids=[why[:50] for *_, why in WRONG])
def test_a_mistake_is_named_by_file_line_and_column(old: str, new: str, why: str) -> None:
    assert old in CHAIN
    with pytest.raises(SceneError) as caught:
        scene_of_csv(CHAIN.replace(old, new, 1), file="chain.csv", name="chain", duration=1e-4)
    assert why in str(caught.value)
    assert "\n" not in str(caught.value)


@examples(200)
@given(st.text(alphabet='0123456789e-+.,;"# \n\tmassnai', max_size=60), st.integers(0, len(CHAIN)))
def test_whatever_stands_in_a_csv_it_is_read_or_refused_in_one_line(text: str, place: int) -> None:
    said = "chain.csv"
    try:
        scene_of_csv(CHAIN[:place] + text + CHAIN[place:], file="chain.csv", name="chain", duration=1e-4)
    except SceneError as error:
        said = str(error)
    assert "\n" not in said
    assert said.startswith("chain.csv")


TABLES = {
    "bodies": "body,mass_kg,velocity_m_per_s\n0,1,2\n1,3,0\n",
    "contacts": "contact,where,stiffness_SI,gap_m\n0,chain,5,0\n1,wall_right,6,1e-3\n",
}


@pytest.mark.parametrize(
    ("table", "old", "new", "why"),
    [
        ("bodies", "\n1,3", "\n2,3", "b.csv, line 3: body = '2'; allowed: 1 (rows are in the order of the chain"),
        (
            "bodies",
            "\n1,3,0",
            "\n1,3,0\n2,1,1",
            "c.csv: the table has 1 contacts of the chain; allowed: 2 for the 3 bodies in b",
        ),
        (
            "contacts",
            "0,chain,5,0\n1,",
            "0,wall_right,5,0\n1,",
            "c.csv, line 2: where = 'wall_right'; allowed: rows with chain, then",
        ),
        ("contacts", "wall_right", "wall", "c.csv, line 3: where = 'wall'; allowed: rows with chain, then"),
        ("contacts", "wall_right,6", "wall_right,-6", "c.csv, line 3: stiffness_SI = -6.0; allowed: a number > 0"),
        ("contacts", ",gap_m", ",mass_kg", "c.csv, line 1: column 'mass_kg' is unknown; allowed: contact, where"),
        ("contacts", "wall_right,6,1e-3", "wall_right,6,", "c.csv, line 3: gap_m is empty; allowed: a number"),
    ],
)
def test_a_mistake_in_two_tables_is_named_by_its_own(table: str, old: str, new: str, why: str) -> None:
    assert old in TABLES[table]
    texts = TABLES | {table: TABLES[table].replace(old, new)}
    with pytest.raises(SceneError) as caught:
        scene_of_csv(
            texts["bodies"], file="b.csv", contacts=texts["contacts"], contacts_file="c.csv", name="a", duration=1.0
        )
    assert why in str(caught.value)


@pytest.mark.parametrize(
    ("beside", "why"),
    [
        (
            {"wall_right": Wall(stiffness=1.0)},
            "b.csv: wall_right is both in the table and an argument; allowed: one of the",
        ),
        ({"duration": -1.0}, "b.csv: duration = -1.0; allowed: a number > 0 (s)"),
        ({"gravity": "x"}, "b.csv: gravity = 'x'; allowed: a finite number"),
        ({"mass": (1, 2)}, "scene_from_csv has no keyword 'mass'; allowed: "),
        (
            {"contacts": "gone.csv"},
            "gone.csv: the file cannot be read (No such file or directory); allowed: a CSV file",
        ),
    ],
)
def test_what_stands_beside_the_tables_is_checked(beside: dict[str, Any], why: str, tmp_path: Path) -> None:
    for name, text in TABLES.items():
        (tmp_path / f"{name[0]}.csv").write_text(text)
    settings: dict[str, Any] = {"duration": 1.0, "contacts": tmp_path / "c.csv"} | beside
    with pytest.raises(DemBridgeError) as caught:
        db.scene_from_csv(tmp_path / "b.csv", **settings)
    assert why in str(caught.value)
    assert isinstance(caught.value, UsageError | SceneError)


@pytest.mark.parametrize("fault", [("1e-2", "1.0000001e-2"), ("4e9", "4.000001e9"), ("0.8", "0.8000001")])
def test_a_fault_in_a_table_changes_the_scene(fault: tuple[str, str]) -> None:
    found = scene_of_csv(CHAIN.replace(*fault, 1), file="chain.csv", name="chain", duration=1e-4)
    assert found.content_hash != THREE.content_hash
