"""Files appear whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from dem_bridge.errors import UsageError
from dem_bridge.foundation.files import check_file, check_future_report_folder, named_file, text_of_file, write_whole


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


def test_only_regular_files_of_bounded_size_are_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "large").write_bytes(b"12345")
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00")
    for path, reason in {
        tmp_path / "pipe": "Is a device or a pipe",
        Path("/dev/zero"): "Is a device or a pipe",
        tmp_path: "Is a directory",
        Path("a\0b"): "no valid name",
        tmp_path / "gone": "No such file",
    }.items():
        with pytest.raises(OSError, match=reason):
            text_of_file(path)
    with pytest.raises(OSError, match="more than 0 MiB"):
        text_of_file(tmp_path / "large", 4)
    with pytest.raises(OSError, match="not a text file"):
        text_of_file(tmp_path / "binary")


def test_a_file_of_the_kernel_that_has_no_size_or_no_end_is_refused() -> None:
    assert Path("/proc/self/pagemap").stat().st_size == 0
    with pytest.raises(OSError, match="more than 0 MiB"):
        text_of_file("/proc/self/pagemap", 2**16)


def test_a_named_file_is_below_the_folder_unless_the_user_says_otherwise(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    inner = tmp_path / "inner"
    inner.mkdir()
    (inner / "link").symlink_to("/etc/passwd")
    assert named_file(inner, "sub/../force.csv") == inner / "sub/../force.csv"
    for name in ("../up.csv", "/etc/passwd", "link", str(tmp_path / "up.csv"), "a\0"):
        with pytest.raises(OSError, match=r"not below the folder|no valid name"):
            named_file(inner, name)
    assert named_file(inner, "../up.csv", tmp_path) == inner / "../up.csv"
    monkeypatch.setenv("DEM_BRIDGE_FILES_BELOW", str(tmp_path))
    assert named_file(inner, "../up.csv") == inner / "../up.csv"
    with pytest.raises(OSError, match="not below"):
        named_file(inner, "/etc/passwd")


def test_a_name_that_no_file_can_have_is_no_output(tmp_path: Path) -> None:
    for name in (300 * "a", "a\0b"):
        with pytest.raises(UsageError, match="no file can have this name; allowed: at most 255 bytes, without NUL"):
            check_file(tmp_path / name)


def test_a_folder_that_is_written_later_is_checked_and_not_left_behind(tmp_path: Path) -> None:
    check_future_report_folder(tmp_path / "new" / "page")
    assert not list(tmp_path.iterdir())
    (tmp_path / "there").mkdir()
    check_future_report_folder(tmp_path / "there")
    assert (tmp_path / "there").is_dir()
    (tmp_path / "there" / "index.html").write_text("mine")
    with pytest.raises(UsageError, match="is not from dem_bridge"):
        check_future_report_folder(tmp_path / "there")
