"""Read a file of any code as a record, in the format that its content shows.

Text is read with bounded memory.
"""

from __future__ import annotations

import bz2
import gzip
import lzma
import math
import re
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, cast

import numpy as np

from dem_bridge.errors import OF_DAMAGED_DATA, UsageError
from dem_bridge.formats.readers.arrays import read_npy, read_npz, table_of_netcdf
from dem_bridge.formats.readers.column_meaning import Choices
from dem_bridge.formats.readers.columns_to_record import draft_of_table
from dem_bridge.formats.readers.dumps import FrameCollector, Frames, looks_like_xyz, read_ase, read_dump, read_xyz
from dem_bridge.formats.readers.frames_to_record import draft_of_frames
from dem_bridge.formats.readers.record import Draft, Record
from dem_bridge.formats.readers.rounding import texts_of
from dem_bridge.formats.readers.tables import Table, read_text
from dem_bridge.formats.readers.vtk import frame_of, places, read_legacy, read_pvd, read_xml
from dem_bridge.foundation import guests
from dem_bridge.foundation.files import MOST_BYTES, named_file, opened
from dem_bridge.foundation.netcdf import is_netcdf
from dem_bridge.foundation.numbers import LARGEST, SMALLEST
from dem_bridge.foundation.script_files import is_unit_test
from dem_bridge.scene.scene import Scene

#: a file of a code, with or without its time step
File = str | Path | tuple[str | Path, float | None]
#: most lines of a text
MOST_LINES = 2**25
_PACKED: dict[bytes, Any] = {b"\x1f\x8b": gzip.open, b"BZh": bz2.open, b"\xfd7zXZ": lzma.open}


@contextmanager
def damage_as_usage_error(path: Path) -> Iterator[None]:
    """Turn the exceptions that damaged data cause into a UsageError with the name of the file."""
    try:
        with np.errstate(all="ignore"):
            yield
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from error
    except MemoryError as error:
        raise UsageError(f"{path}: the file needs too much memory; write fewer samples") from error
    except (OSError, *OF_DAMAGED_DATA) as error:
        # a reader checks its data itself; the fuzzing counts what comes here as a fault
        raise UsageError(
            f"{path}: the file is damaged or not in its format ({type(error).__name__}); write it again"
        ) from error


def read_bytes(path: Path) -> bytes:
    """Return the contents of a file, decompressed; raise UsageError if it is missing, damaged or too large."""
    try:
        with opened(path, MOST_BYTES) as file:
            content = file.read(MOST_BYTES + 1) or b""
            opener = next((opener for magic, opener in _PACKED.items() if content.startswith(magic)), None)
            if opener is not None:
                file.seek(0)
                with opener(file, "rb") as stream:
                    content = stream.read(MOST_BYTES + 1)
    except (OSError, EOFError, lzma.LZMAError, zlib.error, ValueError) as error:
        reason = error.strerror or error if isinstance(error, OSError) else error
        raise UsageError(f"the file cannot be read ({reason}); write it again") from error
    if len(content) > MOST_BYTES:
        raise UsageError(f"the file has more than {MOST_BYTES >> 20} MiB; write fewer samples or use npz or netCDF")
    return bytes(content)


def text_of(content: bytes) -> str:
    """Return the contents of a text file; raise UsageError for a binary file."""
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return content.decode("utf-16", errors="replace")
    if not content.strip():
        raise UsageError("the file is empty; allowed: a file with at least one frame or row")
    if content.count(b"\n") > MOST_LINES:
        raise UsageError(f"the file has more than {MOST_LINES} lines; write fewer samples or use npz or netCDF")
    start = content[:4096]
    foreign = sum(byte > 126 for byte in start)
    if any(byte < 9 or 13 < byte < 32 for byte in start) or foreign > 0.3 * len(start):
        raise UsageError(
            "the file is not text and of no known format; allowed: CSV, text columns, npz, netCDF, text dumps of LAMMPS"
            " and LIGGGHTS, extended XYZ, ASE trajectories, VTK; convert a binary dump with LAMMPS' binary2txt"
        )
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def with_step(file: File) -> tuple[Path, float | None]:
    """Return the path and the time step of a file that was given as FILE, FILE@DT or (path, dt).

    >>> with_step("run.csv@1e-7"), with_step("run.csv")[1], with_step(("run.csv", 2e-7))[1]
    ((PosixPath('run.csv'), 1e-07), None, 2e-07)
    """
    if isinstance(file, tuple):
        path, step = Path(file[0]), file[1]
    else:
        name, sign, text = str(file).rpartition("@")
        if not sign or Path(file).exists():
            return Path(file), None
        path, step = Path(name), math.nan
        with suppress(ValueError):
            step = float(text)
    if step is not None and not SMALLEST <= step <= LARGEST:
        raise UsageError(
            f"{path}: the time step is not a number above 0 ({SMALLEST:g} to {LARGEST:g});"
            f" give FILE@DT with DT in s, such as {path}@1e-7"
        )
    return path, step


