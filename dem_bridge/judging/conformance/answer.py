"""The grade of a code: a mapping, a score card of one screen, a badge, JUnit XML and a folder."""

from __future__ import annotations

import json
import textwrap
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from dem_bridge.foundation.files import write_whole
from dem_bridge.judging.conformance.items import Item
from dem_bridge.judging.judgement import KeyedAnswer
from dem_bridge.observables.verdict import Outcome, exit_code
from dem_bridge.report.junit import junit_xml

SCHEMA = "dem-bridge/conformance/1"
RECORD, BADGE, JUNIT = "conformance.json", "badge.svg", "junit.xml"
#: keys of a grade, in their order
KEYS = ("schema", "set", "score", "items", "command", "features", "seed", "scenes", "runs", "files", "changed")
#: names of the counts of a score, by outcome
_SCORE = {
    "passed": Outcome.PASS,
    "failed": Outcome.FAIL,
    "undecided": Outcome.UNDECIDED,
    "not_run": Outcome.NOT_RUN,
    "broken": Outcome.BROKEN,
}
#: further lines of a sentence on the score card, one less for a run that failed: these often have one reason
MOST_FURTHER_LINES = 2
#: widths of the score card
_COLUMNS, _OF_NAMES, _OF_OUTCOMES = 100, 16, 10
_BADGE = (
    '<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="20" role="img" aria-label="{label}: {text}">'
    '<rect width="{left}" height="20" fill="#555"/><rect x="{left}" width="{right}" height="20" fill="{colour}"/>'
    '<g fill="#fff" font-family="Verdana,DejaVu Sans,sans-serif" font-size="11" text-anchor="middle">'
    '<text x="{label_at}" y="14">{label}</text><text x="{text_at}" y="14">{text}</text></g></svg>\n'
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Conformance(KeyedAnswer):
    """The grade of a code: a mapping with the keys :data:`KEYS`, which are attributes, too.

    ``print`` shows the score card; :meth:`save` writes ``conformance.json``, ``junit.xml`` and ``badge.svg``.
    """

    answer_keys: ClassVar[tuple[str, ...]] = KEYS

    record: Mapping[str, Any]
    """What was run: set, command, features, seed, number of unseen scenes, runs and hashes of files."""
    answers: tuple[Item, ...] = ()
    """The items; the key "items" has them with JSON types."""
    changed: tuple[str, ...] = field(default=())
    """Items of stored files whose outcome is another one than the recorded one."""

    def __getitem__(self, key: str) -> Any:
        if key not in KEYS:
            raise KeyError(key)
        return self.as_json()[key]

    @property
    def score(self) -> dict[str, int]:
        """Number of items of each outcome."""
        counts = Counter(item.outcome for item in self.answers)
        return {name: counts[outcome] for name, outcome in _SCORE.items()}

    @property
    def exit_code(self) -> int:
        """3 if a run broke, 1 if an item failed or an outcome changed, 4 if one is undecided, 0 otherwise."""
        outcomes = [item.outcome for item in self.answers]
        return exit_code([*outcomes, Outcome.FAIL] if self.changed else outcomes)

    def as_json(self) -> dict[str, Any]:
        """Return the keys :data:`KEYS` with JSON types; a number that is not finite becomes null."""
        values = {
            **self.record,
            "score": self.score,
            "items": [item.as_json() for item in self.answers],
            "changed": list(self.changed),
        }
        return {key: values[key] for key in KEYS}

    @property
    def headline(self) -> str:
        """The score in one line."""
        score = {
            name.replace("_", " "): count for name, count in self.score.items() if count or name in ("passed", "failed")
        }
        counts = ", ".join(f"{count} {name}" for name, count in score.items())
        record = self.record
        return (
            f"set {record['set']}, {record['scenes']} unseen scenes (seed {record['seed']}), features"
            f" {','.join(record['features'])}: {counts}"
        )

    def card(self) -> str:
        """Return the score card: an item a line, cut to its width; items that were not asked are in one line."""
        lines = []
        for item in self.answers:
            if item.outcome is Outcome.NOT_RUN:
                continue
            cause = f"[{item.cause}] " if item.cause not in ("none", "unknown") else ""
            text = f"{cause}{item.sentence}"
            room = _COLUMNS - _OF_NAMES - _OF_OUTCOMES
            if item.outcome is Outcome.PASS:
                text = textwrap.shorten(text, room, placeholder=" ...")
            first, *rest = textwrap.wrap(text, room) or [""]
            lines.append(f"{item.outcome.value:{_OF_OUTCOMES}}{item.name:{_OF_NAMES}}{first}".rstrip())
            lines += [
                f"{'':{_OF_OUTCOMES + _OF_NAMES}}{line}"
                for line in rest[: MOST_FURTHER_LINES - (item.outcome is Outcome.BROKEN)]
            ]
        names = [item.name for item in self.answers if item.outcome is Outcome.NOT_RUN]
        if names:
            lines.append(f"{Outcome.NOT_RUN.value:{_OF_OUTCOMES}}{', '.join(dict.fromkeys(names))}")
        lines += [f"{'CHANGED':{_OF_OUTCOMES}}{text}" for text in self.changed]
        return "\n".join([*lines, self.headline])

    def badge(self) -> str:
        """Return a badge as SVG: how many of the items that were asked are right."""
        score = self.score
        asked = sum(score.values()) - score["not_run"]
        text = f"{score['passed']} of {asked}"
        wrong = score["failed"] + score["broken"]
        colour = "#4c1" if score["passed"] == asked else "#e05d44" if wrong else "#dfb317"
        label = f"dem-bridge conform {self.record['set']}"
        left, right = 7 * len(label) + 6, 7 * len(text) + 12
        return _BADGE.format(
            width=left + right, left=left, right=right, colour=colour, label=label, text=text,
            label_at=left / 2, text_at=left + right / 2,
        )  # fmt: skip

    def junit(self) -> str:
        """Return JUnit XML with a test case per item."""
        return junit_xml(
            (item.name, item.scene or item.name, item.outcome.value, f"{item.sentence} (cause: {item.cause})")
            for item in self.answers
        )

    def save(self, folder: str | Path) -> None:
        """Write ``conformance.json``, ``junit.xml`` and ``badge.svg`` into ``folder``, which is created if need be."""
        document = json.dumps(self.as_json(), indent=1, allow_nan=False) + "\n"
        write_whole(Path(folder), {RECORD: document, JUNIT: self.junit(), BADGE: self.badge()})

    def __repr__(self) -> str:
        return self.card()
