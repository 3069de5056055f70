"""docs/inherit.md is true: what it names exists, its examples run, and a step that is forgotten fails a test.

``python -m tests.follow_the_page`` follows it from end to end in a copy.
"""

from __future__ import annotations

import ast
import doctest
import inspect
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import click
import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.api.guests import STUDIES
from dem_bridge.backends import catalogue
from dem_bridge.backends.base import BACKENDS, backend
from dem_bridge.backends.catalogue import Entry
from dem_bridge.cli import main
from dem_bridge.runs.costs import evaluations_of
from dem_bridge.scene.scene import Scene
from dem_bridge.verification.verify import plan_scene
from tests.conftest import Solve
from tests.helpers.export_chains import CROSSED
from tests.helpers.move_pins import move_pins
from tests.helpers.recipes import PAGE, ROOT, Block, blocks, one_more_scene, recipes
from tests.helpers.registered import registered

COMMANDS, PAPER, SCENES = (
    (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8") for name in ("commands", "paper", "scenes")
)
VERDICTS = json.loads((ROOT / "reports/paper/verdicts.json").read_text(encoding="utf-8"))
#: in physics each of these is near one that has baselines, and all are in the report
WITHOUT_BASELINE = {
    "accelerating-200", "accelerating-40-heavier", "accelerating-40-lighter", "decelerating-200",
    "decelerating-40-drag", "decelerating-40-exact", "decelerating-40-gaps", "decelerating-40-graded-exponent",
    "decelerating-40-heavier", "decelerating-40-kuwabara-kono", "decelerating-40-lighter", "decelerating-40-on-base",
    "decelerating-40-scattered", "decelerating-40-soft-exponent", "driven-monomer", "homogeneous-cylinders",
    "stacked-40", "tapered-backward", "tapered-forward",
}  # fmt: skip
MADE = [block for block in blocks() if block.path and block.language != "diff"]
DIFFS = [block for block in blocks() if block.language == "diff"]


def _sources(folder: str, pattern: str = "*.py") -> Iterator[tuple[Path, ast.Module]]:
    for file in sorted((ROOT / folder).rglob(pattern)):
        yield file, ast.parse(file.read_text(encoding="utf-8"))


# the page


def test_every_recipe_has_steps_and_a_test_for_each_but_the_first() -> None:
    assert set(recipes()) == {"backend", "observable", "scene", "field", "fault", "study"}
    for name, steps in recipes().items():
        assert len(steps) > 1, name
        assert all(step.forgotten for step in steps[1:]), name


def _counted(paths: set[str]) -> str:
    """Return how many of these files are new and how many are changed, as the page says it."""
    new = {block.path for block in MADE}
    counts = {"new": len(paths & new), "changed": len(paths - new)}
    return ", ".join(f"{count} {word}" for word, count in counts.items() if count) or "none"


@pytest.mark.parametrize("name", recipes())
def test_the_page_counts_the_files_that_a_change_touches(name: str) -> None:
    paths = {block.path for step in recipes()[name] for block in step.blocks if block.path}
    package, tests = (_counted({path for path in paths if path.startswith(f)}) for f in ("dem_bridge/", "tests/"))
    assert paths == {path for path in paths if path.startswith(("dem_bridge/", "tests/"))}
    article = "an" if name[0] in "aeiou" else "a"
    assert len(re.findall(rf"^\| {article} {name}(?: of scenes)? \| {package} \| {tests} \| ", PAGE, re.MULTILINE)) == 1


@pytest.mark.parametrize("name", sorted(set(re.findall(r"`(tests/[\w/.]+::\w+)`", PAGE))))
def test_every_test_on_the_page_exists(name: str) -> None:
    file, function = name.split("::")
    text = (ROOT / file).read_text(encoding="utf-8")
    assert re.search(rf"^def {function}\(", text, re.MULTILINE), name


@pytest.mark.studies
def test_every_file_on_the_page_exists_and_what_it_makes_does_not() -> None:
    new_files = {block.path for block in MADE}
    for path in new_files:
        assert not (ROOT / path).exists(), path
        assert (ROOT / path).parent.is_dir(), path
    prose = re.sub(r"^```.*?^```$", "", PAGE, flags=re.MULTILINE | re.DOTALL)
    paths = set(re.findall(r"`((?:[\w.-]+/)+[\w.-]*|[\w-]+\.(?:md|toml|txt))`", prose))
    paths |= {f"docs/{link}" for link in re.findall(r"\]\(([\w./-]+)\)", prose)}
    of_users = {"my-chain.toml", "reports/latest/pins/pins.md"}
    assert len(paths) > 20
    assert {path for path in paths - new_files - of_users if not (ROOT / path).exists()} == set()


def test_every_make_target_on_the_page_exists() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"\bmake ([a-z]+)(?=[`\s])", "\n".join([*re.findall(r"`make .*?`", PAGE), *_shell()])))
    assert {"setup", "lint", "test", "docs", "pins", "bench", "machines", "wheels"} == targets
    assert all(f"\n{target}:" in makefile for target in targets)


