"""Compiled kernels are kept under their content, never loaded when damaged, and never needed."""

from __future__ import annotations

import os
import pickle
import random
import shutil
import stat
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numba
import pytest

from dem_bridge.cli import doctor
from dem_bridge.foundation import kernel_cache, kernel_folders
from dem_bridge.foundation.compiled import Kernel, kernel

ROOT = Path(__file__).resolve().parents[2]
FACTOR = 3.0


@kernel(nogil=False)
def _scaled(number):  # type: ignore[no-untyped-def]
    return FACTOR * number


@kernel(nogil=False)
def _halved(number):  # type: ignore[no-untyped-def]
    return 0.5 * number


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Keep kernels in an empty folder."""
    monkeypatch.setenv(kernel_folders.VARIABLE, str(tmp_path / "cache"))
    _forget()
    folder = kernel_folders.folder_to_write()
    assert folder == tmp_path / "cache" / f"kernels-{os.geteuid()}"
    yield folder
    _forget()


def _forget() -> None:
    """Look for the folders anew, as another process would."""
    for function in (kernel_folders.folder_to_write, kernel_folders.folders_to_read, kernel_cache._say_once):
        function.cache_clear()


def _called(function: Kernel = _scaled) -> float:
    """Call a kernel as another process would: from disk, or compiled."""
    return float(Kernel(function.py_func, nogil=False)(2.0))


def _kept(folder: Path) -> list[Path]:
    return sorted(folder.glob(f"*{kernel_folders.SUFFIX}"))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, bytes]:
    """Name and content of a file with a kernel, which is compiled once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(kernel_folders.VARIABLE, str(tmp_path_factory.mktemp("once")))
        _forget()
        assert _called() == 6.0
        [path] = _kept(kernel_folders.folders_to_read()[0])
        _forget()
        return path.name, path.read_bytes()


def test_a_kernel_is_loaded_and_not_compiled_again(folder: Path, whole: tuple[str, bytes]) -> None:
    name, content = whole
    (folder / name).write_bytes(content)
    first = Kernel(_scaled.py_func, nogil=False)
    assert first(2.0) == 6.0
    assert list(first.compiled.stats.cache_hits.values()) == [1]
    assert first.compiled.stats.cache_path == str(folder)


def _cut(content: bytes, share: float) -> bytes:
    return content[: int(share * len(content))]


def _flipped(content: bytes, at: int) -> bytes:
    return content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :]


def _bomb() -> bytes:
    return pickle.dumps(pytest.fail)


def _signed(name: str, content: bytes) -> bytes:
    return kernel_folders.checksum(name, content) + content


