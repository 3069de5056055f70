"""The reference solution of each scene at its samples: shipped for the frozen set, computed for other scenes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from types import MappingProxyType
from typing import Any

import numpy as np

from dem_bridge.errors import UsageError
from dem_bridge.judging.conformance.limit import QUANTITIES
from dem_bridge.judging.conformance.scenes import SET, Probe, frozen_probes
from dem_bridge.judging.reference import reference_at
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats

#: file of the values of the frozen set
FILE = f"set{SET}.json"
_SCHEMA_OF_SET = "dem-bridge/conformance-set/1"


@dataclass(frozen=True, eq=False)
class Truth:
    """The reference solution at the samples of a scene."""

    values: Mapping[str, Floats]
    """Velocity and displacement, ``(n_t, n_body)``, SI."""
    uncertainty: Mapping[str, float]
    """Largest error of each quantity, in its unit."""
    scale: Mapping[str, float]
    """Largest magnitude of each quantity."""


def truth_of(probe: Probe) -> Truth:
    """Return the shipped values of a frozen scene, or the reference solution of another one.

    Examples
    --------
    >>> truth = truth_of(frozen_probes()[0])
    >>> truth.values["velocity"][-1].round(12).tolist(), truth.uncertainty["velocity"] < 1e-12
    ([0.0, 0.5], True)
    """
    if probe.frozen:
        shipped = _shipped(probe)
        return _truth({name: np.array(shipped[name]) for name in QUANTITIES}, shipped["uncertainty"])
    return computed_truth(probe.scene)


def computed_truth(scene: Scene) -> Truth:
    """Return the solution of the reference at the samples of a scene."""
    samples = reference_at(scene, np.linspace(0.0, scene.duration, scene.samples + 1))
    return _truth({name: samples.values[name] for name in QUANTITIES}, samples.uncertainty)


def _truth(values: Mapping[str, Floats], uncertainty: Mapping[str, float]) -> Truth:
    """Return values with their scales."""
    return Truth(
        MappingProxyType(dict(values)),
        MappingProxyType({name: float(uncertainty[name]) for name in QUANTITIES}),
        MappingProxyType({name: float(np.max(np.abs(values[name]))) for name in QUANTITIES}),
    )


def _shipped(probe: Probe) -> Mapping[str, Any]:
    """Return the stored values of a frozen scene; raise UsageError if they are of another scene."""
    entry: Mapping[str, Any] = _stored()[probe.scene.name]
    if entry["content_hash"] != probe.scene.content_hash:
        raise UsageError(f"{FILE}: the values of {probe.scene.name} belong to another scene; install dem-bridge again")
    return entry


@cache
def _stored() -> Mapping[str, Any]:
    """Return the scenes of the shipped file by name."""
    text = (resources.files("dem_bridge.judging.conformance") / FILE).read_text(encoding="utf-8")
    return MappingProxyType(json.loads(text)["scenes"])


def set_text() -> str:
    """Return the file of the frozen set, computed by the reference; one line a sample."""
    scenes = {}
    for probe in frozen_probes():
        truth = computed_truth(probe.scene)
        scenes[probe.scene.name] = {
            "content_hash": probe.scene.content_hash,
            "uncertainty": {name: float(f"{1.05 * truth.uncertainty[name]:.2g}") for name in QUANTITIES},
            **{name: truth.values[name].tolist() for name in QUANTITIES},
        }
    rows = json.dumps({"schema": _SCHEMA_OF_SET, "set": SET, "scenes": scenes}, separators=(",", ":"))
    return rows.replace("],[", "],\n[").replace('},"', '},\n"') + "\n"
