"""Runs of others: read with what is known, refused by name where something is wrong."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import ase
import ase.io
import numpy as np
import pytest
import xarray as xr
from ase.calculators.singlepoint import SinglePointCalculator

import dem_bridge as db
from dem_bridge.errors import UsageError
from dem_bridge.formats.readers.rounding import rounding_error
from dem_bridge.formats.units import STYLES as UNITS
from dem_bridge.lmp.process import run_deck
from dem_bridge.scene.drive import Drive
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory
from tests.helpers.export_chains import CROSSED, PAIR, RAW
from tests.helpers.export_runs import foreign_dump, made_up

STACKED = replace(RAW, name="stacked", gravity=9.81, wall_left=None, damping=None)
PRESSED = replace(STACKED, name="pressed", gap=0.0, gravity=0.0, precompression=20.0)
DRIVEN = replace(PRESSED, name="driven", drive=Drive(shape="sine", force=50.0, frequency=5e3))
EPS = float(np.finfo(float).eps)


def _written(tmp_path: Path, text: str, name: str = "theirs.lammpstrj") -> Path:
    (tmp_path / name).write_text(text)
    return tmp_path / name


@pytest.mark.parametrize("walls", [False, True], ids=["bodies alone", "walls too"])
@pytest.mark.parametrize(
    "scene",
    [CROSSED, STACKED, PRESSED, DRIVEN, replace(RAW, wall_right=None, damping=None), RAW],
    ids=lambda one: one.name,
)
def test_a_dump_of_others_has_velocities_displacements_and_what_forces_follow(
    scene: Scene, walls: bool, tmp_path: Path
) -> None:
    run = made_up(scene)
    found = db.read_trajectory(_written(tmp_path, foreign_dump(scene, run, walls=walls)), scene)
    np.testing.assert_array_equal(found.time, run.time)
    np.testing.assert_array_equal(found.velocity, run.velocity)
    # positions are rounded as doubles of their size are, at both ends of the difference
    assert np.max(np.abs(found.displacement - run.displacement)) <= 2 * EPS * 0.08
    if scene is RAW and not walls:  # between two walls the sum has no beginning
        assert np.all(np.isnan(found.contact_force))
    else:
        # a running sum of a few net forces of up to 2e3 N, twice as many roundings
        assert np.max(np.abs(found.contact_force - run.contact_force)) <= 10 * EPS * 2e3
    assert len(found.provenance["file"]["sha256"]) == 64
    assert any("first frame" in one for one in found.provenance["assumed"])


def test_with_drag_forces_do_not_follow(tmp_path: Path) -> None:
    scene = replace(CROSSED, drag=10.0)
    found = db.read_trajectory(_written(tmp_path, foreign_dump(scene, made_up(scene))), scene)
    assert np.all(np.isnan(found.contact_force))
    assert "contact forces are unknown" in found.provenance["assumed"]


def _swapped(text: str) -> str:
    """Atoms 2 and 3 under each other's ids."""
    return re.sub(r"(?m)^([23]) 1 ", lambda found: f"{5 - int(found[1])} 1 ", text)


def _swapped_once(text: str) -> str:
    frames = text.split("ITEM: TIME\n")
    frames[5] = _swapped(frames[5])
    return "ITEM: TIME\n".join(frames)


def _without(nth: int) -> Callable[[str], str]:
    def cut(text: str) -> str:
        frames = text.split("ITEM: TIME\n")
        return "ITEM: TIME\n".join([*frames[:nth], *frames[nth + 1 :]])

    return cut


def _lost_atom(text: str) -> str:
    head, last = text.rsplit("ITEM: TIME\n", 1)
    lines = [line for line in last.replace("ATOMS\n4", "ATOMS\n3").splitlines() if not line.startswith("3 1 ")]
    return head + "ITEM: TIME\n" + "\n".join(lines) + "\n"


