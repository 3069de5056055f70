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
    from dem_bridge.report.study import Study


class Entry(NamedTuple):
    """Location of a study, and its purpose in one sentence."""

    module: str
    function: str
    summary: str


#: name -> purpose, the first line of the function's docstring
SUMMARIES = {
    "model-hierarchy": "Find which physics and which numerics a scene needs for an accuracy, and its smallest"
    " adequate model.",
    "work-precision": "Measure the error of every backend against its cost, for each of its numerical settings.",
    "rule-of-thumb": "Measure the error of velocity-Verlet at time steps of 5, 10, 20 and 40 % of the Rayleigh time.",
    "order": "Measure the order at contact onset, errors at given tolerances, and condition numbers.",
    "stability": "Find the largest stable and the largest accurate time steps of velocity-Verlet.",
    "energy": "Measure the energy error over many contacts against its prediction by backward error analysis.",
    "extremes": "Run a catalogue of extreme scenes through every backend and check each error against its uncertainty.",
    "bands": "Compare the band edges of a driven, precompressed chain with those of the infinite chain.",
    "horizon": "Measure how long single velocities are predictable, and check what is conserved beyond that time.",
    "precision": "Measure the digits of the velocities that LAMMPS' single and mixed precision modes leave.",
    "scatter": "Measure how random errors of the contact angles change arrival, residence times and peak forces.",
    "sensitivity": "Measure how much each contact's or body's error contributes to the spread of arrival, speeds and"
    " forces.",
    "restitution": "Measure the restitution of impacts by every damping law, clip and code, and compare it with closed"
    " forms.",
    "engine": "Check every normal law, damping and wall of LAMMPS in one impact each against theory, and name what is"
    " wrong.",
    "measurement": "Compare measured values with a scene, each difference with its validation uncertainty, and fit"
    " parameters.",
    "styles": "Run a scene through every pair style, wall and suffix of LAMMPS and compare each with the twin.",
}
#: studies that are packages with a module "study"; the others are one module
_PACKAGES = (
    "model-hierarchy",
    "work-precision",
    "stability",
    "extremes",
    "horizon",
    "order",
    "energy",
    "engine",
    "restitution",
    "measurement",
)


def _entry(name: str, summary: str) -> Entry:
    stem = name.replace("-", "_")
    return Entry(f"dem_bridge.studies.{stem}{'.study' * (name in _PACKAGES)}", f"study_{stem}", summary)


STUDIES: Mapping[str, Entry] = MappingProxyType({name: _entry(name, text) for name, text in SUMMARIES.items()})


def study_named(name: str) -> Callable[..., Study]:
    """Return the function of a study; raise UsageError with the names that exist if there is none of that name."""
    if not isinstance(name, str) or name not in STUDIES:
        raise UsageError(f"study = {name!r}; allowed: {', '.join(STUDIES)}")
    entry = STUDIES[name]
    function: Callable[..., Study] = getattr(importlib.import_module(entry.module), entry.function)
    return function
