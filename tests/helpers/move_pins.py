"""Load the program ``.ci/move_pins.py`` as a module, for the folder of CI is no package."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent.parent / ".ci"))

import move_pins as move_pins
import parts as parts
