"""Count what one verification and one study call: ``python .ci/house_runs.py --checkout DIR --python EXE``.

Commands: ``verify decelerating-40 --accuracy 1e-3 -j 1``, with an empty store, and ``study stability --points 2``.
A look-up is a call of ``Store.load`` or ``Store.load_arrays``, a miss one that returns None. A call carries the scene
where an argument other than ``self`` is a Scene; functions within functions are left out. It changes the module where
the nearest caller within the package is in another one. Scenes and trajectories are counted by their
``__post_init__``. The CPU time is that of a process that counts nothing, with its children.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

PROBE = Path(__file__).with_name("house_probe.py")
VERIFY = ("verify", "decelerating-40", "--accuracy", "1e-3", "-j", "1", "-o", "out")
STABILITY = ("study", "stability", "--points", "2", "-o", "out")
#: what is counted -> pattern of "module:qualified name"
OF_VERIFY = {
    "store look-ups": r".*:Store\.(load|load_arrays)",
    "engine_for": r".*:engine_for",
    "assign_roles": r".*:assign_roles",
    "Support.unsupported_reason": r".*:Support\.unsupported_reason",
    "readings of observables": r"observables\.\w+:(Observable\.)?read",
    "Scene._static_forces": r".*:Scene\._static_forces",
    "Scenes built": r".*:Scene\.__post_init__",
    "trajectories built": r".*:Trajectory\.__post_init__",
}
OF_STABILITY = {
    "Scenes built": r".*:Scene\.__post_init__",
    "trajectories built": r".*:Trajectory\.__post_init__",
    "solves by the twin": r".*splitting:(solve|solve_motion)",
    "runs of LAMMPS": r".*:(solve_lammps|_Lammps\.run|Lammps\w*\.run|Granular\.motion)",
}


def run(checkout: Path, python: Path, words: Sequence[str], *, counted: bool) -> dict[str, Any]:
    """Return what the probe counts in a checkout; nothing is left behind."""
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "result.json"
        variables = {
            **{name: value for name, value in os.environ.items() if not name.startswith("DEM_BRIDGE")},
            "PYTHONPATH": str(checkout),
            "DEM_BRIDGE_STORE": str(Path(folder) / "store"),
            "NO_COLOR": "1",
            "COLUMNS": "100",
        }
        command = [str(python), str(PROBE), str(target), str(int(counted)), *words]
        done = subprocess.run(command, cwd=folder, env=variables, capture_output=True, text=True, check=False)
        if not target.exists():
            raise SystemExit(f"{' '.join(words)} in {checkout}: {done.stderr.strip()[-300:]}")
        return dict(json.loads(target.read_text(encoding="utf-8")))


def matched(found: Mapping[str, int], pattern: str) -> int:
    """Return how often functions whose name fits a pattern were called.

    >>> matched({"runs.store:Store.load": 3, "runs.store:Store.loaded": 4}, r".*:Store\\.load")
    3
    """
    return sum(times for name, times in found.items() if re.fullmatch(pattern, name))


def counts_of(checkout: Path, python: Path, *, quick: bool) -> dict[str, int]:
    """Return all counts; ``quick``: without the study."""
    found = run(checkout, python, VERIFY, counted=True)
    names = {"run_key": "run_key", "distinct": "distinct keys", "misses": "misses of the store"}
    names |= {"carried": "calls that carry the scene", "modules": "... into another module"}
    names |= {
        "rooms": "... into another room",
        "methods": "calls of methods and properties of the Scene",
        "exit": "exit code",
    }
    result = {f"verify: {told}": int(found[name]) for name, told in names.items()}
    result |= {f"verify: {told}": matched(found["by_name"], pattern) for told, pattern in OF_VERIFY.items()}
    result["verify: CPU, s"] = round(run(checkout, python, VERIFY, counted=False)["cpu"])
    if not quick:
        found = run(checkout, python, STABILITY, counted=True)
        result |= {f"stability: {told}": matched(found["by_name"], pattern) for told, pattern in OF_STABILITY.items()}
        result["stability: CPU, s"] = round(run(checkout, python, STABILITY, counted=False)["cpu"])
    return result


def main() -> int:
    """Print the counts of a checkout."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    here = Path(__file__).parent.parent
    parser.add_argument("--checkout", type=Path, default=here, metavar="DIR", help="root; default: this one")
    parser.add_argument("--python", type=Path, metavar="EXE", help="interpreter; default: that in its .venv")
    parser.add_argument("--quick", action="store_true", help="the verification alone")
    parser.add_argument("--names", metavar="PATTERN", help="calls of the verification by name, the most frequent first")
    options = parser.parse_args()
    checkout = options.checkout.resolve()
    # links are not resolved, because an environment's python is a link to an interpreter with other packages
    python = (options.python or checkout / ".venv" / "bin" / "python").absolute()
    if options.names is not None:
        every = run(checkout, python, VERIFY, counted=True)["by_name"]
        print(*(f"{times} {name}" for name, times in every.items() if re.search(options.names, name)), sep="\n")
        return 0
    rows = counts_of(checkout, python, quick=options.quick)
    print("| | calls |\n|---|---:|", *(f"| {name} | {number} |" for name, number in rows.items()), sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
