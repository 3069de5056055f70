"""The readers that are fuzzed: valid files of each, and the call that reads a changed one."""

from __future__ import annotations

import hashlib
import io
import json
import random
import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.io import netcdf_file

import dem_bridge as db
from dem_bridge.errors import UsageError
from dem_bridge.formats.readers import read_record
from dem_bridge.runs.inspect import entries
from dem_bridge.runs.store import Store
from dem_bridge.scene.file import shipped_scenes
from dem_bridge.scene.file.measured_force import read_force
from dem_bridge.verification import replay
from dem_bridge.verification.bundle import check_bundle
from dem_bridge.verification.regression.baseline import read_baseline
from tests.fuzz.mutate import Rng, of_bytes, of_json, of_words

PAIR = db.Scene(
    name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=10, gravity=9.81
)
_REPORT = Path(__file__).parents[2] / "reports"
_KEY = "0" * 64
_VELOCITY = np.stack([0.8 - 0.1 * np.arange(5), 0.05 * np.arange(5)], axis=1)


@dataclass(frozen=True)
class Target:
    """A reader with valid files."""

    sources: Callable[[], list[bytes]]
    """Contents of valid files."""
    name: str
    """Name of the file in its folder."""
    read: Callable[[Path], object]
    """Function that reads the file."""
    structure: Callable[[Rng, bytes], bytes] = of_words
    prepare: Callable[[Path], object] = lambda folder: None
    """Function that writes the other files of the folder."""
    refusals: tuple[type[Exception], ...] = ()
    """Further exceptions that are refusals."""
    finish: Callable[[bytes], bytes] = bytes
    """Function that completes changed data, such as by a checksum."""


def _run() -> db.Trajectory:
    return db.solve(PAIR, backend="verlet", dt=1e-6, uncertainty=False)


def _written(ending: str, **settings: Any) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"run.{ending}")
        db.write_trajectory(_run(), PAIR, path, **settings)
        return path.read_bytes()


def _scenes() -> list[bytes]:
    folder = Path(db.__file__).parent / "scenes"
    return [file.read_bytes() for file in sorted(folder.rglob("*.toml")) if file.stem in shipped_scenes("all")]


def _small_scenes() -> list[bytes]:
    return [
        b"""name = "small"
description = "a \\"quote\\" & more"
duration = 2.0e-4
[chain]
mass = [8.1e-3, 1.0e-2, 1.0e-2]
stiffness = [4.0e9, 5.0e9]
exponent = [2.5, 2.0]
gap = [0.0, 1e-6]
velocity = [0.8, 0.0, 0.0]
[chain.wall_right]
stiffness = 3e9
gap = 1e-6
[chain.damping]
law = "dashpot"
coefficient = 12.0
[chain.drive]
shape = "table"
file = "force.csv"
[environment]
gravity = 9.81
[sampling]
count = 20
""",
        b"""name = "pattern"
duration = 1e-3
[materials.steel]
youngs_modulus = 193e9
poissons_ratio = 0.3
density = 8000.0
[chain.pattern]
repeat = 5
taper = 0.9
cell = [{shape = "sphere", radius = 5e-3}, {shape = "cylinder", radius = 5e-3, height = 1e-2}]
[chain.pattern.decorate]
shape = "sphere"
radius = 1e-3
every = 3
[chain.pattern.disorder]
radius = 0.01
seed = 3
[chain.striker]
radius = 5e-3
velocity = 1.0
""",
        b"""name = "impact"
[impact]
radius = [0.01, 0.01]
youngs_modulus = 48e9
poissons_ratio = 0.20
density = 2800.0
speed = 20.0
[impact.damping]
law = "coeff_restitution"
coefficient = 0.5
[measurement]
file = "force.csv"
[measurement.parameters]
stiffness = 0.02
""",
        *_scenes()[::3],
    ]


def _force(folder: Path) -> None:
    (folder / "force.csv").write_text("time,force\n0,0\n5e-5,1.5\n1e-4,-0.5\n1.5e-4,1\n2e-4,0\n")


