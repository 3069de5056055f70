"""Verification of one-dimensional granular-chain simulations against LAMMPS.

>>> import dem_bridge as db
>>> scene = db.load_scene("decelerating-40")
>>> scene.n_body, scene.n_contact
(41, 40)
"""

from __future__ import annotations

import importlib
import re
from pathlib import Path
from typing import Any

from dem_bridge.foundation import presenters as _presenters

#: modules of the public names; they are imported on first use, so that ``import dem_bridge`` is fast
_STUB = Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")
_HOME = {name: module for module, name in re.findall(r"^from (\S+) import (\w+) as", _STUB, re.MULTILINE)}
#: public names that are modules
_MODULES = ("errors", "features", "plot", "testing")
__all__ = sorted(_HOME)
# run.plot() draws by a module that is built on runs; it is imported when the first figure is asked for
_presenters.declare_presenter(_presenters.FIGURES_OF_RUNS, lambda: importlib.import_module("dem_bridge.plot"))


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if name in _MODULES:
        return importlib.import_module(f"{_HOME[name]}.{name}")
    return getattr(importlib.import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted(_HOME)
