"""Run the command line by ``python -m dem_bridge.cli``."""

from dem_bridge.cli import command

command()
