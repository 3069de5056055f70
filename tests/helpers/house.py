"""Load the programs of ``.ci`` that count how the package is built or compare checkouts: that folder is no package."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent.parent / ".ci"))

import house as house
import house_graph as house_graph
import house_runs as house_runs
import house_source as house_source
import same_bytes as same_bytes
import same_within as same_within
