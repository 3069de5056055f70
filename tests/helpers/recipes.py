"""Read the recipes of docs/inherit.md from the page, with the files that it shows."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
_SHOWN = re.compile(r"^```\{literalinclude\} (\S+)\n:language: (\w+)\n```$", re.MULTILINE)
PAGE = _SHOWN.sub(
    lambda found: f"```{found[2]}\n{(ROOT / 'docs' / found[1]).read_text(encoding='utf-8')}```",
    (ROOT / "docs" / "inherit.md").read_text(encoding="utf-8"),
)
_FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_FORGOTTEN = re.compile(r"Test of this step:\s+`([\w/.]+::\w+)`")


@dataclass(frozen=True)
class Block:
    """Hold one fenced block of the page.

    ``path``: of the file that is made (python, toml: its first line is a comment that says
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
        """Return the text without the line that has the path."""
        return self.text.split("\n", 1)[1] if self.path else self.text

    def added(self) -> str:
        """Return the new lines of a diff."""
        return "".join(f"{line[1:]}\n" for line in self.body.splitlines() if line.startswith("+"))

    def patched(self, before: str) -> str:
        """Return a file's text with the diff, whose parts are separated by a line of three dots.

        AssertionError unless the old lines of each part stand there once."""
        for part in self.body.split("\n...\n"):
            lines = [(line[:1] or " ", line[1:]) for line in part.splitlines()]
            old, new = ("".join(f"{line}\n" for mark, line in lines if mark in f" {side}") for side in "-+")
            assert before.count(old) == 1, (
                f"docs/inherit.md: these lines are {before.count(old)} times in {self.path}:\n{old}"
            )
            before = before.replace(old, new)
        return before


@dataclass(frozen=True)
class Step:
    """Hold one step of a recipe; ``forgotten``: the test that fails without it, '' where all tests do."""

    text: str
    blocks: tuple[Block, ...]
    forgotten: str


def blocks(text: str = PAGE) -> tuple[Block, ...]:
    return tuple(Block(*fields) for fields in _FENCE.findall(text))


def recipes() -> dict[str, tuple[Step, ...]]:
    """Return the steps of each recipe, in their order, by what it adds."""
    steps_of = {}
    for section in re.split(r"^## ", PAGE, flags=re.MULTILINE):
        title, _, text = section.partition("\n")
        if title.startswith("Add a"):
            parts = re.split(r"^\d+\. ", text, flags=re.MULTILINE)[1:]
            forgotten = [_FORGOTTEN.search(part) for part in parts]
            steps_of[title.split()[2]] = tuple(
                Step(part.strip(), blocks(part), match[1] if match else "")
                for part, match in zip(parts, forgotten, strict=True)
            )
    return steps_of


def one_more_scene(page: str) -> str:
    """Return the page of scenes with one scene more: the step that has no block."""
    return re.sub(r"^(\d+)(?= scenes are shipped)", lambda match: str(int(match[1]) + 1), page, flags=re.MULTILINE)
