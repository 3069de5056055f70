"""What readers recognise or refuse at the boundaries: axes, orders, units, steps, samples of rounding, skipped data."""

from __future__ import annotations

import gzip
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import dem_bridge as db
from dem_bridge.errors import UsageError
from dem_bridge.formats.readers import read_record
from dem_bridge.formats.readers.headings import Heading, heading_of
from dem_bridge.formats.readers.read import with_step
from dem_bridge.formats.readers.rounding import numbers, restored_times, rounding_error, rounding_of_values
from dem_bridge.formats.readers.tables import read_text
from dem_bridge.scene.scene import Scene
from tests.helpers.export_chains import CROSSED, PAIR
from tests.helpers.export_runs import foreign_dump, made_up

ALONE = Scene(name="alone", duration=1e-4, mass=(1.0,), stiffness=(), velocity=(1.0,))
#: what read_record returns of two samples of PAIR
MOTION = [[0.8, 0.0], [0.7, 0.1]]


def _dump(names: str, *frames: str, between: str = "") -> str:
    """Return a dump of these rows at the steps 0, 10, ..."""
    head = "ITEM: TIMESTEP\n{}\nITEM: NUMBER OF ATOMS\n{}\nITEM: ATOMS " + names + "\n{}\n"
    texts = [head.format(10 * k, len(rows.split("\n")), rows) for k, rows in enumerate(frames)]
    return between.join(texts)


PLAIN = _dump("id x vx", "1 0 .8\n2 1 0", "1 0 .7\n2 1 .1")
LEGACY = "# vtk DataFile Version 3.0\nrun\nASCII\nDATASET POLYDATA\nPOINTS 2 double\n0 0 0 1 0 0\n"

#: content, arguments, part of a note; each file has the velocities MOTION at 0 s and 1e-6 s
READ: dict[str, tuple[str, dict[str, Any], str]] = {
    "the stated axis": ("t,vx0,vy0,vx1,vy1\n0,9,.8,9,0\n1e-6,9,.7,9,.1\n", {"axis": "y"}, ""),
    "step numbers beside times": ("step,t,v0,v1\n0,0,.8,0\n10,1e-6,.7,.1\n", {}, "the time step is 1e-07 s by the ti"),
    "steps that are no multiples": ("step,t,v0,v1\n0,0,.8,0\n7,1.0000e-6,.7,.1\n17,4.0000e-6,0,0\n", {}, ""),
    "as many columns as bodies": ("a,b,c\n0,.8,0\n1e-6,.7,.1\n", {"columns": ["t", "v", "vel"]}, ""),
    "forces of one side of one body": ("t,v0,v1,force_left_0,force_right_0\n0,.8,0,1,1\n1e-6,.7,.1,1,1\n", {}, ""),
    "the stated axis of atoms": (
        _dump("id x y vx vy", "1 0 0 9 .8\n2 1 0 9 0", "1 0 0 9 .7\n2 1 0 9 .1"), {"axis": "y"}, "lies along y"),
    "the stated bodies of atoms": (
        _dump("id vx", "4 0\n8 .8", "4 .1\n8 .7"), {"bodies": [1, 0]}, ""),
    "a frame that is repeated": (_dump("id x vx", "1 0 .8\n2 1 0") + PLAIN, {}, ""),
    "forces of both sides": (
        _dump("id vx force_left force_right", "1 .8 0 5\n2 0 5 0", "1 .7 0 6\n2 .1 6 0"), {}, ""),
    "blank lines in XYZ": (
        "2\nTime=0\nX 0 0 0 .8 0 0\nX 1 0 0 0 0 0\n\n2\nTime=1e-6\nX 0 0 0 .7 0 0\nX 1 0 0 .1 0 0\n", {}, ""),
    "a heading in one word": ("Time,VelocityX0,VelocityX1\n0,.8,0\n1e-6,.7,.1\n", {}, "velocity has no unit"),
}  # fmt: skip


@pytest.mark.parametrize("kind", READ)
def test_what_can_be_recognised_is_read(kind: str, tmp_path: Path) -> None:
    content, how, note = READ[kind]
    (tmp_path / "run").write_text(content)
    steps = "times" not in kind and "multiples" not in kind
    record = read_record(tmp_path / "run", PAIR, dt=1e-7 if steps else None, **how)
    order = list(record.columns["velocity"])
    assert record.values["velocity"][:2, np.argsort(order)].tolist() == MOTION
    assert record.time[:2].tolist() == pytest.approx([0.0, 1e-6], rel=1e-12)
    assert any(note in sentence for sentence in record.recognised)
    assert record.dt == (None if kind == "steps that are no multiples" else pytest.approx(1e-7))
    force = record.values.get("contact_force")
    assert (None if force is None else force.tolist()) == ([[5.0], [6.0]] if kind == "forces of both sides" else None)


