"""The runs of a check: LAMMPS runs the script at its steps and at finer ones, our codes its scene."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling, backend, unsupported_reason
from dem_bridge.backends.prescan import Prescan
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.errors import DemBridgeError, RunBroken, UsageError
from dem_bridge.formats.readers import read_record
from dem_bridge.judging.check.subject import Subject
from dem_bridge.judging.deck import deck_run
from dem_bridge.judging.reference import ReferenceSamples, reference_at
from dem_bridge.judging.step import StepError, predict_step_error
from dem_bridge.lmp.engine import Engine
from dem_bridge.runs.case import Case
from dem_bridge.runs.planning.predict import Outlook
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats

#: samples at which velocities are compared, about
SAMPLES_COMPARED = 400
#: runs of LAMMPS, of our velocity-Verlet code and of the reference that a check usually makes, for its cost
_LAMMPS_STEPS, _TWIN_STEPS, _REFERENCE_RUNS = 2.0, 12.0, 3.0
#: CPU time, s, that imports, starting LAMMPS and reading its dumps take in a check
_OVERHEAD = 4.5

Progress = Callable[[float, int, str], None]


@dataclass(frozen=True, kw_only=True, eq=False)
class LammpsRun:
    """Velocities of one run of the script by LAMMPS."""

    factor: int
    """How many times its time steps are shorter than those of the script."""
    time: Floats
    """Sample times, s, ``(n_t,)``."""
    velocity: Floats
    """In m/s, ``(n_t, n_body)`` of a scene; else in the units of the script, three components of each atom."""
    bodies: tuple[int, ...]
    version: int
    dangerous: int
    """Dangerous builds of the neighbour list."""

    @property
    def finite(self) -> bool:
        """Return True if all velocities are numbers."""
        return bool(np.all(np.isfinite(self.velocity)))


@dataclass(kw_only=True, eq=False)
class Laboratory:
    """Makes the runs of a check; each is made once."""

    subject: Subject
    engine: Engine | None = None
    time_limit: float = 600.0
    progress: Progress | None = None
    _lammps: dict[tuple[int, int], LammpsRun] = field(default_factory=dict)
    _twins: dict[tuple[float, float | None], Floats] = field(default_factory=dict)
    _said: int = 0

    @property
    def scene(self) -> Scene | None:
        """The scene of the script."""
        return self.subject.scene

    def say(self, label: str) -> None:
        """Tell the progress; the number of runs is not known beforehand."""
        self._said += 1
        if self.progress is not None:
            self.progress(1.0 - 0.8**self._said, 1, label)

    # ------------------------------------------------------------------ LAMMPS
    @property
    def every(self) -> int:
        """Steps of the script between two samples."""
        return max(1, self.subject.deck.state.steps // SAMPLES_COMPARED)

    def lammps(self, factor: int = 1, *, dense: bool = False) -> LammpsRun:
        """Return the run of the script with steps so many times shorter, at the same times.

        ``dense``: with as many samples as a check of that script takes.

        Raises
        ------
        RunBroken
            If LAMMPS stops with an error.
        BackendUnavailable
            If there is no LAMMPS or it lacks a style.
        UsageError
            If the steps of the script cannot be changed.
        """
        every = max(1, self.subject.deck.state.steps * factor // SAMPLES_COMPARED) if dense else self.every * factor
        if (factor, every) not in self._lammps:
            self.say("LAMMPS" + (f" with steps {factor} times shorter" if factor > 1 else ""))
            changed = self.subject.finer(factor)
            with deck_run(
                self.subject.path,
                self.scene,
                engine=self.engine,
                variables=self.subject.variables,
                time_limit=self.time_limit,
                changed=changed,
                every=every,
            ) as run:
                version, dangerous = run.version, run.dangerous
                time, velocity = _dumped(run.out.read_text())
                bodies = tuple(range(velocity.shape[1] // 3))
                time = time * self.subject.unit
                if self.scene is not None and np.all(np.isfinite(velocity)):
                    record = read_record(run.out, self.scene, dt=run.dt)
                    time, velocity = record.time, record.values["velocity"]
                    bodies = tuple(record.columns["velocity"])
            self._lammps[factor, every] = LammpsRun(
                factor=factor, time=time, velocity=velocity, bodies=bodies, version=version, dangerous=dangerous
            )
        return self._lammps[factor, every]

    # ------------------------------------------------------------------ our codes
    @cached_property
    def problem(self) -> str:
        """Why our velocity-Verlet code cannot repeat the run of LAMMPS; '' if it can."""
        if self.scene is None:
            return "the script cannot be read as a scene"
        if self.subject.deck.dt is None:
            return "the script has several time steps"
        return unsupported_reason(backend("verlet"), self.scene) or ""

    def sampled(self, scene: Scene, thin: int = 1) -> Scene:
        """Return the scene with the duration and the samples of LAMMPS' runs, or every ``thin``-th of these."""
        every = self.every * thin
        count = max(1, self.subject.deck.state.steps // every)
        assert self.subject.deck.dt is not None  # see ``problem``
        return replace(scene, duration=self.subject.deck.dt * every * count, samples=count)

    def twin(self, dt: float, radius: float | None = None, thin: int = 1) -> Floats:
        """Return the velocities of our velocity-Verlet code at a step, m/s, ``(n_t, n_body)``."""
        assert self.scene is not None  # see ``problem``
        if (dt, radius) not in self._twins:
            self.say(f"velocity Verlet at {dt:.3g} s")
            scene = self.sampled(self.scene, thin)
            case = Case(
                scene=scene,
                backend="verlet",
                resolution=Resolution(dt=dt, surrogate_radius=radius),
                sampling=Sampling(count=scene.samples),
                uncertainty=False,
            )
            try:
                self._twins[dt, radius] = case.solve().velocity
            except RunBroken:
                self._twins[dt, radius] = np.full((scene.samples + 1, scene.n_body), np.nan)
        return self._twins[dt, radius]

    def twin_error(self, dt: float, radius: float | None = None) -> tuple[float, float]:
        """Return the step that our code takes for ``dt``, which falls on the samples, and its error there.

        A step that is longer than the samples are apart has fewer samples.
        """
        own = self.subject.deck.dt
        assert own is not None  # see ``problem``
        thin = max(1, math.ceil(dt / (own * self.every) * (1.0 - 1e-9)))
        interval = own * self.every * thin
        step = interval / max(1, math.ceil(interval / dt * (1.0 - 1e-9)))
        rows = self.reference.values["velocity"][::thin]
        velocity = self.twin(step, radius, thin)
        with np.errstate(all="ignore"):
            largest = float(np.max(np.abs(velocity - rows[: len(velocity)]))) / self.speed
        return step, largest if math.isfinite(largest) else math.inf

    @cached_property
    def reference(self) -> ReferenceSamples:
        """The reference solution at the sample times of LAMMPS.

        Raises
        ------
        UnsupportedScene
            If there is none.
        """
        assert self.scene is not None
        self.say("reference solution")
        time = self.lammps().time if self.problem else self.times
        return reference_at(self.scene, time)

    @property
    def times(self) -> Floats:
        """Sample times of our codes, s."""
        assert self.scene is not None
        scene = self.sampled(self.scene)
        return np.linspace(0.0, scene.duration, scene.samples + 1)

    @property
    def speed(self) -> float:
        """Largest velocity of the reference, m/s, to which errors are relative; 1 if nothing moves."""
        return self.reference.largest["velocity"] or 1.0

    def error(self, velocity: Floats) -> float:
        """Return the largest error of velocities of all bodies, relative to the largest velocity; inf if not finite."""
        with np.errstate(all="ignore"):
            largest = float(np.max(np.abs(velocity - self.reference.values["velocity"][: len(velocity)])))
        return largest / self.speed if np.isfinite(largest) else float("inf")

    def confirmed_error(self, factor: int) -> float:
        """Return the error of LAMMPS with steps so many times shorter as a check of that script finds it."""
        assert self.scene is not None
        run = self.lammps(factor, dense=True)
        exact = reference_at(self.scene, run.time)
        error = np.max(np.abs(run.velocity - exact.values["velocity"][:, list(run.bodies)]))
        return float(error + exact.uncertainty["velocity"]) / self.speed

    def predicted(self, dt: float, accuracies: tuple[float, ...] = ()) -> StepError | None:
        """Return the error of velocity Verlet at a step, at many times between the samples, too; None if none acts."""
        assert self.scene is not None
        scene = self.sampled(self.scene)
        times = np.linspace(0.0, scene.duration, max(scene.samples, SAMPLES_COMPARED) + 1)
        return predict_step_error(self.scene, dt, accuracies=accuracies, times=times)

    @cached_property
    def prescan(self) -> Prescan | None:
        """A coarse run of the scene; None without a scene, or where it takes too long."""
        try:
            return None if self.scene is None else prescan_scene(self.scene)
        except DemBridgeError:
            return None

    def expected_cost(self) -> float | None:
        """Return the CPU time of the check, s, within a factor of two; None where it cannot be known."""
        if self.scene is None or self.prescan is None or not (dt := self.subject.deck.dt):
            return None
        outlook = Outlook(scene=self.scene, prescan=self.prescan, sampling=Sampling(count=self.scene.samples))
        engine = _LAMMPS_STEPS * outlook.cost("lammps-granular", dt)
        return (
            _OVERHEAD + engine + _TWIN_STEPS * outlook.cost("verlet", dt) + _REFERENCE_RUNS * outlook.cost("reference")
        )


def _dumped(text: str) -> tuple[Floats, Floats]:
    """Return times and velocities of the added dump, atoms by their ids: ``(n_t,)`` and ``(n_t, 3 n_atom)``."""
    times: list[float] = []
    rows: list[Floats] = []
    lines = text.splitlines()
    place, count = 0, 0
    while place < len(lines):
        heading = lines[place]
        if heading.startswith("ITEM: TIME") and not heading.startswith("ITEM: TIMESTEP"):
            times.append(float(lines[place + 1]))
        elif heading.startswith("ITEM: NUMBER OF ATOMS"):
            count = int(lines[place + 1])
        elif heading.startswith("ITEM: ATOMS"):
            table = np.array([line.split() for line in lines[place + 1 : place + 1 + count]], dtype=float)
            rows.append(table[np.argsort(table[:, 0]), 5:8].ravel())
            place += count
        place += 1
    if len({len(row) for row in rows}) > 1:
        raise UsageError("the number of atoms changes during the run; allowed: as many atoms in all frames")
    return np.array(times), np.array(rows)