def _scene_csv() -> list[bytes]:
    table = b"# comment\nmass_kg,velocity_m_per_s,stiffness_N_per_m^(n-1),exponent,gap_m,damping_N_s_per_m\n"
    return [table + b"8e-3,0.8,4e9,2.5,0,1\n1e-2,0,5e9,2,1e-6,0\n1e-2,0,,,,\n"]


def _deck(which: str) -> Callable[[], list[bytes]]:
    def sources() -> list[bytes]:
        with tempfile.TemporaryDirectory() as folder:
            db.write_deck(PAIR, folder, dt=1e-6)
            of_ours = Path(folder, f"{which}.pair").read_bytes()
        return [of_ours, _LOOPS] if which == "in" else [of_ours]

    return sources


_LOOPS = b"""units si
atom_style sphere
variable i loop 3
variable r equal 0.01
variable m string 1e-3
region box block 0 1 -1 1 -1 1 units box
create_box 2 box
label again
create_atoms 1 single $(0.1+2*v_r*v_i:%.6f) 0 0 units box
next i
jump SELF again
set atom 1*3 mass ${m} diameter $(2*v_r)
group left id 1:2
if "${r} > 0 && 1 == 1" then "velocity left set 0.5 0 0 units box" else "run 0"
pair_style granular
pair_coeff * * hertz 1e9 0 tangential linear_nohistory 0 0 damping velocity
fix 1 all nve
fix g all gravity 9.81 vector 1 0 0
include more
timestep 1e-6
run 100
"""


def _more_of_deck(which: str) -> Callable[[Path], None]:
    def prepare(folder: Path) -> None:
        db.write_deck(PAIR, folder, dt=1e-6)
        (folder / "more").write_text("variable k equal 3\nthermo 10\n")
        (folder / f"{which}.pair").unlink()

    return prepare


def _read_deck_of(path: Path) -> object:
    return db.scene_from_deck(path.with_name("in.pair"))


def _netcdf() -> list[bytes]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "theirs.nc")
        with h5py.File(path, "w", libver="latest") as file:
            file["time"] = np.arange(5) * 1e-5
            file["velocity"] = _VELOCITY
            file["velocity"].attrs["units"] = "m/s"
        theirs = path.read_bytes()
        with netcdf_file(path, "w") as old:
            old.createDimension("time", 5)
            old.createDimension("body", 2)
            old.createVariable("time", "f8", ("time",))[:] = np.arange(5) * 1e-5
            old.createVariable("velocity", "f8", ("time", "body"))[:] = _VELOCITY
            old.variables["velocity"].units = "m/s"
        return [_written("nc"), theirs, path.read_bytes()]


def _of_netcdf(rng: Rng, data: bytes) -> bytes:
    """Return changed bytes among the first ones, which describe the file."""
    end = rng.choice((200, 1000, 4000, len(data)))
    return of_bytes(rng, data[:end]) + data[end:] if rng.random() < 0.3 else _overwritten(rng, data, end)


def _overwritten(rng: Rng, data: bytes, end: int) -> bytes:
    out = bytearray(data)
    for _ in range(rng.choice((1, 2, 5, 20))):
        out[rng.randrange(min(end, len(out)))] = rng.choice((0, 1, 255, rng.randrange(256)))
    return bytes(out)


def _read_netcdf(path: Path) -> None:
    try:
        db.load_trajectory(path)
    except UsageError:
        db.read_trajectory(path, PAIR)


def _traj() -> list[bytes]:
    from ase import Atoms
    from ase.io.trajectory import Trajectory

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "run.traj")
        with Trajectory(str(path), "w") as file:
            for k in range(3):
                atoms = Atoms("H2", positions=[[8e-6 * k, 0, 0], [0.02, 0, 0]], masses=PAIR.mass)
                atoms.set_momenta([[0.8 * PAIR.mass[0], 0, 0], [0, 0, 0]])
                atoms.info |= {"Time": 1e-5 * k, "units": "si"}
                file.write(atoms)
        return [path.read_bytes()]


