"""Figures of the report beside those of the paper: all differences on one scale, effects, limits of the model."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from dem_bridge.observables.differences import difference
from dem_bridge.observables.registry import OBSERVABLES as REGISTERED
from dem_bridge.report.study import FigureData, Map, Series
from dem_bridge.report.texts import Texts
from dem_bridge.studies.paper import PAPER
from dem_bridge.studies.paper.effects import PARAMETER, PHYSICS, SUPPOSED, Effect
from dem_bridge.studies.paper.runs import MAIN, Runs
from dem_bridge.studies.paper.validity import ContactValidity, contacts_of
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.reference_choice import SCIPY

TEXTS = Texts("overview", "dem_bridge.studies")
#: rows of the scale of differences: numerical errors, then effects of the model with the observable that each changes
HEADINGS = {"numerics": "Errors of velocities:", "effects": "Effects of the model:"}
NUMERICS = {
    "reference": "reference (estimate)",
    "scipy": "reference, second method",
    "round-off": "LAMMPS, round-off",
    "time-step": "LAMMPS, time step",
    "ode45": "ode45 (defaults)",
}
EFFECTS = {
    "gravity": ("gravity and base: arrival", "arrival at the last cylinder"),
    "bca": ("BCA: arrival", "arrival at the last cylinder"),
    "exact-stiffness": ("exact Hertz law: force", "largest force"),
    "striker-mass": ("striker of fused quartz: force", "largest force"),
    "exponent-1um": ("n falls to 2.2: force", "force at the middle"),
    "bca-force": ("BCA: force", "largest force"),
    "bca-velocity": ("BCA: velocity", "velocity of cylinder 20"),
}
#: assumptions of the model, in the order in which they are judged
ASSUMPTIONS = ("ellipse", "pressure", "edge tension", "sound", "weight")
#: rows of the scale -> part of the error budget of velocities; code whose velocities differ
_PARTS = {"round-off": "round-off", "reference": "reference", "time-step": "time step"}
_CODES = (SCIPY, "ode45")
#: rows of the scale that have the tolerance; width of the scale, as a part of the width of a sheet
_JUDGED_ROWS, _SCALE_WIDTH = ("round-off", "time-step"), 0.54
#: observables of the tornado chart; the assumption of a contact whose ratio should be large
_SHOWN = ("arrival at the last cylinder", "force at the middle", "largest force")
_SOUND = 3
#: scenes of fewer bodies have lines; end of a map in units of the last crossing; rows and columns of a small map
_FEW, _PASSED, _CELLS = 5, 1.05, 80
#: kind of error of the rows of the scale; those of ode45 are the paper's own and no part of LAMMPS' error
_KINDS = {"round-off": "round-off", "reference": "round-off", SCIPY: "round-off", "time-step": "time step", "ode45": ""}


def scale_of_differences(
    studies: Sequence[SceneStudy], effects: Sequence[Effect], runs: Runs, accuracy: float
) -> FigureData:
    """Return the figure with every difference on one logarithmic scale: numerical errors, then effects of the model."""
    values = {name: dict(_differences(name, studies, effects, runs)) for name in MAIN}
    rows: dict[str, str] = {}
    for group, texts in (("numerics", NUMERICS), ("effects", {id: text for id, (text, _) in EFFECTS.items()})):
        present = {id: text for id, text in texts.items() if any(id in of_chain for of_chain in values.values())}
        rows |= ({group: HEADINGS[group]} if present else {}) | present
    places = {id: float(place) for place, id in enumerate(rows)}
    series = []
    for mark, (name, of_chain) in zip(("mark-2", "mark-3"), values.items(), strict=True):
        points = [(value, places[id]) for id, value in of_chain.items() if value > 0.0]
        x, y = np.array(points).reshape(-1, 2).T
        series.append(Series(label=PAPER(name.removesuffix("-40")), style=mark, x=x, y=y))
    judged = [places[id] for id in _JUDGED_ROWS if id in places]
    if judged:
        ends = np.array([min(judged) - 0.5, max(judged) + 0.5])
        series.append(Series(label=TEXTS("tolerance"), style="guide", x=np.full(2, accuracy), y=ends))
    kinds = tuple("" if id in ("numerics", "effects") else _KINDS.get(id, "model") for id in rows)
    panel = replace(TEXTS.panel("scale", series, rows=tuple(rows.values())), row_kinds=kinds)
    return replace(TEXTS.figure("scale", [panel]), width=_SCALE_WIDTH)


def _differences(
    name: str, studies: Sequence[SceneStudy], effects: Sequence[Effect], runs: Runs
) -> Iterator[tuple[str, float]]:
    """Yield the rows of the scale that are known for one chain, with their values."""
    for study in studies:
        if study.scene.name == name and study.budgets:
            for id, part in _PARTS.items():
                yield id, study.budgets[0].parts[part]
    truth = runs.truth(name)
    for code in _CODES:
        if truth is not None and (run := runs.run(name, code)) is not None:
            yield code, difference("velocity", run, truth).value
    for id, (_, observable) in EFFECTS.items():
        for effect in effects:
            if (effect.scene, effect.id) == (name, id.removesuffix("-force")) and observable in effect.changes:
                yield id, abs(effect.changes[observable])
    if truth is not None and (run := runs.run(name, "bca")) is not None:
        by_theory, simulated = (REGISTERED["peak_velocity"].value(runs.scenes[name], of)[20] for of in (run, truth))
        yield "bca-velocity", abs(float(by_theory / simulated) - 1.0)


def tornado(effects: Sequence[Effect]) -> FigureData | None:
    """Return the chart of what each term of the model and each parameter changes; None without any."""
    terms = [effect for effect in effects if effect.kind in (PARAMETER, PHYSICS, SUPPOSED)]
    sizes: dict[str, float] = {}
    for effect in terms:
        sizes[effect.id] = max(sizes.get(effect.id, 0.0), *(abs(effect.changes[name]) for name in _SHOWN))
    rows = sorted(sizes, key=lambda id: -sizes[id])
    if not rows:
        return None
    names = tuple(TEXTS.data["terms"].get(id, id) for id in rows)

    def bars(observable: str) -> Iterator[Series]:
        for name in MAIN:
            of_chain = {effect.id: effect.changes[observable] for effect in terms if effect.scene == name}
            at = [place for place, id in enumerate(rows) if math.isfinite(of_chain.get(id, math.nan))]
            x = np.array([100.0 * of_chain[rows[place]] for place in at])
            label = PAPER(name.removesuffix("-40"))
            yield Series(label=label, style="bar", x=x, y=np.array(at, dtype=float))

    panels = [
        TEXTS.panel("tornado", bars(name), rows=names if not nth else ("",) * len(names), observable=name, bars=True)
        for nth, name in enumerate(_SHOWN)
    ]
    return TEXTS.figure("tornado", panels, columns=3)


def validity_figure(runs: Runs) -> FigureData | None:
    """Return the five ratios of each contact to their limits against the contact angle; None without cylinders."""
    panels, tensions = [], []
    for letter, (scene, contacts) in zip(("(a)", "(b)"), contacts_of(runs, MAIN), strict=False):
        tensions.append([contact.judged[2].ratio for contact in contacts])
        angled = sorted((c for c in contacts if math.isfinite(c.angle)), key=lambda contact: contact.angle)
        x = np.array([contact.angle for contact in angled])
        series = [
            Series(label=label, style=f"nth/{nth}/{nth}", x=x, y=np.array([_over_limit(c, nth) for c in angled]))
            for nth, label in enumerate(ASSUMPTIONS)
        ]
        series.append(Series(label="limit", style="guide", x=x[[0, -1]], y=np.ones(2)))
        chain = PAPER(scene.name.removesuffix("-40"))
        panels.append(
            TEXTS.panel("validity", series, letter=letter, chain=chain, shares_scale_with=(0, 1), log=True, tall=True)
        )
    if len(panels) < len(MAIN):
        return None
    of_striker, inner = max(ratios[0] for ratios in tensions), max(max(ratios[1:]) for ratios in tensions)
    return TEXTS.figure("validity", panels, tension=of_striker, inner=inner)


def all_scenes(runs: Runs, names: Sequence[str]) -> FigureData | None:
    """Return the velocities of every scene as small multiples; None without any."""
    panels = []
    for name in names:
        run, scene = runs.truth(name), runs.scenes.get(name)
        if run is None or scene is None:
            continue
        title = f"{name} ({scene.n_body})"
        if scene.n_body < _FEW:
            lines = tuple(
                Series(label=f"body {k}", style=f"line/{k}/{k}", x=1e3 * run.time, y=run.velocity[:, k])
                for k in range(scene.n_body)
            )
            panels.append(TEXTS.panel("scene", lines, title=title))
            continue
        end = min(_PASSED * float(np.nanmax(run.crossing_time, initial=0.0)) or scene.duration, scene.duration)
        rows = max(2, int(np.searchsorted(run.time, end, side="right")))
        thin = (slice(None, rows, max(1, rows // _CELLS)), slice(1, None, max(1, scene.n_body // _CELLS)))
        values = run.velocity[thin]
        x = np.arange(float(scene.n_body))[thin[1]]
        velocities = Map(label="velocity (m/s)", x=x, y=1e3 * run.time[thin[0]], values=values)
        panels.append(TEXTS.panel("scene", map=velocities, title=title))
    return replace(TEXTS.figure("scenes", panels), small=True, columns=6) if panels else None


def _over_limit(contact: ContactValidity, nth: int) -> float:
    """Return how far a contact is beyond the limit of an assumption: above 1 it is violated."""
    judged = contact.judged[nth]
    return judged.limit / judged.ratio if nth == _SOUND else judged.ratio / judged.limit


__all__ = ["all_scenes", "scale_of_differences", "tornado", "validity_figure"]
