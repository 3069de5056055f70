"""The scripts that count how the package is built, on a tiny package with planted faults."""

from __future__ import annotations

import doctest
import sys
from pathlib import Path

import numpy as np
import pytest

import dem_bridge
from tests.helpers.house import house, house_graph, house_runs, house_source, same_bytes, same_within
from tests.test_architecture import BY_TEXT

#: a module, and what it holds
TINY = {
    "__init__.py": "",
    "__init__.pyi": "from dem_bridge.high.show import show as show\n",
    "errors.py": '"""Errors."""\n\n# a comment\nclass Wrong(Exception):\n    """Two\n    lines."""\n',
    "low/__init__.py": "",
    "low/base.py": "from dem_bridge.errors import Wrong\n",
    "low/climb.py": "import importlib\n\ndef up():\n    return importlib.import_module('dem_bridge.high.show').show\n",
    "high/__init__.py": "",
    "high/show.py": "from dem_bridge.low import base\n\ndef show():\n    return base\n",
    "high/_run.py": "START = ['python', '-m', 'dem_bridge.top']\n",
    "top.py": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from .high.show import show\n",
}


def tiny(root: Path, **more: str) -> Path:
    files = {f"dem_bridge/{name}": text for name, text in TINY.items()} | {"tests/__init__.py": ""} | more
    for name, text in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text, encoding="utf-8")
    return root


def test_a_circle_in_a_string_is_a_circle_and_by_statements_there_is_none(tmp_path: Path) -> None:
    counts = house.count(tiny(tmp_path))
    assert counts["rooms"].members == ["errors", "high", "low", "top"]
    assert counts["loose modules"].members == ["errors", "top"]
    assert counts["arrows between rooms"].members == ["high -> low", "low -> errors", "low -> high", "top -> high"]
    assert counts["arrows in strings and data alone"].members == ["low -> high"]
    assert counts["circles of rooms"].members == ["high low"]
    assert counts["circles of rooms by statements alone"].number == 0
    # errors, the circle, top; without the string low and high are two floors
    assert (counts["floors"].number, counts["floors by statements alone"].number) == (3, 4)
    assert counts["programs that are started"].members == ["dem_bridge.high._run: dem_bridge.top"]


@pytest.mark.parametrize(
    "text",
    [
        "import dem_bridge.top\n",
        "import dem_bridge.top as t\n",
        "from dem_bridge import top\n",
        "def late():\n    from dem_bridge.top import x\n",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from dem_bridge.top import x\n",
        "from .. import top\n",
        "from ..top import x\n",
        "__import__('dem_bridge.top')\n",
        "ENTRY = 'dem_bridge.top:function'\n",
        "ENTRY = 'dem_bridge.top.function'\n",
        "def find(name):\n    return f'dem_bridge.top.{name}'\n",
        "import dem_bridge as db\n\ndef public():\n    return db.public()\n",
    ],
)
def test_every_way_to_name_a_room_is_an_arrow(tmp_path: Path, text: str) -> None:
    stub = "from dem_bridge.top import public as public\n"
    more = {"dem_bridge/low/other.py": text, "dem_bridge/__init__.pyi": stub}
    assert "low -> top" in house.count(tiny(tmp_path, **more))["arrows between rooms"].members


@pytest.mark.parametrize(
    "text",
    [
        '"""Not dem_bridge.top."""\n',
        "'dem_bridge.top'\n",
        "# dem_bridge.top\n",
        "X = 'dem_bridge.tops'\n",
        "X = 'see dem_bridge.top'\n",
    ],
)
def test_what_only_speaks_of_a_room_is_no_arrow(tmp_path: Path, text: str) -> None:
    counts = house.count(tiny(tmp_path, **{"dem_bridge/low/other.py": text}))
    assert "low -> top" not in counts["arrows between rooms"].members


def test_names_in_data_files_count_for_their_room(tmp_path: Path) -> None:
    counts = house.count(tiny(tmp_path, **{"dem_bridge/errors2/names.json": '{"a": "dem_bridge.low.base:f"}'}))
    assert "errors2 -> low" in counts["arrows between rooms"].members


def test_the_rooms_of_the_package_name_each_other_in_one_direction() -> None:
    package = Path(dem_bridge.__file__).parent
    found = house_graph.namings(package, house_source.read_modules(package))
    found = {naming for naming in found if (naming.source, naming.target) not in BY_TEXT}
    assert house_graph.circles(house_graph.graph_of_rooms(house_graph.graph_of(found))) == []


def test_sizes_are_those_of_code_and_limits_are_exclusive(tmp_path: Path) -> None:
    body = "".join(f"    x = {number}  # why\n\n" for number in range(59))
    functions = (
        f"def fits():\n    '''Say.\n\n    More.'''\n{body}\n"
        f"def too_long():\n{body}    return x\n\n"
        f"@kernel()\ndef fast(a, b):  # type: ignore[no-untyped-def]\n{body}    return x\n\n"
        "@kernel(nogil=False)\ndef typed(a: int) -> int:\n    return a\n"
    )
    counts = house.count(tiny(tmp_path, **{"dem_bridge/low/other.py": functions}))
    assert counts["functions above 60 lines"].members == ["dem_bridge.low.other.too_long 61"]
    assert counts["kernels above 100 lines"].number == 0
    assert (counts["kernels"].number, counts["untyped kernels"].members) == (2, ["dem_bridge.low.other.fast"])
    assert counts["type: ignore"].number == 1
    # class Wrong alone, whose docstring is its body
    assert house_source.read_modules(tmp_path / "dem_bridge")["dem_bridge.errors"].code == {4}


