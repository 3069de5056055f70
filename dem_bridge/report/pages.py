"""Fill the templates of pages, of texts for pull requests, and of files for continuous integration."""

from __future__ import annotations

from functools import cache
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from dem_bridge.report import cells
from dem_bridge.report.images import alternative_text, inline

_HERE = "dem_bridge.report"


@cache
def _environment(package: str) -> Environment:
    """Return the environment of the templates of a package and of this one; HTML and XML escape their values."""
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(name, "templates") for name in dict.fromkeys((package, _HERE))]),
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


def fill(template: str, package: str = _HERE, **values: Any) -> str:
    """Return a template of a package, or of this one, filled with values."""
    return _environment(package).get_template(template).render(values)
