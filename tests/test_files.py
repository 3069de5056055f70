"""Files appear whole or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from dem_bridge.errors import UsageError
from dem_bridge.files import write_whole


def _all(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def test_a_name_may_have_folders_in_it(tmp_path: Path) -> None:
    write_whole(tmp_path / "new", {"a.txt": "one", "b/c/d.bin": b"two", "b/e.txt": "three"})
    assert _all(tmp_path / "new") == ["a.txt", "b", "b/c", "b/c/d.bin", "b/e.txt"]
    assert (tmp_path / "new/b/c/d.bin").read_bytes() == b"two"


@pytest.mark.parametrize(
    ("last", "reason"),
    [
        ("taken/g.txt", "the folder .*taken is missing or not writable"),
        ("full", "full: is not a regular file"),
        ("empty", "is not a regular"),
    ],
)
def test_what_cannot_be_written_leaves_nothing_of_the_rest(tmp_path: Path, last: str, reason: str) -> None:
    (tmp_path / "taken").write_text("a file where a folder is asked")
    (tmp_path / "empty").mkdir()
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "inside.txt").write_text("kept")
    (tmp_path / "a.txt").write_text("before")
    before = _all(tmp_path)
    with pytest.raises(UsageError, match=reason):
        write_whole(tmp_path, {"a.txt": "after", "b/c/d.txt": "new", last: ""})
    assert _all(tmp_path) == before
    assert (tmp_path / "a.txt").read_text() == "before"
