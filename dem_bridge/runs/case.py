"""A case: one scene solved by one backend with given settings."""

from __future__ import annotations

from dataclasses import dataclass

from dem_bridge.backends.base import ENGINE_BACKENDS, Backend, Resolution, Sampling, backend
from dem_bridge.backends.reference import SERIES
from dem_bridge.errors import UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.runs.keys import run_key
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory

#: largest memory of the samples of a run, bytes
MOST_MEMORY = 2**32
#: wall time of one core in s: per body and step for a fixed step, per body to a power for an adaptive one
_PER_STEP = {"lammps-granular": 6e-8, "lammps-table": 6e-8, "verlet": 2e-9, "blanes-moan": 1e-8, "ase": 1e-6}
_PER_BODIES = {"reference": (2e-4, 2.0), "scipy": (0.06, 0.85)}
#: LAMMPS evaluates the force of a drive as a formula at every step: factor of its time
_DRIVEN = 5.0
#: number of further runs that the uncertainty of a run takes
_FURTHER_RUNS = {"verlet": 5, "blanes-moan": 5, "scipy": 2}


@dataclass(frozen=True, kw_only=True)
class Case:
    """One run to be made: a scene, a backend, and the settings of the run."""

    scene: Scene
    backend: str
    resolution: Resolution
    sampling: Sampling
    engine: Engine | None = None
    """Which LAMMPS, for a backend that runs it; None: the default."""
    uncertainty: bool = True
    """Estimate the uncertainty of the run, too, which takes further runs; False: inf."""

    def __post_init__(self) -> None:
        size = 8 * (self.sampling.count + 1) * (2 * self.scene.n_body + self.scene.n_contact)
        if size > MOST_MEMORY:
            raise UsageError(
                f"{self.scene.name}: {self.sampling.count} samples of {self.scene.n_body} bodies take"
                f" {size / 2**30:.3g} GiB; allowed: {MOST_MEMORY >> 30} GiB; give fewer samples (--samples)"
            )

    @property
    def label(self) -> str:
        """The case in a few words, for progress."""
        dt = self.resolution.dt
        return f"{self.scene.name}: {self.backend}" + (f" at dt = {dt:.3g} s" if dt else "")

    @property
    def key(self) -> str | None:
        """Key of the run in a store; None: the run cannot be stored."""
        return run_key(
            self.scene, self.backend, self.resolution, self.sampling, self.engine, uncertainty=self.uncertainty
        )

    @property
    def expected(self) -> float:
        """Rough estimate of the wall time, s, by which runs are ordered and the remaining time is shown."""
        bodies, dt, code = self.scene.n_body, self.resolution.dt, self.backend
        if code == "reference" and not SERIES.covers(self.scene):
            code = "scipy"
        runs = 1 + (_FURTHER_RUNS.get(code, 0) if self.uncertainty else 0)
        if code in _PER_BODIES:
            factor, power = _PER_BODIES[code]
            return runs * factor * float(bodies**power)
        steps = self.scene.duration / dt if dt else 1e5
        if code in ENGINE_BACKENDS and self.scene.drive is not None:
            steps *= _DRIVEN
        return 0.05 + runs * _PER_STEP.get(code, 0.0) * bodies * steps

    def solve(self, code: Backend | None = None) -> Trajectory:
        """Return the run, without uncertainty; ``code``: a backend in place of the one that the case names."""
        code = code or backend(self.backend, self.engine)
        return code.run(self.scene, self.resolution, self.sampling)
