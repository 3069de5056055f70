"""Balls of FLINT's library arb in compiled code: numbers with a radius that contains every rounding.

A ball is 48 bytes in a buffer of numpy; the library keeps long mantissas on its own heap. Kernels take addresses and
call the library without Python in between. Python sees a ball as midpoint and radius, two exact fractions.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import weakref
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from llvmlite import binding
from numba.core import types

from dem_bridge.errors import BackendUnavailable
from dem_bridge.foundation.compiled import kernel

#: bytes of a ball, and of the midpoint at its beginning
SIZE, _RADIUS = 48, 32
#: rounding of a midpoint to a double: towards zero, away from zero
_DOWN, _AWAY = 0, 1
#: what a bound of a magnitude is enlarged by: one rounding of the midpoint and one of the sum
_OUT = 1.0 + 1e-15
#: least bound of a magnitude: a smaller one would be rounded to 0 by doubles
FLOOR = 1e-290


@cache
def library() -> ctypes.CDLL:
    """Return FLINT's library, which python-flint bundles; raise BackendUnavailable if it is not installed."""
    try:
        import flint
    except ImportError:
        install = "install the extra 'proof': pip install 'dem-bridge[proof]'"
        raise BackendUnavailable(f"a proof needs python-flint, which is not installed; {install}") from None
    for folder in (Path(flint.__file__).parent, *Path(flint.__file__).parents[1].glob("python_flint*.libs")):
        for path in sorted(folder.glob("*flint*")):
            if ".so" in path.name and path.name.startswith("libflint"):
                binding.load_library_permanently(str(path))
                return _typed(ctypes.CDLL(str(path)))
    system = ctypes.util.find_library("flint")
    if system is None:
        allowed = "allowed: a wheel of python-flint, which has one, or the library of the system"
        raise BackendUnavailable(f"a proof needs the library libflint, which was not found; {allowed}")
    binding.load_library_permanently(system)
    return _typed(ctypes.CDLL(system))


def _typed(flint: ctypes.CDLL) -> ctypes.CDLL:
    flint.arb_dump_str.restype = ctypes.c_void_p
    flint.arb_dump_str.argtypes = [ctypes.c_ssize_t]
    flint.arb_load_str.argtypes = [ctypes.c_ssize_t, ctypes.c_char_p]
    flint.flint_free.argtypes = [ctypes.c_void_p]
    flint.arb_clear.argtypes = [ctypes.c_ssize_t]
    return flint


_I, _D, _VOID = types.intp, types.float64, types.void
# functions of the library that kernels call: addresses, numbers and precisions are integers
dot: Any = types.ExternalFunction("arb_dot", _VOID(_I, _I, types.int32, _I, _I, _I, _I, _I, _I))
add: Any = types.ExternalFunction("arb_add", _VOID(_I, _I, _I, _I))
sub: Any = types.ExternalFunction("arb_sub", _VOID(_I, _I, _I, _I))
mul: Any = types.ExternalFunction("arb_mul", _VOID(_I, _I, _I, _I))
div: Any = types.ExternalFunction("arb_div", _VOID(_I, _I, _I, _I))
divide_by: Any = types.ExternalFunction("arb_div_ui", _VOID(_I, _I, types.uint64, _I))
root: Any = types.ExternalFunction("arb_sqrt", _VOID(_I, _I, _I))
scale: Any = types.ExternalFunction("arb_mul_2exp_si", _VOID(_I, _I, _I))
copy: Any = types.ExternalFunction("arb_set_round", _VOID(_I, _I, _I))
zero: Any = types.ExternalFunction("arb_zero", _VOID(_I))
negate: Any = types.ExternalFunction("arb_neg", _VOID(_I, _I))
double: Any = types.ExternalFunction("arb_set_d", _VOID(_I, _D))
_as_double: Any = types.ExternalFunction("arf_get_d", _D(_I, types.int32))
_radius: Any = types.ExternalFunction("mag_get_d", _D(_I))
_set_mag: Any = types.ExternalFunction("mag_set_d", _VOID(_I, _D))
_widen: Any = types.ExternalFunction("arb_add_error_mag", _VOID(_I, _I))
is_positive: Any = types.ExternalFunction("arb_is_positive", types.int32(_I))


