"""Follow docs/inherit.md in a copy of the checkout: ``python -m tests.follow_the_page [RECIPE]...``.

Each recipe is followed to its end, and the tests that it names must pass. Then each step is left out in turn, and the
test that the page names for it must fail. Takes some minutes; ``--whole`` makes the report of the paper anew, too.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.helpers.recipes import ROOT, Step, one_more_scene, recipes

#: commands that take minutes, and what cannot pass without them
LONG = "verify paper"
NEEDS_LONG = "test_the_committed_report_has_every_shipped_scene"


def main(words: list[str]) -> int:
    whole = "--whole" in words
    names = [word for word in words if word != "--whole"] or list(recipes())
    wrong = []
    for name in names:
        steps = recipes()[name]
        with TemporaryDirectory() as folder:
            complete = followed(Path(folder) / "complete", steps, whole=whole)
            tests = {step.forgotten for step in steps if step.forgotten and (whole or NEEDS_LONG not in step.forgotten)}
            new_tests = {block.path for step in steps for block in step.blocks if "/test_" in block.path}
            if not told(f"{name}: all steps", passes(complete, sorted(tests | new_tests)), True):
                wrong.append(name)
            for number, step in enumerate(steps, 1):
                if step.forgotten:
                    without = followed(Path(folder) / str(number), [*steps[: number - 1], *steps[number:]], whole=False)
                    if not told(f"{name}: without step {number}", passes(without, [step.forgotten]), False):
                        wrong.append(f"{name} {number}")
                    shutil.rmtree(without)
    print(f"not as the page says: {', '.join(wrong)}" if wrong else "all as the page says")
    return 1 if wrong else 0


def told(what: str, passed: bool, expected: bool) -> bool:
    print(f"{'ok   ' if passed is expected else 'WRONG'} {what}: {'passes' if passed else 'fails'}", flush=True)
    return passed is expected


def followed(copy: Path, steps: Sequence[Step], *, whole: bool) -> Path:
    """A copy of the checkout with these steps done; kept kernels are taken along."""
    ignored = shutil.ignore_patterns(".git", ".venv*", ".mypy_cache", ".pytest_cache", ".hypothesis", "latest")
    shutil.copytree(ROOT, copy, ignore=ignored)
    for step in steps:
        for block in step.blocks:
            file = copy / block.path
            if block.language == "diff":
                file.write_text(block.patched(file.read_text(encoding="utf-8")), encoding="utf-8")
            elif block.language == "sh":
                if whole or LONG not in block.text:
                    subprocess.run(block.text, shell=True, cwd=copy, env=_environment(copy), check=False)
            else:
                assert not file.exists(), f"{block.path} is there already"
                file.write_text(block.body, encoding="utf-8")
        if not step.blocks:
            page = copy / "docs" / "scenes.md"
            page.write_text(one_more_scene(page.read_text(encoding="utf-8")), encoding="utf-8")
    return copy


def passes(copy: Path, tests: Sequence[str]) -> bool:
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests],
        cwd=copy, env=_environment(copy), capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode not in (0, 1):  # 1: a test failed; what cannot even be collected proves nothing
        raise SystemExit(f"pytest ended with {done.returncode}:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return done.returncode == 0


def _environment(copy: Path) -> dict[str, str]:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return {**os.environ, "PYTHONPATH": str(copy), "PATH": path, "DEM_BRIDGE_STORE": ""}


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
