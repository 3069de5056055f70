"""Words in, words out, exit codes; no science."""

from dem_bridge.cli.group import command, main

__all__ = ["command", "main"]
