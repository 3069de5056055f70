"""The studies that exist, by name. Each module is imported only when its study is called.

A study is a function ``(scene, *, engine, jobs, progress, store, **settings) -> Study`` that takes those of these
parameters that it uses. Its signature and the "Parameters" section of its docstring are all that
:func:`dem_bridge.study` and the command line know of it. To add a study, write a module with that function and an
entry here.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

from dem_bridge.errors import UsageError

if TYPE_CHECKING:
    from dem_bridge.studies.study import Study


class Entry(NamedTuple):
    """Location of a study, and its purpose in one sentence (the first line of the function's docstring)."""

    module: str
    function: str
    summary: str


STUDIES: Mapping[str, Entry] = MappingProxyType(
    {
        "model-hierarchy": Entry(
            "dem_bridge.studies.model_hierarchy.study",
            "study_model_hierarchy",
            "Find which physics and which numerics a scene needs for an accuracy, and its smallest adequate model.",
        ),
        "work-precision": Entry(
            "dem_bridge.studies.work_precision.study",
            "study_work_precision",
            "Measure the error of every backend against its cost, for each of its numerical settings.",
        ),
        "rule-of-thumb": Entry(
            "dem_bridge.studies.rule_of_thumb",
            "study_rule_of_thumb",
            "Measure the error of velocity-Verlet at time steps of 5, 10, 20 and 40 % of the Rayleigh time.",
        ),
        "stability": Entry(
            "dem_bridge.studies.stability.study",
            "study_stability",
            "Find the largest stable and the largest accurate time steps of velocity-Verlet.",
        ),
        "extremes": Entry(
            "dem_bridge.studies.extremes.study",
            "study_extremes",
            "Run a catalogue of extreme scenes through every backend and check each error against its uncertainty.",
        ),
        "bands": Entry(
            "dem_bridge.studies.bands",
            "study_bands",
            "Compare the band edges of a driven, precompressed chain with those of the infinite chain.",
        ),
        "horizon": Entry(
            "dem_bridge.studies.horizon.study",
            "study_horizon",
            "Measure how long single velocities are predictable, and check what is conserved beyond that time.",
        ),
        "scatter": Entry(
            "dem_bridge.studies.scatter",
            "study_scatter",
            "Measure how random errors of the contact angles change arrival, residence times and peak forces.",
        ),
        "styles": Entry(
            "dem_bridge.studies.styles",
            "study_styles",
            "Run a scene through every pair style, wall and suffix of LAMMPS and compare each with the twin.",
        ),
    }
)


def study_named(name: str) -> Callable[..., Study]:
    """Return the function of a study; raise UsageError with the names that exist if there is none of that name."""
    if not isinstance(name, str) or name not in STUDIES:
        raise UsageError(f"study = {name!r}; allowed: {', '.join(STUDIES)}")
    entry = STUDIES[name]
    function: Callable[..., Study] = getattr(importlib.import_module(entry.module), entry.function)
    return function