def _faster(text: str) -> str:
    """Velocities in mm/s."""
    return re.sub(r"(?m)^(\d 1 \S+ 0 0) (\S+) ", lambda found: f"{found[1]} {1e3 * float(found[2]):.17g} ", text)


@pytest.mark.parametrize(
    ("fault", "found"),
    [
        (_swapped, "in frame 0 atom 2 is at 0.036 and atom 3 at 0.018; allowed: positions that increase with the id"),
        (_swapped_once, "in frame 4 atom 2 is at"),
        (_without(6), r"frame 4 is at .* and the next frame at .* 2 times the usual interval, so a frame is missing"),
        (_without(1), "the file begins at 1.66667e-05 s; allowed: the start of the scene, 0 s"),
        (_lost_atom, r"frame 12 \(step 1200\) has 3 atoms, the first frame has 4: atom 3 is missing"),
        (_faster, r"body 0 starts at 800 m/s, in the scene crossed_3 at 0.8 m/s \(the ratio is 1000\); .*units"),
        (lambda text: text.replace("\nsi\n", "\nlj\n"), "units 'lj', whose SI values are unknown; allowed: si, cgs"),
        (lambda text: text.replace("\nsi\n", "\nmetal\n"), "body 0 starts at 80 m/s"),
        (lambda text: text[: len(text) - 60], "frame 12.* is incomplete"),
        (lambda text: text.replace("ITEM: ATOMS id", "ITEM: ATOMS mol"), "has no column id"),
        (lambda text: text.replace("x y z", "xs ys zs"), "has no column x; allowed: x or xu, not the scaled xs"),
        (lambda text: text.replace("\n3 1 ", "\n2 1 "), "frame 0 .*has atom 2 twice"),
        (lambda text: re.sub(r"(?m)^3 1 \S+", "3 1 nan", text), "frame 0 has positions that are not finite"),
        (lambda text: re.sub(r"(?m)^(4 1 \S+) 0 0 (0\.\d{4,}|1\.\d+)", r"\1 1e-3 0 \2", text), "across the chain"),
        (lambda text: re.sub(r"ITEM: TIME\n.*\n", "", text), "no times; give the time step in seconds"),
        (lambda _: "", "the file is empty; allowed: a file with at least one frame"),
    ],
    ids=["swapped", "swapped once", "lost frame", "no start", "lost atom", "mm/s", "lj", "metal", "cut", "no id",
         "scaled", "twice", "nan", "across", "no time", "empty"],
)  # fmt: skip
def test_a_planted_fault_is_named_in_one_line(fault: Callable[[str], str], found: str, tmp_path: Path) -> None:
    text = foreign_dump(CROSSED, made_up(CROSSED))
    db.read_trajectory(_written(tmp_path, text), CROSSED)
    broken = fault(text)
    assert broken != text
    with pytest.raises(UsageError, match=found) as error:
        db.read_trajectory(_written(tmp_path, broken), CROSSED)
    assert "\n" not in str(error.value)


def test_a_file_that_ends_early_says_so(tmp_path: Path) -> None:
    text = foreign_dump(CROSSED, made_up(CROSSED))
    whole, short = (
        db.read_trajectory(_written(tmp_path, one), CROSSED).provenance["assumed"] for one in (text, _without(13)(text))
    )
    assert "the file ends at 0.000183333 s, the scene at 0.0002 s" in short
    assert not any("ends at" in one for one in whole)


def test_another_number_of_bodies_is_refused(tmp_path: Path) -> None:
    path = _written(tmp_path, foreign_dump(CROSSED, made_up(CROSSED)))
    with pytest.raises(UsageError, match="the file has 4 atoms per frame, the scene pair has 2 bodies; give the scene"):
        db.read_trajectory(path, PAIR)


