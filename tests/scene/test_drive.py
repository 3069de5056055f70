"""A drive is the force that its words say, at every time, and refuses what is no drive."""

from __future__ import annotations

import math
import pickle
from dataclasses import FrozenInstanceError, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from dem_bridge.errors import SceneError
from dem_bridge.scene.drive import KEYS, Drive
from tests.helpers.driven_chains import CHIRP, DRIVES, SINE, TABLE

EPS = float(np.finfo(float).eps)


@given(time=st.floats(0.0, 1e-3), phase=st.floats(-360.0, 360.0))
def test_a_sine_that_rises_is_three_sines(time: float, phase: float) -> None:
    """sin^2(pi t / 2r) sin a = sin a / 2 - sin(a + pi t / r) / 4 - sin(a - pi t / r) / 4."""
    drive = replace(SINE, phase=phase)
    turned = 2.0 * math.pi * 4000.0 * time + math.radians(phase)
    rising = math.pi * min(time, 2e-4) / 2e-4
    three = 0.5 * math.sin(turned) - 0.25 * math.sin(turned + rising) - 0.25 * math.sin(turned - rising)
    # 25 turns of the phase lose the digits of so many rad
    assert float(drive.at(time)) == pytest.approx(2.0 * three, abs=2.0 * 60.0 * EPS)


@pytest.mark.parametrize("time", [1e-5, 1.7e-4, 3e-4, 7e-4])
def test_the_phase_of_a_chirp_is_the_integral_of_its_frequency(time: float) -> None:
    def frequency(t: float) -> float:
        return 1000.0 + 7000.0 * min(t / 3e-4, 1.0)

    cycles = quad(frequency, 0.0, time, points=[3e-4] if time > 3e-4 else None, epsabs=1e-13)[0]
    assert float(CHIRP.at(time)) == pytest.approx(2.0 * math.sin(2.0 * math.pi * cycles), abs=1e-11)


def test_a_chirp_that_goes_nowhere_is_a_sine() -> None:
    time = np.linspace(0.0, 1e-3, 100)
    same = replace(CHIRP, last_frequency=1000.0)
    np.testing.assert_allclose(
        same.at(time), Drive(shape="sine", force=2.0, frequency=1000.0).at(time), rtol=0.0, atol=2.0 * 10.0 * EPS
    )


@given(time=st.floats(0.0, 1e-3))
def test_a_table_is_straight_lines_and_stays_at_its_last_value(time: float) -> None:
    straight = np.interp(time, 8e-5 * np.arange(6), TABLE.force)
    assert float(TABLE.at(time)) == pytest.approx(float(straight), abs=20.0 * EPS)


@pytest.mark.parametrize("shape", DRIVES)
def test_one_time_and_many_are_the_same(shape: str) -> None:
    drive, time = DRIVES[shape], np.linspace(0.0, 5e-4, 24)
    many = drive.at(time.reshape(4, 6))
    assert many.shape == (4, 6)
    # numpy may take another sine for an array than for a number
    each = np.array([float(drive.at(t)) for t in time.tolist()])
    np.testing.assert_allclose(many.ravel(), each, rtol=0.0, atol=4.0 * EPS * drive.peak)


@pytest.mark.parametrize("shape", DRIVES)
def test_no_force_is_above_the_peak_and_none_changes_faster_than_the_rate(shape: str) -> None:
    drive, time = DRIVES[shape], np.linspace(0.0, 4e-4, 40_001)
    force = drive.at(time)
    assert 0.9 * drive.peak < np.max(np.abs(force)) <= drive.peak
    fastest = np.max(np.abs(np.diff(force))) / time[1] / drive.peak
    assert 0.4 * drive.rate < fastest <= drive.rate * (1.0 + 1e-9)


def test_a_force_breaks_at_the_end_of_its_rise_and_sweep_and_where_a_table_bends() -> None:
    assert SINE.breaks.tolist() == [2e-4]
    assert replace(CHIRP, rise=1e-4).breaks.tolist() == [1e-4, 3e-4]
    assert Drive(shape="sine", force=1.0, frequency=1.0).breaks.tolist() == []
    # 0, 1, 2, 2, 2, 0: no bend within a line, none at the ends
    table = Drive(shape="table", force=(0, 1, 2, 2, 2, 0), interval=0.5)
    assert table.breaks.tolist() == [1.0, 2.0]


def test_a_table_without_force_has_no_rate() -> None:
    still = Drive(shape="table", force=(0.0, 0.0), interval=1.0)
    assert (still.peak, still.rate, still.breaks.tolist()) == (0.0, 0.0, [])


@pytest.mark.parametrize("shape", DRIVES)
def test_a_drive_times_a_factor_has_so_many_times_its_force(shape: str) -> None:
    time = np.linspace(0.0, 4e-4, 17)
    np.testing.assert_array_equal(DRIVES[shape].times(4.0).at(time), 4.0 * DRIVES[shape].at(time))


