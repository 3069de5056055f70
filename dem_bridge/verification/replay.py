"""Run the verification of a bundle again and compare it with the bundle, verdict by verdict.

This file is copied into each bundle as ``replay.py`` and imports only the standard library. Arguments on its command
line are passed to ``dem-bridge verify``, such as ``-j 2`` or ``--lmp PATH``. Exit codes: 0 everything is the same, 1
something changed, 2 the verification could not be run.
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

#: allowed change of a difference, as a part of its tolerance: where a difference is round-off, its tolerance is three
#: times the expected value, and another processor has another round-off of the same size
LARGEST_CHANGE_OF_TOLERANCE = 1.0 / 3.0
#: allowed relative change of a number without a tolerance
LARGEST_RELATIVE_CHANGE = 1e-6

Record = dict[str, Any]
_NUMBER = (int, float, type(None))
_TEXT = (str, type(None))
#: form of the parts of verdicts.json that are compared
REPORT = {
    "verdicts": [
        dict.fromkeys(("scene", "quantity", "backend", "reference", "outcome"), str)
        | dict.fromkeys(("difference", "scale", "tolerance"), _NUMBER)
    ],
    "claims": [
        {"id": str, "outcome": str, "values": [{"name": str, "backend": str, "value": _NUMBER, "uncertainty": _NUMBER}]}
    ],
    "provenance": {"runs": [{"scene": str, "scene_hash": str, "deck_hash": _TEXT}]},
}


def main(words: list[str]) -> int:
    """Run the verification again, compare it, print the comparison and return the exit code."""
    here = Path(__file__).resolve().parent
    try:
        return repeat(here, words)
    except (OSError, ValueError) as error:
        print(f"replay: {' '.join(str(error).split())[:480]}", file=sys.stderr)
        return 2


def repeat(here: Path, words: list[str]) -> int:
    """Repeat the verification of the bundle in a folder as :func:`main`; ValueError for a file of another form."""
    bundle = read_record(here / "bundle.json", {"verify": [str], "not_replayed": [str]})
    before = read_record(here / "report" / "verdicts.json", REPORT)
    lines = [("CHANGED", f"{name} differs from the file of the bundle") for name in altered(here)]
    (here / "again" / "verdicts.json").unlink(missing_ok=True)
    command = [sys.executable, "-m", "dem_bridge.cli", "verify", *bundle["verify"], *words, "-o", "again"]
    # without a store: stored results of the first verification would prove nothing
    process = subprocess.run(
        command, cwd=here, env={**os.environ, "PYTHONPATH": str(here / "source"), "DEM_BRIDGE_STORE": ""}
    )
    if not (here / "again" / "verdicts.json").is_file():
        print(
            f"replay: dem-bridge verify ended with exit code {process.returncode} and wrote no verdicts",
            file=sys.stderr,
        )
        return 2
    after = read_record(here / "again" / "verdicts.json", REPORT)
    lines += compared(before, after, bundle["not_replayed"])
    print()
    for word, text in lines:
        print(f"{word:13} {text}")
    counts = {word: sum(outcome == word for outcome, _ in lines) for word in ("SAME", "CHANGED", "NOT REPLAYED")}
    print(f"{', '.join(f'{count} {word}' for word, count in counts.items())}. New report: again/index.html")
    return 1 if counts["CHANGED"] else 0


def read_record(path: Path, form: Any) -> Record:
    """Return the content of a JSON file; raise ValueError, in one line, unless it has a form, as :func:`check_form`."""
    try:
        record = json.loads(path.read_text("utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path.name} is not JSON: {str(error)[:100]}; take the file of the bundle again") from None
    check_form(record, form, path.name)
    return dict(record)


def check_form(value: Any, form: Any, where: str) -> None:
    """Raise ValueError unless a value has a form: a type or several, a list of one form, or an object with its keys."""
    if isinstance(form, dict) and isinstance(value, dict):
        for key, inner in form.items():
            check_form(value.get(key, ...), inner, f"{where}: {key}")
    elif isinstance(form, list) and isinstance(value, list):
        for nth, entry in enumerate(value):
            check_form(entry, form[0], f"{where}[{nth}]")
    elif (
        isinstance(form, dict | list) or not isinstance(value, form) or (isinstance(value, int) and abs(value) > 1e300)
    ):
        raise ValueError(f"{where} has another form than in a bundle; take the file of the bundle again")


def altered(folder: Path) -> list[str]:
    """Return the files of the bundle that are missing or were changed."""
    names = []
    for line in (folder / "SHA256SUMS").read_text("utf-8").splitlines():
        digest, _, name = line.partition("  ")
        file, inside = folder / name, not name.startswith("/") and ".." not in Path(name).parts
        try:
            same = inside and file.is_file() and hashlib.sha256(file.read_bytes()).hexdigest() == digest
        except (OSError, ValueError):  # no name that a file can have
            same = False
        if not same:
            names.append(name)
    return names


def compared(before: Record, after: Record, not_replayed: list[str]) -> Iterator[tuple[str, str]]:
    """Yield SAME, CHANGED or NOT REPLAYED with a description, for every verdict, deck and claim of two reports.

    Raises ValueError if a report has another form.
    """
    for record in (before, after):
        check_form(record, REPORT, "verdicts.json")
    old, new = _verdicts(before), _verdicts(after)
    for key in {**old, **new}:
        name = f"{key[0]}: {key[1]} of {key[2]} against {key[3]}"
        if key not in new:
            yield "NOT REPLAYED" if key[0] in not_replayed else "CHANGED", f"{name}: the verdict is missing now"
        elif key not in old:
            yield "CHANGED", f"{name}: the verdict is not in the bundle"
        else:
            yield _word(_is_same(old[key], new[key])), f"{name}: {_summary(old[key])}, now {_summary(new[key])}"
    first, second = _inputs(before), _inputs(after)
    for scene, (hashes, decks) in first.items():
        if scene not in not_replayed:
            same = second.get(scene) == (hashes, decks)
            yield _word(same), f"{scene}: hashes of the scene and of its {len(decks)} decks"
    yield from _claims(before, after)


def _word(same: bool) -> str:
    """Return the outcome of a comparison."""
    return "SAME" if same else "CHANGED"


def _verdicts(record: Record) -> dict[tuple[str, ...], Record]:
    """Return the verdicts by scene, quantity, backend and reference."""
    keys = ("scene", "quantity", "backend", "reference")
    return {tuple(verdict[key] for key in keys): verdict for verdict in record["verdicts"]}


def _inputs(record: Record) -> dict[str, tuple[set[str], set[str]]]:
    """Return the hashes of each scene and of its decks."""
    inputs: dict[str, tuple[set[str], set[str]]] = {}
    for run in record["provenance"]["runs"]:
        hashes, decks = inputs.setdefault(run["scene"], (set(), set()))
        hashes.add(run["scene_hash"])
        if run["deck_hash"]:
            decks.add(run["deck_hash"])
    return inputs


def _is_same(old: Record, new: Record) -> bool:
    """Return True if outcome, difference and scale of a verdict are the same within their tolerances."""
    allowed = (
        LARGEST_CHANGE_OF_TOLERANCE * old["tolerance"]
        if old["tolerance"]
        else LARGEST_RELATIVE_CHANGE * abs(old["difference"] or 0.0)
    )
    return (
        old["outcome"] == new["outcome"]
        and _near(old["difference"], new["difference"], allowed)
        and _near(old["scale"], new["scale"], LARGEST_RELATIVE_CHANGE * abs(old["scale"] or 0.0))
    )


def _near(a: float | None, b: float | None, allowed: float) -> bool:
    """Return True if two numbers differ by at most ``allowed``, or both are unknown."""
    if a is None or b is None:
        return a is b
    return abs(a - b) <= allowed


def _summary(verdict: Record) -> str:
    """Return the outcome and the difference of a verdict."""
    difference = verdict["difference"]
    return str(verdict["outcome"]) + ("" if difference is None else f" {difference:.6e}")


def _claims(before: Record, after: Record) -> Iterator[tuple[str, str]]:
    """Yield the outcome of the comparison of each claim."""
    new_claims = {claim["id"]: claim for claim in after["claims"]}
    if before["claims"] and not new_claims:
        count = len(before["claims"])
        yield "NOT REPLAYED", f"the {count} claims, because they need more runs than those of the scenes"
        return
    for old in before["claims"]:
        name = f"claim {old['id']}"
        if old["id"] not in new_claims:
            yield "CHANGED", f"{name}: the claim is missing now"
            continue
        new = new_claims[old["id"]]
        moved = [
            f"{a['name']} by {a['backend']} was {a['value']} and is {b['value']}"
            for a, b in zip(old["values"], new["values"], strict=False)
            if not _near(
                a["value"], b["value"], (a["uncertainty"] or 0.0) + LARGEST_RELATIVE_CHANGE * abs(a["value"] or 0.0)
            )
        ]
        same = old["outcome"] == new["outcome"] and len(old["values"]) == len(new["values"]) and not moved
        yield _word(same), "; ".join([f"{name}: {old['outcome']}, now {new['outcome']}", *moved])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
