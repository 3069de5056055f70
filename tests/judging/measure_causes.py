"""Count how often the judge names the cause of planted faults: python -m tests.judging.measure_causes -n 300 --seed 1.

Each line of the lists can be repeated by ``-n 1 --seed SEED``. Two processes at most.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
import traceback
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

import dem_bridge as db
from dem_bridge.formats.readers.record import Record
from dem_bridge.judging.cause import diagnose
from tests.helpers.planted.cases import Case, draw
from tests.helpers.planted.files import rounded

#: effects below so many floors need not be named
LEAST = 50.0


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What the judge answers to a case."""

    seed: int
    kind: str
    fault: str
    effect: float
    truth: tuple[str, ...]
    also: tuple[str, ...]
    parts: tuple[tuple[str, ...], ...]
    cause: str
    faults: tuple[str, ...]
    alternatives: tuple[str, ...]
    where: str
    place: int | None
    evidence: str
    seconds: float
    case: str

    @property
    def grade(self) -> str:
        """in the set, defensible, unknown, or wrong; of right files and small effects "none" is no mistake.

        Of two faults at once: both named, one named (defensible if the other is below 50 floors), unknown, or wrong.
        """
        if self.parts and self.cause not in ("none", "unknown", "broken"):
            first, second = self.parts
            if len(self.faults) == 2 and any(a in first and b in second for a, b in (self.faults, self.faults[::-1])):
                return "both named"
            single = "one named" if self.cause in first or self.cause in second else "wrong"
            return "defensible" if self.cause in self.also else single
        if self.cause in self.truth and not self.parts:
            return "in the set"
        if self.cause in self.also:
            return "defensible"
        if self.cause == "unknown":
            return "unknown"
        if self.cause == "none" and self.effect < LEAST:
            return "none"
        return "broken" if self.cause == "broken" else "wrong"

    @property
    def place_is_right(self) -> bool | None:
        """True if ``where`` names the right body or contact; None if the fault has no place."""
        if self.place is None or self.cause not in ("mass", "stiffness", "missed-contact"):
            return None
        digits = "".join(letter if letter.isdigit() else " " for letter in self.where).split()
        return str(self.place) in digits or "wall" in self.where


def own_record(case: Case) -> Record:
    """Return the record of a case, without a file."""
    planted, digits = case.planted, case.planted.setting.digits
    values = {name: rounded(data, digits) for name, data in planted.run.values.items()}
    exponents = {name: np.floor(np.log10(np.maximum(np.abs(data), 1e-300))) for name, data in values.items()}
    rounding = {name: np.maximum(0.5 * 10.0 ** (exponents[name] + 1 - digits), 1e-300) for name in values}
    bodies = tuple(planted.setting.bodies or range(planted.chain.n_body))
    return Record(
        name=f"case{case.seed}",
        time=planted.run.time,
        values=values,
        columns=dict.fromkeys(values, bodies),
        rounding={**rounding, "time": np.spacing(planted.run.time)},
        dt=planted.setting.dt if planted.setting.dt_stated else None,
    )


def judge(case: Case, folder: Path, by: str) -> dict[str, Any]:
    """Return what the judge answers to a case, and the seconds that it took."""
    path, scene, dt = case.write(folder)
    loaded, record = db.load_scene(scene), own_record(case)
    began = time.perf_counter()
    if by == "diagnose":
        answer = vars(diagnose(loaded, [record]))
    else:
        package: Any = db
        answer = dict(package.judge([str(path) if dt is None else f"{path}@{dt!r}"], loaded))
    seconds = time.perf_counter() - began
    faults = [asdict(fault) if by == "diagnose" else fault for fault in answer["faults"]]
    return {
        **{key: str(answer[key] or "") for key in ("cause", "where", "evidence")},
        "alternatives": tuple(answer["alternatives" if by == "diagnose" else "alternative_causes"]),
        "faults": tuple(fault["cause"] for fault in faults),
        "seconds": seconds,
    }


Task = tuple[int, str | None, str | None, str]


def answer(task: Task) -> Answer:
    """Draw the case of a seed and judge it."""
    seed, kind, fault, by = task
    case = draw(seed, kind=kind, fault=fault)
    with tempfile.TemporaryDirectory() as folder:
        try:
            found = judge(case, Path(folder), by)
        except Exception:
            found = {"cause": "broken", "alternatives": (), "faults": (), "where": "", "seconds": 0.0}
            found["evidence"] = traceback.format_exc(limit=-3)
    planted = case.planted
    return Answer(
        seed=seed,
        kind=case.kind,
        fault=planted.fault,
        effect=planted.effect,
        truth=tuple(sorted(planted.truth)),
        also=tuple(sorted(planted.also)),
        parts=tuple(tuple(sorted(part)) for part in planted.parts),
        place=planted.where,
        case=str(case),
        **found,
    )


