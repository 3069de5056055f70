"""Compiled kernels: compiled when first called and when their content has changed, and interruptible while they run."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import cached_property, update_wrapper
from types import FunctionType
from typing import Any, Generic, ParamSpec, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from dem_bridge.foundation.stopwatch import cpu_time, credit

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")
#: arrays that kernels take
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


class Kernel(Generic[P, R]):
    """A function that numba compiles, or loads from its cache, when it is first called.

    numba takes half a second of CPU to import and to prepare for its first kernel. It is therefore imported with the
    first call, which some processes never make and others make after they have started an engine.
    """

    def __init__(self, function: Callable[P, R], nogil: bool) -> None:
        self.py_func, self.nogil = function, nogil
        update_wrapper(self, function)

    @cached_property
    def compiled(self) -> Any:
        """The function as numba compiles it; a loop of a hundred thousand calls calls this directly."""
        # numba imports coverage where it is installed, for 0.1 s
        with _without("coverage"):
            from dem_bridge.foundation.kernel_cache import compile_function

        return compile_function(self.py_func, nogil=self.nogil)

    @property
    def _numba_type_(self) -> Any:
        """Type of the compiled function, which numba needs where one kernel calls another."""
        return self.compiled._numba_type_

    def __call__(self, *arguments: P.args, **named: P.kwargs) -> R:
        """Call the compiled function."""
        try:
            result: R = self.compiled(*arguments, **named)
        except SystemError as error:
            if isinstance(error.__cause__, KeyboardInterrupt):  # Ctrl-C at the moment when the function returned
                raise error.__cause__ from None
            raise
        return result

    def interpret(self, *arguments: P.args, **named: P.kwargs) -> R:
        """Call the function, and the kernels that it calls, without the compiler."""
        return self._interpreted()(*arguments, **named)

    def _interpreted(self) -> Callable[P, R]:
        """Return the function with the functions of the kernels that it calls in place of these."""
        function = cast(FunctionType, self.py_func)
        called = {name: function.__globals__.get(name) for name in function.__code__.co_names}
        kernels = {name: value._interpreted() for name, value in called.items() if isinstance(value, Kernel)}
        return FunctionType(function.__code__, function.__globals__ | kernels, argdefs=function.__defaults__)


@contextmanager
def _without(package: str) -> Iterator[None]:
    """Have a package that is not imported yet not found within this context."""
    absent = package not in sys.modules
    if absent:
        sys.modules[package] = cast(Any, None)
    try:
        yield
    finally:
        if absent:
            sys.modules.pop(package, None)


def kernel(*, nogil: bool = True) -> Callable[[Callable[P, R]], Kernel[P, R]]:
    """Return a decorator that makes a :class:`Kernel` of a function of numbers and arrays.

    With ``nogil`` the kernel releases the interpreter lock. A kernel that takes microseconds should keep it, because a
    thread that has released the lock may wait 5 ms for it.

    Examples
    --------
    >>> @kernel(nogil=False)
    ... def twice(number):
    ...     return 2.0 * number
    >>> twice.py_func(1.5)
    3.0
    """
    return lambda function: Kernel(function, nogil)


def interruptible(kernel: Callable[P, R], *arguments: P.args, **named: P.kwargs) -> R:
    """Return ``kernel(*arguments)`` for a kernel that releases the interpreter lock; Ctrl-C ends the wait at once.

    Compiled code does not check for signals, and a signal that arrives during it breaks the return of the result. The
    kernel therefore runs in a thread that can be abandoned, and signals reach the waiting main thread. In any other
    thread, which no signal reaches, the kernel runs at once. Its CPU time counts as that of the calling thread.
    """
    if threading.current_thread() is not threading.main_thread():
        return kernel(*arguments, **named)

    def timed() -> tuple[R, float]:
        began = cpu_time()
        return kernel(*arguments, **named), cpu_time() - began

    result, seconds = started(timed)()
    credit(seconds)
    return result


def side_by_side(work: Callable[[T], R], items: Iterable[T]) -> list[R]:
    """Return ``[work(item) for item in items]``, computed in as many threads as this process has cores.

    That helps as far as the work is in kernels that release the interpreter lock. Its CPU time counts as that of the
    calling thread.

    Examples
    --------
    >>> side_by_side(abs, [-1, 2, -3])
    [1, 2, 3]
    """
    items = list(items)
    cores = max(1, min(len(os.sched_getaffinity(0)), len(items)))

    def part(first: int) -> tuple[list[R], float]:
        began = cpu_time()
        return [work(item) for item in items[first::cores]], cpu_time() - began

    others = [started(part, first) for first in range(1, cores)]
    results: list[Any] = [None] * len(items)
    results[::cores] = part(0)[0]
    for first, wait in enumerate(others, start=1):
        results[first::cores], seconds = wait()
        credit(seconds)
    return results


def started(work: Callable[P, R], *arguments: P.args, **named: P.kwargs) -> Callable[[], R]:
    """Start ``work(*arguments)`` in a thread, and return a function that waits for its result.

    The function re-raises what ``work`` raised. The program does not wait for the thread when it ends.
    """
    result: list[R] = []
    failure: list[BaseException] = []

    def run() -> None:
        try:
            result.append(work(*arguments, **named))
        except BaseException as error:  # carried to the caller's thread
            failure.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()

    def wait() -> R:
        while thread.is_alive():
            thread.join(0.1)
        if failure:
            raise failure[0]
        return result[0]

    return wait