#: suffixes of the texts that this package reads, which no other distribution takes
SUFFIXES = ("csv", "dat", "dump", "extxyz", "lammpstrj", "tsv", "txt", "xyz")


def read_record(
    path: str | Path,
    scene: Scene,
    *,
    dt: float | None = None,
    columns: Mapping[str, str] | Sequence[str] | None = None,
    units: Mapping[str, str] | str | None = None,
    bodies: Sequence[int] | None = None,
    axis: str | None = None,
) -> Record:
    r"""Read what a file of any code has of a run of ``scene``.

    The format follows from the content. Headings are believed; what is recognised without being stated in the file is
    in :attr:`Record.recognised`. Values that contradict the scene are not refused.

    Parameters
    ----------
    path : str or Path
        File to read.
    scene : Scene
        Scene of the run: numbers of bodies and contacts.
    dt : float, optional
        Time step of the run, s; needed for a file with step numbers and no times.
    columns : mapping or sequence of str, optional
        Meaning of headings, such as ``{"ch1": "velocity 3 [mm/s]"}``, or the headings of all columns in their order.
    units : str or mapping, optional
        Unit style ("si", "metal", ...) of quantities without a unit, or the unit of each quantity, such as
        ``{"time": "ms"}``.
    bodies : sequence of int, optional
        Body of each column, in their order.
    axis : {"x", "y", "z"}, optional
        Axis of the chain.

    Returns
    -------
    Record
        Quantities in SI units with their rounding errors.

    Raises
    ------
    UsageError
        If the file cannot be read.

    Examples
    --------
    >>> import dem_bridge as db, tempfile
    >>> scene = db.Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(folder, "pair.csv").write_text("t,v0,v1\n0,0.8,0\n1e-4,0.089,0.569\n")
    ...     record = read_record(f"{folder}/pair.csv", scene)
    >>> record.values["velocity"][1].tolist(), record.rounding["velocity"][1].tolist(), record.recognised[0]
    ([0.089, 0.569], [0.0005, 0.0005], 'time has no unit in the file and is read in s')
    """
    path = Path(path)
    choices = Choices(dt, columns, units, bodies, axis)
    with damage_as_usage_error(path):
        if (draft := _draft_of_unit_test(path)) is not None:
            return draft.record(scene)
        contents, default_units = load(path, choices)
        if isinstance(contents, Frames):
            return draft_of_frames(path.name, contents, scene, choices, default_units).record(scene)
        return draft_of_table(path.name, contents, scene, choices).record(scene)


def load(path: Path, choices: Choices) -> tuple[Table | Frames, str]:
    """Return the contents of a file, a folder or a pattern of files, and the usual unit style of its format."""
    files = series(path)
    if len(files) > 1 or path.suffix.lower() == ".pvd":
        return _of_series(path, files, choices), "si"
    try:
        with opened(files[0], MOST_BYTES) as stream:
            first = stream.read(16) or b""
    except OSError as error:
        raise UsageError(f"the file cannot be read ({error.strerror}); give a file of samples") from error
    if is_netcdf(first):
        return table_of_netcdf(files[0]), "si"
    if first.startswith(b"PK"):
        return read_npz(files[0]), "si"
    if first.startswith(b"- of Ulm"):
        return read_ase(files[0]), "ase"
    content = read_bytes(files[0])
    if content.startswith(b"\x93NUMPY"):
        return read_npy(content), "si"
    if _is_vtk(content):
        return _of_series(path, files, choices), "si"
    if (foreign := _of_guest(files[0])) is not None:
        return foreign, "si"
    text = text_of(content)
    if text.lstrip().startswith("ITEM:"):
        return read_dump([text], _renamed(choices)), "si"
    if looks_like_xyz(text):
        return read_xyz([text]), "si"
    return read_text(text), "si"


def _draft_of_unit_test(path: Path) -> Draft | None:
    """Return the draft of the record of a unit test of LAMMPS; None if the file is something else."""
    if path.suffix.lower() not in (".yaml", ".yml") or not path.is_file():
        return None
    text = text_of(read_bytes(path))
    if not is_unit_test(text):
        return None
    # few files need what reads LAMMPS' scripts
    from dem_bridge.formats.readers.unit_tests import draft_of_unit_test
    from dem_bridge.lmp.unit_test import read_unit_test

    return draft_of_unit_test(path.name, read_unit_test(text, path.name))


