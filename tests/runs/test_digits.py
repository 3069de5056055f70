"""The fingerprint of the last digits of a place changes exactly when digits do, and keys have that of the place."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor, Future
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.foundation import kernel_folders
from dem_bridge.runs import digits
from dem_bridge.runs.campaign import run_cases
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import SUFFIX, Store
from tests.helpers.three_bodies import THREE

_CODE = """
import json, sys
from dem_bridge.runs import digits
from dem_bridge.runs.keys import run_key
from dem_bridge.backends.base import Resolution, Sampling
from tests.helpers.three_bodies import THREE
probes = dict(digits.probes())
key = run_key(THREE, "reference", Resolution(), Sampling(count=3))
print(json.dumps({"probes": probes, "whole": digits.fingerprint(), "key": key, "numba": "numba" in sys.modules}))
"""
#: settings that choose other routines, where a machine has them
_OTHER_DIGITS: Mapping[str, Mapping[str, str]] = {
    "C library without AVX2 and FMA": {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA"},
    "linear algebra of Prescott": {"OPENBLAS_CORETYPE": "Prescott"},
    "linear algebra of Nehalem": {"OPENBLAS_CORETYPE": "Nehalem"},
    "numpy without dispatch": {"NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR"},
    "numpy with AVX2 alone": {"NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR"},
}
#: settings that change no digits
_SAME_DIGITS: Mapping[str, Mapping[str, str]] = {
    "threads, hashes and names": {"OMP_NUM_THREADS": "4", "PYTHONHASHSEED": "7", "UNRELATED": "1"},
    "one thread": {"OMP_NUM_THREADS": "1", "PYTHONHASHSEED": "1"},
}  # fmt: skip


@cache
def _in_process(**settings: str) -> dict[str, Any]:
    """Return probes, fingerprint and key of a process with these settings."""
    root = Path(__file__).resolve().parents[2]
    clean = {name: value for name, value in os.environ.items() if name not in {key for s in _ALL for key in s}}
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", _CODE],
        env={**clean, "PYTHONPATH": str(root), **settings},
        check=True,
        capture_output=True,
        text=True,
    )
    return dict(json.loads(done.stdout))


_ALL = (*_OTHER_DIGITS.values(), *_SAME_DIGITS.values())


@pytest.mark.parametrize("settings", [
    pytest.param(settings, id=name, marks=[] if place in (0, 5) else pytest.mark.slow)
    for place, (name, settings) in enumerate({**_OTHER_DIGITS, **_SAME_DIGITS}.items())
])  # fmt: skip
def test_the_key_changes_exactly_when_digits_do(settings: Mapping[str, str]) -> None:
    plain, other = _in_process(), _in_process(**settings)
    changed = {name for name in plain["probes"] if plain["probes"][name] != other["probes"][name]}
    if settings in _SAME_DIGITS.values():
        assert not changed
    # a processor without the features that are switched off has the same digits, and the same key
    assert (plain["whole"] != other["whole"]) is bool(changed)
    assert (plain["key"] != other["key"]) is bool(changed)


def test_a_process_that_plans_runs_does_not_import_the_compiler() -> None:
    _in_process()
    _in_process.cache_clear()
    assert _in_process()["numba"] is False


def test_every_probe_is_of_something_else() -> None:
    probes = digits.probes()
    assert len(probes) > 50
    assert len(set(probes.values())) == len(probes)
    assert probes == digits.probes()


_FUNCTIONS = [("math", name) for name in (*digits._OF_ONE, *digits._OF_TWO)] + [
    ("numpy", name) for name in (*digits._LOOPS, *digits._LOOPS_OF_TWO, *digits._SUMS, "dot")
] + [("numpy.linalg", name) for name in ("solve", "eigvals", "eigh", "lstsq", "svd", "cholesky")]  # fmt: skip


def test_a_last_digit_of_any_function_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    before = digits.probes()
    for module, name in _FUNCTIONS:
        place = sys.modules[module]
        real = getattr(place, name)

        def other(*arguments: Any, real: Any = real, **keywords: Any) -> Any:
            answer = real(*arguments, **keywords)
            first, *rest = answer if isinstance(answer, tuple) else (answer,)
            return (np.nextafter(first, np.float32(9.0)) if np.isrealobj(first) else first * (1 + 2**-52), *rest)

        with monkeypatch.context() as patch:
            wrapped = other if name in ("eigh", "lstsq") else lambda *a, _f=other, **k: _f(*a, **k)[0]
            patch.setattr(place, name, wrapped)
            after = digits.probes()
        kind = "C" if module == "math" else "numpy" if module == "numpy" else "algebra"
        assert (
            before[f"{kind} {name.replace('eigvals', 'eig')}"] != after[f"{kind} {name.replace('eigvals', 'eig')}"]
        ), name


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Keep what compiled code computes in an empty folder."""
    monkeypatch.setenv(kernel_folders.VARIABLE, str(tmp_path))
    kernel_folders.folder_to_write.cache_clear()
    kernel_folders.folders_to_read.cache_clear()
    yield kernel_folders.folder_in(tmp_path)
    kernel_folders.folder_to_write.cache_clear()
    kernel_folders.folders_to_read.cache_clear()