def test_a_drive_in_words() -> None:
    assert SINE.words == "sine of 2 N at 4000 Hz, from 30 degrees, rising over 0.0002 s"
    assert CHIRP.words == "chirp of 2 N at 1000 Hz to 8000 Hz in 0.0003 s"
    assert TABLE.words == "table of 6 forces at intervals of 8e-05 s, at most 2 N"


def test_a_drive_cannot_be_changed_and_travels_without_what_it_finds_again() -> None:
    with pytest.raises(FrozenInstanceError):
        SINE.force = 1.0  # type: ignore[misc]
    before = len(pickle.dumps(TABLE))
    assert TABLE.at([0.0]).tolist() == [0.0]
    assert len(pickle.dumps(TABLE)) == before
    assert pickle.loads(pickle.dumps(TABLE)) == TABLE


def test_numbers_become_floats_and_lists_tuples() -> None:
    taken = Drive(shape="table", force=np.array([1, 2]), interval=1)  # type: ignore[arg-type]
    assert (taken.force, taken.interval) == ((1.0, 2.0), 1.0)
    assert taken == Drive(shape="table", force=[1, 2], interval=1.0)  # type: ignore[arg-type]


GOOD: dict[str, Any] = {"shape": "sine", "force": 1.0, "frequency": 1000.0}

WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "no shape": ({"shape": "square"}, "drive.shape = 'square'; allowed: sine or chirp or table"),
    "a shape that is no word": ({"shape": 1}, "drive.shape = 1;"),
    "no frequency": ({"frequency": None}, "drive.frequency is missing; allowed: a number > 0 (Hz)"),
    "a frequency of 0": ({"frequency": 0.0}, "drive.frequency = 0.0;"),
    "a force of 0": ({"force": 0.0}, "drive.force = 0.0; allowed: a number > 0 (N)"),
    "a force the other way": ({"force": -1.0}, "phase = 180"),
    "a list for an amplitude": ({"force": (1.0, 2.0)}, "drive.force = (1.0, 2.0);"),
    "a rise backwards": ({"rise": -1e-3}, "drive.rise = -0.001;"),
    "a phase that is no number": ({"phase": math.nan}, "drive.phase = nan;"),
    "a chirp's key on a sine": (
        {"sweep": 1e-3}, "drive.sweep does not apply to shape = 'sine', only to chirp; allowed: force, frequency"
    ),
    "a table's key on a sine": ({"interval": 1e-3}, "only to table"),
    "half a chirp": ({"shape": "chirp", "last_frequency": 1.0}, "drive.sweep is missing; allowed: a number > 0 (s)"),
    "a wave's key on a table": (
        {"shape": "table", "force": (0.0, 1.0), "interval": 1.0}, "drive.frequency does not apply to shape = 'table'",
    ),
    "a table's phase": (
        {"shape": "table", "force": (0.0, 1.0), "interval": 1.0, "frequency": None, "phase": 1.0},
        "drive.phase does not apply to shape = 'table'",
    ),
    "a table of one value": (
        {"shape": "table", "force": (1.0,), "interval": 1.0, "frequency": None}, "has 1 entries; allowed: at least 2",
    ),
    "a table without interval": ({"shape": "table", "force": (0, 1), "frequency": None}, "drive.interval is missing"),
    "a table that is a number": (
        {"shape": "table", "force": 1.0, "interval": 1.0, "frequency": None}, "drive.force = 1.0; allowed: a list",
    ),
    "a table with a hole": (
        {"shape": "table", "force": (1.0, math.inf), "interval": 1.0, "frequency": None}, "drive.force[1] = inf",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("changes", "said"), WRONG.values(), ids=WRONG)
def test_what_is_no_drive_is_refused_in_one_line(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(SceneError) as caught:
        Drive(**(GOOD | changes))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("shape", DRIVES)
def test_every_key_of_a_drive_belongs_to_a_shape(shape: str) -> None:
    assert all(getattr(DRIVES[shape], key) is not None for key in KEYS[shape])


@pytest.mark.parametrize(
    "drive",
    [
        Drive(shape="sine", force=0.7, frequency=930.0, phase=30.0),
        Drive(shape="sine", force=0.7, frequency=930.0, rise=2e-3),
        Drive(shape="chirp", force=2.0, frequency=50.0, last_frequency=900.0, sweep=3e-3, phase=-75.0, rise=1e-3),
        Drive(shape="table", force=(0.5, -2.0, 1.0, 3.0), interval=1.3e-3),
    ],
    ids=["sine", "rise", "chirp", "table"],
)
def test_the_function_of_one_time_has_the_values_of_all(drive: Drive) -> None:
    times = np.linspace(0.0, 6e-3, 301)
    function = drive.function()
    values = [function(t) for t in times.tolist()]
    # two sines of different libraries, of angles up to 30 rad
    np.testing.assert_allclose(values, drive.at(times), rtol=0.0, atol=1e-14 * drive.peak)