def test_masses_of_another_scene_are_refused(tmp_path: Path) -> None:
    db.write_trajectory(made_up(CROSSED), CROSSED, tmp_path / "run.lammpstrj")
    other = replace(CROSSED, mass=(8.1e-3, 1e-2, 1e-2, 1.1e-2))
    with pytest.raises(UsageError, match=r"atom 2 has a mass of 0\.010077 kg, body 1 of crossed_3 has 0\.01 kg"):
        db.read_trajectory(tmp_path / "run.lammpstrj", other)


def test_velocities_that_are_not_there_are_not_made_up(tmp_path: Path) -> None:
    text = foreign_dump(CROSSED, made_up(CROSSED)).replace("z vx fx", "z c_1 fx")
    found = db.read_trajectory(_written(tmp_path, text), CROSSED)
    assert np.all(np.isnan(found.velocity))
    assert any("the file has no velocities" in one for one in found.provenance["assumed"])


def test_few_digits_are_seen_and_said(tmp_path: Path) -> None:
    run = made_up(CROSSED)
    full, short = (db.read_trajectory(_written(tmp_path, foreign_dump(CROSSED, run, number=number)), CROSSED)
                   for number in (".17g", ".8f"))  # fmt: skip
    assert full.provenance["resolution"] == {"position": None, "velocity": None}
    assert short.provenance["resolution"] == pytest.approx({"position": 5e-9, "velocity": 5e-9})
    off = np.max(np.abs(short.displacement - full.displacement))
    # rounded at both ends of the difference, of which the first is on the grid
    assert 1e-9 < off <= 5.001e-9
    assert any(
        "position has few digits: its rounding error is up to 5e-09 m" in one for one in short.provenance["assumed"]
    )
    found = db.compare(short, full)
    assert found.divergence is not None
    assert max(one.value * one.scale for one in found.differences if one.quantity == "velocity") <= 5.001e-9


@pytest.mark.parametrize("number", [".4g", ".6g", ".12g", ".3f", ".8f"])
@pytest.mark.parametrize("decades", [1, 3, 14])
def test_what_few_digits_cost_is_found_from_the_numbers(number: str, decades: int) -> None:
    rng = np.random.default_rng(0)
    exact = 10.0 * rng.random(1000) * 10.0 ** -rng.integers(0, decades, 1000)
    written = [float(format(value, number)) for value in exact]
    found = rounding_error(written)
    assert found is not None
    worst = float(np.max(np.abs(np.array(written) - exact)))
    # no less than it is (but for an ulp), and not much more
    assert 0.5 * found < worst <= found + EPS * 10.0
    assert rounding_error(exact.tolist()) is None


@pytest.mark.parametrize("style", [one for one in UNITS if one not in ("si", "ase")])
def test_other_units_are_converted(style: str, tmp_path: Path) -> None:
    run, unit = made_up(CROSSED), UNITS[style]
    scaled = replace(
        run, time=run.time / unit.time, displacement=run.displacement / unit.length,
        velocity=run.velocity / unit.velocity, contact_force=run.contact_force / unit.force,
    )  # fmt: skip
    text = foreign_dump(CROSSED, scaled, place=0.018 / unit.length).replace("\nsi\n", f"\n{style}\n")
    found = db.read_trajectory(_written(tmp_path, text), CROSSED)
    for name in ("time", "velocity"):
        np.testing.assert_allclose(getattr(found, name), getattr(run, name), rtol=4 * EPS, err_msg=name)
    assert np.max(np.abs(found.displacement - run.displacement)) <= 8 * EPS * 0.08
    assert np.max(np.abs(found.contact_force - run.contact_force)) <= 10 * EPS * 2e3


def test_lammps_units_are_those_of_its_manual() -> None:
    """A check by another route: force is mass times length over time squared wherever a style's units are coherent."""
    for style in ("si", "cgs", "micro", "nano", "ase"):
        one = UNITS[style]
        assert one.force == pytest.approx(one.mass * one.length / one.time**2, rel=1e-9), style
        assert one.velocity == pytest.approx(one.length / one.time, rel=1e-9), style
    from ase import units

    assert UNITS["ase"].time * 1e15 * units.fs == pytest.approx(1.0, rel=1e-7)  # other CODATA
    assert UNITS["metal"].force == pytest.approx(1.602176634e-9)
    assert UNITS["real"].force == pytest.approx(4184.0 / 6.02214076e23 / 1e-10)


