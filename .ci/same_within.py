"""Compare what two checkouts compute, within uncertainties: ``python .ci/same_within.py BEFORE [AFTER] [--scenes N]``.

BEFORE and AFTER are roots of checkouts with their tests; AFTER is this one unless it is named. Both solve the first N
of the 300 random scenes (100 without ``--scenes``) with their uncertainties by ``reference`` and ``scipy``, at the
default settings and without a store. A quantity of two runs is the same if it differs by at most the sum of the two
uncertainties: velocity and displacement by their largest difference over all samples and bodies, peak force and
crossing time at each contact. Exit codes: 0, and 1 where a quantity differs or only one checkout has a run.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

ROOT = Path(__file__).parent.parent
BACKENDS, SCENES = ("reference", "scipy"), 100
#: quantities of a run -> whether their uncertainty is one number, or that of each contact
QUANTITIES = {"velocity": True, "displacement": True, "peak_force": False, "crossing_time": False}
#: a run as JSON: the hash of its scene with the values and uncertainties of its quantities, or why there is none
Answer = Mapping[str, Any]


class Difference(NamedTuple):
    """A quantity of one scene by one backend in two checkouts."""

    label: str
    quantity: str
    share: float
    """Largest difference over the sum of the two uncertainties; inf where only one run has a value."""


def answer(seed: int, backend: str) -> Answer:
    """Return the run of a random scene by the package that is imported, as JSON."""
    import dem_bridge as db
    from dem_bridge.errors import DemBridgeError
    from tests.helpers.random_scenes import random_scene

    scene = random_scene(seed)
    known: dict[str, Any] = {"label": f"random scene {seed}, {backend}", "scene": scene.content_hash}
    try:
        run = db.solve(scene, backend=backend)
    except DemBridgeError as error:
        return known | {"failure": str(error)}
    values = {name: getattr(run, name).tolist() for name in QUANTITIES}
    return known | values | {f"{name} +-": np.asarray(run.uncertainty[name]).tolist() for name in QUANTITIES}


def answers(checkout: Path, scenes: int, backends: Sequence[str] = BACKENDS) -> Iterator[Answer]:
    """Yield the runs of a checkout in a process of its own, which imports the package of that checkout."""
    words = [sys.executable, str(Path(__file__).resolve()), "--answers", str(scenes), *backends]
    environment = os.environ | {"PYTHONPATH": str(checkout.resolve())}
    with subprocess.Popen(words, cwd=checkout, env=environment, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        yield from map(json.loads, process.stdout)
    if process.returncode:
        raise SystemExit(f"{checkout}: the runs ended with code {process.returncode}; is it the root of a checkout?")


def differences(before: Answer, after: Answer) -> Iterator[Difference]:
    """Yield the quantities of two runs of one scene; one with the name of the fault where they cannot be compared.

    >>> run = {"label": "a", "scene": "0", **{name: [1.0, float("nan")] for name in QUANTITIES}}
    >>> run |= {f"{name} +-": 0.5 if one else [0.5, float("nan")] for name, one in QUANTITIES.items()}
    >>> [(found.quantity, found.share) for found in differences(run, run | {"peak_force": [1.5, float("nan")]})][2:]
    [('peak_force', 0.5), ('crossing_time', 0.0)]
    >>> [found.share for found in differences(run, run | {"velocity": [1.0, 1.0]})][:2]
    [inf, 0.0]
    """
    if before["scene"] != after["scene"]:
        yield Difference(after["label"], "scene", math.inf)
    elif "failure" in before or "failure" in after:
        both = "failure" in before and "failure" in after
        yield Difference(after["label"], "run", 0.0 if both else math.inf)
    else:
        for name in QUANTITIES:
            one, other = (np.asarray(run[name], dtype=float) for run in (before, after))
            bar = np.add(*(np.asarray(run[f"{name} +-"], dtype=float) for run in (before, after)))
            yield Difference(after["label"], name, _share(one, other, bar))


def _share(one: Any, other: Any, bar: Any) -> float:
    """Return the largest difference over its bar; a value that is missing in both is the same."""
    if one.shape != other.shape or not np.array_equal(np.isfinite(one), np.isfinite(other)):
        return math.inf
    known = np.isfinite(one)
    gap, bars = np.abs(one - other)[known], np.broadcast_to(bar, one.shape)[known]
    with np.errstate(divide="ignore", invalid="ignore"):
        # a difference of zero is none, whatever the uncertainty; one without uncertainty is outside
        return float(
            np.max(np.where(gap == 0.0, 0.0, np.nan_to_num(gap / bars, nan=math.inf, posinf=math.inf)), initial=0.0)
        )


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare two checkouts, and print the quantities that differ and the largest shares."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path, nargs="?", default=ROOT)
    parser.add_argument("--scenes", type=int, default=SCENES)
    chosen = parser.parse_args(arguments)
    found: list[Difference] = []
    pairs = zip(answers(chosen.before, chosen.scenes), answers(chosen.after, chosen.scenes), strict=True)
    for before, after in pairs:
        some = list(differences(before, after))
        for item in (item for item in some if item.share > 1.0):
            print(f"{item.label}: {item.quantity} differs by {item.share:.3g} of both uncertainties", flush=True)
        found += some
    outside = sum(item.share > 1.0 for item in found)
    print(f"{len(found)} quantities of {chosen.scenes} scenes by {' and '.join(BACKENDS)}: {outside} outside")
    for name in QUANTITIES:
        shares = [item.share for item in found if item.quantity == name]
        if shares:
            print(f"{name}: median {np.median(shares):.2g}, largest {max(shares):.2g} of both uncertainties")
    return 1 if outside else 0


if __name__ == "__main__":
    if sys.argv[1:2] == ["--answers"]:
        for seed in range(int(sys.argv[2])):
            for name in sys.argv[3:]:
                print(json.dumps(answer(seed, name)), flush=True)
        sys.exit(0)
    sys.exit(main())
