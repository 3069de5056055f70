"""Write samples into files as other people's codes do: CSV, text columns, npz, netCDF, dumps, XYZ, VTK."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tests.helpers.planted.faults import Run

UNIT = {"displacement": "m", "velocity": "m_per_s"}


def text(value: float, digits: int) -> str:
    """Return a number with so many significant digits; 17 are all digits."""
    return repr(float(value)) if digits >= 17 else f"{value:.{digits - 1}e}"


def _table(run: Run, bodies: Sequence[int]) -> tuple[list[str], np.ndarray]:
    headings = ["time_s"] + [f"{name}_{body}_{UNIT[name]}" for name in run.values for body in bodies]
    return headings, np.column_stack([run.time, *run.values.values()])


def write_csv(path: Path, run: Run, bodies: Sequence[int], digits: int) -> None:
    """Write a row per time, with a heading such as ``velocity_0_m_per_s`` per column."""
    headings, table = _table(run, bodies)
    rows = (",".join([text(row[0], 15), *(text(value, digits) for value in row[1:])]) for row in table)
    path.write_text("\n".join([",".join(headings), *rows]) + "\n")


def write_columns(path: Path, run: Run, bodies: Sequence[int], digits: int) -> None:
    """Write columns that are separated by blanks, with the headings of the CSV file after a ``#``."""
    headings, table = _table(run, bodies)
    rows = (" ".join([text(row[0], 15), *(text(value, digits) for value in row[1:])]) for row in table)
    path.write_text("\n".join(["# " + " ".join(headings), *rows]) + "\n")


def rounded(values: np.ndarray, digits: int) -> np.ndarray:
    """Return values as they are read from a text file with so many digits."""
    return np.array([[float(text(value, digits)) for value in row] for row in values])


def write_npz(path: Path, run: Run, bodies: Sequence[int], digits: int) -> None:
    """Write the arrays ``time``, ``displacement``, ``velocity`` and ``body``."""
    arrays: dict[str, Any] = {name: rounded(values, digits) for name, values in run.values.items()}
    np.savez(path, time=run.time, body=np.array(bodies), **arrays)


def write_netcdf(path: Path, run: Run, bodies: Sequence[int], digits: int) -> None:
    """Write the variables ``displacement`` and ``velocity`` over ``time`` and ``body``, with units."""
    import xarray

    units = {"displacement": "m", "velocity": "m/s"}
    variables = {
        name: (("time", "body"), rounded(values, digits), {"units": units[name]}) for name, values in run.values.items()
    }
    coordinates = {"time": ("time", run.time, {"units": "s"}), "body": ("body", np.array(bodies))}
    xarray.Dataset(variables, coords=coordinates).to_netcdf(path, engine="h5netcdf")


def write_dump(path: Path, run: Run, bodies: Sequence[int], digits: int, spacing: float = 0.018) -> None:
    """Write a LAMMPS dump with positions along x in all digits, and velocities; a step is a tenth of a row."""
    names = ["id", "type", "x", "y", "z"] + (["vx", "vy", "vz"] if "velocity" in run.values else [])
    lines: list[str] = []
    for row, time in enumerate(run.time):
        lines += ["ITEM: UNITS", "si", "ITEM: TIME", repr(float(time)), "ITEM: TIMESTEP", str(10 * row)]
        lines += ["ITEM: NUMBER OF ATOMS", str(len(bodies)), "ITEM: BOX BOUNDS ff pp pp"]
        lines += [
            f"{-spacing!r} {spacing * (max(bodies) + 1)!r}",
            "-0.01 0.01",
            "-0.01 0.01",
            "ITEM: ATOMS " + " ".join(names),
        ]
        for column, body in enumerate(bodies):
            x = spacing * body + run.values["displacement"][row, column]
            cells = [str(body + 1), "1", repr(float(x)), "0", "0"]
            if "velocity" in run.values:
                cells += [text(run.values["velocity"][row, column], digits), "0", "0"]
            lines.append(" ".join(cells))
    path.write_text("\n".join(lines) + "\n")


def write_extxyz(path: Path, run: Run, bodies: Sequence[int], digits: int, spacing: float = 0.018) -> None:
    """Write extended XYZ with positions and velocities in SI units, and the time in the comment."""
    lines: list[str] = []
    for row, time in enumerate(run.time):
        properties = "species:S:1:pos:R:3" + (":velo:R:3" if "velocity" in run.values else "")
        lines += [str(len(bodies)), f'Properties={properties} Time={float(time)!r} units="si" pbc="F F F"']
        for column, body in enumerate(bodies):
            cells = ["X", repr(float(spacing * body + run.values["displacement"][row, column])), "0.0", "0.0"]
            if "velocity" in run.values:
                cells += [text(run.values["velocity"][row, column], digits), "0.0", "0.0"]
            lines.append(" ".join(cells))
    path.write_text("\n".join(lines) + "\n")


def write_vtk(folder: Path, run: Run, bodies: Sequence[int], digits: int, spacing: float = 0.018) -> Path:
    """Write a legacy VTK file per time and a PVD file with the times; return the latter."""
    sets = []
    for row, time in enumerate(run.time):
        file = folder / f"chain_{row:05d}.vtk"
        x = [float(spacing * body + run.values["displacement"][row, c]) for c, body in enumerate(bodies)]
        lines = ["# vtk DataFile Version 3.0", "chain", "ASCII", "DATASET POLYDATA", f"POINTS {len(x)} double"]
        lines += [f"{value!r} 0.0 0.0" for value in x]
        lines += [f"VERTICES {len(x)} {2 * len(x)}", *(f"1 {i}" for i in range(len(x))), f"POINT_DATA {len(x)}"]
        if "velocity" in run.values:
            lines += ["VECTORS velocity double"]
            lines += [f"{text(value, digits)} 0.0 0.0" for value in run.values["velocity"][row]]
        lines += ["SCALARS id int 1", "LOOKUP_TABLE default", *(str(body + 1) for body in bodies)]
        file.write_text("\n".join(lines) + "\n")
        sets.append(f'<DataSet timestep="{float(time)!r}" group="" part="0" file="{file.name}"/>')
    path = folder / "chain.pvd"
    head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n<Collection>\n'
    path.write_text(head + "\n".join(sets) + "\n</Collection>\n</VTKFile>\n")
    return path


WRITERS = {
    "csv": write_csv,
    "txt": write_columns,
    "npz": write_npz,
    "nc": write_netcdf,
    "lammpstrj": write_dump,
    "extxyz": write_extxyz,
}
