"""State what a verification is for: intended use, domain tested, tolerances, verification of codes and of solutions.

The words are those of ASME V&V 10 and 40: code verification asks whether a program solves its equations correctly,
solution verification how large the numerical error of a given run is, and validation whether the equations describe
reality.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dem_bridge.observables.verdict import Outcome
from dem_bridge.report.texts import Texts
from dem_bridge.verification.verification import Verification

TEXTS = Texts("scope", "dem_bridge.verification")
PARTS = ("use", "domain", "tolerances", "code", "solution", "validation")


def scope(verification: Verification) -> tuple[tuple[str, str], ...]:
    """Return headings with their paragraphs; numbers follow from the scenes and the verdicts."""
    scenes = [study.scene for study in verification.studies]
    if not scenes:
        return ()
    counts = Counter(verdict.outcome for verdict in verification.verdicts)
    budgets = [budget for study in verification.studies for budget in study.budgets]
    exponents = np.concatenate([scene.contacts.exponent for scene in scenes])
    stiffness = np.concatenate([scene.contacts.stiffness for scene in scenes])
    features = sorted({feature.label for scene in scenes for feature in scene.features})
    values = {
        "scenes": len(scenes),
        "bodies": _range([scene.n_body for scene in scenes]),
        "stiffness": _range(stiffness),
        "exponents": _range(exponents),
        "speed": max(float(np.max(np.abs(scene.velocity))) for scene in scenes),
        "features": ", ".join(features) or "none",
        "accuracy": verification.accuracy,
        "verdicts": counts.total(),
        "passed": counts[Outcome.PASS],
        "budgets": len(budgets),
        "unexplained": sum(budget.is_finding for budget in budgets),
    }
    return tuple((TEXTS(part, "headings"), TEXTS(part, **values)) for part in PARTS)


def _range(values: Sequence[float] | NDArray[np.float64]) -> str:
    """Return the least and the largest of some values as text, or the value if all are the same."""
    ends = [f"{value:.3g}" for value in (np.min(values), np.max(values))]
    return ends[0] if ends[0] == ends[1] else f"{ends[0]} to {ends[1]}"
