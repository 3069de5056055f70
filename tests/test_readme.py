"""The README's numbers are those of the committed report, and its example runs as printed."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from tests.helpers.readme_tables import with_tables

ROOT = Path(__file__).parent.parent
NAMES = {
    "LAMMPS": "lammps-granular",
    "twin": "verlet",
    "twin in positions": "verlet in positions",
    "reference": "reference",
    "scipy": "scipy",
    "BCA": "bca",
}


def test_the_table_of_verdicts_is_that_of_the_committed_report() -> None:
    report = json.loads((ROOT / "reports/paper/verdicts.json").read_text(encoding="utf-8"))
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    block = readme.split("<!-- verdicts:")[1].split("<!-- end of verdicts -->")[0]
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in block.splitlines() if line.startswith("| ")
    ][1:]
    assert len(rows) == 12
    for scene, compared, meaning, difference, bar, outcome in rows:
        what, pair = compared.split(", ")
        run, reference = (NAMES[name] for name in pair.split(" - "))
        quantity = {"velocity": "velocity", "arrival at the last cylinder": "arrival_at_end"}[what]
        key = (scene, quantity, run, reference)
        [found] = [v for v in report["verdicts"] if (v["scene"], v["quantity"], v["backend"], v["reference"]) == key]
        assert (meaning, difference, bar, outcome) == (
            found["meaning"],
            f"{found['difference']:.1e}",
            f"{found['reference_uncertainty']:.1e}",
            found["outcome"],
        )


def test_the_tables_of_backends_are_what_the_backends_declare() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert readme == with_tables(readme), "run: python -m tests.helpers.readme_tables"


@pytest.mark.lammps
def test_the_python_example_prints_what_the_readme_says(capsys: pytest.CaptureFixture[str]) -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    code, printed = re.findall(r"```python\n(.*?)```\s+```\n(.*?)```", readme, re.DOTALL)[0]
    exec(compile(code, "README.md", "exec"), {})
    assert capsys.readouterr().out == printed


def test_the_scene_in_the_readme_loads() -> None:
    from dem_bridge.scene_file import parse_scene

    [text] = re.findall(r"```toml\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    scene = parse_scene(text, where="README.md")
    assert scene.n_body == 3
    assert scene.wall_right is not None


def test_every_command_in_the_readme_exists() -> None:
    from dem_bridge.cli import main

    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^dem-bridge (\w+)", readme, re.MULTILINE)) <= set(main.commands)
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"make (\w+)", readme.split("## Use")[0]):
        assert f"\n{target}:" in makefile
