"""Fingerprint the digits of a place: two places with the same fingerprint compute the same last digits.

Last digits depend on the C library, on the processor, and on settings that choose between routines of the C library, of
numpy, of its linear algebra and of the compiler. They are not listed here, since no list is complete. Instead the same
small problems are solved wherever runs are made, and the digest of all their bits is the fingerprint.

The problems have at most 1,500 numbers. Linear algebra adds up more than about 10,000 numbers in threads, and the sum
then depends on the number of threads; no backend adds up so many there.
"""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import cache
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.base import versions_of
from dem_bridge.foundation.compiled import kernel
from dem_bridge.foundation.kernel_content import closure_digest
from dem_bridge.foundation.kernel_folders import folder_to_write, folders_to_read, is_safe
from dem_bridge.foundation.leftovers import owned

Floats = NDArray[np.float64]
#: fingerprint of the place where the runs are made that are planned now, if it is not this process
_PLANNED: ContextVar[str] = ContextVar("planned", default="")
#: functions of the C library of one number > 0, and of two
_OF_ONE = ("sin", "cos", "tan", "atan", "sinh", "cosh", "tanh", "asinh", "exp", "exp2", "expm1", "log", "log2", "log10",
           "log1p", "cbrt", "sqrt", "gamma", "lgamma", "erf", "erfc")  # fmt: skip
_OF_TWO = ("pow", "hypot", "atan2", "fmod")
#: the same of numpy, which has loops of its own for several kinds of processors
_LOOPS = ("sqrt", "exp", "exp2", "expm1", "log", "log2", "log1p", "log10", "sin", "cos", "tan", "arctan", "sinh",
          "tanh", "arcsinh", "cbrt", "reciprocal")  # fmt: skip
_LOOPS_OF_TWO = ("power", "hypot", "arctan2", "divide")
_SUMS = ("sum", "mean", "std", "prod", "cumsum")
#: calls of each function of the C library: two variants of one differ at about one argument in a thousand
_CALLS = 1_500
#: lengths that are no, one and many blocks of a vector loop, with remainders
_LENGTHS = (3, 64, 1000)
_PREFIX = "digits-"
_CPU = ("vendor_id", "cpu family", "model", "model name", "flags", "CPU implementer", "CPU part", "Features")


def fingerprint() -> str:
    """Return the digest of the digits of this process: 40 hexadecimal digits.

    Examples
    --------
    >>> len(fingerprint()), fingerprint() == fingerprint()
    (40, True)
    """
    return digits_of_place()


def planned_fingerprint() -> str:
    """Return the fingerprint of the place where the runs are made that are planned now: by default this process."""
    return _PLANNED.get() or fingerprint()


@contextmanager
def made_at(place: str) -> Iterator[None]:
    """Plan runs, within this context, that are made at a place of another fingerprint; '': in this process."""
    token = _PLANNED.set(place)
    try:
        yield
    finally:
        _PLANNED.reset(token)


@cache
def digits_of_place() -> str:
    """Return the digest of all probes, interpreted and compiled, which are computed once."""
    parts = probes()
    interpreted = digest_of(parts)
    return digest_of({"interpreted": interpreted, "compiled": compiled_digits(interpreted)})


def probes() -> Mapping[str, str]:
    """Return the digests of the probes that need no compiler, by name: each is of one function or routine."""
    found: dict[str, list[Any]] = {}
    first, second = (8.0 * _numbers(_CALLS)).tolist(), _numbers(_CALLS)[::-1].tolist()
    for name in _OF_ONE:
        found[f"C {name}"] = [list(map(getattr(math, name), first))]
    for name in _OF_TWO:
        found[f"C {name}"] = [list(map(getattr(math, name), first, second))]
    arrays: list[Any] = [_numbers(length) for length in _LENGTHS]
    arrays += [arrays[-1][::3], *(array.astype(np.float32) for array in arrays)]
    with np.errstate(all="ignore"):
        for name in _LOOPS:
            found[f"numpy {name}"] = [getattr(np, name)(array) for array in arrays]
        for name in _LOOPS_OF_TWO:
            found[f"numpy {name}"] = [getattr(np, name)(array, array[::-1]) for array in arrays]
        for name in _SUMS:
            found[f"numpy {name}"] = [getattr(np, name)(array - 0.7) for array in arrays]
    found["numpy dot"] = [np.dot(array, array[::-1]) for array in arrays]
    for size in (3, 8, 17, 24):
        matrix = _numbers(size * size).reshape(size, size) - 0.7 + np.eye(size)
        for name, of_matrix in _ALGEBRA.items():
            found.setdefault(f"algebra {name}", []).extend(of_matrix(matrix))
    return {name: digest_of(values) for name, values in found.items()}


