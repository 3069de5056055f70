"""Make the pictures of the runs of a verification, which the store keeps under the keys of these runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from dem_bridge.report.images import recalled_picture, svg_of
from dem_bridge.runs.store import Store
from dem_bridge.verification.assess import SceneStudy

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def picture_of_runs(name: str, studies: Sequence[SceneStudy], store: Store | None = None) -> str | None:
    """Return the picture that a function of :mod:`.figures` or :mod:`.motion` draws of runs; None if it draws none."""

    def draw() -> str | None:
        from dem_bridge.verification import figures, motion

        figure: Figure | None = getattr(motion if name == "motion" else figures, name)(studies)
        return None if figure is None else svg_of(figure)

    keys = [result.key for study in studies for result in study.results]
    judged = [
        (
            study.refinement,
            [verdict.as_json() for verdict in study.verdicts],
            [budget.as_json() for budget in study.budgets],
        )
        for study in studies
    ]
    return recalled_picture(store, name, keys, draw, [study.scene for study in studies], judged=judged)
