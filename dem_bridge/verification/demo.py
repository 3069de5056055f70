"""Show what a verification is on one chain: LAMMPS' error, its cause, and the step that an accuracy needs.

It takes seconds: LAMMPS, its twin and the reference solve the chain once, and the twin at further steps.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.foundation.wording import share
from dem_bridge.lmp.engine import Engine
from dem_bridge.report.study import FigureData, Panel, Series, Study, Table
from dem_bridge.runs.cache import RunCache
from dem_bridge.runs.case import Case
from dem_bridge.runs.uncertainty.estimate import solve
from dem_bridge.scene.file import load_scene
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats, Trajectory
from dem_bridge.verification.chains import body_noun
from dem_bridge.verification.panels import spacetime_panel
from dem_bridge.verification.reference_choice import REFERENCE
from dem_bridge.verification.roles import TWIN

#: the shipped scene that is solved, and the time step of LAMMPS, s
SCENE, STEP_OF_LAMMPS_S = "tapered-backward", 1e-7
#: steps of the twin, s, the coarsest first; STEP is one of them
STEPS_OF_TWIN_S = (2e-6, 1e-6, 5e-7, 2e-7, 1e-7, 5e-8, 2e-8)
#: accuracies, relative to the largest velocity, for which a step is named
ACCURACIES = (1e-3, 1e-5)
#: backend of LAMMPS
ENGINE = "lammps-granular"
#: part of the error of LAMMPS that its difference from the twin may be where the step is the cause
_LARGEST_SHARE_UNEXPLAINED = 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class Demonstration:
    """The runs of the demonstration and the errors that follow from them, relative to the largest velocity."""

    scene: Scene
    lammps: Trajectory
    reference: Trajectory
    twins: Mapping[float, Trajectory]
    """Runs of the twin by their steps, s."""

    @property
    def scale(self) -> float:
        """Largest velocity of the reference, m/s."""
        return float(np.abs(self.reference.velocity).max())

    def differences(self, run: Trajectory, other: Trajectory) -> Floats:
        """Return the largest difference of velocities at each time, relative to the scale."""
        return np.asarray(np.abs(run.velocity - other.velocity).max(axis=1) / self.scale)

    @property
    def errors(self) -> dict[float, float]:
        """Largest error of the twin at each step."""
        return {dt: float(self.differences(run, self.reference).max()) for dt, run in self.twins.items()}

    def largest_step(self, accuracy: float) -> float | None:
        """Return the largest step of those tried whose error, and that of all finer ones, is within an accuracy."""
        largest = None
        for dt, error in sorted(self.errors.items()):
            if error > accuracy:
                break
            largest = dt
        return largest


def demonstrate(engine: Engine | None = None, tell: Callable[[float, int, str], None] | None = None) -> Study:
    """Solve the chain of the demonstration and return it as a study.

    Parameters
    ----------
    engine : Engine, optional
        Which LAMMPS. None: the default one.
    tell : callable, optional
        Called with (done, total, label) before each part.

    Raises
    ------
    BackendUnavailable
        If there is no LAMMPS on this machine.
    """
    scene, cache = load_scene(SCENE), RunCache()
    steps: list[tuple[str, str, float | None]] = [(f"LAMMPS solves {SCENE}", ENGINE, STEP_OF_LAMMPS_S)]
    steps += [("the reference solution", REFERENCE, None)]
    steps += [(f"the twin at dt = {dt:g} s", TWIN, dt) for dt in STEPS_OF_TWIN_S]
    runs = []
    for done, (label, backend, dt) in enumerate(steps):
        if tell is not None:
            tell(done, len(steps) + 1, label)
        case = Case(
            scene=scene,
            backend=backend,
            resolution=Resolution(dt=dt),
            sampling=Sampling(count=scene.samples),
            engine=engine if backend == ENGINE else None,
            uncertainty=backend == REFERENCE,
        )
        runs.append(solve(case, cache))
    if tell is not None:
        tell(len(steps), len(steps) + 1, "the page")
    lammps, reference, *twins = runs
    return study_of(
        Demonstration(
            scene=scene, lammps=lammps, reference=reference, twins=dict(zip(STEPS_OF_TWIN_S, twins, strict=True))
        )
    )


def study_of(demo: Demonstration) -> Study:
    """Return the answer, the figures and the table of the demonstration."""
    return Study(
        id="demo",
        title="A chain, LAMMPS, its error and the cause",
        answer=_answer(demo),
        figures=(_motion(demo), _convergence(demo)),
        tables=(_steps(demo),),
        notes=(
            "The error is the largest difference of velocities between LAMMPS and a reference solution, over"
            " all samples and bodies, relative to the largest velocity. The reference is a Taylor series of high order;"
            f" its own uncertainty is {share(demo.reference.uncertainty['velocity'] / demo.scale)}.",
            "The twin is an independent implementation of the algorithm of LAMMPS (velocity-Verlet). Where it has the"
            " same error, the algorithm and its time step cause it, and not the code.",
            f"The steps are the largest of the {len(STEPS_OF_TWIN_S)} in the table whose error is within the accuracy.",
            f"A verification does this for your chain, with all checks: dem-bridge verify {SCENE} -o report/",
        ),
        provenance={"lammps": demo.lammps.provenance.get("lammps", {}), "versions": demo.lammps.provenance["versions"]},
    )


def _answer(demo: Demonstration) -> tuple[str, ...]:
    """Return a line each for the chain, the error, its cause, and the steps that serve."""
    scene, lammps = demo.scene, demo.lammps
    error = float(demo.differences(lammps, demo.reference).max())
    rest = float(demo.differences(lammps, demo.twins[STEP_OF_LAMMPS_S]).max())
    version = str(lammps.provenance["lammps"]["version"])
    release = datetime.strptime(version, "%Y%m%d").strftime("%d %b %Y").lstrip("0")
    cause = "the time step; a second code with this step has the same error"
    if rest > _LARGEST_SHARE_UNEXPLAINED * error:
        cause = (
            f"unknown; a second code with this step has an error of {share(demo.errors[STEP_OF_LAMMPS_S])}, and differs"
        )
    served = [(share(accuracy), demo.largest_step(accuracy)) for accuracy in ACCURACIES]
    steps = [f"{dt:g} s for an error below {accuracy}" if dt else f"none for {accuracy}" for accuracy, dt in served]
    return (
        f"Chain: {scene.n_body} {body_noun(scene)}s, the first at {max(scene.velocity):g} m/s;"
        f" LAMMPS {release}, step {STEP_OF_LAMMPS_S:g} s.",
        f"Error: LAMMPS' velocities are wrong by at most {share(error)} of the largest.",
        f"Cause: {cause} to {rest:.0e}.",
        f"Step:  {', '.join(steps)}.",
    )


def _motion(demo: Demonstration) -> FigureData:
    """Return the figure with the velocities of all bodies and the error at each time."""
    run, end = demo.lammps, demo.scene.duration
    pairs = (
        ("LAMMPS - reference", "line/0/1", demo.lammps, demo.reference),
        ("twin - reference", "line/6/2", demo.twins[STEP_OF_LAMMPS_S], demo.reference),
        ("LAMMPS - twin: round-off", "line/1/0", demo.lammps, demo.twins[STEP_OF_LAMMPS_S]),
    )
    series = []
    for label, style, first, second in pairs:
        values = demo.differences(first, second)
        kept = values > 0.0
        series.append(Series(label=label, style=style, x=1e3 * run.time[kept], y=values[kept]))
    return FigureData(
        id="demo-error",
        title="The chain and the error of LAMMPS",
        caption="Left: velocity of every body (colour) against time; the impulse runs to the right. Right: largest"
        " difference of velocities at each time, relative to the largest velocity. The first two lines lie on each"
        " other: the error of LAMMPS is that of its algorithm at this step.",
        panels=(
            spacetime_panel(run, "velocity by LAMMPS", until=end, body=body_noun(demo.scene)),
            Panel(
                title=f"error at a step of {STEP_OF_LAMMPS_S:g} s",
                x_label="time (ms)",
                y_label="difference / largest velocity",
                series=tuple(series),
                log_y=True,
            ),
        ),
    )


def _convergence(demo: Demonstration) -> FigureData:
    """Return the figure with the error against the step."""
    steps = np.array(sorted(demo.twins))
    errors = np.array([demo.errors[dt] for dt in steps])
    lammps = float(demo.differences(demo.lammps, demo.reference).max())
    guide = errors[0] * (steps / steps[0]) ** 2
    return FigureData(
        id="demo-steps",
        title="Error against time step",
        caption="Largest error of velocities of the twin, and of LAMMPS at its step. A code of second order follows the"
        " dashed line: half the step has a quarter of the error.",
        panels=(
            Panel(
                title="error against step",
                x_label="time step (s)",
                y_label="error / largest velocity",
                log=True,
                series=(
                    Series(label="order 2", style="guide", x=steps, y=guide),
                    Series(label="twin", style="nth/0/2", x=steps, y=errors),
                    Series(
                        label="LAMMPS", style="lammps-granular", x=np.array([STEP_OF_LAMMPS_S]), y=np.array([lammps])
                    ),
                ),
            ),
        ),
    )


def _steps(demo: Demonstration) -> Table:
    """Return the table of the steps that were tried."""
    rows = tuple((dt, demo.errors[dt], float(demo.twins[dt].cost.steps)) for dt in STEPS_OF_TWIN_S)
    return Table(
        id="demo-steps",
        title="Time steps and errors",
        caption="Error of velocities of the twin, relative to the largest velocity.",
        columns=("time step (s)", "error", "time steps"),
        rows=rows,
    )