def _damage(name: str, content: bytes) -> Iterator[tuple[str, bytes]]:
    """Yield what may be in place of a file."""
    yield "empty", b""
    yield "without its first byte", content[1:]
    yield "without its checksum", content.partition(b"\n")[2]
    yield "a byte more", content + b"\0"
    yield "zeros", bytes(len(content))
    yield "a text", b"x" * len(content)
    yield "random bytes", random.Random(1).randbytes(len(content))
    yield "a pickle of something else", pickle.dumps(pytest.fail)
    yield "another kernel", _signed("another", content.partition(b"\n")[2])
    yield "twice", content + content
    for at in (1, 2, 10, 63, 64, 65, 66, 67, 80):
        yield f"cut at byte {at}", content[:at]
    for percent in range(4, 100, 4):
        yield f"cut at {percent} %", content[: len(content) * percent // 100]
    for at in (0, 1, 63, 64, 65, 66, 100, -1, -9, *(len(content) * tenth // 10 for tenth in range(1, 10))):
        yield f"flipped at byte {at}", content[:at] + bytes([content[at] ^ 1]) + content[len(content[:at]) + 1 :]
    # whoever can write a checksum can write anything; but these are no kernels
    yield "signed: a number", _signed(name, b"1")
    yield "signed: a list", _signed(name, pickle.dumps([1, 2]))
    yield "signed: a class that is not there", _signed(name, b"cnowhere\nX\n.")


def test_nothing_of_a_damaged_file_is_loaded(whole: tuple[str, bytes]) -> None:
    name, content = whole
    assert kernel_folders.checked(name, content)
    damage = dict(_damage(name, content))
    assert len(damage) > 60
    for kind, damaged in damage.items():
        assert damaged != content, kind
        if not kind.startswith("signed"):
            with pytest.raises(ValueError, match="its checksum does not fit"):
                kernel_folders.checked(name, damaged)


def _is_replaced(folder: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Check that what is in place of a file is set aside in one line, compiled anew, and named by the doctor."""
    assert doctor.numba_cache().fine is False
    assert name in doctor.numba_cache().state
    assert _called() == 6.0
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1, lines
    assert f"the compiled kernel {folder / name} is damaged (" in lines[0]
    assert [path.name for path in _kept(folder)] == [name]
    [aside] = folder.glob(f"*{kernel_folders.DAMAGED}")
    found = doctor.numba_cache()
    assert (found.fine, found.needed, str(found).split()[0]) == (False, False, "DEFECT")
    assert aside.name in found.state
    assert _called() == 6.0
    assert not capsys.readouterr().err
    shutil.rmtree(aside) if aside.is_dir() else aside.unlink()
    assert doctor.numba_cache().fine


@pytest.mark.parametrize("every", [15, pytest.param(1, marks=pytest.mark.slow)])
def test_a_damaged_file_is_set_aside_and_compiled_anew(
    folder: Path, whole: tuple[str, bytes], every: int, capsys: pytest.CaptureFixture[str]
) -> None:
    name, content = whole
    for kind, damaged in list(_damage(name, content))[::every]:
        _forget()
        (folder / name).write_bytes(damaged)
        if not kind.startswith("signed"):
            _is_replaced(folder, name, capsys)
            continue
        # it has the right checksum, which the doctor looks at, and fails when it is loaded
        assert _called() == 6.0
        assert "is damaged (" in capsys.readouterr().err
        for path in folder.glob(f"*{kernel_folders.DAMAGED}"):
            path.unlink()
        assert doctor.numba_cache().fine


@pytest.mark.parametrize("kind", ["folder", "full folder", "pipe", "link to nothing", "others may write", "unreadable"])
def test_what_is_no_safe_file_is_set_aside(
    folder: Path, whole: tuple[str, bytes], kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    name, content = whole
    path = folder / name
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "link to nothing":  # the same as no file
        path.symlink_to("nowhere")
        assert _called() == 6.0
        assert path.read_bytes()
        return
    elif "folder" in kind:
        path.mkdir()
        if kind == "full folder":
            (path / "file").touch()
    else:
        path.write_bytes(content)
        path.chmod(0o666 if kind == "others may write" else 0o000)
        if kind == "unreadable" and os.access(path, os.R_OK):
            pytest.skip("this user can read every file")
    _is_replaced(folder, name, capsys)


def test_a_folder_that_another_user_can_write_is_not_used(
    folder: Path, whole: tuple[str, bytes], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    name, _ = whole
    bomb = b"cos\nabort\n(tR."  # ends the process that loads it
    (folder / name).write_bytes(kernel_folders.checksum(name, bomb) + bomb)
    for mode in (0o777, 0o775, 0o757):
        folder.chmod(mode)
        _forget()
        assert folder not in kernel_folders.folders_to_read()
        assert kernel_folders.folder_to_write() != folder
    assert "another user can write to it" in doctor.numba_cache().state
    folder.chmod(0o755)
    if os.geteuid() == 0:
        os.chown(folder, 12345, -1)
        _forget()
        assert folder not in kernel_folders.folders_to_read()


def test_folders_are_read_up_to_the_first_that_can_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, whole: tuple[str, bytes]
) -> None:
    name, content = whole
    monkeypatch.delenv(kernel_folders.VARIABLE, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(kernel_folders, "PACKAGE", tmp_path)
    package = kernel_folders.folder_in(tmp_path / "__pycache__")
    package.mkdir(parents=True)
    (package / name).write_bytes(content)
    home = kernel_folders.folder_in(tmp_path / "dem-bridge")
    try:
        for fault, folders in (("", (package,)), ("Read-only file system", (home, package))):
            monkeypatch.setattr(
                kernel_folders, "write_fault", lambda folder, f=fault: f if folder == package else _made(folder)
            )
            _forget()
            assert kernel_folders.folders_to_read() == folders
            first = Kernel(_scaled.py_func, nogil=False)
            assert first(2.0) == 6.0
            assert list(first.compiled.stats.cache_hits.values()) == [1]
        # a folder that is named is the only one
        monkeypatch.setenv(kernel_folders.VARIABLE, str(tmp_path / "named"))
        _forget()
        assert kernel_folders.folders_to_read() == (kernel_folders.folder_in(tmp_path / "named"),)
    finally:
        _forget()


def _made(folder: Path) -> str:
    folder.mkdir(parents=True, exist_ok=True)
    return ""


def test_folders_and_files_can_be_written_by_their_owner_alone(folder: Path) -> None:
    old = os.umask(0)
    try:
        shutil.rmtree(folder)
        _forget()
        assert _called() == 6.0
    finally:
        os.umask(old)
    [path] = _kept(folder)
    assert (stat.S_IMODE(folder.stat().st_mode), stat.S_IMODE(path.stat().st_mode)) == (0o755, 0o644)


@pytest.fixture
def nowhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Leave no folder that can be written: each would be below a file."""
    file = tmp_path / "file"
    file.touch()
    monkeypatch.setattr(kernel_folders, "PACKAGE", file)
    monkeypatch.setenv("HOME", str(file / "home"))
    monkeypatch.setenv(kernel_folders.VARIABLE, str(file / "named"))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    _forget()
    yield tmp_path
    _forget()


def test_without_a_folder_kernels_are_in_a_temporary_one(
    nowhere: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(nowhere))
    assert _called() == 6.0
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith("dem-bridge: compiled kernels are not kept, because no folder for them can be written: ")
    assert line.count("(Not a directory)") == 3
    assert line.endswith("; set NUMBA_CACHE_DIR to a folder that you can write")
    temporary = Path(os.environ[kernel_folders.VARIABLE])
    assert stat.S_IMODE(temporary.stat().st_mode) == 0o700
    assert len(_kept(kernel_folders.folder_in(temporary))) == 1
    kernel_folders.remove_own(temporary, os.getpid() + 1)
    assert temporary.exists()
    kernel_folders.remove_own(temporary, os.getpid())
    assert not temporary.exists()


def test_without_any_folder_kernels_are_compiled(
    nowhere: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(nowhere / "file"))
    assert (_called(), _called()) == (6.0, 6.0)
    assert len(capsys.readouterr().err.splitlines()) == 1
    found = doctor.numba_cache()
    assert (found.fine, found.needed) == (False, False)
    assert "no folder can be written" in found.state
    assert "NUMBA_CACHE_DIR" in found.remedy


def test_a_user_without_a_home_has_no_folder_in_the_current_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr("os.path.expanduser", lambda path: path)
    assert all(root.is_absolute() for root in kernel_folders.roots())


def test_a_full_disk_costs_a_line(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(*arguments: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    assert _called() == 6.0
    [line] = capsys.readouterr().err.splitlines()
    assert "cannot be kept (No space left on device)" in line
    assert not list(folder.iterdir())


def test_the_least_recently_used_kernels_are_removed(
    folder: Path, whole: tuple[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    name, content = whole
    monkeypatch.setattr(kernel_folders, "MOST_FILES", 5)
    (folder / name).write_bytes(content)
    for age in range(1, 9):
        (folder / f"older-{age}{kernel_folders.SUFFIX}").touch()
        os.utime(folder / f"older-{age}{kernel_folders.SUFFIX}", (1e9 - age, 1e9 - age))
    os.utime(folder / name, (0.0, 0.0))
    assert _called() == 6.0  # it is used now
    assert _called(_halved) == 1.0  # it is compiled
    assert {path.name.rpartition("-")[2] for path in _kept(folder)} >= {
        "1.nbc",
        "2.nbc",
        "3.nbc",
        name.rpartition("-")[2],
    }
    assert len(_kept(folder)) == 5


def test_a_setting_of_numba_is_content_if_it_changes_code(monkeypatch: pytest.MonkeyPatch) -> None:
    before = kernel_cache.environment()
    changes = {
        "OPT": 1,
        "LOOP_VECTORIZE": 0,
        "SLP_VECTORIZE": 1,
        "BOUNDSCHECK": 1,
        "CPU_NAME": "generic",
        "CPU_FEATURES": "",
        "ENABLE_AVX": 0,
        "DISABLE_INTEL_SVML": 1,
        "DEBUGINFO_DEFAULT": 1,
    }
    others = {
        "NUMBA_NUM_THREADS": 99,
        "THREADING_LAYER": "x",
        "SHOW_HELP": 9,
        "CACHE_DIR": "x",
        "DUMP_IR": 9,
        "TRACE": 9,
    }
    for name, value in {**changes, **others}.items():
        with monkeypatch.context() as patch:
            patch.setattr(numba.config, name, value)
            assert (kernel_cache.environment() != before) is (name in changes), name


_MODULES = {
    "ours_a.py": "from dem_bridge.foundation.compiled import kernel\nfrom ours_b import HALF, middle\n\n"
    "@kernel()\ndef top(x):\n    return middle(x) + HALF\n",
    "ours_b.py": "from dem_bridge.foundation.compiled import kernel\nfrom ours_c import lowest\n\nHALF = 0.5\n\n"
    "@kernel()\ndef middle(x):\n    return 10.0 * lowest(x)\n",
    "ours_c.py": "from dem_bridge.foundation.compiled import kernel\n\n@kernel()\ndef lowest(x):\n    return x + 1.0\n",
}


def _top(folder: Path) -> tuple[float, int]:
    """Return what the kernel of three modules returns in a process of its own, and how often it was compiled."""
    code = "import ours_a; print(ours_a.top(2.0), sum(ours_a.top.compiled.stats.cache_misses.values()))"
    env = {**os.environ, "PYTHONPATH": f"{folder}:{ROOT}", kernel_folders.VARIABLE: str(folder / "cache")}
    done = subprocess.run([sys.executable, "-c", code], env=env, check=True, capture_output=True, text=True)
    value, compiled = done.stdout.split()
    return float(value), int(compiled)


def _folder(folder: Path) -> Path:
    return kernel_folders.folder_in(folder / "cache")


def _write(folder: Path, **changes: tuple[str, str]) -> None:
    """Write the modules, with changes, all with the times of an old archive."""
    for name, text in _MODULES.items():
        path = folder / name
        path.write_text(text.replace(*changes.get(path.stem, ("", ""))), encoding="utf-8")
        os.utime(path, (1e9, 1e9))


def test_a_changed_helper_is_never_stale_whatever_its_time(tmp_path: Path) -> None:
    _write(tmp_path)
    assert _top(tmp_path) == (30.5, 1)
    _write(tmp_path, ours_c=("x + 1.0", "x + 1.25"))
    assert _top(tmp_path) == (33.0, 1)
    _write(tmp_path)
    (tmp_path / "ours_c.py").touch()
    assert _top(tmp_path) == (30.5, 0)


@pytest.mark.slow
def test_processes_may_compile_a_kernel_at_once(tmp_path: Path) -> None:
    _write(tmp_path)
    with ThreadPoolExecutor(4) as pool:
        assert [value for value, _ in pool.map(_top, [tmp_path] * 4)] == [30.5] * 4
    assert _top(tmp_path) == (30.5, 0)
    assert [path.suffix for path in _folder(tmp_path).iterdir()] == [kernel_folders.SUFFIX] * 3


@pytest.mark.slow
def test_no_member_of_the_closure_is_stale(tmp_path: Path) -> None:
    _write(tmp_path)
    assert _top(tmp_path) == (30.5, 1)
    for change, value in (
        ({"ours_b": ("HALF = 0.5", "HALF = 0.25")}, 30.25),
        ({"ours_b": ("10.0 * lowest", "100.0 * lowest")}, 300.5),
        ({"ours_a": ("middle(x) + HALF", "middle(x) - HALF")}, 29.5),
        ({"ours_c": ("x + 1.0", "x * 1.0")}, 20.5),
    ):
        _write(tmp_path, **change)
        shutil.rmtree(tmp_path / "__pycache__", ignore_errors=True)
        assert _top(tmp_path) == (value, 1)
        assert _top(tmp_path) == (value, 0)
    # a copy with its cache, at another place
    copy = tmp_path.with_name("copy")
    shutil.copytree(tmp_path, copy)
    assert _top(copy) == (20.5, 0)


#: a kernel with an array and one that hashes a text, which needs numbers of numba beside its memory management
_LOADED = """
import sys
import numpy as np
from numba.core import entrypoints
from dem_bridge.foundation.compiled import kernel


@kernel()
def halves(count):
    return np.full(count, 0.5).sum()


@kernel()
def hashed(text):
    return hash(text)


assert halves(3) == 1.5
prepared = "numba.np.arraymath" in sys.modules, entrypoints._already_initialized
assert hashed("sphere") == hash("sphere")
print(*prepared)
"""


def test_a_kernel_is_loaded_without_the_rules_of_the_compiler(tmp_path: Path) -> None:
    (tmp_path / "loaded.py").write_text(_LOADED, encoding="utf-8")
    environment = {**os.environ, kernel_folders.VARIABLE: str(tmp_path / "cache"), "PYTHONPATH": str(ROOT)}
    for prepared in (True, False):
        done = subprocess.run(
            [sys.executable, "loaded.py"], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert (done.returncode, done.stdout.strip()) == (0, f"{prepared} {prepared}"), done.stderr


_TAKEN_IN = """
import sys
import llvmlite.binding as llvm

read, parse = [], llvm.parse_bitcode
llvm.parse_bitcode = lambda content: read.append(content) or parse(content)
from dem_bridge.foundation.compiled import kernel


@kernel()
def third(number):
    return number / 3.0


@kernel()
def thirds(count):
    total = 0.0
    for number in range(count):
        total += third(float(number))
    return total


assert third(3.0) == 1.0
before = len(read)
if "caller" in sys.argv:
    assert thirds(4) == 2.0
print(before, len(read) - before)
"""


def test_the_code_of_a_loaded_kernel_is_read_only_where_another_one_takes_it_in(tmp_path: Path) -> None:
    (tmp_path / "taken.py").write_text(_TAKEN_IN, encoding="utf-8")
    environment = {**os.environ, kernel_folders.VARIABLE: str(tmp_path / "cache"), "PYTHONPATH": str(ROOT)}

    def read(*words: str) -> str:
        done = subprocess.run(
            [sys.executable, "taken.py", *words], cwd=tmp_path, env=environment, capture_output=True, text=True,
            check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout.strip()

    read()
    assert read() == "0 0"
    assert read("caller") == "0 1"
    assert read("caller") == "0 0"
