"""What a code does in one scene: its values at each time step, their limits, and how far they are from a motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dem_bridge.judging.conformance.faults import Values
from dem_bridge.judging.conformance.limit import QUANTITIES, Limit, Samples, limit_of
from dem_bridge.judging.conformance.scenes import Probe
from dem_bridge.judging.conformance.truth import Truth
from dem_bridge.trajectory.trajectory import Floats

#: multiple of the uncertainty of a limit that is no fault yet
ALLOWED_UNCERTAINTIES = 2.0
#: uncertainty of a limit, relative to the largest value, above which nothing is decided
LARGEST_UNCERTAINTY = 0.05


@dataclass(frozen=True, eq=False)
class Behaviour:
    """What a code does in one scene: its values at each time step, and their limits."""

    probe: Probe
    truth: Truth
    files: tuple[Samples, ...]
    """Values at each time step, from coarse to fine."""
    limits: Mapping[str, Limit]
    scale: Mapping[str, float]
    """Largest magnitude of each quantity, in the reference or in the finest file: the file may have other units."""

    @property
    def uncertainty(self) -> float:
        """Largest uncertainty of the limits and of the reference, relative to the largest values."""
        own = (self.truth.uncertainty[name] / self.scale[name] for name in self.limits)
        return max(limit.uncertainty for limit in self.limits.values()) + max(own)

    @property
    def allowed(self) -> float:
        """Difference from the reference, relative to the largest values, that the time steps explain."""
        return ALLOWED_UNCERTAINTIES * self.uncertainty

    def difference(self, values: Values) -> float:
        """Return the largest difference of the limits from values of a motion, relative to the largest values."""
        return float(np.max(np.abs(self.residual(values))))

    def residual(self, values: Values) -> Floats:
        """Return all differences of the limits from values of a motion, relative to the largest values."""
        parts = []
        for name, limit in self.limits.items():
            rows = values[name][-len(limit.values) :]
            parts.append(((limit.values - rows) / self.scale[name]).ravel())
        return np.nan_to_num(np.concatenate(parts), nan=1e3, posinf=1e3, neginf=-1e3)


def behaviour_of(probe: Probe, truth: Truth, files: Sequence[Samples]) -> Behaviour:
    """Return what the files of a code, from coarse to fine, say of one scene."""
    names = [name for name in QUANTITIES if all(name in file.values for file in files)]
    limits, scale = {}, {}
    for name in names:
        rows = min(len(file.values[name]) for file in files)
        values = [file.values[name][-rows:] for file in files]
        scale[name] = max(truth.scale[name], float(np.max(np.abs(values[-1]))))
        digits = max(file.digits[name] for file in files)
        limits[name] = limit_of(values, digits, scale[name], smooth=probe.smooth)
    return Behaviour(probe, truth, tuple(files), limits, scale)