def test_private_calls_and_patches_of_tests_are_counted_by_folder(tmp_path: Path) -> None:
    text = (
        "from dem_bridge.low.other import _hidden\nfrom tests.low.helpers import _shown\n\n_own = len\n"
        "def test_a(monkeypatch, thing):\n"
        "    _hidden()\n    thing._hidden()\n    thing._replace()\n    thing.__len__()\n"
        # a helper of other tests has the name of a private function, and a method of a protocol is not private
        "    _shown()\n    thing._repr_html_()\n    _own()\n"
        "    monkeypatch.setattr(thing, '_hidden', None)\n    monkeypatch.setenv('A', 'b')\n"
        "    setattr(thing, 'x', 1)\n"
    )
    functions = "\n".join(f"def {name}():\n    pass\n" for name in ("_hidden", "_shown", "_own", "_repr_html_"))
    more = {"dem_bridge/low/other.py": functions, "tests/low/test_a.py": text}
    counts = house.count(tiny(tmp_path, **more))
    found = [counts[name].number for name in counts if name.endswith("in tests")]
    assert found == [2, 1, 1]
    expected = {"calls of private functions in tests": 2, "monkeypatches in tests": 1}
    assert house.by_folder(counts) == {"low": expected}


def test_modules_with_one_importer(tmp_path: Path) -> None:
    assert house.count(tiny(tmp_path))["modules with one importer"].members == [
        "dem_bridge.errors",
        "dem_bridge.high.show",
        "dem_bridge.low.base",
    ]


def test_a_checkout_without_the_package_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="has no folder dem_bridge"):
        house.count(tmp_path)


@pytest.mark.parametrize("module", [house, house_graph, house_runs, same_bytes, same_within])
def test_examples(module: object) -> None:
    result = doctest.testmod(module)  # type: ignore[arg-type]
    assert result.attempted > 0 == result.failed


def test_a_changed_byte_a_new_file_and_a_lost_file_are_named(tmp_path: Path) -> None:
    sides = [tmp_path / "before", tmp_path / "after"]
    for side, digit in zip(sides, "12", strict=True):
        (side / "work").mkdir(parents=True)
        (side / "a.txt").write_text(f"first\nvelocity 0.{digit}\n", encoding="utf-8")
        (side / "b.json").write_text(f'{{"made": "2026-11-2{digit}", "cpu": {digit}.5, "n": 1}}', encoding="utf-8")
        (side / "work" / f"only{digit}").touch()
    found = same_bytes.compare(*sides)
    assert found["a.txt"].startswith("line 2: 'velocity 0.1' -> 'velocity 0.2'")
    assert found["b.json"] == ""
    assert (found["work/only1"], found["work/only2"]) == ("only before", "only after")


def test_runs_that_differ_by_more_than_both_uncertainties_are_named() -> None:
    [run] = same_within.answers(same_within.ROOT, 1, ["scipy"])
    assert {found.share for found in same_within.differences(run, run)} == {0.0}
    bar = float(run["velocity +-"])
    for planted, outside in ((1.5, False), (2.5, True)):
        moved = [[value + planted * bar for value in row] for row in run["velocity"]]
        [velocity, *others] = same_within.differences(run, {**run, "velocity": moved})
        assert velocity.quantity == "velocity"
        assert (velocity.share > 1.0) is outside
        assert {found.share for found in others} == {0.0}
    # a run in one checkout alone, and another scene
    failed = {key: run[key] for key in ("label", "scene")} | {"failure": "it stopped"}
    assert [found.share for found in same_within.differences(run, failed)] == [np.inf]
    assert [found.share for found in same_within.differences(failed, failed)] == [0.0]
    assert [found.quantity for found in same_within.differences(run, {**run, "scene": "0"})] == ["scene"]


PROBED = """\
class Scene:
    pass

def run_key(scene):
    return str(id(scene))

def command():
    from dem_bridge.other import take
    scenes = [Scene(), Scene()]
    for scene in [*scenes, scenes[0]]:
        run_key(scene)
        take(1, scene)
"""


def test_calls_that_carry_a_scene_and_change_the_module_are_counted(tmp_path: Path) -> None:
    files = {"__init__.py": "", "cli.py": PROBED, "other.py": "def take(number, scene):\n    return number\n"}
    for name, text in files.items():
        (tmp_path / "dem_bridge").mkdir(exist_ok=True)
        (tmp_path / "dem_bridge" / name).write_text(text, encoding="utf-8")
    found = house_runs.run(tmp_path, Path(sys.executable), ["verify"], counted=True)
    assert (found["run_key"], found["distinct"]) == (3, 2)
    assert (found["carried"], found["modules"], found["rooms"]) == (6, 3, 3)
    assert found["by_name"]["other:take"] == 3
