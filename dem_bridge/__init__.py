"""Verification of one-dimensional granular-chain simulations against LAMMPS.

>>> import dem_bridge as db
>>> scene = db.load_scene("decelerating-40")
>>> scene.n_body, scene.n_contact
(41, 40)
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from dem_bridge.version import __version__ as __version__

#: public names by module; modules are imported on first use, so that ``import dem_bridge`` is fast
_NAMES = {
    "accuracy": "observed_order",
    "api.regress": "regress",
    "api.runs": "available plan solve write_deck",
    "api.scenes": "scene_from_csv scene_from_deck",
    "api.studies": "minimal study",
    "api.tables": "export table_of",
    "api.trajectories": "compare read_trajectory write_trajectory",
    "api.verification": "verify",
    "backends.base": "Resolution Sampling",
    "drive": "Drive",
    "exports.angles": "angles_for",
    "geometry": "Body Geometry Material",
    "lmp.engine": "Engine",
    "physics.law": "ContactLaw law_of",
    "planning.answer": "Plan",
    "scene": "Damping Scene Wall",
    "scene_file": "load_scene shipped_scenes",
    "scene_file.bodies": "chain",
    "studies.study": "Study",
    "studies.verification": "Verification",
    "trajectory": "Trajectory load_trajectory",
}
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}
#: public modules, also imported on first use
_MODULES = ("errors", "features", "plot", "testing")

if TYPE_CHECKING:  # `a as a` exports a name to type checkers
    # isort: off
    from dem_bridge import errors as errors, features as features, plot as plot, testing as testing
    from dem_bridge.accuracy import observed_order as observed_order
    from dem_bridge.api.regress import regress as regress
    from dem_bridge.api.runs import available as available, plan as plan, solve as solve, write_deck as write_deck
    from dem_bridge.api.scenes import scene_from_csv as scene_from_csv, scene_from_deck as scene_from_deck
    from dem_bridge.api.studies import minimal as minimal, study as study
    from dem_bridge.api.tables import export as export, table_of as table_of
    from dem_bridge.api.trajectories import (
        compare as compare,
        read_trajectory as read_trajectory,
        write_trajectory as write_trajectory,
    )
    from dem_bridge.api.verification import verify as verify
    from dem_bridge.backends.base import Resolution as Resolution, Sampling as Sampling
    from dem_bridge.drive import Drive as Drive
    from dem_bridge.exports.angles import angles_for as angles_for
    from dem_bridge.geometry import Body as Body, Geometry as Geometry, Material as Material
    from dem_bridge.lmp.engine import Engine as Engine
    from dem_bridge.physics.law import ContactLaw as ContactLaw, law_of as law_of
    from dem_bridge.planning.answer import Plan as Plan
    from dem_bridge.scene import Damping as Damping, Scene as Scene, Wall as Wall
    from dem_bridge.scene_file import load_scene as load_scene, shipped_scenes as shipped_scenes
    from dem_bridge.scene_file.bodies import chain as chain
    from dem_bridge.studies.study import Study as Study
    from dem_bridge.studies.verification import Verification as Verification
    from dem_bridge.trajectory import Trajectory as Trajectory, load_trajectory as load_trajectory
    # isort: on
else:
    __all__ = sorted([*_HOME, *_MODULES, "__version__"])


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
    if name in _MODULES:
        return importlib.import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOME, *_MODULES])
