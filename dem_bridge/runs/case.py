"""A case: one scene solved by one backend with given settings."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from dem_bridge.backends.base import Backend, Resolution, Sampling, backend
from dem_bridge.backends.reference import SERIES
from dem_bridge.errors import UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.runs.costs import WITH_UNCERTAINTY, predicted_cost
from dem_bridge.runs.keys import run_key
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory

#: largest memory of the samples of a run, bytes
MOST_MEMORY = 2**32
#: time in which a run is checked, looked up, handed over and described, s
OVERHEAD = 0.05
#: rough numbers of a run that nobody has looked at yet: steps of a default time step; steps of the prescan, which are
#: as close as dense samples, for each body (57 on decelerating-40); tolerance
_STEPS, _COARSE_STEPS, _RTOL = 1e5, 50.0, 1e-10


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

    @cached_property
    def expected(self) -> float:
        """Rough estimate of the time, s, by which runs are ordered and the remaining time is shown."""
        scene, dt, code = self.scene, self.resolution.dt, self.backend
        if code == "reference" and not SERIES.covers(scene):
            code = "scipy"
        steps, coarse = scene.duration / dt if dt else _STEPS, _COARSE_STEPS * scene.n_body
        cost = predicted_cost(
            code,
            scene,
            steps=steps,
            samples=min(steps, max(self.sampling.count, coarse)),
            coarse=coarse,
            rtol=self.resolution.rtol or _RTOL,
        )
        return OVERHEAD + cost * (WITH_UNCERTAINTY.get(code, 1.0) if self.uncertainty else 1.0)

    def solve(self, code: Backend | None = None) -> Trajectory:
        """Return the run, without uncertainty; ``code``: a backend in place of the one that the case names."""
        code = code or backend(self.backend, self.engine)
        return code.run(self.scene, self.resolution, self.sampling)
