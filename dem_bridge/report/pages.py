"""Fill the templates of pages, of texts for pull requests, and of files for continuous integration."""

from __future__ import annotations

from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from dem_bridge.report import cells
from dem_bridge.report.images import alternative_text, inline


@cache
def _environment() -> Environment:
    """Return the environment of all templates; those of HTML and XML escape their values."""
    environment = Environment(
        loader=PackageLoader("dem_bridge.report", "templates"),
        undefined=StrictUndefined,
        autoescape=lambda name: name is not None and name.endswith((".html.j2", ".xml.j2")),
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {
        "by_backend": cells.by_backend,
        "alternative_text": alternative_text,
        "digits": lambda value: cells.digits_of(value.value, value.uncertainty),
        "inline": lambda svg, name, alt: Markup(inline(svg, name, alt)),
        "number": cells.number,
        "numeric": cells.numeric,
        "sortable": cells.sortable,
        "typeset": cells.typeset,
    }
    return environment


def fill(template: str, **values: Any) -> str:
    """Return a template filled with values."""
    return _environment().get_template(template).render(values)
