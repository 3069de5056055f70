"""The numbers of README and pages are those of the committed report, and the examples there run."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
from pathlib import Path

import click
import pytest

from tests.helpers.backend_tables import PAGE, with_tables
from tests.helpers.command_line import run_here

ROOT = Path(__file__).parent.parent
NAMES = {
    "LAMMPS": "lammps-granular",
    "twin": "verlet",
    "twin in positions": "verlet in positions",
    "reference": "reference",
    "scipy": "scipy",
    "BCA": "bca",
}
GUIDES = sorted(str(page.relative_to(ROOT)) for page in (ROOT / "docs" / "howto").glob("*.md"))
PAGES_WITH_COMMANDS = [
    "README.md",
    "docs/start.md",
    "docs/commands.md",
    "docs/editors.md",
    "docs/index.md",
    "docs/questions.md",
    "docs/regression.md",
    *GUIDES,
]


@pytest.mark.parametrize(("page", "count"), [("README.md", 4), ("docs/paper.md", 12)])
def test_the_table_of_verdicts_is_that_of_the_committed_report(page: str, count: int) -> None:
    report = json.loads((ROOT / "reports/paper/verdicts.json").read_text(encoding="utf-8"))
    text = (ROOT / page).read_text(encoding="utf-8")
    block = text.split("<!-- verdicts:")[1].split("<!-- end of verdicts -->")[0]
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in block.splitlines() if line.startswith("| ")
    ][1:]
    assert len(rows) == count
    for scene, compared, meaning, difference, uncertainty, tolerance, outcome in rows:
        what, pair = compared.split(", ")
        run, reference = (NAMES[name] for name in pair.split(" - "))
        quantity = {"velocity": "velocity", "arrival at the last cylinder": "arrival_at_end"}[what]
        key = (scene, quantity, run, reference)
        [verdict] = [v for v in report["verdicts"] if (v["scene"], v["quantity"], v["backend"], v["reference"]) == key]
        assert (meaning, difference, uncertainty, tolerance, outcome) == (
            verdict["meaning"],
            f"{verdict['difference']:.1e}",
            f"{verdict['reference_uncertainty']:.1e}",
            "-" if verdict["tolerance"] is None else f"{verdict['tolerance']:.1e}",
            verdict["outcome"],
        )


def test_the_tables_of_backends_are_what_the_backends_declare() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert page == with_tables(page), "run: python -m tests.helpers.backend_tables"


@pytest.mark.lammps
@pytest.mark.parametrize("page", ["README.md", "docs/start.md"])
def test_the_python_example_prints_what_the_page_says(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    for scene in re.findall(r"```toml\n(.*?)```", text, re.DOTALL):
        (tmp_path / "two-sizes.toml").write_text(scene, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    [(code, printed)] = re.findall(r"```python\n(.*?)```\s+```(?:text)?\n(.*?)```", text, re.DOTALL)
    exec(compile(code, page, "exec"), {})
    assert capsys.readouterr().out == printed


@pytest.mark.parametrize("page", ["docs/start.md", "docs/scenes.md"])
def test_the_scene_on_the_page_loads(page: str) -> None:
    from dem_bridge.scene.file import parse_scene

    texts = re.findall(r"```toml\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL)
    scene, *_ = [parse_scene(text, where=page) for text in texts]
    assert scene.n_body == 3
    assert scene.wall_right is not None
    assert (scene.precompression > 0.0, scene.drive is not None) == ((page == "docs/scenes.md",) * 2)


@pytest.mark.parametrize("page", PAGES_WITH_COMMANDS)
def test_every_command_on_the_page_is_understood(page: str) -> None:
    from dem_bridge.cli import main

    lines = re.findall(r"^ *(dem-bridge .*?)(?: +#.*)?$", (ROOT / page).read_text(encoding="utf-8"), re.MULTILINE)
    assert lines
    for line in lines:
        command: click.Command = main
        # the last line of a script in quotes ends with one
        words = shlex.split(line.rstrip("'") if line.count("'") % 2 else line)[1:]
        if words[0] == "study":
            pytest.importorskip("dem_bridge.studies")
        while isinstance(command, click.Group):
            command, words = command.commands[words[0]], words[1:]
        command.make_context(line, words)


def test_the_page_of_commands_has_every_command() -> None:
    from dem_bridge.cli import main

    page = (ROOT / "docs/commands.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^dem-bridge (\w+)", page, re.MULTILINE)) == set(main.commands)


def test_every_make_target_in_the_readme_exists() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = re.findall(r"^make ([\w-]+)|`make ([\w-]+)`", readme, re.MULTILINE)
    assert len(targets) == 4
    assert [target for target in map("".join, targets) if f"\n{target}:" not in makefile] == []


def test_verify_installs_the_package_and_test_adds_the_tools(tmp_path: Path) -> None:
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        (tmp_path / name).write_bytes((ROOT / name).read_bytes())

    def installed(target: str) -> list[str]:
        done = subprocess.run(["make", "-n", target], cwd=tmp_path, capture_output=True, text=True, check=True)
        return re.findall(r"pip install .* -e '?(\.\S*?)'?$", done.stdout, re.MULTILINE)

    assert (installed("verify"), installed("test")) == (["."], [".", ".[dev]"])
    (tmp_path / ".venv").mkdir()
    for stamp in (".installed-core", ".installed"):
        (tmp_path / ".venv" / stamp).touch()
    assert installed("test") == installed("verify") == []


@pytest.mark.lammps
def test_the_readme_begins_with_what_the_demonstration_prints(tmp_path: Path) -> None:
    done = run_here("demo", "-o", "page", cwd=tmp_path)
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    # round-off differs between processors
    shown, printed = (re.sub(r"error to \S+\.$|Page.*", "", part, flags=re.MULTILINE) for part in (text, done.stdout))
    assert printed.strip() in shown
    assert text.index("dem-bridge demo") < text.index("![Left") < text.index("Chaunsali")


def test_the_readme_is_short() -> None:
    # one screen and a half of 60 lines; everything else is in docs
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 90
