"""The first call says that kernels are compiled, and no later one does."""

from __future__ import annotations

from pathlib import Path

import pytest

from dem_bridge.cli.compiling import announce_compiling
from dem_bridge.foundation import kernel_folders


def test_compiling_is_announced_until_a_kernel_is_on_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(kernel_folders, "folders_to_read", lambda: (tmp_path,))
    words = "dem-bridge: kernels are compiled first, once on this machine: up to a minute\n"
    announce_compiling()
    assert capsys.readouterr().err == words
    (tmp_path / "dem_bridge.backends.verlet.advance-0.kernel").touch()
    announce_compiling()
    assert capsys.readouterr().err == ""
    # those of the reference are others
    announce_compiling("taylor", silent=True)
    assert capsys.readouterr().err == ""
    announce_compiling("taylor")
    assert capsys.readouterr().err == words
