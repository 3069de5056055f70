"""Run the verification of a bundle again and say, verdict by verdict, whether it is the same.

A program of its own, copied into each bundle as ``replay.py``: it imports nothing but the standard library. More
words on its command line go to ``dem-bridge verify``, such as ``-j 2`` or ``--lmp PATH``. Exit codes: 0 all is the
same, 1 something changed, 2 the verification could not be run.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

#: of a verdict's tolerance: as far as its difference may move. Where a difference is round-off its tolerance is three
#: times what is expected, and another processor's round-off is as likely as the first one's.
WITHIN = 1.0 / 3.0
#: relative, where there is no tolerance
ALMOST = 1e-6

Record = dict[str, Any]


def main(words: list[str]) -> int:
    """Verify again, compare, print; the exit code."""
    here = Path(__file__).resolve().parent
    bundle, before = (json.loads((here / name).read_text("utf-8")) for name in ("bundle.json", "report/verdicts.json"))
    lines = [("CHANGED", f"{name} is not the file that was bundled") for name in altered(here)]
    (here / "again" / "verdicts.json").unlink(missing_ok=True)
    command = [sys.executable, "-m", "dem_bridge.cli", "verify", *bundle["verify"], *words, "-o", "again"]
    # with an empty store: what is kept from the first time would prove nothing
    ended = subprocess.run(
        command, cwd=here, env={**os.environ, "PYTHONPATH": str(here / "source"), "DEM_BRIDGE_STORE": ""}
    )
    if not (here / "again" / "verdicts.json").is_file():
        print(f"replay: dem-bridge verify ended with {ended.returncode} and wrote no verdicts", file=sys.stderr)
        return 2
    after = json.loads((here / "again" / "verdicts.json").read_text("utf-8"))
    lines += compared(before, after, bundle["not_replayed"])
    print()
    for word, text in lines:
        print(f"{word:13} {text}")
    counts = {word: sum(one == word for one, _ in lines) for word in ("SAME", "CHANGED", "NOT REPLAYED")}
    print(f"{', '.join(f'{count} {word}' for word, count in counts.items())}. The new report: again/index.html")
    return 1 if counts["CHANGED"] else 0


def altered(folder: Path) -> list[str]:
    """Files of the bundle that are gone or have other content than when it was made."""
    found = []
    for line in (folder / "SHA256SUMS").read_text("utf-8").splitlines():
        digest, name = line.split("  ", 1)
        file = folder / name
        if not file.is_file() or hashlib.sha256(file.read_bytes()).hexdigest() != digest:
            found.append(name)
    return found


def compared(before: Record, after: Record, not_replayed: list[str]) -> Iterator[tuple[str, str]]:
    """(SAME, CHANGED or NOT REPLAYED, what) for every verdict, deck and claim of two ``verdicts.json``."""
    old, new = _verdicts(before), _verdicts(after)
    for key in {**old, **new}:
        name = f"{key[0]}: {key[1]} of {key[2]} against {key[3]}"
        if key not in new:
            yield "NOT REPLAYED" if key[0] in not_replayed else "CHANGED", f"{name}: there is no such verdict now"
        elif key not in old:
            yield "CHANGED", f"{name}: there was no such verdict"
        else:
            yield _word(_is_same(old[key], new[key])), f"{name}: {_told(old[key])}, now {_told(new[key])}"
    first, second = _inputs(before), _inputs(after)
    for scene, (hashes, decks) in first.items():
        if scene not in not_replayed:
            same = second.get(scene) == (hashes, decks)
            yield _word(same), f"{scene}: the scene and its {len(decks)} decks, byte for byte"
    yield from _claims(before, after)


def _word(same: bool) -> str:
    return "SAME" if same else "CHANGED"


def _verdicts(record: Record) -> dict[tuple[str, ...], Record]:
    return {tuple(one[key] for key in ("scene", "quantity", "backend", "reference")): one for one in record["verdicts"]}


def _inputs(record: Record) -> dict[str, tuple[set[str], set[str]]]:
    """Hashes of each scene and of its decks."""
    found: dict[str, tuple[set[str], set[str]]] = {}
    for run in record["provenance"]["runs"]:
        hashes, decks = found.setdefault(run["scene"], (set(), set()))
        hashes.add(run["scene_hash"])
        if run["deck_hash"]:
            decks.add(run["deck_hash"])
    return found


def _is_same(old: Record, new: Record) -> bool:
    allowed = WITHIN * old["tolerance"] if old["tolerance"] else ALMOST * abs(old["difference"] or 0.0)
    return (
        old["outcome"] == new["outcome"]
        and _near(old["difference"], new["difference"], allowed)
        and _near(old["scale"], new["scale"], ALMOST * abs(old["scale"] or 0.0))
    )


def _near(one: float | None, other: float | None, allowed: float) -> bool:
    if one is None or other is None:
        return one is other
    return abs(one - other) <= allowed


def _told(verdict: Record) -> str:
    difference = verdict["difference"]
    return str(verdict["outcome"]) + ("" if difference is None else f" {difference:.6e}")


def _claims(before: Record, after: Record) -> Iterator[tuple[str, str]]:
    new = {one["id"]: one for one in after["claims"]}
    if before["claims"] and not new:
        yield "NOT REPLAYED", f"the {len(before['claims'])} claims: they follow from more runs than those of the scenes"
        return
    for old in before["claims"]:
        name = f"claim {old['id']}"
        if old["id"] not in new:
            yield "CHANGED", f"{name}: there is no such claim now"
            continue
        one = new[old["id"]]
        moved = [
            f"{a['name']} by {a['backend']} {a['value']} now {b['value']}"
            for a, b in zip(old["values"], one["values"], strict=False)
            if not _near(a["value"], b["value"], (a["uncertainty"] or 0.0) + ALMOST * abs(a["value"] or 0.0))
        ]
        same = old["outcome"] == one["outcome"] and len(old["values"]) == len(one["values"]) and not moved
        yield _word(same), "; ".join([f"{name}: {old['outcome']}, now {one['outcome']}", *moved])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
