"""The runs of a check: LAMMPS runs the script at its steps and at finer ones, our codes its scene."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from dem_bridge.backends.base import Sampling, backend, unsupported_reason
from dem_bridge.backends.prescan import Prescan
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.errors import DemBridgeError, RunBroken, UsageError
from dem_bridge.judging.check.edits import Edit, applied, stretched
from dem_bridge.judging.check.lammps_run import (
    LARGEST_SPACING_OF_PERIOD,
    LammpsRun,
    Spacing,
    along_chain,
    changing,
    samples_of,
    spacing_of,
    times_at,
)
from dem_bridge.judging.check.neighbours import safe_edits
from dem_bridge.judging.check.subject import Subject
from dem_bridge.judging.deck import DeckRun, deck_run, user_deck
from dem_bridge.judging.reference import ReferenceSamples, reference_at
from dem_bridge.judging.step import predict_step_error, stability_limit
from dem_bridge.judging.twin_run import twin_run
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.process import probe
from dem_bridge.observables.largest_step import StepError
from dem_bridge.runs.planning.predict import Outlook
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats

#: samples at which velocities are compared, about; more while forces act
SAMPLES_COMPARED = 400
#: samples of a run with other lines
_SAMPLES_OF_OTHER_LINES = 4000
#: times at which errors of other steps are looked for, relative to the last one at which forces act
_END_AFTER_LAST_FORCE = 1.05
#: numbers of one run of our code that are kept at most
_MOST_VALUES_KEPT = 4_000_000
#: release of LAMMPS since which a dump leaves out frames by a variable
_RELEASE_THAT_SKIPS_FRAMES = 20220623
#: steps times bodies of a run of our code for a second of the time limit, above which it takes a part of the limit
_STEPS_TIMES_BODIES_PER_SECOND = 1e6
#: runs of LAMMPS, of our velocity-Verlet code and of the reference that a check usually makes, for its cost
_LAMMPS_STEPS, _TWIN_STEPS, _REFERENCE_RUNS = 2.0, 12.0, 3.0
#: CPU time, s, that imports and starting LAMMPS take in a check, and that of reading dumps and of the further runs for
#: each body; fitted to 10 scripts of 3 to 80 bodies (docs/quality.md)
_OVERHEAD, _OVERHEAD_OF_BODY = 2.6, 0.075

Progress = Callable[[float, int, str], None]


@dataclass(kw_only=True, eq=False)
class Laboratory:
    """Makes the runs of a check; each is made once."""

    subject: Subject
    engine: Engine | None = None
    time_limit: float = 600.0
    progress: Progress | None = None
    _lammps: dict[tuple[int, int], LammpsRun] = field(default_factory=dict)
    _twins: dict[tuple[float, float | None, int], Floats] = field(default_factory=dict)
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
        state = self.subject.deck.state
        every = max(1, state.steps * factor // SAMPLES_COMPARED) if dense else self.every * factor
        own = self._spacing(factor) if dense else self.spacing
        close = (own.every if dense else own.every * factor) if every > 1 and self.skips else None
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
                active_every=close,
            ) as run:
                self._lammps[factor, every] = self._read(run, factor, dense)
        return self._lammps[factor, every]

    def _read(self, run: DeckRun, factor: int, dense: bool) -> LammpsRun:
        """Return the velocities of a run, in SI where the script has a scene."""
        samples = samples_of(run.out.read_text(), self.scene, dt=run.dt, unit=self.subject.unit)
        result = LammpsRun(
            factor=factor,
            time=samples.time,
            velocity=samples.velocity,
            bodies=samples.bodies,
            version=run.version,
            dangerous=run.dangerous,
        )
        steps, values = run.active() if result.finite else (result.active_steps, result.active)
        if not len(steps) or not np.all(np.isfinite(values)) or not np.all(np.diff(steps) > 0):
            return result
        values = (
            along_chain(run, values, result, float(steps[-1]) * (run.dt or 0.0))
            if samples.of_scene
            else values.reshape(len(steps), -1)
        )
        if not dense and (base := self._base) is not None:
            rows = np.flatnonzero(np.isin(steps // factor, base.common_steps))
        else:
            rows = changing(values)
        return replace(result, active_steps=steps[rows], active=values[rows])

    @property
    def _base(self) -> LammpsRun | None:
        """The run whose samples those of finer ones share; None if there is none yet."""
        return next((run for run in self._lammps.values() if len(run.active_steps)), None)

    @cached_property
    def skips(self) -> bool:
        """Return True if the release of LAMMPS leaves out frames of a dump by a variable."""
        return probe(self.engine or Engine.chosen()).version >= _RELEASE_THAT_SKIPS_FRAMES

    @cached_property
    def spacing(self) -> Spacing:
        """Steps of the script between two frames while forces act."""
        return self._spacing(1)

    @property
    def resolves(self) -> bool:
        """Return False if velocities may change a lot between two samples, so that the largest error is missed."""
        if self.every == 1 or (self.skips and self.spacing.resolves):
            return True
        dt, frequency = self.subject.deck.dt, 0.0 if self.prescan is None else self.prescan.frequency
        return dt is not None and 0.0 < self.every * dt * frequency <= LARGEST_SPACING_OF_PERIOD

    def _spacing(self, factor: int) -> Spacing:
        """Return the steps between two frames while forces act, of a script with steps so many times shorter."""
        deck = self.subject.deck
        dt = None if deck.dt is None else deck.dt / factor
        scene = None if self.problem or self.scene is None or self.scene.law is not None else self.scene
        frequency = 0.0 if self.prescan is None else self.prescan.frequency
        bodies = max(1, len(deck.state.particles.atoms))
        if deck.state.steps * factor * bodies > _STEPS_TIMES_BODIES_PER_SECOND * self.time_limit:
            scene = None  # our run, which estimates the part of the time in which forces act, takes too long
        return spacing_of(scene, dt, deck.state.steps * factor, bodies, frequency)

    # ------------------------------------------------------------------ our codes
    @cached_property
    def problem(self) -> str:
        """Why our velocity-Verlet code cannot repeat the run of LAMMPS; '' if it can."""
        if self.scene is None:
            return "the script cannot be read as a scene"
        if self.subject.deck.dt is None:
            return "the script has several time steps"
        return unsupported_reason(backend("verlet"), self.scene) or ""

    def sampled(self, scene: Scene, every: int, count: int) -> Scene:
        """Return the scene with so many samples, so many steps of the script apart."""
        assert self.subject.deck.dt is not None  # see ``problem``
        return replace(scene, duration=self.subject.deck.dt * every * count, samples=count)

    def twin(self, dt: float, radius: float | None = None, thin: int = 1) -> Floats:
        """Return the velocities of our velocity-Verlet code at a step, m/s, ``(n_t, n_body)``."""
        every = self.every * thin
        return self._stepped(dt, radius, every, max(1, self.subject.deck.state.steps // every))

    def _stepped(self, dt: float, radius: float | None, every: int, count: int) -> Floats:
        assert self.scene is not None  # see ``problem``
        if (dt, radius, every) not in self._twins:
            self.say(f"velocity Verlet at {dt:.3g} s")
            scene = self.sampled(self.scene, every, count)
            try:
                self._twins[dt, radius, every] = twin_run(scene, dt, radius).velocity
            except RunBroken:
                self._twins[dt, radius, every] = np.full((scene.samples + 1, scene.n_body), np.nan)
        return self._twins[dt, radius, every]

    def apart_while_active(self, run: LammpsRun, dt: float, radius: float | None) -> float:
        """Return the largest difference of LAMMPS from our code at a step, m/s, at the samples while forces act.

        Our code is not run where it would need too many samples.
        """
        close = self.spacing.every
        if not len(run.active_steps) or run.common_steps[-1] // close * run.active.shape[1] > _MOST_VALUES_KEPT:
            return 0.0
        velocity = self._stepped(dt, radius, close, max(1, int(run.common_steps[-1]) // close))
        with np.errstate(all="ignore"):
            apart = np.abs(run.active - velocity[run.common_steps // close][:, list(run.bodies)])
        return float(np.max(apart))

    def twin_error(self, dt: float, radius: float | None = None) -> tuple[float, float]:
        """Return the step that our code takes for ``dt``, which falls on the samples, and its error there.

        A step that is longer than the samples are apart has fewer samples.
        """
        own = self.subject.deck.dt
        assert own is not None  # see ``problem``
        thin = max(1, math.ceil(dt / (own * self.every) * (1.0 - 1e-9)))
        interval = own * self.every * thin
        step = interval / max(1, math.ceil(interval / dt * (1.0 - 1e-9)))
        rows = self.exact(self.times)[::thin]
        velocity = self.twin(step, radius, thin)
        with np.errstate(all="ignore"):
            largest = float(np.max(np.abs(velocity - rows[: len(velocity)]))) / self.speed
        return step, largest if math.isfinite(largest) else math.inf

    @cached_property
    def reference(self) -> ReferenceSamples:
        """The reference solution at the sample times of LAMMPS, and while forces act at more times.

        Raises
        ------
        UnsupportedScene
            If there is none.
        """
        assert self.scene is not None
        self.say("reference solution")
        return reference_at(self.scene, self.moments)

    @cached_property
    def moments(self) -> Floats:
        """Times at which errors are looked for, s: those of the samples, and more while forces act."""
        dt, base = self.subject.deck.dt, self._base
        if dt is None:
            return next(iter(self._lammps.values())).time
        steps = self.every * np.arange(self._count + 1)
        return times_at(np.union1d(steps, steps if base is None else base.common_steps), dt)

    def exact(self, times: Floats) -> Floats:
        """Return the velocities of the reference at some of its times, m/s, ``(n_t, n_body)``."""
        places = np.searchsorted(self.reference.time, times * (1.0 - 1e-9))
        return self.reference.values["velocity"][np.minimum(places, len(self.reference.time) - 1)]

    @property
    def _count(self) -> int:
        """Number of samples after the first one."""
        return max(1, self.subject.deck.state.steps // self.every)

    @property
    def times(self) -> Floats:
        """Sample times of our codes, s."""
        assert self.subject.deck.dt is not None  # see ``problem``
        return times_at(self.every * np.arange(self._count + 1), self.subject.deck.dt)

    @property
    def speed(self) -> float:
        """Largest velocity of the reference, m/s, to which errors are relative; 1 if nothing moves."""
        return self.reference.largest["velocity"] or 1.0

    def error(self, run: LammpsRun) -> float:
        """Return the largest error of velocities of a run, relative to the largest velocity; inf if not finite."""
        dt, columns = self.subject.deck.dt, list(run.bodies)
        exact = self.exact(self.times if dt is not None else run.time)[: len(run.velocity)]
        with np.errstate(all="ignore"):
            largest = float(np.max(np.abs(run.velocity[: len(exact)] - exact[:, columns])))
            if len(run.active_steps) and dt is not None:
                more = self.exact(times_at(run.common_steps, dt))
                largest = max(largest, float(np.max(np.abs(run.active - more[:, columns]))))
        return largest / self.speed if np.isfinite(largest) else float("inf")

    def confirmed_error(self, factor: int) -> float:
        """Return the error of LAMMPS with steps so many times shorter as a check of that script finds it."""
        assert self.scene is not None
        run, dt = self.lammps(factor, dense=True), (self.subject.deck.dt or math.nan) / factor
        error = 0.0
        for time, velocity in ((run.time, run.velocity), (times_at(run.active_steps, dt), run.active)):
            if len(time) > 0:
                exact = reference_at(self.scene, time)
                part = np.max(np.abs(velocity - exact.values["velocity"][:, list(run.bodies)]))
                error = max(error, float(part + exact.uncertainty["velocity"]))
        return error / self.speed

    def error_of(self, edits: Sequence[Edit]) -> float:
        """Return the error of LAMMPS with other lines at its own sample times; nan if it cannot be run or told."""
        assert self.scene is not None
        subject = self.subject
        try:
            changed = {**subject.changed, **applied(subject.texts(), edits)}
            steps = user_deck(subject.path, self.scene, subject.variables, changed).state.steps
            self.say("LAMMPS with other lines")
            with deck_run(
                subject.path,
                self.scene,
                engine=self.engine,
                variables=subject.variables,
                time_limit=self.time_limit,
                changed=changed,
                every=max(1, steps // _SAMPLES_OF_OTHER_LINES),
            ) as run:
                samples = samples_of(run.out.read_text(), self.scene, dt=run.dt, unit=subject.unit)
            exact = reference_at(self.scene, samples.time).values["velocity"][:, list(samples.bodies)]
        except DemBridgeError:
            return math.nan
        return float(np.max(np.abs(samples.velocity - exact))) / self.speed

    def error_with_safe_list(self, dt: float) -> float:
        """Return the error of LAMMPS at a longer step, s, with a safe neighbour list; nan if it is unknown."""
        try:
            longer = stretched(self.subject.texts(), self.subject.deck.commands, dt / self.subject.unit)
        except UsageError:
            return math.nan
        return self.error_of([*safe_edits(self.subject.deck), *longer])

    def predicted(self, dt: float, accuracies: tuple[float, ...] = ()) -> StepError | None:
        """Return the error of velocity Verlet at a step, at many times between the samples, too; None if none acts."""
        assert self.scene is not None
        times = np.linspace(0.0, self.times[-1], max(self._count, SAMPLES_COMPARED) + 1)
        if (base := self._base) is not None and self.subject.deck.dt is not None:
            # velocities do not change any more when no force acts
            more = self.subject.deck.dt * base.common_steps
            times = np.union1d(times[times <= _END_AFTER_LAST_FORCE * more[-1]], more)
        return predict_step_error(self.scene, dt, accuracies=accuracies, times=times)

    @cached_property
    def limit(self) -> float:
        """The largest step, s, that is stable; nan if it is not known or no contact closes."""
        if self.scene is None or self.prescan is None:
            return math.nan
        values = self.reference.values
        # no force acts after the last of the further samples
        end = self.times[-1] if self._base is None else self.times[1] / self.every * self._base.common_steps[-1]
        end = min(_END_AFTER_LAST_FORCE * float(end), float(self.times[-1]))
        return stability_limit(self.scene, values["displacement"], values["velocity"], end, self.prescan.frequency)

    @cached_property
    def prescan(self) -> Prescan | None:
        """A coarse run of the scene; None without a scene, or where it takes too long."""
        try:
            return None if self.scene is None else prescan_scene(self.scene)
        except DemBridgeError:
            return None

    def expected_cost(self) -> float | None:
        """Return the CPU time of the check, s, within a factor of two for most; None where it cannot be known.

        A step that is too coarse costs further runs, of which nothing is known beforehand.
        """
        if self.scene is None or self.prescan is None or not (dt := self.subject.deck.dt):
            return None
        outlook = Outlook(scene=self.scene, prescan=self.prescan, sampling=Sampling(count=self.scene.samples))
        own = _OVERHEAD + _OVERHEAD_OF_BODY * self.scene.n_body
        runs = _LAMMPS_STEPS * outlook.cost("lammps-granular", dt) + _TWIN_STEPS * outlook.cost("verlet", dt)
        return own + runs + _REFERENCE_RUNS * outlook.cost("reference")
