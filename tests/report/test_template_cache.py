"""Compiled templates on disk: loaded where they are whole, compiled anew where they are not."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from jinja2 import DictLoader, Environment

from dem_bridge.foundation import kernel_folders
from dem_bridge.report import template_cache
from dem_bridge.report.template_cache import TemplateCache


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Keep code below a folder of this test."""
    monkeypatch.setenv(kernel_folders.VARIABLE, str(tmp_path))
    _forget_folders()
    yield kernel_folders.folder_in(tmp_path)
    _forget_folders()


def _forget_folders() -> None:
    for function in (kernel_folders.folder_to_write, kernel_folders.folders_to_read):
        function.cache_clear()


def _filled(text: str = "{{ 1 + 1 }} {{ name }}") -> str:
    environment = Environment(loader=DictLoader({"page": text}), bytecode_cache=TemplateCache(), autoescape=True)
    return environment.get_template("page").render(name="of two")


def test_a_template_is_kept_once_for_each_text(folder: Path) -> None:
    first, again = _filled(), _filled()
    assert (first, again) == ("2 of two", "2 of two")
    [file] = folder.iterdir()
    assert _filled("{{ name }}") == "of two"
    assert len(list(folder.iterdir())) == 2
    assert file in folder.iterdir()


def test_what_is_kept_is_loaded(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _filled()

    def compiled(*_: object) -> None:
        raise AssertionError("the template was compiled again")

    monkeypatch.setattr(Environment, "compile", compiled)
    assert _filled() == "2 of two"
    with pytest.raises(AssertionError, match="compiled again"):
        _filled("{{ name }}")


@pytest.mark.parametrize("planted", ["damaged", "other user", "other name"])
def test_what_is_not_as_it_was_written_is_compiled_anew(planted: str, folder: Path) -> None:
    _filled()
    [file] = folder.iterdir()
    whole = file.read_bytes()
    if planted == "damaged":
        file.write_bytes(whole[:-1] + b"x")
    elif planted == "other user":
        file.chmod(0o666)
    else:
        _filled("{{ name }}")
        [other] = set(folder.iterdir()) - {file}
        file.write_bytes(other.read_bytes())
    assert _filled() == "2 of two"
    assert file.read_bytes() == whole


def test_other_code_has_another_file_and_changed_code_none(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _filled()
    monkeypatch.setattr(template_cache, "code_of_all", lambda: {"report/page.py": "0123456789ab"})
    _filled()
    assert len(list(folder.iterdir())) == 2
    monkeypatch.setattr(template_cache, "changed_since_start", lambda: True)
    assert _filled("{{ name }}") == "of two"
    assert len(list(folder.iterdir())) == 2
