"""Atomic writing of files: either all of them appear completely, or none."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

from dem_bridge.errors import UsageError
from dem_bridge.leftovers import owned, sweep


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
        Name to content: text, or bytes for a picture. A name may contain folders, such as "figures/main.csv", which are
        created.

    Raises
    ------
    UsageError
        If a file cannot be written.
    """
    check_folder(folder)
    try:
        sweep(folder)
        with TemporaryDirectory(prefix=owned(".dem-bridge"), dir=folder) as temporary:
            for name, text in texts.items():
                part, target = Path(temporary, name), folder / name
                check_file(next(parent for parent in target.parents if parent.exists()) / target.name)
                part.parent.mkdir(parents=True, exist_ok=True)
                part.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8"))
            for name in texts:
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                Path(temporary, name).replace(folder / name)
    except OSError as error:
        raise UsageError(f"{folder}: cannot be written ({error.strerror}); choose another folder") from error
