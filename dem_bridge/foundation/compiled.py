"""Compiled kernels: compiled when first called and when their content has changed, and interruptible while they run."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import cached_property, update_wrapper
from typing import Any, Generic, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from dem_bridge.foundation.stopwatch import cpu_time, credit

P = ParamSpec("P")
R = TypeVar("R")
#: arrays that kernels take
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
_thread = threading.local()


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
        from dem_bridge.foundation.kernel_cache import compile_function

        return compile_function(self.py_func, nogil=self.nogil)

    @property
    def _numba_type_(self) -> Any:
        """Type of the compiled function, which numba needs where one kernel calls another."""
        return self.compiled._numba_type_

    def __call__(self, *arguments: P.args, **named: P.kwargs) -> R:
        """Call the compiled function, or within :meth:`interpret` the function itself."""
        if getattr(_thread, "interprets", False):
            return self.py_func(*arguments, **named)
        try:
            result: R = self.compiled(*arguments, **named)
        except SystemError as error:
            if isinstance(error.__cause__, KeyboardInterrupt):  # Ctrl-C at the moment when the function returned
                raise error.__cause__ from None
            raise
        return result

    def interpret(self, *arguments: P.args, **named: P.kwargs) -> R:
        """Call the function, and the kernels that it calls, without the compiler."""
        _thread.interprets = True
        try:
            return self.py_func(*arguments, **named)
        finally:
            _thread.interprets = False


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
