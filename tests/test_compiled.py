"""Kept kernels are never older than what they are made of."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numba
import pytest

from dem_bridge.backends.curves import POWERS, curves_of
from dem_bridge.compiled import forget_stale, kernel
from dem_bridge.scene import Scene, Wall


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """Two modules with a kernel each, made at 100 s and 200 s, and kept at 300 s."""
    for part, age in (("lmp/cell", 100.0), ("backends/twin", 200.0)):
        source = tmp_path / f"{part}.py"
        kept = source.parent / "__pycache__" / f"{source.stem}.kernel-7.py311.nbi"
        kept.parent.mkdir(parents=True)
        for file, when in ((source, age), (kept, 300.0)):
            file.touch()
            os.utime(file, (when, when))
    return tmp_path


def _kept(package: Path) -> set[str]:
    return {file.name.split(".")[0] for file in package.glob("**/*.nbi")}


def test_what_is_younger_than_all_sources_is_kept(package: Path) -> None:
    forget_stale(package)
    assert _kept(package) == {"cell", "twin"}


def test_a_change_in_one_file_forgets_the_kernels_of_all(package: Path) -> None:
    os.utime(package / "lmp" / "cell.py", (400.0, 400.0))
    forget_stale(package)
    assert _kept(package) == set()


def test_a_kernel_that_was_made_after_the_change_is_kept(package: Path) -> None:
    os.utime(package / "lmp" / "cell.py", (400.0, 400.0))
    [kept] = package.glob("**/twin*.nbi")
    os.utime(kept, (500.0, 500.0))
    forget_stale(package)
    assert _kept(package) == {"twin"}


def test_a_package_without_kernels_is_left_alone(tmp_path: Path) -> None:
    forget_stale(tmp_path)
    assert not list(tmp_path.iterdir())


@kernel(nogil=False)
def _square(number):  # type: ignore[no-untyped-def]
    return number * number


@kernel()
def _cube(number):  # type: ignore[no-untyped-def]
    return number * _square(number)


def test_a_kernel_calls_another_and_is_compiled_when_it_is_called() -> None:
    assert vars(_cube)["__name__"] == "_cube"
    assert (_cube(3.0), _cube.py_func(3.0)) == (27.0, 27.0)
    assert [one.compiled.signatures for one in (_square, _cube)] == [[(numba.float64,)]] * 2


@pytest.mark.parametrize("backend", ["lammps", "verlet", "reference", "scipy_dop853"])
def test_a_backend_is_imported_without_numba(backend: str) -> None:
    code = f"import sys, dem_bridge.backends.{backend}; sys.exit('numba' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_walls_and_laws_need_no_kernels_of_their_own() -> None:
    plain = Scene(name="three", duration=1e-5, mass=(1e-2,) * 3, stiffness=(4e9,) * 2, velocity=(0.8, 0.0, 0.0))
    walled = replace(plain, wall_left=Wall(stiffness=4e9), wall_right=Wall(stiffness=4e9))
    of_walls, of_all = (numba.typeof((c.left, c.right)) for c in (walled.contacts, plain.contacts))
    assert of_walls == of_all
    law = replace(plain, law=lambda overlap: 4e9 * overlap**1.5)
    assert numba.typeof(curves_of(law)) == numba.typeof(POWERS)


@pytest.mark.parametrize("cause", [KeyboardInterrupt, ValueError])
def test_ctrl_c_at_the_end_of_a_compiled_function_is_that_and_no_system_error(cause: type[BaseException]) -> None:
    def returned_with_an_exception_set() -> None:
        raise SystemError("returned a result with an exception set") from cause()

    one = kernel()(returned_with_an_exception_set)
    one.__dict__["compiled"] = returned_with_an_exception_set
    with pytest.raises(KeyboardInterrupt if cause is KeyboardInterrupt else SystemError):
        one()