def _atoms(scene: Scene, run: Trajectory, row: int, axis: int = 0) -> ase.Atoms:
    unit = np.eye(3)[axis]
    x = 0.018 * np.arange(scene.n_body) + run.displacement[row]
    atoms = ase.Atoms("X" * scene.n_body, positions=np.outer(x, unit), masses=scene.mass)
    atoms.set_velocities(np.outer(run.velocity[row], unit))
    force = np.pad(run.contact_force[row], 1)
    atoms.calc = SinglePointCalculator(atoms, forces=np.outer(force[:-1] - force[1:], unit))
    return atoms


@pytest.mark.parametrize("axis", [0, 2], ids=["along x", "along z"])
def test_ase_trajectories_are_read(axis: int, tmp_path: Path) -> None:
    run, path = made_up(CROSSED), tmp_path / "theirs.traj"
    ase.io.write(path, [_atoms(CROSSED, run, row, axis) for row in range(len(run.time))])
    dt = float(run.time[1])
    found = db.read_trajectory(path, CROSSED, units="si", dt=dt)
    np.testing.assert_allclose(found.time, run.time, rtol=2 * EPS)
    # ASE keeps momenta: a product and a quotient
    np.testing.assert_allclose(found.velocity, run.velocity, rtol=2 * EPS)
    assert np.max(np.abs(found.contact_force - run.contact_force)) <= 10 * EPS * 2e3
    with pytest.raises(UsageError, match="no times; give the time step in seconds"):
        db.read_trajectory(path, CROSSED, units="si")
    # without units those are taken in which the masses are the scene's; of another scene they are ASE's own
    again = db.read_trajectory(path, CROSSED, dt=dt)
    np.testing.assert_array_equal(again.velocity, found.velocity)
    assert any("units are si, because the masses" in sentence for sentence in again.provenance["assumed"])
    heavier = replace(CROSSED, mass=tuple(2.0 * np.array(CROSSED.mass)), geometry=None)
    with pytest.raises(UsageError, match=r"atom 0 has a mass of 1\.3\S*e-29 kg"):
        db.read_trajectory(path, heavier, dt=dt)


def test_ase_without_momenta_has_no_velocities(tmp_path: Path) -> None:
    run = made_up(CROSSED)
    frames = [_atoms(CROSSED, run, row) for row in range(len(run.time))]
    for one in frames:
        del one.arrays["momenta"]
    ase.io.write(tmp_path / "theirs.traj", frames)
    found = db.read_trajectory(tmp_path / "theirs.traj", CROSSED, units="si", dt=1e-6)
    assert np.all(np.isnan(found.velocity))
    del frames[3].arrays["masses"]
    ase.io.write(tmp_path / "theirs.traj", frames)
    with pytest.raises(UsageError, match="only one of frame 3 and the first frame has mass"):
        db.read_trajectory(tmp_path / "theirs.traj", CROSSED, units="si", dt=1e-6)


def test_extended_xyz_by_ase_is_read_and_its_8_decimals_are_seen(tmp_path: Path) -> None:
    run = made_up(CROSSED)
    frames = [_atoms(CROSSED, run, row) for row in range(len(run.time))]
    for one, time in zip(frames, run.time.tolist(), strict=True):
        one.info["Time"] = time
        one.arrays["velo"] = one.get_velocities()
    ase.io.write(tmp_path / "theirs.extxyz", frames, columns=["symbols", "positions", "velo", "forces"])
    found = db.read_trajectory(tmp_path / "theirs.extxyz", CROSSED)
    assert found.provenance["resolution"]["position"] == pytest.approx(5e-9)
    assert any("units are si, because the file does not state them" in one for one in found.provenance["assumed"])
    assert np.max(np.abs(found.velocity - run.velocity)) <= 5.001e-9


