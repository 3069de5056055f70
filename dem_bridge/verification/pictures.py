"""Begin the pictures of a verification: those of the page, and those that are drawn while runs are made.

Where no process draws beside this one, pictures are drawn when they are shown.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from dem_bridge.report.drawer import drawn, is_drawing_beside
from dem_bridge.report.images import begin_recalled_picture
from dem_bridge.report.svg import svg_drawn_by, svg_of_data
from dem_bridge.runs.store import Store
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.panels import front_of, maps_of, motion_of
from dem_bridge.verification.verification import Verification

#: the module that draws, which imports matplotlib
_FIGURES = "dem_bridge.verification.figures"
#: pictures that are the same whatever the verdicts are, and the functions of their data
_OF_RUNS = {"motion": motion_of, "spacetime_maps": maps_of, "front_along_chain": front_of}


def with_figures_of(study: Verification) -> list[SceneStudy]:
    """Return the scenes with figures of their own: those with refinement levels, if the whole paper was verified."""
    refined = [item for item in study.studies if any(len(steps) > 1 for steps, _ in item.refinement.values())]
    return refined if study.claims else list(study.studies)


def pictures_shown(study: Verification) -> list[tuple[str, list[SceneStudy]]]:
    """List the pictures that the page shows: the name of each in :mod:`.figures`, and its scenes."""
    chains, paper = with_figures_of(study), bool(study.claims)
    motions = [] if paper else [("motion", [item]) for item in study.studies]
    budgets = [("error_budget", [item]) for item in chains if item.budgets]
    names = ("convergence",) if paper else ("spacetime_maps", "front_along_chain", "convergence")
    return [*motions, *budgets, *((name, chains[k : k + 2]) for k in range(0, len(chains), 2) for name in names)]


def begin_pictures(study: Verification, store: Store | None) -> Callable[[str, Sequence[SceneStudy]], str | None]:
    """Begin to draw the pictures of the page, and return the function that awaits one of them."""

    def place(name: str, studies: Sequence[SceneStudy]) -> tuple[str, ...]:
        return (name, *(item.scene.name for item in studies))

    begun = {place(name, studies): begin_picture(name, studies, store) for name, studies in pictures_shown(study)}
    return lambda name, studies: begun[place(name, studies)]()


def begin_picture(name: str, studies: Sequence[SceneStudy], store: Store | None = None) -> Callable[[], str | None]:
    """Begin a picture that a function of :mod:`.figures` draws, and return what awaits it: None if it draws none."""

    def begin() -> Callable[[], str | None]:
        if name not in _OF_RUNS:
            return begin_of_verdicts(name, studies)
        data = _OF_RUNS[name](studies)
        return (lambda: None) if data is None else drawn(svg_of_data, data)

    keys = [result.key for study in studies for result in study.results]
    judged = [
        (
            study.refinement,
            [verdict.as_json() for verdict in study.verdicts],
            [budget.as_json() for budget in study.budgets],
        )
        for study in studies
    ]
    return begin_recalled_picture(store, name, keys, begin, [study.scene for study in studies], judged=judged)


def begin_of_verdicts(name: str, studies: Sequence[SceneStudy]) -> Callable[[], str | None]:
    """Begin a picture that a function of :mod:`.figures` draws of verdicts, and return what awaits it."""
    return drawn(svg_drawn_by, _FIGURES, name, [only_drawn(study) for study in studies])


def begin_budget(study: SceneStudy) -> None:
    """Begin to draw the error budget as soon as it is there; nothing where no process draws."""
    if is_drawing_beside() and study.budgets:
        begin_of_verdicts("error_budget", [study])


def begin_motion(study: SceneStudy) -> None:
    """Begin to draw what is shown of LAMMPS' run, as soon as it is there; nothing where no process draws."""
    if is_drawing_beside():
        for data in (motion_of([study]), maps_of([study])):
            if data is not None:
                drawn(svg_of_data, data)


def only_drawn(study: SceneStudy) -> SceneStudy:
    """Return a study without what no picture of verdicts shows: of the runs it has LAMMPS' main run alone."""
    runs = [result for result in study.results if result.case.backend == study.engine][:1]
    return replace(study, roles=replace(study.roles), runs=None, others=tuple(runs), observables=())
