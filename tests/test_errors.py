"""The tree of exceptions: exit codes, one line each, and what a SceneError says."""

from __future__ import annotations

import pytest

from dem_bridge import errors
from dem_bridge.errors import (
    BackendUnavailable,
    DemBridgeError,
    NotAsymptotic,
    RunBroken,
    SceneError,
    UnsupportedScene,
    UsageError,
)


@pytest.mark.parametrize(
    "kind", [UsageError, SceneError, UnsupportedScene, BackendUnavailable, NotAsymptotic, RunBroken]
)
def test_every_error_can_be_caught_as_a_dem_bridge_error(kind: type[Exception]) -> None:
    assert issubclass(kind, DemBridgeError)


def test_the_tree_in_the_docstring_names_every_error() -> None:
    assert errors.__doc__ is not None
    public = [
        name for name, thing in vars(errors).items() if isinstance(thing, type) and thing.__module__ == errors.__name__
    ]
    assert [name for name in public if name not in errors.__doc__] == []


def test_wrong_use_exits_with_2_and_a_broken_run_with_3() -> None:
    assert UsageError("x").exit_code == SceneError("x", allowed="y").exit_code == 2
    assert RunBroken("x").exit_code == 3


def test_wrong_use_is_also_a_value_error() -> None:
    assert issubclass(UsageError, ValueError)
    assert issubclass(SceneError, ValueError)
    assert issubclass(NotAsymptotic, ValueError)


def test_a_scene_error_says_where_what_and_what_is_allowed() -> None:
    error = SceneError("chain.mass[7]", value=-0.01, allowed="a number > 0 (kg)", where="taper.toml", advice="mend it")
    assert str(error) == "taper.toml: chain.mass[7] = -0.01; allowed: a number > 0 (kg); mend it"


def test_a_scene_error_with_a_problem_says_it_instead_of_the_value() -> None:
    error = SceneError("chain.mass", problem="has 2 entries", allowed="3, one per body", where="f.toml")
    assert str(error) == "f.toml: chain.mass has 2 entries; allowed: 3, one per body"


def test_a_scene_error_without_a_key_is_about_the_whole_file() -> None:
    assert str(SceneError("", problem="no such scene", allowed="a, b", where="c")) == "c: no such scene; allowed: a, b"


def test_a_scene_error_seen_from_a_file_keeps_all_but_its_place() -> None:
    error = SceneError("mass[0]", value=0.0, allowed="a number > 0 (kg)", advice="mend it")
    moved = error.at("f.toml", "chain.mass[0]")
    assert str(moved) == "f.toml: chain.mass[0] = 0.0; allowed: a number > 0 (kg); mend it"
    assert (moved.key, moved.where, moved.value) == ("chain.mass[0]", "f.toml", 0.0)


def test_a_broken_run_keeps_the_engines_last_words() -> None:
    assert RunBroken("LAMMPS: ERROR", log="last words").log == "last words"
    assert RunBroken("LAMMPS: ERROR").log == ""


def test_a_message_is_one_printable_line_of_500_characters_at_most() -> None:
    for kind in (UsageError, UnsupportedScene, BackendUnavailable, NotAsymptotic, RunBroken):
        message = str(kind("file\x1b[2J\r\nname \udc80" + "long " * 1000 + "end"))
        assert message.isprintable()
        assert len(message) == 500
        assert message.startswith("file\\x1b[2J name \\udc80")
        assert message.endswith("end")
    assert "too long to be shown" in str(SceneError("samples", value=10**5000, allowed="less"))