def _csv(head: str, run: Trajectory, *columns: np.ndarray) -> str:
    rows = np.hstack([run.time[:, None], *columns])
    return "\n".join([head, *(",".join(map(repr, row)) for row in rows.tolist())])


def test_csv_of_others_in_other_units(tmp_path: Path) -> None:
    run = made_up(PAIR)
    head = "t (s),x_0 (mm),x_1 (mm),velocity 0 [mm/s],velocity 1 [mm/s]"
    text = _csv(head, run, 1e3 * (run.displacement + np.array([0.0, 0.02])), 1e3 * run.velocity)
    found = db.read_trajectory(_written(tmp_path, text, "theirs.csv"), PAIR)
    np.testing.assert_allclose(found.velocity, run.velocity, rtol=2 * EPS)
    assert np.max(np.abs(found.displacement - run.displacement)) <= 4 * EPS * 0.02
    assert np.all(np.isnan(found.contact_force))


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("time_s,velocity_0_m_per_s\n0,1\n", "velocity are of 1 bodies, the scene pair has 2; allowed: all"),
        ("time_s,contact_force_0_N\n0,0\n1,1\n", "neither displacements nor positions nor velocities; add one"),
        ("time_s,speed_0_m\n0,1\n", "that can be used in 'time_s', 'speed_0_m'; allowed: headings such"),
        ("time_s,velocity_0_furlong\n0,1\n", "be used in 'time_s', 'velocity_0_furlong'; allowed: .* .m/s.'"),
        ("time_s,velocity 0 [furlong]\n0,1\n", "the unit 'furlong' of velocity is unknown; allowed: m/s, mm/s"),
        ("time_s,displacement_0_m,displacement_2_m\n0,1,1\n", "the displacement of body 2; .* has 2: .* 0 to 1"),
        ("time_s,x_0_m,x_1_m\n0,0,-1\n1,0,-1\n", "in frame 0 atom 0 is at 0 and atom 1 at -1; allowed: positions"),
        ("displacement_0_m,displacement_1_m\n0,1\n", "has no times; name their column"),
        ("time_s,displacement_0_m,displacement_1_m\n0,one,1\n", "not a table, because none of its 2 lines is a row of"),
        ("time_s,displacement_0_m,displacement_1_m\n0,1,1\n0,one,1\n", "column 'disp.*' has no number in row 2"),
        ("time_s,displacement_0_m,displacement_1_m\n0,1\n", "which is not the number of headings in"),
        ("time_s,body,displacement_m\n0,0,0\n0,1,0\n1,0,0\n", "not used: 1 s lacks body 1; allowed: a complete"),
        ("time_s,x_0_m,x_1_m\n0,0,1\n1,0,1\n0.5,0,1\n", "sample 2 is at 0.5 s and sample 1 at 1 s; allowed"),
        ("time_s,x_0_m,x_1_m\n0,0,1\n1,,1\n", r"line 3, column 2 \('x_0_m'\): the cell is empty; allowed: finite"),
        ("", "the file is empty"),
    ],
)  # fmt: skip
def test_a_csv_that_cannot_be_is_refused_by_name(text: str, found: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=found) as error:
        db.read_trajectory(_written(tmp_path, text, "theirs.csv"), PAIR)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "how", "found"),
    [
        ("none.csv", {}, "no such file"),
        ("binary.lammpstrj", {}, "the file is not text .* convert a binary dump with LAMMPS' binary2txt"),
        ("binary.traj", {"dt": 1e-6}, r"ASE cannot read frame 0 \(.*\); write the file again"),
        ("text.lammpstrj", {}, "where a line 'ITEM: ...' is expected"),
        ("hello.lammpstrj", {}, "the file is not a table, because none of its 1 lines is a row"),
        ("text.lammpstrj", {"units": "lj"}, "units = 'lj' is unknown; allowed: si"),
        ("text.lammpstrj", {"dt": -1.0}, r"dt = -1\.0; allowed"),
        ("text.csv", {"units": "metal"}, "the file is not a table, because none of its 1 lines is a row"),
        ("run.nc", {"dt": 1.0}, "units and dt do not apply to netCDF"),
        ("run.pdb", {}, "no such file"),
    ],
)
def test_files_and_settings_that_cannot_be_are_refused(
    name: str, how: dict[str, Any], found: str, tmp_path: Path
) -> None:
    (tmp_path / "binary.lammpstrj").write_bytes(b"\xf6\xff\xff\xff\xff\xff\xff\xffDUMPCUSTOM\x01")
    (tmp_path / "binary.traj").write_bytes(b"- of UlmASE-Trajectory\xf6\xff")
    for text in ("hello.lammpstrj", "text.csv"):
        (tmp_path / text).write_text("hello\n")
    (tmp_path / "text.lammpstrj").write_text("ITEM: TIMESTEP\n0\nhello\n")
    with pytest.raises(UsageError, match=found) as error:
        db.read_trajectory(tmp_path / name, PAIR, **how)
    assert "\n" not in str(error.value)


