"""Write figures (matplotlib), HTML pages (jinja2), JUnit XML and bundles. This package computes no results."""
