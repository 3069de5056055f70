"""Check the site while it is built: it has every public name, and a page loads nothing from the network."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.errors import ExtensionError
from sphinx.util import logging

#: elements and style rules that load a file from another host; links that a reader follows are allowed
_LOADED = re.compile(
    r"""<(?!a\b)\w+\b[^>]*\b(?:src|href|srcset|data)\s*=\s*["'](?:https?:)?//|(?:url\(|@import)\s*["']?(?:https?:)?//"""
)


def _check_names(app: Sphinx, env: BuildEnvironment) -> None:
    """Warn of every public name that the API reference does not have; ``-W`` makes it an error."""
    package = app.config.public_package
    documented = {name for name, *_ in env.domains["py"].get_objects()}
    for name in importlib.import_module(package).__all__:
        if f"{package}.{name}" not in documented:
            logging.getLogger(__name__).warning("the API reference has no entry for %s.%s", package, name)


def _check_network(app: Sphinx, exception: Exception | None) -> None:
    """Raise an error if a page or a style sheet loads a file from the network."""
    if exception is not None or app.builder.name != "html":
        return
    folder = Path(app.outdir)
    for file in sorted(path for path in folder.rglob("*") if path.suffix in (".html", ".css")):
        if loaded := _LOADED.search(file.read_text(encoding="utf-8")):
            raise ExtensionError(f"{file.relative_to(folder)} loads a file from the network: {loaded[0]}")


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect the checks; the setting ``public_package`` is the package whose ``__all__`` must be documented."""
    app.add_config_value("public_package", "", "env", str)
    app.connect("env-check-consistency", _check_names)
    app.connect("build-finished", _check_network)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
