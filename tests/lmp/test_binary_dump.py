"""Binary dumps are read bit for bit, and what is cut or something else is a broken run, never a wrong answer."""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dem_bridge.errors import RunBroken
from dem_bridge.lmp.binary_dump import read_binary_dump
from tests.helpers.dumps import frame

ROWS = [[1.0, 0.1, -0.8, 1e-300], [2.0, math.pi, 5e-324, -math.inf]]


def _file(folder: Path, *frames: bytes) -> Path:
    path = folder / "dump.bin"
    path.write_bytes(b"".join(frames))
    return path


def test_every_bit_of_every_frame_arrives(tmp_path: Path) -> None:
    other = [[1.0, 0.3, 1 / 3, math.nan], [2.0, -0.0, 1e308, 0.1]]
    steps, values = read_binary_dump(_file(tmp_path, frame(0, ROWS), frame(601, other)), columns=4)
    assert steps.tolist() == [0, 601]
    assert values.tobytes() == np.array([ROWS, other]).tobytes()


@pytest.mark.parametrize(
    "form", [{"units": ""}, {"time": None}, {"triclinic": True}, {"columns": ""}, {"units": "", "time": None}], ids=str
)
def test_every_optional_part_of_the_header_may_be_there_or_not(tmp_path: Path, form: dict[str, object]) -> None:
    dump = _file(tmp_path, frame(5, ROWS, **form), frame(6, ROWS, **form))  # type: ignore[arg-type]
    steps, values = read_binary_dump(dump, columns=4)
    assert steps.tolist() == [5, 6]
    assert values.shape == (2, 2, 4)


def test_the_chunks_of_two_ranks_are_one_frame(tmp_path: Path) -> None:
    _, values = read_binary_dump(_file(tmp_path, frame(0, ROWS, chunks=2)), columns=4)
    assert values.tobytes() == np.array([ROWS]).tobytes()


@given(step=st.integers(0, 2**62), atoms=st.integers(1, 50))
def test_steps_beyond_32_bits_and_any_number_of_atoms_are_read(
    tmp_path_factory: pytest.TempPathFactory, step: int, atoms: int
) -> None:
    rows = np.random.default_rng(atoms).standard_normal((atoms, 4))
    steps, values = read_binary_dump(_file(tmp_path_factory.mktemp("dump"), frame(step, rows.tolist())), columns=4)
    assert steps.tolist() == [step]
    np.testing.assert_array_equal(values, rows[None])


def test_a_missing_dump_is_a_broken_run(tmp_path: Path) -> None:
    with pytest.raises(RunBroken, match=r"dump\.bin: LAMMPS ended without an error but wrote no dump"):
        read_binary_dump(tmp_path / "dump.bin", columns=4)


def test_a_text_dump_is_a_broken_run(tmp_path: Path) -> None:
    with pytest.raises(RunBroken, match="not a binary LAMMPS dump"):
        read_binary_dump(_file(tmp_path, b"ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n2\n"), columns=4)


def test_another_revision_is_refused_by_its_number(tmp_path: Path) -> None:
    with pytest.raises(RunBroken, match="binary dump revision 3; allowed: 2"):
        read_binary_dump(_file(tmp_path, frame(0, ROWS, revision=3)), columns=4)


def test_a_number_of_atoms_that_changes_is_a_broken_run(tmp_path: Path) -> None:
    with pytest.raises(RunBroken, match="number of atoms changes"):
        read_binary_dump(_file(tmp_path, frame(0, ROWS), frame(1, ROWS[:1])), columns=4)


def test_a_number_of_columns_that_does_not_fit_is_a_broken_run(tmp_path: Path) -> None:
    with pytest.raises(RunBroken, match="is incomplete or has another layout"):
        read_binary_dump(_file(tmp_path, frame(0, ROWS)), columns=3)


def test_the_frame_that_does_not_fit_is_named(tmp_path: Path) -> None:
    with pytest.raises(RunBroken, match="frame 0 is incomplete"):
        read_binary_dump(_file(tmp_path, frame(0, ROWS)), columns=3)


#: where the second frame's flag for the time stands: magic, integers, box, columns, length of "si", "si"
FLAG = len(frame(0, ROWS)) + 18 + 28 + 24 + 48 + 4 + 4 + 2
#: lengths that end within "si" or right before the flag
UNITS = range(FLAG - 2, FLAG + 1)


def _broken(path: Path) -> str:
    with pytest.raises(RunBroken) as caught:
        read_binary_dump(path, columns=4)
    return str(caught.value)


def test_a_dump_cut_anywhere_within_a_frame_is_a_broken_run(tmp_path: Path) -> None:
    one = frame(0, ROWS)
    for length in range(len(one) + 1, 2 * len(one)):
        if length not in UNITS:  # see the next test
            assert "dump.bin: " in _broken(_file(tmp_path, (one + frame(1, ROWS))[:length]))


@pytest.mark.parametrize("length", UNITS)
def test_a_dump_cut_before_the_time_flag_is_a_broken_run(tmp_path: Path, length: int) -> None:
    assert "dump.bin: " in _broken(_file(tmp_path, (frame(0, ROWS) + frame(1, ROWS))[:length]))


@pytest.mark.parametrize("form", [{}, {"time": None}, {"triclinic": True}], ids=str)
def test_frames_that_are_laid_out_alike_are_read_at_once_and_as_by_the_loop(
    form: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = np.random.default_rng(3).standard_normal((50, 3, 4))
    # as LAMMPS writes them: units in the first frame alone
    alike = [frame(0, rows[0].tolist(), **form)]
    times = [None if "time" in form else 0.1 * step for step in range(50)]
    alike += [frame(k, rows[k].tolist(), units="", **(form | {"time": times[k]})) for k in range(1, 50)]
    # a frame of two ranks has its atoms in another order, and that with units is longer
    two_ranks, longer = frame(50, rows[0].tolist(), units="", chunks=2, **form), frame(50, rows[0].tolist(), **form)
    for last, order in ((b"", []), (two_ranks, [[0, 2, 1]]), (longer, [[0, 1, 2]])):
        with monkeypatch.context() as patch:
            patch.setattr("dem_bridge.lmp.binary_dump.struct.unpack_from", spy := Mock(wraps=struct.unpack_from))
            steps, values = read_binary_dump(_file(tmp_path, *alike, last), columns=4)
        assert steps.tolist() == list(range(50 + len(order)))
        assert values.tobytes() == np.concatenate([rows, *(rows[:1, each] for each in order)]).tobytes()
        assert (spy.call_count < 50) == (last == b"")
