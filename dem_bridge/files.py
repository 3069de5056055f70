"""Atomic writing of files: either all of them appear completely, or none."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from dem_bridge.errors import UsageError


def check_file(path: Path) -> None:
    """Raise UsageError unless a file can be written at ``path``; devices and folders are never replaced."""
    if path.exists() and not path.is_file():
        raise UsageError(f"{path}: is not a regular file; allowed: a new file, or a file to replace")
    if not (path.parent.is_dir() and os.access(path.parent, os.W_OK)):
        raise UsageError(f"{path}: the folder {path.parent} is missing or not writable; create it or choose another")


def check_folder(folder: Path) -> None:
    """Create ``folder`` if it is missing, and raise UsageError unless files can be written into it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{folder}: the folder cannot be written ({error.strerror}); choose another") from error
    if not os.access(folder, os.W_OK):
        raise UsageError(f"{folder}: the folder cannot be written (no permission); choose another")


def write_whole(folder: Path, texts: Mapping[str, str | bytes]) -> None:
    """Write all ``texts`` into ``folder``, or none of them.

    Parameters
    ----------
    folder : Path
        Folder, which is created if it is missing.
    texts : mapping
        Name to content: text, or bytes for a picture. A name may contain folders, such as "figures/main.csv"; they are
        created, and removed again if the writing fails.

    Raises
    ------
    UsageError
        If a file cannot be written.
    """
    check_folder(folder)
    parts = {name: folder / f"{name}.{os.getpid()}.part" for name in texts}
    created: list[Path] = []
    try:
        for name, text in texts.items():
            for missing in _missing(folder, (folder / name).parent):
                missing.mkdir()
                created.append(missing)
            check_file(folder / name)
            if isinstance(text, bytes):
                parts[name].write_bytes(text)
            else:
                parts[name].write_text(text, encoding="utf-8")
        for name, part in parts.items():
            part.replace(folder / name)
    except OSError as error:
        raise UsageError(f"{folder}: cannot be written ({error.strerror}); choose another folder") from error
    finally:
        for part in parts.values():
            if part.parent.is_dir():
                part.unlink(missing_ok=True)
        for directory in reversed(created):
            if not any(directory.iterdir()):
                directory.rmdir()


def _missing(folder: Path, inner: Path) -> list[Path]:
    """Return the missing directories on the way from ``folder`` to ``inner``, outermost first."""
    return [
        directory
        for directory in (*reversed(inner.parents), inner)
        if folder in directory.parents and not directory.exists()
    ]
