"""Print digests of digits and what the libraries say of the processor, as JSON, for ``.ci/machines.py``."""

from __future__ import annotations

import hashlib
import json
import math
import platform
import random
from typing import Any

import llvmlite.binding as llvm
import numba
import numpy as np


@numba.njit("float64(float64)")
def _kernel(value: float) -> float:
    return float(value**1.7 + math.exp(-value))


def probe() -> dict[str, Any]:
    """Return digests of some ten thousand numbers of each library, and the names of processor and versions."""
    draw = random.Random(30)
    x = np.array([draw.uniform(0.1, 3.0) for _ in range(20000)])
    square, numbers = x[:10000].reshape(100, 100), x.tolist()
    functions = (math.exp, math.log, math.sin, lambda value: math.pow(value, 1.7))
    digits = {
        "libm": np.array([function(value) for function in functions for value in numbers]),
        "numpy": np.concatenate([np.exp(x), np.log(x), x**1.7, np.tan(x)]),
        "dot": np.append(square @ square, x @ x),
        "solve": np.linalg.solve(square, x[:100]),
        "kernel": np.array([_kernel(value) for value in numbers]),
    }
    simd: Any = np.show_config(mode="dicts")
    return {
        "digests": {name: hashlib.sha256(values.tobytes()).hexdigest() for name, values in digits.items()},
        "features": simd["SIMD Extensions"].get("found", []),
        "processor": llvm.get_host_cpu_name(),
        "libc": " ".join(platform.libc_ver()),
        "versions": f"numpy {np.__version__}, numba {numba.__version__}",
    }


if __name__ == "__main__":
    print(json.dumps(probe()))
