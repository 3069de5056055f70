"""What is written reads back to the last bit, by us and by the readers of other programs."""

from __future__ import annotations

import json
import math
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import ase.io
import numpy as np
import pytest
import xarray as xr

import dem_bridge as db
from dem_bridge.errors import UsageError
from dem_bridge.formats.writers import NOMINAL_SPACING, centres, text_of
from dem_bridge.scene.scene import Scene
from tests.helpers.export_chains import CROSSED, PAIR, RAW
from tests.helpers.export_runs import NAMES, made_up
from tests.helpers.fake_runs import free_flight

PRESSED = replace(RAW, name="pressed", gap=0.0, precompression=20.0, velocity=(0.8, 0.0, 0.0, 0.0), wall_left=None,
                  damping=None)  # fmt: skip
ALONE = Scene(name="alone", duration=1e-3, mass=(1e-2,), stiffness=(), velocity=(0.5,))
SCENES = [CROSSED, RAW, PAIR, PRESSED, ALONE]
FORMATS = [("extxyz", {}), ("lammpstrj", {}), ("csv", {}), ("csv", {"layout": "wide"})]


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.name)
@pytest.mark.parametrize(("ending", "how"), FORMATS, ids=["extxyz", "lammpstrj", "csv", "csv wide"])
def test_samples_read_back_are_the_same_to_the_last_bit(
    scene: Scene, ending: str, how: dict[str, Any], tmp_path: Path
) -> None:
    run, path = made_up(scene), tmp_path / f"run.{ending}"
    db.write_trajectory(run, scene, path, **how)
    again = db.read_trajectory(path, scene)
    for name in NAMES:
        np.testing.assert_array_equal(getattr(again, name), getattr(run, name), err_msg=name, strict=True)
    assert again.provenance["scene_hash"] == scene.content_hash
    # what is not in the file is not made up
    assert np.all(np.isnan(again.crossing_time))
    assert again.uncertainty["velocity"] == math.inf


@pytest.mark.parametrize(("ending", "how"), FORMATS, ids=["extxyz", "lammpstrj", "csv", "csv wide"])
def test_forces_that_are_not_known_stay_so(ending: str, how: dict[str, Any], tmp_path: Path) -> None:
    run = made_up(CROSSED, forces=False)
    db.write_trajectory(run, CROSSED, tmp_path / f"run.{ending}", **how)
    again = db.read_trajectory(tmp_path / f"run.{ending}", CROSSED)
    assert np.all(np.isnan(again.contact_force))
    np.testing.assert_array_equal(again.velocity, run.velocity)


def test_netcdf_keeps_all_and_opens_in_xarray_with_dimensions_units_and_provenance(tmp_path: Path) -> None:
    run, path = made_up(RAW), tmp_path / "run.nc"
    db.write_trajectory(run, RAW, path)
    again = db.read_trajectory(path)
    for name in (*NAMES, "peak_force", "crossing_time"):
        np.testing.assert_array_equal(getattr(again, name), getattr(run, name))
    assert {key: again.provenance[key] for key in run.provenance} == dict(run.provenance)
    with xr.open_dataset(path) as opened:
        assert opened.velocity.dims == ("time", "body")
        assert opened.contact_force.dims == ("time", "contact")
        units = {"time": "s", "velocity": "m/s", "contact_force": "N", "peak_force_uncertainty": "N"}
        assert {name: opened[name].attrs["units"] for name in units} == units
        assert all(opened[name].attrs["long_name"] for name in opened.variables)
        assert opened.time.dtype == np.float64
        assert json.loads(opened.attrs["provenance"])["scene"] == "raw"
        np.testing.assert_array_equal(opened.velocity.sel(body=0), run.velocity[:, 0])


def test_what_was_read_from_others_can_be_kept_as_netcdf(tmp_path: Path) -> None:
    db.write_trajectory(made_up(PAIR), PAIR, tmp_path / "run.csv")
    read = db.read_trajectory(tmp_path / "run.csv", PAIR)
    read.save(tmp_path / "run.nc")
    again = db.load_trajectory(tmp_path / "run.nc")
    np.testing.assert_array_equal(again.velocity, read.velocity)
    assert math.isnan(again.cost.wall)
    with xr.open_dataset(tmp_path / "run.nc") as opened:
        strict = json.loads(opened.attrs["cost"], parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))
        assert strict["wall"] is None


