"""Make the values of the frozen scenes of ``dem-bridge conform`` again: ``.venv/bin/python .ci/conformance_set.py``.

They are computed by the reference and written into the package. Set 1 never changes: the file that is written differs
from the committed one in last digits at most, and a test compares both within their uncertainties. Scenes that are
others get the set a new number.
"""

from __future__ import annotations

from pathlib import Path

from dem_bridge.judging.conformance import truth

if __name__ == "__main__":
    path = Path(truth.__file__).with_name(truth.FILE)
    path.write_text(truth.set_text(), encoding="utf-8")
    print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB")