def _shell() -> list[str]:
    return [
        line.split("#")[0].strip() for block in blocks() if block.language == "sh" for line in block.text.splitlines()
    ]


def _commands() -> list[str]:
    prose = re.findall(r"`(dem-bridge [^`]*)`", PAGE)
    return [line for line in [*prose, *_shell()] if line.startswith("dem-bridge ")]


@pytest.mark.parametrize("line", _commands())
def test_every_command_on_the_page_is_understood(line: str) -> None:
    command: click.Command = main
    words = shlex.split(line)[1:]
    while isinstance(command, click.Group) and words:
        assert words[0] in command.commands, line
        command, words = command.commands[words[0]], words[1:]
    if "--table" in words:
        words.insert(0, "decelerating-40")  # in prose
    if words:
        command.make_context(line, words)


@pytest.mark.parametrize("words", re.findall(r'ARGS="(.*?)"', PAGE))
def test_every_way_to_move_the_pins_is_understood(words: str) -> None:
    move_pins.asked(shlex.split(words))


@pytest.mark.parametrize("block", DIFFS, ids=lambda block: block.path)
def test_every_change_on_the_page_fits_the_file_as_it_is(block: Block) -> None:
    before = (ROOT / block.path).read_text(encoding="utf-8")
    after = block.patched(before)
    assert after != before
    if block.path.endswith(".py"):
        ast.parse(after)


# its examples


@pytest.fixture
def built(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], list[ModuleType]]:
    """The modules of a recipe, as if their files were there."""

    def build(name: str) -> list[ModuleType]:
        examples = []
        for block in (block for step in recipes()[name] for block in step.blocks if block in MADE):
            module = ModuleType(block.path.removesuffix(".py").replace("/", "."))
            monkeypatch.setitem(sys.modules, module.__name__, module)
            exec(compile(block.body, block.path, "exec"), module.__dict__)
            examples.append(module)
        return examples

    return build


def _run(modules: list[ModuleType], solved: Solve) -> int:
    """Run what is a test in them; how many there were."""
    count = 0
    for module in modules:
        results = [
            doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE).run(example)
            for example in doctest.DocTestFinder(exclude_empty=True).find(module)
        ]
        assert sum(result.failed for result in results) == 0
        count += sum(result.attempted > 0 for result in results)
        for name, test in vars(module).items():
            if name.startswith("test_"):
                test(**({"solved": solved} if "solved" in inspect.signature(test).parameters else {}))
                count += 1
    return count


def test_the_example_of_a_backend_runs_within_its_bars(
    built: Callable[[str], list[ModuleType]], monkeypatch: pytest.MonkeyPatch, solved: Solve
) -> None:
    modules = built("backend")
    more = {"leapfrog": Entry("dem_bridge.backends.leapfrog", "Leapfrog", "", "")}
    monkeypatch.setattr(catalogue, "BACKENDS", {**BACKENDS, **more})
    assert _run(modules, solved) == 1
    scene = Scene(name="pair", duration=2e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=20)
    run, truth = solved(scene, "leapfrog", dt=1e-7), solved(scene, "reference")
    error = np.max(np.abs(run.velocity - truth.velocity))
    assert 0.0 < error <= run.uncertainty["velocity"] + truth.uncertainty["velocity"]
    assert evaluations_of("leapfrog") == _evaluations(solved(scene, "leapfrog", dt=1e-7, uncertainty=False))


def test_the_example_of_an_observable_runs(built: Callable[[str], list[ModuleType]], solved: Solve) -> None:
    modules = built("observable")
    assert _run(modules, solved) == 2
    with registered(modules[0].DECLARED[0]):
        table = db.table_of(CROSSED, "observables", backend="verlet", dt=1e-6)
    assert any(note.startswith("centre of mass: largest magnitude at samples, 3.38108e-05 m") for note in table.notes)