def _npz() -> list[bytes]:
    stream = io.BytesIO()
    np.savez(stream, time=np.arange(5) * 1e-5, velocity=_VELOCITY, dt=1e-6)
    packed = io.BytesIO()
    np.savez_compressed(packed, t=np.arange(5.0), v=np.ones((5, 2, 3), dtype=np.float32))
    plain = io.BytesIO()
    np.save(plain, np.hstack([1e-5 * np.arange(5.0)[:, None], _VELOCITY]))
    return [stream.getvalue(), packed.getvalue(), plain.getvalue()]


def _vtk() -> list[bytes]:
    points = "0 0 0\n0.02 0 0\n"
    legacy = "# vtk DataFile Version 3.0\nrun\nASCII\nDATASET POLYDATA\nFIELD FieldData 1\nTIME 1 1 double\n1e-5\n"
    legacy += f"POINTS 2 double\n{points}POINT_DATA 2\n"
    legacy += "SCALARS id int 1\nLOOKUP_TABLE default\n1\n2\nVECTORS velocity double\n0.8 0 0\n0 0 0\n"
    legacy += "FIELD FieldData 1\nradius 1 2 double\n0.01 0.01\n"
    xml = '<?xml version="1.0"?><VTKFile type="PolyData" version="0.1" byte_order="LittleEndian"><PolyData><FieldData>'
    xml += '<DataArray type="Float64" Name="TimeValue" NumberOfTuples="1" format="ascii">1e-5</DataArray></FieldData>'
    xml += '<Piece NumberOfPoints="2"><Points><DataArray type="Float64" NumberOfComponents="3" format="ascii">'
    xml += f'{points}</DataArray></Points><PointData><DataArray type="Float64" Name="velocity" NumberOfComponents="3" '
    xml += 'format="binary">MAAAAJqZmZmZmek/AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA==</DataArray>'
    xml += "</PointData></Piece></PolyData></VTKFile>"
    return [legacy.encode(), xml.encode()]


def _tables() -> list[bytes]:
    rows = "\n".join(f"{k * 1e-5:.6g} {0.8 - 0.1 * k:.6g} {0.05 * k:.6g}" for k in range(8))
    return [
        f"# dt = 1e-6 s\n# t v0 v1\n{rows}\n".encode(),
        f"time [s];velocity 0 [m/s];velocity 1 [m/s]\n{rows.replace(' ', ';').replace('.', ',')}\n".encode(),
        f"# dt = 1e-6\nstep,v_0_m_per_s,v_1_m_per_s\n{rows.replace(' ', ',')}\n".encode(),
    ]


def _measured() -> list[bytes]:
    return [b"# laser\ntime_s,velocity_1_m_per_s,uncertainty_m_per_s\n1e-5,0.1,0.01\n2e-5,0.2,0.01\n5e-5,,0.01\n"]


def _baselines() -> list[bytes]:
    return [(_REPORT / "baselines" / "decelerating-40.verlet.json").read_bytes()]


@cache
def _verdicts() -> list[bytes]:
    record = json.loads((_REPORT / "paper" / "verdicts.json").read_text(encoding="utf-8"))
    record["verdicts"], record["claims"] = record["verdicts"][:3], record["claims"][:2]
    record["provenance"]["runs"] = record["provenance"]["runs"][:2]
    return [json.dumps({key: record[key] for key in ("schema", "verdicts", "claims", "provenance")}).encode()]


def _read_verdicts(path: Path) -> None:
    whole = json.loads(_verdicts()[0])
    changed = replay.read_record(path, replay.REPORT)
    for pair in ((whole, changed), (changed, whole)):
        list(replay.compared(pair[0], pair[1], []))


_MARK = {"schema": "dem-bridge/bundle/1", "verify": ["pair"], "not_replayed": [], "python": "3.11"}


def _bundle(folder: Path) -> None:
    (folder / "bundle.json").write_text(json.dumps(_MARK))
    (folder / "a.txt").write_text("a")
    (folder / "SHA256SUMS").write_text(f"{hashlib.sha256(b'a').hexdigest()}  a.txt\n")


def _read_bundle(path: Path) -> None:
    check_bundle(path.parent)
    replay.altered(path.parent)
    replay.read_record(path.parent / "bundle.json", {"verify": [str], "not_replayed": [str]})


