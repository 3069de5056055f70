"""State what a verification is for: intended use, domain tested, tolerances, verification of codes and of solutions.

The words are those of ASME V&V 10 and 40: code verification asks whether a program solves its equations correctly,
solution verification how large the numerical error of a given run is, and validation whether the equations describe
reality.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from dem_bridge.studies.texts import Texts
from dem_bridge.studies.verification import Verification
from dem_bridge.verification.verdict import Outcome

TEXTS = Texts("scope")
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
        "few": min(scene.n_body for scene in scenes),
        "many": max(scene.n_body for scene in scenes),
        "soft": float(stiffness.min()),
        "stiff": float(stiffness.max()),
        "low": float(exponents.min()),
        "high": float(exponents.max()),
        "speed": max(float(np.max(np.abs(scene.velocity))) for scene in scenes),
        "features": ", ".join(features) or "none",
        "accuracy": verification.accuracy,
        "verdicts": counts.total(),
        "passed": counts[Outcome.PASS],
        "budgets": len(budgets),
        "unexplained": sum(budget.is_finding for budget in budgets),
    }
    return tuple((TEXTS.data["headings"][part], TEXTS(part, **values)) for part in PARTS)