def _of_guest(path: Path) -> Table | Frames | None:
    """Return what a reader of another distribution makes of a file; None without one for its suffix."""
    suffix = path.suffix.lower().removeprefix(".")
    point = guests.find_guest(guests.READERS, suffix) if suffix and suffix not in SUFFIXES else None
    return None if point is None else cast("Table | Frames", guests.load_guest(point)(path))


def _is_vtk(content: bytes) -> bool:
    """Return True for legacy and XML files of VTK."""
    return content.startswith(b"# vtk") or b"<VTKFile" in content[:1000]


def _renamed(choices: Choices) -> Mapping[str, str] | None:
    """Return the names of the columns of a dump that the user states."""
    if choices.columns is not None and not isinstance(choices.columns, Mapping):
        raise UsageError("columns of a dump are given by their names; allowed: a mapping, such as {'f_v[1]': 'vx'}")
    return choices.columns


def _of_series(path: Path, files: list[Path], choices: Choices) -> Frames:
    """Return the frames of files with a frame each, in the order of the numbers in their names."""
    times = [""] * len(files)
    if path.suffix.lower() == ".pvd":
        sets = read_pvd(read_bytes(path))
        times = [time for time, _ in sets]
        try:
            files = [named_file(path.parent, file) for _, file in sets]
        except OSError as error:
            raise UsageError(f"a data set of the series cannot be read: {error.strerror}") from error
        if missing := [file for file in files if not file.is_file()]:
            raise UsageError(f"the data set {missing[0].name} of the series is missing; copy all files of the series")
    contents = map(read_bytes, files)
    start = read_bytes(files[0])
    if not _is_vtk(start):
        texts = map(text_of, contents)
        if start.lstrip().startswith(b"ITEM:"):
            return read_dump(texts, _renamed(choices))
        if looks_like_xyz(text_of(start)):
            return read_xyz(texts)
        raise UsageError(
            f"{files[0].name} is neither a dump nor XYZ nor VTK; allowed: a series of files of one of these formats"
        )
    collector, time_texts, numbered = FrameCollector(), list[str](), True
    for nth, (file, content) in enumerate(zip(files, contents, strict=True)):
        try:
            arrays, time = (read_legacy if content.startswith(b"# vtk") else read_xml)(content)
            ids, columns = frame_of(arrays)
            if "position" not in columns or not len(columns["position"]):
                raise UsageError("the VTK file has no points; allowed: a point for each body")
            if ids is None:
                numbered, ids = False, places(columns["position"])
            collector.add(ids, columns, f"frame {nth}")
        except (ValueError, IndexError, TypeError, UsageError) as error:
            raise UsageError(f"{file.name}: {error}") from error
        time_texts += [text] if (text := times[nth] or time) else []
    step = [float(re.findall(r"\d+", file.name)[-1]) if re.search(r"\d", file.name) else math.nan for file in files]
    notes = () if numbered else ("the file has no ids; bodies are the points in their order",)
    texts_of_times = texts_of(time_texts) if time_texts else ()
    steps = [] if len(set(step)) < len(step) or math.nan in step else step
    return collector.frames(time=texts_of_times, step=steps, numbered=numbered, notes=notes)


def series(path: Path) -> list[Path]:
    """Return the files of a folder or a pattern, in the order of the last numbers in their names; else the file."""
    try:
        if path.exists() and not path.is_dir():
            return [path]
    except (OSError, ValueError):  # the name is too long or contains a NUL
        raise UsageError("this is no valid name of a file; correct it") from None
    if path.is_dir():
        candidates = [file for file in path.iterdir() if file.is_file() and re.search(r"\d", file.name)]
    else:
        candidates = [file for file in path.parent.glob(path.name) if file.is_file()] if "*" in path.name else []
    if not candidates:
        raise UsageError(
            "there is no such file; allowed: a file, a folder or a pattern of files with a frame each; correct the name"
        )
    kinds = Counter(re.sub(r"\d+", "#", file.name) for file in candidates)
    usual = max(kinds, key=lambda kind: (kinds[kind], -len(kind)))
    chosen = [file for file in candidates if re.sub(r"\d+", "#", file.name) == usual]
    return sorted(chosen, key=lambda file: [int(number) for number in re.findall(r"\d+", file.name)])
