"""The recipes of docs/inherit.md, read from the page."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
PAGE = (ROOT / "docs" / "inherit.md").read_text(encoding="utf-8")
_FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_FORGOTTEN = re.compile(r"Forgotten:\s+`([\w/.]+::\w+)`")


@dataclass(frozen=True)
class Block:
    """What stands in a fence. ``path``: of the file that is made (python, toml: its first line is a comment that says
    so) or changed (diff: its first line)."""

    language: str
    text: str

    @property
    def path(self) -> str:
        first = self.text.split("\n", 1)[0]
        if self.language == "diff":
            return first
        return first[2:] if self.language in ("python", "toml") and re.fullmatch(r"# [\w/.-]+\.\w+", first) else ""

    @property
    def body(self) -> str:
        """Without the line that has the path."""
        return self.text.split("\n", 1)[1] if self.path else self.text

    def added(self) -> str:
        """Of a diff: the new lines alone."""
        return "".join(f"{line[1:]}\n" for line in self.body.splitlines() if line.startswith("+"))

    def patched(self, before: str) -> str:
        """Of a diff: a file's text with it; AssertionError where its old lines do not stand there once."""
        lines = [(line[:1] or " ", line[1:]) for line in self.body.splitlines()]
        old, new = ("".join(f"{line}\n" for mark, line in lines if mark in f" {side}") for side in "-+")
        assert before.count(old) == 1, (
            f"docs/inherit.md: these lines are {before.count(old)} times in {self.path}:\n{old}"
        )
        return before.replace(old, new)


@dataclass(frozen=True)
class Step:
    """One step of a recipe. ``forgotten``: the test that fails without it; '' where all is lost without it."""

    text: str
    blocks: tuple[Block, ...]
    forgotten: str


def blocks(text: str = PAGE) -> tuple[Block, ...]:
    return tuple(Block(*found) for found in _FENCE.findall(text))


def recipes() -> dict[str, tuple[Step, ...]]:
    """What is added -> its steps, in their order."""
    found = {}
    for section in re.split(r"^## ", PAGE, flags=re.MULTILINE):
        title, _, text = section.partition("\n")
        if title.startswith("Add a"):
            parts = re.split(r"^\d+\. ", text, flags=re.MULTILINE)[1:]
            forgotten = [_FORGOTTEN.search(part) for part in parts]
            found[title.split()[-1]] = tuple(
                Step(part.strip(), blocks(part), match[1] if match else "")
                for part, match in zip(parts, forgotten, strict=True)
            )
    return found


def one_more_scene(readme: str) -> str:
    """The step that has no block: the number of scenes in the README."""
    return re.sub(r"^(\d+)(?= scenes are shipped)", lambda match: str(int(match[1]) + 1), readme, flags=re.MULTILINE)
