"""The studies that exist, by name; each is imported only when asked for.

A study is a function ``(scene, *, engine, jobs, progress, store, **own settings) -> Study``; without a scene where it
takes a catalogue of its own. Adding one = a module with that function, a line here and a command in ``cli.studies``.
"""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable, Mapping
from types import MappingProxyType

from dem_bridge.errors import UsageError
from dem_bridge.studies.study import Study

#: name -> (module, function)
STUDIES: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "model-hierarchy": ("dem_bridge.studies.model_hierarchy.study", "study_model_hierarchy"),
        "work-precision": ("dem_bridge.studies.work_precision.study", "study_work_precision"),
        "rule-of-thumb": ("dem_bridge.studies.rule_of_thumb", "study_rule_of_thumb"),
        "stability": ("dem_bridge.studies.stability.study", "study_stability"),
        "extremes": ("dem_bridge.studies.extremes.study", "study_extremes"),
        "bands": ("dem_bridge.studies.bands", "study_bands"),
        "horizon": ("dem_bridge.studies.horizon.study", "study_horizon"),
    }
)
#: settings that every study has
COMMON = ("scene", "engine", "jobs", "progress", "store")


def study_named(name: str) -> Callable[..., Study]:
    """The study of that name; UsageError with the names that exist otherwise."""
    if not isinstance(name, str) or name not in STUDIES:
        raise UsageError(f"study = {name!r}; allowed: {', '.join(STUDIES)}")
    module, attribute = STUDIES[name]
    found: Callable[..., Study] = getattr(importlib.import_module(module), attribute)
    return found


def takes(study: Callable[..., Study]) -> tuple[bool, bool, tuple[str, ...]]:
    """Whether a study takes a scene, whether it must have one, and its own settings beside :data:`COMMON`."""
    parameters = inspect.signature(study).parameters
    scene = parameters.get("scene")
    own = tuple(name for name in parameters if name not in COMMON)
    return scene is not None, scene is not None and scene.default is scene.empty, own
