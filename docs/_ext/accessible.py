"""Add attributes that the theme leaves out, so that keyboards and screen readers reach every part of a page."""

from __future__ import annotations

from pathlib import Path

from sphinx.application import Sphinx

#: text in the pages of the theme -> text that the checks of axe-core accept
_REPLACED = {
    'role="heading"': 'role="heading" aria-level="2"',
    "<pre>": '<pre tabindex="0">',
    '<div class="table-wrapper': '<div tabindex="0" class="table-wrapper',
    '<aside class="sidebar-drawer">': '<aside class="sidebar-drawer" aria-label="Site">',
    '<aside class="toc-drawer': '<aside aria-label="Page" class="toc-drawer',
}


def _replace(app: Sphinx, exception: Exception | None) -> None:
    if exception is None and app.builder.name == "html":
        for page in Path(app.outdir).rglob("*.html"):
            text = page.read_text(encoding="utf-8")
            for old, new in _REPLACED.items():
                text = text.replace(old, new)
            page.write_text(text, encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect the replacement."""
    app.connect("build-finished", _replace)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
