"""Settings of the documentation: ``make docs`` builds docs/_build/index.html."""

from __future__ import annotations

import sys
from importlib.resources import files
from pathlib import Path

import dem_bridge

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project = "dem_bridge"
author = "The dem_bridge developers"
copyright = author
version = release = dem_bridge.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "numpydoc",
    "sphinx_click",
    "accessible",
    "bench_history",
    "mathml",
    "notebooks",
    "site_checks",
]
exclude_patterns = ["_build"]
default_role = "code"

myst_enable_extensions = ["dollarmath", "amsmath", "deflist"]
myst_heading_anchors = 3
html_math_renderer = "mathml"

# types are in the section Parameters of a docstring
autodoc_typehints = "none"
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
public_package = "dem_bridge"

html_theme = "furo"
html_title = "dem_bridge"
# the font of the equations comes from the package ziamath, because many systems have no font with a table for MathML
html_static_path = ["_static", str(files("ziamath") / "fonts" / "STIXTwoMath-Regular.ttf")]
html_css_files = ["site.css"]
html_show_copyright = False
html_copy_source = False
pygments_style, pygments_dark_style = "a11y-high-contrast-light", "a11y-high-contrast-dark"
