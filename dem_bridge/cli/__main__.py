"""``python -m dem_bridge.cli``: the command line where no script is installed."""

from dem_bridge.cli.group import command

command()