def test_a_file_without_its_scene_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="give the scene of this run"):
        db.read_trajectory(tmp_path / "run.csv")


@pytest.mark.parametrize("name", ["run", "run.csv", "run.pdb", "run.nc"])
@pytest.mark.parametrize("kind", ["nc", "dump", "foreign netCDF"])
def test_the_content_decides_about_the_format_and_not_the_name(name: str, kind: str, tmp_path: Path) -> None:
    run, path = made_up(CROSSED), tmp_path / name
    if kind == "nc":
        run.save(path)
    elif kind == "dump":
        path.write_text(foreign_dump(CROSSED, run))
    else:
        dims = ("time", "body")
        data = {"velocity": (dims, run.velocity), "displacement": (dims, run.displacement)}
        xr.Dataset(data, coords={"time": run.time}).to_netcdf(path, engine="h5netcdf")
    if (kind, name) == ("dump", "run.nc"):
        with pytest.raises(UsageError, match="not a netCDF-4 file"):
            db.read_trajectory(path, CROSSED)
        return
    found = db.read_trajectory(path, CROSSED)
    np.testing.assert_array_equal(found.velocity, run.velocity)
    assert (found.provenance["backend"] == "file") == (kind != "nc")


@pytest.mark.lammps
@pytest.mark.parametrize("scene", [CROSSED, replace(RAW, damping=None)], ids=lambda one: one.name)
def test_a_dump_that_lammps_wrote_is_our_own_run_to_the_last_digit(scene: Scene, tmp_path: Path) -> None:
    dt = 2e-7
    db.write_deck(scene, tmp_path, dt=dt)
    deck = tmp_path / f"in.{scene.name}"
    deck.write_text(deck.read_text().replace(f"dump.{scene.name}.bin", "run.lammpstrj"))
    run_deck(tmp_path, deck.name, time_limit=60.0)
    found = db.read_trajectory(tmp_path / "run.lammpstrj", scene)
    ours = db.solve(scene, backend="lammps-granular", dt=dt, uncertainty=False)
    assert len(found.time) >= len(ours.time)
    compared = db.compare(found, ours)
    assert compared.samples == len(ours.time)
    assert compared.divergence is None
    assert {one.quantity: one.value for one in compared.differences if one.quantity != "peak_force"} == {
        "displacement": 0.0, "velocity": 0.0, "contact_force": 0.0,
    }  # fmt: skip
    # ... and not because nothing moves
    assert np.max(np.abs(found.velocity[1:] - found.velocity[0])) > 0.1
    assert math.isfinite(found.peak_force.max())