#: routines of linear algebra
_ALGEBRA: Mapping[str, Callable[[Floats], Any]] = {
    "matmul": lambda matrix: (matrix @ matrix, matrix.T @ matrix, (matrix @ matrix.astype(np.float32))),
    "matrix by vector": lambda matrix: (matrix @ matrix[0], matrix[0] @ matrix),
    "solve": lambda matrix: (np.linalg.solve(matrix, matrix[0]),),
    "eig": lambda matrix: (np.linalg.eigvals(matrix),),
    "eigh": lambda matrix: np.linalg.eigh(matrix + matrix.T),
    "lstsq": lambda matrix: (np.linalg.lstsq(matrix[:, : len(matrix) // 2], matrix[0], rcond=None)[0],),
    "svd": lambda matrix: (np.linalg.svd(matrix, compute_uv=False),),
    "cholesky": lambda matrix: (np.linalg.cholesky(matrix @ matrix.T + len(matrix) * np.eye(len(matrix))),),
}


def _numbers(count: int) -> Floats:
    """Return numbers in (0.25, 1.25) without a pattern, by operations that are exact everywhere."""
    place = np.arange(count)
    return np.asarray((place * place * 40_503 + place * 12_345) % 65_521 / 65_536.0 + 0.25 + 2.0**-40)


def digest_of(values: Any) -> str:
    """Return the first 40 digits of the sha256 of texts by name, or of the bits of numbers and arrays."""
    if isinstance(values, dict):
        content = repr(sorted(values.items())).encode()
    else:
        content = b"".join(np.asarray(value).tobytes() for value in values)
    return hashlib.sha256(content).hexdigest()[:40]


@kernel(nogil=False)
def compiled_probe(numbers: Floats, out: Floats) -> None:
    """Fill ``out`` with what compiled code computes: powers, roots, functions, sums of products, divisions."""
    total, product = 0.0, 1.0
    for i in range(len(numbers)):
        x, y = numbers[i], numbers[len(numbers) - 1 - i]
        total += x * y - 0.5 * x
        product = product * x + y / (1.0 + x)
        out[i, 0], out[i, 1] = x**1.5 + x * np.sqrt(y), (x**y) ** (1.0 / 3.0)
        out[i, 2], out[i, 3] = np.exp(-x) * np.sin(8.0 * y), np.log(x) + np.cos(y) * np.tanh(x)
        out[i, 4], out[i, 5] = total, product
        out[i, 6], out[i, 7] = np.hypot(x, y) - np.arctan2(x, y), x * y + total / product
    out[:, 6] += np.sum(numbers * out[:, 1])


def compiled_digits(interpreted: str) -> str:
    """Return the digest of what the compiled probe computes.

    numba takes half a second to import. What the probe computed before with the same compiler is therefore kept beside
    the compiled kernels. The machine code depends on versions, processor and settings, and what it computes besides on
    the C library, which the other probes know.
    """
    name = f"{_PREFIX}{digest_of(_compiler(interpreted))}"
    for folder in folders_to_read():
        with suppress(OSError, ValueError):  # not there, or damaged: it is computed again
            path = folder / name
            kept, check = path.read_text(encoding="ascii").split()
            if check == digest_of({name: kept}) and is_safe(path):
                return kept
    numbers = _numbers(200)
    out = np.zeros((len(numbers), 8))
    compiled_probe(numbers, out)
    computed = digest_of([out])
    if (place := folder_to_write()) is not None:
        part = place / f"{owned('part')}{os.urandom(4).hex()}"
        with suppress(OSError):  # it is computed again in the next process
            part.write_text(f"{computed} {digest_of({name: computed})}", encoding="ascii")
            part.chmod(0o644)
            part.replace(place / name)
    return computed


def _compiler(interpreted: str) -> dict[str, object]:
    """Return what determines the machine code of the compiled probe, and the digits of what it calls."""
    file = b""
    with suppress(OSError):  # there is none, as a rule
        file = Path(".numba_config.yaml").read_bytes()
    settings = {name: value for name, value in os.environ.items() if name.startswith("NUMBA_") and "CACHE" not in name}
    return {
        "interpreted": interpreted,
        "probe": closure_digest(cast(Any, compiled_probe).py_func),
        "versions": versions_of("numba", "llvmlite", "numpy"),
        "processor": processor(),
        "settings": [sorted(settings.items()), file],
    }


@cache
def processor() -> list[str]:
    """Return the processor with its instruction set, as the system states them."""
    with suppress(OSError), open("/proc/cpuinfo", encoding="utf-8", errors="replace") as file:
        first = file.read(16_384).split("\n\n")[0]
        about = dict(line.partition(":")[::2] for line in first.split("\n"))
        cpu = {name.strip(): value.strip() for name, value in about.items()}
        return [cpu.get(name, "") for name in _CPU]
    return []