def _entries() -> list[bytes]:
    with tempfile.TemporaryDirectory() as folder:
        store = Store(folder)
        store.save(_KEY, _run())
        return [Path(folder, f"{_KEY}.run").read_bytes().partition(b"\n")[2]]


def _with_sum(content: bytes) -> bytes:
    return hashlib.sha256(content).hexdigest().encode() + b"\n" + content


def _of_entry(rng: Rng, data: bytes) -> bytes:
    head, _, body = data.partition(b"\n")
    return of_json(rng, head) + b"\n" + body if rng.random() < 0.7 else of_bytes(rng, data)


def _read_entry(path: Path) -> None:
    store = Store(path.parent)
    store._same_code_until = float("inf")
    list(entries(store))
    if store.load(_KEY, PAIR) is None:
        raise UsageError("the entry is computed again")


def _read_run(path: Path) -> object:
    return db.read_trajectory(path, PAIR)


def _judged(path: Path) -> object:
    settings: dict[str, Any] = random.Random(path.stat().st_size).choice(
        [
            {},
            {"dt": 1e-6},
            {"units": "metal"},
            {"axis": "y"},
            {"bodies": [1, 0]},
            {"columns": {"v0": "velocity 1 [mm/s]"}},
        ]
    )
    with suppress(UsageError):
        read_record(path, PAIR, **settings)
    return read_record(path, PAIR)


def _read_measured(path: Path) -> Any:
    return pytest.importorskip("dem_bridge.studies.measurement.readings").read_measurement([path], PAIR)


def _any_run() -> list[bytes]:
    return [_written("lammpstrj"), _written("extxyz"), _written("csv"), *_netcdf()[1:], *_tables(), *_vtk(), *_npz()]


TARGETS = {
    "scene": Target(_small_scenes, "scene.toml", db.load_scene, prepare=_force),
    "scene CSV": Target(_scene_csv, "scene.csv", lambda path: db.scene_from_csv(path, duration=1e-4)),
    "drive CSV": Target(lambda: [b"time,force\n0,0\n5e-5,1.5\n1e-4,-0.5\n"], "force.csv", read_force),
    "deck": Target(_deck("in"), "in.pair", db.scene_from_deck, prepare=_more_of_deck("in")),
    "data of a deck": Target(
        _deck("data"), "data.pair", _read_deck_of, prepare=_more_of_deck("data")
    ),
    "dump": Target(lambda: [_written("lammpstrj")], "run.lammpstrj", _read_run),
    "extxyz": Target(lambda: [_written("extxyz")], "run.extxyz", _read_run),
    "traj": Target(_traj, "run.traj", _read_run, structure=_of_netcdf),
    "trajectory CSV": Target(
        lambda: [_written("csv"), _written("csv", layout="wide"), *_tables()], "run.csv", _read_run
    ),
    "netCDF": Target(_netcdf, "run.nc", _read_netcdf, structure=_of_netcdf),
    "npz, npy": Target(_npz, "run.npz", _judged, structure=_of_netcdf),
    "VTK": Target(_vtk, "run.vtk", _judged),
    "files to judge": Target(_any_run, "run.txt", _judged),
    "baseline": Target(_baselines, "decelerating-40.verlet.json", read_baseline, structure=of_json),
    "verdicts": Target(_verdicts, "verdicts.json", _read_verdicts, structure=of_json, refusals=(ValueError,)),
    "bundle": Target(
        lambda: [json.dumps(_MARK).encode()], "bundle.json", _read_bundle, of_json, _bundle, refusals=(ValueError,)
    ),
    "sums of a bundle": Target(
        lambda: [f"{hashlib.sha256(b'a').hexdigest()}  a.txt\n".encode()],
        "SHA256SUMS", _read_bundle, prepare=_bundle, refusals=(ValueError,),
    ),
    "store entry": Target(_entries, f"{_KEY}.run", _read_entry, structure=_of_entry, finish=_with_sum),
}  # fmt: skip
if find_spec("dem_bridge.studies"):  # its reader is that of a study
    TARGETS["measured CSV"] = Target(_measured, "laser.csv", _read_measured)