def answers(tasks: list[Task], jobs: int) -> Iterator[Answer]:
    """Yield the answers to all cases as they are ready, from at most two processes."""
    if jobs < 2:
        yield from map(answer, tasks)
        return
    with get_context("spawn").Pool(2) as pool:
        yield from pool.imap_unordered(answer, tasks)


def _count(title: str, rows: Iterable[Answer]) -> list[str]:
    grades = Counter(row.grade for row in rows)
    total = sum(grades.values())
    shares = ", ".join(f"{count} {grade} ({100.0 * count / total:.1f} %)" for grade, count in grades.most_common())
    return [f"{title}: {total} files" + (f": {shares}" if total else "")]


def table(rows: list[Answer]) -> str:
    """Return the confusion table and the lists of what is wrong."""
    large = [row for row in rows if row.effect >= LEAST and row.kind == "listed"]
    lines = _count(f"faults of the list, effect {LEAST:g} floors or more", large)
    lines += _count("right files", [row for row in rows if row.kind == "none"])
    lines += _count(
        f"effect below {LEAST:g} floors", [row for row in rows if row.kind != "none" and row.effect < LEAST]
    )
    others = [row for row in rows if row.kind in ("pair", "outside") and row.effect >= LEAST]
    for kind, title in {"pair": "two faults at once", "outside": "faults outside of the list"}.items():
        lines += _count(title, [row for row in others if row.kind == kind])
    places = [row.place_is_right for row in large if row.place_is_right is not None]
    lines += [f"body or contact named: {sum(places)} of {len(places)}"]
    missing = [row for row in large if row.grade == "in the set" and not {row.cause, *row.alternatives} & {row.fault}]
    lines += [f"the planted cause is neither cause nor alternative: {len(missing)}"]
    seconds = sorted(row.seconds for row in rows)
    lines += [f"seconds per file: median {seconds[len(seconds) // 2]:.2f}, largest {seconds[-1]:.2f}", ""]
    confusion: dict[str, Counter[str]] = defaultdict(Counter)
    for row in [*large, *others, *(row for row in rows if row.kind == "none")]:
        confusion[row.fault][row.cause] += 1
    width = max(map(len, confusion), default=0)
    for fault, causes in sorted(confusion.items()):
        lines.append(f"{fault:{width}}  " + ", ".join(f"{cause} {count}" for cause, count in causes.most_common()))
    for grade in ("broken", "wrong", "one named", "defensible", "unknown"):
        listed = [
            row for row in rows if row.grade == grade and (grade != "unknown" or row in large or row.kind == "none")
        ]
        lines += ["", f"{grade}: {len(listed)}"]
        for row in listed:
            lines.append(
                f"  {row.case}\n    truth {', '.join(row.truth)}; named {row.cause} {row.where}: {row.evidence}"
            )
    wrong_place = [row for row in large if row.place_is_right is False]
    lines += ["", f"wrong place: {len(wrong_place)}"]
    lines += [f"  {row.case}\n    {row.place} is right; named {row.where}" for row in wrong_place]
    return "\n".join(lines)


def main() -> None:
    """Judge the files of consecutive seeds and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-n", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1, help="first seed")
    parser.add_argument("--kind", choices=("listed", "none", "pair", "outside"))
    parser.add_argument("--fault")
    parser.add_argument("--by", choices=("judge", "diagnose"), default="judge", help="db.judge on files, or diagnose")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("-o", type=Path, help="file of JSON lines to append the answers to")
    options = parser.parse_args()
    os.nice(5)
    rows = []
    tasks = [(options.seed + k, options.kind, options.fault, options.by) for k in range(options.n)]
    for row in answers(tasks, options.jobs):
        rows.append(row)
        print(f"{len(rows)} seed {row.seed} {row.fault}: {row.cause} ({row.grade}, {row.seconds:.1f} s)", flush=True)
        if options.o:
            with options.o.open("a") as file:
                file.write(json.dumps(asdict(row)) + "\n")
    print(table(sorted(rows, key=lambda row: row.seed)))


if __name__ == "__main__":
    main()
