"""What other projects use in their workflows: the action, the hooks of pre-commit, the test of five lines, the recipe.

Nothing here needs a network. Of the steps that only a runner can do (Python, uploads) the words are checked.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import jinja2
import pytest
import yaml

import dem_bridge as db
from dem_bridge.cli import main
from tests.helpers.fake_runs import CHAIN

ROOT = Path(__file__).parent.parent
ACTION: dict[str, Any] = yaml.safe_load((ROOT / "action.yml").read_text(encoding="utf-8"))
STEPS: list[dict[str, Any]] = ACTION["runs"]["steps"]
[RUN] = [step for step in STEPS if step.get("id") == "run"]
HOOKS = {hook["id"]: hook for hook in yaml.safe_load((ROOT / ".pre-commit-hooks.yaml").read_text(encoding="utf-8"))}
PAGE = (ROOT / "docs" / "howto" / "continuous-integration.md").read_text(encoding="utf-8")
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
#: the programs of this environment come first, as after an installation
ENVIRONMENT = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
BASH = shutil.which("bash")
needs_bash = pytest.mark.skipif(BASH is None, reason="no bash")

#: a code of somebody: a chain by velocity-Verlet, from the JSON of the scene to a CSV file
MY_CODE = """
import csv, json, sys

scene, dt, out = json.load(open(sys.argv[1])), float(sys.argv[2]), sys.argv[3]
chain = scene["chain"]
mass, beta = chain["mass"], chain["stiffness"]
n = len(mass)

def accelerations(x):
    force = [0.0] + [k * max(x[i] - x[i + 1], 0.0) ** 1.5 for i, k in enumerate(beta)] + [0.0]
    return [(force[i] - force[i + 1]) / m for i, m in enumerate(mass)]

x, v = [0.0] * n, list(chain["velocity"])
a, steps, rows = accelerations(x), round(scene["duration"] / dt), []
for step in range(steps + 1):
    rows.append([step * dt, *x, *v])
    half = [v[i] + 0.5 * dt * a[i] for i in range(n)]
    x = [x[i] + dt * half[i] for i in range(n)]
    a = accelerations(x)
    v = [half[i] + 0.5 * dt * a[i] for i in range(n)]
