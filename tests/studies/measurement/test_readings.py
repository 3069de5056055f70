"""Measured values are read in all layouts, and what is no measurement is refused in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dem_bridge.errors import SceneError, UsageError
from dem_bridge.scene.file import parse_scene
from dem_bridge.scene.file.load import measurement_of
from dem_bridge.studies.measurement.readings import Reading, read_measurement
from tests.helpers.synthetic import SCENE

ROW = parse_scene(SCENE)
LONG = "time_s,body,velocity_m_per_s,uncertainty_m_per_s\n1e-5,3,0.25,0.01\n1e-5,1,0.5,0.02\n0,1,0.125,0.02\n"


def _read(folder: Path, text: str) -> tuple[Reading, ...]:
    (folder / "laser.csv").write_text(text, encoding="utf-8")
    return read_measurement([folder / "laser.csv"], ROW)


@pytest.mark.parametrize(
    "text",
    [
        LONG,
        "# comment\nt (us);body;v (mm/s);sigma (mm/s)\n10;3;250;10\n10;1;500;20\n0;1;125;20\n",
        "time_us,velocity_3_m_per_s,velocity_3_uncertainty_m_per_s,velocity_1_m_per_s,u_velocity_1_m_per_s\n"
        "0,,,0.125,0.02\n10,0.25,0.01,0.5,0.02\n",
        LONG.replace(",", "  "),
    ],
    ids=["long", "units", "wide", "blanks"],
)
def test_layouts_and_units_give_the_same_values_by_place_and_in_order(tmp_path: Path, text: str) -> None:
    one, three = _read(tmp_path, text)
    assert (one.quantity, one.place, three.place) == ("velocity", 1, 3)
    assert one.time == pytest.approx([0.0, 1e-5])
    assert one.value == pytest.approx([0.125, 0.5])
    assert three.uncertainty == pytest.approx([0.01])


def test_forces_arrivals_and_peaks_are_quantities_of_their_own(tmp_path: Path) -> None:
    text = "body,contact,arrival_us,uncertainty_arrival_us,peak_force_kN,uncertainty_peak_force_kN\n"
    arrival, peak = _read(tmp_path, text + "2,,50,1,,\n,1,,,0.2,0.01\n")
    assert (arrival.quantity, arrival.place, arrival.value[0]) == ("arrival", 2, pytest.approx(5e-5))
    assert (peak.quantity, peak.place, peak.value[0]) == ("peak_force", 1, pytest.approx(200.0))
    assert np.isnan(peak.time[0])
    (force,) = _read(tmp_path, "time_s,contact,force_N,uncertainty_N\n0,2,1.5,0.1\n")
    assert (force.quantity, force.place) == ("contact_force", 2)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (LONG.replace("0.25,0.01", "0.25,-0.01"), "line 2: uncertainty_m_per_s = -0.01; allowed: a number > 0"),
        (LONG.replace("0.25,0.01", "0.25,0"), "line 2: uncertainty_m_per_s = 0; allowed: a number > 0"),
        (LONG.replace("0.25,0.01", "0.25,"), "line 2: uncertainty_m_per_s = empty; allowed: a number > 0"),
        (LONG.replace("0.25", "nan"), "line 2: velocity_m_per_s = 'nan'; allowed: a finite number"),
        (LONG.replace("1e-5,3", "1e-5,4"), "line 2: body = 4; allowed: a whole number from 0 to 3"),
        (LONG.replace("1e-5,3", "1e-5,1.5"), "line 2: body = 1.5; allowed: a whole number"),
        (LONG.replace("1e-5,3", "1,3"), "line 2: time = 1 s; allowed: 0 to 0.00025 s, the duration of row"),
        (LONG.replace("1e-5,3", "1e-5"), "line 2 has 3 cells; allowed: 4"),
        (LONG.replace("velocity_m", "acceleration_m"), "column 'acceleration_m_per_s' is unknown; allowed: time"),
        (LONG.replace("velocity_m_per_s", "velocity"), "column 'velocity' has no unit; write velocity_m_per_s"),
        (LONG.replace("velocity_m_per_s", "velocity (kt)"), "has the unknown unit 'kt'; allowed: m/s"),
        (LONG.replace("time_s,", "t_s,").replace("t_s", "lap"), "column 'lap' is unknown"),
        (
            "time_s,body,velocity_m_per_s\n0,1,0.5\n",
            "has no uncertainty, and a value without one is no measurement; add",
        ),
        ("body,velocity_m_per_s,uncertainty_m_per_s\n1,0.5,0.1\n", "needs times; add a column time_s"),
        ("time_s,velocity_m_per_s,uncertainty_m_per_s\n0,0.5,0.1\n", "does not say of which body; add a column body"),
        ("time_s,body,force_N,uncertainty_N\n0,0,1,1\n", "does not say of which contact; add a column contact"),
        ("time_s,body,uncertainty_m\n0,1,0.1\n", "the file has no measured quantity; allowed: velocity"),
        ("time_s,body,velocity_m_per_s,displacement_m,uncertainty_m\n0,1,1,1,1\n", "does not say of which quantity"),
        ("time_s,body,velocity_m_per_s,uncertainty_m_per_s\n", "the file has no values"),
        ("a,b\n1,2\n", "the file has no known heading; allowed: time, body, contact and quantities with their units"),
        ("\0\n\0\n", "cannot be read (it is not a text file in UTF-8)"),
    ],
)
def test_what_is_no_measurement_is_refused_in_one_line_that_names_the_file(
    tmp_path: Path, text: str, said: str
) -> None:
    with pytest.raises(UsageError) as error:
        _read(tmp_path, text)
    assert said in str(error.value)
    assert "laser.csv: " in str(error.value)
    assert "\n" not in str(error.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"none\.csv: the file of \[measurement\] cannot be read \(No such file"):
        read_measurement([tmp_path / "none.csv"], ROW)


# the table of the scene file

TABLE = '[measurement]\nfile = "laser.csv"\nsource = "a test"\nkind = "digitised"\nparameters.stiffness = 0.02\n'


def test_the_table_is_read_relative_to_the_scene_file_and_is_no_physics(tmp_path: Path) -> None:
    (tmp_path / "row.toml").write_text(SCENE + TABLE)
    found = measurement_of(tmp_path / "row.toml")
    assert found is not None
    assert found.files == (tmp_path / "laser.csv",)
    assert (found.name, dict(found.parameters)) == ("digitised figure", {"stiffness": 0.02})
    assert parse_scene(SCENE + TABLE).content_hash == ROW.content_hash
    assert parse_scene(SCENE + TABLE) == ROW
    assert measurement_of(ROW) is None
    (tmp_path / "row.toml").write_text(SCENE)
    assert measurement_of(tmp_path / "row.toml") is None


@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    [
        ("file =", "data =", "measurement.data is an unknown key; allowed: file, source, kind, parameters, fit"),
        ('"digitised"', '"guessed"', "measurement.kind = 'guessed'; allowed: 'measured', 'digitised' or 'synthetic'"),
        ("0.02", "-0.02", "measurement.parameters.stiffness = -0.02; allowed: greater than 0"),
        ('file = "laser.csv"\n', "", "measurement.file is missing"),
    ],
)
def test_a_table_with_a_wrong_key_is_refused(right: str, wrong: str, said: str) -> None:
    with pytest.raises(SceneError) as error:
        parse_scene(SCENE + TABLE.replace(right, wrong, 1), where="row.toml")
    assert said in str(error.value)


def test_a_heading_with_a_number_of_thousands_of_digits_is_no_reading(tmp_path: Path) -> None:
    (tmp_path / "laser.csv").write_text(f"time_s,velocity_{'1' * 5000}\n0,1\n1e-4,2\n")
    with pytest.raises(UsageError, match=r"laser\.csv"):
        read_measurement([tmp_path / "laser.csv"], ROW)


#: units of each quantity with their values in SI
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
METRES = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "nm": 1e-9}
SPEEDS = {"m_per_s": 1.0, "cm_per_s": 1e-2, "mm_per_s": 1e-3, "m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3}
UNITS = {"arrival": SECONDS, "displacement": METRES, "velocity": SPEEDS, "force": {"N": 1.0, "kN": 1e3, "mN": 1e-3}}


@pytest.mark.parametrize(
    ("heading", "unit", "factor"), [(name, *item) for name, units in UNITS.items() for item in units.items()]
)
def test_every_unit_has_its_value(heading: str, unit: str, factor: float, tmp_path: Path) -> None:
    (reading,) = _read(tmp_path, f"time_us;body;contact;{heading} ({unit});sigma ({unit})\n10;1;1;2;0.5\n")
    assert (reading.value[0], reading.uncertainty[0]) == (pytest.approx(2.0 * factor), pytest.approx(0.5 * factor))
    if heading == "velocity":
        for name, value in SECONDS.items():
            text = f"time ({name});body;v ({unit});sigma ({unit})\n{1e-5 / value!r};1;2;0.5\n"
            assert _read(tmp_path, text)[0].time[0] == pytest.approx(1e-5)
