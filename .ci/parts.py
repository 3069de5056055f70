"""What is run in an environment to see whether it does as another: the parts of ``move_pins.py``.

Of the standard library alone. A part answers with what is not as it should be, so that two environments compare by
what one has found and the other has not.
"""

from __future__ import annotations

import importlib.util
import json
import re
import subprocess
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parent.parent
Done = subprocess.CompletedProcess[str]
#: words of a command and what to add to its environment -> how it ended
Run = Callable[[Sequence[str], Mapping[str, str]], Done]
#: golden decks, LAMMPS and its failures, the contract of the backends
QUICK_TESTS = ("tests/lmp", "tests/test_architecture.py", "tests/backends/test_contract.py", "-m", "not slow")


class Broken(Exception):
    """A part that says nothing, in one line."""


@dataclass(frozen=True)
class Environment:
    """One of the two, and how commands are run in it."""

    name: str
    folder: Path
    work: Path
    run: Run

    def __call__(self, program: str, *words: str) -> Done:
        """Run a program of the environment on this checkout; what it says is kept in ``work``."""
        # nothing from earlier runs, and no kernel that another numba compiled; a LAMMPS that is missing is a failure
        settings = {
            "PYTHONPATH": str(ROOT),
            "DEM_BRIDGE_STORE": "",
            "DEM_BRIDGE_REQUIRE_LAMMPS": "1",
            "NUMBA_CACHE_DIR": str(self.work / f"numba-{self.name}"),
        }
        done = self.run([str(self.folder / "bin" / program), *words], settings)
        with (self.work / f"{self.name}.log").open("a", encoding="utf-8") as log:
            log.write(f"$ {program} {' '.join(words)}\n{done.stdout}{done.stderr}[{done.returncode}]\n\n")
        return done


@dataclass(frozen=True)
class Part:
    """What one part found in one environment."""

    found: Mapping[str, str] = field(default_factory=dict)
    """What is not as it should be -> what is said of it."""
    told: str = ""
    """In a few words; why there is nothing where it broke."""
    broken: bool = False


def doctor(env: Environment, words: Sequence[str]) -> Part:
    done = env("dem-bridge", "doctor", "--json", *words)
    findings = read_json(done.stdout, done)
    bad = {f"{one['name']}: {one['found']}": one["remedy"] for one in findings if not one["fine"]}
    return Part(bad, f"{len(findings) - len(bad)} of {len(findings)} there")


def lint(env: Environment, words: Sequence[str]) -> Part:
    found: dict[str, str] = {}
    for tool in (
        ("ruff", "format", "--check", "."),
        ("ruff", "check", "--output-format", "concise", "."),
        ("mypy", "--cache-dir", str(env.work / f"mypy-{env.name}")),
    ):
        done = env(*tool, *words)
        lines = re.findall(r"^(Would reformat: \S+|\S+?:\d+:.*)$", done.stdout, re.MULTILINE)
        if done.returncode not in (0, 1) or (done.returncode == 1 and not lines):
            raise Broken(f"{tool[0]}: {last_line(done)}")
        found |= {f"{tool[0]}: {line}": "" for line in lines if ": note: " not in line}
    return Part(found, f"{len(found)} complaints")


def suite(env: Environment, words: Sequence[str]) -> Part:
    junit = env.work / f"{env.name}-tests.xml"
    how = ("-q", "-n", "auto", f"--junit-xml={junit}")
    done = env("python", "-m", "pytest", *how, *words)
    if not junit.is_file():
        raise Broken(f"pytest: {last_line(done)}")
    found, cases = {}, list(ElementTree.parse(junit).iter("testcase"))
    for case in cases:
        for kind in ("failure", "error", "skipped"):
            for one in case.iter(kind):
                said = (one.get("message") or "").strip().splitlines()
                found[f"{case.get('classname')}::{case.get('name')}"] = f"{kind}: {said[0] if said else ''}"
    if done.returncode != 0 and not found:
        raise Broken(f"pytest: {last_line(done)}")
    return Part(found, f"{len(cases) - len(found)} of {len(cases)} passed")


def regress(env: Environment, words: Sequence[str]) -> Part:
    file = env.work / f"{env.name}-regress.json"
    done = env("dem-bridge", "regress", "--json", str(file), *words)
    compared = read_json(file, done)["comparisons"]
    changed = [one for one in compared if one["change"] != "SAME"]
    found = {f"{one['change']} {one['scene']}, {one['backend']}": one["sentence"] for one in changed}
    return Part(found, f"{len(compared) - len(changed)} of {len(compared)} SAME")


def paper(env: Environment, words: Sequence[str]) -> Part:
    folder = env.work / f"{env.name}-paper"
    done = env("dem-bridge", "verify", "paper", "--no-cache", "-o", str(folder), *words)
    now, was = read_json(folder / "verdicts.json", done), read_json(ROOT / "reports/paper/verdicts.json", done)
    lines = list(_replay().compared(was, now, []))
    other = [text.rpartition(": ") for word, text in lines if word != "SAME"]
    told = f"{len(lines) - len(other)} of {len(lines)} as in reports/paper"
    return Part({what: said for what, _, said in other}, told)


def _replay() -> Any:
    """How a bundle is replayed: it knows how far honest numbers may move, and is a program of its own, too."""
    place = Path(__file__).resolve().parent.parent / "dem_bridge" / "verification" / "replay.py"
    spec = importlib.util.spec_from_file_location("replay", place)
    if spec is None or spec.loader is None:
        raise Broken(f"{place} cannot be loaded")
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


#: name -> what is run, and its further words for --quick (None: it is left out); what is soon done comes first
PARTS: Mapping[str, tuple[Callable[[Environment, Sequence[str]], Part], Sequence[str] | None]] = {
    "doctor": (doctor, ()),
    "lint": (lint, ()),
    "regress": (regress, ("--backend", "lammps-granular", "--backend", "verlet")),
    "tests": (suite, QUICK_TESTS),
    "paper": (paper, None),
}


def ran(name: str, env: Environment, *, quick: bool) -> Part:
    """A part, or why it says nothing: one that breaks ends no other."""
    part, fewer = PARTS[name]
    try:
        return part(env, (fewer or ()) if quick else ())
    except Broken as error:
        return Part(told=str(error), broken=True)
    except (KeyError, TypeError, ElementTree.ParseError, OSError) as error:
        return Part(told=f"its answer cannot be read ({type(error).__name__}: {error})", broken=True)


def last_line(done: Done) -> str:
    lines = (done.stderr.strip() or done.stdout.strip()).splitlines()
    return f"{lines[-1].strip() if lines else 'it said nothing'} (exit code {done.returncode})"


def read_json(source: Path | str, done: Done) -> Any:
    """What a command wrote; Broken, with what it said last, where that cannot be read."""
    try:
        return json.loads(source.read_text(encoding="utf-8") if isinstance(source, Path) else source)
    except (OSError, ValueError):
        raise Broken(last_line(done)) from None