heading = ["time_s", *(f"displacement_{i}_m" for i in range(n)), *(f"velocity_{i}_m_per_s" for i in range(n))]
csv.writer(open(out, "w", newline="")).writerows([heading, *rows])
"""


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """Return a project with a code on its path and the scene that it must solve."""
    (tmp_path / "chain.toml").write_text(CHAIN, encoding="utf-8")
    code = tmp_path / "mycode"
    code.write_text(f"#!{sys.executable}\n{MY_CODE}", encoding="utf-8")
    code.chmod(0o755)
    return tmp_path


def test_the_action_uses_what_it_declares_and_versions_that_do_not_move() -> None:
    text = (ROOT / "action.yml").read_text(encoding="utf-8")
    assert set(re.findall(r"inputs\.([\w-]+)", text)) == set(ACTION["inputs"])
    for output in ACTION["outputs"].values():
        assert re.fullmatch(r"\$\{\{ steps\.run\.outputs\.exit-code \}\}", output["value"])
    assert ACTION["runs"]["using"] == "composite"
    for step in STEPS:
        assert ("uses" in step) != ("run" in step)
        assert "shell" in step or "uses" in step
        # an expression within a script would be code of the caller
        assert "${{" not in step.get("run", "")
        assert re.fullmatch(r"actions/[a-z-]+@v\d+\.\d+\.\d+", step.get("uses", "actions/none@v0.0.0"))
    workflow = (ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8")
    assert f"uses: {STEPS[0]['uses']}\n" in workflow
    assert ACTION["inputs"]["python-version"]["default"] == PYPROJECT["requires-python"].removeprefix(">=")
    [allowed] = re.findall(r"allowed: (.*?)\"", RUN["run"])
    assert allowed.split(", ") == ["conform", "judge", "regress"]
    assert ACTION["inputs"]["command"]["description"].startswith("conform")


def _act(project: Path, command: str, arguments: str) -> tuple[int, Path, str]:
    """Run the step of the action as a runner does; return exit code, report folder and output of the step."""
    assert BASH is not None
    script, temporary = project / "step.sh", project / "runner"
    temporary.mkdir(exist_ok=True)
    script.write_text(RUN["run"], encoding="utf-8")
    files = {"GITHUB_OUTPUT": temporary / "output", "GITHUB_STEP_SUMMARY": temporary / "summary"}
    values = {key: str(path) for key, path in files.items()} | {"RUNNER_TEMP": str(temporary)}
    done = subprocess.run(
        [BASH, "--noprofile", "--norc", "-eo", "pipefail", script],
        cwd=project,
        env={**ENVIRONMENT, **values, "COMMAND": command, "ARGUMENTS": arguments},
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    output = files["GITHUB_OUTPUT"].read_text() if files["GITHUB_OUTPUT"].exists() else done.stderr
    return done.returncode, temporary / "dem-bridge", output


@needs_bash
def test_the_action_judges_and_keeps_page_and_junit(project: Path) -> None:
    words = "--scene chain.toml --command './mycode {scene} {dt} {out.csv}' --dt 1e-6,5e-7 --tolerance 1e-2"
    code, report, output = _act(project, "judge", words)
    assert (code, output) == (0, "exit-code=0\n")
    assert {"index.html", "verdicts.json", "junit.xml", "answer.txt"} <= {path.name for path in report.iterdir()}
    cases = ET.parse(report / "junit.xml").getroot().iter("testcase")
    assert sorted(case.get("name", "").split(":")[0] for case in cases) == ["displacement", "velocity"]
    assert (report / "answer.txt").read_text() in (project / "runner" / "summary").read_text()
    # planted: a code that writes velocities of half steps
    faulty = (
        (project / "mycode")
        .read_text()
        .replace("rows.append([step * dt, *x, *v])", "rows.append([step * dt, *x, *(half if step else v)])")
    )
    (project / "mycode").write_text(faulty, encoding="utf-8")
    code, report, output = _act(project, "judge", words.replace("1e-2", "1e-5"))
    assert (code, output) == (1, "exit-code=0\nexit-code=1\n")
    assert list(ET.parse(report / "junit.xml").getroot().iter("failure"))


@needs_bash
def test_the_action_compares_with_baselines(project: Path) -> None:
    words = "chain.toml --backend verlet --dt 1e-6"
    code, _, output = _act(project, "regress", f"{words} --update")
    assert (code, output.splitlines()[-1]) == (0, "exit-code=0")
    code, report, _ = _act(project, "regress", words)
    assert code == 0
    assert {"regress.json", "regress.md", "junit.xml"} <= {path.name for path in report.iterdir()}
    # planted: a run that has changed, as a baseline with another peak force and the digest of it
    baseline = project / "reports" / "baselines" / "small.verlet.json"
    document = json.loads(baseline.read_text())
    document["contacts"][0]["peak_force"] *= 1.0 + 1e-9
    document["digests"]["peak_force"] = {"in_order": "0" * 16, "sorted": "0" * 16}
    baseline.write_text(json.dumps(document))
    code, report, _ = _act(project, "regress", words)
    assert code == 1
    assert list(ET.parse(report / "junit.xml").getroot().iter("failure"))


@needs_bash
@pytest.mark.slow
def test_the_action_grades_a_code(project: Path) -> None:
    code, report, output = _act(project, "conform", "--command './mycode {scene} {dt} {out.csv}' --scenes 0")
    assert (code, output) == (0, "exit-code=0\n")
    assert {"conformance.json", "junit.xml", "badge.svg", "files"} <= {path.name for path in report.iterdir()}
    assert json.loads((report / "conformance.json").read_text())["score"]["failed"] == 0


@needs_bash
def test_the_action_refuses_another_command_and_expands_nothing(project: Path) -> None:
    code, _, output = _act(project, "study", "")
    assert (code, output) == (2, "command = study; allowed: conform, judge, regress\n")
    code, report, _ = _act(project, "judge", "'$(touch planted)' `touch planted` --scene chain.toml")
    assert code == 2
    assert not (project / "planted").exists()
    assert "$(touch planted)" in (report / "answer.txt").read_text()


@pytest.mark.parametrize("command", ["conform", "judge", "regress"])
def test_the_commands_of_the_action_have_its_options(command: str) -> None:
    options = {flag for parameter in main.commands[command].params for flag in parameter.opts}
    [words] = re.findall(rf"{command}\b[^)]*\) words=\((.*?)\)", RUN["run"])
    assert {word for word in shlex.split(words) if word.startswith("-")} <= options


def _hook(name: str, *files: Path) -> subprocess.CompletedProcess[str]:
    """Run a hook on files as pre-commit does: its entry, split as by a shell, and the names of the files."""
    pattern = re.compile(HOOKS[name]["files"])
    assert all(pattern.search(file.as_posix()) for file in files)
    words = [*shlex.split(HOOKS[name]["entry"]), *map(str, files)]
    return subprocess.run(words, env=ENVIRONMENT, capture_output=True, text=True, timeout=600, check=False)


def test_hooks_have_the_keys_that_pre_commit_needs() -> None:
    for hook in HOOKS.values():
        assert {"id", "name", "entry", "language", "files"} <= set(hook)
        assert hook["language"] == "python"
        assert shlex.split(hook["entry"])[0] == "sh"


def test_the_hook_of_scenes_refuses_a_wrong_scene_and_names_every_one(tmp_path: Path) -> None:
    folder = tmp_path / "scenes"
    folder.mkdir()
    for name, text in (
        ("right", CHAIN),
        ("key", CHAIN.replace("mass", "mas")),
        ("sign", CHAIN.replace("4.0e9", "-4.0e9")),
    ):
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    right, *wrong = (folder / f"{name}.toml" for name in ("right", "key", "sign"))
    done = _hook("dem-bridge-scene", right)
    assert (done.returncode, done.stderr) == (0, "")
    done = _hook("dem-bridge-scene", *wrong, right)
    assert (done.returncode, done.stdout) == (1, "")
    assert "key.toml" in done.stderr
    assert "sign.toml" in done.stderr


@pytest.mark.lammps
def test_the_hook_of_scripts_refuses_a_step_that_is_too_coarse(tmp_path: Path) -> None:
    scene = tmp_path / "chain.toml"
    scene.write_text(CHAIN, encoding="utf-8")
    for name, dt in (("fine", 1e-7), ("coarse", 8e-6)):
        db.write_deck(scene, tmp_path / name, dt=dt)
    fine, coarse = (tmp_path / name / "in.small" for name in ("fine", "coarse"))
    done = _hook("dem-bridge-check", coarse, fine)
    assert done.returncode == 1
    assert "outcome" in done.stdout or "FAIL" in done.stdout
    assert _hook("dem-bridge-check", fine).returncode == 0


def test_the_test_of_five_lines_passes_a_right_code_and_names_the_cause_of_a_wrong_one(project: Path) -> None:
    [recipe] = re.findall(r"^```python\n(import dem_bridge as db\n.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    assert len([line for line in recipe.splitlines() if line]) == 5
    (project / "test_mycode.py").write_text(recipe, encoding="utf-8")
    words = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_mycode.py"]
    environment = {**ENVIRONMENT, "PATH": f"{project}{os.pathsep}{ENVIRONMENT['PATH']}"}

    def run() -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            words, cwd=project, env=environment, capture_output=True, text=True, timeout=600, check=False
        )

    done = run()
    assert done.returncode == 0, done.stdout
    code = (project / "mycode").read_text(encoding="utf-8")
    (project / "mycode").write_text(code.replace("** 1.5", "** 1.45"), encoding="utf-8")
    done = run()
    assert done.returncode == 1
    assert "exponent" in done.stdout


def _recipe() -> dict[str, Any]:
    """Return the recipe of conda-build as a document; its templates are those of jinja."""
    text = (ROOT / "conda" / "meta.yaml").read_text(encoding="utf-8")
    document: dict[str, Any] = yaml.safe_load(jinja2.Template(text).render(PYTHON="python"))
    return document


def _bounds(requirements: list[str]) -> dict[str, str]:
    """Return the lower bound of each package of a list of requirements."""
    bounds = {}
    for requirement in requirements:
        name, _, bound = requirement.partition(";")[0].partition(">=")
        bounds[name.strip().lower()] = bound.strip()
    return bounds


def test_the_conda_recipe_needs_what_the_package_needs() -> None:
    recipe = _recipe()
    assert recipe["package"] == {"name": PYPROJECT["name"], "version": db.__version__}
    needed = _bounds(PYPROJECT["dependencies"]) | {"python": PYPROJECT["requires-python"].removeprefix(">=")}
    del needed["mpich"]  # LAMMPS of conda-forge has the MPI library that it needs
    needed["matplotlib-base"] = needed.pop("matplotlib")
    assert _bounds(recipe["requirements"]["run"]) == needed
    build = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["build-system"]["requires"]
    host = _bounds(recipe["requirements"]["host"])
    assert {name: host[name] for name in _bounds(build)} == _bounds(build)
    scripts = [f"{name} = {target}" for name, target in PYPROJECT["scripts"].items()]
    assert recipe["build"]["entry_points"] == scripts
    assert (recipe["about"]["summary"], recipe["about"]["license"]) == (PYPROJECT["description"], PYPROJECT["license"])
    assert (ROOT / "conda" / recipe["source"]["path"] / recipe["about"]["license_file"]).is_file()


def test_the_tests_of_the_conda_recipe_run(tmp_path: Path) -> None:
    checks = _recipe()["test"]
    commands = [*(f"python -c 'import {name}'" for name in checks["imports"]), *checks["commands"]]
    for command in commands:
        done = subprocess.run(
            shlex.split(command),
            cwd=tmp_path,
            env=ENVIRONMENT,
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
        assert (done.returncode, done.stderr) == (0, ""), command


def test_the_page_shows_the_hooks_and_the_inputs_of_the_action() -> None:
    blocks = [yaml.safe_load(block) for block in re.findall(r"^```yaml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)]
    [hooks] = [block for block in blocks if "repos" in block]
    assert {hook["id"] for hook in hooks["repos"][0]["hooks"]} == set(HOOKS)
    [workflow] = [block for block in blocks if "jobs" in block]
    [step] = [step for step in workflow["jobs"]["dem"]["steps"] if "dem_bridge" in step.get("uses", "")]
    assert set(step["with"]) <= set(ACTION["inputs"])
    assert step["with"]["command"] in main.commands
