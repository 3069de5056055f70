"""Keep compiled templates on disk beside the compiled kernels: to compile them takes longer than to fill them.

A file is named after the template, its text, and all code of the package, because filters of constants are evaluated
when a template is compiled. What is loaded is code: the rules of :mod:`dem_bridge.foundation.kernel_folders` apply.
"""

from __future__ import annotations

import hashlib
from contextlib import suppress
from io import BytesIO

import jinja2
from jinja2 import BytecodeCache
from jinja2.bccache import Bucket

from dem_bridge.foundation.kernel_folders import SUFFIX, folders_to_read, kept_content, lasting_folder, write_kept
from dem_bridge.runs.code import changed_since_start, code_of_all, digest


class TemplateCache(BytecodeCache):
    """The compiled templates on disk, in the interface that jinja2 asks for."""

    def load_bytecode(self, bucket: Bucket) -> None:
        """Load the code of a template, if it is there and undamaged."""
        name = _name(bucket)
        for path in (folder / name for folder in folders_to_read()):
            with suppress(OSError, ValueError):  # it is not there, or damaged: the template is compiled
                bucket.load_bytecode(BytesIO(kept_content(path)))
                return

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Keep the code of a template, if there is a folder that lasts and the code that made it is that on disk."""
        folder, _ = lasting_folder()
        if folder is None or changed_since_start():
            return
        content = BytesIO()
        bucket.write_bytecode(content)
        with suppress(OSError):  # there is no room: the next process compiles it again
            write_kept(folder / _name(bucket), content.getvalue())


def _name(bucket: Bucket) -> str:
    """Return the name of the file of a template."""
    parts = (bucket.key, bucket.checksum, jinja2.__version__, digest(code_of_all()))
    return f"jinja-template-{hashlib.sha256(repr(parts).encode()).hexdigest()[:40]}{SUFFIX}"