def test_the_example_of_a_study_runs(built: Callable[[str], list[ModuleType]], solved: Solve) -> None:
    modules = built("study")
    assert _run(modules, solved) == 1
    assert "times smaller" in modules[1].study_halving(modules[1].PRESSED).answer[0]


def test_the_example_of_a_field_changes_few_files_and_no_backend_that_refuses_it(tmp_path: Path) -> None:
    blocks_of_field = [block for step in recipes()["field"] for block in step.blocks]
    changed = {block.path for block in blocks_of_field if block.path.startswith("dem_bridge/")}
    assert len(changed) <= 8
    modules = {entry.module.replace(".", "/") + ".py" for entry in BACKENDS.values()}
    assert changed & modules == {"dem_bridge/backends/verlet.py"}
    shutil.copytree(ROOT / "dem_bridge", tmp_path / "dem_bridge", ignore=shutil.ignore_patterns("__pycache__"))
    [test] = [block for block in blocks_of_field if block in MADE]
    (tmp_path / "test_magnet.py").write_text(test.body, encoding="utf-8")
    for block in blocks_of_field:
        if block.path in changed:
            file = tmp_path / block.path
            file.write_text(block.patched(file.read_text(encoding="utf-8")), encoding="utf-8")
            assert len(file.read_text(encoding="utf-8").splitlines()) <= 500, block.path
    # interpreted: to compile the changed kernels would take longer than these few steps
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "NUMBA_DISABLE_JIT": "1"}
    words = [sys.executable, "-m", "pytest", "-q", "-c", os.devnull, "-p", "no:cacheprovider", "test_magnet.py"]
    done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-3000:]
    assert f"{2 * len(BACKENDS)} passed" in done.stdout


def test_the_example_of_a_scene_loads_and_has_the_hash_that_the_page_says(tmp_path: Path) -> None:
    [block] = [block for block in MADE if block.language == "toml"]
    file = tmp_path / Path(block.path).name
    file.write_text(block.body, encoding="utf-8")
    scene = db.load_scene(file)
    assert scene.name == file.stem
    assert f'"{scene.content_hash}"' in _diff("tests/scene/file/test_shipped_scenes.py", "twelve").added()
    assert one_more_scene(SCENES) != SCENES


def test_the_example_of_a_fault_is_named_by_the_verdicts_that_the_page_says() -> None:
    from tests.faults import test_numerics
    from tests.helpers.fault_judging import BENCH
    from tests.helpers.fault_stand_in import runs_of

    planted, line = (_diff("tests/faults/test_numerics.py", text).added() for text in ("class StrongKick", "kicks too"))
    names = dict(vars(test_numerics))
    exec(planted, names)
    [fault] = eval(f"{{{line}}}", names).values()
    BENCH.check_fault(runs_of(fault.plant), fault)


def _diff(path: str, text: str = "") -> Block:
    [matching] = [block for block in DIFFS if block.path.endswith(path) and text in block.added()]
    return matching


# what is forgotten is noticed


def test_every_backend_is_in_the_catalogue() -> None:
    modules = {
        ".".join(file.relative_to(ROOT).with_suffix("").parts)
        for file, tree in _sources("dem_bridge/backends")
        for node in tree.body
        if isinstance(node, ast.ClassDef)
        if any(isinstance(part, ast.Assign) and ast.unparse(part.targets[0]) == "supports" for part in node.body)
    }
    assert len(modules) > 5
    assert modules <= {entry.module for entry in BACKENDS.values()}


def _evaluations(run: db.Trajectory) -> int:
    return round(run.cost.force_evaluations / run.cost.steps)


@pytest.mark.parametrize(
    "name", [name for name in BACKENDS if backend(name).order is not None and name not in catalogue.ENGINE_BACKENDS]
)
def test_the_planner_knows_what_a_step_of_every_backend_costs(name: str, solved: Solve) -> None:
    scene = Scene(name="pair", duration=1e-5, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=5)
    run = solved(scene, name, dt=1e-7, uncertainty=False)
    assert evaluations_of(name) == _evaluations(run)


def test_the_paper_is_run_through_every_backend() -> None:
    powers = [db.load_scene(name) for name in ("decelerating-40", "decelerating-40-soft-exponent")]
    judged = {case.backend for scene in powers for case in plan_scene(scene, 1e-4).cases}
    beside = pytest.importorskip("dem_bridge.studies.paper.runs").BESIDE
    assert judged | set(beside) == set(BACKENDS)