@pytest.mark.parametrize("damage", ["", "x", "0" * 40, f"{'0' * 40} {'0' * 40}", "\0" * 100])
def test_what_compiled_code_computes_is_computed_again_if_it_is_damaged(folder: Path, damage: str) -> None:
    right = digits.compiled_digits("some digits")
    [file] = folder.glob(f"{digits._PREFIX}*")
    file.write_text(damage, encoding="ascii")
    assert digits.compiled_digits("some digits") == right
    assert file.read_text(encoding="ascii").startswith(right)
    file.chmod(0o666)
    file.write_text(f"another {digits.digest_of({file.name: 'another'})}", encoding="ascii")
    assert digits.compiled_digits("some digits") == right


def test_other_digits_of_the_compiled_probe_are_another_fingerprint(monkeypatch: pytest.MonkeyPatch) -> None:
    before = digits.digits_of_place.__wrapped__()
    monkeypatch.setattr(digits, "compiled_digits", lambda interpreted: "another")
    assert digits.digits_of_place.__wrapped__() != before


class Elsewhere(Executor):
    """Run calls in this process as a machine would that has other digits; ``places``: that of each call in turn."""

    def __init__(self, *places: str) -> None:
        self._places, self.calls = places, 0

    def submit(self, function: Any, /, *arguments: Any, **keywords: Any) -> Future[Any]:
        future: Future[Any] = Future()
        place = self._places[min(self.calls, len(self._places) - 1)]
        self.calls += 1
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(digits, "digits_of_place", lambda: place)
            future.set_result(function(*arguments, **keywords))
        return future


def _cases() -> list[Case]:
    return [
        Case(scene=THREE, backend="verlet", resolution=Resolution(dt=dt), sampling=Sampling(count=3), uncertainty=False)
        for dt in (1e-6, 2e-6)
    ]


def _stored(folder: Path) -> set[str]:
    return {file.stem for file in folder.glob(f"*{SUFFIX}")}


def _keys(place: str) -> set[str | None]:
    with digits.made_at(place):
        return {case.key for case in _cases()}


def test_runs_of_another_machine_are_under_its_fingerprint(tmp_path: Path) -> None:
    workers = Elsewhere("a" * 40)
    results = run_cases(_cases(), jobs=workers, store=Store(tmp_path))
    assert {result.key for result in results} == _stored(tmp_path) == _keys("a" * 40)
    assert not _keys("") & _stored(tmp_path)
    # they are found by the next campaign there, and not by one here
    calls = workers.calls
    run_cases(_cases(), jobs=workers, store=Store(tmp_path))
    assert workers.calls == calls + 1  # the fingerprint
    assert {result.key for result in run_cases(_cases(), store=Store(tmp_path))} == _keys("")
    assert _stored(tmp_path) == _keys("") | _keys("a" * 40)


@pytest.mark.parametrize("shared", [True, False])
def test_a_cluster_of_several_kinds_of_machines_mixes_no_keys(tmp_path: Path, shared: bool) -> None:
    planned, made = "a" * 40, "b" * 40
    # the fingerprint, the look at the folder, the runs
    places = (planned, planned, made) if shared else (planned, made)
    workers = Elsewhere(*places)
    if not shared:
        real = workers.submit

        def submit(function: Any, /, *arguments: Any, **keywords: Any) -> Future[Any]:
            return real((lambda path: False) if function is os.path.exists else function, *arguments, **keywords)

        workers.submit = submit  # type: ignore[method-assign]
    results = run_cases(_cases(), jobs=workers, store=Store(tmp_path))
    assert {result.key for result in results} == _stored(tmp_path) == _keys(made)
