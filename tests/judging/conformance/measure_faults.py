"""Grade a right code and all faults of :mod:`.faulty_code`: ``python -m tests.judging.conformance.measure_faults``.

One line a fault: whether the item that asks for it failed, which items failed beside it, and the cause that is named.
Words after the module select faults. The code runs as a command, on the frozen scenes.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import dem_bridge as db
from tests.judging.conformance.faulty_code import FAULTS

CODE = Path(__file__).with_name("faulty_code.py")
FEATURES = "hertz,hooke,walls,gaps,gravity,precompression,several-moving,polydisperse,dashpot,tsuji,coeff_restitution"


def failed_items(fault: str, features: str = FEATURES) -> dict[str, str]:
    """Return the items that failed or are undecided, with outcome, cause and sentence."""
    with tempfile.TemporaryDirectory() as folder:
        command = f"{sys.executable} {CODE} {{scene}} {{dt}} {{out.csv}} {fault}"
        grade = db.conform(command, features=features, scenes=0, folder=Path(folder) / "grade")
        items = grade.as_json()["items"]
    return {
        f"{item['name']} ({item['scene']})": f"{item['outcome']}, {item['cause']}: {item['sentence']}"
        for item in items
        if item["outcome"] not in ("PASS", "NOT_RUN")
    }


def main(names: list[str]) -> None:
    """Print the table."""
    right = 0
    for fault in names or ["", *FAULTS]:
        wanted = FAULTS[fault][0] if fault else ""
        found = failed_items(fault)
        named = [item for item in found if item.split(" ")[0] == wanted]
        beside = [item for item in found if item not in named]
        right += bool(named) == bool(wanted) and not beside
        print(f"{'ok ' if (named or not wanted) and not beside else '-- '} {fault or 'right'} [{wanted}]", flush=True)
        for item in found if beside or not named else named:
            print(f"      {item}: {found[item]}", flush=True)
    print(f"{right} of {len(names or FAULTS) + (not names)} as they should be")


if __name__ == "__main__":
    main(sys.argv[1:])