@kernel()
def radius(ball: int) -> float:
    """Return an upper bound of the radius of a ball."""
    return float(_radius(ball + _RADIUS) * _OUT + FLOOR)


@kernel()
def upper(ball: int) -> float:
    """Return an upper bound of a ball as a double."""
    middle = _as_double(ball, _AWAY)
    most = middle if middle > 0.0 else _as_double(ball, _DOWN)
    return float(most + _radius(ball + _RADIUS) * _OUT + 4e-16 * abs(most) + FLOOR)


@kernel()
def lower(ball: int) -> float:
    """Return a lower bound of a ball as a double."""
    middle = _as_double(ball, _AWAY)
    least = middle if middle < 0.0 else _as_double(ball, _DOWN)
    return float(least - _radius(ball + _RADIUS) * _OUT - 4e-16 * abs(least) - FLOOR)


@kernel()
def magnitude(ball: int) -> float:
    """Return an upper bound of the magnitude of all numbers in a ball."""
    return float((abs(_as_double(ball, _AWAY)) + _radius(ball + _RADIUS)) * _OUT + FLOOR)


@kernel()
def widen(ball: int, by: float, spare: int) -> None:
    """Enlarge the radius of a ball by a double; ``spare`` is the address of a ball whose radius may be overwritten."""
    _set_mag(spare + _RADIUS, by)
    _widen(ball, spare + _RADIUS)


class Balls:
    """A vector of balls, all 0 at first, and the memory of their mantissas."""

    def __init__(self, count: int) -> None:
        self._library = library()
        self.buffer = np.zeros(count * SIZE, dtype=np.uint8)
        self.address = int(self.buffer.ctypes.data)
        weakref.finalize(self, _clear, self._library, self.buffer, count)

    def at(self, index: int) -> int:
        """Return the address of a ball."""
        return self.address + SIZE * index

    def __getitem__(self, index: int) -> tuple[Fraction, Fraction]:
        """Return midpoint and radius of a ball."""
        text = self._library.arb_dump_str(self.at(index))
        parts = [int(part, 16) for part in (ctypes.string_at(text)).decode().split()]
        self._library.flint_free(text)
        middle, radius = (Fraction(man) * Fraction(2) ** exp for man, exp in (parts[:2], parts[2:]))
        return middle, radius

    def __setitem__(self, index: int, ball: tuple[Fraction, Fraction]) -> None:
        """Set a ball to one that contains midpoint and radius, with a radius of 30 bits."""
        middle, radius = ball
        bits = 64 + max(0, middle.numerator.bit_length() - middle.denominator.bit_length(), 1 << 11)
        if middle.denominator & (middle.denominator - 1):  # not dyadic: rounded, and the rounding is in the radius
            rounded = Fraction(round(middle * 2**bits), 2**bits)
            radius += abs(middle - rounded)
            middle = rounded
        exponent = -(middle.denominator.bit_length() - 1)
        lift = radius.numerator.bit_length() - radius.denominator.bit_length() - 29
        scaled = radius / Fraction(2) ** lift
        mantissa = -(-scaled.numerator // scaled.denominator)  # rounded up
        while mantissa >= 2**30:
            mantissa, lift = -(-mantissa // 2), lift + 1
        parts = middle.numerator, exponent, mantissa, lift if mantissa else 0
        text = " ".join(f"{'-' * (part < 0)}{abs(part):x}" for part in parts)
        if self._library.arb_load_str(self.at(index), text.encode()):
            raise ValueError(f"the library does not read the ball {text[:200]}")


def _clear(flint: ctypes.CDLL, buffer: Any, count: int) -> None:
    for index in range(count):
        flint.arb_clear(int(buffer.ctypes.data) + SIZE * index)
