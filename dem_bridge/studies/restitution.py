"""Study of restitution: which one an impact has for the coefficient that is written, by every damping law and code.

Each impact is solved by several codes with their uncertainties and compared with the closed form of its law: for the
coefficients that are written, and at other speeds, mass ratios and radii. For one coefficient the time step of the twin
and of LAMMPS varies, too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from dem_bridge.backends.base import BACKENDS, ENGINE_BACKENDS, Resolution, Sampling
from dem_bridge.errors import BackendUnavailable, UnsupportedScene, UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.observables.verdict import Outcome, Verdict, judge_relative
from dem_bridge.physics.damped_impact import RestitutionLaw, restitution_obtained, restitution_to_write
from dem_bridge.report.columns import METRE, PERCENT, SPEED, STIFFNESS, Column
from dem_bridge.report.study import EFFECTS, FigureData, Series, Study, Table
from dem_bridge.report.texts import Texts
from dem_bridge.runs.campaign import Jobs, Progress, Result, run_cases
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from dem_bridge.scene.scene import BY_RESTITUTION
from dem_bridge.studies.recalled import recall_study
from dem_bridge.studies.restitution_impacts import (
    CONTACTS,
    LAWS,
    VARIED,
    WRITTEN,
    Bounce,
    Impact,
    Parameter,
    bounce_cases,
    bounces_of,
    curve_of,
    usual_impact,
    varied_impacts,
    written_impacts,
)
from dem_bridge.verification.assess import named_failures

TEXTS = Texts("restitution", "dem_bridge.studies")
WRITE_COLUMNS = (
    "wanted", "coeff_restitution, not clipped", "coeff_restitution, clipped", "tsuji, not clipped", "tsuji, clipped",
)  # fmt: skip
OBTAINED_COLUMNS = (
    "written", "coeff_restitution, not clipped", "coeff_restitution, clipped", "tsuji, not clipped", "tsuji, clipped",
)  # fmt: skip
IMPACTS_COLUMNS = {
    "impact.name": "law", "impact.coefficient": "coefficient", "impact.speed": Column("speed", SPEED),
    "impact.ratio": "mass ratio", "impact.radius": Column("radius", METRE), "backend": "code", "theory": "closed form",
    "value": "restitution", "difference": "difference", "uncertainty": "uncertainty", "outcome": "outcome",
}  # fmt: skip
STEPS_COLUMNS = {
    "impact.name": "law", "backend": "code", "steps": "steps per contact time", "value": "restitution",
    "difference": "error",
}  # fmt: skip
BOUNCES_COLUMNS = {
    "backend": "code", "stiffness": Column("stiffness", STIFFNESS), "number": "bounce",
    "hard": Column("hard sphere", METRE), "soft": Column("soft sphere", METRE),
    "softness": Column("soft - hard", PERCENT), "height": Column("code", METRE), "error": Column("code - soft", METRE),
    "uncertainty": Column("uncertainty", METRE), "outcome": "outcome",
}  # fmt: skip
BACKENDS_BY_DEFAULT = ("scipy", "verlet", "lammps-granular")
#: codes with a fixed step, whose step is varied
STEPPED = ("verlet", "lammps-granular")
#: elastic contact time over the time step of fixed-step codes, and the values at which the step is varied
STEPS = 1000
STEPS_VARIED = (10, 30, 100, 300, 1000)
#: restitutions for which the table lists what to write
WANTED = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)
#: factor from SI to the unit of an axis
_FACTORS: dict[Parameter, float] = {"speed": 1.0, "ratio": 1.0, "radius": 1e3}


@dataclass(frozen=True, kw_only=True)
class Measured:
    """Restitution of one impact by one code."""

    varies: str
    impact: Impact
    result: Result
    steps: int = STEPS
    """Elastic contact time over the time step."""

    @property
    def backend(self) -> str:
        """Name of the code."""
        return self.result.case.backend

    @cached_property
    def value(self) -> float:
        """Speed of separation over speed of approach; nan without a run."""
        run = self.result.trajectory
        return math.nan if run is None else run.restitution

    @cached_property
    def uncertainty(self) -> float:
        """Estimated numerical error of the value: that of the velocities of all bodies."""
        run = self.result.trajectory
        return math.nan if run is None else len(run.velocity[-1]) * run.uncertainty.velocity / self.impact.speed

    @cached_property
    def closed_form(self) -> tuple[float, float]:
        """Restitution by the closed form, and a bound of its error."""
        return self.impact.theory()

    @property
    def theory(self) -> float:
        """Restitution by the closed form."""
        return self.closed_form[0]

    @property
    def difference(self) -> float:
        """Value less closed form."""
        return self.value - self.theory

    @property
    def outcome(self) -> Outcome:
        """PASS if the value is the closed form within the uncertainty of the run and the error of the form."""
        if self.result.trajectory is not None:
            return judge_relative(abs(self.difference), self.closed_form[1], self.uncertainty)
        absent = isinstance(self.result.failure, UnsupportedScene | BackendUnavailable)
        return Outcome.NOT_RUN if absent else Outcome.BROKEN


def study_restitution(
    *,
    engine: Engine | None = None,
    jobs: Jobs = None,
    progress: Progress | None = None,
    store: Store | None = None,
    laws: Sequence[str] = LAWS,
    backends: Sequence[str] = BACKENDS_BY_DEFAULT,
    known_defects: str = "fail",
) -> Study:
    """Measure the restitution of impacts by every damping law, clip and code, and compare it with closed forms.

    Two spheres, or a sphere and a wall, meet at several speeds, mass ratios and radii. The study lists the restitution
    that is obtained for the coefficient that is written, and the coefficient to write for the one that is wanted.

    Parameters
    ----------
    laws : sequence of str
        Damping laws.
    backends : sequence of str
        Codes; LAMMPS and the twin run at a thousandth of the elastic contact time.
    known_defects : {"fail", "ok"}
        Effect on the exit code of failures that known defects of this LAMMPS release explain.
    engine, jobs, progress, store : as in :func:`dem_bridge.study`

    Returns
    -------
    Study

    Raises
    ------
    UsageError
        For a law or a backend that does not exist.
    """
    choices = (
        ("laws", laws, LAWS),
        ("backends", backends, tuple(BACKENDS)),
        ("known_defects", [known_defects], EFFECTS),
    )
    for name, values, allowed in choices:
        if not values or not set(values) <= set(allowed):
            raise UsageError(f"{name} = {list(values)!r}; allowed: some of {', '.join(allowed)}")
    engine = engine or Engine.chosen()

    def measured() -> Study:
        campaign = {"jobs": jobs, "progress": progress, "store": store}
        return _study(laws, backends, known_defects, engine, campaign)

    settings = {"laws": list(laws), "backends": list(backends), "known_defects": known_defects}
    return recall_study("restitution", store, measured, [], engine, **settings)


def _study(
    laws: Sequence[str], backends: Sequence[str], known_defects: str, engine: Engine, campaign: Mapping[str, Any]
) -> Study:
    """Run the impacts and show their restitution; ``campaign``: arguments of ``run_cases``."""
    points = [*_points(laws, backends, engine), *_step_points(laws, backends, engine)]
    bouncing = bounce_cases(backends, engine) if "coeff_restitution" in laws else []
    cases = [case for *_, case in points]
    results = run_cases([*cases, *bouncing], **campaign)
    bounced = zip(bouncing, results[len(cases) :], strict=True)
    bounces = [bounce for case, result in bounced for bounce in bounces_of(case.scene, result)]
    measured = [
        Measured(varies=varies, impact=impact, steps=steps, result=result)
        for (varies, impact, steps, _), result in zip(points, results[: len(cases)], strict=True)
    ]
    judged = [item for item in measured if item.varies != "step"]
    verdicts = (*_verdicts(judged), *_bounce_verdicts(bounces))
    return TEXTS.study(
        {"contacts": CONTACTS, "steps": STEPS},
        answer=(*_answer(measured, laws, verdicts), *_bounce_answer(bounces)),
        tables=(*_tables(measured), *([TEXTS.table("bounces", BOUNCES_COLUMNS, bounces)] if bounces else [])),
        figures=(_figure(measured, laws),),
        verdicts=verdicts,
        known_defects=known_defects,
    )


def _points(
    laws: Sequence[str], backends: Sequence[str], engine: Engine | None
) -> Iterator[tuple[str, Impact, int, Case]]:
    """Yield what varies, the impact, the contact time over the step, and the case, for all impacts that are judged."""
    both = [usual_impact(law, clip) for law in laws if law not in BY_RESTITUTION for clip in (False, True)]
    impacts = [("coefficient", impact) for impact in (*written_impacts(laws), *both)]
    for law in laws:
        if law != "tsuji":  # its force has the form of that of the law "coeff_restitution"
            impacts += [(name, impact) for name in VARIED for impact in varied_impacts(law, name)]
    for varies, impact in impacts:
        for backend in backends:
            yield varies, impact, STEPS, _case(impact, backend, engine, STEPS)


def _step_points(
    laws: Sequence[str], backends: Sequence[str], engine: Engine | None
) -> Iterator[tuple[str, Impact, int, Case]]:
    """Yield the same for the first law at several time steps, without uncertainties."""
    law = "coeff_restitution" if "coeff_restitution" in laws else laws[0]
    for clip in (False, True):
        for backend in (name for name in backends if name in STEPPED):
            for steps in STEPS_VARIED:
                impact = usual_impact(law, clip)
                yield "step", impact, steps, _case(impact, backend, engine, steps, uncertainty=False)


def _case(impact: Impact, backend: str, engine: Engine | None, steps: int, *, uncertainty: bool = True) -> Case:
    return Case(
        scene=impact.scene,
        backend=backend,
        resolution=Resolution(dt=impact.contact_time / steps),
        sampling=Sampling(count=CONTACTS),
        engine=engine if backend in ENGINE_BACKENDS else None,
        uncertainty=uncertainty,
    )


def _verdicts(measured: Sequence[Measured]) -> Iterator[Verdict]:
    """Yield a verdict for each law, clip and code, on the impact that differs most in units of its uncertainty."""
    groups: dict[tuple[str, str], list[Measured]] = {}
    for item in measured:
        groups.setdefault((item.impact.name, item.backend), []).append(item)
    for (name, backend), items in groups.items():
        absent = next((item for item in items if item.result.trajectory is None), None)
        if absent is not None:
            reason = {"outcome": absent.outcome, "failure": absent.result.failure}
            yield TEXTS.verdict("absent", scene=name, backend=backend, **reason)
            continue
        # a failure decides, then what is undecided, then the largest share of the uncertainty
        order = (Outcome.FAIL, Outcome.UNDECIDED, Outcome.PASS)
        worst = min(items, key=lambda item: (order.index(item.outcome), -abs(item.difference) / item.uncertainty))
        verdict = TEXTS.verdict(
            "restitution",
            scene=name,
            backend=backend,
            outcome=worst.outcome,
            difference=abs(worst.difference),
            tolerance=worst.uncertainty,
            uncertainty=worst.uncertainty,
            reference_uncertainty=worst.closed_form[1],
            worst=worst,
            count=len(items),
            relation="within" if worst.outcome is Outcome.PASS else "not within",
        )
        run = worst.result.trajectory if backend in ENGINE_BACKENDS else None
        yield from named_failures(worst.impact.scene.name, backend, run, [verdict])


def _bounce_verdicts(bounces: Sequence[Bounce]) -> Iterator[Verdict]:
    """Yield a verdict for each code that ran, on the height that differs most in units of its uncertainty."""
    for backend in dict.fromkeys(bounce.backend for bounce in bounces if math.isfinite(bounce.height)):
        items = [bounce for bounce in bounces if bounce.backend == backend]
        worst = max(items, key=lambda item: abs(item.error) / item.uncertainty)
        relative = {"difference": abs(worst.error) / worst.soft, "tolerance": worst.uncertainty / worst.soft}
        texts = {"backend": backend, "outcome": worst.outcome, "scale": worst.soft, "count": len(items)}
        yield TEXTS.verdict("bounce", **texts, **relative, uncertainty=relative["tolerance"], worst=worst)


def _bounce_answer(bounces: Sequence[Bounce]) -> Iterator[str]:
    """Yield a sentence on the difference between hard and soft spheres, and on the errors of codes."""
    measured = [bounce for bounce in bounces if math.isfinite(bounce.height)]
    if measured:
        first = [bounce for bounce in measured if bounce.number == 1]
        errors = [
            f"{max(abs(item.error) / item.soft for item in measured if item.backend == backend):.1e} ({backend})"
            for backend in dict.fromkeys(item.backend for item in measured)
        ]
        yield TEXTS("bounce", soft=first[0], stiff=first[-1], errors=", ".join(errors))


def _answer(measured: Sequence[Measured], laws: Sequence[str], verdicts: Sequence[Verdict]) -> Iterator[str]:
    obtained = (restitution_obtained(e, clip=True) for e in WRITTEN)
    pairs = ", ".join(f"{e:g} gives {value:.4f}" for e, value in zip(WRITTEN, obtained, strict=True))
    half = restitution_to_write(0.5, clip=True)
    yield TEXTS("obtained", pairs=pairs, least=math.exp(-2.0), half=half)
    judged = (Outcome.PASS, Outcome.FAIL, Outcome.UNDECIDED)
    counted = [item for item in verdicts if item.quantity == "restitution" and item.outcome in judged]
    agree = [verdict for verdict in counted if verdict.outcome is Outcome.PASS]
    yield TEXTS("agreement" if counted else "none", agree=len(agree), count=len(counted))
    for verdict in counted:
        if verdict.outcome is Outcome.FAIL:
            yield TEXTS("departure", verdict=verdict, values=_listed(measured, verdict))
    for law in laws:
        if law in BY_RESTITUTION:
            continue
        spans = {name: [impact.theory()[0] for impact in varied_impacts(law, name)] for name in VARIED}
        slow, _, fast = spans["speed"]
        speed = TEXTS("no_speed") if math.isclose(slow, fast) else TEXTS("speed", slow=slow, fast=fast)
        words = usual_impact(law).clip_words
        yield TEXTS("law", law=law, clip=words, speed=speed, ratio=spans["ratio"], radius=spans["radius"])
    steps = {item.steps: item for item in measured if item.varies == "step" and not item.impact.clip}
    if steps and all(math.isfinite(steps[count].difference) for count in (10, 100)):
        yield TEXTS("step", backend=steps[10].backend, at_10=steps[10].difference, at_100=steps[100].difference)


def _listed(measured: Sequence[Measured], verdict: Verdict) -> str:
    """List the restitutions of a failing code beside the coefficients that were written, or beside the closed form."""
    items = [
        item
        for item in measured
        if (item.impact.name, item.backend, item.varies) == (verdict.scene, verdict.backend, "coefficient")
    ]
    written = {True: "written", False: "closed form"}
    return ", ".join(
        f"{item.value:.5f} ({written[by]} {item.impact.coefficient if by else item.theory:.5g})"
        for item in items
        if (by := item.impact.law in BY_RESTITUTION) or item.outcome is Outcome.FAIL
    )


def _tables(measured: Sequence[Measured]) -> Iterator[Table]:
    chosen: list[RestitutionLaw] = ["coeff_restitution", "tsuji"]
    kinds = [(law, clip) for law in chosen for clip in (False, True)]
    yield TEXTS.table(
        "write",
        WRITE_COLUMNS,
        [(e, *(restitution_to_write(e, clip=clip, law=law) for law, clip in kinds)) for e in WANTED],
    )
    yield TEXTS.table(
        "obtained",
        OBTAINED_COLUMNS,
        [(e, *(restitution_obtained(e, clip=clip, law=law) for law, clip in kinds)) for e in WRITTEN],
    )
    yield TEXTS.table("impacts", IMPACTS_COLUMNS, [item for item in measured if item.varies != "step"])
    yield TEXTS.table("steps", STEPS_COLUMNS, [item for item in measured if item.varies == "step"])


def _figure(measured: Sequence[Measured], laws: Sequence[str]) -> FigureData:
    panels = [TEXTS.panel("written", _written_series(measured))]
    shown = [law for law in laws if law != "tsuji"] or list(laws)
    for name in VARIED:
        lines = []
        for nth, law in enumerate(shown):
            x, y = curve_of(law, name)
            lines.append(Series(label=usual_impact(law).name, style=f"line/{nth}/0", x=_FACTORS[name] * x, y=y))
        panels.append(TEXTS.panel(name, (*lines, *_marks(measured, name)), log=True))
    panels.append(TEXTS.panel("step", _step_series(measured), log=True))
    return TEXTS.figure("restitution", panels)


def _written_series(measured: Sequence[Measured]) -> Iterator[Series]:
    """Yield the closed forms, and the values of each code where they are obtained and where they are not."""
    e = np.linspace(0.01, 1.0, 100)
    for clip in (False, True):
        y = np.array([restitution_obtained(value, clip=clip) for value in e.tolist()])
        yield Series(label="clipped" if clip else "not clipped", style="line/6/3" if clip else "line/6/0", x=e, y=y)
    items = [item for item in measured if item.varies == "coefficient" and item.impact.law in BY_RESTITUTION]
    for wrong in (False, True):
        for backend in dict.fromkeys(item.backend for item in items):
            some = [item for item in items if item.backend == backend and (item.outcome is Outcome.FAIL) is wrong]
            if some:
                x, y = np.array([(item.impact.coefficient, item.value) for item in some]).T
                label = f"{backend}, {some[0].impact.law}: wrong" if wrong else backend
                yield Series(label=label, style="mark-1" if wrong else f"mark/{backend}", x=x, y=y)


def _marks(measured: Sequence[Measured], name: Parameter) -> Iterator[Series]:
    """Yield the values of each code for all values of a parameter but walls."""
    items = [item for item in measured if item.varies == name and item.impact.ratio < math.inf]
    for backend in dict.fromkeys(item.backend for item in items):
        some = [item for item in items if item.backend == backend]
        x = _FACTORS[name] * np.array([getattr(item.impact, name) for item in some])
        y, bar = np.array([item.value for item in some]), np.array([item.uncertainty for item in some])
        yield Series(label=backend, style=f"mark/{backend}", x=x, y=y, bar=bar)


def _step_series(measured: Sequence[Measured]) -> Iterator[Series]:
    """Yield the errors of each code at several time steps."""
    items = [item for item in measured if item.varies == "step"]
    for backend, clip in dict.fromkeys((item.backend, item.impact.clip) for item in items):
        some = [item for item in items if (item.backend, item.impact.clip) == (backend, clip)]
        x, y = 1.0 / np.array([item.steps for item in some]), np.abs([item.difference for item in some])
        kind = "clipped" if clip else "not clipped"
        yield Series(label=f"{backend}, {kind}", style=f"curve/{backend}/{'richardson' if clip else ''}", x=x, y=y)
