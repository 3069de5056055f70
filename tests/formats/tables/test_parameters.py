"""Contacts, bodies and coefficients are what geometry, theory, the deck and the run say, each from another source."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import dem_bridge as db
from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.lammps import LammpsGranular
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.formats.tables.parameters import NOTES, contacts
from dem_bridge.formats.tables.render import as_markdown, as_tex
from dem_bridge.formats.tables.table import Table
from dem_bridge.lmp.process import run_deck
from dem_bridge.physics.hertz import crossed_cylinders
from dem_bridge.scene.geometry import Body, Geometry
from dem_bridge.scene.scene import Scene, Wall
from tests.conftest import Solve
from tests.helpers.deck_reader import read_deck
from tests.helpers.export_chains import CROSSED, CYLINDER, PAIR, QUARTZ, RAW, SPHERE, STEEL
from tests.helpers.foreign_readers import read_markdown, read_tex


def _contacts(scene: Scene | str, **settings: Any) -> tuple[Table, pd.DataFrame]:
    table = db.table_of(scene, "contacts", **settings)
    return table, table.to_pandas()


def _deck_lines(scene: Scene, **form: Any) -> list[str]:
    deck = LammpsGranular().deck(scene, Resolution(dt=1e-7, **form), Sampling(count=scene.samples))
    return deck.files[deck.input_file].splitlines()


def test_the_papers_stiffnesses_are_those_of_the_notes_on_its_physics() -> None:
    """Angle 2 degrees between cylinders 1 and 2: eq. 3.1 to 12 digits, the exact one and their ratio."""
    table, frame = _contacts("decelerating-40", with_run=False)
    row = frame.iloc[1]
    assert row["angle_deg"] == pytest.approx(2.0, rel=1e-12)  # found from the stiffness, to what that promises
    # 12 digits are printed
    assert row["stiffness_paper_N_per_m1_5"] == pytest.approx(7.27299328384e10, rel=5e-12)
    assert row["stiffness_exact_N_per_m1_5"] == pytest.approx(6.17559e10, rel=5e-6)
    assert row["paper_over_exact"] == pytest.approx(1.1777, abs=5e-5)
    assert frame["stiffness_paper_N_per_m1_5"].iloc[-1] == pytest.approx(4.689197642511e9, rel=5e-12)
    assert math.isnan(frame["angle_deg"][0]), "a sphere has no angle"
    assert frame["peak_force_N"].isna().all()
    assert "without a run, peak forces, peak overlaps, contact ellipses and pressures are unknown" in table.notes


def test_binary_collisions_are_those_of_two_bodies() -> None:
    """The striker on one cylinder at 0.8 m/s: half of its contact time, and its force, as known to 13 digits."""
    row = _contacts("decelerating-40", with_run=False)[1].iloc[0]
    # the scene's mass is rounded to 12 digits, by 4.4e-12 of itself
    assert row["residence_bca_s"] == pytest.approx(0.5 * 5.596816463565898e-05, rel=4.4e-12)
    assert row["peak_force_bca_N"] == pytest.approx(236.1474973592, rel=4.4e-12)


def test_binary_collisions_are_the_backends_own() -> None:
    frame = _contacts(CROSSED, with_run=False)[1]
    long = db.solve(replace(CROSSED, duration=1.0), backend="bca")
    # a difference of arrivals loses what the last of them is longer than the shortest residence, a few times
    np.testing.assert_allclose(frame["residence_bca_s"], np.diff(long.crossing_time, prepend=0.0), rtol=1e-14)
    np.testing.assert_array_equal(frame["peak_force_bca_N"], long.peak_force)


def test_what_is_found_is_the_runs_and_the_survey_is_near(solved: Solve) -> None:
    table, frame = _contacts(CROSSED)
    run = solved(CROSSED, "reference")
    np.testing.assert_array_equal(frame["peak_force_N"], run.peak_force)
    np.testing.assert_array_equal(frame["peak_force_uncertainty_N"], run.uncertainty["peak_force"])
    overlap = frame["peak_overlap_m"]
    # a root and a power and back: some ulp
    beta = np.array(CROSSED.stiffness)
    np.testing.assert_allclose(beta * overlap**1.5, run.peak_force, rtol=1e-14)
    upper = beta * (overlap + frame["peak_overlap_uncertainty_m"]) ** 1.5
    assert np.all(upper >= run.peak_force + run.uncertainty["peak_force"] * (1.0 - 1e-2)), "bars hold upwards too"
    # "good to about a per cent": what the survey promises
    np.testing.assert_allclose(frame["peak_overlap_prescan_m"], overlap, rtol=0.02)
    np.testing.assert_allclose(frame["peak_force_prescan_N"], run.peak_force, rtol=0.03)
    assert table.provenance["backend"] == "reference"


def test_another_backend_and_its_step_are_the_runs(solved: Solve) -> None:
    table, frame = _contacts(CROSSED, backend="verlet", dt=1e-7)
    run = solved(CROSSED, "verlet", dt=1e-7)
    np.testing.assert_array_equal(frame["peak_force_N"], run.peak_force)
    assert table.provenance["backend"] == "verlet"
    assert table.provenance["settings"]["dt"] == run.provenance["settings"]["dt"]


def test_ellipses_bear_the_peak_force() -> None:
    """The force is the integral of the pressure over the ellipse: 2/3 of pi a b p_0; circles at 90 degrees."""
    frame = _contacts(CROSSED)[1]
    area = math.pi * frame["semi_major_m"] * frame["semi_minor_m"]
    np.testing.assert_allclose(2.0 / 3.0 * area * frame["peak_pressure_Pa"], frame["peak_force_N"], rtol=1e-13)
    assert (frame["semi_major_m"] / frame["semi_minor_m"]).tolist()[2] == 1.0
    assert frame["semi_major_m"][1] > 2.0 * frame["semi_minor_m"][1], "at 20 degrees an ellipse is long"


def test_a_contact_of_two_materials_has_the_modulus_of_both() -> None:
    steel = Body(shape="cylinder", radius=9e-3, height=18e-3, material=STEEL)
    geometry = Geometry(bodies=(SPHERE, steel, CYLINDER, SPHERE), angles=(None, 30.0, None))
    modulus = 1.0 / ((1.0 - 0.17**2) / 72e9 + (1.0 - 0.3**2) / 200e9)
    assert geometry.contact(0).modulus == pytest.approx(modulus, rel=1e-15)
    assert geometry.contact(1).modulus == pytest.approx(modulus, rel=1e-15)
    alike = crossed_cylinders(angle=30.0, radius=9e-3, **QUARTZ.elastic)
    # stiffness goes with the modulus alone
    assert geometry.contact(1).stiffness / alike.stiffness == pytest.approx(modulus / alike.modulus, rel=1e-14)
    # whichever stands first
    assert geometry.contact(2).stiffness == Geometry(bodies=(SPHERE, CYLINDER)).contact(0).stiffness


def test_without_geometry_what_is_unknown_is_empty_and_said_once() -> None:
    table, frame = _contacts(RAW)
    for name in ("angle_deg", "stiffness_paper_N_per_m1_5", "stiffness_exact_N_per_m1_5", "semi_major_m"):
        assert frame[name].isna().all()
    assert sum("the scene has no geometry" in note for note in table.notes) == 1
    assert len(set(table.notes)) == len(table.notes)
    bodies = db.table_of(RAW, "bodies")
    assert bodies.to_pandas()["shape"].isna().all()
    assert sum("the scene has no geometry" in note for note in bodies.notes) == 1


def test_damped_contacts_between_walls_have_forces_and_no_overlaps_of_them() -> None:
    table, frame = _contacts(RAW)
    assert frame["where"].tolist() == ["chain", "chain", "chain", "wall_left", "wall_right"]
    assert frame["peak_force_N"].notna().all()
    assert frame["peak_overlap_m"].isna().all()
    assert frame["residence_bca_s"].isna().all()
    assert (
        sum(
            "peak overlaps are empty: they follow from peak forces only for elastic power laws" in note
            for note in table.notes
        )
        == 1
    )
    assert sum("the scene has walls, gaps and dashpot damping;" in note for note in table.notes) == 1


@pytest.mark.parametrize(
    ("scene", "form"),
    [(CROSSED, {}), (RAW, {}), (RAW, {"types": "per-body"}), (PAIR, {"surrogate_radius": 1e-3})],
    ids=["crossed", "raw", "per body", "own radius"],
)
def test_what_lammps_is_told_is_what_its_deck_says(scene: Scene, form: dict[str, Any], tmp_path: Path) -> None:
    """Read by the independent reader of decks."""
    deck = LammpsGranular().deck(scene, Resolution(dt=1e-7, **form), Sampling(count=scene.samples))
    for file, text in deck.files.items():
        (tmp_path / file).write_text(text)
    read = read_deck(tmp_path, deck.name)
    frame = _contacts(scene, with_run=False, **form)[1]
    left = int(scene.wall_left is not None)
    for k in range(scene.n_contact):
        row, one, other = frame.iloc[k], int(scene.contacts.left[k]), int(scene.contacts.right[k])
        if row["where"] == "wall_left":
            one = -1
        kinds = [
            read.atoms[left + one].kind,
            read.atoms[left + (other if row["where"] != "wall_right" else one + 1)].kind,
        ]
        assert [row["type_left"], row["type_right"]] == kinds
        told = [line for line in _deck_lines(scene, **form) if line.split()[:1] == ["pair_coeff"]]
        [line] = [one for one in told if one.split()[1:3] == [str(min(kinds)), str(max(kinds))]]
        assert (row["lammps_model"], row["lammps_k_n_SI"]) == (line.split()[3], float(line.split()[4]))
        assert 2.0 * row["surrogate_radius_m"] == read.atoms[0].diameter
    bodies = db.table_of(scene, "bodies", **form).to_pandas()
    for i in range(scene.n_body):
        atom = read.atoms[left + i]
        assert (bodies["atom_id"][i], bodies["atom_type"][i]) == (atom.number, atom.kind)


def test_a_law_that_granular_has_not_leaves_k_n_empty_with_the_reason() -> None:
    table, frame = _contacts(replace(PAIR, exponent=3.0), with_run=False)
    assert frame["lammps_k_n_SI"].isna().all()
    assert any("contact 0 has exponent n = 3.0; allowed exponents: 2 and 2.5" in note for note in table.notes)
    with pytest.raises(
        UnsupportedScene, match=r"^pair has no pair coefficients for pair_style granular: contact 0 has exponent n = 3"
    ):
        db.table_of(replace(PAIR, exponent=3.0), "pair-coeffs")


def test_a_law_of_its_own_has_forces_by_the_law() -> None:
    scene = replace(PAIR, law=_stiffer)
    table, frame = _contacts(scene)
    assert frame["peak_overlap_m"].isna().all()
    np.testing.assert_allclose(frame["peak_force_prescan_N"], frame["peak_force_N"], rtol=0.03)
    assert any("the scene has contact laws given as functions" in note for note in table.notes)


def _stiffer(overlap: np.ndarray) -> np.ndarray:
    return np.asarray(4e9 * overlap**1.5 + 2e6 * overlap)


def test_bodies_are_those_of_the_scene() -> None:
    table = db.table_of(CROSSED, "bodies")
    frame = table.to_pandas()
    assert frame["mass_kg"].tolist() == list(CROSSED.mass)
    assert frame["shape"].tolist() == ["sphere", "cylinder", "cylinder", "cylinder"]
    assert frame["material"].tolist() == ["quartz & 100%_pure"] * 4
    assert frame["radius_m"].tolist() == [9e-3] * 4
    assert math.isnan(frame["height_m"][0])
    assert frame["height_m"][1] == 18e-3
    # 2200 kg/m^3 times the volume of a sphere of 9 mm
    assert frame["mass_by_density_kg"][0] == pytest.approx(6.718e-3, rel=1e-4)
    assert any("density times volume differs for a body whose mass was set" in note for note in table.notes)
    own = replace(CROSSED, mass=tuple(body.mass for body in (SPHERE, CYLINDER, CYLINDER, CYLINDER)))
    assert db.table_of(own, "bodies").notes == ()


@pytest.mark.parametrize("scene", [CROSSED, RAW, PAIR, db.load_scene("decelerating-40")], ids=lambda scene: scene.name)
def test_the_include_file_is_the_decks_own_lines(scene: Scene) -> None:
    include = str(db.export(scene, table="pair-coeffs", format="lammps")).splitlines()
    own = [line for line in _deck_lines(scene) if line.startswith("pair_")]
    assert [line for line in include if not line.startswith("#")] == own
    said = " ".join(line.strip("# ") for line in include if re.match(r"#   [\d ]+$", line))
    frame = db.table_of(scene, "bodies").to_pandas()
    walls = int(scene.wall_left is not None), int(scene.wall_right is not None)
    types = [int(word) for word in said.split()]
    assert types[walls[0] : len(types) - walls[1]] == frame["atom_type"].tolist()


@pytest.mark.lammps
def test_lammps_reads_the_include_file_and_runs_the_same_bit_for_bit(tmp_path: Path) -> None:
    deck = LammpsGranular().deck(RAW, Resolution(dt=1e-7), Sampling(count=10))
    include = db.export(RAW, table="pair-coeffs", path=tmp_path / "coefficients.lmp")
    assert isinstance(include, str)
    lines = deck.files[deck.input_file].splitlines()
    own = [nth for nth, line in enumerate(lines) if line.startswith("pair_")]
    assert own == list(range(own[0], own[-1] + 1)), "one block"
    lines[own[0] : own[-1] + 1] = ["include coefficients.lmp"]
    hertz = re.search(r"hertz (\d+\.\d+)", include.split("pair_coeff      1 1")[1])
    assert hertz is not None
    fault = include.replace(hertz[1], repr(math.nextafter(float(hertz[1]), math.inf)))
    dumps = {}
    for name, main, text in (
        ("deck", deck.files[deck.input_file], ""),
        ("include", "\n".join(lines) + "\n", include),
        ("fault", "\n".join(lines) + "\n", fault),
    ):
        folder = tmp_path / name
        folder.mkdir()
        for file, content in {**deck.files, deck.input_file: main, "coefficients.lmp": text}.items():
            (folder / file).write_text(content, encoding="utf-8")
        run_deck(folder, deck.input_file, time_limit=60.0)
        dumps[name] = (folder / deck.dump_file).read_bytes()
    assert dumps["include"] == dumps["deck"]
    assert dumps["fault"] != dumps["deck"], "an ulp of one coefficient shows"


def test_a_radius_below_the_overlap_is_refused() -> None:
    with pytest.raises(UsageError, match=r"^surrogate_radius = 1e-06 m; allowed: more than the largest overlap, 1\."):
        db.table_of(PAIR, "pair-coeffs", surrogate_radius=1e-6)


@pytest.mark.parametrize("table", ["contacts", "pair-coeffs"])
def test_a_radius_of_the_largest_overlap_is_refused_and_the_next_larger_is_not(table: str) -> None:
    overlaps = _contacts(CROSSED, with_run=False)[1]["peak_overlap_prescan_m"]
    largest = float(np.max(overlaps))
    assert largest > float(np.min(overlaps))
    with pytest.raises(UsageError, match=f"^surrogate_radius = {largest:g} m; allowed: more than the largest overlap"):
        db.table_of(CROSSED, table, with_run=False, surrogate_radius=largest)
    above = math.nextafter(largest, 1.0)
    assert db.table_of(CROSSED, table, with_run=False, surrogate_radius=above).rows


def test_tables_refuse_what_they_are_not_asked(tmp_path: Path) -> None:
    with pytest.raises(
        UsageError, match=r"^table = 'balls' is unknown; allowed: contacts, pair-coeffs, bodies, observables, "
    ):
        db.table_of(PAIR, "balls")
    with pytest.raises(UsageError, match=r"^table 'bodies' without a run has no setting 'dt'; allowed: geometry,"):
        db.table_of(PAIR, "bodies", dt=1e-7)
    with pytest.raises(
        UsageError, match=r"^table 'observables' consists of results of a run; leave out with_run=False"
    ):
        db.table_of(PAIR, "observables", with_run=False)
    with pytest.raises(UsageError, match=r"^setting 'tolerance' is unknown; allowed: backend, dt"):
        db.table_of(PAIR, "contacts", tolerance=1.0)
    with pytest.raises(UsageError, match=r"the folder .* is missing or not writable"):
        db.export(PAIR, table="bodies", path=tmp_path / "no" / "bodies.csv")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "unknown"),
    [
        ("stacked-40", {"residence_bca_s"}),
        ("decelerating-40-graded-exponent", {"lammps_k_n_SI"}),
        ("decelerating-40-kuwabara-kono", {"residence_bca_s"}),
        ("tapered-forward", {"angle_deg"}),
    ],
)
def test_shipped_scenes_have_what_they_can_have_and_print_well(name: str, unknown: set[str]) -> None:
    table, frame = _contacts(name, with_run=False)
    for column in ("angle_deg", "stiffness_exact_N_per_m1_5", "lammps_k_n_SI", "residence_bca_s"):
        assert frame[column].isna().all() == (column in unknown), column
    assert len(read_tex(as_tex(table)).rows) == len(read_markdown(as_markdown(table))[1]) == len(frame)
    assert not any("\n" in note for note in table.notes)


def test_a_body_alone_has_tables_without_rows() -> None:
    alone = Scene(name="alone", duration=1e-3, mass=(1.0,), stiffness=(), velocity=(1.0,))
    for name in ("contacts", "pair-coeffs"):
        assert db.table_of(alone, name).rows == []
    for name in ("bodies", "observables"):
        assert len(db.table_of(alone, name).rows) == 1


def test_ellipses_are_those_of_hertzian_contacts_and_the_reason_is_given_for_others(solved: Solve) -> None:
    soft = replace(
        CROSSED, name="mixed", exponent=(2.5, 2.2, 2.5), stiffness=(*CROSSED.stiffness[:1], 3e8, *CROSSED.stiffness[2:])
    )
    table, frame = _contacts(soft)
    assert frame["semi_major_m"].isna().tolist() == [False, True, False]
    reason = [note for note in table.notes if note not in _contacts(CROSSED)[0].notes and "Hertz" in note]
    assert len(reason) == 1
    assert _contacts(CROSSED)[1]["semi_major_m"].notna().all()
    # overlaps by the power law of each contact
    overlap = (frame["peak_force_N"] / np.array(soft.stiffness)) ** (1.0 / (np.array([2.5, 2.2, 2.5]) - 1.0))
    np.testing.assert_allclose(frame["peak_overlap_m"], overlap, rtol=1e-12)


def test_the_stiffness_in_a_deck_has_the_unit_of_its_models() -> None:
    units = {
        scene.name: [
            column.unit for column in _contacts(scene, with_run=False)[0].columns if column.heading == "LAMMPS k_n"
        ]
        for scene in (PAIR, replace(PAIR, name="linear", exponent=2.0), RAW)
    }
    assert units == {"pair": ["N/m^2"], "linear": ["N/m"], "raw": ["N/m^2 or N/m"]}


def test_notes_on_spheres_and_walls_belong_to_scenes_that_have_them() -> None:
    cylinders = replace(
        CROSSED,
        name="cylinders",
        exponent=2.5,
        gap=0.0,
        mass=CROSSED.mass[1:],
        stiffness=CROSSED.stiffness[1:],
        velocity=(0.8, 0.0, 0.0),
        geometry=Geometry(bodies=(CYLINDER,) * 3, angles=(20.0, 90.0)),
    )
    walled = replace(cylinders, name="walled", wall_right=Wall(stiffness=4e9))
    notes = {scene.name: _contacts(scene, with_run=False)[0].notes for scene in (CROSSED, cylinders, walled)}
    assert [NOTES["spheres"] in notes[name] for name in ("crossed_3", "cylinders", "walled")] == [True, False, False]
    assert [NOTES["walls"] in notes[name] for name in ("crossed_3", "cylinders", "walled")] == [False, False, True]


def test_contacts_below_one_newton_have_overlaps_and_those_without_a_force_no_ellipse(solved: Solve) -> None:
    force, uncertainty = np.array([100.0, 0.5, 0.0]), np.array([1.0, 0.7, 0.0])
    run = solved(CROSSED, "reference")
    run = replace(run, peak_force=force, uncertainty=replace(run.uncertainty, peak_force=uncertainty))
    frame = contacts(CROSSED, run).to_pandas()
    beta = np.array(CROSSED.stiffness)
    np.testing.assert_allclose(frame["peak_overlap_m"], (force / beta) ** (2.0 / 3.0), rtol=1e-12)
    # down to the least force, which is not below zero
    least = (np.array([99.0, 0.0, 0.0]) / beta) ** (2.0 / 3.0)
    off = (force / beta) ** (2.0 / 3.0) - least
    np.testing.assert_allclose(frame["peak_overlap_uncertainty_m"], off, rtol=1e-9)
    assert frame["semi_major_m"].isna().tolist() == [False, False, True]
    assert frame["peak_pressure_Pa"][1] > 0.0


def test_a_mass_is_that_of_density_and_volume_to_1e_9() -> None:
    own = [body.mass for body in (SPHERE, CYLINDER, CYLINDER, CYLINDER)]
    for part, said in ((0.5e-9, False), (1.5e-9, True)):
        scene = replace(CROSSED, mass=(own[0] * (1.0 + part), *own[1:]))
        assert (NOTES["own_mass"] in db.table_of(scene, "bodies").notes) == said


@pytest.mark.parametrize(
    ("count", "said"), [(2, "contact 0"), (3, "contact 0 and 1 more"), (4, "contact 0 and 2 more")]
)
def test_pairs_of_types_in_several_contacts_say_how_many(count: int, said: str) -> None:
    velocity = (0.8, *(0.0,) * (count - 1))
    alike = Scene(name="a", duration=1e-4, mass=(1e-2,) * count, stiffness=(4e9,) * (count - 1), velocity=velocity)
    include = str(db.export(alike, table="pair-coeffs", format="lammps"))
    assert [line.split("  # ")[1].split(":")[0] for line in include.splitlines() if "  # " in line] == [said]
