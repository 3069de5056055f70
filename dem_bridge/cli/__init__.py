"""The command line ``dem-bridge``."""

from dem_bridge.cli.group import command, main

__all__ = ["command", "main"]
