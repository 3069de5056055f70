"""Reading of files of bounded size, and atomic writing: either all files appear completely, or none."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import BinaryIO

from dem_bridge.errors import UsageError
from dem_bridge.foundation.arguments import is_path
from dem_bridge.foundation.leftovers import owned, sweep

#: largest size of a text that describes a scene (a scene file, a table of bodies, a deck, a baseline), bytes
MOST_TEXT = 2**26
#: largest size of a file of samples and of the arrays in it, bytes
MOST_BYTES = 2**29
#: name of the page of a report, and what is near the beginning of each; the second is of pages that lack the first
PAGE, GENERATORS = "index.html", (b'<meta name="generator" content="dem_bridge">', b"--ink: #1b1f24; --paper: #ffffff;")
#: variable with the folder below which the files must be that scenes and decks name
FILES_BELOW = "DEM_BRIDGE_FILES_BELOW"


def checked_file(path: str | Path, most: int = MOST_TEXT) -> Path:
    """Return a path; raise OSError, with the reason as ``strerror``, unless it is a regular file of at most ``most``.

    Devices and pipes, whose content may never end, are never opened.
    """
    try:
        path = Path(path)
        if path.exists() and not path.is_file():
            code, kind = (errno.EISDIR, "a directory") if path.is_dir() else (errno.EINVAL, "a device or a pipe")
            raise OSError(code, f"Is {kind}")
        if path.stat().st_size > most:
            raise OSError(errno.EFBIG, f"it has more than {most >> 20} MiB")
    except (ValueError, RuntimeError):  # a NUL in the name, or a circle of symbolic links
        raise OSError(errno.EINVAL, "it is no valid name of a file") from None
    return path


@contextmanager
def opened(path: str | Path, most: int = MOST_TEXT) -> Iterator[BinaryIO]:
    """Open a file of :func:`checked_file` for reading; a file of the kernel that would wait for events is empty."""
    with open(os.open(checked_file(path, most), os.O_RDONLY | os.O_NONBLOCK), "rb") as file:
        yield file


def bytes_of_file(path: str | Path, most: int = MOST_TEXT) -> bytes:
    """Return the content of a file; raise OSError with the reason as ``strerror`` if it cannot be read."""
    with opened(path, most) as file:
        content = file.read(most + 1) or b""
    if len(content) > most:  # a file of the kernel has no size
        raise OSError(errno.EFBIG, f"it has more than {most >> 20} MiB")
    return content


def text_of_file(path: str | Path, most: int = MOST_TEXT) -> str:
    """Return the text of a file in UTF-8; raise OSError with the reason as ``strerror`` if it cannot be read."""
    content = bytes_of_file(path, most)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise OSError(errno.EILSEQ, "it is not a text file in UTF-8")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def named_file(folder: Path, name: str, below: str | Path | None = None) -> Path:
    """Return the path of a file that the content of another file names, relative to the ``folder`` of the latter.

    Parameters
    ----------
    folder : Path
        Folder of the file that names the other one.
    name : str
        The name, as it is written.
    below : str or Path, optional
        Folder below which the file must be. None: ``$DEM_BRIDGE_FILES_BELOW``, or else ``folder``.

    Raises
    ------
    OSError
        If the file is not below that folder; ``strerror`` has the reason.
    """
    try:
        allowed = Path(below or os.environ.get(FILES_BELOW) or folder).resolve()
        inside = (folder / name).resolve().is_relative_to(allowed)
    except (ValueError, RuntimeError):
        raise OSError(errno.EINVAL, "it is no valid name of a file") from None
    if not inside:
        raise OSError(errno.EACCES, f"it is not below the folder {allowed}; name another folder by --files-below")
    return folder / name


def check_file(path: Path) -> None:
    """Raise UsageError unless a file can be written at ``path``; devices and folders are never replaced."""
    if not is_path(path):
        raise UsageError(f"{path}: no file can have this name; allowed: at most 255 bytes, without NUL")
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


def check_report_folder(folder: Path) -> None:
    """Check a folder by :func:`check_folder`; raise UsageError if its ``index.html`` is not a page of dem_bridge."""
    check_folder(folder)
    page = folder / PAGE
    if page.exists():
        with opened(page, MOST_BYTES) as file:
            head = file.read(4096)
            if not any(generator in head for generator in GENERATORS):
                allowed = f"a folder without {PAGE}, or with an earlier report"
                raise UsageError(f"{page}: the page is not from dem_bridge and would be lost; allowed: {allowed}")


def check_future_report_folder(folder: Path) -> None:
    """Check as :func:`check_report_folder` a folder that is written later; a missing one stays missing until then."""
    missing = [parent for parent in (folder, *folder.parents) if not parent.exists()]
    check_report_folder(folder)
    for made in missing:
        made.rmdir()


def write_whole(folder: Path, texts: Mapping[str, str | bytes], *, replace: bool = True) -> None:
    """Write all ``texts`` into ``folder``, or none of them.

    Parameters
    ----------
    folder : Path
        Folder, which is created if it is missing.
    texts : mapping
        Name to content: text, or bytes for a picture. A name may contain folders, such as "figures/main.csv", which are
        created.
    replace : bool
        True: files that exist are replaced. False: they are an error.

    Raises
    ------
    UsageError
        If a file cannot be written.
    """
    if not replace and (existing := [name for name in texts if (folder / name).exists()]):
        raise UsageError(f"{folder / existing[0]}: the file exists; allowed: new files, or --force to replace them")
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
        raise UsageError(
            f"{folder}: cannot be written ({error.strerror}); choose another folder, or make room"
        ) from error
