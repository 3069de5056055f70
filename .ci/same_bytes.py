"""Compare what two checkouts write, byte for byte: ``python .ci/same_bytes.py BEFORE AFTER [--quick]``.

BEFORE and AFTER are roots of checkouts with a ``.venv``, or folders of outputs that ``--keep DIR`` stored. Each output
of the list is made in a folder of its own name and place, with an empty store, one job and a fixed environment. Files
of commands are outputs, too. Apart from :data:`ASIDE` every byte counts. Exit codes: 0, and 1 where an output differs.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

#: what is left out of a comparison -> pattern, whose first group stays
ASIDE = {
    "times": r'("(?:wall|cpu|wall_time|cpu_time|seconds|setup|made|stored|date|started|finished|elapsed)":\s*)[^,}\n]+',
    "durations in words": r"()\b\d[\d.,]*(?:e[+-]?\d+)?\s?(?:ms|s|min)(?: of)? (?:CPU|wall)\b",
    "wall times of runs": r"((?:wall|CPU) time\s+)[\d.e+-]+ s",
    "dates": r"()\b\d{4}-\d\d-\d\d(?:[T ]\d\d:\d\d(?::\d\d)?(?:[+-]\d\d:\d\d|Z| UTC)?)?",
    "code hashes and run keys": r"()\b[0-9a-f]{64}\b",
    "bytes of netCDF": r"()(?<=\x89HDF)(?s:.*)",
}
#: named outputs -> words of a command; folders and files that it writes are outputs
CHEAP: Mapping[str, Sequence[str]] = {
    "scenes": ("scenes",),
    "version": ("--version",),
    "new": ("new", "mine.toml"),
    **{f"new-{form}": ("new", f"{form}.toml", "--form", form) for form in ("cylinders", "spheres", "impact", "raw")},
    "run-verlet": ("run", "decelerating-40", "--backend", "verlet", "--dt", "1e-7", "-o", "verlet.nc"),
    "run-verlet-coarse": ("run", "decelerating-40", "--backend", "verlet", "--dt", "2e-7", "-o", "coarse.nc"),
    "run-reference": ("run", "newtons-cradle", "--backend", "reference"),
    "run-bca": ("run", "decelerating-40", "--backend", "bca"),
    "run-lammps": ("run", "decelerating-40", "--backend", "lammps-granular", "--dt", "1e-7"),
    "run-lammps-table": ("run", "decelerating-40-soft-exponent", "--backend", "lammps-table", "--dt", "2e-7"),
    "convert-csv": ("convert", "verlet.nc", "-o", "verlet.csv"),
    "convert-wide": ("convert", "verlet.nc", "--layout", "wide", "-o", "wide.csv"),
    "convert-dump": ("convert", "verlet.nc", "-o", "verlet.lammpstrj"),
    "convert-extxyz": ("convert", "verlet.nc", "-o", "verlet.extxyz"),
    "compare": ("compare", "verlet.nc", "coarse.nc"),
    "judge": ("judge", "verlet.csv@1e-7", "--scene", "decelerating-40"),
    "judge-json": ("judge", "verlet.csv@1e-7", "--scene", "decelerating-40", "--json"),
    "judge-wrong-step": ("judge", "verlet.csv@1e-9", "--scene", "decelerating-40"),
    "judge-wrong-scene": ("judge", "verlet.csv", "--scene", "newtons-cradle"),
    "import-deck": ("import", "deck", "deck-dimer-1-1/in.dimer-1-1", "-o", "imported.toml"),
    "plan": ("plan", "decelerating-40", "--accuracy", "1e-3", "--predict-only"),
    "store-list": ("store", "list"),
    "error-scene": ("run", "no-such-scene", "--backend", "verlet"),
    "error-backend": ("run", "decelerating-40", "--backend", "no-such-backend"),
    "error-features": ("run", "decelerating-40-drag", "--backend", "blanes-moan"),
    "error-step": ("run", "decelerating-40", "--backend", "verlet", "--dt", "-1"),
    "error-study": ("study", "no-such-study"),
    "error-format": ("convert", "verlet.nc", "-o", "verlet.xyzzy"),
    **{
        f"help-{'-'.join(words) or 'all'}": (*words, "--help")
        for words in [
            (), *((one,) for one in ("scenes", "doctor", "run", "deck", "verify", "plan", "study", "export")),
            *((one,) for one in ("regress", "judge", "store", "new", "convert", "compare", "import")),
            ("import", "deck"), ("import", "csv"), ("study", "stability"), ("study", "engine"), ("store", "why"),
        ]
    },
}  # fmt: skip
DEAR: Mapping[str, Sequence[str]] = {
    "verify": ("verify", "decelerating-40", "dimer-1-1", "newtons-cradle", "--accuracy", "1e-3", "-j", "1", "-o", "v"),
    "study-rule-of-thumb": ("study", "rule-of-thumb", "-o", "thumb"),
    "regress": ("regress", "--backend", "verlet", "-j", "1", "--baselines", "{root}/reports/baselines"),
}
TABLES = ("contacts", "pair-coeffs", "bodies", "observables", "energy-ledger", "stiffness-curve", "angles")
DECKS = ("granular", "table")


def commands(scenes: Sequence[str], *, quick: bool) -> Iterator[tuple[str, Sequence[str]]]:
    """Yield every output and its command; decks come first, because others read them."""
    for scene in ("dimer-1-1", "decelerating-40") if quick else scenes:
        for style in DECKS:
            suffix = "" if style == "granular" else f"-{style}"
            yield f"deck-{scene}{suffix}", ("deck", scene, "--style", style, "-o", f"deck-{scene}{suffix}")
    for table in TABLES[:3] if quick else TABLES:
        for form in ("csv", "json", "md"):
            yield f"table-{table}-{form}", ("export", "decelerating-40", "--table", table, "--format", form)
    yield from CHEAP.items()
    if not quick:
        yield from DEAR.items()


def produce(checkout: Path, folder: Path, *, quick: bool) -> None:
    """Write all outputs of a checkout into a folder; what a command says and its exit code are NAME.txt."""
    python, root = checkout / ".venv" / "bin" / "python", checkout / "dem_bridge"
    scenes = sorted(file.stem for file in root.rglob("scenes/*.toml"))
    work = folder / "work"
    variables = {name: value for name, value in os.environ.items() if not name.startswith("DEM_BRIDGE")}
    variables |= {"PYTHONPATH": str(checkout), "DEM_BRIDGE_STORE": "", "NO_COLOR": "1", "COLUMNS": "100", "LC_ALL": "C"}
    work.mkdir(parents=True)
    for name, words in commands(scenes, quick=quick):
        command = [str(python), "-m", "dem_bridge.cli", *(word.replace("{root}", str(checkout)) for word in words)]
        done = subprocess.run(command, cwd=work, env=variables, capture_output=True, text=True, check=False)
        said = f"{done.stdout}\n--- stderr\n{done.stderr}\n--- exit code {done.returncode}\n"
        for path in (work, checkout):
            said = said.replace(str(path), "PLACE")
        (folder / f"{name}.txt").write_text(said, encoding="utf-8")


def cleaned(content: bytes) -> str:
    """Return the content of a file without what is left out.

    >>> cleaned(b'{"cpu": 1.25, "outcome": "PASS", "made": "2026-11-23T10:00:00+00:00"}')
    '{"cpu": *, "outcome": "PASS", "made": *}'
    """
    text = content.decode("utf-8", "backslashreplace")
    for pattern in ASIDE.values():
        text = re.sub(pattern, r"\1*", text)
    return text


def compare(before: Path, after: Path) -> dict[str, str]:
    """Return, for every file of two folders, "" where it is the same, otherwise the first line that differs."""
    names = sorted({str(f.relative_to(root)) for root in (before, after) for f in root.rglob("*") if f.is_file()})
    result = {}
    for name in names:
        if name.endswith(".nc"):  # HDF5 keeps times of its own; its content is compared as csv
            continue
        one, other = before / name, after / name
        if not (one.is_file() and other.is_file()):
            result[name] = "only before" if one.is_file() else "only after"
        else:
            result[name] = difference(cleaned(one.read_bytes()), cleaned(other.read_bytes()))
    return result


def difference(before: str, after: str) -> str:
    """Return the first line that differs, in both forms; '' where nothing does.

    >>> difference("a\\nb\\n", "a\\nc\\n")
    "line 2: 'b' -> 'c'"
    """
    if before == after:
        return ""
    lines = [*before.split("\n"), ""], [*after.split("\n"), ""]
    number, (one, other) = next((n, pair) for n, pair in enumerate(zip(*lines, strict=False), 1) if pair[0] != pair[1])
    start = next((k for k, (a, b) in enumerate(zip(one, other, strict=False)) if a != b), min(len(one), len(other)))
    cut = slice(max(0, start - 40), start + 60)
    return f"line {number}: {one[cut]!r} -> {other[cut]!r}"


def main() -> int:
    """Produce both sides where they are checkouts, and print a line a file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    parser.add_argument("--quick", action="store_true", help="without verification and study, and with few decks")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="folder that gets the outputs of both sides")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        sides = []
        for name in ("before", "after"):
            given = getattr(options, name).resolve()
            side = (options.keep or Path(temporary)).resolve() / name
            if (given / "dem_bridge").is_dir():
                shutil.rmtree(side, ignore_errors=True)
                produce(given, side, quick=options.quick)
                given = side
            elif not (given / "work").is_dir():
                parser.error(f"{given}: is neither a checkout nor a folder of --keep")
            sides.append(given)
        found = compare(*sides)
    for name, said in found.items():
        print(f"differs  {name}: {said}" if said else f"same     {name}")
    bad = sum(map(bool, found.values()))
    print(f"{len(found) - bad} of {len(found)} the same; left out: {', '.join(ASIDE)}")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