#: content, arguments, message
REFUSED: dict[str, tuple[str, dict[str, Any], str]] = {
    "units against the file": (
        "ITEM: UNITS\nsi\n" + PLAIN, {"units": "metal"}, "units = 'metal' was given, but the file has 'si'; leave un"),
    "bodies of other atoms": (PLAIN, {"bodies": [0]}, "1 bodies were given, the file has 2 atoms; give the body of ea"),
    "too many atoms": (
        _dump("id vx", "1 0\n2 0\n3 0"), {}, "the file has 3 atoms per frame, the scene pair has 2 bodies; allow"),
    "names of a dump in a row": (PLAIN, {"columns": ["id", "x", "vx"]}, "columns of a dump are given by their names; "),
    "a dump without frames": ("ITEM: TIMESTEP\n0\n", {}, "the file has no frames; allowed: a file with at least one"),
    "a dump without step": ("ITEM: ATOMS id x\n1 0\n", {}, "frame 0 or the next frame is incomplete or not in the for"),
    "a time that is nan": ("t,v0,v1\nnan,.8,0\n", {}, "sample 0 is at nan s; allowed: finite, increasing times"),
    "a time that is infinite": ("t,v0\n0,1\n1,1\ninf,1\n", {}, "sample 2 is at inf s; allowed: finite, increasing tim"),
    "a letter like another": ("t,veloc\u0130ty0\n0,1\n1,1\n", {}, "no velocities, displacements, positions or contact"),
}  # fmt: skip


@pytest.mark.parametrize("kind", REFUSED)
def test_what_contradicts_itself_is_refused(kind: str, tmp_path: Path) -> None:
    content, how, why = REFUSED[kind]
    (tmp_path / "run").write_text(content)
    with pytest.raises(UsageError) as refused:
        read_record(tmp_path / "run", PAIR, dt=None if "time" in kind else 1e-7, **how)
    assert why in str(refused.value)
    assert "\n" not in str(refused.value)


def test_without_any_motion_the_first_axis_is_taken(tmp_path: Path) -> None:
    (tmp_path / "run").write_text("t,vx0,vz0,vx1,vz1\n0,0,0,0,0\n1e-6,0,0,0,0\n")
    record = read_record(tmp_path / "run", PAIR)
    assert "the chain lies along x, which has the largest motion" in record.recognised
    assert record.values["velocity"].tolist() == [[0.0, 0.0], [0.0, 0.0]]


@pytest.mark.parametrize(
    ("names", "rows", "quantity", "expected"),
    [
        ("id x y", ("1 0 3", "1 0 5"), "displacement", [[0.0], [2.0]]),
        ("id displacement", ("1 0", "1 .5"), "displacement", [[0.0], [0.5]]),
    ],
)
def test_one_atom_moves_along_the_axis_of_its_largest_motion(
    names: str, rows: tuple[str, str], quantity: str, expected: list[list[float]], tmp_path: Path
) -> None:
    (tmp_path / "run").write_text(_dump(names, *rows))
    assert read_record(tmp_path / "run", ALONE, dt=1e-7).values[quantity].tolist() == expected


def test_radii_that_are_diameters_are_said(tmp_path: Path) -> None:
    text = foreign_dump(CROSSED, made_up(CROSSED)).replace("vx fx", "vx radius")
    rows = [row.rsplit(" ", 1)[0] + " 0.018" if row.count(" ") == 6 and "ITEM" not in row else row
            for row in text.splitlines()]  # fmt: skip
    (tmp_path / "run").write_text("\n".join(rows))
    assert any("has the diameters of the scene" in note for note in read_record(tmp_path / "run", CROSSED).recognised)


def test_arrays_of_ids_sort_what_has_their_shape_and_nothing_else(tmp_path: Path) -> None:
    force = np.array([[1.0], [2.0]])
    time, ids = np.array([0.0, 1e-6]), np.array([[2, 1], [1, 2]])
    np.savez(tmp_path / "run.npz", time=time, id=ids, velocity=[[0.0, 0.8], [0.7, 0.1]], contact_force=force)
    record = read_record(tmp_path / "run.npz", PAIR)
    assert record.values["velocity"].tolist() == MOTION
    assert record.values["contact_force"].tolist() == force.tolist()
    np.savez(tmp_path / "run.npz", time=time, velocity=np.zeros((3, 4)))
    with pytest.raises(UsageError, match=r"'velocity' has the shape \(3, 4\), the times have 2; allowed: a value for"):
        read_record(tmp_path / "run.npz", PAIR)


