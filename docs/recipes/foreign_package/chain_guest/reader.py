"""Files of numbers separated by bars: the time, then the velocity of each body, in SI units."""

from pathlib import Path

from dem_bridge.formats.readers.tables import Table, read_text


def read_gst(path: Path) -> Table:
    """Read a file; its first line has the headings."""
    return read_text(path.read_text(encoding="utf-8").replace("|", ","))
