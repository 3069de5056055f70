"""Kernels are compiled when they are called, and numba is imported then."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numba
import pytest

from dem_bridge.backends.curves import POWERS, curves_of
from dem_bridge.foundation.compiled import kernel, side_by_side
from dem_bridge.foundation.stopwatch import cpu_time
from dem_bridge.scene.scene import Scene, Wall


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


#: runs with its path in the first argument, for a kernel needs a file
LEAN = """
import sys
import numpy as np
from dem_bridge.foundation.compiled import kernel


@kernel()
def plain(rows):
    return rows[0, 0] + 1.0


@kernel()
def product(rows):
    return np.dot(rows, rows.T)[0, 1] + np.cov(rows)[0, 1]


rows = np.array([[1.0, 2.0], [3.0, 5.0]])
assert plain(rows) == 2.0
assert not {"coverage", "scipy.linalg"} & set(sys.modules)
assert product(rows) == 14.0
assert "scipy.linalg" in sys.modules
import coverage
"""


def test_the_first_kernel_imports_no_linear_algebra_and_a_kernel_that_needs_it_does(tmp_path: Path) -> None:
    (tmp_path / "lean.py").write_text(LEAN, encoding="utf-8")
    done = subprocess.run([sys.executable, str(tmp_path / "lean.py")], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_function_is_interpreted_with_those_that_it_calls() -> None:
    # of numbers that numba does not know
    assert _cube.interpret(Fraction(2, 3)) == Fraction(8, 27)


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


@pytest.mark.parametrize("cores", [1, 2, 7])
def test_work_side_by_side_has_the_order_of_its_items_and_all_its_cpu_time(
    monkeypatch: pytest.MonkeyPatch, cores: int
) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: set(range(cores)))
    threads = set()

    def spun(item: int) -> int:
        threads.add(threading.get_ident())
        end = time.thread_time() + 0.02
        while time.thread_time() < end:
            pass
        return 10 * item

    before = cpu_time()
    assert side_by_side(spun, range(5)) == [0, 10, 20, 30, 40]
    assert 0.1 <= cpu_time() - before < 0.2
    assert len(threads) <= min(cores, 5)
    assert (len(threads) > 1) is (cores > 1)
    assert side_by_side(spun, []) == []
    with pytest.raises(ZeroDivisionError):
        side_by_side(lambda item: 1 // item, [3, 2, 1, 0])
