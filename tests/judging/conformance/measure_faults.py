"""Grade right codes and faulty ones: ``python -m tests.judging.conformance.measure_faults``.

One line a fault: whether the item that asks for it failed, which items failed beside it, and the cause that is named.
Words after the module select faults. Those of :mod:`.faulty_code` run as a command, on the frozen scenes; those of
:mod:`.planted_faults` in this process, with five unseen scenes, too.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import dem_bridge as db
from dem_bridge.judging.conformance.scenes import FEATURES as ALL
from tests.judging.conformance.faulty_code import FAULTS
from tests.judging.conformance.planted_faults import PLANTED

CODE = Path(__file__).with_name("faulty_code.py")
FEATURES = "hertz,hooke,walls,gaps,gravity,precompression,several-moving,polydisperse,dashpot,tsuji,coeff_restitution"
#: outcomes that say that an answer is no
NO = ("FAIL", "BROKEN")


def failed_items(fault: str, features: str = FEATURES) -> dict[str, str]:
    """Return the items that a fault of the other author fails or leaves undecided, with outcome, cause and sentence."""
    with tempfile.TemporaryDirectory() as folder:
        command = f"{sys.executable} {CODE} {{scene}} {{dt}} {{out.csv}} {fault}"
        return _items(db.conform(command, features=features, scenes=0, folder=Path(folder) / "grade"))


def planted_items(fault: str) -> dict[str, str]:
    """Return the same of a planted fault."""
    return _items(db.conform(PLANTED[fault][0], features=tuple(ALL), scenes=5, seed=3))


def _items(grade: db.Conformance) -> dict[str, str]:
    """Return the items of a grade that did not pass."""
    return {
        f"{item.name} ({item.scene})": f"{item.outcome.value}, {item.cause}: {item.sentence}"
        for item in grade.answers
        if item.outcome.value not in ("PASS", "NOT_RUN")
    }


def _print_fault(name: str, wanted: str, found: dict[str, str]) -> bool:
    """Print one fault, and return True if the item that asks for it failed alone."""
    failed = {item.split(" ")[0] for item, words in found.items() if words.startswith(NO)}
    right = failed == ({wanted} if wanted else set())
    print(f"{'ok ' if right else '-- '} {name or 'right'} [{wanted}]", flush=True)
    for item, words in found.items():
        if words.startswith(NO) or not right:
            print(f"      {item}: {words}", flush=True)
    if undecided := [item for item, words in found.items() if not words.startswith(NO)]:
        print(f"      undecided: {', '.join(undecided)}", flush=True)
    return right


def main(names: list[str]) -> None:
    """Print the tables."""
    blind = [name for name in names or ["", *FAULTS] if name not in PLANTED]
    right = [_print_fault(name, FAULTS[name][0] if name else "", failed_items(name)) for name in blind]
    own = [name for name in names or PLANTED if name in PLANTED]
    planted = [_print_fault(name, PLANTED[name][1], planted_items(name)) for name in own]
    print(f"{sum(right)} of {len(right)}, {sum(planted)} of {len(planted)} as they should be")


if __name__ == "__main__":
    main(sys.argv[1:])