def test_every_backend_has_tests_of_its_own() -> None:
    texts = {file.name: file.read_text(encoding="utf-8") for file, _ in _sources("tests/backends", "test_*.py")}
    del texts["test_contract.py"]
    for name in BACKENDS:
        assert any(f'"{name}"' in text for text in texts.values()), f"no test in tests/backends names {name}"


def test_every_observable_is_tested() -> None:
    tests = "\n".join(file.read_text(encoding="utf-8") for file, _ in _sources("tests/observables"))
    public = [
        node.name
        for _, tree in _sources("dem_bridge/observables")
        for node in tree.body
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_")
    ]
    assert len(public) > 20
    assert [name for name in public if not re.search(rf"\b{name}\b", tests)] == []


def test_every_scene_has_baselines_or_none_on_purpose() -> None:
    having = {file.name.split(".")[0] for file in (ROOT / "reports/baselines").glob("*.json")}
    assert having | WITHOUT_BASELINE == set(db.shipped_scenes()), "regress NAME --update, or WITHOUT_BASELINE"
    assert not having & WITHOUT_BASELINE


def test_the_page_of_scenes_counts_the_shipped_scenes() -> None:
    assert re.findall(r"^(\d+) scenes are shipped", SCENES, re.MULTILINE) == [str(len(db.shipped_scenes()))]


def test_the_committed_report_has_every_shipped_scene() -> None:
    scenes = {verdict["scene"] for verdict in VERDICTS["verdicts"]}
    assert scenes == set(db.shipped_scenes()), "dem-bridge verify paper --no-cache -o reports/paper"


def test_the_page_of_the_paper_counts_the_claims_of_the_committed_report() -> None:
    outcomes = [claim["outcome"] for claim in VERDICTS["claims"]]
    counts = re.search(
        r"reads (\d+) statements .*?\s(\d+) statements hold: .*?\s(\d+) cannot be decided: ", PAPER, re.DOTALL
    )
    assert counts is not None
    assert [*map(int, counts.groups())] == [len(outcomes), outcomes.count("PASS"), outcomes.count("UNDECIDED")]


def _names(tree: ast.AST) -> set[str]:
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}


def test_every_table_of_faults_is_run() -> None:
    count = 0
    for file, tree in _sources("tests/faults", "test_*.py"):
        run = {
            name
            for node in ast.walk(tree)
            if isinstance(node, ast.FunctionDef)
            for decorator in node.decorator_list
            for name in _names(decorator)
        }
        for node in tree.body:
            if isinstance(node, ast.AnnAssign) and ast.unparse(node.annotation).startswith("dict["):
                assert ast.unparse(node.target) in run, f"{file.name}: no test runs {ast.unparse(node.target)}"
                count += 1
    assert count >= 8


def test_every_fault_is_planted() -> None:
    for file, tree in _sources("tests/faults", "test_*.py"):
        classes = {node.name for node in tree.body if isinstance(node, ast.ClassDef)}
        assert classes <= _names(tree), f"{file.name}: {min(classes - _names(tree))} is planted nowhere"


def test_every_study_is_in_the_catalogue() -> None:
    entries = {
        (".".join(file.relative_to(ROOT).with_suffix("").parts), node.name)
        for file, tree in _sources("dem_bridge/studies")
        for node in tree.body
        if isinstance(node, ast.FunctionDef) and re.match("study_(?!of$)", node.name)
        if node.returns is not None and ast.unparse(node.returns) == "Study"
    }
    assert entries == {(entry.module, entry.function) for entry in STUDIES.values()}


def test_every_study_is_tested() -> None:
    # the catalogue's own test names every study
    files = [file for file, _ in _sources("tests/studies", "test_*.py") if file.name != "test_catalogue.py"]
    tests = "\n".join(file.read_text(encoding="utf-8") for file in files)
    for name, (module, *_) in STUDIES.items():
        package = module.removesuffix(".study")
        assert package in tests or f'"{name}"' in tests, f"no test of {name} in tests/studies"


def test_a_made_up_recipe_that_does_not_fit_is_refused() -> None:
    block = Block("diff", "docs/commands.md\n-no such line\n+another\n")
    with pytest.raises(AssertionError, match=r"0 times in docs/commands\.md"):
        block.patched(COMMANDS)
