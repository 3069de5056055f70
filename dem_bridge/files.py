"""Writing files so that they appear whole or not at all, and saying in one line where that cannot be."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from dem_bridge.errors import UsageError


def check_file(path: Path) -> None:
    """Whether a file can be written at ``path``; UsageError if not. A device or a folder is not replaced."""
    if path.exists() and not path.is_file():
        raise UsageError(f"{path}: is no regular file; allowed: a new file or one to replace")
    if not (path.parent.is_dir() and os.access(path.parent, os.W_OK)):
        raise UsageError(f"{path}: there is no folder {path.parent} that can be written to; make it or name another")


def check_folder(folder: Path) -> None:
    """Whether files can be written into ``folder``, which is made if need be; UsageError if not."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{folder}: the folder cannot be written ({error.strerror}); name another") from error
    if not os.access(folder, os.W_OK):
        raise UsageError(f"{folder}: the folder cannot be written (no permission); name another")


def write_whole(folder: Path, texts: Mapping[str, str | bytes]) -> None:
    """Write all ``texts`` (name -> content, bytes for a picture) into ``folder``, or none; UsageError if that fails.

    A name may have folders in it, "figures/one.csv": they are made, and go again with what could not be written.
    """
    check_folder(folder)
    parts = {name: folder / f"{name}.{os.getpid()}.part" for name in texts}
    made: list[Path] = []
    try:
        for name, text in texts.items():
            for missing in _missing(folder, (folder / name).parent):
                missing.mkdir()
                made.append(missing)
            check_file(folder / name)
            if isinstance(text, bytes):
                parts[name].write_bytes(text)
            else:
                parts[name].write_text(text, encoding="utf-8")
        for name, part in parts.items():
            part.replace(folder / name)
    except OSError as error:
        raise UsageError(f"{folder}: cannot be written ({error.strerror}); name another folder") from error
    finally:
        for part in parts.values():
            if part.parent.is_dir():
                part.unlink(missing_ok=True)
        for one in reversed(made):
            if not any(one.iterdir()):
                one.rmdir()


def _missing(folder: Path, inner: Path) -> list[Path]:
    """Folders on the way from ``folder`` to ``inner`` that are not there, outermost first."""
    return [one for one in (*reversed(inner.parents), inner) if folder in one.parents and not one.exists()]
