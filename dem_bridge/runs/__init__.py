"""Runs as values: what is to be solved (``case``), and results kept on disk under a key of all that decides them."""
