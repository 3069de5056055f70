"""Curves of work-precision: for each backend and each of its settings, runs from cheap to expensive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from dem_bridge.backends.base import (
    BACKENDS,
    ENGINE_BACKENDS,
    Backend,
    Resolution,
    Sampling,
    backend,
    unsupported_reason,
)
from dem_bridge.backends.prescan import Prescan
from dem_bridge.lmp.engine import Engine
from dem_bridge.report.texts import Texts
from dem_bridge.runs.case import Case
from dem_bridge.runs.uncertainty.extrapolate import extrapolate
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory

TEXTS = Texts("work-precision", "dem_bridge.studies")
#: steps are the sample interval over these powers of two, from the first that is below 1/omega of the stiffest contact
HALVINGS = 13
#: ... fewer for those that take long
FINEST = {"lammps-granular": 11, "lammps-table": 11, "ase": 5}
#: ... and for orders above 2, which are at their floor there
FINEST_OF_HIGH_ORDER = 10
#: ... and of tables at a fixed step, so many halvings below the first: errors of a step are then 1e-5 or less
FIXED_HALVINGS = 7
POINTS = (100, 400, 1600, 6400)
STYLES = ("spline", "linear")
LINES = (16, 50, 160)
#: knobs that are whole numbers
WHOLE = ("table_points", "table_lines")
#: atol of ode45 (m and m/s) beside an rtol; both fall together
ATOL_PER_RTOL = 1e-3
#: how the seconds of a run go with its knob, for predictions: adaptive steps as the tolerance to this power
ADAPTIVE = 1.0 / 6.0
#: s of a run of which nothing else is known
UNKNOWN = 0.1


@dataclass(frozen=True, kw_only=True)
class Curve:
    """One backend with one knob turned, all else fixed."""

    name: str
    backend: str
    knob: str = ""
    """Field of a Resolution; '' where nothing can be turned."""
    values: Sequence[float] = (float("nan"),)
    """Of the knob, from cheap to expensive."""
    fixed: Mapping[str, Any] = field(default_factory=dict)
    """More fields of the Resolution."""
    variant: str = ""
    """What tells it from other curves of the backend, for the drawing."""
    richardson: bool = False

    def settings(self, value: float) -> dict[str, Any]:
        """Fields of a Resolution that are asked for, with ``value`` of the knob."""
        if not self.knob:
            return dict(self.fixed)
        requested = {**self.fixed, self.knob: int(value) if self.knob in WHOLE else value}
        if self.variant == "both":
            requested["atol"] = ATOL_PER_RTOL * value
        return requested

    def size(self, value: float) -> float:
        """Return the size with which the time of a run grows about linearly."""
        if self.knob == "dt":
            return 1.0 / value
        return value**-ADAPTIVE if self.knob in ("rtol", "atol") else value

    def case(self, scene: Scene, value: float, sampling: Sampling, *, limit: float = 1e9) -> Case:
        """Return the case of a run; ``limit`` (s) stops an engine in another process."""
        resolution = Resolution(**self.settings(value), time_limit=limit)
        return Case(scene=scene, backend=self.backend, resolution=resolution, sampling=sampling, uncertainty=False)

    def run(self, chosen: Backend, scene: Scene, value: float, sampling: Sampling, *, limit: float) -> Trajectory:
        """Run the scene with these settings."""
        case = self.case(scene, value, sampling, limit=limit)
        return extrapolate(case, chosen) if self.richardson else case.solve(chosen)

    def guess(self, scene: Scene, value: float, sampling: Sampling) -> float:
        """Guess the seconds of one run, for the time that is left and nothing else."""
        case = self.case(scene, value, sampling)
        return UNKNOWN if case.resolution.dt is None else case.expected * (10.0 if self.richardson else 1.0)


#: settings of backends with adaptive steps, from cheap to expensive; in "both", atol (m and m/s) goes with rtol
_RTOL = (1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
_ATOL = tuple(ATOL_PER_RTOL * value for value in _RTOL)
ADAPTIVE_CURVES: Mapping[str, list[Curve]] = {
    "scipy": [Curve(name="scipy", backend="scipy", knob="rtol", values=(1e-4, 1e-8, 1e-12))],
    "ode45": [
        Curve(name="ode45 (rtol alone)", backend="ode45", knob="rtol", values=_RTOL),
        Curve(name="ode45 (atol alone)", backend="ode45", knob="atol", values=_ATOL, variant="atol alone"),
        Curve(name="ode45 (both)", backend="ode45", knob="rtol", values=_RTOL, variant="both"),
    ],
}


def curves(
    scene: Scene, sampling: Sampling, prescan: Prescan, engine: Engine | None, requested: Sequence[str] | None = None
) -> tuple[list[tuple[Curve, Backend]], list[str]]:
    """Return all curves that can be run here, each with its backend; and why others cannot.

    ``requested``: names of backends; None for all.
    """
    results, notes = [], []
    for name in BACKENDS if requested is None else dict.fromkeys(requested):
        chosen = backend(name, engine if name in ENGINE_BACKENDS else None)
        reason = unsupported_reason(chosen, scene) or chosen.availability().reason
        if reason:
            notes.append(f"{name} is not there: {reason}")
            continue
        results += [(curve, chosen) for curve in _of(chosen, steps(scene, sampling, prescan), scene)]
    return results, notes


def steps(scene: Scene, sampling: Sampling, prescan: Prescan) -> tuple[float, ...]:
    """Return time steps (s), each half the one before, that fall on the samples; the first below 1/omega."""
    first = scene.duration / sampling.count
    while first * prescan.frequency > 1.0:
        first *= 0.5
    return tuple(first * 0.5**j for j in range(HALVINGS))


def _of(chosen: Backend, dt: tuple[float, ...], scene: Scene) -> list[Curve]:
    name = chosen.name
    if chosen.order is None:
        return ADAPTIVE_CURVES.get(name) or [Curve(name=name, backend=name)]
    finest = FINEST.get(name, HALVINGS if chosen.order <= 2 else FINEST_OF_HIGH_ORDER)
    by_step = Curve(name=name, backend=name, knob="dt", values=dt[:finest])
    sparse = replace(by_step, values=by_step.values[::2])
    if name == "ase":
        return [sparse]
    if name == "lammps-table":
        return [sparse, *_tables(name, dt[FIXED_HALVINGS])]
    results = [by_step]
    if chosen.order == 2:  # three runs of 2 dt, dt and dt/2; coarser ones have no clean order
        values = by_step.values[2:-1:2] or by_step.values
        results.append(
            replace(sparse, name=f"{name} (Richardson)", values=values, variant="richardson", richardson=True)
        )
    if name == "lammps-granular" and scene.spacing is not None:
        radius = f"R = {500.0 * scene.spacing:.3g} mm"
        fixed = {"geometry": "physical"}
        results.append(replace(sparse, name=f"{name} ({radius})", variant="physical", fixed=fixed))
    return results


def _tables(name: str, dt: float) -> list[Curve]:
    """Return the knobs of tables at a fixed step."""
    points = Curve(name=name, backend=name, knob="table_points", values=POINTS)
    return [
        *(
            replace(points, name=f"{name} ({style})", fixed={"dt": dt, "table_style": style}, variant=style)
            for style in STYLES
        ),
        replace(points, name=f"{name} (lines)", knob="table_lines", values=LINES, fixed={"dt": dt}, variant="lines"),
    ]
