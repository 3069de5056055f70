"""Verification of one-dimensional granular-chain simulations against LAMMPS.

>>> import dem_bridge as db
>>> scene = db.load_scene("decelerating-40")
>>> scene.n_body, scene.n_contact
(41, 40)
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from dem_bridge.version import __version__

#: module of each public name; modules are imported on first use, so that ``import dem_bridge`` is fast
_HOME = {
    "Body": "geometry",
    "ContactLaw": "physics.law",
    "Damping": "scene",
    "Drive": "drive",
    "Engine": "lmp.engine",
    "Geometry": "geometry",
    "Material": "geometry",
    "Plan": "planning.answer",
    "Resolution": "backends.base",
    "Sampling": "backends.base",
    "Scene": "scene",
    "Study": "studies.study",
    "Wall": "scene",
    "Trajectory": "trajectory",
    "Verification": "studies.verification",
    "angles_for": "exports.angles",
    "available": "api.runs",
    "chain": "scene_file.bodies",
    "compare": "api.trajectories",
    "export": "api.tables",
    "law_of": "physics.law",
    "load_scene": "scene_file",
    "load_trajectory": "trajectory",
    "minimal": "api.studies",
    "observed_order": "accuracy",
    "plan": "api.runs",
    "read_trajectory": "api.trajectories",
    "regress": "api.regress",
    "scene_from_csv": "api.scenes",
    "scene_from_deck": "api.scenes",
    "shipped_scenes": "scene_file",
    "solve": "api.runs",
    "study": "api.studies",
    "table_of": "api.tables",
    "verify": "api.verification",
    "write_deck": "api.runs",
    "write_trajectory": "api.trajectories",
}
#: public modules, also imported on first use
_MODULES = ("errors", "features", "plot", "testing")

if TYPE_CHECKING:
    from dem_bridge import errors, features, plot, testing
    from dem_bridge.accuracy import observed_order
    from dem_bridge.api.regress import regress
    from dem_bridge.api.runs import available, plan, solve, write_deck
    from dem_bridge.api.scenes import scene_from_csv, scene_from_deck
    from dem_bridge.api.studies import minimal, study
    from dem_bridge.api.tables import export, table_of
    from dem_bridge.api.trajectories import compare, read_trajectory, write_trajectory
    from dem_bridge.api.verification import verify
    from dem_bridge.backends.base import Resolution, Sampling
    from dem_bridge.drive import Drive
    from dem_bridge.exports.angles import angles_for
    from dem_bridge.geometry import Body, Geometry, Material
    from dem_bridge.lmp.engine import Engine
    from dem_bridge.physics.law import ContactLaw, law_of
    from dem_bridge.planning.answer import Plan
    from dem_bridge.scene import Damping, Scene, Wall
    from dem_bridge.scene_file import load_scene, shipped_scenes
    from dem_bridge.scene_file.bodies import chain
    from dem_bridge.studies.study import Study
    from dem_bridge.studies.verification import Verification
    from dem_bridge.trajectory import Trajectory, load_trajectory

__all__ = [
    "Body",
    "ContactLaw",
    "Damping",
    "Drive",
    "Engine",
    "Geometry",
    "Material",
    "Plan",
    "Resolution",
    "Sampling",
    "Scene",
    "Study",
    "Trajectory",
    "Verification",
    "Wall",
    "__version__",
    "angles_for",
    "available",
    "chain",
    "compare",
    "errors",
    "export",
    "features",
    "law_of",
    "load_scene",
    "load_trajectory",
    "minimal",
    "observed_order",
    "plan",
    "plot",
    "read_trajectory",
    "regress",
    "scene_from_csv",
    "scene_from_deck",
    "shipped_scenes",
    "solve",
    "study",
    "table_of",
    "testing",
    "verify",
    "write_deck",
    "write_trajectory",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
    if name in _MODULES:
        return importlib.import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOME, *_MODULES])
