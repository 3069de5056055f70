"""Reading of files of any code: as a record of what they have, or as a complete trajectory."""

from dem_bridge.formats.readers.read import read_record
from dem_bridge.formats.readers.record import Record

__all__ = ["Record", "read_record"]
