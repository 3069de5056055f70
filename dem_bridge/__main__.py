"""Run the command line by ``python -m dem_bridge``."""

from dem_bridge.cli import command

if __name__ == "__main__":
    command()
