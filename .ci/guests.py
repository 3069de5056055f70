"""Run the tests where no studies are installed: ``make guests``.

Studies are guests of the package: nothing else needs them. This copies the checkout without ``dem_bridge/studies``
(their catalogue with them) and ``tests/studies``, and runs the suite there. ``ARGS`` are given to pytest; without any,
what ``make test`` runs is run. The exit code is that of pytest.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parent.parent
GUESTS = ("dem_bridge/studies", "tests/studies")


def copy_without_guests(copy: Path) -> None:
    """Copy the files of the checkout that git knows or would take, without the studies and their tests."""
    listed = subprocess.run(
        ["git", "ls-files", "-coz", "--exclude-standard"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    for name in filter(None, listed.stdout.split("\0")):
        if not name.startswith(tuple(f"{guest}/" for guest in GUESTS)) and (ROOT / name).is_file():
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, copy / name)
    # some tests ask git for the files of the package
    for words in (("init", "--quiet"), ("add", "--all")):
        subprocess.run(["git", *words], cwd=copy, check=True)


def main(words: Sequence[str]) -> int:
    """Run the suite in a copy of its own and return the exit code of pytest."""
    with TemporaryDirectory(prefix="dem-bridge-guests-") as folder:
        copy = Path(folder)
        copy.chmod(0o755)  # some tests read the package as a user who owns nothing
        copy_without_guests(copy)
        # the package of the copy goes before the installed one
        environment = {**os.environ, "PYTHONPATH": str(copy)}
        chosen = words or ("-n", "auto", "-m", "not slow")
        tests = [sys.executable, "-m", "pytest", *chosen]
        return subprocess.run(tests, cwd=copy, env=environment, check=False).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