def test_arrays_that_are_no_samples_and_steps_that_are_none_are_left_out(tmp_path: Path) -> None:
    for dt in (0.0, -1.0, math.nan, math.inf):
        np.savez(tmp_path / "run.npz", time=[0.0, 1e-6], velocity=MOTION, stress=np.zeros((2, 2, 3, 3)), dt=dt)
        record = read_record(tmp_path / "run.npz", PAIR)
        assert (record.dt, list(record.values)) == (None, ["velocity"])
    np.save(tmp_path / "run.npy", np.column_stack([[0.0, 1e-6], MOTION]))
    record = read_record(tmp_path / "run.npy", PAIR)
    assert record.values["velocity"].tolist() == MOTION
    assert "the file has no headings; its first row shows that its columns are the time and velocities" in (
        record.recognised
    )


def test_netcdf_has_factors_and_a_trajectory_only_its_samples(tmp_path: Path) -> None:
    attributes = {"scale_factor": 0.5, "add_offset": 1.0, "units": "mm/s"}
    data = {"velocity": (("time", "body"), np.array([[4, 0], [2, 6]], dtype="i2"), attributes)}
    xr.Dataset(data, coords={"time": [0.0, 1e-6]}).to_netcdf(tmp_path / "run.nc", engine="h5netcdf")
    record = read_record(tmp_path / "run.nc", PAIR)
    np.testing.assert_allclose(record.values["velocity"], 1e-3 * np.array([[3.0, 1.0], [2.0, 4.0]]), rtol=1e-15)
    run = made_up(PAIR, forces=False)
    replace(run, provenance={**run.provenance, "settings": {"dt": 1e-7}}).save(tmp_path / "own.nc")
    record = read_record(tmp_path / "own.nc", PAIR)
    assert set(record.values) == {"velocity", "displacement"}  # its contact forces are nan
    np.testing.assert_array_equal(record.values["velocity"], run.velocity)
    assert record.dt == 1e-7


@pytest.mark.parametrize(
    ("text", "meaning"),
    [
        ("contactForce_3 [N]", Heading("contact_force", 3, "N", None)),
        ("PositionY(mm)", Heading("position", None, "mm", 1)),
        ("net.force", Heading("force", None, None, None)),
        ("po\u017fition", None),
    ],
)
def test_separators_in_names_are_optional(text: str, meaning: Heading | None) -> None:
    assert heading_of(text) == meaning


def _series(folder: Path, ending: str, *frames: str) -> Path:
    for k, text in enumerate(frames):
        (folder / f"run{10 * k}.{ending}").write_text(text)
    return folder


def _cells(vectors: str) -> str:
    return LEGACY + f"CELL_DATA 1\nVECTORS v double\n9 9 9\nFIELD f 1\nid 1 1 int\n7\nPOINT_DATA 2\n{vectors}"


#: files with a frame each: ending, frames
SERIES = {
    "XYZ": ("xyz", ["2\nrun\nX 0 0 0 .8 0 0\nX 1 0 0 0 0 0\n", "2\nrun\nX 0 0 0 .7 0 0\nX 1 0 0 .1 0 0\n"]),
    "cells": ("vtk", [_cells(f"VECTORS v double\n{v} 0 0 {w} 0 0\n") for v, w in MOTION]),
    "scalars": ("vtk", [LEGACY + f"POINT_DATA 2\nSCALARS vx double 1\nLOOKUP_TABLE default\n{v} {w}\n"
                        for v, w in MOTION]),
}  # fmt: skip


@pytest.mark.parametrize("kind", SERIES)
def test_a_folder_of_frames_is_read(kind: str, tmp_path: Path) -> None:
    ending, frames = SERIES[kind]
    record = read_record(_series(tmp_path, ending, *frames), PAIR, dt=1e-6 if kind == "XYZ" else 1e-7)
    assert record.values["velocity"].tolist() == MOTION
    np.testing.assert_allclose(record.time, [0.0, 1e-6], rtol=1e-15)


def test_displacements_of_points_are_those_of_the_chain(tmp_path: Path) -> None:
    text = LEGACY + "POINT_DATA 2\nVECTORS displacement double\n1e-6 0 0 2e-6 0 0\n"
    record = read_record(_series(tmp_path, "vtk", text), PAIR, dt=1e-7)
    assert record.values["displacement"].tolist() == [[1e-6, 2e-6]]


def test_a_folder_of_tables_is_refused(tmp_path: Path) -> None:
    folder = _series(tmp_path, "csv", "t,v0\n0,1\n", "t,v0\n1,1\n")
    with pytest.raises(UsageError, match=r"run0\.csv is neither a dump nor XYZ nor VTK; allowed: a series of files of"):
        read_record(folder, PAIR)


