"""Load the programs of ``.ci`` as modules, because that folder is no package."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent.parent / ".ci"))

import coverage_table as coverage_table
import faults as faults
import machines as machines
import move_pins as move_pins
import mutate as mutate
import parts as parts
import quality as quality
import wheels as wheels