def test_bodies_stand_in_their_physical_places() -> None:
    places, radii, physical = centres(CROSSED)
    assert physical
    np.testing.assert_allclose(places, [0.0, 18e-3, 36e-3, 54e-3], rtol=1e-15)
    np.testing.assert_array_equal(radii, [9e-3] * 4)


def test_without_a_geometry_they_stand_a_stated_spacing_and_their_gaps_apart() -> None:
    places, radii, physical = centres(RAW)
    assert not physical
    np.testing.assert_allclose(np.diff(places), np.array([0.0, 1e-7, 0.0]) + NOMINAL_SPACING, rtol=1e-14)
    np.testing.assert_array_equal(radii, 0.5 * NOMINAL_SPACING)
    assert centres(RAW, 0.5)[0][1] == 0.5
    # a precompressed chain overlaps from the start
    overlap = -PRESSED.contacts.gap[0]
    assert overlap > 0.0
    assert centres(PRESSED)[0][1] == NOMINAL_SPACING - overlap


@pytest.mark.parametrize(
    ("scene", "how", "found"),
    [
        (CROSSED, {"spacing": 0.1}, "the scene crossed_3 has a spacing; leave spacing out"),
        (RAW, {"spacing": -1.0}, "spacing = -1.0; allowed: a number above 0"),
        (RAW, {"layout": "wide"}, "layout = 'wide' with format 'extxyz'"),
        (PAIR, {}, "the run has 4 bodies and 5 contacts, the scene pair has 2 and 1"),
        (replace(RAW, duration=1.0), {}, "the run is of a scene with the hash"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(scene: Scene, how: dict[str, Any], found: str) -> None:
    run = made_up(CROSSED if scene is CROSSED else RAW)
    with pytest.raises(UsageError, match=found) as error:
        text_of(run, scene, "extxyz", **how)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("ending", "found"), [("pdb", "the file type is not clear from"), ("traj", "can be read, but not written")]
)
def test_a_format_that_is_not_written_is_refused(ending: str, found: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=found):
        db.write_trajectory(made_up(PAIR), PAIR, tmp_path / f"run.{ending}")


def test_a_scene_that_is_not_given_must_be_a_shipped_one(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="the scene 'raw', which is not a shipped scene"):
        db.write_trajectory(made_up(RAW), None, tmp_path / "run.csv")


def test_ase_reads_extended_xyz_to_the_last_bit(tmp_path: Path) -> None:
    run, path = made_up(CROSSED), tmp_path / "run.extxyz"
    db.write_trajectory(run, CROSSED, path)
    frames: Any = ase.io.read(path, index=":")
    assert [frame.info["Time"] for frame in frames] == run.time.tolist()
    x = np.array([frame.positions[:, 0] for frame in frames])
    np.testing.assert_array_equal(x, centres(CROSSED)[0] + run.displacement)
    np.testing.assert_array_equal([frame.arrays["velo"][:, 0] for frame in frames], run.velocity)
    chain = np.pad(run.contact_force, ((0, 0), (1, 1)))
    net = chain[:, :-1] - chain[:, 1:]
    np.testing.assert_array_equal([frame.get_forces()[:, 0] for frame in frames], net)
    assert not frames[0].pbc.any()
    np.testing.assert_array_equal(frames[0].arrays["mass"], CROSSED.mass)
    # 8 decimals, which ASE's own writer keeps, are not enough
    ase.io.write(tmp_path / "ase.extxyz", frames)
    short = np.array([frame.positions[:, 0] for frame in ase.io.read(tmp_path / "ase.extxyz", index=":")])
    assert 1e-9 < np.max(np.abs(short - x)) <= 5.001e-9


def test_ase_reads_dumps(tmp_path: Path) -> None:
    run, path = made_up(CROSSED), tmp_path / "run.lammpstrj"
    db.write_trajectory(run, CROSSED, path)
    frames = ase.io.read(path, index=":", format="lammps-dump-text", units="si")
    assert len(frames) == len(run.time)
    # ASE converts to its own units: a product rounded, and half an ulp of it
    x = 1e-10 * np.array([frame.positions[:, 0] for frame in frames])
    np.testing.assert_allclose(x, centres(CROSSED)[0] + run.displacement, rtol=4e-16 * 4, atol=0.0)


@pytest.mark.parametrize("ending", ["extxyz", "lammpstrj"])
def test_ovito_reads(ending: str, tmp_path: Path) -> None:
    pytest.importorskip("ovito")
    from ovito.io import import_file  # type: ignore[import-not-found, unused-ignore]

    run, path = made_up(CROSSED), tmp_path / f"run.{ending}"
    db.write_trajectory(run, CROSSED, path)
    pipeline = import_file(str(path))
    assert pipeline.source.num_frames == len(run.time)
    found = pipeline.compute(5)
    assert found.attributes["Time"] == run.time[5]
    # its own conversion of digits is off by an ulp at most
    x = centres(CROSSED)[0] + run.displacement[5]
    np.testing.assert_array_max_ulp(found.particles.positions[:, 0], x, 1)
    np.testing.assert_array_max_ulp(np.asarray(found.particles["Velocity"])[:, 0], run.velocity[5], 1)
    np.testing.assert_allclose(found.particles["Radius"], 9e-3, rtol=2.0**-23)  # in single precision there
    np.testing.assert_allclose(found.particles["Mass"], CROSSED.mass, rtol=1e-15)


@pytest.mark.filterwarnings("default")  # of MDAnalysis' own, about masses that it guesses by element
def test_mdanalysis_reads_extended_xyz(tmp_path: Path) -> None:
    mda = pytest.importorskip("MDAnalysis")
    run, path = made_up(CROSSED), tmp_path / "run.xyz"
    db.write_trajectory(run, CROSSED, path)
    universe = mda.Universe(str(path), topology_format="XYZ", format="XYZ")
    with closing(universe.trajectory):  # else its file stays open until the end
        assert len(universe.trajectory) == len(run.time)
        universe.trajectory[5]
        # it keeps single precision
        x = centres(CROSSED)[0] + run.displacement[5]
        np.testing.assert_allclose(universe.atoms.positions[:, 0], x, rtol=2.0**-23, atol=1e-30)


def test_each_layout_of_csv_has_its_own_headings_and_numbers() -> None:
    run = free_flight(bodies=2, contacts=1, samples=2, contact_force=np.array([[0.0], [5.0], [7.0]]))
    scene = Scene(name="two", duration=1.0, mass=(1.0, 2.0), stiffness=(1.0,), velocity=(1.0, 2.0))
    long, wide = (text_of(run, scene, "csv", layout=layout).splitlines() for layout in ("long", "wide"))
    assert long[0] == "time_s,body,x_m,displacement_m,velocity_m_per_s,force_left_N,force_right_N"
    # bodies stand 10 mm apart, and the contact presses the first to the left and the second to the right
    rows = [[float(cell) for cell in row.split(",")] for row in long[1:]]
    assert rows[2:4] == [[0.5, 0.0, 0.5, 0.5, 1.0, 0.0, 5.0], [0.5, 1.0, 1.01, 1.0, 2.0, 5.0, 0.0]]
    assert len(rows) == 6
    names = ["displacement_0_m", "displacement_1_m", "velocity_0_m_per_s", "velocity_1_m_per_s", "contact_force_0_N"]
    assert wide[0].split(",") == ["time_s", *names]
    assert [[float(cell) for cell in row.split(",")] for row in wide[1:]] == [
        [0.0, 0.0, 0.0, 1.0, 2.0, 0.0],
        [0.5, 0.5, 1.0, 1.0, 2.0, 5.0],
        [1.0, 1.0, 2.0, 1.0, 2.0, 7.0],
    ]


def test_a_dump_has_net_forces_and_a_box_that_contains_all_motion() -> None:
    run = free_flight(bodies=2, contacts=1, samples=1, contact_force=np.array([[0.0], [5.0]]))
    scene = Scene(name="two", duration=1.0, mass=(1.0, 2.0), stiffness=(1.0,), velocity=(1.0, 2.0), spacing=0.02)
    dump = text_of(run, scene, "lammpstrj").splitlines()
    low, high = (
        float(number) for number in dump[dump.index(next(line for line in dump if "BOX" in line)) + 1].split()[:2]
    )
    # from two radii left of the first body to two right of where the last one could fly from its place
    assert (low, high) == (pytest.approx(-0.02), pytest.approx(0.02 + 2.0 + 0.02))
    columns = next(line for line in dump if line.startswith("ITEM: ATOMS")).split()[2:]
    last = [dict(zip(columns, row.split(), strict=True)) for row in dump[-2:]]
    assert [float(row["fx"]) for row in last] == [-5.0, 5.0]
    assert [float(row["vx"]) for row in last] == [1.0, 2.0]
    assert [float(row["radius"]) for row in last] == [0.01, 0.01]
    assert [float(row["mass"]) for row in last] == [1.0, 2.0]
    assert [row["id"] for row in last] == ["1", "2"]