def test_a_file_beyond_the_limit_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dem_bridge.formats.readers.read.MOST_BYTES", 1 << 20)
    content = b"t,v0\n" + b"0,1\n" * (1 << 18)
    (tmp_path / "run").write_bytes(content)
    with pytest.raises(UsageError, match=r"the file cannot be read \(it has more than 1 MiB\); give a file of samples"):
        read_record(tmp_path / "run", PAIR)
    (tmp_path / "run").write_bytes(gzip.compress(content))
    with pytest.raises(UsageError, match="the file has more than 1 MiB; write fewer samples or use npz or netCDF"):
        read_record(tmp_path / "run", PAIR)


@pytest.mark.parametrize("file", ["run.csv@0", "run.csv@-1e-7", "run.csv@nan", "run.csv@fast", ("run.csv", math.inf)])
def test_a_time_step_that_is_none_is_refused(file: Any) -> None:
    with pytest.raises(UsageError, match=r"run\.csv: the time step is not a number above 0 \(\S+ to \S+\); give FILE@"):
        with_step(file)


def test_a_run_of_three_samples_is_complete(tmp_path: Path) -> None:
    run = made_up(CROSSED)
    frames = foreign_dump(CROSSED, run).split("ITEM: TIME\n")
    (tmp_path / "run").write_text("ITEM: TIME\n".join(frames[:4]))
    found = db.read_trajectory(tmp_path / "run", CROSSED)
    np.testing.assert_array_equal(found.velocity, run.velocity[:3])


# digits


def test_of_many_numbers_a_sample_shows_their_digits() -> None:
    values = np.round(np.random.default_rng(2).random(6000), 4)
    texts = np.array([f"{value:.4f}".encode() for value in values])
    for rounding in (rounding_of_values(values), numbers(texts)[1]):
        np.testing.assert_allclose(rounding, 5e-5, rtol=1e-12)
    assert rounding_error(np.zeros(3)) is None


@pytest.mark.parametrize(
    ("time", "digits", "interval", "left"),
    [
        # of the numbers from 0.01225 to 0.0125 none is clearly the roundest, so it is their middle
        ([0.0, 0.012, 0.025], 3, 0.012375, 1.25e-4),
        # 0.007 is the only number of one digit from 0.00699 to 0.00701
        ((0.007 * np.arange(51)).tolist(), 3, 0.007, 0.0),
        # no number of up to nine digits is within 4e-13 of the interval: it stays uncertain by that
        ((np.arange(4) / 81.0000001).tolist(), 12, 1.0 / 81.0000001, 5e-13 / 3.0),
    ],
)
def test_times_of_no_known_interval_have_the_roundest_or_the_middle(
    time: list[float], digits: int, interval: float, left: float
) -> None:
    rounding = np.full(len(time), 0.5 * 10.0**-digits)
    restored, error, sentence = restored_times(np.round(time, digits), rounding, duration=1.0, samples=7, dt=None)
    order = np.arange(len(time))
    # the bounds of the interval have the rounding errors of the last time
    np.testing.assert_allclose(restored, interval * order, rtol=0.0, atol=(left + 1e-15) * order[-1])
    np.testing.assert_allclose(error, np.minimum(left * order, rounding), rtol=0.5, atol=1e-15)
    assert sentence is not None
    assert sentence.startswith("times have few digits and are multiples of 0.0")


def _read_table(text: str) -> tuple[list[list[bytes]], list[str]] | str:
    """Return the cells and notes of a table, or why it is refused."""
    try:
        table = read_text(text)
    except UsageError as error:
        return str(error)
    return [entry.values.tolist() for entry in table.entries], table.notes


@pytest.mark.parametrize("mark", [",", ";", "\t"])
@pytest.mark.parametrize(
    "cell",
    ["2", "+2.", "-.5", "2e3", "2.5E-03", "1.0D+2", "NaN", "-inf", "Infinity", "", ".", "2e", "--2", "1_0", "0x2",
     "infi", "2 3", "\N{ARABIC-INDIC DIGIT TWO}", '"2"', "2" * 500],
)  # fmt: skip
def test_rows_of_plain_numbers_are_read_as_rows_with_blanks_are(cell: str, mark: str) -> None:
    text = f"t{mark}v0{mark}v1\n0{mark}1{mark}0\n1{mark}{cell}{mark}3\n2{mark}4{mark}5\n"
    with_blanks = text.replace(f"2{mark}4", f"2 {mark}4")
    assert _read_table(text) == _read_table(with_blanks)


@pytest.mark.parametrize("text", ["t,v0\n0,1\n1,2,3\n", "t,v0\n0,1\n1\n", "t;v0\n0;1,5\n1;2,5\n", "t,\n0,\n1,\n"])
def test_rows_of_another_length_and_decimal_commas_are_seen_among_plain_numbers(text: str) -> None:
    assert _read_table(text) == _read_table(text.replace("\n1", "\n 1"))
